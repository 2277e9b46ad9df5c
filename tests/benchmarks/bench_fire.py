"""What one FIRE step costs: by the number of particles, against a hand-written kernel, and over a whole quench.

Run with one thread: OMP_NUM_THREADS=1 python tests/benchmarks/bench_fire.py
"""

from __future__ import annotations

import math
import time

import numpy as np
from calibration import REFERENCE_NS, calibrate, cpu_seconds

import packmech as pm
from packmech.compiled import kernel
from packmech.dynamics.fire import Fire
from packmech.dynamics.kernels import Goal
from packmech.dynamics.program import Program, build_program


@kernel
def _hand_written(x, v, f, radius_n, i_p, j_p, shift_pd, steps, dt):  # type: ignore[no-untyped-def]
    """Harmonic discs, nothing chosen by type: forces, power, and the mixed step of FIRE."""
    alpha = 0.15
    speed2 = 0.0
    most = 0.0
    for _ in range(steps):
        total = 0.0
        touching = 0
        for p in range(i_p.shape[0]):
            i = i_p[p]
            j = j_p[p]
            dx = x[j, 0] - x[i, 0] + shift_pd[p, 0]
            dy = x[j, 1] - x[i, 1] + shift_pd[p, 1]
            square = dx * dx + dy * dy
            sigma = radius_n[i] + radius_n[j]
            if square < sigma * sigma:
                r = math.sqrt(square)
                inverse = 1.0 / sigma
                push = inverse * inverse * (sigma - r)
                total += push
                touching += 1
                push /= r
                f[i, 0] -= push * dx
                f[i, 1] -= push * dy
                f[j, 0] += push * dx
                f[j, 1] += push * dy
        power = 0.0
        square_force = 0.0
        most = 0.0
        for i in range(x.shape[0]):
            own = f[i, 0] * f[i, 0] + f[i, 1] * f[i, 1]
            power += f[i, 0] * v[i, 0] + f[i, 1] * v[i, 1]
            square_force += own
            most = max(most, own)
        keep = 0.0
        push = dt
        if power > 0.0:
            keep = 1.0 - alpha
            push += alpha * math.sqrt(speed2 / square_force)
        speed2 = 0.0
        fastest = 0.0
        for i in range(x.shape[0]):
            vx = keep * v[i, 0] + push * f[i, 0]
            vy = keep * v[i, 1] + push * f[i, 1]
            v[i, 0] = vx
            v[i, 1] = vy
            x[i, 0] += dt * vx
            x[i, 1] += dt * vy
            f[i, 0] = 0.0
            f[i, 1] = 0.0
            own = vx * vx + vy * vy
            speed2 += own
            fastest = max(fastest, own)
    return most


def relaxed_program(particles: int, *, seed: int = 1, dimension: int = 2) -> Program:
    """Return the program of a bidisperse packing that FIRE has brought near its minimum."""
    fraction = 0.88 if dimension == 2 else 0.68
    packing = pm.random_packing(
        particles, dimension=dimension, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=fraction, seed=seed
    )
    program = build_program(pm.Scene(packing, (pm.Repulsion(law=pm.Harmonic()),)))
    program.fire(force_tolerance=1e-3, step_limit=5000)
    return program


def bench_step(particles: int, *, dimension: int = 2) -> tuple[float, float]:
    """Return CPU ns per particle and step of FIRE, and of the hand-written kernel on the same pairs (2D only)."""
    program = relaxed_program(particles, dimension=dimension)
    start = program.positions()
    method = Fire()
    steps = max(100, 1_000_000 // particles)
    took = []
    for _ in range(8):
        # from the same place each time, so that nothing is measured at the floor of rounding
        program.place(start)
        progress = method.start(program)
        began = time.process_time()
        method.advance(program, Goal(1e-300, 0.0), progress, steps)
        took.append((time.process_time() - began) / steps / particles * 1e9)
        assert progress.steps == steps
    typed = float(np.median(took[1:]))
    if dimension == 3:
        return typed, math.nan
    pairs = program.pairs
    i_p = pairs.i_p[: pairs.picked].copy()
    code = pairs.code_p[: pairs.picked]
    j_p = code >> np.uint32(pairs.bits)
    shift = pairs.shift_kd[code & np.uint32((1 << pairs.bits) - 1), :2].copy()
    x, radius = program.row[:, :2].copy(), program.row[:, 3].copy()
    v, f = np.zeros_like(x), np.zeros_like(x)
    arguments = (x, v, f, radius, i_p, j_p, shift, steps, 0.3)
    _hand_written(*arguments)
    return typed, cpu_seconds(lambda: _hand_written(*arguments)) / steps / particles * 1e9


def bench_quench(particles: int, seeds: range) -> None:
    """Print steps and CPU time from random positions to 1e-10 of the mean contact force, rebuilds included."""
    rows = []
    for seed in seeds:
        packing = pm.random_packing(
            particles, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.88, seed=seed
        )
        program = build_program(pm.Scene(packing, (pm.Repulsion(),)))
        started = time.process_time()
        run = program.fire(force_tolerance=1e-10)
        rows.append((time.process_time() - started, run.steps, run.residual))
    seconds, steps, residual = (float(np.median(column)) for column in zip(*rows, strict=True))
    print(
        f"FIRE from random, N = {particles}: {steps:.0f} steps, {seconds:.3f} s, "
        f"{seconds / steps / particles * 1e9:.1f} ns a particle and step, residual {residual:.1e} (medians)"
    )


def main() -> None:
    """Print all figures."""
    ratio = calibrate() / REFERENCE_NS
    figures = {}
    for particles in (64, 1000, 4096, 10_000, 100_000):
        typed, hand = bench_step(particles)
        figures[particles] = typed
        print(
            f"one FIRE step, 2D, N = {particles}: {typed:.1f} ns a particle ({typed / ratio:.1f} at reference speed), "
            f"{typed / hand:.2f} x hand-written"
        )
    print(f"N = 1e5 against 1e3: {figures[100_000] / figures[1000]:.2f} x")
    typed, _ = bench_step(4096, dimension=3)
    print(f"one FIRE step, 3D, N = 4096: {typed:.1f} ns a particle ({typed / ratio:.1f} at reference speed)")
    for particles in (256, 1024, 4096):
        bench_quench(particles, range(3))


if __name__ == "__main__":
    main()
