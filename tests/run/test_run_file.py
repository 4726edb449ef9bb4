"""A whole run in a file: what it may hold, and what is refused."""

import inspect
import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

import hlsd
from hlsd.cli.app import app
from hlsd.core.errors import HlsdError
from hlsd.run.run_file import SCHEMA, load_config
from tests.cli.ready import ready

ROOT = Path(__file__).resolve().parents[2]
MINE = """
import math
from gains import GAIN
from hlsd import Command

class Mine:
    period_s = 0.05

    def __init__(self, speed: float = 0.5):
        self.speed = speed

    def reset(self, setup):
        pass

    def plan(self, observation):
        x, y = observation.local_goal_in_base
        return Command(self.speed, GAIN * math.atan2(y, x))
"""
RUN = """
planners = [
    "slow=old/mine.py:Mine(speed=0.4)",
    {reference = "new/mine.py:Mine", name = "new", options = {speed = 0.7}},
    "pursuit(max_speed=0.8)",
]
suite = "barn300"
worlds = [0, 30]
trials = 1
jobs = 1
out = "results"

[perturbations]
lidar.dropout = 0.1
"command.latency" = 0.05
"""


@pytest.fixture
def folder(tmp_path):
    for name, gain in (("old", 2.0), ("new", 2.5)):
        (tmp_path / name).mkdir()
        (tmp_path / name / "mine.py").write_text(MINE)
        (tmp_path / name / "gains.py").write_text(f"GAIN = {gain}\n")
    (tmp_path / "run.toml").write_text(RUN)
    return tmp_path


def write(folder, text):
    (folder / "run.toml").write_text(text)
    return folder / "run.toml"


def test_it_holds_what_bench_takes_and_paths_are_relative_to_it(folder):
    (folder / "worlds").mkdir()
    held = load_config(write(folder, RUN.replace('"barn300"', '"worlds"')))
    planners = held.pop("planners")
    assert [held.name for held in planners] == ["slow", "new", "pursuit(max_speed=0.8)"]
    assert planners[0].reference == f"{folder}/old/mine.py:Mine"
    assert planners[1].options == (("speed", 0.7),)
    assert held == {
        "suite": str(folder / "worlds"),
        "worlds": [0, 30],
        "trials": 1,
        "jobs": 1,
        "out": folder / "results",
        "perturbations": {"lidar.dropout": 0.1, "command.latency": 0.05},
    }
    held = load_config(
        write(
            folder,
            'planners = [{reference="hlsd10", policy="p.npz", name="x"}]\n'
            'protocol = "rules.py:MINE"\nrobot = "jackal"\nperturbations = "cold"\n'
            'worlds = "0:9"\nforce_policy = true',
        )
    )
    assert held["policies"] == {"x": folder / "p.npz"}
    assert held["protocol"] == f"{folder}/rules.py:MINE"
    assert (held["robot"], held["perturbations"]) == ("jackal", "cold")


def test_every_argument_of_bench_but_a_few_has_a_key():
    arguments = set(inspect.signature(hlsd.bench).parameters)
    assert arguments - {"policies", "discard", "progress"} == set(SCHEMA["properties"])


WRONG = [
    ("trails = 3", "unknown key 'trails': did you mean 'trials'? known are planners,"),
    ('trials = "3"', "trials is '3', but should be a whole number, 1 or more"),
    ("trials = 0", "trials is 0, but should be a whole number, 1 or more"),
    ("trials = true", "trials is True, but should be a whole number"),
    ("seed = -1", "seed is -1, but should be a whole number, 0 or more"),
    ('worlds = ["0"]', "worlds[0] is '0', but should be a whole number"),
    ("worlds = 0.5", "worlds is 0.5, but should be a text or a whole number or a list"),
    ("trajectories = 1", "trajectories is 1, but should be true or false"),
    ('executor = "slurm"', "executor is 'slurm', but should be 'processes' or 'ray'"),
    ("planners = [3]", "planners[0] is 3, but should be a text or a table"),
    ('planners = [{name = "x"}]', "planners[0] lacks the key 'reference'"),
    (
        'planners = [{reference = "dwa", option = {}}]',
        "unknown key 'planners[0].option': did you mean 'options'?",
    ),
    ('planners = ["dwa(speed"]', "its brackets or quotes do not close"),
    (
        "[perturbations]\nlidar.bias = 'x'",
        "perturbations.lidar.bias is 'x', but should",
    ),
    ("planners = [", "run.toml is not a configuration of a run: "),
]


@pytest.mark.parametrize(("text", "says"), WRONG)
def test_what_is_wrong_is_told_with_key_value_and_what_would_do(text, says, tmp_path):
    with pytest.raises(HlsdError) as refused:
        load_config(write(tmp_path, text))
    assert says in str(refused.value)
    assert "run.toml" in str(refused.value) or "planner" in str(refused.value)


def test_no_file_is_told_so(tmp_path):
    with pytest.raises(HlsdError, match=r"there is no configuration of a run .*none"):
        load_config(tmp_path / "none.toml")


def test_the_schema_is_one_and_says_the_same(tmp_path):
    jsonschema = pytest.importorskip("jsonschema")
    import tomllib

    out = tmp_path / "schema.json"
    printed = CliRunner().invoke(app, ["schema"])
    assert CliRunner().invoke(app, ["schema", "--out", str(out)]).exit_code == 0
    assert json.loads(printed.output) == json.loads(out.read_text()) == SCHEMA
    refused = CliRunner().invoke(app, ["schema", "--out", str(out)])
    assert "nothing is overwritten" in str(refused.exception)
    validator = jsonschema.Draft202012Validator(SCHEMA)
    validator.check_schema(SCHEMA)
    assert validator.is_valid(tomllib.loads(RUN))
    for text, _ in WRONG[:12]:
        assert not validator.is_valid(tomllib.loads(text)), text


def command(*words, cwd):
    return ready("bench", *words, cwd=cwd, timeout=200, PYTHONPATH=str(ROOT))


def test_two_versions_of_one_file_drive_and_options_go_before_the_file(folder):
    """From another folder, in workers; the same run as from Python."""
    away = folder / "away"
    away.mkdir()
    done = command("--config", "../run.toml", "--worlds", "0", "--jobs", "2", cwd=away)
    assert done.returncode == 0, done.stderr
    run = hlsd.load_run(folder / "results")
    assert run.planners == ["slow", "new", "pursuit(max_speed=0.8)"]
    assert run.worlds == [0]
    assert set(run.episodes["outcome"]) == {"success"}, done.stdout
    assert not run.episodes["time_s"].duplicated().any()
    config = json.loads((run.path / "run.json").read_text())["config"]
    assert config["references"] == {
        "slow": "mine:Mine(speed=0.4)",
        "new": "mine:Mine(speed=0.7)",
    }
    assert str(folder) not in (run.path / "run.json").read_text()
    settings = load_config(folder / "run.toml") | {"worlds": 0, "out": folder / "again"}
    again = hlsd.bench(**settings, progress=False)
    same = [path.path / "trajectories.zip" for path in (run, again)]
    assert same[0].read_bytes() == same[1].read_bytes()


def invoke(*words):
    return str(CliRunner().invoke(app, ["bench", *map(str, words)]).exception)


def test_planners_of_the_command_line_replace_the_file_s(folder, monkeypatch):
    given = []
    monkeypatch.setattr(hlsd, "bench", lambda **held: given.append(held) or 1 / 0)
    config = write(
        folder,
        'planners = [{reference="hlsd10", policy="p.npz"}]\ntrials = 2\nseed = 4\n'
        "trajectories = false\nperturbations = 'cold'\nforce_policy = true\n",
    )
    invoke("--config", config)
    invoke("--config", config, "--planner", "dwa", "--seed", "0", "--trajectories")
    invoke("--config", config, "--planner-arg", "max_speed=0.4")
    invoke("--config", config, "--perturb", "lidar.bias=0.1", "--policy", "q.npz")
    first, second, third, fourth = given
    assert (first["trials"], first["seed"], first["trajectories"]) == (2, 4, False)
    assert (first["suite"], first["robot"]) == ("barn300", "jackal")
    assert first["policies"] == {"hlsd10": folder / "p.npz"}
    assert (second["seed"], second["trajectories"], second["policies"]) == (0, True, {})
    assert [held.name for held in second["planners"]] == ["dwa"]
    assert third["policies"] == {"hlsd10(max_speed=0.4)": folder / "p.npz"}
    assert fourth["perturbations"] == ["lidar.bias=0.1"]
    assert fourth["policies"] == {"hlsd10": Path("q.npz")}
    assert fourth["force_policy"]


def test_the_command_line_refuses_in_a_line(folder):
    for words, says in (
        ((), "no planner is named: give --planner, or planners in a file (--config)"),
        (("--planner", "dwa", "--planner-arg", "max_sped=1"), "did you mean 'max_sp"),
        (("--planner", "dwa", "--planner-arg", "0.8"), "--planner-arg: option '0.8'"),
        (
            ("--planner", "dwa", "--planner", "x=dwa", "--planner-arg", "speeds=5"),
            "give each its own, --planner 'dwa(speeds=5)'",
        ),
        (("--planner", "dwa", "--planner", "dwa"), "another name, e.g. other=dwa"),
        (
            ("--planner", f"{folder}/old/mine.py:Mine(speed=fast)"),
            "option 'speed' is fast, but should be a number: its signature is Mine(",
        ),
        (
            ("--planner", f"{folder}/old/mine.py:Mine", "--planner", "mine:Mine"),
            "planner 'mine:Mine' is named twice",
        ),
    ):
        assert says in invoke(*words, "--worlds", "0", "--out", folder / "out")
    assert not (folder / "out").exists()
