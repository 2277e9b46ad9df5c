"""Facts about the other jamming protocols, about compression from the onset, and about shear stabilization."""

from __future__ import annotations

import numpy as np
import pytest

import packmech as pm

HARMONIC = (pm.Repulsion(law=pm.Harmonic()),)


def scene(particles=64, seed=1, packing_fraction=0.8):
    sizes = pm.Bidisperse(ratio=1.4)
    packing = pm.random_packing(particles, dimension=2, sizes=sizes, packing_fraction=packing_fraction, seed=seed)
    return pm.Scene(packing, HARMONIC)


def with_packing(packing):
    return pm.Scene(packing, HARMONIC)


@pytest.mark.parametrize("solver", ["clarabel", "highs"])
def test_the_chain_of_programs_ends_at_an_isostatic_packing_with_either_solver(solver):
    run = pm.jam(scene(32, seed=4), strain="isotropic", method=pm.ProgramChain(solver=solver))
    assert run.report["hard_excess_contacts"] == 0
    assert run.residual <= 1e-5


def test_the_interior_point_method_stays_at_the_packing_that_the_chain_of_programs_found():
    chain = pm.jam(scene(32, seed=4), strain="isotropic", method=pm.ProgramChain())
    again = pm.compress(with_packing(chain.packing), [1e-6])[0]
    assert again.report["onset"] == pytest.approx(chain.report["jamming_packing_fraction"], abs=1e-13)
    assert again.report["hard_contacts"] == chain.report["hard_contacts"]


@pytest.mark.parametrize("tolerance", [1e-16, 1e-12])
def test_step_halving_ends_with_the_energy_per_particle_in_its_window(tolerance):
    run = pm.jam(scene(32, seed=3), energy_tolerance=tolerance, strain="isotropic")
    per_particle = pm.energy(with_packing(run.packing)) / 32
    assert tolerance < per_particle < 2.0 * tolerance


def test_step_halving_and_the_exact_onset_agree_to_the_overlaps_that_are_left():
    run = pm.jam(scene(32, seed=3), energy_tolerance=1e-14, strain="isotropic")
    onset = pm.compress(with_packing(run.packing), [1e-6])[0].report["onset"]
    # energy 1e-14 a particle means overlaps near 1e-7
    assert 0.0 < run.report["packing_fraction"] - onset < 1e-6


@pytest.mark.parametrize("minimizer", [pm.ConjugateGradient(), pm.LBFGS()])
def test_step_halving_takes_other_minimizers(minimizer):
    run = pm.jam(
        scene(16, seed=3), method=pm.StepHalving(energy_tolerance=1e-12, minimizer=minimizer), strain="isotropic"
    )
    assert run.ok


def test_step_halving_can_free_every_strain():
    run = pm.jam(scene(32, seed=3), energy_tolerance=1e-14, strain="free")
    assert run.report["stress_anisotropy"] <= 1e-7


def test_decompression_extrapolates_to_the_exact_onset():
    run = pm.jam(scene(64, seed=2), strain="isotropic", method=pm.Decompression(stop_pressure=1e-5))
    exact = run.report["jamming_packing_fraction"]
    assert run.report["extrapolated_packing_fraction"] == pytest.approx(exact, abs=2e-5)


@pytest.mark.parametrize("strain", ["isotropic", "free"])
def test_compression_reaches_each_distance_above_the_onset_in_balance(strain):
    start = pm.jam(scene(32, seed=5), strain=strain)
    distances = [1e-3, 1e-6, 1e-2]
    runs = pm.compress(with_packing(start.packing), distances, strain=strain)
    for run, distance in zip(runs, sorted(distances), strict=True):
        assert run.report["packing_fraction"] - start.report["jamming_packing_fraction"] == pytest.approx(
            distance, abs=1e-12
        )
        assert run.ok
        assert run.report["pressure_asked"] is None
    if strain == "free":
        assert max(run.report["stress_anisotropy"] for run in runs) < 1e-8


def test_pressure_grows_in_proportion_to_the_distance_while_the_network_stays():
    start = pm.jam(scene(64, seed=1), strain="isotropic")
    runs = pm.compress(with_packing(start.packing), [1e-6, 1e-5])
    slope = [run.report["pressure"] / run.report["distance"] for run in runs]
    assert all(run.report["contacts_closed"] == run.report["contacts_opened"] == 0 for run in runs)
    assert slope[0] == pytest.approx(slope[1], rel=1e-3)


def test_far_compression_closes_contacts_and_counts_rearrangements():
    start = pm.jam(scene(64, seed=1), strain="isotropic")
    near, far = pm.compress(with_packing(start.packing), [1e-6, 5e-2])
    assert far.report["contacts"] - near.report["contacts"] > 10
    assert far.report["contacts_closed"] - far.report["contacts_opened"] >= 10
    assert far.report["rearrangements"] >= 0


def test_compression_ends_in_balance_where_a_contact_that_just_touches_holds_the_packing():
    packing = pm.random_packing(256, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.9, seed=29)
    springs = (pm.Repulsion(law=pm.LinearSpring()),)
    jammed = pm.jam(pm.Scene(packing, springs), pressure=1e-3)
    (run,) = pm.compress(pm.Scene(jammed.packing, springs), [1e-3])
    assert run.ok and run.residual <= 1e-9


@pytest.mark.parametrize("bad", [[], [0.0], [-1e-3], [np.nan]])
def test_distances_that_are_not_positive_are_refused(bad):
    with pytest.raises(ValueError, match="distances must"):
        pm.compress(scene(8), bad)


def test_shear_stabilization_keeps_the_volume_and_makes_the_stress_isotropic():
    start = pm.quench(scene(32, packing_fraction=0.92), force_tolerance=1e-6).packing
    run = pm.shear_stabilize(with_packing(start))
    stress = pm.stress_tensor(with_packing(run.packing))
    pressure = -np.trace(stress) / 2
    assert np.abs(stress + pressure * np.eye(2)).max() < 1e-9 * pressure
    assert run.packing.box.volume == pytest.approx(start.box.volume, rel=1e-14)


def test_shear_stabilization_reaches_a_pressure():
    run = pm.shear_stabilize(scene(32, packing_fraction=0.92), pressure=1e-2)
    assert run.report["pressure"] == pytest.approx(1e-2, rel=1e-9)
    assert run.report["stress_anisotropy"] < 1e-9


def test_shear_stabilization_of_a_dilute_packing_says_that_nothing_touches():
    run = pm.shear_stabilize(scene(16, packing_fraction=0.2))
    assert run.outcome is pm.Outcome.UNJAMMED


def test_step_halving_ends_at_an_energy_and_takes_no_pressure():
    with pytest.raises(
        ValueError, match="pressure must be left out for StepHalving, which ends at an energy, got 1e-06"
    ):
        pm.jam(scene(16, seed=3), method=pm.StepHalving(), pressure=1e-6)
