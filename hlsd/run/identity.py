"""What a run is: all that decides its rows, and what a process must find to drive it.

Rows go together in one folder if everything here is the same: planners, worlds, trials
and conditions, which are the settings, and the code, policies and packages that drive
them.
"""

import hashlib
import json
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

import cloudpickle

from hlsd.core.content import content_sha256
from hlsd.core.errors import HlsdError
from hlsd.core.imported import (
    Code,
    code_of,
    digest_of,
    forget_edited,
    modules_behind,
    own_code,
    require_loaded,
)
from hlsd.core.registry import BUILT_IN, Entry, Registry
from hlsd.core.software import DECISIVE
from hlsd.data.worlds import Suite, World
from hlsd.planners.options import files_of
from hlsd.planners.registry import BUILT_IN as PLANNERS
from hlsd.planners.registry import get_entry, planners, policy_path
from hlsd.run.conditions import Conditions
from hlsd.run.differences import other_making as other_making
from hlsd.run.differences import other_settings as other_settings
from hlsd.run.drivers import Driver
from hlsd.run.protocol import COURSE, Protocol, protocols
from hlsd.run.row import FIELDS, fields, plug_in_metrics
from hlsd.run.shard import Shard, Share
from hlsd.run.stopping import UNTIL
from hlsd.sim.perturbations import perturbations
from hlsd.sim.robots import RobotDescription, robots

SHARD = "shard"
"""Key of the shard in ``run.json``, where the run is one."""
_DRIVES = ("hlsd.run.work", "hlsd.planners.registry")


@dataclass(frozen=True)
class RunConfig:
    """Everything that decides a run's results.

    Attributes:
        planners: Names, in order.
        policy_sha256: Digest of each planner's policy file, "" where it has none.
        worlds: Indices, in order; of a shard, those of its whole run.
        trials: Runs per world and planner.
        conditions: What is driven under.
        measured: Version of each column that another package measures, by name.
        planner_sha256: Digest of the code of each planner, and of what a class or
            object holds; "" for hlsd's own.
        code: Digests of other code that drives, by whose it is: hlsd's own, and those
            of protocols, robots, perturbations and metrics that are not.
        versions: Of the packages in `DECISIVE`.
        shard: Which part of the run is driven; None is all of it.
        references: What planners with names of one's own are, with their options.
        until: The rule by which it stops, with the order of its worlds; None is at its
            end.
    """

    planners: tuple[str, ...]
    policy_sha256: tuple[str, ...]
    worlds: tuple[int, ...]
    trials: int
    conditions: Conditions
    measured: Mapping[str, int] = field(default_factory=dict)
    planner_sha256: tuple[str, ...] = ()
    code: Mapping[str, str] = field(default_factory=dict)
    versions: Mapping[str, str] = field(default_factory=dict)
    shard: Shard | None = None
    references: Mapping[str, str] = field(default_factory=dict)
    until: Mapping[str, object] | None = None

    @property
    def share(self) -> Share:
        """Its episodes."""
        alone = self.conditions.protocol.layout == COURSE.layout
        return Share(self.planners, self.worlds, self.trials, alone, self.shard)

    def as_json(self) -> dict[str, object]:
        """All of it as ``run.json`` holds it."""
        plain = {
            "planners": self.planners,
            "policy_sha256": self.policy_sha256,
            "planner_sha256": self.planner_sha256,
            "worlds": self.worlds,
            "trials": self.trials,
            **({} if self.shard is None else {SHARD: str(self.shard)}),
            **({"references": dict(self.references)} if self.references else {}),
            **({} if self.until is None else {UNTIL: dict(self.until)}),
            "conditions": self.conditions.as_json(),
            "measured": dict(self.measured),
            "code": dict(self.code),
            "versions": dict(self.versions),
        }
        # As JSON gives it back, so that it compares with what was read.
        held: dict[str, object] = json.loads(json.dumps(plain))
        return held

    def sha256(self) -> str:
        """Digest of all of it."""
        text = json.dumps(self.as_json(), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()


@dataclass(frozen=True, slots=True)
class Expected:
    """What each process of a run must find, so that what was digested is driven.

    Attributes:
        code: The modules that drive.
        policies: SHA-256 of the policy file of each planner that has one.
        worlds: SHA-256 of grid and path of each world.
        programs: Digest of each planner that is a program, and of its files.
    """

    code: Code
    policies: Mapping[str, str]
    worlds: Mapping[int, tuple[str, str]]
    programs: Mapping[str, str] = field(default_factory=dict)

    def check_code(self) -> None:
        """Hold what this process has loaded against it.

        Raises:
            HlsdError: A module was edited since the run began.
        """
        require_loaded(self.code)

    def check_program(self, held: Driver) -> None:
        """Hold a planner's program against it, as it is now, if it is one.

        Raises:
            HlsdError: A file is another than when the run began, or is gone.
        """
        wanted, program = self.programs.get(held.name), held.program
        if wanted is not None and program is not None and wanted != program.sha256():
            raise HlsdError(
                f"the program of planner {held.name!r}, or a file that its command "
                f"names, is another than this run began with: {held.reference}"
            )

    def check_policy(self, held: Driver) -> None:
        """Hold a planner's policy file against it, as it is now.

        Raises:
            HlsdError: The file was replaced since the run began, or is gone.
        """
        wanted = self.policies.get(held.name)
        path = policy_file(held)
        if wanted is not None and path is not None and wanted != _sha256(path):
            raise HlsdError(
                f"policy {str(path)!r} of planner {held.name!r} was replaced after "
                "this run had begun"
            )

    def check_worlds(self, suite: Suite) -> None:
        """Hold what a suite says of its worlds against it.

        Raises:
            HlsdError: The suite is another.
        """
        for index, wanted in self.worlds.items():
            if suite.digests.get(index) != wanted:
                raise HlsdError(
                    f"suite {suite.name!r} is another than this run began with: its "
                    f"world {index} differs, or is not there"
                )

    def check_robot(self, robot: RobotDescription, sha256: str) -> None:
        """Hold a robot's model against its digest.

        Raises:
            HlsdError: The model is another, or is not there.
        """
        try:
            found = robot.sha256
        except OSError as error:
            raise HlsdError(
                f"cannot read {str(robot.model_file)!r} of robot {robot.name!r}: "
                f"{error.strerror}"
            ) from error
        if found != sha256:
            raise HlsdError(
                f"the model {str(robot.model_file)!r} of robot {robot.name!r} is "
                "another than this run began with"
            )

    def check_world(self, world: World) -> None:
        """Hold a world against it.

        Raises:
            HlsdError: The suite was changed since the run began.
        """
        found = world.digests()
        if self.worlds.get(world.index, found) != found:
            raise HlsdError(
                f"world {world.index} of suite {world.suite!r} is not the one whose "
                "digest the suite gave when this run began: was it changed meanwhile?"
            )


def identify(
    drivers: Iterable[Driver],
    conditions: Conditions,
    worlds: Mapping[int, tuple[str, str]],
    trials: int,
    values: Mapping[str, object],
) -> tuple[RunConfig, Expected]:
    """What decides a run's rows, and what its processes must find.

    Args:
        drivers: The planners, each made once before, so that its code is loaded.
        conditions: What is driven under.
        worlds: SHA-256 of grid and path, by index.
        trials: Runs per world and planner.
        values: Protocol and robot, by kind, each as it was given: a name or a value.

    Raises:
        HlsdError: Code or a policy cannot be read, or was edited since this process
            loaded it.
    """
    held = tuple(drivers)
    modules: dict[str, str] = {}
    policies = {
        each.name: _sha256(path)
        for each in held
        if (path := policy_file(each)) is not None
    }
    planner_sha256 = []
    for each in held:
        code, content = _of_planner(each)
        modules |= code
        planner_sha256.append(_joined(digest_of(code), content))
    others: dict[str, str] = {}
    for whose, thing, module in _foreign(conditions, values):
        code = code_of(modules_behind(thing, {module} if module else ()))
        modules |= code
        # What no module has, this process was given: it counts as it is.
        others[whose] = _joined(digest_of(code), "" if module else _content(thing))
    ours = own_code(*_DRIVES)
    programs = {
        each.name: program.sha256()
        for each in held
        if (program := each.program) is not None
    }
    expected = Expected({**ours, **modules}, policies, worlds, programs)
    expected.check_code()
    config = RunConfig(
        planners=tuple(each.name for each in held),
        policy_sha256=tuple(policies.get(each.name, "") for each in held),
        planner_sha256=tuple(planner_sha256),
        worlds=tuple(worlds),
        trials=trials,
        conditions=conditions,
        measured={
            field.name: field.metric.version if field.metric is not None else 1
            for field in fields()
            if field.name not in FIELDS
        },
        code={"hlsd": digest_of(ours), **others},
        versions={name: version(name) for name in DECISIVE},
        references={
            each.name: each.spelled
            for each in held
            if each.spelled not in ("", each.name)
        },
    )
    return config, expected


def policy_file(held: Driver) -> Path | None:
    """The file that a planner drives from: the given one, the shipped, or none.

    Raises:
        HlsdError: A policy was given to a planner that takes none.
    """
    if held.reference is None:
        return None
    return policy_path(get_entry(held.reference), held.policy)


def load_anew(drivers: Iterable[Driver], named: Iterable[tuple[str, str]]) -> None:
    """Have modules of others loaded anew that were edited since they were loaded.

    What is given by its name is what its file says when the run begins.

    Args:
        drivers: The planners.
        named: Kind and name of a protocol, a robot, perturbations.

    Raises:
        HlsdError: There is no such thing, or a file is not Python.
    """
    registries = {
        "planner": planners,
        "protocol": protocols,
        "robot": robots,
        "perturbation": perturbations,
    }
    references = (each.reference for each in drivers)
    names = [("planner", name) for name in references if name is not None]
    for kind, name in (*names, *named):
        registry: Registry[Any] = registries[kind]  # type: ignore[assignment]
        if module := registry.entry(name).module:
            forget_edited(module)


def worlds_of(suite: Suite, indices: Iterable[int]) -> dict[int, tuple[str, str]]:
    """SHA-256 of grid and path of worlds, as the suite's digest has them."""
    return {index: suite.digests[index] for index in indices}


def _of_planner(held: Driver) -> tuple[Code, str]:
    """The code of a planner that is not hlsd's, and what else tells it from others."""
    if held.reference is None:
        thing = cloudpickle.loads(held.pickled)
        return code_of(modules_behind(thing)), held.sha256
    if held.program is not None:
        return {}, held.program.sha256()
    # A name of one's own says nothing of what it stands for.
    content = "" if held.spelled == held.name else held.spelled
    files = files_of(held.options)
    content = _joined(content, *map(_sha256, files)) if files else content
    if held.reference in PLANNERS:
        return {}, content
    entry = planners.entry(held.reference)
    if not entry.module:
        thing, _ = planners.registered[held.reference]
        return code_of(modules_behind(thing)), _joined(content, _content(thing))
    behind = modules_behind(get_entry(held.reference).build, {entry.module})
    return code_of(behind), content


def _foreign(
    conditions: Conditions, values: Mapping[str, object]
) -> Iterator[tuple[str, object, str]]:
    """What else is not hlsd's own: how it is called, the thing, its module or ""."""
    # The conditions hold robots and protocols whole, but for code of others in them.
    protocol, robot = values["protocol"], values["robot"]
    if isinstance(robot, str):
        yield from _unless_built_in("robot", robots.entry(robot))
    if isinstance(protocol, str):
        yield from _unless_built_in("protocol", protocols.entry(protocol))
    elif isinstance(protocol, Protocol) and not _is_ours(protocol.ends):
        yield f"protocol {protocol.name}", protocol.ends, ""
    for held in conditions.perturbations:
        yield from _unless_built_in("perturbation", perturbations.entry(held.name))
    for column in fields():
        if column.name not in FIELDS:
            entry = plug_in_metrics.entry(column.name)
            yield from _unless_built_in("metric", entry)


def _unless_built_in(kind: str, entry: Entry[Any]) -> Iterator[tuple[str, object, str]]:
    if entry.origin != BUILT_IN:
        yield f"{kind} {entry.name}", entry.load(), entry.module


def _is_ours(thing: object) -> bool:
    return type(thing).__module__.split(".")[0] == __name__.split(".")[0]


def _content(thing: object) -> str:
    try:
        return content_sha256(thing)
    except Exception:  # it cannot be pickled, so that its workers will not have it
        return ""


def _joined(*parts: str) -> str:
    """One digest of several; of a single one that says something, itself."""
    said = [part for part in parts if part]
    if len(said) < 2:
        return "".join(said)
    return hashlib.sha256(" ".join(parts).encode()).hexdigest()


def _sha256(path: Path) -> str:
    try:
        return hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise HlsdError(f"cannot read {str(path)!r}: {error.strerror}") from error
