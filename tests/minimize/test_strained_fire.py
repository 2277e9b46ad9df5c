"""Facts about FIRE with the box: the stress that it balances is that of the packing, and its lists lose no pair."""

import numpy as np
import pytest

import packmech as pm
from packmech.linalg.mandel import mandel_basis
from packmech.minimize.first_order.strain_fire import StrainedFire
from packmech.minimize.program import build_program

PRESSURE = 0.05


def fire(packing):
    scene = pm.Scene(packing, (pm.Repulsion(),))
    basis = mandel_basis(packing.dimension)
    return scene, StrainedFire(build_program(scene), packing, basis, PRESSURE, tolerance=1e-13, step_limit=10**6)


def stress(one):
    """Return the stress that pulls at the box, tension positive."""
    strains, d = one._strains, one.packing.dimension
    pull = strains.pull_dd[:d, :d] * strains.scale / one.packing.box.volume
    return -pull - PRESSURE * np.eye(d)


def packings():
    yield "discs", pm.random_packing(40, dimension=2, packing_fraction=1.0, seed=1)
    yield "spheres", pm.random_packing(40, dimension=3, packing_fraction=0.75, seed=1)
    yield "ellipses", pm.random_packing(30, dimension=2, packing_fraction=0.95, shapes=pm.Ellipses(1.5), seed=1)


@pytest.mark.parametrize("packing", [pytest.param(one, id=name) for name, one in packings()])
def test_the_stress_that_pulls_at_the_box_is_that_of_the_packing(packing):
    scene, one = fire(packing)
    for steps in (0, 1, 7, 40):
        one.advance(steps)
        expected = pm.stress_tensor(scene.replace(packing=one.packing))
        assert np.abs(stress(one) - 0.5 * (expected + expected.T)).max() < 1e-11 * np.abs(expected).max()


@pytest.mark.parametrize("unit", [1e-3, 1.0, 1e3])
def test_discs_at_one_place_press_as_they_do_in_every_unit(unit):
    start = pm.random_packing(30, dimension=2, packing_fraction=0.9, seed=1)
    position = start.position_nd.copy()
    position[1] = position[0]
    packing = pm.Packing(position * unit, start.radius_n * unit, pm.Box(start.box.lattice_dd * unit))
    scene, one = fire(packing)
    assert one.relaxation().pressure == pytest.approx(pm.pressure(scene), rel=1e-12)


@pytest.mark.parametrize(("dimension", "fraction", "seed"), [(2, 0.7, 0), (2, 1.2, 1), (3, 0.5, 2)])
def test_lists_that_go_with_the_box_lose_no_pair(dimension, fraction, seed):
    packing = pm.random_packing(64, dimension=dimension, packing_fraction=fraction, seed=seed)
    scene, one = fire(packing)
    for k in range(30):
        one.advance(1 + 3 * k % 17)
        expected = pm.pressure(scene.replace(packing=one.packing))
        assert one.relaxation().pressure == pytest.approx(expected, rel=1e-9, abs=1e-12)
