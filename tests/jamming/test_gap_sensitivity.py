"""Facts about what a verdict assumes: gaps, rest, solvers; and when it says that it does not know."""

import functools
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import packmech as pm
from packmech.jamming import classify as jamming
from packmech.jamming.backbone import judge_network
from packmech.jamming.classify import judged_by_fewest
from packmech.jamming.contact_selection import check_rest, select_contacts
from packmech.linalg import linear_programs
from packmech.result import Outcome, Solve

YES, NO, UNKNOWN = "jammed", "not jammed", "ambiguous"
EFFECTS = (pm.Repulsion(),)


@functools.cache
def soft_packing(particles=64, pressure=1e-8, strain="free", seed=3):
    start = pm.random_packing(particles, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.87, seed=seed)
    return pm.jam(pm.Scene(start, EFFECTS), pressure=pressure, strain=strain).packing


def shaken(packing, size, seed=0):
    noise = np.random.default_rng(seed).standard_normal(packing.position_nd.shape)
    return packing.replace(position_nd=packing.position_nd + size * noise)


@pytest.mark.parametrize("pressure", [1e-6, 1e-7, 1e-8, 1e-9])
@pytest.mark.parametrize("strain", ["isotropic", "free"])
def test_verdict_does_not_depend_on_pressure_where_it_is_low(pressure, strain):
    verdict = pm.classify_jamming(pm.Scene(soft_packing(64, pressure, strain), EFFECTS))
    assert (verdict.local, verdict.collective, verdict.strict) == (YES, YES, YES if strain == "free" else NO)
    assert len({level.excess for level in verdict.touching.levels}) == 1


@pytest.mark.parametrize("pressure", [1e-3, 1e-2, 1e-1])
def test_verdict_is_ambiguous_where_pressure_has_closed_gaps(pressure):
    verdict = pm.classify_jamming(pm.Scene(soft_packing(64, pressure, "isotropic"), EFFECTS))
    assert (verdict.collective, verdict.strict) == (UNKNOWN, UNKNOWN)
    assert "off its plateau" in verdict.strictly.reason
    # what a pressure makes of overlaps depends on the law: no pressure is named
    assert "run.report['hard_packing']" in verdict.strictly.reason and "1e-8" not in verdict.strictly.reason
    assert verdict.mechanically_stable


def test_gap_tolerance_asked_for_is_taken_at_its_word():
    packing = soft_packing(64, 1e-3, "isotropic")
    verdict = pm.classify_jamming(packing, gap_tolerance=0.0)
    assert (verdict.touching.rule, verdict.touching.tolerance) == ("given", 0.0)
    assert verdict.collective == YES
    assert verdict.contacts < pm.classify_jamming(packing).contacts


@pytest.mark.parametrize("method", ["certificate", "loads"])
def test_wide_gaps_are_no_contacts_for_sure_even_where_they_are_asked_for(method):
    crystal = pm.lattice_packing("triangular", (4, 4), relative_overlap=-0.04)
    verdict = pm.classify_jamming(crystal, gap_tolerance=0.05, method=method)
    assert [level.contacts for level in verdict.touching.levels] == [0, 48, 48]
    assert (verdict.local, verdict.collective, verdict.strict) == (UNKNOWN, UNKNOWN, UNKNOWN)
    assert "+1 at 5.0e-03, +17 at 5.0e-02" in verdict.strictly.reason
    # as an allowance for errors of the coordinates the same ratio is taken at its word, and pairs that are named always
    near = pm.lattice_packing("triangular", (4, 4), relative_overlap=-0.004)
    assert pm.classify_jamming(near, gap_tolerance=0.005, method=method).strict == YES
    named = pm.find_contacts(crystal, gap_tolerance=0.05)
    assert pm.classify_jamming(crystal, contacts=named, method=method).strict == YES


def test_rule_for_the_gap_tolerance_is_seven_mean_overlaps():
    packing = soft_packing()
    overlap = pm.find_contacts(packing).overlap_c
    touching = select_contacts(packing, None)
    assert touching.tolerance == pytest.approx(7.0 * overlap.mean(), rel=1e-12)
    assert [level.tolerance / touching.tolerance for level in touching.levels] == pytest.approx([0.1, 1.0, 10.0])


def test_crystal_without_overlap_gets_the_least_gap_tolerance():
    touching = select_contacts(pm.lattice_packing("fcc", (2, 2, 2)), None)
    assert touching.tolerance == 1e-9
    assert [level.contacts for level in touching.levels] == [48, 48, 48]


def test_gap_near_the_tolerance_leaves_all_three_answers_open():
    crystal = pm.lattice_packing("triangular", (4, 4), relative_overlap=-5e-9)
    verdict = pm.classify_jamming(crystal)
    assert (verdict.local, verdict.collective, verdict.strict) == (UNKNOWN, UNKNOWN, UNKNOWN)
    assert not verdict.ok


@pytest.mark.parametrize("gap", [5e-8, 1e-6, 1e-3])
def test_gap_beyond_the_tolerance_is_no_contact_and_one_asked_for_is(gap):
    crystal = pm.lattice_packing("triangular", (4, 4), relative_overlap=-gap)
    assert pm.classify_jamming(crystal).strict == NO
    assert pm.classify_jamming(crystal, gap_tolerance=2.0 * gap).strict == YES


def test_one_contact_opened_within_the_tolerances_does_not_shake_a_jammed_crystal():
    # one disc of a compressed crystal is a little smaller: its gaps lie between tolerance and ten times that
    crystal = pm.lattice_packing("triangular", (6, 6))
    radius = crystal.radius_n.copy()
    radius[0] -= 4e-9
    verdict = pm.classify_jamming(crystal.replace(radius_n=radius))
    assert len({level.excess for level in verdict.touching.levels}) == 2
    assert (verdict.collective, verdict.strict) == (YES, YES)
    assert "already" in verdict.strictly.reason


def counting(asked):
    """Return a stand-in for Clarabel that notes the size of what it is asked."""

    def solve(program, tolerance):
        asked.append(len(program.cost))
        return linear_programs.solve_clarabel(program, tolerance)

    return solve


# off the plateau by pairs between the same backbone particles
DENSER = [(32, 1e-4, "free", 1), (64, 1e-4, "free", 2)]


@pytest.mark.parametrize("case", DENSER, ids=str)
def test_loads_on_the_fewest_contacts_answer_for_the_others(monkeypatch, case):
    packing, asked = soft_packing(*case), []
    monkeypatch.setitem(linear_programs.SOLVE, "clarabel", counting(asked))
    verdict = pm.classify_jamming(packing, method="loads")
    few, at, _ = verdict.touching.levels
    assert few.contacts < at.contacts == verdict.contacts and few.particles == at.particles
    assert verdict.first_order_jammed and len(asked) == 1
    monkeypatch.setattr(jamming, "judged_by_fewest", lambda *_: None)
    direct = pm.classify_jamming(packing, method="loads")
    assert len(asked) == 2
    for ours, other in ((verdict.collectively, direct.collectively), (verdict.strictly, direct.strictly)):
        for name in ("verdict", "first_order_jammed", "isostatic_contacts", "states_of_self_stress", "floppy_modes"):
            assert getattr(ours, name) == getattr(other, name)
    certified = pm.classify_jamming(packing)
    assert (certified.collective, certified.strict) == (verdict.collective, verdict.strict)
    assert certified.states_of_self_stress == verdict.states_of_self_stress


def test_fewest_contacts_answer_for_nothing_where_they_do_not_jam():
    packing = soft_packing(*DENSER[0])
    touching = select_contacts(packing, None)
    unjammed = SimpleNamespace(jammed=(True, False))
    found = judged_by_fewest(packing, touching, None, lambda level: unjammed, "free")
    assert found is None


def test_fewest_contacts_are_not_asked_where_they_hold_fewer_particles_or_cannot_jam_strictly():
    def never(level):
        raise AssertionError(level)

    packing = soft_packing(*DENSER[0])
    touching = select_contacts(packing, None)
    few, at, many = touching.levels
    for fewer in (replace(few, particles=few.particles - 1), replace(few, excess=1), at):
        changed = replace(touching, levels=(fewer, at, many))
        assert judged_by_fewest(packing, changed, None, never, "free") is None


@pytest.mark.parametrize("method", ["certificate", "loads"])
def test_network_that_is_the_same_at_two_levels_is_judged_once(monkeypatch, method):
    packing = soft_packing(32, 1e-4, "free", 2)
    levels = select_contacts(packing, None).levels
    assert levels[0].contacts == levels[1].contacts < levels[2].contacts
    judged = []

    def noting(packing, contacts, **others):
        judged.append(len(contacts))
        return judge_network(packing, contacts, **others)

    monkeypatch.setattr(jamming, "judge_network", noting)
    assert pm.classify_jamming(packing, method=method).strict == YES
    assert len(judged) == 1


@pytest.mark.parametrize("size", [1e-12, 1e-10, 1e-9])
def test_packing_not_at_rest_is_ambiguous_and_says_why(size):
    verdict = pm.classify_jamming(shaken(soft_packing(), size))
    assert (verdict.local, verdict.collective, verdict.strict) == (UNKNOWN, UNKNOWN, UNKNOWN)
    assert "not at rest" in verdict.local_reason
    assert verdict.rest.residual > verdict.rest.limit >= 1e-5


def test_rest_may_be_waived():
    packing = shaken(soft_packing(), 1e-10)
    verdict = pm.classify_jamming(packing, rest_tolerance=np.inf)
    assert (verdict.collective, verdict.strict) == (YES, YES)


def test_rest_is_judged_by_the_scene_s_own_law():
    packing = soft_packing()
    assert pm.classify_jamming(pm.Scene(packing, EFFECTS)).strict == YES
    hertz = pm.classify_jamming(pm.Scene(packing, (pm.Repulsion(law=pm.Hertz()),)))
    assert hertz.strict == UNKNOWN
    assert "Hertz" in hertz.strictly.reason
    assert "harmonic, assumed" in pm.classify_jamming(shaken(packing, 1e-9)).strictly.reason


def test_unit_of_energy_does_not_enter():
    packing = soft_packing()
    checks = [check_rest(packing, (pm.Repulsion(law=pm.Harmonic(scale)),), 1e-5) for scale in (1e-12, 1.0, 1e12)]
    assert [check.residual for check in checks] == pytest.approx([checks[1].residual] * 3, rel=1e-6)
    assert [check.limit for check in checks] == pytest.approx([checks[1].limit] * 3, rel=1e-6)


def test_rounding_overlaps_of_a_crystal_are_in_balance():
    crystal = pm.lattice_packing("kagome", (3, 3))
    check = check_rest(crystal, None, 1e-5)
    assert check.residual > 0.1
    assert check.at_rest


def test_residual_is_the_largest_net_force_over_the_mean_contact_force():
    packing = shaken(soft_packing(), 1e-9)
    contacts = pm.find_contacts(packing)
    mean = (contacts.overlap_c / contacts.contact_distance_c).mean()
    largest = np.linalg.norm(pm.forces(pm.Scene(packing, EFFECTS)), axis=1).max()
    assert check_rest(packing, EFFECTS, 1e-5).residual == pytest.approx(largest / mean, rel=1e-9)


def test_given_contacts_are_judged_without_questions():
    packing = shaken(soft_packing(), 1e-9)
    contacts = pm.find_contacts(soft_packing(), gap_tolerance=1e-7)
    verdict = pm.classify_jamming(packing, contacts=contacts)
    assert verdict.rest is None
    assert verdict.touching.rule == "contacts given"
    assert verdict.strict == YES


def fail(program, tolerance):
    found = linear_programs.solve_clarabel(program, tolerance)
    state = Solve(Outcome.INACCURATE, 1.0, status="forced to fail")
    nothing = np.full_like(found.equal_multiplier, np.nan)
    return linear_programs.Solution(0.0 * found.x, nothing, 0.0 * found.below_multiplier, np.nan, state)


@pytest.mark.parametrize("method", ["certificate", "loads"])
def test_solver_that_fails_is_replaced_by_simplex(monkeypatch, method):
    monkeypatch.setitem(linear_programs.SOLVE, "clarabel", fail)
    verdict = pm.classify_jamming(soft_packing(), method=method)
    assert (verdict.collective, verdict.strict) == (YES, YES)


@pytest.mark.parametrize("method", ["certificate", "loads"])
def test_when_every_solver_fails_the_answer_is_ambiguous(monkeypatch, method):
    for name in ("clarabel", "highs"):
        monkeypatch.setitem(linear_programs.SOLVE, name, fail)
    # many states of self stress: which one is wanted must be asked
    verdict = pm.classify_jamming(pm.lattice_packing("triangular", (3, 3), relative_overlap=0.01), method=method)
    assert (verdict.local, verdict.collective, verdict.strict) == (YES, UNKNOWN, UNKNOWN)
    assert "forced to fail" in verdict.strictly.reason
    assert verdict.first_order_jammed is None


def test_the_only_state_of_self_stress_needs_no_solver(monkeypatch):
    for name in ("clarabel", "highs"):
        monkeypatch.setitem(linear_programs.SOLVE, name, fail)
    verdict = pm.classify_jamming(soft_packing())
    assert (verdict.local, verdict.collective, verdict.strict) == (YES, YES, YES)
    assert verdict.contact_force_c.min() > 0
    assert pm.classify_jamming(soft_packing(), method="loads").strict == UNKNOWN


def test_rank_of_a_floppy_crystal_needs_no_solver(monkeypatch):
    for name in ("clarabel", "highs"):
        monkeypatch.setitem(linear_programs.SOLVE, name, fail)
    assert pm.classify_jamming(pm.lattice_packing("kagome", (2, 2))).strict == NO


@pytest.mark.parametrize(
    ("name", "repeats", "overlap", "fixed", "deformable"),
    [
        ("triangular", (3, 3), 0.01, True, True),
        ("triangular", (3, 3), 0.0, True, True),
        ("square", (1, 1), 0.01, True, False),
        ("square", (2, 2), 0.01, False, False),
        ("kagome", (1, 1), 0.01, False, False),
        ("fcc", (2, 2, 2), 0.01, True, True),
    ],
)
def test_stability_of_crystals_by_their_hessian(name, repeats, overlap, fixed, deformable):
    scene = pm.Scene(pm.lattice_packing(name, repeats, relative_overlap=overlap), EFFECTS)
    verdict = pm.classify_jamming(scene)
    assert (verdict.mechanically_stable, verdict.prestress_stable) == (fixed, deformable)


@pytest.mark.parametrize("strain", ["isotropic", "free"])
def test_stability_is_the_sign_of_the_dense_eigenvalues(strain):
    scene = pm.Scene(soft_packing(64, 1e-2, strain), EFFECTS)
    verdict = pm.classify_jamming(scene)
    backbone, _ = pm.remove_rattlers(scene.packing, gap_tolerance=0.0)
    matrix = pm.hessian(scene.replace(packing=backbone), "none").toarray()
    value = np.linalg.eigvalsh(matrix)
    assert np.abs(value[:2]).max() < 1e-12
    assert verdict.mechanically_stable == (value[2] > 1e-10)


def test_triangular_crystal_under_shear_is_stable_in_its_box_only():
    # at xi = 0.3 the shear modulus sqrt3 (1 - 4 xi) / (4 (1 - xi)) of the Cauchy kind is negative; with the volume held
    # the energy's second derivative along a shear is the one of the moduli less the pressure, negative too
    scene = pm.Scene(pm.lattice_packing("triangular", (1, 1), relative_overlap=0.3), EFFECTS)
    verdict = pm.classify_jamming(scene, gap_tolerance=0.0)
    assert verdict.mechanically_stable
    assert not verdict.prestress_stable


def test_without_a_law_stability_is_not_claimed():
    verdict = pm.classify_jamming(soft_packing())
    assert verdict.mechanically_stable is None
    assert verdict.prestress_stable is None


@pytest.mark.parametrize("law", [pm.Harmonic(), pm.RepulsiveLennardJones()])
def test_coincident_centers_are_not_at_rest(law):
    packing = pm.Packing([[1.0, 1.0], [1.0, 1.0], [1.4, 1.0]], [0.5] * 3, pm.Box.cubic(3.0, 2))
    verdict = pm.classify_jamming(pm.Scene(packing, (pm.Repulsion(law=law),)))
    assert (verdict.local, verdict.collective, verdict.strict) == (UNKNOWN, UNKNOWN, UNKNOWN)
    assert verdict.mechanically_stable is None


WRONG = [
    ({"method": "guess"}, ValueError, "method must be one of 'certificate', 'loads', got 'guess'"),
    ({"solver": "abacus"}, ValueError, "solver must be one of 'clarabel', 'cvxpy', 'highs', got 'abacus'"),
    ({"strain": "none"}, ValueError, "strain must be one of 'free', 'isochoric', got 'none'"),
    ({"bound": "cone"}, ValueError, "bound must be one of 'ball', 'box', got 'cone'"),
    ({"gap_tolerance": np.nan}, ValueError, "gap_tolerance must be a finite number"),
    ({"gap_tolerance": "small"}, TypeError, "gap_tolerance must be a finite number"),
    ({"rest_tolerance": 0.0}, ValueError, "rest_tolerance must be a number, perhaps infinite, above 0, got 0.0"),
    ({"tolerance": -1.0}, ValueError, "tolerance must be a finite number above 0"),
    ({"seed": -1}, ValueError, "seed must be an integer at least 0, got -1"),
    ({"contacts": 7}, TypeError, "contacts must be a Contacts, got 7"),
]


@pytest.mark.parametrize(("changes", "error", "message"), WRONG)
def test_wrong_argument_is_named(changes, error, message):
    with pytest.raises(error, match=message):
        pm.classify_jamming(pm.lattice_packing("triangular", (2, 2)), **changes)


def test_something_that_is_no_packing_is_refused():
    with pytest.raises(TypeError, match="packing must be a Packing, got 'packing.npz'"):
        pm.classify_jamming("packing.npz")
