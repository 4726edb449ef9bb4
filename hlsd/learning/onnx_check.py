"""An exported policy against hlsd's own forward pass, on scans of the benchmark."""

import math
from typing import NamedTuple

import mujoco
import numpy as np

from hlsd.core.description import LidarSpec
from hlsd.core.errors import HlsdError
from hlsd.core.geometry import frame_at, into_frame
from hlsd.core.types import FloatArray
from hlsd.data.worlds import load_suite
from hlsd.learning.onnx_policy import BOUND, EXTRA, GOAL, RANGES, min_range_m
from hlsd.learning.policy import GOAL_INPUTS, Policy
from hlsd.sim.lidar import Lidar
from hlsd.sim.mjcf import build_model
from hlsd.sim.robots import get_robot

WORLDS = range(0, 300, 60)
"""Of barn300, whose scans are shown to both."""
_POSES = 40
_GOAL_M = 1.0


class Difference(NamedTuple):
    """How far an exported policy is from hlsd's forward pass.

    Attributes:
        speed: The most on any scan [m/s].
        yaw_rate: Likewise [rad/s].
        scans: Number of scans.
    """

    speed: float
    yaw_rate: float
    scans: int


def check_export(policy: Policy, data: bytes) -> Difference:
    """Run an exported policy and hlsd's own on the same scans.

    Args:
        policy: The policy.
        data: Bytes of the ONNX file.

    Raises:
        HlsdError: They differ by more than `BOUND`, or the package onnxruntime is not
            installed.
    """
    try:
        import onnxruntime
    except ImportError as error:
        raise HlsdError(
            "an exported policy is checked by the package onnxruntime, which is not "
            f"here: {EXTRA}"
        ) from error
    scans, goals = seen(policy.lidar, policy.inputs - GOAL_INPUTS)
    single = scans.astype(np.float32), goals.astype(np.float32)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    session = onnxruntime.InferenceSession(
        data, options, providers=["CPUExecutionProvider"]
    )
    (found,) = session.run(None, dict(zip((RANGES, GOAL), single, strict=True)))
    ours = np.array([_forward(policy, *pair) for pair in zip(*single, strict=True)])
    apart = np.abs(np.asarray(found, dtype=np.float64) - ours).max(axis=0)
    held = Difference(float(apart[0]), float(apart[1]), len(scans))
    if not max(held[:2]) <= BOUND:
        raise HlsdError(
            f"the exported policy differs from hlsd's by {held.speed:.2g} m/s and "
            f"{held.yaw_rate:.2g} rad/s, more than {BOUND:g}: nothing is written; its "
            "weights are too large for float32"
        )
    return held


def seen(lidar: LidarSpec, beams: int) -> tuple[FloatArray, FloatArray]:
    """Scans and local goals on the way through worlds of barn300, and odd ones.

    Args:
        lidar: The sensor.
        beams: How many beams the policy takes.

    Returns:
        Scans ``(n, beams)`` [m] and goals ``(n, 2)`` in base_link [m].
    """
    rng, robot = np.random.default_rng(0), get_robot("jackal")
    scans, goals = [], []
    for index in WORLDS:
        world = load_suite("barn300")[index]
        model = build_model(robot, world.shapes)
        data, sensor = mujoco.MjData(model), Lidar(model, lidar)
        path = world.path_xy()
        for k in np.linspace(0, len(path) - 2, _POSES).astype(int):
            x, y = path[k]
            distant = np.hypot(*(path[k:] - path[k]).T) >= _GOAL_M
            goal = path[k + int(distant.argmax())] if distant.any() else path[-1]
            yaw = math.atan2(goal[1] - y, goal[0] - x) + rng.normal(0.0, 0.7)
            mujoco.mj_resetDataKeyframe(model, data, model.key("home").id)
            data.qpos[:2] = x, y
            data.qpos[3:7] = math.cos(yaw / 2), 0.0, 0.0, math.sin(yaw / 2)
            mujoco.mj_forward(model, data)
            scans.append(sensor.measure(data, rng))
            goals.append(into_frame(goal[0], goal[1], frame_at(x, y, yaw)))
    odd = rng.uniform(0.0, 2.0, (len(_ODD_GOALS), beams))
    odd[:, ::7], odd[:, 1::7] = 0.0, math.inf  # no return, as drivers tell it
    return np.vstack([np.array(scans), odd]), np.vstack([np.array(goals), _ODD_GOALS])


# Where directions are special: ahead, beside, behind, here, near and far.
_ODD_GOALS = np.array(
    [
        (1.0, 0.0),
        (0.0, 1.0),
        (0.0, -1.0),
        (-1.0, 1e-3),
        (-1.0, -1e-3),
        (0.0, 0.0),
        (1e-30, -1e-30),
        (1e30, 1e30),
    ]
)


def _forward(policy: Policy, scan: FloatArray, goal: FloatArray) -> tuple[float, float]:
    """What hlsd's planners make of a scan and a goal, by the words of `Policy`."""
    values = np.empty(policy.inputs, dtype=np.float32)
    none = scan < min_range_m(policy)
    values[:-2] = np.where(none, policy.clip_m, np.minimum(scan, policy.clip_m))
    most = policy.goal_bearing_rad
    bearing = min(max(math.atan2(goal[1], goal[0]), -most), most)
    values[-2:] = math.cos(bearing), math.sin(bearing)
    return policy.forward(values)
