"""The crossover of shear moduli, recovered from curves that are known."""

import numpy as np
import pytest

from packmech.validation.studies.shapes import DISTANCES, Sheared, crossover


def moduli(place, noise, seeds=10):
    rng = np.random.default_rng(3)
    rows = []
    for seed in range(seeds):
        for distance in DISTANCES:
            modulus = 0.7 * distance / np.sqrt(1.0 + distance / place) * np.exp(noise * rng.normal())
            rows.append(Sheared(2, 256, 1.5, seed, distance, 0.0, modulus, 0.0, 0, 0, 0.0))
    return rows


@pytest.mark.parametrize("place", [1e-3, 2e-2])
def test_crossover_is_found_where_the_exponent_of_the_curve_is_three_quarters(place):
    found, error = crossover(moduli(place, 0.0), 1.5)
    assert found == pytest.approx(place, rel=1e-6) and error < 1e-6
    h = 1e-4
    curve = [np.log(x / np.sqrt(1.0 + x / found)) for x in (found * np.exp(-h), found * np.exp(h))]
    assert (curve[1] - curve[0]) / (2.0 * h) == pytest.approx(0.75, abs=1e-6)


def test_error_of_the_crossover_is_that_of_packings_drawn_again():
    found, error = crossover(moduli(1e-2, 0.2), 1.5)
    assert 0.03 < error < 0.3 and abs(np.log(found / 1e-2)) < 3.0 * error
    assert np.isnan(crossover(moduli(1e-2, 0.2, seeds=1), 1.5)).all()
