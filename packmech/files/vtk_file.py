"""Packings as VTK files, for ParaView: points with radii, lines for links, springs and contacts with their forces.

Written and read through the package ``vtk``, the format's own (extra ``formats``), ``.vtp`` (XML) or ``.vtk``
(the older one), in double precision. Points are the particles (z is 0 in two dimensions), with the arrays ``radius``,
``mass``, ``particle`` (their numbers), ``aspect`` and ``director`` of ellipses and spheroids, and fields: glyphs scaled
by ``radius`` (scale factor 1, sphere source of radius 1) are the particles. Lines go from a particle to the other end
of a link, spring or contact, at its image: where that is none of the particles it is a further point, of radius 0 and
of the same number. Lines have the arrays ``kind`` (1 link, 2 spring, 3 contact; particles 0), ``normal_force`` and
``tangential_force`` (of contacts, on the first particle), and ``length`` (of links and springs). The field data
``packmech/...`` are the arrays of an ``.npz`` file: everything is read back to the last bit.

Of other programs' files, points are particles in the box given as ``box=``, with radii ``radius`` or ``diameter`` or as
``radius=`` says; other arrays of points are fields, and cells and their arrays are left out, and listed in a warning.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.files import columns
from packmech.files.formats import BONDS, EVERYTHING, FORCES, STEP, Format, Given, One, field_name, numeric
from packmech.files.npz import REQUIRED, arrays_beside, arrays_of, is_own, snapshot_in
from packmech.files.snapshot import Snapshot

_LOG = "packmech/"
_LINK, _SPRING, _CONTACT = 1, 2, 3


def _library() -> tuple[Any, Any, Any]:
    """Return the modules of VTK that hold data, read and write it, and turn it to arrays."""
    try:
        from vtkmodules import vtkCommonCore, vtkCommonDataModel, vtkIOLegacy, vtkIOXML
        from vtkmodules.util import numpy_support
    except ImportError as error:
        raise ImportError(
            "path must end in another ending than .vtp and .vtk where the package vtk is missing; "
            "pip install 'packmech[formats]' brings it"
        ) from error
    return (vtkCommonCore, vtkCommonDataModel), (vtkIOXML, vtkIOLegacy), numpy_support


def _three(array: NDArray[Any]) -> NDArray[Any]:
    found = np.zeros((len(array), 3))
    found[:, : array.shape[1]] = array
    return found


def _lines(snapshot: Snapshot) -> dict[str, NDArray[Any]]:
    """Return lines: the particles at their ends, the images of the second, kind, length, and forces."""
    packing, d = snapshot.packing, snapshot.packing.dimension
    links, contacts = packing.links, snapshot.contact_forces
    parts: list[tuple[Any, ...]] = [(_LINK, links.i_l, links.j_l, links.image_ld.reshape(-1, d), links.length_l, None)]
    parts += [(_SPRING, one.i_b, one.j_b, one.image_bd, one.rest_length_b, None) for one in snapshot.bonds]
    if contacts is not None:
        none = np.full(len(contacts.i_c), np.nan)
        parts.append((_CONTACT, contacts.i_c, contacts.j_c, contacts.image_cd, none, contacts))
    found: dict[str, list[NDArray[Any]]] = {}
    for kind, i, j, image, length, forces in parts:
        count = len(i)
        normal = np.full(count, np.nan) if forces is None else forces.normal_c
        tangential = np.full((count, 3), np.nan) if forces is None else _three(forces.tangential_cd)
        own = (i, j, image, np.full(count, kind), length, normal, tangential)
        for name, one in zip(("i", "j", "image", "kind", "length", "normal", "tangential"), own, strict=True):
            found.setdefault(name, []).append(one)
    return {name: np.concatenate(several) for name, several in found.items()}


def _write(snapshots: Iterable[Snapshot], path: Path) -> None:
    (_, model), (xml, legacy), support = _library()
    (snapshot,) = snapshots
    packing = snapshot.packing
    many, lines = packing.particles, _lines(snapshot)
    place = _three(packing.position_nd)
    # the far ends of lines that go to images of particles are points of their own
    away = lines["image"].any(axis=1)
    ends = packing.position_nd[lines["j"]] + lines["image"] @ packing.box.lattice_dd.T
    end = lines["j"].copy()
    end[away] = many + np.arange(int(away.sum()))
    points = np.concatenate([place, _three(ends)[away]])
    data = model.vtkPolyData()
    vtk_points = _points(points, support)
    data.SetPoints(vtk_points)
    data.SetVerts(_cells(np.arange(many)[:, None], model, support))
    if len(end):
        data.SetLines(_cells(np.column_stack([lines["i"], end]), model, support))
    own = np.concatenate([np.arange(many), lines["j"][away]])
    arrays = columns.arrays_of_particles(snapshot)
    del arrays["position_nd"]
    for name, array in arrays.items():
        shown = array[own]
        if shown.dtype.kind == "f" and name == "radius_n":
            shown = np.where(np.arange(len(own)) < many, shown, 0.0)
        name = {"director_nd": "director"}.get(name, columns.SCALARS.get(name, field_name(name)))
        shown = _three(shown) if shown.ndim == 2 and shown.shape[1] == 2 else shown
        _add(data.GetPointData(), name, shown, support)
    _add(data.GetPointData(), "particle", own, support)
    nothing = np.full(many, np.nan)
    _add(data.GetCellData(), "kind", np.concatenate([np.zeros(many, dtype=np.int64), lines["kind"]]), support)
    if len(end):
        _add(data.GetCellData(), "length", np.concatenate([nothing, lines["length"]]), support)
    if snapshot.contact_forces is not None:
        _add(data.GetCellData(), "normal_force", np.concatenate([nothing, lines["normal"]]), support)
        tangential = np.concatenate([np.full((many, 3), np.nan), lines["tangential"]])
        _add(data.GetCellData(), "tangential_force", tangential, support)
    for name, array in (arrays_of(packing) | arrays_beside(snapshot)).items():
        kept = np.asarray(array)
        flat = kept.astype(np.uint8) if kept.dtype.kind == "b" else kept
        _add(data.GetFieldData(), _LOG + name, flat, support)
    writer = legacy.vtkPolyDataWriter() if path.suffix.lower() == ".vtk" else xml.vtkXMLPolyDataWriter()
    writer.SetFileName(str(path))
    writer.SetInputData(data)
    if path.suffix.lower() == ".vtk":
        writer.SetFileTypeToBinary()
    if not writer.Write():
        raise OSError(f"{path} could not be written")


def _points(place: NDArray[np.float64], support: Any) -> Any:
    from vtkmodules.vtkCommonCore import vtkPoints

    found = vtkPoints()
    found.SetDataTypeToDouble()
    found.SetData(support.numpy_to_vtk(np.ascontiguousarray(place), deep=True))
    return found


def _cells(end: NDArray[Any], model: Any, support: Any) -> Any:
    found = model.vtkCellArray()
    many, width = end.shape
    offsets = support.numpy_to_vtkIdTypeArray(np.arange(0, many * width + 1, width, dtype=np.int64), deep=True)
    found.SetData(
        offsets, support.numpy_to_vtkIdTypeArray(np.ascontiguousarray(end.ravel(), dtype=np.int64), deep=True)
    )
    return found


def _add(where: Any, name: str, array: NDArray[Any], support: Any) -> None:
    found = support.numpy_to_vtk(np.ascontiguousarray(array), deep=True)
    found.SetName(name)
    where.AddArray(found)


def _arrays(where: Any, support: Any) -> dict[str, NDArray[Any]]:
    """Return the arrays of numbers, and as words the others."""
    found = {}
    for k in range(where.GetNumberOfArrays()):
        array = where.GetAbstractArray(k)
        if array.IsNumeric():
            found[array.GetName()] = np.array(support.vtk_to_numpy(array))
        else:
            found[array.GetName()] = np.array([str(array.GetValue(n)) for n in range(array.GetNumberOfTuples())])
    return found


def _read(path: Path, given: Given) -> tuple[Snapshot, list[str]]:
    (core, _), (xml, legacy), support = _library()
    is_legacy = path.suffix.lower() == ".vtk"
    reader = legacy.vtkDataSetReader() if is_legacy else xml.vtkXMLPolyDataReader()
    quiet = core.vtkObject.GetGlobalWarningDisplay()
    core.vtkObject.GlobalWarningDisplayOff()
    try:
        if not is_legacy and not reader.CanReadFile(str(path)):
            raise ValueError("it must be poly data in VTK's XML, got something else")
        reader.SetFileName(str(path))
        if is_legacy:
            reader.ReadAllScalarsOn()
            reader.ReadAllVectorsOn()
            reader.ReadAllFieldsOn()
        reader.Update()
        data = reader.GetOutput()
    finally:
        core.vtkObject.SetGlobalWarningDisplay(quiet)
    if reader.GetErrorCode() or data is None or not hasattr(data, "GetPoints") or not data.GetNumberOfPoints():
        raise ValueError("it must be a data set of VTK with points, got none that can be read")
    place = np.array(support.vtk_to_numpy(data.GetPoints().GetData()), dtype=np.float64)
    points, cells = _arrays(data.GetPointData(), support), _arrays(data.GetCellData(), support)
    held = _arrays(data.GetFieldData(), support)
    own = {name.removeprefix(_LOG): one for name, one in held.items() if name.startswith(_LOG)}
    if all(name in own for name in REQUIRED):
        if given.box is not None or given.radius is not None:
            raise ValueError("box and radius must be left out for files of packmech, which hold them")
        if "link_shape_l" in own:
            own["link_shape_l"] = own["link_shape_l"].astype(bool)
        snapshot = snapshot_in({name: one for name, one in own.items() if is_own(name)})
        many = snapshot.packing.particles
        radius = points.get("radius", np.zeros(0))[:many]
        if not (
            np.array_equal(place[:many], _three(snapshot.packing.position_nd))
            and np.array_equal(radius, snapshot.packing.radius_n)
        ):
            raise ValueError("its field data packmech/... and its points must be one packing, got two that differ")
        return snapshot, []
    return _of_points(place, points, cells, held, given)


def _of_points(
    place: NDArray[np.float64],
    points: dict[str, NDArray[Any]],
    cells: dict[str, NDArray[Any]],
    held: dict[str, NDArray[Any]],
    given: Given,
) -> tuple[Snapshot, list[str]]:
    """Return what another program's points are."""
    box = given.box_in(None)
    left_out = [f"arrays of cells {', '.join(cells)}"] if cells else []
    left_out += [f"field data {', '.join(held)}"] if held else []
    if place[:, box.dimension :].any():
        raise ValueError("its points must lie at z = 0 in a box of two dimensions, got others")
    names = {"radius": "radius_n", "diameter": "diameter", "mass": "mass_n", "type": "type"}
    arrays = {names.get(name.lower(), name): one for name, one in points.items()}
    if "diameter" in arrays and "radius_n" not in arrays:
        arrays["radius_n"] = 0.5 * arrays.pop("diameter")
    velocity = next((name for name in ("velocity", "v", "Velocity") if name in arrays), None)
    if velocity is not None and arrays[velocity].ndim == 2:
        arrays["velocity_nd"] = arrays.pop(velocity)[:, : box.dimension]
    for name in ("radius_n", "mass_n"):
        if name in arrays:
            arrays[name] = arrays[name].astype(np.float64)
    fields = {name.replace(" ", "_"): one for name, one in arrays.items()}
    return columns.snapshot_of_particles(fields | {"position_nd": place[:, : box.dimension]}, box, given), left_out


def _frames(path: Path, given: Given) -> One:
    return One(lambda: _read(path, given))


VTK = Format("vtk", (".vtp", ".vtk"), EVERYTHING | {BONDS, FORCES, STEP}, _frames, _write, field=numeric)
