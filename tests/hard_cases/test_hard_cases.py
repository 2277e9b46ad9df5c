"""Every hard case of the catalogue is within its bound; a case that is not, or that breaks, is noticed."""

import math

import pytest

from hard_cases import HardCase, catalogue, measure


@pytest.mark.parametrize("case", catalogue(), ids=lambda case: case.name)
def test_hard_case_is_within_its_bound(case, record_property):
    found = measure(case)
    figure, seconds = found.raised or f"{found.value:.3g}", f"{found.seconds:.2f}"
    measured = (figure, f"{case.bound:.3g}", found.naive or "-", case.why, seconds)
    record_property("hard case", (case.name, case.watched, *measured))
    assert found.within, f"{case.watched}: {found.value} above {case.bound} {found.raised}"


def case_of(value, bound=1.0):
    return HardCase("name", "risk", "watched", bound, "why", value)


@pytest.mark.parametrize("value", [1.0000001, math.inf, math.nan])
def test_a_value_above_its_bound_or_no_number_is_out_of_bounds(value):
    assert not measure(case_of(lambda: value)).within


def test_a_value_at_its_bound_is_within():
    assert measure(case_of(lambda: 1.0)).within


def test_a_case_that_raises_is_out_of_bounds_with_the_reason():
    found = measure(case_of(lambda: math.log(0.0)))
    assert not found.within
    assert found.raised.startswith("ValueError: ")


def test_every_case_says_its_risk_its_quantity_and_where_its_bound_comes_from():
    for case in catalogue():
        assert min(len(case.risk), len(case.watched), len(case.why)) >= 10, case.name
