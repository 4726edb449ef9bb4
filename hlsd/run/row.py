"""The row of an episode: its columns, and how it is made of what was driven.

The built-in columns are declared in `hlsd.run.built_in_columns`, once each. The tables'
columns, the types that they are read with, the page docs/columns.md and, for measured
metrics, `hlsd.analysis.metrics` and docs/metrics.md follow from that.
"""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import TypeAlias

from hlsd.core.errors import HlsdError, blame
from hlsd.core.registry import Registry, own_name
from hlsd.run.built_in_columns import BUILT_IN
from hlsd.run.field import Driven, Field
from hlsd.run.trajectory import Key

METRICS_VERSION = "3"
"""Goes up when any metric is added, removed or redefined; stands in ``run.json``."""

Row: TypeAlias = dict[str, str]

FIELDS = MappingProxyType({field.name: field for field in BUILT_IN})
"""The built-in columns, in order."""
COLUMNS = tuple(name for name, field in FIELDS.items() if field.table == "episodes")
"""Those of ``episodes.csv``."""
TEXT_COLUMNS = tuple(name for name in COLUMNS if FIELDS[name].kind == "text")
NUMBER_COLUMNS = tuple(name for name in COLUMNS if FIELDS[name].kind != "text")
OPTIONAL_COLUMNS = tuple(name for name in COLUMNS if not FIELDS[name].required)
"""Tables without these are read as if they were empty."""
_TIMED = tuple(name for name, field in FIELDS.items() if field.table == "timing")
_KEYS = ("planner", "world", "trial", "wall_s", "planning_wall_s", "ticks")
TIMING_COLUMNS = tuple(dict.fromkeys((*_KEYS, *_TIMED)))
"""Those of ``timing.csv``: keys, wall times, and ticks to divide them by."""


def _check(name: str, thing: object) -> object:
    own = thing.name if isinstance(thing, Field) else name
    return own_name("metric", name, own, thing)


# Metrics are of two kinds: measured while driving, a `Field`, and computed from rows, a
# `hlsd.analysis.metrics.Metric`. Both are announced under one group.
plug_in_metrics = Registry[object]("metric", "hlsd.metrics", list, _check)
"""What other packages measure or compute."""


def fields() -> tuple[Field, ...]:
    """All columns: the built-in ones, then those that installed packages measure.

    Packages whose column cannot be had are left out; ``plug_in_metrics.faults()`` tells
    them.

    Raises:
        HlsdError: A package's column has the name of another.
    """
    found = list(BUILT_IN)
    for name, thing in plug_in_metrics.usable().items():
        if not isinstance(thing, Field):
            continue
        if name in FIELDS:
            raise HlsdError(
                f"metric {name!r} of {plug_in_metrics.entry(name).origin} has the name "
                "of a built-in column"
            )
        found.append(thing)
    return tuple(found)


def episode_columns(held: Sequence[Field]) -> tuple[str, ...]:
    """Columns of ``episodes.csv``, in order."""
    return tuple(field.name for field in held if field.table == "episodes")


def timing_columns(held: Sequence[Field]) -> tuple[str, ...]:
    """Columns of ``timing.csv``, in order."""
    others = (field.name for field in held if field.table == "timing")
    return tuple(dict.fromkeys((*TIMING_COLUMNS, *others)))


def row_of(driven: Driven, held: Sequence[Field]) -> Row:
    """The row of an episode: a cell for each field.

    Raises:
        ForeignError: A column that another package measures raised.
    """
    return {field.name: _cell(field, driven) for field in held}


def _cell(field: Field, driven: Driven) -> str:
    try:
        return field.text(driven)
    except Exception as error:
        if field.name in FIELDS:
            raise
        raise blame("metric", field.name, error) from error


def key_of(row: Mapping[str, str]) -> Key:
    """(planner, world, trial) of a row."""
    return row["planner"], int(row["world"]), int(row["trial"])
