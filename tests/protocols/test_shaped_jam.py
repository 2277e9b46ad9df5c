"""Facts about jamming ellipses and spheroids, and following them in pressure, density and stress."""

import functools

import numpy as np
import pytest

import packmech as pm


def start(d=2, count=20, aspect=1.5, seed=1):
    packing = pm.random_packing(
        count, dimension=d, packing_fraction=0.6 if d == 2 else 0.4, seed=seed, shapes=pm.Ellipses(aspect)
    )
    return pm.Scene(packing, (pm.Repulsion(),))


@functools.cache
def jammed(d=2, pressure=1e-5, strain="free"):
    scene = start(d)
    return scene.replace(packing=pm.jam(scene, pressure=pressure, strain=strain).packing)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("strain", ["free", "isotropic"])
def test_packings_jam_at_the_pressure_asked_for_with_one_state_of_self_stress(d, strain):
    scene = start(d, aspect=0.6 if d == 3 else 1.5)
    run = pm.jam(scene, pressure=1e-6, strain=strain)
    report, there = run.report, scene.replace(packing=run.packing)
    assert run.ok and run.residual < 1e-5
    assert pm.pressure(there) / there.pressure_unit == pytest.approx(1e-6, rel=1e-6)
    assert report["states_of_self_stress"] == 1 and report["rank_certain"]
    assert report["floppy_modes"] == -report["excess_contacts"] > 0
    held = run.packing.particles - report["rattlers"]
    assert report["isostatic_contacts"] == held * (3 if d == 2 else 5) - d + (
        1 if strain == "isotropic" else d * (d + 1) // 2
    )
    stress = pm.stress_tensor(there)
    if strain == "free":
        assert np.abs(stress + pm.pressure(there) * np.eye(d)).max() < 1e-5 * pm.pressure(there)
    else:
        assert np.allclose(run.packing.box.lattice_dd / run.packing.box.lattice_dd[0, 0], np.eye(d))
    # torques balance: the stress is symmetric
    assert np.abs(stress - stress.T).max() < 1e-6 * pm.pressure(there)
    assert pm.normal_modes(there).negative == 0
    assert run.packing.shapes.aspect_n.tolist() == scene.packing.shapes.aspect_n.tolist()


def test_a_packing_that_is_jammed_is_followed_in_pressure():
    scene = jammed()
    runs = pm.sweep_pressure(scene, [1e-4, 1e-3, 1e-5])
    assert all(one.ok for one in runs)
    pressures = [one.report["pressure"] for one in runs]
    assert np.allclose(pressures, [1e-4, 1e-3, 1e-5], rtol=1e-6)
    fractions = [pm.packing_fraction(one.packing) for one in runs]
    assert fractions[2] < fractions[0] < fractions[1]


def test_distance_above_jamming_is_what_was_asked_for():
    runs = pm.compress(jammed(), [1e-5, 1e-4, 1e-3], strain="free")
    for run, distance in zip(runs, (1e-5, 1e-4, 1e-3), strict=True):
        assert run.ok and pm.packing_fraction(run.packing) - run.report["onset"] == pytest.approx(distance, rel=1e-8)
    # harmonic: pressure in proportion
    ratio = [one.report["pressure"] / one.report["distance"] for one in runs]
    assert np.ptp(ratio) < 0.1 * ratio[0]


@pytest.mark.parametrize("pressure", [None, 1e-3])
def test_shear_stabilized_packings_have_an_isotropic_stress(pressure):
    run = pm.shear_stabilize(jammed(), pressure=pressure)
    assert run.ok and run.report["stress_anisotropy"] < 1e-7
    if pressure is None:
        assert run.packing.box.volume == pytest.approx(jammed().packing.box.volume, rel=1e-12)


def test_a_packing_is_followed_to_a_stress_that_shears():
    scene = scene_at = jammed(pressure=1e-3)
    stress = pm.stress_tensor(scene)
    asked = stress + 0.02 * pm.pressure(scene) * np.array([[0.0, 1.0], [1.0, 0.0]])
    run = pm.sweep_stress(scene, [asked])[0]
    found = pm.stress_tensor(scene_at.replace(packing=run.packing))
    assert np.abs(found - asked).max() < 1e-8 * pm.pressure(scene)


def test_step_halving_ends_at_the_energy_in_a_box_of_fixed_shape():
    scene = start()
    run = pm.jam(scene, method=pm.StepHalving(energy_tolerance=1e-10, increment=1e-3), strain="isotropic")
    per = pm.energy(scene.replace(packing=run.packing)) / 20
    assert 1e-10 < per < 2e-10 and run.residual <= 1e-5
    assert pm.packing_fraction(run.packing) == pytest.approx(
        pm.packing_fraction(jammed(strain="isotropic").packing), abs=0.02
    )


def test_what_only_discs_know_is_refused_by_name():
    with pytest.raises(ValueError, match="method must be Decompression, Press, or StepHalving in a box of fixed shape"):
        pm.jam(start(), method=pm.HardVertex())
    with pytest.raises(ValueError, match="method must be Decompression"):
        pm.jam(start(), method=pm.StepHalving(), strain="free")


def test_a_seed_gives_the_same_bits_twice():
    one, other = (pm.jam(start(seed=4), pressure=1e-4, strain="isotropic").packing for _ in range(2))
    assert one == other


def test_random_packings_of_ellipses_have_the_radii_and_places_of_discs():
    plain = pm.random_packing(50, dimension=2, packing_fraction=0.8, seed=3)
    shaped = pm.random_packing(50, dimension=2, packing_fraction=0.8, seed=3, shapes=pm.Ellipses(1.7))
    assert np.array_equal(plain.position_nd, shaped.position_nd) and np.array_equal(plain.radius_n, shaped.radius_n)
    assert (shaped.shapes.aspect_n == 1.7).all() and pm.packing_fraction(shaped) == pm.packing_fraction(plain)
    each = np.linspace(0.5, 2.0, 50)
    assert np.array_equal(
        pm.random_packing(50, dimension=3, packing_fraction=0.5, seed=3, shapes=pm.Ellipses(each)).shapes.aspect_n, each
    )
    # directions alike: the mean of mu mu^T is that of the sphere
    many = pm.random_packing(
        4000, dimension=3, packing_fraction=0.5, seed=1, shapes=pm.Ellipses(2.0)
    ).shapes.director_nd
    assert np.abs(many.T @ many / 4000 - np.eye(3) / 3).max() < 0.02


def test_scene_files_keep_shapes_and_draw_them(tmp_path):
    scene = jammed()
    pm.write_scene(scene, tmp_path / "ellipses.toml")
    assert pm.read_scene(tmp_path / "ellipses.toml").packing == scene.packing
    fields = {
        "kind": '"random"',
        "particles": 12,
        "packing_fraction": 0.8,
        "seed": 2,
        "shapes": "{ kind = 'ellipses', aspect = 1.4 }",
    }
    lines = [f"{name} = {value}" for name, value in fields.items()]
    text = "\n".join(["[packing]", *lines, "", "[[effects]]", 'kind = "repulsion"', ""])
    (tmp_path / "drawn.toml").write_text(text, encoding="utf-8")
    drawn = pm.read_scene(tmp_path / "drawn.toml").packing
    assert drawn == pm.random_packing(12, dimension=2, packing_fraction=0.8, seed=2, shapes=pm.Ellipses(1.4))


@pytest.mark.parametrize("seed", range(5))
def test_two_spheroids_in_a_cube_leave_the_symmetric_saddle_and_jam(seed):
    packing = pm.random_packing(2, dimension=3, packing_fraction=0.3, seed=seed, shapes=pm.Ellipses(1.5))
    run = pm.jam(pm.Scene(packing, (pm.Repulsion(),)), pressure=1e-6, strain="isotropic", check=False)
    assert run.outcome is pm.Outcome.CONVERGED
    assert abs(run.report["pressure"] / 1e-6 - 1.0) < 1e-6 and run.report["states_of_self_stress"] >= 1


@pytest.mark.parametrize("strain", ["isotropic", "free"])
@pytest.mark.parametrize("count", [1, 2, 3, 4])
@pytest.mark.parametrize(("d", "aspect"), [(2, 1.5), (3, 1.5), (3, 0.6)])
def test_a_few_ellipses_and_spheroids_jam_on_a_backbone_that_bears_the_pressure(d, aspect, count, strain):
    run = pm.jam(start(d, count=count, aspect=aspect), pressure=1e-6, strain=strain, check=False)
    assert run.outcome is pm.Outcome.CONVERGED
    assert run.report["backbone_pressure"] > 0.99
