"""Facts about the search for hard packings of many particles: where it starts, what it ends in, how its steps grow."""

from __future__ import annotations

import numpy as np
import pytest

import packmech as pm
from packmech.contacts.network import candidate_pairs, pair_contacts
from packmech.jamming.hard_packing import densify
from packmech.jamming.hard_start import settled_start
from packmech.linalg.block_system import BlockSystem
from packmech.linalg.mandel import mandel_basis


def scene(particles, seed, dimension=2):
    sizes = pm.Bidisperse(ratio=1.4) if dimension == 2 else pm.Monodisperse()
    packing = pm.random_packing(particles, dimension=dimension, sizes=sizes, packing_fraction=0.8, seed=seed)
    spread = 1.0 + 0.03 * np.random.default_rng(seed).standard_normal(particles)
    return pm.Scene(packing.replace(radius_n=packing.radius_n * spread), (pm.Repulsion(law=pm.Harmonic()),))


@pytest.fixture(scope="module")
def pressed():
    """Return a soft packing in rough balance at small overlaps, in units of its mean diameter."""
    near = pm.jam(scene(200, 1), pressure=1e-3).packing
    unit = float(near.diameter_n.mean())
    return near.replace(
        position_nd=near.position_nd / unit, radius_n=near.radius_n / unit, box=near.box.scaled(1.0 / unit)
    )


def begun(packing):
    load = float(packing.particles * packing.dimension)
    return settled_start(packing.position_nd, packing.box.lattice_dd, packing.radius_n, load)


def test_the_search_starts_with_one_product_of_slack_and_force_and_springs_behind_barriers(pressed):
    state = begun(pressed)
    assert np.allclose(state.slack_c * state.force_c, state.barrier, rtol=1e-12)
    here = pm.Packing(state.position_nd, pressed.radius_n, pm.Box(state.lattice_dd))
    gap = pair_contacts(here, *state.pairs).gap_c
    ratio = (state.slack_c - gap) / state.force_c
    # where gaps are wide the difference is lost in rounding
    near = gap < 1e-2
    assert np.ptp(ratio[near]) < 1e-9 * ratio[near].mean()
    assert float((state.force_c * (gap + here.radius_n[state.pairs.i_c] + here.radius_n[state.pairs.j_c])).sum()) == (
        pytest.approx(pressed.particles * 2.0, rel=1e-12)
    )


def test_only_what_three_contacts_do_not_hold_is_moved_at_the_start_and_away_from_what_it_overlaps(pressed):
    state = begun(pressed)
    moved = (state.position_nd != pressed.position_nd).any(axis=1)
    contacts = pm.find_contacts(pressed)
    bears = -contacts.gap_c > 1e-2 * -contacts.gap_c.mean()
    touches = np.zeros((pressed.particles, pressed.particles))
    touches[contacts.i_c[bears], contacts.j_c[bears]] = touches[contacts.j_c[bears], contacts.i_c[bears]] = 1
    held = np.ones(pressed.particles, dtype=bool)
    for _ in range(pressed.particles):
        held &= touches @ held > 2
    assert moved.any() and not (moved & held).any()
    # those that touched what surrounds them, which stays where it is, have room on all sides now
    here = pm.Packing(state.position_nd, pressed.radius_n, pm.Box(state.lattice_dd))
    before, after = pair_contacts(pressed, *state.pairs), pair_contacts(here, *state.pairs)
    once = moved[before.i_c] ^ moved[before.j_c]
    touched = 0
    for n in np.flatnonzero(moved):
        own = (before.i_c == n) | (before.j_c == n)
        if once[own].all() and before.gap_c[own].min() < 0.0:
            touched += 1
            assert after.gap_c[own].min() > before.gap_c[own].min()
    assert touched


def test_correctors_lead_to_balance_at_the_barrier_as_well(pressed):
    state = densify(begun(pressed), pressed.radius_n, mandel_basis(2), correctors=6)
    assert state.barrier <= 1e-12
    end = pm.Packing(state.position_nd, pressed.radius_n, pm.Box(state.lattice_dd))
    contacts = pair_contacts(end, *state.pairs)
    assert contacts.gap_c.min() > -1e-12
    net = np.zeros(end.position_nd.shape)
    push = state.force_c[:, None] * contacts.normal_cd
    np.add.at(net, contacts.j_c, push)
    np.subtract.at(net, contacts.i_c, push)
    assert np.abs(net).max() < 1e-5


def test_a_large_packing_that_rearranges_late_goes_back_to_wider_walls_and_is_found_in_few_steps():
    sizes = pm.Bidisperse(ratio=1.4)
    packing = pm.random_packing(4096, dimension=2, sizes=sizes, packing_fraction=0.87, seed=30)
    spread = 1.0 + 0.03 * np.random.default_rng(30).standard_normal(4096)
    crawls = pm.Scene(packing.replace(radius_n=packing.radius_n * spread), (pm.Repulsion(),))
    # 568 steps along the walls where the barrier only falls
    report = pm.jam(crawls, method=pm.HardVertex(iteration_limit=250)).report
    assert report["hard_excess_contacts"] == 0 and report["floppy_modes"] == 0


def test_both_backends_solve_a_large_plane_network_alike():
    packing = scene(1500, 2).packing
    contacts = pair_contacts(packing, *candidate_pairs(packing.position_nd, packing.radius_n, packing.box, scale=1.3))
    along = np.random.default_rng(0).random(len(contacts)) + 0.5
    right = np.random.default_rng(1).standard_normal(3000)
    answers = [
        BlockSystem(contacts.i_c, contacts.j_c, 1500, 2, backend=backend)
        .factor(contacts.normal_cd, along, extra_n=np.full(1500, 1e-2), pin=False)
        .solve(right)
        for backend in ("rslab", "blocks")
    ]
    assert np.abs(answers[0] - answers[1]).max() < 1e-10 * np.abs(answers[1]).max()


@pytest.fixture(scope="module")
def large():
    return {particles: pm.jam(scene(particles, 21)) for particles in (1024, 4096)}


@pytest.mark.parametrize("particles", [1024, 4096])
def test_large_packings_end_certified_with_one_state_of_self_stress(particles, large):
    report = large[particles].report
    assert report["hard_excess_contacts"] == 0 and report["floppy_modes"] == 0
    assert report["gap_error"] < 1e-11 and report["force_imbalance"] < 1e-9 and report["smallest_force"] > 0.0
    assert large[particles].residual < 1e-5
    assert pm.find_contacts(report["hard_packing"], gap_tolerance=1e-3).gap_c.min() > -1e-11


def test_steps_of_the_search_grow_more_slowly_than_the_number_of_particles(large):
    steps = [sum(one.steps for one in run.stages if one.name == "hard packing") for run in large.values()]
    assert steps[1] < 4 * steps[0]


def test_settling_ends_no_less_dense_than_the_search_alone_within_the_scatter_of_packings(large, monkeypatch):
    monkeypatch.setattr("packmech.protocols.hard_vertex.settle_at_pressure", lambda protocol, packing, steps: packing)
    alone = pm.jam(scene(1024, 21)).report["jamming_packing_fraction"]
    # packings of 1024 discs scatter by 7e-4
    assert large[1024].report["jamming_packing_fraction"] > alone - 2e-3


@pytest.mark.parametrize("pressure", [1e-3, 1e-6])
def test_large_packings_are_pressed_at_one_go_and_balance_at_the_pressure(pressure):
    run = pm.jam(scene(1024, 21), pressure=pressure)
    contacts = pm.find_contacts(run.packing)
    # springs of unit energy: force = overlap / diameter^2, in the diameters of the pair
    force = -contacts.gap_c / contacts.contact_distance_c**2
    net = np.zeros(run.packing.position_nd.shape)
    np.add.at(net, contacts.j_c, force[:, None] * contacts.normal_cd)
    np.subtract.at(net, contacts.i_c, force[:, None] * contacts.normal_cd)
    assert np.abs(net).max() < 1e-5 * force.mean()
    virial = np.einsum("c,ca,cb->ab", force, contacts.vector_cd, contacts.normal_cd) / run.packing.box.volume
    # in units of energy over the mean diameter squared
    assert virial * run.packing.diameter_n.mean() ** 2 == pytest.approx(
        pressure * np.eye(2), rel=1e-5, abs=1e-8 * pressure
    )
    steps = {one.name: one.steps for one in run.stages}
    # Newton's method is tried once, where the law is near enough to linear that it may be enough
    assert steps.get("soft packing", 0) <= 25


def test_a_small_search_that_goes_in_circles_begins_anew_after_settling():
    packing = pm.random_packing(512, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.87, seed=5)
    run = pm.jam(pm.Scene(packing, (pm.Repulsion(),)), pressure=1e-6, strain="isotropic")
    names = [one.name for one in run.stages]
    assert names.count("hard packing") == 2 and "settling" in names
    assert run.ok and run.report["force_imbalance"] < 1e-9


def test_a_large_packing_that_is_followed_is_not_settled_anew():
    first = pm.jam(scene(1024, 21), pressure=1e-6)
    again = pm.jam(scene(1024, 21).replace(packing=first.packing), pressure=1e-7)
    assert again.ok and "settling" not in [one.name for one in again.stages]
