"""Facts about packings as objects of other programs: nothing is lost that these have a place for."""

import types

import numpy as np
import pytest

import packmech as pm


def discs(dimension=2, seed=2, **changes):
    lattice = np.array([[6.0, 1.5, -0.5], [0.3, 5.5, 0.75], [0.0, -0.2, 5.0]])[:dimension, :dimension]
    packing = pm.random_packing(60, dimension=dimension, packing_fraction=0.9, box=lattice, seed=seed)
    return packing.replace(**changes)


@pytest.mark.parametrize("dimension", [2, 3])
def test_atoms_of_ase_hold_the_packing_exactly(dimension):
    ase = pytest.importorskip("ase")
    rng = np.random.default_rng(1)
    shapes = pm.Spheroids(rng.uniform(0.5, 2.0, 60), rng.normal(size=(60, dimension)))
    packing = discs(dimension, mass_n=rng.uniform(1.0, 2.0, 60), shapes=shapes)
    snapshot = pm.Snapshot(packing, {"velocity_nd": rng.normal(size=(60, dimension)), "age": np.arange(60)})
    atoms = pm.to_ase(snapshot)
    assert isinstance(atoms, ase.Atoms) and atoms.pbc.tolist() == [True, True, dimension == 3]
    assert pm.from_ase(atoms) == snapshot


def test_atoms_of_ase_have_radii_by_symbol_and_velocities():
    ase = pytest.importorskip("ase")
    atoms = ase.Atoms("CuAu", [[0.5, 0.25, 1.0], [1.75, 0.5, 1.5]], cell=[6, 5, 4], pbc=True)
    atoms.set_velocities([[0.25, 0.0, 0.0], [0.0, 0.0, 0.5]])
    found = pm.from_ase(atoms, radius={"Cu": 0.5, "Au": 0.75})
    assert found.packing == pm.Packing([[0.5, 0.25, 1.0], [1.75, 0.5, 1.5]], [0.5, 0.75], [6.0, 5.0, 4.0])
    np.testing.assert_allclose(found.fields["velocity_nd"], [[0.25, 0.0, 0.0], [0.0, 0.0, 0.5]], rtol=1e-14)
    assert found.fields["species"].tolist() == ["Cu", "Au"]
    with pytest.raises(ValueError, match="it holds no radii"):
        pm.from_ase(atoms)
    atoms.info["note"] = 3
    with pytest.warns(UserWarning, match="atoms: left out, .*: info note"):
        pm.from_ase(atoms, radius=0.5)
    atoms.pbc = [True, False, True]
    with pytest.raises(ValueError, match="atoms must be periodic along each axis"):
        pm.from_ase(atoms, radius=0.5)
    with pytest.raises(TypeError, match="atoms must be ase.Atoms, got int"):
        pm.from_ase(3)


def linked(packing):
    contacts = pm.find_contacts(packing)
    first = np.flatnonzero(contacts.i_c != contacts.j_c)[:4]
    pairs = (one[first] for one in (contacts.i_c, contacts.j_c, contacts.image_cd, contacts.distance_c))
    return packing.replace(links=pm.Links(*pairs))


def test_what_atoms_do_not_hold_is_refused_unless_it_is_dropped():
    pytest.importorskip("ase")
    packing = linked(discs())
    with pytest.raises(
        ValueError, match=r"packing must have no links for pm.to_ase \(only .npz, .* keep them; drop=True"
    ):
        pm.to_ase(packing)
    assert pm.from_ase(pm.to_ase(packing, drop=True)).packing == packing.replace(links=None)


@pytest.mark.parametrize("dimension", [2, 3])
def test_frames_of_hoomd_hold_the_snapshot_exactly(dimension):
    packing = linked(discs(dimension))
    forces = pm.contact_forces(pm.Scene(packing.replace(links=None), (pm.Repulsion(),)))
    snapshot = pm.Snapshot(packing, {"velocity_nd": packing.position_nd}, contact_forces=forces, step=5)
    assert pm.from_hoomd(pm.to_hoomd(snapshot)) == snapshot
    with pytest.raises(ValueError, match="packing must have no fields name for pm.to_hoomd"):
        pm.to_hoomd(pm.Snapshot(packing, {"name": ["a"] * 60}))


def test_a_snapshot_of_hoomd_is_read_by_its_arrays():
    """HOOMD's snapshots have the fields of the schema, but neither a step nor shapes nor logs."""
    frame = pm.to_hoomd(pm.Snapshot(discs(3), {"velocity_nd": discs(3).position_nd}))
    theirs = types.SimpleNamespace(
        configuration=types.SimpleNamespace(box=frame.configuration.box, dimensions=3),
        particles=types.SimpleNamespace(
            **{name: getattr(frame.particles, name)
               for name in ("N", "position", "velocity", "image", "mass", "diameter", "types", "typeid")}
        ),
        bonds=types.SimpleNamespace(N=0, group=np.zeros((0, 2)), types=[]),
    )  # fmt: skip
    found = pm.from_hoomd(theirs)
    np.testing.assert_allclose(found.packing.radius_n, discs(3).radius_n, rtol=1e-7)
    assert found.packing.box.volume == pytest.approx(discs(3).box.volume, rel=1e-6)
    assert found.fields["velocity_nd"].shape == (60, 3)
    with pytest.raises(TypeError, match="frame must be a gsd.hoomd.Frame or a hoomd.Snapshot, got int"):
        pm.from_hoomd(3)


@pytest.mark.parametrize("dimension", [2, 3])
def test_freud_finds_the_contacts_of_a_packing(dimension):
    freud = pytest.importorskip("freud")
    packing = discs(dimension, radius_n=0.6)
    query = freud.locality.AABBQuery.from_system(pm.to_freud(packing))
    pairs = query.query(query.points, {"r_max": 1.2, "exclude_ii": True}).toNeighborList()
    contacts = pm.find_contacts(packing)
    assert len(pairs.distances) == 2 * len(contacts)
    seen = np.sort(pairs.distances[pairs.query_point_indices < pairs.point_indices])
    np.testing.assert_allclose(seen, np.sort(contacts.distance_c), rtol=1e-5, atol=1e-5)
    found = pm.from_freud(query, radius=0.6).packing
    assert len(pm.find_contacts(found)) == pytest.approx(len(contacts), abs=2)  # in single precision
    assert found.box.volume == pytest.approx(packing.box.volume, rel=1e-6)
    with pytest.raises(TypeError, match="system must be a freud box and points, got int"):
        pm.from_freud(3, radius=0.5)


def test_a_graph_of_contacts_has_its_images_and_forces():
    networkx = pytest.importorskip("networkx")
    # two discs that touch through several images
    packing = pm.Packing([[0.1, 0.2], [1.0, 0.3]], 0.6, 2.0)
    scene = pm.Scene(packing, (pm.Repulsion(),))
    forces = pm.contact_forces(scene)
    graph = pm.to_networkx(forces)
    assert isinstance(graph, networkx.MultiGraph) and graph.number_of_edges(0, 1) == 2
    assert graph.degree(0) == 2 and graph.nodes[1] == {"position": (1.0, 0.3), "radius": 0.6}
    held = {image: data for _, _, image, data in graph.edges(keys=True, data=True)}
    for c, image in enumerate(map(tuple, forces.contacts.image_cd.tolist())):
        assert held[image]["normal_force"] == forces.normal_c[c]
        assert held[image]["normal"] == tuple(forces.contacts.normal_cd[c].tolist())
    found = pm.from_networkx(graph, packing)
    np.testing.assert_array_equal(found.image_cd, forces.contacts.image_cd)
    np.testing.assert_array_equal(found.vector_cd, forces.contacts.vector_cd)


def test_a_graph_without_images_joins_the_nearest_ones():
    networkx = pytest.importorskip("networkx")
    packing = pm.lattice_packing("triangular", repeats=(5, 5), relative_overlap=0.01)
    contacts = pm.find_contacts(packing)
    graph = networkx.Graph(zip(contacts.j_c.tolist(), contacts.i_c.tolist(), strict=True))
    found = pm.from_networkx(graph, packing)
    np.testing.assert_array_equal(found.image_cd, contacts.image_cd)
    np.testing.assert_array_equal(found.vector_cd, contacts.vector_cd)
    for wrong, words in (
        (
            [(0, 99)],
            "graph must join particles by their numbers: one must be an integer at least 0 and at most 24, got 99",
        ),
        ([("a", 1)], "graph must join particles by their numbers"),
        ([(3, 3)], "graph must join a particle with itself through an image only, got particle 3"),
    ):
        with pytest.raises((TypeError, ValueError), match=words):
            pm.from_networkx(networkx.Graph(wrong), packing)


def test_a_package_that_is_missing_is_named_with_what_to_install(monkeypatch, tmp_path):
    import importlib

    def missing(name):
        raise ImportError(name)

    monkeypatch.setattr(importlib, "import_module", missing)
    from packmech.files import convert

    for call, package in ((convert.to_ase, "ase"), (convert.to_freud, "freud-analysis")):
        with pytest.raises(
            ImportError, match=rf"find the package {package}; pip install 'packmech\[formats\]' brings it"
        ):
            call(discs())


@pytest.mark.parametrize("dimension", [2, 3])
def test_kinds_go_to_other_programs_and_back(dimension):
    packing = pm.random_packing(20, dimension=dimension, packing_fraction=0.5, seed=1)
    packing = pm.assign_kinds(packing, (1, 2), seed=1)
    atoms = pm.to_ase(packing)
    assert atoms.arrays["kind"].tolist() == packing.kind_n.tolist()
    assert pm.from_ase(atoms).packing == packing
    assert pm.from_hoomd(pm.to_hoomd(packing)).packing == packing
    forces = pm.contact_forces(pm.Scene(packing, (pm.Repulsion(),)))
    assert [kind for _, kind in pm.to_networkx(forces).nodes(data="kind")] == packing.kind_n.tolist()


def test_a_field_of_ase_that_would_be_taken_for_the_packings_own_is_refused():
    packing = pm.lattice_packing("square", repeats=(2, 2))
    for name in ("radius", "kind"):
        with pytest.raises(ValueError, match=f"packing must have no fields {name} for pm.to_ase"):
            pm.to_ase(pm.Snapshot(packing, {name: np.arange(4)}))
