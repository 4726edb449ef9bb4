"""docs/how-to/robot.md, from outside the package: its files, its check, its drive."""

import re
import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "how-to" / "robot.md"


def block(language, number=0):
    """A fenced block of the page."""
    text = PAGE.read_text(encoding="utf-8")
    return re.findall(rf"^```{language}\n(.*?)^```$", text, re.M | re.S)[number]


@pytest.fixture
def package(tmp_path):
    """The page's package, in a folder of the user's."""
    folder = tmp_path / "my_robots"
    folder.mkdir()
    (folder / "cart.xml").write_text(block("xml"), encoding="utf-8")
    (folder / "__init__.py").write_text(block("python"), encoding="utf-8")
    return tmp_path


def run(code, folder):
    result = subprocess.run(
        [sys.executable, "-c", code],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    return result.stdout


def test_the_robot_of_the_page_keeps_the_contract(package):
    run(block("python", 1), package)


def test_the_robot_of_the_page_reaches_the_goal(package):
    assert run(block("python", 2), package).startswith("success ")


def test_the_announcement_names_the_description(package):
    points = tomllib.loads(block("toml"))["project"]["entry-points"]["hlsd.robots"]
    for name, value in points.items():
        module, attribute = value.split(":")
        code = f"import {module}; print({module}.{attribute}.name)"
        assert run(code, package) == f"{name}\n"
