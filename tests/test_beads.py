"""Rigid bodies of discs and spheres: what they are, their forces, and what of them is known otherwise."""

import dataclasses

import numpy as np
import pytest

import packmech as pm
from packmech.contacts.fused_volume import union_moments
from packmech.mechanics.network import contact_network
from packmech.mechanics.quartic import free_turns

REPULSION = (pm.Repulsion(),)
BENT = pm.Cluster([[0.0, 0.0], [0.7, 0.0], [1.0, 0.5]], [0.5, 0.4, 0.3])
BODIES = [(2, pm.Dimer(0.8)), (2, BENT), (2, pm.LinearCluster(4, 0.9)), (3, pm.Dimer(0.7)), (3, pm.Trimer(0.7, 2.0))]


def crowd(d, shapes, count=12, seed=1, skewed=False):
    box = None
    if skewed:
        box = np.eye(d)
        box[0, 1] = 0.3
    packing = pm.random_packing(count, dimension=d, packing_fraction=1.0, seed=seed, shapes=shapes, box=box)
    return pm.Scene(packing, REPULSION)


def moved(scene, shift, turn):
    packing = scene.packing
    turned = packing.shapes.turned(turn)
    return scene.replace(packing=packing.replace(position_nd=packing.position_nd + shift, shapes=turned))


def test_moments_of_fused_discs_are_those_of_the_lens_in_closed_form():
    # areas and squared radii of gyration of dimers of discs of radius 1/2, made of half moments of the lens
    for length, area, square in ((0.4, 1.1744596142, 0.1977756147), (0.9, 1.5414333734, 0.3335444692)):
        volume, center, second = union_moments(np.array([[0.0, 0.0], [length, 0.0]]), np.array([0.5, 0.5]))
        assert abs(volume - area) < 1e-10 and abs(np.trace(second) - square) < 1e-10
        assert np.abs(center - [0.5 * length, 0.0]).max() < 1e-14


def test_moments_of_fused_spheres_follow_the_lens_and_turn_along():
    # two unit spheres a unit apart: 2 * 4 pi / 3 less the lens pi (4 + d) (2 - d)^2 / 12
    place = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    volume, _, second = union_moments(place, np.ones(2))
    assert volume == pytest.approx(8.0 * np.pi / 3.0 - 5.0 * np.pi / 12.0, rel=1e-12)
    # about the axis: each cap of height h = 3/2 of a sphere has the moment pi h^3 (20 R^2 - 15 R h + 3 h^2) / 30
    about = 2.0 * np.pi * 1.5**3 * (20.0 - 22.5 + 6.75) / 30.0
    assert (second[1, 1] + second[2, 2]) * volume == pytest.approx(about, rel=1e-10)
    rng = np.random.default_rng(0)
    place, radius = 0.5 * rng.normal(size=(4, 3)), np.array([0.5, 0.6, 0.7, 0.4])
    turn = np.linalg.qr(rng.normal(size=(3, 3)))[0]
    one, other = union_moments(place, radius), union_moments(place @ turn.T, radius)
    assert one[0] == pytest.approx(other[0], rel=1e-9)
    assert np.abs(other[1] - turn @ one[1]).max() < 1e-9 and np.abs(other[2] - turn @ one[2] @ turn.T).max() < 1e-9


def test_bodies_are_about_their_centers_of_mass_and_principal_axes():
    place, radius = np.array([[0.0, 0.0, 0.0], [0.7, 0.1, 0.0], [0.8, 0.7, 0.3]]), np.array([0.5, 0.4, 0.6])
    body = pm.rigid_packing(pm.Packing(place, radius, pm.Box.cubic(8.0, 3)), [0, 0, 0])
    volume, center, second = union_moments(place, radius)
    assert 4.0 / 3.0 * np.pi * body.radius_n[0] ** 3 == pytest.approx(volume, rel=1e-12)
    assert np.abs(body.position_nd[0] - center).max() < 1e-12
    frame = body.shapes.frames()[0]
    assert np.abs(frame.T @ frame - np.eye(3)).max() < 1e-14 and np.linalg.det(frame) > 0.0
    inertia = frame.T @ (np.trace(second) * np.eye(3) - second) @ frame / body.radius_n[0] ** 2
    assert np.abs(inertia - np.diag(body.shapes.gyration_nk[0] ** 2)).max() < 1e-12
    again = pm.bead_packing(body)
    assert np.abs(again.position_nd - place).max() < 1e-14 and np.abs(again.radius_n - radius).max() < 1e-14


@pytest.mark.parametrize(("d", "shapes"), BODIES)
def test_turns_are_rotations_and_come_back(d, shapes):
    packing = crowd(d, shapes).packing
    turn = np.random.default_rng(2).normal(size=(12, 1 if d == 2 else 3))
    # less than half a turn: farther ones come back the short way
    turn *= 3.0 / np.maximum(3.0, np.sqrt((turn**2).sum(axis=1, keepdims=True)))
    turned = packing.shapes.turned(turn)
    assert np.abs(turned.rotation_since(packing.shapes) - turn).max() < 1e-12
    arm, after = packing.shapes.arms(packing.radius_n), turned.arms(packing.radius_n)
    owner = packing.shapes.particle_b
    if d == 2:
        c, s = np.cos(turn[owner, 0]), np.sin(turn[owner, 0])
        expected = np.stack([c * arm[:, 0] - s * arm[:, 1], s * arm[:, 0] + c * arm[:, 1]], axis=1)
    else:
        from scipy.spatial.transform import Rotation

        expected = Rotation.from_rotvec(turn[owner]).apply(arm)
    assert np.abs(after - expected).max() < 1e-13


@pytest.mark.parametrize(("d", "shapes"), BODIES)
def test_forces_and_torques_are_slopes_of_the_energy(d, shapes):
    scene = crowd(d, shapes, skewed=True)
    force, torque = pm.forces(scene), np.reshape(pm.torques(scene), (12, -1))
    rng, h = np.random.default_rng(3), 1e-6
    for _ in range(4):
        shift, turn = rng.normal(size=force.shape), rng.normal(size=torque.shape)
        ends = [pm.energy(moved(scene, sign * h * shift, sign * h * turn)) for sign in (-1.0, 1.0)]
        work = float((force * shift).sum() + (torque * turn).sum())
        assert (ends[0] - ends[1]) / (2.0 * h) == pytest.approx(work, rel=1e-7, abs=1e-8)
    # forces sum to nothing, and the stress is the slope along a strain that turns nobody
    assert np.abs(force.sum(axis=0)).max() < 1e-13 * np.abs(force).max() * len(force)
    strain = rng.normal(size=(d, d))
    packing = scene.packing

    def strained(size):
        grown = np.eye(d) + size * strain
        box = pm.Box(grown @ packing.box.lattice_dd)
        return pm.energy(scene.replace(packing=packing.replace(position_nd=packing.position_nd @ grown.T, box=box)))

    slope = (strained(h) - strained(-h)) / (2.0 * h)
    assert slope == pytest.approx(packing.box.volume * (pm.stress_tensor(scene) * strain).sum(), rel=1e-6)


@pytest.mark.parametrize(("d", "shapes"), BODIES)
def test_curvatures_are_slopes_of_slopes(d, shapes):
    packing = crowd(d, shapes, count=8).packing
    contacts = pm.find_shape_contacts(packing, second=True)
    rng, h = np.random.default_rng(4), 1e-6
    shift, turn = rng.normal(size=packing.position_nd.shape), rng.normal(size=(8, 1 if d == 2 else 3))
    from packmech.contacts.shape_contacts import shape_contacts

    ends = []
    for sign in (-1.0, 1.0):
        other = packing.replace(
            position_nd=packing.position_nd + sign * h * shift, shapes=packing.shapes.turned(sign * h * turn)
        )
        ends.append(shape_contacts(other, contacts.pairs))
    along = np.hstack([shift[contacts.j_c] - shift[contacts.i_c], turn[contacts.i_c], turn[contacts.j_c]])
    slope = (ends[1].distance_c - ends[0].distance_c) / (2.0 * h)
    assert np.abs((contacts.slope_cx * along).sum(axis=1) - slope).max() < 1e-8
    # second differences of the distance along a straight path of rotation vectors
    middle = shape_contacts(packing, contacts.pairs).distance_c
    h = 1e-4
    ends = []
    for sign in (-1.0, 1.0):
        other = packing.replace(
            position_nd=packing.position_nd + sign * h * shift, shapes=packing.shapes.turned(sign * h * turn)
        )
        ends.append(shape_contacts(other, contacts.pairs).distance_c)
    second = (ends[0] - 2.0 * middle + ends[1]) / h**2
    exact = np.einsum("cx,cxy,cy->c", along, contacts.curvature_cxx, along)
    assert np.abs(exact - second).max() < 1e-5 * np.abs(exact).max()


@pytest.mark.parametrize(("d", "shapes"), BODIES)
def test_the_compiled_program_and_numpy_agree_on_turned_bodies(d, shapes):
    from packmech.minimize.program import build_program

    scene = crowd(d, shapes)
    program = build_program(scene)
    turn = np.random.default_rng(5).normal(size=(12, 1 if d == 2 else 3))
    other = moved(scene, 0.0, turn)
    program.put(other.packing)
    found = program.evaluate()
    assert found.energy == pytest.approx(pm.energy(other), rel=1e-12)
    assert np.abs(found.force_nd[:12] - pm.forces(other)).max() < 1e-12
    assert np.abs(found.stress_dd - 0.5 * (pm.stress_tensor(other) + pm.stress_tensor(other).T)).max() < 1e-12
    # forces on the rows of turns are slopes of the energy along these
    place, h = program.coordinates(), 1e-6
    shift = np.zeros_like(place)
    shift[12:, : turn.shape[1]] = np.random.default_rng(6).normal(size=turn.shape)
    ends = [program.evaluate(place + sign * h * shift).energy for sign in (-1.0, 1.0)]
    assert (ends[0] - ends[1]) / (2.0 * h) == pytest.approx((found.force_nd * shift).sum(), rel=1e-6, abs=1e-8)


@pytest.mark.parametrize("d", [2, 3])
def test_bodies_of_one_bead_are_discs_and_spheres(d):
    start = pm.random_packing(40, dimension=d, packing_fraction=0.95 if d == 2 else 0.75, seed=3)
    plain = pm.Scene(pm.quench(pm.Scene(start, REPULSION), force_tolerance=1e-12).packing, REPULSION)
    bodies = plain.replace(packing=pm.rigid_packing(plain.packing, np.arange(40)))
    assert not bodies.packing.shapes.turns_n.any()
    assert np.abs(pm.forces(bodies) - pm.forces(plain)).max() < 1e-14
    assert np.abs(pm.stress_tensor(bodies) - pm.stress_tensor(plain)).max() < 1e-14
    assert np.array_equal(pm.find_rattlers(bodies.packing), pm.find_rattlers(plain.packing))
    one, other = pm.elastic_moduli(plain).cauchy, pm.elastic_moduli(bodies).cauchy
    assert np.abs(one - other).max() < 1e-10 * np.abs(one).max()
    lowest = [pm.normal_modes(scene).frequency_m for scene in (plain, bodies)]
    assert len(lowest[0]) == len(lowest[1]) and np.abs(lowest[0] - lowest[1]).max() < 1e-8
    assert pm.floppy_modes(bodies.packing).count == pm.floppy_modes(plain.packing).count


def test_dimers_held_by_links_and_rigid_ones_are_the_same_packing():
    start = pm.cluster_packing(20, shape=pm.Dimer(0.8), dimension=2, packing_fraction=0.5, seed=2)
    linked = pm.Scene(pm.jam(pm.Scene(start, REPULSION), pressure=1e-4).packing, REPULSION)
    rigid = linked.replace(packing=pm.rigid_packing(linked.packing))
    assert pm.packing_fraction(rigid.packing) == pytest.approx(pm.packing_fraction(linked.packing), rel=1e-12)
    assert len(pm.find_shape_contacts(rigid.packing)) == len(pm.find_contacts(linked.packing))
    # at rest for links is at rest for bodies: the links carry what is left on each bead
    scale = float(np.abs(pm.forces(linked)).max())
    assert np.abs(pm.forces(rigid)).max() < 1e-9 * scale and np.abs(pm.torques(rigid)).max() < 1e-9 * scale
    one, other = pm.elastic_moduli(linked).cauchy, pm.elastic_moduli(rigid).cauchy
    assert np.abs(one - other).max() < 1e-8 * np.abs(one).max()
    # pressure of bodies is measured between centers, and nobody carries a stress of its own
    assert pm.pressure(rigid) == pytest.approx(pm.pressure(linked), rel=1e-9)


@pytest.mark.parametrize(("d", "shapes"), [(2, pm.Dimer(0.8)), (2, BENT), (3, pm.Trimer(0.7, 2.0))])
def test_jammed_bodies_are_isostatic_but_for_those_that_turn_freely(d, shapes):
    start = pm.random_packing(24, dimension=d, packing_fraction=0.5 if d == 2 else 0.3, seed=2, shapes=shapes)
    run = pm.jam(pm.Scene(start, REPULSION), pressure=1e-7)
    assert run.outcome is pm.Outcome.CONVERGED and run.residual < 1e-5
    network = contact_network(run.packing, second=False)
    free = len(free_turns(network.packing, network.contacts))
    assert run.report["floppy_modes"] == free and run.report["states_of_self_stress"] == 1


def test_bodies_that_start_across_each_other_part():
    for shapes in (pm.Dimer(0.8), pm.LinearCluster(3, 0.8)):
        for seed in range(4):
            start = pm.random_packing(30, dimension=2, packing_fraction=0.6, seed=seed, shapes=shapes)
            run = pm.quench(pm.Scene(start, REPULSION), force_tolerance=1e-6)
            assert run.report["deep_overlaps"] == 0
    cross = pm.Packing([[2.0, 2.5], [3.0, 2.5], [2.5, 2.0], [2.5, 3.0]], [0.55] * 4, pm.Box.cubic(6.0, 2))
    bodies = pm.rigid_packing(cross, [0, 0, 1, 1])
    nudged = bodies.replace(position_nd=bodies.position_nd + [[0.0, 0.0], [0.02, 0.01]])
    run = pm.quench(pm.Scene(nudged, REPULSION), force_tolerance=1e-6)
    assert run.report["deep_overlaps"] == 0 and run.stages[0].name == "deep overlaps"
    assert pm.energy(pm.Scene(run.packing, REPULSION)) < 1e-12


def test_a_body_touches_its_own_image():
    row = pm.Packing([[0.0, 0.0], [0.9, 0.0]], [0.5, 0.5], pm.Box([[1.8, 0.0], [0.0, 4.0]]))
    body = pm.rigid_packing(row, [0, 0])
    contacts = pm.find_shape_contacts(body)
    assert len(contacts) == 1 and contacts.i_c[0] == contacts.j_c[0] == 0
    assert contacts.distance_c[0] == pytest.approx(0.9, rel=1e-12)
    assert contacts.image_cd.tolist() in ([[1, 0]], [[-1, 0]])
    # turned by a right angle it does not
    across = body.replace(shapes=body.shapes.turned(np.array([[np.pi / 2]])))
    assert len(pm.find_shape_contacts(across)) == 0


@pytest.mark.parametrize(("d", "shapes"), BODIES[1:])
@pytest.mark.parametrize("ending", ["npz", "gsd", "toml"])
def test_files_keep_bodies_to_the_last_bit(d, shapes, ending, tmp_path):
    scene = crowd(d, shapes, skewed=True)
    path = tmp_path / f"bodies.{ending}"
    if ending == "toml":
        pm.write_scene(scene, path)
        found = pm.read_scene(path).packing
    else:
        pm.write_packing(scene.packing, path)
        found = pm.read_packing(path)
    assert found == scene.packing


@pytest.mark.parametrize("d", [2, 3])
def test_gsd_files_of_others_show_unions_of_spheres(d, tmp_path):
    gsd = pytest.importorskip("gsd.hoomd")
    packing = crowd(d, pm.Trimer(0.7, 2.0)).packing
    path = tmp_path / "bodies.gsd"
    pm.write_packing(packing, path)
    with gsd.open(str(path), "r") as file:
        frame = file[0]
    assert {one["type"] for one in frame.particles.type_shapes} == {"SphereUnion"}
    frame.log = {}
    bare = tmp_path / "bare.gsd"
    with gsd.open(str(bare), "w") as file:
        file.append(frame)
    found = pm.read_packing(bare)
    one, other = pm.bead_packing(found), pm.bead_packing(packing.wrapped())
    apart = one.position_nd - other.position_nd
    apart -= np.rint(apart @ packing.box.inverse_dd.T) @ packing.box.lattice_dd.T
    assert np.abs(apart).max() < 1e-5 and np.abs(one.radius_n - other.radius_n).max() < 1e-6


@pytest.mark.parametrize("d", [2, 3])
def test_gsd_files_show_other_programs_beads_where_they_are_and_as_large_as_they_are(d, tmp_path):
    gsd, fl = pytest.importorskip("gsd.hoomd"), pytest.importorskip("gsd.fl")
    packing = crowd(d, pm.Trimer(0.7, 2.0, radii=(0.5, 0.4, 0.6)), skewed=True).packing
    path = tmp_path / "bodies.gsd"
    pm.write_packing(packing, path)
    with gsd.open(str(path), "r") as file:
        frame = file[0]
    # as the schema says: centers turned by the unit quaternion (w, v), which is c + 2 w (v x c) + 2 v x (v x c)
    place, diameter = [], []
    for n in range(packing.particles):
        one = frame.particles.type_shapes[frame.particles.typeid[n]]
        center = np.array(one["centers"])
        w, *v = frame.particles.orientation[n].astype(float)
        aside = np.cross(v, center)
        place.append(frame.particles.position[n] + center + 2.0 * w * aside + 2.0 * np.cross(v, aside))
        diameter.append(one["diameters"])
    place, beads = np.concatenate(place)[:, :d], pm.bead_packing(packing)
    assert np.allclose(np.concatenate(diameter), beads.diameter_n, rtol=1e-12)
    x, y, z, xy, xz, yz = frame.configuration.box.astype(float)
    seen = pm.Box(np.array([[x, xy * y, xz * z], [0.0, y, yz * z], [0.0, 0.0, z]])[:d, :d])

    def apart(position, box):
        fraction = (position[:, None] - position[None]) @ box.inverse_dd.T
        return np.sqrt((((fraction - np.rint(fraction)) @ box.lattice_dd.T) ** 2).sum(axis=-1))

    assert np.abs(apart(place, seen) - apart(beads.position_nd, packing.box)).max() < 1e-5
    # OVITO scales unions by diameters that are given
    with fl.open(str(path), "r") as file:
        assert not file.chunk_exists(0, "particles/diameter")


def test_scene_files_draw_bodies(tmp_path):
    table = '[packing]\nkind = "random"\nparticles = 6\npacking_fraction = 0.5\nseed = 1\n'
    table += 'shapes = { kind = "trimer", length = 0.7, angle = 2.0 }\n\n[[effects]]\nkind = "repulsion"\n'
    (tmp_path / "bodies.toml").write_text(table, encoding="utf-8")
    drawn = pm.random_packing(6, dimension=2, packing_fraction=0.5, seed=1, shapes=pm.Trimer(0.7, 2.0))
    assert pm.read_scene(tmp_path / "bodies.toml").packing == drawn


def test_random_bodies_have_the_radii_and_places_of_discs():
    plain = pm.random_packing(20, dimension=2, packing_fraction=0.5, seed=1)
    bodies = pm.random_packing(20, dimension=2, packing_fraction=0.5, seed=1, shapes=pm.Trimer(0.7, (1.0, 2.0)))
    assert np.array_equal(plain.position_nd, bodies.position_nd) and np.array_equal(plain.radius_n, bodies.radius_n)
    assert len(np.unique(bodies.shapes.gyration_nk)) == 20


def test_bad_bodies_are_refused_by_name():
    shapes = crowd(2, pm.Dimer(0.8)).packing.shapes
    with pytest.raises(ValueError, match="start_n must grow from 0 to the number of beads"):
        dataclasses.replace(shapes, start_n=[0, 3])
    with pytest.raises(ValueError, match="size_b"):
        dataclasses.replace(shapes, size_b=-shapes.size_b)
    plain = pm.random_packing(4, dimension=2, packing_fraction=0.5, seed=1)
    with pytest.raises(ValueError, match="body_n must number bodies 0, 1, 2"):
        pm.rigid_packing(plain, [0, 0, 2, 2])
    with pytest.raises(ValueError, match="body_n must be given for a packing without links"):
        pm.rigid_packing(plain)
    with pytest.raises(ValueError, match=r"one of rigid bodies"):
        pm.bead_packing(plain)
    with pytest.raises(TypeError, match="shapes must be Ellipses, Superellipses or a shape of a cluster"):
        pm.random_packing(4, dimension=2, packing_fraction=0.5, seed=1, shapes=3)
