"""What the documents say is true: commands, links, and the code they show."""

import ast
import importlib
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from hlsd.data.worlds import load_suite
from hlsd.run.episode import Course, Outcome, run_episode
from hlsd.run.protocol import HLSD2021
from hlsd.sim.robots import get_robot
from scripts.make_cli_docs import PAGE, REMAKE, commands, render

ROOT = Path(__file__).resolve().parents[2]
PAGES = sorted(
    path
    for pattern in ("*.md", "docs/*.md", "docs/*/*.md", "*/README.md")
    for path in ROOT.glob(pattern)
    if not path.relative_to(ROOT).parts[0].startswith(".")
)
COMMANDS = {command.name: command for command in commands()}
EXAMPLES = sorted(path.stem for path in (ROOT / "examples").glob("*.py"))
# A fenced block: its info string and its text.
FENCE = re.compile(r"^```([^\n`]*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
LINK = re.compile(r"\]\(([^)\s]+)\)|(?:src|href)=\"([^\"]+)\"")


def name_of(page):
    return page.relative_to(ROOT).as_posix()


def blocks(text, *infos):
    """Texts of the fenced blocks with one of these info strings."""
    return [body for info, body in FENCE.findall(text) if info.strip() in infos]


def anchors(text):
    """Anchors of a page's headings, as GitHub makes them."""
    titles = re.findall(r"^#+ (.*)$", FENCE.sub("", text), re.MULTILINE)
    plain = (re.sub(r"[^\w\- ]", "", title.lower()) for title in titles)
    return {title.strip().replace(" ", "-") for title in plain}


def broken_links(page, text):
    """Relative links of a page that lead nowhere, or out of the project."""
    broken = []
    for match in LINK.finditer(FENCE.sub("", text)):
        link = match[1] or match[2]
        if re.match(r"[a-z]+:", link):
            continue
        path, _, anchor = link.partition("#")
        target = (page.parent / path).resolve() if path else page
        if not (target.is_relative_to(ROOT) and target.exists()):
            broken.append(link)
        elif anchor and target.suffix == ".md":
            there = text if target == page else target.read_text(encoding="utf-8")
            if anchor not in anchors(there):
                broken.append(link)
    return broken


def shell_words(text):
    """Command lines of `hlsd` and `make` in a page's shell blocks, as words."""
    for body in blocks(text, "", "sh", "bash", "console"):
        for line in body.replace("\\\n", " ").splitlines():
            line = line.removeprefix("$ ").replace("python cli.py ", "hlsd ")
            if line.startswith(("hlsd ", "make ")):
                yield shlex.split(line, comments=True)


def unknown_options(words):
    """What a line `hlsd ...` names that does not exist."""
    depth = max(n for n in (1, 2, 3) if " ".join(words[:n]) in COMMANDS)
    command, rest = COMMANDS[" ".join(words[:depth])], words[depth:]
    known = {"-h", "--help"}
    for parameter in command.parameters:
        known.update(parameter.name.split(", "))
    options = {word.split("=")[0] for word in rest if word.startswith("-")}
    return (options - known) | (set(rest) - options if command.is_group else set())


def planner_classes(tree):
    """Names of the classes of a module that have a method `plan`."""
    return [
        node.name
        for node in tree.body
        if isinstance(node, ast.ClassDef)
        and any(isinstance(n, ast.FunctionDef) and n.name == "plan" for n in node.body)
    ]


def drive(code, folder):
    """Write a block to a file of the user's and run its planner on a world."""
    (folder / "my_planner.py").write_text(code, encoding="utf-8")
    (planner,) = planner_classes(ast.parse(code))
    result = subprocess.run(
        [
            *(sys.executable, "-m", "hlsd", "bench"),
            *("--planner", f"my_planner:{planner}"),
            *("--worlds", "0", "--trials", "1", "--out", "run"),
        ],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    rows = (folder / "run" / "episodes.csv").read_text(encoding="utf-8")
    assert ",error," not in rows, rows


def test_the_command_reference_is_up_to_date():
    assert PAGE.read_text(encoding="utf-8") == render(), f"run: {REMAKE}"


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_and_option_has_help(name):
    command = COMMANDS[name]
    assert command.help
    for parameter in command.parameters:
        assert parameter.help, f"{name} {parameter.name} says nothing"
        assert parameter.help.endswith("."), f"{name} {parameter.name}: no full stop"


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_links_lead_somewhere(page):
    assert broken_links(page, page.read_text(encoding="utf-8")) == []


def test_a_link_to_nowhere_is_noticed():
    page = ROOT / "README.md"
    text = (
        "# A page: [commands](docs/cli.md#hlsd-bench), [top](#a-page-commands-top)\n"
        "[gone](docs/none.md) [lost](docs/cli.md#hlsd-fly) [out](../shared/x)\n"
        '[web](https://example.org) <img src="docs/none.png">\n'
        "```\n[code](is/no/link)\n```\n"
    )
    broken = broken_links(page, text)
    assert {"docs/none.md", "docs/cli.md#hlsd-fly", "../shared/x"} <= set(broken)
    assert "docs/none.png" in broken
    assert not {"docs/cli.md#hlsd-bench", "is/no/link"} & set(broken)


@pytest.mark.parametrize("page", PAGES, ids=name_of)
def test_commands_on_the_page_exist(page):
    """Every `hlsd ...` and `make ...` line names commands and options that exist."""
    targets = re.findall(r"^([\w-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE)
    for words in shell_words(page.read_text(encoding="utf-8")):
        if words[0] == "make":
            assert set(words[1:]) <= set(targets), words
        else:
            assert not unknown_options(words), words


def test_a_command_that_does_not_exist_is_noticed():
    text = "```sh\n$ hlsd fly\nhlsd bench --planer x \\\n  --seed=1\nhlsd -h\n```\n"
    assert [unknown_options(words) for words in shell_words(text)] == [
        {"fly"},
        {"--planer"},
        set(),
    ]


def test_readme_planner_drives(tmp_path):
    """Blocks marked ```python run are whole programs."""
    found = blocks((ROOT / "README.md").read_text(encoding="utf-8"), "python run")
    if not found:
        pytest.skip("README.md shows no planner yet")
    for number, code in enumerate(found):
        folder = tmp_path / str(number)
        folder.mkdir()
        drive(code, folder)


def test_a_block_that_does_not_run_is_noticed(tmp_path):
    source = (ROOT / "examples" / "follow_path.py").read_text(encoding="utf-8")
    wrong = source.replace("local_goal_in_base", "goal_of_yesterday")
    text = f"```python\nno program\n```\n```python run\n{wrong}```\n"
    (code,) = blocks(text, "python run")
    with pytest.raises(AssertionError, match="goal_of_yesterday"):
        drive(code, tmp_path)


@pytest.mark.parametrize("name", EXAMPLES)
def test_examples_import_and_their_planners_drive(name):
    path = ROOT / "examples" / f"{name}.py"
    module = importlib.import_module(f"examples.{name}")
    assert module.__doc__
    course = Course(load_suite("barn300")[0], get_robot("jackal"), HLSD2021)
    for planner in planner_classes(ast.parse(path.read_text(encoding="utf-8"))):
        episode = run_episode(course, getattr(module, planner)(), seed=0, trial=0)
        assert episode.outcome is Outcome.SUCCESS, episode.reason
