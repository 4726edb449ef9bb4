"""Make docs/columns.md: what a run's folder holds, column by column.

python scripts/make_columns_docs.py
"""

import dataclasses
from pathlib import Path

from hlsd.data.worlds import load_suite
from hlsd.run.conditions import Conditions
from hlsd.run.field import Field
from hlsd.run.folder import FORMAT
from hlsd.run.protocol import HLSD2021
from hlsd.run.row import COLUMNS, FIELDS, TIMING_COLUMNS
from hlsd.sim.perturbations import Disturbance

ROOT = Path(__file__).resolve().parents[1]
PAGE = ROOT / "docs" / "columns.md"
REMAKE = "python scripts/make_columns_docs.py"

_PAGE = f"""\
# What a run's folder holds

<!-- Generated; change hlsd/run/built_in_columns.py, hlsd/run/conditions.py or the \
script's words, then run: {REMAKE} -->

| file | what it holds |
|---|---|
| `episodes.csv` | a row per episode |
| `timing.csv` | wall times, which never repeat |
| `run.json` | what was run, under which conditions, with which software |
| `trajectories.zip` | every episode, tick by tick \
([metrics](metrics.md#trajectories)) |
| `tracebacks.txt` | each fault of a planner once, with its first traceback ([how to \
debug a planner](how-to/debug.md#what-a-run-keeps)); only where there are some |
| `history.json` | when it was driven, and by which commands; it decides nothing |
| `results.sha256` | digests of the tables and of `run.json`, for `sha256sum -c` |
| `summary.md`, `summary.csv` | the table that `hlsd bench` prints |
| `time_by_world.png` | its plot |

`hlsd.load_run(folder)` reads it in Python ([Python](python.md)).

## `episodes.csv`

An empty cell is a number that is not defined for the run, or is unknown; \
`reason` is empty where there was no error. Columns that an older table lacks are read \
as empty. A package that measures more adds its columns at the end \
([how](how-to/metric.md)).

{{episodes}}

## `timing.csv`

{{timing}}

## `run.json`

`format` is {FORMAT}. `config` holds all that decides the rows: an interrupted run \
goes on where every value is the same, and is refused where one is not, with what \
differs. `versions` holds the versions of the software, and that of the metrics.

| key of `config` | what it holds |
|---|---|
| `planners` | names, in order |
| `policy_sha256` | digest of each planner's policy file, "" where it has none |
| `planner_sha256` | digest of each planner's code, with what it imports of its own \
package or folder; "" for hlsd's own |
| `worlds` | indices, in order |
| `trials` | runs per world and planner |
| `until_decided` | in a run [until it is decided](until-decided.md) alone: metric, \
margin, alpha, and the order of its worlds; beside `config` the same key holds how \
many of them were driven and the verdict, once the run is finished |
| `shard` | in a [shard](scale.md#shards) alone: which it is, as `2/8` |
| `conditions` | what the planners drove under |
| `measured` | version of each column that another package measures |
| `code` | digest of hlsd's code that drives, and of protocols, robots, perturbations \
and metrics of other packages |
| `versions` | of MuJoCo, Numba and NumPy |

`conditions` holds the suite with the digest of its worlds, the whole protocol, the \
robot, the seed and the perturbations:

| key of `conditions` | what it holds |
|---|---|
{{conditions}}

While a run is unfinished, its folder holds `journal.jsonl`, a record with a checksum \
for each finished episode, and a folder `trajectories`. The same command goes on from \
any state of the folder and ends with the same tables; what is damaged is driven \
again, and a line says so. hlsd refuses a finished run whose tables or `run.json` \
were changed since. To read rows that you chose, put your `episodes.csv` into a folder \
of its own.

`history.json` holds `sessions`, of each process that drove episodes when it `began` \
(UTC) and its `command`, "" where hlsd was used from Python, and when the run `ended`. \
A merged run has the sessions of all shards. `results.sha256` leaves it out.

An imported run's `run.json` holds `imported`, where it is from, and `rows`, their \
number.

A run of 0.1.0 holds names in place of `conditions`; its protocol is the one that \
0.1.0 knew by that name.
"""

_CONDITIONS = {
    "suite": "name, version and SHA-256 over all grids and paths",
    "protocol": "every rule: name, version, start and goal, limits, score",
    "robot": "name and version of its parameters",
    "seed": "of starts, noise and perturbations",
    "perturbations": "name and size of each, in order",
}


def render() -> str:
    """The page, as it should stand in `PAGE`."""
    example = _example().as_json()
    assert example.keys() == _CONDITIONS.keys(), "each key of conditions has its words"
    conditions = "\n".join(f"| `{key}` | {text} |" for key, text in _CONDITIONS.items())
    return (
        _PAGE.replace("{episodes}", _table(COLUMNS))
        .replace("{timing}", _table(TIMING_COLUMNS))
        .replace("{conditions}", conditions)
    )


def main() -> None:
    """Write the page."""
    PAGE.write_text(render(), encoding="utf-8")
    print(PAGE.relative_to(ROOT))


def _table(names: tuple[str, ...]) -> str:
    head = ["| column | unit | what it holds |", "|---|---|---|"]
    return "\n".join([*head, *(_row(FIELDS[name]) for name in names)])


def _row(field: Field) -> str:
    meaning = field.meaning.replace("|", "\\|")
    return f"| `{field.name}` | {field.unit} | {meaning} |"


def _example() -> Conditions:
    suite = load_suite("barn300")
    held = Conditions(suite.name, suite.version, "", HLSD2021, "jackal", "1.0", seed=0)
    return dataclasses.replace(held, perturbations=(Disturbance("lidar.dropout", 0.2),))


if __name__ == "__main__":
    main()
