"""Reports of runs that may still go on, served to this machine: what `hlsd view` does.

A server on the loopback address gives the page of the runs so far and says whether
there is a newer one; the page asks and loads itself anew (``page/live.js``). The runs
are only read (`hlsd.run.following`). A page is made again when rows were added and
somebody has asked lately, and at most a fifth of the time goes into that.
"""

import contextlib
import json
import shlex
import tempfile
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path

from hlsd.analysis.labels import labels_of
from hlsd.analysis.runs import join_runs
from hlsd.core.errors import HlsdError
from hlsd.core.text import one_line
from hlsd.report.page import render_page, render_waiting
from hlsd.report.page_content import (
    Numbers,
    curves_of,
    page_content,
    suite_of,
    tables_of,
)
from hlsd.run.following import Following
from hlsd.run.trajectory import Key, read_trajectories

LOOPBACK = "127.0.0.1"
PORT = 8650
"""Where the page is served if no port is asked for and it is free."""
_LEAST_S = 2.0
_SHARE = 5.0
"""A page is made again after so many times as long as it took, at the earliest."""
_WATCHED_S = 15.0
"""Nobody watches who has not asked for so long."""


@dataclass(frozen=True, slots=True)
class Served:
    """A page.

    Attributes:
        html: What a browser gets.
        number: Of the page, from 1.
        rows: How many episodes it is of.
        finished: Whether all of its runs were finished.
    """

    html: bytes
    number: int
    rows: int
    finished: bool


class Viewer:
    """Pages of some runs, made anew as they go on."""

    def __init__(self, runs: Sequence[Path], suite: str | None = None) -> None:
        """Look at the runs; nothing is made yet.

        Args:
            runs: Folders of runs of one suite and protocol, finished or not.
            suite: Name or folder of their worlds, as of `hlsd.report.write`.

        Raises:
            HlsdError: No run is there, or they do not go together.
        """
        if not runs:
            raise HlsdError("no run is given: give one at least")
        places = [run.resolve() for run in runs]
        for n, place in enumerate(places):
            if place in places[:n]:
                raise HlsdError(f"the run in {str(place)!r} is given twice")
        self._runs, self._suite = list(runs), suite
        self._following = [Following(run) for run in runs]
        self._labels = labels_of(self._runs)
        self._lock = threading.Lock()  # of what was read
        self._making = threading.Lock()
        self._page: Served | None = None
        self._asked_s, self._next_s = 0.0, 0.0
        self._trouble = ""
        with tempfile.TemporaryDirectory(prefix="hlsd-view-") as scratch:
            folders, _ = self._copies(Path(scratch))
            if folders:
                join_runs(folders, whole=self._all_finished())

    def page(self) -> bytes:
        """The newest page; the first is made when it is asked for.

        Raises:
            HlsdError: There is none yet, and the runs cannot be read.
        """
        self._asked_s = time.monotonic()
        with self._making:
            page = self._page or self._make()
        return page.html

    def state(self) -> Mapping[str, object]:
        """What the page asks for: number of the newest, and how far the runs are."""
        self._asked_s = time.monotonic()
        with self._lock:
            self._look()
            said, finished = self._said(), self._all_finished()
        page = self._page
        return {
            "page": 0 if page is None else page.number,
            "said": said,
            "finished": finished,
        }

    def refresh(self) -> None:
        """Make a page if there is news, it is time and somebody watches."""
        now_s = time.monotonic()
        if now_s < self._next_s or now_s > self._asked_s + _WATCHED_S:
            return
        with self._lock:
            self._look()
            rows, finished = self._rows(), self._all_finished()
        page = self._page
        if page is not None and (rows, finished) != (page.rows, page.finished):
            with self._making:
                self._make()

    def _make(self) -> Served:
        """A new page; the last one, where the runs cannot be read."""
        begun_s = time.monotonic()
        try:
            self._page = self._made()
            self._trouble = ""
        except (HlsdError, OSError) as error:
            self._trouble = one_line(error, 500)
            if self._page is None:
                raise HlsdError(self._trouble) from error
        took_s = time.monotonic() - begun_s
        self._next_s = time.monotonic() + max(_LEAST_S, _SHARE * took_s)
        return self._page

    def _made(self) -> Served:
        number = 1 if self._page is None else self._page.number + 1
        with tempfile.TemporaryDirectory(prefix="hlsd-view-") as scratch:
            with self._lock:
                self._look()
                said, rows = self._said(), self._rows()
                finished = self._all_finished()
                folders, blocks = self._copies(Path(scratch))
            live = None if finished else {"page": number, "said": said}
            if not folders:
                html = render_waiting(", ".join(self._labels), live or {})
                return Served(html.encode(), number, rows, finished)
            episodes = join_runs(folders, whole=finished)
            worlds = suite_of(folders, episodes, self._suite)
            tables, pairs = tables_of(episodes)
            orders, shares, firsts = curves_of(episodes, worlds)
            numbers = Numbers(tables, pairs, orders, shares, firsts)
            content = page_content(folders, episodes, worlds, numbers, blocks)
            named = [shlex.quote(str(run)) for run in self._runs]
            html = render_page(replace(content, live=live, runs=named))
            return Served(html.encode(), number, rows, finished)

    def _copies(self, scratch: Path) -> tuple[list[Path], list[Mapping[Key, bytes]]]:
        """A folder with the rows of each run that has some, and their trajectories."""
        folders: list[Path] = []
        blocks: list[Mapping[Key, bytes]] = []
        for run, label, held in zip(
            self._runs, self._labels, self._following, strict=True
        ):
            if held.finished:
                folders.append(run)
                blocks.append(read_trajectories(run))
            elif len(held.rows):
                # Named as the run is, since planners of several runs are told by that.
                copy = scratch / label
                copy.mkdir(parents=True)
                held.copy_to(copy)
                folders.append(copy)
                blocks.append(held.blocks())
        return folders, blocks

    def _look(self) -> None:
        for held in self._following:
            try:
                held.look()
                self._trouble = ""
            except (HlsdError, OSError) as error:  # removed, or being made anew
                self._trouble = one_line(error, 500)

    def _rows(self) -> int:
        return sum(-1 if held.finished else len(held.rows) for held in self._following)

    def _all_finished(self) -> bool:
        return all(held.finished for held in self._following)

    def _said(self) -> str:
        """How far the runs are, in a line."""
        if self._trouble:
            return self._trouble
        parts = []
        for label, held in zip(self._labels, self._following, strict=True):
            if held.finished:
                parts.append(f"{label}: finished")
                continue
            of = "" if held.total is None else f" of {held.total}"
            quiet_s = held.quiet_s
            last = f", the last {quiet_s / 60:.0f} min ago" if quiet_s >= 120 else ""
            parts.append(f"{label}: {len(held.rows)}{of} episodes{last}")
        return one_line("; ".join(parts), 500)


class _Handler(BaseHTTPRequestHandler):
    """Answers GET / and GET /state, to this machine's own addresses alone."""

    server: "_Server"
    protocol_version = "HTTP/1.1"
    server_version = "hlsd"
    sys_version = ""

    def do_GET(self) -> None:
        """Answer, or refuse."""
        # A page from elsewhere whose name was made to lead here (DNS rebinding) asks
        # with that name.
        if self.headers.get_all("Host", []) not in self.server.hosts:
            self._answer(HTTPStatus.FORBIDDEN, "text/plain", b"another host's name\n")
            return
        path = self.path.split("?")[0]
        try:
            if path == "/":
                self._answer(HTTPStatus.OK, "text/html", self.server.viewer.page())
            elif path == "/state":
                state = json.dumps(self.server.viewer.state()).encode()
                self._answer(HTTPStatus.OK, "application/json", state)
            else:
                self._answer(HTTPStatus.NOT_FOUND, "text/plain", b"no such page\n")
        except HlsdError as error:
            text = f"{one_line(error, 2000)}\n".encode()
            self._answer(HTTPStatus.SERVICE_UNAVAILABLE, "text/plain", text)

    def _answer(self, status: HTTPStatus, kind: str, body: bytes) -> None:
        self.send_response(status)
        for name, value in (
            ("Content-Type", f"{kind}; charset=utf-8"),
            ("Content-Length", str(len(body))),
            ("Cache-Control", "no-store"),
            ("X-Content-Type-Options", "nosniff"),
            ("Referrer-Policy", "no-referrer"),
            ("Cross-Origin-Resource-Policy", "same-origin"),
            ("Content-Security-Policy", _POLICY),
        ):
            self.send_header(name, value)
        self.end_headers()
        with contextlib.suppress(ConnectionError):  # the browser has gone on
            self.wfile.write(body)

    def log_message(self, format: str, *args: object) -> None:
        """Say nothing of each request."""


_POLICY = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
    "img-src data:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)


class _Server(ThreadingHTTPServer):
    daemon_threads = True

    def __init__(self, viewer: Viewer, port: int) -> None:
        self.viewer = viewer
        super().__init__((LOOPBACK, port), _Handler)
        names = (LOOPBACK, "localhost")
        self.hosts = [[f"{name}:{self.server_port}"] for name in names]
        if self.server_port == 80:
            self.hosts += [[name] for name in names]


class Door:
    """The viewer's server.

    Attributes:
        address: Where the page is.
    """

    def __init__(self, viewer: Viewer, port: int | None = None) -> None:
        """Take a port.

        Args:
            viewer: Whose pages to serve.
            port: Which; 0 for any free one; None for `PORT`, or any if that is taken.

        Raises:
            HlsdError: The port cannot be had.
        """
        try:
            self._server = _Server(viewer, PORT if port is None else port)
        except (OSError, OverflowError) as error:
            if port is not None:
                why = getattr(error, "strerror", None) or "there is no such port"
                raise HlsdError(
                    f"cannot serve on port {port} of {LOOPBACK}: {why}: give another, "
                    "or 0 for any that is free",
                    argument="port",
                ) from error
            self._server = _Server(viewer, 0)
        self._viewer = viewer
        self.address = f"http://{LOOPBACK}:{self._server.server_port}/"

    def serve(self) -> None:
        """Answer until `close` is called or the process is interrupted."""
        threading.Thread(target=self._keep_fresh, daemon=True).start()
        try:
            self._server.serve_forever(poll_interval=0.2)
        finally:
            self._server.server_close()

    def close(self) -> None:
        """End `serve`, from another thread."""
        self._server.shutdown()

    def _keep_fresh(self) -> None:
        while True:
            with contextlib.suppress(HlsdError):
                self._viewer.refresh()
            time.sleep(0.5)
