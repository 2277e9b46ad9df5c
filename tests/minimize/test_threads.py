"""Several threads in FIRE, and the blocks of rows that they share: neither changes what comes out."""

import functools
import math
import threading
from typing import NamedTuple

import numpy as np
import pytest

import packmech as pm
from packmech.jit.compiled import kernel
from packmech.jit.threads import run_together, some_failed, wait
from packmech.minimize import program as programs
from packmech.minimize.passes.kernels import Goal
from packmech.minimize.passes.pair_list import listed_pairs
from packmech.minimize.program import build_program

REPULSION = (pm.Repulsion(law=pm.Harmonic()),)
# rows of a block in these tests: some hundred particles then have several
SMALL = 100
# of particles by dimension
MANY = {2: 700, 3: 450}


@pytest.fixture(autouse=True)
def small_blocks(monkeypatch):
    monkeypatch.setattr(programs, "_BLOCK", SMALL)


@functools.cache
def random_scene(dimension=2, effects=REPULSION):
    fraction = {2: 0.92, 3: 0.72}[dimension]
    packing = pm.random_packing(
        MANY[dimension], dimension=dimension, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=fraction, seed=2
    )
    return pm.Scene(packing, effects)


def outcome_of(scene, threads, **settings):
    """Return all that threads must not change."""
    run = pm.quench(scene, threads=threads, check=False, **settings)
    energy = pm.energy(scene.replace(packing=run.packing))
    return run.packing.position_nd.tobytes(), energy, run.residual, run.steps, run.force_evaluations, run.outcome


def test_the_scenes_of_these_tests_have_several_blocks():
    assert [len(build_program(random_scene(d)).pairs.row_b) - 1 for d in (2, 3)] == [7, 4]


@pytest.mark.parametrize("method", [pm.Fire(), pm.Fire2()], ids=["fire", "fire2"])
@pytest.mark.parametrize("dimension", [2, 3])
def test_any_number_of_threads_gives_the_same_bits(dimension, method):
    settings = {"force_tolerance": 1e-4, "method": method, "step_limit": 150}
    one, *more = (outcome_of(random_scene(dimension), threads, **settings) for threads in (1, 2, 3))
    assert one == more[0] == more[1]


def test_what_acts_on_single_particles_acts_in_threads_too():
    held = pm.FixedParticles(range(0, MANY[2], 50))
    scene = random_scene(2, (*REPULSION, pm.Gravity(y=-1e-3), held))
    one, two = (outcome_of(scene, threads, force_tolerance=1e-3, step_limit=100) for threads in (1, 2))
    assert one == two


def test_the_default_route_to_a_minimum_takes_threads():
    one, two = (outcome_of(random_scene(), threads, force_tolerance=1e-10) for threads in (1, 2))
    assert one == two and one[-1] is pm.Outcome.CONVERGED


def test_more_threads_than_blocks_give_the_same_bits():
    one, nine = (outcome_of(random_scene(), threads, force_tolerance=1e-2, step_limit=20) for threads in (1, 9))
    assert one == nine


@functools.cache
def near_minimum(dimension):
    """Return a scene whose particles were moved off a minimum by little."""
    scene = random_scene(dimension)
    packing = pm.quench(scene, force_tolerance=1e-12).packing
    move = 1e-5 * np.random.default_rng(4).standard_normal(packing.position_nd.shape)
    return scene.replace(packing=packing.replace(position_nd=packing.position_nd + move))


@pytest.mark.parametrize("dimension", [2, 3])
def test_blocks_change_forces_and_minimum_by_rounding_only(dimension, monkeypatch):
    scene = near_minimum(dimension)
    blocks, found = build_program(scene), pm.quench(scene, force_tolerance=1e-12)
    monkeypatch.setattr(programs, "_BLOCK", 10**9)
    whole, expected = build_program(scene), pm.quench(scene, force_tolerance=1e-12)
    assert len(whole.pairs.row_b) == 2 < len(blocks.pairs.row_b)
    force, other = blocks.evaluate(), whole.evaluate()
    # forces of pairs are the same bits; sums of z of them in two orders differ by up to 2 (z - 1) eps times their sizes
    contacts = pm.find_contacts(scene.packing)
    most = int(contacts.count_n().max())
    atol = 2.0 * (most - 1) * np.finfo(float).eps * most * other.mean_force
    np.testing.assert_allclose(force.force_nd, other.force_nd, rtol=0.0, atol=atol)
    assert force.contacts == other.contacts and math.isclose(force.energy, other.energy, rel_tol=1e-13)
    # what is left of net forces moves particles against the softest mode
    at_rest = scene.replace(packing=expected.packing.replace(mass_n=np.ones(MANY[dimension])))
    softest = pm.normal_modes(at_rest, count=1).eigenvalue_m[0]
    left = (found.residual + expected.residual) * other.mean_force * math.sqrt(MANY[dimension])
    np.testing.assert_allclose(found.packing.position_nd, expected.packing.position_nd, rtol=0.0, atol=left / softest)


@pytest.mark.parametrize("method", [pm.LBFGS(), pm.ConjugateGradient(), pm.GradientDescent()])
def test_other_minimizers_walk_the_blocks_on_one_thread(method, monkeypatch):
    scene = near_minimum(2)
    found = pm.quench(scene, force_tolerance=1e-6, method=method, threads=2)
    monkeypatch.setattr(programs, "_BLOCK", 10**9)
    expected = pm.quench(scene, force_tolerance=1e-6, method=method)
    # the same path to rounding, which a hundred steps that do not amplify it take to some 1e-11
    np.testing.assert_allclose(found.packing.position_nd, expected.packing.position_nd, rtol=0.0, atol=1e-9)


def test_scenes_that_one_thread_walks_have_one_block():
    discs = random_scene().packing
    ellipses = pm.random_packing(300, dimension=2, shapes=pm.Ellipses(aspect=1.5), packing_fraction=0.7, seed=1)
    attracting = (*REPULSION, pm.ShortRangeAttraction(width=0.1))
    scenes = pm.Scene(ellipses, REPULSION), pm.Scene(discs, attracting)
    assert [len(build_program(scene).pairs.row_b) - 1 for scene in scenes] == [1, 1]


def test_a_time_limit_leaves_a_packing_that_any_number_of_threads_goes_on_from():
    scene = random_scene()
    with pytest.raises(pm.NotConverged) as stop:
        pm.quench(scene, force_tolerance=1e-14, method=pm.Fire(), threads=2, time_limit=1e-3)
    run = stop.value.run
    assert run.outcome is pm.Outcome.TIME_LIMIT and np.isfinite(run.packing.position_nd).all()
    assert pm.quench(scene.replace(packing=run.packing), force_tolerance=1e-3, threads=2).ok


def test_an_interrupt_carries_the_packing_reached_so_far():
    def stop(stage, figures):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as stopped:
        pm.quench(random_scene(), force_tolerance=1e-12, method=pm.Fire(), threads=2, progress=stop)
    run = stopped.value.run
    assert run.outcome is pm.Outcome.INTERRUPTED and run.steps > 0
    assert np.isfinite(run.packing.position_nd).all()


@pm.law
class FailingLaw(NamedTuple):
    """The harmonic law, which fails for pairs of one contact distance."""

    energy_scale: float = 1.0
    forbidden: float = 0.0

    def energy(self, distance: float, contact_distance: float) -> float:
        """Return the energy."""
        return 0.5 * (contact_distance - distance) ** 2

    def first(self, distance: float, contact_distance: float) -> float:
        """Return du/dr."""
        if contact_distance == self.forbidden:
            raise ValueError("this pair has no law")
        return distance - contact_distance

    def second(self, distance: float, contact_distance: float) -> float:
        """Return d2u/dr2."""
        return 1.0


@kernel
def meet_or_fail(thread, times, failing):
    """Meet the others so many times, or fail half way where one's bit is set; return how often they met."""
    for k in range(times):
        if some_failed(thread):
            return k
        if failing >> thread.rank & 1 and k == times // 2:
            raise ValueError("failed")
        wait(thread)
    return times


@pytest.mark.parametrize("failing", [0b001, 0b010, 0b100, 0b011, 0b110, 0b111])
def test_nobody_waits_for_a_thread_that_failed_and_its_error_is_raised(failing):
    before = threading.active_count()
    with pytest.raises(ValueError, match="failed"):
        run_together(lambda thread: meet_or_fail(thread, 1000, failing), 3)
    assert threading.active_count() == before
    assert run_together(lambda thread: meet_or_fail(thread, 1000, 0), 3) == 1000


def test_threads_that_cannot_be_started_leave_none_waiting(monkeypatch):
    start, started = threading.Thread.start, []

    def one_of_two(thread):
        if started:
            raise RuntimeError("can't start new thread")
        started.append(thread)
        start(thread)

    monkeypatch.setattr(threading.Thread, "start", one_of_two)
    with pytest.raises(RuntimeError, match="can't start"):
        run_together(lambda thread: meet_or_fail(thread, 1000, 0), 3)
    assert not started[0].is_alive()


def test_the_error_of_a_law_in_one_thread_ends_all():
    scene = random_scene()
    scene = scene.replace(effects=(pm.Repulsion(law=FailingLaw()),))
    program = build_program(scene, threads=2)
    progress = pm.Fire().start(program)
    assert pm.Fire().advance(program, Goal(1e-9, 0.0), progress, 3) == 0
    # a touching pair of rows of the second thread
    i, j, _ = listed_pairs(program.pairs)
    radius = program.row[:, 3]
    radius[i[-1]] *= 1.0 + 1e-9
    program.effects = (pm.Repulsion(law=FailingLaw(forbidden=radius[i[-1]] + radius[j[-1]])),)
    with pytest.raises(ValueError, match="this pair has no law"):
        pm.Fire().advance(program, Goal(1e-9, 0.0), progress, 100)
