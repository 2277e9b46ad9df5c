"""Facts about packings that are sheared to and fro, or tapped: what comes back, what grows denser, seeds and limits."""

import functools

import numpy as np
import pytest

import packmech as pm
from packmech.protocols.anneal import kicked


@functools.cache
def scene(shapes=None, pressure=1e-3, seed=1, dimension=2, particles=24):
    form = {} if shapes is None else {"shapes": shapes}
    start = pm.random_packing(
        particles,
        dimension=dimension,
        sizes=pm.Bidisperse(ratio=1.4),
        packing_fraction=0.6 if shapes or dimension == 3 else 0.8,
        seed=seed,
        **form,
    )
    whole = pm.Scene(start, (pm.Repulsion(),))
    return whole.replace(packing=pm.jam(whole, pressure=pressure, strain="isotropic").packing)


ELLIPSES = pm.Ellipses(1.5)


@pytest.mark.parametrize("pressure", [None, 1e-3])
@pytest.mark.parametrize("shapes", [None, ELLIPSES])
def test_a_cycle_short_of_the_first_change_of_contacts_comes_back(pressure, shapes):
    whole = scene(shapes)
    first = min(
        abs(pm.quasistatic_shear(whole, way, step=abs(way), pressure=pressure).predicted_change_t[0])
        for way in (1e-6, -1e-6)
    )
    (run,) = pm.cyclic_shear(whole, 0.9 * first, step=0.2 * first, pressure=pressure)
    assert run.report["displacement"] < 1e-10
    assert run.report["contacts_opened"] == run.report["contacts_closed"] == 0
    assert len(set(run.network_t)) == 1 and run.strain_t.max() == -run.strain_t.min() == 0.9 * first
    # nothing is dissipated: the stress over the cycle does no work, over that of a quarter
    assert abs(run.report["work"]) < 1e-9 * run.work_t.max()
    assert run.packing.box.lattice_dd == pytest.approx(whole.packing.box.lattice_dd, rel=1e-12, abs=1e-12)


def test_a_cycle_begins_as_quasistatic_shear_does():
    run = pm.cyclic_shear(scene(), 2e-3, step=1e-3)[0]
    one_way = pm.quasistatic_shear(scene(), 2e-3, step=1e-3, locate="none")
    assert np.array_equal(run.strain_t[:3], one_way.strain_t)
    assert np.array_equal(run.shear_stress_t[:3], one_way.shear_stress_t)
    assert run.strain_t[-1] == 0.0 and run.packing_fraction_t == pytest.approx(run.packing_fraction_t[0], rel=1e-13)


@functools.cache
def loose():
    """Return the loosest of four small packings of ellipses."""
    return min(
        (scene(ELLIPSES, seed=seed, particles=16) for seed in range(4)), key=lambda x: pm.packing_fraction(x.packing)
    )


@functools.cache
def cycles():
    return pm.cyclic_shear(loose(), 0.1, 4, step=0.05, pressure=1e-3)


def test_going_on_with_cycles_is_going_through():
    settings = {"step": 0.05, "pressure": 1e-3}
    two = pm.cyclic_shear(loose(), 0.1, 2, **settings)
    third = pm.cyclic_shear(loose().replace(packing=two[-1].packing), 0.1, **settings)
    assert [run.report["cycle"] for run in cycles()] == [1, 2, 3, 4]
    assert two[-1].packing == cycles()[1].packing and third[0].packing == cycles()[2].packing
    assert cycles()[0].packing != cycles()[1].packing


def test_cycles_at_constant_pressure_make_a_loose_packing_denser():
    assert all(run.report["pressure"] == pytest.approx(1e-3, rel=1e-9) for run in cycles())
    assert all(run.report["states_of_self_stress"] >= 1 for run in cycles())
    assert cycles()[-1].report["packing_fraction"] > pm.packing_fraction(loose().packing) + 0.01
    # where it rearranged for good it did not come back
    assert cycles()[0].report["displacement"] > 1e-3


def test_links_keep_their_lengths_over_a_cycle():
    start = pm.cluster_packing(
        16, pm.Dimer(0.8), dimension=2, packing_fraction=0.35, largest_overlap=0.1, seed=1
    )  # fmt: skip
    whole = pm.Scene(start, (pm.Repulsion(),))
    whole = whole.replace(packing=pm.jam(whole, pressure=1e-3, strain="isotropic").packing)
    (run,) = pm.cyclic_shear(whole, 2e-5, step=1e-5)
    assert run.packing.link_error < 1e-12 and run.report["displacement"] < 1e-9


def test_kicks_have_the_size_that_is_asked_for():
    packing = scene(ELLIPSES, particles=64).packing
    rng = np.random.default_rng(3)
    moved, turned = [], []
    for _ in range(50):
        after = kicked(packing, 0.02, rng)
        moved.append(after.position_nd - packing.position_nd)
        sine = np.cross(packing.shapes.director_nd, after.shapes.director_nd)
        turned.append(np.arcsin(sine) * packing.shapes.gyration(packing.radius_n))
    for value in (np.array(moved), np.array(turned)):
        # of a normal distribution to four standard errors
        assert value.std() == pytest.approx(0.02, rel=4.0 / np.sqrt(2.0 * value.size))
        assert abs(value.mean()) < 4.0 * 0.02 / np.sqrt(value.size)


@pytest.mark.parametrize(("shapes", "dimension"), [(None, 2), (ELLIPSES, 2), (pm.Dimer(0.5), 2), (None, 3)])
def test_a_light_tap_leads_back_to_the_same_packing(shapes, dimension):
    whole = scene(shapes, 1e-5, dimension=dimension, particles=16)
    before = (
        pm.find_contacts(whole.packing, gap_tolerance=0.0)
        if shapes is None
        else pm.find_shape_contacts(whole.packing, gap_tolerance=0.0)
    )
    (run,) = pm.tap(whole, 1e-3, seed=1, pressure=1e-5)
    after = (
        pm.find_contacts(run.packing, gap_tolerance=0.0)
        if shapes is None
        else pm.find_shape_contacts(run.packing, gap_tolerance=0.0)
    )
    # a rattler may rest against another particle to the last digit
    assert np.count_nonzero(after.overlap_c > 1e-12) == np.count_nonzero(before.overlap_c > 1e-12)
    assert run.report["packing_fraction"] == pytest.approx(pm.packing_fraction(whole.packing), abs=1e-10)
    assert run.report["pressure"] == pytest.approx(1e-5, rel=1e-6) and run.residual < 1e-5


def test_taps_make_a_loose_packing_denser():
    runs = pm.tap(loose(), 0.15, 8, seed=0, pressure=1e-3)
    assert runs[-1].report["packing_fraction"] > pm.packing_fraction(loose().packing) + 0.01


def test_the_same_seed_gives_the_same_bits_and_going_on_is_going_through():
    whole = scene(ELLIPSES, 1e-4)
    through = pm.tap(whole, 0.2, 3, seed=5, pressure=1e-4)
    rng = np.random.default_rng(5)
    two = pm.tap(whole, 0.2, 2, rng=rng, pressure=1e-4)
    third = pm.tap(whole.replace(packing=two[-1].packing), 0.2, rng=rng, pressure=1e-4)
    assert [run.report["tap"] for run in through] == [1, 2, 3]
    assert two[-1].packing == through[1].packing and third[0].packing == through[2].packing
    assert pm.tap(whole, 0.2, seed=6, pressure=1e-4)[0].packing != through[0].packing


CALLS = {
    "cycle": lambda whole, **settings: pm.cyclic_shear(whole, 1e-4, 3, step=1e-4, **settings),
    "tap": lambda whole, **settings: pm.tap(whole, 1e-3, 3, seed=1, **settings),
}


@pytest.mark.parametrize("name", CALLS)
def test_time_is_limited_in_all_and_interrupts_pass_on_what_was_finished(name):
    whole = scene(pressure=1e-4)
    all_three = CALLS[name](whole)
    assert all(run.ok and run.seconds > 0.0 and run.force_evaluations > 0 and run.stages for run in all_three)
    runs = CALLS[name](whole, time_limit=1e-9, check=False)
    assert len(runs) == 1 and runs[0].outcome is pm.Outcome.TIME_LIMIT
    assert runs[0].to_dict()["outcome"] == "time_limit"
    seen = []

    def stop(stage, figures):
        if stage == name:
            seen.append(figures)
        elif seen:
            raise KeyboardInterrupt

    def stop_at_once(stage, figures):
        if stage == name:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as stopped:
        CALLS[name](whole, progress=stop_at_once)
    assert [run.packing for run in stopped.value.runs] == [all_three[0].packing]
    with pytest.raises(KeyboardInterrupt) as stopped:
        CALLS[name](whole, progress=stop)
    (finished,) = stopped.value.runs
    assert finished.packing == all_three[0].packing == seen[0]["packing"] and seen[0][name] == 1


def test_what_cannot_be_sheared_or_tapped_is_refused():
    loose = pm.Scene(pm.random_packing(16, dimension=2, packing_fraction=0.4, seed=1), (pm.Repulsion(),))
    with pytest.raises(ValueError, match="scene.packing must be jammed"):
        pm.cyclic_shear(loose, 0.1)
    with pytest.raises(ValueError, match="scene.packing must be jammed"):
        pm.tap(loose, 0.1, seed=1)
    with pytest.raises(ValueError, match="amplitude must be a finite number above 0, got -0.1"):
        pm.cyclic_shear(scene(), -0.1)
    with pytest.raises(ValueError, match="taps must be an integer at least 1, got 0"):
        pm.tap(scene(), 0.1, 0, seed=1)
    with pytest.raises(ValueError, match="seed must be an integer"):
        pm.tap(scene(), 0.1)


def test_the_first_cycle_counts_from_the_pressure_that_is_held_and_not_from_the_packing_before():
    runs = pm.cyclic_shear(scene(pressure=1e-3), 1e-5, 2, step=1e-5, pressure=2e-3)
    assert all(run.report["displacement"] < 1e-10 for run in runs)
    assert [run.report["contacts_opened"] + run.report["contacts_closed"] for run in runs] == [0, 0]
