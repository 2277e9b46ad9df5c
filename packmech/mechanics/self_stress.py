"""States of self stress and floppy modes: the null spaces of the rigidity matrix, counted and, if they fit, spanned.

With C contacts and the rank r of the rigidity matrix: states of self stress = C - r, floppy modes = columns - r - d,
where the d uniform translations are trivial and never counted. Rigid links restrict motions and bear what forces they
must: their rows are appended to the matrix, and taken off the counts again. Strains are admitted as "none" (the box
stays), "isotropic" (its volume changes, its shape stays), "isochoric" (its shape changes, its volume stays; the
multiplier of the volume is the pressure) or "free".
"""

from __future__ import annotations

import functools
import time
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from packmech.calls.display import shown
from packmech.calls.honors import honors
from packmech.calls.status import shown_as
from packmech.check import STRAINS, BoxStrain, instance, one_of, positive, real
from packmech.constraints.factor import BASIS_LIMIT, ConstraintFactor
from packmech.contacts import Contacts
from packmech.contacts.elements import distance_rows
from packmech.contacts.given import contacts_of
from packmech.contacts.shape_contacts import ShapeContacts
from packmech.jit.blas import single_thread
from packmech.linalg.factor import Factorization, eigenvalues_below, factorize
from packmech.linalg.mandel import strain_directions
from packmech.mechanics.linked_systems import rows_on
from packmech.mechanics.modes import signed_columns
from packmech.mechanics.rigidity import strain_columns
from packmech.packing import Packing

METHODS = ("auto", "dense", "sparse")
# singular values below this fraction of the largest are zero (1e-10 in eigenvalues of A^T A)
RANK_TOLERANCE = 1e-5
_DENSE_ENTRIES = 40_000
_SWEEPS = 12


@shown()
@dataclass(frozen=True, eq=False)
class SelfStress:
    """States of self stress: contact forces in balance without load.

    Attributes
    ----------
    count
        Number of independent states, contacts - rank.
    contacts, rank
        Rows and rank of the rigidity matrix on the motions that rigid links admit.
    motions
        Dimension N_dof of these motions, translations included: its columns.
    trivial
        Number of uniform translations, d.
    force_ck
        (C, count) orthonormal states in columns, on the contacts, links bearing the rest, positive for repulsion up to
        the sign of the vector; None if they would not fit the limit.
    residual
        Largest unbalanced force component of a state of unit size [1].
    certain
        Whether the rank stays the same for tolerances ten times looser and tighter.
    method
        "dense" (singular values) or "sparse" (inertia of A^T A, then projections).
    seconds
        CPU time.

    """

    count: int
    contacts: int
    rank: int
    motions: int
    trivial: int
    force_ck: NDArray[np.float64] | None
    residual: float
    certain: bool
    method: str
    seconds: float

    @property
    def isostatic_contact_count(self) -> int:
        """Number of contacts, N_dof - d + 1, at which a packing without floppy modes has one state of self stress.

        In the boundary conditions that were asked for: "none" a fixed box, "isochoric" a shear-stabilized packing.
        Every particle counts: take rattlers out first.
        """
        return self.motions - self.trivial + 1


@shown()
@dataclass(frozen=True, eq=False)
class FloppyModes:
    """Floppy modes: motions, and strains if admitted, that change no contact distance to first order.

    Attributes
    ----------
    count
        Number of independent modes, columns - rank - trivial.
    columns, rank
        Columns (N_dof, the motions that rigid links admit) and rank of the rigidity matrix with the admitted strains.
    trivial
        Number of uniform translations, d; they are in no mode.
    motion_xk
        (N d + s, count) modes in columns: displacements with zero mean, then Mandel strains, zero where none are
        admitted; with shapes each particle's turns, as lengths, follow its displacement. None if they would not fit the
        limit.
    residual
        Largest change of contact distance of a mode of unit size [1].
    certain, method, seconds
        As in `SelfStress`.

    """

    count: int
    columns: int
    rank: int
    trivial: int
    motion_xk: NDArray[np.float64] | None
    residual: float
    certain: bool
    method: str
    seconds: float


@dataclass(frozen=True, eq=False)
class RigidityRows:
    """The rigidity matrix with admitted strains as columns of average size, one particle pinned; link rows last.

    Columns of turns that there are not, those of discs among ellipses, are `absent`; so are those of held particles,
    beside which none is pinned.
    """

    matrix: sp.csr_array
    contacts: int
    strain_map: NDArray[np.float64]  # (s, k): Mandel strain of a unit of each strain column
    pinned: NDArray[np.int64]
    absent: NDArray[np.int64]

    @functools.cached_property
    def largest(self) -> float:
        """A bound on the singular values."""
        return float(np.sqrt(abs(self.matrix.T @ self.matrix).sum(axis=0).max())) if self.matrix.shape[0] else 0.0

    @property
    def links(self) -> int:
        """Number of rows of links."""
        return int(self.matrix.shape[0]) - self.contacts

    @property
    def kept(self) -> NDArray[np.int64]:
        """The columns that can move."""
        return np.delete(np.arange(self.matrix.shape[1]), np.concatenate([self.pinned, self.absent]))

    @property
    def motions(self) -> int:
        """Number of coordinates, links counted."""
        return int(self.matrix.shape[1]) - len(self.absent)

    @property
    def reduced(self) -> sp.csc_array:
        """The matrix of these columns."""
        return sp.csc_array(self.matrix.tocsc()[:, self.kept])

    @property
    def method(self) -> str:
        """How null spaces are found unless asked for otherwise."""
        return "dense" if self.matrix.shape[0] * len(self.kept) <= _DENSE_ENTRIES else "sparse"


def with_strains(position: sp.csr_array, side: NDArray[np.float64], coordinates: int) -> tuple[sp.csr_array, float]:
    """Return the matrix with columns of admitted strains behind those of the positions, and the strain of their unit.

    Rank does not depend on the size of the strain columns, its tolerance does: they get the mean size of the others.
    """
    mean = np.sqrt(2.0 * len(side) / coordinates)
    size = float(np.sqrt((side**2).sum(axis=0)).max(initial=0.0))
    scale = mean / size if size > 0.0 else 1.0
    return sp.csr_array(sp.hstack([position, sp.csr_array(side * scale)], format="csr")), scale


def _problem(packing: Packing, strain: BoxStrain, contacts: Contacts | ShapeContacts) -> RigidityRows:
    dimension = packing.dimension
    admitted = strain_directions(dimension, strain)
    turn = packing.turn_nkt
    there = np.hstack([np.ones((packing.particles, dimension), dtype=bool), (turn != 0.0).any(axis=2)])
    width, absent = there.shape[1], np.flatnonzero(~there.ravel())
    position, side = distance_rows(contacts), strain_columns(contacts) @ admitted
    matrix, scale = with_strains(position, side, packing.particles * dimension)
    everything = np.ones(position.shape[1], dtype=bool)
    rows = rows_on(ConstraintFactor(packing), everything, np.ones(position.shape[1]), admitted, 1.0 / scale)
    matrix = sp.csr_array(sp.vstack([matrix, rows], format="csr"))
    pinned = width * int(np.argmax(contacts.count_n())) + np.arange(dimension)
    return RigidityRows(matrix, len(contacts), admitted * scale, pinned, absent)


def _dense_rank(problem: RigidityRows, tolerance: float) -> tuple[int, bool, NDArray[np.float64], NDArray[np.float64]]:
    """Return rank, certainty, and the left and right null vectors of the pinned matrix as columns."""
    left, value, right = np.linalg.svd(problem.reduced.toarray(), full_matrices=True)
    ranks = [int(np.count_nonzero(value > factor * tolerance * problem.largest)) for factor in (1.0, 0.1, 10.0)]
    return ranks[0], len(set(ranks)) == 1, left[:, ranks[0] :], right[ranks[0] :].T


def _sparse_rank(problem: RigidityRows, tolerance: float) -> tuple[int, bool]:
    reduced = problem.reduced
    square = sp.csc_array(reduced.T @ reduced)
    # the larger Gram matrix is A A^T, but strain columns fill it; both have the same rank
    ranks = [
        square.shape[0] - eigenvalues_below(square, (factor * tolerance * problem.largest) ** 2)
        for factor in (1.0, 0.1, 10.0)
    ]
    return ranks[0], len(set(ranks)) == 1


def shifted_square(problem: RigidityRows, tolerance: float) -> tuple[sp.csc_array, Factorization]:
    """Return the matrix of the columns that can move, and its square, a little shifted, factored."""
    reduced = problem.reduced
    shift = (tolerance * problem.largest) ** 2
    square = reduced.T @ reduced + shift * sp.eye_array(reduced.shape[1])
    return reduced, factorize(sp.csc_array(square))


def orthonormal(columns: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return orthonormal columns that span what the given ones do."""
    q: NDArray[np.float64] = np.linalg.qr(columns)[0]
    return q


def _sparse_left(problem: RigidityRows, tolerance: float, count: int) -> NDArray[np.float64]:
    """Return an orthonormal basis of the left null space: what is left of generic forces after balancing them."""
    reduced, factor = shifted_square(problem, tolerance)
    state = orthonormal(np.random.default_rng(0).normal(size=(reduced.shape[0], count)))
    for _ in range(_SWEEPS):
        unbalanced = reduced.T @ state
        if np.abs(unbalanced).max(initial=0.0) < 1e-15 * problem.largest:
            break
        state = orthonormal(state - reduced @ factor.solve(unbalanced))
    return state


def _sparse_right(problem: RigidityRows, tolerance: float, count: int) -> NDArray[np.float64]:
    """Return an orthonormal basis of the right null space by inverse iteration on a block."""
    reduced, factor = shifted_square(problem, tolerance)
    motion = orthonormal(np.random.default_rng(0).normal(size=(reduced.shape[1], count)))
    for _ in range(_SWEEPS):
        motion = orthonormal(factor.solve(motion))
        if np.abs(reduced @ motion).max(initial=0.0) < 1e-15 * problem.largest:
            break
    return motion


def _prepare(
    packing: Packing,
    strain: BoxStrain,
    contacts: Contacts | ShapeContacts | None,
    gap_tolerance: float | None,
    tolerance: float,
    method: str,
    limit: float,
) -> tuple[RigidityRows, str]:
    one_of("strain", strain, STRAINS)
    one_of("method", method, METHODS)
    real("rank_tolerance", tolerance, above=0.0, below=0.1)
    positive("basis_limit", limit)
    instance("packing", packing, Packing)
    found = contacts_of(packing, contacts, gap_tolerance)
    problem = _problem(packing, strain, found)
    return problem, problem.method if method == "auto" else method


def null_space(
    problem: RigidityRows, method: str, tolerance: float, limit: float, *, left: bool
) -> tuple[int, bool, int, NDArray[np.float64] | None]:
    """Return rank, its certainty, and number and columns of the left or right null space; None beyond the limit."""
    rows, columns = problem.matrix.shape[0], problem.matrix.shape[1] - len(problem.absent)
    # the motions of the particle that is held are the translations
    size, held = (rows, 0) if left else (columns, len(problem.pinned))
    basis: NDArray[np.float64] | None = None
    if not rows:
        rank, certain, basis = 0, True, np.eye(size - held)
    elif method == "dense":
        rank, certain, *both = _dense_rank(problem, tolerance)
        basis = both[0 if left else 1]
    else:
        rank, certain = _sparse_rank(problem, tolerance)
    count = size - held - rank
    if 8.0 * count * size > limit:
        return rank, certain, count, None
    if basis is None:
        basis = (_sparse_left if left else _sparse_right)(problem, tolerance, count)
    return rank, certain, count, basis


@shown_as("states of self stress")
@honors("links shapes", packing_only=True)
def states_of_self_stress(
    packing: Packing,
    strain: BoxStrain = "none",
    *,
    contacts: Contacts | ShapeContacts | None = None,
    gap_tolerance: float | None = None,
    rank_tolerance: float = RANK_TOLERANCE,
    method: str = "auto",
    basis_limit: float = BASIS_LIMIT,
) -> SelfStress:
    """Return the states of self stress: contact forces in balance on every particle and against the admitted strains.

    Parameters
    ----------
    packing
        The packing; rattlers may stay, they carry no self stress.
    strain
        "none": forces balance on particles only (a fixed box). "isotropic": they also have no pressure. "isochoric":
        they have no stress but pressure (a shear-stabilized packing). "free": they have no stress at all.
    contacts
        The contacts to use, instead of those that `gap_tolerance` finds.
    gap_tolerance
        Largest gap relative to the contact distance [1] at which a pair counts as touching; None: the rule of
        `find_contacts`.
    rank_tolerance
        Singular values below this fraction of the (bound on the) largest count as zero [1].
    method
        "dense" or "sparse"; "auto" takes the dense one for matrices of at most 40 000 entries.
    basis_limit
        Largest memory of the basis [bytes]; beyond it `force_ck` is None and only the counts are given.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind or a name is unknown.

    Examples
    --------
    >>> import packmech as pm
    >>> crystal = pm.lattice_packing("triangular", repeats=(4, 4))
    >>> pm.states_of_self_stress(crystal).count, pm.states_of_self_stress(crystal, "free").count
    (18, 15)

    """
    start = time.process_time()
    with single_thread():
        problem, method = _prepare(packing, strain, contacts, gap_tolerance, rank_tolerance, method, basis_limit)
        rank, certain, count, basis = null_space(problem, method, rank_tolerance, basis_limit, left=True)
        if basis is not None and problem.links and count:
            # states of size 1 on the contacts, whatever the links bear
            _, right = np.linalg.qr(basis[: problem.contacts])
            basis = np.linalg.solve(right.T, basis.T).T
        residual = float("nan") if basis is None else float(np.abs(problem.matrix.T @ basis).max(initial=0.0))
    found = problem.contacts
    force = None if basis is None else np.ascontiguousarray(signed_columns(basis[:found]))
    return SelfStress(
        count, found, rank - problem.links, problem.motions - problem.links, packing.dimension, force, residual,
        certain, method, time.process_time() - start,
    )  # fmt: skip


@shown_as("floppy modes")
@honors("links shapes", packing_only=True)
def floppy_modes(
    packing: Packing,
    strain: BoxStrain = "none",
    *,
    contacts: Contacts | ShapeContacts | None = None,
    gap_tolerance: float | None = None,
    rank_tolerance: float = RANK_TOLERANCE,
    method: str = "auto",
    basis_limit: float = BASIS_LIMIT,
) -> FloppyModes:
    """Return the floppy modes: motions without extension of any contact, uniform translations left out.

    Parameters
    ----------
    packing
        The packing; each rattler that stays adds its d motions (or what its contacts leave of them).
    strain
        Which strains of the box the motions may use: "none", "isotropic", "isochoric" or "free".
    contacts, gap_tolerance, rank_tolerance, method
        As in `states_of_self_stress`.
    basis_limit
        Largest memory of the basis [bytes]; beyond it the modes are None and only the counts are given.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind or a name is unknown.

    Examples
    --------
    >>> import packmech as pm
    >>> square = pm.lattice_packing("square", repeats=(4, 4))
    >>> pm.floppy_modes(square).count, pm.floppy_modes(square, "free").count
    (6, 7)

    """
    start = time.process_time()
    with single_thread():
        problem, method = _prepare(packing, strain, contacts, gap_tolerance, rank_tolerance, method, basis_limit)
        columns, dimension, particles = problem.matrix.shape[1], packing.dimension, packing.particles
        rank, certain, count, basis = null_space(problem, method, rank_tolerance, basis_limit, left=False)
        motion_xk, residual = None, float("nan")
        if basis is not None:
            motion = np.zeros((columns, count))
            motion[problem.kept] = basis
            positions = columns - len(problem.strain_map.T)
            free = motion[:positions].reshape(particles, positions // particles, count)[:, :dimension]
            free -= free.mean(axis=0)
            motion = signed_columns(orthonormal(motion))
            residual = float(np.abs(problem.matrix @ motion).max(initial=0.0))
            strain_ek = problem.strain_map @ motion[positions:]
            motion_xk = np.concatenate([motion[:positions], strain_ek])
    seconds = time.process_time() - start
    columns, rank = problem.motions - problem.links, rank - problem.links
    return FloppyModes(count, columns, rank, dimension, motion_xk, residual, certain, method, seconds)
