"""Verdicts: what they follow from, how often they err, and what is refused."""

import json
import sys
from dataclasses import fields, replace

import numpy as np
import pytest
from typer.testing import CliRunner

from hlsd.analysis.compare import (
    MIN_WORLDS,
    ComparedRuns,
    Margin,
    Side,
    Verdict,
    compare,
    default_margin,
    judge,
    load_side,
    parse_margin,
)
from hlsd.analysis.metrics import METRICS
from hlsd.analysis.same_runs import same_runs
from hlsd.analysis.statistics import Paired, paired_difference
from hlsd.cli.app import app, main
from hlsd.core.errors import HlsdError
from hlsd.report.verdict_tables import comparison_markdown
from hlsd.run.bench import Bench, run_bench
from hlsd.run.conditions import Conditions
from hlsd.run.folder import write_imported
from hlsd.run.protocol import BARN2022, HLSD2021
from hlsd.run.row import COLUMNS
from hlsd.sim.perturbations import Disturbance

LIMIT_S = 50.0
CONDITIONS = {field.name for field in fields(Conditions)}
TIME, SUCCESS = METRICS["time_s"], METRICS["success"]


def side(times, seed=0, worlds=None, **changed):
    """A planner with a row of times per world, failures at the limit."""
    times = np.asarray(times, np.float64)
    number = np.arange(len(times)) if worlds is None else worlds
    conditions = Conditions(
        suite="suite",
        suite_version="1",
        suite_digest="",
        protocol=HLSD2021,
        robot="jackal",
        robot_version="1.0",
        seed=seed,
    )
    ours = {name: value for name, value in changed.items() if name in CONDITIONS}
    held = Side(
        name="planner (somewhere)",
        planner="planner",
        conditions=replace(conditions, **ours),
        worlds=np.repeat(number, times.shape[1]),
        trials=np.tile(np.arange(times.shape[1]), len(times)),
        values={
            "time_s": times.ravel(),
            "success": (times.ravel() < LIMIT_S).astype(np.float64),
        },
    )
    others = {name: value for name, value in changed.items() if name not in ours}
    return replace(held, **others)


def planner_times(rng, hard, trials=3, longer=0.0, failing=0.03):
    """Log-normal times with an effect of the world, some runs failing."""
    noise = 0.3 * rng.normal(size=(len(hard), trials))
    times = 10 * (1 + longer) * np.exp(0.5 * hard[:, None] + noise)
    fails = rng.random(times.shape) < failing
    return np.where(fails, LIMIT_S, np.minimum(times, LIMIT_S))


def verdict_of(a, b, metric="time_s", margin=None):
    (judged,) = compare(a, b, {metric: margin})
    return judged


def pair_with(low, high, low_90, high_90, worlds=20):
    some = np.zeros(worlds)
    middle = (low + high) / 2
    intervals = (low, high, low_90, high_90)
    return Paired(
        np.arange(worlds), some, some, some, 1, 1, True, middle, *intervals, 1
    )


@pytest.mark.parametrize(
    ("interval", "interval_90", "lower_is_better", "verdict", "within"),
    [
        ((-3, -1), (-2.8, -1.2), True, Verdict.BETTER, False),
        ((-3, -1), (-2.8, -1.2), False, Verdict.WORSE, False),
        ((1, 3), (1.2, 2.8), True, Verdict.WORSE, False),
        ((1, 3), (1.2, 2.8), False, Verdict.BETTER, False),
        ((-0.4, 0.3), (-0.3, 0.2), True, Verdict.EQUIVALENT, True),
        ((-0.6, 0.5), (-0.5, 0.4), True, Verdict.EQUIVALENT, True),
        ((-0.9, 0.3), (-0.7, 0.2), True, Verdict.INCONCLUSIVE, False),
        ((-2, 3), (-1.5, 2.5), True, Verdict.INCONCLUSIVE, False),
        ((0, 3), (0.2, 2.5), True, Verdict.INCONCLUSIVE, False),
        # Real, and too small to matter: both are said.
        ((-0.4, -0.1), (-0.38, -0.12), True, Verdict.BETTER, True),
        ((-0.4, -0.1), (-0.38, -0.12), False, Verdict.WORSE, True),
    ],
)
def test_the_rule(interval, interval_90, lower_is_better, verdict, within):
    pair = pair_with(*interval, *interval_90)
    metric = TIME if lower_is_better else SUCCESS
    assert judge(pair, metric, 0.5) == (verdict, within)


def test_a_metric_that_is_not_better_either_way_only_differs():
    metric = METRICS["success_time_s"]
    assert metric.better is None
    assert judge(pair_with(-3, -1, -2.8, -1.2), metric, 0.5)[0] is Verdict.DIFFERENT
    small = pair_with(-0.4, 0.3, -0.3, 0.2)
    assert judge(small, metric, 0.5)[0] is Verdict.EQUIVALENT


def test_too_few_worlds_give_no_verdict():
    few = pair_with(-3, -1, -2.8, -1.2, worlds=MIN_WORLDS - 1)
    assert judge(few, TIME, 0.5) == (Verdict.INCONCLUSIVE, False)


@pytest.mark.parametrize("same_seed", [True, False])
def test_a_planner_is_seldom_better_than_itself(same_seed):
    """200 pairs that differ by chance alone; 2.5 % are meant to come out better."""
    rng = np.random.default_rng(11)
    found = []
    for _ in range(200):
        hard = rng.normal(size=24)
        a, b = (
            side(planner_times(rng, hard), seed) for seed in (0, int(not same_seed))
        )
        found.append(verdict_of(a, b).verdict)
    assert found.count(Verdict.BETTER) <= 10
    assert found.count(Verdict.WORSE) <= 10
    assert found.count(Verdict.INCONCLUSIVE) > 0


def test_a_planner_that_is_a_fifth_faster_is_found_better():
    rng = np.random.default_rng(12)
    found = []
    for _ in range(50):
        hard = rng.normal(size=60)
        a = planner_times(rng, hard, longer=-0.2, failing=0.0)
        b = planner_times(rng, hard, failing=0.0)
        found.append(verdict_of(side(a, 0), side(b, 1)).verdict)
    assert found.count(Verdict.BETTER) >= 45


def test_as_good_is_equivalent_when_there_are_runs_enough():
    rng = np.random.default_rng(13)
    hard = rng.normal(size=300)
    a, b = (planner_times(rng, hard, 10, failing=0.0) for _ in range(2))
    judged = verdict_of(side(a, 0), side(b, 1))
    assert judged.verdict is Verdict.EQUIVALENT
    assert judged.margin == pytest.approx(0.05 * b.mean())


def test_a_planner_against_itself_is_equivalent_with_any_margin():
    times = planner_times(np.random.default_rng(1), np.zeros(10))
    judged = verdict_of(side(times), side(times), margin=Margin(0.0, False))
    assert judged.verdict is Verdict.EQUIVALENT
    assert judged.within_margin
    assert judged.paired.same_runs
    assert np.isnan((judged.paired.low, judged.paired.high)).all()
    text = comparison_markdown(ComparedRuns(side(times), side(times), (judged,)))
    assert "| equivalent: the same runs |" in text
    assert "nothing can differ" in text
    assert "nan" not in text


@pytest.mark.parametrize(
    ("worlds", "expected"),
    [(3, "inconclusive"), (12, "inconclusive"), (300, "equivalent")],
)
@pytest.mark.parametrize("seed", [0, 1])
def test_two_that_never_fail_are_equivalent_only_on_worlds_enough(
    worlds, expected, seed
):
    """Or always do: a difference of 2 points may hide in few worlds."""
    rng = np.random.default_rng(9)
    for times in (planner_times(rng, np.zeros(worlds), failing=f) for f in (0, 1)):
        faster = np.where(times < LIMIT_S, times * 0.9, LIMIT_S)
        judged = verdict_of(side(faster, planner="a"), side(times, seed), "success")
        assert judged.verdict == expected
        assert judged.within_margin == (expected == "equivalent")
        assert judged.paired.low < 0 < judged.paired.high


def test_what_never_differs_says_nothing_of_other_worlds():
    """All at the limit: no interval of times, and no verdict."""
    times = np.full((50, 2), LIMIT_S)
    a, b = side(times, planner="a"), side(times, planner="b")
    judged = verdict_of(a, b)
    assert judged.verdict is Verdict.INCONCLUSIVE
    assert not judged.paired.same_runs, "two planners that fail alike"
    text = comparison_markdown(ComparedRuns(a, b, (judged,)))
    assert "| – |" in text
    assert "all worlds differ by the same" in text
    assert str(ComparedRuns(a, b, (judged,))).endswith("inconclusive, +0.00")


def test_every_world_being_slower_by_the_same_is_worse():
    """No interval, since no resample differs; that all differ is seen all the same."""
    times = planner_times(np.random.default_rng(8), np.zeros(8), failing=0.0)
    judged = verdict_of(side(times + 1.0), side(times), margin=Margin(2.0, False))
    assert np.isnan(judged.paired.low)
    assert (judged.verdict, judged.within_margin) == (Verdict.WORSE, False)


def test_the_same_runs_are_known_by_what_they_did():
    times = planner_times(np.random.default_rng(10), np.zeros(9))
    base = side(times)
    order = np.random.default_rng(0).permutation(len(base.worlds))
    shuffled = replace(
        base,
        worlds=base.worlds[order],
        trials=base.trials[order],
        values={name: values[order] for name, values in base.values.items()},
    )
    assert same_runs(base, shuffled)
    assert same_runs(base, side(times, planner="under another name"))
    assert same_runs(side(times, None), side(times, None)), "both imported"
    assert not same_runs(base, side(times, 1)), "other starts and noise"
    assert same_runs(base, side(times, None)), "no other seed is known"
    assert same_runs(base, side(times[:5])), "in the worlds that both hold"
    assert not same_runs(base, side(times[:, :2])), "fewer trials"
    other = times.copy()
    other[4, 1] += 0.01
    assert not same_runs(base, side(other))


def test_a_single_world_is_told_without_an_interval():
    a, b = (side(np.full((1, n), 9.0 + n), 0) for n in (1, 2))
    judged = compare(a, b, {"time_s": None, "success": None})
    assert {row.verdict for row in judged} == {Verdict.INCONCLUSIVE}
    held = ComparedRuns(a, b, judged)
    text = comparison_markdown(held)
    assert "nan" not in text + str(held)
    assert text.count("| – |") == 2
    for row in held.as_json()["metrics"].values():
        assert (row["interval_95"], row["interval_90"]) == (None, None)
    assert "NaN" not in json.dumps(held.as_json(), allow_nan=False)


def test_only_runs_of_one_seed_are_pairs():
    """Shared noise cancels where runs are paired by trial."""
    rng = np.random.default_rng(2)
    a = planner_times(rng, rng.normal(size=20), failing=0.0)
    b = a + rng.normal(0.5, 0.1, a.shape)
    same, other, unknown = (
        verdict_of(side(a), side(b, s)).paired for s in (0, 1, None)
    )
    assert same.by_trial
    assert not other.by_trial
    assert not unknown.by_trial
    neither = verdict_of(side(a, None), side(b, None)).paired
    assert not neither.by_trial, "unknown is not the same"
    assert same.difference == pytest.approx(other.difference)
    assert same.high - same.low < 0.2 * (other.high - other.low)


def test_several_metrics_are_adjusted_by_holm():
    rng = np.random.default_rng(3)
    hard = rng.normal(size=30)
    a, b = side(planner_times(rng, hard)), side(planner_times(rng, hard), 1)
    both = compare(a, b, {"time_s": None, "success": None})
    least = min(both, key=lambda row: row.paired.p)
    assert least.holm_p == pytest.approx(min(1.0, 2 * least.paired.p))
    (alone,) = compare(a, b, {"time_s": None})
    assert alone.holm_p == alone.paired.p


def test_only_common_worlds_count_and_it_is_said():
    times = planner_times(np.random.default_rng(4), np.zeros(20))
    a = side(times[:12], worlds=np.arange(12))
    b = side(times[4:], worlds=np.arange(4, 20))
    judged = compare(a, b, {"time_s": None})
    assert judged[0].paired.worlds.tolist() == list(range(4, 12))
    text = comparison_markdown(ComparedRuns(a, b, judged))
    assert "8 common worlds" in text
    assert "4 worlds that only" in text
    assert "8 worlds that only" in text


def test_runs_without_a_value_are_left_out_and_it_is_said():
    times = planner_times(np.random.default_rng(5), np.zeros(10), failing=0.0)
    a, b = side(times), side(times + 1)
    a.values["time_s"][[0, 4]] = np.nan
    judged = compare(a, b, {"time_s": None})
    assert (judged[0].paired.a_runs, judged[0].paired.b_runs) == (28, 28)
    assert "not defined for 2 runs of A and 0 of B" in comparison_markdown(
        ComparedRuns(a, b, judged)
    )


def test_other_robots_are_compared_with_a_note():
    times = planner_times(np.random.default_rng(6), np.zeros(10))
    a, b = side(times), side(times, robot="jackal-ideal")
    judged = compare(a, b, {"time_s": None})
    assert "robots differ" in comparison_markdown(ComparedRuns(a, b, judged))


@pytest.mark.parametrize(
    ("changed", "what"),
    [
        ({"suite": "mine"}, "suite"),
        ({"suite_version": "2"}, "suite version"),
        ({"protocol": BARN2022}, "protocol"),
        ({"protocol": replace(HLSD2021, version="3")}, "protocol's version"),
        ({"perturbations": (Disturbance("lidar.dropout", 0.1),)}, "perturbations"),
    ],
)
def test_other_conditions_are_refused(changed, what):
    times = np.ones((8, 2))
    with pytest.raises(HlsdError, match=f"differ in their {what}: "):
        compare(side(times), side(times, **changed), {"time_s": None})


DROPOUT = (Disturbance("lidar.dropout", 0.1),)


def test_perturbed_and_clean_are_compared_where_one_is_told_to():
    times = planner_times(np.random.default_rng(7), np.zeros(20), failing=0.0)
    a, b = side(times + 1.0, perturbations=DROPOUT), side(times)
    with pytest.raises(HlsdError, match="only with `across_perturbations`"):
        compare(a, b, {"time_s": None})
    judged = compare(a, b, {"time_s": None}, across_perturbations=True)
    assert judged[0].paired.by_trial, "by world and trial"
    assert judged[0].verdict is Verdict.WORSE
    said = comparison_markdown(ComparedRuns(a, b, judged)).splitlines()[0]
    assert said.endswith("; A perturbed by lidar.dropout=0.1; B not perturbed")
    sides = ComparedRuns(a, b, judged).as_json()
    assert sides["a"]["perturbations"] == ["lidar.dropout=0.1"]
    assert sides["b"]["perturbations"] == []
    other = side(times, perturbations=DROPOUT, protocol=BARN2022)
    with pytest.raises(HlsdError, match="differ in their protocol"):
        compare(other, b, {"time_s": None}, across_perturbations=True)


def test_runs_of_one_perturbation_are_compared_and_it_is_said():
    times = planner_times(np.random.default_rng(7), np.zeros(20))
    a, b = side(times + 1.0, perturbations=DROPOUT), side(times, perturbations=DROPOUT)
    said = comparison_markdown(ComparedRuns(a, b, compare(a, b, {"time_s": None})))
    assert "; both perturbed by lidar.dropout=0.1" in said
    clean = ComparedRuns(side(times), side(times + 1), compare(b, a, {"time_s": None}))
    assert "perturbed" not in comparison_markdown(clean)


def imported(folder, held, text=""):
    """A run under perturbations; its rows alone, with a text, where they are None."""
    known = side(np.ones((1, 1)), suite="barn300", protocol=BARN2022).conditions
    rows = [
        {
            "suite": known.suite,
            "suite_version": known.suite_version,
            "world": str(world),
            "planner": "mine",
            "robot": known.robot,
            "robot_version": known.robot_version,
            "trial": "0",
            "protocol": known.protocol.name,
            "outcome": "success",
            "time_s": "12.0000",
            "perturbations": text,
        }
        for world in range(8)
    ]
    conditions = None if held is None else replace(known, perturbations=held)
    write_imported(folder, rows, {}, conditions)


def test_the_commands_refuse_and_take_perturbed_beside_clean(tmp_path):
    def command(*words):
        return CliRunner().invoke(app, [str(word) for word in words])

    perturbed, clean, alone = (tmp_path / name for name in ("p", "c", "alone"))
    imported(perturbed, DROPOUT)
    imported(clean, ())
    # Rows that were taken out of their run's folder.
    imported(alone, None, "lidar.dropout=0.1")
    base = tmp_path / "baseline.json"
    assert command("baseline", clean, "--out", base).exit_code == 0
    for run in (perturbed, alone):
        for words in (("compare", run, clean), ("gate", run, "--baseline", base)):
            refused = command(*words)
            assert "only with --across-perturbations" in str(refused.exception)
            said = command(*words, "--across-perturbations").stdout
            assert "perturbed by lidar.dropout=0.1" in said
    assert command("compare", perturbed, alone).exit_code == 0


def test_worlds_of_another_digest_are_refused_where_both_are_known():
    times = np.ones((8, 2))
    a, b = side(times, suite_digest="a"), side(times, suite_digest="b")
    with pytest.raises(HlsdError, match="suite digest"):
        compare(a, b, {"time_s": None})
    compare(a, side(times), {"time_s": None})


def test_margins_are_read_as_typed():
    assert parse_margin("5%", TIME).of(12.0) == pytest.approx(0.6)
    assert parse_margin("0.3", TIME).of(12.0) == pytest.approx(0.3)
    assert parse_margin("2", SUCCESS).of(0.5) == pytest.approx(0.02), "points"
    assert parse_margin(" 5 %", SUCCESS).of(0.5) == pytest.approx(0.025)
    assert default_margin(TIME).of(-4.0) == pytest.approx(0.2)
    assert default_margin(SUCCESS).of(0.1) == pytest.approx(0.02)
    for wrong in ("much", "-1", "nan", "inf%", "%"):
        with pytest.raises(HlsdError, match="not a margin"):
            parse_margin(wrong, TIME)


# ------------------------------------------------------------------- on real runs


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    """HLSD 1.0 and DWA on 12 worlds, the first four times and the other twice."""
    folder = tmp_path_factory.mktemp("runs")
    for planner, trials in (("hlsd10", 4), ("dwa", 2)):
        bench = Bench((planner,), worlds="0:300:26", trials=trials)
        run_bench(bench, folder / planner, jobs=1)
    return folder


@pytest.mark.slow
def test_hlsd_is_better_than_dwa(runs):
    a, b = (load_side(str(runs / name), ["time_s"]) for name in ("hlsd10", "dwa"))
    judged = verdict_of(a, b)
    assert (judged.paired.by_trial, judged.paired.a_runs) == (True, 24)
    assert judged.verdict is Verdict.BETTER
    assert judged.paired.p < 0.05
    assert verdict_of(b, a).verdict is Verdict.WORSE


@pytest.mark.slow
def test_halves_of_a_real_run_are_seldom_better_than_each_other(runs):
    """200 splits of each world's runs into halves: what another seed would show."""
    held = load_side(str(runs / "hlsd10"), ["time_s"])
    times, worlds = held.values["time_s"], held.worlds
    rng = np.random.default_rng(14)
    found = []
    for _ in range(200):
        shuffled = np.lexsort((rng.random(len(times)), worlds))
        first = np.arange(len(times)) % 4 < 2
        a, b = shuffled[first], shuffled[~first]
        pair = paired_difference(times[a], worlds[a], times[b], worlds[b])
        found.append(judge(pair, TIME, 0.05 * float(pair.b.mean()))[0])
    assert found.count(Verdict.BETTER) <= 10
    assert found.count(Verdict.WORSE) <= 10


# -------------------------------------------------------------- on the command line


def row(planner, world, trial, time_s, **changed):
    return {
        **dict.fromkeys(COLUMNS, ""),
        "suite": "suite",
        "suite_version": "1",
        "world": str(world),
        "planner": planner,
        "robot": "jackal",
        "robot_version": "1.0",
        "trial": str(trial),
        "seed": "0",
        "protocol": "hlsd2021",
        "outcome": "success" if time_s < LIMIT_S else "timeout",
        "time_s": f"{time_s:.4f}",
        **changed,
    }


def write_run(path, planners, worlds=12, trials=2, **changed):
    """A run's folder with planners of so many seconds each."""
    rng = np.random.default_rng(0)
    hard = rng.normal(0, 2, worlds)
    rows = [
        row(planner, w, t, mean + hard[w] + rng.normal(0, 0.5), **changed)
        for planner, mean in planners.items()
        for w in range(worlds)
        for t in range(trials)
    ]
    write_imported(path, rows, {"format": "test"})
    return path


def invoke(*arguments):
    return CliRunner().invoke(app, list(map(str, arguments)))


def test_planners_of_one_run_or_of_two(tmp_path):
    fast = "package:Fast"
    run = write_run(tmp_path / "run", {fast: 8.0, "slow": 12.0})
    alone = write_run(tmp_path / "alone", {"slow": 12.0})
    for b in (f"{run}:slow", alone):
        result = invoke("compare", f"{run}:{fast}", b)
        assert result.exit_code == 0, result.output
        assert "| better |" in result.stdout
        assert "the same starts and noise" in result.stdout
        assert "± 0.6" in result.stdout, "the margin is told"


def test_a_contact_may_count_as_a_failure(tmp_path):
    """The faster one touches everything: it is better, and it is worse."""
    run = write_run(tmp_path / "run", {"careful": 12.0}, contacts="0")
    other = write_run(tmp_path / "other", {"careless": 8.0}, contacts="1")
    options = ("--metric", "time_s", "--metric", "time_contact_fails_s", "--json")
    held = json.loads(invoke("compare", other, run, *options).stdout)["metrics"]
    assert held["time_s"]["verdict"] == "better"
    assert held["time_contact_fails_s"]["verdict"] == "worse"
    assert held["time_contact_fails_s"]["a"] == LIMIT_S
    assert held["time_contact_fails_s"]["b"] == held["time_s"]["b"]
    unknown = write_run(tmp_path / "unknown", {"who": 8.0}, contacts="")
    with pytest.raises(
        HlsdError, match=r"no run .* has a value of time_contact_fails_s"
    ):
        load_side(str(unknown), ["time_contact_fails_s"])


def test_json_has_what_the_table_has(tmp_path):
    run = write_run(tmp_path / "run", {"a": 8.0, "b": 12.0})
    options = ("--metric", "time_s", "--metric", "success", "--json")
    result = invoke("compare", f"{run}:a", f"{run}:b", *options)
    held = json.loads(result.stdout)
    time_s = held["metrics"]["time_s"]
    assert time_s["verdict"] == "better"
    assert time_s["difference"] == pytest.approx(time_s["a"] - time_s["b"])
    assert time_s["interval_95"][0] < time_s["difference"] < time_s["interval_95"][1]
    assert time_s["margin"] == pytest.approx(0.05 * time_s["b"])
    assert (time_s["worlds"], time_s["a_runs"]) == (12, 24)
    success = held["metrics"]["success"]
    assert success["verdict"] == "inconclusive", "12 worlds are too few for 2 points"
    assert success["interval_95"][0] < 0 == success["difference"]
    itself = json.loads(invoke("compare", f"{run}:a", f"{run}:a", *options).stdout)
    for metric in itself["metrics"].values():
        assert (metric["verdict"], metric["same_runs"]) == ("equivalent", True)
        assert metric["interval_95"] is None
    assert held["a"]["planner"] == "a"


def test_bad_input_is_one_clear_line(tmp_path, monkeypatch, capsys):
    run = write_run(tmp_path / "run", {"a": 8.0, "b": 12.0})
    one = write_run(tmp_path / "one", {"a": 8.0})
    other = write_run(tmp_path / "other", {"a": 8.0}, suite="elsewhere")
    a = f"{run}:a"
    for arguments, fragments in (
        ((run, one), ("(a, b)", "say which")),
        ((f"{run}:c", one), ("'c'", "known are a, b")),
        ((one, tmp_path / "none"), ("no run at", "FOLDER:PLANNER")),
        ((one, other), ("differ in their suite", "elsewhere")),
        ((a, one, "--metric", "times"), ("'times'", "did you mean 'time_s'")),
        ((a, one, "--metric", "score_4_8"), ("not defined under", "barn2022")),
        ((a, one, "--metric", "min_clearance_m"), ("no run", "min_clearance_m")),
        ((a, one, "--margin", "wide"), ("'wide'", "5%")),
        (
            (a, one, "--margin", "1", "--metric", "time_s", "--metric", "success"),
            ("5%",),
        ),
        ((a, one, "--seed", "-1"), ("--seed -1",)),
    ):
        monkeypatch.setattr(sys, "argv", ["hlsd", "compare", *map(str, arguments)])
        with pytest.raises(SystemExit) as stop:
            main()
        out, err = capsys.readouterr()
        assert (stop.value.code, out) == (2, "")
        assert len(err.splitlines()) == 1, err
        for fragment in fragments:
            assert fragment in err
