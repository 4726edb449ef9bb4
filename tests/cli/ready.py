"""The command line in a fork of a process that has imported it.

`python -m hlsd` imports for two or three seconds before it does anything. Here a
process imports once; each command runs in a fork of it, with arguments, folder,
environment, streams and exit code of its own, up to the end of its interpreter. What a
variable changes while Python or a library is imported is not seen here.
"""

import atexit
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]

_SERVER = """
import importlib, json, os, pkgutil, runpy, signal, sys, time

import hlsd

rooms = ("analysis", "cli", "core", "data", "learning", "navigation", "planners",
         "report", "run", "sim", "studies")
for found in pkgutil.walk_packages(hlsd.__path__, "hlsd."):
    if found.name.split(".")[1] in rooms:
        importlib.import_module(found.name)
import matplotlib.pyplot

own = os.environ.get("PYTHONPATH", "").split(os.pathsep)  # each order has its own
rest = [each for each in sys.path[1:] if each not in own]
print("ready", flush=True)
for line in sys.stdin:
    order = json.loads(line)
    pid = os.fork()
    if pid == 0:
        break
    deadline = time.monotonic() + order["timeout"]
    while (ended := os.waitpid(pid, os.WNOHANG))[0] == 0:
        if time.monotonic() > deadline:
            os.kill(pid, signal.SIGKILL)
        time.sleep(0.005)
    print(os.waitstatus_to_exitcode(ended[1]), flush=True)
else:
    sys.exit()

os.chdir(order["cwd"])
for number, name, flags in (
    (0, os.devnull, os.O_RDONLY),
    (1, order["stdout"], os.O_WRONLY),
    (2, order["stderr"], os.O_WRONLY),
):
    held = os.open(name, flags)
    os.dup2(held, number)
    os.close(held)
os.environ.clear()
os.environ.update(order["environment"])
given = os.environ.get("PYTHONPATH", "").split(os.pathsep)
sys.path[:] = [os.getcwd(), *filter(None, given), *rest]
sys.argv[:] = ["hlsd", *order["words"]]
exec(order["before"], {"__name__": "before"})
runpy.run_module("hlsd", run_name="__main__", alter_sys=True)
"""

_server: subprocess.Popen[str] | None = None


def _started() -> subprocess.Popen[str]:
    global _server
    if _server is None:
        _server = subprocess.Popen(
            [sys.executable, "-c", _SERVER],
            cwd=ROOT,  # where `-c` finds hlsd
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )
        atexit.register(_end, _server)
        assert _server.stdout.readline() == "ready\n"
    return _server


def _end(server: subprocess.Popen[str]) -> None:
    server.stdin.close()
    server.wait()
    server.stdout.close()


def ready(*words, cwd, timeout=120, before="", **environment):
    """`hlsd WORDS`, as `subprocess.run` would tell of it.

    Args:
        words: Of the command line.
        cwd: The folder where it runs.
        timeout: It is killed after that [s].
        before: Code that runs in its process first.
        environment: Variables beside those of the tests.
    """
    server = _started()
    words = [str(word) for word in words]
    with tempfile.TemporaryDirectory() as folder:
        streams = [Path(folder, name) for name in ("stdout", "stderr")]
        for path in streams:
            path.touch()
        order = {
            "words": words,
            "cwd": str(cwd),
            "timeout": timeout,
            "before": before,
            "environment": {**os.environ, **environment},
            "stdout": str(streams[0]),
            "stderr": str(streams[1]),
        }
        server.stdin.write(json.dumps(order) + "\n")
        server.stdin.flush()
        code = int(server.stdout.readline())
        said = [path.read_text(encoding="utf-8") for path in streams]
    return subprocess.CompletedProcess(["hlsd", *words], code, *said)
