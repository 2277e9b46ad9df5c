"""Packings followed down towards jamming: pressure, energy, contacts, moduli and states at every level.

    python recordings/scaling/scaling.py springs --particles 64 --particles 256 --particles 1024

Scenes are `springs.toml` and `hertz.toml` beside this file; `--over distance --strain isotropic` compresses packings
from their own jamming points. `laws.py` makes the power laws of it.
"""

from pathlib import Path
from typing import Literal

import numpy as np
from cyclopts import run

import packmech as pm

HERE = Path(__file__).parent
LEVELS = {"pressure": np.logspace(-2.0, -6.0, 9), "distance": np.logspace(-5.0, -1.0, 9)}
FREQUENCIES = np.logspace(-3.6, 0.8, 67)


def follow(scene: str, particles: int, over: str, levels: list[float], strain: str, seed: int) -> dict[str, np.ndarray]:
    """Return figures of a packing at each level, and counts of its states without stress, all masses 1."""
    start = pm.read_scene(HERE / f"{scene}.toml", seed=seed, changes={"packing.particles": particles})
    method = pm.HardVertex(start_packing_fraction=0.9, stop_pressure=1e-4)
    first = pm.jam(start, pressure=levels[0] if over == "pressure" else 1e-6, strain=strain, method=method)
    here, call = start.replace(packing=first.packing), pm.compress if over == "distance" else pm.sweep_pressure
    figures, counts = [], []
    for one in call(here, levels, strain=strain):
        here, of, phi = start.replace(packing=one.packing), one.report, pm.packing_fraction(one.packing)
        moduli, excess = pm.elastic_moduli(here), 2.0 * one.report["excess_contacts"]
        # the mean over all directions of shear, of unstable packings, too
        bulk, shear = moduli.bulk_modulus, (np.trace(moduli.cauchy) - moduli.cauchy[:2, :2].sum() / 2.0) / 4.0
        # P ~ distance^(w - 1), energies ~ overlap^w
        onset = of.get("onset", phi * (1.0 - (1.5 if scene == "hertz" else 1.0) * of["pressure"] / bulk))
        contacts = excess / (particles - of["rattlers"])
        figures.append((onset, phi, of["pressure"], pm.energy(here) / particles, contacts, bulk, shear))
        alike = here.replace(packing=one.packing.replace(mass_n=np.ones(particles)))
        counts.append(pm.density_of_states(alike, FREQUENCIES, kind="unstressed").count_b)
    onset_l, phi_l, *rest = np.array(figures).T
    return {"figure_lq": np.stack([phi_l - onset_l[rest[0].argmin()], *rest], axis=1), "count_lb": np.array(counts)}


def main(
    scene: Literal["springs", "hertz"] = "springs",
    *,
    particles: tuple[int, ...] = (256,),
    packings: int = 20,
    over: Literal["pressure", "distance"] = "pressure",
    levels: tuple[float, ...] = (),
    strain: str = "free",
    out: Path = HERE,
    workers: int | None = None,
) -> None:
    """Follow the packings of each N, and print what is done."""
    given = {"scene": scene, "over": over, "levels": [list(levels or LEVELS[over])], "strain": strain}
    grid = given | {"particles": list(particles), "seed": range(packings)}
    print(pm.run_ensemble(follow, grid, out / "members" / scene, workers=workers).of(grid))


if __name__ == "__main__":
    run(main)
