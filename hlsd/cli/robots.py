"""`hlsd robots`: which robots there are, and how well they repeat a recording."""

from pathlib import Path
from typing import Annotated

import typer

from hlsd.cli.options import RobotOption
from hlsd.cli.output import JsonOption, answer
from hlsd.core.text import one_line

app = typer.Typer(help="List the simulated robots; compare one with a recording.")


@app.callback()
def robots() -> None:
    """List the simulated robots; compare one with a recording."""


@app.command("list")
def list_robots(as_json: JsonOption = False) -> None:
    """List the robots, built in or installed: name, version, what each is."""
    from hlsd.sim.robots import robots

    found = list(robots.usable().values())
    data = {
        "robots": [
            {"name": robot.name, "version": robot.version, "summary": robot.summary}
            for robot in found
        ]
    }
    rows = [
        (robot.name, f"{one_line(robot.version):<3} {one_line(robot.summary)}")
        for robot in found
    ]
    answer(as_json, data, rows=rows)
    for fault in robots.faults():  # one broken plug-in must not hide the others
        typer.echo(f"hlsd: {fault}", err=True)


@app.command("validate")
def validate(
    log: Annotated[
        Path,
        typer.Argument(
            help="The recording: .npz of `hlsd collect` (poses, commands, period_s); "
            ".npz with pos, ori (x, y, z, w), cmd_vel, cmd_ang_vel at 50 Hz or with "
            "rate_hz or t; or .csv with the columns t,x,y,yaw,v_cmd,omega_cmd."
        ),
    ],
    robot: RobotOption = "jackal",
    as_json: JsonOption = False,
) -> None:
    """Replay a recording's commands; report the pose error after 1 s and the gains.

    Windows open every 0.1 s at recorded poses; the commands before a window bring the
    robot to the velocity it starts with. Gains are taken where the command has stood
    for 0.6 s, with speeds up to 1 m/s and, for turning, yaw rates of 0.2 to 1 rad/s.
    """
    from hlsd.report.robot_table import robot_text
    from hlsd.sim.robot_log import load_robot_log
    from hlsd.sim.robots import get_robot
    from hlsd.sim.validation import validate_robot

    result = validate_robot(get_robot(robot), load_robot_log(log))
    answer(as_json, result.as_json(), robot_text(result))
