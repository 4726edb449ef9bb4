"""Reference files, and `hlsd validate` as a user runs it."""

import csv
import json

import numpy as np
import pytest
from scipy import stats

from hlsd.analysis.reference import Format, load_reference
from hlsd.analysis.run_trials import load_run
from hlsd.core.errors import HlsdError
from hlsd.run.conditions import Conditions
from hlsd.run.folder import RunConfig, RunFolder
from hlsd.run.protocol import get_protocol
from hlsd.run.row import COLUMNS, TEXT_COLUMNS, TIMING_COLUMNS
from tests.cli.test_cli import assert_refused, hlsd
from tests.conftest import shared

HEAD = "world,planner,trial,time_s\n"
LIMIT_S = 50.0


def make_run(folder, times, protocol="hlsd2021", finish=True):
    """A run's folder from {planner: {world: times}}; None is a timeout."""
    planners = tuple(times)
    worlds = tuple(times[planners[0]])
    conditions = Conditions(
        suite="barn300",
        suite_version="1",
        suite_digest="0",
        protocol=get_protocol(protocol),
        robot="jackal",
        robot_version="1.0",
        seed=0,
    )
    config = RunConfig(planners, ("",) * len(planners), worlds, 2, conditions)
    run = RunFolder(folder, config, {})
    blank = dict.fromkeys((*COLUMNS, *TIMING_COLUMNS), "0")
    blank |= dict.fromkeys(TEXT_COLUMNS, "")
    blank |= {"suite": "barn300", "protocol": protocol, "robot": "jackal"}
    blank |= {"suite_version": "1", "robot_version": "1.0"}
    run.append(
        blank
        | {
            "planner": planner,
            "world": str(world),
            "trial": str(trial),
            "outcome": "timeout" if time is None else "success",
            "reason": "",
            "time_s": str(LIMIT_S if time is None else time),
        }
        for planner, by_world in times.items()
        for world, values in by_world.items()
        for trial, time in enumerate(values)
    )
    if finish:
        run.finish(planners)
    return folder


def write(path, text):
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture
def run(tmp_path):
    times = {w: [10.0 + w, 12.0 + 1.5 * w] for w in range(5)} | {5: [30.0, None]}
    return make_run(tmp_path / "run", {"mine": times})


@pytest.fixture
def reference(tmp_path):
    rows = [
        f"{w},gazebo,{t},{time}\n"
        for w in range(1, 8)
        for t, time in enumerate((14.0 + w, 15.0 + w, 30.0 if w == 5 else 13.0 + w))
    ]
    return write(tmp_path / "reference.csv", HEAD + "".join(rows))


def test_a_csv_of_trials_with_penalties_and_timeouts(tmp_path):
    path = write(
        tmp_path / "t.csv",
        HEAD + "0,a,0,12.5\n0,a,1,30.000000\n1,a,0,50.007\n1,a,1,49.99\n2,a,0,30.001\n",
    )
    held = load_reference(path, LIMIT_S)
    assert (held.name, held.format) == ("a", Format.CSV)
    assert held.trials.worlds.tolist() == [0, 0, 1, 1, 2]
    assert held.trials.times_s.tolist() == [12.5, 30, 50, 49.99, 30.001]
    assert held.trials.success.tolist() == [True, False, False, True, True]
    assert (held.penalties, held.timeouts) == (1, 1)
    plain = load_reference(path, LIMIT_S, penalty_s=0)
    assert (plain.penalties, plain.trials.success.sum()) == (0, 4)
    short = load_reference(path, 20.0)
    assert (short.penalties, short.timeouts) == (0, 4)
    assert short.trials.times_s.max() == 20


def test_columns_go_by_name_and_files_of_other_systems_are_read(tmp_path):
    path = tmp_path / "t.csv"
    text = '\r\ntime_s, note, trial, planner, world\r\n12.5,x,0,"a, b",7\r\n\r\n'
    path.write_bytes(b"\xef\xbb\xbf" + text.encode())
    held = load_reference(path, LIMIT_S)
    assert held.name == "a, b"
    assert held.trials.worlds.tolist() == [7]


def test_the_planner_of_a_csv_is_chosen(tmp_path):
    path = write(tmp_path / "t.csv", HEAD + "0,a,0,1.5\n0,b,0,2.5\n")
    assert load_reference(path, LIMIT_S, "b").trials.times_s.tolist() == [2.5]
    with pytest.raises(HlsdError, match=r"\(a, b\).*`reference_planner`"):
        load_reference(path, LIMIT_S)
    with pytest.raises(HlsdError, match="'c': known are a, b"):
        load_reference(path, LIMIT_S, "c")


def test_out_txt_puts_every_failure_at_the_limit(tmp_path):
    """A collision after 5 s is no fast run; a success beyond the limit is none."""
    path = write(
        tmp_path / "out.txt",
        "108 1 0 0 22.2800 4.1806\n108 0 1 0 5.0 0.0\n6 0 0 1 100.07 0\n6 1 0 0 61 1\n",
    )
    held = load_reference(path, LIMIT_S)
    assert (held.name, held.format) == ("out.txt", Format.OUT_TXT)
    assert held.trials.worlds.tolist() == [108, 108, 6, 6]
    assert held.trials.times_s.tolist() == [22.28, 50, 50, 50]
    assert held.trials.success.tolist() == [True, False, False, False]
    assert (held.penalties, held.timeouts) == (0, 1)
    longer = load_reference(path, 100.0)
    assert longer.trials.times_s.tolist() == [22.28, 100, 100, 61]
    with pytest.raises(HlsdError, match="names no planner"):
        load_reference(path, LIMIT_S, "dwa")


STATUS = "world,planner,trial,time_s,status\n"


def test_a_run_that_the_file_calls_a_failure_is_none_of_the_fast(tmp_path):
    rows = "0,a,0,5.0,flip\n0,a,1,12.5,Succeeded\n1,a,0,30.0,success\n1,a,1,60,ok\n"
    held = load_reference(write(tmp_path / "t.csv", STATUS + rows), LIMIT_S)
    assert held.trials.success.tolist() == [False, True, True, False]
    assert held.trials.times_s.tolist() == [50, 12.5, 30, 50]
    # The file says that the goal was reached after 30 s: no penalty.
    assert (held.penalties, held.timeouts) == (0, 1)


@pytest.mark.parametrize("name", ["status", "outcome", "result", "success"])
@pytest.mark.parametrize(("word", "reached"), [("1", True), ("Timed out", False)])
def test_every_name_of_the_column_is_known(tmp_path, name, word, reached):
    text = f"{name},world,planner,trial,time_s\n{word},0,a,0,12.5\n"
    held = load_reference(write(tmp_path / "t.csv", text), LIMIT_S)
    assert held.trials.success.tolist() == [reached]


def test_more_columns_of_an_out_txt_are_passed_over(tmp_path):
    text = "293 1 0 0 12.7 8.1 0.5\n310 0 1 0 6.9 8.9 0\n"
    held = load_reference(write(tmp_path / "o.txt", text), LIMIT_S)
    assert held.trials.worlds.tolist() == [293, 310]
    assert held.trials.success.tolist() == [True, False]


@pytest.mark.parametrize(
    ("file", "runs", "reached"),
    [
        ("trials-with-status.csv", 5, 0),
        ("lu.txt", 6, 5),
        ("aajin126.txt", 6, 3),
        ("2024-run.txt", 500, None),
    ],
)
def test_files_of_teams_are_read(file, runs, reached):
    held = load_reference(shared("cases", "out-txt", file), 100.0)
    assert len(held.trials.worlds) == runs
    assert reached is None or held.trials.success.sum() == reached


BAD = {
    STATUS + "0,a,0,5.0,perhaps\n": ("line 2", "status 'perhaps'", "flip"),
    STATUS + "0,a,0,5.0,\n": ("line 2", "status ''"),
    "success," + STATUS + "1,0,a,0,5.0,flip\n": ("line 2", "disagree"),
    "status," + STATUS + "ok,0,a,0,5.0,ok\n": ("line 1", "2 columns 'status'"),
    "0 1 0 0 22.2 4.1\n0 1 0 0 22.2 4 5\n": ("line 2", "7 fields", "6, as many as"),
    "0 1 0 0 2_2 4.1\n": ("line 1", "time '2_2'"),
    "": ("is empty", "world,planner,trial,time_s"),
    "\n \n": ("is empty",),
    "hello world\n": ("line 1", "'hello world'", "out.txt"),
    "\n\nworld;time\n": ("line 3",),
    "world,trial,time_s\n0,0,1\n": ("line 1", "no column 'planner'"),
    HEAD: ("no trials",),
    HEAD + "0,a,0\n": ("line 2", "3 fields", "4"),
    HEAD + "0,a,0,1.5\n-1,a,0,2\n": ("line 3", "world '-1'", "whole number"),
    HEAD + "0,a,x,1.5\n": ("line 2", "trial 'x'"),
    HEAD + "0,a,0,nan\n": ("line 2", "time_s 'nan'", "a number"),
    HEAD + "0,a,0,\n": ("line 2", "time_s ''"),
    HEAD + "0,a,0,-3\n": ("line 2", "time_s '-3'", "seconds"),
    HEAD + f"{'9' * 5000},a,0,3\n": ("line 2", "world '999"),
    HEAD + "0,a,0,1.5\n\n0,b,0,2\n0,a,0,2.5\n": ("line 5", "again", "line 2"),
    HEAD + '0,"a,0,1.5\n': ("line 2",),
    "0 1 0 0 22.2 4.1\n0 1 0 0 22.2\n": ("line 2", "5 fields", "six"),
    "0 1 0 0 22.2 4.1\n0 2 0 0 22.2 4\n": ("line 2", "success '2'", "0 or 1"),
    "0 1 1 0 22.2 4.1\n": ("line 1", "collided 1", "without"),
    "0.5 1 0 0 22.2 4.1\n": ("line 1", "world '0.5'"),
    "0 1 0 0 fast 4.1\n": ("line 1", "time 'fast'"),
    "0 1 0 0 22.2 x\n": ("line 1", "metric 'x'"),
    "a b c d e f\n": ("line 1", "success 'b'"),
}


@pytest.mark.parametrize("text", BAD, ids=lambda text: repr(text[:50]))
def test_what_is_no_reference_is_refused_with_its_line(tmp_path, text):
    path = write(tmp_path / "bad", text)
    with pytest.raises(HlsdError) as caught:
        load_reference(path, LIMIT_S)
    message = str(caught.value)
    assert "\n" not in message
    assert len(message) < 400
    for fragment in (str(path), *BAD[text]):
        assert fragment in message


def test_files_that_cannot_be_read_are_refused(tmp_path):
    with pytest.raises(HlsdError, match=r"there is no reference .*none\.csv"):
        load_reference(tmp_path / "none.csv", LIMIT_S)
    with pytest.raises(HlsdError, match="it is a folder, not a reference"):
        load_reference(tmp_path, LIMIT_S)
    (tmp_path / "binary").write_bytes(b"\xff\xfe\x00,\x00")
    with pytest.raises(HlsdError, match="UTF-16 text"):
        load_reference(tmp_path / "binary", LIMIT_S)


def test_a_run_gives_the_trials_of_one_planner(tmp_path):
    folder = make_run(
        tmp_path / "run",
        {"one": {0: [11.0, None]}, "two": {0: [22.0, 23.0]}},
    )
    held = load_run(folder, "one")
    assert held.trials.times_s.tolist() == [11, 50]
    assert held.trials.success.tolist() == [True, False]
    assert (held.planner, held.protocol.limit_s) == ("one", 50)
    assert load_run(folder, "two").trials.times_s.tolist() == [22, 23]
    with pytest.raises(HlsdError, match=r"\(one, two\): say which"):
        load_run(folder)
    with pytest.raises(HlsdError, match=r"unknown planner of .*'too'.*one, two"):
        load_run(folder, "too")


def test_validate_prints_what_was_compared(run, reference, tmp_path):
    out = tmp_path / "worlds.csv"
    command = ("validate", run, "--against", reference, "--worlds-out", out)
    result = hlsd(*command)
    assert result.returncode == 0, result.stderr
    assert result.stderr == ""
    text = result.stdout
    assert "mine" in text
    assert "5 worlds, 10 runs against 15" in text
    assert "| mean time |" in text
    assert "Spearman-Brown" in text
    assert "uncorrected" in text
    assert "1 reference runs are recorded at the penalty" in text
    assert "1 worlds that only the run holds, 2 that only the reference holds" in text
    assert str(out) in text
    rows = list(csv.DictReader(out.read_text(encoding="utf-8").splitlines()))
    assert [row["world"] for row in rows] == ["1", "2", "3", "4", "5"]
    assert [float(row["mean_time_s"]) for row in rows] == [12.25, 13.5, 14.75, 16, 40]
    assert float(rows[4]["reference_success"]) == pytest.approx(2 / 3, abs=1e-4)
    before = out.read_bytes()
    assert_refused(hlsd(*command), str(out), "exists")
    assert out.read_bytes() == before


def test_validate_as_json_is_the_arithmetic_of_the_rows(run, reference):
    command = ("validate", run, "--against", reference, "--json")
    result = hlsd(*command)
    assert result.returncode == 0, result.stderr
    held = json.loads(result.stdout)
    ours = [12.25, 13.5, 14.75, 16, 40]
    theirs = [15, 16, 17, 18, (19 + 20 + 30) / 3]
    assert [w["reference_mean_time_s"] for w in held["per_world"]] == theirs
    time = held["time_correlation"]
    assert time["pearson"]["value"] == pytest.approx(stats.pearsonr(ours, theirs)[0])
    assert time["spearman"]["value"] == pytest.approx(1)
    assert held["time_s"]["ratio"]["value"] == pytest.approx(sum(ours) / sum(theirs))
    at_limit = held["time_at_limit_s"]["reference"]["value"]
    assert at_limit == pytest.approx((sum(theirs) + 20 / 3) / 5)
    successes = held["success_time_s"]["reference"]["value"]
    assert successes == pytest.approx((3 * sum(theirs) - 30) / 14)
    assert held["reference"]["penalties"] == 1
    assert held["run"]["limit_s"] == LIMIT_S
    assert hlsd(*command).stdout == result.stdout, "same seed, same bytes"


def test_validate_refuses_bad_input(run, reference, tmp_path):
    bad = write(tmp_path / "bad.txt", "0 1 0 0 22.2 4.1\n0 1 0\n")
    few = write(tmp_path / "few.csv", HEAD + "0,a,0,9\n1,a,0,9\n99,a,0,9\n")
    unfinished = make_run(tmp_path / "half", {"mine": {0: [1.0]}}, finish=False)
    for arguments, fragments in (
        ((run, "--against", bad), (str(bad), "line 2", "six")),
        ((run, "--against", few), ("share 2 worlds", "3 or more")),
        ((unfinished, "--against", reference), ("not finished", "hlsd bench")),
        (
            (run, "--against", reference, "--planner", "min"),
            ("unknown planner of", "'min'", "did you mean 'mine'"),
        ),
    ):
        assert_refused(hlsd("validate", *arguments), *fragments)


def test_the_published_trials_are_read_whole():
    """Five trials of two planners, and ten of one, in the worlds held here."""
    path = shared("reference", "gazebo_2020_trials.csv")
    with pytest.raises(HlsdError, match=r"dwa_0\.5, eband"):
        load_reference(path, LIMIT_S)
    table = np.genfromtxt(path, delimiter=",", names=True, dtype=None, encoding="utf-8")
    for planner in ("dwa_0.5", "eband"):
        held = load_reference(path, LIMIT_S, planner)
        times = table["time_s"][table["planner"] == planner]
        assert set(np.unique(held.trials.worlds, return_counts=True)[1]) == {5}
        np.testing.assert_array_equal(held.trials.times_s, np.minimum(times, LIMIT_S))
        assert held.penalties == (times == 30).sum() > 0
        assert held.timeouts == (times >= 50).sum() > 0
        failures = held.penalties + held.timeouts
        assert (~held.trials.success).sum() == failures
    out = shared("reference", "gazebo_2022_dwa_out.txt")
    runs = np.loadtxt(out)
    held = load_reference(out, 100.0)
    assert set(np.unique(held.trials.worlds, return_counts=True)[1]) == {10}
    np.testing.assert_array_equal(held.trials.success, runs[:, 1] == 1)
    reached = held.trials.success
    np.testing.assert_array_equal(held.trials.times_s[reached], runs[reached, 4])
    assert set(held.trials.times_s[~reached]) == {100.0}
    assert held.timeouts == 0
