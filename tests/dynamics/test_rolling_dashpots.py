"""Facts about resistance to rolling without a spring: of one size, and in proportion to the velocity of rolling."""

import math
from typing import NamedTuple

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import packmech as pm
from packmech.dynamics.energy_drift import is_frictional
from packmech.dynamics.integrators import choose_time_step
from packmech.dynamics.stability import growth
from packmech.mechanics.complex_modulus import _touching as touching_elements

STIFF = 1e3
SPRING = pm.Repulsion(pm.LinearSpring(1.0))
FORMS = [pm.ConstantRolling(0.1, 2.0), pm.ViscousRolling(0.3)]


def inertia(dimension, mass=1.0, radius=0.5):
    return (0.5 if dimension == 2 else 0.4) * mass * radius**2


def on_floor(dimension, rolling, slope=0.0, overlap=0.01):
    """Return a disc or sphere of mass 1 where a rough floor bears its weight, and its arm there.

    A wall has half the stiffness of a pair at twice the overlap.
    """
    arm = 0.5 - overlap
    place = np.full((1, dimension), 5.0)
    place[0, 1] = arm
    packing = pm.Packing(place, [0.5], pm.Box.cubic(20.0, dimension), mass_n=[1.0])
    floor = pm.Walls(1, 0.0, 15.0, pm.LinearSpring(STIFF), 0.0, pm.Friction(0.5, STIFF, 20.0), rolling)
    return pm.Scene(packing, (floor, pm.Gravity(slope, -2.0 * STIFF * overlap))), arm


def rolled(scene, arm, speed, **how):
    """Return the run of a disc or sphere that starts rolling along x."""
    dimension = scene.packing.dimension
    spin = [[-speed / arm]] if dimension == 2 else [[0.0, 0.0, -speed / arm]]
    velocity = np.zeros((1, dimension))
    velocity[0, 0] = speed
    return pm.simulate(scene, velocity_nd=velocity, spin_nk=spin, **how)


@pytest.mark.parametrize("dimension", [2, 3])
def test_constant_resistance_takes_the_speed_of_what_rolls_on_a_floor_at_a_constant_rate(dimension):
    """m v' = -f and I w' = f D - mu D N with v = w D: v' = -mu g / (1 + I / (m D^2)), D the arm, 20 the weight."""
    scene, arm = on_floor(dimension, pm.ConstantRolling(0.01, 20.0))
    rate = 0.01 * 20.0 / (1.0 + inertia(dimension) / arm**2)
    ends = [rolled(scene, arm, 1.0, duration=time).velocity_nd[0, 0] for time in (2.0, 4.0, 6.0)]
    assert np.diff(ends) / -2.0 == pytest.approx([rate, rate], rel=1e-8)


@pytest.mark.parametrize("dimension", [2, 3])
def test_viscous_resistance_takes_the_speed_of_what_rolls_on_a_floor_exponentially(dimension):
    """m v' = -f and I w' = f D - k N v D with v = w D: v' = -k g v / (1 + I / (m D^2))."""
    scene, arm = on_floor(dimension, pm.ViscousRolling(0.02))
    rate = 0.02 * 20.0 / (1.0 + inertia(dimension) / arm**2)
    # the spring of friction follows the force, which falls: it slips by rate^2 / stiffness of the way
    ends = [rolled(scene, arm, 1.0, duration=time).velocity_nd[0, 0] for time in (2.0, 4.0, 6.0)]
    assert np.diff(np.log(ends)) / -2.0 == pytest.approx([rate, rate], rel=2e-4)


def test_a_step_for_the_weight_is_as_good_as_the_shorter_one_that_is_chosen_for_deep_contacts():
    scene, arm = on_floor(2, pm.ViscousRolling(2.0), overlap=1e-4)
    floor, weight = scene.effects
    longest = pm.simulate(scene.replace(effects=(floor._replace(rolling=None), weight)), steps=1).dt
    # of a particle on a wall F_n is its weight, and a its arm
    assert longest * 2.0 * 2.0 * STIFF * 1e-4 * arm**2 / inertia(2) < 0.05
    chosen, given = (rolled(scene, arm, 0.05, duration=4.0, **how) for how in ({}, {"dt": longest}))
    assert chosen.dt < 0.2 * given.dt and 0.0 < given.velocity_nd[0, 0] < 0.03
    assert given.velocity_nd[0, 0] == pytest.approx(chosen.velocity_nd[0, 0], rel=1e-3)


@pytest.mark.parametrize("dimension", [2, 3])
def test_what_constant_resistance_stops_stays_at_rest(dimension):
    scene, arm = on_floor(dimension, pm.ConstantRolling(0.01, 20.0))
    stops = (1.0 + inertia(dimension) / arm**2) / (0.01 * 20.0)
    run, later = (rolled(scene, arm, 1.0, steps=round((stops + more) / 1e-3), dt=1e-3) for more in (4.0, 8.0))
    assert abs(run.velocity_nd[0, 0]) < 1e-12
    assert later.packing.position_nd[0, 0] == pytest.approx(run.packing.position_nd[0, 0], abs=1e-12)


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_time_step_that_is_chosen_turns_no_spin_round(dimension):
    side = 1.96
    place = np.full((2, dimension), 1.5)
    place[:, 0] = [0.0, 0.5 * side]
    packing = pm.Packing(place, [0.5, 0.5], pm.Box(np.diag([side, *[3.0] * (dimension - 1)])), mass_n=[1.0, 1.0])
    scene = pm.Scene(packing, (SPRING, pm.ConstantRolling(1.0, 5.0)))
    spin = np.zeros((2, 1 if dimension == 2 else 3))
    spin[:, -1] = [0.02, -0.02]
    # coarser than the one that is chosen
    dt = 4.0 * pm.simulate(scene, steps=1, spin_nk=spin).dt
    seen = [pm.simulate(scene, steps=steps, dt=dt, spin_nk=spin).spin_nk[0, -1] for steps in range(1, 300, 6)]
    assert np.all(np.diff(seen) <= 0.0) and min(seen) >= -1e-18 and seen[-1] < 1e-12
    with pytest.raises(pm.NotConverged, match="resistance of a contact to rolling or twisting is unstable above"):
        pm.simulate(scene, steps=1, dt=1.0, spin_nk=spin)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("rolling", [pm.ConstantRolling(1.0, 1.0), pm.RollingResistance(1.0, 1.0)])
def test_a_time_step_is_refused_where_a_contact_of_two_sizes_rolls_unstably(dimension, rolling):
    """v' = -a^2 (1/I_i + 1/I_j) f with a = .5 * 2 / 2.5."""
    place = np.full((2, dimension), 4.0)
    place[1, 0] += 2.4
    packing = pm.Packing(place, [0.5, 2.0], pm.Box.cubic(12.0, dimension))
    rate = 0.4**2 * sum(1.0 / inertia(dimension, *one) for one in zip(packing.mass_n, packing.radius_n, strict=True))
    scene = pm.Scene(packing, (pm.Repulsion(pm.LinearSpring(0.1)), rolling))
    how = {"steps": 1, "check": False, "spin_nk": np.full((2, 1 if dimension == 2 else 3), 1e-3)}
    for part in (1.5, 4.0):
        refused = pm.simulate(scene, dt=part * (1.0 / rate if rolling.damping else 2.0 / math.sqrt(rate)), **how)
        assert refused.outcome is pm.Outcome.STEP_TOO_LONG
        longest = refused.unmet[0].asked
        kind = {"tangential": True, "second_order": True, "lead": 0.0 if rolling.damping else 0.35}
        limit = growth(rate * longest**2 * rolling.stiffness, rate * longest * rolling.damping, **kind)
        assert limit == pytest.approx(1.1, rel=1e-6)
    assert pm.simulate(scene, dt=0.9 * longest, **how).outcome is pm.Outcome.FINISHED
    assert pm.simulate(scene, **how).dt < 0.1 * longest


def test_below_its_limit_a_slope_makes_what_constant_resistance_does_not_hold_creep():
    """The load is m g_x, against a dashpot; a spring holds it."""
    creeps, _ = on_floor(2, pm.ConstantRolling(0.1, 50.0), slope=0.5)
    assert pm.simulate(creeps, duration=20.0).velocity_nd[0, 0] == pytest.approx(0.5 / 50.0, rel=1e-6)
    held, _ = on_floor(2, pm.RollingResistance(0.1, STIFF, 50.0), slope=0.5)
    assert abs(pm.simulate(held, duration=20.0).velocity_nd[0, 0]) < 1e-6


def collision(dimension, rolling):
    """Return two unequal particles that are pressed and pass each other, without friction, and how they move."""
    place = np.full((2, dimension), 2.0)
    place[1, :2] += [0.8, 0.3]
    packing = pm.Packing(place, [0.5, 0.6], pm.Box.cubic(6.0, dimension), mass_n=[1.0, 1.7])
    velocity = np.zeros((2, dimension))
    velocity[:, :2] = [[0.1, -0.04], [-0.06, 0.03]]
    spin = [[0.3], [-0.8]] if dimension == 2 else [[0.3, -0.5, 0.2], [-0.6, 0.1, 0.9]]
    return pm.Scene(packing, (SPRING, rolling)), {"velocity_nd": velocity, "spin_nk": np.array(spin)}


def integrated(scene, start, coefficient, duration):
    """Return spins at the end by an integrator of SciPy, given the dashpot as (speed, normal force) -> coefficient."""
    packing = scene.packing
    d, k = packing.dimension, start["spin_nk"].shape[1]
    mass, radius = packing.mass_n, packing.radius_n
    turned = np.array([inertia(d, *one) for one in zip(mass, radius, strict=True)])
    sigma = radius.sum()

    def slope(_, y):
        place, velocity, spin = y[: 2 * d].reshape(2, d), y[2 * d : 4 * d].reshape(2, d), y[4 * d :].reshape(2, k)
        branch = np.zeros(3)
        branch[:d] = place[1] - place[0]
        distance = np.linalg.norm(branch)
        # they touch throughout
        n, normal = branch / distance, sigma - distance
        three = np.zeros((2, 3))
        three[:, 3 - k :] = spin
        arms = radius * distance / sigma
        arm = arms[0] * arms[1] / arms.sum()
        rolls = arm * np.cross(three[1] - three[0], n)
        torque = arm * np.cross(n, coefficient(np.linalg.norm(rolls), normal) * rolls)[3 - k :]
        push = normal * n[:d]
        return np.concatenate(
            [velocity.ravel(), -push / mass[0], push / mass[1], torque / turned[0], -torque / turned[1]]
        )

    y = np.concatenate([packing.position_nd.ravel(), start["velocity_nd"].ravel(), start["spin_nk"].ravel()])
    found = solve_ivp(slope, (0.0, duration), y, "DOP853", rtol=1e-12, atol=1e-14, max_step=duration / 50)
    return found.y[4 * d :, -1].reshape(2, k)


@pytest.mark.parametrize("dimension", [2, 3])
def test_viscous_resistance_follows_the_equations_of_motion_to_second_order(dimension):
    scene, start = collision(dimension, pm.ViscousRolling(8.0))
    due = integrated(scene, start, lambda speed, normal: 8.0 * normal, 0.8)
    errors = [
        np.abs(pm.simulate(scene, steps=steps, dt=0.8 / steps, check=False, **start).spin_nk - due).max()
        for steps in (100, 200, 400)
    ]
    assert np.abs(start["spin_nk"] - due).max() > 0.2
    assert [math.log2(a / b) for a, b in zip(errors[:-1], errors[1:], strict=True)] == pytest.approx([2.0] * 2, abs=0.1)
    assert errors[-1] < 1e-5


@pytest.mark.parametrize("dimension", [2, 3])
def test_constant_resistance_follows_the_equations_of_motion_above_and_below_its_limit(dimension):
    scene, start = collision(dimension, pm.ConstantRolling(1.5, 2.0))
    ratios = []

    def coefficient(speed, normal):
        ratios.append(2.0 * speed / (1.5 * normal))
        return min(2.0, 1.5 * normal / speed)

    due = integrated(scene, start, coefficient, 0.8)
    assert max(ratios) > 1.2 and min(ratios) < 0.8
    found = pm.simulate(scene, steps=4000, dt=2e-4, check=False, **start).spin_nk
    assert np.abs(found - due).max() < 1e-6


@pytest.mark.parametrize("rolling", FORMS)
def test_a_contact_dissipates_its_force_times_its_velocity_of_rolling(rolling):
    """F v after a hundredth of the scene's shortest time, in which v' = -2 a^2 F / I slows the rolling."""
    packing = pm.Packing([[2.0, 2.0], [2.9, 2.0]], [0.5, 0.5], pm.Box.cubic(6.0, 2))
    scene, mass, arm, normal = pm.Scene(packing, (SPRING, rolling)), float(packing.mass_n[0]), 0.225, 0.1
    later, slowing = choose_time_step(scene, 0.01), 2.0 * arm**2 / inertia(2, mass)
    viscous = isinstance(rolling, pm.ViscousRolling)
    dashpot = rolling.coefficient * normal if viscous else rolling.damping
    for spin in (1.0, 0.001):
        speed, cap = 2.0 * arm * spin, np.inf if viscous else rolling.coefficient * normal
        if dashpot * speed < cap:
            due = dashpot * speed**2 * math.exp(-2.0 * slowing * dashpot * later)
        else:
            due = cap * (speed - slowing * cap * later)
        found = pm.contact_dissipation(scene, np.zeros((2, 2)), [[spin], [-spin]])
        assert found.by_channel["rolling"] == pytest.approx(found.total, rel=1e-12)
        # meanwhile the spring, k = 1, parts the discs: the normal force falls by k t^2 / m; 1e-6 is the step's
        assert found.total == pytest.approx(due, rel=later**2 / mass + 1e-6)


@pytest.mark.parametrize("rolling", FORMS)
def test_at_rest_it_is_as_if_there_were_none_and_nothing_is_kept(rolling):
    start = pm.random_packing(32, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.95, seed=4)
    bare = pm.Scene(start, (SPRING,))
    scene = pm.Scene(start, (SPRING, rolling))
    rest = pm.quench(scene, force_tolerance=1e-12).packing
    assert rest == pm.quench(bare, force_tolerance=1e-12).packing
    bare, scene = bare.replace(packing=rest), scene.replace(packing=rest)
    assert pm.classify_jamming(scene).strict == pm.classify_jamming(bare).strict
    np.testing.assert_array_equal(pm.normal_modes(scene).frequency_m, pm.normal_modes(bare).frequency_m)
    rough, more = (one.replace(effects=(*one.effects, pm.Friction(0.5, 0.7))) for one in (bare, scene))
    for one, other in ((bare, scene), (rough, more)):
        np.testing.assert_array_equal(pm.elastic_moduli(other).cauchy, pm.elastic_moduli(one).cauchy)
        found, due = pm.contact_forces(other), pm.contact_forces(one)
        assert found.isostatic_coordination == due.isostatic_coordination
        np.testing.assert_array_equal(found.rattlers_n, due.rattlers_n)
        assert (pm.stiffness_matrix(other) != pm.stiffness_matrix(one)).nnz == 0
    run = pm.simulate(more, steps=50, spin_nk=np.full((32, 1), 0.1))
    assert run.packing.tangential.rolling_ck is None
    assert pm.simulate(scene, steps=50, spin_nk=np.full((32, 1), 0.1)).packing.tangential is None
    assert "zero at rest" == pm.calls.honors.CALLS["quench"].answer(*pm.calls.honors.columns_of(rolling))


@pytest.mark.parametrize("rolling", FORMS)
def test_complex_moduli_have_the_dashpots_that_small_oscillations_have(rolling):
    start = pm.random_packing(32, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.95, seed=4)
    rest = pm.quench(pm.Scene(start, (SPRING,)), force_tolerance=1e-12).packing
    strong = rolling._replace(coefficient=20.0) if isinstance(rolling, pm.ViscousRolling) else rolling
    effects = (SPRING, pm.ContactDamping(0.3), pm.Friction(0.5, 0.7, 0.2), strong)
    scene, bare = pm.Scene(rest, effects), pm.Scene(rest, effects[:3])
    due, without = (pm.complex_modulus(one, [0.2]).modulus_f[0] for one in (scene, bare))
    run = pm.oscillatory_shear(scene, amplitude=1e-7, frequency=0.2, periods=24, skip_periods=22, pre_periods=0)
    found = complex(run.moduli.storage, run.moduli.loss)
    assert abs(found - due) < 1e-4 * abs(due) and abs(without - due) > 1e-3 * abs(due)


@pm.effect
class Pull(NamedTuple):
    """A spring that pulls particles that touch together."""

    strength: float = 1.0

    def pair_energy(self, distance, contact_distance):
        return -0.5 * self.strength * (contact_distance - distance) ** 2

    def pair_first(self, distance, contact_distance):
        return self.strength * (contact_distance - distance)

    def pair_second(self, distance, contact_distance):
        return -self.strength


@pytest.mark.parametrize("strength", [0.0, 2.0])
def test_a_contact_that_pulls_resists_rolling_as_one_that_pushes(strength):
    packing = pm.Packing([[2.0, 2.0], [2.9, 2.0]], [0.5, 0.5], pm.Box.cubic(6.0, 2))
    scene = pm.Scene(packing, (SPRING, Pull(strength), pm.ViscousRolling(3.0)))
    _, dashpots = touching_elements(scene, pm.find_contacts(packing, gap_tolerance=0.0), 1.0 / packing.mass_n)
    assert dashpots[1].stiffness_cxx[0, -1, -1] == pytest.approx(0.225**2 * 3.0 * 0.1, rel=1e-12)
    assert pm.contact_dissipation(scene, np.zeros((2, 2)), [[1.0], [-1.0]]).by_channel["rolling"] > 0.0


def test_dashpots_are_no_springs_that_give_way_and_no_friction_to_leave_out():
    scene = pm.Scene(pm.lattice_packing("triangular", repeats=(3, 3)), (SPRING,))
    for one in FORMS:
        assert not is_frictional(scene.replace(effects=(SPRING, one)))
    for one in (pm.Friction(0.5), pm.RollingResistance(0.1)):
        assert is_frictional(scene.replace(effects=(SPRING, one)))
    linked = pm.cluster_packing(6, pm.Trimer(), dimension=2, packing_fraction=0.3, seed=1)
    with pytest.raises(ValueError, match=r"method must be .*, for a packing with links or shapes, got HardVertex"):
        pm.jam(pm.Scene(linked, (SPRING, FORMS[0])), method=pm.HardVertex())
    spring = pm.Scene(scene.packing, (SPRING, pm.RollingResistance()))
    with pytest.raises(ValueError, match=r"leave friction out with scene.without\(pm.RollingResistance\)"):
        pm.jam(spring, method=pm.HardVertex())


def test_grains_at_rest_on_a_rough_floor_that_only_damps_rolling_are_those_of_one_without():
    for rolling in FORMS:
        scene, _ = on_floor(2, rolling)
        floor, weight = scene.effects
        plain = scene.replace(effects=(floor._replace(rolling=None), weight))
        np.testing.assert_array_equal(pm.torques(scene), pm.torques(plain))
        np.testing.assert_array_equal(pm.contact_forces(scene).rattlers_n, pm.contact_forces(plain).rattlers_n)
        run = pm.settle(scene, force_tolerance=1e-8)
        assert run.outcome is pm.Outcome.CONVERGED
        kept = pm.simulate(scene, steps=20, velocity_nd=[[0.1, 0.0]]).packing
        assert pm.energy(scene.replace(packing=kept)) == pm.energy(plain.replace(packing=kept))


class Sticky(NamedTuple):
    """A user's own resistance to rolling."""

    size: float = 1.0

    def rolling_dashpot(self, speed, normal_force):
        return self.size


def test_what_has_no_meaning_is_refused():
    plane = pm.lattice_packing("triangular", repeats=(3, 3))
    with pytest.raises(ValueError, match="one resistance to rolling at most, got ConstantRolling at 1, Viscous.* at 2"):
        pm.Scene(plane, (SPRING, *FORMS))
    with pytest.raises(ValueError, match="one resistance to rolling at most, got RollingResistance at 1, Constant"):
        pm.Scene(plane, (SPRING, pm.RollingResistance(), FORMS[0]))
    with pytest.raises(ValueError, match=r"effects\[0\].damping must be positive, got 0"):
        pm.Scene(plane, (pm.ConstantRolling(0.1, 0.0),))
    ellipses = pm.random_packing(8, dimension=2, packing_fraction=0.5, shapes=pm.Ellipses(aspect=1.5), seed=1)
    for one in FORMS:
        name = type(one).__name__
        with pytest.raises(ValueError, match=f"effects must hold no {name} for ellipses"):
            pm.Scene(ellipses, (SPRING, one))
        with pytest.raises(ValueError, match=rf"rolling of Walls must be given where contacts have {name}"):
            pm.Scene(plane, (SPRING, one, pm.Walls(1, -9.0, 9.0)))
        walls = pm.Walls(1, -9.0, 9.0, rolling=one._replace(coefficient=0.0))
        assert pm.Scene(plane, (SPRING, one, walls)).effects[2].roughness is None
    with pytest.raises(ValueError, match=r"rolling must be RollingResistance\(...\), ConstantRolling\(...\), Viscous"):
        pm.Scene(plane, (SPRING, pm.Walls(1, -9.0, 9.0, rolling=pm.Friction())))
    with pytest.raises(TypeError, match="Sticky must not define rolling_dashpot"):
        pm.effect(Sticky)
