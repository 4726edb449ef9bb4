"""The report's page in a browser: what it computes, and what a reader does with it."""

import shutil

import numpy as np
import pandas as pd
import pytest

from hlsd.analysis.runs import load_episodes
from hlsd.analysis.statistics import resampling
from hlsd.core.description import LidarSpec
from hlsd.data.worlds import load_suite
from hlsd.report.page_data import BEAM_STEP
from hlsd.report.write import write_report
from hlsd.run.bench import Bench, run_bench
from hlsd.run.trajectory import decode, read_trajectories
from hlsd.sim.lidar import Lidar
from hlsd.sim.mjcf import build_model
from hlsd.sim.robots import get_robot
from hlsd.sim.simulator import Simulator
from tests.data.small_arena import store_small_arena
from tests.data.small_course import store_small_course
from tests.report.browsing import (
    NEEDS_BROWSER,
    ask,
    choose,
    element,
    media,
    size,
    wait,
)
from tests.report.test_report import episodes, write_run

pytestmark = NEEDS_BROWSER

PLANNERS = ("lfh10", "hlsd10")
WORLDS = (12, 240)


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    settings = Bench(PLANNERS, worlds="12,240", trials=2)
    return run_bench(settings, tmp_path_factory.mktemp("runs") / "run", 1)


@pytest.fixture(scope="module")
def address(run):
    folder = write_report([run], formats=["html"]).folder
    return (folder / "report.html").as_uri()


@pytest.fixture
def page(browser, address):
    """The page, opened anew; whatever a test does must leave the console clean."""
    media(browser, "light")
    size(browser, 1400, 1000)
    browser.get(address)
    wait(browser, "replay.trajectory !== null")
    yield browser
    complaints = [
        entry["message"]
        for entry in browser.get_log("browser")
        if entry["level"] in ("SEVERE", "WARNING")
    ]
    assert complaints == []


def rows(browser):
    """Texts of the table's cells, all but the last column."""
    return ask(
        browser,
        "[...byId('runs').tBodies[0].rows]"
        ".map((row) => [...row.cells].slice(0, -1))"
        ".map((cells) => cells.map((cell) => cell.textContent.trim()))",
    )


def head(browser, k):
    return browser.find_elements("css selector", "#runs thead th button")[k]


def sorts(browser):
    return ask(
        browser,
        "[...byId('runs').tHead.rows[0].cells]"
        ".map((cell) => cell.getAttribute('aria-sort'))",
    )


def test_trajectories_are_decoded_as_python_decodes_them(page, run):
    kept = read_trajectories(run)
    found = ask(
        page,
        "Promise.all(runs.map(async (run) => {"
        " const t = await trajectoryOf(run);"
        " const list = (column) => [...column];"
        " return {key: [report.planners[run.planner].name,"
        "   report.worlds[run.world].index, run.trial], period_s: t.period_s,"
        "  x: list(t.x), y: list(t.y), yaw: list(t.yaw), goal: list(t.goalY),"
        "  command: list(t.commandSpeed), turn: list(t.commandYawRate),"
        "  speed: list(t.speed), yawRate: list(t.yawRate), mode: list(t.mode),"
        "  touching: list(t.touching), ticks: t.paths.map((path) => path.tick),"
        "  paths: t.paths.map((path) => [list(path.x), list(path.y)])};"
        "}))",
    )
    assert {tuple(entry["key"]) for entry in found} == set(kept)
    for entry in found:
        truth = decode(kept[tuple(entry["key"])])
        assert entry["period_s"] == truth.period_s
        for name, column in {
            **dict(zip(("x", "y", "yaw"), truth.poses.T, strict=True)),
            **dict(zip(("command", "turn"), truth.commands.T, strict=True)),
            **dict(zip(("speed", "yawRate"), truth.speeds.T, strict=True)),
            "goal": truth.local_goals[:, 1],
            "mode": truth.modes,
            "touching": truth.touching,
            "ticks": [tick for tick, _ in truth.paths],
        }.items():
            np.testing.assert_allclose(entry[name], column, atol=1e-9, err_msg=name)
        for points, (_, path) in zip(entry["paths"], truth.paths, strict=True):
            np.testing.assert_allclose(np.transpose(points), path, atol=1e-9)


@pytest.mark.parametrize("world", WORLDS)
def test_scans_are_those_of_the_simulated_lidar(page, world):
    """The page's circles against MuJoCo's cylinders, at poses level on the ground."""
    robot, spec = get_robot("jackal"), LidarSpec()
    model = build_model(robot, load_suite("barn300")[world].cylinders_xy())
    simulator, lidar = Simulator(model, robot), Lidar(model, spec)
    for pose in ((-2.0, 3.5, 1.57), (-2.3, 9.9, -2.0), (-1.2, 1.0, 0.3)):
        simulator.reset(np.array(pose))
        expected = lidar.scan(simulator.data)[::BEAM_STEP]
        found = ask(
            page,
            "castScan({x: args[1], y: args[2], yaw: args[3]}, shapesOf("
            "report.worlds.findIndex((world) => world.index === args[0])))"
            ".rays.map((ray) => ray.range)",
            world,
            *pose,
        )
        assert len(found) == 360
        # At rest the robot stands a little off level, and a beam may miss an edge.
        apart = np.abs(np.array(found) - expected)
        assert np.median(apart) < 0.002
        assert (apart < 0.02).mean() > 0.98


def test_a_course_of_any_size_is_drawn_and_its_scans_are_the_lidar_s(browser, tmp_path):
    """A grid that is not square, in another place, without BARN's start box."""
    suite = load_suite(str(store_small_course(tmp_path / "short")))
    settings = Bench(("hlsd10",), str(tmp_path / "short"), trials=1)
    run = run_bench(settings, tmp_path / "run", 1)
    folder = write_report([run], formats=["html"], suite=str(tmp_path / "short")).folder
    size(browser, 1400, 1000)
    browser.get((folder / "report.html").as_uri())
    wait(browser, "replay.trajectory !== null")
    centres = np.array(ask(browser, "shapesOf(0).circles"))[:, :2]
    np.testing.assert_allclose(
        centres[np.lexsort(centres.T)],
        suite[0].cylinders_xy()[np.lexsort(suite[0].cylinders_xy().T)],
        atol=1e-9,
    )
    view = ask(browser, "report.view")
    (left, low), (right, high) = centres.min(axis=0), centres.max(axis=0)
    np.testing.assert_allclose(view["x"], [left - 0.12, right + 0.12], atol=1e-3)
    np.testing.assert_allclose(view["y"], [low - 0.12, high + 0.12], atol=1e-3)
    robot = get_robot("jackal")
    model = build_model(robot, suite[0].cylinders_xy())
    simulator, lidar = Simulator(model, robot), Lidar(model, LidarSpec())
    pose = (1.2, 1.5, 1.3)
    simulator.reset(np.array(pose))
    expected = lidar.scan(simulator.data)[::BEAM_STEP]
    found = ask(
        browser,
        "castScan({x: args[0], y: args[1], yaw: args[2]}, shapesOf(0))"
        ".rays.map((ray) => ray.range)",
        *pose,
    )
    apart = np.abs(np.array(found) - expected)
    assert np.median(apart) < 0.002
    assert (apart < 0.02).mean() > 0.98
    assert [e for e in browser.get_log("browser") if e["level"] == "SEVERE"] == []


def test_a_world_that_moves_is_drawn_as_the_simulator_had_it(browser, tmp_path):
    """Movers where their tracks are at every tick, and scans of shapes that move."""
    stored = store_small_arena(tmp_path / "small")
    suite = load_suite(str(stored))
    run = run_bench(Bench(("pursuit",), str(stored), trials=2), tmp_path / "run", 1)
    folder = write_report([run], formats=["html"], suite=str(stored)).folder
    size(browser, 1400, 1000)
    browser.get((folder / "report.html").as_uri())
    wait(browser, "replay.trajectory !== null")
    blocks = read_trajectories(run)
    world, robot = suite[0], get_robot("jackal")
    simulator = Simulator(build_model(robot, world.shapes, world.movers), robot)
    lidar = Lidar(simulator.model, LidarSpec())
    for trial in (0, 1):
        truth = decode(blocks["pursuit", 0, trial])
        clocks_s = truth.mover_clocks_s()
        for tick in (0, len(truth.commands) // 2, len(truth.commands)):
            wanted = [
                mover.track.at(clocks_s[tick : tick + 1, k])[0]
                for k, mover in enumerate(world.movers)
            ]
            pose = truth.poses[tick]
            circles, boxes, ranges = ask(
                browser,
                "trajectoryOf(runs.find((run) => run.trial === args[0]"
                " && report.worlds[run.world].index === 0)).then((t) => {"
                " const moving = moversAt(0, t, args[1]);"
                " const pose = {x: args[2], y: args[3], yaw: args[4]};"
                " const scan = castScan(pose, together(shapesOf(0), moving));"
                " return [moving.circles, moving.boxes,"
                "  scan.rays.map((ray) => ray.range)]; })",
                trial,
                tick * truth.period_s,
                *pose.tolist(),
            )
            np.testing.assert_allclose(np.array(circles)[:, :2], wanted[::2], atol=2e-3)
            np.testing.assert_allclose(np.array(boxes)[:, :2], wanted[1:2], atol=2e-3)
            simulator.reset(pose)
            simulator.data.mocap_pos[:, :2] = wanted
            apart = np.abs(np.array(ranges) - lidar.scan(simulator.data)[::BEAM_STEP])
            assert np.median(apart) < 0.002
            assert (apart < 0.02).mean() > 0.97
    assert "moving obstacle" in browser.find_element("id", "mode-keys").text
    assert [e for e in browser.get_log("browser") if e["level"] == "SEVERE"] == []


def test_the_table_sorts_by_any_head_and_by_keyboard(page):
    from selenium.webdriver.common.keys import Keys

    first = rows(page)
    assert [row[0] for row in first] == ["12", "12", "240", "240"]
    assert sorts(page)[0] == "ascending"
    head(page, 3).click()
    times = [float(row[3]) for row in rows(page)]
    assert times == sorted(times)
    assert len(set(times)) > 1
    assert sorts(page)[3] == "ascending"
    assert sorts(page).count(None) == len(sorts(page)) - 1
    head(page, 3).send_keys(Keys.ENTER)
    assert [float(row[3]) for row in rows(page)] == times[::-1]
    assert sorts(page)[3] == "descending"


def test_the_table_s_numbers_are_the_rows(page, run):
    episodes = load_episodes(run)
    groups = episodes.groupby(["world", "planner"], sort=False)
    expected = {key: group["path_length_m"].mean() for key, group in groups}
    found = {(int(row[0]), row[1]): float(row[6]) for row in rows(page)}
    assert found == pytest.approx(expected, abs=0.006)


def test_the_table_filters(page):
    text = element(page, "filter-text")
    text.send_keys("240")
    assert {row[0] for row in rows(page)} == {"240"}
    assert element(page, "filter-count").text == "2 of 4 rows"
    text.send_keys(" hlsd")
    assert [(row[0], row[1]) for row in rows(page)] == [("240", "hlsd10")]
    text.clear()
    choose(page, "filter-planner", 0)
    assert {row[1] for row in rows(page)} == {"lfh10"}
    choose(page, "filter-planner", "")
    choose(page, "filter-outcome", "touched")
    assert {row[0] for row in rows(page) if float(row[4]) == 0} == set()
    choose(page, "filter-outcome", "all")
    assert all(row[2] == "2 / 2" for row in rows(page))


def test_a_planner_can_be_hidden_everywhere(page):
    (lfh10,) = (
        button
        for button in page.find_elements("css selector", "#legend button")
        if button.text == "lfh10"
    )
    lfh10.click()
    assert {row[1] for row in rows(page)} == {"hlsd10"}
    assert len(page.find_elements("css selector", "#incidences figure")) == 1
    assert len(page.find_elements("css selector", "#profile .curve")) == 1


def picture(browser, identifier):
    return ask(browser, "byId(args[0]).toDataURL()", identifier)


def test_a_replay_plays_and_pauses(page):
    choose(page, "speed", 0.25)  # not over before it is looked at
    button = element(page, "play")
    assert button.get_attribute("aria-label") == "Play"
    before = picture(page, "stage")
    begun = ask(page, "replay.time_s")
    button.click()
    wait(page, f"replay.time_s > {begun} + 0.3")
    assert button.get_attribute("aria-label") == "Pause"
    button.click()
    wait(page, "!replay.playing")
    stopped, tick = ask(page, "[replay.time_s, Number(byId('slider').value)]")
    assert tick > 0
    assert picture(page, "stage") != before, "the robot moved"
    assert ask(page, "replay.time_s") == stopped, "paused"
    assert element(page, "read-time").text.startswith(f"{stopped:.2f} of ")


def test_a_replay_ends_at_the_goal(page):
    from selenium.webdriver.common.keys import Keys

    element(page, "slider").send_keys(Keys.END)
    time, duration, end, last = ask(
        page,
        "[replay.time_s, duration(), poseAt(replay.trajectory, duration()),"
        " [replay.trajectory.x.at(-1), replay.trajectory.y.at(-1)]]",
    )
    assert time == pytest.approx(duration)
    assert [end["x"], end["y"]] == pytest.approx(last)
    element(page, "play").click()
    wait(page, f"replay.time_s < {duration} / 2")  # from the start again
    element(page, "play").click()


def test_every_run_can_be_chosen(page):
    buttons = page.find_elements("css selector", "#runs tbody .trials button")
    assert len(buttons) == 8
    for button in buttons:
        page.execute_script("arguments[0].click()", button)
        words = button.get_attribute("aria-label")
        wait(page, "replay.trajectory !== null")
        planner, world, trial = ask(
            page,
            "[report.planners[replay.run.planner].name,"
            " report.worlds[replay.run.world].index, replay.run.trial]",
        )
        assert words.startswith(f"Replay {planner} in world {world}, trial {trial}:")
    choose(page, "replay-world", 0)
    choose(page, "replay-planner", 1)
    choose(page, "replay-trial", 1)
    wait(page, "replay.trajectory !== null")
    assert ask(page, "[replay.run.world, replay.run.planner, replay.run.trial]") == [
        0,
        1,
        1,
    ]


def test_maps_are_drawn_when_they_are_seen(page):
    blank = "maps.map(({canvas}) => canvas.toDataURL() === document"
    blank += ".createElement('canvas').toDataURL() || canvas.height === 150)"
    assert all(ask(page, blank)), "far below, not drawn yet"
    page.execute_script("byId('maps').scrollIntoView({behavior: 'instant'})")
    wait(page, f"!({blank}).some(Boolean)")
    maps = page.find_elements("css selector", "#map-grid button")
    assert len(maps) == len(WORLDS)
    maps[1].click()
    wait(page, "replay.trajectory !== null && replay.run.world === 1")
    assert maps[1].get_attribute("aria-current") == "true"


def test_worlds_can_be_ordered_in_other_ways(page):
    offered = ask(page, "[...byId('order').options].map((option) => option.text)")
    assert len(offered) == 6, "five metrics of BARN, and the index: DWA did not drive"
    titles = set()
    for k in range(len(offered)):
        choose(page, "order", k)
        titles.add(page.find_element("css selector", "#regression svg").accessible_name)
    assert len(titles) == len(offered)


def channels(browser, expression):
    """Red, green and blue of a colour in CSS."""
    text = ask(browser, expression)
    return [float(part) for part in text[text.index("(") + 1 : -1].split(",")[:3]]


def contrast(browser):
    """The contrast of text on the page's ground, by WCAG 2."""

    def luminance(rgb):
        linear = [
            v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4
            for v in (channel / 255 for channel in rgb)
        ]
        return float(np.dot(linear, [0.2126, 0.7152, 0.0722]))

    ground = luminance(channels(browser, "resolve('var(--card)')"))
    inks = ("--ink", "--muted", "--accent", "--bad", "--good")
    found = []
    for ink in inks:
        high, low = sorted(
            [luminance(channels(browser, f"resolve('var({ink})')")), ground]
        )[::-1]
        found.append((high + 0.05) / (low + 0.05))
    return min(found), ground


def test_light_and_dark(page):
    least, ground = contrast(page)
    assert ground > 0.8
    assert least > 4.5
    light = picture(page, "stage")
    media(page, "dark")
    wait(page, "byId('theme').textContent === 'Light'")
    least, ground = contrast(page)
    assert ground < 0.1
    assert least > 4.5
    assert picture(page, "stage") != light, "canvases are drawn anew"
    element(page, "theme").click()
    assert contrast(page)[1] > 0.8, "chosen over the system's"
    assert picture(page, "stage") == light


@pytest.mark.parametrize("width", [390, 768, 1400])
def test_nothing_is_wider_than_the_window(page, width):
    size(page, width, 844)
    wait(page, f"innerWidth === {width} && byId('stage').clientWidth < {width}")
    assert ask(page, "document.documentElement.scrollWidth") <= width


def test_every_control_has_a_name(page):
    for control in page.find_elements("css selector", "button, select, input, canvas"):
        if control.is_displayed():
            assert control.accessible_name or control.get_attribute("aria-hidden"), (
                control.get_attribute("outerHTML")[:200]
            )


@pytest.fixture(scope="module")
def failing(run, tmp_path_factory):
    """The same runs, had trial 1 of LfH 1.0 failed in either world."""
    folder = tmp_path_factory.mktemp("failing")
    rows = pd.read_csv(run / "episodes.csv", keep_default_na=False, dtype=str)
    own = (rows["planner"] == "lfh10") & (rows["trial"] == "1")
    rows.loc[own, ["outcome", "time_s"]] = ["timeout", "50.0000"]
    rows.loc[own, "cause"] = ["pocket", "froze"]
    rows.loc[own, "cause_s"] = ["2.0000", "1.2500"]
    rows.to_csv(folder / "episodes.csv", index=False)
    shutil.copy(run / "trajectories.zip", folder)
    return folder


def causes(browser):
    """World, planner and the cell of causes of each row that is shown."""
    return [(row[0], row[1], row[-1]) for row in rows(browser)]


def test_a_cause_is_shown_filtered_and_leads_to_its_moment(browser, failing):
    page = write_report([failing], formats=["html"]).folder / "report.html"
    size(browser, 1400, 1000)
    browser.get(page.as_uri())
    wait(browser, "replay.trajectory !== null")
    assert causes(browser) == [
        ("12", "lfh10", "pocket at 2.00 s"),
        ("12", "hlsd10", ""),
        ("240", "lfh10", "froze at 1.25 s"),
        ("240", "hlsd10", ""),
    ]
    choose(browser, "filter-cause", "froze")
    assert causes(browser) == [("240", "lfh10", "froze at 1.25 s")]
    browser.find_element("css selector", "#runs button.link").click()
    wait(browser, "replay.run.world === 1 && replay.trajectory !== null")
    assert ask(browser, "[replay.run.trial, replay.time_s, replay.playing]") == [
        1,
        1.25,
        False,
    ]
    assert element(browser, "read-time").text.startswith("1.25 of")
    assert ask(browser, "Number(byId('slider').value)") == round(
        1.25 / ask(browser, "replay.trajectory.period_s")
    )
    # The verdict above the replay leads there, too.
    ask(browser, "seek(0)")
    link = browser.find_element("css selector", "#verdict button.link")
    assert link.text == "froze at 1.25 s"
    link.click()
    wait(browser, "replay.trajectory !== null && replay.time_s === 1.25")
    # A run that is chosen otherwise begins at its start.
    choose(browser, "filter-cause", "")
    browser.find_element("css selector", "#runs .trials button").click()
    wait(browser, "replay.run.world === 0 && replay.trajectory !== null")
    assert ask(browser, "replay.time_s") == 0
    assert [e for e in browser.get_log("browser") if e["level"] == "SEVERE"] == []


def test_a_run_that_knew_no_causes_has_none(browser, failing, tmp_path):
    folder = tmp_path / "old"
    folder.mkdir()
    table = pd.read_csv(failing / "episodes.csv", keep_default_na=False, dtype=str)
    table = table.drop(columns=["cause", "cause_s"])
    table.to_csv(folder / "episodes.csv", index=False)
    page = write_report([folder], formats=["html"]).folder / "report.html"
    browser.get(page.as_uri())
    wait(browser, "byId('runs').tBodies[0].rows.length === 4")
    assert {cell for *_, cell in causes(browser)} == {""}
    assert ask(browser, "byId('filter-cause').options.length") == 1
    assert [e for e in browser.get_log("browser") if e["level"] == "SEVERE"] == []


ODD = {
    "one world": lambda rows: rows[rows["world"] == 12],
    "one run": lambda rows: rows[:1],
    "a suite that is not at hand": lambda rows: rows.assign(suite="far-away"),
    "columns that nobody knows": lambda rows: rows.assign(
        contacts="", min_clearance_m="", time_to_contact_s="", robot="", seed=""
    ),
    "failures alone": lambda rows: rows.assign(outcome="timeout", time_s=50.0),
    "another protocol": lambda rows: rows.assign(
        protocol="barn2022", outcome="collision", official_length_m=10.0
    ),
}


@pytest.mark.parametrize("odd", ODD)
def test_odd_runs_make_a_page_without_complaints(browser, run, tmp_path, odd):
    folder = tmp_path / "run"
    folder.mkdir()
    rows = ODD[odd](pd.read_csv(run / "episodes.csv", keep_default_na=False))
    rows.to_csv(folder / "episodes.csv", index=False)
    shutil.copy(run / "trajectories.zip", folder)
    page = write_report([folder], formats=["html", "md"]).folder / "report.html"
    browser.get(page.as_uri())
    wait(browser, "replay.trajectory !== null")
    browser.execute_script("byId('maps').scrollIntoView({behavior: 'instant'})")
    wait(browser, "maps.every((map) => !map.visible || !map.stale)")
    expected = rows.groupby(["world", "planner"]).ngroups
    assert ask(browser, "byId('runs').tBodies[0].rows.length") == expected
    assert [e for e in browser.get_log("browser") if e["level"] == "SEVERE"] == []


def test_a_run_without_trajectories_says_so(browser, run, tmp_path):
    bare = tmp_path / "bare"
    bare.mkdir()
    shutil.copy(run / "episodes.csv", bare)
    folder = write_report([bare], formats=["html"]).folder
    browser.get((folder / "report.html").as_uri())
    browser.execute_script("showReplay({world: 0})")
    wait(browser, "!byId('stage-note').hidden")
    assert "No trajectory" in element(browser, "stage-note").text
    assert not element(browser, "play").is_enabled()
    assert [e for e in browser.get_log("browser") if e["level"] == "SEVERE"] == []


def test_twenty_thousand_rows_stand_on_pages(browser, tmp_path, monkeypatch):
    monkeypatch.setattr(resampling, "MOST_DRAWS", 1)  # as few resamples as there are
    runs = [
        (planner, world, 0, "timeout" if world % 997 == 5 else 5.0 + world % 1000 / 50)
        for planner in ("dwa", "hlsd10")
        for world in range(10_000)
    ]
    folder = write_run(tmp_path / "run", episodes(runs))
    page = write_report([folder], formats=["html"]).folder / "report.html"
    size(browser, 1400, 1000)
    browser.get(page.as_uri())
    wait(browser, "byId('filter-count').textContent === '20000 of 20000 rows'")
    assert len(rows(browser)) == 300
    pages = browser.find_element("id", "runs-pages")
    assert "1 to 300 of 20000" in pages.text
    browser.execute_script("byId('runs-pages').children[4].click()")
    assert "19801 to 20000 of 20000" in pages.text
    assert rows(browser)[-1][:2] == ["9999", "hlsd10"]
    browser.execute_script("document.querySelectorAll('#runs thead button')[3].click()")
    assert "1 to 300 of 20000" in pages.text
    assert {row[3] for row in rows(browser)} < {f"{5 + k / 50:.2f}" for k in range(20)}
    choose(browser, "filter-outcome", "some")
    assert len(rows(browser)) == 2 * 11
    assert not pages.is_displayed(), "one page"
    assert ask(browser, "document.querySelectorAll('#regression .dot').length") == 0
    assert ask(browser, "document.querySelectorAll('#regression .dots').length") >= 1
    maps = ask(browser, "byId('map-grid').children.length")
    assert maps == 300
    browser.execute_script("byId('maps-pages').children[3].click()")
    assert ask(browser, "byId('map-grid').children[0].textContent") == "300"
    assert [e for e in browser.get_log("browser") if e["level"] == "SEVERE"] == []
