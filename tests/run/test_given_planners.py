"""Options and files of planners belong to what a run is."""

import pytest

from hlsd.core.errors import HlsdError
from hlsd.run.bench import Bench, resolve, run_bench
from hlsd.run.identity import other_making, other_settings

MINE = """
import gains
from hlsd import Command

class Mine:
    period_s = 0.05

    def __init__(self, speed=0.5, net=None):
        self.speed = speed

    def reset(self, setup):
        pass

    def plan(self, observation):
        return Command(self.speed, gains.GAIN)
"""


def write(folder, gain=1.0):
    folder.mkdir()
    (folder / "mine.py").write_text(MINE)
    (folder / "gains.py").write_text(f"GAIN = {gain}\n")
    return f"{folder}/mine.py:Mine"


def config_of(*planners):
    return resolve(Bench(planners, worlds="0", trials=1))


def test_the_same_file_elsewhere_is_the_same_run_and_another_option_is_not(tmp_path):
    here, there, edited = (
        write(tmp_path / name, gain) for name, gain in (("a", 1), ("b", 1), ("c", 2))
    )
    first = config_of(here)
    assert first.planners == ("mine:Mine",)
    assert config_of(there).sha256() == first.sha256()
    before, after = first.as_json(), config_of(edited).as_json()
    assert other_settings(before, after) == ""
    assert other_making(before, after) == "other code of planner 'mine:Mine'"
    assert config_of(f"{here}(speed=0.4)").planners == ("mine:Mine(speed=0.4)",)
    slow, slower = (config_of(f"x={here}(speed={v})").as_json() for v in (0.4, 0.3))
    assert other_settings(slow, slower) == (
        "references x 'mine:Mine(speed=0.4)', now 'mine:Mine(speed=0.3)'"
    )
    assert slow["planner_sha256"] != slower["planner_sha256"]


def test_options_of_hlsds_own_planners_count_under_any_name():
    shas = {
        config_of(f"x={planner}").sha256()
        for planner in ("pursuit", "pursuit(max_speed=0.8)", "pursuit(max_speed=0.7)")
    }
    assert len(shas) == 3


def test_what_a_file_holds_that_an_option_names_counts(tmp_path):
    planner, net = write(tmp_path / "a"), tmp_path / "net.pt"
    shas = set()
    for content in (b"1", b"2"):
        net.write_bytes(content)
        shas.add(config_of(f"{planner}(net={net})").sha256())
    assert len(shas) == 2


def test_a_period_that_cannot_be_driven_is_refused_before_anything_is_written(tmp_path):
    bench = Bench(("pursuit(period_s=0.0123)",), worlds="0", trials=1)
    with pytest.raises(HlsdError, match=r"its period_s is 0\.0123"):
        run_bench(bench, tmp_path / "out", 1)
    assert not (tmp_path / "out").exists()
