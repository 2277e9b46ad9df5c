"""Facts about Mindlin's tangential spring: closed forms, cycles that make no energy, impacts, the matrix at rest."""

import itertools
import math

import numpy as np
import pytest

import packmech as pm
from packmech.dynamics.engine import build_engine
from packmech.effects import mindlin_stiffness

# Young's modulus, Poisson's ratio, and the law of two equal spheres of radius 0.5 made of them
YOUNG, POISSON = 2.0, 0.3
EFFECTIVE = YOUNG / (2.0 * (1.0 - POISSON**2))
SHEAR = YOUNG / (2.0 * (1.0 + POISSON)) / (2.0 * (2.0 - POISSON))
HERTZ = pm.Repulsion(pm.Hertz(4.0 / 3.0 * EFFECTIVE * math.sqrt(0.25)))
MINDLIN = pm.Mindlin(POISSON)
STRONG, HEAVY = 1e3, 1e14


def contact_of(overlap, effects, mass=1.0, radii=(0.5, 0.5)):
    place = np.array([[2.0, 2.0, 2.0], [2.0 + sum(radii) - overlap, 2.0, 2.0]])
    return pm.Scene(pm.Packing(place, list(radii), pm.Box.cubic(6.0, 3), mass_n=[mass] * 2), effects)


def spring_of(overlap):
    """Return 8 G* a of two spheres of radius 0.5."""
    return 8.0 * SHEAR * math.sqrt(0.25 * overlap)


@pytest.mark.parametrize("overlap", [1e-6, 0.01, 0.1])
def test_the_force_of_a_displacement_is_that_of_mindlin_without_slip(overlap):
    scene = contact_of(overlap, (HERTZ, pm.Friction(STRONG, MINDLIN)))
    springs = pm.TangentialDisplacements([0], [1], [[0, 0, 0]], [[0.0, 1e-7, 0.0]])
    found = pm.contact_forces(scene.replace(packing=scene.packing.replace(tangential=springs)))
    normal = 4.0 / 3.0 * EFFECTIVE * math.sqrt(0.25) * overlap**1.5
    assert found.normal_c[0] == pytest.approx(normal, rel=1e-9)
    np.testing.assert_allclose(found.tangential_cd[0], [0.0, spring_of(overlap) * 1e-7, 0.0], rtol=1e-9)


class Path:
    """Two heavy spheres, pressed and turned against each other by hand; what they bear across is read after each."""

    def __init__(self, overlap):
        self.scene, self.overlap = contact_of(overlap, (HERTZ, pm.Friction(STRONG, MINDLIN)), HEAVY), overlap

    def force(self):
        return float(pm.contact_forces(self.scene).tangential_cd[0, 1])

    def _move(self, **velocities):
        run = pm.simulate(self.scene, steps=40, dt=0.025, check=False, **velocities)
        self.scene = self.scene.replace(packing=run.packing)
        return self.force()

    def press(self, overlap):
        speed, self.overlap = 0.5 * (overlap - self.overlap), overlap
        return self._move(velocity_nd=[[speed, 0, 0], [-speed, 0, 0]])

    def slip(self, length):
        # surfaces move by the spin about z times the distance
        spin = -length / (1.0 - self.overlap)
        return self._move(spin_nk=[[0, 0, spin], [0, 0, spin]])


def test_forces_grow_by_slip_stay_under_load_and_fall_with_the_radius_of_contact():
    path = Path(0.01)
    first = path.slip(1e-3)
    assert abs(first) == pytest.approx(spring_of(0.01) * 1e-3, rel=1e-9)
    assert path.press(0.04) == pytest.approx(first, rel=1e-9)
    second = path.slip(-4e-4)
    assert second == pytest.approx(first * (1.0 - 2.0 * 0.4), rel=1e-9)
    assert path.press(0.0025) == pytest.approx(0.25 * second, rel=1e-9)
    assert path.press(0.04) == pytest.approx(0.25 * second, rel=1e-9)


def test_cycles_of_load_slip_and_unload_make_no_energy():
    rng = np.random.default_rng(4)
    for _ in range(3):
        path, work, force, gone = Path(0.02), 0.0, 0.0, 0.0
        for k in range(6):
            length = 1e-3 * rng.normal() if k < 5 else -gone
            now = path.slip(length)
            # the force is linear in the slip
            work += 0.5 * (now + force) * length
            gone += length
            overlap = 0.02 if k == 5 else float(rng.uniform(0.005, 0.08))
            force = path.press(overlap)
        stored = 0.5 * force**2 / spring_of(0.02)
        assert work - stored > 0.0


def impact(tangent, mu, e=1.0, dt=None):
    """Return slip velocities of the surfaces over mu times that of approach, before and after, and both energies."""
    effects = (HERTZ, pm.Friction(mu, MINDLIN), *((pm.Restitution(e),) if e < 1.0 else ()))
    scene = contact_of(0.0, effects)
    speed = 1e-6
    velocity = np.array([[speed, speed * tangent, 0.0], [-speed, -speed * tangent, 0.0]])
    # the Hertzian time of contact is 2.87 (m^2 / (R E^2 v))^(1/5)
    time = 2.87 * (0.25 / (0.25 * EFFECTIVE**2 * 2.0 * speed)) ** 0.2
    run = pm.simulate(scene, duration=1.3 * time, dt=dt or time / 400, velocity_nd=velocity, check=False)
    v, w = run.velocity_nd, run.spin_nk
    after = (v[0, 1] - v[1, 1]) + 0.5 * (w[0, 2] + w[1, 2])
    energy = 0.5 * (v**2).sum() + 0.05 * (w**2).sum()
    return tangent / mu, after / (2.0 * speed * mu), energy / (0.5 * (velocity**2).sum()), v


@pytest.mark.parametrize("e", [1.0, 0.6])
def test_an_impact_that_slides_throughout_changes_slip_by_the_impulse_of_friction(e):
    # Maw, Barber and Fawcett (1976): gross sliding where psi_1 = 2 (1 - nu) / (2 - nu) tan / mu is above 4 chi - 1
    before, after, energy, _ = impact(3.0, 0.2, e)
    assert 2.0 * (1 - POISSON) / (2 - POISSON) * before > 4.0 * 3.5 * (1 - POISSON) / (2 - POISSON) - 1.0
    assert after == pytest.approx(before - 3.5 * (1.0 + e), rel=5e-3)
    assert energy < 1.0


def test_impacts_throw_surfaces_on_back_and_on_as_the_angle_grows():
    # Maw, Barber and Fawcett (1976), figure 4: small angles stick and swing through, larger ones are thrown back
    found = [impact(tangent, 0.4) for tangent in (0.02, 0.2, 1.0, 1.5, 2.2)]
    for before, after, energy, _ in found:
        assert energy < 1.0
        assert abs(after) < before
    assert [after > 0.0 for _, after, _, _ in found] == [True, True, False, False, False]
    assert all(after > before - 7.0 for before, after, _, _ in found[:-1])


def test_an_impact_that_sticks_on_linear_springs_turns_by_the_ratio_of_frequencies():
    scene = contact_of(0.0, (pm.Repulsion(pm.LinearSpring(1.0)), pm.Friction(STRONG, MINDLIN)))
    speed, tangent = 1e-6, 0.01
    velocity = np.array([[speed, speed * tangent, 0.0], [-speed, -speed * tangent, 0.0]])
    time = math.pi * math.sqrt(0.5)
    run = pm.simulate(scene, duration=1.1 * time, dt=time / 2000, velocity_nd=velocity, check=False)
    v, w = run.velocity_nd, run.spin_nk
    after = (v[0, 1] - v[1, 1]) + 0.5 * (w[0, 2] + w[1, 2])
    ratio = 3.5 * 2.0 * (1.0 - POISSON) / (2.0 - POISSON)
    assert after / (2.0 * speed * tangent) == pytest.approx(math.cos(math.pi * math.sqrt(ratio)), abs=3e-3)


def test_smooth_contacts_converge_to_second_order():
    end = []
    for dt in (0.04, 0.02, 0.01):
        start = {"velocity_nd": [[3e-3, 1e-3, 0.0], [-3e-3, -1e-3, 5e-4]], "check": False}
        scene = contact_of(0.02, (HERTZ, pm.Friction(STRONG, MINDLIN)))
        end.append(pm.simulate(scene, duration=2.0, dt=dt, **start).packing.position_nd)
    coarse, fine = (np.abs(one - other).max() for one, other in itertools.pairwise(end))
    assert math.log2(coarse / fine) == pytest.approx(2.0, abs=0.05)


def shaken(dimension, effects, seed=2, steps=300):
    kind, repeats = ("triangular", (4, 4)) if dimension == 2 else ("fcc", (2, 2, 2))
    packing = pm.lattice_packing(kind, repeats=repeats, relative_overlap=0.1)
    rng = np.random.default_rng(seed)
    n, d = packing.position_nd.shape
    start = {"velocity_nd": 0.02 * rng.normal(size=(n, d)), "spin_nk": 0.05 * rng.normal(size=(n, 2 * d - 3))}
    scene = pm.Scene(packing, effects)
    return scene, pm.simulate(scene, steps=steps, dt=0.02, trace_every=steps, check=False, **start), start


@pytest.mark.parametrize("dimension", [2, 3])
def test_of_a_linear_spring_it_is_a_constant_stiffness_in_time_and_at_rest(dimension):
    ratio = 2.0 * (1.0 - POISSON) / (2.0 - POISSON)
    normal = pm.Repulsion(pm.LinearSpring(1.3)), pm.ContactDamping(0.1), pm.RollingResistance(0.2, 0.4)
    pair = []
    for friction in (pm.Friction(0.3, ratio * 1.3, 0.5 * 0.1), pm.Friction(0.3, MINDLIN, pm.DampingRatio(0.5))):
        scene, run, _ = shaken(dimension, (*normal, friction))
        there = scene.replace(packing=run.packing)
        modulus = pm.complex_modulus(scene, [0.1, 1.0]).modulus_f
        pair.append((run.packing.position_nd, run.trace.energy_t, pm.energy(there), modulus))
        pair[-1] += (pm.stiffness_matrix(there).toarray(), pm.torques(there))
    for one, other in zip(*pair, strict=True):
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-9 * np.abs(one).max())


@pytest.mark.parametrize("dimension", [2, 3])
def test_energy_and_torques_at_rest_are_those_of_the_run_and_runs_go_on(dimension, tmp_path):
    turning = (pm.RollingResistance(STRONG, 0.4), pm.TwistingResistance(STRONG, 0.3))[: dimension - 1]
    effects = (HERTZ, pm.Friction(STRONG, MINDLIN), *turning)
    scene, run, start = shaken(dimension, effects)
    there = scene.replace(packing=run.packing)
    assert run.trace.energy_t[-1] == pytest.approx(pm.energy(there), rel=1e-10)
    pm.simulate(scene, steps=150, dt=0.02, check=False, checkpoint=tmp_path / "half.npz", **start)
    resumed = pm.resume(tmp_path / "half.npz", scene, steps=300)
    np.testing.assert_array_equal(resumed.packing.position_nd, run.packing.position_nd)
    assert resumed.packing.tangential == run.packing.tangential
    on = pm.simulate(there, steps=1, dt=1e-9, velocity_nd=run.velocity_nd, spin_nk=run.spin_nk, check=False)
    inertia = (0.5 if dimension == 2 else 0.4) * (there.packing.mass_n * there.packing.radius_n**2)[:, None]
    turned = inertia * (on.spin_nk - run.spin_nk) / 1e-9
    close = 1e-5 * np.abs(turned).max()
    np.testing.assert_allclose(pm.torques(there).reshape(turned.shape), turned, rtol=0.0, atol=close)


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_matrix_is_the_derivative_of_the_engines_forces_as_contacts_load(dimension):
    scene, run, _ = shaken(dimension, (HERTZ, pm.Friction(STRONG, MINDLIN)), steps=100)
    scene = scene.replace(packing=run.packing.replace(mass_n=np.full(run.packing.particles, HEAVY)))
    packing, d = scene.packing, dimension
    rng = np.random.default_rng(5)
    v, w = rng.normal(size=packing.position_nd.shape), rng.normal(size=(packing.particles, 2 * d - 3))

    def difference(step):
        pushes = []
        for sign in (1.0, -1.0):
            engine = build_engine(scene, dt=step, velocity_nd=sign * v, spin_nk=sign * w, second_order=False)
            engine.advance(1)
            push = np.empty_like(engine.state.push)
            push[engine.order_n] = engine.state.push
            pushes.append(push)
        return (pushes[0] - pushes[1]) / (2.0 * step)

    found = pm.contact_forces(scene)
    contacts, force = found.contacts, found.tangential_cd
    approach = -((v[contacts.j_c] - v[contacts.i_c]) * contacts.normal_cd).sum(axis=1)
    # either way the motion unloads some contacts, whose tangential forces fall by dk_t / k_t = d(overlap) / 2 overlap:
    # half of the central difference
    overlap = contacts.contact_distance_c - contacts.distance_c
    lost = (0.25 * approach / overlap)[:, None] * force
    expected = np.zeros((packing.particles, 3 * (d - 1)))
    np.add.at(expected, (contacts.i_c, slice(0, d)), lost)
    np.add.at(expected, (contacts.j_c, slice(0, d)), -lost)
    n = contacts.normal_cd
    moment = (n[:, 0] * lost[:, 1] - n[:, 1] * lost[:, 0])[:, None] if d == 2 else np.cross(n, lost)
    for own in (contacts.i_c, contacts.j_c):
        arm = packing.radius_n[own] * contacts.distance_c / contacts.contact_distance_c
        np.add.at(expected, (own, slice(d, None)), arm[:, None] * moment)
    gyration = packing.radius_n[:, None] * (0.5 if d == 2 else 0.4) ** 0.5
    matrix = pm.stiffness_matrix(scene, "none")
    linear = -(matrix @ np.hstack([v, w * gyration]).ravel()).reshape(packing.particles, -1)
    expected += np.hstack([linear[:, :d], linear[:, d:] * gyration])
    # second derivatives differ between loading and unloading, so that an error of first order is left to be taken off
    found = 2.0 * difference(5e-6) - difference(1e-5)
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-7 * np.abs(expected).max())


def test_scene_files_name_it_and_bad_numbers_are_refused(tmp_path):
    scene = contact_of(0.01, (HERTZ, pm.Friction(0.5, pm.Mindlin(0.2), pm.DampingRatio(0.7)), pm.Restitution(0.8)))
    pm.write_scene(scene, tmp_path / "scene.toml")
    assert pm.read_scene(tmp_path / "scene.toml") == scene
    for wrong, said in (
        (pm.Friction(0.5, pm.Mindlin(0.7)), "stiffness.poisson_ratio must be from 0 to 0.5, got 0.7"),
        (pm.Friction(0.5, MINDLIN, pm.DampingRatio(-1.0)), "damping.ratio must not be negative"),
        (pm.Friction(0.5, pm.DampingRatio()), "stiffness must be a finite number"),
        (pm.RollingResistance(0.5, MINDLIN), "stiffness must be a finite number"),
    ):
        with pytest.raises(ValueError, match=said):
            contact_of(0.01, (HERTZ, wrong))


@pytest.mark.parametrize(("dimension", "fraction"), [(2, 0.9), (3, 0.62)])
def test_bodies_whose_law_is_a_linear_spring_have_the_constant_spring_that_follows_at_each_place_they_touch(
    dimension, fraction
):
    bodies = pm.random_packing(16, dimension=dimension, packing_fraction=fraction, seed=1, shapes=pm.Trimer(angle=2.0))
    normal = (pm.Repulsion(pm.LinearSpring(2.0)), pm.ContactDamping(0.1))
    constant = mindlin_stiffness(pm.Mindlin(0.3), 2.0, 0)
    ends = [
        pm.simulate(
            pm.Scene(bodies, (*normal, pm.Friction(0.4, stiffness, 0.1))),
            steps=200, dt=0.02, temperature=1e-3, seed=1, check=False,
        )
        for stiffness in (pm.Mindlin(0.3), constant)
    ]  # fmt: skip
    assert len(ends[0].packing.tangential) > 16
    np.testing.assert_allclose(ends[0].packing.position_nd, ends[1].packing.position_nd, rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(ends[0].spin_nk, ends[1].spin_nk, rtol=0.0, atol=1e-12)
