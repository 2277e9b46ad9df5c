"""Annealed ellipses beside quenched ones over their aspect: packing fraction, contacts, nematic and six-fold order."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

import packmech as pm
from packmech.validation.studies.rows import complete_rows
from packmech.validation.studies.shapes import over_aspect, start_of
from packmech.view.figures import COLORS, MARKERS, styled_figure

ASPECTS = (1.1, 1.2, 1.3, 1.4, 1.5, 1.75, 2.0, 2.5, 3.0)
STEPS = (0.05, 0.005)
PRESSURE = 1e-6
# packing fraction at which discs are quenched that are annealed then
_DENSE = 0.9


@dataclass(frozen=True)
class Annealed:
    """One jammed packing of ellipses: what it was asked for, and what came of it; step 0 is a quench from random."""

    particles: int
    step: float
    pressure: float
    aspect: float
    seed: int
    packing_fraction: float
    jamming_packing_fraction: float
    coordination_number: float
    rattlers: int
    nematic_order: float
    global_order: float
    local_order: float
    states_of_self_stress: int
    residual: float
    converged: int
    seconds: float

    @property
    def settings(self) -> tuple[float, ...]:
        """What it was asked for."""
        return tuple(getattr(self, one.name) for one in fields(self)[:5])


def _discs(particles: int, pressure: float, seed: int) -> pm.Scene:
    """Return jammed discs 1:1.4 in halves, from random places at a packing fraction of .9, in a square box."""
    packing = pm.random_packing(
        particles, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=_DENSE, seed=seed
    )
    scene = pm.Scene(packing, (pm.Repulsion(),))
    return scene.replace(packing=pm.jam(scene, pressure=pressure, strain="isotropic").packing)


def steps_between(low: float, high: float, step: float) -> list[float]:
    """Return the aspects from one to another, this left out, in equal steps of at most a size."""
    count = max(1, round((high - low) / step))
    return [high if k == count else low + (high - low) * k / count for k in range(1, count + 1)]


def anneal_all(
    folder: Path,
    *,
    particles: int,
    steps: Sequence[float],
    aspects: Sequence[float],
    pressure: float,
    seeds: Sequence[int],
    progress: Callable[[int, int, Annealed | None], None],
) -> list[Annealed]:
    """Return packings of all steps, aspects and seeds, in square boxes, quenched ones for step 0; each is kept."""
    packings = folder / "packings"
    packings.mkdir(parents=True, exist_ok=True)
    order = sorted(aspects)

    def file_of(step: float, pressure: float, aspect: float, seed: int) -> Path:
        return packings / f"annealed-{particles}-{step:g}-{pressure:g}-{aspect:g}-{seed}.npz"

    def annealed(step: float, pressure: float, aspect: float, seed: int) -> pm.Run:
        before = [one for one in order if one < aspect and file_of(step, pressure, one, seed).exists()]
        if before:
            scene = pm.Scene(pm.read_packing(file_of(step, pressure, before[-1], seed)), (pm.Repulsion(),))
            ways, draw = steps_between(before[-1], aspect, step), None
        else:
            scene, ways, draw = _discs(particles, pressure, seed), steps_between(1.0, aspect, step), seed
        return pm.anneal_shape(scene, ways, seed=draw, pressure=pressure, check=False)[-1]

    def make(particles: int, step: float, pressure: float, aspect: float, seed: int) -> Annealed:
        if step:
            run = annealed(step, pressure, aspect, seed)
        else:
            run = pm.jam(start_of(2, particles, aspect, seed), pressure=pressure, strain="isotropic", check=False)
        report = run.report
        reached = run.ok and report.get("aspect", aspect) == aspect
        if reached:
            # where the way to an aspect failed, the next one is sought from the last that was reached
            pm.write_packing(run.packing, file_of(step, pressure, aspect, seed))
        bonds = pm.bond_orientational_order(run.packing, 6)
        return Annealed(
            *(particles, step, pressure, aspect, seed),
            report["packing_fraction"],
            report.get("jamming_packing_fraction", float("nan")),
            2.0 * report["contacts"] / (particles - report["rattlers"]),
            report["rattlers"],
            float(pm.nematic_order(run.packing)),
            bonds.global_order,
            bonds.local_order,
            report["states_of_self_stress"],
            run.residual,
            int(reached),
            run.seconds,
        )

    found: list[Annealed] = []
    for step in steps:
        # aspects last, so that each follows the one before
        wanted = [(particles, step, pressure, aspect, seed) for seed, aspect in itertools.product(seeds, order)]
        found += complete_rows(folder / f"annealed-{step:g}.csv", Annealed, wanted, make, progress, workers=0)
    return found


def words_of(step: float) -> str:
    """Return how packings were made, in words."""
    return "quenched" if step == 0.0 else f"annealed, steps of {step:g}"


def draw_annealed(found: Sequence[Annealed], path: Path) -> None:
    """Write the figure: packing fraction, contacts, nematic and six-fold order over the aspect, standard errors."""
    panels = (
        ("jamming_packing_fraction", "packing fraction at jamming"),
        ("coordination_number", "coordination number"),
        ("nematic_order", "nematic order"),
        ("local_order", "six-fold order, local and (dashed) global"),
    )
    with styled_figure(path, (10.0, 7.2)) as figure:
        axes = figure.subplots(2, 2).ravel()
        particles = found[0].particles
        for number, step in enumerate(sorted({one.step for one in found})):
            mine = [one for one in found if one.step == step and one.converged]
            seeds = len({one.seed for one in mine})
            for ax, (name, label) in zip(axes, panels, strict=True):
                aspect, mean, error = over_aspect(mine, name)
                style = dict(color=COLORS[number], marker=MARKERS[number], markersize=4.0, capsize=2.0)
                ax.errorbar(aspect, mean, error, label=f"{words_of(step)} ({seeds} of a kind)", **style)
                ax.set(xlabel="aspect", ylabel=label)
                if name == "local_order":
                    aspect, mean, error = over_aspect(mine, "global_order")
                    ax.errorbar(aspect, mean, error, linestyle="--", **style)
        # what random directors have
        axes[2].axhline(np.sqrt(np.pi / (4.0 * particles)), color="#b0b0b0", linewidth=0.8)
        axes[1].axhline(6.0, color="#b0b0b0", linewidth=0.8)
        axes[0].legend(fontsize=8.0)
        figure.suptitle(
            f"Ellipses 1:1.4, N = {particles}, pressure {found[0].pressure:g}, square; gray: random directors, z = 6",
            fontsize=10,
        )
