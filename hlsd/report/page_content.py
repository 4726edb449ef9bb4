"""Runs -> all that their page shows."""

import shlex
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd

from hlsd.analysis.provenance import provenances
from hlsd.analysis.runs import join_trajectories, suite_digest
from hlsd.analysis.statistics import CumulativeIncidence, Profile
from hlsd.core.errors import HlsdError
from hlsd.data.difficulty import Difficulty
from hlsd.data.kept import kept
from hlsd.data.worlds import Suite, load_suite
from hlsd.report.cause_table import cause_table
from hlsd.report.curves import (
    TimesByWorld,
    incidences,
    orders_at_hand,
    profiles,
    times_by_worlds,
)
from hlsd.report.page_data import PageContent
from hlsd.report.planner_tables import (
    driving_table,
    pair_tables,
    planning_table,
    resample_ahead,
    summary_table,
)
from hlsd.report.tables import Table
from hlsd.run.trajectory import Key
from hlsd.sim.robots import RobotDescription, get_robot


@dataclass(frozen=True, slots=True, eq=False)
class Numbers:
    """What is computed of runs: as `PageContent` has it."""

    summary: Sequence[Table]
    pairs: Sequence[Table]
    orders: Sequence[TimesByWorld]
    profiles: Sequence[tuple[str, Profile]]
    incidences: Sequence[tuple[str, CumulativeIncidence]]


def tables_of(episodes: pd.DataFrame) -> tuple[list[Table], tuple[Table, ...]]:
    """Tables of planners, the summary first, and tables of pairs.

    Args:
        episodes: From `hlsd.analysis.runs.join_runs`, of one protocol.
    """
    makers = (summary_table, cause_table, driving_table, planning_table)
    resample_ahead(episodes)
    found = (make(episodes) for make in makers)
    return [table for table in found if table is not None], pair_tables(episodes)


def curves_of(
    episodes: pd.DataFrame, suite: Suite | None
) -> tuple[
    Sequence[TimesByWorld],
    Sequence[tuple[str, Profile]],
    Sequence[tuple[str, CumulativeIncidence]],
]:
    """Times over worlds in each order at hand, profiles, and what came first.

    Args:
        episodes: As of `tables_of`.
        suite: Of the worlds; None where it is not at hand.
    """
    orders = _orders(episodes, suite)
    return orders, list(profiles(episodes)), list(incidences(episodes))


def page_content(
    runs: Sequence[Path],
    episodes: pd.DataFrame,
    suite: Suite | None,
    numbers: Numbers,
    blocks: Sequence[Mapping[Key, bytes]] | None = None,
) -> PageContent:
    """All that the page of some runs shows.

    Args:
        runs: Their folders.
        episodes: From `hlsd.analysis.runs.join_runs`.
        suite: Of the worlds; None where it is not at hand.
        numbers: Of the same episodes.
        blocks: Trajectories of each run; those of its archive if left out.

    Raises:
        HlsdError: An archive or a record is damaged.
    """
    robot = _robot(episodes)
    return PageContent(
        episodes=episodes,
        # Without its robot's outline and lidar no run can be replayed.
        trajectories=(
            {} if robot is None else join_trajectories(runs, episodes, blocks)
        ),
        suite=suite,
        robot=robot or get_robot("jackal"),
        orders=numbers.orders,
        summary=numbers.summary,
        pairs=numbers.pairs,
        profiles=numbers.profiles,
        incidences=numbers.incidences,
        runs=[shlex.quote(str(run)) for run in runs],
        provenance=provenances(runs),
    )


def _orders(episodes: pd.DataFrame, suite: Suite | None) -> list[TimesByWorld]:
    difficulty: dict[int, Difficulty] | None = None
    if suite is not None:
        worlds = sorted({int(world) for world in episodes["world"]})
        read = {world: suite[world] for world in worlds}
        if all(world.arena is None for world in read.values()):  # grids, all of them
            difficulty = {index: world.difficulty() for index, world in read.items()}
    return times_by_worlds(episodes, orders_at_hand(episodes, difficulty), difficulty)


def _robot(episodes: pd.DataFrame) -> RobotDescription | None:
    """The runs'; the Jackal where an imported run names none; None where it is gone."""
    named = [str(name) for name in episodes["robot"].unique() if name]
    try:
        return get_robot(named[0] if named else "jackal")
    except HlsdError:
        return None


def suite_of(
    runs: Sequence[Path], episodes: pd.DataFrame, given: str | None
) -> Suite | None:
    """The worlds of the runs; None where they are not at hand.

    Args:
        runs: Their folders.
        episodes: From `hlsd.analysis.runs.join_runs`.
        given: Name or folder of the suite; None for the one that the rows name.

    Raises:
        HlsdError: What was given is not what was driven in.
    """
    name, version = (str(episodes[c].iloc[0]) for c in ("suite", "suite_version"))
    try:
        suite = kept(load_suite(name if given is None else given))
    except HlsdError:
        if given is not None:
            raise
        return None
    missing = sorted({int(w) for w in episodes["world"]} - set(suite.indices))
    digests = {digest for run in runs if (digest := suite_digest(run))}
    same = suite.version == version or not version
    if same and not missing and digests <= {suite.digest}:
        return suite
    if given is None:
        return None
    raise HlsdError(
        f"suite {given!r} is not what was driven in: the runs are of {name!r}, version "
        f"{version or 'unknown'}"
        + (f", which has a world {missing[0]}" if missing else "")
    )
