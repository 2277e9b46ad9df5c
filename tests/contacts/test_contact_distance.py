"""Facts about ellipses and spheroids that touch: stored vectors of 50 digits, closed forms, identities, bisection.

golden/jammed_systems holds pairs whose contact distances, forces, torques and Hessians were computed with 50 digits;
each file says by which conventions.
"""

import functools
import gzip
import json
import pathlib

import numpy as np
import pytest

import packmech as pm
from packmech.contacts.scaled_contact import scaled_contacts

GOLDEN = pathlib.Path(__file__).parent.parent / "golden" / "jammed_systems"
FILES = {2: "ellipse_pairs_2d", 3: "spheroid_pairs_3d"}
LEVELS = {"exact": "sigma", "gaussian": "sigma_gauss", "linear": "sigma_linear", "quadratic": "sigma_quadratic"}
POTENTIALS = {
    "spring2": lambda s: (-(1.0 - s), np.ones_like(s)),
    "hertz2.5": lambda s: (-((1.0 - s) ** 1.5), 1.5 * (1.0 - s) ** 0.5),
    "rlj": lambda s: (-12.0 * s**-7 * np.expm1(-6.0 * np.log(s)), 156.0 * s**-14 - 84.0 * s**-8),
}


def between(vector, radius, aspect, director, **named):
    """Return contact distances of particles given by their radii and aspects."""
    radius, aspect, director = (np.asarray(one, dtype=float) for one in (radius, aspect, director))
    across = radius / aspect ** (1.0 / np.shape(vector)[1])
    axes = np.stack([aspect * across, across], axis=2)
    return pm.contact_distance(vector, axes[:, 0], director[:, 0], axes[:, 1], director[:, 1], **named)


@functools.cache
def stored(d):
    """Return the pairs of a file, and what `between` takes of them."""
    with gzip.open(GOLDEN / f"{FILES[d]}.json.gz") as file:
        pairs = json.load(file)["pairs"]
    ai, bi, aj, bj = (np.array([one[key] for one in pairs]) for key in ("a_i", "b_i", "a_j", "b_j"))
    radius = np.stack([(ai * bi ** (d - 1)) ** (1 / d), (aj * bj ** (d - 1)) ** (1 / d)], axis=1)
    if d == 2:
        angle = np.array([[one["theta_i"], one["theta_j"]] for one in pairs])
        director = np.stack([np.cos(angle), np.sin(angle)], axis=2)
    else:
        director = np.array([[one["mu_i_raw"], one["mu_j_raw"]] for one in pairs])
        director /= np.sqrt((director**2).sum(axis=2, keepdims=True))
    vector = np.array([one["r"] for one in pairs])
    return pairs, (vector, radius, np.stack([ai / bi, aj / bj], axis=1), director)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("level", LEVELS)
def test_distances_match_the_stored_ones_to_1e_14(d, level):
    pairs, given = stored(d)
    found = between(*given, level=level)
    expected = np.array([np.nan if one.get(LEVELS[level]) is None else one[LEVELS[level]] for one in pairs], float)
    known = np.isfinite(expected)
    assert known.sum() > 30
    assert np.abs(found[known] / expected[known] - 1.0).max() < 1e-14
    # a step that leads out of the range finds no contact
    assert d == 3 or np.array_equal(np.isinf(found), ~known)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("potential", POTENTIALS)
def test_forces_torques_and_second_derivatives_match_the_stored_ones(d, potential):
    pairs, given = stored(d)
    touching = np.flatnonzero([one["r_over_sigma"] < 1.0 for one in pairs])
    found = scaled_contacts(*(part[touching] for part in given), second=True)
    first, second = POTENTIALS[potential](found.scale_p)
    assert np.abs(found.scale_p / [pairs[k]["r_over_sigma"] for k in touching] - 1.0).max() < 1e-14
    assert np.abs(found.parameter_p / [pairs[k]["lam"] for k in touching] - 1.0).max() < 1e-13
    hessians = 0
    for k, at in enumerate(touching):
        one = pairs[at]["pot"][potential]
        expected = np.hstack([one["force_on_j"], one["torque_i"], one["torque_j"]])
        pull = -first[k] * found.first_px[k]
        # where shapes only just touch, what rounding leaves of 1 - s
        digits = max(1e-10, 1e-15 / (1.0 - pairs[at]["r_over_sigma"]))
        assert np.abs(pull - expected).max() < digits * np.abs(expected).max()
        if "hessian" in one:
            hessians += 1
            slope = found.first_px[k]
            whole = second[k] * np.outer(slope, slope) + first[k] * found.second_pxx[k]
            assert np.abs(whole - one["hessian"]).max() < 1e-9 * np.abs(one["hessian"]).max()
    assert hessians > 5


def drawn(d, count, seed):
    """Return pairs of any sizes and aspects at any angles."""
    rng = np.random.default_rng(seed)
    director = rng.normal(size=(count, 2, d))
    director /= np.sqrt((director**2).sum(axis=2, keepdims=True))
    sizes, aspects = 10.0 ** rng.uniform(-1, 1, (count, 2)), 10.0 ** rng.uniform(-2, 2, (count, 2))
    return rng.normal(size=(count, d)), sizes, aspects, director


def bisected(vector, radius, aspect, director):
    """Return distances by 200 halvings of the stationarity condition with matrices, in 80-bit numbers."""
    wide = np.longdouble
    d = vector.shape[1]
    normal = (vector / np.sqrt((vector**2).sum(axis=1, keepdims=True))).astype(wide)
    b = radius.astype(wide) / aspect.astype(wide) ** (wide(1) / d)
    a = aspect * b
    mu = director.astype(wide)
    # rounding of a director's length is a part of the difference of squares in a flat shape
    mu = mu / np.sqrt((mu**2).sum(axis=2, keepdims=True))
    shape = (b**2)[..., None, None] * np.eye(d, dtype=wide)
    shape = shape + (a**2 - b**2)[..., None, None] * mu[..., :, None] * mu[..., None, :]

    def solved(at):
        c = (1 - at)[:, None, None] * shape[:, 0] + at[:, None, None] * shape[:, 1]
        if d == 2:
            det = c[:, 0, 0] * c[:, 1, 1] - c[:, 0, 1] ** 2
            w = np.stack([c[:, 1, 1] * normal[:, 0] - c[:, 0, 1] * normal[:, 1],
                          c[:, 0, 0] * normal[:, 1] - c[:, 0, 1] * normal[:, 0]], axis=1)  # fmt: skip
            return w / det[:, None]
        rows = np.stack([np.cross(c[:, 1], c[:, 2]), np.cross(c[:, 2], c[:, 0]), np.cross(c[:, 0], c[:, 1])], axis=1)
        det = (c[:, 0] * rows[:, 0]).sum(axis=1)
        return (rows * normal[:, None]).sum(axis=2) / det[:, None]

    low, high = np.zeros(len(vector), wide), np.ones(len(vector), wide)
    for _ in range(80):
        at = (low + high) / 2
        w = solved(at)
        pull = [np.einsum("pa,pab,pb->p", w, shape[:, k], w) for k in (0, 1)]
        below = (1 - at) ** 2 * pull[0] > at**2 * pull[1]
        low, high = np.where(below, at, low), np.where(below, high, at)
    at = (low + high) / 2
    return 1 / np.sqrt(at * (1 - at) * (normal * solved(at)).sum(axis=1))


@pytest.mark.parametrize("d", [2, 3])
def test_random_pairs_of_extreme_shapes_agree_with_bisection_to_1e_12(d):
    given = drawn(d, 4000, d)
    error = np.abs(between(*given) / bisected(*given) - 1.0)
    assert error.max() < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("d", [2, 3])
def test_a_million_random_pairs_agree_with_bisection_to_1e_12(d):
    for seed in range(10):
        given = drawn(d, 100_000, 100 + seed)
        assert np.abs(between(*given) / bisected(*given) - 1.0).max() < 1e-12


def test_rough_levels_overestimate_and_the_middle_by_no_more_than_a_root_of_two():
    for d in (2, 3):
        given = drawn(d, 2000, 9)
        exact = between(*given)
        for level in ("gaussian", "linear", "quadratic"):
            assert (between(*given, level=level) >= exact * (1.0 - 1e-12)).all()
        assert (between(*given, level="gaussian") <= exact * np.sqrt(2.0) * (1.0 + 1e-12)).all()


def test_closed_forms():
    along, across = [1.0, 0.0], [0.0, 1.0]
    # a and b from the disc of equal area: b = r / sqrt(aspect)
    b = 0.5 / np.sqrt(3.0)
    cases = [([[along, along]], 6.0 * b), ([[across, across]], 2.0 * b), ([[along, across]], 4.0 * b)]
    for directors, expected in cases:
        found = between([[2.0, 0.0]], [[0.5, 0.5]], [[3.0, 3.0]], directors)
        assert found[0] == pytest.approx(expected, rel=1e-15)
    turned = [[[0.6, 0.8, 0.0], [0.0, 0.6, 0.8]]]
    assert between([[1.0, 2.0, 3.0]], [[0.3, 0.9]], [[1.0, 1.0]], turned)[0] == pytest.approx(1.2, rel=1e-15)


@pytest.mark.parametrize("d", [2, 3])
def test_forces_balance_torques_and_swapping_the_pair_changes_signs_only(d):
    vector, radius, aspect, director = drawn(d, 500, 3)
    found = scaled_contacts(vector, radius, aspect, director)
    turns = 1 if d == 2 else 3
    pull, ti, tj = np.split(found.first_px, [d, d + turns], axis=1)
    # the whole pair can be turned freely, and growing by a factor makes the scale grow by it
    around = np.cross(vector, pull).reshape(-1, turns)
    size = np.abs(found.first_px).max(axis=1)
    assert (np.abs(around + ti + tj).max(axis=1) < 1e-9 * size * (1.0 + np.abs(vector).max(axis=1))).all()
    assert np.abs((vector * pull).sum(axis=1) / found.scale_p - 1.0).max() < 1e-9
    swapped = scaled_contacts(-vector, radius[:, ::-1].copy(), aspect[:, ::-1].copy(), director[:, ::-1].copy())
    assert np.abs(swapped.scale_p / found.scale_p - 1.0).max() < 1e-12
    expected = np.concatenate([-pull, tj, ti], axis=1)
    assert (np.abs(swapped.first_px - expected).max(axis=1) < 1e-8 * size).all()


@pytest.mark.parametrize("d", [2, 3])
def test_derivatives_are_those_of_differences(d):
    rng = np.random.default_rng(4)
    count = 20
    vector, _, _, director = drawn(d, count, 5)
    radius, aspect = rng.uniform(0.4, 0.8, (count, 2)), rng.uniform(0.4, 2.5, (count, 2))
    found = scaled_contacts(vector, radius, aspect, director, second=True)
    size, step = found.first_px.shape[1], 1e-5

    def moved(axis, by):
        at, mu = vector.copy(), director.copy()
        if axis < d:
            at[:, axis] += by
            return scaled_contacts(at, radius, aspect, mu)
        turns = 1 if d == 2 else 3
        k, about = divmod(axis - d, turns)
        one = mu[:, k]
        if d == 2:
            mu[:, k] = one * np.cos(by) + np.stack([-one[:, 1], one[:, 0]], axis=1) * np.sin(by)
        else:
            i, j = (about + 1) % 3, (about + 2) % 3
            mu[:, k, i], mu[:, k, j] = (
                np.cos(by) * director[:, k, i] - np.sin(by) * director[:, k, j],
                np.sin(by) * director[:, k, i] + np.cos(by) * director[:, k, j],
            )
        return scaled_contacts(at, radius, aspect, mu)

    for axis in range(size):
        plus, minus = moved(axis, step), moved(axis, -step)
        slope = (plus.scale_p - minus.scale_p) / (2.0 * step)
        assert np.abs(slope - found.first_px[:, axis]).max() < 1e-8 * np.abs(found.first_px).max()
        # a difference of gradients holds half of what turns do not commute by, with the torque
        change = (plus.first_px - minus.first_px) / (2.0 * step)
        part = slice(0, d) if d == 3 and axis >= d else slice(None)
        assert np.abs(change - found.second_pxx[:, axis])[:, part].max() < 1e-6 * np.abs(found.second_pxx).max()


def test_a_guess_changes_no_digits_that_count():
    given = drawn(2, 500, 6)
    found = scaled_contacts(*given)
    again = scaled_contacts(*given, guess_p=found.parameter_p)
    assert np.abs(again.scale_p / found.scale_p - 1.0).max() < 1e-13


def test_arguments_are_checked():
    good = [[1.0, 0.0]], [[0.7, 0.35]], [[1.0, 0.0]], [[0.7, 0.35]], [[0.0, 1.0]]
    for place, bad, what in (
        (0, [[0.0, 0.0]], "vector_cd must have a direction, got zeros for pair 0"),
        (0, [[1.0]], "vector_cd must have shape"),
        (1, [[0.5, 0.0]], "semi_axes_i_ck must"),
        (3, [[2.0, -1.0]], "semi_axes_j_ck must"),
        (4, [[0.0, 0.0]], "director_j_cd must have a direction"),
    ):
        given = list(good)
        given[place] = bad
        with pytest.raises(ValueError, match=what):
            pm.contact_distance(*given)
    with pytest.raises(ValueError, match="level must be one of"):
        pm.contact_distance(*good, level="cubic")
