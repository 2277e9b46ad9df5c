"""Every guard of a verdict, against a solver that lies: what passes no check is no answer, and the reason says why.

Each lie fails one guard only; with that guard taken out it would be believed.
"""

import pathlib
import time
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

import packmech as pm
from packmech.jamming import certificates
from packmech.jamming.certificates import (
    BALANCE,
    CLOSE,
    EARLY,
    NET_FORCES,
    ROUNDING,
    Finding,
    attempts,
    borne,
    certify,
    closes_nothing,
    force_error,
    is_surely_rigid,
    kept_open,
    proven,
    turned_round,
    yield_to_loads,
)
from packmech.jamming.contact_selection import backbone_contacts
from packmech.jamming.motion_cone import MotionCone, motion_cone
from packmech.jamming.programs import largest_smallest_force, open_all

HARD = np.load(pathlib.Path(__file__).parents[1] / "golden" / "hard_packings.npz")
NAME = "2d-32-shape-free-2"


def cone_of(without=None):
    position, radius, lattice = (HARD[f"{NAME}/{part}"] for part in ("position_nd", "radius_n", "lattice_dd"))
    packing = pm.Packing(position, radius, pm.Box(lattice))
    network = backbone_contacts(pm.find_contacts(packing, gap_tolerance=1e-9))
    if without is not None:
        network = network.select(np.arange(len(network)) != without)
    return motion_cone(packing, network, strain="free")


@pytest.fixture(scope="module")
def cone():
    return cone_of()


@pytest.fixture(scope="module")
def true_weight(cone):
    """Contact forces and the volume's multiplier that balance, the forces' mean 1."""
    weight = cone.balanced(largest_smallest_force(cone).weight)
    return weight / weight[: cone.opening.shape[0]].mean()


@pytest.fixture(scope="module")
def floppy():
    """The same without one of its contacts, and a motion that closes none of the others."""
    found = cone_of(without=0)
    return found, kept_open(found, open_all(found).motion)


def believed(cone, weight, motion=None):
    return proven(cone, cone.softest()[0], weight, motion, ())


@pytest.fixture
def without_balancing(monkeypatch):
    """Forces are taken as they come, as if what balances them were broken."""
    monkeypatch.setattr(MotionCone, "balanced", lambda self, weight: weight.copy())


def test_the_truth_is_believed(cone, true_weight):
    finding = believed(cone, true_weight)
    assert finding.jammed
    assert finding.balance < BALANCE < 1e-8


def test_forces_out_of_balance_prove_nothing(cone, true_weight, without_balancing):
    push = np.zeros(cone.unknowns)
    push[0], push[2] = 1.0, -1.0
    # forces that two particles would need from outside, small enough that no force's sign is in doubt
    off = cone.bearing(np.zeros(len(true_weight)), push) * (20.0 * BALANCE)
    lie = true_weight + off
    lie /= lie[: cone.opening.shape[0]].mean()
    smallest = lie[: cone.opening.shape[0]].min()
    assert BALANCE < np.abs(cone.rows.T @ lie).max() < 100.0 * BALANCE
    assert smallest > 100.0 * force_error(cone, cone.softest()[0], lie)
    finding = believed(cone, lie)
    assert finding.jammed is None
    assert finding.weight is None
    assert finding.reason.startswith("neither forces nor a motion passed the check")


@pytest.mark.parametrize("k", [0, 7, -1])
def test_a_balance_in_which_a_contact_pulls_proves_nothing(cone, true_weight, k):
    sign = np.ones(cone.opening.shape[0])
    sign[k] = -1.0
    # the same rows, but one contact would open where the other closes: forces balance if it pulls
    turned = replace(cone, opening=sp.csr_array(sp.diags_array(sign) @ cone.opening))
    lie = true_weight.copy()
    lie[: len(sign)] *= sign
    assert np.abs(turned.rows.T @ lie).max() < BALANCE
    assert believed(turned, lie).jammed is None


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_forces_that_are_no_numbers_prove_nothing(cone, true_weight, value):
    lie = true_weight.copy()
    lie[3] = value
    with np.errstate(invalid="ignore"):
        finding = believed(cone, lie)
    assert finding.jammed is None


def test_no_forces_prove_nothing(cone, true_weight):
    assert believed(cone, np.zeros_like(true_weight)).jammed is None
    assert believed(cone, -true_weight).jammed is None


def test_a_force_that_rounding_could_make_proves_nothing(cone, true_weight):
    smallest = true_weight[: cone.opening.shape[0]].min()
    # rows so nearly dependent that the forces are not known better than to their smallest
    softest = cone.softest()[0] * force_error(cone, cone.softest()[0], true_weight) / (2.0 * smallest)
    finding = proven(cone, softest, true_weight, None, ())
    assert finding.jammed is None
    assert "not known better than" in finding.reason


def test_the_error_of_forces_is_so_many_times_their_distance_from_a_balance_along_the_softest_row(cone, true_weight):
    left, value, _ = np.linalg.svd(cone.rows.toarray(), full_matrices=False)
    last = cone.unknowns - cone.dimension - 1
    assert value[last] / value[0] == pytest.approx(cone.softest()[0], rel=1e-2)
    # |r| / s is the distance itself where the net forces r are those of the softest singular vector
    off = true_weight + 1e-6 * left[:, last]
    assert np.linalg.norm(off - cone.balanced(off)) == pytest.approx(1e-6, rel=1e-4)
    assert force_error(cone, cone.softest()[0], off) == pytest.approx(NET_FORCES * 1e-6, rel=1e-2)


def test_forces_in_exact_balance_are_known_to_rounding_of_the_contacts_directions_only():
    square = pm.lattice_packing("square", repeats=(4, 4))
    cone = motion_cone(square, pm.find_contacts(square, gap_tolerance=1e-9), strain="none")
    weight = np.ones(cone.rows.shape[0])
    assert not (cone.rows.T @ weight).any()
    # rows wrong by e move a state of self stress by e |w| / s; the floppy crystal's s is put in by hand
    least = 0.1 * np.sqrt(cone.largest_eigenvalue)
    assert force_error(cone, 0.1, weight) > np.finfo(float).eps * np.linalg.norm(weight) / least


def test_the_error_of_exact_forces_grows_as_their_sum_of_squares_and_as_the_box_over_a_diameter():
    def error(repeats):
        square = pm.lattice_packing("square", repeats=(repeats, repeats))
        cone = motion_cone(square, pm.find_contacts(square, gap_tolerance=1e-9), strain="none")
        return force_error(cone, 0.1, np.ones(cone.rows.shape[0]))

    # the largest eigenvalue in it is known to 1e-3
    assert error(8) / error(4) == pytest.approx(2.0 * 2.0, rel=1e-2)


def test_solvers_are_asked_more_closely_and_then_by_the_simplex_unless_they_were_already(cone):
    assert attempts(cone, "clarabel", 1e-6) == [("clarabel", 1e-6), ("clarabel", CLOSE), ("highs", 1e-6)]
    for tolerance in (CLOSE, 0.1 * CLOSE):
        assert attempts(cone, "clarabel", tolerance) == [("clarabel", tolerance), ("highs", tolerance)]
    assert attempts(cone, "highs", 1e-6) == [("highs", 1e-6)]


def test_loads_are_answered_in_the_seconds_that_they_take(cone):
    begun = time.process_time()
    answer = yield_to_loads(cone, np.random.default_rng(0), tolerance=1e-8, solver="clarabel")
    assert answer.jammed and 0.0 <= sum(one.seconds for one in answer.solves) <= time.process_time() - begun


@pytest.mark.parametrize(
    ("options", "asked"),
    [
        ({}, [EARLY]),
        ({"tolerance": EARLY}, [EARLY]),
        ({"fallback": False}, [1e-8, 1e-8]),
        ({"bound": "box"}, [1e-8, 1e-8]),
    ],
    ids=["default", "rough", "once", "box"],
)
def test_multipliers_of_the_first_rough_program_settle_both_loads_and_without_them_each_is_asked_once(
    cone, monkeypatch, options, asked
):
    tolerances, solve = [], certificates.yield_to_load

    def recorded(cone, load, **given):
        tolerances.append(given["tolerance"])
        return solve(cone, load, **given)

    monkeypatch.setattr(certificates, "yield_to_load", recorded)
    assert yield_to_loads(cone, np.random.default_rng(0), **options).jammed
    assert tolerances == asked


def test_a_volume_that_pulls_proves_nothing(cone, true_weight):
    assert cone.one_sided.shape[0] == 1
    turned = replace(cone, one_sided=sp.csr_array(-cone.one_sided))
    lie = np.append(true_weight[:-1], -true_weight[-1])
    assert np.abs(turned.rows.T @ lie).max() < BALANCE
    assert believed(turned, lie).jammed is None


@pytest.mark.parametrize(("share", "jammed"), [(3.0, None), (1.0 / 3.0, True)])
def test_a_volume_that_presses_by_less_than_the_error_proves_nothing(cone, true_weight, share, jammed):
    count = cone.opening.shape[0]
    smallest = true_weight[:count].min()
    little = 0.1 * smallest
    # the volume's row made longer, its multiplier is as much smaller
    long = replace(cone, one_sided=sp.csr_array(cone.one_sided * (true_weight[-1] / little)))
    weight = np.append(true_weight[:-1], little)
    # rows so nearly dependent that the error is this share of the multiplier, always below the forces
    softest = long.softest()[0] * force_error(long, long.softest()[0], weight) / (share * little)
    assert share * little < smallest
    assert proven(long, softest, weight, None, ()).jammed is jammed


@pytest.mark.parametrize("by", [1e-3, 1e-6, 100.0])
def test_a_motion_that_closes_one_contact_of_many_is_none(floppy, by):
    cone, motion = floppy
    closing = np.zeros(cone.opening.shape[0])
    closing[3] = -1.0
    step = np.linalg.lstsq(cone.rows.toarray(), np.append(closing, 0.0), rcond=None)[0]
    by = by if by < 1.0 else by * cone.rounding * np.abs(motion).max()
    stretch = cone.opening @ motion
    lie = motion + (by + stretch[3]) * step
    assert (cone.opening @ lie).mean() > 0.5 * stretch.mean()
    assert not closes_nothing(cone, lie)


def test_a_motion_that_closes_a_contact_proves_nothing(floppy):
    cone, motion = floppy
    assert closes_nothing(cone, motion)
    row = cone.opening[[int(np.argmax(cone.opening @ motion))]]
    turned = -motion
    weight = np.full(cone.rows.shape[0], np.nan)
    for lie in (turned, motion - 1e-3 * np.asarray(row.T.toarray()).ravel(), np.full_like(motion, np.nan)):
        assert kept_open(cone, lie) is None or closes_nothing(cone, kept_open(cone, lie))
    assert kept_open(cone, turned) is None
    with np.errstate(invalid="ignore"):
        assert believed(cone, weight, turned).jammed is None
        assert believed(cone, weight, motion).jammed is False


def test_a_translation_and_an_opening_of_rounding_prove_nothing(cone, floppy):
    here = np.zeros(cone.unknowns)
    here[0 : 2 * len(cone.kept_n) : 2] = 1.0
    assert kept_open(cone, here) is None
    loose, motion = floppy
    drifting = np.zeros(loose.unknowns)
    drifting[0 : 2 * len(loose.kept_n) : 2] = 1.0
    assert not closes_nothing(loose, drifting + 0.1 * ROUNDING * motion)


@pytest.mark.parametrize("lie", ["nan", "pulling", "idle"])
def test_multipliers_that_bear_no_load_prove_nothing(cone, lie):
    load = cone.without_translations(np.random.default_rng(0).standard_normal(cone.unknowns))
    load /= np.linalg.norm(load)
    weight = cone.bearing(np.zeros(cone.rows.shape[0]), load)
    wrong = {"nan": np.full_like(weight, np.nan), "pulling": weight - 1e3 * np.abs(weight), "idle": 0.0 * weight}[lie]
    assert borne(cone, load, wrong) is None
    if lie == "pulling":
        assert turned_round(cone, load, wrong) is None


@pytest.mark.parametrize(("least_weight", "bears"), [(1e-4, True), (-1e-4, False)])
def test_a_load_is_borne_where_all_weights_press_however_little_one_pulls(cone, true_weight, least_weight, bears):
    load = cone.without_translations(np.random.default_rng(0).standard_normal(cone.unknowns))
    load /= np.linalg.norm(load)
    weight = cone.bearing(np.zeros(cone.rows.shape[0]), load)
    # any multiple of the state of self stress may be added: as much as leaves one weight so small
    weight += ((least_weight - weight) / true_weight).max() * true_weight
    assert weight.min() == pytest.approx(least_weight, rel=1e-6)
    assert (borne(cone, load, weight) is not None) == bears


def pair_held_by_tilts(tilt, tilts=(1, 1, -1, -1), slack=0.0):
    """Return the motions of two discs with contacts left and right, each turned up or down by a small angle.

    Up and down they change contacts by the tilt only: a singular value of sqrt(2) times it for each two contacts.
    """
    two = pm.Packing([[0.0, 0.0], [1.0, 0.0]], [0.5, 0.5], pm.Box.cubic(4.0, 2))
    cone = motion_cone(two, pm.find_contacts(two, gap_tolerance=1e-9), strain="none")
    side = np.array([1.0, -1.0] * (len(tilts) // 2))
    normal = np.stack([side * np.sqrt(1.0 - tilt**2), tilt * np.array(tilts, dtype=float)], axis=1)
    opening = sp.csr_array(np.hstack([-normal, normal]))
    return replace(cone, opening=opening, slack=slack, gap_c=np.zeros(len(tilts)))


def with_sign(cone, sign):
    """Return the cone with its softest motion up, or down: which one a solver finds is chance."""
    value, motion = cone.softest()
    turned = replace(cone)
    turned.__dict__["_softest"] = value, sign * np.sign(motion[3]) * motion
    return turned


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_soft_motion_is_surely_held_only_where_contacts_close_either_way(sign):
    assert is_surely_rigid(with_sign(pair_held_by_tilts(1e-5), sign))
    # all tilts up: up they open and down they close
    assert not is_surely_rigid(with_sign(pair_held_by_tilts(1e-5, tilts=(1, 1)), sign))


@pytest.mark.parametrize(("slack", "sure"), [(1e-8, True), (1e-6, False)])
def test_a_soft_motion_is_surely_held_only_above_a_hundred_times_what_the_rows_are_known_to(slack, sure):
    # the singular value is 2.8e-5, by Weyl's bound known to 2.8 slacks
    assert is_surely_rigid(pair_held_by_tilts(1e-5, slack=slack)) == sure


def test_a_motion_is_floppy_where_it_changes_nothing_and_left_open_below_what_contacts_are_known_to():
    floppy = certify(pair_held_by_tilts(0.0))
    assert floppy.jammed is False and not floppy.within_error and "changes no contact" in floppy.reason
    within = certify(pair_held_by_tilts(1e-9, slack=1e-9))
    assert within.jammed is False and within.within_error and "by less than these are known" in within.reason
    known = certify(pair_held_by_tilts(1e-9, slack=1e-11))
    assert known.jammed is None and not known.within_error


@pytest.mark.parametrize(("tilt", "floppy"), [(1e-15, True), (1e-12, False), (1e-6, False)])
def test_only_what_rounding_makes_of_a_contact_is_no_change(tilt, floppy):
    assert pair_held_by_tilts(tilt).is_floppy == floppy


def test_a_stiff_motion_is_not_floppy_within_the_error_however_little_is_known():
    assert pair_held_by_tilts(1e-6, slack=1.0).is_floppy_within_error
    assert not pair_held_by_tilts(0.1, slack=1.0).is_floppy_within_error


@pytest.mark.parametrize("overlap", [0.0, 1e-6, 1e-3])
@pytest.mark.parametrize("shift", [0.0, 2.0**20])
def test_contacts_are_known_to_their_largest_overlap_and_to_rounding_of_the_coordinates(overlap, shift):
    square = pm.lattice_packing("square", repeats=(3, 3), relative_overlap=overlap)
    square = square.replace(position_nd=square.position_nd + shift)
    cone = motion_cone(square, pm.find_contacts(square, gap_tolerance=1e-9), strain="none")
    rounding = np.spacing(np.abs(square.position_nd).max()) / square.reference_diameter
    assert overlap + 0.999 * rounding <= cone.slack <= overlap * (1.0 + 1e-9) + 4.0 * rounding


class Drawn:
    """A generator that draws what it is told to."""

    def __init__(self, load):
        self.load = load

    def standard_normal(self, size):
        assert size == len(self.load)
        return self.load.copy()


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("fallback", [True, False])
def test_a_motion_that_only_one_of_a_load_and_its_opposite_makes_is_found_and_closes_nothing(floppy, sign, fallback):
    cone, motion = floppy
    finding = yield_to_loads(cone, Drawn(sign * motion), fallback=fallback)
    assert finding.jammed is False
    assert closes_nothing(cone, finding.motion)


def test_what_shutting_leaves_of_a_motion_is_none_where_it_is_rounding(monkeypatch):
    cone = pair_held_by_tilts(1e-4)
    up = np.array([0.0, -1.0, 0.0, 1.0])
    assert kept_open(cone, up, opening=False) is None
    # a translation of rounding size changes no contact
    monkeypatch.setattr(MotionCone, "shutting", lambda self, motion, shut: iter([np.full(4, 1e-16)]))
    assert kept_open(cone, up, opening=False) is None


@pytest.mark.parametrize(("certified", "expected"), [(True, None), (None, None), (False, False)])
def test_a_motion_that_closes_hardly_unjams_only_where_the_certificate_says_so(
    monkeypatch, floppy, certified, expected
):
    cone, motion = floppy
    monkeypatch.setattr(certificates, "closes_hardly", lambda *given: True)
    monkeypatch.setattr(certificates, "certify", lambda *given, **named: Finding(certified, "as it is told"))
    assert yield_to_loads(cone, Drawn(motion)).jammed is expected
