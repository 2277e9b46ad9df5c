"""How a scene file says materials: one for all particles, or one for each kind with means and what pairs have instead.

Materials of kinds are tables in a row, which may have a `name`; what two of them do together stands beside these::

    [[material]]
    name = "glass"
    young_modulus = 1.0
    friction = 0.4

    [[material]]
    name = "steel"
    young_modulus = 3.0
    friction = 0.2

    [mixing]
    friction = "min"

    [[exception]]
    between = ["glass", "steel"]
    restitution = 0.7
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from packmech.check import brief, did_you_mean
from packmech.effects.materials import MIXED, Material, Materials
from packmech.files.records import Errors, from_table, kind_of, kinds_of, make, read_fields

# tables that stand beside [[material]]
BESIDE = ("mixing", "exception")


def mixing(friction: str = "geometric", restitution: str = "geometric") -> dict[str, str]:
    """Return which means two materials have where they touch: "geometric", "harmonic", "mean" (arithmetic) or "min".

    Parameters
    ----------
    friction
        Mean of Coulomb's coefficients.
    restitution
        Mean of the shares of the speed that head-on collisions leave.

    """
    return {"friction": friction, "restitution": restitution}


def exception(
    between: tuple[str | int, ...],
    young_modulus: float | None = None,
    poisson_ratio: float | None = None,
    restitution: float | None = None,
    friction: float | None = None,
) -> dict[str, Any]:
    """Return what was measured of one pair of materials, in place of what follows from the constants of both.

    Parameters
    ----------
    between
        Two materials by their `name`, or by number from 0; twice the same for a material with itself.
    young_modulus
        E of the one material as two of which they touch [force/length^2].
    poisson_ratio
        Its nu, from 0 to 0.5 [1].
    restitution
        Share of the speed that head-on collisions leave, above 0 and at most 1 [1].
    friction
        Coulomb's coefficient [1].

    """
    constants = {
        "young_modulus": young_modulus,
        "poisson_ratio": poisson_ratio,
        "restitution": restitution,
        "friction": friction,
    }
    given = {name: value for name, value in constants.items() if value is not None}
    if not given:
        raise ValueError(f"{', '.join(constants)} must be given, one of them at least, got none")
    return {"between": between, "given": given}


def read_materials(tables: Mapping[str, Any]) -> Material | Materials | None:
    """Return the material of a scene's tables, or those of its kinds; None where there is none.

    Raises
    ------
    TypeError, ValueError
        Naming the field by its path, such as ``exception[0].between``.

    """
    found = tables.get("material")
    if not isinstance(found, list):
        for name in BESIDE:
            if name in tables:
                raise ValueError(
                    f"{name} must stand beside a material for each kind ([[material]]), got "
                    f"{'no material' if found is None else 'one material for all ([material])'}"
                )
        return None if found is None else _material(found, "material")
    names, errors = _names(found), Errors()
    materials, mixed = [], mixing()
    for k, table in enumerate(found):
        with errors.kept():
            materials.append(_material(table, f"material[{k}]"))
    with errors.kept():
        mixed = _mixing(tables.get("mixing", {}))
    errors.check()
    return Materials(tuple(materials), mixed, _exceptions(tables.get("exception", []), materials, names))


def material_of_walls(named: Any, where: str, tables: Mapping[str, Any]) -> int:
    """Return the number of the material that walls name, among those of kinds of particles.

    Raises
    ------
    TypeError, ValueError
        Naming the field, such as ``effects[2].material``.

    """
    found = tables.get("material")
    if not isinstance(found, list):
        has = "nothing" if found is None else "one table [material], which walls are made of anyway"
        raise ValueError(f"{where}.material must stand beside tables [[material]], got {has}")
    return _number(named, f"{where}.material", _names(found))


def _material(table: Any, where: str) -> Material:
    if isinstance(table, dict) and "kind" in table:
        raise ValueError(f"{where}.kind must be left out, got {table['kind']!r}")
    if isinstance(table, dict):
        # the name is the file's own
        table = {name: value for name, value in table.items() if name != "name"} | {"kind": kind_of(Material)}
    made: Material = from_table(table, where, kinds_of((Material,)))
    return made


def _names(tables: Sequence[Mapping[str, Any]]) -> list[str | None]:
    """Return the names of materials, None where one has none."""
    names: list[str | None] = []
    for k, table in enumerate(tables):
        name = table.get("name") if isinstance(table, dict) else None
        if name is not None and not isinstance(name, str):
            raise TypeError(f"material[{k}].name must be a string, got {brief(name)}")
        if name is not None and name in names:
            raise ValueError(
                f"material[{k}].name must be that of no other material, got {brief(name)} as of {names.index(name)}"
            )
        names.append(name)
    return names


def _mixing(given: Any) -> dict[str, str]:
    """Return the means that a table names; a name alone stands for both."""
    if isinstance(given, str):
        given = dict.fromkeys(MIXED, given)
    if not isinstance(given, dict) or "kind" in given:
        raise TypeError(f"mixing must be a table of means of {' and '.join(MIXED)}, without a kind, got {brief(given)}")
    _, values = read_fields(given, "mixing", {kind_of(mixing): mixing})
    made = mixing(**values)
    # materials name what is wrong with a mean
    Material(1.0).mixed(Material(1.0), made)
    return made


def _exceptions(
    tables: Any, materials: Sequence[Material], names: Sequence[str | None]
) -> dict[tuple[int, int], dict[str, float]]:
    """Return what pairs of materials have instead of what follows from both, by the numbers of these."""
    if not isinstance(tables, list):
        raise TypeError(f"exception must be a list of tables ([[exception]]), got {brief(tables)}")
    errors = Errors()
    found: dict[tuple[int, int], dict[str, float]] = {}
    for k, table in enumerate(tables):
        where = f"exception[{k}]"
        with errors.kept():
            if not isinstance(table, dict) or "kind" in table:
                raise TypeError(
                    f"{where} must be a table of between and what the pair has, without a kind, got {table}"
                )
            _, values = read_fields(table, where, {kind_of(exception): exception})
            made = make(exception, values, where)
            numbers = [_number(one, f"{where}.between", names) for one in made["between"]]
            if len(numbers) != 2:
                raise ValueError(f"{where}.between must name two materials, got {list(made['between'])}")
            pair = (min(numbers), max(numbers))
            if pair in found:
                raise ValueError(f"{where}.between must be a pair that no other has, got {list(made['between'])} again")
            found[pair] = made["given"]
            # each constant is checked as that of a material
            make(Material, {"young_modulus": 1.0} | made["given"], where)
    errors.check()
    return found


def _number(named: str | int, where: str, names: Sequence[str | None]) -> int:
    """Return the number of the material that a name or a number means."""
    if isinstance(named, int) and 0 <= named < len(names):
        return named
    if named in names:
        return names.index(str(named))
    known = [name for name in names if name is not None]
    near = did_you_mean(named, known) if isinstance(named, str) else ""
    listed = f", or by name ({', '.join(map(repr, known))})" if known else ", as none of them has a name"
    raise ValueError(
        f"{where} must name materials by number, from 0 to {len(names) - 1}{listed}, got {brief(named)}{near}"
    )
