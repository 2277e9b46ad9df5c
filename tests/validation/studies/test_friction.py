"""The study of friction: what is finished stays, and tables say what packings are."""

import numpy as np

from packmech.cli import execute
from packmech.validation.studies import friction
from packmech.validation.studies.rows import read_rows


def test_what_was_pressed_is_found_again_and_drawn(tmp_path, capsys):
    words = "--particles 24 --packings 1 --pressures 1e-3 --coefficients 0 1 --workers 0 --out".split()
    assert execute(["friction", *words, str(tmp_path)]) == 0
    found = read_rows(tmp_path / "friction-2d.csv", friction.Pressed)
    smooth, rough = sorted(found, key=lambda one: one.coefficient)
    assert rough.packing_fraction < smooth.packing_fraction
    assert rough.coordination_number < smooth.coordination_number
    assert max(one.residual for one in found) <= 1e-8
    assert (tmp_path / "friction-2d.png").stat().st_size > 10_000
    # nothing is pressed again
    before = {path: path.stat().st_mtime_ns for path in tmp_path.glob("members/*/workspace/*/result.json")}
    assert len(before) == 2
    assert execute(["friction", *words, str(tmp_path)]) == 0
    assert {path: path.stat().st_mtime_ns for path in before} == before
    assert read_rows(tmp_path / "friction-2d.csv", friction.Pressed) == found
    assert "friction-2d.png" in capsys.readouterr().out


def test_means_and_errors_are_those_of_the_packings():
    one = friction.Pressed(2, 8, 0.5, 1.0, 1e-3, 1e-4, 0, 0.8, 3.2, 3.0, 1, 0, 1e-9, 10, 1.0)
    other = friction.Pressed(2, 8, 0.5, 1.0, 1e-3, 1e-4, 1, 0.82, 3.4, 3.0, 1, 0, 1e-9, 10, 1.0)
    mu, mean, error = friction.over_friction([one, other], "packing_fraction")
    assert mu.tolist() == [0.5]
    np.testing.assert_allclose([mean[0], error[0]], [0.81, 0.01])
