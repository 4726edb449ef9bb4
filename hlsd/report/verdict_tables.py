"""Verdicts as text: what `hlsd compare` and `hlsd gate` print."""

from collections.abc import Sequence

import numpy as np

from hlsd.analysis.compare import (
    MIN_WORLDS,
    ComparedRuns,
    Judged,
    Side,
    Verdict,
)
from hlsd.analysis.gate import GatedRun, Status
from hlsd.analysis.metrics import Metric
from hlsd.analysis.parts import stopped_text
from hlsd.report.tables import (
    UNDEFINED,
    interval_text,
    markdown_table,
    markdown_text,
    p_text,
)

NEXT_STEP = (
    "adding worlds or trials and asking again until it fits errs more often than 5 %. "
    "hlsd bench --planner A --planner B --until-decided may look after every world, "
    "and so may hlsd compare A B --until-decided on runs that are there."
)
"""What helps where a verdict is inconclusive."""


def comparison_markdown(compared: ComparedRuns) -> str:
    """A comparison for people: a row per metric, and what was compared."""
    a, b, judged = compared.a, compared.b, compared.judged
    robots = dict.fromkeys(side.conditions.robot_text for side in (a, b))
    head = [
        "metric",
        "A",
        "B",
        "A - B",
        "95 % interval",
        "Wilcoxon p",
        "margin",
        "A is",
    ]
    rows = []
    for row in judged:
        pair, metric = row.paired, row.metric
        adjusted = f", Holm {p_text(row.holm_p)}" if len(judged) > 1 else ""
        rows.append(
            [
                metric.heading,
                metric.printed(float(pair.a.mean())),
                metric.printed(float(pair.b.mean())),
                signed(metric, pair.difference),
                _interval(metric, pair.low, pair.high),
                p_text(pair.p) + adjusted,
                f"± {metric.printed(row.margin)}",
                verdict_words(row),
            ]
        )
    how = (
        f"runs paired by trial: seed {a.conditions.seed}, the same starts and noise"
        if judged[0].paired.by_trial
        else "runs not paired within a world: their seeds differ or are unknown"
    )
    worlds = len(judged[0].paired.worlds)
    notes = [f"{worlds} common worlds, {how}. Means are over worlds."]
    notes += left_out(a, b)
    models = {side.conditions.robot_sha256 for side in (a, b)} - {""}
    if len(robots) > 1 or len(models) > 1:
        notes.append("The robots differ: so may the results, for that alone.")
    if a.planner == b.planner and (parts := a.other_parts(b)):
        notes.append(
            f"A and B are both called {a.planner}, but differ in their "
            f"{' and '.join(parts)}."
        )
    notes += _undecided(judged) + _peeking(compared)
    if judged[0].paired.same_runs:
        notes.append("A and B are the same runs: nothing can differ.")
    setting = markdown_text(
        f"A = {a.name}, B = {b.name}; {a.conditions.suite}, protocol "
        f"{a.conditions.protocol.name}, robot {' against '.join(robots)}"
        f"{perturbed(('A', a), ('B', b))}"
    )
    return f"{setting}\n\n{markdown_table(head, rows, *notes)}"


def gate_markdown(gated: GatedRun) -> str:
    """What the gate says, for people: the status, a row per metric, what it is from."""
    head = [
        "metric",
        "run",
        "baseline",
        "difference",
        "90 % interval",
        "worse by at most",
        "Wilcoxon p of more",
        "",
    ]
    rows = [
        [
            row.metric.heading,
            row.metric.printed(float(row.paired.a.mean())),
            row.metric.printed(float(row.paired.b.mean())),
            signed(row.metric, row.paired.difference),
            _interval(row.metric, row.paired.low_90, row.paired.high_90),
            row.metric.printed(row.limit),
            p_text(row.ranks_p),
            str(row.status),
        ]
        for row in gated.gated
    ]
    pair = gated.gated[-1].paired
    sides = gated.run, gated.baseline
    unknown = any(side.conditions.seed is None for side in sides)
    how = (
        "paired by trial"
        if pair.by_trial
        else f"not paired: the seeds {'are not known' if unknown else 'differ'}"
    )
    notes = [f"{len(pair.worlds)} worlds, {pair.a_runs} runs, {how}."]
    if pair.same_runs:
        notes.append("The runs are the baseline's own: nothing has changed.")
    elif len(pair.worlds) < MIN_WORLDS:
        notes.append(
            f"{MIN_WORLDS} worlds are the fewest, unless all runs are the same."
        )
    notes += _stopped(gated.run)
    if gated.status is Status.INCONCLUSIVE:
        notes.append(f"Inconclusive: {NEXT_STEP}")
    sides_named = ("run", gated.run), ("baseline", gated.baseline)
    said = (
        f"{gated.status}: {gated.run.name} against {gated.baseline.name}"
        f"{perturbed(*sides_named)}"
    )
    return f"{markdown_text(said)}\n\n{markdown_table(head, rows, *notes)}"


def verdict_words(row: Judged) -> str:
    """The verdict, with what has to be said beside it."""
    if row.paired.same_runs:
        return f"{row.verdict}: the same runs"
    if row.within_margin and row.verdict is not Verdict.EQUIVALENT:
        return f"{row.verdict}, but within the margin"
    return str(row.verdict)


def perturbed(*sides: tuple[str, Side]) -> str:
    """What stood between world and robot: once where it is the same, else by side."""
    held = {
        name: ", ".join(map(str, side.conditions.perturbations)) for name, side in sides
    }
    if not any(held.values()):
        return ""
    if len(set(held.values())) == 1:
        return f"; both perturbed by {next(iter(held.values()))}"
    return "".join(
        f"; {name} perturbed by {text}" if text else f"; {name} not perturbed"
        for name, text in held.items()
    )


def signed(metric: Metric, value: float) -> str:
    """A difference with its sign and without its unit."""
    return f"{metric.scale * value:+.{metric.decimals}f}"


def _interval(metric: Metric, low: float, high: float) -> str:
    """The interval of a difference, a dash where there is none."""
    form = f"+.{metric.decimals}f"
    return interval_text(metric.scale * low, metric.scale * high, form) or UNDEFINED


def left_out(a: Side, b: Side) -> list[str]:
    """What only one side holds."""
    notes = []
    for side, other in ((a, b), (b, a)):
        alone = len(np.setdiff1d(side.worlds, other.worlds))
        if alone:
            notes.append(f"Left out: {alone} worlds that only {side.name} holds.")
    return notes


def _stopped(*sides: Side) -> list[str]:
    """Said of runs that stopped for their result."""
    found = dict.fromkeys(
        text
        for side in sides
        if side.rows is not None and (text := stopped_text(side.rows))
    )
    return [
        f"{text}: intervals and p from such worlds err more often than they say; "
        "hlsd compare --until-decided does not."
        for text in found
    ]


def _peeking(compared: ComparedRuns) -> list[str]:
    """What to do, and what not, where it is not decided or was stopped for a result."""
    notes = _stopped(compared.a, compared.b)
    if Verdict.INCONCLUSIVE in compared.verdicts.values():
        notes.append(f"Inconclusive: {NEXT_STEP}")
    return notes


def _undecided(judged: Sequence[Judged]) -> list[str]:
    """What a metric leaves out, and where worlds are too few for a verdict."""
    notes = []
    for row in judged:
        if row.a_undefined or row.b_undefined:
            notes.append(
                f"{row.metric.title}: not defined for {row.a_undefined} runs of A and "
                f"{row.b_undefined} of B, which are left out, and with them what they "
                "are paired with."
            )
        if row.paired.same_runs:
            continue
        if len(row.paired.worlds) < MIN_WORLDS:
            notes.append(
                f"{row.metric.title}: no verdict from {len(row.paired.worlds)} worlds; "
                f"{MIN_WORLDS} are the fewest."
            )
        elif np.isnan(row.paired.low):
            notes.append(
                f"{row.metric.title}: no interval, since all worlds differ by the same."
            )
    return notes
