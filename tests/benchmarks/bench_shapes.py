"""What shapes cost: a pass over the forces of ellipses and spheroids beside that of discs and spheres, and jamming.

Run with one thread: OMP_NUM_THREADS=1 python tests/benchmarks/bench_shapes.py [2 | 3]
"""

import sys
import time

import packmech as pm
from packmech.jit.compiled import kernel
from packmech.minimize.passes.kernels import force_pass
from packmech.minimize.program import build_program

REPEATS, PASSES, PARTICLES = 30, 10, 4000


@kernel
def pass_forces(effects, axes, row, force_nd, velocity_nd, pairs):
    """Take the forces as minimizers do in their loops."""
    return force_pass(None, effects, axes, row, force_nd, velocity_nd, pairs, None)


def nanoseconds(scene):
    """Return the CPU time of a pass per contact, of the fastest of some repeats, in a packing that nearly rests."""
    scene = scene.replace(packing=pm.quench(scene, force_tolerance=1e-2).packing)
    program = build_program(scene)
    program.relax(force_tolerance=1e-300, method=pm.Fire(), step_limit=200)
    best = float("inf")
    for _ in range(REPEATS):
        start = time.process_time()
        for _ in range(PASSES):
            program.force_nd[:] = 0.0
            sums = pass_forces(
                program.effects, program.axes, program.row, program.force_nd, program.velocity_nd, program.pairs
            )
        best = min(best, (time.process_time() - start) / PASSES)
    return 1e9 * best / sums.touching


def main(d):
    drawing = {"dimension": d, "packing_fraction": 0.92 if d == 2 else 0.72, "seed": 1}
    plain = nanoseconds(pm.Scene(pm.random_packing(PARTICLES, **drawing), (pm.Repulsion(),)))
    print(f"d = {d}: round {plain:.1f} ns a contact")
    for aspect in (1.1, 1.5, 3.0):
        own = nanoseconds(
            pm.Scene(pm.random_packing(PARTICLES, **drawing, shapes=pm.Ellipses(aspect)), (pm.Repulsion(),))
        )
        print(f"  aspect {aspect}: {own:.1f} ns a contact, {own / plain:.1f} times")
    for count in (64, 1024):
        for seed in range(3):
            start = pm.random_packing(count, dimension=2, packing_fraction=0.6, seed=seed, shapes=pm.Ellipses(1.5))
            run = pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=1e-6, strain="isotropic", check=False)
            print(f"  jam N = {count}: {run.outcome.name}, residual {run.residual:.1e}, {run.seconds:.2f} s CPU")


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 2)
