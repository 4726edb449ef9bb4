"""A value or a mean over runs with its 95 % interval."""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from hlsd.analysis.statistics.resampling import interval_of, resampled_sums
from hlsd.core.types import FloatArray, IntArray


@dataclass(frozen=True, slots=True)
class Estimate:
    """A value with its 95 % percentile interval.

    Attributes:
        value: From the data as they are; None where it is undefined, as a correlation
            with a constant is.
        low: Lower end of the interval; None where no resample defines the value, or
            all give the same, which says nothing of other worlds.
        high: Upper end, likewise.
        undefined: Number of resamples left out because they do not define the value.
    """

    value: float | None
    low: float | None
    high: float | None
    undefined: int


def estimate(value: float, resampled: FloatArray) -> Estimate:
    """A value with the interval that resampling gives.

    Args:
        value: From the data as they are, NaN where it is undefined.
        resampled: From each resample, NaN where it is undefined.
    """
    defined = resampled[~np.isnan(resampled)]
    low, high = interval_of(defined)
    none = np.isnan(low)
    return Estimate(
        None if np.isnan(value) else float(value),
        None if none else low,
        None if none else high,
        len(resampled) - len(defined),
    )


def world_interval(
    values: FloatArray, worlds: IntArray, seed: int = 0
) -> tuple[float, float]:
    """A 95 % percentile interval of the mean over runs, by the double bootstrap.

    A rate has `rate_interval` instead.

    Args:
        values: One per run, ``(n,)``; a run whose value is NaN is left out.
        worlds: The world of each run, ``(n,)``.
        seed: Of the resampling.

    Returns:
        Lower and upper end; NaN where fewer than two worlds are left, or where all
        resamples have the same mean, which says nothing of other worlds.
    """
    return world_intervals([values], worlds, seed)[0]


def world_intervals(
    columns: Sequence[FloatArray], worlds: IntArray, seed: int = 0
) -> list[tuple[float, float]]:
    """`world_interval` of several values of the same runs, which are drawn once.

    Intervals are remembered: the same values of the same runs are not resampled again.

    Args:
        columns: A value per run each, ``(n,)``.
        worlds: The world of each run, ``(n,)``.
        seed: Of the resampling.
    """
    keys = [_digest(values, worlds, seed) for values in columns]
    if len(_found) > _MOST_FOUND:
        _found.clear()
    alike: dict[bytes, dict[bytes, FloatArray]] = {}
    for key, values in zip(keys, columns, strict=True):
        if key not in _found:
            alike.setdefault(np.isnan(values).tobytes(), {})[key] = values
    for group in alike.values():
        defined = ~np.isnan(next(iter(group.values())))
        if len(np.unique(worlds[defined])) < 2:
            _found.update(dict.fromkeys(group, (float("nan"), float("nan"))))
            continue
        held = [values[defined] for values in group.values()]
        table = np.column_stack([*held, np.ones(len(held[0]))])
        sums = resampled_sums(table, worlds[defined], seed)
        ends = [interval_of(sums[:, k] / sums[:, -1]) for k in range(len(held))]
        _found.update(zip(group, ends, strict=True))
    return [_found[key] for key in keys]


_found: dict[bytes, tuple[float, float]] = {}
"""Intervals by the digest of what they are of: tables ask for the same ones."""
_MOST_FOUND = 10_000


def _digest(values: FloatArray, worlds: IntArray, seed: int) -> bytes:
    total = hashlib.blake2b(digest_size=16)
    for part in (values.astype(np.float64), worlds.astype(np.int64)):
        total.update(np.ascontiguousarray(part).data)
    total.update(f"{len(values)} {seed}".encode())
    return total.digest()
