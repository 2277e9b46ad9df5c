"""Facts about contacts at the Coulomb limit: a gap parts them from the others, what lies in none is doubtful."""

import numpy as np
import pytest

from packmech.contacts.coulomb_limit import find_at_limit


def tangential(distance_c, normal_c, coefficient):
    """Return tangential forces so far from the limit, over the mean normal force."""
    return coefficient * normal_c - np.asarray(distance_c) * normal_c.mean()


@pytest.mark.parametrize("coefficient", [0.1, 0.5])
@pytest.mark.parametrize("residual", [1e-12, 1e-8, 1e-6])
@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e6])
def test_what_slid_on_the_way_to_rest_stands_within_some_residuals_of_the_limit(coefficient, residual, unit):
    normal = unit * np.linspace(0.5, 1.5, 40)
    distance = np.r_[residual * np.geomspace(0.01, 30.0, 8), coefficient * np.linspace(0.1, 0.4, 32)]
    found = find_at_limit(tangential(distance, normal, coefficient), normal, coefficient, residual)
    assert found.at_limit_c.tolist() == [True] * 8 + [False] * 32
    assert not found.doubtful_c.any()
    assert 30.0 * residual < found.bound < 0.1 * coefficient


def test_without_a_gap_contacts_near_the_bound_are_doubtful():
    normal = np.ones(60)
    distance = np.r_[np.geomspace(1e-9, 0.05, 50), np.full(10, 0.2)]
    found = find_at_limit(tangential(distance, normal, 0.5), normal, 0.5, 1e-8)
    assert found.doubtful_c.any()
    assert not found.doubtful_c[-10:].any()


def test_a_contact_that_bears_next_to_nothing_is_doubtful_wherever_it_stands():
    normal = np.r_[np.ones(30), 1e-9, 0.0]
    force = 0.5 * np.r_[np.full(5, 1.0 - 1e-10), np.full(25, 0.6), 0.3e-9, 0.0]
    found = find_at_limit(force, normal, 0.5, 1e-8)
    assert found.at_limit_c.tolist() == [True] * 5 + [False] * 27
    assert found.doubtful_c.tolist() == [False] * 30 + [True, False]


def test_in_motion_only_what_slides_to_rounding_is_at_the_limit():
    normal = np.ones(4)
    found = find_at_limit(0.5 * np.array([1.0, 1.0 - 1e-10, 1.0 - 1e-8, 0.5]), normal, 0.5, 0.3)
    assert found.at_limit_c.tolist() == [True, True, False, False] and not found.doubtful_c.any()
