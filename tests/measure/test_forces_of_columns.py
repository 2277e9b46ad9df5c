"""Facts about contact forces in columns, pairs and crystals, where they are known without any sum over contacts."""

import numpy as np
import pytest

import packmech as pm

ROUGH = (pm.Repulsion(), pm.Friction(0.5, stiffness=1.0))


def columns(*overlaps):
    """Return columns of two discs each between their own images, with these overlaps."""
    height = 2.0
    place = [[2.0 + 3.0 * k, y] for k in range(len(overlaps)) for y in (0.5, 1.5)]
    radius = [0.5 * (1.0 + one) for one in overlaps for _ in range(2)]
    return pm.Packing(place, radius, pm.Box([[3.0 * len(overlaps) + 1.0, 0.0], [0.0, height]]))


def test_a_pair_that_nothing_holds_together_is_not_at_rest_by_all_of_its_force():
    pair = pm.Packing([[1.0, 1.0], [1.9, 1.0]], [0.5, 0.5], pm.Box.cubic(4.0, 2))
    found = pm.contact_forces(pm.Scene(pair, (pm.Repulsion(),)))
    assert found.residual == pytest.approx(1.0, rel=1e-14) and not found.at_rest
    assert not found.balances_to(0.99) and found.balances_to(1.01)


def test_overlaps_of_rounding_are_at_rest_whatever_they_leave_unbalanced():
    packing = columns(0.0)
    tiny = packing.replace(position_nd=packing.position_nd + [[0.0, 0.0], [0.0, 2e-16]], radius_n=[0.5 + 1e-16] * 2)
    found = pm.contact_forces(pm.Scene(tiny, (pm.Repulsion(),)))
    assert found.largest_imbalance < 1e-14 and found.at_rest


def test_contacts_bear_above_a_millionth_of_the_mean_force_at_rest_and_all_that_push_away_from_rest():
    scene = pm.Scene(columns(0.05, 1e-9), ROUGH)
    found = pm.contact_forces(scene)
    assert found.residual < 1e-12 and found.bearing_c.tolist() == (found.normal_c > 1e-3).tolist()
    assert found.bearing_c.sum() == 2 and found.rattlers_n.tolist() == [False, False, True, True]
    moved = scene.packing.position_nd + [[0.0, 0.0], [0.0, 0.01], [0.0, 0.0], [0.0, 0.0]]
    away = pm.contact_forces(scene.replace(packing=scene.packing.replace(position_nd=moved)))
    assert away.residual > 0.1 and away.bearing_c.all()


def test_links_bear_what_contacts_leave_unbalanced():
    packing = columns(0.05)
    place = [[2.0, 0.5 + k] for k in range(4)]
    links = pm.Links([0, 2], [1, 3], [[0, 0], [0, 0]], [1.0, 1.0])
    dimers = pm.Packing(place, [packing.radius_n[0]] * 4, pm.Box(np.diag([4.0, 4.0])), links)
    found = pm.contact_forces(pm.Scene(dimers, (pm.Repulsion(),)))
    assert len(found.contacts) == 2 and found.residual < 1e-12 and found.at_rest
    assert found.tension_l == pytest.approx(-found.normal_c, rel=1e-12)


def test_tangential_forces_that_cancel_leave_a_torque_that_counts_over_the_radius():
    packing = columns(0.05)
    pairs = pm.find_contacts(packing)
    springs = pm.TangentialDisplacements(pairs.i_c, pairs.j_c, pairs.image_cd, [[0.01], [0.01]])
    found = pm.contact_forces(pm.Scene(packing.replace(tangential=springs), ROUGH))
    assert np.abs(found.force_nd).max() < 1e-15
    # two forces of .01 at half the distance from the center, over the radius .525 and the normal force
    expected = 2.0 * 0.01 * 0.5 / 0.525 / found.normal_c.mean()
    assert found.residual == pytest.approx(expected, rel=1e-12) and not found.at_rest


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("rough", [False, True])
def test_each_link_takes_2_over_n_numbers_off_what_balances_a_crystal(d, rough):
    name = "triangular" if d == 2 else "fcc"
    crystal = pm.lattice_packing(name, repeats=(3,) * d, relative_overlap=0.01)
    pair = pm.find_contacts(crystal).select(np.arange(1))
    linked = crystal.replace(links=pm.Links(pair.i_c, pair.j_c, pair.image_cd, pair.distance_c))
    effects = ROUGH if rough else ROUGH[:1]
    found = [pm.contact_forces(pm.Scene(one, effects)) for one in (crystal, linked)]
    assert [one.rattlers_n.any() for one in found] == [False, False]
    # a contact bears one number, with friction d
    numbers = d if rough else 1
    assert found[0].isostatic_coordination == pytest.approx(d + 1 if rough else 2 * d, rel=1e-14)
    less = found[0].isostatic_coordination - found[1].isostatic_coordination
    assert less == pytest.approx(2.0 / (numbers * crystal.particles), rel=1e-9)


def test_rattlers_and_their_contacts_count_in_no_mean():
    crystal = pm.lattice_packing("triangular", repeats=(4, 4), relative_overlap=0.01)
    # one disc is taken out, and two that overlap each other, and touch nobody, are put in its place
    place = np.vstack([crystal.position_nd[1:], crystal.position_nd[0] + [[-0.02, 0.0], [0.02, 0.0]]])
    packing = pm.Packing(place, [*crystal.radius_n[1:], 0.1, 0.1], crystal.box)
    pairs = pm.find_contacts(packing).among(np.arange(17) < 15).select(np.arange(3))
    springs = pm.TangentialDisplacements(pairs.i_c, pairs.j_c, pairs.image_cd, np.ones((3, 1)))
    found = pm.contact_forces(pm.Scene(packing.replace(tangential=springs), ROUGH))
    assert found.rattlers_n.tolist() == [False] * 15 + [True] * 2
    # 48 contacts, less the 6 of the disc that was taken out
    assert len(found.contacts) == 43 and found.to_dict()["bearing_contacts"] == 42
    assert found.at_limit_per_particle == 3.0 / 15.0 and found.sliding_fraction == 3.0 / 42.0
    assert found.coordination_number == 2.0 * 42.0 / 15.0
    assert found.isostatic_coordination == pytest.approx(3.0 + 3.0 / 15.0, rel=1e-14)


@pytest.mark.parametrize("slipping", [0, 4])
def test_springs_at_the_rolling_limit_count_as_sliding_contacts_do(slipping):
    crystal = pm.lattice_packing("triangular", repeats=(2, 2), relative_overlap=0.01)
    pairs = pm.find_contacts(crystal).select(np.arange(4))
    rolled = np.zeros((4, 1))
    rolled[:slipping] = 1.0
    springs = pm.TangentialDisplacements(pairs.i_c, pairs.j_c, pairs.image_cd, np.zeros((4, 1)), rolling_ck=rolled)
    effects = (*ROUGH, pm.RollingResistance(coefficient=0.1, stiffness=1.0))
    found = pm.contact_forces(pm.Scene(crystal.replace(tangential=springs), effects))
    # three numbers balance a disc, and a contact bears three for two of them, less one where its spring slips
    expected = 2.0 * (3.0 + slipping / crystal.particles) / 3.0
    assert not found.at_limit_c.any() and found.isostatic_coordination == pytest.approx(expected, rel=1e-14)


def test_an_ellipse_that_leans_between_its_own_images_is_turned_though_no_force_moves_it():
    # parallel ellipses of axes sqrt(2) and 1 / sqrt(2), at 45 degrees, touch from 2 / sqrt(5) = .89 on
    lean = pm.Spheroids([2.0], [[1.0, 1.0]])
    packing = pm.Packing([[2.0, 0.5]], [0.5], pm.Box(np.diag([6.0, 0.85])), shapes=lean)
    found = pm.contact_forces(pm.Scene(packing, (pm.Repulsion(),)))
    assert len(found.contacts) and np.abs(found.force_nd).max() < 1e-12
    assert np.abs(found.torque_nk).max() > 1e-3 and found.residual > 0.1 and not found.at_rest


def test_what_rough_walls_bear_is_in_no_count_of_contacts():
    disc = pm.Packing([[5.0, 0.45]], [0.5], pm.Box.cubic(20.0, 2))
    walls = pm.Walls(1, 0.0, 0.9, pm.LinearSpring(), friction=pm.Friction(0.5))
    assert np.isnan(pm.contact_forces(pm.Scene(disc, (*ROUGH, walls))).isostatic_coordination)
