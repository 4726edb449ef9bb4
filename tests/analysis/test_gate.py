"""The gate: exit codes, power, what is refused, and the files that use it in CI."""

import hashlib
import json
import re
import shlex
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from hlsd.analysis.compare import Margin
from hlsd.analysis.gate import (
    GatedRun,
    Status,
    baseline_text,
    default_limit,
    gate,
    gate_run,
    load_baseline,
    overall,
    status_of,
    write_baseline,
)
from hlsd.analysis.metrics import METRICS
from hlsd.cli.app import main
from hlsd.core.errors import HlsdError
from hlsd.report.verdict_tables import gate_markdown
from hlsd.run.conditions import first_protocol
from hlsd.run.protocol import BARN2022, HLSD2021
from tests.analysis.test_compare import pair_with, planner_times, side, write_run
from tests.project.test_docs import unknown_options

ROOT = Path(__file__).resolve().parents[2]
WORKFLOW = ROOT / "examples" / "gate.yml"
BASELINE = ROOT / "baselines" / "hlsd10.json"
TIME, SUCCESS = METRICS["time_s"], METRICS["success"]


def status(run, baseline, limit=None):
    return overall(gate(run, baseline, {"time_s": limit}))


@pytest.mark.parametrize(
    ("interval_90", "metric", "expected"),
    [
        ((0.6, 2.0), TIME, Status.REGRESSION),
        ((0.4, 2.0), TIME, Status.INCONCLUSIVE),
        ((-0.6, 0.6), TIME, Status.INCONCLUSIVE),
        ((-0.6, 0.5), TIME, Status.OK),
        ((-9.0, -7.0), TIME, Status.OK),
        ((0.1, 0.4), TIME, Status.OK),  # worse, but not by more than is allowed
        ((-2.0, -0.6), SUCCESS, Status.REGRESSION),
        ((-0.6, 0.6), SUCCESS, Status.INCONCLUSIVE),
        ((-0.5, 0.6), SUCCESS, Status.OK),
    ],
)
def test_the_rule(interval_90, metric, expected):
    pair = pair_with(*interval_90, *interval_90)
    assert status_of(pair, metric, 0.5) is expected


def test_too_few_worlds_are_inconclusive_unless_the_rows_are_the_same():
    few = pair_with(-0.1, 0.1, -0.1, 0.1, worlds=3)
    assert status_of(few, TIME, 0.5) is Status.INCONCLUSIVE
    same = replace(few, same_runs=True)
    assert status_of(same, TIME, 0.0) is Status.OK


def test_the_worst_metric_decides():
    rng = np.random.default_rng(0)
    base = side(planner_times(rng, np.zeros(24), failing=0.0))
    slow = replace(base, values={**base.values, "time_s": base.values["time_s"] * 2})
    gated = gate(slow, base, {"success": None, "time_s": None})
    assert [row.status for row in gated] == [Status.OK, Status.REGRESSION]
    assert overall(gated) is Status.REGRESSION
    assert [Status(s).exit_code for s in ("ok", "regression", "inconclusive")] == [
        0,
        1,
        3,
    ]


def test_the_same_rows_are_always_ok():
    rng = np.random.default_rng(1)
    for _ in range(20):
        base = side(planner_times(rng, rng.normal(size=24), trials=2, failing=0.2))
        assert status(base, base, Margin(0.0, False)) is Status.OK
    for seed in (0, None):
        for times in (np.full((1, 1), 9.0), np.full((24, 2), 50.0)):
            base = side(times, seed)
            gated = gate(base, base, {"success": None, "time_s": Margin(0.0, False)})
            assert [row.status for row in gated] == [Status.OK] * 2
            assert "nothing has changed" in gate_markdown(GatedRun(base, base, gated))


def test_success_without_a_failure_is_ok_on_worlds_enough():
    """Other rows, and still no failure: 10 points worse cannot hide in 24 worlds."""
    rng = np.random.default_rng(7)
    for worlds, expected in ((6, "inconclusive"), (12, "inconclusive"), (24, "ok")):
        times = planner_times(rng, np.zeros(worlds), 2, failing=0.0)
        changed = side(times * 1.01)
        (row,) = gate(changed, side(times), {"success": None})
        assert (row.status, row.paired.difference) == (expected, 0)


def test_what_never_differs_is_no_proof():
    """Every run at the limit, before and after: times tell of no other world."""
    base = side(np.full((24, 2), 50.0))
    changed = replace(
        base, values={**base.values, "success": 1 - base.values["success"]}
    )
    (row,) = gate(changed, base, {"time_s": None})
    assert row.status is Status.INCONCLUSIVE
    assert np.isnan(row.paired.low_90)


def steady(rng, hard, longer=0.0):
    """Two runs a world of a planner that drives about as steadily as HLSD 1.0."""
    noise = rng.normal(0, 0.06, (len(hard), 2))
    return 7 * (1 + longer) * np.exp(0.33 * hard[:, None] + noise)


def test_noise_is_no_regression_and_a_worse_planner_is_one():
    """24 worlds x 2 runs, other noise on either side, 10 % allowed."""
    rng = np.random.default_rng(2)
    found = {0.0: [], 0.3: []}
    for _ in range(100):
        hard = rng.normal(size=24)
        base = side(steady(rng, hard))
        for longer, statuses in found.items():
            statuses.append(status(side(steady(rng, hard, longer), 1), base))
    assert found[0.0].count(Status.OK) >= 95
    assert found[0.0].count(Status.REGRESSION) == 0
    assert found[0.3].count(Status.REGRESSION) >= 95


def test_a_failure_by_chance_does_not_hide_that_most_worlds_are_slower():
    """One timeout in the baseline widens the mean's interval beyond use."""
    rng = np.random.default_rng(6)
    hard = rng.normal(size=24)
    old, new = steady(rng, hard), steady(rng, hard, 0.3)
    old[3, 0] = 50.0
    (row,) = gate(side(new, 1), side(old), {"time_s": None})
    assert row.paired.low_90 < row.limit, "the mean alone does not tell"
    assert row.status is Status.REGRESSION
    # It is no way to be ok: most worlds being as good leaves the mean open.
    (row,) = gate(side(steady(rng, hard), 1), side(old), {"time_s": None})
    assert row.status is Status.OK, "the failure was the baseline's"
    failing = steady(rng, hard)
    failing[[3, 9], 0] = 50.0
    (row,) = gate(side(failing, 1), side(steady(rng, hard)), {"time_s": None})
    assert row.status is Status.INCONCLUSIVE


def test_at_the_limit_either_error_is_one_in_twenty():
    """A planner worse by just what is allowed is seldom called ok, or a regression."""
    rng = np.random.default_rng(3)
    found = []
    for _ in range(100):
        hard = rng.normal(size=24)
        run, base = side(steady(rng, hard, 0.1), 1), side(steady(rng, hard))
        found.append(status(run, base))
    assert found.count(Status.REGRESSION) <= 10
    assert found.count(Status.OK) <= 10


def test_a_baseline_comes_back_as_it_was(tmp_path):
    base = side(planner_times(np.random.default_rng(4), np.zeros(24), 2), seed=7)
    base.values["time_s"][3] = np.nan
    file = tmp_path / "base.json"
    file.write_text(baseline_text(base))
    held = load_baseline(file)
    assert held.conditions == base.conditions
    assert np.array_equal(held.worlds, base.worlds)
    assert np.array_equal(held.trials, base.trials)
    assert list(held.values) == ["time_s", "success"]
    for name, values in base.values.items():
        assert np.array_equal(held.values[name], values, equal_nan=True), name
    assert baseline_text(held) == file.read_text()


def test_runs_beyond_the_baselines_are_left_out_and_missing_ones_refused():
    times = planner_times(np.random.default_rng(5), np.zeros(24), 3)
    whole, part = side(times), side(times[:20, :2])
    (row,) = gate(whole, part, {"time_s": None})
    assert (len(row.paired.worlds), row.paired.a_runs) == (20, 40)
    assert row.status is Status.OK
    with pytest.raises(HlsdError, match="lacks 32 of the baseline's 72 runs"):
        gate(part, whole, {"time_s": None})


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"suite": "mine"}, "differ in their suite"),
        ({"protocol": BARN2022}, "differ in their protocol"),
        ({"protocol": replace(HLSD2021, limit_s=60.0)}, "protocol's limit_s: '50.0'"),
        ({"robot": "jackal-ideal"}, "robot is 'jackal', the baseline's 'jackal-ideal'"),
        ({"robot_version": "0.9"}, "make the baseline again"),
    ],
)
def test_what_is_not_the_same_task_is_refused(changed, message):
    base = side(np.full((8, 2), 9.0))
    other = replace(base, conditions=replace(base.conditions, **changed))
    with pytest.raises(HlsdError, match=message):
        gate(base, other, {"time_s": None})


def test_a_metric_that_is_not_better_either_way_is_no_gate():
    base = side(np.full((8, 2), 9.0))
    base.values["path_length_m"] = base.values["time_s"]
    with pytest.raises(HlsdError, match="not better either way"):
        gate(base, base, {"path_length_m": None})


def test_limits_if_nobody_says():
    assert default_limit(TIME).of(8.0) == pytest.approx(0.8)
    assert default_limit(SUCCESS).of(0.9) == pytest.approx(0.1)


# -------------------------------------------------------------- on the command line


def hlsd(monkeypatch, capsys, *arguments):
    """Exit code, stdout and stderr of a command."""
    monkeypatch.setattr(sys, "argv", ["hlsd", *map(str, arguments)])
    with pytest.raises(SystemExit) as stop:
        main()
    out, err = capsys.readouterr()
    return stop.value.code or 0, out, err


def test_exit_codes(tmp_path, monkeypatch, capsys):
    run = write_run(tmp_path / "run", {"old": 10.0, "new": 10.65, "slow": 15.0})
    base = tmp_path / "base.json"
    made = hlsd(monkeypatch, capsys, "baseline", f"{run}:old", "--out", base)
    assert made[0] == 0
    assert base.stat().st_size < 4096
    again = hlsd(monkeypatch, capsys, "baseline", f"{run}:old", "--out", base)
    assert (again[0], "exists already" in again[2]) == (2, True)
    for planner, code, word in (
        ("old", 0, "ok"),
        ("slow", 1, "regression"),
        ("new", 3, "inconclusive"),
    ):
        options = ("--baseline", base, "--max-regression", "9%")
        found, out, _ = hlsd(monkeypatch, capsys, "gate", f"{run}:{planner}", *options)
        assert (found, out.startswith(f"{word}: ")) == (code, True), out
        found, out, _ = hlsd(
            monkeypatch, capsys, "gate", f"{run}:{planner}", *options, "--json"
        )
        assert (found, json.loads(out)["status"]) == (code, word)


def test_a_baseline_may_hold_the_time_with_contact_as_failure(tmp_path):
    """Older baselines, which do not hold it, are read as they were."""
    metric = ["time_s", "time_contact_fails_s"]
    clean = write_run(tmp_path / "clean", {"mine": 10.0}, worlds=24, contacts="0")
    touches = write_run(
        tmp_path / "new", {"mine": 9.5}, worlds=24, trials=3, contacts="3"
    )
    base = tmp_path / "base.json"
    write_baseline(str(clean), base, metric)
    held = load_baseline(base).values["time_contact_fails_s"]
    np.testing.assert_array_equal(held, load_baseline(base).values["time_s"])
    found = {row.metric.name: row.status for row in gate_run(str(touches), base).gated}
    assert found == dict(zip(metric, (Status.OK, Status.REGRESSION), strict=True))
    assert list(load_baseline(BASELINE).values) == ["success", "time_s"]
    with pytest.raises(HlsdError, match="holds no time_contact_fails_s"):
        gate_run(str(clean), BASELINE, "time_contact_fails_s")


def checksum(content):
    """A baseline's digest of its own content, as another program would make it."""
    plain = {name: value for name, value in content.items() if name != "sha256"}
    return hashlib.sha256(json.dumps(plain, sort_keys=True).encode()).hexdigest()


def test_bad_input_is_one_clear_line(tmp_path, monkeypatch, capsys):
    run = write_run(tmp_path / "run", {"a": 10.0})
    base = tmp_path / "base.json"
    hlsd(monkeypatch, capsys, "baseline", run, "--out", base, "--metric", "time_s")
    held = json.loads(base.read_text())
    wrong = {
        "other.json": {**held, "format": "something else"},
        "version.json": {**held, "metrics": {"time_s": 0}},
        "name.json": {**held, "metrics": {"times": 1}},
        "short.json": {**held, "runs": [[0, 0]]},
        "ragged.json": {**held, "runs": [[0, 0], [1, 0, 3.0]]},
        "lacking.json": {k: v for k, v in held.items() if k != "planner"},
    }
    for name, content in wrong.items():
        content["sha256"] = checksum(content)
        (tmp_path / name).write_text(json.dumps(content))
    edited = {**held, "runs": [[0, 0, 1.0], *held["runs"][1:]]}
    (tmp_path / "edited.json").write_text(json.dumps(edited))
    (tmp_path / "text.json").write_text("no JSON")
    for file, options, fragment in (
        ("none.json", (), "there is no baseline"),
        ("text.json", (), "not a baseline"),
        ("other.json", (), "'something else'"),
        ("version.json", (), "make the baseline again"),
        ("name.json", (), "did you mean 'time_s'"),
        ("edited.json", (), "changed since it was written"),
        ("short.json", (), "a value per metric"),
        ("ragged.json", (), "not a baseline"),
        ("lacking.json", (), "'planner'"),
        ("base.json", ("--metric", "success"), "holds no success, but time_s"),
        ("base.json", ("--max-regression", "lots"), "'lots'"),
    ):
        code, out, err = hlsd(
            monkeypatch, capsys, "gate", run, "--baseline", tmp_path / file, *options
        )
        assert (code, out) == (2, ""), file
        assert len(err.splitlines()) == 1, err
        assert fragment in err


# ------------------------------------------------------------ in continuous integration


def commands(text):
    """Lines of a shell script that run hlsd, as words."""
    for line in text.replace("\\\n", " ").splitlines():
        words = shlex.split(line, comments=True)
        if words and Path(words[0]).name == "hlsd":
            yield ["hlsd", *words[1:]]


def test_the_example_workflow_is_one_that_runs():
    """It parses, and its commands and options exist; GitHub's words are quoted."""
    workflow = yaml.safe_load(WORKFLOW.read_text(encoding="utf-8"))
    # YAML 1.1 reads the key `on` as true.
    assert set(workflow[True]) >= {"push", "pull_request"}
    (job,) = workflow["jobs"].values()
    assert job["runs-on"].startswith("ubuntu-")
    steps = job["steps"]
    for step in steps:
        assert ("uses" in step) != ("run" in step), step
        assert re.fullmatch(r"[\w./-]+@v\d+", step.get("uses", "a@v1"))
    found = [words for step in steps for words in commands(step.get("run", ""))]
    for words in found:
        assert not unknown_options(words), words
    assert {words[1] for words in found} >= {"bench", "gate", "report"}
    (upload,) = (s for s in steps if s.get("uses", "").startswith("actions/upload"))
    assert upload["if"] == "always()", "a report is wanted most when the gate fails"
    assert "pip install" in "".join(step.get("run", "") for step in steps)


def test_our_own_ci_gates_24_worlds_against_the_committed_baseline():
    ci = (ROOT / ".ci" / "run").read_text()
    assert [line for line in ci.splitlines() if line.startswith("make")] == [
        "make check",
        "make test",
        "make -j2 test-lowest test-python313",
        "make bench-ci",
    ]
    makefile = (ROOT / "Makefile").read_text()
    recipe = makefile[makefile.index("\nbench-ci:") :].split("\n\n")[0]
    assert f"--baseline {BASELINE.relative_to(ROOT)}" in recipe
    base = load_baseline(BASELINE)
    assert base.planner == "hlsd10"
    assert len(np.unique(base.worlds)) == 24
    (worlds,) = re.findall(r"^CI_WORLDS := (\S+)$", makefile, re.MULTILINE)
    start, stop, step = map(int, worlds.split(":"))
    assert sorted(set(base.worlds.tolist())) == list(range(start, stop, step))
    assert BASELINE.stat().st_size < 4096


def test_the_committed_baseline_is_of_this_suite_and_robot():
    from hlsd.data.worlds import load_suite
    from hlsd.sim.robots import get_robot

    base, suite, robot = load_baseline(BASELINE), load_suite("barn300"), "jackal"
    held = base.conditions
    assert (held.suite, held.suite_version) == (suite.name, suite.version)
    assert held.suite_digest == suite.digest
    assert (held.robot, held.robot_version) == (robot, get_robot(robot).version)
    assert held.protocol == HLSD2021


def test_a_baseline_of_0_1_0_is_read_by_the_rules_that_it_knew(tmp_path):
    base = side(np.full((8, 2), 9.0))
    plain = json.loads(baseline_text(base))
    conditions = plain.pop("conditions")
    plain["format"] = "hlsd baseline 1"
    plain |= {
        "suite": conditions["suite"]["name"],
        "suite_version": conditions["suite"]["version"],
        "suite_digest": conditions["suite"]["digest"],
        "protocol": "hlsd2021",
        "robot": "jackal",
        "robot_version": "1.0",
        "seed": 0,
    }
    file = tmp_path / "old.json"
    file.write_text(json.dumps(plain))
    first = first_protocol("hlsd2021")
    assert first.version == "1"
    assert load_baseline(file).conditions == replace(base.conditions, protocol=first)
