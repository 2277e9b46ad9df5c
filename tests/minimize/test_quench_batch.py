"""A batch of packings strained and relaxed in one call does to each what pm.quench and pm.jam would do."""

from typing import NamedTuple

import numpy as np
import pytest

import packmech as pm

FRACTION = 0.9


def scene(seed=1, particles=24, dimension=2, law=None):
    packing = pm.random_packing(
        particles, dimension=dimension, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=FRACTION, seed=seed
    )
    return pm.Scene(packing, (pm.Repulsion(law=law or pm.Harmonic()),))


def trimers():
    packing = pm.cluster_packing(6, pm.Trimer(), dimension=2, packing_fraction=0.4, seed=3, largest_overlap=0.1)
    return pm.Scene(packing, (pm.Repulsion(),))


def drawn(batch, steps, seed=0, change=0.02, strain=0.05):
    rng = np.random.default_rng(seed)
    return [(rng.uniform(-change, change, batch), rng.uniform(-strain, strain, batch)) for _ in range(steps)]


def same(one, other):
    return one.box == other.box and np.array_equal(one.position_nd, other.position_nd)


def test_so_many_steps_at_a_time_are_the_steps_of_a_quench():
    start = scene()
    batch = pm.QuenchBatch(start, relax=7, force_tolerance=1e-9)
    for _ in range(9):
        batch.step([0.0], [0.0])
    run = pm.quench(start, method=pm.Fire(), force_tolerance=1e-9, step_limit=63, check=False)
    assert run.outcome is batch.outcome(0) is pm.Outcome.STEP_LIMIT
    # one loop compiled in two places: products and sums may be fused otherwise
    np.testing.assert_allclose(batch.packing(0).position_nd, run.packing.position_nd, rtol=0, atol=1e-11)


@pytest.mark.parametrize(
    "method",
    [pm.Fire(), pm.Fire2(), pytest.param(pm.DampedDynamics(), marks=pytest.mark.slow)],
    ids=lambda one: type(one).__name__,
)
def test_full_relaxation_is_the_quench(method):
    start = scene()
    batch = pm.QuenchBatch(start, method=method, force_tolerance=1e-6)
    batch.step([0.0], [0.0])
    run = pm.quench(start, method=method, force_tolerance=1e-6)
    assert batch.outcome(0) is run.outcome is pm.Outcome.CONVERGED and batch.relaxed_b.all()
    np.testing.assert_allclose(batch.packing(0).position_nd, run.packing.position_nd, rtol=0, atol=1e-9)
    assert batch.steps_b[0] == run.steps


def test_compression_is_the_box_scaled_then_quenched():
    start = scene()
    batch = pm.QuenchBatch(start, force_tolerance=1e-9)
    batch.step([0.05], [0.0])
    factor = (FRACTION / (FRACTION + 0.05)) ** 0.5
    packing = start.packing
    scaled = packing.replace(position_nd=packing.position_nd * factor, box=packing.box.scaled(factor))
    run = pm.quench(start.replace(packing=scaled), method=pm.Fire(), force_tolerance=1e-9)
    assert batch.packing_fraction_b[0] == pytest.approx(FRACTION + 0.05, abs=1e-14)
    np.testing.assert_allclose(batch.packing(0).position_nd, run.packing.position_nd, atol=1e-9)


def test_shear_keeps_the_volume_and_tilts_the_box():
    batch = pm.QuenchBatch(scene())
    batch.step([0.0], [0.1])
    lattice = batch.packing(0).box.lattice_dd
    assert lattice[0, 1] == pytest.approx(0.1 * lattice[1, 1], rel=1e-14)
    assert batch.packing_fraction_b[0] == pytest.approx(FRACTION, abs=1e-14)
    assert batch.strain_b[0] == 0.1


@pytest.mark.parametrize("start", [scene(), trimers()], ids=["discs", "trimers"])
def test_figures_are_the_measures_of_the_packing(start):
    batch = pm.QuenchBatch(start, 2, force_tolerance=1e-8)
    for change, strain in drawn(2, 4):
        batch.step(change + 0.12, strain)
    for b in range(2):
        now = start.replace(packing=batch.packing(b))
        assert batch.pressure_b[b] > 1e-3
        assert batch.energy_b[b] == pytest.approx(pm.energy(now), rel=1e-12)
        assert batch.pressure_b[b] == pytest.approx(pm.pressure(now), rel=1e-12)
        np.testing.assert_allclose(batch.stress_bdd[b], pm.stress_tensor(now), atol=1e-13)
        assert batch.packing_fraction_b[b] == pytest.approx(pm.packing_fraction(now.packing), rel=1e-14)
        assert batch.contacts_b[b] == len(pm.find_contacts(now.packing, gap_tolerance=0.0))
        assert batch.max_force_b[b] <= 1e-8 * batch.mean_force_b[b]
        assert now.packing.link_error < 1e-13


def test_rattlers_and_excess_contacts_are_those_of_the_jamming_report():
    run = pm.jam(scene(seed=4), pressure=1e-4, strain="isotropic")
    batch = pm.QuenchBatch(scene(seed=4))
    batch.restart(0, run.packing)
    assert batch.rattlers_b[0] == run.report["rattlers"]
    assert batch.excess_contacts_b[0] == run.report["excess_contacts"]


@pytest.mark.parametrize("relax", ["full", 5])
def test_bits_depend_neither_on_the_others_nor_on_threads(relax):
    start = scene()
    packings = [pm.scattered_packing(start.packing, packing_fraction=0.8, seed=seed) for seed in range(6)]
    moves = drawn(6, 6)

    def ends(batch, index):
        for place, b in enumerate(index):
            batch.restart(place, packings[b], relax=True)
        for change, strain in moves:
            batch.step(change[index], strain[index])
        return [batch.packing(place) for place in range(len(index))]

    together = ends(pm.QuenchBatch(start, 6, relax=relax), np.arange(6))
    threads = ends(pm.QuenchBatch(start, 6, relax=relax, threads=2), np.arange(6))
    alone = [ends(pm.QuenchBatch(start, relax=relax), np.array([b]))[0] for b in range(6)]
    assert all(same(a, b) and same(a, c) for a, b, c in zip(together, threads, alone, strict=True))


@pytest.mark.parametrize("start", [scene(), trimers()], ids=["discs", "trimers"])
def test_restart_forgets_everything(start):
    used, fresh = pm.QuenchBatch(start, relax=3), pm.QuenchBatch(start, relax=3)
    for change, strain in drawn(1, 20, seed=1):
        used.step(change, strain)
    for batch in (used, fresh):
        batch.restart(0, pm.scattered_packing(start.packing, packing_fraction=0.6, seed=9))
        for change, strain in drawn(1, 10, seed=2):
            batch.step(change, strain)
    assert same(used.packing(0), fresh.packing(0))
    assert used.energy_b[0] == fresh.energy_b[0] and used.strain_b[0] == fresh.strain_b[0]


def test_inactive_packings_stay_as_they_are():
    batch = pm.QuenchBatch(scene(), 3)
    before = [batch.packing(b) for b in range(3)]
    batch.step([0.01] * 3, [0.0] * 3, active_b=np.array([True, False, True]))
    assert [same(batch.packing(b), before[b]) for b in range(3)] == [False, True, False]


@pytest.mark.parametrize("start", [scene(), trimers()], ids=["discs", "trimers"])
def test_endless_shear_keeps_lattice_vectors_short_and_figures_right(start):
    batch = pm.QuenchBatch(start, relax=2)
    batch.step([0.15], [0.0])
    for _ in range(60):
        batch.step([0.0], [0.3])
    now = start.replace(packing=batch.packing(0))
    side = now.packing.box.volume**0.5
    assert np.linalg.norm(now.packing.box.lattice_dd, axis=0).max() < 3.0 * side
    assert batch.strain_b[0] == pytest.approx(18.0, rel=1e-12)
    assert batch.energy_b[0] == pytest.approx(pm.energy(now), rel=1e-12)
    assert batch.packing_fraction_b[0] == pytest.approx(pm.packing_fraction(now.packing), rel=1e-12)
    assert now.packing.link_error < 1e-12


@pytest.mark.slow  # a law of its own is compiled for
def test_deep_overlaps_under_a_diverging_law_are_parted_first():
    start = scene(law=pm.RepulsiveLennardJones())
    batch = pm.QuenchBatch(start, force_tolerance=1e-6)
    batch.restart(0, pm.scattered_packing(start.packing, packing_fraction=1.0, seed=1), relax=True)
    assert batch.outcome(0) is pm.Outcome.CONVERGED
    assert np.isfinite(batch.energy_b[0])


@pytest.mark.slow  # a law of its own is compiled for
def test_forces_without_measure_leave_the_packing_where_it_was():
    packing = pm.Packing([[0.0, 0.0], [0.4, 0.0]], [0.3, 0.3], pm.Box.cubic(2.0, 2))
    start = pm.Scene(packing, (pm.Repulsion(law=Unbearable()),))
    batch = pm.QuenchBatch(start, relax=1)
    assert batch.max_force_b[0] < 1.0
    before = batch.packing(0)
    batch.step([0.3], [0.2])
    assert batch.outcome(0) is pm.Outcome.STALLED
    assert np.array_equal(batch.packing(0).position_nd, before.position_nd) and batch.strain_b[0] == 0.0
    assert batch.packing_fraction_b[0] == pytest.approx(pm.packing_fraction(before), rel=1e-14)


@pm.law
class Unbearable(NamedTuple):
    """Weak, and infinitely strong from a relative overlap of 0.4 on."""

    energy_scale: float = 1e-3

    def energy(self, distance, contact_distance):
        return 0.5 * self.energy_scale * (contact_distance - distance) ** 2 if distance > 0.36 else np.inf

    def first(self, distance, contact_distance):
        return -self.energy_scale * (contact_distance - distance) if distance > 0.36 else -np.inf

    def second(self, distance, contact_distance):
        return self.energy_scale


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([0.0], [np.nan]), "shear_strain_b must"),
        (([0.0], [1.5]), r"shear_strain_b must lie between -1 and 1, got 1.5 for packing 0"),
        (([0.0, 0.0], [0.0]), r"packing_fraction_change_b must have shape \(1\), got \(2,\)"),
        ((["a"], [0.0]), "packing_fraction_change_b must be an array"),
    ],
)
def test_bad_steps_are_refused(arguments, message):
    with pytest.raises((TypeError, ValueError), match=message):
        pm.QuenchBatch(scene()).step(*arguments)


@pytest.mark.parametrize(
    ("index", "packing", "message"),
    [
        (1, scene().packing, "index must"),
        (0, scene(particles=25).packing, "packing must have 24 particles in 2 dimensions, got 25"),
        (0, scene(dimension=3).packing, "packing must have 24 particles in 2 dimensions, got 24 in 3"),
        (0, "packing", "packing must be"),
        (
            0,
            pm.cluster_packing(8, pm.Trimer(), dimension=2, packing_fraction=0.4, seed=1),
            "packing must have links just if",
        ),
    ],
)
def test_bad_restarts_are_refused(index, packing, message):
    with pytest.raises((TypeError, ValueError), match=message):
        pm.QuenchBatch(scene()).restart(index, packing)


def test_scene_with_bonds_is_refused():
    packing = pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.01)
    with pytest.raises(ValueError, match="nothing that pm.QuenchBatch would ignore, got Bonds at 1"):
        pm.QuenchBatch(pm.Scene(packing, (pm.Repulsion(), pm.bond_contacts(packing))))
