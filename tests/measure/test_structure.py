"""Facts about structure in real space: brute force over images, shells of crystals, decays that are known, freud."""

import numpy as np
import pytest

import packmech as pm


@pytest.mark.parametrize("dimension", [2, 3])
def test_pair_distribution_is_that_of_all_pairs_over_all_images(dimension, scattered, images):
    packing = scattered(dimension)
    found = pm.pair_distribution(packing, r_max=2.9, bins=29)
    distance = np.sqrt((images(packing) ** 2).sum(axis=-1))
    distance[distance == 0.0] = 99.0
    small = packing.radius_n < 0.35
    shell = np.diff(found.edge_b**dimension) * (np.pi if dimension == 2 else 4.0 * np.pi / 3.0)
    count = np.histogram(distance, found.edge_b)[0]
    assert np.array_equal(found.count_b, count)
    np.testing.assert_allclose(found.g_b, count * packing.box.volume / (120.0**2 * shell), rtol=1e-12)
    unlike = np.histogram(distance[small][:, ~small], found.edge_b)[0]
    np.testing.assert_allclose(
        found.partial_ssb[0, 1],
        unlike * packing.box.volume / (small.sum() * (~small).sum() * shell),
        rtol=1e-12,
    )
    share = found.particles_s / 120.0
    assert found.radius_s.tolist() == [0.3, 0.42]
    np.testing.assert_allclose(np.einsum("a,abr,b->r", share, found.partial_ssb, share), found.g_b, rtol=1e-12)


def test_stored_points_have_the_stored_pair_distribution_and_correlations(stored):
    packing, points = stored.packing, stored.points
    found = pm.pair_distribution(packing, r_max=4.0, bins=40)
    np.testing.assert_allclose(found.edge_b, points["g_edges"], atol=1e-14)
    np.testing.assert_allclose(found.g_b, points["g"], rtol=1e-12)
    psi = np.array(points["psi6_re"]) + 1j * np.array(points["psi6_im"])
    both = pm.correlation_function(packing, psi, r_max=points["corr_edges"][-1], bins=20)
    np.testing.assert_allclose(both.value_b, points["corr_complex_re"], atol=1e-12)
    np.testing.assert_allclose(both.magnitude_b, points["corr_magnitude"], atol=1e-12)
    assert both.count_b.tolist() == points["corr_counts"]
    assert both.mean_square == pytest.approx(points["psi6_global"] ** 2, abs=1e-14)


@pytest.mark.parametrize(
    ("kind", "name", "repeats"),
    [("triangular", "hex", 16), ("square", "square", 12), ("honeycomb", "honeycomb", 8), ("sc", "sc", 7),
     ("fcc", "fcc", 7), ("bcc", "bcc8", 7), ("hcp", "hcp", 7)],
)  # fmt: skip
def test_crystals_have_their_shells(kind, name, repeats, lattices):
    """Distances and numbers of neighbors in units of the shortest, counted by a separate program."""
    shells = lattices[name]["shells"]
    dimension = 2 if name in ("hex", "square", "honeycomb") else 3
    crystal = pm.lattice_packing(kind, repeats=(repeats,) * dimension)
    # bins whose edges fall on shells, where rounding decides unless it is taken into account
    found = pm.pair_distribution(crystal, r_max=2.7, bins=270)
    per_particle = found.count_b / crystal.particles
    for distance, count in shells:
        if distance < 2.65:
            b = int(distance * 100 * (1 + 1e-9))
            assert per_particle[b] == count, (distance, per_particle[b])
    assert per_particle.sum() == sum(count for distance, count in shells if distance < 2.7)


def test_a_packing_moved_by_lattice_vectors_in_equivalent_boxes_has_the_same_pairs(scattered):
    packing = scattered(2)
    lattice = packing.box.lattice_dd @ np.array([[1, 1], [0, 1]])
    other = pm.Packing(packing.position_nd, packing.radius_n, pm.Box(lattice))
    assert np.array_equal(pm.pair_distribution(packing, 4.0).count_b, pm.pair_distribution(other, 4.0).count_b)


def repeated(packing, times):
    """Return a packing and its images in a cell that is as many times as long along every vector."""
    d, lattice = packing.dimension, packing.box.lattice_dd
    shift = np.stack(np.meshgrid(*[np.arange(times)] * d, indexing="ij"), axis=-1).reshape(-1, d) @ lattice.T
    place = (packing.position_nd[None] + shift[:, None]).reshape(-1, d)
    return pm.Packing(place, np.tile(packing.radius_n, len(shift)), pm.Box(times * lattice))


@pytest.mark.parametrize("dimension", [2, 3])
def test_beyond_half_the_box_pairs_are_those_of_the_packing_repeated(dimension, scattered):
    packing = scattered(dimension)
    packing = packing.replace(box=pm.Box(packing.box.lattice_dd + 0.8 * np.eye(dimension, k=1)))
    half = 0.5 * packing.box.height_d.min()
    value = np.random.default_rng(3).normal(size=(packing.particles, 2))
    many = repeated(packing, 3)
    whole, part = (pm.pair_distribution(one, r_max=2.7 * half, bins=40) for one in (many, packing))
    assert part.edge_b[-1] > 2.6 * half
    assert np.array_equal(whole.count_ssb, 3**dimension * part.count_ssb)
    np.testing.assert_allclose(part.g_b, whole.g_b, rtol=1e-12)
    np.testing.assert_allclose(part.partial_ssb, whole.partial_ssb, rtol=1e-12)
    whole, part = (
        pm.correlation_function(one, np.tile(value, (one.particles // packing.particles, 1)), r_max=2.7 * half, bins=40)
        for one in (many, packing)
    )
    assert np.array_equal(whole.count_b, 3**dimension * part.count_b)
    np.testing.assert_allclose(part.value_b, whole.value_b, rtol=0, atol=1e-10)
    np.testing.assert_allclose(part.magnitude_b, whole.magnitude_b, rtol=1e-10)


def test_one_particle_is_near_its_own_images():
    alone = pm.Packing([[0.3, 0.2]], [0.5], pm.Box.cubic(1.0, 2))
    found = pm.pair_distribution(alone, r_max=3.0, bins=300)
    # the square lattice's shells: 4 at 1, 4 at sqrt 2, 4 at 2, 8 at sqrt 5
    shells = {1.0: 4, 2.0**0.5: 4, 2.0: 4, 5.0**0.5: 8, 8.0**0.5: 4}
    for distance, count in shells.items():
        assert found.count_b[int(distance * (1.0 + 1e-9) / 0.01)] == count
    assert found.count_b[:-1].sum() == sum(shells.values())


@pytest.mark.parametrize("r_max", [1e3, 1e9, 1e300])
def test_more_pairs_than_fit_are_refused_with_their_number(r_max, scattered):
    with pytest.raises(ValueError, match=r"r_max must be so small that at most 1e\+08 pairs are nearer, .* got 1"):
        pm.pair_distribution(scattered(2), r_max=r_max)


def test_many_sizes_are_one_species(scattered):
    packing = scattered(2).replace(radius_n=np.linspace(0.2, 0.4, 120))
    found = pm.pair_distribution(packing)
    assert found.partial_ssb.shape == (1, 1, 60)
    assert np.array_equal(found.partial_ssb[0, 0], found.g_b)


def test_the_first_minimum_of_a_crystal_lies_between_its_shells_where_there_is_nothing():
    found = pm.pair_distribution(pm.lattice_packing("triangular", repeats=(8, 8)), r_max=3.0, bins=60)
    assert found.peak == pytest.approx(1.025) and 1.05 < found.first_minimum < 1.7
    assert found.translational_order == 0.0 and found.bin_width == 0.05


@pytest.mark.parametrize("dimension", [2, 3])
def test_correlations_are_those_of_all_pairs(dimension, scattered, images):
    packing = scattered(dimension, particles=60)
    value = np.random.default_rng(2).normal(size=(60, 3, 2)) @ np.array([1.0, 1j])
    found = pm.correlation_function(packing, value, r_max=2.9, bins=15)
    distance = np.sqrt((images(packing) ** 2).sum(axis=-1))
    product = (value @ value.conj().T).real[:, :, None] + 0.0 * distance
    for b in range(15):
        inside = (distance >= found.edge_b[b]) & (distance < found.edge_b[b + 1]) & (distance > 0.0)
        assert found.count_b[b] == inside.sum()
        if inside.any():
            assert found.value_b[b] == pytest.approx(product[inside].mean(), abs=1e-12)
    assert found.mean_square == pytest.approx((np.abs(value.mean(axis=0)) ** 2).sum(), rel=1e-12)


def test_a_plane_wave_correlates_as_the_bessel_function(scattered):
    """<exp(i k (x_i - x_j))> over directions is J0(k r); in a crystal without structure within a bin to the noise."""
    from scipy.special import j0

    packing = scattered(2, particles=4000)
    k = 2.0 * np.pi * packing.box.inverse_dd[1]
    found = pm.correlation_function(packing, np.exp(1j * packing.position_nd @ k), r_max=4.0, bins=20)
    away = found.value_b - j0(np.linalg.norm(k) * found.r_b)
    assert np.abs(away * np.sqrt(found.count_b)).max() < 4.0 + 0.02 * np.sqrt(found.count_b.max())


def test_the_length_of_a_decay_is_found_from_its_maxima_above_the_noise():
    r = np.linspace(0.0, 20.0, 2001)
    wave = np.exp(-r / 3.0) * np.cos(2.0 * np.pi * r)
    found = pm.correlation_length(r, wave, np.full(2001, 10**4))
    assert found.length == pytest.approx(3.0, rel=1e-9) and found.amplitude == pytest.approx(1.0, rel=1e-2)
    # maxima below 1/sqrt(pairs) do not count
    assert len(found.r_m) == int(np.floor(3.0 * np.log(100.0)))
    assert np.isnan(pm.correlation_length(r, wave, np.full(2001, 4)).length)
    assert pm.correlation_length(r, wave, np.full(2001, 10**4), r_min=2.5).r_m[0] == pytest.approx(3.0, abs=0.02)


def test_freud_agrees_on_pair_distributions_and_correlations(scattered):
    freud = pytest.importorskip("freud")
    for dimension in (2, 3):
        packing = scattered(dimension)
        lattice = packing.box.lattice_dd
        xy = lattice[0, 1] / lattice[1, 1]
        box = freud.box.Box(lattice[0, 0], lattice[1, 1], xy=xy, is2D=True)
        if dimension == 3:
            box = freud.box.Box(*np.diag(lattice), xy, lattice[0, 2] / lattice[2, 2], lattice[1, 2] / lattice[2, 2])
        place = np.zeros((packing.particles, 3))
        place[:, :dimension] = packing.position_nd
        place = box.wrap(place)
        rdf = freud.density.RDF(bins=29, r_max=2.9).compute((box, place))
        np.testing.assert_allclose(pm.pair_distribution(packing, 2.9, 29).g_b, rdf.rdf, atol=5e-5)
        value = np.exp(1j * np.arange(packing.particles) ** 2)
        other = freud.density.CorrelationFunction(bins=10, r_max=2.9).compute((box, place), value)
        found = pm.correlation_function(packing, value, 2.9, 10)
        np.testing.assert_allclose(found.value_b[3:], other.correlation.real[3:], atol=5e-5)


def test_noise_on_a_wave_has_no_maxima_of_its_own_where_they_are_to_stand_apart():
    r = np.linspace(0.0, 12.5, 626)
    wave = np.exp(-r / 3.0) * (1.0 + np.cos(2.0 * np.pi * r) + 0.05 * (-1.0) ** np.arange(626))
    loose = pm.correlation_length(r, wave, np.full(626, 10**6))
    found = pm.correlation_length(r, wave, np.full(626, 10**6), separation=0.4)
    assert len(loose.r_m) > 40 and found.r_m == pytest.approx(np.arange(1, 13), abs=0.06)
    assert found.length == pytest.approx(3.0, rel=0.01) and loose.error > 5.0 * found.error


def test_maxima_of_noise_do_not_lengthen_a_decay():
    r = np.linspace(0.0, 14.0, 1401)
    noise = 0.002 * np.random.default_rng(1).normal(size=r.size)
    wave = np.exp(-r / 2.0) * np.cos(2.0 * np.pi * r) + noise
    count = np.full(r.size, 10**6)
    found = pm.correlation_length(r, wave, count, noise_b=np.full(r.size, 0.05), separation=0.4)
    # points near a maximum are up to two deviations of the noise too high: .004 / exp(-r / 2) in the logarithms at
    # r = 1 to 6, which takes .0141 off the slope of 1 / 2
    assert found.length == pytest.approx(2.0, abs=1.0 / (0.5 - 0.0141) - 2.0) and len(found.r_m) == 6
    # the line through all maxima is that of the box
    assert pm.correlation_length(r, wave, count, separation=0.4).length > 2.5
    for wrong in (np.zeros(3), np.full(r.size, -1.0)):
        with pytest.raises(ValueError, match="noise_b"):
            pm.correlation_length(r, wave, count, noise_b=wrong)


def test_the_error_of_a_length_holds_the_choice_of_maxima():
    """A decay that slows down, exp(-r / 2) + .02: no one length, and no scatter either."""
    r = np.linspace(0.0, 8.0, 1601)
    wave = (np.exp(-r / 2.0) + 0.02) * np.cos(2.0 * np.pi * r)
    all_, near = (pm.correlation_length(r[:n], wave[:n], np.full(n, 10**8)) for n in (1601, 801))
    assert abs(all_.length - near.length) < 2.0 * all_.error


@pytest.mark.parametrize("separation", [0.0, 0.4])
def test_maxima_in_troughs_do_not_end_a_decay(separation):
    r = np.linspace(0.0, 10.0, 1001)
    wave = np.exp(-r / 2.0) * (np.cos(2.0 * np.pi * r) + 0.6 * np.cos(4.0 * np.pi * r))
    assert pm.correlation_length(r, wave, np.full(1001, 10**6), separation=separation).length == pytest.approx(
        2.0, rel=1e-9
    )


def test_without_a_distance_it_is_what_the_box_allows_and_three_at_most():
    for repeats, expected in (((2, 2), 0.5 * np.sqrt(3.0)), ((3, 3), 0.75 * np.sqrt(3.0)), ((12, 12), 3.0)):
        packing = pm.lattice_packing("triangular", repeats=repeats)
        pairs = pm.pair_distribution(packing)
        values = pm.correlation_function(packing, np.ones(packing.particles))
        assert pairs.edge_b[-1] == pytest.approx(expected, rel=1e-12)
        assert values.edge_b[-1] == pytest.approx(expected, rel=1e-12)
        assert f"up to {expected:.6g}" in repr(pairs)
