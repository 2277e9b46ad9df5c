"""Measures of a scene or a packing as it stands; nothing here changes anything."""

from __future__ import annotations

from packmech.measure.averages import block_mean, mean_with_error
from packmech.measure.counting import coordination_number, packing_fraction
from packmech.measure.demodulation import Demodulation, demodulate, softening_strain, yield_strain
from packmech.measure.link_tension import link_tension
from packmech.measure.rattlers import find_rattlers, remove_rattlers
from packmech.measure.stress import contact_stress, energy, force_balance, forces, pressure, stress_tensor, sum_forces

__all__ = [
    "Demodulation",
    "block_mean",
    "contact_stress",
    "coordination_number",
    "demodulate",
    "energy",
    "find_rattlers",
    "force_balance",
    "forces",
    "link_tension",
    "mean_with_error",
    "packing_fraction",
    "pressure",
    "remove_rattlers",
    "softening_strain",
    "stress_tensor",
    "sum_forces",
    "yield_strain",
]
