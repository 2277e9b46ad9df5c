"""Facts about the study of silos: Janssen's law is found where it holds, and grains in one bear their weight."""

import numpy as np
import pytest

from packmech.validation.studies import silo


def test_a_silo_of_janssens_law_gives_its_length_and_ratio_back():
    depth = np.arange(1.0, 100.0, 2.0)
    width, friction, ratio, weight = 20.0, 0.4, 0.7, 1e-4
    length = width / (2.0 * friction * ratio)
    vertical = silo.janssen_stress(depth, length, 1.5, weight)
    found = silo.Silo(width, weight, depth, vertical, ratio * vertical, friction * ratio * vertical, 0.3)
    fit, surface = silo.fit_silo(found)
    assert (fit.length, surface) == pytest.approx((length, 1.5), rel=1e-6)
    assert (fit.wall_friction, fit.stress_ratio, fit.fitted_ratio) == pytest.approx((friction, ratio, ratio), rel=1e-6)
    # the law itself: what is not borne by the walls is added, d sigma / dz = weight - 2 mu K sigma / W
    z, step = 30.0, 1e-4
    slope = np.diff(silo.janssen_stress(np.array([z - step, z + step]), length, 1.5, weight))[0] / (2.0 * step)
    assert slope == pytest.approx(weight - silo.janssen_stress(z, length, 1.5, weight) / length, rel=1e-6)


@pytest.mark.slow
def test_walls_and_floor_bear_the_weight_of_grains_that_slide_slowly(tmp_path):
    (found,) = silo.lower_all(tmp_path, width=8.0, height=16.0, friction=0.5, seeds=[1], progress=lambda *_: None)
    again = silo.lower_all(tmp_path, width=8.0, height=16.0, friction=0.5, seeds=[1], progress=lambda *_: None)[0]
    assert np.array_equal(found.vertical_l, again.vertical_l)
    # between two levels the walls take what the grains between weigh less what is passed on; inertia is small
    layer = found.depth_l[1] - found.depth_l[0]
    passed = np.diff(found.vertical_l) * found.width
    taken = (found.wall_shear_l[1:] + found.wall_shear_l[:-1]) * layer
    inner = slice(1, -1)
    weight = found.weight * found.width * layer
    assert (passed + taken)[inner].mean() == pytest.approx(weight, rel=0.1)
    assert 0.0 < found.floor_part < 0.9
