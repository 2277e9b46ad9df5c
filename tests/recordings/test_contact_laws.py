"""Facts about the figure of contact laws: Hertz's force, and which law is the stiffest at which overlap."""

import math

import matplotlib.pyplot as plt
import pytest

import packmech as pm


def test_hertz_force_is_that_of_two_equal_spheres(script):
    laws = script("contact_laws")
    # 4/3 E* sqrt(R*) dx^(3/2) with E* = E / (2 (1 - nu^2)) and R* = R/2
    modulus, radius = 8000.0 / (2.0 * (1.0 - 0.3**2)), 10.0 / 2.0
    expected = 4.0 / 3.0 * modulus * math.sqrt(radius) * 2.0**1.5
    assert laws.hertz_force(2.0, 8000.0, 10.0, poisson_ratio=0.3) == pytest.approx(expected, rel=1e-14)
    # the source rounds the factor of a layer
    assert laws.layer_force(2.0, 8000.0, 10.0) == pytest.approx(1.1 * 8000.0 * 10.0**-0.5 * 2.0**1.5, rel=0.01)


def test_force_laws_are_ordered_as_in_the_documentations_figure(script):
    laws, stiffness = script("contact_laws"), pm.material_constants(young_modulus=8000.0).stiffness
    # E = 8 kPa, r = 10 um; the Hertz force is per layer, in N/m as the others
    for overlap, largest in ((2.0, "linear"), (19.0, "divergent")):
        forces = {
            "linear": -pm.LinearSpring(stiffness).first(20.0 - overlap, 20.0),
            "divergent": -pm.DivergentRepulsion(stiffness).first(20.0 - overlap, 20.0),
            "hertz": laws.layer_force(overlap, 8000.0, 10.0),
        }
        assert forces["divergent"] >= forces["linear"]
        if largest == "divergent":
            assert forces["divergent"] > forces["hertz"] > forces["linear"]
        else:
            assert forces["hertz"] < 2.0 * forces["linear"]


def test_the_figure_is_drawn(script, tmp_path):
    script("contact_laws").draw(tmp_path / "laws.png")
    plt.close("all")
    assert (tmp_path / "laws.png").stat().st_size > 10_000
