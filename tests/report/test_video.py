"""Videos: what is drawn, files that are whole, and what is refused."""

import sys

import numpy as np
import pytest
from PIL import Image
from typer.testing import CliRunner

import hlsd
from hlsd.analysis.runs import load_run
from hlsd.cli.app import app
from hlsd.core.errors import HlsdError
from hlsd.data.worlds import load_suite
from hlsd.report import rendering
from hlsd.report.rendering import View, painter
from hlsd.report.video import scene_of, shown_of, write_video
from hlsd.report.watching import Closed, Shower, driven
from hlsd.run.drivers import driver
from hlsd.run.session import open_course
from hlsd.sim.robots import get_robot
from tests.run.test_moving_runs import stored  # noqa: F401 - a fixture


@pytest.fixture(scope="module", autouse=True)
def graphics():
    """Skips where nothing can draw."""
    try:
        rendering._context(64, 64).free()
    except HlsdError as error:
        pytest.skip(str(error))


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    return hlsd.bench(
        ["pursuit", "hlsd10"],
        worlds="60",
        trials=1,
        jobs=1,
        out=tmp_path_factory.mktemp("video") / "run",
        progress=False,
    ).path


def invoke(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


def test_a_gif_shows_planners_side_by_side_and_ends_where_they_did(run, tmp_path):
    out = tmp_path / "x.gif"
    result = invoke(
        *("video", run, "--world", 60, "--planner", "pursuit", "--planner", "hlsd10"),
        *("--speed", 40, "--width", 96, "--height", 64, "--out", out),
    )
    assert result.exit_code == 0, result.output
    assert f"video: {out}" in result.output
    with Image.open(out) as film:
        assert film.size == (192, 64)
        pictures, length_ms = [], 0
        for number in range(film.n_frames):
            film.seek(number)
            pictures.append(np.array(film.convert("RGB")).astype(int))
            length_ms += film.info["duration"]
    assert 1200 < length_ms < 1700  # the end stays for a second
    first, last = pictures[0], pictures[-1]
    assert np.abs(first - last).mean() > 1.0
    assert [path.name for path in tmp_path.iterdir()] == ["x.gif"]


@pytest.mark.parametrize("camera", ["chase", "top", "robot"])
def test_every_camera_sees_something(run, tmp_path, camera):
    shown = shown_of(load_run(run), 60, "hlsd10", 0)
    out = write_video(
        [shown], tmp_path / "x.gif", camera=camera, size=(64, 48), speed=100.0
    )
    with Image.open(out) as film:
        assert np.array(film.convert("RGB")).std() > 5.0


@pytest.mark.parametrize("name", ["jackal", "disc"])
def test_the_robot_is_yellow_and_stands_where_it_is(name):
    """A disc, which has nothing to see but what collides, is as visible."""
    world, robot = load_suite("barn300")[60], get_robot(name)
    model = scene_of(world, robot).compile()
    import mujoco

    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, 0)
    data.qpos[:2] = -2.0, 3.0
    mujoco.mj_forward(model, data)
    with painter(model, 96, 64) as held:
        for at, seen in ((data.qpos[:3], True), (np.array((0.0, 20.0, 0.0)), False)):
            picture = held.draw(data, View(at, 1.5, 30.0, -40.0)).astype(int)
            red, green, blue = np.moveaxis(picture, 2, 0)
            yellow = (red > 150) & (green > 110) & (blue < 90)
            assert bool(yellow.sum() > 20) is seen


def test_movers_are_drawn_where_they_were(stored, tmp_path):  # noqa: F811
    held = hlsd.bench(
        "pursuit",
        suite=stored,
        worlds="0",
        trials=1,
        jobs=1,
        out=tmp_path / "run",
        progress=False,
    )
    shown = shown_of(held, 0, None, 0, str(stored))
    out = write_video([shown], tmp_path / "x.gif", size=(64, 48), speed=100.0)
    assert out.exists()


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (["--out", "x.avi"], "'x.avi' ends in '.avi': want .gif or .mp4"),
        (["--out", "x.gif", "--camera", "chas"], "did you mean 'chase'?"),
        (["--out", "x.gif", "--speed", "0"], "--speed of 0: give 0.05 to 100"),
        (["--out", "x.gif", "--width", "9"], "--width of 9 pixels: give 16 to 3840"),
        (["--out", "x.gif", "--trial", "7"], "kept no trajectory of hlsd10"),
        (["--out", "there.gif"], "'there.gif' exists already"),
    ],
)
def test_what_cannot_be_drawn_is_refused_in_one_line(
    run, tmp_path, monkeypatch, words, text
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "there.gif").write_bytes(b"mine")
    result = CliRunner().invoke(
        app, ["video", str(run), "--world", "60", "--planner", "hlsd10", *words]
    )
    assert isinstance(result.exception, HlsdError)
    assert text in str(result.exception)
    assert [path.name for path in tmp_path.iterdir()] == ["there.gif"]
    assert (tmp_path / "there.gif").read_bytes() == b"mine"


def test_where_nothing_can_draw_the_packages_are_named(monkeypatch):
    def broken(width, height):
        raise ImportError("no library")

    monkeypatch.setattr(rendering, "_egl", broken)
    monkeypatch.setattr(rendering, "_osmesa", broken)
    with pytest.raises(HlsdError, match=r"egl: .*no library.*apt install libegl1"):
        rendering._context(64, 64)


def test_without_a_display_watching_names_video(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    result = invoke("watch", "--planner", "hlsd10", "--world", 60)
    assert "hlsd video" in str(result.exception)


class Viewer:
    """A window that is closed after some pictures."""

    def __init__(self, most):
        self.shown, self.most = 0, most

    def sync(self):
        self.shown += 1

    def is_running(self):
        return self.shown < self.most


def test_who_watches_sees_each_tick_in_its_time_until_the_window_is_closed():
    import mujoco

    course = open_course(60, "barn300", None, "jackal")
    data = mujoco.MjData(scene_of(course.world, course.robot).compile())
    viewer = Viewer(6)
    shower = Shower(course, viewer, data)
    said = driven(course, driver("hlsd10"), 0, 0, shower)
    assert said.startswith("closed after 0.")
    assert viewer.shown == 6
    assert np.array_equal(data.qpos, course.simulator.data.qpos) is False
    with pytest.raises(Closed):
        shower.drove(None)


def test_an_mp4_is_h264_at_thirty_pictures_a_second(run, tmp_path):
    av = pytest.importorskip("av")
    shown = shown_of(load_run(run), 60, "hlsd10", 0)
    out = write_video([shown], tmp_path / "x.mp4", size=(65, 48), speed=100.0)
    with av.open(str(out)) as film:
        stream = film.streams.video[0]
        assert (stream.codec_context.name, stream.average_rate) == ("h264", 30)
        assert (stream.width, stream.height) == (64, 48)
        assert 30 <= sum(1 for _ in film.decode(stream)) < 40


def test_without_pyav_an_mp4_is_refused_in_one_line(run, tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "av", None)
    shown = shown_of(load_run(run), 60, "hlsd10", 0)
    with pytest.raises(HlsdError, match=r"or write a \.gif"):
        write_video([shown], tmp_path / "x.mp4", size=(64, 48))
    assert not list(tmp_path.iterdir())
