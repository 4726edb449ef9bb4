"""The whole experiment of the paper in one call: data, policies, runs, table, figure.

Each step leaves its output and beside it a stamp, a small JSON file with what the
output was made from. A step whose output is there with the same stamp is skipped; one
whose output was made from something else is refused, so that no folder ever mixes two
experiments.
"""

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from hlsd.bench import Bench, resolve, run_bench, software_versions
from hlsd.collect import collect
from hlsd.data.motion_log import MotionLog
from hlsd.data.worlds import load_suite
from hlsd.errors import HlsdError
from hlsd.files import write_atomic
from hlsd.paper import PUBLISHED, load_timing, plot_regression, table_one
from hlsd.report import load_episodes
from hlsd.results import EPISODES
from hlsd.sim.robot import get_robot
from hlsd.train import TRAINABLE, train

Progress = Callable[[str, int, int], None]
"""Called now and then with what is done, steps done, steps in all."""

TRIALS = 3
"""Runs per world (section IV-B)."""
QUICK_STRIDE = 6
"""Of the worlds, a quick reproduction takes each so many-th one."""
PRESETS = ("1.0", "0.4")
"""The two data sets of the paper (section IV-A)."""
POLICIES = ("hlsd10", "lfh10", "hlsd04", "lfh04")
"""The planners that learn."""
TABLE = "table1"
FIGURE = "regression.png"


@dataclass(frozen=True, slots=True)
class Reproduction:
    """What a reproduction leaves for people.

    Attributes:
        table: The paper's table beside ours, in Markdown.
        figure: Path of the regression plot.
    """

    table: str
    figure: Path


def default_folder(quick: bool, suite: str) -> Path:
    """Where a reproduction goes if nobody says: a folder under ``runs/``."""
    kind = "reproduce-quick" if quick else "reproduce"
    return Path("runs") / f"{kind}-{load_suite(suite).name}"


def reproduce(
    out: Path, quick: bool, suite: str, jobs: int, progress: Progress | None = None
) -> Reproduction:
    """Collect twice, train four policies, run five planners; table and figure.

    Steps that are done already, with the same inputs, are skipped; an interrupted run
    of the planners goes on where it stopped.

    Args:
        out: Folder, made where it does not exist. It gets ``open-space-*.npz``, a
            policy per planner that learns, the run in ``bench`` and table and figure
            in ``paper``, each with a stamp.
        quick: Take the shipped policies and every sixth world.
        suite: A suite's name or folder.
        jobs: Worker processes.
        progress: Told of every step.

    Raises:
        HlsdError: Bad settings, or an output in ``out`` that was made from other
            inputs; it is left as it is.
    """
    if jobs < 1:
        raise HlsdError(f"--jobs is {jobs}: at least 1 is needed")
    indices = load_suite(suite).indices
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise HlsdError(
            f"cannot write to output folder {str(out)!r}: {error.strerror}"
        ) from error
    steps = _Steps(
        2 if quick else 2 + len(PRESETS) + len(POLICIES),
        progress if progress is not None else _silent,
    )
    policies: tuple[tuple[str, Path], ...] = ()
    if not quick:
        logs = {preset: _collect(out, preset, steps) for preset in PRESETS}
        policies = tuple((name, _train(out, name, logs, steps)) for name in POLICIES)
    bench = Bench(
        planners=tuple(PUBLISHED),
        suite=suite,
        worlds=",".join(map(str, indices[::QUICK_STRIDE])) if quick else None,
        trials=TRIALS,
        seed=_SEED,
        policies=policies,
    )
    return _paper(out, _bench(out, bench, jobs, steps), steps)


_SEED = 0
_ROBOT = "jackal"


class _Steps:
    """Runs steps that are not done yet, and numbers them for progress."""

    def __init__(self, total: int, progress: Progress) -> None:
        self._number, self._total, self._progress = 0, total, progress

    def run(
        self,
        name: str,
        output: Path,
        done: Path,
        inputs: Mapping[str, object],
        work: Callable[[Progress], object],
    ) -> None:
        """Do a step unless its output is there.

        Args:
            name: In words.
            output: File or folder that the step makes; its stamp is beside it.
            done: The file that is there once the step is complete.
            inputs: Everything that decides the output.
            work: Does it; where ``output`` is there but not ``done``, it goes on.

        Raises:
            HlsdError: The output was made from other inputs.
        """
        self._number += 1
        title = f"[{self._number}/{self._total}] {name}"
        stamp = output.with_name(f"{output.name}.json")
        plain: dict[str, object] = json.loads(json.dumps(dict(inputs)))
        if output.exists():
            _check_stamp(output, stamp, plain)
        else:
            # Before the output, so that no crash leaves an output without a stamp.
            write_atomic(stamp, json.dumps(plain, indent=2) + "\n")
        if done.exists():
            self._progress(f"{title}, there already", 1, 1)
            return
        work(lambda what, k, n: self._progress(f"{title}: {what}", k, n))


def _silent(_what: str, _done: int, _total: int) -> None:
    pass


def _check_stamp(output: Path, stamp: Path, inputs: Mapping[str, object]) -> None:
    try:
        held = json.loads(stamp.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        held = None
    if not isinstance(held, dict):
        raise HlsdError(
            f"{str(output)!r} is there, but not its stamp {stamp.name!r}: move it "
            "away, or choose another --out"
        )
    for key in {**inputs, **held}:
        if held.get(key) != inputs.get(key):
            raise HlsdError(
                f"{str(output)!r} was made from other inputs ({key} "
                f"{_short(held.get(key))}, now {_short(inputs.get(key))}): move it "
                "away, or choose another --out"
            )


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."


def _collect(out: Path, preset: str, steps: _Steps) -> Path:
    robot = get_robot(_ROBOT)
    output = out / f"open-space-{preset}.npz"
    inputs = {
        "preset": preset,
        "law": "matched",
        "seed": _SEED,
        "robot": robot.name,
        "robot_version": robot.version,
        **_software("hlsd", "mujoco", "numpy"),
    }

    def work(progress: Progress) -> None:
        collect(preset, "matched", _SEED, robot, progress).save(output)

    steps.run(f"collect {preset}", output, output, inputs, work)
    return output


def _train(out: Path, planner: str, logs: Mapping[str, Path], steps: _Steps) -> Path:
    log = logs[TRAINABLE[planner].preset]
    output = out / f"{planner}.npz"
    inputs = {
        "recipe": asdict(TRAINABLE[planner]),
        "seed": _SEED,
        "motion_log_sha256": _sha256(log),
        **_software("hlsd", "numpy", "torch"),
    }

    def work(progress: Progress) -> None:
        train(planner, MotionLog.load(log), _SEED, progress).save(output)

    steps.run(f"train {planner}", output, output, inputs, work)
    return output


def _bench(out: Path, bench: Bench, jobs: int, steps: _Steps) -> Path:
    output = out / "bench"
    inputs = {**asdict(resolve(bench)), **_software("hlsd", "mujoco", "numpy", "numba")}

    def work(progress: Progress) -> None:
        run_bench(bench, output, jobs, lambda k, n, _: progress("episodes", k, n))

    steps.run("bench", output, output / EPISODES, inputs, work)
    return output


def _paper(out: Path, run: Path, steps: _Steps) -> Reproduction:
    output = out / "paper"
    inputs = {
        "episodes_sha256": _sha256(run / EPISODES),
        "timing_sha256": _sha256(run / "timing.csv"),
        **_software("hlsd"),
    }

    def work(progress: Progress) -> None:
        output.mkdir(exist_ok=True)
        episodes = load_episodes(run)
        table = table_one(episodes, load_timing(run))
        write_atomic(output / f"{TABLE}.md", table.markdown())
        write_atomic(output / f"{TABLE}.tex", table.latex())
        write_atomic(output / f"{TABLE}.csv", table.csv())
        plot_regression(episodes, output / FIGURE)
        progress("written", 1, 1)

    steps.run("table and figure", output, output / FIGURE, inputs, work)
    table = (output / f"{TABLE}.md").read_text(encoding="utf-8")
    return Reproduction(table, output / FIGURE)


def _software(*names: str) -> dict[str, str]:
    known = software_versions()
    return {name: known.get(name) or _version(name) for name in names}


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "absent"


def _sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
