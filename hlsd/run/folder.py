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
from dataclasses import asdict, dataclass
from enum import StrEnum
from pathlib import Path

from hlsd.core.errors import HlsdError
from hlsd.core.files import write_atomic
from hlsd.run.trajectory import ARCHIVE, Key, pack, read_archive

METRICS_VERSION = "1"
"""Goes up when any metric is added, removed or redefined; stands in ``run.json``."""
EPISODES = "episodes.csv"
MANIFEST = "run.json"
_JOURNAL = "journal.csv"
_PIECES = "trajectories"


class Outcome(StrEnum):
    """How an episode ended.

    Members:
        SUCCESS: The goal was reached within the limit.
        TIMEOUT: The limit passed.
        COLLISION: A contact ended the run (protocols where contact does).
        ERROR: The planner ended it; the row's ``reason`` says how, first its kind.
    """

    SUCCESS = "success"
    TIMEOUT = "timeout"
    COLLISION = "collision"
    ERROR = "error"


class ErrorKind(StrEnum):
    """How a planner ends an episode: the word, before a colon, that begins a reason.

    Members:
        EXCEPTION: It raised.
        BAD_COMMAND: It gave a command that is not finite.
        TOO_SLOW: One command took longer than anyone would wait.
    """

    EXCEPTION = "exception"
    BAD_COMMAND = "bad command"
    TOO_SLOW = "too slow"


ERROR_KINDS = tuple(kind.value for kind in ErrorKind)

COLUMNS = (
    "suite",
    "suite_version",
    "world",
    "planner",
    "robot",
    "robot_version",
    "trial",
    "seed",
    "protocol",
    "outcome",
    "reason",
    "time_s",
    "contacts",
    "contact_time_s",
    "path_length_m",
    "official_length_m",
    "shortest_length_m",
    "min_clearance_m",
    "mean_clearance_m",
    "jerk_m_s3",
    "yaw_rate_change_rad_s",
    "recoveries",
    "contact_distance_m",
    "time_to_contact_s",
    "recovery_ticks",
    "turn_ticks",
    "ticks",
    "replans",
    "sim_steps",
    "sim_time_s",
    "wall_s",
)
TEXT_COLUMNS = (
    "suite",
    "suite_version",
    "planner",
    "robot",
    "robot_version",
    "protocol",
    "outcome",
    "reason",
)
NUMBER_COLUMNS = tuple(name for name in COLUMNS if name not in TEXT_COLUMNS)
"""An empty cell is a number that nobody knows."""
OPTIONAL_COLUMNS = (
    "official_length_m",
    "shortest_length_m",
    "min_clearance_m",
    "mean_clearance_m",
    "jerk_m_s3",
    "yaw_rate_change_rad_s",
    "recoveries",
    "contact_distance_m",
    "time_to_contact_s",
)
"""Tables without these are read as if they were empty."""
# Wall times never repeat; all but `wall_s` are kept out of episodes.csv.
TIMING_COLUMNS = (
    "planner",
    "world",
    "trial",
    "wall_s",
    "planning_wall_s",
    "ticks",
    "planning_median_ms",
    "planning_p95_ms",
    "planning_max_ms",
    "overruns",
)
_ALL = tuple(dict.fromkeys(COLUMNS + TIMING_COLUMNS))

Row = dict[str, str]


@dataclass(frozen=True, slots=True)
class RunConfig:
    """Everything that decides a run's results.

    Attributes:
        planners: Names, in order.
        policy_sha256: Digest of each planner's policy file, "" where it has none.
        suite: Name of the suite.
        suite_version: Its version.
        suite_digest: SHA-256 over its grids and paths.
        worlds: Indices, in order.
        trials: Runs per world and planner.
        protocol: Name.
        robot: Name.
        robot_version: Version of its parameters.
        seed: Of start jitter and noise.
    """

    planners: tuple[str, ...]
    policy_sha256: tuple[str, ...]
    suite: str
    suite_version: str
    suite_digest: str
    worlds: tuple[int, ...]
    trials: int
    protocol: str
    robot: str
    robot_version: str
    seed: int


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
        found = _claim(path)
        if EPISODES in found:
            raise HlsdError(
                f"output folder {str(path)!r} already holds a finished run: "
                "choose another --out"
            )
        if found and MANIFEST not in found:
            raise _not_empty(path, found)
        if found:
            self._check_same(config)
        else:
            manifest = {"config": asdict(config), "versions": dict(versions)}
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
            writer = csv.DictWriter(file, _ALL, lineterminator="\n")
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
        write_atomic(self.path / "timing.csv", _to_csv(rows, TIMING_COLUMNS))
        write_atomic(self.path / EPISODES, _to_csv(rows, COLUMNS))
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
                "choose another --out"
            )
        for name, value in _plain(config).items():
            if held.get(name) != value:
                raise HlsdError(
                    f"output folder {str(self.path)!r} holds an interrupted run with "
                    f"other settings ({name} {_short(held.get(name))}, now "
                    f"{_short(value)}): choose another --out"
                )

    def _read_journal(self) -> dict[Key, Row]:
        journal = self.path / _JOURNAL
        if not journal.exists():
            return {}
        whole, _, _torn = journal.read_text(encoding="utf-8").rpartition("\n")
        # A line torn by a crash is cut off, so that the next append starts afresh.
        write_atomic(journal, whole + "\n" if whole else "")
        rows = list(csv.reader(whole.splitlines()))
        if any(len(row) != len(_ALL) for row in rows):
            raise HlsdError(
                f"output folder {str(self.path)!r} holds an interrupted run of another "
                "version of hlsd: choose another --out"
            )
        named = [dict(zip(_ALL, row, strict=True)) for row in rows]
        return {key_of(row): row for row in named}


def write_imported(
    path: Path, rows: Iterable[Mapping[str, str]], source: Mapping[str, object]
) -> None:
    """Make the folder of a run that was not driven here.

    Args:
        path: Made where it does not exist; must be empty.
        rows: Its episodes, in order; columns that a row lacks are left empty.
        source: Where the rows are from, for the record; what JSON can write.

    Raises:
        HlsdError: The folder is not empty, or cannot be written.
    """
    found = _claim(path)
    if found:
        raise _not_empty(path, found)
    blank = dict.fromkeys(COLUMNS, "")
    record = json.dumps({"imported": dict(source)}, indent=2) + "\n"
    write_atomic(path / MANIFEST, record)
    write_atomic(path / EPISODES, _to_csv([blank | dict(row) for row in rows], COLUMNS))


def is_interrupted(path: Path, config: RunConfig) -> bool:
    """Whether a folder holds a run of exactly this configuration, unfinished."""
    return not (path / EPISODES).exists() and _held_config(path) == _plain(config)


def key_of(row: Mapping[str, str]) -> Key:
    """(planner, world, trial) of a row."""
    return row["planner"], int(row["world"]), int(row["trial"])


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


def _plain(config: RunConfig) -> dict[str, object]:
    """The configuration as JSON gives it back."""
    plain: dict[str, object] = json.loads(json.dumps(asdict(config)))
    return plain


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


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."
