"""Facts about packings of superellipsoids: volumes, moments, energies, rest, jamming, moduli, time steps, files."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import packmech as pm


def drawn(d, count=24, seed=1, exponent=4.0, ratios=None, packing_fraction=None):
    """Return a scene of superellipsoids of one form at random places, with a harmonic repulsion."""
    ratios = ((1.3, 1.0) if d == 2 else (1.4, 1.2, 1.0)) if ratios is None else ratios
    packing_fraction = (0.95 if d == 2 else 0.8) if packing_fraction is None else packing_fraction
    shapes = pm.Superellipses(exponent, ratios)
    packing = pm.random_packing(count, dimension=d, packing_fraction=packing_fraction, shapes=shapes, seed=seed)
    return pm.Scene(packing, (pm.Repulsion(),))


def at_rest(d, **how):
    """Return such a scene at rest."""
    scene = drawn(d, **how)
    run = pm.quench(scene, force_tolerance=1e-10)
    assert run.outcome is pm.Outcome.CONVERGED and run.residual < 1e-10
    return scene.replace(packing=run.packing)


def mixed(d, count=12, seed=3):
    """Return shapes whose exponents and axes differ, in lengths of their radii, and their radii."""
    rng = np.random.default_rng(seed)
    turn = rng.normal(size=(count, 2 if d == 2 else 4))
    return pm.Superellipsoids(rng.uniform(2.0, 8.0, count), np.exp(rng.uniform(-0.5, 0.5, (count, d))), turn)


def remade(packing):
    """Return a packing of spheroids made of superellipsoids."""
    shapes, d = packing.shapes, packing.dimension
    turn = shapes.director_nd
    if d == 3:
        found = [Rotation.align_vectors(one[None], [[1.0, 0.0, 0.0]])[0].as_quat() for one in turn]
        turn = np.roll(np.array(found), 1, axis=1)
    ratio = np.ones((packing.particles, d))
    ratio[:, 0] = shapes.aspect_n
    return packing.replace(shapes=pm.Superellipsoids(np.full(packing.particles, 2.0), ratio, turn))


@pytest.mark.parametrize("d", [2, 3])
def test_volumes_and_moments_are_those_of_a_fine_grid(d):
    shapes, radius = mixed(d, 3), 0.7
    semi, count = shapes.axes(np.full(3, radius)), 1200 if d == 2 else 160
    for n in range(3):
        edges = [np.linspace(-a, a, count, endpoint=False) + a / count for a in semi[n]]
        at = np.stack(np.meshgrid(*edges, indexing="ij"), axis=-1).reshape(-1, d)
        inside = at[(np.abs(at / semi[n]) ** shapes.exponent_n[n]).sum(axis=1) <= 1.0]
        volume = len(inside) * np.prod(2.0 * semi[n] / count)
        assert volume == pytest.approx(np.pi * radius**2 if d == 2 else 4.0 / 3.0 * np.pi * radius**3, rel=1e-3)
        square = (inside**2).mean(axis=0)
        inertia = [square.sum()] if d == 2 else square.sum() - square
        np.testing.assert_allclose((shapes.gyration_nk[n] * radius) ** 2, inertia, rtol=2e-3)


@pytest.mark.parametrize("d", [2, 3])
def test_the_reach_is_the_farthest_point_of_the_surface(d):
    shapes, rng = mixed(d, 6), np.random.default_rng(4)
    normal = rng.normal(size=(40000, 1, d))
    point = shapes.surface_points(np.tile(normal, (1, 6, 1)), np.ones(6))
    far = np.sqrt((point**2).sum(axis=2))
    assert (far <= shapes.reach(np.ones(6)) * (1.0 + 1e-12)).all()
    np.testing.assert_allclose(far.max(axis=0), shapes.reach(np.ones(6)), rtol=2e-3)
    along = (point[..., None, :] * shapes.frames().transpose(0, 2, 1)).sum(axis=3) / shapes.axes(np.ones(6))
    np.testing.assert_allclose((np.abs(along) ** shapes.exponent_n[:, None]).sum(axis=2), 1.0, rtol=1e-12)


@pytest.mark.parametrize("d", [2, 3])
def test_with_exponent_two_and_equal_axes_they_are_spheroids(d):
    """Energy, forces, stress, Hessian and minimum of a packing are those of the same one made of spheroids."""
    count, aspect, rng = 16, 1.5, np.random.default_rng(5)
    start = pm.random_packing(count, dimension=d, packing_fraction=0.95 if d == 2 else 0.8, seed=2)
    one = start.replace(shapes=pm.Spheroids(np.full(count, aspect), rng.normal(size=(count, d))))
    other = remade(one)
    one, other = (pm.Scene(packing, (pm.Repulsion(),)) for packing in (one, other))
    assert pm.energy(other) == pytest.approx(pm.energy(one), rel=1e-12)
    np.testing.assert_allclose(pm.forces(other), pm.forces(one), rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(pm.torques(other), pm.torques(one), rtol=0.0, atol=1e-12)
    np.testing.assert_allclose(pm.stress_tensor(other), pm.stress_tensor(one), rtol=1e-11)
    reach = [scene.packing.shapes.reach(start.radius_n) for scene in (one, other)]
    np.testing.assert_allclose(reach[1], reach[0], rtol=1e-14)
    # coordinates of turns differ: values along the same motions do not
    values = [np.linalg.eigvalsh(pm.hessian(scene, strain="none").toarray()) for scene in (one, other)]
    if d == 3:
        # turns about the axes of spheroids are no motions of theirs
        values[1] = np.delete(values[1], np.argsort(np.abs(values[1]), kind="stable")[:count])
        values[0] = np.sort(values[0])
    assert len(values[1]) == len(values[0])
    np.testing.assert_allclose(np.sort(values[1]), values[0], rtol=0.0, atol=1e-10 * np.abs(values[0]).max())
    # at the same minimum: from the start the two may come to rest in different ones
    rest = pm.quench(one, force_tolerance=1e-12).packing
    moduli = [pm.elastic_moduli(one.replace(packing=packing)).bulk_modulus for packing in (rest, remade(rest))]
    assert moduli[1] == pytest.approx(moduli[0], rel=1e-6)


@pytest.mark.parametrize("d", [2, 3])
def test_forces_torques_and_stress_are_slopes_of_the_energy(d):
    scene = drawn(d, count=8)
    packing, step = scene.packing, 1e-6

    def slope(change):
        return (pm.energy(scene.replace(packing=change(step))) - pm.energy(scene.replace(packing=change(-step)))) / (
            2.0 * step
        )

    def shifted(n, a):
        def change(by):
            moved = packing.position_nd.copy()
            moved[n, a] += by
            return packing.replace(position_nd=moved)

        return change

    def turned(n, a):
        def change(by):
            rotation = np.zeros((packing.particles, 1 if d == 2 else 3))
            rotation[n, a] = by
            return packing.replace(shapes=packing.shapes.turned(rotation))

        return change

    def strained(by):
        gradient = np.eye(d)
        gradient[0, 1] += by
        box = pm.Box(gradient @ packing.box.lattice_dd)
        return packing.replace(position_nd=packing.position_nd @ gradient.T, box=box)

    force, torque = pm.forces(scene), pm.torques(scene).reshape(packing.particles, -1)
    for n in (0, 5):
        for a in range(d):
            assert force[n, a] == pytest.approx(-slope(shifted(n, a)), abs=1e-8)
        for a in range(torque.shape[1]):
            assert torque[n, a] == pytest.approx(-slope(turned(n, a)), abs=1e-8)
    assert slope(strained) == pytest.approx(pm.stress_tensor(scene)[0, 1] * packing.box.volume, abs=1e-7)


@pytest.mark.parametrize("d", [2, 3])
def test_the_hessian_is_the_derivative_of_the_forces(d):
    scene = at_rest(d, count=12)
    packing, width = scene.packing, d + (1 if d == 2 else 3)
    dense, step = pm.hessian(scene, strain="none").toarray(), 1e-6
    rng = np.random.default_rng(7)
    for _ in range(3):
        way = rng.normal(size=(packing.particles, width))

        def slopes(by, way=way):
            now = packing.moved(by * way)
            there = scene.replace(packing=now)
            torque = pm.torques(there).reshape(packing.particles, -1)
            turning = np.einsum("nkt,nt->nk", packing.turn_nkt, torque)
            return -np.hstack([pm.forces(there), turning]).ravel()

        change = (slopes(step) - slopes(-step)) / (2.0 * step)
        np.testing.assert_allclose(change, dense @ way.ravel(), rtol=0.0, atol=1e-6 * np.abs(change).max())


def test_turning_a_whole_packing_changes_no_energy():
    scene = drawn(3, count=8)
    packing = scene.packing
    vector = np.array([0.4, -0.9, 0.3])
    turn = Rotation.from_rotvec(vector).as_matrix()
    shapes = packing.shapes.turned(np.tile(vector, (packing.particles, 1)))
    box = pm.Box(turn @ packing.box.lattice_dd)
    turned = packing.replace(position_nd=packing.position_nd @ turn.T, box=box, shapes=shapes)
    assert pm.energy(scene.replace(packing=turned)) == pytest.approx(pm.energy(scene), rel=1e-12)
    np.testing.assert_allclose(pm.forces(scene.replace(packing=turned)), pm.forces(scene) @ turn.T, atol=1e-12)


def test_ellipsoids_of_three_axes_touch_at_the_sums_of_their_semi_axes():
    ratio = [[3.0, 2.0, 1.5]] * 2
    shapes = pm.Superellipsoids([2.0, 2.0], ratio, [[1.0, 0.0, 0.0, 0.0]] * 2)
    radius = np.array([0.5, 0.7])
    semi = shapes.axes(radius)
    for axis in range(3):
        apart = np.zeros((2, 3))
        apart[1, axis] = semi[:, axis].sum()
        packing = pm.Packing(apart, radius, 20.0, shapes=shapes)
        contact = pm.find_shape_contacts(packing, gap_tolerance=1e-9)
        assert contact.distance_c[0] == pytest.approx(1.2, rel=1e-14)


@pytest.mark.parametrize("d", [2, 3])
def test_they_jam_in_balance_where_their_energy_has_a_minimum(d):
    exponent = 4.0 if d == 2 else 2.0
    scene = drawn(d, count=32, seed=3, exponent=exponent, packing_fraction=0.6 if d == 2 else 0.4)
    run = pm.jam(scene, pressure=1e-5, strain="isotropic")
    assert run.outcome is pm.Outcome.CONVERGED
    assert run.residual < 1e-8
    jammed = scene.replace(packing=run.packing)
    value = np.linalg.eigvalsh(pm.hessian(jammed, strain="none").toarray())
    assert value.min() > -1e-10 * value.max()
    # one state of self stress, and motions that curvature alone resists make up for the contacts that are missing
    report = run.report
    assert report["states_of_self_stress"] == 1
    assert report["contacts"] < report["isostatic_contacts"]
    assert report["floppy_modes"] == report["isostatic_contacts"] - report["contacts"]
    assert pm.classify_jamming(run.packing).collective == "jammed"


@pytest.mark.parametrize("d", [2, 3])
def test_the_bulk_modulus_is_that_of_strained_and_relaxed_packings(d):
    scene = at_rest(d, count=16)
    step = 1e-6

    def pressure(by):
        packing = scene.packing
        box = packing.box.scaled(1.0 + by)
        moved = packing.replace(position_nd=packing.position_nd * (1.0 + by), box=box)
        run = pm.quench(scene.replace(packing=moved), force_tolerance=1e-12)
        return pm.pressure(scene.replace(packing=run.packing))

    measured = -(pressure(step) - pressure(-step)) / (2.0 * step * d)
    assert pm.elastic_moduli(scene).bulk_modulus == pytest.approx(measured, rel=1e-5)


@pytest.mark.parametrize("d", [2, 3])
def test_time_steps_keep_the_energy_to_second_order(d):
    scene = at_rest(d, count=16, exponent=4.0 if d == 2 else 2.0)
    drift = [
        abs(pm.simulate(scene, steps=round(4.0 / dt), dt=dt, temperature=1e-5, seed=1).energy_drift)
        for dt in (0.04, 0.01)
    ]
    assert drift[1] < drift[0] / 8.0


def test_files_of_numpy_keep_them_exactly_and_others_refuse_them_by_name(tmp_path):
    for d in (2, 3):
        packing = pm.Packing(np.random.default_rng(1).random((12, d)), 0.1, 1.0, shapes=mixed(d))
        pm.write_packing(packing, tmp_path / "mixed.npz")
        assert pm.read_packing(tmp_path / "mixed.npz") == packing
        for ending in ("csv", "extxyz", "vtp"):
            with pytest.raises(ValueError, match="Superellipsoids"):
                pm.write_packing(packing, tmp_path / f"mixed.{ending}")


def test_wrong_shapes_and_what_is_not_known_beside_them_are_refused_by_name():
    with pytest.raises(ValueError, match="exponent_n must be from 2 to 50, got 1.5 for particle 1"):
        pm.Superellipsoids([2.0, 1.5], [[1.0, 1.0]] * 2, [[1.0, 0.0]] * 2)
    with pytest.raises(ValueError, match="ratio_nd must be positive|ratio_nd must"):
        pm.Superellipsoids([2.0], [[1.0, -1.0]], [[1.0, 0.0]])
    with pytest.raises(ValueError, match="ratios must be one for each of 3 axes"):
        pm.random_packing(4, dimension=3, packing_fraction=0.3, shapes=pm.Superellipses(4.0, (2.0, 1.0)), seed=1)
    packing = drawn(2, count=4).packing
    rough = pm.Walls(0, 0.0, 1.0, friction=pm.Friction(0.3))
    moving = pm.Walls(0, 0.0, 1.0, low_motion=pm.WallMotion(x=0.1))
    for effect, said in (
        (pm.RollingResistance(0.1, 1.0), "no RollingResistance for superellipses, whose shapes decide how they roll"),
        (rough, "must be smooth Walls, .* for superellipses"),
        (moving, "must be Walls that stand still for superellipses"),
    ):
        with pytest.raises(ValueError, match=said):
            pm.Scene(packing, (pm.Repulsion(), effect))
    with pytest.raises(ValueError, match="Superellipsoids"):
        pm.spectral_density(packing, [[1, 0]])


def test_without_contacts_they_have_no_torques_and_no_stiffness():
    scene = drawn(2, count=4, packing_fraction=0.05)
    assert not pm.torques(scene).any() and not pm.hessian(scene, strain="none").nnz
    rough = scene.replace(effects=(*scene.effects, pm.Friction(0.5)))
    assert not pm.stiffness_matrix(rough, "none").nnz


def test_their_touch_does_not_depend_on_the_unit_of_length():
    shapes = pm.Superellipsoids([8.0, 3.0], [[1.0, 1.4], [1.0, 0.7]], [[0.6, 0.8], [1.0, 0.0]])
    found = []
    for unit in (1.0, 1e-12, 1e12):
        place = unit * np.array([[1.0, 1.0], [2.2, 1.3]])
        packing = pm.Packing(place, unit * np.array([0.8, 0.8]), pm.Box.cubic(8.0 * unit, 2), shapes=shapes)
        found.append(pm.find_shape_contacts(packing).distance_c / unit)
    assert len(found[0]) == 1
    for one in found[1:]:
        assert one == pytest.approx(found[0], rel=1e-12)


ROUGH = (pm.Repulsion(), pm.Friction(10.0, 0.7, 0.1), pm.ContactDamping(0.2))


def rubbing(d, exponent=3.0):
    """Return two superellipsoids that overlap askew, and how they move and turn."""
    turn = [[0.8, 0.6], [0.1, 1.0]] if d == 2 else [[0.8, 0.6, 0.3, 0.1], [0.1, 1.0, 0.3, 0.5]]
    ratio = [[1.3, 1.0], [1.0, 1.5]] if d == 2 else [[1.3, 1.1, 1.0], [1.0, 1.2, 1.5]]
    shapes = pm.Superellipsoids([exponent, exponent + 1.0], ratio, turn)
    place = np.array([[4.0, 4.0, 4.0], [4.75, 4.3, 4.1]])[:, :d]
    packing = pm.Packing(place, [0.5, 0.45], pm.Box.cubic(8.0, d), shapes=shapes)
    rng = np.random.default_rng(4)
    velocity, spin = 0.1 * rng.normal(size=(2, d)), 0.4 * rng.normal(size=(2, 1 if d == 2 else 3))
    velocity -= packing.mass_n @ velocity / packing.mass_n.sum()
    return packing, {"velocity_nd": velocity, "spin_nk": spin}


@pytest.mark.parametrize("d", [2, 3])
def test_with_friction_and_exponent_two_they_move_as_spheroids_do(d):
    rng = np.random.default_rng(6)
    start = pm.random_packing(12, dimension=d, packing_fraction=0.9 if d == 2 else 0.7, seed=2)
    shapes = pm.Spheroids(rng.uniform(0.6, 1.7, 12), rng.normal(size=(12, d)))
    packing = pm.quench(pm.Scene(start.replace(shapes=shapes), (pm.Repulsion(),)), force_tolerance=1e-3).packing
    effects = (pm.Repulsion(), pm.Friction(0.3, 0.7, 0.1), pm.ContactDamping(0.2))
    motion = {"velocity_nd": 0.1 * rng.normal(size=(12, d)), "spin_nk": 0.1 * rng.normal(size=(12, 1 if d == 2 else 3))}
    one, other = (
        pm.simulate(pm.Scene(each, effects), steps=100, dt=0.02, check=False, **motion)
        for each in (packing, remade(packing))
    )
    np.testing.assert_allclose(other.packing.position_nd, one.packing.position_nd, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(other.spin_nk, one.spin_nk, rtol=0.0, atol=1e-10)
    spring, same = one.packing.tangential, other.packing.tangential
    assert np.array_equal(spring.i_c, same.i_c) and len(spring) > 8
    np.testing.assert_allclose(same.displacement_ck, spring.displacement_ck, rtol=0.0, atol=1e-10)
    # at rest, from the same springs
    forces = [pm.contact_forces(pm.Scene(each.packing, effects)) for each in (one, other)]
    np.testing.assert_allclose(forces[1].tangential_cd, forces[0].tangential_cd, rtol=0.0, atol=1e-10)
    np.testing.assert_allclose(forces[1].torque_nk, forces[0].torque_nk, rtol=0.0, atol=1e-10)


@pytest.mark.parametrize("d", [2, 3])
def test_a_pair_that_sticks_is_followed_to_second_order_and_keeps_its_momenta(d):
    packing, motion = rubbing(d)
    ends = []
    for dt in (0.02, 0.01, 0.005):
        run = pm.simulate(pm.Scene(packing, ROUGH), duration=0.4, dt=dt, trace_every=1, **motion)
        assert run.trace.contacts_t[-1] == 1 and not run.trace.sliding_t.any() and run.trace.tangential_t[-1] > 1e-7
        moved = run.packing.position_nd, run.spin_nk, run.packing.tangential.displacement_ck
        ends.append(np.concatenate([one.ravel() for one in moved]))
        whole = run.trace.angular_momentum_tk
        size = np.linalg.norm(packing.position_nd, axis=1) * np.linalg.norm(motion["velocity_nd"], axis=1)
        assert np.abs(whole - whole[0]).max() < 1e-12 * packing.mass_n @ size
    assert np.abs(ends[0] - ends[1]).max() / np.abs(ends[1] - ends[2]).max() == pytest.approx(4.0, rel=0.1)


def test_where_flat_faces_touch_the_tangential_force_acts_at_their_touch():
    """The point of contact is not lost to the flatness of faces: forces there make the torques that slopes do."""
    shapes = pm.Superellipsoids([12.0, 12.0], [[1.5, 1.0], [1.5, 1.0]], [[1.0, 1e-13], [1.0, 0.0]])
    height = shapes.axes([0.5, 0.5])[:, 1].sum() * 0.999
    packing = pm.Packing([[2.0, 2.0], [2.1, 2.0 + height]], [0.5, 0.5], pm.Box.cubic(6.0, 2), shapes=shapes)
    contacts = pm.find_shape_contacts(packing)
    point, push = contacts.points(packing.radius_n)[0], contacts.slope_cx[0, :2]
    # the slopes along turns of i and of j are those of forces at the point
    other = point - contacts.vector_cd[0]
    moments = -(point[0] * push[1] - point[1] * push[0]), other[0] * push[1] - other[1] * push[0]
    assert contacts.slope_cx[0, 2:] == pytest.approx(moments, abs=1e-13)
    assert abs(point[0]) > 0.01


@pytest.mark.parametrize("d", [2, 3])
def test_shear_moduli_are_those_of_strained_and_relaxed_packings(d):
    scene, step = at_rest(d, count=16), 1e-6
    packing, strain = scene.packing, np.zeros((d, d))
    strain[0, 1] = strain[1, 0] = 0.5

    def stress(by):
        gradient = np.eye(d) + by * strain
        box = pm.Box(gradient @ packing.box.lattice_dd)
        moved = packing.replace(position_nd=packing.position_nd @ gradient.T, box=box)
        run = pm.quench(scene.replace(packing=moved), force_tolerance=1e-12, check=False)
        return pm.mandel_vector(pm.stress_tensor(scene.replace(packing=run.packing)))

    change = (stress(step) - stress(-step)) / (2.0 * step)
    expected = pm.elastic_moduli(scene).cauchy @ pm.mandel_vector(strain)
    np.testing.assert_allclose(change, expected, rtol=0.0, atol=1e-6 * np.abs(expected).max())


def test_shear_at_rest_and_in_time_begins_with_their_modulus_and_ends_where_it_says():
    scene = at_rest(2, count=16, exponent=3.0)
    still = pm.quasistatic_shear(scene, 3e-3, step=1e-3)
    assert still.modulus_t[0] == pytest.approx(pm.elastic_moduli(scene).simple_shear(0, 1), rel=1e-8)
    end = scene.replace(packing=still.packing)
    assert still.strain_t[-1] == pytest.approx(3e-3, rel=1e-12) and still.residual < 1e-9
    assert still.shear_stress_t[-1] == pytest.approx(pm.stress_tensor(end)[0, 1], rel=1e-9)
    assert still.energy_t[-1] == pytest.approx(pm.energy(end), rel=1e-12)
    damped = scene.replace(effects=(*scene.effects, pm.ContactDamping(0.5)))
    run = pm.ramp_strain(damped, rate=0.01, applied_strain=0.01, samples=5)
    assert run.strain_t[-1] == pytest.approx(0.01, rel=1e-12)
    end = scene.replace(packing=run.packing)
    assert run.potential_t[-1] == pytest.approx(pm.energy(end), rel=1e-11)
    assert run.contacts_t[-1] == len(pm.find_shape_contacts(run.packing))


@pytest.mark.parametrize("d", [2, 3])
def test_coarse_fields_have_the_sums_of_the_whole(d):
    scene = drawn(d, count=12)
    packing = scene.packing
    fields = pm.coarse_grain(scene, 0.5)
    assert packing.box.volume * fields.density_g.mean() == pytest.approx(packing.mass_n.sum(), rel=1e-12)
    whole, found = pm.stress_tensor(scene), fields.contact_stress_gdd.mean(axis=0)
    np.testing.assert_allclose(found, whole, rtol=0.0, atol=1e-12 * np.abs(whole).max())


@pytest.mark.parametrize("d", [2, 3])
def test_statistics_of_contacts_have_the_mean_of_all(d):
    packing = at_rest(d, count=16).packing
    found = pm.contact_statistics(packing)
    assert found.mean == pytest.approx(pm.coordination_number(packing), rel=1e-12)
    assert found.count_z.sum() + found.rattlers == 16 and found.rattlers == pm.find_rattlers(packing).sum()
    assert np.trace(found.fabric_dd) == pytest.approx(1.0, rel=1e-12)
    # normals of contacts, not directions between centers
    normal = pm.find_shape_contacts(packing).normal_cd
    kept = pm.contact_statistics(packing, rattlers="keep")
    np.testing.assert_allclose(kept.fabric_dd, normal.T @ normal / len(normal), rtol=0.0, atol=1e-12)
