"""Mechanics: rigidity, Hessians, vibrations and elasticity of a packing, by sparse linear algebra."""

from __future__ import annotations

from packmech.mechanics.counting import FloppyModes, SelfStress, floppy_modes, states_of_self_stress
from packmech.mechanics.factor import Factorization, Inertia, NotDefinite, eigenvalues_below, factorize
from packmech.mechanics.hessian import dynamical_matrix, hessian, perturbation_energy
from packmech.mechanics.rigidity import rigidity_matrix

__all__ = [
    "Factorization",
    "FloppyModes",
    "Inertia",
    "NotDefinite",
    "SelfStress",
    "dynamical_matrix",
    "eigenvalues_below",
    "factorize",
    "floppy_modes",
    "hessian",
    "perturbation_energy",
    "rigidity_matrix",
    "states_of_self_stress",
]
