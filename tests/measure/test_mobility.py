"""Displacements against time: straight lines, random walks, sheared boxes, and a plain loop."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import quad

import packmech as pm


def walk(frames, dimension, seed, particles=30, size=0.1, gradient=None):
    """Return packings of a random walk in a box that deforms with every frame, and box and places of each."""
    rng = np.random.default_rng(seed)
    box = pm.Box(4.0 * np.eye(dimension) + 0.3 * rng.standard_normal((dimension, dimension)))
    fraction = rng.random((particles, dimension))
    path = []
    for t in range(frames):
        here = box if gradient is None else box.strained(t * np.asarray(gradient))
        path.append((here, fraction.copy()))
        fraction += size * rng.standard_normal((particles, dimension)) @ np.linalg.inv(here.lattice_dd).T
    packings = [pm.Packing((s - np.floor(s)) @ here.lattice_dd.T, np.full(particles, 0.2), here) for here, s in path]
    return packings, path


@pytest.mark.parametrize("dimension", [2, 3])
def test_mean_squares_are_those_of_a_plain_loop_in_a_box_that_shears(dimension):
    gradient = np.zeros((dimension, dimension))
    gradient[0, 1] = 0.02
    packings, path = walk(12, dimension, 1, gradient=gradient)
    found = pm.mean_square_displacement(packings, time_t=0.5 * np.arange(12), lags=[1, 3, 8])
    scattered = pm.self_scattering(packings, 2.0, lags=[1, 3, 8])
    for k, lag in enumerate((1, 3, 8)):
        squares, fourths, phases = [], [], []
        for t in range(12 - lag):
            here, s = path[t + lag]
            for n in range(30):
                u = here.lattice_dd @ (s[n] - path[t][1][n])
                squares.append(u @ u)
                fourths.append((u @ u) ** 2)
                phases.append(2.0 * np.linalg.norm(u))
        assert found.time_l[k] == pytest.approx(0.5 * lag, rel=1e-12)
        assert found.msd_l[k] == pytest.approx(np.mean(squares), rel=1e-12)
        assert found.starts_l[k] == 12 - lag
        broad = dimension * np.mean(fourths) / ((dimension + 2) * np.mean(squares) ** 2) - 1.0
        assert found.non_gaussian_l[k] == pytest.approx(broad, abs=1e-12)
        # the average over directions by quadrature
        if dimension == 2:
            mean = [quad(lambda a, x=x: np.cos(x * np.cos(a)), 0.0, np.pi)[0] / np.pi for x in phases]
        else:
            mean = [quad(lambda c, x=x: np.cos(x * c), -1.0, 1.0)[0] / 2.0 for x in phases]
        assert scattered.f_l[k] == pytest.approx(np.mean(mean), rel=1e-10)


def test_a_random_walk_diffuses_and_is_gaussian():
    packings, _ = walk(400, 2, 2, particles=200, size=0.05)
    found = pm.mean_square_displacement(packings, lags=[1, 10, 100])
    # each step has the mean square d size^2, so that it diffuses with size^2 / 2, to the errors that are told
    error_l = found.error_l / (4.0 * found.time_l)
    assert (np.abs(found.diffusion_l - 0.5 * 0.05**2) < 4.0 * error_l).all()
    assert abs(found.non_gaussian_l[0]) < 0.02
    k = 4.0
    expected = np.exp(-(k**2) * 0.05**2 * found.time_l / 2.0)
    scattered = pm.self_scattering(packings, k, lags=[1, 10, 100])
    assert (np.abs(scattered.f_l - expected) < 4.0 * scattered.error_l).all()


def test_a_common_drift_is_taken_out_where_that_is_asked_for():
    packings, path = walk(10, 3, 3)
    moving = [
        pm.Packing((s + [0.03 * t, 0.0, 0.0]) @ here.lattice_dd.T, np.full(30, 0.2), here)
        for t, (here, s) in enumerate(path)
    ]
    still = pm.mean_square_displacement(packings, lags=[2, 5], remove_drift=True)
    found = pm.mean_square_displacement(moving, lags=[2, 5], remove_drift=True)
    np.testing.assert_allclose(found.msd_l, still.msd_l, rtol=1e-11)
    assert (pm.mean_square_displacement(moving, lags=[2, 5]).msd_l > found.msd_l).all()


def test_the_relaxation_time_is_that_of_an_exponential():
    time = np.geomspace(0.1, 100.0, 200)
    one = pm.SelfScattering(time, np.exp(-time / 7.0), np.zeros(200), 1.0)
    # in the logarithm of time its curvature vanishes there: lines between points a step h apart err by h^3 / 8 at most
    h = np.log(1000.0) / 199.0
    assert one.relaxation_time == pytest.approx(7.0, rel=h**3 / 8.0)
    assert pm.SelfScattering(time[:10], np.exp(-time[:10] / 7.0), np.zeros(10), 1.0).relaxation_time == np.inf


def test_particles_that_fly_freely_go_as_far_as_their_speed_takes_them_in_runs():
    """A run's positions are never wrapped: frames may be farther apart than half of the box."""
    two = pm.Packing([[1.0, 1.0], [1.0, 3.0]], [0.3, 0.3], pm.Box.cubic(4.0, 2))
    run = pm.simulate(
        pm.Scene(two, (pm.Repulsion(),)),
        steps=400,
        dt=0.02,
        velocity_nd=[[1.5, 0.0], [-1.5, 0.0]],
        trace_every=100,
        trace_positions=True,
    )
    found = pm.mean_square_displacement(run, lags=[1, 2, 3])
    np.testing.assert_allclose(found.msd_l, (1.5 * found.time_l) ** 2, rtol=1e-12)
    np.testing.assert_allclose(found.time_l, [2.0, 4.0, 6.0], rtol=1e-12)
    one = pm.mean_square_displacement(run, lags=[1], particles=[1])
    assert one.msd_l[0] == pytest.approx(9.0, rel=1e-12) and np.isnan(one.error_l[0])


def test_what_is_no_trajectory_is_refused():
    packings, _ = walk(4, 2, 4)
    with pytest.raises(TypeError, match="frames must be a run that kept positions"):
        pm.mean_square_displacement(packings[0])
    with pytest.raises(ValueError, match="evenly spaced in time"):
        pm.mean_square_displacement(packings, time_t=[0.0, 1.0, 2.0, 4.0])
    with pytest.raises(ValueError, match="lags must be"):
        pm.mean_square_displacement(packings, lags=[4])
    with pytest.raises(ValueError, match="particles must be numbers below 30"):
        pm.mean_square_displacement(packings, particles=[30])
    with pytest.raises(ValueError, match="wave_number must be"):
        pm.self_scattering(packings, 0.0)


def test_the_end_of_a_run_that_falls_between_two_frames_is_left_out():
    packing = pm.lattice_packing("square", repeats=(3, 3))
    scene = pm.Scene(packing, (pm.Repulsion(),))
    whole, longer = (
        pm.simulate(scene, steps=steps, dt=0.01, temperature=1e-3, seed=1, trace_every=20, trace_positions=True)
        for steps in (100, 110)
    )
    assert len(longer.trace.time_t) == len(whole.trace.time_t) + 1
    one, other = map(pm.mean_square_displacement, (whole, longer))
    assert one.time_l.tolist() == other.time_l.tolist()
    assert one.msd_l.tolist() == other.msd_l.tolist()
