"""Facts about one packing followed from stress to stress: what it bears, and how its box answers."""

import numpy as np
import pytest

import packmech as pm
from packmech.linalg.mandel import mandel_basis


def jammed(dimension=2, pressure=1e-3, seed=1, law=None, count=48):
    drawn = pm.random_packing(
        count, dimension=dimension, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.6, seed=seed
    )
    start = pm.Scene(drawn, (pm.Repulsion(law or pm.Harmonic()),))
    return start.replace(packing=pm.jam(start, pressure=pressure).packing)


def sheared(dimension, pressure, size, axes=(0, 1)):
    stress = -pressure * np.eye(dimension)
    stress[axes] += size * pressure
    stress[axes[::-1]] = stress[axes]
    return stress


def strain_between(one, other):
    """Return the symmetric strain of a small change of the box."""
    change = other.box.lattice_dd @ one.box.inverse_dd - np.eye(one.dimension)
    return 0.5 * (change + change.T)


@pytest.mark.parametrize("dimension", [2, 3])
def test_stresses_are_reached_in_balance_whatever_their_shape(dimension):
    scene = jammed(dimension)
    uniaxial = -1e-3 * np.eye(dimension)
    uniaxial[0, 0] *= 1.05
    asked = [sheared(dimension, 1e-3, 0.02), uniaxial, sheared(dimension, 2e-3, -0.03, (dimension - 1, 0))]
    runs = pm.sweep_stress(scene, asked)
    for run, stress in zip(runs, asked, strict=True):
        there = scene.replace(packing=run.packing)
        scale = np.trace(-stress) / dimension
        assert np.abs(pm.stress_tensor(there) / there.pressure_unit - stress).max() < 1e-9 * scale
        assert run.residual < 1e-8 and run.report["stress_error"] < 1e-9


def test_the_box_answers_as_the_moduli_of_the_cauchy_stress_say():
    """Central differences over steps so small that no contact changes: a third of the step, a tenth of the error."""
    scene = jammed(seed=2, law=pm.Hertz())
    found = pm.elastic_moduli(scene)
    tangent = found.cauchy
    unit = scene.pressure_unit
    for axes, size, largest in (((0, 1), 3e-8, 1e-6), ((0, 1), 1e-8, 1e-7), ((0, 0), 1e-8, 1e-7), ((1, 1), 1e-8, 1e-7)):
        change = np.zeros((2, 2))
        change[axes] = change[axes[::-1]] = size
        plus, minus = (pm.sweep_stress(scene, [found.stress_dd / unit + sign * change])[0] for sign in (1.0, -1.0))
        assert plus.report["rearrangements"] == minus.report["rearrangements"] == 0
        strain = strain_between(scene.packing, plus.packing) - strain_between(scene.packing, minus.packing)
        answer = tangent @ np.einsum("kab,ab->k", mandel_basis(2), strain)
        asked = np.einsum("kab,ab->k", mandel_basis(2), 2.0 * unit * change)
        assert np.abs(answer - asked).max() < largest * np.abs(asked).max()


def test_pressures_alone_lead_along_the_way_of_sweep_pressure():
    scene = jammed(seed=3, pressure=1e-5)
    goals = [2e-5, 1e-4]
    by_stress = pm.sweep_stress(scene, [-p * np.eye(2) for p in goals])
    by_pressure = pm.sweep_pressure(scene, goals, strain="free")
    for one, other in zip(by_stress, by_pressure, strict=True):
        assert np.abs(strain_between(one.packing, other.packing)).max() < 1e-9
        assert one.report["contacts"] == other.report["contacts"]


def test_the_way_back_ends_where_it_began_while_nothing_rearranges():
    scene = jammed(3)
    runs = pm.sweep_stress(scene, [sheared(3, 1e-3, 0.005), sheared(3, 1e-3, 0.01), sheared(3, 1e-3, 0.005)])
    assert [run.report["rearrangements"] for run in runs] == [0, 0, 0]
    assert np.abs(strain_between(runs[0].packing, runs[2].packing)).max() < 1e-12


def test_packings_with_links_bear_shear_stress_too():
    drawn = pm.cluster_packing(16, pm.Dimer(0.75), dimension=2, packing_fraction=0.4, largest_overlap=0.1, seed=4)
    start = pm.Scene(drawn, (pm.Repulsion(pm.Harmonic()),))
    scene = start.replace(packing=pm.jam(start, pressure=1e-3).packing)
    asked = sheared(2, 1e-3, 0.01)
    (run,) = pm.sweep_stress(scene, [asked])
    there = scene.replace(packing=run.packing)
    assert np.abs(pm.stress_tensor(there) / there.pressure_unit - asked).max() < 1e-12
    links = run.packing.links
    vectors = links.vectors(run.packing.position_nd, run.packing.box.lattice_dd)
    assert np.abs(np.hypot(*vectors.T) - links.length_l).max() < 1e-12


def test_beyond_the_yield_stress_the_run_says_that_it_does_not_converge():
    scene = jammed(seed=6, pressure=1e-3, count=16)
    (run,) = pm.sweep_stress(scene, [sheared(2, 1e-3, 0.9)], check=False)
    assert not run.ok and run.report["stress_error"] > 1e-3


def test_stresses_are_checked():
    scene = jammed(count=16)
    for stress, what in (
        ([[-1.0, 0.1], [0.0, -1.0]], r"stresses\[0\] must be symmetric"),
        ([[1.0, 0.0], [0.0, -1.0]], r"stresses\[0\] must have a positive pressure"),
        ([-1.0, -1.0], "stresses must have shape"),
    ):
        with pytest.raises(ValueError, match=what):
            pm.sweep_stress(scene, [stress])


def test_a_packing_of_ellipses_that_falls_into_another_minimum_on_the_way_says_so():
    ellipses = pm.random_packing(
        24, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.6, seed=0, shapes=pm.Ellipses(1.3)
    )
    scene = pm.Scene(ellipses, (pm.Repulsion(),))
    scene = scene.replace(packing=pm.jam(scene, pressure=1e-4, strain="free").packing)
    shear = np.array([[0.0, 1.0], [1.0, 0.0]])
    loads = [-1e-4 * (np.eye(2) + share * shear) for share in (0.06, 0.08, 0.06)]
    there, beyond, back = pm.sweep_stress(scene, loads)
    # the same load twice: other contacts, another packing fraction
    assert abs(pm.packing_fraction(back.packing) - pm.packing_fraction(there.packing)) > 1e-3
    assert beyond.report["rearrangements"] + back.report["rearrangements"] > 0
