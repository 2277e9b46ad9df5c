"""Closed forms of the elastic moduli of crystals."""

from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

import packmech as pm
from packmech.mechanics import elasticity
from packmech.mechanics.linked_systems import FreeOperator
from packmech.mechanics.modes import _missed

ROOT = 3**0.5


def crystal(name, repeats, overlap=0.0, diameter=1.0, law=None):
    packing = pm.lattice_packing(name, repeats=repeats, relative_overlap=overlap, diameter=diameter)
    return pm.Scene(packing, (pm.Repulsion(law=law or pm.Harmonic()),))


@pytest.mark.parametrize("overlap", [0.0, 1e-6, 0.01, 0.1, 0.24])
@pytest.mark.parametrize("repeats", [(1, 1), (2, 3), (4, 4)])
def test_triangular_crystal_has_its_closed_forms(overlap, repeats):
    diameter = 1.3
    moduli = pm.elastic_moduli(crystal("triangular", repeats, overlap, diameter))
    unit = 1.0 / ((1.0 - overlap) * diameter**2)
    energy = moduli.average("hill", tangent="energy")
    found = [
        moduli.pressure, energy.bulk_modulus, energy.shear_modulus, moduli.bulk_modulus, moduli.shear_modulus,
        moduli.hill.bulk_modulus, moduli.hill.shear_modulus,
    ]  # fmt: skip
    bulk, shear = ROOT / 2 * unit, ROOT * (1 - 4 * overlap) / 4 * unit
    expected = [
        ROOT * overlap * unit, ROOT / 2 / diameter**2, ROOT * (1 - 2 * overlap) / 4 * unit, bulk, shear, bulk, shear,
    ]  # fmt: skip
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10)
    assert abs(moduli.anisotropy) < 1e-10
    assert moduli.stable and not len(moduli.soft_directions) and not len(moduli.stiff_directions)


@pytest.mark.parametrize("overlap", [0.0, 0.01, 0.05])
@pytest.mark.parametrize("repeats", [(1, 1, 1), (2, 2, 2)])
def test_fcc_crystal_has_its_closed_forms(overlap, repeats):
    diameter = 1.1
    q, t, volume = 1 - overlap, -overlap * (1 - overlap), diameter**3 * (1 - overlap) ** 3 / 2**0.5
    pressure = -2 * t / volume
    moduli = pm.elastic_moduli(crystal("fcc", repeats, overlap, diameter))
    assert abs(moduli.pressure - pressure) < 1e-10
    for name, energy, cauchy in (
        ("xxxx", (q + 2 * t) / volume, (q + 2 * t) / volume),
        ("xxyy", q / (2 * volume), q / (2 * volume) + pressure),
        ("yzyz", (q / 2 + t) / volume, (q / 2 + t) / volume - pressure / 2),
        ("xyxy", (q / 2 + t) / volume, (q / 2 + t) / volume - pressure / 2),
        ("xxyz", 0.0, 0.0),
    ):
        assert abs(moduli.component(name, tangent="energy") - energy) < 1e-10
        assert abs(moduli.component(name) - cauchy) < 1e-10


def test_stored_crystals_agree(golden):
    for name, stored in golden("crystal_moduli.json").items():
        if name == "source":
            continue
        position = stored.get("positions", [[0.0, 0.0, 0.0]])
        packing = pm.Packing(position, [stored["radius"]] * len(position), pm.Box(stored["lattice_columns"]))
        moduli = pm.elastic_moduli(pm.Scene(packing, (pm.Repulsion(),)))
        assert abs(moduli.pressure - stored["pressure"]) < 1e-10
        if "C_energy_mandel" in stored:
            np.testing.assert_allclose(moduli.energy, stored["C_energy_mandel"], rtol=0, atol=1e-10)
            assert abs(moduli.bulk_modulus - stored["K_cauchy"]) < 1e-10
            assert abs(moduli.shear_modulus - stored["G_cauchy"]) < 1e-10
        else:
            averages = stored["averages"]
            for letter, bound in (("V", "voigt"), ("R", "reuss"), ("H", "hill")):
                found = moduli.average(bound, tangent="energy")
                assert abs(found.bulk_modulus - averages[f"K_{letter}"]) < 1e-10
                assert abs(found.shear_modulus - averages[f"G_{letter}"]) < 1e-10
            assert abs(found.poisson_ratio - averages["nu_H"]) < 1e-10
            assert abs(found.young_modulus - averages["E_H"]) < 1e-10
            if stored["xi"] == 0.0:
                assert abs(moduli.anisotropy - 0.6) < 1e-10


def test_crystals_at_contact_have_their_exact_moduli(golden):
    stored = golden("lattice_exact.json")["moduli"]
    hexagonal, fcc = (pm.elastic_moduli(crystal(name, (2,) * d)) for name, d in (("triangular", 2), ("fcc", 3)))
    assert abs(hexagonal.shear_modulus - stored["hexagonal"]["G"]) < 1e-10
    assert abs(hexagonal.bulk_modulus - stored["hexagonal"]["B"]) < 1e-10
    assert abs(fcc.bulk_modulus - stored["fcc"]["B"]) < 1e-10
    for name, key in (("xxxx", "C11"), ("xxyy", "C12"), ("xyxy", "C44")):
        assert abs(fcc.component(name) - stored["fcc"][key]) < 1e-10
    assert pm.elastic_moduli(crystal("square", (3, 3))).shear_modulus == stored["square"]["G_simple_shear_along_axes"]


@pytest.mark.parametrize("repeats", [(1, 1), (2, 2), (3, 4), (6, 6)])
def test_kagome_has_finite_moduli_because_its_floppy_modes_carry_no_strain(repeats):
    moduli = pm.elastic_moduli(crystal("kagome", repeats))
    assert abs(moduli.bulk_modulus - ROOT / 4) < 1e-10
    assert abs(moduli.shear_modulus - ROOT / 8) < 1e-10
    assert abs(moduli.anisotropy) < 1e-9
    assert not len(moduli.soft_directions) and moduli.stable
    if repeats[0] == repeats[1]:
        assert moduli.floppy_positions == 3 * repeats[0] - 2


@pytest.mark.parametrize("repeats", [(1, 1), (2, 2), (5, 5)])
def test_shear_of_the_square_crystal_is_soft_not_stiff(repeats):
    moduli = pm.elastic_moduli(crystal("square", repeats))
    assert abs(moduli.shear_modulus) < 1e-12 and moduli.reuss.shear_modulus == 0.0
    np.testing.assert_allclose(np.abs(moduli.soft_directions), [[0.0, 0.0, 1.0]], atol=1e-12)
    assert moduli.compliance[2, 2] == np.inf and np.isfinite(moduli.compliance[:2, :2]).all()
    np.testing.assert_allclose(moduli.compliance[:2, :2], np.eye(2), atol=1e-12)
    assert moduli.stable and moduli.negative_modes == 0
    assert moduli.anisotropy == np.inf


@pytest.mark.parametrize("overlap", [0.01, 0.1])
def test_square_crystal_under_pressure_has_the_shear_modulus_minus_the_pressure_and_is_unstable(overlap):
    for repeats in ((1, 1), (4, 4)):
        moduli = pm.elastic_moduli(crystal("square", repeats, overlap))
        energy = np.diag(moduli.energy)
        np.testing.assert_allclose(
            energy * (1 - overlap) ** 2, [(1 - overlap) ** 2] * 2 + [-overlap * (1 - overlap)], atol=1e-10
        )
        assert abs(moduli.shear_modulus + moduli.pressure) < 1e-10
        assert not moduli.stable and moduli.negative_strains == 1
        value = np.linalg.eigvalsh(pm.hessian(crystal("square", repeats, overlap), "none").toarray())
        assert moduli.negative_positions == int((value < -1e-9).sum())


@pytest.mark.parametrize(("overlap", "unstable"), [(0.0, 0), (1e-12, 0), (1e-9, 1), (1e-6, 1)])
def test_the_least_pressure_shears_the_square_crystal_away_and_rounding_of_none_does_not(overlap, unstable):
    # the energy along its shear is minus the pressure; below 1e-10 of the stiffness it counts as none
    moduli = pm.elastic_moduli(crystal("square", (1, 1), overlap))
    assert moduli.energy[2, 2] == pytest.approx(-moduli.pressure, rel=1e-6, abs=1e-20)
    assert moduli.negative_strains == moduli.negative_modes == unstable and moduli.stable == (not unstable)
    # its one disc has nowhere to relax to: the affine stiffness is the same
    assert np.isnan(moduli.average("voigt", tangent="affine").bulk_modulus) == bool(unstable)


@pytest.mark.parametrize("changes", [{"negative_positions": 1}, {"negative_strains": 1}, {"cauchy_least": -1e-9}])
def test_a_packing_is_stable_only_without_negative_modes_and_where_every_strain_takes_work(changes):
    moduli = pm.elastic_moduli(crystal("triangular", (1, 1), 0.01))
    assert moduli.stable and np.isfinite(moduli.anisotropy) and np.isfinite(moduli.voigt.shear_modulus)
    other = replace(moduli, **changes)
    assert not other.stable and np.isnan(other.anisotropy) and np.isnan(other.voigt.shear_modulus)
    assert other.negative_modes == changes.get("negative_positions", 0) + changes.get("negative_strains", 0)
    assert other.stable_in_box == ("negative_positions" not in changes)


def test_a_relaxation_that_leaves_loads_unbalanced_makes_no_packing_stable(monkeypatch):
    scene = crystal("triangular", (2, 2), 0.01)
    assert pm.elastic_moduli(scene).stable
    relax = elasticity.relax
    monkeypatch.setattr(elasticity, "relax", lambda system: relax(system)._replace(residual=1e-3))
    moduli = pm.elastic_moduli(scene)
    assert moduli.negative_strains == 1 and not moduli.stable and np.isnan(moduli.hill.shear_modulus)


def test_contacts_that_agree_with_no_motion_make_no_packing_stable(monkeypatch):
    scene = crystal("triangular", (2, 2), 0.01)
    rough = scene.replace(effects=(*scene.effects, pm.Friction(0.5, stiffness=1.0)))
    shear = [[0.0, 1.0], [1.0, 0.0]]
    assert pm.elastic_moduli(rough, contacts_at_limit=shear).stable
    find = elasticity.find_sliding
    monkeypatch.setattr(elasticity, "find_sliding", lambda *given: (*find(*given)[:3], False))
    assert not pm.elastic_moduli(rough, contacts_at_limit=shear).stable


def test_triangular_crystal_shears_away_beyond_an_overlap_of_one_quarter():
    assert pm.elastic_moduli(crystal("triangular", (1, 1), 0.24)).stable
    beyond = pm.elastic_moduli(crystal("triangular", (1, 1), 0.26))
    assert not beyond.stable and beyond.shear_modulus < 0


def test_a_single_particle_touching_its_images_has_moduli():
    moduli = pm.elastic_moduli(crystal("fcc", (1, 1, 1)))
    assert (moduli.particles, moduli.contacts) == (1, 6)
    assert abs(moduli.bulk_modulus - 2 * 2**0.5 / 3) < 1e-10


def test_eigenvalues_within_1e_10_of_the_largest_are_zero_modes_and_not_unstable_ones():
    modes = pm.normal_modes(crystal("triangular", (3, 3), 0.01))
    assert modes.negative == 0 and modes.complete
    told = replace(modes, eigenvalue_m=np.array([-2e-10, -5e-11, 5e-11, 2e-10, 1.0]) * modes.largest)
    assert told.zero_m.tolist() == [False, True, True, False, False] and told.negative == 1
    assert not told.complete


@pytest.mark.parametrize(("found", "missed"), [([1.0, 2.0, 3.0, 4.0], 0), ([1.0, 3.0, 4.0], 1), ([3.0, 4.0], 2)])
def test_eigenvalues_that_a_search_overlooked_are_counted_by_inertia(found, missed):
    operator = FreeOperator(sp.csr_array(sp.diags_array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0])))
    assert _missed(operator, np.array(found), 5.0, 1) == (missed, True)


def test_modes_warn_of_what_counts_as_rattlers_only_because_nothing_balances():
    pair = pm.Packing([[1.0, 1.0], [1.9, 1.0]], [0.5, 0.5], pm.Box.cubic(4.0, 2))
    with pytest.warns(UserWarning, match="2 of 2 particles count as rattlers by contacts that do not balance"):
        assert len(pm.normal_modes(pm.Scene(pair, (pm.Repulsion(),)))) == 0


@pytest.mark.parametrize("repeats", [2, 3, 5])
def test_all_floppy_modes_of_a_crystal_count_as_states_from_an_edge_at_zero_on(repeats):
    states = pm.density_of_states(crystal("square", (repeats, repeats)), [0.0, 10.0])
    assert states.count_b.tolist() == [2 * repeats**2 - 2]
