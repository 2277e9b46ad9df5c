"""Facts about packings followed down to the jamming point, and about the fits of what falls on the way."""

import dataclasses
import math
from types import MappingProxyType

import numpy as np
import pytest

import packmech as pm
from packmech.ensemble.jamming_scaling import COLUMNS


def starts(count, particles=64):
    packings = [
        pm.random_packing(particles, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.87, seed=seed)
        for seed in range(count)
    ]
    return [pm.Scene(one, (pm.Repulsion(),)) for one in packings]


def made(value_sp, level_p, particles=256, control="pressure"):
    level = np.asarray(level_p)
    table = {name: np.asarray(value_sp, dtype=float) for name in COLUMNS}
    # springs: P = .4 distance
    table["pressure"] = np.tile(level if control == "pressure" else 0.4 * level, (len(table["residual"]), 1))
    table["distance"] = np.tile(level if control == "distance" else 2.5 * level, (len(table["residual"]), 1))
    return pm.JammingScaling(particles, 2, "free", control, level, MappingProxyType(table), 2.0, 0.0)


@pytest.fixture(scope="module")
def found():
    return pm.jamming_scaling(starts(3), [1e-2, 3e-3, 1e-3, 1e-5])


def test_energy_and_bulk_modulus_fall_as_one_integral_of_the_pressure(found):
    """dE = -p dV and B = -V dp/dV: dE/dp = p V / B, so that the exponents of E and B add up to that of p^2 V."""
    assert found.packings == 3 and found.strain == "free"
    powers = [found.fit(name, smallest=1e-3).exponent for name in ("energy_per_particle", "bulk_modulus")]
    volume = -found.fit("packing_fraction", smallest=1e-3).exponent
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


def test_the_distance_is_that_to_the_packing_fraction_at_which_the_last_pressure_vanishes(found):
    """P = B (phi - phi_J) / phi at the lowest pressure, so that distances fall with pressure, to about P / .4 there."""
    distance, pressure = found.mean_p("distance"), found.mean_p("pressure")
    assert (np.diff(distance) < 0.0).all()
    assert 0.2 < pressure[-1] / distance[-1] < 0.6
    each = found.value_sp["packing_fraction"] - found.value_sp["distance"]
    assert np.ptp(each, axis=1) == pytest.approx(0.0, abs=1e-12)
    assert found.law_exponent == 2.0


def test_few_particles_show_below_a_distance_that_falls_with_the_square_of_their_number():
    assert made(np.ones((1, 3)), [1e-3, 3.9e-4, 3.7e-4], control="distance").counted_p.tolist() == [True, True, False]
    # N^2 P = 10 at P = .4 distance
    assert made(np.ones((1, 2)), [1.55e-4, 1.50e-4]).counted_p.tolist() == [True, False]
    assert made(np.ones((1, 2)), [1.55e-4, 1.50e-4], particles=128).counted_p.tolist() == [False, False]


def test_a_correction_to_scaling_is_found_along_with_the_exponent():
    distance = np.geomspace(1e-3, 1e-1, 7)
    value = 2.0 * distance**0.5 * (1.0 + 1.5 * np.sqrt(distance))
    scaling = made(np.stack([value] * 3), distance, control="distance")
    plain, corrected = (scaling.fit("shear_modulus", corrected=one) for one in (False, True))
    assert plain.exponent > 0.55
    assert corrected.exponent == pytest.approx(0.5, abs=1e-8)
    assert (corrected.prefactor, corrected.correction) == (pytest.approx(2.0), pytest.approx(1.5))
    # over the pressure, .4 of it, the correction is larger by sqrt(2.5)
    over = scaling.fit("shear_modulus", corrected=True, over="pressure")
    assert (over.exponent, over.correction) == (pytest.approx(0.5), pytest.approx(1.5 * math.sqrt(2.5)))


def test_what_n_sets_is_told_from_the_correction_by_packings_of_several_n():
    distance = np.geomspace(1e-3, 1e-1, 7)
    sized = []
    for count in (128, 256, 1024):
        value = 2.0 * distance**0.5 * (1.0 + 1.5 * np.sqrt(distance) - 0.8 / (count * np.sqrt(distance)))
        scatter = np.random.default_rng(count).normal(size=(4, 1)) * 1e-3
        sized.append(made(value * (1.0 + scatter - scatter.mean()), distance, count, control="distance"))
    found = pm.fit_sizes(sized, "shear_modulus")
    assert found.exponent == pytest.approx(0.5, abs=1e-8)
    assert (found.prefactor, found.correction, found.finite_size) == pytest.approx((2.0, 1.5, -0.8))
    assert 0.0 < found.error < 1e-3 and found.window_error < 1e-7 and found.size_error == 0.0
    # the nearest of N = 128 lies on its plateau
    assert (found.levels, found.of_levels) == (20, 21)
    # one N takes what N sets for the other correction, and its error says so
    alone = sized[0].fit("shear_modulus", corrected=True)
    assert alone.exponent > 0.52 and abs(alone.exponent - 0.5) < alone.error
    assert pm.fit_sizes(sized, "shear_modulus", largest=0.03).exponent == pytest.approx(0.5, abs=1e-8)
    # levels where N shows too much for the first order take no part
    assert pm.fit_sizes(sized[1:], "shear_modulus").finite_size == pytest.approx(-0.8)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({}, "scalings must be of two or more N"),
        ({"particles": 128, "law_exponent": 2.5}, r"scalings\[1\] must be like the first"),
        ({"particles": 128}, "at least 6 levels of two N"),
    ],
)
def test_fits_of_sizes_are_of_several_n_alike(change, words):
    one = made(np.ones((2, 2)), [1e-2, 1e-1], control="distance")
    with pytest.raises(ValueError, match=words):
        pm.fit_sizes([one, dataclasses.replace(one, **change)], "shear_modulus")


def test_a_fit_of_sizes_of_which_one_lies_on_its_plateau_is_refused():
    level = np.geomspace(1e-3, 1e-1, 7)
    small, large = (made(level[None, :] ** 0.5, level, count, control="distance") for count in (10, 256))
    with pytest.raises(ValueError, match=r"levels of two N above their plateaus, got 7 of N = \[256\]"):
        pm.fit_sizes([small, large], "shear_modulus")


def test_hertzian_contacts_have_exponents_of_their_own():
    """Over the distance P, E, B, G, z, omega*: 3/2, 5/2, 1/2, 1, 1/2, 3/4; of springs 1, 2, 0, 1/2, 1/2, 1/2."""
    names = ("pressure", "energy_per_particle", "bulk_modulus", "shear_modulus", "excess_coordination", "plateau_edge")
    harmonic = made(np.ones((1, 2)), [1e-2, 1e-3])
    hertz = dataclasses.replace(harmonic, law_exponent=2.5)
    assert [harmonic.theory(name, over="distance") for name in names] == [1.0, 2.0, 0.0, 0.5, 0.5, 0.5]
    assert [hertz.theory(name, over="distance") for name in names] == [1.5, 2.5, 0.5, 1.0, 0.5, 0.75]
    assert hertz.theory("excess_coordination", over="pressure") == pytest.approx(1.0 / 3.0)


def test_packings_are_followed_over_the_distance_to_their_own_hard_packing_with_their_states():
    scaling = pm.jamming_scaling(starts(1, 32), distances=[1e-2, 1e-3], strain="isotropic", states=True)
    assert scaling.control == "distance" and scaling.level_p.tolist() == [1e-3, 1e-2]
    assert scaling.value_sp["distance"][0] == pytest.approx([1e-3, 1e-2], abs=1e-9)
    # every mode is counted, d N' - d for N' particles without rattlers
    assert all(one.count_b.sum() == one.modes for one in scaling.states_sp[0])
    assert scaling.names[-1] == "plateau_edge" and "plateau_edge_error" in scaling.to_csv()


def test_an_exact_power_law_is_found_with_no_error_and_only_where_it_is_fitted():
    pressure = np.array([1e-2, 1e-3, 1e-4, 1e-5])
    value = 3.0 * pressure**0.5
    # where N shows
    value[2:] = 7.0
    fit = made(np.stack([value, value, value]), pressure).fit("shear_modulus")
    assert fit.exponent == pytest.approx(0.5, abs=1e-12) and fit.prefactor == pytest.approx(3.0)
    assert fit.sampling_error == pytest.approx(0.0, abs=1e-12)
    # of two levels none can be left out
    assert math.isnan(fit.window_error) and math.isnan(fit.error)
    assert (fit.levels, fit.of_levels, fit.smallest, fit.largest) == (2, 4, 1e-3, 1e-2)
    assert "from 2 of 4 levels, x = 0.001 to 0.01" in repr(fit)


# exponent, correction and finite size of G, omega*, excess contacts, P and B of discs: recordings/scaling
LAWS = {
    "shear_modulus": (0.5, 0.6, 4.0),
    "plateau_edge": (0.5, 1.5, 3.5),
    "excess_coordination": (0.5, 0.0, -1.0),
    "pressure": (1.0, 1.6, 0.0),
    "bulk_modulus": (0.0, 3.4, 0.0),
}


@pytest.mark.parametrize("corrected", [False, True])
@pytest.mark.parametrize("particles", [128, 256, 1024])
@pytest.mark.parametrize("name", ["shear_modulus", "excess_coordination", "pressure", "bulk_modulus"])
def test_the_error_of_an_exponent_holds_the_choice_of_levels_and_what_n_does(name, particles, corrected):
    """Laws with the corrections that discs have, without any scatter of packings: off by at most three errors."""
    power, correction, finite = LAWS[name]
    level = 10.0 ** np.arange(-6.0, -0.9, 0.25)
    value = level**power * (1.0 + correction * np.sqrt(level) + finite / (particles * np.sqrt(level)))
    scaling = made(np.stack([np.maximum(value, 1e-9)] * 2), level, particles, control="distance")
    scaling.value_sp[name][:] = np.maximum(value, 1e-9)
    fit = scaling.fit(name, over="distance", corrected=corrected)
    assert fit.sampling_error == pytest.approx(0.0, abs=1e-9)
    assert abs(fit.exponent - power) <= 3.0 * fit.error < 1.5
    assert fit.levels == np.count_nonzero(scaling.counted_p) < fit.of_levels == 21


def test_levels_on_the_plateau_of_n_widen_the_error_and_are_counted():
    """G = x^.5 (1 + 4 / (N sqrt(x))) is flat where N shows, and the exponent falls."""
    level, count = 10.0 ** np.arange(-7.0, -0.9, 0.5), 64
    value = np.sqrt(level) + 4.0 / count
    scaling = made(np.stack([value] * 3), level, count, control="distance")
    fit = scaling.fit("shear_modulus", smallest=1e-6)
    assert fit.exponent < 0.25 and abs(fit.exponent - 0.5) <= 2.0 * fit.error
    assert fit.on_plateau == np.count_nonzero(level < scaling.counted_from) - 2
    assert f"{fit.on_plateau} of them on the plateau of N" in repr(fit)


def test_the_error_is_that_of_the_mean_of_independent_packings():
    """Slopes drawn with a spread s give an error of about s / sqrt(S), over the packings."""
    rng = np.random.default_rng(1)
    pressure = np.array([1e-1, 1e-2, 1e-3])
    spread, count = 0.02, 400
    slope = 0.5 + spread * rng.standard_normal(count)
    table = made(pressure[None, :] ** slope[:, None], pressure)
    # large values lead in a mean of powers: small spreads keep the mean of slopes
    assert table.fit("shear_modulus").sampling_error == pytest.approx(spread / math.sqrt(count), rel=0.2)


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
        (lambda: made(np.ones((1, 2)), [1e-2, 1e-3]).fit("residual", smallest=5e-3), "at least 2 levels, got 1"),
        (lambda: made(np.ones((1, 3)), [1, 2, 3]).fit("residual", corrected=True), "at least 4 levels, got 3"),
        (lambda: made(np.ones((1, 2)), [1e-2, 1e-3]).fit("residual", over="time"), "over must be one of"),
        (lambda: pm.jamming_scaling(starts(1), [1e-2], distances=[1e-2]), "distances must be left out"),
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


def test_what_was_stopped_goes_on_with_the_same_bits_here_and_in_other_processes(tmp_path):
    """Interrupted after the first of two packings, finished by two processes: as followed at once, states and all."""
    given = {"strain": "isotropic", "states": True, "method": pm.HardVertex(stop_pressure=1e-3)}

    def progress(stage, figures):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as stop:
        pm.jamming_scaling(starts(2, 32), [1e-2, 5e-3], folder=tmp_path, progress=progress, **given)
    assert stop.value.folder == tmp_path
    assert pm.read_ensemble(tmp_path).counts()["done"] == 1
    parts = pm.jamming_scaling(starts(2, 32), [1e-2, 5e-3], folder=tmp_path, workers=1, **given)
    whole = pm.jamming_scaling(starts(2, 32), [1e-2, 5e-3], **given)
    for name in COLUMNS:
        assert (parts.value_sp[name] == whole.value_sp[name]).all(), name
    for some, all_ in zip(parts.states_sp, whole.states_sp, strict=True):
        for one, other in zip(some, all_, strict=True):
            assert (one.count_b == other.count_b).all() and one.modes == other.modes


def test_the_shear_modulus_of_a_packing_that_is_unstable_in_its_box_is_the_mean_over_directions():
    """Half of e C e over pure shears e of all directions, unit tensors: stability does not matter to this mean."""
    (scene,) = starts(1, 32)
    jammed = pm.jam(scene, pressure=1e-5, strain="isotropic")
    moduli = pm.elastic_moduli(scene.replace(packing=jammed.packing))
    assert not moduli.stable
    angle = np.linspace(0.0, np.pi, 8, endpoint=False)
    shears = np.stack([np.cos(angle), -np.cos(angle), np.sqrt(2.0) * np.sin(angle)], axis=1) / np.sqrt(2.0)
    mean = np.einsum("ka,ab,kb->k", shears, moduli.cauchy, shears).mean() / 2.0
    found = pm.jamming_scaling([scene], [1e-5], strain="isotropic").value_sp["shear_modulus"][0, 0]
    assert found == pytest.approx(mean / scene.pressure_unit, rel=1e-9)


def test_a_limit_of_time_is_no_part_of_what_is_asked_and_what_is_out_of_time_is_followed_again(tmp_path):
    scenes = starts(2, 32)
    with pytest.raises(TimeoutError, match="time_limit must suffice for a packing"):
        pm.jamming_scaling(scenes, [1e-2], folder=tmp_path, time_limit=1e-9)
    assert pm.read_ensemble(tmp_path).counts()["done"] == 0
    assert pm.jamming_scaling(scenes, [1e-2], folder=tmp_path, time_limit=1e9).packings == 2
    assert pm.jamming_scaling(scenes, [1e-2], folder=tmp_path, check=False).packings == 2
    assert len(pm.read_ensemble(tmp_path)) == 2


def test_a_scene_that_is_given_twice_counts_twice_and_laws_that_differ_are_refused():
    (scene,) = starts(1, 32)
    found = pm.jamming_scaling([scene, scene], [1e-2])
    assert found.packings == 2 and (found.value_sp["pressure"][0] == found.value_sp["pressure"][1]).all()
    with pytest.raises(
        ValueError, match=r"scenes\[1\] must have energies ~ overlap\^2 like the first, got overlap\^2.5"
    ):
        pm.jamming_scaling([scene, scene.replace(effects=(pm.Repulsion(law=pm.Hertz()),))], [1e-2])


def test_where_every_level_is_in_the_plateau_there_is_no_fit():
    found = pm.jamming_scaling(starts(2, 32), [1e-3, 1e-4])
    with pytest.raises(
        ValueError, match="smallest must leave at least 2 levels, got 0 of pressure from .* N = 32 sets a plateau"
    ):
        found.fit("shear_modulus")
    assert repr(found) == "JammingScaling: 2 of 2 packings of 32 particles at 2 levels of pressure from 0.0001 to 0.001"
