"""Laws and numbers that differ by the kinds of the particles that touch: tables over pairs of kinds, rows for walls.

A table is a tuple with one entry for each pair of kinds, in the order of `pair_of_kinds`. What looks numbers up is
chosen by type, so that scenes without tables hold no code for them. A row is a tuple with one entry for each kind: what
walls do to particles of it. Loops know walls as one kind meets them, without rows.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.calls.kinds import looks_at_kinds, reads_kinds, records_in
from packmech.check import brief
from packmech.contacts.network import pair_of_kinds
from packmech.effects.laws import Law, is_law, law, law_energy, law_first, law_second
from packmech.effects.partners import Partners, equal_partners, partners_of, passes_partners_on
from packmech.jit.compiled import compiled_form, tell_apart
from packmech.jit.source_key import written_name
from packmech.packing import Packing


def kinds_of_table(entries: int) -> int:
    """Return for how many kinds a table of so many pairs is; 0 where it is for no number of kinds."""
    kinds = (math.isqrt(8 * entries + 1) - 1) // 2
    return kinds if pair_of_kinds(kinds, 0) == entries else 0


def _table(name: str, given: Any, *, words: str) -> tuple[Any, ...]:
    """Return a table by pairs of kinds from rows of a symmetric square, a mapping of pairs, or the table itself."""
    if isinstance(given, Mapping):
        return _table_of_pairs(name, given, words)
    if isinstance(given, np.ndarray):
        given = given.tolist()
    if not isinstance(given, tuple | list) or hasattr(given, "_fields") or not given:
        raise TypeError(
            f"{name} must be rows of a square of {words}, or a mapping of pairs of kinds, got {brief(given)}"
        )
    rows = [isinstance(one, tuple | list) and not hasattr(one, "_fields") for one in given]
    if not any(rows):
        if not kinds_of_table(len(given)):
            raise ValueError(f"{name} must have one of the {words} for each pair of kinds, got {len(given)}")
        return tuple(given)
    kinds = len(given)
    if not all(rows) or any(len(row) != kinds for row in given):
        raise ValueError(f"{name} must be a square of {words}, as many rows as columns, got {brief(given)}")
    for a, b in itertools.combinations(range(kinds), 2):
        if given[a][b] != given[b][a]:
            raise ValueError(
                f"{name} must be the same for kinds {a} and {b} as for {b} and {a}, got {brief(given[a][b])} and "
                f"{given[b][a]!r}"
            )
    return tuple(given[high][low] for high in range(kinds) for low in range(high + 1))


def _table_of_pairs(name: str, given: Mapping[Any, Any], words: str) -> tuple[Any, ...]:
    found: dict[tuple[int, int], Any] = {}
    for pair, one in given.items():
        a, b = checked_pair(name, pair)
        if found.setdefault((b, a), one) != one:
            raise ValueError(f"{name} must be the same for kinds {a} and {b} as for {b} and {a}, got {brief(given)}")
    kinds = max((high for high, _ in found), default=-1) + 1
    missing = [(b, a) for a in range(kinds) for b in range(a + 1) if (a, b) not in found]
    if missing or not kinds:
        what = f"none for {missing[0]}" if missing else "nothing"
        raise ValueError(f"{name} must have one of the {words} for each pair of kinds, got {what}")
    return tuple(found[high, low] for high in range(kinds) for low in range(high + 1))


def checked_pair(name: str, pair: Any) -> tuple[int, int]:
    """Return two kinds, the smaller one first."""
    try:
        a, b = pair
        whole = all(isinstance(one, int | np.integer) and not isinstance(one, bool) and one >= 0 for one in (a, b))
    # whatever an object raises that is asked for its entries, it is no pair
    except Exception:
        whole = False
    if not whole:
        raise TypeError(f"{name} must name pairs of kinds such as (0, 1), got {brief(pair)}")
    return int(min(a, b)), int(max(a, b))


class _ByKind(NamedTuple):
    numbers: tuple[Any, ...]


class ByKind(_ByKind):
    """A number of an effect that differs by the kinds of the two particles that touch.

    Kinds are `Packing.kind_n`. It may stand for `Friction.coefficient`, `Mindlin.poisson_ratio`,
    `Restitution.coefficient`, `ContactDamping.coefficient` and `ViscoelasticDamping.time`; in scene files as a table
    ``{ numbers = [[0.5, 0.1], [0.1, 0.3]] }``.

    Its numbers are checked when a `Scene` is made with it, each as the number that it stands for.

    Parameters
    ----------
    numbers
        Rows of a symmetric square, entry (a, b) that of kinds a and b; or a mapping {(a, b): number} with each pair
        once. Kept as a tuple with one number for each pair: (0, 0), (1, 0), (1, 1), (2, 0), ...

    Raises
    ------
    TypeError, ValueError
        If it is no such table.

    Examples
    --------
    >>> import packmech as pm
    >>> table = ByKind([[0.5, 0.1], [0.1, 0.3]])
    >>> table, table.of(1, 0)
    (ByKind(numbers=(0.5, 0.1, 0.3)), 0.1)
    >>> pm.Friction(coefficient=table).coefficient == ByKind({(0, 0): 0.5, (0, 1): 0.1, (1, 1): 0.3})
    True

    """

    table_of_kinds = True

    def __new__(cls, numbers: Any) -> ByKind:
        """Return the record of the table."""
        return super().__new__(cls, _table("numbers", numbers, words="numbers"))

    def of(self, one: int, other: int) -> float:
        """Return the number of two kinds."""
        return float(self.numbers[pair_of_kinds(one, other)])


tell_apart(ByKind)


class _LawByKind(NamedTuple):
    # a tuple of laws; files look for records in a field of this annotation
    laws: Any


@law
@passes_partners_on
class LawByKind(_LawByKind):
    """A law of touching pairs that has other numbers for each pair of kinds of particles (`Packing.kind_n`).

    Its unit of energy is the largest of its laws'.

    The numbers are checked when a `Scene` is made with it.

    Parameters
    ----------
    laws
        Laws of one class: rows of a symmetric square, entry (a, b) for kinds a and b; or a mapping {(a, b): law} with
        each pair once. Kept as a tuple with one law for each pair: (0, 0), (1, 0), (1, 1), (2, 0), ...

    Raises
    ------
    TypeError, ValueError
        If it is no such table, or its laws are of several classes.

    Examples
    --------
    >>> import packmech as pm
    >>> soft, mixed, hard = pm.Harmonic(1.0), pm.Harmonic(2.0), pm.Harmonic(5.0)
    >>> by_kind = pm.LawByKind([[soft, mixed], [mixed, hard]])
    >>> by_kind.of(0, 1)
    Harmonic(energy_scale=2.0)
    >>> packing = pm.Packing([[0.0, 0.0], [0.9, 0.0]], [0.5, 0.5], pm.Box.cubic(3.0, 2), kind_n=[0, 1])
    >>> round(pm.energy(pm.Scene(packing, (pm.Repulsion(by_kind),))), 12)
    0.01

    """

    table_of_kinds = True

    def __new__(cls, laws: Any) -> LawByKind:
        """Return the record of the table."""
        return super().__new__(cls, _laws_of_one_class(_table("laws", laws, words="laws")))

    def of(self, one: int, other: int) -> Law:
        """Return the law of two kinds."""
        found: Law = self.laws[pair_of_kinds(one, other)]
        return found

    def energy(self, distance: float, partners: Partners) -> float:
        """Return the energy [energy]."""
        return law_energy(self.laws[partners.kinds], distance, partners)

    def first(self, distance: float, partners: Partners) -> float:
        """Return du/dr [energy/length]."""
        return law_first(self.laws[partners.kinds], distance, partners)

    def second(self, distance: float, partners: Partners) -> float:
        """Return d2u/dr2 [energy/length^2]."""
        return law_second(self.laws[partners.kinds], distance, partners)


def _laws_of_one_class(laws: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return laws, after refusing what is none, and one that is of another class than the first, or holds others."""
    for one in laws:
        if not is_law(one) or isinstance(one, LawByKind | LawPerKind):
            raise TypeError(f"laws must be laws such as Harmonic(...), got {brief(one)}")
        if _classes(one) != _classes(laws[0]):
            raise TypeError(f"laws must be of one class, {' of '.join(_classes(laws[0]))}, got {brief(one)}")
    return laws


def _classes(law: Any) -> list[str]:
    """Return the names of the classes of a law and of the records in it."""
    return [written_name(type(one)) for _, one in records_in(law)]


class _PerKind(NamedTuple):
    values: tuple[Any, ...]


class PerKind(_PerKind):
    """A number of walls that differs by the kind of the particle that touches them (`Packing.kind_n`).

    In `Walls` it may stand for `damping`, for the `coefficient` of a dashpot or of `friction`, for the `time` of
    `ViscoelasticDamping`, and for `Mindlin.poisson_ratio`; in scene files as a table ``{ values = [0.5, 0.1] }``, which
    names its kind, "per-kind", where it stands for `damping`.

    Its numbers are checked when a `Scene` is made with it.

    Parameters
    ----------
    values
        A number for each kind of particles, in their order.

    Raises
    ------
    TypeError
        If it is no such row.

    Examples
    --------
    >>> import packmech as pm
    >>> floor = pm.Walls(1, 0.0, 9.0, damping=pm.Restitution(pm.PerKind([0.9, 0.4])))
    >>> floor.of(1).damping
    Restitution(coefficient=0.4)

    """

    table_of_kinds = True

    def __new__(cls, values: Any) -> PerKind:
        """Return the record of the row."""
        row = _row("values", values, words="numbers")
        for one in row:
            if isinstance(one, bool) or not isinstance(one, int | float | np.number):
                raise TypeError(f"values must be numbers, one for each kind of particles, got {brief(one)}")
        return super().__new__(cls, row)

    def of(self, kind: int) -> float:
        """Return the number of a kind."""
        return float(self.values[_checked_kind(kind, len(self.values))])


class _LawPerKind(NamedTuple):
    # a tuple of laws; files look for records in a field of this annotation
    laws: Any


class LawPerKind(_LawPerKind):
    """A law of walls that has other numbers for each kind of particles (`Packing.kind_n`): `Walls.law`.

    Its numbers are checked when a `Scene` is made with it.

    Parameters
    ----------
    laws
        Laws of one class, one for each kind of particles, in their order.

    Raises
    ------
    TypeError
        If it is no such row, or its laws are of several classes.

    Examples
    --------
    >>> import packmech as pm
    >>> floor = pm.Walls(1, 0.0, 9.0, pm.LawPerKind([pm.Harmonic(1.0), pm.Harmonic(3.0)]))
    >>> pair = pm.Packing([[1.0, 0.4], [3.0, 0.4]], [0.5, 0.5], pm.Box.cubic(10.0, 2), kind_n=[0, 1])
    >>> pm.forces(pm.Scene(pair, (floor,))).round(12).tolist()
    [[0.0, 0.2], [0.0, 0.6]]

    """

    table_of_kinds = True

    def __new__(cls, laws: Any) -> LawPerKind:
        """Return the record of the row."""
        return super().__new__(cls, _laws_of_one_class(_row("laws", laws, words="laws")))

    def of(self, kind: int) -> Law:
        """Return the law of a kind."""
        found: Law = self.laws[_checked_kind(kind, len(self.laws))]
        return found

    def energy(self, distance: float, contact_distance: float) -> float:
        """Refuse to return the energy, which is that of a kind."""
        raise _no_kind()

    def first(self, distance: float, contact_distance: float) -> float:
        """Refuse to return du/dr, which is that of a kind."""
        raise _no_kind()

    def second(self, distance: float, contact_distance: float) -> float:
        """Refuse to return d2u/dr2, which is that of a kind."""
        raise _no_kind()


for _one in (PerKind, LawPerKind):
    tell_apart(_one)


def _no_kind() -> TypeError:
    return TypeError("law must be that of one kind of particles, got LawPerKind: take walls.of(kind)")


def _row(name: str, given: Any, *, words: str) -> tuple[Any, ...]:
    """Return a row with an entry for each kind of particles."""
    if isinstance(given, np.ndarray):
        given = given.tolist()
    if not isinstance(given, tuple | list) or hasattr(given, "_fields") or not given:
        raise TypeError(f"{name} must be {words}, one for each kind of particles, got {brief(given)}")
    return tuple(given)


def _checked_kind(kind: Any, kinds: int) -> int:
    if isinstance(kind, bool) or not isinstance(kind, int | np.integer):
        raise TypeError(f"kind must be a whole number, got {brief(kind)}")
    if not 0 <= kind < kinds:
        raise ValueError(f"kind must be from 0 to {kinds - 1}, got {kind}")
    return int(kind)


def rows_in(record: Any) -> list[tuple[str, tuple[Any, ...]]]:
    """Return the rows by kinds in walls, each with its name there."""
    return _named_in(record, PerKind | LawPerKind)


def at_kind(record: Any, kind: int) -> Any:
    """Return a record of walls with what its rows have for a kind of particles."""
    if isinstance(record, PerKind | LawPerKind):
        return record.of(kind)
    if not hasattr(record, "_fields") or not rows_in(record):
        return record
    return type(record)(*(at_kind(one, kind) for one in record))


def number_at(number: Any, kinds: Any) -> Any:
    """Return a number of an effect, or that of a table for a pair of kinds, or those for (C,) pairs.

    Of a row of walls that of a kind of particles, or those for (W,) kinds.
    """
    if not isinstance(number, ByKind | PerKind):
        return number
    return np.array(number[0])[kinds] if isinstance(kinds, np.ndarray) else number[0][kinds]


@compiled_form(number_at, inline=True)
def _choose_number_at(number: Any, kinds: Any) -> Any:
    if getattr(number, "instance_class", None) is ByKind:
        return lambda number, kinds: number.numbers[kinds]
    return lambda number, kinds: number


def largest_number(number: Any) -> float:
    """Return a number, or the largest of a table or a row."""
    return max(number[0]) if isinstance(number, ByKind | PerKind) else float(number)


def tables_in(record: Any) -> list[tuple[str, tuple[Any, ...]]]:
    """Return the tables by pairs of kinds in an effect or a law, each with its name there."""
    return _named_in(record, ByKind | LawByKind)


def _named_in(record: Any, classes: Any) -> list[tuple[str, tuple[Any, ...]]]:
    return [(name, one[0]) for name, one in records_in(record) if isinstance(one, classes)]


def kinds_matter(effects: tuple[Any, ...]) -> bool:
    """Return whether an effect on pairs may do other things to other kinds: by a table, or as a user's class.

    Walls do not count, which loops know as each kind meets them.
    """
    return any(looks_at_kinds(one) for one in effects if getattr(one, "acts_as", None) not in ("walls", "mesh"))


def kinds_in(effects: tuple[Any, ...], packing: Packing) -> NDArray[np.int64] | None:
    """Return the (N,) kinds of a packing's particles; None where there is one alone, or no effect looks at them."""
    return packing.kind_n if packing.kinds > 1 and kinds_matter(effects) else None


def kinds_by_rows(packing: Packing, order_n: NDArray[np.int64] | None = None) -> NDArray[np.int64]:
    """Return the (N,) kinds of a packing's particles in an order, their own unless given; zeros where it has none."""
    if packing.kind_n is None:
        return np.zeros(packing.particles, dtype=np.int64)
    return np.ascontiguousarray(packing.kind_n if order_n is None else packing.kind_n[order_n])


def refuse_missing_kinds(effects: tuple[Any, ...], packing: Packing) -> None:
    """Refuse tables and rows by kinds that lack a kind of the packing, or stand where no kinds are known.

    Raises
    ------
    ValueError
        Naming the table and the particle.

    """
    for k, one in enumerate(effects):
        # of surfaces what compiled loops know
        flat = getattr(one, "flat", one)
        acts_as = getattr(one, "acts_as", "")
        if acts_as in ("walls", "mesh") and packing.kinds > 1:
            _refuse_readers_of_pairs(k, flat)
        for name, table in tables_in(flat):
            kinds = kinds_of_table(len(table))
            if acts_as == "walls":
                raise ValueError(
                    f"effects[{k}].{name} must be pm.{'LawPerKind' if is_law(table[0]) else 'PerKind'} for walls that "
                    f"differ by the kind of what touches them, got a table by pairs of {kinds} kinds"
                )
            if acts_as == "mesh":
                _refuse_on_surface(f"effects[{k}].{name}", f"a table for {kinds} kinds")
            _refuse_short(f"effects[{k}].{name} must have a row", kinds, packing)
        for name, row in rows_in(flat):
            if acts_as == "mesh":
                _refuse_on_surface(f"effects[{k}].{name}", f"a row for {len(row)} kinds")
            if packing.kind_n is None and len(row) > 1:
                raise ValueError(
                    f"effects[{k}].{name} must be the same for all particles of a packing without kinds, got a row for "
                    f"{len(row)} kinds: give packing.replace(kind_n=...), or pm.assign_kinds(...)"
                )
            _refuse_short(f"effects[{k}].{name} must have an entry", len(row), packing)


def _refuse_readers_of_pairs(k: int, walls: Any) -> None:
    """Refuse what reads the kinds of two particles where one touches a wall."""
    rows = [(name, one) for name, row in rows_in(walls) for one in row]
    for name, one in [*records_in(walls), *rows]:
        cls: Any = type(one)
        if name and reads_kinds(cls):
            raise ValueError(
                f"effects[{k}].{name} must read no kinds, which are those of two particles, where one touches a wall, "
                f"got {brief(one)}: take pm.LawPerKind or pm.PerKind in pm.Walls"
            )


def _refuse_on_surface(name: str, what: str) -> None:
    raise ValueError(f"{name} must not differ by kinds, as surfaces do the same to all particles, got {what}")


def _refuse_short(must: str, kinds: int, packing: Packing) -> None:
    if packing.kinds > kinds:
        kind_n = packing.kind_n
        n = 0 if kind_n is None else int((kind_n >= kinds).argmax())
        raise ValueError(
            f"{must} for each kind of the packing's particles, {packing.kinds}, got {kinds}: particle {n} is of kind "
            f"{0 if kind_n is None else kind_n[n]}"
        )


def reference_partners(effects: tuple[Any, ...], packing: Packing) -> tuple[Partners, ...]:
    """Return partners of the reference diameter: of each pair of the packing's kinds where effects look at kinds."""
    pair = equal_partners(packing.reference_diameter)
    return tuple(pair._replace(kinds=each) for each in _pairs_of_kinds(effects, packing))


def _pairs_of_kinds(effects: tuple[Any, ...], packing: Packing) -> list[int]:
    """Return the pairs of kinds that particles of a packing may be; 0 alone where no effect looks at kinds."""
    kind_n = kinds_in(effects, packing)
    present = [0] if kind_n is None else np.unique(kind_n).tolist()
    return [int(pair_of_kinds(*pair)) for pair in itertools.combinations_with_replacement(present, 2)]


def bounding_partners(effects: tuple[Any, ...], packing: Packing, *, sites: bool = False) -> tuple[Partners, ...]:
    """Return partners of the smallest, the mean and the largest radius, each with each: what bounds are taken over.

    Where effects look at kinds, for every pair of the packing's kinds.

    Parameters
    ----------
    effects
        The scene's effects.
    packing
        The packing.
    sites
        Whether radii are those of what touches, of rigid bodies the beads.

    """
    radius_n = packing.shapes.site_radius(packing.radius_n) if sites else packing.radius_n
    sizes = dict.fromkeys((float(radius_n.min()), float(radius_n.mean()), float(radius_n.max())))
    kinds = _pairs_of_kinds(effects, packing)
    return tuple(
        partners_of(*pair, each) for pair in itertools.combinations_with_replacement(sizes, 2) for each in kinds
    )
