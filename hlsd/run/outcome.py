"""How an episode ended, and why a planner ended it."""

from enum import StrEnum

from hlsd.planners.driving import ErrorKind as ErrorKind


class Outcome(StrEnum):
    """How an episode ended.

    Members:
        SUCCESS: The goal was reached within the limit.
        TIMEOUT: The limit passed.
        COLLISION: A contact ended the run, under a protocol where contacts do.
        ERROR: The planner ended it; the row's ``reason`` says how, first its kind.
    """

    SUCCESS = "success"
    TIMEOUT = "timeout"
    COLLISION = "collision"
    ERROR = "error"


ERROR_KINDS = tuple(kind.value for kind in ErrorKind)
"""The kinds that begin a reason."""
