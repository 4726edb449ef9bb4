"""Names that a shell completes: planners, suites, protocols, robots, perturbations.

A key press must not wait for MuJoCo, Numba or NumPy: built-in names are written down
here, and a test compares them with the registries. Installed ones are read from what
packages announce, without importing them.
"""

from collections.abc import Callable, Iterable
from importlib.metadata import entry_points

from hlsd.core.errors import HlsdError
from hlsd.core.resources import user_data

BUILT_IN = {
    "planners": (
        *("dwa", "dwa05", "eband", "lfh04", "lfh10"),
        *("hlsd04", "hlsd10", "hlsd20", "mppi", "vfh", "pursuit"),
        *("td3", "sac", "lics", "drlvo"),
        *("mpc", "teb"),
    ),
    "suites": ("barn300", "course"),
    "protocols": (
        *("hlsd2021", "barn2022", "barn2024"),
        *("course", "dynabarn", "dynabarn2024", "shapes"),
    ),
    "robots": ("jackal", "jackal-ideal", "disc"),
    "perturbations": (
        *("lidar.mount_yaw", "lidar.mount_x", "lidar.noise_sd", "lidar.bias"),
        *("lidar.max_range", "lidar.beams", "lidar.dropout", "lidar.latency"),
        *("odometry.drift", "odometry.yaw_bias", "control.rate", "command.latency"),
        *("command.dead_band", "wheel.friction", "wheel.track", "robot.payload"),
        *("start.position", "start.yaw"),
    ),
}
KINDS = ("planners", "robots", "suites", "protocols", "metrics", "perturbations")


def names_of(kind: str) -> list[str]:
    """Names of a kind, built-in ones first.

    Args:
        kind: A key of `BUILT_IN`.
    """
    installed = sorted(point.name for point in entry_points(group=f"hlsd.{kind}"))
    return list(dict.fromkeys([*BUILT_IN[kind], *_own(kind), *installed]))


def _own(kind: str) -> list[str]:
    """The user's own, which only suites have."""
    if kind != "suites":
        return []
    try:
        return sorted(folder.name for folder in (user_data() / "suites").iterdir())
    except (HlsdError, OSError):
        return []


def _completing(
    names: Callable[[], Iterable[str]], ending: str = ""
) -> Callable[[str], list[str]]:
    def complete(incomplete: str) -> list[str]:
        found = (f"{name}{ending}" for name in names())
        return [name for name in found if name.startswith(incomplete)]

    return complete


complete_planners = _completing(lambda: names_of("planners"))
complete_suites = _completing(lambda: names_of("suites"))
complete_protocols = _completing(lambda: names_of("protocols"))
complete_robots = _completing(lambda: names_of("robots"))
complete_perturbations = _completing(lambda: names_of("perturbations"), "=")
complete_kinds = _completing(lambda: KINDS)
