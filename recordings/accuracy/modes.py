"""The lowest modes by dense diagonalization and by shift-invert, and counts of states by inertia, against N.

    python recordings/accuracy/modes.py

Discs pressed to 1e-4, without rattlers. The reference of each size is numpy's diagonalization of the whole Hessian,
which packmech does not use. Its floor: an eigenvalue is good to the rounding of the largest, and so the lowest
frequency to 1.1e-16 times (highest / lowest)^2. Counts have no floor: a bin holds as many modes or it does not.
"""

from functools import cache, partial
from pathlib import Path

import numpy as np
from against import compare, write
from cyclopts import run

import packmech as pm

FREQUENCY, COUNT = "lowest frequencies (relative)", "modes in a bin"
SIZES = (128.0, 256.0, 512.0, 1024.0)


@cache
def scene_of(particles: float) -> pm.Scene:
    """Return discs of unit mass that are pressed to 1e-4, without rattlers."""
    given = {"dimension": 2, "sizes": pm.Bidisperse(ratio=1.4), "packing_fraction": 0.87, "seed": 1}
    start = pm.Scene(pm.random_packing(int(particles), **given), (pm.Repulsion(),))
    backbone = pm.remove_rattlers(pm.jam(start, pressure=1e-4, strain="isotropic").packing)[0]
    return start.replace(packing=backbone.replace(mass_n=np.ones(backbone.particles)))


@cache
def reference(particles: float) -> np.ndarray:
    """Return all frequencies but the two of translations, by numpy."""
    value = np.linalg.eigvalsh(pm.hessian(scene_of(particles), "none").toarray())
    return np.sqrt(np.sort(np.delete(value, np.argsort(np.abs(value))[:2])))


def counts_off(source: pm.Scene | pm.Modes, particles: float) -> dict[str, float]:
    """Return by how many modes the worst of 50 bins is off."""
    true = reference(particles)
    edge = np.linspace(0.0, 1.01 * true[-1], 51)
    off = pm.density_of_states(source, edge).count_b - np.histogram(true, edge)[0]
    return {COUNT: float(np.abs(off).max())}


def by_modes(method: str, count: int | None, particles: float) -> pm.Answer:
    """Return how far the lowest frequencies are off, and the counts where all modes are found."""
    true = reference(particles)
    modes = pm.normal_modes(scene_of(particles), count, method=method)
    off = {FREQUENCY: float(np.abs(modes.frequency_m / true[: len(modes)] - 1.0).max())}
    floor = 0.5 * np.finfo(float).eps * float(true[-1] / true[0]) ** 2
    work = {"modes": len(modes), "missed": modes.missed, "residual": modes.residual, "floor": floor}
    return pm.Answer(off if count else off | counts_off(modes, particles), work=work)


def main(*, sizes: tuple[float, ...] = SIZES, count: int = 30, out: Path = Path(__file__).parent) -> None:
    """Find modes and counts of all sizes; write table, text and figure."""
    methods = {"dense, all": partial(by_modes, "dense", None)}
    methods |= {f"{one}, lowest {count}": partial(by_modes, one, count) for one in ("dense", "shift-invert")}
    methods["inertia, 50 bins"] = lambda particles: counts_off(scene_of(particles), particles)
    table = compare(
        methods,
        sizes,
        (FREQUENCY, COUNT),
        3,
        knob="discs",
        title="Modes of discs at pressure 1e-4, and counts of states",
        reference_is="numpy's diagonalization of the whole Hessian",
    )
    worst = max(one.errors.get(COUNT, 0.0) for one in table.trials)
    most = max(one.errors[FREQUENCY] / one.work["floor"] for one in table.trials if FREQUENCY in one.errors)
    missed = sum(one.work.get("missed", 0) for one in table.trials)
    words = f"Frequencies are off by {most:.1f} floors at most, counts by {worst:g} modes; {missed:g} modes are missed."
    write(table, out, "modes", words, floor="floor")


if __name__ == "__main__":
    run(main)
