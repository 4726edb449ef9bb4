"""What an agreement comes to, in one plain sentence: a function of its numbers.

Each threshold stands here, once; docs/agreement-with-gazebo.md says what they mean.
"""

from dataclasses import dataclass
from enum import StrEnum

from hlsd.analysis.agreement import Agreement, Comparison
from hlsd.analysis.statistics import Estimate
from hlsd.core.types import IntArray

TIME_MARGIN = 0.10
"""Times are the same where the interval of their ratio lies within 1 by this."""
SUCCESS_MARGIN = 0.10
"""Success is the same where the interval of the difference lies within this."""
AS_ITSELF = 0.9
"""Of the reference's agreement with itself: from there on, the order is the same."""
PARTLY = 0.5
"""Of the same: from there on, the order is partly the same; below, hardly."""
NAMED = 10
"""Worlds that the sentence names of a kind."""


class Amount(StrEnum):
    """How a figure of the run stands to the reference's.

    Members:
        SAME: The interval lies within the margin.
        MORE: It does not, and lies above the reference's.
        LESS: Likewise below.
        OPEN: None of these: more worlds would tell.
        UNTOLD: There is no interval.
        NOT_COMPARED: The courses differ.
    """

    SAME = "same"
    MORE = "more"
    LESS = "less"
    OPEN = "open"
    UNTOLD = "untold"
    NOT_COMPARED = "not compared"


class Order(StrEnum):
    """How far the run's hard worlds are the reference's.

    Members:
        AS_ITSELF: Pearson's r is `AS_ITSELF` of the reference's agreement with itself
            or more, and its interval begins at `PARTLY` of it or above.
        PARTLY: Pearson's r is `PARTLY` of it or more, and the interval leaves out 0.
        HARDLY: Pearson's r is less, and the interval leaves out 0.
        NOT_SHOWN: The interval holds 0.
        OPPOSED: The interval lies below 0.
        UNTOLD: There is no correlation, or no interval.
    """

    AS_ITSELF = "as the reference with itself"
    PARTLY = "partly"
    HARDLY = "hardly"
    NOT_SHOWN = "not shown"
    OPPOSED = "opposed"
    UNTOLD = "untold"


@dataclass(frozen=True, slots=True)
class Verdict:
    """What an agreement comes to.

    Attributes:
        sentence: All of it; of many worlds, the first `NAMED`.
        times: Of mean times, every failure at the limit.
        order: Of which worlds are hard, by mean time.
        success: Of success rates; None where no run of either side failed.
        only_ours_fail: Worlds where all our runs fail and none of the reference's.
        only_reference_fails: Worlds where all of the reference's fail and none of ours.
    """

    sentence: str
    times: Amount
    order: Order
    success: Amount | None
    only_ours_fail: tuple[int, ...]
    only_reference_fails: tuple[int, ...]

    def as_json(self) -> dict[str, object]:
        """All of it as texts and lists."""
        return {
            "sentence": self.sentence,
            "times": self.times.value,
            "order": self.order.value,
            "success": None if self.success is None else self.success.value,
            "worlds_only_ours_fail": list(self.only_ours_fail),
            "worlds_only_reference_fails": list(self.only_reference_fails),
        }


def verdict_of(
    agreement: Agreement, planner: str, limit_s: float, same_course: bool = True
) -> Verdict:
    """What an agreement comes to.

    Args:
        agreement: The figures.
        planner: Name of the run's.
        limit_s: Where the run's failures stand [s].
        same_course: False where times and success rates cannot be compared.
    """
    ours, theirs = agreement.ours, agreement.reference
    failures = bool((ours.success < 1).any() or (theirs.success < 1).any())
    times, success = Amount.NOT_COMPARED, Amount.NOT_COMPARED if failures else None
    if same_course:
        ratio = agreement.time_at_limit_s.ratio
        times = amount(ratio, 1.0, TIME_MARGIN)
        if failures:
            success = amount(agreement.success.difference, 0.0, SUCCESS_MARGIN)
    pearson, itself = agreement.time.pearson, _itself(agreement)
    order = order_of(pearson, itself)
    only_ours = ours.worlds[(ours.success == 0) & (theirs.success == 1)]
    only_theirs = ours.worlds[(theirs.success == 0) & (ours.success == 1)]
    text = f"On {len(ours.worlds)} worlds"
    if same_course:
        counted = f", every failure at {limit_s:g} s" if failures else ""
        text += f", {_times_text(times, agreement.time_at_limit_s, planner, counted)}"
        text += f" and its {_order_text(order, pearson, itself)}"
    else:
        text += (
            f" by other rules, so that times and success are not compared, {planner}'s "
            f"{_order_text(order, pearson, itself)}"
        )
    if success is not None and same_course:
        text += f"; {_success_text(success, agreement.success)}"
        text += _worlds_text("its runs fail and none of the reference's", only_ours)
        text += _worlds_text("the reference's runs fail and none of its", only_theirs)
    return Verdict(
        sentence=f"{text}.",
        times=times,
        order=order,
        success=success,
        only_ours_fail=tuple(only_ours.tolist()),
        only_reference_fails=tuple(only_theirs.tolist()),
    )


def amount(held: Estimate, none: float, margin: float) -> Amount:
    """How a figure stands to the reference's.

    Args:
        held: Ratio or difference.
        none: Its value where both are the same.
        margin: By which it may differ and counts as the same.
    """
    if held.value is None or held.low is None or held.high is None:
        return Amount.UNTOLD
    if none - margin <= held.low and held.high <= none + margin:
        return Amount.SAME
    if held.low > none:
        return Amount.MORE
    return Amount.LESS if held.high < none else Amount.OPEN


def order_of(pearson: Estimate, itself: float | None) -> Order:
    """How far the order of worlds is the reference's.

    Args:
        pearson: Of mean times over worlds.
        itself: The reference's agreement with itself; None where it is unknown, which
            is held to be perfect.
    """
    value, low, high = pearson.value, pearson.low, pearson.high
    if value is None or low is None or high is None:
        return Order.UNTOLD
    if low <= 0:
        return Order.OPPOSED if high < 0 else Order.NOT_SHOWN
    best = 1.0 if itself is None else itself
    if value >= AS_ITSELF * best and low >= PARTLY * best:
        return Order.AS_ITSELF
    return Order.PARTLY if value >= PARTLY * best else Order.HARDLY


def _itself(agreement: Agreement) -> float | None:
    halves = agreement.time.pearson_halves
    return None if halves is None else halves.spearman_brown


_TIMES = {
    Amount.SAME: f"which is the same to {100 * TIME_MARGIN:.0f} %",
    Amount.MORE: "which is longer",
    Amount.LESS: "which is shorter",
    Amount.OPEN: f"which may be the same to {100 * TIME_MARGIN:.0f} % or not",
}


def _times_text(times: Amount, row: Comparison, planner: str, counted: str) -> str:
    ratio = row.ratio
    if ratio.value is None:
        return f"nothing compares {planner}'s times with the reference's"
    text = f"{planner}'s runs take {ratio.value:.2f} times the reference's time"
    if ratio.low is None or ratio.high is None:
        return f"{text} (no interval{counted})"
    return f"{text} ({ratio.low:.2f} … {ratio.high:.2f}{counted}), {_TIMES[times]},"


_ORDERS = {
    Order.AS_ITSELF: "are the reference's, as nearly as the reference repeats itself",
    Order.PARTLY: "are partly the reference's",
    Order.HARDLY: "are hardly the reference's",
    Order.NOT_SHOWN: "are not shown to be the reference's",
    Order.OPPOSED: "are the reference's easy ones",
    Order.UNTOLD: "cannot be judged by the reference's",
}


def _order_text(order: Order, pearson: Estimate, itself: float | None) -> str:
    text = f"hard worlds {_ORDERS[order]}"
    if pearson.value is None:
        return f"{text}: no correlation is defined"
    text += f": Pearson {pearson.value:.2f}"
    if pearson.low is None or pearson.high is None:
        text += " (no interval)"
    else:
        zero = ", which holds 0" if order is Order.NOT_SHOWN else ""
        text += f" ({pearson.low:.2f} … {pearson.high:.2f}{zero})"
    if itself is None:
        return f"{text}, where the reference's agreement with itself is unknown"
    return f"{text}, where the reference agrees with itself at {itself:.2f}"


_SUCCESSES = {
    Amount.SAME: f"it succeeds as often, to {100 * SUCCESS_MARGIN:.0f} points",
    Amount.MORE: "it succeeds more often",
    Amount.LESS: "it succeeds less often",
    Amount.OPEN: "whether it succeeds as often is open",
    Amount.UNTOLD: "nothing tells whether it succeeds as often",
}


def _success_text(success: Amount, row: Comparison) -> str:
    ours, theirs, by = row.ours.value, row.reference.value, row.difference
    assert ours is not None
    assert theirs is not None
    rates = f"{100 * ours:.1f} % of runs against {100 * theirs:.1f} %"
    text = f"{_SUCCESSES[success]}, {rates}"
    if by.low is None or by.high is None:
        return text
    return f"{text} (by {100 * by.low:+.1f} … {100 * by.high:+.1f} points)"


def _worlds_text(where: str, worlds: IntArray) -> str:
    """A clause that names worlds; "" for none."""
    if not len(worlds):
        return ""
    named = ", ".join(map(str, worlds[:NAMED].tolist()))
    more = f" and {len(worlds) - NAMED} more" if len(worlds) > NAMED else ""
    return f"; worlds where all {where}: {named}{more}"
