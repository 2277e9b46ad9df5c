"""What a file format is to packmech: how its frames are read and written, and what it keeps of a snapshot."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.check import given_shape, instance, positive, positive_array
from packmech.files.snapshot import FIELD_WORDS, Snapshot

# what formats may keep beside positions, radii, masses and the box
LINKS, TANGENTIAL, SPHEROIDS, BODIES = "links", "tangential displacements", "spheroids", "rigid bodies"
KINDS = "kinds of particles"
SUPERELLIPSOIDS = "superellipsoids"
BONDS, FORCES, STEP, LAW = "springs", "contact forces", "step", "law"
EVERYTHING = frozenset((LINKS, TANGENTIAL, SPHEROIDS, BODIES, KINDS))


class Given(NamedTuple):
    """What the caller of a read says of a file: the box and radii that it does not hold, the style of its lines."""

    box: Box | None = None
    radius: Any = None
    style: str = ""

    @staticmethod
    def checked(box: Any, radius: Any) -> Given:
        """Return what is given, after checking that it is a box, and radii."""
        if box is not None:
            instance("box", box, Box)
        if isinstance(radius, Mapping):
            if not radius:
                raise ValueError("radius must be given for each type, got {}")
            radius = {key: positive(f"radius[{key!r}]", value) for key, value in radius.items()}
        elif radius is not None:
            one = not given_shape(radius)
            radius = positive("radius", radius) if one else positive_array("radius", radius, shape=(None,))
        return Given(box, radius)

    def radii(self, held: NDArray[np.float64] | None, type_n: NDArray[Any] | None, count: int) -> NDArray[np.float64]:
        """Return the radii of the file, or those given: one for all, for each particle, or for each type."""
        if held is not None:
            if self.radius is not None:
                raise ValueError("radius must be left out where a file holds radii, as this one does")
            return held
        if self.radius is None:
            raise ValueError(
                "it holds no radii: give them as radius=, a number, one for each particle, or by type {1: 0.5, 2: 0.7}"
            )
        if not isinstance(self.radius, Mapping):
            one = np.asarray(self.radius, dtype=np.float64)
            return positive_array("radius", np.full(count, one) if one.ndim == 0 else one, shape=(count,))
        if type_n is None:
            raise ValueError("radius must be a number, or one for each particle, as the file has no types, got by type")
        by_type = {str(key): float(value) for key, value in self.radius.items()}
        missing = sorted({str(one) for one in type_n.tolist()} - by_type.keys())
        if missing:
            raise ValueError(f"radius must be given for the types {', '.join(missing)}, got {', '.join(by_type)}")
        return np.array([by_type[str(one)] for one in type_n.tolist()])

    def box_in(self, held: Box | None) -> Box:
        """Return the box of the file, or the one given."""
        if held is not None and self.box is not None:
            raise ValueError("box must be left out where a file holds one, as this one does")
        found = self.box if held is None else held
        if found is None:
            raise ValueError("it holds no periodic box: give it as box=")
        return found


class Frames(Protocol):
    """The snapshots of a file, read one at a time."""

    def __len__(self) -> int:
        """Return the number of snapshots."""
        ...

    def frame(self, number: int) -> tuple[Snapshot, list[str]]:
        """Return one snapshot, and what the file holds of it that a snapshot has no place for."""
        ...


@dataclass(frozen=True)
class One:
    """The frames of a file of one snapshot."""

    read: Callable[[], tuple[Snapshot, list[str]]]

    def __len__(self) -> int:
        return 1

    def frame(self, number: int) -> tuple[Snapshot, list[str]]:
        """Return the snapshot."""
        return self.read()


@dataclass(frozen=True)
class Format:
    """One file format.

    Attributes
    ----------
    name
        What `format=` calls it.
    endings
        Of the file names that are taken for it, the usual one first.
    keeps
        What it keeps, of the words above.
    frames
        Opens a file.
    write
        Writes snapshots to a new file, of which it keeps everything that `losses` does not name.
    many
        Whether a file may hold several snapshots.
    field
        Whether it has a place for a field of such a name and array.
    losses
        Names what else it has no place for.

    """

    name: str
    endings: tuple[str, ...]
    keeps: frozenset[str]
    frames: Callable[[Path, Given], Frames]
    write: Callable[[Iterable[Snapshot], Path], None]
    many: bool = False
    field: Callable[[str, NDArray[Any]], bool] = lambda name, array: True
    losses: Callable[[Snapshot], Iterator[str]] = lambda snapshot: iter(())

    def not_kept(self, snapshot: Snapshot) -> Iterator[tuple[str, str, str]]:
        """Name what the format does not keep: what it is, what must be instead, and what came."""
        packing = snapshot.packing
        if len(packing.links) and LINKS not in self.keeps:
            yield LINKS, "packing must have no links", str(len(packing.links))
        if packing.tangential is not None and TANGENTIAL not in self.keeps:
            yield TANGENTIAL, "packing must have no tangential displacements", str(packing.tangential.springs)
        if packing.kinds > 1 and KINDS not in self.keeps:
            yield KINDS, "packing must be of one kind of particles", f"{packing.kinds} kinds"
        shape = self._shape(snapshot)
        if shape and shape not in self.keeps:
            yield shape, "packing must be of discs or spheres", type(packing.shapes).__name__
        lost = [name for name, array in snapshot.fields.items() if not self.field(name, array)]
        if lost:
            yield "fields", f"packing must have no fields {', '.join(lost)}", "them"
        if snapshot.bonds and BONDS not in self.keeps:
            yield BONDS, "packing must have no springs", str(sum(map(len, snapshot.bonds)))
        if snapshot.contact_forces is not None and FORCES not in self.keeps:
            yield FORCES, "packing must have no contact forces", f"those of {len(snapshot.contact_forces.i_c)}"
        if snapshot.step is not None and STEP not in self.keeps:
            yield STEP, "packing must have no step", str(snapshot.step)

    @staticmethod
    def _shape(snapshot: Snapshot) -> str:
        shapes = snapshot.packing.shapes
        if not shapes.has_orientations:
            return ""
        if not shapes.has_spheroid_sites:
            return SUPERELLIPSOIDS
        return BODIES if shapes.has_beads else SPHEROIDS

    def kept(self, snapshot: Snapshot) -> Snapshot:
        """Return what the format keeps of the snapshot."""
        packing = snapshot.packing
        lost = {what for what, _, _ in self.not_kept(snapshot)}
        changes: dict[str, Any] = {LINKS: {"links": None}, TANGENTIAL: {"tangential": None}, KINDS: {"kind_n": None}}
        changes |= dict.fromkeys((SPHEROIDS, BODIES, SUPERELLIPSOIDS), {"shapes": None})
        for what in lost & changes.keys():
            packing = packing.replace(**changes[what])
        return Snapshot(
            packing,
            {name: array for name, array in snapshot.fields.items() if self.field(name, array)},
            () if BONDS in lost else snapshot.bonds,
            None if FORCES in lost else snapshot.contact_forces,
            None if STEP in lost else snapshot.step,
        )


def numeric(name: str, array: NDArray[Any]) -> bool:
    """Return whether a field is of numbers."""
    return array.dtype.kind in "if"


def field_name(name: str) -> str:
    """Return how a field of a snapshot is called in a file without names of its own: without the letters of axes."""
    return name[: name.rindex("_")] if name in FIELD_WORDS else name
