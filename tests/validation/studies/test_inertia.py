"""The study of dense flow: what is finished stays, and lines are fitted with their errors."""

import numpy as np
import pytest

from packmech.cli import execute
from packmech.validation.studies import inertia
from packmech.validation.studies.rows import read_rows


def test_flows_are_found_again_and_drawn(tmp_path, monkeypatch, capsys):
    words = "--particles 40 --inertial-numbers 0.1 0.2 --pressure 1e-2 --workers 0 --out".split()
    monkeypatch.setattr(inertia, "_STRAIN", 3.0)
    assert execute(["inertia", *words, str(tmp_path)]) == 0
    found = read_rows(tmp_path / "inertia.csv", inertia.Flow)
    assert [one.inertial_number for one in found] == [0.1, 0.2]
    for one in found:
        assert abs(one.mean_pressure - one.pressure) < 5.0 * one.mean_pressure_error
        apart = one.stress_ratio - one.volume_stress_ratio
        assert abs(apart) < 5.0 * np.hypot(one.stress_ratio_error, one.volume_stress_ratio_error)
    assert (tmp_path / "inertia.png").stat().st_size > 10_000
    # nothing is sheared again
    monkeypatch.setattr(inertia.pm, "shear_at_pressure", None)
    assert execute(["inertia", *words, str(tmp_path)]) == 0
    assert "stress ratio:" in capsys.readouterr().out


def test_the_fit_of_a_line_is_exact_on_a_line():
    flows = [
        inertia.Flow(1, 0.4, 1e-3, x, 0, 0.25 + 1.1 * x, e, 0.81 - 0.3 * x, e, *[1.0] * 6, 1, 1.0)
        for x, e in ((0.01, 0.1), (0.05, 0.2), (0.1, 0.1))
    ]
    for name, line in (("stress_ratio", inertia.RATIO_LINE), ("packing_fraction", inertia.FRACTION_LINE)):
        (a, b), error = inertia.fit_line(flows, name)
        assert (a, b) == pytest.approx(line, rel=1e-12)
        assert (error > 0.0).all()
