"""What others published on BARN, in Gazebo, as facts to stand beside a run.

A score is worth what its worlds and its clip are, so both stand with it. Where a log of
the runs is public, both scores are computed from it.
"""

import math
from dataclasses import dataclass
from typing import Literal

NAN = math.nan


@dataclass(frozen=True, slots=True)
class PublishedScore:
    """What a planner scored in the BARN Challenge, or on its public worlds.

    Attributes:
        name: What drove.
        year: Of the publication, or of the Challenge.
        worlds: ``"hidden"``: the Challenge's own 50; ``"public"``: worlds 0, 6, ... 294
            of BARN, or a part of them.
        score_4_8: With the clip from 4 to 8 optimal times; NaN where it is not known.
        score_2_8: With the clip from 2 to 8 optimal times; likewise.
        success: Share of runs that reached the goal; likewise.
        time_s: Mean time of successes [s]; likewise.
        source: Where it stands.
        planner: The built-in planner of hlsd that follows the same method, "" for none.
            It is an implementation of its own.
    """

    name: str
    year: int
    worlds: Literal["hidden", "public"]
    score_4_8: float
    score_2_8: float
    success: float
    time_s: float
    source: str
    planner: str = ""


_CHALLENGE = "results of the BARN Challenge {year}, second-hand"
PUBLISHED_SCORES = (
    PublishedScore(
        "DWA, 0.5 m/s",
        2022,
        "public",
        0.158,
        0.159,
        0.850,
        33.2,
        "Daffan/nav-competition-icra2022: res/dwa_out.txt, 500 runs",
        "dwa05",
    ),
    PublishedScore(
        "DRL-VO",
        2022,
        "public",
        0.2339,
        0.372,
        0.936,
        15.0,
        "TempleRAIL/nav-competition-icra2022-drl-vo: README, res/drl_vo_out.txt, "
        "500 runs",
    ),
    PublishedScore(
        "LfLH with a state machine, Inventec",
        2023,
        "public",
        0.2445,
        NAN,
        0.99,
        14.03,
        "inventec-ai-center/inventec-team-barn-challenge-2023: README, second-hand",
    ),
    PublishedScore(
        "LfLH",
        2024,
        "hidden",
        NAN,
        0.4354,
        NAN,
        NAN,
        _CHALLENGE.format(year=2024),
    ),
    PublishedScore(
        "AIMS",
        2024,
        "hidden",
        NAN,
        0.4723,
        NAN,
        NAN,
        _CHALLENGE.format(year=2024),
    ),
    PublishedScore(
        "LiCS-KI",
        2024,
        "hidden",
        NAN,
        0.4762,
        NAN,
        NAN,
        _CHALLENGE.format(year=2024),
        "lics",
    ),
    PublishedScore(
        "LiCS-KI, own log",
        2024,
        "public",
        0.245,
        0.489,
        0.980,
        7.7,
        "damanikjosh/the-barn-challenge: out.txt, 500 runs",
        "lics",
    ),
    PublishedScore(
        "Nav2 MPPI, 0.5 m/s, another robot",
        2026,
        "public",
        NAN,
        0.105,
        0.756,
        NAN,
        "Saadmaghani/The-Barn-Challenge-Ros2: res/mppi_out.txt, 78 runs",
        "mppi",
    ),
    PublishedScore(
        "MPC, zebra314",
        2026,
        "public",
        NAN,
        0.338,
        0.705,
        NAN,
        "zebra314/barn-challenge-2026, 528 runs",
        "mpc",
    ),
    PublishedScore(
        "Rudra-roy",
        2026,
        "public",
        NAN,
        0.4451,
        NAN,
        NAN,
        "Rudra-roy/BARN, 500 runs",
    ),
    PublishedScore(
        "Team Robo (MPC)",
        2026,
        "hidden",
        NAN,
        0.4515,
        NAN,
        NAN,
        _CHALLENGE.format(year=2026),
        "mpc",
    ),
    PublishedScore(
        "EW-Glab (TEB)",
        2026,
        "hidden",
        NAN,
        0.4880,
        NAN,
        NAN,
        _CHALLENGE.format(year=2026),
        "teb",
    ),
    PublishedScore(
        "IN2BOT",
        2026,
        "hidden",
        NAN,
        0.4975,
        NAN,
        NAN,
        _CHALLENGE.format(year=2026),
    ),
)
"""By year. The best official static score so far is 0.4975."""


def scores_of_clip(lowest: float) -> list[tuple[PublishedScore, float]]:
    """The published scores of one clip, the best first, with their values.

    Args:
        lowest: Its lower bound in optimal times, 2 or 4.
    """
    known = [
        (held, held.score_4_8 if lowest == 4 else held.score_2_8)
        for held in PUBLISHED_SCORES
    ]
    known = [(held, score) for held, score in known if not math.isnan(score)]
    return sorted(known, key=lambda each: -each[1])


def published_of(planner: str) -> tuple[PublishedScore, ...]:
    """What is published of the method of a built-in planner, by year.

    Args:
        planner: Its name.
    """
    return tuple(held for held in PUBLISHED_SCORES if held.planner == planner)
