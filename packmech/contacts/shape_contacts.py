"""Contacts of particles with shapes: one distance each, with its slopes and curvatures along the pair's coordinates.

Every law of spheroids and superellipsoids is taken at rho = s (r_i + r_j), s the scale at which the two shapes touch,
with the contact distance r_i + r_j: they overlap where rho is smaller. Of rigid bodies, each pair of beads has a
contact of its own, at the beads' distance and with the sum of their radii. Coordinates of a pair are the vector from
center i to center j and the rotations of i and of j, angles in a plane and rotation vectors in space.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.calls.display import shown
from packmech.calls.honors import honors
from packmech.check import boolean, chosen_rows, instance, particle_mask
from packmech.contacts.bead_contact import bead_contacts, turned_arms
from packmech.contacts.elements import normal_slopes
from packmech.contacts.gauge_contact import gauge_contacts
from packmech.contacts.network import (
    Candidates,
    Contacts,
    candidate_pairs,
    effective_radius,
    find_contacts,
    gap_limit,
    kinds_of_pairs,
    overlapping_or_all,
)
from packmech.contacts.scaled_contact import scaled_contacts
from packmech.packing import Packing
from packmech.shapes import Beads, Shapes, Spheroids, Superellipsoids

# changes of coordinates below this, relative to contact distances, change rho by less than its rounding shows
_SMALL = 1e-5

# (C,) distances, (C, X) slopes, and (C, X, X) curvatures or none
_Distances = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]


@shown(lambda one: f"{len(one)} contacts of {one.particles} particles")
@dataclass(frozen=True, eq=False)
class ShapeContacts:
    """Pairs of particles with shapes, or of their beads, each physical pair once, sorted by (i, j) and their sites.

    Attributes
    ----------
    i_c, j_c, image_cd, distance_c, contact_distance_c, kinds_c, particles, dimension
        As in `Contacts`, distances those at which laws are taken.
    site_i_c, site_j_c
        (C,) beads that touch, as the shapes number them; of other shapes the particles again.
    vector_cd
        (C, d) vectors from center i to center j [length].
    slope_cx
        (C, X) slopes of the distance along the vector and the rotations of i and j [1], [length]; X = 4 in a plane and
        9 in space.
    curvature_cxx
        (C, X, X) second derivatives of the distance; none where they were not asked for.
    radius_n, shapes
        (N,) radii of the particles [length], and their shapes, as they are turned.

    """

    i_c: NDArray[np.int64]
    j_c: NDArray[np.int64]
    image_cd: NDArray[np.int64]
    vector_cd: NDArray[np.float64]
    distance_c: NDArray[np.float64]
    contact_distance_c: NDArray[np.float64]
    kinds_c: NDArray[np.int64]
    slope_cx: NDArray[np.float64]
    curvature_cxx: NDArray[np.float64]
    site_i_c: NDArray[np.int64]
    site_j_c: NDArray[np.int64]
    particles: int
    dimension: int
    radius_n: NDArray[np.float64]
    shapes: Shapes

    def __len__(self) -> int:
        return len(self.i_c)

    @property
    def gap_c(self) -> NDArray[np.float64]:
        """The (C,) distances less contact distances, negative where particles overlap [length]."""
        return self.distance_c - self.contact_distance_c

    @property
    def overlap_c(self) -> NDArray[np.float64]:
        """The (C,) relative overlaps 1 - s [1]."""
        return 1.0 - self.distance_c / self.contact_distance_c

    @property
    def effective_radius_c(self) -> NDArray[np.float64]:
        """The (C,) values of r_i r_j / (r_i + r_j) of the beads that touch [length]; nan of other shapes."""
        if not self.shapes.has_beads:
            return np.full(len(self), np.nan)
        radius_b = self.shapes.site_radius(self.radius_n)
        return np.asarray(effective_radius(radius_b[self.site_i_c], radius_b[self.site_j_c]))

    @property
    def push_c(self) -> NDArray[np.float64]:
        """The (C,) sizes of a force of a contact over du/drho [1]."""
        return np.asarray(np.sqrt((self.slope_cx[:, : self.dimension] ** 2).sum(axis=1)))

    @functools.cached_property
    def turn_nkt(self) -> NDArray[np.float64]:
        """The (N, K, t) rotations that one length of each coordinate of turns makes."""
        # a network of no particles keeps the shapes of its packing
        return self.shapes.turn_basis(self.radius_n)[: self.particles]

    @property
    def normal_cd(self) -> NDArray[np.float64]:
        """The (C, d) unit vectors along which contacts push, from i to j [1]."""
        return np.asarray(self.slope_cx[:, : self.dimension] / self.push_c[:, None])

    @property
    def bead_c2(self) -> NDArray[np.int64] | None:
        """The (C, 2) beads of i and of j that touch, counted from 0 in each; None where particles have no beads."""
        if not self.shapes.has_beads:
            return None
        start = self.shapes.start_n
        return np.stack([self.site_i_c - start[self.i_c], self.site_j_c - start[self.j_c]], axis=1)

    def points(self, radius_n: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (C, d) vectors from center i to the point of contact [length].

        Sites touch when both are scaled by s = rho / sigma: at s A n / g from their centers, A their matrix of squared
        semi-axes, g = sqrt(n A n), where they are spheroids. Of superellipsoids the part across the normal is what the
        slopes along turns say, which are exact where faces are flat, too.
        """
        if not len(self):
            return np.zeros((0, self.dimension))
        if not self.shapes.has_spheroid_sites:
            d, normal = self.dimension, self.normal_cd
            reach = (1.0 - self.overlap_c) * (self._support(radius_n)[0] * normal).sum(axis=1)
            turn, push = self.slope_cx[:, d : (self.slope_cx.shape[1] + d) // 2], self.push_c[:, None]
            across = turn * turned_arms(normal)[:, :, 0] if d == 2 else np.cross(turn, normal)
            return np.asarray(reach[:, None] * normal + across / push)
        arm = self.shapes.arms(radius_n)[self.site_i_c]
        return np.asarray(arm + (1.0 - self.overlap_c)[:, None] * self._support(radius_n)[0])

    def point_slopes(self, radius_n: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (C, d, X) derivatives of these by the pairs' coordinates; curvatures are needed."""
        d = self.dimension
        own = slice(d, (self.slope_cx.shape[1] + d) // 2)
        point, bend = self._support(radius_n)
        scale, normal = (1.0 - self.overlap_c)[:, None, None], self.normal_cd
        # the point turns with the shape, and moves on it as the normal turns against the shape
        slope = bend @ normal_slopes(self)
        slope[:, :, own] += turned_arms(point) - bend @ turned_arms(normal)
        slope = scale * slope + point[:, :, None] * (self.slope_cx / self.contact_distance_c[:, None])[:, None]
        slope[:, :, own] += turned_arms(self.shapes.arms(radius_n)[self.site_i_c])
        return np.asarray(slope)

    def _support(self, radius_n: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (C, d) points p = A n / g of the sites i where n is their normal, and (C, d, d) dp/dn."""
        if not self.shapes.has_spheroid_sites:
            d = self.dimension
            if not len(self):
                return np.zeros((0, d)), np.zeros((0, d, d))
            shapes: Any = self.shapes.select(self.site_i_c)
            own = self.normal_cd, radius_n[self.site_i_c]
            return shapes.surface_points(*own), shapes.surface_bends(*own)
        along, across = (one[self.site_i_c] ** 2 for one in self.shapes.semi_axes(radius_n))
        director, normal = self.shapes.axis_bd[self.site_i_c], self.normal_cd
        matrix = (along - across)[:, None, None] * director[:, :, None] * director[:, None, :]
        matrix += across[:, None, None] * np.eye(self.dimension)
        point = np.einsum("cab,cb->ca", matrix, normal)
        size = np.sqrt((point * normal).sum(axis=1))
        point /= size[:, None]
        return point, (matrix - point[:, :, None] * point[:, None, :]) / size[:, None, None]

    @property
    def pairs(self) -> Candidates:
        """The pairs of sites, as `shape_contacts` takes them."""
        return Candidates(self.site_i_c, self.site_j_c, self.image_cd)

    def at(self, packing: Packing) -> ShapeContacts:
        """Return the same pairs of sites where another packing of the same particles is, touching or not."""
        instance("packing", packing, Packing)
        return shape_contacts(packing, self.pairs)

    def among(self, kept_n: NDArray[np.bool_]) -> ShapeContacts:
        """Return the contacts both of whose particles are among the (N,) named ones."""
        kept = particle_mask("kept_n", kept_n, self.particles)
        return self.select(kept[self.i_c] & kept[self.j_c])

    def select(self, keep_c: ArrayLike) -> ShapeContacts:
        """Return the contacts that a boolean mask or an index array names, in their order."""
        keep = chosen_rows("keep_c", keep_c, len(self))
        lengths = ("vector_cd", "distance_c", "contact_distance_c", "kinds_c", "slope_cx")
        names = ("i_c", "j_c", "image_cd", "site_i_c", "site_j_c", *lengths)
        parts = {name: getattr(self, name)[keep] for name in names}
        curvature = self.curvature_cxx[keep] if len(self.curvature_cxx) else self.curvature_cxx
        return replace(self, **parts, curvature_cxx=curvature)

    def numbered(self, number_n: NDArray[np.int64], packing: Packing) -> ShapeContacts:
        """Return the contacts between the particles of another packing, by their new numbers."""
        i, j = number_n[self.i_c], number_n[self.j_c]
        start, now = self.shapes.start_n, packing.shapes.start_n
        site_i = self.site_i_c - start[self.i_c] + now[i]
        site_j = self.site_j_c - start[self.j_c] + now[j]
        return replace(
            self, i_c=i, j_c=j, site_i_c=site_i, site_j_c=site_j,
            particles=int(number_n.max(initial=-1)) + 1, radius_n=packing.radius_n, shapes=packing.shapes,
        )  # fmt: skip

    def count_n(self) -> NDArray[np.int64]:
        """Return the (N,) number of contacts of each particle; a self-image counts twice, once for each side."""
        return np.bincount(np.concatenate([self.i_c, self.j_c]), minlength=self.particles)

    def distance_change(self, start: ShapeContacts) -> NDArray[np.float64]:
        """Return the (C,) changes of the distances of the same pairs since the start.

        Where coordinates changed by little, from the slopes at both ends: in the difference of the distances they would
        be lost to rounding.
        """
        rotation_nt = self.shapes.rotation_since(start.shapes)
        moved = np.hstack([self.vector_cd - start.vector_cd, rotation_nt[self.i_c], rotation_nt[self.j_c]])
        scaled = moved.copy()
        scaled[:, : self.dimension] /= self.contact_distance_c[:, None]
        along = 0.5 * ((start.slope_cx + self.slope_cx) * moved).sum(axis=1)
        return np.where(np.abs(scaled).max(axis=1) < _SMALL, along, self.distance_c - start.distance_c)


def candidate_sites(packing: Packing, scale: float = 1.0, skin: float = 0.0) -> Candidates:
    """Return the pairs of sites that touch when shapes, or beads, are grown by scale and skin, and perhaps some more.

    Sites are particles, in whose surrounding discs or spheres their shapes are, or beads of different bodies.
    """
    bodies, radius = packing.shapes, packing.radius_n
    owner, reach = bodies.particle_b, bodies.site_reach(radius)
    place = packing.position_nd[owner] + bodies.arms(radius)
    found = candidate_pairs(place, reach, packing.box, scale=scale, skin=skin)
    if not bodies.has_beads:
        return found
    i, j = owner[found.i_c], owner[found.j_c]
    other = (i != j) | found.image_cd.any(axis=1)
    order = np.flatnonzero(other)[np.lexsort((j[other], i[other]))]
    return Candidates(*(part[order] for part in found))


def shape_contacts(packing: Packing, pairs: Candidates, *, second: bool = False) -> ShapeContacts:
    """Return the geometry of the given pairs of sites, touching or not.

    Parameters
    ----------
    packing
        The packing, with shapes.
    pairs
        Pairs of sites, and images.
    second
        Whether curvatures are asked for.

    Raises
    ------
    ValueError
        If two centers, or of rigid bodies two beads, coincide: which way they part there is not defined.

    """
    shapes = packing.shapes
    owner, arm, size = shapes.particle_b, shapes.arms(packing.radius_n), shapes.site_radius(packing.radius_n)
    i, j = owner[pairs.i_c], owner[pairs.j_c]
    vector = packing.position_nd[j] - packing.position_nd[i] + pairs.image_cd @ packing.box.lattice_dd.T
    sigma = size[pairs.i_c] + size[pairs.j_c]
    apart = vector + arm[pairs.j_c] - arm[pairs.i_c]
    _check_apart("beads" if shapes.has_beads else "particles", apart, pairs.i_c, pairs.j_c)
    distance, first, curvature = _MEASURES[type(shapes)](packing, pairs, apart, second)
    return ShapeContacts(
        i, j, pairs.image_cd, vector, distance, sigma, kinds_of_pairs(packing, i, j), first, curvature,
        pairs.i_c, pairs.j_c, packing.particles, packing.dimension, packing.radius_n, shapes,
    )  # fmt: skip


def _between_beads(packing: Packing, pairs: Candidates, apart_cd: NDArray[np.float64], second: bool) -> _Distances:
    """Return distances of beads that are so far apart, with slopes and curvatures."""
    arm = packing.shapes.arms(packing.radius_n)
    return bead_contacts(apart_cd, arm[pairs.i_c], arm[pairs.j_c], second=second)


def _between_spheroids(packing: Packing, pairs: Candidates, apart_cd: NDArray[np.float64], second: bool) -> _Distances:
    """Return rho of ellipses or spheroids, with slopes and curvatures."""
    arrays = packing.shapes.arrays()
    radius, aspect, director = (_both(one, pairs) for one in (packing.radius_n, *arrays.values()))
    found = scaled_contacts(apart_cd, radius, aspect, director, second=second)
    return _scaled(found.scale_p, found.first_px, found.second_pxx, radius.sum(axis=1))


def _between_superellipsoids(
    packing: Packing, pairs: Candidates, apart_cd: NDArray[np.float64], second: bool
) -> _Distances:
    """Return rho of superellipses or superellipsoids, with slopes and curvatures."""
    shapes: Any = packing.shapes
    own = packing.radius_n, shapes.axes(packing.radius_n), shapes.exponent_n, shapes.frames()
    radius, semi, exponent, frame = (_both(one, pairs) for one in own)
    found = gauge_contacts(apart_cd, semi, exponent, frame, second=second)
    return _scaled(found.scale_p, found.first_px, found.second_pxx, radius.sum(axis=1))


def _both(array_n: NDArray[np.float64], pairs: Candidates) -> NDArray[np.float64]:
    """Return what particles i and j have, side by side."""
    return np.stack([array_n[pairs.i_c], array_n[pairs.j_c]], axis=1)


def _scaled(
    scale_c: NDArray[np.float64],
    first_cx: NDArray[np.float64],
    second_cxx: NDArray[np.float64],
    sigma_c: NDArray[np.float64],
) -> _Distances:
    """Return rho = s sigma of scales at which shapes touch, with slopes and curvatures."""
    return scale_c * sigma_c, first_cx * sigma_c[:, None], second_cxx * sigma_c[: len(second_cxx), None, None]


# how the distances of each kind of shape are measured
_MEASURES: dict[type, Callable[[Packing, Candidates, NDArray[np.float64], bool], _Distances]] = {
    Beads: _between_beads,
    Spheroids: _between_spheroids,
    Superellipsoids: _between_superellipsoids,
}


def _check_apart(what: str, vector_cd: NDArray[np.float64], i_c: NDArray[np.int64], j_c: NDArray[np.int64]) -> None:
    same = ~vector_cd.any(axis=1)
    if same.any():
        c = int(np.argmax(same))
        raise ValueError(f"packing must have no coincident centers, got {what} {i_c[c]} and {j_c[c]} at one place")


@honors("shapes", packing_only=True)
def find_shape_contacts(packing: Packing, *, gap_tolerance: float | None = None, second: bool = False) -> ShapeContacts:
    """Return all touching pairs of a packing with shapes, over every periodic image, their own among them.

    Parameters
    ----------
    packing
        The packing, with shapes.
    gap_tolerance
        As in `find_contacts`, for gaps 1 - s between shapes: relative to the sum of radii [1].
    second
        Whether the curvatures of the distances are asked for, too.

    Raises
    ------
    TypeError, ValueError
        If the packing is none, has no shapes, or the tolerance is not what it must be.

    Examples
    --------
    >>> import packmech as pm
    >>> shapes = pm.Spheroids([4.0, 4.0], [[1.0, 0.0], [0.0, 1.0]])
    >>> packing = pm.Packing([[0.0, 0.0], [1.2, 0.0]], [0.5, 0.5], pm.Box.cubic(6.0, 2), shapes=shapes)
    >>> contacts = pm.find_shape_contacts(packing)
    >>> len(contacts), round(float(contacts.distance_c[0]), 12)
    (1, 0.96)

    """
    instance("packing", packing, Packing)
    if not packing.shapes.has_orientations:
        raise ValueError("packing must have shapes, got one of discs or spheres: ask pm.find_contacts")
    boolean("second", second)
    tolerance = gap_limit(gap_tolerance)
    pairs = candidate_sites(packing, (1.0 + tolerance) * (1.0 + 1e-9))
    near = shape_contacts(packing, pairs)
    touching = near.gap_c <= tolerance * near.contact_distance_c
    if gap_tolerance is None:
        touching = overlapping_or_all(packing, near.gap_c, near.contact_distance_c, touching)
    if not second:
        return near.select(touching)
    return shape_contacts(packing, Candidates(*(part[touching] for part in pairs)), second=True)


def touching_pairs(
    packing: Packing, gap_tolerance: float | None = 0.0, *, second: bool = False
) -> Contacts | ShapeContacts:
    """Return the touching pairs of a packing with shapes or without, arguments as of `find_shape_contacts`."""
    if packing.shapes.has_orientations:
        return find_shape_contacts(packing, gap_tolerance=gap_tolerance, second=second)
    return find_contacts(packing, gap_tolerance=gap_tolerance)
