"""What mechanics with rigid links costs: moduli, and how much longer the dense reference takes.

Run with one thread: OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 python tests/benchmarks/bench_link_mechanics.py
"""

from __future__ import annotations

import functools

import numpy as np
from calibration import calibrate, cpu_seconds

import packmech as pm

# beads in a cluster, repeats of the crystal
CASES = [(2, (32, 32)), (3, (32, 32)), (200, (32, 32)), (3, (64, 64)), (200, (64, 64)), (3, (16, 8, 8))]
DENSE_PARTICLES = 1024


def linked_crystal(beads: int, repeats: tuple[int, ...]) -> pm.Scene:
    """Return a disturbed crystal cut into chains of at most so many beads."""
    name = "triangular" if len(repeats) == 2 else "fcc"
    packing = pm.lattice_packing(name, repeats=repeats, relative_overlap=0.03)
    shake = 0.005 * np.random.default_rng(0).normal(size=packing.position_nd.shape)
    packing = packing.replace(position_nd=packing.position_nd + shake)
    contacts = pm.find_contacts(packing, gap_tolerance=0.0)
    near: list[list[tuple[int, int]]] = [[] for _ in range(packing.particles)]
    for c, (i, j) in enumerate(zip(contacts.i_c.tolist(), contacts.j_c.tolist(), strict=True)):
        near[i].append((j, c))
        near[j].append((i, c))
    taken = np.zeros(packing.particles, dtype=bool)
    chosen = []
    for start in range(packing.particles):
        here, taken[start] = (-1 if taken[start] else start), True
        for _ in range(beads - 1):
            free = [(j, c) for j, c in near[here] if not taken[j]] if here >= 0 else []
            if not free:
                break
            here, c = free[0]
            taken[here] = True
            chosen.append(c)
    links = pm.Links(contacts.i_c[chosen], contacts.j_c[chosen], contacts.image_cd[chosen], contacts.distance_c[chosen])
    return pm.Scene(packing.replace(links=links), (pm.Repulsion(),))


def main() -> None:
    """Print a table."""
    print(f"calibration {calibrate():.3f}")
    print("beads  N      links  moduli ms   dense ms   ratio  largest relative difference of compliance")
    for beads, repeats in CASES:
        scene = linked_crystal(beads, repeats)
        sparse = cpu_seconds(functools.partial(pm.elastic_moduli, scene), repeats=3)
        row = f"{beads:5d}  {scene.packing.particles:5d} {len(scene.packing.links):6d}  {1e3 * sparse:9.1f}"
        if scene.packing.particles <= DENSE_PARTICLES:
            reference = functools.partial(pm.compliance_matrix, scene, method="pseudoinverse")
            dense = cpu_seconds(reference, repeats=1)
            one, other = pm.compliance_matrix(scene), reference()
            error = np.abs(one - other).max() / np.abs(other).max()
            row += f"  {1e3 * dense:9.1f}  {dense / sparse:6.1f}  {error:.1e}"
        print(row, flush=True)


if __name__ == "__main__":
    main()
