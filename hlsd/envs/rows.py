"""The row of an episode that was stepped by hand, as numbers."""

import math
from typing import TypeAlias

from hlsd.data.worlds import Suite
from hlsd.run.conditions import Conditions
from hlsd.run.episode import Episode
from hlsd.run.field import Driven
from hlsd.run.row import fields, row_of
from hlsd.run.session import Session

Numbers: TypeAlias = dict[str, str | int | float]
"""A row: text, whole numbers and numbers by column."""

_LEFT_OUT = ("planner", "reason", "wall_s")
"""There is no planner, and wall times are the learner's."""


def numbers_of(episode: Episode, session: Session, suite: Suite) -> Numbers:
    """The row of an episode that is over.

    Args:
        episode: What happened.
        session: In which.
        suite: Where its world is from.

    Returns:
        What ``episodes.csv`` holds, to as many decimals, but for planner, reason and
        wall time; NaN where a cell is empty.
    """
    course = session.course
    conditions = Conditions(
        suite=suite.name,
        suite_version=suite.version,
        suite_digest="",
        protocol=course.protocol,
        robot=course.robot.name,
        robot_version=course.robot.version,
        seed=session.seed,
        perturbations=course.disturbances,
    )
    driven = Driven(conditions, "", session.trial, course, episode)
    held = [
        field
        for field in fields()
        if field.table == "episodes" and field.name not in _LEFT_OUT
    ]
    row = row_of(driven, held)
    numbers: Numbers = {}
    for field in held:
        cell = row[field.name]
        if field.kind == "text":
            numbers[field.name] = cell
        elif not cell:
            numbers[field.name] = math.nan
        else:
            numbers[field.name] = int(cell) if field.kind == "whole" else float(cell)
    return numbers
