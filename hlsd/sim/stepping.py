"""The physics steps of a tick, in compiled code from end to end.

MuJoCo's own ``mj_step`` is called from the kernel by its address, so that a step costs
no Python. An error that MuJoCo calls fatal ends the process, as it ends any C program.
"""

import ctypes
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite.binding  # type: ignore[import-untyped,unused-ignore]
import mujoco
import numba
import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.errors import HlsdError
from hlsd.core.response import Ramp, follow_command
from hlsd.core.types import BoolArray, FloatArray, IntArray
from hlsd.data.tracks import TrackTable, follow
from hlsd.sim.gate import Gate, hide, show


def _library() -> str:
    """MuJoCo's library, the one that its Python package has loaded."""
    folder = Path(mujoco.__file__).parent
    names = ("libmujoco.so*", "libmujoco*.dylib", "mujoco.dll")
    found = [file for name in names for file in sorted(folder.glob(name))]
    if not found:
        raise HlsdError(
            f"MuJoCo's library is not in {str(folder)!r}: install the package mujoco "
            "again"
        )
    return str(found[0])


_types: Any = numba.core.types
_config: Any = numba.config
if _config.DISABLE_JIT:
    _mj_step: Any = ctypes.CDLL(_library()).mj_step
    _mj_step.argtypes = (ctypes.c_void_p, ctypes.c_void_p)
else:
    llvmlite.binding.load_library_permanently(_library())
    _mj_step = _types.ExternalFunction("mj_step", _types.void(_types.intp, _types.intp))

STEPS, BOTH = 0, 1
"""In `Drive.counts`: physics steps so far, and those in contact with both kinds."""
STILL, MOVING = 2, 5
"""Where the counts of contacts with what stands, and with movers, begin."""
BEGUN, TOUCHED, LAST = 0, 1, 2
"""Of each kind: contacts begun, steps in contact, and the last of them."""
COUNTS = 8


class Split(NamedTuple):
    """How set points become wheel speeds; see `hlsd.sim.robots.Drive`.

    Attributes:
        edge_onset: [m/s^2].
        edge_full: [m/s^2].
        separation: Multiplier of the track.
        separation_on_edge: The same in hard turns.
        track: [m].
        radius: Of the wheels, as the controller has it [m].
    """

    edge_onset: float
    edge_full: float
    separation: float
    separation_on_edge: float
    track: float
    radius: float


class Drive(NamedTuple):
    """The robot's drive, and what is counted while it drives.

    Attributes:
        ramp: How set points follow.
        split: How they become wheel speeds.
        sides: -1 for each wheel on the left, 1 on the right.
        set_points: Speed and yaw rate, ``(2,)``; changed.
        counts: ``(COUNTS,)``; changed.
        gap_steps: A touch within so many steps of the last one is the same contact.
    """

    ramp: Ramp
    split: Split
    sides: FloatArray
    set_points: FloatArray
    counts: IntArray
    gap_steps: int


class State(NamedTuple):
    """MuJoCo's model and state, as a kernel takes them.

    Attributes:
        model: Address of the model.
        data: Address of the state.
        qpos: View of it, the robot's pose first.
        ctrl: View of the actuators' commands.
        still: View of the sensor of contacts with what stands, ``(1,)``, or empty.
        moving: View of those of contacts with movers, ``(m,)``.
        contype: View of the model's ``body_contype``.
        conaffinity: View of its ``body_conaffinity``.
    """

    model: int
    data: int
    qpos: FloatArray
    ctrl: FloatArray
    still: FloatArray
    moving: FloatArray
    contype: IntArray
    conaffinity: IntArray


class Traffic(NamedTuple):
    """The movers of a world, as a kernel takes them; arrays of none where none are.

    Attributes:
        table: Their tracks.
        places: View of where they are: x, y and height, ``(m, 3)`` [m]; x and y are
            changed.
        stops: Which stop for the robot, ``(m,)``.
        within: And how near it must be, ``(m,)`` [m].
        waited: Steps that each has waited, ``(m,)``; changed.
    """

    table: TrackTable
    places: FloatArray
    stops: BoolArray
    within: FloatArray
    waited: IntArray


@compiled
def advance(
    command: tuple[float, float],
    times: tuple[int, float, float],
    state: State,
    drive: Drive,
    traffic: Traffic,
    gate: Gate,
) -> None:
    """Drive a command for some physics steps.

    Args:
        command: Speed [m/s] and yaw rate [rad/s], within the robot's limits.
        times: Steps to go, the length of one [s], and what the movers' clocks read
            when the episode began [s].
        state: Changed.
        drive: Changed.
        traffic: Changed.
        gate: Changed.
    """
    count, timestep, begin = times
    model, data, qpos, ctrl, still, moving, contype, conaffinity = state
    ramp, split, sides, set_points, counts, gap_steps = drive
    table, places, stops, within, waited = traffic
    movers = waited.size
    reacts = stops.any()
    looks = 2 if reacts else count + 1
    clocks, ahead = np.empty((looks, movers)), np.empty((looks, movers, 2))
    if not reacts:
        _look_ahead((counts[STEPS], timestep, begin), waited, table, clocks, ahead)
    for step in range(count):
        _control(command, ramp, split, sides, set_points, ctrl)
        hide(gate, qpos, places, contype, conaffinity)
        if reacts:
            _look_ahead((counts[STEPS], timestep, begin), waited, table, clocks, ahead)
        _mj_step(model, data)
        counts[STEPS] += 1
        # What the step found is where all were when it began; now they go on.
        for j in range(movers):
            to = 1 if reacts else step + 1
            if reacts and _waits(ahead[0, j], ahead[1, j], qpos, stops[j], within[j]):
                waited[j] += 1
                to = 0
            places[j, 0], places[j, 1] = ahead[to, j, 0], ahead[to, j, 1]
        stands = still.size > 0 and still[0] > 0.0
        moves = False
        for j in range(movers):
            moves = moves or moving[j] > 0.0
        if stands:
            _touch(counts, STILL, gap_steps)
        if moves:
            _touch(counts, MOVING, gap_steps)
            if stands:
                counts[BOTH] += 1
    show(gate, contype, conaffinity)


@compiled
def _control(
    command: tuple[float, float],
    ramp: Ramp,
    split: Split,
    sides: FloatArray,
    set_points: FloatArray,
    wheel_speeds: FloatArray,
) -> None:
    """Move the set points towards a command by one step, and split them into wheels.

    Args:
        command: Speed [m/s] and yaw rate [rad/s].
        ramp: How the set points follow.
        split: How they become wheel speeds.
        sides: -1 for each wheel on the left, 1 on the right.
        set_points: Speed and yaw rate, ``(2,)``; changed.
        wheel_speeds: ``(wheels,)``, written [rad/s].
    """
    edge_onset, edge_full, separation, separation_on_edge, track, radius = split
    follow_command(command, ramp, set_points)
    now_speed, now_yaw_rate = set_points[0], set_points[1]
    lateral = abs(now_speed * now_yaw_rate)
    on_edge = min(max((lateral - edge_onset) / (edge_full - edge_onset), 0.0), 1.0)
    # The half track by which the drive turns a yaw rate into wheel speeds.
    half_track = (separation + (separation_on_edge - separation) * on_edge) * track / 2
    turn = now_yaw_rate * half_track
    for wheel in range(sides.size):
        wheel_speeds[wheel] = (now_speed + sides[wheel] * turn) / radius


@compiled
def _look_ahead(
    times: tuple[int, float, float],
    waited: IntArray,
    table: TrackTable,
    clocks: FloatArray,
    ahead: FloatArray,
) -> None:
    """Where movers are now, and after each of the next steps if none of them waits.

    Args:
        times: Steps so far, the length of one [s], and what the clocks read at first.
        waited: Steps that each has waited, ``(m,)``.
        table: Their tracks.
        clocks: ``(n, m)``, written [s].
        ahead: ``(n, m, 2)``, written [m].
    """
    steps, timestep, begin = times
    for step in range(clocks.shape[0]):
        for j in range(clocks.shape[1]):
            clocks[step, j] = begin + (steps + step - waited[j]) * timestep
    follow(clocks, table, ahead)


@compiled
def _waits(
    here: FloatArray, ahead: FloatArray, robot: FloatArray, stops: bool, within: float
) -> bool:
    """Whether a mover stops for the robot; places are ``(2,)`` or more [m]."""
    if not stops:
        return False
    dx, dy = robot[0] - here[0], robot[1] - here[1]
    along = (ahead[0] - here[0]) * dx + (ahead[1] - here[1]) * dy
    return bool(dx * dx + dy * dy < within * within and along > 0.0)


@compiled
def _touch(counts: IntArray, kind: int, gap_steps: int) -> None:
    """Note a step with contact of a kind."""
    step = counts[STEPS]
    if step - counts[kind + LAST] > gap_steps:
        counts[kind + BEGUN] += 1
    counts[kind + TOUCHED] += 1
    counts[kind + LAST] = step
