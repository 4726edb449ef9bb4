"""Workers that are lost, hang, pause, fork or lose their parent."""

import ctypes
import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
from pathlib import Path

import pytest

from hlsd.core import watch
from hlsd.core.executor import Lost, tell
from hlsd.core.importing import path_with_working_directory_last
from hlsd.core.processes import Pool, Processes
from tests.conftest import heed_signals

ROOT = Path(__file__).resolve().parents[2]
posix = pytest.mark.skipif(os.name != "posix", reason="needs signals")
linux = pytest.mark.skipif(sys.platform != "linux", reason="needs /proc")


def run(function, tasks, told=None, jobs=2):
    return dict(Processes(jobs).run(function, tasks, told=told))


def living(mark):
    """Processes whose environment holds a mark, those aside that only wait to go."""
    found = []
    for folder in Path("/proc").iterdir():
        try:
            state = (folder / "stat").read_text().rpartition(")")[2].split()[0]
            if mark.encode() in (folder / "environ").read_bytes() and state != "Z":
                found.append(int(folder.name))
        except (OSError, ValueError, IndexError):
            continue
    return found


def wait_for_none(mark, limit_s=5.0):
    deadline = time.monotonic() + limit_s
    while left := living(mark):
        assert time.monotonic() < deadline, f"{left} live on"
        time.sleep(0.05)


@posix
def test_a_lost_worker_is_replaced_and_all_others_go_on():
    def work(task):
        tell(("doing", task))
        if task == 1:
            os._exit(3)
        if task == 2:
            os.kill(os.getpid(), signal.SIGKILL)
        if task == 3:
            ctypes.string_at(0)
        return task * 10

    found = run(work, range(6))
    trace = found[3].trace
    assert found == {
        0: 0,
        1: Lost(("doing", 1), exit_code=3),
        2: Lost(("doing", 2), exit_code=-signal.SIGKILL),
        3: Lost(("doing", 3), exit_code=-signal.SIGSEGV, trace=trace),
        4: 40,
        5: 50,
    }
    assert "Segmentation fault" in trace
    assert "string_at" in trace, "where it was"


def test_a_pool_keeps_its_processes_and_functions_are_not_mixed_up():
    with Pool(1) as pool:
        first = dict(pool.run(lambda task: (os.getpid(), task + 1), [1, 2]))
        second = dict(pool.run(lambda task: (os.getpid(), task * 7), [1, 2]))
        pool.close()
        third = dict(pool.run(lambda task: (os.getpid(), task), [1]))
    pids = {pid for pid, _ in (*first.values(), *second.values())}
    assert len(pids) == 1
    assert [value for _, value in second.values()] == [7, 14]
    assert third[0][0] not in pids


@posix
def test_what_cannot_even_be_read_is_lost_without_a_word():
    class Deadly:
        def __reduce__(self):
            return os._exit, (5,)

    assert run(lambda task: task, [Deadly()]) == {0: Lost(None, exit_code=5)}


@linux
def test_a_call_that_does_not_return_is_ended():
    def work(task):
        tell("before")
        begun = watch.begin(0.5)
        if task == "in Python":
            time.sleep(600)
        if task == "in C":  # without letting go of the interpreter
            ctypes.PyDLL(None).sleep(600)
        if task == "many short ones":
            for _ in range(10):
                watch.end(begun)
                time.sleep(0.1)
                begun = watch.begin(0.5)
        watch.end(begun)
        return task

    found = run(work, ["in Python", "in C", "many short ones"])
    assert found[2] == "many short ones"
    for number in (0, 1):
        assert (found[number].said, found[number].hung_s) == ("before", 0.5)
        assert "in work" in found[number].trace, "where it stood"


@linux
def test_a_pause_of_a_worker_does_not_count():
    def work(_task):
        begun = watch.begin(1.2)
        tell(os.getpid())
        time.sleep(0.6)
        watch.end(begun)
        return "done"

    def told(_number, pid):
        os.kill(pid, signal.SIGSTOP)
        threading.Timer(2.5, os.kill, (pid, signal.SIGCONT)).start()

    began = time.monotonic()
    assert run(work, [0], told) == {0: "done"}
    assert time.monotonic() - began > 2.5


@linux
def test_a_worker_that_stays_stopped_is_ended():
    def work(_task):
        watch.begin(0.2)
        os.kill(os.getpid(), signal.SIGSTOP)

    assert run(work, [0])[0].hung_s == 0.2


PAUSED = """
    import os, time
    from hlsd.core import watch
    from hlsd.core.executor import tell
    from hlsd.core.processes import Processes

    def work(task):
        begun = watch.begin(1.2)
        tell(os.getpid())
        time.sleep(0.6)
        watch.end(begun)
        return "done"

    def told(number, pid):
        print(pid, flush=True)

    print(list(Processes(1).run(work, [0], told=told)))
"""


def start(script, tmp_path, mark):
    return subprocess.Popen(
        [sys.executable, "-c", textwrap.dedent(script)],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT), "HLSD_TEST_MARK": mark},
        stdout=subprocess.PIPE,
        text=True,
        preexec_fn=heed_signals,
    )


@linux
def test_a_pause_of_all_does_not_count(tmp_path):
    """As when a laptop is closed, or a machine has no time for us."""
    with start(PAUSED, tmp_path, f"all-{tmp_path.name}") as parent:
        worker = int(parent.stdout.readline())
        for pid in (worker, parent.pid):
            os.kill(pid, signal.SIGSTOP)
        time.sleep(2.0)
        for pid in (parent.pid, worker):
            os.kill(pid, signal.SIGCONT)
        assert parent.stdout.read() == "[(0, 'done')]\n"


KILLED = """
    import ctypes, os, subprocess, sys
    from hlsd.core.executor import tell
    from hlsd.core.processes import Processes

    def work(task):
        subprocess.Popen(["sleep", "600"])
        if os.fork() == 0:
            ctypes.PyDLL(None).sleep(600)
        tell(os.getpid())
        ctypes.PyDLL(None).sleep(600)  # keeps the interpreter to itself

    def told(number, pid):
        print(pid, flush=True)

    list(Processes(2).run(work, [0, 1], told=told))
"""


@linux
@pytest.mark.parametrize("number", [signal.SIGKILL, signal.SIGTERM, signal.SIGHUP])
def test_nothing_outlives_a_parent_that_was_ended(tmp_path, number):
    mark = f"killed-{tmp_path.name}"
    with start(KILLED, tmp_path, mark) as parent:
        for _ in range(2):
            parent.stdout.readline()
        assert len(living(mark)) >= 7, "parent, and two of worker, sleep and fork"
        parent.send_signal(number)
        try:
            parent.wait(60)
        finally:
            parent.kill()
        wait_for_none(mark)


@linux
def test_what_a_task_leaves_running_ends_with_the_workers(monkeypatch, tmp_path):
    mark = f"left-{tmp_path.name}"
    monkeypatch.setenv("HLSD_TEST_MARK", mark)

    def work(task):
        subprocess.Popen(["sleep", "600"])
        if os.fork() == 0:
            time.sleep(600)
        threading.Thread(target=time.sleep, args=(600,)).start()
        if task == "dies":
            os._exit(4)
        return os.getpid()

    found = run(work, ["returns", "dies"])
    assert found[1] == Lost(None, exit_code=4)
    wait_for_none(mark)


@posix
def test_a_fork_that_comes_back_does_not_go_on_as_the_worker():
    def work(task):
        begun = watch.begin(30.0)
        os.fork()
        watch.end(begun)
        return task

    results = list(Processes(1).run(work, range(3)))
    assert results == [(0, 0), (1, 1), (2, 2)]


def test_what_tasks_print_is_no_output_of_ours(capfd):
    assert run(lambda task: print(f"task {task} \udc80"), [0], jobs=1) == {0: None}
    printed = capfd.readouterr()
    assert printed.out == ""
    assert "task 0" in printed.err


SHADOWED = """
    import json, sys
    from hlsd.core.processes import Processes
    sys.path.insert(0, FIRST)

    def look(_task):
        import os, json, tempfile
        safe = os.environ.get("PYTHONSAFEPATH")
        return sys.path, json.__file__, tempfile.__file__, safe

    ((_, (path, *files, safe)),) = Processes(1).run(look, [0])
    import os
    here = os.getcwd()
    assert path[-1] == here and here not in path[:-1] and "" not in path, path
    assert not any(file.startswith(here) for file in files), files
    assert safe is None
    print("well")
"""


@pytest.mark.parametrize("first", ["", "."])
def test_the_working_directory_comes_last_in_workers(tmp_path, first):
    """Though it comes first in the parent, as in a notebook."""
    script = textwrap.dedent(SHADOWED).replace("FIRST", repr(first))
    names = ("json", "tempfile", "numpy", "random", "struct", "cloudpickle", "pickle")
    for name in names:
        (tmp_path / f"{name}.py").write_text("raise ImportError('not this one')\n")
    result = subprocess.run(
        [sys.executable, "-P", "-c", script],
        cwd=tmp_path,
        env={"PATH": os.environ["PATH"], "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert (result.stdout, result.returncode) == ("well\n", 0), result.stderr


def test_a_folder_of_pythonpath_stays_where_the_user_put_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    here = str(tmp_path)
    monkeypatch.setattr(sys, "path", [here, *sys.path])
    assert path_with_working_directory_last()[-1] == here
    assert path_with_working_directory_last().count(here) == 1
    monkeypatch.setenv("PYTHONPATH", here)
    assert path_with_working_directory_last()[0] == here


ELSEWHERE = """
    import multiprocessing.connection, multiprocessing.sharedctypes
    import multiprocessing.reduction, os, signal, sys
    import cloudpickle, numpy
    for module, names in (
        (os, "setsid killpg fork getpgrp register_at_fork waitid sched_getaffinity"),
        (signal, "pthread_sigmask SIGUSR1 SIGUSR2 SIGALRM SIGHUP setitimer"),
    ):
        for name in names.split():
            delattr(module, name)
    sys.platform = "win32"
    import hlsd.core.machine, hlsd.core.processes, hlsd.core.worker
    import hlsd.run.surroundings
    here = hlsd.run.surroundings.Surroundings.here()
    here.restore(here)
    assert hlsd.core.machine.cores(None) >= 1
    print("well")
"""


def test_it_can_be_imported_where_the_system_has_less():
    result = subprocess.run(
        [sys.executable, "-c", textwrap.dedent(ELSEWHERE)],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert (result.stdout, result.returncode) == ("well\n", 0), result.stderr
