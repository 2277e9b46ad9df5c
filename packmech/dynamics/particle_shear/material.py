# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""The contact's constants and its normal elastic law, as the reference package has them."""

from __future__ import annotations

import math
from typing import NamedTuple

from packmech import check
from packmech.compiled import device


class Material(NamedTuple):
    """Constants of one contact: springs, dashpots, friction, the shape of the normal law. All per metre of depth.

    Parameters
    ----------
    stiffness
        Normal spring k [1e-6 N/m].
    viscosity
        Normal dashpot eta [mg/s].
    tangential_stiffness
        Tangential spring k_T [1e-6 N/m].
    tangential_viscosity
        Tangential dashpot eta_T [mg/s].
    friction_coefficient
        Largest tangential force over the elastic normal force [1].
    divergence
        Share of the divergent law S1-5b in the repulsion; 0 is the linear law S1-5a [1].
    bond_normal_ratio, bond_tangential_ratio
        Springs of permanent bonds over those of contacts [1].
    bond_viscosity_follows
        Whether the dashpots of bonds take the same ratios; 1 or 0.
    plateau_begin, plateau_end, plateau_slope
        The plateau law: between these fractions of the contact distance the repulsion rises with this slope instead of
        1. A slope of 1 is the law without a plateau [1].
    tensile_range
        Range of the saturating tension of bonds, in rest lengths; 0 is linear tension [1].

    Examples
    --------
    >>> normal_force(Material(stiffness=2.0), 0.9, 1.0)  # linear: 2 (1 - 0.9), repulsive
    -0.19999999999999996

    """

    stiffness: float = 1.0
    viscosity: float = 0.0
    tangential_stiffness: float = 0.0
    tangential_viscosity: float = 0.0
    friction_coefficient: float = 0.0
    divergence: float = 0.0
    bond_normal_ratio: float = 1.0
    bond_tangential_ratio: float = 1.0
    bond_viscosity_follows: float = 1.0
    plateau_begin: float = 0.3
    plateau_end: float = 0.8
    plateau_slope: float = 1.0
    tensile_range: float = 0.0

    def checked(self) -> Material:
        """Return the same constants as floats after checking each.

        Raises
        ------
        ValueError
            If one is negative or not finite, or the plateau ends before it begins.

        """
        numbers = [check.real(name, value, at_least=0.0) for name, value in zip(self._fields, self, strict=True)]
        good = Material(*numbers)
        check.real("divergence", good.divergence, at_least=0.0, at_most=1.0)
        if not 0.0 < good.plateau_begin <= good.plateau_end <= 1.0:
            raise ValueError(
                "plateau_begin and plateau_end must be in order inside (0, 1], "
                f"got {good.plateau_begin} and {good.plateau_end}"
            )
        return good


@device
def repulsion(material, distance, rest, ratio):
    """Return the elastic normal force between discs that touch at `rest`, where `ratio` is rest/distance; it is <= 0.

    S1-5a and S1-5b, blended. The documented limit of S1-6 is 1000 k d0; the package stops at 999 k d0, where the
    distance is cut at d0/1000.
    """
    d = distance
    if material.plateau_slope != 1.0:
        begin, end, slope = material.plateau_begin * rest, material.plateau_end * rest, material.plateau_slope
        if d < begin:
            d = d / begin * (end + (begin - end) * slope)
        elif d < end:
            d = end + (d - end) * slope
        ratio = rest / max(d, rest / 1000.0)
    if d > rest:
        return 0.0
    share = material.divergence
    return -material.stiffness * ((1.0 - share) * (rest - d) + share * rest * (min(ratio, 1000.0) - 1.0))


@device
def tension(material, stretch, rest):
    """Return the pull of a permanent bond longer than its rest length, before its ratio: linear or saturating."""
    if material.tensile_range > 0.0:
        reach = rest * material.tensile_range
        return material.stiffness * reach * (1.0 - math.exp(-stretch / reach))
    return material.stiffness * stretch


@device
def normal_force(material, distance, rest):
    """Return the elastic normal force of a contact [1e-12 N/m]; negative repels."""
    return repulsion(material, distance, rest, rest / max(distance, rest / 1000.0))


@device
def bond_force(material, distance, rest):
    """Return the elastic normal force of a permanent bond [1e-12 N/m]; negative repels."""
    if distance < rest:
        return material.bond_normal_ratio * normal_force(material, distance, rest)
    return material.bond_normal_ratio * tension(material, distance - rest, rest)
