"""What mechanics costs: factorizations by backend, moduli, the lowest modes, counts, and a Newton polish.

Run with one thread: OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python tests/benchmarks/bench_mechanics.py
"""

from __future__ import annotations

import functools
import statistics

import numpy as np
from calibration import calibrate, cpu_seconds

import packmech as pm
from packmech.linalg.factor import NotDefinite, factorize
from packmech.minimize.program import build_program
from packmech.minimize.second_order.newton import newton

CASES = [(64, 2, 0.9), (256, 2, 0.9), (1024, 2, 0.9), (4096, 2, 0.9), (256, 3, 0.7), (1024, 3, 0.7)]
BUDGET = {"moduli": 0.020, "modes": 0.100}


@functools.cache
def nearly_at_rest(particles: int, dimension: int, packing_fraction: float, seed: int) -> pm.Scene:
    sizes = pm.Bidisperse(ratio=1.4) if dimension == 2 else pm.Monodisperse()
    packing = pm.random_packing(
        particles, dimension=dimension, packing_fraction=packing_fraction, sizes=sizes, seed=seed
    )
    scene = pm.Scene(packing, (pm.Repulsion(law=pm.Harmonic()),))
    relaxed = build_program(scene).relax(force_tolerance=1e-6, method=pm.Fire())
    return scene.replace(packing=packing.replace(position_nd=relaxed.packing.position_nd))


def factorizations() -> None:
    print("\nfactorization of the pinned Hessian, CPU ms (solve of 6 right-hand sides, largest residual)")
    for case in CASES:
        scene = nearly_at_rest(*case, 1)
        backbone, _ = pm.remove_rattlers(scene.packing)
        d = backbone.dimension
        matrix = pm.hessian(scene.replace(packing=backbone), "none").tocsr()[d:, d:]
        right = np.random.default_rng(0).normal(size=(matrix.shape[0], 6))
        for backend in ("auto", "blocks", "qdldl", "superlu", "rslab"):
            try:
                factor = factorize(matrix, backend=backend)
            except NotDefinite as refused:
                print(f"  {case}  {backend:8s} {refused}")
                continue
            repeats = 5 if case[0] <= 1024 else 3
            whole = cpu_seconds(functools.partial(factorize, matrix, backend=backend), repeats=repeats)
            solve = cpu_seconds(functools.partial(factor.solve, right), repeats=repeats)
            worst = np.abs(matrix @ factor.solve(right) - right).max()
            print(f"  {case}  {backend:8s} {factor.backend:8s} {1e3 * whole:8.2f} ({1e3 * solve:6.2f}, {worst:.0e})")


def answers() -> None:
    print("\nmedian CPU ms over 5 packings: polish from 1e-6 (steps, largest residual), moduli, 50 modes, count")
    for case in CASES:
        polish, steps, residual, moduli, modes, counts = [], [], [], [], [], []
        for seed in range(1, 6):
            scene = nearly_at_rest(*case, seed)
            run = newton(scene, force_tolerance=1e-16, check=False)
            polish.append(cpu_seconds(functools.partial(newton, scene, force_tolerance=1e-16, check=False), repeats=1))
            steps.append(run.steps)
            residual.append(run.residual)
            rest = scene.replace(packing=run.packing)
            moduli.append(cpu_seconds(functools.partial(pm.elastic_moduli, rest), repeats=3))
            modes.append(cpu_seconds(functools.partial(pm.normal_modes, rest, 50), repeats=3))
            counts.append(cpu_seconds(functools.partial(pm.floppy_modes, rest.packing), repeats=1))
        middle = [1e3 * statistics.median(one) for one in (polish, moduli, modes, counts)]
        print(
            f"  {case}  polish {middle[0]:7.1f} ({statistics.median(steps)}, {max(residual):.0e})"
            f"  moduli {middle[1]:6.1f}  modes {middle[2]:7.1f}  floppy modes {middle[3]:7.1f}"
        )
        if case == (1024, 2, 0.9):
            for name, taken in (("moduli", middle[1]), ("modes", middle[2])):
                print(f"    {name}: {taken / (1e3 * BUDGET[name]):.2f} of the budget of {1e3 * BUDGET[name]:.0f} ms")


if __name__ == "__main__":
    calibrate()
    factorizations()
    answers()
