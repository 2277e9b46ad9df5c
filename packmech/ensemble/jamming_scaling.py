"""`jamming_scaling`: how contacts, energy and moduli fall as packings are followed down to the jamming point."""

from __future__ import annotations

import math
import os
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial, update_wrapper
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from packmech.check import BoxStrain, function, instance, one_of, positive
from packmech.effects import pair_energy
from packmech.ensemble.callers import Finished, complete, folder_of, keep_scene, scene_at, scene_path
from packmech.honors import declare
from packmech.linalg.line import fit_line, windows_without_ends
from packmech.loop.run_loop import Progress
from packmech.measure.counting import packing_fraction
from packmech.measure.stress import energy
from packmech.mechanics.elasticity import elastic_moduli, voigt_average
from packmech.mechanics.modes import StateDensity, density_of_states
from packmech.protocols.compress import compress
from packmech.protocols.jam import check_method, jam
from packmech.protocols.method import JamMethod
from packmech.protocols.protocol import sequence
from packmech.protocols.sweep import sweep_pressure
from packmech.result import NotConverged, Outcome, Run
from packmech.scene import JamDrive, Scene

PRESSURES = tuple(10.0 ** (-2.0 - 0.5 * k) for k in range(9))
# what is measured of each packing at each pressure or distance, and its unit
COLUMNS = {
    "pressure": "energy_scale / diameter^d",
    "distance": "1",
    "packing_fraction": "1",
    "energy_per_particle": "energy_scale",
    "excess_coordination": "1",
    "bulk_modulus": "energy_scale / diameter^d",
    "shear_modulus": "energy_scale / diameter^d",
    "modulus_ratio": "1",
    "rearrangements": "1",
    "residual": "1",
}
_PRESSURE, _DISTANCE, _FRACTION = range(3)
# the end of the plateau of vibrational states is that of all packings together
EDGE = "plateau_edge"
HONORED = declare("jamming_scaling", "repulsion links shapes", at_rest=True)
# closer to jamming than this, times N^-2, a packing has a handful of contacts too many or none: N^2 P = 10 for springs
_COUNTED, _PRESSED = 25.0, 10.0
# |b| of the terms b / (N sqrt(x)) that `fit_sizes` finds for discs of N = 64, 256, 1024 (recordings/scaling:
# G 3.6 to 4, omega* 3.5 to 4, excess contacts .8 to 1.1; pressure, energy and bulk modulus at most .3)
_SIZE_TERM = {"excess_coordination": 1.0, "shear_modulus": 4.0, "modulus_ratio": 4.0, EDGE: 4.0}
_SMALL_SIZE_TERM = 0.3
# dimension and exponent of the law that they were found for
_SIZED = (2, 2.0)
# levels that a law of several N asks for: four parameters and two to spare
_LEVELS = 6
# edges of the bins of vibrational states [sqrt(energy_scale / mass) / diameter]
_FREQUENCIES = np.logspace(-3.6, 0.8, 67)
# the method starts here, where pressures are not asked for [energy_scale / diameter^d]
_JAMMED_AT = 1e-6


class Exponent(NamedTuple):
    """quantity = prefactor * x**exponent * (1 + correction * sqrt(x) + finite_size / (N * sqrt(x))).

    Attributes
    ----------
    exponent, error
        The exponent and its error, the three below added in squares; nan where one of them cannot be known.
    prefactor, correction, finite_size
        Of the law; terms that were not fitted are 0.
    sampling_error
        One standard deviation of the exponent over packings (jackknife); nan for a single packing.
    window_error
        How far the exponent moves when levels are left out at either end, half of them at the most; nan where too few
        levels take part to leave one out.
    size_error
        How far the finite-size term that discs with springs have moves the exponent of a fit without it: with packings
        of one N it cannot be separated from the correction. Where that term is not known, in 3D and for other laws, nan
        and no part of `error`; 0 where it was fitted (`fit_sizes`).
    levels, of_levels, on_plateau
        How many levels were fitted, of how many, and how many of the fitted ones lie on the plateau that N sets.
    smallest, largest
        The x of the levels that were fitted.

    """

    exponent: float
    error: float
    prefactor: float
    correction: float = 0.0
    finite_size: float = 0.0
    sampling_error: float = math.nan
    window_error: float = math.nan
    size_error: float = math.nan
    levels: int = 0
    of_levels: int = 0
    on_plateau: int = 0
    smallest: float = math.nan
    largest: float = math.nan

    def __repr__(self) -> str:
        parts = f"packings {self.sampling_error:.2g}, window {self.window_error:.2g}, N {self.size_error:.2g}"
        terms = [f" {name} {value:.3g}," for name, value in (("c", self.correction), ("b", self.finite_size)) if value]
        plateau = f", {self.on_plateau} of them on the plateau of N" if self.on_plateau else ""
        return (
            f"Exponent: {self.exponent:.4f} +- {self.error:.2g} ({parts}), prefactor {self.prefactor:.4g},"
            f"{''.join(terms)} from {self.levels} of {self.of_levels} levels, x = {self.smallest:.3g} to "
            f"{self.largest:.3g}{plateau}"
        )


@dataclass(frozen=True, eq=False)
class JammingScaling:
    """Packings followed over pressure or over the distance to jamming, and what was measured of each.

    Attributes
    ----------
    particles, dimension
        N and d.
    strain
        "isotropic" or "free".
    control
        "pressure" or "distance": what was set.
    level_p
        (P,) pressures [energy_scale / diameter^d], or packing fractions above each packing's own jamming [1], in the
        order in which they were visited.
    value_sp
        By name (see `COLUMNS`) an (S, P) array: one row a packing. Distance: packing fraction less the packing's own at
        jamming, that of the hard packing it was compressed from, or where its lowest pressure leads to. The excess
        coordination is 2 / N' times the contacts beyond one state of self stress, N' particles without rattlers. The
        shear modulus is the mean over all directions of shear, the modulus ratio that over the bulk modulus.
        Rearrangements are those on the way from the level before; nan: that packing did not come to rest.
    law_exponent
        Of the law where overlaps are small: energy ~ overlap^law_exponent, 2 for springs and 5/2 for Hertz.
    seconds
        CPU time.
    states_sp
        Densities of vibrational states of the packings without their stress, all particles of mass 1, in one row a
        packing; empty rows where they were not asked for.

    """

    particles: int
    dimension: int
    strain: BoxStrain
    control: str
    level_p: NDArray[np.float64]
    value_sp: Mapping[str, NDArray[np.float64]]
    law_exponent: float
    seconds: float
    states_sp: tuple[tuple[StateDensity, ...], ...] = ()

    @property
    def packings(self) -> int:
        """Number of packings that came to rest at every level, which is those that means are over."""
        return int(np.count_nonzero(~np.isnan(self.value_sp["residual"]).any(axis=1)))

    @property
    def names(self) -> tuple[str, ...]:
        """What can be asked for by name: the columns, and "plateau_edge" where states were counted."""
        return (*COLUMNS, EDGE) if any(self.states_sp) else tuple(COLUMNS)

    @property
    def counted_p(self) -> NDArray[np.bool_]:
        """Which levels are above the plateau that N sets: packing fractions 25 / N^2 above jamming, N^2 P = 10.

        Below, contacts in excess, shear moduli and the lowest frequencies are those of a handful of contacts too many:
        they stay at values of the order of 1 / N.
        """
        distance = self.mean_p("distance")
        if np.isfinite(distance).all():
            return np.asarray(distance >= self.counted_from * (1.0 - 1e-12))
        return np.asarray(self.mean_p("pressure") >= _PRESSED / self.particles**2 * (1.0 - 1e-12))

    @property
    def counted_from(self) -> float:
        """Packing fraction above jamming from which N does not show [1]."""
        return _COUNTED / self.particles**2

    def mean_p(self, name: str) -> NDArray[np.float64]:
        """Return the (P,) means over the packings; the plateau's edge is that of all their modes."""
        return self._means(name, self._rested(name))

    def error_p(self, name: str) -> NDArray[np.float64]:
        """Return the (P,) standard errors of these, by leaving packings out; nan for a single packing."""
        rows = self._rested(name)
        if len(rows) < 2:
            return np.full(len(self.level_p), math.nan)
        left = np.array([self._means(name, np.delete(rows, k)) for k in range(len(rows))])
        return _jackknife(left)

    def theory(self, name: str, *, over: str = "pressure") -> float:
        """Return the exponent that discs and spheres are expected to have; nan where there is none.

        Over the distance: pressure law_exponent - 1, energy law_exponent, bulk modulus law_exponent - 2, shear modulus
        law_exponent - 3/2, contacts in excess 1/2, omega* (law_exponent - 1) / 2.
        """
        power = self.law_exponent
        known = {
            "pressure": power - 1.0,
            "distance": 1.0,
            "energy_per_particle": power,
            "bulk_modulus": power - 2.0,
            "shear_modulus": power - 1.5,
            "modulus_ratio": 0.5,
            "excess_coordination": 0.5,
            EDGE: (power - 1.0) / 2.0,
        }
        return known.get(name, math.nan) / known[one_of("over", over, ("pressure", "distance"))]

    def fit(
        self,
        name: str,
        *,
        over: str | None = None,
        corrected: bool = False,
        smallest: float | None = None,
        largest: float | None = None,
    ) -> Exponent:
        """Return the power law of the means by least squares in logarithms, with what its exponent is known to.

        The error holds the scatter of packings, the choice of levels, and what N does: b / (N sqrt(x)), which falls
        slowly. `print` says how many levels were fitted. Packings of several N tell N from the correction
        (`fit_sizes`); of one N, `corrected` takes what N does for part of the correction, and its error says so.

        Parameters
        ----------
        name
            Of the quantity.
        over
            "pressure" or "distance"; None: what was set.
        corrected
            Fit prefactor * x^exponent (1 + correction sqrt(x)), the first correction to scaling.
        smallest, largest
            Values of `over` that take part; None: all above the plateau that N sets (`counted_p`).

        Raises
        ------
        ValueError
            If the name is unknown, fewer than two levels take part (four of a corrected fit), or a mean there is not
            positive.

        """
        chosen = self.control if over is None else one_of("over", over, ("pressure", "distance"))
        rows = self._rested(name)
        x = self._means(chosen, rows)
        part = self.counted_p if smallest is None else x >= positive("smallest", smallest) * (1.0 - 1e-12)
        if largest is not None:
            part = part & (x <= positive("largest", largest) * (1.0 + 1e-12))
        needed = 4 if corrected else 2
        if len(np.unique(x[part])) < needed:
            where = f"{chosen} from {x.min():g} to {x.max():g}" + (
                ""
                if smallest is not None
                else f", where N = {self.particles} sets a plateau below {self.counted_from:.2g} above jamming: give "
                "smallest"
            )
            raise ValueError(f"smallest must leave at least {needed} levels, got {len(np.unique(x[part]))} of {where}")

        x, y = self._fitted(name, chosen, rows, part)
        slope, prefactor, correction = _power_law(x, y, corrected)
        sampling = math.nan
        if len(rows) > 1:
            left = [self._fitted(name, chosen, np.delete(rows, k), part) for k in range(len(rows))]
            sampling = float(_jackknife(np.array([_power_law(*one, corrected)[0] for one in left])))
        order = np.argsort(x)
        windows = [order[part] for part in windows_without_ends(len(x), needed)]
        moved = [abs(_power_law(x[w], y[w], corrected)[0] - slope) for w in windows]
        window = max(moved, default=math.nan)
        # what is left when the usual term of N is taken out
        usual = _SIZE_TERM.get(name, _SMALL_SIZE_TERM) / (self.particles * np.sqrt(self._means("distance", rows)[part]))
        known = (self.dimension, self.law_exponent) == _SIZED
        size = abs(_power_law(x, y / (1.0 + usual), corrected)[0] - slope) if known else math.nan
        return Exponent(
            slope,
            math.hypot(sampling, window, size if known else 0.0),
            prefactor,
            correction,
            sampling_error=sampling,
            window_error=window,
            size_error=size,
            levels=len(x),
            of_levels=len(self.level_p),
            on_plateau=int(np.count_nonzero(part & ~self.counted_p)),
            smallest=float(x.min()),
            largest=float(x.max()),
        )

    def __repr__(self) -> str:
        """Return what was followed, in a line."""
        levels = f"{len(self.level_p)} levels of {self.control} from {self.level_p.min():g} to {self.level_p.max():g}"
        asked = len(self.value_sp["residual"])
        return f"JammingScaling: {self.packings} of {asked} packings of {self.particles} particles at {levels}"

    def to_csv(self) -> str:
        """Return means and errors of every quantity, a line a level."""
        names = [name for name in self.names if name != self.control]
        lines = [self.control + "," + ",".join(f"{name},{name}_error" for name in names)]
        columns = [(self.mean_p(name), self.error_p(name)) for name in names]
        for k, level in enumerate(self.level_p.tolist()):
            cells = ",".join(f"{mean[k]:.9g},{error[k]:.3g}" for mean, error in columns)
            lines.append(f"{level:.9g},{cells}")
        return "\n".join(lines) + "\n"

    def _rested(self, name: str) -> NDArray[np.int64]:
        """Return the packings that came to rest at every level."""
        one_of("name", name, self.names)
        rows: NDArray[np.int64] = np.nonzero(~np.isnan(self.value_sp["residual"]).any(axis=1))[0]
        if not len(rows):
            raise ValueError("packings must have come to rest at every level, got none that did")
        return rows

    def _fitted(
        self, name: str, over: str, rows: NDArray[np.int64], part: NDArray[np.bool_]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return what is fitted: means of x and y over some of the packings, at the levels that take part."""
        mean, at = self._means(name, rows)[part], self._means(over, rows)[part]
        if not ((mean > 0.0) & (at > 0.0)).all():
            raise ValueError(f"{name} must be positive on average to be fitted, got {mean.min():g}")
        return at, mean

    def _means(self, name: str, rows: NDArray[np.int64]) -> NDArray[np.float64]:
        if name != EDGE:
            return np.asarray(self.value_sp[name][rows].mean(axis=0))
        edges = [
            StateDensity.merged([self.states_sp[s][p] for s in rows]).plateau_edge for p in range(len(self.level_p))
        ]
        return np.array(edges)


def _jackknife(left_s: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return standard errors of figures from their values with one packing left out."""
    count = len(left_s)
    return np.asarray(np.sqrt((count - 1) * ((left_s - left_s.mean(axis=0)) ** 2).mean(axis=0)))


def _power_law(x: NDArray[np.float64], y: NDArray[np.float64], corrected: bool) -> tuple[float, float, float]:
    """Return exponent, prefactor and correction of y = prefactor x^exponent (1 + correction sqrt(x))."""
    log_x, log_y, root = np.log(x), np.log(y), np.sqrt(x)
    line = fit_line(log_x, log_y)
    if not corrected:
        return line.slope, math.exp(line.height), 0.0
    # log(1 + c sqrt(x)) exists above this
    least = -0.999 / root.max()

    def miss(guess: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(guess[0] + guess[1] * log_x + np.log1p(guess[2] * root) - log_y)

    bounds = ([-np.inf, -np.inf, least], np.inf)
    found = least_squares(
        miss, (line.height, line.slope, 0.0), bounds=bounds, x_scale=(1.0, 1.0, 1.0 / root.max()), xtol=1e-12
    )
    return float(found.x[1]), math.exp(found.x[0]), float(found.x[2])


def fit_sizes(scalings: Sequence[JammingScaling], name: str, *, largest: float | None = None) -> Exponent:
    """Return one power law over the distance x of packings of several N, with its corrections in x and in N.

    prefactor * x^exponent (1 + correction sqrt(x) + finite_size / (N sqrt(x))) is fitted by least squares of relative
    deviations to all levels above the plateau of each N (`JammingScaling.counted_p`). The error holds the scatter of
    packings, and how far the exponent moves when the lowest or the highest level of each N is left out. What N sets
    falls behind the power law only as slowly as (N^2 x)^-1/2, so that from one N alone it cannot be known apart from
    the other correction.

    Parameters
    ----------
    scalings
        Of two or more N, in one dimension, with the same laws, strains and control.
    name
        Of the quantity.
    largest
        Largest distance that takes part [1]; None: all.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, or fewer than six levels take part.

    Examples
    --------
    >>> import packmech as pm
    >>> found = []
    >>> for count in (48, 96):
    ...     start = pm.random_packing(count, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.87, seed=1)
    ...     scenes = [pm.Scene(start, (pm.Repulsion(),))]
    ...     found.append(pm.jamming_scaling(scenes, [1e-1, 5e-2, 2.5e-2, 1.2e-2, 6e-3]))
    >>> abs(pm.fit_sizes(found, "energy_per_particle").exponent - 2.0) < 0.2
    True

    """
    if isinstance(scalings, JammingScaling) or not isinstance(scalings, Sequence):
        raise TypeError(f"scalings must be a sequence of scalings, got {scalings!r}")
    for k, one in enumerate(scalings):
        instance(f"scalings[{k}]", one, JammingScaling)
        first, kind = ((x.dimension, x.law_exponent, x.strain, x.control) for x in (scalings[0], one))
        if kind != first:
            raise ValueError(f"scalings[{k}] must be like the first in dimension, law, strain and control, got {kind}")
    if len({one.particles for one in scalings}) < 2:
        raise ValueError(f"scalings must be of two or more N, got {sorted({one.particles for one in scalings})}")
    top = math.inf if largest is None else positive("largest", largest) * (1.0 + 1e-12)
    rows = [one._rested(name) for one in scalings]
    parts = [one.counted_p & (one.mean_p("distance") <= top) for one in scalings]
    counts = [int(np.count_nonzero(part)) for part in parts]
    sizes = sorted({one.particles for one, count in zip(scalings, counts, strict=True) if count})
    if sum(counts) < _LEVELS or len(sizes) < 2:
        words = f"{sum(counts)} of N = {sizes}"
        raise ValueError(f"largest must leave at least {_LEVELS} levels of two N above their plateaus, got {words}")

    def law(rows: Sequence[NDArray[np.int64]], parts: Sequence[NDArray[np.bool_]]) -> NDArray[np.float64]:
        taking = [(one, r, p) for one, r, p in zip(scalings, rows, parts, strict=True) if p.any()]
        pairs = [one._fitted(name, "distance", r, p) for one, r, p in taking]
        x, y = (np.concatenate([pair[k] for pair in pairs]) for k in (0, 1))
        inverse = np.repeat([1.0 / one.particles for one, _, _ in taking], [len(pair[0]) for pair in pairs])
        return _sized_power_law(x, y, inverse)

    best = law(rows, parts)
    variance = 0.0
    for k, own in enumerate(rows):
        if len(own) > 1:
            left = [law([*rows[:k], np.delete(own, j), *rows[k + 1 :]], parts)[1] for j in range(len(own))]
            variance += float(_jackknife(np.array(left))) ** 2
        else:
            variance = math.nan
    moved = []
    for end in (0, -1):
        fewer = [_without_an_end(one.mean_p("distance"), part, end) for one, part in zip(scalings, parts, strict=True)]
        kept = [np.count_nonzero(part) for part in fewer]
        if sum(kept) >= _LEVELS and np.count_nonzero(kept) > 1:
            moved.append(abs(law(rows, fewer)[1] - best[1]))
    window = max(moved, default=math.nan)
    reached = np.concatenate([one.mean_p("distance")[part] for one, part in zip(scalings, parts, strict=True)])
    return Exponent(
        float(best[1]),
        math.hypot(math.sqrt(variance), window),
        math.exp(best[0]),
        float(best[2]),
        float(best[3]),
        sampling_error=math.sqrt(variance),
        window_error=window,
        size_error=0.0,
        levels=sum(counts),
        of_levels=sum(len(one.level_p) for one in scalings),
        smallest=float(reached.min()),
        largest=float(reached.max()),
    )


def _without_an_end(distance: NDArray[np.float64], part: NDArray[np.bool_], end: int) -> NDArray[np.bool_]:
    """Return which levels take part without the nearest (end = 0) or the farthest (-1) of them."""
    left = part.copy()
    inside = np.nonzero(part)[0]
    if len(inside):
        left[inside[np.argsort(distance[inside])[end]]] = False
    return left


def _sized_power_law(
    x: NDArray[np.float64], y: NDArray[np.float64], inverse: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return log(prefactor), exponent, correction and finite size of the law of several N."""
    log_x, root = np.log(x), np.sqrt(x)
    line = fit_line(log_x, np.log(y))
    size = inverse / root

    def miss(guess: NDArray[np.float64]) -> NDArray[np.float64]:
        law = np.exp(guess[0] + guess[1] * log_x) * (1.0 + guess[2] * root + guess[3] * size)
        return np.asarray(law / y - 1.0)

    scale = (1.0, 1.0, 1.0 / root.max(), 1.0 / size.max())
    found = least_squares(miss, (line.height, line.slope, 0.0, 0.0), x_scale=scale, xtol=1e-12)
    if not found.success:
        raise ValueError(f"scalings must determine one law, got a fit that does not converge: {found.message}")
    return np.asarray(found.x)


def jamming_scaling(
    scenes: Iterable[Scene],
    pressures: Iterable[float] | None = None,
    *,
    distances: Iterable[float] | None = None,
    strain: BoxStrain = "free",
    method: JamMethod | None = None,
    states: bool = False,
    time_limit: float | None = None,
    folder: str | os.PathLike[str] | None = None,
    workers: int | None = 0,
    progress: Progress | None = None,
    check: bool = True,
) -> JammingScaling:
    """Return how packings change as they are followed from pressure to pressure, or from their jamming points upward.

    Over pressures, each scene is jammed at the first and then followed along its contact network (`sweep_pressure`);
    over distances it is jammed, and then compressed from its own exact hard packing (`compress`).

    Parameters
    ----------
    scenes
        Starts of one number of particles and of axes, such as random packings of many seeds.
    pressures
        In the order in which they are visited, from high to low as a rule [energy_scale / diameter^d]; None, without
        distances: `PRESSURES`.
    distances
        Packing fractions above each packing's own jamming, in place of pressures [1]; visited in increasing order.
    strain
        "free": strains relax. "isotropic": the box keeps its shape; many such packings are unstable to shear, and their
        shear moduli scatter around a small mean.
    method
        Of `jam`, which decides about the ensemble, such as HardVertex(start_packing_fraction=0.9, stop_pressure=1e-5).
    states
        Count vibrational states, too: of the packings without their stress, all particles of mass 1, so that
        `fit("plateau_edge")` gives omega*. About a hundred factorizations for each packing and level.
    time_limit
        For each packing [s]: CPU time, or wall time where other processes follow it.
    folder
        An ensemble with a member for each packing (`pm.read_ensemble`), and the scenes. Interrupted work goes on where
        it was when called again, and more scenes may be asked for. None keeps nothing.
    workers
        How many processes share the packings, as in `run_ensemble`; 0: none, they are followed here. Scenes with laws
        of your own need 0.
    progress
        Called as progress(stage, figures); figures holds "done", the number of packings that are finished.
    check
        Raise NotConverged when a packing does not come to rest; otherwise it is nan and left out of means.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, or scenes differ in particles or axes.
    NotConverged
        If a packing does not come to rest and `check` is set.
    TimeoutError, RuntimeError
        If a packing takes longer than the limit (the latter from other processes); the call goes on with it again.
    KeyboardInterrupt
        Passed on with `.scaling` set to what the finished packings give, None before the first.

    Examples
    --------
    >>> import packmech as pm
    >>> starts = [
    ...     pm.random_packing(64, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.87, seed=seed)
    ...     for seed in (1, 2)
    ... ]
    >>> found = pm.jamming_scaling([pm.Scene(start, (pm.Repulsion(),)) for start in starts], [1e-2, 4e-3])
    >>> found.packings, 0.2 < found.fit("excess_coordination").exponent < 0.9
    (2, True)

    """
    if isinstance(scenes, str | Scene) or not isinstance(scenes, Iterable):
        raise TypeError(f"scenes must be a sequence of scenes, got {scenes!r}")
    given = tuple(scenes)
    if not given:
        raise ValueError("scenes must hold at least one scene, got none")
    for k, scene in enumerate(given):
        instance(f"scenes[{k}]", scene, Scene)
        HONORED.check(f"scenes[{k}]", scene)
        if scene.packing.position_nd.shape != given[0].packing.position_nd.shape:
            raise ValueError(
                f"scenes[{k}] must have {given[0].packing.particles} particles in {given[0].packing.dimension} "
                f"dimensions like the first, got {scene.packing.particles} in {scene.packing.dimension}"
            )
    if pressures is not None and distances is not None:
        raise ValueError("distances must be left out when pressures are given")
    control = "pressure" if distances is None else "distance"
    if distances is None:
        goals = sequence("pressures", PRESSURES if pressures is None else pressures, "pressure")
    else:
        goals = np.sort(sequence("distances", distances, "distance"))
    one_of("strain", strain, ("isotropic", "free"))
    instance("states", states, bool)
    instance("check", check, bool)
    laws = [_law_exponent(scene) for scene in given]
    if len(set(laws)) > 1:
        other = next(k for k, law in enumerate(laws) if law != laws[0])
        raise ValueError(
            f"scenes[{other}] must have energies ~ overlap^{laws[0]:g} like the first, got overlap^{laws[other]:g}"
        )
    if progress is not None:
        function("progress", progress)
    if method is not None:
        check_method(method)
    limit = math.inf if time_limit is None else positive("time_limit", time_limit)
    jam_drive = JamDrive(pressure=float(goals[0]) if distances is None else _JAMMED_AT, strain=strain, method=method)
    finished: dict[int, Finished] = {}

    def gathered() -> JammingScaling:
        members = [finished[k] for k in sorted(finished)]
        arrays = [one.arrays() for one in members]
        table = np.stack([one["value_pc"] for one in arrays])
        first = given[0].packing
        return JammingScaling(
            first.particles,
            first.dimension,
            strain,
            control,
            goals,
            MappingProxyType({name: table[:, :, k] for k, name in enumerate(COLUMNS)}),
            _law_exponent(given[0]),
            sum(one.values["cost"] for one in members),
            tuple(_densities(one) for one in arrays) if states else (),
        )

    def report(done: int, of: int, number: int, member: Finished) -> None:
        finished[number] = member
        if check and "outcome" in member.values:
            raise NotConverged(_stalled(member))
        if progress is not None:
            progress("scaling", {"done": done})

    with folder_of(folder) as place:
        try:
            wanted = [
                {
                    "scene": keep_scene(place, scene.replace(drive=jam_drive)),
                    "control": control,
                    "goals": goals.tolist(),
                    "states": states,
                }
                for scene in given
            ]
            # the limit is no part of what a packing is asked for
            job = followed if workers != 0 else update_wrapper(partial(followed, time_limit=limit), followed)
            complete(job, wanted, place, workers=workers, time_limit=time_limit, progress=report)
        except KeyboardInterrupt as stop:
            stop.scaling = gathered() if finished else None  # type: ignore[attr-defined]
            raise
        return gathered()


def followed(
    folder: Path, scene: str, control: str, goals: list[float], states: bool, time_limit: float = math.inf
) -> dict[str, Any]:
    """Return what a member is: one packing, jammed and followed over the goals, and what is measured of it at each.

    A packing that does not come to rest at every goal has nan everywhere, and says how it ended.
    """
    began = time.process_time()

    def left() -> dict[str, Any]:
        rest = None if math.isinf(time_limit) else max(began + time_limit - time.process_time(), 1e-9)
        return {"strain": drive.strain, "time_limit": rest}

    start = scene_at(scene_path(folder, scene))
    drive = start.drive
    assert isinstance(drive, JamDrive)
    runs: tuple[Run, ...] = (jam(start, pressure=drive.pressure, method=drive.method, check=False, **left()),)
    if runs[0].outcome.ok:
        here = start.replace(packing=runs[0].packing)
        if control == "distance":
            runs = compress(here, goals, check=False, **left())
        elif len(goals) > 1:
            runs = (*runs, *sweep_pressure(here, goals[1:], check=False, **left()))
    ended = next((run for run in runs if not run.outcome.ok), runs[-1])
    if ended.outcome is Outcome.TIME_LIMIT:
        raise TimeoutError(f"time_limit must suffice for a packing, got {time_limit:g} s")
    if len(runs) < len(goals) or not ended.outcome.ok:
        stalled = {"outcome": ended.outcome.name, "residual": ended.residual, "steps": ended.steps}
        empty = np.zeros(0, dtype=np.int64)
        return stalled | {
            "value_pc": np.full((len(goals), len(COLUMNS)), math.nan),
            "count_pb": empty,
            "modes_p": empty,
            "cost": time.process_time() - began,
            "packing": ended.packing,
        }
    table = np.array([_measured(start, run) for run in runs])
    table[:, _DISTANCE] = table[:, _FRACTION] - _onset(runs, table, _law_exponent(start))
    found = tuple(_states(start, run) for run in runs) if states else ()
    return {
        "value_pc": table,
        "count_pb": np.array([one.count_b for one in found], dtype=np.int64),
        "modes_p": np.array([one.modes for one in found], dtype=np.int64),
        "cost": time.process_time() - began,
    }


def _stalled(member: Finished) -> Run:
    """Return the run of a packing that did not come to rest, as far as it is kept."""
    kept = member.values
    return Run(member.packing(), Outcome[kept["outcome"]], kept["residual"], kept["steps"], 0, kept["cost"])


def _densities(arrays: Mapping[str, NDArray[Any]]) -> tuple[StateDensity, ...]:
    """Return the states that a member counted at each goal."""
    counts = zip(arrays["count_pb"], arrays["modes_p"].tolist(), strict=True)
    return tuple(StateDensity(_FREQUENCIES, count, modes, math.nan) for count, modes in counts)


def _law_exponent(scene: Scene) -> float:
    """Return w of the energies of barely touching pairs, ~ overlap^w."""
    sigma = scene.packing.reference_diameter
    laws = [one for one in scene.effects if hasattr(type(one), "pair_energy")]
    small, twice = (sum(float(pair_energy(one, sigma * (1.0 - xi), sigma)) for one in laws) for xi in (1e-6, 2e-6))
    return round(math.log2(twice / small), 3)


def _states(scene: Scene, run: Run) -> StateDensity:
    """Return the vibrational states of a packing without its stress, all particles of mass 1."""
    alike = run.packing.replace(mass_n=np.ones(run.packing.particles))
    unit = math.sqrt(scene.energy_scale) / scene.packing.reference_diameter
    found = density_of_states(scene.replace(packing=alike), _FREQUENCIES * unit, kind="unstressed")
    return replace(found, edge_b=_FREQUENCIES)


def _onset(runs: Sequence[Run], table: NDArray[np.float64], law_exponent: float) -> float:
    """Return the packing fraction at which the packing that was followed is jammed.

    That of the hard packing if it was followed from there, else the one at which its lowest pressure vanishes on the
    way P ~ distance^(law_exponent - 1), whose slope is the bulk modulus.
    """
    if "onset" in runs[0].report:
        return float(runs[0].report["onset"])
    last = int(np.argmin(table[:, _PRESSURE]))
    pressure, fraction, bulk = table[last, [_PRESSURE, _FRACTION, list(COLUMNS).index("bulk_modulus")]]
    return float(fraction * (1.0 - (law_exponent - 1.0) * pressure / bulk))


def _measured(scene: Scene, run: Run) -> list[float]:
    """Return the figures of one packing, in the order of `COLUMNS`; the distance is not known yet."""
    here = scene.replace(packing=run.packing)
    moduli = elastic_moduli(here)
    # the mean over directions of shear, of unstable packings, too
    shear = voigt_average(moduli.cauchy, moduli.stiff_directions).shear_modulus
    backbone = run.report["particles"] - run.report["rattlers"]
    return [
        run.report["pressure"],
        math.nan,
        packing_fraction(run.packing),
        energy(here) / (scene.energy_scale * scene.packing.particles),
        2.0 * run.report["excess_contacts"] / backbone,
        moduli.bulk_modulus / scene.pressure_unit,
        shear / scene.pressure_unit,
        shear / moduli.bulk_modulus,
        run.report.get("rearrangements", 0),
        run.residual,
    ]
