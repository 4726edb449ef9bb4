"""Whole episodes among moving obstacles."""

from collections.abc import Sequence
from functools import partial

from benchmarks.timing import Row, cpu_seconds, row
from hlsd.data.generation import maker
from hlsd.data.world import World
from hlsd.planners.base import Planner
from hlsd.planners.registry import make_planner
from hlsd.run.episode import Course, run_episode
from hlsd.run.protocol import get_protocol
from hlsd.sim.robots import get_robot

TIERS = ("easy", "hard")
COUNT = 10
"""Worlds of each tier, made from seed 0."""


def moving(planner: str, rounds: int) -> list[Row]:
    """Simulated seconds per CPU second in DynaBARN's worlds.

    Args:
        planner: Who drives.
        rounds: Each runs all episodes once.
    """
    robot, protocol = get_robot("jackal"), get_protocol("dynabarn2024")
    driver = make_planner(planner)
    rows = []
    for tier in TIERS:
        make = maker("dynabarn", tier)
        worlds = [World.of(tier, index, make(0, index)[0]) for index in range(COUNT)]
        courses = [Course(world, robot, protocol) for world in worlds]
        drive = partial(_drive, courses, driver)
        simulated_s = drive()
        seconds = cpu_seconds({tier: drive}, rounds)[tier]
        name = f"{planner}, DynaBARN {tier}: simulated per CPU second"
        rows.append(row(name, "s/s", simulated_s / seconds))
    return rows


def _drive(courses: Sequence[Course], planner: Planner) -> float:
    """Drive all courses once; simulated time [s]."""
    return sum(run_episode(held, planner, 0, 0).sim_time_s for held in courses)
