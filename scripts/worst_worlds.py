"""How a planner drove where its times are farthest from a reference's.

    hlsd validate RUN --against FILE --worlds-out WORLDS.csv
    python scripts/worst_worlds.py RUN WORLDS.csv [RUN WORLDS.csv ...] [--most 10]

Prints the worlds with the largest differences of mean time, with what the trajectories
show: seconds in which the robot stood or turned in place, crept, or backed up, full
turns, and the share of runs that touched an obstacle. Then the same for all worlds in
which it was slower by more than 5 s, as medians over all worlds and means over those.
"""

import argparse
from pathlib import Path

import numpy as np
import pandas as pd

from hlsd.analysis.runs import load_episodes
from hlsd.run.trajectory import Trajectory, decode, read_trajectories

STANDS, CREEPS = 0.05, 0.25  # slower commands stand, creep [m/s]
FAR_S = 5.0


def shown(trajectory: Trajectory) -> dict[str, float]:
    """What one run shows."""
    speed, period_s = trajectory.commands[:, 0], trajectory.period_s
    yaw = np.unwrap(trajectory.poses[:, 2])
    return {
        "stands [s]": float(np.sum(np.abs(speed) < STANDS) * period_s),
        "creeps [s]": float(np.sum((speed >= STANDS) & (speed < CREEPS)) * period_s),
        "backs up [s]": float(np.sum(speed <= -STANDS) * period_s),
        "full turns": float(np.abs(np.diff(yaw)).sum() / (2.0 * np.pi)),
        "touches": float(trajectory.touching.any()),
    }


def by_world(run: Path, compared: Path) -> pd.DataFrame:
    """A row for each world of a run: times, and means of what its runs show."""
    blocks = read_trajectories(run)
    rows = [
        {"world": world, **shown(decode(blocks[planner, world, trial]))}
        for planner, world, trial in load_episodes(run)[
            ["planner", "world", "trial"]
        ].itertuples(index=False)
    ]
    means = pd.DataFrame(rows).groupby("world").mean()
    times = pd.read_csv(compared).set_index("world")
    means.insert(0, "time [s]", times["mean_time_s"])
    means.insert(1, "reference [s]", times["reference_mean_time_s"])
    means.insert(2, "its success", times["reference_success"])
    means.insert(3, "difference [s]", means["time [s]"] - means["reference [s]"])
    return means


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", 1)[0])
    parser.add_argument("files", nargs="+", type=Path, help="RUN WORLDS.csv ...")
    parser.add_argument("--most", type=int, default=10)
    options = parser.parse_args()
    pairs = zip(options.files[::2], options.files[1::2], strict=True)
    worlds = pd.concat([by_world(run, compared) for run, compared in pairs])
    far = worlds["difference [s]"].abs().sort_values(ascending=False).index
    print(worlds.loc[far].head(options.most).round(1).to_string(), "\n")
    slow = worlds[worlds["difference [s]"] > FAR_S]
    fast = worlds[worlds["difference [s]"] < -FAR_S]
    print(f"{len(slow)} of {len(worlds)} worlds are slower by more than {FAR_S:g} s")
    failed = int((fast["its success"] < 1).sum())
    print(f"{len(fast)} are faster by as much; in {failed} of them runs of it failed\n")
    both = {"median of all": worlds.median(), "mean of the slower": slow.mean()}
    print(pd.DataFrame(both).T.round(1).to_string())


if __name__ == "__main__":
    main()
