"""Facts that join jamming, counting and elasticity."""

import numpy as np
import pytest

import packmech as pm


def jammed(particles, dimension, strain, seed, pressure=1e-7):
    sizes = pm.Bidisperse(ratio=1.4) if dimension == 2 else pm.Monodisperse()
    fraction = 0.87 if dimension == 2 else 0.68
    start = pm.random_packing(particles, dimension=dimension, sizes=sizes, packing_fraction=fraction, seed=seed)
    scene = pm.Scene(start, (pm.Repulsion(law=pm.Harmonic()),))
    return scene.replace(packing=pm.jam(scene, pressure=pressure, strain=strain).packing)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize(("strain", "admitted"), [("isotropic", "none"), ("free", "isochoric")])
def test_a_jammed_packing_has_one_state_of_self_stress_and_its_rattlers_are_all_that_is_floppy(
    dimension, strain, admitted
):
    scene = jammed(32, dimension, strain, 1)
    backbone, _ = pm.remove_rattlers(scene.packing)
    selves, modes = pm.states_of_self_stress(backbone, admitted), pm.floppy_modes(backbone, admitted)
    assert (selves.count, modes.count) == (1, 0)
    assert selves.certain and modes.certain
    strains = 0 if strain == "isotropic" else dimension * (dimension + 1) // 2 - 1
    assert selves.contacts == backbone.position_nd.size - dimension + strains + 1
    # the one state is what the particles press with: of one sign
    force = selves.force_ck[:, 0]
    assert force.min() > 0 or force.max() < 0


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_shear_stabilized_packing_is_stable_and_its_moduli_are_positive(dimension):
    moduli = pm.elastic_moduli(jammed(32, dimension, "free", 2))
    assert moduli.stable and moduli.negative_modes == 0
    assert np.linalg.eigvalsh((moduli.cauchy + moduli.cauchy.T) / 2).min() > 0
    assert moduli.bulk_modulus > moduli.voigt.shear_modulus > 0
    assert 0 < moduli.poisson_ratio < (1.0 if dimension == 2 else 0.5)
    stress = moduli.stress_dd
    assert np.abs(stress + moduli.pressure * np.eye(dimension)).max() < 1e-5 * moduli.pressure


def test_prestress_matters_in_proportion_to_the_pressure():
    differences = []
    for pressure in (1e-5, 1e-7):
        scene = jammed(32, 2, "free", 3, pressure)
        exact, unstressed = (pm.elastic_moduli(scene, kind=kind).cauchy for kind in ("exact", "unstressed"))
        differences.append(np.abs(exact - unstressed).max() / np.abs(unstressed).max())
    assert 30 < differences[0] / differences[1] < 300


def test_all_modes_of_a_jammed_packing_vibrate():
    scene = jammed(64, 2, "isotropic", 1)
    modes = pm.normal_modes(scene)
    assert modes.negative == 0 and not modes.zero_m.any()
    assert modes.available == 2 * (len(modes.index_n) - 1)
