"""Whether a reference was driven on a run's course: what it says, and what it shows.

A reference can say it: by a column, by the record of an imported run, or by the word of
who gives it. The metric of an ``out.txt`` shows it. Of a CSV that says nothing, the
times can contradict the run's course; if they do not, the course stays unknown.
"""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np

from hlsd.analysis.out_txt_metric import (
    metric_doubts,
    metric_fit,
    official_lengths_m,
    shown_protocol,
)
from hlsd.analysis.reference import PENALTY_S, Format, Recorded
from hlsd.analysis.run_trials import RunTrials
from hlsd.core.errors import HlsdError, unknown_name
from hlsd.run.protocol import (
    BARN2022,
    HLSD2021,
    PROTOCOLS,
    Protocol,
    get_protocol,
    protocols,
)
from hlsd.sim.robots import ROBOTS

LATE = 0.02
"""By how much a recorded time may be beyond the limit: evaluators look now and then."""
AT_LIMIT = 0.005
"""By how much a timeout's is, of the evaluator of 2020."""
FAST = 0.05
"""By how much a run may be faster than the shortest way at the robot's top speed."""
_FEW = 2
_OFTEN = 3


class Source(StrEnum):
    """How the protocol of a reference is known.

    Members:
        STATED: By the word of who gives it.
        COLUMN: By the CSV's column.
        RECORD: By the record of an imported run.
        METRIC: By the metric of an ``out.txt``.
        TIMES: It is not; its times contradict the run's.
        NOTHING: It is not.
    """

    STATED = "stated"
    COLUMN = "column"
    RECORD = "run.json"
    METRIC = "metric"
    TIMES = "times"
    NOTHING = "nothing"


_SAID = {
    Source.STATED: "as is stated",
    Source.COLUMN: "as its column protocol says",
    Source.RECORD: "as its run.json says",
    Source.METRIC: "as its metric shows",
}


@dataclass(frozen=True, slots=True, eq=False)
class Course:
    """What is known of the course that a reference was driven on.

    Attributes:
        protocol: What it was driven under; None where it is unknown.
        source: How that is known.
        same: Whether the course is the run's; None where it is unknown.
        note: What a reader has to know of it, a sentence; where it is another course,
            what shows that, without a full stop.
        limit_s: Where its failed runs stand [s].
        doubts: What speaks against it, in sentences.
    """

    protocol: Protocol | None
    source: Source
    same: bool | None
    note: str
    limit_s: float
    doubts: tuple[str, ...] = ()

    def refusal(self) -> HlsdError:
        """The error for a reference of another course."""
        if self.source is Source.RECORD:
            wanted = "validate a run under the rules that it records"
        elif self.source in _SAID and self.protocol is not None:
            wanted = f"validate a run under {self.protocol.name}"
        elif self.source is Source.METRIC:
            wanted = "validate a run under barn2022 or barn2024"
        else:
            wanted = "say what it was driven under with `reference_protocol`"
        return HlsdError(
            f"{self.note}: {wanted}, or compare the order of the worlds alone with "
            "`other_course`",
            argument="reference_protocol",
        )


def course_of(
    ours: RunTrials, held: Recorded, stated: str | None, penalty_s: float
) -> Course:
    """What is known of a reference's course.

    Args:
        ours: The run that it is held against.
        held: The reference.
        stated: Name of the protocol that it was driven under, or ``module:attribute``;
            None where nobody says.
        penalty_s: See `hlsd.analysis.reference.counted`.

    Raises:
        HlsdError: There is no such protocol, the reference names another one, or it was
            driven in other worlds.
    """
    if stated is not None and held.protocol not in ("", stated):
        raise HlsdError(
            f"`reference_protocol` is {stated}, but {held.where} names {held.protocol}",
            argument="reference_protocol",
        )
    if held.conditions is not None:
        return _recorded(ours, held)
    if held.protocol:
        return _known(ours, held, _named(ours, held), Source.COLUMN, penalty_s)
    if stated is not None:
        own = stated == ours.protocol.name
        protocol = ours.protocol if own else get_protocol(stated)
        return _known(ours, held, protocol, Source.STATED, penalty_s)
    if held.format is Format.OUT_TXT:
        return _of_metric(ours, held)
    return _of_times(ours, held, penalty_s)


def _named(ours: RunTrials, held: Recorded) -> Protocol:
    """The protocol that a CSV's column names: of text from a file, nothing is loaded.

    Raises:
        HlsdError: There is none of this name.
    """
    if held.protocol == ours.protocol.name:
        return ours.protocol
    names = protocols.names()
    if held.protocol not in names:
        unknown = unknown_name("protocol", held.protocol, names)
        raise HlsdError(f"{held.where}: {unknown}")
    return protocols.get(held.protocol)


def _recorded(ours: RunTrials, held: Recorded) -> Course:
    """Of an imported run: all that both recorded is compared."""
    assert held.conditions is not None
    protocol = held.conditions.protocol
    differences = ours.conditions.differences(held.conditions)
    for name, (here, there) in differences.items():
        if name.startswith("suite"):
            raise HlsdError(
                f"{held.where} and the run differ in their {name} ({there}, {here}): "
                "the worlds of one number must be the same ones"
            )
    rules = [name for name in differences if name.startswith("protocol")]
    if not rules:
        note = f"The reference is of the run's worlds and rules, {_SAID[Source.RECORD]}"
        return Course(protocol, Source.RECORD, True, f"{note}.", protocol.limit_s)
    if rules[0] == "protocol":
        return _other(ours, held, protocol, Source.RECORD)
    here, there = differences[rules[0]]
    note = (
        f"{held.where} and the run were driven under other rules of the name "
        f"{protocol.name}: the {rules[0]} is {there}, the run's {here}"
    )
    return Course(protocol, Source.RECORD, False, note, protocol.limit_s)


def _known(
    ours: RunTrials,
    held: Recorded,
    protocol: Protocol,
    source: Source,
    penalty_s: float,
) -> Course:
    """Where the protocol is named.

    Raises:
        HlsdError: No ``out.txt`` can be of it.
    """
    if held.format is Format.OUT_TXT and protocol.score is None:
        raise HlsdError(
            f"`reference_protocol` is {protocol.name}, which has no score: {held.where}"
            " is an out.txt of the BARN Challenge",
            argument="reference_protocol",
        )
    if protocol != ours.protocol:
        return _other(ours, held, protocol, source)
    doubts = [
        f"It is said to be of {protocol.name}, but {found}."
        for found in contradictions(ours, held, penalty_s)
    ]
    if held.format is Format.OUT_TXT:
        doubts += metric_doubts(
            protocol, metric_fit(held, protocol, official_lengths_m(ours))
        )
    note = (
        f"The reference was driven under {protocol.name}, as the run, {_SAID[source]}; "
        f"that its worlds are those of {ours.suite} is your word."
    )
    return Course(protocol, source, True, note, protocol.limit_s, tuple(doubts))


def _other(
    ours: RunTrials, held: Recorded, protocol: Protocol, source: Source
) -> Course:
    note = (
        f"{held.where} was driven under {protocol.name}, {_SAID[source]}, and the run "
        f"under {ours.protocol.name}, whose course is another"
    )
    return Course(protocol, source, False, note, protocol.limit_s)


# ---------------------------------------------------------------- what the times show


def contradictions(ours: RunTrials, held: Recorded, penalty_s: float) -> list[str]:
    """What in a reference's times cannot be of the run's protocol and worlds."""
    protocol = ours.protocol
    limit_s = protocol.limit_s
    times = held.times_s
    found = []
    late = times > (1 + LATE) * limit_s
    if late.any():
        found.append(
            f"{late.sum()} of its runs took longer than {limit_s:g} s, the limit of "
            f"{protocol.name}, up to {times.max():.1f} s"
        )
    mark = mark_of_2020(held, penalty_s)
    if mark and limit_s != HLSD2021.limit_s:
        found.append(
            f"{mark}, as the evaluator of {HLSD2021.name} has it, where the limit of "
            f"{protocol.name} is {limit_s:g} s"
        )
    fast = _too_fast(ours, held)
    if fast:
        found.append(
            f"{fast} of its runs are faster than the shortest way of {protocol.name} at"
            " the robot's top speed"
        )
    return found


def mark_of_2020(held: Recorded, penalty_s: float) -> str:
    """What in a CSV's times is the mark of the evaluator of 2020; "" where nothing is.

    It ended runs at 50 s and wrote exactly 30 s for those that it gave up. Two runs at
    50 s with none later are a mark, and so is a time of 30 s that stands there three
    times and three times as often as any other.
    """
    limit_s = HLSD2021.limit_s
    times = held.times_s
    if held.format is not Format.CSV or times.max() > (1 + LATE) * limit_s:
        return ""
    ends = times[~held.reached]
    capped = int(((ends >= limit_s) & (ends <= (1 + AT_LIMIT) * limit_s)).sum())
    marks = []
    if capped >= _FEW:
        marks.append(f"{capped} of its runs end at {limit_s:g} s, none later")
    given_up = int((held.times_s[~held.said] == PENALTY_S).sum())
    others = times[(times != PENALTY_S) & (times < limit_s)]
    _, counts = np.unique(others, return_counts=True)
    most = int(counts.max(initial=1))
    if penalty_s == PENALTY_S and given_up >= _OFTEN * most:
        marks = [f"{given_up} of its runs took exactly {PENALTY_S:g} s", *marks]
    return " and ".join(marks)


def _too_fast(ours: RunTrials, held: Recorded) -> int:
    """How many runs of a reference no robot of the run's top speed could drive."""
    robot = ROBOTS.get(ours.conditions.robot)
    if robot is None:
        return 0
    lengths = ours.rows.groupby("world")["shortest_length_m"].min()
    free_m = np.sqrt(ours.protocol.clock_displacement_sq_m2)
    least_s = (1 - FAST) * (lengths - free_m) / robot.limits.max_speed
    bound_s = least_s.reindex(held.worlds).to_numpy(np.float64)  # NaN where unknown
    failed = held.said & ~held.reached
    return int(((held.times_s < bound_s) & ~failed).sum())


def _of_times(ours: RunTrials, held: Recorded, penalty_s: float) -> Course:
    """Of a CSV that says nothing."""
    own = ours.protocol
    found = contradictions(ours, held, penalty_s)
    mark = mark_of_2020(held, penalty_s)
    if found:
        note = (
            f"{held.where} does not look driven under {own.name}, as the run was: "
            f"{'; '.join(found)}"
        )
        limit_s = HLSD2021.limit_s if mark else _least_limit_s(held)
        return Course(None, Source.TIMES, False, note, limit_s)
    shown = ""
    if mark and own == HLSD2021:
        shown = f" ({mark}, as the evaluator of {own.name} has it, which is no proof)"
    note = (
        f"The reference does not say what it was driven in: that it is {ours.suite} "
        f"under {own.name}, as the run, is your word{shown}; --reference-protocol NAME "
        "or a column protocol states it."
    )
    return Course(None, Source.NOTHING, None, note, own.limit_s)


def _least_limit_s(held: Recorded) -> float:
    """The least limit of a built-in protocol that its times could be of [s]."""
    longest_s = float(held.times_s.max())
    limits = {protocol.limit_s for protocol in PROTOCOLS.values()}
    return min((n for n in limits if longest_s <= (1 + LATE) * n), default=longest_s)


# -------------------------------------------------------------- what the metric shows


def _of_metric(ours: RunTrials, held: Recorded) -> Course:
    """Of an ``out.txt``."""
    own = ours.protocol
    if own.score is None:
        shown = shown_protocol(ours, held)
        metric = "" if shown is None else f", by its metric of {shown.name},"
        note = (
            f"{held.where} is an out.txt of the BARN Challenge{metric} and the run was "
            f"driven under {own.name}, whose course is another"
        )
        limit_s = (shown or BARN2022).limit_s
        return Course(shown, Source.METRIC, False, note, limit_s)
    fit = metric_fit(held, own, official_lengths_m(ours))
    if fit.whole:
        note = (
            f"The reference is of the run's worlds and rules, {_SAID[Source.METRIC]}."
        )
        return Course(own, Source.METRIC, True, note, own.limit_s)
    shown = shown_protocol(ours, held)
    if shown is not None:
        return _other(ours, held, shown, Source.METRIC)
    note = (
        "The reference is an out.txt of the BARN Challenge, whose metric does not show "
        f"the rules that it was driven by: that it is {ours.suite} under {own.name}, "
        "as the run, is your word; --reference-protocol NAME states it."
    )
    doubts = metric_doubts(own, fit)
    return Course(None, Source.NOTHING, None, note, own.limit_s, doubts)
