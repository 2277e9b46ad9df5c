"""Facts about the studies of scaling and cementing: laws give their exponents back, and packings obey identities."""

import math

import matplotlib.pyplot as plt
import numpy as np
import pytest

import packmech as pm

# exponent, correction and size of shear modulus, contacts in excess, pressure and bulk modulus of discs
LAWS = [(0.5, 0.6, 4.0), (0.5, 0.0, -1.0), (1.0, 1.6, 0.0), (0.0, 3.4, 0.0)]


@pytest.mark.parametrize("law", LAWS)
def test_what_n_sets_is_told_from_the_correction_by_packings_of_several_n(script, law):
    power, correction, size = law
    level = np.geomspace(1e-2, 1e-1, 7)
    x, n = np.tile(level, 3), np.repeat([64, 256, 1024], 7)
    y = 2.0 * x**power * (1.0 + correction * np.sqrt(x) + size / (n * np.sqrt(x)))
    assert script("scaling/laws").fit(x, y, n) == pytest.approx((power, 2.0, correction, size), abs=1e-6)


def test_a_correction_to_scaling_is_found_along_with_the_exponent(script):
    x = np.geomspace(1e-3, 1e-1, 7)
    y = 2.0 * np.sqrt(x) * (1.0 + 1.5 * np.sqrt(x))
    assert np.polyfit(np.log(x), np.log(y), 1)[0] > 0.55
    assert script("scaling/laws").fit(x, y, np.full(7, 64)) == pytest.approx((0.5, 2.0, 1.5), abs=1e-7)


def followed(script, **more):
    given = {
        "scene": "springs",
        "particles": 64,
        "over": "pressure",
        "levels": [1e-2, 3e-3, 1e-3, 1e-5],
        "strain": "free",
    }
    return script("scaling/scaling").follow(**(given | more))


@pytest.fixture(scope="module")
def packings(script):
    return [followed(script, seed=seed) for seed in range(3)]


def test_energy_and_bulk_modulus_fall_as_one_integral_of_the_pressure(packings):
    """dE = -p dV and B = -V dp/dV: dE/dp = p V / B, so that the exponents of E and B add up to that of p^2."""
    figure = np.mean([one["figure_lq"] for one in packings], axis=0)
    _, pressure, energy, excess, bulk, shear = figure.T
    power = [np.polyfit(np.log(pressure[:3]), np.log(value[:3]), 1)[0] for value in (energy, bulk)]
    # B is no pure power over this decade, nor does the volume stay what it is
    assert sum(power) == pytest.approx(2.0, abs=0.1)
    assert (np.diff(excess) < 0.0).all()
    # with every strain free each of them is stable to shear
    assert all((one["figure_lq"][:, 5] > 0.0).all() for one in packings)


def test_the_distance_is_that_to_the_packing_fraction_at_which_the_last_pressure_vanishes(packings):
    """P = B (phi - phi_J) / phi at the lowest pressure, so that distances fall with pressure, to about P / .4 there."""
    distance, pressure = np.mean([one["figure_lq"] for one in packings], axis=0)[:, :2].T
    assert (np.diff(distance) < 0.0).all()
    assert 0.2 < pressure[-1] / distance[-1] < 0.6


def test_packings_are_followed_over_the_distance_to_their_own_hard_packing_with_all_their_states(script):
    one = followed(script, particles=32, over="distance", levels=[1e-3, 1e-2], strain="isotropic", seed=0)
    assert one["figure_lq"][:, 0] == pytest.approx([1e-3, 1e-2], abs=1e-9)
    # d N' - d modes for N' particles without rattlers
    assert (one["count_lb"].sum(axis=1) <= 2 * 32 - 2).all() and (one["count_lb"].sum(axis=1) % 2 == 0).all()


def test_the_shear_modulus_of_a_packing_that_is_unstable_in_its_box_is_the_mean_over_directions(script):
    """Half of e C e over pure shears e of all directions, unit tensors: stability does not matter to this mean."""
    found = followed(script, particles=32, levels=[1e-5], strain="isotropic", seed=0)["figure_lq"][0, 5]
    scene = pm.read_scene(script("scaling/scaling").HERE / "springs.toml", seed=0, changes={"packing.particles": 32})
    method = pm.HardVertex(start_packing_fraction=0.9, stop_pressure=1e-4)
    jammed = pm.jam(scene, pressure=1e-5, strain="isotropic", method=method)
    moduli = pm.elastic_moduli(scene.replace(packing=jammed.packing))
    angle = np.linspace(0.0, np.pi, 8, endpoint=False)
    shears = np.stack([np.cos(angle), -np.cos(angle), math.sqrt(2.0) * np.sin(angle)], axis=1) / math.sqrt(2.0)
    mean = np.einsum("ka,ab,kb->k", shears, moduli.cauchy, shears).mean() / 2.0
    assert found == pytest.approx(mean, rel=1e-6)


def test_laws_of_what_was_followed_are_written_and_drawn(script, tmp_path):
    given = {"particles": (40, 64), "out": tmp_path}
    script("scaling/scaling").main(packings=2, levels=(0.1, 0.03, 1e-2), workers=0, **given)
    script("scaling/laws").main(**given)
    plt.close("all")
    assert (tmp_path / "springs-sizes.png").stat().st_size > 5_000
    table = np.genfromtxt(tmp_path / "springs-64.csv", delimiter=",", names=True)
    assert table["pressure"] == pytest.approx([0.1, 0.03, 1e-2], rel=1e-4)
    assert (table["pressure_error"] >= 0.0).all() and (np.diff(table["shear_modulus"]) < 0.0).all()


def test_weighted_means_of_packings_have_the_closed_forms(script):
    study = script("cementing/curves")
    value, weight = np.array([[[1.0], [2.0]], [[4.0], [np.inf]]]), np.array([[[1.0], [2.0]], [[1.0], [0.0]]])
    mean, error = study.mean(value, weight)
    assert mean == pytest.approx([9.0 / 4.0])
    # off by -1.25 - 0.5 in one packing, by 1.75 in the other
    assert error == pytest.approx([np.sqrt(2.0 * 2.0 * 1.75**2) / 4.0])
    assert [one.tolist() for one in study.mean(np.array([[[1.0]] * 2, [[3.0]] * 2]), np.ones((2, 2, 1)))] == [
        [2.0],
        [1.0],
    ]


def test_curves_of_cemented_packings_start_from_their_moduli_and_end_rigid(script, tmp_path):
    script("cementing/cementing").main(particles=(16,), packings=2, orders=2, out=tmp_path, workers=0)
    script("cementing/curves").main(tmp_path)
    plt.close("all")
    assert (tmp_path / "cementing.png").stat().st_size > 5_000
    table = np.genfromtxt(tmp_path / "curve.csv", delimiter=",", names=True)
    packing = pm.read_table(tmp_path / "orders.csv")
    first = (packing["number"] == 0.0) & (packing["order"] == 0.0)
    assert table["bulk_Reuss"][0] == pytest.approx(packing["bulk_reuss"][first].mean())
    # without trials of finite bounds there is no mean
    some = np.isfinite(table["bulk"])
    assert some[0] and (table["bulk_Reuss"] <= table["bulk_Voigt"])[some].all()
    assert table["all_stiff"][0] == 0.0 and (np.diff(table["some_stiff"]) >= 0.0).all()
    assert (packing["first_stiff"] <= packing["all_stiff"]).all()
