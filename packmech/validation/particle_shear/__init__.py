"""The reference package particleShear 1.0.2, step by step and faults included, so that old results can be checked.

It stands alone: nothing else in packmech computes with it, and it shares no kernel with the native dynamics. All of it
is public as `pm.particle_shear`.

Examples
--------
>>> import packmech as pm
>>> experiment = pm.particle_shear.ParticleShear(amplitude=0.2, particles=40, pre_periods=0.5, post_periods=0.2)
>>> start = pm.particle_shear.prepared_discs(experiment, seed=1, centers=5)
>>> run = experiment.run(start)
>>> run.moduli("overall")._fields
('in_phase', 'out_of_phase', 'storage', 'loss')

"""

from packmech.validation.particle_shear.conversion import from_scene, to_scene
from packmech.validation.particle_shear.experiment import (
    DRIFTS,
    ComplexModuli,
    ParticleShear,
    ParticleShearRun,
    Periods,
    demodulate,
    remove_jumps,
)
from packmech.validation.particle_shear.material import Material, bond_force, normal_force
from packmech.validation.particle_shear.preparation import bond_fragments, prepared_discs
from packmech.validation.particle_shear.scenarios import SCENARIOS, STATEMENTS, Row, Scenario, is_as_stated, judge
from packmech.validation.particle_shear.series import CONTROLS, run_series
from packmech.validation.particle_shear.step import (
    STRESSES,
    Preparation,
    ShearedDiscs,
    StepForces,
    StepRules,
    Steps,
    advance,
)
from packmech.validation.particle_shear.text_file import TextData, read_text, write_text

__all__ = [
    "CONTROLS",
    "DRIFTS",
    "SCENARIOS",
    "STATEMENTS",
    "STRESSES",
    "ShearedDiscs",
    "StepForces",
    "Material",
    "ComplexModuli",
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
    "from_scene",
    "is_as_stated",
    "judge",
    "normal_force",
    "prepared_discs",
    "read_text",
    "remove_jumps",
    "run_series",
    "to_scene",
    "write_text",
]
