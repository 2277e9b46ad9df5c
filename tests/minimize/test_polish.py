"""Facts about Newton's method for the last digits."""

from fractions import Fraction

import numpy as np
import pytest

import packmech as pm
from packmech.minimize.program import build_program
from packmech.minimize.second_order.newton import Newton, newton, polish
from packmech.minimize.second_order.soft_network import SoftNetwork, Units


def nearly_at_rest(particles, dimension, fraction, seed, tolerance=1e-6):
    packing = pm.random_packing(
        particles,
        dimension=dimension,
        packing_fraction=fraction,
        sizes=pm.Bidisperse(ratio=1.4) if dimension == 2 else pm.Monodisperse(),
        seed=seed,
    )
    scene = pm.Scene(packing, (pm.Repulsion(law=pm.Harmonic()),))
    relaxed = build_program(scene).relax(force_tolerance=tolerance, method=pm.Fire())
    return scene.replace(packing=packing.replace(position_nd=relaxed.packing.position_nd))


def rounding_floor(scene):
    """Return spacing of the coordinates times the stiffness of the best connected particle, for unit stiffness."""
    contacts = pm.find_contacts(scene.packing, gap_tolerance=0.0)
    stiff = 1.0 / contacts.contact_distance_c.min() ** 2 * contacts.count_n().max()
    return stiff * np.spacing(np.abs(scene.packing.box.lattice_dd).max())


@pytest.mark.parametrize(
    ("particles", "dimension", "fraction"), [(64, 2, 0.9), (256, 2, 0.86), (64, 3, 0.7), (128, 3, 0.66)]
)
@pytest.mark.parametrize("seed", range(2))
def test_a_nearly_relaxed_packing_reaches_the_rounding_floor_in_a_few_steps(particles, dimension, fraction, seed):
    scene = nearly_at_rest(particles, dimension, fraction, seed)
    run = newton(scene, force_tolerance=1e-16)
    assert run.outcome is pm.Outcome.ROUNDING_FLOOR and run.ok
    assert np.sqrt((pm.forces(scene.replace(packing=run.packing)) ** 2).sum(axis=1)).max() < 2 * rounding_floor(scene)
    assert run.residual < 1e-10 and run.steps <= 12
    # it stays in its basin
    assert np.abs(run.packing.position_nd - scene.packing.position_nd).max() < 0.05


@pytest.mark.parametrize("law", [pm.Hertz(), pm.RepulsiveLennardJones(0.02), pm.PowerLaw(1.0, 3.0), pm.LinearSpring()])
def test_every_law_is_polished(law):
    scene = nearly_at_rest(64, 2, 0.95, 1, 1e-3)
    run = newton(scene.replace(effects=(pm.Repulsion(law=law),)), force_tolerance=1e-10, step_limit=200)
    assert run.residual <= 1e-10 or run.outcome is pm.Outcome.ROUNDING_FLOOR


def test_residual_is_that_of_the_returned_packing():
    scene = nearly_at_rest(64, 2, 0.9, 3)
    run = newton(scene, force_tolerance=1e-11)
    contacts = pm.find_contacts(run.packing, gap_tolerance=0.0)
    force = (1.0 - contacts.distance_c / contacts.contact_distance_c) / contacts.contact_distance_c
    net = np.sqrt((pm.forces(scene.replace(packing=run.packing)) ** 2).sum(axis=1)).max()
    assert run.residual == pytest.approx(net / force.mean(), rel=1e-3)
    assert run.outcome is pm.Outcome.CONVERGED and run.residual <= 1e-11


def test_convergence_is_quadratic():
    scene = nearly_at_rest(64, 2, 0.95, 2, 1e-3)
    residuals = []
    for steps in range(4):
        residuals.append(polish(scene.packing, scene.effects, force_tolerance=1e-16, step_limit=steps).residual)
    ratios = [b / a**2 for a, b in zip(residuals, residuals[1:], strict=False) if b > 1e-11]
    assert len(ratios) >= 1 and max(ratios) < 50.0 and residuals[-1] < 1e-11


def test_energy_change_is_right_far_below_the_rounding_of_the_energy():
    scene = nearly_at_rest(64, 2, 0.9, 1)
    network = SoftNetwork(scene.packing, Units(scene.effects, 1.0, 1.0), np.zeros((0, 2, 2)), None, reach=0.3)
    near = network.listed
    # exact image shifts: the box is square, so coordinates are sums of doubles
    lattice = scene.packing.box.lattice_dd
    for size in (1e-3, 1e-6, 1e-9, 1e-12):
        position = scene.packing.position_nd + size * np.random.default_rng(0).normal(size=(64, 2))
        change = Fraction(0)
        for c in np.flatnonzero(near.distance_c < 1.02 * near.contact_distance_c):
            sigma = Fraction(float(near.contact_distance_c[c]))
            pair = []
            for place in (scene.packing.position_nd, position):
                vector = [
                    Fraction(float(place[near.j_c[c], a]))
                    - Fraction(float(place[near.i_c[c], a]))
                    + int(near.image_cd[c, a]) * Fraction(float(lattice[a, a]))
                    for a in range(2)
                ]
                distance = exact_root(vector[0] ** 2 + vector[1] ** 2)
                overlap = max(1 - distance / sigma, Fraction(0))
                pair.append(overlap * overlap / 2)
            change += pair[1] - pair[0]
        found = network.growth_to(scene.packing.replace(position_nd=position))
        # forces are known to their rounding floor, and so is the change, not to the rounding of the energy
        step = np.abs(position - scene.packing.position_nd).sum()
        bound = 0.05 * rounding_floor(scene) * step
        assert abs(found - float(change)) < bound
        assert size > 1e-8 or bound < 1e-3 * np.spacing(pm.energy(scene))


def exact_root(value):
    """Return the square root of a fraction to 60 digits."""
    import math

    scale = 10**60
    return Fraction(math.isqrt(value.numerator * scale * scale // value.denominator), scale)


def test_particles_without_contacts_stay_where_they_are():
    crystal = pm.lattice_packing("triangular", repeats=(6, 6), relative_overlap=0.03)
    gone = np.ones(36, dtype=bool)
    gone[14] = False
    hole = crystal.position_nd[14]
    position = np.vstack([crystal.position_nd[gone], hole + 0.03])
    radius = np.append(crystal.radius_n[gone], 0.05)
    scene = pm.Scene(pm.Packing(position, radius, crystal.box), (pm.Repulsion(),))
    run = newton(scene, force_tolerance=1e-11)
    np.testing.assert_array_equal(run.packing.position_nd[-1], position[-1])
    assert run.residual <= 1e-11


def test_a_particle_pushed_by_one_contact_alone_is_let_go():
    crystal = pm.lattice_packing("triangular", repeats=(6, 6), relative_overlap=0.03)
    gone = np.arange(36) != 14
    position = np.vstack([crystal.position_nd[gone], crystal.position_nd[14] + [0.32, 0.02]])
    radius = np.append(crystal.radius_n[gone], 0.2)
    scene = pm.Scene(pm.Packing(position, radius, crystal.box), (pm.Repulsion(),))
    assert pm.find_contacts(scene.packing, gap_tolerance=0.0).count_n()[-1] == 1
    run = newton(scene, force_tolerance=1e-11)
    overlap = pm.find_contacts(run.packing, gap_tolerance=0.0).overlap_c
    last = pm.find_contacts(run.packing, gap_tolerance=0.0)
    mine = overlap[(last.i_c == 35) | (last.j_c == 35)]
    assert run.ok and (mine < 1e-11).all()


def test_a_saddle_is_not_taken_for_a_minimum():
    square = pm.lattice_packing("square", repeats=(4, 4), relative_overlap=0.05)
    scene = pm.Scene(square, (pm.Repulsion(),))
    with pytest.raises(pm.NotConverged, match="saddle") as caught:
        newton(scene, force_tolerance=1e-10)
    run = caught.value.run
    assert run.outcome is pm.Outcome.UNSTABLE and run.residual < 1e-10 and run.report["negative_modes"] > 0


def test_a_rough_start_that_does_not_converge_says_so():
    packing = pm.random_packing(256, dimension=2, packing_fraction=0.86, sizes=pm.Bidisperse(ratio=1.4), seed=1)
    scene = pm.Scene(packing, (pm.Repulsion(),))
    with pytest.raises(pm.NotConverged) as caught:
        newton(scene, force_tolerance=1e-10, step_limit=3)
    assert caught.value.run.outcome is pm.Outcome.STEP_LIMIT
    run = newton(scene, force_tolerance=1e-10, step_limit=3, check=False)
    assert not run.ok and run.residual > 1e-10 and np.isfinite(run.packing.position_nd).all()


def test_no_step_raises_the_energy_from_a_rough_start():
    packing = pm.random_packing(64, dimension=2, packing_fraction=0.9, sizes=pm.Bidisperse(ratio=1.4), seed=1)
    scene = pm.Scene(packing, (pm.Repulsion(),))
    energies = []
    for steps in range(8):
        done = polish(packing, scene.effects, force_tolerance=1e-12, step_limit=steps)
        energies.append(pm.energy(scene.replace(packing=done.packing)))
    assert all(b <= a for a, b in zip(energies, energies[1:], strict=False))
    assert energies[-1] < energies[0]


def test_a_packing_without_contacts_is_unjammed():
    packing = pm.Packing([[0.0, 0.0], [1.0, 1.0]], [0.1, 0.1], pm.Box.cubic(2.0, 2))
    run = newton(pm.Scene(packing, (pm.Repulsion(),)), force_tolerance=1e-12)
    assert run.outcome is pm.Outcome.UNJAMMED and run.residual == 0.0
    np.testing.assert_array_equal(run.packing.position_nd, packing.position_nd)


def test_images_of_a_particle_alone_balance():
    scene = pm.Scene(pm.lattice_packing("fcc", repeats=(1, 1, 1), relative_overlap=0.1), (pm.Repulsion(),))
    run = newton(scene, force_tolerance=1e-12)
    assert run.outcome is pm.Outcome.CONVERGED and run.steps == 0


def test_a_repetition_has_the_same_bits():
    scene = nearly_at_rest(64, 2, 0.9, 1)
    one, two = (newton(scene, force_tolerance=1e-16).packing.position_nd for _ in range(2))
    np.testing.assert_array_equal(one, two)


@pytest.mark.parametrize("unit", [1e-12, 1e12])
def test_the_unit_of_length_does_not_matter(unit):
    scene = nearly_at_rest(64, 2, 0.9, 1)
    packing = scene.packing
    scaled = pm.Packing(packing.position_nd * unit, packing.radius_n * unit, packing.box.scaled(unit))
    run = newton(scene.replace(packing=scaled), force_tolerance=1e-16)
    assert run.outcome is pm.Outcome.ROUNDING_FLOOR and run.residual < 1e-10


SCENE = pm.Scene(pm.lattice_packing("triangular", repeats=(2, 2), relative_overlap=0.01), (pm.Repulsion(),))


@pytest.mark.parametrize(
    ("call", "error", "text"),
    [
        (lambda: newton(SCENE.packing, force_tolerance=1e-9), TypeError, "scene must be a Scene"),
        (lambda: newton(SCENE, force_tolerance=0.0), ValueError, "force_tolerance must be"),
        (lambda: newton(SCENE, force_tolerance=np.nan), ValueError, "force_tolerance must be"),
        (
            lambda: newton(SCENE, force_tolerance=1e-9, step_limit=-1),
            ValueError,
            "step_limit must be an integer at least 0",
        ),
        (lambda: newton(SCENE, force_tolerance=1e-9, method="newton"), TypeError, "method must be a Newton"),
        (lambda: newton(SCENE, force_tolerance=1e-9, method=Newton(skin=0.0)), ValueError, "method.skin must be"),
        (
            lambda: newton(SCENE, force_tolerance=1e-9, method=Newton(largest_step=-1.0)),
            ValueError,
            "method.largest_step must be",
        ),
    ],
)
def test_bad_input_gets_one_clear_error(call, error, text):
    with pytest.raises(error, match=text):
        call()
