"""Preparations of one kind of packing: ellipses quenched, sheared to and fro, tapped, and annealed from discs."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

import packmech as pm
from packmech.validation.studies.annealing import steps_between
from packmech.validation.studies.families import jammed_discs
from packmech.validation.studies.rows import Progress, columns_of, complete_rows
from packmech.validation.studies.shapes import mean_and_error, start_of
from packmech.view.figures import COLORS, MARKERS, label_settings, styled_figure

QUENCHED, SHEARED, TAPPED, ANNEALED = 0, 1, 2, 3
WORDS = {QUENCHED: "quenched", SHEARED: "sheared to and fro", TAPPED: "tapped", ANNEALED: "annealed"}
ASPECT = 1.5
PRESSURE = 1e-6
# numbers of cycles or taps after which packings are measured
CYCLES = (1, 2, 5, 10, 20)
# amplitudes: shear strains, kicks in mean diameters; of annealing the step of the aspect
AMPLITUDES: dict[int, tuple[float, ...]] = {SHEARED: (0.05, 0.1), TAPPED: (0.1, 0.2), ANNEALED: (0.05,)}
# pressure at which packings are sheared, and steps of the strain from zero to the amplitude
_SHEAR_PRESSURE, _STEPS = 1e-3, 2


@dataclass(frozen=True)
class Prepared:
    """One jammed packing of ellipses: what it was asked for, and what came of it.

    `cycles` is the number of cycles or taps, 0 for what is quenched or annealed; `displacement` is that of the last
    cycle of shear, over the mean diameter.
    """

    preparation: int
    particles: int
    aspect: float
    amplitude: float
    cycles: int
    pressure: float
    seed: int
    packing_fraction: float
    jamming_packing_fraction: float
    coordination_number: float
    rattlers: int
    nematic_order: float
    global_order: float
    local_order: float
    states_of_self_stress: int
    displacement: float
    residual: float
    converged: int
    seconds: float

    @property
    def settings(self) -> tuple[float, ...]:
        """What it was asked for."""
        return tuple(getattr(self, one.name) for one in fields(self)[:7])


def _prepared(
    preparation: int, particles: int, aspect: float, amplitude: float, pressure: float, seed: int, cycles: Sequence[int]
) -> Iterator[tuple[int, pm.Run, float, float]]:
    """Give a packing after each number of cycles: the number, its run, the last cycle's displacement, and seconds."""
    if preparation == ANNEALED:
        discs = jammed_discs(particles, seed, pressure)
        steps = steps_between(1.0, aspect, amplitude)
        runs = pm.anneal_shape(discs, steps, seed=seed, pressure=pressure, check=False)
        yield 0, runs[-1], math.nan, sum(one.seconds for one in runs)
        return
    run = pm.jam(start_of(2, particles, aspect, seed), pressure=pressure, strain="isotropic", check=False)
    if preparation == QUENCHED:
        yield 0, run, math.nan, run.seconds
        return
    scene = pm.Scene(run.packing, (pm.Repulsion(),))
    if preparation == SHEARED:
        scene = scene.replace(packing=pm.jam(scene, pressure=_SHEAR_PRESSURE, strain="isotropic").packing)
    # a packing that is lost on the way is none: its member fails, and says so
    rng, first = np.random.default_rng(seed), 0
    for done in cycles:
        displacement = math.nan
        if preparation == TAPPED:
            runs = pm.tap(scene, amplitude, done - first, rng=rng, pressure=pressure)
            run = runs[-1]
            seconds = sum(one.seconds for one in runs)
            scene = scene.replace(packing=run.packing)
        else:
            step = amplitude / _STEPS
            runs = pm.cyclic_shear(scene, amplitude, done - first, step=step, pressure=_SHEAR_PRESSURE)
            scene = scene.replace(packing=runs[-1].packing)
            run = pm.jam(scene, pressure=pressure, strain="isotropic", check=False)
            displacement = runs[-1].report.get("displacement", math.nan)
            seconds = run.seconds + sum(one.seconds for one in runs)
        yield done, run, displacement, seconds
        first = done


def prepare(
    preparation: int, particles: int, aspect: float, amplitude: float, pressure: float, seed: int, counts: list[int]
) -> dict[str, Any]:
    """Return rows of one packing after each number of cycles or taps, 0 alone for what has none, and it at the end.

    What is sheared or tapped starts from the packing that was quenched, and is measured at the pressure.
    """
    rows = []
    for done, run, displacement, seconds in _prepared(
        preparation, particles, aspect, amplitude, pressure, seed, counts
    ):
        bonds, report = pm.bond_orientational_order(run.packing, 6), run.report
        rows.append(
            Prepared(
                *(preparation, particles, aspect, amplitude, done, pressure, seed),
                report["packing_fraction"],
                report.get("jamming_packing_fraction", math.nan),
                2.0 * report["contacts"] / (particles - report["rattlers"]),
                report["rattlers"],
                float(pm.nematic_order(run.packing)),
                bonds.global_order,
                bonds.local_order,
                report["states_of_self_stress"],
                displacement,
                run.residual,
                int(run.ok),
                seconds,
            )
        )
    return columns_of(rows) | {"packing": run.packing}


def prepare_all(
    folder: Path,
    *,
    particles: int,
    cycles: Sequence[int],
    pressure: float,
    seeds: Sequence[int],
    progress: Progress[Prepared],
    workers: int | None = None,
) -> list[Prepared]:
    """Return packings of all preparations and seeds in square boxes, each a member."""
    wanted: list[tuple[Any, ...]] = []
    for seed in seeds:
        for preparation, amplitudes in ({QUENCHED: (0.0,)} | AMPLITUDES).items():
            counts = sorted(cycles) if preparation in (SHEARED, TAPPED) else [0]
            wanted += [(preparation, particles, ASPECT, one, pressure, seed, counts) for one in amplitudes]
    return complete_rows(folder / "preparations.csv", Prepared, wanted, prepare, progress, workers)


def words_of(one: Prepared) -> str:
    """Return how a packing was prepared, in words."""
    return (
        WORDS[one.preparation]
        + {
            QUENCHED: "",
            SHEARED: f", strain {one.amplitude:g}",
            TAPPED: f", kicks of {one.amplitude:g} d",
            ANNEALED: f", steps of {one.amplitude:g}",
        }[one.preparation]
    )


def groups_of(found: Sequence[Prepared]) -> Iterator[tuple[str, int, list[Prepared]]]:
    """Give the packings by preparation and number of cycles: words, cycles, and those that came to rest."""
    for preparation, amplitude in sorted({(one.preparation, one.amplitude) for one in found}):
        mine = [one for one in found if (one.preparation, one.amplitude) == (preparation, amplitude)]
        for done in sorted({one.cycles for one in mine}):
            yield words_of(mine[0]), done, [one for one in mine if one.cycles == done and one.converged]


def draw_prepared(found: Sequence[Prepared], path: Path) -> None:
    """Write the figure: packing fraction, contacts and order over cycles or taps, with standard errors."""
    panels = (
        ("jamming_packing_fraction", "packing fraction at jamming"),
        ("coordination_number", "coordination number"),
        ("nematic_order", "nematic order"),
        ("local_order", "six-fold order, local and (dashed) global"),
    )
    series: dict[str, list[tuple[int, list[Prepared]]]] = {}
    for words, done, part in groups_of(found):
        series.setdefault(words, []).append((done, part))
    with styled_figure(path, (10.0, 7.2)) as figure:
        axes = figure.subplots(2, 2).ravel()
        for number, (words, groups) in enumerate(series.items()):
            seeds = max(len(part) for _, part in groups)
            for ax, (name, label) in zip(axes, panels, strict=True):
                for each, style in ((name, "-"), *((("global_order", "--"),) if name == "local_order" else ())):
                    mean, error = np.array([mean_and_error([getattr(x, each) for x in part]) for _, part in groups]).T
                    _draw_line(ax, [done for done, _ in groups], mean, error, number, style, f"{words} ({seeds})")
                ax.set(xlabel="cycles or taps", ylabel=label, xscale="log")
                label_settings(ax, CYCLES)
        figure.legend(*axes[0].get_legend_handles_labels(), loc="outside lower center", ncols=3, fontsize=8.0)
        what = f"Ellipses 1:1.4 of aspect {ASPECT:g}, N = {found[0].particles}, pressure {found[0].pressure:g}"
        figure.suptitle(f"{what}; all but the annealed begin as the quenched (packings of a kind)", fontsize=10)


def _draw_line(ax: Any, x: list[int], mean: np.ndarray, error: np.ndarray, number: int, style: str, label: str) -> None:
    """Draw a mean over cycles, or a band where there are none."""
    color = COLORS[number % len(COLORS)]
    kept = label if style == "-" else None
    if x == [0]:
        ax.axhline(mean[0], color=color, linestyle=style, linewidth=1.0, label=kept)
        ax.axhspan(mean[0] - error[0], mean[0] + error[0], color=color, alpha=0.12, linewidth=0.0)
        return
    marker = MARKERS[number % len(MARKERS)]
    ax.errorbar(x, mean, error, color=color, marker=marker, linestyle=style, markersize=4.0, capsize=2.0, label=kept)
