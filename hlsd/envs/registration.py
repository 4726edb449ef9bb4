"""What `gymnasium.make` finds: the environments by their names."""

from importlib.util import find_spec

from hlsd.core.errors import HlsdError

IDS = {
    "hlsd/Barn-v1": "hlsd.envs.environment:BarnEnv",
    "hlsd/DynaBarn-v1": "hlsd.envs.environment:DynaBarnEnv",
}
"""The environments, and what makes them."""


def register() -> None:
    """Announce the environments to Gymnasium, once.

    ``import hlsd.envs`` calls it, and so does the entry point ``gymnasium.envs``, which
    Gymnasium loads by itself up to 0.29.
    """
    from gymnasium.envs.registration import register as announce
    from gymnasium.envs.registration import registry

    for name, maker in IDS.items():
        if name not in registry:
            announce(id=name, entry_point=maker)


def require_gymnasium() -> None:
    """Refuse to go on without Gymnasium.

    Raises:
        HlsdError: It is not installed.
    """
    if find_spec("gymnasium") is None:
        raise HlsdError("gymnasium is not installed: `pip install 'hlsd[gym]'`")
