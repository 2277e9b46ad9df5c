"""Scenes as TOML files: a packing (generated, read or written out), the effects, what is done with it.

A scene file looks like this; `kind` names a class of the package in lower case with hyphens::

    description = "256 bidisperse discs, every strain free"      # optional

    [packing]
    kind = "random"                     # or "lattice", "clusters", "chains", "file", "inline"
    particles = 256
    dimension = 2
    packing_fraction = 0.87
    seed = 1
    sizes = { kind = "bidisperse", ratio = 1.4, fraction = "50:50" }

    [kinds]                             # optional: kinds of particles, or by = "size"
    shares = [0.7, 0.3]
    seed = 1

    [[effects]]
    kind = "repulsion"
    law = { kind = "harmonic", energy_scale = 1.0 }

    [material]                          # optional: in place of effects, or beside others
    young_modulus = 7e4
    poisson_ratio = 0.22
    density = 2.5                       # of the packing, too, where it names none
    restitution = 0.9
    friction = 0.4

    [drive]                             # optional
    kind = "jam"
    pressure = 1e-8
    strain = "free"
    method = { kind = "decompression", factor = 0.3 }             # optional: what pm.jam takes as its method

The other drives are `kind = "quench"`, with a `force_tolerance` and a `method` such as "conjugate-gradient", and
`kind = "shear-stabilize"`, with a `force_tolerance` and a `pressure` (the volume is held if it is not given), and
`kind = "cement"`, with a `pressure`, the number of random `orders`, their `seed`, and `step` and `freeze` of pm.cement,
and `kind = "oscillatory-shear"`, `"steady-shear"`, `"shear-at-pressure"`, `"ramp-strain"` and `"creep"`, with the
arguments of `pm.oscillatory_shear`, `pm.steady_shear`, `pm.shear_at_pressure`, `pm.ramp_strain` and `pm.creep`;
`kind = "settle"` brings a scene with friction to rest, with a `force_tolerance`; `kind = "simulate"` follows Newton's
equations for so many `steps` (or a `duration`), from `velocities` and `spins` one row a particle, with the numbers of
the particles that are `held`. Oscillatory shear may have rough `plates`, the layer of `pm.rough_plates`.
The other packings: `lattice` takes the arguments of `pm.lattice_packing`, `clusters` those of `pm.cluster_packing` and
`chains` those of `pm.chain_packing`; `file` takes a `path`, relative to the scene file; `inline` takes
`lattice_vectors`, `positions` and `radii`. Lattice vectors stand one in a line. Clusters name their shape, as in
`shape = { kind = "trimer", angle = 1.2 }`, or `angle = [1.1, 2.8]` for another one in every cluster. An inline
packing may have links: `link_pairs` of particles and `link_lengths`, with `link_images` where some are not zero and
`link_shapes` where some hold a shape. `prepared` takes the arguments of a random packing, and a `side` or
`lattice_vectors` of a box to be filled; it is at its energy minimum under the scene's repulsion. Each of these
packings takes a `density`, mass over area, or over volume in space, of every particle, which is 1 unless given; an
inline one may have `masses` instead. It may also have `kinds` of its particles, numbers from 0; in other packings a
table `[kinds]` assigns them, with the arguments of `pm.assign_kinds`. In place of `[material]` there may be a table
`[[material]]` for each kind, of whose densities the masses are then, with the means of two of them in `[mixing]` and
what pairs have instead in `[[exception]]` (`material_tables`); walls name which they are made of
(`material = "wood"`), or what they do themselves.
Numbers that differ by kinds are tables, `coefficient = { numbers = [[0.5, 0.1], [0.1, 0.3]] }`, and so are laws,
`kind = "law-by-kind"` with `laws`: rows of a symmetric square, or one for each pair (0, 0), (1, 0), (1, 1), ...; those
of walls have one entry for each kind, `{ values = [0.5, 0.1] }` and `kind = "law-per-kind"`.

Bonds are effects, too: `kind = "bonds"` and `of = "contacts"`, with the arguments of `pm.bond_contacts` and, with a
`seed`, those of `pm.cut_fragments`; or written out with `pairs` of particles, `rest_lengths` and `images`.

Laws, effects, packings and drives of your own are named like those of the package once they are registered (`pm.law`,
`pm.effect`, `pm.packing_kind`, `pm.drive`); `packmech run --load my_module.py` imports the file that does so.
"""

from __future__ import annotations

import copy
import inspect
import os
import re
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import resources
from pathlib import Path
from typing import Any

import tomli_w

from packmech.check import brief, clear_errors, did_you_mean, instance, integer, one_of
from packmech.check import table as check_table
from packmech.effects import Bonds, Walls, law_of
from packmech.effects.materials import Material, Materials
from packmech.files.paths import PathLike, existing_file, file_name, replacing, writable_file
from packmech.files.records import (
    Errors,
    OpenKinds,
    TableError,
    from_table,
    kind_of,
    kinds_of,
    make,
    read_fields,
    to_table,
)
from packmech.scene import Scene, drive_code, drive_kind, registered_drives
from packmech.scenes.material_tables import BESIDE, material_of_walls, read_materials
from packmech.scenes.recipes import (
    FIELD_OF,
    NESTED,
    PACKINGS,
    acting,
    bonds,
    bonds_table,
    inline_table,
    is_random,
    kinds_of_particles,
    records_in_fields,
)

# fields of walls that a material gives; of several it is named in a field of the file's own
_OF_MATERIAL = ("law", "damping", "friction")
_MATERIAL = "material"
_TOP = ("description", "packing", "kinds", "material", *BESIDE, "effects", "drive")


@clear_errors
def list_scenes() -> dict[str, str]:
    """Return the scenes that ship inside the package: name -> one sentence on it, the default one first.

    Examples
    --------
    >>> next(iter(list_scenes()))
    'default'

    """
    names = sorted(
        (entry.name.removesuffix(".toml") for entry in _shipped().iterdir() if entry.name.endswith(".toml")),
        key=lambda name: (name != "default", name),
    )
    texts = {name: (_shipped() / f"{name}.toml").read_text(encoding="utf-8") for name in names}
    return {name: str(tomllib.loads(text).get("description", "")) for name, text in texts.items()}


def _shipped() -> Any:
    return resources.files("packmech") / "scenes"


def shipped_scene_text(name: str) -> str:
    """Return the text of the file of a scene that ships inside the package.

    Raises
    ------
    ValueError
        If there is none of that name.

    """
    return str((_shipped() / f"{one_of('name', name, list_scenes())}.toml").read_text(encoding="utf-8"))


@clear_errors
def read_scene(path: PathLike, *, seed: int | None = None, changes: Mapping[str, Any] | None = None) -> Scene:
    """Return the scene in a TOML file, or the shipped scene of that name.

    Parameters
    ----------
    path
        A file, or a bare name without an ending such as ``"default"`` (see ``pm.list_scenes``).
    seed
        Another seed than the file's, for a scene whose packing is random.
    changes
        Other values than the file's by their path, as in ``{"packing.particles": 64}``. An effect is named by its kind,
        a material by its name, or either by its place in the list: ``"effects.friction.coefficient"``,
        ``"effects.0.law.energy_scale"``, ``"material.steel.friction"``.

    Raises
    ------
    FileNotFoundError
        If there is no such file or shipped scene.
    TypeError, ValueError
        Naming the field by its path, such as ``effects[0].law.kind``, what it must be, what was given, and the file.

    Examples
    --------
    >>> import packmech as pm
    >>> scene = pm.read_scene("default", changes={"packing.particles": 64, "effects.repulsion.law": "hertz"})
    >>> scene.packing.particles, scene.drive.strain, scene.effects[0].law
    (64, 'free', Hertz(energy_scale=1.0))

    """
    tables, folder = read_scene_tables(path)
    return scene_of_tables(tables, folder, seed=seed, changes=changes, name=os.fspath(path))


def read_scene_tables(path: PathLike) -> tuple[dict[str, Any], Path]:
    """Return the tables of a scene file, or of a shipped scene, and the folder that its paths are relative to.

    Raises
    ------
    FileNotFoundError, TypeError, ValueError
        As `read_scene`.

    """
    name = str(file_name("path", path, "a file name or the name of a shipped scene"))
    if isinstance(path, str) and not Path(name).suffix and Path(name).name == name:
        entry = _shipped() / f"{name}.toml"
        if not entry.is_file():
            shipped = list_scenes()
            raise FileNotFoundError(
                f"path must name a file or a shipped scene ({', '.join(shipped)}), got {brief(name)}"
                f"{did_you_mean(name, shipped)}"
            )
        data, folder = entry.read_bytes(), Path(".")
    else:
        data, folder = existing_file("path", name).read_bytes(), Path(name).parent
    with _named(name):
        text = data.decode("utf-8")
        try:
            return tomllib.loads(text), folder
        except tomllib.TOMLDecodeError:
            _refuse_one_and_several(text)
            raise


def _refuse_one_and_several(text: str) -> None:
    """Refuse a table that stands in a file both as one and as one of several, which TOML cannot read."""
    for name in _TOP:
        one, several = (re.search(rf"^\s*{form}", text, re.MULTILINE) for form in (rf"\[{name}\]", rf"\[\[{name}\]\]"))
        if one and several:
            each = " (one for all particles, or one for each kind)" if name == "material" else ""
            lines = sorted(1 + text.count("\n", 0, found.end()) for found in (one, several))
            raise ValueError(
                f"{name} must be one table [{name}] or several [[{name}]]{each}, got both, in lines "
                f"{lines[0]} and {lines[1]}"
            )


def scene_of_tables(
    tables: Mapping[str, Any],
    folder: Path,
    *,
    seed: int | None = None,
    changes: Mapping[str, Any] | None = None,
    name: str,
) -> Scene:
    """Return the scene that the tables of a file describe, with another seed and other values, as `read_scene`.

    Parameters
    ----------
    tables, folder
        What `read_scene_tables` returned.
    seed, changes
        As in `read_scene`.
    name
        That of the file, for messages.

    """
    with _named(name):
        return _scene(changed_tables(tables, seed=seed, changes=changes), folder)


def changed_tables(
    tables: Mapping[str, Any], *, seed: int | None = None, changes: Mapping[str, Any] | None = None
) -> dict[str, Any]:
    """Return the tables of a scene file with another seed and other values, as `read_scene` takes them."""
    own = copy.deepcopy(dict(tables))
    if changes is not None:
        check_table("changes", changes)
    errors = Errors()
    for path, value in (changes or {}).items():
        with errors.kept():
            _change(own, path, value)
    errors.check()
    if seed is not None:
        _reseed(own, integer("seed", seed, at_least=0), changes or {})
    return own


@contextmanager
def _named(name: str) -> Iterator[None]:
    """Say in errors which file they are about."""
    try:
        yield
    except TableError as several:
        kind = TypeError if all(isinstance(one, TypeError) for one in several.found) else ValueError
        raise kind(f"{len(several.found)} errors in scene file {name!r}:\n{several}") from several
    except (TypeError, ValueError, OSError) as error:
        kind = TypeError if isinstance(error, TypeError) else ValueError
        said = f"path must name a TOML file: {error}" if isinstance(error, _NOT_TOML) else str(error)
        raise kind(f"{said} (in scene file {name!r})") from error


def _change(tables: dict[str, Any], path: str, value: Any) -> None:
    """Set the field at a path to another value."""
    *before, last = path.split(".")
    place: Any = tables
    for k, part in enumerate(before):
        entry = _entry(place, part)
        if entry is None:
            known = list(place) if isinstance(place, dict) else [_name(one) for one in place]
            where = ".".join(before[:k]) or "the scene"
            near = did_you_mean(part, [str(one) for one in known])
            raise ValueError(f"{path} must lie in what the scene has, got no {part!r} in {where} ({known}){near}")
        if isinstance(place[entry], str):
            # the name of a kind stands for a table with its defaults
            place[entry] = {"kind": place[entry]}
        place = place[entry]
        if not isinstance(place, dict | list):
            raise ValueError(f"{path} must lie in a table, got {brief(place)} at {'.'.join(before[: k + 1])}")
    entry = _entry(place, last)
    if isinstance(place, list) and entry is None:
        raise ValueError(f"{path} must be a field of the scene, got no {last!r} there")
    place[last if entry is None else entry] = value


def _entry(place: Any, part: str) -> Any:
    """Return the name in a table, or the number in a list of tables, that a part of a path means; None if none."""
    if isinstance(place, dict):
        return part if part in place else None
    if part.isdigit():
        return int(part) if int(part) < len(place) else None
    found = [k for k, one in enumerate(place) if isinstance(one, dict) and _name(one) == part]
    return found[0] if len(found) == 1 else None


def _name(table: Mapping[str, Any]) -> Any:
    """Return what names a table in a list: its kind, or a name where it has none."""
    return table.get("kind", table.get("name"))


def _reseed(tables: dict[str, Any], seed: int, changes: Mapping[str, Any]) -> None:
    """Set another seed of whatever is drawn, but for a seed of the kinds that is given beside it."""
    packing, assigned = tables.get("packing"), tables.get("kinds")
    if not isinstance(packing, dict) or not is_random(tables):
        kind = packing.get("kind") if isinstance(packing, dict) else None
        raise ValueError(f"seed must be left out for a packing that is not random, got {seed} for kind {kind!r}")
    if is_random({"packing": packing}):
        packing["seed"] = seed
    if is_random({"kinds": assigned}) and "kinds.seed" not in changes:
        tables["kinds"]["seed"] = seed
    effects = tables.get("effects")
    for table in effects if isinstance(effects, list) else []:
        # cuts are drawn again with the packing
        if isinstance(table, dict) and table.get("kind") == "bonds" and "seed" in table:
            table["seed"] = seed


_NOT_TOML = (tomllib.TOMLDecodeError, UnicodeDecodeError)


def _scene(tables: dict[str, Any], folder: Path) -> Scene:
    errors = Errors()
    for name in tables:
        if name not in _TOP:
            near = did_you_mean(name, _TOP)
            errors.found.append(
                ValueError(f"{name} must be a field of a scene ({', '.join(_TOP)}), got an unknown one{near}")
            )
    if not isinstance(tables.get("description", ""), str):
        errors.found.append(TypeError(f"description must be a string, got {tables['description']!r}"))
    entries = tables.get("effects")
    if "material" in tables and entries is None:
        entries = []
    if not isinstance(entries, list) or not (entries or "material" in tables):
        errors.found.append(TypeError(f"effects must be a list of tables ([[effects]]), got {entries or 'nothing'}"))
        entries = []
    known_effects, nested = acting(), records_in_fields()
    # each effect beside its place; bonds are made once the packing is there
    effects: list[Any] = []
    bonded: dict[int, dict[str, Any]] = {}
    walls: dict[int, set[str]] = {}
    made_of: dict[int, int] = {}
    for k, table in enumerate(entries):
        with errors.kept():
            named = isinstance(table, dict) and table.get("kind") == kind_of(Walls) and _MATERIAL in table
            if named:
                made_of[len(effects)] = material_of_walls(table[_MATERIAL], f"effects[{k}]", tables)
                table = {name: value for name, value in table.items() if name != _MATERIAL}
            maker, values = read_fields(table, f"effects[{k}]", known_effects, nested, given=("packing",))
            if maker is bonds:
                bonded[len(effects)] = values
            if maker is Walls:
                walls[len(effects)] = set(values)
            effects.append(None if maker is bonds else make(maker, values, f"effects[{k}]"))
    material: Material | Materials | None = None
    with errors.kept():
        material = read_materials(tables)
    drive = None
    with errors.kept():
        drive = _drive(tables["drive"]) if "drive" in tables else None
    with errors.kept():
        if "packing" not in tables:
            raise ValueError("packing must be given, got nothing")
        recipe, fields = read_fields(
            tables["packing"], "packing", OpenKinds(PACKINGS, "pm.packing_kind"), NESTED | nested, given=("folder",)
        )
    assigned = None
    with errors.kept():
        if "kinds" in tables:
            maker, table = kinds_of_particles, tables["kinds"]
            if not isinstance(table, dict) or "kind" in table:
                raise TypeError(
                    f"kinds must be a table of shares and a seed, or of by, without a kind, got {brief(table)}"
                )
            assigned = read_fields(table, "kinds", {kind_of(maker): maker}, given=("packing",))[1]
    errors.check()
    known = inspect.signature(recipe).parameters
    if "folder" in known:
        fields["folder"] = folder
    if "law" in known and "law" not in fields:
        if material is not None:
            raise ValueError("packing.law must be given beside a material, whose law is known once the packing is")
        fields["law"] = law_of(tuple(effects))
    if isinstance(material, Materials) and "density" in fields:
        raise ValueError(
            "packing.density must be left out beside several materials, which have their own, got "
            f"{fields['density']!r}"
        )
    if isinstance(material, Material) and "density" in known:
        fields.setdefault("density", material.density)
    packing = make(recipe, fields, "packing", FIELD_OF)
    if assigned is not None:
        packing = make(kinds_of_particles, assigned | {"packing": packing}, "kinds")
    for k, values in bonded.items():
        effects[k] = make(bonds, values | {"packing": packing}, f"effects[{k}]", FIELD_OF)
    if isinstance(material, Materials) and packing.given_mass_n is None:
        packing = packing.replace(mass_n=make(material.masses, {"packing": packing}, "material"))
    if material is not None:
        for k, given in walls.items():
            if isinstance(material, Materials) and k not in made_of:
                _refuse_open_walls(f"effects[{k}]", given)
                continue
            # what a table of walls leaves open is the material's
            one = effects[k]
            place = {"packing": packing, "axis": one.axis, "low": one.low, "high": one.high}
            if isinstance(material, Materials):
                place["of"] = made_of[k]
            made = make(material.walls, place, "material", FIELD_OF)
            effects[k] = one._replace(**{name: getattr(made, name) for name in _OF_MATERIAL if name not in given})
        effects = [*make(material.effects, {"packing": packing}, "material", FIELD_OF), *effects]
    return Scene(packing, tuple(effects), drive)


def _refuse_open_walls(where: str, given: set[str]) -> None:
    """Refuse walls that leave to the material what they do, where there are several."""
    for name in _OF_MATERIAL:
        if name not in given:
            raise ValueError(
                f"{where}.{name} must be given for walls beside several materials, got nothing: say which of them the "
                f"walls are made of, as in {_MATERIAL} = 0"
            )


def _drive(table: Any) -> Any:
    drives = registered_drives()
    kinds = OpenKinds(drives, "pm.drive")
    cls = drives.get(table.get("kind", "")) if isinstance(table, dict) else None
    # what may stand there, the code of the drive knows; where no method is named it need not be imported
    nested = {}
    if cls is not None and "method" in table:
        nested = {name: kinds_of(classes()) for name, classes in drive_code(cls).nested.items()}
    return from_table(table, "drive", kinds, nested)


@clear_errors
def write_scene(scene: Scene, path: PathLike, *, description: str = "") -> None:
    """Write the scene as TOML with its packing inline; `read_scene` returns an equal scene, to the last bit.

    Parameters
    ----------
    scene
        The scene.
    path
        The file. An existing file is replaced, completely or not at all.
    description
        One sentence on the scene.

    Raises
    ------
    TypeError, ValueError
        Naming the argument: not a scene, not a file name, a folder that does not exist, a packing with tangential
        displacements, for which scene files have no place, or with links that do not have their lengths.

    Examples
    --------
    >>> import pathlib, tempfile, packmech as pm
    >>> scene = pm.Scene(pm.lattice_packing("square"), effects=(pm.Repulsion(law=pm.Hertz()),))
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "square.toml"
    >>> pm.write_scene(scene, path)
    >>> pm.read_scene(path) == scene
    True

    """
    instance("scene", scene, Scene)
    instance("description", description, str)
    scene.packing.check_link_lengths("scene.packing", "write_scene")
    if scene.packing.tangential is not None:
        raise ValueError(
            "scene.packing must have no tangential displacements for scene files, got "
            f'{scene.packing.tangential.springs}: write it with pm.write_packing and name the file (kind = "file"), or '
            "leave them out with packing.replace(tangential=None)"
        )
    target = writable_file("path", path)
    try:
        description.encode("utf-8")
    except UnicodeEncodeError:
        raise ValueError(f"description must be a text without halves of letters, got {brief(description)}") from None
    tables: dict[str, Any] = {"description": description} if description else {}
    tables["packing"] = inline_table(scene.packing)
    tables["effects"] = [bonds_table(one) if isinstance(one, Bonds) else to_table(one) for one in scene.effects]
    if scene.drive is not None:
        tables["drive"] = to_table(scene.drive) | {"kind": drive_kind(type(scene.drive))}
    with replacing(target) as partial:
        partial.write_text(tomli_w.dumps(tables), encoding="utf-8")
