"""What an agent sees and does: layout, scaling, bounds, and what is refused."""

import math

import numba
import numpy as np
import pytest

from hlsd.core.description import LidarSpec, RobotLimits
from hlsd.core.errors import HlsdError
from hlsd.envs.reward import Step, Weights, reward, weights_of
from hlsd.envs.spaces import (
    VARIANTS,
    ActionReader,
    ActionSpec,
    ObservationMaker,
    ObservationSpec,
    observation_spec,
)
from hlsd.planners.base import Command, Observation

pytest.importorskip("gymnasium", reason="needs the extra gym")

LIDAR, LIMITS = LidarSpec(beams=8), RobotLimits()
RANGES = np.array([0.5, 1.0, 9.0, 30.0, 2.5, 4.0, 5.0, 31.0])


def known(ranges=RANGES, speed=1.0, yaw_rate=-2.0, goal=(3.0, 4.0), pose=(0, 0, 0)):
    return Observation(
        time_s=0.0,
        ranges_m=np.array(ranges, dtype=np.float64),
        speed=speed,
        yaw_rate=yaw_rate,
        pose_in_odom=np.array(pose, dtype=np.float64),
        path_in_odom=np.empty((0, 2)),
        local_goal_in_base=np.array([0.6, -0.8]),
        goal_in_odom=np.array(goal),
    )


def test_the_dict_form_is_in_metres_and_of_the_sensors_range():
    seen = ObservationMaker("scan+local_goal", LIDAR, LIMITS).make(known())
    assert list(seen) == ["scan", "local_goal", "velocity"]
    assert all(array.dtype == np.float32 for array in seen.values())
    np.testing.assert_array_equal(seen["scan"], np.float32([*RANGES[:-1], 30.0]))
    np.testing.assert_array_equal(seen["local_goal"], np.float32([0.6, -0.8]))
    np.testing.assert_array_equal(seen["velocity"], [1.0, -2.0])


def test_the_final_goal_is_seen_from_the_robot():
    maker = ObservationMaker("scan+goal", LIDAR, LIMITS)
    seen = maker.make(known(goal=(3.0, 4.0), pose=(1.0, 1.0, math.pi / 2)))
    np.testing.assert_allclose(seen["goal"], [3.0, -2.0], rtol=1e-6)


def test_the_flat_form_is_scaled_in_the_documented_order():
    flat = ObservationMaker("flat4+goal", LIDAR, LIMITS).make(known())
    scan = [0.1, 1.0, 0.5, 1.0]  # the nearest of two each, over 5 m
    goal = [0.6, 0.8, 0.5]  # its bearing, and 5 of 10 m
    np.testing.assert_allclose(flat, [*scan, *goal, 0.5, -0.5], rtol=1e-6)
    assert flat.dtype == np.float32


def test_a_goal_beneath_the_robot_has_a_bearing():
    flat = ObservationMaker("flat+goal", LIDAR, LIMITS).make(known(goal=(0.0, 0.0)))
    np.testing.assert_array_equal(flat[8:11], [1.0, 0.0, 0.0])


@pytest.mark.parametrize("variant", [*VARIANTS, "scan2+goal", "flat1+local_goal"])
def test_whatever_is_known_lies_in_the_space(variant):
    """Ranges of perturbed sensors, goals and velocities beyond all reason included."""
    maker = ObservationMaker(variant, LIDAR, LIMITS)
    space = maker.space()
    assert maker.make(known()) in space
    far = known([-1.0] * 4 + [1e9] * 4, 99.0, -99.0, (1e6, -1e6))
    assert maker.make(far) in space
    assert str(observation_spec(variant)) == variant
    assert space.contains(space.sample())


@pytest.mark.parametrize(
    ("observation", "said"),
    [
        ("scan+gaol", "did you mean 'scan+goal'?"),
        ("camera", "known are scan+local_goal, scan+goal, flat+local_goal, flat+goal"),
        (7, "unknown observation '7'"),
        (
            "flat3+goal",
            "3 beams, which do not divide the lidar's 8: near to it are 1, 2, 4",
        ),
        ("scan0+goal", "0 beams: give a whole number of 1 or more"),
        ("scan16+goal", "16 beams, which do not divide the lidar's 8"),
    ],
)
def test_an_observation_that_there_is_not_is_refused(observation, said):
    with pytest.raises(HlsdError) as error:
        ObservationMaker(observation, LIDAR, LIMITS)
    assert said in str(error.value)


@pytest.mark.parametrize(
    "wrong", [{"goal": "home"}, {"clip_m": 0.0}, {"clip_m": math.nan}, {"beams": 1.5}]
)
def test_a_spec_that_cannot_be_is_refused(wrong):
    with pytest.raises(HlsdError, match="observation "):
        ObservationSpec(**wrong)


def test_actions_are_velocities_or_shares_of_the_limits():
    velocity = ActionReader("velocity", LIMITS)
    np.testing.assert_array_equal(velocity.space().high, [2.0, 4.0])
    given = np.array([0.1, -3.3])
    assert velocity.command(given) == Command(0.1, -3.3), "float64 as it is"
    normalised = ActionReader("normalised", LIMITS)
    assert normalised.command([-0.5, 1.0]) == Command(-1.0, 4.0)
    forward = ActionReader("forward", LIMITS)
    assert forward.command(np.float32([-1.0, 0.0])) == Command(0.0, 0.0)
    assert forward.command([1, -1]) == Command(2.0, -4.0)
    slow = ActionReader(ActionSpec(normalised=True, max_speed=0.5), LIMITS)
    assert slow.command([1.0, 0.5]) == Command(0.5, 2.0)


def test_a_limit_that_float32_rounds_up_can_be_reached():
    limits = RobotLimits(max_speed=1.2)
    reader = ActionReader("velocity", limits)
    highest = reader.space().high
    assert float(highest[0]) > 1.2
    assert reader.command(highest) == Command(1.2, 4.0)


@pytest.mark.parametrize(
    ("action", "said"),
    [
        ([3.0, 0.0], "speed 3 m/s, which is out of bounds: it lies between -2 and 2"),
        (
            [0.0, -4.1],
            "yaw rate -4.1 rad/s, which is out of bounds: it lies between -4",
        ),
        ([math.nan, 0.0], "speed nan m/s, which is not finite"),
        ([0.0, math.inf], "yaw rate inf rad/s, which is not finite"),
        ([1.0], "give two numbers, speed and yaw rate"),
        ([[1.0, 2.0]], "give two numbers"),
        (None, "give two numbers"),
        ("go", "give two numbers"),
        ([True, False], "give two numbers"),
    ],
)
def test_an_action_that_cannot_be_driven_is_refused(action, said):
    with pytest.raises(HlsdError) as error:
        ActionReader("velocity", LIMITS).command(action)
    assert said in str(error.value)


def test_clipping_leaves_what_is_not_finite_to_be_refused():
    reader = ActionReader("normalised", LIMITS)
    np.testing.assert_array_equal(reader.clipped([7.0, -7.0]), [1.0, -1.0])
    with pytest.raises(HlsdError, match="not finite"):
        reader.command(reader.clipped([math.nan, 0.0]))
    with pytest.raises(HlsdError, match="give two numbers"):
        reader.command(reader.clipped("go"))


def test_an_action_space_that_cannot_be_is_refused():
    with pytest.raises(HlsdError, match="did you mean 'forward'"):
        ActionReader("foward", LIMITS)
    with pytest.raises(HlsdError, match="max_speed of 9: the robot's limit is 2"):
        ActionReader(ActionSpec(max_speed=9.0), LIMITS)
    with pytest.raises(HlsdError, match="max_yaw_rate of -1"):
        ActionSpec(max_yaw_rate=-1.0)


def test_the_reward_is_the_sum_of_its_terms_in_python_and_in_kernels():
    weights = weights_of({"progress": 2.0, "time": -0.5, "collision": -3})
    step = Step(0.25, 0.1, 2, 0.04, False, True)
    by_hand = 0.5 - 0.05 - 2.0 - 0.04 - 3.0
    assert reward(step, weights) == pytest.approx(by_hand, abs=1e-12)
    compiled = numba.njit(lambda step, weights: reward(step, weights))
    assert compiled(step, weights) == reward(step, weights)
    reached = Step(0.0, 0.0, 0, 0.0, True, False)
    assert reward(reached, Weights()) == Weights().goal


@pytest.mark.parametrize(
    ("given", "said"),
    [
        ({"progres": 1.0}, "did you mean 'progress'"),
        ({"goal": math.inf}, "weight goal is inf: give a finite number"),
        ({"goal": "much"}, "weight goal is 'much'"),
        (Weights(time=math.nan), "weight time is nan"),
    ],
)
def test_weights_that_cannot_be_are_refused(given, said):
    with pytest.raises(HlsdError) as error:
        weights_of(given)
    assert said in str(error.value)
