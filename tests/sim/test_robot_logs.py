"""Recordings in other units, orders and clocks: read rightly, or told what is wrong."""

import numpy as np
import pytest

from hlsd.core.errors import HlsdError
from hlsd.data.motion_log import MotionLog
from hlsd.sim.robot_log import load_robot_log
from tests.conftest import shared

COLUMNS = ("t", "x", "y", "yaw", "v_cmd", "omega_cmd")


@pytest.fixture
def drive():
    """Columns of a drive of 8 s at 50 Hz: straight, then left, then right."""
    t = np.arange(400) * 0.02
    v = np.full(400, 0.5)
    w = np.where(t < 2, 0.0, np.where(t < 5, 0.6, -0.4))
    yaw = np.concatenate([[0.0], np.cumsum(w * 0.02)[:-1]]) + 2.0
    middle = yaw + w * 0.01
    x = np.concatenate([[0.0], np.cumsum(0.01 * np.cos(middle))[:-1]])
    y = np.concatenate([[0.0], np.cumsum(0.01 * np.sin(middle))[:-1]])
    return dict(zip(COLUMNS, (t, x, y, yaw, v, w), strict=True))


def csv_of(path, drive, mark="", end="\n"):
    rows = np.column_stack(list(drive.values())).tolist()
    lines = [",".join(drive), *(",".join(map(repr, row)) for row in rows)]
    path.write_bytes((mark + end.join(lines) + end).encode())
    return path


def npz_of(path, drive, order="xyzw", **changes):
    half = drive["yaw"] / 2
    zero = np.zeros_like(half)
    parts = {"x": zero, "y": zero, "z": np.sin(half), "w": np.cos(half)}
    arrays = {
        "pos": np.column_stack([drive["x"], drive["y"]]),
        "ori": np.column_stack([parts[letter] for letter in order]),
        "cmd_vel": drive["v_cmd"],
        "cmd_ang_vel": drive["omega_cmd"],
        "t": drive["t"],
    } | changes
    np.savez(path, **{k: v for k, v in arrays.items() if v is not None})
    return path


def refusal(path) -> str:
    with pytest.raises(HlsdError) as caught:
        load_robot_log(path)
    text = str(caught.value)
    assert text.isprintable()
    assert str(path) in text
    return text


def test_marks_line_ends_and_epochs_make_no_difference(drive, tmp_path):
    plain = load_robot_log(csv_of(tmp_path / "a.csv", drive))
    later = drive | {"t": drive["t"] + 1748980672.0}
    for other in (
        csv_of(tmp_path / "b.csv", drive, mark="\ufeff"),
        csv_of(tmp_path / "c.csv", drive, end="\r\n"),
        csv_of(tmp_path / "d.csv", later),
        npz_of(tmp_path / "e.npz", drive),
        csv_of(tmp_path / "f.csv", drive | {"note": drive["t"]}),
    ):
        log = load_robot_log(other)
        assert log.period_s == plain.period_s == 0.02
        np.testing.assert_allclose(log.poses[:, :2], plain.poses[:, :2])
        np.testing.assert_array_equal(log.commands, plain.commands)


@pytest.mark.parametrize(
    ("factor", "says"),
    [
        (1e9, "nanoseconds"),
        (1e6, "microseconds"),
        (1e3, "milliseconds"),
        (150.0, "samples are 3 s apart, which look like milliseconds: wanted"),
        (0.01, "samples are 0.0002 s apart: wanted"),
    ],
)
def test_times_in_other_units_are_told(drive, tmp_path, factor, says):
    other = drive | {"t": drive["t"] * factor}
    assert says in refusal(csv_of(tmp_path / "a.csv", other))
    assert says in refusal(npz_of(tmp_path / "a.npz", other))
    rate = npz_of(tmp_path / "b.npz", drive, t=None, rate_hz=50.0 / factor)
    assert says in refusal(rate)


def column(drive, name, change):
    return drive | {name: change(drive[name])}


@pytest.mark.parametrize(
    ("name", "change", "says"),
    [
        ("yaw", np.degrees, "yaw"),
        ("yaw", np.negative, "as commanded: wanted"),
        ("yaw", lambda v: v + np.pi / 2, "does not move along its yaw"),
        ("yaw", lambda v: v + np.pi, "does not move along its yaw"),
        ("omega_cmd", np.negative, "does not turn as commanded"),
        ("omega_cmd", np.degrees, "yaw rate of sample 100 is 34.3"),
        ("v_cmd", np.negative, "does not move along its yaw as commanded"),
        ("v_cmd", lambda v: v * 100, "commanded speed of sample 0 is 50"),
        ("v_cmd", lambda v: v * 10, "moves 0.1 times as much"),
        ("v_cmd", lambda v: v * 0 + np.nan, "row 2 is"),
        ("x", lambda v: v + (np.arange(400) > 200) * 3.0, "position jumps 2.99"),
        ("yaw", lambda v: v + (np.arange(400) > 200) * 2.0, "its yaw jumps 2.01"),
        ("x", lambda v: v + 1e300, "x of sample 0 is 1e+300"),
        ("t", lambda v: np.where(np.arange(400) == 7, 0.0, v), "sample 7 does not"),
        ("t", lambda v: v + (np.arange(400) > 200) * 0.7, "0.720 s are missing bef"),
        ("t", lambda v: v * 1e300, "beyond 1e+20"),
    ],
)
def test_other_units_and_frames_are_told(drive, tmp_path, name, change, says):
    assert says in refusal(csv_of(tmp_path / "a.csv", column(drive, name, change)))


@pytest.mark.parametrize("factor", [100.0, 1000.0, 0.01])
def test_positions_in_other_units_are_told(drive, tmp_path, factor):
    other = drive | {name: drive[name] * factor for name in "xy"}
    said = refusal(csv_of(tmp_path / "a.csv", other))
    assert "times as much as its commands say" in said or "position jumps" in said


def test_commands_of_nothing_compare_with_nothing(drive, tmp_path):
    other = drive | {"v_cmd": drive["t"] * 0, "omega_cmd": drive["t"] * 0}
    assert "leave the robot where it stands" in refusal(
        csv_of(tmp_path / "a.csv", other)
    )


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"order": "wxyz"}, "they look like w, x, y, z"),
        ({"ori": np.full((400, 4), 0.3)}, "has norm 0.6, not 1"),
        ({"ori": np.zeros((400, 4))}, "has norm 0, not 1"),
        ({"ori": np.full((400, 4), 1e300)}, "has norm 4, not 1"),
        ({"ori": np.tile([1.0, 0, 0, 0], (400, 1))}, "tilts the robot by 180 degrees"),
        ({"ori": np.zeros((400, 3))}, "ori has shape (400, 3), needed is (T, 4)"),
        ({"pos": np.zeros((400, 4))}, "pos has shape (400, 4)"),
        ({"cmd_vel": np.zeros((400, 6))}, "cmd_vel has shape (400, 6)"),
        ({"t": np.zeros(3)}, "t has 3"),
        ({"cmd_vel": np.full(400, np.nan)}, "sample 0 is not finite"),
        ({"t": None, "rate_hz": 0}, "rate_hz is 0"),
        ({"t": None, "rate_hz": np.nan}, "rate_hz is nan"),
        ({"t": None, "rate_hz": np.ones(2)}, "needed is a single value"),
        ({"cmd_vel": np.full(400, 1j)}, "plain numbers"),
    ],
)
def test_quaternions_and_shapes_are_checked(drive, tmp_path, changes, says):
    assert says in refusal(npz_of(tmp_path / "a.npz", drive, **changes))


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("omega_cmd", "v_cmd", "lacks the columns omega_cmd"),
        ("t,x", "x,t,x", "two columns x"),
        (",", ";", "lacks the columns"),
        ("0.5", "0_5", "row 2"),
        ("0.5", "0,5", "row 2"),
        ("0.5", "", "row 2"),
        ("0.5", '"0.5', "none of a CSV"),
    ],
)
def test_a_line_that_is_none_is_named(drive, tmp_path, old, new, says):
    path = csv_of(tmp_path / "a.csv", drive)
    count = -1 if old == "," else 1
    path.write_text(path.read_text().replace(old, new, count))
    assert says in refusal(path)


def test_the_recordings_at_hand():
    assert load_robot_log(shared("jackal_log", "openspace_1m.npz")).period_s == 0.02
    held = [shared("cases", "robot-logs", f"{name}.csv") for name in ("sec", "bom")]
    first, second = map(load_robot_log, held)
    np.testing.assert_array_equal(first.poses, second.poses)
    assert "nanoseconds" in refusal(shared("cases", "robot-logs", "ns.csv"))


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"period_s": 20.0}, "milliseconds"),
        ({"commands": np.full((400, 2), 50.0)}, "commanded speed"),
        ({"poses": np.arange(1200.0).reshape(400, 3)}, "position jumps"),
        ({"recipe": "[" * 9999}, "nests deeper"),
        ({"recipe": "[]"}, "not a JSON object"),
        ({"commands": np.tile([-0.5, 0.0], (400, 1))}, "does not move along"),
    ],
)
def test_motion_logs_for_training_are_checked_likewise(drive, tmp_path, changes, says):
    arrays = [drive[name] for name in COLUMNS]
    values = {
        "period_s": 0.02,
        "poses": np.column_stack(arrays[1:4]),
        "commands": np.column_stack(arrays[4:]),
        "robot": "jackal",
        "robot_version": "1",
        "recipe": "{}",
        "points": 100,
    }
    MotionLog(**values).save(tmp_path / "good.npz")
    assert MotionLog.load(tmp_path / "good.npz").points == 100
    path = tmp_path / "bad.npz"
    MotionLog(**(values | changes)).save(path)
    with pytest.raises(HlsdError) as caught:
        MotionLog.load(path)
    assert says in str(caught.value)
    assert str(caught.value).isprintable()
