"""Drives two planners world by world until it is decided which is better.

Processes may be ahead of the world that is looked at next: what they drove of worlds
beyond the one where it was decided is left out when the run is finished.
"""

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import cast

from hlsd.core.errors import HlsdError
from hlsd.core.notices import notice
from hlsd.run.crew import Crew
from hlsd.run.folder import RunFolder
from hlsd.run.identity import RunConfig
from hlsd.run.stopping import UNTIL, Look, Stopped, Stopping, world_order
from hlsd.run.work import Done, Work, tasks_of

UNDECIDED = "inconclusive"
"""The verdict at the end of all worlds, where there is no other."""
_FIRST_ROUND = 8
"""Worlds that are handed out before it is seen which runs have to be tried again; each
round has twice as many."""


def require_pair(planners: Sequence[str], shard: object) -> None:
    """Refuse what cannot be compared world by world.

    Args:
        planners: Names.
        shard: Which part of the run is driven; None is all of it.

    Raises:
        HlsdError: There are not two planners, or it is a part.
    """
    if len(planners) != 2:
        raise HlsdError(
            f"`{UNTIL}` compares two planners, and there are {len(planners)} "
            f"({', '.join(planners)}): name two",
            argument=UNTIL,
        )
    if shard is not None:
        raise HlsdError(
            f"`{UNTIL}` looks at all worlds so far, which shard {shard} does not have: "
            "leave one of them out",
            argument=UNTIL,
        )


def rule_of(stopping: Stopping, config: RunConfig) -> Mapping[str, object]:
    """The rule as the run's identity holds it, with the order of the worlds.

    Raises:
        HlsdError: The rule does not go with the run.
    """
    require_pair(config.planners, config.shard)
    begun(stopping, config)
    held = config.conditions
    order = world_order(config.worlds, held.suite, held.suite_version, [held.seed])
    return {**stopping.rule, "order": order}


def begun(stopping: Stopping, config: RunConfig) -> Look:
    """What looks at a run's worlds, from the first on.

    Raises:
        HlsdError: The rule does not fit what is driven.
    """
    a, b = config.planners
    return stopping.begin(config.conditions, (a, b))


def drive_until(
    crew: Crew,
    work: Work,
    folder: RunFolder,
    look: Look,
    keep: Callable[[Done], None],
) -> Stopped:
    """Drive what the folder lacks, until it is decided.

    Args:
        crew: Drives.
        work: What it does with a task.
        folder: Of a run with a rule.
        look: Told of each world, in the rule's order.
        keep: Takes what is done.

    Returns:
        Where it stopped: the same for any crew and any interruption.
    """
    config = folder.config
    rule = cast(Mapping[str, object], config.until)
    order = cast(list[int], rule["order"])
    looks = _Looks(folder, order, look)
    for worlds in [] if looks.decided() else _rounds(order):
        tasks = list(tasks_of(config, folder.finished, worlds))
        with contextlib.closing(crew.drive(work, tasks)) as driven:  # type: ignore[type-var]
            for done in driven:
                keep(done)
                if looks.decided():
                    break
        if looks.decided():
            break
    count, verdict = looks.count, looks.verdict or UNDECIDED
    many = f"after {count} of {len(order)} worlds"
    notice(f"{UNTIL.replace('_', ' ')}: {config.planners[0]} is {verdict}, {many}")
    return Stopped(tuple(order), count, verdict, rule)


class _Looks:
    """Looks at worlds in their order, each as soon as it and those before are whole."""

    def __init__(self, folder: RunFolder, order: Sequence[int], look: Look) -> None:
        self._folder, self._order, self._look = folder, order, look
        self.count = 0
        self.verdict = ""

    def decided(self) -> bool:
        """Look at what can be looked at; whether that decides it."""
        rows, config = self._folder.finished, self._folder.config
        while not self.verdict and self.count < len(self._order):
            keys = [
                (planner, self._order[self.count], trial)
                for planner in config.planners
                for trial in range(config.trials)
            ]
            if not all(key in rows for key in keys):
                break
            self.verdict = self._look([rows[key] for key in keys])
            self.count += 1
        return bool(self.verdict)


def _rounds(order: Sequence[int]) -> Iterator[Sequence[int]]:
    first, size = 0, _FIRST_ROUND
    while first < len(order):
        yield order[first : first + size]
        first, size = first + size, 2 * size
