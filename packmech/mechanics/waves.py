"""Waves through endless copies of a packing: their frequencies, dispersion along a path, and the speeds of sound."""

from __future__ import annotations

import inspect
import itertools
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import ArrayLike, NDArray

from packmech.calls.display import shown
from packmech.calls.honors import honors
from packmech.calls.status import shown_as
from packmech.check import KINDS, Kind, finite_array, instance, integer, one_of
from packmech.jit.blas import single_thread
from packmech.linalg.factor import eigenvalues_below
from packmech.measure.contact_forces import resting_forces, unless_at_rest
from packmech.mechanics.assembly import assemble
from packmech.mechanics.hessian import refuse_no_copies
from packmech.mechanics.relaxation import relax
from packmech.mechanics.system import System, system_of
from packmech.mechanics.wave_matrices import WaveStiffness
from packmech.scene import Scene

# up to so many coordinates, or a quarter of them asked for, all eigenvalues are found at once
DENSE_ROWS = 1200
_DENSE_LIMIT = 8192
# the shift lies this far below zero, in bounds on the largest eigenvalue
_SHIFT = 1e-6
# eigenvalues nearer to each other than this, in the same bounds, are of one degenerate set: to rounding
_DEGENERATE = 1e-13
_ROUNDS = 6
# of one run of Lanczos: those that end take some tens
_RESTARTS = 300


def _in_words(one: Waves) -> str:
    words = f"{one.frequency_km.shape[1]} branches at {len(one.wave_vector_kd)} wave vectors"
    return unless_at_rest(one.force_residual, one.at_rest, words if one.available else f"{words}: all particles rattle")


@shown(_in_words)
@dataclass(frozen=True, eq=False)
class Waves:
    """Frequencies of waves through copies of a packing.

    Attributes
    ----------
    wave_vector_kd
        (K, d) wave vectors in fractions of the reciprocal lattice [1].
    frequency_km
        (K, M) angular frequencies, ascending [1/time]; unstable waves have minus their growth rate.
    along_k
        (K,) length of the way from the first wave vector through all up to this one [1/length].
    corner_k
        Which wave vectors are the corners of a path; all of them where no path was asked for.
    available
        Number of branches; M of them are here, the lowest.
    residual
        Largest |D q - eigenvalue q| of a wave over the largest eigenvalue found or bounded [1].
    index_n
        (N',) particles that took part.
    seconds
        CPU time.
    force_residual, at_rest
        Largest net force over mean contact force of the packing as given [1], and whether that is rest, as in `Modes`:
        elsewhere these are no frequencies.
    missed
        Waves below the highest ones returned that an inertia count sees and this list lacks; 0 in a correct answer.

    """

    wave_vector_kd: NDArray[np.float64]
    frequency_km: NDArray[np.float64]
    along_k: NDArray[np.float64]
    corner_k: NDArray[np.int64]
    available: int
    residual: float
    index_n: NDArray[np.int64]
    seconds: float
    force_residual: float
    at_rest: bool
    missed: int = 0

    @property
    def complete(self) -> bool:
        """Whether these are all branches."""
        return bool(self.frequency_km.shape[1] == self.available)


@shown_as("waves")
@honors("repulsion kinds bonds interactions shapes memory", at_rest=True, rough="pm.stiffness_matrix")
def waves(
    scene: Scene,
    wave_vectors: ArrayLike,
    *,
    count: int | None = None,
    kind: Kind = "exact",
    rattlers: str = "remove",
    gap_tolerance: float | None = None,
) -> Waves:
    """Return the frequencies of waves through endless copies of a packing.

    The box is one cell; at the wave vectors (i / n1, j / n2) the frequencies are together those of n1 x n2 copies.

    Parameters
    ----------
    scene
        The scene, at rest, without rigid links, walls and held particles.
    wave_vectors
        (K, d) fractions of the reciprocal lattice [1].
    count
        How many of the lowest branches; None: all.
    kind, rattlers, gap_tolerance
        As in `normal_modes`.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind, or all branches of more than 8192 coordinates are asked for.

    Examples
    --------
    >>> import packmech as pm
    >>> square = pm.lattice_packing("square", repeats=(1, 1)).replace(mass_n=[1.0])
    >>> found = pm.waves(pm.Scene(square, (pm.Repulsion(),)), [[0.5, 0.0], [0.25, 0.0]])
    >>> found.frequency_km[:, 1].round(9).tolist()
    [2.0, 1.414213562]

    """
    instance("scene", scene, Scene)
    fraction = finite_array("wave_vectors", wave_vectors, shape=(None, scene.packing.dimension), what="wave vector")
    return _waves(scene, fraction, np.arange(len(fraction)), count, kind, rattlers, gap_tolerance)


@shown_as("dispersion")
@honors("repulsion kinds bonds interactions shapes memory", at_rest=True, rough="pm.stiffness_matrix")
def dispersion(
    scene: Scene,
    path: ArrayLike,
    *,
    points: int = 100,
    count: int | None = None,
    kind: Kind = "exact",
    rattlers: str = "remove",
    gap_tolerance: float | None = None,
) -> Waves:
    """Return the frequencies of waves along straight lines between wave vectors.

    Parameters
    ----------
    scene, count, kind, rattlers, gap_tolerance
        As in `waves`.
    path
        (C, d) corners in fractions of the reciprocal lattice [1].
    points
        Number of wave vectors on the whole way, more where lines are longer; corners are among them.

    Examples
    --------
    >>> import packmech as pm
    >>> triangular = pm.lattice_packing("triangular", repeats=(1, 1)).replace(mass_n=[1.0])
    >>> scene = pm.Scene(triangular, (pm.Repulsion(),))
    >>> branches = pm.dispersion(scene, [[0, 0], [1 / 2, 0], [2 / 3, 1 / 3], [0, 0]], points=60)
    >>> branches.frequency_km[branches.corner_k].round(6).tolist()
    [[0.0, 0.0], [1.414214, 2.44949], [2.12132, 2.12132], [0.0, 0.0]]

    """
    instance("scene", scene, Scene)
    corners = finite_array("path", path, shape=(None, scene.packing.dimension), what="corner")
    if len(corners) < 2:
        raise ValueError(f"path must have two corners or more, got {len(corners)}")
    # of each point the frequencies of all coordinates are held
    wanted = integer("points", points, at_least=1, bytes_each=8.0 * scene.packing.position_nd.size)
    if wanted < len(corners):
        raise ValueError(f"points must be {len(corners)} or more, one for each corner of the path, got {wanted}")
    length = _lengths(scene, np.diff(corners, axis=0))
    share = length / length.sum() if length.sum() > 0.0 else np.full(len(length), 1.0 / len(length))
    steps = np.maximum(1, np.rint(share * (wanted - 1)).astype(np.int64))
    fraction = np.concatenate(
        [
            begin + np.arange(k)[:, None] / k * (end - begin)
            for begin, end, k in zip(corners[:-1], corners[1:], steps, strict=True)
        ]
        + [corners[-1:]]
    )
    at = np.concatenate([[0], np.cumsum(steps)])
    return _waves(scene, fraction, at, count, kind, rattlers, gap_tolerance)


def _lengths(scene: Scene, fraction_kd: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the lengths of wave vectors [1/length]."""
    vector = 2.0 * np.pi * fraction_kd @ scene.packing.box.inverse_dd
    return np.asarray(np.sqrt((vector**2).sum(axis=1)))


class WaveCell:
    """A scene whose box is one cell of an endless packing: second derivatives over masses at any wave vector.

    Parameters
    ----------
    scene, kind, rattlers, gap_tolerance
        As in `waves`.

    """

    def __init__(self, scene: Scene, kind: Kind, rattlers: str, gap_tolerance: float | None) -> None:
        one_of("kind", kind, KINDS)
        refuse_no_copies(scene, "scene must be without")
        system = system_of(scene, kind, gap_tolerance=gap_tolerance, rattlers=rattlers, strained=False)
        network = system.network
        self.index_n = network.index_n
        self._there = network.there_nq.ravel()
        self.branches = int(self._there.sum())
        self._weight = 1.0 / np.sqrt(np.repeat(scene.packing.mass_n[network.index_n], network.there_nq.sum(axis=1)))
        self._stiffness = WaveStiffness(system.elements, network.turn_nkt, network.packing)

    def matrix(self, fraction_d: NDArray[np.float64]) -> sp.csr_array:
        """Return the Hermitian matrix whose eigenvalues are squared frequencies at a wave vector [1/time^2]."""
        whole = self._stiffness.at(fraction_d)[self._there][:, self._there]
        return sp.csr_array(whole.multiply(self._weight[:, None]).multiply(self._weight[None, :]))


def real_form(matrix: sp.csr_array) -> sp.csr_array:
    """Return a Hermitian matrix as a symmetric one of real numbers, which has each eigenvalue twice."""
    real = sp.csr_array(sp.block_array([[matrix.real, -matrix.imag], [matrix.imag, matrix.real]]))
    real.sort_indices()
    return real


def _waves(
    scene: Scene,
    fraction_kd: NDArray[np.float64],
    corner_k: NDArray[np.int64],
    count: int | None,
    kind: Kind,
    rattlers: str,
    gap_tolerance: float | None,
) -> Waves:
    start = time.process_time()
    cell = WaveCell(scene, kind, rattlers, gap_tolerance)
    branches = cell.branches
    wanted = branches if count is None else min(integer("count", count, at_least=1), branches)
    dense = branches <= DENSE_ROWS or wanted > branches // 4
    if dense and branches > _DENSE_LIMIT:
        raise ValueError(f"count must be given, and small, for more than {_DENSE_LIMIT} coordinates, got {branches}")
    frequency, residual, missed = np.zeros((len(fraction_kd), wanted)), 0.0, 0
    with single_thread():
        for k, fraction in enumerate(fraction_kd if wanted else []):
            value, left, lacking = _lowest(cell.matrix(fraction), wanted, dense)
            frequency[k] = np.copysign(np.sqrt(np.abs(value)), value)
            residual, missed = max(residual, left), missed + lacking
    along = np.concatenate([[0.0], np.cumsum(_lengths(scene, np.diff(fraction_kd, axis=0)))])[: len(fraction_kd)]
    seconds = time.process_time() - start
    rest = resting_forces(scene)
    return Waves(
        *(fraction_kd, frequency, along, corner_k, branches, residual, cell.index_n, seconds),
        rest.residual,
        rest.at_rest,
        missed,
    )


def _lowest(matrix: sp.csr_array, count: int, dense: bool) -> tuple[NDArray[np.float64], float, int]:
    """Return the lowest eigenvalues of a Hermitian matrix, the largest residual over a bound, and how many lack."""
    import scipy.linalg

    bound = float(abs(matrix).sum(axis=1).max()) or 1.0
    missed = 0
    if dense:
        value, vector = scipy.linalg.eigh(matrix.toarray(), subset_by_index=(0, count - 1))
    else:
        value, vector, missed = _shift_invert(matrix, count, bound)
    left = np.abs(matrix @ vector - vector * value).max(initial=0.0)
    # rounding is no frequency
    return np.where(np.abs(value) <= 1e-15 * bound * len(vector), 0.0, value), float(left / bound), missed


def _shift_invert(
    matrix: sp.csr_array, count: int, bound: float
) -> tuple[NDArray[np.float64], NDArray[np.complex128], int]:
    """Return the lowest eigenvalues and vectors, and how many lower ones a count by inertia shows to be missing."""
    rows, real = matrix.shape[0], real_form(matrix)
    shift = -_SHIFT * bound
    while eigenvalues_below(real, shift):
        shift *= 8.0
    solve = spla.splu(sp.csc_array(matrix - shift * sp.eye_array(rows))).solve
    found, value, missed = np.zeros((rows, 0), dtype=complex), np.zeros(0), count + 2
    for turn in itertools.count():
        # Lanczos may overlook members of a degenerate set: the next run searches across what was found
        more = min(missed, count + 2, rows - found.shape[1] - 1)
        found = np.hstack([found, _lanczos(matrix, solve, shift, found, more, turn)])
        value, inside = np.linalg.eigh(found.conj().T @ (matrix @ found))
        found = found @ inside
        missed = count + 2 - len(value) if len(value) < count + 2 else _missed(real, value, count, bound)
        if missed <= 0 or (turn >= _ROUNDS and len(value) > count):
            break
    return value[:count], found[:, :count], max(missed, 0)


def _lanczos(
    matrix: sp.csr_array,
    solve: Callable[[NDArray[np.complex128]], NDArray[np.complex128]],
    shift: float,
    taken: NDArray[np.complex128],
    count: int,
    turn: int,
) -> NDArray[np.complex128]:
    """Return orthonormal vectors of the eigenvalues nearest to the shift, across those that are taken."""

    def across(vector: NDArray[np.complex128]) -> NDArray[np.complex128]:
        return np.asarray(vector - taken @ (taken.conj().T @ vector))

    rows = matrix.shape[0]
    inverse = spla.LinearOperator((rows, rows), matvec=lambda v: across(solve(across(v.ravel()))), dtype=complex)
    rng = np.random.default_rng(turn)
    # newer SciPy restarts from its own generator: give it a seed, so that a repetition has the same bits
    seeded = {"rng": rng} if "rng" in inspect.signature(spla.eigsh).parameters else {}
    while True:
        begin = across(rng.normal(size=rows).astype(complex))
        room = min(rows, max(2 * count + 1, count + 40))
        try:
            _, vector = spla.eigsh(
                matrix, k=count, sigma=shift, OPinv=inverse, v0=begin, ncv=room, tol=0.0, maxiter=_RESTARTS, **seeded
            )
        except spla.ArpackError as failure:
            # of few different eigenvalues, each of many waves, it can run out of directions before it has all: what it
            # has will do, and where that is nothing fewer may be found
            vector = getattr(failure, "eigenvectors", np.zeros((rows, 0)))
            if not vector.shape[1] and count == 1:
                raise
        if vector.shape[1]:
            return np.asarray(np.linalg.qr(across(vector))[0])
        count = (count + 1) // 2


def _missed(real: sp.csr_array, value: NDArray[np.float64], count: int, bound: float) -> int:
    """Return how many eigenvalues below the highest of so many a list lacks, by the inertia in a gap of the list.

    The gap is the widest above them, or the next one below where those above are one degenerate set.
    """
    gap = np.diff(value)
    k = count - 1 + int(np.argmax(gap[count - 1 :]))
    if gap[k] <= _DEGENERATE * bound:
        k = max(np.flatnonzero(gap[:k] > _DEGENERATE * bound).tolist(), default=-1)
    level = 0.5 * float(value[k] + value[k + 1]) if k >= 0 else float(value[0]) - _DEGENERATE * bound
    return eigenvalues_below(real, level) // 2 - (k + 1)


def _speeds_in_words(one: SoundSpeeds) -> str:
    words = f"speeds {', '.join(f'{v:.5g}' for v in one.speed_m)} [length/time]"
    return unless_at_rest(one.force_residual, one.at_rest, words if one.density else "all particles rattle: no sound")


@shown(_speeds_in_words)
@dataclass(frozen=True, eq=False)
class SoundSpeeds:
    """Speeds of the d waves of great length along one direction, ascending.

    Attributes
    ----------
    direction_d
        (d,) unit vector along which they travel [1].
    speed_m
        (d,) speeds [length/time]; minus the root of minus the square where that is negative, and the wave grows.
    polarization_md
        (d, d) directions in which particles move, one in a row.
    density
        Mass of the particles that take part over the volume [mass/length^d].
    residual
        Of the linear solve, over the largest force of a contact under a unit strain [1].
    force_residual, at_rest
        As in `Waves`.

    """

    direction_d: NDArray[np.float64]
    speed_m: NDArray[np.float64]
    polarization_md: NDArray[np.float64]
    density: float
    residual: float
    force_residual: float
    at_rest: bool


@shown_as("speeds of sound")
@honors("repulsion kinds bonds interactions shapes memory", at_rest=True, rough="pm.elastic_moduli")
def sound_speeds(
    scene: Scene,
    direction: Sequence[float] | NDArray[Any],
    *,
    kind: Kind = "exact",
    rattlers: str = "remove",
    gap_tolerance: float | None = None,
) -> SoundSpeeds:
    """Return the speeds of sound along a direction: frequencies over wave vectors, as these go to zero.

    A wave of great length along k displaces by a cos(k.x), which is the displacement gradient a k at each place; the
    particles relax in it. With C the second derivatives of the energy over the volume by gradients a k, relaxed, the
    squared speeds are the eigenvalues of C over the density of mass: Christoffel's, with the stress at rest in it.

    Parameters
    ----------
    scene, kind, rattlers, gap_tolerance
        As in `waves`.
    direction
        (d,) where they travel to; its length does not matter.

    Examples
    --------
    Of a triangular crystal these are the roots of (B + G) / density and G / density:

    >>> import packmech as pm
    >>> crystal = pm.Scene(pm.lattice_packing("triangular", repeats=(1, 1)), (pm.Repulsion(),))
    >>> moduli, speeds = pm.elastic_moduli(crystal), pm.sound_speeds(crystal, [1.0, 0.0])
    >>> float(speeds.speed_m[0] ** 2 * speeds.density / moduli.shear_modulus).__round__(9)
    1.0

    """
    instance("scene", scene, Scene)
    one_of("kind", kind, KINDS)
    refuse_no_copies(scene, "scene must be without")
    packing, d = scene.packing, scene.packing.dimension
    along = finite_array("direction", direction, shape=(d,), what="component")
    size = float(np.sqrt(along @ along))
    if not size > 0.0:
        raise ValueError(f"direction must have a length, got {along.tolist()}")
    along = along / size
    with single_thread():
        system = system_of(scene, kind, gap_tolerance=gap_tolerance, rattlers=rattlers, strained=False)
        relaxed = _relaxed(system, np.eye(d)[:, :, None] * along)
    density = float(packing.mass_n[system.network.index_n].sum()) / packing.box.volume
    rest = resting_forces(scene)
    if not density:
        return SoundSpeeds(along, np.zeros(d), np.eye(d), 0.0, 0.0, rest.residual, rest.at_rest)
    stiffness, residual = relaxed
    value, vector = np.linalg.eigh(stiffness / (packing.box.volume * density))
    # rounding of what cancels is no speed
    value[np.abs(value) <= 1e-13 * np.abs(value).max(initial=0.0)] = 0.0
    speed = np.copysign(np.sqrt(np.abs(value)), value)
    return SoundSpeeds(along, speed, vector.T, density, residual, rest.residual, rest.at_rest)


def _relaxed(system: System, gradient_edd: NDArray[np.float64]) -> tuple[NDArray[np.float64], float]:
    """Return second derivatives of the energy by displacement gradients, relaxed, and the solve's residual."""
    network = system.network
    assembled = assemble(system.elements, network.turn_nkt, network.dimension, basis_edd=gradient_edd)
    if not network.pinned_f.any():
        return assembled.corner_ee, 0.0
    found = relax(System(network, system.terms, system.elements, assembled, carried=False))
    return assembled.corner_ee - found.relief_ee, found.residual
