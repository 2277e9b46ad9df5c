"""Orthonormal bases of what links hold and of what they leave free, cluster by cluster."""

from __future__ import annotations

import functools
import time
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.linalg as sl
import scipy.sparse as sp
from numpy.typing import NDArray

from packmech.calls.display import shown
from packmech.calls.honors import ANY_LENGTH, honors
from packmech.check import BoxStrain, instance, one_of, positive, real
from packmech.constraints.factor import BASIS_LIMIT, ConstraintFactor, admitted_strains
from packmech.constraints.jacobian import FORMS, LINK_STRAINS, link_rows, scale_of_strain
from packmech.jit.blas import single_thread
from packmech.linalg.mandel import strain_components, strain_directions
from packmech.packing import Packing

# largest dense matrix that is made unless more is asked for [bytes]
MEMORY_LIMIT = 1e9


def check_memory(rows: int, columns: int, memory_limit: float) -> None:
    """Check that a dense matrix of this size fits the limit.

    Raises
    ------
    ValueError
        Naming the size.

    """
    need = 8.0 * rows * columns
    if need > memory_limit:
        raise ValueError(
            f"memory_limit must be at least {need:.3g} bytes for a dense matrix of {rows} by {columns}, "
            f"got {memory_limit:g}"
        )


def motion_basis(
    links: ConstraintFactor,
    strain_ek: NDArray[np.float64] | None,
    *,
    mass_n: NDArray[np.float64],
    strain_scale: float,
    memory_limit: float = MEMORY_LIMIT,
) -> NDArray[np.float64]:
    """Return the motions (x, e) that the links admit to first order, as columns of an (N d + s, N_dof) matrix.

    Positions come first, cluster by cluster, then at most s motions with strain: of all that make that strain those
    with the least motion of the particles, made orthonormal. Columns are
    orthonormal in sum of mass x.x + strain_scale^2 e.e.

    Parameters
    ----------
    links
        The links.
    strain_ek
        (s, k) admitted strains as columns; None for a fixed box, whose motions have no strain rows.
    mass_n
        (N,) masses.
    strain_scale
        Length that a unit strain counts as.
    memory_limit
        Largest memory of the matrix [bytes].

    """
    gradient, stretch = links.independent_rows()
    root = np.repeat(np.sqrt(mass_n), links.pairs.dimension)
    shape = len(root), 0 if strain_ek is None else len(strain_ek)
    asked = np.zeros((stretch.shape[1], 0)) if strain_ek is None else strain_ek
    strains = admitted_strains(asked, links.stiff_strains)
    check_memory(sum(shape), len(root) - gradient.shape[0] + strains.shape[1], memory_limit)
    weighted = gradient.multiply(1.0 / root[None, :]).T.tocsc()
    blocks = cluster_blocks(weighted, links.cluster_l[~links.dependent_l], links.cluster_n, "householder", 0.0)
    motions = _strain_motions(blocks, stretch.T / strain_scale, strains, len(root))
    basis: NDArray[np.float64] = _null_basis(blocks, motions, shape).toarray()
    basis[: len(root)] /= root[:, None]
    basis[len(root) :] /= strain_scale
    return basis


METHODS = ("householder", "gram-schmidt", "gram-schmidt-twice", "whole-matrix")
# columns whose part outside the span of the others is below this, relative to the largest column, depend on them
RANK = 1e-10


class Block(NamedTuple):
    """The links of one cluster: Omega = basis @ triangle on the rows of its particles, links in the order of pivots."""

    row_x: NDArray[np.int64]
    link_l: NDArray[np.int64]
    basis_xr: NDArray[np.float64]
    triangle_rl: NDArray[np.float64]


@shown()
@dataclass(frozen=True, eq=False)
class ConstraintBasis:
    """Orthonormal bases of a packing's constraints and of the motions they leave.

    Attributes
    ----------
    method
        How it was made.
    rank
        Number of independent constraints: links, and the volume if it is one.
    link_rank
        Number of links that are independent of each other at fixed box.
    blocks
        The clusters, each with its dense orthonormal block.
    strain_xk
        (N d + s, k) orthonormal motions that go with the admissible strains, or (N d, 0) without strains.
    shape
        Numbers of positions' coordinates N d, and of strains s (0 without).
    seconds
        CPU time.

    """

    method: str
    rank: int
    link_rank: int
    blocks: tuple[Block, ...]
    strain_xk: NDArray[np.float64]
    shape: tuple[int, int]
    seconds: float

    @property
    def freedoms(self) -> int:
        """Number of degrees of freedom left, N_dof, the d translations included."""
        return sum(self.shape) - self.rank

    @functools.cached_property
    def orthogonality(self) -> float:
        """Largest entry of Q^T Q - 1 over the blocks and the motions with strain [1]."""
        parts = [block.basis_xr for block in self.blocks] + [self.strain_xk]
        with single_thread():
            return max(float(np.abs(q.T @ q - np.eye(q.shape[1])).max(initial=0.0)) for q in parts)

    @functools.cached_property
    def link_basis(self) -> sp.csc_array:
        """Omega_o: (N d, link_rank) orthonormal columns that span the links' gradients at fixed box, block by block."""
        return _columns([(block.row_x, block.basis_xr) for block in self.blocks], self.shape[0])

    @functools.cached_property
    def null_basis(self) -> sp.csc_array:
        """B: (N d + s, freedoms) orthonormal columns that span the motions without change of a constraint.

        Clusters come first, then particles without links, then the motions that go with strains.
        """
        return _null_basis(self.blocks, self.strain_xk, self.shape)

    def project(self, vector_x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the part of an (N d + s,) vector that changes no constraint."""
        positions, strains = self.shape
        out = np.array(vector_x, dtype=np.float64)
        if out.shape != (positions + strains,):
            raise ValueError(f"vector_x must have shape ({positions + strains},), got {out.shape}")
        out[positions:] = 0.0
        with single_thread():
            for block in self.blocks:
                part = out[block.row_x]
                out[block.row_x] = part - block.basis_xr @ (block.basis_xr.T @ part)
            if strains:
                # the motions with strain have parts in the span of Omega that were just taken away
                out += self.strain_xk @ (self.strain_xk.T @ np.asarray(vector_x, dtype=np.float64))
        return out


def _null_basis(blocks: tuple[Block, ...], strain_xk: NDArray[np.float64], shape: tuple[int, int]) -> sp.csc_array:
    """Return orthonormal motions without change of a constraint, by cluster, of single particles, and with strains."""
    positions, strains = shape
    linked = np.zeros(positions, dtype=bool)
    parts = []
    with single_thread():
        for block in blocks:
            linked[block.row_x] = True
            rank = block.basis_xr.shape[1]
            whole = sl.qr(block.basis_xr, check_finite=False)[0] if rank else np.eye(len(block.row_x))
            parts.append((block.row_x, whole[:, rank:]))
    free = np.flatnonzero(~linked)
    alone = sp.csc_array((np.ones(len(free)), (free, np.arange(len(free)))), shape=(positions, len(free)))
    moves = sp.hstack([_columns(parts, positions), alone], format="csc")
    if not strains:
        return sp.csc_array(moves)
    moves = sp.vstack([moves, sp.csc_array((strains, moves.shape[1]))])
    return sp.csc_array(sp.hstack([moves, sp.csc_array(strain_xk)]))


def _columns(parts: list[tuple[NDArray[np.int64], NDArray[np.float64]]], rows: int) -> sp.csc_array:
    """Return dense blocks, each on its own rows, as the columns of one sparse array."""
    index = np.int32 if sum(q.size for _, q in parts) < 2**31 and rows < 2**31 else np.int64
    widths = np.concatenate([np.full(q.shape[1], q.shape[0]) for _, q in parts] + [np.empty(0, dtype=np.int64)])
    start = np.concatenate([[0], np.cumsum(widths)]).astype(index)
    value, row = np.empty(int(start[-1])), np.empty(int(start[-1]), dtype=index)
    done = 0
    for place, q in parts:
        value[done : done + q.size] = q.ravel(order="F")
        row[done : done + q.size] = np.tile(place, q.shape[1])
        done += q.size
    return sp.csc_array((value, row, start), shape=(rows, len(widths)))


def _gram_schmidt(
    matrix: NDArray[np.float64], twice: bool, tolerance: float
) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Orthonormalize columns by modified Gram-Schmidt, the longest rest first; return the basis and the columns' order.

    Twice: each new column is made orthogonal to all before it again.
    """
    rest, order = matrix.T.copy(order="C"), np.arange(matrix.shape[1])
    square = (rest**2).sum(axis=1)
    smallest = tolerance**2 * square.max()
    basis: list[NDArray[np.float64]] = []
    for rank in range(min(matrix.shape)):
        best = rank + int(square[rank:].argmax())
        if not square[best] > smallest:
            break
        for array in (rest, order, square):
            array[[rank, best]] = array[[best, rank]]
        vector = rest[rank]
        for before in basis if twice else ():
            vector = vector - (before @ vector) * before
        basis.append(vector / np.sqrt(vector @ vector))
        left = rest[rank + 1 :]
        left -= np.outer(left @ basis[-1], basis[-1])
        square[rank + 1 :] = (left**2).sum(axis=1)
    return np.array(basis).reshape(-1, len(matrix)).T.copy(order="C"), order


def _orthonormal(
    matrix: NDArray[np.float64], method: str, tolerance: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.int64]]:
    """Return an orthonormal basis, the columns' coefficients in it, and the columns' order, independent ones first."""
    if method.startswith("gram-schmidt"):
        basis, order = _gram_schmidt(matrix, method == "gram-schmidt-twice", tolerance)
        return basis, basis.T @ matrix[:, order], order
    basis, triangle, order = sl.qr(matrix, mode="economic", pivoting=True, check_finite=False)
    size = np.abs(np.diag(triangle))
    rank = int(np.count_nonzero(size > tolerance * size[0])) if len(size) and size[0] > 0.0 else 0
    # rounding of many reflections shows most in the lengths; summed in pairs along each column, which lies in one piece
    basis = basis[:, :rank]
    basis /= np.sqrt((basis.T**2).sum(axis=1))
    return basis, triangle[:rank], np.asarray(order, dtype=np.int64)


def cluster_blocks(
    matrix: sp.csc_array, own: NDArray[np.int64], cluster: NDArray[np.int64], method: str, tolerance: float,
    limit: float = np.inf,
) -> tuple[Block, ...]:  # fmt: skip
    """Return the orthonormal blocks of Omega, one for each cluster that has links.

    Parameters
    ----------
    matrix
        (N d, L) Omega.
    own, cluster
        (L,) and (N,) the clusters of the links and of the particles.
    method, tolerance, limit
        As `constraint_basis` takes them.

    """
    if not len(own):
        return ()
    d = matrix.shape[0] // len(cluster)
    if method == "whole-matrix":
        own, cluster = np.zeros_like(own), np.zeros_like(cluster)
    members = np.argsort(cluster, kind="stable")
    member_start = np.concatenate([[0], np.cumsum(np.bincount(cluster))])
    order = np.argsort(own, kind="stable")
    link_start = np.concatenate([[0], np.cumsum(np.bincount(own, minlength=len(member_start) - 1))])
    sizes, counts = d * np.diff(member_start), np.diff(link_start)
    needed = 8.0 * float((sizes * np.minimum(sizes, counts))[counts > 0].sum())
    if max(needed, 8.0 * float((sizes * counts).max())) > limit:
        raise ValueError(f"basis_limit must be at least {needed:.3g} bytes for this basis, got {limit:.3g}")
    place = np.empty(len(cluster), dtype=np.int64)
    place[members] = np.arange(len(cluster)) - np.repeat(member_start[:-1], np.diff(member_start))
    blocks = []
    for c in np.flatnonzero(counts):
        inside = members[member_start[c] : member_start[c + 1]]
        link = order[link_start[c] : link_start[c + 1]]
        dense = np.zeros((sizes[c], len(link)), order="F")
        first, last = matrix.indptr[link], matrix.indptr[link + 1]
        width = last - first
        entry = np.repeat(first - np.concatenate([[0], np.cumsum(width)[:-1]]), width) + np.arange(width.sum())
        row = matrix.indices[entry]
        dense[place[row // d] * d + row % d, np.repeat(np.arange(len(link)), width)] = matrix.data[entry]
        basis, triangle, pivots = _orthonormal(dense, method, tolerance)
        blocks.append(Block((inside[:, None] * d + np.arange(d)).ravel(), link[pivots], basis, triangle))
    return tuple(blocks)


def _strain_motions(
    blocks: tuple[Block, ...], rows_sl: NDArray[np.float64], admitted_sk: NDArray[np.float64], size: int
) -> NDArray[np.float64]:
    """Return orthonormal motions (N d + s, k), one for each admitted strain, orthogonal to those at fixed strain."""
    moves = np.zeros((size, admitted_sk.shape[1]))
    for block in blocks:
        rank = block.basis_xr.shape[1]
        rates = rows_sl[:, block.link_l[:rank]].T @ admitted_sk
        moves[block.row_x] = -block.basis_xr @ np.linalg.solve(block.triangle_rl[:, :rank].T, rates)
    return np.linalg.qr(np.concatenate([moves, admitted_sk]))[0]


def _stiff_strains(blocks: tuple[Block, ...], rows_sl: NDArray[np.float64], tolerance: float) -> NDArray[np.float64]:
    """Return strains that links forbid, as rows: what dependent ones ask beyond those they depend on (a taut ring)."""
    stiff = [np.zeros((0, len(rows_sl)))]
    for block in blocks:
        rank = block.basis_xr.shape[1]
        rates = rows_sl[:, block.link_l].T
        if rank < len(rates):
            part = np.linalg.solve(block.triangle_rl[:, :rank].T, rates[:rank])
            rest = rates[rank:] - block.triangle_rl[:, rank:].T @ part
            largest = np.abs(rates).max()
            stiff.append(np.where(np.abs(rest) > 1e3 * tolerance * largest, rest, 0.0) / largest)
    return np.concatenate(stiff)


@honors("links", packing_only=True, link_tolerance=ANY_LENGTH)
def constraint_basis(
    packing: Packing,
    strain: BoxStrain = "none",
    *,
    method: str = "householder",
    form: str = "exact",
    rank_tolerance: float = RANK,
    strain_scale: float | None = 1.0,
    basis_limit: float = BASIS_LIMIT,
) -> ConstraintBasis:
    """Return orthonormal bases of the constraints and of the motions they leave free, with rank and orthogonality.

    Coordinates are the positions, particle-major, and with strain the Mandel strains times `strain_scale`. Degrees of
    freedom: N d - rank in a fixed box, N d + s - rank with strain, one less with isochoric ones; translations count.
    Equations 5, 6 and 28 to 32 of Dennis (2021), cluster by cluster.

    Parameters
    ----------
    packing
        The packing; without links everything is free.
    strain, form
        As in `constraint_jacobian`.
    method
        "householder" (reflections with column pivoting, each cluster by itself), "gram-schmidt" (modified, one pass),
        "gram-schmidt-twice" (two passes), or "whole-matrix" (one dense matrix of all links with Householder: the
        reference, quadratic in memory). One pass of Gram-Schmidt loses orthogonality as the condition of the links.
    rank_tolerance
        A link depends on others when the part of its gradient outside their span is below this [1].
    strain_scale
        Length by which strains are multiplied to be coordinates. None: V^(1/d).
    basis_limit
        Largest size of the basis [bytes].

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind, a name is unknown, or the basis would be too large.

    Examples
    --------
    >>> import packmech as pm
    >>> links = pm.Links([0, 1, 0], [1, 2, 2], [[0, 0]] * 3, [1.0, 1.0, 2**0.5])
    >>> trimer = pm.Packing([[0, 0], [1, 0], [1, 1]], [0.5] * 3, pm.Box.cubic(4.0, 2), links)
    >>> basis = pm.constraint_basis(trimer)
    >>> basis.rank, basis.freedoms, basis.orthogonality < 1e-14
    (3, 3, True)

    """
    instance("packing", packing, Packing)
    one_of("strain", strain, LINK_STRAINS)
    one_of("method", method, METHODS)
    one_of("form", form, FORMS)
    tolerance = real("rank_tolerance", rank_tolerance, above=0.0, below=1.0)
    scale = scale_of_strain(packing, strain_scale)
    limit = positive("basis_limit", basis_limit)
    started = time.process_time()
    size, strains = packing.position_nd.size, 0 if strain == "none" else strain_components(packing.dimension)
    with single_thread():
        links = ConstraintFactor(packing)
        position, stretch = link_rows(links, form)
        blocks = cluster_blocks(position, links.cluster_l, links.cluster_n, method, tolerance, limit)
        link_rank = sum(block.basis_xr.shape[1] for block in blocks)
        motions = np.zeros((size, 0))
        rank = link_rank
        if strains:
            stiff = _stiff_strains(blocks, stretch / scale, tolerance)
            admitted = admitted_strains(strain_directions(packing.dimension, strain), stiff, tolerance)
            motions = _strain_motions(blocks, stretch / scale, admitted, size)
            rank += strains - motions.shape[1]
    seconds = time.process_time() - started
    return ConstraintBasis(method, rank, link_rank, blocks, motions, (size, strains), seconds)
