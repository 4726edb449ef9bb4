"""What options of several commands mean when they are left out."""

import os


def cores(jobs: int | None) -> int:
    """Worker processes: as many as were asked for, else all cores."""
    if jobs is not None:
        return jobs
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else 1
