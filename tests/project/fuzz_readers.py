"""Every reader of foreign files, with good files to damage: one entry each.

A reader is added by a function that takes the path of a file, reads it and uses what it
read, under `reads` with the file's name and what writes good ones.
"""

import csv
import io
import json
import shutil
import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from hlsd.analysis.reference import load_reference
from hlsd.analysis.trial_files import read_out_txt
from hlsd.core.reading import read_json, read_toml
from hlsd.data import barn, course
from hlsd.data.arena import SHAPES, ArenaMap, arena_text, fault
from hlsd.data.barn import FILLS, BarnMap, MapRecipe, generate
from hlsd.data.barn_files import infer_grid, read_grid, read_path
from hlsd.data.dynabarn import walls
from hlsd.data.dynabarn_files import read_dynabarn_world
from hlsd.data.motion_log import MotionLog
from hlsd.data.plugin_keys import read_plugin
from hlsd.data.shapes import Mover
from hlsd.data.suite_files import (
    Header,
    TextFolder,
    open_text_folder,
    read_seed_table,
    read_suite_list,
    read_world_text,
    world_text,
)
from hlsd.data.tracks import Track
from hlsd.data.world_files import read_world
from hlsd.learning.checkpoints.file import Checkpoint
from hlsd.sim.robot_log import load_robot_log
from hlsd.sim.validation import recorded_velocities, steady_gains, window_errors
from tests.data.mover_plugins import compile_plugin, keys_code
from tests.data.small_course import small_course


@dataclass(frozen=True, slots=True)
class Reader:
    """A reader under test.

    Attributes:
        name: What it reads.
        file: Name of the file, in a folder of its own.
        good: Writes good files' bytes.
        read: Reads the file and uses what it holds.
        beside: Makes the other files of its folder, by name.
        needed: Whether it refuses a folder without the file.
        writes: Whether it may write, in the file's folder only.
    """

    name: str
    file: str
    good: Callable[[], Iterator[bytes]]
    read: Callable[[Path], object]
    beside: Callable[[], Mapping[str, bytes]] = dict
    needed: bool = True
    writes: bool = False


READERS: list[Reader] = []


def reads(
    name: str,
    file: str,
    good: Callable[[], Iterator[bytes]],
    beside: Callable[[], Mapping[str, bytes]] = dict,
    needed: bool = True,
    writes: bool = False,
) -> Callable[[Callable[[Path], object]], Callable[[Path], object]]:
    """Add the reader that follows; see `Reader`."""

    def add(read: Callable[[Path], object]) -> Callable[[Path], object]:
        READERS.append(Reader(name, file, good, read, beside, needed, writes))
        return read

    return add


# --- good files ---------------------------------------------------------------------


def _world() -> BarnMap:
    """One with few cylinders."""
    made = (generate(MapRecipe(seed, FILLS[0], 4)) for seed in range(40))
    kept = [barn_map for barn_map in made if barn_map is not None]
    return min(kept, key=lambda barn_map: int(barn_map.grid.sum()))


_WORLD = _world()


def npz(**arrays: object) -> bytes:
    target = io.BytesIO()
    np.savez(target, **arrays)
    return target.getvalue()


def _npy(array: np.ndarray) -> bytes:
    target = io.BytesIO()
    np.save(target, array)
    return target.getvalue()


def _drive() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, poses and commands of a drive on a circle."""
    t = np.arange(60) * 0.05
    commands = np.tile([0.5, 0.4], (60, 1))
    yaw = 0.4 * t
    radius = 0.5 / 0.4
    poses = np.column_stack([radius * np.sin(yaw), radius * (1 - np.cos(yaw)), yaw])
    return t, poses, commands


def motion_logs() -> Iterator[bytes]:
    _, poses, commands = _drive()
    yield npz(
        format=1,
        period_s=0.05,
        poses=poses,
        commands=commands,
        points=30,
        robot="jackal",
        robot_version="1",
        recipe=json.dumps({"preset": "1.0", "seed": 0}),
    )


def robot_npz() -> Iterator[bytes]:
    t, poses, commands = _drive()
    yield from motion_logs()
    half = poses[:, 2] / 2
    zero = np.zeros(len(t))
    yield npz(
        pos=poses,
        ori=np.column_stack([zero, zero, np.sin(half), np.cos(half)]),
        cmd_vel=commands[:, 0].astype(np.float32),
        cmd_ang_vel=commands[:, 1],
        t=t,
        rate_hz=20,
    )


def robot_csv() -> Iterator[bytes]:
    t, poses, commands = _drive()
    rows = np.column_stack([t, poses, commands])
    lines = "".join(",".join(f"{v:.4f}" for v in row) + "\n" for row in rows)
    yield f"t,x,y,yaw,v_cmd,omega_cmd\n{lines}".encode()


def grids() -> Iterator[bytes]:
    yield _npy(_WORLD.grid.astype(np.int64))


def paths() -> Iterator[bytes]:
    yield _npy(_WORLD.path)


def gazebo_worlds() -> Iterator[bytes]:
    models = "".join(
        f"<model name='unit_cylinder_{k}'><static>1</static>\n"
        f"<pose>{x:.6f} {y:.6f} 0 0 -0 0</pose><link name='link'>"
        "<collision name='c'><geometry><cylinder><radius>0.075</radius>"
        "<length>1</length></cylinder></geometry></collision></link></model>\n"
        for k, (x, y) in enumerate(barn.cylinders_xy(_WORLD.grid).tolist())
    )
    yield (
        "<?xml version='1.0'?><sdf version='1.6'><world name='default'>"
        "<include><uri>model://sun</uri></include>\n<model name='ground_plane'>"
        "<static>1</static><link name='l'><collision name='c'><geometry><plane>"
        "<normal>0 0 1</normal></plane></geometry></collision><sensor name='s' "
        "type='contact'><contact><collision>c</collision></contact></sensor></link>"
        f"</model>\n{models}</world></sdf>\n"
    ).encode()


def world_texts() -> Iterator[bytes]:
    yield world_text(_WORLD, "seed 1, fill 0.20, smoothing 4").encode()


def course_texts() -> Iterator[bytes]:
    yield world_text(small_course(), "by hand").encode()


def suite_headers() -> Iterator[bytes]:
    yield b'format = 1\nversion = "1"\nsource = "s"\nlayout = "course"\nworlds = 1\n'
    yield b'format = 1\nversion = "1"\nsource = "made here"\nworlds = 1\n'


def suite_lists() -> Iterator[bytes]:
    first = b'[barn300]\nversion = "1"\nseeds = "b.csv"\nsource = "s"\n'
    yield first + b'[x]\nversion = "2"\nseeds = "x.csv"\nsource = "t"\n'


def seed_tables() -> Iterator[bytes]:
    digests = f"{_WORLD.grid_sha256()},{_WORLD.path_sha256()}"
    yield (
        "world,seed,fill,smoothing,grid_sha256,path_sha256\n"
        f"0,482165344995270980,0.15,3,{digests}\n7,5,0.30,4,{digests}\n"
    ).encode()
    yield f"world,seed,grid_sha256,path_sha256\n0,5,{digests}\n".encode()


def shapes_texts() -> Iterator[bytes]:
    track = Track(np.array([(0.0, -3.0, 0.1), (2.5, 3.0, 0.1), (6.0, 0.0, 4.0)]))
    movers = (Mover(track, radius_m=0.3), Mover(track, half_size_m=(0.4, 0.2)))
    made = ArenaMap((1.0, 2.0, 0.5), (9.0, -1.0), walls(), movers)
    yield arena_text(made, "by hand").encode()


def dynabarn_worlds() -> Iterator[bytes]:
    models = "".join(
        f"<model name='o_{k}'><static>1</static><pose frame=>0 {k} .5 0 0 0</pose>\n"
        f"<link name='l'><collision name='c'><geometry>{shape}</geometry></collision>"
        f"</link>{plugin}</model>\n"
        for k, (shape, plugin) in enumerate(
            (
                ("<box><size>.5 20 1</size></box>", ""),
                (_CYLINDER, "<plugin name='o' filename='o_1.so'/>"),
                (_CYLINDER, ""),
            )
        )
    )
    yield f"<sdf version='1.6'><world name='w'>{models}</world></sdf>".encode()


_CYLINDER = "<cylinder><radius>0.5</radius><length> 1 </length></cylinder>"


def plugins() -> Iterator[bytes]:
    keys = [(0.0, 10.0, -6.0), (6.29, 7.78, 0.0), (12.57, -10.0, 0.01)]
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "o.so"
        compile_plugin(file, keys_code(keys), "12.57", options=("-O0", "-s"))
        yield file.read_bytes()


def out_txts() -> Iterator[bytes]:
    yield b"108 1 0 0 22.2800 4.1806\n72 0 1 0 5.0 0.0\n6 0 0 1 100.07 0\n"
    yield b"293 1 0 0 12.7580 8.1166 0.5000\n286 0 1 0 6.9270 8.9715 0.0000\n"


def trials_csvs() -> Iterator[bytes]:
    yield b"world,planner,trial,time_s\n0,a,0,12.5\n0,a,1,30.000000\n1,a,0,50.007\n"
    yield b"world,planner,trial,time_s,status\n0,a,0,12.5,flip\n1,a,0,9,succeeded\n"


def jsons() -> Iterator[bytes]:
    yield json.dumps({"a": [1, 2.5, "é", None, {"b": True}], "seed": 0}).encode()


def tomls() -> Iterator[bytes]:
    yield b'a = 1\nb = "x"\n[c.d]\ne = [1, 2.5, {f = true}]\ng = 2020-01-01\n'


# --- readers -------------------------------------------------------------------------


@reads("motion log", "log.npz", motion_logs)
def _(path: Path) -> None:
    log = MotionLog.load(path)
    assert len(log.sha256()) == 64
    assert np.isfinite(log.poses).all()


def checkpoints() -> Iterator[bytes]:
    tensors = {"fc.weight": np.ones((2, 3), np.float32), "b": np.zeros(2, np.float32)}
    yield Checkpoint("td3", tensors, '{"source": "x"}').as_bytes()


@reads("converted checkpoint", "x.npz", checkpoints)
def _(path: Path) -> None:
    held = Checkpoint.load(path, "td3")
    held.said()
    assert all(np.isfinite(tensor).all() for tensor in held.tensors.values())


def _robot_log(path: Path) -> None:
    log = load_robot_log(path)
    assert len(log.poses) * log.period_s < 1000
    window_errors(log.poses, log)
    steady_gains(recorded_velocities(log), log)


reads("robot log (npz)", "log.npz", robot_npz)(_robot_log)
reads("robot log (csv)", "log.csv", robot_csv)(_robot_log)


@reads("BARN grid", "grid_0.npy", grids)
def _(path: Path) -> None:
    assert infer_grid(barn.placed(read_grid(path))).shape == (30, 30)


@reads("BARN path", "path_0.npy", paths)
def _(path: Path) -> None:
    barn.fault(BarnMap(_WORLD.grid, read_path(path)))


@reads("Gazebo world", "world_0.world", gazebo_worlds)
def _(path: Path) -> None:
    assert infer_grid(read_world(path)).shape == (30, 30)


@reads("stored world", "world_0.txt", world_texts)
def _(path: Path) -> None:
    assert barn.fault(read_world_text(path)) is None


@reads("stored course", "world_0.txt", course_texts)
def _(path: Path) -> None:
    assert course.fault(read_world_text(path, course.LAYOUT)) is None


@reads("stored world of shapes", "world_0.json", shapes_texts)
def _(path: Path) -> None:
    made = TextFolder(path.parent, Header("1", "s", SHAPES), (0,)).read(0)
    assert isinstance(made, ArenaMap)
    assert fault(made) is None
    json.dumps([made.grid_sha256(), made.path_sha256()])


@reads("DynaBARN's world", "world_0.world", dynabarn_worlds)
def _(path: Path) -> None:
    shapes, movers = read_dynabarn_world(path)
    shapes.bounds()
    assert all("/" not in mover.plugin and mover.radius_m > 0 for mover in movers)


if shutil.which("g++") is not None:

    @reads("DynaBARN's plug-in", "o_1.so", plugins)
    def _(path: Path) -> None:
        pytest.importorskip("capstone", reason="needs the extra dynabarn")
        pytest.importorskip("elftools", reason="needs the extra dynabarn")
        assert read_plugin(path).length_s >= 0.0


@reads("suite header", "suite.toml", suite_headers, lambda: {"world_0.txt": b""})
def _(path: Path) -> None:
    header = open_text_folder(path.parent).header
    assert (header.version + header.source).isprintable()


@reads("list of suites", "suites.toml", suite_lists)
def _(path: Path) -> None:
    for entry in read_suite_list(path).values():
        assert "/" not in entry["seeds"]


@reads("table of seeds", "seeds.csv", seed_tables)
def _(path: Path) -> None:
    table = read_seed_table(path)
    for index in table.indices:
        assert index < 1e9
        assert table.recipes[index].seed >= 0
        if table.layout == barn.LAYOUT:
            assert table.recipes[index].smoothing < 100


@reads("out.txt", "out.txt", out_txts)
def _(path: Path) -> None:
    assert all(run.time_s >= 0 for run in read_out_txt(path))
    load_reference(path, 50.0)


@reads("trials (csv)", "trials.csv", trials_csvs)
def _(path: Path) -> None:
    held = load_reference(path, 50.0)
    assert np.isfinite(held.trials.times_s).all()
    csv.writer(io.StringIO()).writerow([held.name])


@reads("JSON", "a.json", jsons)
def _(path: Path) -> None:
    json.dumps(read_json(path, "record"), allow_nan=False).encode()


@reads("TOML", "a.toml", tomls)
def _(path: Path) -> None:
    repr(read_toml(path, "record")).encode()
