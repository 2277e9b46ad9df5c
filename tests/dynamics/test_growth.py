"""Facts about energy from nowhere: what a step too long shows, and what motion that is right does not."""

from functools import cache
from typing import NamedTuple

import numpy as np
import pytest

import packmech as pm
from packmech.dynamics import observables as columns
from packmech.dynamics.energy_drift import (
    EnergyWatch,
    Moment,
    RowWatch,
    energy_unit,
    knows_its_energy,
    steps_between_observations,
    watch_of,
)

SPRING = pm.LinearSpring()


def moment(time, potential, kinetic, power=0.0, pressing=0.0):
    return Moment(time, potential, 0.0, kinetic, power, pressing)


def is_calm(now, start, *between, strained=False, known=True, rubbing=False, every=100):
    """Whether the last of several looks, a hundred steps apart, is calm."""
    watch = EnergyWatch(1.0, known, strained, rubbing, every)
    watch.remember(start, 0)
    last = start
    for k, one in enumerate((*between, now), start=1):
        good = watch.is_calm(one, last, start, 100 * k)
        last = one
    return good


def test_energy_may_change_its_kind():
    # a fall from no potential energy and no motion
    assert is_calm(moment(1.0, -50.0, 50.1), moment(0.0, 0.0, 0.0))


def test_a_packing_at_rest_gains_no_motion_however_much_energy_its_contacts_hold():
    assert not is_calm(moment(1.0, 10.0, 1e-6), moment(0.0, 10.0, 0.0))
    assert is_calm(moment(1.0, 10.0, 1e-12), moment(0.0, 10.0, 0.0))


def test_a_motion_just_below_the_limit_shows_a_hundred_times_its_energy_at_most():
    assert is_calm(moment(1.0, 10.0 + 5e-5, 0.0), moment(0.0, 10.0, 1e-6))
    assert not is_calm(moment(1.0, 10.0 + 2e-4, 0.0), moment(0.0, 10.0, 1e-6))


def test_work_of_the_box_is_no_growth_and_growth_beyond_it_is():
    # half of a power that grew evenly from none
    start = moment(0.0, 10.0, 0.0)
    assert is_calm(moment(2.0, 11.0, 0.0, power=1.0), start, strained=True)
    assert not is_calm(moment(2.0, 12.5, 0.0, power=1.0), start, strained=True)
    assert not is_calm(moment(2.0, 11.0, 0.0), start)


def test_what_dashpots_took_may_not_come_back():
    assert not is_calm(moment(9.0, 1.0, 2.0), moment(0.0, 1.0, 5.0), moment(8.0, 1.0, 1e-3))


@pytest.mark.parametrize("number", [np.nan, np.inf])
def test_a_number_that_is_none_is_never_calm(number):
    assert not is_calm(moment(1.0, number, 0.0), moment(0.0, 1.0, 0.0), known=False)


def test_a_body_force_without_an_energy_may_do_any_work():
    assert is_calm(moment(1.0, 1.0, 100.0), moment(0.0, 1.0, 0.0), known=False)
    assert not knows_its_energy(pm.Scene(packing(), (Blower(),)))


@pm.effect
class Blower(NamedTuple):
    """A force that grows with the velocity."""

    strength: float = 1.0

    def body_force(self, x, y, z, u, v, w, mass, radius):
        """Return the force."""
        return self.strength * u, self.strength * v, self.strength * w


@cache
def packing(particles=40):
    start = pm.random_packing(particles, dimension=2, sizes=pm.Bidisperse(1.4), packing_fraction=0.95, seed=1)
    return pm.quench(pm.Scene(start, (pm.Repulsion(law=SPRING),)), force_tolerance=1e-10).packing


def scene_of(*, damping=0.0, damping_across=0.0, every=2):
    bonds = pm.bond_contacts(packing(), tangential_stiffness=0.3, damping=damping, tangential_damping=damping_across)
    bonds = bonds.select(np.arange(len(bonds)) % every == 0)
    effects = (pm.Repulsion(law=SPRING), pm.ContactDamping(damping), pm.Friction(0.5, 0.4, damping_across), bonds)
    return pm.Scene(packing(), effects)


def velocities(size):
    return size * np.random.default_rng(3).standard_normal((40, 2))


def test_heating_that_is_small_against_the_energy_of_the_contacts_is_named():
    scene = scene_of(every=10_000)
    velocity = velocities(1e-4)
    run = pm.simulate(
        scene, steps=3000, dt=0.4, velocity_nd=velocity, applied_strain=pm.SteadyStrain(0.0), trace_every=1, check=False
    )
    assert run.outcome is pm.Outcome.STEP_TOO_LONG
    assert run.trace.kinetic_t[-1] < 1e-3 * run.trace.energy_t[0]


def test_the_work_of_shear_is_volume_times_stress_times_rate():
    rate, dt = 0.02, 0.005
    run = pm.simulate(
        scene_of(every=1),
        steps=400,
        dt=dt,
        velocity_nd=velocities(1e-3),
        applied_strain=pm.SteadyStrain(rate),
        trace_every=1,
    )
    trace = run.trace
    velocity = trace.kinetic_stress_tdd[:, 0, 1] - trace.momentum_td[:, 0] * trace.momentum_td[:, 1] / (
        run.packing.mass_n.sum() * run.packing.box.volume
    )
    power = rate * run.packing.box.volume * (trace.stress_tdd[:, 0, 1] + velocity)
    gained = trace.energy_t + trace.kinetic_t - trace.energy_t[0] - trace.kinetic_t[0]
    work = np.concatenate([[0.0], np.cumsum(0.5 * dt * (power[1:] + power[:-1]))])
    assert gained.max() > 1e-3
    assert np.abs(gained - work).max() < 1e-4 * np.abs(gained).max()


def test_what_a_sliding_spring_is_set_to_is_no_growth():
    start, now = moment(0.0, 10.0, 0.0), moment(1.0, 12.0, 0.0)._replace(tangential=2.0)
    assert is_calm(now, start, rubbing=True) and not is_calm(now, start)
    assert not is_calm(now._replace(kinetic=0.1), start, rubbing=True)


def test_growth_that_is_little_from_look_to_look_is_seen_over_many():
    slow = [moment(float(k), 10.0, 1e-3 * 1.2**k) for k in range(40)]
    assert is_calm(slow[12], slow[0], *slow[1:12], strained=True)
    assert not is_calm(slow[-1], slow[0], *slow[1:-1], strained=True, every=4000)


def test_a_box_that_is_to_stay_as_it_is_does_no_work():
    assert not watch_of(scene_of(), pm.SteadyStrain(0.0), 0.1).works
    assert watch_of(scene_of(), pm.SteadyStrain(1e-3), 0.1).works


def test_observations_of_a_box_that_deforms_are_as_close_as_its_strain_asks_for():
    assert steps_between_observations(None, 0.1, 100) == np.inf
    assert steps_between_observations(pm.SteadyStrain(0.0), 0.1, 100) == np.inf
    assert steps_between_observations(pm.SteadyStrain(1e-3), 0.1, 1000) == 200
    assert steps_between_observations(pm.OscillatoryStrain(1e-3, 1e-2), 0.05, 1000) == 125
    # a look costs as much as some thousand steps of one particle
    assert steps_between_observations(pm.SteadyStrain(1.0), 0.1, 50) == 100


def test_the_unit_of_energy_is_that_of_the_stiffest_law_of_contacts_bonds_or_walls():
    law = pm.LinearSpring(7.0)
    bonds = pm.Bonds([0], [1], [[0, 0]], [1.0], compression=law)
    assert energy_unit(pm.Scene(packing(), (bonds,))) == 7.0 * packing().reference_diameter ** 2
    assert energy_unit(pm.Scene(packing(), (pm.BackgroundDamping(),))) == 0.0
    assert knows_its_energy(pm.Scene(packing(), (pm.Gravity(), pm.BackgroundDamping(), bonds)))


def rows_of(stress, kinetic):
    """Return rows of figures, one unit of time apart, of a box sheared at rate 0.1 in which a force grows."""
    rows = np.zeros((len(kinetic), columns.COLUMNS))
    rows[:, columns.TIME], rows[:, columns.RATE] = np.arange(len(rows)), 0.1
    rows[:, columns.STRAIN] = 0.1 * rows[:, columns.TIME]
    rows[:, columns.POTENTIAL], rows[:, columns.KINETIC], rows[:, columns.FORCE + 1] = 5.0, kinetic, stress
    return rows


def test_rows_of_figures_are_watched_as_they_come():
    shear = np.array([[0.0, 1.0], [0.0, 0.0]])
    worked, grown = rows_of(2.0, 0.2 * np.arange(6.0)), rows_of(0.0, 0.2 * np.arange(6.0))
    watch = RowWatch(scene_of(), shear, 100, lambda time: 0.0)
    assert watch.is_calm(worked[:1]) and watch.is_calm(worked[:4]) and watch.is_calm(worked)
    assert not RowWatch(scene_of(), shear, 100, lambda time: 0.0).is_calm(grown)


def lone(kind):
    """Return one particle in a box by itself: what friction lets turn, an ellipse, a spheroid, a rigid body."""
    d = 2 if kind in ("disc", "ellipse") else 3
    shapes = None if kind in ("disc", "sphere") else pm.Spheroids([2.0], [[1.0] + [0.0] * (d - 1)])
    alone = pm.Packing([[2.0] * d], [0.5], pm.Box.cubic(4.0, d), shapes=shapes)
    rough = pm.Friction(coefficient=0.5, stiffness=0.7, damping=0.1)
    return pm.Scene(alone, (pm.Repulsion(), rough, pm.BackgroundDamping(0.5)))


@pytest.mark.parametrize("kind", ["disc", "sphere", "ellipse", "spheroid"])
def test_what_drag_turns_with_a_flow_is_stopped_by_nothing(kind):
    scene = lone(kind)
    run = pm.ramp_strain(scene, rate=0.1, applied_strain=2.0, dt=0.01)
    assert run.ok
    # half the vorticity of v_x = rate y
    assert run.spin_nk[0, -1] == pytest.approx(-0.05, abs=1e-4)
    shear = pm.OscillatoryStrain(amplitude=0.5, frequency=0.05)
    assert pm.simulate(scene, duration=40.0, dt=0.02, applied_strain=shear).ok


def discs(*effects, seed=1):
    """Return 32 discs at rest whose contacts hold an energy of about .033, under these effects."""
    start = pm.random_packing(32, dimension=2, sizes=pm.Bidisperse(1.4), packing_fraction=0.9, seed=seed)
    settled = pm.quench(pm.Scene(start, (pm.Repulsion(),)), force_tolerance=1e-8).packing
    return pm.Scene(settled, (pm.Repulsion(), *effects))


STIFF = {
    "tangential spring": (pm.Friction(0.5, stiffness=1e4), 0.5),
    "tangential spring, shorter steps": (pm.Friction(0.5, stiffness=1e4), 0.1),
    "tangential dashpot": (pm.Friction(0.5, stiffness=1.0, damping=1e3), 0.5),
    "tangential dashpot, shorter steps": (pm.Friction(0.5, stiffness=1.0, damping=1e3), 0.02),
    "normal dashpot": (pm.ContactDamping(50.0), 0.05),
    "drag": (pm.BackgroundDamping(50.0), 0.05),
}


@pytest.mark.parametrize("method", [pm.VelocityVerlet(), pm.SemiImplicitEuler()])
@pytest.mark.parametrize("name", STIFF)
def test_a_step_that_is_unstable_for_one_contact_is_too_long_and_the_run_says_for_which(name, method):
    effect, dt = STIFF[name]
    scene = discs(effect)
    moving = 0.1 * np.random.default_rng(1).normal(size=(32, 2))
    run = pm.simulate(scene, dt=dt, steps=2000, velocity_nd=moving, method=method, check=False)
    assert run.outcome is pm.Outcome.STEP_TOO_LONG and not run.ok
    assert run.steps == 0
    np.testing.assert_allclose(run.packing.position_nd, scene.packing.position_nd, rtol=0, atol=1e-14)
    limit = run.unmet[0]
    assert limit.name == "time step" and limit.reached == dt and limit.asked < dt
    # a step that is chosen is shorter
    assert pm.simulate(scene, steps=3, velocity_nd=moving, method=method).dt < limit.asked


def pair(d, mass):
    """Return two particles that overlap a little, with these masses."""
    place = np.zeros((2, d)) + 2.0
    place[1, 0] += 0.99
    return pm.Packing(place, [0.5, 0.5], pm.Box.cubic(6.0, d), mass_n=mass)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize(
    ("effect", "stiffness", "damping", "turned"),
    [
        (pm.Repulsion(pm.LinearSpring(40.0)), 40.0, 0.0, False),
        (pm.ContactDamping(7.0), 0.0, 7.0, False),
        (pm.Friction(0.5, stiffness=1e-9, damping=7.0), 0.0, 7.0, True),
    ],
)
def test_the_limit_of_a_pair_is_that_of_its_reduced_mass_and_inertia(d, effect, stiffness, damping, turned):
    mass = (0.5, 2.0)
    inverse = 1.0 / mass[0] + 1.0 / mass[1]
    if turned:
        # arms r: r^2 / I = 2 / m of discs, 5 / (2 m) of spheres
        inverse *= 3.0 if d == 2 else 3.5
    # velocity Verlet: omega dt = 2; its dashpot sees v(half) + v(half) - v(start): c dt / m = 1
    limit = 2.0 / np.sqrt(inverse * stiffness) if stiffness else 1.0 / (inverse * damping)
    scene = pm.Scene(pair(d, mass), (effect,))
    run = pm.simulate(scene, dt=1.5 * limit, steps=1, check=False)
    # what counts is growth by a tenth in a step
    assert limit < run.unmet[0].asked < 1.1 * limit
    assert pm.simulate(scene, dt=0.99 * limit, steps=1, check=False).unmet == ()


def test_bonds_that_are_too_stiff_for_a_step_are_named():
    bonds = pm.Bonds([0], [1], [[0, 0]], [0.99], compression=SPRING, tangential_stiffness=1e5)
    run = pm.simulate(pm.Scene(pair(2, (1.0, 1.0)), (bonds,)), dt=0.1, steps=10, check=False)
    assert run.outcome is pm.Outcome.STEP_TOO_LONG and "tangential force of a bond" in str(run.unmet[0])
    still = pm.FixedParticles((0, 1))
    assert pm.simulate(pm.Scene(pair(2, (1.0, 1.0)), (bonds, still)), dt=0.1, steps=10).ok


def test_strained_runs_and_batches_refuse_a_step_that_is_unstable_for_one_contact():
    scene = discs(pm.Friction(0.5, stiffness=1e4))
    sheared = pm.ramp_strain(scene, rate=1e-3, applied_strain=0.1, dt=0.1, check=False)
    assert sheared.outcome is pm.Outcome.STEP_TOO_LONG and sheared.unmet[0].name == "time step"
    pressed = pm.shear_at_pressure(scene, rate=1e-3, pressure=1e-2, dt=0.1, check=False)
    assert pressed.outcome is pm.Outcome.STEP_TOO_LONG
    with pytest.raises(ValueError, match="dt must be at most .*friction of a contact is unstable above"):
        pm.ShearBatch([scene], control="rate", dt=0.1)
