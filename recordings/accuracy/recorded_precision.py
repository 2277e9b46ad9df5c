"""What files lose of a packing at falling pressure: positions, overlaps and pressure read back.

    python recordings/accuracy/recorded_precision.py

Files of packmech hold double precision, gsd files and recordings (.rrd) beside single precision for other programs: the
HOOMD schema and the picture under /world. Single precision rounds a coordinate of some diameters by 2e-7 of a diameter,
and so an overlap by as much, however small it is. The reference is the packing that was written. The floor is rounding
of the largest coordinate in double precision.
"""

from functools import cache, partial
from pathlib import Path
from tempfile import TemporaryDirectory

import gsd.hoomd
import numpy as np
import rerun.chunk
from against import compare, write
from cyclopts import run

import packmech as pm

QUANTITIES = ("positions (diameters)", "overlaps (relative)", "pressure (relative)")
FILES = {"npz": "a.npz", "gsd, packmech's arrays": "a.gsd", "gsd, schema": "b.gsd"}
ENTITIES = {"rrd, /state": ("state/position", "position_nd")}
ENTITIES["rrd, /world"] = ("world/particles", "Points2D:positions")


@cache
def packing_at(particles: int, pressure: float) -> pm.Packing:
    """Return discs pressed in a box of fixed shape."""
    start = pm.random_packing(particles, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.87, seed=1)
    return pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=pressure, strain="isotropic").packing


def read_back(packing: pm.Packing, kind: str, folder: Path) -> pm.Packing:
    """Return the packing as it is read from a file of this kind; a recording's box and radii are taken as they were."""
    if kind in ENTITIES:
        entity, column = ENTITIES[kind]
        pieces = rerun.chunk.RrdReader(pm.record_packing(packing, folder / "a.rrd")).stream().to_chunks()
        batches = [one.to_record_batch() for one in pieces if str(one.entity_path) == f"/{entity}"]
        (held,) = [one.column(column).to_pylist() for one in batches if column in one.schema.names]
        return packing.replace(position_nd=np.array(held[-1], dtype=float).reshape(packing.position_nd.shape))
    pm.write_packing(packing, folder / FILES[kind].replace("b", "a"))
    if kind == "gsd, schema":
        with gsd.hoomd.open(folder / "a.gsd") as file, gsd.hoomd.open(folder / "b.gsd", "w") as bare:
            frame = file[0]
            frame.log = {}
            bare.append(frame)
    return pm.read_packing(folder / FILES[kind])


def trial(particles: int, kind: str, pressure: float) -> pm.Answer:
    """Return how far positions, overlaps of the contacts and the pressure are off, with the contacts lost."""
    packing, diameter = packing_at(particles, pressure), packing_at(particles, pressure).reference_diameter
    with TemporaryDirectory() as folder:
        back = read_back(packing, kind, Path(folder))
    moved_nd = (back.position_nd - packing.position_nd) @ packing.box.inverse_dd.T
    # particles may have been wrapped into the box
    shift_nd = (moved_nd - np.round(moved_nd)) @ packing.box.lattice_dd.T
    back = back.replace(position_nd=packing.position_nd + shift_nd)
    contacts = pm.find_contacts(packing)
    before_c, after_c = contacts.overlap_c, contacts.at(back).overlap_c
    true, seen = (pm.pressure(pm.Scene(one, (pm.Repulsion(),))) for one in (packing, back))
    relative, lost = np.sqrt(((after_c - before_c) ** 2).mean()) / before_c.mean(), (after_c <= 0.0).sum()
    off = (np.abs(shift_nd).max() / diameter, relative, abs(seen / true - 1.0))
    work = {"mean overlap": before_c.mean(), "contacts": len(contacts), "lost contacts": lost}
    work["floor"] = np.finfo(float).eps * np.abs(packing.position_nd).max() / diameter
    return pm.Answer(dict(zip(QUANTITIES, map(float, off), strict=True)), work=work)


def main(*, particles: int = 64, decades: tuple[int, int] = (2, 8), out: Path = Path(__file__).parent) -> None:
    """Write and read packings at all pressures; write table, text and figure."""
    pressures = [10.0**-k for k in range(decades[0], decades[1] + 1)]
    for pressure in pressures:
        packing_at(particles, pressure)
    problem = {kind: partial(trial, particles, kind) for kind in [*FILES, *ENTITIES]}
    title = f"What files keep of {particles} discs at falling pressure"
    about = {"knob": "pressure", "title": title, "reference_is": "the packing that was written"}
    table = compare(problem, pressures, QUANTITIES, **about)
    exact = [one for one in table.methods if all(set(trial.errors.values()) == {0.0} for trial in table.of(one))]
    words = f"Without any error, and not drawn: {'; '.join(exact)}. CPU s: writing, reading and finding the contacts."
    write(table, out, "recorded_precision", words, floor="floor", clock=False)


if __name__ == "__main__":
    run(main)
