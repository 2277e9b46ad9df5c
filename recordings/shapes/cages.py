"""Places of discs in a periodic unit square: distances, middles of cages, and pairs at one distance to rounding."""

import numpy as np

# all nine cells that a disc can reach
CELLS = np.array([(a, b) for a in (-1.0, 0.0, 1.0) for b in (-1.0, 0.0, 1.0)])


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
