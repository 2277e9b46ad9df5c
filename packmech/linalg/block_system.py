"""Sparse systems A^T D A of contact networks: one d x d block per particle and per pair, factored again and again.

A contact with stiffness `along` its normal and `across` it couples the displacements of its two particles through
K = across 1 + (along - across) n n. The pattern depends on the pairs alone, so it is analyzed once; a factorization
then costs the numbers only. A particle's own image moves with it and adds nothing here.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.check import one_of
from packmech.contacts.network import distinct_pairs
from packmech.jit.compiled import kernel
from packmech.linalg.threads import allowed_threads

Solver = Callable[[NDArray[np.float64]], NDArray[np.float64]]
# rows from which on supernodes win in two dimensions, too
_LARGE = 2000
# particles beyond which the plane is dissected
_DISSECTED = 20_000


def _pattern(
    i_c: NDArray[np.int64], j_c: NDArray[np.int64], particles: int, d: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return each pair's place in its row of blocks, and the lower triangle's column pointers and row numbers."""
    row, neighbor, pair_c = distinct_pairs(i_c, j_c)
    first = np.searchsorted(row, np.arange(particles + 1))
    slot = np.arange(len(row)) - first[row]
    length = d - np.arange(d) + d * np.diff(first)[:, None]
    start = np.concatenate([[0], np.cumsum(length)])
    column = start[:-1].reshape(particles, d)
    index = np.empty(start[-1], dtype=np.int64)
    for b in range(d):
        for a in range(b, d):
            index[column[:, b] + a - b] = np.arange(particles) * d + a
        for a in range(d):
            index[column[row, b] + d - b + d * slot + a] = neighbor * d + a
    slot_c = np.full(len(i_c), -1)
    apart = i_c != j_c
    slot_c[apart] = slot[pair_c[apart]]
    return slot_c, start, index


@kernel
def _assemble(i_c, j_c, slot_c, normal, along, across, extra_n, start, data):  # type: ignore[no-untyped-def]
    """Add the blocks of all contacts, in order, to the lower triangle; return the particle of the stiffest row."""
    d = normal.shape[1]
    data[:] = 0.0
    for c in range(i_c.shape[0]):
        if slot_c[c] < 0:
            continue
        i = i_c[c]
        j = j_c[c]
        for b in range(d):
            at_i = start[i * d + b] - b
            at_j = start[j * d + b] - b
            off = start[i * d + b] + (d - b) + d * slot_c[c]
            for a in range(d):
                value = (along[c] - across[c]) * normal[c, a] * normal[c, b]
                if a == b:
                    value += across[c]
                if a >= b:
                    data[at_i + a] += value
                    data[at_j + a] += value
                data[off + a] -= value
    stiffest = 0
    most = -1.0
    for i in range(extra_n.shape[0]):
        trace = 0.0
        for b in range(d):
            trace += data[start[i * d + b]]
            data[start[i * d + b]] += extra_n[i]
        if trace > most:
            most = trace
            stiffest = i
    return stiffest


@kernel
def _transposed(start, index):  # type: ignore[no-untyped-def]
    """Return column pointers and row numbers of the transposed pattern, and where each of its numbers was before."""
    size = start.shape[0] - 1
    other = np.zeros(size + 1, np.int64)
    for k in range(index.shape[0]):
        other[index[k] + 1] += 1
    for row in range(size):
        other[row + 1] += other[row]
    place = other[:-1].copy()
    row_k, from_k = np.empty_like(index), np.empty_like(index)
    for column in range(size):
        for k in range(start[column], start[column + 1]):
            to = place[index[k]]
            row_k[to], from_k[to] = column, k
            place[index[k]] += 1
    return other, row_k, from_k


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
    """The pattern of one list of pairs, analyzed once; each `factor` with new numbers ends the use of the one before.

    Parameters
    ----------
    i_c, j_c
        (C,) particles of the pairs, i <= j, sorted by (i, j).
    particles, dimension
        N and d.
    backend
        "qdldl", "rslab" (supernodal, ordered by minimum fill in the plane up to 20000 particles, else by dissection)
        or "auto": rslab in three dimensions and from 2000 rows on where it is installed, else qdldl. Measured, CPU
        milliseconds of one factorization of the pairs within 1.35 diameters, qdldl and rslab: 2D N = 1024: 2.4 and
        2.2; 4096: 30 and 12; 16384 (another machine): 540 and 88; 3D N = 1024, within 1.3 diameters: 190 and 28; of
        the order, by minimum fill and by dissection: 2D N = 4096: 8 and 22; 16384: 37 and 107.

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
        # a quick command quenches first, and SciPy's sparse matrices take 0.2 s to import
        import scipy.sparse as sp

        one_of("backend", backend, ("auto", "rslab", "qdldl"))
        if backend == "auto":
            large = particles * dimension >= _LARGE or dimension == 3
            backend = "rslab" if large and importlib.util.find_spec("rslab") else "qdldl"
        self.backend = backend
        self.particles, self.dimension = particles, dimension
        self.i_c, self.j_c = i_c, j_c
        size = particles * dimension
        self._slot_c, self._start, index = _pattern(i_c, j_c, particles, dimension)
        self._data = np.empty(len(index))
        self._symbolic: Any = None
        self._found: Any = None
        if backend == "rslab":
            import rslab

            lower = sp.csc_matrix((np.ones(len(index)), index, self._start), shape=(size, size))
            # in the plane minimum fill takes a third of the time of dissection, and its factors are as good to 16384
            order = "amf" if dimension == 2 and particles <= _DISSECTED else "metis"
            self._symbolic = rslab.analyze(lower, path="ldlt", threads=allowed_threads(), ordering=order)
        else:
            # qdldl reads the upper triangle: where each of its numbers stands in the lower one
            start, row, self._from_lower = _transposed(self._start, index)
            self._upper = sp.csc_matrix((np.ones(len(index)), row, start), shape=(size, size))

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
        data, d = self._data, self.dimension
        pinned = int(_assemble(self.i_c, self.j_c, self._slot_c, normal_cd, along_c, across, extra, self._start, data))
        if pin:
            diagonal = self._start[pinned * d : pinned * d + d]
            data[diagonal] += max(float(data[diagonal].max()), 1e-300)
        if self._symbolic is not None:
            try:
                found = self._symbolic.factor(data)
            except RuntimeError as failure:
                raise np.linalg.LinAlgError(f"system must not be singular: {failure}") from None

            def solve(right: NDArray[np.float64]) -> NDArray[np.float64]:
                one = right.ndim == 1
                answer: NDArray[np.float64] = found.solve(right) if one else found.solve_many(np.asfortranarray(right))
                return answer

            return Factored(solve, int(found.inertia[1]), pinned)
        return self._factor_qdldl(data, pinned)

    def _factor_qdldl(self, data: NDArray[np.float64], pinned: int) -> Factored:
        import qdldl

        self._upper.data = data[self._from_lower]
        try:
            if self._found is None:
                self._found = qdldl.Solver(self._upper, upper=True)
            else:
                self._found.update(self._upper, upper=True)
        except (RuntimeError, ValueError) as failure:
            self._found = None
            raise np.linalg.LinAlgError(f"system must not be singular: {failure}") from None
        found = self._found
        # L and D of the solver are those of its last update: an older Factored must not be used any more
        pivots = found.factors()[1]

        def solve(right: NDArray[np.float64]) -> NDArray[np.float64]:
            if right.ndim == 1:
                return np.asarray(found.solve(right))
            return np.stack([found.solve(np.ascontiguousarray(column)) for column in right.T], axis=1)

        return Factored(solve, int((pivots < 0).sum()), pinned)
