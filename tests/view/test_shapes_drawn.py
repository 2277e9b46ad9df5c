"""Facts about pictures and recordings of ellipses and spheroids."""

import json

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import packmech as pm
from packmech.cli import execute
from packmech.view import drawing
from packmech.view.frame import blank, paint_ellipses, paint_spheroids


@pytest.mark.parametrize("aspect", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("angle", [0.0, 0.4, 1.3])
def test_an_ellipse_covers_its_area_where_it_lies(aspect, angle):
    along, across = 80.0 * np.sqrt(aspect), 80.0 / np.sqrt(aspect)
    image = blank((400, 300), (0, 0, 0))
    # pixels go down
    axis = np.array([[np.cos(angle), -np.sin(angle)]])
    paint_ellipses(
        image, np.array([[190.0, 140.0]]), np.array([along]), np.array([across]), axis, np.full((1, 3), 200.0)
    )
    covered = image[:, :, 0] > 40.0
    assert covered.sum() == pytest.approx(np.pi * 80.0**2, rel=0.02)
    y, x = np.nonzero(covered)
    assert (x.mean(), y.mean()) == pytest.approx((189.5, 139.5), abs=0.1)
    value, vector = np.linalg.eigh(np.cov(x, -y))
    assert np.allclose(np.sqrt(4.0 * value), sorted([along, across]), rtol=0.01)
    if aspect != 1.0:
        found = vector[:, 1] if aspect > 1.0 else vector[:, 0]
        assert abs(found @ [np.cos(angle), np.sin(angle)]) == pytest.approx(1.0, abs=1e-4)


def test_superellipses_are_painted_as_the_ellipses_that_they_are_and_cover_their_areas():
    ellipses = pm.random_packing(12, dimension=2, packing_fraction=0.5, seed=1, shapes=pm.Ellipses(1.6))
    aspect, turn = ellipses.shapes.aspect_n, ellipses.shapes.director_nd
    same = pm.Superellipsoids(np.full(12, 2.0), np.stack([aspect, np.ones(12)], axis=1), turn)
    one, other = (pm.draw_frame(ellipses.replace(shapes=each)) for each in (ellipses.shapes, same))
    assert np.abs(one.astype(float) - other.astype(float)).mean() < 0.5
    for exponent in (2.0, 6.0, 50.0):
        alone = pm.Superellipsoids([exponent], [[1.7, 1.0]], [[0.6, 0.8]])
        packing = pm.Packing([[2.0, 2.0]], [1.0], pm.Box.cubic(4.0, 2), shapes=alone)
        pixels = pm.draw_frame(packing).sum(axis=-1).astype(int)
        inside = np.s_[60:420, 60:420]
        side = (480 / 1.24) / 4.0
        covered = (np.abs(pixels[inside] - sum(drawing.BACKGROUND)) > 60).sum()
        # pixels on the outline are covered in part: half of them, about, and surely less than all
        outline = drawing.silhouettes(packing)[0]
        crossed = side * np.linalg.norm(np.diff(outline, axis=0), axis=1).sum()
        assert covered == pytest.approx(np.pi * side**2, abs=0.5 * crossed)


@pytest.mark.parametrize("aspect", [0.5, 2.0])
def test_a_spheroid_seen_along_its_axis_is_a_disc_and_across_it_an_ellipse(aspect):
    along, across = 60.0 * aspect, 60.0
    for axis, width in (([0.0, 0.0, 1.0], across), ([1.0, 0.0, 0.0], along), ([0.6, 0.0, 0.8], None)):
        image, depth = blank((400, 300), (0, 0, 0)), np.full((300, 400), -np.inf)
        sizes = np.array([along]), np.array([across])
        paint_spheroids(image, depth, np.array([[190.0, 140.0, 5.0]]), *sizes, np.array([axis]), np.full((1, 3), 200.0))
        width = np.hypot(0.6 * along, 0.8 * across) if width is None else width
        assert np.isfinite(depth).sum() == pytest.approx(np.pi * across * width, rel=0.02)
        x = np.nonzero(np.isfinite(depth))[1]
        assert np.ptp(x) == pytest.approx(2.0 * width, abs=2.0)
        # its top is as high as the axis lets it be
        top = np.hypot(axis[2] * along, np.hypot(*axis[:2]) * across)
        assert depth.max() == pytest.approx(5.0 + top, abs=0.2)


def test_aspect_one_is_drawn_as_discs_and_spheres_are():
    for d in (2, 3):
        packing = pm.random_packing(20, dimension=d, packing_fraction=0.5, seed=1)
        shapes = pm.Spheroids(np.ones(20), np.eye(d)[[0] * 20])
        one, other = (pm.draw_frame(each, size=(240, 200)) for each in (packing, packing.replace(shapes=shapes)))
        assert np.abs(one.astype(float) - other.astype(float)).mean() < 1.0


def test_quaternions_turn_the_first_axis_to_the_director():
    shapes = pm.Spheroids(np.full(50, 2.0), np.random.default_rng(1).normal(size=(50, 3)))
    x, y, z, w = drawing.orientations(shapes.director_nd).T
    first = np.stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)], axis=1)
    assert np.abs(np.abs((first * shapes.director_nd).sum(axis=1)) - 1.0).max() < 1e-12


@pytest.mark.parametrize("d", [2, 3])
def test_recordings_are_written_and_take_shapes_of_the_scene_alone(tmp_path, d):
    start = pm.random_packing(8, dimension=d, packing_fraction=0.9, seed=1, shapes=pm.Ellipses(1.6))
    scene = pm.Scene(start, (pm.Repulsion(),))
    run = pm.quench(scene, force_tolerance=1e-6, trace_every=20, trace_positions=True)
    path = pm.record_run(run, tmp_path / "run.rrd", scene=scene)
    assert path.stat().st_size > 1000
    assert pm.record_packing(scene.replace(packing=run.packing), tmp_path / "one.rrd").stat().st_size > 1000
    with pm.Recording(tmp_path / "live.rrd", scene) as recording:
        recording.add(run.packing, figures={"energy": 1.0})
        with pytest.raises(ValueError, match="shapes as the scene has"):
            recording.add(run.packing.replace(shapes=None))


def test_the_report_counts_turns_and_names_what_it_judges_by(tmp_path, capsys):
    start = pm.random_packing(20, dimension=2, packing_fraction=0.6, seed=1, shapes=pm.Ellipses(1.5))
    scene = pm.Scene(start, (pm.Repulsion(),))
    pm.write_packing(pm.jam(scene, pressure=1e-6, strain="isotropic").packing, tmp_path / "one.npz", law=pm.Harmonic())
    assert execute(["analyze", str(tmp_path / "one.npz"), "--json", str(tmp_path / "one.json")]) == 0
    said = capsys.readouterr().out
    for words in ("20 ellipses", "with turns", "quartic modes", "by the Hessian", "1 state of self stress"):
        assert words in said
    numbers = json.loads((tmp_path / "one.json").read_text(encoding="utf-8"))
    assert numbers["local_minimum"] and numbers["quartic_modes"] == numbers["floppy_modes"] > 0
    assert numbers["least_quartic_curvature"] > 0.0 and "collective" not in numbers


def test_bodies_are_drawn_as_their_beads_are():
    # two discs that do not touch: no line marks a contact between the beads
    two = pm.Packing([[2.0, 2.2], [2.63, 1.36]], [0.5, 0.5], pm.Box.cubic(4.0, 2))
    body = pm.rigid_packing(two, [0, 0])
    one, other = (pm.draw_frame(each, size=(240, 200)).astype(float) for each in (body, pm.bead_packing(body)))
    # the box is drawn in units of the particles; a body has a hue of its own
    inside = np.s_[30:170, 50:190]
    ground = np.array(drawing.BACKGROUND)
    covered, expected = ((np.abs(each - ground).sum(axis=-1) > 3.0)[inside] for each in (one, other))
    assert np.mean(covered != expected) < 0.002 and 0.1 < covered.mean() < 0.9
    for d in (2, 3):
        plain = pm.random_packing(20, dimension=d, packing_fraction=0.3, seed=1)
        single = pm.rigid_packing(plain, np.arange(20))
        one, other = (pm.draw_frame(each, size=(240, 200)).astype(float) for each in (plain, single))
        assert np.abs(one - other).mean() < 1e-9


@pytest.mark.parametrize("d", [2, 3])
def test_recordings_of_bodies_hold_their_beads_and_orientations(d, tmp_path):
    start = pm.random_packing(6, dimension=d, packing_fraction=0.9, seed=1, shapes=pm.Dimer(0.8))
    scene = pm.Scene(start, (pm.Repulsion(),))
    run = pm.quench(scene, force_tolerance=1e-8, trace_every=20, trace_positions=True)
    assert run.trace.orientation_tnq.shape[1:] == start.shapes.orientation_nq.shape
    path = pm.record_run(run, tmp_path / "bodies.rrd", scene=scene)
    assert path.stat().st_size > 1000
    with pm.Recording(tmp_path / "live.rrd", scene) as recording:
        recording.add(run.packing, figures={"energy": 1.0})
        with pytest.raises(ValueError, match="shapes as the scene has"):
            recording.add(pm.random_packing(6, dimension=d, packing_fraction=0.9, seed=1, shapes=pm.Dimer(0.7)))


def test_a_recording_of_superellipsoids_holds_their_surfaces_where_they_are(tmp_path):
    read = pytest.importorskip("rerun.chunk").RrdReader
    form = pm.Superellipses(5.0, (1.3, 1.0, 0.8))
    start = pm.random_packing(6, dimension=3, packing_fraction=0.55, seed=1, shapes=form)
    exponent = [5.0, 5.0, 2.0, 5.0, 2.0, 30.0]
    shapes = pm.Superellipsoids(exponent, start.shapes.ratio_nd, start.shapes.orientation_nq)
    scene = pm.Scene(start.replace(shapes=shapes), (pm.Repulsion(),))
    run = pm.quench(scene, force_tolerance=1e-8, trace_every=20, trace_positions=True)
    path = pm.record_run(run, tmp_path / "solids.rrd", scene=scene)
    found = {}
    for chunk in read(str(path)).stream().to_chunks():
        batch = chunk.to_record_batch()
        for name in batch.schema.names:
            found.setdefault(str(chunk.entity_path).strip("/"), {}).setdefault(name, []).extend(
                batch.column(name).to_pylist()
            )
    parts = [found[name] for name in sorted(found) if name.startswith("world/particles/")]
    places, end = run.packing.wrapped().position_nd, run.packing.shapes
    seen, axes = [], end.axes(run.packing.radius_n)
    for part in parts:
        corner_vd = np.array(part["Mesh3D:vertex_positions"][0])
        poses = (part[f"InstancePoses3D:{name}"] for name in ("translations", "quaternions", "scales"))
        for place, turn, scale in zip(*(np.array(one[-1]) for one in poses), strict=True):
            n = int(np.argmin(np.linalg.norm(places - place, axis=1)))
            seen.append(n)
            drawn = Rotation.from_quat(turn).apply(scale * corner_vd)
            # on the surface, in the frame of the particle
            own = np.abs(drawn @ end.frames()[n] / axes[n])
            level = (own ** end.exponent_n[n]).sum(axis=1) ** (1.0 / end.exponent_n[n])
            assert np.abs(level - 1.0).max() < 1e-5
            # the corners reach to the ends of the axes on both sides
            assert np.allclose([own.max(axis=0)], 1.0, atol=1e-5)
            faces = corner_vd[np.array(part["Mesh3D:triangle_indices"][0])]
            assert np.linalg.det(faces).min() > -1e-9
    assert sorted(seen) == list(range(6))


def test_rigid_bodies_of_several_beads_have_hues_of_their_own():
    packing = pm.random_packing(4, dimension=2, packing_fraction=0.3, seed=1, shapes=pm.Dimer(0.8))
    colors = [tuple(one) for one in drawing.particle_colors(packing).tolist()]
    assert len(set(colors)) == 4 and set(colors) <= set(drawing.CLUSTERS)
    single = pm.rigid_packing(pm.bead_packing(packing), np.arange(8))
    assert np.array_equal(drawing.particle_colors(single), drawing.particle_colors(pm.bead_packing(packing)))


@pytest.mark.parametrize(("name", "wide"), [("along", 3.0), ("across", 1.0 / 3.0), ("two discs side by side", 2.0)])
def test_pictures_of_runs_show_shapes_as_they_are(tmp_path, name, wide):
    from PIL import Image

    if name == "two discs side by side":
        touching = pm.Packing([[1.5, 2.0], [2.5, 2.0]], [0.5, 0.5], pm.Box.cubic(4.0, 2))
        shapes = pm.rigid_packing(touching, [0, 0]).shapes
    else:
        shapes = pm.Spheroids([3.0], [[1.0, 0.0] if name == "along" else [0.0, 1.0]])
    packing = pm.Packing([[2.0, 2.0]], [0.5], pm.Box.cubic(4.0, 2), shapes=shapes)
    scene = pm.Scene(packing, (pm.Repulsion(),))
    run = pm.quench(scene, force_tolerance=1e-6)
    with Image.open(pm.write_pictures(run, tmp_path, scene=scene, frames=2)[0]) as image:
        seen = np.asarray(image).astype(int)
    # particles are blue, and all else beside the plots is gray
    part = seen[:, : int(0.64 * seen.shape[1])]
    y, x = np.nonzero(part[:, :, 2] - part[:, :, 0] > 40)
    assert np.ptp(x) / np.ptp(y) == pytest.approx(wide, rel=0.03)


def test_a_body_in_space_is_drawn_with_its_upper_bead_above():
    beads = pm.Packing([[0.0, 0.0, 0.0], [0.0, 0.0, 1.2]], [0.8, 0.4], pm.Box.cubic(6.0, 3))
    body = pm.rigid_packing(beads.replace(position_nd=beads.position_nd + 3.0), [0, 0])
    picture = pm.draw_frame(body, size=(300, 300)).astype(int)
    # the hue of a body is bluer than the edges of the box
    row, column = np.nonzero(picture[:, :, 2] - picture[:, :, 0] > 30)
    third = np.ptp(row) // 3
    assert np.ptp(column[row < row.min() + third]) < 0.8 * np.ptp(column[row > row.max() - third])
