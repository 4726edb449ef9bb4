"""Rows as the bytes of a CSV file."""

from collections.abc import Iterable, Mapping, Sequence


def to_csv(rows: Iterable[Mapping[str, str]], columns: Sequence[str]) -> bytes:
    """A table in UTF-8; half characters (surrogates) stand as escapes.

    Args:
        rows: Cells by column.
        columns: Those of the table, in order.
    """
    lines = [",".join(columns)]
    for row in rows:
        lines.append(",".join(_quoted(row[column]) for column in columns))
    return ("\n".join(lines) + "\n").encode("utf-8", "backslashreplace")


def _quoted(text: str) -> str:
    return f'"{text.replace(chr(34), chr(34) * 2)}"' if {*',"\r\n'} & {*text} else text
