"""Digests of what a class does: the same in any process, another when it is edited."""

import os
import subprocess
import sys
import threading

import pytest

from hlsd.core.content import content_sha256

DEFINITION = """
import math

LIMIT = 3

class Driver:
    '''A class as a script or a notebook defines it.'''

    names = ("a", "b")

    def __init__(self, gain=2.0):
        self.gain = gain

    def speed(self, word):
        if word in {"stop", "halt", "wait", "whoa"}:
            return 0.0
        return min([self.gain * value for value in range(LIMIT)] + [math.pi])
"""

PRINTS = """
from hlsd.core.content import content_sha256
exec(compile({definition!r}, {name!r}, "exec"))
print(content_sha256({thing}))
"""


def digest_elsewhere(definition, name="cell 1", thing="Driver", seed="0"):
    """The digest that a process of its own finds, with its own order of sets."""
    code = PRINTS.format(definition=definition, name=name, thing=thing)
    result = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
        env=os.environ | {"PYTHONHASHSEED": seed},
    )
    return result.stdout.strip()


def test_another_process_cell_and_line_give_the_same_digest():
    first = digest_elsewhere(DEFINITION)
    moved = digest_elsewhere("\n\n\n" + DEFINITION, name="cell 7", seed="1")
    assert first == moved
    assert len(first) == 64


@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("gain=2.0", "gain=2.5"),
        ("LIMIT = 3", "LIMIT = 4"),
        ('"wait"', '"go"'),
        ('("a", "b")', '("a", "c")'),
        ("math.pi", "math.tau"),
        ("self.gain * value", "self.gain + value"),
    ],
)
def test_an_edit_gives_another(old, new):
    assert DEFINITION.count(old) == 1
    edited = defined(DEFINITION.replace(old, new))
    assert content_sha256(edited) != content_sha256(defined(DEFINITION))
    assert content_sha256(defined(DEFINITION)) == content_sha256(defined(DEFINITION))


def test_objects_differ_by_what_they_hold():
    held = defined(DEFINITION)
    assert content_sha256(held(1.0)) == content_sha256(held(1.0))
    assert content_sha256(held(1.0)) != content_sha256(held(2.0))


def test_what_cannot_be_sent_is_told():
    with pytest.raises(TypeError):
        content_sha256(threading.Lock())


def defined(definition):
    """The class of a definition."""
    space = {"__name__": "__main__"}
    exec(definition, space)
    return space["Driver"]
