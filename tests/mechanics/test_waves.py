"""Facts about waves: closed forms of crystals, copies of a box, and sound against moduli and the slopes of branches."""

import numpy as np
import pytest
import scipy.sparse as sp

import packmech as pm
from packmech.mechanics import waves as waves_room

SPRINGS = (pm.Repulsion(),)


def crystal(name, overlap=0.0):
    """Return a crystal of one particle of mass 1 in its primitive cell, and its nearest neighbors' vectors."""
    packing = pm.lattice_packing(name, repeats=(1,) * (2 if name in ("triangular", "square") else 3))
    if overlap:
        packing = pm.lattice_packing(name, repeats=(1,) * packing.dimension, relative_overlap=overlap)
    return pm.Scene(packing.replace(mass_n=np.ones(packing.particles)), SPRINGS)


def rest(particles, dimension, seed, strain="free", pressure=1e-2):
    start = pm.random_packing(
        particles, dimension=dimension, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.8 if dimension == 2 else 0.6,
        seed=seed,
    )  # fmt: skip
    run = pm.jam(pm.Scene(start, SPRINGS), pressure=pressure, strain=strain, force_tolerance=1e-12)
    return pm.Scene(run.packing, SPRINGS)


@pytest.mark.parametrize(("name", "overlap"), [("triangular", 0.0), ("triangular", 0.05), ("fcc", 0.0), ("fcc", 0.05)])
def test_dispersion_of_bravais_lattices_is_the_sum_over_neighbors(name, overlap):
    scene = crystal(name, overlap)
    contacts = pm.find_contacts(scene.packing) if overlap else pm.find_contacts(scene.packing, gap_tolerance=1e-9)
    stretch = pm.elastic_moduli(scene).stable
    assert stretch
    terms = pm.contact_forces(scene) if overlap else None
    push = terms.normal_c if overlap else np.zeros(len(contacts))
    # u'' = 1 / sigma^2 in units of the energy, of springs of diameter 1
    second = 1.0 / contacts.contact_distance_c**2
    rng = np.random.default_rng(0)
    reciprocal = 2.0 * np.pi * scene.packing.box.inverse_dd
    for fraction in rng.uniform(-1.0, 1.0, size=(20, scene.packing.dimension)):
        k = fraction @ reciprocal
        matrix = np.zeros((len(k), len(k)))
        for n, r, p, s in zip(contacts.normal_cd, contacts.distance_c, push, second, strict=True):
            block = s * np.outer(n, n) - p / r * (np.eye(len(k)) - np.outer(n, n))
            matrix += 4.0 * np.sin(0.5 * r * (k @ n)) ** 2 * block
        wanted = np.linalg.eigvalsh(matrix)
        found = pm.waves(scene, [fraction]).frequency_km[0]
        np.testing.assert_allclose(found**2, wanted, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(("dimension", "repeats"), [(2, (3, 2)), (3, (2, 1, 2))])
def test_waves_of_a_box_are_the_modes_of_its_copies(dimension, repeats):
    scene = rest(20, dimension, 1)
    many = scene.replace(packing=scene.packing.repeated(repeats))
    fractions = np.stack(
        np.meshgrid(*(np.arange(n) / n for n in repeats), indexing="ij"), axis=-1
    ).reshape(-1, dimension)  # fmt: skip
    frequency = pm.waves(scene, fractions).frequency_km.ravel()
    found = np.sort(np.sign(frequency) * frequency**2)
    modes = pm.normal_modes(many)
    wanted = np.sort(np.concatenate([np.zeros(dimension), modes.eigenvalue_m]))
    np.testing.assert_allclose(found, wanted, atol=1e-12 * wanted[-1])


def test_ellipses_turn_in_waves_too():
    scene = pm.Scene(
        pm.random_packing(12, dimension=2, packing_fraction=0.95, seed=3, shapes=pm.Ellipses(1.5)), SPRINGS
    )
    matrix = pm.hessian(scene, "none", wave_vector=[0.3, -0.2]).toarray()
    assert matrix.shape == (36, 36)
    np.testing.assert_allclose(matrix, matrix.conj().T, atol=1e-14)
    half = [np.linalg.eigvalsh(pm.hessian(scene, "none", wave_vector=[f, 0.0]).toarray()) for f in (0.0, 0.5)]
    packing = scene.packing
    position = np.concatenate([packing.position_nd, packing.position_nd + packing.box.lattice_dd[:, 0]])
    shapes = pm.Spheroids(np.tile(packing.shapes.aspect_n, 2), np.tile(packing.shapes.orientation_nq, (2, 1)))
    box = pm.Box(packing.box.lattice_dd * [2.0, 1.0])
    two = pm.Packing(position, np.tile(packing.radius_n, 2), box, shapes=shapes)
    wanted = np.linalg.eigvalsh(pm.hessian(scene.replace(packing=two), "none").toarray())
    np.testing.assert_allclose(np.sort(np.concatenate(half)), wanted, atol=1e-11)
    np.testing.assert_allclose(
        pm.hessian(scene, "none", wave_vector=[1.0, 0.0]).toarray(), pm.hessian(scene, "none").toarray(), atol=1e-12
    )


def test_rows_at_a_wave_vector_give_the_stiffness_without_forces():
    scene = rest(16, 2, 2)
    rows = pm.rigidity_matrix(scene.packing, "none", wave_vector=[0.2, 0.4])
    stiffness = 1.0 / pm.find_contacts(scene.packing).contact_distance_c ** 2
    wanted = rows.conj().T @ (stiffness[:, None] * rows.toarray())
    found = pm.hessian(scene, "none", "unstressed", wave_vector=[0.2, 0.4]).toarray()
    np.testing.assert_allclose(found, wanted, atol=1e-12)


def test_copies_farther_along_move_by_the_phase_as_often_as_they_are_boxes_away():
    # two discs in a row around the box: 1 touches 0 of the next box, whose motion is exp(2 pi i f) times that of 0
    pair = pm.Packing([[0.5, 1.5], [1.5, 1.5]], 0.5, pm.Box([2.0, 3.0]))
    contacts = pm.find_contacts(pair, gap_tolerance=1e-9)
    f = 0.1
    rows = pm.rigidity_matrix(pair, "none", contacts=contacts, wave_vector=[f, 0.0]).toarray()
    for row, image in zip(rows, contacts.image_cd[:, 0], strict=True):
        # i = 0 and j = 1: beside 0 in the box, or in the box before it
        side = 1.0 if image == 0 else -1.0
        np.testing.assert_allclose(row, [-side, 0.0, side * np.exp(2j * np.pi * f * image), 0.0], atol=1e-15)
    assert sorted(contacts.image_cd[:, 0]) == [-1, 0]


def test_waves_that_grow_are_found_among_many_coordinates():
    start = pm.random_packing(700, dimension=2, packing_fraction=0.9, seed=1)
    scene = pm.Scene(start, SPRINGS)
    wave = [[0.3, 0.1]]
    few = pm.waves(scene, wave, count=4, rattlers="keep")
    matrix = pm.dynamical_matrix(scene, wave_vector=wave[0]).toarray()
    lowest = np.linalg.eigvalsh(matrix)[:4]
    assert lowest[0] < -1.0 and few.missed == 0
    np.testing.assert_allclose(few.frequency_km[0], -np.sqrt(-lowest), rtol=1e-9)


@pytest.mark.parametrize("overlap", [0.0, 0.03])
def test_sound_in_isotropic_crystals_goes_by_the_moduli(overlap):
    scene = crystal("triangular", overlap)
    moduli = pm.elastic_moduli(scene)
    for direction in ([1.0, 0.0], [0.3, -0.8]):
        sound = pm.sound_speeds(scene, direction)
        found = sound.speed_m**2 * sound.density
        wanted = [moduli.shear_modulus, moduli.bulk_modulus + moduli.shear_modulus]
        np.testing.assert_allclose(found, wanted, rtol=1e-12)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("seed", range(10))
def test_sound_is_the_slope_of_the_lowest_branches(seed, dimension):
    scene = rest(24, dimension, seed)
    direction = np.eye(dimension)[seed % dimension]
    box = scene.packing.box
    small = 1e-3
    k = 2.0 * np.pi * float(np.linalg.norm(direction @ box.inverse_dd)) * small * np.array([1.0, 0.5])
    squares = (pm.waves(scene, small * np.outer([1.0, 0.5], direction), count=dimension).frequency_km / k[:, None]) ** 2
    # errors go as k^2
    slope = (4.0 * squares[1] - squares[0]) / 3.0
    sound = pm.sound_speeds(scene, direction @ box.inverse_dd)
    np.testing.assert_allclose(slope, sound.speed_m**2, rtol=1e-6)


def test_dispersion_passes_its_corners_and_lowest_branches_are_those_of_all():
    scene = rest(30, 2, 5)
    path = pm.dispersion(scene, [[0, 0], [0.5, 0], [0.5, 0.5], [0, 0]], points=12)
    np.testing.assert_array_equal(path.wave_vector_kd[path.corner_k], [[0, 0], [0.5, 0], [0.5, 0.5], [0, 0]])
    assert path.complete and path.residual < 1e-13 and (np.diff(path.along_k) > 0.0).all()
    few = pm.waves(scene, path.wave_vector_kd, count=5)
    np.testing.assert_allclose(few.frequency_km, path.frequency_km[:, :5], atol=1e-6)


def test_corners_at_one_place_are_points_of_their_own():
    path = pm.dispersion(crystal("triangular"), [[0, 0], [0, 0], [0.5, 0]], points=5)
    assert path.corner_k[0] == 0 and (np.diff(path.corner_k) >= 1).all()
    assert len(path.wave_vector_kd) == path.corner_k[-1] + 1 >= 5


def test_many_particles_are_searched_from_below():
    scene = rest(24, 2, 1)
    many = scene.replace(packing=scene.packing.repeated((8, 8)))
    wave = np.array([[0.25, 0.5]])
    few = pm.waves(many, wave, count=6)
    fractions = (np.stack(np.meshgrid(np.arange(8), np.arange(8), indexing="ij"), axis=-1).reshape(-1, 2) + wave) / 8.0
    wanted = np.sort(pm.waves(scene, fractions).frequency_km.ravel())[:6]
    assert few.available > 1200 and few.residual < 1e-10
    np.testing.assert_allclose(few.frequency_km[0], wanted, rtol=1e-8)


def test_waves_of_a_square_crystal_in_hundreds_of_one_frequency_are_all_found():
    # rows and columns move each by themselves, so that each frequency is that of 4 x 27 waves
    square = pm.lattice_packing("square", repeats=(27, 27)).replace(mass_n=np.ones(27 * 27))
    few = pm.waves(pm.Scene(square, SPRINGS), [[0.5, 0.5]], count=110)
    assert few.available > 1200 and few.missed == 0
    wanted = 2.0 * np.sin(np.pi * np.array([0.5, 1.5]) / 27.0)
    np.testing.assert_allclose(few.frequency_km[0], np.repeat(wanted, [108, 2]), rtol=1e-9)


def test_of_waves_of_one_frequency_a_list_may_hold_some_and_none_below_may_lack():
    # 0.1 once, 0.2 five times, and a list of some of them, as rounding leaves these
    real = waves_room.real_form(sp.csr_array(np.diag([0.1, 0.2, 0.2, 0.2, 0.2, 0.2, 1.0]).astype(complex)))
    some = 0.2 + 2e-15 * np.arange(-1, 2)
    assert waves_room._missed(real, np.array([0.1, *some]), 2, 1.0) == 0
    assert waves_room._missed(real, some, 1, 1.0) == 1


@pytest.mark.parametrize("always", [False, True])
def test_the_lowest_waves_that_a_search_overlooks_are_looked_for_again_or_counted_as_missed(always, monkeypatch):
    scene = rest(24, 2, 1)
    many = scene.replace(packing=scene.packing.repeated((8, 8)))
    wave, search = [[0.23, 0.4]], waves_room._lanczos
    wanted = pm.waves(many, wave, count=6)

    def overlooking(matrix, solve, shift, taken, count, turn):
        found = search(matrix, solve, shift, taken, count + 2, turn)
        order = np.argsort(np.einsum("rm,rm->m", found.conj(), matrix @ found).real)
        return found[:, order[2:]] if always or not turn else found[:, order]

    monkeypatch.setattr(waves_room, "_lanczos", overlooking)
    found = pm.waves(many, wave, count=6)
    if always:
        assert found.missed == 2 and found.frequency_km[0, 0] > wanted.frequency_km[0, 1]
    else:
        assert found.missed == 0
        np.testing.assert_allclose(found.frequency_km, wanted.frequency_km, rtol=1e-8)


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda scene: pm.waves(scene, [[0.1]]), "wave_vectors must have shape"),
        (lambda scene: pm.dispersion(scene, [[0.0, 0.0]]), "path must have two corners or more, got 1"),
        (
            lambda scene: pm.dispersion(scene, [[0, 0], [0.5, 0], [0, 0]], points=2),
            "points must be 3 or more, one for each corner of the path, got 2",
        ),
        (lambda scene: pm.dispersion(scene, [[0, 0], [0.5, 0]], points=10**15), "points must be so small that memory"),
        (lambda scene: pm.sound_speeds(scene, [0.0, 0.0]), "direction must have a length"),
        (lambda scene: pm.hessian(scene, "free", wave_vector=[0.1, 0.0]), "strain must be 'none'"),
        (
            lambda scene: pm.rigidity_matrix(scene.packing, wave_vector=[0.1, 0.0]),
            "wave_vector must be left out but for",
        ),
    ],
)
def test_bad_input_gets_one_clear_error(call, message):
    with pytest.raises(ValueError, match=message):
        call(crystal("triangular"))


def test_what_has_no_copies_has_no_waves():
    chain = pm.Scene(pm.chain_packing(2, 4, dimension=2, packing_fraction=0.3, seed=1), SPRINGS)
    with pytest.raises(ValueError, match="rigid links"):
        pm.dynamical_matrix(chain, wave_vector=[0.1, 0.0])
