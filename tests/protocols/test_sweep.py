"""Facts about one packing followed from pressure to pressure."""

import numpy as np
import pytest

import packmech as pm


def scene(seed=1, strain="isotropic", law=None):
    drawn = pm.random_packing(48, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.8, seed=seed)
    start = pm.Scene(drawn, (pm.Repulsion(law or pm.Harmonic()),))
    return start.replace(packing=pm.jam(start, pressure=1e-6, strain=strain).packing)


@pytest.mark.parametrize("strain", ["isotropic", "free"])
def test_each_pressure_is_reached_in_balance_up_and_down(strain):
    pressures = [1e-5, 1e-3, 1e-4, 1e-6]
    runs = pm.sweep_pressure(scene(strain=strain), pressures, strain=strain)
    assert np.allclose([run.report["pressure"] for run in runs], pressures, rtol=1e-8, atol=0.0)
    assert all(run.residual < 1e-7 for run in runs)
    if strain == "free":
        assert all(run.report["stress_anisotropy"] < 1e-7 for run in runs)


def test_the_way_back_is_the_way_where_nothing_rearranges():
    start = scene()
    runs = pm.sweep_pressure(start, [2e-6, 3e-6, 2e-6])
    assert [run.report["rearrangements"] for run in runs] == [0, 0, 0]
    there, back = runs[0].packing, runs[2].packing
    held = ~pm.find_rattlers(there)
    away = back.position_nd @ back.box.inverse_dd.T - there.position_nd @ there.box.inverse_dd.T
    away = away[held] - away[held].mean(axis=0)
    assert np.abs(away).max() < 1e-9
    closed, opened = (runs[1].report[name] for name in ("contacts_closed", "contacts_opened"))
    assert (runs[2].report["contacts_opened"], runs[2].report["contacts_closed"]) == (closed, opened)


def test_enthalpy_falls_by_the_volume_times_the_change_of_pressure():
    """dH/dP = V along a network, here by the trapezoidal rule over steps of a thousandth: of third order."""
    start = scene(law=pm.Hertz())
    pressures = 1e-5 * 1.001 ** np.arange(4)
    runs = pm.sweep_pressure(start, pressures, force_tolerance=1e-11)
    unit = start.pressure_unit
    enthalpy = [pm.energy(start.replace(packing=run.packing)) for run in runs]
    volume = [run.packing.box.volume for run in runs]
    enthalpy = np.array(enthalpy) + unit * pressures * volume
    rise = np.diff(enthalpy)
    expected = unit * np.diff(pressures) * 0.5 * (np.array(volume[1:]) + volume[:-1])
    assert np.allclose(rise, expected, rtol=1e-9, atol=0.0)


def test_a_packing_that_is_not_jammed_is_refused():
    loose = pm.random_packing(16, dimension=2, packing_fraction=0.4, seed=1)
    with pytest.raises(ValueError, match="scene.packing must be jammed"):
        pm.sweep_pressure(pm.Scene(loose, (pm.Repulsion(),)), [1e-4])
    with pytest.raises(ValueError, match="pressures must .*pressure 1"):
        pm.sweep_pressure(scene(), [1e-4, -1.0])


def test_a_protocol_of_ones_own_is_ten_lines():
    """Decompress a quenched packing and extrapolate its pressure to zero: where `jam` finds the hard packing."""
    current = scene(seed=5)
    jammed = pm.jam(current, pressure=1e-6, strain="isotropic")
    points = []
    for above in (2e-4, 1e-4):
        packing = pm.at_packing_fraction(current.packing, jammed.report["jamming_packing_fraction"] + above)
        current = current.replace(packing=pm.quench(current.replace(packing=packing), force_tolerance=1e-10).packing)
        points.append((pm.pressure(current), pm.packing_fraction(current.packing)))
    (high, dense), (low, dilute) = points
    onset = dilute - low * (dense - dilute) / (high - low)
    assert abs(onset - jammed.report["jamming_packing_fraction"]) < 1e-6
