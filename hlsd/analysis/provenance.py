"""Where the rows of a run are from: when, by which command, from what."""

import hashlib
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from hlsd.analysis.labels import labels_of
from hlsd.analysis.runs import folder_of
from hlsd.core.reading import read_bytes, read_json
from hlsd.core.text import one_line
from hlsd.run.folder import EPISODES, MANIFEST
from hlsd.run.history import History, read_history
from hlsd.run.record import read_record
from hlsd.run.seal import Seal
from hlsd.run.table import MOST_BYTES


@dataclass(frozen=True, slots=True)
class Provenance:
    """What a run's folder says of where its rows are from.

    Attributes:
        label: Its folder, as it is told from the others.
        history: When it was driven, and by which commands.
        imported: Where its rows are from, in words; "" where they were driven.
        versions: Of the software that drove, by name.
        digests: SHA-256 of what decides the rows, and of the rows, by what it is of.
    """

    label: str
    history: History
    imported: str
    versions: Mapping[str, str]
    digests: Mapping[str, str]


def provenances(runs: Sequence[Path]) -> list[Provenance]:
    """Of each run.

    Args:
        runs: Folders of runs that `hlsd.analysis.runs.load_episodes` reads, or their
            tables.

    Raises:
        HlsdError: A folder's record is damaged.
    """
    labels = labels_of(runs)
    return [_of(run, label) for run, label in zip(runs, labels, strict=True)]


def _of(run: Path, label: str) -> Provenance:
    folder = folder_of(run)
    file = folder / MANIFEST
    plain = read_json(file, "record of a run") if file.exists() else {}
    imported = plain.get("imported")
    table = run / EPISODES if run.is_dir() else run
    return Provenance(
        label=label,
        history=read_history(folder),
        imported="" if imported is None else one_line(json.dumps(imported), 500),
        versions=_texts(plain.get("versions")),
        digests={
            **dict(_decisive(folder, plain)),
            f"rows ({table.name})": hashlib.sha256(
                read_bytes(table, "table of a run", MOST_BYTES)
            ).hexdigest(),
        },
    )


def _decisive(folder: Path, plain: Mapping[str, object]) -> Iterator[tuple[str, str]]:
    record = read_record(folder / MANIFEST, Seal())
    if record is None:
        return
    held = record.conditions
    if held is not None:
        if held.suite_digest:
            yield f"suite {held.suite}", held.suite_digest
        if held.robot_sha256:
            yield f"robot {held.robot}", held.robot_sha256
    for planner, digests in record.digests.items():
        for what, digest in digests.items():
            kind = "code" if what == "planner" else what
            yield f"{kind} of {planner}", digest
    config = plain.get("config")
    code = config.get("code") if isinstance(config, dict) else None
    for whose, digest in _texts(code).items():
        yield f"code of {whose}", digest


def _texts(held: object) -> dict[str, str]:
    """The texts of a mapping, each on a line."""
    if not isinstance(held, dict):
        return {}
    return {
        one_line(name, 80): one_line(text, 80)
        for name, text in held.items()
        if isinstance(text, str)
    }
