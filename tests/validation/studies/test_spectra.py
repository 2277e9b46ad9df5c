"""Facts about the studies of vibrations and of hard packings: balance of forces, counts, exponents, resumption."""

import numpy as np
import pytest

import packmech as pm
from packmech.validation.studies import spectra as study
from packmech.validation.studies.rows import kept_of


def nothing(done, of, last):
    pass


def test_forces_of_a_hard_packing_balance_and_press_on_contacts_only(tmp_path):
    (row,) = study.touch_all(tmp_path, dimension=2, particles=32, seeds=[1], progress=nothing, workers=0)
    (found,) = study.read_contacts(tmp_path, [row])
    assert row.contacts == row.isostatic_contacts == len(found.force_c)
    assert row.force_imbalance < 1e-10
    assert found.force_c.mean() == pytest.approx(1.0)
    assert (found.force_c > 0.0).all() and (found.gap_p > 1e-9).all()
    # three contacts a buckler, of which two bucklers may share one
    assert row.bucklers <= np.count_nonzero(found.on_buckler_c) <= 3 * row.bucklers


def test_a_power_law_is_found_below_the_largest_value_with_its_error():
    rng = np.random.default_rng(2)
    parts = [np.concatenate([rng.random(500) ** (1.0 / 0.6), 1.0 + rng.random(100)]) for _ in range(40)]
    exponent, error, count = study.small_exponent(parts, 1.0)
    assert count == 20_000
    assert exponent == pytest.approx(-0.4, abs=4.0 * error) and error == pytest.approx(0.6 / np.sqrt(count), rel=0.4)


def test_modes_of_a_packing_are_kept_and_found_again(tmp_path):
    given = {"dimension": 2, "particles": 12, "aspects": [1.0], "seeds": [1], "progress": nothing, "workers": 0}
    (row,) = study.vibrate_all(tmp_path, **given)
    kept = kept_of(study.states_table(tmp_path, 2), row).arrays()
    assert len(kept["frequency_m"]) == row.modes
    assert (kept["rotation_m"] == 0.0).all()
    assert ((kept["participation_m"] > 0.0) & (kept["participation_m"] <= 1.0)).all()
    study.draw_states([row], tmp_path, tmp_path / "states.png")
    assert study.vibrate_all(tmp_path, **given) == [row]


def test_the_plateau_of_states_ends_where_the_density_falls_to_half():
    """Uniform from .1 to 1 and nothing below: averaged over a quarter to both sides, half is reached near the step."""
    edge = np.geomspace(1e-3, 2.0, 200)
    count = np.round(1e6 * np.diff(np.clip(edge, 0.1, 1.0))).astype(np.int64)
    states = pm.StateDensity(edge, count, int(count.sum()), 0.0)
    assert states.plateau == pytest.approx(1.0 / 0.9, rel=1e-3)
    assert states.plateau_edge == pytest.approx(0.1, rel=0.05)
    both = pm.StateDensity.merged([states, states])
    assert both.modes == 2 * states.modes and both.plateau_edge == states.plateau_edge
