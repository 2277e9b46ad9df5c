"""Facts about the cone of motions and the three programs of jamming, against dense algebra and one another."""

import pathlib

import numpy as np
import pytest
from hard_cases.defects import open_contact

import packmech as pm
from packmech.jamming import certificates
from packmech.jamming.certificates import certify, closes_nothing, force_error, kept_open, yield_to_loads
from packmech.jamming.contact_selection import backbone_contacts
from packmech.jamming.motion_cone import motion_cone
from packmech.jamming.programs import largest_smallest_force, open_all, yield_to_load
from packmech.linalg import linear_programs
from packmech.result import Outcome, Solve

HARD = np.load(pathlib.Path(__file__).parents[1] / "golden" / "hard_packings.npz")
SOLVERS = ["clarabel", "cvxpy", "highs"]


def hard_packing(name):
    parts = (HARD[f"{name}/{part}"] for part in ("position_nd", "radius_n", "lattice_dd"))
    position, radius, lattice = parts
    return pm.Packing(position, radius, pm.Box(lattice))


def network_of(packing):
    return backbone_contacts(pm.find_contacts(packing, gap_tolerance=1e-9))


def cone_of(packing, strain="none", without=None):
    network = network_of(packing)
    if without is not None:
        network = network.select(np.arange(len(network)) != without)
    return motion_cone(packing, network, strain=strain)


def dense_singular_values(cone):
    """Return all singular values of the rows on motions without translation."""
    return np.linalg.svd(cone.rows.toarray() @ cone._free_basis, compute_uv=False)


CASES = [
    ("2d-16-shape-fixed-0", "none"),
    ("2d-32-shape-free-2", "free"),
    ("2d-64-shape-fixed-0", "free"),
    ("3d-32-shape-fixed-0", "none"),
]


@pytest.mark.parametrize(("name", "strain"), CASES)
def test_smallest_singular_value_is_that_of_the_dense_matrix(name, strain):
    cone = cone_of(hard_packing(name), strain)
    values = dense_singular_values(cone)
    padded = np.append(values, np.zeros(cone._free_basis.shape[1] - len(values)))
    assert abs(cone.softest()[0] - padded[-1] / values[0]) < 1e-7


@pytest.mark.parametrize("crystal", ["square", "honeycomb", "kagome", "sc", "triangular"])
@pytest.mark.parametrize("strain", ["none", "free"])
def test_floppy_modes_are_the_dense_nullity(crystal, strain):
    cone = cone_of(pm.lattice_packing(crystal, 2 if crystal == "sc" else 4), strain)
    values = dense_singular_values(cone)
    assert cone.floppy_modes() == cone._free_basis.shape[1] - np.count_nonzero(values > 1e-9)


@pytest.mark.parametrize("strain", ["none", "free"])
def test_softest_motion_has_no_translation_and_the_length_it_says(strain):
    cone = cone_of(hard_packing("2d-64-shape-free-0"), strain)
    value, motion = cone.softest()
    assert np.abs(motion[: 2 * len(cone.kept_n)].reshape(-1, 2).mean(axis=0)).max() < 1e-15
    assert abs(np.linalg.norm(cone.rows @ motion) - value * np.sqrt(cone.largest_eigenvalue)) < 1e-12


@pytest.mark.parametrize("name", ["2d-64-shape-free-0", "3d-64-shape-free-0"])
def test_balancing_is_the_orthogonal_projection_on_self_stresses(name):
    cone = cone_of(hard_packing(name), strain="free")
    weight = np.random.default_rng(0).standard_normal(cone.rows.shape[0])
    matrix = cone.rows.toarray()
    expected = weight - matrix @ np.linalg.lstsq(matrix, weight, rcond=None)[0]
    assert np.abs(cone.balanced(weight) - expected).max() < 1e-10


@pytest.mark.parametrize(("name", "strain"), [("2d-64-shape-fixed-0", "none"), ("2d-32-shape-free-2", "free")])
@pytest.mark.parametrize("solver", SOLVERS)
def test_unique_self_stress_is_the_certificate(name, strain, solver):
    cone = cone_of(hard_packing(name), strain)
    values, directions = np.linalg.svd(cone.rows.toarray() @ cone._free_basis)[1:]
    weight = np.linalg.svd((cone.rows.toarray() @ cone._free_basis).T)[2][-1][: cone.opening.shape[0]]
    assert len(values) == cone.rows.shape[0] - 1
    found = largest_smallest_force(cone, solver=solver)
    assert abs(found.smallest - (weight / weight.mean()).min()) < 1e-6


@pytest.mark.parametrize("strain", ["none", "free"])
@pytest.mark.parametrize("solver", SOLVERS)
def test_triangular_crystal_carries_equal_forces(strain, solver):
    found = largest_smallest_force(cone_of(pm.lattice_packing("triangular", 4), strain), solver=solver)
    assert abs(found.smallest - 1.0) < 1e-6


@pytest.mark.parametrize("crystal", ["square", "honeycomb", "kagome"])
def test_positive_self_stress_alone_would_call_a_floppy_crystal_jammed(crystal):
    cone = cone_of(pm.lattice_packing(crystal, 4))
    assert largest_smallest_force(cone).smallest > 0.999
    assert certify(cone).jammed is False


def test_full_rank_alone_would_call_isostatic_minus_one_jammed():
    cone = cone_of(hard_packing("2d-64-shape-fixed-0"), without=17)
    assert cone.floppy_modes() == 0
    assert certify(cone).jammed is False


@pytest.mark.parametrize("solver", SOLVERS)
def test_without_one_contact_every_other_can_open_and_none_carries(solver):
    cone = cone_of(hard_packing("2d-64-shape-fixed-0"), without=17)
    found = open_all(cone, solver=solver)
    assert not found.carrying_c.any()
    assert (cone.opening @ found.motion).min() > 1.0 - 1e-6


@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("strain", ["none", "free"])
def test_contacts_either_carry_force_or_open(solver, strain):
    # a kagome crystal with one bond gone: some lines still carry force
    cone = cone_of(pm.lattice_packing("kagome", 3), strain, without=5)
    found = open_all(cone, solver=solver)
    stretch = cone.opening @ found.motion
    assert 0 < np.count_nonzero(found.carrying_c) < len(stretch)
    assert np.abs(stretch[found.carrying_c]).max() < 1e-6
    assert stretch[~found.carrying_c].min() > 1.0 - 1e-6
    assert np.abs(cone.rows.T @ found.weight).max() < 1e-6


@pytest.mark.parametrize("strain", ["free", "isochoric"])
@pytest.mark.parametrize("solver", SOLVERS)
@pytest.mark.parametrize("program", [largest_smallest_force, open_all])
def test_forces_balance_with_their_multipliers(program, solver, strain):
    cone = cone_of(hard_packing("2d-32-shape-free-2"), strain=strain)
    weight = program(cone, solver=solver).weight
    assert np.abs(cone.rows.T @ weight).max() < 1e-6 * np.abs(weight).max()
    # what presses on a volume that may shrink is a pressure
    assert cone.held.shape[0] or weight[-1] > 0


WAYS = [("clarabel", "ball"), ("clarabel", "box"), ("highs", "box"), ("cvxpy", "ball"), ("cvxpy", "box")]


@pytest.mark.parametrize(("solver", "bound"), WAYS)
def test_loads_leave_a_jammed_packing_at_rest(solver, bound):
    cone = cone_of(hard_packing("2d-64-shape-fixed-0"))
    load = np.random.default_rng(1).standard_normal(cone.unknowns)
    motion, solve, _ = yield_to_load(cone, load, solver=solver, bound=bound)
    assert solve.outcome is Outcome.CONVERGED
    assert np.abs(motion).max() < 1e-5


@pytest.mark.parametrize(("solver", "bound"), WAYS)
def test_motion_of_the_loads_lengthens_contacts_which_the_printed_sign_would_shorten(solver, bound):
    cone = cone_of(hard_packing("2d-64-shape-fixed-0"), without=17)
    load = cone.without_translations(np.random.default_rng(1).standard_normal(cone.unknowns))
    motions = [yield_to_load(cone, sign * load, solver=solver, bound=bound)[0] for sign in (1.0, -1.0)]
    assert max(np.abs(motion).max() for motion in motions) > 0.01
    for motion in motions:
        stretch = cone.opening @ motion
        assert stretch.min() > -1e-6
        assert stretch.max() > 0.001 or np.abs(motion).max() < 1e-5


def test_translation_is_never_the_answer_of_the_loads():
    cone = cone_of(pm.lattice_packing("triangular", 3))
    push = np.tile([1.0, 0.0], 9)
    motion, _, _ = yield_to_load(cone, push)
    assert np.abs(motion).max() < 1e-6


def test_ball_in_the_simplex_method_is_refused():
    cone = cone_of(pm.lattice_packing("triangular", 3))
    with pytest.raises(ValueError, match="bound must be 'box' for the simplex method, got 'ball'"):
        yield_to_load(cone, np.ones(cone.unknowns), solver="highs", bound="ball")


def lying(outcome, garble):
    """Return a stand-in for Clarabel that says `outcome` and returns garbled numbers."""

    def solve(program, tolerance):
        found = linear_programs.solve_clarabel(program, tolerance)
        state = Solve(outcome, 0.0, status="forced")
        return linear_programs.Solution(
            garble(found.x), garble(found.equal_multiplier), garble(found.below_multiplier), found.value, state
        )

    return solve


def crystal():
    """Return the motions of a jammed crystal with many states of self stress, so that the program has to choose."""
    return cone_of(pm.lattice_packing("triangular", 4))


LIES = [Outcome.CONVERGED, Outcome.INFEASIBLE, Outcome.INACCURATE]


@pytest.mark.parametrize("outcome", LIES)
@pytest.mark.parametrize(("without", "jammed"), [(None, True), (17, False)])
def test_wrong_answer_of_a_solver_is_caught_and_simplex_decides(monkeypatch, outcome, without, jammed):
    cone = crystal() if jammed else cone_of(hard_packing("2d-64-shape-fixed-0"), without=without)
    monkeypatch.setitem(linear_programs.SOLVE, "clarabel", lying(outcome, lambda x: 1.0 - 3.0 * x))
    finding = certify(cone)
    assert finding.jammed is jammed
    assert "HiGHS" in finding.solves[-1].status


@pytest.mark.parametrize("outcome", LIES)
def test_wrong_status_alone_does_not_spoil_a_good_certificate(monkeypatch, outcome):
    cone = cone_of(hard_packing("2d-64-shape-fixed-0"), without=17)
    monkeypatch.setitem(linear_programs.SOLVE, "clarabel", lying(outcome, lambda x: x))
    assert certify(cone).jammed is False


def test_when_no_solver_gives_a_proof_nothing_is_claimed(monkeypatch):
    cone = crystal()
    for name in ("clarabel", "highs"):
        monkeypatch.setitem(linear_programs.SOLVE, name, lying(Outcome.CONVERGED, lambda x: 1.0 - 3.0 * x))
    finding = certify(cone)
    assert finding.jammed is None
    assert "neither forces nor a motion" in finding.reason


def test_large_systems_do_not_fall_back_on_simplex(monkeypatch):
    cone = crystal()
    monkeypatch.setattr(certificates, "SIMPLEX_PARTICLES", 10)
    monkeypatch.setitem(linear_programs.SOLVE, "clarabel", lying(Outcome.INACCURATE, lambda x: 0.0 * x))
    assert certify(cone).jammed is None
    assert yield_to_loads(cone, np.random.default_rng(0)).jammed is None


def test_a_motion_that_closes_a_contact_proves_nothing():
    cone = cone_of(hard_packing("2d-64-shape-fixed-0"), without=17)
    motion = open_all(cone).motion
    assert closes_nothing(cone, motion)
    assert not closes_nothing(cone, -motion)
    assert not closes_nothing(cone, 0.0 * motion)


def test_a_motion_that_enlarges_the_box_proves_nothing():
    cone = cone_of(hard_packing("2d-32-shape-free-2"), strain="free")
    growth = np.zeros(cone.unknowns)
    growth[-3:-1] = 1.0
    assert (cone.opening @ growth).min() > 0
    assert not closes_nothing(cone, growth)


@pytest.mark.parametrize(("name", "strain"), [("2d-64-shape-fixed-0", "none"), ("2d-32-shape-free-2", "free")])
def test_only_state_of_self_stress_is_what_the_program_chooses(name, strain):
    cone = cone_of(hard_packing(name), strain)
    projected, chosen = certify(cone), certify(cone, solver="highs")
    assert "projection" in projected.solves[-1].status and "HiGHS" in chosen.solves[-1].status
    assert np.abs(projected.weight - chosen.weight).max() < 1e-9


def thinly_held(gap):
    """Return the motions of four discs held by a force of about 1.8 gaps on one contact, of the mean force."""
    opened = open_contact(pm.lattice_packing("triangular", 2), 4, gap)
    return motion_cone(opened, pm.find_contacts(opened, gap_tolerance=0.1 * gap), strain="free")


@pytest.mark.parametrize("gap", [1e-3, 1e-6, 1e-9])
@pytest.mark.parametrize("solver", SOLVERS)
def test_force_as_small_as_a_gap_holds(gap, solver):
    cone = thinly_held(gap)
    assert certify(cone, solver=solver).jammed is True
    # the simplex method knows stretches to 1e-10 at best
    allowed = (True, None) if solver == "highs" and gap < 1e-8 else (True,)
    assert yield_to_loads(cone, np.random.default_rng(0), solver=solver, bound="box").jammed in allowed


def test_motion_that_closes_held_contacts_by_a_billionth_is_no_proof():
    cone = thinly_held(1e-9)
    # without the weakly held contact the others can stay as they are
    rows, weak = cone.rows.toarray(), int(np.argmin(certify(cone).weight[:11]))
    target = np.zeros(len(rows))
    target[weak] = 1.0
    motion = np.linalg.lstsq(rows, target, rcond=None)[0]
    stretch = cone.opening @ motion
    assert stretch[weak] > 0.5 and -2e-8 < stretch.min() < -1e-10
    assert not closes_nothing(cone, motion)
    assert kept_open(cone, motion) is None


@pytest.mark.parametrize("strain", ["none", "free"])
def test_motion_of_a_solver_is_made_to_close_nothing(strain):
    # half of the contacts carry force: these stay shut
    cone = cone_of(pm.lattice_packing("kagome", 3), strain, without=5)
    motion = open_all(cone).motion
    kept = kept_open(cone, motion)
    assert np.abs(kept - cone.without_translations(motion)).max() < 1e-5
    assert -(cone.opening @ kept).min() <= cone.rounding * np.abs(kept).max()
    assert (cone.opening @ kept).max() > 0.99


@pytest.mark.parametrize("name", ["2d-64-shape-free-0", "3d-64-shape-free-0"])
def test_forces_are_as_near_to_balance_as_their_bound_says(name):
    cone, rng = cone_of(hard_packing(name), strain="free"), np.random.default_rng(3)
    exact = certify(cone).weight
    for size in (1e-3, 1e-6, 1e-9):
        weight = exact + size * rng.standard_normal(len(exact))
        away = weight - cone.balanced(weight)
        assert 1e-3 * size < np.sqrt(away @ away) < force_error(cone, cone.softest()[0], weight)


@pytest.mark.parametrize(("bend", "floppy"), [(0.0, 1), (1e-7, 0), (1e-10, 0), (1e-3, 0)])
def test_soft_motion_that_changes_a_contact_is_not_floppy(bend, floppy):
    # two discs in a row with their images; bent by an angle both contacts open when it straightens
    places = [[0.0, 0.0], [np.cos(bend), np.sin(bend)]]
    row = pm.Packing(places, [0.5, 0.5], pm.Box(np.diag([2.0 * np.cos(bend), 3.0])))
    cone = motion_cone(row, pm.find_contacts(row, gap_tolerance=1e-12), strain="none")
    assert cone.floppy_modes() == floppy and cone.is_floppy == bool(floppy)
    finding = certify(cone)
    assert finding.jammed is False and ("floppy" in finding.reason) == bool(floppy)
    assert (cone.opening @ finding.motion).min() >= 0.0 if bend > 1e-9 else True
