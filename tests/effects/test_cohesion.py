"""Facts about cohesive contacts: pull-off forces, works of separation, collisions, stiffness, and what is remembered."""

import math

import numpy as np
import pytest
from scipy.integrate import quad

import packmech as pm

W, E, SIGMA = 0.01, 2.0, 1.0
RADIUS = 0.25
JKR = pm.JKR(E, W)
BOUND = (1.0,)


def pair(dimension=3, distance=0.99, mass=1.0):
    place = np.full((2, dimension), 2.0)
    place[:, 0] = [1.5, 1.5 + distance]
    return pm.Packing(place, [0.5, 0.5], pm.Box.cubic(4.0, dimension), mass_n=[mass, mass])


def bound(packing):
    """Return the packing with a memory of its first two particles having touched."""
    image, slack = np.zeros((1, packing.dimension)), np.zeros((1, 1 if packing.dimension == 2 else 3))
    return packing.replace(tangential=pm.TangentialDisplacements([0], [1], image, slack, memory_ck=[[1.0]]))


def pull(effect, distance, *memory):
    return effect.interaction_first(distance, SIGMA, 1.0, *memory)[0]


def test_it_takes_the_pull_off_force_and_the_work_of_the_formula_to_part_dmt_spheres():
    dmt = pm.DMT(W, 0.02, 7.0)
    distance = np.linspace(0.97, dmt.reach(SIGMA), 100001)
    tension = [pull(dmt, r) + pm.Hertz(5.0).first(min(r, SIGMA), SIGMA) for r in distance]
    assert max(tension) == pytest.approx(2.0 * math.pi * W * RADIUS, rel=1e-6)
    work, _ = quad(lambda r: pull(dmt, r), SIGMA, dmt.reach(SIGMA), epsabs=0.0, epsrel=1e-12)
    assert work == pytest.approx(2.0 * math.pi * W * RADIUS * 0.02 * 7.0 / 9.0, rel=1e-12)
    assert -dmt.interaction_energy(SIGMA, SIGMA, 1.0) == pytest.approx(work, rel=1e-12)
    # the van der Waals force A R / (6 (gap + z)^2), A = 12 pi w z^2, where the cut is far
    far = pm.DMT(W, 0.02, 1e6)
    assert pull(far, 1.05) == pytest.approx(12.0 * math.pi * W * 0.02**2 * RADIUS / (6.0 * 0.07**2), rel=1e-9)


def test_a_jkr_contact_has_the_pull_off_force_and_the_radius_of_the_closed_forms():
    radius = (9.0 * math.pi * W * RADIUS**2 / (2.0 * E)) ** (1.0 / 3.0)
    balanced = radius**2 / RADIUS - math.sqrt(2.0 * math.pi * W * radius / E)
    assert abs(pull(JKR, SIGMA - balanced, BOUND)) < 1e-13 * W
    # equilibrium overlap a^2 / (3 R)
    assert balanced == pytest.approx(radius**2 / (3.0 * RADIUS), rel=1e-12)
    tension = [pull(JKR, r, BOUND) for r in np.linspace(SIGMA, JKR.reach(SIGMA), 20001)]
    assert max(tension) == pytest.approx(1.5 * math.pi * W * RADIUS, rel=1e-7)
    # at touch 8/9 of it, where it breaks 5/9
    assert tension[0] == pytest.approx(4.0 / 3.0 * math.pi * W * RADIUS, rel=1e-12)
    assert pull(JKR, JKR.reach(SIGMA) * (1.0 - 1e-15), BOUND) == pytest.approx(
        5.0 / 6.0 * math.pi * W * RADIUS, rel=1e-5
    )
    # without adhesion it is Hertz's force (4/3) E R^(1/2) overlap^(3/2)
    dry = pm.JKR(E, 1e-12)
    assert -pull(dry, 0.98, BOUND) == pytest.approx(4.0 / 3.0 * E * math.sqrt(RADIUS) * 0.02**1.5, rel=1e-4)


@pytest.mark.parametrize("distance", [0.9, 0.99, 0.9999, 1.0001, 1.005])
def test_overlap_and_force_of_jkr_are_those_of_the_same_radius(distance):
    overlap = SIGMA - distance
    radii = np.roots([1.0 / RADIUS**2, 0, -2.0 * overlap / RADIUS, -2.0 * math.pi * W / E, overlap**2])
    # a^2/R - overlap = sqrt(...) has one sign
    real = [a.real for a in radii if abs(a.imag) < 1e-9 * abs(a) and a.real**2 / RADIUS > overlap]
    a = max(real)
    force = 4.0 * E * a**3 / (3.0 * RADIUS) - math.sqrt(8.0 * math.pi * W * E * a**3)
    assert -pull(JKR, distance, BOUND) == pytest.approx(force, rel=1e-9)


def lost():
    """Energy lost as a bond forms at touch and breaks at its largest distance: 7.09 (w^5 R^4 / E^2)^(1/3)."""
    x = 0.25 ** (1.0 / 3.0)
    scale = 8.0 / 3.0 * math.pi * W * (2.0 * math.pi * W * RADIUS**2 / E) ** (2.0 / 3.0)
    return scale * (0.4 * x**10 - x**7 + 0.375 * x**4 + 0.225)


def test_the_loss_of_a_jkr_bond_is_that_of_thornton_and_ning_and_its_work():
    assert lost() == pytest.approx(7.09 * (W**5 * RADIUS**4 / E**2) ** (1.0 / 3.0), rel=1e-3)
    work, _ = quad(lambda r: pull(JKR, r, BOUND), SIGMA, JKR.reach(SIGMA), epsabs=0.0, epsrel=1e-8)
    assert work == pytest.approx(lost(), rel=1e-7)


def collide(speed, dt, effects=(JKR,), gap=0.003):
    scene = pm.Scene(pair(distance=1.0 + gap), effects)
    velocity = np.zeros((2, 3))
    velocity[:, 0] = [0.5 * speed, -0.5 * speed]
    return pm.simulate(scene, duration=6.0, dt=dt, velocity_nd=velocity, check=False)


def test_a_collision_loses_what_making_and_breaking_of_a_jkr_bond_takes():
    # reduced mass 1/2
    speed, error = 2.0 * math.sqrt(4.0 * lost()), []
    for dt in (2e-3, 1e-3):
        run = collide(speed, dt)
        left = 0.25 * (run.velocity_nd[1, 0] - run.velocity_nd[0, 0]) ** 2
        assert run.packing.tangential is None
        error.append(abs(0.25 * speed**2 - left - lost()))
        # the bond forms up to a step late, and breaks up to a step late
        assert error[-1] < 2.0 * 1.5 * math.pi * W * RADIUS * speed * dt


def test_jkr_spheres_stick_below_the_speed_whose_energy_is_lost_and_part_above():
    threshold = math.sqrt(4.0 * lost())
    for part, sticks in ((0.97, True), (1.03, False)):
        run = pm.simulate(
            pm.Scene(pair(distance=1.0001), (JKR,)),
            duration=12.0,
            dt=5e-4,
            velocity_nd=[[0.5 * part * threshold, 0, 0], [-0.5 * part * threshold, 0, 0]],
            check=False,
        )
        assert (run.packing.tangential is not None) == sticks


def test_a_bridge_has_the_force_of_its_formula_until_its_rupture():
    wet = pm.CapillaryBridge(1e-4, 0.01, 0.3)
    rupture = (1.0 + 0.15) * 1e-4 ** (1.0 / 3.0)
    assert wet.reach(SIGMA) - SIGMA == pytest.approx(rupture, rel=1e-12)
    r, h = 0.5, 0.03
    # Rabinovich and others: F = 2 pi r g cos(theta) / (1 + h / (2 d)), d = h/2 (-1 + sqrt(1 + 2 V / (pi r h^2)))
    depth = 0.5 * h * (-1.0 + math.sqrt(1.0 + 2.0 * 1e-4 / (math.pi * r * h * h)))
    force = 2.0 * math.pi * r * 0.01 * math.cos(0.3) / (1.0 + h / (2.0 * depth))
    assert pull(wet, SIGMA + h, BOUND) == pytest.approx(force, rel=1e-12)
    assert pull(wet, SIGMA + h, (0.0,)) == 0.0
    assert pull(wet, 0.98, BOUND) == pytest.approx(2.0 * math.pi * r * 0.01 * math.cos(0.3), rel=1e-12)


COHESIVE = {
    "spring": (pm.Repulsion(pm.Harmonic(1.0)), pm.ShortRangeAttraction(1.0, 0.02)),
    "dmt": (pm.Repulsion(pm.Hertz(1.0)), pm.DMT(W, 0.01)),
    "jkr": (JKR,),
    "bridge": (pm.Repulsion(pm.Harmonic(1.0)), pm.CapillaryBridge(1e-4, 0.01)),
}


@pytest.mark.parametrize("name", ["jkr", "bridge"])
def test_pairs_that_never_touched_feel_nothing_and_those_that_did_are_held_up_to_the_break(name):
    effects = COHESIVE[name]
    reach = effects[-1].reach(SIGMA)
    near = 0.5 * (SIGMA + reach)
    apart = pm.Scene(pair(distance=near), effects)
    assert pm.energy(apart) == 0.0 and not pm.forces(apart).any()
    together = apart.replace(packing=bound(apart.packing))
    force = pull(effects[-1], near, BOUND)
    np.testing.assert_allclose(pm.forces(together)[:, 0], [force, -force], rtol=1e-12)
    assert pm.energy(together) == pytest.approx(effects[-1].interaction_energy(near, SIGMA, 1.0, BOUND), rel=1e-12)
    run = pm.simulate(together, steps=1, dt=1e-6)
    np.testing.assert_allclose(run.velocity_nd[:, 0], [force * 1e-6, -force * 1e-6], rtol=1e-5)
    assert run.packing.tangential.memory_ck.tolist() == [[1.0]]
    assert pm.simulate(apart, steps=1, dt=1e-6).packing.tangential is None


def test_two_spheres_that_are_drawn_apart_pull_with_the_jkr_force_and_break_where_it_says():
    # one is held, the other so heavy that its speed stays
    scene = pm.Scene(bound(pair(distance=0.999, mass=1e9)), (JKR, pm.FixedParticles((0,))))
    fast = [[0.0, 0.0, 0.0], [1e-3, 0.0, 0.0]]
    time = 1.2e3 * (JKR.reach(SIGMA) - 0.999)
    run = pm.simulate(scene, duration=time, dt=0.05, trace_every=1, velocity_nd=fast, check=False)
    distance = 0.999 + 1e-3 * run.time_t
    tension = run.stress_tdd[:, 0, 0] * 64.0 / distance
    assert tension.max() == pytest.approx(1.5 * math.pi * W * RADIUS, rel=1e-4)
    last = distance[np.flatnonzero(tension > 0.0)[-1]]
    assert last == pytest.approx(JKR.reach(SIGMA), abs=2.0 * 1e-3 * 0.05)
