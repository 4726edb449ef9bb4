"""Tests that may be looked at after every value: capital of who bets on a mean.

Who says that the mean of bounded values is at most some number lets others bet against
it at fair odds. A gambler who begins with 1 then has more than ``1 / alpha`` at *any*
time with probability `alpha` at most, if the number is right (Ville's inequality): such
a capital refutes it, whenever it is looked at and for whatever reason one stops.

The gambler here has several fixed bets, `BETS`, side by side. The numbers that are
refuted so far leave a *confidence sequence*, an interval that holds the mean at all
times at once.

Source: Waudby-Smith and Ramdas, Estimating means of bounded random variables by
betting, Journal of the Royal Statistical Society B 86, 2024 (arXiv:2010.09686); fixed
bets side by side are their grid Kelly; Ville, Étude critique de la notion de
collectif, 1939.
"""

import math

import numpy as np

from hlsd.core.types import FloatArray

BETS = ((1.0, 0.6), (0.5, 0.3), (0.25, 0.1))
"""The share of its capital that each bet risks, and the bet's share of the first
capital. Differences of planners are small beside their range, where the best bet risks
all; half and a quarter are for a range that is used, as by success. Chosen on made-up
laws (steady, skewed, rare failures, success and failure) before the simulation of
docs/statistics.md, which has others."""
_LEAST = 1e-6
"""Of the range: an end of an interval that is nearer to a bound is at the bound."""
_STEPS, _CLOSE, _CLOSE_LOG = 100, 1e-13, 1e-10
"""Of Newton's method for an end, which takes about five."""
_DIGITS = 10
"""Of an end of an interval, relative to the range: as every processor gives it."""


def capital(values: FloatArray, low: float, high: float, mean: float) -> FloatArray:
    """Capital after each value of who bets that their mean is above a number.

    Args:
        values: In the order in which they are seen, ``(n,)``.
        low: No value is below it.
        high: No value is above it.
        mean: The number; where it is not above ``low`` it can only be wrong.

    Returns:
        ``(n,)``; infinite where the number can only be wrong.

    Raises:
        ValueError: A value is out of bounds.
    """
    _check(values, low, high)
    if mean <= low:
        return np.full(len(values), math.inf)
    returns = (values - low) / (mean - low)
    held = np.zeros(len(values))
    with np.errstate(over="ignore", invalid="ignore"):
        for risk, share in BETS:
            held += share * np.cumprod((1 - risk) + risk * returns)
    return held


def first_above(held: FloatArray, threshold: float) -> int | None:
    """After how many values a capital reaches a threshold first; None if it does not.

    Args:
        held: From `capital`, ``(n,)``.
        threshold: ``1 / alpha``.
    """
    found = np.flatnonzero(held >= threshold)
    return int(found[0]) + 1 if len(found) else None


def fewest(alpha: float) -> int:
    """The fewest values that can show a difference, all of them as far as can be.

    Args:
        alpha: For both sides together.
    """
    count = 1
    while float(capital(np.ones(count), -1.0, 1.0, 0.0)[-1]) < 2 / alpha:
        count += 1
    return count


def confidence_sequence(
    values: FloatArray, low: float, high: float, alpha: float
) -> tuple[FloatArray, FloatArray]:
    """Intervals after each value, all of which hold the mean but with chance `alpha`.

    Args:
        values: In the order in which they are seen, ``(n,)``.
        low: No value is below it.
        high: No value is above it.
        alpha: How often the mean may ever be left out, half of it at either side.

    Returns:
        Lower and upper ends, ``(n,)`` each; an interval lies within those before.

    Raises:
        ValueError: A value is out of bounds.
    """
    _check(values, low, high)
    span = high - low
    shares = (values - low) / span
    lower = _lower_ends(shares, 2 / alpha)
    upper = 1.0 - _lower_ends(1.0 - shares, 2 / alpha)
    ends = low + span * np.round(lower, _DIGITS), low + span * np.round(upper, _DIGITS)
    return np.asarray(ends[0]), np.asarray(ends[1])


def _lower_ends(shares: FloatArray, threshold: float) -> FloatArray:
    """The highest mean in [0, 1] that is refuted after each value, 0 where none is."""
    ends = np.zeros(len(shares))
    wanted, place = math.log(threshold), math.log(_LEAST)
    end = 0.0
    for count in range(1, len(shares) + 1):
        seen = shares[:count]
        # The logarithm of the capital falls with that of the mean, and is convex: from
        # below, Newton's steps end below or at the place where it is as wanted.
        for _ in range(_STEPS):
            log, slope = _log_capital(seen, place)
            # The last step may be too far by rounding.
            if not log >= wanted - _CLOSE_LOG:
                break
            end = min(math.exp(place), 1.0)
            step = (log - wanted) / -slope if slope < 0 else 0.0
            if step < _CLOSE:
                break
            place += step
        place = math.log(end) if end > 0 else math.log(_LEAST)
        ends[count - 1] = end
    return ends


def _log_capital(shares: FloatArray, place: float) -> tuple[float, float]:
    """The logarithm of the last `capital`, and its slope, at the logarithm of a mean.

    Args:
        shares: Values in [0, 1], ``(n,)``.
        place: The logarithm of a mean in [0, 1].
    """
    returns = shares * math.exp(-place)
    logs, slopes = [], []
    with np.errstate(divide="ignore", invalid="ignore"):
        for risk, share in BETS:
            factors = (1 - risk) + risk * returns
            logs.append(math.log(share) + float(np.log(factors).sum()))
            slopes.append(-float(np.nansum(risk * returns / factors)))
    most = max(logs)
    weights = [math.exp(log - most) for log in logs]
    slope = sum(w * own for w, own in zip(weights, slopes, strict=True)) / sum(weights)
    return most + math.log(sum(weights)), slope


def _check(values: FloatArray, low: float, high: float) -> None:
    # Sums of differences miss the bounds by rounding.
    slack = 1e-9 * (high - low)
    if len(values) and not (
        values.min() >= low - slack and values.max() <= high + slack
    ):
        raise ValueError(f"values from {values.min()} to {values.max()}, not in range")
