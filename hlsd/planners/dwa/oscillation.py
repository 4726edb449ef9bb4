"""What DWA remembers against oscillation.

Source: ros-planning/navigation, melodic-devel, base_local_planner,
src/trajectory_planner.cpp.
"""

import math
from dataclasses import dataclass

from hlsd.core.geometry import wrap_angle
from hlsd.planners.dwa.scoring import NO_WAY, Choice


@dataclass(slots=True)
class Flags:
    """Which motions are blocked at present.

    Two turns in place to one side block the other side, until the robot has moved on
    from the last of them. An escape blocks driving forward, until the robot has moved
    or turned away from where it began.

    Attributes:
        oscillation_reset_m: A robot that has moved on by this may turn either way.
        escape_reset_m: One that has moved by this may drive forward again,
        escape_reset_rad: and one that has turned by this.
        rotating_right: It turned right in place.
        rotating_left: It turned left in place.
        stuck_right: It did so again: turning left is blocked.
        stuck_left: Turning right is blocked.
        escaping: Driving forward is blocked.
    """

    oscillation_reset_m: float
    escape_reset_m: float
    escape_reset_rad: float
    rotating_right: bool = False
    rotating_left: bool = False
    stuck_right: bool = False
    stuck_left: bool = False
    escaping: bool = False
    _turned_at: tuple[float, float] = (0.0, 0.0)
    _escaped_at: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def note_driving(self, best: Choice, x_m: float, y_m: float) -> None:
        """A legal rollout was chosen."""
        if best.speed > 0.0:
            return
        if best.yaw_rate < 0.0:
            self.stuck_right = self.stuck_right or self.rotating_right
            self.rotating_right = True
        elif best.yaw_rate > 0.0:
            self.stuck_left = self.stuck_left or self.rotating_left
            self.rotating_left = True
        self._turned_at = (x_m, y_m)

    def note_escape(self, cost: float, x_m: float, y_m: float, yaw: float) -> None:
        """Nothing was legal; ``cost`` is that of driving backwards."""
        if not self.escaping and cost > NO_WAY:
            self._escaped_at = (x_m, y_m, yaw)
            self.escaping = True

    def expire(self, x_m: float, y_m: float, yaw: float) -> None:
        """Drop the flags that the robot has moved away from."""
        turned_x, turned_y = self._turned_at
        if math.hypot(x_m - turned_x, y_m - turned_y) > self.oscillation_reset_m:
            self.rotating_right = self.rotating_left = False
            self.stuck_right = self.stuck_left = False
        escaped_x, escaped_y, escaped_yaw = self._escaped_at
        if (
            math.hypot(x_m - escaped_x, y_m - escaped_y) > self.escape_reset_m
            or abs(wrap_angle(yaw - escaped_yaw)) > self.escape_reset_rad
        ):
            self.escaping = False
