"""What a column of the rows is: its value, its meaning, its unit, its source."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Literal, TypeAlias

from hlsd.run.cause import Verdict, cause_of
from hlsd.run.conditions import Conditions
from hlsd.run.episode import Episode
from hlsd.run.session import Course

Better: TypeAlias = Literal["lower", "higher"]
Value: TypeAlias = str | int | float

PAPER = "Xiao, Liu and Stone 2021, section IV-B and table I"
RECOVERY = "Xiao, Liu and Stone 2021, section IV-A, for what recovery is"
CHALLENGE = "BARN Challenge, nav-competition-icra2022 and the-barn-challenge, run.py"
ARENA = "arena-evaluation, 02_evaluation/get_metrics.py"
OURS = "this project"


@dataclass(frozen=True)
class Driven:
    """An episode and all that it came from.

    Attributes:
        conditions: What it was driven under.
        planner: Name of the planner.
        trial: Its number within the world.
        course: World, robot and protocol.
        episode: What happened.
    """

    conditions: Conditions
    planner: str
    trial: int
    course: Course
    episode: Episode

    @cached_property
    def verdict(self) -> Verdict:
        """Why the run failed, and when."""
        goal = self.course.protocol.goal(self.course.world)
        return cause_of(self.episode.record, self.episode.outcome, goal)


@dataclass(frozen=True, slots=True)
class Judgement:
    """What makes a column a metric as well.

    Attributes:
        title: In words.
        better: Which way is better; None where neither is, taken alone.
        scale: Printed values are this times the value.
        decimals: Of printed values.
        version: Goes up when it is redefined.
    """

    title: str
    better: Better | None
    scale: float = 1.0
    decimals: int = 2
    version: int = 1


@dataclass(frozen=True, slots=True)
class Field:
    """A column of the rows.

    Attributes:
        name: In tables; unit at its end where it has one.
        kind: Whether it is text, a whole number, or a number with decimals. An empty
            cell is a number that is not defined, or unknown.
        of: Its value in a row; NaN where it is not defined.
        meaning: What exactly it is, in a sentence.
        unit: "" for none.
        decimals: Their number in tables.
        source: Whose definition.
        table: The file it stands in; wall times never repeat, so that all but
            ``wall_s`` stand in a table of their own.
        required: Whether every table of episodes has it. Where another column is
            missing, it is read as empty.
        metric: What makes it a metric as well; None where it is a column only.
    """

    name: str
    kind: Literal["text", "whole", "number"]
    of: Callable[[Driven], Value]
    meaning: str
    unit: str = ""
    decimals: int = 0
    source: str = OURS
    table: Literal["episodes", "timing"] = "episodes"
    required: bool = False
    metric: Judgement | None = None

    def text(self, driven: Driven) -> str:
        """Its cell in a row."""
        value = self.of(driven)
        if self.kind == "text":
            return str(value)
        if not math.isfinite(float(value)):
            return ""
        if self.kind == "whole":
            return str(int(value))
        return f"{float(value):.{self.decimals}f}"
