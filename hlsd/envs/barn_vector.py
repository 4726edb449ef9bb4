"""``hlsd/BarnVec-v1`` and ``hlsd/DynaBarnVec-v1``: the single environments' physics.

The same physics, lidar, noise, rules and reward as `hlsd.envs.BarnEnv`, to the bit, for
observations that need no navigator: those with the final goal. With the local goal they
show that of a known map (`hlsd.envs.way`), where `BarnEnv` shows the navigator's.
"""

from collections import OrderedDict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hlsd.core.errors import require_at_least
from hlsd.core.types import BoolArray, FloatArray
from hlsd.data.world import World
from hlsd.data.worlds import Suite
from hlsd.envs.fleet import Fleet, drive_fleet, kind_of, look_around, place
from hlsd.envs.game import begin_row
from hlsd.envs.normals import state_of
from hlsd.envs.spaces import LOCAL_GOAL
from hlsd.envs.vector import VectorNavigation
from hlsd.envs.way import Way, way_of
from hlsd.envs.worlds import barn_suite, dynabarn_suite
from hlsd.run.session import movers_begin_s, start_jitter, streams_of
from hlsd.sim.lidar import Lidar
from hlsd.sim.mjcf import build_model
from hlsd.sim.simulator import Simulator

KEPT = 64
"""Compiled worlds that wait for their next episode, beside those in use: each takes
some 4 MB."""


class _Place(NamedTuple):
    """A compiled world, and one robot in it."""

    world: int
    simulator: Simulator
    lidar: Lidar
    way: Way | None
    start: FloatArray
    goal: FloatArray


class PhysicsVectorEnv(VectorNavigation):
    """Robots in MuJoCo, stepped by `hlsd.envs.fleet.drive_fleet`."""

    def __init__(
        self, suite: Suite, num_envs: int, *, worlds_kept: int = KEPT, **settings: Any
    ) -> None:
        """Check the settings; one world is compiled for that.

        Args:
            suite: Where its worlds are from.
            num_envs: How many are stepped at once.
            worlds_kept: Compiled worlds that wait for their next episode, 0 or more.
            **settings: Of `hlsd.envs.vector.VectorNavigation`.

        Raises:
            HlsdError: A setting that cannot be.
        """
        super().__init__(suite, num_envs, **settings)
        require_at_least(0, "worlds_kept", worlds_kept)
        self._kept = worlds_kept
        self._waiting: OrderedDict[int, list[_Place]] = OrderedDict()
        self._in_use: list[_Place | None] = [None] * num_envs
        self._fleet = Fleet.of(num_envs)
        first = self._make(suite[self.worlds[0]])
        self._kind = kind_of(first.simulator, first.lidar, self.period_s)
        place(self._fleet, 0, first.simulator, first.lidar, first.way)
        self._put_back(first)

    def close_extras(self, **keywords: Any) -> None:
        """End the threads, and free the worlds."""
        super().close_extras(**keywords)
        self._waiting.clear()
        self._in_use = [None] * self.num_envs

    @property
    def _episodes(self) -> FloatArray:
        return self._fleet.episodes

    @property
    def _fresh(self) -> BoolArray:
        return self._fleet.fresh

    def _begin(self, i: int, world: World, trial: int) -> None:
        before = self._in_use[i]
        if before is not None and before.world != world.index:
            self._in_use[i] = None
            self._put_back(before)
            before = None
        held = before or self._take(world)
        self._in_use[i] = held
        streams = streams_of(self.seed, world.index, trial)
        start = held.start + start_jitter(streams.jitter)
        begin_s = movers_begin_s(streams.movers)
        held.simulator.reset(start, begin_s)
        fleet = self._fleet
        place(fleet, i, held.simulator, held.lidar, held.way)
        fleet.begin_s[i] = begin_s
        fleet.noise[i] = state_of(streams.noise)
        x, y, yaw = start.tolist()
        goal_x, goal_y = held.goal.tolist()
        begin_row((x, y, yaw), (goal_x, goal_y), fleet.episodes[i])

    def _run(self, span: tuple[int, int], commands: FloatArray) -> None:
        told = self._told
        drive_fleet(
            span, commands, self._fleet, self._kind, self._rules, self._look, told
        )

    def _look_at(self, which: BoolArray) -> None:
        for i in np.flatnonzero(which).tolist():
            look_around(i, self._fleet, self._kind, self._look, self._told)

    def _take(self, world: World) -> _Place:
        """A world that waits, or a new one."""
        found = self._waiting.get(world.index)
        if not found:
            return self._make(world)
        place = found.pop()
        if not found:
            del self._waiting[world.index]
        return place

    def _put_back(self, place: _Place) -> None:
        """Let a world wait for its next episode; the oldest go."""
        self._waiting.setdefault(place.world, []).append(place)
        self._waiting.move_to_end(place.world)
        while sum(map(len, self._waiting.values())) > self._kept:
            index, oldest = next(iter(self._waiting.items()))
            oldest.pop()
            if not oldest:
                del self._waiting[index]

    def _make(self, world: World) -> _Place:
        model = build_model(self.robot, world.shapes, world.movers)
        start, goal = self.protocol.start_pose(world), self.protocol.goal(world)
        local = self._maker.spec.goal == LOCAL_GOAL
        return _Place(
            world.index,
            Simulator(model, self.robot, world.movers),
            Lidar(model, self.robot.lidar),
            way_of(world.shapes, start[:2], goal) if local else None,
            start,
            goal,
        )


class BarnVectorEnv(PhysicsVectorEnv):
    """``hlsd/BarnVec-v1``: worlds that stand still."""

    def __init__(
        self,
        num_envs: int = 1,
        suite: str | Path | Suite | None = None,
        *,
        worlds_seed: int = 0,
        **settings: Any,
    ) -> None:
        """Settings as in `PhysicsVectorEnv`, and where its worlds are from.

        Args:
            num_envs: How many are stepped at once.
            suite: A suite's name or folder; None makes BARN's kind of worlds in memory.
            worlds_seed: Of those.
            **settings: Of `PhysicsVectorEnv`.

        Raises:
            HlsdError: A setting that cannot be.
        """
        super().__init__(barn_suite(suite, worlds_seed), num_envs, **settings)


class DynaBarnVectorEnv(PhysicsVectorEnv):
    """``hlsd/DynaBarnVec-v1``: worlds with moving obstacles."""

    def __init__(
        self,
        num_envs: int = 1,
        suite: str | Path | Suite | None = None,
        *,
        tier: str | None = None,
        worlds_seed: int = 0,
        **settings: Any,
    ) -> None:
        """Settings as in `PhysicsVectorEnv`, and where its worlds are from.

        Args:
            num_envs: How many are stepped at once.
            suite: A suite's name or folder; None makes DynaBARN's kind of worlds in
                memory.
            tier: Of those: ``"easy"``, which None is, ``"medium"`` or ``"hard"``.
            worlds_seed: Of those.
            **settings: Of `PhysicsVectorEnv`.

        Raises:
            HlsdError: A setting that cannot be.
        """
        suite = dynabarn_suite(suite, tier, worlds_seed)
        super().__init__(suite, num_envs, **settings)
