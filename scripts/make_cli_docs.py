"""Write docs/cli.md from the help of the commands themselves.

Run it after any change to a command: python scripts/make_cli_docs.py
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, cast

import typer

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "cli.md"
REMAKE = "python scripts/make_cli_docs.py"

_HEAD = f"""\
# Commands

<!-- Generated; change the commands' own help, then run: {REMAKE} -->

`hlsd COMMAND --help` says the same on the terminal. In a checkout, `python cli.py` does
what `hlsd` does. Bad input is one line on stderr and exit code 2.
"""


@dataclass(frozen=True, slots=True)
class Parameter:
    """An argument or option of a command.

    Attributes:
        name: As it is typed; an argument's in capitals.
        is_option: Whether it is given by name.
        default: As text; empty where leaving it out means what the help says.
        required: Whether the command refuses to run without it.
        help: What it is for; empty where nobody said.
    """

    name: str
    is_option: bool
    default: str
    required: bool
    help: str


@dataclass(frozen=True, slots=True)
class CommandHelp:
    """A command or a group of commands.

    Attributes:
        name: All words that are typed, e.g. ``hlsd worlds show``.
        is_group: Whether it only holds other commands.
        help: Paragraphs, parted by an empty line.
        parameters: Arguments and options, in order.
    """

    name: str
    is_group: bool
    help: str
    parameters: tuple[Parameter, ...]


def commands() -> list[CommandHelp]:
    """Every command of the installed command line, groups before their commands."""
    from hlsd.cli.app import app

    return list(_walk("hlsd", cast(_Command, typer.main.get_command(app))))


def render() -> str:
    """The page, as it should stand in `PAGE`."""
    listed = commands()
    parts = [_HEAD, _contents(listed), *map(_section, listed)]
    return "\n".join(parts).rstrip("\n") + "\n"


def main() -> None:
    """Write the page."""
    PAGE.write_text(render(), encoding="utf-8")
    print(PAGE.relative_to(ROOT))


class _Parameter(Protocol):
    """What all versions of click, and the copies of it in Typer, share."""

    opts: list[str]
    secondary_opts: list[str]
    param_type_name: str
    metavar: str | None
    default: object
    required: bool
    help: str | None
    hidden: bool


class _Command(Protocol):
    help: str | None
    params: Sequence[_Parameter]


def _walk(name: str, command: _Command) -> Iterator[CommandHelp]:
    children: dict[str, _Command] = getattr(command, "commands", {})
    yield CommandHelp(
        name=name,
        is_group=bool(children),
        help=_unwrap(command.help or ""),
        parameters=tuple(
            _parameter(item) for item in command.params if not item.hidden
        ),
    )
    # Groups last, so that each heading is followed by its own commands.
    for word, child in sorted(
        children.items(), key=lambda item: hasattr(item[1], "commands")
    ):
        yield from _walk(f"{name} {word}", child)


def _parameter(item: _Parameter) -> Parameter:
    is_option = item.param_type_name == "option"
    typed = ", ".join([*item.opts, *item.secondary_opts])
    return Parameter(
        name=typed if is_option else (item.metavar or typed).upper(),
        is_option=is_option,
        default=_default(item.default),
        required=item.required,
        help=" ".join((item.help or "").split()),
    )


def _default(value: object) -> str:
    if value is None:
        return ""
    if isinstance(value, bool):
        return "on" if value else "off"
    return str(value)


def _unwrap(text: str) -> str:
    """Paragraphs on one line each."""
    paragraphs = text.strip().split("\n\n")
    return "\n\n".join(" ".join(paragraph.split()) for paragraph in paragraphs)


def _contents(listed: list[CommandHelp]) -> str:
    rows = [
        f"- [`{command.name}`](#{command.name.replace(' ', '-')}): "
        f"{command.help.splitlines()[0] if command.help else ''}"
        for command in listed
        if not command.is_group
    ]
    return "\n".join(rows) + "\n"


def _section(command: CommandHelp) -> str:
    level = "##" if command.is_group else "###"
    lines = [f"{level} {command.name}", "", command.help, ""]
    if not command.is_group:
        lines += ["```", _usage(command), "```", ""]
    if command.parameters:
        lines += ["| | default | meaning |", "|---|---|---|"]
        lines += [*map(_row, command.parameters), ""]
    return "\n".join(lines)


def _usage(command: CommandHelp) -> str:
    """What must be typed, then that more may be."""
    required = [
        f"{item.name} {_value(item.name)}" if item.is_option else item.name
        for item in command.parameters
        if item.required
    ]
    optional = any(item.is_option and not item.required for item in command.parameters)
    return " ".join([command.name, *required, *(["[OPTIONS]"] if optional else [])])


def _value(name: str) -> str:
    return name.split(",")[0].lstrip("-").replace("-", "_").upper()


def _row(item: Parameter) -> str:
    default = "required" if item.required else _code(item.default)
    meaning = item.help.replace("|", "\\|")
    return f"| `{item.name}` | {default} | {meaning} |"


def _code(text: str) -> str:
    return f"`{text}`" if text else ""


if __name__ == "__main__":
    main()
