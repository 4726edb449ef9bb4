"""Joined shards: the bytes of one process, or one line and nothing written."""

import csv
import os
import shutil
import signal
from dataclasses import replace
from hashlib import sha256
from itertools import count
from zipfile import ZipFile

import pytest

import hlsd
from hlsd.core.errors import HlsdError
from hlsd.core.executor import Serial
from hlsd.report.summary import write_summary
from hlsd.run.bench import Bench, run_bench
from hlsd.run.history import read_history
from hlsd.run.merge import merge_shards
from hlsd.run.tracebacks import faults_of, read_tracebacks, tracebacks_text
from hlsd.run.trajectory import read_archive
from tests.data.small_course import store_small_course
from tests.run.saboteur import PLANNER, Stop, in_child, sabotage, summary

SETTINGS = Bench(
    ("examples.follow_path:FollowPath", PLANNER), worlds="0:300:75", trials=2
)
SAME = ("run.json", "trajectories.zip", "tracebacks.txt")
SUMMED = ("summary.md", "summary.csv", "time_by_world.png")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A whole run, and its shards."""
    folder = tmp_path_factory.mktemp("shards")
    run_bench(SETTINGS, folder / "whole", Serial(), conclude=write_summary)
    for n in (1, 2, 3):
        run_bench(replace(SETTINGS, shard=f"{n}/3"), folder / f"s{n}", Serial())
    return folder


def shards(folder, numbers=(1, 2, 3)):
    return [folder / f"s{n}" for n in numbers]


def rows(folder, name="episodes.csv", drop=("wall_s",)):
    """The cells of a table, and its columns."""
    with (folder / name).open(newline="", encoding="utf-8") as file:
        reader = csv.DictReader(file)
        return reader.fieldnames, [
            {column: cell for column, cell in row.items() if column not in drop}
            for row in reader
        ]


def assert_same(merged, whole, names=(*SAME, *SUMMED)):
    """All but wall times are the same to the byte, and nothing else is there."""
    for name in names:
        assert (merged / name).read_bytes() == (whole / name).read_bytes(), name
    assert rows(merged) == rows(whole)
    timed = ("wall_s", "planning_wall_s")
    kept = [
        name
        for name in rows(whole, "timing.csv")[0]
        if name not in timed and not name.startswith(("planning_", "overruns"))
    ]
    assert kept == ["planner", "world", "trial", "ticks"]
    for n, row in enumerate(rows(whole, "timing.csv")[1]):
        assert [rows(merged, "timing.csv")[1][n][k] for k in kept] == [
            row[k] for k in kept
        ]
    for line in (merged / "results.sha256").read_text().splitlines():
        digest, name = line.split("  ")
        assert sha256((merged / name).read_bytes()).hexdigest() == digest
    names = {path.name for path in whole.iterdir()}
    assert {path.name for path in merged.iterdir()} == names


@pytest.mark.parametrize("order", [(1, 2, 3), (3, 1, 2)])
def test_shards_merged_are_the_bytes_of_one_process(made, tmp_path, order):
    run = hlsd.merge(shards(made, order), tmp_path / "run")
    assert_same(run.path, made / "whole")
    timing = [row for n in order for row in rows(made / f"s{n}", "timing.csv", ())[1]]
    found = rows(run.path, "timing.csv", ())[1]
    assert len(found) == 16
    assert all(row in timing for row in found), "wall times are those of the shards"
    assert [path.name for path in tmp_path.iterdir()] == ["run"]
    assert len(read_history(run.path).sessions) == 3 + 1, "the shards' and the merge"


def test_the_trials_of_a_course_merge_likewise(tmp_path):
    suite = store_small_course(tmp_path / "short")
    bench = Bench((PLANNER,), str(suite), trials=3)
    whole = run_bench(bench, tmp_path / "whole", Serial())
    parts = [
        run_bench(replace(bench, shard=f"{n}/2"), tmp_path / f"{n}", Serial())
        for n in (1, 2)
    ]
    merged = merge_shards(parts, tmp_path / "run")
    assert_same(merged, whole, SAME)


def test_a_shard_alone_is_the_whole(made, tmp_path):
    bench = replace(SETTINGS, worlds="60", trials=1)
    whole = run_bench(bench, tmp_path / "whole", Serial())
    part = run_bench(replace(bench, shard="1/1"), tmp_path / "part", Serial())
    assert_same(merge_shards([part], tmp_path / "run"), whole, SAME)


def test_an_existing_empty_folder_is_taken(made, tmp_path):
    (tmp_path / "run").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "run")
    merge_shards(shards(made), tmp_path / "link", conclude=write_summary)
    assert_same(tmp_path / "run", made / "whole")


def test_without_trajectories(made, tmp_path):
    """Of shards that have none, and of some of each where that is asked for."""
    mixed = [shutil.copytree(part, tmp_path / part.name) for part in shards(made)]
    (mixed[1] / "trajectories.zip").unlink()
    with pytest.raises(HlsdError, match="drive shard 2/3 again to have it"):
        merge_shards(mixed, tmp_path / "run")
    assert not (tmp_path / "run").exists()
    merge_shards(mixed, tmp_path / "left-out", trajectories=False)
    for part in mixed:
        (part / "trajectories.zip").unlink(missing_ok=True)
    merge_shards(mixed, tmp_path / "none")
    for name in ("left-out", "none"):
        assert rows(tmp_path / name) == rows(made / "whole")
        assert not (tmp_path / name / "trajectories.zip").exists()


def test_trajectories_are_read_one_by_one(made, tmp_path, monkeypatch):
    """None is read before the one before it was written."""
    events = []

    class Watched(dict):
        def __getitem__(self, key):
            events.append("read")
            return self.archive[key]

        def __init__(self, archive):
            super().__init__(dict.fromkeys(archive))
            self.archive = archive

    write = ZipFile.writestr

    def written(self, entry, block):
        events.append("written")
        write(self, entry, block)

    monkeypatch.setattr(
        "hlsd.run.merge.read_archive", lambda f: Watched(read_archive(f))
    )
    monkeypatch.setattr(ZipFile, "writestr", written)
    merge_shards(shards(made), tmp_path / "run")
    assert events == ["read", "written"] * 16


@pytest.mark.parametrize("how", ["full", "stop"])
def test_a_call_that_fails_at_any_moment_leaves_nothing(made, tmp_path, how):
    for at in count(1):
        place = tmp_path / f"at-{at}"
        with pytest.MonkeyPatch.context() as patch:
            counted = sabotage(patch, tmp_path, at, how)
            try:
                merge_shards(shards(made), place, conclude=summary)
                said = ""
            except (HlsdError, Stop) as error:
                said = str(error) or "stopped"
        if counted[0] < at:
            break
        assert "\n" not in said
        # Behind the move, all is there.
        found = {path.name for path in tmp_path.iterdir()}
        assert found in (set(), {place.name})
        if found:
            assert rows(place) == rows(made / "whole")
            shutil.rmtree(place)
    assert at > 20, "every call was a moment"
    assert rows(place) == rows(made / "whole")


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork")
def test_killed_at_any_moment_it_is_there_whole_or_not_at_all(made, tmp_path):
    for at in count(1, 3):
        place = tmp_path / f"at-{at}" / "run"

        def die(at=at, place=place):
            sabotage(pytest.MonkeyPatch(), place.parent, at, "kill")
            merge_shards(shards(made), place, conclude=summary)

        code = in_child(die)
        if code == 0:
            break
        assert code == -signal.SIGKILL
        if not place.exists():
            merge_shards(shards(made), place, conclude=summary)
        assert rows(place) == rows(made / "whole")
    assert at > 20


def test_tracebacks_are_read_as_they_were_written(tmp_path):
    """Also where one holds what stands between two of them."""
    reasons = ("exception: A: x (m.py:1)", "exception: B (m.py:1)", "hung: 3 s")
    rows = [
        {"planner": "p: x", "world": str(world), "trial": "0", "reason": reason}
        for world, reason in enumerate((*reasons, reasons[0], ""))
    ]
    faults = faults_of(rows)
    keys = [("p: x", world, 0) for world in range(3)]
    assert [(found.first, found.count) for found in faults] == [
        *((keys[0], 2), (keys[1], 1), (keys[2], 1)),
    ]
    rule = f"\n{'-' * 72}\n"
    file = tmp_path / "tracebacks.txt"
    for texts in (
        ("same", "same", ""),
        (
            "é \\ud800",
            "\r\n\x0b\u2028",
            "1 episode of planner p: x, in world 2, trial 0:",
        ),
        (f"first\n{rule}-{rule}{rule}", rule.strip(), f"{rule}{rule}"),
    ):
        file.write_bytes(tracebacks_text(dict(zip(keys, texts, strict=True)), faults))
        found = read_tracebacks(file, faults)
        assert list(found) == keys
        # A line of dashes gets a space behind it.
        assert [
            text.replace("- \n", "-\n").strip("\n ") for text in found.values()
        ] == [text.strip("\n") for text in texts]
        assert tracebacks_text(found, faults) == file.read_bytes()
    for damaged in (b"", b"\n", file.read_bytes()[5:], b"\xff"):
        file.write_bytes(damaged)
        with pytest.raises(HlsdError, match="is not as hlsd wrote it"):
            read_tracebacks(file, faults)
    file.write_bytes(tracebacks_text({}, faults))
    for others in (faults[1:], faults_of(rows[1:]), []):
        with pytest.raises(HlsdError, match="is not as hlsd wrote it"):
            read_tracebacks(file, others)
    assert read_tracebacks(tmp_path / "none", []) == {}
    with pytest.raises(HlsdError, match="list of tracebacks"):
        read_tracebacks(tmp_path / "none", faults)
