"""Where the time of an episode goes, in multiples of bare physics."""

import mujoco
import numpy as np

from benchmarks.drive import Drive
from benchmarks.timing import Row, cpu_seconds, row
from hlsd.planners.base import Setup
from hlsd.planners.navigation import Navigator, navigation_of


def episode(drives: list[Drive], rounds: int) -> list[Row]:
    """CPU time per tick of whole episodes and of their parts.

    Bare physics is `mujoco.mj_step` with the recorded actuator commands, so that
    states and contacts are the same. Every part is run again on what was recorded;
    "the rest" is what remains of the episode.

    Args:
        drives: Rows are over all of their ticks.
        rounds: Each runs the episodes and every part once.
    """
    parts = {
        "whole episode": _rerun,
        "bare mj_step": _bare_physics,
        "Simulator.advance": _advance,
        "Lidar.measure": _lidar,
        "Navigator.update": _navigator,
        "Planner.plan": _planner,
    }
    seconds = cpu_seconds(
        {
            name: lambda part=part: [part(drive) for drive in drives]  # type: ignore[misc]
            for name, part in parts.items()
        },
        rounds,
    )
    ticks = sum(len(drive.commands) for drive in drives)
    simulated_s = sum(drive.episode.sim_time_s for drive in drives)
    whole, bare = seconds["whole episode"], seconds["bare mj_step"]
    rest = whole - sum(seconds[name] for name in list(parts)[2:])
    return [
        row("episode: as multiple of bare mj_step", "x", whole / bare),
        row("episode: simulated per CPU second", "s/s", simulated_s / whole),
        *(
            row(f"per tick: {name}", "us", times / ticks * 1e6)
            for name, times in {**seconds, "the rest": rest}.items()
        ),
    ]


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
    planner.reset(Setup(course.robot.limits, course.lidar_spec, 0))
    for seen in drive.observations:
        planner.plan(seen)
