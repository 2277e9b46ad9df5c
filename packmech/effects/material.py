"""Model constants from what a material is made of: Young's modulus, Poisson's ratio, density, size.

Section 5 of particleShear's documentation (equations S1-7 to S1-14). A plane stands for a slice of parallel cylinders,
and everything extensive is per metre of its depth. Units that belong together: lengths in um, times in s, masses in kg
per m; stiffnesses and stresses are then in Pa, dashpots in Pa s, forces in 1e-6 N per m.
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from typing import Any

from packmech.calls.display import shown
from packmech.check import clear_errors, integer, positive, real
from packmech.effects.body import BackgroundDamping
from packmech.effects.damping import ContactDamping
from packmech.effects.friction import Friction
from packmech.effects.frictional_laws import DivergentRepulsion
from packmech.effects.repulsion import Repulsion

# density in kg/m^3 to kg per m of depth and um^2
_PER_SQUARE_UM = 1e-12


def contact_stiffness(young_modulus: float, *, poisson_ratio: float = 0.0) -> float:
    """Return the stiffness k = pi E / (8 (1 - nu^2)) of two parallel cylinders in contact [Pa] (S1-7, S1-8).

    Parameters
    ----------
    young_modulus
        E [Pa].
    poisson_ratio
        nu, from 0 (which particleShear takes; at most 25 % off) to 0.5 [1].

    Examples
    --------
    >>> round(contact_stiffness(8000.0), 3)
    3141.593

    """
    ratio = real("poisson_ratio", poisson_ratio, at_least=0.0, at_most=0.5)
    return math.pi / 8.0 * positive("young_modulus", young_modulus) / (1.0 - ratio * ratio)


@shown()
@dataclass(frozen=True, kw_only=True)
class MaterialConstants:
    """Constants of a plane model of a material; `material_constants` makes them.

    Attributes
    ----------
    stiffness, tangential_stiffness
        Springs k and k_T of a contact [Pa].
    damping, tangential_damping
        Dashpots eta and eta_T [Pa s].
    friction_coefficient
        mu [1].
    mean_mass
        m, of a particle [kg per m].
    density
        As packings take it (`pm.fill_box`), mass over area [kg per m and um^2].
    time
        tau = sqrt(m / k) [s].
    frequency
        Of the excitation [Hz].
    background_damping
        Rate at which velocities relax to the flow's [1/s].
    small_radius, large_radius
        Of the two sizes, half of the particles each [um].

    """

    stiffness: float
    tangential_stiffness: float
    damping: float
    tangential_damping: float
    friction_coefficient: float
    mean_mass: float
    density: float
    time: float
    frequency: float
    background_damping: float
    small_radius: float
    large_radius: float

    def effects(self, *, divergence: float = 1.0) -> tuple[Any, ...]:
        """Return what acts between particles and on them, without bonds; `divergence` is that of the repulsion."""
        frictional = Friction(self.friction_coefficient, self.tangential_stiffness, self.tangential_damping)
        return (
            Repulsion(DivergentRepulsion(self.stiffness, divergence)),
            ContactDamping(self.damping),
            *((frictional,) if self.friction_coefficient > 0.0 else ()),
            BackgroundDamping(self.background_damping),
        )


@clear_errors
def material_constants(
    *,
    young_modulus: float = 8000.0,
    poisson_ratio: float = 0.0,
    density: float = 1000.0,
    particles: int = 150,
    packing_fraction: float = 1.5,
    side: float = 500.0,
    size_ratio: float = 1.4,
    friction_coefficient: float = 0.01,
    relative_viscosity: float = 0.1,
    tangential_ratio: float = 1.0,
    relative_frequency: float = 0.025,
    period_decay: float = 0.5,
) -> MaterialConstants:
    """Return the constants of a plane model of a material; the defaults are those of particleShear's Table S2-1.

    ====================================  =======================================================================
    particleShear                         here
    ====================================  =======================================================================
    Young_modulus_spheres                 ``young_modulus``
    density                               ``density``, the true one of every particle
    N, packing_fraction                   ``particles``, ``packing_fraction``
    size of the cell (500 x 500)          ``side``
    bimodal_factor                        ``size_ratio``
    theMu                                 ``friction_coefficient``; Friction(coefficient=...)
    relative_viscosity                    ``relative_viscosity``; ContactDamping(...), damping= of Friction and Bonds
    relative_transversal_link_strength    ``tangential_ratio``; Friction(stiffness=...)
    relative_frequency                    ``relative_frequency``; also an argument of oscillatory_shear
    cool_factor                           ``period_decay``; BackgroundDamping(...)
    central_repulsion_coefficient         DivergentRepulsion(divergence=...)
    elastic_force_law_plateau             PlateauRepulsion(begin, end, slope)
    theAmplitude                          oscillatory_shear(amplitude=...)
    pre_periods, periods, post_periods    the same of oscillatory_shear
    do_permanent_links                    Bonds, of bond_contacts; the scene ``uncrosslinked`` has none
    interface_reenforcement_central       another stiffness for Bonds than for Repulsion
    interface_reenforcement_tangential    another tangential_stiffness for Bonds than for Friction
    keep_viscosity_coefficients_constant  another damping for Bonds than for ContactDamping and Friction, or the same
    cut_lines, doCutByTriangulation       cut_fragments(centers=...) or (lines=...); 0: the scene ``bulk``
    avoid_horizontal_angle_degree         cut_fragments(avoided_angle=...) [rad]
    avoid_height_spanning_particles       cut_fragments(spanning=...)
    cut_top_bottom, edge_fuzziness        the same of cut_fragments
    remove_link_fraction                  cut_fragments(removed_fraction=...)
    root_folder, saveData                 ``packmech run --json``, ``--out``; write_table
    saveStressTensorData                  write_table: every tensor against time
    saveOutputImages, imageFileType       ``packmech run --frames 200 --format png`` or svg; write_pictures
    doDrawing, plotStress                 ``packmech run --live``, ``--record``
    relative_y_scale_force                none: plots of stress against strain scale themselves
    ====================================  =======================================================================

    Parameters
    ----------
    young_modulus, poisson_ratio
        E [Pa] and nu [1] of the particles: k = pi E / (8 (1 - nu^2)) (S1-8).
    density
        [kg/m^3]. Mean mass m = density packing_fraction side^2 / N.
    particles, packing_fraction, side, size_ratio
        Number, summed area over that of the square cell [1], its side [um], large over small radius [1] (S1-14).
    friction_coefficient
        mu [1].
    relative_viscosity
        eta over sqrt(m k) [1] (S1-9).
    tangential_ratio
        k_T over k, and eta_T over eta [1].
    relative_frequency
        Frequency times tau [1].
    period_decay
        What a period leaves of velocities relative to the flow, above 0 and at most 1 [1].

    Examples
    --------
    >>> made = material_constants()
    >>> round(made.stiffness, 2), round(made.frequency, 1), round(made.small_radius, 3)
    (3141.59, 886.2, 23.188)

    """
    stiffness = contact_stiffness(young_modulus, poisson_ratio=poisson_ratio)
    count = integer("particles", particles, at_least=1)
    length = positive("side", side)
    area = positive("packing_fraction", packing_fraction) * length * length / count
    ratio = real("size_ratio", size_ratio, at_least=1.0)
    heavy = positive("density", density) * _PER_SQUARE_UM
    mass = heavy * area
    if not all(sys.float_info.min <= one < math.inf for one in (area, mass, mass / stiffness)):
        raise ValueError(
            "side, particles, packing_fraction, density and young_modulus must make area, mass and time of a particle "
            f"normal numbers, got {area:g} um^2, {mass:g} kg and the square root of {mass / stiffness:g} s^2"
        )
    time = math.sqrt(mass / stiffness)
    damping = real("relative_viscosity", relative_viscosity, at_least=0.0) * stiffness * time
    across = real("tangential_ratio", tangential_ratio, at_least=0.0)
    frequency = positive("relative_frequency", relative_frequency) / time
    base = math.sqrt(area / math.pi * 2.0 / (ratio + 1.0 / ratio))
    return MaterialConstants(
        stiffness=stiffness,
        tangential_stiffness=across * stiffness,
        damping=damping,
        tangential_damping=across * damping,
        friction_coefficient=real("friction_coefficient", friction_coefficient, at_least=0.0),
        mean_mass=mass,
        density=heavy,
        time=time,
        frequency=frequency,
        background_damping=-math.log(real("period_decay", period_decay, above=0.0, at_most=1.0)) * frequency,
        small_radius=base / math.sqrt(ratio),
        large_radius=base * math.sqrt(ratio),
    )
