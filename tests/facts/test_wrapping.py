"""Facts about places in a periodic box: a particle is the same at any of its images, whatever it is joined to."""

import functools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import packmech as pm

REPULSION = (pm.Repulsion(pm.LinearSpring()),)


def discs(dimension=2, **arguments):
    return pm.random_packing(
        14, dimension=dimension, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.9, seed=2, **arguments
    )


def trimers(dimension=2):
    return pm.cluster_packing(6, pm.Trimer(angle=(1.1, 2.6)), dimension=dimension, packing_fraction=0.8, seed=1)


def between_walls():
    packing = discs()
    top = float(packing.box.lattice_dd[1, 1])
    return pm.Scene(packing, (*REPULSION, pm.Gravity(0.0, -1e-3), pm.Walls(1, low=0.2, high=top)))


def rubbing(packing):
    scene = pm.Scene(packing, (*REPULSION, pm.ContactDamping(0.3), pm.Friction(0.5, damping=0.1)))
    return scene.replace(packing=pm.simulate(scene, steps=20, dt=0.05).packing)


KINDS = {
    "discs": lambda: pm.Scene(discs(), REPULSION),
    "spheres": lambda: pm.Scene(discs(3), REPULSION),
    "ellipses": lambda: pm.Scene(discs(shapes=pm.Ellipses(1.5)), REPULSION),
    "bodies": lambda: pm.Scene(discs(shapes=pm.Dimer(0.8)), REPULSION),
    "links": lambda: pm.Scene(trimers(), REPULSION),
    "links in space": lambda: pm.Scene(trimers(3), REPULSION),
    "walls": between_walls,
    "held": lambda: pm.Scene(discs(), (*REPULSION, pm.FixedParticles((1, 4)))),
    "friction": lambda: rubbing(discs()),
    "bonds": lambda: pm.Scene(discs(), (*REPULSION, pm.bond_contacts(discs(), rest="distance"))),
}


@functools.cache
def scene_of(kind):
    return KINDS[kind]()


def elsewhere(scene, seed):
    """Return the scene with each particle at another image of its place."""
    packing = scene.packing
    image = np.random.default_rng(seed).integers(-3, 4, packing.position_nd.shape)
    return scene.replace(packing=packing.replace(position_nd=packing.position_nd + image @ packing.box.lattice_dd.T))


def apart(one, other):
    """Return the largest distance between particles of two packings over all images."""
    way = one.position_nd - other.position_nd
    way -= np.rint(way @ one.box.inverse_dd.T) @ one.box.lattice_dd.T
    return np.abs(way).max()


@pytest.mark.parametrize("kind", [one for one in KINDS if one != "bonds"])
def test_energy_and_forces_are_the_same_at_any_image(kind):
    scene, other = scene_of(kind), elsewhere(scene_of(kind), 3)
    assert pm.energy(other) == pytest.approx(pm.energy(scene), rel=1e-12)
    force = pm.forces(scene)
    assert np.abs(pm.forces(other) - force).max() < 1e-12 * np.abs(force).max()
    assert other.packing.link_error < 1e-12


@pytest.mark.filterwarnings("ignore:scene should be at rest")  # bodies as they were drawn
@pytest.mark.parametrize("kind", ["bodies", "links in space", "walls"])
def test_vibrations_are_the_same_at_any_image(kind):
    square = [
        pm.normal_modes(one, 8, kind="unstressed").eigenvalue_m
        for one in (scene_of(kind), elsewhere(scene_of(kind), 5))
    ]
    assert np.abs(square[1] - square[0]).max() < 1e-10 * max(np.abs(square[0]).max(), 1.0)


@pytest.mark.parametrize("kind", KINDS)
def test_trajectories_are_the_same_from_any_image(kind):
    scene, other = scene_of(kind), elsewhere(scene_of(kind), 4)
    ends = [pm.simulate(one, steps=20, dt=0.02).packing for one in (scene, other)]
    assert apart(*ends) < 1e-11
    assert ends[1].link_error < 1e-11
    if ends[0].tangential is not None:
        springs = [np.abs(one.tangential.displacement_ck).sum() for one in ends]
        assert springs[0] > 0.0 and springs[1] == pytest.approx(springs[0], rel=1e-9)


def test_the_verdict_is_the_same_at_any_image():
    lattice = pm.lattice_packing("triangular", repeats=(3, 3))
    contacts = pm.find_contacts(lattice, gap_tolerance=0.0)
    some = slice(None, None, 5)
    links = pm.Links(contacts.i_c[some], contacts.j_c[some], contacts.image_cd[some], contacts.contact_distance_c[some])
    packing = lattice.replace(links=links)
    image = np.random.default_rng(1).integers(-2, 3, packing.position_nd.shape)
    other = packing.replace(position_nd=packing.position_nd + image @ packing.box.lattice_dd.T)
    one, two = pm.classify_jamming(packing), pm.classify_jamming(other)
    assert (one.collective, one.strict) == (two.collective, two.strict) == ("jammed", "jammed")


# -- links -------------------------------------------------------------------------------------------------------------


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32), st.sampled_from([2, 3]), st.floats(0.05, 2.0))
def test_links_of_any_length_go_with_particles_that_are_wrapped(seed, dimension, length):
    rng = np.random.default_rng(seed)
    box = np.eye(dimension) + 0.3 * rng.standard_normal((dimension, dimension))
    place = rng.random((8, dimension)) @ box.T
    way = rng.normal(size=(8, dimension))
    end = place + length * way / np.linalg.norm(way, axis=1)[:, None]
    links = pm.Links(np.arange(8), np.arange(8, 16), np.zeros((8, dimension)), np.full(8, length))
    packing = pm.Packing(np.concatenate([place, end]), np.full(16, 0.1), pm.Box(box), links)
    moved = packing.position_nd + rng.integers(-3, 4, (16, dimension)) @ box.T
    assert packing.replace(position_nd=moved).link_error < 1e-12


@settings(max_examples=40, deadline=None)
@given(st.integers(0, 2**32), st.sampled_from([2, 3]), st.floats(0.05, 0.45))
def test_a_packing_made_of_wrapped_positions_finds_the_images_of_its_short_links(seed, dimension, length):
    rng = np.random.default_rng(seed)
    place = rng.random((8, dimension))
    way = rng.normal(size=(8, dimension))
    end = place + length * way / np.linalg.norm(way, axis=1)[:, None]
    links = pm.Links(np.arange(8), np.arange(8, 16), np.zeros((8, dimension)), np.full(8, length))
    packing = pm.Packing(np.concatenate([place, end]) % 1.0, np.full(16, 0.1), pm.Box(np.eye(dimension)), links)
    assert packing.link_error < 1e-12


def test_a_particle_that_was_moved_and_wrapped_keeps_the_nearer_image():
    dimer = pm.Packing([[3.9, 1.0], [4.6, 1.0]], [0.5, 0.5], pm.Box.cubic(5.0, 2), pm.Links([0], [1], [[0, 0]], [0.7]))
    moved = dimer.replace(position_nd=(dimer.position_nd + [[0.0, 0.0], [0.45, 0.0]]) % 5.0)
    assert moved.link_error == pytest.approx(0.45)
    assert pm.reaffix_links(moved).packing.links.image_ld.tolist() == [[1, 0]]


def test_links_of_a_box_that_is_scaled_go_with_particles_that_are_wrapped():
    packing = trimers()
    away = np.arange(18) % 3 == 1
    place = 1.5 * packing.position_nd + away[:, None] * (1.5 * packing.box.lattice_dd.sum(axis=1))
    scaled = packing.replace(position_nd=place, box=packing.box.scaled(1.5), radius_n=1.5 * packing.radius_n)
    assert scaled.replace(links=scaled.links.scaled(1.5)).link_error < 1e-12


def away_from_its_link(by=0.3):
    return pm.Packing(
        [[0.0, 0.0], [1.0 + by, 0.0]], [0.5, 0.5], pm.Box.cubic(6.0, 2), pm.Links([0], [1], [[0, 0]], [1.0])
    )


CALLS = {
    "energy": pm.energy,
    "forces": pm.forces,
    "pressure": pm.pressure,
    "hessian": pm.hessian,
    "normal_modes": lambda scene: pm.normal_modes(scene, 2),
    "elastic_moduli": pm.elastic_moduli,
    "classify_jamming": lambda scene: pm.classify_jamming(scene.packing),
    "find_rattlers": lambda scene: pm.find_rattlers(scene.packing),
    "quench": lambda scene: pm.quench(scene, force_tolerance=1e-6),
    "jam": lambda scene: pm.jam(scene, pressure=1e-3),
    "simulate": lambda scene: pm.simulate(scene, steps=2),
    "compress": lambda scene: pm.compress(scene, packing_fraction=0.5),
    "packing_fraction": lambda scene: pm.packing_fraction(scene.packing),
}


@pytest.mark.parametrize("name", CALLS)
def test_a_link_away_from_its_length_is_refused_with_the_way_out(name):
    scene = pm.Scene(away_from_its_link(), REPULSION)
    words = (
        f"links at their lengths to (1e-06|0.01) for pm.{name}, got particles 0 and 1 at distance 1.3 .*reaffix_links"
    )
    with pytest.raises(ValueError, match=words):
        CALLS[name](scene)


@pytest.mark.parametrize("ending", ["npz", "gsd", "toml"])
def test_a_packing_with_a_link_away_from_its_length_is_not_written(tmp_path, ending):
    scene = pm.Scene(away_from_its_link(), REPULSION)
    with pytest.raises(ValueError, match="links at their lengths"):
        if ending == "toml":
            pm.write_scene(scene, tmp_path / "a.toml")
        else:
            pm.write_packing(scene.packing, tmp_path / f"a.{ending}")
    assert list(tmp_path.iterdir()) == []


def test_what_reaffix_links_returns_is_taken():
    back = pm.reaffix_links(away_from_its_link()).packing
    assert pm.energy(pm.Scene(back, REPULSION)) == 0.0


def test_the_rounding_of_seven_digits_is_no_violation():
    assert pm.energy(pm.Scene(away_from_its_link(5e-7), REPULSION)) == 0.0


# -- springs of contacts and bonds -------------------------------------------------------------------------------------


def test_tangential_displacements_go_with_particles_that_are_wrapped_and_with_no_others():
    springs = pm.TangentialDisplacements([0], [1], [[0, 0]], [[0.1]])
    packing = pm.Packing([[0.5, 0.5], [1.4, 0.5]], [0.5, 0.5], pm.Box.cubic(4.0, 2), tangential=springs)
    wrapped = packing.replace(position_nd=packing.position_nd + [[0.0, 4.0], [-4.0, 0.0]])
    assert wrapped.tangential == pm.TangentialDisplacements([0], [1], [[1, 1]], [[0.1]])
    assert packing.replace(position_nd=packing.position_nd + [[0.0, 4.0], [1e-9, 0.0]]).tangential is None
    assert packing.replace(position_nd=packing.position_nd, radius_n=[0.5, 0.6]).tangential is None


def test_bonds_go_with_particles_that_are_wrapped():
    packing = discs()
    scene = pm.Scene(packing, (*REPULSION, pm.bond_contacts(packing, rest="distance")))
    other = elsewhere(scene, 7)
    bonds = other.effects[1]
    vector = other.packing.position_nd[bonds.j_b] - other.packing.position_nd[bonds.i_b]
    distance = np.linalg.norm(vector + bonds.image_bd @ packing.box.lattice_dd.T, axis=1)
    assert np.abs(distance - bonds.rest_length_b).max() < 1e-12


def test_bonds_of_a_particle_that_went_far_stay_as_they_are():
    packing = pm.Packing([[0.5, 0.5], [1.5, 0.5]], [0.5, 0.5], pm.Box.cubic(4.0, 2))
    bonds = pm.Bonds([0], [1], [[0, 0]], [1.0])
    scene = pm.Scene(packing, (*REPULSION, bonds))
    # half the box, and a little more
    far = packing.replace(position_nd=packing.position_nd + [[1.9, 0.0], [2.1, 0.0]])
    assert scene.replace(packing=far).effects[1] == bonds


def test_a_wrong_link_beside_the_right_one_of_the_same_pair_stays_and_is_refused():
    links = pm.Links([0, 0], [1, 1], [[0, 0], [1, 0]], [1.0, 1.0])
    packing = pm.Packing([[1.0, 1.0], [2.0, 1.0]], [0.5, 0.5], pm.Box.cubic(4.0, 2), links)
    np.testing.assert_array_equal(packing.links.image_ld, [[0, 0], [1, 0]])
    assert np.max(packing.link_error) == pytest.approx(4.0)
    with pytest.raises(ValueError, match="links at their lengths"):
        pm.energy(pm.Scene(packing, REPULSION))
