"""Leaves obstacles out of MuJoCo's search for contacts while none can be touched.

More than half of a physics step among hundreds of cylinders is MuJoCo's search for
contacts, and in most steps nothing is within reach. What decides is where all are when
a step begins, since that is when MuJoCo looks. So before each step a lower bound of the
distance between robot and obstacles is taken in closed form. While it is above zero,
the bodies of the obstacles are hidden by their ``body_conaffinity`` and
``body_contype``, and MuJoCo finds the same contacts without them, those of the tyres.

The robot counts as an upright box around all of its geoms that may touch an obstacle,
in the frame of base_link. It moves by at most ``|shift| + 2 sin(angle / 2) R`` where R
is the distance of its farthest corner from base_link, so that the distance to hundreds
of obstacles is asked for only after the robot may have come near one.
"""

import math
from typing import NamedTuple

import mujoco
import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.types import FloatArray, IntArray
from hlsd.sim.mjcf import BASE, MOVER, OBSTACLES

SLACK_M = 1e-3
"""Nearer than this counts as touching [m]: far above what MuJoCo's solvers leave."""
_UPRIGHT = 1.0 - 1e-9


class Reach(NamedTuple):
    """A box around all of a robot that may touch obstacles, in the base's frame.

    Attributes:
        back: Least x [m].
        front: Largest x [m].
        right: Least y [m].
        left: Largest y [m].
        radius: Distance of its farthest corner from base_link [m].
    """

    back: float
    front: float
    right: float
    left: float
    radius: float


class Gate(NamedTuple):
    """What a world's gate needs; kernels take it.

    Attributes:
        reach: Of the robot.
        slack: Nearer than this counts as touching [m].
        discs: Obstacles as circles: x, y, radius, ``(n, 3)`` [m].
        boxes: As rectangles: x, y, cosine and sine of the yaw, half length, half
            width, ``(k, 6)`` [m].
        movers: Radius of the circle around each mover, ``(m,)`` [m].
        bodies: Body of what stands, or -1, and then of each mover, ``(1 + m,)``.
        shown: Their ``body_contype`` and ``body_conaffinity`` when they are not hidden,
            ``(1 + m, 2)``.
        near: A lower bound of the distance to what stands [m], and the pose for which
            it holds: x, y, and w and z of a quaternion around z, ``(5,)``. Changed.
    """

    reach: Reach
    slack: float
    discs: FloatArray
    boxes: FloatArray
    movers: FloatArray
    bodies: IntArray
    shown: IntArray
    near: FloatArray


def gate_of(model: mujoco.MjModel, movers: int) -> Gate:
    """The gate of a compiled model.

    Everything is read from the model, so that what a perturbation changes in it counts.
    Of a model whose robot has parts that no box bounds, nothing is ever hidden.

    Args:
        model: From `hlsd.sim.mjcf.build_model`.
        movers: How many it has.
    """
    still = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_BODY, OBSTACLES)
    moving = [model.body(f"{MOVER}{number:03d}").id for number in range(movers)]
    bodies = np.array([still, *moving], dtype=np.int64)
    contype, conaffinity = model.body_contype, model.body_conaffinity
    shown = np.array(
        [(contype[b], conaffinity[b]) if b >= 0 else (0, 0) for b in bodies.tolist()],
        dtype=np.int64,
    )
    data = _at_origin(model)
    discs, boxes, bounded = _outlines(model, data, still)
    radii = [_radius(model, body) for body in moving]
    reach = _reach(model, data, bodies, shown)
    if reach is None or not bounded or not all(map(math.isfinite, radii)):
        reach = Reach(-math.inf, math.inf, -math.inf, math.inf, math.inf)
    margins = np.sort(model.geom_margin)[-2:].sum() if model.ngeom else 0.0
    return Gate(
        reach=reach,
        slack=SLACK_M + float(margins),
        discs=discs,
        boxes=boxes,
        movers=np.array(radii, dtype=np.float64),
        bodies=bodies,
        shown=shown,
        near=np.array((-math.inf, 0.0, 0.0, 1.0, 0.0)),
    )


@compiled
def _show(
    j: int,
    visible: bool,
    bodies: IntArray,
    shown: IntArray,
    contype: IntArray,
    conaffinity: IntArray,
) -> None:
    contype[bodies[j]] = shown[j, 0] if visible else 0
    conaffinity[bodies[j]] = shown[j, 1] if visible else 0


@compiled
def show(gate: Gate, contype: IntArray, conaffinity: IntArray) -> None:
    """Let MuJoCo see all bodies again; both arrays are changed."""
    _, _, _, _, _, bodies, shown, _ = gate
    for j in range(bodies.size):
        if bodies[j] >= 0:
            _show(j, True, bodies, shown, contype, conaffinity)


@compiled
def hide(
    gate: Gate,
    qpos: FloatArray,
    places: FloatArray,
    contype: IntArray,
    conaffinity: IntArray,
) -> None:
    """Hide those bodies that cannot be touched in the step that begins now.

    Args:
        gate: Of the model; where the bound held last is noted in it.
        qpos: The robot's, x, y, z and a unit quaternion first, ``(nq,)``.
        places: Of the movers, x and y first, ``(m, 3)`` [m].
        contype: ``body_contype``; changed.
        conaffinity: ``body_conaffinity``; changed.
    """
    reach, slack, discs, boxes, movers, bodies, shown, near = gate
    x, y = qpos[0], qpos[1]
    w, qx, qy, z = qpos[3], qpos[4], qpos[5], qpos[6]
    if not math.isfinite(x + y + w + qx + qy + z):
        show(gate, contype, conaffinity)
        return
    # The turn around z nearest to the orientation: what remains of it is the tilt.
    length = math.sqrt(w * w + z * z)
    w0, z0 = (w / length, z / length) if length > 0.0 else (1.0, 0.0)
    tilt = 2.0 * math.sqrt(qx * qx + qy * qy) * reach[4]
    if bodies[0] >= 0:
        # Half of the angle to the pose that the bound is of has this cosine.
        cosine = w * near[3] + z * near[4]
        turned = 2.0 * math.sqrt(max(0.0, 1.0 - cosine * cosine)) * reach[4]
        moved = math.hypot(x - near[1], y - near[2]) + turned
        # A bound that is not a number, as where the reach is infinite, is near.
        apart = near[0] - moved > slack
        if not apart:
            near[0] = distance(reach, discs, boxes, (x, y, w0, z0))
            near[1], near[2], near[3], near[4] = x, y, w0, z0
            apart = near[0] - tilt > slack
        _show(0, not apart, bodies, shown, contype, conaffinity)
    c, s = w0 * w0 - z0 * z0, 2.0 * w0 * z0
    for j in range(movers.size):
        dx, dy = places[j, 0] - x, places[j, 1] - y
        away = _to_disc(reach, c * dx + s * dy, c * dy - s * dx) - movers[j]
        near_it = not away - tilt > slack
        _show(1 + j, near_it, bodies, shown, contype, conaffinity)


@compiled
def distance(
    reach: Reach,
    discs: FloatArray,
    boxes: FloatArray,
    pose: tuple[float, float, float, float],
) -> float:
    """A lower bound of the distance from the upright robot to what stands [m].

    Where all of that is discs, it is the distance itself, and 0 or less in contact.

    Args:
        reach: Of the robot.
        discs: As in `Gate`.
        boxes: As in `Gate`.
        pose: x, y, and w and z of a quaternion around z.
    """
    x, y, w, z = pose
    c, s = w * w - z * z, 2.0 * w * z
    least = math.inf
    for i in range(discs.shape[0]):
        dx, dy = discs[i, 0] - x, discs[i, 1] - y
        away = _to_disc(reach, c * dx + s * dy, c * dy - s * dx) - discs[i, 2]
        least = min(least, away)
    back, front, right, left = reach[0], reach[1], reach[2], reach[3]
    ahead, aside = (front + back) / 2, (left + right) / 2
    length, width = (front - back) / 2, (left - right) / 2
    for i in range(boxes.shape[0]):
        dx, dy = boxes[i, 0] - x, boxes[i, 1] - y
        # In the robot's frame, from the middle of its box.
        bx, by = c * dx + s * dy - ahead, c * dy - s * dx - aside
        bc, bs = c * boxes[i, 2] + s * boxes[i, 3], c * boxes[i, 3] - s * boxes[i, 2]
        half, wide = boxes[i, 4], boxes[i, 5]
        # The widest gap along the four directions of the sides.
        ac, as_ = abs(bc), abs(bs)
        away = abs(bx) - length - ac * half - as_ * wide
        away = max(away, abs(by) - width - as_ * half - ac * wide)
        away = max(away, abs(bc * bx + bs * by) - half - ac * length - as_ * width)
        away = max(away, abs(bc * by - bs * bx) - wide - as_ * length - ac * width)
        least = min(least, away)
    return least


@compiled
def _to_disc(reach: Reach, x: float, y: float) -> float:
    """From the robot's box to a point in the base's frame; 0 within [m]."""
    dx = max(reach[0] - x, 0.0, x - reach[1])
    dy = max(reach[2] - y, 0.0, y - reach[3])
    return math.sqrt(dx * dx + dy * dy)


def _at_origin(model: mujoco.MjModel) -> mujoco.MjData:
    """The model with base_link at the origin, so that the world is its frame."""
    data = mujoco.MjData(model)
    data.qpos[:] = model.key("home").qpos
    data.qpos[:7] = 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0
    mujoco.mj_kinematics(model, data)
    return data


def _outlines(
    model: mujoco.MjModel, data: mujoco.MjData, body: int
) -> tuple[FloatArray, FloatArray, bool]:
    """Discs and boxes of a body's geoms, and whether they bound all of them."""
    geoms = _geoms(model, [body] if body >= 0 else [])
    places, axes = data.geom_xpos[geoms], data.geom_xmat[geoms]
    sizes, kinds = model.geom_size[geoms], model.geom_type[geoms]
    upright = np.abs(axes[:, 8]) > _UPRIGHT
    flat = upright & (kinds == mujoco.mjtGeom.mjGEOM_BOX)
    turns = axes[flat][:, [0, 3]]
    turns /= np.hypot(turns[:, 0], turns[:, 1])[:, np.newaxis]
    radii = model.geom_rbound[geoms].copy()
    round_ = upright & (kinds == mujoco.mjtGeom.mjGEOM_CYLINDER)
    radii[round_] = sizes[round_, 0]
    discs = np.column_stack((places[~flat, :2], radii[~flat]))
    boxes = np.column_stack((places[flat, :2], turns, sizes[flat, :2]))
    return discs, boxes, bool((radii[~flat] > 0.0).all())


def _radius(model: mujoco.MjModel, body: int) -> float:
    """Of the circle around a body's geoms, seen from above; infinite for no bound."""
    radii = []
    for geom in _geoms(model, [body]):
        x, y, _ = model.geom_pos[geom].tolist()
        radius = float(model.geom_rbound[geom])
        upright = float(np.abs(model.geom_quat[geom][1:3]).max()) < 1e-9
        size = model.geom_size[geom]
        if upright and model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_CYLINDER:
            radius = float(size[0])
        elif upright and model.geom_type[geom] == mujoco.mjtGeom.mjGEOM_BOX:
            radius = math.hypot(*size[:2])
        radii.append(math.hypot(x, y) + radius if radius > 0.0 else math.inf)
    return max(radii, default=0.0)


def _reach(
    model: mujoco.MjModel, data: mujoco.MjData, bodies: IntArray, shown: IntArray
) -> Reach | None:
    """The box around what may touch these bodies; None where no box bounds it."""
    contype = int(np.bitwise_or.reduce(shown[:, 0], initial=0))
    conaffinity = int(np.bitwise_or.reduce(shown[:, 1], initial=0))
    base = model.body(BASE).id
    low, high = np.full(3, np.inf), np.full(3, -np.inf)
    others = [body for body in range(model.nbody) if body not in set(bodies.tolist())]
    for geom in _geoms(model, others):
        meets = (model.geom_contype[geom] & conaffinity) | (
            model.geom_conaffinity[geom] & contype
        )
        body = int(model.geom_bodyid[geom])
        # What is fixed to the world touches nothing that is.
        if not meets or model.body_weldid[body] == 0:
            continue
        bound = _bound(model, data, geom, base)
        if bound is None:
            return None
        low, high = np.minimum(low, bound[0]), np.maximum(high, bound[1])
    if not np.isfinite(low).all():
        return None
    farthest = float(np.linalg.norm(np.maximum(np.abs(low), np.abs(high))))
    (back, right, _), (front, left, _) = low.tolist(), high.tolist()
    return Reach(back, front, right, left, farthest)


def _bound(
    model: mujoco.MjModel, data: mujoco.MjData, geom: int, base: int
) -> tuple[FloatArray, FloatArray] | None:
    """Least and largest coordinates of a robot's geom however its joint turns.

    Returns:
        Two ``(3,)`` in the base's frame [m]; None for a part of no robot, or one that
        hangs on more than one hinge or on another joint.
    """
    joints: list[int] = []
    body = int(model.geom_bodyid[geom])
    while body != base:
        if body == 0:
            return None
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        joints += range(first, first + count)
        body = int(model.body_parentid[body])
    hinge = mujoco.mjtJoint.mjJNT_HINGE
    if len(joints) > 1 or any(model.jnt_type[joint] != hinge for joint in joints):
        return None
    axes = data.geom_xmat[geom].reshape(3, 3)
    middle, half = model.geom_aabb[geom][:3], model.geom_aabb[geom][3:]
    signs = np.array(np.meshgrid(*[(-1.0, 1.0)] * 3)).reshape(3, -1).T
    corners = data.geom_xpos[geom] + (middle + signs * half) @ axes.T
    radius = float(model.geom_rbound[geom])
    if radius <= 0.0:
        return None
    centre = data.geom_xpos[geom][np.newaxis]
    if not joints:
        return corners.min(axis=0), corners.max(axis=0)
    anchor, axis = data.xanchor[joints[0]], data.xaxis[joints[0]]
    boxed, balled = _swept(corners, anchor, axis), _swept(centre, anchor, axis)
    # Both hold what the geom sweeps, so what they have in common does.
    return (
        np.maximum(boxed[0], balled[0] - radius),
        np.minimum(boxed[1], balled[1] + radius),
    )


def _swept(
    points: FloatArray, anchor: FloatArray, axis: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Least and largest coordinates of points ``(n, 3)`` that turn around an axis."""
    arms = points - anchor
    along = (arms @ axis)[:, np.newaxis] * axis
    radii = np.linalg.norm(arms - along, axis=1)[:, np.newaxis]
    spread = radii * np.sqrt(np.maximum(0.0, 1.0 - axis**2))
    middle = anchor + along
    return (middle - spread).min(axis=0), (middle + spread).max(axis=0)


def _geoms(model: mujoco.MjModel, bodies: list[int]) -> list[int]:
    """Geoms of some bodies."""
    return np.flatnonzero(np.isin(model.geom_bodyid, bodies)).tolist()
