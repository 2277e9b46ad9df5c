"""What a verdict assumes: which pairs touch, and whether the packing is at rest."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.constraints.factor import ConstraintFactor
from packmech.constraints.motion_rules import link_rules
from packmech.contacts import Contacts, find_contacts
from packmech.contacts.rattlers import rattlers_of
from packmech.effects import Harmonic, Repulsion, contact_terms
from packmech.measure.contact_forces import rounding_force
from packmech.measure.rattlers import rattling_particles
from packmech.measure.stress import sum_forces
from packmech.packing import Packing

# gap tolerance in mean relative overlaps, and the smallest one: rounding of exact crystals and hard-particle packings
OVERLAPS = 7.0
MINIMUM_GAP_TOLERANCE = 1e-9
# net forces below this many rounding floors are zero within the error
FLOORS = 8.0


@dataclass(frozen=True)
class GapLevel:
    """The contact network at one gap tolerance.

    Attributes
    ----------
    tolerance
        Largest gap relative to the contact distance [1].
    contacts, particles
        Counts after rattlers were taken out, and with them their contacts.
    excess
        Contacts beyond the fewest that can jam these particles in a fixed box, d N' - N_l' - d + 1 with N_l' rigid
        links that do not depend on each other.

    """

    tolerance: float
    contacts: int
    particles: int
    excess: int


@dataclass(frozen=True, eq=False)
class ContactSelection:
    """The pairs that a verdict takes for contacts, and how that depends on the gap tolerance.

    Attributes
    ----------
    contacts
        The pairs, those of rattlers included.
    tolerance
        Largest gap relative to the contact distance [1]; NaN when the contacts were given.
    mean_overlap
        Mean of 1 - r/sigma over the overlapping pairs [1]; 0 when there are none.
    rule
        Where the tolerance came from.
    levels
        The network at a tenth of the tolerance, at the tolerance and at ten times; empty when the contacts were given.
    widest
        The pairs at ten times the tolerance; None when the contacts were given.
    backbone
        What `backbone_of` makes of the contacts; None when these were given.

    """

    contacts: Contacts
    tolerance: float
    mean_overlap: float
    rule: str
    levels: tuple[GapLevel, ...] = ()
    widest: Contacts | None = None
    backbone: tuple[Contacts, NDArray[np.int64]] | None = None

    def __str__(self) -> str:
        within = "as given" if self.rule == "given" else f"gaps up to {self.tolerance:.1e} ({self.rule})"
        return f"{len(self.contacts)} pairs, {within}"

    @property
    def on_plateau(self) -> bool:
        """Whether the excess contacts are the same at all levels, and all or none of the networks are empty."""
        # nothing at all counts as one in excess, like the square lattice
        return len({(level.excess, level.contacts > 0) for level in self.levels}) <= 1

    def within(self, level: int) -> Contacts:
        """Return the pairs within the tolerance of one of the levels, those of rattlers included."""
        widest = self.contacts if self.widest is None else self.widest
        return widest.select(widest.gap_c <= self.levels[level].tolerance * widest.contact_distance_c)


def backbone_contacts(contacts: Contacts) -> Contacts:
    """Return the contacts between particles that do not rattle."""
    return contacts.among(~rattlers_of(contacts))


def backbone_of(packing: Packing, contacts: Contacts) -> tuple[Contacts, NDArray[np.int64]]:
    """Return the contacts between particles that do not rattle, and the numbers of these particles.

    With rigid links the particles are held by them too, and need no contacts of their own.

    Parameters
    ----------
    packing
        The packing.
    contacts
        Its contacts, those of rattlers included.

    """
    rattling = rattling_particles(packing, contacts)
    return contacts.among(~rattling), np.flatnonzero(~rattling)


def select_contacts(packing: Packing, gap_tolerance: float | None) -> ContactSelection:
    """Return the contacts within a gap tolerance; by default max(7 x mean relative overlap, 1e-9).

    Parameters
    ----------
    packing
        The packing.
    gap_tolerance
        Largest gap relative to the contact distance [1], or None for the rule.

    """
    overlap = find_contacts(packing, gap_tolerance=0.0).overlap_c
    mean = float(overlap[overlap > 0].mean()) if (overlap > 0).any() else 0.0
    tolerance = max(OVERLAPS * mean, MINIMUM_GAP_TOLERANCE) if gap_tolerance is None else gap_tolerance
    rule = f"max({OVERLAPS:g} x mean overlap, {MINIMUM_GAP_TOLERANCE:g})" if gap_tolerance is None else "given"
    steps = (0.1 * tolerance, tolerance, 10.0 * tolerance) if tolerance > 0 else (tolerance,)
    widest = find_contacts(packing, gap_tolerance=steps[-1])
    gap = widest.gap_c / widest.contact_distance_c
    d = packing.dimension
    levels: list[GapLevel] = []
    backbone: tuple[Contacts, NDArray[np.int64]] | None = None
    # the pairs within one tolerance are among those within the next: as many are the same
    counts = [int(np.count_nonzero(gap <= step)) for step in steps]
    for k, step in enumerate(steps):
        if k and counts[k] == counts[k - 1]:
            levels.append(replace(levels[-1], tolerance=step))
        else:
            network, kept = backbone_of(packing, widest.select(gap <= step))
            particles = len(kept)
            fewest = d * particles - d + 1
            if particles:
                fewest -= link_rules(packing, kept).position.shape[0]
            levels.append(GapLevel(step, len(network), particles, len(network) - fewest))
        if step == tolerance:
            backbone = network, kept
    return ContactSelection(widest.select(gap <= tolerance), tolerance, mean, rule, tuple(levels), widest, backbone)


@dataclass(frozen=True)
class RestCheck:
    """Whether the net forces vanish.

    Attributes
    ----------
    residual
        Largest net force over the mean contact force [1]; 0 when nothing overlaps.
    floor
        What rounding of the coordinates makes of perfectly balanced forces, in the same unit.
    limit
        The residual up to which the packing counts as at rest: max(rest tolerance, 8 floors).
    law
        The law that the forces were taken from, and whether it was known or assumed.

    """

    residual: float
    floor: float
    limit: float
    law: str

    def __str__(self) -> str:
        answer = "at rest" if self.at_rest else "not at rest"
        return f"{answer}: net forces up to {self.residual:.1e} of the mean contact force, allowed {self.limit:.1e}"

    @property
    def at_rest(self) -> bool:
        """Whether the residual is within the limit."""
        return self.residual <= self.limit


def check_rest(packing: Packing, effects: tuple[Any, ...] | None, rest_tolerance: float) -> RestCheck:
    """Return how well the overlapping pairs balance, under the given effects or, failing those, a harmonic law.

    Rigid links bear what they can of the net forces.

    Overlaps of the size of rounding errors push the floor, and so the limit, above any residual: a packing of hard
    particles passes.

    Parameters
    ----------
    packing
        The packing.
    effects
        What acts, or None.
    rest_tolerance
        Largest net force over mean contact force [1] at rest.

    """
    law = "harmonic, assumed"
    if effects is None:
        effects = (Repulsion(law=Harmonic()),)
    else:
        law = ", ".join(repr(one) for one in effects)
    contacts = find_contacts(packing, gap_tolerance=0.0)
    contacts = contacts.select(contacts.overlap_c > 0)
    terms = contact_terms(effects, contacts)
    mean = float(np.abs(terms.first_c).mean()) if len(contacts) else 0.0
    if mean == 0.0:
        return RestCheck(0.0, 0.0, rest_tolerance, law)
    # diverging laws give infinite forces at coincident centers: the residual is no number then, and nothing is at rest
    with np.errstate(invalid="ignore", over="ignore"):
        net = sum_forces(contacts, -terms.first_c)
        if np.isfinite(net).all():
            links = ConstraintFactor(packing)
            # the multipliers balance minus the forces
            net = net - (links.gradient_lx.T @ links.multipliers(-net.ravel())).reshape(net.shape)
        residual = float(np.sqrt((net**2).sum(axis=1)).max()) / mean
        floor = rounding_force(packing, terms.second_c) / mean
    return RestCheck(residual, floor, max(rest_tolerance, FLOORS * floor), law)
