"""Shards as a user drives and merges them: one is killed, some are wrong."""

import csv
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest
import yaml

from hlsd.core.executor import Serial
from hlsd.report.summary import write_summary
from hlsd.run.bench import Bench, run_bench
from hlsd.run.seal import seal
from hlsd.run.trajectory import pack, read_archive
from tests.analysis.test_gate import commands
from tests.cli.test_cli import episodes_in
from tests.project.test_docs import FENCE, ROOT, unknown_options

ARRAY = ROOT / "examples" / "shards.sbatch"
WORKFLOW = ROOT / "examples" / "shards.yml"
PLANNERS = """
import time
from pathlib import Path

from hlsd.planners.base import Command

class Turns:
    period_s = 0.25

    def reset(self, setup):
        while Path("hold").exists() and '"row"' in Path("s2/journal.jsonl").read_text():
            time.sleep(0.05)
        self.ticks = 0

    def plan(self, observation):
        self.ticks += 1
        if self.ticks > 3:
            raise ValueError("enough")
        return Command(0.3, 0.1)

class Slower(Turns):
    def plan(self, observation):
        super().plan(observation)
        return Command(0.2, 0.1)
"""
NAMES = ("sharded:Turns", "sharded:Slower")
SETTINGS = Bench(NAMES, worlds="0:300:50", trials=2)
BENCH = ("bench", *(word for name in NAMES for word in ("--planner", name)))
BENCH = (*BENCH, "--worlds", "0:300:50", "--trials", "2", "--jobs", "1")


def killed(folder, command):
    """Begin to drive a shard, and kill it when the first episodes are there."""
    (folder / "hold").touch()
    process = subprocess.Popen(
        command, cwd=folder, stderr=subprocess.DEVNULL, start_new_session=True
    )
    journal, until = folder / "s2" / "journal.jsonl", time.monotonic() + 60
    while not episodes_in(journal) and time.monotonic() < until:
        time.sleep(0.05)
    os.killpg(process.pid, signal.SIGKILL)
    process.wait()
    (folder / "hold").unlink()
    assert 0 < episodes_in(journal) < 8


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A whole run, its shards, the second of which was killed once, and other runs'."""
    folder = tmp_path_factory.mktemp("shards")
    (folder / "sharded.py").write_text(PLANNERS)
    second = [sys.executable, "-m", "hlsd", *BENCH, "--shard", "2/3", "--out", "s2"]
    killed(folder, second)
    shutil.copytree(folder / "s2", folder / "cut")
    subprocess.run(second, cwd=folder, capture_output=True, timeout=120, check=True)
    with pytest.MonkeyPatch.context() as patch:
        patch.chdir(folder)
        patch.syspath_prepend(folder)

        def drive(out, shard, conclude=None):
            bench = replace(SETTINGS, shard=shard)
            return run_bench(bench, out, Serial(), conclude=conclude)

        drive(Path("whole"), None, write_summary)
        drive(Path("s1"), "1/3")
        default = drive(None, "3/3", write_summary)
        assert default.name.endswith("-barn300-hlsd2021-6-of-300-worlds-shard-3-of-3")
        default.rename("s3")
        (folder / "sharded.py").write_text(PLANNERS.replace("0.2, 0.1", "0.1, 0.1"))
        drive(Path("code"), "3/3")
    for name, before, after in (
        ("seed", '"seed": 0', '"seed": 1'),
        ("of4", '"3/3"', '"3/4"'),
    ):
        shutil.copytree(folder / "s3", folder / name)
        edit("run.json", before, after, sealed=True)(folder / name)
    return folder


def rows(folder):
    with (folder / "episodes.csv").open(newline="", encoding="utf-8") as file:
        return [{**row, "wall_s": ""} for row in csv.DictReader(file)]


@pytest.mark.parametrize("order", ["s1 s2 s3", "s3 s1 s2"])
def test_a_shard_that_was_killed_goes_on_and_merges_the_same(
    made, hlsd, tmp_path, order
):
    out = tmp_path / "deep" / "run"
    code, said, err = hlsd("merge", *order.split(), "--out", out)
    assert (code, err) == (0, "")
    assert said.startswith("barn300, 6 worlds, protocol hlsd2021, robot jackal 1.0, ")
    assert "shard" not in said.splitlines()[0]
    assert f"results: {out}" in said
    for name in ("run.json", "trajectories.zip", "tracebacks.txt", "summary.md"):
        assert (out / name).read_bytes() == (made / "whole" / name).read_bytes(), name
    assert rows(out) == rows(made / "whole")
    assert len(rows(out)) == 24
    assert {path.name for path in out.iterdir()} == {
        path.name for path in (made / "whole").iterdir()
    }
    assert (
        (made / "whole" / "tracebacks.txt")
        .read_text()
        .startswith("12 episodes of planner ")
    )
    again = hlsd("merge", *order.split(), "--out", out)
    assert again[0] == 2
    assert "is not empty (it holds 'episodes.csv'): choose another --out" in again[2]


REFUSED = {
    "s1 s2": "of 3 shards 1 is missing: 3/3",
    "s2": "of 3 shards 2 are missing: 1/3, 3/3",
    "s1 s2 s3 s2": "shard 2/3 is there twice, in s2 and s2: give it once",
    "s1 s2 of4": "s1 and of4 are not of one run: shards 1/3 and 3/4",
    "s1 s2 seed": "s1 and seed are not of one run: seed 0 and 1",
    "s1 s2 code": "s1 and code are not of one run: other code of planner 'sharded",
    "s1 cut s3": "the run in cut is not finished: the same `hlsd bench` command goes",
    "s1 s2 whole": "the run in whole is whole, not one of several",
    "s1 s2 none": "no run in none: give the folder of a shard",
    "s1 s2 sharded.py": "no run in sharded.py: give the folder of a shard",
}


def assert_refused(found, fragment):
    code, out, err = found
    assert (code, out) == (2, ""), err
    assert len(err.splitlines()) == 1, err
    assert fragment in err


@pytest.mark.parametrize("folders", REFUSED)
def test_what_is_no_whole_run_is_refused(made, hlsd, tmp_path, folders):
    found = hlsd("merge", *folders.split(), "--out", tmp_path / "run")
    assert_refused(found, REFUSED[folders])
    assert list(tmp_path.iterdir()) == [], "nothing was written"


def edit(name, before, after, sealed=False):
    """Change a file of a shard; also its seal, so that only the rows can tell."""

    def change(folder):
        text = (folder / name).read_text()
        assert before in text
        (folder / name).write_text(text.replace(before, after, 1))
        if sealed:
            seal(folder, ("episodes.csv", "timing.csv", "run.json"))

    return change


def without_rows(folder):
    for name in ("episodes.csv", "timing.csv"):
        lines = (folder / name).read_text().splitlines(keepends=True)
        (folder / name).write_text("".join(lines[:-1]))
    seal(folder, ("episodes.csv", "timing.csv", "run.json"))


def other_versions(folder):
    record = json.loads((folder / "run.json").read_text())
    record["versions"]["python"] = "3.99"
    (folder / "run.json").write_text(json.dumps(record))
    seal(folder, ("episodes.csv", "timing.csv", "run.json"))


def archive(change):
    """Write a shard's archive anew from what a function makes of its blocks."""

    def write(folder):
        file = folder / "trajectories.zip"
        blocks = change(dict(read_archive(file)))
        file.write_bytes(pack(blocks, sorted(blocks)))

    return write


def flip(folder):
    file = folder / "trajectories.zip"
    data, block = file.read_bytes(), next(iter(read_archive(file).values()))
    at = data.index(block) + len(block) // 2
    file.write_bytes(data[:at] + bytes([data[at] ^ 1]) + data[at + 1 :])


def cut(folder):
    os.truncate(folder / "trajectories.zip", 1000)


def gone(name):
    return lambda folder: (folder / name).unlink()


DAMAGED = {
    "a cell": (edit("episodes.csv", "exception", "exit"), "was changed since hlsd"),
    "a time": (edit("timing.csv", ",0.0", ",1.0"), "was changed since hlsd wrote it"),
    "the record": (edit("run.json", '"seed": 0', '"seed": 1'), "was changed since"),
    "another's row": (
        edit("episodes.csv", "\nbarn300,1,50,", "\nbarn300,1,0,", sealed=True),
        "want one of shard 2/3, as in run.json",
    ),
    "rows": (without_rows, "lacks 1 of the run's 8 episodes"),
    "another Python": (other_versions, "not of one run: versions python '3."),
    "a bit of the archive": (flip, "is not an archive of trajectories: Bad CRC-32"),
    "a cut archive": (cut, "is not an archive of trajectories"),
    "no archive": (gone("trajectories.zip"), "or leave all out with --no-trajectories"),
    "a block too few": (
        archive(lambda held: dict(list(held.items())[1:])),
        "has 7 of the 8 episodes of shard 2/3",
    ),
    "a block too many": (
        archive(lambda held: {**held, ("sharded:Turns", 0, 0): b""}),
        "has sharded:Turns, world 0, trial 0, which is none of shard 2/3",
    ),
    "tracebacks' episodes": (
        edit("tracebacks.txt", "trial 0", "trial 2"),
        "is not as hlsd wrote it",
    ),
    "the seal": (gone("results.sha256"), "has no results.sha256"),
    "times": (gone("timing.csv"), "timing.csv"),
    "no shard": (edit("run.json", '"2/3"', '"4/3"', sealed=True), "is damaged: shard"),
    "too many": (edit("run.json", '"2/3"', '"2/9"', sealed=True), "6 shards at most"),
}


@pytest.mark.parametrize("what", DAMAGED)
def test_a_damaged_or_changed_shard_is_refused(made, hlsd, tmp_path, what):
    change, fragment = DAMAGED[what]
    shutil.copytree(made / "s2", tmp_path / "s2")
    change(tmp_path / "s2")
    out = tmp_path / "run"
    assert_refused(hlsd("merge", "s1", tmp_path / "s2", "s3", "--out", out), fragment)
    assert [path.name for path in tmp_path.iterdir()] == ["s2"], "nothing was written"


def test_trajectories_may_be_left_out(made, hlsd, tmp_path):
    shutil.copytree(made / "s2", tmp_path / "s2")
    (tmp_path / "s2" / "trajectories.zip").unlink()
    code, _, _ = hlsd(
        *("merge", "s1", tmp_path / "s2", "s3", "--no-trajectories"),
        *("--out", tmp_path / "run"),
    )
    assert code == 0
    assert rows(tmp_path / "run") == rows(made / "whole")
    assert not (tmp_path / "run" / "trajectories.zip").exists()


@pytest.mark.parametrize("text", ["0/3", "4/3", "x", "1/0", "-1/2", "1/3 ", "1/7"])
def test_a_wrong_shard_is_one_line_and_drives_nothing(hlsd, tmp_path, text):
    found = hlsd(*BENCH, "--shard", text, "--out", tmp_path / "run")
    most = text == "1/7"
    assert_refused(found, "6 shards at most" if most else f"--shard {text!r}: want i/n")
    assert not (tmp_path / "run").exists()


def test_a_file_and_the_folder_of_the_command_are_no_place(hlsd, tmp_path, monkeypatch):
    (tmp_path / "file").touch()
    (tmp_path / "here").mkdir()
    shards = [Path(name).resolve() for name in ("s1", "s2", "s3")]
    monkeypatch.chdir(tmp_path / "here")
    assert_refused(hlsd("merge", *shards, "--out", "../file"), "is a file")
    assert_refused(hlsd("merge", *shards, "--out", "."), "the one that this runs in")


def test_what_judges_refuses_a_shard_and_what_shows_says_it_is_one(hlsd, tmp_path):
    side = "s1:sharded:Turns"
    for arguments in (
        ("compare", side, "whole:sharded:Turns"),
        ("compare", "whole:sharded:Turns", side),
        ("gate", side, "--baseline", ROOT / "baselines" / "hlsd10.json"),
        ("baseline", side, "--out", tmp_path / "base.json"),
        ("export", "s1", "--planner", "sharded:Turns", "--out", tmp_path / "out.txt"),
        ("validate", "s1", "--planner", "sharded:Turns", "--against", "whole"),
    ):
        assert_refused(
            hlsd(*arguments), "the run in s1 is shard 1/3, a part of its run"
        )
    code, out, _ = hlsd("report", "s1", "--out", tmp_path / "one", "--format", "html")
    assert code == 0
    said = "shard 1/3, a part of its run: hlsd merge joins the shards"
    assert said in out
    assert said in (tmp_path / "one" / "report.html").read_text()
    code, out, _ = hlsd(
        "report", "s1", "s2", "--out", tmp_path / "two", "--format", "csv"
    )
    assert code == 0
    assert "parts of runs: s1 is shard 1/3, s2 is shard 2/3; hlsd merge" in out
    whole = hlsd("report", "whole", "--out", tmp_path / "whole", "--format", "csv")
    assert whole[0] == 0
    assert "hlsd merge" not in whole[1]


def test_an_unfinished_shard_is_no_other_run(made, hlsd, tmp_path):
    shutil.copytree(made / "cut", tmp_path / "cut")
    for options, said in (
        ((), "shard '2/3', now None"),
        (("--shard", "1/3"), "now '1"),
    ):
        found = hlsd(*BENCH, *options, "--out", tmp_path / "cut")
        assert_refused(found, said)


# ------------------------------------------------------------------------- on machines


def test_the_slurm_array_of_the_examples_drives_and_joins_all_parts(tmp_path):
    """The page shows it; what its tasks call, as SLURM runs them, goes together."""
    page = (ROOT / "docs" / "scale.md").read_text(encoding="utf-8")
    script = ARRAY.read_text(encoding="utf-8")
    plain = re.sub(r"^# .*\n", "", script, flags=re.MULTILINE)
    shown = [body for _, body in FENCE.findall(page) if body.startswith("#!/bin/bash")]
    assert shown == [plain]
    shim = tmp_path / "hlsd"
    shim.write_text('#!/bin/sh\nprintf "%s|" "$@" >> said; echo >> said\n')
    shim.chmod(0o755)
    (tmp_path / "shards" / "1").mkdir(parents=True)
    (tmp_path / "shards" / "2").mkdir()
    task = {
        "PATH": f"{tmp_path}:{os.environ['PATH']}",
        "SLURM_ARRAY_TASK_COUNT": "2",
        "SLURM_CPUS_PER_TASK": "16",
    }
    (joins,) = re.findall(r'--wrap "(.*)"', script)
    for line in ("1", "2", joins):
        subprocess.run(
            ["bash", "-c", line] if line == joins else ["bash", str(ARRAY)],
            cwd=tmp_path,
            env={**task, "SLURM_ARRAY_TASK_ID": line},
            timeout=60,
            check=True,
        )
    said = [line.split("|")[:-1] for line in (tmp_path / "said").read_text().split()]
    for number, words in enumerate(said[:2], 1):
        assert not unknown_options(["hlsd", *words])
        assert words[words.index("--shard") + 1] == f"{number}/2"
        assert words[words.index("--out") + 1] == f"shards/{number}"
    assert said[2:] == [["merge", "shards/1", "shards/2", "--out", "run"]]


def test_the_example_workflow_drives_all_parts_and_joins_them():
    workflow = yaml.safe_load(WORKFLOW.read_text(encoding="utf-8"))
    drive, gate = workflow["jobs"]["drive"], workflow["jobs"]["gate"]
    numbers = drive["strategy"]["matrix"]["shard"]
    assert numbers == list(range(1, len(numbers) + 1)), "from 1/N to N/N"
    assert gate["needs"] == "drive"
    found = []
    for step in (*drive["steps"], *gate["steps"]):
        assert ("uses" in step) != ("run" in step), step
        assert re.fullmatch(r"[\w./-]+@v\d+", step.get("uses", "a@v1"))
        found += commands(step.get("run", ""))
    for words in found:
        assert not unknown_options(words), words
    assert [words[1] for words in found] == ["bench", "merge", "gate"]
    shard = found[0][found[0].index("--shard") + 1]
    assert shard == "${{ matrix.shard }}/${{ strategy.job-total }}"
    up, down = (
        next(s for s in job["steps"] if f"{verb}-artifact" in s.get("uses", ""))["with"]
        for job, verb in ((drive, "upload"), (gate, "download"))
    )
    assert up["name"] == down["pattern"].replace("*", "${{ matrix.shard }}")
    assert up["path"] == down["path"] == found[1][2].split("/")[0]
    assert down["merge-multiple"] is True
