"""The factorization by fronts against dense matrices."""

from __future__ import annotations

import numpy as np
import pytest

from packmech.mechanics.dissection import dissect, graph_of
from packmech.mechanics.front_solve import solve_fronts
from packmech.mechanics.fronts import factor_fronts

UNIT = 0.7
NO_SPACE = (np.empty(1),) * 4


def _system(particles, dimension, seed, shift, place=None, row=5):
    """Return a network of random places, or the given ones, with links, as the kernels take it, and a dense matrix."""
    rng = np.random.default_rng(seed)
    if place is None:
        place = rng.uniform(size=(particles, dimension)) * particles ** (1.0 / dimension)
    gap = np.linalg.norm(place[:, None] - place[None], axis=2)
    i, j = np.nonzero(np.triu(gap < 1.6, 1))
    normal = (place[j] - place[i]) / gap[i, j][:, None]
    block = normal[:, :, None] * normal[:, None, :] + 0.1 * np.eye(dimension)
    diagonal = np.tile(shift * np.eye(dimension), (particles, 1, 1))
    np.add.at(diagonal, i, block)
    np.add.at(diagonal, j, block)
    # links along the order of the particles, wherever these stand: some are long
    link_i = np.flatnonzero(np.arange(particles - 1) % row < max(row - 2, 3))
    link_j = link_i + 1
    toward = place[link_j] - place[link_i]
    toward /= np.linalg.norm(toward, axis=1)[:, None]
    size, count = particles * dimension, len(link_i)
    dense = np.zeros((size + count, size + count))
    for n in range(particles):
        dense[n * dimension : (n + 1) * dimension, n * dimension : (n + 1) * dimension] = diagonal[n]
    for c in range(len(i)):
        a, b = (slice(k * dimension, (k + 1) * dimension) for k in (i[c], j[c]))
        dense[a, b] -= block[c]
        dense[b, a] -= block[c].T
    for k in range(count):
        for end, sign in ((link_i[k], -1.0), (link_j[k], 1.0)):
            dense[size + k, end * dimension : (end + 1) * dimension] = sign * UNIT * toward[k]
    gradient = dense[size:, :size] / UNIT
    dense[:size, size:] = dense[size:, :size].T
    dense[:size, :size] += UNIT * gradient.T @ gradient
    graph = graph_of(np.concatenate([i, link_i]), np.concatenate([j, link_j]), particles)
    start, _, entry = graph_of(link_i, link_j, particles)
    pinned = particles // 2
    kept = np.ones(len(dense), dtype=bool)
    kept[pinned * dimension : (pinned + 1) * dimension] = False

    def factor(leaf, trials):
        tree = dissect(place, graph[0], graph[1], pinned, leaf, trials)
        return factor_fronts(
            tree, graph, block, diagonal, link_i, link_j, (start, entry), toward, UNIT, pinned, NO_SPACE
        )[:3]

    return factor, dense[np.ix_(kept, kept)], kept


@pytest.mark.parametrize(("particles", "dimension"), [(3, 2), (40, 2), (400, 2), (40, 3), (400, 3)])
@pytest.mark.parametrize(("leaf", "trials"), [(1, 1), (8, 9)])
def test_solutions_by_fronts_are_those_of_the_dense_matrix(particles, dimension, leaf, trials):
    factor, dense, kept = _system(particles, dimension, seed=1, shift=0.05)
    failed, _, fronts = factor(leaf, trials)
    right = np.zeros((4, len(kept)))
    right[:, kept] = np.random.default_rng(2).normal(size=(4, kept.sum()))
    found = solve_fronts(fronts, right)[:, kept]
    assert not failed
    assert np.abs(found - np.linalg.solve(dense, right[:, kept].T).T).max() < 1e-9 * np.abs(found).max()


@pytest.mark.parametrize("bend", [0.0, 1e-6, 1e-2, 0.3])
def test_straight_chains_through_many_branches_are_solved_as_by_the_dense_matrix(bend):
    rng = np.random.default_rng(4)
    place = np.stack(np.meshgrid(np.arange(20.0), np.arange(15.0)), axis=-1).reshape(-1, 2)
    place = place + bend * rng.normal(size=place.shape)
    factor, dense, kept = _system(300, 2, seed=1, shift=0.05, place=place, row=20)
    failed, negative, fronts = factor(8, 1)
    right = np.zeros((3, len(kept)))
    right[:, kept] = rng.normal(size=(3, kept.sum()))
    expected = np.linalg.solve(dense, right[:, kept].T).T
    assert not failed
    assert np.abs(solve_fronts(fronts, right)[:, kept] - expected).max() < 1e-9 * np.abs(expected).max()
    assert negative == np.count_nonzero(np.linalg.eigvalsh(dense) < 0.0)


@pytest.mark.parametrize("shift", [0.05, -0.3, -1.0])
@pytest.mark.parametrize("dimension", [2, 3])
def test_signs_of_pivots_by_fronts_are_those_of_the_eigenvalues(dimension, shift):
    factor, dense, _ = _system(120, dimension, seed=3, shift=shift)
    failed, negative, _ = factor(8, 1)
    assert not failed
    assert negative == np.count_nonzero(np.linalg.eigvalsh(dense) < 0.0)


def test_two_links_of_one_pair_are_seen_to_depend_on_each_other():
    none = np.zeros(0, dtype=np.int64)
    link = np.array([0, 0]), np.array([1, 1])
    graph = graph_of(*link, 3)
    tree = dissect(np.eye(3)[:, :2], graph[0], graph[1], 2, 1, 1)
    stiff = np.tile(np.eye(2), (3, 1, 1))
    normal = np.array([[1.0, 0.0], [1.0, 0.0]])
    failed, _, _, _ = factor_fronts(
        tree, graph, np.zeros((len(none), 2, 2)), stiff, *link, (graph[0], graph[2]), normal, 1.0, 2, NO_SPACE
    )
    assert failed


@pytest.mark.parametrize("dimension", [2, 3])
def test_every_particle_but_the_pinned_one_has_one_place_in_the_dissection(dimension):
    rng = np.random.default_rng(5)
    place = rng.uniform(size=(300, dimension))
    i, j = rng.integers(0, 300, size=(2, 900))
    start, neighbor, _ = graph_of(i, j, 300)
    member, begin, children = dissect(place, start, neighbor, 7, 4, 5)
    assert sorted(member.tolist()) == [n for n in range(300) if n != 7]
    assert begin[-1] == 299
    assert children.sum() == len(children) - 1


def test_no_edge_joins_two_branches_of_the_dissection():
    rng = np.random.default_rng(6)
    place = rng.uniform(size=(200, 2))
    gap = np.linalg.norm(place[:, None] - place[None], axis=2)
    i, j = np.nonzero(np.triu(gap < 0.12, 1))
    start, neighbor, _ = graph_of(i, j, 200)
    member, begin, children = dissect(place, start, neighbor, 0, 6, 3)
    # the nodes above each node, itself included
    parent, waiting = {}, []
    for t in range(len(children)):
        for _ in range(children[t]):
            parent[waiting.pop()] = t
        waiting.append(t)
    node = {int(member[m]): t for t in range(len(children)) for m in range(begin[t], begin[t + 1])}

    def above(t):
        line = {t}
        while t in parent:
            t = parent[t]
            line.add(t)
        return line

    for a, b in zip(i.tolist(), j.tolist(), strict=True):
        if a and b:
            assert node[a] in above(node[b]) or node[b] in above(node[a])
