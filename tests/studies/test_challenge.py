"""A submission's rehearsal: the Challenge's score, its traps, and the command."""

import functools
import json
import math
from dataclasses import replace

import numpy as np
import pytest
from typer.testing import CliRunner

import hlsd.run.work as work_module
from hlsd.analysis.challenge import import_runs
from hlsd.analysis.published_scores import PUBLISHED_SCORES, scores_of_clip
from hlsd.analysis.rehearsal import SKIPPED_WORLDS, TEST_WORLDS, YEARS, rehearse
from hlsd.cli.app import app
from hlsd.core.errors import HlsdError
from hlsd.core.executor import Serial
from hlsd.data.worlds import load_suite
from hlsd.report.rehearsal_table import rehearsal_markdown
from hlsd.run.outcome import Outcome
from hlsd.run.protocol import get_protocol
from hlsd.studies.challenge import challenge, with_out_txt
from tests.analysis.test_challenge import EPISODE
from tests.cli.test_cli import assert_refused, hlsd

TRIALS = 10


def runs(protocol="barn2024"):
    """A whole evaluation: world, success, collided, timeout, time.

    The first seven worlds are driven fast, the others slower; each world's second run
    touches, its third one times out.
    """
    found = []
    for world in TEST_WORLDS:
        optimal_s = length_m(protocol, world) / 2
        for trial in range(TRIALS):
            time_s = optimal_s * (1.5 if world in SKIPPED_WORLDS else 3.0)
            outcome = {1: (0, 1, 0), 2: (0, 0, 1)}.get(trial, (1, 0, 0))
            held = {1: 4.0, 2: 100.0}.get(trial, time_s)
            found.append((world, *outcome, held))
    return found


@functools.cache
def length_m(protocol, world):
    return get_protocol(protocol).official_length_m(load_suite("barn300")[world])


def imported(folder, lines, protocol="barn2024"):
    text, low = "", 2 if protocol == "barn2024" else 4
    for world, success, collided, timeout, time_s in lines:
        best = length_m(protocol, world) / 2
        score = success * best / min(max(time_s, low * best), 8 * best)
        text += f"{world} {success} {collided} {timeout} {time_s:.4f} {score:.4f}\n"
    file = folder / "gazebo.txt"
    file.write_text(text, encoding="utf-8")
    import_runs(file, "mine", protocol, "barn300", folder / "run")
    return folder / "run"


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    return imported(tmp_path_factory.mktemp("whole"), runs())


def test_the_score_and_every_trap_by_hand(whole):
    found = rehearse(whole)
    assert (found.worlds, found.runs, found.missing) == (50, 500, "")
    assert (found.protocol, found.clip) == ("barn2024", "2-8")
    # 8 of 10 reach the goal: at 1.5 OT, clipped to 2 OT, or at 3 OT.
    fast, slow = 0.8 / 2, 0.8 / 3
    official = (7 * fast + 43 * slow) / 50
    assert found.score.value == pytest.approx(official, abs=1e-6)
    assert found.score.low < official < found.score.high
    assert found.success.value == pytest.approx(0.8)
    assert found.collision.value == pytest.approx(0.1)
    assert found.timeout.value == pytest.approx(0.1)
    traps = {trap.name: trap for trap in found.traps}
    assert traps["worlds"].score.value == pytest.approx(slow, abs=1e-6)
    assert traps["clip"].score.value == pytest.approx(0.8 / 4, abs=1e-6)
    assert traps["sign"].score.value == pytest.approx(0.8 / 8, abs=1e-6)
    for trap in found.traps:
        assert trap.change == pytest.approx(trap.score.value - found.score.value)


def test_the_loop_leaves_out_the_first_seven_of_fifty():
    assert tuple(6 * i for i in range(50) if i not in range(7, 50)) == SKIPPED_WORLDS
    assert len(TEST_WORLDS) - len(SKIPPED_WORLDS) == 43


def test_the_rules_of_2022_have_the_other_clip(tmp_path):
    some = [run for run in runs("barn2022") if run[0] < 84]
    found = rehearse(imported(tmp_path, some, "barn2022"))
    assert (found.protocol, found.clip) == ("barn2022", "4-8")
    assert found.score.value == pytest.approx(0.2, abs=1e-6)
    traps = {trap.name: trap.score.value for trap in found.traps}
    assert traps["clip"] == pytest.approx((0.4 + 0.8 / 3) / 2, abs=1e-6)
    assert {get_protocol(name).score.lowest for name in YEARS.values()} == {4, 2}


def test_intervals_are_clustered_by_world(whole, tmp_path):
    """Runs of one world alike make a wider interval than the same runs mixed."""
    lines = [run for run in runs() if run[0] < 72]
    alike = [
        (world, int(world % 12 == 0), int(world % 12 != 0), 0, time_s)
        for world, *_, time_s in lines
    ]
    mixed = [
        (world, trial % 2, 1 - trial % 2, 0, time_s)
        for (world, *_, time_s), trial in zip(lines, list(range(10)) * 12, strict=True)
    ]
    widths = []
    for name, held in (("alike", alike), ("mixed", mixed)):
        (tmp_path / name).mkdir()
        found = rehearse(imported(tmp_path / name, held))
        assert found.success.value == pytest.approx(0.5)
        widths.append(found.success.high - found.success.low)
    assert widths[0] > 2 * widths[1]


def test_what_is_no_whole_evaluation_says_so(tmp_path):
    some = [run for run in runs() if run[0] in (0, 42)]
    found = rehearse(imported(tmp_path, some))
    assert found.missing == "2 of the 50 test worlds"
    assert "not a whole evaluation: it has 2 of the 50" in rehearsal_markdown(found)
    (tmp_path / "few").mkdir()
    few = runs()[::TRIALS]
    assert rehearse(imported(tmp_path / "few", few)).missing.startswith("1 run a")


def test_runs_of_other_rules_or_worlds_are_refused(tmp_path):
    some = [(7, 1, 0, 0, 9.0)]
    with pytest.raises(HlsdError, match="none of the test worlds 0, 6"):
        rehearse(imported(tmp_path, some))
    with pytest.raises(HlsdError, match="`year` is 2021: known are the rules of 2022"):
        challenge("pursuit", year=2021, out=tmp_path / "no", progress=False)
    with pytest.raises(HlsdError, match="world 1, which is none of the test"):
        challenge("pursuit", worlds="0,1", out=tmp_path / "no", progress=False)
    assert not (tmp_path / "no").exists()


def test_published_scores_are_scores():
    """The figures that others ask for, each by its clip, the best first."""
    for held in PUBLISHED_SCORES:
        for score, best in ((held.score_4_8, 0.25), (held.score_2_8, 0.5)):
            assert math.isnan(score) or 0 < score <= best
        assert held.source
    of_2 = {held.name: score for held, score in scores_of_clip(2)}
    assert of_2["LfLH"] == 0.4354
    assert of_2["LiCS-KI"] == 0.4762
    assert next(iter(of_2.values())) == max(of_2.values()) == 0.4975
    assert {score for _, score in scores_of_clip(4)} >= {0.158, 0.2339}


def test_a_call_that_is_done_drives_nothing(tmp_path, monkeypatch):
    """And one that stopped goes on; other settings need another folder."""
    driven = []

    def drive(course, planner, seed, trial):
        driven.append((course.world.index, trial))
        if len(driven) == 3:
            raise KeyboardInterrupt
        return replace(EPISODE, outcome=Outcome.SUCCESS, time_s=20.0)

    monkeypatch.setattr(work_module, "run_episode", drive)
    settings = {
        "worlds": "0,42",
        "trials": 2,
        "jobs": Serial(),
        "out": tmp_path / "run",
        "progress": False,
    }
    with pytest.raises(KeyboardInterrupt):
        challenge("pursuit", **settings)
    assert not (tmp_path / "run" / "out.txt").exists()
    found = challenge("pursuit", **settings)
    assert sorted(set(driven)) == [(0, 0), (0, 1), (42, 0), (42, 1)]
    count = len(driven)
    assert (found.runs, found.out_txt) == (4, tmp_path / "run" / "out.txt")
    assert len(found.out_txt.read_text(encoding="utf-8").splitlines()) == 4
    again = challenge("pursuit", **settings)
    assert len(driven) == count
    assert again == found
    with pytest.raises(HlsdError, match="already holds a finished run"):
        challenge("pursuit", **{**settings, "seed": 1})
    found.out_txt.write_text("mine\n", encoding="utf-8")
    with pytest.raises(HlsdError, match="exists already"):
        with_out_txt(tmp_path / "run")
    assert found.out_txt.read_text(encoding="utf-8") == "mine\n"


def test_a_run_without_a_name_finds_its_own_folder(tmp_path, monkeypatch):
    """The same settings the same one, others the next."""
    monkeypatch.chdir(tmp_path)
    drives = lambda *_: replace(EPISODE, outcome=Outcome.SUCCESS, time_s=20.0)  # noqa: E731
    monkeypatch.setattr(work_module, "run_episode", drives)
    settings = {"worlds": "42", "trials": 1, "jobs": Serial(), "progress": False}
    places = [
        challenge("pursuit", seed=seed, **settings).path.name for seed in (0, 1, 0, 1)
    ]
    assert places == 2 * ["challenge-pursuit-barn2024", "challenge-pursuit-barn2024-2"]


def test_the_command_as_a_team_runs_it(tmp_path, monkeypatch):
    """A planner under a name; JSON, and the run scored again; what is refused."""
    monkeypatch.chdir(tmp_path)
    command = ("challenge", "--planner", "mine=pursuit", "--jobs", "1")
    look = ("--worlds", "0,42", "--trials", "1", "--out", "run", "--no-trajectories")

    def call(*arguments):
        return CliRunner().invoke(app, arguments)

    done = call(*command, *look, "--json")
    assert done.exit_code == 0, done.exception
    told = json.loads(done.stdout)
    assert (told["results"], told["runs"], told["clip"]) == ("run", 2, "2-8")
    assert told["planner"] == "mine"
    assert told["published"][0]["score"] == 0.4975
    assert [trap["name"] for trap in told["traps"]] == ["worlds", "clip", "sign"]
    lines = (tmp_path / "run" / "out.txt").read_text(encoding="utf-8").splitlines()
    assert [line.split()[0] for line in lines] == ["0", "42"]
    mean = np.mean([float(line.split()[-1]) for line in lines])
    assert told["score"]["value"] == pytest.approx(mean, abs=1e-4)
    again = call("challenge", "--run", "run:mine")
    assert again.exit_code == 0, again.exception
    for fragment in (
        "predicted official score | ",
        "not a whole evaluation: it has 2 of the 50 test worlds",
        "| LiCS-KI | 2024 | 0.4762 | hidden |",
        "leaves out worlds 0, 6, 12, 18, 24, 30, 36",
        "result file: run/out.txt",
    ):
        assert fragment in again.stdout
    assert_refused(hlsd("challenge", cwd=tmp_path), "--planner", "--run")
    refused = call(*command, "--year", "2021").exception
    assert isinstance(refused, HlsdError)
    assert str(refused) == "--year is 2021: known are the rules of 2022 to 2026"
