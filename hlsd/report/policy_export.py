"""A policy written elsewhere: as ONNX, as ``.npz``, and its model card."""

import hashlib
import json
import math
import shlex
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from hlsd.analysis.runs import folder_of, load_episodes, planner_digests
from hlsd.analysis.summary import summarise
from hlsd.core.errors import HlsdError
from hlsd.core.files import write_new
from hlsd.core.reading import shown
from hlsd.learning.card import Card, card_of, markdown, measured_by_us
from hlsd.learning.policy import Policy, is_onnx, shipped_policy
from hlsd.report.summary import setting

FORMATS = (".onnx", ".npz", ".md", ".json")
"""What `export_policy` writes, by the end of the name: a policy, or its card."""
_KEPT = (
    "success",
    "mean_time_s",
    "sd_time_s",
    "mean_time_low_s",
    "mean_time_high_s",
    "contact_free",
)


@dataclass(frozen=True, slots=True)
class Exported:
    """What was exported.

    Attributes:
        card: The model card, for programs.
        markdown: The same for people.
        difference: The most that the ONNX file differs from hlsd's forward pass in
            speed [m/s] and yaw rate [rad/s], and on how many scans; None of another.
    """

    card: Card
    markdown: str
    difference: tuple[float, float, int] | None = None


def export_policy(
    policy: Path | str, out: Path | str | None = None, runs: Sequence[Path | str] = ()
) -> Exported:
    """Write a policy or its model card.

    Args:
        policy: Name of a planner whose policy ships, or a policy's file.
        out: File to write, see `FORMATS`; None writes none.
        runs: Folders of runs that the policy drove: the card says how well.

    Raises:
        HlsdError: There is no such policy, another kind of file is asked for, it
            exists, a run is of another policy, a package of the extra ``onnx`` is
            missing, or the ONNX file would differ from hlsd's forward pass.
    """
    target = None if out is None else Path(out)
    if target is not None and target.suffix.lower() not in FORMATS:
        raise HlsdError(
            f"cannot export a policy to {shown(target)}: its name must end in "
            f"{', '.join(FORMATS[:-1])} or {FORMATS[-1]}"
        )
    if target is not None and target.exists():
        raise HlsdError(f"{shown(target)} exists already: choose another name")
    path = _file(policy)
    held = Policy.load(path)
    # An .npz keeps its bytes; those of an ONNX file are made anew.
    data = held.as_bytes() if is_onnx(path) else path.read_bytes()
    sha256 = hashlib.sha256(data).hexdigest()
    measured = measured_by_us(sha256)
    for run in runs:
        measured += _measured(Path(run), sha256)
    card = card_of(held, sha256, measured)
    text, difference = markdown(card), None
    if target is not None:
        kind = target.suffix.lower()
        if kind == ".onnx":
            from hlsd.learning.onnx_check import check_export
            from hlsd.learning.onnx_policy import onnx_bytes

            made = onnx_bytes(held, text)
            difference = check_export(held, made)
            write_new(target, made)
        elif kind == ".npz":
            write_new(target, data)
        else:
            plain = json.dumps(card, indent=2, ensure_ascii=False) + "\n"
            write_new(target, text if kind == ".md" else plain)
    return Exported(card, text, difference)


def _file(policy: Path | str) -> Path:
    """The file of a policy, or of the shipped one that a name means."""
    path = Path(policy)
    named = len(path.parts) == 1 and not path.suffix
    return shipped_policy(str(policy)) if named and not path.exists() else path


def _measured(run: Path, sha256: str) -> list[Card]:
    """How the policy drove in a run, under each name that it has there."""
    episodes, folder = load_episodes(run), folder_of(run)
    cards: list[Card] = []
    for row in summarise(episodes).to_dict("records"):
        name = str(row["planner"])
        if planner_digests(folder, name).get("policy") != sha256:
            continue
        own = episodes[episodes["planner"] == name]
        kept = {key: float(row[key]) for key in _KEPT}
        first = own.iloc[0]
        words = ["hlsd", "bench", "--planner", name.partition("@")[0]]
        for option in ("suite", "protocol", "robot", "seed"):
            words += [f"--{option}", str(first[option])]
        words += ["--trials", str(int(own.groupby("world").size().max()))]
        cards.append(
            {
                "command": shlex.join(words),
                "setting": setting(own),
                "runs": len(own),
                **{key: value for key, value in kept.items() if math.isfinite(value)},
            }
        )
    if not cards:
        raise HlsdError(
            f"no planner of {shown(run)} drove from this policy (SHA-256 {sha256}): "
            "give a run that did"
        )
    return cards
