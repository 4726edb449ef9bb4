"""`hlsd view`: a run that goes on is shown as it goes, and notices nothing."""

import contextlib
import csv
import http.client
import json
import os
import signal
import subprocess
import sys
import threading
import time

import pytest

from hlsd.core.errors import HlsdError
from hlsd.report import view
from hlsd.report.view import Door, Viewer
from hlsd.report.write import write_report
from hlsd.run.bench import Bench, resolve, run_bench
from hlsd.run.folder import EPISODES, TIMING, RunFolder
from hlsd.run.following import Following
from hlsd.run.journal import JOURNAL, InUseError
from hlsd.run.row import key_of
from hlsd.run.trajectory import read_trajectories
from tests.conftest import heed_signals
from tests.report.browsing import NEEDS_BROWSER, ask, choose, element, media, size, wait

BENCH = Bench(("pursuit",), worlds="12,240", trials=2)


@pytest.fixture(scope="module")
def finished(tmp_path_factory):
    return run_bench(BENCH, tmp_path_factory.mktemp("runs") / "run", 1)


@pytest.fixture(scope="module")
def driven(finished):
    """Its rows, as a journal has them, with their trajectories, in order."""
    tables = []
    for name in (TIMING, EPISODES):
        with (finished / name).open(newline="") as file:
            tables.append(list(csv.DictReader(file)))
    rows = [timing | row for timing, row in zip(*tables, strict=True)]
    kept = read_trajectories(finished)
    return [(row, kept[key_of(row)]) for row in rows]


@pytest.fixture(scope="module")
def config():
    return resolve(BENCH)


@pytest.fixture
def going(tmp_path, config):
    """A run that another part of this process is driving."""
    with RunFolder(tmp_path / "run", config, {}) as held:
        yield held


def add(folder, driven, *numbers):
    for number in numbers:
        row, block = driven[number]
        folder.append([row], {key_of(row): block})


@pytest.fixture(autouse=True)
def at_once(monkeypatch):
    monkeypatch.setattr(view, "_LEAST_S", 0.0)
    monkeypatch.setattr(view, "_SHARE", 0.0)


@contextlib.contextmanager
def served(viewer):
    door = Door(viewer, 0)
    thread = threading.Thread(target=door.serve, daemon=True)
    thread.start()
    try:
        yield door.address
    finally:
        door.close()
        thread.join(10)


def fetch(address, path="/", host=None):
    """Status, headers and body of an answer."""
    place = address.removeprefix("http://").rstrip("/")
    connection = http.client.HTTPConnection(place, timeout=60)
    connection.request("GET", path, headers={"Host": host or place})
    answer = connection.getresponse()
    body = answer.read()
    connection.close()
    return answer.status, answer.headers, body.decode()


def test_rows_are_shown_as_they_come_and_the_end_is_the_report(
    going, driven, config, tmp_path
):
    with served(Viewer([going.path])) as address:
        status, headers, body = fetch(address)
        assert status == 200
        assert "No episode is done yet" in body
        assert "frame-ancestors 'none'" in headers["Content-Security-Policy"]
        for count, number in enumerate((2, 0, 3), 1):
            add(going, driven, number)
            state = json.loads(fetch(address, "/state")[2])
            assert state["said"] == f"run: {count} of 4 episodes"
        deadline = time.monotonic() + 60
        while "3 of 4 episodes" not in body or "report-data" not in body:
            assert time.monotonic() < deadline
            body = fetch(address)[2]
            time.sleep(0.1)
        lines = body.split('id="report-trajectories">')[1].split("</script>")[0]
        assert sum(map(bool, lines.split("\n"))) == 3, "replays of all that is done"
        add(going, driven, 1)
        going.finish(config.planners)
        going.close()
        while json.loads(fetch(address, "/state")[2])["said"] != "run: finished":
            assert time.monotonic() < deadline
        while 'id="live"' in body:
            assert time.monotonic() < deadline
            body = fetch(address)[2]
            time.sleep(0.1)
    report = write_report([going.path], tmp_path / "report", ["html"])
    assert body == (report.folder / "report.html").read_text("utf-8")


def test_other_hosts_and_paths_are_refused(finished):
    with served(Viewer([finished])) as address:
        place = address.removeprefix("http://").rstrip("/")
        port = place.split(":")[1]
        for host in (
            "evil.example",
            f"evil.example:{port}",
            "127.0.0.1",
            f"[::1]:{port}",
        ):
            for path in ("/", "/state"):
                status, headers, body = fetch(address, path, host)
                assert status == 403, host
                assert "pursuit" not in body
                assert "Access-Control-Allow-Origin" not in headers
        assert fetch(address, "/state", f"localhost:{port}")[0] == 200
        assert fetch(address, "/../run.json")[0] == 404


def test_a_reader_takes_no_lock_and_writes_nothing(going, driven, config):
    add(going, driven, 0)
    before = {p: (p.stat().st_mtime_ns, p.read_bytes()) for p in going.path.glob("*.*")}
    held = Following(going.path)
    assert len(held.rows) == 1
    assert before == {
        p: (p.stat().st_mtime_ns, p.read_bytes()) for p in going.path.glob("*.*")
    }
    with pytest.raises(InUseError):  # the run's own lock stands
        RunFolder(going.path, config, {})
    going.close()
    held.look()
    with RunFolder(going.path, config, {}) as again:  # no lock of the reader's
        assert len(again.finished) == 1
        add(again, driven, 1)
        held.look()
        assert len(held.rows) == 2


def test_a_torn_line_waits_for_its_end_and_a_new_journal_begins_anew(
    going, driven, config
):
    add(going, driven, 0, 1)
    held = Following(going.path)
    file = going.path / JOURNAL
    whole = file.read_bytes()
    cut = len(whole) - 40
    file.write_bytes(whole[:cut])
    torn = Following(going.path)
    assert len(torn.rows) == 1
    with file.open("ab") as more:
        more.write(whole[cut:])
    torn.look()
    assert [*torn.rows] == [*held.rows]
    assert torn.blocks()[key_of(driven[1][0])] == driven[1][1]
    going.close()
    with RunFolder(going.path, config, {}, discard=True):
        torn.look()
        assert len(torn.rows) == 0


@pytest.mark.parametrize("name", ["missing", "empty", "a.csv"])
def test_what_is_no_run_is_refused(tmp_path, name):
    (tmp_path / "empty").mkdir()
    (tmp_path / "a.csv").write_text("a\n")
    with pytest.raises(HlsdError, match=r"no run in .*: give a folder"):
        Viewer([tmp_path / name])


def test_a_port_that_is_taken_is_refused(finished):
    viewer = Viewer([finished])
    with served(viewer) as address:
        port = int(address.rstrip("/").split(":")[-1])
        with pytest.raises(HlsdError, match=rf"port {port} of 127\.0\.0\.1: .*: give"):
            Door(viewer, port)


@pytest.mark.slow
def test_the_command_serves_until_it_is_interrupted(finished):
    command = [sys.executable, "-m", "hlsd", "view", "--no-open", "--port", "0"]
    refused = subprocess.run(
        [*command, "nowhere"], capture_output=True, text=True, timeout=120
    )
    assert refused.returncode == 2
    assert refused.stderr.startswith("hlsd: no run in nowhere")
    process = subprocess.Popen(
        [*command, str(finished)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=heed_signals,
    )
    said = process.stdout.readline()
    address = said.split()[1]
    assert said == f"view: {address} (Ctrl-C ends it)\n"
    assert json.loads(fetch(address, "/state")[2])["said"] == "run: finished"
    os.kill(process.pid, signal.SIGINT)
    _, error = process.communicate(timeout=60)
    assert (process.returncode, error) == (0, "")


class TestInBrowser:
    pytestmark = NEEDS_BROWSER

    def test_the_page_refreshes_itself_and_keeps_the_reader_s_place(
        self, browser, going, driven
    ):
        add(going, driven, 0, 2)
        with served(Viewer([going.path])) as address:
            media(browser, "light")
            size(browser, 1400, 900)
            browser.get(address)
            wait(browser, "replay.trajectory !== null")
            assert element(browser, "live-said").text == "run: 2 of 4 episodes"
            browser.execute_script("load([runs[1]], { time_s: 1.5 })")
            wait(browser, "replay.trajectory !== null && replay.run.id === 1")
            element(browser, "show-scan").click()
            choose(browser, "maps-order", "failures")
            element(browser, "theme").click()
            browser.execute_script("byId('worlds').scrollIntoView()")
            top = ask(browser, "byId('worlds').getBoundingClientRect().top")
            browser.execute_script("window.old = true; document.activeElement.blur()")
            add(going, driven, 1)
            wait(
                browser,
                "!window.old && typeof replay === 'object' && runs.length === 3",
            )
            wait(browser, "replay.trajectory !== null")
            assert ask(browser, "byId('worlds').getBoundingClientRect().top") == (
                pytest.approx(top, abs=3)
            )
            found = ask(
                browser,
                "[report.worlds[replay.run.world].index, replay.run.trial,"
                " replay.time_s, byId('show-scan').checked, byId('maps-order').value,"
                " document.documentElement.dataset.theme]",
            )
            assert found == [240, 0, 1.5, False, "failures", "dark"]
            # Who watches a replay is not disturbed, but told.
            choose(browser, "speed", "0.25")
            browser.execute_script(
                "document.activeElement.blur(); window.old = true; seek(0); play()"
            )
            add(going, driven, 3)
            wait(browser, "!byId('live-now').hidden")
            assert ask(browser, "window.old === true")
            element(browser, "live-now").click()
            wait(browser, "!window.old && runs.length === 4")
        severe = [e for e in browser.get_log("browser") if e["level"] == "SEVERE"]
        assert severe == []
