"""The study of families: first changes of one packing over pressure, and slopes, go on where they were."""

import math

from packmech.validation.studies import families as study


def silent(done, of, last):
    """Report nothing."""


def test_first_changes_of_a_packing_are_found_from_its_sweep_and_found_again(tmp_path, monkeypatch):
    given = {"particles": [10], "seeds": [1], "progress": silent, "workers": 0}
    found = study.first_changes(tmp_path, pressures=[1e-3, 1e-2], **given)
    assert [one.pressure for one in found] == [1e-2, 1e-3]
    for one in found:
        assert math.isclose(one.strain, one.strain_from_above, rel_tol=1e-10)
    monkeypatch.setattr(study, "jammed_discs", None)
    assert study.first_changes(tmp_path, pressures=[1e-3, 1e-2], **given) == found
    study.draw_first_changes(found, tmp_path / "first-change.png")
    assert (tmp_path / "first-change.png").stat().st_size > 10_000


def test_slopes_are_the_stress_ratio(tmp_path):
    (one,) = study.compare_slopes(tmp_path, [(10, 1.0, 1, 0.01)], silent, workers=0)
    assert one.compared and one.largest_error < 1e-6 * max(one.largest_slope, 1.0)
