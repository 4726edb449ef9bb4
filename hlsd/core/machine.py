"""How much of the machine this process may use."""

import math
import os
from pathlib import Path


def cores(jobs: int | None, root: Path = Path("/")) -> int:
    """Tasks at a time: as many as were asked for, else one for each core.

    Cores are those that this process may run on; a control group with a quota of
    processor time, as containers have, counts as that many cores, rounded up.

    Args:
        jobs: What was asked for.
        root: Of the file system in which control groups are looked for.
    """
    if jobs is not None:
        return jobs
    quota = quota_cores(root)
    count = allowed_cores()
    return count if quota is None else max(1, min(count, math.ceil(quota - 1e-6)))


def allowed_cores() -> int:
    """Cores that this process may run on, whatever the quota of its group."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    counted = getattr(os, "process_cpu_count", os.cpu_count)()
    return int(counted or 1)


def quota_cores(root: Path = Path("/")) -> float | None:
    """The least quota of this process's control group and of those above it [cores].

    None where there is none.
    """
    quotas = []
    for line in _text(root / "proc/self/cgroup").splitlines():
        number, _, rest = line.partition(":")
        controllers, _, group = rest.partition(":")
        if number == "0" and not controllers:
            base, read = root / "sys/fs/cgroup", _quota_v2
        elif "cpu" in controllers.split(","):
            base, read = root / "sys/fs/cgroup/cpu", _quota_v1
            if not base.is_dir():
                base = root / "sys/fs/cgroup" / controllers
        else:
            continue
        # A container may see its own group as the root, whatever it is called.
        parts = [part for part in group.split("/") if part not in ("", "..")]
        for depth in range(len(parts), -1, -1):
            quotas.append(read(base.joinpath(*parts[:depth])))
    return min((quota for quota in quotas if quota is not None), default=None)


def memory_limit(root: Path = Path("/")) -> int | None:
    """What a container's control group lets its processes have [bytes].

    None where there is no limit, or none below what the machine has.
    """
    files = ("memory.max", "memory/memory.limit_in_bytes")
    texts = [_text(root / "sys/fs/cgroup" / name).strip() for name in files]
    limits = [int(text) for text in texts if text.isdecimal()]
    return min((limit for limit in limits if limit < memory_of_machine()), default=None)


def memory_of_machine() -> int:
    """Of the machine [bytes]; 0 where the system does not say."""
    try:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    except (AttributeError, ValueError, OSError):
        return 0


def _quota_v2(group: Path) -> float | None:
    return _share(_text(group / "cpu.max").split())


def _quota_v1(group: Path) -> float | None:
    quota, period = (
        _text(group / f"cpu.cfs_{name}_us").strip() for name in ("quota", "period")
    )
    return _share([quota, period])


def _share(words: list[str]) -> float | None:
    """Time per period; None for no limit, or for what is no such thing."""
    try:
        quota, period = (int(word) for word in words)
    except ValueError:
        return None
    return quota / period if quota > 0 and period > 0 else None


def _text(file: Path) -> str:
    try:
        return file.read_text(encoding="utf-8", errors="replace")
    except OSError:
        return ""
