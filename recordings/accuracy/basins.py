"""Which minimum a start belongs to: minimizers, by tolerance or step, against an adaptive integration of dx/dt = F.

    python recordings/accuracy/basins.py

`minima.py` compares minimizers as they come, on many starts, with packmech's own steepest descent. Here the reference
is scipy's BDF with the exact Hessian at a tolerance of 1e-7, and what limits the step of each method is turned: the
tolerance of the two adaptive descents, the step of gradient descent in units of 1 / stiffness, the largest step of the
others in diameters. The error is the share of starts that end in another minimum: energies that differ by more than
1e-8, or other contacts. The floor is one over the number of starts.
"""

from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

import numpy as np
from against import compare, write
from cyclopts import run
from descents import minimum, start
from scipy.integrate import BDF

import packmech as pm

OTHER, TIGHT = "minimum (share of starts that end in another)", 1e-7
METHODS: dict[str, Callable[[float], object]] = {
    "steepest descent: tolerance": pm.SteepestDescent,
    "gradient descent: step": lambda step: pm.GradientDescent(step=step),
    "FIRE: largest step": lambda step: pm.Fire(largest_step=step),
    "conjugate gradient: largest step": lambda step: pm.ConjugateGradient(largest_step=step),
    "L-BFGS: largest step": lambda step: pm.LBFGS(largest_step=step),
}


@cache
def integrated(particles: int, seed: int, tolerance: float) -> dict[str, float]:
    """Return the minimum to which scipy's BDF follows dx/dt = F until forces are small, and Newton's method then."""
    scene = start(particles, seed)
    shape = scene.packing.position_nd.shape

    def at(place_x: np.ndarray) -> pm.Scene:
        return scene.replace(packing=scene.packing.replace(position_nd=place_x.reshape(shape)))

    path = BDF(
        lambda time, place_x: pm.forces(at(place_x)).ravel(),
        *(0.0, scene.packing.position_nd.ravel(), np.inf, np.inf, tolerance, tolerance),
        jac=lambda time, place_x: -pm.hessian(at(place_x), "none").toarray(),
    )
    while np.abs(pm.forces(at(path.y))).max() > 1e-6 and path.status == "running":
        path.step()
    end = at(path.y)
    return minimum(end.replace(packing=pm.quench(end, force_tolerance=1e-10).packing))


def quenched(particles: int, seed: int, method: object) -> dict[str, float]:
    """Return the minimum to which a minimizer leads."""
    scene = start(particles, seed)
    found = pm.quench(scene, force_tolerance=1e-10, method=method, step_limit=20_000_000, check=False)
    return minimum(scene.replace(packing=found.packing))


def trial(particles: int, starts: int, name: str, setting: float) -> pm.Answer:
    """Return the share of starts that end in another minimum than the reference."""
    other = 0
    for seed in range(starts):
        true = integrated(particles, seed, TIGHT)
        adaptive = name not in METHODS
        found = integrated.__wrapped__ if adaptive else quenched
        mine = found(particles, seed, setting if adaptive else METHODS[name](setting))
        near = abs(mine["energy"] - true["energy"]) <= 1e-8 * true["energy"]
        other += not (near and mine["network"] == true["network"])
    return pm.Answer({OTHER: other / starts}, work={"same minimum": starts - other, "floor": 1.0 / starts})


def main(*, particles: int = 32, starts: int = 12, out: Path = Path(__file__).parent) -> None:
    """Quench all starts by all methods at all settings; write table, text and figure."""
    for seed in range(starts):
        integrated(particles, seed, TIGHT)
    settings = {"scipy BDF: tolerance": (1e-3, 1e-5)} | dict.fromkeys(METHODS, (1e-1, 1e-2, 1e-3, 1e-4))
    settings["gradient descent: step"] = (0.8, 0.4, 0.1, 0.02)
    problem = {name: partial(trial, particles, starts, name) for name in settings}
    about = {"knob": "tolerance or step", "title": f"Minima of {starts} starts of {particles} discs"}
    table = compare(problem, settings, (OTHER,), **about, reference_is=f"scipy's BDF at a tolerance of {TIGHT:g}")
    write(table, out, "basins", "CPU s: all starts together.", floor="floor", least=1.0 / starts)


if __name__ == "__main__":
    run(main)
