"""Facts about rattlers of packings with rigid links: one cluster at a time, the others at rest."""

import numpy as np
import pytest

import packmech as pm


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
