"""Facts about laws that feel the radii of both particles: closed forms, and the same answer by every way."""

import itertools
import math
from typing import NamedTuple

import numpy as np
import pytest

import packmech as pm
from packmech.effects.partners import equal_partners, partners_of

LAW = pm.ElasticSpheres(2.0)
REPULSION = (pm.Repulsion(LAW),)


def force_of(overlap, radius, other, modulus=2.0):
    return 4.0 / 3.0 * modulus * math.sqrt(radius * other / (radius + other)) * max(overlap, 0.0) ** 1.5


def by_hand(packing):
    """Return the (N, d) forces of all pairs of discs or spheres by two loops, at the nearest images."""
    force, side = np.zeros_like(packing.position_nd), np.diag(packing.box.lattice_dd)
    for i in range(packing.particles):
        for j in range(i):
            vector = packing.position_nd[j] - packing.position_nd[i]
            vector -= side * np.round(vector / side)
            r = float(np.linalg.norm(vector))
            a, b = packing.radius_n[i], packing.radius_n[j]
            push = force_of(a + b - r, a, b) * vector / r
            force[i] -= push
            force[j] += push
    return force


@pytest.fixture(scope="module", params=[2, 3])
def start(request):
    sizes = pm.Uniform(3.0) if request.param == 2 else pm.Bidisperse(3.0)
    return pm.random_packing(60, dimension=request.param, sizes=sizes, packing_fraction=1.0, seed=5)


def test_of_one_size_they_are_hertz_contacts():
    hertz, pair = pm.Hertz(2.0 / 3.0 * 2.0 * 1.4**3), equal_partners(1.4)
    for r in (0.3, 1.0, 1.399):
        found = [LAW.energy(r, pair), LAW.first(r, pair), LAW.second(r, pair)]
        assert found == pytest.approx([hertz.energy(r, 1.4), hertz.first(r, 1.4), hertz.second(r, 1.4)], rel=1e-12)


def test_the_effective_radius_is_that_of_the_two_curvatures_and_of_a_plane_that_of_the_sphere():
    assert partners_of(0.3, 0.7, 0).effective_radius == pytest.approx(1.0 / (1.0 / 0.3 + 1.0 / 0.7), rel=1e-15)
    assert partners_of(0.3, 1e12, 0).effective_radius == pytest.approx(0.3, rel=1e-11)


def test_forces_are_those_of_two_loops_by_every_way(start):
    scene, due = pm.Scene(start, REPULSION), by_hand(start)
    scale = np.abs(due).max()
    np.testing.assert_allclose(pm.forces(scene), due, rtol=0.0, atol=1e-12 * scale)
    # one step from rest by the integrator, and what the contacts of the packing say
    moved = pm.simulate(scene, steps=1, dt=1e-9, method=pm.SemiImplicitEuler(), check=False)
    np.testing.assert_allclose(moved.velocity_nd * start.mass_n[:, None] / 1e-9, due, rtol=0.0, atol=1e-8 * scale)
    found = pm.contact_forces(scene)
    radius, other = start.radius_n[found.contacts.i_c], start.radius_n[found.contacts.j_c]
    overlap = radius + other - found.contacts.distance_c
    expected = [force_of(*row) for row in zip(overlap, radius, other, strict=True)]
    np.testing.assert_allclose(found.normal_c, expected, rtol=1e-10)


def test_minimizers_agree_and_second_derivatives_are_differences_of_the_forces(start):
    scene = pm.Scene(start, REPULSION)
    for method in (pm.Fire(), pm.LBFGS(), pm.Newton()):
        run = pm.quench(scene, force_tolerance=1e-11, method=method)
        mean = pm.contact_forces(scene.replace(packing=run.packing)).normal_c.mean()
        assert np.linalg.norm(by_hand(run.packing), axis=1).max() < 1e-10 * mean
    # where overlaps are large beside the step: what all but touches at rest has a stiffness that ends within it
    matrix = pm.hessian(scene, "none").toarray()
    rng, step = np.random.default_rng(2), 1e-6
    for _ in range(3):
        u_nd = rng.standard_normal(start.position_nd.shape)
        ahead, behind = (by_hand(start.replace(position_nd=start.position_nd + by * u_nd)) for by in (step, -step))
        slope = (behind - ahead) / (2.0 * step)
        np.testing.assert_allclose(matrix @ u_nd.ravel(), slope.ravel(), rtol=0.0, atol=1e-6 * np.abs(matrix).max())


def test_a_packing_is_jammed_at_the_pressure_asked_and_its_moduli_are_those_of_finite_strain(start):
    scene = pm.Scene(start, REPULSION)
    run = pm.jam(scene, pressure=1e-3)
    jammed = scene.replace(packing=run.packing)
    found = pm.contact_forces(jammed)
    virial = (found.normal_c * found.contacts.distance_c).sum() / (start.dimension * jammed.packing.box.volume)
    assert run.ok and virial == pytest.approx(1e-3 * jammed.pressure_unit, rel=1e-8)

    def stress_at(strain):
        gradient = np.zeros((start.dimension, start.dimension))
        gradient[0, 1] = strain
        stretch = np.eye(start.dimension) + gradient
        packing = jammed.packing
        sheared = packing.replace(position_nd=packing.position_nd @ stretch.T, box=packing.box.strained(gradient))
        rest = pm.quench(jammed.replace(packing=sheared), force_tolerance=1e-13, method=pm.Newton())
        return pm.stress_tensor(jammed.replace(packing=rest.packing))[0, 1]

    slope = (stress_at(1e-6) - stress_at(-1e-6)) / 2e-6
    moduli = pm.elastic_moduli(jammed, rattlers="keep")
    assert moduli.simple_shear(0, 1) == pytest.approx(slope, rel=1e-6)


def test_a_collision_of_unequal_spheres_lasts_and_ends_as_its_closed_form_says():
    """Hertz: the deepest overlap is (15 m v^2 / (16 E sqrt(R)))^(2/5), the reduced mass m (Timoshenko and Goodier)."""
    radii, masses, speed = np.array([0.5, 1.5]), np.array([1.0, 27.0]), 0.02
    place = [[2.0, 2.0, 2.0], [2.0 + radii.sum(), 2.0, 2.0]]
    packing = pm.Packing(place, radii, pm.Box.cubic(20.0, 3), mass_n=masses)
    mass, radius = masses.prod() / masses.sum(), radii.prod() / radii.sum()
    deepest = (15.0 * mass * speed**2 / (16.0 * 2.0 * math.sqrt(radius))) ** 0.4
    time = 2.943275 * deepest / speed
    scene = pm.Scene(packing, REPULSION)
    run = pm.simulate(
        scene, duration=1.2 * time, dt=time / 4000, velocity_nd=[[speed, 0, 0], [0, 0, 0]],
        trace_every=1, trace_positions=True,
    )  # fmt: skip
    apart = np.linalg.norm(run.trace.position_tnd[:, 1] - run.trace.position_tnd[:, 0], axis=1)
    assert radii.sum() - apart.min() == pytest.approx(deepest, rel=1e-5)
    touching = np.count_nonzero(apart < radii.sum()) * time / 4000
    assert touching == pytest.approx(time, rel=2e-3)


def test_beads_that_touch_have_radii_of_their_own():
    chains = pm.cluster_packing(12, pm.Dimer(0.7, (0.5, 0.3)), dimension=2, packing_fraction=0.6, seed=1)
    start = pm.at_packing_fraction(pm.rigid_packing(chains), 1.0)
    found = pm.contact_forces(pm.Scene(start, REPULSION))
    size = start.shapes.site_radius(start.radius_n)
    radius, other = size[found.contacts.site_i_c], size[found.contacts.site_j_c]
    expected = [force_of(*row) for row in zip(-found.contacts.gap_c, radius, other, strict=True)]
    np.testing.assert_allclose(found.normal_c, expected, rtol=1e-10)
    assert len(set(np.round(radius / other, 6))) > 1


def test_a_step_of_rigid_bodies_has_the_forces_of_a_loop_over_pairs_of_beads():
    chains = pm.cluster_packing(8, pm.Dimer(0.7, (0.5, 0.3)), dimension=3, packing_fraction=0.4, seed=1)
    packing = pm.at_packing_fraction(pm.rigid_packing(chains), 0.9)
    beads = pm.bead_packing(packing)
    body_of = packing.shapes.particle_b
    due, pairs = np.zeros_like(packing.position_nd), set()
    side = np.diag(packing.box.lattice_dd)
    for i, j in itertools.combinations(range(beads.particles), 2):
        if body_of[i] != body_of[j]:
            vector = beads.position_nd[j] - beads.position_nd[i]
            vector -= side * np.round(vector / side)
            r = float(np.linalg.norm(vector))
            a, b = beads.radius_n[i], beads.radius_n[j]
            push = force_of(a + b - r, a, b) * vector / r
            due[body_of[i]] -= push
            due[body_of[j]] += push
            if r < a + b:
                pairs.add((round(min(a, b), 9), round(max(a, b), 9)))
    assert len(pairs) == 3
    run = pm.simulate(pm.Scene(packing, REPULSION), steps=1, dt=1e-9, method=pm.SemiImplicitEuler(), check=False)
    found = run.velocity_nd * packing.mass_n[:, None] / 1e-9
    np.testing.assert_allclose(found, due, rtol=0.0, atol=1e-7 * np.abs(due).max())


@pm.effect
class Curved(NamedTuple):
    """A force by the effective radius alone."""

    strength: float = 0.1

    def pair_energy(self, distance, partners):
        return 0.5 * self.strength * partners.effective_radius * (partners.contact_distance - distance) ** 2

    def pair_first(self, distance, partners):
        return -self.strength * partners.effective_radius * (partners.contact_distance - distance)

    def pair_second(self, distance, partners):
        return self.strength * partners.effective_radius


def test_an_effect_of_a_users_is_told_the_effective_radius():
    packing = pm.Packing([[1.0, 1.0], [2.4, 1.0]], [0.5, 1.0], pm.Box.cubic(8.0, 2))
    scene = pm.Scene(packing, (Curved(),))
    assert pm.forces(scene)[1, 0] == pytest.approx(0.1 * (0.5 / 1.5) * 0.1, rel=1e-12)
    plateau = scene.replace(effects=(pm.Repulsion(pm.PlateauRepulsion(law=LAW)),))
    assert pm.forces(plateau)[1, 0] == pytest.approx(force_of(0.1, 0.5, 1.0), rel=1e-12)


@pm.law
class Within(NamedTuple):
    """A law that holds another one, and feels curvature itself."""

    law: pm.Harmonic = pm.Harmonic()

    def energy(self, distance, partners):
        return partners.effective_radius * (partners.contact_distance - distance) ** 2

    def first(self, distance, partners):
        return -2.0 * partners.effective_radius * (partners.contact_distance - distance)

    def second(self, distance, partners):
        return 2.0 * partners.effective_radius


@pytest.mark.parametrize("effect", [Curved(), pm.Repulsion(Within()), pm.Walls(1, 0.0, 9.0, LAW)], ids=repr)
def test_ellipses_are_refused_wherever_in_a_record_the_effective_radius_is_asked_for(effect):
    ellipses = pm.random_packing(6, dimension=2, packing_fraction=0.5, shapes=pm.Ellipses(1.5), seed=1)
    with pytest.raises(ValueError, match=r"effective radii for ellipses, .*pm\.Hertz"):
        pm.Scene(ellipses, (pm.Repulsion(), effect))
    plain = pm.Scene(ellipses, (pm.Repulsion(pm.PlateauRepulsion(law=pm.Hertz())),))
    assert len(plain.effects) == 1


@pytest.mark.parametrize("name", ["compression", "tension"])
def test_bonds_have_no_effective_radius(name):
    with pytest.raises(ValueError, match=rf"{name} must be a law of the distance and the rest length.*ElasticSpheres"):
        pm.Bonds([0], [1], [[0, 0]], [1.0], **{name: LAW})


@pytest.mark.parametrize("law", [pm.Hertz(), pm.PowerLaw(1.0, 2.5)], ids=repr)
def test_the_tension_of_a_bond_must_hold_beyond_its_rest_length(law):
    with pytest.raises(ValueError, match="tension must be a law that holds beyond the rest length"):
        pm.Bonds([0], [1], [[0, 0]], [1.0], tension=law)


@pytest.mark.parametrize(
    ("effect", "force"),
    [
        (pm.DMT(0.01, 0.02, 7.0), 2.0 * math.pi * 0.01 * 0.375),
        (pm.CapillaryBridge(1e-3, 0.01), 4.0 * math.pi * 0.375 * 0.01),
    ],
    ids=repr,
)
def test_the_pull_of_unequal_spheres_at_contact_is_that_of_their_effective_radius(effect, force):
    place = np.array([[5.0, 5.0, 5.0], [7.0 - 1e-9, 5.0, 5.0]])
    packing = pm.Packing(place, [0.5, 1.5], pm.Box.cubic(20.0, 3), mass_n=[1.0, 1.0])
    scene = pm.Scene(packing, (pm.Repulsion(), effect))
    assert pm.forces(scene)[0, 0] == pytest.approx(force, rel=1e-6)
    run = pm.simulate(scene, steps=1, dt=1e-6, method=pm.SemiImplicitEuler(), check=False)
    assert run.velocity_nd[0, 0] == pytest.approx(1e-6 * force, rel=1e-6)
