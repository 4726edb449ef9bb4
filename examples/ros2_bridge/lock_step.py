"""A planner for hlsd that asks a navigation stack at each tick; imports nothing of ROS.

What it needs of ROS is a stack (`bridge_node.RosStack`, or a stand-in in the tests):

- ``start()`` starts it; ``ready()`` says whether it takes a goal;
- ``publish(topic, fields)`` sends a message (`conversion`), the topics being clock, tf,
  tf_static, odom, scan and goal;
- ``commands(wait_s)`` waits so long at most for commands, and gives those that came:
  the time that each is stamped with [ns], None without a stamp, speed and yaw rate.
"""

import time

import conversion

START_S = 50.0
"""A stack is given so long to start [s]; hlsd waits for 60 s."""
_STEP_NS = 50_000_000


class LockStep:
    """Publishes what the robot knows, waits for the command to it, and gives that.

    The clock stands while the stack thinks and goes on by a period with each tick.
    """

    def __init__(
        self, stack, *, period_s=0.05, wait_s=0.25, hold_s=0.5, no_return="inf"
    ):
        """Take a stack.

        Args:
            stack: See the module.
            period_s: Between two ticks.
            wait_s: Wall time that a command is waited for at each tick.
            hold_s: A command is driven so long where no new one comes [s, simulated];
                then the robot stands, as a base does whose driver has a timeout.
            no_return: See `conversion.laser_scan`.
        """
        self.period_s = period_s
        self._stack, self._wait_s, self._hold_ns = stack, wait_s, round(hold_s * 1e9)
        self._no_return = no_return

    def reset(self, setup):
        """Start the stack, and let its clock run until it takes a goal.

        Raises:
            TimeoutError: It does not in `START_S`.
        """
        self._lidar = setup.lidar
        goal_s = setup.goal_period_s
        self._goal_every_ns = None if goal_s is None else round(goal_s * 1e9)
        self._goal_at_ns = None
        self._command, self._commanded_ns = (0.0, 0.0), None
        self._stack.start()
        self._stack.publish("tf_static", conversion.fixed_transforms(setup.lidar))
        until_s = time.monotonic() + START_S
        # Not 0, which means "no time yet" to ROS.
        self._begin_ns = _STEP_NS
        while not self._stack.ready():
            if time.monotonic() > until_s:
                raise TimeoutError(f"the stack took no goal within {START_S:g} s")
            self._robot((0.0, 0.0, 0.0), 0.0, 0.0, self._begin_ns)
            self._stack.commands(_STEP_NS / 1e9)
            self._begin_ns += _STEP_NS

    def plan(self, observation):
        """Show the stack a tick; its command to it, or the last one."""
        now_ns = self._begin_ns + round(observation.time_s * 1e9)
        pose = observation.pose_in_odom
        self._stack.publish(
            "scan",
            conversion.laser_scan(
                observation.ranges_m,
                self._lidar,
                now_ns,
                self.period_s,
                self._no_return,
            ),
        )
        # What came late counts for nothing: it answers an earlier tick.
        self._stack.commands(0.0)
        self._robot(pose, observation.speed, observation.yaw_rate, now_ns)
        if self._is_time_for_goal(now_ns):
            self._goal_at_ns = now_ns
            fields = conversion.goal(observation.goal_in_odom, pose, now_ns)
            self._stack.publish("goal", fields)
        self._await_command(now_ns)
        if self._commanded_ns is None or now_ns - self._commanded_ns > self._hold_ns:
            return Stand(0.0, 0.0)
        return Drive(*self._command)

    def _robot(self, pose, speed, yaw_rate, now_ns):
        """Where the robot is, and then the clock: who wakes up finds all the rest."""
        publish = self._stack.publish
        publish("tf", [conversion.robot_transform(pose, now_ns)])
        publish("odom", conversion.odometry(pose, speed, yaw_rate, now_ns))
        publish("clock", conversion.clock(now_ns))

    def _is_time_for_goal(self, now_ns):
        if self._goal_at_ns is None:
            return True
        every = self._goal_every_ns
        return every is not None and now_ns - self._goal_at_ns >= every

    def _await_command(self, now_ns):
        until_s = time.monotonic() + self._wait_s
        while (left_s := until_s - time.monotonic()) > 0.0:
            for stamped_ns, speed, yaw_rate in self._stack.commands(left_s):
                if stamped_ns is None or stamped_ns >= now_ns:
                    self._command, self._commanded_ns = (speed, yaw_rate), now_ns
            if self._commanded_ns == now_ns:
                return


class Drive:
    """A command of the stack."""

    mode = "plan"

    def __init__(self, speed, yaw_rate):
        """Note it [m/s, rad/s]."""
        self.speed, self.yaw_rate = speed, yaw_rate


class Stand(Drive):
    """None came for too long."""

    mode = "wait"
