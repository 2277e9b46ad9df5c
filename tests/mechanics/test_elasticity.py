"""Facts about elastic moduli."""

import itertools
import json
import pathlib

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from threadpoolctl import threadpool_limits

import packmech as pm
from packmech.linalg.mandel import mandel_tensor, mandel_vector
from packmech.mechanics.elasticity import reuss_average, voigt_average
from packmech.minimize.second_order.newton import newton

OUTSIDE = pathlib.Path(__file__).parents[3] / "shared" / "data" / "outside" / "soft-discs-N64-P1e-4.json"
COMPONENTS = ["xxxx", "yyyy", "xyxy", "xxyy", "xxxy", "yyxy"]
# -- independent methods -----------------------------------------------------------------------------------------------

AT_REST = [(48, 2, 0.92, 1, law) for law in ("harmonic", "hertz", "lennard-jones", "user's")] + [
    (32, 3, 0.72, 2, "harmonic")
]


def stress_after(scene, gradient):
    """Return the Cauchy stress after the box was deformed by (1 + gradient) and the particles relaxed."""
    packing = scene.packing
    stretch = np.eye(packing.dimension) + gradient
    start = pm.Packing(packing.position_nd @ stretch.T, packing.radius_n, packing.box.strained(gradient))
    relaxed = newton(scene.replace(packing=start), force_tolerance=1e-15, check=False)
    assert relaxed.ok
    return pm.stress_tensor(scene.replace(packing=relaxed.packing))


def slope(function, size):
    return (8 * (function(size) - function(-size)) - (function(2 * size) - function(-2 * size))) / (12 * size)


@pytest.mark.parametrize("case", AT_REST, ids=str)
def test_cauchy_stiffness_is_the_change_of_stress_of_the_relaxed_packing(rest_scene, case):
    scene = rest_scene(*case)
    moduli = pm.elastic_moduli(scene, rattlers="keep")
    expected = np.stack(
        [
            mandel_vector(slope(lambda h, unit=unit: stress_after(scene, h * mandel_tensor(unit)), 1e-6))
            for unit in np.eye(len(moduli.cauchy))
        ],
        axis=1,
    )
    assert np.abs(moduli.cauchy - expected).max() < 1e-7 * np.abs(expected).max()


@pytest.mark.parametrize(("flow", "gradient"), [(0, 1), (1, 0)])
def test_shear_modulus_is_the_slope_of_the_shear_stress_in_simple_shear(rest_scene, flow, gradient):
    scene = rest_scene(48, 2, 0.92, 1)
    shear = np.zeros((2, 2))
    shear[flow, gradient] = 1.0
    expected = slope(lambda h: stress_after(scene, h * shear)[0, 1], 1e-6)
    moduli = pm.elastic_moduli(scene, rattlers="keep")
    assert abs(moduli.simple_shear(flow, gradient) - expected) < 1e-7 * abs(expected)
    assert moduli.shear_modulus == moduli.simple_shear(0, 1)


@pytest.mark.parametrize("case", AT_REST[:1] + AT_REST[-1:], ids=str)
def test_bulk_modulus_is_the_slope_of_the_pressure_in_the_packing_fraction(rest_scene, case):
    scene = rest_scene(*case)
    d = scene.packing.dimension

    def pressure(size):
        return -np.trace(stress_after(scene, np.eye(d) * size)) / d

    # d(ln packing_fraction) = -d * strain
    expected = -slope(pressure, 1e-6) / d
    assert abs(pm.elastic_moduli(scene, rattlers="keep").bulk_modulus - expected) < 1e-7 * expected


@pytest.mark.parametrize("kind", ["exact", "unstressed"])
@pytest.mark.parametrize("case", AT_REST, ids=str)
def test_sparse_moduli_are_those_of_the_dense_pseudo_inverse(rest_scene, case, kind):
    scene = rest_scene(*case)
    full = pm.hessian(scene, kind=kind).toarray()
    count = scene.packing.position_nd.size
    relaxed = (
        full[count:, count:]
        - full[count:, :count] @ np.linalg.pinv(full[:count, :count], rcond=1e-9, hermitian=True) @ full[:count, count:]
    )
    moduli = pm.elastic_moduli(scene, kind=kind, rattlers="keep")
    np.testing.assert_allclose(moduli.energy, relaxed / scene.packing.box.volume, rtol=0, atol=1e-11)
    np.testing.assert_allclose(moduli.affine, full[count:, count:] / scene.packing.box.volume, rtol=0, atol=1e-13)
    assert moduli.residual < 1e-11


def test_rattlers_without_contacts_make_no_difference(rest_scene):
    scene = rest_scene(128, 2, 0.86, 5)
    without, with_them = (pm.elastic_moduli(scene, rattlers=choice) for choice in ("remove", "keep"))
    rattlers = int(pm.find_rattlers(scene.packing).sum())
    assert rattlers > 0 and with_them.particles == without.particles + rattlers
    assert with_them.floppy_positions == 2 * rattlers
    np.testing.assert_allclose(with_them.cauchy, without.cauchy, rtol=0, atol=1e-12)


def test_negative_modes_are_those_of_the_whole_hessian(rest_scene):
    found = set()
    for seed in range(12):
        scene = rest_scene(32, 2, 0.85, seed)
        moduli = pm.elastic_moduli(scene, rattlers="keep")
        value = np.linalg.eigvalsh(pm.hessian(scene).toarray())
        assert moduli.negative_modes == int((value < -1e-9).sum())
        found.add(moduli.negative_modes)
        assert moduli.stable_in_box
    # packings in a fixed box: some are stable to shear and some are not
    assert len(found) > 1


@pytest.mark.parametrize(("particles", "dimension", "fraction"), [(48, 2, 0.95), (32, 3, 0.75)])
def test_averages_of_stable_packings_lie_in_their_order(rest_scene, particles, dimension, fraction):
    stable = 0
    for seed in range(60):
        moduli = pm.elastic_moduli(rest_scene(particles, dimension, fraction, seed))
        assert (moduli.bulk_modulus == moduli.voigt.bulk_modulus) == moduli.stable
        if moduli.stable:
            stable += 1
            # bounds of symmetric matrices; the Cauchy tangent is not quite symmetric under shear stress
            voigt, hill, reuss = (moduli.average(bound, tangent="energy") for bound in ("voigt", "hill", "reuss"))
            assert 0 < reuss.bulk_modulus <= hill.bulk_modulus <= voigt.bulk_modulus
            assert 0 < reuss.shear_modulus <= hill.shear_modulus <= voigt.shear_modulus
        # in a fixed box many packings are unstable to shear; which ones, the last digits of their quench decide
        if stable == 3:
            break
    assert stable == 3


def test_an_unstable_packing_has_no_averages_and_no_anisotropy(rest_scene):
    # in a fixed box, where some packings are unstable to shear
    found = (pm.elastic_moduli(rest_scene(16, 2, 0.9, seed)) for seed in range(60))
    moduli = next(one for one in found if one.negative_strains and one.stable_in_box)
    assert not moduli.stable and np.isfinite(moduli.bulk_modulus) and moduli.bulk_modulus > 0.0
    for tangent, bound in itertools.product(("cauchy", "energy"), ("voigt", "reuss", "hill")):
        average = moduli.average(bound, tangent=tangent)
        for number in (average.bulk_modulus, average.shear_modulus, average.young_modulus, average.poisson_ratio):
            assert np.isnan(number)
    assert np.isnan(moduli.anisotropy) and np.isnan(moduli.poisson_ratio)
    assert moduli.average("reuss", tangent="affine").shear_modulus > 0.0


@pytest.mark.parametrize("dimension", [2, 3])
def test_voigt_shear_modulus_is_the_mean_over_all_directions(rest_scene, dimension):
    moduli = pm.elastic_moduli(rest_scene(*(AT_REST[0] if dimension == 2 else AT_REST[-1])))
    tensor = moduli.tensor(tangent="energy")
    rng = np.random.default_rng(0)
    if dimension == 2:
        angle = np.arange(16) * np.pi / 16
        pairs = [((np.cos(a), np.sin(a)), (-np.sin(a), np.cos(a))) for a in angle]
    else:
        pairs = np.linalg.qr(rng.normal(size=(4000, 3, 3)))[0][:, :, :2].transpose(0, 2, 1)
    m, n = np.moveaxis(np.array(pairs), 1, 0)
    mean = np.einsum("abcd,ka,kb,kc,kd->k", tensor, m, n, m, n, optimize=True).mean()
    expected = voigt_average(moduli.energy).shear_modulus
    assert abs(mean - expected) < (1e-12 if dimension == 2 else 0.02 * expected)


def test_a_packing_without_contacts_is_soft_in_every_direction():
    packing = pm.Packing([[0.0, 0.0], [1.0, 1.0]], [0.1, 0.1], pm.Box.cubic(2.0, 2))
    moduli = pm.elastic_moduli(pm.Scene(packing, (pm.Repulsion(),)))
    assert moduli.bulk_modulus == moduli.shear_modulus == moduli.reuss.bulk_modulus == 0.0
    assert len(moduli.soft_directions) == 3 and moduli.contacts == 0
    assert np.isinf(np.diag(moduli.compliance)).all()


# -- invariances -------------------------------------------------------------------------------------------------------


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32), dimension=st.sampled_from([2, 3]))
def test_moduli_do_not_depend_on_labels_lattice_vectors_or_wrapping(rest_scene, seed, dimension):
    scene = rest_scene(*(AT_REST[0] if dimension == 2 else AT_REST[-1]))
    packing = scene.packing
    rng = np.random.default_rng(seed)
    order = rng.permutation(packing.particles)
    image = rng.integers(-3, 4, size=packing.position_nd.shape)
    change = np.eye(dimension, dtype=int) + np.triu(rng.integers(-2, 3, size=(dimension, dimension)), 1)
    position = (packing.position_nd + image @ packing.box.lattice_dd.T)[order]
    other = pm.Packing(position, packing.radius_n[order], pm.Box(packing.box.lattice_dd @ change))
    one, two = pm.elastic_moduli(scene), pm.elastic_moduli(scene.replace(packing=other))
    assert (one.particles, one.contacts, one.negative_modes) == (two.particles, two.contacts, two.negative_modes)
    np.testing.assert_allclose(two.cauchy, one.cauchy, rtol=0, atol=1e-11)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32), dimension=st.sampled_from([2, 3]))
def test_moduli_turn_with_the_packing(rest_scene, seed, dimension):
    scene = rest_scene(*(AT_REST[0] if dimension == 2 else AT_REST[-1]))
    packing = scene.packing
    turn = np.linalg.qr(np.random.default_rng(seed).normal(size=(dimension, dimension)))[0]
    other = pm.Packing(packing.position_nd @ turn.T, packing.radius_n, pm.Box(turn @ packing.box.lattice_dd))
    one, two = pm.elastic_moduli(scene), pm.elastic_moduli(scene.replace(packing=other))
    turned = np.einsum("ae,bf,cg,dh,efgh->abcd", turn, turn, turn, turn, one.tensor())
    np.testing.assert_allclose(two.tensor(), turned, rtol=0, atol=1e-11)
    assert one.stable == two.stable
    pairs = [(voigt_average(one.cauchy), voigt_average(two.cauchy))]
    pairs += [[reuss_average(moduli.cauchy, moduli.soft_directions) for moduli in (one, two)]]
    for first, second in pairs:
        assert abs(first.bulk_modulus - second.bulk_modulus) < 1e-11
        assert abs(first.shear_modulus - second.shear_modulus) < 1e-11
    if one.stable:
        assert abs(one.anisotropy - two.anisotropy) < 1e-8


@pytest.mark.parametrize("length", [1e-12, 1.0, 1e12])
@pytest.mark.parametrize("energy", [1e-12, 1e12])
def test_moduli_carry_their_unit(rest_scene, length, energy):
    scene = rest_scene(48, 2, 0.92, 1)
    packing = scene.packing
    scaled = pm.Packing(packing.position_nd * length, packing.radius_n * length, packing.box.scaled(length))
    effects = (pm.Repulsion(law=pm.Harmonic(1.3 * energy)),)
    one, two = pm.elastic_moduli(scene), pm.elastic_moduli(pm.Scene(scaled, effects))
    np.testing.assert_allclose(two.cauchy * (length**2 / energy), one.cauchy, rtol=0, atol=1e-11)
    assert (two.negative_modes, two.stable, two.floppy_positions) == (
        one.negative_modes,
        one.stable,
        one.floppy_positions,
    )


def test_a_repetition_has_the_same_bits(rest_scene):
    one, two = (pm.elastic_moduli(rest_scene(128, 2, 0.86, 2)).cauchy for _ in range(2))
    np.testing.assert_array_equal(one, two)


def test_the_number_of_threads_does_not_change_a_bit(rest_scene):
    answers = []
    for threads in (1, 2):
        with threadpool_limits(threads):
            answers.append(pm.elastic_moduli(rest_scene(300, 2, 0.9, 3)).cauchy)
    np.testing.assert_array_equal(*answers)


# -- packings made by others -------------------------------------------------------------------------------------------


@pytest.mark.skipif(not OUTSIDE.exists(), reason="the packings made by others are not in the repository")
def test_elastic_constants_published_with_packings_made_by_others():
    stored = json.loads(OUTSIDE.read_text())
    unstable = 0
    for one in stored["packings"]:
        box = np.array(one["box"])
        packing = pm.Packing(np.array(one["fractional_position"]) @ box.T, one["radius"], pm.Box(box))
        scene = pm.Scene(packing, (pm.Repulsion(),))
        assert abs(pm.energy(scene) - one["energy"]) < 1e-10 * one["energy"]
        stress = np.array(one["stress"])
        assert np.abs(pm.stress_tensor(scene) - stress).max() < 1e-10 * np.abs(stress).max()
        moduli = pm.elastic_moduli(scene)
        published = np.array(one["Cijkl"])
        found = [moduli.component(name, tangent="energy") for name in COMPONENTS]
        np.testing.assert_allclose(found, published, rtol=1e-5, atol=1e-8)
        a, b, c, ab, ac, bc = published
        matrix = np.array([[a, ab, 2**0.5 * ac], [ab, b, 2**0.5 * bc], [2**0.5 * ac, 2**0.5 * bc, 2 * c]])
        assert moduli.negative_strains == int((np.linalg.eigvalsh(matrix) < 0).sum())
        assert moduli.stable_in_box
        if c < 0:
            unstable += 1
            assert not moduli.stable and moduli.shear_modulus < 0
    assert unstable == 4


SCENE = pm.Scene(pm.lattice_packing("triangular", repeats=(2, 2)), (pm.Repulsion(),))


@pytest.mark.parametrize(
    ("call", "error", "text"),
    [
        (lambda: pm.elastic_moduli(SCENE.packing), TypeError, "scene must be a Scene"),
        (lambda: pm.elastic_moduli(SCENE, kind="bare"), ValueError, "kind must be one of"),
        (lambda: pm.elastic_moduli(SCENE, rattlers=True), ValueError, "rattlers must be one of"),
        (lambda: pm.elastic_moduli(SCENE, gap_tolerance="1"), TypeError, "gap_tolerance must be a finite number"),
        (lambda: pm.elastic_moduli(SCENE).component("xz"), ValueError, "indices must be four letters out of xy"),
        (lambda: pm.elastic_moduli(SCENE).component("xxxx", tangent="bulk"), ValueError, "tangent must be one of"),
        (lambda: pm.elastic_moduli(SCENE).average("mean"), ValueError, "bound must be one of"),
        (
            lambda: pm.elastic_moduli(SCENE).simple_shear(0, 2),
            ValueError,
            "flow and gradient must be two different axes below 2",
        ),
    ],
)
def test_bad_input_gets_one_clear_error(call, error, text):
    with pytest.raises(error, match=text):
        call()


def not_at_rest():
    return pm.Scene(pm.random_packing(64, dimension=2, packing_fraction=0.9, seed=3), (pm.Repulsion(),))


def test_the_residual_of_a_packing_that_is_not_at_rest_is_that_of_all_its_contacts():
    scene = not_at_rest()
    contacts = pm.find_contacts(scene.packing)
    # the law's force is the relative overlap over the contact distance
    mean = np.mean(contacts.overlap_c / contacts.contact_distance_c)
    largest = np.sqrt((pm.forces(scene) ** 2).sum(axis=1)).max()
    with pytest.warns(UserWarning, match="scene should be at rest"):
        moduli = pm.elastic_moduli(scene)
    np.testing.assert_allclose(moduli.force_residual, largest / mean, rtol=1e-9)


def test_moduli_of_a_packing_as_drawn_say_first_that_it_is_not_at_rest():
    with pytest.warns(UserWarning, match="64 of 64 particles count as rattlers by contacts that do not balance"):
        moduli = pm.elastic_moduli(not_at_rest())
    first, second = repr(moduli).splitlines()[:2]
    residual = f"{moduli.force_residual:.2g}"
    assert first.endswith(
        f"not at rest (force residual {residual}): relax it first, by pm.quench, or pm.settle with friction"
    )
    assert second == "  bulk modulus 0, shear modulus 0 [energy/length^2]" and "not at rest" in moduli._repr_html_()
    assert "not at rest" in repr(pm.contact_forces(not_at_rest())).splitlines()[0]
    with pytest.warns(UserWarning, match="all rattle"):
        assert pm.coordination_number(not_at_rest().packing) == 0.0
    # nothing was decided from the forces here, and the first line still says it
    assert "not at rest" in repr(pm.elastic_moduli(not_at_rest(), rattlers="keep"))


def test_a_packing_that_touches_to_rounding_counts_as_at_rest():
    # moved off round numbers, so that some pairs overlap by rounding and others do not
    kagome = pm.lattice_packing("kagome", repeats=(2, 2))
    moved = kagome.replace(position_nd=kagome.position_nd + np.array([0.123456, 0.654321]))
    moduli = pm.elastic_moduli(pm.Scene(moved, (pm.Repulsion(),)), gap_tolerance=1e-9)
    assert moduli.at_rest and "not at rest" not in repr(moduli)


def test_the_compliance_of_a_packing_that_is_not_at_rest_is_refused():
    with pytest.raises(ValueError, match="scene must be at rest"):
        pm.compliance_matrix(not_at_rest())


def test_rattlers_that_bear_the_pressure_are_not_left_out_in_silence():
    row = pm.Packing([[0.5, 0.3], [3.0, 0.7]], [0.5, 0.5], pm.Box([[6.0, 0.0], [0.0, 0.9]]))
    scene = pm.Scene(row, (pm.Repulsion(),))
    with pytest.raises(ValueError, match='rattlers="keep"'):
        pm.elastic_moduli(scene)
    # two springs of stiffness 1 and length .9 across a box of volume 5.4
    moduli = pm.elastic_moduli(scene, kind="unstressed", rattlers="keep")
    np.testing.assert_allclose(moduli.component("yyyy"), 2.0 * 0.9**2 / 5.4, rtol=1e-12)
