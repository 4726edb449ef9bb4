"""Executors: the same results everywhere, what tasks say, and how all of it ends."""

import multiprocessing
import os
import signal
import subprocess
import sys
import textwrap
import time
from pathlib import Path

import pytest

from hlsd.core.errors import HlsdError
from hlsd.core.executor import (
    LostWorkerError,
    Serial,
    executor,
    results,
    tell,
)
from hlsd.core.processes import Processes

ROOT = Path(__file__).resolve().parents[2]
THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def run(run_by, function, tasks, told=None):
    return dict(run_by.run(function, tasks, told=told))


@pytest.mark.parametrize("run_by", [Serial(), Processes(1), Processes(3)])
def test_results_do_not_depend_on_who_runs_the_tasks(run_by):
    offset = 10  # a closure, and a function that no module holds

    def square(task):
        tell(("begun", task))
        tell(("done", task))
        return task * task + offset

    said = []
    seen = {}
    for number, result in run_by.run(
        square, range(5), told=lambda *what: said.append(what)
    ):
        seen[number] = result
        assert (number, ("done", number)) in said, "told before its result"
    assert seen == {k: k * k + 10 for k in range(5)}
    for k in range(5):
        of_task = [message for number, message in said if number == k]
        assert of_task == [("begun", k), ("done", k)]
    assert run(run_by, square, []) == {}
    assert multiprocessing.active_children() == []


def test_one_job_is_this_process_and_none_is_refused():
    assert executor(1) == Serial()
    assert executor(2) == Processes(2)
    with pytest.raises(HlsdError, match="jobs is 0: at least 1 is needed") as refused:
        executor(0)
    assert refused.value.argument == "jobs"
    pids = run(executor(1), lambda _: os.getpid(), [0])
    assert pids == {0: os.getpid()}


def test_workers_have_one_thread_each_and_the_environment_stays(monkeypatch):
    monkeypatch.setenv("OMP_NUM_THREADS", "3")
    monkeypatch.delenv("MKL_NUM_THREADS", raising=False)
    before = dict(os.environ)
    main, mask = sys.modules["__main__"], signal.pthread_sigmask(signal.SIG_BLOCK, [])

    def environment(_task):
        return {name: os.environ.get(name) for name in THREADS}

    running = Processes(2).run(environment, range(4))
    first = next(running)
    assert dict(os.environ) == before
    assert dict([first, *running]) == dict.fromkeys(
        range(4), dict.fromkeys(THREADS, "1")
    )
    assert sys.modules["__main__"] is main
    assert signal.pthread_sigmask(signal.SIG_BLOCK, []) == mask


@pytest.mark.parametrize("run_by", [Serial(), Processes(2)])
def test_an_error_stops_all_at_once(run_by):
    def fail_first(task):
        if task == 0:
            raise HlsdError("trials is 0", argument="trials")
        time.sleep(60)

    began = time.monotonic()
    with pytest.raises(HlsdError, match=r"^trials is 0$") as failed:
        run(run_by, fail_first, range(5))
    assert failed.value.argument == "trials"
    assert time.monotonic() - began < 30
    assert multiprocessing.active_children() == []


def test_an_error_that_cannot_travel_is_told_in_words():
    class Error(Exception):
        def __init__(self, first, second):
            super().__init__(f"{first} and {second}")

    def fail(_task):
        raise Error("this", "that")

    with pytest.raises(RuntimeError, match="Error: this and that"):
        run(Processes(1), fail, [0])


def test_a_worker_that_dies_names_its_task():
    def die(task):
        if task == "world 7":
            os.kill(os.getpid(), signal.SIGKILL)
        time.sleep(60)

    with pytest.raises(
        LostWorkerError, match=r"^world 7 ended without a result"
    ) as lost:
        dict(results(Processes(2), die, ["world 3", "world 7", "world 9"]))
    assert (lost.value.number, lost.value.exit_code) == (1, -signal.SIGKILL)
    assert lost.value.argument == "jobs"
    assert multiprocessing.active_children() == []


def test_leaving_early_stops_all(capfd):
    def slow(task):
        tell(task)
        time.sleep(60 if task else 0)

    began = time.monotonic()
    for number, _ in Processes(2).run(slow, range(4)):
        assert number == 0
        break
    assert time.monotonic() - began < 30
    assert multiprocessing.active_children() == []

    def interrupt(_number, task):
        if task == 1:
            for child in multiprocessing.active_children():
                os.kill(child.pid, signal.SIGINT)  # as a terminal does
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(Processes(2), slow, range(4), interrupt)
    assert multiprocessing.active_children() == []
    assert capfd.readouterr().err == ""


def test_a_script_s_own_classes_travel_without_a_guard(tmp_path):
    """The workers do not run the script again, though it lacks the usual guard."""
    script = tmp_path / "script.py"
    script.write_text(
        textwrap.dedent("""
            from dataclasses import dataclass
            from hlsd.core.executor import executor

            @dataclass
            class Point:
                x: int

            def mirrored(point):
                return Point(-point.x)

            done = dict(executor(2).run(mirrored, [Point(1), Point(2)]))
            assert done == {0: Point(-1), 1: Point(-2)}, done
            assert type(done[0]) is Point
            print("once")
        """)
    )
    result = subprocess.run(
        [sys.executable, str(script)],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert (result.stdout, result.stderr, result.returncode) == ("once\n", "", 0)


def test_workers_end_when_their_parent_is_killed(tmp_path):
    script = textwrap.dedent("""
        import os, sys, time
        from hlsd.core.executor import tell
        from hlsd.core.processes import Processes

        def wait(task):
            tell(os.getpid())
            time.sleep(600)

        def told(number, pid):
            print(pid, flush=True)

        list(Processes(2).run(wait, [0, 1], told=told))
    """)
    parent = subprocess.Popen(
        [sys.executable, "-c", script],
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        stdout=subprocess.PIPE,
        text=True,
    )
    pids = [int(parent.stdout.readline()) for _ in range(2)]
    parent.kill()
    parent.wait()
    parent.stdout.close()
    deadline = time.monotonic() + 30
    while any(Path(f"/proc/{pid}").exists() for pid in pids):
        assert time.monotonic() < deadline, "a worker lives on"
        time.sleep(0.05)
