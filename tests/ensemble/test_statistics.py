"""Statistics of ensembles against what is known of the numbers they are taken of."""

import math

import numpy as np
import pytest

import packmech as pm
from packmech.ensemble.statistics import bootstrap, fit_power_law, group_statistics, histogram

# what failed is what these tests look at
pytestmark = pytest.mark.filterwarnings("ignore:.* members failed:UserWarning")


def test_bootstrap_errors_are_the_known_ones_of_normal_numbers():
    value_kr = np.random.default_rng(1).normal(size=(30, 400))
    for statistic, error in (("mean", 1.0), ("width", math.sqrt(0.5)), ("median", math.sqrt(math.pi / 2.0))):
        found = np.mean([bootstrap(value, statistic=statistic, draws=300)[1] for value in value_kr])
        assert found == pytest.approx(error / 20.0, rel=0.06), statistic


def test_the_error_of_a_mean_agrees_with_the_formula():
    value = np.random.default_rng(2).normal(size=7)
    assert bootstrap(value, draws=20000)[1] == pytest.approx(value.std(ddof=1) / math.sqrt(7), rel=0.03)


def test_too_few_values_have_no_error():
    assert math.isnan(bootstrap(np.array([1.0]))[1])
    assert math.isnan(bootstrap(np.array([1.0]), statistic="width")[0])
    assert math.isnan(bootstrap(np.array([]))[0])


def test_a_fit_to_noisy_powers_is_within_its_own_error():
    rng, size = np.random.default_rng(3), np.array([32.0, 64.0, 128.0, 256.0, 1024.0])
    off = []
    for _ in range(300):
        error = 0.05 * size**-0.5
        found = fit_power_law(size, 0.4 * size**-0.5 + error * rng.normal(size=5), error)
        off.append((found.exponent + 0.5) / found.exponent_error)
    assert abs(np.mean(off)) < 4.0 / math.sqrt(300)
    # an error of 5 per cent is not quite small in a logarithm
    assert np.std(off) == pytest.approx(1.0, abs=0.2)


def test_the_error_of_a_law_that_misses_its_points_grows_by_how_much_it_misses():
    size = np.array([32.0, 64.0, 128.0, 256.0, 1024.0])
    value = 0.4 * size**-0.5 * (1.0 + 5.0 / np.sqrt(size))
    for error in (1e-3, 1e-5):
        found = fit_power_law(size, value, error * value)
        # the errors of the points do not matter where the law misses them by far more: those of the scatter do
        _, covariance = np.polyfit(np.log(size), np.log(value), 1, cov=True)
        assert found.exponent_error == pytest.approx(math.sqrt(covariance[0, 0]), rel=1e-9)
        assert found.chi_square > 1.0
    assert fit_power_law(size, value, value, exponent=-0.5).prefactor_error > 0.0


def test_a_histogram_is_a_density_of_all_values():
    value = np.random.default_rng(4).normal(size=1000)
    found = histogram(value)
    assert found.count_b.sum() == 1000
    assert (found.density_b * np.diff(found.edge_b)).sum() == pytest.approx(1.0)


def test_groups_are_those_of_equal_parameters_and_failures_do_not_count(tmp_path, called):
    grid = [{"scale": [1.0, 2.0], "seed": range(3)}, {"scale": 3.0, "seed": ["no number", "none"]}]
    made = pm.run_ensemble(called("square"), grid, tmp_path / "out", workers=1)
    assert made.counts() == {"done": 6, "failed": 2, "missing": 0}
    found = group_statistics(made, "square")
    assert found.by["scale"].tolist() == [1.0, 2.0, 3.0]
    assert found.count_g.tolist() == [3, 3, 0]
    np.testing.assert_allclose(found.value_g[:2], [5.0 / 3.0, 10.0 / 3.0])
    with pytest.raises(ValueError, match="a text"):
        group_statistics(made, "word")


def test_a_power_law_is_found_below_the_largest_value_with_its_error():
    rng = np.random.default_rng(2)
    parts = [np.concatenate([rng.random(500) ** (1.0 / 0.6), 1.0 + rng.random(100)]) for _ in range(40)]
    exponent, error, count = pm.small_value_exponent(parts, 1.0)
    assert count == 20_000
    # an error found from 40 packings has a relative error of 1 / sqrt(78): bounds are some four of both
    assert exponent == pytest.approx(-0.4, abs=4.0 * error) and error == pytest.approx(0.6 / np.sqrt(count), rel=0.4)
