"""What a run's folder says of its run: ``run.json``, read and checked.

Format 3 and 2 hold conditions; the first, of 0.1.0, has no format and holds names in
their place. The folder of a run that was not driven here says what it has: conditions
as far as they are known, and the number of its rows.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from hlsd.core.errors import HlsdError
from hlsd.core.reading import parse_json, read_bytes, shown, text_of
from hlsd.core.text import one_line
from hlsd.run.conditions import Conditions, first_protocol
from hlsd.run.protocol import COURSE
from hlsd.run.seal import Seal
from hlsd.run.shard import Shard, Share, parse_shard
from hlsd.run.stopping import Stopped, stopped_of

_KIND = "record of a run"
_DIGEST = "_sha256"


@dataclass(frozen=True, slots=True)
class Record:
    """What a run recorded of itself.

    Attributes:
        conditions: What it was driven under; None where it is unknown.
        driven: Whether it was driven here, not imported.
        planners: Names, in order; () of an imported run, as the next.
        worlds: Indices, in order; of a shard, those of its whole run; of a run that
            stopped before its end, those until then.
        trials: Runs per world and planner; 0 of an imported run.
        rows: Number of rows of an imported run; None where it does not say.
        digests: Of what decides how a planner drives (policy, code), by planner and by
            what they are of, e.g. ``"policy"``. Unknown ones are left out.
        shard: Which part of its run this is; None is the whole.
        stopped: Where it stopped, of a run until decided that is finished; else None.
    """

    conditions: Conditions | None
    driven: bool
    planners: tuple[str, ...] = ()
    worlds: tuple[int, ...] = ()
    trials: int = 0
    rows: int | None = None
    digests: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    shard: Shard | None = None
    stopped: Stopped | None = None

    @property
    def share(self) -> Share:
        """The episodes of a run that was driven here; of another there are none."""
        held = self.conditions
        alone = held is not None and held.protocol.layout == COURSE.layout
        return Share(self.planners, self.worlds, self.trials, alone, self.shard)


def read_record(file: Path, seal: Seal) -> Record | None:
    """What a ``run.json`` says; None where there is no such file.

    Args:
        file: The ``run.json``.
        seal: Of its folder.

    Raises:
        HlsdError: It is damaged, or was changed since it was written.
    """
    if not file.exists():
        seal.check_there(file)
        return None
    data = read_bytes(file, _KIND)
    seal.check(file, data)
    text = text_of(data, file, _KIND)
    try:
        plain = parse_json(text, _KIND)
        if not isinstance(plain, dict):
            raise HlsdError("it is not a JSON object")
        if "config" in plain:
            return _driven(_mapping(plain, "config"), plain)
        if "imported" in plain:
            return _imported(plain)
        raise HlsdError("it has neither 'config' nor 'imported'")
    except HlsdError as error:
        raise HlsdError(
            f"{shown(file)} is damaged: {error}: restore it, or put the rows into a "
            "folder of their own, without it"
        ) from error


def _driven(config: Mapping[str, object], manifest: Mapping[str, object]) -> Record:
    planners = tuple(_texts(config, "planners"))
    if not planners or len(set(planners)) < len(planners):
        raise HlsdError(f"planners {one_line(planners)}: want each named once")
    worlds = tuple(_whole(n, "worlds", 0) for n in _list(config, "worlds"))
    if not worlds or len(set(worlds)) < len(worlds):
        raise HlsdError(f"worlds {one_line(worlds, 60)}: want each once")
    stopped = stopped_of(config, manifest)
    record = Record(
        conditions=(
            Conditions.from_json(_mapping(config, "conditions"))
            if "conditions" in config
            else _first_conditions(config)
        ),
        driven=True,
        planners=planners,
        worlds=worlds if stopped is None else stopped.worlds,
        trials=_whole(config.get("trials"), "trials", 1),
        rows=None,
        digests=_digests(config, planners),
        shard=parse_shard(config["shard"]) if "shard" in config else None,
        stopped=stopped,
    )
    record.share.require_shard_fits()
    return record


def _imported(plain: Mapping[str, object]) -> Record:
    rows = plain.get("rows")
    held = plain.get("conditions")
    return Record(
        conditions=(
            None
            if held is None
            else Conditions.from_json(_mapping(plain, "conditions"))
        ),
        driven=False,
        rows=None if rows is None else _whole(rows, "rows", 0),
    )


def _first_conditions(config: Mapping[str, object]) -> Conditions | None:
    """Of a run of 0.1.0, which recorded names: the rules are those that it knew.

    None where it knew no such protocol.
    """
    name, *texts = (
        _text(config, key)
        for key in (
            "protocol",
            "suite",
            "suite_version",
            "suite_digest",
            "robot",
            "robot_version",
        )
    )
    seed = _whole(config.get("seed"), "seed", 0)
    protocol = first_protocol(name)
    if protocol is None:
        return None
    suite, suite_version, suite_digest, robot, robot_version = texts
    return Conditions(
        suite=suite,
        suite_version=suite_version,
        suite_digest=suite_digest,
        protocol=protocol,
        robot=robot,
        robot_version=robot_version,
        seed=seed,
    )


def _digests(
    config: Mapping[str, object], planners: Sequence[str]
) -> dict[str, dict[str, str]]:
    """Lists called ``..._sha256`` hold a digest of each planner, "" where none is."""
    found: dict[str, dict[str, str]] = {name: {} for name in planners}
    for key, value in config.items():
        if not (key.endswith(_DIGEST) and isinstance(value, list) and value):
            continue
        digests = _texts(config, key)
        if len(digests) != len(planners):
            raise HlsdError(f"{key} has {len(digests)} items: want one of each planner")
        for name, digest in zip(planners, digests, strict=True):
            if digest:
                found[name][key.removesuffix(_DIGEST)] = digest
    return found


def _mapping(plain: Mapping[str, object], key: str) -> dict[str, object]:
    value = plain[key]
    if not isinstance(value, dict):
        raise HlsdError(f"{key} {_shown(value)}: want an object")
    return value


def _list(plain: Mapping[str, object], key: str) -> list[object]:
    value = plain.get(key)
    if not isinstance(value, list):
        raise HlsdError(f"{key} {_shown(value)}: want a list")
    return value


def _texts(plain: Mapping[str, object], key: str) -> list[str]:
    values = _list(plain, key)
    if not all(isinstance(value, str) for value in values):
        raise HlsdError(f"{key} {_shown(values)}: want texts")
    return [str(value) for value in values]


def _text(plain: Mapping[str, object], key: str) -> str:
    value = plain.get(key)
    if not isinstance(value, str):
        raise HlsdError(f"{key} {_shown(value)}: want a text")
    return value


def _whole(value: object, key: str, least: int) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or value < least:
        raise HlsdError(f"{key} {_shown(value)}: want a whole number from {least}")
    return value


def _shown(value: object) -> str:
    return one_line(repr(value), 60)
