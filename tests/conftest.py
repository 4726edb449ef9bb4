"""Where the tests find data of others, in which order they run, what signals do."""

import signal
from pathlib import Path

import pytest

SHARED = Path(__file__).resolve().parents[2] / "shared"

FIRST = (
    # It compiles most kernels; what runs beside it needs few of them.
    "planners/test_shapes.py",
    "project/test_fuzz.py",
    "learning/test_policies.py",
    "run/test_misbehaviour.py",
    "run/test_ray_bench.py",
    "cli/test_cli.py",
    "project/test_how_to.py",
    "project/test_packaging.py",
    "cli/test_surroundings.py",
    "run/test_disasters.py",
    "core/test_ray.py",
    "studies/test_sweep.py",
    "project/test_benchmarks.py",
    "cli/test_exit_codes.py",
    "run/test_trajectory.py",
    "sim/test_robot.py",
    "report/test_report_page.py",
    "planners/test_external.py",
    "data/test_barn_files.py",
    "studies/test_reproduce.py",
    "studies/test_ablation.py",
    "project/test_api.py",
    "report/test_report.py",
    "planners/test_dwa.py",
    "envs/test_vector.py",
    "run/test_identity.py",
    "run/test_failures.py",
    "project/test_docs.py",
    "run/test_external_runs.py",
    "learning/test_train_many.py",
)
"""Modules of more than about 30 s, and those that take long for few tests."""


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Let the longest modules begin, so that no core waits for one at the end.

    Needs `--no-loadscope-reorder`, else the number of a module's tests decides.
    """
    tests = Path(__file__).resolve().parent
    places = {tests / name: place for place, name in enumerate(FIRST)}
    items.sort(key=lambda item: places.get(item.path, len(places)))


def shared(*parts: str) -> Path:
    """A path in the shared data; the test skips where it is absent."""
    path = SHARED.joinpath(*parts)
    if not path.exists():
        pytest.skip(f"needs {'/'.join(parts)} beside the checkout, which is not there")
    return path


def heed_signals() -> None:
    """For `preexec_fn` of a process that is to be ended by a signal.

    A shell that starts the tests in the background has its children ignore SIGINT,
    `nohup` SIGHUP, and they would pass that on.
    """
    for name in ("SIGINT", "SIGHUP", "SIGTERM"):
        if hasattr(signal, name):
            signal.signal(getattr(signal, name), signal.SIG_DFL)
