"""The site: navigation, the pages of the API and the observation, the notebook."""

import dataclasses
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

import hlsd
from hlsd.core.description import LidarSpec, RobotLimits
from hlsd.data.worlds import load_suite
from hlsd.run.episode import Course, Outcome, run_episode
from hlsd.run.protocol import get_protocol
from hlsd.sim.robots import get_robot

ROOT = Path(__file__).resolve().parents[2]
DOCS = ROOT / "docs"
NOTEBOOK = ROOT / "examples" / "first_look.ipynb"
sys.path.append(str(ROOT / "tools" / "site"))
import site_parts  # noqa: E402  (as tools/site/conf.py imports it)

NAMED = [page for part in site_parts.NAVIGATION.values() for page in part]
LINK = re.compile(r"\]\(([^)\s]+)\)")
FENCE = re.compile(r"^```.*?^```$", re.MULTILINE | re.DOTALL)


def file_of(page):
    """The file of a page of the site."""
    files = [ROOT / f"{page}{suffix}" for suffix in (".md", ".ipynb")]
    return next((file for file in files if file.is_file()), None)


def test_every_page_is_in_the_navigation_once():
    assert len(set(NAMED)) == len(NAMED)
    assert [page for page in NAMED if file_of(page) is None] == []
    pages = {
        page.relative_to(ROOT).with_suffix("").as_posix() for page in DOCS.rglob("*.md")
    }
    missing = sorted(pages - set(NAMED))
    assert missing == [], "add them to NAVIGATION in tools/site/site_parts.py"
    shown = site_parts.page_text("README", "# hlsd\n")
    assert [page for page in NAMED if f"\n/{page}\n" not in shown] == []


@pytest.mark.parametrize("page", ["README", *NAMED])
def test_links_between_pages_lead_to_pages_of_the_site(page):
    """A page that GitHub shows but the site lacks would be a download."""
    text = site_parts.page_text(page, file_of(page).read_text(encoding="utf-8"))
    for link in LINK.findall(FENCE.sub("", text)):
        target = site_parts.target_of(page, link)
        if target is None or link.startswith("data:"):
            continue
        stem, suffix = os.path.splitext(target)
        assert (ROOT / target).is_file(), f"{link}: no file"
        if suffix in {".md", ".ipynb"}:
            assert stem in {"README", *NAMED}, f"{link}: not a page of the site"


def test_a_link_to_a_file_is_told_from_others():
    target_of = site_parts.target_of
    assert target_of("docs/how-to/robot", "../cli.md#hlsd") == "docs/cli.md"
    assert target_of("README", "docs/cli.md") == "docs/cli.md"
    assert target_of("README", "#install") is None
    assert target_of("README", "https://example.org/x.md") is None


def test_a_notebook_is_shown_with_what_it_printed():
    text = site_parts.page_text(
        "examples/first_look", NOTEBOOK.read_text(encoding="utf-8")
    )
    assert text.startswith("# First look\n")
    assert "](data:image/png;base64," in text
    assert re.search(r"^```text\n +planner +world", text, re.MULTILINE)


def test_every_public_name_is_on_the_page_of_the_api():
    text = (DOCS / "api.md").read_text(encoding="utf-8")
    names = sorted(set(dir(hlsd)) - {"__version__"})
    assert sorted(re.findall(r"^- `hlsd\.(\w+)`", text, re.MULTILINE)) == names
    shown = site_parts.page_text("docs/api", text)
    assert ".. autofunction:: hlsd.bench\n" in shown
    assert ".. autoclass:: hlsd.Observation\n   :members:\n" in shown


def rows(section):
    """The first cells of a section's tables on the page of the observation."""
    text = (DOCS / "observation.md").read_text(encoding="utf-8")
    (body,) = re.findall(rf"^## {section}\n(.*?)(?=^## |\Z)", text, re.S | re.MULTILINE)
    return re.findall(r"^\| `(\w+)` \|", body, re.MULTILINE)


def fields(*kinds):
    return [field.name for kind in kinds for field in dataclasses.fields(kind)]


def test_every_field_that_a_planner_sees_is_explained():
    assert rows("Observation") == fields(hlsd.Observation)
    assert rows("Setup") == fields(hlsd.Setup, RobotLimits, LidarSpec)
    assert rows("Command") == fields(hlsd.Command)
    assert rows("Mode") == [mode.name for mode in hlsd.Mode]


def test_the_jackal_s_numbers_are_the_jackal_s():
    text = (DOCS / "observation.md").read_text(encoding="utf-8")
    for holder in (RobotLimits(), LidarSpec()):
        for field in dataclasses.fields(holder):
            value = getattr(holder, field.name)
            row = rf"^\| `{field.name}` \|[^|]*\| ([^|]*) \|"
            (cell,) = re.findall(row, text, re.MULTILINE)
            numbers = [float(number) for number in cell.split(", ")]
            wanted = value if isinstance(value, tuple) else (value,)
            assert numbers == pytest.approx(list(wanted), rel=1e-3), field.name


def test_modes_that_are_recoveries_are_named_so():
    text = (DOCS / "observation.md").read_text(encoding="utf-8")
    said = dict(re.findall(r"^\| `([A-Z_]+)` \| (yes|no) \|", text, re.MULTILINE))
    assert said == {m.name: "yes" if m.is_recovery else "no" for m in hlsd.Mode}


@pytest.mark.parametrize(
    ("page", "protocol"), [("start", "hlsd2021"), ("barn-teams", "barn2024")]
)
def test_the_planner_of_a_page_drives(page, protocol):
    text = (DOCS / f"{page}.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"^```python run\n(.*?)^```$", text, re.DOTALL | re.MULTILINE)
    held = {}
    exec(compile(code, page, "exec"), held)
    assert "mine.py:Mine" in text
    rules = get_protocol(protocol)
    course = Course(load_suite("barn300")[0], get_robot("jackal"), rules)
    episode = run_episode(course, held["Mine"](), seed=0, trial=0)
    # A planner of 15 lines may touch something; it must not be at fault.
    assert episode.outcome is not Outcome.ERROR, episode.reason
    assert episode.time_s > 5.0


# A cell after another, as a notebook runs them: it uses no magic and no `display`.
CELLS = """
import json, sys
for cell in json.load(open(sys.argv[1], encoding="utf-8"))["cells"]:
    if cell["cell_type"] == "code":
        exec(compile("".join(cell["source"]), cell["id"], "exec"), globals())
assert set(run.episodes["outcome"]) == {"success"}
assert len(axes.lines) == 3
"""


def test_the_notebook_runs(tmp_path):
    notebook = json.loads(NOTEBOOK.read_text(encoding="utf-8"))
    assert notebook["nbformat"] == 4
    done = subprocess.run(
        [sys.executable, "-c", CELLS, NOTEBOOK],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT), "MPLBACKEND": "agg"},
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    (verdict,) = re.findall(r"failures at the limit \[s\]: (\w+)", done.stdout)
    assert verdict in {"better", "worse", "equivalent", "inconclusive"}
