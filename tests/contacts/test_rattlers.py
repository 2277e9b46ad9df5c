"""Facts about rattlers: which contact normals hold a particle, and that loose neighbors hold nobody."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog

import packmech as pm
from packmech.contacts.rattlers import _is_free, rattlers_of

CRYSTALS = ["triangular", "square", "honeycomb", "kagome", "sc", "bcc", "fcc", "hcp", "diamond"]


def directions(degrees):
    angle = np.radians(degrees)
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


def is_free(normal_cd):
    count, d = np.shape(normal_cd)
    return bool(_is_free(np.ascontiguousarray(normal_cd, dtype=float), d, *np.empty((3, count)), count))


def margin(normal_cd):
    """Return how far the origin lies inside the hull of the normals; negative outside. By linear programs."""
    # the smallest over directions u of max n.u, on the surface of a cube: one program for each face
    count, d = normal_cd.shape
    best = np.inf
    for axis in range(d):
        for sign in (-1.0, 1.0):
            cost = np.zeros(d + 1)
            cost[-1] = 1.0
            below = np.hstack([normal_cd, -np.ones((count, 1))])
            bounds = [(-1.0, 1.0)] * d + [(None, None)]
            bounds[axis] = (sign, sign)
            best = min(best, linprog(cost, A_ub=below, b_ub=np.zeros(count), bounds=bounds).fun)
    return best


@pytest.mark.parametrize("name", CRYSTALS)
@pytest.mark.parametrize("repeats", [1, 2])
def test_touching_crystal_has_no_rattlers_down_to_one_particle_that_touches_itself(name, repeats):
    assert not pm.find_rattlers(pm.lattice_packing(name, repeats)).any()


@pytest.mark.parametrize("repeats", [1, 3])
def test_crystal_pulled_apart_is_all_rattlers(repeats):
    assert pm.find_rattlers(pm.lattice_packing("fcc", repeats, relative_overlap=-1e-6)).all()


def test_three_contacts_around_a_disc_hold_it():
    assert not is_free(directions([0.0, 130.0, 250.0]))


def test_three_contacts_on_one_side_of_a_disc_do_not_hold_it():
    assert is_free(directions([0.0, 60.0, 150.0]))


def test_two_opposite_contacts_and_one_across_leave_a_disc_free():
    assert is_free(directions([0.0, 180.0, 90.0]))


def test_two_pairs_of_opposite_contacts_hold_a_disc():
    assert not is_free(directions([0.0, 180.0, 40.0, 220.0]))


def test_contacts_in_one_plane_never_hold_a_sphere():
    flat = np.hstack([directions([0.0, 90.0, 180.0, 270.0, 45.0]), np.zeros((5, 1))])
    assert is_free(flat)
    assert is_free(np.vstack([flat, [0.0, 0.0, 1.0]]))
    assert not is_free(np.vstack([flat, [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]))


@pytest.mark.parametrize("d", [2, 3])
def test_fewer_than_d_plus_1_contacts_never_hold(d):
    assert is_free(np.vstack([np.eye(d)[:-1], -np.ones((1, d)) / np.sqrt(d)]))


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), d=st.sampled_from([2, 3]), count=st.integers(2, 9))
def test_held_exactly_when_no_direction_approaches_no_neighbor_by_linear_programs(seed, d, count):
    normal = np.random.default_rng(seed).standard_normal((count, d))
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    inside = margin(normal)
    if abs(inside) > 1e-6:
        assert is_free(normal) == (inside < 0)


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_turning_a_cube_of_contacts_changes_nothing_though_it_is_degenerate(seed):
    turn, _ = np.linalg.qr(np.random.default_rng(seed).standard_normal((3, 3)))
    cube = np.vstack([np.eye(3), -np.eye(3)]) @ turn
    assert not is_free(cube)
    assert is_free(cube[:5])


def test_column_of_discs_in_a_wide_box_rattles_though_it_touches_its_images():
    column = pm.Packing([[0.0, 0.0]], [0.5], pm.Box([[1.0, 0.0], [0.0, 3.0]]))
    assert len(pm.find_contacts(column, gap_tolerance=1e-9)) == 1
    assert pm.find_rattlers(column).all()


def test_a_column_that_nothing_keeps_from_buckling_has_no_contacts_that_count_and_a_warning_if_it_presses():
    box = pm.Box([[1.0, 0.0], [0.0, 3.0]])
    assert pm.coordination_number(pm.Packing([[0.0, 0.0]], [0.5], box), gap_tolerance=1e-9) == 0.0
    with pytest.warns(UserWarning, match="got 1 pairs that overlap and no particle that they hold"):
        assert pm.coordination_number(pm.Packing([[0.0, 0.0]], [0.51], box)) == 0.0


def crystal_with_guest(gap):
    """Return a triangular crystal with one vacancy, and in it a small disc at the given gap from one neighbor."""
    crystal = pm.lattice_packing("triangular", repeats=(5, 5))
    position, radius = crystal.position_nd[1:], crystal.radius_n[1:]
    guest = crystal.position_nd[0] + [0.2 - gap, 0.0]
    return pm.Packing(np.vstack([position, guest]), np.append(radius, 0.3), crystal.box)


def test_disc_hanging_by_one_contact_rattles_and_its_neighbors_do_not():
    packing = crystal_with_guest(0.0)
    assert pm.find_contacts(packing, gap_tolerance=1e-9).count_n()[-1] == 1
    assert np.flatnonzero(pm.find_rattlers(packing)).tolist() == [24]


def test_the_contact_of_a_rattler_counts_for_none_of_the_others():
    # a crystal of 25 discs has 75 contacts, of which its vacancy takes 6; the guest in it touches one neighbor
    packing = crystal_with_guest(0.0)
    assert pm.coordination_number(packing, gap_tolerance=1e-9) == 2.0 * 69 / 24
    assert pm.coordination_number(packing, gap_tolerance=1e-9, rattlers="keep") == 2.0 * 70 / 25
    assert pm.coordination_number(crystal_with_guest(0.01), gap_tolerance=1e-9) == 2.0 * 69 / 24


def test_removing_rattlers_returns_the_rest_and_their_numbers():
    packing = crystal_with_guest(0.01)
    backbone, index = pm.remove_rattlers(packing)
    assert index.tolist() == list(range(24))
    assert np.array_equal(backbone.position_nd, packing.position_nd[:24])


def test_one_vacancy_undoes_a_square_crystal_disc_by_disc():
    # its neighbors lose their hold along the row and the column, the next lose theirs along their own lines, and so on
    crystal = pm.lattice_packing("square", repeats=(6, 6))
    keep = np.arange(36) != 14
    assert pm.find_rattlers(pm.Packing(crystal.position_nd[keep], crystal.radius_n[keep], crystal.box)).all()


def test_no_contacts_at_all_means_all_rattle():
    contacts = pm.find_contacts(pm.Packing([[0.0, 0.0], [2.0, 2.0]], [0.1, 0.1], pm.Box.cubic(4.0, 2)))
    assert rattlers_of(contacts).tolist() == [True, True]


def test_given_contacts_overrule_the_gap_tolerance():
    crystal = pm.lattice_packing("triangular", repeats=(3, 3))
    contacts = pm.find_contacts(crystal, gap_tolerance=1e-9)
    lost = (contacts.i_c == 0) | (contacts.j_c == 0)
    assert np.flatnonzero(pm.find_rattlers(crystal, contacts=contacts.select(~lost))).tolist() == [0]


def test_packing_of_rattlers_cannot_be_reduced():
    with pytest.raises(ValueError, match="packing must have particles that do not rattle, got 4 rattlers"):
        pm.remove_rattlers(pm.lattice_packing("triangular", repeats=(2, 2), relative_overlap=-0.1))


def test_contacts_of_another_packing_are_refused():
    contacts = pm.find_contacts(pm.lattice_packing("triangular", repeats=(2, 2)))
    with pytest.raises(ValueError, match="contacts must belong to 9 particles in 2 dimensions, got 4 in 2"):
        pm.find_rattlers(pm.lattice_packing("triangular", repeats=(3, 3)), contacts=contacts)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_relabelling_permutes_the_rattlers(seed):
    rng = np.random.default_rng(seed)
    position, radius = rng.random((40, 2)) * 5.0, rng.uniform(0.4, 0.7, 40)
    order = rng.permutation(40)
    box = pm.Box.cubic(5.0, 2)
    before = pm.find_rattlers(pm.Packing(position, radius, box))
    assert np.array_equal(pm.find_rattlers(pm.Packing(position[order], radius[order], box)), before[order])


@pytest.mark.parametrize("bound", [False, True])
def test_walls_hold_a_cluster_as_a_whole_where_they_hold_none_of_its_discs(bound):
    """Each of two discs touches two walls, which push it towards the other: only a link keeps both where they are."""
    links = pm.Links([0], [1], [[0, 0]], [2.0**0.5]) if bound else None
    packing = pm.Packing([[1.0, 1.0], [2.0, 2.0]], [0.5, 0.5], pm.Box.cubic(4.0, 2), links)
    corners = (pm.Walls(0, low=0.51, high=2.49), pm.Walls(1, low=0.51, high=2.49))
    assert pm.find_rattlers(packing, effects=corners).tolist() == [not bound] * 2
    # two walls alone leave a cluster free to slide along them
    assert pm.find_rattlers(packing, effects=corners[:1]).all()
