"""Facts about the default jamming protocol."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest
import scipy.optimize

import packmech as pm
from packmech.linalg.mandel import mandel_basis
from packmech.mechanics.hessian import is_stable

HARMONIC = (pm.Repulsion(law=pm.Harmonic()),)


def start(particles=64, dimension=2, seed=1, scatter=0.0, effects=HARMONIC):
    sizes = pm.Bidisperse(ratio=1.4) if dimension == 2 else pm.Monodisperse()
    packing = pm.random_packing(particles, dimension=dimension, sizes=sizes, packing_fraction=0.8, seed=seed)
    if scatter:
        spread = 1.0 + scatter * np.random.default_rng(seed).standard_normal(particles)
        packing = packing.replace(radius_n=packing.radius_n * spread)
    return pm.Scene(packing, effects)


@pytest.fixture(scope="module")
def fixed():
    return pm.jam(start(), strain="isotropic")


@pytest.fixture(scope="module")
def free():
    return pm.jam(start(seed=2), strain="free")


def independent_rank(run, strains):
    """States of self stress counted by a dense singular value decomposition of the touching backbone."""
    packing, _ = pm.remove_rattlers(run.packing)
    contacts = pm.find_contacts(packing, gap_tolerance=0.0)
    d, n = packing.dimension, packing.particles
    matrix = np.zeros((len(contacts), n * d + len(strains)))
    for c in range(len(contacts)):
        normal = contacts.normal_cd[c]
        matrix[c, contacts.j_c[c] * d : contacts.j_c[c] * d + d] += normal
        matrix[c, contacts.i_c[c] * d : contacts.i_c[c] * d + d] -= normal
        for m, strain in enumerate(strains):
            matrix[c, n * d + m] = contacts.distance_c[c] * normal @ strain @ normal
    singular = np.linalg.svd(matrix, compute_uv=False)
    return len(contacts), n, len(contacts) - int((singular > 1e-9 * singular[0]).sum())


def test_a_packing_jammed_in_a_fixed_box_has_one_state_of_self_stress_and_2n_minus_1_contacts(fixed):
    contacts, backbone, self_stress = independent_rank(fixed, strains=[])
    assert (contacts, self_stress) == (2 * backbone - 1, 1)
    assert fixed.report["states_of_self_stress"] == 1


def test_a_packing_jammed_with_every_strain_free_has_one_isochoric_self_stress_and_2n_plus_1_contacts(free):
    basis = mandel_basis(2)
    shears = [np.diag([1.0, -1.0]) / np.sqrt(2.0), basis[2]]
    contacts, backbone, self_stress = independent_rank(free, strains=shears)
    assert (contacts, self_stress) == (2 * backbone + 1, 1)


def test_the_pressure_asked_for_is_reached_and_forces_balance_to_the_rounding_of_positions(fixed):
    scene = start().replace(packing=fixed.packing)
    assert pm.pressure(scene) / scene.pressure_unit == pytest.approx(1e-8, rel=1e-6)
    assert np.abs(pm.forces(scene)).max() <= 1e-5 * 1e-8
    assert fixed.residual <= 1e-5


def test_the_stress_is_isotropic_when_every_strain_is_free(free):
    stress = pm.stress_tensor(start().replace(packing=free.packing))
    pressure = -np.trace(stress) / 2
    assert np.abs(stress + pressure * np.eye(2)).max() <= 1e-8 * pressure


def test_a_fixed_box_keeps_its_shape(fixed):
    ratio = fixed.packing.box.lattice_dd @ start().packing.box.inverse_dd
    assert np.abs(ratio / ratio[0, 0] - np.eye(2)).max() < 1e-14


def test_no_pair_of_the_hard_packing_overlaps_and_all_its_contacts_touch(fixed):
    hard = fixed.report["hard_packing"]
    near = pm.find_contacts(hard, gap_tolerance=1e-12)
    assert len(near) == fixed.report["hard_contacts"]
    assert pm.find_contacts(hard, gap_tolerance=1e-9).gap_c.min() > -1e-13


@pytest.mark.parametrize("strain", ["isotropic", "free"])
def test_both_sides_of_the_onset_are_held(strain, fixed, free):
    run = fixed if strain == "isotropic" else free
    apart, (low, high) = run.report["packing_below_onset"], run.report["onset_between"]
    assert f"{low:.10f}, {high:.10f}" in str(run.summary())
    assert len(pm.find_contacts(apart, gap_tolerance=0.0)) == 0
    onset = run.report["jamming_packing_fraction"]
    assert onset - 1e-12 < low <= onset < high
    # the pressure is the bulk modulus times the way from the onset; with free strains that at isotropic stress
    pressed = start().replace(packing=run.packing)
    moduli, unit = pm.elastic_moduli(pressed), np.array([1.0, 1.0, 0.0])
    modulus = moduli.bulk_modulus if strain == "isotropic" else 1.0 / (unit @ moduli.compliance @ unit)
    # forces are balanced to force_tolerance, 1e-5
    assert np.log(high / low) * modulus == pytest.approx(pm.pressure(pressed), rel=1e-5)


def test_step_halving_holds_a_packing_that_does_not_press_and_is_as_near_as_its_energy():
    run = pm.jam(start(), strain="isotropic", method=pm.StepHalving(increment=1e-3, energy_tolerance=1e-12))
    apart, (low, high) = run.report["packing_below_onset"], run.report["onset_between"]
    assert len(pm.find_contacts(apart, gap_tolerance=0.0)) == 0
    # energies of 1e-12 are overlaps of 1e-6
    assert 0.0 < high - low < 1e-5


@pytest.mark.parametrize("method", [pm.HardVertex(quench_steps=10, iteration_limit=1), pm.StepHalving(step_limit=1)])
def test_what_is_not_jammed_has_no_bracket(method):
    run = pm.jam(start(), strain="isotropic", method=method, check=False)
    assert not run.ok
    assert "onset_between" not in run.report
    assert "packing_below_onset" not in run.report


@pytest.mark.parametrize("strain", ["isotropic", "free"])
def test_no_linear_program_makes_the_hard_packing_denser(strain, fixed, free):
    """HiGHS' simplex method as judge: over all small motions that keep pairs apart, none shrinks the box."""
    hard = (fixed if strain == "isotropic" else free).report["hard_packing"]
    near = pm.find_contacts(hard, gap_tolerance=0.02)
    basis = np.eye(2)[None] / np.sqrt(2) if strain == "isotropic" else mandel_basis(2)
    n = hard.particles
    matrix = np.zeros((len(near), 2 * n + len(basis)))
    row = np.arange(len(near))
    for a in range(2):
        matrix[row, 2 * near.j_c + a] += near.normal_cd[:, a]
        matrix[row, 2 * near.i_c + a] -= near.normal_cd[:, a]
    matrix[:, 2 * n :] = np.einsum("ca,kab,cb->ck", near.normal_cd, basis, near.vector_cd)
    cost = np.concatenate([np.zeros(2 * n), np.einsum("kaa->k", basis)])
    found = scipy.optimize.linprog(
        cost, A_ub=-matrix, b_ub=np.maximum(near.gap_c, 0.0), bounds=(-1e-3, 1e-3), method="highs"
    )
    assert found.status == 0
    assert found.fun > -1e-9


def test_the_hard_packing_does_not_depend_on_the_scale_of_the_law():
    one = pm.jam(start(effects=(pm.Repulsion(law=pm.Harmonic(energy_scale=1.0)),)), strain="isotropic")
    many = pm.jam(start(effects=(pm.Repulsion(law=pm.Harmonic(energy_scale=1024.0)),)), strain="isotropic")
    assert one.report["hard_packing"] == many.report["hard_packing"]


@pytest.mark.parametrize(
    ("law", "pressure"),
    [(pm.Hertz(), 1e-8), (pm.PowerLaw(exponent=3.0), 1e-9), (pm.LinearSpring(stiffness=7.0), 1e-7)]
    + [(pm.RepulsiveLennardJones(), 1e-6), (pm.Harmonic(), 1e-3), (pm.Hertz(), 1e-2)],
)
def test_every_law_comes_to_rest_at_the_pressure_asked_for(law, pressure):
    scene = start(effects=(pm.Repulsion(law=law),))
    run = pm.jam(scene, pressure=pressure, strain="isotropic")
    done = scene.replace(packing=run.packing)
    assert pm.pressure(done) / done.pressure_unit == pytest.approx(pressure, rel=1e-6)
    assert run.residual <= 1e-5


def in_units(scene, factor):
    packing = scene.packing
    box = pm.Box(packing.box.lattice_dd * factor)
    return scene.replace(packing=pm.Packing(packing.position_nd * factor, packing.radius_n * factor, box))


@pytest.mark.parametrize("factor", [1e12, 1e-12])
def test_the_onset_of_a_packing_does_not_depend_on_the_unit_of_length(factor, fixed):
    jammed = start().replace(packing=fixed.packing)
    run = pm.compress(in_units(jammed, factor), [1e-6])[0]
    assert run.report["onset"] == pytest.approx(fixed.report["jamming_packing_fraction"], abs=1e-13)
    assert run.report["hard_contacts"] == fixed.report["hard_contacts"]


@pytest.mark.parametrize("factor", [1e12, 1e-12])
def test_tiny_and_huge_units_of_length_end_in_balance(factor):
    # other digits of the start: chaos in the quench may choose another packing
    run = pm.jam(in_units(start(), factor), strain="free")
    assert run.residual <= 1e-5
    assert run.report["states_of_self_stress"] == 1


@pytest.mark.parametrize("unit", [1e-12, 1e12])
def test_tiny_and_huge_units_of_energy_reach_the_same_network(unit, fixed):
    run = pm.jam(start(effects=(pm.Repulsion(law=pm.Harmonic(energy_scale=unit)),)), strain="isotropic")
    assert run.report["contacts"] == fixed.report["contacts"]
    assert run.report["packing_fraction"] == pytest.approx(fixed.report["packing_fraction"], abs=1e-12)


def test_the_box_may_be_given_by_any_lattice_vectors(fixed):
    scene = start()
    tilted = pm.Box(scene.packing.box.lattice_dd @ np.array([[1, 7], [0, 1]]))
    run = pm.jam(scene.replace(packing=scene.packing.replace(box=tilted)), strain="isotropic")
    assert run.report["states_of_self_stress"] == 1
    assert run.residual <= 1e-5


def test_a_triangular_crystal_jams_at_pi_over_the_root_of_twelve_as_one_redundant_patch():
    crystal = pm.lattice_packing("triangular", repeats=(4, 4))
    run = pm.jam(pm.Scene(crystal, HARMONIC), strain="free")
    assert run.report["jamming_packing_fraction"] == pytest.approx(np.pi / np.sqrt(12.0), abs=1e-12)
    # 3 N contacts against 2 (N - 1) + 3
    assert run.report["hard_excess_contacts"] == 3 * 16 - (2 * 15 + 3)
    assert [patch.tolist() for patch in run.report["patches"]] == [list(range(16))]


@pytest.mark.parametrize(("strain", "fraction"), [("isotropic", np.pi / 4.0), ("free", np.pi / np.sqrt(12.0))])
def test_one_disc_that_touches_its_own_images_jams_at_the_density_of_its_lattice(strain, fraction):
    one = pm.Packing([[0.3, 0.1]], [0.5], pm.Box.cubic(1.0, 2))
    run = pm.jam(pm.Scene(one, HARMONIC), strain=strain)
    assert run.report["jamming_packing_fraction"] == pytest.approx(fraction, abs=1e-10)


@pytest.mark.parametrize("particles", [2, 3, 5, 8])
@pytest.mark.parametrize("strain", ["isotropic", "free"])
def test_a_few_discs_jam_in_balance(particles, strain):
    run = pm.jam(start(particles, seed=particles), strain=strain)
    assert run.residual <= 1e-5
    assert run.report["contacts"] >= run.report["isostatic_contacts"]


def test_spheres_jam_with_3n_minus_2_contacts():
    run = pm.jam(start(64, dimension=3, seed=2), strain="isotropic")
    assert run.report["contacts"] == 3 * (64 - run.report["rattlers"]) - 2
    assert 0.60 < run.report["jamming_packing_fraction"] < 0.66


def test_a_packing_with_redundant_hexagons_names_them_and_is_generic_once_radii_scatter():
    for seed in range(1, 60):
        run = pm.jam(start(256, seed=seed), strain="isotropic")
        if run.report["hard_excess_contacts"]:
            break
    patch = run.report["patches"][0]
    # a hexagon of equal discs closes by itself: at least a disc and its six neighbors
    assert len(patch) >= 7
    generic = pm.jam(start(256, seed=seed, scatter=0.03), strain="isotropic")
    assert generic.report["hard_excess_contacts"] == 0
    assert generic.report["patches"] == ()


def test_the_same_start_gives_the_same_bits_whatever_the_number_of_threads(fixed):
    program = (
        "import hashlib, packmech as pm\n"
        "packing = pm.random_packing(64, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.8, seed=1)\n"
        "run = pm.jam(pm.Scene(packing, (pm.Repulsion(law=pm.Harmonic()),)), strain='isotropic')\n"
        "print(run.packing.position_nd.tobytes().hex(), run.packing.box.lattice_dd.tobytes().hex())\n"
    )
    environment = {**os.environ, "OMP_NUM_THREADS": "2", "OPENBLAS_NUM_THREADS": "2", "NUMBA_NUM_THREADS": "2"}
    out = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    position, lattice = out.stdout.split()
    assert position == fixed.packing.position_nd.tobytes().hex()
    assert lattice == fixed.packing.box.lattice_dd.tobytes().hex()


def test_an_interrupted_run_hands_over_the_hard_packing_that_was_finished():
    def stop(stage, figures):
        if stage == "soft packing":
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as caught:
        pm.jam(start(), strain="isotropic", progress=stop)
    run = caught.value.run
    assert run.outcome is pm.Outcome.INTERRUPTED
    assert run.packing == run.report["hard_packing"]
    assert [stage.name for stage in run.stages] == ["quench", "hard packing", "certificate"]


@pytest.mark.parametrize(
    "call", [pm.jam, pm.shear_stabilize, lambda scene, **given: pm.compress(scene, [1e-3], **given)[0]]
)
def test_a_protocol_whose_time_is_up_says_so_with_what_it_reached(call):
    scene = start(96)
    dense = scene.replace(packing=scene.packing.replace(box=scene.packing.box.scaled(0.9)))
    run = call(dense, time_limit=1e-6, check=False)
    assert run.outcome is pm.Outcome.TIME_LIMIT
    assert run.packing.particles == 96 and run.report["packing_fraction"] > 0.0
    with pytest.raises(pm.NotConverged):
        call(dense, time_limit=1e-6)


def test_a_search_that_may_not_iterate_says_that_it_found_no_jammed_packing():
    method = pm.HardVertex(iteration_limit=2)
    with pytest.raises(pm.NotConverged) as caught:
        pm.jam(start(), strain="isotropic", method=method)
    assert caught.value.run.outcome is pm.Outcome.NOT_JAMMED
    assert pm.jam(start(), strain="isotropic", method=method, check=False).outcome is pm.Outcome.NOT_JAMMED


def test_stages_account_for_steps_and_seconds(fixed):
    assert fixed.steps == sum(stage.steps for stage in fixed.stages)
    assert fixed.seconds >= 0.5 * sum(stage.seconds for stage in fixed.stages)


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        ({"pressure": -1.0}, ValueError, "pressure must"),
        ({"pressure": np.nan}, ValueError, "pressure must"),
        ({"pressure": "low"}, TypeError, "pressure must"),
        ({"strain": "loose"}, ValueError, "strain must be one of 'isotropic', 'free'"),
        ({"method": "fast"}, TypeError, "method must be HardVertex"),
        ({"energy_tolerance": 0.0}, ValueError, "energy_tolerance must"),
        ({"force_tolerance": 0.0}, ValueError, "force_tolerance must"),
        ({"energy_tolerance": 1e-16, "method": pm.HardVertex()}, ValueError, "energy_tolerance must be left out"),
    ],
)
def test_a_bad_argument_is_named(arguments, error, words):
    with pytest.raises(error, match=words):
        pm.jam(start(), **arguments)


def test_something_else_than_a_scene_is_refused():
    with pytest.raises(TypeError, match="scene must be a Scene"):
        pm.jam(start().packing)


@pytest.mark.parametrize(
    ("method", "settings"),
    [
        (pm.HardVertex, {"start_packing_fraction": 0.0}),
        (pm.HardVertex, {"quench_tolerance": 2.0}),
        (pm.HardVertex, {"iteration_limit": 0}),
        (pm.ProgramChain, {"solver": "magic"}),
        (pm.ProgramChain, {"trust_radius": 1.0}),
        (pm.StepHalving, {"increment": 0.0}),
        (pm.Decompression, {"factor": 1.0}),
        (pm.Decompression, {"stop_pressure": -1.0}),
    ],
)
def test_a_bad_setting_of_a_protocol_is_named(method, settings):
    with pytest.raises(ValueError, match=next(iter(settings))):
        method(**settings)


def strip(length, shapes=None):
    """Return twenty discs of diameter 1 in a box of height 1: each touches its own images above and below."""
    place = np.random.default_rng(1).random((20, 2)) * [length, 1.0]
    return pm.Scene(pm.Packing(place, np.full(20, 0.5), pm.Box([[length, 0.0], [0.0, 1.0]]), shapes=shapes), HARMONIC)


@pytest.mark.parametrize("length", [30.0, 1000.0])
def test_discs_between_their_own_images_alone_are_not_jammed(length):
    run = pm.jam(strip(length), pressure=1e-6, strain="isotropic", check=False)
    assert (run.outcome, run.report["backbone_pressure"]) == (pm.Outcome.NOT_JAMMED, 0.0)
    assert [one.name for one in run.unmet] == ["part of the pressure that rattlers bear"]


def test_ellipses_between_their_own_images_alone_are_not_jammed():
    lying = pm.Spheroids(np.full(20, 1.2), np.tile([1.0, 0.0], (20, 1)))
    run = pm.jam(strip(40.0, lying), pressure=1e-6, strain="isotropic", check=False)
    assert run.outcome is pm.Outcome.NOT_JAMMED


@pytest.mark.parametrize("call", [pm.sweep_pressure, pm.compress])
def test_a_packing_that_its_rattlers_bear_is_not_followed_as_jammed(call):
    pressed = strip(30.0)
    side = [[29.7, 0.0], [0.0, 0.99]]
    apart = np.column_stack([1.4 * np.arange(20), np.full(20, 0.5)])
    pressed = pressed.replace(packing=pressed.packing.replace(position_nd=apart, box=pm.Box(side)))
    assert pm.pressure(pressed) > 0.0
    (run,) = call(pressed, [1e-4], strain="isotropic", check=False)
    assert run.outcome is pm.Outcome.NOT_JAMMED


def test_a_tolerance_below_the_rounding_of_positions_ends_at_its_floor_and_names_it(fixed):
    run = pm.jam(start(), pressure=1e-10, force_tolerance=1e-10, strain="isotropic")
    assert run.outcome is pm.Outcome.ROUNDING_FLOOR
    assert 1e-10 < run.residual <= 8.0 * run.report["rounding_floor"]


def test_the_floor_is_the_rounding_of_positions_over_the_overlap():
    one = pm.Packing([[0.3, 0.4]], [0.5], pm.Box.cubic(2.0, 2))
    report = pm.jam(pm.Scene(one, HARMONIC), pressure=1e-6, strain="isotropic").report
    # a contact of stiffness 1 / sigma^2 bears p L
    np.testing.assert_allclose(report["rounding_floor"], np.finfo(float).eps / 1e-6, rtol=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(7))
def test_rattlers_that_graze_do_not_decide_on_a_disc_that_its_own_images_bear(seed):
    rng = np.random.default_rng(seed)
    radius = np.r_[22.0, rng.uniform(0.4, 0.6, 150)]
    packing = pm.Packing(rng.random((151, 2)) * 48.4, radius, pm.Box.cubic(48.4, 2))
    run = pm.jam(pm.Scene(packing, (pm.Repulsion(pm.Hertz()),)), pressure=1e-6, strain="isotropic", check=False)
    assert (run.outcome, run.report["rattlers"]) == (pm.Outcome.CONVERGED, 150)


def test_a_jammed_packing_s_report_has_its_whole_stress_tensor_of_contacts_found_anew():
    scene = pm.Scene(pm.random_packing(32, dimension=2, packing_fraction=0.9, seed=3), (pm.Repulsion(),))
    run = pm.jam(scene, 1e-3, strain="isotropic")
    stress = pm.stress_tensor(scene.replace(packing=run.packing)) / scene.pressure_unit
    assert np.allclose(run.report["stress"], stress, rtol=0.0, atol=1e-15)
    assert -np.trace(run.report["stress"]) / 2 == pytest.approx(1e-3, rel=1e-9)
    # a box that keeps its shape bears shear stress, too: that is said, not only the pressure
    assert run.report["stress_anisotropy"] == pytest.approx(
        np.abs(run.report["stress"] + 1e-3 * np.eye(2)).max() / 1e-3, rel=1e-9
    )


@pytest.mark.parametrize("law", [pm.Harmonic(), pm.Hertz(2.0), pm.LinearSpring(3.0)])
def test_a_pressure_that_no_overlap_bears_is_refused(law):
    with pytest.raises(ValueError, match="pressure must be at most .* got 100000"):
        pm.jam(start(16, effects=(pm.Repulsion(law),)), pressure=1e5)


@pytest.mark.parametrize("law", [pm.Harmonic(), pm.Hertz(2.0), pm.LinearSpring(3.0)])
def test_a_pressure_of_overlaps_below_the_rounding_of_positions_is_refused_for_that(law):
    with pytest.raises(ValueError, match="pressure must be at least .* got 1e-30: .* rounding of positions"):
        pm.jam(start(16, effects=(pm.Repulsion(law),)), pressure=1e-30)


# which way is taken depends on the last bits, and these on the machine
@pytest.mark.parametrize(("pressure", "seed"), [(1e-7, 43), (1e-6, 46)])
def test_a_thousand_discs_whose_first_soft_packing_is_no_balance_end_in_a_minimum(pressure, seed):
    # a search by FIRE alone ended both on saddles
    start = pm.random_packing(1024, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.8, seed=seed)
    radius_n = start.radius_n * (1.0 + 0.03 * np.random.default_rng(seed + 1000).standard_normal(1024))
    run = pm.jam(pm.Scene(start.replace(radius_n=radius_n), (pm.Repulsion(),)), pressure=pressure)
    done = pm.Scene(run.packing, (pm.Repulsion(),))
    assert run.ok and run.residual <= 1e-5
    assert pm.pressure(done) / done.pressure_unit == pytest.approx(pressure, rel=1e-5)
    assert is_stable(done, strain="free")
