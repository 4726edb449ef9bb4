"""The report's tables, curves and files: closed cases that a hand computes."""

import csv
import io
import json
import re
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from hlsd.analysis.runs import join_runs, join_trajectories, load_episodes
from hlsd.analysis.summary import summarise
from hlsd.core.errors import HlsdError
from hlsd.data.worlds import load_suite
from hlsd.report import page
from hlsd.report.curves import (
    incidences,
    orders_at_hand,
    profiles,
    times_by_world,
)
from hlsd.report.drawing import SHADES, planner_shades
from hlsd.report.planner_tables import (
    driving_table,
    pair_tables,
    planning_table,
    summary_table,
)
from hlsd.report.summary import summary_markdown
from hlsd.report.tables import Cell, Column, Table, csv_table
from hlsd.report.write import write_report
from hlsd.run.bench import Bench, run_bench
from hlsd.run.row import COLUMNS, TEXT_COLUMNS
from hlsd.run.trajectory import read_trajectories
from tests.cli.test_cli import assert_refused, hlsd


def episodes(runs, protocol="hlsd2021", seed=0):
    """Rows of runs (planner, world, trial, time or reason of failure, more columns)."""
    rows = []
    for planner, world, trial, end, *more in runs:
        row = dict.fromkeys(COLUMNS, np.nan) | dict.fromkeys(TEXT_COLUMNS, "")
        row |= {"suite": "barn300", "suite_version": "1", "protocol": protocol}
        row |= {"planner": planner, "world": world, "trial": trial, "seed": seed}
        row |= {"robot": "jackal", "robot_version": "1.0", "contacts": 0}
        limit_s = 50.0 if protocol == "hlsd2021" else 100.0
        if isinstance(end, str):
            outcome = {"timeout": "timeout", "contact": "collision"}.get(end, "error")
            reason = end if outcome == "error" else ""
            row |= {"outcome": outcome, "time_s": limit_s, "reason": reason}
        else:
            row |= {"outcome": "success", "time_s": end}
        rows.append(row | dict(*more))
    return pd.DataFrame(rows)


def column(table, name):
    k = [column.name for column in table.columns].index(name)
    return {row[0].text: row[k] for row in table.rows}


def write_run(folder, rows):
    folder.mkdir(parents=True)
    rows[list(COLUMNS)].to_csv(folder / "episodes.csv", index=False)
    return folder


TWO = [
    *[("dwa", w, t, 10.0 + w + t) for w in (0, 1, 2) for t in (0, 1)],
    *[("hlsd10", w, t, 6.0 + w + t) for w in (0, 1, 2) for t in (0, 1)],
]


def test_a_failure_of_every_kind_is_counted_as_what_it_is():
    ends = (
        8.0,
        12.0,
        "timeout",
        "timeout",
        "exception: ValueError: no",
        "unheard of",
        "bad command: nan m/s",
        "too slow: one command took more than 10 s",
    )
    table = summary_table(episodes([("a", k, 0, end) for k, end in enumerate(ends)]))
    kinds = {
        c.name: row.value
        for c, row in zip(table.columns, table.rows[0], strict=True)
        if c.title.startswith("failed: ")
    }
    once = ("exception", "bad_command", "too_slow", "unknown")
    assert kinds == {"timeout": 2, **dict.fromkeys(once, 1)}
    assert column(table, "success")["a"].value == pytest.approx(2 / 8)
    # No failure is left out of the mean time, however it failed.
    assert column(table, "time_s")["a"].value == pytest.approx((20 + 6 * 50) / 8)
    assert column(table, "success_time_s")["a"].value == pytest.approx(10.0)


def test_scores_stand_where_the_protocol_has_them():
    runs = [("a", 0, t, 20.0, {"official_length_m": 10.0}) for t in range(2)]
    runs.append(("a", 6, 0, "contact", {"official_length_m": 10.0}))
    names = [c.name for c in summary_table(episodes(runs)).columns]
    assert not {"score_4_8", "score_2_8"} & set(names)
    table = summary_table(episodes(runs, "barn2022"))
    # 10 m at 2 m/s is 5 s; 20 s is 4 of these; mean over worlds, not over runs.
    assert column(table, "score_4_8")["a"].value == pytest.approx((0.25 + 0) / 2)
    assert column(table, "contact")["a"].value == 1


TOUCHED = {"contacts": 2}


def test_a_contact_as_failure_stands_beside_the_time_in_every_table():
    runs = [("a", w, t, 10.0 + w + t) for w in range(6) for t in (0, 1)]
    runs += [("b", w, t, 8.0 + w + t) for w in range(6) for t in (0, 1)]
    runs[12] = ("b", 0, 0, 8.0, TOUCHED)
    runs[13] = ("b", 0, 1, "timeout", TOUCHED)
    rows = episodes(runs)
    summary = summary_table(rows)
    names = [c.name for c in summary.columns]
    assert names.index("time_contact_fails_s") == names.index("time_s") + 1
    mean_s = (2 * 50 + 8.0 * 10 + 2 * 15 + 5) / 12  # two runs count 50 s
    cell = column(summary, "time_contact_fails_s")["b"]
    assert cell.value == pytest.approx(mean_s)
    assert cell.low < mean_s < cell.high
    assert column(summary, "time_s")["b"].value == pytest.approx(mean_s - 42 / 12)
    assert "a run that touches an obstacle counts the limit, too" in summary.notes[0]
    pairs = {table.name: table for table in pair_tables(rows)}
    own, strict = (
        pairs[f"pairs_{name}"].rows[0][3] for name in ("time_s", "time_contact_fails_s")
    )
    assert strict.value == pytest.approx(own.value - 42 / 12)
    record = summarise(rows).set_index("planner").loc["b"]
    assert record["mean_time_contact_fails_s"] == pytest.approx(mean_s)
    assert record["mean_time_contact_fails_low_s"] == pytest.approx(cell.low)
    assert record["mean_time_contact_fails_high_s"] == pytest.approx(cell.high)
    sd_s = record["sd_time_contact_fails_s"]
    (line,) = (x for x in summary_markdown(rows).splitlines() if x.startswith("| b "))
    assert f"| {mean_s:.2f} ± {sd_s:.2f} |" in line


def test_where_a_contact_ends_the_run_the_two_times_stand_once():
    runs = [("a", w, 0, 20.0 + w, {"official_length_m": 10.0}) for w in range(6)]
    runs += [("b", w, 0, "contact", {"official_length_m": 10.0}) for w in range(6)]
    rows = episodes(runs, "barn2022")
    assert "time_contact_fails_s" not in [c.name for c in summary_table(rows).columns]
    assert "pairs_time_contact_fails_s" not in [t.name for t in pair_tables(rows)]
    for _, record in summarise(rows).iterrows():
        assert record["mean_time_contact_fails_s"] == record["mean_time_s"]
        assert record["sd_time_contact_fails_s"] == record["sd_time_s"]


def test_contacts_that_were_not_counted_give_no_time():
    unknown = {"contacts": np.nan}
    runs = [("theirs", w, 0, 9.0 + w, unknown) for w in range(6)]
    rows = episodes([*runs, *[("ours", w, 0, 9.0 + w) for w in range(6)]])
    assert column(summary_table(rows), "time_contact_fails_s")["theirs"].text == "–"
    assert "pairs_time_contact_fails_s" not in [t.name for t in pair_tables(rows)]
    lines = summary_markdown(rows).splitlines()
    (line,) = (held for held in lines if held.startswith("| theirs "))
    assert line.count("unknown") == 2, "the time, and the share without contact"
    alone = episodes(runs)
    assert "time_contact_fails_s" not in [c.name for c in summary_table(alone).columns]
    assert "nan" not in summary_markdown(alone) + shown(summary_table(alone))
    assert csv_table(summarise(alone)).splitlines()[1].count(",,,,") == 1


def test_the_floor_is_called_so_where_it_stands():
    said = "pursuit is the floor: it follows the global path and never looks at the"
    with_floor = episodes([*TWO, *[("pursuit", w, 0, 5.0 + w) for w in (0, 1, 2)]])
    for text in (summary_markdown(with_floor), *summary_table(with_floor).notes[1:2]):
        assert text.count(said) == 1
    without = episodes(TWO)
    assert "floor" not in summary_markdown(without) + shown(summary_table(without))
    joined = with_floor.replace({"planner": {"pursuit": "pursuit (run-2)"}})
    assert "pursuit (run-2) is the floor" in summary_markdown(joined)
    imported = with_floor.assign(robot="")
    assert "floor" not in summary_markdown(imported), "who knows what that one did"
    mine = with_floor.replace({"planner": {"pursuit": "pursuit_of_mine"}})
    assert "floor" not in summary_markdown(mine)


def test_what_nobody_measured_is_left_out():
    assert driving_table(episodes(TWO)) is None
    assert planning_table(episodes(TWO)) is None
    rows = episodes([(*run, {"path_length_m": 5.0}) for run in TWO])
    table = driving_table(rows)
    assert [c.name for c in table.columns] == ["planner", "path_length_m"]
    assert column(table, "path_length_m")["dwa"].value == 5.0


MEASURED = {
    "ticks": 100,
    "contacts": 0,
    "path_length_m": 5.0,
    "min_clearance_m": 0.2,
    "recoveries": 1,
    "recovery_ticks": 4,
}
AT_ONCE = {**MEASURED, "ticks": 0, "path_length_m": 0.0, "recoveries": 0}


def shown(*tables):
    """All that people read of tables."""
    return "".join(table.markdown() + table.latex() for table in tables)


def every_table(rows):
    tables = (summary_table(rows), driving_table(rows), planning_table(rows))
    return [*(table for table in tables if table is not None), *pair_tables(rows)]


@pytest.mark.parametrize("protocol", ["hlsd2021", "barn2022"])
@pytest.mark.parametrize("trials", [1, 3])
def test_one_world_has_no_interval_anywhere(protocol, trials):
    measured = {**MEASURED, "official_length_m": 10.0}
    runs = [
        (name, 4, trial, 9.0 + trial, measured)
        for name in ("a", "b")
        for trial in range(trials)
    ]
    rows = episodes(runs, protocol)
    tables = every_table(rows)
    assert len(tables) >= 4
    for table in tables:
        cells = [cell for row in table.rows for cell in row]
        assert [cell.range_text for cell in cells] == [""] * len(cells), table.name
        assert np.isnan([cell.low for cell in cells]).all()
    text = shown(*tables) + summary_markdown(rows)
    assert "nan" not in text
    assert "…" not in text
    assert ("±" in summary_markdown(rows).split("\n\nMean")[0]) == (
        trials > 1 and protocol == "hlsd2021"
    )
    ((_, profile), _) = profiles(rows)
    assert np.isnan(profile.low).all()
    csv_text = csv_table(summarise(rows))
    (record, _) = csv.DictReader(io.StringIO(csv_text))
    assert record["mean_time_low_s"] == record["success_high"] == ""
    assert (record["sd_time_s"] == "") == (trials == 1)


def test_rates_without_a_failure_keep_their_width_in_every_table():
    runs = [
        (name, world, trial, 9.0 + world % 5 + trial + len(name), MEASURED)
        for name in ("a", "bb")
        for world in range(12)
        for trial in range(3)
    ]
    rows = episodes(runs)
    for name in ("success", "contact_free"):
        cell = column(summary_table(rows), name)["a"]
        assert (cell.value, cell.high) == (1.0, 1.0)
        assert 0.7 < cell.low < 0.9
        pair = {table.name: table for table in pair_tables(rows)}[f"pairs_{name}"]
        (row,) = pair.rows
        assert row[3].value == 0
        assert row[3].low < -0.1 < 0.1 < row[3].high
    # What is the same in all runs, and no rate, has no interval.
    recoveries = column(driving_table(rows), "recoveries")["a"]
    assert (recoveries.full_text, np.isnan(recoveries.low)) == ("1.00", True)
    for _, profile in profiles(rows):
        assert (profile.high - profile.low > 0.1).all()


def test_what_was_measured_is_of_the_runs_that_drove():
    """A planner that raises at its first tick touches nothing, which is no merit."""
    error = "exception: ValueError: no"
    runs = [("a", world, 0, 9.0 + world, MEASURED) for world in range(6)]
    runs += [("a", world, 1, error, AT_ONCE) for world in range(4)]
    runs += [("never", world, 0, error, AT_ONCE) for world in range(6)]
    runs[0] = ("a", 0, 0, 9.0, {**MEASURED, "contacts": 2})
    rows = episodes(runs)
    summary, driving = summary_table(rows), driving_table(rows)
    assert column(summary, "runs")["a"].value == 10
    for table in (summary, driving):
        assert column(table, "drove")["a"].value == 6
        assert column(table, "drove")["never"].text == "0"
    assert column(summary, "contact_free")["a"].value == pytest.approx(5 / 6)
    assert column(summary, "success")["a"].value == pytest.approx(0.6)
    assert column(summary, "time_s")["never"].text == "50.00"
    assert column(driving, "path_length_m")["a"].value == 5.0
    for table, name in (
        (summary, "contact_free"),
        (driving, "path_length_m"),
        (driving, "min_clearance_m"),
        (driving, "recoveries"),
        (driving, "recovery_share"),
    ):
        assert column(table, name)["never"].full_text == "–"
    text = summary_markdown(rows)
    assert "| 83.3 % of 6 |" in text
    (line,) = (line for line in text.splitlines() if line.startswith("| never |"))
    assert line.endswith("| none | – |")
    assert "nan" not in text + shown(*every_table(rows))
    all_drove = episodes(runs[:6])
    assert "drove" not in [c.name for c in summary_table(all_drove).columns]
    assert "| 83.3 % |" in summary_markdown(all_drove)


def test_pairs_are_differences_of_world_means():
    table = pair_tables(episodes(TWO))[0]
    assert table.name == "pairs_time_s"
    (row,) = table.rows
    assert [cell.text for cell in row[:3]] == ["dwa", "hlsd10", "3"]
    assert row[3].value == pytest.approx(4.0)
    assert row[3].full_text == "+4.00", "all worlds differ by the same: no interval"
    # Three differences of one sign: 2 x (1/2)^3; one pair leaves Holm nothing to do.
    assert row[4].value == row[5].value == pytest.approx(0.25)
    assert "runs paired by trial" in table.notes[0]


def test_holm_counts_the_pairs():
    three = [*TWO, *[("lfh04", w, t, 9.0 + w) for w in (0, 1, 2) for t in (0, 1)]]
    table = pair_tables(episodes(three))[0]
    assert len(table.rows) == 3
    raw = [row[4].value for row in table.rows]
    assert [row[5].value for row in table.rows] == pytest.approx([0.75] * 3)
    assert raw == pytest.approx([0.25] * 3)


def test_runs_of_different_seeds_are_not_paired_by_trial():
    rows = pd.concat(
        [episodes(TWO[:6], seed=0), episodes(TWO[6:], seed=1)], ignore_index=True
    )
    assert "runs not paired by trial" in pair_tables(rows)[0].notes[0]


def test_planners_without_a_world_in_common_have_no_pair():
    assert pair_tables(episodes([("a", 0, 0, 9.0), ("b", 1, 0, 9.0)])) == ()
    assert pair_tables(episodes([("a", 0, 0, 9.0)])) == ()


def test_markdown_latex_and_csv_hold_the_same():
    table = Table(
        "t",
        "T",
        (Column("who", "who", "text"), Column("p_100", "share [%]", "interval")),
        ((Cell("a_b"), Cell("−1.5", -0.015, -0.02, 0.01, "−2.0 … +1.0")),),
        ("A note.",),
    )
    assert table.markdown().splitlines() == [
        "| who | share [%] |",
        "| --- | --- |",
        "| a_b | −1.5 (−2.0 … +1.0) |",
        "",
        "A note.",
    ]
    assert r"a\_b & $-$1.5 ($-$2.0 \dots{} +1.0) \\" in table.latex()
    assert r"share [\%]" in table.latex()
    (record,) = csv.DictReader(io.StringIO(table.csv()))
    assert record == {
        "who": "a_b",
        "p_100": "-0.015",
        "p_100_low": "-0.02",
        "p_100_high": "0.01",
    }


def test_worlds_are_ordered_by_dwa_and_lines_are_least_squares():
    dwa = {3: (20.0, 10.0), 5: ("timeout", 50.0), 8: (9.0, 11.0)}
    other = {3: (10.0, 16.0), 5: (31.0, 31.0), 8: (50.0, "timeout")}
    rows = episodes(
        (name, world, trial, end)
        for name, worlds in (("dwa", dwa), ("x", other))
        for world, ends in worlds.items()
        for trial, end in enumerate(ends)
    )
    order = times_by_world(rows, "dwa")
    assert order.worlds.tolist() == [8, 3, 5]
    of_dwa, of_x = order.planners
    assert (of_dwa.planner, of_dwa.made_order, of_dwa.fit) == ("dwa", True, None)
    np.testing.assert_allclose(of_dwa.mean_s, [10, 15, 50])
    np.testing.assert_allclose(of_x.mean_s, [50, 13, 31])
    slope, offset = np.polyfit([0, 1, 2], [50, 13, 31], 1)
    np.testing.assert_allclose(of_x.fit.line, slope * of_x.fit.x + offset)
    assert (of_x.fit.low <= of_x.fit.line).all()
    assert (of_x.fit.line <= of_x.fit.high).all()
    by_index = times_by_world(rows, "index")
    assert by_index.worlds.tolist() == [3, 5, 8]
    assert by_index.own
    assert all(own.fit is None for own in by_index.planners), "indices are no order"


def test_a_cross_fitted_order_shows_dwa_by_the_runs_that_did_not_make_it():
    # Trial 0 says that world 1 is harder, trial 1 the contrary.
    times = {(0, 0): 5.0, (0, 1): 9.0, (1, 0): 8.0, (1, 1): 6.0}
    rows = episodes([("dwa", *run, time) for run, time in times.items()])
    order = times_by_world(rows, "dwa-cross-fitted")
    (own,) = order.planners
    assert order.worlds.tolist() == [0, 1]
    np.testing.assert_allclose(own.mean_s, [9.0, 6.0])
    assert not own.made_order


def test_only_orders_that_the_runs_allow_are_offered():
    assert orders_at_hand(episodes(TWO[6:]), None) == ("index",)
    assert orders_at_hand(episodes(TWO), None) == ("dwa", "dwa-cross-fitted", "index")
    once = episodes([("dwa", 0, 0, 9.0), ("dwa", 1, 0, 9.0)])
    assert orders_at_hand(once, None) == ("dwa", "index")
    suite = load_suite("barn300")
    difficulty = {world: suite[world].difficulty() for world in (0, 1, 2)}
    offered = orders_at_hand(episodes(TWO), difficulty)
    assert len(offered) == 8
    for how in offered:
        order = times_by_world(episodes(TWO), how, difficulty)
        assert sorted(order.worlds.tolist()) == [0, 1, 2]


def test_what_came_first():
    rows = episodes(
        [
            ("a", 0, 0, 10.0),
            ("a", 0, 1, 20.0, {"contacts": 2, "time_to_contact_s": 5.0}),
            ("a", 1, 0, "timeout", {"contacts": 1, "time_to_contact_s": 30.0}),
            ("a", 1, 1, "timeout"),
        ]
    )
    ((name, found),) = incidences(rows)
    assert name == "a"
    at = {t: int(np.searchsorted(found.grid_s, t)) for t in (5, 10, 30, 50)}
    contact, goal = found.ended["contact"], found.ended["goal"]
    assert [contact[at[t]] for t in (5, 10, 30, 50)] == [0.25, 0.25, 0.5, 0.5]
    assert [goal[at[t]] for t in (5, 10, 50)] == [0, 0.25, 0.25]
    assert found.ended["timeout"][at[50]] == 0.25
    assert found.running[-1] == 0


def test_a_profile_is_the_share_of_runs_at_the_goal():
    ((_, found),) = profiles(episodes([("a", 0, 0, 10.0), ("a", 1, 0, "timeout")]))
    after = found.grid_s >= 10.0
    np.testing.assert_array_equal(found.runs, 0.5 * after)


def test_every_planner_has_a_colour_of_its_own():
    names = [*SHADES, "dwa (run-2)", "mine", "yours"]
    shades = planner_shades(names)
    assert all(shades[name] == SHADES[name] for name in SHADES)
    assert len({s.light for s in shades.values()}) == len(names)
    assert planner_shades(["dwa (a)", "dwa (b)"])["dwa (a)"] == SHADES["dwa"]


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = tmp_path_factory.mktemp("runs") / "both"
    settings = Bench(("dwa", "hlsd10"), worlds="0,12", trials=2)
    return run_bench(settings, folder, 1)


def test_planning_times_come_with_the_rows(run):
    rows = load_episodes(run)
    with (run / "timing.csv").open(newline="") as file:
        timing = list(csv.DictReader(file))
    expected = [float(row["planning_p95_ms"]) for row in timing]
    assert rows["planning_p95_ms"].tolist() == pytest.approx(expected)


def test_trajectories_follow_planners_that_are_renamed(run, tmp_path):
    other = tmp_path / "other"
    other.mkdir()
    for name in ("episodes.csv", "run.json", "trajectories.zip"):
        (other / name).write_bytes((run / name).read_bytes())
    blocks = join_trajectories([run, other])
    kept = read_trajectories(run)
    assert len(blocks) == 2 * len(kept) == 16
    rows = join_runs([run, other])
    keys = zip(rows["planner"], rows["world"], rows["trial"], strict=True)
    assert set(keys) == set(blocks)
    assert blocks["dwa (other)", 12, 1] == kept["dwa", 12, 1]


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_the_same_runs_make_the_same_bytes(run, tmp_path):
    first = write_report([run], tmp_path / "a")
    second = write_report([run], tmp_path / "b")
    files = contents(first.folder)
    assert files == contents(second.folder)
    assert sorted(files) == sorted(first.files)
    figures = {"difficulty", "orders", "profiles", "incidence"}
    tables = {"summary", "driving", "planning", "pairs_time_s", "pairs_success"}
    wanted = {"report.html", "report.md"}
    wanted |= {f"{name}.{kind}" for name in figures for kind in ("png", "pdf")}
    wanted |= {f"{name}.{kind}" for name in tables for kind in ("csv", "tex")}
    assert wanted <= set(files)
    assert files["difficulty.pdf"][:5] == b"%PDF-"
    assert files["difficulty.png"][:4] == b"\x89PNG"


def test_the_document_s_figures_are_there(run, tmp_path):
    folder = write_report([run], tmp_path / "out", ["md"]).folder
    text = (folder / "report.md").read_text(encoding="utf-8")
    figures = re.findall(r"!\[[^\]]*\]\(([^)]+)\)", text)
    assert len(figures) == 4
    assert {path.name for path in folder.iterdir()} == {"report.md", *figures}


def test_the_page_needs_nothing_but_itself(run, tmp_path):
    report = write_report([run], tmp_path / "out", ["html"])
    assert report.files == ("report.html",)
    page = (report.folder / "report.html").read_text(encoding="utf-8")
    addresses = set(re.findall(r"\w+://[^\s\"'<>`]*", page))
    assert addresses == {"http://www.w3.org/2000/svg"}, "the name of SVG, not a link"
    assert "{{" not in page
    assert not re.findall(
        r"<(?:link|img|script|iframe)[^>]* (?:href|src)=\"(?!data:)", page
    )
    assert str(run) not in page
    # 15 MB for 750 runs: what does not grow with runs is below 0.5 MB.
    lines = page.split('id="report-trajectories">')[1].split("</script>")[0].split("\n")
    assert len(lines) == 8
    assert max(map(len, lines)) < 14.5e6 / 750
    assert len(page) - sum(map(len, lines)) < 0.5e6


def test_a_planner_s_words_cannot_leave_their_place(tmp_path):
    evil = "exception: E: </script><script>alert(1)</script>&amp;"
    rows = episodes([("<b>&'\"", 0, 0, 9.0), ("<b>&'\"", 1, 0, evil)])
    folder = write_report([write_run(tmp_path / "run", rows)], formats=["html"]).folder
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "<b>&" not in page
    assert "alert(1)</script>" not in page
    text = page.split('id="report-data">')[1].split("</script>")[0]
    assert json.loads(text)["runs"]["reason"][1] == evil


def test_reports_go_to_new_folders(tmp_path):
    run = write_run(tmp_path / "run", episodes(TWO))
    first = write_report([run], formats=["csv"])
    second = write_report([run], formats=["csv"])
    assert first.folder == (tmp_path / "run-report").resolve()
    assert second.folder == (tmp_path / "run-report-2").resolve()
    before = contents(first.folder)
    with pytest.raises(HlsdError, match="is not empty"):
        write_report([run], first.folder)
    assert contents(first.folder) == before
    other = write_run(tmp_path / "other", episodes([("x", 0, 0, 9.0)]))
    both = write_report([run, other], formats=["csv"])
    assert both.folder.name == "run-and-1-more-report"


def test_a_suite_that_is_not_at_hand_leaves_maps_out(tmp_path):
    rows = episodes(TWO).assign(suite="far-away")
    run = write_run(tmp_path / "run", rows)
    report = write_report([run], formats=["html"])
    assert not report.maps
    with pytest.raises(HlsdError, match="barn12"):
        write_report([run], tmp_path / "out", suite="barn12")
    assert write_report([run], tmp_path / "out", ["csv"], suite="barn300").maps
    lost = write_run(tmp_path / "lost", episodes([("a", 999, 0, 9.0)]))
    with pytest.raises(HlsdError, match="world 999"):
        write_report([lost], tmp_path / "none", suite="barn300")
    assert not (tmp_path / "none").exists()


def test_the_command_prints_the_summary_and_says_where_the_report_is(tmp_path):
    run = write_run(tmp_path / "run", episodes(TWO))
    out = tmp_path / "out"
    result = hlsd("report", run, "--out", out, "--format", "csv,html")
    assert result.returncode == 0, result.stderr
    assert "| hlsd10 | 6 | 100.0 % |" in result.stdout
    assert str(out / "report.html") in result.stdout
    assert {p.suffix for p in out.iterdir()} == {".csv", ".html"}
    assert_refused(hlsd("report", run, "--out", out), "is not empty")
    pdf = hlsd("report", run, "--format", "pdf", "--out", tmp_path / "no")
    assert_refused(pdf, "'pdf'", "md, tex, csv, html")
    assert not (tmp_path / "no").exists()


def test_the_page_escapes_every_text(tmp_path):
    name = "<b>\"a\" & 'b'</b>"
    rows = episodes([(name, w, 0, 9.0 + w) for w in range(3)])
    folder = write_report([write_run(tmp_path / "run", rows)], formats=["html"]).folder
    text = (folder / "report.html").read_text()
    assert name not in text
    assert "<title>&lt;b&gt;&#34;a&#34; &amp; &#39;b&#39;&lt;/b&gt; on" in text


def test_every_script_is_on_the_page():
    folder = Path(page.__file__).with_name("page")
    assert sorted(page.SCRIPTS) == sorted(file.name for file in folder.glob("*.js"))
