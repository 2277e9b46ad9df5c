# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Sums over long vectors, in an order that does not depend on the machine."""

from __future__ import annotations

from packmech.jit.compiled import device


@device
def dot(a_f, b_f):
    """Return the inner product, summed in eight interleaved parts: fast, and with the same bits everywhere."""
    n = a_f.shape[0]
    s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = 0.0
    whole = n - n % 8
    for k in range(0, whole, 8):
        s0 += a_f[k] * b_f[k]
        s1 += a_f[k + 1] * b_f[k + 1]
        s2 += a_f[k + 2] * b_f[k + 2]
        s3 += a_f[k + 3] * b_f[k + 3]
        s4 += a_f[k + 4] * b_f[k + 4]
        s5 += a_f[k + 5] * b_f[k + 5]
        s6 += a_f[k + 6] * b_f[k + 6]
        s7 += a_f[k + 7] * b_f[k + 7]
    rest = 0.0
    for k in range(whole, n):
        rest += a_f[k] * b_f[k]
    return ((s0 + s4) + (s1 + s5)) + ((s2 + s6) + (s3 + s7)) + rest


@device
def add_to(a_f, factor, b_f):
    """Set a = a + factor b."""
    for k in range(a_f.shape[0]):
        a_f[k] += factor * b_f[k]


@device
def copy_to(a_f, b_f):
    """Set a = b."""
    for k in range(a_f.shape[0]):
        a_f[k] = b_f[k]


@device
def read_places(axes, row, place_f):
    """Copy the positions of the rows to a flat vector."""
    d = len(axes)
    for i in range(row.shape[0]):
        for a in range(d):
            place_f[i * d + a] = row[i, a]


@device
def longest(axes, vector_nd):
    """Return the largest length of a particle's part of the vector."""
    most = 0.0
    for i in range(vector_nd.shape[0]):
        own = 0.0
        for a in range(len(axes)):
            own += vector_nd[i, a] * vector_nd[i, a]
        most = max(most, own)
    return most**0.5
