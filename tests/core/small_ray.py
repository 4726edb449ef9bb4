"""A real Ray cluster of two nodes on this machine, for tests."""

import contextlib
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
import uuid
from pathlib import Path

from tests.core.test_processes import living

ROOT = Path(__file__).resolve().parents[2]


class Cluster:
    """A head with one CPU, and nodes that come and go."""

    def __init__(self):
        self.mark = f"small-ray-{uuid.uuid4().hex}"
        self.folder = tempfile.mkdtemp(prefix="ray-", dir="/tmp")  # sockets: short
        self.address = f"127.0.0.1:{free_port()}"
        # Its ports are open to the network: who has no token runs nothing on it.
        self.access = {"RAY_AUTH_MODE": "token", "RAY_AUTH_TOKEN": uuid.uuid4().hex}

    def __enter__(self):
        port = self.address.rpartition(":")[2]
        self.start(
            *("head", "--head", f"--port={port}", f"--temp-dir={self.folder}/ray"),
            "--include-dashboard=false",
        )
        return self

    def __exit__(self, *_):
        deadline = time.monotonic() + 30
        while left := living(self.mark):
            assert time.monotonic() < deadline, f"{left} live on"
            kill(left)
            time.sleep(0.1)
        shutil.rmtree(self.folder, ignore_errors=True)

    def add(self, name):
        """Start a node beside the head."""
        self.start(name, f"--address={self.address}")

    def lose(self, name):
        """Kill a node's daemon; what it had started must end of itself."""
        daemons = [pid for pid in self.of(name) if "raylet/raylet" in command(pid)]
        assert daemons
        kill(daemons)
        deadline = time.monotonic() + 30
        while left := self.workers(name):
            assert time.monotonic() < deadline, f"{left} live on"
            time.sleep(0.05)
        kill(self.of(name))  # what only writes logs

    def workers(self, name):
        """Processes of a node that do tasks, and those of Ray above them."""
        found = ((pid, command(pid)) for pid in self.of(name))
        return [pid for pid, line in found if "spawn_main" in line or "ray::" in line]

    def of(self, name):
        """Processes of a node."""
        return living(f"{self.mark}-{name}")

    def start(self, name, *options):
        done = subprocess.run(
            [
                *(sys.executable, "-P", "-m", "ray.scripts.scripts", "start"),
                *("--num-cpus=1", "--object-store-memory=100000000", *options),
                *("--disable-usage-stats", "--node-ip-address=127.0.0.1"),
            ],
            env=os.environ
            | {
                "HLSD_TEST_NODE": f"{self.mark}-{name}",
                "RAY_memory_monitor_refresh_ms": "0",
            }
            | self.access,
            cwd=self.folder,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )
        assert done.returncode == 0, done.stdout[-2000:] + done.stderr[-2000:]


def free_port():
    with socket.create_server(("127.0.0.1", 0)) as server:
        return server.getsockname()[1]


def command(pid):
    with contextlib.suppress(OSError):
        return Path(f"/proc/{pid}/cmdline").read_bytes().decode(errors="replace")
    return ""


def kill(pids):
    for pid in pids:
        with contextlib.suppress(ProcessLookupError):
            os.kill(pid, signal.SIGKILL)
