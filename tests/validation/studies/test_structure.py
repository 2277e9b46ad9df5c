"""The studies of annealing and of structure: rows resume, figures are written, pressures are reached."""

import math

import numpy as np
import pytest

import packmech as pm
from packmech.validation.studies import families, preparations
from packmech.validation.studies.annealing import anneal_all, draw_annealed, steps_between
from packmech.validation.studies.structure import (
    DISCS,
    ELLIPSES,
    contact_numbers,
    correlate,
    draw_contact_numbers,
    draw_order,
    draw_spectrum,
    jam_all,
    measure_spectrum,
    packing_of,
    spectral_packing,
    spectral_packings,
)


def silent(done, of, last):
    """Report nothing."""


def test_steps_are_equal_and_end_at_the_aspect():
    assert steps_between(1.0, 1.2, 0.05) == pytest.approx([1.05, 1.1, 1.15, 1.2])
    assert steps_between(1.1, 1.2, 0.5) == [1.2]


def test_an_annealing_that_was_stopped_goes_on_to_the_same_packings(tmp_path):
    settings = {"particles": 16, "steps": (0.0, 0.1), "pressure": 1e-4, "seeds": (1,), "progress": silent}
    first = anneal_all(tmp_path / "a", aspects=(1.1,), **settings)
    both = anneal_all(tmp_path / "a", aspects=(1.1, 1.3), **settings)
    at_once = anneal_all(tmp_path / "b", aspects=(1.1, 1.3), **settings)
    assert [one.step for one in both] == [0.0, 0.0, 0.1, 0.1] and first[0] == both[0]
    assert [one.packing_fraction for one in both] == [one.packing_fraction for one in at_once]
    assert all(one.converged for one in both)
    draw_annealed(both, tmp_path / "annealing.png")
    assert (tmp_path / "annealing.png").stat().st_size > 10_000


def test_order_and_correlations_of_a_few_discs_are_drawn(tmp_path, monkeypatch):
    from packmech.validation.studies import structure

    monkeypatch.setattr(structure, "RATIOS", (1.2, 1.4))
    monkeypatch.setattr(structure, "ASPECTS", (1.3,))
    settings = {"seeds": (0,), "pressure": 1e-4, "progress": silent, "workers": 0}
    found = jam_all(tmp_path, particles=64, kinds=(DISCS,), **settings)
    found += jam_all(tmp_path, particles=16, kinds=(ELLIPSES,), **settings)
    assert [one.disorder for one in found] == [1.2, 1.4, 1.3] and all(one.converged for one in found)
    packing = packing_of(tmp_path, found[1])
    assert found[1].global_order == pm.bond_orientational_order(packing).global_order
    found += jam_all(tmp_path, particles=64, kinds=(DISCS,), **(settings | {"seeds": (1,)}))
    # one alone: maxima are those of its own g - 1 and of its own correlations less that of the mean, with their sign
    alone = correlate(tmp_path, found[:1])
    given = {"r_max": alone.r_b[-1] + 0.025, "bins": len(alone.r_b)}
    one = packing_of(tmp_path, found[0])
    own = pm.correlation_function(one, pm.bond_orientational_order(one, 6).psi_n, **given)
    assert alone.value_b == pytest.approx(np.abs(np.nan_to_num(own.value_b)), abs=1e-15)
    signed = np.nan_to_num(own.value_b) - own.mean_square
    excess = pm.pair_distribution(one, **given).g_b - 1.0
    for line, whole in ((alone.bond_length, signed), (alone.pair_length, excess)):
        there = np.searchsorted(alone.r_b, line.r_m)
        assert line.value_m == pytest.approx(whole[there], abs=1e-12) and (line.value_m > 0.0).all()
    assert len(alone.pair_length.r_m) > 0
    # boxes of two sizes
    correlated = [correlate(tmp_path, [one for one in found if one.disorder == ratio]) for ratio in (1.2, 1.4)]
    draw_order(found, correlated, tmp_path, tmp_path / "order.png")
    assert (tmp_path / "order.png").stat().st_size > 10_000


def test_a_spectrum_is_that_of_a_packing_at_the_pressure(tmp_path):
    packing = spectral_packing(64, 1, 3e-3)
    assert pm.pressure(pm.Scene(packing, (pm.Repulsion(),))) == pytest.approx(3e-3, rel=0.1)
    said = []
    given = (tmp_path, 64, (1,), 3e-3, lambda *one: said.append(one))
    assert [spectral_packings(*given, workers=0) for _ in range(2)] == [[packing]] * 2
    assert said == [(1, 1)] * 2
    found = measure_spectrum([packing], width=0.5)
    index = pm.wave_indices(packing.box, 12.0 / found.diameter, half=True)
    value = pm.spectral_density(packing, index) / found.diameter**2
    assert (found.filled.value_b * found.filled.count_b).sum() == pytest.approx(value.sum())
    assert found.filled.count_b.sum() == len(index)
    assert found.to_csv().count("\n") == len(found.filled.k_b) + 1
    fit = found.filled.power_law(0.5, 6.0)
    draw_spectrum(found, fit, tmp_path / "spectrum.png")
    assert math.isfinite(fit.exponent) and (tmp_path / "spectrum.png").stat().st_size > 10_000
    assert np.isfinite(found.centers.value_b).all()


def test_packings_tapped_and_sheared_on_are_those_of_one_go(tmp_path, monkeypatch):
    monkeypatch.setattr(
        preparations,
        "AMPLITUDES",
        {preparations.SHEARED: (0.02,), preparations.TAPPED: (0.1,), preparations.ANNEALED: (0.25,)},
    )
    settings = {"particles": 12, "pressure": 1e-4, "seeds": (1,), "progress": silent, "workers": 0}
    first = preparations.prepare_all(tmp_path, cycles=(1,), **settings)
    both = preparations.prepare_all(tmp_path, cycles=(1, 2), **settings)
    assert [(one.preparation, one.cycles) for one in both] == [(0, 0), (1, 1), (1, 2), (2, 1), (2, 2), (3, 0)]
    assert [one.settings for one in first] == [one.settings for one in both if one.cycles < 2]
    assert [one.packing_fraction for one in first] == [one.packing_fraction for one in both if one.cycles < 2]
    assert all(one.converged and one.states_of_self_stress >= 1 for one in both)
    preparations.draw_prepared(both, tmp_path / "preparations.png")
    assert (tmp_path / "preparations.png").stat().st_size > 10_000


def test_discs_of_hard_packings_have_three_contacts_or_more_unless_they_rattle(tmp_path):
    count = contact_numbers(tmp_path, particles=32, seeds=(0, 1), progress=lambda done, of: None, workers=0)
    assert count.sum() == 64 and count[1] == count[2] == 0 and count[3] > 0
    held = count[1:].sum()
    # one state of self stress each
    assert (np.arange(len(count)) * count).sum() / 2 == 2 * held - 2
    draw_contact_numbers(count, 32, tmp_path / "contacts.png")
    assert (tmp_path / "contacts.png").stat().st_size > 5_000


def test_stress_is_the_modulus_times_the_strain_up_to_the_first_change_of_contacts(tmp_path, monkeypatch):
    monkeypatch.setattr(families, "DISTANCES", (1e-3, 4e-3))
    monkeypatch.setattr(families, "DECADES", (1e-6, 1e-5, 1e-4))
    found = families.stress_over_strain(16, 1, "free", lambda distance: None)
    assert {one.distance for one in found} == {1e-3, 4e-3} and all(one.modulus > 0.0 for one in found)
    for distance in (1e-3, 4e-3):
        mine = [one for one in found if one.distance == pytest.approx(distance)]
        # what is off is the second order of the strain: in proportion to it, by a few times it
        off = np.array([(one.shear_stress / (one.modulus * one.strain) - 1.0) / one.strain for one in mine])
        assert off == pytest.approx(off[-1], rel=0.01) and abs(off[-1]) < 10.0
    families.draw_stress(found, tmp_path / "stress.png")
    assert (tmp_path / "stress.png").stat().st_size > 10_000
