"""A connection to a Ray cluster, or to one that is started here.

Ray takes more than ten minutes to give up an address where nobody answers, and talks
meanwhile. So an address is tried before, and what Ray says is kept from the terminal.
"""

import contextlib
import importlib
import logging
import os
import secrets
import signal
import socket
import subprocess
import sys
import threading
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from hlsd.core.errors import HlsdError
from hlsd.core.machine import cores
from hlsd.core.text import one_line

_REACH_S = 5.0
_ANSWER_S = 20.0
# Rows and trajectories are small; what is larger, Ray keeps on disk [bytes].
_STORE_BYTES = 200 * 2**20


@dataclass(frozen=True, slots=True)
class Node:
    """A machine of a cluster, or a part of one.

    Attributes:
        number: Ray's own.
        address: Of the machine.
        cpus: How many processes it takes.
    """

    number: str
    address: str
    cpus: int


def load_ray() -> Any:
    """The package.

    Raises:
        HlsdError: It is not installed.
    """
    try:
        with _quiet():
            ray = importlib.import_module("ray")
        if not hasattr(ray, "init"):  # a folder of this name
            del sys.modules["ray"]
            raise ImportError("No module named 'ray'")
        return ray
    except ImportError as error:
        raise HlsdError(
            f"`executor` is ray, which cannot be loaded ({error}): pip install "
            '"hlsd[ray]"',
            argument="executor",
        ) from error


def connect(address: str | None, jobs: int | None) -> bool:
    """Connect this process to a cluster, unless it is.

    Args:
        address: ``"auto"``, ``"host:port"`` or ``"ray://host:port"``; None starts Ray
            here.
        jobs: Processes at a time, where Ray is started here; None is one for each core.

    Returns:
        Whether it was connected now.

    Raises:
        HlsdError: Ray is not installed, or no cluster answers.
    """
    ray = load_ray()
    if ray.is_initialized():
        if address is not None:
            raise HlsdError(
                f"address is {address!r}, but this process is connected to a Ray "
                "cluster already: leave out `address` to use it",
                argument="address",
            )
        return False
    settings: dict[str, Any] = {"address": address}
    if address is None:
        settings = {
            "address": "local",
            "num_cpus": cores(jobs),
            "include_dashboard": False,
            "object_store_memory": _STORE_BYTES,
            # A planner that takes all memory is ended by the system, which ends its
            # worker alone.
            "_system_config": {"memory_monitor_refresh_ms": 0},
        }
        # Ray asks for a token where it starts by itself, and would leave one in the
        # user's home, which changes what `ray start` does from then on.
        _set_for_now(RAY_AUTH_TOKEN=_TOKEN)
    else:
        _require_answer(address)
    try:
        with _quiet(), _signals_kept():
            ray.init(log_to_driver=False, logging_level=logging.ERROR, **settings)
    except Exception as error:
        raise _no_cluster(address, str(error)) from error
    return True


def nodes() -> list[Node]:
    """The nodes that are there and take processes, in the order of their addresses."""
    found = [
        Node(
            str(held["NodeID"]),
            str(held["NodeManagerAddress"]),
            int(held["Resources"].get("CPU", 0)),
        )
        for held in load_ray().nodes()
        if held["Alive"]
    ]
    found = [node for node in found if node.cpus > 0]
    return sorted(found, key=lambda node: (node.address, node.number))


def disconnect() -> None:
    """Let go of the cluster; one that was started here ends."""
    with contextlib.suppress(Exception), _quiet():
        load_ray().shutdown()
    while _set:
        os.environ.pop(_set.pop(), None)


def _require_answer(address: str) -> None:
    """See that a cluster answers within seconds, in a process that can be ended."""
    if address.startswith("ray://"):
        host, _, port = address.removeprefix("ray://").rpartition(":")
        _require_listener(address, host, port)
        return
    if address != "auto":
        host, _, port = address.rpartition(":")
        _require_listener(address, host, port)
    command = [sys.executable, "-P", "-m", "ray.scripts.scripts", "health-check"]
    if address != "auto":
        command += ["--address", address]
    try:
        done = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            errors="replace",
            timeout=_ANSWER_S,
            check=False,
        )
    except subprocess.TimeoutExpired as error:
        raise _no_cluster(
            address, f"no answer of Ray within {_ANSWER_S:g} s"
        ) from error
    if "AuthenticationError" in done.stderr:
        raise _no_cluster(
            address,
            "it asks for its token: set RAY_AUTH_MODE to token, and RAY_AUTH_TOKEN or "
            "RAY_AUTH_TOKEN_PATH",
        )
    if done.returncode != 0:
        lines = [line for line in done.stderr.splitlines() if line.strip()]
        raise _no_cluster(address, lines[-1] if lines else "")


def _set_for_now(**variables: str) -> None:
    """Set variables of the environment that are not set, until `disconnect`."""
    # With the token, Ray sets the mode, which is to go with it.
    _set.update({*variables, "RAY_AUTH_MODE"} - os.environ.keys())
    for name, value in variables.items():
        os.environ.setdefault(name, value)


_set = set[str]()
# One for the life of the process, as Ray reads it once.
_TOKEN = secrets.token_hex(32)


def _require_listener(address: str, host: str, port: str) -> None:
    if not host or not port.isdecimal() or not 0 < int(port) < 65536:
        raise HlsdError(
            f"address is {address!r}: give auto, host:port or ray://host:port",
            argument="address",
        )
    try:
        socket.create_connection((host.strip("[]"), int(port)), _REACH_S).close()
    except (OSError, UnicodeError) as error:
        raise _no_cluster(address, str(error)) from error


def _no_cluster(address: str | None, why: str) -> HlsdError:
    said = one_line(why.strip().partition("\n")[0], 200)
    if address is None:
        return HlsdError(f"Ray does not start on this machine: {said}")
    return HlsdError(
        f"address is {address!r}, where no Ray cluster can be used ({said}): start one "
        "with ray start --head, or leave `address` out",
        argument="address",
    )


@contextlib.contextmanager
def _quiet() -> Iterator[None]:
    """Within, Ray is begun without words, and tells nobody that it is used."""
    wanted = {
        "RAY_USAGE_STATS_ENABLED": "0",
        "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",
    }
    missing = [name for name in wanted if name not in os.environ]
    os.environ.update({name: wanted[name] for name in missing})
    try:
        yield
    finally:
        for name in missing:
            os.environ.pop(name, None)


@contextlib.contextmanager
def _signals_kept() -> Iterator[None]:
    """Within, Ray may set how this process takes signals; afterwards all is as it was.

    Ray ends at the exit of the process in any case.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    kept = {number: signal.getsignal(number) for number in (signal.SIGTERM,)}
    try:
        yield
    finally:
        for number, handler in kept.items():
            signal.signal(number, handler)
