"""Hallucination against geometry done another way."""

import dataclasses
import itertools
import math

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hlsd.core.description import LidarSpec
from hlsd.core.errors import HlsdError
from hlsd.data.motion_log import MotionLog
from hlsd.learning.hallucination import (
    Hallucination,
    Kind,
    OffsetOrder,
    beam_limits,
    hallucinate,
    most_constrained_scan,
    offset_m,
    segments,
    windows,
)
from hlsd.learning.scan_walk import key_of, walk
from hlsd.learning.tube import FreeStretches, into_base

PAPER = Hallucination()
NARROW = Hallucination(side_offset_m=0.215)
LIDAR_X = LidarSpec().mount_in_base[0]
ANGLES = LidarSpec().angles_rad()


def drive(commands, period_s=0.04):
    """Poses of an ideal unicycle from the origin, one more than commands."""
    poses = [np.zeros(3)]
    for v, w in commands:
        x, y, yaw = poses[-1]
        turn = w * period_s
        chord = v * period_s * np.sinc(turn / 2 / np.pi)
        poses.append(
            np.array(
                [
                    x + chord * np.cos(yaw + turn / 2),
                    y + chord * np.sin(yaw + turn / 2),
                    yaw + turn,
                ]
            )
        )
    return np.array(poses)


def random_motion(seed, largest_turn=1.6):
    """A window as it comes from a log: poses, yaw rates, index of the goal."""
    rng = np.random.default_rng(seed)
    commands = []
    while True:
        v, w = rng.uniform(0.1, 1.0), rng.uniform(-largest_turn, largest_turn)
        w = 0.0 if rng.random() < 0.2 else w
        commands += [(v, w)] * int(rng.integers(3, 30))
        poses = drive(commands)
        goals, ends = windows(poses, 1, PAPER)
        if ends[0] >= 0:
            end = int(ends[0])
            rates = np.array([*(w for _, w in commands), 0.0])
            return poses[: end + 1], rates[: end + 1], int(goals[0])


def seen_from_first(poses):
    """Poses in the frame of the first of them, yaw not wrapped."""
    result = np.empty((len(poses), 3))
    into_base(poses, 0, len(poses), result)
    return result


def sample_scan(limits, speed, hallucination, *, seed, point=0, number=0):
    """One ordinary scan, as `hallucinate` draws it."""
    scan = np.empty(len(limits.min_m))
    walk(
        FreeStretches(limits.min_m, limits.later_m, limits.later_count),
        limits.max_m,
        offset_m(speed, hallucination),
        hallucination.rules(),
        np.uint64(key_of(np.uint64(seed), np.uint64(point), np.uint64(number))),
        scan,
    )
    return scan


def footprint_points(pose, b):
    x, y, yaw = pose
    left = np.array([-math.sin(yaw), math.cos(yaw)])
    return np.array([x, y]) + b * left, np.array([x, y]) - b * left


def depth_in_tube(points, poses, hallucination):
    """How deep each point is inside the best piece of the tube; <= 0 is outside.

    By half planes: a rectangle is four of them; the strip between two poses is what
    the line between the footprint points sweeps, one convex piece or, when that line
    turns about one of its own points, two triangles.
    """
    h = hallucination
    best = np.full(len(points), -np.inf)
    for pose in poses:
        c, s = math.cos(pose[2]), math.sin(pose[2])
        dx, dy = points[:, 0] - pose[0], points[:, 1] - pose[1]
        ahead, left = np.abs(c * dx + s * dy), np.abs(c * dy - s * dx)
        depth = np.minimum(h.half_length_m - ahead, h.half_width_m - left)
        best = np.maximum(best, depth)
    for first, second in itertools.pairwise(poses):
        l0, r0 = footprint_points(first, h.side_offset_m)
        l1, r1 = footprint_points(second, h.side_offset_m)
        crossing = crossing_of(l0, r0, l1, r1)
        pieces = [(l0, l1, r1, r0)]
        if crossing is not None:
            pieces = [(l0, l1, crossing), (r0, r1, crossing)]
        for piece in pieces:
            best = np.maximum(best, depth_in_convex(points, piece))
    return best


def crossing_of(a, b, c, d):
    """Where the segments a b and c d cross, or None."""
    system = np.column_stack([b - a, c - d])
    if abs(np.linalg.det(system)) < 1e-15:
        return None
    u, v = np.linalg.solve(system, c - a)
    return a + u * (b - a) if 0.0 <= u <= 1.0 and 0.0 <= v <= 1.0 else None


def depth_in_convex(points, corners):
    corners = np.array(corners)
    area = 0.0
    for p, q in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        area += p[0] * q[1] - p[1] * q[0]
    depth = np.full(len(points), np.inf)
    for p, q in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        side = q - p
        length = np.linalg.norm(side)
        if length < 1e-12:
            continue
        left = side[0] * (points[:, 1] - p[1]) - side[1] * (points[:, 0] - p[0])
        depth = np.minimum(depth, np.sign(area) * left / length)
    return depth


def on_beams(ranges, angles=ANGLES):
    return np.column_stack([LIDAR_X + ranges * np.cos(angles), ranges * np.sin(angles)])


@pytest.mark.parametrize("hallucination", [PAPER, NARROW], ids=["wide", "narrow"])
@pytest.mark.parametrize("motion", [*range(6), "loop", "turn back", "spin"])
def test_beams_leave_and_enter_the_tube_where_half_planes_say(motion, hallucination):
    if isinstance(motion, int):
        poses, rates, goal = random_motion(motion)
    else:
        # Tighter than the footprint, so that strips are two triangles, and reaching
        # behind the robot, where the field of view ends.
        poses = drive(
            {
                "loop": [(0.5, 1.6)] * 100,
                "turn back": [(0.3, 1.57)] * 45 + [(0.8, 0.1)] * 45,
                "spin": [(0.0, 3.0)] * 30 + [(0.6, 0.0)] * 30 + [(0.02, 2.0)] * 40,
            }[motion]
        )
        rates, goal = np.ones(len(poses)), len(poses) - 1
    limits = beam_limits(poses, rates, goal, hallucination)
    # Along every beam: where it is in the tube, just before and behind L_min too.
    marks = [np.full(720, t) for t in np.linspace(0.005, 0.995, 40)]
    marks += [limits.min_m - 1e-5, np.where(limits.min_m < 1.0, limits.min_m, 0) + 1e-5]
    depth = depth_in_tube(
        np.concatenate([on_beams(t) for t in marks]), poses, hallucination
    ).reshape(-1, 720)
    for t, inside in zip(marks, depth, strict=True):
        claimed = t < limits.min_m
        for k in range(limits.later_m.shape[1]):
            start, end = limits.later_m[:, k, 0], limits.later_m[:, k, 1]
            claimed |= (k < limits.later_count) & (start < t) & (t < end)
        clear = np.abs(inside) > 1e-7
        assert clear.mean() > 0.97
        np.testing.assert_array_equal(claimed[clear], inside[clear] > 0)


@settings(max_examples=25, deadline=None)
@given(seed=st.integers(0, 2**32), speed=st.floats(0.0, 1.0), narrow=st.booleans())
def test_samples_lie_between_the_limits_and_outside_the_sweep(seed, speed, narrow):
    hallucination = NARROW if narrow else PAPER
    poses, rates, goal = random_motion(seed)
    limits = beam_limits(poses, rates, goal, hallucination)
    assert (limits.min_m > 0.0).all()
    assert (limits.min_m <= limits.max_m).all()
    assert (limits.max_m <= 1.0).all()
    scan = sample_scan(limits, speed, hallucination, seed=seed)
    assert (limits.min_m <= scan).all()
    assert (scan <= limits.max_m).all()
    returns = on_beams(scan)[scan < 1.0]
    assert (depth_in_tube(returns, poses, hallucination) < 1e-9).all()


def test_readings_move_out_of_a_pocket_of_the_tube():
    # A hairpin: some beams leave the tube, cross the gap, and meet it again.
    poses = drive([(1.0, 0.0)] * 20 + [(0.8, 1.6)] * 50 + [(1.0, 0.0)] * 40)
    ends = windows(poses, 1, NARROW)[1]
    poses = poses[: ends[0] + 1]
    limits = beam_limits(poses, np.zeros(len(poses)), len(poses) - 1, NARROW)
    again = limits.later_count > 0
    assert again.sum() > 20
    start = limits.later_m[again, 0, 0]
    assert (start > limits.min_m[again]).all()
    moved = 0
    for number in range(50):
        scan = sample_scan(limits, 0.5, NARROW, seed=1, number=number)
        moved += np.isin(scan[again], limits.later_m[again, 0]).sum()
    assert moved > 20


def test_straight_motion_has_no_segment_and_sides_at_the_footprint():
    poses = drive([(0.8, 0.0)] * 60)
    rates = np.zeros(61)
    limits = beam_limits(poses, rates, 40, PAPER)
    assert len(segments(poses, rates, 40, PAPER)) == 0
    assert (limits.max_m == 1.0).all()
    np.testing.assert_allclose(limits.min_m, limits.min_m[::-1], atol=1e-12)
    side = LidarSpec(beams=3, fov_rad=math.pi)
    right, ahead, left = most_constrained_scan(
        poses, dataclasses.replace(PAPER, lidar=side)
    )
    assert right == pytest.approx(PAPER.side_offset_m, abs=1e-12)
    assert left == pytest.approx(PAPER.side_offset_m, abs=1e-12)
    assert ahead == 1.0
    # The end of the tube is no wall: every beam that ends before the clip ends at a
    # side or behind the axle.
    ends = on_beams(limits.min_m)[limits.min_m < 1.0]
    sides = np.isclose(np.abs(ends[:, 1]), PAPER.side_offset_m, atol=1e-9)
    assert (sides | (ends[:, 0] < 1e-9)).all()


def test_alone_the_robot_sees_its_own_rectangle():
    scan = most_constrained_scan(np.zeros((1, 3)), PAPER)
    c, s = np.cos(ANGLES), np.sin(ANGLES)
    ends = np.where(c > 0, PAPER.half_length_m, -PAPER.half_length_m)
    with np.errstate(divide="ignore"):
        expected = np.minimum((ends - LIDAR_X) / c, PAPER.half_width_m / np.abs(s))
    np.testing.assert_allclose(scan, expected, rtol=1e-12)


@pytest.mark.parametrize("radius", [0.7, 1.0, 2.0])
def test_constant_turn_equals_the_annulus(radius):
    # Ticks so short that the chords between footprint points are arcs to 1e-6 m.
    speed, b, step = 0.8, 0.3, 0.002
    h = dataclasses.replace(PAPER, side_offset_m=b, half_length_m=0.06)
    poses = drive([(speed, speed / radius)] * int(2.4 * radius / speed / step), step)
    rates = np.full(len(poses), speed / radius)
    goal = int(windows(poses, 1, h)[0][0])
    limits = beam_limits(poses, rates, goal, h)
    c, s = np.cos(ANGLES), np.sin(ANGLES)
    # Ray from (lidar_x, 0) against circles about (0, radius).
    along = -LIDAR_X * c + radius * s
    away = LIDAR_X**2 + radius**2
    outer = along + np.sqrt(along**2 - away + (radius + b) ** 2)
    under = along**2 - away + (radius - b) ** 2
    inner = np.where(
        (under > 0) & (along > 0), along - np.sqrt(np.maximum(under, 0)), np.inf
    )
    expected = np.minimum(np.minimum(outer, inner), 1.0)
    forward = np.abs(ANGLES) < 1.2  # others leave through the first axle line
    np.testing.assert_allclose(limits.min_m[forward], expected[forward], atol=2e-5)
    # The inner wall is on the left; only there are beams held in by a segment.
    held = limits.max_m < 1.0
    assert held.sum() > 5
    assert (ANGLES[held] > 0).all()
    slivers = segments(poses, rates, goal, h)
    from_centre = np.hypot(slivers[:, 0, 0], slivers[:, 0, 1] - radius)
    np.testing.assert_allclose(from_centre, radius - b, atol=1e-9)


@pytest.mark.parametrize("seed", range(6))
def test_mirrored_motion_mirrors_the_limits(seed):
    poses, rates, goal = random_motion(seed)
    mirrored = poses * np.array([1.0, -1.0, -1.0])
    limits = beam_limits(poses, rates, goal, PAPER)
    other = beam_limits(mirrored, -rates, goal, PAPER)
    # A beam that grazes a corner may fall on either side of it.
    for ours, theirs in ((limits.min_m, other.min_m), (limits.max_m, other.max_m)):
        assert np.mean(np.abs(ours - theirs[::-1]) > 1e-9) <= 1 / 720


def test_limits_do_not_depend_on_where_the_log_has_its_origin():
    poses, rates, goal = random_motion(3)
    c, s = math.cos(2.0), math.sin(2.0)
    moved = np.column_stack(
        [
            5.0 + c * poses[:, 0] - s * poses[:, 1],
            -3.0 + s * poses[:, 0] + c * poses[:, 1],
            # atan2 of a simulated robot wraps
            np.arctan2(np.sin(poses[:, 2] + 2.0), np.cos(poses[:, 2] + 2.0)),
        ]
    )
    limits = beam_limits(poses, rates, goal, PAPER)
    other = beam_limits(seen_from_first(moved), rates, goal, PAPER)
    np.testing.assert_allclose(limits.min_m, other.min_m, atol=1e-9)


def test_beam_0_points_to_the_right():
    poses = drive([(0.8, -1.0)] * 80)
    rates = np.full(81, -1.0)
    goals, ends = windows(poses, 1, PAPER)
    limits = beam_limits(poses[: ends[0] + 1], rates[: ends[0] + 1], goals[0], PAPER)
    held = np.flatnonzero(limits.max_m < 1.0)
    assert len(held) > 5
    assert held.max() < 360


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32))
def test_segments_are_reflections_of_footprint_points(seed):
    poses, rates, goal = random_motion(seed)
    sides = np.array([footprint_points(pose, 0.43) for pose in poses])
    for c_m, image in segments(poses, rates, goal, PAPER)[::5]:
        (m,), (side,) = np.nonzero(np.abs(sides[1:goal] - c_m).max(axis=2) < 1e-12)
        m += 1
        turn = np.sign(rates[m])
        assert side == (0 if turn > 0 else 1)
        c_c, c_g = sides[0, side], sides[m + 1, side]
        chord = c_g - c_c
        assert math.dist(c_c, image) == pytest.approx(math.dist(c_c, c_m), abs=1e-12)
        assert math.dist(c_g, image) == pytest.approx(math.dist(c_g, c_m), abs=1e-12)
        offside = np.array([-chord[1], chord[0]]) / np.linalg.norm(chord)
        assert abs((0.5 * (c_m + image) - c_c) @ offside) < 1e-12
        distance = abs((c_m - c_c) @ offside)
        assert math.dist(c_m, image) == pytest.approx(2 * distance, abs=1e-12)
        # The image lies on the inner side of the turn.
        assert turn * ((image - c_c) @ offside) > 0.0


def test_s_curves_are_left_out():
    # Left, then right: seen from the start the right-hand bend still bulges left.
    poses = drive([(0.8, 1.0)] * 15 + [(0.8, -1.0)] * 40)
    rates = np.array([1.0] * 15 + [-1.0] * 41)
    goal = int(windows(poses, 1, PAPER)[0][0])
    kept = len(segments(poses, rates, goal, PAPER))
    assert 0 < kept < goal - 1


@settings(max_examples=40, deadline=None)
@given(
    x=st.floats(0.2, 0.8),
    y=st.floats(0.02, 0.4),
    eps=st.floats(1e-4, 1e-2),
    side=st.sampled_from([-1.0, 1.0]),
)
def test_the_segment_makes_the_bend_optimal(x, y, eps, side):
    """The point robot of section III-A, with a visibility graph as the oracle."""
    c_c, c_g, c_m = np.zeros(2), np.array([1.0, 0.0]), np.array([x, -side * y])
    # The same triple by way of poses: footprint points at offset b on the inner side.
    b = 0.43
    h = dataclasses.replace(PAPER, side_offset_m=b)
    shift = np.array([0.0, -side * b])
    poses = np.array([[*(p + shift), 0.0] for p in (c_c, c_m, c_g)])
    ((first, image),) = segments(poses, np.array([0.0, side, 0.0]), 2, h)
    np.testing.assert_allclose(first, c_m, atol=1e-12)
    through = math.dist(c_c, c_m) + math.dist(c_m, c_g)
    straight = 1.0
    # Going round either end is equally long: c_m' is the mirror image.
    assert shortest(c_c, c_g, [(c_m, image)]) == pytest.approx(through, abs=1e-12)
    # Longer beyond c_m', and the way through c_m is the only shortest one.
    along = (image - c_m) / math.dist(image, c_m)
    prolonged = [(c_m, image + eps * along)]
    assert shortest(c_c, c_g, prolonged) == pytest.approx(through, abs=1e-12)
    assert shortest(c_c, c_g, prolonged, without=c_m) > through
    # A gap anywhere inside makes p no longer optimal.
    middle = 0.5 * (c_m + image)
    gap = 0.25 * math.dist(c_m, image) * along
    pieces = [(c_m, middle - gap), (middle + gap, image)]
    found = shortest(c_c, c_g, pieces)
    assert straight <= found < through


def shortest(start, goal, walls, without=None):
    """Length of the shortest path past open segments: a visibility graph."""
    nodes = [start, goal, *(end for wall in walls for end in wall)]
    if without is not None:
        nodes = [n for n in nodes if not np.allclose(n, without)]
    n = len(nodes)
    length = np.full((n, n), np.inf)
    for i, j in itertools.permutations(range(n), 2):
        if not any(blocks(nodes[i], nodes[j], *wall) for wall in walls):
            length[i, j] = math.dist(nodes[i], nodes[j])
    for k in range(n):
        length = np.minimum(length, length[:, k, None] + length[None, k, :])
    return length[0, 1]


def blocks(a, b, c, d):
    """Whether the open segments a b and c d cross."""

    def turn(p, q, r):
        return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])

    def beside(u, v):
        return u * v < -1e-18

    return beside(turn(a, b, c), turn(a, b, d)) and beside(turn(c, d, a), turn(c, d, b))


def test_offset_is_linear_in_the_speed():
    speeds = (0.0, 0.3, 0.65, 1.0, 2.0)
    offsets = [offset_m(v, PAPER) for v in speeds]
    assert offsets == pytest.approx([0.0, 0.0, 0.5, 1.0, 1.0], abs=1e-12)


def test_the_walk_starts_afresh_as_often_as_alpha_says():
    # Steps too small to be seen: every visible change is a fresh draw.
    h = dataclasses.replace(PAPER, small_step_m=1e-9, side_offset_m=0.01)
    limits = beam_limits(np.zeros((1, 3)), np.zeros(1), 0, h)
    wide = dataclasses.replace(
        limits, min_m=np.zeros(720), max_m=np.ones(720), later_count=limits.later_count
    )
    counts = [
        np.count_nonzero(
            np.abs(np.diff(sample_scan(wide, 0.0, h, seed=5, number=n))) > 1e-6
        )
        for n in range(400)
    ]
    mean, sd = 719 * 0.04, math.sqrt(719 * 0.04 * 0.96)
    assert np.mean(counts) == pytest.approx(mean, abs=4 * sd / 20)
    assert np.std(counts) == pytest.approx(sd, rel=0.15)


def test_steps_are_uniform_and_even_handed():
    h = dataclasses.replace(PAPER, small_step_m=1e-4)
    wide = dataclasses.replace(
        beam_limits(np.zeros((1, 3)), np.zeros(1), 0, h),
        min_m=np.zeros(720),
        max_m=np.ones(720),
    )
    steps = np.concatenate(
        [np.diff(sample_scan(wide, 0.0, h, seed=2, point=n)) for n in range(200)]
    )
    small = steps[np.abs(steps) <= 1e-4] / 1e-4
    assert len(small) > 100_000
    assert np.mean(small > 0) == pytest.approx(0.5, abs=0.01)
    quarters = np.histogram(np.abs(small), bins=4, range=(0, 1))[0] / len(small)
    np.testing.assert_allclose(quarters, 0.25, atol=0.01)


def test_the_offset_skews_readings_and_after_the_clamp_empties_them():
    poses, rates, goal = random_motion(1)
    limits = beam_limits(poses, rates, goal, PAPER)
    after = dataclasses.replace(PAPER, offset_order=OffsetOrder.AFTER_CLAMP)

    def mean(h, speed):
        return np.mean(
            [sample_scan(limits, speed, h, seed=0, number=n) for n in range(30)]
        )

    assert mean(PAPER, 0.3) < mean(PAPER, 0.6) < mean(PAPER, 1.0) < 0.97
    assert mean(after, 0.3) == mean(PAPER, 0.3)
    assert mean(after, 1.0) == pytest.approx(1.0, abs=1e-12)


def a_log(seed=0, ticks=260, points=150, speeds=(0.2, 1.0)):
    rng = np.random.default_rng(seed)
    commands = np.zeros((ticks, 2))
    for start in range(0, ticks, 13):
        commands[start : start + 13] = rng.uniform(*speeds), rng.normal(0, 0.6)
    return MotionLog(0.04, drive(commands[:-1]), commands, "u", "1", "{}", points)


def test_scans_of_a_log_are_those_of_its_points():
    log = a_log()
    result = hallucinate(log, PAPER, seed=7)
    assert result.scans.shape == (150 * 12, 720)
    goals, ends = windows(log.poses, log.points, PAPER)
    for k in range(0, 150, 11):
        poses = seen_from_first(log.poses[k : ends[k] + 1])
        limits = beam_limits(
            poses, log.commands[k : ends[k] + 1, 1].copy(), goals[k] - k, PAPER
        )
        for number in (0, 9):
            expected = sample_scan(
                limits, log.commands[k, 0], PAPER, seed=7, point=k, number=number
            )
            row = result.scans[12 * k + number]
            np.testing.assert_array_equal(row, expected.astype(np.float32))
        goal = poses[goals[k] - k, :2]
        assert np.linalg.norm(goal) >= 1.0
        np.testing.assert_allclose(
            result.goals_in_base[k], goal / np.linalg.norm(goal), atol=1e-12
        )
        np.testing.assert_array_equal(most_constrained_scan(poses, PAPER), limits.min_m)


def test_fast_points_get_an_empty_scan_and_slow_ones_the_most_constrained():
    log = a_log(speeds=(0.1, 1.0), ticks=700, points=400)
    scans = hallucinate(log, PAPER, seed=0).scans.reshape(400, 12, 720)
    constrained = hallucinate(
        log, dataclasses.replace(PAPER, kind=Kind.MOST_CONSTRAINED), seed=0
    ).scans
    assert constrained.shape == (400, 720)
    speeds = log.commands[:400, 0]
    empty = (scans == 1.0).all(axis=2)
    np.testing.assert_array_equal(empty[:, 10], speeds > 0.8)
    assert empty.mean() == pytest.approx(np.mean(speeds > 0.8) / 12)
    tight = (scans == constrained[:, None]).all(axis=2)
    np.testing.assert_array_equal(tight[:, 11], speeds < 0.3)
    assert tight.mean() == pytest.approx(np.mean(speeds < 0.3) / 12)
    assert 0 < np.mean(speeds < 0.3) < np.mean(speeds < 0.8) < 1
    assert (constrained[:, None] <= scans).all()


def test_any_number_of_threads_gives_the_same_bytes():
    log = a_log(seed=3)
    threads = numba.get_num_threads()
    try:
        numba.set_num_threads(1)
        alone = hallucinate(log, PAPER, seed=1).scans
    finally:
        numba.set_num_threads(threads)
    assert alone.tobytes() == hallucinate(log, PAPER, seed=1).scans.tobytes()
    assert alone.tobytes() != hallucinate(log, PAPER, seed=2).scans.tobytes()


def test_bad_input_is_one_clear_line():
    with pytest.raises(HlsdError, match=r"never get\s+1\.33 m away"):
        hallucinate(a_log(points=255), PAPER, seed=0)
    with pytest.raises(HlsdError, match="no data points"):
        hallucinate(a_log(points=0), PAPER, seed=0)
    with pytest.raises(HlsdError, match="seed"):
        hallucinate(a_log(), PAPER, seed=-1)
    with pytest.raises(HlsdError, match="poses"):
        most_constrained_scan(np.zeros((0, 3)), PAPER)
    with pytest.raises(HlsdError, match="finite"):
        most_constrained_scan(np.full((2, 3), np.nan), PAPER)
    with pytest.raises(HlsdError, match="goal"):
        segments(np.zeros((3, 3)), np.zeros(3), 3, PAPER)
    with pytest.raises(HlsdError, match="centre line"):
        Hallucination(lidar=LidarSpec(mount_in_base=(0.0, 0.1, 0.2)))
    with pytest.raises(HlsdError, match="alpha"):
        Hallucination(alpha=0.6)
