"""Facts about the cell list: it finds what listing every pair and image finds, with little work."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import packmech as pm
from packmech.contacts import candidate_pairs, cells, network


@settings(max_examples=150, deadline=None)
@given(st.integers(0, 2**32), st.sampled_from([(1.0, 0.0), (1.3, 0.0), (1.0, 0.4)]))
def test_cell_list_finds_what_listing_every_pair_and_image_finds(list_pairs, difficult_packing, as_list, seed, limit):
    packing = difficult_packing(seed, work=2e5)
    scale, skin = limit
    found = candidate_pairs(packing.position_nd, packing.radius_n, packing.box, scale=scale, skin=skin)
    assert as_list(found) == list_pairs(packing, scale, skin)


def test_pairs_across_every_face_edge_and_corner_are_found_at_any_number_of_cells(list_pairs, as_list):
    # one particle at the corner of the cell and one anywhere: box sides from one to nine cells
    for side in np.linspace(1.0, 9.0, 17):
        packing = pm.Packing([[1e-16, 1e-16], [side - 1e-9, side / 2], [side / 2, 0]], [0.5] * 3, pm.Box.cubic(side, 2))
        found = candidate_pairs(packing.position_nd, packing.radius_n, packing.box)
        assert as_list(found) == list_pairs(packing)


class Counting:
    """An array that counts how often one of its entries is read."""

    def __init__(self, array):
        self.array, self.reads = array, 0

    def __getitem__(self, index):
        self.reads += 1
        return self.array[index]


def pairs_tried(packing, monkeypatch):
    """Return how many pairs the search computes a distance for: each reads one entry of the sorted particle list."""
    counters = []
    fill = cells._fill

    def counting_fill(*arguments):
        first, start, order, placed = fill(*arguments)
        counters.append(Counting(order))
        return first, start, counters[-1], placed

    with monkeypatch.context() as patch:
        patch.setattr(network, "_pairs_as_given", network._pairs_as_given.py_func)
        patch.setattr(cells, "_fill", counting_fill)
        found = candidate_pairs(packing.position_nd, packing.radius_n, packing.box)
    return max(counter.reads for counter in counters), len(found.i_c)


def mixture(particles, ratio, dimension, seed=1):
    """Return a random packing at fraction 0.8 with one particle in a hundred `ratio` times larger."""
    sizes = pm.Mixture(ratios=(1.0, ratio), fractions=(99, 1))
    return pm.random_packing(particles, dimension=dimension, packing_fraction=0.8, sizes=sizes, seed=seed)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("ratio", [10.0, 100.0, 1000.0])
def test_two_sizes_far_apart_cost_no_more_per_particle_than_equal_ones(monkeypatch, dimension, ratio):
    equal, unequal = (pairs_tried(mixture(1600, r, dimension), monkeypatch)[0] for r in (1.0, ratio))
    assert unequal < 1.5 * equal


@pytest.mark.parametrize("ratio", [1.0, 100.0])
def test_work_per_particle_does_not_grow_with_their_number(monkeypatch, ratio):
    few, many = (pairs_tried(mixture(n, ratio, 2), monkeypatch)[0] / n for n in (400, 1600))
    # with all pairs, four times the particles would make four times the work for each
    assert many < 1.5 * few


def test_equal_discs_try_a_small_multiple_of_the_pairs_that_touch(monkeypatch):
    # cells as wide as a diameter: nine of them hold 9/pi times the discs in the circle of contact
    tried, found = pairs_tried(mixture(1600, 1.0, 2), monkeypatch)
    assert found <= tried < 10 * found
