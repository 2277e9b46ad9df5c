"""What an engine holds follows from the effects of its scene."""

import numpy as np
import pytest
from benchmarks import bench_effect_costs as study


@pytest.mark.slow
def test_what_nothing_rubs_has_neither_spins_nor_stretches_nor_figures(monkeypatch):
    monkeypatch.setattr(study, "WARM_STEPS", 20)
    monkeypatch.setattr(study, "STEPS", 20)
    start = study.start_of(200)
    spring = study.cost_of(start, "spring", (study.SPRING,), 0)
    dashpot = study.cost_of(start, "dashpot", (study.SPRING, study.DASHPOT), 0)
    frictional = study.cost_of(start, "friction", (study.SPRING, study.DASHPOT, study.FRICTION), 0)
    bonded = study.cost_of(
        start, "bonds", (study.SPRING, study.DASHPOT, study.FRICTION, study.bonds_of(start.packing)), 0
    )
    observed = study.cost_of(start, "figures", (study.SPRING, study.DASHPOT, study.FRICTION), 1)
    assert spring.arrays == dashpot.arrays < frictional.arrays < observed.arrays < bonded.arrays
    assert spring.bytes < frictional.bytes < bonded.bytes
    # the torque and the spin's own column: a push row is one number longer
    assert frictional.bytes_per_particle - spring.bytes_per_particle > 8.0
    assert np.isfinite([one.nanoseconds for one in (spring, frictional, bonded, observed)]).all()
