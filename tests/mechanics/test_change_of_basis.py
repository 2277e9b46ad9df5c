"""Facts about Hessians and rigidity matrices of packings with links, and the motions that these admit."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import packmech as pm
from packmech.constraints.factor import ConstraintFactor

RANDOM = ["random_trimer_2d_w2.5", "random_dimer_3d_w2.0", "random_chain_3d_w2.5"]
AT_REST = ["equilibrium_chain_2d", "equilibrium_dimer_2d", "equilibrium_dimer_3d", "equilibrium_trimer_2d"]


def same_rows(one, other):
    """Largest difference between two sets of rows, each sorted the same way."""
    return max(np.abs(np.asarray(one) - row).max(axis=1).min() for row in np.asarray(other))


def gamma(packing):
    """Return the (N d + s, L) gradients of the links' lengths."""
    links = ConstraintFactor(packing)
    return np.hstack([links.gradient_lx.toarray(), links.strain_le]).T


@pytest.mark.parametrize("name", RANDOM)
def test_hessian_of_the_contacts_is_that_of_automatic_differentiation(linked, name):
    scene, data = linked(name)
    size = scene.packing.position_nd.size
    full = pm.hessian(scene, kind="paper").toarray()
    scale = np.abs(full).max()
    assert np.abs(full[:size, :size] - np.array(data["H_xx"])).max() < 1e-12 * scale
    assert np.abs(full[size:, :size] - np.array(data["H_ex_mandel"])).max() < 1e-12 * scale
    assert np.abs(full[size:, size:] - np.array(data["H_ee_mandel"])).max() < 1e-12 * scale


@pytest.mark.parametrize("name", RANDOM)
def test_rows_of_contacts_and_links_are_those_of_complex_steps(linked, name):
    scene, data = linked(name)
    mine = pm.rigidity_matrix(scene.packing, gap_tolerance=0.0).toarray()
    stored = np.array(data["rigidity_matrix_mandel"])
    assert mine.shape == stored.shape
    assert same_rows(mine, stored) < 1e-12
    assert same_rows(gamma(scene.packing).T, np.array(data["constraint_jacobian_Gamma_links_mandel"]).T) < 1e-12


@pytest.mark.parametrize("name", AT_REST)
def test_hessians_at_rest_are_the_stored_ones(linked, name):
    scene, data = linked(name)
    for kind, stored in (("paper", "H0_mandel"), ("exact", "H_exact_trace_mandel")):
        mine = pm.hessian(scene, kind=kind, strain="isochoric", volume_curvature="trace").toarray()
        assert np.abs(mine - np.array(data[stored])).max() < 1e-12


@pytest.mark.parametrize("name", AT_REST)
def test_spectra_at_fixed_volume_are_the_stored_ones(linked, name):
    scene, data = linked(name)
    basis = pm.change_of_basis(scene.packing, strain="isochoric", strain_scale=1.0).T
    for kind, curvature, stored in (
        ("paper", "det", "paper"),
        ("exact", "det", "exact_det"),
        ("exact", "trace", "exact_trace"),
    ):
        full = pm.hessian(scene, kind=kind, strain="isochoric", volume_curvature=curvature)
        value = np.linalg.eigvalsh(basis @ (full @ basis.T))
        expected = np.sort(data[f"eigvals_reduced_fixed_volume_{stored}"])
        assert len(value) == len(expected)
        assert np.abs(value - expected).max() < 1e-9


@pytest.mark.parametrize("name", [*RANDOM, *AT_REST])
@pytest.mark.parametrize("strain_scale", [1.0, 3.7])
def test_basis_is_orthonormal_and_keeps_the_links(linked, name, strain_scale):
    packing = linked(name)[0].packing
    size, links = packing.position_nd.size, len(packing.links)
    basis = pm.change_of_basis(packing, strain_scale=strain_scale).T
    components = basis.shape[1] - size
    assert len(basis) == size + components - links
    assert np.abs(basis @ basis.T - np.eye(len(basis))).max() < 1e-14
    scaled = np.concatenate([np.ones(size), np.full(components, strain_scale)])
    assert np.abs((basis / scaled) @ gamma(packing)).max() < 1e-14
    assert pm.change_of_basis(packing, strain="isochoric").shape[1] == len(basis) - 1
    assert pm.change_of_basis(packing, strain="none").shape == (size, size - links)


def test_rigid_trimer_keeps_translations_and_rotations():
    rng = np.random.default_rng(0)
    for dimension, motions in ((2, 3), (3, 6)):
        place = rng.normal(size=(3, dimension))
        i, j = np.array([(0, 1), (1, 2), (0, 2)]).T
        links = pm.Links(i, j, np.zeros((3, dimension)), np.linalg.norm(place[j] - place[i], axis=1))
        packing = pm.Packing(place, [0.1] * 3, pm.Box.cubic(9.0, dimension), links)
        basis = pm.change_of_basis(packing, strain="none").T
        centered = place - place.mean(axis=0)
        rigid = [np.tile(axis, 3) for axis in np.eye(dimension)]
        for a in range(dimension):
            for b in range(a):
                turn = np.zeros((dimension, dimension))
                turn[a, b], turn[b, a] = 1.0, -1.0
                rigid.append((centered @ turn.T).ravel())
        q = np.linalg.qr(np.array(rigid).T)[0]
        assert q.shape[1] == motions
        assert np.abs(basis.T @ basis - q @ q.T).max() < 1e-14


@pytest.mark.parametrize("name", ["trimer_projector_2d", "trimer_projector_3d"])
def test_projector_of_a_trimer_is_the_stored_one(golden, name):
    stored = golden("exact_links.json")[name]
    place = np.array(stored["positions"])
    i, j = np.array([(0, 1), (1, 2), (0, 2)]).T
    links = pm.Links(i, j, np.zeros((3, place.shape[1])), np.linalg.norm(place[j] - place[i], axis=1))
    packing = pm.Packing(place, [0.1] * 3, pm.Box.cubic(9.0, place.shape[1]), links)
    basis = pm.change_of_basis(packing, strain="none").T
    assert len(basis) == stored["dof"]
    assert np.abs(basis.T @ basis - np.array(stored["projector"])).max() < 1e-10


def test_gradient_of_a_dimer_is_the_stored_one(golden):
    stored = golden("exact_links.json")["dimer_strain"]
    end = stored["length"] * np.array([np.cos(stored["theta"]), np.sin(stored["theta"])])
    links = pm.Links([0], [1], [[0, 0]], [stored["length"]])
    row = gamma(pm.Packing([[0.0, 0.0], end], [0.4] * 2, pm.Box.cubic(9.0, 2), links))[:, 0]
    assert np.abs(row - np.array(stored["Gamma"])).max() < 1e-10
    assert row @ row == pytest.approx(stored["norm2"], abs=1e-10)


def test_dimer_gradient_is_the_closed_form():
    length, angle = 1.7, 0.4
    normal = np.array([np.cos(angle), np.sin(angle)])
    packing = pm.Packing(
        [[0.0, 0.0], length * normal], [0.4] * 2, pm.Box.cubic(9.0, 2), pm.Links([0], [1], [[0, 0]], [length])
    )
    row = gamma(packing)[:, 0]
    strain = length * np.array([normal[0] ** 2, normal[1] ** 2, np.sqrt(2.0) * normal[0] * normal[1]])
    assert np.abs(row - np.concatenate([-normal, normal, strain])).max() < 1e-15
    assert row @ row == pytest.approx(2.0 + length**2, rel=1e-14)


def test_links_that_close_around_the_box_forbid_the_strain_along_them():
    place = [[0.5 + k, 1.0] for k in range(4)]
    links = pm.Links([0, 1, 2, 0], [1, 2, 3, 3], [[0, 0]] * 3 + [[-1, 0]], [1.0] * 4)
    packing = pm.Packing(place, [0.4] * 4, pm.Box.cubic(4.0, 2), links)
    basis = pm.change_of_basis(packing, strain_scale=1.0).T
    # four links of rank three along x, and the strain xx is lost
    assert len(basis) == 8 - 3 + 2
    assert np.abs(basis[:, 8]).max() < 1e-14
    assert np.linalg.matrix_rank(basis[:, 9:]) == 2


@pytest.mark.parametrize("name", AT_REST)
def test_dynamical_matrix_is_the_reduced_hessian(linked, name):
    scene, _ = linked(name)
    scene, fourfold = (
        scene.replace(packing=scene.packing.replace(mass_n=np.full(scene.packing.particles, m))) for m in (1.0, 4.0)
    )
    for strain in ("none", "free"):
        basis = pm.change_of_basis(scene.packing, strain).T
        reduced = basis @ (pm.hessian(scene, strain) @ basis.T)
        matrix = pm.dynamical_matrix(scene, strain, strain_scale=1.0).toarray()
        assert np.abs(matrix - reduced).max() < 1e-13
        heavy = pm.dynamical_matrix(fourfold).toarray()
        light = pm.dynamical_matrix(scene).toarray()
        assert np.abs(np.linalg.eigvalsh(heavy) - np.linalg.eigvalsh(light) / 4.0).max() < 1e-13


@pytest.mark.parametrize("name", AT_REST)
def test_contact_stiffness_of_the_reduced_rigidity_matrix_is_the_unstressed_dynamical_matrix(linked, name):
    scene, data = linked(name)
    reduced = pm.constrained_rigidity_matrix(scene.packing)
    stiffness = 1.0 / pm.find_contacts(scene.packing).contact_distance_c ** 2
    spring = reduced.T @ (stiffness[:, None] * reduced)
    assert data["w"] == 2.0
    assert np.abs(spring - pm.dynamical_matrix(scene, "free", "unstressed", strain_scale=1.0).toarray()).max() < 1e-13
    square = pm.n_matrix(scene.packing)
    one, other = np.linalg.eigvalsh(square), np.linalg.eigvalsh(reduced.T @ reduced)
    shared = min(len(one), len(other))
    assert np.abs(one[-shared:] - other[-shared:]).max() < 1e-12


@pytest.mark.parametrize(("name", "strain"), [("jammed_dimer_strain", "isochoric"), ("jammed_trimer_fixedbox", "none")])
def test_near_jamming_ranks_and_spectra_are_the_stored_ones(linked, name, strain):
    scene, data = linked(name)
    dimension = scene.packing.dimension
    count = data["first_order"]
    reduced = pm.constrained_rigidity_matrix(scene.packing, strain, strain_scale=1.0)
    assert reduced.shape[1] - dimension == count["dims_mod_translations"]
    size = np.linalg.svd(reduced, compute_uv=False)
    rank = int(np.count_nonzero(size > 1e-5 * size[0]))
    assert rank == count["rank"] and len(reduced) - rank == count["sss"]
    assert reduced.shape[1] - dimension - rank == count["floppy"]
    basis = pm.change_of_basis(scene.packing, strain, strain_scale=1.0).T
    for kind in ("exact", "paper"):
        full = pm.hessian(scene, strain, kind, volume_curvature="trace")
        value = np.linalg.eigvalsh(basis @ (full @ basis.T))
        # translations are zero modes that the stored list leaves out
        expected = np.sort(np.concatenate([data[f"eigvals_{kind}"], np.zeros(dimension)]))
        assert np.abs(value - expected).max() < 1e-9


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 2**32))
def test_reduced_spectrum_does_not_change_when_links_and_particles_are_wrapped(linked, seed):
    scene, _ = linked("equilibrium_dimer_3d")
    packing = scene.packing
    image = np.random.default_rng(seed).integers(-2, 3, size=packing.position_nd.shape)
    moved = packing.replace(
        position_nd=packing.position_nd - image @ packing.box.lattice_dd.T, links=packing.links.moved(image)
    )
    one, other = (
        np.linalg.eigvalsh(pm.dynamical_matrix(scene.replace(packing=p), "free").toarray()) for p in (packing, moved)
    )
    assert np.abs(one - other).max() < 1e-12


def test_matrices_beyond_the_memory_limit_are_refused_with_their_size(linked):
    scene, _ = linked("equilibrium_dimer_2d")
    for call in (
        lambda limit: pm.change_of_basis(scene.packing, memory_limit=limit),
        lambda limit: pm.constrained_rigidity_matrix(scene.packing, memory_limit=limit),
        lambda limit: pm.n_matrix(scene.packing, memory_limit=limit),
        lambda limit: pm.dynamical_matrix(scene, "free", memory_limit=limit),
    ):
        assert call(1e6).shape[0]
        with pytest.raises(ValueError, match=r"^memory_limit must be at least [\d.e+]+ bytes .* (23 by 18|21 by 21)"):
            call(1e3)
