"""How a robot answers velocity commands: set points that follow, a body behind them.

What simulator, kinematic environment and planners share. The set points follow a
command as `follow_command` says, in the simulator too. Behind them the kinematic Jackal
stands in for the physics, with nine numbers fitted to the simulated one
(``scripts/fit_kinematic_jackal.py``): the two sides push towards the set points' wheel
speeds, each by no more than its motors can; a yaw rate is braked by the tyres'
scrubbing; and the robot turns about a point ahead of base_link.

It leaves out what contacts do: tyres that lose their grip (from 1.5 m/s and 1.5 rad/s
on together), pitch under acceleration, and being pushed along an obstacle.
"""

import math
from typing import NamedTuple

from hlsd.core.compiled import compiled
from hlsd.core.types import FloatArray

# Set points this near to the command, in m/s and rad/s, take its value.
_SETTLED = 1e-6

X, Y, YAW, SPEED, YAW_RATE, SET = range(6)
"""In a state: pose of base_link, its velocity, then both set points and those of the
last `DELAY` steps, oldest first."""
DELAY = 3
"""Dead time of the drive, in steps."""
STATE = SET + 2 * (1 + DELAY)
"""Numbers of a state."""
TIMESTEP_S = 0.005


class Ramp(NamedTuple):
    """How the set points follow a command in one physics step.

    Attributes:
        speed_change: Largest [m/s].
        yaw_rate_change: Largest [rad/s].
        turn_in: Share of a growing yaw rate's gap that closes.
    """

    speed_change: float
    yaw_rate_change: float
    turn_in: float


class Response(NamedTuple):
    """How the robot answers its set points; fitted.

    Attributes:
        stiffness: Of each side, acceleration over error of speed [1/s].
        thrust: Largest of each side, as the robot's acceleration [m/s^2].
        arm: By which an error of the yaw rate becomes one of a side's speed [m].
        leverage: Angular acceleration over the difference of the sides' [1/m].
        scrubbing: By which a yaw rate decays [1/s].
        gain: Yaw rate over its set point, but for scrubbing, at a standstill.
        gain_per_speed: By how much that grows with the speed [s/m].
        sideways: Velocity to the left over yaw rate, at a standstill [m].
        sideways_per_speed: By how much that grows with the speed [s].
        edge_gain: By which the set point of the yaw rate grows in hard turns.
        edge_onset: As in `hlsd.sim.robots.Drive` [m/s^2].
        edge_full: Likewise [m/s^2].
    """

    stiffness: float
    thrust: float
    arm: float
    leverage: float
    scrubbing: float
    gain: float
    gain_per_speed: float
    sideways: float
    sideways_per_speed: float
    edge_gain: float
    edge_onset: float
    edge_full: float


JACKAL_RAMP = Ramp(
    speed_change=20.0 * TIMESTEP_S,
    yaw_rate_change=25.0 * TIMESTEP_S,
    turn_in=-math.expm1(-TIMESTEP_S / 0.11),
)
"""The Jackal's, for one step of `TIMESTEP_S`."""
JACKAL_RESPONSE = Response(
    stiffness=17.14,
    thrust=2.524,
    arm=0.2938,
    leverage=3.633,
    scrubbing=2.103,
    gain=1.234,
    gain_per_speed=0.2699,
    sideways=-0.1264,
    sideways_per_speed=-0.01133,
    edge_gain=1.554631246838308 / 1.405,
    edge_onset=1.1,
    edge_full=1.35,
)
"""The Jackal's; the last three are its drive's."""


@compiled
def follow_command(
    command: tuple[float, float], ramp: Ramp, set_points: FloatArray
) -> None:
    """Move the set points towards a command by one physics step.

    Args:
        command: Speed [m/s] and yaw rate [rad/s].
        ramp: How they follow.
        set_points: Speed and yaw rate, ``(2,)``; changed.
    """
    speed, yaw_rate = command
    speed_change, yaw_rate_change, turn_in = ramp
    now_speed, now_yaw_rate = set_points[0], set_points[1]
    if speed != now_speed or yaw_rate != now_yaw_rate:
        now_speed += min(max(speed - now_speed, -speed_change), speed_change)
        change = yaw_rate - now_yaw_rate
        if change * now_yaw_rate >= 0.0:
            change *= turn_in
        now_yaw_rate += min(max(change, -yaw_rate_change), yaw_rate_change)
        if abs(speed - now_speed) < _SETTLED and abs(change) < _SETTLED:
            now_speed, now_yaw_rate = speed, yaw_rate
    set_points[0], set_points[1] = now_speed, now_yaw_rate


@compiled
def respond(
    command: tuple[float, float], ramp: Ramp, response: Response, state: FloatArray
) -> None:
    """Drive a command for one step of `TIMESTEP_S`.

    Args:
        command: Speed [m/s] and yaw rate [rad/s], within the robot's limits.
        ramp: How set points follow it.
        response: How the robot follows those.
        state: ``(STATE,)``; changed.
    """
    if state.size != STATE:
        raise ValueError("a state has another number of numbers")
    by = response
    follow_command(command, ramp, state[SET : SET + 2])
    set_speed, set_yaw_rate = state[SET], state[SET + 1]
    lateral = abs(set_speed * set_yaw_rate)
    on_edge = (lateral - by.edge_onset) / (by.edge_full - by.edge_onset)
    set_yaw_rate *= 1.0 + (by.edge_gain - 1.0) * min(max(on_edge, 0.0), 1.0)
    first, last = SET + 2, STATE - 2
    due_speed, due_yaw_rate = state[first], state[first + 1]
    for i in range(first, last):
        state[i] = state[i + 2]
    state[last], state[last + 1] = set_speed, set_yaw_rate
    speed, yaw_rate = state[SPEED], state[YAW_RATE]
    ahead = due_speed - speed
    aside = by.arm * (
        due_yaw_rate - yaw_rate / (by.gain + by.gain_per_speed * abs(speed))
    )
    left = min(max(by.stiffness * (ahead - aside), -by.thrust), by.thrust)
    right = min(max(by.stiffness * (ahead + aside), -by.thrust), by.thrust)
    sideways = yaw_rate * (by.sideways + by.sideways_per_speed * speed)
    speed += TIMESTEP_S * (left + right + yaw_rate * sideways)
    yaw_rate += TIMESTEP_S * (by.leverage * (right - left) - by.scrubbing * yaw_rate)
    turn = TIMESTEP_S * yaw_rate
    c, s = math.cos(state[YAW] + 0.5 * turn), math.sin(state[YAW] + 0.5 * turn)
    state[X] += TIMESTEP_S * (c * speed - s * sideways)
    state[Y] += TIMESTEP_S * (s * speed + c * sideways)
    state[YAW] += turn
    state[SPEED], state[YAW_RATE] = speed, yaw_rate
