"""Draw failures for the eye, and compare what the eye said with the rules.

    python scripts/failure_sheets.py draw RUN... --out SHEETS --count 100
    python scripts/failure_sheets.py agree RUN... --labels docs/causes_confirm.csv

A sheet shows four failures, each as a map of its last seconds, one of all of it, and
speed, yaw rate and mode over time. Where obstacles move, the last seconds are fewer
and the map is wider: movers have the colour of the robot's outline of the same moment,
and an arrow as long as they go in 0.5 s. A sheet tells neither the cause nor any number
of the rules. ``key.csv`` beside the sheets names the episodes; a copy of it with a
column ``label`` filled in is what ``agree`` reads. docs/causes.md says how it was used.
"""

import argparse
import csv
import dataclasses
import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd

mpl.use("Agg")
import matplotlib.pyplot as plt
from matplotlib.axes import Axes
from matplotlib.collections import PatchCollection
from matplotlib.figure import Figure
from matplotlib.patches import Polygon

from hlsd.analysis.runs import load_episodes
from hlsd.core.description import Outline
from hlsd.data.worlds import World, load_suite
from hlsd.planners.base import Mode
from hlsd.report.arena_view import shape_patches
from hlsd.run.cause import cause_of
from hlsd.run.clearance import clearances
from hlsd.run.outcome import Outcome
from hlsd.run.protocol import get_protocol
from hlsd.run.recording import Record
from hlsd.run.trajectory import MODES, Key, Trajectory, decode, read_trajectories
from hlsd.sim.robots import get_robot

KEYS = ("suite", "protocol", "planner", "world", "trial")
PER_SHEET = 4
CLOSE_M = 1.3
LAST_S = 8.0
EVERY_S = 0.5
MOVERS_CLOSE_M = 1.9
MOVERS_LAST_S = 2.5
ARROW_S = 0.5
COLOURS = {
    Mode.PLAN: "white",
    Mode.TURN_IN_PLACE: "gold",
    Mode.ROTATE: "orange",
    Mode.REVERSE: "tomato",
    Mode.WAIT: "lightgrey",
    Mode.CLEAR: "violet",
    Mode.TURN_AROUND: "orange",
    Mode.GIVEN_UP: "dimgrey",
}


def main() -> None:
    """Draw sheets, or print the agreement."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("draw", "agree"))
    parser.add_argument("runs", nargs="+", type=Path)
    parser.add_argument("--out", type=Path, default=Path("sheets"))
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--labels", type=Path)
    given = parser.parse_args()
    if given.what == "draw":
        draw(given.runs, given.out, given.count, given.seed)
    else:
        print(agreement(given.runs, given.labels))


def draw(runs: Sequence[Path], out: Path, count: int, seed: int) -> None:
    """Sheets and ``key.csv`` of failures, in an order that is drawn by lot.

    Timeouts come in whole, since they are rarer; contacts of each planner in turn make
    up the number.

    Args:
        runs: Folders of finished runs with trajectories.
        out: A new folder.
        count: Of failures.
        seed: Of the lot.
    """
    failures = pd.concat([_failures(run) for run in runs], ignore_index=True)
    rng = np.random.default_rng(seed)
    shuffled = failures.iloc[rng.permutation(len(failures))]
    late = shuffled["outcome"] == "timeout"
    contacts = shuffled[~late]
    turn = contacts.groupby("planner").cumcount().sort_values(kind="stable").index
    chosen = pd.concat([shuffled[late], contacts.loc[turn]]).head(count)
    chosen = chosen.iloc[rng.permutation(len(chosen))].reset_index(drop=True)
    out.mkdir(parents=True)
    with (out / "key.csv").open("w", newline="", encoding="utf-8") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("number", *KEYS, "label"))
        for number, row in chosen.iterrows():
            writer.writerow((number, *(row[key] for key in KEYS), ""))
    blocks = {run: read_trajectories(run) for run in runs}
    for first in range(0, len(chosen), PER_SHEET):
        rows = chosen.iloc[first : first + PER_SHEET]
        figure, axes = plt.subplots(
            PER_SHEET,
            3,
            figsize=(15, 4.4 * PER_SHEET),
            width_ratios=(1.0, 0.8, 1.3),
        )
        figure.subplots_adjust(
            left=0.03, right=0.99, bottom=0.03, top=0.98, wspace=0.1, hspace=0.2
        )
        for own, (number, row) in zip(axes, rows.iterrows(), strict=False):
            key = str(row["planner"]), int(row["world"]), int(row["trial"])
            trajectory = decode(blocks[row["run"]][key])
            _draw_one(figure, own, int(str(number)), row, trajectory)
        figure.savefig(out / f"sheet{first // PER_SHEET:02d}.png", dpi=75)
        plt.close(figure)


def agreement(runs: Sequence[Path], labels: Path) -> str:
    """Share of equal verdicts, Cohen's kappa and the table of both, as Markdown.

    Args:
        runs: Folders of finished runs with trajectories.
        labels: A ``key.csv`` with labels.
    """
    rows = pd.concat([_failures(run) for run in runs], ignore_index=True)
    blocks = {run: read_trajectories(run) for run in runs}
    held = pd.read_csv(labels, dtype={"label": str})
    both = held.merge(rows, on=list(KEYS), how="left", validate="one_to_one")
    if both["run"].isna().any():
        raise SystemExit("the runs lack episodes that have a label")
    eye = both["label"]
    rule = pd.Series([_cause(row, blocks[row["run"]]) for _, row in both.iterrows()])
    for number in both["number"][eye != rule]:
        print(f"{number}: {eye[number]} by eye, {rule[number]} by rule")
    same = float((eye == rule).mean())
    names = sorted({*eye, *rule})
    by_chance = sum(float((eye == n).mean() * (rule == n).mean()) for n in names)
    kappa = (same - by_chance) / (1.0 - by_chance)
    lines = [
        f"{len(both)} failures: {(eye == rule).sum()} alike ({100 * same:.0f} %), "
        f"Cohen's kappa {kappa:.2f}",
        "",
        "| by eye \\ by rule | " + " | ".join(names) + " |",
        "|---|" + "---:|" * len(names),
    ]
    for name in names:
        counts = [int(((eye == name) & (rule == other)).sum()) for other in names]
        lines.append(f"| {name} | " + " | ".join(map(str, counts)) + " |")
    return "\n".join(lines)


def _failures(run: Path) -> pd.DataFrame:
    """Timeouts and collisions of a run, with its folder."""
    rows = load_episodes(run)
    failed = rows[rows["outcome"].isin(("timeout", "collision"))]
    return failed.assign(run=run)


def _cause(row: "pd.Series[str]", blocks: Mapping[Key, bytes]) -> str:
    """What the rules say of a trajectory, which is kept to 1 mm and 1 cm/s."""
    key = str(row["planner"]), int(row["world"]), int(row["trial"])
    kept = decode(blocks[key])
    world = load_suite(str(row["suite"]))[key[1]]
    speeds = np.vstack((kept.speeds, kept.speeds[-1:]))
    still = np.zeros(len(speeds))
    contact_times_s = np.concatenate(([0.0], np.cumsum(kept.touching * 1.0)))
    record = Record(
        world=world,
        limits=get_robot(str(row["robot"])).limits,
        period_s=kept.period_s,
        motions=np.column_stack((kept.poses, speeds[:, 0], still, speeds[:, 1])),
        commands=kept.commands,
        modes=kept.modes,
        local_goals=kept.local_goals,
        contact_times_s=contact_times_s,
        mover_contact_times_s=np.zeros(len(speeds)),
        movers_begin_s=kept.movers_begin_s,
        movers_waited_s=kept.movers_waited_s,
        paths=kept.paths,
    )
    if world.movers:
        # What was touched is not kept: it is what was nearer.
        outline = record.limits.outline
        stands_m = clearances(record.motions[:, :3], outline, world.shapes)
        nearer = record.mover_clearances_m.min(axis=1) < stands_m
        by_mover = np.cumsum(kept.touching * nearer[1:])
        times_s = np.concatenate(([0.0], by_mover))
        record = dataclasses.replace(record, mover_contact_times_s=times_s)
    goal = get_protocol(str(row["protocol"])).goal(world)
    return str(cause_of(record, Outcome(str(row["outcome"])), goal).cause)


def _draw_one(
    figure: Figure,
    axes: Sequence[Axes],
    number: int,
    row: "pd.Series[str]",
    trajectory: Trajectory,
) -> None:
    world = load_suite(str(row["suite"]))[int(row["world"])]
    protocol = get_protocol(str(row["protocol"]))
    robot = get_robot(str(row["robot"]))
    goal = protocol.goal(world)
    close_m, last_s = CLOSE_M, LAST_S
    if world.movers:
        close_m, last_s = MOVERS_CLOSE_M, MOVERS_LAST_S
    close, whole, strips = axes
    poses, period_s = trajectory.poses, trajectory.period_s
    ticks = len(trajectory.commands)
    for panel in (close, whole):
        _draw_world(panel, world)
        panel.plot(*goal, "*", color="green", ms=12)
        panel.plot(poses[:, 0], poses[:, 1], color="tab:blue", lw=0.8)
        panel.set_aspect("equal")
        if trajectory.paths:
            points = trajectory.paths[-1][1]
            panel.plot(points[:, 0], points[:, 1], ":", color="green", lw=1)
    every = max(1, round(EVERY_S / period_s))
    shown = range(ticks, max(-1, ticks - round(last_s / period_s) - 1), -every)
    for k in reversed(list(shown)):
        colour = plt.cm.plasma(0.9 * (ticks - k) * period_s / last_s)
        _draw_robot(close, poses[k], robot.limits.outline, colour)
        for panel in (close, whole):
            _draw_movers(panel, world, trajectory, k, colour, at_end=k == ticks)
    last = poses[-1]
    close.set_xlim(last[0] - close_m, last[0] + close_m)
    close.set_ylim(last[1] - close_m, last[1] + close_m)
    close.set_title(f"{number}: {row['planner']}, last {last_s:g} s, dark is the end")
    touched = np.flatnonzero(trajectory.touching)
    if len(touched):
        whole.plot(poses[touched + 1, 0], poses[touched + 1, 1], "rx", ms=7)
    _draw_robot(whole, last, robot.limits.outline, "black")
    whole.plot(*poses[0, :2], "ko", ms=4)
    # As wide as BARN's field, or as the walls around movers.
    low, high = np.array([-4.6, 3.0]), np.array([0.2, 3.0])
    if world.movers:
        low, high = world.shapes.bounds() or (poses[0, :2], goal)
    x = np.concatenate((poses[:, 0], [goal[0], low[0], high[0]]))
    y = np.concatenate((poses[:, 1], [goal[1], low[1], high[1]]))
    whole.set_xlim(x.min() - 0.3, x.max() + 0.3)
    whole.set_ylim(y.min() - 0.3, y.max() + 0.3)
    whole.set_title(f"{row['outcome']}, {row['protocol']}")
    _draw_strips(figure, strips, trajectory)


def _draw_world(axes: Axes, world: World) -> None:
    parts = shape_patches(world.shapes)
    axes.add_collection(PatchCollection(parts, color="0.6", lw=0))


def _draw_movers(
    axes: Axes,
    world: World,
    trajectory: Trajectory,
    tick: int,
    colour: object,
    *,
    at_end: bool,
) -> None:
    """Where movers were at a tick; at the end filled, and where they go."""
    clocks_s = trajectory.mover_clocks_s()[[max(tick - 1, 0), tick]]
    for mover, times_s in zip(world.movers, clocks_s.T, strict=True):
        before, at = mover.track.at(times_s)
        for patch in shape_patches(mover.at(*at.tolist())):
            patch.set(fill=False, edgecolor=colour, lw=1.2)
            if at_end:
                patch.set(fill=True, facecolor=(0.8, 0.3, 0.5, 0.25))
            axes.add_patch(patch)
        gone_s = float(times_s[1] - times_s[0])
        if at_end and gone_s > 0.0:
            axes.quiver(
                *at,
                *(ARROW_S / gone_s * (at - before)),
                color=colour,
                angles="xy",
                scale_units="xy",
                scale=1.0,
                width=0.008,
                zorder=4,
            )


def _draw_robot(axes: Axes, pose: np.ndarray, outline: Outline, colour: object) -> None:
    """Its outline, and a line towards its front."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    turn = np.array([[c, s], [-s, c]])
    length, width = outline.half_length_m, outline.half_width_m
    corners = [(length, width), (-length, width), (-length, -width), (length, -width)]
    points = np.array(corners) @ turn + pose[:2]
    axes.add_patch(Polygon(points, fill=False, edgecolor=colour, lw=1.2))
    nose = np.array([[0.0, 0.0], [length, 0.0]]) @ turn + pose[:2]
    axes.plot(nose[:, 0], nose[:, 1], color=colour, lw=1.2)


def _draw_strips(figure: Figure, axes: Axes, trajectory: Trajectory) -> None:
    """Speed and yaw rate, measured and commanded, over the whole run and its end."""
    place = axes.get_subplotspec()
    assert place is not None, "these axes are of a grid"
    box = place.subgridspec(4, 1, hspace=0.05)
    axes.remove()
    times_s = np.arange(len(trajectory.commands)) * trajectory.period_s
    end_s = float(times_s[-1]) + trajectory.period_s if len(times_s) else 1.0
    for part in range(4):
        axes = figure.add_subplot(box[part])
        column = part % 2
        axes.plot(times_s, trajectory.commands[:, column], color="0.5", lw=0.7)
        axes.plot(times_s, trajectory.speeds[:, column], color="tab:blue", lw=1.2)
        axes.axhline(0.0, color="0.8", lw=0.8)
        low, high = axes.get_ylim()
        for index, mode in enumerate(MODES):
            inside = trajectory.modes == index
            if index and inside.any():
                axes.fill_between(
                    times_s,
                    low,
                    high,
                    where=inside,
                    color=COLOURS[mode],
                    alpha=0.6,
                    lw=0,
                    label=mode.value,
                )
        axes.plot(
            times_s[trajectory.touching],
            np.full(int(trajectory.touching.sum()), low),
            "r|",
            ms=12,
        )
        axes.set_xlim(0.0 if part < 2 else max(0.0, end_s - LAST_S), end_s)
        axes.set_ylabel(("v", "w")[column])
        if part == 0 and axes.get_legend_handles_labels()[0]:
            axes.legend(fontsize=8, loc="upper left", ncols=4)


if __name__ == "__main__":
    main()
