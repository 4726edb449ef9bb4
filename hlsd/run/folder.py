"""The folder of a run: configuration, journal, episode rows.

A run writes ``run.json`` first, then one line per finished episode to a journal, after
its trajectory, where those are kept. When all are there, ``trajectories.zip``,
``timing.csv`` and ``episodes.csv`` are written, each in one piece, in order of planner,
world and trial. A folder with a journal is an interrupted run, which the same command
resumes.
"""

import csv
import json
import os
import shutil
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from hlsd.core.errors import HlsdError
from hlsd.core.files import write_atomic
from hlsd.core.settings import change
from hlsd.run.conditions import Conditions
from hlsd.run.record import read_record
from hlsd.run.row import COLUMNS, Row, episode_columns, fields, key_of, timing_columns
from hlsd.run.seal import read_seal, seal
from hlsd.run.trajectory import ARCHIVE, Key, pack, read_archive

EPISODES = "episodes.csv"
TIMING = "timing.csv"
MANIFEST = "run.json"
FORMAT = 2
"""Of ``run.json``. That of 0.1.0 has no format, and names in place of conditions."""
_JOURNAL = "journal.csv"
_PIECES = "trajectories"


@dataclass(frozen=True, slots=True)
class RunConfig:
    """Everything that decides a run's results.

    Attributes:
        planners: Names, in order.
        policy_sha256: Digest of each planner's policy file, "" where it has none.
        planner_sha256: Digest of each class or object that drives, "" for names.
        worlds: Indices, in order.
        trials: Runs per world and planner.
        conditions: What is driven under.
        measured: Version of each column that another package measures, by name.
    """

    planners: tuple[str, ...]
    policy_sha256: tuple[str, ...]
    worlds: tuple[int, ...]
    trials: int
    conditions: Conditions
    measured: Mapping[str, int] = field(default_factory=dict)
    planner_sha256: tuple[str, ...] = ()

    def as_json(self) -> dict[str, object]:
        """All of it as ``run.json`` holds it."""
        plain = {
            "planners": self.planners,
            "policy_sha256": self.policy_sha256,
            "planner_sha256": self.planner_sha256,
            "worlds": self.worlds,
            "trials": self.trials,
            "conditions": self.conditions.as_json(),
            "measured": dict(self.measured),
        }
        # As JSON gives it back, so that it compares with what was read.
        held: dict[str, object] = json.loads(json.dumps(plain))
        return held


class RunFolder:
    """Where a run's results go; nothing in it is ever overwritten.

    Attributes:
        path: The folder.
        finished: Rows of episodes done before, by (planner, world, trial).
    """

    def __init__(
        self, path: Path, config: RunConfig, versions: Mapping[str, str]
    ) -> None:
        """Claim an empty folder, or one that holds this run, interrupted.

        Args:
            path: Made where it does not exist.
            config: What decides the results.
            versions: Of the software, for the record.

        Raises:
            HlsdError: The folder is used for something else, or cannot be written.
        """
        self.path = path
        # The journal has the columns of both tables.
        held = fields()
        self._episode_columns = episode_columns(held)
        self._timing_columns = timing_columns(held)
        self._columns = tuple(
            dict.fromkeys(self._episode_columns + self._timing_columns)
        )
        found = _claim(path)
        if EPISODES in found:
            raise HlsdError(
                f"output folder {str(path)!r} already holds a finished run: "
                "choose another `out`",
                argument="out",
            )
        if found and MANIFEST not in found:
            raise _not_empty(path, found)
        if found:
            self._check_same(config)
        else:
            manifest = {
                "format": FORMAT,
                "config": config.as_json(),
                "versions": dict(versions),
            }
            write_atomic(path / MANIFEST, json.dumps(manifest, indent=2) + "\n")
        self.finished = self._read_journal()

    def append(
        self, rows: Iterable[Row], trajectories: Mapping[Key, bytes] | None = None
    ) -> None:
        """Add finished episodes to the journal; safe against interruption.

        Args:
            rows: Of the episodes.
            trajectories: Their blocks (`hlsd.run.trajectory`), for those that are to be
                kept. They are written first, so that what the journal holds has its
                trajectory.
        """
        self._keep(trajectories or {})
        journal = self.path / _JOURNAL
        with journal.open("a", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, self._columns, lineterminator="\n")
            for row in rows:
                writer.writerow(row)
                self.finished[key_of(row)] = row
            file.flush()
            os.fsync(file.fileno())

    def finish(self, planners: tuple[str, ...]) -> Path:
        """Write the tables and the trajectories from journal and pieces.

        Args:
            planners: Gives the order of the rows.

        Returns:
            Path of ``episodes.csv``.
        """
        order = sorted(
            self.finished, key=lambda key: (planners.index(key[0]), *key[1:])
        )
        rows = [self.finished[key] for key in order]
        pieces = self.path / _PIECES
        if pieces.is_dir():
            blocks = {
                key: block
                for piece in sorted(pieces.glob("*.zip"))
                for key, block in read_archive(piece).items()
            }
            write_atomic(self.path / ARCHIVE, pack(blocks, order))
        write_atomic(self.path / TIMING, _to_csv(rows, self._timing_columns))
        write_atomic(self.path / EPISODES, _to_csv(rows, self._episode_columns))
        seal(self.path, (EPISODES, TIMING, MANIFEST))
        (self.path / _JOURNAL).unlink(missing_ok=True)
        shutil.rmtree(pieces, ignore_errors=True)
        return self.path / EPISODES

    def _keep(self, trajectories: Mapping[Key, bytes]) -> None:
        """Put blocks into the pieces of their worlds, beside what is there."""
        for world in sorted({world for _, world, _ in trajectories}):
            piece = self.path / _PIECES / f"{world}.zip"
            piece.parent.mkdir(exist_ok=True)
            blocks = dict(read_archive(piece)) if piece.exists() else {}
            blocks |= {
                key: trajectories[key] for key in trajectories if key[1] == world
            }
            write_atomic(piece, pack(blocks, sorted(blocks)))

    def _check_same(self, config: RunConfig) -> None:
        held = _held_config(self.path)
        if held is None:
            raise HlsdError(
                f"output folder {str(self.path)!r} has an unreadable {MANIFEST}: "
                "choose another `out`",
                argument="out",
            )
        if differing := change(held, config.as_json()):
            raise HlsdError(
                f"output folder {str(self.path)!r} holds an interrupted run with "
                f"other settings ({differing}): choose another `out`",
                argument="out",
            )

    def _read_journal(self) -> dict[Key, Row]:
        journal = self.path / _JOURNAL
        if not journal.exists():
            return {}
        whole, _, _torn = journal.read_text(encoding="utf-8").rpartition("\n")
        # A line torn by a crash is cut off, so that the next append starts afresh.
        write_atomic(journal, whole + "\n" if whole else "")
        rows = list(csv.reader(whole.splitlines()))
        if any(len(row) != len(self._columns) for row in rows):
            raise HlsdError(
                f"output folder {str(self.path)!r} holds an interrupted run of another "
                "version of hlsd: choose another `out`",
                argument="out",
            )
        named = [dict(zip(self._columns, row, strict=True)) for row in rows]
        return {key_of(row): row for row in named}


def write_imported(
    path: Path,
    rows: Iterable[Mapping[str, str]],
    source: Mapping[str, object],
    conditions: Conditions | None = None,
) -> None:
    """Make the folder of a run that was not driven here.

    Args:
        path: Made where it does not exist; must be empty.
        rows: Its episodes, in order; columns that a row lacks are left empty.
        source: Where the rows are from, for the record; what JSON can write.
        conditions: What they were driven under, as far as anyone knows.

    Raises:
        HlsdError: The folder is not empty, or cannot be written.
    """
    found = _claim(path)
    if found:
        raise _not_empty(path, found)
    blank = dict.fromkeys(COLUMNS, "")
    known = {} if conditions is None else {"conditions": conditions.as_json()}
    held = [blank | dict(row) for row in rows]
    record = {"imported": dict(source), "rows": len(held), **known}
    write_atomic(path / MANIFEST, json.dumps(record, indent=2) + "\n")
    write_atomic(path / EPISODES, _to_csv(held, COLUMNS))
    seal(path, (EPISODES, MANIFEST))


def recorded_conditions(path: Path) -> Conditions | None:
    """What a run was driven under, as its folder says; None where it does not.

    A run of 0.1.0 recorded names only: its protocol is the one that 0.1.0 knew.

    Raises:
        HlsdError: The folder's record is damaged.
    """
    record = read_record(path / MANIFEST, read_seal(path))
    return None if record is None else record.conditions


def is_interrupted(path: Path, config: RunConfig) -> bool:
    """Whether a folder holds a run of exactly this configuration, unfinished."""
    return not (path / EPISODES).exists() and _held_config(path) == config.as_json()


def _claim(path: Path) -> list[str]:
    """Names of what a folder holds, which is made where it does not exist."""
    try:
        path.mkdir(parents=True, exist_ok=True)
        return sorted(entry.name for entry in path.iterdir())
    except OSError as error:
        raise HlsdError(
            f"cannot write to output folder {str(path)!r}: {error.strerror}"
        ) from error


def _not_empty(path: Path, found: list[str]) -> HlsdError:
    return HlsdError(
        f"output folder {str(path)!r} is not empty (it holds {found[0]!r}): "
        "choose a new or empty one"
    )


def _held_config(path: Path) -> dict[str, object] | None:
    try:
        held = json.loads((path / MANIFEST).read_text(encoding="utf-8"))["config"]
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return held if isinstance(held, dict) else None


def _to_csv(rows: list[Row], columns: tuple[str, ...]) -> str:
    lines = [",".join(columns)]
    for row in rows:
        lines.append(",".join(_quoted(row[column]) for column in columns))
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    return f'"{text.replace(chr(34), chr(34) * 2)}"' if {*',"\n'} & {*text} else text
