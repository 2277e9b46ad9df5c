"""Facts about rattlers of packings with rigid links: one cluster at a time, the others at rest."""

import functools

import numpy as np
import pytest

import packmech as pm

HOLE = 14
METHODS = ["certificate", "loads"]


def named(mask):
    return np.flatnonzero(mask).tolist()


def test_beads_that_turn_about_the_one_held_rattle(linked):
    scene, data = linked("jammed_trimer_fixedbox")
    assert named(pm.find_rattlers(scene.packing)) == data["rattling_particles"]


@pytest.mark.parametrize("name", ["jammed_trimer_fixedbox", "jammed_dimer_strain", "equilibrium_dimer_3d"])
def test_rattlers_of_overlaps_at_rest_and_of_bare_gaps_are_the_same(linked, name):
    packing = linked(name)[0].packing
    contacts = pm.find_contacts(packing)
    # half the radii: the same contacts with gaps, so no forces to go by
    apart = packing.replace(radius_n=0.5 * packing.radius_n)
    known = pm.find_contacts(apart, gap_tolerance=1.5)
    key = {
        (i, j, *z)
        for i, j, z in zip(contacts.i_c.tolist(), contacts.j_c.tolist(), contacts.image_cd.tolist(), strict=True)
    }
    same = [
        (i, j, *z) in key
        for i, j, z in zip(known.i_c.tolist(), known.j_c.tolist(), known.image_cd.tolist(), strict=True)
    ]
    bare = known.select(np.array(same))
    assert len(bare) == len(contacts) and bare.overlap_c.max() < 0.0
    assert np.array_equal(pm.find_rattlers(apart, contacts=bare), pm.find_rattlers(packing))


@pytest.mark.parametrize(("name", "repeats"), [("triangular", (6, 6)), ("fcc", (3, 3, 3))])
def test_single_beads_beside_a_linked_pair_are_held_as_their_normals_say(name, repeats):
    """A crystal with vacancies and a tiny dimer in one of them: the rule for clusters meets that for single beads."""
    crystal = pm.lattice_packing(name, repeats)
    seen = set()
    for seed in range(6):
        kept = np.random.default_rng(seed).permutation(crystal.particles)[
            : round((0.5 + 0.08 * seed) * crystal.particles)
        ]
        gone = np.setdiff1d(np.arange(crystal.particles), kept)[0]
        count, d = len(kept), crystal.dimension
        step = 0.05 * crystal.radius_n[0] * np.eye(d)[:1]
        place = np.vstack(
            [crystal.position_nd[kept], crystal.position_nd[gone] - step, crystal.position_nd[gone] + step]
        )
        bare = pm.Packing(place, np.append(crystal.radius_n[kept], [0.01 * crystal.radius_n[0]] * 2), crystal.box)
        links = pm.Links([count], [count + 1], [[0] * d], [0.1 * crystal.radius_n[0]])
        single = pm.find_rattlers(bare)
        assert np.array_equal(pm.find_rattlers(bare.replace(links=links)), single)
        seen.add(int(single.sum()))
    assert len(seen) > 2


def test_sub_packing_keeps_the_links_between_particles_that_are_left(linked):
    packing = linked("jammed_trimer_fixedbox")[0].packing
    backbone, index = pm.remove_rattlers(packing)
    assert index.tolist() == [0, *range(3, 13)]
    assert backbone.particles == 11 and len(backbone.links) == 9
    before = packing.links.vectors(packing.position_nd, packing.box.lattice_dd)[3:12]
    assert np.array_equal(backbone.links.vectors(backbone.position_nd, backbone.box.lattice_dd), before)
    assert not pm.find_rattlers(backbone).any()
    assert pm.classify_jamming(backbone).contacts == 12


def test_coordination_number_leaves_rattling_beads_out(linked):
    packing = linked("jammed_trimer_fixedbox")[0].packing
    assert pm.coordination_number(packing) == 2 * 12 / 11
    assert pm.coordination_number(packing, rattlers="keep") == 2 * 12 / 15


def test_distance_that_a_rattling_bead_held_becomes_a_link_of_shape():
    """A rigid tetrahedron without the link 0-1 but with a fifth bead that holds it: taken out, the distance stays."""
    from packmech.measure.rattlers import without

    place = np.array([[0, 0, 0], [1, 0, 0], [0.5, 0.8, 0], [0.5, 0.3, 0.8], [0.5, -0.5, 0.6]])
    pairs = [(0, 2), (0, 3), (0, 4), (1, 2), (1, 3), (1, 4), (2, 3), (2, 4), (3, 4)]
    i, j = np.array(pairs).T
    links = pm.Links(i, j, np.zeros((9, 3)), np.linalg.norm(place[i] - place[j], axis=1))
    packing = pm.Packing(place, [0.2] * 5, pm.Box.cubic(6.0, 3), links)
    left, index = without(packing, np.array([False, False, True, True, True]))
    assert index.tolist() == [0, 1] and left.links.length_l.tolist() == [1.0] and left.links.shape_l.tolist() == [True]


def test_nothing_left_is_refused(linked):
    packing = linked("jammed_trimer_fixedbox")[0].packing
    with pytest.raises(ValueError, match="packing must have particles that do not rattle, got 15 rattlers"):
        pm.remove_rattlers(packing.replace(radius_n=0.5 * packing.radius_n))


def test_rattlers_do_not_depend_on_where_clusters_are_wrapped(linked):
    packing = linked("jammed_trimer_fixedbox")[0].packing
    image = np.random.default_rng(0).integers(-2, 3, size=packing.position_nd.shape)
    moved = packing.replace(
        position_nd=packing.position_nd - image @ packing.box.lattice_dd.T, links=packing.links.moved(image)
    )
    assert np.array_equal(pm.find_rattlers(moved), pm.find_rattlers(packing))


def neighbors(contacts):
    """Return a function: the particles that touch one, with the image of each as seen from it."""
    table = {}
    for i, j, z in zip(contacts.i_c.tolist(), contacts.j_c.tolist(), contacts.image_cd, strict=True):
        table.setdefault(i, {})[j] = z
        table.setdefault(j, {})[i] = -z
    return table


def walk(table, start, length, avoid):
    """Return a path of touching particles of that length from `start` that meets itself nowhere, or None."""
    if length == 1:
        return [start]
    for other in sorted(table[start]):
        if other not in avoid:
            rest = walk(table, other, length - 1, avoid | {start, other})
            if rest is not None:
                return [start, *rest]
    return None


class Molecule:
    """A crystal less one disc, some of its discs linked, and tiny beads in the hole that are linked to them."""

    def __init__(self, name="triangular", repeats=(6, 6)):
        crystal = pm.lattice_packing(name, repeats)
        self.table = neighbors(pm.find_contacts(crystal, gap_tolerance=1e-9))
        self.crystal, self.side = crystal, 2.0 * float(crystal.radius_n[0])
        self.rim = sorted(self.table[HOLE])
        self.tiny, self.links = [], []

    def bead(self, *offset):
        """Place a tiny bead at this offset from the middle of the hole, in diameters, and return its number."""
        self.tiny.append(self.crystal.position_nd[HOLE] + self.side * np.array(offset))
        return self.crystal.particles + len(self.tiny) - 1

    def link(self, *chain, close=False):
        """Link these particles in a row."""
        self.links += list(zip(chain, [*chain[1:], *([chain[0]] if close else [])], strict=False))

    def direction(self, k, seen_from=HOLE):
        """Return the way to a neighbor, in diameters."""
        vector = self.crystal.position_nd[k] - self.crystal.position_nd[seen_from]
        return (vector + self.crystal.box.lattice_dd @ self.table[seen_from][k]) / self.side

    def packing(self):
        """Return the packing; the disc of the hole is the last number and taken out, the others keep theirs."""
        place = np.vstack([self.crystal.position_nd, *self.tiny])
        radius = np.append(self.crystal.radius_n, [0.01 * self.side] * len(self.tiny))
        i, j = np.array(self.links).T
        image = np.array([self.image(a, b) for a, b in self.links])
        number = np.arange(len(place)) - (np.arange(len(place)) > HOLE)
        vector = place[j] - place[i] + image @ self.crystal.box.lattice_dd.T
        links = pm.Links(number[i], number[j], image, np.linalg.norm(vector, axis=1))
        rest = np.arange(len(place)) != HOLE
        return pm.Packing(place[rest], radius[rest], self.crystal.box, links)

    def image(self, a, b):
        """Return the image of b that a is linked to: the one it touches, or the same from the hole."""
        last = self.crystal.particles
        here = np.zeros(self.crystal.dimension, dtype=int)
        if a >= last:
            return here if b >= last else self.table[HOLE][b]
        return -self.table[HOLE][a] if b >= last else self.table[a][b]


def chain_of_thirty():
    """A chain of 27 discs of the crystal and three beads that dangle in the hole."""
    made = Molecule()
    first = made.rim[0]
    made.link(
        *walk(made.table, first, 27, {HOLE})[::-1], made.bead(-0.1, 0.2), made.bead(0.1, 0.1), made.bead(0.2, -0.1)
    )
    return made.packing(), 3


def branched():
    """A cluster of a held arm, and two arms of different length that dangle."""
    made = Molecule()
    knot = made.rim[2]
    made.link(*walk(made.table, knot, 5, {HOLE}))
    made.link(knot, made.bead(0.0, 0.2), made.bead(0.2, 0.1))
    made.link(knot, made.bead(-0.2, -0.2))
    return made.packing(), 3


def ring():
    """A ring of five: two discs of the crystal that touch, and three beads that hang loosely in the hole."""
    made = Molecule()
    one = made.rim[0]
    other = next(k for k in made.rim if k in made.table[one])
    made.link(one, made.bead(0.2, 0.1), made.bead(-0.1, -0.2), made.bead(0.1, 0.25), other, close=True)
    return made.packing(), 3


def ring_held():
    """A ring around the hole: the six discs of its rim."""
    made = Molecule()
    ring = walk(made.table, made.rim[0], 6, set(made.table) - set(made.rim))
    made.link(*ring, close=True)
    made.link(ring[0], made.bead(0.1, 0.1))
    return made.packing(), 1


def winding(slack):
    """A chain that closes around the box along a row of the crystal, over the hole by way of two beads."""
    made = Molecule()
    left, right = (next(k for k in made.rim if abs(made.direction(k)[0] - x) < 1e-9) for x in (-1.0, 1.0))
    row = [right]
    while row[-1] != left:
        row.append(next(k for k in made.table[row[-1]] if abs(made.direction(k, row[-1])[0] - 1.0) < 1e-9))
    made.link(*row, made.bead(-0.2, 0.2 * slack), made.bead(0.2, -0.2 * slack), right)
    return made.packing(), 2


def rigid(arm=1):
    """A rigid part in space: two spheres of the crystal that stay where they are, three beads that turn about them.

    An arm of spheres, if longer than the one, makes the cluster as a whole flexible.
    """
    made = Molecule("fcc", (3, 3, 3))
    one = made.rim[0]
    other = next(k for k in made.rim if k in made.table[one])
    beads = [made.bead(0.1, 0.2, 0.05), made.bead(-0.2, 0.1, 0.1), made.bead(0.05, -0.1, -0.2)]
    five = [one, *beads, other]
    for k, a in enumerate(five):
        for b in five[k + 1 :]:
            # nine of ten pairs hold the shape; the distance of the two that are held is none of them
            if (a, b) != (one, other):
                made.link(a, b)
    if arm > 1:
        made.link(*walk(made.table, one, arm, {HOLE, other}))
    return made.packing(), 3


MOLECULES = {
    "chain of thirty": chain_of_thirty,
    "branched": branched,
    "ring": ring,
    "ring that is held": ring_held,
    "winding, slack": functools.partial(winding, 1.0),
    "rigid": rigid,
    "rigid with an arm": functools.partial(rigid, 4),
}
every_molecule = pytest.mark.parametrize("name", MOLECULES)


@every_molecule
def test_only_the_end_of_a_cluster_that_is_loose_rattles_by_all_three_rules(name):
    packing, loose = MOLECULES[name]()
    last = list(range(packing.particles - loose, packing.particles))
    assert named(pm.find_rattlers(packing)) == named(pm.find_rattling_clusters(packing).rattling_n) == last
    for method in METHODS:
        verdict = pm.classify_jamming(packing, method=method)
        assert (verdict.collective, named(verdict.rattlers)) == ("jammed", last)
        assert named(verdict.danglers) == last and not verdict.rattling_clusters.any()


@every_molecule
def test_cut_cluster_keeps_what_held_and_the_rest_is_jammed_as_before(name):
    packing, loose = MOLECULES[name]()
    left, index = pm.remove_rattlers(packing)
    assert index.tolist() == list(range(packing.particles - loose))
    assert np.array_equal(left.position_nd, packing.position_nd[index]) and not pm.find_rattlers(left).any()
    old = {(i, j, *z): length for i, j, z, length in rows_of(packing.links) if max(i, j) < left.particles}
    new = {(i, j, *z): length for i, j, z, length in rows_of(left.links)}
    assert old.items() <= new.items()
    before, after = (pm.classify_jamming(one) for one in (packing, left))
    assert (before.collective, before.strict) == (after.collective, after.strict)
    # where the cut cluster held the distance of two discs that touch, a link takes the place of their contact
    network = before.network
    touching = set(zip(network.i_c.tolist(), network.j_c.tolist(), *network.image_cd.T.tolist(), strict=True))
    assert before.contacts - after.contacts == len((new.keys() - old.keys()) & touching)


def rows_of(links):
    """Return the links as tuples: ends, image, length."""
    return zip(links.i_l.tolist(), links.j_l.tolist(), links.image_ld.tolist(), links.length_l.tolist(), strict=True)


@pytest.mark.parametrize("arm", [1, 4])
def test_beads_that_turn_with_a_rigid_part_leave_its_held_distance_as_a_link_of_shape(arm):
    packing, _ = rigid(arm)
    left, _ = pm.remove_rattlers(packing)
    assert len(left.links) == arm and left.links.shape_l.sum() == 1
    assert left.links.length_l[left.links.shape_l] == pytest.approx(2.0 * packing.radius_n.max(), rel=1e-12)


def test_chain_around_the_box_that_is_taut_over_a_hole_holds_its_beads_across_and_loses_none_that_is_held():
    taut, _ = winding(0.0)
    assert not set(named(pm.find_rattlers(taut))) & set(range(taut.particles - 2))
    assert np.array_equal(pm.find_rattlers(taut), pm.find_rattling_clusters(taut).rattling_n)
    assert np.array_equal(pm.find_rattlers(taut), pm.classify_jamming(taut).rattlers)


def test_cluster_that_rattles_as_a_whole_is_one_and_goes_as_a_whole():
    made = Molecule()
    made.link(made.bead(0.1, 0.1), made.bead(-0.1, 0.1), made.bead(0.0, -0.1))
    packing = made.packing()
    last = list(range(packing.particles - 3, packing.particles))
    verdict = pm.classify_jamming(packing)
    assert named(verdict.rattlers) == named(verdict.rattling_clusters) == named(verdict.danglers) == last
    left, _ = pm.remove_rattlers(packing)
    assert not left.links and left.particles == 35


def squeezed(bend, overlap):
    """Return a crystal with a tiny dimer in a vacancy and, in another, a disc in touch with two of its neighbors.

    These are bent by an angle from a straight line; at 60 degrees they are the two below.
    """
    crystal = pm.lattice_packing("triangular", (8, 8), relative_overlap=0.01)
    radius, side = crystal.radius_n.copy(), crystal.box.lattice_dd[0, 0] / 8.0
    away = crystal.position_nd - crystal.position_nd[27]
    # the two neighbors that the disc touches
    angle = np.radians([180.0 + bend, -bend]) if bend >= 30.0 else np.array([np.pi, 0.0])
    chosen = [int(np.linalg.norm(away - side * np.array([np.cos(one), np.sin(one)]), axis=1).argmin()) for one in angle]
    place = crystal.position_nd[27].copy()
    if bend < 30.0:
        # larger than the others, so that these do not touch it, and a little below it
        radius[chosen] *= 1.1
        place[1] += side * np.tan(np.radians(bend))
    else:
        place[1] -= 0.2 * side
    distance = np.linalg.norm(crystal.position_nd[chosen] - place, axis=1)
    disc = distance[0] / (1.0 - overlap) - radius[chosen[0]]
    ends = crystal.position_nd[45] + 0.05 * side * np.array([[-1.0, 0.0], [1.0, 0.0]])
    kept = np.setdiff1d(np.arange(64), [27, 45])
    count = len(kept)
    links = pm.Links([count + 1], [count + 2], [[0, 0]], [0.1 * side])
    packing = pm.Packing(
        np.vstack([crystal.position_nd[kept], place, ends]), np.concatenate([radius[kept], [disc, 0.01, 0.01]]),
        crystal.box, links,
    )  # fmt: skip
    return packing, count


@pytest.mark.parametrize(("bend", "overlap"), [(0.25, 1e-4), (0.25, 1e-9), (60.0, 1e-9), (60.0, 1e-3)])
def test_a_disc_that_two_others_squeeze_out_rattles_however_straight_they_stand_and_however_little_they_overlap(
    bend, overlap
):
    packing, disc = squeezed(bend, overlap)
    assert pm.find_contacts(packing).count_n()[disc] == 2
    assert named(pm.find_rattlers(packing)) == [disc, disc + 1, disc + 2]
