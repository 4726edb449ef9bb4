"""Cores that this process may use: affinity, and quotas of control groups."""

import os

import pytest

from hlsd.core import machine
from hlsd.core.machine import cores


@pytest.fixture(autouse=True)
def eight(monkeypatch):
    monkeypatch.setattr(os, "sched_getaffinity", lambda _pid: set(range(8)), False)


def system(root, files):
    for name, text in files.items():
        file = root / name
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(text)
    return root


V2 = "sys/fs/cgroup"


@pytest.mark.parametrize(
    ("files", "expected"),
    [
        ({}, 8),
        ({"proc/self/cgroup": "0::/\n", f"{V2}/cpu.max": "max 100000\n"}, 8),
        ({"proc/self/cgroup": "0::/\n", f"{V2}/cpu.max": "200000 100000\n"}, 2),
        ({"proc/self/cgroup": "0::/\n", f"{V2}/cpu.max": "150000 100000\n"}, 2),
        ({"proc/self/cgroup": "0::/\n", f"{V2}/cpu.max": "10000 100000\n"}, 1),
        ({"proc/self/cgroup": "0::/\n", f"{V2}/cpu.max": "3200000 100000\n"}, 8),
        (  # the least of a group and those above it
            {
                "proc/self/cgroup": "0::/a/b\n",
                f"{V2}/a/cpu.max": "300000 100000\n",
                f"{V2}/a/b/cpu.max": "500000 100000\n",
            },
            3,
        ),
        (  # a container whose path is that of the host
            {
                "proc/self/cgroup": "0::/../docker/x\n",
                f"{V2}/cpu.max": "400000 100000\n",
            },
            4,
        ),
        (  # version 1, as docker mounts it
            {
                "proc/self/cgroup": "4:cpu,cpuacct:/docker/x\n1:name=systemd:/\n",
                f"{V2}/cpu,cpuacct/cpu.cfs_quota_us": "250000\n",
                f"{V2}/cpu,cpuacct/cpu.cfs_period_us": "100000\n",
            },
            3,
        ),
        (
            {
                "proc/self/cgroup": "4:cpu:/\n",
                f"{V2}/cpu/cpu.cfs_quota_us": "-1\n",
                f"{V2}/cpu/cpu.cfs_period_us": "100000\n",
            },
            8,
        ),
        ({"proc/self/cgroup": "0::/\n", f"{V2}/cpu.max": "what is this\n"}, 8),
        ({"proc/self/cgroup": "0::/\n", f"{V2}/cpu.max": "100000 0\n"}, 8),
        ({"proc/self/cgroup": "rubbish\n"}, 8),
    ],
)
def test_a_quota_bounds_the_cores(tmp_path, files, expected):
    assert cores(None, system(tmp_path, files)) == expected


def test_what_was_asked_for_is_taken(tmp_path):
    files = {"proc/self/cgroup": "0::/\n", f"{V2}/cpu.max": "100000 100000\n"}
    assert cores(5, system(tmp_path, files)) == 5


def test_systems_without_affinity_count_their_cores(tmp_path, monkeypatch):
    """As macOS and Windows do."""
    monkeypatch.delattr(machine.os, "sched_getaffinity")
    monkeypatch.delattr(machine.os, "process_cpu_count", raising=False)
    monkeypatch.setattr(machine.os, "cpu_count", lambda: 6)
    assert cores(None, tmp_path) == 6
    monkeypatch.setattr(machine.os, "cpu_count", lambda: None)
    assert cores(None, tmp_path) == 1
    monkeypatch.setattr(machine.os, "process_cpu_count", lambda: 3, raising=False)
    assert cores(None, tmp_path) == 3
