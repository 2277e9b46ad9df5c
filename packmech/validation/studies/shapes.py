"""Jammed ellipses and spheroids over their aspect: packing fraction, contacts, quartic modes, and the shear modulus.

The shear modulus is linear in the distance above jamming at first and bends toward a square root. Where its exponent
passes 3/4 does not grow with the aspect throughout: 6.0e-4, 5.9e-3, 1.2e-2 and 2.2e-2 at aspects 1.002, 1.01, 1.03 and
1.1, then 1.4e-2 and 5.9e-3 at 1.3 and 2 (N = 256, ten packings; to 8 to 19 percent).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

import packmech as pm
from packmech.linalg.line import fit_line
from packmech.validation.studies.rows import Progress, columns_of, complete_rows, kept_of
from packmech.view.figures import COLORS, MARKERS, styled_figure

ASPECTS = (1.02, 1.06, 1.1, 1.2, 1.3, 1.4, 1.5, 1.6, 1.8, 2.0, 3.0)
PRESSURE = 1e-7
# dilute starts [1]
_START = {2: 0.6, 3: 0.4}
MODULUS_ASPECTS = (1.002, 1.01, 1.03, 1.1, 1.3, 2.0)
# how often packings are drawn again for an error, and what no mean modulus is known better than, relative
_REPEATS, _FLOOR = 100, 0.02
DISTANCES = tuple(float(x) for x in np.logspace(-5.0, -1.0, 13))


@dataclass(frozen=True)
class Jammed:
    """One jammed packing: what it was asked for, and what came of it."""

    dimension: int
    particles: int
    aspect: float
    pressure: float
    seed: int
    packing_fraction: float
    jamming_packing_fraction: float
    coordination_number: float
    rattlers: int
    contacts: int
    isostatic_contacts: int
    states_of_self_stress: int
    quartic_modes: int
    certain: int
    smallest_curvature: float
    largest_curvature: float
    unstable_modes: int
    residual: float
    steps: int
    seconds: float

    @property
    def settings(self) -> tuple[float, ...]:
        """What it was asked for."""
        return tuple(getattr(self, one.name) for one in fields(self)[:5])


@dataclass(frozen=True)
class Sheared:
    """The moduli of one shear-stabilized packing at a distance above its own jamming."""

    dimension: int
    particles: int
    aspect: float
    seed: int
    distance: float
    pressure: float
    shear_modulus: float
    bulk_modulus: float
    contacts: int
    isostatic_contacts: int
    residual: float

    @property
    def settings(self) -> tuple[float, ...]:
        """What it was asked for."""
        return tuple(getattr(self, one.name) for one in fields(self)[:5])


class HasAspect(Protocol):
    """A packing of some aspect."""

    @property
    def aspect(self) -> float:
        """The axis along the director over that across it."""
        ...


def start_of(dimension: int, particles: int, aspect: float, seed: int) -> pm.Scene:
    """Return a dilute start: ellipses 1:1.4 in halves, or spheroids alike, of one aspect, under the harmonic law."""
    packing = pm.random_packing(
        particles,
        dimension=dimension,
        sizes=pm.Bidisperse(ratio=1.4),
        packing_fraction=_START[dimension],
        seed=seed,
        shapes=pm.Ellipses(aspect),
    )
    return pm.Scene(packing, (pm.Repulsion(),))


def jammed_table(folder: Path, dimension: int) -> Path:
    """Return the table of jammed packings."""
    return folder / f"jammed-{dimension}d.csv"


def jam_ellipses(dimension: int, particles: int, aspect: float, pressure: float, seed: int) -> dict[str, Any]:
    """Return the row of a packing in a box of fixed shape, and the packing."""
    scene = start_of(dimension, particles, aspect, seed)
    run = pm.jam(scene, pressure=pressure, strain="isotropic", check=False)
    jammed, report = scene.replace(packing=run.packing), run.report
    quartic = pm.quartic_modes(jammed)
    curvature = quartic.curvature_m / quartic.pressure if len(quartic) else np.array([math.nan])
    row = Jammed(
        *(dimension, particles, aspect, pressure, seed),
        report["packing_fraction"],
        report.get("jamming_packing_fraction", math.nan),
        2.0 * report["contacts"] / (particles - report["rattlers"]),
        report["rattlers"],
        report["contacts"],
        report["isostatic_contacts"],
        report["states_of_self_stress"],
        len(quartic),
        int(report.get("rank_certain", False) and quartic.certain and run.ok),
        float(curvature[0]),
        float(curvature[-1]),
        int((pm.normal_modes(jammed).eigenvalue_m < 0.0).sum()),
        run.residual,
        run.steps,
        run.seconds,
    )
    return asdict(row) | {"packing": run.packing}


def jam_all(
    folder: Path,
    *,
    dimension: int,
    particles: int,
    aspects: Sequence[float],
    pressure: float,
    seeds: Sequence[int],
    progress: Progress[Jammed],
    workers: int | None = None,
) -> list[Jammed]:
    """Return packings of all aspects and seeds in boxes of fixed shape, each a member with its packing."""
    wanted = list(itertools.product((dimension,), (particles,), aspects, (pressure,), seeds))
    return complete_rows(jammed_table(folder, dimension), Jammed, wanted, jam_ellipses, progress, workers)


def shear_upward(
    dimension: int, particles: int, aspect: float, seed: int, distances: Sequence[float]
) -> dict[str, NDArray[Any]]:
    """Return the rows of a shear-stabilized packing that is followed from its jamming upward; nan where it ended."""
    scene = start_of(dimension, particles, aspect, seed)
    scene = scene.replace(packing=pm.jam(scene, pressure=1e-6, strain="free").packing)
    nothing = (math.nan, math.nan, math.nan, 0, 0, math.nan)
    rows = {each: Sheared(dimension, particles, aspect, seed, each, *nothing) for each in distances}
    for distance, run in zip(distances, pm.compress(scene, distances, strain="free", check=False), strict=False):
        moduli = pm.elastic_moduli(scene.replace(packing=run.packing))
        rows[distance] = Sheared(
            *(dimension, particles, aspect, seed, distance),
            run.report["pressure"],
            # over the directions, with equal weights
            moduli.voigt.shear_modulus,
            moduli.bulk_modulus,
            run.report["contacts"],
            run.report["isostatic_contacts"],
            run.residual,
        )
    return columns_of(list(rows.values()))


def shear_all(
    folder: Path,
    *,
    dimension: int,
    particles: int,
    aspects: Sequence[float],
    seeds: Sequence[int],
    progress: Progress[Sheared],
    workers: int | None = None,
) -> list[Sheared]:
    """Return moduli of shear-stabilized packings of all aspects and seeds, followed from their jamming upward."""
    wanted = list(itertools.product((dimension,), (particles,), aspects, seeds, (DISTANCES,)))
    return complete_rows(folder / f"moduli-{dimension}d.csv", Sheared, wanted, shear_upward, progress, workers)


def mean_and_error(values: Sequence[float]) -> tuple[float, float]:
    """Return the mean of finite values and its standard error; nan where there are too few."""
    finite = np.array([one for one in values if math.isfinite(one)])
    if not len(finite):
        return math.nan, math.nan
    return float(finite.mean()), float(finite.std(ddof=1) / math.sqrt(len(finite))) if len(finite) > 1 else math.nan


def over_aspect(
    found: Sequence[HasAspect], name: str
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the aspects, and mean and standard error of a figure at each."""
    aspects = sorted({one.aspect for one in found})
    rows = [mean_and_error([float(getattr(one, name)) for one in found if one.aspect == each]) for each in aspects]
    mean, error = np.array(rows).T
    return np.array(aspects), mean, error


def densest_aspect(found: Sequence[Jammed]) -> tuple[float, float]:
    """Return aspect and packing fraction at the peak of a parabola through the densest mean and its neighbors."""
    aspect, mean, _ = over_aspect(found, "jamming_packing_fraction")
    if len(aspect) < 3:
        return math.nan, math.nan
    top = min(max(int(np.argmax(mean)), 1), len(aspect) - 2)
    a, b, c = np.polyfit(aspect[top - 1 : top + 2], mean[top - 1 : top + 2], 2)
    peak = -b / (2.0 * a)
    return float(peak), float(c + b * peak + a * peak**2)


def exponent(found: Sequence[Sheared], aspect: float, low: float, high: float) -> tuple[float, float]:
    """Return the exponent of the mean shear modulus over the distance between two distances, and its standard error."""
    x, y, weight = [], [], []
    for distance in DISTANCES:
        if low <= distance <= high * 1.0001:
            mean, error = mean_and_error(
                [one.shear_modulus for one in found if one.aspect == aspect and one.distance == distance]
            )
            if mean > 0.0:
                x.append(math.log(distance))
                y.append(math.log(mean))
                weight.append(mean / error if error > 0.0 else 1.0)
    if len(x) < 3:
        return math.nan, math.nan
    line = fit_line(np.array(x), np.array(y), 1.0 / np.array(weight))
    return line.slope, line.slope_error


def crossover(found: Sequence[Sheared], aspect: float) -> tuple[float, float]:
    """Return the distance above jamming where the exponent of the shear modulus passes 3/4, and its relative error.

    That of the curve G = a x / sqrt(1 + x / x*), linear below x* and a square root far above it, which is fitted to the
    mean moduli; the error is the spread of ln x* over packings drawn with repetition. nan with fewer than two packings.
    """
    part = [one for one in found if one.aspect == aspect and math.isfinite(one.shear_modulus)]
    rows: dict[int, dict[float, float]] = {}
    for one in part:
        rows.setdefault(one.seed, {})[one.distance] = one.shear_modulus
    distance = np.array(sorted({one.distance for one in part}))
    modulus = np.array([[row[x] for x in distance] for row in rows.values() if len(row) == len(distance)])
    if len(modulus) < 2 or len(distance) < 4:
        return math.nan, math.nan
    rng = np.random.default_rng(0)
    drawn = [_crossover(distance, modulus[rng.integers(0, len(modulus), len(modulus))]) for _ in range(_REPEATS)]
    return math.exp(_crossover(distance, modulus)), float(np.std(drawn, ddof=1))


def _crossover(distance: NDArray[np.float64], modulus_st: NDArray[np.float64]) -> float:
    """Return ln x* of the curve through the means of moduli at these distances, weighted by their errors."""
    mean = modulus_st.mean(axis=0)
    error = np.hypot(modulus_st.std(axis=0, ddof=1) / math.sqrt(len(modulus_st)) / mean, _FLOOR)
    x, y = np.log(distance), np.log(mean)

    def wrong(parameters: NDArray[np.float64]) -> NDArray[np.float64]:
        level, place = parameters
        return np.asarray((level + x - 0.5 * np.logaddexp(0.0, x - place) - y) / error)

    return float(least_squares(wrong, [y[0] - x[0], float(x.mean())]).x[1])


def draw_jammed(found: Sequence[Jammed], folder: Path, path: Path) -> None:
    """Write the figure: packing fraction, contacts, and sorted spectra of the first packing of some aspects."""
    d, particles = found[0].dimension, found[0].particles
    with styled_figure(path, (12.6, 4.0)) as figure:
        left, middle, right = figure.subplots(1, 3)
        aspect, mean, error = over_aspect(found, "jamming_packing_fraction")
        left.errorbar(aspect, mean, error, color=COLORS[0], marker=MARKERS[0], markersize=4.0, capsize=2.0)
        left.set(xlabel="aspect", ylabel="packing fraction at jamming")
        aspect, mean, error = over_aspect(found, "coordination_number")
        middle.errorbar(aspect, mean, error, color=COLORS[1], marker=MARKERS[1], markersize=4.0, capsize=2.0)
        for level in (2 * d, 2 * (2 * d - 1 if d == 2 else 5)):
            middle.axhline(level, color="#b0b0b0", linewidth=0.8)
        middle.set(xlabel="aspect", ylabel="coordination number")
        shown = sorted({one.aspect for one in found})
        for number, each in enumerate(shown[:: max(1, len(shown) // 4)]):
            first = min((one for one in found if one.aspect == each), key=lambda one: one.seed)
            packing = kept_of(jammed_table(folder, d), first).packing()
            modes = pm.normal_modes(pm.Scene(packing, (pm.Repulsion(),)))
            frequency = np.sqrt(np.maximum(modes.eigenvalue_m, 0.0))
            right.plot(
                (np.arange(len(frequency)) + 1) / len(frequency), frequency, ".", markersize=2.5,
                color=COLORS[number % len(COLORS)], label=f"aspect {each:g}",
            )  # fmt: skip
        right.set(yscale="log", xlabel="mode, sorted, over their number", ylabel="frequency")
        right.legend(fontsize=7.0)
        seeds = len({one.seed for one in found})
        figure.suptitle(
            f"{seeds} packings each of N = {particles}, d = {d}, pressure {found[0].pressure:g}", fontsize=10
        )


def draw_moduli(found: Sequence[Sheared], path: Path) -> None:
    """Write the figure: shear modulus over distance above jamming; where its exponent passes 3/4, over the aspect."""
    aspects = sorted({one.aspect for one in found})
    with styled_figure(path, (10.8, 4.4)) as figure:
        ax, right = figure.subplots(1, 2, width_ratios=(3, 2))
        places = []
        for number, aspect in enumerate(aspects):
            rows = [
                mean_and_error([one.shear_modulus for one in found if one.aspect == aspect and one.distance == each])
                for each in DISTANCES
            ]
            mean, error = np.array(rows).T
            style = {"color": COLORS[number % len(COLORS)], "marker": MARKERS[number % len(MARKERS)]}
            ax.errorbar(
                DISTANCES, mean, error, label=f"aspect {aspect:g}", markersize=3.5, linewidth=1.0, capsize=2.0, **style
            )
            place, spread = crossover(found, aspect)
            places.append((place, place * (1.0 - math.exp(-spread)), place * (math.exp(spread) - 1.0)))
            height = math.exp(float(np.interp(math.log(place), np.log(DISTANCES), np.log(mean))))
            ax.plot(place, height, marker="|", markersize=16.0, color=style["color"])
            right.errorbar(aspect - 1.0, place, np.array(places[-1][1:])[:, None], capsize=2.0, **style)
        low = np.array(DISTANCES)
        ax.plot(low, 0.3 * np.sqrt(low), color="#808080", linestyle=":", linewidth=1.0, label="slope 1/2")
        ax.plot(low, 2.0 * low, color="#808080", linestyle="--", linewidth=1.0, label="slope 1")
        ax.set(xscale="log", yscale="log", xlabel="packing fraction above jamming", ylabel="shear modulus")
        ax.legend(fontsize=7.0)
        right.plot(np.array(aspects) - 1.0, [one[0] for one in places], color="#b0b0b0", linewidth=0.8, zorder=0)
        right.set(
            xscale="log", yscale="log", xlabel="aspect - 1", ylabel="packing fraction where the exponent passes 3/4"
        )
        seeds, particles = len({one.seed for one in found}), found[0].particles
        figure.suptitle(f"{seeds} shear-stabilized packings each of N = {particles}", fontsize=10)
