"""From the costs of a batch to the sequence of controls: MPPI's update.

The new sequence is the mean of the sampled ones, weighted by the exponential of what
they cost; a filter smooths it, and its second control is sent.

Source: ros-navigation/navigation2 1.3.12, nav2_mppi_controller, src/optimizer.cpp
(updateControlSequence, applyControlSequenceConstraints, shiftControlSequence) and
include/.../tools/utils.hpp (savitskyGolayFilter). The method's own: Williams et al.,
Information Theoretic MPC for Model-Based Reinforcement Learning, ICRA 2017.
"""

import math

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.types import Float32Array, FloatArray
from hlsd.planners.mppi.batch import Batch, Motion, _require

# Savitzky and Golay 1964: a quadratic through nine points.
_FILTER = np.array([-21, 14, 39, 54, 59, 54, 39, 14, -21], dtype=np.float64) / 231.0
# Shorter sequences are not smoothed.
_LEAST_STEPS = 21


@compiled
def update(
    batch: Batch,
    costs: FloatArray,
    gamma: float,
    temperature: float,
    motion: Motion,
    control: Float32Array,
) -> None:
    """Replace a sequence by the mean of its samples, the cheap ones first.

    Args:
        batch: The samples.
        costs: Of each ``(batch,)``; becomes their weights, whose sum is 1.
        gamma: How much more it costs to go on as before.
        temperature: How much dearer a sample may be and still count.
        motion: Limits.
        control: Speed and yaw rate ``(2, steps)``, overwritten.

    Raises:
        ValueError: Shapes that do not fit.
    """
    batch, motion = Batch(*batch), Motion(*motion)
    steps, n = batch.x.shape
    _require(batch)
    if costs.shape != (n,) or control.shape != (2, steps):
        raise ValueError("costs are (batch,) and controls (2, steps)")
    along = np.zeros(n, dtype=np.float32)
    if gamma > 0.0:
        _add_along(batch.speed, control[0], gamma / motion.speed_sd**2, along)
        _add_along(batch.yaw_rate, control[1], gamma / motion.yaw_rate_sd**2, along)
    least = np.inf
    for i in range(n):
        costs[i] += along[i]
        least = min(least, costs[i])
    total = 0.0
    for i in range(n):
        costs[i] = math.exp((least - costs[i]) / temperature)
        total += costs[i]
    for i in range(n):
        costs[i] /= total
    for t in range(steps):
        speed, rate = 0.0, 0.0
        for i in range(n):
            speed += costs[i] * batch.speed[t, i]
            rate += costs[i] * batch.yaw_rate[t, i]
        control[0, t], control[1, t] = speed, rate
    constrain(control, motion)


@compiled
def _add_along(
    sampled: Float32Array, control: Float32Array, gain: float, out: Float32Array
) -> None:
    """Add ``gain`` times the product of the sequence and its noise."""
    for t in range(sampled.shape[0]):
        mean = control[t]
        factor = np.float32(gain) * mean
        row = sampled[t]
        for i in range(out.size):
            out[i] += factor * (row[i] - mean)


@compiled
def constrain(control: Float32Array, motion: Motion) -> None:
    """Keep a sequence ``(2, steps)`` within velocities and accelerations."""
    motion = Motion(*motion)
    if control.shape[0] != 2:
        raise ValueError("controls are (2, steps)")
    least, most, turn = motion.min_speed, motion.max_speed, motion.max_yaw_rate
    for t in range(control.shape[1]):
        speed = min(max(float(control[0, t]), least), most)
        rate = min(max(float(control[1, t]), -turn), turn)
        if t > 0:
            before, turned = control[0, t - 1], control[1, t - 1]
            change = motion.turn * motion.dt
            speed = max(speed, before - motion.loss * motion.dt)
            speed = min(speed, before + motion.gain * motion.dt)
            rate = min(max(rate, turned - change), turned + change)
        control[0, t], control[1, t] = speed, rate


@compiled
def smooth(control: Float32Array, history: Float32Array) -> None:
    """Run the filter along a sequence, with the last controls before it.

    The sequence's last control stays, and stands for those that would follow it.

    Args:
        control: Speed and yaw rate ``(2, steps)``; fewer than 21 steps stay.
        history: The last four that were sent ``(2, 4)``, the latest last; overwritten
            with the next one.

    Raises:
        ValueError: Shapes that do not fit.
    """
    steps = control.shape[1]
    if control.shape[0] != 2 or history.shape != (2, 4) or steps < 2:
        raise ValueError("controls are (2, steps), of 2 or more, and history (2, 4)")
    if steps < _LEAST_STEPS:
        return
    for k in range(2):
        given = control[k].copy()
        for t in range(steps - 1):
            value = 0.0
            for j in range(9):
                at = t + j - 4
                if at < 0:
                    value += _FILTER[j] * history[k, 4 + at]
                elif at < steps - 1:
                    value += _FILTER[j] * given[at]
                else:
                    value += _FILTER[j] * given[steps - 1]
            control[k, t] = value
        history[k, :3] = history[k, 1:].copy()
        history[k, 3] = control[k, 1]


@compiled
def shift(control: Float32Array) -> None:
    """Move a sequence ``(2, steps)`` on by a step; the last control stays.

    Raises:
        ValueError: Another shape.
    """
    steps = control.shape[1]
    if control.shape[0] != 2 or steps < 2:
        raise ValueError("controls are (2, steps), of 2 or more")
    for k in range(2):
        for t in range(steps - 1):
            control[k, t] = control[k, t + 1]
