"""Modules from files: each folder apart, and nothing that is installed is hidden."""

import subprocess
import sys

import pytest

from hlsd.core.beside import FileReference, plain
from hlsd.core.errors import HlsdError
from hlsd.core.imported import (
    code_of,
    digest_of,
    forget_edited,
    require_loaded,
)
from hlsd.planners.registry import planners
from hlsd.run.protocol import protocols

PLANNER = """
import json
import numpy
import {helper}
from {helper} import GAIN as taken

class Mine:
    period_s = 0.05

    def reset(self, setup):
        pass

    def plan(self, observation):
        from {helper} import GAIN
        assert GAIN == taken == {helper}.GAIN
        return GAIN, json.dumps({{}}), numpy.ones(1).sum()

class Other:
    pass
"""


def write(folder, gain, helper="helper"):
    folder.mkdir(parents=True)
    (folder / "mine.py").write_text(PLANNER.format(helper=helper))
    (folder / f"{helper}.py").write_text(f"GAIN = {gain}\n")
    return FileReference.read(f"{folder}/mine.py:Mine")


def test_two_files_of_one_name_are_two_modules_with_what_lies_beside_each(tmp_path):
    for number in (1, 2):
        (tmp_path / str(number)).mkdir()
        reference = write(tmp_path / str(number) / "x", number)
        # Neither hides what Python and packages bring along.
        for name in ("json.py", "numpy.py", "hlsd.py"):
            (reference.file.parent / name).write_text("1 / 0\n")
    for number in (1, 2):
        reference = FileReference.read(f"{tmp_path}/{number}/x/mine.py:Mine")
        planner = reference.load().Mine()
        assert planner.plan(None) == (number, "{}", 1.0)
    assert "helper" not in sys.modules
    assert not any(str(tmp_path) in place for place in sys.path)


def test_the_same_files_elsewhere_are_the_same_code(tmp_path):
    digests = []
    for name, gain in (("a", 1), ("b", 1), ("c", 2)):
        reference = write(tmp_path / name, gain)
        reference.load()
        code = code_of([reference.module])
        assert {plain(module) for module in code} == {"mine", "helper"}
        digests.append(digest_of(code))
    assert digests[0] == digests[1] != digests[2]
    # As is the module, imported by its name.
    probe = (
        "import mine; from hlsd.core.imported import code_of, digest_of; "
        "print(digest_of(code_of(['mine'])))"
    )
    done = subprocess.run(
        [sys.executable, "-c", probe],
        cwd=tmp_path / "a",
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.strip() == digests[0]


def test_an_edit_of_what_lies_beside_is_loaded_anew(tmp_path):
    reference = write(tmp_path / "edited", 1)
    assert reference.load().Mine().plan(None)[0] == 1
    require_loaded(code_of([reference.module]))  # as a run does
    (reference.file.parent / "helper.py").write_text("GAIN = 22\n")
    with pytest.raises(HlsdError, match="module 'helper' was edited after this"):
        require_loaded(code_of([reference.module]))
    forget_edited(reference.module)
    assert reference.load().Mine().plan(None)[0] == 22


def test_a_file_in_a_package_is_a_part_of_it(tmp_path):
    inner = tmp_path / "my_package" / "inner"
    inner.mkdir(parents=True)
    for folder in (inner, inner.parent):
        (folder / "__init__.py").write_text("")
    (inner.parent / "gains.py").write_text("GAIN = 7\n")
    (inner / "mine.py").write_text(
        "from ..gains import GAIN\nfrom my_package.gains import GAIN as again\n"
    )
    reference = FileReference.read(f"{inner}/mine.py:Mine")
    module = reference.load()
    assert module.GAIN == module.again == 7
    assert reference.plain == "my_package.inner.mine:Mine"
    assert "my_package.gains" in {plain(name) for name in code_of([reference.module])}


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("mine.py:Mien", "has no 'Mien', it has Mine: give {}/mine.py:Mine"),
        ("mine.py", "is a module, it has Mine: give {}/mine.py:Mine"),
        ("nine.py:Mine", "there is no file {}/nine.py: give path/to/file.py:attribute"),
        ("broken.py:Mine", "cannot be imported: SyntaxError"),
        ("divides.py:Mine", "ZeroDivisionError: division by zero (divides.py:2)"),
        ("lacks.py:Mine", "ModuleNotFoundError: No module named 'no_such_thing'"),
        ("my.planner.py:Mine", "a dot in the name of a Python file stands for"),
    ],
)
def test_what_is_not_there_is_refused_in_a_line(text, says, tmp_path):
    folder = tmp_path / "x"
    write(folder, 1)
    (folder / "broken.py").write_text("def f(:\n")
    (folder / "divides.py").write_text("a = 1\n1 / 0\n")
    (folder / "lacks.py").write_text("import no_such_thing\n")
    (folder / "my.planner.py").write_text("")
    with pytest.raises(HlsdError) as refused:
        planners.get(f"{folder}/{text}")
    assert says.format(folder) in str(refused.value)


def test_things_of_all_kinds_come_from_files(tmp_path):
    file = tmp_path / "rules.py"
    file.write_text(
        "from dataclasses import replace\nfrom hlsd.run.protocol import HLSD2021\n"
        "MINE = replace(HLSD2021, name='mine')\n"
    )
    assert protocols.get(f"{file}:MINE").name == "mine"
    with pytest.raises(HlsdError, match=r"it has HLSD2021, MINE: give .*:MINE"):
        protocols.get(f"{file}:MINES")
