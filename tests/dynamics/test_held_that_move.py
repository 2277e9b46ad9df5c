"""Facts about particles that are held and moved: what they do work on, and what refuses them."""

import numpy as np
import pytest

import packmech as pm
from packmech.view.drawing import draw_packing
from packmech.view.report import examine

STIFFNESS = 2.0


def line(count=4, gap=0.0, velocity=(0.0, 0.0), *more):
    """Return a row of discs along x between two that are held, the first of which moves."""
    place = [(2.0 + (1.0 + gap) * k, 2.0) for k in range(count)]
    packing = pm.Packing(place, np.full(count, 0.5), pm.Box(np.diag([count + 8.0, 4.0])))
    effects = (
        pm.Repulsion(pm.LinearSpring(STIFFNESS)),
        pm.FixedParticles((0,), velocity),
        pm.FixedParticles((count - 1,)),
        *more,
    )
    return pm.Scene(packing, effects)


def test_they_go_on_at_their_velocity_whatever_pushes_them():
    run = pm.simulate(line(velocity=(1e-3, 2e-3)), duration=20.0, dt=0.05)
    moved = run.packing.position_nd - line().packing.position_nd
    assert np.abs(moved[0] - (20e-3, 40e-3)).max() < 400 * 2.0**-53 * 8.0 and not moved[-1].any()
    assert np.array_equal(run.velocity_nd[0], (1e-3, 2e-3))


def test_energy_grows_by_their_work_along_a_slow_press():
    """Between held ends n springs in a row take x^2 k / (2 n): pressed slowly, all the work there is."""
    scene = line(5, 0.0, (1e-5, 0.0), pm.ContactDamping(1.0))
    run = pm.simulate(scene, duration=4000.0)
    pressed = 4000.0 * 1e-5
    assert pm.energy(pm.Scene(run.packing, scene.effects[:1])) == pytest.approx(
        0.5 * STIFFNESS / 4.0 * pressed**2, rel=1e-3
    )


def test_power_is_that_of_the_force_that_holds_them():
    """A lone spring between two held discs: the work is its energy, to rounding, in any frame."""
    packing = pm.Packing([[1.0, 2.0], [2.0, 2.0]], [0.5, 0.5], pm.Box(np.diag([6.0, 4.0])))
    both = (pm.Repulsion(pm.LinearSpring(STIFFNESS)), pm.FixedParticles((0,), (1e-2, 0.0)), pm.FixedParticles((1,)))
    run = pm.simulate(pm.Scene(packing, both), duration=5.0, dt=0.01)
    assert run.ok and pm.energy(pm.Scene(run.packing, both[:1])) == pytest.approx(0.5 * STIFFNESS * 0.05**2, rel=1e-9)


def test_a_run_cut_in_two_ends_with_the_same_bits(tmp_path):
    scene = line(count=6, gap=-0.01, velocity=(1e-3, 0.0))
    whole = pm.simulate(scene, steps=400, dt=0.05)
    pm.simulate(scene, steps=150, dt=0.05, checkpoint=tmp_path / "run.npz")
    rest = pm.resume(tmp_path / "run.npz", scene, steps=400)
    assert np.array_equal(whole.packing.position_nd, rest.packing.position_nd)


def test_a_hopper_at_rest_has_a_residual_without_the_force_on_what_holds():
    rng = np.random.default_rng(1)
    floor = np.column_stack([np.arange(6) + 0.5, np.full(6, 1.0)])
    grain = np.column_stack([np.arange(5) + 1.0, np.full(5, 1.95)]) + rng.uniform(-0.02, 0.02, (5, 2))
    packing = pm.Packing(np.concatenate([floor, grain]), np.full(11, 0.5), pm.Box(np.diag([6.0, 8.0])))
    effects = (pm.Repulsion(), pm.Gravity(y=-1e-3), pm.FixedParticles(tuple(range(6))), pm.BackgroundDamping(0.2))
    run = pm.simulate(pm.Scene(packing, effects), duration=400.0)
    assert run.residual < 1e-6
    assert np.abs(pm.forces(pm.Scene(run.packing, effects[:3]))).max() < 1e-6


def test_nothing_is_at_rest_where_they_move():
    scene = line(velocity=(1e-3, 0.0))
    for call in (lambda: pm.quench(scene, force_tolerance=1e-6), lambda: pm.hessian(scene), lambda: pm.forces(scene)):
        with pytest.raises(ValueError, match="got FixedParticles at 1"):
            call()
    pm.forces(line())


def test_velocities_are_checked():
    for velocity in ((1.0,), (1.0, 0.0, 0.0)):
        with pytest.raises(ValueError, match="velocity must have 2 numbers"):
            pm.simulate(line(velocity=velocity), steps=1, dt=0.1)
    scene = line(4, 0.0, (1.0, 0.0), pm.FixedParticles((0, 1)))
    with pytest.raises(ValueError, match="must be held by nothing else"):
        pm.simulate(scene, steps=1, dt=0.1)
    with pytest.raises(ValueError, match="velocity"):
        pm.FixedParticles((0,), (np.nan, 0.0))


@pytest.mark.parametrize("d", [2, 3])
def test_two_that_are_held_do_not_push_each_other_however_they_overlap(d):
    place = np.full((4, d), 2.0)
    place[:, 0] = [1.0, 1.7, 2.6, 3.5]
    packing = pm.Packing(place, [0.5] * 4, pm.Box.cubic(8.0, d))
    scene = pm.Scene(packing, (pm.Repulsion(), pm.FixedParticles((0, 1))))
    # pairs 1-2 and 2-3 overlap by .1 and balance on 2; 3 is pushed away
    found = pm.contact_forces(scene)
    assert found.contacts.i_c.tolist() == [1, 2] and found.normal_c == pytest.approx(0.1)
    assert pm.energy(scene) == pytest.approx(2 * 0.005)
    assert pm.stress_tensor(scene)[0, 0] == pytest.approx(-2 * 0.1 * 0.9 / packing.box.volume)
    run = pm.simulate(scene, steps=1, dt=1e-6, trace_every=1)
    assert run.trace.contacts_t[0] == 2 and run.trace.energy_t[0] == pytest.approx(0.01)
    for method in (None, pm.Newton()):
        at_rest = pm.quench(scene, force_tolerance=1e-9, method=method)
        assert at_rest.outcome is pm.Outcome.UNJAMMED and at_rest.packing.position_nd[:2] == pytest.approx(place[:2])
    # what is printed and drawn
    assert examine(scene, modes=0).numbers["largest_overlap"] == pytest.approx(0.1)
    assert draw_packing(packing, scene.effects).force_s == pytest.approx([1.0, 1.0])
