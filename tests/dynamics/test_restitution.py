"""What collisions leave: dashpots by restitution against an independent integration, closed forms and the engine."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import beta

import packmech as pm

LAWS = (pm.LinearSpring(2.0), pm.Harmonic(3.0), pm.Hertz(), pm.PowerLaw(1.0, 3.5), pm.DivergentRepulsion())


@settings(max_examples=40, deadline=None)
@given(
    law=st.sampled_from(LAWS),
    restitution=st.floats(0.05, 0.999),
    ratio=st.floats(0.0, 3.0).map(lambda power: 10.0**power),
    size=st.floats(1.0, 30.0),
    speed=st.floats(-5.0, -1.0).map(lambda power: 10.0**power),
)
def test_restitution_is_had_for_any_law_masses_radii_and_speeds(law, restitution, ratio, size, speed):
    effects = (pm.Repulsion(law), pm.Restitution(restitution))
    found = pm.coefficient_of_restitution(effects, speed, radii=(0.5, 0.5 * size), masses=(1.0, ratio))
    assert found == pytest.approx(restitution, rel=1e-8)


def zeta(restitution):
    """Return the damping ratio of a linear spring that leaves this restitution."""
    return -math.log(restitution) / math.hypot(math.pi, math.log(restitution))


def test_the_dashpot_of_a_linear_spring_is_constant_and_that_of_hertz_spheres_is_tsujis():
    for overlap in (1e-6, 0.02):
        distance, mass = 1.0 - overlap, 0.4
        linear = pm.TouchingPair(distance, 1.0, -1.0, 0.5 * 7.0 * overlap**2, -7.0 * overlap, 7.0, mass, 0.25)
        assert pm.Restitution(0.6).pair_damping(linear) == pytest.approx(2.0 * zeta(0.6) * math.sqrt(0.4 * 7.0))
        hertz = pm.TouchingPair(
            distance, 1.0, -1.0, 0.4 * 5.0 * overlap**2.5, -5.0 * overlap**1.5, 7.5 * overlap**0.5, mass, 0.25
        )
        alpha = math.sqrt(5.0) * zeta(0.6)
        assert pm.Restitution(0.6).pair_damping(hertz) == pytest.approx(alpha * math.sqrt(0.4 * 5.0) * overlap**0.25)


def test_viscoelastic_spheres_lose_what_the_first_two_orders_in_their_time_say():
    mass, speed = 0.5, 1e-3
    # F = stiffness overlap^(3/2)
    stiffness = -pm.Hertz().first(0.99, 1.0) / 0.01**1.5
    deepest = (1.25 * mass * speed**2 / stiffness) ** 0.4
    for time in (1e-2, 1e-3):
        time *= deepest / speed
        found = pm.coefficient_of_restitution((pm.Repulsion(pm.Hertz()), pm.ViscoelasticDamping(time)), speed)
        # int c v^2 dt over m v^2, c = (3/2) time stiffness sqrt(overlap), speeds of the undamped collision
        share = 3.0 * time * stiffness / (mass * speed) * deepest**1.5 * 0.4 * beta(0.6, 1.5)
        # e = 1 - share + (3/5) share^2 + ... (Ramirez and others, Phys. Rev. E 60, 4465 (1999))
        assert (1.0 - found) / share - 1.0 == pytest.approx(-0.6 * share, rel=share)


@pytest.mark.parametrize("law", [pm.LinearSpring(2.0), pm.Hertz()], ids=repr)
def test_the_viscoelastic_time_leaves_the_restitution_it_was_found_for(law):
    how = {"radii": (0.5, 3.0), "masses": (1.0, math.inf)}
    time = pm.viscoelastic_time(law, 0.98, 1e-3, **how)
    effects = (pm.Repulsion(law), pm.ViscoelasticDamping(time))
    assert pm.coefficient_of_restitution(effects, 1e-3, **how) == pytest.approx(0.98, rel=1e-8)
    slower = pm.coefficient_of_restitution(effects, 1e-5, **how)
    if isinstance(law, pm.Hertz):
        # 1 - e = share - (3/5) share^2 to the third order, and the share grows as speed^(1/5)
        share = (1.0 - math.sqrt(1.0 - 4.0 * 0.6 * 0.02)) / 1.2
        less = share * 1e-2**0.2
        assert 1.0 - slower == pytest.approx(less - 0.6 * less**2, rel=share**2)
    else:
        assert slower == pytest.approx(0.98, rel=1e-8)


def test_what_cannot_part_has_the_restitution_zero_and_what_passes_through_is_refused():
    assert pm.coefficient_of_restitution((pm.Repulsion(pm.LinearSpring()), pm.ContactDamping(50.0)), 1e-3) == 0.0
    with pytest.raises(ValueError, match="speed must be so small that the effects stop the particles"):
        pm.coefficient_of_restitution((pm.Repulsion(),), 10.0)


@pytest.mark.parametrize("coefficient", [0.0, 1.5, -0.1])
def test_restitution_is_above_zero_and_at_most_one(coefficient):
    packing = pm.lattice_packing("triangular", repeats=(3, 3))
    with pytest.raises(ValueError, match=r"effects\[1\]\.coefficient must "):
        pm.Scene(packing, (pm.Repulsion(), pm.Restitution(coefficient)))


class Collision:
    """Two particles, or one and a wall, that meet head on in the engine."""

    def __init__(self, law, damping, speed, *, sizes=(1.0, 1.0), masses=(1.0, 1.0), dimension=2, wall=False):
        self.law, self.damping, self.speed, self.wall = law, damping, speed, wall
        self.radii = 0.5 * np.array(sizes)
        self.masses, self.d = np.array(masses), dimension
        self.sigma = 2.0 * self.radii[0] if wall else self.radii.sum()
        self.reduced = 0.5 * self.masses[0] if wall else 1.0 / (1.0 / self.masses).sum()

    def scene(self, gap):
        """Return the scene with the particles, or the particle and the wall, a gap apart."""
        box = pm.Box.cubic(10.0 * self.sigma, self.d)
        # near the origin places are rounded least
        place = np.zeros((1 if self.wall else 2, self.d))
        if self.wall:
            place[0, 0] = self.radii[0] + gap
            effects = (pm.Repulsion(self.law), pm.Walls(0, 0.0, 9.0 * self.sigma, self.law, self.damping))
        else:
            place[1, 0] += self.sigma + gap
            effects = (pm.Repulsion(self.law), self.damping)
        count = len(place)
        return pm.Scene(pm.Packing(place, self.radii[:count], box, mass_n=self.masses[:count]), effects)

    def after(self, dt, steps, gap=None):
        """Return the speed after so many steps over that before; contacts close in the middle of a step."""
        half = 0.5 * self.speed * dt
        scene = self.scene(half if gap is None else gap)
        velocity = np.zeros(scene.packing.position_nd.shape)
        # the center of mass of two rests
        share = [1.0] if self.wall else [-self.reduced / self.masses[0], self.reduced / self.masses[1]]
        velocity[:, 0] = -self.speed * np.array(share)
        run = pm.simulate(scene, steps=steps, dt=dt, velocity_nd=velocity)
        end = run.velocity_nd[:, 0]
        return float(end[0] if self.wall else end[1] - end[0]) / self.speed


@pytest.mark.parametrize("wall", [False, True], ids=["two", "wall"])
@pytest.mark.parametrize(("ratio", "size"), [(1.0, 1.0), (1000.0, 30.0), (1.0, 30.0)])
@pytest.mark.parametrize("speed", [1e-5, 1e-3, 1e-1])
def test_linear_contacts_have_their_restitution_to_second_order_in_the_engine(wall, ratio, size, speed):
    met = Collision(
        pm.LinearSpring(2.0), pm.Restitution(0.6), speed, sizes=(1.0, size), masses=(1.0, ratio), dimension=3, wall=wall
    )
    omega = math.sqrt(2.0 / met.reduced)
    lasts = math.pi / (omega * math.sqrt(1.0 - zeta(0.6) ** 2))
    errors = []
    for steps in (400, 800, 25600):
        # it opens in the middle of a step, too: a dashpot that jumps there costs no order then
        errors.append(met.after(lasts / steps, steps + 2) - 0.6)
    assert math.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=5e-3)
    # places are rounded in every step
    rounding = np.spacing(met.sigma) * math.sqrt(25600.0) / (speed / omega)
    assert abs(errors[2]) < 1e-8 + rounding


@pytest.mark.parametrize("law", [pm.Hertz(), pm.DivergentRepulsion(divergence=1.0)], ids=repr)
@pytest.mark.parametrize(("ratio", "size", "speed"), [(1.0, 1.0, 1e-2), (1000.0, 30.0, 1e-4), (30.0, 1.0, 1e-6)])
@pytest.mark.parametrize("wall", [False, True], ids=["two", "wall"])
def test_other_laws_have_their_restitution_to_a_thousandth_in_the_engine(law, ratio, size, speed, wall):
    met = Collision(law, pm.Restitution(0.7), speed, sizes=(1.0, size), masses=(1.0, ratio), wall=wall)
    # the time of a collision, from the energy at an overlap that a bisection finds
    low, high = 0.0, 0.5 * met.sigma
    for _ in range(200):
        middle = 0.5 * (low + high)
        deep = law.energy(met.sigma - middle, met.sigma) > 0.5 * met.reduced * speed**2
        low, high = (low, middle) if deep else (middle, high)
    dt = 2e-3 * high / speed
    # the dashpot sets in, and lets go, within a step: up to half of c dt / m = 2 zeta omega dt = 4e-4 each
    assert met.after(dt, 3000, gap=0.37 * speed * dt) == pytest.approx(0.7, abs=1e-3)


def test_a_held_particle_counts_as_infinitely_heavy():
    box = pm.Box.cubic(10.0, 2)
    packing = pm.Packing([[5.0, 5.0], [6.001, 5.0]], [0.5, 0.5], box, mass_n=[1.0, 3.0])
    scene = pm.Scene(packing, (pm.Repulsion(pm.LinearSpring()), pm.Restitution(0.4), pm.FixedParticles((0,))))
    run = pm.simulate(scene, duration=8.0, dt=1e-3, velocity_nd=[[0.0, 0.0], [-0.01, 0.0]])
    # as far as the steps in which the contact closes and opens: 2 zeta omega dt
    assert run.velocity_nd[1, 0] == pytest.approx(0.004, rel=2.0 * zeta(0.4) * math.sqrt(1.0 / 3.0) * 1e-3)


# of collisions of shapes
STEP = 2e-4


def shaped(kind, dimension):
    """Return two particles apart along x, off center and tilted, so that they turn as they meet."""
    place = np.full((2, dimension), 5.0)
    place[1] += np.r_[2.0, 0.35, [0.2] * (dimension - 2)]
    if kind == "spheroids":
        tilted = [math.cos(0.4), math.sin(0.4), *[0.2] * (dimension - 2)]
        shapes = pm.Spheroids([1.8, 1.5], [tilted, np.eye(dimension)[1]])
        return pm.Packing(place, [0.5, 0.6], pm.Box.cubic(10.0, dimension), shapes=shapes, mass_n=[1.0, 2.5])
    bead = np.zeros((5, dimension))
    bead[:, :2] = [[-0.4, -0.2], [0.5, 0.3], [-0.3, -0.2], [0.4, 0.0], [0.0, 0.6]]
    if dimension == 3:
        bead[:, 2] = [0.1, -0.2, 0.0, 0.15, 0.1]
    beads = pm.Packing(place[[0, 0, 1, 1, 1]] + bead, [0.35, 0.3, 0.35, 0.3, 0.25], pm.Box.cubic(10.0, dimension))
    return pm.rigid_packing(beads, [0, 0, 1, 1, 1]).replace(mass_n=[1.0, 2.5])


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("kind", ["spheroids", "beads"])
@pytest.mark.parametrize("wall", [False, True], ids=["two", "wall"])
def test_shapes_that_meet_off_center_turn_by_what_restitution_leaves_of_the_impulse(kind, dimension, wall):
    packing = shaped(kind, dimension)

    def changes(restitution):
        """Return the changes of velocities and spins in a collision."""
        damping = pm.Restitution(restitution)
        effects = (pm.Repulsion(pm.LinearSpring(4.0)), damping)
        met = packing
        if wall:
            met = packing.select([0])
            effects = (pm.Repulsion(), pm.Walls(0, 3.9, 9.0, pm.LinearSpring(4.0), damping))
        velocity = np.zeros(met.position_nd.shape)
        velocity[-1, 0] = -1e-3
        trace = pm.simulate(
            pm.Scene(met, effects), duration=1500.0, dt=0.01, velocity_nd=velocity, trace_every=20
        ).trace
        touching = trace.time_t[trace.energy_t > 0.0]
        # they fly freely until just before, and spins of free bodies change on their way after it
        near = met.replace(position_nd=met.position_nd + (touching[0] - 0.5) * velocity)
        lasts = float(touching[-1] - touching[0]) + 1.5
        run = pm.simulate(pm.Scene(near, effects), duration=lasts, dt=STEP, velocity_nd=velocity)
        assert pm.energy(pm.Scene(run.packing, effects)) == 0.0
        return np.concatenate([(run.velocity_nd - velocity).ravel(), run.spin_nk.ravel()])

    whole = changes(1.0)
    assert np.count_nonzero(np.abs(whole) > 1e-5) > 1
    # the steps in which contacts close and open, 2 zeta omega dt, and how far shapes move while they touch
    close = 2.0 * zeta(0.4) * math.sqrt(4.0 / 0.3) * STEP + 1e-3
    np.testing.assert_allclose(changes(0.4), 0.7 * whole, rtol=0.0, atol=close * np.abs(whole).max())


def test_minimizers_and_forces_at_rest_know_no_dashpots():
    packing = pm.random_packing(32, dimension=2, packing_fraction=0.88, seed=2)
    plain = pm.Scene(packing, (pm.Repulsion(),))
    damped = plain.replace(effects=(pm.Repulsion(), pm.Restitution(0.3), pm.ViscoelasticDamping(2.0)))
    one, other = (pm.quench(scene, force_tolerance=1e-10).packing for scene in (plain, damped))
    np.testing.assert_array_equal(one.position_nd, other.position_nd)
    np.testing.assert_array_equal(pm.forces(plain), pm.forces(damped))


@pytest.mark.parametrize("dashpot", [pm.Restitution(0.5), pm.ViscoelasticDamping(0.7)], ids=repr)
def test_complex_moduli_have_the_dashpots_that_small_oscillations_have(dashpot):
    start = pm.random_packing(48, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.95, seed=4)
    rest = pm.quench(pm.Scene(start, (pm.Repulsion(pm.Hertz()),)), force_tolerance=1e-12).packing
    scene = pm.Scene(rest, (pm.Repulsion(pm.Hertz()), dashpot))
    due = pm.complex_modulus(scene, [0.2]).modulus_f[0]
    assert due.imag > 0.0
    run = pm.oscillatory_shear(scene, amplitude=1e-7, frequency=0.2, periods=24, skip_periods=22, pre_periods=0)
    assert complex(run.moduli.storage, run.moduli.loss) == pytest.approx(due, rel=3e-5)


def test_walls_keep_their_dashpot_in_scene_files(tmp_path):
    packing = pm.Packing([[5.0, 5.0]], [0.5], pm.Box.cubic(10.0, 2))
    for damping in (0.25, pm.Restitution(0.8), pm.ContactDamping(0.1, onset="smooth")):
        scene = pm.Scene(packing, (pm.Repulsion(), pm.Walls(1, 0.0, 9.0, pm.Hertz(), damping)))
        pm.write_scene(scene, tmp_path / "scene.toml")
        assert pm.read_scene(tmp_path / "scene.toml").effects == scene.effects
    with pytest.raises(TypeError, match=r"effects\[1\]\.damping must be a number or a dashpot such as Restitution"):
        pm.Scene(packing, (pm.Repulsion(), pm.Walls(1, 0.0, 9.0, pm.Hertz(), pm.Repulsion())))


def test_a_dashpot_of_ones_own_that_drives_is_refused():
    from typing import NamedTuple

    class Drives(NamedTuple):
        strength: float = 1.0

        def pair_damping(self, pair):
            return -self.strength * pair.mass

    with pytest.raises(ValueError, match=r"effect Drives\.pair_damping must be finite and not negative, got -0\.3"):
        pm.effect(Drives)
