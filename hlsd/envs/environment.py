"""The environments: BARN's worlds and DynaBARN's, stepped by a learner's actions."""

import math
from collections import OrderedDict
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, cast

import gymnasium
import numpy as np
import numpy.typing as npt
from gymnasium.error import ResetNeeded

from hlsd.core.errors import HlsdError, require_at_least, unknown_name
from hlsd.data.selection import extent, selection_text
from hlsd.data.worlds import Suite
from hlsd.envs.rendering import CAMERAS, Screen, screen_of
from hlsd.envs.reward import Step, Weights, reward, weights_of
from hlsd.envs.rows import numbers_of
from hlsd.envs.spaces import (
    ActionReader,
    ActionSpec,
    ObservationMaker,
    ObservationSpec,
    Seen,
)
from hlsd.envs.worlds import barn_suite, dynabarn_suite
from hlsd.navigation.navigator import Navigator
from hlsd.run.episode import Episode, episode_of
from hlsd.run.outcome import Outcome
from hlsd.run.protocol import Protocol, protocol_for
from hlsd.run.recording import Recorder
from hlsd.run.session import PERIOD_S, Course, Session, open_course
from hlsd.sim.perturbations import Disturbance, disturbances
from hlsd.sim.robots import RobotDescription, get_robot

TRIALS = 1_000_000
"""Trials that are drawn are below this."""
COURSES_KEPT = 16
"""Worlds that stay compiled: each takes some 5 MB, and 20 ms to compile again."""
OPTIONS = ("world", "trial")
"""Of `NavigationEnv.reset`."""


_METADATA = {"render_modes": ["rgb_array", "human"], "render_fps": round(1 / PERIOD_S)}


class NavigationEnv(gymnasium.Env[Seen, npt.ArrayLike]):
    """A robot that is to reach a goal among obstacles.

    Each episode is a trial in a world, under a protocol, as `hlsd.bench` drives it:
    the same actions give the same poses, contacts and row, to the bit.

    Attributes:
        suite: Where its worlds are from.
        worlds: Indices of those that are drawn from.
        protocol: The rules.
        session: What is driven now; None before the first reset.
        weights: Of the reward.
    """

    metadata: dict[str, Any] = _METADATA

    # Settings have one argument each, by keyword.
    def __init__(
        self,
        suite: Suite,
        *,
        worlds: str | int | Iterable[int] | None = None,
        protocol: str | Protocol | None = None,
        robot: str | RobotDescription = "jackal",
        perturbations: Mapping[str, float] | Iterable[str | Disturbance] | str = (),
        period_s: float = PERIOD_S,
        seed: int = 0,
        observation: str | ObservationSpec = "scan+local_goal",
        action: str | ActionSpec = "normalised",
        reward: Mapping[str, float] | Weights | None = None,
        render_mode: str | None = None,
        camera: str = "chase",
        render_size: tuple[int, int] = (640, 360),
        courses_kept: int = COURSES_KEPT,
    ) -> None:
        """Check the settings; one world is compiled for that.

        Args:
            suite: Where its worlds are from.
            worlds: Indices that are drawn from, or ``"start:stop:step"``; None is all.
            protocol: A protocol, its name, or ``"module:attribute"``; None is the one
                of the worlds' layout.
            robot: A robot, its name, or ``"module:attribute"``.
            perturbations: As in `hlsd.bench`.
            period_s: Of a step: a whole number of physics steps [s].
            seed: Of starts, noise and perturbations, as in `hlsd.bench`.
            observation: As `hlsd.envs.spaces.observation_spec` reads it.
            action: As `hlsd.envs.spaces.action_spec` reads it.
            reward: Weights by name; those left out are `hlsd.envs.reward.Weights`'s.
            render_mode: ``"rgb_array"``, ``"human"``, or None.
            camera: Of pictures: ``"chase"``, ``"top"`` or ``"robot"``.
            render_size: Width and height of pictures [pixels].
            courses_kept: Worlds that stay compiled, 1 or more.

        Raises:
            HlsdError: A setting that cannot be.
        """
        self.suite = suite
        chosen = selection_text(worlds)
        self.worlds = suite.indices if chosen is None else suite.select(chosen)
        self.robot = get_robot(robot)
        self.protocol = protocol_for(protocol, suite.layout.name)
        self.protocol.require_fit(suite.name, suite.layout.name)
        self.perturbations = disturbances(perturbations)
        require_at_least(0, "seed", seed)
        require_at_least(1, "courses_kept", courses_kept)
        self.seed, self.period_s = seed, period_s
        self.weights = weights_of(reward)
        lidar, limits = self.robot.lidar, self.robot.limits
        self._maker = ObservationMaker(observation, lidar, limits)
        self._reader = ActionReader(action, limits)
        self.observation_space = self._maker.space()
        self.action_space = self._reader.space()
        modes = self.metadata["render_modes"]
        if render_mode is not None and render_mode not in modes:
            raise unknown_name("render mode", f"{render_mode}", modes)
        if camera not in CAMERAS:
            raise unknown_name("camera", f"{camera}", CAMERAS)
        self.render_mode = render_mode
        self._camera, self._render_size = camera, render_size
        self._screen: Screen | None = None
        self._courses: OrderedDict[int, Course] = OrderedDict()
        self._courses_kept = courses_kept
        self._navigator: Navigator | None = None
        self.session: Session | None = None
        self._course(self.worlds[0]).simulator.check_period(period_s)
        self.metadata = {**self.metadata, "render_fps": max(1, round(1 / period_s))}

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Seen, dict[str, Any]]:
        """Put the robot at the start of a trial.

        Args:
            seed: Of the draws of worlds and trials from here on.
            options: ``world``, index of a world of the suite, and ``trial``, a number
                from 0; what is not given is drawn.

        Returns:
            What is seen, and where: see `step`.

        Raises:
            HlsdError: An option that there is not, or a world that is none.
        """
        super().reset(seed=seed)
        world, trial = self._episode(options or {})
        self._recorder = Recorder()
        session = Session(self._course(world), self.seed, [self._recorder])
        known = session.reset(trial, period_s=self.period_s)
        self.session = session
        self._goal = self.protocol.goal(session.course.world).tolist()
        self._distance_m = self._to_goal_m()
        self._contacts, self._touching_s = 0, 0.0
        if self.render_mode == "human":
            self.render()
        return self._maker.make(known), self._info()

    def step(
        self, action: npt.ArrayLike
    ) -> tuple[Seen, float, bool, bool, dict[str, Any]]:
        """Drive an action for one period.

        Args:
            action: As the action space has it, ``(2,)``; the numbers are taken as they
                are, those of float64, too.

        Returns:
            What is seen; the reward; whether the goal was reached or a contact ended
            the run; whether the time limit passed; and what is known: ``suite``,
            ``world``, ``trial``, ``time_s`` on the protocol's clock, ``contacts``,
            ``mover_contacts``, ``outcome`` ("" while the run goes on), ``success``,
            and at the end ``row``, see `hlsd.envs.rows.numbers_of`.

        Raises:
            HlsdError: An action that is none, not finite or out of bounds.
            ResetNeeded: No episode is under way.
        """
        session = self.session
        if session is None or session.outcome is not None:
            raise ResetNeeded("no episode is under way: call reset first")
        known = session.step(self._reader.command(action))
        simulator, outcome = session.course.simulator, session.outcome
        distance_m = self._to_goal_m()
        happened = Step(
            progress_m=self._distance_m - distance_m,
            period_s=self.period_s,
            contacts=simulator.contacts - self._contacts,
            touching_s=simulator.contact_time_s - self._touching_s,
            reached=outcome is Outcome.SUCCESS,
            collided=outcome is Outcome.COLLISION,
        )
        self._distance_m = distance_m
        self._contacts = simulator.contacts
        self._touching_s = simulator.contact_time_s
        info = self._info()
        if outcome is not None:
            info["row"] = numbers_of(self.episode, session, self.suite)
        if self.render_mode == "human":
            self.render()
        return (
            self._maker.make(known),
            reward(happened, self.weights),
            happened.reached or happened.collided,
            outcome is Outcome.TIMEOUT,
            info,
        )

    def render(self) -> Any:
        """A picture ``(height, width, 3)``, uint8; in ``"human"`` mode nothing.

        Raises:
            HlsdError: Nothing here can draw, or there is no display.
            ResetNeeded: There was no reset yet.
        """
        if self.render_mode is None:
            gymnasium.logger.warn(
                'nothing is drawn: give render_mode="rgb_array" or "human" to make'
            )
            return None
        if self.session is None:
            raise ResetNeeded("there is nothing to draw: call reset first")
        course = self.session.course
        if self._screen is not None and self._screen.course is not course:
            self._put_out()
        if self._screen is None:
            self._screen = screen_of(
                self.render_mode, course, self._camera, self._render_size
            )
        return self._screen.show(self.session)

    def close(self) -> None:
        """Free window, graphics and compiled worlds; `reset` may follow."""
        self._put_out()
        self._courses.clear()
        self._navigator = None
        self.session = None

    @property
    def episode(self) -> Episode:
        """What happened, once it is over: its ``trajectory`` has it tick by tick.

        Raises:
            HlsdError: It is not over.
        """
        session = self.session
        if session is None or session.outcome is None:
            raise HlsdError("the episode is not over: step until it is")
        return episode_of(session, self._recorder, np.empty(0), 0.0)

    def _put_out(self) -> None:
        screen, self._screen = self._screen, None
        if screen is not None:
            screen.close()

    def _episode(self, options: Mapping[str, Any]) -> tuple[int, int]:
        """World and trial, drawn where they are not given."""
        for name in options:
            if name not in OPTIONS:
                raise unknown_name("option of reset", str(name), OPTIONS)
        world, trial = options.get("world"), options.get("trial")
        if world is None:
            world = self.worlds[int(self.np_random.integers(len(self.worlds)))]
        elif not isinstance(world, int | np.integer) or isinstance(world, bool):
            raise HlsdError(
                f"option world is {world!r}: give the index of a world; suite "
                f"{self.suite.name!r} has {extent(self.suite.indices)}"
            )
        if trial is None:
            trial = int(self.np_random.integers(TRIALS))
        require_at_least(0, "trial", trial)
        return int(world), int(trial)

    def _course(self, world: int) -> Course:
        """A compiled world; the newest are kept."""
        course = self._courses.get(world)
        if course is None:
            course = open_course(
                self.suite[world],
                self.suite.name,
                self.protocol,
                self.robot,
                self.perturbations,
                self._navigator,
            )
            self._navigator = course.navigator
        self._courses[world] = course
        self._courses.move_to_end(world)
        while len(self._courses) > self._courses_kept:
            self._courses.popitem(last=False)
        return course

    def _to_goal_m(self) -> float:
        """Straight from base_link to the goal, as they truly are [m]."""
        motion = cast(Session, self.session).motion
        x, y = motion.x - self._goal[0], motion.y - self._goal[1]
        return math.sqrt(x * x + y * y)

    def _info(self) -> dict[str, Any]:
        session = cast(Session, self.session)
        simulator, outcome = session.course.simulator, session.outcome
        return {
            "suite": self.suite.name,
            "world": session.course.world.index,
            "trial": session.trial,
            "time_s": session.referee.time_s,
            "contacts": simulator.contacts,
            "mover_contacts": simulator.mover_contacts,
            "outcome": "" if outcome is None else outcome.value,
            "success": outcome is Outcome.SUCCESS,
        }


class BarnEnv(NavigationEnv):
    """``hlsd/Barn-v1``: worlds that stand still."""

    def __init__(
        self,
        suite: str | Path | Suite | None = None,
        *,
        worlds_seed: int = 0,
        **settings: Any,
    ) -> None:
        """Settings as in `NavigationEnv`, and where its worlds are from.

        Args:
            suite: A suite's name or folder; None makes BARN's kind of worlds in memory.
            worlds_seed: Of those.
            **settings: Of `NavigationEnv`.

        Raises:
            HlsdError: A setting that cannot be.
        """
        super().__init__(barn_suite(suite, worlds_seed), **settings)


class DynaBarnEnv(NavigationEnv):
    """``hlsd/DynaBarn-v1``: worlds with moving obstacles."""

    def __init__(
        self,
        suite: str | Path | Suite | None = None,
        *,
        tier: str | None = None,
        worlds_seed: int = 0,
        **settings: Any,
    ) -> None:
        """Settings as in `NavigationEnv`, and where its worlds are from.

        Args:
            suite: A suite's name or folder; None makes DynaBARN's kind of worlds in
                memory.
            tier: Of those: ``"easy"``, which None is, ``"medium"`` or ``"hard"``.
            worlds_seed: Of those.
            **settings: Of `NavigationEnv`.

        Raises:
            HlsdError: A setting that cannot be.
        """
        super().__init__(dynabarn_suite(suite, tier, worlds_seed), **settings)
