"""Many robots in MuJoCo, each in a world of its own, driven by one call.

What `hlsd.sim.simulator` and `hlsd.sim.lidar` hold of each world goes into a table of
addresses. The kernel makes the arrays of it and calls what they call: `advance` for the
physics, `cast` for the scan. So every number is theirs.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.errors import HlsdError
from hlsd.core.memory import bools_at, floats_in, int32s_in, ints_in, table_of
from hlsd.core.types import BoolArray, FloatArray, IntArray, UInt64Array
from hlsd.data.tracks import TrackTable
from hlsd.envs.game import (
    EPISODE,
    GOES_ON,
    Look,
    Rules,
    Told,
    goal_in_sight,
    settle,
    show_agent,
    way_in,
)
from hlsd.envs.normals import STATE, fill_normals
from hlsd.envs.way import Way
from hlsd.sim.gate import Gate, Reach
from hlsd.sim.lidar import Lidar
from hlsd.sim.ray_casting import Sensor, Surfaces, cast
from hlsd.sim.simulator import Simulator
from hlsd.sim.stepping import (
    BEGUN,
    BOTH,
    MOVING,
    STEPS,
    STILL,
    TOUCHED,
    Drive,
    State,
    Traffic,
    advance,
)

# The arrays of a world, in the order of its row; their addresses and lengths are there.
_QPOS, _QVEL, _CTRL, _STILL, _MOVING, _CONTYPE, _CONAFFINITY = range(7)
_SIDES, _SET_POINTS, _COUNTS, _NEAR, _DISCS, _BOXES, _MOVERS = range(7, 14)
_BODIES, _SHOWN, _PLACES, _STOPS, _WITHIN, _WAITED = range(14, 20)
_KEYS, _FIRST, _CURVED, _CYLINDERS, _RAY_BOXES, _MOCAPS, _MOCAP_POS = range(20, 27)
_AHEAD = 27
_ARRAYS = 28
_MODEL, _DATA = 2 * _ARRAYS, 2 * _ARRAYS + 1
ROW = 2 * _ARRAYS + 2
"""Numbers of a world's row."""


class Fleet(NamedTuple):
    """All robots, a row for each.

    Attributes:
        table: Addresses and lengths, ``(n, ROW)``.
        reach: Of each one's gate: `hlsd.sim.gate.Reach` and slack, ``(n, 6)`` [m].
        begin_s: What the movers' clocks read when the episode began, ``(n,)`` [s].
        noise: State of each lidar's generator, ``(n, STATE)``.
        episodes: See `hlsd.envs.game.EPISODE`, ``(n, EPISODE)``.
        ways: Of the way through each world, x, y, columns and rows, ``(n, 4)``.
        fresh: Which begin an episode: they look around and drive nothing, ``(n,)``.
    """

    table: IntArray
    reach: FloatArray
    begin_s: FloatArray
    noise: UInt64Array
    episodes: FloatArray
    ways: FloatArray
    fresh: BoolArray

    @staticmethod
    def of(count: int) -> "Fleet":
        """Room for some robots; none is in it yet."""
        return Fleet(
            table=np.zeros((count, ROW), dtype=np.int64),
            reach=np.zeros((count, 6)),
            begin_s=np.zeros(count),
            noise=np.zeros((count, STATE), dtype=np.uint64),
            episodes=np.zeros((count, EPISODE)),
            ways=np.zeros((count, 4)),
            fresh=np.zeros(count, dtype=np.bool_),
        )


class Kind(NamedTuple):
    """What all robots of a fleet have in common.

    Attributes:
        sensor: Their lidar.
        ramp: How set points follow commands.
        split: How these become wheel speeds.
        gap_steps: See `hlsd.sim.stepping.Drive`.
        steps: Physics steps of a command.
        timestep_s: Length of one [s].
    """

    sensor: Any
    ramp: Any
    split: Any
    gap_steps: int
    steps: int
    timestep_s: float


def kind_of(simulator: Simulator, lidar: Lidar, period_s: float) -> Kind:
    """What a robot has in common with others of its kind.

    Raises:
        HlsdError: The period is not a whole number of physics steps, or the lidar's
            rays are MuJoCo's.
    """
    simulator.check_period(period_s)
    drive = Drive(*simulator.for_kernel[1])
    steps = round(period_s / simulator.timestep_s)
    sensor = _rays(lidar)[0]
    return Kind(
        Sensor(*sensor),
        drive.ramp,
        drive.split,
        drive.gap_steps,
        steps,
        simulator.timestep_s,
    )


def _rays(lidar: Lidar) -> Any:
    if lidar.for_kernel is None:
        raise HlsdError(
            "this robot's scans are made by MuJoCo's own rays, which a vector "
            "environment does not call: take the single environment",
            argument="robot",
        )
    return lidar.for_kernel


def place(
    fleet: Fleet, i: int, simulator: Simulator, lidar: Lidar, way: Way | None
) -> None:
    """Put a world into a fleet's row. Whoever does keeps all of it alive.

    Args:
        fleet: Changed.
        i: The row.
        simulator: Of the world.
        lidar: Of the same model.
        way: Through the world; None where no local goal is seen.

    Raises:
        HlsdError: It has moving boxes, or the lidar's rays are MuJoCo's.
    """
    state, drive, traffic, gate = simulator.for_kernel
    state, drive, gate = State(*state), Drive(*drive), Gate(*gate)
    traffic = Traffic(*traffic)
    tracks = TrackTable(*traffic.table)
    _, surfaces, moving = _rays(lidar)
    surfaces = Surfaces(*surfaces)
    mocaps = np.empty(0, dtype=np.int64)
    for table, bodies, _, yaws in moving:
        if len(yaws) or table.shape[0] != surfaces.cylinders.shape[0]:
            raise HlsdError(
                "a vector environment takes moving cylinders, and this world has "
                "moving boxes: take the single environment"
            )
        mocaps = bodies
    arrays = (
        *(state.qpos, simulator.data.qvel, state.ctrl, state.still, state.moving),
        *(state.contype, state.conaffinity, drive.sides, drive.set_points),
        *(drive.counts, gate.near, gate.discs, gate.boxes, gate.movers),
        *(gate.bodies, gate.shown, traffic.places, traffic.stops, traffic.within),
        *(traffic.waited, tracks.keys, tracks.first, tracks.curved),
        *(surfaces.cylinders.T, surfaces.boxes.T, mocaps, simulator.data.mocap_pos),
        np.empty(0, dtype=np.int32) if way is None else way.ahead,
    )
    fleet.table[i, : 2 * _ARRAYS] = table_of(arrays)
    fleet.table[i, _MODEL], fleet.table[i, _DATA] = state.model, state.data
    fleet.reach[i] = (*gate.reach, gate.slack)
    if way is not None:
        fleet.ways[i] = way.x, way.y, way.columns, way.rows


@compiled
def drive_fleet(
    span: tuple[int, int],
    commands: FloatArray,
    fleet: Fleet,
    kind: Kind,
    rules: Rules,
    look: Look,
    told: Told,
) -> None:
    """Drive a command of each robot, judge and pay it, and look around.

    Args:
        span: First robot and the one after the last.
        commands: Speed [m/s] and yaw rate [rad/s] of each, ``(n, 2)``.
        fleet: Changed.
        kind: What they have in common.
        rules: Of the game.
        look: What is seen.
        told: Written, the rows of these robots.
    """
    for i in range(span[0], span[1]):
        if fleet.fresh[i]:
            told.reward[i], told.outcome[i] = 0.0, GOES_ON
            look_around(i, fleet, kind, look, told)
            continue
        _advance((commands[i, 0], commands[i, 1]), i, fleet, kind)
        row, counts = fleet.episodes[i], ints_in(fleet.table[i], _COUNTS)
        x, y, _, _, _ = _motion(fleet.table[i])
        contacts = counts[STILL + BEGUN] + counts[MOVING + BEGUN]
        touched = counts[STILL + TOUCHED] + counts[MOVING + TOUCHED] - counts[BOTH]
        times_s = counts[STEPS] * kind.timestep_s, touched * kind.timestep_s
        settle(i, (x, y), contacts, times_s, rules, row, told)
        look_around(i, fleet, kind, look, told)


@compiled
def look_around(i: int, fleet: Fleet, kind: Kind, look: Look, told: Told) -> None:
    """Write what robot i sees; its noise is drawn."""
    table = fleet.table[i]
    beams = kind.sensor.beams.shape[1]
    errors, ranges = np.empty(beams), np.empty(beams)
    fill_normals(fleet.noise[i], errors)
    flat = floats_in(table, _CYLINDERS)
    cylinders = flat.reshape((flat.size // 5, 5)).T  # as the lidar keeps them
    mocaps = ints_in(table, _MOCAPS)
    positions = floats_in(table, _MOCAP_POS)
    stand = cylinders.shape[1] - mocaps.size
    for k in range(mocaps.size):
        cylinders[0, stand + k] = positions[3 * mocaps[k]]
        cylinders[1, stand + k] = positions[3 * mocaps[k] + 1]
    boxes = floats_in(table, _RAY_BOXES)
    around = Surfaces(cylinders, boxes.reshape((boxes.size // 8, 8)).T, True)
    cast(floats_in(table, _QPOS), kind.sensor, around, errors, ranges)
    x, y, yaw, speed, yaw_rate = _motion(table)
    row = fleet.episodes[i]
    way = way_in(fleet.ways[i], int32s_in(table, _AHEAD))
    goal = goal_in_sight((x, y, yaw), way, look, row)
    show_agent(i, ranges, goal, (speed, yaw_rate), look, told)


@compiled
def _motion(table: IntArray) -> tuple[float, float, float, float, float]:
    """x, y, yaw, speed and yaw rate of base_link, as `Simulator.motion` has them."""
    qpos, qvel = floats_in(table, _QPOS), floats_in(table, _QVEL)
    qw, qx, qy, qz = qpos[3], qpos[4], qpos[5], qpos[6]
    yaw = math.atan2(2 * (qw * qz + qx * qy), 1 - 2 * (qy * qy + qz * qz))
    speed = math.cos(yaw) * qvel[0] + math.sin(yaw) * qvel[1]
    return qpos[0], qpos[1], yaw, speed, qvel[5]


@compiled
def _advance(command: tuple[float, float], i: int, fleet: Fleet, kind: Kind) -> None:
    """Drive a command with robot i."""
    table, reach = fleet.table[i], fleet.reach[i]
    places, keys = floats_in(table, _PLACES), floats_in(table, _KEYS)
    discs, boxes = floats_in(table, _DISCS), floats_in(table, _BOXES)
    shown = ints_in(table, _SHOWN)
    contype: Any = int32s_in(table, _CONTYPE)
    conaffinity: Any = int32s_in(table, _CONAFFINITY)
    state = State(
        table[_MODEL],
        table[_DATA],
        floats_in(table, _QPOS),
        floats_in(table, _CTRL),
        floats_in(table, _STILL),
        floats_in(table, _MOVING),
        contype,
        conaffinity,
    )
    drive = Drive(
        kind.ramp,
        kind.split,
        floats_in(table, _SIDES),
        floats_in(table, _SET_POINTS),
        ints_in(table, _COUNTS),
        kind.gap_steps,
    )
    traffic = Traffic(
        TrackTable(
            keys.reshape((keys.size // 5, 5)),
            ints_in(table, _FIRST),
            ints_in(table, _CURVED),
        ),
        places.reshape((places.size // 3, 3)),
        bools_at(table[2 * _STOPS], table[2 * _STOPS + 1]),
        floats_in(table, _WITHIN),
        ints_in(table, _WAITED),
    )
    gate = Gate(
        Reach(reach[0], reach[1], reach[2], reach[3], reach[4]),
        reach[5],
        discs.reshape((discs.size // 3, 3)),
        boxes.reshape((boxes.size // 6, 6)),
        floats_in(table, _MOVERS),
        ints_in(table, _BODIES),
        shown.reshape((shown.size // 2, 2)),
        floats_in(table, _NEAR),
    )
    times = (kind.steps, kind.timestep_s, fleet.begin_s[i])
    advance(command, times, state, drive, traffic, gate)
