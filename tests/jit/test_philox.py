"""Facts about random numbers by counters."""

import numba
import numpy as np
import pytest

from packmech.jit.philox import normal_pair, philox


@numba.njit
def words(a, b, c, d, key, other):
    return philox(a, b, c, d, key, other)


@numba.njit
def normals(count):
    out = np.empty(2 * count)
    for k in range(count):
        a, b, _, _ = philox(np.uint64(k), np.uint64(0), np.uint64(0), np.uint64(0), np.uint64(5), np.uint64(0))
        out[2 * k], out[2 * k + 1] = normal_pair(a, b)
    return out


@pytest.mark.parametrize(
    ("counter", "key", "expected"),
    [
        ((0, 0, 0, 0), (0, 0), (0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8)),
        ((0xFFFFFFFF,) * 4, (0xFFFFFFFF,) * 2, (0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD)),
        (
            (0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344),
            (0xA4093822, 0x299F31D0),
            (0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1),
        ),
    ],
)
def test_the_words_are_those_of_the_authors(counter, key, expected):
    """The known answers of philox4x32-10 that are published with Random123."""
    assert words(*map(np.uint64, counter + key)) == expected


def test_normal_numbers_have_the_moments_of_a_normal_distribution():
    count = 1 << 18
    value = normals(count // 2)
    # standard errors of the first moments of so many numbers
    for power, moment, variance in ((1, 0.0, 1.0), (2, 1.0, 2.0), (3, 0.0, 15.0), (4, 3.0, 96.0), (6, 15.0, 10170.0)):
        assert abs((value**power).mean() - moment) < 4.0 * np.sqrt(variance / count)
    assert abs((value[::2] * value[1::2]).mean()) < 4.0 / np.sqrt(count / 2)
    assert abs((value[:-2] * value[2:]).mean()) < 4.0 / np.sqrt(count)
