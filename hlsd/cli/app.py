"""The command line: one short function per command, each a client of one stage.

Heavy modules are imported inside the commands, so that ``hlsd --help`` answers at once.
"""

import contextlib
import errno
import os
import signal
import sys
import traceback
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, NoReturn

import typer

from hlsd.cli.challenge import challenge
from hlsd.cli.check import check
from hlsd.cli.checkpoints import convert_checkpoint
from hlsd.cli.compare import baseline, compare, gate
from hlsd.cli.debug import debug
from hlsd.cli.doctor import doctor, show_version
from hlsd.cli.experiments import ablate, sweep
from hlsd.cli.listing import list_, planners
from hlsd.cli.options import (
    AddressOption,
    Commands,
    ExecutorOption,
    ForcePolicyOption,
    JobsOption,
    MaybePlannersOption,
    PerturbOption,
    PlannerArgOption,
    PolicyOption,
    ProtocolOption,
    RobotOption,
    SeedOption,
    SuiteOption,
    TrialsOption,
    WorldsOption,
    resumable,
)
from hlsd.cli.output import (
    JsonOption,
    answer,
    answer_run,
    note_first_time,
    records,
    show,
)
from hlsd.cli.policies import export_policy
from hlsd.cli.results import export, import_, merge, report, validate
from hlsd.cli.robots import app as robots_app
from hlsd.cli.run_files import ConfigOption, schema, settings_of
from hlsd.cli.seeing import demo, video, watch
from hlsd.cli.until_decided import (
    AlphaOption,
    BenchMarginOption,
    BenchMetricOption,
    BenchUntilOption,
    decided_run,
)
from hlsd.cli.view import view
from hlsd.cli.worlds import app as worlds_app
from hlsd.core.command import note_command
from hlsd.core.errors import ForeignError, HlsdError
from hlsd.core.importing import working_directory_last
from hlsd.core.process import settle

app = typer.Typer(
    name="hlsd",
    cls=Commands,
    no_args_is_help=True,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)
app.add_typer(worlds_app, name="worlds")
app.add_typer(robots_app, name="robots")


@app.callback()
def hlsd(
    version: Annotated[
        bool,
        typer.Option(
            "--version",
            callback=show_version,
            is_eager=True,
            help="Print the version and exit.",
        ),
    ] = False,
) -> None:
    """Benchmark local robot-navigation planners on 300 BARN worlds in MuJoCo."""


# A command has as many arguments as it has options; these are read from the context.
@app.command()
def bench(
    context: typer.Context,
    planner: MaybePlannersOption = None,
    planner_arg: PlannerArgOption = None,
    config: ConfigOption = None,
    suite: SuiteOption = "barn300",
    worlds: WorldsOption = None,
    trials: TrialsOption = 3,
    protocol: ProtocolOption = None,
    robot: RobotOption = "jackal",
    policy: PolicyOption = None,
    force_policy: ForcePolicyOption = False,
    jobs: JobsOption = None,
    executor: ExecutorOption = "processes",
    address: AddressOption = None,
    seed: SeedOption = 0,
    perturb: PerturbOption = None,
    shard: Annotated[
        str | None,
        typer.Option(
            metavar="I/N",
            help="Drive the I-th of N parts, from 1/N to N/N, for machines that share "
            "a run; `hlsd merge` joins them. All if left out.",
        ),
    ] = None,
    until_decided: BenchUntilOption = False,
    metric: BenchMetricOption = None,
    margin: BenchMarginOption = None,
    alpha: AlphaOption = None,
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder for the results; a free one under runs/ if left out."
        ),
    ] = None,
    trajectories: Annotated[
        bool,
        typer.Option(
            "--trajectories/--no-trajectories",
            help="Keep every episode, tick by tick, or tables only, which leave "
            "`hlsd report` without replays.",
        ),
    ] = True,
    discard: Annotated[
        bool,
        typer.Option(
            "--discard",
            help="Begin anew where an unfinished run is in the way: throw that away.",
        ),
    ] = False,
    quick: Annotated[
        bool,
        typer.Option(
            "--quick",
            help="A first look: 12 worlds spread over the suite, 1 trial, hlsd10 if no "
            "planner is named. --worlds, --trials, --planner go before it.",
        ),
    ] = False,
    as_json: JsonOption = False,
) -> None:
    """Run planners on a suite; rows, table and plot go to a folder.

    A file (--config) may hold all of it; what is given here goes before. After an
    interruption, the same command goes on where it stopped.
    """
    import hlsd
    from hlsd.report.debugging import debug_commands

    note_first_time()
    settings = settings_of(context, config)
    with resumable():
        run = hlsd.bench(**settings)
    notes = debug_commands(run.episodes, settings, run.path)
    answer_run(as_json, run, notes, decided_run(run, settings))


@app.command()
def collect(
    out: Annotated[Path, typer.Option(help="Motion log to write (npz).")],
    preset: Annotated[
        str, typer.Option(help="1.0: varying speed up to 1 m/s; 0.4: mostly 0.4 m/s.")
    ] = "1.0",
    law: Annotated[
        str,
        typer.Option(
            help="Law of the random commands: matched to recorded driving, or the "
            "paper's words taken literally, uniform, which drives badly."
        ),
    ] = "matched",
    robot: RobotOption = "jackal",
    seed: SeedOption = 0,
    as_json: JsonOption = False,
) -> None:
    """Drive at random in open space for 505 s and record commands and poses."""
    from hlsd.core.progress import StageProgress
    from hlsd.learning.collect import collect as run_collect
    from hlsd.sim.robots import get_robot

    _refuse_existing(out)
    with StageProgress() as progress:
        log = run_collect(preset, law, seed, get_robot(robot), progress.update)
    log.save(out)
    count, rate_hz = len(log.commands), 1 / log.period_s
    answer(
        as_json,
        {"out": out, "commands": count, "rate_hz": rate_hz, "points": log.points},
        f"{count} commands at {rate_hz:g} Hz, {log.points} training points: {out}",
    )


@app.command()
def train(
    planner: Annotated[str, typer.Option(help="hlsd04, hlsd10, lfh04 or lfh10.")],
    data: Annotated[Path, typer.Option(help="Motion log from `hlsd collect`.")],
    out: Annotated[Path, typer.Option(help="Policy file to write (npz).")],
    seed: SeedOption = 0,
    empty_above_speed: Annotated[
        float | None,
        typer.Option(
            help="Speed above which a data point also gets an empty scan [m/s]; 0.8 "
            "for hlsd10 and 0.32 for hlsd04 if left out."
        ),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Hallucinate obstacles around a motion log and train a policy (needs torch)."""
    from hlsd.core.progress import StageProgress
    from hlsd.data.motion_log import MotionLog
    from hlsd.learning.training import train as run_train

    _refuse_existing(out)
    log = MotionLog.load(data)
    with StageProgress() as progress:
        policy = run_train(planner, log, seed, progress.update, empty_above_speed)
    policy.save(out)
    answer(as_json, {"out": out, "planner": planner}, f"policy for {planner}: {out}")


@app.command()
def reproduce(
    quick: Annotated[
        bool,
        typer.Option(
            "--quick", help="With the shipped policies, on every sixth world."
        ),
    ] = False,
    suite: Annotated[
        str, typer.Option(help="Suite: a name, or a folder of published BARN data.")
    ] = "barn300",
    out: Annotated[
        Path | None,
        typer.Option(
            help="Folder for all of it; runs/reproduce-SUITE, or "
            "runs/reproduce-quick-SUITE, if left out."
        ),
    ] = None,
    jobs: Annotated[
        int | None, typer.Option(help="Worker processes; all cores if left out.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Repeat the paper: collect, train, run its planners, make tables and figure.

    What is there already from the same inputs is not done again, so that the same
    command goes on after an interruption.
    """
    from hlsd.core.machine import cores
    from hlsd.core.progress import WholeProgress
    from hlsd.studies.reproduce import TABLES, default_folder
    from hlsd.studies.reproduce import reproduce as run_reproduce

    folder = default_folder(quick, suite) if out is None else out
    with resumable(), WholeProgress() as progress:
        done = run_reproduce(
            folder, quick, suite, jobs=cores(jobs), progress=progress.update
        )
    if as_json:
        paper = done.figure.parent
        tables = {name: records(paper / f"{name}.csv") for name in TABLES}
        answer(True, {"results": folder, "figure": done.figure, **tables})
        return
    for text in (done.table, done.behaviour, done.dataset, done.course):
        show(text)
    typer.echo(f"figure: {done.figure}\nresults: {folder}")


app.command()(planners)
app.command("list")(list_)
app.command()(check)
app.command()(debug)
app.command()(doctor)
app.command()(export_policy)
app.command()(convert_checkpoint)
app.command()(schema)
app.command()(ablate)
app.command()(sweep)
app.command()(challenge)
app.command()(merge)
app.command()(video)
app.command()(watch)
app.command()(demo)
app.command()(report)
app.command()(view)
app.command()(compare)
app.command()(gate)
app.command()(baseline)
app.command()(validate)
app.command()(export)
app.command("import")(import_)


def main() -> None:
    """Run the command line.

    Bad input is one line on stderr and exit code 2. An error of hlsd itself is told
    whole, with one line that says so, and exit code 70.
    """
    settle()
    note_command(sys.argv[1:])
    # Modules of one's own are imported from here, after all that is installed.
    working_directory_last()
    try:
        with _interrupted_by_signals():
            app(standalone_mode=True)
    except HlsdError as error:
        if isinstance(error, ForeignError):
            print(error.trace, end="", file=sys.stderr)
        print(f"hlsd: {error}", file=sys.stderr)
        sys.exit(2)
    except BrokenPipeError:
        _drop_output()
        sys.exit(0)
    except OSError as error:
        if error.filename is not None or error.errno not in _NO_ROOM:
            _own_fault()
        _drop_output()
        print(f"hlsd: cannot write the output: {error.strerror}", file=sys.stderr)
        sys.exit(2)
    except Exception:
        _own_fault()


def _own_fault() -> NoReturn:
    traceback.print_exc()
    print(
        "hlsd: this is an error of hlsd itself, not of what it was given: please "
        "report it with the lines above",
        file=sys.stderr,
    )
    sys.exit(_OWN_ERROR)


_OWN_ERROR = 70
"""Exit code for an error of hlsd itself: EX_SOFTWARE of sysexits.h."""


@contextlib.contextmanager
def _interrupted_by_signals() -> Iterator[None]:
    """Within, SIGTERM and SIGHUP end a command as Ctrl-C does, with a code of theirs.

    A second one ends it at once, and one that is ignored stays so (`nohup`).
    """
    caught: list[int] = []

    def stop(number: int, _frame: object) -> None:
        signal.signal(number, signal.SIG_DFL)
        caught.append(number)
        raise KeyboardInterrupt

    for name in ("SIGTERM", "SIGHUP"):
        number = getattr(signal, name, None)
        if number is not None and signal.getsignal(number) == signal.SIG_DFL:
            signal.signal(number, stop)
    try:
        yield
    finally:
        if caught:
            sys.exit(128 + caught[0])


_NO_ROOM = (errno.ENOSPC, errno.EDQUOT, errno.EIO)


def _drop_output() -> None:
    """What is still to be written goes nowhere, so that Python does not try again."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def _refuse_existing(out: Path) -> None:
    if out.exists():
        raise HlsdError(f"{str(out)!r} exists: nothing is overwritten, name a new file")
    if not out.parent.is_dir():
        raise HlsdError(f"folder {str(out.parent)!r} does not exist: make it first")
