"""CPU seconds of the structure measures against N, one thread."""

from __future__ import annotations

import time

import numpy as np

import packmech as pm


def scattered(particles: int, dimension: int, seed: int = 1) -> pm.Packing:
    """Return random points at the density of touching particles of diameter 1, in a tilted box."""
    rng = np.random.default_rng(seed)
    volume = particles * (0.87 if dimension == 2 else 0.82)
    lattice = np.eye(dimension)
    lattice[0, 1] = 0.3
    box = pm.Box(lattice * volume ** (1.0 / dimension))
    place = rng.random((particles, dimension)) @ box.lattice_dd.T
    return pm.Packing(place, rng.choice([0.42, 0.58], particles), box)


def spent(call, repeats: int = 3) -> float:
    """Return the least CPU time of a call, once it is compiled [s]."""
    call()
    best = np.inf
    for _ in range(repeats):
        start = time.process_time()
        call()
        best = min(best, time.process_time() - start)
    return best


def first(packing: pm.Packing, count: int) -> np.ndarray:
    """Return the indices of the shortest wave vectors."""
    d = packing.dimension
    volume = 2.0 * count * (2.0 * np.pi) ** d / packing.box.volume
    reach = (volume / (np.pi if d == 2 else 4.0 * np.pi / 3.0)) ** (1.0 / d)
    return pm.wave_indices(packing.box, reach)[:count]


def main() -> None:
    print(f"{'d':>2} {'N':>7} {'pairs r<3':>10} {'voronoi':>9} {'psi6/Q6':>9} {'S, 1e3 k':>9} {'S, 1e4 k':>9}")
    for d in (2, 3):
        for n in (1000, 10_000, 100_000):
            packing = scattered(n, d)
            reach = min(3.0, 0.49 * packing.box.reduced()[0].height_d.min())
            near = pm.find_neighbors(packing, "cutoff", cutoff=1.3)
            few, many = first(packing, 1000), first(packing, 10_000)
            figures = [
                spent(lambda p=packing, r=reach: pm.pair_distribution(p, r, 60)),
                spent(lambda p=packing: pm.find_neighbors(p), 1) if n < 100_000 or d == 2 else np.nan,
                spent(lambda p=packing, k=near: pm.bond_orientational_order(p, 6, k)),
                spent(lambda p=packing, k=few: pm.structure_factor(p, k)),
                spent(lambda p=packing, k=many: pm.structure_factor(p, k), 1),
            ]
            print(f"{d:2d} {n:7d} {figures[0]:10.3f} " + " ".join(f"{one:9.3f}" for one in figures[1:]), flush=True)


if __name__ == "__main__":
    main()
