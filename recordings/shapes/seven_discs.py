"""Seven equal discs in a periodic square: mechanically stable, and only locally stable, packings from random starts.

Mechanically stable ones are what random starts jam to. Locally stable ones are what is left of random starts when discs
move one at a time, each to the middle of the cage of the others, until no disc can make the smallest distance larger by
itself: the local jamming of Torquato and Stillinger, J. Phys. Chem. B 105, 11849 (2001).
"""

import numpy as np
from cages import CELLS, distances, equidistant, middle_of_cage

import packmech as pm

DISCS = 7


def mechanically_stable(seed: int) -> pm.Packing:
    """Return what a random start jams to; quenched deeper, nearly all starts end in the densest packing."""
    start = pm.random_packing(DISCS, dimension=2, sizes=pm.Monodisperse(), packing_fraction=0.6, seed=seed)
    method = pm.HardVertex(start_packing_fraction=0.74)
    scene = pm.Scene(start, (pm.Repulsion(),))
    return pm.jam(scene, pressure=1e-9, strain="isotropic", method=method, check=False).packing


def locally_stable(seed: int) -> pm.Packing | None:
    """Return the packing in which random discs cannot grow any more by moves of single ones; None without an end."""
    rng = np.random.default_rng(seed)
    place_nd, last = rng.random((DISCS, 2)), 0.0
    for _ in range(2000):
        for n in rng.permutation(DISCS):
            others = (np.delete(place_nd, n, axis=0)[:, None] + CELLS).reshape(-1, 2)
            place_nd[n] = middle_of_cage(place_nd[n], others) % 1.0
        smallest = distances(place_nd)[1].min()
        if smallest <= last * (1.0 + 1e-15):
            break
        last = smallest
    else:
        return None
    ends, distance_p = distances(place_nd)
    touching = distance_p <= last * (1.0 + 1e-6)
    if (distance_p[~touching] <= last * (1.0 + 1e-4)).any():
        return None
    place_nd, diameter = equidistant(place_nd, [one[touching] for one in ends], last)
    # lengths in diameters; discs are smaller than their distances by more than rounding makes of one
    return pm.Packing(place_nd / diameter, np.full(DISCS, 0.5 * (1.0 - 1e-13)), pm.Box.cubic(1.0 / diameter, 2))


def lowest_mode(scene: pm.Scene) -> np.ndarray:
    """Return the (N, 2) lowest mode of unit length, of the sign that costs less energy."""
    mode_nd = pm.normal_modes(scene, count=1, rattlers="keep").displacement_mnd[0]
    costs = [energy_change(scene, sign * mode_nd, np.array([0.2]))[0] for sign in (1.0, -1.0)]
    return mode_nd if costs[0] <= costs[1] else -mode_nd


def energy_change(scene: pm.Scene, mode_nd: np.ndarray, amplitudes: np.ndarray) -> np.ndarray:
    """Return what the energy a particle grows by along straight motions of these lengths [diameter]."""
    place_nd, unit = scene.packing.position_nd, scene.packing.reference_diameter
    moved = [scene.packing.replace(position_nd=place_nd + one * unit * mode_nd) for one in amplitudes]
    energies = np.array([pm.energy(scene.replace(packing=one)) for one in moved])
    return (energies - pm.energy(scene)) / scene.packing.particles
