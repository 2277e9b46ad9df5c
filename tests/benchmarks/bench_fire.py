# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""What one FIRE step costs: by the number of particles, with a user's law, and over a whole quench.

Beside LAMMPS and a loop written by hand: tests/benchmarks/peers.

Threads share blocks of at least 2048 rows. On one thread (AMD EPYC, the best of several runs in turn) a step takes
66 us in 2D and 161 us in 3D at N = 4096, 280 us in 2D at 16384 and 1.5 ms at 65536; blocks cost it 0 to 1 % at 4096
and 3 % in 3D, up to 2 % at 16384, between nothing and 10 % at 65536. What the first of several threads does alone,
stiffnesses every 64 steps and new inner lists, is 4 to 5 % of a step near a minimum. Both threads on one processor
take 5 to 10 % longer than one at 16384. Two threads need two idle processors: figures from a busy machine say nothing.

Run on an idle machine: OMP_NUM_THREADS=1 python tests/benchmarks/bench_fire.py
"""

from __future__ import annotations

import math
import time
from typing import Any, NamedTuple

import numpy as np
from calibration import REFERENCE_NS, calibrate, cpu_seconds

import packmech as pm
from packmech.jit.compiled import kernel
from packmech.minimize import program as programs
from packmech.minimize.first_order.fire import Fire
from packmech.minimize.passes.kernels import Goal, force_pass, move_pass
from packmech.minimize.program import Program, build_program

DT, ALPHA = 0.3, 0.15


@pm.law
class OwnHarmonic(NamedTuple):
    """The harmonic law as a user would write it."""

    energy_scale: float = 1.0

    def energy(self, distance: float, contact_distance: float) -> float:
        """Return the energy."""
        overlap = (contact_distance - distance) / contact_distance
        return 0.5 * self.energy_scale * overlap * overlap

    def first(self, distance: float, contact_distance: float) -> float:
        """Return du/dr."""
        return -self.energy_scale * (contact_distance - distance) / (contact_distance * contact_distance)

    def second(self, distance: float, contact_distance: float) -> float:
        """Return d2u/dr2."""
        return self.energy_scale / (contact_distance * contact_distance)


@kernel
def typed_loop(effects, axes, row, force_nd, velocity_nd, pairs, steps):
    """The loop of the package, without list keeping: forces by type, sums, and the mixed step."""
    speed2 = 0.0
    for _ in range(steps):
        sums = force_pass(None, effects, axes, row, force_nd, velocity_nd, pairs, None)
        push = DT
        keep = 0.0
        if sums.power > 0.0:
            keep = 1.0 - ALPHA
            push += ALPHA * math.sqrt(speed2 / sums.square)
        speed2, _most = move_pass(None, axes, row, force_nd, velocity_nd, pairs, keep, push, DT)
    return speed2


def relaxed_program(particles: int, *, seed: int = 1, dimension: int = 2) -> Program:
    """Return the program of a bidisperse packing that FIRE has brought near its minimum."""
    fraction = 0.88 if dimension == 2 else 0.68
    packing = pm.random_packing(
        particles, dimension=dimension, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=fraction, seed=seed
    )
    program = build_program(pm.Scene(packing, (pm.Repulsion(law=pm.Harmonic()),)))
    program.relax(force_tolerance=1e-2, step_limit=5000, method=pm.Fire())
    return program


def loop_arguments(program: Program, steps: int) -> tuple[Any, ...]:
    """Return what `typed_loop` takes to step a program."""
    return (program.effects, program.axes, program.row, program.force_nd, program.velocity_nd, program.pairs, steps)


def bench_step(particles: int, *, dimension: int = 2) -> float:
    """Return CPU ns per particle and step of FIRE near a minimum, list keeping included."""
    program = relaxed_program(particles, dimension=dimension)
    start = program.positions()
    method = Fire()
    # few enough that nothing is measured at the floor of rounding
    steps = 100 if particles < 1000 else 200
    took = []
    for _ in range(8):
        program.place(start)
        progress = method.start(program)
        began = time.process_time()
        method.advance(program, Goal(1e-300, 0.0), progress, steps)
        took.append((time.process_time() - began) / steps / particles * 1e9)
        assert progress.steps == steps
    return float(np.median(took[1:]))


def bench_types(particles: int) -> tuple[float, float]:
    """Return CPU ns per particle and step of the bare loop: effects chosen by type, and by type with a user's law."""
    program = relaxed_program(particles)
    steps = max(20, 500_000 // particles)
    program.evaluate()
    program.force_nd[:] = 0.0
    typed = loop_arguments(program, steps)
    own = ((pm.Repulsion(law=OwnHarmonic()),), *typed[1:])
    typed_loop(*typed)
    typed_loop(*own)
    by_type, by_user = [], []
    for _ in range(15):
        # in turn, so that both meet the same moods of the machine
        by_type.append(cpu_seconds(lambda: typed_loop(*typed), repeats=1))
        by_user.append(cpu_seconds(lambda: typed_loop(*own), repeats=1))
    one, two = (float(np.median(took)) / steps / particles * 1e9 for took in (by_type, by_user))
    return one, two


def bench_quench(particles: int, seeds: range) -> None:
    """Print steps and CPU time from random positions to 1e-10 of the mean contact force, rebuilds included."""
    rows = []
    for seed in seeds:
        packing = pm.random_packing(
            particles, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.88, seed=seed
        )
        program = build_program(pm.Scene(packing, (pm.Repulsion(),)))
        started = time.process_time()
        run = program.relax(force_tolerance=1e-10, method=pm.Fire())
        rows.append((time.process_time() - started, run.steps, run.residual))
    seconds, steps, residual = (float(np.median(column)) for column in zip(*rows, strict=True))
    print(
        f"FIRE from random, N = {particles}: {steps:.0f} steps, {seconds:.3f} s, "
        f"{seconds / steps / particles * 1e9:.1f} ns a particle and step, residual {residual:.1e} (medians)"
    )


def seconds_of(program: Program, start: Any, steps: int, clock: Any) -> float:
    """Return the seconds of so many FIRE steps from positions near a minimum."""
    program.place(start)
    method = Fire()
    progress = method.start(program)
    method.advance(program, Goal(1e-300, 0.0), progress, 3)
    began = clock()
    method.advance(program, Goal(1e-300, 0.0), progress, steps)
    return float(clock() - began)


def bench_threads(particles: int, *, dimension: int = 2) -> None:
    """Print what blocks of rows cost on one thread, and the wall time of a FIRE step on one thread and on two."""
    program = relaxed_program(particles, dimension=dimension)
    start, scene, rows = program.positions(), program.scene, programs._BLOCK
    programs._BLOCK = particles + 1
    whole = build_program(scene)
    programs._BLOCK = rows
    steps = max(10, 1_000_000 // particles)
    took: dict[str, list[float]] = {name: [] for name in ("whole", "blocks", "1", "2")}
    for _ in range(15):
        # in turn, so that all meet the same moods of the machine
        for name, one, clock in (("whole", whole, time.process_time), ("blocks", program, time.process_time)):
            took[name].append(seconds_of(one, start, steps, clock))
        for threads in (1, 2):
            program.threads = threads
            took[str(threads)].append(seconds_of(program, start, steps, time.perf_counter))
        program.threads = 1
    whole_s, blocks, one, two = (min(seconds) / steps for seconds in took.values())
    print(
        f"one FIRE step, {dimension}D, N = {particles}: {1e6 * one:.0f} us on one thread, {1e6 * two:.0f} us on two "
        f"({one / two:.2f} x); blocks cost {100.0 * (blocks / whole_s - 1.0):.1f} % on one (the best of 15)"
    )


def main() -> None:
    """Print all figures."""
    for particles, dimension in ((4096, 2), (16_384, 2), (65_536, 2), (4096, 3), (16_384, 3)):
        bench_threads(particles, dimension=dimension)
    ratio = calibrate() / REFERENCE_NS
    for particles in (1000, 4096, 100_000):
        typed, own = bench_types(particles)
        print(f"effects by type, N = {particles}: {typed:.1f} ns, a user's law {own / typed:.2f} x the built-in")
    figures = {}
    for particles, dimension in ((64, 2), (1000, 2), (4096, 2), (10_000, 2), (100_000, 2), (4096, 3)):
        took = bench_step(particles, dimension=dimension)
        figures[particles, dimension] = took
        print(
            f"one FIRE step, {dimension}D, N = {particles}: {took:.1f} ns a particle "
            f"({took / ratio:.1f} at reference speed)"
        )
    print(f"2D, N = 1e5 against 1e3: {figures[100_000, 2] / figures[1000, 2]:.2f} x")
    for particles in (256, 1024, 4096):
        bench_quench(particles, range(5))


if __name__ == "__main__":
    main()
