"""Facts about the packing fraction of fused clusters: closed forms, sums over lines and points, and invariances."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import packmech as pm
from packmech.links import image_offsets

BALL = {2: math.pi, 3: 4.0 * math.pi / 3.0}


def fused(position_bd, radius_b, side=20.0):
    """Return one rigid cluster in a large box, and the volume that its packing fraction says."""
    cluster = pm.Cluster(position_bd, radius_b)
    place = np.asarray(position_bd, dtype=float) + side / 2
    links = pm.Links(*cluster.links.T, np.zeros((len(cluster.links), place.shape[1])), cluster.length_l)
    packing = pm.Packing(place, radius_b, pm.Box.cubic(side, place.shape[1]), links)
    return packing, pm.packing_fraction(packing) * packing.box.volume


def volume_of_union(packing, lines=300):
    """Return the volume of all particles' union from lines along the last axis, on a grid over the others."""
    offset, _ = image_offsets(packing.links, packing.particles)
    place = packing.position_nd + offset @ packing.box.lattice_dd.T
    radius, d = packing.radius_n, packing.dimension
    low, high = (place - radius[:, None]).min(axis=0)[:-1], (place + radius[:, None]).max(axis=0)[:-1]
    axes = [a + (b - a) * (np.arange(lines) + 0.5) / lines for a, b in zip(low, high, strict=True)]
    point = np.stack([axis.ravel() for axis in np.meshgrid(*axes, indexing="ij")], axis=1)
    room = radius**2 - ((point[:, None] - place[None, :, :-1]) ** 2).sum(axis=2)
    half = np.sqrt(np.maximum(room, 0.0))
    begin, end = place[:, -1] - half, place[:, -1] + half
    order = np.argsort(begin, axis=1)
    begin, end = np.take_along_axis(begin, order, 1), np.take_along_axis(end, order, 1)
    reached = np.maximum.accumulate(end, axis=1)
    before = np.concatenate([np.full((len(point), 1), -np.inf), reached[:, :-1]], axis=1)
    covered = np.maximum(0.0, end - np.maximum(begin, before)).sum()
    return covered * np.prod(high - low) / lines ** (d - 1)


def random_cluster(beads, dimension, seed, **sizes):
    rng = np.random.default_rng(seed)
    return fused(rng.random((beads, dimension)), rng.uniform(0.15, 0.5, beads), **sizes)


def test_two_discs_at_the_distance_of_their_radius_fill_four_pi_over_three_and_half_the_root_of_three():
    _, area = fused([[0.0, 0.0], [1.0, 0.0]], [1.0, 1.0])
    assert area == pytest.approx(4 * math.pi / 3 + math.sqrt(3) / 2, rel=1e-14)


def test_three_unit_discs_on_a_unit_triangle_share_a_reuleaux_triangle():
    # three circles less three lenses and the triangle of constant width that all three share
    lens, shared = 2 * math.pi / 3 - math.sqrt(3) / 2, (math.pi - math.sqrt(3)) / 2
    _, area = fused([[0.0, 0.0], [1.0, 0.0], [0.5, math.sqrt(0.75)]], [1.0, 1.0, 1.0])
    assert area == pytest.approx(3 * math.pi - 3 * lens + shared, rel=1e-14)


def test_three_discs_that_share_no_point_lose_their_three_lenses():
    side = 1.9
    half = math.acos(side / 2)
    lens = 2 * half - math.sin(2 * half)
    _, area = fused([[0.0, 0.0], [side, 0.0], [side / 2, side * math.sqrt(0.75)]], [1.0, 1.0, 1.0])
    assert area == pytest.approx(3 * math.pi - 3 * lens, rel=1e-14)


@pytest.mark.parametrize(("a", "b", "distance"), [(0.5, 0.5, 0.4), (0.5, 0.7, 0.9), (1.0, 0.3, 0.8)])
def test_two_spheres_lose_the_lens_of_their_caps(a, b, distance):
    # caps of height h of a sphere of radius r: pi h^2 (r - h/3)
    plane = (distance**2 + a**2 - b**2) / (2 * distance)
    cap = sum(math.pi * h**2 * (r - h / 3) for r, h in ((a, a - plane), (b, b - distance + plane)))
    _, volume = fused([[0.0, 0.0, 0.0], [0.0, 0.6 * distance, 0.8 * distance]], [a, b])
    assert volume == pytest.approx(4 * math.pi / 3 * (a**3 + b**3) - cap, rel=1e-14)


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_particle_inside_another_of_its_cluster_fills_nothing(dimension):
    place = np.zeros((3, dimension))
    place[1, 0], place[2, 1] = 0.3, -0.2
    _, volume = fused(place, [1.0, 0.6, 0.7])
    assert volume == pytest.approx(BALL[dimension], rel=1e-13)


@settings(max_examples=40, deadline=None)
@given(st.integers(2, 12), st.integers(0, 2**32))
def test_random_clusters_of_discs_fill_their_union(beads, seed):
    packing, area = random_cluster(beads, 2, seed)
    assert area == pytest.approx(volume_of_union(packing, 100_000), rel=3e-7)


@settings(max_examples=15, deadline=None)
@given(st.integers(2, 9), st.integers(0, 2**32))
def test_random_clusters_of_spheres_fill_their_union(beads, seed):
    packing, volume = random_cluster(beads, 3, seed)
    assert volume == pytest.approx(volume_of_union(packing), rel=3e-4)


@settings(max_examples=20, deadline=None)
@given(st.integers(3, 9), st.integers(0, 2**32))
def test_the_quadrature_of_spheres_errs_by_less_than_it_says(beads, seed):
    # the same slices in other directions are another quadrature
    rng = np.random.default_rng(seed)
    place, radius = rng.random((beads, 3)), rng.uniform(0.15, 0.5, beads)
    turned = [np.linalg.qr(rng.standard_normal((3, 3)))[0] for _ in range(3)]
    volume = [fused(place @ turn.T, radius)[1] for turn in turned]
    assert np.ptp(volume) < 2e-10 * BALL[3] * (radius**3).sum()


@settings(max_examples=20, deadline=None)
@given(st.integers(2, 8), st.sampled_from([2, 3]), st.integers(0, 2**32))
def test_packing_fraction_is_the_same_wrapped_moved_turned_reordered_and_in_other_units(beads, dimension, seed):
    rng = np.random.default_rng(seed)
    packing, volume = random_cluster(beads, dimension, seed)
    turn = np.linalg.qr(rng.standard_normal((dimension, dimension)))[0]
    moved = packing.replace(position_nd=packing.position_nd @ turn.T + rng.normal(size=dimension) * 30).wrapped()
    order = rng.permutation(beads)
    number = np.argsort(order)
    links = moved.links.numbered(number)
    mixed = pm.Packing(moved.position_nd[order], moved.radius_n[order], moved.box, links)
    scaled = pm.Packing(mixed.position_nd * 1e5, mixed.radius_n * 1e5, mixed.box.scaled(1e5), mixed.links.scaled(1e5))
    for other in (packing.wrapped(), moved, mixed, scaled):
        assert pm.packing_fraction(other) * packing.box.volume == pytest.approx(volume, rel=1e-9, abs=1e-13)


@pytest.mark.parametrize("dimension", [2, 3])
def test_clusters_that_only_touch_and_overlaps_of_different_clusters_count_in_full(dimension):
    packing = pm.cluster_packing(40, pm.Trimer(), dimension=dimension, packing_fraction=0.9, seed=1)
    sum_of_volumes = BALL[dimension] * (packing.radius_n**dimension).sum()
    assert len(pm.find_contacts(packing)) > 10
    assert pm.packing_fraction(packing) == sum_of_volumes / packing.box.volume


def test_a_flexible_chain_loses_the_lenses_of_its_links_however_it_lies():
    # beads two apart may overlap as contacts do: that counts in full
    beads, distance = 12, 0.7
    half = math.acos(distance)
    lens = 0.25 * (2 * half - math.sin(2 * half))
    for seed, form in ((1, "open"), (2, "ring"), (3, "wound")):
        packing = pm.chain_packing(
            1, beads, dimension=2, packing_fraction=0.4, link_length=distance, form=form, seed=seed, crossing="allowed",
            tries=5000,
        )  # fmt: skip
        area = beads * math.pi / 4 - (beads - (form == "open")) * lens
        assert pm.packing_fraction(packing) * packing.box.volume == pytest.approx(area, rel=1e-13)
        assert pm.packing_fraction(packing) == pytest.approx(0.4, rel=1e-13)


def test_a_chain_around_the_box_with_held_angles_loses_what_three_in_a_row_share_once():
    # a zigzag of equal discs around the box: every disc overlaps two neighbors on either side
    count, step, height = 6, 0.5, 0.3
    box = pm.Box([[count * step, 0.0], [0.0, 10.0]])
    place = np.stack([step * np.arange(count), 5.0 + height * (np.arange(count) % 2)], axis=1)
    bonds = [(k, k + 1) for k in range(count)] + [(k, k + 2) for k in range(count)]
    i, j = np.array(bonds).T
    vector = np.stack([step * (j - i), height * ((j % 2) - (i % 2))], axis=1)
    image = np.stack([j // count, 0 * j], axis=1)
    links = pm.Links(i, j % count, image, np.linalg.norm(vector, axis=1))
    packing = pm.Packing(place, np.full(count, 0.55), box, links)
    # far along a straight zigzag every disc adds what the one before it left free
    long = np.stack([step * np.arange(60), height * (np.arange(60) % 2)], axis=1)
    more = fused(long, np.full(60, 0.55), side=100.0)[1] - fused(long[:54], np.full(54, 0.55), side=100.0)[1]
    assert pm.packing_fraction(packing) * box.volume == pytest.approx(more, rel=1e-10)


@pytest.mark.parametrize(("dimension", "low", "high"), [(2, 0.85, 0.92), (3, 0.60, 0.74)])
def test_fused_dimers_jam_at_a_density_that_discs_and_spheres_can_have(dimension, low, high):
    # aspect 1.4: centers at 0.4 diameters; the sum of all areas over the box would be 1.18
    packing = pm.cluster_packing(24, pm.Dimer(0.4), dimension=dimension, packing_fraction=0.3, seed=2)
    run = pm.jam(pm.Scene(packing, (pm.Repulsion(),)), strain="isotropic", pressure=1e-5)
    assert run.ok and low < run.report["packing_fraction"] < high
    assert run.report["packing_fraction"] == pm.packing_fraction(run.packing)


def test_a_batch_of_fused_trimers_reports_the_same_packing_fraction():
    packing = pm.cluster_packing(6, pm.Trimer(0.7), dimension=2, packing_fraction=0.5, seed=1)
    batch = pm.QuenchBatch(pm.Scene(packing, (pm.Repulsion(),)))
    batch.step([0.1], [0.05])
    assert batch.packing_fraction_b[0] == pytest.approx(0.6, rel=1e-12)
    assert pm.packing_fraction(batch.packing(0)) == pytest.approx(0.6, rel=1e-12)


@pytest.mark.parametrize("dimension", [2, 3])
def test_fused_clusters_are_scattered_at_the_packing_fraction_asked_for(dimension):
    packing = pm.cluster_packing(8, pm.Trimer(0.6), dimension=dimension, packing_fraction=0.2, seed=1)
    again = pm.scattered_packing(packing, packing_fraction=0.3, seed=2)
    assert pm.packing_fraction(again) == pytest.approx(0.3, rel=1e-10)
