"""One hard world, HLSD 1.0 beside DWA: what hlsd is, in a picture that moves."""

from collections.abc import Callable
from pathlib import Path

from hlsd.core.errors import HlsdError
from hlsd.report.video import Shown, write_video
from hlsd.run.drivers import driver
from hlsd.run.episode import run_episode
from hlsd.run.session import open_course

WORLD = 217
"""Of barn300: DWA takes two and a half times as long there as HLSD 1.0."""
PLANNERS = {"hlsd10": "HLSD 1.0", "dwa": "DWA"}
_SPEED = 2.5
_SIZE = (400, 260)

Progress = Callable[[str, int, int], None]
"""Told what is done, how many of it, and of how many."""


def demo(file: Path, progress: Progress | None = None) -> dict[str, str]:
    """Drive the two planners and write the video.

    Args:
        file: New; ``.gif``, or ``.mp4`` with the extra ``video``.
        progress: Called now and then.

    Returns:
        How each planner's run ended, by its title.

    Raises:
        HlsdError: The file exists or is of another kind, or nothing here can draw.
    """
    if file.exists():
        raise HlsdError(f"{str(file)!r} exists already: give another file")
    shown, ended = [], {}
    for number, (name, title) in enumerate(PLANNERS.items(), 1):
        course = open_course(WORLD, "barn300", None, "jackal")
        episode = run_episode(course, driver(name).make(), seed=0, trial=0)
        ended[title] = f"{episode.outcome}, {episode.time_s:.1f} s"
        shown.append(
            Shown(
                title=title,
                world=course.world,
                robot=course.robot,
                protocol=course.protocol,
                trajectory=episode.trajectory,
            )
        )
        if progress is not None:
            progress("runs", number, len(PLANNERS))

    def drawn(done: int, total: int) -> None:
        if progress is not None:
            progress("pictures", done, total)

    write_video(shown, file, size=_SIZE, speed=_SPEED, progress=drawn)
    return ended
