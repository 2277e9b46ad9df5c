"""What mechanics takes of a packing with shapes: the particles that are held, their contacts, turns and Hessian."""

from __future__ import annotations

import dataclasses
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.contacts.shape_contacts import ShapeContacts, find_shape_contacts
from packmech.contacts.shape_rattlers import shape_rattlers
from packmech.effects import (
    ContactTerms,
    ShapedTerms,
    Walls,
    acts_on_single,
    contact_terms,
    held_particles,
    needs_second,
    refuse_unknown_to_shapes,
    shaped_terms,
    single_effects,
    wall_sides,
)
from packmech.linalg.mandel import trace_vector
from packmech.mechanics.shape_sums import ShapeSums, shape_sums, turning
from packmech.packing import Packing
from packmech.scene import Scene


class ShapedNetwork(NamedTuple):
    """Contacts among the particles that are held, numbered anew, with what turns make of them; q coordinates each.

    `index_n` are the particles, `turn_nkt` their turns (`Spheroids.turn_basis`) and `free_nq` which of their
    coordinates there are: a disc has no turns.
    """

    packing: Packing
    contacts: ShapeContacts
    index_n: NDArray[np.int64]
    turn_nkt: NDArray[np.float64]
    free_nq: NDArray[np.bool_]

    @property
    def pinned(self) -> NDArray[np.bool_]:
        """The (N', q) coordinates but for the translations of the best connected particle."""
        pinned = self.free_nq.copy()
        if len(pinned):
            pinned[int(np.argmax(self.contacts.count_n())), : self.contacts.dimension] = False
        return pinned


def shaped_network(
    packing: Packing,
    *,
    gap_tolerance: float | None = None,
    rattlers: str = "remove",
    second: bool = True,
    effects: tuple[Any, ...] = (),
) -> ShapedNetwork:
    """Return the contacts among the particles that do not rattle, or among all where rattlers are kept.

    Walls among the effects hold particles, too; what has a weight, or feels another potential, presses on whatever it
    touches and rattles only where it touches nothing. The coordinates of what is held are none of the free ones.
    """
    index = np.arange(packing.particles)
    held = held_particles(effects, packing.particles)
    contacts = find_shape_contacts(packing, gap_tolerance=gap_tolerance, second=second)
    if rattlers == "remove":
        rattling = _rattling(packing, contacts, effects)
        if rattling.all():
            return _nothing_held(packing, contacts)
        if rattling.any():
            index = np.flatnonzero(~rattling)
            packing = packing.select(index)
            number = np.cumsum(~rattling) - 1
            kept = contacts.select(~(rattling[contacts.i_c] | rattling[contacts.j_c]))
            contacts = kept.numbered(number, packing)
    shapes = packing.shapes
    assert shapes is not None
    turn = shapes.turn_basis(packing.radius_n)
    free = np.hstack([np.ones((len(index), packing.dimension), dtype=bool), turning(turn)])
    if held is not None:
        free[held[index]] = False
    return ShapedNetwork(packing, contacts, index, turn, free)


def _rattling(packing: Packing, contacts: ShapeContacts, effects: tuple[Any, ...]) -> NDArray[np.bool_]:
    """Return who rattles where effects act on single particles, or none do."""
    walls = [one for _, _, _, one in wall_sides(effects, packing)]
    held = held_particles(effects, packing.particles)
    if all(isinstance(one, Walls) for one in single_effects(effects)):
        return shape_rattlers(packing, contacts, walls, held)
    touching = contacts.count_n() > 0
    for one in walls:
        touching[one.particle_w] = True
    return ~touching if held is None else ~(touching | held)


def _nothing_held(packing: Packing, contacts: ShapeContacts) -> ShapedNetwork:
    """Return the network without particles, beside the packing of those that all rattle."""
    shapes = packing.shapes
    assert shapes is not None
    turn = shapes.turn_basis(packing.radius_n)[:0]
    free = np.zeros((0, packing.dimension + turn.shape[1]), dtype=bool)
    none = dataclasses.replace(contacts.select(np.zeros(len(contacts), dtype=bool)), particles=0)
    return ShapedNetwork(packing, none, np.zeros(0, dtype=np.int64), turn, free)


class ShapedHessian(NamedTuple):
    """A network with the energies of its contacts and their second derivatives."""

    network: ShapedNetwork
    terms: ContactTerms
    sums: ShapeSums
    anchored: bool = False

    def corner(self, kind: str, strain: str, volume_curvature: str) -> NDArray[np.float64]:
        """Return the (s, s) derivatives by strains, with the curvature P V (tr E tr F - tr E F) of a held volume."""
        if not (kind == "exact" and strain == "isochoric" and volume_curvature == "det"):
            return self.sums.strain_ee
        one = self.network.contacts
        pull = self.terms.first_c[:, None] * one.slope_cx[:, : one.dimension]
        pressure_volume = -float((pull * one.vector_cd).sum()) / one.dimension
        trace = trace_vector(one.dimension)
        return np.asarray(self.sums.strain_ee + pressure_volume * (np.outer(trace, trace) - np.eye(len(trace))))


def shaped_hessian(
    scene: Scene, kind: str, *, gap_tolerance: float | None = None, rattlers: str = "remove"
) -> ShapedHessian:
    """Return the second derivatives of a scene whose packing has shapes; "unstressed" leaves out the forces."""
    refuse_unknown_to_shapes(scene)
    acting = acts_on_single(scene.effects)
    if acting:
        needs_second(scene.effects, "second derivatives")
    network = shaped_network(
        scene.packing, gap_tolerance=gap_tolerance, rattlers=rattlers, effects=scene.effects if acting else ()
    )
    one = network.contacts
    terms = contact_terms(scene.effects, one.distance_c, one.contact_distance_c, closing=True)
    first = np.zeros_like(terms.first_c) if kind == "unstressed" else terms.first_c
    sums = shape_sums(one, network.turn_nkt, first, terms.second_c)
    if acting:
        single = shaped_terms(scene.effects, scene.packing)
        sums.diagonal_nqq[:] += _of_single(single, network, kind)
    return ShapedHessian(network, terms, sums, acting)


def _of_single(single: ShapedTerms, network: ShapedNetwork, kind: str) -> NDArray[np.float64]:
    """Return the (N', q, q) second derivatives of what acts on the network's particles, by their coordinates."""
    d, turn = network.contacts.dimension, network.turn_nkt
    whole = (single.stiffness_nxx if kind == "unstressed" else single.second_nxx)[network.index_n]
    count, turns, rotations = turn.shape
    change = np.zeros((count, d + turns, d + rotations))
    change[:, :d, :d] = np.eye(d)
    change[:, d:, d:] = turn
    return np.asarray(change @ whole @ change.transpose(0, 2, 1))
