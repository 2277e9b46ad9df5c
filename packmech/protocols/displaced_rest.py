"""Rest at pressures whose overlaps are near rounding: displacements from a reference packing keep all digits."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray

from packmech.calls.honors import honors
from packmech.calls.status import shown_as
from packmech.check import BoxStrain, boolean, instance, integer, one_of, positive, real
from packmech.contacts import Contacts
from packmech.contacts.exact_gaps import ExactPairs
from packmech.contacts.network import Candidates, candidate_pairs, pair_contacts
from packmech.contacts.pairs import are_among
from packmech.effects import ContactTerms, Touches, at_distances, contact_terms
from packmech.jamming.hard_packing import contact_system
from packmech.jit.blas import single_thread
from packmech.linalg.mandel import mandel_basis, strain_directions
from packmech.measure.rattlers import find_rattlers
from packmech.packing import Packing
from packmech.result import Condition, NotConverged, Outcome, Run, unmet_conditions
from packmech.scene import Scene

# pairs whose gaps in the reference are below so many mean overlaps may come to bear
_REACH = 100.0
# pressure in units of the energy scale above which that reaches beyond the next neighbors [1]
_HIGHEST = 0.01
# stiffness of a contact that is open, and of every particle, in the matrix of a step, over the smallest that bears
_OPEN, _HOLD = 1e-9, 1e-12
# balance that is enough at a pressure on the way [1]
_ON_THE_WAY = 1e-4
# laws are asked for overlaps of at least this part of the contact distance, and go on as a power from there [1]
_SHALLOWEST = 2.0**-40
# overlaps of other pairs within so many roundings of a position are none
_ROUNDINGS = 8.0
# steps without progress
_IDLE = 6
# largest multiple of a step, and halvings to find the lowest place along it
_FURTHEST, _BISECTIONS = 1e3, 40


def terms_at_overlap(effects: tuple[object, ...], touches: Touches, overlap_c: NDArray[np.float64]) -> ContactTerms:
    """Return energy, du/dr and d2u/dr2 of contacts whose overlaps are known better than their distances.

    A law is given distances, whose difference from the contact distance is rounded. Near that rounded overlap it is
    continued as a power, u' = A overlap^p with p = u'' overlap / u': exact for springs, Hertz and every power law, and
    to a part of the overlap, squared, for others.

    Parameters
    ----------
    effects
        The scene's effects.
    touches
        The contacts, whose contact distances, radii and kinds are taken.
    overlap_c
        (C,) overlaps [length]; those that are not positive have no energy and no force.

    Examples
    --------
    >>> import packmech as pm
    >>> from packmech.effects import equal_touches
    >>> spring = (pm.Repulsion(law=pm.LinearSpring()),)
    >>> terms = terms_at_overlap(spring, equal_touches(np.ones(1), np.ones(1)), np.array([1.25e-14]))
    >>> float(terms.first_c[0]), float(terms.second_c[0])
    (-1.25e-14, 1.0)

    """
    sigma_c = np.asarray(touches.contact_distance_c)
    distance_c = sigma_c - np.maximum(overlap_c, _SHALLOWEST * sigma_c)
    there = contact_terms(effects, at_distances(touches, distance_c))
    rounded_c = sigma_c - distance_c
    part_c = np.maximum(overlap_c, 0.0) / rounded_c
    power_c = np.zeros_like(part_c)
    np.divide(-there.second_c * rounded_c, there.first_c, out=power_c, where=there.first_c != 0.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        weaker_c = np.where(part_c > 0.0, part_c**power_c, 0.0)
        second_c = np.where(part_c > 0.0, there.second_c * weaker_c / part_c, 0.0)
    return ContactTerms(there.energy_c * weaker_c * part_c, there.first_c * weaker_c, second_c)


@dataclass(frozen=True, eq=False, repr=False)
class DisplacedRest(Run):
    """Forces in balance at a tiny pressure, as displacements from a reference packing.

    `packing` is the sum of both, whose overlaps are rounded; `residual` is that of the exact overlaps.

    Attributes
    ----------
    reference
        The packing that displacements start from; its coordinates and radii are taken as exact.
    displacement_nd
        (N, d) displacements beyond what the gradient takes along [length]; those of rattlers are zero.
    gradient_dd
        (d, d) displacement gradient of the box, symmetric: lattice vectors are (1 + gradient) lattice.
    contacts
        The contacts that bear, where they are; their own `gap_c` is rounded.
    overlap_c, normal_c
        (C,) their overlaps [length] and forces [force].
    pressure
        Pressure of these forces [energy_scale / diameter^d].

    """

    reference: Packing = field(kw_only=True)
    displacement_nd: NDArray[np.float64] = field(kw_only=True)
    gradient_dd: NDArray[np.float64] = field(kw_only=True)
    contacts: Contacts = field(kw_only=True)
    overlap_c: NDArray[np.float64] = field(kw_only=True)
    normal_c: NDArray[np.float64] = field(kw_only=True)
    pressure: float = field(kw_only=True)


class _Balance:
    """Pairs that may bear, their exact gaps, forces, and what these lack."""

    def __init__(self, scene: Scene, near: Contacts, basis_kdd: NDArray[np.float64]) -> None:
        self.scene, self.near, self.basis_kdd = scene, near, basis_kdd
        self.exact = ExactPairs(scene.packing, near.pairs)
        self.u_nd = np.zeros_like(scene.packing.position_nd)
        self.strain_k = np.zeros(len(basis_kdd))
        self.trace_k = np.einsum("kaa->k", basis_kdd)
        self.load_k = np.zeros(len(basis_kdd))
        self.measure()

    @property
    def pressure(self) -> float:
        """The pressure of the forces [energy/length^d]."""
        packing = self.scene.packing
        return float((self.force_c * self.now.distance_c).sum()) / packing.dimension / packing.box.volume

    def press(self, pressure: float) -> None:
        """Take another pressure for the goal [energy/length^d]."""
        self.load_k = pressure * self.scene.packing.box.volume * self.trace_k
        self.measure()

    @property
    def gradient_dd(self) -> NDArray[np.float64]:
        """The displacement gradient."""
        return np.asarray(np.einsum("k,kab->ab", self.strain_k, self.basis_kdd))

    def measure(self) -> None:
        """Take the displacements in: forces, and what is missing of balance."""
        vector_cd, gap_c = self.exact.displaced(self.u_nd, self.gradient_dd)
        distance_c = np.sqrt((vector_cd**2).sum(axis=1))
        self.overlap_c = -gap_c
        self.now = replace(self.near, normal_cd=vector_cd / distance_c[:, None], distance_c=distance_c)
        terms = terms_at_overlap(self.scene.effects, self.now, self.overlap_c)
        self.force_c, self.stiffness_c = -terms.first_c, terms.second_c
        self.system = contact_system(self.now, self.basis_kdd)
        self.net = -self.system.gather(self.force_c)
        self.missing_k = self.load_k - self.system.stretch_ck.T @ self.force_c
        bearing = self.force_c != 0.0
        mean = float(self.force_c[bearing].mean()) if bearing.any() else 0.0
        largest = float(np.sqrt((self.net.reshape(self.u_nd.shape) ** 2).sum(axis=1)).max())
        stress, load = float(np.abs(self.missing_k).max()), float(np.abs(self.load_k).max())
        self.residual = max(largest / mean, stress / load) if mean > 0.0 and load > 0.0 else np.inf

    def step(self) -> None:
        """Go to balance of the contacts as springs, which is all but exact at small overlaps."""
        # what keeps the matrix regular is little beside the softest of them
        softest = float(self.stiffness_c.min(where=self.stiffness_c > 0.0, initial=np.inf))
        hold, system = _HOLD * softest, self.system
        system.factor(
            np.maximum(self.stiffness_c, _OPEN * softest), np.where(system.live_n, hold, 1.0), hold * len(self.u_nd)
        )
        u_nd, strain_k = self.system.solve(-self.net, -self.missing_k)
        size = self._lowest(self.system.extend(u_nd, strain_k), float(self.load_k @ strain_k))
        self.go_to(self.u_nd + size * u_nd, self.strain_k + size * strain_k)

    def go_to(self, u_nd: NDArray[np.float64], strain_k: NDArray[np.float64]) -> None:
        """Take other displacements."""
        self.u_nd, self.strain_k = u_nd, strain_k
        self.measure()

    def _lowest(self, growth_c: NDArray[np.float64], work: float) -> float:
        """Return how far along a step the enthalpy is lowest, which is convex where no contact turns."""

        def slope(size: float) -> float:
            terms = terms_at_overlap(self.scene.effects, self.now, self.overlap_c - size * growth_c)
            return work + float(terms.first_c @ growth_c)

        # while no contact opens or closes springs are at their minimum after a whole step
        if abs(slope(1.0)) <= _ON_THE_WAY * abs(slope(0.0)):
            return 1.0
        low, high = 0.0, 1.0
        while slope(high) < 0.0 and high < _FURTHEST:
            low, high = high, 2.0 * high
        for _ in range(_BISECTIONS):
            middle = 0.5 * (low + high)
            low, high = (middle, high) if slope(middle) < 0.0 else (low, middle)
        return 0.5 * (low + high)


def _bearing_pairs(packing: Packing, depth: float) -> Contacts:
    """Return the pairs of particles that do not rattle that touch, or may under a few of these relative overlaps."""
    held_n = ~find_rattlers(packing)
    pairs = candidate_pairs(packing.position_nd, packing.radius_n, packing.box, scale=1.0 + _REACH * depth)
    kept = held_n[pairs.i_c] & held_n[pairs.j_c]
    return pair_contacts(packing, *Candidates(*(column[kept] for column in pairs)))


@shown_as("rest at a tiny pressure")
@honors("repulsion kinds", at_rest=True)
def displaced_rest(
    scene: Scene,
    *,
    pressure: float,
    strain: BoxStrain = "isotropic",
    force_tolerance: float = 1e-10,
    step_limit: int = 30,
    check: bool = True,
) -> DisplacedRest:
    """Return forces in balance at a tiny pressure, as displacements from the packing of the scene.

    Positions are rounded to 1e-16 of the box, and overlaps at a pressure of 1e-12 are 1e-12 of a diameter: of their
    forces, four digits or fewer are left (`report["rounding_floor"]` of `jam`). Here the packing of the scene is a
    reference whose coordinates are exact, displacements from it are numbers of the size of the overlaps, and gaps of
    the reference are found to thirty digits: forces keep all digits at any pressure. Newton's method takes the network
    of contacts as springs, with those that open left out; contacts that touch, or nearly, in the reference may bear.

    Parameters
    ----------
    scene
        Discs or spheres, jammed: what `jam` returned at that pressure or, where its forces are rounded so much that
        contacts are lost, up to a thousand times above: displacements round by 1e-16 of the overlaps there, which are
        a thousand of those at the end, and 1024 discs balance to 3e-11 then.
    pressure
        Pressure at the end [energy_scale / diameter^d]; at most .01, as overlaps are to be small.
    strain
        "isotropic": the box keeps its shape; "free": all strains relax. As the packing was jammed.
    force_tolerance
        Largest net force over mean contact force, and missing stress over pressure, that count as balance [1].
    step_limit
        Largest number of steps.
    check
        Raise NotConverged when forces do not balance to the tolerance; otherwise return what was reached.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, or nothing in the packing bears.
    NotConverged
        If the tolerance was not met and `check` is set.

    Examples
    --------
    >>> import packmech as pm
    >>> scene = pm.Scene(pm.random_packing(32, dimension=2, packing_fraction=0.87, seed=1), (pm.Repulsion(),))
    >>> run = pm.jam(scene, pressure=1e-12, strain="isotropic")
    >>> fine = pm.displaced_rest(scene.replace(packing=run.packing), pressure=1e-12)
    >>> run.residual > 1e-4, fine.residual < 1e-10, round(fine.pressure / 1e-12, 9)
    (True, True, 1.0)

    """
    instance("scene", scene, Scene)
    goal, tolerance = (
        real("pressure", pressure, above=0.0, at_most=_HIGHEST),
        positive("force_tolerance", force_tolerance),
    )
    one_of("strain", strain, ("isotropic", "free"))
    limit = integer("step_limit", step_limit, at_least=0)
    boolean("check", check)
    began = time.process_time()
    packing, unit = scene.packing, scene.pressure_unit
    d = packing.dimension
    basis = np.einsum("sk,sab->kab", strain_directions(d, strain), mandel_basis(d))
    touching = pair_contacts(packing, *candidate_pairs(packing.position_nd, packing.radius_n, packing.box))
    depth = float(touching.overlap_c.mean()) if len(touching) else 0.0
    near = _bearing_pairs(packing, max(depth, goal))
    if not len(near):
        raise ValueError("scene must be a jammed packing, got one in which no particles bear a force")
    with single_thread():
        balance = _Balance(scene, near, basis)
        steps = 0
        for now in _pressures(balance.pressure / unit, goal):
            balance.press(now * unit)
            outcome, used = _settle(balance, tolerance if now == goal else max(tolerance, _ON_THE_WAY), limit - steps)
            steps += used
            if not outcome.ok:
                break
    found = _finished(balance, outcome, tolerance, steps, time.process_time() - began)
    if check and not found.ok:
        raise NotConverged(found)
    return found


def _pressures(start: float, goal: float) -> list[float]:
    """Return pressures from one to another, each at most ten times the last: what a step moves it rounds by."""
    decades = abs(float(np.log10(goal / start))) if start > 0.0 else 0.0
    return [*np.geomspace(start, goal, int(np.ceil(decades)) + 1)[1:-1].tolist(), goal] if decades > 1.0 else [goal]


def _settle(balance: _Balance, tolerance: float, limit: int) -> tuple[Outcome, int]:
    """Take steps until forces balance, and return how it ended and after how many steps."""
    best, place, idle = balance.residual, (balance.u_nd, balance.strain_k), 0
    outcome, steps = Outcome.STEP_LIMIT, 0
    for steps in range(limit + 1):
        if balance.residual < best:
            idle = 0 if balance.residual < 0.5 * best else idle + 1
            best, place = balance.residual, (balance.u_nd, balance.strain_k)
        else:
            idle += steps > 0
        # contacts that open and close may raise it on the way
        if best <= tolerance or idle > _IDLE:
            outcome = Outcome.CONVERGED if best <= tolerance else Outcome.STALLED
            break
        if steps < limit:
            try:
                balance.step()
            except np.linalg.LinAlgError:
                # so many contacts are open that nothing holds the rest
                outcome = Outcome.STALLED
                break
    if balance.residual != best:
        balance.go_to(*place)
    return outcome, steps


def _unlisted(balance: _Balance, packing: Packing) -> int:
    """Return how many pairs that were not looked at overlap, by more than rounding, in the packing at the end.

    They are pairs of particles that rattle, or that came from afar.
    """
    now = pair_contacts(packing, *candidate_pairs(packing.position_nd, packing.radius_n, packing.box))
    deep = -now.gap_c > _ROUNDINGS * packing.rounding * float(packing.radius_n.min())
    return int(np.count_nonzero(deep & ~are_among(now, balance.near)))


def _finished(balance: _Balance, outcome: Outcome, tolerance: float, steps: int, seconds: float) -> DisplacedRest:
    scene, packing = balance.scene, balance.scene.packing
    bearing, gradient_dd = balance.force_c != 0.0, balance.gradient_dd
    position_nd = packing.position_nd + balance.u_nd + packing.position_nd @ gradient_dd.T
    moved = packing.replace(position_nd=position_nd, box=packing.box.strained(gradient_dd))
    others = _unlisted(balance, moved)
    outcome = Outcome.STALLED if others else outcome
    return DisplacedRest(
        moved,
        outcome,
        balance.residual,
        steps,
        steps + 1,
        seconds,
        unmet=unmet_conditions(
            outcome,
            Condition("force residual", balance.residual, tolerance),
            Condition("pairs that overlap and were not among those near contact", others, 0),
        ),
        reference=packing,
        displacement_nd=balance.u_nd,
        gradient_dd=gradient_dd,
        contacts=balance.now.select(bearing),
        overlap_c=balance.overlap_c[bearing],
        normal_c=balance.force_c[bearing],
        pressure=balance.pressure / scene.pressure_unit,
    )
