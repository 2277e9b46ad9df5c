"""Facts about resistance to rolling and twisting: closed forms, conserved quantities, limits, and what is kept."""

import dataclasses
import math

import numpy as np
import pytest

import packmech as pm
from packmech.dynamics.spans import with_dashpot

SPRING = pm.Repulsion(pm.LinearSpring(1.0))
# beyond any limit that is reached
STRONG = 1e3


def row(dimension, spins, *effects, overlap=0.02):
    """Return two equal particles in a row of period two, and their spins about one axis: opposite ones do not slide."""
    side = 2.0 * (1.0 - overlap)
    lattice = np.diag([side, *[3.0] * (dimension - 1)])
    place = np.full((2, dimension), 1.5)
    place[:, 0] = [0.0, 0.5 * side]
    packing = pm.Packing(place, [0.5, 0.5], pm.Box(lattice), mass_n=[1.0, 1.0])
    return pm.Scene(packing, (SPRING, pm.Friction(STRONG, 0.7), *effects)), np.array(spins)


ROLLING = [(2, None), (3, [0.0, 1.0, 0.0]), (3, [0.0, 0.6, -0.8])]


@pytest.mark.parametrize(("dimension", "axis"), [*ROLLING, (3, [1.0, 0.0, 0.0])])
def test_opposite_spins_oscillate_at_the_frequency_of_rolling_and_twisting_springs(dimension, axis):
    rolling, twisting = pm.RollingResistance(STRONG, 0.3), pm.TwistingResistance(STRONG, 0.9)
    effects = (rolling, twisting)[: dimension - 1]
    unit = np.array([1.0] if axis is None else axis)
    scene, spin = row(dimension, np.outer([1e-3, -1e-3], unit), *effects)
    stiffness = 0.9 if axis == [1.0, 0.0, 0.0] else 0.3
    inertia = (0.5 if dimension == 2 else 0.4) * 0.25
    # I w' = -2 contacts A k (2 A angle), A half the arm of 0.49
    omega = math.sqrt(4.0 * 0.245**2 * stiffness / inertia)
    error = []
    for steps in (100, 200):
        run = pm.simulate(scene, steps=steps, dt=1.7 / omega / steps, spin_nk=spin)
        error.append(run.spin_nk[0] @ unit / 1e-3 - math.cos(1.7))
        np.testing.assert_allclose(run.spin_nk[1], -run.spin_nk[0], rtol=0, atol=1e-15)
    assert abs(error[1]) < 1e-5
    assert math.log2(error[0] / error[1]) == pytest.approx(2.0, abs=2e-3)


@pytest.mark.parametrize(("dimension", "axis"), [*ROLLING, (3, [1.0, 0.0, 0.0])])
def test_spins_decay_at_a_constant_rate_where_the_limit_is_reached(dimension, axis):
    effects = (pm.RollingResistance(0.05, 10.0), pm.TwistingResistance(0.03, 10.0))[: dimension - 1]
    unit = np.array([1.0] if axis is None else axis)
    scene, spin = row(dimension, np.outer([0.2, -0.2], unit), *effects)
    coefficient = 0.03 if axis == [1.0, 0.0, 0.0] else 0.05
    inertia = (0.5 if dimension == 2 else 0.4) * 0.25
    # two contacts, the moment arm A times the limit: the normal force is 0.02
    rate = 2.0 * 0.245 * coefficient * 0.02 / inertia
    time = 0.8 * 0.2 / rate
    runs = [pm.simulate(scene, duration=part * time, dt=1e-2, spin_nk=spin) for part in (0.5, 1.0)]
    early, late = (run.spin_nk[0] @ unit for run in runs)
    assert (early - late) / (0.5 * time) == pytest.approx(rate, rel=1e-3)


def shaken(dimension, seed=2, coefficient=STRONG):
    """Return a scene with all resistances whose contacts last, and random velocities and spins."""
    kind, repeats = ("triangular", (4, 4)) if dimension == 2 else ("fcc", (2, 2, 2))
    packing = pm.lattice_packing(kind, repeats=repeats, relative_overlap=0.1)
    turning = (pm.RollingResistance(coefficient, 0.4), pm.TwistingResistance(coefficient, 0.3))[: dimension - 1]
    scene = pm.Scene(packing, (SPRING, pm.Friction(coefficient, 0.7), *turning))
    rng = np.random.default_rng(seed)
    n, d = packing.position_nd.shape
    velocity, spin = 0.02 * rng.normal(size=(n, d)), 0.05 * rng.normal(size=(n, 1 if d == 2 else 3))
    return scene, {"velocity_nd": velocity, "spin_nk": spin}


@pytest.mark.parametrize("dimension", [2, 3])
def test_energy_is_kept_to_second_order_and_momentum_to_rounding(dimension):
    scene, start = shaken(dimension)

    def drift(dt):
        run = pm.simulate(scene, duration=4.0, dt=dt, trace_every=1, check=False, **start)
        trace = run.trace
        whole = trace.energy_t + trace.kinetic_t
        return np.abs(whole - whole[0]).max() / np.abs(trace.energy_t).max(), run

    coarse, (fine, run) = drift(0.02)[0], drift(0.005)
    mass = scene.packing.mass_n
    np.testing.assert_allclose(mass @ run.velocity_nd, mass @ start["velocity_nd"], rtol=0.0, atol=1e-13)
    assert math.log(coarse / fine) / math.log(4.0) == pytest.approx(2.0, abs=0.3)
    assert fine < 1e-4


@pytest.mark.parametrize("dimension", [2, 3])
def test_forces_torques_and_energy_at_rest_are_those_of_the_run(dimension):
    scene, start = shaken(dimension, coefficient=0.3)
    strong = shaken(dimension)[0]
    run = pm.simulate(strong, steps=400, dt=0.02, trace_every=400, check=False, **start)
    assert run.trace.energy_t[-1] == pytest.approx(pm.energy(strong.replace(packing=run.packing)), rel=1e-10)
    # where springs give way, what they gave since the last step is in the run's energy
    run = pm.simulate(scene, steps=400, dt=0.02, trace_every=400, check=False, **start)
    there = scene.replace(packing=run.packing)
    assert run.packing.tangential.rolling_ck.any()
    assert dimension == 2 or run.packing.tangential.twisting_c.any()
    assert run.trace.energy_t[-1] == pytest.approx(pm.energy(there), rel=1e-4)
    on = pm.simulate(there, steps=1, dt=1e-9, velocity_nd=run.velocity_nd, spin_nk=run.spin_nk, check=False)
    mass, k = there.packing.mass_n[:, None], run.spin_nk.shape[1]
    inertia = (0.5 if dimension == 2 else 0.4) * mass * there.packing.radius_n[:, None] ** 2
    turned = inertia * (on.spin_nk - run.spin_nk) / 1e-9
    size = np.abs(turned).max()
    np.testing.assert_allclose(pm.torques(there).reshape(-1, k), turned, rtol=0.0, atol=1e-5 * size)
    bare = there.without(pm.RollingResistance, pm.TwistingResistance)
    assert np.abs(pm.torques(bare).reshape(-1, k) - turned).max() > 1e-2 * size


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_run_that_goes_on_from_its_packing_or_its_checkpoint_is_the_same(dimension, tmp_path):
    scene, start = shaken(dimension, coefficient=0.2)
    whole = pm.simulate(scene, steps=600, dt=0.02, check=False, **start)
    half = pm.simulate(scene, steps=300, dt=0.02, check=False, checkpoint=tmp_path / "state.npz", **start)
    resumed = pm.resume(tmp_path / "state.npz", scene, steps=600)
    np.testing.assert_array_equal(resumed.packing.position_nd, whole.packing.position_nd)
    assert resumed.packing.tangential == whole.packing.tangential
    pm.write_packing(half.packing, tmp_path / "half.npz")
    kept = pm.read_packing(tmp_path / "half.npz")
    assert kept == half.packing and kept.tangential.rolling_ck is not None
    more = {"velocity_nd": half.velocity_nd, "spin_nk": half.spin_nk}
    bare = dataclasses.replace(kept.tangential, rolling_ck=None, twisting_c=None)
    ends = []
    for springs in (kept.tangential, bare):
        there = scene.replace(packing=kept.replace(tangential=springs))
        ends.append(pm.simulate(there, steps=300, dt=0.02, check=False, **more).spin_nk)
    # a packing knows no forces of the step before, from which a run extrapolates velocities
    missed = [np.abs(end - whole.spin_nk).max() for end in ends]
    assert missed[0] < 1e-3 * missed[1]


def test_seen_from_the_other_end_a_rolling_displacement_is_the_same():
    plane = pm.TangentialDisplacements([1], [0], [[0, 0]], [[0.1]], rolling_ck=[[0.2]])
    assert plane == pm.TangentialDisplacements([0], [1], [[0, 0]], [[0.1]], rolling_ck=[[-0.2]])
    space = pm.TangentialDisplacements([1], [0], [[0] * 3], [[0.1, 0, 0]], rolling_ck=[[0.2, 0, 0]], twisting_c=[0.3])
    back = pm.TangentialDisplacements([0], [1], [[0] * 3], [[-0.1, 0, 0]], rolling_ck=[[0.2, 0, 0]], twisting_c=[0.3])
    assert space == back


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_order_of_particles_is_of_no_matter(dimension):
    scene, start = shaken(dimension, coefficient=0.3)
    packing = pm.simulate(scene, steps=200, dt=0.02, check=False, **start).packing
    order = np.random.default_rng(1).permutation(packing.particles)
    one = pm.torques(scene.replace(packing=packing))
    other = pm.torques(scene.replace(packing=packing.select(order)))
    np.testing.assert_allclose(other, one[order], rtol=0.0, atol=1e-13)


@pytest.mark.parametrize(("slope", "rolls"), [(0.9, False), (1.1, True)])
@pytest.mark.parametrize("dimension", [2, 3])
def test_a_disc_or_sphere_on_a_slope_rolls_above_the_angle_of_its_rolling_resistance(dimension, slope, rolls):
    """On a held disc or sphere that is so much larger that it is a plane."""
    angle, mu = math.atan(0.1 * slope), 0.1
    place = np.full((2, dimension), 2.5e5)
    place[1, 1] += 100000.5 - 1e-3
    packing = pm.Packing(place, [1e5, 0.5], pm.Box.cubic(5e5, dimension), mass_n=[1.0, 1.0])
    weight = pm.Gravity(1e-3 * math.sin(angle), -1e-3 * math.cos(angle))
    effects = (
        SPRING, pm.Friction(0.8, 1.0, 0.5), pm.RollingResistance(mu, 1.0, 0.5), pm.ContactDamping(0.5),
        pm.FixedParticles((0,)), weight,
    )  # fmt: skip
    run = pm.simulate(pm.Scene(packing, effects), duration=1000.0, dt=0.1)
    moved = run.packing.position_nd[1, 0] - place[1, 0]
    if rolls:
        # (sin - mu cos) g t^2 / 2 over 1 + I / (m r^2)
        due = 1e-3 * (math.sin(angle) - mu * math.cos(angle)) / (1.5 if dimension == 2 else 1.4) * 0.5 * 1000.0**2
        assert moved == pytest.approx(due, rel=0.05)
    else:
        assert abs(moved) < 1e-2 and np.abs(run.spin_nk[1]).max() < 1e-6


def test_without_friction_spins_alone_feel_resistance_to_rolling():
    scene, spin = row(2, [[0.1], [-0.05]], pm.RollingResistance(STRONG, 0.3))
    smooth = scene.without(pm.Friction)
    run = pm.simulate(smooth, duration=3.0, dt=0.01, spin_nk=spin)
    again = pm.simulate(
        smooth.replace(effects=(*smooth.effects, pm.Friction(0.0))), duration=3.0, dt=0.01, spin_nk=spin
    )
    np.testing.assert_array_equal(run.spin_nk, again.spin_nk)
    # the mean is kept, the difference oscillates
    assert run.spin_nk.sum() == pytest.approx(0.05, rel=1e-12)
    omega = math.sqrt(4.0 * 0.245**2 * 0.3 / 0.125)
    assert np.ptp(run.spin_nk) == pytest.approx(0.15 * abs(math.cos(3.0 * omega)), rel=1e-3)
    np.testing.assert_array_equal(run.velocity_nd, 0.0)


def test_complex_moduli_have_the_springs_and_dashpots_that_small_oscillations_have():
    start = pm.random_packing(32, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.95, seed=4)
    rest = pm.quench(pm.Scene(start, (SPRING,)), force_tolerance=1e-12).packing
    effects = (SPRING, pm.ContactDamping(0.3), pm.Friction(0.5, 0.7, 0.2), pm.RollingResistance(0.2, 0.6, 0.3))
    scene, bare = pm.Scene(rest, effects), pm.Scene(rest, effects[:3])
    due, without = (pm.complex_modulus(one, [0.2]).modulus_f[0] for one in (scene, bare))
    run = pm.oscillatory_shear(scene, amplitude=1e-7, frequency=0.2, periods=24, skip_periods=22, pre_periods=0)
    found = complex(run.moduli.storage, run.moduli.loss)
    assert abs(found - due) < 1e-4 * abs(due) and abs(without - due) > 1e-3 * abs(due)


def test_resistance_of_coefficient_zero_is_none():
    scene, start = shaken(2, coefficient=0.2)
    bare = scene.without(pm.RollingResistance)
    idle = bare.replace(effects=(*bare.effects, pm.RollingResistance(0.0, 1.0)))
    assert (pm.stiffness_matrix(idle) != pm.stiffness_matrix(bare)).nnz == 0
    runs = [pm.simulate(one, steps=50, dt=0.02, check=False, **start).spin_nk for one in (bare, idle)]
    np.testing.assert_array_equal(*runs)


def test_pressing_adds_the_same_dashpot_with_and_without_resistance_to_rolling():
    scene, _ = shaken(2)
    found = [with_dashpot(one)[1] for one in (scene, scene.without(pm.RollingResistance))]
    assert found[0] == found[1] > 0.0


def test_what_has_no_meaning_is_refused():
    plane = pm.lattice_packing("triangular", repeats=(3, 3))
    with pytest.raises(ValueError, match="effects must hold no TwistingResistance in a plane"):
        pm.Scene(plane, (SPRING, pm.Friction(), pm.TwistingResistance()))
    ellipses = pm.random_packing(8, dimension=2, packing_fraction=0.5, shapes=pm.Ellipses(aspect=1.5), seed=1)
    with pytest.raises(ValueError, match="effects must hold no RollingResistance for ellipses"):
        pm.Scene(ellipses, (SPRING, pm.Friction(), pm.RollingResistance()))
