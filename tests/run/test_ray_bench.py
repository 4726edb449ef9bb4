"""A bench on a Ray cluster: the same bytes as in one process, whatever is lost."""

import csv
import importlib.util
import os
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace

import pytest

from hlsd.core.errors import HlsdError
from hlsd.core.software import differing, software
from hlsd.data.worlds import load_suite
from hlsd.run.drivers import Driver, require_modules
from hlsd.run.identity import Expected
from hlsd.sim.robots import get_robot
from tests.cli.ready import ready
from tests.run.test_failures import ROOT
from tests.run.test_misbehaviour import COMMAND

BENCH = ("bench", "--planner", "hlsd10", "--worlds", "0:300:13", "--trials", "1")


def hlsd(
    folder, *words, code="from hlsd.cli import main; main()", start="run", access=()
):
    """A command in a folder, run or started."""
    return getattr(subprocess, start)(
        [sys.executable, "-c", code, *words],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": str(ROOT), **dict(access)},
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )


def has_ray():
    return importlib.util.find_spec("ray") is not None


def rows_of(run):
    """Rows without wall times."""
    with (run / "episodes.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        del row["wall_s"]
    return rows


@pytest.fixture(scope="module")
def cluster():
    if not has_ray() or sys.platform != "linux":
        pytest.skip("needs Linux and ray: pip install 'hlsd[ray]'")
    from tests.core.small_ray import Cluster

    with Cluster() as cluster:
        yield cluster


@pytest.fixture
def on_ray(cluster):
    """Options, while the cluster has two nodes."""
    cluster.add("second")
    yield "--executor", "ray", "--address", cluster.address
    if cluster.of("second"):
        cluster.lose("second")


def await_lines(running, journal, count):
    """Wait until a command that runs has written so many lines to its journal."""
    deadline = time.monotonic() + 120
    while not journal.exists() or journal.read_bytes().count(b"\n") < count:
        assert running.poll() is None, running.stderr.read()
        assert time.monotonic() < deadline
        time.sleep(0.02)


def test_a_node_is_lost_and_no_byte_differs(tmp_path, cluster, on_ray):
    # Long enough for a quiet machine to be in the middle when the node is gone.
    bench = (*BENCH[:-1], "3")
    alone = hlsd(tmp_path, *bench, "--jobs", "1", "--out", "alone")
    assert alone.returncode == 0, alone.stderr
    with hlsd(
        *(tmp_path, *bench, *on_ray, "--out", "ray"),
        start="Popen",
        access=cluster.access,
    ) as running:
        journal = tmp_path / "ray" / "journal.jsonl"
        await_lines(running, journal, 4)
        cluster.lose("second")
        begun = journal.read_bytes().count(b"\n") if journal.exists() else 72
        _, stderr = running.communicate(timeout=300)
    assert running.returncode == 0, stderr
    assert begun < 72, "it was lost in the middle"
    assert rows_of(tmp_path / "ray") == rows_of(tmp_path / "alone")
    one, two = ((tmp_path / name / "trajectories.zip") for name in ("alone", "ray"))
    assert one.read_bytes() == two.read_bytes()
    said = [line for line in stderr.splitlines() if "episode" not in line]
    assert said == [], "nothing but the progress"


def test_planners_that_misbehave_have_the_same_rows(tmp_path, cluster, on_ray):
    shutil.copy(ROOT / "tests" / "run" / "misbehaving.py", tmp_path)
    (tmp_path / "here.txt").write_text("here")
    words = ["bench", "--worlds", "0", "--trials", "1"]
    for name in ("Segfaults", "Hangs", "Other"):
        words += ["--planner", f"misbehaving:{name}"]
    for name, options in (("alone", ("--jobs", "1")), ("ray", on_ray)):
        words_here = (*words, *options, "--out", name)
        done = hlsd(tmp_path, *words_here, code=COMMAND, access=cluster.access)
        assert done.returncode == 0, done.stderr
    rows = rows_of(tmp_path / "ray")
    assert rows == rows_of(tmp_path / "alone")
    kinds = [row["reason"].partition(":")[0] for row in rows]
    assert sorted(kinds) == ["crashed", "exception", "hung"]
    # One whose process ends as it is made ends no more than its worker.
    (tmp_path / "deadly.py").write_text(
        "import os\nclass Deadly:\n    def __init__(self):\n        os._exit(3)\n"
    )
    refused = hlsd(
        tmp_path,
        *("bench", "--planner", "deadly:Deadly", "--worlds", "0", "--out", "deadly"),
        *on_ray,
        access=cluster.access,
    )
    assert refused.returncode == 2
    assert refused.stderr == (
        "hlsd: planner 'deadly:Deadly' cannot be made: crashed: the process ended "
        "with exit code 3\n"
    )


def test_an_interrupted_bench_goes_on_with_processes_here(tmp_path, cluster, on_ray):
    with hlsd(
        *(tmp_path, *BENCH, *on_ray, "--out", "run"),
        start="Popen",
        access=cluster.access,
    ) as running:
        await_lines(running, tmp_path / "run" / "journal.jsonl", 2)
        running.send_signal(signal.SIGTERM)
        _, stderr = running.communicate(timeout=60)
    assert running.returncode == 128 + signal.SIGTERM, stderr
    assert stderr.endswith("hlsd: interrupted; the same command goes on from here\n")
    deadline = time.monotonic() + 30
    while workers := [
        pid for name in ("head", "second") for pid in cluster.of(name) if is_worker(pid)
    ]:
        assert time.monotonic() < deadline, f"{workers} live on"
        time.sleep(0.1)
    done = hlsd(tmp_path, *BENCH, "--jobs", "2", "--out", "run")
    assert done.returncode == 0, done.stderr
    assert len(rows_of(tmp_path / "run")) == 24


def is_worker(pid):
    from tests.core.small_ray import command

    return "spawn_main" in command(pid)


def test_a_cluster_that_asks_for_a_token_says_so_in_one_line(tmp_path, cluster):
    words = ("bench", "--planner", "hlsd10", "--worlds", "0", "--out", "run")
    address = ("--executor", "ray", "--address", cluster.address)
    done = hlsd(tmp_path, *words, *address, access={"RAY_AUTH_MODE": "disabled"})
    assert done.returncode == 2
    assert "it asks for its token: set RAY_AUTH_MODE to token" in done.stderr
    assert done.stderr.count("\n") == 1


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--address", "auto"), "--address is 'auto', which only a Ray cluster has"),
        (("--executor", "rya"), "unknown executor 'rya': known are processes, ray"),
        (("--executor", "ray", "--jobs", "0"), "--jobs is 0: at least 1 is needed"),
        (("--executor", "ray", "--address", "x"), "--address is 'x': give auto"),
        (
            ("--executor", "ray", "--address", "127.0.0.1:1"),
            "--address is '127.0.0.1:1', where no Ray cluster can be used",
        ),
    ],
)
@pytest.mark.parametrize("command", ["bench", "sweep"])
def test_bad_options_are_one_line(tmp_path, command, options, said):
    if "--address" in options and "ray" in options and not has_ray():
        pytest.skip("needs ray: pip install 'hlsd[ray]'")
    vary = ("--vary", "lidar.dropout=0.5") if command == "sweep" else ()
    words = (command, "--planner", "hlsd10", "--worlds", "0", *vary, "--out", "run")
    began = time.monotonic()
    done = ready(*words, *options, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.startswith(f"hlsd: {said}")
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "run").exists()
    assert time.monotonic() - began < 60


WITHOUT = """
import sys

class Gone:
    @staticmethod
    def find_spec(name, path, target=None):
        if name == "ray":
            raise ImportError("No module named 'ray'")

sys.meta_path.insert(0, Gone)
from hlsd.cli import main
main()
"""


def test_without_ray_one_line_says_what_to_install(tmp_path):
    words = ("bench", "--planner", "hlsd10", "--worlds", "0", "--out", "run")
    done = hlsd(tmp_path, *words, "--executor", "ray", code=WITHOUT)
    assert done.returncode == 2
    assert done.stderr == (
        "hlsd: --executor is ray, which cannot be loaded (No module named 'ray'): "
        'pip install "hlsd[ray]"\n'
    )


def test_what_a_process_lacks_of_a_run_is_found_before_it_drives(tmp_path, monkeypatch):
    (tmp_path / "lacking.py").write_text(
        "class Lacks:\n    def __init__(self):\n        import nowhere_at_all\n"
        "class Fails:\n    def __init__(self):\n        raise ValueError('now')\n"
    )
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.delitem(sys.modules, "lacking", raising=False)
    for name, text in (
        ("gone_from_here:Planner", "gone_from_here"),
        ("lacking:Lacks", "No module named 'nowhere_at_all'"),
        ("no-such-plug-in", "unknown planner 'no-such-plug-in'"),
    ):
        with pytest.raises(HlsdError, match=text):
            require_modules(Driver(name, reference=name))
    require_modules(Driver("lacking:Fails", reference="lacking:Fails"))
    suite, robot = load_suite("barn300"), get_robot("jackal")
    held = Expected({}, {}, {0: suite.digests[0]})
    held.check_worlds(suite)
    held.check_robot(robot, robot.sha256)
    for other in ({0: suite.digests[1]}, {300: suite.digests[0]}):
        with pytest.raises(HlsdError, match="suite 'barn300' is another than this run"):
            Expected({}, {}, other).check_worlds(suite)
    with pytest.raises(HlsdError, match="of robot 'jackal' is another"):
        held.check_robot(robot, "0" * 64)
    absent = replace(robot, model=tmp_path / "absent.xml")
    with pytest.raises(HlsdError, match=r"cannot read '.*absent.xml' of robot"):
        held.check_robot(absent, robot.sha256)


def test_software_that_differs_is_named_with_a_remedy():
    ours = software()
    assert differing(ours, ours) == ""
    assert differing({**ours, "mujoco": ""}, ours).startswith("has no mujoco, here is")
    assert "nodes of one kind" in differing({**ours, "processor": "riscv"}, ours)
