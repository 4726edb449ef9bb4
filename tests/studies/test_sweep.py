"""Sweeps: pairs, curves against closed forms, points driven once, refusals."""

import math
import os
import re
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import hlsd
import hlsd.studies.sweep as sweep_module
from hlsd.analysis.degradation import (
    Curve,
    Factor,
    Point,
    area_under,
    curves,
    falls_at,
    pair,
    sum_up,
    tabulate,
)
from hlsd.analysis.worst import worst_worlds
from hlsd.cli.app import app
from hlsd.core.errors import HlsdError
from hlsd.report.degradation import draw_sweep, sweep_markdown
from hlsd.run.bench import Bench
from hlsd.run.row import COLUMNS, TEXT_COLUMNS
from hlsd.sim.perturbations import (
    Disturbance,
    Perturbation,
    disturbances,
    perturbations,
)
from hlsd.studies.sweep import default_folder, plan, sweep
from tests.cli.ready import ready

ROOT = Path(__file__).resolve().parents[2]
NOISE = Factor("noise", (0.1, 0.4), 0.0, "m")
GAIN = Factor("gain", (0.5, 0.75, 2.0), 1.0)


class Gain(Perturbation):
    """The drive multiplies each command by a gain."""

    neutral = 1.0

    def __init__(self, gain):
        if gain <= 0:
            raise HlsdError(f"gain is above 0, not {gain:g}")
        self.gain = gain

    def command(self, speed, yaw_rate, time_s):
        return self.gain * speed, self.gain * yaw_rate


@pytest.fixture(scope="module")
def gain():
    perturbations.register("gain", Gain)
    yield "gain"
    perturbations.forget("gain")


def episodes(success, time_s=10.0, planner="one", seed=0):
    """Rows from success by (world, trial)."""
    rows = []
    for (world, trial), there in success.items():
        row = dict.fromkeys(COLUMNS, 0) | dict.fromkeys(TEXT_COLUMNS, "")
        row |= {"suite": "s", "protocol": "hlsd2021", "planner": planner, "robot": "r"}
        row |= {"world": world, "trial": trial, "seed": seed, "reason": ""}
        row |= {"outcome": "success" if there else "timeout", "robot_version": "1"}
        row["time_s"] = time_s + world if there else 50.0
        rows.append(row)
    return pd.DataFrame(rows)


def grid(worlds, trials, succeeds):
    return {(w, t): succeeds(w, t) for w in range(worlds) for t in range(trials)}


def test_the_area_and_the_size_of_a_fall_are_what_a_hand_computes():
    """Rates 1, 0.5, 0 at 0, 0.1, 0.4: trapezoids of 0.075 and 0.075 over 0.4."""
    curve = Curve(NOISE, (0.0, 0.1, 0.4), (0, 1, 2))
    success = np.array([[1, 1, 1, 1], [1, 1, 0, 0], [0, 0, 0, 0]], np.float64)
    worlds = np.array([0, 0, 1, 1])
    area, low, high = area_under(curve, success, worlds)
    assert area == pytest.approx((0.1 * 0.75 + 0.3 * 0.25) / 0.4)
    # A run that stays until 0.1 has (0.1 + 0.15) / 0.4, the others 0.05 / 0.4.
    assert (low, high) == pytest.approx((0.125, 0.625))
    fall, low, high = falls_at(curve, success, worlds)
    assert fall == pytest.approx(0.1 * 0.1 / 0.5)
    # All draws from the one world: 0.1 + 0.3 * 0.1; all from the other: 0.1 * 0.1.
    assert (low, high) == pytest.approx((0.01, 0.13))


def test_a_curve_that_falls_exactly_by_ten_points_has_its_size_there():
    curve = Curve(NOISE, (0.0, 0.1, 0.4), (0, 1, 2))
    success = np.ones((3, 10))
    success[1:, 0] = 0.0
    fall, low, high = falls_at(curve, success, np.arange(10))
    assert fall == pytest.approx(0.1)
    assert low < 0.1
    assert high == math.inf  # many resamples lack the world that fails


def test_what_does_not_fall_is_beyond_on_either_side_and_has_no_interval():
    for sizes, beyond in (((1.0, 2.0), math.inf), ((1.0, 0.5), -math.inf)):
        curve = Curve(GAIN, sizes, (0, 1))
        found = falls_at(curve, np.ones((2, 6)), np.arange(6))
        assert found[0] == beyond
        assert np.isnan(found[1:]).all()
        area, *ends = area_under(curve, np.ones((2, 6)), np.arange(6))
        assert area == 1.0
        assert np.isnan(ends).all()


def test_sizes_on_both_sides_of_the_neutral_one_are_two_curves():
    points = [Point("clean")]
    points += [Point(f"{s}", (Disturbance("gain", s),)) for s in GAIN.sizes]
    points.append(Point("both", (*points[1].perturbations, Disturbance("noise", 1.0))))
    above, below = curves(points, GAIN)
    assert (above.sizes, above.points) == ((1.0, 2.0), (0, 3))
    assert (below.sizes, below.points) == ((1.0, 0.75, 0.5), (0, 2, 1))
    np.testing.assert_allclose(below.distances, [0.0, 0.25, 0.5])
    # Rates 1, 0.5, 0.5 downwards: by 0.1 at a fifth of the way to 0.75.
    success = np.array([[1, 1], [1, 0], [1, 0]], np.float64)
    assert falls_at(below, success, np.arange(2))[0] == pytest.approx(0.95)


def test_changes_are_of_pairs_whatever_the_order_of_the_rows():
    """Worlds differ by 1 s each, the perturbed runs by the same 3 s."""
    all_there = grid(8, 2, lambda w, t: True)
    clean, slow = episodes(all_there), episodes(all_there, time_s=13.0)
    shuffled = slow.sample(frac=1.0, random_state=1)
    points = [Point("clean"), Point("noise=0.1", (Disturbance("noise", 0.1),))]
    table = tabulate(pair([clean, shuffled]), points, [NOISE])
    first, second = table.to_dict("records")
    assert (first["noise"], second["noise"]) == (0.0, 0.1)
    assert math.isnan(first["time_change_s"])
    assert second["time_change_s"] == pytest.approx(3.0)
    # The same in every pair: unpaired, it would be as wide as worlds differ.
    assert math.isnan(second["time_change_low_s"])
    assert second["mean_time_high_s"] - second["mean_time_low_s"] > 2.0
    assert second["success_change"] == 0.0
    assert second["success_change_low"] < 0 < second["success_change_high"]


@pytest.mark.parametrize(
    "other",
    [
        episodes(grid(2, 1, lambda w, t: True)),
        episodes(grid(2, 2, lambda w, t: True), planner="two"),
        episodes(grid(2, 2, lambda w, t: True), seed=1),
    ],
)
def test_points_that_are_no_pairs_are_refused(other):
    with pytest.raises(HlsdError, match="not pairs"):
        pair([episodes(grid(2, 2, lambda w, t: True)), other])


def test_the_worst_tenth_is_judged_on_other_trials_than_it_is_ranked_on():
    """Even trials fail in world 3 alone, odd ones in world 7 alone: luck."""

    def lucky(world, trial):
        return world != (3 if trial % 2 == 0 else 7)

    (runs,) = pair([episodes(grid(20, 4, lucky))])
    worst = worst_worlds(runs, 0)
    assert worst["worlds"] == 2
    assert worst["ranked_apart"]
    # Ranked on even trials: world 3 and the slowest of the others, 19. On the odd
    # ones, neither fails. And the other way round.
    assert worst["success"] == 1.0
    assert worst["time_s"] == pytest.approx(((13 + 29) / 2 + (17 + 29) / 2) / 2)
    (single,) = pair([episodes(grid(20, 1, lucky))])
    biased = worst_worlds(single, 0)
    assert not biased["ranked_apart"]
    assert biased["success"] == 0.5  # world 3, and a world of no failure
    (bad,) = pair([episodes(grid(20, 4, lambda w, t: w not in (3, 7)))])
    worst = worst_worlds(bad, 0)
    assert worst["success"] == 0.0
    assert worst["time_s"] == 50.0
    assert 0.0 == worst["success_low"] < worst["success_high"] <= 1.0


def test_worlds_of_equal_rank_count_in_equal_parts():
    """Five of 20 worlds fail in even trials; of these, one in odd ones, too."""
    rows = grid(20, 2, lambda w, t: w >= 5 or (t == 1 and w > 0))
    (runs,) = pair([episodes(rows)])
    # On even trials five share the place: 4 of 5 succeed in odd ones. On odd ones,
    # world 0 is the worst, the slowest, 19, next: 0 and 1 in even ones.
    assert worst_worlds(runs, 0)["success"] == pytest.approx((0.8 + 0.5) / 2)


def test_the_text_says_what_is_not_within_the_range():
    points = [Point("clean")]
    points += [Point(f"noise={s:g}", (Disturbance("noise", s),)) for s in NOISE.sizes]
    there = grid(6, 1, lambda w, t: True)
    some = grid(6, 1, lambda w, t: w > 2)
    data = [
        pd.concat([episodes(there), episodes(own, planner="two")])
        for own in (there, some, some)
    ]
    runs = pair(data)
    table = tabulate(runs, points, [NOISE])
    summary = sum_up(runs, points, [NOISE])
    text = sweep_markdown(data[0], table, summary, [NOISE])
    lines = [line for line in text.splitlines() if line.startswith("| noise")]
    assert "not within the range" in lines[0]
    assert "| 0.02 m (" in lines[1]  # 1 to 0.5 within 0.1 m
    above, below = draw_sweep(points, table, [NOISE]).axes
    assert above.get_xlabel() == below.get_xlabel() == "noise [m]"
    drawn = {line.get_label(): line.get_ydata().tolist() for line in above.lines}
    assert drawn == {"one": [100.0, 100.0, 100.0], "two": [100.0, 50.0, 50.0]}
    assert draw_sweep(points, table, [NOISE, GAIN, GAIN], grid=True) is None


SMALL = {"worlds": [0, 150], "trials": 2, "jobs": 1, "progress": False}
MADE = ("sweep.csv", "summary.csv", "summary.md", "degradation.png", "sweep.json")


def made(folder):
    return {name: (folder / name).read_bytes() for name in MADE}


@pytest.fixture(scope="module")
def swept(gain, tmp_path_factory):
    return sweep(
        "pursuit",
        {"gain": [1, 0.25], "lidar.dropout": [0.5]},
        out=tmp_path_factory.mktemp("sweep") / "all",
        **SMALL,
    )


def test_every_point_is_a_run_of_its_own(swept):
    assert [p.name for p in swept.points] == ["clean", "gain=0.25", "lidar.dropout=0.5"]
    for point in swept.points:
        run = swept.run(point.name)
        assert run.conditions.perturbations == point.perturbations
        assert list(run.episodes[["world", "trial"]].itertuples(index=False)) == [
            (0, 0),
            (0, 1),
            (150, 0),
            (150, 1),
        ]
    slow = swept.table.set_index("point").loc["gain=0.25"]
    clean = swept.run("clean").episodes["time_s"].to_numpy()
    times = swept.run("gain=0.25").episodes["time_s"].to_numpy()
    assert slow["time_change_s"] == pytest.approx((times - clean).mean())
    assert slow["time_change_s"] > 5  # a quarter of the speed
    assert list(swept.summary["perturbation"]) == ["gain", "lidar.dropout"]
    assert repr(swept).endswith("pursuit; 3 points)")
    with pytest.raises(HlsdError, match="no point 'x': there are clean"):
        swept.run("x")


def test_any_number_of_jobs_gives_the_same_bytes(swept, tmp_path):
    again = sweep(
        "pursuit",
        ["gain=1,0.25", "lidar.dropout=0.5"],
        out=tmp_path / "two",
        **(SMALL | {"jobs": 2}),
    )
    assert made(again.path) == made(swept.path)


def test_an_interrupted_sweep_goes_on_where_it_stopped(swept, tmp_path, monkeypatch):
    planned = plan(
        Bench(("pursuit",), worlds="0,150", trials=2),
        {"gain": [1, 0.25], "lidar.dropout": [0.5]},
    )
    out, told = tmp_path / "out", []

    def stop(what, done, total, left):
        told.append((done, total))
        if done == 6:  # within the second point
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        sweep_module.run_sweep(planned, out, 1, stop)
    assert not (out / "sweep.csv").exists()
    kept = (out / "clean" / "episodes.csv").read_bytes()
    assert not (out / "gain=0.25" / "episodes.csv").exists()
    told.clear()
    sweep_module.run_sweep(planned, out, 1, lambda *what: told.append(what[1:3]))
    # Two points are left, and of the first of them two episodes.
    assert told[0] == (4, 8)
    assert told[-1] == (8, 8)
    assert made(out) == made(swept.path)
    assert (out / "clean" / "episodes.csv").read_bytes() == kept
    told.clear()
    sweep_module.run_sweep(planned, out, 1, lambda *what: told.append(what[0]))
    assert ["there already" in what for what in told] == [True]


def test_more_sizes_are_added_and_fewer_or_others_refused(gain, tmp_path):
    out = tmp_path / "out"
    small = SMALL | {"worlds": 0, "trials": 1}
    sweep("pursuit", {"gain": [0.5]}, out=out, **small)
    kept = (out / "clean" / "episodes.csv").read_bytes()
    more = sweep("pursuit", {"gain": [2, 0.5]}, out=out, **small)
    assert list(more.table["gain"]) == [1.0, 2.0, 0.5]
    assert (out / "clean" / "episodes.csv").read_bytes() == kept
    before = made(out)
    with pytest.raises(HlsdError, match=r"other points \(gain=0.5\): choose another"):
        sweep("pursuit", {"gain": [2]}, out=out, **small)
    with pytest.raises(HlsdError, match=r"other inputs \(seed"):
        sweep("pursuit", {"gain": [2, 0.5]}, out=out, **small, seed=1)
    with pytest.raises(HlsdError, match="not a sweep's folder"):
        sweep("pursuit", {"gain": [2]}, out=out / "clean", **small)
    assert made(out) == before


def test_a_grid_drives_all_combinations_once(gain, tmp_path):
    done = sweep(
        "pursuit",
        {"gain": [1, 0.5], "lidar.dropout": [0, 0.5]},
        grid=True,
        out=tmp_path / "grid",
        **(SMALL | {"worlds": 0, "trials": 1}),
    )
    assert [point.name for point in done.points] == [
        "clean",
        "lidar.dropout=0.5",
        "gain=0.5",
        "gain=0.5,lidar.dropout=0.5",
    ]
    assert done.figure.read_bytes().startswith(b"\x89PNG")
    # Either is varied alone in this grid, so that both have curves.
    assert len(done.summary) == 2


def test_a_grid_without_neutral_sizes_has_a_table_and_no_curves():
    planned = plan(
        Bench(("pursuit",)),
        {"lidar.dropout": [0.1, 0.2]},
        grid=True,
    )
    assert len(planned.points) == 3
    points = (planned.points[0], Point("x", (Disturbance("a", 1), Disturbance("b", 1))))
    runs = pair([episodes(grid(2, 1, lambda w, t: True))] * 2)
    empty = sum_up(runs, points, [Factor("a", (1.0,)), Factor("b", (1.0,))])
    assert empty.empty
    assert "falls_at" in empty.columns


def test_a_preset_is_driven_whole_and_its_worst_worlds_told(tmp_path):
    out = tmp_path / "cold"
    arguments = ["sweep", "--planner", "pursuit", "--preset", "cold", "--worlds"]
    arguments += ["0,150", "--trials", "2", "--jobs", "1", "--out", str(out)]
    result = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert result.exit_code == 0
    assert "| planner | success, clean | success, cold |" in result.output
    assert "cold: lidar.mount_yaw=0.02, " in result.output.replace("\n", " ")
    assert "the 1 world where a planner does worst" in result.output
    assert "half of the trials" in result.output
    assert f"results: {out}" in result.output
    assert hlsd.load_run(out / "cold").conditions.perturbations == disturbances("cold")
    (row,) = pd.read_csv(out / "summary.csv").to_dict("records")
    assert row["mean_time_s"] > row["clean_mean_time_s"]
    assert row["worst_worlds"] == 1
    assert not (out / "degradation.png").exists()


def test_an_unknown_preset_is_refused_before_anything_is_driven(tmp_path):
    out = tmp_path / "out"
    for preset in ("no-such-set", "lidar.dropout=0.2"):
        with pytest.raises(HlsdError, match=preset):
            sweep("pursuit", preset=preset, out=out, **SMALL)
    with pytest.raises(HlsdError, match="set of its own"):
        sweep("pursuit", ["lidar.dropout=0.2"], preset="cold", out=out, **SMALL)
    assert not out.exists()


@pytest.mark.parametrize(
    ("vary", "message"),
    [
        ([], "--vary"),
        (["lidar.dropout"], "give name=size,size"),
        (["lidar.dropout=0,much"], "give name=size,size"),
        (["lidar.dropout=0.1,,"], "give name=size,size"),
        (["lidar.dropout=0.1,nan"], "a finite size"),
        (["lidar.dropout=0.1,0.10"], "to 0.1 twice"),
        (["lidar.dropout=0.1", "lidar.dropout=0.2"], "is varied twice"),
        (["lidar.dropout=0"], "nothing is disturbed"),
        (["lidar.dropout=0.1,2"], "within 0 and 1, not 2"),
        (["lidar.dropuot=0.1"], "did you mean 'lidar.dropout'"),
    ],
)
def test_what_cannot_be_varied_is_one_clear_line(vary, message, tmp_path):
    arguments = ["sweep", "--planner", "pursuit", "--out", str(tmp_path / "out")]
    arguments += [word for text in vary for word in ("--vary", text)]
    result = CliRunner().invoke(app, arguments)
    assert isinstance(result.exception, HlsdError)
    assert message in str(result.exception)
    assert "\n" not in str(result.exception)
    assert not (tmp_path / "out").exists()


def test_the_command_ends_with_code_2(tmp_path):
    arguments = ["sweep", "--planner", "pursuit", "--vary", "lidar.dropout=0.1,0.1"]
    done = ready(*arguments, cwd=tmp_path)
    assert done.returncode == 2
    assert done.stderr.splitlines() == [
        "hlsd: lidar.dropout is varied to 0.1 twice: give each size once"
    ]
    assert list(tmp_path.iterdir()) == []


def test_the_command_drives_and_prints_summary_and_paths(tmp_path):
    out = tmp_path / "out"
    arguments = ["sweep", "--planner", "pursuit", "--vary", "lidar.dropout=0,0.5"]
    arguments += ["--worlds", "0", "--trials", "1", "--jobs", "1", "--out", str(out)]
    result = CliRunner().invoke(app, arguments, catch_exceptions=False)
    assert result.exit_code == 0
    places = [result.output.index(f"\n{name}: {out}") for name in ("figure", "table")]
    assert all(a < b for a, b in pairwise([result.output.index("| area"), *places]))
    assert (out / "summary.md").read_text() in result.output


def test_the_program_of_the_page_runs(tmp_path):
    page = (ROOT / "docs" / "sweeps.md").read_text(encoding="utf-8")
    (program,) = re.findall(r"^```python run\n(.*?)^```$", page, re.M | re.S)
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "area under success" in done.stdout


def test_folders_are_readable_and_fit_any_file_system():
    def names(vary):
        return [p.name for p in plan(Bench(("dwa",)), vary, grid=True).points[1:]]

    assert names({"lidar.dropout": [0.1, 1e-7]}) == [
        "lidar.dropout=0.1",
        "lidar.dropout=1e-07",
    ]
    # Sizes that print alike are apart.
    near = names({"lidar.dropout": [0.12345678, 0.12345679]})
    assert len(set(near)) == 2
    odd = names({f"{__name__}:Gain": [0.5]})
    assert odd == ["tests.studies.test_sweep%3AGain=0.5"]
    planned = plan(Bench(("a:b", "dwa")), {"lidar.dropout": [0.1]})
    assert default_folder(planned).as_posix() == "runs/sweep-a_b+dwa-barn300"
