"""Facts about order: exact values of crystals, rotations, stored points, Voronoi cells that fill the box, freud."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import packmech as pm

# Q4, Q6 as closed forms, and W4, W6: rational numbers times roots, to the digits of Mickel et al. 2013
Q = {
    "fcc": ((7 / 192) ** 0.5, (169 / 512) ** 0.5, -0.159317, -0.013161),
    "hcp": (7 / 72, (29237 / 124416) ** 0.5, 0.134097, -0.012442),
    "bcc": ((7 / 27) ** 0.5, (32 / 81) ** 0.5, -0.159317, 0.013161),
    "sc": ((7 / 12) ** 0.5, (1 / 8) ** 0.5, 0.159317, 0.013161),
}


def turned(packing, rotation):
    """Return the packing and its box turned."""
    return packing.replace(position_nd=packing.position_nd @ rotation.T, box=pm.Box(rotation @ packing.box.lattice_dd))


def rotation_of(dimension, seed=1):
    if dimension == 3:
        return Rotation.random(random_state=seed).as_matrix()
    return np.array([[np.cos(0.7), -np.sin(0.7)], [np.sin(0.7), np.cos(0.7)]])


@pytest.mark.parametrize("rule", ["contact", "voronoi"])
@pytest.mark.parametrize(
    ("kind", "psi4", "psi6"), [("triangular", 0.0, 1.0), ("square", 1.0, 0.0), ("honeycomb", 0.0, 1.0)]
)
def test_plane_crystals_have_exact_order_however_they_are_turned(kind, psi4, psi6, rule, lattices):
    crystal = turned(pm.lattice_packing(kind, repeats=(4, 5)), rotation_of(2))
    for fold, wanted in ((4, psi4), (6, psi6)):
        found = pm.bond_orientational_order(crystal, fold, rule)
        # opposite phases of the two kinds of sites of a honeycomb agree at six
        assert found.global_order == pytest.approx(wanted, abs=1e-12)
        assert found.local_order == pytest.approx(wanted, abs=1e-12)
        assert found.bond_weighted_order == pytest.approx(wanted, abs=1e-12)
    assert found.neighbors.count_n.max() == lattices[{"triangular": "hex"}.get(kind, kind)]["z"]


@pytest.mark.parametrize("kind", ["fcc", "hcp", "bcc", "sc"])
def test_crystals_in_space_have_exact_order_however_they_are_turned(kind, lattices):
    crystal = pm.lattice_packing(kind, repeats=(3, 3, 3))
    for one in (crystal, turned(crystal, rotation_of(3))):
        near = pm.find_neighbors(one, "contact", gap_tolerance=1e-9)
        for degree, q, w in ((4, Q[kind][0], Q[kind][2]), (6, Q[kind][1], Q[kind][3])):
            found = pm.bond_orientational_order(one, degree, near)
            # sublattices of hcp are images of each other in a mirror, under which even harmonics differ in phase
            for value in (found.local_order, found.local_rms, found.order_n.max()):
                assert value == pytest.approx(q, abs=1e-12)
            assert np.ptp(found.w_n) < 1e-12 and found.w_n[0] == pytest.approx(w, abs=2e-6 if kind != "bcc" else 1.0)
    stored_name = {"bcc": "bcc8"}.get(kind, kind)
    assert found.global_order == pytest.approx(lattices[stored_name]["l6"]["Q_global"], abs=1e-12)


def test_voronoi_cells_of_bcc_have_fourteen_faces_and_their_exact_order():
    found = pm.bond_orientational_order(pm.lattice_packing("bcc", repeats=(3, 3, 3)), 6)
    assert found.neighbors.count_n.tolist() == [14] * 27
    assert found.local_order == pytest.approx((169 / 648) ** 0.5, abs=1e-12)


@pytest.mark.parametrize("degree", [1, 2, 5, 6, 12])
def test_spherical_harmonics_are_those_of_scipy(degree, scattered):
    from scipy import special

    packing = scattered(3, particles=40)
    near = pm.find_neighbors(packing, "cutoff", cutoff=2.0)
    found = pm.bond_orientational_order(packing, degree, near).q_nm
    x, y, z = near.vector_pd.T
    polar, azimuth = np.arccos(z / np.sqrt(x * x + y * y + z * z)), np.arctan2(y, x)
    for m in range(-degree, degree + 1):
        if hasattr(special, "sph_harm_y"):
            value = special.sph_harm_y(degree, m, polar, azimuth)
        else:
            value = special.sph_harm(m, degree, azimuth, polar)
        mean = np.zeros(40, complex)
        np.add.at(mean, near.i_p, value)
        np.testing.assert_allclose(found[:, m + degree], mean / np.maximum(near.count_n, 1), atol=1e-12)


def test_third_order_invariants_are_integrals_of_cubes(scattered):
    """The integral of the cube of a function is W_l (l l l; 0 0 0) (2l+1)^1.5 / sqrt(4 pi)."""
    degree = 6
    packing = scattered(3, particles=12)
    found = pm.bond_orientational_order(packing, degree, "cutoff", cutoff=2.2)
    # a real function with these coefficients, integrated by Gauss-Legendre and equal angles
    node, weight = np.polynomial.legendre.leggauss(24)
    phi = 2.0 * np.pi * np.arange(48) / 48
    sine = np.sqrt(1.0 - node**2)
    point = np.stack(
        [np.outer(sine, np.cos(phi)), np.outer(sine, np.sin(phi)), np.outer(node, np.ones(48))], axis=-1
    ).reshape(-1, 3)
    alone = pm.find_neighbors(packing, "cutoff", cutoff=2.2)
    values = []
    counted = np.flatnonzero(found.counted_n)
    assert len(counted) > 5
    for n in counted:
        bond = alone.vector_pd[alone.i_p == n]
        bond = bond / np.linalg.norm(bond, axis=1, keepdims=True)
        legendre = np.polynomial.legendre.Legendre.basis(degree)(point @ bond.T)
        # sum over m of q_m conj(Y_m) is (2l + 1) / (4 pi) times the mean of P_l over bonds
        function = (2 * degree + 1) / (4.0 * np.pi) * legendre.mean(axis=1)
        both = np.repeat(weight, 48) * 2.0 * np.pi / 48
        values.append((both * function**3).sum() / (both * function**2).sum() ** 1.5)
    # (6 6 6; 0 0 0) = -20 / sqrt(46189)
    gaunt = (2 * degree + 1) ** 1.5 / np.sqrt(4.0 * np.pi) * -20.0 / 46189**0.5
    np.testing.assert_allclose(found.w_n[counted] * gaunt, values, atol=1e-12)


def test_stored_points_have_the_stored_order(stored):
    packing, points = stored.packing, stored.points
    found = pm.bond_orientational_order(packing, 6, "cutoff", cutoff=points["rc"])
    assert found.neighbors.count_n.tolist() == [int(one) for one in points["n_neigh"]]
    np.testing.assert_allclose(found.psi_n, np.array(points["psi6_re"]) + 1j * np.array(points["psi6_im"]), atol=1e-12)
    assert found.global_order == pytest.approx(points["psi6_global"], abs=1e-12)
    assert found.local_order == pytest.approx(points["psi6_local"], abs=1e-12)
    theta = np.array(points["theta"])
    shapes = pm.Spheroids(np.full(80, 2.0), np.stack([np.cos(theta), np.sin(theta)], axis=1))
    nematic = pm.nematic_order(packing.replace(shapes=shapes))
    assert nematic.order == pytest.approx(points["P2_2D"], abs=1e-12)
    along = np.array([np.cos(points["director_angle"]), np.sin(points["director_angle"])])
    assert abs(nematic.director_d @ along) == pytest.approx(1.0, abs=1e-12)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("particles", [1, 2, 40])
def test_voronoi_neighbors_are_mutual_and_pyramids_over_their_faces_fill_the_box(dimension, particles, scattered):
    packing = scattered(dimension, particles=particles)
    near = pm.find_neighbors(packing, "voronoi", smallest_face=0.0)
    # the volume of a cell is the sum of its pyramids, with half the distance as height
    volume = (near.face_p * np.linalg.norm(near.vector_pd, axis=1)).sum() / (2.0 * dimension)
    assert volume == pytest.approx(packing.box.volume, rel=1e-12)
    there = {(i, j, *z) for i, j, z in zip(near.i_p, near.j_p, near.image_pd.tolist(), strict=True)}
    assert {(j, i, *(-a for a in z)) for i, j, *z in there} == there
    order = np.lexsort((*near.image_pd.T[::-1], near.j_p, near.i_p))
    assert np.array_equal(order, np.arange(len(near)))
    if dimension == 2:
        assert len(near) == 6 * particles


def test_voronoi_neighbors_are_those_with_a_point_nearer_to_no_other(scattered, images):
    """The middle of a face's line of centers, where it lies inside: brute force over images."""
    packing = scattered(2, particles=30)
    near = pm.find_neighbors(packing)
    there = {(i, j, *z) for i, j, z in zip(near.i_p, near.j_p, near.image_pd.tolist(), strict=True)}
    vector = images(packing)
    place, step = packing.box.wrap(packing.position_nd)
    shift = np.array([[a, b] for a in range(-3, 4) for b in range(-3, 4)])
    found = 0
    for i in range(30):
        every = vector[i].reshape(-1, 2)
        for j in range(30):
            for s, v in enumerate(vector[i, j]):
                length = np.linalg.norm(v)
                if 0.0 < length < 3.0 and np.linalg.norm(every - 0.5 * v, axis=1).min() > 0.5 * length * (1.0 - 1e-9):
                    image = shift[s] - step[j] + step[i]
                    assert (i, j, *image.tolist()) in there
                    found += 1
    assert 0.5 * len(near) < found < len(near)


@pytest.mark.parametrize("dimension", [2, 3])
def test_order_does_not_know_turned_axes_equivalent_boxes_or_names_of_particles(dimension, scattered):
    packing = scattered(dimension, particles=50)
    change = np.eye(dimension, dtype=int)
    change[0, 1] = 3
    other = turned(packing.replace(box=pm.Box(packing.box.lattice_dd @ change)), rotation_of(dimension))
    order = np.random.default_rng(1).permutation(50)
    one, two = (pm.bond_orientational_order(each) for each in (packing, other.select(order)))
    np.testing.assert_allclose(two.order_n, one.order_n[order], atol=1e-11)
    assert two.global_order == pytest.approx(one.global_order, abs=1e-12)
    if dimension == 3:
        np.testing.assert_allclose(two.w_n, one.w_n[order], atol=1e-10)


def test_particles_without_neighbors_count_in_no_mean():
    crystal = pm.lattice_packing("triangular", repeats=(4, 4))
    smaller = crystal.replace(radius_n=np.where(np.arange(16) == 5, 0.1, 0.5))
    found = pm.bond_orientational_order(smaller, 6, "contact")
    assert found.neighbors.count_n[5] == 0 and found.psi_n[5] == 0.0
    assert found.without_neighbors == 1 and "; 1 of them without any are left out of the means" in repr(found)
    assert found.global_order == pytest.approx(np.abs(np.delete(found.psi_n, 5).mean()), abs=1e-15)
    none = pm.bond_orientational_order(crystal, 6, "cutoff", cutoff=0.5)
    assert np.isnan(none.global_order) and np.isnan(none.local_order) and none.without_neighbors == 16


def test_in_space_particles_without_neighbors_are_counted_and_left_out_of_every_mean():
    crystal = pm.lattice_packing("fcc", repeats=(2, 2, 2), conventional=True)
    whole = pm.bond_orientational_order(crystal, 6, "contact")
    small = crystal.replace(radius_n=np.where(np.arange(crystal.particles) < 2, 0.2, crystal.radius_n))
    found = pm.bond_orientational_order(small, 6, "contact")
    assert whole.without_neighbors == 0 and "left out" not in repr(whole)
    assert found.without_neighbors == 2 and found.counted_n.tolist() == [False] * 2 + [True] * (crystal.particles - 2)
    kept = found.component_nm[2:]
    assert found.global_order == pytest.approx(np.linalg.norm(kept.mean(axis=0)), rel=1e-14)
    assert found.local_order == pytest.approx(np.linalg.norm(kept, axis=1).mean(), rel=1e-14)
    # times the share of those that count it is the mean over all, where the others are zero
    share = 1.0 - 2.0 / crystal.particles
    assert found.global_order * share == pytest.approx(np.linalg.norm(found.component_nm.mean(axis=0)), rel=1e-14)
    none = pm.bond_orientational_order(crystal, 6, "cutoff", cutoff=0.1)
    assert np.isnan(none.global_w) and np.isnan(none.bond_weighted_order)


def test_nematic_order_says_how_many_round_particles_it_leaves_out():
    shapes = pm.Spheroids([2.0, 1.0, 2.0], [[1.0, 0.0]] * 3)
    packing = pm.Packing([[1.0, 1.0], [3.0, 3.0], [5.0, 1.0]], [0.5] * 3, pm.Box.cubic(6.0, 2), shapes=shapes)
    found = pm.nematic_order(packing)
    assert float(found) == pytest.approx(1.0) and found.round_particles == 1
    assert "of 2 directors" in repr(found) and "1 round particles left out" in repr(found)


def test_nematic_order_of_parallel_and_crossed_directors():
    for dimension in (2, 3):
        axis = np.eye(dimension)
        box, place = pm.Box.cubic(9.0, dimension), np.arange(6 * dimension).reshape(6, dimension) * 0.3
        unit = rotation_of(dimension)[:, 0]
        sign = np.array([1.0, -1.0, -1.0, 1.0, 1.0, 1.0])[:, None]
        same = pm.Packing(place, np.full(6, 0.2), box, shapes=pm.Spheroids(np.full(6, 2.0), sign * unit))
        found = pm.nematic_order(same)
        assert float(found) == pytest.approx(1.0, abs=1e-12)
        assert abs(found.director_d @ unit) == pytest.approx(1.0, abs=1e-12)
        crossed = pm.Spheroids(np.full(6, 2.0), axis[np.arange(6) % dimension])
        assert float(pm.nematic_order(same.replace(shapes=crossed))) == pytest.approx(0.0, abs=1e-12)


def test_random_directors_in_a_plane_have_the_order_of_their_number():
    rng = np.random.default_rng(1)
    found = []
    for _ in range(200):
        theta = rng.uniform(0.0, np.pi, 100)
        shapes = pm.Spheroids(np.full(100, 1.5), np.stack([np.cos(theta), np.sin(theta)], axis=1))
        place = rng.random((100, 2)) * 9.0
        found.append(float(pm.nematic_order(pm.Packing(place, np.full(100, 0.1), pm.Box.cubic(9.0, 2), shapes=shapes))))
    assert np.mean(found) == pytest.approx((np.pi / 400.0) ** 0.5, rel=4 * 0.52 / 200**0.5)


def test_dimers_point_along_their_beads_and_round_particles_count_nowhere(scattered):
    start = pm.random_packing(12, dimension=3, packing_fraction=0.2, seed=1, shapes=pm.Dimer(0.8))
    beads = start.shapes
    arm = beads.arms(start.radius_n)[1::2]
    wanted = arm / np.linalg.norm(arm, axis=1, keepdims=True)
    found = pm.nematic_order(start)
    assert np.abs((found.direction_nd * wanted).sum(axis=1)) == pytest.approx(np.ones(12), abs=1e-12)
    with pytest.raises(ValueError, match="must have shapes with a director"):
        pm.nematic_order(scattered(2))
    mixed = pm.Spheroids([2.0, 1.0], [[1.0, 0.0], [0.0, 1.0]])
    two = pm.Packing([[0.0, 0.0], [2.0, 0.0]], [0.5, 0.5], pm.Box.cubic(5.0, 2), shapes=mixed)
    assert float(pm.nematic_order(two)) == pytest.approx(1.0) and len(pm.nematic_order(two).direction_nd) == 1


def test_bodies_that_touch_at_two_beads_are_neighbors_once():
    square = pm.Packing([[0.0, 0.0], [1.0, 0.0], [0.0, 0.99], [1.0, 0.99]], [0.5] * 4, pm.Box.cubic(6.0, 2))
    bodies = pm.rigid_packing(square, [0, 0, 1, 1])
    assert len(pm.find_shape_contacts(bodies)) == 2
    assert pm.find_neighbors(bodies, "contact").count_n.tolist() == [1, 1]


def test_scaled_cutoffs_are_in_sums_of_radii_and_cutoffs_belong_to_their_rules(scattered, images):
    packing = scattered(2, particles=50)
    distance = np.linalg.norm(images(packing), axis=-1)
    scaled = distance / (packing.radius_n[:, None] + packing.radius_n)[:, :, None]
    near = pm.find_neighbors(packing, "scaled cutoff", cutoff=1.6)
    assert len(near) == ((scaled <= 1.6) & (distance > 0.0)).sum() and "1.6 sums of radii" in near.rule
    for rule, cutoff in (("voronoi", 1.0), ("cutoff", None), ("contact", 1.0)):
        with pytest.raises(ValueError, match="cutoff must be given for the rules with one only"):
            pm.find_neighbors(packing, rule, cutoff=cutoff)
    with pytest.raises(ValueError, match="neighbors must be those of the packing, of 40 particles, got 50"):
        pm.bond_orientational_order(scattered(2, particles=40), 6, near)


def test_freud_agrees_on_order(scattered):
    freud = pytest.importorskip("freud")
    # points that come near each other have no angles in single precision
    packing = pm.lattice_packing("triangular", repeats=(10, 12))
    packing = packing.replace(position_nd=packing.position_nd + np.random.default_rng(2).normal(size=(120, 2)) * 0.12)
    lattice = packing.box.lattice_dd
    box = freud.box.Box(lattice[0, 0], lattice[1, 1], xy=lattice[0, 1] / lattice[1, 1], is2D=True)
    place = box.wrap(np.column_stack([packing.position_nd, np.zeros(120)]))
    voronoi = freud.locality.Voronoi().compute((box, place))
    hexatic = freud.order.Hexatic(k=6).compute((box, place), neighbors=voronoi.nlist)
    found = pm.bond_orientational_order(packing, 6, smallest_face=0.0)
    np.testing.assert_allclose(found.psi_n, hexatic.particle_order, atol=5e-5)
    shapes = pm.Spheroids(np.full(120, 2.0), np.random.default_rng(1).normal(size=(120, 2)))
    nematic = freud.order.Nematic().compute(np.column_stack([shapes.director_nd, np.zeros(120)]))
    assert float(pm.nematic_order(packing.replace(shapes=shapes))) == pytest.approx(
        (4.0 * nematic.order - 1.0) / 3.0, abs=5e-5
    )
    space = scattered(3)
    h = space.box.lattice_dd
    box = freud.box.Box(*np.diag(h), h[0, 1] / h[1, 1], h[0, 2] / h[2, 2], h[1, 2] / h[2, 2])
    place = box.wrap(space.position_nd)
    for degree in (4, 6):
        other = freud.order.Steinhardt(degree, wl=True, wl_normalize=True)
        other.compute((box, place), neighbors={"r_max": 2.5, "exclude_ii": True})
        found = pm.bond_orientational_order(space, degree, "cutoff", cutoff=2.5)
        np.testing.assert_allclose(found.w_n, other.particle_order, atol=5e-5)
        other = freud.order.Steinhardt(degree).compute((box, place), neighbors={"r_max": 2.5, "exclude_ii": True})
        np.testing.assert_allclose(found.order_n, other.particle_order, atol=5e-5)
        assert found.global_order == pytest.approx(other.order, abs=5e-5)


def test_centers_at_one_place_have_no_bond_and_no_cells():
    both = pm.Packing([[0.0, 0.0], [0.0, 0.0], [1.0, 1.0]], [0.1] * 3, pm.Box.cubic(3.0, 2))
    with pytest.raises(ValueError, match="no coincident centers for Voronoi cells, got one of them at .* particle 1"):
        pm.find_neighbors(both)
    with pytest.raises(ValueError, match="neighbors must have centers apart, got particles 0 and 1"):
        pm.bond_orientational_order(both, 6, "cutoff", cutoff=1.0)
