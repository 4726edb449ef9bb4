"""What hlsd knows, as the fields of ROS messages, and back; imports nothing of ROS.

A message is a dictionary of its fields, nested as the message is; `fill` puts it into a
real one. Frames: `map` and `odom` are one (the start pose, x forward), `base_link` is
the robot, `laser` its lidar (REP 105). Units are ROS's and hlsd's alike: SI.
"""

import math

import numpy as np

MAP, ODOM, BASE, LASER = "map", "odom", "base_link", "laser"


def stamp(time_ns):
    """builtin_interfaces/Time of whole nanoseconds."""
    return {"sec": time_ns // 1_000_000_000, "nanosec": time_ns % 1_000_000_000}


def nanoseconds(stamp):
    """Whole nanoseconds of a builtin_interfaces/Time."""
    return stamp.sec * 1_000_000_000 + stamp.nanosec


def header(time_ns, frame):
    """std_msgs/Header."""
    return {"stamp": stamp(time_ns), "frame_id": frame}


def quaternion(yaw_rad):
    """geometry_msgs/Quaternion of a turn about z."""
    return {
        "x": 0.0,
        "y": 0.0,
        "z": math.sin(yaw_rad / 2.0),
        "w": math.cos(yaw_rad / 2.0),
    }


def clock(time_ns):
    """rosgraph_msgs/Clock."""
    return {"clock": stamp(time_ns)}


def laser_scan(ranges_m, lidar, time_ns, period_s, no_return="inf"):
    """sensor_msgs/LaserScan.

    Args:
        ranges_m: ``(beams,)``, anticlockwise; max_range_m where nothing returns.
        lidar: hlsd's.
        time_ns: When it was taken.
        period_s: Between two scans.
        no_return: "inf", as REP 117 has it, or "max" for the largest range, with which
            costmaps clear where nothing returns without `inf_is_valid`.
    """
    ranges = np.asarray(ranges_m, dtype=np.float32)
    farthest = np.float32(lidar.max_range_m)
    if no_return == "inf":
        ranges = np.where(ranges >= farthest, np.float32(np.inf), ranges)
    else:
        # A reader discards what lies beyond; noise may have put it there.
        ranges = np.minimum(ranges, farthest)
    return {
        "header": header(time_ns, LASER),
        "angle_min": -lidar.fov_rad / 2.0,
        "angle_max": lidar.fov_rad / 2.0,
        "angle_increment": lidar.fov_rad / (lidar.beams - 1),
        "time_increment": 0.0,
        "scan_time": float(period_s),
        "range_min": float(lidar.min_range_m),
        "range_max": float(lidar.max_range_m),
        "ranges": ranges.tolist(),
        "intensities": [],
    }


def odometry(pose_in_odom, speed, yaw_rate, time_ns):
    """nav_msgs/Odometry.

    Args:
        pose_in_odom: x [m], y [m], yaw [rad].
        speed: Measured, forwards [m/s].
        yaw_rate: Measured [rad/s].
        time_ns: When.
    """
    x, y, yaw = map(float, pose_in_odom)
    return {
        "header": header(time_ns, ODOM),
        "child_frame_id": BASE,
        "pose": {
            "pose": {
                "position": {"x": x, "y": y, "z": 0.0},
                "orientation": quaternion(yaw),
            }
        },
        "twist": {
            "twist": {
                "linear": {"x": float(speed), "y": 0.0, "z": 0.0},
                "angular": {"x": 0.0, "y": 0.0, "z": float(yaw_rate)},
            }
        },
    }


def transform(parent, child, place, yaw_rad, time_ns):
    """geometry_msgs/TransformStamped.

    Args:
        parent: Frame.
        child: Frame.
        place: x, y, z of the child in the parent [m].
        yaw_rad: Of the child in the parent.
        time_ns: When.
    """
    x, y, z = map(float, place)
    return {
        "header": header(time_ns, parent),
        "child_frame_id": child,
        "transform": {
            "translation": {"x": x, "y": y, "z": z},
            "rotation": quaternion(yaw_rad),
        },
    }


def robot_transform(pose_in_odom, time_ns):
    """The robot in odom."""
    x, y, yaw = map(float, pose_in_odom)
    return transform(ODOM, BASE, (x, y, 0.0), yaw, time_ns)


def fixed_transforms(lidar):
    """What never moves: odom in map, and the laser on the robot."""
    return [
        transform(MAP, ODOM, (0.0, 0.0, 0.0), 0.0, 0),
        transform(BASE, LASER, lidar.mount_in_base, 0.0, 0),
    ]


def goal(goal_in_odom, pose_in_odom, time_ns):
    """geometry_msgs/PoseStamped: the goal, with the heading of the way to it.

    hlsd's goals have no heading; a goal checker with a tight yaw tolerance would turn
    the robot at the end of a run, which no protocol asks for.
    """
    x, y = map(float, goal_in_odom)
    yaw = math.atan2(y - float(pose_in_odom[1]), x - float(pose_in_odom[0]))
    return {
        "header": header(time_ns, MAP),
        "pose": {
            "position": {"x": x, "y": y, "z": 0.0},
            "orientation": quaternion(yaw),
        },
    }


def velocity(twist):
    """Speed [m/s] and yaw rate [rad/s] of a geometry_msgs/Twist."""
    return float(twist.linear.x), float(twist.angular.z)


def fill(message, fields):
    """Put fields into a message, and give it back.

    Raises:
        AttributeError: The message has no such field.
    """
    for name, held in fields.items():
        there = getattr(message, name)
        if isinstance(held, dict):
            fill(there, held)
        else:
            setattr(message, name, held)
    return message
