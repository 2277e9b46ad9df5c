"""Facts about the minimizers: what they reach, what they conserve, how they end, and what they survive."""

import math
import re
from fractions import Fraction
from typing import NamedTuple

import numpy as np
import pytest
from scipy.integrate import BDF

import packmech as pm
from packmech.effects import equal_partners, pair_first
from packmech.minimize.program import build_program

REPULSION = (pm.Repulsion(law=pm.Harmonic()),)
FAST = (pm.Fire(), pm.Fire2(), pm.ConjugateGradient(), pm.LBFGS())
SLOW = (pm.DampedDynamics(), pm.GradientDescent(), pm.SteepestDescent())
METHODS = (None, *FAST, *SLOW)


def name_of(method):
    return "default" if method is None else type(method).__name__


def random_scene(particles=48, *, dimension=2, packing_fraction=0.92, seed=1, effects=REPULSION):
    packing = pm.random_packing(
        particles, dimension=dimension, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=packing_fraction, seed=seed
    )
    return pm.Scene(packing, effects)


@pytest.fixture(scope="module")
def minimum():
    return pm.quench(random_scene(packing_fraction=1.0, seed=3), force_tolerance=1e-13)


def shaken(minimum, amplitude=1e-5):
    packing = minimum.packing
    move = amplitude * np.random.default_rng(4).standard_normal(packing.position_nd.shape)
    return pm.Scene(packing.replace(position_nd=packing.position_nd + move), REPULSION)


def recomputed_residual(packing, effects=REPULSION):
    scene = pm.Scene(packing, effects)
    contacts = pm.find_contacts(packing, gap_tolerance=0.0)
    force = sum(
        -pair_first(effect, r, equal_partners(sigma))
        for effect in effects
        for r, sigma in zip(contacts.distance_c, contacts.contact_distance_c, strict=True)
    )
    return np.linalg.norm(pm.forces(scene), axis=1).max() / (force / len(contacts))


@pytest.mark.parametrize("method", METHODS, ids=name_of)
def test_residual_told_is_that_of_the_packing_returned(method):
    run = pm.quench(random_scene(), force_tolerance=1e-6, method=method)
    assert run.outcome is pm.Outcome.CONVERGED
    assert run.residual <= 1e-6
    assert recomputed_residual(run.packing) == pytest.approx(run.residual, rel=1e-6)


@pytest.mark.parametrize("method", METHODS, ids=name_of)
def test_every_minimizer_finds_the_same_minimum_from_nearby(method, minimum):
    run = pm.quench(shaken(minimum), force_tolerance=1e-10, method=method)
    assert run.residual <= 1e-10
    assert pm.energy(pm.Scene(run.packing, REPULSION)) == pytest.approx(
        pm.energy(pm.Scene(minimum.packing, REPULSION)), rel=1e-12
    )
    drift = run.packing.position_nd - minimum.packing.position_nd
    held = ~pm.find_rattlers(minimum.packing)
    assert np.abs(drift - drift[held].mean(axis=0))[held].max() < 1e-8


def test_newton_finds_the_minimum_in_a_few_steps(minimum):
    run = pm.quench(shaken(minimum), force_tolerance=1e-11, method=pm.Newton())
    assert run.residual <= 1e-11
    assert run.steps <= 5


@pytest.mark.parametrize(("method", "dimension"), [*((m, 2) for m in (None, *FAST)), (None, 3), (pm.LBFGS(), 3)])
def test_tolerance_below_rounding_ends_at_the_floor_of_double_precision(method, dimension):
    fraction = 0.92 if dimension == 2 else 0.72
    scene = random_scene(dimension=dimension, packing_fraction=fraction)
    run = pm.quench(scene, force_tolerance=1e-300, method=method)
    assert run.outcome is pm.Outcome.ROUNDING_FLOOR
    # a contact of stiffness one feels the rounding of coordinates as large as the box
    side = run.packing.box.lattice_dd.max()
    assert np.abs(pm.forces(pm.Scene(run.packing, REPULSION))).max() < 64 * np.finfo(float).eps * side


@pytest.mark.parametrize("method", METHODS, ids=name_of)
def test_a_dilute_start_ends_unjammed_with_no_contact(method):
    run = pm.quench(random_scene(packing_fraction=0.4), force_tolerance=1e-10, method=method)
    assert run.outcome is pm.Outcome.UNJAMMED
    assert run.ok
    assert pm.energy(pm.Scene(run.packing, REPULSION)) < 1e-25


@pytest.mark.parametrize(("method", "dimension"), [*((m, 2) for m in METHODS), (None, 3), (pm.LBFGS(), 3)])
def test_particles_all_at_one_point_part_and_none_is_lost(method, dimension):
    scene = random_scene(24, dimension=dimension, packing_fraction=0.92 if dimension == 2 else 0.72)
    packing = scene.packing
    together = packing.replace(position_nd=np.zeros_like(packing.position_nd))
    run = pm.quench(scene.replace(packing=together), force_tolerance=1e-3, method=method)
    assert run.ok
    assert np.isfinite(run.packing.position_nd).all()
    assert pm.find_contacts(run.packing, gap_tolerance=0.0).overlap_c.max() < 0.5


@pytest.mark.parametrize("method", [None, pm.LBFGS()], ids=name_of)
def test_repulsive_lennard_jones_survives_a_random_start(method):
    scene = random_scene(effects=(pm.Repulsion(law=pm.RepulsiveLennardJones()),))
    run = pm.quench(scene, force_tolerance=1e-8, method=method)
    assert run.residual <= 1e-8
    assert run.stages[0].name == "harmonic law first"


def test_sizes_that_differ_a_thousandfold_come_to_rest():
    rng = np.random.default_rng(1)
    radius = np.where(np.arange(60) < 4, 500.0, 0.5)
    side = math.sqrt(math.pi * (radius**2).sum() / 0.9)
    packing = pm.Packing(rng.uniform(0.0, side, (60, 2)), radius, pm.Box.cubic(side, 2))
    run = pm.quench(pm.Scene(packing, REPULSION), force_tolerance=1e-8)
    assert run.ok
    assert run.residual <= 1e-8


@pytest.mark.parametrize("method", METHODS, ids=name_of)
def test_the_same_scene_ends_in_the_same_bits_again(method):
    one, two = (pm.quench(random_scene(), force_tolerance=1e-4, method=method) for _ in range(2))
    assert one.packing == two.packing
    assert (one.steps, one.force_evaluations, one.residual) == (two.steps, two.force_evaluations, two.residual)


@pytest.mark.parametrize("method", [None, *FAST], ids=name_of)
@pytest.mark.parametrize("power", [-40, 37])
def test_a_power_of_two_in_the_unit_of_length_changes_no_bit_of_a_quench(method, power):
    scene = random_scene()
    packing = scene.packing
    unit = 2.0**power
    scaled = pm.Packing(packing.position_nd * unit, packing.radius_n * unit, packing.box.scaled(unit))
    one = pm.quench(scene, force_tolerance=1e-8, method=method)
    other = pm.quench(scene.replace(packing=scaled), force_tolerance=1e-8, method=method)
    assert np.array_equal(one.packing.position_nd * unit, other.packing.position_nd)
    assert one.residual == other.residual


@pytest.mark.parametrize("method", [None, *FAST], ids=name_of)
@pytest.mark.parametrize("power", [-40, 37])
def test_a_power_of_two_in_the_unit_of_energy_changes_no_bit_of_a_quench(method, power):
    scene = random_scene()
    law = pm.Harmonic(energy_scale=2.0**power)
    one = pm.quench(scene, force_tolerance=1e-8, method=method)
    other = pm.quench(scene.replace(effects=(pm.Repulsion(law=law),)), force_tolerance=1e-8, method=method)
    assert one.packing == other.packing
    assert one.residual == other.residual


@pytest.mark.parametrize("unit", [1e-12, 1e12])
@pytest.mark.parametrize("method", METHODS, ids=name_of)
def test_decimal_units_change_a_minimum_by_rounding_only(method, unit, minimum):
    scene = shaken(minimum)
    packing = scene.packing
    scaled = pm.Packing(packing.position_nd * unit, packing.radius_n * unit, packing.box.scaled(unit))
    effects = (pm.Repulsion(law=pm.Harmonic(energy_scale=1.0 / unit)),)
    run = pm.quench(pm.Scene(scaled, effects), force_tolerance=1e-9, method=method)
    assert pm.energy(pm.Scene(run.packing, effects)) * unit == pytest.approx(
        pm.energy(pm.Scene(minimum.packing, REPULSION)), rel=1e-12
    )


@pytest.mark.parametrize("method", METHODS, ids=name_of)
def test_translation_changes_a_minimum_by_rounding_only(method, minimum):
    scene = shaken(minimum)
    moved = scene.packing.replace(position_nd=scene.packing.position_nd + np.array([0.37, -0.81]))
    run = pm.quench(scene.replace(packing=moved), force_tolerance=1e-10, method=method)
    assert pm.energy(pm.Scene(run.packing, REPULSION)) == pytest.approx(
        pm.energy(pm.Scene(minimum.packing, REPULSION)), rel=1e-12
    )


def test_damped_dynamics_conserves_momentum():
    scene = random_scene()
    program = build_program(scene)
    program.relax(force_tolerance=1e-12, step_limit=500, method=pm.DampedDynamics())
    speed = np.abs(program.velocity_nd).max()
    assert speed > 1e-6
    assert np.abs(program.velocity_nd.sum(axis=0)).max() < 1e-12 * speed * 48


@pytest.mark.parametrize("method", [*FAST, *SLOW], ids=name_of)
def test_the_center_of_mass_stays_where_it_was(method):
    scene = random_scene()
    run = pm.quench(scene, force_tolerance=1e-5, method=method)
    assert np.abs((run.packing.position_nd - scene.packing.position_nd).mean(axis=0)).max() < 1e-11


def damped_pair_error(damping, dt, time):
    """Distance error after a time of two discs that part, against the damped oscillator: d'' = -2 (k d + b d')."""
    # the harmonic law is a spring of stiffness 1 between discs of diameter 1, and compiled for the other tests
    packing = pm.Packing([[0.0, 0.0], [0.9, 0.0]], [0.5, 0.5], pm.Box.cubic(4.0, 2))
    program = build_program(pm.Scene(packing, (pm.Repulsion(),)))
    method = pm.DampedDynamics(damping, dt / max(1.0, damping))
    run = program.relax(force_tolerance=1e-300, step_limit=round(time / dt), method=method)
    distance = run.packing.position_nd[1, 0] - run.packing.position_nd[0, 0]
    root = math.sqrt(damping**2 - 2.0)
    # the slow root without the cancellation of strong damping
    slow, fast = -2.0 / (damping + root), -damping - root
    overlap = 0.1 * (slow * math.exp(fast * time) - fast * math.exp(slow * time)) / (slow - fast)
    return abs(1.0 - distance - overlap)


@pytest.mark.parametrize(("damping", "dt", "time"), [(2.0, 0.02, 3.0), (30.0, 0.5, 40.0), (1e4, 200.0, 2e4)])
def test_damped_dynamics_follows_the_damped_oscillator_to_first_order_in_the_time_step(damping, dt, time):
    """However strong the damping: steps are bounded by how slowly contacts relax, and not by 1 / b."""
    coarse, fine = (damped_pair_error(damping, each, time) for each in (dt, dt / 2.0))
    assert fine < 2e-3
    assert math.log2(coarse / fine) == pytest.approx(1.0, abs=0.1)


def row_of_three(method, step_limit):
    """Overlaps of three equal discs in a row, .1 and .04 at the start, after so many steps."""
    packing = pm.Packing([[0.0, 0.0], [0.9, 0.0], [1.86, 0.0]], [0.5] * 3, pm.Box.cubic(6.0, 2))
    program = build_program(pm.Scene(packing, (pm.Repulsion(),)))
    position = program.relax(force_tolerance=1e-300, step_limit=step_limit, method=method).packing.position_nd
    return 1.0 - np.diff(position[:, 0])


@pytest.mark.parametrize("tolerance", [1e-5, 1e-7])
def test_steepest_descent_keeps_to_its_path_within_the_tolerance(tolerance):
    """Sum and difference of the overlaps of three discs in a row fall at rates 1 and 3: d / d0 = (s / s0)^3."""
    first, second = row_of_three(pm.SteepestDescent(tolerance), 20)
    assert first + second < 0.12
    assert first - second == pytest.approx(0.06 * ((first + second) / 0.14) ** 3, abs=20 * tolerance)


def test_strong_dashpots_relax_all_contacts_at_one_rate_unlike_steepest_descent():
    """The rates b R^T R v = F of a row of discs, whose rigidity matrix has no state of self stress, are k / b each."""
    first, second = row_of_three(pm.DampedDynamics(damping=1e4), 20)
    assert 1e-4 < first < 0.08
    assert first / second == pytest.approx(0.1 / 0.04, rel=1e-4)


@pytest.mark.parametrize("damping", [0.3, 30.0, 1e4])
def test_damped_dynamics_converges_however_strong_the_damping(damping):
    run = pm.quench(random_scene(), force_tolerance=1e-10, method=pm.DampedDynamics(damping=damping), step_limit=20_000)
    assert run.outcome is pm.Outcome.CONVERGED


def test_steepest_descent_never_raises_the_energy():
    run = pm.quench(random_scene(), force_tolerance=1e-2, method=pm.SteepestDescent(1e-6), trace_every=1)
    assert (np.diff(run.trace.energy_t) <= 1e-14).all()


def test_gradient_descent_never_raises_the_energy():
    run = pm.quench(random_scene(), force_tolerance=1e-3, method=pm.GradientDescent(), trace_every=1)
    assert (np.diff(run.trace.energy_t) <= 0.0).all()


def test_looking_on_changes_no_bit_of_a_quench():
    alone = pm.quench(random_scene(), force_tolerance=1e-8, method=pm.Fire())
    watched = pm.quench(
        random_scene(), force_tolerance=1e-8, method=pm.Fire(), trace_every=7, trace_positions=True, progress=print
    )
    assert alone.packing == watched.packing
    assert alone.steps == watched.steps


def test_trace_holds_every_so_many_steps_first_and_last():
    run = pm.quench(random_scene(), force_tolerance=1e-6, method=pm.LBFGS(), trace_every=10, trace_positions=True)
    trace = run.trace
    assert trace.step_t[0] == 0
    assert trace.step_t[-1] == run.steps
    assert (np.diff(trace.step_t)[:-1] == 10).all()
    assert np.array_equal(trace.position_tnd[-1], run.packing.position_nd)
    for t in (0, len(trace.step_t) // 2):
        there = pm.Scene(run.packing.replace(position_nd=trace.position_tnd[t]), REPULSION)
        assert trace.energy_t[t] == pytest.approx(pm.energy(there), rel=1e-12)
        assert trace.pressure_t[t] == pytest.approx(pm.pressure(there), rel=1e-12)
        assert trace.contacts_t[t] == len(pm.find_contacts(there.packing, gap_tolerance=0.0))
        assert trace.max_force_t[t] == pytest.approx(np.linalg.norm(pm.forces(there), axis=1).max(), rel=1e-9)


def test_too_few_steps_raise_with_the_run_attached():
    with pytest.raises(pm.NotConverged, match="step limit") as caught:
        pm.quench(random_scene(), force_tolerance=1e-10, method=pm.Fire(), step_limit=5)
    assert caught.value.run.outcome is pm.Outcome.STEP_LIMIT
    assert caught.value.run.steps == 5


@pytest.mark.parametrize("method", METHODS, ids=name_of)
def test_too_few_steps_are_told_when_not_to_be_raised(method):
    run = pm.quench(random_scene(), force_tolerance=1e-10, method=method, step_limit=5, check=False)
    assert run.outcome is pm.Outcome.STEP_LIMIT
    assert not run.ok


@pytest.mark.parametrize("steps", [0, 5, 62])
def test_newtons_method_takes_as_many_steps_as_it_may(steps):
    run = pm.quench(random_scene(), force_tolerance=1e-10, method=pm.Newton(), step_limit=steps, check=False)
    assert run.outcome is pm.Outcome.STEP_LIMIT
    assert run.steps == steps


def test_newtons_method_succeeds_with_a_higher_limit_as_its_failure_advises():
    with pytest.raises(pm.NotConverged, match="raise step_limit"):
        pm.quench(random_scene(), force_tolerance=1e-10, method=pm.Newton(), step_limit=20)
    run = pm.quench(random_scene(), force_tolerance=1e-10, method=pm.Newton())
    assert run.outcome is pm.Outcome.CONVERGED


def test_a_time_limit_ends_newtons_method_too():
    scene = random_scene(512)
    run = pm.quench(scene, force_tolerance=1e-10, method=pm.Newton(), time_limit=1e-3, check=False)
    assert run.outcome is pm.Outcome.TIME_LIMIT
    assert run.steps < 20


def test_a_time_limit_ends_a_quench():
    run = pm.quench(
        random_scene(2048), force_tolerance=1e-14, method=pm.GradientDescent(), time_limit=1e-3, check=False
    )
    assert run.outcome is pm.Outcome.TIME_LIMIT
    assert 0 < run.steps < 10_000


def test_an_interrupt_carries_the_packing_reached_so_far():
    def stop(stage, figures):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as caught:
        pm.quench(random_scene(2048), force_tolerance=1e-14, method=pm.GradientDescent(), progress=stop)
    run = caught.value.run
    assert run.outcome is pm.Outcome.INTERRUPTED
    assert pm.energy(pm.Scene(run.packing, REPULSION)) < pm.energy(random_scene(2048))


def test_the_default_route_leaves_a_saddle():
    crystal = pm.lattice_packing("square", repeats=(4, 4), relative_overlap=0.05)
    scene = pm.Scene(crystal, REPULSION)
    assert np.abs(pm.forces(scene)).max() < 1e-14
    run = pm.quench(scene, force_tolerance=1e-10)
    assert run.ok
    assert pm.energy(pm.Scene(run.packing, REPULSION)) < 0.9 * pm.energy(scene)


def test_the_step_limit_of_the_default_route_does_not_count_newtons_steps():
    # columns of a square crystal moved as a wave: Newton's method ends at the saddle, and FIRE goes on from there
    crystal = pm.lattice_packing("square", repeats=(4, 4), relative_overlap=0.05)
    position = crystal.position_nd.copy()
    position[:, 0] += 1e-2 * np.sin(2.0 * np.pi * position[:, 0] / crystal.box.lattice_dd[0, 0])
    scene = pm.Scene(crystal.replace(position_nd=position), (pm.Repulsion(law=pm.Hertz()),))
    whole = pm.quench(scene, force_tolerance=1e-10)
    assert [stage.name for stage in whole.stages] == ["FIRE", "Newton", "FIRE, off the saddle", "Newton"]
    own = sum(stage.steps for stage in whole.stages if stage.name != "Newton")
    assert whole.stages[1].steps > 0 and whole.steps > own
    assert pm.quench(scene, force_tolerance=1e-10, step_limit=own).packing == whole.packing
    short = pm.quench(scene, force_tolerance=1e-10, step_limit=own - 1, check=False)
    assert short.outcome is pm.Outcome.STEP_LIMIT and short.steps == own - 1 + whole.stages[1].steps


@pm.law
class Quartic(NamedTuple):
    energy_scale: float = 1.0

    def energy(self, distance, contact_distance):
        return self.energy_scale * (1.0 - distance / contact_distance) ** 4 / 4.0

    def first(self, distance, contact_distance):
        return -self.energy_scale * (1.0 - distance / contact_distance) ** 3 / contact_distance

    def second(self, distance, contact_distance):
        return 3.0 * self.energy_scale * (1.0 - distance / contact_distance) ** 2 / contact_distance**2


def test_a_users_law_ends_where_the_same_power_law_ends():
    scene = random_scene(packing_fraction=1.0)
    near = pm.quench(scene.replace(effects=(pm.Repulsion(law=Quartic()),)), force_tolerance=1e-8).packing
    own, built_in = (
        pm.quench(pm.Scene(near, (pm.Repulsion(law=law),)), force_tolerance=1e-12, method=pm.Fire())
        for law in (Quartic(), pm.PowerLaw(exponent=4.0))
    )
    assert np.abs(own.packing.position_nd - built_in.packing.position_nd).max() < 1e-6
    assert own.residual <= 1e-12


def test_a_stage_says_how_much_of_its_time_was_compiling_the_first_time_only(monkeypatch):
    monkeypatch.setattr("packmech.jit.cache.KernelCache._kept", lambda cache, sig: "Fresh" not in str(sig))

    class Fresh(NamedTuple):
        energy_scale: float = 1.0

    for name in ("energy", "first", "second"):
        setattr(Fresh, name, vars(pm.Harmonic)[name])
    scene = random_scene(effects=(pm.Repulsion(law=pm.law(Fresh)()),))
    few = {"method": pm.GradientDescent(), "step_limit": 5, "check": False}
    first, second = (pm.quench(scene, force_tolerance=1e-10, **few) for _ in range(2))
    (words,) = re.findall(r"^([0-9.]+) s of it compiling, once for all runs$", first.stages[0].note)
    assert 0.5 * first.stages[0].seconds < float(words)
    assert not any("compiling" in stage.note for stage in second.stages)


def test_stages_account_for_all_steps_and_evaluations():
    run = pm.quench(random_scene(), force_tolerance=1e-10)
    assert [stage.name for stage in run.stages] == ["FIRE", "Newton"]
    assert run.steps == sum(stage.steps for stage in run.stages)
    assert run.force_evaluations >= sum(stage.force_evaluations for stage in run.stages)
    assert run.seconds >= sum(stage.seconds for stage in run.stages) - 1e-3


@pytest.mark.parametrize(
    ("arguments", "error", "words"),
    [
        ({"force_tolerance": -1.0}, ValueError, "force_tolerance must be"),
        ({"force_tolerance": math.nan}, ValueError, "force_tolerance must be"),
        ({"force_tolerance": "tight"}, TypeError, "force_tolerance must be"),
        ({"force_tolerance": 1e-8, "step_limit": -1}, ValueError, "step_limit must be"),
        ({"force_tolerance": 1e-8, "trace_every": 0}, ValueError, "trace_every must be"),
        ({"force_tolerance": 1e-8, "time_limit": 0.0}, ValueError, "time_limit must be"),
        ({"force_tolerance": 1e-8, "method": "fire"}, TypeError, "method must be a minimizer"),
        ({"force_tolerance": 1e-8, "method": pm.Fire}, TypeError, "method must be a minimizer"),
        ({"force_tolerance": 1e-8, "method": pm.Fire(dt=-1.0)}, ValueError, r"method\.dt must be"),
        ({"force_tolerance": 1e-8, "method": pm.LBFGS(memory=0)}, ValueError, r"method\.memory must be"),
        ({"force_tolerance": 1e-8, "method": pm.GradientDescent(step=3.0)}, ValueError, r"method\.step must be"),
        ({"force_tolerance": 1e-8, "method": pm.SteepestDescent(0.0)}, ValueError, r"method\.tolerance must be"),
        ({"force_tolerance": 1e-8, "method": pm.DampedDynamics(damping=0.0)}, ValueError, r"method\.damping must be"),
        ({"force_tolerance": 1e-8, "method": pm.ConjugateGradient(slope_ratio=2.0)}, ValueError, r"method\.slope_rat"),
    ],
)
def test_bad_arguments_are_named(arguments, error, words):
    with pytest.raises(error, match=words):
        pm.quench(random_scene(), **arguments)


def test_a_packing_is_not_a_scene():
    with pytest.raises(TypeError, match="scene must be a Scene"):
        pm.quench(random_scene().packing, force_tolerance=1e-8)


def test_the_path_of_steepest_descent_ends_where_a_stiff_method_with_the_exact_hessian_does():
    packing = pm.random_packing(12, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.95, seed=2)
    scene = pm.Scene(packing, (pm.Repulsion(law=pm.LinearSpring()),))

    def at(place_x):
        return scene.replace(packing=packing.replace(position_nd=place_x.reshape(packing.position_nd.shape)))

    path = BDF(
        lambda time, place_x: pm.forces(at(place_x)).ravel(),
        *(0.0, packing.position_nd.ravel(), np.inf),
        **{"rtol": 1e-7, "atol": 1e-7},
        jac=lambda time, place_x: -pm.hessian(at(place_x), "none").toarray(),
    )
    while np.abs(pm.forces(at(path.y))).max() > 1e-9:
        path.step()
        assert path.status == "running"
    end = pm.quench(scene, force_tolerance=1e-8, method=pm.SteepestDescent(1e-8)).packing.position_nd
    assert np.abs(path.y - end.ravel()).max() < 1e-4


def test_numbers_of_a_minimizer_in_any_form_give_the_same_bits():
    packing = pm.random_packing(16, dimension=2, packing_fraction=0.9, seed=1)
    scene = pm.Scene(packing, (pm.Repulsion(),))
    plain, other = (
        pm.quench(scene, force_tolerance=1e-6, method=method).packing.position_nd
        for method in (pm.Fire(dt=0.25, delay=8.0), pm.Fire(dt=Fraction(1, 4), delay=np.array(8)))
    )
    assert np.array_equal(plain, other)
