"""An experiment in steps: what is there is kept, what was made otherwise is refused.

Beside each output of a step lies its stamp, a small JSON file that says what it was
made from: the inputs, the versions of the software, and the digest of the code that
the step reaches. A step whose output is there with the same stamp is skipped; one
whose output was made from something else is refused, so that no folder ever mixes two
experiments.
"""

import json
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from hlsd.core.errors import HlsdError
from hlsd.core.files import write_atomic
from hlsd.core.progress import THERE, Steps, TellStage, TellWhole
from hlsd.core.reading import read_json
from hlsd.core.settings import change
from hlsd.core.source import code_digest
from hlsd.core.version import __version__

Inputs = Mapping[str, object]
"""What decides an output; values that JSON can write."""


@dataclass(frozen=True, slots=True)
class Step:
    """One step.

    Attributes:
        name: In progress messages.
        outputs: Files or folders, with what decides each of them. That is asked for
            when the steps before are done, since it may hold digests of their outputs.
        make: Makes those outputs that are missing, and tells how far it is.
        code: The function that decides the outputs; the digest of all code that it
            reaches is an input.
        packages: Software whose versions are inputs, beside hlsd.
        nominal_s: Usual duration for one output [s].
        at_once: Outputs that are made at the same time.
        last: Of an output that is a folder, the file that is written last; a folder
            without it goes on where it stopped.
        need: Called before the first step if an output of this one is missing; raises
            where something is not installed.
    """

    name: str
    outputs: Mapping[Path, Callable[[], Inputs]]
    make: Callable[[Sequence[Path], TellStage], None]
    code: Callable[..., object]
    packages: tuple[str, ...]
    nominal_s: float
    at_once: int = 1
    last: str = ""
    need: Callable[[], None] = lambda: None

    def missing(self) -> list[Path]:
        """Outputs that are not there, or not finished."""
        return [path for path in self.outputs if not (path / self.last).exists()]


def run_steps(steps: Sequence[Step], progress: TellWhole | None = None) -> None:
    """Make what is missing, step by step, and leave stamps.

    Args:
        steps: In order.
        progress: Told of every step, with a forecast of what is left.

    Raises:
        HlsdError: An output was made from something else, or a folder cannot be made;
            all is left as it is. Or a step failed.
    """
    nominal_s = {
        step.name: math.ceil(len(step.missing()) / step.at_once) * step.nominal_s
        for step in steps
    }
    for step in steps:
        if step.missing():
            step.need()  # now, not when the steps before are done
    for folder in dict.fromkeys(path.parent for step in steps for path in step.outputs):
        _make_folder(folder)
    numbered = Steps(nominal_s, progress)
    for step in steps:
        tell = numbered.step(step.name)
        made_by = _versions("hlsd", *step.packages)
        made_by["hlsd_code"] = code_digest(step.code)
        for path, inputs in step.outputs.items():
            claim(path, {**inputs(), **made_by})
        if missing := step.missing():
            step.make(missing, tell)
        else:
            tell(*THERE)


def claim(output: Path, inputs: Inputs) -> None:
    """Leave a stamp for an output that is about to be made, or hold it to its stamp.

    Args:
        output: File or folder; its stamp is ``output.json`` beside it.
        inputs: All that decides the output.

    Raises:
        HlsdError: The output is there and was made from other inputs, or it has no
            stamp. It is left as it is.
    """
    stamp = output.with_name(f"{output.name}.json")
    plain: dict[str, object] = json.loads(json.dumps(dict(inputs)))
    if output.exists():
        _check(output, stamp, plain)
    else:
        # Before the output, so that no crash leaves an output without a stamp.
        write_atomic(stamp, json.dumps(plain, indent=2) + "\n")


def _check(output: Path, stamp: Path, inputs: Inputs) -> None:
    try:
        held = read_json(stamp, "stamp")
    except HlsdError:
        held = None
    if held is None:
        raise HlsdError(
            f"{str(output)!r} is there, but not its stamp {stamp.name!r}: move it "
            "away, or choose another `out`",
            argument="out",
        )
    if differing := change(held, inputs):
        raise HlsdError(
            f"{str(output)!r} was made from other inputs ({differing}): move it away, "
            "or choose another `out`",
            argument="out",
        )


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise HlsdError(
            f"cannot write to output folder {str(folder)!r}: {error.strerror}"
        ) from error


def _versions(*packages: str) -> dict[str, str]:
    """Versions of packages; "absent" where there is none."""
    return {name: _version(name) for name in packages}


def _version(package: str) -> str:
    if package == "hlsd":
        return __version__
    try:
        return version(package)
    except PackageNotFoundError:
        return "absent"
