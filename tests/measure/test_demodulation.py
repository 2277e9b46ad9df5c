"""Facts about demodulation: exact on what it fits, error bars that cover, and where moduli cross."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import packmech as pm

PHASE = 2.0 * np.pi * np.linspace(0.0, 6.0, 601)


@given(st.lists(st.floats(-10.0, 10.0), min_size=6, max_size=6), st.floats(1e-3, 1.0))
def test_waves_third_harmonics_offset_and_slope_come_back_exactly(numbers, amplitude):
    a, b, c, d, offset, slope = numbers
    stress = a * np.sin(PHASE) + b * np.cos(PHASE) + c * np.sin(3 * PHASE) + d * np.cos(3 * PHASE)
    stress += offset + slope * PHASE
    found = pm.demodulate(PHASE, stress, amplitude=amplitude)
    fitted = (found.in_phase, found.out_of_phase, found.third_in_phase, found.third_out_of_phase, found.offset)
    assert np.allclose((*fitted, found.slope / (2.0 * np.pi)), numbers, atol=1e-9)
    assert found.stress == pytest.approx(np.hypot(a, b), abs=1e-9)
    assert np.allclose(found.storage_p, a / amplitude, atol=1e-6)


def test_fifth_harmonics_take_nothing_from_the_moduli_over_whole_periods():
    stress = 2.0 * np.sin(PHASE) + 0.5 * np.cos(PHASE) + np.sin(5.0 * PHASE)
    found = pm.demodulate(PHASE[:-1], stress[:-1], amplitude=1.0, periods=6.0)
    # the slope is not quite across the fifth harmonic
    assert found.storage == pytest.approx(2.0, abs=5e-3)
    assert found.loss == pytest.approx(0.5, abs=5e-3)


def test_the_first_period_does_not_count():
    stress = np.sin(PHASE) + 100.0 * (PHASE < 2.0 * np.pi * 0.999)
    assert pm.demodulate(PHASE, stress, amplitude=1.0).storage == pytest.approx(1.0, abs=1e-12)
    assert abs(pm.demodulate(PHASE, stress, amplitude=1.0, skip_periods=0.0).storage - 1.0) > 1.0


def test_what_comes_after_the_last_period_does_not_count():
    stress = np.sin(PHASE) * (PHASE < 2.0 * np.pi * 4.001)
    found = pm.demodulate(PHASE, stress, amplitude=1.0, periods=4.0)
    assert found.storage == pytest.approx(1.0, abs=1e-12)
    assert len(found.storage_p) == 3


def test_periods_beyond_the_last_sample_change_nothing():
    stress = np.sin(PHASE)
    whole = pm.demodulate(PHASE, stress, amplitude=1.0)
    later = pm.demodulate(PHASE, stress, amplitude=1.0, periods=2.0**31)
    assert (later.storage, later.samples) == (whole.storage, whole.samples)
    np.testing.assert_array_equal(later.storage_p, whole.storage_p)


def test_periods_without_samples_are_passed_over_however_many_they_are():
    found = pm.demodulate(np.geomspace(1.0, 1e18, 50), np.ones(50), amplitude=1.0, skip_periods=0.0)
    assert len(found.storage_p) == 0


def test_standard_errors_cover_white_noise():
    rng = np.random.default_rng(3)
    found = [pm.demodulate(PHASE, np.sin(PHASE) + 0.3 * rng.standard_normal(601), amplitude=1.0) for _ in range(400)]
    off = np.std([one.storage for one in found])
    assert np.mean([one.storage_fit_error for one in found]) == pytest.approx(off, rel=0.1)
    assert np.sqrt(np.mean([one.storage_error**2 for one in found])) == pytest.approx(off, rel=0.15)


def test_one_period_has_no_error_over_periods():
    found = pm.demodulate(PHASE, np.sin(PHASE), amplitude=1.0, periods=2.0)
    assert len(found.storage_p) == 1
    assert np.isnan(found.storage_error)


def test_yield_strain_is_where_the_line_between_moduli_crosses_whatever_the_order():
    amplitude, storage, loss = [0.4, 0.01, 0.2, 0.1], [10.0, 100.0, 40.0, 90.0], [30.0, 10.0, 30.0, 20.0]
    assert pm.yield_strain(amplitude, storage, loss) == pytest.approx(0.2 + 0.2 * 10.0 / 30.0, rel=1e-12)


def test_yield_strain_takes_the_last_of_several_crossings():
    assert pm.yield_strain([1.0, 2.0, 3.0, 4.0], [3.0, 1.0, 3.0, 1.0], [2.0] * 4) == pytest.approx(3.5, rel=1e-12)


def test_no_crossing_is_not_a_number():
    assert np.isnan(pm.yield_strain([1.0, 2.0], [3.0, 3.0], [2.0, 2.0]))
    assert np.isnan(pm.yield_strain([1.0, 2.0], [1.0, 1.0], [2.0, 2.0]))
    assert np.isnan(pm.softening_strain([1.0, 2.0], [3.0, 3.0]))


def test_softening_strain_is_where_the_storage_modulus_has_lost_its_part():
    assert pm.softening_strain([1.0, 2.0, 3.0], [8.0, 8.0, 2.0], remaining=0.5) == pytest.approx(2.0 + 2.0 / 3.0)
