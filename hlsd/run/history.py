"""When a run was driven, and by which commands: ``history.json``.

It decides nothing: it stands beside what does, and is not part of a run's identity or
of ``results.sha256``. A run that was interrupted has a session for each time that
it went on.
"""

import json
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

from hlsd.core.command import noted_command
from hlsd.core.errors import HlsdError
from hlsd.core.files import write_atomic
from hlsd.core.reading import read_json
from hlsd.core.text import one_line

HISTORY = "history.json"
_LONGEST = 2000


@dataclass(frozen=True, slots=True)
class Session:
    """A process that drove episodes of a run.

    Attributes:
        began: When, in UTC, as ``2026-05-04T13:02:11Z``; "" where it is unknown.
        command: Its command line; "" where it was none of hlsd's.
    """

    began: str
    command: str


@dataclass(frozen=True, slots=True)
class History:
    """Who drove a run, and when.

    Attributes:
        sessions: In order; none where they are unknown.
        ended: When the run was finished, as `Session.began`.
    """

    sessions: tuple[Session, ...] = ()
    ended: str = ""


def now() -> str:
    """The time in UTC, to the second, by ISO 8601."""
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime())


def this_session() -> dict[str, str]:
    """What this process says of itself, for a journal."""
    return {"began": now(), "command": noted_command()}


def session_of(said: Mapping[str, object]) -> Session:
    """A session as a journal or a ``history.json`` has it; "" for what it lacks."""
    began, command = (
        one_line(text, _LONGEST) if isinstance(text := said.get(key), str) else ""
        for key in ("began", "command")
    )
    return Session(began, command)


def write_history(folder: Path, sessions: Iterable[Session], ended: str) -> None:
    """Write the history of a run.

    Args:
        folder: The run's.
        sessions: In order.
        ended: When it was finished, such as `now`; "" where it goes on.

    Raises:
        HlsdError: It cannot be written.
    """
    held = {
        "sessions": [
            {"began": session.began, "command": session.command} for session in sessions
        ],
        "ended": ended,
    }
    write_atomic(folder / HISTORY, json.dumps(held, indent=2) + "\n")


def read_history(folder: Path) -> History:
    """What a folder says of its history; an empty one where it does not, or is damaged.

    Args:
        folder: Of a run.
    """
    try:
        held = read_json(folder / HISTORY, "history of a run")
    except HlsdError:
        return History()
    sessions, ended = held.get("sessions"), held.get("ended")
    return History(
        tuple(
            session_of(said)
            for said in (sessions if isinstance(sessions, list) else [])
            if isinstance(said, dict)
        ),
        one_line(ended, 60) if isinstance(ended, str) else "",
    )
