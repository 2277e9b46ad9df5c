"""Facts about the distributions of radii."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import packmech as pm
from packmech.generate.random import apportion

DISTRIBUTIONS = [
    pm.Monodisperse(),
    pm.Monodisperse(scatter=0.03),
    pm.Bidisperse(),
    pm.Bidisperse(ratio=1.4, fraction="2:1", scatter=0.03),
    pm.Mixture(ratios=(3.0, 1.0, 2.0), fractions=(1, 5, 3)),
    pm.Uniform(ratio=1.4),
    pm.Normal(spread=0.3),
    pm.LogNormal(spread=0.5),
]


def by_name(sizes):
    return repr(sizes)


@given(
    st.integers(1, 10_000),
    st.lists(st.floats(1e-3, 1.0), min_size=1, max_size=6).map(tuple),
)
def test_apportioned_counts_add_up_and_are_within_one_of_their_share(particles, fractions):
    counts = apportion(particles, fractions)
    assert sum(counts) == particles
    for count, fraction in zip(counts, fractions, strict=True):
        assert abs(count - particles * fraction / math.fsum(fractions)) < 1.0 + 1e-6


def test_three_equal_thirds_share_exactly():
    # 3 * (1/3 + 1/3 + 1/3) must not lose a particle to rounding
    assert apportion(9, (1 / 3, 1 / 3, 1 / 3)) == (3, 3, 3)


@pytest.mark.parametrize(
    ("fraction", "particles", "small"), [("50:50", 256, 128), ("2:1", 300, 200), ("2:1", 64, 43), (0.25, 8, 2)]
)
def test_bidisperse_counts_are_small_to_large(fraction, particles, small):
    radius_n = pm.Bidisperse(ratio=1.4, fraction=fraction).radii(particles, np.random.default_rng(0))
    assert np.count_nonzero(radius_n == 0.5) == small
    assert np.count_nonzero(radius_n == 0.7) == particles - small


def test_smallest_diameter_of_a_mixture_is_one_whatever_the_order_of_its_ratios():
    radius_n = pm.Mixture(ratios=(3.0, 1.5, 6.0), fractions=(1, 1, 1)).radii(6, np.random.default_rng(0))
    assert radius_n.tolist() == [1.0, 1.0, 0.5, 0.5, 2.0, 2.0]


@pytest.mark.parametrize("sizes", [pm.Uniform(), pm.Normal(), pm.LogNormal()], ids=by_name)
def test_mean_diameter_of_a_continuous_distribution_is_one(sizes):
    radius_n = sizes.radii(777, np.random.default_rng(3))
    assert math.fsum(radius_n) * 2 / 777 == pytest.approx(1.0, rel=1e-15)


@pytest.mark.parametrize("sizes", DISTRIBUTIONS, ids=by_name)
def test_same_seed_gives_the_same_bits(sizes):
    first, second = (sizes.radii(100, np.random.default_rng(7)) for _ in range(2))
    assert first.tobytes() == second.tobytes()


@pytest.mark.parametrize("sizes", DISTRIBUTIONS, ids=by_name)
def test_radii_are_positive(sizes):
    assert (sizes.radii(20_000, np.random.default_rng(5)) > 0).all()


# Statistical bounds below are five standard errors of the estimate from 200 000 draws.
DRAWS = 200_000


def relative_spread(sizes):
    radius_n = sizes.radii(DRAWS, np.random.default_rng(11))
    return radius_n.std() / radius_n.mean()


def test_uniform_diameters_spread_as_a_flat_distribution():
    # standard deviation over mean of a flat distribution on [1, q] is (q - 1)/(q + 1)/sqrt 3
    expected = 0.4 / 2.4 / math.sqrt(3)
    assert relative_spread(pm.Uniform(ratio=1.4)) == pytest.approx(expected, rel=5 / math.sqrt(2 * DRAWS))


def test_uniform_diameters_stay_within_their_ratio():
    radius_n = pm.Uniform(ratio=1.4).radii(DRAWS, np.random.default_rng(2))
    assert 1.3999 < radius_n.max() / radius_n.min() <= 1.4 * (1 + 1e-15)


def test_normal_diameters_have_the_spread_asked_for():
    assert relative_spread(pm.Normal(spread=0.1)) == pytest.approx(0.1, rel=5 / math.sqrt(2 * DRAWS))


def test_log_normal_diameters_have_the_spread_asked_for():
    # the variance of a sample variance grows with the kurtosis, here 3 + 16 * 0.2^2 + ...: a factor below 1.3
    assert relative_spread(pm.LogNormal(spread=0.2)) == pytest.approx(0.2, rel=1.3 * 5 / math.sqrt(2 * DRAWS))


def test_logarithm_of_log_normal_diameters_is_symmetric():
    logarithm = np.log(pm.LogNormal(spread=0.5).radii(DRAWS, np.random.default_rng(4)))
    skewness = ((logarithm - logarithm.mean()) ** 3).mean() / logarithm.std() ** 3
    assert abs(skewness) < 5 * math.sqrt(6 / DRAWS)


def test_scatter_multiplies_each_radius_by_its_own_gaussian_factor():
    plain = pm.Bidisperse().radii(DRAWS, np.random.default_rng(9))
    scattered = pm.Bidisperse(scatter=0.03).radii(DRAWS, np.random.default_rng(9))
    factor = scattered / plain
    assert factor.std() == pytest.approx(0.03, rel=5 / math.sqrt(2 * DRAWS))
    assert factor.mean() == pytest.approx(1.0, abs=5 * 0.03 / math.sqrt(DRAWS))
    assert len(np.unique(factor)) > 0.99 * DRAWS


def test_widest_normal_distribution_keeps_its_mean_factor_by_cutting_both_tails_alike():
    radius_n = pm.Monodisperse(scatter=0.3).radii(DRAWS, np.random.default_rng(13))
    assert radius_n.min() >= 0.05 and radius_n.max() <= 0.95
    assert radius_n.mean() == pytest.approx(0.5, abs=5 * 0.15 / math.sqrt(DRAWS))


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: pm.Bidisperse(ratio=1.0), "ratio must be a finite number above 1"),
        (lambda: pm.Bidisperse(ratio=float("nan")), "ratio must be"),
        (lambda: pm.Bidisperse(fraction=1.0), "fraction must be a finite number above 0 and below 1"),
        (lambda: pm.Bidisperse(fraction="2-1"), "fraction must be a number or like '50:50'"),
        (lambda: pm.Bidisperse(fraction="0:1"), "fraction must be a number or like '50:50'"),
        (lambda: pm.Monodisperse(scatter=-0.1), "scatter must be a finite number at least 0"),
        (lambda: pm.Monodisperse(scatter=0.5), "scatter must be a finite number at least 0 and at most 0.3"),
        (lambda: pm.Mixture((), ()), "ratios must hold at least one number"),
        (lambda: pm.Mixture((1.0, 2.0), (1.0,)), "fractions must hold one number for each of the 2 ratios, got 1"),
        (lambda: pm.Mixture((1.0, -2.0), (1.0, 1.0)), r"ratios\[1\] must be a finite number above 0"),
        (lambda: pm.Mixture(2.0, (1.0,)), "ratios must be a sequence of numbers"),
        (lambda: pm.Uniform(ratio=0.5), "ratio must be"),
        (lambda: pm.Normal(spread=0.0), "spread must be"),
        (lambda: pm.LogNormal(spread=float("inf")), "spread must be"),
    ],
)
def test_impossible_distribution_is_refused_by_name(make, message):
    with pytest.raises((TypeError, ValueError), match=message):
        make()
