# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""What one step of time costs: against the pass over the forces alone, and what links add.

Run with one thread: OMP_NUM_THREADS=1 python tests/benchmarks/bench_simulate.py
"""

from __future__ import annotations

import time

import numpy as np
from calibration import calibrate

import packmech as pm
from packmech.dynamics.engine import build_engine
from packmech.dynamics.observables import CONTACTS
from packmech.jit.compiled import kernel
from packmech.minimize.passes.kernels import force_pass
from packmech.minimize.program import build_program

REPULSION = (pm.Repulsion(),)
DAMPED = (pm.Repulsion(), pm.ContactDamping(0.1))


@kernel
def pass_forces(effects, axes, row, force_nd, velocity_nd, pairs):
    """Take the forces as minimizers do in their loops."""
    return force_pass(None, effects, axes, row, force_nd, velocity_nd, pairs, None)


def cost(scene, steps):
    """Return CPU ns a particle and step of a run, the same of the force pass alone, and contacts a particle."""
    n = scene.packing.particles
    scene = scene.replace(packing=scene.packing.replace(mass_n=np.ones(n)))
    engine = build_engine(scene, dt=0.05, velocity_nd=np.zeros_like(scene.packing.position_nd))
    engine.set_velocities(engine.thermal_velocities(1e-4, np.random.default_rng(1)))
    engine.advance(2)
    program = build_program(scene)
    program.evaluate()
    best = [np.inf, np.inf]
    for _ in range(3):
        began = time.process_time()
        engine.advance(steps)
        best[0] = min(best[0], (time.process_time() - began) / steps)
        began = time.process_time()
        for _ in range(steps):
            program.force_nd[:] = 0.0
            pass_forces(scene.effects, program.axes, program.row, program.force_nd, program.velocity_nd, program.pairs)
        best[1] = min(best[1], (time.process_time() - began) / steps)
    return best[0] / n * 1e9, best[1] / n * 1e9, engine.observe()[CONTACTS] / n


def relaxed(packing, effects):
    """Return a scene near a minimum of the energy."""
    at_rest = pm.quench(pm.Scene(packing, REPULSION), force_tolerance=1e-3).packing
    return pm.Scene(at_rest, effects)


def main():
    """Print the table."""
    calibrate()
    print(
        "scene                                      contacts/N   ns/particle-step   of the force pass   ns/contact-step"
    )
    sizes = pm.Bidisperse(ratio=1.4)
    cases = []
    for n, d, fraction in ((1_000, 2, 0.95), (10_000, 2, 0.95), (10_000, 3, 0.7)):
        packing = pm.random_packing(n, dimension=d, sizes=sizes, packing_fraction=fraction, seed=1)
        cases.append((f"{n} particles, {d}D", relaxed(packing, REPULSION)))
    cases.append(("10000 particles, 2D, dashpots", cases[1][1].replace(effects=DAMPED)))
    for name, shape in (("dimers", pm.Dimer()), ("rigid trimers", pm.Trimer())):
        packing = pm.cluster_packing(1_000, shape=shape, dimension=2, packing_fraction=0.85, seed=1)
        cases.append((f"1000 {name}, 2D", relaxed(packing, REPULSION)))
    chains = pm.chain_packing(50, beads=200, dimension=2, packing_fraction=0.6, seed=1)
    cases.append(("50 chains of 200, 2D", relaxed(chains, REPULSION)))
    for name, scene in cases:
        whole, alone, contacts = cost(scene, max(100, 2_000_000 // scene.packing.particles))
        row = f"{contacts:8.2f} {whole:16.1f} {whole / alone:19.2f}"
        print(f"{name:40s} {row} {whole / max(contacts, 1e-9):18.1f}")


if __name__ == "__main__":
    main()
