"""Finished runs, read: the table of their episodes, and what they were driven under.

A table of episodes keeps its protocol in ``attrs``, as the run recorded it. That says
what a failure counts as, whatever this version of hlsd calls by the same name.
"""

import html
from collections import ChainMap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pandas as pd

from hlsd.analysis.columns import column
from hlsd.analysis.labels import labels_of, place_of, shown_names
from hlsd.analysis.parts import joined_shards, note_part, shards_of
from hlsd.analysis.run_reference import RunReference
from hlsd.core.errors import HlsdError, unknown_name
from hlsd.core.types import FloatArray
from hlsd.run.conditions import Conditions, first_protocol
from hlsd.run.folder import EPISODES, MANIFEST, TIMING, recorded_conditions
from hlsd.run.protocol import Protocol, get_protocol
from hlsd.run.record import Record, read_record
from hlsd.run.row import COLUMNS, FIELDS, OPTIONAL_COLUMNS
from hlsd.run.seal import Seal, read_seal
from hlsd.run.table import (
    KEYS,
    Table,
    check_episodes,
    check_same_rows,
    read_table,
)
from hlsd.run.trajectory import Key, Renamed, Trajectory, decode, read_trajectories
from hlsd.sim.perturbations import recorded_disturbances

# What a table keeps in its ``attrs``, as JSON has it.
_PROTOCOL = "hlsd protocol"
_PERTURBATIONS = "hlsd perturbations"
_NAMES = "hlsd names"


@dataclass(frozen=True, eq=False)
class Run:
    """A finished run.

    Attributes:
        path: Its folder.
        episodes: A row per episode; docs/columns.md says what the columns hold.
        conditions: What it was driven under; None where it did not record them.
    """

    path: Path
    episodes: pd.DataFrame
    conditions: Conditions | None

    @property
    def planners(self) -> list[str]:
        """Names of the planners, in order."""
        return [str(name) for name in self.episodes["planner"].unique()]

    @property
    def worlds(self) -> list[int]:
        """Indices of the worlds, in order."""
        return [int(world) for world in self.episodes["world"].unique()]

    def summary(self) -> pd.DataFrame:
        """A row per planner: success, times and contacts, with 95 % intervals."""
        from hlsd.analysis.summary import summarise

        return summarise(self.episodes)

    def trajectory(
        self, world: int, planner: str | None = None, trial: int = 0
    ) -> Trajectory:
        """An episode, tick by tick.

        Args:
            world: Index of the world.
            planner: Its name; may be left out if the run has one.
            trial: Number of the trial.

        Raises:
            HlsdError: The run has no such episode, or kept no trajectory of it.
        """
        if planner is None:
            if len(self.planners) > 1:
                raise HlsdError(
                    f"{str(self.path)!r} holds {', '.join(self.planners)}: name one"
                )
            planner = self.planners[0]
        if planner not in self.planners:
            raise unknown_name(f"planner of {str(self.path)!r}", planner, self.planners)
        kept = read_trajectories(self.path)
        if (planner, world, trial) not in kept:
            held = "none" if not kept else f"{len(kept)} others"
            raise HlsdError(
                f"{str(self.path)!r} kept no trajectory of {planner}, world {world}, "
                f"trial {trial} (it kept {held})"
            )
        return decode(kept[planner, world, trial])

    def __repr__(self) -> str:
        """What was run, in a line."""
        held = self.episodes
        if held.empty:
            return f"Run({str(self.path)!r}: no episodes)"
        first = held.iloc[0]
        part = "".join(f", shard {shard}" for shard in shards_of(held).values())
        return (
            f"Run({str(self.path)!r}: {', '.join(self.planners)}; {len(held)} episodes "
            f"in {len(self.worlds)} worlds of {first['suite']}, protocol "
            f"{first['protocol']}, robot {first['robot']}{part})"
        )

    def _repr_html_(self) -> str:
        """The summary as a table, for notebooks."""
        table = self.summary().to_html(index=False, float_format=lambda x: f"{x:.3g}")
        return f"<p>{html.escape(repr(self))}</p>{table}"


def load_run(path: Path | str) -> Run:
    """A finished run.

    Args:
        path: Its folder, or its ``episodes.csv``.

    Raises:
        HlsdError: It is not there, or holds no finished run.
    """
    file = Path(path)
    episodes = load_episodes(file)
    folder = folder_of(file).resolve()
    return Run(folder, episodes, recorded_conditions(folder))


def load_episodes(path: Path, *, whole: bool = True) -> pd.DataFrame:
    """The rows of a run; unknown numbers are NaN, unknown texts "".

    With them come the planning times of each run (``planning_median_ms`` and so on),
    where ``timing.csv`` lies beside them.

    The rows are all of the run's, as its ``run.json`` counts them, and each cell is
    what its column declares (`hlsd.run.table`).

    Args:
        path: The run's folder, or its ``episodes.csv``. A table of another name, or
            without a ``run.json`` beside it, may hold any rows.
        whole: Whether rows that are missing are an error; a copy of a run that goes on
            (`hlsd.run.following`) has those that are done.

    Raises:
        HlsdError: It is not there, is no such table, or is damaged.
    """
    file = path / EPISODES if path.is_dir() else path
    folder = file.parent
    if not file.exists():
        if file.name == EPISODES and (folder / MANIFEST).exists():
            raise HlsdError(
                f"the run in {str(folder)!r} is not finished: the same `hlsd bench` "
                "command goes on with it"
            )
        raise HlsdError(f"no {EPISODES} at {str(path)!r}: give a run's folder")
    seal = read_seal(folder)
    record = read_record(folder / MANIFEST, seal)
    required = [name for name in COLUMNS if name not in OPTIONAL_COLUMNS]
    table = read_table(file, seal, required)
    protocol = _protocol(table, record)
    counted = whole and file.name == EPISODES
    check_episodes(table, record, protocol, whole=counted)
    episodes = pd.DataFrame(dict(table.columns))
    for name in OPTIONAL_COLUMNS:
        if name not in episodes.columns:
            episodes[name] = "" if FIELDS[name].kind == "text" else np.nan
    episodes = _with_planning_times(episodes, table, file.with_name(TIMING), seal)
    if protocol is not None:
        note_protocol(episodes, protocol)
    if record is not None and record.conditions is not None:
        disturbed = ", ".join(map(str, record.conditions.perturbations))
        episodes.attrs[_PERTURBATIONS] = disturbed
    note_part(episodes, record)
    return episodes


def planning_times(folder: Path) -> pd.DataFrame:
    """The rows of a run's ``timing.csv``.

    Raises:
        HlsdError: It is not there or is damaged.
    """
    return pd.DataFrame(dict(_read_times(folder / TIMING, read_seal(folder)).columns))


def join_runs(
    folders: Sequence[Path],
    planners: Mapping[Path, Sequence[str] | None] = MappingProxyType({}),
    *,
    whole: bool = True,
) -> pd.DataFrame:
    """The rows of several runs, to be summed up in one table.

    Args:
        folders: Of finished runs, of one suite and one protocol. A planner that more
            than one of them holds gets its folder's name appended: what has one name
            need not be one planner.
        planners: Those of a folder that are meant; all where there are none or None.
        whole: As of `load_episodes`.

    Raises:
        HlsdError: A run is missing or given twice, holds no episodes, or they were
            driven under other conditions.
    """
    places = [place_of(folder) for folder in folders]
    for n, place in enumerate(places):
        if place in places[:n]:
            raise HlsdError(f"the run in {str(place)!r} is given twice: give it once")
    runs = [_rows(folder, planners.get(folder), whole) for folder in folders]
    for name in ("suite", "suite_version", "protocol"):
        found = dict.fromkeys(str(v) for run in runs for v in run[name].unique())
        if len(found) > 1:
            raise HlsdError(
                f"the runs differ in their {name} ({', '.join(found)}): a table holds "
                "one"
            )
    shown = shown_names(folders, runs)
    for run, names in zip(runs, shown, strict=True):
        run["planner"] = run["planner"].map(names)
    held = [
        conditions_of(run, folder_of(folder))
        for run, folder in zip(runs, folders, strict=True)
    ]
    for other in held[1:]:
        for name, (ours, theirs) in held[0].differences(other).items():
            raise HlsdError(
                f"the runs differ in their {name} ({ours}, {theirs}): a table holds one"
            )
    joined = pd.concat(runs, ignore_index=True)
    joined.attrs.update(runs[0].attrs)
    if len(runs) > 1:
        joined.attrs.update(joined_shards(runs, labels_of(folders)))
    joined.attrs[_NAMES] = shown
    return joined


def _rows(folder: Path, planners: Sequence[str] | None, whole: bool) -> pd.DataFrame:
    """A run's rows, one at least; None is of all its planners."""
    rows = load_episodes(folder, whole=whole)
    held = list(dict.fromkeys(map(str, rows["planner"])))
    if not held:
        raise HlsdError(f"the run in {str(folder)!r} holds no episodes")
    if planners is None:
        return rows
    chosen = [RunReference(folder, name).chosen(held) for name in planners]
    return rows[rows["planner"].isin(chosen)].reset_index(drop=True)


def join_trajectories(
    folders: Sequence[Path],
    episodes: pd.DataFrame | None = None,
    kept: Sequence[Mapping[Key, bytes]] | None = None,
) -> Mapping[Key, bytes]:
    """Blocks of the trajectories that runs kept, by episode as `join_runs` names it.

    Each is read when it is asked for.

    Args:
        folders: As given to `join_runs`.
        episodes: What that gave; the rows are read again if left out.
        kept: The blocks of each run, by its own names; those of its archive if left
            out.

    Raises:
        HlsdError: An archive is damaged.
    """
    if episodes is None:
        shown = shown_names(folders, [load_episodes(folder) for folder in folders])
    else:
        shown = episodes.attrs[_NAMES]
    if kept is None:
        kept = [read_trajectories(folder_of(folder)) for folder in folders]
    return ChainMap(*(Renamed(*h) for h in zip(kept, shown, strict=True)))  # type: ignore[arg-type]


def folder_of(run: Path) -> Path:
    """The folder of a run that is given by it or by its ``episodes.csv``."""
    return run if run.is_dir() else run.parent


def suite_digest(run: Path) -> str:
    """Of the suite that a run was driven in, as it recorded it; "" if it did not."""
    held = recorded_conditions(folder_of(run))
    return "" if held is None else held.suite_digest


def planner_digests(folder: Path, planner: str) -> dict[str, str]:
    """Digests of what decides how a run's planner drives, by what they are of.

    Args:
        folder: The run's.
        planner: Its name.

    Raises:
        HlsdError: The folder's record is damaged.
    """
    record = read_record(folder / MANIFEST, read_seal(folder))
    return {} if record is None else dict(record.digests.get(planner, {}))


def conditions_of(episodes: pd.DataFrame, folder: Path) -> Conditions:
    """What a table's episodes were driven under, as their run or their rows have it.

    Args:
        episodes: From `load_episodes`, of one run; or some of its rows.
        folder: The run's.

    Raises:
        HlsdError: The rows are of several suites, protocols, robots or perturbations.
    """
    one = {}
    for name in (
        "suite",
        "suite_version",
        "protocol",
        "robot",
        "robot_version",
        "perturbations",
    ):
        found = list(dict.fromkeys(map(str, episodes[name])))
        if len(found) > 1:
            raise HlsdError(f"{str(folder)!r} holds runs of several: {name} {found}")
        one[name] = found[0]
    seeds = episodes["seed"].unique()
    known = len(seeds) == 1 and not pd.isna(seeds[0])
    held = recorded_conditions(folder)
    return Conditions(
        suite=one["suite"],
        suite_version=one["suite_version"],
        suite_digest="" if held is None else held.suite_digest,
        protocol=protocol_of(episodes),
        robot=one["robot"],
        robot_version=one["robot_version"],
        robot_sha256="" if held is None else held.robot_sha256,
        seed=int(seeds[0]) if known else None,
        # Rows that were taken out of their run's folder tell for themselves.
        perturbations=(
            recorded_disturbances(one["perturbations"])
            if held is None
            else held.perturbations
        ),
    )


def protocol_of(episodes: pd.DataFrame) -> Protocol:
    """The rules that a table's episodes were driven under.

    Args:
        episodes: From `load_episodes` or `join_runs`, or rows of such a table. A table
            of another origin is read by the name in its rows.

    Raises:
        HlsdError: It holds several protocols, or an unknown one.
    """
    names = [str(name) for name in episodes["protocol"].unique()]
    if len(names) > 1:
        raise HlsdError(f"the episodes are of several protocols: {', '.join(names)}")
    held = episodes.attrs.get(_PROTOCOL)
    if held is not None and held["name"] == names[0]:
        return Protocol.from_json(held)
    return get_protocol(names[0])


def perturbations_of(episodes: pd.DataFrame) -> str:
    """What stood between world and robot, as it is typed; "" where nothing did.

    Of rows without a record, what they say themselves; of several, each once.
    """
    if _PERTURBATIONS in episodes.attrs:
        return str(episodes.attrs[_PERTURBATIONS])
    held = episodes.get("perturbations", pd.Series(dtype=object))
    return " or ".join(text for text in dict.fromkeys(map(str, held)) if text)


def note_protocol(episodes: pd.DataFrame, protocol: Protocol) -> None:
    """Keep with rows the rules that they were driven under, as `load_episodes` does."""
    episodes.attrs[_PROTOCOL] = protocol.as_json()


def times_s(episodes: pd.DataFrame) -> FloatArray:
    """Time of each run, a failure's being the protocol's limit [s], ``(n,)``.

    Args:
        episodes: From `load_episodes`, of one protocol.
    """
    limit_s = protocol_of(episodes).limit_s
    success = (episodes["outcome"] == "success").to_numpy()
    return np.where(success, episodes["time_s"].to_numpy(np.float64), limit_s)


def times_contact_fails_s(episodes: pd.DataFrame) -> FloatArray:
    """Time of each run, the limit if it failed or touched anything [s], ``(n,)``.

    Where a contact ends a run these are `times_s`. NaN where contacts were not counted,
    as in imported runs.

    Args:
        episodes: From `load_episodes`, of one protocol.
    """
    contacts = column("contacts")(episodes)
    limit_s = protocol_of(episodes).limit_s
    times = np.where(contacts > 0, limit_s, times_s(episodes))
    return np.where(np.isnan(contacts), np.nan, times)


def _protocol(table: Table, record: Record | None) -> Protocol | None:
    """The rules of a table's rows, as its run recorded them, else as 0.1.0 knew them.

    None where they are several, or none that anybody knows.
    """
    if record is not None and record.conditions is not None:
        return record.conditions.protocol
    names = dict.fromkeys(table.texts("protocol"))
    return first_protocol(next(iter(names))) if len(names) == 1 else None


def _read_times(file: Path, seal: Seal) -> Table:
    return read_table(file, seal, (*KEYS, "planning_wall_s", "ticks"))


def _with_planning_times(
    episodes: pd.DataFrame, table: Table, file: Path, seal: Seal
) -> pd.DataFrame:
    """Episodes with the planning times of ``timing.csv``, where there is one."""
    if table.file.name != EPISODES:
        return episodes
    if not file.exists():
        seal.check_there(file)
        return episodes
    times = _read_times(file, seal)
    check_same_rows(times, table)
    known = {*KEYS, *episodes.columns, "planning_wall_s"}
    columns = [name for name in times.columns if name not in known]
    if not columns:
        return episodes
    added = pd.DataFrame({name: times.columns[name] for name in (*KEYS, *columns)})
    return episodes.merge(added, how="left", on=list(KEYS))
