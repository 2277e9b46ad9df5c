"""Facts about the study of minima: what is the same minimum, shares with their errors, and the stiff reference."""

import math

import numpy as np
import pytest
from scipy.integrate import BDF

import packmech as pm
from packmech.validation.studies.accuracy import minima as study


def ended(method, seed, energy, network=1, converged=1):
    return study.Ended(method, seed, converged, energy, network, 150, 0, 10, 0.1)


def test_a_minimum_is_the_same_where_energy_and_network_are():
    one = ended(0, 0, 0.1)
    assert one.same_as(ended(1, 0, 0.1 * (1.0 + 1e-12)))
    assert not one.same_as(ended(1, 0, 0.1 * (1.0 + 1e-6)))
    assert not one.same_as(ended(1, 0, 0.1, network=2))
    assert not one.same_as(ended(1, 0, 0.1, converged=0))


def test_binomial_errors_are_those_of_the_normal_distribution_for_many_and_finite_for_none():
    share, error = study.share_and_error(4000, 10_000)
    assert error == pytest.approx(math.sqrt(share * (1.0 - share) / 10_000), rel=1e-3)
    assert study.share_and_error(0, 200)[1] > 0.0


def test_shares_and_differences_of_onsets_are_those_of_the_rows():
    found = [ended(0, s, 0.1 + s) for s in range(4)] + [ended(1, s, 0.1 + s + (s == 3)) for s in range(4)]
    onsets = [study.Onset(k, s, 0.84 + 0.001 * k * (s == 3)) for k in range(2) for s in range(4)]
    table = study.compare(found, onsets)
    assert [one.same for one in table.shares] == [1.0, 0.75]
    assert table.agreement_mm.tolist() == [[1.0, 0.75], [0.75, 1.0]]
    assert table.shares[1].onset == pytest.approx(0.84025)
    assert "75.0 +-" in table.to_markdown()
    assert table.to_csv().count("\n") == 3


def test_the_path_of_steepest_descent_ends_where_a_stiff_method_with_the_exact_hessian_does():
    packing = pm.random_packing(12, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.95, seed=2)
    scene = pm.Scene(packing, (pm.Repulsion(law=pm.LinearSpring()),))
    ends = [
        pm.quench(scene, force_tolerance=1e-8, method=method).packing.position_nd
        for method in (pm.SteepestDescent(1e-8), study.StiffDescent(BDF, 1e-7))
    ]
    assert np.abs(ends[1] - ends[0]).max() < 1e-4
