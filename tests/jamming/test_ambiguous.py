"""Facts about "ambiguous": it comes exactly where the definition leaves the answer open, by counts made anew here.

The pairs within a tenth of the gap tolerance, within it, and within ten times it make three networks. Where these have
the same number of contacts beyond the fewest that jam, d (N' - 1) + 1, the answer is that of the network in the middle.
Otherwise "jammed" stands only if the smallest network is jammed too and either its self stress is the only one or the
mean overlap times N'^2 is below 0.1; "not jammed" stands only if the largest network is not jammed either. Strictly
jammed implies collectively jammed.
"""

import functools
import itertools

import numpy as np
import pytest

import packmech as pm
from packmech.linalg import linear_programs
from packmech.result import Outcome, Solve

YES, NO, UNKNOWN = "jammed", "not jammed", "ambiguous"
PRESSURES = [1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9]


@functools.cache
def made(particles, pressure, strain, seed):
    start = pm.random_packing(particles, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.87, seed=seed)
    return pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=pressure, strain=strain).packing


def relative_gaps(packing):
    """Return the gaps of all pairs and images nearer than two contact distances, over the contact distance."""
    d, found = packing.dimension, []
    for image in itertools.product((-1, 0, 1), repeat=d):
        step = packing.box.lattice_dd @ np.array(image)
        vector = packing.position_nd[None, :] - packing.position_nd[:, None] + step
        contact = packing.radius_n[None, :] + packing.radius_n[:, None]
        gap = np.sqrt((vector**2).sum(axis=2)) / contact - 1.0
        i, j = np.nonzero(gap < 1.0)
        first = next((z for z in image if z), 0)
        once = (i < j) | ((i == j) & (first > 0))
        found.append(gap[i[once], j[once]])
    return np.concatenate(found)


def predicted(packing, oracle):
    """Return the collective and the strict answer as the definition has them, and whether the counts agree."""
    packing = packing.wrapped()
    gap = relative_gaps(packing)
    overlap = float(-gap[gap < 0].mean()) if (gap < 0).any() else 0.0
    tolerance = max(7.0 * overlap, 1e-9)
    networks = [pm.find_contacts(packing, gap_tolerance=factor * tolerance) for factor in (0.1, 1.0, 10.0)]
    assert [len(one) for one in networks] == [int((gap <= factor * tolerance).sum()) for factor in (0.1, 1.0, 10.0)]
    backbones = [oracle.held_contacts(one) for one in networks]
    particles = [len(np.unique([one.i_c, one.j_c])) for one in backbones]
    excess = [len(one) - packing.dimension * (n - 1) - 1 for one, n in zip(backbones, particles, strict=True)]
    fewer, at, more = (oracle.answers(packing, one) for one in networks)
    if len(set(excess)) == 1:
        return at, True
    answers = []
    for k, strain in ((0, False), (1, True)):
        if at[k] == YES:
            small = overlap * particles[0] ** 2 < 0.1
            unique = excess[0] == excess[1] and self_stresses(packing, backbones[1], strain) == 1
            answers.append(YES if fewer[k] == YES and (small or unique) else UNKNOWN)
        else:
            answers.append(NO if more[k] == NO else UNKNOWN)
    if answers[1] == YES:
        answers[0] = YES
    if answers[0] == NO:
        answers[1] = NO
    return tuple(answers), False


def self_stresses(packing, contacts, strain):
    """Return the number of independent balances of contacts, and a pressure if strains are asked for, by dense rank."""
    d = packing.dimension
    rows = pm.rigidity_matrix(packing, "free" if strain else "none", contacts=contacts).toarray()
    if strain:
        volume = np.zeros((1, rows.shape[1]))
        volume[0, packing.particles * d :][:d] = 1.0
        rows = np.vstack([rows, volume])
    return len(rows) - int(np.linalg.matrix_rank(rows, tol=1e-6))


SWEEP = list(itertools.product([32], PRESSURES, ["isotropic", "free"], [1]))
# off the plateau, and sure: pairs in doubt that the jammed network does without
SURE = [(32, 1e-4, "free", 2), (32, 1e-5, "isotropic", 2), (64, 1e-5, "isotropic", 2)]
LONG = list(itertools.product([32, 64, 128], PRESSURES, ["isotropic", "free"], [1, 2]))


@pytest.mark.parametrize("case", SWEEP, ids=str)
def test_ambiguous_comes_exactly_where_the_definition_leaves_the_answer_open(case, simplex_oracle):
    expected, level = predicted(made(*case), simplex_oracle)
    for method in ("certificate", "loads"):
        verdict = pm.classify_jamming(made(*case), method=method)
        assert (verdict.collective, verdict.strict) == expected
        assert verdict.touching.on_plateau == level


@pytest.mark.parametrize("case", SURE, ids=str)
def test_jammed_stands_off_the_plateau_where_the_pairs_in_doubt_cannot_matter(case, simplex_oracle):
    answers = (YES, YES if case[2] == "free" else NO)
    assert predicted(made(*case), simplex_oracle) == (answers, False)
    verdict = pm.classify_jamming(made(*case))
    assert (verdict.collective, verdict.strict) == answers and not verdict.touching.on_plateau


@pytest.mark.slow
@pytest.mark.parametrize("case", LONG, ids=str)
def test_ambiguous_comes_exactly_there_in_every_packing_of_a_long_sweep(case, simplex_oracle):
    expected, level = predicted(made(*case), simplex_oracle)
    verdict = pm.classify_jamming(made(*case))
    assert (verdict.collective, verdict.strict) == expected
    assert verdict.touching.on_plateau == level


@pytest.mark.parametrize("strain", ["isotropic", "free"])
def test_32_discs_are_surely_jammed_up_to_a_pressure_of_1e_minus_5_and_in_doubt_from_1e_minus_4(strain):
    answers = [pm.classify_jamming(made(32, pressure, strain, 1)).collective for pressure in PRESSURES]
    assert answers == [UNKNOWN] * 2 + [YES] * 5


def test_gap_tolerance_asked_for_is_never_off_its_plateau_and_gives_one_answer_all_along_it():
    packing = made(32, 1e-8, "isotropic", 1)
    inner, _ = pm.remove_rattlers(packing, gap_tolerance=1e-7)
    near = np.sort(relative_gaps(inner.wrapped()))
    # the first gap that is no contact ends the plateau
    end, touching = near[near > 1e-7][0], int((near <= 1e-7).sum())
    for tolerance in np.geomspace(1e-12, 0.99 * end, 15):
        verdict = pm.classify_jamming(packing, gap_tolerance=tolerance)
        assert verdict.touching.rule == "given"
        assert (verdict.local, verdict.collective, verdict.strict, verdict.contacts) == (YES, YES, NO, touching)
    beyond = pm.classify_jamming(packing, gap_tolerance=1.01 * end)
    assert beyond.ok and beyond.contacts > touching
    # tolerances below the weakest overlaps delete contacts that bear force
    assert pm.classify_jamming(packing, gap_tolerance=0.99 * near[touching // 2]).collective == NO
    rule = pm.classify_jamming(packing).touching
    assert rule.on_plateau and 10.0 * rule.tolerance < end


@pytest.mark.parametrize("factor", [0.05, 0.3, 3.0, 30.0])
def test_one_gap_decides_and_is_ambiguous_only_within_a_decade_of_the_tolerance(factor, simplex_oracle):
    # hard particles at 1e-9; a disc a little too small, on which all the others depend
    packing = made(32, 1e-9, "isotropic", 1)
    verdict = pm.classify_jamming(packing)
    assert verdict.states_of_self_stress["none"] == 1
    held = int(np.flatnonzero(verdict.backbone)[0])
    radius = packing.radius_n.copy()
    radius[held] -= factor * verdict.touching.tolerance * 0.8
    other = packing.replace(radius_n=radius)
    expected, _ = predicted(other, simplex_oracle)
    answer = pm.classify_jamming(other, rest_tolerance=np.inf)
    assert (answer.collective, answer.strict) == expected
    assert (UNKNOWN in expected) == (factor in (0.3, 3.0))


@pytest.mark.parametrize("share", [1e-7, 1e-6, 1e-4, 1e-2])
def test_packing_not_at_rest_is_ambiguous_exactly_above_the_rest_tolerance(share):
    packing = made(32, 1e-6, "free", 1)
    push = np.random.default_rng(0).standard_normal(packing.position_nd.shape)
    shaken = packing.replace(position_nd=packing.position_nd + share * 1e-6 * push)
    forces = np.linalg.norm(pm.forces(pm.Scene(shaken, (pm.Repulsion(),))), axis=1)
    contacts = pm.find_contacts(shaken)
    residual = forces.max() / (contacts.overlap_c / contacts.contact_distance_c).mean()
    verdict = pm.classify_jamming(shaken)
    assert (verdict.local == UNKNOWN) == (residual > 1e-5) == (share > 1e-5)
    if residual > 1e-5:
        assert (verdict.collective, verdict.strict) == (UNKNOWN, UNKNOWN)
    assert pm.classify_jamming(shaken, rest_tolerance=2.0 * residual + 1e-5).collective == YES


def lying(outcome, garble):
    """Return a stand-in for Clarabel that returns garbled numbers and says of them what it likes."""

    def solve(program, tolerance):
        found = linear_programs.solve_clarabel(program, tolerance)
        says = Solve(outcome, 0.0, gap=0.0, status="forced")
        numbers = (garble(found.x), garble(found.equal_multiplier), garble(found.below_multiplier))
        return linear_programs.Solution(*numbers, found.value, says)

    return solve


GARBLED = {
    "zeros": lambda x: 0.0 * x,
    "turned round": lambda x: -x,
    "numbers that are none": lambda x: np.full_like(x, np.nan),
    "noise": lambda x: np.random.default_rng(0).standard_normal(x.shape),
    "untouched": lambda x: x,
}


@functools.cache
def cases():
    """Return contacts and answers of a packing made, of the same less a contact, and of a crystal that slides."""
    packing = made(32, 1e-8, "isotropic", 1)
    verdict = pm.classify_jamming(packing)
    whole = verdict.touching.contacts
    gone = np.flatnonzero(~verdict.rattlers[whole.i_c] & ~verdict.rattlers[whole.j_c])[7]
    less = whole.select(np.arange(len(whole)) != gone)
    square = pm.lattice_packing("square", (3, 3))
    rows = pm.find_contacts(square, gap_tolerance=1e-9)
    return [(packing, whole, (YES, NO)), (packing, less, (NO, NO)), (square, rows, (NO, NO))]


@pytest.mark.parametrize("both", [False, True], ids=["one solver", "both solvers"])
@pytest.mark.parametrize("garbled", GARBLED)
@pytest.mark.parametrize("outcome", [Outcome.CONVERGED, Outcome.INFEASIBLE, Outcome.INACCURATE])
@pytest.mark.parametrize("method", ["certificate", "loads"])
def test_solver_that_reports_the_wrong_status_never_leads_to_a_wrong_verdict(
    monkeypatch, method, outcome, garbled, both
):
    expected = cases()
    for name in ("clarabel", "highs") if both else ("clarabel",):
        monkeypatch.setitem(linear_programs.SOLVE, name, lying(outcome, GARBLED[garbled]))
    for packing, contacts, answers in expected:
        verdict = pm.classify_jamming(packing, contacts=contacts, method=method)
        for answer, right in zip((verdict.collective, verdict.strict), answers, strict=True):
            assert answer in (right, UNKNOWN)
            if not both:
                # the other solver tells
                assert answer == right


@pytest.mark.parametrize("method", ["certificate", "loads"])
def test_empty_backbone_is_not_jammed_for_sure_and_ambiguous_where_gaps_might_fill_it(method):
    for gap, expected in ((1e-3, NO), (5e-9, UNKNOWN), (5e-10, UNKNOWN), (5e-11, YES)):
        crystal = pm.lattice_packing("triangular", (3, 3), relative_overlap=-gap)
        verdict = pm.classify_jamming(crystal, method=method)
        assert (verdict.local, verdict.collective, verdict.strict) == (expected,) * 3
        assert ("empty backbone" in verdict.collectively.reason) == (expected == NO)
