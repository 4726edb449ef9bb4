"""The table across papers: made from runs, and only what is missing is driven."""

from dataclasses import replace

import pytest

import hlsd.run.work as work_module
from hlsd.core.errors import HlsdError
from hlsd.planners.registry import BUILT_IN, NEED_CHECKPOINTS
from hlsd.run.outcome import Outcome
from scripts.across_papers import (
    BEGIN,
    END,
    PAGE,
    PLANNERS,
    TEMPLATE,
    filled,
    main,
    published_text,
)
from tests.analysis.test_challenge import EPISODE
from tests.project.test_docs import broken_links


@pytest.fixture
def page(tmp_path, monkeypatch):
    """A page to write into; hlsd10 takes 10 s, pursuit 20 s or fails every third."""
    page = tmp_path / "page.md"
    page.write_text(f"before\n\n{BEGIN}\nold\n{END}\n\nafter\n", encoding="utf-8")

    def drive(course, planner, seed, trial):
        driven.append(type(planner).__name__)
        slow = "Pursuit" in driven[-1]
        if slow and (course.world.index // 6) % 3 == 0:
            return replace(EPISODE, outcome=Outcome.COLLISION, time_s=4.0)
        time_s = (20.0 if slow else 10.0) + 0.1 * trial
        return replace(EPISODE, outcome=Outcome.SUCCESS, time_s=time_s)

    driven = []
    monkeypatch.setattr(work_module, "run_episode", drive)
    return page, driven


def rows_of(text):
    rows = [line.strip("| ").split(" | ") for line in text.splitlines() if "|" in line]
    return {row[0]: row for row in rows[2:]}


def test_the_table_has_every_planner_beside_what_is_published(page, tmp_path):
    page, driven = page
    look = ["--trials", "2", "--worlds", "0:60:6", "--jobs", "1", "--page", str(page)]
    two = ["--planner", "hlsd10", "--against", "pursuit", *look]
    main(["--out", str(tmp_path / "runs"), *two])
    assert len(driven) == 2 * 10 * 2  # pursuit, too, which it is held against
    text = page.read_text(encoding="utf-8")
    assert text.startswith(f"before\n\n{BEGIN}\n\nbarn300, 10 worlds, 2 runs each,")
    assert text.endswith(f"{END}\n\nafter\n")
    assert "first look, not the evaluation: 10 of the 50 test worlds" in text
    rows = rows_of(text)
    assert list(rows) == ["hlsd10", "pursuit"]  # by score
    assert rows["pursuit"][2] == rows["pursuit"][3] == "–"
    score, difference = (float(rows["hlsd10"][k].split()[0]) for k in (1, 2))
    assert difference == pytest.approx(
        score - float(rows["pursuit"][1].split()[0]), abs=2e-4
    )
    assert rows["hlsd10"][2].endswith("better")
    assert rows["pursuit"][5].startswith("40.0 % (")  # worlds 0, 18, 36 and 54
    assert "8.5 ± 6.3 s on the paper's own course" in rows["hlsd10"][-1]
    assert rows["pursuit"][-1] == "none known"
    # One taken from its folder, then all again.
    before = len(driven)
    main(
        [
            str(tmp_path / "runs" / "hlsd10"),
            *("--out", str(tmp_path / "more"), "--planner", "hlsd10"),
            *("--against", "hlsd10", *look),
        ]
    )
    assert len(driven) == before
    main(["--out", str(tmp_path / "runs"), *two])
    assert len(driven) == before
    assert page.read_text(encoding="utf-8") == text


def test_runs_that_do_not_go_together_are_refused(page, tmp_path):
    page, _ = page
    before = page.read_text(encoding="utf-8")
    base = ["--out", str(tmp_path / "runs"), "--page", str(page), "--jobs", "1"]
    base += ["--worlds", "0,42", "--planner"]
    main([*base, "pursuit", "--against", "pursuit", "--trials", "1"])
    written = page.read_text(encoding="utf-8")
    assert written != before
    with pytest.raises(HlsdError, match=r"other worlds or trials .*hlsd10 4 runs"):
        main([*base, "hlsd10", "--against", "pursuit", "--trials", "2"])
    folder = str(tmp_path / "runs" / "pursuit")
    with pytest.raises(HlsdError, match=r"'pursuit' is in .* and in"):
        main([folder, folder, *base, "pursuit"])
    assert page.read_text(encoding="utf-8") == written
    for text in ("none", f"{BEGIN}{END}{BEGIN}{END}", f"{END}{BEGIN}"):
        with pytest.raises(HlsdError, match="once each, in this order"):
            filled(text, "table")


def test_the_page_has_its_markers_and_links_and_every_planner_a_figure():
    for text in (TEMPLATE, PAGE):
        if text.exists():
            held = text.read_text(encoding="utf-8")
            assert filled(held, "| new |") != held
            assert broken_links(PAGE, held) == []
    assert set(PLANNERS) == set(BUILT_IN) - NEED_CHECKPOINTS
    assert "DWA, 0.5 m/s: 0.159 (2-8), 0.158 (4-8), 85.0 % success, 33.2 s, public" in (
        published_text("dwa05")
    )
    assert "2020" in published_text("eband")
