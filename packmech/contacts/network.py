"""Neighbors and contacts: candidate pairs found by cells, and the pairs among them that touch."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.box import Box
from packmech.calls.display import shown
from packmech.calls.honors import ANY_LENGTH, honors
from packmech.check import chosen_rows, entries, instance, particle_mask, real
from packmech.contacts.cells import find_pairs, frame_of, size_levels
from packmech.contacts.excluded import Excluded
from packmech.jit.compiled import device, kernel
from packmech.packing import Packing
from packmech.shapes import Discs

# gaps that rounding of positions makes, in units of it
_DIGITS = 8.0
# gaps and overlaps of packings whose particles just touch, relative to the contact distance
_ROUNDING = 1e-9


class Candidates(NamedTuple):
    """Pairs whose distance is at most scale * (radius_i + radius_j) + skin, each once, sorted by (i, j, image).

    image_cd refers to the positions as given: v = x_j - x_i + lattice @ image.
    """

    i_c: NDArray[np.int64]
    j_c: NDArray[np.int64]
    image_cd: NDArray[np.int64]


@kernel
def _pairs_as_given(axes, row, sizes, frame, scale, skin, step_nd, change_dd):  # type: ignore[no-untyped-def]
    """Return the pairs with images for the positions and vectors as given, and whether some pair has several."""
    i_p, code_p, image_kd, bits = find_pairs(axes, row, sizes, frame, scale, skin)
    count, d = i_p.shape[0], change_dd.shape[0]
    i_c, j_c, image_cd = np.empty(count, np.int64), np.empty(count, np.int64), np.empty((count, d), np.int64)
    several = False
    for c in range(count):
        i, j = np.int64(i_p[c]), np.int64(code_p[c]) >> bits
        k = np.int64(code_p[c]) & ((1 << bits) - 1)
        sign = 0
        for a in range(d):
            total = 0
            for b in range(d):
                total += change_dd[a, b] * (np.int64(image_kd[k, b]) - step_nd[j, b] + step_nd[i, b])
            image_cd[c, a] = total
            if sign == 0 and total != 0:
                sign = 1 if total > 0 else -1
        # a particle and its image are one pair: its first component along the given vectors is to be positive
        if i == j and sign < 0:
            for a in range(d):
                image_cd[c, a] *= -1
        several = several or (c > 0 and i == i_c[c - 1] and j == j_c[c - 1])
        i_c[c], j_c[c] = i, j
    return i_c, j_c, image_cd, several


def candidate_pairs(
    position_nd: NDArray[np.float64], radius_n: NDArray[np.float64], box: Box, *, scale: float = 1.0, skin: float = 0.0
) -> Candidates:
    """Return all pairs, over all images, with distance <= scale * (radius_i + radius_j) + skin.

    Parameters
    ----------
    position_nd
        (N, d) centers [length], inside the cell or not.
    radius_n
        (N,) radii [length].
    box
        The periodic box.
    scale, skin
        Factor on the contact distance [1] and length added to it [length].

    Examples
    --------
    >>> pairs = candidate_pairs(np.zeros((1, 2)), np.array([0.5]), Box.cubic(1.0, 2))
    >>> pairs.image_cd.tolist()
    [[0, 1], [1, 0]]

    """
    d = box.dimension
    small, change = box.reduced()
    wrapped, step = small.wrap(position_nd)
    row = np.zeros((len(radius_n), 4))
    row[:, :d] = wrapped
    row[:, 3] = radius_n
    i_c, j_c, image_cd, several = _pairs_as_given(
        (0,) * d, row, size_levels(radius_n), frame_of(small), float(scale), float(skin), step, change
    )
    # the search sorts by (i, j) already; only the images of one pair may want sorting along the given vectors
    if several:
        sort = np.lexsort((*image_cd.T[::-1], j_c, i_c))
        image_cd = image_cd[sort]
    return Candidates(i_c, j_c, np.ascontiguousarray(image_cd))


@shown(lambda one: f"{len(one)} contacts of {one.particles} particles")
@dataclass(frozen=True, eq=False)
class Contacts:
    """Touching pairs as a multigraph, each physical pair once, sorted by (i, j, image).

    Attributes
    ----------
    i_c, j_c
        (C,) particles; i < j, or i == j for a particle that touches its own image.
    image_cd
        (C, d) integer vectors: v = x_j - x_i + lattice @ image for the positions as they stand in the packing.
    normal_cd
        (C, d) unit vectors from i to j [1].
    distance_c, contact_distance_c, effective_radius_c
        (C,) center distance, sum of radii, and r_i r_j / (r_i + r_j) [length]; ``gap_c`` is the first less the second
        [length], ``overlap_c`` the overlap over the second [1].
    kinds_c
        (C,) which pair of kinds of particles each is, as `pair_of_kinds` counts them.
    particles, dimension
        N and d of the packing.

    """

    i_c: NDArray[np.int64]
    j_c: NDArray[np.int64]
    image_cd: NDArray[np.int64]
    normal_cd: NDArray[np.float64]
    distance_c: NDArray[np.float64]
    contact_distance_c: NDArray[np.float64]
    effective_radius_c: NDArray[np.float64]
    kinds_c: NDArray[np.int64]
    particles: int
    dimension: int

    def __len__(self) -> int:
        return len(self.i_c)

    @property
    def gap_c(self) -> NDArray[np.float64]:
        """The (C,) signed surface distances, negative where particles overlap [length]."""
        return self.distance_c - self.contact_distance_c

    @property
    def overlap_c(self) -> NDArray[np.float64]:
        """The (C,) relative overlaps xi = 1 - r/sigma [1]."""
        return 1.0 - self.distance_c / self.contact_distance_c

    @property
    def vector_cd(self) -> NDArray[np.float64]:
        """The (C, d) vectors from center i to center j [length]."""
        return self.normal_cd * self.distance_c[:, None]

    @property
    def slope_cx(self) -> NDArray[np.float64]:
        """The (C, d) slopes of the distances along these vectors: the normals [1]."""
        return self.normal_cd

    @property
    def curvature_cxx(self) -> NDArray[np.float64]:
        """The (C, d, d) second derivatives of the distances, (1 - n n) / r; zero where centers coincide [1/length]."""
        # with the pairs along the last axis: products over short rows take twice as long
        n, inverse = np.ascontiguousarray(self.normal_cd.T), np.zeros(len(self))
        np.divide(1.0, self.distance_c, out=inverse, where=self.distance_c > 0.0)
        curvature = (np.eye(self.dimension)[:, :, None] - n[:, None] * n) * inverse
        return np.ascontiguousarray(curvature.transpose(2, 0, 1))

    @property
    def shapes(self) -> Discs:
        """Discs or spheres."""
        return Discs(self.particles, self.dimension)

    @property
    def push_c(self) -> NDArray[np.float64]:
        """The (C,) sizes of a force of a contact over du/drho: 1."""
        return np.ones(len(self))

    @property
    def turn_nkt(self) -> NDArray[np.float64]:
        """An (N, 0, 0) array: discs and spheres have no coordinates of turns."""
        return np.zeros((self.particles, 0, 0))

    @property
    def pairs(self) -> Candidates:
        """The pairs, as `pair_contacts` takes them."""
        return Candidates(self.i_c, self.j_c, self.image_cd)

    def at(self, packing: Packing) -> Contacts:
        """Return the same pairs where another packing of the same particles is, touching or not."""
        instance("packing", packing, Packing)
        return pair_contacts(packing, *self.pairs)

    def among(self, kept_n: NDArray[np.bool_]) -> Contacts:
        """Return the contacts both of whose particles are among the (N,) named ones."""
        kept = particle_mask("kept_n", kept_n, self.particles)
        return self.select(kept[self.i_c] & kept[self.j_c])

    def numbered(self, number_n: NDArray[np.int64], packing: Packing) -> Contacts:
        """Return the contacts between the particles of another packing, by their new numbers."""
        return replace(
            self, i_c=number_n[self.i_c], j_c=number_n[self.j_c], particles=int(number_n.max(initial=-1)) + 1
        )

    @property
    def bead_c2(self) -> None:
        """Which beads of a pair touch: none, where particles have no beads."""
        return None

    def points(self, radius_n: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (C, d) vectors from center i to the point of contact, the share r_i / (r_i + r_j) of the way."""
        return self._share(radius_n)[:, None] * self.vector_cd

    def point_slopes(self, radius_n: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (C, d, X) derivatives of these by the vectors and the rotations of i and of j."""
        d = self.dimension
        slope = np.zeros((len(self), d, 4 if d == 2 else 9))
        slope[:, :, :d] = self._share(radius_n)[:, None, None] * np.eye(d)
        return slope

    def _share(self, radius_n: NDArray[np.float64]) -> NDArray[np.float64]:
        radius = entries("radius_n", radius_n, "iuf", "real numbers")
        if radius.ndim != 1 or len(radius) < self.particles:
            raise ValueError(f"radius_n must have shape ({self.particles},), got {radius.shape}")
        return np.asarray(radius[self.i_c] / (radius[self.i_c] + radius[self.j_c]))

    def select(self, keep_c: ArrayLike) -> Contacts:
        """Return the contacts that a boolean mask or an index array names, in their order."""
        keep = chosen_rows("keep_c", keep_c, len(self))
        # by numbers: of an array with columns a mask takes its rows at a tenth of the speed
        row = np.flatnonzero(keep) if keep.dtype == bool else keep
        return Contacts(
            self.i_c[row],
            self.j_c[row],
            self.image_cd.take(row, axis=0),
            self.normal_cd.take(row, axis=0),
            self.distance_c[row],
            self.contact_distance_c[row],
            self.effective_radius_c[row],
            self.kinds_c[row],
            self.particles,
            self.dimension,
        )

    def count_n(self) -> NDArray[np.int64]:
        """Return the (N,) number of contacts of each particle; a self-image counts twice, once for each side."""
        ends = np.concatenate([self.i_c, self.j_c])
        return np.bincount(ends, minlength=self.particles)


def distance_change(
    vector_cd: NDArray[np.float64], change_cd: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Return by how much lengths of vectors grow when these change, and the lengths before and after.

    The length changes by (2 v.dv + dv.dv) / (r + r'), whose digits a difference of the lengths would lose.
    """
    before = np.sqrt((vector_cd**2).sum(axis=1))
    after = np.sqrt(((vector_cd + change_cd) ** 2).sum(axis=1))
    exact = 2.0 * (vector_cd * change_cd).sum(axis=1) + (change_cd**2).sum(axis=1)
    return exact / np.maximum(before + after, np.finfo(float).tiny), before, after


def distinct_pairs(
    i_c: NDArray[np.int64], j_c: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
    """Return the pairs of different particles, each once, and the number of each contact's pair.

    Parameters
    ----------
    i_c, j_c
        (C,) particles of the contacts, sorted by (i, j), so that the images of a pair stand together. The number of a
        contact with an own image is another pair's.

    Examples
    --------
    >>> i, j, number = distinct_pairs(np.array([0, 0, 0, 1]), np.array([0, 1, 1, 2]))
    >>> i.tolist(), j.tolist(), number.tolist()
    ([0, 1], [1, 2], [-1, 0, 0, 1])

    """
    apart = np.flatnonzero(i_c != j_c)
    i, j = i_c[apart], j_c[apart]
    new = np.ones(len(apart), dtype=bool)
    new[1:] = (i[1:] != i[:-1]) | (j[1:] != j[:-1])
    first = np.zeros(len(i_c), dtype=np.int64)
    first[apart[new]] = 1
    return i[new], j[new], np.cumsum(first) - 1


@device
def effective_radius(radius: Any, other: Any) -> Any:
    """Return r_i r_j / (r_i + r_j) of radii, or of arrays of them [length]."""
    return radius * other / (radius + other)


@device
def pair_of_kinds(one: Any, other: Any) -> Any:
    """Return the place of two kinds, either of them first, in a table of all pairs; of arrays of kinds, too.

    Pairs are counted row by row of the lower triangle, (0, 0), (1, 0), (1, 1), (2, 0), ..., so that further kinds
    change no place.

    Examples
    --------
    >>> [int(pair_of_kinds(*pair)) for pair in ((0, 0), (0, 1), (1, 0), (1, 1), (2, 0))]
    [0, 1, 1, 2, 3]

    """
    high, low = np.maximum(one, other), np.minimum(one, other)
    return high * (high + 1) // 2 + low


def kinds_of_pairs(packing: Packing, i_c: NDArray[np.int64], j_c: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return (C,) which pair of kinds each pair of particles is; zeros where all are of one kind."""
    kind_n = packing.kind_n
    return np.zeros(len(i_c), dtype=np.int64) if kind_n is None else np.asarray(pair_of_kinds(kind_n[i_c], kind_n[j_c]))


@kernel
def _geometry(position_nd, radius_n, lattice_dd, i_c, j_c, image_cd):  # type: ignore[no-untyped-def]
    """Return normals, distances, sums and effective radii of the pairs, and whether no centers coincide."""
    count, d = image_cd.shape
    normal, distance, sigma, effective = np.empty((count, d)), np.empty(count), np.empty(count), np.empty(count)
    apart = True
    for c in range(count):
        i, j = i_c[c], j_c[c]
        largest = 0.0
        for a in range(d):
            shift = 0.0
            for b in range(d):
                shift += image_cd[c, b] * lattice_dd[a, b]
            x = position_nd[j, a] - position_nd[i, a] + shift
            normal[c, a] = x
            largest = max(largest, abs(x))
        # scaled by the largest component, so that no unit of length under- or overflows
        square = 0.0
        safe = largest if largest > 0.0 else 1.0
        for a in range(d):
            part = normal[c, a] / safe
            square += part * part
        length = safe * np.sqrt(square)
        distance[c] = length
        sigma[c] = radius_n[i] + radius_n[j]
        effective[c] = effective_radius(radius_n[i], radius_n[j])
        if largest > 0.0:
            for a in range(d):
                normal[c, a] /= length
        else:
            apart = False
    return normal, distance, sigma, effective, apart


def pair_contacts(
    packing: Packing, i_c: NDArray[np.int64], j_c: NDArray[np.int64], image_cd: NDArray[np.int64]
) -> Contacts:
    """Return the geometry of the given pairs, touching or not.

    Coincident centers have no direction: their normal is a fixed unit vector that depends on the pair's numbers only,
    so that forces of a deep overlap separate them and every repetition takes the same way.

    Parameters
    ----------
    packing
        The packing.
    i_c, j_c, image_cd
        (C,), (C,), (C, d) pairs and images.

    """
    normal, distance, sigma, effective, apart = _geometry(
        packing.position_nd, packing.radius_n, packing.box.lattice_dd, i_c, j_c, image_cd
    )
    if not apart:
        here = distance == 0.0
        normal[here] = coincident_normal(i_c[here], j_c[here], packing.dimension)
    kinds = kinds_of_pairs(packing, i_c, j_c)
    return Contacts(i_c, j_c, image_cd, normal, distance, sigma, effective, kinds, packing.particles, packing.dimension)


def coincident_normal(i_c: NDArray[np.int64], j_c: NDArray[np.int64], dimension: int) -> NDArray[np.float64]:
    """Return (C, d) unit vectors for pairs at the same place: a direction by the golden ratio of the pair's numbers."""
    turn = np.mod((i_c + 1) * 0.6180339887498949 + (j_c + 1) * 0.7548776662466927, 1.0)
    angle = 2.0 * np.pi * turn
    if dimension == 2:
        return np.stack([np.cos(angle), np.sin(angle)], axis=1)
    height = 2.0 * np.mod((i_c + 1) * 0.5698402909980532 + (j_c + 1) * 0.8191725133961645, 1.0) - 1.0
    across = np.sqrt(1.0 - height**2)
    return np.stack([across * np.cos(angle), across * np.sin(angle), height], axis=1)


@honors("links", packing_only=True, shaped="pm.find_shape_contacts", link_tolerance=ANY_LENGTH)
def find_contacts(packing: Packing, *, gap_tolerance: float | None = None) -> Contacts:
    """Return all touching pairs: gap <= gap_tolerance * (radius_i + radius_j), over every periodic image.

    Linked pairs at the link's image, and pairs within a rigid cluster, are no contacts.

    Parameters
    ----------
    packing
        The packing.
    gap_tolerance
        Largest gap relative to the contact distance [1] at which a pair counts; a negative one asks for overlap. None,
        as in all calls that count contacts or take their stiffness: the rounding of positions in a packing whose
        particles overlap, and 1e-9 in one where no overlap is larger than that: a crystal or an exact packing of hard
        particles at its touching point.

    Raises
    ------
    TypeError, ValueError
        If the packing is none or the tolerance is not finite or not above -1.

    Examples
    --------
    >>> from packmech.box import Box
    >>> packing = Packing([[0.0, 0.0]], [0.5], Box([[1.0, 0.5], [0.0, 0.75**0.5]]))
    >>> len(find_contacts(packing))
    3

    """
    instance("packing", packing, Packing)
    tolerance = gap_limit(gap_tolerance)
    scale = (1.0 + tolerance) * (1.0 + 1e-9)
    pairs = candidate_pairs(packing.position_nd, packing.radius_n, packing.box, scale=scale)
    contacts = pair_contacts(packing, *pairs)
    touching = contacts.gap_c <= tolerance * contacts.contact_distance_c
    if packing.links:
        touching &= ~Excluded(packing).mask(contacts.i_c, contacts.j_c, contacts.image_cd)
    if gap_tolerance is None:
        touching = overlapping_or_all(packing, contacts.gap_c, contacts.contact_distance_c, touching)
    return contacts.select(touching)


def gap_limit(gap_tolerance: float | None) -> float:
    """Return the largest gap, relative to the contact distance, at which a pair counts; see `find_contacts`."""
    return _ROUNDING if gap_tolerance is None else real("gap_tolerance", gap_tolerance, above=-1.0)


def overlapping_or_all(
    packing: Packing, gap_c: NDArray[np.float64], sigma_c: NDArray[np.float64], touching_c: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Return which touching pairs count where no tolerance is given: those that overlap to rounding, if any do."""
    if not (touching_c & (gap_c < -_ROUNDING * sigma_c)).any():
        return touching_c
    return np.asarray(touching_c & (gap_c <= _DIGITS * packing.rounding * packing.radius_n.min()))
