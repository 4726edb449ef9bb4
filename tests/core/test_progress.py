"""Progress: lines where there is no terminal, and a forecast of what is left."""

import pytest

import hlsd.core.progress as progress_module
from hlsd.core.progress import Forecast, Remaining, StageProgress, WholeProgress, about


def test_a_stage_is_said_to_be_complete_once(capsys):
    """Collecting drives on past its last tick and goes on telling so."""
    with StageProgress() as progress:
        for title in ("first", "second"):
            for done in (1, 2, 2, 2):
                progress.update(title, done, 2)
    lines = capsys.readouterr().err.splitlines()
    assert [line.split(",")[0] for line in lines] == ["first: 2/2 ", "second: 2/2 "]


def test_the_whole_progress_is_a_line_every_15_s(capsys, monkeypatch):
    now = [100.0]
    monkeypatch.setattr(progress_module.time, "monotonic", lambda: now[0])
    with WholeProgress() as progress:
        for done in range(1, 61):
            now[0] += 1.0
            stage = "a" if done <= 30 else "b"
            progress.update(stage, done, 60, Remaining(60.0 - done, 600.0))
    assert capsys.readouterr().err.splitlines() == [
        "a: 15/60, about 45 s left, about 10 min left in all",
        "a: 30/60, about 30 s left, about 10 min left in all",
        "b: 45/60, about 15 s left, about 10 min left in all",
        "b: 60/60, about 5 s left, about 10 min left in all",
    ]


@pytest.mark.parametrize(
    ("seconds", "text"),
    [
        (0.0, "about 5 s"),
        (41.0, "about 40 s"),
        (54.9, "about 55 s"),
        (59.0, "about 1 min"),
        (890.0, "about 15 min"),
        (3900.0, "about 1 h 5 min"),
    ],
)
def test_durations_are_no_finer_than_a_forecast(seconds, text):
    assert about(seconds) == text


class Clock:
    def __init__(self):
        self.now_s = 1000.0

    def __call__(self):
        return self.now_s


def run_stage(forecast, clock, name, takes_s, pause_s=0.0, first=0.0, until=1.0):
    """Report a stage of even pace every hundredth of its whole duration."""
    clock.now_s += pause_s
    for k in range(round(100 * first), round(100 * until) + 1):
        forecast.update(name, k / 100)
        clock.now_s += takes_s / 100 if k < round(100 * until) else 0.0
        yield k / 100, forecast.remaining()


def test_a_forecast_that_is_right_stays_right():
    clock = Clock()
    forecast = Forecast({"a": 40.0, "b": 200.0, "c": 5.0}, clock)
    for done, left in run_stage(forecast, clock, "a", 40.0):
        assert left.stage_s == pytest.approx(40.0 * (1 - done))
        assert left.all_s == pytest.approx(40.0 * (1 - done) + 205.0)
    for done, left in run_stage(forecast, clock, "b", 200.0, pause_s=3.0):
        assert left.all_s == pytest.approx(200.0 * (1 - done) + 5.0, rel=0.05)
    *_, (_, left) = run_stage(forecast, clock, "c", 5.0)
    assert left == Remaining(0.0, 0.0)


def test_a_forecast_learns_from_a_slow_machine():
    """Three times as slow as nominal: told from 40 nominal seconds, within 25 %."""
    clock = Clock()
    forecast = Forecast({"a": 40.0, "b": 200.0}, clock)
    *_, (_, left) = run_stage(forecast, clock, "a", 120.0)
    assert left.all_s == pytest.approx(600.0, rel=0.25)
    *_, (_, left) = run_stage(forecast, clock, "b", 600.0, until=0.2)
    assert left.all_s == pytest.approx(480.0, rel=0.01), "by its own pace alone"


def test_a_forecast_does_not_count_what_an_earlier_run_did():
    """A stage that was half done before goes on at its own pace."""
    clock = Clock()
    forecast = Forecast({"a": 0.0, "b": 100.0, "c": 100.0}, clock)
    forecast.update("a", 1.0)
    for done, left in run_stage(forecast, clock, "b", 100.0, pause_s=9.0, first=0.5):
        assert left.all_s == pytest.approx(100.0 * (1 - done) + 100.0)
