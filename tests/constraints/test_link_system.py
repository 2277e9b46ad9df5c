"""Facts about links in compiled loops: projections, multipliers and the way back to lengths, against dense algebra."""

import json
import pathlib

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import packmech as pm
from packmech.constraints.factor import ConstraintFactor
from packmech.constraints.link_system import make_link_system, project_links, record_link_positions, refill_links

GOLDEN = pathlib.Path(__file__).parents[1] / "golden"


def clusters(kind, dimension, seed=0, scatter=0.0):
    """Return positions, links and lattice of a few clusters of a kind, shuffled so that no order helps."""
    rng = np.random.default_rng(seed)
    size, bonds = {
        "dimer": (2, [(0, 1)]),
        "trimer": (3, [(0, 1), (1, 2), (0, 2)]),
        "chain": (9, [(k, k + 1) for k in range(8)]),
        "ring": (7, [(k, (k + 1) % 7) for k in range(7)]),
        "star": (6, [(0, k) for k in range(1, 6)]),
        "ladder": (8, [(k, k + 1) for k in range(7)] + [(k, k + 2) for k in range(6)]),
    }[kind]
    copies, lattice = 4, np.eye(dimension) * 20.0 + rng.uniform(-1, 1, (dimension, dimension))
    number = rng.permutation(size * copies)
    place = np.cumsum(rng.normal(size=(size * copies, dimension)), axis=0)
    i = np.concatenate([number[[a + size * c for a, _ in bonds]] for c in range(copies)])
    j = np.concatenate([number[[b + size * c for _, b in bonds]] for c in range(copies)])
    image = rng.integers(-1, 2, (len(i), dimension))
    links = pm.Links(i, j, image, np.ones(len(i)))
    length = np.linalg.norm(links.vectors(place, lattice), axis=1)
    links = pm.Links(links.i_l, links.j_l, links.image_ld, length)
    return place + scatter * rng.normal(size=place.shape), links, lattice


def dense_jacobian(links, position, lattice):
    vector = links.vectors(position, lattice)
    normal = vector / np.linalg.norm(vector, axis=1)[:, None]
    matrix = np.zeros((*position.shape, len(links)))
    matrix[links.j_l, :, np.arange(len(links))] += normal
    matrix[links.i_l, :, np.arange(len(links))] -= normal
    return matrix.reshape(position.size, len(links))


def projected(links, position, lattice, vector, *, of_force=True, mass=None):
    system = make_link_system(links, *position.shape, mass_n=mass)
    pivot, dependent = refill_links(system, position, lattice)
    assert dependent == 0 and 0.0 < pivot <= 1.0
    out, multiplier = np.empty_like(vector), np.empty(len(links))
    project_links(system, vector, out, multiplier, of_force)
    return out, multiplier


KINDS = [(kind, d) for kind in ("dimer", "trimer", "chain", "ring", "star", "ladder") for d in (2, 3)]


@pytest.mark.parametrize(("kind", "dimension"), KINDS)
def test_projection_is_the_orthogonal_one_onto_the_null_space_of_the_jacobian(kind, dimension):
    position, links, lattice = clusters(kind, dimension)
    force = np.random.default_rng(1).normal(size=position.shape)
    out, multiplier = projected(links, position, lattice, force)
    jacobian = dense_jacobian(links, position, lattice)
    basis, _ = np.linalg.qr(jacobian)
    expected = force.ravel() - basis @ (basis.T @ force.ravel())
    assert np.abs(out.ravel() - expected).max() < 1e-12
    assert np.abs(jacobian.T @ out.ravel()).max() < 4e-15 * np.abs(force).max()
    assert np.abs(force.ravel() - jacobian @ multiplier - out.ravel()).max() < 1e-12


def test_with_masses_forces_and_velocities_are_projected_in_the_metric_of_the_masses():
    position, links, lattice = clusters("ladder", 2)
    rng = np.random.default_rng(2)
    mass = rng.uniform(0.3, 3.0, len(position))
    vector = rng.normal(size=position.shape)
    jacobian, inverse = dense_jacobian(links, position, lattice), np.repeat(1.0 / mass, 2)
    normal_matrix = jacobian.T @ (inverse[:, None] * jacobian)
    force, of_force = projected(links, position, lattice, vector, mass=mass)
    velocity, of_velocity = projected(links, position, lattice, vector, of_force=False, mass=mass)
    assert np.allclose(of_force, np.linalg.solve(normal_matrix, jacobian.T @ (inverse * vector.ravel())), atol=1e-10)
    assert np.allclose(of_velocity, np.linalg.solve(normal_matrix, jacobian.T @ vector.ravel()), atol=1e-10)
    assert np.abs(jacobian.T @ (inverse * force.ravel())).max() < 2e-14
    assert np.abs(jacobian.T @ velocity.ravel()).max() < 1e-14


@pytest.mark.parametrize("name", ["random_chain_3d_w2.5", "random_dimer_3d_w2.0", "random_trimer_2d_w2.5"])
def test_multipliers_of_projected_contact_forces_are_the_stored_tensions(name):
    data = json.loads((GOLDEN / f"{name}.json").read_text())
    link = data["links"]
    ends = np.array([[one["i"], one["j"]] for one in link])
    links = pm.Links(*ends.T, [one["z"] for one in link], [one["length"] for one in link])
    stored = np.array(data["least_squares_link_multipliers"])[np.lexsort(ends.T[::-1])]
    position, lattice = np.array(data["positions"]), np.array(data["lattice_columns"])
    _, multiplier = projected(links, position, lattice, np.array(data["forces"]))
    assert np.abs(multiplier - stored).max() < 1e-12


@given(kind=st.sampled_from(["chain", "ring", "star", "ladder"]), seed=st.integers(0, 2**32))
def test_relabelled_particles_get_the_same_projected_force(kind, seed):
    position, links, lattice = clusters(kind, 2, seed=seed % 50)
    rng = np.random.default_rng(seed)
    force, number = rng.normal(size=position.shape), rng.permutation(len(position))
    out, _ = projected(links, position, lattice, force)
    moved = np.empty_like(position), np.empty_like(force)
    moved[0][number], moved[1][number] = position, force
    again, _ = projected(links.numbered(number), moved[0], lattice, moved[1])
    assert np.allclose(again[number], out, rtol=0, atol=1e-10)


@pytest.mark.parametrize(("kind", "dimension"), KINDS)
def test_positions_come_back_to_the_lengths(kind, dimension):
    position, links, lattice = clusters(kind, dimension, scatter=0.02)
    system = make_link_system(links, *position.shape, mean_diameter=1.0)
    iterations, error, pivot = record_link_positions(system, position, lattice, 1e-13, 12, np.empty(0))
    length = np.linalg.norm(links.vectors(position, lattice), axis=1)
    assert iterations < 12 and pivot > 0.0 and error < 1e-13
    assert (np.abs(length - links.length_l) / np.maximum(links.length_l, 1.0)).max() < 1.1e-13


def test_one_step_back_to_the_lengths_is_the_shortest():
    position, links, lattice = clusters("ladder", 3, scatter=1e-3)
    before = position.copy()
    error = np.linalg.norm(links.vectors(position, lattice), axis=1) - links.length_l
    shortest = np.linalg.lstsq(dense_jacobian(links, position, lattice).T, error, rcond=None)[0]
    record_link_positions(make_link_system(links, *position.shape), position, lattice, 0.0, 1, np.empty(0))
    assert np.abs((before - position).ravel() - shortest).max() < 1e-13


def test_a_link_that_depends_on_others_is_counted():
    place = np.array([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]])
    links = pm.Links([0, 1, 0], [1, 2, 2], np.zeros((3, 2)), [1.0, 1.0, 2.0])
    assert refill_links(make_link_system(links, 3, 2), place, 9.0 * np.eye(2)) == (0.0, 1)


@pytest.mark.parametrize("bonds", ["chain", "ring"])
def test_the_factor_of_a_long_chain_or_ring_grows_with_its_length_only(bonds):
    count = 5000
    i, j = np.arange(count - 1), np.arange(1, count)
    if bonds == "ring":
        i, j = np.append(i, 0), np.append(j, count - 1)
    number = np.random.default_rng(3).permutation(count)
    links = pm.Links(number[i], number[j], np.zeros((len(i), 2)), np.ones(len(i)))
    assert len(make_link_system(links, count, 2).factor) < 2.01 * count


# -- clusters whose links nearly depend on each other: the factor comes from rotations ---------------------------------


def straightened(dimension, beads=60, bend=0.05, reach=2, seed=3):
    """Return a chain with small bends and links to the next `reach` beads, its lattice and the shoves' generator."""
    rng = np.random.default_rng(seed)
    step = np.zeros((beads, dimension))
    step[0, 0] = 1.0
    for k in range(1, beads):
        aside = rng.normal(size=dimension)
        aside -= (aside @ step[k - 1]) * step[k - 1]
        step[k] = step[k - 1] + bend * rng.uniform(0.5, 1.0) * aside / np.linalg.norm(aside)
        step[k] /= np.linalg.norm(step[k])
    place = np.cumsum(step, axis=0)
    i = np.concatenate([np.arange(beads - u) for u in range(1, reach + 1)])
    j = np.concatenate([np.arange(u, beads) for u in range(1, reach + 1)])
    links = pm.Links(i, j, np.zeros((len(i), dimension)), np.linalg.norm(place[j] - place[i], axis=1))
    return place, links, 100.0 * np.eye(dimension), rng


@pytest.mark.parametrize("mass", [False, True])
@pytest.mark.parametrize(("dimension", "reach", "bend"), [(2, 2, 0.05), (3, 3, 0.3)])
def test_projection_holds_where_the_normal_matrix_has_lost_its_digits(dimension, reach, bend, mass):
    position, links, lattice, rng = straightened(dimension, beads=300, bend=bend, reach=reach)
    mass_n = rng.uniform(0.3, 3.0, len(position)) if mass else None
    force = rng.normal(size=position.shape)
    out, _ = projected(links, position, lattice, force, mass=mass_n)
    root = np.ones(position.size) if mass_n is None else np.repeat(mass_n**-0.5, dimension)
    jacobian = root[:, None] * dense_jacobian(links, position, lattice)
    basis, triangle = np.linalg.qr(jacobian)
    condition = np.linalg.cond(triangle)
    assert condition**2 * np.finfo(float).eps > 1e-8
    weighted = root * force.ravel()
    expected = weighted - basis @ (basis.T @ weighted)
    # both err by rounding times the condition number, and not its square
    assert np.abs(root * out.ravel() - expected).max() < 4.0 * condition * np.finfo(float).eps


@pytest.mark.parametrize(("dimension", "reach", "bend"), [(2, 2, 0.05), (3, 2, 0.05), (3, 3, 0.3)])
@pytest.mark.parametrize("shove", [1e-8, 1e-6, 1e-4, 1e-3])
def test_a_nearly_straight_chain_comes_back_to_its_lengths_nearby(dimension, reach, bend, shove):
    position, links, lattice, rng = straightened(dimension, beads=300, bend=bend, reach=reach)
    before = position + shove * rng.normal(size=position.shape)
    position = before.copy()
    system = make_link_system(links, *position.shape, mean_diameter=1.0)
    _, error, _ = record_link_positions(system, position, lattice, 1e-13, 40, np.empty(0))
    # coordinates of 300 are rounded by 5.7e-14, on each axis and at both ends
    assert error < 4e-13
    assert np.abs(position - before).max() < 10.0 * shove


# up to more than a minute each
SWUNG = [pytest.param(*one, marks=pytest.mark.slow) for one in ((5, 0.02), (4, 0.01), (0, 0.005))]


@pytest.mark.parametrize(("seed", "shove"), [*SWUNG, (3, 0.005)])
def test_a_straight_angle_does_not_let_a_full_step_swing_the_chain_round(seed, shove):
    """Full steps meet the lengths there, too, but in another shape, 70 to 320 shoves away."""
    packing = pm.chain_packing(
        1, 1000, dimension=2, packing_fraction=0.3, angles="fixed", bend=2.0 * np.pi / 3.0, seed=seed
    )
    moved = packing.position_nd + shove * np.random.default_rng(4).normal(size=packing.position_nd.shape)
    back = ConstraintFactor(packing).projected(packing.replace(position_nd=moved))
    assert back.link_error < 1e-13
    # angles leave the chain no way but as a whole: it comes back to where it was
    assert np.abs(back.position_nd - packing.position_nd).max() < 0.1 * shove


@given(shove=st.floats(1e-6, 30.0), seed=st.integers(0, 2**32), dimension=st.sampled_from([2, 3]))
def test_no_way_back_ever_raises_the_errors(shove, seed, dimension):
    position, links, lattice, _ = straightened(dimension, beads=12)
    position = position + shove * np.random.default_rng(seed).normal(size=position.shape)
    system = make_link_system(links, *position.shape, mean_diameter=1.0)
    before = record_link_positions(system, position, lattice, 1e-13, 0, np.empty(0))[1]
    _, error, _ = record_link_positions(system, position, lattice, 1e-13, 20, np.empty(0))
    length = np.linalg.norm(links.vectors(position, lattice), axis=1)
    assert error <= before and np.isfinite(position).all()
    assert np.abs(length - links.length_l).max() <= error * np.maximum(links.length_l, 1.0).max() * (1.0 + 1e-9) + 1e-13


def test_redundant_links_of_a_chain_are_left_out_and_the_rest_held():
    position, links, lattice, rng = straightened(2, beads=20, bend=1.0, reach=4)
    system = make_link_system(links, *position.shape, mean_diameter=1.0)
    _, dependent = refill_links(system, position, lattice)
    assert len(links) - dependent == 2 * 20 - 3
    force, out, multiplier = rng.normal(size=position.shape), np.empty_like(position), np.empty(len(links))
    project_links(system, force, out, multiplier, True)
    jacobian = dense_jacobian(links, position, lattice)
    assert np.abs(jacobian.T @ out.ravel()).max() < 1e-11
    assert np.count_nonzero(multiplier) <= 2 * 20 - 3
