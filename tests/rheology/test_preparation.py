"""Facts about preparation: a material's constants, and scenes that are at rest before they are sheared."""

import functools
import math

import numpy as np
import pytest

import packmech as pm
from packmech.effects.material import contact_stiffness
from packmech.validation.particle_shear import ParticleShear


@pytest.fixture(scope="module")
def microgel():
    return pm.read_scene("microgel")


# -- constants of a material -------------------------------------------------------------------------------------------


def test_stiffness_of_parallel_cylinders_is_pi_eighths_of_the_modulus_and_a_third_more_at_most():
    assert contact_stiffness(8000.0) == pytest.approx(1000.0 * math.pi, rel=1e-15)
    assert contact_stiffness(8000.0, poisson_ratio=0.5) == pytest.approx(
        contact_stiffness(8000.0) * 4.0 / 3.0, rel=1e-15
    )


def test_constants_of_the_default_material_are_those_of_the_reference_package_in_si_units():
    # the package counts stiffness in 1e-6 Pa, mass in mg per m; its code's density is 50
    made, old = pm.material_constants(density=50.0), ParticleShear(particles=150)
    assert made.stiffness == pytest.approx(old.material.stiffness * 1e-6, rel=1e-14)
    assert made.mean_mass == pytest.approx(old.mass * 1e-6, rel=1e-14)
    assert made.time == pytest.approx(old.tau, rel=1e-14)
    assert made.frequency == pytest.approx(old.frequency, rel=1e-14)
    assert made.damping == pytest.approx(old.material.viscosity * 1e-6, rel=1e-14)


def test_masses_of_one_density_have_the_mean_mass(microgel):
    assert microgel.packing.mass_n.mean() == pytest.approx(pm.material_constants().mean_mass, rel=1e-13)


def test_what_a_period_leaves_of_a_velocity_is_the_decay_asked_for():
    made = pm.material_constants(period_decay=0.3)
    assert math.exp(-made.background_damping / made.frequency) == pytest.approx(0.3, rel=1e-14)


def test_effects_of_a_material_have_no_friction_where_there_is_none():
    made = pm.material_constants(friction_coefficient=0.0)
    assert not any(isinstance(one, pm.Friction) for one in made.effects())
    assert pm.material_constants().effects()[2] == pm.Friction(0.01, made.stiffness, made.damping)


# -- at rest -----------------------------------------------------------------------------------------------------------


def test_bonds_made_in_a_frictionless_minimum_leave_it_at_rest(microgel):
    # bonds push as the contacts did, and tangential springs are slack
    rest = pm.equilibrate(microgel, amplitude=0.2, relative_frequency=0.025)
    assert rest.outcome is pm.Outcome.CONVERGED and rest.periods == 1
    assert rest.packing == microgel.packing
    assert rest.oscillation == 0.5 * np.ptp(rest.baseline.shear_stress_t)
    assert rest.ratio < 1e-10


def test_a_scene_that_was_moved_settles_until_it_oscillates_little(microgel):
    rng = np.random.default_rng(2)
    moved = microgel.packing.position_nd + 0.1 * microgel.packing.radius_n.min() * rng.standard_normal((150, 2))
    scene = microgel.replace(packing=microgel.packing.replace(position_nd=moved))
    rest = pm.equilibrate(scene, amplitude=0.005, relative_frequency=0.025)
    assert rest.outcome is pm.Outcome.CONVERGED and rest.periods > 1 and rest.ratio < 0.1
    # what follows starts as the last look did: its first period without strain is the same
    run = pm.oscillatory_shear(
        scene.replace(packing=rest.packing),
        amplitude=0.005,
        relative_frequency=0.025,
        pre_periods=1,
        periods=2,
    )
    before = run.shear_stress_t[run.time_t < 1.0 / run.frequency]
    assert 0.5 * np.ptp(before) == pytest.approx(rest.oscillation, rel=0.02)
    assert 0.5 * np.ptp(before) < 0.1 * run.moduli.stress


def test_a_scene_that_cannot_settle_in_time_says_so(microgel):
    rng = np.random.default_rng(2)
    moved = microgel.packing.position_nd + 3.0 * rng.standard_normal((150, 2))
    scene = microgel.replace(packing=microgel.packing.replace(position_nd=moved))
    how = {"amplitude": 1e-6, "relative_frequency": 0.025, "step_limit": 2000}
    with pytest.raises(pm.NotConverged) as caught:
        pm.equilibrate(scene, **how)
    assert caught.value.run.outcome is pm.Outcome.STEP_LIMIT
    assert pm.equilibrate(scene, check=False, **how).ratio > 0.1


def test_a_frictionless_minimum_that_is_not_found_is_an_outcome_where_that_is_not_checked(microgel, monkeypatch):
    scene = microgel.replace(effects=microgel.effects[:3])
    drawn = scene.replace(packing=pm.fill_box(microgel.packing.box, 150, packing_fraction=1.5, seed=1, density=1e-9))
    short = functools.partial(pm.quench, step_limit=3)
    monkeypatch.setattr("packmech.rheology.equilibrate.quench", short)
    how = {"amplitude": 0.2, "relative_frequency": 0.025}
    with pytest.raises(pm.NotConverged) as caught:
        pm.equilibrate(drawn, **how)
    minimum = caught.value.run
    assert minimum.outcome is pm.Outcome.STEP_LIMIT
    rest = pm.equilibrate(drawn, check=False, **how)
    assert rest.outcome is pm.Outcome.STEP_LIMIT and rest.periods == 1
    assert rest.packing == minimum.packing
    assert math.isnan(rest.expected_stress) and math.isnan(rest.ratio) and rest.oscillation > 0.0
    assert "step limit" in repr(rest)
    given = pm.equilibrate(drawn, expected_stress=1e9, check=False, **how)
    assert given.outcome is pm.Outcome.STEP_LIMIT and given.ratio < 0.1
    assert not pm.run(drawn.replace(drive=pm.OscillatoryShearDrive(periods=1, largest_oscillation=0.1, **how))).ok


def test_time_that_runs_out_within_the_frictionless_minimum_is_an_outcome(microgel):
    drawn = pm.fill_box(microgel.packing.box, 150, packing_fraction=1.5, seed=1, density=1e-9)
    scene = microgel.replace(packing=drawn, effects=microgel.effects[:3])
    how = {"amplitude": 0.2, "relative_frequency": 0.025, "time_limit": 1e-9}
    rest = pm.equilibrate(scene, check=False, **how)
    assert rest.outcome is pm.Outcome.TIME_LIMIT and not rest.ok
    assert rest.stages[0].name == "FIRE" and rest.stages[0].residual > 1e-10
    assert rest.steps <= 1 and math.isnan(rest.expected_stress)
    with pytest.raises(pm.NotConverged, match="time limit was reached") as caught:
        pm.equilibrate(scene, **how)
    assert isinstance(caught.value.run, pm.Equilibration)


def test_without_bonds_the_frictionless_minimum_comes_first(microgel):
    scene = microgel.replace(effects=microgel.effects[:1])
    drawn = pm.fill_box(microgel.packing.box, 150, packing_fraction=1.5, seed=1, density=1e-9)
    rest = pm.equilibrate(scene.replace(packing=drawn), amplitude=0.2, relative_frequency=0.025)
    assert rest.packing == microgel.packing


def test_the_expected_stress_is_amplitude_times_the_frictionless_modulus(microgel):
    modulus = pm.elastic_moduli(microgel.replace(effects=microgel.effects[:1])).shear_modulus
    rest = pm.equilibrate(microgel, amplitude=0.2, relative_frequency=0.025)
    assert rest.expected_stress == pytest.approx(0.2 * modulus, rel=1e-14)


def test_a_packing_that_resists_no_shear_needs_an_expected_stress(microgel):
    loose = pm.Packing([[1.0, 1.0], [5.0, 5.0]], [0.5, 0.5], pm.Box.cubic(10.0, 2))
    scene = microgel.replace(packing=loose, effects=microgel.effects[:1])
    with pytest.raises(ValueError, match="expected_stress must be given where nothing resists shear"):
        pm.equilibrate(scene, amplitude=0.2, relative_frequency=0.025)


# the named parameters of doParticleShearSimulation (Table S2-1 of particleShear's documentation)
OLD_NAMES = """
    root_folder theAmplitude theMu do_permanent_links cut_lines Young_modulus_spheres N packing_fraction density
    bimodal_factor relative_viscosity relative_transversal_link_strength relative_frequency
    avoid_horizontal_angle_degree interface_reenforcement_central interface_reenforcement_tangential
    central_repulsion_coefficient keep_viscosity_coefficients_constant avoid_height_spanning_particles cut_top_bottom
    saveOutputImages imageFileType remove_link_fraction edge_fuzziness doCutByTriangulation doDrawing saveData
    saveStressTensorData plotStress relative_y_scale_force pre_periods periods post_periods cool_factor
""".split()


def test_every_parameter_of_the_reference_package_has_its_place_here():
    rows = pm.material_constants.__doc__.split("=\n")[2].splitlines()
    named = {word for row in rows for word in row[:42].replace(",", " ").split()}
    assert set(OLD_NAMES) <= named, set(OLD_NAMES) - named
