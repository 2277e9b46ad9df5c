"""Facts about packings that are pressed in time, with friction and without."""

import functools

import numpy as np
import pytest

import packmech as pm


@functools.cache
def pressed(mu, strain="isotropic", dimension=2, particles=32, pressure=1e-3):
    """Return the scene and the run of a packing pressed from where nothing touches for long."""
    sizes = pm.Bidisperse(ratio=1.4) if dimension == 2 else pm.Monodisperse()
    fraction = 0.7 if dimension == 2 else 0.5
    packing = pm.random_packing(particles, dimension=dimension, sizes=sizes, packing_fraction=fraction, seed=1)
    effects = pm.Repulsion(pm.LinearSpring(1.0)), pm.ContactDamping(0.3), pm.Friction(mu, 1.0, 0.1)
    scene = pm.Scene(packing, effects)
    return scene, pm.jam(scene, pressure=pressure, strain=strain)


@pytest.mark.parametrize("case", [(0.5, "isotropic", 2), (0.5, "free", 2), (0.3, "isotropic", 3)], ids=str)
def test_it_is_at_rest_under_the_pressure_with_its_springs(case):
    scene, run = pressed(*case)
    found = pm.contact_forces(scene.replace(packing=run.packing))
    assert run.outcome is pm.Outcome.CONVERGED and run.residual == found.residual <= 1e-8
    assert run.report["pressure"] == pytest.approx(1e-3, rel=1e-6)
    assert run.report["kinetic_energy"] < 1e-12
    assert len(run.packing.tangential) > 20
    if case[1] == "free":
        assert run.report["stress_anisotropy"] < 1e-5
    # what is at rest stays where it is, in time, too
    after = pm.simulate(scene.replace(packing=run.packing), steps=300, dt=0.05)
    assert np.abs(after.packing.position_nd - run.packing.position_nd).max() < 1e-7
    assert run.report["coordination_number"] >= run.report["isostatic_coordination"]


def test_friction_lets_packings_be_looser_with_fewer_contacts():
    """Silbert, Soft Matter 6, 2918 (2010): packing fraction and coordination fall with friction, to d + 1."""
    reports = [pressed(mu)[1].report for mu in (0.0, 0.1, 10.0)]
    assert [one["packing_fraction"] for one in reports] == sorted(
        (one["packing_fraction"] for one in reports), reverse=True
    )
    smooth, _, rough = reports
    assert smooth["isostatic_coordination"] == 4.0 and smooth["coordination_number"] >= 3.9
    assert rough["isostatic_coordination"] <= rough["coordination_number"] < 3.6


@functools.cache
def pressed_ellipses(mu):
    """Return the scene and the run of ellipses pressed together."""
    sizes, shapes = pm.Bidisperse(ratio=1.4), pm.Ellipses(aspect=1.5)
    packing = pm.random_packing(24, dimension=2, sizes=sizes, packing_fraction=0.7, seed=1, shapes=shapes)
    scene = pm.Scene(packing, (pm.Repulsion(pm.LinearSpring(1.0)), pm.Friction(mu, 1.0, 0.1), pm.ContactDamping(0.3)))
    return scene, pm.jam(scene, pressure=1e-3, strain="isotropic", method=pm.Press(rate=1e-3))


def test_rough_ellipses_are_pressed_to_rest_looser_than_smooth_ones():
    scene, run = pressed_ellipses(0.5)
    found = pm.contact_forces(scene.replace(packing=run.packing))
    assert run.outcome is pm.Outcome.CONVERGED and run.residual == found.residual <= 1e-8
    assert run.report["pressure"] == pytest.approx(1e-3, rel=1e-6)
    assert run.report["coordination_number"] >= run.report["isostatic_coordination"] - 1e-12 >= 3.0
    assert np.abs(found.tangential_cd).max() > 0.05 * found.normal_c.mean()
    assert pm.elastic_moduli(found.scene).stable_in_box
    smooth = pressed_ellipses(0.0)[1]
    assert smooth.outcome is pm.Outcome.CONVERGED
    assert smooth.report["packing_fraction"] > run.report["packing_fraction"]
    assert smooth.report["coordination_number"] > run.report["coordination_number"]


def test_rough_linked_dimers_are_pressed_to_rest_with_their_links():
    packing = pm.cluster_packing(12, pm.Dimer(), dimension=2, packing_fraction=0.6, seed=2)
    scene = pm.Scene(packing, (pm.Repulsion(pm.LinearSpring(1.0)), pm.Friction(0.5, 1.0, 0.1), pm.ContactDamping(0.3)))
    run = pm.jam(scene, pressure=1e-3, strain="isotropic", method=pm.Press(rate=1e-3))
    found = pm.contact_forces(scene.replace(packing=run.packing))
    assert run.outcome is pm.Outcome.CONVERGED and run.residual == found.residual <= 1e-8
    assert run.packing.link_error < 1e-12 and found.tension_l.any()
    assert found.pressure == pytest.approx(1e-3, rel=1e-6)
    assert run.report["coordination_number"] >= run.report["isostatic_coordination"] - 1e-12
    assert pm.elastic_moduli(found.scene).bulk_modulus > 0.0


def test_without_a_dashpot_it_comes_to_rest_by_one_of_its_own_and_says_so():
    scene, damped = pressed(0.5)
    bare = scene.without(pm.ContactDamping)
    bare = bare.replace(effects=(bare.effects[0], pm.Friction(0.5, 1.0)))
    run = pm.jam(bare, pressure=1e-3, strain="isotropic", method=pm.Press(step_limit=200_000))
    assert run.outcome is pm.Outcome.CONVERGED and run.residual <= 1e-8
    assert run.report["added_damping"] == pytest.approx(0.3 * scene.packing.mass_n.mean() ** 0.5, rel=1e-12)
    assert damped.report["added_damping"] == 0.0


def test_without_friction_it_ends_in_a_packing_that_is_jammed():
    scene, run = pressed(0.0)
    bare = scene.without(pm.Friction).replace(packing=run.packing)
    assert run.packing.tangential is None
    # forces balance without any friction, and the network is that of a minimum
    assert np.sqrt((pm.forces(bare) ** 2).sum(axis=1)).max() < 1e-7 * pm.contact_forces(bare).normal_c.mean()
    settled = pm.quench(bare, force_tolerance=1e-10)
    assert pm.energy(bare.replace(packing=settled.packing)) == pytest.approx(pm.energy(bare), rel=1e-9)


def test_it_goes_on_from_its_own_springs_to_another_pressure():
    scene, run = pressed(0.5)
    again = pm.jam(scene.replace(packing=run.packing), pressure=1e-3, strain="isotropic")
    assert np.abs(again.packing.position_nd - run.packing.position_nd).max() < 1e-5
    assert again.steps < 0.5 * run.steps
    more = pm.jam(scene.replace(packing=run.packing), pressure=1.2e-3, strain="isotropic")
    assert more.report["packing_fraction"] > run.report["packing_fraction"]


def test_the_same_start_gives_the_same_bits():
    scene, run = pressed(0.5)
    assert pm.jam(scene, pressure=1e-3, strain="isotropic").packing == run.packing


def test_a_packing_file_keeps_what_holds_it(tmp_path):
    scene, run = pressed(0.5)
    pm.write_packing(run.packing, tmp_path / "rough.npz")
    read = pm.contact_forces(scene.replace(packing=pm.read_packing(tmp_path / "rough.npz")))
    assert read.residual == run.residual


def test_limits_are_outcomes():
    scene, _ = pressed(0.5)
    few = pm.jam(scene, pressure=1e-3, method=pm.Press(step_limit=500), check=False)
    assert few.outcome is pm.Outcome.STEP_LIMIT and few.stages[-1].steps == 500
    with pytest.raises(pm.NotConverged):
        pm.jam(scene, pressure=1e-3, method=pm.Press(step_limit=500))
    late = pm.jam(scene, pressure=1e-3, time_limit=1e-6, check=False)
    assert late.outcome is pm.Outcome.TIME_LIMIT


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda scene: pm.jam(scene, method=pm.HardVertex()), "method must be Press for a scene with friction"),
        (lambda scene: pm.Press(rate=-1.0), "rate must be a finite number above 0"),
        (lambda scene: pm.Press(step_limit=0), "step_limit must be an integer at least 1"),
        (lambda scene: pm.jam(scene.replace(effects=(*scene.effects, pm.Gravity()))), "got Gravity"),
    ],
)
def test_what_cannot_be_pressed_is_refused_by_name(call, message):
    with pytest.raises(ValueError, match=message):
        call(pressed(0.5)[0])


def test_a_crystal_pressed_onto_a_saddle_is_no_success():
    square = pm.lattice_packing("square", repeats=(4, 4), relative_overlap=0.0667)
    scene = pm.Scene(square, (pm.Repulsion(pm.LinearSpring()), pm.ContactDamping(0.3)))
    run = pm.jam(scene, pressure=pm.pressure(scene), strain="isotropic", method=pm.Press(), check=False)
    assert run.outcome is pm.Outcome.UNSTABLE
    assert run.report["negative_modes"] == pm.elastic_moduli(scene).negative_positions > 0
