"""Facts about surfaces in files that hold triangles without an area."""

import numpy as np
import pytest

import packmech as pm

pytest.importorskip("trimesh")
# two triangles of a square, one with two corners at one place, and one whose corners are in a row
CORNERS = ["0 0 0", "1 0 0", "0 1 0", "1 1 0", "2 0 0", "0 0 0"]
SOUND, FLAT = ["3 0 1 2", "3 1 3 2"], ["3 0 5 1", "3 0 1 4"]


def written(folder, faces):
    path = folder / "surface.off"
    path.write_text("\n".join(["OFF", f"{len(CORNERS)} {len(faces)} 0", *CORNERS, *faces]))
    return path


def test_triangles_without_an_area_are_left_out_where_that_is_asked_for(tmp_path):
    path = written(tmp_path, [SOUND[0], *FLAT, SOUND[1]])
    with pytest.raises(
        ValueError, match=r"triangles must have an area, got none of number 1: pm.read_mesh\(.*drop_flat"
    ):
        pm.MeshWalls(*pm.read_mesh(path))
    mesh = pm.read_mesh(path, drop_flat=True)
    walls = pm.MeshWalls(*mesh)
    assert len(walls) == 2
    sides = np.cross(walls.corner_tcd[:, 1] - walls.corner_tcd[:, 0], walls.corner_tcd[:, 2] - walls.corner_tcd[:, 0])
    assert np.linalg.norm(sides, axis=1).sum() / 2.0 == pytest.approx(1.0)
    np.testing.assert_array_equal(pm.read_mesh(written(tmp_path, SOUND), drop_flat=True).triangles, mesh.triangles)


def test_a_file_of_flat_triangles_alone_is_refused(tmp_path):
    with pytest.raises(ValueError, match="path must name a file of triangles, got none with an area"):
        pm.read_mesh(written(tmp_path, FLAT), drop_flat=True)
    with pytest.raises(TypeError, match="drop_flat must be"):
        pm.read_mesh(written(tmp_path, SOUND), drop_flat=1)
