"""Executors by name: the processes of this machine, or a Ray cluster."""

import contextlib
from collections.abc import Iterator

from hlsd.core.errors import HlsdError, require_at_least, unknown_name
from hlsd.core.executor import Executor
from hlsd.core.machine import cores

EXECUTORS = ("processes", "ray")
"""The names."""


@contextlib.contextmanager
def opened(
    executor: str | Executor, jobs: int | Executor | None, address: str | None
) -> Iterator[int | Executor]:
    """What runs tasks, as a user says it: a number of processes here, or an executor.

    Args:
        executor: One of `EXECUTORS`, or an executor.
        jobs: Tasks at a time; None is one for each core, or each CPU of the cluster. Or
            an executor, where ``executor`` is left at ``"processes"``.
        address: Of a Ray cluster: ``"auto"``, ``"host:port"`` or ``"ray://host:port"``;
            None starts Ray here.

    Raises:
        HlsdError: An unknown name, settings that do not go together, or the cluster
            cannot be used.
    """
    if isinstance(executor, str) and executor not in EXECUTORS:
        raise unknown_name("executor", executor, EXECUTORS)
    if address is not None and executor != "ray":
        raise HlsdError(
            f"address is {address!r}, which only a Ray cluster has: say ray for "
            "`executor`, or leave it out",
            argument="address",
        )
    if jobs is not None and hasattr(jobs, "run"):
        if executor != "processes":
            raise HlsdError("two executors are given, one as jobs: give one of them")
        yield jobs
        return
    if jobs is not None:
        require_at_least(1, "jobs", jobs)
    number = None if jobs is None else int(jobs)
    if executor == "processes":
        yield cores(number)
    elif executor == "ray":
        from hlsd.core.ray_executor import Ray

        with Ray(address, number) as ray:
            yield ray
    else:
        yield _own(executor, number)


def _own(executor: str | Executor, jobs: int | None) -> Executor:
    if isinstance(executor, str) or not hasattr(executor, "run"):
        raise HlsdError(
            f"executor is {executor!r}: give {' or '.join(EXECUTORS)}, or an object "
            "with run (`hlsd.core.executor.Executor`)",
            argument="executor",
        )
    if jobs is not None:
        raise HlsdError(
            f"jobs is {jobs} beside an executor of your own: leave it out",
            argument="jobs",
        )
    return executor
