"""Facts about the rigidity matrix and its two null spaces."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import packmech as pm
from packmech.contacts import pair_contacts
from packmech.effects import contact_terms
from packmech.linalg.mandel import mandel_tensor
from packmech.measure.contact_forces import contact_stress
from packmech.measure.stress import sum_forces

STRAINS = ["none", "isotropic", "isochoric", "free"]


def strained(packing, motion):
    """Return the packing moved by (positions, Mandel strain): v -> (1 + strain)(v + dv)."""
    count = packing.position_nd.size
    gradient = mandel_tensor(motion[count:])
    moved = packing.position_nd + motion[:count].reshape(packing.position_nd.shape)
    return pm.Packing(moved @ (np.eye(len(gradient)) + gradient), packing.radius_n, packing.box.strained(gradient))


def test_rigidity_matrix_agrees_with_an_independent_program(golden):
    stored = golden("random_mono_2d_w3.0.json")
    packing = pm.Packing(stored["positions"], stored["radii"], pm.Box(stored["lattice_columns"]))
    found = pm.rigidity_matrix(packing).toarray()
    np.testing.assert_allclose(found, stored["rigidity_matrix_mandel"], rtol=0, atol=1e-12)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("seed", range(3))
def test_rigidity_matrix_is_the_derivative_of_the_contact_distances(random_scene, dimension, seed):
    packing = random_scene(dimension, seed).packing
    contacts = pm.find_contacts(packing)
    columns = packing.position_nd.size + dimension * (dimension + 1) // 2
    direction = np.random.default_rng(seed).normal(size=columns)

    def distances(size):
        pairs = contacts.i_c, contacts.j_c, contacts.image_cd
        return pair_contacts(strained(packing, size * direction), *pairs).distance_c

    h = 1e-3
    # fourth order in h
    slope = (8 * (distances(h) - distances(-h)) - (distances(2 * h) - distances(-2 * h))) / (12 * h)
    np.testing.assert_allclose(pm.rigidity_matrix(packing) @ direction, slope, rtol=0, atol=2e-8)


@pytest.mark.parametrize("dimension", [2, 3])
def test_transpose_turns_contact_forces_into_net_forces_and_stress(random_scene, dimension):
    packing = random_scene(dimension, 5).packing
    contacts = pm.find_contacts(packing)
    first = np.random.default_rng(0).normal(size=len(contacts))
    gradient = pm.rigidity_matrix(packing).T @ first
    count = packing.position_nd.size
    np.testing.assert_allclose(-gradient[:count], sum_forces(contacts, -first).ravel(), atol=1e-14)
    stress = contact_stress(contacts, first, packing.box.volume)
    np.testing.assert_allclose(mandel_tensor(gradient[count:]) / packing.box.volume, stress, atol=1e-14)


def test_a_self_image_stretches_with_strain_only():
    one = pm.lattice_packing("fcc", repeats=(1, 1, 1))
    matrix = pm.rigidity_matrix(one).toarray()
    assert matrix.shape == (6, 9)
    assert not matrix[:, :3].any()
    assert np.linalg.matrix_rank(matrix[:, 3:]) == 6


# -- counting ----------------------------------------------------------------------------------------------------------

# name, repeats -> zero modes (translations included) and self stress in a fixed box; the same with all strains
LATTICES = [
    *[("triangular", (n, n), 2, n * n + 2, 2, n * n - 1) for n in (3, 4, 6, 9)],
    *[("square", (n, n), 2 * n, 2 * n, 2 * n + 1, 2 * n - 2) for n in (2, 3, 5, 8)],
    *[("kagome", (n, n), 3 * n, 3 * n, 3 * n, 3 * n - 3) for n in (2, 3, 5, 7)],
    ("triangular", (1, 1), 2, 3, 2, 0),
    ("fcc", (1, 1, 1), 3, 6, 3, 0),
    # 6 N contacts, rigid: rank 3 N - 3, and 3 N + 3 with the strains
    ("fcc", (3, 3, 3), 3, 27 * 3 + 3, 3, 27 * 3 - 3),
]


@pytest.mark.parametrize("method", ["dense", "sparse"])
@pytest.mark.parametrize(("name", "repeats", "zero", "stress", "zero_strain", "stress_strain"), LATTICES)
def test_crystals_have_their_counts_of_floppy_modes_and_self_stress(
    name, repeats, zero, stress, zero_strain, stress_strain, method
):
    crystal = pm.lattice_packing(name, repeats=repeats)
    d = crystal.dimension
    # uniform pressure is a state of self stress of each: no free volume without work
    for strain, floppy, states in (
        ("none", zero, stress),
        ("isotropic", zero, stress - 1),
        ("isochoric", zero_strain, stress_strain + 1),
        ("free", zero_strain, stress_strain),
    ):
        modes = pm.floppy_modes(crystal, strain, method=method)
        selves = pm.states_of_self_stress(crystal, strain, method=method)
        assert (modes.count + d, selves.count) == (floppy, states)
        assert modes.certain and selves.certain
        assert modes.residual < 1e-13 and selves.residual < 1e-13


@pytest.mark.parametrize("strain", STRAINS)
@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**32), dimension=st.sampled_from([2, 3]))
def test_rank_and_self_stress_add_up_to_contacts_and_with_floppy_modes_to_columns(strain, seed, dimension):
    packing = pm.random_packing(12, dimension=dimension, packing_fraction=0.8, sizes=pm.Uniform(ratio=3.0), seed=seed)
    components = dimension * (dimension + 1) // 2
    columns = 12 * dimension + {"none": 0, "isotropic": 1, "isochoric": components - 1, "free": components}[strain]
    selves, modes = pm.states_of_self_stress(packing, strain), pm.floppy_modes(packing, strain)
    assert selves.rank == modes.rank
    assert selves.rank + selves.count == selves.contacts == len(pm.find_contacts(packing))
    assert modes.rank + modes.count + dimension == columns == modes.columns


@pytest.mark.parametrize("strain", STRAINS)
def test_sparse_and_dense_methods_span_the_same_spaces(strain):
    # crowded and empty places, so that both spaces have members
    packing = pm.random_packing(60, dimension=2, packing_fraction=0.9, sizes=pm.Uniform(ratio=6.0), seed=2)
    for solve, field, rows in ((pm.states_of_self_stress, "force_ck", None), (pm.floppy_modes, "motion_xk", 120)):
        dense, sparse = (solve(packing, strain, method=method) for method in ("dense", "sparse"))
        assert dense.count == sparse.count > 0
        # displacements of the modes, all of the states
        one, two = (getattr(answer, field)[:rows] for answer in (dense, sparse))
        np.testing.assert_allclose(one @ one.T, two @ two.T, atol=1e-9)


@pytest.mark.parametrize("strain", STRAINS)
def test_states_of_self_stress_balance_every_particle_and_the_admitted_strains(rest_scene, strain):
    packing = rest_scene(64, 2, 0.9, 1).packing
    selves = pm.states_of_self_stress(packing, strain)
    contacts = pm.find_contacts(packing, gap_tolerance=1e-9)
    assert selves.count > 3
    np.testing.assert_allclose(selves.force_ck.T @ selves.force_ck, np.eye(selves.count), atol=1e-12)
    for force in selves.force_ck.T:
        assert np.abs(sum_forces(contacts, force)).max() < 1e-12
        stress = contact_stress(contacts, force, 1.0)
        if strain == "isotropic":
            assert abs(np.trace(stress)) < 1e-12
        elif strain != "none":
            assert np.abs(stress - np.eye(2) * np.trace(stress) / 2).max() < 1e-12
        if strain == "free":
            assert np.abs(stress).max() < 1e-12


def test_the_contact_forces_of_a_packing_at_rest_are_a_state_of_self_stress(rest_scene):
    scene = rest_scene(64, 2, 0.9, 1)
    contacts = pm.find_contacts(scene.packing, gap_tolerance=1e-9)
    terms = contact_terms(scene.effects, contacts)
    force = -terms.first_c
    force /= np.linalg.norm(force)
    states = pm.states_of_self_stress(scene.packing).force_ck
    assert np.linalg.norm(force - states @ (states.T @ force)) < 1e-9


def test_floppy_modes_change_no_distance_and_no_mean_position():
    packing = pm.lattice_packing("square", repeats=(4, 4))
    modes = pm.floppy_modes(packing, "free")
    assert modes.motion_xk.shape == (16 * 2 + 3, 7)
    assert np.abs(pm.rigidity_matrix(packing) @ modes.motion_xk).max() < 1e-13
    assert np.abs(modes.motion_xk[:32].reshape(16, 2, 7).mean(axis=0)).max() < 1e-13
    # exactly one of them shears the box
    assert np.linalg.matrix_rank(modes.motion_xk[32:], tol=1e-10) == 1


def test_each_free_particle_adds_its_d_motions():
    crystal = pm.lattice_packing("square", repeats=(3, 3))
    center = crystal.position_nd + 0.5
    for added in (1, 2, 4):
        packing = pm.Packing(np.vstack([crystal.position_nd, center[:added]]), [0.5] * 9 + [0.1] * added, crystal.box)
        assert pm.floppy_modes(packing).count == pm.floppy_modes(crystal).count + 2 * added
        assert pm.states_of_self_stress(packing).count == pm.states_of_self_stress(crystal).count


def test_a_packing_without_contacts_has_only_motions():
    packing = pm.Packing([[0.0, 0.0], [1.0, 1.0], [0.0, 1.0]], [0.1, 0.1, 0.1], pm.Box.cubic(2.0, 2))
    assert pm.floppy_modes(packing, "free").count == 6 + 3 - 2
    selves = pm.states_of_self_stress(packing)
    assert (selves.count, selves.contacts, selves.rank) == (0, 0, 0)
    assert pm.rigidity_matrix(packing).shape == (0, 9)


def test_a_basis_beyond_the_memory_limit_is_left_out_and_the_count_given():
    crystal = pm.lattice_packing("triangular", repeats=(6, 6))
    selves = pm.states_of_self_stress(crystal, basis_limit=100.0)
    assert selves.force_ck is None and selves.count == 38
    modes = pm.floppy_modes(pm.lattice_packing("kagome", repeats=(4, 4)), basis_limit=100.0)
    assert modes.motion_xk is None and modes.count == 10


CRYSTAL = pm.lattice_packing("triangular", repeats=(2, 2))


@pytest.mark.parametrize(
    ("call", "error", "text"),
    [
        (lambda: pm.rigidity_matrix(3), TypeError, "packing must be a Packing"),
        (lambda: pm.rigidity_matrix(CRYSTAL, "yes"), ValueError, "strain must be one of"),
        (
            lambda: pm.rigidity_matrix(CRYSTAL, gap_tolerance=np.nan),
            ValueError,
            "gap_tolerance must be a finite number",
        ),
        (lambda: pm.states_of_self_stress(CRYSTAL, "all"), ValueError, "strain must be one of"),
        (lambda: pm.states_of_self_stress(CRYSTAL, method="svd"), ValueError, "method must be one of"),
        (lambda: pm.floppy_modes(CRYSTAL, rank_tolerance=0.0), ValueError, "rank_tolerance must be"),
        (lambda: pm.floppy_modes(CRYSTAL, basis_limit=-1), ValueError, "basis_limit must be"),
        (lambda: pm.floppy_modes(None), TypeError, "packing must be a Packing"),
    ],
)
def test_bad_input_gets_one_clear_error(call, error, text):
    with pytest.raises(error, match=text):
        call()
