"""Readers of what runs leave: finished and unfinished folders, baselines, policies."""

import json
import tempfile
from collections.abc import Callable, Iterator, Mapping
from functools import cache
from pathlib import Path

import numpy as np

from hlsd.analysis.baseline import baseline_text, load_baseline
from hlsd.analysis.gate import DEFAULT_METRICS, gate
from hlsd.analysis.metrics import METRICS
from hlsd.analysis.runs import (
    Run,
    load_run,
    planner_digests,
    planning_times,
    protocol_of,
)
from hlsd.analysis.sides import load_side
from hlsd.core.errors import HlsdError
from hlsd.learning.policy import Policy, require_trained_for
from hlsd.run import journal
from hlsd.run.bench import resolve
from hlsd.run.conditions import Conditions
from hlsd.run.folder import RunFolder, write_imported
from hlsd.run.identity import RunConfig
from hlsd.run.journal import JOURNAL
from hlsd.run.protocol import get_protocol
from hlsd.run.row import Row
from hlsd.run.seal import SEAL
from hlsd.run.trajectory import ARCHIVE, Key, decode, read_archive, read_trajectories
from tests.project.fuzz_readers import npz, reads
from tests.run.saboteur import SETTINGS, bench

Files = dict[str, bytes]


# --- good files ---------------------------------------------------------------------


def _files(folder: Path) -> Files:
    return {
        path.relative_to(folder).as_posix(): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


@cache
def _driven() -> tuple[Files, Files, RunConfig, Mapping[Key, Row]]:
    """A finished run's files; the same run's unfinished, what it is, its rows."""
    config = resolve(SETTINGS)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        bench(folder / "run")
        found = load_run(folder / "run").episodes
        assert len(found) == 4
        blocks = dict(read_archive(folder / "run" / ARCHIVE))
        rows = {}
        with RunFolder(folder / "unfinished", config, {}) as held:
            for key, block in blocks.items():
                rows[key] = dict.fromkeys(held._columns, "1") | {
                    "planner": key[0],
                    "world": str(key[1]),
                    "trial": str(key[2]),
                }
                held.append([rows[key]], {key: block}, {key: "Traceback: why"})
        return _files(folder / "run"), _files(folder / "unfinished"), config, rows


@cache
def _imported() -> Files:
    """Successes and failures in ten worlds."""
    rows = [
        {
            "suite": "barn300",
            "suite_version": "1",
            "world": str(world),
            "planner": "theirs",
            "trial": str(trial),
            "protocol": "barn2022",
            "outcome": "collision" if world == 3 else "success",
            "time_s": f"{12 + world + 0.25 * trial:.4f}",
            "official_length_m": "10.5",
            "path_length_m": "11.25",
            "shortest_length_m": "10.1",
            "contacts": "1",
            "ticks": "100",
            "turn_ticks": "7",
        }
        for world in range(10)
        for trial in range(2)
    ]
    protocol = get_protocol("barn2022")
    conditions = Conditions("barn300", "1", "", protocol, "", "", None)
    with tempfile.TemporaryDirectory() as name:
        write_imported(Path(name) / "run", rows, {"file": "out.txt"}, conditions)
        return _files(Path(name) / "run")


def _one(make: Callable[[], Files], name: str) -> Callable[[], Iterator[bytes]]:
    return lambda: iter([make()[name]])


def _others(make: Callable[[], Files], *without: str) -> Callable[[], Files]:
    """The other files of a folder."""
    return lambda: {k: data for k, data in make().items() if k not in without}


def _finished() -> Files:
    return _driven()[0]


def _unfinished() -> Files:
    return _driven()[1]


def policies() -> Iterator[bytes]:
    rng = np.random.default_rng(0)
    beams = 30
    sizes = (beams + 2, 4, 2)
    layers: dict[str, object] = {}
    for k in range(2):
        layers[f"weight_{k}"] = rng.normal(size=sizes[k : k + 2]).astype(np.float32)
        layers[f"bias_{k}"] = np.zeros(sizes[k + 1], dtype=np.float32)
    said = {
        "planner": "hlsd10",
        "hallucination": {
            "kind": "minimal",
            "clip_m": 1.0,
            "passes": 2,
            "lidar": {"beams": beams, "mount_in_base": [0.1, 0.0, 0.0]},
        },
        "loss_curve": [1.5, 0.5],
    }
    for provenance in ({}, said):
        yield npz(
            format=1,
            layers=2,
            clip_m=1.0,
            goal_bearing_rad=3.0,
            provenance=json.dumps(provenance),
            **layers,
        )


def baselines() -> Iterator[bytes]:
    """The format that is written, and the two before it, which have no digest."""
    with tempfile.TemporaryDirectory() as name:
        for file, data in _imported().items():
            (Path(name) / file).write_bytes(data)
        whole = baseline_text(load_side(name, DEFAULT_METRICS)).encode()
    held = json.loads(whole)
    conditions = held["conditions"]
    held |= {"format": "hlsd baseline 2"}
    for name in ("digests", "sha256"):
        del held[name]
    second = json.dumps(held).encode()
    first = {key: held[key] for key in ("planner", "metrics", "runs")} | {
        "format": "hlsd baseline 1",
        "protocol": conditions["protocol"]["name"],
        "suite": conditions["suite"]["name"],
        "suite_version": conditions["suite"]["version"],
        "suite_digest": conditions["suite"]["digest"],
        "robot": conditions["robot"]["name"],
        "robot_version": conditions["robot"]["version"],
        "seed": conditions["seed"],
    }
    yield whole
    yield second
    yield second
    yield json.dumps(first).encode()


# --- readers ------------------------------------------------------------------------


@reads("policy", "policy.npz", policies)
def _(path: Path) -> None:
    policy = Policy.load(path)
    assert len(policy.planner()) <= 40
    assert policy.weights[0].shape[0] == policy.inputs == policy.lidar.beams + 2
    assert np.isfinite(policy.forward(np.ones(policy.inputs, np.float32))).all()
    require_trained_for(path, "hlsd10") if policy.planner() == "hlsd10" else None


@reads("baseline", "baseline.json", baselines)
def _(path: Path) -> None:
    side = load_baseline(path)
    assert all(not np.isinf(values).any() for values in side.values.values())
    json.dumps(side.conditions.as_json(), allow_nan=False)
    gate(side, side, dict.fromkeys(side.values))


def _run(path: Path) -> Run:
    """A run, as its folder says."""
    run = load_run(path.parent)
    assert np.isfinite(run.episodes["time_s"]).all()
    assert str(len(run.episodes)) in repr(run)
    return run


def _rows(path: Path) -> None:
    """And what is measured in its rows."""
    run = _run(path)
    for metric in METRICS.values():
        if metric.defined(protocol_of(run.episodes)):
            assert not np.isinf(metric.of_runs(run.episodes)).any()


def _rules(path: Path) -> None:
    """And what follows from its record."""
    run = _run(path)
    if not run.episodes.empty:
        run.summary()
        planner_digests(run.path, run.planners[0])


for _make, _what in ((_finished, "a run"), (_imported, "an imported run")):
    for _file in ("episodes.csv", "timing.csv", "run.json"):
        if _make is _finished or _file != "timing.csv":
            reads(
                f"{_file} of {_what}",
                _file,
                _one(_make, _file),
                beside=_others(_make, _file, SEAL),
                needed=_file == "episodes.csv",
            )(_rules if _file == "run.json" else _rows)


@reads(
    "times of a run",
    "timing.csv",
    _one(_finished, "timing.csv"),
    beside=_others(_finished, "timing.csv", "episodes.csv", SEAL),
)
def _(path: Path) -> None:
    assert (planning_times(path.parent)["world"] >= 0).all()


@reads("list of digests", SEAL, _one(_finished, SEAL), _others(_finished, SEAL), False)
def _(path: Path) -> None:
    _run(path)
    planning_times(path.parent)


@reads(
    "episodes.csv with its digest",
    "episodes.csv",
    _one(_finished, "episodes.csv"),
    beside=_others(_finished, "episodes.csv"),
)
def _(path: Path) -> None:
    _run(path)
    assert path.read_bytes() == _finished()["episodes.csv"], "a changed table is read"


@reads("trajectories", ARCHIVE, _one(_finished, ARCHIVE), needed=False)
def _(path: Path) -> None:
    refused = []
    for block in read_trajectories(path.parent).values():
        try:
            found = decode(block)
        except HlsdError as error:
            refused.append(error)
            continue
        assert len(found.poses) == len(found.commands) + 1 == len(found.modes) + 1
        assert np.isfinite(found.poses).all()
        assert all(tick >= 0 and len(points) >= 0 for tick, points in found.paths)
    if refused:
        raise refused[0]


def _resumed(folder: Path, *, finish: bool) -> dict[Key, Row]:
    """Rows that the run in a folder would not drive again."""
    _, _, config, rows = _driven()
    with RunFolder(folder, config, {}) as held:
        found = dict(held.finished)
        assert found.keys() <= rows.keys()
        if finish:
            held.finish(config.planners)
    return found


def _goes_on(path: Path) -> None:
    """Each row is the one that was written, or is driven again."""
    rows = _driven()[3]
    found = _resumed(path.parent, finish=False)
    assert all(found[key] == rows[key] for key in found)


for _file in (JOURNAL, "run.json"):
    reads(
        f"{_file} of an unfinished run",
        _file,
        _one(_unfinished, _file),
        beside=_others(_unfinished, _file),
        needed=False,
        writes=True,
    )(_goes_on)


@reads(
    "piece of trajectories",
    "trajectories/0.zip",
    _one(_unfinished, "trajectories/0.zip"),
    beside=_others(_unfinished, "trajectories/0.zip"),
    needed=False,
    writes=True,
)
def _(path: Path) -> None:
    found = _resumed(path.parents[1], finish=True)
    assert all(found[key] == row for key, row in _driven()[3].items() if key[1] == 150)


@reads(
    "journal with its sums right",
    JOURNAL,
    _one(_unfinished, JOURNAL),
    beside=_others(_unfinished, JOURNAL),
    needed=False,
    writes=True,
)
def _(path: Path) -> None:
    if path.is_file():
        run = _driven()[2].sha256()
        start = journal._CHECK + 1
        texts = [line[start:] for line in path.read_bytes().split(b"\n")]
        sums = [journal._checksum(text, run) for text in texts]
        lines = [b"%s %s\n" % pair for pair in zip(sums, texts, strict=True)]
        path.write_bytes(b"".join(lines))
    for row in _resumed(path.parent, finish=True).values():
        assert all(isinstance(text, str) for text in row.values())
