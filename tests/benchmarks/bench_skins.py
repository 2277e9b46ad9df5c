"""Width of the wide pair list against seconds per step: quench of discs and spheres, frictional shear, Newton's method.

A wide list is searched seldom and holds many pairs, a narrow one the reverse. Only `pm.Newton` has the width as an
argument; that of all others is set here below public names. Its pairs are picked again into a list whose width adapts
to the motion, which stays as it is. The reference is the result at the width that packmech takes: a list decides only
which pairs are looked at, so that every bit must be the same, and the floor of the error is zero.

    OMP_NUM_THREADS=1 python tests/benchmarks/bench_skins.py recordings/accuracy
"""

from __future__ import annotations

import sys
from functools import partial
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np

import packmech as pm
from packmech.dynamics import engine
from packmech.minimize import program

SKINS = (2.4, 1.2, 0.9, 0.6, 0.45, 0.3, 0.15, 0.05)
# what packmech takes, by method
TAKEN = {"quench of discs": 0.6, "quench of spheres": 0.6, "frictional shear of discs": 0.6, "Newton, discs": 0.3}
LAW = pm.LinearSpring()


def start(particles: int, dimension: int) -> pm.Scene:
    """Return a random start well above jamming."""
    sizes, fraction = pm.Bidisperse(ratio=1.4), {2: 0.9, 3: 0.7}[dimension]
    packing = pm.random_packing(particles, dimension=dimension, sizes=sizes, packing_fraction=fraction, seed=1)
    return pm.Scene(packing, (pm.Repulsion(law=LAW),))


def rough(particles: int) -> pm.Scene:
    """Return discs at rest with friction and dashpots."""
    scene = start(particles, 2)
    effects = (*scene.effects, pm.ContactDamping(0.3), pm.Friction(0.5, 2.0 / 7.0, 0.15))
    return pm.Scene(pm.quench(scene, force_tolerance=1e-6).packing, effects)


def trial(name: str, scene: pm.Scene, skin: float) -> pm.Answer:
    """Return where all particles are after the run at a width [mean diameter] and microseconds per step."""
    usual = program._SKIN, engine._SKIN
    program._SKIN = engine._SKIN = skin
    try:
        if name.startswith("frictional"):
            run = pm.ramp_strain(scene, rate=1e-3, applied_strain=0.2, dt=0.05)
        else:
            method = pm.Newton(skin=skin) if name.startswith("Newton") else pm.Fire()
            run = pm.quench(scene, force_tolerance=1e-8, method=method)
    finally:
        program._SKIN, engine._SKIN = usual
    work = {"steps": float(run.steps), "microseconds per step": 1e6 * run.seconds / run.steps}
    return pm.Answer(run.packing.position_nd, work=work)


def draw(tables: list[pm.WorkPrecision], path: Path) -> None:
    """Draw seconds per step over those of the width that packmech takes, against the width; rings mark that one."""
    figure, ax = plt.subplots(figsize=(7.2, 4.6), layout="constrained")
    for table, mark in zip(tables, "osD^", strict=True):
        (name,) = table.methods
        taken = next(one.seconds for one in table.of() if one.setting == TAKEN[name])
        ax.plot(
            [one.setting for one in table.of()], [one.seconds / taken for one in table.of()], marker=mark, label=name
        )
        ax.plot(TAKEN[name], 1.0, "ko", fillstyle="none", markersize=13)
    ax.set(xlabel="width of the wide list / mean diameter", xscale="log", ylabel="CPU seconds over those at the ring")
    ax.legend()
    figure.savefig(path, dpi=130)


def main(out: Path, particles: int = 1000, skins: tuple[float, ...] = SKINS, repeats: int = 3) -> None:
    """Run all scenes at all widths; write table, text and figure."""
    flat = start(particles, 2)
    near = flat.replace(packing=pm.quench(flat, force_tolerance=1e-3, method=pm.Fire()).packing)
    scenes = dict(zip(TAKEN, (flat, start(particles, 3), rough(particles), near), strict=True))
    tables = [
        pm.work_precision(
            {name: partial(trial, name, scene)},
            skins,
            trial(name, scene, TAKEN[name]).value,
            error=lambda value, true: {"positions": float(np.abs(value - true).max())},
            knob="width of the list",
            title=f"Width of pair lists: {particles} particles",
            reference_is="the width that packmech takes",
            repeats=repeats,
        )
        for name, scene in scenes.items()
    ]
    trials = [one for table in tables for one in table.trials]
    whole = pm.WorkPrecision(
        tuple(trials), {name: 0.0 for name in TAKEN}, tables[0].knob, tables[0].title, tables[0].reference_is
    )
    words = [f"Largest difference of positions at any width: {max(one.error for one in trials):g}."]
    for table in tables:
        best = min(table.of(), key=lambda one: one.seconds)
        (taken,) = (one for one in table.of() if one.setting == TAKEN[best.method])
        share = taken.seconds / best.seconds - 1.0
        words.append(
            f"{best.method}: quickest at {best.setting:g}; {taken.setting:g}, taken, lasts {share:.0%} longer."
        )
    text = "\n".join([f"# {whole.title}", "", f"Reference: {whole.reference_is}.", "", *words, "", whole.to_markdown()])
    (out / "skins.md").write_text(text)
    (out / "skins.csv").write_text(whole.to_csv())
    draw(tables, out / "skins.png")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
