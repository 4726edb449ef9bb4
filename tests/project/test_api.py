"""The Python API: quick to import, the same rows as the command line, clear errors."""

import csv
import os
import subprocess
import sys
import time
from pathlib import Path

import pytest

import hlsd
from hlsd.run.protocol import HLSD2021

ROOT = Path(__file__).resolve().parents[2]


class Mine:
    """Drives at the local goal."""

    period_s = 0.05

    def __init__(self, top_speed=0.5):
        self.top_speed = top_speed

    def reset(self, setup):
        pass

    def plan(self, observation):
        _, y = observation.local_goal_in_base
        return hlsd.Command(self.top_speed, 2.0 * y)


class Unmakeable(Mine):
    def __init__(self):
        self.share = 1 / 0


def rows(run):
    with (run.path / "episodes.csv").open(newline="", encoding="utf-8") as file:
        return [
            {name: value for name, value in row.items() if name != "wall_s"}
            for row in csv.DictReader(file)
        ]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    out = tmp_path_factory.mktemp("api") / "run"
    return hlsd.bench(
        {"slow": Mine(0.4), "fast": Mine(0.7)},
        worlds=[0, 150],
        trials=1,
        jobs=1,
        out=out,
        progress=False,
    )


def test_the_import_is_quick_and_loads_nothing_heavy():
    """In CPU time: the least of several, since others use the machine, too."""
    probe = (
        "import sys, time; began = time.process_time(); import hlsd; "
        "took = time.process_time() - began; "
        "heavy = {'numpy', 'pandas', 'mujoco', 'numba', 'matplotlib', 'typer'}; "
        "print(took, sorted(heavy & set(sys.modules)))"
    )
    found = [
        subprocess.run(
            [sys.executable, "-c", probe],
            cwd=ROOT,
            capture_output=True,
            text=True,
            check=True,
        ).stdout.split(maxsplit=1)
        for _ in range(5)
    ]
    assert min(float(took) for took, _ in found) < 0.1
    assert {heavy.strip() for _, heavy in found} == {"[]"}


def test_all_that_it_names_is_there():
    for name in dir(hlsd):
        assert getattr(hlsd, name) is not None
    with pytest.raises(AttributeError, match="'fly'"):
        _ = hlsd.fly


def test_objects_drive_under_names_of_ones_own(run):
    assert run.planners == ["slow", "fast"]
    assert run.worlds == [0, 150]
    assert set(run.episodes["outcome"]) <= {"success", "timeout"}
    assert run.conditions.protocol.name == "hlsd2021"
    for name in ("run.json", "summary.md", "time_by_world.png", "trajectories.zip"):
        assert (run.path / name).exists()


def test_any_number_of_jobs_and_an_executor_of_ones_own_give_the_same_rows(
    run, tmp_path
):
    class Backwards:
        """The last task first."""

        def run(self, function, tasks, *, told=None):
            for number in reversed(range(len(tasks))):
                yield number, function(tasks[number])

    mine = {"slow": Mine(0.4), "fast": Mine(0.7)}
    for name, jobs in (("two", 2), ("own", Backwards())):
        again = hlsd.bench(
            mine,
            worlds="0,150",
            trials=1,
            jobs=jobs,
            out=tmp_path / name,
            progress=False,
        )
        assert rows(again) == rows(run)
        kept = [folder / "trajectories.zip" for folder in (again.path, run.path)]
        assert kept[0].read_bytes() == kept[1].read_bytes()


NOTEBOOK = """
import hlsd

class Cell:
    period_s = 0.05
    def reset(self, setup): pass
    def plan(self, observation):
        return hlsd.Command(0.5, 2.0 * observation.local_goal_in_base[1])

run = hlsd.bench(Cell, worlds=[0, 30], trials=1, jobs=2, out="run", progress=False)
print(run.planners, sorted(set(run.episodes["outcome"])))
"""


def test_a_class_of_a_notebook_drives_in_workers(tmp_path):
    """Of a script's main module, which no worker can import, without a guard."""
    (tmp_path / "notebook.py").write_text(NOTEBOOK)
    done = subprocess.run(
        [sys.executable, "notebook.py"],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=200,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("['Cell'] ['success'"), done.stdout


def test_a_run_shows_itself(run):
    assert repr(run).startswith(f"Run({str(run.path)!r}: slow, fast; 4 episodes in 2 ")
    page = run._repr_html_()
    assert "<table" in page
    assert "slow" in page
    again = hlsd.load_run(run.path)
    assert again.episodes.equals(run.episodes)
    assert list(run.summary()["planner"]) == ["slow", "fast"]


def test_trajectories_are_found_and_missing_ones_named(run):
    poses = run.trajectory(150, "fast").poses
    assert poses.shape[1] == 3
    assert len(poses) == run.episodes["ticks"].iloc[3] + 1
    for arguments, message in (
        ((0,), "holds slow, fast: name one"),
        ((0, "fsat"), "did you mean 'fast'"),
        ((1, "fast"), "no trajectory of fast, world 1"),
    ):
        with pytest.raises(hlsd.HlsdError, match=message):
            run.trajectory(*arguments)


def test_one_episode_is_the_bench_s(run):
    episode = hlsd.episode(Mine(0.7), world=150)
    row = rows(run)[3]
    assert (row["planner"], row["world"]) == ("fast", "150")
    assert row["outcome"] == episode.outcome.value
    assert row["time_s"] == f"{episode.time_s:.4f}"
    assert row["path_length_m"] == f"{episode.path_length_m:.4f}"


def test_a_session_is_opened_by_names(run):
    session = hlsd.open_session(world=150)
    observation = session.reset(trial=0)
    planner = Mine(0.7)
    planner.reset(None)
    while session.outcome is None:
        observation = session.step(planner.plan(observation))
    assert session.outcome.value == rows(run)[3]["outcome"]


def test_what_is_registered_drives_in_workers_too(tmp_path):
    hlsd.register("planners", "registered-one", Mine)
    try:
        names = {entry.name for entry in hlsd.list_things("planners")}
        assert {"dwa", "registered-one"} <= names
        run = hlsd.bench(
            "registered-one",
            worlds=[0, 30],
            trials=1,
            jobs=2,
            out=tmp_path / "run",
            progress=False,
        )
        assert set(run.episodes["outcome"]) <= {"success", "timeout"}
    finally:
        hlsd.forget("planners", "registered-one")


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: hlsd.bench("hlsd11"), "did you mean 'hlsd10'"),
        (lambda: hlsd.bench(3), "int is not a planner"),
        (lambda: hlsd.bench("dwa", trials=0), "^trials is 0: at least 1"),
        (lambda: hlsd.bench("dwa", jobs=0), "^jobs is 0: at least 1"),
        (lambda: hlsd.bench("dwa", worlds=[999]), "has no world 999"),
        (lambda: hlsd.bench("dwa", protocol="x"), "unknown protocol"),
        (lambda: hlsd.bench("dwa", perturbations={"x": 1}), "unknown perturbation"),
        (lambda: hlsd.bench(["dwa", "dwa"]), "named twice"),
        (lambda: hlsd.bench([]), "no planner"),
        (lambda: hlsd.bench("dwa", jobs="2"), "jobs is '2': a whole number"),
        (lambda: hlsd.bench("dwa", trials=1.5), "trials is 1.5: a whole number"),
        (lambda: hlsd.bench("dwa", seed=None), "seed is None: a whole number"),
        (lambda: hlsd.bench("dwa", robot=3), "int is not a robot"),
        (lambda: hlsd.bench("dwa", protocol=3), "int is not a protocol"),
        (lambda: hlsd.bench("dwa", worlds=[0.5]), r"cannot read worlds \[0.5\]"),
        (lambda: hlsd.bench("dwa", perturbations={"x.y": "z"}), "give name=size"),
        (lambda: hlsd.bench(Unmakeable), "cannot be made: ZeroDivisionError"),
        (lambda: hlsd.episode("dwa", seed=-1), "^seed is -1"),
        (lambda: hlsd.write_report([]), "no run is given"),
        (lambda: hlsd.compare("x", "x", metrics=[]), "no metric is named"),
        (lambda: hlsd.register("metrics", "success", 3), "exists already"),
        (lambda: hlsd.register("metrics", "three", 3), "neither a Metric nor a Field"),
        (lambda: hlsd.register("robots", "x", hlsd.load_suite), "not hlsd.RobotDesc"),
        (lambda: hlsd.register("protocols", "x", HLSD2021), "calls itself 'hlsd2021'"),
        (lambda: hlsd.episode(dict), "dict, which has no period_s"),
        (lambda: hlsd.list_things("planner"), "did you mean 'planners'"),
        (lambda: hlsd.load_run("nowhere"), "'nowhere'"),
        (lambda: hlsd.compare("nowhere", "nowhere"), "no run at 'nowhere'"),
    ],
)
def test_bad_arguments_are_one_clear_line_and_write_nothing(
    call, message, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(hlsd.HlsdError, match=message) as error:
        call()
    assert "\n" not in str(error.value)
    assert "--" not in str(error.value), "options are the command line's"
    assert list(tmp_path.iterdir()) == []


def test_progress_is_said_unless_asked_not_to(tmp_path, capsys):
    began = time.monotonic()
    arguments = {"worlds": 0, "trials": 1, "jobs": 1}
    hlsd.bench(Mine, **arguments, out=tmp_path / "a", progress=False)
    assert capsys.readouterr().err == ""
    hlsd.bench(Mine, **arguments, out=tmp_path / "b")
    assert "1/1 episodes" in capsys.readouterr().err
    assert time.monotonic() - began < 120
