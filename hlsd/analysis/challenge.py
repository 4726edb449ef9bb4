"""Runs as the BARN Challenge writes them: our runs -> ``out.txt``, and back.

Source: Daffan/nav-competition-icra2022, ``run.py``: lines ``world success collided
timeout time metric``, times and metrics to four digits.
"""

import hashlib
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum
from pathlib import Path

import numpy as np

from hlsd.analysis.run_reference import RunReference
from hlsd.analysis.run_trials import planner_rows
from hlsd.analysis.runs import protocol_of
from hlsd.analysis.trial_files import OUT_COLUMNS, OutRun, line_error, parse_out_txt
from hlsd.core.errors import HlsdError, require_name
from hlsd.core.reading import read_bytes
from hlsd.core.types import FloatArray
from hlsd.data.worlds import Suite, load_suite
from hlsd.run.conditions import Conditions
from hlsd.run.folder import write_imported
from hlsd.run.outcome import Outcome
from hlsd.run.protocol import Protocol, get_protocol, protocols
from hlsd.run.score import Score, optimal_times_s

# Half a digit of the score, and the half digit of the time, which weighs less.
SCORE_TOLERANCE = 1e-4
# Columns of AT/OT are off the recorded time by up to 0.05 % (res/dwa_out.txt of 2022),
# as if the evaluator had taken the wall clock's; none comes near a score.
RATIO_TOLERANCE = 0.01
_DYNABARN = range(300, 360)


class LastColumn(Enum):
    """What the last column of an ``out.txt`` is.

    Members:
        SCORE: The official score of the protocol.
        TIME_RATIO: Actual by optimal time, 0 for failures, as until April 2022.
        EITHER: Nobody can tell, since no run succeeded.
    """

    SCORE = "score"
    TIME_RATIO = "AT/OT"
    EITHER = "either"

    def described(self, protocol: str) -> str:
        """What it is, in words.

        Args:
            protocol: Name of the one that the runs were driven under.
        """
        return {
            LastColumn.SCORE: f"the score of {protocol}",
            LastColumn.TIME_RATIO: "AT/OT, as until April 2022",
            LastColumn.EITHER: "the score or AT/OT: no run succeeded",
        }[self]


@dataclass(frozen=True, slots=True)
class Metric:
    """Which column of an ``out.txt`` is its metric, and what that is.

    Attributes:
        meaning: What it is.
        place: Its number among the columns, from 1; by the Challenge's evaluator the
            last one, 6.
        columns: How many there are.
    """

    meaning: LastColumn
    place: int
    columns: int

    @property
    def column(self) -> str:
        """Which column it is, in words."""
        alone = self.columns == len(OUT_COLUMNS)
        return "last column" if alone else f"column {self.place}"

    def described(self, protocol: str) -> str:
        """What it is, in words.

        Args:
            protocol: Name of the one that the runs were driven under.
        """
        said = self.meaning.described(protocol)
        extra = self.columns > len(OUT_COLUMNS)
        return f"{said}; no other column behind the time is read" if extra else said


@dataclass(frozen=True, slots=True)
class OutTxt:
    """The text of an ``out.txt``.

    Attributes:
        text: Its lines.
        planner: Whose runs they are.
        runs: Their number.
        errors: Number of runs that the planner's own error ended; the text has them as
            timeouts, since the Challenge would have waited for the limit.
    """

    text: str
    planner: str
    runs: int
    errors: int


def export_run(run: Path | str, planner: str | None = None) -> OutTxt:
    """A run's episodes as the Challenge would have written them.

    Args:
        run: Folder of a finished run under one of the Challenge's protocols, or
            ``FOLDER:PLANNER``.
        planner: Which; may be left out where there is only one.

    Returns:
        Lines by world and trial; the metric is the official score of the protocol.

    Raises:
        HlsdError: There is no such run or planner, or the protocol has no score.
    """
    reference = RunReference.read(run, planner)
    name, runs = planner_rows(reference.path, reference.planner)
    protocol = protocol_of(runs)
    score = _score(protocol)
    runs = runs.sort_values(["world", "trial"])
    outcomes = runs["outcome"].to_numpy()
    success = np.asarray(outcomes == Outcome.SUCCESS.value)
    collided = np.asarray(outcomes == Outcome.COLLISION.value)
    times_s = runs["time_s"].to_numpy(np.float64)
    lengths_m = runs["official_length_m"].to_numpy(np.float64)
    if np.isnan(lengths_m).any():
        raise HlsdError(
            f"the run in {str(reference.path)!r} lacks official path lengths"
        )
    scores = score.of_runs(success, times_s, lengths_m)
    flags = np.column_stack([success, collided, ~(success | collided)]).astype(int)
    lines = [
        f"{world} {' '.join(map(str, flag))} {time:.4f} {score:.4f}\n"
        for world, flag, time, score in zip(
            runs["world"], flags.tolist(), times_s, scores, strict=True
        )
    ]
    errors = int((outcomes == Outcome.ERROR.value).sum())
    return OutTxt("".join(lines), name, len(lines), errors)


def import_runs(
    path: Path, planner: str, protocol: str, suite: str, out: Path
) -> Metric:
    """Make the folder of a run from an ``out.txt``.

    Trials are numbered in the order of the lines. What the file does not say (robot,
    seed, contacts, ...) is left empty, never 0. Times stay as recorded, which for a
    timeout is somewhat more than the limit.

    Args:
        path: The ``out.txt``.
        planner: How to name what drove.
        protocol: Name of the Challenge's protocol it was driven under.
        suite: Name or folder of the suite whose worlds it was driven in.
        out: Folder to make.

    Returns:
        What the file's metric is.

    Raises:
        HlsdError: The file is no ``out.txt`` or does not fit suite and protocol (the
            message has the line), or the folder is not empty.
    """
    rules = get_protocol(protocol)
    _score(rules)
    if not planner.strip():
        raise HlsdError("the planner's name is empty: give the runs a name")
    require_name("planner", planner)
    worlds = load_suite(suite)
    data = read_bytes(path, "out.txt")
    runs = parse_out_txt(data, path)
    lengths = _official_lengths(path, runs, rules, worlds)
    metric = _metric(path, runs, rules, lengths)
    trials: Counter[int] = Counter()
    rows = []
    for run in runs:
        length_m = rules.official_length_m(worlds[run.world])
        rows.append(
            {
                "suite": worlds.name,
                "suite_version": worlds.version,
                "world": str(run.world),
                "planner": planner,
                "trial": str(trials[run.world]),
                "protocol": rules.name,
                "outcome": _outcome(path, run, rules).value,
                "time_s": f"{run.time_s:.4f}",
                "official_length_m": f"{length_m:.6f}",
            }
        )
        trials[run.world] += 1
    rows.sort(key=lambda row: (int(row["world"]), int(row["trial"])))
    source = {
        "file": path.name,
        "sha256": hashlib.sha256(data).hexdigest(),
        "metric": metric.meaning.value,
        "column": str(metric.place),
        "planner": planner,
    }
    conditions = Conditions(
        suite=worlds.name,
        suite_version=worlds.version,
        suite_digest=worlds.digest,
        protocol=rules,
        robot="",
        robot_version="",
        seed=None,
    )
    write_imported(out, rows, source, conditions)
    return metric


def _score(protocol: Protocol) -> Score:
    """The protocol's official score."""
    if protocol.score is None:
        known = protocols.usable().values()
        scored = [p.name for p in known if p.score is not None]
        raise HlsdError(
            f"protocol {protocol.name!r} is none of the Challenge's, whose runs an "
            f"out.txt holds: want {' or '.join(scored)}"
        )
    return protocol.score


def _official_lengths(
    path: Path, runs: Sequence[OutRun], protocol: Protocol, suite: Suite
) -> FloatArray:
    """Official path length of each run's world [m], ``(n,)``."""
    held = frozenset(suite.indices)
    lengths: dict[int, float] = {}
    for run in runs:
        if run.world not in held:
            wanted = f"one of suite {suite.name!r}"
            if run.world in _DYNABARN:
                wanted += (
                    ", which has no moving obstacles: worlds 300 to 359 of the "
                    "Challenge are DynaBARN's; leave their lines out"
                )
            raise line_error(path, run.line, f"world {run.world}", wanted)
        if run.world not in lengths:
            lengths[run.world] = protocol.official_length_m(suite[run.world])
    return np.array([lengths[run.world] for run in runs])


def _metric(
    path: Path, runs: Sequence[OutRun], protocol: Protocol, lengths_m: FloatArray
) -> Metric:
    """Tell what the columns behind the time are, by computing all that they may be."""
    success = np.array([run.success for run in runs])
    times_s = np.array([run.time_s for run in runs])
    metrics = np.array([run.metrics for run in runs])
    ratios = np.asarray(success * times_s / optimal_times_s(lengths_m))
    scores = _score(protocol).of_runs(success, times_s, lengths_m)
    found = []
    bad = 0  # the line at which the last explanation failed
    for number, values in enumerate(metrics.T):
        fits = {
            LastColumn.SCORE: np.abs(values - scores) < SCORE_TOLERANCE,
            LastColumn.TIME_RATIO: np.abs(values - ratios) <= RATIO_TOLERANCE * ratios,
        }
        possible = [column for column, fit in fits.items() if fit.all()]
        if possible:
            meaning = LastColumn.EITHER if len(possible) > 1 else possible[0]
            found.append(Metric(meaning, len(OUT_COLUMNS) + number, runs[0].columns))
        else:
            bad = max(bad, *(int(np.argmin(fit)) for fit in fits.values()))
    if found:
        ranked = list(LastColumn)
        return min(found, key=lambda metric: ranked.index(metric.meaning))
    values = " or ".join(f"{value:g}" for value in runs[bad].metrics)
    raise line_error(
        path,
        runs[bad].line,
        f"metric {values}",
        f"{scores[bad]:.4f}, the score of {protocol.name}, or about {ratios[bad]:.4f}"
        ", AT/OT as until April 2022, and the same of the two in all lines",
    )


def _outcome(path: Path, run: OutRun, protocol: Protocol) -> Outcome:
    if run.success:
        if run.time_s > protocol.limit_s:
            raise line_error(
                path,
                run.line,
                f"success after {run.time_s:g} s",
                f"at most {protocol.limit_s:g} s, the limit of {protocol.name}",
            )
        return Outcome.SUCCESS
    if run.collided:
        return Outcome.COLLISION
    if run.timeout:
        return Outcome.TIMEOUT
    raise line_error(
        path, run.line, "success 0, collided 0, timeout 0", "one of the three to be 1"
    )
