"""Facts about the stability of whole scenes: closed forms for rows, and what counts as no instability."""

import numpy as np
import pytest

import packmech as pm
from packmech.linalg.factor import NotDefinite
from packmech.mechanics import stability as module
from packmech.mechanics.stability import Stability, stability


def row(count, overlap, dimension):
    position = np.full((count, dimension), 1.5)
    position[:, 0] = np.arange(count) + 0.5
    box = pm.Box(np.diag([float(count)] + [3.0] * (dimension - 1)))
    return pm.Scene(pm.Packing(position, np.full(count, 0.5 * (1.0 + overlap)), box), (pm.Repulsion(),))


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("count", [3, 4, 7])
@pytest.mark.parametrize("overlap", [1e-6, 0.05])
def test_a_straight_row_has_an_unstable_direction_across_for_each_wave_but_the_uniform_one(count, overlap, dimension):
    # curvature across at wave number q: -2 (1 - cos q) times force over distance
    assert stability(row(count, overlap, dimension)).negative == (count - 1) * (dimension - 1)


@pytest.mark.parametrize(
    ("overlap", "unbalanced", "unstable"), [(1e-11, 0.0, 0), (1e-9, 0.0, 2), (1e-9, 1e-8, 0), (1e-8, 1.0, 2)]
)
def test_curvatures_count_beyond_rounding_and_what_is_unbalanced_and_always_beyond_5e_9(overlap, unbalanced, unstable):
    # two waves across three discs of stiffness 2, of curvature -3 times the overlap: rounding is 2e-10; forces that do
    # not balance explain four times their size over the radius, but never more than 1e-8
    assert stability(row(3, overlap, 2), unbalanced).negative == unstable


def test_links_in_a_straight_row_push_it_aside_as_contacts_do():
    # links bear the row's force where they stand in for contacts: each wave but the uniform one falls away
    scene = row(4, 0.05, 2)
    links = pm.Links([0, 2], [1, 3], [[0, 0], [0, 0]], [1.0, 1.0])
    assert stability(scene.replace(packing=scene.packing.replace(links=links))).negative == 3


def test_links_whose_forces_nothing_determines_are_refused_and_not_judged():
    # three discs in a line, each linked to both others: no length changes to first order as the middle one moves aside
    scene = row(6, 0.05, 2)
    links = pm.Links([0, 1, 0], [1, 2, 2], [[0, 0]] * 3, [1.0, 1.0, 2.0])
    with pytest.raises(ValueError, match="links that hold to first order"):
        stability(scene.replace(packing=scene.packing.replace(links=links)))


def test_shapes_whose_effects_have_no_second_derivative_are_not_judged(monkeypatch):
    packing = pm.random_packing(4, dimension=2, packing_fraction=0.3, seed=0, shapes=pm.Ellipses(1.5))
    scene = pm.Scene(packing, (pm.Repulsion(),))
    assert stability(scene).negative is not None
    monkeypatch.setattr(module, "lacking_second", lambda effects: effects)
    found = stability(scene)
    assert found.negative is None and found.reason == "Repulsion has no body_second"


def test_what_is_not_judged_does_not_pass_for_a_minimum(monkeypatch):
    def fail(scene):
        raise NotDefinite("no factor")

    monkeypatch.setattr(module, "curvature_of", fail)
    found = stability(row(3, 0.05, 2))
    assert found.negative is None and found.unstable == 1
    assert found.to_dict() == {"negative_modes": None, "not_judged": f"minimum or saddle: {found.reason}"}
    assert Stability(0).to_dict() == {"negative_modes": 0} and Stability(0).unstable == 0
    with pytest.raises(ValueError, match="must be unstable for a direction, got None"):
        found.direction()


def test_the_direction_that_is_given_is_among_the_lowest_curvatures():
    scene = row(6, 0.05, 2)
    step = stability(scene).direction().ravel()
    curvature = float(step @ (pm.hessian(scene, "none") @ step) / (step @ step))
    sigma = 2.0 * float(scene.packing.radius_n[0])
    lowest = -4.0 * (sigma - 1.0) / sigma**2
    assert lowest <= curvature * (1.0 - 1e-12) and curvature < 0.25 * lowest


def test_a_packing_at_rest_with_rattlers_has_no_unstable_direction():
    packing = pm.random_packing(64, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.86, seed=3)
    run = pm.quench(pm.Scene(packing, (pm.Repulsion(),)), force_tolerance=1e-12)
    assert pm.find_rattlers(run.packing).any() and stability(pm.Scene(run.packing, (pm.Repulsion(),))).negative == 0


@pytest.mark.parametrize("energy_scale", [1e-12, 1e12])
def test_the_unit_of_energy_makes_nothing_stable_and_nothing_fall(energy_scale):
    for scene in (row(3, 1e-8, 2), row(3, 0.05, 2), row(3, 1e-11, 2)):
        other = scene.replace(effects=(pm.Repulsion(law=pm.Harmonic(energy_scale)),))
        assert stability(other).negative == stability(scene).negative
