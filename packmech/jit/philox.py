# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Random numbers by counters: what is drawn depends on a key and a place in a table, not on what was drawn before.

Philox4x32 of ten rounds: J. K. Salmon, M. A. Moraes, R. O. Dror and D. E. Shaw, Parallel random numbers: as easy as 1,
2, 3, Proc. SC11 (2011), https://doi.org/10.1145/2063384.2063405.
"""

from __future__ import annotations

import math

import numpy as np

from packmech.jit.compiled import inlined

_LOW, _HALF = np.uint64(0xFFFFFFFF), np.uint64(32)
_FIRST, _SECOND = np.uint64(0xD2511F53), np.uint64(0xCD9E8D57)
_KEY_FIRST, _KEY_SECOND = np.uint64(0x9E3779B9), np.uint64(0xBB67AE85)
_ROUNDS = 10


@inlined
def philox(a, b, c, d, key, other_key):
    """Return four words of 32 bits for a counter of four and a key of two, all held in 64 bits without sign."""
    for _ in range(_ROUNDS):
        one, other = _FIRST * a, _SECOND * c
        a, b, c, d = (other >> _HALF) ^ b ^ key, other & _LOW, (one >> _HALF) ^ d ^ other_key, one & _LOW
        key, other_key = (key + _KEY_FIRST) & _LOW, (other_key + _KEY_SECOND) & _LOW
    return a, b, c, d


@inlined
def normal_pair(a, b):
    """Return two independent standard normal numbers of two words of 32 bits (Box and Muller)."""
    size = math.sqrt(-2.0 * math.log((np.float64(a) + 0.5) * 2.0**-32))
    angle = 2.0 * math.pi * 2.0**-32 * (np.float64(b) + 0.5)
    return size * math.cos(angle), size * math.sin(angle)
