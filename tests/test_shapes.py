"""Facts about packings of ellipses and spheroids: the record, files, energies and forces, and who refuses them."""

import numpy as np
import pytest

import packmech as pm
from packmech.calls.honors import CALLS

# calls are declared as their modules are imported
for _name in dir(pm):
    getattr(pm, _name)

HONOR = {
    "QuenchBatch", "ShearBatch", "assign_kinds", "bond_contacts", "compliance_matrix", "rigidity_matrix",
    "scattered_packing", "shear_at_pressure", "vacancy_packing", "wall_contacts",
    "energy", "forces", "stress_tensor", "pressure", "torques", "packing_fraction", "write_packing",
    "at_packing_fraction", "find_shape_contacts", "find_rattlers", "remove_rattlers", "coordination_number",
    "draw_frame", "displaced", "quench", "jam", "compress", "shear_stabilize", "sweep_pressure", "sweep_stress",
    "hessian", "dynamical_matrix", "perturbation_energy", "normal_modes", "density_of_states", "count_modes",
    "sensitivity", "design",
    "elastic_moduli", "complex_modulus", "states_of_self_stress", "floppy_modes", "quartic_modes", "second_order",
    "simulate", "resume", "ramp_strain", "steady_shear", "creep", "oscillatory_shear", "equilibrate", "amplitude_sweep",
    "bead_packing", "classify_jamming", "rigid_clusters", "waves", "dispersion", "sound_speeds",
    "shear_families", "quasistatic_shear", "deform", "deform_at_rate", "cyclic_shear", "tap",
    "anneal_shape", "bond_orientational_order", "contact_statistics", "correlation_function", "find_neighbors",
    "contact_dissipation",
    "contact_forces", "force_chains", "force_distribution", "frictional_modes", "settle", "stiffness_matrix",
    "coarse_grain", "displacements", "local_strain", "nematic_order", "pair_distribution", "partial_structure_factors",
    "spectral_density", "structure_factor", "to_ase", "to_freud", "to_hoomd",
}  # fmt: skip


def crowded(d, count=24, seed=1, aspect=(0.5, 2.0)):
    """Return overlapping particles at random in a skewed box, which one of them touches its own image across."""
    rng = np.random.default_rng(seed)
    side = 3.0 if d == 2 else 2.4
    lattice = side * np.array([[1.0, 0.3, 0.1], [0.0, 1.1, -0.2], [0.0, 0.0, 0.9]])[:d, :d]
    radius = rng.uniform(0.25, 0.45, count)
    radius[0] = 0.9 if d == 2 else 0.8
    ratio = rng.uniform(*aspect, count)
    ratio[0] = aspect[1]
    shapes = pm.Spheroids(ratio, rng.normal(size=(count, d)))
    packing = pm.Packing(rng.random((count, d)) @ lattice.T, radius, pm.Box(lattice), shapes=shapes)
    return pm.Scene(packing, (pm.Repulsion(pm.Hertz()),))


def turned(packing, n, axis, angle):
    """Return the packing with one director turned about an axis."""
    director = packing.shapes.director_nd.copy()
    i, j = (0, 1) if packing.dimension == 2 else ((axis + 1) % 3, (axis + 2) % 3)
    one = director[n].copy()
    director[n, i] = np.cos(angle) * one[i] - np.sin(angle) * one[j]
    director[n, j] = np.sin(angle) * one[i] + np.cos(angle) * one[j]
    return packing.replace(shapes=pm.Spheroids(packing.shapes.aspect_n, director))


@pytest.mark.parametrize("d", [2, 3])
def test_forces_torques_and_stress_are_slopes_of_the_energy(d):
    scene = crowded(d)
    packing, step = scene.packing, 1e-5

    def energy(other):
        return pm.energy(scene.replace(packing=other))

    scale = np.abs(pm.forces(scene)).max()
    for n in (0, 3, 7):
        for a in range(d):
            shift = np.zeros_like(packing.position_nd)
            shift[n, a] = step
            ends = [energy(packing.replace(position_nd=packing.position_nd + sign * shift)) for sign in (1, -1)]
            assert abs(pm.forces(scene)[n, a] + (ends[0] - ends[1]) / (2 * step)) < 1e-7 * scale
        for axis in range(1 if d == 2 else 3):
            ends = [energy(turned(packing, n, axis, sign * step)) for sign in (1, -1)]
            found = pm.torques(scene)[n] if d == 2 else pm.torques(scene)[n, axis]
            assert abs(found + (ends[0] - ends[1]) / (2 * step)) < 1e-7 * scale
    stress = pm.stress_tensor(scene)
    for a in range(d):
        for b in range(d):
            change = np.zeros((d, d))
            change[a, b] = step
            ends = []
            for sign in (1, -1):
                grown = np.eye(d) + sign * change
                # directors stay while centers and box are strained
                box = pm.Box(grown @ packing.box.lattice_dd)
                ends.append(energy(packing.replace(position_nd=packing.position_nd @ grown.T, box=box)))
            slope = (ends[0] - ends[1]) / (2 * step) / packing.box.volume
            assert abs(stress[a, b] - slope) < 1e-7 * np.abs(stress).max()


@pytest.mark.parametrize("d", [2, 3])
def test_what_is_not_symmetric_in_the_stress_is_the_torques(d):
    scene = crowded(d, seed=2)
    stress, volume = pm.stress_tensor(scene), scene.packing.box.volume
    total = np.atleast_2d(pm.torques(scene).T).sum(axis=1)
    around = [stress[1, 0] - stress[0, 1]] if d == 2 else [stress[2, 1] - stress[1, 2], stress[0, 2] - stress[2, 0],
                                                           stress[1, 0] - stress[0, 1]]  # fmt: skip
    assert np.abs(np.array(around) * volume - total).max() < 1e-12 * np.abs(stress).max() * volume
    assert np.abs(pm.forces(scene).sum(axis=0)).max() < 1e-12 * np.abs(pm.forces(scene)).max()


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("law", [pm.Harmonic(), pm.Hertz(), pm.LinearSpring(2.0)])
def test_aspect_one_is_a_disc_or_sphere(d, law):
    shaped = crowded(d, aspect=(1.0, 1.0)).replace(effects=(pm.Repulsion(law), pm.ContactDamping(0.1)))
    round_ = shaped.replace(packing=shaped.packing.replace(shapes=None))
    for call in (pm.energy, pm.forces, pm.stress_tensor, pm.pressure):
        assert np.allclose(call(shaped), call(round_), rtol=1e-12, atol=1e-13)
    assert not pm.torques(shaped).any()
    assert pm.packing_fraction(shaped.packing) == pm.packing_fraction(round_.packing)
    assert np.array_equal(shaped.packing.mass_n, round_.packing.mass_n)


@pytest.mark.parametrize("d", [2, 3])
def test_other_coordinates_give_the_same_answers(d):
    scene = crowded(d, seed=3)
    packing = scene.packing
    moved = packing.replace(position_nd=packing.position_nd + packing.box.lattice_dd @ np.arange(1, d + 1))
    assert pm.energy(scene.replace(packing=moved.wrapped())) == pytest.approx(pm.energy(scene), rel=1e-11)
    # opposite directors are the same shape, all of it turned with the box turns forces
    flipped = packing.replace(shapes=pm.Spheroids(packing.shapes.aspect_n, -packing.shapes.director_nd))
    assert np.allclose(pm.forces(scene.replace(packing=flipped)), pm.forces(scene), rtol=0, atol=1e-12)
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(d, d)))[0]
    turn[0] *= np.linalg.det(turn)
    whole = pm.Packing(
        packing.position_nd @ turn.T, packing.radius_n, pm.Box(turn @ packing.box.lattice_dd),
        shapes=pm.Spheroids(packing.shapes.aspect_n, packing.shapes.director_nd @ turn.T),
    )  # fmt: skip
    expected = pm.forces(scene) @ turn.T
    assert np.allclose(pm.forces(scene.replace(packing=whole)), expected, rtol=0, atol=1e-10 * np.abs(expected).max())


def test_one_that_touches_its_own_image_is_pressed_and_turned_by_it():
    shapes = pm.Spheroids([4.0], [[np.cos(0.2), np.sin(0.2)]])
    packing = pm.Packing([[0.0, 0.0]], [0.5], pm.Box(np.diag([1.5, 3.0])), shapes=shapes)
    scene = pm.Scene(packing, (pm.Repulsion(),))
    assert pm.energy(scene) > 0.0 and not pm.forces(scene).any() and abs(pm.torques(scene)[0]) > 1e-3
    apart = packing.replace(shapes=pm.Spheroids([4.0], [[0.0, 1.0]]))
    assert pm.energy(scene.replace(packing=apart)) == 0.0


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("ending", ["npz", "gsd"])
def test_files_keep_shapes_to_the_last_bit(tmp_path, d, ending):
    packing = crowded(d, seed=5).packing
    path = tmp_path / f"packing.{ending}"
    pm.write_packing(packing, path)
    assert pm.read_packing(path) == packing
    with pytest.raises(ValueError, match="must be of discs or spheres for .txt"):
        pm.write_packing(packing, tmp_path / "packing.txt")


def test_npz_files_with_shapes_are_of_a_version_that_older_readers_refuse(tmp_path):
    packing = crowded(2).packing
    for one, version in ((packing, 5), (packing.replace(shapes=None), 1)):
        pm.write_packing(one, tmp_path / "packing.npz")
        with np.load(tmp_path / "packing.npz") as found:
            assert found["format_version"] == version


@pytest.mark.parametrize("d", [2, 3])
def test_gsd_files_show_other_programs_orientations_and_axes(tmp_path, d):
    import gsd.hoomd

    packing = pm.Packing(
        np.arange(1.0, 1.0 + 3 * d).reshape(3, d), [0.5, 0.5, 0.7], pm.Box(20.0 * np.eye(d)),
        shapes=pm.Spheroids([2.0, 2.0, 0.5], np.eye(3)[[1, 0, 0], :d] * [[1.0], [-1.0], [1.0]]),
    )  # fmt: skip
    path = tmp_path / "packing.gsd"
    pm.write_packing(packing, path)
    with gsd.hoomd.open(str(path), "r") as file:
        frame = file[0]
    along, across = packing.shapes.semi_axes(packing.radius_n)
    for n in range(3):
        w, x, y, z = frame.particles.orientation[n]
        # the turned first axis
        first = np.array([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)])
        assert np.abs(first[:d] - packing.shapes.director_nd[n]).max() < 1e-6
        kind = frame.particles.type_shapes[frame.particles.typeid[n]]
        assert kind["type"] == "Ellipsoid" and (kind["a"], kind["b"]) == pytest.approx((along[n], across[n]))
    # as another program would have written it
    frame.log = {}
    with gsd.hoomd.open(str(path), "w") as file:
        file.append(frame)
    seen = pm.read_packing(path).shapes
    assert np.allclose(seen.aspect_n, packing.shapes.aspect_n, rtol=1e-6)
    assert np.allclose(np.abs((seen.director_nd * packing.shapes.director_nd).sum(axis=1)), 1.0, atol=1e-6)


@pytest.mark.parametrize("d", [2, 3])
def test_freud_finds_the_same_nematic_order_and_neighbors_in_a_gsd_file(tmp_path, d):
    freud, gsd = pytest.importorskip("freud"), pytest.importorskip("gsd.hoomd")
    shapes = crowded(d, seed=5).packing.shapes
    lattice = np.diag([3.0, 4.0, 5.0][:d])
    # left-handed and skewed: what others see is turned
    lattice[0, 1], lattice[-1] = 1.1, -lattice[-1]
    place = np.random.default_rng(1).uniform(0.0, 3.0, (len(shapes), d))
    packing = pm.Packing(place, np.full(len(shapes), 0.5), pm.Box(lattice), shapes=shapes)
    pm.write_packing(packing, tmp_path / "packing.gsd")
    with gsd.open(str(tmp_path / "packing.gsd"), "r") as file:
        frame = file[0]
    w, x, y, z = frame.particles.orientation.T
    first = np.column_stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)])
    nematic = freud.order.Nematic()
    nematic.compute(first)
    director = np.zeros((len(shapes), 3))
    director[:, :d] = shapes.director_nd
    tensor = 1.5 * director.T @ director / len(director) - 0.5 * np.eye(3)
    assert nematic.order == pytest.approx(np.linalg.eigvalsh(tensor)[-1], rel=1e-5)
    # directors stand to the vectors between centers as they do here
    query = freud.locality.AABBQuery.from_system(frame)
    pairs = query.query(frame.particles.position, {"r_max": 1.2, "exclude_ii": True}).toNeighborList()
    seen = np.sort(np.abs((pairs.vectors * first[pairs.query_point_indices]).sum(axis=1)))
    fraction = (place[:, None] - place[None]) @ packing.box.inverse_dd.T
    vector = (fraction - np.rint(fraction)) @ lattice.T
    distance = np.sqrt((vector**2).sum(axis=-1))
    own = np.abs(np.einsum("ijd,id->ij", vector, shapes.director_nd))[(distance > 0.0) & (distance < 1.2)]
    assert len(own) == len(seen) > 0 and np.abs(np.sort(own) - seen).max() < 1e-5


def test_every_other_call_refuses_shapes_by_name():
    scene = crowded(2)
    honoring = {name for name, one in CALLS.items() if one.answer("shapes") == "yes"}
    assert honoring == HONOR
    for name, one in CALLS.items():
        if name not in HONOR:
            with pytest.raises(ValueError, match=f"for pm.{name}, which knows no other shapes, got Spheroids"):
                one.check("scene", scene)
            with pytest.raises(ValueError, match="got Spheroids"):
                one.check("packing", scene.packing)
    with pytest.raises(ValueError, match=r"which knows no other shapes.* or use pm.find_shape_contacts"):
        pm.find_contacts(scene.packing)


def test_friction_is_refused_where_there_is_no_energy_and_nothing_else():
    scene = crowded(2)
    rough = scene.replace(effects=(*scene.effects, pm.Friction()))
    for call in (pm.hessian, lambda scene: pm.quench(scene, force_tolerance=1e-6)):
        with pytest.raises(ValueError, match="would ignore, got Friction"):
            call(rough)
    # springs that are slack do nothing
    assert np.array_equal(pm.forces(rough), pm.forces(scene)) and np.array_equal(pm.torques(rough), pm.torques(scene))
    assert pm.energy(rough) == pm.energy(scene)


def test_the_record_is_checked_selected_and_compared():
    packing = crowded(2).packing
    few = packing.select(np.array([3, 5]))
    assert few.shapes == pm.Spheroids(packing.shapes.aspect_n[[3, 5]], packing.shapes.director_nd[[3, 5]])
    assert packing != packing.replace(shapes=None) and hash(packing) == hash(packing.replace())
    for bad, what in (
        (lambda: pm.Spheroids([0.0], [[1.0, 0.0]]), "aspect_n must"),
        (lambda: pm.Spheroids([1.0, 1.0], [[1.0, 0.0], [0.0, 0.0]]), "director_nd must have a direction.*particle 1"),
        (lambda: pm.Spheroids([1.0], [[1.0]]), "two or three"),
        (lambda: packing.replace(shapes=few.shapes), "shapes must be of as many particles and axes as position_nd"),
        (lambda: few.replace(links=pm.Links([0], [1], [[0, 0]], [1.0])), "shapes must be left out where"),
    ):
        with pytest.raises(ValueError, match=what):
            bad()
    together = pm.Packing([[1.0, 1.0]] * 2, [0.5, 0.5], pm.Box.cubic(4.0, 2), shapes=few.shapes)
    with pytest.raises(ValueError, match="no coincident centers, got particles 0 and 1"):
        pm.energy(pm.Scene(together, (pm.Repulsion(),)))
