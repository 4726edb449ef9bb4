"""The planners that come with hlsd; a new one gets its line here.

Each is imported when it is made, and its options when somebody gives one: listing
planners must not wait for their kernels.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from importlib import import_module
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from hlsd.core.errors import HlsdError
from hlsd.planners.base import Planner
from hlsd.planners.entry import PlannerEntry
from hlsd.planners.options import Taker

if TYPE_CHECKING:
    from hlsd.learning.policy import Policy

FLOOR = "pursuit"
"""The planner that shows what the global path alone is worth."""


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


def _mppi(_policy: Path | None, **options: Any) -> Planner:
    from hlsd.planners.mppi.config import MppiConfig
    from hlsd.planners.mppi.planner import MppiPlanner

    return MppiPlanner(MppiConfig(**options))


def _vfh(_policy: Path | None, **options: Any) -> Planner:
    from hlsd.planners.vfh.planner import VfhConfig, VfhPlanner

    return VfhPlanner(VfhConfig(**options))


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
    "mppi": ("mppi.config", "MppiConfig"),
    "vfh": ("vfh.planner", "VfhConfig"),
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
                "mppi",
                "MPPI as Nav2 has it, with the public BARN parameters: 2000 x 56 "
                "samples, up to 0.5 m/s",
                _mppi,
            ),
            PlannerEntry(
                "vfh",
                "VFH*: polar histograms and a tree that looks 1.5 m ahead, up to 1 m/s",
                _vfh,
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

AT_HAND = tuple(name for name in BUILT_IN if name not in NEED_CHECKPOINTS)
"""Built-in planners that drive with nothing but the package."""
