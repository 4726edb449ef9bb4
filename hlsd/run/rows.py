"""Rows of a run, in little memory: a run may have a hundred thousand."""

import json
from collections.abc import Iterator, MutableMapping

from hlsd.run.row import Row
from hlsd.run.trajectory import Key


class Rows(MutableMapping[Key, Row]):
    """Rows by episode; each is a new dict when it is asked for.

    A row is kept as the text of its cells, a tenth of what a dict of them takes; names
    of columns are kept once.
    """

    def __init__(self) -> None:
        """There are none yet."""
        self._held: dict[Key, tuple[tuple[str, ...], bytes]] = {}
        self._columns: dict[tuple[str, ...], tuple[str, ...]] = {}

    def __getitem__(self, key: Key) -> Row:
        columns, cells = self._held[key]
        return dict(zip(columns, json.loads(cells), strict=True))

    def __setitem__(self, key: Key, row: Row) -> None:
        columns = tuple(row)
        cells = json.dumps(list(row.values()), separators=(",", ":"))
        held = self._columns.setdefault(columns, columns), cells.encode("ascii")
        self._held[key] = held

    def __delitem__(self, key: Key) -> None:
        del self._held[key]

    def __contains__(self, key: object) -> bool:
        return key in self._held

    def __iter__(self) -> Iterator[Key]:
        return iter(self._held)

    def __len__(self) -> int:
        return len(self._held)
