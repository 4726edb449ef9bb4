"""The navigation stack along recorded drives."""

import time

import numpy as np

from benchmarks.drive import Drive
from benchmarks.timing import Row, row
from hlsd.navigation.costmap import Costmap
from hlsd.navigation.global_planner import GlobalPlanner
from hlsd.navigation.navfn import NavFn
from hlsd.navigation.navigator import Navigator


def navigation(drives: list[Drive], rounds: int) -> list[Row]:
    """Time per scan into the costmap, per tick of `Navigator.update`, and per plan.

    The recorded poses and scans are fed to a fresh navigator. Most ticks need no new
    plan; those that do are the slowest ticks of a run, so they have a row of their own.
    The plan goes from the start to the goal over all that the drive has shown.

    Args:
        drives: Rows are over all of their ticks.
        rounds: Replays of each drive.
    """
    quiet, replanned, plans, by_navfn, scans = [], [], [], [], []
    for number in range(-1, rounds):
        a, b, c, d = zip(*map(_replay, drives), strict=True)
        if number >= 0:
            quiet.append(np.mean(np.concatenate(a)))
            replanned.append(np.mean(np.concatenate(b)))
            plans.append(np.mean(c))
            by_navfn.append(np.mean(d))
            scans.append(sum(map(_add_scans, drives)) / sum(map(len, a + b)))
    share = sum(map(len, b)) / sum(map(len, a + b))
    return [
        row("costmap: scan added", "us", np.array(scans) * 1e6),
        row("navigator: tick without a new plan", "us", np.array(quiet) * 1e6),
        row("navigator: tick with a new plan", "us", np.array(replanned) * 1e6),
        row("navigator: ticks with a new plan", "%", np.array([100 * share])),
        row("global plan, start to goal", "us", np.array(plans) * 1e6),
        row("the same by NavFn, for move_base", "us", np.array(by_navfn) * 1e6),
    ]


def _add_scans(drive: Drive) -> float:
    """CPU seconds of the costmap alone."""
    costmap = Costmap(drive.course.lidar_spec)
    began = time.process_time()
    for seen in drive.observations:
        costmap.update(seen.pose_in_odom, seen.ranges_m)
    return time.process_time() - began


def _replay(drive: Drive) -> tuple[list[float], list[float], float, float]:
    """CPU seconds of the ticks without and with a new plan, and of two whole plans."""
    navigator = Navigator(drive.course.lidar_spec)
    navigator.reset(drive.observations[0].goal_in_odom)
    quiet: list[float] = []
    replanned: list[float] = []
    for seen in drive.observations:
        before = navigator.replans
        began = time.process_time()
        navigator.update(seen.time_s, seen.pose_in_odom, seen.ranges_m)
        took = time.process_time() - began
        (quiet if navigator.replans == before else replanned).append(took)
    first = drive.observations[0]
    whole = []
    for planner in (GlobalPlanner(navigator.costmap), NavFn(navigator.costmap)):
        # The way back first: the system hands out the work space's memory meanwhile.
        planner.plan(first.goal_in_odom, first.pose_in_odom)
        began = time.process_time()
        planner.plan(first.pose_in_odom, first.goal_in_odom)
        whole.append(time.process_time() - began)
    return quiet, replanned, whole[0], whole[1]
