"""A run beside its reference as text: what `hlsd validate` prints."""

from hlsd.analysis.agreement import Agreement, Association, Comparison
from hlsd.analysis.reliability import SPLITS, SplitHalf
from hlsd.analysis.statistics import LEVEL, RESAMPLES, Estimate
from hlsd.analysis.validate import ValidatedRun
from hlsd.report.tables import (
    UNDEFINED,
    interval_text,
    markdown_table,
    markdown_text,
    percent_text,
    with_interval,
)

_UNDEFINED = "undefined"


def agreement_markdown(validated: ValidatedRun) -> str:
    """The comparison for people: verdict, means, correlations, what they are from."""
    run, reference, agreement = (
        validated.run,
        validated.reference,
        validated.agreement,
    )
    same = validated.course.same is not False
    means = [_seconds("time of all runs [s]", agreement.time_s, same)]
    if reference.penalties and same:
        limit = f"... every failure at {run.protocol.limit_s:g} s [s]"
        means.append(_seconds(limit, agreement.time_at_limit_s, same))
    means += [
        _seconds("time of successes [s]", agreement.success_time_s, same),
        _percent("success", agreement.success, same),
    ]
    correlations = [
        *_correlated("mean time", agreement.time),
        *_correlated("success rate", agreement.success_rate),
    ]
    setting = markdown_text(
        f"{run.planner} ({run.suite}, protocol {run.protocol.name}, robot "
        f"{run.robot}) against {reference.name}: {len(agreement.ours.worlds)} worlds, "
        f"{agreement.ours.runs.sum()} runs against {agreement.reference.runs.sum()}"
    )
    return (
        f"{markdown_text(validated.verdict.sentence)}\n\n{setting}\n\n"
        + markdown_table(["", run.planner, reference.name, "compared"], means)
        + _worlds(validated)
        + markdown_table(
            ["over worlds", "Pearson r", "Spearman rho"],
            correlations,
            *_notes(validated),
        )
    )


def _worlds(validated: ValidatedRun) -> str:
    """Worlds where one side always fails and the other never; "" without failures."""
    verdict = validated.verdict
    if verdict.success is None:
        return ""
    ours, theirs = validated.run.planner, validated.reference.name
    rows = [
        [
            f"all runs of {one} fail and none of {other}",
            str(len(worlds)),
            ", ".join(map(str, worlds)) or UNDEFINED,
        ]
        for one, other, worlds in (
            (ours, theirs, verdict.only_ours_fail),
            (theirs, ours, verdict.only_reference_fails),
        )
    ]
    return markdown_table(["worlds where", "number", "which"], rows)


def _notes(validated: ValidatedRun) -> list[str]:
    run, reference, agreement = (
        validated.run,
        validated.reference,
        validated.agreement,
    )
    limit = f"{run.protocol.limit_s:g} s"
    percent = percent_text(LEVEL, 0)
    lines = [
        f"In brackets: {percent} intervals from {RESAMPLES} resamples of worlds, and "
        "for means also of each world's runs; for success, from counting runs by "
        "world; for the halves, the middle "
        f"{percent} of {SPLITS} random splits. Every world "
        "counts the same, but for the time of successes, a mean over runs. A failed "
        f"run of {run.planner} counts {limit}."
    ]
    if reference.penalties:
        lines.append(
            f"{reference.penalties} reference runs are recorded at the penalty for a "
            "failed run and keep that time in the mean of all runs."
        )
    if reference.timeouts:
        their_limit = f"{validated.course.limit_s:g} s"
        lines.append(
            f"{reference.timeouts} reference runs took {their_limit} or longer and "
            f"count as timeouts at {their_limit}."
        )
    lines += _course_notes(validated)
    if run.errors:
        lines.append(f"{run.errors} of our runs ended in a planner's error.")
    if agreement.only_ours or agreement.only_reference:
        lines.append(
            f"Left out: {agreement.only_ours} worlds that only the run holds, "
            f"{agreement.only_reference} that only the reference holds."
        )
    return lines + _undefined(agreement)


def _course_notes(validated: ValidatedRun) -> list[str]:
    course = validated.course
    if course.same is not False:
        return [course.note, *course.doubts]
    return [
        f"{course.note}: the order of the worlds can be compared, times and success "
        f"cannot. A failed run of {validated.reference.name} counts "
        f"{course.limit_s:g} s."
    ]


def _undefined(agreement: Agreement) -> list[str]:
    """What was left out because a correlation with a constant does not exist."""
    counts = []
    for name, held in (
        ("time", agreement.time),
        ("success", agreement.success_rate),
    ):
        if held.pearson.undefined:
            counts.append(f"{held.pearson.undefined} resamples for {name}")
        if held.pearson_halves is not None and held.pearson_halves.undefined:
            counts.append(f"{held.pearson_halves.undefined} splits for {name}")
    if agreement.success_time_s.ratio.undefined:
        counts.append(
            f"{agreement.success_time_s.ratio.undefined} resamples without a success"
        )
    return [f"Left out as undefined: {', '.join(counts)}."] if counts else []


def _seconds(name: str, row: Comparison, same_course: bool) -> list[str]:
    ratio = f"x {_estimated(row.ratio, '.3f')}" if same_course else UNDEFINED
    return [name, _estimated(row.ours), _estimated(row.reference), ratio]


def _percent(name: str, row: Comparison, same_course: bool) -> list[str]:
    difference = UNDEFINED
    if same_course:
        difference = f"{_estimated(row.difference, '+.1f', scale=100)} points"
    return [
        f"{name} [%]",
        _estimated(row.ours, ".1f", scale=100),
        _estimated(row.reference, ".1f", scale=100),
        difference,
    ]


def _correlated(name: str, found: Association) -> list[list[str]]:
    """The correlations, then the reference's with itself."""
    halves = found.pearson_halves, found.spearman_halves
    return [
        [name, _estimated(found.pearson), _estimated(found.spearman)],
        [
            "... reference, half against half (uncorrected)",
            *(_uncorrected(split) for split in halves),
        ],
        [
            "... reference, Spearman-Brown corrected",
            *(_corrected(split) for split in halves),
        ],
    ]


def _uncorrected(split: SplitHalf | None) -> str:
    if split is None:
        return _UNDEFINED
    return _ranged(split.uncorrected, split.low, split.high, ".2f", 1.0)


def _corrected(split: SplitHalf | None) -> str:
    if split is None or split.spearman_brown is None:
        return _UNDEFINED
    return f"{split.spearman_brown:.2f}"


def _estimated(held: Estimate, form: str = ".2f", scale: float = 1.0) -> str:
    return _ranged(held.value, held.low, held.high, form, scale)


def _ranged(
    value: float | None, low: float | None, high: float | None, form: str, scale: float
) -> str:
    if value is None:
        return _UNDEFINED
    text = f"{scale * value:{form}}"
    if low is None or high is None:
        return text
    return with_interval(text, interval_text(scale * low, scale * high, form))
