"""Facts about packings followed down to the jamming point, and about the fits of what falls on the way."""

import math
from types import MappingProxyType

import numpy as np
import pytest

import packmech as pm
from packmech.protocols.scaling import COLUMNS


def starts(count, particles=64):
    packings = [
        pm.random_packing(particles, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.87, seed=seed)
        for seed in range(count)
    ]
    return [pm.Scene(one, (pm.Repulsion(),)) for one in packings]


def made(value_sp, pressure_p, particles=256):
    table = {name: np.asarray(value_sp, dtype=float) for name in COLUMNS}
    return pm.JammingScaling(particles, 2, "free", np.asarray(pressure_p), MappingProxyType(table), 0.0)


@pytest.fixture(scope="module")
def found():
    return pm.jamming_scaling(starts(3), [1e-2, 3e-3, 1e-3, 1e-5])


def test_energy_and_bulk_modulus_fall_as_one_integral_of_the_pressure(found):
    """dE = -p dV and B = -V dp/dV: dE/dp = p V / B, so that the exponents of E and B add up to that of p^2 V."""
    assert found.packings == 3 and found.strain == "free"
    powers = [found.fit(name, pressure_from=1e-3).exponent for name in ("energy_per_particle", "bulk_modulus")]
    volume = -found.fit("packing_fraction", pressure_from=1e-3).exponent
    # B is no pure power over this decade, whose ends differ from its mean by some hundredths
    assert sum(powers) == pytest.approx(2.0 + volume, abs=0.05)
    # 64 particles at these pressures are too few, and too dense, to hold an exponent of 1/2 to its error
    assert (np.diff(found.mean_p("excess_coordination")) < 0.0).all()
    # with every strain free each of them is stable to shear
    assert (found.value_sp["shear_modulus"] > 0.0).all()
    assert (np.diff(found.mean_p("packing_fraction")) < 0.0).all()
    assert found.value_sp["residual"].max() < 1e-5


def test_pressure_is_the_slope_of_the_energy(found):
    """dE/dV = -p along the path: E/N between pressures lies between p1 and p2 times the change of volume."""
    fraction, energy = found.value_sp["packing_fraction"], found.value_sp["energy_per_particle"]
    for scene, phi, each in zip(starts(3), fraction, energy, strict=True):
        volume = (math.pi * scene.packing.radius_n**2).sum() / phi / scene.packing.particles
        work = (each[0] - each[1]) / (volume[1] - volume[0])
        assert 3e-3 < work < 1e-2


def test_few_particles_show_below_a_pressure_that_falls_with_their_number(found):
    assert found.counted_from == pytest.approx(1.5e-4 * 16.0)
    assert made(np.ones((1, 2)), [1e-2, 1e-3]).counted_from == pytest.approx(1.5e-4)


def test_an_exact_power_law_is_found_with_no_error_and_only_where_it_is_fitted():
    pressure = np.array([1e-2, 1e-3, 1e-4, 1e-5])
    value = 3.0 * pressure**0.5
    value[2:] = 7.0
    fit = made(np.stack([value, value, value]), pressure).fit("shear_modulus")
    assert fit.exponent == pytest.approx(0.5, abs=1e-12) and fit.prefactor == pytest.approx(3.0)
    assert fit.error == pytest.approx(0.0, abs=1e-12)


def test_the_error_is_that_of_the_mean_of_independent_packings():
    """Slopes drawn with a spread s give an error of about s / sqrt(S), over the packings."""
    rng = np.random.default_rng(1)
    pressure = np.array([1e-1, 1e-2, 1e-3])
    spread, count = 0.02, 400
    slope = 0.5 + spread * rng.standard_normal(count)
    table = made(pressure[None, :] ** slope[:, None], pressure)
    # large values lead in a mean of powers: small spreads keep the mean of slopes
    assert table.fit("shear_modulus").error == pytest.approx(spread / math.sqrt(count), rel=0.2)


def test_packings_that_did_not_come_to_rest_are_left_out():
    value = np.array([[1.0, 2.0], [math.nan, math.nan]])
    table = made(value, [1e-2, 1e-3])
    assert table.mean_p("shear_modulus").tolist() == [1.0, 2.0]
    with pytest.raises(ValueError, match="packings must have come to rest"):
        made(value[1:], [1e-2, 1e-3]).mean_p("shear_modulus")


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: pm.jamming_scaling([]), "scenes must hold at least one scene, got none"),
        (lambda: pm.jamming_scaling(starts(1) + starts(1, 32)), r"scenes\[1\] must have 64 particles"),
        (lambda: pm.jamming_scaling(starts(1), [1e-2, -1.0]), "pressures must be positive"),
        (lambda: made(np.ones((1, 2)), [1e-2, 1e-3]).fit("speed"), "name must be one of"),
        (lambda: made(np.ones((1, 2)), [1e-2, 1e-3]).fit("residual", pressure_from=5e-3), "at least two pressures"),
        (lambda: made(-np.ones((1, 2)), [1e-2, 1e-3]).fit("residual"), "residual must be positive on average"),
    ],
)
def test_wrong_arguments_are_named(call, message):
    with pytest.raises(ValueError, match=message):
        call()


def test_effects_that_would_be_ignored_are_refused_by_name():
    with pytest.raises(ValueError, match="got Walls"):
        pm.jamming_scaling([one.replace(effects=(*one.effects, pm.Walls())) for one in starts(1)])


def test_a_stop_keeps_the_packings_that_were_finished():
    def progress(stage, figures):
        if figures.get("done") == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as stop:
        pm.jamming_scaling(starts(2, 32), [1e-2, 5e-3], progress=progress)
    assert stop.value.scaling.packings == 1
