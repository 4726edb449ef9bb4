"""Vector environments: the single environment's numbers, modes, threads, refusals."""

from dataclasses import replace

import numpy as np
import pytest

from hlsd.core.errors import HlsdError
from hlsd.core.memory import table_of
from hlsd.envs.normals import fill_normals, state_of
from hlsd.run.protocol import DYNABARN2024, HLSD2021

gymnasium = pytest.importorskip("gymnasium", reason="needs the extra gym")

from gymnasium.error import ResetNeeded  # noqa: E402
from gymnasium.vector import AutoresetMode, SyncVectorEnv  # noqa: E402

import hlsd.envs  # noqa: E402, F401
from hlsd.envs.barn_vector import BarnVectorEnv, DynaBarnVectorEnv  # noqa: E402
from hlsd.envs.environment import BarnEnv, DynaBarnEnv  # noqa: E402
from hlsd.envs.worlds import generated_suite  # noqa: E402

# Ends come soon: at this time, or at a contact.
SHORT = replace(HLSD2021, name="short", limit_s=0.25, contact_ends_run=True)
SHORT_MOVING = replace(DYNABARN2024, name="short", limit_s=0.25)
KINEMATIC = "hlsd/KinematicBarn-v1"


def same(one, other):
    """Whether two observations of many robots have the same bits."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(
            same(one[name], other[name]) for name in one
        )
    return one.dtype == other.dtype and np.array_equal(one, other)


def kinematic(count=3, **settings):
    settings = {"worlds": ":2", "protocol": SHORT} | settings
    return gymnasium.make_vec(KINEMATIC, num_envs=count, **settings)


def run(env, steps, seed=0):
    """All that an environment tells on seeded random actions."""
    rng = np.random.default_rng(seed)
    told = [env.reset(seed=seed)[0]]
    for _ in range(steps):
        actions = rng.uniform(-1, 1, (env.num_envs, 2)).astype(np.float32)
        told += env.step(actions)[:4]
    return told


def all_same(one, other):
    return len(one) == len(other) and all(map(same, one, other))


@pytest.mark.parametrize("seed", [0, 2**63, 123456789])
def test_noise_is_numpys_to_the_bit(seed):
    generator = np.random.default_rng(seed)
    state, found = state_of(generator), np.empty(200_000)
    fill_normals(state, found)
    assert np.array_equal(found, generator.standard_normal(len(found)))
    assert np.array_equal(state, state_of(generator))
    assert np.abs(found).max() > 3.66  # the ziggurat's tail was drawn from


def test_noise_of_another_generator_is_refused():
    other = np.random.Generator(np.random.Philox(0))
    with pytest.raises(HlsdError, match="'Philox': it must be 'PCG64'"):
        state_of(other)


def test_an_array_with_gaps_has_no_address():
    with pytest.raises(ValueError, match="not contiguous"):
        table_of([np.zeros((3, 3))[:, 1]])


@pytest.mark.parametrize(
    ("many", "single", "settings"),
    [
        (BarnVectorEnv, BarnEnv, {"protocol": SHORT, "observation": "scan+goal"}),
        (BarnVectorEnv, BarnEnv, {"protocol": SHORT, "observation": "flat72+goal"}),
        (
            DynaBarnVectorEnv,
            DynaBarnEnv,
            {"protocol": SHORT_MOVING, "observation": "flat72+goal", "tier": "hard"},
        ),
    ],
    ids=["barn", "flat", "dynabarn"],
)
@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_it_tells_what_the_single_environment_tells(many, single, settings, mode):
    if mode == "SameStep" and many is DynaBarnVectorEnv:
        pytest.skip("the mode has no part in movers")
    settings = {"worlds": ":2", "seed": 3} | settings
    ours = many(2, threads=2, autoreset_mode=mode, **settings)
    makers = [lambda: single(**settings)] * 2
    theirs = SyncVectorEnv(makers, autoreset_mode=AutoresetMode(mode))
    assert ours.single_observation_space == theirs.single_observation_space
    assert ours.action_space == theirs.action_space
    (seen, known), (seen_too, known_too) = ours.reset(seed=7), theirs.reset(seed=7)
    rng = np.random.default_rng(0)
    ends = 0
    for _ in range(26):
        assert same(seen, seen_too)
        for name in ("world", "trial", "time_s", "contacts", "success", "outcome"):
            assert np.array_equal(known[name], known_too[name]), name
            assert np.array_equal(known[f"_{name}"], known_too[f"_{name}"]), name
        actions = rng.uniform((0.0, -1), (1, 1), (2, 2)).astype(np.float32)
        seen, *told, known = ours.step(actions)
        seen_too, *told_too, known_too = theirs.step(actions)
        for one, other in zip(told, told_too, strict=True):
            assert np.array_equal(one, other)
        over = told[1] | told[2]
        ends += over.sum()
        if mode == "SameStep" and over.any():
            assert np.array_equal(known["_final_obs"], known_too["_final_obs"])
            for i in np.flatnonzero(over):
                assert same(known["final_obs"][i], known_too["final_obs"][i])
                outcome = known_too["final_info"]["outcome"][i]
                assert known["final_info"]["outcome"][i] == outcome
    assert ends >= 4
    ours.close()
    theirs.close()


@pytest.mark.parametrize("env_id", ["hlsd/BarnVec-v1", KINEMATIC])
def test_threads_change_nothing(env_id):
    count = 5 if env_id == KINEMATIC else 3
    settings = {"worlds": ":2", "protocol": SHORT, "observation": "flat60+local_goal"}
    told = []
    for threads in (1, 3):
        env = gymnasium.make_vec(env_id, num_envs=count, threads=threads, **settings)
        told.append(run(env, 12))
        env.close()
    assert all_same(*told)


def test_seeds_decide():
    env = kinematic(worlds=":40")
    assert all_same(run(env, 3, seed=1), run(env, 3, seed=1))
    assert not all_same(run(env, 3, seed=1), run(env, 3, seed=2))


def test_a_kinematic_robot_begins_as_a_physical_one():
    settings = {"worlds": ":3", "observation": "scan+local_goal"}
    seen = []
    for env_id in ("hlsd/BarnVec-v1", KINEMATIC):
        env = gymnasium.make_vec(env_id, num_envs=3, **settings)
        seen.append(env.reset(seed=4)[0])
        env.close()
    for name in seen[0]:
        assert np.allclose(seen[0][name], seen[1][name], atol=1e-6), name


def test_some_are_reset_by_hand():
    env = kinematic(autoreset_mode="Disabled")
    with pytest.raises(ResetNeeded, match="call reset first"):
        env.step(np.zeros((3, 2)))
    first, _ = env.reset(seed=0, options={"world": [0, 1, 0], "trial": 5})
    assert env.world.tolist() == [0, 1, 0]
    assert env.trial.tolist() == [5, 5, 5]
    for _ in range(5):
        last, *_, late, _ = env.step(np.zeros((3, 2)))
    assert late.all()
    with pytest.raises(ResetNeeded, match=r"\[0, 1, 2\] are over"):
        env.step(np.zeros((3, 2)))
    mask = np.array((True, False, True))
    options = {"reset_mask": mask, "world": 0, "trial": 5}
    again, known = env.reset(options=options)
    assert np.array_equal(again["scan"][0], first["scan"][0])
    assert np.array_equal(again["scan"][1], last["scan"][1])
    assert known["_world"].tolist() == mask.tolist()


@pytest.mark.parametrize(
    ("actions", "words"),
    [
        (np.zeros((2, 2)), r"shape \(2, 2\).*\(3, 2\)"),
        (np.zeros((3, 2), dtype=bool), "type bool"),
        (np.array([(0, 0), (0, 0), (0, 1.5)]), "yaw rate 1.5, which is out of bounds"),
        (np.array([(0, 0), (np.nan, 0), (0, 0)]), "not finite"),
    ],
)
def test_bad_actions_are_refused_and_nothing_moves(actions, words):
    env = kinematic()
    env.reset(seed=0)
    before = env.poses
    with pytest.raises(HlsdError, match=words):
        env.step(actions)
    assert np.array_equal(env.poses, before)


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"autoreset_mode": "Never"}, "unknown autoreset_mode 'Never'"),
        ({"threads": 0}, "threads"),
        ({"robot": "disc"}, "'disc' has no kinematic model"),
        ({"period_s": 0.0033}, "not a whole number of steps"),
        ({"observation": "flat77+goal"}, "do not divide"),
    ],
)
def test_bad_settings_are_refused(settings, words):
    with pytest.raises(HlsdError, match=words):
        kinematic(**settings)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"worlds": 1}, "unknown option 'worlds'"),
        ({"world": 10_000_000}, "world is 10000000"),
        ({"world": [1, 2]}, "give a whole number, or 3 of them"),
        ({"trial": -1}, "trial"),
        ({"reset_mask": np.zeros(3, dtype=bool)}, "one of them true at least"),
    ],
)
def test_bad_options_are_refused(options, words):
    env = kinematic()
    env.reset(seed=0)
    with pytest.raises(HlsdError, match=words):
        env.reset(options=options)


def test_a_world_that_a_kinematic_robot_does_not_know_is_refused():
    suite = generated_suite("dynabarn", "easy")
    env = kinematic(suite=suite, protocol="dynabarn2024")
    with pytest.raises(HlsdError, match=r"boxes or what moves.*DynaBarnVec"):
        env.reset(seed=0)
