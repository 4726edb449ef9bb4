"""The environments: Gymnasium's checks, equality with bench, seeds, ends, refusals."""

import itertools
import math
import warnings

import numpy as np
import pytest

import hlsd
from examples.follow_path import FollowPath
from hlsd.core.errors import HlsdError
from hlsd.data.worlds import generate_suite_at, load_suite
from hlsd.envs.reward import Weights
from hlsd.planners.base import Command
from hlsd.report import rendering
from hlsd.run.episode import run_episode
from hlsd.run.row import COLUMNS
from hlsd.run.session import Session
from hlsd.run.trajectory import encode

gymnasium = pytest.importorskip("gymnasium", reason="needs the extra gym")

from gymnasium.error import ResetNeeded  # noqa: E402
from gymnasium.utils.env_checker import check_env  # noqa: E402

from hlsd.envs.environment import BarnEnv, DynaBarnEnv  # noqa: E402
from hlsd.envs.worlds import generated_suite  # noqa: E402

IDS = ("hlsd/Barn-v1", "hlsd/DynaBarn-v1")
STILL = (0.0, 0.0)


class Notes:
    """An observer that keeps what was commanded."""

    def __init__(self):
        self.commands = []

    def began(self, session):
        pass

    def commanded(self, session, command):
        self.commands.append((command.speed, command.yaw_rate))

    def drove(self, session):
        pass


class Replay:
    """A planner that gives recorded commands."""

    def __init__(self, commands, period_s=0.05):
        self.commands, self.period_s = commands, period_s

    def reset(self, setup):
        self.next = iter(self.commands)

    def plan(self, observation):
        return Command(*next(self.next))


def drive(env, actions, **options):
    """The last of an episode's steps, and all rewards."""
    env.reset(options=options)
    rewards = []
    for action in actions:
        last = env.step(action)
        rewards.append(last[1])
    return last, rewards


def same_row(numbers, row):
    """Whether an environment's row holds the cells of one of episodes.csv."""
    assert set(COLUMNS) - set(numbers) == {"planner", "reason", "wall_s"}
    for name, value in numbers.items():
        cell = row[name]
        if isinstance(value, str):
            assert value == ("" if cell != cell else cell), name
        else:
            assert value == cell or (math.isnan(value) and cell != cell), name


def same_trajectory(kept, episode):
    """Whether a run keeps what was driven, to the bit: its block is the same bytes."""
    assert encode(kept) == encode(episode.trajectory)


@pytest.mark.parametrize("name", IDS)
@pytest.mark.parametrize(
    "settings", [{}, {"observation": "flat90+goal", "action": "forward"}]
)
def test_gymnasium_finds_nothing_to_say(name, settings):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        env = gymnasium.make(name, worlds=0, **settings)
        assert env.spec.id == name
        check_env(env.unwrapped, skip_render_check=True)
        env.close()


def at_random(env, **options):
    """Commands and the last info of an episode whose actions are drawn."""
    env.action_space.seed(1)
    env.reset(options=options)
    notes, done = Notes(), False
    env.session.observers += (notes,)
    while not done:
        *_, terminated, truncated, info = env.step(env.action_space.sample())
        done = terminated or truncated
    assert terminated == (info["outcome"] == "collision")
    return notes.commands, info


def test_commands_give_the_rows_and_trajectories_of_bench(tmp_path):
    """A planner's commands in the environment, and its actions through a planner."""
    settings = {
        "suite": "barn300",
        "protocol": "barn2022",
        "seed": 3,
        "perturbations": {"lidar.noise_sd": 0.02},
    }
    period_s = FollowPath.period_s
    env = BarnEnv(action="forward", period_s=period_s, **settings)
    drawn, crash = at_random(env, world=0, trial=0)
    assert crash["outcome"] == "collision"
    crashed = env.episode
    run = hlsd.bench(
        {"follow": FollowPath(), "replay": Replay(drawn, period_s)},
        worlds=0,
        trials=1,
        jobs=1,
        out=tmp_path / "run",
        **settings,
    )
    rows = run.episodes.set_index("planner")
    same_row(crash["row"], rows.loc["replay"])
    same_trajectory(run.trajectory(0, "replay"), crashed)

    notes = Notes()
    course = hlsd.open_session(0, **settings).course
    driven = run_episode(course, FollowPath(), 3, 0, [notes])
    env = BarnEnv(action="velocity", period_s=period_s, **settings)
    (_, _, terminated, truncated, info), _ = drive(
        env, notes.commands, world=0, trial=0
    )
    assert (terminated, truncated) == (True, False)
    assert (info["outcome"], info["success"]) == ("success", True)
    same_row(info["row"], rows.loc["follow"])
    same_trajectory(run.trajectory(0, "follow"), env.episode)
    np.testing.assert_array_equal(driven.record.motions, env.episode.record.motions)


def test_among_moving_obstacles_a_replay_is_the_same_to_the_bit():
    env = DynaBarnEnv(tier="hard", worlds_seed=7, action="forward")
    commands, info = at_random(env, world=1, trial=5)
    driven = hlsd.episode(Replay(commands), env.suite[1], trial=5)
    ours = env.episode
    assert (driven.outcome, driven.contacts) == (info["outcome"], info["contacts"])
    np.testing.assert_array_equal(driven.record.motions, ours.record.motions)
    np.testing.assert_array_equal(driven.record.mover_xy, ours.record.mover_xy)


def test_the_reward_adds_up():
    """Progress telescopes; time, contacts and the end are counted once each."""
    weights = Weights(2.0, -0.5, -3.0, -7.0, 11.0, -13.0)
    env = BarnEnv(
        "barn300", protocol="barn2022", action="velocity", reward=weights, worlds=0
    )
    env.reset(options={"world": 0, "trial": 0})
    goal = env.protocol.goal(env.session.course.world)

    def to_goal():
        return math.dist(env.session.motion[:2], goal)

    begun, total, done = to_goal(), 0.0, False
    while not done:
        _, reward, done, _, info = env.step((2.0, 0.0))
        assert type(reward) is float
        total += reward
    simulator = env.session.course.simulator
    assert info["outcome"] == "collision"
    assert simulator.contact_time_s > 0.0
    expected = (
        2.0 * (begun - to_goal())
        - 0.5 * env.session.time_s
        - 3.0 * info["contacts"]
        - 7.0 * simulator.contact_time_s
        - 13.0
    )
    assert total == pytest.approx(expected, abs=1e-9)


def test_the_protocols_limit_truncates():
    env = BarnEnv("barn300", worlds=0, period_s=1.0)
    (_, _, terminated, truncated, info), rewards = drive(env, [STILL] * 50, trial=0)
    assert (terminated, truncated) == (False, True)
    assert (info["outcome"], info["success"], info["time_s"]) == ("timeout", False, 50)
    assert sum(rewards) == pytest.approx(-0.1 * 50, abs=0.01)
    with pytest.raises(ResetNeeded, match="call reset"):
        env.step(STILL)
    env.reset()
    assert not any(env.step(STILL)[2:4])


def test_contacts_that_end_no_run_are_counted_and_go_on():
    env = BarnEnv("barn300", worlds=0, action="velocity")
    (*_, terminated, truncated, info), rewards = drive(env, [(2.0, 0.0)] * 60, trial=0)
    assert info["contacts"] > 0
    assert (terminated, truncated) == (False, False)
    assert min(rewards) < -0.9
    assert "row" not in info


def played(env, seed, steps=4):
    """All bytes of two episodes' beginnings."""
    found = []
    for number in range(2):
        seen, info = env.reset(seed=seed if number == 0 else None)
        found.append((info["world"], info["trial"], seen["scan"].tobytes()))
        for step in range(steps):
            seen, reward, *_ = env.step((0.1 * step, 0.2))
            found.append((reward, *(array.tobytes() for array in seen.values())))
    return found


def test_the_same_seed_gives_the_same_bytes():
    first = DynaBarnEnv(worlds="0:50")
    second = DynaBarnEnv(worlds="0:50", courses_kept=1)
    assert played(first, 4) == played(second, 4) == played(first, 4)
    assert played(first, 4) != played(first, 5)


def test_worlds_and_trials_are_drawn_from_those_chosen():
    env = BarnEnv("barn300", worlds=[3, 17])
    drawn = [env.reset(seed=0 if n == 0 else None)[1] for n in range(12)]
    assert {info["world"] for info in drawn} == {3, 17}
    assert len({info["trial"] for info in drawn}) == 12
    _, info = env.reset(options={"world": np.int64(5)})
    assert info["world"] == 5
    _, info = env.reset(options={"trial": 8})
    assert (info["trial"], info["world"] in (3, 17)) == (8, True)


def test_the_beginning_is_that_of_a_session():
    """Where it starts, and what it sees there, noise included."""
    env = BarnEnv("barn300", seed=2)
    seen, info = env.reset(options={"world": 4, "trial": 9})
    session = hlsd.open_session(4, seed=2)
    known = session.reset(9)
    np.testing.assert_array_equal(seen["scan"], known.ranges_m.astype(np.float32))
    assert (info["world"], info["trial"], info["time_s"]) == (4, 9, 0.0)
    assert info["outcome"] == ""


def test_worlds_made_in_memory_are_those_that_the_command_stores(tmp_path):
    stored = generate_suite_at(tmp_path / "x", 2, 5, kind="dynabarn", tier="medium")
    env = DynaBarnEnv(tier="medium", worlds_seed=5)
    for index in (0, 1):
        assert env.suite[index].digests() == stored[index].digests()
    assert len(env.suite) == 10_000
    assert generated_suite("barn", seed=1)[0].digests() != (
        generated_suite("barn", seed=2)[0].digests()
    )


def test_no_world_of_barn300_is_trained_on_by_default():
    published = {grid for grid, _ in load_suite("barn300").digests.values()}
    env = BarnEnv()
    assert not published & {env.suite[index].digests()[0] for index in range(24)}


def test_few_courses_are_kept_and_all_are_freed():
    env = BarnEnv("barn300", worlds="0:10", courses_kept=2)
    courses = []
    for world in (1, 2, 1, 3, 1):
        env.reset(options={"world": world})
        courses.append(env.session.course)
    assert courses[0] is courses[2] is courses[4]
    assert len(env._courses) == 2
    env.close()
    assert len(env._courses) == 0
    with pytest.raises(ResetNeeded):
        env.step(STILL)
    env.close()
    env.reset()


def test_a_course_on_anothers_navigator_drives_as_on_its_own():
    env = BarnEnv("barn300", worlds="0:3", action="velocity")
    for world in (0, 1):
        env.reset(options={"world": world, "trial": 0})
        session = Session(hlsd.open_session(world).course)
        session.reset(0)
        for number in range(60):
            command = Command(0.5, math.sin(number / 5))
            known = session.step(command)
            seen = env.step((command.speed, command.yaw_rate))[0]
        np.testing.assert_array_equal(
            env.session.observation.path_in_odom, known.path_in_odom
        )
        np.testing.assert_array_equal(
            seen["local_goal"], known.local_goal_in_base.astype(np.float32)
        )


@pytest.mark.parametrize(
    ("settings", "said"),
    [
        ({"suite": "barn3000"}, "did you mean 'barn300'"),
        ({"worlds": "300"}, "no world 300"),
        ({"worlds": "10000"}, "no world 10000"),
        ({"protocol": "dynabarn2024"}, "worlds of layout 'dynabarn'"),
        ({"robot": "jackl"}, "did you mean 'jackal'"),
        ({"perturbations": {"lidar.nose": 1.0}}, "did you mean 'lidar.noise_sd'"),
        ({"period_s": 0.0333}, "not a whole number of physics steps"),
        ({"period_s": math.nan}, "not a whole number of physics steps"),
        ({"seed": -1}, "seed is -1: 0 or more is needed"),
        ({"observation": "scan"}, "unknown observation 'scan': known are"),
        ({"action": "throttle"}, "unknown action 'throttle': known are velocity"),
        ({"reward": {"speed": 1.0}}, "unknown weight of the reward 'speed'"),
        ({"render_mode": "ansi"}, "unknown render mode 'ansi': known are rgb_array"),
        ({"camera": "chaise"}, "did you mean 'chase'"),
        ({"courses_kept": 0}, "courses_kept is 0: at least 1 is needed"),
        ({"worlds_seed": 0.5}, "worlds_seed is 0.5: a whole number is needed"),
    ],
)
def test_settings_that_cannot_be_are_refused_in_one_line(settings, said):
    if settings.get("worlds") == "300":
        settings = {"suite": "barn300", **settings}
    with pytest.raises(HlsdError) as error:
        BarnEnv(**settings)
    assert said in str(error.value)
    assert "\n" not in str(error.value)


def test_tiers_are_of_worlds_made_in_memory():
    with pytest.raises(HlsdError, match="unknown tier 'heavy': known are easy, medium"):
        DynaBarnEnv(tier="heavy")
    with pytest.raises(HlsdError, match="leave one of them out"):
        DynaBarnEnv("barn300", tier="easy")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"wrold": 3}, "unknown option of reset 'wrold': known are world, trial"),
        ({"world": 300}, "suite 'barn300' has no world 300: it has worlds 0 to 299"),
        ({"world": -1}, "has no world -1"),
        ({"world": "3"}, "option world is '3': give the index of a world"),
        ({"world": True}, "option world is True"),
        ({"trial": -2}, "trial is -2: 0 or more is needed"),
        ({"trial": 0.5}, "trial is 0.5: a whole number is needed"),
    ],
)
def test_options_that_cannot_be_are_refused(options, said):
    with pytest.raises(HlsdError) as error:
        BarnEnv("barn300").reset(options=options)
    assert said in str(error.value)


def test_an_action_that_cannot_be_driven_leaves_the_episode_as_it_was():
    env = BarnEnv("barn300", worlds=0)
    env.reset(options={"trial": 0})
    with pytest.raises(
        HlsdError, match=r"between -1 and 1 \(gymnasium\.wrappers\.Clip"
    ):
        env.step((1.5, 0.0))
    with pytest.raises(HlsdError, match="not finite"):
        env.step((math.nan, 0.0))
    assert env.session.time_s == 0.0
    env.step((1.0, 0.0))
    with pytest.raises(HlsdError, match="not over"):
        _ = env.episode


@pytest.fixture
def graphics():
    """Skips where nothing can draw."""
    try:
        rendering._context(64, 64).free()
    except HlsdError as error:
        pytest.skip(str(error))


def test_pictures_show_what_moves_and_follow_into_another_world(graphics):
    env = BarnEnv(
        "barn300", render_mode="rgb_array", render_size=(64, 48), action="velocity"
    )
    with pytest.raises(ResetNeeded):
        env.render()
    pictures = []
    for world in (0, 200):
        env.reset(options={"world": world, "trial": 0})
        pictures.append(env.render())
        for _ in range(20):
            env.step((2.0, 0.0))
        pictures.append(env.render())
    for picture in pictures:
        assert (picture.shape, picture.dtype) == ((48, 64, 3), np.uint8)
        assert picture.std() > 5.0
    for one, other in itertools.combinations(pictures, 2):
        assert np.abs(one.astype(int) - other).mean() > 1.0
    np.testing.assert_allclose(env.render(), pictures[-1], atol=3)
    env.close()


def test_from_above_there_is_something_to_see(graphics):
    settings = {"camera": "top", "render_size": (64, 48), "worlds": 0}
    env = DynaBarnEnv(render_mode="rgb_array", **settings)
    env.reset(seed=0)
    assert env.render().std() > 5.0
    env.close()


def test_without_a_mode_nothing_is_drawn_and_it_says_so():
    env = BarnEnv("barn300", worlds=0)
    env.reset()
    with pytest.warns(UserWarning, match="rgb_array"):
        assert env.render() is None


def test_people_need_a_display(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    env = BarnEnv("barn300", worlds=0, render_mode="human")
    with pytest.raises(HlsdError, match="there is no display"):
        env.reset()


class Viewer:
    """As MuJoCo's passive one; closed after some pictures."""

    def __init__(self, pictures):
        self.left, self.shown = pictures, 0

    def sync(self):
        self.shown += 1
        self.left -= 1

    def is_running(self):
        return self.left > 0


def test_a_window_shows_each_step_until_it_is_closed(monkeypatch):
    import contextlib

    import mujoco

    from hlsd.envs import rendering as envs_rendering
    from hlsd.report.staging import scene_of
    from hlsd.report.watching import Shower

    viewer, closed = Viewer(3), []

    @contextlib.contextmanager
    def window(course):
        model = scene_of(course.world, course.robot).compile()
        yield Shower(course, viewer, mujoco.MjData(model))
        closed.append(course)

    monkeypatch.setattr(envs_rendering, "window", window)
    env = BarnEnv("barn300", worlds=0, render_mode="human")
    env.reset(options={"trial": 0})
    for _ in range(5):
        env.step(STILL)
    assert viewer.shown == 3, "the start and two steps"
    env.close()
    assert len(closed) == 1
