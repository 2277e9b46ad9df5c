"""Facts about the study of what effects cost: what is counted, and the table and figure it makes."""

import numpy as np
import pytest

from packmech.validation.studies.accuracy import effect_costs as study

ROWS = (
    study.Cost("spring", 0, 36, 280_000, 280.0, 2500, 25.0, 10.0, 1.0),
    study.Cost("spring, friction", 0, 38, 350_000, 350.0, 2500, 50.0, 20.0, 2.0),
    study.Cost("spring, friction", 10, 40, 400_000, 400.0, 2500, 75.0, 30.0, 3.0),
    study.Cost("spring, friction", 1, 40, 800_000, 800.0, 2500, 200.0, 80.0, 8.0),
)


def test_the_table_names_units_and_how_often_figures_are_kept():
    table = study.EffectCosts(ROWS)
    assert "| spring, friction | 10 steps | 40 | 400000 | 400 | 2500 | 75.0 | 30.0 | 3.00 |" in table.to_markdown()
    assert "| spring, friction | step | 40 |" in table.to_markdown()
    assert table.to_csv().splitlines()[1] == "spring,0,36,280000,280.0,2500,25.0,10.0,1.0"


def test_words_take_their_figures_from_the_table():
    words = study.describe(ROWS)
    assert "The spring alone takes 10.0 ns" in words and "20.0 ns and 350 bytes" in words and "make it 80.0 ns" in words


def test_the_figure_is_drawn_the_same_again(tmp_path):
    table = study.EffectCosts(ROWS)
    table.save_figure(tmp_path / "a.png")
    table.save_figure(tmp_path / "b.png")
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    assert (tmp_path / "a.png").stat().st_size > 10_000


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
