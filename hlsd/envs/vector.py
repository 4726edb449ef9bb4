"""Vector environments: many worlds stepped by one call, with no Python for each.

What they have in common: Gymnasium's interface, threads, and resets. `hlsd.envs.fleet`
and `hlsd.envs.kinematic` have what is stepped.
"""

import itertools
from abc import abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeAlias

import numpy as np
import numpy.typing as npt
from gymnasium.error import ResetNeeded
from gymnasium.utils import seeding
from gymnasium.vector import VectorEnv
from gymnasium.vector.utils import batch_space

from hlsd.core.errors import HlsdError, require_at_least, unknown_name
from hlsd.core.types import BoolArray, FloatArray
from hlsd.data.selection import extent, selection_text
from hlsd.data.world import World
from hlsd.data.worlds import Suite
from hlsd.envs.game import (
    CLOCK_S,
    COLLISION,
    CONTACTS,
    SUCCESS,
    TIMEOUT,
    Look,
    Rules,
    Told,
)
from hlsd.envs.reward import Weights, weights_of
from hlsd.envs.spaces import (
    ActionReader,
    ActionSpec,
    ObservationMaker,
    ObservationSpec,
    Seen,
    between,
)
from hlsd.run.outcome import Outcome
from hlsd.run.protocol import Protocol, protocol_for
from hlsd.run.session import PERIOD_S
from hlsd.sim.robots import RobotDescription, get_robot

try:
    from gymnasium.vector import AutoresetMode
except ImportError as error:  # before 1.1
    raise HlsdError(
        "vector environments need gymnasium 1.1 or newer: `pip install -U gymnasium`"
    ) from error

Infos: TypeAlias = dict[str, Any]
Stepped: TypeAlias = tuple[Seen, FloatArray, BoolArray, BoolArray, Infos]

OUTCOMES = np.array(
    ["", Outcome.SUCCESS.value, Outcome.COLLISION.value, Outcome.TIMEOUT.value],
    dtype=object,
)
"""What ``infos["outcome"]`` holds, by the kernels' numbers."""
TRIALS = 1_000_000
"""Trials that are drawn are below this."""


_METADATA = {"render_modes": [], "autoreset_mode": AutoresetMode.NEXT_STEP}


class VectorNavigation(VectorEnv[Seen, npt.ArrayLike, Any]):
    """What all vector environments here have in common.

    Each world depends on its own row of actions alone, so that results are the same for
    any number of threads.

    Attributes:
        suite: Where its worlds are from.
        worlds: Indices of those that are drawn from.
        protocol: The rules.
        weights: Of the reward.
        world: Index of each one's world, ``(num_envs,)``.
        trial: Number of each one's trial, ``(num_envs,)``.
    """

    metadata: dict[str, Any] = _METADATA

    # Settings have one argument each, by keyword.
    def __init__(
        self,
        suite: Suite,
        num_envs: int,
        *,
        worlds: str | int | Iterable[int] | None = None,
        protocol: str | Protocol | None = None,
        robot: str | RobotDescription = "jackal",
        period_s: float = PERIOD_S,
        seed: int = 0,
        observation: str | ObservationSpec = "scan+goal",
        action: str | ActionSpec = "normalised",
        reward: Mapping[str, float] | Weights | None = None,
        threads: int = 1,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
    ) -> None:
        """Check the settings.

        Args:
            suite: Where its worlds are from.
            num_envs: How many are stepped at once.
            worlds: As in `hlsd.envs.BarnEnv`.
            protocol: Likewise.
            robot: Likewise.
            period_s: Likewise [s].
            seed: Likewise.
            observation: Likewise; the local goal is that of a known map.
            action: Likewise.
            reward: Likewise.
            threads: How many step worlds at the same time.
            autoreset_mode: Gymnasium's: ``"NextStep"``, ``"SameStep"`` or
                ``"Disabled"``.

        Raises:
            HlsdError: A setting that cannot be.
        """
        require_at_least(1, "num_envs", num_envs)
        require_at_least(1, "threads", threads)
        require_at_least(0, "seed", seed)
        self.suite, self.num_envs = suite, num_envs
        chosen = selection_text(worlds)
        self.worlds = suite.indices if chosen is None else suite.select(chosen)
        self.robot = get_robot(robot)
        self.protocol = protocol_for(protocol, suite.layout.name)
        self.protocol.require_fit(suite.name, suite.layout.name)
        self.seed, self.period_s, self.threads = seed, period_s, threads
        self.weights = weights_of(reward)
        try:
            mode = AutoresetMode(autoreset_mode)
        except ValueError:
            modes = [each.value for each in AutoresetMode]
            raise unknown_name("autoreset_mode", f"{autoreset_mode}", modes) from None
        self.autoreset_mode = mode
        self.metadata = {**self.metadata, "autoreset_mode": mode}
        self.render_mode = None
        limits = self.robot.limits
        maker = ObservationMaker(observation, self.robot.lidar, limits)
        self._maker, self._reader = maker, ActionReader(action, limits)
        self.single_observation_space = maker.space()
        self.single_action_space = self._reader.space()
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self._rules = Rules.of(self.protocol, period_s, self.weights)
        self._look = Look.of(maker)
        self._told = _room(maker, num_envs)
        self.world, self.trial = (np.zeros(num_envs, dtype=np.int64) for _ in range(2))
        self._randoms: list[np.random.Generator | None] = [None] * num_envs
        self._over = np.zeros(num_envs, dtype=np.bool_)
        self._begun = False
        self._pool: ThreadPoolExecutor | None = None

    def reset(
        self,
        *,
        seed: int | Sequence[int | None] | None = None,
        options: dict[str, Any] | None = None,
    ) -> tuple[Seen, Infos]:
        """Put robots at the starts of trials.

        Args:
            seed: Of the draws of worlds and trials from here on: one for each, or the
                first of as many that ascend.
            options: ``world`` and ``trial``, for all or one for each; what is not given
                is drawn. ``reset_mask``, ``(num_envs,)``, says which are reset.

        Returns:
            What is seen, and where: see `step`.

        Raises:
            HlsdError: An option that there is not, or of another shape.
        """
        count = self.num_envs
        held = dict(options or {})
        mask = held.pop("reset_mask", None)
        chosen = np.ones(count, dtype=np.bool_) if mask is None else np.asarray(mask)
        if chosen.dtype != np.bool_ or chosen.shape != (count,) or not chosen.any():
            raise HlsdError(
                f"option reset_mask is {chosen!r:.80}: give {count} truth values, one "
                "of them true at least"
            )
        if mask is not None and not self._begun and not chosen.all():
            raise ResetNeeded("the first reset is of all: leave reset_mask out")
        for name in held:
            if name not in ("world", "trial"):
                raise unknown_name(
                    "option", f"{name}", ["world", "trial", "reset_mask"]
                )
        given = {name: _each(name, value, count) for name, value in held.items()}
        if seed is None:
            seeds: Sequence[int | None] = [None] * count
        elif isinstance(seed, int | np.integer):
            seeds = [int(seed) + i for i in range(count)]
        else:
            seeds = seed
        if len(seeds) != count:
            raise HlsdError(f"{len(seeds)} seeds for {count} worlds: give one for each")
        for i in np.flatnonzero(chosen).tolist():
            if seeds[i] is not None or self._randoms[i] is None:
                self._randoms[i] = seeding.np_random(seeds[i])[0]
            self._begin_drawn(i, {name: each[i] for name, each in given.items()})
        self._over[chosen] = False
        self._begun = True
        self._look_at(chosen)
        self._told.outcome[chosen] = 0
        return self._seen(), self._infos(chosen)

    def step(self, actions: npt.ArrayLike) -> Stepped:
        """Drive an action of each for one period.

        Args:
            actions: As the action space has them, ``(num_envs, 2)``.

        Returns:
            What is seen; rewards; which reached the goal or collided; which ran out of
            time; and what is known, an array of each with a mask beside it: ``world``,
            ``trial``, ``time_s``, ``contacts``, ``outcome`` and ``success`` as in the
            single environments. The row of an episode is theirs alone.

        Raises:
            HlsdError: Actions that are none, not finite or out of bounds.
            ResetNeeded: No episode is under way.
        """
        if not self._begun:
            raise ResetNeeded("no episode is under way: call reset first")
        commands = self._commands(actions)
        everyone = np.ones(self.num_envs, dtype=np.bool_)
        if self.autoreset_mode is AutoresetMode.DISABLED and self._over.any():
            over = np.flatnonzero(self._over).tolist()
            raise ResetNeeded(f"{over} are over: reset them with option reset_mask")
        fresh = self._over.copy()
        for i in np.flatnonzero(fresh).tolist():
            self._begin_drawn(i, {})
        self._drive(commands, fresh)
        told = self._told
        outcome = told.outcome.copy()
        rewards = told.reward.copy()
        ended = outcome > 0
        infos = self._infos(everyone)
        if self.autoreset_mode is AutoresetMode.SAME_STEP and ended.any():
            final, last = self._seen(), infos
            for i in np.flatnonzero(ended).tolist():
                self._begin_drawn(i, {})
            self._look_at(ended)
            told.outcome[ended] = 0
            infos = self._infos(everyone)
            infos["final_obs"] = _objects(final, ended)
            infos["final_info"] = {
                name: value & ended if name.startswith("_") else value
                for name, value in last.items()
            }
            infos["_final_obs"] = infos["_final_info"] = ended.copy()
            self._over[:] = False
        else:
            self._over = ended
        won = (outcome == SUCCESS) | (outcome == COLLISION)
        return self._seen(), rewards, won, outcome == TIMEOUT, infos

    def close_extras(self, **_: Any) -> None:
        """End the threads, and free the worlds."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None
        self._begun = False

    @abstractmethod
    def _begin(self, i: int, world: World, trial: int) -> None:
        """Put robot i at the start of a trial; nothing is sensed yet."""

    @abstractmethod
    def _run(self, span: tuple[int, int], commands: FloatArray) -> None:
        """Step the robots of a span, in compiled code."""

    @abstractmethod
    def _look_at(self, which: BoolArray) -> None:
        """Write what some see, without a step."""

    @property
    @abstractmethod
    def _episodes(self) -> FloatArray:
        """See `hlsd.envs.game.EPISODE`, ``(num_envs, EPISODE)``."""

    @property
    @abstractmethod
    def _fresh(self) -> BoolArray:
        """Which begin an episode with this step, ``(num_envs,)``; a view."""

    def _drive(self, commands: FloatArray, fresh: BoolArray) -> None:
        """Step all, spread over the threads; those that are fresh look around."""
        self._fresh[:] = fresh
        count, threads = self.num_envs, min(self.threads, self.num_envs)
        if threads == 1:
            self._run((0, count), commands)
            return
        if self._pool is None:
            self._run((0, 0), commands)  # which compiles, or loads what is compiled
            self._pool = ThreadPoolExecutor(threads)
        # Some spans for each thread, since worlds take different times.
        ends = np.linspace(0, count, min(4 * threads, count) + 1).astype(int).tolist()
        spans = itertools.pairwise(ends)
        list(self._pool.map(lambda span: self._run(span, commands), spans))

    def _begin_drawn(self, i: int, given: Mapping[str, int]) -> None:
        """Begin an episode; world and trial are drawn where they are not given."""
        random = self._randoms[i]
        assert random is not None
        world, trial = given.get("world"), given.get("trial")
        if world is None:
            world = self.worlds[int(random.integers(len(self.worlds)))]
        elif world not in self.suite.indices:
            raise HlsdError(
                f"option world is {world}: suite {self.suite.name!r} has "
                f"{extent(self.suite.indices)}"
            )
        if trial is None:
            trial = int(random.integers(TRIALS))
        require_at_least(0, "trial", trial)
        self.world[i], self.trial[i] = world, trial
        self._begin(i, self.suite[world], trial)

    def _commands(self, actions: npt.ArrayLike) -> FloatArray:
        """Speed and yaw rate of each, ``(num_envs, 2)``."""
        reader, values = self._reader, np.asarray(actions)
        if values.shape != (self.num_envs, 2) or values.dtype.kind not in "fiu":
            raise HlsdError(
                f"actions are of shape {values.shape} and type {values.dtype}: give "
                f"speed and yaw rate of each, ({self.num_envs}, 2)"
            )
        low, high = map(np.array, reader.bounds)
        wide = [np.asarray(ends, np.float32).astype(np.float64) for ends in (low, high)]
        within = (values >= np.minimum(low, wide[0])) & (
            values <= np.maximum(high, wide[1])
        )
        for i in np.flatnonzero(~within.all(axis=1)).tolist():
            reader.command(values[i])  # which says what is wrong
        given: Any = np.clip(values.astype(np.float64), low, high)
        if reader.spec.normalised:
            least: Any = np.array(reader.least)
            most: Any = np.array(reader.most)
            given = between(given, least, most)
        return np.ascontiguousarray(given)

    def _seen(self) -> Seen:
        told = self._told
        if self._look.flat:
            return told.flat.copy()
        goal = self._maker.spec.goal
        return {
            goal: told.goal.copy(),
            "scan": told.scan.copy(),
            "velocity": told.velocity.copy(),
        }

    def _infos(self, which: BoolArray) -> Infos:
        rows, outcome = self._episodes, self._told.outcome
        known = {
            "world": self.world.copy(),
            "trial": self.trial.copy(),
            "time_s": rows[:, CLOCK_S].copy(),
            "contacts": rows[:, CONTACTS].astype(np.int64),
            "outcome": OUTCOMES[outcome],
            "success": outcome == SUCCESS,
        }
        return known | {f"_{name}": which.copy() for name in known}


def _room(maker: ObservationMaker, count: int) -> Told:
    """Room for what steps tell."""
    flat = maker.spec.flat

    def room(numbers: int) -> npt.NDArray[np.float32]:
        return np.zeros((count, numbers), dtype=np.float32)

    return Told(
        flat=room(maker.size if flat else 0),
        scan=room(0 if flat else maker.beams),
        goal=room(0 if flat else 2),
        velocity=room(0 if flat else 2),
        reward=np.zeros(count),
        outcome=np.zeros(count, dtype=np.int64),
    )


def _each(name: str, value: object, count: int) -> list[int]:
    """An option for each world."""
    array = np.asarray(value)
    if array.dtype.kind not in "iu" or array.shape not in ((), (count,)):
        raise HlsdError(
            f"option {name} is {value!r:.80}: give a whole number, or {count} of them"
        )
    values: list[int] = np.broadcast_to(array, (count,)).tolist()
    return values


def _objects(seen: Seen, which: BoolArray) -> npt.NDArray[np.object_]:
    """Observations of some, one by one, as Gymnasium has the last of an episode."""
    found = np.full(len(which), None, dtype=object)
    for i in np.flatnonzero(which).tolist():
        found[i] = (
            {name: each[i] for name, each in seen.items()}
            if isinstance(seen, dict)
            else seen[i]
        )
    return found
