"""Fit the kinematic Jackal to the simulated one.

    python scripts/fit_kinematic_jackal.py --evaluations 2000

Drives random commands in the simulator, fits the numbers of
`hlsd.core.response.Response` on them by Nelder-Mead (scipy), starting from those in
use, and prints how far both are apart after 0.2 s and 1 s: on the commands of the fit,
and on others that were not used for it. With ``--evaluations 0`` it only reports.
Nothing is written: `hlsd/core/response.py` is changed by hand.
"""

import argparse

import numpy as np
from scipy.optimize import minimize

from hlsd.core.compiled import compiled
from hlsd.core.geometry import poses_in_frames
from hlsd.core.response import STATE, TIMESTEP_S, Ramp, Response, respond
from hlsd.core.types import FloatArray
from hlsd.envs.kinematics import FITTED, ramp, response_of, with_drive
from hlsd.sim.mjcf import build_model
from hlsd.sim.robots import get_robot
from hlsd.sim.simulator import Simulator

PERIOD_S = 0.05
WINDOWS = {"0.2 s": 4, "1 s": 20}
"""Ticks after which poses are compared."""
ROBOT = get_robot("jackal")

# Of the errors that the fit weighs: median and 95th percentile, position [m] and
# heading [deg], for each window.
ALLOWED = {"0.2 s": (0.005, 0.02, 0.7, 3.0), "1 s": (0.02, 0.08, 2.0, 8.0)}


def main() -> None:
    """Fit, and report on commands that were not used."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--evaluations", type=int, default=2000)
    given = parser.parse_args()
    driven = [commands(1, 6000, 2.0, 3.0)]
    driven += [commands(2, 4000, 2.0, 3.0), commands(3, 4000, 1.0, 1.5)]
    poses = [simulate(each) for each in driven]
    start = np.array([getattr(response_of(ROBOT), name) for name in FITTED])
    fitted = start
    for _ in range(3 if given.evaluations else 0):
        before = fitted
        found = minimize(
            lambda shares, before=before: misfit(before * shares, driven[0], poses[0]),
            np.ones(len(start)),
            method="Nelder-Mead",
            options={"maxfev": given.evaluations // 3, "adaptive": True},
        )
        fitted = before * found.x
    for name, one, other in zip(FITTED, start, fitted, strict=True):
        print(f"{name:20} {one:9.4g} -> {other:9.4g}")
    labels = ("commands of the fit", "others like them", "others, to 1 m/s, 1.5 rad/s")
    for label, command, pose in zip(labels, driven, poses, strict=True):
        found = errors(fitted, command, pose)
        for window, values in found.items():
            print(
                f"{label}, after {window}: position {values[0]:.4f} {values[1]:.4f} m, "
                f"heading {values[2]:.2f} {values[3]:.2f} deg (median, 95th percentile)"
            )


def commands(seed: int, count: int, speed: float, yaw_rate: float) -> FloatArray:
    """Random commands, held for 0.1 to 1.2 s, half of them noisy, ``(count, 2)``.

    Args:
        seed: Of the draw.
        count: How many.
        speed: Largest [m/s]; the robot also reverses, to 0.5 m/s.
        yaw_rate: Largest [rad/s]; speed times yaw rate stays below 2 m/s^2.
    """
    rng = np.random.default_rng(seed)
    low, high = np.array((-0.5, -yaw_rate)), np.array((speed, yaw_rate))
    found: list[FloatArray] = []
    while len(found) < count:
        wanted = rng.uniform(low, high)
        wanted[rng.integers(2)] *= rng.random() > 0.2
        noise = (rng.random() < 0.5) * np.array((0.1, 0.3))
        for _ in range(rng.integers(2, 25)):
            each = np.clip(wanted + noise * rng.standard_normal(2), low, high)
            if abs(each[0] * each[1]) < 2.0:
                found.append(each)
    return np.array(found[:count])


def simulate(commands: FloatArray) -> FloatArray:
    """Poses of the simulated Jackal before and after each command, ``(n + 1, 3)``."""
    simulator = Simulator(build_model(ROBOT, None), ROBOT)
    poses = [np.zeros(3)]
    for speed, yaw_rate in commands.tolist():
        simulator.advance(speed, yaw_rate, PERIOD_S)
        poses.append(simulator.pose)
    return unwrapped(np.array(poses))


def unwrapped(poses: FloatArray) -> FloatArray:
    """Poses whose yaw goes on beyond pi; changed in place."""
    poses[:, 2] = np.unwrap(poses[:, 2])
    return poses


def imitate(fitted: FloatArray, commands: FloatArray) -> FloatArray:
    """Likewise of the kinematic one."""
    poses = np.zeros((len(commands) + 1, 3))
    steps = round(PERIOD_S / TIMESTEP_S)
    _drive(commands, steps, ramp(ROBOT), with_drive(ROBOT, fitted), poses)
    return poses


@compiled
def _drive(
    commands: FloatArray, steps: int, by: Ramp, response: Response, poses: FloatArray
) -> None:
    state = np.zeros(STATE)
    for i in range(commands.shape[0]):
        for _ in range(steps):
            respond((commands[i, 0], commands[i, 1]), by, response, state)
        poses[i + 1] = state[:3]


def errors(
    fitted: FloatArray, commands: FloatArray, poses: FloatArray
) -> dict[str, tuple[float, ...]]:
    """Median and 95th percentile of both errors, for each window."""
    imitated = imitate(fitted, commands)
    found = {}
    for window, ticks in WINDOWS.items():
        moved = poses_in_frames(poses[ticks:], poses[:-ticks])
        off = poses_in_frames(imitated[ticks:], imitated[:-ticks]) - moved
        apart = np.hypot(off[:, 0], off[:, 1]), np.degrees(np.abs(off[:, 2]))
        found[window] = tuple(
            value for each in apart for value in np.percentile(each, (50, 95)).tolist()
        )
    return found


def misfit(fitted: FloatArray, commands: FloatArray, poses: FloatArray) -> float:
    """Errors over what they may be."""
    total = sum(
        value / allowed
        for window, values in errors(fitted, commands, poses).items()
        for value, allowed in zip(values, ALLOWED[window], strict=True)
    )
    return total if np.isfinite(total) else 1e6


if __name__ == "__main__":
    main()
