"""Facts about rigid clusters: frameworks with known answers, counting by the pebble game, exact ranks, proofs."""

import itertools
from fractions import Fraction

import numpy as np
import pytest

import packmech as pm
from packmech.constraints.factor import link_pairs
from packmech.contacts.network import pair_contacts

HARD = pm.Repulsion(pm.LinearSpring(1.0))
TETRAHEDRON = [(i, j) for j in range(4) for i in range(j)]


def framework(place, pairs, side=20.0):
    """Return a packing of points with rigid links, far from the edges of its box."""
    place = np.asarray(place, dtype=float) + 0.4 * side
    length = [float(np.linalg.norm(place[i] - place[j])) for i, j in pairs]
    d = place.shape[1]
    links = pm.Links(*zip(*pairs, strict=True), np.zeros((len(pairs), d), dtype=int), length)
    return pm.Packing(place, np.full(len(place), 0.05), pm.Box.cubic(side, d), links)


def members(found):
    """Return the particles of all clusters."""
    return [found.particles_of(k).tolist() for k in range(len(found))]


def generic(count, d, seed=0):
    return np.random.default_rng(seed).normal(size=(count, d))


def exact_rank(place, pairs):
    """Return the rank of the rigidity matrix of whole-number or binary places, by elimination with fractions."""
    d = len(place[0])
    rows = []
    for i, j in pairs:
        row = [Fraction(0)] * (d * len(place))
        for a in range(d):
            row[d * i + a], row[d * j + a] = (s * (Fraction(place[j][a]) - Fraction(place[i][a])) for s in (-1, 1))
        rows.append(row)
    return len(reduced(rows))


def reduced(rows):
    """Return the independent rows, reduced, by the column that each alone has, by elimination with fractions."""
    found = {}
    for row in rows:
        for column, pivot in found.items():
            if row[column]:
                row = [a - row[column] * b for a, b in zip(row, pivot, strict=True)]
        first = next((k for k, one in enumerate(row) if one), None)
        if first is None:
            continue
        row = [one / row[first] for one in row]
        for column, other in found.items():
            if other[first]:
                found[column] = [a - other[first] * b for a, b in zip(other, row, strict=True)]
        found[first] = row
    return found


def exact_clusters(found):
    """Return the rank of rows with friction and the cluster of each contact, from all motions, as fractions.

    Places are rounded to 1/1024; contact points divide the distance as the radii, so that a rotation slips nowhere.
    """
    packing, contacts = found.packing, found.contacts
    n, count = packing.particles, len(contacts)
    near = [[Fraction(round(1024 * a), 1024) for a in one] for one in packing.position_nd.tolist()]
    side = Fraction(round(1024 * packing.box.lattice_dd[0, 0]), 1024)
    radius = [Fraction(r) for r in packing.radius_n.tolist()]
    ends = list(zip(contacts.i_c.tolist(), contacts.j_c.tolist(), strict=True))
    vector = [
        [b + m * side - a for a, b, m in zip(near[i], near[j], image, strict=True)]
        for (i, j), image in zip(ends, contacts.pairs.image_cd.tolist(), strict=True)
    ]
    rows, spins = [], {n for pair, slides in zip(ends, found.sliding_c, strict=True) if not slides for n in pair}
    for (i, j), (x, y), slides in zip(ends, vector, found.sliding_c, strict=True):
        row = [Fraction(0)] * (3 * n)
        row[3 * i : 3 * i + 2], row[3 * j : 3 * j + 2] = [-x, -y], [x, y]
        rows.append(row)
        if not slides:
            row = [Fraction(0)] * (3 * n)
            arm = (x * x + y * y) / (radius[i] + radius[j])
            row[3 * i : 3 * i + 3], row[3 * j : 3 * j + 3] = [y, -x, -arm * radius[i]], [-y, x, -arm * radius[j]]
            rows.append(row)
    pivots = reduced(rows)
    motions = []
    for free in set(range(3 * n)) - set(pivots):
        motions.append([Fraction(0)] * (3 * n))
        motions[-1][free] = Fraction(1)
        for column, row in pivots.items():
            motions[-1][column] = -row[free]
    rate = [
        tuple((x * (u[3 * j + 1] - u[3 * i + 1]) - y * (u[3 * j] - u[3 * i])) / (x * x + y * y) for u in motions)
        for (i, j), (x, y) in zip(ends, vector, strict=True)
    ]
    spin = {k: tuple(u[3 * k + 2] for u in motions) for k in spins}
    # contacts, then discs that turn, are one where they share a particle and a rate
    number = np.arange(count + n)
    between = [i in spins and j in spins for i, j in ends]
    whole = [
        not both or rate[c] == spin[i] == spin[j] for c, ((i, j), both) in enumerate(zip(ends, between, strict=True))
    ]
    parts = [(c, k, rate[c]) for c in range(count) if whole[c] for k in ends[c]] + [
        (count + k, k, spin[k]) for k in spins
    ]
    for (a, k, one), (b, m, other) in itertools.combinations(parts, 2):
        if k == m and one == other:
            number[number == number[b]] = number[a]
    return len(pivots), np.where(whole, number[:count], -1)


def diluted(length, share, rng, periodic):
    """Return a triangular lattice of displaced points with that share of its bonds, and these as contacts."""
    number = np.arange(length * length)
    x, y = number % length, number // length
    ends = []
    for dx, dy in ((1, 0), (0, 1), (-1, 1)):
        image = np.stack([(x + dx) // length, (y + dy) // length], axis=1)
        ends.append((number, (x + dx) % length + (y + dy) % length * length, image))
    i, j, image = (np.concatenate(one) for one in zip(*ends, strict=True))
    keep = rng.random(len(i)) < share
    if not periodic:
        keep &= ~image.any(axis=1)
    i, j, image = i[keep], j[keep], image[keep]
    turned = i > j
    i, j, image = np.where(turned, j, i), np.where(turned, i, j), np.where(turned[:, None], -image, image)
    order = np.lexsort((*image.T[::-1], j, i))
    place = np.stack([x + 0.5 * y, y * 0.75**0.5], axis=1) + rng.uniform(-0.15, 0.15, (length**2, 2))
    lattice = length * np.array([[1.0, 0.5], [0.0, 0.75**0.5]])
    packing = pm.Packing(place, np.full(length**2, 0.5), pm.Box(lattice))
    return packing, pair_contacts(packing, i[order], j[order], image[order].astype(np.int64))


def same_partition(one, other):
    """Whether two numberings put the same contacts together."""
    pairs = len(set(zip(one.tolist(), other.tolist(), strict=True)))
    return pairs == len(set(one.tolist())) == len(set(other.tolist())) and np.array_equal(one < 0, other < 0)


def agree(one, other):
    """Whether two methods found the same clusters, over-constrained contacts and ranks."""
    return (
        same_partition(one.cluster_c, other.cluster_c)
        and np.array_equal(one.overconstrained_c, other.overconstrained_c)
        and np.array_equal(one.size_k, other.size_k)
        and np.array_equal(one.winding_kd.sum(axis=0), other.winding_kd.sum(axis=0))
    )


def test_a_triangle_is_one_cluster_and_a_square_four_until_it_has_a_diagonal():
    triangle = pm.rigid_clusters(framework(generic(3, 2), [(0, 1), (0, 2), (1, 2)]))
    assert members(triangle) == [[0, 1, 2]] and triangle.floppy_modes == 1
    square, sides = [[0, 0], [1, 0], [1, 1], [0, 1]], [(0, 1), (1, 2), (2, 3), (0, 3)]
    assert pm.rigid_clusters(framework(square, sides)).size_k.tolist() == [2, 2, 2, 2]
    braced = pm.rigid_clusters(framework(square, [*sides, (0, 2)]))
    assert members(braced) == [[0, 1, 2, 3]] and not braced.overconstrained_l.any()
    both = pm.rigid_clusters(framework(square, [*sides, (0, 2), (1, 3)]))
    assert both.overconstrained_l.all() and both.states_of_self_stress == 1


def test_triangles_turn_about_a_particle_that_they_share_and_not_about_a_side():
    pairs = [(0, 1), (0, 2), (1, 2), (0, 3), (0, 4), (3, 4)]
    hinge = pm.rigid_clusters(framework(generic(5, 2), pairs))
    assert members(hinge) == [[0, 1, 2], [0, 3, 4]]
    assert hinge.pivots_n.tolist() == [True, False, False, False, False]
    assert hinge.between > 1e-3 and hinge.within < 1e-12 and hinge.certain
    side = pm.rigid_clusters(framework(generic(4, 2), [(0, 1), (0, 2), (1, 2), (0, 3), (1, 3)]))
    assert members(side) == [[0, 1, 2, 3]]


def test_tetrahedra_turn_about_an_edge_that_they_share_and_not_about_a_face():
    edge = pm.rigid_clusters(framework(generic(6, 3), [*TETRAHEDRON, (0, 4), (1, 4), (0, 5), (1, 5), (4, 5)]))
    assert members(edge) == [[0, 1, 2, 3], [0, 1, 4, 5]]
    # six rigid motions but for the translations, and one about the edge
    assert edge.floppy_modes == 3 + 1 and edge.self_held_k.all()
    face = pm.rigid_clusters(framework(generic(5, 3), [*TETRAHEDRON, (0, 4), (1, 4), (2, 4)]))
    assert members(face) == [[0, 1, 2, 3, 4]] and face.rigid_rank_k.tolist() == [3 * 5 - 6]


def test_an_octahedron_is_rigid_with_as_many_bars_as_it_needs():
    """Cauchy's theorem: triangulated convex surfaces are rigid, with 3 n - 6 edges."""
    corners = np.concatenate([np.eye(3), -np.eye(3)]) + 0.1 * generic(6, 3)
    pairs = [(i, j) for j in range(6) for i in range(j) if j != i + 3]
    found = pm.rigid_clusters(framework(corners, pairs))
    assert found.size_k.tolist() == [6] and found.rank == 12 and found.states_of_self_stress == 0


def test_the_double_banana_counts_as_rigid_and_is_two_clusters_about_its_tips():
    """3 n - 6 = 18 bars on 8 particles, and yet it turns about the line between the tips, which carries stress."""
    banana = [
        pair
        for a, b, c in ((2, 3, 4), (5, 6, 7))
        for pair in [(0, a), (0, b), (0, c), (1, a), (1, b), (1, c), (a, b), (a, c), (b, c)]
    ]
    place = [[0, 0, -30], [1, 2, 31], [9, 1, 2], [-4, 8, -1], [-5, -9, 3], [12, -2, 5], [-3, 11, -7], [-8, -6, 1]]
    assert len(banana) == 3 * len(place) - 6 == exact_rank(place, sorted(banana)) + 1
    found = pm.rigid_clusters(framework(place, sorted(banana), side=200.0))
    assert members(found) == [[0, 1, 2, 3, 4], [0, 1, 5, 6, 7]]
    assert found.rank == 17 and found.overconstrained_l.all() and found.self_held_k.all()


def test_clusters_in_space_are_the_largest_sets_that_keep_all_their_distances():
    """Frameworks drawn at random: distances that no motion of the dense null space changes."""
    for seed in range(40):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(5, 11))
        place, whole = rng.normal(size=(n, 3)), list(itertools.combinations(range(n), 2))
        count = int(rng.integers(n, min(len(whole), 3 * n - 4) + 1))
        packing = framework(place, [whole[k] for k in np.sort(rng.permutation(len(whole))[:count])])
        matrix = pm.rigidity_matrix(packing.replace(links=None), "none", contacts=link_pairs(packing)).toarray()
        value, right = np.linalg.svd(matrix)[1:]
        motion = right[np.count_nonzero(value > 1e-9) :].reshape(-1, n, 3)
        keeps = np.eye(n, dtype=bool)
        for i, j in whole:
            change = ((motion[:, j] - motion[:, i]) * (place[j] - place[i])).sum(axis=1)
            keeps[i, j] = keeps[j, i] = np.abs(change).max() < 1e-9
        found = pm.rigid_clusters(packing)
        for inside in members(found):
            assert keeps[np.ix_(inside, inside)].all(), seed
            assert not keeps[:, inside].all(axis=1)[np.setdiff1d(np.arange(n), inside)].any(), seed
        for i, j in zip(packing.links.i_l, packing.links.j_l, strict=True):
            assert any({i, j} <= set(inside) for inside in members(found)), seed


def test_counting_and_null_space_differ_where_places_are_special_and_exact_ranks_say_which_is_right():
    """Two triples, each of one joined to each of the other, are floppy if and only if the six lie on a conic."""
    pairs = [(i, j) for i in range(3) for j in range(3, 6)]
    # rational points of a circle of radius 65
    conic = [[63, 16], [-33, 56], [-16, -63], [56, 33], [-60, 25], [39, -52]]
    aside = [*conic[:5], [39, -40]]
    for place, rank in ((conic, 8), (aside, 9)):
        assert exact_rank(place, pairs) == rank
        packing = framework(place, pairs, side=300.0)
        found, counted = pm.rigid_clusters(packing), pm.rigid_clusters(packing, method="pebble game")
        assert found.rank == rank and counted.rank == 9
        assert counted.size_k.tolist() == [6]
        assert found.size_k.tolist() == ([6] if rank == 9 else [2] * 9)


def test_discs_of_a_square_grid_turn_against_each_other_like_gears_where_counting_says_that_they_are_rigid():
    """9 discs with 12 contacts that stick: 24 rows and 27 - 3 motions; neighbors can turn in opposite senses."""
    place = 4.0 + np.array([[x, y] for y in range(3) for x in range(3)]) * 0.999
    packing = pm.Packing(place, np.full(9, 0.5), pm.Box.cubic(12.0, 2))
    scene = pm.Scene(packing, (HARD, pm.Friction(0.5)))
    found, counted = pm.rigid_clusters(scene), pm.rigid_clusters(scene, method="pebble game")
    assert counted.size_k.tolist() == [9] and counted.rank == 24
    assert len(found) == 0 and found.rank == 23 and (found.cluster_c == -1).all()
    # three of a triangle cannot, nor can any where rolling is resisted
    three = framework([[0, 0], [0.999, 0], [0.5, 0.86]], [(0, 1)]).replace(links=None, radius_n=np.full(3, 0.5))
    assert pm.rigid_clusters(pm.Scene(three, (HARD, pm.Friction(0.5)))).size_k.tolist() == [3]
    rolling = pm.rigid_clusters(scene.replace(effects=(*scene.effects, pm.RollingResistance(0.3, 0.5))))
    assert rolling.size_k.tolist() == [9]


@pytest.mark.parametrize("seed", range(4))
def test_clusters_of_diluted_lattices_are_those_that_counting_finds(seed):
    """Open ones and periodic ones, whose clusters wind around the box, in places of no symmetry."""
    rng = np.random.default_rng(seed)
    for k in range(20):
        packing, contacts = diluted(int(rng.integers(3, 11)), rng.uniform(0.4, 0.95), rng, bool(k % 2))
        found = pm.rigid_clusters(packing, contacts=contacts)
        counted = pm.rigid_clusters(packing, contacts=contacts, method="pebble game")
        assert agree(found, counted), (seed, k)
        assert not found.certain or found.rank == counted.rank
        assert found.self_held_k.all() and np.array_equal(found.own_rank_k, counted.own_rank_k)
        assert found.states_of_self_stress == found.rows - found.rank


def test_over_constrained_contacts_are_the_rows_of_dense_states_of_self_stress():
    packing, contacts = diluted(8, 0.75, np.random.default_rng(4), True)
    dense = pm.states_of_self_stress(packing, contacts=contacts, method="dense")
    found = pm.rigid_clusters(packing, contacts=contacts)
    assert np.array_equal((dense.force_ck**2).sum(axis=1) > 1e-16, found.overconstrained_c)
    assert found.rank == dense.rank and found.states_of_self_stress == dense.count
    assert found.floppy_modes == pm.floppy_modes(packing, contacts=contacts, method="dense").count


def test_the_smallest_singular_value_of_a_cluster_is_that_of_its_own_rows():
    packing, contacts = diluted(7, 0.7, np.random.default_rng(9), False)
    found = pm.rigid_clusters(packing, contacts=contacts)
    matrix = pm.rigidity_matrix(packing, "none", contacts=contacts)
    bound = np.sqrt(float(abs(matrix.T @ matrix).sum(axis=0).max()))
    inside = found.particles_of(0)
    columns = np.stack([2 * inside, 2 * inside + 1], axis=1).ravel()
    own = np.linalg.svd(matrix[found.cluster_c == 0][:, columns].toarray(), compute_uv=False)
    # inverse iteration comes from above
    assert -1e-9 < found.smallest_k[0] * bound / own[2 * len(inside) - 4] - 1.0 < 1e-2


def frictional(seed, particles):
    """Return a packing with friction at rest; of one in two some contacts slide, with a little less friction."""
    rng = np.random.default_rng(seed)
    fraction, mu = rng.uniform(0.78, 0.88), (0.05, 0.2, 0.5, 1.0)[seed % 4]
    packing = pm.random_packing(
        particles, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=fraction, seed=seed
    )
    damped = (HARD, pm.Friction(mu, 0.7, 0.3), pm.ContactDamping(0.3), pm.BackgroundDamping(0.05))
    rest = pm.simulate(pm.Scene(packing, damped), steps=4000, dt=0.1).packing
    return pm.Scene(rest, (HARD, pm.Friction(mu if seed % 8 < 4 else 0.9 * mu, 0.7)))


@pytest.mark.parametrize("seed", range(8))
def test_rigid_clusters_with_friction_are_those_of_the_game_with_three_pebbles(seed):
    scene = frictional(seed, 48)
    found, counted = pm.rigid_clusters(scene), pm.rigid_clusters(scene, method="pebble game")
    assert agree(found, counted) and found.rank == counted.rank
    assert found.self_held_k.all() and found.certain
    assert found.rows == len(found.contacts) + np.count_nonzero(~found.sliding_c)


def test_without_friction_a_jammed_packing_is_one_cluster_and_its_rattlers():
    packing = pm.random_packing(48, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.84, seed=1)
    jammed = pm.jam(pm.Scene(packing, (pm.Repulsion(),)), pressure=1e-6).packing
    found = pm.rigid_clusters(jammed)
    assert found.particles_of(0).tolist() == np.flatnonzero(~pm.find_rattlers(jammed)).tolist()
    # it winds around the box in both directions, so that it cannot turn
    assert found.winding_kd[0].all() and found.percolates
    assert found.own_rank_k[0] == 2 * found.size_k[0] - 2
    assert found.largest_fraction == found.size_k[0] / 48


@pytest.mark.parametrize(("seed", "missed"), [(6, 0), (41, 2), (56, 2)])
def test_where_most_contacts_slide_exact_motions_say_that_the_null_space_is_right_and_not_the_game(seed, missed):
    """A normal force acts on the center of a disc: one that turns is a pivot there, and bars on centers depend."""
    scene = frictional(seed, 16)
    mu = (0.05, 0.2, 0.5, 1.0)[seed % 4]
    scene = pm.Scene(scene.packing, (HARD, pm.Friction(0.2 * mu, 0.7)))
    found, counted = pm.rigid_clusters(scene), pm.rigid_clusters(scene, method="pebble game")
    assert found.sliding_c.mean() > 0.5
    rank, cluster = exact_clusters(found)
    assert found.rank == rank and same_partition(found.cluster_c, cluster) and found.certain
    assert counted.rank == rank + missed and not agree(found, counted) and not counted.certain


@pytest.mark.parametrize("height", [0.0, 1e-11, 1e-10, 1e-9, 1e-8, 3e-8, 1e-7, 1e-6, 1e-5, 1e-4, 1e-3])
def test_a_flat_triangle_is_certain_only_where_clusters_ranks_and_stresses_are_of_one_triangle(height):
    """Three bars on one line have a state of self stress; of any height they are rigid, by a singular value like it."""
    packing = framework([[0, 0], [1, height], [2.1, 0]], pairs := [(0, 1), (1, 2), (0, 2)])
    found = pm.rigid_clusters(packing)
    assert found.certain == (height == 0.0 or height > 1e-5)
    if found.certain:
        rank = exact_rank(packing.position_nd.tolist(), pairs)
        assert rank == found.rank == 2 + (height > 0.0) and found.floppy_modes == 4 - rank
        assert found.size_k.tolist() == ([3] if rank == 3 else [2] * 3) and found.self_held_k.all()
        assert found.overconstrained_l.tolist() == [rank == 2] * 3


def test_a_tolerance_that_rounding_does_not_allow_leaves_ranks_uncertain():
    packing = framework([[0, 0], [1, 0.5], [2.1, 0]], [(0, 1), (1, 2), (0, 2)])
    assert pm.rigid_clusters(packing).certain
    assert not pm.rigid_clusters(packing, rank_tolerance=1e-9).certain


def test_every_lattice_whose_rank_is_certain_has_the_rank_that_counting_finds():
    """Singular values near the transition are small; only where one is taken for zero is there a doubt."""
    certain = 0
    for seed in range(12):
        rng = np.random.default_rng(30000 + seed)
        packing, contacts = diluted(30, rng.uniform(0.6, 0.75), rng, bool(seed % 2))
        found = pm.rigid_clusters(packing, contacts=contacts)
        counted = pm.rigid_clusters(packing, contacts=contacts, method="pebble game")
        assert found.certain == (found.rank == counted.rank) and agree(found, counted), seed
        certain += found.certain
    assert 0 < certain < 12


def test_clusters_turn_about_what_is_held_by_itself_and_are_rigid_by_their_own_bars():
    """A triangle turns about a corner, a tetrahedron in 3 ways about one and in 1 about an edge, a bar about an end."""
    for place, pairs, held, size, rank in (
        (generic(3, 2), [(0, 1), (0, 2), (1, 2)], (0,), 3, 4 - 1),
        (generic(3, 2), [(0, 1), (0, 2), (1, 2)], (0, 1), 3, 2),
        (generic(2, 2), [(0, 1)], (0,), 2, 2 - 1),
        (generic(2, 3), [(0, 1)], (0,), 2, 3 - 2),
        (generic(4, 3), TETRAHEDRON, (0,), 4, 9 - 3),
        (generic(4, 3), TETRAHEDRON, (0, 1), 4, 6 - 1),
        (generic(4, 3), TETRAHEDRON, (0, 1, 2), 4, 3),
    ):
        found = pm.rigid_clusters(pm.Scene(framework(place, pairs), (HARD, pm.FixedParticles(held))))
        assert found.size_k[0] == size and found.rank == rank == found.own_rank_k[0] == found.rigid_rank_k[0]
        assert found.self_held_k.all() and found.certain
        d = place.shape[1]
        assert found.floppy_modes == d * (len(place) - len(held)) - rank


def test_a_square_with_a_held_corner_is_rigid_by_itself_with_a_diagonal_and_floppy_without():
    """4 points, 5 bars: rigid about the held corner; 4 bars leave the square to change its angles."""
    sides = [(0, 1), (1, 2), (2, 3), (0, 3)]
    place = generic(4, 2)
    effects = (HARD, pm.FixedParticles((0,)))
    rigid = pm.rigid_clusters(pm.Scene(framework(place, [*sides, (0, 2)]), effects))
    assert rigid.size_k.tolist() == [4] and rigid.own_rank_k[0] == 5 and rigid.self_held_k.all()
    floppy = pm.rigid_clusters(pm.Scene(framework(place, sides), effects))
    assert floppy.size_k.tolist() == [2] * 4 and floppy.rigid_rank_k.tolist() == [1] * 4
    assert floppy.floppy_modes == 2


@pytest.mark.parametrize("d", [2, 3])
def test_the_rank_of_a_rigid_cluster_with_held_particles_is_that_of_all_distances_within_it(d):
    """With one to three held, in one of five on a line."""
    for seed in range(20):
        rng = np.random.default_rng(seed)
        n = int(rng.integers(4, 9))
        pairs = [pair for pair in itertools.combinations(range(n), 2) if rng.random() < 0.6]
        place, held = rng.normal(size=(n, d)), rng.choice(n, 1 + seed % 3, replace=False).tolist()
        if len(held) == 3 and seed % 5 == 0:
            place[held[2]] = 0.3 * place[held[0]] + 0.7 * place[held[1]]
        packing = framework(place, pairs)
        found = pm.rigid_clusters(pm.Scene(packing, (HARD, pm.FixedParticles(sorted(held)))))
        for k, own in enumerate(members(found)):
            rows = np.zeros((len(own) ** 2, n, d))
            for row, (i, j) in zip(rows, itertools.combinations(own, 2), strict=False):
                row[j] = packing.position_nd[j] - packing.position_nd[i]
                row[i] = -row[j]
            rows[:, held] = 0.0
            assert found.rigid_rank_k[k] == np.linalg.matrix_rank(rows.reshape(-1, n * d), tol=1e-9), seed
        assert found.certain


def test_what_is_held_is_one_body():
    """Two held discs a distance apart hold a third by two contacts."""
    packing = pm.Packing([[3.0, 3.0], [4.4, 3.0], [3.7, 3.7]], [0.5] * 3, pm.Box.cubic(8.0, 2))
    effects = (pm.Repulsion(), pm.FixedParticles((0, 1)))
    held = pm.rigid_clusters(pm.Scene(packing, effects))
    assert members(held) == [[0, 1, 2]] and held.floppy_modes == 0 and held.own_rank_k.tolist() == [2]
    assert pm.rigid_clusters(packing).size_k.tolist() == [2, 2]


def test_kagome_is_triangles_and_face_centered_cubic_spheres_are_one_cluster():
    kagome = pm.rigid_clusters(pm.lattice_packing("kagome", repeats=(4, 4)))
    assert kagome.size_k.tolist() == [3] * 32
    crystal = pm.lattice_packing("fcc", repeats=(2, 2, 2))
    cubic = pm.rigid_clusters(crystal)
    assert cubic.size_k.tolist() == [crystal.particles] and cubic.winding_kd.all()
    assert cubic.states_of_self_stress == pm.states_of_self_stress(crystal).count


def test_four_spheres_that_stick_are_rigid_and_three_still_spin_about_the_chords_of_their_contacts():
    """6 contacts of 3 rows are 6 * 4 - 6; 3 contacts leave the spin of each sphere about its own chord."""
    corners = 4.0 + 0.999 * np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]]) / 8.0**0.5
    four = pm.Packing(corners, [0.5] * 4, pm.Box.cubic(9.0, 3))
    effects = (HARD, pm.Friction(0.5))
    whole = pm.rigid_clusters(pm.Scene(four, effects))
    assert members(whole) == [[0, 1, 2, 3]] and whole.rank == 18 == whole.own_rank_k[0]
    three = pm.rigid_clusters(pm.Scene(four.select(np.arange(3)), effects))
    assert len(three) == 0 and three.floppy_modes == 18 - 9 - 3
    rolling = (*effects, pm.RollingResistance(0.5, 0.5))
    assert members(pm.rigid_clusters(pm.Scene(four.select(np.arange(3)), rolling))) == [[0, 1, 2]]


def test_a_framework_without_joints_has_no_clusters():
    alone = pm.Packing([[1.0, 1.0], [4.0, 4.0]], [0.5, 0.5], pm.Box.cubic(8.0, 2))
    for method in ("null space", "pebble game"):
        found = pm.rigid_clusters(alone, method=method)
        assert len(found) == 0 and found.rank == 0 and found.floppy_modes == 2 and found.largest_fraction == 0.0


def test_what_has_no_answer_is_refused_by_name():
    crystal = pm.lattice_packing("fcc", repeats=(2, 2, 2))
    with pytest.raises(ValueError, match="method must be 'null space' in space.*got 'pebble game'"):
        pm.rigid_clusters(crystal, method="pebble game")
    flat = pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.01)
    rough = pm.Scene(flat, (HARD, pm.Friction(0.5)))
    with pytest.raises(ValueError, match="contacts must be None for a scene with friction"):
        pm.rigid_clusters(rough, contacts=pm.find_contacts(flat))
    with pytest.raises(ValueError, match="gap_tolerance must be None for a scene with friction"):
        pm.rigid_clusters(rough, gap_tolerance=1e-3)
    held = pm.Scene(flat, (HARD, pm.FixedParticles((0,))))
    with pytest.raises(ValueError, match="method must be 'null space' where particles are held"):
        pm.rigid_clusters(held, method="pebble game")
    with pytest.raises(ValueError, match="cluster must be below 1, the number of rigid clusters, got 3"):
        pm.rigid_clusters(flat).particles_of(3)
    turning = pm.random_packing(8, dimension=3, shapes=pm.Ellipses(aspect=1.5), packing_fraction=0.7, seed=1)
    with pytest.raises(ValueError, match="particles that turn about all their axes or about none"):
        pm.rigid_clusters(turning)


def test_pictures_and_recordings_show_clusters_in_colors(tmp_path):
    packing = pm.lattice_packing("kagome", repeats=(3, 3))
    contacts, found = pm.find_contacts(packing), pm.rigid_clusters(packing)
    ax = pm.plot(found)
    lines = ax.collections[-1]
    # contacts that cross the edge are drawn at both sides
    assert len(lines.get_segments()) >= len(contacts)
    assert len(np.unique(np.round(lines.get_colors()[:, :3], 3), axis=0)) == 10
    assert f"{len(found)} rigid clusters" in ax.get_title()
    path = pm.record_packing(packing, tmp_path / "clusters.rrd", clusters=found)
    assert path.stat().st_size > 1000
    with pytest.raises(ValueError, match="clusters must be those of the packing"):
        pm.record_packing(pm.lattice_packing("kagome", repeats=(2, 2)), tmp_path / "other.rrd", clusters=found)
    with pytest.raises(TypeError, match="clusters must be a RigidClusters"):
        pm.record_packing(packing, tmp_path / "none.rrd", clusters=contacts)


@pytest.mark.slow
def test_a_thousand_diluted_lattices_have_the_clusters_that_counting_finds():
    rng = np.random.default_rng(7)
    for k in range(1000):
        packing, contacts = diluted(int(rng.integers(3, 16)), rng.uniform(0.4, 0.95), rng, bool(k % 2))
        found = pm.rigid_clusters(packing, contacts=contacts)
        assert agree(found, pm.rigid_clusters(packing, contacts=contacts, method="pebble game")), k


@pytest.mark.slow
def test_a_hundred_packings_with_friction_have_the_clusters_that_counting_finds():
    sliding = 0
    for seed in range(100):
        scene = frictional(seed, 64)
        found = pm.rigid_clusters(scene)
        assert agree(found, pm.rigid_clusters(scene, method="pebble game")), seed
        sliding += int(found.sliding_c.sum())
    assert sliding > 100
