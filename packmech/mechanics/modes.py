"""Normal modes and the density of vibrational states."""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from packmech.calls.display import shown
from packmech.calls.honors import honors
from packmech.calls.status import shown_as
from packmech.check import KINDS, BoxStrain, Kind, bin_edges, instance, integer, one_of
from packmech.constraints.basis import motion_basis
from packmech.constraints.jacobian import scale_of_strain
from packmech.jit.blas import single_thread
from packmech.linalg.mandel import strain_directions
from packmech.measure.contact_forces import resting_forces, unless_at_rest
from packmech.mechanics.hessian import check_choices, check_strain_of_box, corner_of
from packmech.mechanics.linked_systems import Operator, free_translations, link_motions, operator_of, rows_on
from packmech.mechanics.network import Network
from packmech.mechanics.system import bordered, system_of
from packmech.scene import Scene

METHODS = ("auto", "dense", "shift-invert")
# the shift lies this far below zero, in units of (a bound on) the largest eigenvalue
_SHIFT = 1e-6
_DENSE_ROWS = 400
_DENSE_LIMIT = 8192
_ROUNDS = 6
# densities at the end of a plateau are averaged over this ratio of frequencies to both sides
_WINDOW = 1.25
# frequencies that a repr names
_SHOWN = 5
# enough for all modes that the dense method takes on [bytes]
_BASIS_BYTES = 3e9


def lowest_in_words(count: int, frequency_m: NDArray[Any]) -> str:
    """Return how many modes there are, and the frequencies of the lowest few, in one line."""
    few = frequency_m[:_SHOWN]
    if not len(few):
        return f"{count} modes"
    more = ", ..." if count > len(few) else ""
    return f"{count} modes, frequencies {', '.join(f'{one:.5g}' for one in few)}{more} [1/time]"


@shown(lambda one: unless_at_rest(one.force_residual, one.at_rest, lowest_in_words(len(one), one.frequency_m)))
@dataclass(frozen=True, eq=False)
class Modes:
    """Normal modes in order of their eigenvalues, uniform translations left out.

    Attributes
    ----------
    eigenvalue_m
        (M,) squared frequencies [1/time^2]; negative ones are directions in which the packing falls apart.
    displacement_mnd
        (M, N, d) displacements, zero for particles that were left out; with the strains, and the turns of particles
        with shapes, they are orthonormal in the mass metric, sum of mass * (u.u + t.t) + strain_scale^2 e.e = 1.
    strain_me
        (M, s) Mandel strains; zero in a fixed box.
    residual
        Largest |D q - eigenvalue q| of a mode over (a bound on) the largest eigenvalue [1].
    available
        Number of modes that the packing has besides translations; M of them are here, the lowest.
    translations, translation_error
        Number of uniform translations that cost nothing (d, fewer where walls or held particles anchor the packing),
        and how far they are from zero modes: |D t| over the largest eigenvalue [1].
    missed
        Modes below the highest returned one that an inertia count sees and this list lacks; 0 in a correct answer.
    largest
        Bound on the largest eigenvalue, by row sums [1/time^2].
    force_residual
        Largest net force on a particle over the mean contact force of the packing as given, rattlers included [1]:
        when this is not small, the packing is not at rest, and these are no normal modes.
    index_n
        (N',) particles that took part.
    method
        "dense" or "shift-invert".
    seconds
        CPU time.
    turn_mnk
        (M, N, K) turns of particles with shapes, angles times radii of gyration, as in `hessian`; K = 0 without.
    rotation_m
        (M,) part of each mode's motion that is turns, between 0 and 1.
    participation_m
        (M,) participation ratio of each mode among the N' particles that took part, between 1 / N' and 1: (sum of w)^2
        over N' sum of w^2, w the part of the mode on one particle, mass * (u.u + t.t). 0 where no particle moves.
    mass_n
        (N,) masses of the particles [mass].
    at_rest
        Whether `force_residual` is at most a hundredth, or no more than rounding of the coordinates makes of it.

    """

    eigenvalue_m: NDArray[np.float64]
    displacement_mnd: NDArray[np.float64]
    strain_me: NDArray[np.float64]
    residual: float
    available: int
    translations: int
    translation_error: float
    missed: int
    largest: float
    force_residual: float
    index_n: NDArray[np.int64]
    method: str
    seconds: float
    turn_mnk: NDArray[np.float64]
    rotation_m: NDArray[np.float64]
    participation_m: NDArray[np.float64]
    mass_n: NDArray[np.float64]
    at_rest: bool = True

    def __len__(self) -> int:
        return len(self.eigenvalue_m)

    @property
    def frequency_m(self) -> NDArray[np.float64]:
        """The (M,) angular frequencies [1/time]; unstable modes have minus the growth rate, -sqrt(-eigenvalue)."""
        return np.copysign(np.sqrt(np.abs(self.eigenvalue_m)), self.eigenvalue_m)

    @property
    def part_mn(self) -> NDArray[np.float64]:
        """The (M, N) parts of the modes on each particle, mass * (u.u + t.t) [1]."""
        square_mn = (self.displacement_mnd**2).sum(axis=2) + (self.turn_mnk**2).sum(axis=2)
        return np.asarray(self.mass_n * square_mn)

    @property
    def complete(self) -> bool:
        """Whether these are all modes that the packing has."""
        return len(self) == self.available

    @property
    def zero_m(self) -> NDArray[np.bool_]:
        """Which modes are zero to rounding: eigenvalue below 1e-10 of the largest."""
        return np.abs(self.eigenvalue_m) <= 1e-10 * self.largest

    @property
    def negative(self) -> int:
        """Number of unstable modes among these, zero modes not counted."""
        return int(np.count_nonzero((self.eigenvalue_m < 0.0) & ~self.zero_m))


@honors(
    "repulsion kinds bonds interactions gravity walls held links shapes memory",
    at_rest=True,
    rough="pm.frictional_modes",
)
@shown_as("normal modes")
def normal_modes(
    scene: Scene,
    count: int | None = None,
    *,
    strain: BoxStrain = "none",
    kind: Kind = "exact",
    volume_curvature: str = "det",
    strain_scale: float | None = None,
    rattlers: str = "remove",
    gap_tolerance: float | None = None,
    method: str = "auto",
) -> Modes:
    """Return the lowest normal modes of a packing, or all of them.

    Rigid links keep their lengths: modes are those of P M^-1/2 H M^-1/2 P, P the projector on what the links admit,
    given in positions and strains.

    Parameters
    ----------
    scene
        The scene; its packing should be at rest.
    count
        How many modes, counted from the lowest and without the d translations; None for all. A packing with fewer
        gives those it has.
    strain, kind, volume_curvature, strain_scale
        As in `dynamical_matrix`.
    rattlers
        "remove" leaves them out; "keep" adds their zero modes.
    gap_tolerance
        As in `hessian`.
    method
        "dense" diagonalization, "shift-invert" (Lanczos on the factored matrix, started from a fixed vector), or
        "auto": dense for up to 400 rows, for all modes, or for more than a quarter of them. Lowest 50, one thread,
        CPU seconds: 2D N = 1024 .05 against .5.

    Returns
    -------
    Modes
        Every mode found is checked against the count of eigenvalues by inertia (`Modes.missed`).

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind, a name is unknown, or all modes of more than 8192 coordinates are asked
        for.

    Examples
    --------
    >>> import packmech as pm
    >>> crystal = pm.lattice_packing("triangular", repeats=(4, 4)).replace(mass_n=[1.0] * 16)
    >>> modes = pm.normal_modes(pm.Scene(crystal, (pm.Repulsion(),)))
    >>> len(modes), modes.translations, round(float(modes.frequency_m[-1]), 6)
    (30, 2, 2.44949)

    """
    start = time.process_time()
    instance("scene", scene, Scene)
    check_choices(kind, strain, volume_curvature)
    one_of("method", method, METHODS)
    if count is not None:
        count = integer("count", count, at_least=1)
    packing = scene.packing
    mass = packing.mass_n
    scale = scale_of_strain(packing, strain_scale)
    check_strain_of_box(scene, strain)
    dimension = packing.dimension
    admitted = strain_directions(dimension, strain)
    with single_thread():
        system = system_of(scene, kind, gap_tolerance=gap_tolerance, rattlers=rattlers, strained=strain != "none")
        network, links, matrix = system.network, system.links, system.matrix()
        index, free_nq, axis, root = _moving(network, mass)
        kept = len(index)
        if strain != "none":
            corner = admitted.T @ corner_of(system, kind, strain, volume_curvature) @ admitted
            matrix = bordered(matrix, system.column() @ admitted / scale, corner / scale**2)
        weight = np.concatenate([1.0 / root, np.ones(admitted.shape[1])])
        matrix = sp.csr_array(matrix.multiply(weight[:, None]).multiply(weight[None, :]))
        rows = rows_on(links, network.free_f, 1.0 / root, admitted, scale)
        translation = free_translations(matrix, rows, root, axis, dimension, network.anchored)
        moving = translation.shape[1]
        operator = operator_of(matrix, rows, dimension)
        available = max(operator.motions - moving, 0) if kept else 0
        wanted = available if count is None else min(count, available)
        method = _choose(method, operator.motions, wanted, count)
        largest = float(abs(matrix).sum(axis=0).max()) if kept else 0.0
        if method == "dense":
            basis = None
            if len(links) and not network.free_f.all():
                basis = link_motions(rows)
            elif len(links):
                basis = motion_basis(links, admitted, mass_n=mass[index], strain_scale=scale, memory_limit=_BASIS_BYTES)
                basis = np.concatenate([basis[: len(root)] * root[:, None], admitted.T @ basis[len(root) :] * scale])
            value, vector = _dense(matrix, basis, translation, largest, wanted)
            missed = 0
        else:
            value, vector, missed = _shift_invert(operator, translation, largest, wanted)
        residual = operator.apply(vector) - vector * value
        worst = float(np.sqrt((residual**2).sum(axis=0)).max(initial=0.0))
        drift = float(np.sqrt((operator.apply(translation) ** 2).sum(axis=0)).max(initial=0.0)) if kept else 0.0
    whole = resting_forces(scene)
    whole.warn_of_rattlers(packing.particles - len(network.index_n))
    vector = signed_columns(vector)
    motion = np.zeros((wanted, *free_nq.shape))
    motion[:, free_nq] = vector[: len(root)].T
    part_mn = (motion**2).sum(axis=2)
    # a mode of the strains alone moves no particle
    square_m = (part_mn**2).sum(axis=1)
    participation = part_mn.sum(axis=1) ** 2 / (max(kept, 1) * np.where(square_m > 0.0, square_m, 1.0))
    motion /= np.sqrt(mass[index])[:, None]
    moved = np.zeros((wanted, packing.particles, motion.shape[2]))
    moved[:, index] = motion
    return Modes(
        eigenvalue_m=value,
        displacement_mnd=np.ascontiguousarray(moved[..., :dimension]),
        strain_me=vector[len(root) :].T @ admitted.T / scale,
        residual=worst / largest if largest else 0.0,
        available=available,
        translations=moving,
        translation_error=drift / largest if largest else 0.0,
        missed=missed,
        force_residual=whole.residual,
        at_rest=whole.at_rest,
        largest=largest,
        index_n=index,
        method=method,
        seconds=time.process_time() - start,
        turn_mnk=np.ascontiguousarray(moved[..., dimension:]),
        rotation_m=(vector[: len(root)][axis >= dimension] ** 2).sum(axis=0),
        participation_m=participation,
        mass_n=mass,
    )


class _Moving(NamedTuple):
    """The particles that move, their coordinates, and of each its place among its particle's and its root of a mass."""

    index_n: NDArray[np.int64]
    free_nq: NDArray[np.bool_]
    axis_f: NDArray[np.int64]
    root_f: NDArray[np.float64]


def _moving(network: Network, mass_n: NDArray[np.float64]) -> _Moving:
    """Return the particles of a network that are not held; turns are lengths, and so have their particle's mass."""
    moves = network.free_nq.any(axis=1)
    index, free = network.index_n[moves], network.free_nq[moves]
    return _Moving(index, free, np.nonzero(free)[1], np.repeat(np.sqrt(mass_n[index]), free.sum(axis=1)))


def _choose(method: str, rows: int, wanted: int, count: int | None) -> str:
    small = rows <= _DENSE_ROWS or count is None or wanted > rows // 4
    chosen = ("dense" if small else "shift-invert") if method == "auto" else method
    if chosen == "shift-invert" and wanted >= rows - 1:
        chosen = "dense"  # Lanczos needs room beyond the modes it finds
    if chosen == "dense" and rows > _DENSE_LIMIT:
        raise ValueError(
            f"count must be given, and small, for more than {_DENSE_LIMIT} coordinates, got {count} of {rows}"
        )
    return chosen


def signed_columns(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the columns with the first of their nearly largest entries positive."""
    if not vector.size:
        return vector
    size = np.abs(vector)
    first = np.argmax(size > 0.999 * size.max(axis=0), axis=0)
    sign: NDArray[np.float64] = np.sign(vector[first, np.arange(vector.shape[1])])
    return vector * sign


def _dense(
    matrix: sp.csr_array,
    basis: NDArray[np.float64] | None,
    translation: NDArray[np.float64],
    largest: float,
    wanted: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the lowest modes, within the orthonormal columns of a basis if one is given."""
    import scipy.linalg

    if not wanted:
        return np.zeros(0), np.zeros((len(translation), 0))
    if basis is not None:
        inside = sp.csr_array(basis.T @ (matrix @ basis))
        value, vector = _dense(inside, None, basis.T @ translation, largest, wanted)
        return value, basis @ vector
    full = matrix.toarray()
    # lift the translations above everything else, out of the way
    full += (4.0 * largest or 1.0) * (translation @ translation.T)
    rows = len(full)
    subset = None if wanted > rows // 3 else (0, wanted - 1)
    value, vector = scipy.linalg.eigh(full, subset_by_index=subset)
    if largest == 0.0:
        value = np.zeros_like(value)
    return value[:wanted], vector[:, :wanted]


def _stable_shift(operator: Operator, largest: float) -> float:
    """Return a shift below all eigenvalues: just under zero for a stable packing, lower if need be."""
    shift = -_SHIFT * (largest or 1.0)
    while operator.below(shift):
        shift *= 8.0
    return shift


def _shift_invert(
    operator: Operator, translation: NDArray[np.float64], largest: float, wanted: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
    if not wanted:
        return np.zeros(0), np.zeros((len(translation), 0)), 0
    shift = _stable_shift(operator, largest)
    rows = operator.size
    solve = operator.solver(shift)
    found = np.zeros((rows, 0))
    missed = 0
    for turn in range(_ROUNDS):
        # a Lanczos run can overlook a member of a degenerate set; the next one searches across what was found
        taken = np.hstack([translation, found])
        more = min(wanted if turn == 0 else max(missed, 1), operator.motions - taken.shape[1] - 1)
        found = np.hstack([found, _lanczos(operator, solve, shift, taken, more, turn)])
        value, inside = np.linalg.eigh(found.T @ operator.apply(found))
        found = found @ inside
        missed = _missed(operator, value[:wanted], largest, translation.shape[1])
        if missed <= 0:
            break
    return value[:wanted], found[:, :wanted], max(missed, 0)


def _lanczos(
    operator: Operator,
    solve: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    shift: float,
    taken: NDArray[np.float64],
    count: int,
    turn: int,
) -> NDArray[np.float64]:
    import scipy.sparse.linalg as spla

    def across(vector: NDArray[np.float64]) -> NDArray[np.float64]:
        rest: NDArray[np.float64] = vector - taken @ (taken.T @ vector)
        return rest

    rows = operator.size
    inverse = spla.LinearOperator((rows, rows), matvec=lambda v: across(solve(across(v.ravel()))), dtype=np.float64)
    begin = across(np.random.default_rng(turn).normal(size=rows))
    if operator.motions < rows:
        begin = across(solve(begin))
    room = min(operator.motions, max(2 * count + 1, count + 40))
    plain = spla.LinearOperator((rows, rows), matvec=lambda v: operator.apply(v.ravel()), dtype=np.float64)
    # newer SciPy restarts from its own generator: give it a seed, so that a repetition has the same bits
    seeded = {"rng": np.random.default_rng(turn)} if "rng" in inspect.signature(spla.eigsh).parameters else {}
    _, vector = spla.eigsh(
        plain, k=count, sigma=shift, OPinv=inverse, v0=begin, ncv=room, which="LM", tol=0.0, **seeded
    )
    kept: NDArray[np.float64] = np.linalg.qr(across(vector))[0]
    return kept


def _missed(operator: Operator, value: NDArray[np.float64], largest: float, translations: int) -> int:
    """Return how many eigenvalues the list lacks, by the inertia at the widest gap among its upper quarter."""
    upper = np.sort(value)[-max(2, len(value) // 4) :]
    gap = np.diff(upper)
    if len(gap) and gap.max() > 1e-9 * largest:
        k = int(np.argmax(gap))
        bound = float(upper[k] + upper[k + 1]) / 2.0
    else:
        bound = float(value.min()) - 1e-7 * largest
    # the translations were projected out of the list, but the matrix still has their zeros
    listed = int(np.count_nonzero(value < bound)) + (translations if bound > 0.0 else 0)
    return operator.below(bound) - listed


@shown()
@dataclass(frozen=True, eq=False)
class StateDensity:
    """Density of vibrational states over angular frequency.

    Attributes
    ----------
    edge_b
        (B + 1,) edges of the bins [1/time].
    count_b
        (B,) number of modes in each bin, uniform translations left out.
    modes
        Number of modes that the packing has besides translations that cost nothing.
    seconds
        CPU time.

    """

    edge_b: NDArray[np.float64]
    count_b: NDArray[np.int64]
    modes: int
    seconds: float

    @property
    def density_b(self) -> NDArray[np.float64]:
        """The (B,) density [time]: its integral over all frequencies is 1; zeros where there is no mode."""
        return self.count_b / (np.diff(self.edge_b) * max(self.modes, 1))

    @property
    def center_b(self) -> NDArray[np.float64]:
        """The (B,) middles of the bins [1/time]."""
        return (self.edge_b[1:] + self.edge_b[:-1]) / 2.0

    @property
    def plateau(self) -> float:
        """Height of the plateau [time]: the mean density between the lowest tenth and the lowest three tenths of modes.

        Harmonic packings near jamming, taken without their stress (kind="unstressed"), have one; nan without modes.
        """
        low, high = self._quantile(0.1), self._quantile(0.3)
        return 0.2 / (high - low) if self.modes else float("nan")

    @property
    def plateau_edge(self) -> float:
        """Angular frequency omega* at which the plateau ends [1/time]; nan where it reaches down to the lowest bin.

        Followed down from the lowest tenth of the modes, the density falls to half of the plateau here. Densities are
        those over a quarter of the frequency to both sides, so that few packings give a smooth curve; bins finer than
        that, and many modes, of several packings if need be, give a sharp answer.
        """
        center = np.sqrt(np.maximum(self.edge_b[1:] * self.edge_b[:-1], 0.0))
        center = center[(center > 0.0) & (center <= self._quantile(0.1))]
        below = np.concatenate([[0], np.cumsum(self.count_b)])
        number = np.interp(center * _WINDOW, self.edge_b, below) - np.interp(center / _WINDOW, self.edge_b, below)
        share = number / (center * (_WINDOW - 1.0 / _WINDOW) * self.modes * self.plateau)
        low = np.nonzero(share < 0.5)[0]
        if not len(low) or low[-1] + 1 == len(center):
            return float("nan")
        k = low[-1]
        part = (0.5 - share[k]) / (share[k + 1] - share[k])
        return float(center[k] ** (1.0 - part) * center[k + 1] ** part)

    def _quantile(self, part: float) -> float:
        """Return the frequency below which this part of the modes lies."""
        below = np.concatenate([[0], np.cumsum(self.count_b)])
        return float(np.interp(part * self.modes, below, self.edge_b))

    @classmethod
    def merged(cls, parts: Sequence[StateDensity]) -> StateDensity:
        """Return the states of several packings in one; their bins must be the same."""
        if not parts or any(not np.array_equal(one.edge_b, parts[0].edge_b) for one in parts):
            raise ValueError("parts must be densities over the same bins, and at least one")
        return cls(
            parts[0].edge_b,
            np.sum([one.count_b for one in parts], axis=0),
            sum(one.modes for one in parts),
            sum(one.seconds for one in parts),
        )


@honors(
    "repulsion kinds bonds interactions gravity walls held links shapes memory",
    at_rest=True,
    rough="pm.frictional_modes",
)
@shown_as("density of states")
def density_of_states(
    source: Modes | Scene,
    bins: int | ArrayLike = 50,
    *,
    kind: Kind = "exact",
    rattlers: str = "remove",
    gap_tolerance: float | None = None,
) -> StateDensity:
    """Return the density of vibrational states D(omega) = (N(omega + d omega) - N(omega)) / d omega, normalized to 1.

    N counts the modes up to a frequency, uniform translations left out, so that the normalization is d N' - d modes.
    For a scene N is counted by the inertia of the shifted Hessian, one sparse factorization for each bin edge and no
    mode computed: exact for any number of particles. Frequencies of unstable modes are minus their growth rates.

    Parameters
    ----------
    source
        All modes of a packing (`normal_modes(scene)`), or a scene, taken in its fixed box.
    bins
        Number of bins between zero (or the lowest unstable frequency) and the highest, or their edges [1/time].
    kind, rattlers, gap_tolerance
        As in `normal_modes`; used for a scene.

    Raises
    ------
    TypeError, ValueError
        If the source is neither, the modes are only some of the packing's, or the edges do not increase.

    Examples
    --------
    >>> import packmech as pm
    >>> scene = pm.Scene(pm.lattice_packing("triangular", repeats=(6, 6)), (pm.Repulsion(),))
    >>> states = pm.density_of_states(scene, 10)
    >>> int(states.count_b.sum()), round(float((states.density_b * np.diff(states.edge_b)).sum()), 12)
    (70, 1.0)

    """
    start = time.process_time()
    if isinstance(source, Modes):
        if not source.complete:
            raise ValueError(
                f"source must hold all modes, got {len(source)} of {source.available}; "
                "call normal_modes without a count, or pass the scene"
            )
        frequency = source.frequency_m
        top = max(float(frequency.max(initial=0.0)), 0.0)
        edge = _edges(bins, min(float(frequency.min(initial=0.0)), 0.0), top)
        count = np.histogram(frequency, edge)[0]
        return StateDensity(edge, count.astype(np.int64), source.available, time.process_time() - start)
    instance("source", source, Scene)
    one_of("kind", kind, KINDS)
    dimension = source.packing.dimension
    system = system_of(source, kind, gap_tolerance=gap_tolerance, rattlers=rattlers, strained=False)
    links, (index, _, axis, root) = system.links, _moving(system.network, source.packing.mass_n)
    if not len(index):
        edge = _edges(bins, 0.0, 1.0)
        return StateDensity(edge, np.zeros(len(edge) - 1, np.int64), 0, time.process_time() - start)
    with single_thread():
        weight = 1.0 / root
        matrix = sp.csr_array(system.matrix().multiply(weight[:, None]).multiply(weight[None, :]))
        none = np.zeros((dimension * (dimension + 1) // 2, 0))
        rows = rows_on(links, system.network.free_f, weight, none, 1.0)
        moving = free_translations(matrix, rows, root, axis, dimension, system.network.anchored).shape[1]
        operator = operator_of(matrix, rows, dimension)
        low, high = _ends(operator)
        edge = _edges(bins, low, high)
        # zero modes have eigenvalues of either sign at rounding: an edge at zero counts all of them above it
        rounding = 1e-10 * high**2
        level = np.sign(edge) * edge**2
        level[np.abs(level) < rounding] = -rounding
        below = np.array([operator.below(float(one)) for one in level])
        # uniform translations are zero modes of the matrix, not vibrations
        below = below - np.where(level > 0.0, moving, 0)
    modes = operator.motions - moving
    return StateDensity(edge, np.diff(below).astype(np.int64), modes, time.process_time() - start)


def _edges(bins: int | ArrayLike, low: float, high: float) -> NDArray[np.float64]:
    found = bin_edges("bins", bins)
    return np.linspace(low, high if high > low else low + 1.0, found + 1) if isinstance(found, int) else found


def _ends(operator: Operator) -> tuple[float, float]:
    """Return frequencies just below the lowest and above the highest mode, zero if none is unstable."""
    import scipy.sparse.linalg as spla

    rows = operator.size
    if rows < 40:
        value = np.linalg.eigvalsh(operator.apply(operator.project(np.eye(rows))))
        lowest, highest = float(value[0]), float(value[-1])
    else:
        begin = operator.project(np.random.default_rng(0).normal(size=rows))
        plain = spla.LinearOperator((rows, rows), matvec=lambda v: operator.apply(v.ravel()), dtype=np.float64)
        highest = float(spla.eigsh(plain, k=1, which="LA", v0=begin, return_eigenvectors=False)[0])
        lowest = 0.0
        if operator.below(-1e-10 * highest):
            lowest = float(spla.eigsh(plain, k=1, which="SA", v0=begin, return_eigenvectors=False)[0])
    floor = -1e-10 * abs(highest)
    # a hair outside, so that the outermost modes fall inside the outermost bins
    low = -np.sqrt(-lowest) * (1.0 + 1e-9) if lowest < floor else 0.0
    return float(low), float(np.sqrt(max(highest, 0.0)) * (1.0 + 1e-9))
