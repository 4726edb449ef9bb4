"""Fit the robot's drive and tyres to a recording.

    python scripts/calibrate_jackal.py LOG.npz --evaluations 300

Starts from the shipped `jackal`, fits on the first half of the log by Nelder-Mead
(scipy) and prints the parameters with their errors on both
halves. Nothing is written: a change of `hlsd/sim/robots.py` and `assets/jackal.xml` is
made by hand, with a new robot version, and the policies are made again.
"""

import argparse
import dataclasses
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

from hlsd.core.errors import HlsdError
from hlsd.sim.mjcf import build_model
from hlsd.sim.robot_log import RobotLog, load_robot_log
from hlsd.sim.robots import RobotDescription, get_robot
from hlsd.sim.simulator import Simulator
from hlsd.sim.validation import validate_robot

# What is fitted; all positive, so the search runs over their logarithms.
DRIVE = (
    "separation_multiplier",
    "delay_s",
    "time_constant_s",
    "turn_in_time_constant_s",
    "edge_onset_m_s2",
    "edge_full_m_s2",
)
TYRES = ("friction", "creep_damping_per_s")
# What an error of 1 s replays may be, and how far gains may stray [-, m].
ALLOWED = {"position": (0.03, 0.10), "heading": (1.5, 6.0)}
YAW_GAIN, YAW_GAIN_BAND = 1.35, 0.03
LATERAL_M, LATERAL_BAND_M = -0.131, 0.010


def main() -> None:
    """Fit on the first half, report on both."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("log", type=Path)
    parser.add_argument("--robot", default="jackal", help="where the search starts")
    parser.add_argument("--evaluations", type=int, default=300)
    given = parser.parse_args()
    start, log = get_robot(given.robot), load_robot_log(given.log)
    first, second = halves(log)
    found = minimize(
        lambda logarithms: misfit(changed(start, np.exp(logarithms)), first),
        np.log(values(start)),
        method="Nelder-Mead",
        options={"maxfev": given.evaluations, "xatol": 1e-3, "fatol": 1e-3},
    )
    fitted = changed(start, np.exp(found.x))
    for name, before, after in zip(
        names(start), values(start), values(fitted), strict=True
    ):
        print(f"{name:32} {before:9.4g} -> {after:9.4g}")
    for label, part in (("fitted half", first), ("other half", second)):
        for which, robot in (("before", start), ("after", fitted)):
            result = validate_robot(robot, part)
            position, heading = result.position_error_m, result.heading_error_deg
            print(
                f"{label}, {which:6}: position {position.median:.4f} "
                f"{position.p95:.4f} m, heading {heading.median:.3f} "
                f"{heading.p95:.3f} deg (median, 95th percentile)"
            )


def names(robot: RobotDescription) -> list[str]:
    """Names of the fitted parameters, in order."""
    tyres = [f"{tyre.pair_class} {name}" for tyre in robot.tyres for name in TYRES]
    return [*DRIVE, *tyres]


def values(robot: RobotDescription) -> list[float]:
    """A robot's fitted parameters, in the order of `names`."""
    drive = [getattr(robot.drive, name) for name in DRIVE]
    return drive + [getattr(tyre, name) for tyre in robot.tyres for name in TYRES]


def changed(robot: RobotDescription, parameters: np.ndarray) -> RobotDescription:
    """The robot with other parameters; the hard-turn multiplier keeps its ratio."""
    new = dict(zip(names(robot), parameters.tolist(), strict=True))
    drive = {name: new[name] for name in DRIVE}
    if (on_edge := robot.drive.separation_multiplier_on_edge) is not None:
        ratio = on_edge / robot.drive.separation_multiplier
        drive["separation_multiplier_on_edge"] = new["separation_multiplier"] * ratio
    return dataclasses.replace(
        robot,
        drive=dataclasses.replace(robot.drive, **drive),
        tyres=tuple(
            dataclasses.replace(
                tyre, **{name: new[f"{tyre.pair_class} {name}"] for name in TYRES}
            )
            for tyre in robot.tyres
        ),
    )


def misfit(robot: RobotDescription, log: RobotLog) -> float:
    """Errors over what they may be, and a penalty for gains outside their bands."""
    try:
        result = validate_robot(robot, log)
    except (HlsdError, ValueError):
        return 1e3  # parameters with which the robot cannot be simulated
    errors = (result.position_error_m, result.heading_error_deg)
    total = sum(
        error.median / median + error.p95 / p95
        for error, (median, p95) in zip(errors, ALLOWED.values(), strict=True)
    )
    for speed in (0.2, 0.6, 1.0):
        for yaw_rate in (0.2, 0.6, 1.0):
            yaw_gain, lateral_m = steady(robot, speed, yaw_rate)
            total += 30 * max(0.0, abs(yaw_gain - YAW_GAIN) - YAW_GAIN_BAND)
            total += 50 * max(0.0, abs(lateral_m - LATERAL_M) - LATERAL_BAND_M)
    return total if np.isfinite(total) else 1e3


def steady(
    robot: RobotDescription, speed: float, yaw_rate: float
) -> tuple[float, float]:
    """Yaw-rate gain and lateral velocity per yaw rate [m] in steady driving."""
    simulator = Simulator(build_model(robot, None), robot)
    simulator.advance(speed, yaw_rate, 1.5)
    velocities = []
    for _ in range(20):
        simulator.advance(speed, yaw_rate, 0.05)
        velocities.append(simulator.body_velocity)
    _, lateral, turning = np.mean(velocities, axis=0)
    return turning / yaw_rate, lateral / turning


def halves(log: RobotLog) -> tuple[RobotLog, RobotLog]:
    """The first and the second half of a log, in time."""
    middle = len(log.poses) // 2
    return (
        RobotLog(log.period_s, log.poses[:middle], log.commands[:middle]),
        RobotLog(log.period_s, log.poses[middle:], log.commands[middle:]),
    )


if __name__ == "__main__":
    main()
