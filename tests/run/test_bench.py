"""Runs as a whole: same rows for any workers, order and interruption."""

import csv
import json
import subprocess
import sys
from dataclasses import replace
from hashlib import sha256

import pytest

import hlsd.run.work as work_module
from hlsd.analysis.runs import load_episodes, load_run
from hlsd.analysis.summary import summarise
from hlsd.core.errors import HlsdError
from hlsd.core.executor import Serial
from hlsd.learning.policy import shipped_policy
from hlsd.planners.base import Command
from hlsd.planners.registry import AT_HAND
from hlsd.report.summary import write_summary
from hlsd.run.bench import Bench, resolve, run_bench
from hlsd.run.protocol import COURSE, HLSD2021
from hlsd.run.work import tasks_of
from hlsd.sim.robots import get_robot
from tests.data.small_course import store_small_course

PLANNER = "examples.follow_path:FollowPath"
SETTINGS = Bench((PLANNER,), worlds="0,150", trials=2)


def rows_without_wall(folder):
    with (folder / "episodes.csv").open(newline="") as file:
        return [
            {name: value for name, value in row.items() if name != "wall_s"}
            for row in csv.DictReader(file)
        ]


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    return run_bench(SETTINGS, tmp_path_factory.mktemp("bench") / "one", jobs=Serial())


def test_rows_name_everything_that_a_result_depends_on(reference):
    rows = rows_without_wall(reference)
    assert [(row["world"], row["trial"]) for row in rows] == [
        ("0", "0"),
        ("0", "1"),
        ("150", "0"),
        ("150", "1"),
    ]
    for row in rows:
        assert row["suite"] == "barn300"
        assert row["planner"] == PLANNER
        assert row["robot"] == "jackal"
        assert row["robot_version"]
        assert row["protocol"] == "hlsd2021"
        assert row["outcome"] in {"success", "timeout"}
        assert int(row["sim_steps"]) * 0.005 == pytest.approx(float(row["sim_time_s"]))


def test_the_trials_on_a_course_are_shared_by_workers(tmp_path):
    """A course is one world, whose runs would else be one process's."""
    suite = store_small_course(tmp_path / "short")
    bench = Bench((PLANNER,), str(suite), trials=2)
    alone = run_bench(bench, tmp_path / "alone", jobs=Serial())
    tasks = list(tasks_of(resolve(bench), frozenset()))
    assert [task.runs for task in tasks] == [((PLANNER, 0),), ((PLANNER, 1),)]
    shared = run_bench(bench, tmp_path / "shared", jobs=2)
    rows = rows_without_wall(alone)
    assert rows == rows_without_wall(shared)
    for row in rows:
        assert (row["protocol"], row["outcome"]) == ("course", "success")
        assert float(row["path_length_m"]) > float(row["shortest_length_m"]) - 0.05
    assert load_run(alone).conditions.protocol == COURSE


@pytest.mark.parametrize("jobs", [1, 2])
def test_rows_do_not_depend_on_the_number_of_workers(reference, tmp_path, jobs):
    """Nor on whether there are any."""
    again = run_bench(SETTINGS, tmp_path / "again", jobs)
    assert rows_without_wall(again) == rows_without_wall(reference)


def test_rows_do_not_depend_on_what_else_is_run(reference, tmp_path):
    alone = run_bench(
        Bench((PLANNER,), worlds="150", trials=2), tmp_path / "alone", jobs=Serial()
    )
    assert rows_without_wall(alone) == rows_without_wall(reference)[2:]


def test_an_interrupted_run_goes_on_and_ends_the_same(reference, tmp_path, monkeypatch):
    folder = tmp_path / "cut"
    real = work_module.run_episode
    calls = []

    def interrupted(course, planner, seed, trial):
        calls.append((course.world.index, trial))
        if len(calls) == 4:
            raise KeyboardInterrupt
        return real(course, planner, seed, trial)

    monkeypatch.setattr(work_module, "run_episode", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run_bench(SETTINGS, folder, jobs=Serial())
    assert not (folder / "episodes.csv").exists(), "no half table"
    journal = folder / "journal.jsonl"
    journal.write_text(journal.read_text() + "barn300,1,150,torn li")
    calls.clear()
    run_bench(SETTINGS, folder, jobs=Serial())
    assert calls == [(150, 0), (150, 1)], "finished worlds are not run again"
    assert rows_without_wall(folder) == rows_without_wall(reference)
    assert not journal.exists()


def test_other_settings_cannot_go_on_in_an_interrupted_folder(tmp_path, monkeypatch):
    folder = tmp_path / "cut"

    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(work_module, "run_episode", interrupted)
    with pytest.raises(KeyboardInterrupt):
        run_bench(SETTINGS, folder, jobs=Serial())
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    with pytest.raises(HlsdError, match=r"seed 0, now 1"):
        run_bench(
            Bench((PLANNER,), worlds="0,150", trials=2, seed=1), folder, jobs=Serial()
        )
    assert before == {path.name: path.read_bytes() for path in folder.iterdir()}


def test_lines_that_are_no_records_of_this_run_do_not_count(
    reference, tmp_path, monkeypatch, capfd
):
    """Whatever they are, their episodes are driven, and one line says so."""
    folder = tmp_path / "cut"

    def interrupted(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(work_module, "run_episode", interrupted)
        with pytest.raises(KeyboardInterrupt):
            run_bench(SETTINGS, folder, jobs=Serial())
    (folder / "journal.jsonl").write_bytes(f"barn300,1,0,{PLANNER}\n\xff\n".encode())
    capfd.readouterr()
    run_bench(SETTINGS, folder, jobs=Serial())
    assert rows_without_wall(folder) == rows_without_wall(reference)
    (line,) = capfd.readouterr().err.splitlines()
    assert "2 records of the journal torn, damaged or missing" in line


def test_a_table_without_official_lengths_is_read(reference, tmp_path):
    lines = (reference / "episodes.csv").read_text(encoding="utf-8").splitlines()
    rows = [line.split(",") for line in lines]
    gone = rows[0].index("official_length_m")
    assert {row[gone] for row in rows[1:]} == {""}, "not defined under hlsd2021"
    old = tmp_path / "episodes.csv"
    old.write_text("\n".join(",".join(r[:gone] + r[gone + 1 :]) for r in rows) + "\n")
    now, before = load_episodes(reference), load_episodes(old)
    assert summarise(now).equals(summarise(before))
    old.write_text("\n".join([*lines, ""]).replace("protocol", "rules", 1))
    with pytest.raises(HlsdError, match="lacks 'protocol'"):
        load_episodes(old)


def test_each_planner_drives_from_the_policy_that_is_named_for_it(tmp_path):
    planners = ("dwa", "hlsd10", "hlsd04")
    renamed = tmp_path / "mine.npz"
    renamed.write_bytes(shipped_policy("hlsd04").read_bytes())
    settings = Bench(planners, worlds="0", policies=(("hlsd04", renamed),))
    assert resolve(settings) == resolve(Bench(planners, worlds="0"))
    assert settings.policy("hlsd04") == renamed
    assert settings.policy("hlsd10") is settings.policy("dwa") is None
    none, ten, four = resolve(settings).policy_sha256
    assert none == ""
    assert ten == sha256(shipped_policy("hlsd10").read_bytes()).hexdigest()
    assert four == sha256(renamed.read_bytes()).hexdigest()
    for policies, message in (
        ((("lfh10", renamed),), "'lfh10', which is not run"),
        ((("dwa", renamed),), "'dwa' takes no policy"),
        ((("hlsd04", renamed), ("hlsd04", renamed)), "two policies"),
    ):
        with pytest.raises(HlsdError, match=message):
            resolve(Bench(planners, worlds="0", policies=policies))


COUNTS_RESETS = """
from hlsd.planners.base import Command

class Planner:
    period_s = 0.05
    resets = 0

    def reset(self, setup):
        self.resets += 1

    def plan(self, observation):
        raise ValueError(f"reset {self.resets} times")
"""


def test_a_planner_is_warmed_up_unseen(tmp_path, monkeypatch):
    """It fails in its episodes only, and has not been reset before the first one."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "counts_resets.py").write_text(COUNTS_RESETS)
    bench = Bench(("counts_resets:Planner",), worlds="0", trials=2)
    rows = rows_without_wall(run_bench(bench, tmp_path / "run", jobs=Serial()))
    assert [(row["outcome"], row["reason"]) for row in rows] == [
        ("error", "exception: ValueError: reset 1 times (counts_resets.py:12)"),
        ("error", "exception: ValueError: reset 2 times (counts_resets.py:12)"),
    ]


LISTS_NEW_KERNELS = """
import sys
from numba.core.dispatcher import Dispatcher
from hlsd.run import drivers
from hlsd.data.worlds import load_suite
from hlsd.run.episode import Course, run_episode
from hlsd.run.protocol import HLSD2021
from hlsd.sim.robots import get_robot

def loaded():
    return {
        (module, name, signature)
        for module in list(sys.modules)
        if module.startswith("hlsd.planners") or module.startswith("hlsd.data")
        for name, value in vars(sys.modules[module]).items()
        if isinstance(value, Dispatcher)
        for signature in map(str, value.signatures)
    }

course = Course(load_suite("barn300")[150], get_robot("jackal"), HLSD2021)
for name in sys.argv[1:]:
    planner = drivers.Drivers([drivers.driver(name)]).warmed_up(name)
    before = loaded()
    run_episode(course, planner, seed=0, trial=0)
    print(name, len(before) > 10, sorted(loaded() - before))
"""


def test_no_kernel_is_loaded_while_planning_is_timed():
    """In a process of its own, since kernels are loaded once."""
    result = subprocess.run(
        [sys.executable, "-c", LISTS_NEW_KERNELS, *AT_HAND],
        capture_output=True,
        text=True,
        timeout=300,
        check=True,
    )
    lines = result.stdout.splitlines()
    assert lines == [f"{name} True []" for name in AT_HAND]


def planner_of_speed(speed):
    """A class of one name whatever it does."""

    class Edited:
        period_s = 0.05

        def reset(self, setup):
            pass

        def plan(self, observation):
            return Command(speed, 0.0)

    return Edited


def test_an_edited_class_is_another_planner():
    before, same, after = (
        resolve(Bench((planner_of_speed(speed),), worlds="0")) for speed in (1, 1, 2)
    )
    assert before.planners == after.planners == ("Edited",)
    assert before == same
    assert before != after


def test_a_changed_robot_of_the_same_name_is_another():
    jackal = get_robot("jackal")
    softer = replace(jackal, drive=replace(jackal.drive, servo_gain=10.0))
    held, changed = (
        resolve(Bench(("dwa",), worlds="0", robot=robot)) for robot in (jackal, softer)
    )
    assert held == resolve(Bench(("dwa",), worlds="0"))
    assert held != changed


def test_a_finished_folder_is_not_touched(reference):
    before = (reference / "episodes.csv").read_bytes()
    with pytest.raises(HlsdError, match="already holds a finished run"):
        run_bench(SETTINGS, reference, jobs=Serial())
    assert (reference / "episodes.csv").read_bytes() == before


def test_default_folders_are_numbered(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.delitem(sys.modules, "mine", raising=False)  # of another test
    (tmp_path / "mine.py").write_text(
        "from hlsd.planners.base import Command\n"
        "class Mine:\n"
        "    period_s = 0.05\n"
        "    def reset(self, setup): pass\n"
        "    def plan(self, observation): raise ValueError('no idea')\n"
    )
    settings = Bench(("mine:Mine",), worlds="0", trials=1)
    first, second = (run_bench(settings, None, jobs=Serial()) for _ in range(2))
    assert first.name == "mine_Mine-barn300-hlsd2021-1-of-300-worlds"
    assert second.name == f"{first.name}-2"
    row = rows_without_wall(first)[0]
    assert (row["outcome"], row["reason"]) == (
        "error",
        "exception: ValueError: no idea (mine.py:5)",
    )
    text = write_summary(first)
    assert "1 runs ended in a planner's error" in text


def test_manifest_holds_configuration_and_versions(reference):
    manifest = json.loads((reference / "run.json").read_text())
    config = manifest["config"]
    assert config["worlds"] == [0, 150]
    conditions = config["conditions"]
    assert conditions["suite"]["name"] == "barn300"
    assert conditions["suite"]["digest"]
    assert conditions["protocol"] == HLSD2021.as_json(), "whole, not by name"
    robot = get_robot("jackal")
    held = {"name": "jackal", "version": "1.0", "sha256": robot.sha256}
    assert conditions["robot"] == held
    assert (conditions["seed"], conditions["perturbations"]) == (0, [])
    assert manifest["versions"]["mujoco"].startswith("4.")


def test_summary_counts_failures_at_the_limit(reference):
    episodes = load_episodes(reference)
    episodes.loc[0, ["outcome", "time_s", "contacts"]] = ["timeout", 50.0, 2]
    episodes.loc[1:, ["outcome", "time_s", "contacts"]] = ["success", 10.0, 0]
    row = summarise(episodes).iloc[0]
    assert row["n"] == 4
    assert row["success"] == 0.75
    assert row["mean_time_s"] == 20.0
    assert row["sd_time_s"] == pytest.approx(20.0)
    assert row["mean_success_time_s"] == 10.0
    assert row["contact_free"] == 0.75
    # Two worlds, runs (50, 10) and (10, 10). Resampled, then runs within worlds: the
    # mean is 50 in 1 of 64 cases, less than 2.5 %, and 40 or more in 5 of 64.
    assert (row["mean_time_low_s"], row["mean_time_high_s"]) == (10.0, 40.0)


def test_summary_and_plot_are_written_beside_the_rows(reference):
    text = write_summary(reference)
    assert PLANNER in text
    assert (reference / "summary.md").read_text() == text
    assert (reference / "summary.csv").read_text().startswith("planner,n,drove,success")
    assert (reference / "time_by_world.png").read_bytes()[:4] == b"\x89PNG"
