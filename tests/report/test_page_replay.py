"""The page's replay, tables and foot, on runs whose robots drive along known lines."""

import base64
import io
import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.image import imread

from hlsd.analysis.metrics import METRICS
from hlsd.report import drawing
from hlsd.report.page_tables import single_best
from hlsd.report.tables import Cell
from hlsd.report.write import write_report
from hlsd.run.history import Session, write_history
from hlsd.run.trajectory import ARCHIVE, Trajectory, encode, pack
from tests.report.browsing import NEEDS_BROWSER, ask, choose, element, media, size, wait
from tests.report.test_report import episodes, write_run

START = np.array([-2.25, 5.0, np.pi / 2])
PERIOD_S = 0.05
STYLE = Path(drawing.__file__).parent / "page" / "style.css"


def line(speed_m_s, ticks, heading=(0.0, 1.0), touching=()):
    """A block of a robot that drives along a line."""
    way = speed_m_s * PERIOD_S * np.arange(ticks + 1)
    poses = np.tile(START, (ticks + 1, 1))
    poses[:, :2] += way[:, None] * np.array(heading)
    touched = np.zeros(ticks, np.bool_)
    touched[list(touching)] = True
    return encode(
        Trajectory(
            period_s=PERIOD_S,
            poses=poses,
            commands=np.full((ticks, 2), speed_m_s),
            speeds=np.full((ticks, 2), speed_m_s),
            local_goals=np.ones((ticks, 2)),
            modes=np.zeros(ticks, np.uint8),
            touching=touched,
            paths=(),
        )
    )


RUNS = [
    ("hlsd04", 12, 0, "timeout"),
    ("hlsd04", 12, 1, 20.0),
    ("hlsd04", 240, 0, "timeout"),
    ("hlsd10", 12, 0, 10.0),
    ("hlsd10", 12, 1, 11.0),
    ("hlsd10", 240, 0, 12.0),
]
OUT_M_S = 4.0
BLOCKS = {
    ("hlsd04", 12, 0): line(0.4, 400, touching=range(100, 120)),
    ("hlsd04", 12, 1): line(0.4, 300),
    ("hlsd04", 240, 0): line(OUT_M_S, 60, heading=(1.0, 0.0)),  # leaves the map
    ("hlsd10", 12, 0): line(1.0, 100),
    ("hlsd10", 12, 1): line(1.0, 110),
    ("hlsd10", 240, 0): line(1.0, 120),
}


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    folder = write_run(tmp_path_factory.mktemp("runs") / "lines", episodes(RUNS))
    (folder / ARCHIVE).write_bytes(pack(BLOCKS, list(BLOCKS)))
    sessions = [
        Session("2026-05-04T13:02:11Z", "hlsd bench --planner hlsd04"),
        Session("2026-05-05T08:00:00Z", ""),
    ]
    write_history(folder, sessions, "2026-05-05T08:30:00Z")
    return folder


@pytest.fixture(scope="module")
def file(run):
    return write_report([run], formats=["html"]).folder / "report.html"


@pytest.fixture
def page(browser, file):
    yield from opened(browser, file)


def opened(browser, file, fragment=""):
    media(browser, "light")
    size(browser, 1400, 1000)
    browser.get("about:blank")
    browser.get(file.as_uri() + fragment)
    wait(browser, "replay.trajectory !== null")
    yield browser
    complaints = [
        entry["message"]
        for entry in browser.get_log("browser")
        if entry["level"] in ("SEVERE", "WARNING")
    ]
    assert complaints == []


def moment(planner="hlsd04", world=12, trial=0, time="0.00", more=""):
    return f"#planner={planner}&world={world}&trial={trial}&time={time}{more}"


def go(browser, fragment):
    """Follow a link on the page, as a reader who opens it."""
    browser.execute_script(
        "replay.trajectory = null; location.hash = arguments[0]", fragment
    )
    wait(browser, "replay.trajectory !== null")


def shown(browser):
    return ask(
        browser,
        "[report.planners[replay.run.planner].name,"
        " report.worlds[replay.run.world].index, replay.run.trial,"
        " Math.round(100 * replay.time_s) / 100]",
    )


def count(browser, colour, left=0):
    """How many pixels of the stage have exactly a colour, from a column on."""
    text, url = ask(
        browser, "[resolve(args[0]), byId('stage').toDataURL('image/png')]", colour
    )
    wanted = np.array(re.findall(r"\d+", text)[:3], np.float64) / 255
    pixels = imread(io.BytesIO(base64.b64decode(url.split(",")[1])))[:, left:, :3]
    return int((np.abs(pixels - wanted) < 1 / 512).all(axis=2).sum())


def press(browser, *keys):
    from selenium.webdriver.common.action_chains import ActionChains

    ActionChains(browser).send_keys(*keys).perform()


class TestInBrowser:
    pytestmark = NEEDS_BROWSER

    def test_a_robot_that_left_the_map_is_shown_by_an_arrow(self, page):
        go(page, moment(world=240, time="0.00"))
        assert not element(page, "stage-off").is_displayed()
        go(page, moment(world=240, time="3.00"))
        away = START[0] + 3.0 * OUT_M_S - ask(page, "report.view.x[1]")
        assert away > 3
        said = element(page, "stage-off").text
        assert said.startswith(f"hlsd04 is {away:.1f} m outside the picture")
        colour = ask(page, "planColour(replay.run.planner)")
        width = ask(page, "byId('stage').width")
        assert count(page, colour, left=width - 45) > 200, "the arrow, at the edge"
        # The view follows where that is asked for: it is within the picture then.
        ask(page, "byId('follow').click()")
        assert not element(page, "stage-off").is_displayed()

    @pytest.mark.parametrize("scheme", ["light", "dark"])
    def test_a_contact_is_drawn_in_its_own_colour(self, page, scheme):
        media(page, scheme)
        go(page, moment(time="2.00"))
        assert count(page, "var(--contact)") == 0
        go(page, moment(time="5.50"))
        assert count(page, "var(--contact)") > 50
        assert element(page, "read-contact").text == "touching"

    def test_two_robots_drive_on_one_clock(self, page):
        go(page, moment(time="4.00"))
        assert ask(page, "replay.robots.length") == 1
        offered = ask(page, "[...byId('replay-beside').options].map((o) => o.text)")
        assert offered[0] == "nobody"
        assert len(offered) == 4, "the world's other runs"
        choose(page, "replay-beside", ask(page, "runs.findIndex((r) => r.id === 3)"))
        wait(page, "replay.robots.length === 2")
        assert shown(page) == ["hlsd04", 12, 0, 4.0], "the clock goes on"
        places = ask(page, "replay.robots.map(({ pose }) => pose.y)")
        assert places == pytest.approx([5 + 0.4 * 4, 5 + 1.0 * 4], abs=2e-3)
        assert ask(page, "duration()") == pytest.approx(20.0), "until both have ended"
        ask(page, "seek(15)")
        places = ask(page, "replay.robots.map(({ pose }) => pose.y)")
        assert places == pytest.approx([5 + 0.4 * 15, 5 + 1.0 * 5], abs=2e-3)
        speeds = element(page, "read-speed").text.split("\n")
        assert [text.strip() for text in speeds] == ["0.40 m/s", "1.00 m/s"]
        assert "goal after 10.00 s" in element(page, "verdict-beside").text
        # Another world keeps the planner beside; without one there is nobody.
        choose(page, "replay-world", 1)
        wait(page, "replay.robots.length === 2")
        assert ask(page, "report.planners[replay.beside.run.planner].name") == "hlsd10"
        choose(page, "replay-beside", "")
        wait(page, "replay.robots.length === 1")
        assert not element(page, "verdict-beside").is_displayed()

    def test_a_link_leads_to_its_moment(self, browser, file):
        link = moment("hlsd10", 12, 1, "2.50", "&beside=hlsd04&beside_trial=1")
        for page in opened(browser, file, link):
            assert shown(page) == ["hlsd10", 12, 1, 2.5]
            assert ask(page, "replay.beside.run.id") == 1
            top = ask(page, "byId('replay').getBoundingClientRect().top")
            assert 0 <= top < 200, "the replay is in sight"
            page.execute_script("location.hash = arguments[0]", moment("hlsd10", 99, 1))
            wait(page, "byId('replay-said').textContent !== ''")
            assert shown(page) == ["hlsd10", 12, 1, 2.5], "left as it was"
            said = element(page, "replay-said").text
            assert "hlsd10, world 99, trial 1, which is not on this page" in said
            go(page, moment("hlsd10", 12, 1, "1e9"))
            assert shown(page)[3] == pytest.approx(5.5), "its end"

    def test_back_and_forward_go_through_the_runs(self, page):
        first = shown(page)
        assert ask(page, "location.hash") == ""
        choose(page, "replay-planner", 1)
        wait(page, "location.hash.includes('hlsd10')")
        ask(page, "seek(1.5), noteSoon()")
        wait(page, "location.hash.includes('time=1.50')")
        choose(page, "replay-world", 1)
        wait(page, "location.hash.includes('world=240')")
        page.back()
        wait(page, "replay.time_s === 1.5")
        assert shown(page) == ["hlsd10", 12, 0, 1.5]
        page.back()
        wait(page, "report.planners[replay.run.planner].name === 'hlsd04'")
        assert shown(page) == first
        page.forward()
        wait(page, "replay.time_s === 1.5")

    def test_the_link_is_copied(self, page):
        page.execute_script(
            "Object.defineProperty(navigator, 'clipboard', { value:"
            " { writeText: async (text) => { window.copied = text; } } });"
        )
        go(page, moment("hlsd10", 240, 0, "1.00"))
        element(page, "copy-link").click()
        wait(page, "byId('replay-said').textContent !== ''")
        assert element(page, "replay-said").text == "The link is copied."
        assert ask(page, "copied === location.href")
        assert ask(page, "copied").endswith(moment("hlsd10", 240, 0, "1.00"))

    def test_keys_drive_the_replay(self, page):
        from selenium.webdriver.common.keys import Keys

        page.execute_script("byId('replay').scrollIntoView()")
        press(page, Keys.ARROW_RIGHT, Keys.ARROW_RIGHT, Keys.ARROW_RIGHT)
        press(page, Keys.ARROW_LEFT)
        assert ask(page, "replay.time_s") == pytest.approx(2 * PERIOD_S)
        press(page, "+", "+")
        assert element(page, "speed").get_attribute("value") == "4"
        press(page, "-")
        assert element(page, "speed").get_attribute("value") == "2"
        press(page, Keys.SPACE)
        wait(page, "replay.playing && replay.time_s > 0.2")
        press(page, Keys.SPACE)
        assert not ask(page, "replay.playing")
        for keys, wanted in (
            ("n", ["hlsd04", 12, 1, 0]),
            ("n", ["hlsd04", 240, 0, 0]),
            ("p", ["hlsd04", 12, 1, 0]),
            ("P", ["hlsd04", 12, 0, 0]),
            ("N", ["hlsd04", 240, 0, 0]),
        ):
            press(page, keys)
            wait(page, "replay.trajectory !== null")
            assert shown(page) == wanted, keys
        press(page, "N")
        said = element(page, "replay-said").text
        assert said == "hlsd04 has no failure after this one."
        press(page, "?")
        assert element(page, "keys").is_displayed()
        press(page, Keys.SPACE)
        press(page, Keys.ESCAPE)
        assert not element(page, "keys").is_displayed()

    def test_keys_leave_texts_and_the_page_alone(self, page):
        from selenium.webdriver.common.keys import Keys

        before = shown(page)
        element(page, "filter-text").send_keys("n 2+?")
        assert element(page, "filter-text").get_attribute("value") == "n 2+?"
        page.execute_script("document.activeElement.blur(); scrollTo(0, 0)")
        press(page, Keys.SPACE)
        wait(page, "scrollY > 200")
        assert shown(page) == before
        assert not ask(page, "replay.playing")

    def test_what_a_metric_is_stands_beside_it(self, page):
        from selenium.webdriver.common.keys import Keys

        def head(table, name):
            css = f"#{table} th[data-metric='{name}'] button"
            return page.find_element("css selector", css)

        tip = element(page, "metric-tip")
        for table, name in (
            ("table-summary", "time_s"),
            ("table-pairs_time_s", "time_s"),
            ("runs", "min_clearance_m"),
        ):
            page.execute_script("arguments[0].focus()", head(table, name))
            assert METRICS[name].definition in tip.text
            assert METRICS[name].source in tip.text
            assert f"[{METRICS[name].unit}]" in tip.text
            box = ask(page, "byId('metric-tip').getBoundingClientRect().toJSON()")
            assert 0 <= box["left"] < box["right"] <= 1400
            assert head(table, name).get_attribute("aria-describedby") == "metric-tip"
            press(page, Keys.ESCAPE)
            assert not tip.is_displayed()

    def test_planners_stand_in_order_and_the_best_is_marked(self, page):
        def names():
            rows = page.find_elements("css selector", "#table-summary tbody th")
            return [row.text.strip() for row in rows]

        assert names() == ["hlsd10", "hlsd04"], "by time, not as they were named"
        legend = page.find_elements("css selector", "#legend button")
        assert [button.text for button in legend] == ["hlsd10", "hlsd04"]
        head = "#table-summary th[data-metric='time_s']"
        cell = page.find_element("css selector", head)
        assert cell.get_attribute("aria-sort") == "ascending"
        cell.find_element("css selector", "button").click()
        assert names() == ["hlsd04", "hlsd10"]
        assert cell.get_attribute("aria-sort") == "descending"
        page.find_element("css selector", "#table-summary th button").click()
        assert names() == ["hlsd10", "hlsd04"]

    def test_worlds_without_an_order_are_sorted_by_each_planner_s_times(self, page):
        choose(page, "order", ask(page, "report.regression.orders.length - 1"))
        paths = ask(
            page,
            "[...document.querySelectorAll('#regression .curve')]"
            ".map((path) => path.getAttribute('d'))",
        )
        assert len(paths) == 2
        assert page.find_elements("css selector", "#regression .band") == []
        for path in paths:
            heights = [float(pair.split()[1]) for pair in path[1:].split("L")]
            assert heights == sorted(heights, reverse=True), "slower is higher up"
        assert "sorted" in element(page, "order-said").text

    def test_wide_tables_say_that_they_scroll(self, page):
        cue = "#summary .cue"
        assert not page.find_element("css selector", cue).is_displayed()
        size(page, 390, 844)
        wait(page, "innerWidth === 390 && !document.querySelector('.cue').hidden")
        first = page.find_element("css selector", cue)
        assert first.text == "More columns to the right →"
        page.execute_script(
            "document.querySelector('#summary .scroll').scrollLeft = 1e6"
        )
        wait(page, "document.querySelector('.cue').textContent.includes('left')")
        assert first.text == "More columns ← to the left"
        assert ask(page, "document.documentElement.scrollWidth") <= 390

    def test_one_planner_in_one_world_has_no_empty_card(self, browser, tmp_path):
        folder = write_run(tmp_path / "run", episodes(RUNS[:2]))
        file = write_report([folder], formats=["html"]).folder / "report.html"
        browser.get(file.as_uri())
        wait(browser, "byId('runs').tBodies[0].rows.length === 1")
        sections = ask(
            browser, "[...document.querySelectorAll('section')].map((s) => s.id)"
        )
        links = ask(
            browser,
            "[...document.querySelectorAll('nav a')].map((a) => a.hash.slice(1))",
        )
        assert links == sections
        assert not {"pairs", "difficulty"} & set(sections)
        assert [e for e in browser.get_log("browser") if e["level"] == "SEVERE"] == []


def luminous(colour):
    """A colour's place in OKLab, in hundredths."""
    rgb = np.array([int(colour[k : k + 2], 16) / 255 for k in (1, 3, 5)])
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    cones = linear @ np.array(
        [
            [0.4122214708, 0.2119034982, 0.0883024619],
            [0.5363325363, 0.6806995451, 0.2817188376],
            [0.0514459929, 0.1073969566, 0.6299787005],
        ]
    )
    return (
        100
        * np.cbrt(cones)
        @ np.array(
            [
                [0.2104542553, 1.9779984951, 0.0259040371],
                [0.7936177850, -2.4285922050, 0.7827717662],
                [-0.0040720468, 0.4505937099, -0.8086757660],
            ]
        )
    )


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_no_planner_has_the_colour_of_a_contact(scheme):
    pair = re.search(r"--contact: light-dark\((#\w+), (#\w+)\)", STYLE.read_text())
    contact = luminous(pair[1 if scheme == "light" else 2])
    known = [*drawing.SHADES, *(f"other {k}" for k in range(8))]
    for name, shades in drawing.planner_shades(known).items():
        apart = np.linalg.norm(luminous(getattr(shades, scheme)) - contact)
        assert apart > 12, (name, apart)


def cells(*intervals):
    return [Cell("", (low + high) / 2, low, high, "…") for low, high in intervals]


@pytest.mark.parametrize(
    ("metric", "intervals", "best"),
    [
        ("time_s", [(5, 6), (7, 8), (6.5, 9)], 0),
        ("time_s", [(5, 7), (6, 8)], None),
        ("success", [(0.1, 0.2), (0.5, 0.9)], 1),
        ("success", [(0.1, 0.6), (0.5, 0.9)], None),
        ("success_time_s", [(5, 6), (7, 8)], None),
        ("time_s", [(5, 6)], None),
    ],
)
def test_the_best_is_marked_where_its_interval_lies_apart(metric, intervals, best):
    assert single_best(cells(*intervals), METRICS[metric]) == best


def test_without_intervals_nobody_is_the_best():
    held = [Cell("5", 5.0), Cell("9", 9.0)]
    assert single_best(held, METRICS["time_s"]) is None


def test_the_foot_says_where_the_rows_are_from(file, run):
    text = file.read_text(encoding="utf-8").split('<footer class="wide"')[1]
    assert "2026-05-04T13:02:11Z: <code>hlsd bench --planner hlsd04</code>" in text
    assert "went on</dt><dd>2026-05-05T08:00:00Z: from Python" in text
    assert "ended</dt><dd>2026-05-05T08:30:00Z" in text
    assert re.search(
        r"SHA-256 of rows \(episodes.csv\)</dt><dd><code>[0-9a-f]{64}", text
    )


def test_a_run_that_recorded_no_date_says_so(run, tmp_path):
    folder = write_run(tmp_path / "old", episodes(RUNS))
    file = write_report([folder], formats=["html"]).folder / "report.html"
    text = file.read_text(encoding="utf-8")
    assert "at a time that was not recorded" in text
