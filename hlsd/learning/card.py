"""Model cards: what a policy is, generated from what its file records."""

import hashlib
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

from hlsd.core.reading import parse_toml
from hlsd.core.text import one_line
from hlsd.learning.hallucination import Kind
from hlsd.learning.onnx_policy import BOUND_TEXT, COMMAND, GOAL, RANGES, min_range_m
from hlsd.learning.policy import GOAL_INPUTS, Policy, said_by, shipped_policy

Card = Mapping[str, object]
"""Facts by name, for programs: texts, numbers, and lists and tables of such."""
LICENCE = "MIT"
"""Of the shipped policies: that of hlsd."""
_UNKNOWN = "not recorded"


def card_of(policy: Policy, sha256: str, measured: Sequence[Card] = ()) -> Card:
    """What a policy says of itself, and what was measured of it.

    Args:
        policy: The policy.
        sha256: Of its file as ``.npz``.
        measured: Runs that it drove, see `measured_by_us`.
    """
    said = said_by(policy.provenance)
    log = _table(said, "motion_log")
    recipe, trained = _table(log, "recipe"), _table(said, "training_set")
    lidar, imagined = policy.lidar, policy.hallucination
    shipped = [
        name for name in _SHIPPED if sha256 == _file_sha256(shipped_policy(name))
    ]
    sizes = [policy.inputs, *(len(bias) for bias in policy.biases)]
    return {
        "planner": policy.planner() or _UNKNOWN,
        "shipped_with_hlsd": bool(shipped),
        "method": _method(policy),
        "sha256": sha256,
        "licence": LICENCE if shipped else _UNKNOWN,
        "seed": said.get("seed", _UNKNOWN),
        "data": {
            "preset": recipe.get("preset", _UNKNOWN),
            "law": recipe.get("law", _UNKNOWN),
            "robot": recipe.get("robot", _UNKNOWN),
            "robot_version": recipe.get("robot_version", _UNKNOWN),
            "seed": recipe.get("seed", _UNKNOWN),
            "points": trained.get("points", _UNKNOWN),
            "samples": trained.get("samples", _UNKNOWN),
            "motion_log_sha256": log.get("sha256", _UNKNOWN),
        },
        "training": {
            "kind": str(imagined.kind.value),
            **_table(said, "optimiser"),
            "torch": said.get("torch", _UNKNOWN),
        },
        "network": {"layers": sizes, "between": "ReLU", "numbers": "float32"},
        "input": {
            "beams": policy.inputs - GOAL_INPUTS,
            "fov_rad": lidar.fov_rad,
            "min_range_m": min_range_m(policy),
            "clip_m": policy.clip_m,
            "goal_bearing_rad": policy.goal_bearing_rad,
        },
        "measured": [dict(each) for each in measured],
        "limits": _limits(policy),
    }


def markdown(card: Card) -> str:
    """A card for people."""
    name = one_line(card["planner"])
    lines = [
        f"# Policy for planner `{name}`",
        "",
        f"{card['method']} Made by hlsd, a benchmark for local robot-navigation "
        "planners.",
        "",
        "| | |",
        "|---|---|",
        f"| SHA-256 as .npz | `{card['sha256']}` |",
        f"| licence | {card['licence']} |",
        f"| seed of the training | {one_line(card['seed'])} |",
    ]
    for key in ("data", "training", "network", "input"):
        held = card[key]
        assert isinstance(held, dict)
        lines += [f"| {key}: {name} | {_cell(held[name])} |" for name in held]
    lines += ["", "## Measured", ""]
    runs = card["measured"]
    assert isinstance(runs, list)
    lines += [f"- {_measured_line(run)}" for run in runs] or [
        "Nothing is recorded; `hlsd bench` measures it."
    ]
    lines += ["", "## As ONNX", "", *_onnx_lines(card), "", "## Limits", ""]
    limits = card["limits"]
    assert isinstance(limits, list)
    return "\n".join([*lines, *(f"- {limit}" for limit in limits), ""])


def measured_by_us(sha256: str) -> list[Card]:
    """What a shipped policy was measured at; nothing of any other.

    Args:
        sha256: Of its file.
    """
    file = Path(__file__).parent / "policies" / "measured.toml"
    held = parse_toml(file.read_text(encoding="utf-8"), "table of measurements")
    found = held.get(sha256)
    return [found] if isinstance(found, dict) else []


_SHIPPED = ("hlsd04", "hlsd10", "lfh04", "lfh10")


def _method(policy: Policy) -> str:
    if policy.hallucination.kind is Kind.MOST_CONSTRAINED:
        return (
            "Learning from hallucination (LfH): it was trained on, and is shown, "
            "imagined scans of the most constrained space around a path."
        )
    return (
        "Hallucinated learning and sober deployment (HLSD): it was trained on imagined "
        "scans of the least obstacles that explain a motion, and is shown real ones."
    )


def _limits(policy: Policy) -> list[str]:
    limits = [
        "It is a network without any check: in hlsd a collision check, a recovery and "
        "the robot's speed limits stand behind it. A robot needs the like.",
        f"It sees {policy.clip_m:g} m far, and goals that are about 1 m away; "
        "something else has to plan the path that these lie on.",
        "All of its obstacles stood still, and all of its driving was simulated.",
        f"It takes scans of {policy.inputs - GOAL_INPUTS} beams over "
        f"{math.degrees(policy.lidar.fov_rad):.0f} degrees, and a robot of the size "
        "and the drive of the one in its data.",
    ]
    if policy.hallucination.kind is Kind.MOST_CONSTRAINED:
        limits.append(
            "Its scan must be imagined around the global path at each tick, which is "
            "no part of the network."
        )
    return limits


def _onnx_lines(card: Card) -> list[str]:
    shape = card["input"]
    assert isinstance(shape, dict)
    return [
        f"- `{RANGES}` (batch, {shape['beams']}), float32 [m]: the scan as the lidar "
        "gives it, beam 0 to the right, anticlockwise. No return is any value beyond "
        f"{shape['clip_m']:g} m, infinity too, or one below "
        f"{shape['min_range_m']:g} m. NaN is none of them: replace it.",
        f"- `{GOAL}` (batch, 2), float32 [m]: the local goal, x forward, y left.",
        f"- `{COMMAND}` (batch, 2), float32: speed [m/s], yaw rate [rad/s], "
        "anticlockwise; not limited.",
        f"- {BOUND_TEXT}",
    ]


def _measured_line(run: Card) -> str:
    parts = [f"{_percent(run['success'])} success"]
    time = f"{run['mean_time_s']:.1f}"
    if _number(run.get("sd_time_s")):
        time += f" ± {run['sd_time_s']:.1f}"
    parts.append(f"time {time} s, failures at the limit")
    if _number(run.get("mean_time_low_s")):
        low, high = run["mean_time_low_s"], run["mean_time_high_s"]
        parts[-1] += f" (95 % interval of the mean {low:.1f} … {high:.1f})"
    if _number(run.get("contact_free")):
        parts.append(f"{_percent(run['contact_free'])} contact-free")
    setting = f"{run['runs']} runs on {one_line(run['setting'], 300)}"
    return f"`{one_line(run['command'], 600)}`: {'; '.join(parts)}. {setting}."


def _number(value: object) -> bool:
    return isinstance(value, float) and math.isfinite(value)


def _percent(value: object) -> str:
    return f"{100 * float(str(value)):.1f} %"


def _cell(value: object) -> str:
    if isinstance(value, list):
        return " → ".join(map(str, value))
    text = f"{value:.6g}" if isinstance(value, float) else one_line(value, 200)
    return text.replace("|", "\\|")


def _table(said: Mapping[str, object], name: str) -> dict[str, object]:
    held = said.get(name)
    return held if isinstance(held, dict) else {}


def _file_sha256(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()
