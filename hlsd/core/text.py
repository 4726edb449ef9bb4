"""Text from outside, made fit for one line of a table, a message or a terminal."""

MOST = 300
"""Characters that a row keeps of what somebody else's code says."""

# What a terminal of another encoding gets for the signs that hlsd prints.
_SPELLED = str.maketrans(
    {
        "…": "...",
        "±": "+-",
        "−": "-",
        "–": "-",
        "°": " deg",
        "²": "^2",
        "³": "^3",
        "µ": "u",
        "×": "x",
    }
)


def one_line(thing: object, most: int = MOST) -> str:
    """A text on one line, without what a terminal or a table would act on.

    Line breaks and tabs become spaces; control characters, half characters (surrogates)
    and marks of direction stand as escapes, so that nothing is hidden. What is longer
    than ``most`` ends in "...".

    Args:
        thing: A text, or whatever has one; one whose ``str`` raises is told by its
            type.
        most: Characters of the result, at most.
    """
    try:
        text = str(thing)
    except Exception as error:
        text = f"({type(thing).__name__}, whose text raises {type(error).__name__})"
    # Far more than is kept is not looked at: others' texts may have any length.
    shown = "".join(
        held if held.isprintable() or held == " " else _escaped(held)
        for held in text[: 4 * most]
    )
    shown = " ".join(shown.split())
    if len(shown) <= most and len(text) <= 4 * most:
        return shown
    return shown[: most - 3].rstrip() + "..."


def error_text(error: BaseException) -> str:
    """What somebody else's error says, on one line: its type and its text."""
    name, said = type(error).__name__, one_line(error)
    return f"{name}: {said}" if said else name


def spelled(text: str) -> str:
    """A text in ASCII: signs that hlsd prints in words, any other as an escape."""
    plain = text.translate(_SPELLED)
    return plain.encode("ascii", "backslashreplace").decode("ascii")


def unfit_name(name: object) -> str:
    """Why a thing cannot be called so; "" where it can.

    Names stand in tables, in file names and on terminals, and are typed. So they are
    one printable line of at most `LONGEST_NAME` characters, without a separator of
    paths, and do not begin as what a spreadsheet calculates.

    Args:
        name: Of a planner, suite, robot, protocol, metric or perturbation.
    """
    if not isinstance(name, str):
        return f"a name is a text, not {type(name).__name__}"
    if not name.strip():
        return "a name has a character at least"
    if len(name) > LONGEST_NAME:
        return f"a name has at most {LONGEST_NAME} characters, not {len(name)}"
    if not name.isprintable():
        return "a name has no line breaks, control characters or half characters"
    if name != name.strip():
        return "a name neither begins nor ends with a space"
    if "/" in name or "\\" in name or name in (".", ".."):
        return "a name is not a path: leave out '/' and '\\'"
    if name[0] in CALCULATED:
        return f"a name does not begin with {name[0]!r}, which spreadsheets calculate"
    return ""


LONGEST_NAME = 200
"""Characters of a name."""
CALCULATED = "=+-@"
"""A spreadsheet calculates a cell that begins with one of these."""


def _escaped(character: str) -> str:
    if character.isspace():
        return " "
    return character.encode("unicode_escape").decode("ascii")
