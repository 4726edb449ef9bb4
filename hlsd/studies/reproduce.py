"""The whole experiment of the paper in one call: data, policies, runs, tables, figure.

Steps over `hlsd.studies.pipeline`: what is there from the same inputs is not done
again, and what was made from others is refused.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

from hlsd.analysis.runs import load_episodes, planning_times
from hlsd.core.errors import HlsdError, require_at_least
from hlsd.core.files import write_atomic
from hlsd.core.npz import sha256_of_file
from hlsd.core.progress import RUN_S, TellStage, TellWhole
from hlsd.core.reading import parse_json, read_json, shown
from hlsd.data.motion_log import MotionLog
from hlsd.data.worlds import load_suite
from hlsd.learning.policy import Policy, shipped_policy
from hlsd.learning.train_many import Trained, Training
from hlsd.learning.training import TRAINABLE
from hlsd.run.bench import Bench
from hlsd.run.folder import EPISODES, TIMING
from hlsd.sim.robots import get_robot
from hlsd.studies.behaviour import behaviour
from hlsd.studies.course import course_table
from hlsd.studies.paper import (
    PUBLISHED,
    TITLES,
    Dataset,
    Learning,
    plot_regression,
    table_one,
)
from hlsd.studies.pipeline import Inputs, Step, run_steps
from hlsd.studies.steps import collecting, driving, save, training

TRIALS = 3
"""Runs per world (section IV-B)."""
COURSE_TRIALS = 5
"""Runs of each planner on the course (section IV-C)."""
QUICK_STRIDE = 6
"""Of the worlds, a quick reproduction takes each so many-th one."""
PRESETS = ("1.0", "0.4")
"""The two data sets of the paper (section IV-A)."""
POLICIES = ("hlsd10", "lfh10", "hlsd04", "lfh04")
"""The planners that learn."""
TABLE = "table1"
BEHAVIOUR = "behaviour"
DATASET = "dataset"
COURSE = "course"
TABLES = (TABLE, BEHAVIOUR, DATASET, COURSE)
"""Stems of the tables' files in the folder ``paper``."""
FIGURE = "regression.png"


@dataclass(frozen=True, slots=True)
class Reproduction:
    """What a reproduction leaves for people.

    Attributes:
        table: The paper's table beside ours, in Markdown.
        behaviour: How the planners drove, in Markdown.
        dataset: What they learned from, in Markdown.
        course: The paper's physical runs beside ours on the course, in Markdown.
        figure: Path of the regression plot.
    """

    table: str
    behaviour: str
    dataset: str
    course: str
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
    """Collect twice, train four policies, run the planners; tables and figure.

    The planners are the paper's five and those of `BESIDE`, the floor among them.

    Steps that are done already, with the same inputs, are skipped; an interrupted run
    of the planners goes on where it stopped, and policies that are finished stay.

    Args:
        out: Folder, made where it does not exist. It gets ``open-space-*.npz``, a
            policy per planner that learns, the runs in ``bench`` and ``course``, and
            tables and figure in ``paper``, each with a stamp.
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
    require_at_least(1, "jobs", jobs)
    worlds = load_suite(suite).indices[:: QUICK_STRIDE if quick else 1]
    steps: list[Step] = []
    logs: dict[str, Path] = {}
    policies: dict[str, Path] = {}
    if not quick:
        logs = {preset: out / f"open-space-{preset}.npz" for preset in PRESETS}
        policies = {planner: out / f"{planner}.npz" for planner in POLICIES}
        steps += [_collecting(preset, log) for preset, log in logs.items()]
        steps.append(_training(logs, policies, jobs))
    run = out / "bench"
    bench = Bench(
        planners=tuple(TITLES),
        suite=suite,
        worlds=",".join(map(str, worlds)) if quick else None,
        trials=TRIALS,
        seed=_SEED,
        policies=tuple(policies.items()),
    )
    episodes = len(worlds) * len(TITLES) * TRIALS
    steps.append(
        driving("bench", {run: bench}, jobs, episodes=episodes, title=lambda _: "runs")
    )
    on_course = out / COURSE
    steps.append(_driving_course(on_course, policies, jobs))
    paper = out / "paper"
    steps.append(_writing(paper, run, on_course, logs, policies))
    run_steps(steps, progress)
    table_md, behaviour_md, dataset_md, course_md = (
        (paper / f"{name}.md").read_text("utf-8")
        for name in (TABLE, BEHAVIOUR, DATASET, COURSE)
    )
    return Reproduction(table_md, behaviour_md, dataset_md, course_md, paper / FIGURE)


_SEED = 0
_ROBOT = "jackal"
# See `hlsd.core.progress` for the other nominal durations [s].
_PAPER_S = 5.0
# Five to six times as long on the clock as a world of BARN, and with a larger map.
_COURSE_RUN_S = 15 * RUN_S
_COURSE_SUITE = "course"


def _collecting(preset: str, log: Path) -> Step:
    return collecting(
        f"collect {preset}",
        log,
        preset=preset,
        law="matched",
        seed=_SEED,
        robot=get_robot(_ROBOT),
    )


def _training(
    logs: Mapping[str, Path], policies: Mapping[str, Path], jobs: int
) -> Step:
    trainings = {
        policy: Training(TRAINABLE[planner], logs[TRAINABLE[planner].preset], _SEED)
        for planner, policy in policies.items()
    }

    def keep(policy: Path, trained: Trained) -> None:
        timing = {"wall_s": round(trained.wall_s, 2), "at_once": trained.at_once}
        write_atomic(_training_time(policy), json.dumps(timing) + "\n")
        save(policy, trained)

    def title(missing: Sequence[Path]) -> str:
        return ", ".join(policy.stem for policy in missing)

    return training("train", trainings, jobs, title=title, keep=keep)


def _training_time(policy: Path) -> Path:
    """Wall times never repeat, so they are kept beside the policy, not in it."""
    return policy.with_suffix(".timing.json")


def _driving_course(out: Path, policies: Mapping[str, Path], jobs: int) -> Step:
    bench = Bench(
        planners=tuple(PUBLISHED),
        suite=_COURSE_SUITE,
        trials=COURSE_TRIALS,
        seed=_SEED,
        policies=tuple(policies.items()),
    )
    episodes = len(PUBLISHED) * COURSE_TRIALS
    return driving(
        COURSE,
        {out: bench},
        jobs,
        episodes=episodes,
        title=lambda _: "runs",
        run_s=_COURSE_RUN_S,
    )


def _writing(
    paper: Path,
    run: Path,
    on_course: Path,
    logs: Mapping[str, Path],
    policies: Mapping[str, Path],
) -> Step:
    """The step that writes tables and figure."""

    def inputs() -> Inputs:
        learning = _learning(logs, policies)
        return {
            "episodes_sha256": sha256_of_file(run / EPISODES),
            "timing_sha256": sha256_of_file(run / TIMING),
            "course_sha256": sha256_of_file(on_course / EPISODES),
            "learning": {planner: asdict(facts) for planner, facts in learning.items()},
        }

    def make(_missing: Sequence[Path], tell: TellStage) -> None:
        _write(paper, run, on_course, _learning(logs, policies))
        tell("tables and figure", 1, 1)

    return Step(
        name="paper",
        outputs={paper: inputs},
        make=make,
        code=_write,
        packages=(),
        nominal_s=_PAPER_S,
        last=FIGURE,
    )


def _write(
    paper: Path, run: Path, on_course: Path, learning: Mapping[str, Learning]
) -> None:
    paper.mkdir(exist_ok=True)
    episodes = load_episodes(run)
    table, drove = table_one(episodes, planning_times(run)), behaviour(episodes)
    learned, course = Dataset(learning), course_table(load_episodes(on_course))
    for name, text in (
        (f"{TABLE}.md", table.markdown()),
        (f"{TABLE}.tex", table.latex()),
        (f"{TABLE}.csv", table.csv()),
        (f"{BEHAVIOUR}.md", drove.markdown()),
        (f"{BEHAVIOUR}.csv", drove.csv()),
        (f"{DATASET}.md", learned.markdown()),
        (f"{DATASET}.csv", learned.csv()),
        (f"{COURSE}.md", course.markdown()),
        (f"{COURSE}.csv", course.csv()),
    ):
        write_atomic(paper / name, text)
    plot_regression(episodes, paper / FIGURE)


def _training_set(file: Path, planner: str) -> dict[str, int]:
    """What a policy says of the data that it learned from."""
    said = parse_json(Policy.load(file, planner).provenance, "provenance", finite=False)
    facts = said.get("training_set") if isinstance(said, dict) else None
    if not isinstance(facts, dict) or not all(
        type(facts.get(name)) is int for name in ("points", "samples")
    ):
        raise HlsdError(f"{shown(file)} does not say what it was trained on")
    return {name: facts[name] for name in ("points", "samples")}


def _learning(
    logs: Mapping[str, Path], policies: Mapping[str, Path]
) -> dict[str, Learning]:
    """What each policy's provenance, log and timing file say of its training."""
    learning = {}
    for planner in POLICIES:
        file = policies[planner] if planner in policies else shipped_policy(planner)
        facts = _training_set(file, planner)
        timing = _training_time(file)
        training_s, driven_s = None, None
        if timing.exists():
            wall_s = read_json(timing, "record of a training").get("wall_s")
            training_s = float(wall_s) if isinstance(wall_s, int | float) else None
        preset = TRAINABLE[planner].preset
        if preset in logs:
            log = MotionLog.load(logs[preset])
            driven_s = (len(log.poses) - 1) * log.period_s
        learning[planner] = Learning(
            preset, facts["points"], facts["samples"], driven_s, training_s
        )
    return learning
