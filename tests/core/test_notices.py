"""Notes for whoever waits: said once, to the innermost listener, from any process."""

import importlib.util
import itertools

import pytest

from hlsd.core import kernel_cache, kernel_folders
from hlsd.core.executor import Lost, LostWorkerError
from hlsd.core.notices import notice, noticing
from hlsd.core.progress import StageProgress
from hlsd.run.crew import Crew
from hlsd.run.drivers import driver
from hlsd.run.work import Begun, Noted, Task


def test_the_innermost_listener_and_from_it_the_one_before():
    outer, inner = [], []
    notice("nobody listens")
    with noticing(outer.append):
        notice("a")
        with noticing(lambda line: (inner.append(line), notice(f"on: {line}"))):
            notice("b")
        notice("c")
    assert (outer, inner) == (["a", "on: b", "c"], ["b"])


def test_progress_prints_the_first_of_a_kind(capsys):
    with StageProgress():
        notice("compiling kernels: about 45 s")
        notice("compiling kernels: about 5 s")
        notice("first episode: a")
    assert capsys.readouterr().err.splitlines() == [
        "compiling kernels: about 45 s",
        "first episode: a",
    ]


KERNEL = """
from hlsd.core.compiled import compiled

@compiled
def doubled(x):
    return 2 * x
"""


def test_a_kernel_that_is_compiled_is_told_and_a_kept_one_is_not(tmp_path):
    file = tmp_path / "kernels_of_mine.py"
    file.write_text(KERNEL)

    def call():
        spec = importlib.util.spec_from_file_location("kernels_of_mine", file)
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        kernel_cache._compiling.cache_clear()
        told = []
        with noticing(told.append):
            assert module.doubled(2.0) == 4.0
        return told

    (line,) = call()
    assert line.startswith("compiling kernels: ")
    assert call() == []


def test_whether_there_are_any_kernels(tmp_path, monkeypatch):
    package = tmp_path / "hlsd"
    (package / "core" / "__pycache__").mkdir(parents=True)
    monkeypatch.setattr(kernel_folders, "__file__", str(package / "core" / "x.py"))
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    monkeypatch.setattr(kernel_folders.tempfile, "gettempdir", lambda: str(tmp_path))
    assert not kernel_folders.any_kernels()
    (chosen,) = itertools.islice(kernel_folders.folders_of(package / "core", "a"), 1)
    monkeypatch.chdir(tmp_path)
    chosen.mkdir(parents=True)
    (chosen / "f.kernel").touch()
    assert not kernel_folders.any_kernels()
    monkeypatch.setenv("NUMBA_CACHE_DIR", "a")
    assert kernel_folders.any_kernels()


class Fake:
    """An executor whose worker says something and is lost."""

    def __init__(self, *said):
        self.said = said
        self.rounds = 0

    def run(self, function, tasks, *, told=None):
        self.rounds += 1
        assert self.rounds < 20, "it never ends"
        for number, _ in enumerate(tasks):
            for message in self.said:
                told(number, message)
            yield number, Lost(said=self.said[-1])


def drive(executor):
    crew = Crew(executor, (driver("pursuit"),))
    told = []
    with noticing(told.append), pytest.raises(LostWorkerError):
        list(crew.drive(None, [Task(0, (("pursuit", 0),))]))
    return told


def test_notes_of_workers_arrive_and_say_nothing_of_their_tasks():
    """A worker that compiles and is lost before it begins is none that drove."""
    fake = Fake(Noted("compiling kernels: x"))
    assert set(drive(fake)) == {"compiling kernels: x"}
    assert fake.rounds == 3
    assert Begun(("pursuit", 0)) != Noted("x")
