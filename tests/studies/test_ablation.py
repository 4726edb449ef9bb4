"""Ablations: one factor at a time, compared run by run; done once, resumed, refused."""

import csv as csv_module
import dataclasses
import io
import json
import re
import shutil

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import hlsd.studies.pipeline as pipeline_module
import hlsd.studies.steps as steps_module
from hlsd.analysis.runs import load_episodes
from hlsd.cli.app import app
from hlsd.core.errors import HlsdError
from hlsd.core.npz import sha256_of_file
from hlsd.data.motion_log import MotionLog
from hlsd.learning.collect import LAWS, PRESETS, Explorer, drive
from hlsd.learning.hallucination import OffsetOrder
from hlsd.learning.policy import Policy, shipped_policy
from hlsd.learning.train_many import Trained
from hlsd.learning.training import TRAINABLE, Optimiser
from hlsd.report.tables import percent_text
from hlsd.run.row import COLUMNS, TEXT_COLUMNS, TIMING_COLUMNS
from hlsd.studies.ablation import compare, csv, default_folder, markdown
from hlsd.studies.ablation import run_ablation as ablate
from hlsd.studies.variants import VARIANTS, Ablation, Variant
from tests.learning.test_collect import Unicycle

RECIPE = dataclasses.replace(
    TRAINABLE["hlsd10"], hidden=(16, 16), optimiser=Optimiser(steps=30, batch=64)
)
TINY = (
    Variant("default", "as it is", recipe=RECIPE),
    Variant("uniform", "other law", law="uniform", recipe=RECIPE),
    Variant("one-layer", "one layer", recipe=dataclasses.replace(RECIPE, hidden=(16,))),
)
# Time [s] of each run, by variant and (world, trial); None is a timeout.
RUNS = {
    "default": {(0, 0): 6.0, (0, 1): 8.0, (1, 0): 30.0, (1, 1): 34.0},
    "uniform": {(0, 0): 10.0, (0, 1): None, (1, 0): None, (1, 1): 30.0},
    "one-layer": {(0, 0): 7.5, (0, 1): 9.5, (1, 0): 31.5, (1, 1): 35.5},
}


def rows_of(times, seed=0):
    rows = []
    for (world, trial), time_s in times.items():
        row = dict.fromkeys(COLUMNS, 0) | dict.fromkeys(TEXT_COLUMNS, "")
        row |= {"suite": "s", "protocol": "hlsd2021", "planner": "hlsd10"}
        row |= {"world": world, "trial": trial, "training_seed": seed, "reason": ""}
        row["outcome"] = "timeout" if time_s is None else "success"
        row["time_s"] = 33.0 if time_s is None else time_s
        # Ticks of 0.1 s, of which 5 are recovery.
        row |= {"ticks": round(row["time_s"] * 10), "recovery_ticks": 5}
        row["contacts"] = int((world, trial) == (1, 1))
        rows.append(row)
    return pd.DataFrame(rows)


@pytest.fixture(scope="module")
def rows():
    return compare({name: rows_of(times) for name, times in RUNS.items()})


def changes(variant, default):
    def factors(variant):
        recipe = dataclasses.asdict(variant.recipe)
        return {"law": variant.law} | recipe.pop("hallucination") | recipe

    pairs = zip(factors(variant).items(), factors(default).items(), strict=True)
    return dict(new for new, old in pairs if new != old)


@pytest.mark.parametrize("planner", VARIANTS)
def test_every_planners_first_variant_is_its_own_recipe(planner):
    default, *others = VARIANTS[planner]
    assert (default.law, default.recipe) == ("matched", TRAINABLE[planner])
    assert Ablation(VARIANTS[planner]).planner == planner
    assert all(changes(variant, default) for variant in others)
    names = [variant.name for variant in VARIANTS[planner]]
    assert len(set(names)) == len(names)
    assert all(re.fullmatch(r"[a-z0-9.-]+", name) for name in names)


def test_each_variant_of_hlsd10_differs_in_one_factor():
    default, *others = VARIANTS["hlsd10"]
    assert [changes(variant, default) for variant in others] == [
        {"law": "uniform"},
        {"side_offset_m": 0.30},
        {"side_offset_m": 0.215},
        {"offset_order": OffsetOrder.AFTER_CLAMP},
        {"hidden": (256, 256)},
    ]
    assert {variant.law for variant in VARIANTS["hlsd10"]} == set(LAWS)


def test_each_variant_of_hlsd04_reads_one_speed_the_other_way():
    """Literally, or as the share of the data's highest speed: 0.4 of 1 m/s."""
    default, *others = VARIANTS["hlsd04"]
    literal, offset = (changes(variant, default) for variant in others)
    paper = TRAINABLE["hlsd10"].hallucination
    assert literal == {"empty_above_speed": paper.empty_above_speed}
    assert offset == {
        name: pytest.approx(0.4 * getattr(paper, name))
        for name in ("offset_from_speed", "offset_to_speed")
    }


def test_variants_of_several_planners_are_not_compared():
    one, other = VARIANTS["hlsd10"][0], VARIANTS["hlsd04"][0]
    with pytest.raises(HlsdError, match="one planner, not of hlsd04 and hlsd10"):
        Ablation((one, other))
    with pytest.raises(HlsdError, match="one planner, not of none"):
        Ablation(())


def test_a_planner_that_is_not_varied_is_refused(tmp_path):
    out = tmp_path / "all"
    for name, hint in (("hlsd4", "did you mean 'hlsd04'"), ("dwa", "known are hlsd10")):
        result = CliRunner().invoke(
            app, ["ablate", "--planner", name, "--out", str(out)]
        )
        assert isinstance(result.exception, HlsdError)
        assert hint in str(result.exception)
    assert not out.exists()
    assert default_folder("hlsd10") != default_folder("hlsd04")


def test_a_planners_own_log_is_collected_and_it_drives(tmp_path, monkeypatch):
    """HLSD 0.4 learns from its preset, and the rows are its own."""
    done = []

    def collect(preset, law, seed, robot, progress):
        done.append(("collect", preset, law))
        return small_collect(preset, law, seed, robot, progress)

    def train_many(trainings, at_once, finished, progress):
        for number, training in enumerate(trainings):
            done.append(("train", training.recipe.hallucination.empty_above_speed))
            policy = Policy.load(shipped_policy("hlsd04"))
            finished(number, Trained(policy, 1.0, at_once))

    def run_bench(bench, out, jobs, progress):
        done.append(("drive", *bench.planners, *dict(bench.policies)))
        out.mkdir()
        rows_of(RUNS["default"])[list(COLUMNS)].to_csv(
            out / "episodes.csv", index=False
        )

    for stage in (collect, train_many, run_bench):
        monkeypatch.setattr(steps_module, stage.__name__, stage)
    two = Ablation(VARIANTS["hlsd04"][:2], count=2, trials=2)
    table = ablate(two, tmp_path, 1)
    assert done == [
        ("collect", "0.4", "matched"),
        *(("train", speed) for speed in (0.32, 0.8)),
        *[("drive", "hlsd04", "hlsd04")] * 2,
    ]
    assert table.startswith("hlsd04; 2 worlds")
    lines = (tmp_path / "ablations.csv").read_text().splitlines()
    speeds = [row["empty_above_speed"] for row in csv_module.DictReader(lines)]
    assert speeds == ["0.32", "0.8"]


def test_a_row_is_what_a_hand_computes(rows):
    default, uniform, _ = rows
    assert [row.variant for row in rows] == list(RUNS)
    # Failures count 50 s: 10, 50, 50, 30.
    assert (uniform.n, uniform.success) == (4, 0.5)
    assert uniform.mean_time_s == pytest.approx(35.0)
    assert uniform.sd_time_s == pytest.approx((1100 / 3) ** 0.5)
    assert uniform.mean_success_time_s == pytest.approx(20.0)
    assert uniform.contact_free == 0.75
    # A share of all ticks, not a mean of shares: a long run counts for more.
    assert default.recovery == pytest.approx(20 / 780)
    # +4, +42 in the one world, +20, -4 in the other.
    assert uniform.difference_s == pytest.approx(15.5)
    # Two draws of a world, two of its pairs each. Below 2.5 % lies only -4 four times
    # (1 in 64), then -4 -4 +4 +4 (2 in 64); above, +42 four times, then 42 42 42 4.
    assert uniform.difference_low_s == pytest.approx(0.0)
    assert uniform.difference_high_s == pytest.approx(32.5)


def test_a_difference_is_paired(rows):
    """Worlds differ by 25 s, the variant by the same 1.5 s in every run."""
    default, _, constant = rows
    assert default.mean_time_high_s - default.mean_time_low_s > 20
    assert constant.difference_s == pytest.approx(1.5)
    assert np.isnan((constant.difference_low_s, constant.difference_high_s)).all()
    shuffled = {
        name: rows_of(times).sample(frac=1.0, random_state=k)
        for k, (name, times) in enumerate(RUNS.items())
    }
    for mixed, row in zip(compare(shuffled), rows, strict=True):
        for name, value in dataclasses.asdict(mixed).items():
            assert value == pytest.approx(getattr(row, name), nan_ok=True), name


def test_training_seeds_are_pooled_and_shown():
    def two(first, second):
        return pd.concat([rows_of(first), rows_of(second, seed=1)])

    slower = dict.fromkeys(RUNS["default"], 40.0)
    default, other = compare(
        {
            "default": two(RUNS["default"], slower),
            "one-layer": two(RUNS["one-layer"], slower),
        }
    )
    assert (default.seed_low_s, default.seed_high_s) == (19.5, 40.0)
    assert default.mean_time_s == pytest.approx(29.75)
    assert default.n == other.n == 8
    assert other.difference_s == pytest.approx(0.75)


def test_other_worlds_are_not_compared():
    fewer = dict(list(RUNS["uniform"].items())[:3])
    with pytest.raises(HlsdError, match=r"'uniform', with 3 runs, was not run with"):
        compare({"default": rows_of(RUNS["default"]), "uniform": rows_of(fewer)})
    with pytest.raises(HlsdError, match="same seeds, worlds and trials"):
        compare(
            {
                "default": rows_of(RUNS["default"]),
                "uniform": rows_of(RUNS["uniform"], seed=1),
            }
        )


def cells(text):
    lines = [line for line in text.splitlines() if line.startswith("|")]
    table = [[cell.strip() for cell in line[1:-1].split("|")] for line in lines]
    return [table[0], *table[2:]]


def test_markdown_and_csv_agree(rows):
    tiny = Ablation(TINY, count=2, suite_seed=7, trials=2)
    text = markdown(tiny, rows)
    head, *body = cells(text)
    assert {len(row) for row in body} == {len(head)}
    assert [row[0] for row in body] == [variant.change for variant in TINY]
    records = list(csv_module.DictReader(io.StringIO(csv(tiny, rows))))
    assert [record["variant"] for record in records] == list(RUNS)
    assert [record["law"] for record in records] == ["matched", "uniform", "matched"]
    assert [record["hidden"] for record in records] == ["16x16", "16x16", "16"]
    for row, record in zip(body, records, strict=True):
        mean, sd = float(record["mean_time_s"]), float(record["sd_time_s"])
        assert (
            row[head.index("time, failures at limit [s]")] == f"{mean:.2f} ± {sd:.2f}"
        )
        assert row[head.index("recovery ticks")] == percent_text(
            float(record["recovery"])
        )
    assert [row[-1] for row in body] == [
        "",
        "+15.50 (+0.00 … +32.50)",
        "+1.50",  # in every run: no interval
    ]
    assert "hlsd worlds generate --count 2 --seed 7" in text
    assert "One training seed stands behind each row" in text


def test_seeds_get_a_column_when_there_are_several(rows):
    several = markdown(Ablation(TINY, seeds=3), rows)
    assert len(cells(several)[0]) == 9
    assert len(cells(markdown(Ablation(TINY), rows))[0]) == 8
    assert "3 training seeds" in several
    assert "One training seed" not in several


def small_collect(preset, law, seed, robot, progress):
    """A hundred points, by an ideal vehicle."""
    poses, commands = drive(
        Unicycle(), Explorer(PRESETS[preset], law, seed), 140, 100, progress
    )
    recipe = json.dumps({"preset": preset, "law": law})
    return MotionLog(0.04, poses, commands, robot.name, "1", recipe, 100)


@pytest.fixture
def stages(monkeypatch):
    """Collecting, training and driving that take no time; what was called."""
    calls = []

    def collect(preset, law, seed, robot, progress):
        calls.append(f"collect {law}")
        return small_collect(preset, law, seed, robot, progress)

    def train_many(trainings, at_once, finished, progress):
        for number, training in enumerate(trainings):
            law = json.loads(MotionLog.load(training.log).recipe)["law"]
            calls.append(f"train {law} {training.recipe.hidden} {training.seed}")
            progress(number, 30, 30)
            policy = Policy.load(shipped_policy("hlsd10"))
            finished(number, Trained(policy, 1.0, at_once))

    def run_bench(bench, out, jobs, progress):
        ((planner, policy),) = bench.policies
        assert bench.planners == (planner,) == ("hlsd10",)
        assert policy.stem == out.name
        calls.append(f"drive {out.name}")
        out.mkdir()
        episodes = rows_of(RUNS[out.name.rpartition("-")[0]])
        episodes[list(COLUMNS)].to_csv(out / "episodes.csv", index=False)
        progress(4, 4, 1.0)

    for stage in (collect, train_many, run_bench):
        monkeypatch.setattr(steps_module, stage.__name__, stage)
    monkeypatch.setattr(pipeline_module, "code_digest", lambda code: "c0de")
    return calls


ALL = [
    "collect matched",
    "collect uniform",
    "train matched (16, 16) 0",
    "train uniform (16, 16) 0",
    "train matched (16,) 0",
    "drive default-0",
    "drive uniform-0",
    "drive one-layer-0",
]
SMALL = Ablation(TINY, count=2, trials=2)


def contents(folder):
    return {p: p.read_bytes() for p in sorted(folder.rglob("*")) if p.is_file()}


def test_every_step_is_done_once(stages, tmp_path, rows):
    told = []
    out = tmp_path / "all"
    table = ablate(SMALL, out, 1, lambda *what: told.append(what))
    assert stages == ALL
    assert table == markdown(SMALL, rows)
    assert (out / "ablations.md").read_text() == table
    assert (out / "ablations.csv").read_text() == csv(SMALL, rows)
    assert ("[4/5] train: 3 policies, gradient steps", 60, 90) in [
        what[:3] for what in told
    ]
    assert told[-1][:3] == ("[5/5] drive: 3 runs, episodes", 12, 12)
    before = contents(out)
    told.clear()
    assert ablate(SMALL, out, 1, lambda *what: told.append(what)) == table
    assert stages == ALL, "nothing is done again"
    assert [what.partition(":")[0] for what, *_ in told] == [
        "[1/5] generate worlds",
        "[2/5] collect, law matched",
        "[3/5] collect, law uniform",
        "[4/5] train",
        "[5/5] drive",
    ]
    assert all("there already" in what for what, *_ in told)
    assert contents(out) == before


def test_what_is_left_is_told_from_the_first_step_to_the_last(stages, tmp_path):
    told = []
    ablate(SMALL, tmp_path, 1, lambda *what: told.append(what))
    first, last = told[0][3], told[-1][3]
    # Three policies of about 100 s are the most of it; then nothing is left.
    assert 250 < first.all_s < 400
    assert first.stage_s < 1
    assert last.all_s == last.stage_s == 0


def test_an_interrupted_training_goes_on_there(stages, tmp_path, monkeypatch):
    real = steps_module.train_many

    def interrupted(trainings, at_once, finished, progress):
        real(trainings[:1], at_once, finished, progress)
        raise KeyboardInterrupt

    monkeypatch.setattr(steps_module, "train_many", interrupted)
    with pytest.raises(KeyboardInterrupt):
        ablate(SMALL, tmp_path, 1)
    assert not (tmp_path / "ablations.md").exists()
    monkeypatch.setattr(steps_module, "train_many", real)
    ablate(SMALL, tmp_path, 1)
    assert stages == ALL


def test_without_the_runs_it_drives_again_with_the_same_policies(stages, tmp_path):
    table = ablate(SMALL, tmp_path, 1)
    shutil.rmtree(tmp_path / "bench")
    assert ablate(SMALL, tmp_path, 1) == table
    assert stages == [*ALL, *(call for call in ALL if call.startswith("drive"))]


def test_more_seeds_go_on_in_the_same_folder(stages, tmp_path):
    ablate(SMALL, tmp_path, 1)
    table = ablate(dataclasses.replace(SMALL, seeds=2), tmp_path, 1)
    again = [f"{call[:-1]}1" for call in ALL if not call.startswith("collect")]
    assert stages == [*ALL, *again]
    assert "x 2 training seeds" in table


def other_seed(path):
    stamp = json.loads(path.read_text())
    held = stamp.get("conditions", stamp)
    held["seed"] = 7
    path.write_text(json.dumps(stamp))


def other_log(path):
    log = MotionLog.load(path)
    path.unlink()
    dataclasses.replace(log, poses=log.poses + 1.0).save(path)


def remove(path):
    path.unlink()


@pytest.mark.parametrize(
    ("change", "file", "named", "why"),
    [
        (other_log, "open-space-uniform.npz", "policies/uniform-0.npz", "motion_log"),
        (other_seed, "policies/default-0.npz.json", "policies/default-0.npz", "seed 7"),
        (other_seed, "bench/default-0.json", "bench/default-0", "seed 7, now 0"),
        (remove, "generated.json", "generated", "not its stamp 'generated.json'"),
    ],
)
def test_changed_inputs_are_refused(change, file, named, why, stages, tmp_path):
    ablate(SMALL, tmp_path, 1)
    change(tmp_path / file)
    before = contents(tmp_path)
    with pytest.raises(HlsdError) as refused:
        ablate(SMALL, tmp_path, 1)
    assert str(refused.value).startswith(repr(str(tmp_path / named)))
    assert why in str(refused.value)
    assert "\n" not in str(refused.value)
    assert stages == ALL
    assert contents(tmp_path) == before


def test_other_settings_are_refused(stages, tmp_path):
    ablate(SMALL, tmp_path, 1)
    for change, why in (({"count": 3}, "count 2, now 3"), ({"trials": 1}, "trials 2")):
        with pytest.raises(HlsdError, match=why):
            ablate(dataclasses.replace(SMALL, **change), tmp_path, 1)
    wider = dataclasses.replace(RECIPE, hidden=(32, 32))
    other = (Variant("default", "as it is", recipe=wider), *TINY[1:])
    with pytest.raises(HlsdError, match=r"default-0\.npz' was made from other"):
        ablate(dataclasses.replace(SMALL, variants=other), tmp_path, 1)
    assert stages == ALL


@pytest.mark.parametrize(
    ("option", "message"),
    [
        ("--count", "--count is 0: at least 1 is needed"),
        ("--trials", "--trials is 0: at least 1 is needed"),
        ("--seeds", "--seeds is 0: at least 1 is needed"),
        ("--jobs", "--jobs is 0: at least 1 is needed"),
    ],
)
def test_bad_settings_write_nothing(option, message, tmp_path):
    out = tmp_path / "all"
    result = CliRunner().invoke(app, ["ablate", "--out", str(out), option, "0"])
    assert isinstance(result.exception, HlsdError)
    assert str(result.exception) == message
    assert not out.exists()


def test_a_file_that_is_not_the_table_is_left_alone(stages, tmp_path):
    (tmp_path / "ablations.csv").write_text("mine")
    with pytest.raises(
        HlsdError, match=r"ablations\.csv' is there, but not the worlds"
    ):
        ablate(SMALL, tmp_path, 1)
    assert contents(tmp_path) == {tmp_path / "ablations.csv": b"mine"}
    assert stages == []


def test_a_folder_that_cannot_be_made_is_said(tmp_path):
    (tmp_path / "file").write_text("mine")
    with pytest.raises(HlsdError, match="cannot write to output folder"):
        ablate(SMALL, tmp_path / "file", 1)


def test_a_tiny_ablation_from_the_simulator_is_the_same_with_fewer_jobs(
    tmp_path, monkeypatch
):
    """Two variants, trained and driven in earnest; driven again by one process."""
    pytest.importorskip("torch", reason="torch is not installed")
    monkeypatch.setattr(steps_module, "collect", small_collect)
    tiny = Ablation((TINY[0], TINY[2]), count=2, trials=1)
    table = ablate(tiny, tmp_path, 2)
    policies = [
        Policy.load(tmp_path / "policies" / f"{name}-0.npz")
        for name in ("default", "one-layer")
    ]
    assert [len(policy.weights) for policy in policies] == [3, 2]
    runs = [load_episodes(tmp_path / "bench" / "one-layer-0")]
    assert list(runs[0]["world"]) == [0, 1]
    assert not (runs[0]["outcome"] == "error").any()
    digest = json.loads((tmp_path / "bench" / "one-layer-0.json").read_text())
    assert digest["policy_sha256"] == [
        sha256_of_file(tmp_path / "policies" / "one-layer-0.npz")
    ]
    shutil.rmtree(tmp_path / "bench")
    assert ablate(tiny, tmp_path, 1) == table
    runs.append(load_episodes(tmp_path / "bench" / "one-layer-0"))
    walls = {*TIMING_COLUMNS} - {"planner", "world", "trial", "ticks"}
    first, second = (
        episodes.drop(columns=[*walls & {*episodes.columns}]) for episodes in runs
    )
    pd.testing.assert_frame_equal(first, second)


def test_a_variant_that_never_arrives_has_no_time_of_successes():
    never = dict.fromkeys(RUNS["default"])
    rows = compare({"default": rows_of(never), "uniform": rows_of(RUNS["uniform"])})
    tiny = Ablation(TINY[:2])
    head, first, _ = cells(markdown(tiny, rows))
    assert first[head.index("time of successes [s]")] == "none"
    assert "nan" not in markdown(tiny, rows)
