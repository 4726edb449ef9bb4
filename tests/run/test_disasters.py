"""Whatever ends a run, the same command goes on, and ends the same to the byte.

`HLSD_MOMENTS` sets the number of moments at which a real command is ended in each way.
"""

import os
import random
import resource
import shutil
import signal
import subprocess
import sys
import time
from itertools import count

import pytest

from hlsd.core.errors import HlsdError
from hlsd.report.summary import write_summary
from hlsd.run.bench import Bench, run_bench
from hlsd.run.journal import InUseError
from hlsd.run.trajectory import ARCHIVE
from tests.cli.test_cli import ROOT, episodes_in, started
from tests.run.saboteur import (
    PLANNER,
    Stop,
    assert_all_gone,
    assert_whole,
    bench,
    in_child,
    results,
    sabotage,
    session_processes,
)

MOMENTS = int(os.environ.get("HLSD_MOMENTS", "1"))
fork = pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")


@pytest.fixture(scope="module")
def wanted(tmp_path_factory):
    return results(bench(tmp_path_factory.mktemp("bench") / "whole"))


@fork
def test_killed_after_any_call_that_touches_the_folder(tmp_path, wanted):
    for at in count(1):
        folder = tmp_path / f"at-{at}"

        def die(at=at, folder=folder):
            sabotage(pytest.MonkeyPatch(), folder, at, "kill")
            bench(folder)

        code = in_child(die)
        if code == 0:
            break
        assert code == -signal.SIGKILL
        if (folder / "journal.jsonl").exists() or not (folder / ARCHIVE).exists():
            bench(folder)
        assert_whole(folder, wanted)
        shutil.rmtree(folder)
    assert at > 40, "every call was a moment"


@pytest.mark.parametrize("how", ["full", "stop"])
def test_a_call_that_fails_at_any_moment(tmp_path, wanted, how, monkeypatch):
    """A full disk is one line; an interruption passes on."""
    for at in count(1):
        folder = tmp_path / f"at-{at}"
        with monkeypatch.context() as patch:
            counted = sabotage(patch, folder, at, how)
            try:
                bench(folder)
                said = ""
            except (HlsdError, Stop) as error:
                said = str(error)
        if counted[0] < at:
            break
        if said:
            assert "No space left on device" in said
            assert "\n" not in said
        if not (folder / ARCHIVE).exists() or (folder / "journal.jsonl").exists():
            bench(folder)
        assert_whole(folder, wanted)
        shutil.rmtree(folder)
    assert at > 40, "every call was a moment"


@fork
def test_files_that_may_not_grow(tmp_path, wanted):
    """As on a disk with a quota: one line, and it goes on once there is room."""
    codes = set()
    for limit in (0, 100, 1000, 2000, 3000, 4000, 10**6):
        folder = tmp_path / f"within-{limit}"

        def squeeze(folder=folder, limit=limit):
            signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
            resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
            bench(folder)

        codes.add(code := in_child(squeeze))
        if code:
            bench(folder)
        assert_whole(folder, wanted)
    assert codes == {0, 2}


def test_a_disk_that_is_full(tmp_path, wanted):
    disk = tmp_path / "disk"
    disk.mkdir()
    mount = ["mount", "-t", "tmpfs", "-o", "size=8k", "none", str(disk)]
    if subprocess.run(mount, capture_output=True, check=False).returncode != 0:
        pytest.skip("needs the right to mount a small disk")
    try:
        for size in ("8k", "12k", "16k", "20k"):
            _remount(disk, size)
            with pytest.raises(HlsdError, match="No space left on device"):
                bench(disk / "run")
        _remount(disk, "1m")
        assert_whole(bench(disk / "run"), wanted)
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def _remount(disk, size):
    command = ["mount", "-o", f"remount,size={size}", str(disk)]
    subprocess.run(command, capture_output=True, check=True)


def test_a_folder_that_is_removed_while_its_run_goes_on(tmp_path):
    for number in (1, 2):

        def remove(done, _n, _s, folder=tmp_path / f"run-{number}", number=number):
            if done == 2 * number:
                shutil.rmtree(folder)

        with pytest.raises(HlsdError, match="was removed") as refused:
            bench(tmp_path / f"run-{number}", progress=remove)
        assert "\n" not in str(refused.value)
        assert not (tmp_path / f"run-{number}").exists()


def test_a_folder_that_is_written_to_is_refused_and_says_by_whom(tmp_path, wanted):
    seen = []

    def meanwhile(done, _n, _s):
        for discard in (False, True):
            with pytest.raises(InUseError) as refused:
                bench(tmp_path / "run", discard=discard)
            seen.append(str(refused.value))

    assert_whole(bench(tmp_path / "run", progress=meanwhile), wanted)
    assert len(seen) == 4
    assert all(f"in use by process {os.getpid()} on " in text for text in seen)


def test_a_second_process_takes_another_default_folder(tmp_path, monkeypatch, wanted):
    monkeypatch.chdir(tmp_path)
    seen = []

    def meanwhile(done, _n, _s):
        if not seen:
            seen.append(None)
            seen.append(bench(None))

    first = bench(None, progress=meanwhile)
    assert first.name == "tests_run_saboteur_GivesUp-barn300-hlsd2021-2-of-300-worlds"
    assert seen[1].name == f"{first.name}-2"
    for folder in (first, seen[1]):
        assert_whole(folder, wanted)


@fork
def test_many_at_once_never_share_a_folder(tmp_path, monkeypatch, wanted):
    """All begin at one moment; each has a folder to itself, or is refused."""
    monkeypatch.chdir(tmp_path)
    for out, codes in ((None, {0}), (tmp_path / "one", {0, 2})):
        begin, go = os.pipe()
        children = []
        for _ in range(4):
            child = os.fork()
            if child == 0:
                code = 1
                try:
                    os.close(go)
                    os.read(begin, 1)  # its end
                    bench(out)
                    code = 0
                except InUseError:
                    code = 2
                except HlsdError as error:
                    code = 2 if "finished" in str(error) else 1
                finally:
                    os._exit(code)
            children.append(child)
        os.close(begin)
        os.close(go)
        found = [os.waitstatus_to_exitcode(os.waitpid(c, 0)[1]) for c in children]
        assert {*found} <= codes
        assert found.count(0) == (4 if out is None else 1)
    for folder in (*(tmp_path / "runs").iterdir(), tmp_path / "one"):
        assert_whole(folder, wanted)
    assert len([*(tmp_path / "runs").iterdir()]) == 4


# ---- The command itself, with workers, ended from outside.


COMMANDED = Bench((PLANNER,), worlds="0:300:50", trials=2)


def command(out):
    return [
        *(sys.executable, "-m", "hlsd", "bench", "--planner", PLANNER),
        *(
            "--worlds",
            COMMANDED.worlds,
            "--trials",
            "2",
            "--jobs",
            "2",
            "--out",
            str(out),
        ),
    ]


def plain(folder):
    rows, archive, _ = results(folder)
    return rows, archive


@pytest.fixture(scope="module")
def uninterrupted(tmp_path_factory):
    folder = tmp_path_factory.mktemp("command") / "whole"
    run_bench(COMMANDED, folder, 1, conclude=write_summary)
    return plain(folder)


def wait_for(process, folder, records):
    """Until the journal has so many records, or the command has ended."""
    journal = folder / "journal.jsonl"
    until = time.monotonic() + 120
    while process.poll() is None and time.monotonic() < until:
        if journal.exists() and episodes_in(journal) >= records:
            return
        time.sleep(0.005)


@pytest.mark.slow
@pytest.mark.parametrize("name", ["SIGKILL", "SIGTERM", "SIGHUP", "worker"])
def test_the_command_is_ended(tmp_path, uninterrupted, name):
    """The process alone or, as a terminal or a system does, with its workers."""
    rng = random.Random(name)
    for moment in range(MOMENTS):
        folder = tmp_path / f"run-{moment}"
        process = started(command(folder))
        wait_for(process, folder, rng.randrange(12) if moment else 4)
        everyone = moment % 2 == 1
        if name == "worker":
            others = {*session_processes(process.pid)} - {process.pid}
            if others:
                os.kill(max(others), signal.SIGKILL)
        elif everyone:
            os.killpg(process.pid, signal.Signals[name])
        else:
            process.send_signal(signal.Signals[name])
        _, error = process.communicate(timeout=120)
        assert_all_gone(process.pid)
        assert "Traceback" not in error, error
        if name in ("SIGTERM", "SIGHUP") and process.returncode != 0:
            expected = {128 + signal.Signals[name], -signal.Signals[name]}
            assert process.returncode in expected, error
        if process.returncode != 0:
            run_bench(COMMANDED, folder, 1, conclude=write_summary)
        assert plain(folder) == uninterrupted
        left = {path.name for path in folder.iterdir() if path.name[0] == "."}
        assert left | {"journal.jsonl", "trajectories"} & {*os.listdir(folder)} == set()


@pytest.mark.slow
def test_two_commands_with_one_folder(tmp_path, uninterrupted):
    first = started(command(tmp_path / "run"))
    wait_for(first, tmp_path / "run", 1)
    second = subprocess.run(
        command(tmp_path / "run"), cwd=ROOT, capture_output=True, text=True, check=False
    )
    _, error = first.communicate(timeout=120)
    assert first.returncode == 0, error
    assert second.returncode == 2
    (line,) = second.stderr.splitlines()
    assert f"in use by process {first.pid} on " in line or "finished run" in line
    assert plain(tmp_path / "run") == uninterrupted


def test_an_archive_is_never_replaced_by_a_smaller_one(tmp_path, wanted):
    """However that might come about."""
    whole = bench(tmp_path / "whole")

    def put_it_there(done, _n, _s):
        shutil.copy(whole / ARCHIVE, tmp_path / "run" / ARCHIVE)

    smaller = Bench((PLANNER,), worlds="0", trials=2)
    with pytest.raises(HlsdError, match="holds 4 runs, more than the 2"):
        run_bench(smaller, tmp_path / "run", 1, put_it_there)
    assert (tmp_path / "run" / ARCHIVE).read_bytes() == wanted[1]
