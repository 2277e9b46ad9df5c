"""Forces of discs and spheres in exact arithmetic: what displacements from a reference packing are held against."""

from __future__ import annotations

from dataclasses import dataclass
from decimal import Decimal, localcontext
from fractions import Fraction

import numpy as np

import packmech as pm

_DIGITS = 60


@dataclass(frozen=True)
class ExactForces:
    """What exact arithmetic makes of harmonic contacts: net forces and errors of single forces, over the mean force."""

    residual: float
    force_error: float


def _ratio(number: Fraction) -> Decimal:
    return Decimal(number.numerator) / Decimal(number.denominator)


def exact_forces(fine: pm.DisplacedRest) -> ExactForces:
    """Return what the forces of a harmonic law of energy 1 are, its numbers taken as they stand, to sixty digits."""
    contacts, packing, d = fine.contacts, fine.reference, fine.reference.dimension
    place = [[Fraction(float(x)) for x in row] for row in packing.position_nd]
    moved = [[Fraction(float(x)) for x in row] for row in fine.displacement_nd]
    lattice = [[Fraction(float(x)) for x in row] for row in packing.box.lattice_dd]
    gradient = [[Fraction(float(x)) for x in row] for row in fine.gradient_dd]
    net = [[Decimal(0)] * d for _ in range(packing.particles)]
    force_c = []
    with localcontext() as context:
        context.prec = _DIGITS
        for i, j, image in zip(contacts.i_c.tolist(), contacts.j_c.tolist(), contacts.image_cd.tolist(), strict=True):
            start = [place[j][a] - place[i][a] + sum(lattice[a][b] * image[b] for b in range(d)) for a in range(d)]
            vector = [
                start[a] + moved[j][a] - moved[i][a] + sum(gradient[a][b] * start[b] for b in range(d))
                for a in range(d)
            ]
            distance = _ratio(sum((x * x for x in vector), Fraction(0))).sqrt()
            sigma = _ratio(Fraction(float(packing.radius_n[i])) + Fraction(float(packing.radius_n[j])))
            force = (1 - distance / sigma) / sigma
            force_c.append(force)
            for a in range(d):
                push = _ratio(vector[a]) / distance * force
                net[j][a] += push
                net[i][a] -= push
        mean = sum(force_c, Decimal(0)) / len(force_c)
        residual = max(float(sum((x * x for x in one), Decimal(0)).sqrt() / mean) for one in net)
        error = [
            float((exact - Decimal(found)) / mean) for exact, found in zip(force_c, fine.normal_c.tolist(), strict=True)
        ]
    return ExactForces(residual, float(np.abs(error).max()))


def as_it_stands(packing: pm.Packing, contacts: pm.Contacts) -> pm.DisplacedRest:
    """Return a packing as a reference that nothing is displaced from, with the overlaps of its rounded differences."""
    d, sigma = packing.dimension, contacts.contact_distance_c
    return pm.DisplacedRest(
        packing, pm.Outcome.CONVERGED, 0.0, 0, 0, 0.0,
        reference=packing, displacement_nd=np.zeros_like(packing.position_nd), gradient_dd=np.zeros((d, d)),
        contacts=contacts, overlap_c=-contacts.gap_c, normal_c=-contacts.gap_c / sigma**2, pressure=0.0,
    )  # fmt: skip
