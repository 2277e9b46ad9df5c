"""Sparse systems A^T D A of contact networks: one d x d block per particle and per pair, factored again and again.

A contact with stiffness `along` its normal and `across` it couples the displacements of its two particles through
K = across 1 + (along - across) n n. The pattern depends on the pairs alone, so it is analyzed once; a factorization
then costs the numbers only. A particle's own image moves with it and adds nothing here.
"""

from __future__ import annotations

import functools
import importlib.util
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.check import one_of
from packmech.contacts.network import distinct_pairs
from packmech.jit.compiled import device, kernel
from packmech.linalg.block_factor import factor_blocks, plan_blocks, solve_blocks
from packmech.linalg.threads import allowed_threads

Solver = Callable[[NDArray[np.float64]], NDArray[np.float64]]
# particles from which on supernodes win, by dimension
_LARGE = {2: 2500, 3: 200}
# particles beyond which the plane is dissected
_DISSECTED = 20_000


class _Pattern(NamedTuple):
    """Where the d x d blocks stand, row by row and by column in each row.

    Column of each block and first block of each row; the block of each particle with itself, and those of each contact,
    (i, j) and (j, i), -1 where it is with an own image.
    """

    column_k: NDArray[np.int32]
    start: NDArray[np.int32]
    own_n: NDArray[np.int64]
    place_cs: NDArray[np.int64]


def _pattern(i_c: NDArray[np.int64], j_c: NDArray[np.int64], particles: int) -> _Pattern:
    """Return where the blocks of sorted pairs stand."""
    one, other, pair_c = distinct_pairs(i_c, j_c)
    own = np.arange(particles)
    row, column = np.concatenate([own, one, other]), np.concatenate([own, other, one])
    order = np.lexsort((column, row))
    place = np.empty(len(order), dtype=np.int64)
    place[order] = np.arange(len(order))
    place_cs = np.full((len(i_c), 2), -1)
    apart = i_c != j_c
    for side in range(2):
        place_cs[apart, side] = place[particles + side * len(one) + pair_c[apart]]
    start = np.searchsorted(row[order], np.arange(particles + 1))
    return _Pattern(column[order].astype(np.int32), start.astype(np.int32), place[:particles], place_cs)


@device
def _corner(pattern: Any, d: Any, row: Any, k: Any) -> Any:
    """Return where the first number of a block stands: the first lines of a row's blocks stand side by side."""
    return d * d * pattern.start[row] + d * (k - pattern.start[row])


@kernel
def _assemble(i_c, j_c, pattern, normal, along, across, extra_n, pin, data):  # type: ignore[no-untyped-def]
    """Add the blocks of all contacts, in order; return the particle of the stiffest row, which is held to pin it."""
    d = normal.shape[1]
    start = pattern.start
    data[:] = 0.0
    for c in range(i_c.shape[0]):
        if pattern.place_cs[c, 0] < 0:
            continue
        for side in range(2):
            row = i_c[c] if side == 0 else j_c[c]
            line = d * (start[row + 1] - start[row])
            own, off = _corner(pattern, d, row, pattern.own_n[row]), _corner(pattern, d, row, pattern.place_cs[c, side])
            for a in range(d):
                for b in range(d):
                    value = (along[c] - across[c]) * normal[c, a] * normal[c, b]
                    if a == b:
                        value += across[c]
                    data[own + a * line + b] += value
                    data[off + a * line + b] -= value
    stiffest = 0
    most = -1.0
    for i in range(extra_n.shape[0]):
        trace = 0.0
        first, next_one = _corner(pattern, d, i, pattern.own_n[i]), d * (start[i + 1] - start[i]) + 1
        for a in range(d):
            trace += data[first + a * next_one]
            data[first + a * next_one] += extra_n[i]
        if trace > most:
            most = trace
            stiffest = i
    if pin:
        first = _corner(pattern, d, stiffest, pattern.own_n[stiffest])
        next_one = d * (start[stiffest + 1] - start[stiffest]) + 1
        hold = 1e-300
        for a in range(d):
            hold = max(hold, data[first + a * next_one])
        for a in range(d):
            data[first + a * next_one] += hold
    return stiffest


@kernel
def gather(i_c, j_c, normal, weight, particles):  # type: ignore[no-untyped-def]
    """Return A^T weight, (N, d): the sum over contacts of weight n on j, minus it on i."""
    d = normal.shape[1]
    out = np.zeros((particles, d))
    for c in range(i_c.shape[0]):
        for a in range(d):
            push = weight[c] * normal[c, a]
            out[j_c[c], a] += push
            out[i_c[c], a] -= push
    return out


@kernel
def extensions(i_c, j_c, normal, displacement):  # type: ignore[no-untyped-def]
    """Return A u, (C,): the growth of each contact's length under displacements of the particles."""
    d = normal.shape[1]
    out = np.empty(i_c.shape[0])
    for c in range(i_c.shape[0]):
        total = 0.0
        for a in range(d):
            total += normal[c, a] * (displacement[j_c[c], a] - displacement[i_c[c], a])
        out[c] = total
    return out


class Factored(NamedTuple):
    """A factored system: `solve` takes (N d,) or (N d, k) right-hand sides; `negative` counts negative pivots."""

    solve: Solver
    negative: int
    pinned: int


class BlockSystem:
    """The pattern of one list of pairs, analyzed once, and factored with numbers again and again.

    Parameters
    ----------
    i_c, j_c
        (C,) particles of the pairs, i <= j, sorted by (i, j).
    particles, dimension
        N and d.
    backend
        "blocks" (minimum degree), "rslab" (supernodal, ordered by minimum fill in the plane up to 20000 particles, else
        by dissection) or "auto": rslab for many particles where it is installed, else blocks. Measured, CPU
        milliseconds of a factorization of the pairs within 1.35 diameters, blocks and rslab: 2D N = 256: .17 and .35;
        1024: 1.2 and 2.4; 2048: 4.8 and 6.0; 4096: 16 and 13; 3D, within 1.3 diameters: N = 64: .15 and .67; 256: 5.5
        and 5.3; 1024: 109 and 30; of the order, by minimum fill and by dissection: 2D N = 4096: 8 and 22; 16384: 37 and
        107.

    """

    def __init__(
        self,
        i_c: NDArray[np.int64],
        j_c: NDArray[np.int64],
        particles: int,
        dimension: int,
        *,
        backend: str = "auto",
    ) -> None:
        one_of("backend", backend, ("auto", "rslab", "blocks"))
        if backend == "auto":
            large = particles >= _LARGE[dimension] and importlib.util.find_spec("rslab")
            backend = "rslab" if large else "blocks"
        self.backend = backend
        self.particles, self.dimension = particles, dimension
        self.i_c, self.j_c = i_c, j_c
        self._places = _pattern(i_c, j_c, particles)
        self._data = np.empty(len(self._places.column_k) * dimension**2)
        self._analyzed: Any = None
        if backend == "blocks":
            self._analyzed = plan_blocks(dimension, self._places.column_k, self._places.start)
        else:
            self._analyze_with_rslab()

    def _analyze_with_rslab(self) -> None:
        """Find an order of elimination for the lower triangle, and where its numbers stand among all."""
        # a quick command quenches first, and SciPy's sparse matrices take 0.2 s to import
        import rslab
        import scipy.sparse as sp

        d, places, size = self.dimension, self._places, self.particles * self.dimension
        # the lower triangle by columns is the upper one by rows
        row, column = _numbers_of(d, places.column_k, places.start)
        self._of_triangle = np.flatnonzero(column >= row)
        start = np.searchsorted(row[self._of_triangle], np.arange(size + 1))
        ones, index = np.ones(len(self._of_triangle)), column[self._of_triangle]
        lower = sp.csc_matrix((ones, index, start), shape=(size, size))
        # in the plane minimum fill takes a third of the time of dissection, and its factors are as good to 16384
        order = "amf" if d == 2 and self.particles <= _DISSECTED else "metis"
        self._analyzed = rslab.analyze(lower, path="ldlt", threads=allowed_threads(), ordering=order)

    def factor(
        self,
        normal_cd: NDArray[np.float64],
        along_c: NDArray[np.float64],
        across_c: NDArray[np.float64] | None = None,
        *,
        extra_n: NDArray[np.float64] | None = None,
        pin: bool = True,
    ) -> Factored:
        """Return the factored system with the stiffest particle held in place.

        Parameters
        ----------
        normal_cd
            (C, d) contact normals.
        along_c, across_c
            (C,) stiffness of each pair along its normal and across it.
        extra_n
            (N,) springs that hold particles where they are.
        pin
            Hold one particle, so that uniform translations do not make the system singular. Right-hand sides must sum
            to zero; then the hold bears no force and does not change the solution otherwise.

        Raises
        ------
        numpy.linalg.LinAlgError
            If a pivot vanishes.

        """
        across = np.zeros_like(along_c) if across_c is None else across_c
        extra = np.zeros(self.particles) if extra_n is None else extra_n
        data, analyzed = self._data, self._analyzed
        pinned = int(_assemble(self.i_c, self.j_c, self._places, normal_cd, along_c, across, extra, pin, data))
        if self.backend == "blocks":
            factors = factor_blocks(data, analyzed)
            if factors is None:
                raise np.linalg.LinAlgError("system must not be singular: a pivot vanished")
            negative = int((factors.pivot_nq < 0.0).sum())
            return Factored(functools.partial(solve_blocks, analyzed, factors), negative, pinned)
        try:
            found = analyzed.factor(data[self._of_triangle])
        except RuntimeError as failure:
            raise np.linalg.LinAlgError(f"system must not be singular: {failure}") from None

        def solve(right: NDArray[np.float64]) -> NDArray[np.float64]:
            one = right.ndim == 1
            answer: NDArray[np.float64] = found.solve(right) if one else found.solve_many(np.asfortranarray(right))
            return answer

        return Factored(solve, int(found.inertia[1]), pinned)


def _numbers_of(
    d: int, column_k: NDArray[np.int32], start: NDArray[np.int32]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return row and column of every number of a matrix of d x d blocks, row by row."""
    length = np.repeat(np.diff(start).astype(np.int64), d)
    row = np.repeat(np.arange(len(length)), d * length)
    first = np.repeat(start[:-1].astype(np.int64), d)
    place = np.arange(len(row)) - np.repeat(d * (np.cumsum(length) - length), d * length)
    return row, d * column_k[np.repeat(first, d * length) + place // d] + place % d
