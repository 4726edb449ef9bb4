"""The bridge to ROS 2, as far as it can be run where there is no ROS."""

import importlib
import math
import os
import shutil
import sys
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import numpy as np
import pytest

from hlsd.planners.base import Observation, Setup
from hlsd.planners.external.planner import ExternalPlanner

BRIDGE = Path(__file__).resolve().parents[2] / "examples" / "ros2_bridge"

pytestmark = pytest.mark.skipif(
    sys.platform not in ("linux", "darwin"), reason="programs plan on Linux and macOS"
)


@pytest.fixture
def bridge(monkeypatch):
    """Its modules that import nothing of ROS."""
    monkeypatch.syspath_prepend(BRIDGE)
    names = ("conversion", "lock_step", "domain")
    yield SimpleNamespace(**{name: importlib.import_module(name) for name in names})
    for name in names:
        sys.modules.pop(name, None)


def seen(time_s=0.0, pose=(1.0, 2.0, math.pi / 2), ranges=None):
    ranges = np.full(720, 5.0) if ranges is None else ranges
    goal = np.array([1.0, 10.0])
    path = np.array([[1.0, 2.0], [1.0, 10.0]])
    return Observation(time_s, ranges, 0.4, -0.2, np.array(pose), path, goal, goal)


def yaw_of(rotation):
    """By the definition of a unit quaternion about z."""
    assert (rotation["x"], rotation["y"]) == (0.0, 0.0)
    assert rotation["z"] ** 2 + rotation["w"] ** 2 == pytest.approx(1.0)
    return math.atan2(
        2.0 * rotation["w"] * rotation["z"], 1.0 - 2.0 * rotation["z"] ** 2
    )


def test_a_time_is_whole_nanoseconds(bridge):
    stamp = bridge.conversion.stamp(12_000_000_345)
    assert stamp == {"sec": 12, "nanosec": 345}
    assert bridge.conversion.nanoseconds(SimpleNamespace(**stamp)) == 12_000_000_345


def test_a_scan_has_a_beam_where_hlsd_has_it(bridge):
    lidar = Setup().lidar
    ranges = np.linspace(0.5, 29.0, lidar.beams)
    ranges[[3, 4]] = lidar.max_range_m, lidar.max_range_m + 0.002
    scan = bridge.conversion.laser_scan(ranges, lidar, 5_000_000_000, 0.05)
    angles = scan["angle_min"] + scan["angle_increment"] * np.arange(lidar.beams)
    assert np.allclose(angles, lidar.angles_rad(), atol=1e-12)
    assert scan["angle_max"] == pytest.approx(angles[-1])
    assert scan["ranges"][3] == scan["ranges"][4] == math.inf
    assert scan["ranges"][5:] == ranges[5:].astype(np.float32).tolist()
    assert scan["header"] == {"stamp": {"sec": 5, "nanosec": 0}, "frame_id": "laser"}
    largest = bridge.conversion.laser_scan(ranges, lidar, 0, 0.05, "max")["ranges"]
    assert largest[3] == largest[4] == scan["range_max"] == 30.0


def test_frames_and_signs(bridge):
    pose = np.array([1.0, -2.0, 2.5])
    odometry = bridge.conversion.odometry(pose, 0.4, -0.2, 0)
    assert yaw_of(odometry["pose"]["pose"]["orientation"]) == pytest.approx(2.5)
    assert odometry["pose"]["pose"]["position"] == {"x": 1.0, "y": -2.0, "z": 0.0}
    assert odometry["twist"]["twist"]["linear"]["x"] == 0.4
    assert odometry["twist"]["twist"]["angular"]["z"] == -0.2
    assert (odometry["header"]["frame_id"], odometry["child_frame_id"]) == (
        "odom",
        "base_link",
    )
    moved = bridge.conversion.robot_transform(pose, 0)
    assert yaw_of(moved["transform"]["rotation"]) == pytest.approx(2.5)
    joined, mount = bridge.conversion.fixed_transforms(Setup().lidar)
    assert (joined["header"]["frame_id"], joined["child_frame_id"]) == ("map", "odom")
    x, y, z = Setup().lidar.mount_in_base
    assert mount["transform"]["translation"] == {"x": x, "y": y, "z": z}
    goal = bridge.conversion.goal(np.array([1.0, 3.0]), np.array([1.0, 1.0, 0.0]), 0)
    assert yaw_of(goal["pose"]["orientation"]) == pytest.approx(math.pi / 2)


def test_fields_are_put_into_a_message_and_a_wrong_one_is_told(bridge):
    stamp = SimpleNamespace(sec=0, nanosec=0)
    message = SimpleNamespace(header=SimpleNamespace(stamp=stamp, frame_id=""))
    bridge.conversion.fill(message, {"header": bridge.conversion.header(7, "odom")})
    assert (message.header.frame_id, message.header.stamp.nanosec) == ("odom", 7)
    with pytest.raises(AttributeError, match="ranges"):
        bridge.conversion.fill(message, {"ranges": []})
    twist = SimpleNamespace(
        linear=SimpleNamespace(x=0.5), angular=SimpleNamespace(z=-1)
    )
    assert bridge.conversion.velocity(twist) == (0.5, -1.0)


STACK = '''
class Stack:
    """A stand-in: ready after some looks, answers each clock that is not left out."""

    def __init__(self, looks=3, stamped=True, silent=(), late_ns=0):
        self.looks, self.stamped, self.silent = looks, stamped, silent
        self.late_ns, self.sent, self.waiting, self.ticks = late_ns, [], [], -1

    def start(self):
        self.sent.append(("start", None))

    def ready(self):
        self.looks -= 1
        return self.looks < 0

    def publish(self, topic, fields):
        self.sent.append((topic, fields))
        if topic == "goal":
            self.has_goal = True
        if topic == "clock" and self.looks < 0:
            self.ticks += 1
            stamp = fields["clock"]
            now_ns = stamp["sec"] * 10**9 + stamp["nanosec"] - self.late_ns
            if self.ticks not in self.silent:
                held = now_ns if self.stamped else None
                self.waiting.append((held, 0.1 * (self.ticks + 1), 0.5))

    def commands(self, wait_s):
        if wait_s == 0.0:
            return []
        came, self.waiting = self.waiting, []
        return came
'''


@pytest.fixture
def stack():
    namespace = {}
    exec(STACK, namespace)
    return namespace["Stack"]


def times_ns(sent):
    return [
        held["clock"]["sec"] * 10**9 + held["clock"]["nanosec"]
        for topic, held in sent
        if topic == "clock"
    ]


@pytest.mark.parametrize("stamped", [True, False])
def test_each_tick_gets_the_command_to_it(bridge, stack, stamped):
    held = stack(stamped=stamped)
    planner = bridge.lock_step.LockStep(held, wait_s=0.05)
    planner.reset(Setup())
    for k in range(4):
        command = planner.plan(seen(0.05 * k))
        assert (command.speed, command.yaw_rate) == (0.1 * (k + 1), 0.5)
        assert command.mode == "plan"
    times = times_ns(held.sent)
    assert times == sorted(set(times)), "time only goes forwards"
    assert {round(t) for t in np.diff(times)} == {50_000_000}
    topics = [topic for topic, _ in held.sent]
    assert topics[:2] == ["start", "tf_static"]
    # The clock comes after all that it dates, but for the goal, and that once.
    assert topics[-8:] == ["scan", "tf", "odom", "clock"] * 2
    assert topics.count("goal") == 1


def test_the_goal_is_sent_as_often_as_the_protocol_says(bridge, stack):
    held = stack()
    planner = bridge.lock_step.LockStep(held, wait_s=0.05)
    planner.reset(Setup(goal_period_s=0.1))
    for k in range(5):
        planner.plan(seen(0.05 * k))
    assert [topic for topic, _ in held.sent].count("goal") == 3


def test_without_a_command_the_last_one_is_held_and_then_the_robot_stands(
    bridge, stack
):
    held = stack(silent=range(1, 100))
    planner = bridge.lock_step.LockStep(held, wait_s=0.001, hold_s=0.1)
    planner.reset(Setup())
    said = [planner.plan(seen(0.05 * k)) for k in range(5)]
    assert [command.speed for command in said] == [0.1, 0.1, 0.1, 0.0, 0.0]
    assert [command.mode for command in said] == ["plan"] * 3 + ["wait"] * 2


def test_a_command_to_an_earlier_tick_counts_for_nothing(bridge, stack):
    planner = bridge.lock_step.LockStep(stack(late_ns=1), wait_s=0.001)
    planner.reset(Setup())
    assert planner.plan(seen()).mode == "wait"


def test_a_stack_that_never_starts_is_told(bridge, stack, monkeypatch):
    monkeypatch.setattr(bridge.lock_step, "START_S", 0.05)
    planner = bridge.lock_step.LockStep(stack(looks=10**9))
    with pytest.raises(TimeoutError, match="took no goal within"):
        planner.reset(Setup())


def test_no_two_processes_have_one_domain(bridge, tmp_path):
    first, kept = bridge.domain.claim(tmp_path)
    second, other = bridge.domain.claim(tmp_path)
    assert first != second
    kept.close()
    third, again = bridge.domain.claim(tmp_path)
    assert third == first
    other.close()
    again.close()


ROS = (
    "rclpy",
    "rclpy.qos",
    *(f"{name}.msg" for name in ("geometry_msgs", "nav_msgs", "rosgraph_msgs")),
    *("sensor_msgs.msg", "std_srvs.srv", "tf2_msgs.msg"),
)


def test_the_node_calls_what_it_means_to_call(bridge, monkeypatch, tmp_path):
    """Against stand-ins that take any call: slips of the pen, and nothing else."""
    for name in (*ROS, *{name.partition(".")[0] for name in ROS}):
        monkeypatch.setitem(sys.modules, name, MagicMock(name=name))
    monkeypatch.setattr(bridge.domain.tempfile, "gettempdir", lambda: str(tmp_path))
    monkeypatch.setenv("ROS_DOMAIN_ID", "0")
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    node = importlib.import_module("bridge_node")
    rclpy = sys.modules["rclpy"]
    held = node.RosStack(node.options_of(["--wait-s", "0.01", "--stamped"]))
    planner = bridge.lock_step.LockStep(held, wait_s=0.01)
    answer = rclpy.create_node().create_client().call_async()
    answer.done.return_value, answer.result().success = True, True
    planner.reset(Setup())
    assert os.environ["ROS_DOMAIN_ID"] == "1"
    (kind, topic, hear, _), _ = rclpy.create_node().create_subscription.call_args
    assert (kind, topic) == (sys.modules["geometry_msgs.msg"].TwistStamped, "/cmd_vel")
    message = SimpleNamespace(
        header=SimpleNamespace(stamp=SimpleNamespace(sec=9, nanosec=0)),
        twist=SimpleNamespace(
            linear=SimpleNamespace(x=0.5), angular=SimpleNamespace(z=0.25)
        ),
    )
    # Each spin brings a command.
    rclpy.spin_once.side_effect = lambda *_, **__: hear(message)
    command = planner.plan(seen())
    assert (command.speed, command.yaw_rate) == (0.5, 0.25)
    made = rclpy.create_node().create_publisher.call_args_list
    assert {call.args[1] for call in made} == {
        *("/clock", "/odom", "/scan", "/goal_pose", "/tf", "/tf_static")
    }
    sys.modules.pop("bridge_node")
    held._claim.close()


def test_the_bridge_speaks_with_hlsd_and_is_new_for_each_episode(tmp_path):
    """All of it but ROS: the stand-in drives over the protocol."""
    for name in ("conversion.py", "lock_step.py"):
        shutil.copy(BRIDGE / name, tmp_path)
    (tmp_path / "drive.py").write_text(
        "from lock_step import LockStep\n"
        "from hlsd.planners.external.serving import serve\n"
        f"{STACK}\n"
        "serve(LockStep(Stack(), wait_s=0.05), fresh_process=True)\n"
    )
    planner = ExternalPlanner(f"{sys.executable} {tmp_path / 'drive.py'}")
    for _ in range(2):
        planner.reset(Setup())
        said = [planner.plan(seen(0.05 * k)).speed for k in range(3)]
        assert said == [0.1 * (k + 1) for k in range(3)]
    planner.close()
