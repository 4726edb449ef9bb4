"""Shapes and numbers from outside: refused at the entrance, never trusted by a kernel.

A kernel checks no index, so that an array of another size would be read and written
beyond its end.
"""

import itertools
import json
import math
import zlib
from dataclasses import replace

import numpy as np
import pytest

from hlsd.analysis.statistics.resampling import resampled_sums
from hlsd.core.compiled import bare
from hlsd.core.description import LidarSpec, Outline
from hlsd.core.errors import HlsdError
from hlsd.data.motion_log import MotionLog
from hlsd.learning import hallucination as imagining
from hlsd.learning.hallucination import Hallucination
from hlsd.learning.policy import Policy, shipped_policy
from hlsd.learning.scan_walk import Drive, HallucinatedScans, imagine
from hlsd.learning.segments import find_first_hits, find_segments
from hlsd.learning.tube import LATER, FreeStretches, find_free_stretches
from hlsd.navigation.costmap import Costmap
from hlsd.navigation.footprint import Footprint, corner_cells, covered_cells
from hlsd.planners import contract
from hlsd.planners.base import Setup
from hlsd.planners.dwa.cheapest import heap_up
from hlsd.planners.dwa.plan_grid import plan_cells, sum_up, take_plan
from hlsd.planners.dwa.wave import begin, make_wave
from hlsd.planners.learned.controller import fill_input
from hlsd.planners.learned.lfh import poses_along, smoothed
from hlsd.planners.learned.safety import path_direction
from hlsd.planners.mppi import critics
from hlsd.planners.mppi.batch import make_batch, normal_quantiles, roll_out
from hlsd.planners.mppi.control import constrain, shift, smooth, update
from hlsd.planners.mppi.inflation import inflate
from hlsd.planners.mppi.outlines import make_outlines
from hlsd.planners.pursuit import length_left, lookahead_point
from hlsd.planners.registry import AT_HAND, BUILT_IN, FLOOR, make_planner
from hlsd.planners.vfh.histogram import binary, candidates, gather, mask, primary
from hlsd.planners.vfh.tree import best_direction, free_way
from hlsd.run import trajectory
from hlsd.run.clearance import cylinder_clearances
from hlsd.run.recording import simplified
from hlsd.run.trajectory import decode
from hlsd.sim.ray_casting import EXACT, Sensor, Surfaces, add_noise, cast, place_sensor

LEARNED = [name for name, entry in BUILT_IN.items() if entry.needs_policy]
WIDTHS = (0, 1, 2, 3, 100, 720, 721, 723, 2000)


def policy_file(path, planner, weights, biases, **changes):
    """A file with the provenance of the shipped policy and other layers."""
    with np.load(shipped_policy(BUILT_IN[planner].trained_as)) as held:
        arrays = dict(held)
    for k in range(int(arrays["layers"])):
        del arrays[f"weight_{k}"], arrays[f"bias_{k}"]
    arrays["layers"] = np.array(len(weights))
    arrays |= {f"weight_{k}": weight for k, weight in enumerate(weights)}
    arrays |= {f"bias_{k}": bias for k, bias in enumerate(biases)}
    np.savez(path, **(arrays | changes))
    return path


def layers(*sizes):
    weights = [np.full(s, 1e-3, np.float32) for s in itertools.pairwise(sizes)]
    return weights, [np.zeros(n, np.float32) for n in sizes[1:]]


def silent():
    """A provenance that names the planner and nothing else."""
    return np.array('{"planner": "hlsd10"}')


@pytest.mark.parametrize("planner", LEARNED)
@pytest.mark.parametrize("inputs", WIDTHS)
def test_a_policy_of_another_width_is_refused(tmp_path, planner, inputs):
    file = policy_file(tmp_path / "p.npz", planner, *layers(inputs, 8, 2))
    with pytest.raises(HlsdError, match=r"p\.npz is not a policy") as caught:
        make_planner(planner, file)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("inputs", WIDTHS)
def test_one_that_says_nothing_of_its_sensor_is_refused_by_the_robot(tmp_path, inputs):
    file = policy_file(
        tmp_path / "p.npz", "hlsd10", *layers(inputs, 8, 2), provenance=silent()
    )
    with pytest.raises(HlsdError, match=r"inputs has no room|720"):
        make_planner("hlsd10", file).reset(Setup())


def test_the_right_width_drives(tmp_path):
    for planner in LEARNED:
        file = policy_file(tmp_path / f"{planner}.npz", planner, *layers(722, 8, 2))
        make_planner(planner, file).reset(Setup())


@pytest.mark.parametrize(
    "sensor", [LidarSpec(360), LidarSpec(721), LidarSpec(fov_rad=math.pi)]
)
@pytest.mark.parametrize("planner", LEARNED)
def test_a_robot_with_another_sensor_is_refused(planner, sensor):
    with pytest.raises(HlsdError, match="train a policy for this robot"):
        make_planner(planner).reset(Setup(lidar=sensor))


def test_a_policy_for_another_sensor_drives_the_robot_that_has_it():
    shipped = Policy.load(shipped_policy("hlsd10"))
    sensor = LidarSpec(8, fov_rad=math.pi)
    said = json.loads(shipped.provenance)
    said["hallucination"]["lidar"] |= {"beams": 8, "fov_rad": math.pi}
    weights, biases = layers(10, 8, 2)
    policy = replace(
        shipped,
        weights=tuple(weights),
        biases=tuple(biases),
        provenance=json.dumps(said),
        hallucination=Hallucination(lidar=sensor),
    )
    from hlsd.planners.learned.hlsd import HlsdPlanner
    from hlsd.planners.learned.lfh import LfhPlanner

    for planner in (HlsdPlanner(policy, 1.0), LfhPlanner(policy, 1.0)):
        planner.reset(Setup(lidar=sensor))
        for place in contract.places()[:1]:
            contract.drive(planner, place, Setup(lidar=sensor))
        with pytest.raises(HlsdError, match="8 beams"):
            planner.reset(Setup())


NARROW = layers(722, 8, 2)
LARGE = ([NARROW[0][0] * np.float32(3e38), NARROW[0][1] * np.float32(3e38)], NARROW[1])


@pytest.mark.parametrize(
    ("weights", "biases", "changes"),
    [
        (*layers(722, 0, 2), {}),
        (*layers(722, 8, 3), {}),
        (*layers(722, 2), {}),
        ([NARROW[0][0].T, NARROW[0][1]], NARROW[1], {}),
        ([NARROW[0][0][:, :7], NARROW[0][1]], NARROW[1], {}),
        (NARROW[0], [NARROW[1][0][:7], NARROW[1][1]], {}),
        (NARROW[0], [NARROW[1][0][None], NARROW[1][1]], {}),
        ([NARROW[0][0].ravel(), NARROW[0][1]], NARROW[1], {}),
        ([w.astype(np.float64) for w in NARROW[0]], NARROW[1], {}),
        ([w.astype(np.int32) for w in NARROW[0]], NARROW[1], {}),
        ([NARROW[0][0] * np.float32(np.nan), NARROW[0][1]], NARROW[1], {}),
        ([NARROW[0][0] * np.float32(np.inf), NARROW[0][1]], NARROW[1], {}),
        (*LARGE, {}),
        (*NARROW, {"layers": np.array(10**12)}),
        (*NARROW, {"layers": np.array(-1)}),
        (*NARROW, {"layers": np.array(np.nan)}),
        (*NARROW, {"layers": np.array([2, 2])}),
        (*NARROW, {"format": np.array(np.inf)}),
        (*NARROW, {"clip_m": np.array(np.inf)}),
        (*NARROW, {"clip_m": np.array(np.nan)}),
        (*NARROW, {"clip_m": np.array(2.0)}),
        (*NARROW, {"goal_bearing_rad": np.array(np.nan)}),
        (*NARROW, {"provenance": np.array(3.0)}),
    ],
)
def test_layers_and_numbers_that_are_none_are_refused(
    tmp_path, weights, biases, changes
):
    file = policy_file(tmp_path / "p.npz", "hlsd10", weights, biases, **changes)
    with pytest.raises(HlsdError, match=r"p\.npz is not a policy") as caught:
        make_planner("hlsd10", file)
    assert "\n" not in str(caught.value)


def test_the_byte_order_of_a_file_is_no_matter(tmp_path):
    weights, biases = layers(722, 8, 2)
    others = ([array.astype(">f4") for array in held] for held in (weights, biases))
    one = policy_file(tmp_path / "a.npz", "hlsd10", weights, biases)
    other = policy_file(tmp_path / "b.npz", "hlsd10", *others)
    given = np.linspace(0.1, 1.0, 722, dtype=np.float32)
    assert Policy.load(other).forward(given) == Policy.load(one).forward(given)


@pytest.mark.parametrize("order", ["F", "strided"])
def test_the_layout_of_an_array_is_no_matter(order):
    weights, biases = layers(722, 8, 2)
    rng = np.random.default_rng(0)
    weights = [rng.normal(0, 0.1, w.shape).astype(np.float32) for w in weights]
    if order == "F":
        others = [np.asfortranarray(w) for w in weights]
    else:
        others = [np.repeat(w, 2, axis=0)[::2] for w in weights]
    given = rng.random(722).astype(np.float32)
    one = Policy(tuple(weights), tuple(biases), 1.0, "{}").forward(given)
    assert Policy(tuple(others), tuple(biases), 1.0, "{}").forward(given) == one


@pytest.mark.parametrize(
    "changes",
    [
        {"clip_m": "a"},
        {"clip_m": math.nan},
        {"goal_distance_m": math.inf},
        {"goal_distance_m": 0.0},
        {"end_margin_m": -0.1},
        {"half_length_m": None},
        {"side_offset_m": True},
        {"sampling_count": 1.5},
        {"sampling_count": 0},
        {"lidar": {"beams": 1}},
        {"lidar": {"beams": 720.5}},
        {"lidar": {"fov_rad": 0.0}},
        {"lidar": {"fov_rad": 7.0}},
        {"lidar": {"max_range_m": math.nan}},
        {"lidar": {"max_range_m": 0.05}},
        {"lidar": {"noise_sd_m": -1.0}},
        {"lidar": {"mount_in_base": [0.0, 0.0]}},
        {"lidar": {"mount_in_base": ["x", 0.0, 0.0]}},
        {"lidar": [1]},
    ],
)
def test_what_a_provenance_says_of_its_training_is_checked(tmp_path, changes):
    said = json.loads(Policy.load(shipped_policy("lfh04")).provenance)
    held = said["hallucination"]
    sensor = changes.get("lidar")
    held |= {"lidar": held["lidar"] | sensor} if isinstance(sensor, dict) else changes
    file = policy_file(
        tmp_path / "p.npz", "lfh04", *NARROW, provenance=np.array(json.dumps(said))
    )
    with pytest.raises(HlsdError, match=r"p\.npz is not a policy") as caught:
        make_planner("lfh04", file)
    assert "\n" not in str(caught.value)


# The floor never looks at the scan.
@pytest.mark.parametrize("name", sorted({*AT_HAND} - {FLOOR}))
@pytest.mark.parametrize("beams", [0, 1, 719, 721, 5000])
def test_a_scan_of_another_length_is_refused_at_the_tick(name, beams):
    place = contract.places()[0]
    planner, setup = make_planner(name), Setup()
    planner.reset(setup)
    seen = []

    class Spy:
        period_s = planner.period_s

        def reset(self, setup):
            planner.reset(setup)

        def plan(self, observation):
            seen.append(observation)
            return planner.plan(observation)

    contract.drive(Spy(), place, setup)
    straight = next(
        each
        for each in seen
        if not name.startswith("lfh")
        or abs(path_direction(each.path_in_odom, each.pose_in_odom)) < 0.5
    )
    planner.reset(setup)
    wrong = replace(straight, ranges_m=np.full(beams, 5.0))
    if name.startswith("lfh"):
        # It is shown its own scan; the real one is looked at within its length.
        planner.plan(wrong)
        return
    with pytest.raises(ValueError, match="beams"):
        planner.plan(wrong)


def beams(number=7):
    return imagining._beams(Hallucination(lidar=LidarSpec(number)))


def stretches(number=7):
    return FreeStretches(
        np.empty(number), np.empty((number, LATER, 2)), np.empty(number, np.int64)
    )


def a_drive(points=1, goal=2, end=3, ticks=5):
    return Drive(
        np.zeros((ticks, 3)),
        np.zeros((ticks, 2)),
        np.full(points, goal),
        np.full(points, end),
    )


def scans(points=1, passes=12, number=7):
    whole = np.empty(points, np.int64)
    return HallucinatedScans(
        np.empty((points * passes, number), np.float32),
        np.empty((points, 2)),
        *(whole.copy() for _ in range(4)),
    )


def imagined(drive, out):
    h = Hallucination(lidar=LidarSpec(7))
    imagine(drive, imagining._outline(h), beams(), h.rules(), np.uint64(0), out)


def sensor(number=7):
    return Sensor(
        0, np.array([0, 0, 0, 1.0, 0, 0, 0]), np.ones((3, number)), 4.0, 0.1, 30.0, 0.0
    )


def grid(n=10, kind=np.uint8):
    return np.zeros((n, n), kind)


POSE, PATH, OUTLINE = (
    np.zeros(3),
    np.zeros((30, 2)),
    imagining._outline(Hallucination()),
)
NONE = Surfaces(np.empty((5, 0)), np.empty((8, 0)), True)
LINES = Footprint().line_table(0.05)
COSTMAP = Costmap(LidarSpec(7))
MADE, START, MOTION = make_batch(8, 5), (0.1, 0.1, 0.1), (0.1,) * 9
BATCH = bare(MADE)
ODD_BATCH = bare(MADE._replace(yaw=np.zeros((8, 4), "f4")))
NOISE, CONTROL = np.zeros((2, 8, 5), "u2"), np.zeros((2, 8), "f4")
QUANTILES, FLAGS = normal_quantiles(), np.zeros(30, np.bool_)
LOCAL, SMALL = (grid(40), 0.05, 20.0, 20.0), (grid(39), 0.05, 20.0, 20.0)
EDGES = bare(make_outlines(Footprint().corners() / 0.05, LINES, 40))
COSTS, ALIGN = (1.0, 1.0, 1.0, 1, 1, False), (1.0, 1, 5, 0.1)
STILL = (1.0, 1.0, 1.0, 0, 1, False)
POSE_3, SHAPE = (0.0, 0.0, 0.0), (72, 0.8, 0.2, 0.1, 0.2, 16)
TASK, WEIGHTS = (POSE_3, 1.0, 0.0, 0.0, 0.1), (*(1.0,) * 7, 5, 0.3)
FOUR = np.array([[0, 0], [0, 40], [40, 40], [40, 0]])
SPARED = np.array([[3, 3]], dtype=np.int32)


@pytest.mark.parametrize(
    "call",
    [
        lambda: fill_input(np.ones(5), np.ones(2), 0.1, 1.0, 3.0, np.ones(6, "f4")),
        lambda: fill_input(np.ones(5), np.ones(1), 0.1, 1.0, 3.0, np.ones(7, "f4")),
        lambda: path_direction(np.zeros((4, 1)), POSE),
        lambda: path_direction(PATH, np.zeros(2)),
        lambda: lookahead_point(np.zeros((4, 1)), POSE, 0.5),
        lambda: lookahead_point(PATH, np.zeros(2), 0.5),
        lambda: lookahead_point(PATH[:0], POSE, 0.5),
        lambda: length_left(np.zeros((4, 1)), 0.5),
        lambda: smoothed(np.zeros((30, 1))),
        lambda: poses_along(PATH, np.zeros(2), 1.0),
        lambda: poses_along(np.zeros((30, 3)), POSE, 1.0),
        lambda: COSTMAP.update(POSE, np.ones(8)),
        lambda: COSTMAP.update(POSE, np.ones(6)),
        lambda: COSTMAP.update(np.zeros(2), np.ones(7)),
        lambda: COSTMAP.update(POSE, np.ones(7), (0, 801, 0, 800)),
        lambda: COSTMAP.update(POSE, np.ones(7), (0, 800, -1, 800)),
        lambda: COSTMAP.update(POSE, np.ones(7), None, np.array([640_000], np.int32)),
        lambda: COSTMAP.update(POSE, np.ones(7), None, np.array([-1], np.int32)),
        lambda: corner_cells(0.0, 0.0, 1.0, 0.0, np.zeros((4, 2)), FOUR[:3].copy()),
        lambda: covered_cells(FOUR, LINES, np.zeros((9999, 2), np.int32)),
        lambda: covered_cells(FOUR // 8, LINES, np.zeros((9, 2), np.int32)),
        lambda: covered_cells(FOUR[:0], LINES, np.zeros((9, 2), np.int32)),
        lambda: take_plan(np.zeros((5, 1)), 0.0, 0.0, 1.0, 5.0, 0.05, np.ones((9, 2))),
        lambda: take_plan(PATH, 0.0, 0.0, 1.0, 5.0, 0.05, np.ones((0, 2))),
        lambda: plan_cells(PATH, np.zeros(2), 0.1, 10, np.zeros((29, 2), np.int64)),
        lambda: plan_cells(PATH, np.zeros(1), 0.1, 10, np.zeros((30, 2), np.int64)),
        lambda: begin(FOUR // 8, grid(), SPARED, (1, 1), 9, make_wave(9)),
        lambda: begin(FOUR // 8, grid(), SPARED, (1, 1), 9, grid(10, np.int32)),
        lambda: begin(FOUR // 8, grid(4), SPARED, (1, 1), 9, make_wave(4)),
        lambda: begin(FOUR // 8, grid(), SPARED + 9, (1, 1), 9, make_wave(10)),
        lambda: begin(FOUR // 8, grid(), SPARED - 4, (1, 1), 9, make_wave(10)),
        lambda: begin(FOUR[:, :1].copy(), grid(), SPARED, (1, 1), 9, make_wave(10)),
        lambda: heap_up(np.ones(5), np.zeros(4, np.int64)),
        lambda: sum_up(grid(), 5.0, 5.0, 3.0, np.zeros((10, 10, 2), np.int32)),
        lambda: roll_out(NOISE, QUANTILES, CONTROL[:1], START, MOTION, BATCH),
        lambda: roll_out(NOISE[:1], QUANTILES, CONTROL, START, MOTION, BATCH),
        lambda: roll_out(NOISE, QUANTILES[1:], CONTROL, START, MOTION, BATCH),
        lambda: roll_out(NOISE, QUANTILES, CONTROL, START, MOTION, ODD_BATCH),
        lambda: update(BATCH, np.zeros(4), 0.1, 0.3, MOTION, CONTROL),
        lambda: update(BATCH, np.zeros(5), 0.1, 0.3, MOTION, CONTROL[:, 1:].copy()),
        lambda: constrain(CONTROL[:1], MOTION),
        lambda: smooth(CONTROL, np.zeros((2, 3), "f4")),
        lambda: smooth(CONTROL[:, :1].copy(), np.zeros((2, 4), "f4")),
        lambda: shift(CONTROL[:, :1].copy()),
        lambda: inflate(grid(), np.zeros(9, "u1"), grid(9)),
        lambda: inflate(grid(), np.zeros(0, "u1"), grid()),
        lambda: critics.too_fast(BATCH, 0.1, (0.0, 1.0), 1.0, np.zeros(4)),
        lambda: critics.backwards(BATCH, 0.1, 1.0, np.zeros(4)),
        lambda: critics.from_goal(BATCH, (0.0, 1.0), 1.0, np.zeros(6)),
        lambda: critics.off_goal_yaw(BATCH, 0.1, 1.0, np.zeros(4)),
        lambda: critics.from_point(BATCH, (0.0, 1.0), 1.0, np.zeros(4)),
        lambda: critics.off_bearing(BATCH, (0.0, 1.0), 1.0, np.zeros(4)),
        lambda: critics.near_obstacles(BATCH, LOCAL, EDGES, COSTS, np.zeros(4)),
        lambda: critics.near_obstacles(BATCH, SMALL, EDGES, COSTS, np.zeros(5)),
        lambda: critics.near_obstacles(BATCH, LOCAL, EDGES, STILL, np.zeros(5)),
        lambda: critics.free_points(PATH, LOCAL, np.zeros(29, np.bool_)),
        lambda: critics.free_points(np.zeros((30, 3)), LOCAL, FLAGS),
        lambda: critics.furthest_point(BATCH, np.zeros((30, 3))),
        lambda: critics.off_path(BATCH, PATH, FLAGS, 30, ALIGN, np.zeros(5)),
        lambda: critics.off_path(BATCH, PATH, FLAGS, -1, ALIGN, np.zeros(5)),
        lambda: critics.off_path(BATCH, PATH, FLAGS[:9], 12, ALIGN, np.zeros(5)),
        lambda: critics.off_path(BATCH, PATH, FLAGS, 9, ALIGN, np.zeros(4)),
        lambda: critics.closest_along(np.zeros(3), 0.5, 3),
        lambda: critics.closest_along(np.zeros(3), 0.5, -1),
        lambda: primary(np.zeros((3, 3)), POSE_3, SHAPE, np.zeros(72)),
        lambda: primary(PATH, POSE_3, SHAPE, np.zeros(71)),
        lambda: binary(np.zeros(71), SHAPE, np.zeros(72, np.bool_)),
        lambda: binary(np.zeros(72), SHAPE, np.zeros(71, np.bool_)),
        lambda: mask(PATH, POSE_3, 0.1, SHAPE, np.zeros(71, np.bool_)),
        lambda: mask(np.zeros((3, 1)), POSE_3, 0.1, SHAPE, np.zeros(72, np.bool_)),
        lambda: candidates(np.zeros(71, np.bool_), 0.1, SHAPE, np.zeros(75)),
        lambda: candidates(np.zeros(72, np.bool_), 0.1, SHAPE, np.zeros(74)),
        lambda: gather(grid(), 254, 0.05, (0.0, 0.0), 1.0, np.zeros((9, 3))),
        lambda: best_direction(PATH, np.zeros(71, np.bool_), TASK, WEIGHTS, SHAPE),
        lambda: free_way(np.zeros((3, 3)), 0.0, 0.1),
        lambda: find_free_stretches(np.zeros((0, 3)), OUTLINE, beams(), stretches()),
        lambda: find_free_stretches(np.zeros((3, 2)), OUTLINE, beams(), stretches()),
        lambda: find_free_stretches(np.zeros((3, 3)), OUTLINE, beams(), stretches(6)),
        lambda: find_segments(
            np.ones((3, 3)), np.ones(9), 3, 0.4, 0.0, np.ones((9, 2, 2))
        ),
        lambda: find_segments(
            np.ones((3, 3)), np.ones(1), 2, 0.4, 0.0, np.ones((9, 2, 2))
        ),
        lambda: find_segments(
            np.ones((3, 3)), np.ones(3), 2, 0.4, 0.0, np.ones((1, 2, 2))
        ),
        lambda: find_first_hits(np.ones((2, 2, 2)), 3, beams(), np.ones(7)),
        lambda: find_first_hits(np.ones((2, 2, 2)), 2, beams(), np.ones(6)),
        lambda: imagined(a_drive(end=5), scans()),
        lambda: imagined(a_drive(goal=-1), scans()),
        lambda: imagined(a_drive(goal=4, end=3), scans()),
        lambda: imagined(a_drive(), scans(passes=11)),
        lambda: imagined(a_drive(), scans(number=6)),
        lambda: imagined(a_drive(points=2), scans()),
        lambda: cast(np.zeros(7), sensor(), NONE, EXACT, np.zeros(8)),
        lambda: cast(np.zeros(6), sensor(), NONE, EXACT, np.zeros(7)),
        lambda: cast(np.ones(7), sensor(), NONE, np.zeros(6), np.zeros(7)),
        lambda: cast(
            np.ones(7),
            sensor(),
            Surfaces(np.ones((4, 2)), np.empty((8, 0)), True),
            EXACT,
            POSE,
        ),
        lambda: place_sensor(np.ones(9), 3, sensor().mount, POSE, np.ones((3, 3))),
        lambda: place_sensor(np.ones(9), -1, sensor().mount, POSE, np.ones((3, 3))),
        lambda: place_sensor(np.ones(9), 0, np.ones(6), POSE, np.ones((3, 3))),
        lambda: add_noise(np.ones(6), sensor(), np.ones(7)),
        lambda: cylinder_clearances(np.ones((3, 2)), Outline(0.2, 0.2), PATH, 0.1),
        lambda: cylinder_clearances(
            np.ones((3, 3)), Outline(0.2, 0.2), np.ones((3, 1)), 0.1
        ),
        lambda: simplified(np.ones((3, 1)), 0.1),
        lambda: resampled_sums(np.ones((3, 1)), np.zeros(4, np.int64)),
        lambda: resampled_sums(np.ones((0, 1)), np.zeros(0, np.int64)),
    ],
)
def test_kernels_refuse_other_shapes(call):
    with pytest.raises(ValueError, match=r"\w+ \w+"):
        call()


@pytest.mark.parametrize(
    "call",
    [
        lambda h: imagining.most_constrained_scan(np.zeros((0, 3)), h),
        lambda h: imagining.most_constrained_scan(np.zeros(3), h),
        lambda h: imagining.most_constrained_scan(np.full((2, 3), np.nan), h),
        lambda h: imagining.windows(np.zeros((3, 3)), 4, h),
        lambda h: imagining.windows(np.zeros((3, 2)), 1, h),
        lambda h: imagining.segments(np.zeros((3, 3)), np.zeros(3), -1, h),
        lambda h: imagining.beam_limits(np.zeros((3, 3)), np.zeros(3), 3, h),
        lambda h: MotionLog(0.04, np.array(1.0), np.array(1.0), "r", "1", "{}", 0),
        lambda h: MotionLog(
            0.04, np.zeros((3, 3)), np.zeros((2, 2)), "r", "1", "{}", 0
        ),
        lambda h: replace(h, end_margin_m=-1.0),
    ],
)
def test_functions_refuse_other_shapes_in_one_line(call):
    with pytest.raises(HlsdError):
        call(Hallucination())


def block(ticks=0, paths=0, period_s=0.1, tail=bytes(6), version=1):
    head = (
        np.array([version, paths], "<u2").tobytes() + np.array(ticks, "<u4").tobytes()
    )
    return zlib.compress(head + np.array(period_s, "<f8").tobytes() + tail)


def test_a_block_of_a_trajectory_is_no_larger_than_it_says(monkeypatch):
    monkeypatch.setattr(trajectory, "MOST_BYTES", 10_000)
    assert decode(block()).poses.shape == (1, 3)
    path = bytes(6) + np.array([0, 1], "<u1").tobytes()  # one path of -1 points
    for wrong in (
        block(ticks=2**32 - 1),
        block(tail=bytes(5)),
        block(tail=bytes(7)),
        block(period_s=math.nan),
        block(period_s=-1.0),
        block(ticks=1, tail=bytes(24) + bytes([200, 0])),
        block(paths=1, tail=path[:6] + bytes(2) + bytes([1, 0])),
        block()[:-3],
        block() + b"more",
        zlib.compress(bytes(10_001)),
    ):
        with pytest.raises(HlsdError, match="trajectory"):
            decode(wrong)
