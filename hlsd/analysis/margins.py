"""Differences that do not matter: read as typed, and what holds if nobody says."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from hlsd.analysis.metrics import Metric, get_metric
from hlsd.core.errors import HlsdError


@dataclass(frozen=True, slots=True)
class Margin:
    """A difference that does not matter.

    Attributes:
        amount: In the metric's own unit, or a share of the other side's mean.
        relative: Whether it is such a share.
    """

    amount: float
    relative: bool

    def of(self, reference: float) -> float:
        """The margin in the metric's unit; never negative.

        Args:
            reference: Mean of what is compared with.
        """
        return self.amount * abs(reference) if self.relative else self.amount


def default_margin(metric: Metric) -> Margin:
    """What does not matter if nobody says: 2 points of a share, else 5 %."""
    return Margin(0.02, False) if metric.unit == "%" else Margin(0.05, True)


def parse_margin(text: str, metric: Metric) -> Margin:
    """A margin as typed: ``5%`` of the other side's mean, or ``0.3`` as printed.

    Args:
        text: A number with or without %; shares are printed in points.
        metric: Its `scale` is that between value and print.

    Raises:
        HlsdError: It is not a number, or below 0.
    """
    relative = text.strip().endswith("%")
    try:
        amount = float(text.strip().removesuffix("%"))
    except ValueError:
        amount = math.nan
    if not (math.isfinite(amount) and amount >= 0):
        raise HlsdError(
            f"{text!r} is not a margin: 5% for a share of the other's mean, 0.3 for "
            f"{metric.name} as printed{f' [{metric.unit}]' if metric.unit else ''}"
        )
    return Margin(amount / (100 if relative else metric.scale), relative)


def parse_margins(
    metrics: Sequence[str], text: str | None, argument: str
) -> Mapping[str, Margin | None]:
    """The margin of each metric as typed once for all; None where nobody says.

    Args:
        metrics: Their names.
        text: A share for any number of metrics, or an amount for a single one.
        argument: How errors call it.

    Raises:
        HlsdError: There is no such metric, or the text is not a margin for all of them.
    """
    found = [get_metric(name) for name in metrics]
    if text is None:
        return dict.fromkeys(metrics)
    margins = {
        name: parse_margin(text, metric)
        for name, metric in zip(metrics, found, strict=True)
    }
    if len(metrics) > 1 and not all(margin.relative for margin in margins.values()):
        raise HlsdError(
            f"{argument} {text} is of one metric, but {', '.join(metrics)} are "
            "compared: give a share such as 5%, or one metric"
        )
    return margins
