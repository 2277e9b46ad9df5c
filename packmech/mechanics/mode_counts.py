"""How many normal modes lie below a frequency, by the signs of a factorization: no mode is computed."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.calls.display import shown
from packmech.calls.honors import honors
from packmech.calls.status import shown_as
from packmech.check import BoxStrain, Kind, boolean, finite_array, given_shape, instance, integer
from packmech.jit.blas import single_thread
from packmech.linalg.threads import factor_threads
from packmech.measure.contact_forces import resting_forces, unless_at_rest
from packmech.mechanics.hessian import check_choices, check_strain_of_box
from packmech.mechanics.vibrations import ZERO, vibrations_of
from packmech.scene import Scene


def _in_words(one: ModeCounts) -> str:
    few = ", ".join(f"{count} below {below:.5g}" for count, below in zip(one.count_v[:3], one.below_v[:3], strict=True))
    more = ", ..." if len(one.below_v) > 3 else ""
    doubt = "" if one.certain_v.all() else f"; {int((~one.certain_v).sum())} of them uncertain"
    return unless_at_rest(one.force_residual, one.at_rest, f"of {one.available} modes {few}{more} [1/time]{doubt}")


@shown(_in_words)
@dataclass(frozen=True, eq=False)
class ModeCounts:
    """How many modes lie below angular frequencies, uniform translations left out, and how sure that is.

    Attributes
    ----------
    below_v
        (V,) angular frequencies [1/time]; unstable modes have minus their growth rate.
    count_v
        (V,) numbers of modes whose frequencies are lower.
    certain_v
        (V,) whether each holds whatever rounding did, but for a chance of one in a million.
    doubt_v
        (V,) bounds on |F^-1 (A - F)| [1], F what was factored in place of the matrix A minus the squared frequency; a
        number is certain where this is below 1. Infinite where the frequency is that of a mode, to rounding.
    distance_v
        (V,) how far the nearest squared frequency is at least, so that a count holds for all frequencies nearer than
        this [1/time^2]; 0 where it is not certain. Up to some thirty times less than the true distance.
    available
        Number of modes that the packing has besides translations.
    translations
        Number of uniform translations that cost nothing.
    negative, zero
        Numbers of unstable modes, and of those whose eigenvalues are at most 1e-10 of the largest one's bound, as in
        `Modes`; None where they were not asked for.
    signs_certain
        Whether these two numbers hold whatever rounding did, as `certain_v`; None where they were not asked for.
    largest
        Bound on the largest eigenvalue, by row sums [1/time^2].
    memory
        Of the factors, at most [bytes].
    force_residual, at_rest
        As in `Modes`.
    index_n
        (N',) particles that took part.
    seconds
        CPU time.

    """

    below_v: NDArray[np.float64]
    count_v: NDArray[np.int64]
    certain_v: NDArray[np.bool_]
    doubt_v: NDArray[np.float64]
    distance_v: NDArray[np.float64]
    available: int
    translations: int
    negative: int | None
    zero: int | None
    signs_certain: bool | None
    largest: float
    memory: int
    force_residual: float
    at_rest: bool
    index_n: NDArray[np.int64]
    seconds: float


@honors(
    "repulsion kinds bonds interactions gravity walls held links shapes memory",
    at_rest=True,
    rough="pm.frictional_modes",
)
@shown_as("number of modes")
def count_modes(
    scene: Scene,
    below: ArrayLike,
    *,
    signs: bool = True,
    strain: BoxStrain = "none",
    kind: Kind = "exact",
    volume_curvature: str = "det",
    strain_scale: float | None = None,
    rattlers: str = "remove",
    gap_tolerance: float | None = None,
    threads: int = 1,
) -> ModeCounts:
    """Return how many normal modes lie below frequencies, by the inertia of the shifted second derivatives.

    One sparse factorization for each value, and no mode computed. That a number is that of the matrix itself, not only
    of its rounded factors, is checked with random vectors (`ModeCounts.certain_v`). Measured, one thread, without
    `signs`, CPU seconds and memory for one value: a million discs 49 and 3.7 GB, a hundred thousand spheres 117 and 3.6
    GB; of a quarter of a million discs 10, and 2 for each further one.

    Parameters
    ----------
    scene
        The scene; its packing should be at rest.
    below
        One angular frequency or (V,) of them [1/time]; at 0 unstable modes are counted, zero modes not, and below zero
        those that grow faster than its size.
    signs
        Whether to count unstable and zero modes, too: one or two more factorizations.
    strain, kind, volume_curvature, strain_scale
        As in `dynamical_matrix`.
    rattlers
        "remove" leaves them out; "keep" adds their zero modes.
    gap_tolerance
        As in `hessian`.
    threads
        Number of threads of the factorizations; it changes no bit, and `seconds` counts the time of all. Two count
        the modes of 8192 spheres 1.6 times as fast, of 65536 discs 1.2.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind, or a name is unknown.

    Examples
    --------
    >>> import packmech as pm
    >>> crystal = pm.lattice_packing("triangular", repeats=(4, 4)).replace(mass_n=[1.0] * 16)
    >>> found = pm.count_modes(pm.Scene(crystal, (pm.Repulsion(),)), [1.0, 2.0, 3.0])
    >>> found.count_v.tolist(), found.available, found.negative, found.zero
    ([0, 21, 30], 30, 0, 0)

    """
    start = time.process_time()
    instance("scene", scene, Scene)
    levels: Any = below if given_shape(below) else [below]
    frequency = finite_array("below", levels, shape=(None,), what="value")
    boolean("signs", signs)
    check_choices(kind, strain, volume_curvature)
    check_strain_of_box(scene, strain)
    integer("threads", threads, at_least=1)
    with single_thread(), factor_threads(threads):
        vibrations = vibrations_of(
            scene, kind, strain=strain, volume_curvature=volume_curvature, strain_scale=strain_scale,
            rattlers=rattlers, gap_tolerance=gap_tolerance,
        )  # fmt: skip
        each = {one: vibrations.count(vibrations.level(one)) for one in dict.fromkeys(frequency.tolist())}
        found = [each[one] for one in frequency.tolist()]
        negative = zero = signs_certain = None
        if signs:
            floor = ZERO * (vibrations.largest or 1.0)
            soft = vibrations.count(floor)
            unstable = vibrations.count(-floor) if soft.number else soft
            negative, zero = unstable.number, soft.number - unstable.number
            signs_certain = soft.certain and unstable.certain
    rest = resting_forces(scene)
    rest.warn_of_rattlers(scene.packing.particles - len(vibrations.network.index_n))
    return ModeCounts(
        below_v=frequency,
        count_v=np.array([one.number for one in found], dtype=np.int64),
        certain_v=np.array([one.certain for one in found], dtype=bool),
        doubt_v=np.array([one.doubt for one in found]),
        distance_v=np.array([one.distance for one in found]),
        available=vibrations.available,
        translations=vibrations.translation.shape[1],
        negative=negative,
        zero=zero,
        signs_certain=signs_certain,
        largest=vibrations.largest,
        memory=max((one.memory for one in found), default=0),
        force_residual=rest.residual,
        at_rest=rest.at_rest,
        index_n=vibrations.index_n,
        seconds=time.process_time() - start,
    )
