"""Normal modes: the lowest ones, all, or all in a window of frequencies."""

from __future__ import annotations

import inspect
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from packmech.calls.display import shown
from packmech.calls.honors import honors
from packmech.calls.status import shown_as
from packmech.check import BoxStrain, Kind, finite_array, instance, integer, one_of
from packmech.jit.blas import single_thread
from packmech.linalg.factor import NotDefinite
from packmech.linalg.threads import factor_threads
from packmech.measure.contact_forces import resting_forces, unless_at_rest
from packmech.mechanics.hessian import check_choices, check_strain_of_box
from packmech.mechanics.linked_systems import Operator
from packmech.mechanics.vibrations import ZERO, Vibrations, vibrations_of
from packmech.scene import Scene

METHODS = ("auto", "dense", "shift-invert")
# the shift lies this far below zero, in units of (a bound on) the largest eigenvalue
_SHIFT = 1e-6
_DENSE_ROWS = 400
_DENSE_LIMIT = 8192
_ROUNDS = 6
# modes that one factorization is searched for in a window of more, and where these are cut in turn, if need be
_SLICE = 100
_CUTS = (0.5, 0.47, 0.54, 0.41)
# frequencies that a repr names
_SHOWN = 5


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
        (M,) squared frequencies, ascending [1/time^2]; negative ones are directions in which the packing falls apart.
    displacement_mnd
        (M, N, d) displacements, zero for particles that were left out; with the strains, and the turns of particles
        with shapes, they are orthonormal in the mass metric, sum of mass * (u.u + t.t) + strain_scale^2 e.e = 1.
    strain_me
        (M, s) Mandel strains; zero in a fixed box.
    residual
        Largest |D q - eigenvalue q| of a mode over (a bound on) the largest eigenvalue [1].
    available
        Number of modes that the packing has besides translations; M of them are here, the lowest but for `below`.
    translations, translation_error
        Number of uniform translations that cost nothing (d, fewer where walls or held particles anchor the packing),
        and how far they are from zero modes: |D t| over the largest eigenvalue [1].
    missed
        Modes below the highest returned one, and within the window asked for, that a count by inertia sees and this
        list lacks; 0 in a correct answer.
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
    below
        Number of modes below those in the window asked for; 0 where the lowest were.
    certain
        Whether the counts behind `missed` hold whatever rounding did, as in `ModeCounts`.
    relative_residual
        Largest |D q - eigenvalue q| of a mode over the size of its own eigenvalue, zero modes left out [1].

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
    below: int = 0
    certain: bool = True
    relative_residual: float = 0.0

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
    between: tuple[float, float] | None = None,
    strain: BoxStrain = "none",
    kind: Kind = "exact",
    volume_curvature: str = "det",
    strain_scale: float | None = None,
    rattlers: str = "remove",
    gap_tolerance: float | None = None,
    method: str = "auto",
    threads: int = 1,
) -> Modes:
    """Return the lowest normal modes of a packing, all in a window of frequencies, or all of them.

    Rigid links keep their lengths: modes are those of P M^-1/2 H M^-1/2 P, P the projector on what the links admit,
    given in positions and strains.

    Parameters
    ----------
    scene
        The scene; its packing should be at rest.
    count
        How many modes, counted from the lowest and without the d translations; None for all. A packing with fewer
        gives those it has.
    between
        Angular frequencies low and high, in place of a count [1/time]: all modes from low on and below high. How many
        there are is counted by inertia, as `count_modes` does. Low below zero takes in unstable modes.
    strain, kind, volume_curvature, strain_scale
        As in `dynamical_matrix`.
    rattlers
        "remove" leaves them out; "keep" adds their zero modes.
    gap_tolerance
        As in `hessian`.
    method
        "dense" diagonalization, "shift-invert" (Lanczos on the factored matrix, started from a fixed vector; in slices
        of about a hundred modes where a window holds more), or "auto": dense for up to 400 rows, for all modes, or for
        more than a quarter of them. Lowest 50, one thread, CPU seconds: 2D N = 1024 .05 against .5; a window of 500, N
        = 102,400: 253, and 5.2 GB.
    threads
        Number of threads of the factorizations; it changes no bit, and `seconds` counts the time of all. Two pay in
        space: lowest 30 of 8192 spheres 1.6 times as fast, of 65536 discs 1.1.

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
    >>> scene = pm.Scene(crystal, (pm.Repulsion(),))
    >>> modes = pm.normal_modes(scene)
    >>> len(modes), modes.translations, round(float(modes.frequency_m[-1]), 6)
    (30, 2, 2.44949)
    >>> high = pm.normal_modes(scene, between=(2.0, 3.0))
    >>> len(high), high.below, high.missed
    (9, 21, 0)

    """
    start = time.process_time()
    instance("scene", scene, Scene)
    check_choices(kind, strain, volume_curvature)
    one_of("method", method, METHODS)
    if count is not None:
        count = integer("count", count, at_least=1)
    window = None if between is None else _window_of(between, count)
    packing = scene.packing
    mass, dimension = packing.mass_n, packing.dimension
    check_strain_of_box(scene, strain)
    integer("threads", threads, at_least=1)
    with single_thread(), factor_threads(threads):
        vibrations = vibrations_of(
            scene, kind, strain=strain, volume_curvature=volume_curvature, strain_scale=strain_scale,
            rattlers=rattlers, gap_tolerance=gap_tolerance,
        )  # fmt: skip
        operator, translation, largest = vibrations.operator, vibrations.translation, vibrations.largest
        index, free_nq, axis = vibrations.index_n, vibrations.free_nq, vibrations.axis_f
        kept, coordinates, moving = len(index), len(axis), translation.shape[1]
        available = vibrations.available
        low = _End(-np.inf, 0, True)
        if window is None:
            high = _End(np.inf, available if count is None else min(count, available), True)
        else:
            low, high = (_End.at(vibrations, vibrations.level(one)) for one in window)
        wanted = max(high.below - low.below, 0)
        method = _choose(method, operator.motions, moving, wanted, count, window is not None)
        if method == "dense":
            value, vector = _dense(
                operator.matrix, vibrations.basis(), translation, largest, wanted, low.below if window else 0
            )
            inside = int(np.count_nonzero((value >= low.level) & (value < high.level)))
            missed, certain = wanted - inside, low.certain and high.certain
        elif window is None:
            value, vector, missed, certain = _shift_invert(operator, translation, largest, wanted)
        else:
            value, vector, missed, certain = _in_window(vibrations, low, high)
            wanted = len(value)
        size_m = np.sqrt(((operator.apply(vector) - vector * value) ** 2).sum(axis=0))
        worst = float(size_m.max(initial=0.0))
        own = np.abs(value) > ZERO * largest
        relative = float((size_m[own] / np.abs(value[own])).max(initial=0.0))
        drift = float(np.sqrt((operator.apply(translation) ** 2).sum(axis=0)).max(initial=0.0)) if kept else 0.0
    whole = resting_forces(scene)
    whole.warn_of_rattlers(packing.particles - len(vibrations.network.index_n))
    vector = signed_columns(vector)
    motion = np.zeros((wanted, *free_nq.shape))
    motion[:, free_nq] = vector[:coordinates].T
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
        strain_me=vector[coordinates:].T @ vibrations.admitted_es.T / vibrations.strain_scale,
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
        rotation_m=(vector[:coordinates][axis >= dimension] ** 2).sum(axis=0),
        participation_m=participation,
        mass_n=mass,
        below=low.below,
        certain=certain,
        relative_residual=relative,
    )


class _End(NamedTuple):
    """An end of a window: an eigenvalue, how many modes lie below it, and whether that is certain."""

    level: float
    below: int
    certain: bool

    @classmethod
    def at(cls, vibrations: Vibrations, level: float) -> _End:
        """Return the end at a level."""
        found = vibrations.count(level)
        return cls(level, found.number, found.certain)

    @property
    def frequency(self) -> float:
        """Its angular frequency, minus the growth rate where it is unstable."""
        return float(np.copysign(np.sqrt(abs(self.level)), self.level))


def _window_of(between: Any, count: int | None) -> tuple[float, float]:
    """Return the checked ends of a window."""
    if count is not None:
        raise ValueError(f"count must be left out where a window between frequencies is given, got {count}")
    low, high = finite_array("between", between, shape=(2,), what="end").tolist()
    if not low < high:
        raise ValueError(f"between must be a lower and a higher frequency, got {low:g} and {high:g}")
    return low, high


def _choose(method: str, rows: int, translations: int, wanted: int, count: int | None, windowed: bool) -> str:
    many = wanted > rows // 4 and rows <= _DENSE_LIMIT if windowed else count is None or wanted > rows // 4
    chosen = ("dense" if rows <= _DENSE_ROWS or many else "shift-invert") if method == "auto" else method
    # Lanczos needs room beyond the modes it finds
    if chosen == "shift-invert" and (wanted >= rows - max(translations, 1) or (windowed and rows <= 2 * _SLICE)):
        chosen = "dense"
    if chosen == "dense" and rows > _DENSE_LIMIT:
        if windowed:
            raise ValueError(f"method must be 'shift-invert' for more than {_DENSE_LIMIT} coordinates, got {method!r}")
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
    first: int = 0,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return modes from a number on, within the orthonormal columns of a basis if one is given."""
    import scipy.linalg

    if not wanted:
        return np.zeros(0), np.zeros((len(translation), 0))
    if basis is not None:
        inside = sp.csr_array(basis.T @ (matrix @ basis))
        value, vector = _dense(inside, None, basis.T @ translation, largest, wanted, first)
        return value, basis @ vector
    full = matrix.toarray()
    # lift the translations above everything else, out of the way
    full += (4.0 * largest or 1.0) * (translation @ translation.T)
    rows = len(full)
    last = first + wanted
    subset = None if wanted > rows // 3 else (first, last - 1)
    value, vector = scipy.linalg.eigh(full, subset_by_index=subset)
    if largest == 0.0:
        value = np.zeros_like(value)
    return (value, vector) if subset else (value[first:last], vector[:, first:last])


def _stable_shift(operator: Operator, largest: float) -> float:
    """Return a shift below all eigenvalues: just under zero for a stable packing, lower if need be."""
    shift = -_SHIFT * (largest or 1.0)
    while operator.below(shift):
        shift *= 8.0
    return shift


def _shift_invert(
    operator: Operator, translation: NDArray[np.float64], largest: float, wanted: int
) -> tuple[NDArray[np.float64], NDArray[np.float64], int, bool]:
    """Return the lowest modes, how many of them were missed, and whether that is certain."""
    if not wanted:
        return np.zeros(0), np.zeros((len(translation), 0)), 0, True
    shift = _stable_shift(operator, largest)
    certain = True

    def missed_of(value: NDArray[np.float64]) -> int:
        nonlocal certain
        missed, certain = _missed(operator, value[:wanted], largest, translation.shape[1])
        return missed

    value, found, missed = _search(operator, operator.solver(shift), shift, translation, wanted, missed_of)
    return value[:wanted], found[:, :wanted], max(missed, 0), certain


def _search(
    operator: Operator,
    solve: Callable[[NDArray[np.float64]], NDArray[np.float64]],
    shift: float,
    translation: NDArray[np.float64],
    wanted: int,
    missed_of: Callable[[NDArray[np.float64]], int],
) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
    """Return the modes nearest to a shift, ascending, in runs of Lanczos until a count misses none."""
    found = np.zeros((operator.size, 0))
    value, missed = np.zeros(0), wanted
    for turn in range(_ROUNDS):
        # a Lanczos run can overlook a member of a degenerate set; the next one searches across what was found
        taken = np.hstack([translation, found])
        more = min(wanted if turn == 0 else max(missed, 1), operator.motions - taken.shape[1] - 1)
        if more < 1:
            break
        found = np.hstack([found, _lanczos(operator, solve, shift, taken, more, turn)])
        value, inside = np.linalg.eigh(found.T @ operator.apply(found))
        found = found @ inside
        missed = missed_of(value)
        if missed <= 0:
            break
    return value, found, missed


def _in_window(
    vibrations: Vibrations, low: _End, high: _End
) -> tuple[NDArray[np.float64], NDArray[np.float64], int, bool]:
    """Return all modes between two ends, how many the counts say are missing, and whether these are certain."""
    operator = vibrations.operator
    values, vectors, missed, certain = [np.zeros(0)], [np.zeros((operator.size, 0))], 0, low.certain and high.certain
    slices = list(_slices(vibrations, low, high))
    for bottom, top in slices:
        value, vector, lacking = _between(vibrations, bottom, top)
        values.append(value)
        vectors.append(vector)
        missed += max(lacking, 0)
        certain = certain and bottom.certain and top.certain and lacking >= 0
    value, vector = np.concatenate(values), np.hstack(vectors)
    if len(slices) > 1:
        # nearly equal eigenvalues to both sides of a cut need not have come out orthogonal
        vector = np.linalg.qr(vector)[0]
        value, inside = np.linalg.eigh(vector.T @ operator.apply(vector))
        vector = vector @ inside
    return value, vector, missed, certain


def _slices(vibrations: Vibrations, low: _End, high: _End) -> Iterator[tuple[_End, _End]]:
    """Give slices of a window, of about a hundred modes each, empty ones left out."""
    if high.below <= low.below:
        return
    if high.below - low.below <= _SLICE or high.level - low.level <= ZERO * vibrations.largest:
        yield low, high
        return
    for part in _CUTS:
        level = vibrations.level(low.frequency + part * (high.frequency - low.frequency))
        middle = _End.at(vibrations, level)
        if middle.certain:
            break
    yield from _slices(vibrations, low, middle)
    yield from _slices(vibrations, middle, high)


def _between(vibrations: Vibrations, low: _End, high: _End) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
    """Return the modes between two ends, and how many the counts say are missing."""
    operator, expected = vibrations.operator, high.below - low.below

    def inside(value: NDArray[np.float64]) -> NDArray[np.bool_]:
        return (value >= low.level) & (value < high.level)

    def missed_of(value: NDArray[np.float64]) -> int:
        return expected - int(np.count_nonzero(inside(value)))

    for part in _CUTS:
        # a shift that is an eigenvalue cannot be inverted
        shift = low.level + part * (high.level - low.level)
        try:
            solve = operator.solver(shift, definite=False)
            break
        except NotDefinite as failure:
            reason = failure
    else:
        raise reason
    # those nearest to the shift are not quite those of the slice
    wanted = expected + expected // 8 + 6
    value, found, missed = _search(operator, solve, shift, vibrations.translation, wanted, missed_of)
    chosen = inside(value)
    return value[chosen], found[:, chosen], missed


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


def _missed(operator: Operator, value: NDArray[np.float64], largest: float, translations: int) -> tuple[int, bool]:
    """Return how many eigenvalues the list lacks, by the inertia at the widest gap among its upper quarter.

    And whether that is certain.
    """
    upper = np.sort(value)[-max(2, len(value) // 4) :]
    gap = np.diff(upper)
    if len(gap) and gap.max() > 1e-9 * largest:
        k = int(np.argmax(gap))
        bound = float(upper[k] + upper[k + 1]) / 2.0
    else:
        bound = float(value.min()) - 1e-7 * largest
    # the translations were projected out of the list, but the matrix still has their zeros
    listed = int(np.count_nonzero(value < bound)) + (translations if bound > 0.0 else 0)
    found = operator.count(bound)
    return found.number - listed, found.certain
