"""Packings as files: one call to read and one to write, trajectories beside them; the ending says the format.

| format | endings | keeps beside positions, radii, masses and the box |
|---|---|---|
| ``npz`` | ``.npz`` | everything, the law too (`packmech.files.npz`) |
| ``gsd`` | ``.gsd`` | everything, also trajectories; for HOOMD, freud, OVITO (`packmech.files.gsd_file`) |
| ``vtk`` | ``.vtp`` | everything; for ParaView (`packmech.files.vtk_file`) |
| ``lammps-data`` | ``.data``, ``.lmp`` | kinds, links, linear springs, velocities, spins (`packmech.files.lammps`) |
| ``lammps-dump`` | ``.dump``, ``.lammpstrj`` | kinds, spheroids, fields, trajectories (`packmech.files.lammps`) |
| ``extxyz`` | ``.extxyz``, ``.xyz`` | kinds, spheroids, fields, trajectories (`packmech.files.extended_xyz`) |
| ``csv`` | ``.csv`` | kinds, ellipses and spheroids, fields (`packmech.files.table_text`) |
| ``table`` | ``.txt``, ``.dat`` | nothing else (`packmech.files.table_text`) |

What a format keeps, a file has to the last bit, in whatever box: read it back and it is equal. What it has no place for
is refused, by name, unless ``drop=True`` says to leave it out. What stands in a file of another program and a packing
has no place for, such as velocities, is listed in a warning by `read_packing`, and is there in the `Snapshot` that
`read_trajectory` gives, of files of one packing, too. Effects, what is held, and drives are no packing's: scene files
(`pm.write_scene`) have these.

Only gsd is read and written through a library, ``gsd``. LAMMPS data, dumps and extended xyz are packmech's own, for the
writers of ASE round positions to eight digits, know no radii of granular styles, and turn boxes; VTK, for its library
ends the interpreter where a file is broken. The last column of the table names the modules, whose heads describe the
files.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar, overload

from packmech.box import Box
from packmech.calls.display import shown
from packmech.calls.honors import honors
from packmech.calls.status import shown_as
from packmech.check import boolean, brief, clear_errors, instance, integer, warn
from packmech.effects.laws import is_law
from packmech.files import npz
from packmech.files.archive import UNREADABLE
from packmech.files.extended_xyz import EXTXYZ
from packmech.files.formats import LAW, Format, Frames, Given
from packmech.files.gsd_file import GSD
from packmech.files.lammps import DATA, DUMP
from packmech.files.npz import NPZ
from packmech.files.paths import PathLike, existing_file, file_name, replacing, writable_file
from packmech.files.snapshot import Snapshot
from packmech.files.table_text import CSV, PLAIN
from packmech.files.vtk_file import VTK
from packmech.packing import Packing

T = TypeVar("T")
# letters at each end of a library's error that a message repeats: what came stands at its end
_END = 300

FORMATS = {one.name: one for one in (NPZ, GSD, PLAIN, CSV, DATA, DUMP, EXTXYZ, VTK)}
_ENDINGS = {ending: one for one in FORMATS.values() for ending in one.endings}


@shown_as("reading")
def read_packing(
    path: PathLike,
    *,
    frame: int | None = None,
    format: str | None = None,
    box: Box | None = None,
    radius: Any = None,
) -> Packing:
    """Return the packing in a file (of a trajectory the last).

    What a file holds and a packing has no place for, such as velocities, types of particles that are not numbered by
    size, and species, is left out and listed in a UserWarning; `pm.read_trajectory` gives arrays of particles, springs
    and contact forces, too, and `pm.write_packing` writes its snapshots. Particles of shapes that packings cannot have
    are refused.

    Parameters
    ----------
    path
        The file; its ending says the format, which the head of ``packmech.files.packings`` lists.
    frame
        Number of the frame of a trajectory, from 0, or from the end where it is negative; the last unless given.
    format
        Name of the format where the ending does not say it: "npz", "gsd", "table", "csv", "lammps-data",
        "lammps-dump", "extxyz" or "vtk"; with the atom style after a colon where a LAMMPS data file does not name it,
        "lammps-data:sphere".
    box
        The periodic box of files that hold none: a CSV of positions, VTK of another program, a dump with walls. Of
        LAMMPS data files, which do not say whether their box is periodic, it takes the place of that.
    radius
        Radii of files that hold none: a number, one for each particle, or for each type ``{1: 0.5, 2: 0.7}``.

    Raises
    ------
    FileNotFoundError
        If there is no such file.
    TypeError, ValueError
        Naming the file, the line, and what is wrong with it or in it; or the argument.

    Examples
    --------
    >>> import pathlib, tempfile, packmech as pm
    >>> packing = pm.lattice_packing("kagome", repeats=(2, 2))
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "kagome.npz"
    >>> pm.write_packing(packing, path)
    >>> pm.read_packing(path) == packing
    True

    """
    if frame is not None:
        frame = integer("frame", frame)
    snapshots = read_trajectory(path, format=format, box=box, radius=radius)
    if frame is not None and not snapshots.format.many:
        raise ValueError(f"frame must be left out for {_shown(snapshots)} files, which hold one packing, got {frame}")
    snapshot, left_out = snapshots.found(-1 if frame is None else frame)
    beside = list(snapshot.beside())
    warn_of(snapshots.path, [*left_out, *beside], keeps="pm.read_trajectory keeps fields and springs" if beside else "")
    return snapshot.packing


@clear_errors
def read_trajectory(
    path: PathLike, *, format: str | None = None, box: Box | None = None, radius: Any = None
) -> Snapshots:
    """Return the snapshots in a file: packings with their fields, springs and contact forces, read as asked for.

    Files of one packing are taken, too, as a sequence of one.

    Parameters
    ----------
    path, format, box, radius
        As of `pm.read_packing`.

    Returns
    -------
    Snapshots
        A sequence: its length is the number of frames, an index or a slice reads these, a loop reads one at a time.
        What a file holds and a snapshot has no place for is listed in a UserWarning as it is read.

    Raises
    ------
    FileNotFoundError, TypeError, ValueError
        As of `pm.read_packing`.

    Examples
    --------
    >>> import pathlib, tempfile, packmech as pm
    >>> packing = pm.lattice_packing("square", repeats=(2, 2))
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "shift.dump"
    >>> moved = (packing.replace(position_nd=packing.position_nd + 0.1 * k) for k in range(4))
    >>> pm.write_trajectory(moved, path)
    >>> frames = pm.read_trajectory(path)
    >>> len(frames), frames[-1].step, frames[1].packing.position_nd[0].tolist()
    (4, 3, [0.1, 0.1])

    """
    found = existing_file("path", path)
    chosen, style = _format(found, format)
    given = _given(chosen, box, radius, style)
    frames = _in_file(found, lambda: chosen.frames(found, given))
    count = _in_file(found, lambda: len(frames))
    if not count:
        _in_file(found, _no_frame)
    return Snapshots(found, chosen, frames)


def _no_frame() -> None:
    raise ValueError("it must hold at least one frame, got none")


@shown()
@dataclass(frozen=True, eq=False)
class Snapshots(Sequence[Snapshot]):
    """The snapshots of a file, as `read_trajectory` gives them: each is read when it is asked for.

    Attributes
    ----------
    path
        The file.
    format
        How it is read.
    frames
        Its frames.

    """

    path: Path
    format: Format
    frames: Frames

    def __len__(self) -> int:
        return self._count

    @functools.cached_property
    def _count(self) -> int:
        # counted once: some files are opened for it
        return len(self.frames)

    @overload
    def __getitem__(self, number: int) -> Snapshot: ...

    @overload
    def __getitem__(self, number: slice) -> Sequence[Snapshot]: ...

    def __getitem__(self, number: int | slice) -> Snapshot | Sequence[Snapshot]:
        if isinstance(number, slice):
            return [self[k] for k in range(len(self))[number]]
        snapshot, left_out = self.found(integer("number", number))
        warn_of(self.path, left_out)
        return snapshot

    def __iter__(self) -> Iterator[Snapshot]:
        return (self[k] for k in range(len(self)))

    def __repr__(self) -> str:
        return f"Snapshots of {str(self.path)!r}: {len(self)} frame{'' if len(self) == 1 else 's'}"

    def found(self, number: int) -> tuple[Snapshot, list[str]]:
        """Return a snapshot, and what the file holds of it that it has no place for."""
        count = len(self)
        if not -count <= number < count:
            # an IndexError, as loops and reversed() of sequences need it
            raise FrameError(
                f"path must name a readable packing, got {str(self.path)!r}: frame must be below {count}, the number "
                f"of frames, got {number}"
            )
        return _in_file(self.path, lambda: self.frames.frame(number % count))


class NotKeptError(ValueError):
    """A format has no place for what a packing holds; `lost` names that."""

    def __init__(self, message: str, lost: Sequence[str]) -> None:
        super().__init__(message)
        self.lost = tuple(lost)


class FrameError(IndexError, ValueError):
    """There is no frame of that number."""


def warn_of(where: Path | str, left_out: Sequence[str], *, keeps: str = "") -> None:
    """List in a warning what was left out of a file, or of another program's object, and what keeps it."""
    if left_out:
        packing = f"a packing ({keeps})" if keeps else "a packing"
        warn(f"{where}: left out, as {packing} has no place for them: {'; '.join(left_out)}")


@shown_as("writing")
@honors("links shapes", packing_only=True)
def write_packing(
    packing: Packing | Snapshot, path: PathLike, *, format: str | None = None, law: Any = None, drop: bool = False
) -> None:
    """Write the packing, and read back from it the same packing to the last bit.

    Parameters
    ----------
    packing
        The packing; or a `Snapshot` with fields such as velocities, springs, or contact forces.
    path
        The file; its ending says the format, which the head of ``packmech.files.packings`` lists with what each keeps.
        An existing file is replaced, completely or not at all.
    format
        Name of the format where the ending does not say it, as of `pm.read_packing`.
    law
        The law between the particles, kept in .npz files so that `packmech analyze` need not ask; None when unknown.
    drop
        Whether what the format has no place for is left out. Unless it is True, it is refused.

    Raises
    ------
    TypeError, ValueError
        Naming the argument: not a packing, an ending without a format, a folder that does not exist, what the format
        has no place for.

    Examples
    --------
    >>> import pathlib, tempfile, packmech as pm
    >>> folder = pathlib.Path(tempfile.mkdtemp())
    >>> square = pm.lattice_packing("square")
    >>> pm.write_packing(square, folder / "square.txt")
    >>> print((folder / "square.txt").read_text().splitlines()[-1])
    0.0 0.0 0.5
    >>> pm.write_packing(pm.Snapshot(square, {"velocity_nd": [[0.1, 0.0]]}), folder / "square.csv")
    >>> print((folder / "square.csv").read_text().splitlines()[-2:])
    ['x,y,radius,vx,vy', '0.0,0.0,0.5,0.1,0.0']

    """
    snapshot = snapshot_of("packing", packing)
    target, chosen = _target(path, format)
    if law is not None:
        if not is_law(law):
            raise TypeError(f"law must be a law such as Harmonic(...) or None, got {brief(law)}")
        if LAW not in chosen.keeps and not drop:
            raise ValueError(
                f"law must be None for {_shown_as(target, chosen)} files (only .npz keeps it), got {brief(law)}"
            )
    kept = kept_of(snapshot, chosen, f"{_shown_as(target, chosen)} files", drop)
    with replacing(target) as partial:
        if chosen is NPZ:
            npz.write_npz(kept, partial, law)
        else:
            chosen.write([kept], partial)


@shown_as("writing")
def write_trajectory(
    snapshots: Iterable[Packing | Snapshot], path: PathLike, *, format: str | None = None, drop: bool = False
) -> None:
    """Write packings one after another as a trajectory: LAMMPS dump, gsd, or extended xyz.

    Parameters
    ----------
    snapshots
        Packings, or `Snapshot` with fields, springs and contact forces, in any sequence or from a generator: one is
        held at a time. Those without a step get their number, from 0.
    path, format, drop
        As of `pm.write_packing`.

    Raises
    ------
    TypeError, ValueError
        As of `pm.write_packing`; also where the format holds one packing only, or there are none.

    Examples
    --------
    >>> import pathlib, tempfile, packmech as pm
    >>> packing = pm.lattice_packing("square", repeats=(2, 2))
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "grow.extxyz"
    >>> pm.write_trajectory((packing.replace(radius_n=packing.radius_n * (1 + k)) for k in range(3)), path)
    >>> [float(one.packing.radius_n[0]) for one in pm.read_trajectory(path)]
    [0.5, 1.0, 1.5]

    """
    target, chosen = _target(path, format)
    boolean("drop", drop)
    try:
        if isinstance(snapshots, Packing | Snapshot | str):
            raise TypeError
        given = iter(snapshots)
    # whatever an object raises that is asked for its entries, it has none
    except Exception:
        raise TypeError(f"snapshots must be a sequence of packings, got {brief(snapshots)}") from None
    if not chosen.many:
        several = ", ".join(one.endings[0] for one in FORMATS.values() if one.many)
        raise ValueError(f"path must be of a format that holds several packings ({several}), got {str(path)!r}")
    done = 0

    def each() -> Iterator[Snapshot]:
        nonlocal done
        for one in given:
            snapshot = snapshot_of(f"snapshots[{done}]", one)
            if snapshot.step is None:
                snapshot = snapshot.at_step(done)
            yield kept_of(snapshot, chosen, f"{_shown_as(target, chosen)} files", drop)
            done += 1

    with replacing(target) as partial:
        chosen.write(each(), partial)
        if not done:
            raise ValueError("snapshots must hold at least one packing, got none")


def snapshot_of(name: str, given: Any) -> Snapshot:
    """Return what is given, a snapshot or a packing, as a snapshot."""
    if isinstance(given, Snapshot):
        return given
    instance(name, given, Packing)
    return Snapshot(given)


def kept_of(snapshot: Snapshot, chosen: Format, shown: str, drop: bool) -> Snapshot:
    """Return what a format keeps of a snapshot; an error names what it does not, unless that is to be dropped."""
    boolean("drop", drop)
    if drop:
        return chosen.kept(snapshot)
    lost, parts = list(chosen.not_kept(snapshot)), list(chosen.losses(snapshot))
    names = [*(what for what, _, _ in lost), *parts]
    for what, must, got in lost:
        keeping = [
            one.endings[0] for one in FORMATS.values() if what not in {other for other, _, _ in one.not_kept(snapshot)}
        ]
        some = f"only {', '.join(keeping[:-1])} and {keeping[-1]} keep them" if len(keeping) > 1 else "none keeps them"
        keep = f"only {keeping[0]} keeps them" if len(keeping) == 1 else some
        raise NotKeptError(f"{must} for {shown} ({keep}; drop=True leaves them out), got {got}", names)
    for part in parts:
        must, _, got = part.rpartition(", got ")
        text = f"packing must have {must} for {shown} (drop=True leaves the rest out), got {got}"
        raise NotKeptError(text, names)
    return snapshot


@clear_errors
def read_law(path: PathLike) -> Any:
    """Return the law stored with a packing, or None when the file says none.

    Parameters
    ----------
    path
        A packing file. Only .npz files can hold a law.

    Raises
    ------
    FileNotFoundError, ValueError
        As ``read_packing``; also for a law of an unknown kind (register a law of your own with ``pm.law`` first).

    Examples
    --------
    >>> import pathlib, tempfile, packmech as pm
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "square.npz"
    >>> pm.write_packing(pm.lattice_packing("square"), path, law=pm.Hertz(energy_scale=2.0))
    >>> pm.read_law(path)
    Hertz(energy_scale=2.0)

    """
    found = existing_file("path", path)
    if _format(found, None)[0] is not NPZ:
        return None
    return _in_file(found, lambda: npz.read_law(found))


def is_packing_file(path: PathLike) -> bool:
    """Return whether a file name ends as those that `read_packing` reads."""
    return Path(path).suffix.lower() in _ENDINGS


def target_file(path: PathLike, *, packing: bool = False) -> Path:
    """Return the file to be written, after checking its folder and, for a packing, its ending."""
    if packing:
        _format(file_name("path", path), None)
    return writable_file("path", path)


def _target(path: PathLike, format: str | None) -> tuple[Path, Format]:
    target = file_name("path", path)
    chosen, _ = _format(target, format)
    return writable_file("path", target), chosen


def _format(path: Path, name: str | None) -> tuple[Format, str]:
    """Return the format of a file, and the style of its lines where the caller says it."""
    if name is None:
        ending = path.suffix.lower()
        if ending not in _ENDINGS:
            raise ValueError(
                f"path must end in one of {', '.join(_ENDINGS)} (or format= name its format), got {str(path)!r}"
            )
        return _ENDINGS[ending], ""
    if not isinstance(name, str):
        raise TypeError(f"format must be a name, got {brief(name)}")
    own, _, style = name.partition(":")
    if own not in FORMATS or (style and own != DATA.name):
        raise ValueError(f"format must be one of {', '.join(map(repr, FORMATS))}, got {brief(name)}")
    return FORMATS[own], style.strip()


def _given(chosen: Format, box: Any, radius: Any, style: str) -> Given:
    given = Given.checked(box, radius)
    for name, value in {"box": box, "radius": radius}.items():
        if value is not None and chosen in (NPZ, GSD):
            raise ValueError(
                f"{name} must be left out for {chosen.endings[0]} files, which hold it, got {brief(value)}"
            )
    return given._replace(style=style)


def _shown_as(path: Path, chosen: Format) -> str:
    """Return how messages call a file: by its ending, or its format where the ending is none of that."""
    ending = path.suffix.lower()
    return ending if ending in chosen.endings else chosen.name


def _shown(snapshots: Snapshots) -> str:
    return _shown_as(snapshots.path, snapshots.format)


def _in_file(path: Path, read: Callable[[], T]) -> T:
    """Return what `read` returns; its errors, of whatever library, become one ValueError that names the file."""
    try:
        return read()
    except UNREADABLE as error:
        # a damaged archive may put its bytes into the message
        why = " ".join(str(error).split())
        why = why if len(why) <= 2 * _END else f"{why[:_END]} ... {why[-_END:]}"
        raise ValueError(f"path must name a readable packing, got {str(path)!r}: {why}") from error
