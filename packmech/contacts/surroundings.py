# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Who is near whom: neighbors by contact, by distance, or by the periodic Voronoi cells of the centers."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import Voronoi

from packmech.calls.display import shown
from packmech.calls.honors import honors
from packmech.calls.status import shown_as
from packmech.check import brief, instance, one_of, positive, real
from packmech.contacts.network import candidate_pairs, gap_limit
from packmech.contacts.shape_contacts import touching_pairs
from packmech.jit.compiled import kernel
from packmech.packing import Packing

RULES = ("voronoi", "contact", "cutoff", "scaled cutoff")
# images around the cell that Voronoi cells are made of, at first, in mean distances of particles
_MARGIN = 3.0


@shown()
@dataclass(frozen=True, eq=False, repr=False)
class Neighbors:
    """Neighbors of each particle, each pair in both directions, sorted by (i, j, image).

    Attributes
    ----------
    i_p, j_p
        (P,) the particles whose neighbors they are, and the neighbors.
    image_pd
        (P, d) integer vectors: v = x_j - x_i + lattice @ image for the positions as they stand in the packing.
    vector_pd
        (P, d) vectors from i to j [length].
    face_p
        (P,) lengths or areas of the faces between the Voronoi cells [length^(d-1)]; empty for other rules.
    particles
        N of the packing.
    rule
        What makes a neighbor, in words, with its number.

    """

    i_p: NDArray[np.int64]
    j_p: NDArray[np.int64]
    image_pd: NDArray[np.int64]
    vector_pd: NDArray[np.float64]
    face_p: NDArray[np.float64]
    particles: int
    rule: str

    def __len__(self) -> int:
        return len(self.i_p)

    @property
    def count_n(self) -> NDArray[np.int64]:
        """The (N,) numbers of neighbors."""
        return np.bincount(self.i_p, minlength=self.particles)

    def __repr__(self) -> str:
        return f"Neighbors of {self.particles} particles by {self.rule}: {len(self) / self.particles:.4g} each"


@kernel
def _face_sizes(vertex_vd, corner_c, start_r):
    """Return the (R,) lengths or areas of faces whose corners stand one after the other; inf where one is far away."""
    faces, d = start_r.shape[0] - 1, vertex_vd.shape[1]
    size = np.empty(faces)
    cross = np.empty(3)
    for r in range(faces):
        low, high = start_r[r], start_r[r + 1]
        far = False
        for c in range(low, high):
            far = far or corner_c[c] < 0
        if far:
            size[r] = np.inf
            continue
        total = 0.0
        if d == 2:
            for a in range(2):
                x = vertex_vd[corner_c[low + 1], a] - vertex_vd[corner_c[low], a]
                total += x * x
        else:
            cross[0] = cross[1] = cross[2] = 0.0
            for c in range(low + 1, high - 1):
                for a in range(3):
                    b, e = (a + 1) % 3, (a + 2) % 3
                    ub = vertex_vd[corner_c[c], b] - vertex_vd[corner_c[low], b]
                    ue = vertex_vd[corner_c[c], e] - vertex_vd[corner_c[low], e]
                    wb = vertex_vd[corner_c[c + 1], b] - vertex_vd[corner_c[low], b]
                    we = vertex_vd[corner_c[c + 1], e] - vertex_vd[corner_c[low], e]
                    cross[a] += 0.5 * (ub * we - ue * wb)
            for a in range(3):
                total += cross[a] * cross[a]
        size[r] = np.sqrt(total)
    return size


def _with_images(
    packing: Packing, margin: float
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return places in the reduced cell and of images within a margin of it, their particles and images there.

    And the (N, d) steps by which particles were brought into the cell. Particles come first, in their order.
    """
    small, _ = packing.box.reduced()
    place, step = small.wrap(packing.position_nd)
    fraction = place @ small.inverse_dd.T
    reach = margin / small.height_d
    # the cell itself stands first, as its particles do
    whole = [range(-int(np.ceil(one)), int(np.ceil(one)) + 1) for one in reach]
    shifts = sorted(itertools.product(*whole), key=lambda one: any(one))
    places, owners, images = [], [], []
    for shift in shifts:
        moved = fraction + np.array(shift)
        near = ((moved >= -reach) & (moved < 1.0 + reach)).all(axis=1) if any(shift) else np.ones(len(place), bool)
        places.append(place[near] + small.lattice_dd @ np.array(shift))
        owners.append(np.flatnonzero(near))
        images.append(np.tile(np.array(shift, dtype=np.int64), (int(near.sum()), 1)))
    return np.concatenate(places), np.concatenate(owners), np.concatenate(images), step


def _voronoi(packing: Packing, smallest_face: float) -> Neighbors:
    """Return the neighbors whose Voronoi cells share a face that is no smaller than asked for."""
    n, d = packing.particles, packing.dimension
    spacing = (packing.box.volume / n) ** (1.0 / d)
    margin = _MARGIN * spacing
    while True:
        place, owner, image, step = _with_images(packing, margin)
        cells = Voronoi(place)
        pair = np.asarray(cells.ridge_points, dtype=np.int64)
        inner = (pair < n).any(axis=1)
        corners = [cells.ridge_vertices[k] for k in np.flatnonzero(inner)]
        pair = pair[inner]
        start = np.concatenate([[0], np.cumsum([len(one) for one in corners])])
        corner = np.array(list(itertools.chain.from_iterable(corners)), dtype=np.int64)
        size = _face_sizes(cells.vertices, corner, start)
        # no image outside the margin reaches a corner that is nearer to its particle than half of it
        center = np.repeat(np.where(pair[:, 0] < n, pair[:, 0], pair[:, 1]), np.diff(start))
        far = np.sqrt(((cells.vertices[corner] - place[center]) ** 2).sum(axis=1))
        if np.isfinite(size).all() and (corner >= 0).all() and 2.0 * far.max() <= margin:
            break
        margin *= 2.0
    alone = np.bincount(pair[pair < n], minlength=n) == 0
    if alone.any():
        raise ValueError(
            f"packing must have no coincident centers for Voronoi cells, got one of them at that of particle "
            f"{int(np.argmax(alone))}"
        )
    kept = size > smallest_face * spacing ** (d - 1)
    pair, size = pair[kept], size[kept]
    one, other = pair.T
    first, second = one < n, other < n
    i = np.concatenate([one[first], other[second]])
    to = np.concatenate([other[first], one[second]])
    j = owner[to]
    _, change = packing.box.reduced()
    # images of the places in the cell, then of the positions as given, then along the vectors as given
    return _sorted(
        packing,
        i,
        j,
        (image[to] - step[j] + step[i]) @ change.T,
        np.concatenate([size[first], size[second]]),
        f"Voronoi cells (faces above {smallest_face:g} spacings^{d - 1})",
    )


def _sorted(
    packing: Packing,
    i_p: NDArray[np.int64],
    j_p: NDArray[np.int64],
    image_pd: NDArray[np.int64],
    face_p: NDArray[np.float64],
    rule: str,
) -> Neighbors:
    """Return directed pairs in the order (i, j, image)."""
    order = np.lexsort((*image_pd.T[::-1], j_p, i_p))
    i, j, image = i_p[order], j_p[order], np.ascontiguousarray(image_pd[order])
    vector = packing.position_nd[j] - packing.position_nd[i] + image @ packing.box.lattice_dd.T
    return Neighbors(i, j, image, vector, face_p[order] if len(face_p) else face_p, packing.particles, rule)


@shown_as("neighbors")
@honors("links shapes", packing_only=True)
def find_neighbors(
    packing: Packing,
    rule: str = "voronoi",
    *,
    cutoff: float | None = None,
    gap_tolerance: float | None = None,
    smallest_face: float = 1e-6,
) -> Neighbors:
    """Return the neighbors of every particle over all periodic images, in any box.

    Parameters
    ----------
    packing
        The packing.
    rule
        "voronoi": cells of the centers share a face. "contact": the pairs of `find_contacts` or `find_shape_contacts`.
        "cutoff": centers are nearer than `cutoff` [length], such as `PairDistribution.first_minimum`. "scaled cutoff":
        nearer than `cutoff` times the sum of radii [1], for mixtures.
    cutoff
        For the rules that have one.
    gap_tolerance
        Of contacts, as in `find_contacts`.
    smallest_face
        Smallest length or area of a face of Voronoi cells over that power of the mean spacing (V / N)^(1/d) [1]: in
        crystals several cells meet in one point, where rounding would make faces.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, a cutoff is missing or not used, or centers that have Voronoi cells
        coincide.

    Examples
    --------
    >>> import packmech as pm
    >>> crystal = pm.lattice_packing("bcc", repeats=(2, 2, 2))
    >>> [int(pm.find_neighbors(crystal, rule).count_n.max()) for rule in ("voronoi", "contact")]
    [14, 8]
    >>> pm.find_neighbors(pm.lattice_packing("square", repeats=(3, 3)), "cutoff", cutoff=1.2)
    Neighbors of 9 particles by distance below 1.2: 4 each

    """
    instance("packing", packing, Packing)
    one_of("rule", rule, RULES)
    if ("cutoff" in rule) != (cutoff is not None):
        raise ValueError(f"cutoff must be given for the rules with one only, got {brief(cutoff)} for {rule!r}")
    smallest = real("smallest_face", smallest_face, at_least=0.0)
    gap_limit(gap_tolerance)
    if rule == "voronoi":
        return _voronoi(packing, smallest)
    if rule == "contact":
        touching = touching_pairs(packing, gap_tolerance)
        # bodies that touch at several beads are neighbors once
        both = np.unique(np.column_stack([touching.i_c, touching.j_c, touching.image_cd]), axis=0)
        i, j, image, words = both[:, 0], both[:, 1], both[:, 2:], "contact"
    else:
        length = positive("cutoff", cutoff)
        scaled = rule == "scaled cutoff"
        radius = packing.radius_n if scaled else np.full(packing.particles, 0.5)
        i, j, image = candidate_pairs(packing.position_nd, radius, packing.box, scale=length)
        words = f"distance below {length:g}" + (" sums of radii" if scaled else "")
    return _sorted(
        packing,
        np.concatenate([i, j]),
        np.concatenate([j, i]),
        np.concatenate([image, -image]),
        np.zeros(0),
        words,
    )
