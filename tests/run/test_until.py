"""Runs that stop when they have decided: the same for any workers and interruption."""

import csv
import json
import shutil
from dataclasses import dataclass, replace

import pytest

from hlsd.analysis.decided import compare_until_decided
from hlsd.analysis.runs import load_run
from hlsd.analysis.until_decided import stopping
from hlsd.core.errors import HlsdError
from hlsd.core.executor import Serial
from hlsd.run.bench import Bench, resolve, run_bench
from hlsd.run.journal import JOURNAL
from hlsd.run.seal import seal
from tests.run.saboteur import PLANNER, REMEMBERS, Remembers, summary

SETTINGS = Bench(
    ("pursuit", PLANNER), worlds="0:300:25", trials=1, until=stopping("success")
)
ORDER = [225, 25, 250, 125, 75, 0, 275, 50, 150, 175, 200, 100]
"""It stays as it is: an interrupted run goes on by it."""
COUNT = 6
"""Pursuit reaches the goal in all of them, the other in none."""


def drive(folder, executor=REMEMBERS, settings=SETTINGS):
    return run_bench(settings, folder, executor, conclude=summary)


def made(folder):
    """What must be the same to the byte: all but wall times and history."""
    with (folder / "episodes.csv").open(newline="") as file:
        rows = [{**row, "wall_s": ""} for row in csv.DictReader(file)]
    names = ("run.json", "trajectories.zip", "tracebacks.txt", "summary.md")
    assert not (folder / JOURNAL).exists()
    return rows, *((folder / name).read_bytes() for name in names)


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    return drive(tmp_path_factory.mktemp("until") / "run")


@dataclass(frozen=True)
class Backwards(Remembers):
    """As many workers may: what comes last is done first."""

    def run(self, function, tasks, *, told=None):
        for number in reversed(range(len(tasks))):
            ((_, done),) = REMEMBERS.run(function, [tasks[number]], told=told)
            yield number, done


@dataclass(frozen=True)
class Interrupted(Remembers):
    """Ends after so many tasks."""

    after: int = 0
    executor: Serial = REMEMBERS

    def run(self, function, tasks, *, told=None):
        for n, ended in enumerate(self.executor.run(function, tasks, told=told)):
            if n == self.after:
                raise KeyboardInterrupt
            yield ended


def test_it_holds_the_worlds_until_the_decision_and_no_others(driven):
    order = json.loads((driven / "run.json").read_text())["config"]["until_decided"]
    assert order["order"] == ORDER
    run = load_run(driven)
    assert run.worlds == sorted(ORDER[:COUNT])
    assert len(run.episodes) == 2 * COUNT
    told = json.loads((driven / "run.json").read_text())["until_decided"]
    assert told == {"worlds": COUNT, "verdict": "better"}


def test_comparing_what_it_drove_says_the_same(driven):
    found = compare_until_decided(f"{driven}:pursuit", f"{driven}:{PLANNER}", "success")
    (decision,) = found.judged
    assert (decision.verdict, decision.worlds) == ("better", tuple(ORDER[:COUNT]))
    # By the other metric, too: the sequence holds whenever one stops.
    found = compare_until_decided(f"{driven}:pursuit", f"{driven}:{PLANNER}", "time_s")
    assert len(found.judged[0].worlds) <= COUNT


def test_any_order_of_execution_gives_the_same_bytes(driven, tmp_path):
    assert made(drive(tmp_path / "run", Backwards())) == made(driven)


@pytest.mark.parametrize("after", [0, 1, COUNT - 1, COUNT, 7])
@pytest.mark.parametrize("way", [REMEMBERS, Backwards()], ids=["forwards", "backwards"])
def test_an_interrupted_run_ends_with_the_same_bytes(driven, tmp_path, after, way):
    """Rows of worlds beyond the decision may be there already."""
    folder = tmp_path / "run"
    try:
        drive(folder, Interrupted(after=after, executor=way))
    except KeyboardInterrupt:
        assert "until_decided" not in json.loads((folder / "run.json").read_text())
        drive(folder)
    else:
        assert way is REMEMBERS
        assert after >= COUNT
    assert made(folder) == made(driven)


def test_what_is_decided_already_is_not_driven_on(driven, tmp_path, monkeypatch):
    """As where it was ended while it wrote its tables."""
    folder = tmp_path / "run"

    def stop(_folder):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_bench(SETTINGS, folder, REMEMBERS, conclude=stop)

    class Nobody(Serial):
        def run(self, function, tasks, *, told=None):
            if not callable(getattr(function, "require_found", None)):
                return super().run(function, tasks, told=told)  # planners are tried
            raise AssertionError

    assert made(drive(folder, Nobody())) == made(driven)


def test_planners_that_do_not_differ_drive_all_worlds(tmp_path):
    planners = (PLANNER, f"other={PLANNER}")
    settings = replace(SETTINGS, planners=planners, worlds="0:300:100")
    folder = drive(tmp_path / "run", Serial(), settings)
    run = load_run(folder)
    assert run.worlds == [0, 100, 200]
    told = json.loads((folder / "run.json").read_text())["until_decided"]
    assert told == {"worlds": 3, "verdict": "inconclusive"}


@pytest.mark.parametrize(
    ("changed", "why"),
    [
        ({"planners": ("pursuit",)}, "compares two planners, and there are 1"),
        ({"planners": ("pursuit", "hlsd10", "dwa")}, r"are 3 \(pursuit, hlsd10, dwa\)"),
        ({"shard": "1/2"}, "which shard 1/2 does not have"),
        ({"until": stopping("score_2_8")}, "not defined under protocol hlsd2021"),
    ],
)
def test_what_cannot_be_decided_is_refused_before_anything_is_written(
    tmp_path, changed, why
):
    folder = tmp_path / "run"
    with pytest.raises(HlsdError, match=why):
        drive(folder, settings=replace(SETTINGS, **changed))
    assert not folder.exists()


def test_an_interrupted_run_goes_on_by_its_own_rule_alone(tmp_path):
    folder = tmp_path / "run"
    with pytest.raises(KeyboardInterrupt):
        drive(folder, Interrupted(after=2))
    others = {
        r"until_decided alpha 0\.05, now 0\.1": stopping("success", alpha=0.1),
        r"until_decided metric 'success', now 'time_s'": stopping(),
        r"until_decided margin 0\.02, now 0\.05": stopping("success", "5"),
        "until_decided .*now None": None,
    }
    for why, until in others.items():
        with pytest.raises(HlsdError, match=f"other settings .*{why}"):
            drive(folder, settings=replace(SETTINGS, until=until))


def test_the_rule_is_part_of_the_identity():
    plain = resolve(replace(SETTINGS, until=None))
    assert "until_decided" not in plain.as_json()
    digests = {
        resolve(replace(SETTINGS, until=until)).sha256()
        for until in (None, stopping(), stopping("success"), stopping(alpha=0.1))
    }
    assert len(digests) == 4


@pytest.mark.parametrize(
    ("edit", "why"),
    [
        (lambda held: held["until_decided"].update(worlds=13), "want a number from 1"),
        (lambda held: held["until_decided"].update(worlds=True), "want a number from"),
        (
            lambda held: held["until_decided"].update(worlds=7),
            "lacks 2 of the run's 14",
        ),
        (
            lambda held: held["until_decided"].update(worlds=5),
            "column world: .0.: want one of those in run",
        ),
        (lambda held: held["until_decided"].update(verdict=3), "want a text"),
        (lambda held: held["config"]["planners"].pop(), "is of two planners"),
        (lambda held: held.pop("until_decided"), "lacks 12 of the run's 24"),
        (lambda held: held["config"].pop("until_decided"), "want a rule with metric"),
        (lambda held: held["config"]["until_decided"]["order"].pop(), "not of the run"),
    ],
)
def test_a_record_that_says_otherwise_is_refused(driven, tmp_path, edit, why):
    folder = tmp_path / "run"
    shutil.copytree(driven, folder)
    held = json.loads((folder / "run.json").read_text())
    edit(held)
    (folder / "run.json").write_text(json.dumps(held))
    seal(folder, ("episodes.csv", "timing.csv", "run.json"))
    with pytest.raises(HlsdError, match=why) as error:
        load_run(folder)
    assert "\n" not in str(error.value)
