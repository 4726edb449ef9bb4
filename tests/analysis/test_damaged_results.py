"""Results that were damaged, cut or edited: refused in one line, or read the same."""

import csv
import hashlib
import io
import json
import random
import shutil

import pandas as pd
import pytest

from hlsd.analysis.challenge import export_run
from hlsd.analysis.compare import compare_runs, load_side
from hlsd.analysis.gate import gate_run, load_baseline, write_baseline
from hlsd.analysis.runs import join_runs, join_trajectories, load_episodes, load_run
from hlsd.analysis.validate import validate_run
from hlsd.core.errors import HlsdError
from hlsd.run.conditions import Conditions
from hlsd.run.folder import RunConfig, RunFolder, write_imported
from hlsd.run.protocol import BARN2022, HLSD2021
from hlsd.run.row import COLUMNS, FIELDS, TIMING_COLUMNS
from hlsd.run.seal import SEAL
from tests.analysis.test_gate import hlsd

PLANNERS, WORLDS, TRIALS = ("a", "b"), (0, 3, 5, 7), 2
HEAD = "world,planner,trial,time_s\n"
EPISODES, TIMING, RECORD = "episodes.csv", "timing.csv", "run.json"


def conditions(protocol=HLSD2021, **changed):
    held = {
        "suite": "barn300",
        "suite_version": "1",
        "suite_digest": "d1",
        "protocol": protocol,
        "robot": "jackal",
        "robot_version": "1.0",
        "robot_sha256": "f00",
        "seed": 4,
    }
    return Conditions(**{**held, **changed})


def row(held, planner, world, trial, n=0, outcome="success", **changed):
    """A row as driving makes it, all columns filled that are always known."""
    failed = outcome != "success"
    blank = dict.fromkeys((*COLUMNS, *TIMING_COLUMNS), "")
    blank |= {name: "1" for name, f in FIELDS.items() if f.required}
    return blank | {
        "suite": held.suite,
        "suite_version": held.suite_version,
        "robot": held.robot,
        "robot_version": held.robot_version,
        "protocol": held.protocol.name,
        "seed": "" if held.seed is None else str(held.seed),
        "planner": planner,
        "world": str(world),
        "trial": str(trial),
        "outcome": outcome,
        "reason": 'exception: ValueError: "no, never"' if outcome == "error" else "",
        "time_s": f"{held.protocol.limit_s if failed else 10 + n % 7:.4f}",
        "contact_time_s": "0.0000",
        "sim_time_s": "60.0000",
        "min_clearance_m": f"0.{n + 10}",
        "official_length_m": "" if held.protocol.score is None else "10.500000",
        "planning_median_ms": "1.2500",
        **changed,
    }


OUTCOMES = ("success",) * 5 + ("timeout", "success", "error")


def drive(folder, held=None, planners=PLANNERS, worlds=WORLDS, trials=TRIALS, **config):
    """A finished run's folder, as `hlsd bench` writes it."""
    held = held or conditions()
    config = {"policy_sha256": ("",) * len(planners), **config}
    run = RunFolder(
        folder,
        RunConfig(planners, worlds=worlds, trials=trials, conditions=held, **config),
        {},
    )
    keys = [(p, w, t) for p in planners for w in worlds for t in range(trials)]
    run.append(
        row(held, *key, n=n, outcome=OUTCOMES[n % len(OUTCOMES)])
        for n, key in enumerate(keys)
    )
    run.finish(planners)
    return folder


def unseal(folder):
    (folder / SEAL).unlink()
    return folder


def copy(folder, to):
    shutil.rmtree(to, ignore_errors=True)
    shutil.copytree(folder, to)
    return to


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return drive(tmp_path_factory.mktemp("damaged") / "whole")


@pytest.fixture(scope="module")
def bare(whole, tmp_path_factory):
    """The same without digests, as 0.1.0 left it: its cells alone speak."""
    return unseal(copy(whole, tmp_path_factory.mktemp("damaged") / "bare"))


def refused(read):
    """The one line by which something is refused."""
    with pytest.raises(HlsdError) as caught:
        read()
    text = str(caught.value)
    assert text.isprintable(), text
    assert len(text) < 700
    return text


def attempt(read):
    """What a reader returns, None if it refuses, and the line by which it does."""
    try:
        return read(), ""
    except HlsdError as error:
        return None, str(error)


def readers(folder, baseline, reference):
    """All that reads results, by name; each returns what can be compared."""
    side = f"{folder}:a"
    return {
        "run": lambda: repr(load_run(folder).episodes.to_csv()),
        "report": lambda: (join_runs([folder]).to_csv(), join_trajectories([folder])),
        "compare": lambda: compare_runs(side, f"{folder}:b").as_json()["metrics"],
        "gate": lambda: gate_run(side, baseline).as_json()["metrics"],
        "side": lambda: load_side(side, ["success"]).values["success"].tolist(),
        "validate": lambda: validate_run(folder, reference, "a").as_json(),
    }


# ------------------------------------------------------------------------ whole files


def lines_of(path):
    return path.read_text(encoding="utf-8").splitlines(keepends=True)


def cell(path, number, column, value):
    """Put a value into a row's cell; returns the line in the file, from 1."""
    with path.open(newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))
    rows[number][rows[0].index(column)] = value
    out = io.StringIO()
    csv.writer(out, lineterminator="\n").writerows(rows)
    path.write_text(out.getvalue(), encoding="utf-8")
    return number + 1


def mutated(data, rng):
    """Bytes with one thing changed, as disks, editors and people change them."""
    lines = data.splitlines(keepends=True)
    k = rng.randrange(len(lines))
    kind = rng.choice(("cut", "drop", "twice", "swap", "byte", "cell", "insert"))
    if kind == "cut":
        return data[: rng.randrange(len(data))]
    if kind == "drop":
        return b"".join(lines[:k] + lines[k + 1 :])
    if kind == "twice":
        return b"".join(lines[: k + 1] + lines[k:])
    if kind == "swap":
        other = rng.randrange(len(lines))
        lines[k], lines[other] = lines[other], lines[k]
        return b"".join(lines)
    at = rng.randrange(len(data))
    if kind == "byte":
        return data[:at] + bytes([rng.randrange(256)]) + data[at + 1 :]
    if kind == "insert":
        return data[:at] + rng.choice((b"\0", b"\n", b'"', b",", b"\xff")) + data[at:]
    cells = lines[k].split(b",")
    cells[rng.randrange(len(cells))] = rng.choice(
        (b"NaN", b"inf", b"-100", b"0.5", b"", b"maybe", b"1e999", b"9" * 30, b'"a,b"')
    )
    return b"".join(lines[:k]) + b",".join(cells) + b"".join(lines[k + 1 :])


@pytest.mark.parametrize("name", [EPISODES, TIMING, RECORD, SEAL])
def test_no_change_of_a_sealed_folder_goes_unsaid(whole, tmp_path, name):
    """Every command reads what was written, or says in a line that it is not that."""
    baseline, reference = tmp_path / "base.json", tmp_path / "trials.csv"
    write_baseline(f"{whole}:a", baseline)
    reference.write_text(HEAD + "".join(f"{w},x,0,12.5\n" for w in WORLDS))
    right = {n: read() for n, read in readers(whole, baseline, reference).items()}
    rng = random.Random(name)
    folder = copy(whole, tmp_path / "run")
    data = (whole / name).read_bytes()
    for _ in range(20 if name == SEAL else 60):
        changed = mutated(data, rng)
        (folder / name).write_bytes(changed)
        for reader, read in readers(folder, baseline, reference).items():
            found, line = attempt(read)
            if line:
                assert line.isprintable()
                assert changed != data
                continue
            # A list of digests with a line less still vouches for the others.
            assert changed == data or name == SEAL, (reader, changed)
            assert found == right[reader]
            if name == SEAL:
                break


@pytest.mark.parametrize("name", [EPISODES, TIMING])
def test_a_table_that_was_cut_is_refused_wherever_it_ends(bare, tmp_path, name):
    folder = copy(bare, tmp_path / "run")
    data = (bare / name).read_bytes()
    rng = random.Random(name)
    ends = {rng.randrange(len(data)) for _ in range(60)}
    ends |= {n + 1 for n, byte in enumerate(data[:-1]) if byte == ord("\n")}
    for end in ends:
        (folder / name).write_bytes(data[:end])
        assert name in refused(lambda: load_run(folder)), end


@pytest.mark.parametrize("name", [EPISODES, TIMING])
def test_a_row_that_is_missing_or_there_twice_is_named(bare, tmp_path, name):
    folder = copy(bare, tmp_path / "run")
    lines = lines_of(bare / name)
    for k in range(1, len(lines)):
        cells = lines[k].split(",")
        place = {c: cells[lines[0].split(",").index(c)] for c in ("world", "trial")}
        episode = f"world {place['world']}, trial {place['trial']}"
        (folder / name).write_text("".join(lines[:k] + lines[k + 1 :]))
        text = refused(lambda: load_run(folder))
        assert "lacks 1 of the run's 16 episodes" in text
        assert episode in text
        (folder / name).write_text("".join([*lines, lines[k]]))
        text = refused(lambda: load_run(folder))
        assert f"line {len(lines) + 1}" in text
        assert f"{episode} again" in text
        assert f"line {k + 1} has it" in text


CELLS = {
    "world": ("0.5", "-1", "", "NaN", "inf", "1e999", "9" * 30, "1", "two", "²"),
    "trial": ("0.5", "-1", "", "7", "1e3x"),
    "seed": ("-1", "0.5", "5", "nan", ""),
    "planner": ("", "c"),
    "suite": ("", "barn30"),
    "suite_version": ("2",),
    "protocol": ("", "barn2022", "nobody's"),
    "robot": ("cart",),
    "robot_version": ("1",),
    "outcome": ("maybe", "", "Success", "timeout "),
    "reason": ("because",),
    "time_s": ("NaN", "nan", "inf", "-100", "50.1", "1e999", "", "1_0", "ten", "١"),
    "contacts": ("-1", "0.5", "", "nan", "9" * 30),
    "contact_time_s": ("-0.1", "60.5", "", "Infinity"),
    "path_length_m": ("-3", "", "NaN"),
    "official_length_m": ("-1", "inf"),
    "min_clearance_m": ("-0.1", "nan", "-inf", "0,1"),
    "recoveries": ("-1", "1.5"),
    "ticks": ("-1", "2.5", ""),
    "sim_time_s": ("-1", ""),
    "wall_s": ("-1", "", "0x10"),
}


@pytest.mark.parametrize(
    ("column", "value"),
    [(column, value) for column, values in CELLS.items() for value in values],
)
def test_a_cell_that_cannot_be_is_refused_with_its_place(bare, tmp_path, column, value):
    folder = copy(bare, tmp_path / "run")
    line = cell(folder / EPISODES, 2, column, value)
    text = refused(lambda: load_run(folder))
    assert f"{EPISODES} line {line}" in text
    assert f"column {column}: {repr(value)[:50]}" in text


@pytest.mark.parametrize(
    ("column", "value"),
    [
        ("planning_wall_s", "-1"),
        ("planning_wall_s", "nan"),
        ("planning_median_ms", "inf"),
        ("overruns", "1.5"),
        ("world", "4"),
        ("planner", "c"),
    ],
)
def test_a_damaged_table_of_times_is_refused_with_its_place(
    bare, tmp_path, column, value
):
    folder = copy(bare, tmp_path / "run")
    line = cell(folder / TIMING, 2, column, value)
    assert f"{TIMING} line {line}" in refused(lambda: load_run(folder))


def test_a_length_that_a_score_divides_by_is_more_than_0(tmp_path):
    held = conditions(BARN2022)
    rows = [row(held, "x", world, 0, official_length_m="0") for world in (0, 1)]
    write_imported(tmp_path / "run", rows, {}, held)
    assert "official_length_m: '0'" in refused(lambda: load_run(tmp_path / "run"))


def test_a_missing_table_of_times_is_none_unless_it_was_there(whole, bare, tmp_path):
    folder = copy(bare, tmp_path / "bare")
    (folder / TIMING).unlink()
    assert "planning_median_ms" not in load_run(folder).episodes
    folder = copy(whole, tmp_path / "whole")
    (folder / TIMING).unlink()
    assert f"{TIMING} is gone" in refused(lambda: load_run(folder))


BYTES = {
    "two columns of one name": (b"trial,seed", b"trial,trial"),
    "a column without a name": (b"trial,seed", b"trial,"),
    "a column that is missing": (b"outcome", b"ending"),
    "a NUL": (b"success", b"succ\0ss"),
    "another encoding": (b"success", b"succ\xe9s"),
    "a quote that does not end": (b"\nbarn300", b'\n"barn300'),
    "a cell too many": (b"\nbarn300,", b"\nbarn300,,"),
}


@pytest.mark.parametrize("kind", BYTES)
def test_a_table_that_is_none_is_refused(bare, tmp_path, kind):
    folder = copy(bare, tmp_path / "run")
    data = (folder / EPISODES).read_bytes()
    old, new = BYTES[kind]
    assert old in data
    (folder / EPISODES).write_bytes(data.replace(old, new, 1))
    assert EPISODES in refused(lambda: load_run(folder))


def test_marks_and_line_ends_of_other_systems_are_read_the_same(bare, tmp_path):
    right = load_episodes(bare)
    folder = copy(bare, tmp_path / "run")
    data = (bare / EPISODES).read_bytes().replace(b"\n", b"\r\n")
    (folder / EPISODES).write_bytes(b"\xef\xbb\xbf" + data)
    pd.testing.assert_frame_equal(load_episodes(folder), right)


RECORDS = {
    "no JSON": lambda plain: "{",
    "a list": lambda plain: [],
    "neither driven nor imported": lambda plain: {},
    "nested deeply": lambda plain: "[" * 100_000,
    "no worlds": lambda plain: plain["config"].update(worlds=[]),
    "worlds that are none": lambda plain: plain["config"].update(worlds=[0.5]),
    "a world less": lambda plain: plain["config"].update(worlds=[0, 3, 5]),
    "a world more": lambda plain: plain["config"].update(worlds=[0, 3, 5, 7, 9]),
    "far too many trials": lambda plain: plain["config"].update(trials=10**12),
    "trials that are none": lambda plain: plain["config"].update(trials="2"),
    "another planner": lambda plain: plain["config"].update(planners=["a", "x"]),
    "digests of others": lambda plain: plain["config"].update(policy_sha256=["1"]),
    "another seed": lambda plain: plain["config"]["conditions"].update(seed=5),
    "a seed that is none": lambda plain: plain["config"]["conditions"].update(seed="4"),
    "a limit that is none": lambda plain: plain["config"]["conditions"][
        "protocol"
    ].update(limit_s="50"),
    "a negative limit": lambda plain: plain["config"]["conditions"]["protocol"].update(
        limit_s=-50
    ),
    "a lower limit": lambda plain: plain["config"]["conditions"]["protocol"].update(
        limit_s=30
    ),
    "ends of a kind unheard of": lambda plain: plain["config"]["conditions"][
        "protocol"
    ]["ends"].update(kind="path"),
    "a suite that is a list": lambda plain: plain["config"]["conditions"].update(
        suite={"name": [], "version": "1", "digest": "d"}
    ),
}


@pytest.mark.parametrize("kind", RECORDS)
def test_a_record_that_does_not_fit_its_rows_is_refused(bare, tmp_path, kind):
    folder = copy(bare, tmp_path / "run")
    plain = json.loads((folder / RECORD).read_text())
    changed = RECORDS[kind](plain)
    text = changed if isinstance(changed, str) else json.dumps(changed or plain)
    if kind in ("a list", "neither driven nor imported"):
        text = json.dumps(changed)
    (folder / RECORD).write_text(text)
    assert RECORD in refused(lambda: load_run(folder)) or kind == "a lower limit"
    refused(lambda: load_run(folder))


def test_nothing_is_called_that_a_record_names(bare, tmp_path, monkeypatch):
    """Start and goal may be of a package; only its values are made, no calls."""
    folder = copy(bare, tmp_path / "run")
    plain = json.loads((folder / RECORD).read_text())
    ends = {"kind": "os:mkdir", "path": str(tmp_path / "made")}
    plain["config"]["conditions"]["protocol"]["ends"] = ends
    (folder / RECORD).write_text(json.dumps(plain))
    assert load_run(folder).conditions.protocol.limit_s == 50
    assert not (tmp_path / "made").exists()


def test_no_module_is_imported_that_a_record_names(bare, tmp_path, monkeypatch):
    """Not even one that lies in the working directory."""
    folder = copy(bare, tmp_path / "run")
    (tmp_path / "lies_here.py").write_text("open('made', 'w').close()\nclass X: ...\n")
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    plain = json.loads((folder / RECORD).read_text())
    plain["config"]["conditions"]["protocol"]["ends"] = {"kind": "lies_here:X"}
    (folder / RECORD).write_text(json.dumps(plain))
    assert load_run(folder).conditions.protocol.limit_s == 50
    assert not (tmp_path / "made").exists()


# ------------------------------------------------------------------------- the digests


def test_digests_are_those_that_sha256sum_checks(whole):
    lines = (whole / SEAL).read_text().splitlines()
    assert [line.split("  ")[1] for line in lines] == [EPISODES, TIMING, RECORD]
    for line in lines:
        digest, name = line.split("  ")
        assert hashlib.sha256((whole / name).read_bytes()).hexdigest() == digest


def test_a_changed_digit_is_noticed_and_the_line_says_what_to_do(whole, tmp_path):
    folder = copy(whole, tmp_path / "run")
    cell(folder / EPISODES, 1, "time_s", "9.9999")
    text = refused(lambda: load_run(folder))
    assert f"{EPISODES} was changed since hlsd wrote it" in text
    assert "a folder of its own" in text
    # What the line says can be done: rows alone, whichever they are.
    own = tmp_path / "own"
    own.mkdir()
    lines = lines_of(folder / EPISODES)
    (own / EPISODES).write_text("".join(lines[:5]))
    assert len(load_run(own).episodes) == 4


def test_rows_of_an_imported_run_are_counted_too(tmp_path):
    held = conditions(BARN2022, robot="", robot_version="", robot_sha256="", seed=None)
    rows = [row(held, "x", w, t) for w in range(4) for t in range(2)]
    write_imported(tmp_path / "run", rows, {"file": "out.txt"}, held)
    folder = tmp_path / "run"
    assert len(load_run(folder).episodes) == 8
    unseal(folder)
    lines = lines_of(folder / EPISODES)
    (folder / EPISODES).write_text("".join(lines[:5]))
    text = refused(lambda: export_run(folder))
    assert "has 4 rows, but run.json beside it counts 8" in text


def test_folders_of_earlier_versions_are_read(bare, tmp_path):
    """Format 2 has no digests of files; 0.1.0 had names in place of conditions."""
    second = copy(bare, tmp_path / "second")
    plain = json.loads((second / RECORD).read_text())
    plain["format"] = 2
    plain["config"].pop("planner_sha256")
    (second / RECORD).write_text(json.dumps(plain))
    right = load_episodes(bare)
    pd.testing.assert_frame_equal(load_episodes(second), right)
    first = copy(bare, tmp_path / "first")
    (first / TIMING).unlink()
    config = {
        "planners": list(PLANNERS),
        "policy_sha256": ["", "abc"],
        "suite": "barn300",
        "suite_version": "1",
        "suite_digest": "d1",
        "worlds": list(WORLDS),
        "trials": TRIALS,
        "protocol": "hlsd2021",
        "robot": "jackal",
        "robot_version": "1.0",
        "seed": 4,
    }
    (first / RECORD).write_text(json.dumps({"config": config, "versions": {}}))
    found = load_episodes(first)
    pd.testing.assert_frame_equal(found, right[found.columns])
    assert load_side(f"{first}:b", ["time_s"]).digests == {"policy": "abc"}
    lines = lines_of(first / EPISODES)
    (first / EPISODES).write_text("".join(lines[:-3]))
    assert "lacks 3" in refused(lambda: load_run(first))


# --------------------------------------------------------------------------- baselines


@pytest.fixture(scope="module")
def baseline(whole, tmp_path_factory):
    path = tmp_path_factory.mktemp("damaged") / "base.json"
    write_baseline(f"{whole}:a", path, ("success", "time_s", "min_clearance_m"))
    return path


def plain_side(side):
    values = {name: repr(column.tolist()) for name, column in side.values.items()}
    keys = list(zip(side.worlds.tolist(), side.trials.tolist(), strict=True))
    return side.planner, side.conditions, keys, values, dict(side.digests)


def test_no_change_of_a_baseline_goes_unsaid(baseline, tmp_path):
    right = plain_side(load_baseline(baseline))
    data = baseline.read_bytes()
    rng = random.Random(0)
    file = tmp_path / "base.json"
    seen = 0
    for _ in range(400):
        file.write_bytes(mutated(data, rng))
        found, line = attempt(lambda: plain_side(load_baseline(file)))
        assert line.isprintable()
        assert line or found == right
        seen += bool(line)
    assert seen > 300


BASELINES = {
    "NaN": lambda held: held["runs"][0].__setitem__(2, float("nan")),
    "a text": lambda held: held["runs"][0].__setitem__(3, "9.5"),
    "true": lambda held: held["runs"][0].__setitem__(3, True),
    "world 0.5": lambda held: held["runs"][0].__setitem__(0, 0.5),
    "a huge world": lambda held: held["runs"][0].__setitem__(0, 10**30),
    "trial -1": lambda held: held["runs"][0].__setitem__(1, -1),
    "a run twice": lambda held: held["runs"].append(held["runs"][0]),
    "no runs": lambda held: held.update(runs=[]),
    "runs that are none": lambda held: held.update(runs={"a": 1}),
    "no planner": lambda held: held.pop("planner"),
    "a seed that is none": lambda held: held["conditions"].update(seed=0.5),
    "no conditions": lambda held: held.pop("conditions"),
    "metrics that are none": lambda held: held.update(metrics=["success"]),
    "a limit that is none": lambda held: held["conditions"]["protocol"].update(
        limit_s=None
    ),
}


@pytest.mark.parametrize("kind", BASELINES)
def test_a_baseline_without_a_digest_is_checked_too(baseline, tmp_path, kind):
    held = json.loads(baseline.read_text())
    held["format"] = "hlsd baseline 2"
    del held["sha256"], held["digests"]
    file = tmp_path / "base.json"
    file.write_text(json.dumps(held))
    load_baseline(file)
    BASELINES[kind](held)
    file.write_text(json.dumps(held))
    assert "base.json" in refused(lambda: load_baseline(file))


def test_a_baseline_s_layout_is_no_content(baseline, tmp_path):
    file = tmp_path / "base.json"
    file.write_text(json.dumps(json.loads(baseline.read_text()), indent=1))
    assert plain_side(load_baseline(file)) == plain_side(load_baseline(baseline))


# --------------------------------------------------------------- on the command line


def test_bad_results_are_one_line_and_exit_code_2(
    whole, bare, baseline, tmp_path, monkeypatch, capsys
):
    """Not 1, which is the gate's word for a regression."""
    cut = copy(bare, tmp_path / "cut")
    (cut / EPISODES).write_text("".join(lines_of(bare / EPISODES)[:9]))
    times = copy(bare, tmp_path / "times")
    (times / TIMING).write_bytes(b"\xff\xfe\0")
    policy = tmp_path / "drive.npz"
    policy.write_bytes(b"PK\x03\x04\xff\xfe\0\x80")
    empty = tmp_path / "empty.json"
    empty.write_text("{}")
    reference = tmp_path / "trials.csv"
    reference.write_text(HEAD + "0,x,0,12.5\n3,x,0,12\n5,x,0,11\n")
    commands = [
        ("gate", f"{whole}:a", "--baseline", policy),
        ("gate", f"{whole}:a", "--baseline", empty),
        ("gate", f"{whole}:a", "--baseline", tmp_path),
    ]
    for folder in (cut, times):
        commands += [
            ("gate", f"{folder}:a", "--baseline", baseline),
            ("baseline", f"{folder}:a", "--out", tmp_path / "new.json"),
            ("compare", f"{whole}:a", f"{folder}:b"),
            ("report", whole, folder, "--out", tmp_path / "report"),
            ("validate", folder, "--planner", "a", "--against", reference),
            ("export", folder, "--planner", "a", "--out", tmp_path / "out.txt"),
        ]
    for command in commands:
        code, out, err = hlsd(monkeypatch, capsys, *command)
        assert (code, out, err.count("\n")) == (2, "", 1), (command, err)
        assert err.startswith("hlsd: ")
    for name in ("new.json", "report", "out.txt"):
        assert not (tmp_path / name).exists()


# ------------------------------------------------------------- what is known by a name


SAME = {
    "driven": {},
    "imported": {"seed": None, "robot": "", "robot_version": "", "robot_sha256": ""},
    "one world": {"worlds": (3,)},
    "one trial": {"trials": 1},
    "one run": {"worlds": (3,), "trials": 1},
    "failures alone": {"outcomes": ("timeout",)},
    "undefined values": {"clearance": ""},
    "imported, one run": {"seed": None, "worlds": (3,), "trials": 1},
    "imported, failures alone": {"seed": None, "outcomes": ("timeout",)},
}


@pytest.mark.parametrize("kind", SAME)
def test_the_same_rows_as_the_baselines_are_always_ok(tmp_path, kind):
    """With any limit and any number of worlds, whatever is known of the runs."""
    asked = dict(SAME[kind])
    worlds, trials = asked.pop("worlds", WORLDS), asked.pop("trials", TRIALS)
    outcomes = asked.pop("outcomes", OUTCOMES)
    clearance = asked.pop("clearance", "0.2")
    held = conditions(**asked)
    rows = [
        row(
            held,
            "x",
            world,
            trial,
            n,
            outcomes[n % len(outcomes)],
            # One is known, so that the metric has a value at all.
            min_clearance_m="0.2" if n == 0 else clearance,
        )
        for n, (world, trial) in enumerate(
            (w, t) for w in worlds for t in range(trials)
        )
    ]
    run, base = tmp_path / "run", tmp_path / "base.json"
    write_imported(run, rows, {"file": "somewhere"}, held)
    metrics = ("success", "time_s", "min_clearance_m")
    write_baseline(str(run), base, metrics)
    for limit in (None, "0%"):
        gated = gate_run(str(run), base, max_regression=limit)
        assert [str(one.status) for one in gated.gated] == ["ok"] * 3
        assert all(one.paired.same_runs for one in gated.gated)
        for metric in metrics:
            assert str(gate_run(str(run), base, metric, limit).status) == "ok"


def test_rows_that_only_look_the_same_are_not(tmp_path):
    """Other seeds that happen to give the same values tell as little as they are."""
    for seed in (1, 2, None):
        held = conditions(seed=seed)
        rows = [row(held, "x", 3, t, n=t) for t in range(2)]
        write_imported(tmp_path / str(seed), rows, {}, held)
    write_baseline(str(tmp_path / "1"), tmp_path / "base.json", ("time_s",))
    status = {
        seed: str(gate_run(str(tmp_path / seed), tmp_path / "base.json").status)
        for seed in ("1", "2", "None")
    }
    assert status == {"1": "ok", "2": "inconclusive", "None": "ok"}


def test_planners_of_one_name_never_become_one(tmp_path):
    """Runs in folders of one name, of one planner's name, in other worlds."""
    first = drive(tmp_path / "x" / "run", worlds=(0, 1), planners=("a",))
    second = drive(tmp_path / "y" / "run", worlds=(2, 3), planners=("a",))
    found = join_runs([first, second])
    assert list(found["planner"].unique()) == ["a (x/run)", "a (y/run)"]
    with pytest.raises(HlsdError, match="given twice"):
        join_runs([first, first / "episodes.csv"])
    with pytest.raises(HlsdError, match="given twice"):
        join_runs([first, tmp_path / "y" / ".." / "x" / "run"])


def test_a_planner_called_as_another_is_shown_is_refused(tmp_path):
    first = drive(tmp_path / "one", planners=("a", "a (two)"))
    second = drive(tmp_path / "two", planners=("a",))
    with pytest.raises(HlsdError, match=r"shown as 'a \(two\)'"):
        join_runs([first, second])


def test_planners_of_one_name_and_other_policies_are_told_apart(
    tmp_path, monkeypatch, capsys
):
    runs = [
        drive(tmp_path / name, planners=("a",), policy_sha256=(digest,))
        for name, digest in (("old", "1" * 64), ("new", "2" * 64))
    ]
    code, out, _ = hlsd(monkeypatch, capsys, "compare", *runs)
    assert code == 0
    assert "A and B are both called a, but differ in their policy." in out
    code, out, _ = hlsd(monkeypatch, capsys, "compare", runs[0], runs[0])
    assert "both called" not in out
    held = compare_runs(*map(str, runs)).as_json()
    assert held["a"]["digests"] == {"policy": "1" * 64}


def test_a_baseline_of_another_robot_of_that_name_is_refused(tmp_path):
    for name in ("1", "2"):
        drive(tmp_path / name, conditions(robot_sha256=name * 64), planners=("a",))
    write_baseline(str(tmp_path / "1"), tmp_path / "base.json")
    with pytest.raises(HlsdError, match="robot sha256"):
        gate_run(str(tmp_path / "2"), tmp_path / "base.json")


# ----------------------------------------------------------------- validate's courses


def test_a_run_is_no_reference(whole, tmp_path):
    for against in (whole, whole / EPISODES):
        text = refused(lambda against=against: validate_run(whole, against, "a"))
        assert "`hlsd compare`" in text


def test_an_out_txt_is_of_the_challenges_course_alone(whole, tmp_path):
    out = tmp_path / "out.txt"
    out.write_text("0 1 0 0 12.0 0.25\n3 1 0 0 12.0 0.25\n5 1 0 0 12.0 0.25\n")
    text = refused(lambda: validate_run(whole, out, "a"))
    assert "driven under hlsd2021" in text


def test_an_out_txt_of_other_worlds_or_rules_is_said(tmp_path, monkeypatch, capsys):
    """10.5 m: 5.25 s at best, so 42 s score 1/8 and have AT/OT 8."""
    run = drive(tmp_path / "run", conditions(BARN2022), planners=("a",))
    out = tmp_path / "out.txt"
    for metric, doubts in (("0.125", 0), ("8.0", 0), ("0.25", 1), ("7.0", 1)):
        lines = [f"{w} 1 0 0 42.0 {metric}\n" for w in WORLDS]
        out.write_text("".join([*lines, "0 0 1 0 3.0 0.0\n"]))
        found = validate_run(run, out)
        assert len(found.doubts) == doubts, metric
        assert len(found.as_json()["doubts"]) == doubts
    _, text, _ = hlsd(monkeypatch, capsys, "validate", run, "--against", out)
    assert "line 1: 7" in text
    assert "of another protocol or of other worlds" in text


def test_what_a_reference_does_not_say_is_said(whole, tmp_path, monkeypatch, capsys):
    reference = tmp_path / "trials.csv"
    reference.write_text(HEAD + "".join(f"{w},x,0,12.5\n" for w in WORLDS))
    command = ("validate", whole, "--planner", "a", "--against", reference)
    _, text, _ = hlsd(monkeypatch, capsys, *command)
    assert "that it is barn300 under hlsd2021, as the run, is your word" in text
