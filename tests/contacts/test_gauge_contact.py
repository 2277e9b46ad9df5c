"""Facts about the scale at which superellipsoids touch: bounds from both sides, an optimizer, closed forms, slopes."""

import numpy as np
import pytest
from scipy.optimize import minimize
from scipy.spatial.transform import Rotation

from packmech.contacts.gauge_contact import gauge_contacts
from packmech.contacts.scaled_contact import scaled_contacts


def pairs(d, count, seed=1, exponents=(2.0, 10.0), aspect=5.0, turned=10.0):
    """Return vectors, semi-axes, exponents and frames of pairs at random, frames turned by vectors of this size."""
    rng = np.random.default_rng(seed)
    rotation = turned * rng.normal(size=(2 * count, 3))
    rotation[:, :2] *= d == 3
    frame = Rotation.from_rotvec(rotation).as_matrix()[:, :d, :d].reshape(count, 2, d, d)
    semi = np.exp(rng.uniform(0.0, np.log(aspect), (count, 2, d)))
    return rng.normal(size=(count, d)), semi, rng.uniform(*exponents, (count, 2)), frame


def gauges(point, semi, exponent, frame):
    """Return the gauges of bodies at points, written out without care for overflow."""
    along = np.abs(np.einsum("pab,pa->pb", frame, point)) / semi
    return (along ** exponent[:, None]).sum(axis=1) ** (1.0 / exponent)


def supports(normal, semi, exponent, frame):
    """Return how far bodies reach along directions: the dual norms."""
    power = exponent / (exponent - 1.0)
    along = np.abs(np.einsum("pab,pa->pb", frame, normal)) * semi
    return (along ** power[:, None]).sum(axis=1) ** (1.0 / power)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("turned", [10.0, 0.0, 1e-9, 1e-3])
def test_a_point_and_a_plane_bound_the_scale_from_both_sides(d, turned):
    """The point of touch lies in both bodies at scale s, and at less the plane across the force keeps them apart."""
    vector, semi, exponent, frame = pairs(d, 400, turned=turned)
    found = gauge_contacts(vector, semi, exponent, frame)
    inside = [gauges(found.point_pd - k * vector, semi[:, k], exponent[:, k], frame[:, k]) for k in (0, 1)]
    normal = found.first_px[:, :d]
    reach = sum(supports(normal, semi[:, k], exponent[:, k], frame[:, k]) for k in (0, 1))
    apart = (normal * vector).sum(axis=1) / reach
    np.testing.assert_allclose(np.maximum(*inside), found.scale_p, rtol=1e-11)
    np.testing.assert_allclose(apart, found.scale_p, rtol=1e-11)


@pytest.mark.parametrize("d", [2, 3])
def test_scales_are_those_of_a_general_optimizer(d):
    vector, semi, exponent, frame = pairs(d, 12, exponents=(2.0, 6.0), aspect=3.0)
    found = gauge_contacts(vector, semi, exponent, frame)
    for p in range(len(vector)):

        def room(z, k, p=p):
            at = (z[:d] - k * vector[p])[None]
            return z[d] - gauges(at, semi[p : p + 1, k], exponent[p : p + 1, k], frame[p : p + 1, k])[0]

        start = np.append(0.5 * vector[p] + 1e-3, 2.0 * np.abs(vector[p]).sum())
        inside = [{"type": "ineq", "fun": room, "args": (k,)} for k in (0, 1)]
        best = minimize(
            lambda z: z[d], start, method="SLSQP", constraints=inside, options={"ftol": 1e-12, "maxiter": 400}
        )
        assert best.success
        assert found.scale_p[p] == pytest.approx(best.fun, rel=1e-7)


@pytest.mark.parametrize("d", [2, 3])
def test_those_of_exponent_two_with_equal_axes_are_spheroids(d):
    vector, _, _, frame = pairs(d, 300)
    rng = np.random.default_rng(2)
    radius, aspect = rng.uniform(0.5, 1.0, (300, 2)), np.exp(rng.uniform(-1.6, 1.6, (300, 2)))
    across = radius / aspect ** (1.0 / d)
    semi = np.stack([aspect * across] + [across] * (d - 1), axis=2)
    found = gauge_contacts(vector, semi, np.full((300, 2), 2.0), frame, second=True)
    known = scaled_contacts(vector, radius, aspect, np.ascontiguousarray(frame[..., 0]), second=True)
    np.testing.assert_allclose(found.scale_p, known.scale_p, rtol=1e-13)
    np.testing.assert_allclose(found.first_px, known.first_px, rtol=0.0, atol=1e-13 * np.abs(known.first_px).max())
    np.testing.assert_allclose(
        found.second_pxx, known.second_pxx, rtol=0.0, atol=1e-11 * np.abs(known.second_pxx).max()
    )


@pytest.mark.parametrize("d", [2, 3])
def test_derivatives_are_differences(d):
    vector, semi, exponent, frame = pairs(d, 300, aspect=3.0, exponents=(2.0, 6.0))
    found = gauge_contacts(vector, semi, exponent, frame, second=True)
    step, t, size = 1e-5, 1 if d == 2 else 3, found.first_px.shape[1]

    def moved(k, by):
        at, turned = vector.copy(), frame.copy()
        if k < d:
            at[:, k] += by
        else:
            side, axis = divmod(k - d, t)
            rotation = np.zeros(3)
            rotation[2 if d == 2 else axis] = by
            turned[:, side] = Rotation.from_rotvec(rotation).as_matrix()[:d, :d] @ turned[:, side]
        return gauge_contacts(at, semi, exponent, turned)

    second = np.empty_like(found.second_pxx)
    for k in range(size):
        ahead, behind = moved(k, step), moved(k, -step)
        first = (ahead.scale_p - behind.scale_p) / (2.0 * step)
        np.testing.assert_allclose(first, found.first_px[:, k], rtol=0.0, atol=1e-7)
        second[:, k] = (ahead.first_px - behind.first_px) / (2.0 * step)
    # slopes along turns of a body that has turned differ by half the commutator of the turns: the rest is symmetric
    second = 0.5 * (second + second.transpose(0, 2, 1))
    # errors of differences grow with derivatives of higher order: of nearly flat contacts they are large
    scale = np.abs(found.second_pxx).max(axis=(1, 2))
    gentle = scale < 5.0
    assert gentle.mean() > 0.8
    error = np.abs(second - found.second_pxx).max(axis=(1, 2)) / scale
    assert np.quantile(error[gentle], 0.9) < 1e-7
    assert error[gentle].max() < 1e-5


def test_squares_and_cubes_face_to_face_touch_at_the_sum_of_their_half_sides():
    for d in (2, 3):
        semi = np.full((1, 2, d), 0.7)
        aside = np.zeros((1, d))
        aside[0, 0], aside[0, 1] = 1.0, 0.05
        for exponent, tolerance in ((4.0, 1e-5), (50.0, 1e-14)):
            found = gauge_contacts(aside, semi, np.full((1, 2), exponent), np.tile(np.eye(d), (1, 2, 1, 1)))
            assert found.scale_p[0] == pytest.approx(1.0 / 1.4, rel=tolerance)


def test_aligned_bodies_of_one_form_touch_as_the_gauge_of_one_says():
    """Two bodies K, aligned, touch as the point r and the body 2 K do."""
    vector, semi, exponent, frame = pairs(3, 100)
    semi[:, 1], exponent[:, 1], frame[:, 1] = semi[:, 0], exponent[:, 0], frame[:, 0]
    found = gauge_contacts(vector, semi, exponent, frame)
    known = gauges(vector, 2.0 * semi[:, 0], exponent[:, 0], frame[:, 0])
    np.testing.assert_allclose(found.scale_p, known, rtol=1e-13)


def test_exchanging_two_bodies_and_turning_both_changes_no_scale():
    vector, semi, exponent, frame = pairs(3, 100)
    found = gauge_contacts(vector, semi, exponent, frame)
    back = gauge_contacts(-vector, semi[:, ::-1], exponent[:, ::-1].copy(), frame[:, ::-1])
    np.testing.assert_allclose(back.scale_p, found.scale_p, rtol=1e-13)
    turn = Rotation.from_rotvec([0.3, -1.1, 0.7]).as_matrix()
    turned = gauge_contacts(vector @ turn.T, semi, exponent, turn @ frame)
    np.testing.assert_allclose(turned.scale_p, found.scale_p, rtol=1e-13)
    # no torque on the pair as a whole
    force, one, other = (found.first_px[:, 3 * k : 3 * k + 3] for k in range(3))
    np.testing.assert_allclose(one + other + np.cross(vector, force), 0.0, atol=1e-12)
