"""packmech: mechanics of jammed packings.

Names are found on first use, so that `import packmech` is light and a command pays only for what it touches.
"""

from __future__ import annotations

import importlib
from typing import Any

__version__ = "0.1.0"

# public name -> module that holds it
_PUBLIC = {
    # packings
    "Box": "packmech.box",
    "Packing": "packmech.packing",
    "Bidisperse": "packmech.generate",
    "LogNormal": "packmech.generate",
    "Mixture": "packmech.generate",
    "Monodisperse": "packmech.generate",
    "Normal": "packmech.generate",
    "Uniform": "packmech.generate",
    "Cluster": "packmech.generate",
    "Dimer": "packmech.generate",
    "LinearCluster": "packmech.generate",
    "RingCluster": "packmech.generate",
    "StarCluster": "packmech.generate",
    "Trimer": "packmech.generate",
    "chain_packing": "packmech.generate",
    "cluster_packing": "packmech.generate",
    "cut_fragments": "packmech.generate",
    "fill_box": "packmech.generate",
    "lattice_packing": "packmech.generate",
    "random_packing": "packmech.generate",
    "reinforced_kagome_packing": "packmech.generate",
    "tunneled_packing": "packmech.generate",
    "vacancy_packing": "packmech.generate",
    "read_law": "packmech.files",
    "read_packing": "packmech.files",
    "write_packing": "packmech.files",
    # scenes and effects
    "CementDrive": "packmech.scene",
    "JamDrive": "packmech.scene",
    "Links": "packmech.links",
    "OscillatoryShearDrive": "packmech.scene",
    "QuenchDrive": "packmech.scene",
    "ShearStabilizeDrive": "packmech.scene",
    "SteadyShearDrive": "packmech.scene",
    "Scene": "packmech.scene",
    "list_scenes": "packmech.scene_file",
    "read_scene": "packmech.scene_file",
    "write_scene": "packmech.scene_file",
    "BackgroundDamping": "packmech.effects",
    "Bonds": "packmech.effects",
    "ContactDamping": "packmech.effects",
    "Friction": "packmech.effects",
    "Gravity": "packmech.effects",
    "Walls": "packmech.effects",
    "DivergentRepulsion": "packmech.effects",
    "ExponentialTension": "packmech.effects",
    "Harmonic": "packmech.effects",
    "Hertz": "packmech.effects",
    "LinearSpring": "packmech.effects",
    "PlateauRepulsion": "packmech.effects",
    "PowerLaw": "packmech.effects",
    "Repulsion": "packmech.effects",
    "RepulsiveLennardJones": "packmech.effects",
    "effect": "packmech.effects",
    "law": "packmech.effects",
    # contacts
    "Contacts": "packmech.contacts",
    "Crossings": "packmech.contacts",
    "crossing_links": "packmech.contacts",
    "find_contacts": "packmech.contacts",
    "find_rattlers": "packmech.measure",
    "remove_rattlers": "packmech.measure",
    # measures
    "Demodulation": "packmech.measure",
    "coordination_number": "packmech.measure",
    "demodulate": "packmech.measure",
    "energy": "packmech.measure",
    "forces": "packmech.measure",
    "link_tension": "packmech.measure",
    "packing_fraction": "packmech.measure",
    "pressure": "packmech.measure",
    "softening_strain": "packmech.measure",
    "stress_tensor": "packmech.measure",
    "yield_strain": "packmech.measure",
    # accuracy and recording
    "Answer": "packmech.accuracy",
    "Trial": "packmech.accuracy",
    "WorkPrecision": "packmech.accuracy",
    "work_precision": "packmech.accuracy",
    "record_motion": "packmech.recording_motion",
    "record_packing": "packmech.recording",
    "record_run": "packmech.recording",
    "Table": "packmech.tables",
    "read_table": "packmech.tables",
    "write_pictures": "packmech.pictures",
    "write_table": "packmech.tables",
    # mechanics
    "Average": "packmech.mechanics.moduli",
    "ConstrainedForce": "packmech.mechanics.projection",
    "ConstraintBasis": "packmech.mechanics.constraint_basis",
    "FloppyModes": "packmech.mechanics.counting",
    "IndependentLinks": "packmech.mechanics.redundant_links",
    "Modes": "packmech.mechanics.modes",
    "Moduli": "packmech.mechanics.moduli",
    "ReaffixedLinks": "packmech.mechanics.reaffixing",
    "Rattling": "packmech.mechanics.rattling",
    "SelfStress": "packmech.mechanics.counting",
    "StateDensity": "packmech.mechanics.spectrum",
    "ComplexModulus": "packmech.mechanics.complex_modulus",
    "change_of_basis": "packmech.mechanics.change_of_basis",
    "complex_modulus": "packmech.mechanics.complex_modulus",
    "compliance_matrix": "packmech.mechanics.compliance",
    "constrained_rigidity_matrix": "packmech.mechanics.change_of_basis",
    "constraint_basis": "packmech.mechanics.constraint_basis",
    "constraint_jacobian": "packmech.mechanics.constraints",
    "density_of_states": "packmech.mechanics.spectrum",
    "dynamical_matrix": "packmech.mechanics.hessian",
    "elastic_moduli": "packmech.mechanics.elasticity",
    "find_rattling_clusters": "packmech.mechanics.rattling",
    "floppy_modes": "packmech.mechanics.counting",
    "hessian": "packmech.mechanics.hessian",
    "independent_links": "packmech.mechanics.redundant_links",
    "n_matrix": "packmech.mechanics.change_of_basis",
    "normal_modes": "packmech.mechanics.modes",
    "perturbation_energy": "packmech.mechanics.hessian",
    "project_force": "packmech.mechanics.projection",
    "reaffix_links": "packmech.mechanics.reaffixing",
    "rigidity_matrix": "packmech.mechanics.rigidity",
    "states_of_self_stress": "packmech.mechanics.counting",
    # minimizers
    "ConjugateGradient": "packmech.dynamics.conjugate_gradient",
    "DampedDynamics": "packmech.dynamics.damped",
    "Fire": "packmech.dynamics.fire",
    "Fire2": "packmech.dynamics.fire",
    "GradientDescent": "packmech.dynamics.gradient_descent",
    "LBFGS": "packmech.dynamics.lbfgs",
    "Newton": "packmech.dynamics.polish",
    "quench": "packmech.dynamics.quench",
    # dynamics
    "bond_contacts": "packmech.dynamics.bond_contacts",
    "Equilibration": "packmech.dynamics.preparation",
    "MaterialConstants": "packmech.dynamics.material",
    "equilibrate": "packmech.dynamics.preparation",
    "material_constants": "packmech.dynamics.material",
    "OscillatoryStrain": "packmech.dynamics.strain",
    "SteadyStrain": "packmech.dynamics.strain",
    "OscillatoryShear": "packmech.dynamics.rheology.oscillatory",
    "StrainRun": "packmech.dynamics.rheology.travel",
    "oscillatory_shear": "packmech.dynamics.rheology.oscillatory",
    "MotionTrace": "packmech.dynamics.simulation",
    "ParticleShear": "packmech.dynamics.particle_shear",
    "ParticleShearRun": "packmech.dynamics.particle_shear",
    "PlayedMotion": "packmech.dynamics.play",
    "SemiImplicitEuler": "packmech.dynamics.verlet",
    "Simulation": "packmech.dynamics.simulation",
    "VelocityVerlet": "packmech.dynamics.verlet",
    "play_motion": "packmech.dynamics.play",
    "resume": "packmech.dynamics.simulate",
    "simulate": "packmech.dynamics.simulate",
    # verdict
    "classify_jamming": "packmech.mechanics.jamming",
    "Verdict": "packmech.mechanics.verdict",
    # jamming protocols
    "Decompression": "packmech.dynamics.jam_methods",
    "HardVertex": "packmech.dynamics.jam_methods",
    "ProgramChain": "packmech.dynamics.jam_methods",
    "StepHalving": "packmech.dynamics.jam_methods",
    "Cementing": "packmech.dynamics.cement",
    "CementingCurve": "packmech.dynamics.cement_curve",
    "WeightedMean": "packmech.dynamics.cement_curve",
    "cement": "packmech.dynamics.cement",
    "cementing_curve": "packmech.dynamics.cement_curve",
    "compress": "packmech.dynamics.compress",
    "jam": "packmech.dynamics.jam",
    "shear_stabilize": "packmech.dynamics.shear_stabilize",
    # outcomes
    "NotConverged": "packmech.outcome",
    "Outcome": "packmech.outcome",
    "Run": "packmech.outcome",
    "Solve": "packmech.outcome",
    "Stage": "packmech.outcome",
    "Trace": "packmech.outcome",
}

__all__ = sorted(_PUBLIC)


def __getattr__(name: str) -> Any:
    module = _PUBLIC.get(name)
    if module is None:
        raise AttributeError(f"module 'packmech' has no attribute {name!r}")
    value = getattr(importlib.import_module(module), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(set(globals()) | set(_PUBLIC))
