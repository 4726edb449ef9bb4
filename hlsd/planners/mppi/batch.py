"""Sampled controls and where they lead: what the critics of MPPI look at.

Arrays of a batch are ``(steps, batch)``, so that the inner loop of each kernel runs
over neighbours in memory; numbers are float32, as in the source. Positions are relative
to the robot's, along the axes of odometry.

Source: ros-navigation/navigation2 1.3.12, nav2_mppi_controller,
include/.../motion_models.hpp (predict) and src/optimizer.cpp
(updateInitialStateVelocities, integrateStateVelocities).
"""

import math
from functools import cache
from statistics import NormalDist
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hlsd.core.compiled import compiled
from hlsd.core.types import Float32Array

UInt16Array: TypeAlias = NDArray[np.uint16]


class Batch(NamedTuple):
    """Trajectories.

    Attributes:
        speed: Controls, forward ``(steps, batch)`` [m/s]. The robot drives row t - 1
            during step t, and what it was measured to drive during step 0.
        yaw_rate: Likewise [rad/s].
        x: After each step, from the robot on ``(steps, batch)`` [m].
        y: Likewise [m].
        yaw: In odometry, unwrapped ``(steps, batch)`` [rad].
        now: Work space: speed, yaw rate, cosine and sine of the yaw, ``(4, batch)``.
    """

    speed: Float32Array
    yaw_rate: Float32Array
    x: Float32Array
    y: Float32Array
    yaw: Float32Array
    now: Float32Array


class Start(NamedTuple):
    """Where all trajectories begin.

    Attributes:
        speed: Measured [m/s].
        yaw_rate: Measured [rad/s].
        yaw: In odometry [rad].
    """

    speed: float
    yaw_rate: float
    yaw: float


class Motion(NamedTuple):
    """How controls are drawn, and how fast they may change.

    Attributes:
        dt: Of a step [s].
        speed_sd: Standard deviation of the noise [m/s].
        yaw_rate_sd: Likewise [rad/s].
        gain: Largest gain of speed [m/s^2].
        loss: Largest loss of speed [m/s^2].
        turn: Largest change of the yaw rate [rad/s^2].
        min_speed: Of the control that is sent [m/s].
        max_speed: Likewise [m/s].
        max_yaw_rate: Likewise [rad/s].
    """

    dt: float
    speed_sd: float
    yaw_rate_sd: float
    gain: float
    loss: float
    turn: float
    min_speed: float
    max_speed: float
    max_yaw_rate: float


QUANTILES = 65536


@cache
def normal_quantiles() -> Float32Array:
    """As many equally likely values of a standard normal number, ``(QUANTILES,)``.

    The outermost are 4.3; value k is the negative of value ``QUANTILES - 1 - k``.
    """
    normal = NormalDist()
    upper = [
        normal.inv_cdf((k + 0.5) / QUANTILES) for k in range(QUANTILES // 2, QUANTILES)
    ]
    half = np.array(upper, dtype=np.float32)
    quantiles: Float32Array = np.concatenate((-half[::-1], half))
    quantiles.flags.writeable = False
    return quantiles


def draw(random: np.random.Generator, steps: int, batch: int) -> UInt16Array:
    """Indices of quantiles, for speed and yaw rate ``(2, steps, batch)``.

    Looking up four numbers for each random word takes a sixth of the time that NumPy's
    normal numbers take.
    """
    count = 2 * steps * batch
    words = random.bit_generator.random_raw(-(-count // 4))
    return words.view(np.uint16)[:count].reshape(2, steps, batch)


def make_batch(steps: int, batch: int) -> Batch:
    """Room for trajectories."""
    speed, yaw_rate, x, y, yaw = np.zeros((5, steps, batch), dtype=np.float32)
    now = np.zeros((4, batch), dtype=np.float32)
    return Batch(speed, yaw_rate, x, y, yaw, now)


@compiled
def roll_out(
    noise: UInt16Array,
    quantiles: Float32Array,
    control: Float32Array,
    start: Start,
    motion: Motion,
    batch: Batch,
) -> None:
    """Add noise to a sequence of controls, and follow each of the results.

    A control that changes faster than the robot can is moved to what it can.

    Args:
        noise: From `draw` ``(2, steps, batch)``.
        quantiles: From `normal_quantiles`.
        control: Speed and yaw rate ``(2, steps)``.
        start: The robot.
        motion: See there.
        batch: Overwritten.

    Raises:
        ValueError: Shapes that do not fit.
    """
    start, motion, batch = Start(*start), Motion(*motion), Batch(*batch)
    steps, n = batch.x.shape
    _require(batch)
    if noise.shape != (2, steps, n) or control.shape != (2, steps):
        raise ValueError("noise is (2, steps, batch) and controls are (2, steps)")
    if quantiles.size != QUANTILES:
        raise ValueError("noise of 16 bits stands for 65536 quantiles")
    dt = np.float32(motion.dt)
    speed_sd, yaw_rate_sd = np.float32(motion.speed_sd), np.float32(motion.yaw_rate_sd)
    gain, loss = np.float32(motion.gain) * dt, np.float32(motion.loss) * dt
    turn = np.float32(motion.turn) * dt
    speed, rate, cosine, sine = batch.now
    speed[:] = np.float32(start.speed)
    rate[:] = np.float32(start.yaw_rate)
    cosine[:] = np.float32(math.cos(start.yaw))
    sine[:] = np.float32(math.sin(start.yaw))
    x, y, yaw = np.zeros_like(speed), np.zeros_like(speed), np.zeros_like(speed)
    yaw[:] = np.float32(start.yaw)
    for t in range(steps):
        if t > 0:
            speeds, rates = batch.speed[t - 1], batch.yaw_rate[t - 1]
            _vary(control[0, t - 1], speed_sd, quantiles, noise[0, t - 1], speeds)
            _vary(control[1, t - 1], yaw_rate_sd, quantiles, noise[1, t - 1], rates)
            for i in range(n):
                held = min(max(speeds[i], speed[i] - loss), speed[i] + gain)
                speed[i], speeds[i] = held, held
                turned = min(max(rates[i], rate[i] - turn), rate[i] + turn)
                rate[i], rates[i] = turned, turned
        _move(x, y, yaw, batch.now, dt)
        batch.x[t], batch.y[t], batch.yaw[t] = x, y, yaw
    last = steps - 1
    _vary(control[0, last], speed_sd, quantiles, noise[0, last], batch.speed[last])
    _vary(
        control[1, last], yaw_rate_sd, quantiles, noise[1, last], batch.yaw_rate[last]
    )


@compiled
def _vary(
    control: np.float32,
    sd: np.float32,
    quantiles: Float32Array,
    noise: UInt16Array,
    out: Float32Array,
) -> None:
    for i in range(out.size):
        out[i] = control + sd * quantiles[noise[i]]


@compiled
def _move(
    x: Float32Array,
    y: Float32Array,
    yaw: Float32Array,
    now: Float32Array,
    dt: np.float32,
) -> None:
    """One step: along the yaw before it, as the source has it.

    Sine and cosine of the turn are their series, to within float32 for 0.8 rad a step:
    several at once, and the same on every machine.
    """
    speed, rate, cosine, sine = now
    one, half = np.float32(1.0), np.float32(0.5)
    sixth, twentieth = np.float32(1.0 / 6.0), np.float32(1.0 / 20.0)
    twelfth, thirtieth = np.float32(1.0 / 12.0), np.float32(1.0 / 30.0)
    last, final = np.float32(1.0 / 42.0), np.float32(1.0 / 56.0)
    for i in range(x.size):
        way = dt * speed[i]
        turn = dt * rate[i]
        x[i] += way * cosine[i]
        y[i] += way * sine[i]
        yaw[i] += turn
        square = turn * turn
        s = turn * (
            one - square * sixth * (one - square * twentieth * (one - square * last))
        )
        c = one - half * square * (
            one - square * twelfth * (one - square * thirtieth * (one - square * final))
        )
        turned = cosine[i] * c - sine[i] * s
        sine[i] = sine[i] * c + cosine[i] * s
        cosine[i] = turned


@compiled
def _require(batch: Batch) -> None:
    """Refuse arrays that do not belong together."""
    shape = batch.x.shape
    if (
        batch.y.shape != shape
        or batch.yaw.shape != shape
        or batch.speed.shape != shape
        or batch.yaw_rate.shape != shape
        or batch.now.shape != (4, shape[1])
        or shape[0] < 2
        or shape[1] < 1
    ):
        raise ValueError("arrays of a batch are (steps, batch), of 2 steps or more")
