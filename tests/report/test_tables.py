"""How numbers are printed, and that Python and the command line give one text."""

from typer.testing import CliRunner

from hlsd.analysis.compare import compare_runs
from hlsd.analysis.gate import Status, gate_run, write_baseline
from hlsd.analysis.validate import validate_run
from hlsd.cli.app import app
from hlsd.report.agreement_table import agreement_markdown
from hlsd.report.tables import (
    UNDEFINED,
    interval_text,
    p_text,
    percent_text,
    plus_minus,
    share_text,
    with_interval,
)
from hlsd.report.verdict_tables import comparison_markdown, gate_markdown
from tests.analysis.test_compare import write_run


def printed(*arguments):
    return CliRunner().invoke(app, list(map(str, arguments))).stdout


def test_numbers_are_printed_in_one_way():
    p_values = (0.0, 0.00012, 0.0456, 0.1, 1.0)
    assert [p_text(p) for p in p_values] == [
        "< 0.0001",
        "0.00012",
        "0.046",
        "0.10",
        "1.00",
    ]
    assert (percent_text(0.8333), percent_text(0.95, 0)) == ("83.3 %", "95 %")
    assert interval_text(-1.25, 3.0, "+.1f") == "-1.2 … +3.0"
    assert with_interval("2", interval_text("1", "3")) == "2 (1 … 3)"
    assert with_interval("2", "") == "2"


def test_what_is_not_there_is_a_dash_or_nothing():
    nan = float("nan")
    assert percent_text(nan) == UNDEFINED
    assert interval_text(nan, nan, ".2f") == ""
    assert (plus_minus(9.0, nan), plus_minus(9.0, 0.5)) == ("9.00", "9.00 ± 0.50")
    assert share_text(0.5, 4, 8) == "50.0 % of 4"
    assert share_text(0.5, 8, 8) == "50.0 %"
    assert share_text(nan, 0, 8) == UNDEFINED


def test_commands_print_what_python_gives(tmp_path):
    run = write_run(tmp_path / "run", {"old": 10.0, "new": 9.0})
    metrics = ("time_s", "success")
    options = ("--metric", "time_s", "--metric", "success")
    a, b = f"{run}:new", f"{run}:old"
    compared = compare_runs(a, b, metrics)
    assert comparison_markdown(compared) == printed("compare", a, b, *options)

    base = tmp_path / "base.json"
    assert write_baseline(b, base).planner == "old"
    gated = gate_run(a, base)
    found = [row.status for row in gated.gated]
    assert found == [Status.INCONCLUSIVE, Status.OK], "success on 12 worlds, and time"
    assert gate_markdown(gated) == printed("gate", a, "--baseline", base)

    reference = tmp_path / "reference.csv"
    rows = [f"{w},gazebo,{t},{9 + w + t}" for w in range(12) for t in range(2)]
    reference.write_text("\n".join(["world,planner,trial,time_s", *rows]))
    found = validate_run(run, reference, planner="new")
    assert agreement_markdown(found) == printed(
        "validate", run, "--against", reference, "--planner", "new"
    )
