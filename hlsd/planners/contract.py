"""What every planner must do, as checks that run without a simulator.

For the planners here and for those of others:

    from hlsd.planners.contract import check_planner
    check_planner(MyPlanner)

drives a few seconds through imagined places: a unicycle that follows the commands, a
path, and scans that need not fit to either. It takes about a second for a fast planner.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hlsd.core.errors import HlsdError
from hlsd.core.geometry import turn_into, wrap_angle
from hlsd.core.text import error_text
from hlsd.core.types import FloatArray
from hlsd.planners.base import Command, Mode, Observation, Planner, Setup
from hlsd.planners.driving import PlannerFaultError, checked_command
from hlsd.planners.driving import drive as run
from hlsd.planners.making import made
from hlsd.planners.registry import PlannerEntry

SECONDS = 2.0
"""How long each check drives."""


class BrokenContractError(AssertionError):
    """A planner does not do what every planner must; says which rule and how."""


@dataclass(frozen=True, slots=True)
class Place:
    """Where a planner is driven.

    Attributes:
        name: For messages.
        ranges_m: Draws a scan, ``(beams,)`` [m].
        path_in_odom: From the start on, ``(n, 2)`` [m], points about 5 cm apart.
    """

    name: str
    ranges_m: Callable[[Setup, np.random.Generator], FloatArray]
    path_in_odom: FloatArray


def check_planner(factory: Callable[[], Planner]) -> None:
    """Run every check of this module that concerns a planner.

    Args:
        factory: Makes a new planner, like the ones that ``--planner`` names.

    Raises:
        BrokenContractError: The first rule that is broken.
    """
    check_can_be_made(factory)
    check_same_seed_same_bytes(factory)
    check_reset_forgets(factory)
    check_commands_within_limits(factory)
    check_survives_clear_and_blocked(factory)
    check_observation_is_not_kept(factory)


def check_can_be_made(factory: Callable[[], Planner]) -> None:
    """A class, or a function without arguments, makes a planner.

    Raises:
        BrokenContractError: It does not; says what it makes, or what that lacks.
    """
    name = str(getattr(factory, "__name__", type(factory).__name__))
    try:
        made(name, factory)
    except HlsdError as error:
        raise BrokenContractError(str(error)) from error


def check_same_seed_same_bytes(factory: Callable[[], Planner]) -> None:
    """Two new planners, told the same, give the same commands to the last bit.

    Raises:
        BrokenContractError: They do not.
    """
    setup = Setup(seed=7)
    for place in places():
        first, second = (drive(factory(), place, setup) for _ in range(2))
        _require_same(first, second, f"same seed, same bytes ({place.name})")


def check_reset_forgets(factory: Callable[[], Planner]) -> None:
    """A planner that has driven elsewhere does as a new one after `reset`.

    Raises:
        BrokenContractError: It does not.
    """
    setup = Setup(seed=7)
    used = factory()
    for place in places():
        # Another seed and a place behind: every memory holds something else by then.
        drive(used, _random_place(seed=99, bend=2.0), Setup(seed=8))
        _require_same(
            drive(factory(), place, setup),
            drive(used, place, setup),
            f"reset forgets ({place.name})",
        )


def check_commands_within_limits(factory: Callable[[], Planner]) -> None:
    """Commands are finite, and no faster than the robot.

    Raises:
        BrokenContractError: One is not, or is no `Command`.
    """
    setup = Setup(seed=7)
    limits = setup.limits
    for place in places():
        for k, command in enumerate(drive(factory(), place, setup)):
            where = f"tick {k}, {place.name}"
            _require(
                isinstance(command, Command) and isinstance(command.mode, Mode),
                f"plan returns a Command with a Mode ({where}), not {command!r}",
            )
            _require(
                math.isfinite(command.speed) and math.isfinite(command.yaw_rate),
                f"commands are finite ({where}), not {command}",
            )
            _require(
                abs(command.speed) <= limits.max_speed
                and abs(command.yaw_rate) <= limits.max_yaw_rate,
                f"commands are within {limits.max_speed} m/s and "
                f"{limits.max_yaw_rate} rad/s ({where}), not {command}",
            )


def check_survives_clear_and_blocked(factory: Callable[[], Planner]) -> None:
    """A scan without any return, and one with returns all around, break nothing.

    Raises:
        BrokenContractError: The planner raised.
    """
    setup = Setup(seed=7)
    path = _bent_path(0.0)
    for name, reading in (
        ("all clear", setup.lidar.max_range_m),
        ("all blocked", 0.25),
        ("all blocked at the sensor", setup.lidar.min_range_m),
        ("all below the least range", 0.0),
    ):
        place = Place(name, _constant(reading), path)
        try:
            drive(factory(), place, setup)
        except Exception as error:
            raise BrokenContractError(
                f"a planner survives a scan that is {name}: {error_text(error)}"
            ) from error


def check_observation_is_not_kept(factory: Callable[[], Planner]) -> None:
    """The planner neither changes an observation nor looks at it afterwards.

    Raises:
        BrokenContractError: An array was changed, or commands differ when the arrays
            of past observations are overwritten.
    """
    setup = Setup(seed=7)
    for place in places():
        _require_same(
            drive(factory(), place, setup),
            drive(factory(), place, setup, spoil=True),
            f"past observations are not kept ({place.name})",
        )


def check_asks_for_policy(entry: PlannerEntry, missing: Path) -> None:
    """A planner that needs a policy file says which command makes one.

    Args:
        entry: The planner; one that needs none passes.
        missing: A path where there is no file.

    Raises:
        BrokenContractError: It does not.
    """
    if not entry.needs_policy:
        return
    try:
        entry.build(missing)
    except HlsdError as error:
        _require(
            f"hlsd train --planner {entry.trained_as} " in str(error)
            and "\n" not in str(error),
            f"the error of a missing policy is one line with the command that makes "
            f"one, not {str(error)!r}",
        )
        return
    raise BrokenContractError(f"planner {entry.name!r} accepts a policy that is absent")


def places() -> tuple[Place, ...]:
    """Where the checks drive: random scans, and paths to every side."""
    return tuple(
        _random_place(seed, bend) for seed, bend in enumerate((0.0, 0.6, -0.6, 2.5))
    )


def drive(
    planner: Planner, place: Place, setup: Setup, spoil: bool = False
) -> list[Command]:
    """Reset a planner and follow its commands for `SECONDS`.

    Args:
        planner: Who drives.
        place: Where.
        setup: Told to the planner; its seed also draws the scans.
        spoil: Whether to overwrite the arrays of each observation after its tick.

    Returns:
        The commands.

    Raises:
        BrokenContractError: The period is not a positive number, or an observation was
            changed.
    """
    period = planner.period_s
    _require(
        math.isfinite(period) and period > 0.0,
        f"period_s is a positive number of seconds, not {period}",
    )
    planner.reset(setup)
    imagined = _Imagined(place, setup, period, spoil)
    run(planner, imagined, imagined.observation, ask=_ask_unguarded)
    return imagined.commands


class _Imagined:
    """A unicycle in a place, as something that can be stepped."""

    def __init__(self, place: Place, setup: Setup, period_s: float, spoil: bool):
        self.commands: list[Command] = []
        self._place, self._setup, self._period_s = place, setup, period_s
        self._spoil = spoil
        self._rng = np.random.default_rng(setup.seed)
        self._pose, self._command = np.zeros(3), Command(0.0, 0.0)
        self.observation = self._observe()

    @property
    def outcome(self) -> str | None:
        """None until its time is up."""
        done = len(self.commands) >= math.ceil(SECONDS / self._period_s)
        return "done" if done else None

    def step(self, command: Command) -> Observation:
        """Follow a command for one period."""
        before, after = self._held, _contents(self.observation)
        rule = f"plan leaves its observation alone ({self._place.name})"
        _require(before == after, rule)
        if self._spoil:
            for array in _arrays(self.observation):
                array.flags.writeable = True
                array.fill(math.nan)
        self.commands.append(command)
        self._command = _numbers(command)
        self._pose = _follow(self._pose, self._command, self._period_s)
        self.observation = self._observe()
        return self.observation

    def _observe(self) -> Observation:
        observation = _observe(
            len(self.commands) * self._period_s,
            self._place,
            self._setup,
            self._pose,
            self._command,
            self._rng,
        )
        self._held = _contents(observation)
        return observation


def _ask_unguarded(planner: Planner, observation: Observation) -> Command:
    """What the planner gives, whatever it is: the checks judge it."""
    return planner.plan(observation)


def _numbers(command: Command) -> Command:
    """A command in plain numbers, which need not be finite."""
    try:
        return checked_command(command, finite=False)
    except PlannerFaultError as fault:
        raise BrokenContractError(
            fault.reason.removeprefix(f"{fault.kind}: ")
        ) from fault


def _contents(observation: Observation) -> list[bytes]:
    return [array.tobytes() for array in _arrays(observation)]


def _observe(
    time_s: float,
    place: Place,
    setup: Setup,
    pose: FloatArray,
    command: Command,
    rng: np.random.Generator,
) -> Observation:
    away = np.hypot(*(place.path_in_odom - pose[:2]).T)
    path = place.path_in_odom[int(away.argmin()) :].copy()
    far = np.flatnonzero(np.hypot(*(path - pose[:2]).T) >= 1.0)
    goal = path[far[0]] if len(far) else path[-1]
    dx, dy = goal - pose[:2]
    ahead = turn_into(dx, dy, math.cos(pose[2]), math.sin(pose[2]))
    observation = Observation(
        time_s=time_s,
        ranges_m=place.ranges_m(setup, rng),
        speed=command.speed,
        yaw_rate=command.yaw_rate,
        pose_in_odom=pose.copy(),
        path_in_odom=path,
        local_goal_in_base=np.array(ahead),
        goal_in_odom=path[-1].copy(),
    )
    for array in _arrays(observation):
        array.flags.writeable = False
    return observation


def _arrays(observation: Observation) -> Iterator[FloatArray]:
    yield observation.ranges_m
    yield observation.pose_in_odom
    yield observation.path_in_odom
    yield observation.local_goal_in_base
    yield observation.goal_in_odom


def _follow(pose: FloatArray, command: Command, period: float) -> FloatArray:
    """A unicycle that does as it is told; commands that are no number stop it."""
    speed, yaw_rate = command.speed, command.yaw_rate
    if not (math.isfinite(speed) and math.isfinite(yaw_rate)):
        return pose
    yaw = pose[2] + yaw_rate * period
    return np.array(
        [
            pose[0] + speed * period * math.cos(yaw),
            pose[1] + speed * period * math.sin(yaw),
            wrap_angle(yaw),
        ]
    )


def _random_place(seed: int, bend: float) -> Place:
    """Obstacles at random distances, 40 to the turn, wherever the robot goes."""
    steady = np.random.default_rng((seed, 1)).uniform(0.2, 4.0, 40)

    def scan(setup: Setup, rng: np.random.Generator) -> FloatArray:
        lidar = setup.lidar
        sector = np.arange(lidar.beams) * len(steady) // lidar.beams
        noise = lidar.noise_sd_m * rng.standard_normal(lidar.beams)
        return np.asarray(steady[sector] + noise)

    return Place(f"random scans {seed}, path {bend:+g} rad", scan, _bent_path(bend))


def _constant(reading_m: float) -> Callable[[Setup, np.random.Generator], FloatArray]:
    return lambda setup, _rng: np.full(setup.lidar.beams, reading_m)


def _bent_path(first_direction_rad: float) -> FloatArray:
    """6 m that begin in a direction and bend towards the x-axis, from the origin."""
    direction = first_direction_rad * np.exp(-np.arange(120) / 20.0)
    steps = 0.05 * np.column_stack((np.cos(direction), np.sin(direction)))
    return np.vstack((np.zeros((1, 2)), np.cumsum(steps, axis=0)))


def _require_same(first: list[Command], second: list[Command], rule: str) -> None:
    for k, (one, other) in enumerate(zip(first, second, strict=True)):
        _require(_bytes(one) == _bytes(other), f"{rule}: tick {k}, {one}, {other}")


def _bytes(command: Command) -> tuple[bytes, str]:
    return np.array([command.speed, command.yaw_rate]).tobytes(), str(command.mode)


def _require(holds: bool, rule: str) -> None:
    if not holds:
        raise BrokenContractError(rule)
