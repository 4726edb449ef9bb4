"""What each choice is worth: policies that differ from the default in one factor.

The paper leaves open how exploration draws its targets, how far to the side of the
robot a footprint point lies and where the offset is added; its three hidden layers
come without a reason. Its speeds of HLSD 1.0 may or may not hold for HLSD 0.4. For
each factor a policy is trained with everything else as it is, and all of them drive
the same generated worlds.

Steps over `hlsd.studies.pipeline`: what is there from the same inputs is not done
again, and what was made from others is refused.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from hlsd.analysis.runs import load_episodes, times_s
from hlsd.analysis.statistics import paired_difference
from hlsd.analysis.summary import summarise
from hlsd.core.errors import HlsdError, require_at_least
from hlsd.core.files import write_atomic
from hlsd.core.progress import TellStage, TellWhole
from hlsd.data.worlds import generate_suite_at
from hlsd.learning.train_many import Training
from hlsd.report.tables import (
    UNDEFINED,
    csv_table,
    interval_text,
    markdown_table,
    percent_text,
    plus_minus,
    share_text,
    with_interval,
)
from hlsd.run.bench import Bench
from hlsd.run.protocol import get_protocol
from hlsd.sim.robots import get_robot
from hlsd.studies.pipeline import Step, run_steps
from hlsd.studies.steps import collecting, driving, training
from hlsd.studies.variants import PLANNER, Ablation, Variant

TABLE = "ablations"
"""Stem of the table's two files."""


@dataclass(frozen=True, slots=True)
class VariantResult:
    """What a variant came to.

    Attributes:
        variant: Its name.
        n: Runs.
        drove: Runs that drove.
        success: Fraction of runs.
        mean_time_s: Over all runs, failures at the protocol's limit [s].
        sd_time_s: Their standard deviation [s].
        mean_time_low_s: Lower end of the mean's 95 % interval, clustered by world [s].
        mean_time_high_s: Its upper end [s].
        seed_low_s: Lowest mean time of a single training seed [s].
        seed_high_s: Highest one [s].
        mean_success_time_s: Over successes alone [s]; NaN where there is none.
        contact_free: Fraction of the runs that drove; NaN where none did.
        recovery: Share of ticks spent in recovery; NaN likewise.
        errors: Runs that ended in an error of the planner.
        difference_s: Mean of the time less the first variant's, with the same seed, in
            the same world and trial [s].
        difference_low_s: Lower end of its 95 % interval, clustered by world [s].
        difference_high_s: Its upper end [s].
    """

    variant: str
    n: int
    drove: int
    success: float
    mean_time_s: float
    sd_time_s: float
    mean_time_low_s: float
    mean_time_high_s: float
    seed_low_s: float
    seed_high_s: float
    mean_success_time_s: float
    contact_free: float
    recovery: float
    errors: int
    difference_s: float
    difference_low_s: float
    difference_high_s: float


def default_folder(planner: str) -> Path:
    """Where an ablation goes if nobody says: a folder under ``runs/``."""
    name = "ablations" if planner == PLANNER else f"ablations-{planner}"
    return Path("runs") / name


def run_ablation(
    ablation: Ablation,
    out: Path,
    jobs: int,
    progress: TellWhole | None = None,
) -> str:
    """Generate worlds, collect, train and drive every variant, write the table.

    The same settings give the same bytes, whatever ``jobs`` is. What ``out`` holds
    already from the same inputs is not done again, but for the table, which is written
    anew from the runs.

    Args:
        ablation: What to compare.
        out: Folder, made where it does not exist. It gets the worlds (``generated``),
            ``open-space-LAW.npz``, ``policies/VARIANT-SEED.npz`` and the runs in
            ``bench/VARIANT-SEED``, each with a stamp, and the table as
            ``ablations.md`` and ``ablations.csv``.
        jobs: Worker processes: so many policies are trained, or worlds driven, at a
            time.
        progress: Told of every step.

    Returns:
        The table, in Markdown.

    Raises:
        HlsdError: Bad settings, torch is not installed, or an output in ``out`` that
            was made from other inputs; it is left as it is.
    """
    require_at_least(1, "jobs", jobs)
    _refuse_others(out)
    run_steps(_steps(ablation, out, jobs), progress)
    rows = compare(
        {
            variant.name: _load_runs(out, variant, ablation.seeds)
            for variant in ablation.variants
        }
    )
    table = markdown(ablation, rows)
    write_atomic(out / f"{TABLE}.md", table)
    write_atomic(out / f"{TABLE}.csv", csv(ablation, rows))
    return table


def compare(runs: Mapping[str, pd.DataFrame]) -> tuple[VariantResult, ...]:
    """A row for each variant.

    Args:
        runs: Episodes of each variant, from `hlsd.analysis.runs.load_episodes`, with
            one column more, ``training_seed``; the first are what the others are
            compared with.

    Raises:
        HlsdError: A variant was not run with the same seeds, worlds and trials as the
            first.
    """
    times = {name: _times(episodes) for name, episodes in runs.items()}
    first, *_ = runs
    rows = []
    for name, episodes in runs.items():
        if not times[name].index.equals(times[first].index):
            raise HlsdError(
                f"variant {name!r}, with {len(times[name])} runs, was not run with the "
                f"same seeds, worlds and trials as {first!r}, with {len(times[first])}"
            )
        worlds = times[name].index.get_level_values("world").to_numpy(np.int64)
        pair = np.arange(len(worlds))
        paired = paired_difference(
            np.asarray(times[name], np.float64),
            worlds,
            np.asarray(times[first], np.float64),
            worlds,
            a_trials=pair,
            b_trials=pair,
        )
        of_seeds = times[name].groupby(level="training_seed").mean()
        summary = summarise(episodes).iloc[0]
        rows.append(
            VariantResult(
                variant=name,
                n=int(summary["n"]),
                drove=int(summary["drove"]),
                success=float(summary["success"]),
                mean_time_s=float(summary["mean_time_s"]),
                sd_time_s=float(summary["sd_time_s"]),
                mean_time_low_s=float(summary["mean_time_low_s"]),
                mean_time_high_s=float(summary["mean_time_high_s"]),
                seed_low_s=float(of_seeds.min()),
                seed_high_s=float(of_seeds.max()),
                mean_success_time_s=float(summary["mean_success_time_s"]),
                contact_free=float(summary["contact_free"]),
                recovery=float(episodes["recovery_ticks"].sum())
                / (float(episodes["ticks"].sum()) or math.nan),
                errors=int(summary["errors"]),
                difference_s=paired.difference,
                difference_low_s=paired.low,
                difference_high_s=paired.high,
            )
        )
    return tuple(rows)


def markdown(ablation: Ablation, rows: Sequence[VariantResult]) -> str:
    """The table for people: what was run, the rows, a footnote.

    Args:
        ablation: What was run.
        rows: From `compare`.
    """
    head = [
        "variant",
        "success",
        "time, failures at limit [s]",
        "95 % interval [s]",
        "means by training seed [s]",
        "time of successes [s]",
        "contact-free",
        "recovery ticks",
        "difference to the default [s]",
    ]
    table = [head]
    for variant, row in zip(ablation.variants, rows, strict=True):
        compared = with_interval(
            f"{row.difference_s:+.2f}",
            interval_text(row.difference_low_s, row.difference_high_s, "+.2f"),
        )
        table.append(
            [
                variant.change,
                percent_text(row.success),
                plus_minus(row.mean_time_s, row.sd_time_s),
                interval_text(row.mean_time_low_s, row.mean_time_high_s, ".2f")
                or UNDEFINED,
                interval_text(row.seed_low_s, row.seed_high_s, ".2f"),
                f"{row.mean_success_time_s:.2f}" if row.success > 0 else "none",
                share_text(row.contact_free, row.drove, row.n),
                percent_text(row.recovery),
                "" if row is rows[0] else compared,
            ]
        )
    if ablation.seeds == 1:
        for cells in table:
            del cells[4]
    body = markdown_table(head, table[1:], _notes(ablation, rows))
    return f"{_setting(ablation)}\n\n{body}"


def csv(ablation: Ablation, rows: Sequence[VariantResult]) -> str:
    """The table for programs: a line per variant, with its factors, unrounded.

    Args:
        ablation: What was run.
        rows: From `compare`.
    """
    records = []
    for variant, row in zip(ablation.variants, rows, strict=True):
        imagined = variant.recipe.hallucination
        factors = {
            "law": variant.law,
            "side_offset_m": imagined.side_offset_m,
            "offset_order": imagined.offset_order.value,
            "hidden": "x".join(map(str, variant.recipe.hidden)),
            "empty_above_speed": imagined.empty_above_speed,
            "offset_from_speed": imagined.offset_from_speed,
            "offset_to_speed": imagined.offset_to_speed,
            "training_seeds": ablation.seeds,
        }
        values = asdict(row)
        records.append({"variant": values.pop("variant"), **factors, **values})
    return csv_table(records)


_ROBOT, _PROTOCOL = "jackal", "hlsd2021"
_COLLECT_SEED = _BENCH_SEED = 0

# See `hlsd.core.progress` for the other nominal durations [s].
_GENERATE_S = 0.02


def _steps(ablation: Ablation, out: Path, jobs: int) -> list[Step]:
    """Worlds, a log for each law, policies, runs."""
    laws = dict.fromkeys(variant.law for variant in ablation.variants)
    logs = {law: out / f"open-space-{law}.npz" for law in laws}
    trainings, benches = {}, {}
    for variant in ablation.variants:
        for seed in range(ablation.seeds):
            policy = out / "policies" / f"{variant.name}-{seed}.npz"
            trainings[policy] = Training(variant.recipe, logs[variant.law], seed)
            benches[_run_folder(out, variant, seed)] = _bench(ablation, out, policy)
    return [
        _generating(ablation, _worlds(out), jobs),
        *(
            collecting(
                f"collect, law {law}",
                log,
                preset=ablation.variants[0].recipe.preset,
                law=law,
                seed=_COLLECT_SEED,
                robot=get_robot(_ROBOT),
            )
            for law, log in logs.items()
        ),
        training(
            "train",
            trainings,
            jobs,
            title=lambda missing: (
                f"{_count(len(missing), 'policy', 'policies')}, gradient steps"
            ),
        ),
        driving(
            "drive",
            benches,
            jobs,
            episodes=ablation.count * ablation.trials,
            title=lambda missing: f"{_count(len(missing), 'run', 'runs')}, episodes",
        ),
    ]


def _worlds(out: Path) -> Path:
    return out / "generated"


def _run_folder(out: Path, variant: Variant, seed: int) -> Path:
    return out / "bench" / f"{variant.name}-{seed}"


def _bench(ablation: Ablation, out: Path, policy: Path) -> Bench:
    return Bench(
        planners=(ablation.planner,),
        # An absolute path: a suite's name would go before a folder of that name.
        suite=str(_worlds(out).resolve()),
        trials=ablation.trials,
        protocol=_PROTOCOL,
        robot=_ROBOT,
        seed=_BENCH_SEED,
        policies=((ablation.planner, policy),),
    )


def _generating(ablation: Ablation, folder: Path, jobs: int) -> Step:
    count, seed = ablation.count, ablation.suite_seed

    def make(_missing: Sequence[Path], tell: TellStage) -> None:
        generate_suite_at(
            folder,
            count,
            seed,
            lambda done: tell("generating", done, count),
            jobs=jobs,
        )

    return Step(
        name="generate worlds",
        outputs={folder: lambda: {"count": count, "suite_seed": seed}},
        make=make,
        code=generate_suite_at,
        packages=("numpy",),
        nominal_s=count * _GENERATE_S,
    )


def _refuse_others(out: Path) -> None:
    """A table is written anew only where it is ours."""
    for name in (f"{TABLE}.md", f"{TABLE}.csv"):
        if (out / name).exists() and not _worlds(out).exists():
            raise HlsdError(
                f"{str(out / name)!r} is there, but not the worlds that it came from: "
                "choose another `out`",
                argument="out",
            )


def _count(number: int, one: str, many: str) -> str:
    return f"{number} {one if number == 1 else many}"


def _load_runs(out: Path, variant: Variant, seeds: int) -> pd.DataFrame:
    """A variant's episodes, of all its training seeds."""
    return pd.concat(
        [
            load_episodes(_run_folder(out, variant, seed)).assign(training_seed=seed)
            for seed in range(seeds)
        ],
        ignore_index=True,
    )


def _times(episodes: pd.DataFrame) -> "pd.Series[float]":
    """Times of runs [s], failures at the limit, ordered by seed, world and trial."""
    keys = pd.MultiIndex.from_frame(episodes[["training_seed", "world", "trial"]])
    return pd.Series(times_s(episodes), index=keys).sort_index()


def _setting(ablation: Ablation) -> str:
    robot = get_robot(_ROBOT)
    command = (
        f"hlsd worlds generate --count {ablation.count} --seed {ablation.suite_seed}"
    )
    counts = [
        f"{_count(ablation.count, 'world', 'worlds')} (`{command}`)",
        _count(ablation.trials, "trial", "trials"),
    ]
    if ablation.seeds > 1:
        counts.append(f"{ablation.seeds} training seeds")
    return (
        f"{ablation.planner}; {' x '.join(counts)}, protocol {_PROTOCOL}, "
        f"robot {robot.name} {robot.version}"
    )


def _notes(ablation: Ablation, rows: Sequence[VariantResult]) -> str:
    limit_s = get_protocol(_PROTOCOL).limit_s
    behind = (
        "One training seed stands behind each row: a difference that is no larger than "
        "those between seeds shows nothing, and more seeds measure those."
        if ablation.seeds == 1
        else f"{ablation.seeds} training seeds, of one collected log, stand behind "
        "each row; the intervals leave out what other seeds would change."
    )
    text = (
        f"Mean ± sd over all runs, a run that fails counts {limit_s:g} s. Intervals "
        "are 95 %, from resampling worlds. A difference is of pairs of runs: the same "
        f"world, start and noise. {behind}"
    )
    if errors := sum(row.errors for row in rows):
        text += f" {_count(errors, 'run', 'runs')} ended in an error of the planner."
    return text
