"""How many runs failed by which cause, in rows, tables and the summary."""

import pandas as pd
import pytest

from hlsd.analysis.causes import cause_counts, failure_cause
from hlsd.analysis.runs import load_episodes
from hlsd.analysis.statistics import rate_interval
from hlsd.core.errors import HlsdError
from hlsd.report.cause_table import cause_note, cause_table
from hlsd.report.summary import summary_markdown
from hlsd.run.cause import Cause
from tests.report.test_report import episodes, write_run

POCKET = {"cause": "pocket", "cause_s": 12.5}
ROWS = [
    *[("a", world, trial, 9.0) for world in range(4) for trial in (0, 1)],
    ("a", 4, 0, "timeout", POCKET),
    ("a", 4, 1, "timeout", {"cause": "froze", "cause_s": 0.0}),
    ("a", 5, 0, "timeout", POCKET),
    ("a", 5, 1, "exception: ValueError: no"),
    *[("b", world, trial, 9.0) for world in range(6) for trial in (0, 1)],
]


def test_each_failure_is_counted_once():
    rows = episodes(ROWS)
    found = list(cause_counts(rows))
    assert [(c.planner, c.cause, c.count) for c in found] == [
        ("a", "froze", 1),
        ("a", "pocket", 2),
        ("a", "exception", 1),
    ]
    assert sum(c.of_failures for c in found) == pytest.approx(1.0)
    assert sum(c.of_runs for c in found) == pytest.approx(4 / 12)
    pocket = (failure_cause(rows) == "pocket").to_numpy(float)[:12]
    worlds = rows["world"].to_numpy()[:12]
    assert (found[1].low, found[1].high) == rate_interval(pocket, worlds)


def test_the_table_and_the_summary_say_so():
    rows = episodes(ROWS)
    table = cause_table(rows)
    assert [[cell.text for cell in row[:4]] for row in table.rows] == [
        ["a", "froze", "1", "25.0"],
        ["a", "pocket", "2", "50.0"],
        ["a", "exception", "1", "25.0"],
    ]
    assert "| pocket | 2 | 50.0 | 16.7 (" in table.markdown()
    note = "a: froze 1, pocket 2, exception 1."
    assert cause_note(rows) == [f"Why they failed (docs/causes.md). {note}"]
    assert note in summary_markdown(rows)


def test_runs_that_know_no_causes_have_no_table():
    rows = episodes([("a", 0, 0, "timeout"), ("a", 1, 0, 9.0)])
    assert failure_cause(rows).tolist() == ["timeout", ""]
    assert cause_table(rows) is None
    assert "Why they failed" not in summary_markdown(rows)


def test_a_table_without_the_columns_is_read(tmp_path):
    folder = write_run(tmp_path / "run", episodes([("a", 0, 0, "timeout", POCKET)]))
    assert load_episodes(folder)["cause"].tolist() == ["pocket"]
    file = folder / "episodes.csv"
    old = pd.read_csv(file, dtype=str, keep_default_na=False)
    old.drop(columns=["cause", "cause_s"]).to_csv(file, index=False)
    rows = load_episodes(folder)
    assert rows["cause"].tolist() == [""]
    assert rows["cause_s"].isna().all()
    assert cause_table(rows) is None


@pytest.mark.parametrize(
    ("end", "cause", "wanted"),
    [
        (9.0, "pocket", "want nothing, for a success"),
        ("exception: no", "pocket", "want nothing, for a error"),
        ("timeout", "bad luck", f"want one of {Cause.HIT_BY_MOVER}"),
    ],
)
def test_a_cause_that_cannot_be_is_refused(tmp_path, end, cause, wanted):
    rows = episodes([("a", 0, 0, end, {"cause": cause})])
    folder = write_run(tmp_path / "run", rows)
    with pytest.raises(HlsdError, match=wanted):
        load_episodes(folder)
