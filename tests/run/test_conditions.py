"""What a run was driven under: written whole, read back, compared; old runs too."""

import dataclasses
import json

import pandas as pd
import pytest

from hlsd.analysis.runs import join_runs, load_episodes, load_run, protocol_of, times_s
from hlsd.core.errors import HlsdError
from hlsd.report.summary import setting
from hlsd.run.conditions import Conditions, first_protocol
from hlsd.run.folder import recorded_conditions, write_imported
from hlsd.run.protocol import BARN2022, HLSD2021, PROTOCOLS, Protocol, SameEnds
from hlsd.run.row import COLUMNS, FIELDS
from hlsd.run.seal import seal
from hlsd.sim.perturbations import Disturbance

NUMBERS = [
    name
    for name, field in FIELDS.items()
    if field.required and field.kind != "text" and field.table == "episodes"
]
CONDITIONS = Conditions(
    suite="barn300",
    suite_version="1",
    suite_digest="abc",
    protocol=BARN2022,
    robot="jackal",
    robot_version="1.0",
    seed=7,
    perturbations=(Disturbance("lidar.dropout", 0.2),),
)


@dataclasses.dataclass(frozen=True)
class Corner(SameEnds):
    """Start and goal of a package outside."""


@pytest.mark.parametrize("protocol", PROTOCOLS.values(), ids=lambda p: p.name)
def test_conditions_come_back_from_json_as_they_were(protocol):
    held = dataclasses.replace(CONDITIONS, protocol=protocol)
    again = Conditions.from_json(json.loads(json.dumps(held.as_json())))
    assert again == held


def test_start_and_goal_of_others_come_back_while_their_package_is_there():
    ends = Corner((0.0, 1.0, 2.0), (3.0, 4.0))
    protocol = dataclasses.replace(BARN2022, name="corner", ends=ends)
    plain = json.loads(json.dumps(protocol.as_json()))
    again = Protocol.from_json(plain)
    assert again == protocol
    assert type(again.ends).__name__ == "Corner"


def test_a_run_whose_start_and_goal_are_gone_keeps_its_limit(tmp_path):
    """Its times are read as before; where it starts nobody can tell."""
    ends = Corner((0.0, 1.0, 2.0), (3.0, 4.0))
    rules = dataclasses.replace(BARN2022, name="corner", ends=ends, limit_s=30.0)
    held = dataclasses.replace(CONDITIONS, protocol=rules)
    write_imported(tmp_path, rows("corner"), {}, held)
    manifest = tmp_path / "run.json"
    text = manifest.read_text()
    kind = f"{Corner.__module__}:Corner"
    assert kind in text
    manifest.write_text(text.replace(kind, "a_package_that_is_gone:Corner"))
    seal(tmp_path, ["run.json"])
    run = load_run(tmp_path)
    assert times_s(run.episodes).tolist() == [12.0, 30.0]
    protocol = protocol_of(run.episodes)
    with pytest.raises(HlsdError, match=r"a_package_that_is_gone.*cannot be imported"):
        protocol.start_pose(None)
    assert Protocol.from_json(protocol.as_json()) == protocol


def test_start_and_goal_that_are_no_values_are_refused():
    class Odd:
        pass

    with pytest.raises(HlsdError, match="Odd, which is not a dataclass"):
        dataclasses.replace(BARN2022, ends=Odd()).as_json()


def test_damaged_conditions_are_never_read_as_todays(tmp_path):
    write_imported(tmp_path, rows("hlsd2021"), {}, CONDITIONS)
    manifest = json.loads((tmp_path / "run.json").read_text())
    manifest["conditions"]["protocol"]["another_rule"] = 1
    (tmp_path / "run.json").write_text(json.dumps(manifest))
    seal(tmp_path, ["run.json"])
    with pytest.raises(HlsdError, match=r"run\.json is damaged"):
        load_episodes(tmp_path)


def test_clean_and_perturbed_runs_do_not_share_a_table(tmp_path):
    protocol = dataclasses.replace(CONDITIONS, protocol=HLSD2021)
    for name, held in (("a", ()), ("b", CONDITIONS.perturbations)):
        conditions = dataclasses.replace(protocol, perturbations=held)
        write_imported(tmp_path / name, rows("hlsd2021"), {}, conditions)
    with pytest.raises(HlsdError, match=r"perturbations \(none, lidar.dropout=0.2\)"):
        join_runs([tmp_path / "a", tmp_path / "b"])
    assert "perturbed by lidar.dropout=0.2" in setting(load_episodes(tmp_path / "b"))
    assert "perturbed" not in setting(load_episodes(tmp_path / "a"))


def test_wording_of_a_protocol_is_no_rule():
    other = dataclasses.replace(HLSD2021, summary="in other words")
    assert other == HLSD2021
    assert other.as_json() == HLSD2021.as_json()


@dataclasses.dataclass(frozen=True)
class Raises:
    """Ends whose values it never likes."""

    def __post_init__(self):
        raise RuntimeError("never")


@pytest.mark.parametrize(
    "changes",
    [
        {"ends": {"kind": f"{__name__}:Raises"}},
        {"score": {"lowest": 4.0, "highest": 0.0}},
        {"score": {"lowest": 0.0, "highest": 8.0}},
        {"score": {"lowest": 8.0, "highest": 4.0}},
    ],
)
def test_rules_that_no_protocol_has_are_refused(changes):
    plain = BARN2022.as_json()
    assert Protocol.from_json(plain) == BARN2022
    with pytest.raises(HlsdError, match="not a protocol"):
        Protocol.from_json(plain | changes)


@pytest.mark.parametrize(
    "plain", [{}, {"ends": {}}, {"ends": 3, "score": None}, {"name": "x"}]
)
def test_what_is_no_protocol_is_refused(plain):
    with pytest.raises(HlsdError, match="not a protocol"):
        Protocol.from_json(plain)


def test_what_differs_is_named_and_the_unknown_differs_from_nothing():
    other = dataclasses.replace(
        CONDITIONS,
        suite_digest="xyz",
        protocol=dataclasses.replace(BARN2022, limit_s=60.0),
        perturbations=(),
        seed=8,
        robot="disc",
    )
    assert CONDITIONS.differences(other) == {
        "suite digest": ("abc", "xyz"),
        "protocol's limit_s": ("100.0", "60.0"),
        "perturbations": ("lidar.dropout=0.2", "none"),
    }
    unknown = dataclasses.replace(CONDITIONS, suite_digest="", suite_version="")
    assert CONDITIONS.differences(unknown) == {}
    assert CONDITIONS.differences(CONDITIONS) == {}


def rows(protocol, outcomes=("success", "timeout")):
    return [
        {
            "suite": "barn300",
            "suite_version": "1",
            "world": str(world),
            "planner": "mine",
            "trial": "0",
            "protocol": protocol,
            "outcome": outcome,
            "time_s": "12.0000",
            "seed": "7",
        }
        for world, outcome in enumerate(outcomes)
    ]


def test_a_run_is_read_by_the_rules_that_it_recorded(tmp_path):
    """60 s under a name that means 50 s today, and a name that means nothing today."""
    for name in ("hlsd2021", "of_a_friend"):
        rules = dataclasses.replace(HLSD2021, name=name, limit_s=60.0, version="0")
        held = dataclasses.replace(CONDITIONS, protocol=rules)
        write_imported(tmp_path / name, rows(name), {}, held)
        run = load_run(tmp_path / name)
        assert run.conditions == held
        assert times_s(run.episodes).tolist() == [12.0, 60.0]
        assert protocol_of(run.episodes) == rules
        assert run.summary()["mean_time_s"].tolist() == [36.0]


def test_parts_of_a_table_keep_its_rules(tmp_path):
    rules = dataclasses.replace(HLSD2021, limit_s=60.0, version="0")
    held = dataclasses.replace(CONDITIONS, protocol=rules)
    write_imported(tmp_path / "run", rows("hlsd2021"), {}, held)
    episodes = load_episodes(tmp_path / "run")
    parts = {
        "mask": episodes[episodes["world"] == 1],
        "reset": episodes[episodes["world"] == 1].reset_index(drop=True),
        "assign": episodes.assign(planner="other"),
        "concat": pd.concat([episodes, episodes], ignore_index=True),
        "sort": episodes.sort_values("world"),
        "join": join_runs([tmp_path / "run"]),
        "group": next(iter(episodes.groupby("planner")))[1],
    }
    for name, part in parts.items():
        assert protocol_of(part).limit_s == 60.0, name


def test_runs_of_other_rules_are_not_joined(tmp_path):
    for name, limit_s in (("a", 50.0), ("b", 60.0)):
        rules = dataclasses.replace(HLSD2021, limit_s=limit_s)
        held = dataclasses.replace(CONDITIONS, protocol=rules)
        write_imported(tmp_path / name, rows("hlsd2021"), {}, held)
    with pytest.raises(HlsdError, match="differ in their protocol's limit_s"):
        join_runs([tmp_path / "a", tmp_path / "b"])


def test_a_run_of_0_1_0_is_read_by_what_0_1_0_knew(tmp_path):
    write_imported(tmp_path / "run", rows("hlsd2021"), {})
    config = {
        "planners": ["mine"],
        "policy_sha256": [""],
        "worlds": [0, 1],
        "trials": 1,
        "suite": "barn300",
        "suite_version": "1",
        "suite_digest": "abc",
        "protocol": "hlsd2021",
        "robot": "jackal",
        "robot_version": "1.0",
        "seed": 7,
    }
    manifest = json.dumps({"config": config, "versions": {}})
    (tmp_path / "run" / "run.json").write_text(manifest)
    (tmp_path / "run" / "results.sha256").unlink()
    blank = dict.fromkeys(COLUMNS, "") | dict.fromkeys(NUMBERS, "0")
    blank |= {"robot": "jackal", "robot_version": "1.0"}
    table = [",".join((blank | row).values()) for row in rows("hlsd2021")]
    text = "\n".join([",".join(COLUMNS), *table, ""])
    (tmp_path / "run" / "episodes.csv").write_text(text)
    held = recorded_conditions(tmp_path / "run")
    assert held.protocol == first_protocol("hlsd2021")
    assert held.protocol == dataclasses.replace(
        HLSD2021, version="1", footprint_padding_m=0.1
    )
    assert held.suite_digest == "abc"
    assert times_s(load_episodes(tmp_path / "run")).tolist() == [12.0, 50.0]


@pytest.mark.parametrize("text", ["", "[]", "{", '{"config": 3}', '{"config": {}}'])
def test_a_record_that_is_none_is_refused(tmp_path, text):
    assert recorded_conditions(tmp_path) is None
    (tmp_path / "run.json").write_text(text)
    with pytest.raises(HlsdError, match=r"run\.json is damaged"):
        recorded_conditions(tmp_path)
