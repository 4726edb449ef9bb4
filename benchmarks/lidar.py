"""The closed form of the lidar against MuJoCo's own ray casting."""

import math

import mujoco
import numpy as np

from benchmarks.timing import Row, cpu_seconds, row
from hlsd.core.description import LidarSpec
from hlsd.data.worlds import load_suite
from hlsd.sim.lidar import Lidar
from hlsd.sim.mjcf import build_model
from hlsd.sim.robots import get_robot

WORLDS = range(0, 300, 50)
POSES_PER_WORLD = 10


def lidar(max_range_m: float, rounds: int) -> list[Row]:
    """Rays per second of `Lidar.scan` and of `mujoco.mj_multiRay`, and their ratio.

    Scans of 720 beams at random poses anywhere in six worlds, obstacles included.

    Args:
        max_range_m: Of the sensor [m].
        rounds: Each scans once at every pose, in both ways.
    """
    places = _places(LidarSpec(max_range_m=max_range_m))
    seconds = cpu_seconds(
        {
            "closed": lambda: [sensor.scan(data) for sensor, data in places],
            "mujoco": lambda: [sensor.multi_ray(data) for sensor, data in places],
        },
        rounds,
    )
    rays = sum(sensor.spec.beams for sensor, _ in places)
    label = f"lidar, {max_range_m:g} m"
    return [
        row(f"{label}: closed form", "Mrays/s", rays / seconds["closed"] / 1e6),
        row(f"{label}: mj_multiRay", "Mrays/s", rays / seconds["mujoco"] / 1e6),
        row(f"{label}: faster by", "x", seconds["mujoco"] / seconds["closed"]),
    ]


def _places(spec: LidarSpec) -> list[tuple[Lidar, mujoco.MjData]]:
    """Sensors at random poses, positions of all geoms computed."""
    suite, robot = load_suite("barn300"), get_robot("jackal")
    rng = np.random.default_rng(0)
    places = []
    for index in WORLDS:
        model = build_model(robot, suite[index].cylinders_xy())
        sensor = Lidar(model, spec)
        assert sensor.closed_form
        for _ in range(POSES_PER_WORLD):
            data = mujoco.MjData(model)
            yaw = rng.uniform(-math.pi, math.pi)
            data.qpos[:2] = rng.uniform((-4.5, 0.0), (0.0, 10.0))
            data.qpos[2] = model.key("home").qpos[2]
            data.qpos[3:7] = math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)
            mujoco.mj_forward(model, data)
            places.append((sensor, data))
    return places
