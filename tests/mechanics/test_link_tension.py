"""Facts about the forces that rigid links carry, and the stress with them."""

import numpy as np
import pytest

import packmech as pm
from packmech.constraints.factor import ConstraintFactor
from packmech.measure.contact_forces import force_balance

RANDOM = ["random_trimer_2d_w2.5", "random_dimer_3d_w2.0", "random_chain_3d_w2.5"]
AT_REST = ["equilibrium_chain_2d", "equilibrium_dimer_2d", "equilibrium_dimer_3d", "equilibrium_trimer_2d"]


def ordered(scene, data):
    """Return stored link numbers in the order in which the packing holds its links."""
    mine = list(zip(scene.packing.links.i_l, scene.packing.links.j_l, strict=True))
    stored = [(min(one["i"], one["j"]), max(one["i"], one["j"])) for one in data["links"]]
    return [stored.index(pair) for pair in mine]


@pytest.mark.parametrize("name", RANDOM)
def test_tension_away_from_rest_is_the_stored_least_squares_solution(linked, name):
    scene, data = linked(name)
    stored = np.array(data["least_squares_link_multipliers"])[ordered(scene, data)]
    assert np.abs(pm.link_tension(scene) - stored).max() < 1e-12


@pytest.mark.parametrize("name", AT_REST)
def test_tension_at_rest_is_the_stored_one_and_balances_the_contacts(linked, name):
    scene, data = linked(name)
    stored = np.array(data["link_multipliers"])[ordered(scene, data)]
    assert np.abs(pm.link_tension(scene) - stored).max() < 1e-12
    largest, mean = force_balance(scene)
    assert largest < 1e-13 * mean


@pytest.mark.parametrize("name", AT_REST)
def test_stress_of_contacts_and_links_adds_up_to_the_stored_total(linked, name):
    scene, data = linked(name)
    for parts in ("contacts", "links", "total"):
        stress = pm.stress_tensor(scene, parts=parts)
        assert np.abs(stress - np.array(data[f"stress_{parts}"])).max() < 1e-12
        assert pm.pressure(scene, parts=parts) == pytest.approx(-np.trace(stress) / len(stress), abs=1e-15)


def test_links_dominate_the_pressure_of_a_flexible_chain(linked):
    scene, _ = linked("equilibrium_chain_2d")
    assert pm.pressure(scene, parts="contacts") > 50 * abs(pm.pressure(scene))


def test_links_that_depend_on_each_other_share_the_least_tension():
    # a square with both diagonals, squeezed between its own images: six links of rank five
    side = 1.0
    place = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]) * side
    i, j = np.array([(0, 1), (1, 2), (2, 3), (0, 3), (0, 2), (1, 3)]).T
    links = pm.Links(i, j, np.zeros((6, 2)), np.linalg.norm(place[j] - place[i], axis=1))
    packing = pm.Packing(place, [0.52] * 4, pm.Box.cubic(2.0, 2), links)
    scene = pm.Scene(packing, (pm.Repulsion(),))
    tension = pm.link_tension(scene)
    largest, mean = force_balance(scene)
    assert largest < 1e-14 * mean
    # the state of self stress of the braced square: -1 on its sides, sqrt(2) on its diagonals
    pairs = list(zip(packing.links.i_l, packing.links.j_l, strict=True))
    state = np.array([np.sqrt(2.0) if pair in ((0, 2), (1, 3)) else -1.0 for pair in pairs])
    assert abs(tension @ state) < 1e-13 * np.abs(tension).max()


def test_long_chain_is_balanced_to_rounding():
    rng = np.random.default_rng(3)
    bend = rng.uniform(-0.01, 0.01, size=199)
    turn = np.cumsum(bend)
    place = np.vstack([[0.0, 0.0], np.cumsum(np.stack([np.cos(turn), np.sin(turn)], axis=1), axis=0)])
    i = np.concatenate([np.arange(199), np.arange(198)])
    j = np.concatenate([np.arange(1, 200), np.arange(2, 200)])
    links = pm.Links(i, j, np.zeros((397, 2)), np.linalg.norm(place[j] - place[i], axis=1))
    packing = pm.Packing(place, np.full(200, 0.4), pm.Box.cubic(500.0, 2), links)
    gradients = ConstraintFactor(packing)
    assert not gradients.dependent_l.any()
    given = rng.normal(size=397)
    push = -(gradients.gradient_lx.T @ given)
    left = push + gradients.gradient_lx.T @ gradients.multipliers(push)
    assert np.abs(left).max() < 1e-12


def test_packings_without_links_have_no_link_stress():
    scene = pm.Scene(pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.01), (pm.Repulsion(),))
    assert len(pm.link_tension(scene)) == 0
    assert not pm.stress_tensor(scene, parts="links").any()
    assert np.array_equal(pm.stress_tensor(scene, parts="contacts"), pm.stress_tensor(scene))
