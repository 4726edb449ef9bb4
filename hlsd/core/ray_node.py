"""What runs on a node of a Ray cluster: a seat, the process that keeps one worker.

The class travels as it is (`hlsd.core.ray_executor`), so that a node which lacks hlsd
can say so: nothing of hlsd is imported before a method is called.
"""

import os
import sys
from collections.abc import Mapping
from typing import Any

Surroundings = Mapping[str, Any]
"""Where the driver works: ``folder``, ``path`` and ``environment``."""


class Seat:
    """A process of a node that has tasks done in a worker of its own.

    Foreign code runs in the worker, which may be lost without this process.
    """

    def __init__(self) -> None:
        self._pool: Any = None
        self._work = b""

    def prove(
        self, surroundings: Surroundings, work: bytes, ours: Mapping[str, str]
    ) -> tuple[str, Any]:
        """See whether this node can do the work.

        Args:
            surroundings: Where the driver works.
            work: The function of the tasks, pickled.
            ours: The driver's software (`hlsd.core.software`).

        Returns:
            ``"lacks"`` and what cannot be imported; ``"other"`` and this node's
            software; ``"failed"`` and an error, pickled; or ``"found"`` and "".
        """
        _settle(surroundings)
        try:
            import cloudpickle

            from hlsd.core.executor import Lost
            from hlsd.core.processes import Pool
            from hlsd.core.software import require_found, software
        except ImportError as error:
            return "lacks", str(error)
        # In a worker, which may find other modules than this process has loaded.
        with Pool(1) as pool:

            def told(*_: object) -> None:
                return None

            def call(function: Any, task: object) -> Any:
                pickled = cloudpickle.dumps(function), [cloudpickle.dumps(task)]
                ((_, ended),) = list(pool.run_pickled(*pickled, told=told))
                return ended

            found = call(software, None)
            if isinstance(found, Lost) or found.failed:
                return "lacks", "its worker does not start"
            theirs = cloudpickle.loads(found.content)
            if theirs != ours:
                return "other", theirs
            proof = call(require_found, work)
            # A planner that ends its process does so in its episodes, too.
            if not isinstance(proof, Lost) and proof.failed:
                return "failed", proof.content
        return self.begin(surroundings, work)

    def begin(self, surroundings: Surroundings, work: bytes) -> tuple[str, Any]:
        """Be ready to do tasks."""
        _settle(surroundings)
        from hlsd.core.processes import Pool

        self._pool, self._work = Pool(1), work
        self._pool.__enter__()
        return "found", ""

    def do(self, task: bytes) -> tuple[str, bytes, list[bytes]]:
        """Have a task done.

        Returns:
            ``"done"`` with the result, ``"failed"`` with the error or ``"lost"`` with
            an `hlsd.core.executor.Lost`, pickled, and what the task told before.
        """
        import cloudpickle

        from hlsd.core.executor import Lost

        said: list[bytes] = []

        def told(_number: int, message: bytes) -> None:
            said.append(message)

        # To its end, as a pool that is left early ends its worker.
        ((_, ended),) = list(self._pool.run_pickled(self._work, [task], told=told))
        if isinstance(ended, Lost):
            return "lost", cloudpickle.dumps(ended), said
        return "failed" if ended.failed else "done", ended.content, said


def _settle(surroundings: Surroundings) -> None:
    """Find what the driver finds, as far as it is on this node.

    Packages are this node's own; folders of the user are looked into as there.
    """
    folder = surroundings["folder"]
    if os.path.isdir(folder):
        os.chdir(folder)
    places = [place for place in surroundings["path"] if os.path.exists(place)]
    own = [held for held in sys.path if held not in ("", folder, *places)]
    # The working directory last, unless the user put it elsewhere.
    sys.path[:] = [*places, *own, *([] if folder in places else [folder])]
    for name, value in surroundings["environment"].items():
        if any(map(os.path.exists, value.split(os.pathsep))):
            os.environ[name] = value
