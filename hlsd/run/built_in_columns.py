"""The built-in columns of the rows, each declared once.

A column says what it holds, in which unit, to how many decimals, from where, and how
its value follows from what was driven.
"""

import math
from collections.abc import Callable

from hlsd.planners.base import Mode
from hlsd.run.field import (
    ARENA,
    CHALLENGE,
    PAPER,
    RECOVERY,
    Driven,
    Field,
    Judgement,
    Value,
)


def _official_length_m(driven: Driven) -> float:
    """To the micrometre, so that scores have the digits that the Challenge prints."""
    protocol = driven.course.protocol
    if protocol.score is None:
        return math.nan
    return protocol.official_length_m(driven.course.world)


def _perturbations(driven: Driven) -> str:
    """As they are typed, those left out whose size changes nothing."""
    return ", ".join(
        str(held) for held, made in driven.course.between if held.size != made.neutral
    )


def _planning(part: str, title: str, of: Callable[[Driven], Value]) -> Field:
    return Field(
        f"planning_{part}_ms",
        "number",
        of,
        f"{title[0].upper()}{title[1:]} over a run's ticks of the wall time from scan "
        "to command: costmap, global plan and planner. It depends on the machine.",
        unit="ms",
        decimals=4,
        table="timing",
        metric=Judgement(f"planning time, {title}", "lower"),
    )


BUILT_IN = (
    Field(
        "suite",
        "text",
        lambda d: d.conditions.suite,
        "Name of the suite.",
        required=True,
    ),
    Field(
        "suite_version",
        "text",
        lambda d: d.conditions.suite_version,
        "Version of the suite's worlds.",
        required=True,
    ),
    Field(
        "world",
        "whole",
        lambda d: d.course.world.index,
        "Index of the world in the suite.",
        required=True,
    ),
    Field(
        "planner",
        "text",
        lambda d: d.planner,
        "Name of the planner.",
        required=True,
    ),
    Field(
        "robot",
        "text",
        lambda d: d.conditions.robot,
        "Name of the robot.",
        required=True,
    ),
    Field(
        "robot_version",
        "text",
        lambda d: d.conditions.robot_version,
        "Version of the robot's parameters.",
        required=True,
    ),
    Field(
        "trial",
        "whole",
        lambda d: d.trial,
        "Number of the run within the world, from 0.",
        required=True,
    ),
    Field(
        "seed",
        "whole",
        lambda d: math.nan if d.conditions.seed is None else d.conditions.seed,
        "Seed of start, noise and perturbations.",
        required=True,
    ),
    Field(
        "protocol",
        "text",
        lambda d: d.conditions.protocol.name,
        "Name of the protocol; `run.json` holds its rules.",
        required=True,
    ),
    Field(
        "outcome",
        "text",
        lambda d: d.episode.outcome.value,
        "How the run ended: success, timeout, collision or error.",
        required=True,
    ),
    Field(
        "reason",
        "text",
        lambda d: d.episode.reason,
        "For an error its kind, a colon, what the planner did, and file and line where "
        "they are known; else empty.",
        required=True,
    ),
    Field(
        "perturbations",
        "text",
        _perturbations,
        "What stood between world and robot, in order, as it is typed for `--perturb`; "
        "empty where nothing did. A size that changes nothing is left out; `run.json` "
        "has all.",
    ),
    Field(
        "time_s",
        "number",
        lambda d: d.episode.time_s,
        "Time on the protocol's clock; the limit for timeouts and errors.",
        unit="s",
        decimals=4,
        source=PAPER,
        required=True,
    ),
    Field(
        "contacts",
        "whole",
        lambda d: d.episode.contacts,
        "Number of contacts with obstacles that began.",
        required=True,
    ),
    Field(
        "mover_contacts",
        "whole",
        lambda d: d.episode.mover_contacts,
        "Number of those contacts that were with moving obstacles.",
    ),
    Field(
        "contact_time_s",
        "number",
        lambda d: d.episode.contact_time_s,
        "Time during which an obstacle was touched, counted in physics steps.",
        unit="s",
        decimals=4,
        required=True,
        metric=Judgement("time in contact", "lower", version=2),
    ),
    Field(
        "path_length_m",
        "number",
        lambda d: d.episode.path_length_m,
        "Length that base_link drove, sampled at ticks, from the start until the run "
        "ended. Of a failure it says little.",
        unit="m",
        decimals=4,
        required=True,
        metric=Judgement("path length", None, version=2),
    ),
    Field(
        "official_length_m",
        "number",
        _official_length_m,
        "The Challenge's path length from start to goal; empty under protocols without "
        "a score.",
        unit="m",
        decimals=6,
        source=CHALLENGE,
    ),
    Field(
        "shortest_length_m",
        "number",
        lambda d: d.course.shortest_length_m,
        "Length of the shortest way from the start to where the goal counts as "
        "reached, for a round robot that knows all obstacles; its radius is that of "
        "the largest circle within the robot's outline (hlsd.data.shortest).",
        unit="m",
        decimals=4,
    ),
    Field(
        "min_clearance_m",
        "number",
        lambda d: d.episode.record.clearances_m.min(),
        "Least distance, over the poses at ticks, from the robot's outline (wheels "
        "included) to the nearest obstacle's surface; 0 where they overlap.",
        unit="m",
        decimals=4,
        source=f"after {ARENA}, min_obstacle_distance",
        metric=Judgement("minimum clearance", "higher", decimals=3, version=2),
    ),
    Field(
        "mean_clearance_m",
        "number",
        lambda d: d.episode.record.clearances_m.mean(),
        "Mean of the distance of min_clearance_m over the poses at ticks.",
        unit="m",
        decimals=4,
        source=f"after {ARENA}, min_obstacle_distance",
        metric=Judgement("mean clearance", "higher", decimals=3, version=2),
    ),
    Field(
        "jerk_m_s3",
        "number",
        lambda d: d.episode.record.jerk_m_s3,
        "Mean of |v[k+1] - 2 v[k] + v[k-1]| / T², v the measured forward speed every "
        "T = 0.1 s, interpolated between the planner's ticks, so that planners of "
        "different periods compare. Not defined for runs of less than 0.2 s.",
        unit="m/s³",
        decimals=4,
        source=f"one difference more than velocity_smoothness in {ARENA}",
        metric=Judgement("mean absolute jerk", "lower"),
    ),
    Field(
        "yaw_rate_change_rad_s",
        "number",
        lambda d: d.episode.record.yaw_rate_change_rad_s,
        "Mean of |omega[k+1] - omega[k]|, omega the measured yaw rate every 0.1 s, "
        "interpolated as for jerk_m_s3. Not defined for runs of less than 0.1 s.",
        unit="rad/s",
        decimals=5,
        source=f"velocity_smoothness in {ARENA}, for the yaw rate and not divided by "
        "time",
        metric=Judgement("mean absolute change of yaw rate", "lower", decimals=3),
    ),
    Field(
        "recoveries",
        "whole",
        lambda d: d.episode.record.recoveries,
        "Number of times that recovery began: rotating, reversing or a recovery of "
        "move_base, after any other mode.",
        source=RECOVERY,
        metric=Judgement("recoveries", "lower", version=2),
    ),
    Field(
        "contact_distance_m",
        "number",
        lambda d: d.episode.record.contact_distance_m,
        "Length driven in ticks in which an obstacle was touched in any physics step.",
        unit="m",
        decimals=4,
        metric=Judgement("distance in contact", "lower", decimals=3, version=2),
    ),
    Field(
        "time_to_contact_s",
        "number",
        lambda d: d.episode.time_to_contact_s,
        "Time on the protocol's clock at the first contact; 0 where the clock had not "
        "started, empty where there was no contact.",
        unit="s",
        decimals=4,
    ),
    Field(
        "movers_begin_s",
        "number",
        lambda d: d.episode.movers_begin_s,
        "What the moving obstacles' clocks read when the run began, drawn from seed, "
        "world and trial; empty where nothing moves.",
        unit="s",
        decimals=4,
    ),
    Field(
        "recovery_ticks",
        "whole",
        lambda d: int(d.episode.record.recovering.sum()),
        "Ticks spent in recovery: rotating, reversing, or a recovery of move_base.",
        source=RECOVERY,
        required=True,
    ),
    Field(
        "turn_ticks",
        "whole",
        lambda d: d.episode.record.count(Mode.TURN_IN_PLACE),
        "Ticks spent in LfH's Turn in Place.",
        required=True,
    ),
    Field(
        "ticks",
        "whole",
        lambda d: d.episode.ticks,
        "Number of planner calls that gave a command.",
        required=True,
    ),
    Field(
        "replans",
        "whole",
        lambda d: d.episode.replans,
        "Number of global plans made.",
        required=True,
    ),
    Field(
        "sim_steps",
        "whole",
        lambda d: d.episode.sim_steps,
        "Number of physics steps.",
        required=True,
    ),
    Field(
        "sim_time_s",
        "number",
        lambda d: d.episode.sim_time_s,
        "Simulated time, what passes before the clock starts included.",
        unit="s",
        decimals=4,
        required=True,
    ),
    Field(
        "cause",
        "text",
        lambda d: d.verdict.cause or "",
        "Why a run that timed out or collided failed, by the rules of "
        "[causes](causes.md); empty for successes and errors.",
    ),
    Field(
        "cause_s",
        "number",
        lambda d: d.verdict.moment_s,
        "Simulated time since the episode began at which it went wrong, by the same "
        "rules; empty where there is no cause.",
        unit="s",
        decimals=4,
    ),
    Field(
        "wall_s",
        "number",
        lambda d: d.episode.wall_s,
        "Wall time of the episode; it depends on the machine and never repeats.",
        unit="s",
        decimals=4,
        required=True,
    ),
    Field(
        "planning_wall_s",
        "number",
        lambda d: d.episode.planning.wall_s,
        "Sum over all ticks of the wall time from scan to command: costmap, global "
        "plan and planner.",
        unit="s",
        decimals=6,
        table="timing",
        required=True,
    ),
    _planning("median", "median", lambda d: d.episode.planning.median_ms),
    _planning("p95", "95th percentile", lambda d: d.episode.planning.p95_ms),
    _planning("max", "maximum", lambda d: d.episode.planning.max_ms),
    Field(
        "overruns",
        "whole",
        lambda d: d.episode.planning.overruns,
        "Ticks whose planning took longer than the planner's period.",
        table="timing",
    ),
)
