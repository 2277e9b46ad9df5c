"""Time steps against closed forms: to the bound that each case names, with the order that it names."""

import math

import pytest
from verification.cases import CASES


@pytest.mark.parametrize("name", CASES)
def test_motion_follows_its_closed_form(name):
    one = CASES[name]
    coarse, fine = (one.solve(steps).error for steps in (one.steps, 2 * one.steps))
    assert coarse <= one.bound and fine <= one.bound
    if one.order is not None:
        assert math.log2(coarse / fine) == pytest.approx(one.order, abs=0.1)
