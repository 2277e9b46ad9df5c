"""Contacts with tangential springs as elements: friction, and what bonds and dashpots do across their directions.

A contact of normal n, whose point lies at a from center i and at b = a - v from center j, v the vector between the
centers, has a normal force along n and a tangential one T across it. It acts at that point, so that its pull along the
coordinates xi of the pair (the vector and the rotations p of i and q of j) is that of the motion of the point's two
sides against each other,

    carry               dv - p x a + q x b
    slip                ds = (1 - n n) carry
    pull                u' slope + carry^T T
    tangential force    dT = k ds + mu dN T/|T| - n (T.dn) + (n x T) n.(p + q)/2       T = k s

as the spring grows by the slip and turns with the contact. Where a contact sticks there is no term with mu; where it
slides k acts across T only, which in the plane is nowhere. What discs, spheroids and beads differ in are their slopes
and curvatures, which give n and dn, and their points of contact with the derivatives of these.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from packmech.check import Kind
from packmech.contacts.bead_contact import turned_arms
from packmech.contacts.elements import Elements, PairGeometry, check_centers, normal_slopes


def tangential_elements(
    pairs: PairGeometry,
    radius_n: NDArray[np.float64],
    first_c: NDArray[np.float64],
    second_c: NDArray[np.float64],
    tangential_cd: NDArray[np.float64],
    stiffness: float | NDArray[np.float64],
    coefficient: float | NDArray[np.float64] = 0.0,
    sliding_c: NDArray[np.bool_] | None = None,
    kind: Kind = "exact",
) -> tuple[Elements, NDArray[np.float64]]:
    """Return pairs with tangential springs as elements, and (C, X) derivatives of what passes mu N, X = d + 2 t.

    Contacts with friction, bonds, and with rates in place of displacements dashpots. The derivatives are those of the
    force of a spring that sticks, along the tangential force, less those of the limit. Torques are about axes that do
    not turn with the particles: their derivatives by rotations are symmetric only where torques balance.

    Parameters
    ----------
    pairs
        The pairs, with curvatures.
    radius_n
        (N,) radii of the particles [length].
    first_c, second_c
        (C,) derivatives of the pair energies by the distances [force], [force/length].
    tangential_cd
        (C, d) tangential forces on particle i [force].
    stiffness
        Of the tangential springs, a number or (C,) [force/length].
    coefficient
        Coulomb's, where contacts slide [1].
    sliding_c
        (C,) which contacts slide; none unless given.
    kind
        "exact", or "unstressed": what forces add where contacts turn is left out.

    Raises
    ------
    ValueError
        If centers coincide.

    """
    check_centers(pairs, np.ones_like(first_c))
    d, n = pairs.dimension, pairs.normal_cd
    t = 1 if d == 2 else 3
    of_i, of_j = slice(d, d + t), slice(d + t, d + 2 * t)
    slope, curvature = _with_rotations(pairs.slope_cx, t), _with_rotations(pairs.curvature_cxx, t)
    turning = _with_rotations(normal_slopes(pairs), t, axes=1)
    point, point_slope = pairs.points(radius_n), pairs.point_slopes(radius_n)
    other, other_slope = pairs.vector_cd - point, -point_slope
    other_slope[:, :, :d] += np.eye(d)
    carry = _carry(point, other)
    slip = _across(n, carry)
    size = np.sqrt((tangential_cd**2).sum(axis=1))
    ahead = tangential_cd / np.where(size > 0.0, size, 1.0)[:, None]
    along = np.zeros_like(ahead) if sliding_c is None else np.where(sliding_c[:, None], ahead, 0.0)
    # without forces contacts turn for nothing
    pull, push = (tangential_cd, first_c) if kind != "unstressed" else (0.0 * tangential_cd, 0.0 * first_c)
    # the limit follows the size of the normal force
    bent = np.einsum("ca,cax->cx", n, _with_rotations(pairs.curvature_cxx[:, :d], t, axes=1))
    normal = (second_c * pairs.push_c)[:, None] * slope + push[:, None] * bent
    limit = np.broadcast_to(coefficient, len(n))[:, None] * np.sign(first_c)[:, None] * normal
    spring = np.broadcast_to(stiffness, len(n))[:, None]
    change = spring[:, None] * (slip - along[:, :, None] * np.einsum("ca,cax->cx", along, slip)[:, None])
    change += along[:, :, None] * limit[:, None] - n[:, :, None] * np.einsum("ca,cax->cx", pull, turning)[:, None]
    if d == 3:
        # the contact turns about its normal at the mean of both rotations
        about = 0.5 * np.cross(n, pull)[:, :, None] * n[:, None]
        change[:, :, of_i] += about
        change[:, :, of_j] += about
    whole = second_c[:, None, None] * slope[:, :, None] * slope[:, None] + push[:, None, None] * curvature
    whole += carry.transpose(0, 2, 1) @ change
    # the force stays while its point moves
    moment = turned_arms(pull).transpose(0, 2, 1)
    for own, moved in ((of_i, point_slope), (of_j, other_slope)):
        whole[:, own] += moment @ moved
        if d == 3:
            # curvatures are by rotation vectors, whose torques turn by half the rotation
            whole[:, own, own] += 0.5 * turned_arms(push[:, None] * slope[:, own])
    slopes = push[:, None] * slope + np.einsum("ca,cax->cx", pull, carry)
    beyond = spring * np.einsum("ca,cax->cx", ahead, slip) - limit
    return Elements(pairs.i_c, pairs.j_c, pairs.vector_cd, slopes, whole, symmetric=False), beyond


def _carry(point_cd: NDArray[np.float64], other_cd: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (C, d, X) how a point's side on j moves against that on i; arms are from the centers of i and j."""
    d = point_cd.shape[1]
    fixed = np.broadcast_to(np.eye(d), (len(point_cd), d, d))
    return np.concatenate([fixed, -turned_arms(point_cd), -turned_arms(other_cd)], axis=2)


def _across(normal_cd: NDArray[np.float64], slope_cdx: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the part across the normal."""
    return np.asarray(slope_cdx - normal_cd[:, :, None] * np.einsum("ca,cax->cx", normal_cd, slope_cdx)[:, None])


def slip_slopes(pairs: PairGeometry, radius_n: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (C, d, X) derivatives of the slip at contacts by the pairs' coordinates, X = d + 2 t.

    Parameters
    ----------
    pairs
        The pairs.
    radius_n
        (N,) radii of the particles [length].

    """
    point = pairs.points(radius_n)
    return _across(pairs.normal_cd, _carry(point, pairs.vector_cd - point))


def _with_rotations(array: NDArray[np.float64], t: int, axes: int | None = None) -> NDArray[np.float64]:
    """Return derivatives along vectors, on the last so many axes (all but the first), with those by rotations added.

    What has them already stays as it is.
    """
    count = array.ndim - 1 if axes is None else axes
    size = (2 if t == 1 else 3) + 2 * t
    after = [(0, 0)] * (array.ndim - count) + [(0, size - array.shape[-1])] * count
    return np.pad(array, after) if array.shape[-1] < size else array
