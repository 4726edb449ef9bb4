"""The checkpoint that a planner was given."""

from pathlib import Path

from hlsd.core.errors import HlsdError
from hlsd.learning.checkpoints.file import KINDS, Checkpoint
from hlsd.planners.base import Setup


def given(kind: str, checkpoint: Path | None) -> Checkpoint:
    """A planner's checkpoint, read.

    Args:
        kind: The planner's name.
        checkpoint: Its option; None where it was left out.

    Raises:
        HlsdError: None was given, or it is none of this planner.
    """
    if checkpoint is None:
        raise HlsdError(
            f"planner {kind!r}, {KINDS[kind]}, drives from a checkpoint that you get "
            f"and convert: --planner '{kind}(checkpoint=x.npz)' (docs/checkpoints.md)"
        )
    return Checkpoint.load(Path(checkpoint).expanduser(), kind)


def require_beams(kind: str, setup: Setup, beams: int) -> None:
    """Find out whether a network can take a robot's scans.

    Raises:
        HlsdError: They have another number of beams.
    """
    if setup.lidar.beams != beams:
        raise HlsdError(
            f"planner {kind!r} takes scans of {beams} beams, and the robot's lidar has "
            f"{setup.lidar.beams}"
        )
