"""Facts about rattling clusters: who moves with the backbone and who does not."""

import numpy as np
import pytest
import scipy.sparse as sp
from hard_cases.jamming import three_in_a_hole

import packmech as pm
from packmech.contacts.elements import distance_rows
from packmech.linalg import linear_programs
from packmech.measure import rattlers
from packmech.result import Outcome, Solve


def test_beads_that_turn_about_the_one_held_rattle_and_are_named(linked):
    scene, data = linked("jammed_trimer_fixedbox")
    found = pm.find_rattling_clusters(scene.packing)
    assert np.flatnonzero(found.rattling_n).tolist() == data["rattling_particles"] == [1, 2, 13, 14]
    assert np.flatnonzero(~found.rattling_n).tolist() == data["backbone_particles"]
    assert np.array_equal(found.dangling_n, found.rattling_n) and not found.rattling_cluster_n.any()
    assert not found.empty


@pytest.mark.parametrize("name", ["jammed_dimer_strain", "equilibrium_chain_2d", "equilibrium_dimer_3d"])
def test_nothing_rattles_where_every_cluster_is_held(linked, name):
    packing = linked(name)[0].packing
    found = pm.find_rattling_clusters(packing)
    assert not found.rattling_n.any() and found.backbone_c.all()


def with_end(packing, bead, reach):
    """Return the packing with a tiny bead linked to the given one, in a hole within reach."""
    packing = packing.wrapped()
    cells = [[a, b] for a in (-2, -1, 0, 1, 2) for b in (-2, -1, 0, 1, 2)]
    others = (packing.position_nd[:, None] + np.array(cells) @ packing.box.lattice_dd.T).reshape(-1, 2)
    radius = np.repeat(packing.radius_n, len(cells))
    grid = packing.position_nd[bead] + np.random.default_rng(1).uniform(-reach, reach, size=(4000, 2))
    room = (np.linalg.norm(grid[:, None] - others, axis=2) - radius).min(axis=1)
    place = grid[np.argmax(room)]
    assert room.max() > 0.02
    links = packing.links
    return pm.Packing(
        np.vstack([packing.position_nd, place]),
        np.append(packing.radius_n, 0.3 * room.max()),
        packing.box,
        pm.Links(
            np.append(links.i_l, bead),
            np.append(links.j_l, packing.particles),
            np.vstack([links.image_ld, [[0, 0]]]),
            np.append(links.length_l, np.linalg.norm(place - packing.position_nd[bead])),
        ),
    )


def test_loose_end_of_a_chain_rattles_while_the_rest_is_held(linked):
    packing = with_end(linked("equilibrium_chain_2d")[0].packing, 0, 1.0)
    found = pm.find_rattling_clusters(packing)
    assert np.flatnonzero(found.rattling_n).tolist() == [10]
    assert np.flatnonzero(found.dangling_n).tolist() == [10] and not found.rattling_cluster_n.any()


def test_linear_program_and_the_forces_at_rest_agree(linked):
    scene, _ = linked("jammed_trimer_fixedbox")
    packing = scene.packing
    # the same touching network with gaps instead of overlaps: no forces to go by
    apart = packing.replace(radius_n=packing.radius_n * (1.0 - 1e-5))
    contacts = pm.find_contacts(apart, gap_tolerance=2e-5)
    assert len(contacts) == len(pm.find_contacts(packing)) and contacts.overlap_c.max() < 0.0
    one, other = pm.find_rattling_clusters(packing), pm.find_rattling_clusters(apart, gap_tolerance=2e-5)
    assert np.array_equal(one.rattling_n, other.rattling_n) and np.array_equal(one.backbone_c, other.backbone_c)


def test_everything_rattles_without_a_backbone():
    links = pm.Links([0, 1, 0], [1, 2, 2], [[0, 0]] * 3, [1.0, 1.0, 2.0**0.5])
    place = [[0, 0], [1, 0], [1, 1], [2, 1.1]]
    touching = pm.Packing(place, [0.5, 0.5, 0.5, 0.6], pm.Box.cubic(9.0, 2), links)
    assert len(pm.find_contacts(touching)) == 1
    found = pm.find_rattling_clusters(touching)
    assert found.empty and found.rattling_cluster_n.all() and not found.backbone_c.any()
    assert np.flatnonzero(found.dangling_n).tolist() == [0, 1]


@pytest.mark.parametrize("dimension", [2, 3])
def test_single_particles_rattle_as_their_contact_normals_say(rest_scene, dimension):
    scene = rest_scene(48, 2, 0.88, 3) if dimension == 2 else rest_scene(32, 3, 0.7, 5)
    found = pm.find_rattling_clusters(scene.packing)
    assert np.array_equal(found.rattling_n, pm.find_rattlers(scene.packing))


def test_rattling_does_not_depend_on_where_the_clusters_are_wrapped(linked):
    packing = linked("jammed_trimer_fixedbox")[0].packing
    image = np.random.default_rng(0).integers(-2, 3, size=packing.position_nd.shape)
    moved = packing.replace(
        position_nd=packing.position_nd - image @ packing.box.lattice_dd.T, links=packing.links.moved(image)
    )
    assert np.array_equal(pm.find_rattling_clusters(moved).rattling_n, pm.find_rattling_clusters(packing).rattling_n)


def test_discs_that_are_held_and_pushed_but_turn_together_rattle():
    packing = three_in_a_hole()
    assert not pm.find_rattlers(packing).any()
    found = pm.find_rattling_clusters(packing)
    assert found.backbone_c.all() and np.flatnonzero(found.rattling_n).tolist() == [35, 36, 37]


@pytest.mark.parametrize(("name", "solver"), [("clarabel", "highs"), ("highs", "clarabel")])
def test_a_solver_that_fails_is_replaced_by_the_other(linked, monkeypatch, name, solver):
    def fail(program, tolerance):
        size, rows = len(program.cost), program.equal.shape[0]
        state = Solve(Outcome.INACCURATE, np.nan, status="forced to fail")
        return linear_programs.Solution(np.full(size, np.nan), np.full(rows, np.nan), np.zeros(0), np.nan, state)

    packing = linked("jammed_trimer_fixedbox")[0].packing
    apart = packing.replace(radius_n=packing.radius_n * (1.0 - 1e-5))
    expected = pm.find_rattling_clusters(apart, gap_tolerance=2e-5).rattling_n
    monkeypatch.setattr(rattlers, "SOLVE", {**rattlers.SOLVE, name: fail})
    assert np.array_equal(pm.find_rattling_clusters(apart, gap_tolerance=2e-5).rattling_n, expected)
    monkeypatch.setattr(rattlers, "SOLVE", {name: fail, solver: fail})
    with pytest.raises(np.linalg.LinAlgError, match="forced to fail; forced to fail"):
        pm.find_rattling_clusters(apart, gap_tolerance=2e-5)


@pytest.mark.parametrize("law", ["harmonic", "hertz"])
def test_forces_of_any_law_show_the_backbone_without_a_solver(rest_scene, monkeypatch, law):
    packing = rest_scene(48, 2, 0.88, 3, law).packing
    held, _ = pm.remove_rattlers(packing)
    monkeypatch.setattr(rattlers, "SOLVE", {})
    assert not pm.find_rattling_clusters(held).rattling_n.any()


@pytest.mark.parametrize(
    ("outcome", "part", "told"),
    [(Outcome.CONVERGED, 1.0, True), (Outcome.INACCURATE, 1.0, False), (Outcome.CONVERGED, 0.45, False)],
)
def test_a_program_tells_which_contacts_push_only_if_it_was_solved_and_by_none_or_all(monkeypatch, outcome, part, told):
    crystal = pm.lattice_packing("triangular", repeats=(2, 2))
    rows = distance_rows(pm.find_contacts(crystal, gap_tolerance=1e-9))

    def solve(program, tolerance):
        found = np.full(len(program.cost), part)
        state = Solve(outcome, 0.0, status="as it is told")
        return linear_programs.Solution(found, np.zeros(program.equal.shape[0]), np.zeros(0), 0.0, state)

    monkeypatch.setattr(rattlers, "SOLVE", {"clarabel": solve, "highs": solve})
    none = sp.csr_array((0, rows.shape[1]))
    if told:
        assert rattlers.pushing_rows(rows, none).all()
    else:
        with pytest.raises(np.linalg.LinAlgError, match="as it is told; as it is told"):
            rattlers.pushing_rows(rows, none)


def test_a_balance_shows_a_backbone_only_if_it_balances_and_pushes_everywhere():
    crystal = pm.lattice_packing("triangular", repeats=(2, 2))
    contact = distance_rows(pm.find_contacts(crystal, gap_tolerance=1e-9))
    none, force = sp.csr_array((0, contact.shape[1])), np.ones(contact.shape[0])
    assert rattlers._balance_nearby(rattlers._LinkedRows(contact, none), force)
    # one contact would open where the others close: forces balance if it pulls
    sign = np.ones(len(force))
    sign[3] = -1.0
    turned = sp.csr_array(sp.diags_array(sign) @ contact)
    assert not rattlers._balance_nearby(rattlers._LinkedRows(turned, none), force + 3.0 * sign)
    # one contact alone balances nothing, by however little it pushes
    alone = rattlers._LinkedRows(sp.csr_array(contact[[0]]), none)
    assert not rattlers._balance_nearby(alone, np.ones(1))


def test_particles_that_nothing_holds_together_are_no_group():
    crystal = pm.lattice_packing("triangular", repeats=(3, 3))
    contacts = pm.find_contacts(crystal, gap_tolerance=1e-9)
    assert not rattlers.moving_apart(crystal, contacts).any()
    assert rattlers.moving_apart(crystal, contacts.select(np.arange(1))).all()
