"""Seven equal discs in a periodic square: mechanically stable, and only locally stable, packings from random starts.

Mechanically stable ones are what random starts jam to. Locally stable ones are what is left of random starts when discs
move one at a time, each to the middle of the cage of the others, until no disc can make the smallest distance larger by
itself: the local jamming of Torquato and Stillinger, J. Phys. Chem. B 105, 11849 (2001).
"""

import numpy as np

import packmech as pm

DISCS = 7
# all nine cells that a disc can reach
CELLS = np.array([(a, b) for a in (-1.0, 0.0, 1.0) for b in (-1.0, 0.0, 1.0)])


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


def middle_of_cage(place_d: np.ndarray, others_nd: np.ndarray) -> np.ndarray:
    """Return where the distance to the nearest of the others is largest, on the steepest way up from this place.

    The way goes straight from the nearest one until another is as near, then between both until a third is, and so on,
    and ends where three are as near that lie around it.
    """
    for _ in range(len(others_nd)):
        apart = place_d - others_nd
        square = (apart**2).sum(axis=1)
        nearest = square <= square.min() * (1.0 + 1e-13)
        angle = np.sort(np.arctan2(apart[nearest, 1], apart[nearest, 0]))
        gap = np.diff(np.append(angle, angle[0] + 2.0 * np.pi))
        widest = int(gap.argmax())
        if gap[widest] <= np.pi + 1e-9:
            break
        # all lie in a half plane: halfway between the two at its sides
        middle = angle[widest] - 0.5 * (2.0 * np.pi - gap[widest])
        way = np.array([np.cos(middle), np.sin(middle)])
        # differences of squared distances are linear along the way
        approach = 2.0 * (others_nd - others_nd[int(np.argmax(nearest))]) @ way
        nearer = (approach > 1e-14) & ~nearest
        if not nearer.any():
            break
        place_d = place_d + float(((square - square.min())[nearer] / approach[nearer]).min()) * way
    return place_d


def distances(place_nd: np.ndarray) -> tuple[list[np.ndarray], np.ndarray]:
    """Return (i, j, cell) of all pairs in a unit box and nine cells, and their distances."""
    i, j = np.triu_indices(len(place_nd), 1)
    i, j, cell = np.repeat(i, len(CELLS)), np.repeat(j, len(CELLS)), np.tile(CELLS, (len(i), 1))
    return [i, j, cell], np.linalg.norm(place_nd[j] + cell - place_nd[i], axis=1)


def equidistant(place_nd: np.ndarray, pairs: list[np.ndarray], diameter: float) -> tuple[np.ndarray, float]:
    """Return places in which all these pairs are at one distance to rounding, by Newton's method, and that distance."""
    i, j, cell = pairs
    for _ in range(20):
        apart = place_nd[j] + cell - place_nd[i]
        distance = np.linalg.norm(apart, axis=1)
        slope = np.zeros((len(i), len(place_nd), 2))
        slope[np.arange(len(i)), j] += apart / distance[:, None]
        slope[np.arange(len(i)), i] -= apart / distance[:, None]
        matrix = np.column_stack([slope.reshape(len(i), -1), -np.ones(len(i))])
        step = np.linalg.lstsq(matrix, diameter - distance, rcond=1e-10)[0]
        place_nd, diameter = place_nd + step[:-1].reshape(-1, 2), diameter + float(step[-1])
        if np.abs(step).max() < 1e-15:
            break
    return place_nd, diameter


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
