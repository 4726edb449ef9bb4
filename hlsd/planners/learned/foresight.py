"""The collision check of HLSD 2.0: what becomes of a command until the robot stands.

A command is driven for a moment and then braked, with the response that was fitted to
the Jackal, and the robot's whole outline keeps some distance from every point that is
known. A command that passes can be taken back later, whatever the network says then:
as long as nothing moves, the robot never gets where it cannot stop. The check of the
paper (`hlsd.planners.learned.safety`) looks 0.2 s ahead instead and lets commands act
at once.
"""

import math
from typing import NamedTuple

from hlsd.core.compiled import compiled
from hlsd.core.response import (
    SPEED,
    STATE,
    TIMESTEP_S,
    YAW,
    YAW_RATE,
    Ramp,
    Response,
    X,
    Y,
    respond,
)
from hlsd.core.types import FloatArray

# Physics steps between two looks at the distance, and when the robot stands.
_EVERY = 4
_STANDS_SPEED, _STANDS_YAW_RATE = 0.03, 0.05
_LONGEST_S = 2.0


class Body(NamedTuple):
    """A robot, as far as its motion and its outline go.

    Attributes:
        half_length: Of its outline [m].
        half_width: Of its outline [m].
        corner: Radius of its corners [m].
        ramp: How its set points follow commands.
        response: How it follows those.
    """

    half_length: float
    half_width: float
    corner: float
    ramp: Ramp
    response: Response


@compiled
def foresee(
    state: FloatArray,
    command: tuple[float, float],
    hold_s: float,
    enough: float,
    body: Body,
    points: FloatArray,
    count: int,
) -> float:
    """Least distance to any point while a command is driven and then braked.

    Args:
        state: Of `hlsd.core.response`, as the command arrives; left as it is.
        command: Speed [m/s] and yaw rate [rad/s].
        hold_s: How long it is driven [s].
        enough: Greater distances are not told apart [m].
        body: The robot.
        points: In the frame of ``state``, ``(2, n)`` [m].
        count: How many of them count.

    Returns:
        The distance, at most ``enough``; 0 or less once a point is within the outline,
        how far it is within [m].
    """
    if state.size != STATE or points.shape[0] != 2 or not 0 <= count <= points.shape[1]:
        raise ValueError("a state has another size, or points are not (2, n)")
    ahead = state.copy()
    least = enough
    still = (0.0, 0.0)
    for step in range(1, round(_LONGEST_S / TIMESTEP_S) + 1):
        driven = (step - 1) * TIMESTEP_S < hold_s
        respond(command if driven else still, body.ramp, body.response, ahead)
        if step % _EVERY:
            continue
        least = _distance(points, count, ahead, body, least)
        braked = step * TIMESTEP_S > hold_s
        if least <= 0.0 or (
            braked
            and abs(ahead[SPEED]) < _STANDS_SPEED
            and abs(ahead[YAW_RATE]) < _STANDS_YAW_RATE
        ):
            break
    return least


@compiled
def _distance(
    points: FloatArray, count: int, state: FloatArray, body: Body, least: float
) -> float:
    """Distance of the nearest point to the outline, or ``least``, whichever is less."""
    x, y = state[X], state[Y]
    cos_yaw, sin_yaw = math.cos(state[YAW]), math.sin(state[YAW])
    length, width = body.half_length - body.corner, body.half_width - body.corner
    least += body.corner
    px, py = points[0], points[1]
    for k in range(count):
        dx, dy = px[k] - x, py[k] - y
        beyond = abs(cos_yaw * dx + sin_yaw * dy) - length
        if beyond >= least:
            continue
        beside = abs(cos_yaw * dy - sin_yaw * dx) - width
        if beside >= least:
            continue
        if beyond > 0.0 and beside > 0.0:
            least = min(least, math.sqrt(beyond * beyond + beside * beside))
        else:
            least = min(least, max(beyond, beside))
    return least - body.corner


@compiled
def foresee_turn(
    state: FloatArray,
    yaw_rate: float,
    enough: float,
    body: Body,
    points: FloatArray,
    count: int,
) -> float:
    """Like `foresee`, for turning on the spot."""
    body = Body(*body)
    return foresee(state, (0.0, yaw_rate), TURN_HOLD_S, enough, body, points, count)


TURN_HOLD_S = 0.2
"""How long a turn on the spot is driven before it is braked."""


class Choice(NamedTuple):
    """How an admissible command is chosen.

    Attributes:
        hold_s: How long a command is driven before it is braked [s].
        least: Distance that every command keeps [m].
        wanted: Distance from which more is not worth a detour [m].
        max_yaw_rate: Of any command [rad/s].
        speed_weight: Cost of 1 m/s less than proposed.
        yaw_rate_weight: Cost of 1 rad/s away from what was proposed.
        nearness_weight: Cost of a metre nearer than ``wanted``.
    """

    hold_s: float
    least: float
    wanted: float
    max_yaw_rate: float
    speed_weight: float
    yaw_rate_weight: float
    nearness_weight: float


# Candidates around a proposal: shares of its speed, and steps of the yaw rate.
_SPEEDS = 7
_YAW_RATES, _YAW_RATE_STEP = 13, 0.25
# A command that neither drives nor turns is none.
_DRIVES, _TURNS = 0.08, 0.3
_FASTER = 8


@compiled
def foresee_command(
    state: FloatArray,
    command: tuple[float, float],
    choice: Choice,
    body: Body,
    points: FloatArray,
    count: int,
) -> float:
    """Like `foresee`, up to the clearance that is wanted."""
    choice, body = Choice(*choice), Body(*body)
    return foresee(state, command, choice.hold_s, choice.wanted, body, points, count)


@compiled
def fastest_on_arc(
    state: FloatArray,
    command: tuple[float, float],
    limits: tuple[float, float, float],
    choice: Choice,
    body: Body,
    points: FloatArray,
    count: int,
) -> tuple[float, float]:
    """The same arc, as many times faster as it is clear.

    Args:
        state: As for `foresee`.
        command: Speed [m/s] and yaw rate [rad/s].
        limits: Most that both are multiplied by; most speed [m/s]; distance that a
            faster command keeps [m].
        choice: For how long a command is driven, and its most yaw rate.
        body: The robot.
        points: As for `foresee`.
        count: As for `foresee`.
    """
    choice, body = Choice(*choice), Body(*body)
    most, max_speed, clear = limits
    for k in range(_FASTER):
        factor = most + (1.0 - most) * k / _FASTER
        faster = factor * command[0], factor * command[1]
        if faster[0] > max_speed or abs(faster[1]) > choice.max_yaw_rate:
            continue
        if foresee(state, faster, choice.hold_s, clear, body, points, count) >= clear:
            return faster
    return command


@compiled
def nearest_admissible(
    state: FloatArray,
    command: tuple[float, float],
    choice: Choice,
    body: Body,
    points: FloatArray,
    count: int,
) -> tuple[float, float, float]:
    """The proposed command where it is clear, else the best of those around it.

    Args:
        state: As for `foresee`.
        command: Proposed: speed [m/s] and yaw rate [rad/s].
        choice: What is good.
        body: The robot.
        points: As for `foresee`.
        count: As for `foresee`.

    Returns:
        Speed, yaw rate, and the distance that it keeps, at most ``choice.wanted``; the
        distance is negative where no command is admissible.
    """
    choice, body = Choice(*choice), Body(*body)
    hold_s, wanted = choice.hold_s, choice.wanted
    speed, yaw_rate = command
    away = foresee(state, command, hold_s, wanted, body, points, count)
    if away >= wanted:
        return speed, yaw_rate, away
    best = (0.0, 0.0, -1.0)
    least_cost = math.inf
    for i in range(_SPEEDS):
        share = 1.0 - i / (_SPEEDS - 1)
        slower = share * speed
        for j in range(_YAW_RATES):
            aside = (j + 1) // 2 * (1 if j % 2 else -1) * _YAW_RATE_STEP
            for on_arc in (False, True):
                turn = (share * yaw_rate if on_arc else yaw_rate) + aside
                if abs(turn) > choice.max_yaw_rate or (
                    slower < _DRIVES and abs(turn) < _TURNS
                ):
                    continue
                cost = choice.speed_weight * (speed - slower)
                cost += choice.yaw_rate_weight * abs(turn - yaw_rate)
                if cost >= least_cost:
                    continue
                away = foresee(
                    state, (slower, turn), hold_s, wanted, body, points, count
                )
                cost += choice.nearness_weight * (wanted - away)
                if away >= choice.least and cost < least_cost:
                    least_cost = cost
                    best = (slower, turn, away)
    return best


@compiled
def clearest_reverse(
    state: FloatArray,
    speed: float,
    choice: Choice,
    body: Body,
    points: FloatArray,
    count: int,
) -> tuple[float, float, float]:
    """The way back that keeps most distance, the straightest of those that keep enough.

    Args:
        state: As for `foresee`.
        speed: Below 0 [m/s].
        choice: For how long a command is driven, and the least distance; three times
            as much is enough.
        body: The robot.
        points: As for `foresee`.
        count: As for `foresee`.

    Returns:
        Speed, yaw rate, and the distance that it keeps.
    """
    choice, body = Choice(*choice), Body(*body)
    best = (0.0, 0.0, -1.0)
    most = -math.inf
    for j in range(9):
        turn = (j - 4) * 0.25
        away = foresee(
            state, (speed, turn), choice.hold_s, _FREE_M, body, points, count
        )
        value = min(away, 3.0 * choice.least) - 0.02 * abs(turn)
        if value > most:
            most = value
            best = (speed, turn, away)
    return best


@compiled
def least_bad(
    state: FloatArray, choice: Choice, body: Body, points: FloatArray, count: int
) -> tuple[float, float]:
    """Where nothing is admissible: the slow command that keeps most distance."""
    choice, body = Choice(*choice), Body(*body)
    best = (0.0, 0.0)
    most = -math.inf
    for i in range(5):
        for j in range(9):
            command = ((i - 2) * 0.15, (j - 4) * 0.3)
            away = foresee(state, command, choice.hold_s, _FREE_M, body, points, count)
            if away > most:
                most, best = away, command
    return best


# More distance than this makes no difference to a robot that backs up [m].
_FREE_M = 0.25
