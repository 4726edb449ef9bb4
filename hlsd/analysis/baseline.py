"""The file that the gate holds a run against: written, read and checked."""

import hashlib
import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hlsd.analysis.metrics import get_metric
from hlsd.analysis.sides import Side
from hlsd.core.errors import HlsdError
from hlsd.core.reading import read_json
from hlsd.core.text import one_line
from hlsd.run.conditions import Conditions, first_protocol

FORMAT = "hlsd baseline 3"
"""The second format had no digests, the first named the conditions without rules."""


def baseline_text(side: Side) -> str:
    """A baseline as JSON, a line per run.

    Args:
        side: With the metrics that it is to hold.
    """
    order = np.lexsort((side.trials, side.worlds))
    runs = [
        [
            int(side.worlds[n]),
            int(side.trials[n]),
            *(_plain(values[n]) for values in side.values.values()),
        ]
        for n in order
    ]
    head = {
        "format": FORMAT,
        "planner": side.planner,
        "digests": dict(side.digests),
        "conditions": side.conditions.as_json(),
        "metrics": {name: get_metric(name).version for name in side.values},
    }
    head["sha256"] = _sha256({**head, "runs": runs})
    lines = [f'  "{name}": {json.dumps(value)},' for name, value in head.items()]
    joined = ",\n    ".join(map(json.dumps, runs))
    return "\n".join(["{", *lines, '  "runs": [', f"    {joined}", "  ]", "}"]) + "\n"


def load_baseline(path: Path) -> Side:
    """A baseline as `baseline_text` wrote it, or as earlier versions of hlsd did.

    Raises:
        HlsdError: It is none, is damaged, or is one of other versions of the metrics.
    """
    held = read_json(path, "baseline", remedy="`hlsd baseline` makes one")
    try:
        read = _Baseline(held)
        runs = read.runs()
        side = Side(
            name=f"baseline {read.planner} ({path})",
            planner=read.planner,
            conditions=read.conditions(),
            worlds=np.array([run[0] for run in runs], np.int64),
            trials=np.array([run[1] for run in runs], np.int64),
            values={
                name: np.array([run[2 + n] for run in runs], np.float64)
                for n, name in enumerate(read.metrics)  # null becomes NaN
            },
            digests=read.digests(),
        )
        read.check_whole()
    except HlsdError as error:
        raise HlsdError(
            f"{str(path)!r} is not a baseline of `hlsd baseline`: {error}"
        ) from error
    for name, version in read.metrics.items():
        if get_metric(name).version != version:
            raise HlsdError(
                f"{str(path)!r} holds version {version} of {name}, now it is "
                f"{get_metric(name).version}: make the baseline again"
            )
    return side


class _Baseline:
    """What a baseline's JSON says, checked part by part."""

    def __init__(self, held: Mapping[str, Any]) -> None:
        self._held = held
        if held.get("format") not in (FORMAT, _SECOND, _FIRST):
            raise HlsdError(f"its format is {self._shown('format')}, not {FORMAT!r}")
        self.planner = self._get("planner", str, "a name")
        self.metrics: dict[str, object] = self._get(
            "metrics", dict, "versions by metric's name"
        )
        for name, version in self.metrics.items():
            if type(version) is not int:
                raise HlsdError(f"version {version!r} of {name}: want a whole number")

    def runs(self) -> list[list[float | None]]:
        found: list[list[float | None]] = self._get("runs", list, "a list of runs")
        seen: set[tuple[object, ...]] = set()
        for n, run in enumerate(found):
            if not isinstance(run, list) or len(run) != 2 + len(self.metrics):
                raise HlsdError(
                    f"run {n} is {one_line(run, 60)}: want world, trial and a value "
                    "per metric"
                )
            if not all(type(k) is int and 0 <= k < 2**53 for k in run[:2]):
                raise HlsdError(
                    f"run {n} is {one_line(run, 60)}: want world and trial as whole "
                    "numbers from 0"
                )
            for name, value in zip(self.metrics, run[2:], strict=True):
                if value is not None and type(value) not in (int, float):
                    raise HlsdError(
                        f"run {n}: {name} {one_line(repr(value), 60)}: want a number "
                        "or null"
                    )
            if tuple(run[:2]) in seen:
                raise HlsdError(f"world {run[0]}, trial {run[1]} again: want each once")
            seen.add(tuple(run[:2]))
        if not found or not self.metrics:
            raise HlsdError("it holds no values: want a run and a metric at least")
        return found

    def digests(self) -> dict[str, str]:
        if self._held["format"] != FORMAT:
            return {}
        found = self._get("digests", dict, "digests by what they are of")
        return {str(name): str(digest) for name, digest in found.items()}

    def conditions(self) -> Conditions:
        if self._held["format"] != _FIRST:
            return Conditions.from_json(self._get("conditions", dict, "conditions"))
        name = self._get("protocol", str, "a protocol's name")
        protocol = first_protocol(name)
        if protocol is None:
            raise HlsdError(f"protocol {one_line(repr(name), 60)}: want one of 0.1.0")
        seed = self._held.get("seed")
        if seed is not None and type(seed) is not int:
            raise HlsdError(f"seed {self._shown('seed')}: want a whole number or null")
        return Conditions(
            suite=self._get("suite", str, "a text"),
            suite_version=self._get("suite_version", str, "a text"),
            suite_digest=self._get("suite_digest", str, "a text"),
            protocol=protocol,
            robot=self._get("robot", str, "a text"),
            robot_version=self._get("robot_version", str, "a text"),
            seed=seed,
        )

    def check_whole(self) -> None:
        """Refuse what is not as it was written; earlier formats cannot tell."""
        if self._held["format"] != FORMAT:
            return
        plain = {name: value for name, value in self._held.items() if name != "sha256"}
        if self._get("sha256", str, "a digest") != _sha256(plain):
            raise HlsdError(
                "it was changed since it was written, as its sha256 says: make it again"
            )

    def _get(self, name: str, kind: type[Any], wanted: str) -> Any:
        value = self._held.get(name)
        if not isinstance(value, kind):
            raise HlsdError(f"{name!r} is {self._shown(name)}: want {wanted}")
        return value

    def _shown(self, name: str) -> str:
        return one_line(repr(self._held.get(name)), 60)


_FIRST = "hlsd baseline 1"
_SECOND = "hlsd baseline 2"


def _sha256(plain: Mapping[str, object]) -> str:
    """Of a baseline's content, however its lines are laid out."""
    text = json.dumps(plain, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()


def _plain(value: float) -> float | int | None:
    """As short as JSON has it: whole numbers without a point, null for NaN."""
    number = float(value)
    if np.isnan(number):
        return None
    if np.isinf(number):
        raise HlsdError(f"a metric of the run is {number}: a baseline cannot hold it")
    return int(number) if number.is_integer() else number
