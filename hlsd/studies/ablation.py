"""What each choice is worth: planners that differ from HLSD 1.0 in one factor.

The paper leaves open how exploration draws its targets, how far to the side of the
robot a footprint point lies and where the offset is added; its three hidden layers
come without a reason. For each factor a policy is trained with everything else as it
is, and all of them drive the same generated worlds.

Each step leaves its output and a stamp, see `hlsd.studies.stamps`: what is there from
the same inputs is not done again.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd

from hlsd.analysis.runs import load_episodes, times_s
from hlsd.analysis.statistics import paired_difference
from hlsd.analysis.summary import summarise
from hlsd.core.errors import HlsdError
from hlsd.core.files import write_atomic
from hlsd.core.npz import sha256_of_file
from hlsd.core.progress import (
    COLLECT_S,
    RUN_S,
    THERE,
    TRAIN_S,
    Steps,
    TellStage,
    TellWhole,
)
from hlsd.data.worlds import generate_suite_at
from hlsd.learning.collect import collect
from hlsd.learning.hallucination import Hallucination, OffsetOrder
from hlsd.learning.train_many import Training, require_torch, train_many
from hlsd.learning.training import TRAINABLE, Recipe
from hlsd.run.bench import Bench, resolve, run_bench
from hlsd.run.folder import EPISODES
from hlsd.run.protocol import get_protocol
from hlsd.sim.robots import get_robot
from hlsd.studies.stamps import RESULT_CODE, claim, code_digest, software

PLANNER = "hlsd10"
"""Whose choices are varied: HLSD 1.0."""
TABLE = "ablations"
"""Stem of the table's two files."""
DEFAULT_FOLDER = Path("runs") / "ablations"
"""Where it all goes if nobody says."""


@dataclass(frozen=True, slots=True)
class Variant:
    """A policy of `PLANNER` that is made in some way.

    Attributes:
        name: Short, fit for a file's name.
        change: What is other than in the default, in words.
        law: Of exploration, a name in `hlsd.learning.collect.LAWS`.
        recipe: What it is trained from.
    """

    name: str
    change: str
    law: str = "matched"
    recipe: Recipe = TRAINABLE[PLANNER]


_RECIPE = TRAINABLE[PLANNER]
_SCANS = _RECIPE.hallucination


def _imagining(name: str, change: str, hallucination: Hallucination) -> Variant:
    return Variant(name, change, recipe=replace(_RECIPE, hallucination=hallucination))


VARIANTS = (
    Variant(
        "default",
        "default: law matched, side offset 0.43 m, offset before the clamp, three "
        "hidden layers",
    ),
    Variant("uniform", "exploration law uniform", law="uniform"),
    _imagining("side-0.30", "side offset 0.30 m", replace(_SCANS, side_offset_m=0.30)),
    _imagining(
        "side-0.215", "side offset 0.215 m", replace(_SCANS, side_offset_m=0.215)
    ),
    _imagining(
        "after-clamp",
        "offset after the clamp",
        replace(_SCANS, offset_order=OffsetOrder.AFTER_CLAMP),
    ),
    Variant(
        "two-layers",
        "two hidden layers",
        recipe=replace(_RECIPE, hidden=_RECIPE.hidden[:2]),
    ),
)
"""The default, then one factor at a time."""


@dataclass(frozen=True, slots=True)
class Ablation:
    """What to compare, and on what.

    Attributes:
        variants: The first is what the others are compared with.
        count: Worlds to generate.
        suite_seed: Of the worlds.
        trials: Runs per world.
        seeds: Policies to train for each variant, from training seeds 0, 1, ...

    Raises:
        HlsdError: A number below 1.
    """

    variants: tuple[Variant, ...] = VARIANTS
    count: int = 120
    suite_seed: int = 1
    trials: int = 3
    seeds: int = 1

    def __post_init__(self) -> None:
        for name, value in (
            ("count", self.count),
            ("trials", self.trials),
            ("seeds", self.seeds),
        ):
            if value < 1:
                raise HlsdError(f"--{name} is {value}: at least 1 is needed")


@dataclass(frozen=True, slots=True)
class Row:
    """What a variant came to.

    Attributes:
        variant: Its name.
        n: Runs.
        success: Fraction of runs.
        mean_time_s: Over all runs, failures at the protocol's limit [s].
        sd_time_s: Their standard deviation [s].
        mean_time_low_s: Lower end of the mean's 95 % interval, clustered by world [s].
        mean_time_high_s: Its upper end [s].
        seed_low_s: Lowest mean time of a single training seed [s].
        seed_high_s: Highest one [s].
        mean_success_time_s: Over successes alone [s]; NaN where there is none.
        contact_free: Fraction of runs.
        recovery: Share of ticks spent in recovery.
        errors: Runs that ended in an error of the planner.
        difference_s: Mean of the time less the first variant's, with the same seed, in
            the same world and trial [s].
        difference_low_s: Lower end of its 95 % interval, clustered by world [s].
        difference_high_s: Its upper end [s].
    """

    variant: str
    n: int
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
    if jobs < 1:
        raise HlsdError(f"--jobs is {jobs}: at least 1 is needed")
    _refuse_others(out)
    laws = tuple(dict.fromkeys(variant.law for variant in ablation.variants))
    nominal_s = _nominal_s(ablation, out, laws, jobs)
    if nominal_s[_TRAIN] > 0.0:
        require_torch()  # now, not when the data are collected
    for folder in (out, out / _POLICIES, out / _BENCH):
        _make_folder(folder)
    steps = Steps(nominal_s, progress)
    suite = _generate(ablation, out, steps.step(_GENERATE))
    logs = {law: _collect(out, law, steps.step(_collecting(law))) for law in laws}
    _train(ablation, out, logs, jobs, steps.step(_TRAIN))
    _drive(ablation, out, suite, jobs, steps.step(_DRIVE))
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


def compare(runs: Mapping[str, pd.DataFrame]) -> tuple[Row, ...]:
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
            Row(
                variant=name,
                n=int(summary["n"]),
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
                / max(1.0, float(episodes["ticks"].sum())),
                errors=int(summary["errors"]),
                difference_s=paired.difference,
                difference_low_s=paired.low,
                difference_high_s=paired.high,
            )
        )
    return tuple(rows)


def markdown(ablation: Ablation, rows: Sequence[Row]) -> str:
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
    table = [head, ["---"] * len(head)]
    for variant, row in zip(ablation.variants, rows, strict=True):
        compared = (
            f"{row.difference_s:+.2f} ({row.difference_low_s:+.2f} … "
            f"{row.difference_high_s:+.2f})"
        )
        table.append(
            [
                variant.change,
                f"{row.success:.1%}",
                f"{row.mean_time_s:.2f} ± {row.sd_time_s:.2f}",
                f"{row.mean_time_low_s:.2f} … {row.mean_time_high_s:.2f}",
                f"{row.seed_low_s:.2f} … {row.seed_high_s:.2f}",
                f"{row.mean_success_time_s:.2f}" if row.success > 0 else "none",
                f"{row.contact_free:.1%}",
                f"{row.recovery:.1%}",
                "" if row is rows[0] else compared,
            ]
        )
    if ablation.seeds == 1:
        for cells in table:
            del cells[4]
    lines = [f"| {' | '.join(cells)} |" for cells in table]
    return (
        "\n".join([_setting(ablation), "", *lines, "", _notes(ablation, rows)]) + "\n"
    )


def csv(ablation: Ablation, rows: Sequence[Row]) -> str:
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
            "training_seeds": ablation.seeds,
        }
        values = asdict(row)
        records.append({"variant": values.pop("variant"), **factors, **values})
    return str(pd.DataFrame(records).to_csv(index=False, lineterminator="\n"))


_WORLDS, _POLICIES, _BENCH = "generated", "policies", "bench"
_ROBOT, _PRESET, _PROTOCOL = "jackal", _RECIPE.preset, "hlsd2021"
_COLLECT_SEED = _BENCH_SEED = 0

# What of hlsd decides logs and policies. Less than `RESULT_CODE`, so that they are kept
# when planners or navigation change, and only the runs have to be made again.
_TRAIN_CODE = ("core", "data", "learning")
_COLLECT_CODE = ("assets", "core", "data", "learning", "sim")


# See `hlsd.core.progress` for the other nominal durations [s].
_GENERATE_S = 0.15

_GENERATE = "generate worlds"
_TRAIN = "train"
_DRIVE = "drive"


def _nominal_s(
    ablation: Ablation, out: Path, laws: Sequence[str], jobs: int
) -> dict[str, float]:
    """Of each step in order, 0 for one whose output is there."""
    there = (out / _WORLDS).exists()
    nominal_s = {_GENERATE: 0.0 if there else ablation.count * _GENERATE_S}
    for law in laws:
        nominal_s[_collecting(law)] = 0.0 if _log(out, law).exists() else COLLECT_S
    policies = list(_policies(ablation))
    untrained = sum(not _policy(out, *policy).exists() for policy in policies)
    nominal_s[_TRAIN] = math.ceil(untrained / jobs) * TRAIN_S
    undriven = sum(
        not (_run_folder(out, *policy) / EPISODES).exists() for policy in policies
    )
    runs = undriven * ablation.count * ablation.trials
    nominal_s[_DRIVE] = runs * RUN_S / jobs
    return nominal_s


def _refuse_others(out: Path) -> None:
    """A table is written anew only where it is ours."""
    for name in (f"{TABLE}.md", f"{TABLE}.csv"):
        if (out / name).exists() and not (out / _WORLDS).exists():
            raise HlsdError(
                f"{str(out / name)!r} is there, but not the worlds that it came from: "
                "choose another --out"
            )


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise HlsdError(
            f"cannot write to output folder {str(folder)!r}: {error.strerror}"
        ) from error


def _generate(ablation: Ablation, out: Path, progress: TellStage) -> str:
    folder = out / _WORLDS
    claim(
        folder,
        {
            "count": ablation.count,
            "suite_seed": ablation.suite_seed,
            **software("hlsd", "numpy"),
            "hlsd_code": code_digest("data/barn.py", "data/worlds.py"),
        },
    )
    if folder.exists():
        progress(*THERE)
    else:
        generate_suite_at(
            folder,
            ablation.count,
            ablation.suite_seed,
            lambda done: progress("generating", done, ablation.count),
        )
    # An absolute path: a suite's name would go before a folder of that name.
    return str(folder.resolve())


def _collect(out: Path, law: str, progress: TellStage) -> Path:
    robot = get_robot(_ROBOT)
    output = _log(out, law)
    claim(
        output,
        {
            "preset": _PRESET,
            "law": law,
            "seed": _COLLECT_SEED,
            "robot": robot.name,
            "robot_version": robot.version,
            **software("hlsd", "mujoco", "numpy"),
            "hlsd_code": code_digest(*_COLLECT_CODE),
        },
    )
    if output.exists():
        progress(*THERE)
    else:
        collect(_PRESET, law, _COLLECT_SEED, robot, progress).save(output)
    return output


def _collecting(law: str) -> str:
    return f"collect, law {law}"


def _log(out: Path, law: str) -> Path:
    return out / f"open-space-{law}.npz"


def _policy(out: Path, variant: Variant, seed: int) -> Path:
    return out / _POLICIES / f"{variant.name}-{seed}.npz"


def _run_folder(out: Path, variant: Variant, seed: int) -> Path:
    return out / _BENCH / f"{variant.name}-{seed}"


def _policies(ablation: Ablation) -> Iterator[tuple[Variant, int]]:
    """Every variant with each of its training seeds."""
    for variant in ablation.variants:
        for seed in range(ablation.seeds):
            yield variant, seed


def _train(
    ablation: Ablation,
    out: Path,
    logs: Mapping[str, Path],
    jobs: int,
    progress: TellStage,
) -> None:
    made_by = software("hlsd", "numpy", "torch")
    made_by["hlsd_code"] = code_digest(*_TRAIN_CODE)
    digests = {law: sha256_of_file(log) for law, log in logs.items()}
    missing = []
    for variant, seed in _policies(ablation):
        output = _policy(out, variant, seed)
        inputs = {
            "recipe": asdict(variant.recipe),
            "seed": seed,
            "motion_log_sha256": digests[variant.law],
            **made_by,
        }
        claim(output, inputs)
        if not output.exists():
            training = Training(variant.recipe, logs[variant.law], seed)
            missing.append((training, output))
    if not missing:
        progress(*THERE)
        return
    what = f"{_count(len(missing), 'policy', 'policies')}, gradient steps"
    total = sum(training.recipe.optimiser.steps for training, _ in missing)
    steps = [0] * len(missing)

    def tell(number: int, done: int, _total: int) -> None:
        steps[number] = done
        progress(what, sum(steps), total)

    progress(what, 0, total)
    train_many(
        [training for training, _ in missing],
        jobs,
        lambda number, trained: trained.policy.save(missing[number][1]),
        tell,
    )


def _drive(
    ablation: Ablation,
    out: Path,
    suite: str,
    jobs: int,
    progress: TellStage,
) -> None:
    made_by = software("hlsd", "mujoco", "numpy", "numba")
    made_by["hlsd_code"] = code_digest(*RESULT_CODE)
    missing = []
    for variant, seed in _policies(ablation):
        bench = Bench(
            planners=(PLANNER,),
            suite=suite,
            trials=ablation.trials,
            protocol=_PROTOCOL,
            robot=_ROBOT,
            seed=_BENCH_SEED,
            policies=((PLANNER, _policy(out, variant, seed)),),
        )
        folder = _run_folder(out, variant, seed)
        claim(folder, {**asdict(resolve(bench)), **made_by})
        if not (folder / EPISODES).exists():
            missing.append((bench, folder))
    if not missing:
        progress(*THERE)
        return
    what = f"{_count(len(missing), 'run', 'runs')}, episodes"
    each = ablation.count * ablation.trials
    for number, (bench, folder) in enumerate(missing):
        before = number * each

        def tell(done: int, _total: int, _s: float, before: int = before) -> None:
            progress(what, before + done, each * len(missing))

        run_bench(bench, folder, jobs, tell)


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
        f"{PLANNER}; {' x '.join(counts)}, protocol {_PROTOCOL}, robot {robot.name} "
        f"{robot.version}"
    )


def _notes(ablation: Ablation, rows: Sequence[Row]) -> str:
    limit_s = get_protocol(_PROTOCOL).limit_s
    behind = (
        "One training seed stands behind each row: a difference that is no larger than "
        "those between seeds shows nothing, and `--seeds` measures those."
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
