"""The folder of a run: whatever is damaged in an unfinished one, nothing misleads."""

import json
import os
import random
import re
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from hlsd.core.command import note_command
from hlsd.core.errors import HlsdError
from hlsd.core.files import is_draft, write_atomic
from hlsd.run.bench import resolve
from hlsd.run.folder import RunFolder
from hlsd.run.history import HISTORY, read_history
from hlsd.run.journal import JOURNAL, InUseError, Journal, TakenError
from hlsd.run.trajectory import ARCHIVE, read_archive
from tests.run.saboteur import (
    SETTINGS,
    GivesUp,
    assert_whole,
    bench,
    results,
    summary,
)

KEYS = [(SETTINGS.planners[0], world, trial) for world in (0, 150) for trial in (0, 1)]
MUTATIONS = int(os.environ.get("HLSD_MUTATIONS", "150"))


@pytest.fixture(scope="module")
def config():
    return resolve(SETTINGS)


@pytest.fixture(scope="module")
def driven(tmp_path_factory):
    """Rows and blocks of a whole run, and what its folder holds in the end."""
    folder = tmp_path_factory.mktemp("driven") / "run"
    rows = {}

    class Recorder(RunFolder):
        def append(self, new, trajectories=None, tracebacks=None):
            new = list(new)
            rows.update(
                {(r["planner"], int(r["world"]), int(r["trial"])): r for r in new}
            )
            super().append(new, trajectories, tracebacks)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("hlsd.run.bench.RunFolder", Recorder)
        bench(folder)
    return rows, dict(read_archive(folder / ARCHIVE)), results(folder)


def go_on(folder, config, driven):
    """Append what is missing, as a run does, and finish; the number of those."""
    rows, blocks, _ = driven
    with RunFolder(folder, config, {}) as held:
        missing = [key for key in KEYS if key not in held.finished]
        for key in missing:
            held.append([rows[key]], {key: blocks[key]}, {key: f"why {key[2]}"})
        held.finish(config.planners, summary)
    return len(missing)


def texts(folder):
    """All that must be the same whenever a run is driven."""
    held = {p.name: p.read_bytes() for p in folder.iterdir() if p.is_file()}
    held.pop(HISTORY, None)
    return held


@pytest.fixture
def unfinished(tmp_path, config, driven):
    """Three of four episodes are there."""
    rows, blocks, _ = driven
    with RunFolder(tmp_path / "run", config, {}) as held:
        for key in KEYS[:3]:
            held.append([rows[key]], {key: blocks[key]}, {key: f"why {key[2]}"})
    return tmp_path / "run"


def mutations(data, rng):
    """Bytes that are nearly what they were, in every way that comes to mind."""
    at = rng.randrange(len(data))
    end = min(len(data), at + rng.choice([1, 1, 8, 100]))
    yield data[:at] + bytes([data[at] ^ (1 << rng.randrange(8))]) + data[at + 1 :]
    yield data[:at] + data[end:]
    yield data[:at]
    yield data[:at] + rng.randbytes(end - at) + data[end:]
    yield data[:at] + bytes(end - at) + data[end:]
    yield data[:at] + rng.choice([b"\n", b"\xff", b"{", b" ", b"\r"]) + data[at:]
    yield data[:at] + data[at:end] + data[at:]
    lines = data.splitlines(keepends=True)
    rng.shuffle(lines)
    yield b"".join(lines)
    digits = [match.start() for match in re.finditer(rb"[0-9]", data)]
    at = rng.choice(digits)
    yield data[:at] + b"%d" % rng.randrange(10) + data[at + 1 :]


@pytest.mark.parametrize("name", [JOURNAL, "run.json", "trajectories/0.zip"])
def test_no_damage_misleads(unfinished, config, driven, name, capfd):
    """The same results in the end, or one line that refuses."""
    whole = unfinished.parent / "whole"
    shutil.copytree(unfinished, whole)
    assert go_on(whole, config, driven) == 1
    wanted = texts(whole)
    rng = random.Random(name)
    data = (unfinished / name).read_bytes()
    ends = {"same": 0, "refused": 0}
    folder = unfinished.parent / "mutated"
    while sum(ends.values()) < MUTATIONS:
        for mutated in mutations(data, rng):
            shutil.copytree(unfinished, folder)
            (folder / name).write_bytes(mutated)
            try:
                go_on(folder, config, driven)
                said = ""
            except HlsdError as error:
                said = str(error)
            ends["refused" if said else "same"] += 1
            assert "\n" not in said
            assert texts(folder) == wanted or (said and name == "run.json"), said
            shutil.rmtree(folder)
    assert ends["same"] > 0
    assert all(
        line.startswith("hlsd: ") for line in capfd.readouterr().err.splitlines()
    )


def test_each_session_is_in_the_history_and_decides_nothing(
    unfinished, config, driven, monkeypatch
):
    monkeypatch.setattr("hlsd.core.command._noted", [])
    note_command(["bench", "--out", "a b"])
    assert go_on(unfinished, config, driven) == 1
    found = read_history(unfinished)
    first, second = (each.command for each in found.sessions)
    assert first != second == "hlsd bench --out 'a b'"
    times = [*(each.began for each in found.sessions), found.ended]
    assert times == sorted(times)
    assert all(re.fullmatch(r"\d{4}(-\d\d){2}T\d\d(:\d\d){2}Z", at) for at in times)
    assert results(unfinished) == driven[2]
    assert HISTORY not in (unfinished / "results.sha256").read_text()
    for damage in ("", "[]", '{"sessions": 3}', '{"sessions": [3, {"began": []}]}'):
        (unfinished / HISTORY).write_text(damage)
        assert not any(each.began for each in read_history(unfinished).sessions)


def shorten(file):
    os.truncate(file, file.stat().st_size - 9)


TORN = "1 record of the journal torn, damaged or missing"


@pytest.mark.parametrize(
    ("remove", "again", "said"),
    [
        (lambda run: (run / "trajectories/0.zip").unlink(), 3, "2 trajectories torn"),
        (lambda run: shutil.rmtree(run / "trajectories"), 4, "3 trajectories torn"),
        (lambda run: (run / "trajectories/150.zip").write_bytes(b""), 2, "1 traject"),
        (lambda run: shorten(run / JOURNAL), 2, TORN),
        (lambda run: (run / JOURNAL).unlink(), 4, None),
        (lambda run: (run / "run.json").unlink(), 1, None),
        (lambda run: (run / "run.json").write_bytes(b""), 1, None),
    ],
)  # fmt: skip
def test_what_is_gone_is_driven_again(
    unfinished, config, driven, capfd, remove, again, said
):
    remove(unfinished)
    assert go_on(unfinished, config, driven) == again
    lines = capfd.readouterr().err.splitlines()
    assert [said in line for line in lines] == ([] if said is None else [True])
    assert (unfinished / ARCHIVE).read_bytes() == driven[2][1]


def test_a_record_of_another_run_does_not_count(unfinished, config, driven):
    """A line that was copied from a run with another seed, its checksum with it."""
    other = replace(config, conditions=replace(config.conditions, seed=1))
    rows, blocks, _ = driven
    with RunFolder(unfinished.parent / "other", other, {}) as held:
        held.append([rows[KEYS[3]] | {"time_s": "1.0"}], {KEYS[3]: blocks[KEYS[3]]})
    line = (unfinished.parent / "other" / JOURNAL).read_bytes().splitlines()[-1]
    with (unfinished / JOURNAL).open("ab") as file:
        file.write(line + b"\n")
    assert go_on(unfinished, config, driven) == 1


def test_a_folder_that_was_begun_only_is_begun_anew(tmp_path, config, driven):
    """Drafts of the first file, an empty one, and the lock of a dead process."""
    for number, names in enumerate(
        ([], [".run.json.ab12cd_9"], ["run.json"], ["journal.jsonl"])
    ):
        folder = tmp_path / str(number)
        folder.mkdir()
        for name in names:
            (folder / name).touch()
        assert go_on(folder, config, driven) == 4
        assert not [path for path in folder.iterdir() if path.name[0] == "."]


def test_what_is_not_a_run_stays(tmp_path, config):
    """Discarding or not."""
    for name in ("thesis.tex", ".bashrc", ".run.json.longer_than_that"):
        folder = tmp_path / name
        folder.mkdir()
        (folder / name).write_text("mine")
        for discard in (False, True):
            with pytest.raises(TakenError, match="is not empty"):
                RunFolder(folder, config, {}, discard=discard)
        assert [path.name for path in folder.iterdir()] == [name]
    (folder / name).rename(folder / "run.json")
    (folder / "thesis.tex").touch()
    with pytest.raises(TakenError, match="is not empty"):
        RunFolder(folder, config, {}, discard=True)
    assert (folder / "run.json").read_text() == "mine"
    with pytest.raises(TakenError, match="is a file"):
        RunFolder(folder / "run.json", config, {})


def test_a_run_by_something_else_is_refused_or_discarded(unfinished, config, driven):
    for other, what in (
        (replace(config, planner_sha256=("f00",)), r"other code of planner '\S+'"),
        (replace(config, policy_sha256=("f00",)), r"another policy for planner '\S+'"),
        (replace(config, code={"hlsd": "f00"}), r"other code of hlsd"),
        (
            replace(config, versions=dict(config.versions, numba="9.9")),
            r"versions numba '\S+', now '9.9'",
        ),
        (replace(config, trials=3), r"other settings \(trials 2, now 3\)"),
    ):
        before = texts(unfinished)
        with pytest.raises(HlsdError, match=what) as refused:
            RunFolder(unfinished, other, {})
        assert "choose another `out`, or throw" in str(refused.value)
        assert "`discard`" in str(refused.value)
        assert texts(unfinished) == before
    with RunFolder(unfinished, replace(config, trials=3), {}, discard=True) as held:
        assert held.finished == {}
    assert not (unfinished / "trajectories").exists()
    with RunFolder(unfinished, config, {}, discard=True) as held:
        assert held.finished == {}
    assert go_on(unfinished, config, driven) == 4


def test_a_default_folder_with_other_settings_is_left_alone(unfinished, config):
    for discard in (False, True):
        with pytest.raises(TakenError):
            RunFolder(
                unfinished,
                replace(config, trials=3),
                {},
                discard=discard,
                only_same=True,
            )
    with pytest.raises(HlsdError, match="other code of hlsd") as refused:
        RunFolder(unfinished, replace(config, code={"hlsd": "f00"}), {}, only_same=True)
    assert not isinstance(refused.value, TakenError)


def test_a_finished_run_is_never_discarded(unfinished, config, driven):
    go_on(unfinished, config, driven)
    before = texts(unfinished)
    with pytest.raises(TakenError, match="already holds a finished run"):
        RunFolder(unfinished, config, {}, discard=True)
    assert texts(unfinished) == before


def test_a_run_of_an_earlier_format_is_refused_with_a_way_on(unfinished, config):
    manifest = json.loads((unfinished / "run.json").read_text())
    manifest["format"] = 2
    del manifest["config"]["code"], manifest["config"]["versions"]
    (unfinished / "run.json").write_text(json.dumps(manifest))
    (unfinished / JOURNAL).rename(unfinished / "journal.csv")
    with pytest.raises(HlsdError, match="another version of hlsd"):
        RunFolder(unfinished, config, {})
    assert not (unfinished / JOURNAL).exists(), "nothing was left there"
    RunFolder(unfinished, config, {}, discard=True).close()
    assert not (unfinished / "journal.csv").exists()


def test_each_fault_has_its_first_traceback(unfinished, config, driven):
    rows, _, _ = driven
    long = "x" * 10**6
    other = rows[KEYS[3]] | {"reason": "exception: OSError: disk 7 of 9 (mine.py:3)"}
    with RunFolder(unfinished, config, {}) as held:
        held.append([other], {}, {KEYS[3]: f"\ud800{long}\n"})
        held.finish(config.planners)
    text = (unfinished / "tracebacks.txt").read_text(encoding="utf-8")
    first, second = text.split(f"\n{'-' * 72}\n")
    name = SETTINGS.planners[0]
    line = GivesUp.plan.__code__.co_firstlineno + 3
    assert first == (
        f"3 episodes of planner {name}, the first in world 0, trial 0:\n"
        f"  exception: ValueError: enough (tests/run/saboteur.py:{line})\n\nwhy 0\n"
    )
    assert second.startswith(
        f"1 episode of planner {name}, in world 150, trial 1:\n"
        "  exception: OSError: disk 7 of 9 (mine.py:3)\n\n\\ud800xxx"
    )
    assert "characters are left out" in second
    assert len(second) < 60_000


def test_tracebacks_are_the_same_in_any_order_and_after_an_interruption(
    tmp_path, config, driven
):
    rows, blocks, _ = driven
    texts = {key: f"why {number}" for number, key in enumerate(KEYS)}
    found = set()
    orders = (KEYS, KEYS[::-1], [KEYS[2], KEYS[0], KEYS[3], KEYS[1]])
    for name, order in enumerate(orders):
        folder = tmp_path / str(name)
        for number, key in enumerate(order):
            with RunFolder(folder, config, {}) as held:
                held.append([rows[key]], {key: blocks[key]}, {key: texts[key]})
                if number == 1 and order is not KEYS:
                    held._pieces.remove()  # its trajectories are lost
                if number == 3:
                    for gone in [key for key in KEYS if key not in held.finished]:
                        held.append([rows[gone]], {}, {gone: texts[gone]})
                    held.finish(config.planners)
        found.add((folder / "tracebacks.txt").read_bytes())
    (text,) = found
    assert text.endswith(b"\n\nwhy 0\n")
    assert text.startswith(b"4 episodes of planner")


def test_no_failure_is_no_file(unfinished, config, driven):
    rows, blocks, _ = driven
    with RunFolder(unfinished, config, {}) as held:
        well = [rows[key] | {"reason": ""} for key in KEYS]
        held.append(well, {key: blocks[key] for key in KEYS})
        held.finish(config.planners)
    assert not (unfinished / "tracebacks.txt").exists()


def test_the_disk_has_all_before_the_journal_goes(tmp_path, monkeypatch):
    """Each result was synced, and the folder, when the journal is unlinked."""
    synced, at_the_end = [], []
    fsync, unlink = os.fsync, os.unlink

    def note(descriptor):
        synced.append(Path(os.readlink(f"/proc/self/fd/{descriptor}")).name)
        fsync(descriptor)

    def noted(path, **options):
        if Path(path).name == JOURNAL:
            at_the_end.extend(synced)
        unlink(path, **options)

    monkeypatch.setattr(os, "fsync", note)
    monkeypatch.setattr(os, "unlink", noted)
    if not Path("/proc/self/fd").is_dir():
        pytest.skip("needs /proc to know what a descriptor is of")
    bench(tmp_path / "run")
    made = {"run.json", "episodes.csv", "timing.csv", ARCHIVE, "summary.md", "run"}
    assert made < {*at_the_end}
    assert at_the_end.count(JOURNAL) >= 3, "the owner and a record for each task"


def test_a_journal_is_locked_until_it_is_let_go(tmp_path):
    file = tmp_path / JOURNAL
    first = Journal(file)
    first.begin()
    with pytest.raises(InUseError, match=f"in use by process {os.getpid()} on "):
        Journal(file)
    first.close()
    second = Journal(file)
    second.remove()
    assert not file.exists()
    Journal(file).close()
    assert not file.exists(), "one without anything in it goes"


def test_a_journal_that_is_no_file_is_one_line(tmp_path, config):
    for make in (Path.mkdir, os.mkfifo):
        folder = tmp_path / make.__name__
        folder.mkdir()
        make(folder / JOURNAL)
        with pytest.raises(HlsdError) as refused:
            RunFolder(folder, config, {})
        assert "\n" not in str(refused.value)


def test_drafts_are_known_by_their_names(tmp_path):
    seen = []
    real = os.replace

    def see(source, target):
        seen.append(Path(source).name)
        real(source, target)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(os, "replace", see)
        for _ in range(50):
            write_atomic(tmp_path / "run.json", b"")
    assert len({*seen}) == 50
    assert all(is_draft(name, ("run.json",)) for name in seen)
    assert not is_draft(seen[0], ("episodes.csv",))
    assert not is_draft("run.json", ("run.json",))


def test_assert_whole_can_fail(tmp_path):
    folder = bench(tmp_path / "run")
    wanted = results(folder)
    (folder / "more").touch()
    with pytest.raises(AssertionError):
        assert_whole(folder, wanted)
