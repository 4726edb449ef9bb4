"""``hlsd/KinematicBarn-v1``: BARN's worlds and lidar, without contact physics, fast.

The robot is `hlsd.envs.kinematics`: a calibrated kinematic Jackal. Worlds, starts,
lidar, noise, rules and reward are those of `hlsd.envs.BarnEnv`. It is made to train in;
what a policy reaches is told by a bench, which drives under physics.
"""

from collections import OrderedDict
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.errors import HlsdError
from hlsd.core.memory import floats_in, int32s_in, table_of
from hlsd.core.response import SPEED, TIMESTEP_S, YAW, YAW_RATE, X, Y
from hlsd.core.response import STATE as ROBOT
from hlsd.core.types import BoolArray, FloatArray, IntArray, UInt64Array
from hlsd.data.world import World
from hlsd.data.worlds import Suite
from hlsd.envs.game import (
    EPISODE,
    GOES_ON,
    Look,
    Rules,
    Told,
    begin_row,
    goal_in_sight,
    settle,
    show_agent,
    way_in,
)
from hlsd.envs.kinematics import ramp, reach_of, respond_among, response_of
from hlsd.envs.normals import STATE as NOISE
from hlsd.envs.normals import fill_normals, state_of
from hlsd.envs.vector import VectorNavigation
from hlsd.envs.way import Way, way_of
from hlsd.envs.worlds import barn_suite
from hlsd.run.session import start_jitter, streams_of
from hlsd.sim.lidar import Lidar
from hlsd.sim.mjcf import build_model
from hlsd.sim.ray_casting import Sensor, Surfaces, cast
from hlsd.sim.simulator import CONTACT_GAP_S, whole_steps

KEPT = 4096
"""Worlds that stay made: each takes some 60 kB."""

_STEPS, _BEGUN, _TOUCHED, _LAST = range(4)
_COUNTS = 4
_GAP_STEPS = round(CONTACT_GAP_S / TIMESTEP_S)
# The arrays of a world, in the order of its row.
_DISCS, _CYLINDERS, _AHEAD = range(3)


class Herd(NamedTuple):
    """All robots, a row for each.

    Attributes:
        robots: See `hlsd.envs.kinematics`, ``(n, ROBOT)``.
        near: Distance to what stands, as `respond_among` has it, ``(n, 4)``.
        counts: Steps, contacts begun, steps in contact, the last of them, ``(n, 4)``.
        table: Addresses and lengths of each one's world, ``(n, 6)``.
        ways: Of the way through it, x, y, columns and rows, ``(n, 4)``.
        noise: State of each lidar's generator, ``(n, NOISE)``.
        episodes: See `hlsd.envs.game.EPISODE`, ``(n, EPISODE)``.
        fresh: Which begin an episode: they look around and drive nothing, ``(n,)``.
    """

    robots: FloatArray
    near: FloatArray
    counts: IntArray
    table: IntArray
    ways: FloatArray
    noise: UInt64Array
    episodes: FloatArray
    fresh: BoolArray

    @staticmethod
    def of(count: int) -> "Herd":
        """Room for some robots."""
        return Herd(
            robots=np.zeros((count, ROBOT)),
            near=np.zeros((count, 4)),
            counts=np.zeros((count, _COUNTS), dtype=np.int64),
            table=np.zeros((count, 6), dtype=np.int64),
            ways=np.zeros((count, 4)),
            noise=np.zeros((count, NOISE), dtype=np.uint64),
            episodes=np.zeros((count, EPISODE)),
            fresh=np.zeros(count, dtype=np.bool_),
        )


class Breed(NamedTuple):
    """What all of them have in common.

    Attributes:
        drive: How they follow commands, how they respond, and their outline.
        sensor: Their lidar.
        home: Of base_link at rest at the origin: height [m] and quaternion.
        steps: Of a command.
        noisy: Whether ranges have the sensor's noise.
    """

    drive: Any
    sensor: Any
    home: tuple[float, float, float, float, float]
    steps: int
    noisy: bool


@compiled
def drive_herd(
    span: tuple[int, int],
    commands: FloatArray,
    herd: Herd,
    breed: Breed,
    rules: Rules,
    look: Look,
    told: Told,
) -> None:
    """Drive a command of each robot, judge and pay it, and look around.

    Args:
        span: First robot and the one after the last.
        commands: Speed [m/s] and yaw rate [rad/s] of each, ``(n, 2)``.
        herd: Changed.
        breed: What they have in common.
        rules: Of the game.
        look: What is seen.
        told: Written, the rows of these robots.
    """
    for i in range(span[0], span[1]):
        if herd.fresh[i]:
            told.reward[i], told.outcome[i] = 0.0, GOES_ON
            look_around(i, herd, breed, look, told)
            continue
        state, counts, row = herd.robots[i], herd.counts[i], herd.episodes[i]
        flat = floats_in(herd.table[i], _DISCS)
        discs = flat.reshape((flat.size // 3, 3))
        command = (commands[i, 0], commands[i, 1])
        for _ in range(breed.steps):
            touches = respond_among(command, breed.drive, discs, herd.near[i], state)
            counts[_STEPS] += 1
            if touches:
                if counts[_STEPS] - counts[_LAST] > _GAP_STEPS:
                    counts[_BEGUN] += 1
                counts[_TOUCHED] += 1
                counts[_LAST] = counts[_STEPS]
        x, y, contacts = state[X], state[Y], counts[_BEGUN]
        times_s = counts[_STEPS] * TIMESTEP_S, counts[_TOUCHED] * TIMESTEP_S
        settle(i, (x, y), contacts, times_s, rules, row, told)
        look_around(i, herd, breed, look, told)


@compiled
def look_around(i: int, herd: Herd, breed: Breed, look: Look, told: Told) -> None:
    """Write what robot i sees; its noise is drawn."""
    state, table, row = herd.robots[i], herd.table[i], herd.episodes[i]
    x, y, yaw = state[X], state[Y], state[YAW]
    pose = np.zeros(7)
    c, s = np.cos(0.5 * yaw), np.sin(0.5 * yaw)
    height, qw, qx, qy, qz = breed.home
    pose[0], pose[1], pose[2] = x, y, height
    pose[3], pose[4] = c * qw - s * qz, c * qx - s * qy
    pose[5], pose[6] = c * qy + s * qx, c * qz + s * qw
    beams = breed.sensor.beams.shape[1]
    ranges, errors = np.empty(beams), np.empty(beams if breed.noisy else 0)
    fill_normals(herd.noise[i], errors)
    flat = floats_in(table, _CYLINDERS)
    cylinders = flat.reshape((flat.size // 5, 5)).T  # as `hlsd.sim.lidar` keeps them
    around = Surfaces(cylinders, np.empty((0, 8)).T, True)
    cast(pose, breed.sensor, around, errors, ranges)
    way = way_in(herd.ways[i], int32s_in(table, _AHEAD))
    goal = goal_in_sight((x, y, yaw), way, look, row)
    show_agent(i, ranges, goal, (state[SPEED], state[YAW_RATE]), look, told)


class _Made(NamedTuple):
    """A world as the kernel takes it."""

    discs: FloatArray
    cylinders: FloatArray
    way: Way
    start: FloatArray
    goal: FloatArray


class KinematicBarn(VectorNavigation):
    """Kinematic Jackals among BARN's cylinders; see the module."""

    def __init__(
        self,
        num_envs: int = 1,
        suite: str | Path | Suite | None = None,
        *,
        worlds_seed: int = 0,
        noise: bool = True,
        **settings: Any,
    ) -> None:
        """Settings as in `hlsd.envs.vector.VectorNavigation`, and these.

        Args:
            num_envs: How many are stepped at once.
            suite: A suite, its name or folder; None makes BARN's kind of worlds in
                memory.
            worlds_seed: Of those.
            noise: Whether ranges have the sensor's noise, which takes a third of a
                step's time.
            **settings: Of `VectorNavigation`.

        Raises:
            HlsdError: A setting that cannot be: a robot without a kinematic model, or a
                period that is not a whole number of steps of 5 ms.
        """
        super().__init__(barn_suite(suite, worlds_seed), num_envs, **settings)
        steps = whole_steps(self.period_s, TIMESTEP_S, "steps")
        robot = self.robot
        drive = (ramp(robot), response_of(robot), reach_of(robot))
        model = build_model(robot, None)
        rays = Lidar(model, robot.lidar).for_kernel
        assert rays is not None  # a plane has the closed form
        home = tuple(model.key("home").qpos[2:7].tolist())
        sensor = Sensor(*rays[0])._replace(address=0)
        self._breed = Breed(drive, sensor, home, steps, bool(noise))
        self._herd = Herd.of(num_envs)
        self._made: OrderedDict[int, _Made] = OrderedDict()
        self._in_use: list[_Made | None] = [None] * num_envs

    @property
    def poses(self) -> FloatArray:
        """Pose of each base_link in its world, ``(num_envs, 3)``."""
        return self._herd.robots[:, :3].copy()

    @property
    def _episodes(self) -> FloatArray:
        return self._herd.episodes

    @property
    def _fresh(self) -> BoolArray:
        return self._herd.fresh

    def _begin(self, i: int, world: World, trial: int) -> None:
        made, herd = self._world(world), self._herd
        self._in_use[i] = made  # the table has its addresses
        streams = streams_of(self.seed, world.index, trial)
        start = made.start + start_jitter(streams.jitter)
        herd.table[i] = table_of((made.discs, made.cylinders, made.way.ahead))
        herd.ways[i] = made.way[:4]
        herd.robots[i] = 0.0
        herd.robots[i, :3] = start
        herd.near[i] = -1.0
        herd.counts[i] = 0
        herd.counts[i, _LAST] = -_GAP_STEPS - 1
        herd.noise[i] = state_of(streams.noise)
        x, y, yaw = start.tolist()
        goal_x, goal_y = made.goal.tolist()
        begin_row((x, y, yaw), (goal_x, goal_y), herd.episodes[i])

    def _run(self, span: tuple[int, int], commands: FloatArray) -> None:
        told = self._told
        drive_herd(
            span, commands, self._herd, self._breed, self._rules, self._look, told
        )

    def _look_at(self, which: BoolArray) -> None:
        for i in np.flatnonzero(which).tolist():
            look_around(i, self._herd, self._breed, self._look, self._told)

    def _world(self, world: World) -> _Made:
        """A world as the kernel takes it; the newest are kept."""
        made = self._made.get(world.index)
        if made is None:
            shapes = world.shapes
            if len(shapes.boxes) or world.movers:
                raise HlsdError(
                    f"world {world.index} of suite {world.suite!r} has boxes or what "
                    "moves, and a kinematic robot knows cylinders that stand still: "
                    "take 'hlsd/BarnVec-v1' or 'hlsd/DynaBarnVec-v1'"
                )
            start, goal = self.protocol.start_pose(world), self.protocol.goal(world)
            cylinders = np.insert(shapes.cylinders, 3, 0.0, axis=1)  # their bottoms
            discs = np.ascontiguousarray(cylinders[:, :3])
            way = way_of(shapes, start[:2], goal)
            way = way._replace(length_m=np.empty(0))
            made = _Made(discs, cylinders, way, start, goal)
        self._made[world.index] = made
        self._made.move_to_end(world.index)
        while len(self._made) > KEPT:
            self._made.popitem(last=False)
        return made
