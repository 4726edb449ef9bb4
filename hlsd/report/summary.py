"""A run's summary, as `hlsd bench` prints it: one table, and time against world."""

import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pandas as pd

from hlsd.analysis.parts import shards_of, shards_text, stopped_text
from hlsd.analysis.runs import load_episodes, perturbations_of, protocol_of, times_s
from hlsd.analysis.summary import score_column, summarise
from hlsd.core.files import write_atomic
from hlsd.planners.registry import FLOOR
from hlsd.report.cause_table import cause_note
from hlsd.report.drawing import (
    drawn,
    label,
    new_figure,
    planner_shades,
    save_figure,
)
from hlsd.report.tables import (
    UNDEFINED,
    csv_table,
    interval_text,
    markdown_table,
    markdown_text,
    percent_text,
    plus_minus,
    share_text,
    with_interval,
)
from hlsd.run.protocol import Protocol
from hlsd.run.score import scores_beside

PLOT = "time_by_world.png"
SUMMARY = "summary"
SCORES_NOTE = (
    "Score A-B of a run: success x OT / clip(time, A OT, B OT), with OT = official "
    "path length / (2 m/s); its mean over each world's runs, then over worlds."
)


def summary_markdown(episodes: pd.DataFrame) -> str:
    """The summary as a Markdown table with its footnotes.

    Args:
        episodes: From `load_episodes` or `join_runs`, of one protocol.
    """
    protocol = protocol_of(episodes)
    notes = [*cause_note(episodes), *floor_note(episodes), *apart(episodes)]
    errors = episodes[episodes["outcome"] == "error"]
    if len(errors):
        notes.append(
            f"{len(errors)} runs ended in a planner's error, the first: "
            f"{errors['reason'].iloc[0]}"
        )
    table = _paper_table if protocol.score is None else _challenge_table
    head = markdown_text(setting(episodes))
    return f"{head}\n\n{table(summarise(episodes), protocol, notes)}"


def floor_note(episodes: pd.DataFrame) -> list[str]:
    """Said where the floor stands among the planners; else nothing."""
    driven = episodes["planner"][episodes["robot"] != ""]  # imported runs have none
    for name in driven.unique():
        if str(name).split(" (")[0] == FLOOR:
            return [
                f"{name} is the floor: it follows the global path and never looks at "
                "the scan, so that its row is what the path alone is worth."
            ]
    return []


def apart(episodes: pd.DataFrame) -> list[str]:
    """Said where planners did not drive in the same worlds; else nothing."""
    worlds = episodes.groupby("planner", sort=False)["world"].agg(frozenset)
    if worlds.nunique() < 2:
        return []
    counts = ", ".join(f"{name} in {len(held)}" for name, held in worlds.items())
    return [f"Not all drove in the same worlds, so rows differ by that: {counts}."]


def setting(episodes: pd.DataFrame) -> str:
    """What was run, in a line: suite, worlds, protocol, robots, seeds, shards."""
    first = episodes.iloc[0]
    driven = episodes[["robot", "robot_version"]].drop_duplicates()
    robots = [f"{name} {version}".strip() for name, version in driven.to_numpy()]
    found = episodes["seed"].unique()
    seeds = ["" if pd.isna(seed) else str(int(seed)) for seed in found]
    disturbed, part = perturbations_of(episodes), shards_text(episodes)
    stopped = stopped_text(episodes)
    return (
        f"{first['suite']}, {episodes['world'].nunique()} worlds, protocol "
        f"{first['protocol']}, robot {_named(robots)}, seed {_named(seeds)}"
        f"{f', perturbed by {disturbed}' if disturbed else ''}"
        f"{f'; {part}' if part else ''}{f'; {stopped}' if stopped else ''}"
    )


def write_summary(folder: Path) -> str:
    """Write ``summary.md``, ``summary.csv`` and the plot beside a run's episodes.

    Args:
        folder: A finished run.

    Returns:
        The Markdown table.
    """
    episodes = load_episodes(folder)
    text = summary_markdown(episodes)
    write_atomic(folder / f"{SUMMARY}.md", text)
    write_atomic(folder / f"{SUMMARY}.csv", csv_table(summarise(episodes)))
    plot_times(episodes, folder / PLOT)
    return text


@drawn
def plot_times(episodes: pd.DataFrame, path: Path) -> None:
    """Draw time against world: a dot per run, a line per planner.

    Args:
        episodes: From `load_episodes`.
        path: PNG to write.
    """
    protocol = protocol_of(episodes)
    figure = new_figure((9, 4.5))
    axes = figure.add_subplot()
    shades = planner_shades(map(str, episodes["planner"].unique()))
    for name, runs in episodes.groupby("planner", sort=False):
        colour = shades[str(name)].light
        world = runs["world"].to_numpy(np.float64)
        success = (runs["outcome"] == "success").to_numpy()
        time = times_s(runs)
        touched = (runs["contacts"] > 0).to_numpy()
        clean = success & ~touched
        axes.scatter(world[clean], time[clean], s=9, color=colour, alpha=0.45, lw=0)
        axes.scatter(
            world[success & touched],
            time[success & touched],
            s=26,
            facecolors="none",
            edgecolors=colour,
            lw=1.1,
        )
        axes.scatter(world[~success], time[~success], s=30, marker="x", color=colour)
        title = (
            f"{label(str(name))}: mean {time.mean():.2f} s, "
            f"{percent_text(success.mean())} success"
        )
        if len(np.unique(world)) > 1:
            slope, offset = np.polyfit(world, time, 1)
            ends = np.array([world.min(), world.max()])
            axes.plot(ends, slope * ends + offset, color=colour, lw=2, label=title)
        else:
            axes.plot([], [], color=colour, lw=2, label=title)
    axes.scatter([], [], s=26, facecolors="none", edgecolors="grey", label="contact")
    axes.scatter([], [], s=30, marker="x", color="grey", label="failed, at the limit")
    axes.set_ylim(0, protocol.limit_s * 1.04)
    axes.axhline(protocol.limit_s, color="0.7", lw=0.8, ls="--")
    parts = "".join(f", shard {shard}" for shard in shards_of(episodes).values())
    axes.set_xlabel(f"world of {label(str(episodes['suite'].iloc[0]))}{parts}")
    axes.set_ylabel("traversal time [s]")
    figure.legend(loc="outside upper left", fontsize=8, ncols=3, frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    save_figure(figure, path)


def _paper_table(summary: pd.DataFrame, protocol: Protocol, notes: list[str]) -> str:
    head = [
        "planner",
        "n",
        "success",
        "time, failures at limit [s]",
        "95 % interval",
        "time, contact as failure [s]",
        "time of successes [s]",
        "contact-free",
    ]
    rows = []
    for _, row in summary.iterrows():
        low, high = row["mean_time_low_s"], row["mean_time_high_s"]
        rows.append(
            [
                str(row["planner"]),
                str(row["n"]),
                percent_text(row["success"]),
                plus_minus(row["mean_time_s"], row["sd_time_s"]),
                interval_text(low, high, ".2f") or UNDEFINED,
                _contact_fails_text(row),
                _success_time(row),
                _contact_free_text(row),
            ]
        )
    note = (
        f"Mean ± sd over all runs, a run that fails counts {protocol.limit_s:g} s; the "
        "interval is of the mean, from resampling worlds; one world has none. With "
        "contact as failure, so does a run that touches an obstacle."
    )
    return markdown_table(head, rows, note, *notes)


def _challenge_table(
    summary: pd.DataFrame, protocol: Protocol, notes: list[str]
) -> str:
    assert protocol.score is not None
    scores = scores_beside(protocol.score)
    head = [
        "planner",
        "n",
        "success",
        "collision",
        "timeout",
        "time of successes [s]",
        "time, failures at limit [s]",
        *(f"score {score.name}" for score in scores),
    ]
    rows = []
    for _, row in summary.iterrows():
        rows.append(
            [
                str(row["planner"]),
                str(row["n"]),
                _success_text(row),
                percent_text(row["collision"]),
                percent_text(row["timeout"]),
                _success_time(row),
                with_interval(
                    f"{row['mean_time_s']:.2f}",
                    interval_text(
                        row["mean_time_low_s"], row["mean_time_high_s"], ".2f"
                    ),
                ),
                *(_score_text(row, score_column(score)) for score in scores),
            ]
        )
    note = (
        f"A run that fails counts {protocol.limit_s:g} s in the time with failures at "
        f"the limit. {SCORES_NOTE} {protocol.name} is scored by "
        f"{protocol.score.name}. In brackets: 95 % intervals from resampling "
        "worlds, of success from counting runs by world; one world has none."
    )
    return markdown_table(head, rows, note, *notes)


def _success_text(row: "pd.Series[float]") -> str:
    """The rate of success with its interval."""
    low, high = row["success_low"], row["success_high"]
    text = percent_text(row["success"])
    if math.isnan(low):
        return text
    return with_interval(text, interval_text(percent_text(low), percent_text(high)))


def _contact_fails_text(row: "pd.Series[float]") -> str:
    """Mean and deviation; a word where contacts were not counted."""
    mean_s = row["mean_time_contact_fails_s"]
    if math.isnan(mean_s):
        return "unknown"
    return plus_minus(mean_s, row["sd_time_contact_fails_s"])


def _contact_free_text(row: "pd.Series[float]") -> str:
    """The share of the runs that drove; a word where contacts were not counted."""
    if row["drove"] > 0 and math.isnan(row["contact_free"]):
        return "unknown"
    return share_text(row["contact_free"], int(row["drove"]), int(row["n"]))


def _success_time(row: "pd.Series[float]") -> str:
    """Mean time of successes, or the word for none."""
    time_s = row["mean_success_time_s"]
    return "none" if math.isnan(time_s) else f"{time_s:.2f}"


def _score_text(row: "pd.Series[float]", column: str) -> str:
    low, high = row[f"{column}_low"], row[f"{column}_high"]
    return with_interval(f"{row[column]:.4f}", interval_text(low, high, ".4f"))


def _named(values: Iterable[str]) -> str:
    """The distinct values, in order."""
    return ", ".join(value or "unknown" for value in dict.fromkeys(values))
