"""Tasks on the nodes of a Ray cluster (https://ray.io), several machines for one.

Each CPU of each node gets a seat (`hlsd.core.ray_node.Seat`), a process of Ray that has
tasks done in a worker as `hlsd.core.processes` does here. A worker that is lost is the
fault of its task; a seat or a node that is lost is nobody's, and its tasks are done on
another seat.
"""

import contextlib
import os
import sys
import sysconfig
import time
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any, TypeVar

import cloudpickle

from hlsd.core import ray_cluster, ray_node
from hlsd.core.errors import HlsdError, require_at_least
from hlsd.core.executor import Lost, LostWorkerError, Told
from hlsd.core.importing import path_with_working_directory_last
from hlsd.core.ray_cluster import Node, load_ray
from hlsd.core.software import differing, software
from hlsd.core.text import one_line

T = TypeVar("T")
R = TypeVar("R")

LOOK_S = 3.0
"""Between two looks at the nodes [s]."""
TRIES = 4
"""A task is begun so often, where seats are lost in the middle of it."""
# A node on which so many seats in a row are lost before they are ready is left out.
_FAILED_STARTS = 3
# The second task of a seat waits there, so that it need not wait for the driver.
_AT_A_SEAT = 2
_SAY_AFTER_S = 30.0


class Ray:
    """Runs tasks on a Ray cluster.

    Attributes:
        address: Of the cluster; None is one that is started here.
        jobs: Tasks at a time, at most; None is one for each CPU of the cluster.
        patience_s: How long to wait for a node where none is left [s].
    """

    def __init__(
        self,
        address: str | None = None,
        jobs: int | None = None,
        *,
        patience_s: float = 60.0,
    ) -> None:
        """Nothing is connected or started yet.

        Args:
            address: ``"auto"``, ``"host:port"`` or ``"ray://host:port"``; None starts
                Ray on this machine, or uses the cluster that this process is connected
                to.
            jobs: See the attribute.
            patience_s: Likewise.

        Raises:
            HlsdError: ``jobs`` is below 1.
        """
        if jobs is not None:
            require_at_least(1, "jobs", jobs)
        self.address = address
        self.jobs = jobs
        self.patience_s = patience_s
        self._is_connected = self._is_ours = False
        self._proved: tuple[bytes, set[str]] = b"", set()

    def __enter__(self) -> "Ray":
        self.connect()
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def connect(self) -> None:
        """Connect to the cluster, unless that is done.

        Raises:
            HlsdError: Ray is not installed, or no cluster answers.
        """
        if not self._is_connected:
            self._is_ours = ray_cluster.connect(self.address, self.jobs)
            self._is_connected = True

    def close(self) -> None:
        """Let go of the cluster; a later run connects anew."""
        if self._is_connected and self._is_ours:
            ray_cluster.disconnect()
        self._proved = b"", set()
        self._is_connected = self._is_ours = False

    def run(
        self,
        function: Callable[[T], R],
        tasks: Sequence[T],
        *,
        told: Told | None = None,
    ) -> Iterator[tuple[int, R | Lost]]:
        """See `hlsd.core.executor.Executor.run`; what a task tells comes with its end.

        Raises:
            HlsdError: A node is not fit for the tasks, none is left, or a task was lost
                `TRIES` times with its node.
            Exception: What a task raised.
        """
        if not tasks:
            return
        self.connect()
        work = cloudpickle.dumps(function)
        if self._proved[0] != work:
            self._proved = work, set()
        running = _Running(*self._proved, tasks, self.jobs, self.patience_s)
        try:
            yield from running.results(told)
        finally:
            running.close()


@dataclass(eq=False)
class _Seat:
    """A seat, as the driver knows it."""

    handle: Any
    node: Node
    ready: bool = False
    tasks: deque[int] = field(default_factory=deque)


class _Running:
    """One run of tasks."""

    def __init__(
        self,
        work: bytes,
        proved: set[str],
        tasks: Sequence[object],
        jobs: int | None,
        patience_s: float,
    ) -> None:
        """Nothing is begun yet.

        Args:
            work: The function, pickled.
            proved: Nodes that have been found fit for it; others join them.
            tasks: See `Ray`, as the others.
            jobs: Likewise.
            patience_s: Likewise.
        """
        self._ray = load_ray()
        self._tasks = tasks
        self._jobs = jobs
        self._patience_s = patience_s
        self._waiting = deque(range(len(tasks)))
        self._unfinished = len(tasks)
        self._lost = Counter[int]()
        self._seats: list[_Seat] = []
        # What is under way: the seat, and the task; None is its beginning.
        self._pending: dict[Any, tuple[_Seat, int | None]] = {}
        self._proved = proved
        self._left_out = set[str]()
        self._failed_starts = Counter[str]()
        self._why = ""
        self._room = 0
        self._looked_s = -LOOK_S
        self._alone_s = self._idle_s = time.monotonic()
        self._has_said = False
        self._surroundings = _surroundings()
        self._software = software()
        self._work = self._ray.put(work)
        self._actor = self._ray.remote(
            num_cpus=1, max_restarts=0, max_task_retries=0, max_concurrency=1
        )(_seat_class(self._ray))

    def results(self, told: Told | None) -> Iterator[tuple[int, Any]]:
        """See `Ray.run`."""
        while self._unfinished:
            self._look()
            self._hand_out()
            for reference in self._ended():
                # A seat that was lost takes what it had under way along.
                if reference not in self._pending:
                    continue
                seat, number = self._pending.pop(reference)
                try:
                    answer = self._ray.get(reference)
                except self._ray.exceptions.RayTaskError as error:
                    error.add_note(f"On node {seat.node.address} of the Ray cluster.")
                    raise
                except self._ray.exceptions.RayError as error:
                    self._lose(seat, error)
                    continue
                if number is None:
                    self._begin(seat, *answer)
                    continue
                seat.tasks.remove(number)
                kind, content, said = answer
                if told is not None:
                    for message in said:
                        told(number, cloudpickle.loads(message))
                result = cloudpickle.loads(content)
                if kind == "failed":
                    raise result
                self._unfinished -= 1
                yield number, result

    def close(self) -> None:
        """End all seats, and their workers with them."""
        seats, self._seats = self._seats, []
        for seat in seats:
            self._kill(seat)
        self._pending.clear()

    def _kill(self, seat: _Seat) -> None:
        with contextlib.suppress(Exception):
            self._ray.kill(seat.handle, no_restart=True)

    # ---- Nodes and seats

    def _look(self) -> None:
        """Open seats where there is room, on nodes that came meanwhile, too."""
        now_s = time.monotonic()
        if now_s - self._looked_s < LOOK_S:
            return
        self._looked_s = now_s
        found = [
            node for node in ray_cluster.nodes() if node.number not in self._left_out
        ]
        self._require_nodes(found, now_s)
        self._say_if_idle(now_s)
        limit = min(self._jobs or self._unfinished, self._unfinished)
        self._room = min(limit, sum(node.cpus for node in found))
        # One for each node, then a second one for each, and so on.
        for place in range(max((node.cpus for node in found), default=0)):
            for node in found:
                held = sum(seat.node.number == node.number for seat in self._seats)
                room = node.cpus if node.number in self._proved else 1
                if held <= place < room and len(self._seats) < limit:
                    self._open(node)

    def _require_nodes(self, found: list[Node], now_s: float) -> None:
        if found:
            self._alone_s = now_s
        elif now_s - self._alone_s >= self._patience_s:
            why = f" ({self._why})" if self._why else ""
            raise HlsdError(
                f"no node of the Ray cluster is left for {self._unfinished} of "
                f"{len(self._tasks)} tasks{why}: add one by ray start --address"
            )

    def _say_if_idle(self, now_s: float) -> None:
        if any(seat.ready for seat in self._seats):
            self._idle_s = now_s
        elif now_s - self._idle_s >= _SAY_AFTER_S and not self._has_said:
            self._has_said = True
            _say("waiting for a free CPU of the Ray cluster")

    def _open(self, node: Node) -> None:
        strategy = self._ray.util.scheduling_strategies.NodeAffinitySchedulingStrategy(
            node_id=node.number, soft=False
        )
        handle = self._actor.options(scheduling_strategy=strategy).remote()
        seat = _Seat(handle, node)
        self._seats.append(seat)
        if node.number in self._proved:
            begun = handle.begin.remote(self._surroundings, self._work)
        else:
            begun = handle.prove.remote(self._surroundings, self._work, self._software)
        self._pending[begun] = seat, None

    def _begin(self, seat: _Seat, kind: str, what: Any) -> None:
        """A seat is there: use it, or refuse its node."""
        node = seat.node
        if kind == "found":
            seat.ready = True
            self._failed_starts.pop(node.number, None)
            if node.number not in self._proved:
                self._proved.add(node.number)
                self._looked_s = -LOOK_S  # there is room for more
            return
        if kind == "lacks":
            text = f"cannot load hlsd ({what}): install hlsd "
            text += f"{self._software['hlsd']} there"
        elif kind == "other":
            text = differing(what, self._software)
        else:
            error = cloudpickle.loads(what)
            if not isinstance(error, HlsdError | ImportError):
                raise error
            text = f"cannot do the work: {one_line(str(error))}"
        said = f"node {node.address} of the Ray cluster {text}"
        if not self._proved:
            raise HlsdError(said)
        # It came to a run that others can do.
        _say(f"{said}; it is left out")
        self._leave_out(node, said)
        self._seats.remove(seat)
        self._kill(seat)

    def _leave_out(self, node: Node, why: str) -> None:
        self._left_out.add(node.number)
        self._why = why

    def _lose(self, seat: _Seat, error: Exception) -> None:
        """A seat has ended: what it had to do is done elsewhere, and soon."""
        if seat not in self._seats:
            return
        self._seats.remove(seat)
        self._kill(seat)
        for reference in [r for r, (held, _) in self._pending.items() if held is seat]:
            del self._pending[reference]
        self._why = one_line(str(error).strip().partition("\n")[0], 200)
        if not seat.ready:
            self._failed_starts[seat.node.number] += 1
            if self._failed_starts[seat.node.number] >= _FAILED_STARTS:
                said = (
                    f"node {seat.node.address} of the Ray cluster loses its processes"
                )
                _say(f"{said} ({self._why}); it is left out")
                self._leave_out(seat.node, said)
        # The first was begun; those behind it were not.
        for number in list(seat.tasks)[:1]:
            self._lost[number] += 1
            if self._lost[number] >= TRIES:
                raise LostWorkerError(
                    f"{one_line(str(self._tasks[number]), 80)} was lost {TRIES} times "
                    f"with its process of Ray, last on node {seat.node.address} "
                    f"({self._why}): does Ray end processes there for want of memory?",
                    number=number,
                )
        self._waiting.extendleft(reversed(seat.tasks))
        seat.tasks.clear()

    # ---- Tasks

    def _hand_out(self) -> None:
        """Give tasks to seats, the first to those that have none."""
        ready = [seat for seat in self._seats if seat.ready]
        for depth in range(_AT_A_SEAT):
            for seat in ready:
                # Where tasks are few, each waits for the seat that is free first, be
                # that one which is not there yet.
                if depth and len(self._waiting) <= self._room:
                    return
                if self._waiting and len(seat.tasks) <= depth:
                    number = self._waiting.popleft()
                    task = cloudpickle.dumps(self._tasks[number])
                    seat.tasks.append(number)
                    self._pending[seat.handle.do.remote(task)] = seat, number

    def _ended(self) -> list[Any]:
        """What has come to an end, after a while at most."""
        pending = list(self._pending)
        if not pending:
            time.sleep(LOOK_S / 10)
            return []
        first, _ = self._ray.wait(pending, num_returns=1, timeout=LOOK_S)
        if not first:
            return []
        ended, _ = self._ray.wait(pending, num_returns=len(pending), timeout=0)
        return list(ended)


def _seat_class(ray: Any) -> type:
    """The class of seats, which travels as it is."""
    ray.cloudpickle.register_pickle_by_value(ray_node)
    return ray_node.Seat


def _surroundings() -> ray_node.Surroundings:
    """Where this process works, for seats on this file system."""
    try:
        folder = os.getcwd()
    except OSError:  # it was removed
        folder = ""
    # Python and its packages are each node's own.
    own = {sysconfig.get_path(name) for name in ("stdlib", "platstdlib")}
    path = [
        place
        for place in _path(folder)
        if place not in own
        and os.path.dirname(place) not in own
        and os.path.basename(place) not in ("site-packages", "dist-packages")
        and not place.endswith(".zip")
    ]
    names = ("PYTHONPATH", "HLSD_HOME", "XDG_DATA_HOME")
    return {
        "folder": folder,
        "path": path,
        "environment": {name: os.environ[name] for name in names if name in os.environ},
    }


def _path(folder: str) -> list[str]:
    """The module search path, without the working directory at its end."""
    path = path_with_working_directory_last()
    return path[:-1] if path and path[-1] == folder else path


def _say(text: str) -> None:
    print(f"hlsd: {text}", file=sys.stderr)
