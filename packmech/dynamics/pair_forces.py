# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""The forces of single pairs at one time: of contacts and bonds, and which contacts slide."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.contacts.coulomb_limit import find_at_limit
from packmech.contacts.network import effective_radius, kinds_of_pairs
from packmech.dynamics.bonds import bond_vector, pull_of_bond
from packmech.dynamics.contact_forces import laws_of
from packmech.dynamics.contact_records import record_contacts
from packmech.dynamics.engine import Engine
from packmech.dynamics.observables import CONTACTS, LARGEST_FORCE, TOTAL
from packmech.effects import ContactLengths, friction_of, under_cap
from packmech.effects.kinds import number_at
from packmech.jit.compiled import lean
from packmech.links import one_way
from packmech.minimize.passes.pair_list import listed_pairs


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
    system, d = engine.system, len(engine.axes)
    found = record_contacts(system, engine.now)
    touching = np.flatnonzero(found.touching_p)
    i, j, _ = listed_pairs(engine.pairs)
    i, j, force, branch = i[touching], j[touching], found.force_pd[touching], found.branch_pd[touching]
    contacts, bonds = len(i), engine.space.bonds
    if bonds is not None:
        of_bond, along_bond = np.zeros((2, len(bonds.i_b), 3))
        lattice_dd = engine.space.frame.lattice_dd
        _measure_bonds(laws_of(system, engine.now), bonds, lattice_dd, of_bond, along_bond)
        i, j = np.concatenate([i, bonds.i_b]), np.concatenate([j, bonds.j_b])
        force, branch = np.concatenate([force, of_bond]), np.concatenate([branch, along_bond])
    order = engine.order_n
    return PairForces(order[i], order[j], force[:, :d], branch[:, :d], np.arange(len(i)) >= contacts)


@lean
def _measure_bonds(laws, bonds, lattice_dd, force_bd, branch_bd):
    """Write the force on i and the vector of each bond."""
    for b in range(bonds.i_b.shape[0]):
        dx, dy, dz = bond_vector(laws.axes, laws.body, bonds, lattice_dd, b)
        pull = pull_of_bond(bonds, laws, b, dx, dy, dz)
        force_bd[b, 0], force_bd[b, 1], force_bd[b, 2] = pull.fx, pull.fy, pull.fz
        branch_bd[b, 0], branch_bd[b, 1], branch_bd[b, 2] = dx, dy, dz


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


def touching_of(engine: Engine) -> Touching:
    """Return the contacts at the present time."""
    if not engine.started:
        engine.begin()
    d = len(engine.axes)
    found = record_contacts(engine.system, engine.now)
    seen = np.flatnonzero(found.touching_p)
    i, j, image = (one[seen] for one in listed_pairs(engine.pairs))
    i, j, image = engine.order_n[i], engine.order_n[j], image[:, :d]
    # from rows and images of the loops' lattice to particles, their places and the scene's box
    whole = image @ engine.change_dd.T - engine.wrap_nd[j] + engine.wrap_nd[i]
    force, normal, sliding = found.force_pd[seen, :d], found.normal_p[seen], found.sliding_p[seen] > 0
    i, j, whole, turned = one_way(i, j, whole)
    force = np.where(turned[:, None], -force, force)
    order = np.lexsort((*whole.T[::-1], j, i))
    touching = Touching(i[order], j[order], whole[order], normal[order], force[order], sliding[order])
    return touching._replace(sliding_c=touching.sliding_c | _stands_at_limit(engine, touching))


def _stands_at_limit(engine: Engine, found: Touching) -> NDArray[np.bool_]:
    """Return the (C,) contacts of discs and spheres that stand at the Coulomb limit, as well as they are at rest."""
    friction = friction_of(engine.scene.effects)
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
    radius, other = (engine.scene.packing.radius_n[end] for end in (found.i_c, found.j_c))
    kinds = kinds_of_pairs(engine.scene.packing, found.i_c, found.j_c)
    touches = ContactLengths(length, radius + other, effective_radius(radius, other), kinds)
    cap = under_cap(engine.scene.effects, found.normal_c, touches)
    return find_at_limit(size, cap, number_at(friction.coefficient, kinds), residual).at_limit_c
