"""The folder of a run: configuration, journal, episode rows.

A run writes ``run.json`` first, then one line per finished episode to a journal. When
all are there, ``episodes.csv`` is written in one piece, in order of planner, world and
trial. A folder with a journal is an interrupted run, which the same command resumes.
"""

import csv
import json
import os
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path

from hlsd.errors import HlsdError
from hlsd.files import write_atomic

EPISODES = "episodes.csv"
MANIFEST = "run.json"
_JOURNAL = "journal.csv"

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
    "recovery_ticks",
    "turn_ticks",
    "ticks",
    "replans",
    "sim_steps",
    "sim_time_s",
    "wall_s",
)
# Wall times never repeat; all but `wall_s` are kept out of episodes.csv.
TIMING_COLUMNS = ("planner", "world", "trial", "wall_s", "planning_wall_s", "ticks")
_ALL = tuple(dict.fromkeys(COLUMNS + TIMING_COLUMNS))

Row = dict[str, str]
Key = tuple[str, int, int]


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
        try:
            path.mkdir(parents=True, exist_ok=True)
            found = sorted(entry.name for entry in path.iterdir())
        except OSError as error:
            raise HlsdError(
                f"cannot write to output folder {str(path)!r}: {error.strerror}"
            ) from error
        if EPISODES in found:
            raise HlsdError(
                f"output folder {str(path)!r} already holds a finished run: "
                "choose another --out"
            )
        if found and MANIFEST not in found:
            raise HlsdError(
                f"output folder {str(path)!r} is not empty (it holds {found[0]!r}): "
                "choose a new or empty one"
            )
        if found:
            self._check_same(config)
        else:
            manifest = {"config": asdict(config), "versions": dict(versions)}
            write_atomic(path / MANIFEST, json.dumps(manifest, indent=2) + "\n")
        self.finished = self._read_journal()

    def append(self, rows: Iterable[Row]) -> None:
        """Add finished episodes to the journal; safe against interruption."""
        journal = self.path / _JOURNAL
        with journal.open("a", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, _ALL, lineterminator="\n")
            for row in rows:
                writer.writerow(row)
                self.finished[key_of(row)] = row
            file.flush()
            os.fsync(file.fileno())

    def finish(self, planners: tuple[str, ...]) -> Path:
        """Write ``episodes.csv`` and ``timing.csv`` from the journal.

        Args:
            planners: Gives the order of the rows.

        Returns:
            Path of ``episodes.csv``.
        """
        rows = [
            self.finished[key]
            for key in sorted(
                self.finished, key=lambda key: (planners.index(key[0]), *key[1:])
            )
        ]
        write_atomic(self.path / "timing.csv", _to_csv(rows, TIMING_COLUMNS))
        write_atomic(self.path / EPISODES, _to_csv(rows, COLUMNS))
        (self.path / _JOURNAL).unlink(missing_ok=True)
        return self.path / EPISODES

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
        lines = csv.DictReader(whole.splitlines(), _ALL)
        return {key_of(row): dict(row) for row in lines}


def is_interrupted(path: Path, config: RunConfig) -> bool:
    """Whether a folder holds a run of exactly this configuration, unfinished."""
    return not (path / EPISODES).exists() and _held_config(path) == _plain(config)


def key_of(row: Mapping[str, str]) -> Key:
    """(planner, world, trial) of a row."""
    return row["planner"], int(row["world"]), int(row["trial"])


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
