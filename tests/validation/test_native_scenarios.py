"""Facts about the reference package's scenarios under native dynamics: each row's native statement, measured."""

import functools
from pathlib import Path

import numpy as np
import pytest
from validation.native_tables import elastic_pair_forces, judge_natively, native_tensors, table_rows

import packmech as pm
from packmech.dynamics.pair_forces import PairForces, pair_forces
from packmech.rheology.drives import follow
from packmech.validation import particle_shear as ps

PAIRS = [name for name in ps.SCENARIOS if not name.startswith(("assembly", "crosslinked"))]
ASSEMBLIES = [name for name in ps.SCENARIOS if name not in PAIRS]
# forces of the scenes of a disc or two are in 1e-12 N per metre, lengths in um
MICRO = 1e-6


def scene_of(name):
    return pm.read_scene(name.replace("_", "-"))


def conserved(name, run):
    """Return momenta as `particle_shear.judge` has them: their change over the discs' own."""
    trace, start = run.trace, ps.SCENARIOS[name]().start
    own = start.mass_n * np.linalg.norm(start.velocity_nd, axis=1)
    linear = np.abs(np.diff(trace.momentum_td[[0, -1]], axis=0)).max()
    if trace.angular_momentum_tk is None:
        x, v = trace.position_tnd, trace.velocity_tnd
        angular_t = (run.packing.mass_n * (x[..., 0] * v[..., 1] - x[..., 1] * v[..., 0])).sum(axis=1)
    else:
        angular_t = trace.angular_momentum_tk[:, -1]
    spin = np.abs(start.spin_n)
    return {
        "linear momentum": np.array([0.0, linear / ((own.sum() + (start.mass_n * spin).sum()) or 1.0)]),
        "angular momentum": np.array(
            [0.0, abs(angular_t[-1] - angular_t[0]) / ((500.0 * own + start.inertia_n * spin).sum() or 1.0)]
        ),
    }


@functools.cache
def measured(name):
    """Return the native tensors of a scenario at the time that its rows are about, and its momenta to the end."""
    scenario, scene = ps.SCENARIOS[name](), scene_of(name)
    return of_pair(name, scenario, scene) if name in PAIRS else of_assembly(name)


def of_pair(name, scenario, scene):
    seen = []

    def watch(stage, figures):
        if figures["steps"] == scenario.measured_step and "engine" in figures:
            seen.append(pair_forces(figures["engine"]))

    run = follow(
        scene.drive,
        scene,
        frames=1,
        progress=watch,
        steps=len(scenario.strain_rate_t),
        trace_every=scenario.measured_step,
    )
    at = run.trace.step_t.tolist().index(scenario.measured_step)
    packing = scene.packing.replace(position_nd=run.trace.position_tnd[at])
    pairs = seen[0] if seen else elastic_pair_forces(scene.replace(packing=packing))
    tensors = {key: tensor_t[at] for key, tensor_t in run.trace.stress.items()}
    found = native_tensors(
        packing, pairs, tensors, held_n=run.held_n, unit=MICRO, velocity_nd=run.trace.velocity_tnd[at]
    )
    return found | conserved(name, run)


@functools.cache
def sheared(name):
    """Return a run of an assembly's scene, and who pushes whom at its end."""
    scene, engines = scene_of(name), []
    drive = scene.drive
    run = pm.oscillatory_shear(
        scene,
        amplitude=drive.amplitude,
        relative_frequency=drive.relative_frequency,
        pre_periods=drive.pre_periods,
        periods=drive.periods,
        frames=38,
        progress=lambda stage, figures: engines.append(figures["engine"]),
    )
    return run, pair_forces(engines[-1])


def of_assembly(name):
    if name != "assembly_at_rest":
        run, pairs = sheared(name)
        tensors = {key: tensor_t[-1] for key, tensor_t in run.stress.items()}
        return native_tensors(run.packing, pairs, tensors, velocity_nd=run.velocity_nd)
    # the last frame before the strain starts: the same discs, without a loop of their own to compile
    run, _ = sheared("assembly_sheared")
    assert scene_of(name).packing == scene_of("assembly_sheared").packing
    assert scene_of(name).effects == scene_of("assembly_sheared").effects
    frame = int(np.flatnonzero(run.frame_time_f < run.start)[-1])
    packing = run.packing.replace(position_nd=run.position_fnd[frame], box=pm.Box(run.lattice_fdd[frame]))
    i, j, image, _, force, _ = run.touching_f[frame]
    x = packing.position_nd
    branch = x[j] - x[i] + image @ packing.box.lattice_dd.T
    pairs = PairForces(i, j, force, branch, np.zeros(len(i), dtype=bool))
    at = int(np.argmin(np.abs(run.time_t - run.frame_time_f[frame])))
    assert run.strain_t[at] == 0.0
    tensors = {key: tensor_t[at] for key, tensor_t in run.stress.items()}
    rest = np.zeros_like(packing.position_nd)
    assert run.kinetic_t[at] < 1e-12 * run.potential_t[at]
    return native_tensors(packing, pairs, tensors, velocity_nd=rest)


@pytest.mark.parametrize("name", ps.SCENARIOS)
def test_every_native_statement_of_a_scenario_holds(name):
    found = judge_natively(ps.SCENARIOS[name](), measured(name))
    assert all(all(each.values()) for each in found.values()), found
    assert {row.about for row in ps.SCENARIOS[name]().rows} == set(found)


def test_recorded_table_says_which_rows_hold_for_which_model():
    recorded = (Path(__file__).parents[2] / "recordings" / "dynamics" / "reference_scenarios.md").read_text()
    found = []
    for name, made in ps.SCENARIOS.items():
        scenario = made()
        native = judge_natively(scenario, measured(name))
        found += table_rows(scenario, ps.judge(scenario, scenario.run()), native)
    lines = [f"| {' | '.join(row)} |" for row in found]
    assert [line for line in recorded.splitlines() if line.startswith("| S4-")] == lines
    assert sum("FAILS" in line for line in lines) == 2


def test_a_contact_across_the_boundary_is_a_contact_like_any_other():
    scene = scene_of("two_spheres_across")
    inside = scene.packing.replace(position_nd=(scene.packing.position_nd + [250.0, 0.0]) % 500.0)
    tensors = [
        {key: tensor_t[-1] for key, tensor_t in follow(one.drive, one, frames=1).trace.stress.items()}
        for one in (scene, scene.replace(packing=inside))
    ]
    assert (
        len(pm.find_contacts(inside, gap_tolerance=0.0)) == 1
        and not pm.find_contacts(inside, gap_tolerance=0.0).image_cd.any()
    )
    for key, across in tensors[0].items():
        assert np.abs(across - tensors[1][key]).max() <= 1e-12 * np.abs(tensors[0]["contact"]).max(), key


@pytest.mark.parametrize("name", PAIRS)
def test_scenes_of_a_disc_or_two_start_as_the_packages_scenarios_do(name):
    scene, scenario = scene_of(name), ps.SCENARIOS[name]()
    start, made, drive = scenario.start, scenario.material, scene.drive
    assert np.array_equal(scene.packing.position_nd, start.position_nd)
    assert np.array_equal(scene.packing.radius_n, start.radius_n)
    assert scene.packing.box == pm.Box.cubic(500.0, 2)
    assert np.array_equal(scene.packing.mass_n, start.mass_n) and drive.dt == scenario.rules.time_step
    assert drive.steps == scenario.measured_step
    spins = np.zeros((start.discs, 1)) if drive.spins is None else np.array(drive.spins)
    assert np.array_equal(spins[:, 0], start.spin_n)
    # who a plate catches is held, whatever its velocity was
    held = np.isin(np.arange(start.discs), drive.held)
    y, r = start.position_nd[:, 1], start.radius_n
    caught = ((y <= r) | (y >= 500.0 - r)) & scenario.rules.plates
    assert np.array_equal(held, caught)
    assert np.array_equal(np.array(drive.velocities), np.where(held[:, None], 0.0, start.velocity_nd))
    of = {type(one).__name__: one for one in scene.effects}
    bonds = of.get("Bonds")
    assert (bonds is not None) == bool(start.bonded_c.any())
    if bonds is not None:
        spring = pm.LinearSpring(made.stiffness)
        assert (bonds.compression, bonds.tension) == (spring, spring)
        assert bonds.rest_length_b.tolist() == [120.0]
        numbers = (bonds.tangential_stiffness, bonds.damping, bonds.tangential_damping)
        assert numbers == (made.tangential_stiffness, made.viscosity, made.tangential_viscosity)
        return
    assert of["Repulsion"].law == pm.LinearSpring(made.stiffness)
    assert getattr(of.get("ContactDamping"), "coefficient", 0.0) == made.viscosity
    if made.tangential_stiffness or made.tangential_viscosity:
        friction = pm.Friction(made.friction_coefficient, made.tangential_stiffness, made.tangential_viscosity)
        assert of["Friction"] == friction


@pytest.mark.parametrize("name", ASSEMBLIES)
def test_scenes_of_assemblies_are_the_packages_in_number_size_material_and_strain(name):
    scene, scenario = scene_of(name), ps.SCENARIOS[name]()
    count = scenario.start.discs
    made = pm.material_constants(particles=count)
    of = {type(one).__name__: one for one in scene.effects}
    radii = sorted(set(scene.packing.radius_n))
    assert scene.packing.particles == count and scene.packing.box == pm.Box.cubic(500.0, 2)
    assert radii[1] / radii[0] == pytest.approx(1.4, rel=1e-12)
    assert pm.packing_fraction(scene.packing) == pytest.approx(1.5, rel=1e-12)
    assert of["Repulsion"].law == pm.DivergentRepulsion(made.stiffness)
    assert of["ContactDamping"].coefficient == made.damping
    assert of["BackgroundDamping"].rate == made.background_damping
    assert of["Friction"] == pm.Friction(0.01, made.tangential_stiffness, made.tangential_damping)
    assert np.array_equal(scene.packing.mass_n, made.density * np.pi * scene.packing.radius_n**2)
    assert ("Bonds" in of) == (name == "crosslinked_sheared")
    if name == "assembly_at_rest":
        assert scene.drive.duration == pytest.approx(0.1 / made.frequency, rel=1e-3)
    else:
        drive = scene.drive
        assert (drive.amplitude, drive.pre_periods, drive.periods) == (0.2, 0.1, 0.27)
        assert drive.relative_frequency == 0.025


def test_native_kinetic_part_of_a_collision_has_the_other_sign_than_the_otsuki_term():
    scenario = ps.SCENARIOS["two_spheres_central"]()
    preset = scenario.run().stress("otsuki")[scenario.measured_step]
    # the two integrators differ after a first half of the collision
    assert np.abs(measured("two_spheres_central")["otsuki"] + preset).max() < 0.05 * np.abs(preset).max()
    assert (np.diag(measured("two_spheres_central")["otsuki"]) > 0.0).all()


@pytest.mark.parametrize("name", ASSEMBLIES)
def test_the_preset_misses_more_than_a_third_of_the_pressure_with_the_contacts_at_the_boundary(name):
    scenario = ps.SCENARIOS[name]()
    preset = scenario.run().stress("love_weber")[scenario.measured_step]
    assert 0.33 < 1.0 - np.trace(preset) / np.trace(measured(name)["love_weber"]) < 0.45
