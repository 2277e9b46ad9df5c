"""Facts about the answers of the load programs: the projection that gives them, and the multipliers that prove them."""

import pathlib
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import packmech as pm
from packmech.jamming import programs
from packmech.jamming.certificates import EARLY, borne, turned_round, yield_to_loads
from packmech.jamming.contact_selection import backbone_contacts
from packmech.jamming.motion_cone import motion_cone
from packmech.jamming.programs import largest_smallest_force, load_gap, open_all, yield_to_load
from packmech.linalg import linear_programs
from packmech.result import Outcome, Solve

HARD = np.load(pathlib.Path(__file__).parents[1] / "golden" / "hard_packings.npz")
WAYS = [("clarabel", "ball"), ("clarabel", "box"), ("highs", "box"), ("cvxpy", "ball"), ("cvxpy", "box")]


def cone_of(name, without=None, strain="free"):
    parts = (HARD[f"{name}/{part}"] for part in ("position_nd", "radius_n", "lattice_dd"))
    position, radius, lattice = parts
    packing = pm.Packing(position, radius, pm.Box(lattice))
    network = backbone_contacts(pm.find_contacts(packing, gap_tolerance=1e-9))
    if without is not None:
        network = network.select(np.arange(len(network)) != without)
    return motion_cone(packing, network, strain=strain if "free" in name else "none")


def load_of(cone, seed=1):
    load = cone.without_translations(np.random.default_rng(seed).standard_normal(cone.unknowns))
    return load / np.linalg.norm(load)


CONES = [("2d-64-shape-fixed-0", None), ("2d-64-shape-fixed-0", 17), ("2d-32-shape-free-2", 3)]


@pytest.mark.parametrize("strain", ["free", "isochoric"])
@pytest.mark.parametrize(("name", "without"), CONES)
@pytest.mark.parametrize(("solver", "bound"), WAYS)
def test_multipliers_prove_the_answer(name, without, strain, solver, bound):
    cone = cone_of(name, without, strain)
    _, solve, _ = yield_to_load(cone, load_of(cone), solver=solver, bound=bound)
    assert abs(solve.gap) * np.sqrt(cone.unknowns) < 1e-4


@pytest.mark.parametrize("bound", ["ball", "box"])
def test_gap_of_any_multipliers_bounds_how_much_farther_a_motion_goes(bound):
    cone = cone_of("2d-64-shape-fixed-0", without=17)
    load, rng = load_of(cone), np.random.default_rng(2)
    best, _, _ = yield_to_load(cone, load, solver="cvxpy", bound=bound)
    for share in (0.0, 0.3, 1.0):
        weight = rng.uniform(-0.1, 1.0, cone.rows.shape[0])
        assert load @ (share * best) - load @ best < load_gap(cone, load, share * best, weight, bound) + 1e-7


@pytest.mark.parametrize("name", ["2d-64-shape-fixed-0", "2d-32-shape-free-2", "3d-32-shape-fixed-0"])
@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_direction_of_the_projection_is_the_answer_of_the_program_as_printed(name, sign):
    cone = cone_of(name, without=3)
    projected, _, _ = yield_to_load(cone, sign * load_of(cone))
    printed, _, _ = yield_to_load(cone, sign * load_of(cone), solver="cvxpy")
    assert abs(np.linalg.norm(projected) - 1.0) < 1e-12
    assert np.abs(projected - printed).max() < 1e-4
    assert load_of(cone) @ (sign * (projected - printed)) < 1e-6


@pytest.mark.parametrize("name", ["2d-64-shape-fixed-0", "2d-32-shape-free-2", "3d-64-shape-free-0"])
def test_projection_leaves_a_jammed_packing_a_motion_below_a_billionth(name):
    cone = cone_of(name)
    assert np.linalg.norm(yield_to_load(cone, load_of(cone))[0]) < 1e-9


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_length_of_the_load_and_its_translation_do_not_matter(scale):
    cone = cone_of("2d-64-shape-fixed-0", without=17)
    load = load_of(cone)
    push = scale * (load + np.tile([3.0, -1.0], len(cone.kept_n)))
    assert np.abs(yield_to_load(cone, push)[0] - yield_to_load(cone, load)[0]).max() < 1e-8


def forced(garble_x, garble_multiplier, outcome=Outcome.CONVERGED):
    """Return a stand-in for Clarabel that claims `outcome` and garbles the answer."""

    def solve(program, tolerance):
        found = linear_programs.solve_clarabel(program, tolerance)
        state = Solve(outcome, 0.0, status="forced")
        x, multiplier = garble_x(found.x), garble_multiplier(found.below_multiplier)
        return linear_programs.Solution(x, found.equal_multiplier, multiplier, found.value, state)

    return solve


@pytest.mark.parametrize("without", [None, 17])
@pytest.mark.parametrize(
    ("garble_x", "garble_multiplier"),
    [
        (lambda x: 0.0 * x, lambda z: 0.0 * z),
        (lambda x: x, lambda z: -z),
        (lambda x: x + np.arange(len(x)), lambda z: z),
    ],
    ids=["claims rest", "wrong multipliers", "wrong motion"],
)
def test_solver_that_calls_a_wrong_point_solved_is_not_believed(monkeypatch, without, garble_x, garble_multiplier):
    monkeypatch.setitem(linear_programs.SOLVE, "clarabel", forced(garble_x, garble_multiplier))
    finding = yield_to_loads(cone_of("2d-64-shape-fixed-0", without), np.random.default_rng(0))
    assert finding.jammed is (without is None)
    # right multipliers prove that a load moves nothing, whatever motion comes with them
    right = without is None and garble_multiplier(1.0) == 1.0
    assert any("HiGHS" in solve.status for solve in finding.solves) is not right


def test_proven_answer_stands_though_the_solver_doubts_it(monkeypatch):
    monkeypatch.setitem(linear_programs.SOLVE, "clarabel", forced(lambda x: x, lambda z: z, outcome=Outcome.INACCURATE))
    finding = yield_to_loads(cone_of("2d-64-shape-fixed-0"), np.random.default_rng(0))
    assert finding.jammed is True
    assert finding.solves[0].status == "forced" and "turned round" in finding.solves[1].status
    assert len(finding.solves) == 2


JAMMED = ["2d-64-shape-fixed-0", "2d-32-shape-free-2", "3d-32-shape-fixed-0", "3d-64-shape-free-0"]


def pressing(cone):
    """Return which rows' multipliers may not be negative."""
    free = np.zeros(cone.rows.shape[0], dtype=bool)
    free[cone.opening.shape[0] : cone.opening.shape[0] + cone.held.shape[0]] = True
    return ~free


@pytest.mark.parametrize("strain", ["free", "isochoric"])
@pytest.mark.parametrize("name", JAMMED)
def test_rough_multipliers_are_made_forces_that_bear_the_load_and_others_that_bear_its_opposite(name, strain):
    cone = cone_of(name, strain=strain)
    load = load_of(cone)
    weight, longest = borne(cone, load, yield_to_load(cone, load, tolerance=EARLY).weight)
    opposite, farthest = turned_round(cone, load, weight)
    for forces, push, length in ((weight, load, longest), (opposite, -load, farthest)):
        assert forces[pressing(cone)].min() > 0.0
        assert np.linalg.norm(cone.without_translations(cone.rows.T @ forces - push)) < 1e-9
        assert length < 1e-9


@pytest.mark.parametrize("name", JAMMED)
def test_opposite_load_s_multipliers_from_the_first_say_what_the_solver_says(name):
    cone = cone_of(name)
    load = load_of(cone)
    weight, _ = borne(cone, load, yield_to_load(cone, load).weight)
    assert turned_round(cone, load, weight) is not None
    assert np.linalg.norm(yield_to_load(cone, -load).motion) < 1e-9


@pytest.mark.parametrize("without", [3, 17, 40])
def test_no_multipliers_bear_both_loads_where_a_motion_is_left(without):
    cone = cone_of("2d-64-shape-fixed-0", without)
    both = []
    for sign in (1.0, -1.0):
        load = sign * load_of(cone)
        found = borne(cone, load, yield_to_load(cone, load).weight)
        both.append(found is not None)
        assert found is None or turned_round(cone, load, found[0]) is None
    assert not all(both)


def test_weights_that_bear_nothing_or_are_no_numbers_prove_nothing():
    cone = cone_of("2d-64-shape-fixed-0")
    load = load_of(cone)
    for weight in (np.zeros(cone.rows.shape[0]), np.full(cone.rows.shape[0], np.nan)):
        assert borne(cone, load, weight) is None
    # the least forces bear it, but some pull
    least = cone.bearing(np.zeros(cone.rows.shape[0]), load)
    assert least[pressing(cone)].min() < 0.0
    assert borne(cone, load, least) is None


@pytest.mark.parametrize("name", JAMMED)
def test_jammed_packing_asks_the_solver_once_for_both_loads(monkeypatch, name):
    asked = []

    def counting(program, tolerance):
        asked.append(tolerance)
        return linear_programs.solve_clarabel(program, tolerance)

    monkeypatch.setitem(linear_programs.SOLVE, "clarabel", counting)
    finding = yield_to_loads(cone_of(name), np.random.default_rng(0))
    assert finding.jammed is True and asked == [EARLY] and finding.longest < 1e-9


@pytest.mark.parametrize("bound", ["ball", "box"])
def test_weights_that_bear_a_load_leave_no_gap_though_held_rows_pull_and_the_load_pushes_all(bound):
    cone = cone_of("2d-32-shape-free-2", strain="isochoric")
    weight = np.append(np.ones(cone.opening.shape[0]), -3.0)
    load = cone.rows.T @ weight
    still = np.zeros(cone.unknowns)
    assert cone.held.shape[0] == 1 and load_gap(cone, load, still, weight, bound) < 1e-12
    everywhere = np.zeros(cone.unknowns)
    everywhere[: 2 * len(cone.kept_n)] = 1.0
    assert load_gap(cone, load + everywhere, still, weight, bound) < 1e-12
    # a contact that pulls bears nothing
    weight[0] = -1.0
    assert load_gap(cone, cone.rows.T @ weight, still, weight, bound) > 0.1


@pytest.mark.parametrize(("outcome", "smallest"), [(Outcome.INFEASIBLE, -np.inf), (Outcome.INACCURATE, np.nan)])
def test_programs_that_were_not_solved_have_no_forces_and_no_motion(monkeypatch, outcome, smallest):
    cone, solve = cone_of("2d-32-shape-free-2"), linear_programs.solve_clarabel

    def doubt(program, tolerance):
        found = solve(program, tolerance)
        return replace(found, solve=replace(found.solve, outcome=outcome))

    monkeypatch.setitem(linear_programs.SOLVE, "clarabel", doubt)
    force, opened = largest_smallest_force(cone), open_all(cone)
    assert np.array_equal(force.smallest, smallest, equal_nan=True) and not force.weight.any()
    assert not opened.carrying_c.any() and not opened.weight.any() and not opened.motion.any()


@pytest.mark.parametrize(
    ("status", "outcome"),
    [("optimal", Outcome.CONVERGED), ("infeasible", Outcome.INFEASIBLE), ("user_limit", Outcome.INACCURATE)],
)
def test_a_status_that_is_not_known_is_no_success(status, outcome):
    stats = SimpleNamespace(num_iters=3)
    problem = SimpleNamespace(solve=lambda **named: None, status=status, solver_stats=stats, constraints=[])
    assert programs._solved(problem, 1e-8).outcome is outcome
