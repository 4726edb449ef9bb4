"""Stamps: a small JSON file beside an output says what the output was made from.

With them a step of a long experiment is skipped when its output is there, and refused
when its output was made from something else, so that no folder mixes two experiments.
"""

import functools
import hashlib
import json
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from hlsd import __version__
from hlsd.core.errors import HlsdError
from hlsd.core.files import write_atomic
from hlsd.core.resources import resource

RESULT_CODE = (
    "assets",
    "core",
    "data",
    "learning",
    "navigation",
    "planners",
    "run",
    "sim",
)
"""What of hlsd decides logs, policies and rows, for `code_digest`.

The version alone would not do, since it stays the same between the commits of a
checkout. The whole package would be too much: a better help text, table or progress
bar would refuse to go on with a run that has lasted half an hour, and change nothing
in it. A comment in one of these files does refuse; that is the price of a digest that
anyone can understand.
"""


def claim(output: Path, inputs: Mapping[str, object]) -> None:
    """Leave a stamp for an output that is about to be made, or hold it to its stamp.

    Args:
        output: File or folder; its stamp is ``output.json`` beside it.
        inputs: All that decides the output; values that JSON can write.

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


def software(*packages: str) -> dict[str, str]:
    """Versions of packages, for the inputs of a stamp; "absent" where there is none."""
    return {name: _version(name) for name in packages}


@functools.cache
def code_digest(*parts: str) -> str:
    """Digest of hlsd's own code, for the inputs of a stamp.

    Args:
        parts: Files and folders of the package, ``assets`` included; of folders, all
            Python and XML files count.

    Returns:
        The first 16 digits of the SHA-256 over names and contents.
    """
    digest = hashlib.sha256()
    for part in sorted(parts):
        place = resource(part) if part == "assets" else Path(__file__).parents[1] / part
        files = [place]
        if place.is_dir():
            files = sorted([*place.rglob("*.py"), *place.rglob("*.xml")])
        for file in files:
            content = file.read_bytes()
            name = file.relative_to(place.parent).as_posix()
            digest.update(f"{name}:{len(content)}:".encode() + content)
    return digest.hexdigest()[:16]


def _check(output: Path, stamp: Path, inputs: Mapping[str, object]) -> None:
    try:
        held = json.loads(stamp.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        held = None
    if not isinstance(held, dict):
        raise HlsdError(
            f"{str(output)!r} is there, but not its stamp {stamp.name!r}: move it "
            "away, or choose another --out"
        )
    for key in {**inputs, **held}:
        if held.get(key) != inputs.get(key):
            raise HlsdError(
                f"{str(output)!r} was made from other inputs ({key} "
                f"{_short(held.get(key))}, now {_short(inputs.get(key))}): move it "
                "away, or choose another --out"
            )


def _short(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 40 else f"{text[:37]}..."


def _version(package: str) -> str:
    if package == "hlsd":
        return __version__
    try:
        return version(package)
    except PackageNotFoundError:
        return "absent"
