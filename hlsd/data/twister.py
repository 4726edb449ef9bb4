"""The Mersenne Twister as Python's ``random.Random`` seeds it, many numbers at a time.

BARN's worlds are drawn by ``random.Random``, anew for each of some 190 maps that are
tried for a world. Compiled, a map's draws take a tenth of the time.

Source: Matsumoto and Nishimura, MT19937 with ``init_by_array`` (2002), and CPython's
``_randommodule.c``, which makes words of the seed and a number of two words.
"""

import numpy as np

from hlsd.core.compiled import compiled
from hlsd.core.types import FloatArray, IntArray

_SIZE = 624
_SHIFT = 397
_MASK = 0xFFFFFFFF


class Twister:
    """Numbers from 0 to below 1, as ``random.Random(seed).random()`` gives them."""

    def __init__(self, seed: int = 0) -> None:
        """Begin.

        Args:
            seed: 0 or positive, of any size.
        """
        self._state = np.zeros(_SIZE + 1, np.int64)
        self.seed(seed)

    def seed(self, seed: int) -> None:
        """Begin anew, as cheaply as a new one.

        Args:
            seed: 0 or positive, of any size.
        """
        words = [seed & _MASK]
        while seed := seed >> 32:
            words.append(seed & _MASK)
        _begin(self._state, np.array(words, np.int64))

    def number(self) -> float:
        """The next number."""
        return float(self.numbers(1, 1)[0, 0])

    def numbers(self, rows: int, columns: int) -> FloatArray:
        """The next numbers, row by row, ``(rows, columns)``."""
        return _numbers(self._state, rows, columns)


@compiled
def _begin(state: IntArray, words: IntArray) -> None:
    """Seed with words of 32 bits, the lowest first; the last entry is the place."""
    state[0] = 19650218
    for k in range(1, _SIZE):
        before = state[k - 1]
        state[k] = (1812433253 * (before ^ (before >> 30)) + k) & _MASK
    k, word = 1, 0
    for _ in range(max(_SIZE, len(words))):
        before = state[k - 1]
        mixed = state[k] ^ ((before ^ (before >> 30)) * 1664525)
        state[k] = (mixed + words[word] + word) & _MASK
        word = (word + 1) % len(words)
        k += 1
        if k == _SIZE:
            state[0] = state[_SIZE - 1]
            k = 1
    for _ in range(_SIZE - 1):
        before = state[k - 1]
        mixed = state[k] ^ ((before ^ (before >> 30)) * 1566083941)
        state[k] = (mixed - k) & _MASK
        k += 1
        if k == _SIZE:
            state[0] = state[_SIZE - 1]
            k = 1
    state[0] = 0x80000000
    state[_SIZE] = _SIZE


@compiled
def _numbers(state: IntArray, rows: int, columns: int) -> FloatArray:
    """The next numbers: 53 bits of two words each."""
    numbers = np.empty((rows, columns))
    for row in range(rows):
        for column in range(columns):
            high = _word(state) >> 5
            low = _word(state) >> 6
            numbers[row, column] = (high * 67108864.0 + low) / 9007199254740992.0
    return numbers


@compiled
def _word(state: IntArray) -> int:
    """The next word of 32 bits."""
    if state[_SIZE] == _SIZE:
        _twist(state)
        state[_SIZE] = 0
    word: int = state[state[_SIZE]]
    state[_SIZE] += 1
    word ^= word >> 11
    word ^= (word << 7) & 0x9D2C5680
    word ^= (word << 15) & 0xEFC60000
    return word ^ (word >> 18)


@compiled
def _twist(state: IntArray) -> None:
    """The next 624 words, before they are tempered."""
    for k in range(_SIZE):
        joined = (state[k] & 0x80000000) | (state[(k + 1) % _SIZE] & 0x7FFFFFFF)
        twisted = (joined >> 1) ^ (0x9908B0DF if joined & 1 else 0)
        state[k] = state[(k + _SHIFT) % _SIZE] ^ twisted
