"""The reference model's material: constants from physical properties (S1-7 to S1-14), and the contact's law."""

from __future__ import annotations

import math
from typing import NamedTuple

from packmech import check
from packmech.effects import material as native
from packmech.jit.compiled import device


def contact_stiffness(young_modulus: float) -> float:
    """Return the normal spring constant k of parallel cylinders, pi E / 8 [1e-6 N/m per m] (S1-7, S1-8).

    The package leaves Poisson's ratio out, which is at most 25 % off.

    Examples
    --------
    >>> f"{contact_stiffness(8000.0):.6e}"
    '3.141593e+09'

    """
    return 1e6 * native.contact_stiffness(young_modulus)


def disc_radii(
    particles: int, packing_fraction: float, *, size_ratio: float = 1.4, width: float = 500.0, height: float = 500.0
) -> tuple[float, float]:
    """Return the large and the small radius [um] of an equal mixture of that packing fraction (S1-14).

    Parameters
    ----------
    particles
        Number of discs.
    packing_fraction
        Summed area of the discs over the cell's [1].
    size_ratio
        Large over small radius, at least 1.
    width, height
        Sides of the cell [um].

    Examples
    --------
    >>> [round(radius, 3) for radius in disc_radii(150, 1.5)]
    [32.463, 23.188]

    """
    ratio = check.real("size_ratio", size_ratio, at_least=1.0)
    base = _mean_radius(particles, packing_fraction, width, height) * math.sqrt(2.0 / (ratio + 1.0 / ratio))
    return base * math.sqrt(ratio), base / math.sqrt(ratio)


def _mean_radius(particles: int, packing_fraction: float, width: float, height: float) -> float:
    area = check.positive("width", width) * check.positive("height", height)
    count = check.integer("particles", particles, at_least=1)
    return math.sqrt(area * check.positive("packing_fraction", packing_fraction) / (count * math.pi))


def model_mass(
    particles: int, packing_fraction: float, density: float, *, width: float = 500.0, height: float = 500.0
) -> float:
    """Return the mass [mg/m] of a disc whose area is the mean one; the unit of mass of the package's models.

    The package then gives a disc of radius r the mass of (r/r_0)^2 of these, with r_0 from another mean, so that its
    true density is (b + 1/b)/2 times the nominal one, for a size ratio b.

    Parameters
    ----------
    particles, packing_fraction, width, height
        As for `disc_radii`.
    density
        [kg/m^3].

    Examples
    --------
    >>> round(model_mass(100, 1.5, 50.0), 10)
    0.1875

    """
    radius = _mean_radius(particles, packing_fraction, width, height)
    return math.pi * radius**2 * check.positive("density", density) * 1e-6


def time_constant(mass: float, stiffness: float) -> float:
    """Return tau = sqrt(m/k) [s], for a mass [mg/m] and a stiffness [1e-6 N/m per m]."""
    return math.sqrt(check.positive("mass", mass) / check.positive("stiffness", stiffness))


def contact_viscosity(mass: float, stiffness: float, *, relative: float = 0.1) -> float:
    """Return the dashpot's constant eta, `relative` times sqrt(m k) [mg/s per m] (S1-9).

    Examples
    --------
    >>> contact_viscosity(0.25, 1e8)
    500.0

    """
    share = check.real("relative", relative, at_least=0.0)
    return share * check.positive("stiffness", stiffness) * time_constant(mass, stiffness)


def package_time_step(
    tau: float,
    *,
    size_ratio: float = 1.4,
    amplitude: float = 0.2,
    friction_coefficient: float = 0.01,
    relative_viscosity: float = 0.1,
    tangential_ratio: float = 1.0,
) -> float:
    """Return the time step that the package takes [s]; it depends on the amplitude, so its error does too.

    Parameters
    ----------
    tau
        `time_constant` [s].
    size_ratio, amplitude, friction_coefficient, relative_viscosity, tangential_ratio
        As for `ParticleShear` [1].

    Examples
    --------
    >>> round(package_time_step(1.0) * 1.4, 12)
    0.025

    """
    mu, ratio = friction_coefficient, tangential_ratio
    longest = package_longest_step(
        tau,
        size_ratio=size_ratio,
        friction_coefficient=mu,
        relative_viscosity=relative_viscosity,
        tangential_ratio=ratio,
    )
    strain = check.positive("amplitude", amplitude)
    halvings = [mu <= 1.0 or ratio < 1.0, strain <= 0.05, mu <= 0.1 or ratio < 0.1, strain <= 0.005, strain >= 0.5]
    return min(0.1 * tau / size_ratio * 0.5 ** sum(halvings), longest)


def package_longest_step(
    tau: float,
    *,
    size_ratio: float = 1.4,
    friction_coefficient: float = 0.01,
    relative_viscosity: float = 0.1,
    tangential_ratio: float = 1.0,
) -> float:
    """Return the longest time step that the package takes while it prepares discs [s].

    Parameters
    ----------
    tau
        `time_constant` [s].
    size_ratio, friction_coefficient, relative_viscosity, tangential_ratio
        As for `ParticleShear` [1].

    Examples
    --------
    >>> round(package_longest_step(1.0) * 1.4, 12)
    0.125

    """
    mu, visc, ratio = friction_coefficient, relative_viscosity, tangential_ratio
    for name, value in (("friction_coefficient", mu), ("relative_viscosity", visc), ("tangential_ratio", ratio)):
        check.real(name, value, at_least=0.0)
    longest = 0.25
    if (visc <= 0.1 and mu < 0.1) or ratio < 0.1 or ratio > 5.0:
        longest = 0.125
    if (visc < 0.01 and mu < 0.01) or ratio < 0.01:
        longest = 0.04
    return longest * check.positive("tau", tau) / check.real("size_ratio", size_ratio, at_least=1.0) / max(visc, 1.0)


# mypy: disable-error-code="no-untyped-def, no-untyped-call"


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
    """Return the elastic normal force of a contact [1e-12 N/m]; negative repels.

    Examples
    --------
    >>> normal_force(Material(stiffness=2.0), 15.0, 20.0)
    -10.0

    """
    return repulsion(material, distance, rest, rest / max(distance, rest / 1000.0))


@device
def bond_force(material, distance, rest):
    """Return the elastic normal force of a permanent bond [1e-12 N/m]; negative repels.

    Examples
    --------
    >>> bond_force(Material(stiffness=2.0), 25.0, 20.0)
    10.0

    """
    if distance < rest:
        return material.bond_normal_ratio * normal_force(material, distance, rest)
    return material.bond_normal_ratio * tension(material, distance - rest, rest)
