"""Facts about the verdict as a whole: what is local, what is taken out, and how it reads."""

import dataclasses
import functools
import json
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sp
from hard_cases.jamming import three_in_a_hole
from scipy.optimize import linprog

import packmech as pm
from packmech.contacts.rattlers import _is_free
from packmech.jamming.backbone import _largest_group
from packmech.jamming.classify import settle
from packmech.jamming.contact_selection import check_rest
from packmech.jamming.motion_cone import motion_cone
from packmech.jamming.programs import open_all
from packmech.jamming.verdict import verdict_numbers
from packmech.view.report import examine, result_rows

YES, NO, OPEN = "jammed", "not jammed", "ambiguous"
METHODS = ["certificate", "loads"]
EFFECTS = (pm.Repulsion(),)


@functools.cache
def soft(pressure=1e-7):
    return pm.jam(
        pm.Scene(pm.random_packing(32, dimension=2, packing_fraction=0.86, seed=3), EFFECTS), pressure=pressure
    )


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("name", "repeats"), [("square", (3, 3)), ("honeycomb", (2, 2)), ("kagome", (2, 2))])
def test_crystals_that_hold_each_particle_and_no_group_are_jammed_locally_only(name, repeats, method):
    verdict = pm.classify_jamming(pm.lattice_packing(name, repeats), method=method)
    assert (verdict.local, verdict.collective, verdict.strict) == (YES, NO, NO)
    assert not verdict.rattlers.any()


def test_local_says_no_more_than_that_some_particles_hold_one_another():
    """A disc in the hole of a honeycomb rattles; the verdict is on the others."""
    crystal = pm.lattice_packing("honeycomb", (3, 3))
    side = 2.0 * crystal.radius_n[0]
    contacts = pm.find_contacts(crystal, gap_tolerance=1e-9)
    normal = contacts.normal_cd[np.flatnonzero(contacts.i_c == 0)[0]]
    free = pm.Packing(
        np.vstack([crystal.position_nd, crystal.position_nd[0] - side * normal]),
        np.append(crystal.radius_n, 0.2 * side),
        crystal.box,
    )
    verdict = pm.classify_jamming(free)
    assert verdict.local == YES and np.flatnonzero(verdict.rattlers).tolist() == [crystal.particles]
    # no link holds it: it is a rattler and dangles from nothing
    assert not verdict.danglers.any() and not pm.find_rattling_clusters(free).dangling_n.any()


@pytest.mark.parametrize(
    ("degrees", "held"),
    [
        ((0, 180), False),
        ((0, 90, 180), False),
        ((0, 180, 271), False),
        ((0, 90, 180, 270), True),
        ((0, 120, 240), True),
        ((0, 91, 181), True),
        ((0, 89, 179), False),
    ],
)
def test_contacts_hold_a_disc_unless_a_half_plane_holds_all_of_them(degrees, held):
    """Contacts that all lie in a closed half plane leave the disc free to move along its edge or away from it."""
    angle = np.radians(degrees)
    place = np.vstack([[0.0, 0.0], np.stack([np.cos(angle), np.sin(angle)], axis=1)])
    star = pm.Packing(place, [0.7, *[0.3] * len(angle)], pm.Box.cubic(20.0, 2))
    contacts = pm.find_contacts(star, gap_tolerance=1e-9)
    assert len(contacts) == len(degrees) and not contacts.i_c.any()
    assert _is_free(contacts.normal_cd, 2, *np.empty((3, len(contacts))), len(contacts)) is not held


@pytest.mark.parametrize("method", METHODS)
def test_discs_that_are_held_and_pushed_but_turn_together_rattle_while_the_crystal_is_jammed(method):
    verdict = pm.classify_jamming(three_in_a_hole(), method=method)
    assert (verdict.local, verdict.collective, verdict.strict) == (YES, YES, YES)
    assert np.flatnonzero(verdict.rattlers).tolist() == [35, 36, 37]
    assert verdict.contacts == 102


@pytest.mark.parametrize(("name", "repeats"), [("square", (3, 3)), ("honeycomb", (2, 2)), ("kagome", (2, 2))])
def test_taking_out_what_loads_move_until_nothing_is_left_is_not_jammed(name, repeats):
    verdict = pm.classify_jamming(pm.lattice_packing(name, repeats), method="loads")
    assert str(verdict.collectively) == str(verdict.strictly) == "not jammed (empty backbone)"
    assert "nothing is left when what moves is taken out" in verdict.collectively.reason


def test_a_group_at_rest_is_not_split_by_the_edge_of_a_cell():
    for at in (0.0, 0.25, 0.5, 0.75):
        place = np.vstack([np.full((9, 2), at) + 1e-3 * np.linspace(-1, 1, 18).reshape(9, 2), [[7.0, 7.0], [9.0, 0.0]]])
        assert _largest_group(place).tolist() == [True] * 9 + [False] * 2


def test_certificate_shows_its_duality_gap_and_what_solvers_said():
    answer = pm.classify_jamming(soft().packing).strictly
    whole = pm.classify_jamming(soft().packing)
    decided = whole.strictly if whole.strict == YES else whole.collectively
    assert decided.gap <= 1e-8 and "only state of self stress: Solved" in decided.status
    assert "Lanczos" in answer.status


def test_verdict_reads_as_one_line_for_each_answer_with_its_grounds():
    text = str(pm.classify_jamming(pm.Scene(soft().packing, EFFECTS)))
    lines = {line.partition("  ")[0]: line for line in text.splitlines()}
    assert list(lines) == [
        "locally jammed",
        "collectively jammed",
        "strictly jammed",
        "mechanically stable",
        "touching",
        "at rest",
        "backbone",
        "method",
    ]
    assert "smallest force" in lines["collectively jammed"]
    assert "max(7 x mean overlap, 1e-09)" in lines["touching"] and "at ten times" in lines["touching"]
    assert "Harmonic" in lines["at rest"]


def test_ambiguous_verdict_reads_with_its_reason_and_what_the_contacts_alone_would_say():
    packing = soft().packing
    noise = 1e-9 * np.random.default_rng(0).standard_normal(packing.position_nd.shape)
    text = str(pm.classify_jamming(packing.replace(position_nd=packing.position_nd + noise)))
    assert text.count("ambiguous") == 3 and text.count("not at rest: the largest net force is") == 2
    assert text.count("box free to deform, strain free; for the same reason") == 1
    assert "by the contacts as taken: jammed to first order" in text


def test_every_number_of_a_verdict_is_plain_json():
    verdict = pm.classify_jamming(pm.Scene(soft().packing, EFFECTS))
    numbers = json.loads(json.dumps(verdict_numbers(verdict)))
    assert numbers["rattling_particles"] == np.flatnonzero(verdict.rattlers).tolist()
    assert [level["excess"] for level in numbers["gap_levels"]] == [one.excess for one in verdict.touching.levels]
    assert numbers["rest"]["residual"] == verdict.rest.residual and numbers["at_rest"] is True


def test_report_prints_the_verdict_s_rows():
    report = examine(pm.Scene(soft().packing, EFFECTS), modes=0)
    rows = {name: value for name, value, _ in result_rows(report.numbers, report.missing)}
    assert rows["locally jammed"] == report.verdict.local and rows["collectively jammed"] == report.verdict.collective
    assert rows["at rest"] == "yes" and rows["touching"].startswith("up to")


def test_gap_tolerance_is_seven_mean_overlaps_over_the_touching_pairs():
    packing = soft().packing
    overlap = pm.find_contacts(packing).overlap_c
    touching = pm.classify_jamming(packing).touching
    assert touching.tolerance == max(7.0 * overlap[overlap > 0].mean(), 1e-9)
    assert [level.tolerance / touching.tolerance for level in touching.levels] == pytest.approx([0.1, 1.0, 10.0])


@pytest.mark.parametrize("law", [pm.Harmonic(), pm.Hertz(), pm.RepulsiveLennardJones()])
def test_rest_compares_the_largest_net_force_with_the_mean_contact_force_of_the_law(law):
    packing = soft(1e-4).packing
    effects = (pm.Repulsion(law=law),)
    check = check_rest(packing, effects, 1e-5)
    contacts = pm.find_contacts(packing)
    contacts = contacts.select(contacts.overlap_c > 0)
    push = [law.first(r, s) for r, s in zip(contacts.distance_c, contacts.contact_distance_c, strict=True)]
    largest = np.linalg.norm(pm.forces(pm.Scene(packing, effects)), axis=1).max()
    assert check.residual == pytest.approx(largest / np.abs(push).mean(), rel=1e-9, abs=1e-13)
    assert check.limit == max(1e-5, 8.0 * check.floor)


def supported(cone):
    """Return which contacts bear force, by the support program: max sum u, R^T (u + v) + H^T m = 0, u <= 1."""
    count, held = cone.opening.shape[0], cone.held.shape[0]
    balance = sp.csr_array(sp.hstack([cone.opening.T, cone.opening.T, cone.held.T, cone.one_sided.T]))[cone.dimension :]
    bounds = [(0, 1)] * count + [(0, None)] * count + [(None, None)] * held + [(0, None)] * cone.one_sided.shape[0]
    cost = np.concatenate([-np.ones(count), np.zeros(balance.shape[1] - count)])
    found = linprog(cost, A_eq=balance, b_eq=np.zeros(balance.shape[0]), bounds=bounds, method="highs-ipm")
    assert found.status == 0 and np.abs(found.x[:count] - 0.5).min() > 0.4
    return found.x[:count] > 0.5


@pytest.mark.parametrize("strain", ["none", "free"])
@pytest.mark.parametrize("share", [1.0, 0.9, 0.6])
@pytest.mark.parametrize("name", ["triangular", "kagome", "fcc", "linked"])
def test_opening_program_finds_the_contacts_of_the_support_program(linked, name, share, strain):
    if name == "linked":
        packing = linked("jammed_dimer_strain")[0].packing
    else:
        packing = pm.lattice_packing(name, (2, 2, 2) if name == "fcc" else (3, 3))
    contacts = pm.find_contacts(packing, gap_tolerance=1e-9)
    kept = np.random.default_rng(7).random(len(contacts)) <= share
    cone = motion_cone(packing, contacts.select(kept), strain=strain)
    assert np.array_equal(open_all(cone).carrying_c, supported(cone))


@pytest.mark.parametrize(("more_is_strict", "strict"), [(False, NO), (True, OPEN), (None, OPEN)])
def test_not_strictly_jammed_off_the_plateau_stands_only_if_no_part_of_the_widest_network_is(more_is_strict, strict):
    verdict = pm.classify_jamming(pm.lattice_packing("square", (1, 1)))
    assert (verdict.collective, verdict.strict) == (YES, NO)
    few, at, many = verdict.touching.levels
    levels = (few, at, dataclasses.replace(many, excess=many.excess + 1))
    touching = dataclasses.replace(verdict.touching, levels=levels, rule="max(7 x mean overlap, 1e-09)")
    answers = settle(
        verdict.collectively,
        verdict.strictly,
        touching,
        verdict.rest,
        lambda contacts: SimpleNamespace(jammed=(True, more_is_strict)),
    )
    assert [answer.verdict for answer in answers] == [YES, strict]
