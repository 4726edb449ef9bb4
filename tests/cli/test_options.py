"""Errors of the library name arguments; on the command line they name options."""

import pytest
from typer.testing import CliRunner

from hlsd.cli.app import app
from hlsd.cli.options import of_options
from hlsd.core.errors import HlsdError, require_at_least


@pytest.mark.parametrize(
    ("argument", "text", "said"),
    [
        ("jobs", "jobs is 0: at least 1", "--jobs is 0: at least 1"),
        ("suite_seed", "suite_seed is -1", "--suite-seed is -1"),
        ("planners", "planners is empty", "--planner is empty"),
        ("out", "choose another `out`", "choose another --out"),
        ("out", "'/tmp/out' is there: give `out`.", "'/tmp/out' is there: give --out."),
        ("out", "'out' without a stamp, run out/x", "'out' without a stamp, run out/x"),
        (None, "jobs is 0", "jobs is 0"),
        ("out", "give `out`, or `discard`", "give --out, or --discard"),
        (
            "reference_protocol",
            "with `reference_protocol`, or with `other_course`",
            "with --reference-protocol, or with --other-course",
        ),
    ],
)
def test_an_argument_becomes_its_option(argument, text, said):
    assert of_options(HlsdError(text, argument=argument)) == said


@pytest.mark.parametrize(
    ("least", "value", "text"),
    [
        (1, 0, "trials is 0: at least 1 is needed"),
        (0, -1, "trials is -1: 0 or more is needed"),
    ],
)
def test_a_number_that_is_too_low_is_said(least, value, text):
    require_at_least(least, "trials", value + 1)
    with pytest.raises(HlsdError) as refused:
        require_at_least(least, "trials", value)
    assert (str(refused.value), refused.value.argument) == (text, "trials")


def test_commands_speak_of_options(tmp_path):
    out = str(tmp_path / "all")
    for command in ("reproduce", "ablate"):
        result = CliRunner().invoke(app, [command, "--out", out, "--jobs", "0"])
        assert str(result.exception) == "--jobs is 0: at least 1 is needed"
    (tmp_path / "all").mkdir()
    (tmp_path / "all" / "ablations.md").write_text("mine")
    result = CliRunner().invoke(app, ["ablate", "--out", out])
    assert str(result.exception).endswith("came from: choose another --out")
