"""Write docs/metrics.md: words from here, the table from the metrics themselves.

Run it after any change to a metric: python scripts/make_metrics_docs.py
"""

from pathlib import Path

from hlsd.analysis.metrics import METRICS, METRICS_VERSION, Metric
from hlsd.run.protocol import PROTOCOLS

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "metrics.md"
REMAKE = "python scripts/make_metrics_docs.py"

_PAGE = f"""\
# Metrics

<!-- Generated; change hlsd/run/built_in_columns.py, hlsd/analysis/metrics.py or the \
script's words, then run: {REMAKE} -->

What every number about a run is: the metrics of version {METRICS_VERSION}, which \
stands in a run's `run.json`. Each is a number per run, defined once: what is measured \
in `hlsd/run/built_in_columns.py`, what follows from rows in \
`hlsd/analysis/metrics.py`. [Statistics](statistics.md) says how runs become a number \
per planner, with an interval. Where a metric is not defined for a run, its cell is \
empty. What was measured of how a robot drove is defined for runs that drove: a \
planner that fails before its first command touches nothing, and that is no merit.

| name | what | unit | better | definition | source |
|---|---|---|---|---|---|
{{table}}

"Neither" means that the number alone does not rank planners: `hlsd compare` \
gives no verdict on it. Poses and speeds are the simulator's true ones at the \
planner's ticks.

## Where they are

`episodes.csv` has a row per run with what was measured, and `timing.csv` the wall \
times, which never repeat: `planning_median_ms`, `planning_p95_ms`, `planning_max_ms`, \
and `overruns`, the number of ticks whose planning took longer than the planner's \
period (the simulated robot waits for them all the same). `time_to_contact_s` is the \
clock's time of the first contact, 0 where the clock started later and empty where \
there was none; `shortest_length_m` is the L of SPL. Runs made by older versions, and \
imported ones, have these columns empty.

## Failures

Every run has a row, whatever happened. `outcome` is `success`, `timeout`, `collision` \
or `error`, and the `reason` of an error begins with its kind. \
`hlsd.analysis.metrics.failure_kind` tells them apart:

| kind | outcome | what happened | reason |
|---|---|---|---|
| `timeout` | `timeout` | the limit passed | |
| `contact` | `collision` | an obstacle was touched, where that ends runs | |
| `exception` | `error` | the planner raised | \
`exception: ValueError: no way (mine.py:12)` |
| `exit` | `error` | the planner asked Python to exit | \
`exit: SystemExit: 3 (mine.py:12)` |
| `crashed` | `error` | the planner ended its process, or something in it did | \
`crashed: the process was ended by SIGSEGV (11)` |
| `out of memory` | `error` | there was not the memory that the planner asked for | \
`out of memory: MemoryError` |
| `bad command` | `error` | `plan` gave no command, or one that is not finite | `bad \
command: nan m/s, 0.3 rad/s is not finite (mine.py:9)` |
| `too slow` | `error` | one call of `plan` took more than 10 s of wall time | `too \
slow: one command took more than 10 s` |
| `hung` | `error` | one call of `plan` did not return within 15 s, or making or \
resetting the planner within 60 s | `hung: a call did not return within 15 s` |
| `unknown` | `error` | a row of an older version, without a kind | |

Why a run timed out or collided is a column of its own, `cause` \
([causes](causes.md)).

Planners that are not built in run in processes of their own, also with `--jobs 1`: \
what a planner does to its process ends its own episode and nothing else. A run that \
crashed, hung or was too slow is driven once more, alone in a new process, and only \
what it comes to then is its row: so neither a pause of the machine nor the memory of \
other workers is the planner's fault. The row of a run that took its process along has \
no ticks. [A program](external.md) that plans takes only itself along: its row keeps \
the ticks before. `tracebacks.txt` has one whole traceback of each fault \
([how to debug a planner](how-to/debug.md)). What planners print goes to \
stderr. A success that touched something (`hlsd2021` lets runs go \
on) is a success that is not `contact_free`.

## Trajectories

`hlsd bench` keeps every run, tick by tick, in `trajectories.zip`: pose to 1 mm and 1 \
mrad, commanded and measured speeds to 0.01 m/s and 0.01 rad/s, local goal to 1 cm, \
mode, contact, and global paths, at most two a second, simplified to 2 cm. The layout \
is written down in `hlsd/run/trajectory.py`. The same seed gives the same bytes, for \
any `--jobs` and after an interruption. `--no-trajectories` does without.

An episode takes 1.3 KB on average (`hlsd10` 1.1 KB, at most 1.9 KB; `dwa` 1.5 KB, at \
most 6.6 KB for one that lasted the full 50 s), about 6 bytes per tick, measured on \
every sixth world:

```sh
hlsd bench --planner hlsd10 --planner dwa --worlds 0:300:6 --trials 1
```
"""


def render() -> str:
    """The page, as it should stand in `PAGE`."""
    return _PAGE.replace("{table}", "\n".join(map(_row, METRICS.values())))


def main() -> None:
    """Write the page."""
    PAGE.write_text(render(), encoding="utf-8")
    print(PAGE.relative_to(ROOT))


def _row(metric: Metric) -> str:
    title = metric.title
    if metric.version > 1:
        title += f" (version {metric.version})"
    definition = metric.definition
    if set(metric.protocols) != set(PROTOCOLS):
        definition += f" Under {' and '.join(metric.protocols)} only."
    cells = (
        f"`{metric.name}`",
        title,
        metric.unit or "–",
        metric.better or "neither",
        definition,
        metric.source,
    )
    return f"| {' | '.join(cell.replace('|', chr(92) + '|') for cell in cells)} |"


if __name__ == "__main__":
    main()
