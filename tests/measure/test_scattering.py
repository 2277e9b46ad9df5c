"""Facts about structure factors and spectral densities: direct sums, exact form factors, ideal gases, crystals."""

import numpy as np
import pytest
from scipy.special import j1

import packmech as pm


@pytest.mark.parametrize("dimension", [2, 3])
def test_structure_factors_are_direct_sums_in_tilted_boxes(dimension, scattered):
    packing = scattered(dimension)
    index = pm.wave_indices(packing.box, 6.0)
    k = 2.0 * np.pi * index @ np.linalg.inv(packing.box.lattice_dd)
    place, _ = packing.box.wrap(packing.position_nd)
    wave = np.exp(1j * place @ k.T)
    np.testing.assert_allclose(pm.structure_factor(packing, index), np.abs(wave.sum(axis=0)) ** 2 / 120, atol=1e-12)
    parts = pm.partial_structure_factors(packing, index)
    small = packing.radius_n < 0.35
    one, other = wave[small].sum(axis=0), wave[~small].sum(axis=0)
    np.testing.assert_allclose(parts.value_ssk[0, 1], one * other.conj() / 120, atol=1e-12)
    np.testing.assert_allclose(parts.value_ssk.sum(axis=(0, 1)), pm.structure_factor(packing, index), atol=1e-12)


def test_stored_points_have_the_stored_structure_factors(stored):
    np.testing.assert_allclose(
        pm.structure_factor(stored.packing, stored.points["Sk_m"]), stored.points["Sk"], atol=1e-12
    )


@pytest.mark.parametrize("dimension", [2, 3])
def test_wave_indices_are_all_there_are(dimension, scattered):
    box = scattered(dimension).box
    found = pm.wave_indices(box, 4.0)
    grid = np.stack(np.meshgrid(*[np.arange(-15, 16)] * dimension, indexing="ij"), axis=-1).reshape(-1, dimension)
    length = np.linalg.norm(2.0 * np.pi * grid @ np.linalg.inv(box.lattice_dd), axis=1)
    wanted = {tuple(one) for one in grid[(length <= 4.0) & (length > 0.0)].tolist()}
    assert {tuple(one) for one in found.tolist()} == wanted and len(found) == len(wanted)
    sorted_length = np.linalg.norm(pm.wave_vectors(box, found), axis=1)
    assert (np.diff(sorted_length) > -1e-8).all()
    # of a long cell of the same lattice they are the same vectors
    change = np.eye(dimension, dtype=int)
    change[0, 1] = 7
    longer = pm.Box(box.lattice_dd @ change)
    other = pm.wave_vectors(longer, pm.wave_indices(longer, 4.0))
    assert np.abs(np.sort(np.linalg.norm(other, axis=1)) - np.sort(sorted_length)).max() < 1e-9
    half = pm.wave_indices(box, 4.0, half=True)
    assert {tuple(one) for one in np.concatenate([half, -half]).tolist()} == wanted and 2 * len(half) == len(wanted)


def test_phases_of_large_indices_keep_their_digits():
    from fractions import Fraction

    packing = pm.Packing([[0.1, 0.2], [0.7, 0.45]], [0.1, 0.1], pm.Box.cubic(1.0, 2))
    index = np.array([[2**20, -(2**20) + 3]])
    turn = [sum(Fraction(x) * int(m) for x, m in zip(row, index[0], strict=True)) % 1 for row in packing.position_nd]
    phase = 2.0 * np.pi * float(turn[1] - turn[0])
    assert pm.structure_factor(packing, index)[0] == pytest.approx(1.0 + np.cos(phase), abs=1e-8)
    with pytest.raises(ValueError, match="index_kd must stay within 1048576"):
        pm.structure_factor(packing, index + 4)


def test_a_crystal_has_bragg_peaks_of_height_n_and_nothing_else():
    crystal = pm.lattice_packing("fcc", repeats=(3, 3, 3))
    index = pm.wave_indices(crystal.box, 12.0)
    value = pm.structure_factor(crystal, index)
    peak = value > 0.5
    np.testing.assert_allclose(value[peak], crystal.particles, rtol=1e-12)
    assert 0 < peak.sum() < 0.05 * len(index) and np.abs(value[~peak]).max() < 1e-12 * crystal.particles


def test_bits_do_not_depend_on_whole_cells_or_on_which_vectors_are_asked_with_them(scattered):
    packing = scattered(3)
    index = pm.wave_indices(packing.box, 3.0)
    whole = pm.structure_factor(packing, index)
    assert np.array_equal(whole[5:9], pm.structure_factor(packing, index[5:9]))
    assert np.array_equal(pm.structure_factor(packing.wrapped(), -index), pm.structure_factor(packing.wrapped(), index))


def test_the_spectral_density_of_one_disc_is_its_form_factor():
    packing = pm.Packing([[0.3, 0.2]], [0.7], pm.Box.cubic(5.0, 2))
    index = pm.wave_indices(packing.box, 9.0)
    k = np.linalg.norm(pm.wave_vectors(packing.box, index), axis=1)
    exact = (2.0 * np.pi * 0.7 * j1(0.7 * k) / k) ** 2 / 25.0
    np.testing.assert_allclose(pm.spectral_density(packing, index), exact, atol=1e-14)


def quadrature(packing, index, corners):
    """Return the spectral density of particles as sums over points inside them."""
    k = pm.wave_vectors(packing.box, index)
    total = sum(weight * np.exp(1j * point @ k.T).sum(axis=0) for point, weight in corners)
    return np.abs(total) ** 2 / packing.box.volume


@pytest.mark.parametrize("dimension", [2, 3])
def test_the_spectral_density_of_spheroids_is_that_of_points_that_fill_them(dimension):
    rng = np.random.default_rng(4)
    director = rng.normal(size=(3, dimension))
    shapes = pm.Spheroids([0.6, 1.0, 2.3], director)
    box = pm.Box(6.0 * np.eye(dimension) + np.eye(dimension, k=1))
    packing = pm.Packing(rng.random((3, dimension)) * 5.0, [0.5, 0.4, 0.6], box, shapes=shapes)
    index = pm.wave_indices(box, 2.5)
    grid = (np.arange(60) + 0.5) / 30.0 - 1.0
    ball = np.stack(np.meshgrid(*[grid] * dimension), axis=-1).reshape(-1, dimension)
    ball = ball[(ball**2).sum(axis=1) < 1.0]
    corners = []
    for n, (along, across) in enumerate(zip(*shapes.semi_axes(packing.radius_n), strict=True)):
        unit = shapes.director_nd[n]
        point = across * ball + (along - across) * (ball @ unit)[:, None] * unit
        volume = (np.pi if dimension == 2 else 4.0 * np.pi / 3.0) * packing.radius_n[n] ** dimension
        corners.append((packing.position_nd[n] + point, volume / len(ball)))
    wanted = quadrature(packing, index, corners)
    np.testing.assert_allclose(pm.spectral_density(packing, index), wanted, atol=3e-3 * wanted.max())


def test_many_sizes_and_few_have_one_spectral_density_and_round_spheroids_that_of_spheres(scattered):
    packing = scattered(2).replace(radius_n=np.linspace(0.2, 0.4, 120))
    index = pm.wave_indices(packing.box, 5.0)
    k = pm.wave_vectors(packing.box, index)
    length = np.linalg.norm(k, axis=1)
    form = 2.0 * np.pi * packing.radius_n * j1(length[:, None] * packing.radius_n) / length[:, None]
    place, _ = packing.box.wrap(packing.position_nd)
    exact = np.abs((form * np.exp(1j * k @ place.T)).sum(axis=1)) ** 2 / packing.box.volume
    np.testing.assert_allclose(pm.spectral_density(packing, index), exact, atol=1e-12)
    mixed = scattered(2)
    round_ones = pm.Spheroids(np.ones(120), np.eye(2)[[0] * 120])
    np.testing.assert_allclose(
        pm.spectral_density(mixed, index), pm.spectral_density(mixed.replace(shapes=round_ones), index), atol=1e-12
    )


def test_points_at_random_scatter_evenly_and_a_shuffled_crystal_as_the_square_of_the_wave_number(scattered):
    """Displacements of their own for each particle of a crystal: S = 1 - exp(-s^2 k^2) off the peaks."""
    random = scattered(2, particles=4000)
    index = pm.wave_indices(random.box, 8.0, half=True)
    average = pm.shell_average(random.box, index, pm.structure_factor(random, index))
    assert abs((average.value_b * average.count_b).sum() / average.count_b.sum() - 1.0) < 0.15
    crystal = pm.lattice_packing("triangular", repeats=(90, 90))
    step = 0.1 * np.random.default_rng(1).normal(size=crystal.position_nd.shape)
    shuffled = crystal.replace(position_nd=crystal.position_nd + step)
    index = pm.wave_indices(shuffled.box, 1.5)
    average = pm.shell_average(shuffled.box, index, pm.structure_factor(shuffled, index))
    fit = average.power_law(0.2, 1.5)
    assert abs(fit.exponent - 2.0) < 2.0 * fit.exponent_error and 0.0 < fit.exponent_error < 0.2
    assert fit.amplitude == pytest.approx(0.01, rel=0.15)
    assert abs(fit.value_at_zero) < 4.0 * fit.value_at_zero_error
    with pytest.raises(ValueError, match="at least three shells"):
        average.power_law(0.2, 0.25)


def shells(value, wave=None):
    """Shells of a plane, and one at a peak of 2.5."""
    k = np.linspace(0.2, 1.5, 14) if wave is None else wave
    count = (200.0 * k).astype(int)
    return pm.ShellAverage(
        np.append(k, 6.0), np.append(value(k, count), 2.5), np.zeros(len(k) + 1), np.append(count, 99)
    )


# by name: S(k), and S(0)
SPECTRA = {
    "3 / 10 k^1.3": (lambda k: 0.3 * k**1.3, 0.0),
    "k^4": (lambda k: k**4, 0.0),
    "a little, and k^1.3": (lambda k: 1e-3 + 0.3 * k**1.3, 1e-3),
    "a line": (lambda k: 0.02 + 0.3 * k, 0.02),
    "a parabola": (lambda k: 0.1 + 0.5 * k**2, 0.1),
    "two powers": (lambda k: 0.05 + 0.2 * k + 0.1 * k**2, 0.05),
    "a liquid": (lambda k: 0.05 / (1.0 - 0.3 * k**2), 0.05),
    "flat": (lambda k: np.full_like(k, 0.2), 0.2),
    "falling": (lambda k: 0.2 + 0.1 * np.exp(-k), 0.3),
    "saturating": (lambda k: k / (1.0 + k), 0.0),
}


@pytest.mark.parametrize("name", SPECTRA)
def test_the_value_at_zero_of_a_spectrum_is_within_three_of_its_errors(name):
    law, zero = SPECTRA[name]
    fit = shells(lambda k, _: law(k)).power_law(0.1, 2.0)
    assert abs(fit.value_at_zero - zero) <= 3.0 * fit.value_at_zero_error + 1e-9
    rng = np.random.default_rng(7)
    for _ in range(5):
        # means of exponentially distributed values, as those of wave vectors are
        noisy = shells(lambda k, count: law(k) * rng.gamma(count / 2, 2 / count)).power_law(0.1, 2.0)
        assert abs(noisy.value_at_zero - zero) <= 4.0 * noisy.value_at_zero_error


def test_packings_are_called_hyperuniform_only_where_the_window_knows_it():
    exact = shells(lambda k, _: 0.3 * k**1.3).power_law(0.1, 2.0)
    assert exact.hyperuniformity == "hyperuniform" and abs(exact.value_at_zero) < 1e-12
    above = shells(lambda k, _: 0.005 + 0.3 * k**1.3).power_law(0.1, 2.0)
    assert above.hyperuniformity == "not hyperuniform"
    assert above.hyperuniformity_index == pytest.approx(0.005 / 2.5, rel=1e-6)
    rng = np.random.default_rng(1)
    noisy = shells(lambda k, count: 0.3 * k**1.3 * rng.gamma(count / 2, 2 / count)).power_law(0.1, 2.0)
    assert noisy.hyperuniformity == "ambiguous"
    few = shells(lambda k, _: 0.3 * k**1.3, np.linspace(0.5, 1.5, 4)).power_law(0.1, 2.0)
    assert few.hyperuniformity == "ambiguous" and np.isnan(few.value_at_zero)


def test_the_error_of_an_exponent_holds_the_window_where_the_spectrum_is_no_power():
    fit = shells(lambda k, _: 0.1 + 0.5 * k**2).power_law(0.1, 2.0)
    assert 0.2 < fit.exponent_error and abs(fit.exponent - 2.0) < 3.0 * fit.exponent_error


def test_errors_of_shells_count_opposite_vectors_once(scattered):
    packing = scattered(2, particles=4000)
    both, half = (pm.wave_indices(packing.box, 5.0, half=one) for one in (False, True))
    one, other = (
        pm.shell_average(packing.box, index, pm.structure_factor(packing, index), width=1.0) for index in (both, half)
    )
    np.testing.assert_allclose(one.value_b, other.value_b, rtol=1e-12)
    np.testing.assert_allclose(one.error_b, other.error_b, rtol=1e-9)


def test_bodies_of_beads_have_no_spectral_density_but_a_structure_factor():
    two = pm.Packing([[0.0, 0.0], [1.0, 0.0]], [0.5, 0.5], pm.Box.cubic(6.0, 2))
    dimer = pm.rigid_packing(two, [0, 0])
    with pytest.raises(ValueError, match="pm.spectral_density, got Beads"):
        pm.spectral_density(dimer, [[1, 0]])
    assert pm.structure_factor(dimer, [[1, 0]])[0] == pytest.approx(1.0)


def test_freud_reaches_no_other_box_than_the_orthogonal_one_and_there_an_octant():
    """Its direct structure factor averages over wave vectors without negative components only: told, not followed."""
    freud = pytest.importorskip("freud")
    rng = np.random.default_rng(1)
    packing = pm.Packing(rng.random((200, 3)) * 6.0, np.full(200, 0.3), pm.Box.cubic(6.0, 3))
    box = freud.box.Box.cube(6.0)
    found = freud.diffraction.StaticStructureFactorDirect(bins=20, k_max=6.0, k_min=1.0)
    found.compute((box, box.wrap(packing.position_nd)))
    index = pm.wave_indices(packing.box, 6.0)
    octant = index[(index >= 0).all(axis=1)]
    length = np.linalg.norm(pm.wave_vectors(packing.box, octant), axis=1)
    value = pm.structure_factor(packing, octant)
    edges = np.asarray(found.bin_edges)
    for b in range(20):
        inside = (length >= edges[b]) & (length < edges[b + 1])
        # a vector on an edge, to single precision, may fall to either side
        near = np.abs(length[:, None] - edges[b : b + 2]).min() < 1e-5
        if inside.any() and not near:
            assert found.S_k[b] == pytest.approx(value[inside].mean(), abs=5e-5)
