"""Facts about the verdict under changes that do not change the packing."""

import pathlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from threadpoolctl import threadpool_limits

import packmech as pm

HARD = np.load(pathlib.Path(__file__).parents[1] / "golden" / "hard_packings.npz")
STRICT, COLLECTIVE, NEITHER = "2d-64-shape-free-0", "2d-64-shape-fixed-0", "2d-256-shape-fixed-2"


def packing_of(name):
    if name in ("kagome", "triangular", "honeycomb"):
        return pm.lattice_packing(name, (3, 3))
    if name == "fcc":
        return pm.lattice_packing(name, (2, 2, 2))
    position, radius, lattice = (HARD[f"{name}/{part}"] for part in ("position_nd", "radius_n", "lattice_dd"))
    return pm.Packing(position, radius, pm.Box(lattice))


def summary(verdict):
    return (
        verdict.local,
        verdict.collective,
        verdict.strict,
        verdict.contacts,
        verdict.isostatic_contacts,
        verdict.states_of_self_stress,
        verdict.collectively.floppy_modes,
        verdict.strictly.floppy_modes,
        int(verdict.rattlers.sum()),
    )


def numbers(verdict):
    answers = (verdict.collectively, verdict.strictly)
    return [one.smallest_singular_value for one in answers] + [
        one.smallest_force for one in answers if one.verdict == "jammed"
    ]


def assert_same(before, after):
    assert summary(before) == summary(after)
    # the force program stops at a duality gap of 1e-8; a unique self stress is exact
    assert numbers(after) == pytest.approx(numbers(before), rel=1e-6, abs=1e-7)


@settings(max_examples=12, deadline=None)
@given(
    name=st.sampled_from([STRICT, COLLECTIVE, "kagome", "triangular", "fcc", "3d-32-shape-fixed-0"]),
    seed=st.integers(0, 2**32 - 1),
    method=st.sampled_from(["certificate", "loads"]),
)
def test_names_cells_and_images_of_particles_do_not_matter(name, seed, method):
    packing = packing_of(name)
    rng = np.random.default_rng(seed)
    d, particles = packing.dimension, packing.particles
    order = rng.permutation(particles)
    change = np.eye(d, dtype=int)
    change[0, 1] = rng.integers(-2, 3)
    change = change @ np.roll(np.eye(d, dtype=int), 1, axis=0)
    images = rng.integers(-2, 3, (particles, d))
    moved = packing.position_nd + images @ packing.box.lattice_dd.T + rng.random(d)
    other = pm.Packing(moved[order], packing.radius_n[order], pm.Box(packing.box.lattice_dd @ change))
    before, after = (pm.classify_jamming(one, method=method) for one in (packing, other))
    if method == "certificate":
        assert_same(before, after)
    else:
        assert summary(before) == summary(after)
    assert np.array_equal(after.rattlers, before.rattlers[order])


@settings(max_examples=8, deadline=None)
@given(
    name=st.sampled_from([STRICT, COLLECTIVE, "honeycomb", "3d-64-shape-free-0"]),
    seed=st.integers(0, 2**32 - 1),
    unit=st.sampled_from([1e-12, 1e-3, 1.0, 1e12]),
)
def test_rotation_and_unit_of_length_do_not_matter(name, seed, unit):
    packing = packing_of(name)
    turn, _ = np.linalg.qr(np.random.default_rng(seed).standard_normal((packing.dimension,) * 2))
    other = pm.Packing(
        unit * packing.position_nd @ turn.T, unit * packing.radius_n, pm.Box(unit * turn @ packing.box.lattice_dd)
    )
    assert_same(pm.classify_jamming(packing), pm.classify_jamming(other))


@pytest.mark.parametrize("name", [STRICT, COLLECTIVE, NEITHER, "kagome"])
@pytest.mark.parametrize("method", ["certificate", "loads"])
def test_number_of_threads_does_not_change_a_bit(name, method):
    packing = packing_of(name)
    verdicts = []
    for threads in (1, 2, 2):
        with threadpool_limits(limits=threads):
            verdicts.append(pm.classify_jamming(packing, method=method))
    first = verdicts[0]
    for other in verdicts[1:]:
        assert summary(other) == summary(first)
        np.testing.assert_array_equal(numbers(other), numbers(first))
        if first.contact_force_c is not None:
            assert np.array_equal(other.contact_force_c, first.contact_force_c)
        if first.unjamming_motion is not None:
            assert np.array_equal(other.unjamming_motion.displacement_nd, first.unjamming_motion.displacement_nd)
            assert np.array_equal(other.unjamming_motion.strain_dd, first.unjamming_motion.strain_dd)


@pytest.mark.parametrize("name", [STRICT, COLLECTIVE, NEITHER, "kagome", "triangular"])
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_any_random_load_gives_the_verdict_of_the_certificate(name, seed):
    packing = packing_of(name)
    certificate, loads = pm.classify_jamming(packing), pm.classify_jamming(packing, method="loads", seed=seed)
    assert summary(loads)[:6] == summary(certificate)[:6]


@pytest.mark.parametrize("tolerance", [1e-4, 1e-6, 1e-10])
@pytest.mark.parametrize("name", [STRICT, COLLECTIVE, NEITHER, "kagome", "triangular"])
def test_tolerance_of_the_solver_does_not_change_a_certified_verdict(name, tolerance):
    packing = packing_of(name)
    verdict = pm.classify_jamming(packing, tolerance=tolerance)
    assert summary(verdict) == summary(pm.classify_jamming(packing))
    assert max(verdict.collectively.balance, verdict.strictly.balance) < 1e-9


def test_verdict_on_a_scene_is_that_on_its_packing():
    packing = packing_of(STRICT)
    assert_same(pm.classify_jamming(packing), pm.classify_jamming(pm.Scene(packing, (pm.Repulsion(),))))
