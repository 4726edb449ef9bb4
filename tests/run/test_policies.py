"""Which policy a planner may drive from: what the file says of itself decides."""

import json
from dataclasses import replace

import pytest
from typer.testing import CliRunner

import hlsd
from hlsd.cli.app import app
from hlsd.core.errors import HlsdError
from hlsd.learning.policy import Policy, shipped_policy
from hlsd.planners.registry import BUILT_IN, make_planner
from hlsd.run.bench import Bench, resolve
from hlsd.run.protocol import HLSD2021

LEARNED = [name for name, entry in BUILT_IN.items() if entry.needs_policy]
TRAINED = sorted({BUILT_IN[name].trained_as for name in LEARNED})


@pytest.fixture(scope="module")
def policies(tmp_path_factory):
    """Files of the shipped network that say various things of themselves."""
    folder = tmp_path_factory.mktemp("policies")
    shipped = Policy.load(shipped_policy("hlsd10"))
    said = json.loads(shipped.provenance)
    for name, provenance in {
        "own": json.dumps(said | {"seed": 7}),
        "silent": "{}",
        "no-json": "trained by hand",
        "number": json.dumps(said | {"planner": 3}),
        "hostile": json.dumps(said | {"planner": "hlsd10\n\x1b[31m<script>"}),
    }.items():
        replace(shipped, provenance=provenance).save(folder / f"{name}.npz")
    return folder


@pytest.mark.parametrize("trained", TRAINED)
@pytest.mark.parametrize("planner", LEARNED)
def test_a_planner_drives_from_its_own_policy_alone(planner, trained):
    file = shipped_policy(trained)
    bench = Bench((planner,), worlds="0", policies=((planner, file),))
    forced = replace(bench, force_policy=True)
    if BUILT_IN[planner].trained_as == trained:
        make_planner(planner, file)
        assert resolve(forced) == resolve(bench)
        assert resolve(bench).planners == (planner,)
        return
    for ask in (lambda: make_planner(planner, file), lambda: resolve(bench)):
        with pytest.raises(HlsdError, match=f"for planner '{trained}', not") as caught:
            ask()
        assert "\n" not in str(caught.value)
        assert f"'{planner}@{trained}'" in str(caught.value)
    assert resolve(forced).planners == (f"{planner}@{trained}",)
    assert resolve(forced) != resolve(Bench((planner,), worlds="0"))


def test_a_policy_of_ones_own_needs_no_word(policies):
    file = policies / "own.npz"
    bench = Bench(("hlsd10",), worlds="0", policies=(("hlsd10", file),))
    assert resolve(bench).planners == ("hlsd10",)
    with pytest.raises(HlsdError, match="not 'hlsd04'"):
        make_planner("hlsd04", file)


@pytest.mark.parametrize("name", ["silent", "no-json", "number", "hostile"])
def test_a_policy_that_does_not_say_for_whom_is_no_ones(policies, name):
    file = policies / f"{name}.npz"
    with pytest.raises(HlsdError, match="does not say that it was trained") as caught:
        make_planner("hlsd10", file)
    assert str(caught.value).isprintable()
    bench = Bench(
        ("hlsd10",), worlds="0", policies=(("hlsd10", file),), force_policy=True
    )
    assert resolve(bench).planners == ("hlsd10@unknown",)


def test_rows_of_a_forced_policy_name_both(tmp_path):
    file = shipped_policy("hlsd04")
    short = replace(HLSD2021, name="short", limit_s=1.0)
    arguments = {"worlds": "0", "trials": 1, "progress": False, "jobs": 1}
    arguments |= {"protocol": short}
    with pytest.raises(HlsdError, match="force_policy"):
        hlsd.bench("hlsd10", policies={"hlsd10": file}, out=tmp_path / "a", **arguments)
    assert not (tmp_path / "a").exists()
    run = hlsd.bench(
        "hlsd10",
        policies={"hlsd10": file},
        force_policy=True,
        out=tmp_path / "a",
        **arguments,
    )
    assert set(run.episodes["planner"]) == {"hlsd10@hlsd04"}
    config = json.loads((tmp_path / "a" / "run.json").read_text())["config"]
    assert config["planners"] == ["hlsd10@hlsd04"]
    assert "hlsd10@hlsd04" in (tmp_path / "a" / "summary.md").read_text()
    with pytest.raises(HlsdError):  # the folder is of another run
        hlsd.bench("hlsd10", out=tmp_path / "a", **arguments)


def test_force_is_of_policies_that_are_given():
    with pytest.raises(HlsdError, match="force_policy") as caught:
        resolve(Bench(("hlsd10",), worlds="0", force_policy=True))
    assert caught.value.argument == "force_policy"
    with pytest.raises(HlsdError, match="takes no policy"):
        resolve(Bench(("dwa",), policies=(("dwa", shipped_policy("lfh10")),)))
    with pytest.raises(HlsdError, match="force_policy"):
        hlsd.episode("hlsd10", policy=shipped_policy("lfh04"))


def test_the_command_line_says_which_option():
    told = CliRunner().invoke(
        app,
        [
            *("bench", "--planner", "hlsd10", "--worlds", "0"),
            *("--policy", str(shipped_policy("lfh04"))),
        ],
    )
    assert "--force-policy" in str(told.exception)
    assert told.exit_code != 0
