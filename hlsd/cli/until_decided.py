"""The options of a comparison that may be looked at after every world."""

from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from hlsd.analysis.decided import DecidedRuns
    from hlsd.analysis.runs import Run

UntilDecidedOption = Annotated[
    bool,
    typer.Option(
        "--until-decided",
        help="Look at the worlds one by one, in an order that follows from suite and "
        "seeds, until there is a verdict (docs/until-decided.md).",
    ),
]
AlphaOption = Annotated[
    float | None,
    typer.Option(
        help="With --until-decided: how often better or worse may be said of equal "
        "planners, looks after every world included; 0.05 if left out."
    ),
]
BenchUntilOption = Annotated[
    bool,
    typer.Option(
        "--until-decided",
        help="Stop when it is decided which of two planners is better: worlds come in "
        "an order drawn from the seed, with a look after each "
        "(docs/until-decided.md).",
    ),
]
BenchMetricOption = Annotated[
    str | None,
    typer.Option(
        help="With --until-decided: metric that decides; time_s, failures at the "
        "limit, if left out."
    ),
]
BenchMarginOption = Annotated[
    str | None,
    typer.Option(
        help="With --until-decided: difference that does not matter: 5% of the second "
        "planner's mean, or 0.3 as printed; 5%, or 2 points of a share, if left out."
    ),
]


def decided_run(run: "Run", settings: dict[str, object]) -> "DecidedRuns | None":
    """What a finished run decided; None of one that drives all worlds.

    Args:
        run: The run.
        settings: Arguments of `hlsd.bench`.
    """
    if not settings.get("until_decided"):
        return None
    from hlsd.analysis.decided import compare_until_decided
    from hlsd.analysis.until_decided import METRIC

    a, b = (f"{run.path}:{name}" for name in run.planners)
    metric, margin, alpha = (settings.get(n) for n in ("metric", "margin", "alpha"))
    return compare_until_decided(
        a,
        b,
        METRIC if metric is None else str(metric),
        None if margin is None else str(margin),
        alpha if isinstance(alpha, float) else None,
    )
