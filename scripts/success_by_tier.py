"""Success of runs in DynaBARN's 60 worlds, by tier, with intervals over worlds.

hlsd worlds import path/to/the-barn-challenge --name dynabarn60
hlsd bench --suite dynabarn60 --planner hlsd10 --trials 10 --out runs/dynabarn60
python scripts/success_by_tier.py runs/dynabarn60
"""

import sys
from pathlib import Path

import numpy as np

from hlsd.analysis.runs import load_episodes
from hlsd.analysis.statistics import rate_interval

TIERS = {"easy": range(20), "medium": range(20, 40), "hard": range(40, 60)}


def main() -> None:
    """Print a row per run and planner."""
    heads = [f"{tier} | {tier}: hit by, late for a mover" for tier in TIERS]
    print(f"| protocol | planner | {' | '.join(heads)} |")
    print("|---" * (2 + 2 * len(TIERS)) + "|")
    for folder in sys.argv[1:]:
        episodes = load_episodes(Path(folder))
        for planner in episodes["planner"].drop_duplicates():
            own = episodes[episodes["planner"] == planner]
            cells = [str(own["protocol"].iloc[0]), str(planner)]
            for worlds in TIERS.values():
                runs = own[own["world"].isin(worlds)]
                reached = (runs["outcome"] == "success").to_numpy(np.float64)
                low, high = rate_interval(reached, runs["world"].to_numpy(np.int64))
                causes = runs["cause"].value_counts()
                hit, late = (
                    int(causes.get(name, 0))
                    for name in ("hit by mover", "late for mover")
                )
                cells.append(f"{reached.mean():.1%} ({low:.1%} … {high:.1%})")
                cells.append(f"{hit}, {late}")
            print(f"| {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
