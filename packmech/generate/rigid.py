"""Rigid bodies made of discs or spheres: their centers of mass, radii and moments of inertia."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.calls.honors import honors
from packmech.calls.status import shown_as
from packmech.check import instance, integer_array
from packmech.contacts.fused_volume import union_moments
from packmech.links import image_offsets
from packmech.packing import Packing
from packmech.shapes import Beads

# components of places smaller than this, relative to the body's radius, have no sign
_NO_SIDE = 1e-6


class UnionBody(NamedTuple):
    """Center of mass and radius of a union, its axes in columns, beads and radii of gyration as `Beads` has them."""

    center_d: NDArray[np.float64]
    radius: float
    frame_dd: NDArray[np.float64]
    offset_bd: NDArray[np.float64]
    size_b: NDArray[np.float64]
    gyration_k: NDArray[np.float64]


def body_of(position_bd: NDArray[np.float64], radius_b: NDArray[np.float64]) -> UnionBody:
    """Return the rigid body that is the union of discs or spheres, of even density; its axes are the principal ones."""
    d = position_bd.shape[1]
    turns = 1 if d == 2 else 3
    if len(radius_b) == 1:
        gyration = np.full(turns, math.sqrt(0.5 if d == 2 else 0.4))
        return UnionBody(position_bd[0], float(radius_b[0]), np.eye(d), np.zeros((1, d)), np.ones(1), gyration)
    volume, center, second = union_moments(position_bd - position_bd[0], radius_b)
    center = center + position_bd[0]
    radius = math.sqrt(volume / math.pi) if d == 2 else (0.75 * volume / math.pi) ** (1.0 / 3.0)
    spread, frame = np.linalg.eigh(second)
    # the longest axis first; beads that come first stand on positive sides, as far as a right-handed frame lets them
    spread, frame = spread[::-1], frame[:, ::-1]
    for k in range(d - 1):
        along = (position_bd - center) @ frame[:, k] / radius
        side = along[np.abs(along) > _NO_SIDE]
        if len(side) and side[0] < 0.0:
            frame[:, k] *= -1.0
    frame[:, -1] *= np.sign(np.linalg.det(frame))
    gyration = np.sqrt([spread.sum()] if d == 2 else spread.sum() - spread)
    offset = (position_bd - center) @ frame / radius
    return UnionBody(center, radius, frame, offset, radius_b / radius, gyration / radius)


def beads_of(bodies: list[UnionBody], orientation_nq: NDArray[np.float64]) -> Beads:
    """Return the shapes of bodies with given orientations."""
    start = np.concatenate([[0], np.cumsum([len(one.size_b) for one in bodies])])
    return Beads(
        start,
        np.concatenate([one.offset_bd for one in bodies]),
        np.concatenate([one.size_b for one in bodies]),
        np.array([one.gyration_k for one in bodies]),
        orientation_nq,
    )


def orientation_of(frame_dd: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the direction, or the quaternion, of a frame."""
    if len(frame_dd) == 2:
        return np.asarray(frame_dd[:, 0])
    # the largest of the four components is taken from the diagonal, the others from it and sums of the rest
    xx, yy, zz = np.diag(frame_dd)
    found = np.array([1.0 + xx + yy + zz, 1.0 + xx - yy - zz, 1.0 - xx + yy - zz, 1.0 - xx - yy + zz])
    k = int(found.argmax())
    odd = frame_dd - frame_dd.T
    even = frame_dd + frame_dd.T
    rows = [
        [found[0], odd[2, 1], odd[0, 2], odd[1, 0]],
        [odd[2, 1], found[1], even[0, 1], even[0, 2]],
        [odd[0, 2], even[0, 1], found[2], even[1, 2]],
        [odd[1, 0], even[0, 2], even[1, 2], found[3]],
    ]
    return np.asarray(rows[k]) / (2.0 * math.sqrt(found[k]))


@shown_as("placing bodies")
@honors("links", packing_only=True)
def rigid_packing(packing: Packing, body_n: ArrayLike | None = None) -> Packing:
    """Return the packing whose particles are rigid bodies of discs or spheres: dimers, n-mers, any union of them.

    Where links hold clusters only approximately or not at all, as rows of three beads or more, bodies are exactly
    rigid. A body's place is the center of mass of its union, of even density, its radius that of the disc or sphere of
    equal area or volume, its mass the sum of those of its beads where they were given, and its kind that of its beads.

    Parameters
    ----------
    packing
        Discs or spheres, which may overlap within a body. Beads of a body lie where they are given, not at images of
        that, but for linked ones, which lie at the links' images.
    body_n
        (N,) number of the body of each disc or sphere, 0, 1, 2, and so on; the clusters of the links when left out.

    Raises
    ------
    TypeError, ValueError
        If the packing is none or has shapes, bodies are not numbered so, or have beads of several kinds, or there are
        neither numbers nor links.

    Examples
    --------
    >>> import packmech as pm
    >>> row = pm.Packing([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]], [0.5] * 3, pm.Box.cubic(6.0, 2))
    >>> body = pm.rigid_packing(row, [0, 0, 0])
    >>> body.position_nd.tolist(), body.shapes.turn_basis(body.radius_n).shape
    ([[1.0, 0.0]], (1, 1, 1))

    """
    instance("packing", packing, Packing)
    if packing.shapes.has_orientations:
        raise ValueError(f"packing must be one of discs or spheres, got {type(packing.shapes).__name__}")
    links = packing.links
    position = packing.position_nd + image_offsets(links, packing.particles)[0] @ packing.box.lattice_dd.T
    if body_n is None:
        if not len(links):
            raise ValueError("body_n must be given for a packing without links, got None")
        cluster = links.clusters(packing.particles)
        body = np.unique(cluster, return_inverse=True)[1]
    else:
        body = integer_array("body_n", body_n, shape=(packing.particles,))
        missing = np.setdiff1d(np.arange(body.max(initial=0) + 1), body)
        if body.min(initial=0) < 0 or len(missing):
            raise ValueError(f"body_n must number bodies 0, 1, 2, and so on, got {sorted(set(body.tolist()))}")
    members = np.split(np.argsort(body, kind="stable"), np.cumsum(np.bincount(body))[:-1])
    bodies = [body_of(position[mine], packing.radius_n[mine]) for mine in members]
    orientation = np.array([orientation_of(one.frame_dd) for one in bodies])
    given, kind_n = packing.given_mass_n, packing.kind_n
    if kind_n is not None:
        kind_n, bead_kind = kind_n[[mine[0] for mine in members]], kind_n
        mixed = np.flatnonzero(bead_kind != kind_n[body])
        if len(mixed):
            n = int(mixed[0])
            raise ValueError(
                f"packing must have bodies whose beads are of one kind, got kinds {kind_n[body[n]]} and {bead_kind[n]} "
                f"in body {body[n]}"
            )
    return Packing(
        np.array([one.center_d for one in bodies]),
        np.array([one.radius for one in bodies]),
        packing.box,
        mass_n=None if given is None else np.bincount(body, given),
        shapes=beads_of(bodies, orientation),
        kind_n=kind_n,
    )


@honors("shapes", packing_only=True)
def bead_packing(packing: Packing) -> Packing:
    """Return the discs or spheres that a packing of rigid bodies consists of, as a packing of them alone.

    Their order is that of ``packing.shapes``: those of body n from ``start_n[n]`` on. They have its kind. Nothing holds
    them together in it: it is there to be drawn, written and counted.

    Parameters
    ----------
    packing
        A packing with `Beads`.

    Raises
    ------
    TypeError, ValueError
        If it is none, or one of other shapes.

    Examples
    --------
    >>> import packmech as pm
    >>> two = pm.Packing([[0.0, 0.0], [1.0, 0.0]], [0.5, 0.5], pm.Box.cubic(6.0, 2))
    >>> bead_packing(pm.rigid_packing(two, [0, 0])).position_nd.round(12).tolist()
    [[0.0, 0.0], [1.0, 0.0]]

    """
    instance("packing", packing, Packing)
    shapes = packing.shapes
    if not isinstance(shapes, Beads):
        raise ValueError(f"packing must be one of rigid bodies (pm.Beads), got {type(shapes).__name__}")
    place = packing.position_nd[shapes.particle_b] + shapes.arms(packing.radius_n)
    kind_n = None if packing.kind_n is None else packing.kind_n[shapes.particle_b]
    return Packing(place, shapes.site_radius(packing.radius_n), packing.box, kind_n=kind_n)
