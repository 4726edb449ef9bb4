"""The shards of a run, joined: the folder that one process would have made of it.

All is checked before anything is written: the shards are of one run, finished, each
there once and none missing, and their rows and trajectories are those of their
episodes. The folder is made beside its place and then moved there, so that it is there
whole or not at all.
"""

import contextlib
import functools
import json
import os
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from pathlib import Path

from hlsd.core.errors import HlsdError
from hlsd.core.files import folder_in_one_piece, sync, sync_folder, write_atomic
from hlsd.core.reading import csv_rows, read_json, read_text, shown
from hlsd.core.settings import change
from hlsd.run.csv_text import to_csv
from hlsd.run.folder import EPISODES, MADE, MANIFEST, TIMING
from hlsd.run.history import (
    now,
    read_history,
    session_of,
    this_session,
    write_history,
)
from hlsd.run.identity import SHARD, other_making, other_settings
from hlsd.run.journal import JOURNAL
from hlsd.run.record import Record, read_record
from hlsd.run.row import COLUMNS, OPTIONAL_COLUMNS, TIMING_COLUMNS, Row, key_of
from hlsd.run.seal import SEAL, Seal, read_seal, seal
from hlsd.run.shard import Shard
from hlsd.run.table import (
    MOST_BYTES,
    check_episodes,
    check_same_rows,
    episode_text,
    read_table,
)
from hlsd.run.tracebacks import (
    TRACEBACKS,
    faults_of,
    read_tracebacks,
    tracebacks_text,
)
from hlsd.run.trajectory import ARCHIVE, Key, pack_into, read_archive

_OPEN = 128
"""Archives that are open at once, at most."""
_NAMED = 8
"""Missing shards that are named, at most."""
_AND = " and "


@dataclass(frozen=True, slots=True, eq=False)
class _Part:
    """A shard's folder, as it says of itself."""

    folder: Path
    seal: Seal
    record: Record
    shard: Shard
    manifest: Mapping[str, object]

    @property
    def config(self) -> dict[str, object]:
        """What decides the rows of the whole run."""
        held = self.manifest["config"]
        assert isinstance(held, dict)  # as its record was read
        return {key: value for key, value in held.items() if key != SHARD}

    @property
    def archive(self) -> Path:
        return self.folder / ARCHIVE


@dataclass(frozen=True, slots=True, eq=False)
class _Table:
    """The rows of a table, by episode, as they are written."""

    columns: tuple[str, ...]
    rows: dict[Key, Row]


def merge_shards(
    folders: Sequence[Path],
    out: Path,
    *,
    trajectories: bool = True,
    conclude: Callable[[Path], object] | None = None,
) -> Path:
    """Join the shards of a run; all but wall times is as one process makes it.

    Trajectories are read one by one as they are written.

    Args:
        folders: Of all shards, in any order.
        out: Folder for the run, new or empty.
        trajectories: Whether to keep them; without, shards may differ in whether they
            have any.
        conclude: Called with the folder, not yet in its place, when its tables are
            there.

    Returns:
        The folder.

    Raises:
        HlsdError: The shards do not make up one run, one is unfinished, damaged or was
            changed, or ``out`` cannot be written; nothing is written then.
    """
    _require_free(out)
    if not folders:
        raise HlsdError("no shard is given: give the folders of all shards of a run")
    parts = [_read(folder) for folder in folders]
    _require_one_run(parts)
    _require_all(parts)
    parts.sort(key=lambda part: part.shard.number)
    tables = [_tables(part) for part in parts]
    episodes, timing = (_joined(parts, held) for held in zip(*tables, strict=True))
    planners = parts[0].record.planners
    order = sorted(episodes.rows, key=lambda key: (planners.index(key[0]), *key[1:]))
    texts: dict[Key, str] = {}
    for part, (own, _) in zip(parts, tables, strict=True):
        faults = faults_of(own.rows[key] for key in order if key in own.rows)
        texts |= read_tracebacks(part.folder / TRACEBACKS, faults)
    faults = faults_of(episodes.rows[key] for key in order)
    kept = trajectories and _keep_trajectories(parts)
    manifest = {**parts[0].manifest, "config": parts[0].config}
    with _in_one_piece(out) as draft:
        write_atomic(draft / MANIFEST, json.dumps(manifest, indent=2) + "\n")
        if kept:
            with open(draft / ARCHIVE, "wb") as file:
                pack_into(file, _blocks(parts, order))
        if faults:
            write_atomic(draft / TRACEBACKS, tracebacks_text(texts, faults))
        for name, table in ((TIMING, timing), (EPISODES, episodes)):
            rows = (table.rows[key] for key in order)
            write_atomic(draft / name, to_csv(rows, table.columns))
        sessions = (read_history(part.folder).sessions for part in parts)
        write_history(draft, (*chain(*sessions), session_of(this_session())), now())
        seal(draft, (EPISODES, TIMING, MANIFEST))
        if conclude is not None:
            conclude(draft)
    return out


def _read(folder: Path) -> _Part:
    """What a folder says, which is a finished shard's."""
    file = folder / MANIFEST
    if not file.is_file():
        raise HlsdError(f"no run in {shown(folder)}: give the folder of a shard")
    if (folder / JOURNAL).exists() or not (folder / EPISODES).exists():
        raise HlsdError(
            f"the run in {shown(folder)} is not finished: the same `hlsd bench` "
            "command goes on with it"
        )
    if not (folder / SEAL).exists():
        raise HlsdError(
            f"{shown(folder)} has no {SEAL}, so that nothing shows that its rows are "
            "what was driven: restore it"
        )
    held = read_seal(folder)
    for name in (EPISODES, TIMING, MANIFEST):
        if name not in held.digests:
            raise HlsdError(f"{shown(folder / SEAL)} does not list {name}: restore it")
    record = read_record(file, held)
    if record is None or record.shard is None:
        raise HlsdError(
            f"the run in {shown(folder)} is whole, not one of several: give folders "
            "that `hlsd bench` made with `shard`",
            argument="shard",
        )
    manifest = read_json(file, "record of a run")
    return _Part(folder, held, record, record.shard, manifest)


def _require_one_run(parts: Sequence[_Part]) -> None:
    """Refuse shards of several runs, with what differs."""
    first = parts[0]
    for part in parts[1:]:
        held, ours = first.config, part.config
        differs = (
            _by_count(first.shard, part.shard)
            or other_settings(held, ours, _AND)
            or other_making(held, ours, _AND)
            or change(
                {**first.manifest, "config": None},
                {**part.manifest, "config": None},
                _AND,
            )
        )
        if differs:
            raise HlsdError(
                f"{shown(first.folder)} and {shown(part.folder)} are not of one run: "
                f"{differs}"
            )


def _by_count(first: Shard, other: Shard) -> str:
    return "" if first.count == other.count else f"shards {first} and {other}"


def _require_all(parts: Sequence[_Part]) -> None:
    """Refuse a shard that is there twice, and that any is missing."""
    found: dict[int, Path] = {}
    for part in parts:
        if part.shard.number in found:
            raise HlsdError(
                f"shard {part.shard} is there twice, in "
                f"{shown(found[part.shard.number])} and {shown(part.folder)}: give it "
                "once"
            )
        found[part.shard.number] = part.folder
    count = parts[0].shard.count
    missing = [str(Shard(n, count)) for n in range(1, count + 1) if n not in found]
    if missing:
        named = ", ".join(missing[:_NAMED])
        more = f" and {len(missing) - _NAMED} more" if len(missing) > _NAMED else ""
        raise HlsdError(
            f"of {count} shards {len(missing)} {'is' if len(missing) == 1 else 'are'} "
            f"missing: {named}{more}"
        )


def _tables(part: _Part) -> tuple[_Table, _Table]:
    """The episodes of a shard and their times; all of its own, and no others."""
    held = part.record.conditions
    required = [name for name in COLUMNS if name not in OPTIONAL_COLUMNS]
    episodes = read_table(part.folder / EPISODES, part.seal, required)
    protocol = None if held is None else held.protocol
    check_episodes(episodes, part.record, protocol, whole=True)
    timing = read_table(part.folder / TIMING, part.seal, TIMING_COLUMNS)
    check_same_rows(timing, episodes)
    return _written(part, EPISODES), _written(part, TIMING)


def _written(part: _Part, name: str) -> _Table:
    """A table whose cells are texts, as they stand in its file."""
    file = part.folder / name
    text = read_text(file, "table of a run", MOST_BYTES)
    part.seal.check(file, text.encode())
    (_, header), *lines = csv_rows(text, file, "table of a run")
    rows = [dict(zip(header, cells, strict=True)) for _, cells in lines]
    return _Table((*header,), {key_of(row): row for row in rows})


def _joined(parts: Sequence[_Part], tables: Sequence[_Table]) -> _Table:
    """One table of all rows."""
    columns = tables[0].columns
    for part, table in zip(parts, tables, strict=True):
        if table.columns != columns:
            raise HlsdError(
                f"the tables of {shown(parts[0].folder)} and {shown(part.folder)} have "
                "other columns: drive both with the same packages"
            )
    return _Table(columns, dict(chain(*(table.rows.items() for table in tables))))


def _keep_trajectories(parts: Sequence[_Part]) -> bool:
    """Whether the shards have their trajectories: all of them, or none."""
    having = [part for part in parts if part.archive.exists()]
    if not having:
        return False
    for part in parts:
        if not part.archive.exists():
            raise HlsdError(
                f"{shown(part.archive)} is not there, but {shown(having[0].archive)} "
                f"is: drive shard {part.shard} again to have it, or leave all out with "
                "`trajectories`",
                argument="trajectories",
            )
        kept, share = {*read_archive(part.archive)}, part.record.share
        if strange := [key for key in kept if not share.has(*key)]:
            raise HlsdError(
                f"{shown(part.archive)} has {episode_text(min(strange))}, which is "
                f"none of shard {part.shard}: restore it"
            )
        if len(kept) < share.count:
            raise HlsdError(
                f"{shown(part.archive)} has {len(kept)} of the {share.count} episodes "
                f"of shard {part.shard}: restore it, drive that again, or leave all "
                "out with `trajectories`",
                argument="trajectories",
            )
    return True


def _blocks(
    parts: Sequence[_Part], order: Sequence[Key]
) -> Iterator[tuple[Key, bytes]]:
    """The trajectories of all shards, each read when it is its turn."""
    opened = functools.lru_cache(_OPEN)(read_archive)
    places = {
        key: part.archive for part in parts for key in part.record.share.episodes()
    }
    for key in order:
        yield key, opened(places[key])[key]


def _require_free(out: Path) -> None:
    """Refuse a place that holds something."""
    try:
        found = sorted(out.iterdir()) if out.is_dir() else []
        if out.is_dir() and out.samefile("."):
            raise HlsdError(
                f"output folder {shown(out)} is the one that this runs in: name a new "
                "one",
                argument="out",
            )
    except OSError as error:
        raise HlsdError(f"cannot read {shown(out)}: {error.strerror}") from error
    if found:
        raise HlsdError(
            f"output folder {shown(out)} is not empty (it holds {found[0].name!r}): "
            "choose another `out`",
            argument="out",
        )
    if not out.is_dir() and os.path.lexists(out):
        raise HlsdError(
            f"output folder {shown(out)} is a file: choose another `out`",
            argument="out",
        )


@contextlib.contextmanager
def _in_one_piece(out: Path) -> Iterator[Path]:
    """A folder to write to, which takes its place when all is done, or goes."""
    place = out.resolve()
    try:
        with folder_in_one_piece(place) as draft:
            yield draft
            sync(draft, MADE)
        sync_folder(place.parent)
    except OSError as error:
        raise HlsdError(
            f"cannot write {shown(out)}: {error.strerror or error}"
        ) from error
