"""A planner drives an obedient unicycle between walls known in closed form."""

import math

import numpy as np

from hlsd.core.description import LidarSpec
from hlsd.planners.base import Command, Observation, Setup

LIDAR = LidarSpec(noise_sd_m=0.0)
STRAIGHT = np.column_stack((np.linspace(0.0, 6.0, 200), np.zeros(200)))
CORRIDOR = ((0.0, 1.0, 0.7), (0.0, 1.0, -0.7))


def scan_of(walls, pose):
    """Ranges to infinite walls, each a normal and its distance from the origin."""
    angles = LIDAR.angles_rad() + pose[2]
    forward = LIDAR.mount_in_base[0]
    sx = pose[0] + forward * math.cos(pose[2])
    sy = pose[1] + forward * math.sin(pose[2])
    ranges = np.full(LIDAR.beams, LIDAR.max_range_m)
    for nx, ny, distance in walls:
        along = nx * np.cos(angles) + ny * np.sin(angles)
        left = distance - nx * sx - ny * sy
        with np.errstate(divide="ignore"):
            hit = np.where(along * left > 0.0, left / along, np.inf)
        ranges = np.minimum(ranges, hit)
    return ranges


def drive(planner, walls, path, seconds, seed=1):
    """A unicycle that obeys; poses ``(ticks, 3)`` and commands."""
    planner.reset(Setup(lidar=LIDAR, seed=seed))
    pose, command = np.zeros(3), Command(0.0, 0.0)
    poses, commands = [], []
    for k in range(round(seconds / 0.05)):
        nearest = int(np.hypot(*(path - pose[:2]).T).argmin())
        command = planner.plan(
            Observation(
                time_s=k * 0.05,
                ranges_m=scan_of(walls, pose),
                speed=command.speed,
                yaw_rate=command.yaw_rate,
                pose_in_odom=pose,
                path_in_odom=path[nearest:],
                local_goal_in_base=np.array((1.0, 0.0)),
                goal_in_odom=path[-1],
            )
        )
        yaw = pose[2] + 0.05 * command.yaw_rate
        step = 0.05 * command.speed * np.array((math.cos(yaw), math.sin(yaw)))
        pose = np.array((*(pose[:2] + step), yaw))
        poses.append(pose)
        commands.append(command)
    return np.array(poses), commands
