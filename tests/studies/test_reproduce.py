"""The paper's tables and figure, and the whole experiment: once, resumed, refused."""

import csv
import io
import json
import re
import sys

import numpy as np
import pandas as pd
import pytest
from matplotlib.collections import PathCollection
from matplotlib.colors import to_hex
from typer.testing import CliRunner

import hlsd.run.work as work_module
import hlsd.studies.behaviour as behaviour_module
import hlsd.studies.paper as paper_module
import hlsd.studies.pipeline as pipeline_module
import hlsd.studies.reproduce as reproduce_module
import hlsd.studies.steps as steps_module
from hlsd.analysis.runs import load_episodes, planning_times
from hlsd.analysis.summary import summarise
from hlsd.cli.app import app
from hlsd.core.errors import HlsdError
from hlsd.core.progress import Remaining
from hlsd.data.motion_log import MotionLog
from hlsd.data.worlds import generate_suite
from hlsd.learning.policy import Policy, shipped_policy
from hlsd.learning.train_many import Trained
from hlsd.planners.registry import BUILT_IN, FLOOR
from hlsd.report.drawing import COLOURS
from hlsd.run.row import COLUMNS, TEXT_COLUMNS
from hlsd.studies.behaviour import behaviour
from hlsd.studies.course import course_table
from hlsd.studies.paper import (
    BESIDE,
    PUBLISHED,
    STRICT_ROW,
    TITLES,
    Dataset,
    Learning,
    plot_regression,
    table_one,
)
from hlsd.studies.reproduce import default_folder, reproduce
from tests.data.small_course import store_small_course

# Time [s] of each run, by planner and world; None is a timeout.
RUNS = {
    "dwa": {3: (10.0, 20.0), 5: (None, None), 8: (9.0, 11.0)},
    "hlsd10": {3: (6.0, 8.0), 5: (7.0, 9.0), 8: (5.0, 7.0)},
    "lfh10": {3: (12.0, None), 5: (None, None), 8: (12.0, 14.0)},
    "pursuit": {3: (5.0, 5.0), 5: (6.0, 6.0), 8: (None, 5.0)},
    "mine": {3: (1.0, 1.0), 5: (1.0, 1.0), 8: (1.0, 1.0)},
}


def rows(runs=RUNS):
    episodes, timing = [], []
    for planner, worlds in runs.items():
        for world, times in worlds.items():
            for trial, time_s in enumerate(times):
                row = dict.fromkeys(COLUMNS, 0) | dict.fromkeys(TEXT_COLUMNS, "")
                row |= {"suite": "s", "protocol": "hlsd2021", "planner": planner}
                row |= {"world": world, "trial": trial, "robot": "jackal", "reason": ""}
                row["outcome"] = "timeout" if time_s is None else "success"
                row["time_s"] = 33.0 if time_s is None else time_s
                row["contacts"] = 3 * int((planner, world, trial) == ("hlsd10", 5, 0))
                row["ticks"] = (100, 300)[trial]
                row["recovery_ticks"] = (0, 30)[trial] if planner == "dwa" else 0
                row["turn_ticks"] = (20, 0)[trial] if planner == "lfh10" else 0
                row["replans"], row["path_length_m"] = (2, 5)[trial], (6.0, 7.0)[trial]
                episodes.append(row)
                # 0.1 s for 100 ticks in the first trial, 0.6 s for 300 in the second.
                spent = {"planning_wall_s": (0.1, 0.6)[trial], "wall_s": 1.0}
                timing.append(
                    {"planner": planner, "world": world, "trial": trial}
                    | {"ticks": (100, 300)[trial]}
                    | spent
                )
    return pd.DataFrame(episodes), pd.DataFrame(timing)


@pytest.fixture(scope="module")
def table():
    return table_one(*rows())


def test_the_paper_s_numbers_stand_in_the_paper_s_order():
    assert [entry.title for entry in PUBLISHED.values()] == [
        "DWA",
        "LfH 0.4",
        "LfH 1.0",
        "HLSD 0.4",
        "HLSD 1.0",
    ]
    simulated = [(e.simulated.mean_s, e.simulated.sd_s) for e in PUBLISHED.values()]
    assert simulated == [
        (17.0, 12.6),
        (13.5, 6.4),
        (26.7, 15.0),
        (13.4, 9.8),
        (8.5, 6.3),
    ]
    assert PUBLISHED["lfh10"].physical is None


def test_table_one_is_what_a_hand_computes(table):
    names = ["dwa", "lfh10", "hlsd10", "pursuit"]
    assert list(table.measured) == names, "ours alone left out"
    dwa, hlsd10 = table.measured["dwa"], table.measured["hlsd10"]
    # Failures count 50 s: 10, 20, 50, 50, 9, 11.
    assert dwa.time.mean_s == pytest.approx(150 / 6)
    squares = 15**2 + 5**2 + 25**2 + 25**2 + 16**2 + 14**2
    assert dwa.time.sd_s == pytest.approx((squares / 5) ** 0.5)
    assert dwa.success == pytest.approx(4 / 6)
    assert hlsd10.time.mean_s == pytest.approx(7.0)
    assert hlsd10.time.sd_s == pytest.approx(2**0.5)
    assert (dwa.contact_free, hlsd10.contact_free) == (1.0, pytest.approx(5 / 6))
    # 50 instead of 7 s for the run that touched something.
    assert hlsd10.strict.mean_s == pytest.approx((42 - 7 + 50) / 6)
    squares = sum((t - 85 / 6) ** 2 for t in (6, 8, 50, 9, 5, 7))
    assert hlsd10.strict.sd_s == pytest.approx((squares / 5) ** 0.5)
    assert dwa.strict == dwa.time, "it touched nothing"
    assert dwa.strict_interval_s == dwa.interval_s
    assert dwa.runs == 6
    # 0.7 s for 400 ticks; the mean of the trials' ratios would be 1.5 ms.
    assert dwa.planning_ms == pytest.approx(1.75)
    summary = summarise(rows()[0]).set_index("planner")
    assert dwa.interval_s == (
        summary.loc["dwa", "mean_time_low_s"],
        summary.loc["dwa", "mean_time_high_s"],
    )


def cells(lines, separator):
    return [[cell.strip() for cell in line.split(separator)] for line in lines]


def test_markdown_latex_and_csv_agree(table):
    markdown = cells(
        [line[1:-1] for line in table.markdown().splitlines() if line.startswith("|")],
        "|",
    )
    del markdown[1]  # the rule below the head
    plain = table.latex().replace("$\\pm$", "±").replace("\\dots{}", "…")
    plain = plain.replace(" -- ", " – ")
    latex = cells(
        [
            line.removesuffix("\\\\").replace("\\%", "%")
            for line in plain.splitlines()
            if line.endswith("\\\\")
        ],
        "&",
    )
    assert latex == markdown
    assert [len(row) for row in markdown] == [8] * 10
    assert markdown[5][0] == STRICT_ROW
    assert "our reading, found after the result" in STRICT_ROW
    assert table.markdown().count("found after the result") == 2, "row and footnote"
    assert "not simulated here" in markdown[3][0]
    records = {r["planner"]: r for r in csv.DictReader(io.StringIO(table.csv()))}
    assert list(records) == list(TITLES) == [*PUBLISHED, "pursuit", "eband"]
    for column, (name, record) in enumerate(records.items(), start=1):
        shown = [row[column] for row in markdown[1:]]
        number = {
            key: value and float(value) for key, value in list(record.items())[1:]
        }
        pair = "{:.1f} ± {:.1f}".format
        if name in PUBLISHED:
            assert shown[0] == pair(
                number["paper_simulated_mean_s"], number["paper_simulated_sd_s"]
            )
            assert shown[2] == (
                pair(number["paper_physical_mean_s"], number["paper_physical_sd_s"])
                if number["paper_physical_mean_s"]
                else "all failed"
            )
        else:
            assert shown[0] == shown[2] == "–", "the paper says nothing of it"
            assert number["paper_simulated_mean_s"] == ""
            assert number["paper_physical_sd_s"] == ""
        if name in ("lfh04", "hlsd04", "eband"):
            assert {shown[1], *shown[3:]} == {"not run"}
            assert number["n"] == number["mean_time_s"] == ""
            assert number["mean_time_contact_fails_s"] == ""
            continue
        assert shown[1] == pair(number["mean_time_s"], number["sd_time_s"])
        low, high = number["mean_time_low_s"], number["mean_time_high_s"]
        assert shown[3] == f"{low:.1f} … {high:.1f}"
        strict = number["mean_time_contact_fails_s"]
        assert shown[4] == pair(strict, number["sd_time_contact_fails_s"])
        low, high = (
            number[f"mean_time_contact_fails_{end}_s"] for end in ("low", "high")
        )
        assert shown[5] == f"{low:.1f} … {high:.1f}"
        assert shown[6] == f"{100 * number['success']:.1f} %"
        assert shown[7] == f"{100 * number['contact_free']:.1f} %"
        assert shown[8] == f"{number['planning_ms_per_tick']:.3f}"


def test_who_is_driven_beside_the_papers_planners_is_built_in_and_said():
    """The floor at least, under a title of its own and with a line that says what."""
    assert FLOOR in BESIDE
    assert BESIDE[FLOOR] == "floor: Pursuit"
    assert not set(BESIDE) & set(PUBLISHED)
    assert len(set(TITLES.values())) == len(TITLES)
    (note,) = re.findall("Not the paper's: .*", table_one(*rows()).markdown())
    for name in BESIDE:
        assert f"{name} ({BUILT_IN[name].summary})" in note


def test_one_more_planner_beside_them_is_one_more_name(monkeypatch):
    monkeypatch.setattr(paper_module, "BESIDE", {**BESIDE, "dwa05": "DWA 0.5"})
    for module in (paper_module, behaviour_module):
        monkeypatch.setattr(module, "TITLES", {**TITLES, "dwa05": "DWA 0.5"})
    runs = rows({**RUNS, "dwa05": RUNS["hlsd10"]})
    table, drove = table_one(*runs), behaviour(runs[0])
    (head, _, _, ours, *_) = table.markdown().partition("\n\n")[2].splitlines()
    assert head.endswith("| HLSD 1.0 | floor: Pursuit | E-Band | DWA 0.5 |")
    assert ours.endswith("| 7.0 ± 1.4 | 12.8 ± 18.2 | not run | 7.0 ± 1.4 |")
    assert table.csv().splitlines()[-1].startswith("dwa05,,,,,6,7.0,")
    assert BUILT_IN["dwa05"].summary in table.markdown()
    assert [*drove.planners][-2:] == ["pursuit", "dwa05"]
    assert "| DWA 0.5 |" in drove.markdown()


def test_latex_is_balanced_and_comments_keep_the_notes(table):
    lines = table.latex().splitlines()
    for command in ("\\begin{tabular}{lccccccc}", "\\toprule", "\\bottomrule"):
        assert lines.count(command) == 1
    assert lines[-1] == "\\end{tabular}"
    body = [line for line in lines if not line.startswith("%")]
    assert all(ord(letter) < 128 for letter in "".join(body))
    assert not re.search(r"(?<!\\)%", "".join(body))


def test_behaviour_is_what_a_hand_computes():
    table = behaviour(rows()[0])
    assert list(table.planners) == ["dwa", "lfh10", "hlsd10", "pursuit"]
    dwa, lfh10, hlsd10, _ = table.planners.values()
    # 30 of 400 ticks in each world; the mean of the trials' shares would be 0.05.
    assert (dwa.recovery, dwa.turn_in_place) == (pytest.approx(90 / 1200), 0.0)
    assert (lfh10.recovery, lfh10.turn_in_place) == (0.0, pytest.approx(60 / 1200))
    assert (hlsd10.contacts, hlsd10.contact_free) == (0.5, pytest.approx(5 / 6))
    assert (hlsd10.replans, hlsd10.path_m) == (3.5, 6.5)
    lines = table.markdown().splitlines()
    assert lines[4] == "| HLSD 1.0 | 0.50 | 83.3 % | 0.0 % | 0.0 % | 3.5 | 6.50 |"
    assert lines[2].startswith("| DWA | 0.00 | 100.0 % | 7.5 % |")
    records = {r["planner"]: r for r in csv.DictReader(io.StringIO(table.csv()))}
    assert float(records["dwa"]["recovery"]) == dwa.recovery


def test_the_physical_row_stands_beside_a_course_that_is_ours():
    """Times count failures at the limit; where all failed, that is said."""
    table = course_table(rows()[0])
    assert list(table.planners) == ["dwa", "lfh10", "hlsd10"]
    dwa, lfh10, hlsd10 = table.planners.values()
    assert dwa.time.mean_s == pytest.approx(150 / 6)  # 50 s for each failure
    assert (dwa.success, hlsd10.success) == (pytest.approx(4 / 6), 1.0)
    assert (hlsd10.drove.contacts, lfh10.drove.contacts) == (0.5, 0.0)
    markdown = cells(
        [line[1:-1] for line in table.markdown().splitlines() if line.startswith("|")],
        "|",
    )
    assert markdown[0] == ["", "DWA", "LfH 1.0", "HLSD 1.0"]
    paper, ours = markdown[2:4]
    assert paper == [
        "paper, its physical course: time [s]",
        "78.8 ± 10.0",
        "all failed",
        "45.4 ± 0.4",
    ]
    assert ours[0] == "hlsd, a simulated course of ours: time [s]"
    assert ours[3] == "7.0 ± 1.4"
    assert "not a copy of it" in table.markdown()
    records = {r["planner"]: r for r in csv.DictReader(io.StringIO(table.csv()))}
    assert records["lfh10"]["paper_physical_mean_s"] == ""
    assert float(records["dwa"]["mean_time_s"]) == dwa.time.mean_s
    lost = {"lfh10": {0: (None, None)}, "dwa": {0: (9.0, 9.0)}}
    assert "| 9.0 ± 0.0 | all failed |" in course_table(rows(lost)[0]).markdown()
    with pytest.raises(HlsdError, match="none of the paper's planners"):
        course_table(rows({"mine": RUNS["mine"]})[0])


def test_data_sets_stand_beside_the_paper_s():
    learning = {
        "hlsd10": Learning("1.0", 12_585, 151_020, 506.2, 101.6),
        "lfh04": Learning("0.4", 100, 100, None, None),
    }
    table = Dataset(learning)
    lines = table.markdown().splitlines()
    assert [line.split(" | ", 1)[1] for line in lines[2:5]] == [
        "1.0 | 505.0 | 12 585 | 151 020 | 12 | < 180 |",
        "1.0 | 506.2 | 12 585 | 151 020 | 12 | 102 |",
        "0.4 | - | 100 | 100 | 1 | - |",
    ]
    records = list(csv.DictReader(io.StringIO(table.csv())))
    assert [record["planner"] for record in records] == ["paper", "hlsd10", "lfh04"]
    assert [record["training_s"] for record in records] == ["", "101.6", ""]
    assert [record["driven_s"] for record in records] == ["505.0", "506.2", ""]


def test_a_run_without_the_paper_s_planners_is_refused():
    mine = {name: RUNS[name] for name in ("pursuit", "mine")}
    with pytest.raises(HlsdError, match="none of the paper's planners: dwa, lfh04"):
        table_one(*rows(mine))
    with pytest.raises(HlsdError, match="run 'dwa', too"):
        plot_regression(rows(mine)[0], None)
    with pytest.raises(HlsdError, match="lacks 'dwa'"):
        table_one(rows()[0], rows(mine)[1])


def test_missing_or_foreign_timing_is_refused(tmp_path):
    with pytest.raises(HlsdError, match=r"timing\.csv"):
        planning_times(tmp_path)
    (tmp_path / "timing.csv").write_text("a,b\n1,2\n")
    with pytest.raises(HlsdError, match="lacks 'planner'"):
        planning_times(tmp_path)


def ends(line):
    return line.get_xydata()[[0, -1]]


def test_the_figure_orders_worlds_by_dwa_and_fits_lines(monkeypatch):
    drawn = []
    monkeypatch.setattr(paper_module, "save_figure", lambda *args: drawn.append(args))
    plot_regression(rows()[0], None)
    (axes,) = drawn[0][0].axes
    lines = {line.get_label(): line for line in axes.lines}
    # DWA's means are 15 (world 3), 50 (world 5) and 10 (world 8): 8, 3, 5.
    np.testing.assert_allclose(lines["DWA"].get_ydata(), [10, 15, 50])
    dots = {
        to_hex(drawn.get_facecolor()[0]): drawn.get_offsets()
        for drawn in axes.collections
        if isinstance(drawn, PathCollection)
    }
    assert len(dots) == 2, "dots for LfH 1.0 and HLSD 1.0"
    np.testing.assert_allclose(
        dots[to_hex(COLOURS["hlsd10"])], [[0, 6], [1, 7], [2, 8]]
    )
    np.testing.assert_allclose(ends(lines["HLSD 1.0"]), [[0, 6], [2, 8]])
    # 13, 31, 50: slope 18.5 through the mean 94 / 3.
    np.testing.assert_allclose(
        ends(lines["LfH 1.0"]), [[0, 94 / 3 - 18.5], [2, 94 / 3 + 18.5]]
    )
    for title, name in (("DWA", "dwa"), ("LfH 1.0", "lfh10"), ("HLSD 1.0", "hlsd10")):
        assert lines[title].get_color() == COLOURS[name]


@pytest.mark.parametrize("worlds", [(3, 5, 8), (3,)])
def test_the_figure_is_written_whole(worlds, tmp_path):
    runs = {name: {w: times[w] for w in worlds} for name, times in RUNS.items()}
    plot_regression(rows(runs)[0], tmp_path / "figure.png")
    assert [path.name for path in tmp_path.iterdir()] == ["figure.png"]
    assert (tmp_path / "figure.png").read_bytes()[:4] == b"\x89PNG"


@pytest.fixture(scope="module")
def tiny(tmp_path_factory):
    """A suite of 7 worlds, of which a quick reproduction takes the first and last."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HLSD_HOME", str(tmp_path_factory.mktemp("home")))
        generate_suite("tiny", 7, seed=1)
        yield "tiny"


@pytest.fixture
def stages(monkeypatch):
    """Collecting, training and driving that take no time; what was called."""
    calls = []

    def collect(preset, law, seed, robot, progress):
        calls.append(f"collect {preset}")
        progress("driving", 1, 1)
        recipe = json.dumps({"preset": preset})
        poses, commands = np.zeros((3, 3)), np.zeros((3, 2))
        return MotionLog(0.04, poses, commands, robot.name, "1", recipe, 2)

    def train_many(trainings, at_once, finished, progress):
        for number, training in enumerate(trainings):
            planner = training.recipe.planner
            calls.append(f"train {planner}")
            preset = "1.0" if planner.endswith("10") else "0.4"
            assert json.loads(MotionLog.load(training.log).recipe)["preset"] == preset
            progress(number, training.recipe.optimiser.steps, 1)
            policy = Policy.load(shipped_policy(planner), planner)
            finished(number, Trained(policy, 100.0 + number, at_once))

    def run_bench(bench, out, jobs, progress):
        calls.append(out.name)
        assert [name for name, _ in bench.policies] == [
            "hlsd10",
            "lfh10",
            "hlsd04",
            "lfh04",
        ]
        out.mkdir()
        episodes, timing = rows()
        timing.to_csv(out / "timing.csv", index=False)
        episodes.to_csv(out / "episodes.csv", index=False)

    for stage in (collect, train_many, run_bench):
        monkeypatch.setattr(steps_module, stage.__name__, stage)
    monkeypatch.setattr(pipeline_module, "code_digest", lambda code: "c0de")
    return calls


ALL = [
    "collect 1.0",
    "collect 0.4",
    "train hlsd10",
    "train lfh10",
    "train hlsd04",
    "train lfh04",
    "bench",
    "course",
]


def contents(folder):
    return {p: p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def test_every_step_is_done_once(tiny, stages, tmp_path):
    told = []
    out = tmp_path / "all"
    done = reproduce(out, False, tiny, 2, lambda *what: told.append(what))
    assert stages == ALL
    assert [what for what, _, _, _ in told] == [
        "[1/6] collect 1.0: driving",
        "[2/6] collect 0.4: driving",
        *["[3/6] train: hlsd10, lfh10, hlsd04, lfh04"] * 5,
        "[6/6] paper: tables and figure",
    ]
    assert [steps for _, *steps, _ in told[2:7]] == [
        [5900 * k, 23600] for k in range(5)
    ]
    assert done.table == table_one(*rows()).markdown()
    assert done.behaviour == behaviour(rows()[0]).markdown()
    assert done.course == course_table(rows()[0]).markdown()
    for number, planner in enumerate(("hlsd10", "lfh10", "hlsd04", "lfh04")):
        (line,) = re.findall(f"hlsd: {PUBLISHED[planner].title} .*", done.dataset)
        assert line.endswith(f"| {100 + number} |"), line
        # The log of 3 ticks was 0.08 s long; the policies are the shipped ones.
        assert "| 0.1 | 12 585 | 1" in line
    assert done.figure.exists()
    before = contents(out)
    told.clear()
    assert reproduce(out, False, tiny, 1, lambda *what: told.append(what)) == done
    assert stages == ALL, "nothing is done again"
    assert [what.split(":")[1] for what, *_ in told] == [" there already"] * 6
    assert [remaining for *_, remaining in told] == [Remaining(0.0, 0.0)] * 6
    assert contents(out) == before


def test_an_interrupted_training_goes_on_there(tiny, stages, tmp_path, monkeypatch):
    real = steps_module.train_many

    def interrupted(trainings, at_once, finished, progress):
        real(trainings[:2], at_once, finished, progress)
        raise KeyboardInterrupt

    monkeypatch.setattr(steps_module, "train_many", interrupted)
    with pytest.raises(KeyboardInterrupt):
        reproduce(tmp_path / "all", False, tiny, 1)
    assert stages == ALL[:4]
    monkeypatch.setattr(steps_module, "train_many", real)
    reproduce(tmp_path / "all", False, tiny, 1)
    assert stages == ALL


def test_a_missing_torch_is_one_line_before_any_work(
    tiny, stages, tmp_path, monkeypatch
):
    out, command = tmp_path / "all", ["reproduce", "--suite", tiny, "--out"]
    with monkeypatch.context() as patch:
        patch.setitem(sys.modules, "torch", None)
        result = CliRunner().invoke(app, [*command, str(out)])
        assert isinstance(result.exception, HlsdError)
        assert re.fullmatch(r".*needs torch.*pip install.*", str(result.exception))
        assert stages == []
        assert not out.exists()
    reproduce(out, False, tiny, 1)
    monkeypatch.setitem(sys.modules, "torch", None)
    (out / "bench" / "episodes.csv").unlink()
    (out / "bench" / "timing.csv").unlink()
    (out / "bench").rmdir()
    reproduce(out, False, tiny, 1)
    assert stages == [*ALL, "bench"], "with the policies there it is not needed"


def test_another_hlsd_is_refused(tiny, stages, tmp_path, monkeypatch):
    out = tmp_path / "all"
    reproduce(out, False, tiny, 1)
    before = contents(out)
    monkeypatch.setattr(pipeline_module, "code_digest", lambda code: "f00")
    with pytest.raises(HlsdError, match=r"other inputs \(hlsd_code '\w+', now 'f00'\)"):
        reproduce(out, False, tiny, 1)
    assert contents(out) == before


def remove(path):
    path.unlink()


def other_log(path):
    log = MotionLog.load(path)
    path.unlink()
    poses = log.poses + 1.0
    MotionLog(0.04, poses, log.commands, "jackal", "1", log.recipe, 2).save(path)


def other_seed(path):
    stamp = json.loads(path.read_text())
    held = stamp.get("conditions", stamp)
    held["seed"] = 7
    path.write_text(json.dumps(stamp))


def another_line(path):
    path.write_text(path.read_text() + "\n")


@pytest.mark.parametrize(
    ("change", "file", "named", "why"),
    [
        (other_log, "open-space-0.4.npz", "hlsd04.npz", "motion_log_sha256"),
        (other_seed, "lfh10.npz.json", "lfh10.npz", "seed 7, now 0"),
        (other_seed, "bench.json", "bench", "seed 7, now 0"),
        (another_line, "bench/episodes.csv", "paper", "episodes_sha256"),
        (other_seed, "course.json", "course", "seed 7, now 0"),
        (another_line, "course/episodes.csv", "paper", "course_sha256"),
        (remove, "open-space-1.0.npz.json", "open-space-1.0.npz", "not its stamp"),
    ],
)
def test_changed_inputs_are_refused(change, file, named, why, tiny, stages, tmp_path):
    out = tmp_path / "all"
    reproduce(out, False, tiny, 1)
    change(out / file)
    before = contents(out)
    with pytest.raises(HlsdError) as refused:
        reproduce(out, False, tiny, 1)
    assert str(refused.value).startswith(repr(str(out / named)))
    assert why in str(refused.value)
    assert "\n" not in str(refused.value)
    assert stages == ALL
    assert contents(out) == before


def test_a_quick_run_does_not_go_into_the_folder_of_a_whole_one(tiny, stages, tmp_path):
    reproduce(tmp_path / "all", False, tiny, 1)
    with pytest.raises(HlsdError, match=r"bench' was made from other inputs"):
        reproduce(tmp_path / "all", True, tiny, 1)
    assert default_folder(False, tiny) != default_folder(True, tiny)
    assert default_folder(True, tiny).as_posix() == "runs/reproduce-quick-tiny"


def test_bad_settings_write_nothing(tiny, tmp_path):
    out = tmp_path / "all"
    for suite, jobs, message in (("tinny", 1, "'tinny'"), (tiny, 0, "jobs is 0")):
        with pytest.raises(HlsdError, match=message):
            reproduce(out, True, suite, jobs)
    assert not out.exists()
    (tmp_path / "file").write_text("mine")
    with pytest.raises(HlsdError, match="cannot write to output folder"):
        reproduce(tmp_path / "file", True, tiny, 1)


def test_a_quick_reproduction_from_the_simulator_survives_an_interruption(
    tiny, tmp_path, monkeypatch
):
    """Two worlds, seven planners, three trials; cut after the first world."""
    out = tmp_path / "quick"
    course = store_small_course(tmp_path / "short")
    monkeypatch.setattr(reproduce_module, "_COURSE_SUITE", str(course))
    monkeypatch.setattr(reproduce_module, "COURSE_TRIALS", 2)
    real = work_module.run_episode
    calls = []

    def interrupted(course, planner, seed, trial):
        calls.append(course.world.index)
        if len(calls) == 23:
            raise KeyboardInterrupt
        return real(course, planner, seed, trial)

    monkeypatch.setattr(work_module, "run_episode", interrupted)
    with pytest.raises(KeyboardInterrupt):
        reproduce(out, True, tiny, 1)
    assert not (out / "paper").exists()
    reproduce(out, True, tiny, 1)
    on_course = [0] * 10
    assert calls[23:] == [6] * 21 + on_course, "the first world is not run again"
    episodes = load_episodes(out / "bench")
    assert list(episodes["planner"].unique()) == list(TITLES)
    assert sorted(episodes["world"].unique()) == [0, 6]
    assert len(episodes) == 42
    table = (out / "paper" / "table1.md").read_text()
    assert "tiny, 2 worlds x 3 trials" in table
    assert "not run" not in table
    before = contents(out)
    command = ["reproduce", "--quick", "--suite", tiny, "--out", str(out)]
    result = CliRunner().invoke(app, [*command, "--jobs", "1"])
    assert result.exit_code == 0, result.output
    assert table in result.stdout
    assert str(out / "paper" / "regression.png") in result.stdout
    assert (out / "paper" / "course.md").read_text() in result.stdout
    assert calls[23:] == [6] * 21 + on_course
    assert contents(out) == before
