"""Facts about what a verdict says of its assumptions: bounds of loads, rest of crystals, thin forces."""

import pytest
from hard_cases.defects import open_contact

import packmech as pm
from packmech.generate import reinforced_kagome_packing
from packmech.jamming.verdict import verdict_numbers

YES, NO, UNKNOWN = "jammed", "not jammed", "ambiguous"
METHODS = ("certificate", "loads")


def line(verdict, name):
    return next(one for one in str(verdict).splitlines() if one.startswith(name))


@pytest.mark.parametrize(
    ("given", "bound"),
    [
        ({"method": "loads"}, "ball"),
        ({"method": "loads", "bound": "box"}, "box"),
        ({"method": "loads", "solver": "highs"}, "box"),
        ({"method": "certificate"}, None),
    ],
    ids=str,
)
def test_verdict_says_what_bounded_the_loads(given, bound):
    verdict = pm.classify_jamming(pm.lattice_packing("triangular", (2, 2)), **given)
    assert verdict.bound == verdict_numbers(verdict)["verdict_bound"] == bound
    assert ("bounded by" in line(verdict, "method")) == (bound is not None)
    if bound is not None:
        assert f"loads bounded by a {bound}" in line(verdict, "method")


def test_rest_of_a_crystal_whose_overlaps_are_rounding_is_said_in_words():
    crystal = pm.classify_jamming(pm.lattice_packing("kagome", (3, 3)))
    assert crystal.rest.limit > 1.0
    assert "overlaps are rounding of the coordinates" in line(crystal, "at rest")
    pressed = pm.classify_jamming(pm.lattice_packing("triangular", (3, 3), relative_overlap=1e-3))
    assert "of the mean contact force, allowed 1.0e-05" in line(pressed, "at rest")
    apart = pm.classify_jamming(pm.lattice_packing("triangular", (3, 3), relative_overlap=-1e-3))
    assert "no net forces" in line(apart, "at rest")


def opened(crystal, contact, gap):
    """Return both methods' verdicts on a crystal with one contact opened by so much, and not counted."""
    thin = open_contact(crystal, contact, gap)
    shut = pm.find_contacts(thin, gap_tolerance=0.1 * gap)
    return [pm.classify_jamming(thin, contacts=shut, method=method) for method in METHODS]


@pytest.mark.parametrize("gap", [1e-9, 1e-10, 1e-11, 1e-12, 1e-13, 1e-14])
def test_crystal_held_by_forces_as_small_as_rounding_is_never_called_unjammed(gap):
    """Four discs of the triangular crystal, one of twelve contacts open: forces of 11/6 of the gap hold the others."""
    certificate, loads = opened(pm.lattice_packing("triangular", repeats=2), 4, gap)
    assert certificate.strict == (YES if gap > 2e-14 else UNKNOWN)
    assert loads.strict == (YES if gap > 2e-12 else UNKNOWN)
    assert NO not in (certificate.collective, loads.collective)


@pytest.mark.parametrize("gap", [1e-6, 1e-7, 1e-8, 1e-9, 1e-11, 1e-13])
def test_contacts_opposite_to_within_1e_8_hold_nothing_for_sure_nor_surely_not(gap):
    """The reinforced kagome crystal, one contact open, is held by pairs of contacts opposite but for the gap."""
    for verdict in opened(reinforced_kagome_packing(1), 10, gap):
        expected = YES if gap > 2e-8 else UNKNOWN
        assert (verdict.local, verdict.collective, verdict.strict) == (expected,) * 3


def test_network_that_rattles_away_and_can_move_without_change_is_not_jammed():
    """Discs in a row touch both neighbors: nothing opens when the row slides, and none is held across it."""
    row = pm.Packing([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]], [0.5] * 3, pm.Box([[3.0, 0.0], [0.0, 5.0]]))
    contacts = pm.find_contacts(row, gap_tolerance=1e-9)
    for method in METHODS:
        verdict = pm.classify_jamming(row, contacts=contacts, method=method)
        assert (verdict.local, verdict.collective, verdict.strict) == (NO, NO, NO)
