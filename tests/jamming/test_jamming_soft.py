"""Crystals that shear or turn freely do so too when coordinates carry noise, few digits or a shift, or are strained."""

import numpy as np
import pytest

import packmech as pm

# collectively and strictly jammed, of 2 x 2 (x 2) cells
ANSWERS = {
    "square": ("not jammed", "not jammed"),
    "kagome": ("not jammed", "not jammed"),
    "honeycomb": ("not jammed", "not jammed"),
    "snub square": ("jammed", "not jammed"),
    "sc": ("not jammed", "not jammed"),
    "triangular": ("jammed", "jammed"),
    "snub hexagonal": ("jammed", "jammed"),
}
METHODS = ("certificate", "loads")


def answers(packing, method, **how):
    verdict = pm.classify_jamming(packing, method=method, **how)
    return verdict.collective, verdict.strict


def moved(packing, position_nd):
    return packing.replace(position_nd=position_nd)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", ANSWERS)
def test_a_shift_by_many_diameters_changes_no_answer(name, method):
    crystal = pm.lattice_packing(name, 2)
    for shift in (1e3 / 3, 1e4 / 7):
        assert answers(moved(crystal, crystal.position_nd + shift), method) == ANSWERS[name]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", ANSWERS)
@pytest.mark.parametrize("digits", [12, 10])
def test_coordinates_of_few_digits_change_no_answer(name, method, digits):
    crystal = pm.lattice_packing(name, 2)
    rounded = moved(crystal, np.round(crystal.position_nd, digits))
    # the box keeps its digits; so pairs across its edge open by as much
    assert answers(rounded, method, rest_tolerance=np.inf, gap_tolerance=1e-8) == ANSWERS[name]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", ["square", "kagome", "sc"])
def test_noise_of_the_coordinates_makes_no_floppy_crystal_rigid(name, method):
    crystal = pm.lattice_packing(name, 3, relative_overlap=1e-4)
    noise = 1e-12 * np.random.default_rng(0).normal(size=crystal.position_nd.shape)
    assert answers(moved(crystal, crystal.position_nd + noise), method) == ("not jammed", "not jammed")


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize("name", ANSWERS)
def test_a_strain_below_the_gap_tolerance_changes_no_answer(name, method):
    crystal = pm.lattice_packing(name, 2)
    d = crystal.dimension
    rng = np.random.default_rng(1)
    for size in (1e-13, 1e-12, 1e-11):
        strain = rng.normal(size=(d, d))
        change = np.eye(d) + size * (strain + strain.T) / 2
        strained = pm.Packing(crystal.position_nd @ change.T, crystal.radius_n, pm.Box(change @ crystal.box.lattice_dd))
        assert answers(strained, method, rest_tolerance=np.inf) == ANSWERS[name]


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(("shape", "count", "seed"), [(pm.Dimer(), 6, 120), (pm.Trimer(), 12, 3)])
def test_clusters_jammed_in_a_fixed_box_that_shears_freely_are_not_strictly_jammed(shape, count, seed, method):
    start = pm.cluster_packing(count, shape, dimension=2, packing_fraction=0.4, largest_overlap=0.1, seed=seed)
    packing = pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=1e-7, strain="isotropic", check=False).packing
    assert answers(packing, method) == ("jammed", "not jammed")
