"""Facts about hard packings sheared at zero pressure: families, their slopes, and what parts them."""

import functools

import numpy as np
import pytest

import packmech as pm
from packmech.protocols.shearing import hard_discs


@functools.cache
def jammed(seed=1, particles=10, dimension=2):
    sizes = pm.Bidisperse(ratio=1.4)
    start = pm.random_packing(particles, dimension=dimension, sizes=sizes, packing_fraction=0.6, seed=seed)
    return pm.jam(pm.Scene(start, (pm.Repulsion(),)), strain="isotropic")


@functools.cache
def walked():
    return pm.shear_families(jammed().packing, 0.12, step=0.01, keep=[0.0, 0.05, 0.12])


def slope_error(packing, step):
    """Return d ln(phi)/d(strain) by a difference of fourth order, plus Sigma/P."""
    there, back = (pm.shear_families(packing, sign * 2.0 * step, step=step) for sign in (1.0, -1.0))
    assert not there.changes and not back.changes
    (_, near, far), (_, less, least) = (np.log(one.packing_fraction_t) for one in (there, back))
    return abs((8.0 * (near - less) - (far - least)) / (12.0 * step) + there.stress_ratio_t[0])


@pytest.mark.parametrize(("particles", "dimension"), [(10, 2), (32, 2), (14, 3)])
def test_packing_fraction_falls_by_shear_stress_over_pressure(particles, dimension):
    assert slope_error(jammed(2, particles, dimension).packing, 1e-6) < 1e-7


def test_kept_packings_are_exact_hard_packings():
    run = walked()
    assert len(run.packings) == 3
    for packing, strain in zip(run.packings, (0.0, 0.05, 0.12), strict=True):
        contacts = pm.find_contacts(packing, gap_tolerance=1e-9)
        diameter = packing.diameter_n.mean()
        assert np.abs(contacts.gap_c).max() < 1e-11 * diameter
        row = int(np.flatnonzero(run.strain_t == strain)[-1])
        assert len(contacts) == run.contacts_t[row]
        assert abs(pm.packing_fraction(packing) - run.packing_fraction_t[row]) < 1e-13
        # one state of self stress: d N' - d + 1
        assert len(contacts) == 2 * (10 - run.rattlers_t[row]) - 1
    assert run.gap_error_t.max() < 1e-11 and run.residual < 1e-9


def test_changes_do_not_depend_on_the_step():
    coarse, fine = walked(), pm.shear_families(jammed().packing, 0.12, step=0.005)
    assert [one.cause for one in coarse.changes] == [one.cause for one in fine.changes]
    assert {one.cause for one in coarse.changes} == {"opening", "closing"}
    for one, other in zip(coarse.changes, fine.changes, strict=True):
        assert abs(one.strain - other.strain) < 1e-10
        assert abs(one.jump - other.jump) < 1e-9
        assert (one.closed, one.opened) == (other.closed, other.opened)


def test_an_exchange_is_continuous_and_a_fall_goes_up_in_packing_fraction():
    for one in walked().changes:
        if one.route == "exchange":
            assert one.jump == 0.0 and len(one.closed) == len(one.opened) == 1
        else:
            assert one.jump > 1e-7 and one.moved > 1e-4
    assert len(walked().jumps(1e-3)) == 1


def test_the_way_back_is_the_way_up_to_the_first_fall():
    there = pm.shear_families(jammed().packing, 0.06, step=0.01)
    *_, fall, exchange = there.changes
    assert (fall.route, exchange.route) == ("interior point", "exchange")
    back = pm.shear_families(there.packing, -0.06, step=0.01)
    first, second = back.changes[:2]
    assert first.cause == "closing" and abs(0.06 + first.strain - exchange.strain) < 1e-10
    # what fell is not climbed again: the network goes on below the strain at which it was reached
    assert second.strain + 0.06 < fall.strain - 1e-3
    between = (back.strain_t + 0.06 > fall.strain) & (back.strain_t < 0.0)
    known = there.strain_t > fall.strain + 1e-6
    order = np.argsort(there.strain_t[known])
    expected = np.interp(
        back.strain_t[between] + 0.06, there.strain_t[known][order], there.packing_fraction_t[known][order]
    )
    assert np.abs(back.packing_fraction_t[between] - expected).max() < 1e-5


def test_labels_of_the_lattice_and_mirrors_change_nothing():
    packing, run = jammed().packing, walked()
    lattice = packing.box.lattice_dd
    relabeled = pm.Packing(packing.position_nd, packing.radius_n, pm.Box(lattice @ [[1.0, 1.0], [0.0, 1.0]]))
    other = pm.shear_families(relabeled, 0.12, step=0.01)
    assert np.abs(other.packing_fraction_t - run.packing_fraction_t).max() < 1e-9
    assert np.abs(other.strain_t - run.strain_t).max() < 1e-10
    mirror = pm.Packing(packing.position_nd * [-1.0, 1.0], packing.radius_n, packing.box)
    image = pm.shear_families(mirror, -0.12, step=0.01)
    assert np.abs(image.packing_fraction_t - run.packing_fraction_t).max() < 1e-9
    assert np.abs(image.strain_t + run.strain_t).max() < 1e-10


def test_a_box_sheared_by_its_own_period_is_a_box_without_shear():
    """At the strain Lx/Ly the lattice is that of the start again; half of it and its negative are one lattice."""
    run = pm.shear_families(jammed().packing, 1.0, step=0.05, keep=[0.5])
    side = run.packing.box.volume**0.5
    assert np.abs(np.abs(run.packing.box.lattice_dd) - side * np.eye(2)).max() < 1e-8 * side
    half = run.packings[0]
    assert abs(half.box.lattice_dd[0, 1]) <= 0.5 * half.box.lattice_dd[0, 0] * (1.0 + 1e-12)
    assert len({change.family_after for change in run.changes}) > 10


def test_exact_hard_packings_are_taken_as_they_stand():
    hard = jammed().report["hard_packing"]
    run = pm.shear_families(hard, 1e-3)
    assert abs(run.packing_fraction_t[0] - pm.packing_fraction(hard)) < 1e-12


def test_what_is_not_jammed_is_refused():
    loose = pm.random_packing(16, dimension=2, packing_fraction=0.5, seed=1)
    with pytest.raises(ValueError, match="packing must be jammed"):
        pm.shear_families(loose)
    with pytest.raises(ValueError, match=r"keep\[0\] must lie between 0 and applied_strain, got 0.2"):
        pm.shear_families(jammed().packing, 0.1, keep=[0.2])


def test_what_was_finished_is_kept_where_time_is_up_and_at_ctrl_c():
    run = pm.shear_families(jammed().packing, 5.0, step=0.01, time_limit=0.1, check=False)
    assert run.outcome is pm.Outcome.TIME_LIMIT and len(run.strain_t) > 1

    def stop(stage, figures):
        if figures["strain"] > 0.025:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as caught:
        pm.shear_families(jammed().packing, 0.1, step=0.01, progress=stop)
    assert caught.value.run.strain_t[-1] == pytest.approx(0.03)


def test_rows_are_a_table():
    run = walked()
    lines = run.to_csv().splitlines()
    assert lines[0].startswith("strain,packing_fraction,stress_ratio,family")
    assert len(lines) == len(run.strain_t) + 1 == len(run.table()) + 1
    assert run.to_dict()["changes"] == len(run.changes) and "families" in repr(run)


@functools.cache
def jammed_ellipses():
    start = pm.random_packing(
        10, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.6, seed=0, shapes=pm.Ellipses(1.5)
    )
    return pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=1e-6, strain="isotropic").packing


@functools.cache
def walked_ellipses():
    return pm.shear_families(jammed_ellipses(), 0.05, step=0.01, keep=[0.03])


def test_hard_packings_of_ellipses_have_closed_contacts_and_balance_with_fewer_than_discs_need():
    run = walked_ellipses()
    assert run.outcome is pm.Outcome.FINISHED
    assert run.gap_error_t.max() < 1e-11 and run.residual < 1e-9
    # hypostatic: one state of self stress would need 3 N' - 1 contacts where curvature held nothing
    assert (run.contacts_t < 3 * (10 - run.rattlers_t) - 1).all()
    contacts = pm.find_shape_contacts(run.packings[0], gap_tolerance=1e-9)
    row = int(np.flatnonzero(run.strain_t == 0.03)[-1])
    assert len(contacts) == run.contacts_t[row]
    assert abs(pm.packing_fraction(run.packings[0]) - run.packing_fraction_t[row]) < 1e-13


def test_contacts_of_ellipses_open_alone_at_a_strain_that_the_step_does_not_move():
    coarse, fine = walked_ellipses(), pm.shear_families(jammed_ellipses(), 0.05, step=0.004)
    assert len(coarse.changes) == len(fine.changes) == 1
    for one, other in zip(coarse.changes, fine.changes, strict=True):
        assert (one.cause, one.route) == (other.cause, other.route) == ("opening", "exchange")
        assert abs(one.strain - other.strain) < 1e-9
        assert one.opened == other.opened and not one.closed and one.jump == 0.0


def test_ellipses_walk_back_the_way_they_came_where_none_fell():
    there = walked_ellipses()
    back = pm.shear_families(there.packing, -0.05, step=0.01)
    assert abs(back.packing_fraction_t[-1] - there.packing_fraction_t[0]) < 1e-9
    forth = [one.strain for one in there.changes]
    assert np.abs(np.array([0.05 + one.strain for one in back.changes])[::-1] - forth).max() < 1e-9


def test_slopes_of_ellipses_are_as_exact_as_those_of_discs():
    assert slope_error(jammed_ellipses(), 1e-5) < 1e-8


@functools.cache
def jammed_mixture(ratio, seed, packing_fraction=0.75, scatter=0.0, aspect=None):
    """Return a small jammed packing in which many particles rattle, or one of ellipses."""
    shapes = None if aspect is None else pm.Ellipses(aspect)
    start = pm.random_packing(
        16 if aspect is None else 12,
        dimension=2,
        sizes=pm.Bidisperse(ratio=ratio, scatter=scatter),
        packing_fraction=packing_fraction,
        seed=seed,
        shapes=shapes,
    )
    pressure = None if aspect is None else 1e-6
    return pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=pressure, strain="isotropic").packing


def overlap_of_all_pairs(packing):
    """Return the largest overlap over the contact distance, by every pair and image in turn."""
    if packing.shapes.has_orientations:
        return float(np.maximum(pm.find_shape_contacts(packing, gap_tolerance=0.0).overlap_c, 0.0).max(initial=0.0))
    images = np.stack(np.meshgrid([-1, 0, 1], [-1, 0, 1], indexing="ij"), axis=-1).reshape(-1, 2)
    worst = 0.0
    for image in images:
        vector = packing.position_nd[None] - packing.position_nd[:, None] + packing.box.lattice_dd @ image
        distance = np.sqrt((vector**2).sum(axis=2))
        if not image.any():
            np.fill_diagonal(distance, np.inf)
        worst = max(worst, float((1.0 - distance / np.add.outer(packing.radius_n, packing.radius_n)).max()))
    return worst


def kept_of(packing):
    """Return twenty kept packings of a path up to a strain of 0.05."""
    return pm.shear_families(packing, 0.05, step=2.5e-3, keep=np.linspace(0.0, 0.05, 21)[1:], time_limit=60.0).packings


@pytest.mark.parametrize(("ratio", "seed", "packing_fraction"), [(3.0, 3, 0.8), (1.4, 5, 0.75), (10.0, 0, 0.75)])
def test_no_pair_of_a_kept_packing_overlaps_rattlers_or_not(ratio, seed, packing_fraction):
    packings = kept_of(jammed_mixture(ratio, seed, packing_fraction, 0.1 if ratio > 5.0 else 0.0))
    assert len(packings) == 20
    assert max(overlap_of_all_pairs(one) for one in packings) <= 1e-12


@pytest.mark.slow
@pytest.mark.parametrize(
    ("ratio", "aspect"), [(1.4, None), (3.0, None), (10.0, None), (1.4, 1.5)], ids=["1.4", "3", "10", "ellipses"]
)
def test_none_of_a_thousand_kept_packings_overlaps(ratio, aspect):
    # equal large discs of the last mixture would make crystals
    scatter = 0.1 if ratio > 5.0 else 0.0
    density = 0.75 if aspect is None else 0.6
    worst = [
        overlap_of_all_pairs(one)
        for seed in range(13)
        for one in kept_of(jammed_mixture(ratio, seed, density, scatter, aspect))
    ]
    assert len(worst) == 260
    assert max(worst) <= 1e-12


def test_rattlers_that_are_squeezed_are_so_at_a_strain_that_the_step_does_not_move():
    packing = jammed_mixture(3.0, 21)
    coarse, fine = (pm.shear_families(packing, 0.015, step=step, time_limit=20.0) for step in (5e-3, 1e-3))
    assert [one.cause for one in coarse.changes] == [one.cause for one in fine.changes] == ["squeezing"]
    assert abs(coarse.changes[0].strain - fine.changes[0].strain) < 1e-11


def test_a_crystal_with_rattlers_is_sheared_to_where_its_contacts_part_and_on():
    # eight equal discs bear all forces, five contacts more than one state of self stress needs
    run = pm.shear_families(jammed_mixture(10.0, 2), 0.05, step=2.5e-3, keep=[0.025, 0.05], time_limit=20.0)
    assert run.contacts_t[0] == 20 and run.contacts_t[-1] < 20
    assert len(run.changes) == 1 and 0.0 < run.changes[0].strain < 1e-6
    assert max(overlap_of_all_pairs(one) for one in run.packings) <= 1e-12


def test_a_path_that_loses_the_packing_says_why_and_keeps_the_last_hard_one(monkeypatch):
    monkeypatch.setattr(hard_discs, "search_hard", lambda *_: (None, 0))
    run = pm.shear_families(jammed().packing, 0.06, step=0.01, check=False)
    assert run.outcome is pm.Outcome.NOT_JAMMED
    assert run.report["stopped"].startswith("no hard packing was found, beyond strain 0.03")
    assert 0.03 <= run.strain_t[-1] < 0.0392
    assert overlap_of_all_pairs(run.packing) <= 1e-12


def test_a_start_with_more_contacts_than_needed_goes_on_with_those_that_bear_forces():
    packing = jammed_mixture(1.4, 5)
    run = pm.shear_families(packing, 1e-3, step=1e-3)
    first = run.changes[0]
    # the strain at which the contacts touch exactly is solved for
    assert first.strain == pytest.approx(0.0, abs=1e-13)
    assert (first.cause, first.route) == ("opening", "exchange")
    assert len(first.opened) == 1 and not first.closed
    assert run.gap_error_t.max() < 1e-13
