"""The reference package particleShear 1.0.2, step by step and faults included, so that old results can be checked.

It stands alone: nothing else in packmech computes with it, and it shares no kernel with the native dynamics.

Examples
--------
>>> from packmech.validation import particle_shear
>>> experiment = particle_shear.ParticleShear(amplitude=0.2, particles=100)
>>> experiment.steps, round(experiment.material.viscosity, 6)
(13439, 2427.032391)

"""

from packmech.validation.particle_shear.experiment import (
    DRIFTS,
    Moduli,
    ParticleShear,
    ParticleShearRun,
    Periods,
    demodulate,
)
from packmech.validation.particle_shear.material import Material, bond_force, normal_force
from packmech.validation.particle_shear.preparation import bond_fragments, prepared_discs
from packmech.validation.particle_shear.scenarios import SCENARIOS, STATEMENTS, Row, Scenario, judge
from packmech.validation.particle_shear.step import STRESSES, Discs, Evaluation, Preparation, StepRules, Steps, advance
from packmech.validation.particle_shear.text_file import TextData, read_text, write_text

__all__ = [
    "DRIFTS",
    "SCENARIOS",
    "STATEMENTS",
    "STRESSES",
    "Discs",
    "Evaluation",
    "Material",
    "Moduli",
    "ParticleShear",
    "ParticleShearRun",
    "Periods",
    "Preparation",
    "Row",
    "Scenario",
    "StepRules",
    "Steps",
    "TextData",
    "advance",
    "bond_force",
    "bond_fragments",
    "demodulate",
    "judge",
    "normal_force",
    "prepared_discs",
    "read_text",
    "write_text",
]
