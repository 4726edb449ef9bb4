"""The Challenge's out.txt: our runs written as it, its runs in our tables."""

import csv
import hashlib
import json
import math
from dataclasses import replace

import numpy as np
import pytest

import hlsd.run.work as work_module
from hlsd.analysis.agreement import compare
from hlsd.analysis.challenge import LastColumn, export_run, import_runs
from hlsd.analysis.reference import load_reference
from hlsd.analysis.run_trials import load_run
from hlsd.analysis.runs import join_runs, load_episodes
from hlsd.analysis.summary import summarise
from hlsd.analysis.trial_files import read_out_txt
from hlsd.core.description import RobotLimits
from hlsd.core.errors import HlsdError
from hlsd.core.executor import Serial
from hlsd.data.worlds import load_suite
from hlsd.report.summary import summary_markdown
from hlsd.run.bench import Bench, run_bench
from hlsd.run.episode import Episode, Outcome, Planning
from hlsd.run.protocol import get_protocol
from hlsd.run.recording import Record
from hlsd.run.row import COLUMNS
from tests.cli.test_cli import assert_refused, hlsd
from tests.conftest import shared

PLANNER = "examples.follow_path:FollowPath"
UNKNOWN = (
    "robot",
    "robot_version",
    "seed",
    "contacts",
    "contact_time_s",
    "path_length_m",
    "sim_steps",
    "sim_time_s",
    "wall_s",
    "replans",
    "ticks",
    "min_clearance_m",
    "jerk_m_s3",
    "recoveries",
    "time_to_contact_s",
    "contact_distance_m",
    "shortest_length_m",
)
# World, success, collided, timeout, time; failures of each kind among them.
RUNS = (
    (6, 1, 0, 0, 9.5),
    (0, 1, 0, 0, 31.25),
    (6, 0, 1, 0, 4.75),
    (0, 0, 0, 1, 100.0123),
    (6, 1, 0, 0, 99.0),
    (12, 1, 0, 0, 20.0),
    (12, 0, 1, 1, 100.2),
)


def optimal_s(protocol, world):
    length = get_protocol(protocol).official_length_m(load_suite("barn300")[world])
    return length / 2


def out_txt(path, runs=RUNS, protocol="barn2022", ratio=False):
    """An out.txt of these runs, its last column by the plain formulas."""
    low = 4 if protocol == "barn2022" else 2
    lines = []
    for world, success, collided, timeout, time_s in runs:
        optimal = optimal_s(protocol, world)
        score = optimal / min(max(time_s, low * optimal), 8 * optimal)
        metric = success * (time_s / optimal if ratio else score)
        lines.append(
            f"{world} {success} {collided} {timeout} {time_s:.4f} {metric:.4f}\n"
        )
    path.write_text("".join(lines), encoding="utf-8")
    return path


def rows_of(folder):
    with (folder / "episodes.csv").open(newline="", encoding="utf-8") as file:
        return list(csv.DictReader(file))


@pytest.fixture
def imported(tmp_path):
    out = tmp_path / "gazebo"
    import_runs(out_txt(tmp_path / "out.txt"), "gazebo-dwa", "barn2022", "barn300", out)
    return out


@pytest.mark.parametrize("protocol", ["barn2022", "barn2024"])
@pytest.mark.parametrize("ratio", [False, True])
def test_the_last_column_is_told_by_computing_both(tmp_path, protocol, ratio):
    path = out_txt(tmp_path / "out.txt", protocol=protocol, ratio=ratio)
    metric = import_runs(path, "dwa", protocol, "barn300", tmp_path / "run")
    assert metric.meaning is (LastColumn.TIME_RATIO if ratio else LastColumn.SCORE)
    manifest = json.loads((tmp_path / "run" / "run.json").read_text())
    assert manifest["imported"]["metric"] == metric.meaning.value


def test_nobody_can_tell_the_last_column_without_a_success(tmp_path):
    path = out_txt(tmp_path / "out.txt", [run for run in RUNS if not run[1]])
    metric = import_runs(path, "dwa", "barn2022", "barn300", tmp_path / "run")
    assert metric.meaning is LastColumn.EITHER
    row = summarise(load_episodes(tmp_path / "run")).iloc[0]
    assert row["success"] == row["score_4_8"] == 0
    assert math.isnan(row["mean_success_time_s"])
    text = summary_markdown(load_episodes(tmp_path / "run"))
    assert "| none |" in text
    assert "nan" not in text


def test_imported_rows_say_what_the_file_says_and_nothing_else(imported):
    rows = rows_of(imported)
    assert list(rows[0]) == list(COLUMNS)
    assert [
        (row["world"], row["trial"], row["outcome"], row["time_s"]) for row in rows
    ] == [
        ("0", "0", "success", "31.2500"),
        ("0", "1", "timeout", "100.0123"),
        ("6", "0", "success", "9.5000"),
        ("6", "1", "collision", "4.7500"),
        ("6", "2", "success", "99.0000"),
        ("12", "0", "success", "20.0000"),
        ("12", "1", "collision", "100.2000"),
    ]
    for row in rows:
        assert (row["suite"], row["planner"]) == ("barn300", "gazebo-dwa")
        assert row["protocol"] == "barn2022"
        assert float(row["official_length_m"]) == pytest.approx(
            2 * optimal_s("barn2022", int(row["world"])), abs=1e-6
        )
        for name in UNKNOWN:
            assert row[name] == "", name


def test_the_table_of_an_imported_run(imported):
    episodes = load_episodes(imported)
    row = summarise(episodes).iloc[0]
    assert row["n"] == 7
    assert row["success"] == pytest.approx(4 / 7)
    assert row["collision"] == pytest.approx(2 / 7)
    assert row["timeout"] == pytest.approx(1 / 7)
    assert row["mean_success_time_s"] == pytest.approx((31.25 + 9.5 + 99 + 20) / 4)
    assert row["mean_time_s"] == pytest.approx((31.25 + 9.5 + 99 + 20 + 300) / 7)
    assert math.isnan(row["contact_free"]), "not counted is not free of contacts"
    assert math.isnan(row["mean_time_contact_fails_s"])
    assert math.isnan(row["sd_time_contact_fails_s"])
    for name, low in (("score_4_8", 4), ("score_2_8", 2)):
        means = []
        for world in (0, 6, 12):
            optimal = optimal_s("barn2022", world)
            scores = [
                success * optimal / min(max(time_s, low * optimal), 8 * optimal)
                for w, success, _, _, time_s in RUNS
                if w == world
            ]
            means.append(sum(scores) / len(scores))
        assert row[name] == pytest.approx(np.mean(means), rel=1e-6)
        # Three worlds: among the resamples is each of them alone.
        assert row[f"{name}_low"] == pytest.approx(min(means), rel=1e-6)
        assert row[f"{name}_high"] == pytest.approx(max(means), rel=1e-6)
    text = summary_markdown(episodes)
    for fragment in (
        "robot unknown",
        "seed unknown",
        "time, failures at limit [s]",
        "counts 100 s",
        "score 4-8",
        "score 2-8",
        "barn2022 is scored by 4-8",
    ):
        assert fragment in text
    assert "contact-free" not in text
    assert "nan" not in text


def test_an_export_is_imported_again_unchanged(imported, tmp_path):
    exported = export_run(imported)
    assert (exported.runs, exported.errors) == (7, 0)
    path = tmp_path / "again.txt"
    path.write_text(exported.text, encoding="utf-8")
    metric = import_runs(path, "gazebo-dwa", "barn2022", "barn300", tmp_path / "again")
    assert metric.meaning is LastColumn.SCORE
    assert rows_of(tmp_path / "again") == rows_of(imported)


def test_an_imported_run_is_a_run_to_validate(imported, tmp_path):
    ours = load_run(imported)
    assert ours.robot == "unknown"
    assert ours.trials.times_s.max() == 100.0
    reference = load_reference(tmp_path / "out.txt", 100.0)
    agreement = compare(ours.trials, reference.trials, 100.0)
    assert agreement.time.pearson.value == pytest.approx(1)
    assert agreement.time_s.ratio.value == pytest.approx(1)


RECORD = Record(
    world=load_suite("barn300")[0],
    limits=RobotLimits(),
    period_s=0.05,
    motions=np.zeros((2, 6)),
    commands=np.zeros((1, 2)),
    modes=np.zeros(1, np.uint8),
    local_goals=np.zeros((1, 2)),
    contact_times_s=np.zeros(2),
    mover_contact_times_s=np.zeros(2),
    movers_begin_s=math.nan,
    movers_waited_s=np.empty((2, 0)),
    paths=(),
)
EPISODE = Episode(
    outcome=Outcome.SUCCESS,
    reason="",
    time_s=12.34567,
    contacts=0,
    mover_contacts=0,
    movers_begin_s=math.nan,
    contact_time_s=0.0,
    time_to_contact_s=math.nan,
    path_length_m=11.0,
    replans=3,
    sim_steps=2500,
    sim_time_s=12.5,
    wall_s=0.2,
    record=RECORD,
    planning=Planning(0.1, 0.4, 0.5, 0.9, 0),
)


def drives(outcomes):
    """In place of driving: an episode for each trial."""

    def run_episode(course, planner, seed, trial):
        outcome, time_s = outcomes[trial]
        reason = "exception: KeyError: 'x'" if outcome is Outcome.ERROR else ""
        return replace(EPISODE, outcome=outcome, time_s=time_s, reason=reason)

    return run_episode


@pytest.mark.parametrize("protocol", ["barn2022", "barn2024"])
def test_our_runs_are_written_as_the_challenge_s(tmp_path, monkeypatch, protocol):
    """Each outcome, and back: the same outcomes, times to the printed digits."""
    outcomes = (
        (Outcome.SUCCESS, 12.34567),
        (Outcome.COLLISION, 3.05),
        (Outcome.TIMEOUT, 100.0),
        (Outcome.ERROR, 100.0),
    )
    monkeypatch.setattr(work_module, "run_episode", drives(outcomes))
    bench = Bench((PLANNER,), worlds="0,150", trials=4, protocol=protocol)
    folder = run_bench(bench, tmp_path / "run", jobs=Serial())
    exported = export_run(folder)
    assert (exported.planner, exported.runs, exported.errors) == (PLANNER, 8, 2)
    optimal = optimal_s(protocol, 0)
    score = get_protocol(protocol).score
    best = optimal / max(12.3457, score.lowest * optimal)
    assert exported.text.splitlines()[:4] == [
        f"0 1 0 0 12.3457 {best:.4f}",
        "0 0 1 0 3.0500 0.0000",
        "0 0 0 1 100.0000 0.0000",
        "0 0 0 1 100.0000 0.0000",
    ]
    path = tmp_path / "out.txt"
    path.write_text(exported.text, encoding="utf-8")
    assert len(read_out_txt(path)) == 8
    import_runs(path, "back", protocol, "barn300", tmp_path / "back")
    ours, theirs = rows_of(folder), rows_of(tmp_path / "back")
    for mine, back in zip(ours, theirs, strict=True):
        for name in ("world", "trial", "protocol", "time_s", "official_length_m"):
            assert back[name] == mine[name]
        was = "timeout" if mine["outcome"] == "error" else mine["outcome"]
        assert back["outcome"] == was
    one, other = (summarise(load_episodes(f)) for f in (folder, tmp_path / "back"))
    for name in ("score_4_8", "score_2_8", "mean_time_s", "success_high"):
        assert one[name].tolist() == other[name].tolist()
    text = summary_markdown(load_episodes(folder))
    assert (
        "2 runs ended in a planner's error, the first: exception: KeyError: 'x'" in text
    )


def test_runs_stand_in_one_table(imported, tmp_path, monkeypatch):
    monkeypatch.setattr(work_module, "run_episode", drives([(Outcome.SUCCESS, 9.0)]))
    settings = Bench((PLANNER,), worlds="0", trials=1, protocol="barn2022")
    ours = run_bench(settings, tmp_path / "ours", jobs=Serial())
    joined = join_runs([ours, imported])
    assert summarise(joined)["planner"].tolist() == [PLANNER, "gazebo-dwa"]
    assert summarise(joined)["n"].tolist() == [1, 7]
    different = (
        f"Not all drove in the same worlds, so rows differ by that: {PLANNER} in 1"
    )
    assert "Not all" not in summary_markdown(load_episodes(imported))
    for fragment in ("robot jackal 1", "unknown", "seed 0, unknown", different):
        assert fragment in summary_markdown(joined)
    ideal = replace(settings, robot="jackal-ideal")
    other = run_bench(ideal, tmp_path / "ideal", jobs=Serial())
    names = summarise(join_runs([ours, other]))["planner"].tolist()
    assert names == [f"{PLANNER} (ours)", f"{PLANNER} (ideal)"]
    with pytest.raises(HlsdError, match="given twice"):
        join_runs([ours, ours])
    old = run_bench(
        replace(settings, protocol="hlsd2021"), tmp_path / "old", jobs=Serial()
    )
    with pytest.raises(HlsdError, match=r"protocol \(barn2022, hlsd2021\)"):
        join_runs([ours, old])
    assert rows_of(old)[0]["official_length_m"] == ""
    assert "score" not in summary_markdown(load_episodes(old))


@pytest.mark.parametrize(
    ("columns", "place"), [("{:.4f} 5.00", 6), ("8.1166 {:.4f}", 7), ("{:.4f}", 6)]
)
def test_the_metric_is_found_among_more_columns(tmp_path, columns, place):
    column = columns.format
    lines = f"0 1 0 0 40.0 {column(0.1679)}\n6 0 1 0 5.0 {column(0)}\n"
    path = tmp_path / "o.txt"
    path.write_text("\ufeff" + lines, encoding="utf-8")
    metric = import_runs(path, "dwa", "barn2022", "barn300", tmp_path / "run")
    assert metric.meaning is LastColumn.SCORE
    assert (metric.place, metric.columns) == (place, 5 + len(columns.split()))
    assert ("no other column" in metric.described("barn2022")) == (" " in columns)
    source = json.loads((tmp_path / "run" / "run.json").read_text())["imported"]
    assert source["column"] == str(place)
    assert source["sha256"] == hashlib.sha256(path.read_bytes()).hexdigest()


BAD = {
    "": ("is empty",),
    "0 1 0 0 22.2\n": ("line 1", "5 fields"),
    "\n300 1 0 0 22.2 0.1\n": ("line 2", "world 300", "suite 'barn300'", "DynaBARN's"),
    "360 1 0 0 22.2 0.1\n": ("line 1", "world 360", "one of suite 'barn300'"),
    "0 1 0 0 40.0 0.3 0.4\n": ("line 1", "metric 0.3 or 0.4", "0.1679"),
    "0 0 0 1 100.1 0\n0 0 0 0 55.5 0\n": ("line 2", "timeout 0", "one of the three"),
    "0 1 0 0 100.5 0.125\n": ("line 1", "success after 100.5 s", "100 s"),
    "0 0 0 1 100.1 0\n0 1 0 0 40.0 0.3\n": ("line 2", "metric 0.3", "0.1679", "AT/OT"),
    # A score in one line, AT/OT in the other.
    "0 1 0 0 40.0 0.1679\n0 1 0 0 40.0 5.956\n": ("line 2", "metric 5.956"),
    "0 0 1 0 5.0 0.2\n": ("line 1", "metric 0.2", "0.0000"),
}


@pytest.mark.parametrize("text", BAD, ids=repr)
def test_what_does_not_fit_is_refused_with_its_line(tmp_path, text):
    path = tmp_path / "bad.txt"
    path.write_text(text, encoding="utf-8")
    out = tmp_path / "run"
    with pytest.raises(HlsdError) as caught:
        import_runs(path, "dwa", "barn2022", "barn300", out)
    message = str(caught.value)
    assert "\n" not in message
    for fragment in (str(path), *BAD[text]):
        assert fragment in message
    assert not out.exists(), "nothing is written"


def test_import_export_and_report_as_a_user_runs_them(tmp_path):
    path, run, again = out_txt(tmp_path / "o.txt"), tmp_path / "run", tmp_path / "a.txt"
    order = ("import", path, "--planner", "gazebo-dwa", "--protocol")
    result = hlsd(*order, "barn2022", "--out", run)
    assert result.returncode == 0, result.stderr
    assert "last column of o.txt: the score of barn2022" in result.stdout
    assert (run / "summary.md").read_text(encoding="utf-8") in result.stdout
    assert (run / "time_by_world.png").exists()
    result = hlsd("export", run, "--out", again)
    assert result.returncode == 0, result.stderr
    assert sorted(again.read_text().splitlines()) == sorted(
        [*path.read_text().splitlines()[:-1], "12 0 1 0 100.2000 0.0000"]
    )
    before = again.read_bytes()
    assert_refused(hlsd("export", run, "--out", again), "exists")
    assert again.read_bytes() == before
    assert (run / "summary.md").read_text() in hlsd("report", run).stdout
    assert_refused(hlsd(*order, "barn2022", "--out", run), "is not empty")
    assert_refused(
        hlsd(*order, "hlsd2021", "--out", tmp_path / "no"),
        "'hlsd2021'",
        "barn2022 or barn2024",
    )
    assert_refused(hlsd("report", tmp_path / "none"), "no run at")


def test_a_run_under_another_protocol_is_not_exported(tmp_path, monkeypatch):
    monkeypatch.setattr(work_module, "run_episode", drives([(Outcome.SUCCESS, 9.0)]))
    folder = run_bench(
        Bench((PLANNER,), worlds="0", trials=1), tmp_path / "run", Serial()
    )
    with pytest.raises(HlsdError, match=r"'hlsd2021'.*want barn2022 or barn2024"):
        export_run(folder)


def test_gazebo_s_runs_of_2022_in_our_tables(tmp_path):
    path = shared("reference", "gazebo_2022_dwa_out.txt")
    metric = import_runs(path, "dwa", "barn2022", "barn300", tmp_path / "run")
    assert metric.meaning is LastColumn.TIME_RATIO
    runs = np.loadtxt(path)
    row = summarise(load_episodes(tmp_path / "run")).iloc[0]
    assert row["n"] == len(runs)
    for column, name in enumerate(("success", "collision", "timeout"), 1):
        assert row[name] == pytest.approx(runs[:, column].mean())
    reached = runs[:, 1] == 1
    assert row["mean_success_time_s"] == pytest.approx(runs[reached, 4].mean())
    # Scores by the file's own AT/OT, in place of our path lengths.
    ratio = np.where(reached, runs[:, 5], np.inf)
    for name, low in (("score_4_8", 4), ("score_2_8", 2)):
        scores = np.where(reached, 1 / np.clip(ratio, low, 8), 0)
        worlds = np.unique(runs[:, 0])
        mean = np.mean([scores[runs[:, 0] == world].mean() for world in worlds])
        assert row[name] == pytest.approx(mean, abs=2e-5)
