"""Packings as VTK files, for ParaView: points with radii, lines for links, springs and contacts with their forces.

Poly data in XML, ``.vtp``, in double precision. Points are the particles (z is 0 in two dimensions), with the arrays
``radius``, ``mass``, ``kind`` where there are several, ``particle`` (their numbers), ``aspect`` and ``director`` of
ellipses and spheroids, and fields: glyphs scaled by ``radius`` (scale factor 1, sphere source of radius 1) are the
particles. Tensor glyphs by ``semi_axes`` are ellipses and spheroids. Rigid bodies are drawn as their beads, points of
their own with the number of the body, whose own point has the radius 0. Lines go from a particle to the other end of a
link, spring or contact, at its image: where that is none of the particles it is a further point, of radius 0 and of the
same number. Lines have the arrays ``kind`` (1 link, 2 spring, 3 contact; particles 0), ``normal_force`` and
``tangential_force`` (of contacts, on the first particle), and ``length`` (of links and springs). The field data
``packmech/...`` are the arrays of an ``.npz`` file: everything is read back to the last bit.

Of other programs' files, poly data and unstructured grids in any of the encodings of VTK's XML (ASCII, base64,
appended, compressed by zlib), points are particles in the box given as ``box=``, with radii ``radius`` or ``diameter``
or as ``radius=`` says; other arrays of points are fields, and cells and their arrays are left out, and listed in a
warning. VTK's own library is not used: it ends the interpreter where a file is broken. The older format ``.vtk`` is not
read.
"""

from __future__ import annotations

import base64
import binascii
import zlib
from collections.abc import Iterable
from pathlib import Path
from typing import Any, Literal
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

import numpy as np
from numpy.typing import NDArray

from packmech.files import columns
from packmech.files.formats import BONDS, EVERYTHING, FORCES, STEP, Format, Given, One, field_name, numeric
from packmech.files.npz import REQUIRED, arrays_beside, arrays_of, is_own, snapshot_in
from packmech.files.snapshot import Snapshot
from packmech.packing import Packing
from packmech.shapes import Spheroids

_LOG = "packmech/"
_LINK, _SPRING, _CONTACT = 1, 2, 3
_TYPES = {
    **{f"Int{8 * size}": f"i{size}" for size in (1, 2, 4, 8)},
    **{f"UInt{8 * size}": f"u{size}" for size in (1, 2, 4, 8)},
    "Float32": "f4",
    "Float64": "f8",
}
# arrays of points that are no fields
_OWN = ("radius", "mass", columns.KIND, "particle", "aspect", "director", "semi_axes")


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
    (snapshot,) = snapshots
    packing = snapshot.packing
    many, lines = packing.particles, _lines(snapshot)
    # the far ends of lines that go to images of particles are points of their own
    away = lines["image"].any(axis=1)
    ends = packing.position_nd[lines["j"]] + lines["image"] @ packing.box.lattice_dd.T
    end = lines["j"].copy()
    end[away] = many + np.arange(int(away.sum()))
    points, own = [_three(packing.position_nd), _three(ends)[away]], [np.arange(many), lines["j"][away]]
    radius = [packing.radius_n, np.zeros(int(away.sum()))]
    if packing.shapes.has_beads:
        # bodies are drawn as their beads, which are points of their own
        bead = packing.shapes.particle_b
        points.append(_three(packing.position_nd[bead] + packing.shapes.arms(packing.radius_n)))
        own.append(bead)
        radius = [np.zeros(many), radius[1], packing.shapes.site_radius(packing.radius_n)]
    particle = np.concatenate(own)
    arrays = columns.arrays_of_particles(snapshot)
    del arrays["position_nd"]
    arrays = {name: array[particle] for name, array in arrays.items()} | {"radius_n": np.concatenate(radius)}
    if isinstance(packing.shapes, Spheroids):
        arrays["semi_axes"] = _tensors(packing)[particle]
    shown = {"particle": particle}
    for name, array in arrays.items():
        name = {"director_nd": "director"}.get(name, columns.SCALARS.get(name, field_name(name)))
        shown[name] = _three(array) if array.ndim == 2 and array.shape[1] == 2 else array
    nothing = np.full(many, np.nan)
    cells = {"kind": np.concatenate([np.zeros(many, dtype=np.int64), lines["kind"]])}
    if len(end):
        cells["length"] = np.concatenate([nothing, lines["length"]])
    if snapshot.contact_forces is not None:
        cells["normal_force"] = np.concatenate([nothing, lines["normal"]])
        cells["tangential_force"] = np.concatenate([np.full((many, 3), np.nan), lines["tangential"]])
    held = {_LOG + name: np.asarray(array) for name, array in (arrays_of(packing) | arrays_beside(snapshot)).items()}
    text = [
        '<VTKFile type="PolyData" version="1.0" byte_order="LittleEndian" header_type="UInt64">',
        "<PolyData>",
        *_group("FieldData", held, tuples=True),
        f'<Piece NumberOfPoints="{len(particle)}" NumberOfVerts="{many}" NumberOfLines="{len(end)}" NumberOfStrips="0" '
        'NumberOfPolys="0">',
        *_group("PointData", shown),
        *_group("CellData", cells),
        *_group("Points", {"Points": np.concatenate(points)}),
        *_group("Verts", _cells(np.arange(many)[:, None])),
        *_group("Lines", _cells(np.column_stack([lines["i"], end]))),
        "</Piece>",
        "</PolyData>",
        "</VTKFile>",
    ]
    path.write_text("\n".join(text) + "\n", encoding="ascii")


def _cells(end: NDArray[Any]) -> dict[str, NDArray[Any]]:
    """Return the arrays of cells of as many points each."""
    return {"connectivity": end.ravel(), "offsets": np.arange(1, len(end) + 1) * end.shape[1]}


def _group(tag: str, arrays: dict[str, NDArray[Any]], tuples: bool = False) -> list[str]:
    """Return the lines of an element with arrays, of which field data say how long they are."""
    return [f"<{tag}>", *(_element(name, array, tuples) for name, array in arrays.items()), f"</{tag}>"]


def _element(name: str, array: NDArray[Any], tuples: bool) -> str:
    kind = {"f": "Float64", "b": "UInt8"}.get(array.dtype.kind, "UInt8" if array.dtype == np.uint8 else "Int64")
    flat = np.ascontiguousarray(array, dtype=np.dtype(_TYPES[kind]).newbyteorder("<"))
    width = 1 if array.ndim < 2 else array.shape[1]
    length = f' NumberOfTuples="{len(array)}"' if tuples else ""
    content = base64.b64encode(np.array(flat.nbytes, dtype="<u8").tobytes() + flat.tobytes()).decode("ascii")
    head = f'<DataArray type="{kind}" Name={quoteattr(name)} NumberOfComponents="{width}"{length}'
    return f'{head} format="binary">{content}</DataArray>'


def _tensors(packing: Packing) -> NDArray[np.float64]:
    """Return (N, 9) tensors whose eigenvalues and eigenvectors are the semi-axes of ellipses and spheroids."""
    along, across = packing.shapes.semi_axes(packing.radius_n)
    director = _three(packing.shapes.axis_bd)
    stretch = (along - across)[:, None, None] * director[:, :, None] * director[:, None, :]
    return np.asarray(across[:, None, None] * np.eye(3) + stretch).reshape(-1, 9)


class _Reader:
    """The arrays of a file of VTK's XML."""

    def __init__(self, content: bytes) -> None:
        self.appended, self.encoding = b"", "raw"
        head, tag, tail = content.partition(b"<AppendedData")
        if tag:
            mark = tail.find(b"_")
            self.encoding = "base64" if b"base64" in tail[: max(mark, 0)] else "raw"
            self.appended = tail[mark + 1 : tail.rfind(b"</AppendedData>")]
            head += b"</VTKFile>"
        try:
            self.root = ElementTree.fromstring(head)
        except ElementTree.ParseError as error:
            raise ValueError(f"it must be XML, got {error}") from None
        kind = self.root.get("type")
        if self.root.tag != "VTKFile" or kind not in ("PolyData", "UnstructuredGrid"):
            raise ValueError(f"it must be PolyData or an UnstructuredGrid of VTK, got {self.root.tag} {kind}")
        compressor = self.root.get("compressor")
        if compressor not in (None, "vtkZLibDataCompressor"):
            raise ValueError(f"it must be compressed by zlib, or not, got {compressor}")
        self.compressed = compressor is not None
        self.order: Literal["<", ">"] = ">" if self.root.get("byte_order") == "BigEndian" else "<"
        self.header = np.dtype("u8" if self.root.get("header_type") == "UInt64" else "u4").newbyteorder(self.order)

    def arrays(self, tag: str) -> tuple[dict[str, NDArray[Any]], list[str]]:
        """Return the arrays of numbers in all elements of a tag, one piece after another, and the names of others."""
        found: dict[str, list[NDArray[Any]]] = {}
        others = []
        for group in self.root.iter(tag):
            for element in group:
                name = element.get("Name") or tag
                if element.tag == "DataArray" and element.get("type") in _TYPES:
                    found.setdefault(name, []).append(self._array(name, element))
                else:
                    others.append(name)
        return {name: np.concatenate(parts) for name, parts in found.items()}, others

    def _array(self, name: str, element: ElementTree.Element) -> NDArray[Any]:
        kind, width = np.dtype(_TYPES[element.get("type", "")]), int(element.get("NumberOfComponents", "1"))
        encoded = element.get("format", "ascii")
        if encoded == "ascii":
            words = (element.text or "").split()
            array = np.array([float(one) if kind.kind == "f" else int(one) for one in words], dtype=kind)
        else:
            if encoded == "appended":
                content, is_text = self.appended[int(element.get("offset", "0")) :], self.encoding == "base64"
            else:
                content, is_text = "".join((element.text or "").split()).encode("ascii"), True
            held = self._inflated(content, is_text) if self.compressed else self._plain(content, is_text)
            if len(held) % kind.itemsize:
                raise ValueError(f"its array {name} must hold whole numbers of {kind.itemsize} bytes, got {len(held)}")
            array = np.frombuffer(held, dtype=kind.newbyteorder(self.order)).astype(kind)
        if width < 1 or len(array) % width:
            raise ValueError(f"its array {name} must hold {width} numbers in each row, got {len(array)}")
        return array if width == 1 else array.reshape(-1, width)

    def _decoded(self, content: bytes, is_text: bool, size: int) -> tuple[bytes, bytes]:
        """Return so many bytes, and the content behind their block."""
        length = -(-size // 3) * 4 if is_text else size
        block = base64.b64decode(content[:length], validate=True) if is_text else content[:length]
        if len(block) < size:
            raise ValueError(f"it must hold {size} bytes where it says so, got {len(block)}")
        return block[:size], content[length:]

    def _plain(self, content: bytes, is_text: bool) -> bytes:
        head = self.header.itemsize
        size = int(np.frombuffer(self._decoded(content, is_text, head)[0], self.header)[0])
        if size > len(content):
            raise ValueError(f"it must hold {size} bytes where it says so, got {len(content)}")
        # the number of bytes may be a block of its own, or stand in one with these
        alone = is_text and content[-(-head // 3) * 4 - 1 :][:1] == b"="
        if alone or not is_text:
            return self._decoded(self._decoded(content, is_text, head)[1], is_text, size)[0]
        return self._decoded(content, is_text, head + size)[0][head:]

    def _inflated(self, content: bytes, is_text: bool) -> bytes:
        step = self.header.itemsize
        blocks = int(np.frombuffer(self._decoded(content, is_text, 3 * step)[0], self.header)[0])
        if blocks * step > len(content):
            raise ValueError(f"it must hold {blocks} blocks where it says so, got {len(content)} bytes")
        head, rest = self._decoded(content, is_text, (3 + blocks) * step)
        sizes = np.frombuffer(head, self.header).tolist()[3:]
        if sum(sizes) > len(content):
            raise ValueError(f"it must hold {sum(sizes)} bytes where it says so, got {len(content)}")
        data = self._decoded(rest, is_text, sum(sizes))[0]
        found, place = [], 0
        for size in sizes:
            found.append(zlib.decompress(data[place : place + size]))
            place += size
        return b"".join(found)


def _read(path: Path, given: Given) -> tuple[Snapshot, list[str]]:
    try:
        return _parsed(_Reader(path.read_bytes()), given)
    except (zlib.error, binascii.Error, UnicodeError) as error:
        raise ValueError(f"it must hold arrays as it says, got {error}") from error


def _parsed(reader: _Reader, given: Given) -> tuple[Snapshot, list[str]]:
    place = reader.arrays("Points")[0].get("Points", np.zeros((0, 3))).astype(np.float64)
    if not len(place) or place.shape[1:] != (3,):
        raise ValueError(f"it must hold points of three coordinates, got an array of shape {place.shape}")
    (points, odd), (cells, more), (held, others) = (
        reader.arrays(tag) for tag in ("PointData", "CellData", "FieldData")
    )
    if any(len(one) != len(place) for one in points.values()):
        raise ValueError(f"its arrays of points must be of {len(place)} points, got others")
    left_out = [f"arrays {', '.join([*odd, *more, *others])}"] if [*odd, *more, *others] else []
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
            and (snapshot.packing.shapes.has_beads or np.array_equal(radius, snapshot.packing.radius_n))
        ):
            raise ValueError("its field data packmech/... and its points must be one packing, got two that differ")
        return snapshot, left_out
    snapshot, aside = _of_points(place, points, cells, held, given)
    return snapshot, [*left_out, *aside]


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


def _field(name: str, array: NDArray[Any]) -> bool:
    return numeric(name, array) and name not in _OWN


VTK = Format("vtk", (".vtp",), EVERYTHING | {BONDS, FORCES, STEP}, _frames, _write, field=_field)
