"""Facts about the laws of the frictional model: closed forms to rounding, limits, and where forces are capped."""

import math
from decimal import Decimal, localcontext

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import packmech as pm
from packmech.effects import contact_terms, energy_scale_of, equal_partners, equal_touches
from packmech.effects.laws import law_energy, law_first, law_second
from packmech.validation.particle_shear import Material, bond_force, normal_force


@pytest.fixture(autouse=True)
def precise_decimals():
    with localcontext(prec=60):
        yield


EPSILON = float(np.finfo(float).eps)


def divergent(k, c):
    def energy(r, sigma):
        return Decimal(k) * sigma**2 * (
            (1 - Decimal(c)) * (1 - r / sigma) ** 2 / 2 + Decimal(c) * (-(r / sigma).ln() - 1 + r / sigma)
        )  # fmt: skip

    return energy


def exponential(k, q):
    def energy(r, sigma):
        reach = Decimal(q) * sigma
        t = (r - sigma) / reach
        return Decimal(k) * reach**2 * (t + (-t).exp() - 1)

    return energy


CLOSED_FORMS = {
    pm.DivergentRepulsion(2.5): divergent(2.5, 1),
    pm.DivergentRepulsion(1.0, 0.25): divergent(1.0, 0.25),
    pm.DivergentRepulsion(3.0, 0.0): divergent(3.0, 0),
    pm.ExponentialTension(1.5, 0.2): exponential(1.5, 0.2),
}
LAWS = [*CLOSED_FORMS, pm.PlateauRepulsion(), pm.PlateauRepulsion(0.2, 0.6, 0.0, pm.DivergentRepulsion(2.0))]
# distances over contact distances at which each of these has kinks
KINKS = {LAWS[-2]: (0.3, 0.8), LAWS[-1]: (0.2, 0.6)}


def three(law, distance, contact_distance=1.0):
    pair = equal_partners(contact_distance)
    return [float(method(law, distance, pair)) for method in (law_energy, law_first, law_second)]


def derivative(function, order, r, sigma, scale):
    step = scale * Decimal("1e-12")
    coefficients = {0: [1], 1: [-1, 1], 2: [1, -2, 1], 3: [-1, 3, -3, 1]}[order]
    places = [r + step * (2 * k - order) for k in range(order + 1)]
    return sum(c * function(x, sigma) for c, x in zip(coefficients, places, strict=True)) / (2 * step) ** order


@settings(max_examples=30, deadline=None)
@given(st.floats(1e-9, 0.95), st.floats(0.1, 100.0))
@pytest.mark.parametrize("order", [0, 1, 2])
@pytest.mark.parametrize("law", list(CLOSED_FORMS), ids=repr)
def test_energy_and_derivatives_are_those_of_the_formula_to_rounding(law, order, offset, contact_distance):
    sign = 1.0 if isinstance(law, pm.ExponentialTension) else -1.0
    distance = contact_distance * (1.0 + sign * offset)
    r, sigma = Decimal(distance), Decimal(contact_distance)
    exact, steeper = (derivative(CLOSED_FORMS[law], n, r, sigma, abs(sigma - r)) for n in (order, order + 1))
    condition = abs(float(r * steeper / exact))
    error = abs(Decimal(three(law, distance, contact_distance)[order]) - exact)
    assert error <= Decimal(EPSILON * (30 + condition)) * abs(exact)


@settings(max_examples=60, deadline=None)
@given(st.floats(0.02, 0.99))
@pytest.mark.parametrize("law", [*LAWS, pm.DivergentRepulsion(1.0, 0.5, cap=4.0)], ids=repr)
def test_force_and_stiffness_are_derivatives_of_the_energy_on_every_branch(law, distance):
    step = 1e-4
    kinks = (*KINKS.get(law, ()), 1.0)
    if isinstance(law, pm.DivergentRepulsion) and law.cap == 4.0:
        kinks = (*kinks, (-4.0 + np.sqrt(16.0 + 1.0)) * 1.0)
    if min(abs(distance - kink) for kink in kinks) < 2.5 * step or distance < 3.0 * step:
        return
    places = [distance + k * step for k in (-2, -1, 1, 2)]
    weights = np.array([1.0, -8.0, 8.0, -1.0]) / (12.0 * step)
    for n in (0, 1):
        found = float(weights @ [three(law, place)[n] for place in places])
        assert found == pytest.approx(three(law, distance)[n + 1], rel=1e-5, abs=1e-6)


def test_divergent_force_is_the_linear_one_over_the_distance_left():
    law = pm.DivergentRepulsion(2.0)
    for r in (0.2, 0.7, 0.99):
        assert -law.first(r * 3.0, 3.0) == pytest.approx(2.0 * (3.0 - 3.0 * r) / r, rel=1e-14)


def test_without_divergence_the_law_is_the_linear_spring():
    laws = (pm.DivergentRepulsion(3.0, 0.0), pm.LinearSpring(3.0))
    for r in (0.0, 0.3, 0.9):
        one, other = (three(law, r, 1.3) for law in laws)
        assert one == pytest.approx(other, rel=1e-15)


def test_without_divergence_the_cap_may_be_what_the_spring_pushes_with_at_most():
    law = pm.DivergentRepulsion(stiffness=2.0, divergence=0.0, cap=1.0)
    for distance in (0.9, 0.5, 0.0):
        assert math.isclose(law.energy(distance, 1.0), (1.0 - distance) ** 2, rel_tol=1e-14)
        assert math.isclose(-law.first(distance, 1.0), 2.0 * (1.0 - distance), rel_tol=1e-14)


def test_no_overlap_pushes_harder_than_the_cap_times_stiffness_and_contact_distance():
    law = pm.DivergentRepulsion(2.0)
    force = [-law.first(r, 5.0) for r in (0.0, 1e-300, 1e-6, 5.0 / 1001.0 * 0.999)]
    assert force == [10_000.0] * 4
    assert -law.first(5.0 / 1001.0 * 1.001, 5.0) < 10_000.0


def test_energy_rises_linearly_at_the_cap():
    law = pm.DivergentRepulsion(2.0, 0.6, cap=5.0)
    assert law.energy(0.0, 4.0) - law.energy(0.1, 4.0) == pytest.approx(0.1 * 2.0 * 4.0 * 5.0, rel=1e-12)
    assert law.second(0.1, 4.0) == 0.0


def test_a_plateau_of_slope_one_is_the_other_law():
    law, other = pm.PlateauRepulsion(slope=1.0, law=pm.DivergentRepulsion(2.0)), pm.DivergentRepulsion(2.0)
    for r in (0.1, 0.3, 0.5, 0.8, 0.9):
        assert three(law, r) == pytest.approx(three(other, r), rel=1e-12)


def test_a_plateau_of_slope_zero_pushes_alike_all_along_it():
    law = pm.PlateauRepulsion(slope=0.0, law=pm.LinearSpring(5.0))
    assert [-three(law, r)[1] for r in (0.8, 0.6, 0.3)] == pytest.approx([1.0] * 3, rel=1e-14)
    assert three(law, 0.3)[0] - three(law, 0.8)[0] == pytest.approx(0.5, rel=1e-14)


def test_energy_of_an_almost_flat_plateau_is_near_that_of_a_flat_one():
    flat, steeper = (pm.PlateauRepulsion(slope=slope, law=pm.Hertz()) for slope in (0.99e-5, 1.01e-5))
    for r in (0.1, 0.4, 0.7):
        assert three(flat, r)[0] == pytest.approx(three(steeper, r)[0], rel=1e-6)


def test_tension_saturates_at_stiffness_times_reach():
    law = pm.ExponentialTension(3.0, 0.25)
    assert law.first(2.0 * 40.0, 2.0) == pytest.approx(3.0 * 0.25 * 2.0, rel=1e-14)
    assert three(law, 2.0, 2.0) == [0.0, 0.0, 3.0]


@pytest.mark.parametrize("law", LAWS, ids=repr)
def test_compiled_law_gives_what_the_plain_methods_give(law):
    distance = np.array([0.001, 0.05, 0.25, 0.5, 0.7, 0.95, 0.999999])
    terms = contact_terms((pm.Repulsion(law=law),), equal_touches(distance, np.ones(7)))
    plain = np.array([three(law, r) for r in distance.tolist()])
    np.testing.assert_allclose(np.column_stack(terms), plain, rtol=1e-12)


def test_unit_of_energy_of_a_plateau_is_that_of_its_law():
    assert energy_scale_of((pm.Repulsion(law=pm.PlateauRepulsion(law=pm.Hertz(2.5))),), 3.0) == 2.5
    assert energy_scale_of((pm.Repulsion(law=pm.DivergentRepulsion(2.0)),), 3.0) == 18.0


@pytest.mark.parametrize("share", [0.0, 0.4, 1.0])
def test_forces_are_those_of_the_reference_package_away_from_its_own_cap(share):
    material = Material(stiffness=2.0, divergence=share)
    law = pm.DivergentRepulsion(2.0, share)
    for r in (0.5, 2.0, 3.9):
        assert law.first(r, 4.0) == pytest.approx(float(normal_force(material, r, 4.0)), rel=1e-14)


def test_plateau_and_saturating_tension_are_those_of_the_reference_package():
    plateau = Material(stiffness=2.0, divergence=1.0, plateau_begin=0.3, plateau_end=0.8, plateau_slope=0.1)
    law = pm.PlateauRepulsion(law=pm.DivergentRepulsion(2.0))
    for r in (0.4, 2.0, 3.9):
        assert three(law, r, 4.0)[1] == pytest.approx(float(normal_force(plateau, r, 4.0)), rel=1e-14)
    saturating = Material(stiffness=2.0, tensile_range=0.2, bond_normal_ratio=1.0)
    pull = pm.ExponentialTension(2.0, 0.2)
    assert pull.first(5.0, 4.0) == pytest.approx(float(bond_force(saturating, 5.0, 4.0)), rel=1e-14)


@pytest.mark.parametrize(
    ("law", "message"),
    [
        (pm.DivergentRepulsion(divergence=1.5), r"effects\[0\].law.divergence must be from 0 to 1, got 1.5"),
        (pm.DivergentRepulsion(cap=0.5), r"effects\[0\].law.cap must be at least 1, got 0.5"),
        (pm.PlateauRepulsion(begin=0.9), r"effects\[0\].law.end must be at least begin and at most 1, got 0.8"),
        (pm.PlateauRepulsion(slope=1.5), r"effects\[0\].law.slope must be at most 1, got 1.5"),
        (pm.PlateauRepulsion(slope=-0.5), r"effects\[0\].law.slope must .*, got -0.5"),
        (pm.PlateauRepulsion(begin=1.5, end=1.0), r"effects\[0\].law.begin must be above 0 and at most 1, got 1.5"),
        (pm.PlateauRepulsion(law=pm.Hertz(-1.0)), r"effects\[0\].law.law.energy_scale must be positive, got -1.0"),
        (pm.ExponentialTension(fraction=0.0), r"effects\[0\].law.fraction must be positive, got 0.0"),
    ],
)
def test_a_number_out_of_bounds_is_named(law, message):
    with pytest.raises(ValueError, match=message):
        pm.Scene(pm.lattice_packing("square"), (pm.Repulsion(law=law),))


def test_laws_of_bonds_are_checked_with_the_scene():
    packing = pm.lattice_packing("square", repeats=(3, 3))
    bonds = pm.bond_contacts(packing, tension=pm.ExponentialTension(float("nan")), gap_tolerance=1e-9)
    with pytest.raises(ValueError, match=r"effects\[1\].tension.stiffness must be a finite number, got nan"):
        pm.Scene(packing, (pm.Repulsion(), bonds))


def test_a_law_within_a_law_is_kept_by_a_packing_file(tmp_path):
    law = pm.PlateauRepulsion(0.2, 0.7, 0.3, pm.DivergentRepulsion(2.0, 0.5, 100.0))
    pm.write_packing(pm.lattice_packing("square"), tmp_path / "a.npz", law=law)
    assert pm.read_law(tmp_path / "a.npz") == law


@pytest.mark.parametrize(
    "law",
    [
        pm.DivergentRepulsion(divergence=0.0, cap=1.0), pm.DivergentRepulsion(divergence=1.0),
        pm.PlateauRepulsion(slope=0.0), pm.PlateauRepulsion(slope=1.0), pm.PlateauRepulsion(begin=1.0, end=1.0),
        pm.PlateauRepulsion(begin=0.5, end=0.5),
    ],
)  # fmt: skip
def test_numbers_at_their_bounds_are_those_of_a_law(law):
    packing = pm.Packing([[1.0, 1.0], [1.9, 1.0]], [0.5, 0.5], pm.Box.cubic(4.0, 2))
    scene = pm.Scene(packing, (pm.Repulsion(law=law),))
    assert pm.energy(scene) == pytest.approx(law_energy(law, 0.9, equal_partners(1.0)), rel=1e-12)
