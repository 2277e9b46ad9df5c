"""Dense flow of discs with friction: stress over pressure and packing fraction over the inertial number."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import packmech as pm
from packmech.validation.studies.rows import Progress, complete_rows
from packmech.view.figures import COLORS, styled_figure

INERTIAL_NUMBERS = (0.01, 0.02, 0.03, 0.05, 0.1)
# what da Cruz et al. found, Phys. Rev. E 72, 021309 (2005): stress over pressure and packing fraction, each a + b I
RATIO_LINE, FRACTION_LINE = (0.25, 1.1), (0.81, -0.3)
# where starts are taken, near what comes; restitution .1 of two discs of mean mass
_START, _DAMPING = 0.8, 1.0
# strain that counts; what does not, in units of the time in which the volume follows
_STRAIN, _SETTLING = 8.0, 1.0


@dataclass(frozen=True)
class Flow:
    """A flow at constant pressure, and one at constant volume and the packing fraction found; errors by blocks."""

    particles: int
    coefficient: float
    pressure: float
    inertial_number: float
    seed: int
    stress_ratio: float
    stress_ratio_error: float
    packing_fraction: float
    packing_fraction_error: float
    mean_pressure: float
    mean_pressure_error: float
    volume_stress_ratio: float
    volume_stress_ratio_error: float
    volume_pressure: float
    volume_pressure_error: float
    steps: int
    seconds: float

    @property
    def settings(self) -> tuple[float, ...]:
        """What it was asked for."""
        return tuple(getattr(self, one.name) for one in fields(self)[:5])


def shear(particles: int, coefficient: float, pressure: float, inertial_number: float, seed: int) -> Flow:
    """Return a flow of discs 1:1.3 in halves, springs of stiffness 1, mean mass near 1."""
    effects = (
        pm.Repulsion(pm.LinearSpring(1.0)),
        pm.Friction(coefficient, 0.5),
        pm.ContactDamping(_DAMPING),
    )
    start = pm.random_packing(
        particles, dimension=2, sizes=pm.Bidisperse(ratio=1.3), packing_fraction=_START, seed=seed
    )
    # deep overlaps of a random start would blow the box up
    start = pm.quench(pm.Scene(start, effects[:1]), force_tolerance=1e-3, check=False).packing
    rate = inertial_number * math.sqrt(pressure / start.mass_n.mean())
    skip = max(2.0, _SETTLING * rate / pressure)
    further = {"applied_strain": skip + _STRAIN, "skip_strain": skip}
    run = pm.shear_at_pressure(pm.Scene(start, effects), rate=rate, pressure=pressure, check=False, **further)
    fraction, fraction_error = run.mean(run.packing_fraction_t)
    # the same discs in the volume found
    area = float((math.pi * start.radius_n**2).sum())
    scale = math.sqrt(area / start.box.volume / fraction)
    same = pm.Packing(start.position_nd * scale, start.radius_n, pm.Box(start.box.lattice_dd * scale))
    curve = pm.steady_shear(pm.Scene(same, effects), rates=[rate], samples=4000, check=False, **further)
    ratio, ratio_error = run.stress_ratio
    mean, mean_error = run.mean(run.pressure_t)
    level = float(curve.pressure_r[0])
    return Flow(
        particles=particles,
        coefficient=coefficient,
        pressure=pressure,
        inertial_number=inertial_number,
        seed=seed,
        stress_ratio=ratio,
        stress_ratio_error=ratio_error,
        packing_fraction=fraction,
        packing_fraction_error=fraction_error,
        mean_pressure=mean,
        mean_pressure_error=mean_error,
        volume_stress_ratio=float(curve.stress_ratio_r[0]),
        volume_stress_ratio_error=float(curve.stress_error_r[0]) / level,
        volume_pressure=level,
        volume_pressure_error=float(curve.pressure_error_r[0]),
        steps=run.steps + curve.runs[0].steps,
        seconds=run.seconds + curve.seconds,
    )


def shear_all(
    path: Path,
    *,
    particles: int,
    coefficient: float,
    pressure: float,
    inertial_numbers: Sequence[float],
    seeds: Sequence[int],
    progress: Progress[Flow],
    workers: int | None = None,
) -> list[Flow]:
    """Return flows of all combinations, each a member of the ensemble beside the table."""
    wanted = list(itertools.product((particles,), (coefficient,), (pressure,), inertial_numbers, seeds))
    return complete_rows(path, Flow, wanted, shear, progress, workers)


def fit_line(found: Sequence[Flow], name: str) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return a and b of a figure a + b I by weighted least squares, and their errors."""
    x = np.array([one.inertial_number for one in found])
    y, error = (np.array([getattr(one, f"{name}{end}") for one in found]) for end in ("", "_error"))
    rows = np.column_stack([np.ones_like(x), x]) / error[:, None]
    covariance = np.linalg.inv(rows.T @ rows)
    return covariance @ (rows.T @ (y / error)), np.sqrt(np.diag(covariance))


def draw_flows(found: Sequence[Flow], path: Path) -> None:
    """Write the figure: stress ratio and packing fraction over the inertial number, with the literature's lines."""
    x = np.array([one.inertial_number for one in found])
    along = np.linspace(0.0, 1.05 * x.max(), 50)
    with styled_figure(path, (9.6, 4.2)) as figure:
        left, right = figure.subplots(1, 2)
        panels = (
            (left, "stress_ratio", RATIO_LINE, "shear stress / pressure"),
            (right, "packing_fraction", FRACTION_LINE, "packing fraction"),
        )
        for ax, name, (at_rest, slope), words in panels:
            y, error = (np.array([getattr(one, f"{name}{end}") for one in found]) for end in ("", "_error"))
            ax.errorbar(x, y, error, fmt="o", color=COLORS[0], capsize=2.0, markersize=4.0, label="constant pressure")
            (a, b), _ = fit_line(found, name)
            ax.plot(along, a + b * along, color=COLORS[0], linewidth=1.0, label=f"{a:.3f} {b:+.2f} I")
            ax.plot(
                along,
                at_rest + slope * along,
                color="#909090",
                linestyle="--",
                label=f"{at_rest:g} {slope:+g} I (2005)",
            )
            ax.set(xlabel="inertial number I", ylabel=words)
        y, error = (np.array([getattr(one, f"volume_stress_ratio{end}") for one in found]) for end in ("", "_error"))
        left.errorbar(x, y, error, fmt="s", color=COLORS[1], capsize=2.0, markersize=4.0, label="constant volume")
        for ax in (left, right):
            ax.legend(fontsize=8.0)
        one = found[0]
        figure.suptitle(
            f"N = {one.particles} discs 1:1.3, friction {one.coefficient:g}, overlaps of {one.pressure:g} diameters",
            fontsize=10,
        )
