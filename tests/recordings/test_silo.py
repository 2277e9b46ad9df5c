"""Facts about the study of silos: Janssen's law is found where it holds, and grains in one bear their weight."""

import numpy as np
import pytest


def test_a_silo_of_janssens_law_gives_its_length_and_ratio_back(script, tmp_path):
    study = script("silo/janssen")
    depth = np.arange(1.0, 100.0, 2.0)
    width, friction, ratio, weight = 20.0, 0.4, 0.7, 1e-4
    length = width / (2.0 * friction * ratio)
    vertical = study.janssen(depth, length, 1.5, weight)
    constant = np.full(len(depth), weight), np.full(len(depth), 0.3)
    columns = np.array([depth, vertical, ratio * vertical, friction * ratio * vertical, *constant])
    assert study.fit(columns, width) == pytest.approx((length, 1.5, friction, ratio), rel=1e-6)
    # the law itself: what is not borne by the walls is added, d sigma / dz = weight - 2 mu K sigma / W
    z, step = 30.0, 1e-4
    slope = np.diff(study.janssen(np.array([z - step, z + step]), length, 1.5, weight))[0] / (2.0 * step)
    assert slope == pytest.approx(weight - study.janssen(z, length, 1.5, weight) / length, rel=1e-6)
    np.savetxt(tmp_path / "silo-w20-h100-mu0.5-seed0.csv", columns.T, delimiter=",", header="names", comments="")
    study.main(out=tmp_path)
    assert (tmp_path / "silo.png").stat().st_size > 10_000


@pytest.mark.slow
def test_walls_and_floor_bear_the_weight_of_grains_that_slide_slowly(script):
    found = script("silo/silo").lower(8.0, 16.0, 0.5, 1)
    # between two levels the walls take what the grains between weigh less what is passed on; inertia is small
    layer = found["depth"][1] - found["depth"][0]
    passed = np.diff(found["vertical"]) * 8.0
    taken = (found["wall_shear"][1:] + found["wall_shear"][:-1]) * layer
    weight = found["weight"][0] * 8.0 * layer
    assert (passed + taken)[1:-1].mean() == pytest.approx(weight, rel=0.1)
    assert 0.0 < found["floor_part"][0] < 0.9
