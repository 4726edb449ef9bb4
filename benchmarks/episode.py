"""Whole episodes in multiples of bare physics, and where their time goes."""

from collections.abc import Callable, Mapping

import mujoco
import numpy as np

from benchmarks.drive import Drive
from benchmarks.timing import Row, Work, cpu_seconds, row
from hlsd.navigation.navigator import Navigator, navigation_of

Drives = Mapping[str, list[Drive]]


def ticks(drives: Drives, rounds: int) -> list[Row]:
    """CPU time of `Planner.plan` on recorded observations, all planners in turn.

    Args:
        drives: Of each planner; rows are over all of their ticks.
        rounds: Each runs every planner once.
    """
    seconds = cpu_seconds(
        {name: _each(_planner, found) for name, found in drives.items()}, rounds
    )
    return [
        row(f"{name}: tick", "us", times / _ticks(drives[name]) * 1e6)
        for name, times in seconds.items()
    ]


def episodes(drives: Drives, rounds: int) -> list[Row]:
    """Whole episodes against bare physics for the same steps.

    Bare physics is `mujoco.mj_step` with the recorded actuator commands, so that
    states and contacts are the same.

    Args:
        drives: Of each planner.
        rounds: Each runs all episodes of all planners, and their physics, once.
    """
    work: dict[str, Work] = {}
    for name, found in drives.items():
        work[f"{name} whole"] = _each(_rerun, found)
        work[f"{name} bare"] = _each(_bare_physics, found)
    seconds = cpu_seconds(work, rounds)
    rows = []
    for name, found in drives.items():
        whole, bare = seconds[f"{name} whole"], seconds[f"{name} bare"]
        simulated_s = sum(drive.episode.sim_time_s for drive in found)
        rows += [
            row(f"{name}: episode over bare mj_step", "x", whole / bare),
            row(f"{name}: simulated per CPU second", "s/s", simulated_s / whole),
        ]
    return rows


def parts(drives: Drives, rounds: int) -> list[Row]:
    """CPU time per tick of whole episodes and of their parts.

    Every part is run again on what was recorded; "the rest" is what remains of the
    episode.

    Args:
        drives: Of each planner; rows are over all of their ticks.
        rounds: Each runs the episodes and every part once.
    """
    pieces = {
        "whole episode": _rerun,
        "bare mj_step": _bare_physics,
        "Simulator.advance": _advance,
        "Lidar.measure": _lidar,
        "Navigator.update": _navigator,
        "Planner.plan": _planner,
    }
    rows = []
    for name, found in drives.items():
        seconds = cpu_seconds(
            {part: _each(piece, found) for part, piece in pieces.items()}, rounds
        )
        inside = sum(seconds[part] for part in list(pieces)[2:])
        seconds["the rest"] = seconds["whole episode"] - inside
        rows += [
            row(f"{name}: per tick, {part}", "us", times / _ticks(found) * 1e6)
            for part, times in seconds.items()
        ]
    return rows


def _each(piece: Callable[[Drive], None], drives: list[Drive]) -> Work:
    """Work that does a piece for all drives."""

    def work() -> None:
        for drive in drives:
            piece(drive)

    return work


def _ticks(drives: list[Drive]) -> int:
    return sum(len(drive.commands) for drive in drives)


def _rerun(drive: Drive) -> None:
    drive.rerun()


def _bare_physics(drive: Drive) -> None:
    drive.restart()
    model, data = drive.course.simulator.model, drive.course.simulator.data
    ctrl, step = data.ctrl, mujoco.mj_step
    for command in drive.ctrl:
        ctrl[:] = command
        step(model, data)


def _advance(drive: Drive) -> None:
    drive.restart()
    simulator, period_s = drive.course.simulator, drive.planner.period_s
    for command in drive.commands:
        simulator.advance(command.speed, command.yaw_rate, period_s)


def _lidar(drive: Drive) -> None:
    noise = np.random.default_rng(0)
    lidar, data = drive.course.lidar, drive.course.simulator.data
    for qpos in drive.qpos:
        data.qpos[:] = qpos
        lidar.measure(data, noise)


def _navigator(drive: Drive) -> None:
    navigator: Navigator = drive.course.navigator
    navigator.reset(drive.observations[0].goal_in_odom, navigation_of(drive.planner))
    for seen in drive.observations:
        navigator.update(seen.time_s, seen.pose_in_odom, seen.ranges_m)


def _planner(drive: Drive) -> None:
    course, planner = drive.course, drive.planner
    planner.reset(course.setup(0))
    for seen in drive.observations:
        planner.plan(seen)
