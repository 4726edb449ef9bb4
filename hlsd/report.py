"""Episodes -> the summary table and the plot of time against world."""

import io
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pandas as pd

from hlsd.errors import HlsdError
from hlsd.files import write_atomic
from hlsd.protocol import get_protocol
from hlsd.results import COLUMNS, EPISODES
from hlsd.statistics import world_interval
from hlsd.types import FloatArray

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PLOT = "time_by_world.png"
SUMMARY = "summary"

# The paper's colours (section IV-B); HLSD 1.0 gets its own.
COLOURS = {
    "dwa": "tab:blue",
    "dwa05": "steelblue",
    "lfh10": "tab:red",
    "lfh04": "magenta",
    "hlsd04": "darkturquoise",
    "hlsd10": "tab:green",
}


def load_episodes(path: Path) -> pd.DataFrame:
    """The rows of a run.

    Args:
        path: The run's folder, or its ``episodes.csv``.

    Raises:
        HlsdError: It is not there or is no such table.
    """
    file = path / EPISODES if path.is_dir() else path
    try:
        episodes = pd.read_csv(file, keep_default_na=False)
    except FileNotFoundError:
        raise HlsdError(
            f"no {EPISODES} at {str(path)!r}: give a run's folder"
        ) from None
    except (ValueError, OSError) as error:
        raise HlsdError(f"{str(file)!r} is no episode table: {error}") from error
    missing = [name for name in COLUMNS if name not in episodes.columns]
    if missing:
        raise HlsdError(f"{str(file)!r} is no episode table: it lacks {missing[0]!r}")
    return episodes


def times_s(episodes: pd.DataFrame) -> FloatArray:
    """Time of each run, a failure's being the protocol's limit [s], ``(n,)``.

    Args:
        episodes: From `load_episodes`, of one protocol.
    """
    limit_s = get_protocol(str(episodes["protocol"].iloc[0])).limit_s
    success = (episodes["outcome"] == "success").to_numpy()
    return np.where(success, episodes["time_s"].to_numpy(np.float64), limit_s)


def summarise(episodes: pd.DataFrame) -> pd.DataFrame:
    """One row per planner.

    Args:
        episodes: From `load_episodes`, of one protocol.

    Returns:
        Columns: ``planner``; ``n`` runs; ``success``, fraction of runs; ``mean_time_s``
        and ``sd_time_s`` over all runs, failures at the protocol's limit (the paper's
        table; a restricted mean); ``mean_time_low_s`` and ``mean_time_high_s``, its
        95 % interval clustered by world; ``mean_success_time_s`` over successes alone;
        ``contact_free``, fraction of runs; ``errors``, number of runs.
    """
    rows = []
    for planner, runs in episodes.groupby("planner", sort=False):
        success = (runs["outcome"] == "success").to_numpy()
        times = times_s(runs)
        low, high = world_interval(times, runs["world"].to_numpy(np.int64))
        rows.append(
            {
                "planner": planner,
                "n": len(runs),
                "success": float(success.mean()),
                "mean_time_s": float(times.mean()),
                "sd_time_s": float(times.std(ddof=1)) if len(times) > 1 else 0.0,
                "mean_time_low_s": low,
                "mean_time_high_s": high,
                "mean_success_time_s": (
                    float(times[success].mean()) if success.any() else float("nan")
                ),
                "contact_free": float((runs["contacts"] == 0).mean()),
                "errors": int((runs["outcome"] == "error").sum()),
            }
        )
    return pd.DataFrame(rows)


def summary_markdown(episodes: pd.DataFrame) -> str:
    """The summary as a Markdown table with its footnote."""
    first = episodes.iloc[0]
    protocol = get_protocol(str(first["protocol"]))
    lines = [
        f"{first['suite']}, {episodes['world'].nunique()} worlds, protocol "
        f"{protocol.name}, robot {first['robot']} {first['robot_version']}, "
        f"seed {first['seed']}",
        "",
        "| planner | n | success | time, failures at limit [s] | 95 % interval "
        "| time of successes [s] | contact-free |",
        "|---|---|---|---|---|---|---|",
    ]
    for record in summarise(episodes).to_dict("records"):
        row = {str(name): value for name, value in record.items()}
        lines.append(
            "| {planner} | {n} | {success:.1%} | {mean_time_s:.2f} ± {sd_time_s:.2f} "
            "| {mean_time_low_s:.2f} … {mean_time_high_s:.2f} "
            "| {mean_success_time_s:.2f} | {contact_free:.1%} |".format(**row)
        )
    lines += [
        "",
        f"Mean ± sd over all runs, a run that fails counts {protocol.limit_s:g} s; the "
        "interval is of the mean, from resampling worlds.",
    ]
    errors = episodes[episodes["outcome"] == "error"]
    if len(errors):
        lines.append(
            f"{len(errors)} runs ended in a planner's error, the first: "
            f"{errors['reason'].iloc[0]}"
        )
    return "\n".join(lines) + "\n"


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
    table = summarise(episodes).to_csv(index=False, lineterminator="\n")
    write_atomic(folder / f"{SUMMARY}.csv", table)
    plot_times(episodes, folder / PLOT)
    return text


def plot_times(episodes: pd.DataFrame, path: Path) -> None:
    """Draw time against world: a dot per run, a line per planner.

    Args:
        episodes: From `load_episodes`.
        path: PNG to write.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    protocol = get_protocol(str(episodes["protocol"].iloc[0]))
    figure = Figure(figsize=(9, 4.5), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.add_subplot()
    palette = iter(("tab:orange", "tab:purple", "tab:brown", "tab:olive", "black"))
    for name, runs in episodes.groupby("planner", sort=False):
        colour = COLOURS.get(str(name)) or next(palette, "grey")
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
        label = (
            f"{name}: mean {time.mean():.2f} s, {100 * success.mean():.1f} % success"
        )
        if len(np.unique(world)) > 1:
            slope, offset = np.polyfit(world, time, 1)
            ends = np.array([world.min(), world.max()])
            axes.plot(ends, slope * ends + offset, color=colour, lw=2, label=label)
        else:
            axes.plot([], [], color=colour, lw=2, label=label)
    axes.scatter([], [], s=26, facecolors="none", edgecolors="grey", label="contact")
    axes.scatter([], [], s=30, marker="x", color="grey", label="failed, at the limit")
    axes.set_ylim(0, protocol.limit_s * 1.04)
    axes.axhline(protocol.limit_s, color="0.7", lw=0.8, ls="--")
    axes.set_xlabel(f"world of {episodes['suite'].iloc[0]}")
    axes.set_ylabel("traversal time [s]")
    figure.legend(loc="outside upper left", fontsize=8, ncols=3, frameon=False)
    axes.spines[["top", "right"]].set_visible(False)
    save_figure(figure, path)


def save_figure(figure: "Figure", path: Path) -> None:
    """Write a PNG so that it is there whole or not at all."""
    image = io.BytesIO()
    figure.savefig(image, dpi=140, format="png")
    write_atomic(path, image.getvalue())
