"""Facts about the verdict on packings with rigid links."""

import dataclasses
import functools

import numpy as np
import pytest
import scipy.linalg
from scipy.optimize import linprog

import packmech as pm
from packmech.constraints.factor import ConstraintFactor
from packmech.constraints.motion_rules import link_rules
from packmech.contacts.elements import distance_rows
from packmech.jamming.classify import undecided
from packmech.jamming.motion_cone import motion_cone

YES, NO = "jammed", "not jammed"
WAYS = [
    ("certificate", "clarabel"),
    ("certificate", "cvxpy"),
    ("certificate", "highs"),
    ("loads", "clarabel"),
    ("loads", "cvxpy"),
    ("loads", "highs"),
]
every_way = pytest.mark.parametrize(("method", "solver"), WAYS)


def named(mask):
    return np.flatnonzero(mask).tolist()


def keys(contacts):
    return [
        (i, j, *z)
        for i, j, z in zip(contacts.i_c.tolist(), contacts.j_c.tolist(), contacts.image_cd.tolist(), strict=True)
    ]


def with_end(packing, bead):
    """Return the packing with a tiny bead linked to the given one, in a hole: a loose end."""
    packing = packing.wrapped()
    cells = [[a, b] for a in (-2, -1, 0, 1, 2) for b in (-2, -1, 0, 1, 2)]
    others = (packing.position_nd[:, None] + np.array(cells) @ packing.box.lattice_dd.T).reshape(-1, 2)
    radius = np.repeat(packing.radius_n, len(cells))
    grid = packing.position_nd[bead] + np.random.default_rng(1).uniform(-1.0, 1.0, size=(4000, 2))
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


@every_way
def test_two_trimers_held_on_one_bead_each_rotate_freely_while_the_rest_is_jammed(linked, method, solver):
    scene, data = linked("jammed_trimer_fixedbox")
    verdict = pm.classify_jamming(scene, method=method, solver=solver)
    assert verdict.collective == YES and verdict.collectively.first_order_jammed
    assert named(verdict.rattlers) == data["rattling_particles"] == [1, 2, 13, 14]
    assert named(verdict.backbone) == data["backbone_particles"]
    assert named(verdict.danglers) == [1, 2, 13, 14] and not verdict.rattling_clusters.any()
    # 15 - 2 freedoms less translations, 2 of them rotations
    assert verdict.contacts == verdict.collectively.isostatic_contacts == 12
    assert verdict.states_of_self_stress["none"] == data["first_order"]["sss"] == 1


@every_way
@pytest.mark.parametrize("strain", ["free", "isochoric"])
def test_seven_dimers_are_strictly_jammed_with_one_state_of_self_stress(linked, method, solver, strain):
    scene, data = linked("jammed_dimer_strain")
    verdict = pm.classify_jamming(scene, method=method, solver=solver, strain=strain)
    assert (verdict.local, verdict.collective, verdict.strict) == (YES, YES, YES)
    assert verdict.contacts == verdict.isostatic_contacts == len(data["contacts"]) == 22
    assert verdict.states_of_self_stress == {"none": 3, "isochoric": 1}
    assert verdict.first_order_jammed and verdict.prestress_stable and verdict.mechanically_stable
    assert not verdict.rattlers.any()


@every_way
def test_end_of_a_chain_rattles_while_the_rest_is_jammed(linked, method, solver):
    scene, _ = linked("jammed_dimer_strain")
    packing = with_end(scene.packing, 3)
    verdict = pm.classify_jamming(scene.replace(packing=packing), method=method, solver=solver)
    assert (verdict.collective, verdict.strict) == (YES, YES)
    assert named(verdict.rattlers) == named(verdict.danglers) == [14]
    assert named(pm.find_rattlers(packing)) == [14]
    assert verdict.contacts == verdict.isostatic_contacts == 22 and verdict.backbone_links == 7


@every_way
def test_an_all_rattling_packing_is_not_jammed_for_its_empty_backbone(method, solver):
    links = pm.Links([0, 1, 0, 3], [1, 2, 2, 4], [[0, 0]] * 4, [1.0, 1.0, 2.0**0.5, 1.0])
    place = [[0, 0], [1, 0], [1, 1], [2, 1.1], [3, 1.1]]
    packing = pm.Packing(place, [0.5, 0.5, 0.5, 0.6, 0.4], pm.Box.cubic(9.0, 2), links)
    assert len(pm.find_contacts(packing)) == 1
    verdict = pm.classify_jamming(packing, method=method, solver=solver, gap_tolerance=1e-9, rest_tolerance=np.inf)
    for answer in (verdict.collectively, verdict.strictly):
        assert str(answer) == "not jammed (empty backbone)"
    assert verdict.local == NO and named(verdict.rattlers) == named(verdict.rattling_clusters) == [0, 1, 2, 3, 4]
    assert named(verdict.danglers) == named(pm.find_rattling_clusters(packing).dangling_n) == [0, 1, 4]


@functools.cache
def basis_of_motions(scene, strain):
    """Return orthonormal motions, as columns, that keep links and volume and translate nothing, from a dense SVD."""
    packing = scene.packing
    gamma = pm.constraint_jacobian(packing, strain="isochoric" if strain else "none")
    gamma = np.asarray(gamma.todense() if hasattr(gamma, "todense") else gamma)
    d = packing.dimension
    uniform = np.zeros((gamma.shape[0], d))
    uniform[: packing.particles * d] = np.tile(np.eye(d), (packing.particles, 1))
    return scipy.linalg.null_space(np.hstack([gamma, uniform]).T)


def oracle(scene, contacts, strain):
    """Return whether the dense program of section 12 finds no motion, by HiGHS: max sum of openings in the cone."""
    matrix = pm.rigidity_matrix(
        scene.packing, "free" if strain else "none", contacts=contacts
    ).toarray() @ basis_of_motions(scene, strain)
    value = np.linalg.svd(matrix, compute_uv=False)
    if matrix.shape[0] < matrix.shape[1] or value[-1] < 1e-5 * value[0]:
        return False
    found = linprog(
        -matrix.sum(axis=0), A_ub=-matrix, b_ub=np.zeros(len(matrix)), bounds=[(-1.0, 1.0)] * matrix.shape[1]
    )
    assert found.status == 0
    return bool(-found.fun < 1e-7)


@pytest.mark.parametrize("removed", [None, 0, 7, 15, 21])
def test_dense_program_agrees_with_and_without_a_contact(linked, removed):
    scene, _ = linked("jammed_dimer_strain")
    contacts = pm.find_contacts(scene.packing)
    contacts = contacts.select(np.arange(len(contacts)) != (-1 if removed is None else removed))
    verdict = pm.classify_jamming(scene.packing, contacts=contacts, strain="isochoric")
    for answer, strain in ((verdict.collectively, False), (verdict.strictly, True)):
        # a part may be jammed by itself where the whole is not
        assert answer.first_order_jammed == oracle(scene, contacts, strain) or verdict.rattlers.any()
    assert verdict.rattlers.any() <= (not oracle(scene, contacts, False))


@pytest.mark.parametrize("name", ["equilibrium_trimer_2d", "equilibrium_dimer_2d", "equilibrium_dimer_3d"])
@pytest.mark.parametrize("share", [0.5, 0.6, 0.7, 0.85, 1.0])
def test_dense_program_and_every_method_agree_on_parts_of_a_network(linked, name, share):
    scene, _ = linked(name)
    contacts = pm.find_contacts(scene.packing)
    seen = set()
    for seed in range(3):
        kept = np.random.default_rng(seed).permutation(len(contacts))[: round(share * len(contacts))]
        part = contacts.select(np.sort(kept))
        expected = tuple(oracle(scene, part, strain) for strain in (False, True))
        for method in ("certificate", "loads"):
            verdict = pm.classify_jamming(scene.packing, contacts=part, strain="isochoric", method=method)
            if verdict.rattlers.any():
                # what is left may be jammed by itself, the whole is not
                assert expected == (False, False)
            else:
                found = (verdict.collectively.first_order_jammed, verdict.strictly.first_order_jammed)
                assert found == expected
            seen.add((method, verdict.collective, verdict.strict, tuple(named(verdict.rattlers))))
    assert len(seen) % 2 == 0


@pytest.mark.parametrize("name", ["jammed_dimer_strain", "jammed_trimer_fixedbox"])
def test_certificate_balances_contacts_with_links_of_either_sign(linked, name):
    scene, _ = linked(name)
    verdict = pm.classify_jamming(scene)
    answer = verdict.collectively
    push = distance_rows(verdict.network).T @ answer.contact_force_c
    pull = ConstraintFactor(scene.packing).gradient_lx.T @ answer.link_tension_l
    assert np.abs(push - pull).max() < 1e-12 and answer.contact_force_c.min() > 0.0
    assert answer.link_tension_l.min() < 0.0 < answer.link_tension_l.max() or name == "jammed_dimer_strain"


def test_unjamming_motion_keeps_links_and_opens_what_one_contact_less_sets_free(linked):
    scene, _ = linked("jammed_trimer_fixedbox")
    packing = scene.packing
    contacts = pm.find_contacts(packing)
    verdict = pm.classify_jamming(packing, contacts=contacts.select(np.arange(len(contacts)) != 0))
    motion = verdict.unjamming_motion
    assert verdict.collective == NO and motion.closing < 1e-12 < motion.opening
    stretch = ConstraintFactor(packing).gradient_lx @ motion.displacement_nd.ravel()
    assert np.abs(stretch).max() < 1e-12
    moved = motion.moved(packing, 1e-3)
    assert moved.link_error < 1e-13
    # contacts of the backbone close by what is of second order in the amplitude
    deepest = []
    for amplitude in (1e-3, 1e-4):
        now = pm.find_contacts(motion.moved(packing, amplitude), gap_tolerance=0.1)
        gap = dict(zip(keys(now), now.gap_c.tolist(), strict=True))
        deepest.append(min(gap.get(key, np.inf) for key in keys(verdict.network)))
    assert -1e-5 < deepest[0] and deepest[1] > 0.02 * min(deepest[0], -5e-6)


def test_strict_question_of_a_packing_made_in_a_fixed_box_is_answered_by_a_shear_that_keeps_links(linked):
    scene, _ = linked("jammed_trimer_fixedbox")
    verdict = pm.classify_jamming(scene)
    assert verdict.strict == NO and verdict.first_order_jammed is False and verdict.prestress_stable is False
    motion = verdict.unjamming_motion
    assert abs(np.trace(motion.strain_dd)) < 1e-12 < np.abs(motion.strain_dd).max()
    assert motion.moved(scene.packing, 1e-2).link_error < 1e-13


def test_links_around_the_box_forbid_strains(linked):
    """A taut chain of beads along x, and discs beside it: no motion of the cone stretches the box along x."""
    links = pm.Links([0, 1, 0], [1, 2, 2], [[0, 0], [0, 0], [-1, 0]], [1.0, 1.0, 1.0])
    place = [[0.0, 0.0], [1.0, 0.0], [2.0, 0.0], [0.5, 0.9]]
    packing = pm.Packing(place, [0.45, 0.45, 0.45, 0.59], pm.Box([[3.0, 0.0], [0.0, 3.0]]), links)
    contacts = pm.find_contacts(packing)
    cone = motion_cone(packing, contacts, strain="free", kept_n=np.arange(4))
    motion = cone.keeping_rules(np.random.default_rng(0).normal(size=cone.unknowns))
    assert np.abs(cone.held @ motion).max() < 1e-13 and abs(motion[-3]) < 1e-13
    assert (cone.one_sided @ motion).min() > -1e-13
    # two of three links are independent on displacements, the third forbids a strain
    assert cone.link_rows == 2 and cone.held.shape[0] == 3


def test_rattlers_between_held_beads_ask_what_their_links_ask():
    """A taut string of two links through a bead without contacts holds its ends as one link would."""
    box = pm.Box.cubic(9.0, 2)
    string = pm.Packing([[0, 0], [1, 0], [2, 0]], [0.1] * 3, box, pm.Links([0, 1], [1, 2], [[0, 0]] * 2, [1.0, 1.0]))
    rules = link_rules(string, np.array([0, 2]))
    row = rules.position.toarray()[0] / rules.position.toarray()[0, 2]
    assert rules.position.shape[0] == 1 and np.allclose(row, [-1.0, 0.0, 1.0, 0.0], atol=1e-15)
    bent = string.replace(position_nd=[[0, 0], [0.8, 0.6], [1.6, 0.0]])
    assert link_rules(bent, np.array([0, 2])).position.shape[0] == 0


def test_a_motion_that_forces_block_at_second_order_is_left_open(linked):
    scene, _ = linked("jammed_trimer_fixedbox")
    answer = pm.classify_jamming(scene).strictly
    assert (answer.verdict, answer.stable) == (NO, False) and undecided(scene.packing, answer) is answer
    blocked = undecided(scene.packing, dataclasses.replace(answer, stable=True))
    assert (blocked.verdict, blocked.first_order_jammed) == ("ambiguous", False)
    assert "held by the forces at second order" in blocked.reason
    free = pm.lattice_packing("square", (3, 3))
    assert undecided(free, dataclasses.replace(answer, stable=True)).verdict == NO


def crystal_with_string(sag):
    """Return a crystal in which two discs hang on a string through a vacancy between them, and its contacts.

    The contacts that would push the two towards each other are left out: the string must pull instead.
    """
    crystal = pm.lattice_packing("triangular", (6, 6))
    place = crystal.position_nd.copy()
    around = pm.find_contacts(crystal, gap_tolerance=1e-9)
    flat = np.abs(around.normal_cd[:, 1]) < 1e-9
    middle = 14
    sides = [(i, n) for i, j, n in zip(around.i_c, around.j_c, around.normal_cd, strict=True) if j == middle]
    sides += [(j, -n) for i, j, n in zip(around.i_c, around.j_c, around.normal_cd, strict=True) if i == middle]
    (a, toward), (c, _) = [(int(k), n) for k, n in sides if abs(n[1]) < 1e-9]
    assert flat.any() and not around.image_cd[(around.i_c == middle) | (around.j_c == middle)].any()
    place[middle, 1] += sag
    radius = crystal.radius_n.copy()
    radius[middle] *= 0.01
    ends = np.array([[min(a, middle), max(a, middle)], [min(c, middle), max(c, middle)]])
    length = np.linalg.norm(place[ends[:, 0]] - place[ends[:, 1]], axis=1)
    packing = pm.Packing(place, radius, crystal.box, pm.Links(*ends.T, np.zeros((2, 2)), length))
    contacts = pm.find_contacts(packing, gap_tolerance=1e-9)
    outward = {a: -toward, c: toward}
    keep = [
        all(sign * n @ outward[k] < 0.1 for k, sign in ((i, 1.0), (j, -1.0)) if k in outward)
        for i, j, n in zip(contacts.i_c.tolist(), contacts.j_c.tolist(), contacts.normal_cd, strict=True)
    ]
    return packing, contacts.select(np.array(keep)), (a, middle, c)


@pytest.mark.parametrize(("method", "solver"), WAYS[:1] + WAYS[2:4])
def test_taut_string_through_a_rattling_bead_holds_its_ends_and_a_slack_one_does_not(method, solver):
    packing, contacts, (a, middle, c) = crystal_with_string(sag=0.0)
    taut = pm.classify_jamming(packing, contacts=contacts, method=method, solver=solver)
    assert taut.collective == YES and named(taut.rattlers) == [middle] == named(
        pm.find_rattlers(packing, contacts=contacts)
    )
    if method == "certificate":
        tension = taut.collectively.link_tension_l
        assert tension.min() > 0.0 and tension[0] == pytest.approx(tension[1], rel=1e-9)
    packing, contacts, _ = crystal_with_string(sag=0.1 * packing.radius_n.max())
    slack = pm.classify_jamming(packing, contacts=contacts, method=method, solver=solver)
    assert {a, middle, c} <= set(named(slack.rattlers))


def test_verdict_does_not_depend_on_where_clusters_are_wrapped_or_how_they_are_turned(linked):
    scene, _ = linked("jammed_dimer_strain")
    packing = scene.packing
    image = np.random.default_rng(0).integers(-2, 3, size=packing.position_nd.shape)
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    moved = packing.replace(
        position_nd=(packing.position_nd - image @ packing.box.lattice_dd.T) @ turn.T,
        box=pm.Box(turn @ packing.box.lattice_dd),
        links=packing.links.moved(image),
    )
    one, other = pm.classify_jamming(packing), pm.classify_jamming(moved)
    assert (one.collective, one.strict, one.contacts) == (other.collective, other.strict, other.contacts)
    assert one.strictly.smallest_force == pytest.approx(other.strictly.smallest_force, rel=1e-7)


def test_a_single_particle_packing_has_no_fields_of_clusters():
    verdict = pm.classify_jamming(pm.lattice_packing("triangular", (3, 3)))
    assert verdict.cluster_n is None and verdict.collectively.link_tension_l is None
    assert np.array_equal(verdict.rattling_clusters, verdict.rattlers)


@pytest.mark.parametrize("strain", ["none", "isochoric", "free"])
def test_a_motion_that_keeps_the_rules_changes_no_link_and_does_not_enlarge_the_box(linked, strain):
    packing = linked("jammed_trimer_fixedbox")[0].packing
    cone = motion_cone(packing, pm.find_contacts(packing), strain=strain)
    for seed in range(4):
        motion = np.random.default_rng(seed).normal(size=cone.unknowns)
        kept = cone.keeping_rules(motion)
        assert np.abs(cone.held @ motion).max() > 0.1 and np.abs(cone.held @ kept).max() < 1e-14
        assert (cone.one_sided @ kept > -1e-14).all()
        # what keeps them already stays
        assert np.abs(cone.keeping_rules(kept) - kept).max() < 1e-14


@pytest.mark.parametrize("strain", ["isochoric", "free"])
def test_where_links_around_the_box_hold_all_strains_no_rule_for_the_volume_is_left(strain):
    crystal = pm.lattice_packing("triangular", repeats=(4, 4))
    box = crystal.box.lattice_dd
    sides = np.array([[1, 0], [0, 1], [1, -1]])
    hole = crystal.position_nd[0] + (box[:, 0] + box[:, 1]) / 12.0
    links = pm.Links([16] * 3, [16] * 3, sides, np.linalg.norm(sides @ box.T, axis=1))
    packing = pm.Packing(np.vstack([crystal.position_nd, hole]), np.append(crystal.radius_n, 0.02), crystal.box, links)
    cone = motion_cone(packing, pm.find_contacts(packing, gap_tolerance=1e-9), strain=strain)
    rules = np.vstack([cone.held.toarray(), cone.one_sided.toarray()])
    assert len(rules) == cone.bound_rows == np.linalg.matrix_rank(rules) == 3
    kept = cone.keeping_rules(np.random.default_rng(0).normal(size=cone.unknowns))
    assert np.abs(kept[-3:]).max() < 1e-14 and np.abs(kept).max() > 0.1
