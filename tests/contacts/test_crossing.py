"""Facts about crossing links: the test over images against listing them all, the bound 1/sqrt2, invariances."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import packmech as pm
from packmech.contacts.crossing import near_links, swept_links


def segments(seed, most=14):
    """Return a packing of random links: any lattice, ends shared at random, images up to one, some longer than it."""
    rng = np.random.default_rng(seed)
    particles = int(rng.integers(2, most))
    # upright, or tilted by up to two cells; a far flatter cell only makes the list of all images endless
    lattice = np.eye(2) + rng.uniform(-0.2, 0.2, (2, 2)) + rng.choice([0.0, 1.0]) * rng.uniform(-2, 2) * np.eye(2, k=1)
    box = pm.Box(lattice * 10 ** rng.uniform(-1, 1))
    position = rng.random((particles, 2)) @ box.lattice_dd.T
    found = {}
    for _ in range(int(rng.integers(1, most))):
        i, j = np.sort(rng.choice(particles, 2, replace=False))
        found[(int(i), int(j), *rng.integers(-1, 2, 2).tolist())] = None
    key = np.array(list(found))
    vector = position[key[:, 1]] - position[key[:, 0]] + key[:, 2:] @ box.lattice_dd.T
    links = pm.Links(key[:, 0], key[:, 1], key[:, 2:], np.linalg.norm(vector, axis=1), rng.random(len(key)) < 0.2)
    return pm.Packing(position, np.full(particles, 0.1), box, links)


def list_crossings(packing):
    """Return the crossings by trying every image of every pair: the two lines' equations solved, p + s u = q + t v."""
    links, lattice = packing.links, packing.box.lattice_dd
    start = packing.position_nd[links.i_l]
    along = links.vectors(packing.position_nd, lattice)
    most = np.ceil(np.ptp(np.concatenate([start, start + along]) @ packing.box.inverse_dd.T, axis=0)).astype(int)
    shift = np.array(list(itertools.product(*[range(-m, m + 1) for m in most])))
    found = {}
    for a, b in itertools.combinations(np.flatnonzero(~links.shape_l).tolist(), 2):
        gap = start[b] + shift @ lattice.T - start[a]
        s, t = np.linalg.solve(np.column_stack([along[a], -along[b]]), gap.T)
        ends = {(int(links.i_l[a]), 0, 0), (int(links.j_l[a]), *links.image_ld[a].tolist())}
        for k in np.flatnonzero((s >= 0) & (s <= 1) & (t >= 0) & (t <= 1)):
            z, far = shift[k].tolist(), (shift[k] + links.image_ld[b]).tolist()
            if (int(links.i_l[b]), *z) not in ends and (int(links.j_l[b]), *far) not in ends:
                found[(a, b, *z)] = start[a] + s[k] * along[a]
    return found


def as_dict(crossings):
    key = np.column_stack([crossings.first_c, crossings.second_c, crossings.image_cd]).tolist()
    return {tuple(one): point for one, point in zip(key, crossings.point_cd, strict=True)}


@settings(max_examples=80, deadline=None)
@given(st.integers(0, 2**32))
def test_crossings_are_those_found_by_trying_every_image(seed):
    packing = segments(seed)
    found, expected = as_dict(pm.crossing_links(packing)), list_crossings(packing)
    assert sorted(found) == sorted(expected)
    size = np.abs(packing.position_nd).max() + np.abs(packing.box.lattice_dd).max()
    for key, point in expected.items():
        np.testing.assert_allclose(found[key], point, atol=1e-9 * size)


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32))
def test_wrapping_relabelling_and_other_lattice_vectors_keep_the_crossings(seed):
    packing = segments(seed)
    rng = np.random.default_rng(seed)
    count = len(pm.crossing_links(packing))
    image = rng.integers(-3, 4, packing.position_nd.shape)
    moved = packing.replace(
        position_nd=packing.position_nd - image @ packing.box.lattice_dd.T, links=packing.links.moved(image)
    )
    assert len(pm.crossing_links(moved)) == count
    assert len(pm.crossing_links(packing.wrapped())) == count
    number = rng.permutation(packing.particles)
    relabelled = packing.replace(
        position_nd=packing.position_nd[np.argsort(number)], links=packing.links.numbered(number)
    )
    assert len(pm.crossing_links(relabelled)) == count
    change = np.array([[1, 2], [1, 3]])
    links = packing.links
    back = np.rint(np.linalg.inv(change)).astype(int)
    other = packing.replace(
        box=pm.Box(packing.box.lattice_dd @ change),
        links=pm.Links(links.i_l, links.j_l, links.image_ld @ back.T, links.length_l, links.shape_l),
    )
    assert len(pm.crossing_links(other)) == count


def two(places, shape=(False, False), side=9.0):
    """Return two links 0-1 and 2-3 between four places."""
    places = np.array(places, dtype=float)
    length = np.linalg.norm(places[[1, 3]] - places[[0, 2]], axis=1)
    links = pm.Links([0, 2], [1, 3], np.zeros((2, 2)), length, shape)
    return pm.Packing(places, np.full(4, 0.5), pm.Box.cubic(side, 2), links)


def test_a_link_that_ends_on_another_crosses_it_and_a_parallel_one_does_not():
    assert len(pm.crossing_links(two([[0, 0], [2, 0], [1, 0], [1, 1]]))) == 1
    assert len(pm.crossing_links(two([[0, 0], [2, 0], [1, 0], [3, 0]]))) == 0


def test_links_that_hold_a_shape_may_be_crossed():
    places = [[0, 0], [1, 1], [0, 1], [1, 0]]
    assert len(pm.crossing_links(two(places))) == 1
    assert len(pm.crossing_links(two(places, (True, False)))) == 0


def test_links_that_share_a_bead_do_not_cross_but_its_image_may_be_crossed():
    box = pm.Box.cubic(2.0, 2)
    places = [[0.0, 0.0], [1.0, 0.0], [1.5, 1.0]]
    length = [1.0, math.hypot(0.5, 1.0)]
    corner = pm.Packing(places, [0.1] * 3, box, pm.Links([0, 1], [1, 2], np.zeros((2, 2)), length))
    assert len(pm.crossing_links(corner)) == 0
    # the second link runs from bead 1 down-left, through the image of the first link one box below
    vector = np.array([-0.5, 1.0]) + [0.0, -4.0]
    through = pm.Links([0, 1], [1, 2], [[0, 0], [-1, -2]], [1.0, np.linalg.norm(vector + [-1.0, 0.0])])
    found = pm.crossing_links(corner.replace(links=through))
    assert len(found) == len(list_crossings(corner.replace(links=through))) == 1


@settings(max_examples=300, deadline=None)
@given(st.integers(0, 2**32), st.floats(0.1, 4.0))
def test_two_crossing_links_have_two_ends_at_most_their_length_over_sqrt2_apart(seed, length):
    rng = np.random.default_rng(seed)
    turn = rng.random(2) * 2 * np.pi
    along = length * np.column_stack([np.cos(turn), np.sin(turn)])
    middle = rng.uniform(0, length, (2, 2)) * [[0, 0], [1, 1]]
    packing = two(np.concatenate([middle - along / 2, middle + along / 2])[[0, 2, 1, 3]], side=20.0)
    if len(pm.crossing_links(packing)):
        ends = packing.position_nd
        apart = np.linalg.norm(ends[:2, None] - ends[None, 2:], axis=-1)
        assert apart.min() <= length / math.sqrt(2) * (1 + 1e-12)


def test_two_links_at_right_angles_through_their_middles_reach_the_bound():
    packing = two([[-0.5, 0], [0.5, 0], [0, -0.5], [0, 0.5]])
    assert len(pm.crossing_links(packing)) == 1
    assert np.linalg.norm(packing.position_nd[0] - packing.position_nd[2]) == pytest.approx(1 / math.sqrt(2), rel=1e-15)


def test_nothing_crosses_without_links_or_with_links_that_hold_shapes_only():
    packing = two([[0, 0], [1, 1], [0, 1], [1, 0]], (True, True))
    assert len(pm.crossing_links(packing)) == 0
    assert len(pm.crossing_links(packing.replace(links=None))) == 0


def test_links_in_three_dimensions_are_refused():
    packing = pm.Packing(np.eye(3), [0.1] * 3, pm.Box.cubic(4.0, 3), pm.Links([0], [1], [[0] * 3], [math.sqrt(2)]))
    with pytest.raises(ValueError, match="^packing must have two dimensions for links to cross, got 3"):
        pm.crossing_links(packing)


def test_a_link_that_jumps_over_another_one_is_seen_to_pass_through_it():
    links = pm.Links([0, 2], [1, 3], [[0, 0], [0, 0]], [1.0, 1.0])
    before = pm.Packing([[1, 1], [2, 1], [1.2, 1.3], [2.2, 1.3]], [0.5] * 4, pm.Box.cubic(6.0, 2), links)
    after = before.replace(position_nd=before.position_nd + [[0, 0], [0, 0], [0, -0.6], [0, -0.6]])
    aside = before.replace(position_nd=before.position_nd + [[0, 0], [0, 0], [0, 0.6], [0, 0.6]])
    assert len(pm.crossing_links(before)) == len(pm.crossing_links(after)) == 0
    assert swept_links(before, after, near_links(before, 1.0)).tolist() == [True]
    assert not swept_links(before, aside, near_links(before, 1.0)).any()


@pytest.mark.parametrize("side", [1.0, -1.0])
@pytest.mark.parametrize("turned", [(False, False), (True, False), (False, True), (True, True)])
@pytest.mark.parametrize("first", [0, 1])
def test_a_link_that_is_pushed_endwise_onto_another_sweeps_it_from_either_side(side, turned, first):
    """No link turns on the way, so the quadratic in time is linear: one of its coefficients is zero exactly."""
    ends = np.array([[[2.0, 3.0], [3.0, 3.0]], [[2.5, 3.0 + 0.3 * side], [2.5, 3.0 + 1.3 * side]]])
    ends = np.array([one[::-1] if back else one for one, back in zip(ends, turned, strict=True)])
    moves = np.array([[0.0, 0.0], [0.0, -0.5 * side]])
    order = [first, 1 - first]
    links = pm.Links([0, 2], [1, 3], [[0, 0], [0, 0]], [1.0, 1.0])
    before = pm.Packing(ends[order].reshape(4, 2), [0.1] * 4, pm.Box.cubic(6.0, 2), links)
    near = near_links(before, 1.0)
    for part, swept in ((1.0, True), (0.5, False), (-1.0, False)):
        move = np.repeat(part * moves[order], 2, axis=0)
        assert swept_links(before, before.replace(position_nd=before.position_nd + move), near).tolist() == [swept]


def test_links_swept_through_are_those_whose_ends_pass_each_other_in_small_steps():
    """An independent look: which pairs change how they cross between any two of many small steps."""
    rng = np.random.default_rng(3)
    links = pm.Links(np.arange(0, 20, 2), np.arange(1, 20, 2), np.zeros((10, 2), int), np.ones(10))
    for _ in range(20):
        start = 4.0 * rng.random((20, 2))
        end = start + 0.8 * rng.standard_normal((20, 2))
        before = pm.Packing(start, np.full(20, 0.1), pm.Box.cubic(30.0, 2), links)
        near = near_links(before, 6.0)
        swept = swept_links(before, before.replace(position_nd=end), near)
        named = set(zip(near.first_c[swept].tolist(), near.second_c[swept].tolist(), strict=True))
        seen, crossing = set(), None
        for t in np.linspace(0.0, 1.0, 401):
            found = pm.crossing_links(before.replace(position_nd=(1.0 - t) * start + t * end))
            now = set(zip(found.first_c.tolist(), found.second_c.tolist(), strict=True))
            seen |= now if crossing is None else now ^ crossing
            crossing = now if crossing is None else crossing | now
        start_pairs = pm.crossing_links(before)
        at_start = set(zip(start_pairs.first_c.tolist(), start_pairs.second_c.tolist(), strict=True))
        # what crosses for less than a step may be missed by the small steps, and by them alone
        assert seen - at_start <= named
