"""Facts about GSD files of other programs: what they hold is used, refused by name, or listed as left out."""

import itertools
import math
import warnings

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import packmech as pm

gsd = pytest.importorskip("gsd.hoomd")
SQUARE = {"type": "Sphere", "diameter": 2.0}
DIMER = {"type": "SphereUnion", "centers": [[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]], "diameters": [1.0, 1.2]}


def frame_of(position, box, *, dimensions=3, **particles):
    """Return a frame as another program would write it; `particles` are fields of the schema."""
    frame = gsd.Frame()
    position = np.atleast_2d(position).astype(float)
    frame.configuration.box = box
    frame.configuration.dimensions = dimensions
    frame.particles.N = len(position)
    frame.particles.position = np.column_stack([position, np.zeros((len(position), 3 - position.shape[1]))])
    for name, value in particles.items():
        setattr(frame.particles, name, value)
    return frame


def written(folder, *frames):
    with gsd.open(str(folder / "a.gsd"), "w") as file:
        file.extend(frames)
    return folder / "a.gsd"


def about_z(angle):
    return [math.cos(0.5 * angle), 0.0, 0.0, math.sin(0.5 * angle)]


def two(dimensions=2, **particles):
    """Return two particles of one type."""
    height = 1.0 if dimensions == 2 else 9.0
    return frame_of([[-1.0, 0.5], [1.5, 0.0]], [8.0, 9.0, height, 0.0, 0.0, 0.0], dimensions=dimensions, **particles)


# -- sizes and shapes --------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("diameter", [0.3, 1.0, 2.0])
def test_touching_hard_discs_have_the_packing_fraction_of_the_triangular_lattice(tmp_path, diameter):
    side = diameter * np.array([1.0, math.sqrt(3.0)])
    frame = frame_of(
        [[0.0, 0.0], 0.5 * side], [*side, 1.0, 0.0, 0.0, 0.0], dimensions=2,
        type_shapes=[{"type": "Sphere", "diameter": diameter}],
    )  # fmt: skip
    found = pm.read_packing(written(tmp_path, frame))
    assert pm.packing_fraction(found) == pytest.approx(math.pi / math.sqrt(12.0), rel=1e-6)


def test_touching_hard_spheres_have_the_packing_fraction_of_the_face_centered_lattice(tmp_path):
    side = 1.5 * math.sqrt(2.0)
    place = 0.5 * side * np.array([[0, 0, 0], [0, 1, 1], [1, 0, 1], [1, 1, 0]]) - 0.25 * side
    frame = frame_of(place, [side] * 3 + [0.0] * 3, type_shapes=[{"type": "Sphere", "diameter": 1.5}])
    assert pm.packing_fraction(pm.read_packing(written(tmp_path, frame))) == pytest.approx(math.pi / math.sqrt(18.0))


def test_types_of_two_sizes_have_each_its_own(tmp_path):
    shapes = [{"type": "Sphere", "diameter": 1.0}, {"type": "Sphere", "diameter": 1.4}]
    frame = two(types=["A", "B"], typeid=[1, 0], type_shapes=shapes)
    assert pm.read_packing(written(tmp_path, frame)).radius_n.tolist() == [0.7, 0.5]


@pytest.mark.parametrize("dimensions", [2, 3])
@pytest.mark.parametrize("axes", [(2.0, 1.0, 1.0), (0.4, 1.0, 1.0)])
def test_volumes_of_ellipsoids_are_those_of_their_axes(tmp_path, axes, dimensions):
    frame = two(dimensions, type_shapes=[dict(zip("abc", axes, strict=True), type="Ellipsoid")])
    found = pm.read_packing(written(tmp_path, frame))
    whole = math.pi * axes[0] * axes[1] if dimensions == 2 else 4.0 / 3.0 * math.pi * np.prod(axes)
    assert found.radius_n[0] == pytest.approx((whole / math.pi) ** 0.5 if dimensions == 2 else np.cbrt(axes[0]))
    assert pm.packing_fraction(found) == pytest.approx(2.0 * whole / found.box.volume)


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    st.sampled_from([(0, 1, 2), (1, 0, 2), (1, 2, 0)]),
    st.floats(0.3, 3.0),
    st.floats(0.2, 2.0),
    st.tuples(*[st.floats(-1.0, 1.0)] * 4).filter(lambda q: sum(x * x for x in q) > 0.01),
)
def test_any_axis_of_an_ellipsoid_may_be_the_one_that_differs(tmp_path, order, aspect, across, turn):
    # order[0] is the place of the axis that differs; (1, 2, 0): c, as of oblate HOOMD ellipsoids
    own = order.index(0)
    axes = [across] * 3
    axes[own] = aspect * across
    w, *v = np.array(turn) / np.linalg.norm(turn)
    aside = np.cross(v, np.eye(3)[own])
    director = np.eye(3)[own] + 2.0 * w * aside + 2.0 * np.cross(v, aside)
    frame = two(3, type_shapes=[dict(zip("abc", axes, strict=True), type="Ellipsoid")], orientation=[[w, *v]] * 2)
    found = pm.read_packing(written(tmp_path, frame))
    along, other = found.shapes.semi_axes(found.radius_n)
    assert (along[0], other[0]) == pytest.approx((aspect * across, across), rel=1e-6)
    if abs(aspect - 1.0) > 1e-6:
        assert abs(found.shapes.director_nd[0] @ director) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("upright", [0, 1, 2])
def test_in_the_plane_ellipsoids_are_the_ellipses_of_the_axes_that_lie_there(tmp_path, upright):
    turns = {0: [math.sqrt(0.5), 0.0, math.sqrt(0.5), 0.0], 1: [math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0]}
    axes = {"a": 0.5, "b": 0.8, "c": 1.1}
    frame = two(type_shapes=[axes | {"type": "Ellipsoid"}], orientation=[turns.get(upright, [1.0, 0.0, 0.0, 0.0])] * 2)
    found = pm.read_packing(written(tmp_path, frame))
    lying = sorted(value for k, value in enumerate(axes.values()) if k != upright)
    assert sorted(np.ravel(found.shapes.semi_axes(found.radius_n))[::2]) == pytest.approx(lying, rel=1e-6)


def test_ellipses_turn_with_their_orientation(tmp_path):
    shape = {"type": "Ellipsoid", "a": 1.0, "b": 0.5, "c": 0.5}
    found = pm.read_packing(written(tmp_path, two(type_shapes=[shape], orientation=[about_z(0.3), about_z(-1.0)])))
    angle = np.arctan2(found.shapes.director_nd[:, 1], found.shapes.director_nd[:, 0])
    assert angle == pytest.approx([0.3, -1.0], abs=1e-6)


def test_spheres_among_ellipsoids_have_aspect_one(tmp_path):
    shapes = [{"type": "Ellipsoid", "a": 1.0, "b": 0.5, "c": 0.5}, {"type": "Sphere", "diameter": 0.6}]
    found = pm.read_packing(written(tmp_path, two(types=["A", "B"], typeid=[0, 1], type_shapes=shapes)))
    assert found.shapes.aspect_n.tolist() == [2.0, 1.0] and found.radius_n[1] == pytest.approx(0.3)


@pytest.mark.parametrize("dimensions", [2, 3])
def test_beads_of_unions_lie_where_the_schema_puts_them_about_any_origin(tmp_path, dimensions):
    angle = [0.4, -1.1]
    frame = two(dimensions, type_shapes=[DIMER], orientation=[about_z(one) for one in angle])
    beads = pm.bead_packing(pm.read_packing(written(tmp_path, frame)))
    centers = np.array(DIMER["centers"])[:, 0]
    expected = [
        frame.particles.position[n, :2] + one * np.array([math.cos(angle[n]), math.sin(angle[n])])
        for n, one in itertools.product(range(2), centers)
    ]
    assert np.abs(beads.position_nd[:, :2] - expected).max() < 1e-6
    assert beads.diameter_n == pytest.approx([1.0, 1.2] * 2, rel=1e-12)


def test_spheres_among_unions_are_bodies_of_one_bead(tmp_path):
    shapes = [DIMER, {"type": "Sphere", "diameter": 0.6}]
    found = pm.read_packing(written(tmp_path, two(3, types=["A", "B"], typeid=[0, 1], type_shapes=shapes)))
    assert pm.bead_packing(found).diameter_n == pytest.approx([1.0, 1.2, 0.6])


def test_a_type_that_no_particle_has_may_be_of_any_shape(tmp_path):
    frame = two(types=["A", "B"], typeid=[0, 0], type_shapes=[{"type": "Sphere", "diameter": 0.6}, {"type": "Mesh"}])
    assert pm.read_packing(written(tmp_path, frame)).radius_n.tolist() == [0.3, 0.3]


def test_a_body_that_is_one_union_is_that_union(tmp_path):
    assert len(pm.read_packing(written(tmp_path, two(3, type_shapes=[DIMER], body=[0, 1]))).shapes.size_b) == 4


def test_positions_are_unwrapped_by_the_images(tmp_path):
    frame = two(image=[[0, 0, 0], [2, -1, 0]])
    found = pm.read_packing(written(tmp_path, frame))
    assert found.position_nd.tolist() == [[-1.0, 0.5], [1.5 + 16.0, -9.0]]


POLYGON = {"type": "Polygon", "rounding_radius": 0.0, "vertices": [[-0.5, -0.5], [0.5, -0.5], [0.0, 0.5]]}
ROUND = {"type": "Ellipsoid", "a": 1.0, "b": 0.5, "c": 0.5}
TILTED = [[math.cos(0.3), math.sin(0.3), 0.0, 0.0]] * 2


@pytest.mark.parametrize(
    ("dimensions", "particles", "message"),
    [
        (2, {"type_shapes": [POLYGON]}, "must be spheres, ellipsoids or unions of spheres, got 'Polygon' for type 'A'"),
        (3, {"type_shapes": [POLYGON | {"type": "ConvexPolyhedron"}]}, "got 'ConvexPolyhedron' for type 'A'"),
        (3, {"type_shapes": [{"type": "Mesh", "vertices": [], "indices": []}]}, "got 'Mesh' for type 'A'"),
        (2, {"type_shapes": [{"type": "Disk", "diameter": 1.0}]}, "got 'Disk' for type 'A'"),
        (3, {"type_shapes": [{"rounding_radius": 1.0}]}, "got None for type 'A'"),
        (3, {"type_shapes": [ROUND | {"c": 0.6}]}, r"two equal axes, got \[1.0, 0.5, 0.6\] for particle 0 of type 'A'"),
        (3, {"type_shapes": [ROUND | {"b": -0.5}]}, "b of type 'A' must be a finite number above 0, got -0.5"),
        (3, {"type_shapes": [{"type": "Ellipsoid", "a": 1.0}]}, "Ellipsoid of type 'A' must have 'b', got type, a"),
        (3, {"type_shapes": [{"type": "Sphere"}]}, "Sphere of type 'A' must have 'diameter', got type"),
        (3, {"type_shapes": [DIMER | {"diameters": [1.0]}]}, "diameters of type 'A' must have shape"),
        (3, {"type_shapes": [{"type": "SphereUnion", "centers": [[0, 0, 0]]}]}, "'A' must have 'diameters'"),
        (3, {"type_shapes": [SQUARE], "diameter": [2.0, 3.0]}, "diameter and particles/type_shapes must agree, got 3"),
        (3, {"body": [0, 0]}, "must not form bodies, got particles/body 0 for particle 0"),
        (3, {"body": [0, 1], "type_shapes": [SQUARE]}, "must not form bodies"),
        (3, {"body": [-1, -2]}, "must not form bodies, got particles/body -2 for particle 1"),
        (2, {"type_shapes": [ROUND], "orientation": TILTED}, "an axis along z in two dimensions"),
        (2, {"type_shapes": [DIMER], "orientation": TILTED}, "turn about z in two dimensions"),
        (3, {"type_shapes": [ROUND], "orientation": [[2.0, 0.0, 0.0, 0.0]] * 2}, "unit quaternions"),
    ],
)  # fmt: skip
def test_what_a_packing_cannot_have_is_refused_by_name(tmp_path, dimensions, particles, message):
    with pytest.raises(ValueError, match=f"a.gsd.*{message}"):
        pm.read_packing(written(tmp_path, two(dimensions, **particles)))


@pytest.mark.parametrize(("height", "tilt"), [(0.2, 0.0), (0.0, 0.1)])
def test_what_leaves_the_plane_in_two_dimensions_is_refused(tmp_path, height, tilt):
    frame = frame_of([[0.0, 0.0, 0.0], [1.0, 0.0, height]], [8.0, 9.0, 1.0, 0.0, tilt, 0.0], dimensions=2)
    with pytest.raises(ValueError, match="must lie in the plane z = 0 in two dimensions"):
        pm.read_packing(written(tmp_path, frame))


@pytest.mark.parametrize(
    ("shapes", "message"),
    [
        ([ROUND, DIMER], "must not be ellipsoids and unions of spheres in one packing"),
        ([ROUND, {}], "must all have shape definitions or diameters where one has, got none for 'B'"),
        ([ROUND], "must all have shape definitions or diameters where one has, got none for 'B'"),
    ],
)
def test_types_that_do_not_go_together_are_refused(tmp_path, shapes, message):
    with pytest.raises(ValueError, match=message):
        pm.read_packing(written(tmp_path, two(3, types=["A", "B"], typeid=[0, 1], type_shapes=shapes)))


# -- what is left out is listed ----------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("particles", "words"),
    [
        ({"velocity": [[0.0, 0.0, 0.0], [0.0, 1.0, 0.0]]}, "velocities"),
        ({"angmom": [[0.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0]]}, "angular momenta"),
        ({"charge": [1.0, -1.0]}, "charges"),
        ({"moment_inertia": [[0.1, 0.1, 0.1]] * 2}, "moments of inertia"),
        ({"orientation": [[0.0, 1.0, 0.0, 0.0]] * 2}, "orientations"),
        ({"types": ["A", "B"], "typeid": [0, 1]}, r"particle types \(A, B\), some of one size and shape"),
        ({"type_shapes": [ROUND], "diameter": [2.0, 2.0]}, "particles/diameter"),
    ],
)
def test_what_a_packing_has_no_place_for_is_listed(tmp_path, particles, words):
    with pytest.warns(UserWarning, match=rf"a.gsd: left out, as a packing (\(.*\) )?has no place for them: {words}"):
        assert pm.read_packing(written(tmp_path, two(3, **particles))).particles == 2


@pytest.mark.parametrize("kind", ["bonds", "angles", "dihedrals", "impropers", "pairs"])
def test_bonds_and_other_groups_without_lengths_are_listed(tmp_path, kind):
    frame = two()
    groups = getattr(frame, kind)
    groups.N, groups.types = 1, ["polymer"]
    groups.group = [[0, 1, 0, 1][: groups.M]]
    with pytest.warns(UserWarning, match=f"left out, .*: 1 {kind}"):
        assert not pm.read_packing(written(tmp_path, frame)).links


def test_bonds_of_constraints_are_links_and_the_others_are_listed(tmp_path):
    frame = frame_of([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]], [8.0, 9.0, 1.0, 0.0, 0.0, 0.0], dimensions=2)
    frame.constraints.N, frame.constraints.group, frame.constraints.value = 1, [[0, 1]], [1.0]
    frame.bonds.N, frame.bonds.group, frame.bonds.types = 2, [[1, 0], [1, 2]], ["polymer"]
    with pytest.warns(UserWarning, match="left out, .*: 1 bonds"):
        assert pm.read_packing(written(tmp_path, frame)).links == pm.Links([0], [1], [[0, 0]], [1.0])


def test_logged_quantities_are_listed(tmp_path):
    frame = two()
    frame.log = {"md/energy": np.array([1.0])}
    with pytest.warns(UserWarning, match="left out, .*: log entries md/energy"):
        pm.read_packing(written(tmp_path, frame))


def test_a_file_of_nothing_else_is_read_without_a_word(tmp_path):
    pm.read_packing(written(tmp_path, two(diameter=[1.0, 2.0], mass=[1.0, 3.0])))


@pytest.mark.parametrize("box", [30.0, 300.0])
def test_links_whose_positions_are_of_single_precision_have_their_lengths(tmp_path, box):
    rng = np.random.default_rng(1)
    place = rng.uniform(-0.5 * box, 0.5 * box, (50, 3))
    way = rng.normal(size=(50, 3))
    place = np.concatenate([place, place + 0.7 * way / np.linalg.norm(way, axis=1)[:, None]])
    place -= box * np.rint(place / box)
    frame = frame_of(place, [box] * 3 + [0.0] * 3)
    frame.constraints.N = 50
    frame.constraints.group, frame.constraints.value = np.arange(100).reshape(2, 50).T, [0.7] * 50
    found = pm.read_packing(written(tmp_path, frame))
    assert found.link_error < 1e-6 and np.abs(found.links.length_l - 0.7).max() < 4e-7 * box


# -- frames ------------------------------------------------------------------------------------------------------------


def test_every_frame_of_a_trajectory_is_read(tmp_path):
    path = written(tmp_path, *(two(diameter=[1.0 + k, 1.0]) for k in range(3)))
    assert [pm.read_packing(path, frame=k).radius_n[0] for k in range(3)] == [0.5, 1.0, 1.5]
    assert pm.read_packing(path, frame=-3).radius_n[0] == 0.5
    assert pm.read_packing(path) == pm.read_packing(path, frame=2) == pm.read_packing(path, frame=-1)


@pytest.mark.parametrize("frame", [3, -4])
def test_a_frame_that_is_not_there_is_refused(tmp_path, frame):
    path = written(tmp_path, *(two(diameter=[1.0 + k, 1.0]) for k in range(3)))
    with pytest.raises(ValueError, match=f"a.gsd.*frame must be below 3, the number of frames, got {frame}"):
        pm.read_packing(path, frame=frame)


def test_a_frame_of_a_file_of_one_packing_is_refused(tmp_path):
    pm.write_packing(pm.lattice_packing("square"), tmp_path / "a.npz")
    with pytest.raises(ValueError, match="frame must be left out for .npz files, which hold one packing, got 0"):
        pm.read_packing(tmp_path / "a.npz", frame=0)


def test_a_frame_that_another_program_appended_is_not_taken_for_the_first(tmp_path):
    packing = pm.lattice_packing("square", repeats=(2, 2))
    pm.write_packing(packing, tmp_path / "a.gsd")
    with gsd.open(str(tmp_path / "a.gsd"), "r+") as file:
        frame = file[0]
        frame.log = {}
        frame.particles.position = frame.particles.position + np.float32([0.25, 0.0, 0.0])
        file.append(frame)
    assert pm.read_packing(tmp_path / "a.gsd", frame=0) == packing
    assert pm.read_packing(tmp_path / "a.gsd").position_nd == pytest.approx(packing.position_nd + [0.25, 0.0])


def changed(tmp_path, change):
    """Write a packing, change the log chunks of its frame as another program would, and return the file."""
    pm.write_packing(pm.lattice_packing("triangular", repeats=(2, 2)), tmp_path / "a.gsd")
    with gsd.open(str(tmp_path / "a.gsd"), "r") as file:
        frame = file[0]
    change(frame.log)
    return written(tmp_path, frame)


@pytest.mark.parametrize("name", ["position_nd", "radius_n", "lattice_dd"])
def test_a_change_in_the_last_digit_breaks_the_seal(name, tmp_path):
    def change(log):
        array = log[f"packmech/{name}"].copy()
        array.flat[-1] = np.nextafter(array.flat[-1], np.inf)
        log[f"packmech/{name}"] = array

    with pytest.raises(ValueError, match="its arrays must be those that were written, by their seal"):
        pm.read_packing(changed(tmp_path, change))


@pytest.mark.parametrize("name", ["position_nd", "radius_n", "lattice_dd"])
def test_a_frame_that_lost_an_exact_array_is_not_read_in_single_precision(name, tmp_path):
    path = changed(tmp_path, lambda log: log.pop(f"packmech/{name}"))
    with pytest.raises(ValueError, match=f"it must hold all chunks packmech/.* got none named {name}"):
        pm.read_packing(path)


def test_a_seal_whose_name_was_damaged_is_not_taken_for_none(tmp_path):
    def change(log):
        log["packmech/sha255"] = log.pop("packmech/sha256")

    with pytest.raises(ValueError, match="must have names of packmech's, or a seal .sha256., got 'sha255'"):
        pm.read_packing(changed(tmp_path, change))


def test_a_count_that_no_file_could_hold_is_refused_before_there_is_room_for_it(tmp_path):
    import gsd.fl

    with gsd.fl.open(str(tmp_path / "b.gsd"), "w", application="any", schema="hoomd", schema_version=[1, 4]) as file:
        file.write_chunk("configuration/dimensions", np.array([2], dtype=np.uint8))
        file.write_chunk("particles/N", np.array([2**31], dtype=np.uint32))
        file.end_frame()
    with pytest.raises(ValueError, match="particles/N must be at most the bytes of its file, got 2147483648"):
        pm.read_packing(tmp_path / "b.gsd")


def test_a_frame_without_exact_arrays_is_read_as_every_reader_sees_it(tmp_path):
    packing = pm.lattice_packing("triangular", repeats=(2, 2))
    found = pm.read_packing(changed(tmp_path, lambda log: log.clear()))
    apart = found.position_nd - packing.position_nd
    assert np.abs(apart + packing.box.nearest_images(apart) @ packing.box.lattice_dd.T).max() < 1e-6
    # what was written before there were seals
    assert pm.read_packing(changed(tmp_path, lambda log: log.pop("packmech/sha256"))) == packing


def test_a_scene_file_names_the_frame(tmp_path):
    written(tmp_path, *(two(diameter=[1.0 + k, 1.0]) for k in range(3)))
    (tmp_path / "scene.toml").write_text(
        '[packing]\nkind = "file"\npath = "a.gsd"\nframe = 1\n[[effects]]\nkind = "repulsion"\nlaw = "harmonic"\n'
    )
    assert pm.read_scene(tmp_path / "scene.toml").packing.radius_n.tolist() == [1.0, 0.5]


# -- what other programs see -------------------------------------------------------------------------------------------


def test_equal_diameters_of_one_are_written_where_other_programs_look_for_them(tmp_path):
    # the schema does not store diameters of 1, and OVITO shows particles without sizes by a radius of 0
    pm.write_packing(pm.lattice_packing("square"), tmp_path / "a.gsd")
    with gsd.open(str(tmp_path / "a.gsd"), "r") as file:
        assert file[0].particles.type_shapes == [{"type": "Sphere", "diameter": 1.0}]


@pytest.mark.parametrize("seed", range(3))
def test_a_packing_is_read_from_what_other_programs_see_of_it(tmp_path, seed):
    packing = pm.random_packing(12, dimension=2, sizes=pm.Bidisperse(), packing_fraction=0.6, seed=seed)
    packing = packing.replace(radius_n=(0.5, 1.0, 2.0)[seed] * packing.radius_n)
    pm.write_packing(packing, tmp_path / "b.gsd")
    with gsd.open(str(tmp_path / "b.gsd"), "r") as file:
        frame = file[0]
    frame.log, frame.particles.diameter = {}, None
    found = pm.read_packing(written(tmp_path, frame))
    assert found.radius_n == pytest.approx(packing.radius_n, rel=1e-12)


# -- npz ---------------------------------------------------------------------------------------------------------------


def test_arrays_that_a_packing_has_no_place_for_are_listed(tmp_path):
    arrays = {"position_nd": [[0.0, 0.0]], "radius_n": [0.5], "lattice_dd": 2.0 * np.eye(2)}
    np.savez(tmp_path / "a.npz", **arrays, velocity_nd=[[1.0, 0.0]], mass=[2.0])
    with pytest.warns(UserWarning, match="a.npz: left out, .*: arrays velocity_nd, mass"):
        assert pm.read_packing(tmp_path / "a.npz").given_mass_n is None


def test_arrays_of_two_kinds_of_shapes_are_refused(tmp_path):
    packing = pm.Packing([[0.0, 0.0]], [0.5], pm.Box.cubic(2.0, 2), shapes=pm.Spheroids([2.0], [[1.0, 0.0]]))
    pm.write_packing(packing, tmp_path / "a.npz")
    with np.load(tmp_path / "a.npz") as file:
        arrays = dict(file)
    body = pm.rigid_packing(pm.Packing([[0.0, 0.0], [0.5, 0.0]], [0.5, 0.5], pm.Box.cubic(3.0, 2)), [0, 0]).shapes
    for name in ("start_n", "offset_bd", "size_b", "gyration_nk", "orientation_nq"):
        arrays[f"bead_{name}"] = getattr(body, name)
    del arrays["sha256"]
    np.savez(tmp_path / "a.npz", **arrays)
    with pytest.raises(ValueError, match="must hold arrays of .* or of superellipsoids, got several"):
        pm.read_packing(tmp_path / "a.npz")


def test_each_kind_and_size_is_a_particle_type_of_its_own(tmp_path):
    packing = pm.random_packing(12, dimension=2, packing_fraction=0.5, seed=1)
    packing = packing.replace(kind_n=[0, 0, 0, 2, 2, 2, 2, 2, 2, 2, 2, 2])
    pm.write_packing(packing, tmp_path / "a.gsd")
    with gsd.open(tmp_path / "a.gsd", "r") as file:
        particles = file[0].particles
    # six small ones stand first
    assert particles.types == ["kind0_A", "kind2_A", "kind2_B"]
    assert particles.typeid.tolist() == [0, 0, 0, 1, 1, 1, 2, 2, 2, 2, 2, 2]
    size = {name: shape["diameter"] for name, shape in zip(particles.types, particles.type_shapes, strict=True)}
    assert size == {"kind0_A": 1.0, "kind2_A": 1.0, "kind2_B": pytest.approx(1.4, rel=1e-15)}


@pytest.mark.parametrize("shape", ["discs", "ellipses", "bodies", "polydisperse"])
def test_kinds_are_read_from_names_of_types_where_another_program_wrote_the_frame(tmp_path, shape):
    shapes = {"ellipses": pm.Ellipses(1.5), "bodies": pm.Dimer()}.get(shape)
    sizes = pm.LogNormal(0.1) if shape == "polydisperse" else pm.Bidisperse()
    packing = pm.random_packing(20, dimension=2, packing_fraction=0.5, seed=1, shapes=shapes, sizes=sizes)
    packing = pm.assign_kinds(packing, (1, 1, 1), seed=2)
    pm.write_packing(packing, tmp_path / "a.gsd")
    with gsd.open(tmp_path / "a.gsd", "r") as file:
        frame = file[0]
    frame.log = {}
    with gsd.open(tmp_path / "b.gsd", "w") as file:
        file.append(frame)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        assert pm.read_packing(tmp_path / "b.gsd").kind_n.tolist() == packing.kind_n.tolist()


def test_a_frame_whose_types_another_program_changed_is_refused(tmp_path):
    packing = pm.random_packing(20, dimension=2, packing_fraction=0.5, seed=1, sizes=pm.Monodisperse())
    pm.write_packing(pm.assign_kinds(packing, (1, 1), seed=2), tmp_path / "a.gsd")
    with gsd.open(tmp_path / "a.gsd", "r") as file:
        frame = file[0]
    frame.particles.typeid = 1 - frame.particles.typeid
    with gsd.open(tmp_path / "b.gsd", "w") as file:
        file.append(frame)
    with pytest.raises(ValueError, match="must be one packing, got two that differ"):
        pm.read_packing(tmp_path / "b.gsd")
