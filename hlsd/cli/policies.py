"""``hlsd export-policy``: a policy as ONNX or ``.npz``, and its model card."""

from pathlib import Path
from typing import Annotated

import typer

from hlsd.core.errors import HlsdError


def export_policy(
    policy: Annotated[
        str,
        typer.Argument(
            metavar="POLICY",
            help="Planner whose policy ships (hlsd04, hlsd10, lfh04, lfh10), or a "
            "policy's file, .npz or .onnx.",
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            help="File to write: .onnx or .npz the policy, .md or .json its card."
        ),
    ] = None,
    card: Annotated[bool, typer.Option("--card", help="Print the model card.")] = False,
    run: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="RUN",
            help="Folder of a run that the policy drove: the card says how well; "
            "repeatable.",
        ),
    ] = None,
) -> None:
    """Write a policy as ONNX for use elsewhere, or print its model card.

    The ONNX graph takes the scan and the local goal in metres, and is run beside
    hlsd's forward pass before it is written. It comes back by `hlsd bench --policy
    x.onnx`, or as .npz.
    """
    import hlsd
    from hlsd.learning.onnx_policy import BOUND

    if out is None and not card:
        raise HlsdError("nothing to do: give --out FILE, --card or both")
    done = hlsd.export_policy(policy, out, run or ())
    if card:
        typer.echo(done.markdown, nl=False)
    if done.difference is not None:
        speed, yaw_rate, scans = done.difference
        typer.echo(
            f"differs from hlsd's forward pass by at most {speed:.1e} m/s and "
            f"{yaw_rate:.1e} rad/s on {scans} scans (bound {BOUND:g})",
            err=card,
        )
    if out is not None:
        typer.echo(f"{out}", err=card)
