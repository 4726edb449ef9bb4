"""A comparison until it is decided, as text: what `--until-decided` prints."""

from hlsd.analysis.decided import DecidedRuns, Decision
from hlsd.analysis.statistics.betting import fewest
from hlsd.analysis.until_decided import Question
from hlsd.report.tables import interval_text, markdown_table, markdown_text
from hlsd.report.verdict_tables import left_out, perturbed, signed

_SHOWN = 6
"""Worlds of the order that are named."""


def decided_markdown(decided: DecidedRuns) -> str:
    """A row per metric, and what was compared."""
    a, b = decided.a, decided.b
    level = f"{100 * (1 - decided.alpha):g} %"
    head = [
        "metric",
        "A",
        "B",
        "A - B",
        f"{level} confidence sequence",
        "margin",
        "worlds looked at",
        "A is",
    ]
    rows = []
    for row in decided.judged:
        metric = row.metric
        of_a, of_b, difference = row.means
        ends = float(row.low[-1]) * metric.scale, float(row.high[-1]) * metric.scale
        rows.append(
            [
                metric.heading,
                metric.printed(of_a),
                metric.printed(of_b),
                signed(metric, difference),
                interval_text(*ends, f"+.{metric.decimals}f"),
                margin_text(row.asked),
                f"{len(row.worlds)} of {len(decided.order)} driven",
                words(row),
            ]
        )
    first = ", ".join(map(str, decided.order[:_SHOWN]))
    more = ", …" if len(decided.order) > _SHOWN else ""
    notes = [
        f"Worlds in an order that follows from suite and seed ({first}{more}), with a "
        "look after each. Means are over the worlds that were looked at; the sequence "
        f"may be looked at after every world, and errs in {100 * decided.alpha:g} % at "
        "most.",
        *left_out(a, b),
        *(note for row in decided.judged for note in _notes(row, decided)),
    ]
    setting = markdown_text(
        f"A = {a.name}, B = {b.name}; {a.conditions.suite}, protocol "
        f"{a.conditions.protocol.name}{perturbed(('A', a), ('B', b))}"
    )
    return f"{setting}\n\n{markdown_table(head, rows, *notes)}"


def words(row: Decision) -> str:
    """The verdict, with what has to be said beside it."""
    if row.same_runs:
        return f"{row.verdict}: the same runs"
    if row.within_margin and row.verdict.value != "equivalent":
        return f"{row.verdict}, but within the margin"
    return str(row.verdict)


def margin_text(asked: Question) -> str:
    """The margin as it was meant: a share of B's mean, or an amount."""
    if asked.margin.relative:
        return f"± {100 * asked.margin.amount:g} % of B"
    return f"± {asked.metric.printed(asked.margin.amount)}"


def _notes(row: Decision, decided: DecidedRuns) -> list[str]:
    title = row.metric.title
    if row.same_runs:
        return [f"{title}: A and B are the same runs: nothing can differ."]
    if row.decided:
        return []
    least = fewest(decided.alpha)
    if len(decided.order) < least:
        return [
            f"{title}: {least} worlds are the fewest that can show a difference, with "
            f"all of them on one side, and {len(decided.order)} are there."
        ]
    return [
        f"{title}: not decided by the end of the worlds. A longer run with a wider "
        "selection of worlds is another test: choose its worlds before it begins."
    ]
