"""Facts about contacts of shapes: slopes and curvatures against differences, turns, rattlers."""

import numpy as np
import pytest

import packmech as pm
from packmech.contacts.rattlers import can_balance, ends_of, rattlers_of
from packmech.contacts.shape_contacts import candidate_sites, find_shape_contacts, shape_contacts


def some(d, count=10, seed=1):
    """Return overlapping shapes in a skewed box, one so long that it touches its own image."""
    rng = np.random.default_rng(seed)
    lattice = 2.4 * np.array([[1.0, 0.3, 0.1], [0.0, 1.1, -0.2], [0.0, 0.0, 0.9]])[:d, :d]
    radius, aspect = rng.uniform(0.3, 0.5, count), rng.uniform(0.4, 2.5, count)
    radius[0], aspect[0] = 0.9, 2.5
    shapes = pm.Spheroids(aspect, rng.normal(size=(count, d)))
    return pm.Packing(rng.random((count, d)) @ lattice.T, radius, pm.Box(lattice), shapes=shapes)


@pytest.mark.parametrize("d", [2, 3])
def test_slopes_and_curvatures_are_derivatives_of_the_distance(d):
    packing = some(d)
    pairs = candidate_sites(packing)
    found = shape_contacts(packing, pairs, second=True)
    assert (found.i_c == found.j_c).any()
    rng, step, turns = np.random.default_rng(2), 1e-6, 1 if d == 2 else 3
    moved, turned = rng.normal(size=(packing.particles, d)), rng.normal(size=(packing.particles, turns))
    motion = np.hstack([moved[found.j_c] - moved[found.i_c], turned[found.i_c], turned[found.j_c]])
    ends = []
    for sign in (1, -1):
        shapes = packing.shapes.turned(sign * step * turned)
        other = packing.replace(position_nd=packing.position_nd + sign * step * moved, shapes=shapes)
        ends.append(shape_contacts(other, pairs))
    slope = (ends[0].distance_c - ends[1].distance_c) / (2 * step)
    assert np.abs(slope - (found.slope_cx * motion).sum(axis=1)).max() < 1e-7
    # along one rotation vector, whose own coordinates stay as they are
    bend = ((ends[0].slope_cx - ends[1].slope_cx) * motion).sum(axis=1) / (2 * step)
    curved = np.einsum("cx,cxy,cy->c", motion, found.curvature_cxx, motion)
    assert np.abs(bend - curved).max() < 1e-7 * np.abs(curved).max()


@pytest.mark.parametrize("d", [2, 3])
def test_turns_undo_each_other_and_are_found_again(d):
    shapes = some(d).shapes
    rotation = np.random.default_rng(1).normal(size=(len(shapes), 1 if d == 2 else 3)) * 0.5
    there = shapes.turned(rotation)
    assert np.abs(there.turned(-rotation).director_nd - shapes.director_nd).max() < 1e-14
    found = there.rotation_since(shapes)
    assert np.abs(shapes.turned(found).director_nd - there.director_nd).max() < 1e-14
    if d == 2:
        assert np.abs(found - rotation).max() < 1e-14
    else:
        assert np.abs((found * shapes.director_nd).sum(axis=1)).max() < 1e-14
    small = shapes.turned(1e-12 * rotation)
    assert np.abs(shapes.turned(small.rotation_since(shapes)).director_nd - small.director_nd).max() < 3e-16


@pytest.mark.parametrize("d", [2, 3])
def test_coordinates_of_turns_are_lengths_across_the_axis(d):
    packing = some(d)
    shapes = pm.Spheroids(np.where(np.arange(10) == 3, 1.0, packing.shapes.aspect_n), packing.shapes.director_nd)
    basis = shapes.turn_basis(packing.radius_n)
    assert not basis[3].any() and (np.abs(np.delete(basis, 3, axis=0)).max(axis=2) > 0).all()
    gyration = shapes.gyration(packing.radius_n)
    if d == 2:
        along, across = shapes.semi_axes(packing.radius_n)
        assert np.allclose(gyration**2, (along**2 + across**2) / 4)
    scaled = np.delete(basis * gyration[:, None, None], 3, axis=0)
    assert np.allclose(np.einsum("nkt,nlt->nkl", scaled, scaled), np.eye(1 if d == 2 else 2))
    if d == 3:
        assert np.abs(np.einsum("nkt,nt->nk", scaled, np.delete(shapes.director_nd, 3, axis=0))).max() < 1e-15


def test_the_radius_of_gyration_is_that_of_points_inside():
    rng = np.random.default_rng(3)
    for d, count in ((2, 400_000), (3, 400_000)):
        point = rng.normal(size=(count, d))
        point *= (rng.random(count) ** (1 / d) / np.sqrt((point**2).sum(axis=1)))[:, None]
        shapes = pm.Spheroids([2.0], [np.eye(d)[0]])
        along, across = (axis[0] for axis in shapes.semi_axes([0.7]))
        point *= np.array([along, *[across] * (d - 1)])
        # about an axis across: distance squared from it
        about = (point[:, :2] ** 2).sum(axis=1).mean()
        assert shapes.gyration([0.7])[0] ** 2 == pytest.approx(about, rel=5e-3)


def test_changes_of_distances_keep_the_digits_that_their_difference_loses():
    packing = some(2)
    packing = packing.replace(shapes=pm.Spheroids(np.ones(10), packing.shapes.director_nd))
    pairs = candidate_sites(packing)
    start = shape_contacts(packing, pairs)
    moved = np.random.default_rng(5).normal(size=(10, 2))
    for step in (1e-3, 1e-11):
        other = packing.replace(position_nd=packing.position_nd + step * moved)
        now = shape_contacts(other, pairs)
        # of discs, from the positions as they are stored, in longer numbers
        lengths = []
        for one in (packing, other):
            place = one.position_nd.astype(np.longdouble)
            image = pairs.image_cd.astype(np.longdouble) @ one.box.lattice_dd.T.astype(np.longdouble)
            lengths.append(np.sqrt(((place[pairs.j_c] - place[pairs.i_c] + image) ** 2).sum(axis=1)))
        exact = (lengths[1] - lengths[0]).astype(float)
        scale = np.abs(exact).max()
        kept = np.median(np.abs(now.distance_change(start) - exact)) / scale
        lost = np.median(np.abs(now.distance_c - start.distance_c - exact)) / scale
        assert kept < 1e-8
    assert lost > 1e-7


def held(angles, directions=None):
    """Return an ellipse in the middle with round neighbors that touch it at these angles, far from each other."""
    shapes = [2.0, *[1.0] * len(angles)]
    director = [[1.0, 0.0]] * len(shapes)
    a, b = (axis[0] for axis in pm.Spheroids([2.0], [[1.0, 0.0]]).semi_axes([0.5]))
    places = [[0.0, 0.0]]
    for angle in angles:
        rim = np.array([a * np.cos(angle), b * np.sin(angle)])
        normal = np.array([np.cos(angle) / a, np.sin(angle) / b])
        places.append(rim + 0.2 * normal / np.hypot(*normal) * (1 - 1e-9))
    radius = [0.5, *[0.2] * len(angles)]
    packing = pm.Packing(np.array(places) + 5.0, radius, pm.Box.cubic(10.0, 2), shapes=pm.Spheroids(shapes, director))
    contacts = find_shape_contacts(packing)
    assert len(contacts) == len(angles)
    return packing, contacts


def test_an_ellipse_on_three_contacts_is_held_where_their_normals_meet_in_one_point():
    # mirror images whose normals meet on the short axis, and the third along it
    packing, contacts = held([0.6, np.pi - 0.6, -np.pi / 2])
    neighbors = contacts.select([0, 1, 2])
    assert _held_by(packing, neighbors)
    # off the axis they leave a torque that nothing balances
    packing, contacts = held([0.6, np.pi - 0.9, -np.pi / 2 + 0.3])
    assert not _held_by(packing, contacts)
    # four that turn it both ways hold it
    packing, contacts = held([0.5, np.pi - 0.5, np.pi + 0.5, -0.5])
    assert _held_by(packing, contacts)
    # all on one side do not
    packing, contacts = held([0.5, np.pi - 0.5, np.pi / 2])
    assert not _held_by(packing, contacts)


def _held_by(packing, contacts):
    """Return whether the ellipse is held, by itself: neighbors that are taken out are put in again."""
    ends = ends_of(contacts)
    push, side = (part[ends.body_e == 0] for part in (ends.push_ex, ends.side_esx))
    return len(contacts) > packing.dimension and bool(can_balance(push, side, np.array([0]), len(push), 0.0))


def test_what_rattles_is_taken_out_one_after_the_other():
    packing, contacts = held([0.5, np.pi - 0.5, np.pi + 0.5, -0.5])
    # its neighbors have one contact each: they go first, and then it has none
    assert rattlers_of(contacts).all()
    assert pm.find_rattlers(packing).all() and pm.coordination_number(packing) == 0.0


@pytest.mark.parametrize("d", [2, 3])
def test_packings_of_discs_written_as_shapes_have_the_rattlers_of_discs(d):
    scene = pm.Scene(pm.random_packing(32, dimension=d, packing_fraction=0.6, seed=2), (pm.Repulsion(),))
    packing = pm.jam(scene, pressure=1e-4).packing
    shapes = pm.Spheroids(np.ones(32), np.random.default_rng(0).normal(size=(32, d)))
    assert np.array_equal(pm.find_rattlers(packing.replace(shapes=shapes)), pm.find_rattlers(packing))
    assert pm.coordination_number(packing.replace(shapes=shapes)) == pm.coordination_number(packing)
