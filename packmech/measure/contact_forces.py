"""Forces and torques of contacts at rest, friction included: what slides, what is held, and who rattles."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.calls.display import shown
from packmech.calls.honors import STRAINED, honors
from packmech.check import instance, warn
from packmech.constraints.factor import ConstraintFactor
from packmech.contacts import Contacts
from packmech.contacts.coulomb_limit import CoulombLimit, find_at_limit
from packmech.contacts.rattlers import rough_ends_of
from packmech.contacts.shape_contacts import ShapeContacts, touching_pairs
from packmech.effects import (
    Interactions,
    RollingResistance,
    RoughContacts,
    ShapedTerms,
    acting_contacts,
    acts_on_single,
    contact_terms,
    find_interactions,
    friction_of,
    friction_or_zero,
    held_particles,
    refuse_unknown_to_shapes,
    rolling_spring_of,
    rough_walls,
    roughness_of,
    shaped_terms,
    single_terms,
    springs_of,
    total_push,
    twisting_of,
    under_cap,
    wall_sides,
)
from packmech.effects.kinds import number_at
from packmech.effects.single import SingleTerms
from packmech.jit.blas import single_thread
from packmech.measure.counting import mean_of_moving
from packmech.measure.friction import (
    TurningForces,
    particles_at_walls,
    sum_both,
    tangential_forces,
    turning_forces,
    wall_springs,
)
from packmech.measure.rattlers import find_rattling_clusters, rattlers_among
from packmech.packing import Packing
from packmech.scene import Scene

# a contact bears force above this part of the mean normal force
_BEARING = 1e-6
# net force over mean contact force of a packing at rest [1], and how many times more than rounding shows in it
AT_REST, _FLOORS = 1e-2, 8.0


def unless_at_rest(force_residual: float, at_rest: bool, words: str) -> str:
    """Return the headline of a result of a scene; that it is not at rest, and what to do, is its first line."""
    if at_rest:
        return words
    mend = "relax it first, by pm.quench, or pm.settle with friction"
    return f"not at rest (force residual {force_residual:.2g}): {mend}\n{words}"


def _headline(one: ContactForces) -> str:
    words = f"{len(one.normal_c)} contacts, mean force {one.mean_force:.6g}, residual {one.residual:.1e}"
    return unless_at_rest(one.residual, one.at_rest, words)


@shown(_headline)
@dataclass(frozen=True, eq=False)
class ContactForces:
    """Normal and tangential forces of all touching pairs, and what they add up to.

    Attributes
    ----------
    scene
        The scene.
    contacts
        The touching pairs; of rigid bodies those of their beads.
    normal_c
        (C,) normal forces, positive for repulsion [force].
    tangential_cd
        (C, d) tangential forces on particle i [force].

    """

    scene: Scene
    contacts: Contacts | ShapeContacts
    normal_c: NDArray[np.float64]
    tangential_cd: NDArray[np.float64]

    @functools.cached_property
    def under_cap_c(self) -> NDArray[np.float64]:
        """The (C,) normal forces that Coulomb's limit is made of, with what cohesion adds [force]."""
        return under_cap(self.scene.effects, self.normal_c, self.contacts)

    @property
    def coefficient_c(self) -> NDArray[np.float64]:
        """The (C,) Coulomb's coefficients, 0 without friction [1]."""
        return np.array(np.broadcast_to(_coefficients(self.scene, self.contacts), len(self.contacts)), dtype=float)

    @functools.cached_property
    def limit(self) -> CoulombLimit:
        """Which contacts are at the Coulomb limit, which are doubtful, and the bound between (`find_at_limit`)."""
        size = np.sqrt((self.tangential_cd**2).sum(axis=1))
        return find_at_limit(size, self.under_cap_c, _coefficients(self.scene, self.contacts), self.residual)

    @functools.cached_property
    def turning_limits(self) -> tuple[CoulombLimit, CoulombLimit]:
        """The same of the springs against rolling and against twisting; no contact where a scene has none."""
        effects, forces = self.scene.effects, self.turning
        rolled = np.sqrt((forces.rolling_cd**2).sum(axis=1))
        both = ((rolling_spring_of(effects), rolled), (twisting_of(effects), np.abs(forces.twisting_c)))
        rolling, twisting = (
            find_at_limit(size, self.under_cap_c, 0.0 if one is None else one.coefficient, self.residual)
            for one, size in both
        )
        return rolling, twisting

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

    @property
    def virial_c(self) -> NDArray[np.float64]:
        """The (C,) forces times the vectors between centers, of which -trace(stress) is made [energy]."""
        return np.asarray((self.force_cd * self.contacts.vector_cd).sum(axis=1))

    @functools.cached_property
    def _pushes(self) -> SinglePush:
        """What acts on single particles."""
        return single_push(self.scene)

    @functools.cached_property
    def interactions(self) -> Interactions:
        """What acts between centers whether these touch or not, bonds among it; perhaps nothing."""
        return find_interactions(self.scene.packing, self.scene.effects)

    @functools.cached_property
    def energy(self) -> float:
        """The energy of contacts and their tangential springs, interactions, what acts on single particles [energy]."""
        effects, pairs = self.scene.effects, self.contacts
        springs = tangential_forces(self.scene, pairs, self.under_cap_c).energy_c + self.turning.energy_c
        whole = float(np.add.reduce(contact_terms(effects, pairs).energy_c))
        whole += float(np.add.reduce(self.interactions.energy_c))
        whole += float(np.add.reduce(springs)) + float(np.add.reduce(self._pushes.terms.energy_n))
        return whole + self._pushes.springs

    @functools.cached_property
    def turning(self) -> TurningForces:
        """What resists rolling and twisting of discs and spheres."""
        return turning_forces(self.scene, self.contacts, self.under_cap_c)

    @functools.cached_property
    def force_nd(self) -> NDArray[np.float64]:
        """The (N, d) net forces, weights and pushes of walls included, none on what is held [force].

        What rigid links add to them is not counted.
        """
        return self._free(self._net_nd(with_pushes=True))

    @property
    def reaction_nd(self) -> NDArray[np.float64]:
        """The (N, d) forces that hold the held particles against all others, 0 for those that are free [force].

        They balance contacts, bonds and interactions at rest. A held particle's own weight, and the push of a wall on
        it, are not among them, so that the grains of a floor add up to the weight that lies on them, as in the report's
        "force on supports". Dashpots, and what rigid links add, are not counted.
        """
        by_others = self._net_nd(with_pushes=False)
        return self._free(by_others.copy()) - by_others

    def _net_nd(self, *, with_pushes: bool) -> NDArray[np.float64]:
        """Return the (N, d) net forces, on what is held, too; with what acts on single particles or without [force]."""
        force = self.force_cd
        net = sum_both(self.contacts, force, -force)
        if with_pushes:
            net = net + self._pushes.force_nd
        if len(self.interactions):
            net += self.interactions.net()[:, : net.shape[1]]
        return net

    @functools.cached_property
    def torque_nk(self) -> NDArray[np.float64]:
        """The (N, 1) net torques in the plane, (N, 3) in space, about each center, none on what is held.

        In [force * length]. Forces act at the points of contact: for discs and spheres, and beads, at their shares of
        the distance, r_i d / (r_i + r_j), as in `Friction`.
        """
        net, d = sum_both(self.contacts, *self.torque_ck) + self._pushes.torque_nk, self.contacts.dimension
        if self.interactions.turning_ct.size:
            net += self.interactions.net()[:, d:]
        return self._free(net)

    @property
    def torque_ck(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The (C, 1 or 3) torques on particle i and on particle j [force * length]."""
        contacts, d = self.contacts, self.contacts.dimension
        point = contacts.points(self.scene.packing.radius_n)
        on_i, on_j = (_cross(arm, self.tangential_cd) for arm in (point, contacts.vector_cd - point))
        k = on_i.shape[1]
        if contacts.slope_cx.shape[1] > d:
            turning = (self.normal_c / contacts.push_c)[:, None] * contacts.slope_cx[:, d:]
            on_i, on_j = on_i + turning[:, :k], on_j + turning[:, k:]
        moment = self.turning.moment_ck(contacts.normal_cd)
        return on_i + moment, on_j - moment

    def _free(self, sum_nk: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the sums over contacts, zero for particles that are held."""
        held = held_particles(self.scene.effects, len(sum_nk))
        if held is not None:
            sum_nk[held] = 0.0
        return sum_nk

    @functools.cached_property
    def _links(self) -> tuple[ConstraintFactor, NDArray[np.float64]]:
        """The rigid links, and their (L,) tensions [force]."""
        effects, packing = self.scene.effects, self.scene.packing
        held = held_particles(effects, packing.particles)
        with single_thread():
            links = ConstraintFactor(packing)
            return links, links.multipliers(-self.force_nd, None if held is None else ~held)

    @property
    def link_pairs(self) -> Contacts:
        """The linked pairs, in the order of the links."""
        return self._links[0].pairs

    @property
    def tension_l(self) -> NDArray[np.float64]:
        """The (L,) forces in the rigid links, as `link_tension` gives them [force]."""
        return self._links[1]

    @property
    def mean_force(self) -> float:
        """Mean force of contacts, and of pushes on single particles that are free [force]; 0 where nothing acts."""
        held = held_particles(self.scene.effects, self.scene.packing.particles)
        push, pushes = total_push(self._pushes.terms, held)
        size, count = float(np.abs(self.normal_c).sum()) + push, len(self.contacts) + pushes
        size, count = size + float(np.abs(self.interactions.first_ck[:, 0]).sum()), count + len(self.interactions)
        return size / count if count else 0.0

    @functools.cached_property
    def residual(self) -> float:
        """Largest net force, or net torque over the radius, over the mean normal force [1]; 0 where nothing is pushed.

        Forces on single particles count in the mean: weights, and pushes of walls.
        """
        mean = self.mean_force
        return self.largest_imbalance / mean if mean > 0.0 else 0.0

    @functools.cached_property
    def at_rest(self) -> bool:
        """Whether the residual is at most a hundredth, or no more than rounding of the coordinates makes of it."""
        return self.balances_to(AT_REST)

    def balances_to(self, tolerance: float) -> bool:
        """Return whether the residual is at most that, or no more than rounding of the coordinates makes of it."""
        if self.residual <= tolerance:
            return True
        terms = contact_terms(self.scene.effects, self.contacts)
        return self.largest_imbalance <= _FLOORS * rounding_force(self.scene.packing, terms.second_c)

    def warn_of_rattlers(self, left_out: int) -> None:
        """Warn of rattlers that are left out of an answer where the forces do not balance."""
        if left_out and not self.at_rest:
            count = self.scene.packing.particles
            warn(
                f"scene should be at rest, got force residual {self.residual:.2g}: {left_out} of {count} particles "
                "count as rattlers by contacts that do not balance, and are left out; relax it first, by pm.quench, or "
                'pm.settle with friction, or take all particles with rattlers="keep"',
            )

    @functools.cached_property
    def largest_imbalance(self) -> float:
        """Largest net force that links do not bear, or net torque over the radius [force].

        Without friction discs and spheres feel no torque, and those on others count over their radii of gyration.
        """
        packing, force, turn = self.scene.packing, self.force_nd, self.scene.packing.turn_nkt
        if packing.links:
            links, tension = self._links
            pull = links.pairs.normal_cd * tension[:, None]
            force = self._free(force + sum_both(links.pairs, pull, -pull))
        parts = [force]
        if roughness_of(self.scene.effects) is not None or rough_walls(self.scene.effects):
            parts.append(self.torque_nk / packing.radius_n[:, None])
        elif turn.size:
            parts.append(np.einsum("nkt,nt->nk", turn, self.torque_nk[:, : turn.shape[2]]))
        return float(np.sqrt(max((one**2).sum(axis=1).max() for one in parts)))

    @property
    def contact_stress_dd(self) -> NDArray[np.float64]:
        """The (d, d) stress that contacts and bonds bear [energy/length^d], tension positive, row = force component."""
        virial = np.asarray(self.force_cd.T @ self.contacts.vector_cd) + self.interactions.virial()
        return virial / self.scene.packing.box.volume

    @property
    def link_stress_dd(self) -> NDArray[np.float64]:
        """The (d, d) stress that rigid links bear [energy/length^d]."""
        d, box = self.contacts.dimension, self.scene.packing.box
        if not self.scene.packing.links:
            return np.zeros((d, d))
        links, tension = self._links
        return contact_stress(links.pairs, tension, box.volume)

    @property
    def stress_dd(self) -> NDArray[np.float64]:
        """The (d, d) stress of contacts and links [energy/length^d], tension positive, row = force component."""
        return self.contact_stress_dd + self.link_stress_dd

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
        a weight do where they touch nothing, linked ones where nothing touches their cluster.
        """
        packing, effects = self.scene.packing, self.scene.effects
        bearing, walls = self.contacts.select(self.bearing_c), rough_walls(effects)
        mu = self._coefficient
        # rows are made for this coefficient, the largest, and as long as their own is over it
        unit = mu if mu > 0.0 or not walls else 1.0
        if unit == 0.0:
            return rattlers_among(packing, bearing, effects)
        resisting = rolling_spring_of(effects), twisting_of(effects)
        rolls = resisting[0] is not None or any(isinstance(one.rolling, RollingResistance) for one in walls)
        twists = resisting[1] is not None or any(one.twisting for one in walls)
        point, arm = bearing.points(packing.radius_n), self.turning.arm_c[self.bearing_c] / unit
        sizes = [0.0 if one is None else one.coefficient for one in resisting]
        moments = [size * arm if there else None for size, there in zip(sizes, (rolls, twists), strict=True)]
        rough = rough_ends_of(bearing, np.stack([point, point - bearing.vector_cd]), packing.spin_nkk, moments)
        share_c = np.broadcast_to(_coefficients(self.scene, bearing) / unit, len(bearing))
        rough.side_esx[:, : packing.dimension - 1] *= np.tile(share_c, 2)[:, None, None]
        return rattlers_among(packing, bearing, effects, rough=rough, friction=unit, turning=(rolls, twists))

    @property
    def spinning_n(self) -> NDArray[np.bool_]:
        """The (N,) spheres that friction holds by two contacts: each can spin about the chord between these.

        Such a spin is a floppy mode of contacts that stick; in the plane there is none, nor where contacts resist
        rolling or twisting.
        """
        effects, packing = self.scene.effects, self.scene.packing
        count, resisting = self.contacts.select(self._held_c()).count_n(), np.zeros(packing.particles, dtype=bool)
        resisting[:] = bool(rolling_spring_of(effects) or twisting_of(effects))
        if not self._coefficient > 0.0:
            count = np.zeros_like(count)
        for side in wall_sides(effects, packing) if rough_walls(effects) else ():
            rough = side.wall.roughness
            held = side.touches.particle_w[(side.coefficient_w > 0.0) | isinstance(rough, RoughContacts)]
            # a surface may touch a sphere at several places
            np.add.at(count, held, 1)
            resisting[held] |= isinstance(springs_of(rough), RoughContacts)
        return np.asarray((count == 2) & ~resisting & ~self.rattlers_n & (self.contacts.dimension == 3))

    @property
    def coordination_number(self) -> float:
        """Mean number of force-bearing contacts of the particles that neither rattle nor are held [1]."""
        count_n, scene = self.contacts.select(self._held_c()).count_n(), self.scene
        return mean_of_moving(count_n, self.rattlers_n, held_particles(scene.effects, scene.packing.particles))

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

        Where contacts resist rolling, twisting, or both, each has r numbers more, d - 1 and 1, and what is at its limit
        there counts in n_m, too: (d (d + 1) + 2 n_m) / (d + r). Shundyak, van Hecke and van Saarloos, Phys. Rev. E 75,
        010301 (2007); n_m is the number of contacts at the limit per particle, which for discs and spheres tends to 1
        in the plane and to 3 in space as friction vanishes: then it is 2 d, as without friction, where their torques
        need no balance. Where the coefficient is 0 for some pairs of kinds, their contacts have a normal force alone,
        and the torques of what only such contacts touch need no balance. Every link bears one force, too. Not known,
        nan, where walls are rough: what they bear is not counted.
        """
        if rough_walls(self.scene.effects):
            return math.nan
        d, held = self.contacts.dimension, ~self.rattlers_n
        links, count = self.scene.packing.links, max(int(held.sum()), 1)
        linked = int((held[links.i_l] & held[links.j_l]).sum())
        turns_n = (self.scene.packing.turn_nkt != 0.0).any(axis=2).sum(axis=1)
        if not self._coefficient > 0.0:
            return 2.0 * (d + (int(turns_n[held].sum()) - linked) / count)
        rolling, twisting = rolling_spring_of(self.scene.effects), twisting_of(self.scene.effects)
        rows = d + (d - 1) * (rolling is not None) + (twisting is not None)
        limited = self.at_limit_per_particle + self._turning_at_limit() / count
        bearing = self.contacts.select(self._held_c())
        rubbing_c = np.broadcast_to(_coefficients(self.scene, bearing) > 0.0, len(bearing))
        smooth = 1.0 - float(rubbing_c.mean()) if len(bearing) else 0.0
        turned = (bearing.select(rubbing_c).count_n() > 0) | (bearing.count_n() == 0)
        turns = int(np.where(turned, d * (d - 1) // 2, turns_n)[held].sum())
        return 2.0 * (d + (turns - linked) / count + limited) / (rows - (d - 1) * smooth)

    def _turning_at_limit(self) -> int:
        """Return how many springs against rolling and twisting are at their limit, of contacts that bear."""
        return sum(int((one.at_limit_c & self._held_c()).sum()) for one in self.turning_limits)

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

    @property
    def _coefficient(self) -> float:
        """Coulomb's coefficient, the largest of these contacts where it differs by kinds; 0 without friction."""
        return float(np.max(_coefficients(self.scene, self.contacts), initial=0.0))

    def _held_c(self) -> NDArray[np.bool_]:
        rattling = self.rattlers_n
        return np.asarray(self.bearing_c & ~(rattling[self.contacts.i_c] | rattling[self.contacts.j_c]))


def _cross(one: NDArray[np.float64], other: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (C, 1 or 3) cross products of (C, d) vectors."""
    if one.shape[1] == 3:
        return np.cross(one, other)
    return np.asarray((one[:, 0] * other[:, 1] - one[:, 1] * other[:, 0])[:, None])


def _coefficients(scene: Scene, contacts: Contacts | ShapeContacts) -> Any:
    """Return Coulomb's coefficient, or those of the (C,) contacts where it differs by kinds."""
    return number_at(friction_or_zero(scene.effects).coefficient, contacts.kinds_c)


@honors(
    "repulsion kinds friction rolling gravity walls held links shapes rough mesh",
    at_rest=True,
    link_tolerance=STRAINED,
)
def contact_forces(scene: Scene) -> ContactForces:
    """Return the forces of all touching pairs of a scene at rest, friction included, and counts made of them.

    Tangential forces are the stiffness of `Friction` times the packing's tangential displacements
    (`Packing.tangential`, which runs leave there), cut at the coefficient times the normal force. Walls have contacts
    of their own (`wall_contacts`); what they do, and weights, count in the net forces.

    Parameters
    ----------
    scene
        The scene.

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
    return resting_forces(scene)


def resting_forces(
    scene: Scene, *, second: bool = False, near: Contacts | ShapeContacts | None = None
) -> ContactForces:
    """Return the forces of all touching pairs of a scene, whatever else it holds (`contact_forces`).

    Parameters
    ----------
    scene
        The scene.
    second
        Whether the curvatures of their distances are asked for, too.
    near
        Contacts found before, without those that no effect acts on, every pair that overlaps among them; None: they are
        searched for.

    """
    instance("scene", scene, Scene)
    refuse_unknown_to_shapes(scene)
    if near is None:
        contacts = acting_contacts(touching_pairs(scene.packing, second=second), scene.effects)
    else:
        contacts = near.select(near.gap_c <= 0.0)
    terms = contact_terms(scene.effects, contacts)
    # 0 - u', so that a contact without a force has 0 and not -0
    normal = 0.0 - terms.first_c * contacts.push_c
    cap = under_cap(scene.effects, normal, contacts)
    across = tangential_forces(scene, contacts, cap).force_cd
    return ContactForces(scene, contacts, normal, across)


class SinglePush(NamedTuple):
    """What effects on single particles do: (N, d) forces, (N, 1 or 3) torques, and the terms that these are of.

    What rough walls do across is among forces and torques; `springs` is the energy of their springs.
    """

    force_nd: NDArray[np.float64]
    torque_nk: NDArray[np.float64]
    terms: SingleTerms | ShapedTerms
    springs: float


def single_push(scene: Scene) -> SinglePush:
    """Return the forces and torques of what acts on single particles: walls turn shapes, and rough ones all."""
    packing, d = scene.packing, scene.packing.dimension
    if packing.shapes.has_orientations:
        shaped = shaped_terms(scene.effects, packing)
        return SinglePush(-shaped.slope_nx[:, :d], -shaped.slope_nx[:, d:], shaped, 0.0)
    terms, sides = single_terms(scene.effects, packing), wall_sides(scene.effects, packing)
    force, torque = np.zeros_like(packing.position_nd), np.zeros((packing.particles, 1 if d == 2 else 3))
    if not sides:
        return SinglePush(terms.force_nd, torque, terms, 0.0)
    across = wall_springs(packing, sides)
    particle = particles_at_walls(sides)
    np.add.at(force, particle, across.force_wd)
    np.add.at(torque, particle, across.torque_wk)
    return SinglePush(terms.force_nd + force, torque, terms, float(across.energy_w.sum()))


def rounding_force(packing: Packing, second_c: NDArray[np.float64]) -> float:
    """Return what rounding of the coordinates makes of net forces that balance, by u'' of the contacts [force]."""
    largest = max(np.abs(packing.position_nd).max(), np.abs(packing.box.lattice_dd).max())
    return float(np.spacing(largest)) * float(np.abs(second_c).mean()) if len(second_c) else 0.0


def force_residual(scene: Scene) -> float:
    """Return the largest net force on a particle over the mean contact force, friction included [1].

    Torques count over radii, and 0 is returned where nothing touches. It is that of the whole scene: what the contacts
    of rattlers do not balance is in it.
    """
    return resting_forces(scene).residual


def force_balance(scene: Scene) -> tuple[float, float]:
    """Return the largest net force and the mean contact force [force]; both 0 when nothing touches.

    Their ratio is the residual of a run (`ContactForces.residual`).
    """
    found = resting_forces(scene)
    mean = found.mean_force
    return (found.largest_imbalance, mean) if mean > 0.0 else (0.0, 0.0)


def contact_stress(contacts: Contacts, first_c: NDArray[np.float64], volume: float) -> NDArray[np.float64]:
    """Return the (d, d) stress of contacts with radial derivatives first_c [force], tension positive.

    Parameters
    ----------
    contacts
        The contacts.
    first_c
        (C,) du/dr, negative for repulsion.
    volume
        Volume of the box [length^d].

    """
    weighted = contacts.normal_cd * (first_c * contacts.distance_c)[:, None]
    stress: NDArray[np.float64] = np.einsum("ca,cb->ab", weighted, contacts.normal_cd) / volume
    return stress


@honors(
    "repulsion kinds friction rolling bonds interactions gravity walls held links shapes breaking memory rough mesh",
    at_rest=True,
    link_tolerance=STRAINED,
)
def torques(scene: Scene) -> NDArray[np.float64]:
    """Return the net torques about each center: (N,) in the plane, (N, 3) in space [force * length].

    Discs and spheres feel those of friction and of resistance to rolling (`contact_forces`), ellipses, spheroids and
    rigid bodies those of their contacts and of walls, too. Held ones have none.

    Parameters
    ----------
    scene
        The scene.

    Examples
    --------
    >>> import packmech as pm
    >>> pm.torques(pm.Scene(pm.lattice_packing("square", repeats=(2, 2)), (pm.Repulsion(),))).tolist()
    [0.0, 0.0, 0.0, 0.0]

    """
    instance("scene", scene, Scene)
    found = resting_forces(scene).torque_nk
    return found[:, 0] if found.shape[1] == 1 else found


def rattlers_in(scene: Scene) -> NDArray[np.bool_]:
    """Return (N,) which particles of a scene at rest rattle: by friction, weights, walls and links, too.

    With links, particles that move apart from the backbone; where something acts on single particles beside links,
    clusters that can be moved as a whole.
    """
    packing, effects = scene.packing, scene.effects
    if packing.tangential is not None or friction_of(effects) is not None or rough_walls(effects):
        return resting_forces(scene).rattlers_n
    if packing.links and not acts_on_single(effects):
        return find_rattling_clusters(packing).rattling_n
    return rattlers_among(packing, acting_contacts(touching_pairs(packing, None), effects), effects)
