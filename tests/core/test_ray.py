"""Tasks on a real Ray cluster of two nodes: as with processes here, come what may."""

import importlib.util
import os
import signal
import subprocess
import sys
import textwrap
import threading
import time
from pathlib import Path

import pytest

from hlsd.core import ray_executor, watch
from hlsd.core.errors import HlsdError
from hlsd.core.executor import Lost, LostWorkerError, tell
from hlsd.core.executors import opened
from hlsd.core.processes import Processes
from tests.core.small_ray import ROOT, Cluster

pytestmark = pytest.mark.skipif(
    importlib.util.find_spec("ray") is None or sys.platform != "linux",
    reason="needs Linux and ray: pip install 'hlsd[ray]'",
)


@pytest.fixture(scope="module")
def cluster():
    with Cluster() as cluster:
        cluster.add("second")
        yield cluster


@pytest.fixture(scope="module")
def run_by(cluster):
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(ray_executor, "LOOK_S", 0.5)
        for name, value in cluster.access.items():  # before Ray is loaded
            patch.setenv(name, value)
        with ray_executor.Ray(cluster.address) as run_by:
            yield run_by


def node(_task=None):
    return os.environ["HLSD_TEST_NODE"].rpartition("-")[2]


def test_results_and_what_tasks_say_come_home_from_both_nodes(run_by):
    offset = 10  # a closure, and a function that no module holds

    def square(task):
        tell(("begun", task))
        time.sleep(0.3)
        tell(("done", task))
        return task * task + offset, os.environ["HLSD_TEST_NODE"], os.getcwd()

    said, seen = [], {}
    for number, result in run_by.run(
        square, range(12), told=lambda *what: said.append(what)
    ):
        seen[number] = result
        of_task = [message for told, message in said if told == number]
        assert of_task == [("begun", number), ("done", number)]
    assert {number: held[0] for number, held in seen.items()} == {
        k: k * k + 10 for k in range(12)
    }
    assert len({held[1] for held in seen.values()}) == 2, "both nodes"
    assert {held[2] for held in seen.values()} == {os.getcwd()}
    assert dict(run_by.run(square, [])) == {}


def test_a_worker_that_is_lost_is_told_as_with_processes_here(run_by):
    def work(task):
        tell(("doing", task))
        if task == 1:
            os._exit(3)
        if task == 2:
            os.kill(os.getpid(), signal.SIGSEGV)
        if task == 3:
            watch.begin(0.5)
            time.sleep(600)
        if task == 4:
            sys.stdout.write("what a planner prints\n")
        return task

    def without_trace(found):
        return {
            number: (held.said, held.exit_code, held.hung_s, held.out_of_memory)
            if isinstance(held, Lost)
            else held
            for number, held in found
        }

    assert without_trace(run_by.run(work, range(6))) == without_trace(
        Processes(2).run(work, range(6))
    )


def test_an_error_comes_home_and_stops_all(run_by):
    pids = []

    def fail(task):
        tell(os.getpid())
        if task == 1:
            raise HlsdError("trials is 0", argument="trials")
        time.sleep(0.2 if task == 0 else 60)

    began = time.monotonic()
    with pytest.raises(HlsdError, match=r"^trials is 0$") as failed:
        for _ in run_by.run(fail, range(5), told=lambda _, pid: pids.append(pid)):
            pass
    assert failed.value.argument == "trials"
    with pytest.raises(ZeroDivisionError) as divided:
        dict(run_by.run(lambda task: 1 // task, [0]))
    assert "In a worker" in divided.value.__notes__[0]
    assert time.monotonic() - began < 50
    wait_for_gone(pids)


def test_leaving_early_ends_all_workers(run_by, tmp_path):
    def slow(task):
        (tmp_path / str(os.getpid())).touch()
        time.sleep(600 if task else 0)

    for number, _ in run_by.run(slow, range(4)):
        assert number == 0
        break
    wait_for_gone(int(file.name) for file in tmp_path.iterdir())


def test_a_process_of_ray_that_is_lost_costs_a_retry(run_by, tmp_path):
    def work(task):
        if task == 2 and not (tmp_path / "lost").exists():
            (tmp_path / "lost").touch()
            os.kill(os.getppid(), signal.SIGKILL)
            time.sleep(60)
        return task

    assert dict(run_by.run(work, range(5))) == {k: k for k in range(5)}
    assert (tmp_path / "lost").exists()


def test_a_task_that_is_lost_again_and_again_is_an_error(run_by):
    def work(task):
        if task == "world 7":
            os.kill(os.getppid(), signal.SIGKILL)
            time.sleep(60)

    tasks = ["quick", "quick", "world 7"]
    with pytest.raises(LostWorkerError, match="world 7 was lost 4 times") as lost:
        dict(run_by.run(work, tasks))
    assert lost.value.number == 2
    assert "\n" not in str(lost.value)


def test_nodes_come_and_go(cluster, run_by, tmp_path):
    def work(task):
        (tmp_path / node()).touch()
        if not (tmp_path / "all came and went").exists():
            time.sleep(0.2)
        return task

    found, added, lost = {}, False, False
    for number, result in run_by.run(work, range(400)):
        found[number] = result
        if not added:
            cluster.add("third")
            added = True
        elif not lost and (tmp_path / "third").exists():
            cluster.lose("third")
            (tmp_path / "all came and went").touch()
            lost = True
    assert lost, "a node that joins is used"
    assert found == {k: k for k in range(400)}


def test_a_node_with_other_software_is_refused(run_by, monkeypatch):
    own = ray_executor.software()
    for name, found, text in (
        ("numpy", "1.0", f"has numpy {own['numpy']}, here is 1.0: pip install numpy"),
        ("hlsd's code", "0" * 16, "has other code of hlsd .* install the same there"),
        ("Python", "3.1", r"has Python 3\.\d+, here is 3.1: start Ray with Python 3.1"),
    ):
        other = {**own, name: found}
        monkeypatch.setattr(ray_executor, "software", lambda other=other: other)
        with pytest.raises(HlsdError, match=rf"^node [\d.]+ of the Ray .*{text}"):
            dict(run_by.run(node, [0]))


class Needy:
    def __init__(self, error):
        self.error = error

    def require_found(self):
        raise self.error

    def __call__(self, task):
        return task


def test_what_a_node_lacks_is_one_line_that_names_the_node(run_by):
    for error in (ModuleNotFoundError("No module named 'mine'"), HlsdError("no suite")):
        with pytest.raises(HlsdError, match=rf"^node [\d.]+ .*cannot .*{error}"):
            dict(run_by.run(Needy(error), [0]))


def test_settings_that_do_not_go_together_are_refused(run_by):
    for given, text in (
        (("rya", None, None), "unknown executor 'rya'.*did you mean 'ray'"),
        (("processes", None, "auto"), "address is 'auto', which only a Ray cluster"),
        ((run_by, 2, None), "jobs is 2 beside an executor of your own"),
        (("ray", run_by, None), "two executors are given"),
        ((3, None, None), "executor is 3: give processes or ray, or an object"),
        (("ray", 0, None), "jobs is 0: at least 1 is needed"),
        (("ray", None, "auto"), "connected to a Ray cluster already"),
    ):
        with pytest.raises(HlsdError, match=text), opened(*given):
            pass
    with opened("processes", run_by, None) as first, opened(run_by, None, None) as same:
        assert first is same is run_by
    assert list(run_by.run(node, [0])), "it is still connected"


def test_workers_end_when_the_driver_is_killed(cluster):
    script = textwrap.dedent("""
        import os, sys, time
        from hlsd.core.ray_executor import Ray

        def wait(task):
            open(task, "w").write(str(os.getpid()))
            time.sleep(600)

        list(Ray(sys.argv[1]).run(wait, sys.argv[2:]))
    """)
    files = [Path(cluster.folder) / name for name in ("a", "b")]
    with subprocess.Popen(
        [sys.executable, "-c", script, cluster.address, *map(str, files)],
        env=os.environ | {"PYTHONPATH": str(ROOT)} | cluster.access,
    ) as driver:
        limit = threading.Timer(100, driver.kill)
        limit.start()
        deadline = time.monotonic() + 90
        while not all(file.exists() and file.read_text() for file in files):
            assert time.monotonic() < deadline
            assert driver.poll() is None
            time.sleep(0.1)
        limit.cancel()
        driver.kill()
    wait_for_gone(int(file.read_text()) for file in files)


def wait_for_gone(pids):
    deadline = time.monotonic() + 30
    for pid in pids:
        while Path(f"/proc/{pid}").exists():
            assert time.monotonic() < deadline, f"{pid} lives on"
            time.sleep(0.05)
