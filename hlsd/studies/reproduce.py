"""The whole experiment of the paper in one call: data, policies, runs, table, figure.

Each step leaves its output and beside it a stamp, see `hlsd.studies.stamps`. A step
whose output is there with the same stamp is skipped; one whose output was made from
something else, an hlsd of other code included, is refused, so that no folder ever mixes
two experiments.
"""

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from hlsd.analysis.runs import load_episodes
from hlsd.core.errors import HlsdError
from hlsd.core.files import write_atomic
from hlsd.core.npz import sha256_of_file
from hlsd.core.progress import COLLECT_S, RUN_S, THERE, TRAIN_S, Steps, TellWhole
from hlsd.data.motion_log import MotionLog
from hlsd.data.worlds import load_suite
from hlsd.learning.collect import collect
from hlsd.learning.policy import Policy, shipped_policy
from hlsd.learning.train_many import Trained, Training, require_torch, train_many
from hlsd.learning.training import TRAINABLE
from hlsd.run.bench import Bench, resolve, run_bench
from hlsd.run.folder import EPISODES
from hlsd.sim.robots import get_robot
from hlsd.studies.paper import (
    PUBLISHED,
    Dataset,
    Learning,
    behaviour,
    load_timing,
    plot_regression,
    table_one,
)
from hlsd.studies.stamps import RESULT_CODE, claim, code_digest, software

TRIALS = 3
"""Runs per world (section IV-B)."""
QUICK_STRIDE = 6
"""Of the worlds, a quick reproduction takes each so many-th one."""
PRESETS = ("1.0", "0.4")
"""The two data sets of the paper (section IV-A)."""
POLICIES = ("hlsd10", "lfh10", "hlsd04", "lfh04")
"""The planners that learn."""
TABLE = "table1"
BEHAVIOUR = "behaviour"
DATASET = "dataset"
FIGURE = "regression.png"


@dataclass(frozen=True, slots=True)
class Reproduction:
    """What a reproduction leaves for people.

    Attributes:
        table: The paper's table beside ours, in Markdown.
        behaviour: How the planners drove, in Markdown.
        dataset: What they learned from, in Markdown.
        figure: Path of the regression plot.
    """

    table: str
    behaviour: str
    dataset: str
    figure: Path


def default_folder(quick: bool, suite: str) -> Path:
    """Where a reproduction goes if nobody says: a folder under ``runs/``."""
    kind = "reproduce-quick" if quick else "reproduce"
    return Path("runs") / f"{kind}-{load_suite(suite).name}"


def reproduce(
    out: Path,
    quick: bool,
    suite: str,
    jobs: int,
    progress: TellWhole | None = None,
) -> Reproduction:
    """Collect twice, train four policies, run five planners; tables and figure.

    Steps that are done already, with the same inputs, are skipped; an interrupted run
    of the planners goes on where it stopped, and policies that are finished stay.

    Args:
        out: Folder, made where it does not exist. It gets ``open-space-*.npz``, a
            policy per planner that learns, the run in ``bench`` and tables and figure
            in ``paper``, each with a stamp.
        quick: Take the shipped policies and every sixth world.
        suite: A suite's name or folder.
        jobs: Worker processes: so many policies are trained, or worlds driven, at a
            time.
        progress: Told of every step.

    Raises:
        HlsdError: Bad settings, torch is not installed and a policy is still to be
            trained, or an output in ``out`` that was made from other inputs; it is
            left as it is.
    """
    if jobs < 1:
        raise HlsdError(f"--jobs is {jobs}: at least 1 is needed")
    worlds = load_suite(suite).indices[:: QUICK_STRIDE if quick else 1]
    nominal_s = _nominal_s(out, quick, len(worlds), jobs)
    if nominal_s.get(_TRAIN):
        require_torch()  # now, not when the data are collected
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise HlsdError(
            f"cannot write to output folder {str(out)!r}: {error.strerror}"
        ) from error
    steps = Steps(nominal_s, progress)
    logs: dict[str, Path] = {}
    policies: dict[str, Path] = {}
    if not quick:
        logs = {preset: _collect(out, preset, steps) for preset in PRESETS}
        policies = _train(out, logs, jobs, steps)
    bench = Bench(
        planners=tuple(PUBLISHED),
        suite=suite,
        worlds=",".join(map(str, worlds)) if quick else None,
        trials=TRIALS,
        seed=_SEED,
        policies=tuple(policies.items()),
    )
    run = _bench(out, bench, jobs, steps)
    return _paper(out, run, _learning(logs, policies), steps)


_SEED = 0
_ROBOT = "jackal"

# See `hlsd.core.progress` for the other nominal durations [s].
_PAPER_S = 5.0

_TRAIN = "train"
_BENCH = "bench"
_PAPER = "paper"


def _nominal_s(out: Path, quick: bool, worlds: int, jobs: int) -> dict[str, float]:
    """Of each step in order, 0 for one whose output is there."""
    runs = worlds * len(PUBLISHED) * TRIALS
    nominal_s: dict[str, float] = {}
    if not quick:
        for preset in PRESETS:
            there = _log(out, preset).exists()
            nominal_s[_collecting(preset)] = 0.0 if there else COLLECT_S
        missing = sum(not _policy(out, planner).exists() for planner in POLICIES)
        nominal_s[_TRAIN] = math.ceil(missing / jobs) * TRAIN_S
    driven = (out / _BENCH / EPISODES).exists()
    nominal_s[_BENCH] = 0.0 if driven else runs * RUN_S / jobs
    nominal_s[_PAPER] = 0.0 if (out / _PAPER / FIGURE).exists() else _PAPER_S
    return nominal_s


def _log(out: Path, preset: str) -> Path:
    return out / f"open-space-{preset}.npz"


def _policy(out: Path, planner: str) -> Path:
    return out / f"{planner}.npz"


def _training_time(policy: Path) -> Path:
    """Wall times never repeat, so they are kept beside the policy, not in it."""
    return policy.with_suffix(".timing.json")


def _collecting(preset: str) -> str:
    return f"collect {preset}"


def _collect(out: Path, preset: str, steps: Steps) -> Path:
    robot = get_robot(_ROBOT)
    output, tell = _log(out, preset), steps.step(_collecting(preset))
    inputs = {
        "preset": preset,
        "law": "matched",
        "seed": _SEED,
        "robot": robot.name,
        "robot_version": robot.version,
        **_made_by("mujoco", "numpy"),
    }
    claim(output, inputs)
    if output.exists():
        tell(*THERE)
    else:
        collect(preset, "matched", _SEED, robot, tell).save(output)
    return output


def _train(
    out: Path, logs: Mapping[str, Path], jobs: int, steps: Steps
) -> dict[str, Path]:
    """Policy file of each planner that learns."""
    tell = steps.step(_TRAIN)
    made_by = _made_by("numpy", "torch")
    digests = {preset: sha256_of_file(log) for preset, log in logs.items()}
    outputs = {planner: _policy(out, planner) for planner in POLICIES}
    for planner, output in outputs.items():
        recipe = TRAINABLE[planner]
        inputs = {
            "recipe": asdict(recipe),
            "seed": _SEED,
            "motion_log_sha256": digests[recipe.preset],
            **made_by,
        }
        claim(output, inputs)
    missing = [planner for planner in POLICIES if not outputs[planner].exists()]
    if not missing:
        tell(*THERE)
        return outputs
    recipes = [TRAINABLE[planner] for planner in missing]
    done = [0] * len(missing)
    what, total = ", ".join(missing), sum(recipe.optimiser.steps for recipe in recipes)

    def progress(number: int, steps_done: int, _total: int) -> None:
        done[number] = steps_done
        tell(what, sum(done), total)

    def finished(number: int, trained: Trained) -> None:
        output = outputs[missing[number]]
        timing = {"wall_s": round(trained.wall_s, 2), "at_once": trained.at_once}
        write_atomic(_training_time(output), json.dumps(timing) + "\n")
        trained.policy.save(output)

    tell(what, 0, total)
    train_many(
        [Training(recipe, logs[recipe.preset], _SEED) for recipe in recipes],
        jobs,
        finished,
        progress,
    )
    return outputs


def _bench(out: Path, bench: Bench, jobs: int, steps: Steps) -> Path:
    output, tell = out / _BENCH, steps.step(_BENCH)
    claim(output, {**asdict(resolve(bench)), **_made_by("mujoco", "numpy", "numba")})
    if (output / EPISODES).exists():
        tell(*THERE)
    else:
        run_bench(bench, output, jobs, lambda k, n, _: tell("runs", k, n))
    return output


def _learning(
    logs: Mapping[str, Path], policies: Mapping[str, Path]
) -> dict[str, Learning]:
    """What each policy's provenance, log and timing file say of its training."""
    learning = {}
    for planner in POLICIES:
        file = policies[planner] if planner in policies else shipped_policy(planner)
        provenance = json.loads(Policy.load(file, planner).provenance)
        facts = provenance["training_set"]
        timing = _training_time(file)
        training_s, driven_s = None, None
        if timing.exists():
            training_s = float(json.loads(timing.read_text("utf-8"))["wall_s"])
        preset = TRAINABLE[planner].preset
        if preset in logs:
            log = MotionLog.load(logs[preset])
            driven_s = (len(log.poses) - 1) * log.period_s
        learning[planner] = Learning(
            preset, facts["points"], facts["samples"], driven_s, training_s
        )
    return learning


def _paper(
    out: Path, run: Path, learning: Mapping[str, Learning], steps: Steps
) -> Reproduction:
    output, tell = out / _PAPER, steps.step(_PAPER)
    inputs = {
        "episodes_sha256": sha256_of_file(run / EPISODES),
        "timing_sha256": sha256_of_file(run / "timing.csv"),
        "learning": {planner: asdict(facts) for planner, facts in learning.items()},
        **software("hlsd"),
        "hlsd_code": code_digest(*("analysis", "report", "run", "studies")),
    }
    claim(output, inputs)
    if (output / FIGURE).exists():
        tell(*THERE)
    else:
        output.mkdir(exist_ok=True)
        episodes = load_episodes(run)
        table, drove = table_one(episodes, load_timing(run)), behaviour(episodes)
        learned = Dataset(learning)
        for name, text in (
            (f"{TABLE}.md", table.markdown()),
            (f"{TABLE}.tex", table.latex()),
            (f"{TABLE}.csv", table.csv()),
            (f"{BEHAVIOUR}.md", drove.markdown()),
            (f"{BEHAVIOUR}.csv", drove.csv()),
            (f"{DATASET}.md", learned.markdown()),
            (f"{DATASET}.csv", learned.csv()),
        ):
            write_atomic(output / name, text)
        plot_regression(episodes, output / FIGURE)
        tell("tables and figure", 1, 1)
    table_md, behaviour_md, dataset_md = (
        (output / f"{name}.md").read_text("utf-8")
        for name in (TABLE, BEHAVIOUR, DATASET)
    )
    return Reproduction(table_md, behaviour_md, dataset_md, output / FIGURE)


def _made_by(*packages: str) -> dict[str, str]:
    """Of the software that decides a step's output: versions, and hlsd's own code."""
    return {**software("hlsd", *packages), "hlsd_code": code_digest(*RESULT_CODE)}
