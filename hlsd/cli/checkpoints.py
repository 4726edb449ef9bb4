"""Checkpoints of others: ``hlsd convert-checkpoint``."""

from pathlib import Path
from typing import Annotated

import typer

from hlsd.cli.output import JsonOption, answer
from hlsd.core.errors import HlsdError


def convert_checkpoint(
    kind: Annotated[
        str,
        typer.Argument(
            help="Whose network: td3, sac, lics or drlvo; the planner's name."
        ),
    ],
    file: Annotated[
        str,
        typer.Argument(help="The published file, or its address, https://..."),
    ],
    out: Annotated[Path, typer.Option(help="File to write (npz).")],
    sha256: Annotated[
        str | None,
        typer.Option(help="What the file's digest must be; an address needs it."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Convert a published checkpoint into numbers that a planner drives from.

    Nothing in the file is run: a file that asks for more than tensors is refused. The
    result is a plain .npz for --planner 'lics(checkpoint=x.npz)'. Needs torch
    (docs/checkpoints.md).
    """
    from hlsd.core.errors import unknown_name
    from hlsd.learning.checkpoints.file import KINDS

    if kind not in KINDS:
        raise unknown_name("checkpoint", kind, KINDS)
    if out.exists():
        raise HlsdError(f"{out} exists already: choose another name, or remove it")
    from hlsd.learning.checkpoints.convert import convert

    checkpoint = convert(kind, file, sha256)
    checkpoint.save(out)
    count = sum(tensor.size for tensor in checkpoint.tensors.values())
    data = {"out": out, "kind": kind, "numbers": count, **checkpoint.said()}
    answer(
        as_json,
        data,
        f"{KINDS[kind]}, {count} numbers: {out}",
        f"drive it: --planner '{kind}(checkpoint={out})'",
    )
