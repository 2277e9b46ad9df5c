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

    [[effects]]
    kind = "repulsion"
    law = { kind = "harmonic", energy_scale = 1.0 }

    [drive]                             # optional
    kind = "jam"
    pressure = 1e-8
    strain = "free"
    method = { kind = "decompression", factor = 0.3 }             # optional: what pm.jam takes as its method

The other drives are `kind = "quench"`, with a `force_tolerance` and a `method` such as "conjugate-gradient", and
`kind = "shear-stabilize"`, with a `force_tolerance` and a `pressure` (the volume is held if it is not given), and
`kind = "cement"`, with a `pressure`, the number of random `orders`, their `seed`, and `step` and `freeze` of pm.cement,
and `kind = "oscillatory-shear"`, `"steady-shear"`, `"ramp-strain"` and `"creep"`, with the arguments of
`pm.oscillatory_shear`, `pm.steady_shear`, `pm.ramp_strain` and `pm.creep` and a `density`; `kind = "simulate"` follows
Newton's equations for so many `steps` (or a `duration`), from `velocities` and `spins` one row a particle, with
`masses` (or a `density`) and the numbers of who is `held`. Oscillatory shear may have rough `plates`, the layer of
`pm.rough_plates`.
The other packings: `lattice` takes the arguments of `pm.lattice_packing`, `clusters` those of `pm.cluster_packing` and
`chains` those of `pm.chain_packing`; `file` takes a `path`, relative to the scene file; `inline` takes
`lattice_vectors`, `positions` and `radii`. Lattice vectors stand one in a line. Clusters name their shape, as in
`shape = { kind = "trimer", angle = 1.2 }`, or `angle = [1.1, 2.8]` for another one in every cluster. An inline
packing may have links: `link_pairs` of particles and `link_lengths`, with `link_images` where some are not zero and
`link_shapes` where some hold a shape. `prepared` takes the arguments of a random packing, and a `side` or
`lattice_vectors` of a box to be filled; it is at its energy minimum under the scene's repulsion.

Bonds are effects, too: `kind = "bonds"` and `of = "contacts"`, with the arguments of `pm.bond_contacts` and, with a
`seed`, those of `pm.cut_fragments`; or written out with `pairs` of particles, `rest_lengths` and `images`.
"""

from __future__ import annotations

import dataclasses
import os
import tomllib
import typing
from importlib import resources
from pathlib import Path
from typing import Any

from packmech import bond_recipe
from packmech.bond_recipe import BondRecipe, bonds_table
from packmech.check import instance, integer
from packmech.effects import Bonds, law_of, registered_effects, registered_laws
from packmech.files import PathLike, replacing, target_file
from packmech.packing import Packing
from packmech.recipes import FIELD_OF, NESTED, PACKINGS, SEEDED, Prepared, inline_table
from packmech.records import from_table, kinds_of, to_table
from packmech.scene import Drive, Scene
from packmech.toml_text import toml_text

_DRIVES = {kind.removesuffix("-drive"): cls for kind, cls in kinds_of(typing.get_args(Drive)).items()}
_TOP = ("description", "packing", "effects", "drive")


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


def read_scene(path: PathLike, *, seed: int | None = None) -> Scene:
    """Return the scene in a TOML file, or the shipped scene of that name.

    Parameters
    ----------
    path
        A file, or a bare name without an ending such as ``"default"`` (see ``pm.list_scenes``).
    seed
        Another seed than the file's, for a scene whose packing is random.

    Raises
    ------
    FileNotFoundError
        If there is no such file or shipped scene.
    TypeError, ValueError
        Naming the field by its path, such as ``effects[0].law.kind``, what it must be, what came, and the file.

    Examples
    --------
    >>> import packmech as pm
    >>> scene = pm.read_scene("default")
    >>> scene.packing.particles, scene.drive.strain
    (256, 'free')

    """
    if not isinstance(path, str | os.PathLike):
        raise TypeError(f"path must be a file name or the name of a shipped scene, got {path!r}")
    name = os.fspath(path)
    if isinstance(path, str) and not Path(name).suffix and Path(name).name == name:
        entry = _shipped() / f"{name}.toml"
        if not entry.is_file():
            raise FileNotFoundError(
                f"path must name a file or a shipped scene ({', '.join(list_scenes())}), got {name!r}"
            )
        data, folder = entry.read_bytes(), Path(".")
    else:
        if not Path(name).is_file():
            raise FileNotFoundError(f"path must name an existing file, got {name!r}")
        data, folder = Path(name).read_bytes(), Path(name).parent
    try:
        tables = tomllib.loads(data.decode("utf-8"))
        if seed is not None:
            _reseed(tables, integer("seed", seed, at_least=0))
        return _scene(tables, folder)
    except (TypeError, ValueError, OSError) as error:
        kind = TypeError if isinstance(error, TypeError) else ValueError
        said = f"path must name a TOML file: {error}" if isinstance(error, _NOT_TOML) else str(error)
        raise kind(f"{said} (in scene file {name!r})") from error


def _reseed(tables: dict[str, Any], seed: int) -> None:
    packing = tables.get("packing")
    if not isinstance(packing, dict) or packing.get("kind") not in SEEDED:
        kind = packing.get("kind") if isinstance(packing, dict) else None
        raise ValueError(f"seed must be left out for a packing that is not random, got {seed} for kind {kind!r}")
    packing["seed"] = seed
    effects = tables.get("effects")
    for table in effects if isinstance(effects, list) else []:
        # cuts are drawn anew with the packing
        if isinstance(table, dict) and table.get("kind") == "bonds" and "seed" in table:
            table["seed"] = seed


_NOT_TOML = (tomllib.TOMLDecodeError, UnicodeDecodeError)


def _methods(drive: Any) -> dict[str, dict[str, type]]:
    """Return the records that may stand in the fields of a drive, by name, where it has any."""
    if not isinstance(drive, dict) or "method" not in drive or drive.get("kind") == "shear-stabilize":
        return {}
    from packmech.dynamics.jam_methods import JamMethod
    from packmech.dynamics.minimizers import MinimizeMethod
    from packmech.dynamics.verlet import INTEGRATORS

    if drive.get("kind") in ("oscillatory-shear", "steady-shear", "ramp-strain", "creep", "simulate"):
        return {"method": kinds_of(INTEGRATORS)}

    minimize = kinds_of(typing.get_args(MinimizeMethod))
    return {
        "method": minimize if drive.get("kind") == "quench" else kinds_of(typing.get_args(JamMethod)),
        "minimizer": minimize,
    }


def _scene(tables: dict[str, Any], folder: Path) -> Scene:
    for name in tables:
        if name not in _TOP:
            raise ValueError(f"{name} must be a field of a scene ({', '.join(_TOP)}), got an unknown one")
    if not isinstance(tables.get("description", ""), str):
        raise TypeError(f"description must be a string, got {tables['description']!r}")
    if "packing" not in tables:
        raise ValueError("packing must be given, got nothing")
    entries = tables.get("effects")
    if not isinstance(entries, list) or not entries:
        raise TypeError(f"effects must be a list of tables ([[effects]]), got {entries or 'nothing'}")
    laws, acting = kinds_of(registered_laws()), kinds_of(registered_effects()) | {"bonds": BondRecipe}
    fields = dict.fromkeys(("law", "compression", "tension"), laws)
    said = tuple(from_table(table, f"effects[{k}]", acting, fields) for k, table in enumerate(entries))
    drive = from_table(tables["drive"], "drive", _DRIVES, _methods(tables["drive"])) if "drive" in tables else None
    recipe = from_table(tables["packing"], "packing", PACKINGS, NESTED | fields)
    if isinstance(recipe, Prepared) and recipe.law is None:
        recipe = dataclasses.replace(recipe, law=law_of(said))
    try:
        packing = recipe.packing(folder)
    except (TypeError, ValueError, OSError) as error:
        argument, must, rest = str(error).partition(" must ")
        raise type(error)(f"packing.{FIELD_OF.get(argument, argument)}{must}{rest}") from error
    effects = tuple(
        _bonds(one, packing, f"effects[{k}]") if isinstance(one, BondRecipe) else one for k, one in enumerate(said)
    )
    return Scene(packing, effects, drive)


def _bonds(recipe: BondRecipe, packing: Packing, where: str) -> Bonds:
    try:
        return recipe.bonds(packing)
    except (TypeError, ValueError) as error:
        argument, must, rest = str(error).partition(" must ")
        raise type(error)(f"{where}.{bond_recipe.FIELD_OF.get(argument, argument)}{must}{rest}") from error


def write_scene(scene: Scene, path: PathLike, *, description: str = "") -> None:
    """Write the scene as TOML with its packing inline; `read_scene` returns an equal scene, to the last bit.

    Parameters
    ----------
    scene
        The scene.
    path
        The file. An existing file is replaced, whole or not at all.
    description
        One sentence on the scene.

    Raises
    ------
    TypeError, ValueError
        Naming the argument: not a scene, not a file name, a folder that does not exist.

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
    target = target_file(path)
    tables: dict[str, Any] = {"description": description} if description else {}
    tables["packing"] = inline_table(scene.packing)
    tables["effects"] = [bonds_table(one) if isinstance(one, Bonds) else to_table(one) for one in scene.effects]
    if scene.drive is not None:
        drive = to_table(scene.drive)
        tables["drive"] = drive | {"kind": drive["kind"].removesuffix("-drive")}
    with replacing(target) as partial:
        partial.write_text(toml_text(tables), encoding="utf-8")
