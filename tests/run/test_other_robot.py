"""Another body drives the benchmark without a line about it outside its description."""

import csv
from dataclasses import replace

import pytest
from typer.testing import CliRunner

from hlsd.cli.app import app
from hlsd.core.description import LidarSpec, Outline
from hlsd.core.errors import HlsdError
from hlsd.data.worlds import load_suite
from hlsd.planners.registry import make_planner
from hlsd.run.bench import Bench, resolve
from hlsd.run.episode import Course, Outcome, run_episode
from hlsd.run.protocol import HLSD2021
from hlsd.sim.robots import get_robot

WORLD = 36  # among the widest of barn300


def test_bench_drives_the_disc_to_the_goal(tmp_path):
    out = tmp_path / "run"
    command = ["bench", "--planner", "hlsd10", "--planner", "dwa", "--robot", "disc"]
    command += ["--worlds", str(WORLD), "--trials", "1", "--out", str(out)]
    result = CliRunner().invoke(app, command, catch_exceptions=False)
    assert result.exit_code == 0, result.output
    with (out / "episodes.csv").open(newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["planner"] for row in rows] == ["hlsd10", "dwa"]
    for row in rows:
        assert (row["robot"], row["outcome"]) == ("disc", "success")
        assert row["contacts"] == "0"
        assert float(row["min_clearance_m"]) > 0.0
    result = CliRunner().invoke(app, ["report", str(out)], catch_exceptions=False)
    assert result.exit_code == 0, result.output
    (page,) = tmp_path.glob("*/report.html")
    assert '"corner_radius_m":0.3' in page.read_text(encoding="utf-8")


def test_a_course_takes_everything_from_the_robot():
    robot, world = get_robot("disc"), load_suite("barn300")[WORLD]
    course = Course(world, robot, HLSD2021)
    setup = course.setup(0)
    assert (setup.limits, setup.lidar) == (robot.limits, robot.lidar)
    assert setup.footprint == robot.footprint
    assert course.lidar.spec == robot.lidar
    assert course.navigator.costmap.spec.inscribed_radius_m == 0.3 + 0.1


def test_the_shortest_way_of_a_wider_robot_is_longer():
    world = load_suite("barn300")[120]
    ways = [
        Course(world, get_robot(name), HLSD2021).shortest_length_m
        for name in ("jackal", "disc")
    ]
    assert ways[0] + 0.05 < ways[1]


def test_a_policy_for_another_lidar_is_refused_in_one_line():
    coarse = replace(get_robot("disc"), lidar=LidarSpec(360, mount_in_base=(0, 0, 0.2)))
    bench = Bench(("hlsd10",), worlds=str(WORLD), robot=coarse)
    with pytest.raises(HlsdError, match="720 beams, and the robot's lidar has 360"):
        resolve(bench)


def test_a_robot_needs_no_name_in_the_registry():
    """A disc that its navigation stack takes for a square is another robot."""
    square = replace(
        get_robot("disc"), name="square-disc", footprint=Outline(0.25, 0.25)
    )
    course = Course(load_suite("barn300")[WORLD], square, HLSD2021)
    episode = run_episode(course, make_planner("hlsd10"), seed=0, trial=0)
    assert episode.outcome is Outcome.SUCCESS
