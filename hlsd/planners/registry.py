"""Planners by name: the built-in ones, installed plug-ins, and a module of one's own.

A plug-in is any callable that returns a `hlsd.planners.base.Planner`, or a
`PlannerEntry` where it drives from a policy file:

- installed: the entry point group ``hlsd.planners``, its name is the planner's;
- at hand: ``--planner my_module:MyPlanner``, importable from the working directory, or
  ``--planner path/to/file.py:MyPlanner``;
- a program: ``--planner "exec:./my_planner --gain 2"`` (docs/external.md).

Options (`hlsd.planners.options`) are arguments of that callable, or of what builds.
"""

import math
import shlex
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import partial
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from hlsd.core.errors import HlsdError
from hlsd.core.registry import Entry, Registry, built_in
from hlsd.planners.base import Planner
from hlsd.planners.driving import PlannerFaultError, guarded, kind_of, limits
from hlsd.planners.external.command import SCHEME, ProgramCommand
from hlsd.planners.making import called, made, require_planner
from hlsd.planners.options import Taker
from hlsd.planners.spelling import Options

if TYPE_CHECKING:
    from hlsd.learning.policy import Policy

ENTRY_POINT_GROUP = "hlsd.planners"
FLOOR = "pursuit"
"""The planner that shows what the global path alone is worth."""


@dataclass(frozen=True, slots=True)
class PlannerEntry:
    """A planner that exists.

    Attributes:
        name: As on the command line and in result rows.
        summary: One line for lists.
        build: Makes the planner; takes the policy file, None where it needs none, and
            options by their names.
        needs_policy: Whether it drives from a trained policy.
        policy_of: The planner whose policies it drives from; empty for its own.
        taker: Says which options there are; None reads it off ``build``: what that
            takes besides the policy file.
    """

    name: str
    summary: str
    build: Callable[..., Planner]
    needs_policy: bool = False
    policy_of: str = ""
    taker: Callable[[], Taker] | None = None

    @property
    def trained_as(self) -> str:
        """The planner that its policies are trained for."""
        return self.policy_of or self.name

    def typed(self, options: Options) -> dict[str, object]:
        """Options as `build` takes them.

        Raises:
            HlsdError: One does not exist, or is of another type.
        """
        if not options:
            return {}
        if self.taker is None:
            taker = replace(Taker.of(self.build, skip=1), name=self.name)
        else:
            taker = self.taker()
        return taker.typed(self.name, options)


def _hlsd10(policy: Path | None, max_speed: float = 1.0) -> Planner:
    from hlsd.planners.learned.hlsd import HlsdPlanner

    return HlsdPlanner(_load_policy(policy, "hlsd10"), _speed("hlsd10", max_speed))


def _hlsd20(policy: Path | None, **options: Any) -> Planner:
    from hlsd.planners.learned.hlsd20 import Hlsd20Planner, Hlsd20Spec

    return Hlsd20Planner(_load_policy(policy, "hlsd10"), Hlsd20Spec(**options))


def _hlsd04(policy: Path | None, **options: Any) -> Planner:
    from hlsd.planners.learned.hlsd import HlsdPlanner
    from hlsd.planners.learned.modulation import ModulationSpec

    modulation = ModulationSpec(**options)
    return HlsdPlanner(_load_policy(policy, "hlsd04"), modulation.max_speed, modulation)


def _lfh10(policy: Path | None, max_speed: float = 1.0) -> Planner:
    from hlsd.planners.learned.lfh import LfhPlanner

    return LfhPlanner(_load_policy(policy, "lfh10"), _speed("lfh10", max_speed))


def _lfh04(policy: Path | None, **options: Any) -> Planner:
    from hlsd.planners.learned.lfh import LfhPlanner
    from hlsd.planners.learned.modulation import ModulationSpec

    modulation = ModulationSpec(**options)
    return LfhPlanner(_load_policy(policy, "lfh04"), modulation.max_speed, modulation)


def _load_policy(path: Path | None, planner: str) -> "Policy":
    from hlsd.learning.policy import Policy, shipped_policy

    return Policy.load(shipped_policy(planner) if path is None else path, planner)


def _speed(planner: str, max_speed: float) -> float:
    if not 0.0 < max_speed < math.inf:
        raise HlsdError(f"{planner} max_speed is {max_speed}: it must be above 0")
    return max_speed


def _dwa(_policy: Path | None, **options: Any) -> Planner:
    from hlsd.planners.dwa.planner import HLSD_DWA, DwaPlanner

    return DwaPlanner(replace(HLSD_DWA, **options))


def _dwa05(_policy: Path | None, **options: Any) -> Planner:
    from hlsd.planners.dwa.planner import JACKAL_DWA, DwaPlanner

    return DwaPlanner(replace(JACKAL_DWA, **options))


def _pursuit(_policy: Path | None, **options: Any) -> Planner:
    from hlsd.planners.pursuit import PursuitConfig, PursuitPlanner

    return PursuitPlanner(PursuitConfig(**options))


def _mpc(_policy: Path | None, **options: Any) -> Planner:
    from hlsd.planners.mpc.planner import MpcConfig, MpcPlanner

    return MpcPlanner(MpcConfig(**options))


def _teb(_policy: Path | None, **options: Any) -> Planner:
    from hlsd.planners.teb.config import TebConfig
    from hlsd.planners.teb.planner import TebPlanner

    return TebPlanner(TebConfig(**options))


def _eband(_policy: Path | None, **options: Any) -> Planner:
    from hlsd.planners.eband.planner import BARN_EBAND, EbandPlanner

    return EbandPlanner(replace(BARN_EBAND, **options))


def _from_checkpoint(name: str) -> Callable[..., Planner]:
    """What drives from a checkpoint of others."""
    if name == "lics":
        from hlsd.planners.checkpoints.lics import LicsPlanner

        return LicsPlanner
    if name == "drlvo":
        from hlsd.planners.checkpoints.drlvo import DrlVoPlanner

        return DrlVoPlanner
    from hlsd.planners.checkpoints.baselines import BaselinePlanner

    return partial(BaselinePlanner, name)


def _adapter(name: str, summary: str) -> PlannerEntry:
    return PlannerEntry(
        name,
        f"{summary}; needs checkpoint=x.npz",
        lambda _policy, **options: _from_checkpoint(name)(**options),
        taker=lambda: replace(Taker.of(_from_checkpoint(name)), name=name),
    )


# Options are the fields of these, by planner; loaded when somebody gives one.
_CONFIGS = {
    "dwa": ("dwa.planner", "HLSD_DWA"),
    "dwa05": ("dwa.planner", "JACKAL_DWA"),
    "eband": ("eband.planner", "BARN_EBAND"),
    "mpc": ("mpc.planner", "MpcConfig"),
    "pursuit": ("pursuit", "PursuitConfig"),
    "teb": ("teb.config", "TebConfig"),
    "hlsd20": ("learned.hlsd20", "Hlsd20Spec"),
    "hlsd04": ("learned.modulation", "ModulationSpec"),
    "lfh04": ("learned.modulation", "ModulationSpec"),
}


def _fields(planner: str) -> Taker:
    module, name = _CONFIGS[planner]
    held = getattr(import_module(f"hlsd.planners.{module}"), name)
    return Taker.of_fields(planner, held() if isinstance(held, type) else held)


BUILT_IN: Mapping[str, PlannerEntry] = MappingProxyType(
    {
        entry.name: (
            replace(entry, taker=partial(_fields, entry.name))
            if entry.name in _CONFIGS
            else entry
        )
        for entry in (
            PlannerEntry(
                "dwa",
                "DWA as in the paper: up to 1 m/s, 12 x 40 samples",
                _dwa,
            ),
            PlannerEntry(
                "dwa05",
                "DWA as the Jackal ships it: up to 0.5 m/s, 6 x 20 samples",
                _dwa05,
            ),
            PlannerEntry(
                "eband",
                "E-Band as in the BARN trials of 2020: an elastic band, up to 0.39 m/s",
                _eband,
            ),
            PlannerEntry(
                "mpc",
                "nonlinear MPC along the global path: 2 s ahead, up to 1 m/s",
                _mpc,
            ),
            PlannerEntry(
                "teb",
                "TEB as a BARN team set it: a timed elastic band, up to 0.8 m/s",
                _teb,
            ),
            PlannerEntry(
                "lfh04",
                "LfH 0.4: hallucinates the path as it drives; learned at 0.4 m/s, "
                "modulated up to 0.6",
                _lfh04,
                needs_policy=True,
            ),
            PlannerEntry(
                "lfh10",
                "LfH 1.0: the same, learned from driving at 0 ... 1 m/s, unmodulated",
                _lfh10,
                needs_policy=True,
            ),
            PlannerEntry(
                "hlsd04",
                "HLSD 0.4: sober deployment, learned at 0.4 m/s, modulated up to 0.6",
                _hlsd04,
                needs_policy=True,
            ),
            PlannerEntry(
                "hlsd10",
                "HLSD 1.0: sober deployment, learned from driving at 0 ... 1 m/s",
                _hlsd10,
                needs_policy=True,
            ),
            PlannerEntry(
                "hlsd20",
                "HLSD 2.0: HLSD 1.0's policy, deployed for the BARN Challenge",
                _hlsd20,
                needs_policy=True,
                policy_of="hlsd10",
            ),
            PlannerEntry(
                FLOOR,
                "floor: regulated pure pursuit of the global path, blind to the scan",
                _pursuit,
            ),
            _adapter("td3", "TD3 baseline of the BARN Challenge"),
            _adapter("sac", "SAC baseline of the BARN Challenge"),
            _adapter("lics", "LiCS, a transformer, winner of the Challenge of 2024"),
            _adapter("drlvo", "DRL-VO, winner in simulation of 2022"),
        )
    }
)

NEED_CHECKPOINTS = frozenset({"td3", "sac", "lics", "drlvo"})
"""Built-in planners that drive from checkpoints of others, which hlsd does not have."""


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

        require_trained_for(policy, entry.trained_as)
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
