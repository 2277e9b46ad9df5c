"""What friction does to packings: packing fraction and coordination over the friction coefficient."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import packmech as pm
from packmech.result import Outcome
from packmech.validation.studies.rows import Progress, complete_rows
from packmech.view.figures import COLORS, MARKERS, styled_figure

COEFFICIENTS = (0.0, 0.01, 0.1, 0.5, 1.0, 10.0)
# dilute starts [1], and the dashpots of contacts [sqrt(m k)]
_START, _NORMAL, _TANGENTIAL = {2: 0.7, 3: 0.5}, 0.3, 0.1
# where a coefficient of zero stands on an axis of logarithms
_ZERO = 1e-3


@dataclass(frozen=True)
class Pressed:
    """One packing: what it was asked for, and what came of it. Rates are in sqrt(k / m), pressures in k d^(2 - dim)."""

    dimension: int
    particles: int
    coefficient: float
    stiffness_ratio: float
    pressure: float
    rate: float
    seed: int
    packing_fraction: float
    coordination_number: float
    isostatic_coordination: float
    rattlers: int
    contacts_at_limit: int
    residual: float
    steps: int
    seconds: float

    @property
    def settings(self) -> tuple[float, ...]:
        """What it was asked for."""
        return tuple(getattr(self, one.name) for one in fields(self)[:7])


def press(
    dimension: int, particles: int, coefficient: float, ratio: float, pressure: float, rate: float, seed: int
) -> Pressed:
    """Return a packing pressed from a dilute start: discs 1:1.4 in halves, or equal spheres, springs of stiffness 1."""
    sizes = pm.Bidisperse(ratio=1.4) if dimension == 2 else pm.Monodisperse()
    start = pm.random_packing(
        particles, dimension=dimension, sizes=sizes, packing_fraction=_START[dimension], seed=seed
    )
    effects = (
        pm.Repulsion(pm.LinearSpring(1.0)),
        pm.ContactDamping(_NORMAL),
        pm.Friction(coefficient, ratio, _TANGENTIAL),
    )
    run = pm.jam(pm.Scene(start, effects), pressure=pressure, strain="isotropic", method=pm.Press(rate=rate))
    assert run.outcome is Outcome.CONVERGED
    report = run.report
    return Pressed(
        *(dimension, particles, coefficient, ratio, pressure, rate, seed),
        report["packing_fraction"],
        report["coordination_number"],
        report["isostatic_coordination"],
        report["rattlers"],
        report["contacts_at_limit"],
        run.residual,
        run.steps,
        run.seconds,
    )


def press_all(
    path: Path,
    *,
    dimension: int,
    particles: int,
    coefficients: Sequence[float],
    ratios: Sequence[float],
    pressures: Sequence[float],
    rates: Sequence[float],
    seeds: Sequence[int],
    progress: Progress[Pressed],
    workers: int | None = None,
) -> list[Pressed]:
    """Return packings of all combinations, each a member of the ensemble beside the table."""
    wanted = list(itertools.product((dimension,), (particles,), coefficients, ratios, pressures, rates, seeds))
    return complete_rows(path, Pressed, wanted, press, progress, workers)


def over_friction(
    found: Sequence[Pressed], name: str
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return the coefficients, and mean and standard error of a figure at each."""
    mu = sorted({one.coefficient for one in found})
    values = [[float(getattr(one, name)) for one in found if one.coefficient == each] for each in mu]
    mean = np.array([np.mean(each) for each in values])
    error = np.array([np.std(each, ddof=1) / math.sqrt(len(each)) if len(each) > 1 else math.nan for each in values])
    return np.array(mu), mean, error


def draw_friction(found: Sequence[Pressed], path: Path) -> None:
    """Write the figure: packing fraction and coordination over friction, with generalized isostaticity."""
    kinds = sorted({(one.stiffness_ratio, one.pressure, one.rate) for one in found})
    with styled_figure(path, (9.6, 4.2)) as figure:
        left, right = figure.subplots(1, 2)
        for number, kind in enumerate(kinds):
            part = [one for one in found if (one.stiffness_ratio, one.pressure, one.rate) == kind]
            style = {"color": COLORS[number % len(COLORS)], "marker": MARKERS[number % len(MARKERS)], "capsize": 2.0}
            label = f"$k_t/k_n$ = {kind[0]:.3g}, p = {kind[1]:g}, rate {kind[2]:g}"
            for ax, name in ((left, "packing_fraction"), (right, "coordination_number")):
                mu, mean, error = over_friction(part, name)
                ax.errorbar(np.maximum(mu, _ZERO), mean, error, label=label, markersize=4.0, linewidth=1.0, **style)
            mu, bound, _ = over_friction(part, "isostatic_coordination")
            right.plot(np.maximum(mu, _ZERO), bound, color=style["color"], linestyle=":", linewidth=1.2)
        d = found[0].dimension
        left.set(xscale="log", xlabel=f"friction coefficient ({_ZERO:g}: none)", ylabel="packing fraction")
        right.set(xscale="log", xlabel=f"friction coefficient ({_ZERO:g}: none)", ylabel="coordination number")
        for level in (d + 1, 2 * d):
            right.axhline(level, color="#b0b0b0", linewidth=0.8)
        left.legend(fontsize=7.0)
        seeds = len({one.seed for one in found})
        figure.suptitle(
            f"{seeds} packings each of N = {found[0].particles}, d = {d}, pressed until they are at rest\n"
            "dotted: generalized isostaticity, (d + 1) + 2 n_m / d; gray: d + 1 and 2 d",
            fontsize=10,
        )
