"""The paper's tables and figure, from the rows of a run of its planners.

*Agile Robot Navigation through Hallucinated Learning and Sober Deployment*, section
IV: table I gives the traversal times of five planners, a figure shows them over worlds
ordered by difficulty, each with a line fitted by linear regression, and the text gives
the size of the data set. Beside the paper's planners stand others, among them the
floor, which shows what the global path alone is worth.
"""

import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from types import MappingProxyType

import pandas as pd

from hlsd.analysis.runs import protocol_of
from hlsd.analysis.summary import summarise
from hlsd.core.errors import HlsdError
from hlsd.planners.registry import BUILT_IN
from hlsd.report.curves import times_by_world
from hlsd.report.drawing import save_figure
from hlsd.report.figures import draw_orders
from hlsd.report.tables import (
    UNDEFINED,
    csv_table,
    interval_text,
    latex_table,
    markdown_table,
    markdown_text,
    number_text,
    percent_text,
    plus_minus,
    share_text,
)
from hlsd.studies.published import BESIDE as BESIDE
from hlsd.studies.published import PUBLISHED as PUBLISHED
from hlsd.studies.published import TITLES as TITLES
from hlsd.studies.published import Published as Published
from hlsd.studies.published import Time as Time

STRICT_ROW = "hlsd: time, contact as failure [s] (our reading, found after the result)"
"""The row of table I that neither the paper nor its protocol has."""


@dataclass(frozen=True, slots=True)
class Measured:
    """What a run says of a planner.

    Attributes:
        runs: Their number.
        drove: Number of those that drove.
        time: Over all runs, failures at the protocol's limit.
        interval_s: Of the mean, 95 %, from resampling worlds [s].
        strict: Likewise, a run that touches an obstacle being a failure as well; NaN
            where contacts were not counted.
        strict_interval_s: Of its mean [s].
        success: Fraction of runs.
        contact_free: Fraction of the runs that drove; NaN where none did.
        planning_ms: Mean wall time of planning for each tick [ms]; NaN likewise.
    """

    runs: int
    drove: int
    time: Time
    interval_s: tuple[float, float]
    strict: Time
    strict_interval_s: tuple[float, float]
    success: float
    contact_free: float
    planning_ms: float


@dataclass(frozen=True, slots=True)
class TableOne:
    """Table I with a run's numbers beside the paper's.

    Attributes:
        setting: What was run, in words.
        limit_s: Time of a run that fails [s].
        measured: By planner, in `TITLES`' order; those that were run.
    """

    setting: str
    limit_s: float
    measured: Mapping[str, Measured]

    def markdown(self) -> str:
        """The table for people, with its footnote."""
        table = markdown_table(_titles(), self._rows(), *self._notes())
        return f"{markdown_text(self.setting)}\n\n{table}"

    def latex(self) -> str:
        """The table for a paper: a ``tabular``; needs the package booktabs."""
        rows = self._rows()
        align = f"l{'c' * len(TITLES)}"
        comments = (self.setting, *self._notes())
        return latex_table(align, _titles(), [rows[:3], rows[3:]], comments)

    def csv(self) -> str:
        """The table for programs: a line per planner, unrounded, empty = not there."""
        records = []
        for name in TITLES:
            ours, entry = self.measured.get(name), PUBLISHED.get(name)
            simulated = entry.simulated if entry else None
            physical = entry.physical if entry else None
            records.append(
                {
                    "planner": name,
                    "paper_simulated_mean_s": simulated.mean_s if simulated else None,
                    "paper_simulated_sd_s": simulated.sd_s if simulated else None,
                    "paper_physical_mean_s": physical.mean_s if physical else None,
                    "paper_physical_sd_s": physical.sd_s if physical else None,
                    "n": str(ours.runs) if ours else "",
                    "mean_time_s": ours.time.mean_s if ours else None,
                    "sd_time_s": ours.time.sd_s if ours else None,
                    "mean_time_low_s": ours.interval_s[0] if ours else None,
                    "mean_time_high_s": ours.interval_s[1] if ours else None,
                    "mean_time_contact_fails_s": ours.strict.mean_s if ours else None,
                    "sd_time_contact_fails_s": ours.strict.sd_s if ours else None,
                    "mean_time_contact_fails_low_s": (
                        ours.strict_interval_s[0] if ours else None
                    ),
                    "mean_time_contact_fails_high_s": (
                        ours.strict_interval_s[1] if ours else None
                    ),
                    "success": ours.success if ours else None,
                    "contact_free": ours.contact_free if ours else None,
                    "planning_ms_per_tick": ours.planning_ms if ours else None,
                }
            )
        return csv_table(records)

    def _rows(self) -> list[list[str]]:
        """Labels and cells, the first three rows those of the paper's table."""

        def paper(text: Callable[[Published], str]) -> Iterator[str]:
            entries = map(PUBLISHED.get, TITLES)
            return (text(entry) if entry else UNDEFINED for entry in entries)

        def ours(text: Callable[[Measured], str]) -> Iterator[str]:
            measured = map(self.measured.get, TITLES)
            return (text(own) if own else "not run" for own in measured)

        rows = {
            "paper, simulated: time [s]": paper(
                lambda entry: _plus_minus(entry.simulated)
            ),
            "hlsd: time [s]": ours(lambda own: _plus_minus(own.time)),
            "paper, physical robot: time [s] (not simulated here; see course)": paper(
                lambda entry: (
                    _plus_minus(entry.physical) if entry.physical else "all failed"
                )
            ),
            "hlsd: 95 % interval of the mean [s]": ours(
                lambda own: interval_text(*own.interval_s, ".1f") or UNDEFINED
            ),
            STRICT_ROW: ours(lambda own: _plus_minus(own.strict)),
            "hlsd: 95 % interval of that mean [s]": ours(
                lambda own: interval_text(*own.strict_interval_s, ".1f") or UNDEFINED
            ),
            "hlsd: success": ours(lambda own: percent_text(own.success)),
            "hlsd: contact-free": ours(
                lambda own: share_text(own.contact_free, own.drove, own.runs)
            ),
            "hlsd: planning time per tick [ms]": ours(
                lambda own: number_text(own.planning_ms, ".3f")
            ),
        }
        return [[label, *cells] for label, cells in rows.items()]

    def _notes(self) -> list[str]:
        return [
            f"Mean ± sd over all runs, a run that fails counts {self.limit_s:g} s; the "
            "interval is from resampling worlds. The paper's numbers are those of its "
            "table I; its physical course is not simulated, but a course of ours is.",
            "With contact as failure, a run that touches an obstacle counts "
            f"{self.limit_s:g} s, too: our reading of the paper's table, found after "
            "the result.",
            "Not the paper's: "
            f"{'; '.join(f'{name} ({BUILT_IN[name].summary})' for name in BESIDE)}.",
        ]


def table_one(episodes: pd.DataFrame, timing: pd.DataFrame) -> TableOne:
    """The paper's table I from a run.

    Args:
        episodes: From `hlsd.analysis.runs.load_episodes`, of one protocol.
        timing: The run's ``timing.csv``, from `planning_times`.

    Returns:
        Other planners than `TITLES`' are left out, and those of them that were not run
        are left empty.

    Raises:
        HlsdError: None of the paper's planners was run, or times are missing.
    """
    records = {
        record.pop("planner"): record
        for record in summarise(episodes).to_dict("records")
    }
    spent = timing.groupby("planner", sort=False)[["planning_wall_s", "ticks"]].sum()
    ticks = spent["ticks"].where(spent["ticks"] > 0)
    per_tick_ms = 1e3 * spent["planning_wall_s"] / ticks
    measured = {}
    for name in TITLES:
        if name not in records:
            continue
        if name not in spent.index:
            raise HlsdError(
                f"the table of times lacks {name!r}: give the same run's timing.csv"
            )
        row = {key: float(value) for key, value in records[name].items()}
        measured[name] = Measured(
            runs=int(row["n"]),
            drove=int(row["drove"]),
            time=Time(row["mean_time_s"], row["sd_time_s"]),
            interval_s=(row["mean_time_low_s"], row["mean_time_high_s"]),
            strict=Time(
                row["mean_time_contact_fails_s"], row["sd_time_contact_fails_s"]
            ),
            strict_interval_s=(
                row["mean_time_contact_fails_low_s"],
                row["mean_time_contact_fails_high_s"],
            ),
            success=row["success"],
            contact_free=row["contact_free"],
            planning_ms=float(per_tick_ms[name]),
        )
    if not any(name in PUBLISHED for name in measured):
        raise HlsdError(
            f"the run has none of the paper's planners: {', '.join(PUBLISHED)}"
        )
    first = episodes.iloc[0]
    trials = episodes["trial"].nunique()
    setting = (
        f"{first['suite']}, {episodes['world'].nunique()} worlds x {trials} trials, "
        f"protocol {first['protocol']}, robot {first['robot']} "
        f"{first['robot_version']}, seed {first['seed']}"
    )
    limit_s = protocol_of(episodes).limit_s
    return TableOne(setting, limit_s, MappingProxyType(measured))


@dataclass(frozen=True, slots=True)
class Learning:
    """What a policy learned from.

    Attributes:
        preset: The data set, named after its highest speed.
        points: Data points, ``|D_raw|``.
        samples: Of the training set, ``|D_train|``.
        driven_s: Length of the drive in open space [s]; None if it is not at hand.
        training_s: Wall time of hallucination and training [s]; None if it is not
            known.
    """

    preset: str
    points: int
    samples: int
    driven_s: float | None
    training_s: float | None


PUBLISHED_LEARNING = Learning("1.0", 12_585, 12 * 12_585, 505.0, training_s=None)
"""Section IV-A: 12 585 points of 505 s, |D_train| = 12 |D_raw|, training takes less
than three minutes."""


@dataclass(frozen=True, slots=True)
class Dataset:
    """The paper's data set beside ours.

    Attributes:
        learning: By planner.
    """

    learning: Mapping[str, Learning]

    def markdown(self) -> str:
        """The table for people, with its footnote."""
        head = ["", "data", "driven [s]", "points D_raw", "samples D_train"]
        head += ["D_train / D_raw", "training [s]"]
        rows = [_learned("paper, HLSD", PUBLISHED_LEARNING, "< 180")]
        for name, own in self.learning.items():
            training = "-" if own.training_s is None else f"{own.training_s:.0f}"
            rows.append(_learned(f"hlsd: {PUBLISHED[name].title}", own, training))
        notes = [
            "The paper's numbers are those of its section IV-A. hlsd's points are the "
            "first 12 585 ticks of 505 s; it drives on until the last of them has its "
            "future. Training is wall time, hallucination included, on a processor, "
            "torch on one thread; several may have shared the machine."
        ]
        if any(own.training_s is None for own in self.learning.values()):
            notes.append("A dash: not known, as of the policies that ship with hlsd.")
        return markdown_table(head, rows, " ".join(notes))

    def csv(self) -> str:
        """The table for programs: a line per planner, empty = not known."""
        records: dict[str, dict[str, str | int | float | None]] = {
            "paper": asdict(PUBLISHED_LEARNING)
        }
        records |= {name: asdict(own) for name, own in self.learning.items()}
        return _csv(records)


def plot_regression(episodes: pd.DataFrame, path: Path) -> None:
    """Draw the paper's figure: times over worlds that get harder for DWA.

    Worlds are ordered from left to right by DWA's mean time, which is a line; each
    other planner's mean times are dots with a line fitted by linear regression, here
    with its 95 % band.

    Args:
        episodes: From `hlsd.analysis.runs.load_episodes`, of one protocol.
        path: PNG to write.

    Raises:
        HlsdError: DWA was not run.
    """
    names = [name for name in PUBLISHED if (episodes["planner"] == name).any()]
    if "dwa" not in names:
        raise HlsdError("the figure orders worlds by DWA's times: run 'dwa', too")
    known = pd.concat([episodes[episodes["planner"] == name] for name in names])
    titles = {name: PUBLISHED[name].title for name in names}
    figure = draw_orders([times_by_world(known, "dwa")], known, titles)
    save_figure(figure, path)


def _titles() -> list[str]:
    return ["", *TITLES.values()]


def _plus_minus(time: Time) -> str:
    if math.isnan(time.mean_s):
        return UNDEFINED
    return plus_minus(time.mean_s, time.sd_s, ".1f")


def _learned(label: str, learning: Learning, training: str) -> list[str]:
    driven_s = learning.driven_s
    return [
        label,
        learning.preset,
        "-" if driven_s is None else f"{driven_s:.1f}",
        f"{learning.points:,}".replace(",", " "),
        f"{learning.samples:,}".replace(",", " "),
        f"{learning.samples / learning.points:g}",
        training,
    ]


def _csv(records: Mapping[str, Mapping[str, str | int | float | None]]) -> str:
    return csv_table([{"planner": name, **own} for name, own in records.items()])
