"""Measures of a scene or a packing as it stands; nothing here changes anything."""

from __future__ import annotations

from packmech.measure.counting import coordination_number, find_rattlers, packing_fraction, remove_rattlers
from packmech.measure.signals import (
    Demodulation,
    block_mean,
    demodulate,
    mean_with_error,
    softening_strain,
    yield_strain,
)
from packmech.measure.stress import (
    contact_stress,
    energy,
    force_balance,
    forces,
    link_tension,
    pressure,
    stress_tensor,
    sum_forces,
)

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
