"""The second derivatives of a scene, the same for every family: its elements, assembled, on the motions of its links.

What a kind of contact adds is decided here and nowhere else in mechanics: which pairs touch, who rattles, and the
elements. Hessians, modes, moduli and the rest ask a `System`.
"""

from __future__ import annotations

import functools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from packmech.check import Kind
from packmech.constraints.factor import ConstraintFactor
from packmech.contacts import Contacts
from packmech.contacts.elements import Elements, PairGeometry, elements_of, sum_slopes
from packmech.contacts.shape_contacts import ShapeContacts
from packmech.contacts.tangential_elements import tangential_elements
from packmech.contacts.turning_elements import TurningLimits, turning_elements
from packmech.effects import (
    ContactTerms,
    acts_on_single,
    at_normal_force,
    bonded_pairs,
    bonds_of,
    contact_terms,
    lacking_second,
    needs_second,
    refuse_tangential_bonds,
    refuse_tangential_springs,
    refuse_unknown_to_shapes,
    rolling_of,
    rolling_spring_of,
    shaped_terms,
    single_terms,
    twisting_of,
)
from packmech.linalg.mandel import mandel_basis, trace_vector
from packmech.measure.friction import TurningForces
from packmech.mechanics.assembly import Assembled, assemble
from packmech.mechanics.network import Network, contact_network
from packmech.packing import Packing
from packmech.scene import Scene

# step of differences of forces on single particles [smallest radius]
_STEP = 1e-6


@dataclass(frozen=True, eq=False)
class System:
    """Slopes and second derivatives of a scene's energy by the coordinates of a network, and by strains.

    Attributes
    ----------
    network
        Particles, contacts, links and coordinates.
    terms
        Energies of the contacts and their derivatives, those that just touch taken from the closed side.
    elements
        What is assembled: contacts, bonds, and links as springs with a force and no stiffness.
    assembled
        Their sum, with what acts on single particles.
    carried
        Whether strains take displacements along, as Mandel strains of a box do; displacement gradients of waves do not.

    """

    network: Network
    terms: ContactTerms
    elements: tuple[Elements, ...]
    assembled: Assembled
    carried: bool = True

    @property
    def links(self) -> ConstraintFactor:
        """The rigid links, perhaps none."""
        return self.network.links

    def matrix(self, free_f: NDArray[np.bool_] | None = None) -> sp.csr_array:
        """Return the second derivatives by coordinates, those that can move unless given."""
        return self.assembled.matrix(self.network.free_f if free_f is None else free_f)

    def whole_matrix(self) -> sp.csr_array:
        """Return the second derivatives by all coordinates, zeros in rows and columns of what is held."""
        free_nq, there_nq = self.network.free_nq, self.network.there_nq
        found = self.matrix(np.ones(free_nq.size, dtype=bool))
        if (free_nq != there_nq).any():
            moving = sp.diags_array(free_nq.ravel().astype(float), format="csr")
            found = sp.csr_array(moving @ found @ moving)
        found.eliminate_zeros()
        return found

    @functools.cached_property
    def _carried_nqe(self) -> NDArray[np.float64]:
        """The (N', q, s) what a strain makes of net forces: it takes displacements along, v -> (1 + strain) v."""
        d = self.network.dimension
        carried = np.zeros_like(self.assembled.column_nqe)
        if self.carried and carried.shape[2]:
            carried[:, :d] = np.einsum("eab,nb->nae", mandel_basis(d), self.assembled.slope_nq[:, :d])
        return carried

    def column(self, free_f: NDArray[np.bool_] | None = None) -> NDArray[np.float64]:
        """Return the (F, s) derivatives of the slopes by Mandel strains [energy/length]."""
        free = self.network.free_f if free_f is None else free_f
        strains = self._carried_nqe.shape[2]
        return self.assembled.column(free) + np.compress(free, self._carried_nqe.reshape(len(free), strains), axis=0)

    def row(self, free_f: NDArray[np.bool_] | None = None) -> NDArray[np.float64]:
        """Return the (s, F) derivatives of stress times volume by the coordinates [energy/length]."""
        free = self.network.free_f if free_f is None else free_f
        strains = self._carried_nqe.shape[2]
        return self.assembled.row(free) + np.compress(free, self._carried_nqe.reshape(len(free), strains), axis=0).T

    @property
    def corner(self) -> NDArray[np.float64]:
        """The (s, s) derivatives of stress times volume by strains [energy]."""
        return self.assembled.corner_ee

    @functools.cached_property
    def virial_dd(self) -> NDArray[np.float64]:
        """The (d, d) stress times the volume, row = force component, of contacts and links [energy]."""
        d = self.network.dimension
        total = np.zeros((d, d))
        for one in self.elements:
            total += one.pull_cx[:, :d].T @ one.vector_cd
        return total

    @property
    def volume_curvature(self) -> NDArray[np.float64]:
        """The (s, s) curvature P V d2(det) of a volume held by pressure: P V (tr E tr F - tr E F)."""
        d = self.network.dimension
        trace = trace_vector(d)
        pressure_volume = -float(np.trace(self.virial_dd)) / d
        return np.asarray(pressure_volume * (np.outer(trace, trace) - np.eye(len(trace))))

    @property
    def push(self) -> float:
        """The largest force of a contact under a unit strain."""
        contacts, beyond = self.network.contacts, self.network.interactions
        largest = 0.0
        for one, first_c, second_c in (
            (contacts, self.terms.first_c, self.terms.second_c),
            (beyond.pairs, beyond.first_ck[:, 0], beyond.second_ckk[:, 0, 0]),
        ):
            size = np.sqrt((one.slope_cx[:, : one.dimension] ** 2).sum(axis=1))
            push = (np.abs(second_c) * one.distance_c + np.abs(first_c)) * size
            largest = max(largest, float(push.max(initial=0.0)))
        return largest

    @property
    def virial_of_springs(self) -> float:
        """The sum of du/dr r over all pairs but links, whatever the kind of second derivatives [energy]."""
        one = self.network.contacts
        along_c = (one.slope_cx[:, : one.dimension] * one.vector_cd).sum(axis=1)
        return float(self.terms.first_c @ along_c + np.trace(self.network.interactions.virial()))


def system_of(
    scene: Scene,
    kind: Kind = "exact",
    *,
    gap_tolerance: float | None = None,
    rattlers: str = "remove",
    strained: bool = True,
) -> System:
    """Return the second derivatives of a scene whose forces derive from an energy.

    Parameters
    ----------
    scene
        The scene.
    kind
        "exact": with the forces of contacts and links. "paper": with those of the contacts alone. "unstressed":
        without forces.
    gap_tolerance, rattlers
        As in `contact_network`.
    strained
        Whether strains of the box are asked for, too: without them `column`, `row` and `corner` are empty.

    Raises
    ------
    ValueError
        If touching centers coincide, or an effect on single particles has no second derivatives.

    """
    packing, effects = scene.packing, scene.effects
    refuse_unknown_to_shapes(scene)
    if acts_on_single(effects):
        needs_second(effects, "second derivatives")
    network = contact_network(packing, effects, gap_tolerance=gap_tolerance, rattlers=rattlers)
    return assembled_system(scene, network, kind, strained=strained)


def assembled_system(
    scene: Scene,
    network: Network,
    kind: Kind = "exact",
    *,
    strained: bool = True,
    link_stiffness: float = 0.0,
    surfaces: Sequence[Elements] = (),
    walls_nxx: NDArray[np.float64] | None = None,
) -> System:
    """Return the second derivatives of a scene's energy on a network; with springs along the links where asked for.

    Contacts are those of pairs whose energies depend on their distances alone, unless `surfaces` are given: the
    contacts, and tangential springs of bonds. `walls_nxx` are (N, X, X) derivatives by positions and rotations of what
    rough walls do across.
    """
    one = network.contacts
    terms = closed_terms(scene, one)
    elements = list(surfaces)
    if not elements:
        refuse_tangential_springs(scene.effects)
        first = np.zeros_like(terms.first_c) if kind == "unstressed" else terms.first_c
        elements.append(elements_of(one, first, terms.second_c))
    if len(network.interactions):
        elements.append(network.interactions.elements(kind))
    if len(network.links) and (kind == "exact" or link_stiffness):
        tension = np.zeros(len(network.links))
        if kind == "exact":
            tension = _tension(scene, network, elements)
        elements.append(elements_of(network.links.pairs, tension, np.full(len(tension), link_stiffness)))
    d = network.dimension
    assembled = assemble(
        elements,
        network.turn_nkt,
        d,
        single_nqq=single_second(scene, network, kind, walls_nxx),
        basis_edd=None if strained else np.zeros((0, d, d)),
    )
    return System(network, terms, tuple(elements), assembled)


def across_bonds(effects: tuple[Any, ...], network: Network, *, dashpots: bool = False) -> list[Elements]:
    """Return the tangential springs of bonds, which are slack at rest, or their dashpots, along and across; or nothing.

    Springs along the bonds are among the network's interactions.
    """
    bonds = bonds_of(effects)
    if bonds is None or not (dashpots or bonds.tangential_stiffness):
        return []
    refuse_tangential_bonds(effects, network.parent.shapes)
    found = bonded_pairs(network.parent, effects)
    assert found is not None
    pairs = found.among(network.index_n).pairs
    none, slack = np.zeros(len(pairs)), np.zeros_like(pairs.normal_cd)
    along, across = (bonds.damping, bonds.tangential_damping) if dashpots else (0.0, bonds.tangential_stiffness)
    if not across:
        return [elements_of(pairs, none, none + along)]
    return [tangential_elements(pairs, network.packing.radius_n, none, none + along, slack, across)[0]]


def turning_springs(
    effects: tuple[Any, ...],
    contacts: PairGeometry,
    packing: Packing,
    forces: TurningForces,
    kind: Kind = "exact",
    *,
    normal_c: NDArray[np.float64] | None = None,
    limits: TurningLimits | None = None,
) -> tuple[list[Elements], NDArray[np.float64] | None]:
    """Return the springs against rolling and twisting of contacts, or their dashpots; or nothing.

    And the derivatives of what passes their limits, as `turning_elements` does; None without springs.

    Dashpots are those of small motions about rest, below any limit.

    Parameters
    ----------
    effects
        The scene's effects.
    contacts, packing
        The contacts, and the packing whose particles they count.
    forces
        What these springs bear, contact by contact.
    kind
        "exact" or "unstressed".
    normal_c
        (C,) normal forces that limits are made of, where dashpots are asked for [force].
    limits
        Those of springs, where some slip.

    """
    parts = (forces.rolling_cd, forces.twisting_c)
    resisting: tuple[Any, ...]
    if normal_c is None:
        resisting = (rolling_spring_of(effects), twisting_of(effects))
        sizes = [0.0 if one is None else one.stiffness for one in resisting]
    else:
        resisting = (rolling_of(effects), twisting_of(effects))
        sizes = [0.0 if one is None else at_normal_force(one, normal_c).damping for one in resisting]
        parts, kind = (np.zeros_like(parts[0]), np.zeros_like(parts[1])), "unstressed"
    if not any(resisting):
        return [], None
    found, beyond = turning_elements(contacts, packing.radius_n, *parts, (sizes[0], sizes[1]), kind, limits)
    return [found], beyond


def closed_terms(scene: Scene, contacts: Contacts | ShapeContacts) -> ContactTerms:
    """Return the contacts' energies and derivatives, those that just touch taken from the closed side."""
    return contact_terms(scene.effects, contacts, closing=True)


def single_second(
    scene: Scene, network: Network, kind: Kind = "exact", walls_nxx: NDArray[np.float64] | None = None
) -> NDArray[np.float64] | None:
    """Return the (N', q, q) second derivatives of what acts on single particles; None where nothing does.

    `walls_nxx` as in `assembled_system`.

    Those of effects that give none come from differences of their forces, which err by the square of a millionth of the
    smallest radius, over the length on which the forces change.
    """
    packing, effects = scene.packing, scene.effects
    if not acts_on_single(effects):
        return None
    d, turn, index = network.dimension, network.turn_nkt, network.index_n
    terms = shaped_terms(effects, packing)
    second = (terms.stiffness_nxx if kind == "unstressed" else terms.second_nxx)[index]
    second[:, :d, :d] += _differences(effects, packing)[index]
    if walls_nxx is not None:
        second = second + walls_nxx[index]
    change = np.zeros((len(turn), d + turn.shape[1], second.shape[1]))
    change[:, :d, :d] = np.eye(d)
    change[:, d:, d : d + turn.shape[2]] = turn
    return np.asarray(change @ second @ change.transpose(0, 2, 1))


def _differences(effects: tuple[Any, ...], packing: Packing) -> NDArray[np.float64]:
    """Return the (N, d, d) second derivatives of effects on single particles that give none."""
    d = packing.dimension
    second = np.zeros((packing.particles, d, d))
    lacking = lacking_second(effects)
    if not lacking:
        return second
    step = _STEP * float(packing.radius_n.min())
    for axis in range(d):
        shift = np.zeros(d)
        shift[axis] = step
        there, back = (
            single_terms(lacking, packing, packing.position_nd + side * shift).force_nd for side in (1.0, -1.0)
        )
        second[:, :, axis] = (back - there) / (2.0 * step)
    return np.asarray(0.5 * (second + second.transpose(0, 2, 1)))


def _tension(scene: Scene, network: Network, elements: list[Elements]) -> NDArray[np.float64]:
    """Return the (L,) forces in the links that balance the elements, and what acts on particles that can move."""
    d, turn = network.dimension, network.turn_nkt
    push = np.sum([sum_slopes(one.i_c, one.j_c, one.pull_cx, turn, d) for one in elements], axis=0)[:, :d]
    if network.anchored:
        push -= single_terms(scene.effects, scene.packing).force_nd[network.index_n]
    return network.links.multipliers(push, np.asarray(network.free_nq.any(axis=1)))


def bordered(position: sp.csr_array, coupling_xe: NDArray[np.float64], corner_ee: NDArray[np.float64]) -> sp.csr_array:
    """Return a symmetric sparse matrix with strains appended: their mixed derivatives, and those by strains alone."""
    side = sp.csr_array(coupling_xe)
    return sp.csr_array(sp.block_array([[position, side], [side.T, sp.csr_array(corner_ee)]], format="csr"))
