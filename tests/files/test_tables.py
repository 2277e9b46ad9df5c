"""Facts about tables: what is read back equals what the run kept, to the last bit, with its units."""

import json
import sys
from functools import cache

import numpy as np
import pytest

import packmech as pm
from packmech.files.tables import table_of
from packmech.validation.particle_shear import STRESSES, prepared_discs


@cache
def sheared():
    packing = pm.random_packing(40, dimension=2, sizes=pm.Bidisperse(1.4), packing_fraction=0.95, seed=4)
    bonds = pm.bond_contacts(packing, tangential_stiffness=0.5, damping=0.2)
    effects = (
        pm.Repulsion(law=pm.LinearSpring()),
        pm.ContactDamping(0.1),
        pm.Friction(0.5, 0.4, 0.1),
        bonds.select(np.arange(len(bonds)) % 3 == 0),
    )
    return pm.simulate(
        pm.Scene(packing, effects), steps=40, dt=0.02, applied_strain=pm.SteadyStrain(0.7), trace_every=7
    )


ENDINGS = ["parquet", "csv"]


@pytest.fixture(params=ENDINGS)
def written(request, tmp_path):
    if request.param == "parquet":
        pytest.importorskip("pyarrow")
    path = tmp_path / f"run.{request.param}"
    pm.write_table(sheared(), path)
    return path


def test_every_tensor_and_figure_is_read_back_to_the_last_bit(written):
    trace, back = sheared().trace, pm.read_table(written)
    for name in ("stress", "overall_stress", "torque_stress", "spin_stress", "bond_stress", "kinetic_stress"):
        assert back.tensor(name).tobytes() == np.ascontiguousarray(getattr(trace, f"{name}_tdd")).tobytes()
    for name in ("step", "time", "strain", "strain_rate", "energy", "kinetic", "tangential", "rotational", "pressure"):
        assert back[name].tobytes() == getattr(trace, f"{name}_t").tobytes()
    assert back["momentum_y"].tobytes() == np.ascontiguousarray(trace.momentum_td[:, 1]).tobytes()
    assert back["angular_momentum_z"].tobytes() == np.ascontiguousarray(trace.angular_momentum_tk[:, 0]).tobytes()
    assert back["sliding"].dtype == np.int64
    assert len(back) == len(trace.step_t)


def test_units_and_what_the_run_says_of_itself_are_in_the_file(written):
    back = pm.read_table(written)
    assert back.units["overall_stress_xy"] == "energy/length^2"
    assert back.units["strain_rate"] == "1/time"
    assert back.units["contacts"] == "1"
    assert set(back.units) == set(back.columns)
    assert "" not in back.units.values()
    assert back.about["kind"] == "Simulation"
    assert back.about["dt"] == sheared().dt
    assert back.about["outcome"] == "finished"


def test_parts_of_the_overall_stress_add_up_in_the_file(written):
    back = pm.read_table(written)
    parts = back.tensor("stress") + back.tensor("torque_stress") + back.tensor("spin_stress")
    assert parts == pytest.approx(back.tensor("overall_stress"), abs=1e-15)


def test_pandas_and_other_readers_see_plain_columns_with_units(tmp_path):
    parquet = pytest.importorskip("pyarrow.parquet")
    path = tmp_path / "run.parquet"
    pm.write_table(sheared(), path)
    schema = parquet.read_schema(path)
    assert schema.field("overall_stress_xy").metadata == {b"unit": b"energy/length^2"}
    assert json.loads(schema.metadata[b"packmech"])["dimension"] == 2


def test_figures_that_are_not_finite_come_back_from_both_formats(tmp_path):
    trace = pm.Trace(
        np.arange(3), np.array([np.inf, -np.inf, np.nan]), np.zeros(3), np.arange(3), np.array([5e-324, -0.0, 1 / 3])
    )
    for ending in ENDINGS:
        pm.write_table(trace, tmp_path / f"odd.{ending}")
        back = pm.read_table(tmp_path / f"odd.{ending}")
        assert back["energy"].tolist()[:2] == [np.inf, -np.inf]
        assert np.isnan(back["energy"][2])
        assert back["max_force"].tobytes() == trace.max_force_t.tobytes()


def test_a_run_that_kept_positions_and_contacts_has_the_table_of_one_that_did_not():
    packing = pm.random_packing(20, dimension=2, packing_fraction=0.9, seed=3)
    scene = pm.Scene(packing, (pm.Repulsion(), pm.Friction(0.5)))
    kept, left = (
        table_of(pm.simulate(scene, steps=4, dt=0.05, trace_every=2, trace_positions=more)) for more in (True, False)
    )
    assert list(kept.columns) == list(left.columns)
    assert all(kept[name].tobytes() == left[name].tobytes() for name in left.columns)


def test_a_minimization_has_a_table_too(tmp_path):
    packing = pm.random_packing(20, dimension=2, packing_fraction=0.9, seed=3)
    run = pm.quench(pm.Scene(packing, (pm.Repulsion(),)), force_tolerance=1e-6, trace_every=10)
    pm.write_table(run, tmp_path / "quench.csv")
    back = pm.read_table(tmp_path / "quench.csv")
    assert back["energy"].tolist() == run.trace.energy_t.tolist()
    assert back.units["pressure"] == "energy/length^2"


def test_the_reference_experiment_keeps_its_own_units_and_names():
    experiment = pm.ParticleShear(amplitude=0.1, particles=20, periods=0.05, pre_periods=0.0, post_periods=0.0)
    run = experiment.run(prepared_discs(experiment, seed=1, steps=5))
    table = table_of(run)
    for name in STRESSES:
        assert np.array_equal(table.tensor(f"{name}_stress"), run.stress(name))
    assert table.units["overall_stress_xy"] == "Pa"
    assert table.units["time"] == "s"


def test_without_pyarrow_the_error_names_the_extra_and_csv_still_works(monkeypatch, tmp_path):
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    with pytest.raises(ImportError, match=r"pip install 'packmech\[tables\]'"):
        pm.write_table(sheared(), tmp_path / "run.parquet")
    assert list(tmp_path.iterdir()) == []
    pm.write_table(sheared(), tmp_path / "run.csv")
    assert len(pm.read_table(tmp_path / "run.csv")) == len(sheared().trace.step_t)


def test_tables_of_other_origin_are_refused(tmp_path):
    (tmp_path / "other.csv").write_text("a,b\n1,2\n")
    with pytest.raises(ValueError, match="path must name a table of packmech, got .*first line must start with"):
        pm.read_table(tmp_path / "other.csv")
    (tmp_path / "other.parquet").write_text("PAR1")
    with pytest.raises(ValueError, match="path must name a table of packmech"):
        pm.read_table(tmp_path / "other.parquet")
    with pytest.raises(ValueError, match=r"path must end in one of \.parquet, \.csv"):
        pm.write_table(sheared(), tmp_path / "run.txt")


def test_a_run_that_kept_nothing_is_refused():
    run = pm.simulate(pm.Scene(pm.lattice_packing("square"), (pm.Repulsion(),)), steps=1, dt=0.1)
    with pytest.raises(ValueError, match=r"subject must be a run with a trace \(trace_every=...\), got one without"):
        pm.write_table(run, "run.csv")


def test_a_column_that_is_not_there_is_named():
    with pytest.raises(KeyError, match="name must be one of step, energy"):
        table_of(sheared())["temperature"]
