# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""The forces of single pairs at one time: of contacts and bonds, and which contacts slide."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.contacts.coulomb_limit import find_at_limit
from packmech.dynamics.bonds import bond_vector
from packmech.dynamics.deformation import rates
from packmech.dynamics.engine import Engine
from packmech.dynamics.observables import CONTACTS, LARGEST_FORCE, TOTAL, bond_forces, is_touching, measure_pair
from packmech.dynamics.pair_lists import listed_pairs
from packmech.dynamics.shape_pairs import measure_shapes
from packmech.jit.compiled import device, kernel, lean
from packmech.links import one_way
from packmech.measure.friction import friction_of


class PairForces(NamedTuple):
    """Every touching pair once, then every bond.

    i_k, j_k are particles; branch_kd (K, d) points from i to the image of j that is meant [length], force_kd (K, d) is
    the whole force on i, dashpots and friction included [force]; bonded_k marks the bonds.
    """

    i_k: NDArray[np.int64]
    j_k: NDArray[np.int64]
    force_kd: NDArray[np.float64]
    branch_kd: NDArray[np.float64]
    bonded_k: NDArray[np.bool_]

    def net(self, particles: int) -> NDArray[np.float64]:
        """Return the (N, d) sums of these forces on each particle [force]."""
        total = np.zeros((particles, self.force_kd.shape[1]))
        np.add.at(total, self.i_k, self.force_kd)
        np.subtract.at(total, self.j_k, self.force_kd)
        return total


def pair_forces(engine: Engine) -> PairForces:
    """Return the forces of contacts and bonds at the present time.

    Their sum of force times branch vector, over the volume, is the contact stress that `observe` reports; which of them
    reach a wall, or a particle, is for the caller to choose.
    """
    if not engine.started:
        engine.begin()
    d = len(engine.axes)
    bonds = 0 if engine.space.bonds is None else len(engine.space.bonds.i_b)
    capacity = len(engine.pairs.i_p) + bonds
    # rows, forces and branch vectors
    pair_list = row_k2, force, branch = (
        np.zeros((capacity, 2), dtype=np.int64),
        np.zeros((capacity, 3)),
        np.zeros((capacity, 3)),
    )
    count = 0
    if engine.acting.pairs is not None:
        count = _list_contacts(
            *(engine.acting.shapes, engine.acting, engine.axes, engine.state),
            *(engine.space, engine.pairs, engine.track, engine.pace),
            pair_list,
        )
    whole = _list_all_bonds(engine.axes, engine.state, engine.space, engine.pace, count, pair_list)
    order = engine.order_n
    return PairForces(
        order[row_k2[:whole, 0]],
        order[row_k2[:whole, 1]],
        force[:whole, :d],
        branch[:whole, :d],
        np.arange(whole) >= count,
    )


@device
def _write(pair_list, k, i, j, force, branch):
    row_k2, force_k3, branch_k3 = pair_list
    row_k2[k, 0], row_k2[k, 1] = i, j
    force_k3[k, 0], force_k3[k, 1], force_k3[k, 2] = force
    branch_k3[k, 0], branch_k3[k, 1], branch_k3[k, 2] = branch


@lean
def _list_contacts(shapes, acting, axes, state, space, pairs, track, pace, pair_list):
    """Write the touching pairs; return how many there are."""
    flowing = rates(space.flow)
    body = state.body
    stretch_pk = None if track is None else track.inner_pk
    count = 0
    for s in range(pairs.start_s.shape[0] - 1):
        for p in range(pairs.start_s[s], pairs.start_s[s + 1]):
            i, j = pairs.i_p[p], pairs.j_p[p]
            dx, dy, dz = body[j, 0] - body[i, 0], body[j, 1] - body[i, 1], 0.0
            if len(axes) == 3:
                dz = body[j, 2] - body[i, 2]
            if s % 2 == 1:
                k = pairs.image_p[p]
                dx += pairs.shift_kd[k, 0]
                dy += pairs.shift_kd[k, 1]
                dz += pairs.shift_kd[k, 2]
            if shapes is not None:
                touching, _, _, _, _, fx, fy, fz = measure_shapes(
                    shapes, acting.pairs, acting.friction, flowing, axes, body, stretch_pk, p, i, j, dx, dy, dz, pace
                )  # fmt: skip
                if touching:
                    _write(pair_list, count, i, j, (fx, fy, fz), (dx, dy, dz))
                    count += 1
                continue
            square = dx * dx + dy * dy + dz * dz
            # coincident centers push along no branch vector
            if square == 0.0 or not is_touching(body, i, j, dx, dy, dz):
                continue
            _, _, _, _, (gx, gy, gz), (fx, fy, fz), _, _ = measure_pair(
                acting.pairs, acting.friction, flowing, axes, body, stretch_pk, p, i, j, dx, dy, dz, pace
            )
            _write(pair_list, count, i, j, (gx + fx, gy + fy, gz + fz), (dx, dy, dz))
            count += 1
    return count


@device
def _list_bonds(bonds, flowing, axes, body, lattice, pace, first_k, pair_list):
    """Write the bonds behind what is there; return how many there are in all."""
    if bonds is None:
        return first_k
    k = first_k
    for b in range(bonds.i_b.shape[0]):
        i, j = bonds.i_b[b], bonds.j_b[b]
        dx, dy, dz = bond_vector(axes, body, bonds.image_bd, lattice, b, i, j)
        if dx * dx + dy * dy + dz * dz == 0.0:
            continue
        branch = dx, dy, dz
        _, _, (gx, gy, gz), (fx, fy, fz), _, _ = bond_forces(bonds, flowing, axes, body, pace, b, branch)
        _write(pair_list, k, i, j, (gx + fx, gy + fy, gz + fz), branch)
        k += 1
    return k


@kernel
def _list_all_bonds(axes, state, space, pace, first_k, pair_list):
    flowing = rates(space.flow)
    return _list_bonds(space.bonds, flowing, axes, state.body, space.frame.lattice_dd, pace, first_k, pair_list)


class Touching(NamedTuple):
    """Pairs that touch, bonded ones not among them, sorted by (i, j, image).

    i_c, j_c are particles, image_cd (C, d) vectors of the scene's box, for positions as they are: the branch vector is
    x_j - x_i + lattice @ image. normal_c are elastic normal forces, force_cd (C, d) the whole forces on i, dashpots and
    friction included [force]; sliding_c marks those at Coulomb's cap, of discs and spheres at rest those that
    `pm.contact_forces` counts there, too.
    """

    i_c: NDArray[np.int64]
    j_c: NDArray[np.int64]
    image_cd: NDArray[np.int64]
    normal_c: NDArray[np.float64]
    force_cd: NDArray[np.float64]
    sliding_c: NDArray[np.bool_]


@lean
def _measure_contacts(
    acting_shapes, acting, axes, state, space, pace, i_p, j_p, image_pd, stretch_pk, seen_p, figure_pk
):
    """Mark the pairs that touch; write normal force, sliding and force on i of each."""
    flowing = rates(space.flow)
    body, lattice = state.body, space.frame.lattice_dd
    for p in range(i_p.shape[0]):
        i, j = i_p[p], j_p[p]
        x, y, z = image_pd[p, 0], image_pd[p, 1], image_pd[p, 2]
        dx = body[j, 0] - body[i, 0] + (lattice[0, 0] * x + lattice[0, 1] * y + lattice[0, 2] * z)
        dy = body[j, 1] - body[i, 1] + (lattice[1, 0] * x + lattice[1, 1] * y + lattice[1, 2] * z)
        dz = body[j, 2] - body[i, 2] + (lattice[2, 0] * x + lattice[2, 1] * y + lattice[2, 2] * z)
        if acting_shapes is not None:
            touching, _, _, sliding, normal, fx, fy, fz = measure_shapes(
                acting_shapes, acting.pairs, acting.friction, flowing, axes, body, stretch_pk, p, i, j, dx, dy, dz, pace
            )
            seen_p[p] = touching > 0
            figure_pk[p, 0], figure_pk[p, 1] = normal, sliding
            figure_pk[p, 2], figure_pk[p, 3], figure_pk[p, 4] = fx, fy, fz
            continue
        seen_p[p] = is_touching(body, i, j, dx, dy, dz)
        if not seen_p[p]:
            continue
        _, _, sliding, normal, (gx, gy, gz), (fx, fy, fz), _, _ = measure_pair(
            acting.pairs, acting.friction, flowing, axes, body, stretch_pk, p, i, j, dx, dy, dz, pace
        )
        figure_pk[p, 0] = normal
        figure_pk[p, 1] = sliding
        # coincident centers have no direction
        away = 1.0 if dx * dx + dy * dy + dz * dz > 0.0 else 0.0
        figure_pk[p, 2] = away * (gx + fx)
        figure_pk[p, 3] = away * (gy + fy)
        figure_pk[p, 4] = away * (gz + fz)


def touching_of(engine: Engine) -> Touching:
    """Return the contacts at the present time."""
    if not engine.started:
        engine.begin()
    d = len(engine.axes)
    i, j, image = listed_pairs(engine.pairs)
    seen, figure = np.zeros(len(i), dtype=np.bool_), np.zeros((len(i), 5))
    if len(i) and engine.acting.pairs is not None:
        held = None if engine.track is None else engine.track.inner_pk
        _measure_contacts(
            engine.acting.shapes,
            engine.acting,
            engine.axes,
            engine.state,
            engine.space,
            engine.pace,
            i,
            j,
            image.astype(float),
            held,
            seen,
            figure,
        )
    i, j, image, figure = engine.order_n[i[seen]], engine.order_n[j[seen]], image[seen, :d], figure[seen]
    # from rows and images of the loops' lattice to particles, their places and the scene's box
    whole = image @ engine.change_dd.T - engine.wrap_nd[j] + engine.wrap_nd[i]
    force = figure[:, 2 : 2 + d]
    i, j, whole, turned = one_way(i, j, whole)
    force = np.where(turned[:, None], -force, force)
    order = np.lexsort((*whole.T[::-1], j, i))
    found = Touching(i[order], j[order], whole[order], figure[order, 0], force[order], figure[order, 1] > 0.0)
    return found._replace(sliding_c=found.sliding_c | _stands_at_limit(engine, found))


def _stands_at_limit(engine: Engine, found: Touching) -> NDArray[np.bool_]:
    """Return the (C,) contacts of discs and spheres that stand at the Coulomb limit, as well as they are at rest."""
    friction = friction_of(engine.scene)
    if friction is None or engine.acting.shapes is not None or not len(found.i_c):
        return np.zeros(len(found.i_c), dtype=bool)
    row, place = engine.observe(), engine.positions()
    branch = place[found.j_c] - place[found.i_c] + found.image_cd @ engine.box().lattice_dd.T
    length = np.sqrt((branch**2).sum(axis=1))
    normal = branch / np.where(length > 0.0, length, 1.0)[:, None]
    tangential = found.force_cd - (found.force_cd * normal).sum(axis=1)[:, None] * normal
    mean = row[TOTAL] / max(row[CONTACTS], 1.0)
    residual = float(row[LARGEST_FORCE] / mean) if mean > 0.0 else math.inf
    size = np.sqrt((tangential**2).sum(axis=1))
    return find_at_limit(size, found.normal_c, friction.coefficient, residual).at_limit_c
