"""The metrics: each in closed form, and the page about them."""

import numpy as np
import pandas as pd
import pytest

from hlsd.analysis.metrics import FAILURE_KINDS, METRICS, METRICS_VERSION, failure_kind
from hlsd.analysis.runs import load_episodes
from hlsd.run.protocol import PROTOCOLS
from hlsd.run.row import COLUMNS, OPTIONAL_COLUMNS, TEXT_COLUMNS, TIMING_COLUMNS
from scripts.make_metrics_docs import PAGE, REMAKE, render


def runs(**columns):
    """Two runs, a success in 12 s and a timeout, with some columns changed."""
    table = pd.DataFrame({name: np.zeros(2) for name in COLUMNS})
    for name in TEXT_COLUMNS:
        table[name] = ""
    table["planner"] = "mine"
    table["protocol"] = "barn2022"
    table["outcome"] = ["success", "timeout"]
    table["time_s"] = [12.0, 100.0]
    table["trial"] = [0, 1]
    table["ticks"] = 100.0
    return table.assign(**columns)


def values(name, table):
    found = METRICS[name].of_runs(table)
    assert found.shape == (len(table),)
    assert found.dtype == np.float64
    return found.tolist()


def test_names_titles_sources_and_definitions_are_all_there():
    for name, metric in METRICS.items():
        assert metric.name == name
        assert metric.title
        assert metric.source
        assert metric.definition.endswith(".")
        assert metric.better in ("lower", "higher", None)
        assert metric.version >= 1
        assert set(metric.protocols) <= set(PROTOCOLS)
    titles = [metric.title for metric in METRICS.values()]
    assert len(set(titles)) == len(titles)


def test_the_names_are_those_that_were_promised():
    assert list(METRICS) == [
        "success",
        "collision",
        "timeout",
        "error",
        "contact_free",
        "time_s",
        "time_contact_fails_s",
        "success_time_s",
        "score_4_8",
        "score_2_8",
        "path_length_m",
        "spl",
        "min_clearance_m",
        "mean_clearance_m",
        "jerk_m_s3",
        "yaw_rate_change_rad_s",
        "recoveries",
        "recovery_share",
        "contact_time_s",
        "contact_distance_m",
        "planning_median_ms",
        "planning_p95_ms",
        "planning_max_ms",
        "overrun_share",
    ]


def test_outcomes_are_one_of_four():
    table = pd.concat([runs(), runs(outcome=["collision", "error"])])
    assert values("success", table) == [1, 0, 0, 0]
    assert values("timeout", table) == [0, 1, 0, 0]
    assert values("collision", table) == [0, 0, 1, 0]
    assert values("error", table) == [0, 0, 0, 1]


def test_times_with_failures_and_of_successes_are_never_mixed():
    table = runs(outcome=["success", "collision"], time_s=[12.0, 3.0])
    assert values("time_s", table) == [12.0, 100.0], "a failure counts the limit"
    np.testing.assert_array_equal(values("success_time_s", table), [12.0, np.nan])
    assert METRICS["success_time_s"].better is None, "a statistic of survivors"
    table["protocol"] = "hlsd2021"
    assert values("time_s", table) == [12.0, 50.0]


def test_a_contact_may_be_a_failure_whatever_the_protocol_says():
    table = pd.concat([runs(), runs(outcome=["success", "error"])])
    table["contacts"] = [0.0, 0.0, 2.0, 1.0]
    table["protocol"] = "hlsd2021"
    assert values("time_s", table) == [12.0, 50.0, 12.0, 50.0]
    assert values("time_contact_fails_s", table) == [12.0, 50.0, 50.0, 50.0]
    assert METRICS["time_contact_fails_s"].better == "lower"


@pytest.mark.parametrize("protocol", ["barn2022", "barn2024"])
def test_where_a_contact_ends_the_run_it_is_a_failure_anyhow(protocol):
    table = pd.concat([runs(), runs(outcome=["collision", "error"])])
    table["contacts"] = [0.0, 0.0, 1.0, 0.0]
    table["protocol"] = protocol
    expected = [12.0, 100.0, 100.0, 100.0]
    assert values("time_s", table) == expected
    assert values("time_contact_fails_s", table) == expected


def test_contacts_that_were_not_counted_are_no_time_without_contact():
    """Neither the limit nor the time as it was: imported runs are undefined."""
    table = runs(contacts=[np.nan, np.nan])
    assert np.isnan(values("time_contact_fails_s", table)).all()
    assert np.isnan(
        values("time_contact_fails_s", table.drop(columns="contacts"))
    ).all()
    one = values("time_contact_fails_s", runs(contacts=[np.nan, 0.0]))
    np.testing.assert_array_equal(one, [np.nan, 100.0])


def test_failing_at_once_is_no_way_around_a_contact():
    """A planner that never drove touched nothing, and counts the limit."""
    table = runs(outcome=["error", "error"], ticks=[0, 0], contacts=[0, 0])
    assert values("time_contact_fails_s", table) == [100.0, 100.0]


def test_scores_follow_the_challenge():
    """OT = 5 s: 12 s is clipped to 20 s by the first, and not by the second."""
    table = runs(official_length_m=[10.0, 10.0])
    assert values("score_4_8", table) == [5.0 / 20.0, 0.0]
    assert values("score_2_8", table) == [5.0 / 12.0, 0.0]
    slow = runs(official_length_m=[10.0, 10.0], time_s=[90.0, 100.0])
    assert values("score_2_8", slow)[0] == 5.0 / 40.0
    nowhere = runs(official_length_m=[np.nan, np.nan], protocol="hlsd2021")
    assert np.isnan(values("score_4_8", nowhere)).all()
    assert METRICS["score_4_8"].protocols == (
        "barn2022",
        "barn2024",
        "dynabarn2024",
    )


def test_spl_weighs_success_by_the_shortest_length():
    table = pd.concat([runs(), runs(outcome=["success", "success"])])
    table["shortest_length_m"] = 6.0
    table["path_length_m"] = [8.0, 1.0, 6.0, 5.9]
    assert values("spl", table) == [0.75, 0.0, 1.0, 1.0]
    there = table.assign(shortest_length_m=0.0, path_length_m=[0.0, 0.0, 2.0, 0.0])
    assert values("spl", there) == [1.0, 0.0, 0.0, 1.0]


def test_contact_free_is_unknown_where_contacts_were_not_counted():
    found = values("contact_free", runs(contacts=[0, 2]))
    assert found == [1.0, 0.0]
    assert np.isnan(values("contact_free", runs(contacts=[np.nan, np.nan]))).all()


@pytest.mark.parametrize(
    ("name", "column"),
    [("recovery_share", "recovery_ticks"), ("overrun_share", "overruns")],
)
def test_shares_of_ticks_are_undefined_without_any(name, column):
    found = values(name, runs(ticks=[200, 0], **{column: [50, 0]}))
    np.testing.assert_array_equal(found, [0.25, np.nan])


COLUMN_METRICS = (
    "path_length_m",
    "min_clearance_m",
    "mean_clearance_m",
    "jerk_m_s3",
    "yaw_rate_change_rad_s",
    "recoveries",
    "contact_time_s",
    "contact_distance_m",
    "planning_median_ms",
    "planning_p95_ms",
    "planning_max_ms",
)


@pytest.mark.parametrize("name", COLUMN_METRICS)
def test_measured_metrics_are_their_columns(name):
    assert name in (*COLUMNS, *TIMING_COLUMNS)
    assert values(name, runs(**{name: [0.25, 3.0]})) == [0.25, 3.0]
    assert np.isnan(values(name, runs().drop(columns=name, errors="ignore"))).all()


@pytest.mark.parametrize("name", ["contact_free", *COLUMN_METRICS])
def test_what_was_measured_is_of_runs_that_drove(name):
    """A planner that fails at its first tick touches nothing, which is no merit."""
    held = {"contacts": [0, 0]} if name == "contact_free" else {name: [1.0, 0.0]}
    found = values(name, runs(ticks=[200, 0], **held))
    np.testing.assert_array_equal(found, [1.0, np.nan])
    unknown = values(name, runs(ticks=[np.nan, 200], **held))
    assert not np.isnan(unknown).any(), "imported runs drove, as far as is known"


def test_all_runs_have_a_success_and_a_time():
    table = runs(ticks=[0, 0], outcome=["error", "error"])
    assert values("success", table) == [0.0, 0.0]
    assert values("error", table) == [1.0, 1.0]
    assert values("time_s", table) == [100.0, 100.0]
    assert values("spl", table.assign(shortest_length_m=6.0)) == [0.0, 0.0]


def test_a_metric_that_is_redefined_has_another_version():
    """In 0.1.0 they counted runs that did not drive."""
    redefined = {
        "contact_free",
        "path_length_m",
        "min_clearance_m",
        "mean_clearance_m",
        "recoveries",
        "contact_time_s",
        "contact_distance_m",
    }
    for name, metric in METRICS.items():
        assert metric.version == (2 if name in redefined else 1), name


def test_rates_are_those_of_zero_or_one():
    table = pd.concat([runs(), runs(outcome=["collision", "error"], contacts=[1, 0])])
    rates = {"success", "collision", "timeout", "error", "contact_free"}
    assert {name for name, metric in METRICS.items() if metric.rate} == rates
    for name in rates:
        assert set(values(name, table)) == {0.0, 1.0}


def test_every_metric_is_a_column_s_or_tested_here():
    derived = (
        "success",
        "collision",
        "timeout",
        "error",
        "contact_free",
        "time_s",
        "time_contact_fails_s",
        "success_time_s",
        "score_4_8",
        "score_2_8",
        "spl",
        "recovery_share",
        "overrun_share",
    )
    assert {*derived, *COLUMN_METRICS} == {*METRICS}


@pytest.mark.parametrize(
    ("outcome", "reason", "kind"),
    [
        ("success", "", ""),
        ("timeout", "", "timeout"),
        ("collision", "", "contact"),
        ("error", "exception: ValueError: too slow: no", "exception"),
        ("error", "bad command: nan m/s, 0 rad/s is not finite", "bad command"),
        ("error", "too slow: one command took more than 10 s", "too slow"),
        ("error", "ValueError: as written before kinds were", "unknown"),
        ("error", "exceptional", "unknown"),
        ("error", "", "unknown"),
        # Reasons are for errors alone.
        ("timeout", "exception: X: y", "timeout"),
    ],
)
def test_each_failure_has_its_kind(outcome, reason, kind):
    table = runs(outcome=[outcome, "success"], reason=[reason, ""])
    table.index = [7, 3]
    found = failure_kind(table)
    assert found.tolist() == [kind, ""]
    assert found.index.tolist() == [7, 3]
    assert kind in ("", *FAILURE_KINDS)


def test_an_older_table_is_read_and_its_metrics_are_undefined(tmp_path):
    """Without any of the columns that came later."""
    old = runs().drop(columns=list(OPTIONAL_COLUMNS))
    path = tmp_path / "episodes.csv"
    old.to_csv(path, index=False)
    table = load_episodes(path)
    assert list(table.columns[-len(OPTIONAL_COLUMNS) :]) == list(OPTIONAL_COLUMNS)
    for name in ("min_clearance_m", "jerk_m_s3", "recoveries", "spl", "score_4_8"):
        assert np.isnan(values(name, table)).all()
    assert values("success", table) == [1.0, 0.0]
    assert values("time_s", table) == [12.0, 100.0]


def test_printed_values_have_their_unit_s_scale():
    assert METRICS["success"].printed(0.9876) == "98.8"
    assert METRICS["time_s"].printed(12.345) == "12.35"
    assert METRICS["time_s"].printed(float("nan")) == ""


def test_the_page_has_every_metric_as_it_is_defined():
    assert PAGE.read_text(encoding="utf-8") == render(), f"run: {REMAKE}"
    for metric in METRICS.values():
        assert f"| `{metric.name}` |" in render()
    assert f"version {METRICS_VERSION}" in render()
    for kind in FAILURE_KINDS:
        assert f"| `{kind}` | " in render()
