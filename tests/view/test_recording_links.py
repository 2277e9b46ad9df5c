"""Facts about recordings of packings with rigid links: what is drawn apart, where it ends, what is kept exactly."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import packmech as pm
from packmech.cli.output import Watch
from packmech.scenes import run as run_drive
from packmech.view import drawing
from packmech.view.trajectory import trace_of, trajectory_of_run

HARMONIC = (pm.Repulsion(),)


@pytest.fixture(scope="module", autouse=True)
def strict_rerun():
    import rerun as rr

    rr.set_strict_mode(True)  # bad data are errors, not warnings
    yield
    rr.set_strict_mode(False)


def columns(path):
    """Every column of a recording by entity and name: {step: value}, or the one value of static data."""
    import rerun.chunk as chunk

    found = {}
    for piece in chunk.RrdReader(path).stream().to_chunks():
        batch = piece.to_record_batch()
        steps = batch.column("step").to_pylist() if "step" in batch.schema.names else None
        for name in set(batch.schema.names) - {"log_time", "rerun.controls.RowId", "step"}:
            values = batch.column(name).to_pylist()
            key = (str(piece.entity_path), name)
            if steps is None:
                found[key] = values[0]
            else:
                found.setdefault(key, {}).update(zip(steps, values, strict=True))
    return found


def trimers(dimension, count=8, seed=3):
    return pm.cluster_packing(
        count,
        pm.Trimer(angle=(1.2, 2.6)),
        dimension=dimension,
        packing_fraction=0.9 if dimension == 2 else 0.65,
        seed=seed,
    )


@pytest.fixture(scope="module", params=[2, 3], ids=["2D", "3D"])
def recorded(request, tmp_path_factory):
    """Trimers relaxed with strain, as the command records them."""
    drive = pm.ShearStabilizeDrive(pressure=1e-3, force_tolerance=1e-8)
    scene = pm.Scene(trimers(request.param), HARMONIC, drive)
    watch = Watch(lambda words: None)
    run = run_drive(scene, frames=60, progress=watch)
    run = replace(run, trace=trace_of(scene, watch.step_t, watch.packing_t))
    bare = run_drive(scene)
    assert np.array_equal(run.packing.position_nd, bare.packing.position_nd)
    path = pm.record_run(run, tmp_path_factory.mktemp("recorded") / "run.rrd", scene=scene)
    return SimpleNamespace(scene=scene, run=run, column=columns(path), d=request.param)


def strips(recorded, entity):
    return recorded.column[entity, f"LineStrips{recorded.d}D:strips"]


def crossing(packing):
    """Number of links that cross the cell's edge, bonds and shapes."""
    links = packing.wrapped().links
    out = links.image_ld.any(axis=1)
    return np.count_nonzero(out & ~links.shape_l), np.count_nonzero(out & links.shape_l)


def test_links_contacts_and_box_are_entities_of_their_own_at_every_frame(recorded):
    steps = set(strips(recorded, "/world/box"))
    assert len(steps) > 5
    assert min(steps) == 0
    for entity in ("/world/forces", "/world/links/bonds", "/world/links/shapes"):
        assert set(strips(recorded, entity)) == steps


def test_every_bond_and_every_shape_link_is_drawn_once_and_again_where_it_crosses_the_edge(recorded):
    last = max(strips(recorded, "/world/box"))
    across_bonds, across_shapes = crossing(recorded.run.packing)
    assert across_bonds > 0
    assert len(strips(recorded, "/world/links/bonds")[last]) == 16 + across_bonds
    assert len(strips(recorded, "/world/links/shapes")[last]) == 8 + across_shapes


def test_lines_of_bonds_have_the_bonds_length_at_every_frame(recorded):
    for lines in strips(recorded, "/world/links/bonds").values():
        ends = np.array(lines)
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        assert np.allclose(length, 1.0, rtol=1e-5)  # the picture is kept in single precision


def test_exact_positions_and_images_of_every_frame_hold_the_links(recorded):
    links = recorded.scene.packing.links
    kept = {name: np.array(recorded.column["/state/links", name]) for name in ("i_l", "j_l", "length_l", "shape_l")}
    assert np.array_equal(kept["length_l"], links.length_l)
    assert np.array_equal(kept["shape_l"], links.shape_l)
    lattices = recorded.column["/state/lattice", "lattice_dd"]
    images = recorded.column["/state/link_image", "image_ld"]
    for step, flat in recorded.column["/state/position", "position_nd"].items():
        x = np.array(flat).reshape(-1, recorded.d)
        lattice = np.array(lattices[step]).reshape(recorded.d, recorded.d)
        image = np.array(images[step]).reshape(-1, recorded.d)
        length = np.linalg.norm(x[kept["j_l"]] - x[kept["i_l"]] + image @ lattice.T, axis=1)
        assert np.abs(length - links.length_l).max() < 1e-12


def test_the_box_moves(recorded):
    lattices = recorded.column["/state/lattice", "lattice_dd"]
    assert len({tuple(lattice) for lattice in lattices.values()}) >= 3


def test_a_packing_without_links_has_no_entity_of_links(tmp_path):
    crystal = pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.01)
    found = {entity for entity, _ in columns(pm.record_packing(pm.Scene(crystal, HARMONIC), tmp_path / "a.rrd"))}
    assert not [entity for entity in found if "link" in entity]
    assert {"/world/forces", "/world/box", "/world/particles"} <= found


def test_a_packing_with_links_but_without_law_is_recorded(tmp_path):
    found = columns(pm.record_packing(trimers(2), tmp_path / "a.rrd"))
    radius = np.array(found["/world/links/bonds", "LineStrips2D:radii"][0])
    assert len(np.unique(radius)) == 1


@pytest.mark.parametrize("dimension", [2, 3])
def test_linked_pairs_are_no_contacts_wherever_the_particles_stand(dimension):
    packing = trimers(dimension)
    shift = np.random.default_rng(1).integers(-2, 3, packing.position_nd.shape)
    moved = packing.replace(
        position_nd=packing.position_nd + shift @ packing.box.lattice_dd.T, links=packing.links.moved(-shift)
    )
    assert moved.link_error < 1e-12
    assert len(drawing.draw_packing(moved).force_s) == len(drawing.draw_packing(packing).force_s)


@pytest.mark.parametrize("dimension", [2, 3])
def test_lines_of_links_end_in_centers_or_their_copies(dimension):
    packing = trimers(dimension)
    picture = drawing.draw_packing(packing, HARMONIC)
    ends = np.concatenate([picture.bond_sed, picture.shape_sed]).reshape(-1, dimension) @ packing.box.inverse_dd.T
    offset = ends[:, None, :] - (picture.center_nd @ packing.box.inverse_dd.T)[None, :, :]
    assert np.abs(offset - np.rint(offset)).max(axis=2).min(axis=1).max() < 1e-12


def test_tension_of_a_compressed_chain_around_the_box_is_drawn_as_compression_over_the_mean_contact_force():
    links = pm.Links([0, 1], [1, 2], [[0, 0], [1, 0]], [1.0, 1.0])
    chain = pm.Packing([[0.0, 0.0], [1.0, 0.0], [-0.9, 0.0]], [0.5] * 3, pm.Box.cubic(2.9, 2), links)
    picture = drawing.draw_packing(chain, HARMONIC)
    # one contact presses with the force that both links pass on; a link across the edge is drawn at both ends
    assert np.allclose(picture.bond_tension_s, -1.0)
    assert len(picture.shape_sed) == 0


def test_links_are_violet_in_compression_green_in_tension_and_gray_without_force():
    colors = drawing.tension_colors(np.array([-9.0, 0.0, 9.0]), shape=False)
    assert colors.tolist() == [list(drawing.COMPRESSION), list(drawing.IDLE_BOND), list(drawing.TENSION)]


def test_a_link_is_as_wide_as_a_contact_of_its_force_and_never_too_thin_to_be_seen():
    wide = drawing.tension_radii(np.array([-2.0, 2.0, 0.0]), 1.0, 2, shape=False)
    assert wide.tolist() == drawing.force_radii(np.array([2.0, 2.0, drawing.THINNEST]), 1.0, 2).tolist()
    assert np.allclose(drawing.tension_radii(np.array([2.0]), 1.0, 2, shape=True), 0.5 * wide[1])


def test_beads_of_a_cluster_share_a_color_and_rattlers_keep_theirs():
    links = pm.Links([0, 2], [1, 3], [[0, 0]] * 2, [1.0] * 2)
    row = pm.Packing([[k + 0.5, 1.0] for k in range(5)], np.full(5, 0.5), pm.Box.cubic(10.0, 2), links=links)
    rattler_n = np.array([False, False, False, True, False])
    color_nc = drawing.particle_colors(row, rattler_n=rattler_n).tolist()
    first, second = (list(color) for color in drawing.CLUSTERS[:2])
    assert color_nc == [first, first, second, list(drawing.RATTLER), list(drawing.LARGE)]


@pytest.mark.parametrize("dimension", [2, 3])
def test_packings_kept_with_other_images_are_drawn_with_their_links_whole(dimension):
    packing = trimers(dimension)
    shift = np.random.default_rng(2).integers(-1, 2, packing.position_nd.shape)
    moved = packing.replace(
        position_nd=packing.position_nd + shift @ packing.box.lattice_dd.T, links=packing.links.moved(-shift)
    )
    scene = pm.Scene(packing, HARMONIC)
    run = pm.Run(packing, pm.Outcome.CONVERGED, 0.0, 9, 9, 0.0, trace=trace_of(scene, [0, 5], [packing, moved]))
    assert max(frame.link_error for frame in trajectory_of_run(run, scene, 10).packing_f) < 1e-12
