"""Mechanics: rigidity, Hessians, vibrations and elasticity of a packing, by sparse linear algebra.

Names are found on first use, so that a program which needs one of these modules does not pay for the others.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from packmech.mechanics.constraint_basis import ConstraintBasis, constraint_basis
    from packmech.mechanics.constraints import constraint_jacobian
    from packmech.mechanics.counting import FloppyModes, SelfStress, floppy_modes, states_of_self_stress
    from packmech.mechanics.elasticity import elastic_moduli
    from packmech.mechanics.factor import Factorization, Inertia, NotDefinite, eigenvalues_below, factorize
    from packmech.mechanics.hessian import dynamical_matrix, hessian, perturbation_energy
    from packmech.mechanics.jamming import classify_jamming
    from packmech.mechanics.modes import Modes, normal_modes
    from packmech.mechanics.moduli import Average, Moduli
    from packmech.mechanics.projection import ConstrainedForce, project_force
    from packmech.mechanics.reaffixing import ReaffixedLinks, reaffix_links
    from packmech.mechanics.redundant_links import IndependentLinks, independent_links
    from packmech.mechanics.rigidity import rigidity_matrix
    from packmech.mechanics.spectrum import StateDensity, density_of_states
    from packmech.mechanics.verdict import Verdict

_MODULE = {
    "Average": "moduli",
    "ConstrainedForce": "projection",
    "ConstraintBasis": "constraint_basis",
    "Factorization": "factor",
    "FloppyModes": "counting",
    "IndependentLinks": "redundant_links",
    "Inertia": "factor",
    "Modes": "modes",
    "Moduli": "moduli",
    "NotDefinite": "factor",
    "ReaffixedLinks": "reaffixing",
    "SelfStress": "counting",
    "StateDensity": "spectrum",
    "Verdict": "verdict",
    "classify_jamming": "jamming",
    "constraint_basis": "constraint_basis",
    "constraint_jacobian": "constraints",
    "density_of_states": "spectrum",
    "dynamical_matrix": "hessian",
    "eigenvalues_below": "factor",
    "elastic_moduli": "elasticity",
    "factorize": "factor",
    "floppy_modes": "counting",
    "hessian": "hessian",
    "independent_links": "redundant_links",
    "normal_modes": "modes",
    "perturbation_energy": "hessian",
    "project_force": "projection",
    "reaffix_links": "reaffixing",
    "rigidity_matrix": "rigidity",
    "states_of_self_stress": "counting",
}

__all__ = [
    "Average",
    "ConstrainedForce",
    "ConstraintBasis",
    "Factorization",
    "FloppyModes",
    "IndependentLinks",
    "Inertia",
    "Modes",
    "Moduli",
    "NotDefinite",
    "ReaffixedLinks",
    "SelfStress",
    "StateDensity",
    "Verdict",
    "classify_jamming",
    "constraint_basis",
    "constraint_jacobian",
    "density_of_states",
    "dynamical_matrix",
    "eigenvalues_below",
    "elastic_moduli",
    "factorize",
    "floppy_modes",
    "hessian",
    "independent_links",
    "normal_modes",
    "perturbation_energy",
    "project_force",
    "reaffix_links",
    "rigidity_matrix",
    "states_of_self_stress",
]


def __getattr__(name: str) -> Any:
    if name not in _MODULE:
        raise AttributeError(f"module 'packmech.mechanics' has no attribute {name!r}")
    value = getattr(importlib.import_module(f"packmech.mechanics.{_MODULE[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(set(globals()) | set(_MODULE))
