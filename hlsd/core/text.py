"""Text from outside, made fit for one line of a table, a message or a terminal."""

MOST = 300
"""Characters that a row keeps of what somebody else's code says."""


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


def _escaped(character: str) -> str:
    if character.isspace():
        return " "
    return character.encode("unicode_escape").decode("ascii")
