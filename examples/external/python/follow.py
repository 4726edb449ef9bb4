"""A planner in a process of its own: keep to the path, slow down where it is narrow.

Run it: hlsd bench --planner "exec:python3 examples/external/python/follow.py" \
            --worlds 0:300:30

It needs msgpack, NumPy, and either hlsd or a copy of its file
hlsd/planners/external/serving.py beside this one, named serving.py.
"""

import math
import sys

try:
    from serving import Command, serve
except ImportError:
    from hlsd.planners.external.serving import Command, serve


class Follow:
    """The same arithmetic as in ../cpp/follow.cpp, operation by operation."""

    period_s = 0.05

    def reset(self, setup):
        """Note how fast to drive, and which beams point ahead: 45 degrees of them."""
        self.top_speed = min(0.5, setup.limits.max_speed)
        middle, half = setup.lidar.beams // 2, setup.lidar.beams // 12
        self.ahead = slice(middle - half, middle + half)

    def plan(self, observation):
        """Turn towards the local goal; drive as fast as the room ahead allows."""
        x, y = map(float, observation.local_goal_in_base)
        clearance = float(observation.ranges_m[self.ahead].min())
        bearing = math.atan2(y, x)
        speed = self.top_speed * clearance / (clearance + 0.3)
        if abs(bearing) > 0.8:
            speed = 0.0
        return Command(speed, min(max(2.0 * bearing, -1.5), 1.5))


if __name__ == "__main__":
    serve(Follow(), scan=sys.argv[1] if len(sys.argv) > 1 else "float32")
