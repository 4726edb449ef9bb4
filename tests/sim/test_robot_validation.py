"""Reading recordings, comparing with them, and the command that does it."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from hlsd.cli.robots import app
from hlsd.core.errors import HlsdError
from hlsd.sim.robot_log import RobotLog, load_robot_log
from hlsd.sim.robots import ROBOTS, get_robot
from hlsd.sim.validation import (
    replay,
    steady_gains,
    validate_robot,
    window_errors,
)

PERIOD_S = 0.02


@pytest.fixture(scope="module")
def drive() -> RobotLog:
    """A recording of `jackal-ideal` itself, 9 s, some of it steady."""
    commands = np.repeat(
        [[0.5, 0.0], [0.8, 0.5], [0.4, -0.7], [1.0, 0.3], [0.6, 0.0], [0.3, 0.9]],
        75,
        axis=0,
    )
    empty = RobotLog(PERIOD_S, np.zeros((len(commands), 3)), commands)
    poses, _ = replay(get_robot("jackal-ideal"), empty)
    return RobotLog(PERIOD_S, poses, commands)


def write_npz(path, drive, **changes):
    half = drive.poses[:, 2] / 2
    zero = np.zeros_like(half)
    arrays = {
        "pos": np.column_stack([drive.poses[:, :2], zero + 0.0635]),
        "ori": np.column_stack([zero, zero, np.sin(half), np.cos(half)]),
        "cmd_vel": drive.commands[:, 0],
        "cmd_ang_vel": drive.commands[:, 1],
    } | changes
    np.savez(path, **{k: v for k, v in arrays.items() if v is not None})
    return path


def write_csv(path, drive, header="t,x,y,yaw,v_cmd,omega_cmd"):
    rows = np.column_stack(
        [np.arange(len(drive.poses)) * PERIOD_S, drive.poses, drive.commands]
    )
    np.savetxt(path, rows, delimiter=",", header=header, comments="", fmt="%.9f")
    return path


def test_a_robot_replays_itself(drive):
    result = validate_robot(get_robot("jackal-ideal"), drive)
    assert result.n > 50
    assert result.position_error_m.p95 < 1e-9
    assert result.heading_error_deg.p95 < 1e-6
    assert result.gains.yaw_gain == pytest.approx(result.recorded.yaw_gain, abs=1e-3)


def test_another_robot_does_not(drive):
    result = validate_robot(get_robot("jackal"), drive)
    assert result.heading_error_deg.median > 3.0
    assert result.gains.yaw_gain > 1.3 > 1.05 > result.recorded.yaw_gain


def test_window_errors_are_differences_of_motions_in_the_windows_own_frame():
    # A simulated robot that turns 0.1 rad/s more on a circle of the same speed.
    t = np.arange(300) * PERIOD_S

    def circle(w, heading):
        yaw = heading + w * t
        return np.column_stack(
            [
                (np.sin(yaw) - np.sin(heading)) / w,
                (np.cos(heading) - np.cos(yaw)) / w,
                yaw,
            ]
        )

    log = RobotLog(PERIOD_S, circle(0.4, 2.0), np.tile([1.0, 0.4], (300, 1)))
    errors = window_errors(circle(0.5, -1.0), log)
    expected = [
        np.sin(0.5) / 0.5 - np.sin(0.4) / 0.4,
        (1 - np.cos(0.5)) / 0.5 - (1 - np.cos(0.4)) / 0.4,
        0.1,
    ]
    np.testing.assert_allclose(errors, np.tile(expected, (len(errors), 1)), atol=1e-9)


def test_steady_gains_leave_transients_out():
    commands = np.repeat([[0.5, 0.4], [1.0, -0.8]], 100, axis=0)
    log = RobotLog(PERIOD_S, np.zeros((200, 3)), commands)
    turning = 1.2 * commands[:, 1]
    velocities = np.column_stack([0.9 * commands[:, 0], -0.1 * turning, turning])
    velocities[:25] = 7.0
    velocities[100:125] = 7.0
    gains = steady_gains(velocities, log)
    assert gains.speed_gain == pytest.approx(0.9)
    assert gains.yaw_gain == pytest.approx(1.2)
    assert gains.lateral_per_yaw_m == pytest.approx(-0.1)


def test_restless_driving_has_no_steady_gains():
    commands = np.random.default_rng(0).uniform(0.3, 0.9, (300, 2))
    log = RobotLog(PERIOD_S, np.zeros((300, 3)), commands)
    gains = steady_gains(np.ones((300, 3)), log)
    assert gains.speed_gain is gains.yaw_gain is gains.lateral_per_yaw_m is None


def test_all_layouts_give_the_same_log(drive, tmp_path):
    paths = [
        write_npz(tmp_path / "gazebo.npz", drive),
        write_npz(
            tmp_path / "times.npz", drive, t=5 + np.arange(len(drive.poses)) / 50
        ),
        write_csv(tmp_path / "log.csv", drive),
        tmp_path / "own.npz",
    ]
    np.savez(paths[3], poses=drive.poses, commands=drive.commands, period_s=PERIOD_S)
    for path in paths:
        log = load_robot_log(path)
        assert log.period_s == PERIOD_S
        np.testing.assert_allclose(log.poses, drive.poses, atol=1e-7)
        np.testing.assert_allclose(log.commands, drive.commands, atol=1e-7)


def test_a_motion_log_is_read(drive, tmp_path):
    from hlsd.data.motion_log import MotionLog

    log = MotionLog(
        period_s=PERIOD_S,
        poses=drive.poses,
        commands=drive.commands,
        robot="jackal-ideal",
        robot_version=ROBOTS["jackal-ideal"].version,
        recipe="{}",
        points=10,
    )
    log.save(tmp_path / "log.npz")
    np.testing.assert_array_equal(
        load_robot_log(tmp_path / "log.npz").poses, drive.poses
    )


def test_irregular_times_are_resampled(drive, tmp_path):
    # Every third sample dropped: commands are held, poses interpolated.
    keep = np.arange(len(drive.poses)) % 3 != 1
    part = RobotLog(PERIOD_S, drive.poses[keep], drive.commands[keep])
    times_s = np.arange(len(drive.poses))[keep] * PERIOD_S
    log = load_robot_log(write_npz(tmp_path / "log.npz", part, t=times_s))
    assert log.period_s == PERIOD_S
    count = len(log.poses)
    # Interpolated over 0.04 s: off by up to 1/8 x 25 rad/s^2 x 0.04^2 s^2.
    np.testing.assert_allclose(log.poses, drive.poses[:count], atol=5e-3)
    assert (log.commands == drive.commands[:count]).mean() > 0.99


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"ori": None}, "holds pos, cmd_vel, cmd_ang_vel"),
        ({"cmd_vel": np.zeros(3)}, "do not fit"),
        ({"pos": np.full((450, 3), np.nan)}, "sample 0 is not finite"),
        ({"t": np.zeros(450)}, "does not rise"),
        ({"rate_hz": np.array(5000.0)}, "samples are 0.0002 s apart"),
        ({"ori": np.zeros((450, 3))}, r"needed is \(T, 4\)"),
    ],
)
def test_bad_arrays_are_one_clear_line(drive, tmp_path, changes, says):
    path = write_npz(tmp_path / "bad.npz", drive, **changes)
    with pytest.raises(HlsdError, match=says) as caught:
        load_robot_log(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "content", "says"),
    [
        ("a.npz", b"PK\x03\x04 truncated", "truncated or damaged"),
        ("b.npz", b"", "truncated or damaged"),
        ("c.csv", b"", "lacks the columns t, x"),
        ("d.csv", b"t,x,y,yaw,v_cmd\n0,0,0,0,0\n", "lacks the columns omega_cmd"),
        ("e.csv", b"t,x,y,yaw,v_cmd,omega_cmd\n0,0,0,0,0,?\n", "row 2"),
        ("f.csv", b"t,x,y,yaw,v_cmd,omega_cmd\n0,0,0\n", "row 2"),
        ("g.csv", b"\xff\xfe\x00", "UTF-16 text: save it as UTF-8"),
        ("h.csv", b"t,x,y,yaw,v_cmd,omega_cmd\n", "lasts 0.00 s"),
    ],
)
def test_bad_files_are_one_clear_line(tmp_path, name, content, says):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(HlsdError, match=says) as caught:
        load_robot_log(path)
    assert str(path) in str(caught.value)
    assert "\n" not in str(caught.value)


def test_missing_files_and_folders_are_one_clear_line(tmp_path):
    with pytest.raises(HlsdError, match="there is no log"):
        load_robot_log(tmp_path / "none.npz")
    with pytest.raises(HlsdError, match="cannot read"):
        load_robot_log(tmp_path)


def test_list_names_every_robot():
    result = CliRunner().invoke(app, ["list"])
    assert result.exit_code == 0
    lines = result.output.splitlines()
    assert len(lines) == len(ROBOTS)
    for robot, line in zip(ROBOTS.values(), lines, strict=True):
        assert line.split()[:2] == [robot.name, robot.version]


def test_validate_prints_json_with_the_published_keys(drive, tmp_path):
    path = write_csv(tmp_path / "log.csv", drive)
    result = CliRunner().invoke(
        app, ["validate", str(path), "--robot", "jackal-ideal", "--json"]
    )
    assert result.exit_code == 0, result.output
    values = json.loads(result.output)
    assert values["robot"] == "jackal-ideal"
    assert values["robot_version"] == ROBOTS["jackal-ideal"].version
    assert values["position_error_m"].keys() == {"median", "p95"}
    assert values["heading_error_deg"].keys() == {"median", "p95"}
    gains = {"speed_gain", "yaw_gain", "lateral_per_yaw_m"}
    assert values["recorded"].keys() == gains
    assert values["yaw_gain"] == pytest.approx(1.0, abs=0.02)
    assert values.keys() >= gains


def test_validate_prints_a_table(drive, tmp_path):
    path = write_csv(tmp_path / "log.csv", drive)
    result = CliRunner().invoke(app, ["validate", str(path)])
    assert result.exit_code == 0, result.output
    assert result.output.startswith(f"jackal {ROBOTS['jackal'].version}, ")
    assert "heading error [deg]" in result.output


def test_validate_refuses_an_unknown_robot(drive, tmp_path):
    path = write_csv(tmp_path / "log.csv", drive)
    result = CliRunner().invoke(app, ["validate", str(path), "--robot", "husky"])
    assert isinstance(result.exception, HlsdError)
    assert "known are jackal, jackal-ideal, disc" in str(result.exception)
