"""Facts about links: one canonical form, images as state, clusters, and pairs that are no contacts."""

import json
import pathlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import packmech as pm
from packmech.contacts.excluded import rigid_clusters
from packmech.links import image_offsets

GOLDEN = pathlib.Path(__file__).parent / "golden"
# packings of the polymer vectors; each file names its source
STORED = ["random_trimer_2d_w2.5", "random_dimer_3d_w2.0", "random_chain_3d_w2.5", "equilibrium_trimer_2d"]


def stored(name):
    data = json.loads((GOLDEN / f"{name}.json").read_text())
    link = data["links"]
    links = pm.Links(
        [one["i"] for one in link],
        [one["j"] for one in link],
        [one["z"] for one in link],
        [one["length"] for one in link],
    )
    return pm.Packing(data["positions"], data["radii"], pm.Box(data["lattice_columns"]), links), data


def pairs(contacts):
    return {
        (int(i), int(j), *map(int, z)) for i, j, z in zip(contacts.i_c, contacts.j_c, contacts.image_cd, strict=True)
    }


@pytest.mark.parametrize("name", STORED)
def test_contacts_leave_out_links_and_pairs_of_rigid_clusters(name):
    packing, data = stored(name)
    expected = set()
    for one in data["contacts"]:
        i, j, z = one["i"], one["j"], np.array(one["z"])
        expected.add((i, j, *map(int, z)) if i < j else (j, i, *map(int, -z)))
    assert pairs(pm.find_contacts(packing)) == expected
    assert packing.link_error < 1e-14


def test_links_are_stored_once_in_one_direction_and_order():
    links = pm.Links([2, 1, 1], [1, 0, 1], [[1, 0], [0, 2], [0, -1]], [1.0, 2.0, 3.0], [True, False, False])
    assert links.i_l.tolist() == [0, 1, 1] and links.j_l.tolist() == [1, 1, 2]
    assert links.image_ld.tolist() == [[0, -2], [0, 1], [-1, 0]]
    assert links.length_l.tolist() == [2.0, 3.0, 1.0] and links.shape_l.tolist() == [False, False, True]


@given(seed=st.integers(0, 2**32), name=st.sampled_from(STORED))
def test_wrapping_keeps_links_clusters_and_contacts(seed, name):
    packing, _ = stored(name)
    image = np.random.default_rng(seed).integers(-3, 4, size=packing.position_nd.shape)
    moved = packing.replace(
        position_nd=packing.position_nd - image @ packing.box.lattice_dd.T, links=packing.links.moved(image)
    )
    assert moved.link_error < 1e-13
    assert len(pm.find_contacts(moved)) == len(pm.find_contacts(packing))
    assert moved.wrapped() == packing.wrapped() or np.allclose(
        moved.wrapped().position_nd, packing.wrapped().position_nd
    )
    assert np.array_equal(rigid_clusters(moved), rigid_clusters(packing))


def test_a_chain_around_the_box_winds_and_an_open_one_does_not():
    box = pm.Box.cubic(4.0, 2)
    position = [[0.5 + k, 1.0] for k in range(4)]
    ring = pm.Packing(
        position, [0.4] * 4, box, pm.Links([0, 1, 2, 0], [1, 2, 3, 3], [[0, 0]] * 3 + [[-1, 0]], [1.0] * 4)
    )
    assert ring.link_error < 1e-15
    assert image_offsets(ring.links, 4)[1].all()
    chain = ring.replace(links=ring.links.select([0, 1, 3]))
    assert not image_offsets(chain.links, 4)[1].any()
    assert not rigid_clusters(ring).any()


@pytest.mark.parametrize(
    ("places", "bonds", "rigid"),
    [
        ([[0, 0], [1, 0]], [(0, 1)], True),
        ([[0, 0], [1, 0], [0.3, 0.9]], [(0, 1), (1, 2), (0, 2)], True),
        ([[0, 0], [1, 0], [0.3, 0.9]], [(0, 1), (1, 2)], False),
        # collinear: the three links leave a bend of second order
        ([[0, 0], [1, 0], [2, 0]], [(0, 1), (1, 2), (0, 2)], False),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [(0, 1), (1, 2), (0, 2)], True),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0.2, 0.1, 1]], [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)], True),
        # coplanar: six links of rank five
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)], False),
    ],
)
def test_a_cluster_is_rigid_if_its_links_leave_translations_and_rotations_only(places, bonds, rigid):
    places = np.array(places, dtype=float)
    i, j = np.array(bonds).T
    length = np.linalg.norm(places[j] - places[i], axis=1)
    links = pm.Links(i, j, np.zeros((len(i), places.shape[1])), length)
    packing = pm.Packing(places, np.full(len(places), 0.6), pm.Box.cubic(9.0, places.shape[1]), links)
    assert rigid_clusters(packing).all() == rigid
    assert len(pm.find_contacts(packing)) == 0 or not rigid


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([0], [1], [[0, 0]], [-1.0]), "length_l must .*positive.* link 0"),
        (([0], [1], [[0, 2**62]], [1.0]), "image_ld must stay within 2147483648, got .* for link 0"),
        (([0], [1], [[0, 0.5]], [1.0]), "image_ld must hold whole numbers, got 0.5 for link 0"),
        (([0], [0], [[0, 0]], [1.0]), "image_ld must not be zero for a link of a particle with itself, got link 0"),
        (
            ([0, 1], [1, 0], [[0, 0], [0, 0]], [1.0, 1.0]),
            "links must name each pair once, got 0-1 at image .0, 0. twice",
        ),
        (([0, 1], [1], [[0, 0]] * 2, [1.0]), "j_l must have as many entries as i_l .2., got 1"),
        (([-1], [1], [[0, 0]], [1.0]), "i_l must not be negative, got -1 for link 0"),
        (([0], [1], [[0, 0]], [1.0], [1]), "shape_l must be an array of truth values"),
    ],
)
def test_wrong_links_are_refused_naming_the_argument(arguments, message):
    with pytest.raises((TypeError, ValueError), match=message):
        pm.Links(*arguments)


def test_links_of_particles_that_are_not_there_are_refused():
    links = pm.Links([0], [5], [[0, 0]], [1.0])
    with pytest.raises(ValueError, match="links must name particles below 2, got 5"):
        pm.Packing([[0.0, 0.0], [1.0, 0.0]], [0.5, 0.5], pm.Box.cubic(4.0, 2), links)


def test_calls_that_would_ignore_links_refuse_them():
    packing, _ = stored("random_trimer_2d_w2.5")
    with pytest.raises(
        ValueError, match="scene.packing must have no links for pm.complex_modulus, which would ignore them, got 9"
    ):
        pm.complex_modulus(pm.Scene(packing, (pm.Repulsion(), pm.Friction(coefficient=0.5))), [0.1])


def test_links_are_found_from_either_end():
    packing, _ = stored("random_chain_3d_w2.5")
    links = packing.links
    rng = np.random.default_rng(3)
    named = rng.permutation(len(links))
    back = rng.random(len(named)) < 0.5
    i, j = np.where(back, links.j_l[named], links.i_l[named]), np.where(back, links.i_l[named], links.j_l[named])
    image = np.where(back[:, None], -links.image_ld[named], links.image_ld[named])
    assert (links.find(i, j, image) == named).all()
    assert links.find(i[:0], j[:0], image[:0]).shape == (0,)
    with pytest.raises(ValueError, match="links must hold .*, got none"):
        links.find(i, j, image + 7)
