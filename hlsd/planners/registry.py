"""Planners by name: the built-in ones, installed plug-ins, and a module of one's own.

A plug-in is any callable that returns a `hlsd.planners.base.Planner`, or a
`PlannerEntry` where it drives from a policy file:

- installed: the entry point group ``hlsd.planners``, its name is the planner's;
- at hand: ``--planner my_module:MyPlanner``, importable from the working directory, or
  ``--planner path/to/file.py:MyPlanner``;
- a program: ``--planner "exec:./my_planner --gain 2"`` (docs/external.md).

Options (`hlsd.planners.options`) are arguments of that callable, or of what builds.
"""

import shlex
from dataclasses import replace
from pathlib import Path

from hlsd.core.errors import HlsdError
from hlsd.core.registry import Entry, Registry, built_in
from hlsd.planners.base import Planner
from hlsd.planners.built_in import AT_HAND as AT_HAND
from hlsd.planners.built_in import BUILT_IN as BUILT_IN
from hlsd.planners.built_in import FLOOR as FLOOR
from hlsd.planners.built_in import NEED_CHECKPOINTS as NEED_CHECKPOINTS
from hlsd.planners.driving import PlannerFaultError, guarded, kind_of, limits
from hlsd.planners.entry import PlannerEntry as PlannerEntry
from hlsd.planners.external.command import SCHEME, ProgramCommand
from hlsd.planners.making import called, made, require_planner
from hlsd.planners.options import Taker
from hlsd.planners.spelling import Options

ENTRY_POINT_GROUP = "hlsd.planners"


def _check(name: str, thing: object) -> PlannerEntry:
    if isinstance(thing, PlannerEntry):
        return replace(thing, name=name)
    if not callable(thing):
        raise HlsdError(
            f"planner {name!r} is {kind_of(thing)}, which cannot be called: give a "
            "class, or a function without arguments that returns a planner"
        )

    def build(_policy: Path | None, **options: object) -> Planner:
        return made(name, thing, options)

    return PlannerEntry(name, f"plug-in {name}", build, taker=lambda: Taker.of(thing))


def _likely(thing: object) -> bool:
    return hasattr(thing, "reset") and hasattr(thing, "plan")


def _program(reference: str) -> Entry[PlannerEntry]:
    """The planner that a command starts."""
    command = ProgramCommand.parse(reference)

    def build(_policy: Path | None) -> Planner:
        from hlsd.planners.external.planner import ExternalPlanner

        return ExternalPlanner(reference)

    summary = f"program {shlex.join(command.words)}"
    entry = PlannerEntry(reference, summary, build)
    return Entry(reference, reference, summary, lambda: entry)


planners = Registry[PlannerEntry](
    "planner",
    ENTRY_POINT_GROUP,
    lambda: (built_in(e.name, e.summary, e) for e in BUILT_IN.values()),
    _check,
    _likely,
    {SCHEME: _program},
)
"""Every planner there is."""


def list_planners() -> list[Entry[PlannerEntry]]:
    """The built-in planners and the installed ones, which are not imported for it."""
    return planners.entries()


def get_entry(name: str) -> PlannerEntry:
    """The planner called ``name``, or ``module:attribute`` of one's own.

    Raises:
        HlsdError: There is none, or it cannot be imported.
    """
    if name in BUILT_IN:
        return planners.get(name)
    # Importing a module runs its code.
    try:
        return guarded(lambda: planners.get(name), limits().begin_s)
    except PlannerFaultError as fault:
        if isinstance(fault.__context__, HlsdError):
            raise fault.__context__ from fault.__context__.__cause__
        raise HlsdError(
            f"planner {name!r} cannot be imported: {fault.reason.partition(': ')[2]}"
        ) from fault


def policy_path(entry: PlannerEntry, policy: Path | None) -> Path | None:
    """The policy file with which ``entry`` drives: the given one, else the shipped.

    Raises:
        HlsdError: A policy was given to a planner that takes none.
    """
    if not entry.needs_policy:
        if policy is not None:
            raise HlsdError(
                f"planner {entry.name!r} takes no policy file, got {str(policy)!r}"
            )
        return None
    if policy is not None:
        return policy
    from hlsd.learning.policy import shipped_policy

    return shipped_policy(entry.trained_as)


def make_planner(
    name: str,
    policy: Path | None = None,
    *,
    force_policy: bool = False,
    options: Options = (),
) -> Planner:
    """A new planner, with the shipped policy where it needs one and none is given.

    Args:
        name: See `get_entry`.
        policy: Its policy file; None is the shipped one.
        force_policy: Whether a built-in planner may drive from the policy of another.
        options: Arguments of what makes it.

    Raises:
        HlsdError: Unknown planner or option, an unusable policy file, or one that was
            trained for another planner.
    """
    entry = get_entry(name)
    path = policy_path(entry, policy)
    if policy is not None and not force_policy and has_policies_of_ours(name):
        from hlsd.learning.policy import require_trained_for

        require_trained_for(policy, entry.trained_as, name)
    given = entry.typed(options)
    if name in BUILT_IN:
        return entry.build(path, **given)
    return require_planner(name, called(name, lambda: entry.build(path, **given)))


def has_policies_of_ours(name: str) -> bool:
    """Whether a planner drives from files that `hlsd train` writes."""
    return name in BUILT_IN and BUILT_IN[name].needs_policy


def name_in_rows(name: str, policy: Path | None) -> str:
    """What a planner is called that may drive from the policy of another.

    Its own name where the policy was trained for it, else followed by ``@`` and the
    name of the planner that it was trained for, or ``unknown``.

    Raises:
        HlsdError: An unusable policy file.
    """
    if policy is None or not has_policies_of_ours(name):
        return name
    from hlsd.learning.policy import forced_name, trained_planner

    own = BUILT_IN[name].trained_as
    trained = trained_planner(policy, own)
    return name if trained == own else forced_name(name, trained)
