"""A ROS 2 navigation stack as a planner of hlsd; README.md says how to run it.

For hlsd it is a program that plans; for the stack it is the robot, its lidar and the
clock. It needs rclpy and the common messages, msgpack and NumPy, and either hlsd or a
copy of its file hlsd/planners/external/serving.py beside this one.
"""

import argparse
import os
import shlex
import signal
import subprocess

import conversion
import domain
from lock_step import LockStep

try:
    from serving import serve
except ImportError:
    from hlsd.planners.external.serving import serve

# Of messages and answers that may have come together.
_MORE = 10


class RosStack:
    """Publishers, subscriptions and the stack's processes, in a domain of their own."""

    def __init__(self, options):
        """Note what to start; nothing of ROS is touched yet."""
        self._options = options
        self._came = []

    def start(self):
        """Claim a domain, start the node and the stack."""
        number, self._claim = domain.claim()
        os.environ["ROS_DOMAIN_ID"] = str(number)
        os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
        if self._options.launch:
            # hlsd starts this process deaf to Ctrl-C, with which launch ends its nodes.
            signal.signal(signal.SIGINT, signal.default_int_handler)
            # In this process's group, which hlsd ends as a whole.
            self._launched = subprocess.Popen(
                shlex.split(self._options.launch), stdin=subprocess.DEVNULL
            )
        self._start_node()

    def _start_node(self):
        import rclpy
        from geometry_msgs.msg import (
            PoseStamped,
            TransformStamped,
            Twist,
            TwistStamped,
        )
        from nav_msgs.msg import Odometry
        from rclpy.qos import DurabilityPolicy, QoSProfile
        from rosgraph_msgs.msg import Clock
        from sensor_msgs.msg import LaserScan
        from std_srvs.srv import Trigger
        from tf2_msgs.msg import TFMessage

        options = self._options
        rclpy.init(args=[])
        self._rclpy, self._transform, self._tf = rclpy, TransformStamped, TFMessage
        self._trigger = Trigger
        self._node = node = rclpy.create_node("hlsd_bridge")
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self._kinds = {
            "clock": Clock,
            "odom": Odometry,
            "scan": LaserScan,
            "goal": PoseStamped,
            "tf": TFMessage,
            "tf_static": TFMessage,
        }
        names = {
            "clock": "/clock",
            "odom": options.odom_topic,
            "scan": options.scan_topic,
            "goal": options.goal_topic,
            "tf": "/tf",
            "tf_static": "/tf_static",
        }
        self._publishers = {
            topic: node.create_publisher(
                kind, names[topic], latched if topic == "tf_static" else 10
            )
            for topic, kind in self._kinds.items()
        }
        kind, hear = (Twist, self._hear)
        if options.stamped:
            kind, hear = (TwistStamped, self._hear_stamped)
        node.create_subscription(kind, options.command_topic, hear, 10)
        self._active = node.create_client(Trigger, options.active_service)
        self._asked = None

    def _hear(self, twist):
        self._came.append((None, *conversion.velocity(twist)))

    def _hear_stamped(self, message):
        stamped_ns = conversion.nanoseconds(message.header.stamp)
        self._came.append((stamped_ns, *conversion.velocity(message.twist)))

    def ready(self):
        """Whether the stack's lifecycle manager says that all of it is active."""
        if self._asked is not None and self._asked.done():
            answer, self._asked = self._asked.result(), None
            if answer is not None and answer.success:
                return True
        if self._asked is None and self._active.service_is_ready():
            self._asked = self._active.call_async(self._trigger.Request())
        return False

    def publish(self, topic, fields):
        """Send a message, or for tf a list of transforms."""
        message = self._kinds[topic]()
        if topic in ("tf", "tf_static"):
            message.transforms = [
                conversion.fill(self._transform(), held) for held in fields
            ]
        else:
            conversion.fill(message, fields)
        self._publishers[topic].publish(message)

    def commands(self, wait_s):
        """Commands that came, after so long at most."""
        self._rclpy.spin_once(self._node, timeout_sec=wait_s)
        for _ in range(_MORE):  # a spin takes one message at most
            self._rclpy.spin_once(self._node, timeout_sec=0.0)
        came, self._came = self._came, []
        return came


def options_of(words=None):
    """The options of the command line."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--launch", help="command that starts the stack")
    parser.add_argument("--period-s", type=float, default=0.05)
    parser.add_argument(
        "--wait-s", type=float, default=0.25, help="for a command, wall"
    )
    parser.add_argument("--hold-s", type=float, default=0.5, help="of a command")
    parser.add_argument("--no-return", choices=("inf", "max"), default="inf")
    parser.add_argument("--stamped", action="store_true", help="cmd_vel: TwistStamped")
    parser.add_argument("--scan-topic", default="/scan")
    parser.add_argument("--odom-topic", default="/odom")
    parser.add_argument("--goal-topic", default="/goal_pose")
    parser.add_argument("--command-topic", default="/cmd_vel")
    parser.add_argument(
        "--active-service", default="/lifecycle_manager_navigation/is_active"
    )
    return parser.parse_args(words)


def main():
    """Serve until hlsd says bye; each trial has a new process."""
    options = options_of()
    planner = LockStep(
        RosStack(options),
        period_s=options.period_s,
        wait_s=options.wait_s,
        hold_s=options.hold_s,
        no_return=options.no_return,
    )
    serve(planner, fresh_process=True)


if __name__ == "__main__":
    main()
