"""Facts about the elastic moduli of packings with links."""

import functools

import numpy as np
import pytest
import scipy.optimize

import packmech as pm
from packmech.constraints.factor import ConstraintFactor
from packmech.linalg.mandel import mandel_basis, mandel_vector
from packmech.mechanics.elasticity import reuss_average, voigt_average

AT_REST = ["equilibrium_chain_2d", "equilibrium_dimer_2d", "equilibrium_dimer_3d", "equilibrium_trimer_2d"]


@pytest.mark.parametrize("name", AT_REST)
def test_moduli_are_the_stored_ones(linked, name):
    scene, data = linked(name)
    moduli = pm.elastic_moduli(scene)
    assert np.abs(moduli.cauchy - np.array(data["C_cauchy_mandel"])).max() < 1e-9
    for kind, stored in (("exact", "S_exact_mandel"), ("paper", "S_paper_times_V_mandel")):
        expected = np.array(data[stored])
        for method in ("sparse", "pseudoinverse"):
            mine = pm.compliance_matrix(scene, kind=kind, method=method)
            assert np.abs(mine - expected).max() < 1e-9 * np.abs(expected).max()
        average = pm.elastic_moduli(scene, kind=kind)
        expected = data[f"averages_{kind}"]
        # the chains without their links' forces are unstable: the formulas still hold, but they average nothing
        assert average.stable == ((name, kind) != ("equilibrium_chain_2d", "paper"))
        voigt, reuss = voigt_average(average.energy), reuss_average(average.energy, average.soft_directions)
        for letter, one in (("V", voigt), ("R", reuss)):
            assert one.bulk_modulus == pytest.approx(expected[f"K_{letter}"], rel=1e-9)
            assert one.shear_modulus == pytest.approx(expected[f"G_{letter}"], rel=1e-9)
        hill = average.average("hill", tangent="energy")
        if not average.stable:
            assert np.isnan([hill.bulk_modulus, hill.shear_modulus, hill.poisson_ratio, hill.young_modulus]).all()
            continue
        assert [average.average(bound, tangent="energy") for bound in ("voigt", "reuss")] == [voigt, reuss]
        assert hill.bulk_modulus == pytest.approx(expected["K_H"], rel=1e-9)
        assert hill.shear_modulus == pytest.approx(expected["G_H"], rel=1e-9)
        assert hill.poisson_ratio == pytest.approx(expected["nu_H"], rel=1e-9)
        assert hill.young_modulus == pytest.approx(expected["E_H"], rel=1e-9)
    assert moduli.stable and moduli.negative_modes == 0 and not len(moduli.stiff_directions)


def test_moduli_near_jamming_are_the_stored_ones(linked):
    scene, data = linked("jammed_dimer_strain")
    expected = np.array(data["S_exact_mandel"])
    for method in ("sparse", "pseudoinverse"):
        mine = pm.compliance_matrix(scene, method=method)
        assert np.abs(mine - expected).max() < 1e-9 * np.abs(expected).max()


@pytest.mark.parametrize("name", AT_REST)
def test_paper_kind_is_wrong_by_the_curvature_of_the_links(linked, name):
    scene, data = linked(name)
    exact, paper = (pm.compliance_matrix(scene, kind=kind) for kind in ("exact", "paper"))
    stored = np.abs(np.array(data["S_exact_mandel"]) - np.array(data["S_paper_times_V_mandel"])).max()
    assert np.abs(exact - paper).max() == pytest.approx(stored, rel=1e-9)
    assert stored > 0.02 * np.abs(exact).max()


# -- independent methods -----------------------------------------------------------------------------------------------


def relaxed(scene):
    """Return the scene at rest under its links: Newton on positions and multipliers."""
    for _ in range(30):
        packing = scene.packing
        links = ConstraintFactor(packing)
        rows = links.gradient_lx.toarray()
        error = links.pairs.distance_c - packing.links.length_l
        push = pm.forces(scene).ravel()
        matrix = np.block(
            [[pm.hessian(scene, strain="none").toarray(), rows.T], [rows, np.zeros((len(rows), len(rows)))]]
        )
        step = np.linalg.lstsq(matrix, np.concatenate([push, -error]), rcond=1e-11)[0][: push.size]
        step = (step.reshape(-1, packing.dimension) - step.reshape(-1, packing.dimension).mean(axis=0)).ravel()
        packing = packing.replace(position_nd=packing.position_nd + step.reshape(-1, packing.dimension))
        scene = scene.replace(packing=packing)
        if np.abs(step).max() < 1e-14:
            break
    return scene


@functools.cache
def made(shape, dimension, seed):
    """Return three rigid trimers, or one flexible chain, at rest in a small box."""
    rng = np.random.default_rng(seed)
    if shape == "trimer":
        corner = np.array([[0.0, 0.0], [1.0, 0.0], [0.45, 0.8]])
        corner = np.hstack([corner, np.zeros((3, dimension - 2))])
        place, pairs = [], []
        for k in range(3):
            turn = np.linalg.qr(rng.normal(size=(dimension, dimension)))[0]
            place.append(corner @ turn.T + rng.uniform(0, 2, size=dimension))
            pairs += [(3 * k, 3 * k + 1), (3 * k + 1, 3 * k + 2), (3 * k, 3 * k + 2)]
        place = np.vstack(place)
    else:
        step = rng.normal(size=(7, dimension))
        place = np.vstack([np.zeros(dimension), np.cumsum(step / np.linalg.norm(step, axis=1)[:, None], axis=0)])
        pairs = [(k, k + 1) for k in range(7)]
    i, j = np.array(pairs).T
    length = np.linalg.norm(place[j] - place[i], axis=1)
    links = pm.Links(i, j, np.zeros((len(i), dimension)), length)
    box = pm.Box(np.array([[2.0, 0.3, 0.1], [0.0, 2.1, -0.2], [0.0, 0.0, 1.9]])[:dimension, :dimension] * 0.9)
    packing = pm.Packing(place, np.full(len(place), 0.5), box, links)
    scene = pm.Scene(packing, (pm.Repulsion(),))

    def at(x):
        return scene.replace(packing=scene.packing.replace(position_nd=x.reshape(-1, dimension)))

    def lengths(x):
        moved = at(x).packing
        return np.linalg.norm(links.vectors(moved.position_nd, moved.box.lattice_dd), axis=1) - links.length_l

    found = scipy.optimize.minimize(
        # on the way links are not at their lengths, which the calls refuse
        lambda x: pm.energy.__wrapped__(at(x)),
        place.ravel(),
        jac=lambda x: -pm.forces.__wrapped__(at(x)).ravel(),
        constraints={
            "type": "eq",
            "fun": lengths,
            "jac": lambda x: ConstraintFactor(at(x).packing).gradient_lx.toarray(),
        },
        method="SLSQP",
        options={"maxiter": 500, "ftol": 1e-14},
    )
    return relaxed(at(found.x))


def strained(scene, gradient):
    """Return the scene after its box was deformed and its particles relaxed under the links."""
    packing = scene.packing
    stretch = np.eye(packing.dimension) + gradient
    return relaxed(
        scene.replace(
            packing=packing.replace(position_nd=packing.position_nd @ stretch.T, box=packing.box.strained(gradient))
        )
    )


CASES = [*AT_REST, ("trimer", 3, 4), ("chain", 3, 2)]


@pytest.fixture(params=CASES, ids=str)
def resting(request, linked):
    scene = linked(request.param)[0] if isinstance(request.param, str) else made(*request.param)
    moduli = pm.elastic_moduli(scene)
    assert moduli.force_residual < 1e-11 and moduli.negative_positions == 0
    return scene, moduli


def test_cauchy_stiffness_is_the_change_of_total_stress_of_the_relaxed_packing(resting):
    scene, moduli = resting
    rng = np.random.default_rng(1)
    dimension = scene.packing.dimension
    direction = rng.normal(size=(dimension, dimension))
    direction = (direction + direction.T) / 2.0
    direction /= np.linalg.norm(direction)
    expected = moduli.cauchy @ mandel_vector(direction)
    error = []
    for step in (4e-4, 2e-4, 1e-4):
        up, down = (pm.stress_tensor(strained(scene, sign * step * direction)) for sign in (1.0, -1.0))
        error.append(np.abs(mandel_vector((up - down) / (2.0 * step)) - expected).max() / np.abs(expected).max())
    # central differences: a fourth of the error for half the step
    assert error[0] / error[1] == pytest.approx(4.0, abs=0.4)
    assert error[1] / error[2] == pytest.approx(4.0, abs=0.4)
    slope = (4.0 * error[2] - error[1]) / 3.0
    assert abs(slope) < 1e-6


def test_energy_stiffness_is_the_second_derivative_of_the_relaxed_energy(resting):
    scene, moduli = resting
    volume, here = scene.packing.box.volume, pm.energy(scene)
    for k, basis in enumerate(mandel_basis(scene.packing.dimension)):
        values = []
        for step in (8e-4, 4e-4, 2e-4):
            up, down = (pm.energy(strained(scene, sign * step * basis)) for sign in (1.0, -1.0))
            values.append((up - 2.0 * here + down) / step**2 / volume)
        first, second = values[0] - values[1], values[1] - values[2]
        # central differences: a fourth of the error for half the step. Rounding of three energies, over step^2
        rounding = 16.0 * np.finfo(float).eps * here / 2e-4**2 / volume
        assert first / second == pytest.approx(4.0, abs=0.1 + 5.0 * rounding / abs(second))
        # Richardson, twice: what is left is of sixth order. Strains of 1e-3 over overlaps of 0.1 or more leave far less
        # than 1e-6 of it, and rounding, estimated above, at most 4e-7 (a modulus of 0.04 beside an energy of 0.5)
        once = [(4.0 * fine - coarse) / 3.0 for coarse, fine in zip(values[:2], values[1:], strict=True)]
        assert (16.0 * once[1] - once[0]) / 15.0 == pytest.approx(moduli.energy[k, k], rel=1e-6)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_moduli_scale_as_energy_over_volume(linked, scale):
    scene, _ = linked("equilibrium_chain_2d")
    packing = scene.packing
    other = pm.Packing(
        scale * packing.position_nd,
        scale * packing.radius_n,
        pm.Box(scale * packing.box.lattice_dd),
        packing.links.scaled(scale),
    )
    one, two = pm.elastic_moduli(scene), pm.elastic_moduli(scene.replace(packing=other))
    assert np.abs(two.cauchy * scale**2 - one.cauchy).max() < 1e-11 * np.abs(one.cauchy).max()


def test_moduli_turn_with_the_packing(linked):
    scene, _ = linked("equilibrium_trimer_2d")
    packing = scene.packing
    c, s = np.cos(0.7), np.sin(0.7)
    turn = np.array([[c, -s], [s, c]])
    turned = packing.replace(position_nd=packing.position_nd @ turn.T, box=pm.Box(turn @ packing.box.lattice_dd))
    one, two = pm.elastic_moduli(scene), pm.elastic_moduli(scene.replace(packing=turned))
    for bound in ("voigt", "reuss"):
        assert two.average(bound).bulk_modulus == pytest.approx(one.average(bound).bulk_modulus, rel=1e-11)
        assert two.average(bound).shear_modulus == pytest.approx(one.average(bound).shear_modulus, rel=1e-11)


def test_links_that_close_around_the_box_make_a_direction_infinitely_stiff():
    # rows of a square lattice linked along x all around the box, pressed together along y
    n = 4
    place = np.array([[i, 0.98 * j] for j in range(n) for i in range(n)], dtype=float)
    number = np.arange(n * n).reshape(n, n)
    i, j = number.ravel(), np.roll(number, -1, axis=1).ravel()
    image = np.zeros((n * n, 2))
    image[number[:, -1], 0] = 1
    links = pm.Links(i, j, image, np.ones(n * n))
    packing = pm.Packing(place, np.full(n * n, 0.5), pm.Box(np.diag([n, 0.98 * n])), links)
    scene = pm.Scene(packing, (pm.Repulsion(),))
    moduli = pm.elastic_moduli(scene)
    assert np.abs(np.abs(moduli.stiff_directions) - [[1.0, 0.0, 0.0]]).max() < 1e-12
    assert moduli.bulk_modulus == np.inf
    # pressed rows buckle, so that only without the forces there are averages
    assert not moduli.stable and np.isnan(moduli.voigt.shear_modulus)
    assert pm.elastic_moduli(scene, kind="unstressed").voigt.shear_modulus == np.inf
    # along y the rows are springs in series: k a^2 / V per contact with the exact curvature at overlap 0.02
    assert moduli.energy[1, 1] == pytest.approx(0.98**2 / 0.98, rel=1e-10)
    assert np.abs(moduli.energy[0]).max() == 0.0
    for method in ("sparse", "pseudoinverse"):
        compliance = pm.compliance_matrix(scene, kind="unstressed", method=method)
        assert np.abs(compliance[0, :2]).max() < 1e-12 and np.isinf(compliance[2, 2])
        assert compliance[1, 1] == pytest.approx(1.0 / 0.98, rel=1e-10)


def test_box_all_of_links_has_no_compliance_at_all():
    # one particle linked to its own images along three directions
    lattice = np.array([[1.0, 0.5], [0.0, 0.75**0.5]])
    links = pm.Links([0, 0, 0], [0, 0, 0], [[1, 0], [0, 1], [1, -1]], [1.0] * 3)
    packing = pm.Packing([[0.0, 0.0]], [0.4], pm.Box(lattice), links)
    moduli = pm.elastic_moduli(pm.Scene(packing, (pm.Repulsion(),)))
    assert len(moduli.stiff_directions) == 3
    assert moduli.voigt.bulk_modulus == moduli.reuss.bulk_modulus == np.inf
    assert moduli.voigt.shear_modulus == moduli.reuss.shear_modulus == moduli.simple_shear(0, 1) == np.inf
    assert not moduli.compliance.any() and not moduli.cauchy.any() and not moduli.energy.any()
    for method in ("sparse", "pseudoinverse"):
        assert not pm.compliance_matrix(pm.Scene(packing, (pm.Repulsion(),)), method=method).any()


def test_cluster_without_contacts_changes_no_modulus(linked):
    scene, _ = linked("equilibrium_chain_2d")
    packing = scene.packing
    # two tiny beads in a hole, linked
    grid = packing.box.lattice_dd @ np.random.default_rng(0).uniform(size=(2, 4000))
    wide = min(grid.T, key=lambda x: -hole(packing, x))
    size = hole(packing, wide)
    assert size > 0.02
    links = packing.links
    more = pm.Packing(
        np.vstack([packing.position_nd, wide, wide + [0.2 * size, 0.0]]),
        np.append(packing.radius_n, [0.3 * size] * 2),
        packing.box,
        pm.Links(
            np.append(links.i_l, packing.particles),
            np.append(links.j_l, packing.particles + 1),
            np.vstack([links.image_ld, [[0, 0]]]),
            np.append(links.length_l, 0.2 * size),
        ),
    )
    one, two = pm.elastic_moduli(scene), pm.elastic_moduli(scene.replace(packing=more))
    assert np.array_equal(one.cauchy, two.cauchy) and two.particles == one.particles
    kept = pm.elastic_moduli(scene.replace(packing=more), rattlers="keep")
    assert np.abs(kept.cauchy - one.cauchy).max() < 1e-9 * np.abs(one.cauchy).max()
    assert kept.floppy_positions == 3


def hole(packing, x):
    """Return how far the point is from the nearest particle's surface."""
    shift = np.array([[a, b] for a in (-1, 0, 1) for b in (-1, 0, 1)]) @ packing.box.lattice_dd.T
    place, _ = packing.box.wrap(packing.position_nd)
    apart = np.linalg.norm(place[:, None] + shift - x, axis=2) - packing.radius_n[:, None]
    return apart.min()
