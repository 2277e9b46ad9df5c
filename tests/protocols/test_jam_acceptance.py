"""Jamming at its full size: every seed to pressure 1e-8, counts of self stress, the ensemble's packing fraction.

Run with -s to see the table of figures.
"""

from __future__ import annotations

import numpy as np
import pytest

import packmech as pm

pytestmark = pytest.mark.slow

HARMONIC = (pm.Repulsion(law=pm.Harmonic(energy_scale=1.0)),)
# seeds that no setting of the protocol was chosen by
FIRST = 5001
# (particles, dimension, scatter of radii, seeds)
CASES = {
    "2D N = 64": (64, 2, 0.0, 20),
    "2D N = 256": (256, 2, 0.0, 20),
    "2D N = 1024": (1024, 2, 0.0, 5),
    "2D N = 4096, radii scattered": (4096, 2, 0.03, 2),
    "3D N = 64": (64, 3, 0.0, 5),
    "3D N = 256": (256, 3, 0.0, 5),
    "3D N = 1024": (1024, 3, 0.0, 1),
}


def start(particles, dimension, scatter, seed):
    sizes = pm.Bidisperse(ratio=1.4) if dimension == 2 else pm.Monodisperse()
    fraction = 0.9 if dimension == 2 else 0.68
    packing = pm.random_packing(particles, dimension=dimension, sizes=sizes, packing_fraction=fraction, seed=seed)
    if scatter:
        spread = 1.0 + scatter * np.random.default_rng(seed).standard_normal(particles)
        packing = packing.replace(radius_n=packing.radius_n * spread)
    return pm.Scene(packing, HARMONIC)


def jammed(name, strain):
    particles, dimension, scatter, seeds = CASES[name]
    runs = [pm.jam(start(particles, dimension, scatter, seed), strain=strain) for seed in range(FIRST, FIRST + seeds)]
    report = [run.report for run in runs]
    print(
        f"\n{name}, strain {strain}: residual at most {max(run.residual for run in runs):.1e},"
        f" self stress {sorted(one['states_of_self_stress'] for one in report)},"
        f" hard excess {sorted(one['hard_excess_contacts'] for one in report)},"
        f" anisotropy at most {max(one['stress_anisotropy'] for one in report):.1e},"
        f" onset {np.mean([one['jamming_packing_fraction'] for one in report]):.4f},"
        f" median CPU {np.median([run.seconds for run in runs]):.3f} s, worst {max(run.seconds for run in runs):.3f} s"
    )
    return runs


@pytest.mark.parametrize("strain", ["isotropic", "free"])
@pytest.mark.parametrize("name", CASES)
def test_every_seed_comes_to_rest_at_pressure_1e_minus_8(name, strain):
    for run in jammed(name, strain):
        assert run.outcome is pm.Outcome.CONVERGED
        assert run.residual <= 1e-5
        assert run.report["pressure"] == pytest.approx(1e-8, rel=1e-6)
        assert run.report["gap_error"] < 1e-12
        assert run.report["force_imbalance"] < 1e-9
        # what is redundant says where
        assert (run.report["hard_excess_contacts"] > 0) == bool(run.report["patches"])
        if strain == "free":
            assert run.report["stress_anisotropy"] <= 1e-8


@pytest.mark.parametrize("strain", ["isotropic", "free"])
def test_all_of_20_packings_of_64_discs_have_exactly_one_state_of_self_stress(strain):
    assert [run.report["states_of_self_stress"] for run in jammed("2D N = 64", strain)] == [1] * 20


@pytest.mark.parametrize("strain", ["isotropic", "free"])
def test_at_least_17_of_20_packings_of_256_discs_have_exactly_one_state_of_self_stress(strain):
    count = [run.report["states_of_self_stress"] for run in jammed("2D N = 256", strain)]
    assert count.count(1) >= 17


@pytest.mark.parametrize("strain", ["isotropic", "free"])
def test_packings_of_256_discs_become_generic_when_radii_scatter_by_3_percent(strain):
    redundant = [
        seed
        for seed in range(FIRST, FIRST + 60)
        if pm.jam(start(256, 2, 0.0, seed), strain=strain).report["hard_excess_contacts"]
    ]
    assert redundant
    for seed in redundant:
        assert pm.jam(start(256, 2, 0.03, seed), strain=strain).report["hard_excess_contacts"] == 0


@pytest.mark.parametrize(
    "particles, seeds, mean, error", [(64, 100, 0.8405, 2e-4), (256, 40, 0.8441, 2e-4)] + [(1024, 8, 0.8451, 3e-4)]
)
def test_decompression_from_90_percent_reproduces_the_published_onset(particles, seeds, mean, error):
    """Reference: an independent study of the same protocol with springs of one stiffness, V = k/2 overlap^2."""
    spring = (pm.Repulsion(law=pm.LinearSpring(stiffness=1.0)),)
    onset = []
    for seed in range(seeds):
        scene = start(particles, 2, 0.0, seed).replace(effects=spring)
        run = pm.jam(scene, strain="isotropic", method=pm.Decompression())
        onset.append(run.report["jamming_packing_fraction"])
    spread = np.std(onset, ddof=1) / np.sqrt(seeds)
    print(f"\nN = {particles}: onset {np.mean(onset):.5f} +- {spread:.5f}, reference {mean} +- {error}")
    assert abs(np.mean(onset) - mean) < 3.0 * np.hypot(spread, error)
