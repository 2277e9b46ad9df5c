"""Forces and torques of contacts with friction, for a packing at rest: what slides, what is held, and who rattles."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.check import instance
from packmech.contacts import Contacts, find_contacts
from packmech.contacts.coulomb_limit import CoulombLimit, find_at_limit
from packmech.contacts.rattlers import rough_ends_of
from packmech.contacts.shape_contacts import touching_pairs
from packmech.effects import Bonds, acts_on_single, contact_terms, held_particles, single_terms, total_push
from packmech.honors import honors
from packmech.measure.friction import friction_of, sum_both, sum_tangential, tangential_forces
from packmech.measure.rattlers import find_rattling_clusters, rattlers_among
from packmech.measure.shaped import shape_forces
from packmech.measure.stress import force_balance, sum_forces
from packmech.scene import Scene

# a contact bears force above this part of the mean normal force
_BEARING = 1e-6


@dataclass(frozen=True, eq=False)
class ContactForces:
    """Normal and tangential forces of all touching pairs, and what they add up to.

    Attributes
    ----------
    scene
        The scene.
    contacts
        The touching pairs.
    normal_c
        (C,) normal forces, positive for repulsion [force].
    tangential_cd
        (C, d) tangential forces on particle i [force].

    """

    scene: Scene
    contacts: Contacts
    normal_c: NDArray[np.float64]
    tangential_cd: NDArray[np.float64]

    @functools.cached_property
    def limit(self) -> CoulombLimit:
        """Which contacts are at the Coulomb limit, which are doubtful, and the bound between (`find_at_limit`)."""
        size = np.sqrt((self.tangential_cd**2).sum(axis=1))
        return find_at_limit(size, self.normal_c, _coefficient(self.scene), self.residual)

    @property
    def at_limit_c(self) -> NDArray[np.bool_]:
        """The (C,) contacts at the Coulomb limit as well as the residual lets it be known.

        They slide as soon as they are pushed on.
        """
        return self.limit.at_limit_c

    @property
    def force_cd(self) -> NDArray[np.float64]:
        """The (C, d) whole forces on particle i [force]."""
        return np.asarray(self.tangential_cd - self.normal_c[:, None] * self.contacts.normal_cd)

    @functools.cached_property
    def force_nd(self) -> NDArray[np.float64]:
        """The (N, d) net forces, weights and pushes of walls included, none on what is held [force]."""
        net = sum_forces(self.contacts, self.normal_c) + sum_tangential(self.contacts, self.tangential_cd)
        return self._free(net + single_terms(self.scene.effects, self.scene.packing).force_nd)

    @functools.cached_property
    def torque_nk(self) -> NDArray[np.float64]:
        """The (N, 1) net torques in the plane, (N, 3) in space, about each center, none on what is held.

        In [force * length]. Arms are the particles' shares of the distance, r_i d / (r_i + r_j), as in `Friction`.
        """
        return self._free(sum_both(self.contacts, *self.torque_ck))

    @property
    def torque_ck(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The (C, 1 or 3) torques on particle i and on particle j [force * length]."""
        moment = _cross(self.contacts.normal_cd, self.tangential_cd)
        arm_i, arm_j = self._arms()
        return arm_i[:, None] * moment, arm_j[:, None] * moment

    def _free(self, sum_nk: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the sums over contacts, zero for particles that are held."""
        held = held_particles(self.scene.effects, len(sum_nk))
        if held is not None:
            sum_nk[held] = 0.0
        return sum_nk

    @functools.cached_property
    def residual(self) -> float:
        """Largest net force, or net torque over the radius, over the mean normal force [1]; 0 where nothing is pushed.

        Forces on single particles count in the mean: weights, and pushes of walls.
        """
        packing, effects = self.scene.packing, self.scene.effects
        push, pushes = total_push(single_terms(effects, packing), held_particles(effects, packing.particles))
        size = float(np.abs(self.normal_c).sum()) + push
        if not size:
            return 0.0
        mean = size / (len(self.contacts) + pushes)
        return self.largest_imbalance / mean

    @property
    def largest_imbalance(self) -> float:
        """Largest net force, or net torque over the radius [force]."""
        force = np.sqrt((self.force_nd**2).sum(axis=1)).max()
        torque = (np.sqrt((self.torque_nk**2).sum(axis=1)) / self.scene.packing.radius_n).max()
        return float(max(force, torque))

    @property
    def stress_dd(self) -> NDArray[np.float64]:
        """The (d, d) stress [energy/length^d], tension positive, row = force component."""
        vector = self.contacts.normal_cd * self.contacts.distance_c[:, None]
        return np.asarray(self.force_cd.T @ vector) / self.scene.packing.box.volume

    @property
    def pressure(self) -> float:
        """Pressure -trace(stress)/d [energy/length^d]."""
        return (0.0 - float(np.trace(self.stress_dd))) / self.contacts.dimension

    @property
    def bearing_c(self) -> NDArray[np.bool_]:
        """The (C,) contacts whose normal force is above 1e-6 of the mean; above 0 while the residual is larger."""
        if not len(self.contacts):
            return np.zeros(0, dtype=bool)
        part = _BEARING if self.residual <= _BEARING else 0.0
        return np.asarray(self.normal_c > part * np.abs(self.normal_c).mean())

    @functools.cached_property
    def rattlers_n(self) -> NDArray[np.bool_]:
        """The (N,) particles that rattle.

        Taken out again and again are particles that fewer than two force-bearing contacts touch, or whose contacts
        cannot balance force and torque by any forces within the friction cones. Two contacts suffice where the chord
        between them lies in both cones; so held, a sphere can still spin about it (`spinning_n`). Without friction it
        is the rule of `find_rattlers`, for the force-bearing contacts. Particles that are held never rattle; those with
        a weight do where they touch nothing.
        """
        packing, bearing, mu = self.scene.packing, self.contacts.select(self.bearing_c), _coefficient(self.scene)
        rough = None
        if mu > 0.0:
            share = packing.radius_n[bearing.i_c] / bearing.contact_distance_c
            arm_i = share[:, None] * bearing.vector_cd
            spins = np.eye(1 if packing.dimension == 2 else 3) / packing.radius_n[:, None, None]
            rough = rough_ends_of(bearing, np.stack([arm_i, arm_i - bearing.vector_cd]), spins)
        return rattlers_among(packing, bearing, self.scene.effects, rough=rough, friction=mu)

    @property
    def spinning_n(self) -> NDArray[np.bool_]:
        """The (N,) spheres that friction holds by two contacts: each can spin about the chord between these.

        Such a spin is a floppy mode of contacts that stick; in the plane there is none.
        """
        two = self.contacts.select(self._held_c()).count_n() == 2
        return np.asarray(two & (self.contacts.dimension == 3) & (_coefficient(self.scene) > 0.0))

    @property
    def coordination_number(self) -> float:
        """Mean number of force-bearing contacts of the particles that do not rattle [1]."""
        held = int((~self.rattlers_n).sum())
        return 2.0 * int(self._held_c().sum()) / held if held else 0.0

    @property
    def sliding_fraction(self) -> float:
        """Part of the force-bearing contacts between particles that do not rattle that is at the Coulomb limit [1]."""
        held = self._held_c()
        return float(self.at_limit_c[held].mean()) if held.any() else 0.0

    @property
    def at_limit_per_particle(self) -> float:
        """Contacts at the Coulomb limit per particle that does not rattle, n_m [1]."""
        held = int((~self.rattlers_n).sum())
        return int((self._held_c() & self.at_limit_c).sum()) / held if held else 0.0

    @property
    def isostatic_coordination(self) -> float:
        """Least coordination number that can balance forces and torques, (d + 1) + 2 n_m / d, none held [1].

        Shundyak, van Hecke and van Saarloos, Phys. Rev. E 75, 010301 (2007); n_m is the number of contacts at the
        limit per particle, which tends to 1 in the plane and to 3 in space as friction vanishes: then it is 2 d, as
        without friction, where torques need no balance.
        """
        d = self.contacts.dimension
        if not _coefficient(self.scene) > 0.0:
            return 2.0 * d
        return (d + 1) + 2.0 * self.at_limit_per_particle / d

    def to_dict(self) -> dict[str, Any]:
        """Return the counts by name, as plain values."""
        return {
            "contacts": len(self.contacts),
            "bearing_contacts": int(self._held_c().sum()),
            "rattlers": int(self.rattlers_n.sum()),
            "contacts_at_limit": int((self._held_c() & self.at_limit_c).sum()),
            "doubtful_at_limit": int((self._held_c() & self.limit.doubtful_c).sum()),
            "coordination_number": self.coordination_number,
            "isostatic_coordination": self.isostatic_coordination,
            "pressure": self.pressure,
            "residual": self.residual,
        }

    def _held_c(self) -> NDArray[np.bool_]:
        rattling = self.rattlers_n
        return np.asarray(self.bearing_c & ~(rattling[self.contacts.i_c] | rattling[self.contacts.j_c]))

    def _arms(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        contacts, radius = self.contacts, self.scene.packing.radius_n
        share = contacts.distance_c / contacts.contact_distance_c
        return radius[contacts.i_c] * share, radius[contacts.j_c] * share


def _cross(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (C, 1 or 3) cross products of (C, d) vectors."""
    if one.shape[1] == 3:
        return np.cross(one, other)
    return np.asarray((one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0])[:, None])


def _coefficient(scene: Scene) -> float:
    friction = friction_of(scene)
    return 0.0 if friction is None else friction.coefficient


@honors("repulsion friction gravity walls held", at_rest=True, shaped="pm.forces or pm.find_shape_contacts")
def contact_forces(scene: Scene) -> ContactForces:
    """Return the forces of all touching pairs of a scene at rest, friction included, and counts made of them.

    Tangential forces are the stiffness of `Friction` times the packing's tangential displacements
    (`Packing.tangential`, which runs leave there), cut at the coefficient times the normal force. Walls, where
    there is no friction, have contacts of their own (`wall_contacts`); their pushes and weights count in the net
    forces.

    Parameters
    ----------
    scene
        The scene, without links.

    Raises
    ------
    TypeError, ValueError
        If it is no scene, or holds what would be ignored.

    Examples
    --------
    >>> import packmech as pm
    >>> springs = pm.TangentialDisplacements([0], [1], [[0, 0]], [[0.03]])
    >>> pair = pm.Packing([[1.0, 1.0], [1.9, 1.0]], [0.5, 0.5], pm.Box.cubic(4.0, 2), tangential=springs)
    >>> found = pm.contact_forces(pm.Scene(pair, (pm.Repulsion(), pm.Friction(0.5, 1.0))))
    >>> found.normal_c.round(12).tolist(), np.abs(found.tangential_cd).round(12).tolist(), found.at_limit_c.tolist()
    ([0.1], [[0.0, 0.03]], [False])
    >>> found.torque_nk.round(12).tolist()
    [[0.0135], [0.0135]]

    """
    instance("scene", scene, Scene)
    packing = scene.packing
    contacts = find_contacts(packing, gap_tolerance=0.0)
    first = contact_terms(scene.effects, contacts.distance_c, contacts.contact_distance_c).first_c
    found = tangential_forces(scene, contacts, -first)
    return ContactForces(scene, contacts, -first, found.force_cd)


def force_residual(scene: Scene) -> float:
    """Return the largest net force on a particle over the mean contact force, friction included [1].

    Torques count over radii, and 0 is returned where nothing touches. It is that of the whole scene: what the contacts
    of rattlers do not balance is in it.
    """
    if friction_of(scene) is not None:
        return contact_forces(scene).residual
    largest, mean = force_balance(scene)
    return largest / mean if mean > 0.0 else 0.0


@honors("repulsion friction bonds gravity walls held shapes", at_rest=True, apart="friction+shapes")
def torques(scene: Scene) -> NDArray[np.float64]:
    """Return the net torques about each center: (N,) in the plane, (N, 3) in space [force * length].

    Discs and spheres feel those of friction alone (`contact_forces`), ellipses, spheroids and rigid bodies those of
    their contacts and of walls. Held ones have none.

    Parameters
    ----------
    scene
        The scene, without links.

    Examples
    --------
    >>> import packmech as pm
    >>> pm.torques(pm.Scene(pm.lattice_packing("square", repeats=(2, 2)), (pm.Repulsion(),))).tolist()
    [0.0, 0.0, 0.0, 0.0]

    """
    instance("scene", scene, Scene)
    if scene.packing.shapes is not None:
        found = shape_forces(scene).torques()
    else:
        # tangential springs of bonds are slack, and bonded pairs have none of friction
        found = contact_forces(scene.without(Bonds)).torque_nk
    return found[:, 0] if found.shape[1] == 1 else found


def rattlers_in(scene: Scene) -> NDArray[np.bool_]:
    """Return (N,) which particles of a scene at rest rattle: by friction, weights, walls and links, too.

    With links, particles that move apart from the backbone; where something acts on single particles beside links,
    clusters that can be moved as a whole.
    """
    packing, effects = scene.packing, scene.effects
    if packing.links is not None and not acts_on_single(effects):
        return find_rattling_clusters(packing).rattling_n
    if packing.links is None and (packing.tangential is not None or friction_of(scene) is not None):
        unbonded = tuple(one for one in effects if not isinstance(one, Bonds))
        return contact_forces(scene.replace(effects=unbonded)).rattlers_n
    return rattlers_among(packing, touching_pairs(packing, None), effects)
