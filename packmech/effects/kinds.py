"""Laws and numbers that differ by the kinds of the particles that touch: tables over pairs of kinds.

A table is a tuple with one entry for each pair of kinds, in the order of `pair_of_kinds`. What looks numbers up is
chosen by type, so that scenes without tables hold no code for them.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.calls.kinds import looks_at_kinds, records_in
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
        raise TypeError(f"{name} must be rows of a square of {words}, or a mapping of pairs of kinds, got {given!r}")
    rows = [isinstance(one, tuple | list) and not hasattr(one, "_fields") for one in given]
    if not any(rows):
        if not kinds_of_table(len(given)):
            raise ValueError(f"{name} must have one of the {words} for each pair of kinds, got {len(given)}")
        return tuple(given)
    kinds = len(given)
    if not all(rows) or any(len(row) != kinds for row in given):
        raise ValueError(f"{name} must be a square of {words}, as many rows as columns, got {given!r}")
    for a, b in itertools.combinations(range(kinds), 2):
        if given[a][b] != given[b][a]:
            raise ValueError(
                f"{name} must be the same for kinds {a} and {b} as for {b} and {a}, got {given[a][b]!r} and "
                f"{given[b][a]!r}"
            )
    return tuple(given[high][low] for high in range(kinds) for low in range(high + 1))


def _table_of_pairs(name: str, given: Mapping[Any, Any], words: str) -> tuple[Any, ...]:
    found: dict[tuple[int, int], Any] = {}
    for pair, one in given.items():
        a, b = checked_pair(name, pair)
        if found.setdefault((b, a), one) != one:
            raise ValueError(f"{name} must be the same for kinds {a} and {b} as for {b} and {a}, got {given!r}")
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
        whole = all(isinstance(one, int | np.integer) and not isinstance(one, bool) and one >= 0 for one in pair)
    except (TypeError, ValueError):
        whole = False
    if not whole:
        raise TypeError(f"{name} must name pairs of kinds such as (0, 1), got {pair!r}")
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
        table = _table("laws", laws, words="laws")
        for one in table:
            if not is_law(one) or isinstance(one, LawByKind):
                raise TypeError(f"laws must be laws such as Harmonic(...), got {one!r}")
            if type(one) is not type(table[0]):
                raise TypeError(f"laws must be of one class, {written_name(type(table[0]))}, got {one!r}")
        return super().__new__(cls, table)

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


def number_at(number: Any, kinds: Any) -> Any:
    """Return a number of an effect, or that of a table for a pair of kinds, or those for (C,) pairs."""
    if not isinstance(number, ByKind):
        return number
    return np.array(number.numbers)[kinds] if isinstance(kinds, np.ndarray) else number.numbers[kinds]


@compiled_form(number_at, inline=True)
def _choose_number_at(number: Any, kinds: Any) -> Any:
    if getattr(number, "instance_class", None) is ByKind:
        return lambda number, kinds: number.numbers[kinds]
    return lambda number, kinds: number


def largest_number(number: Any) -> float:
    """Return a number, or the largest of a table."""
    return max(number.numbers) if isinstance(number, ByKind) else float(number)


def tables_in(record: Any) -> list[tuple[str, tuple[Any, ...]]]:
    """Return the tables by kinds in an effect or a law, each with its name there."""
    return [(name, one[0]) for name, one in records_in(record) if getattr(one, "table_of_kinds", False)]


def kinds_matter(effects: tuple[Any, ...]) -> bool:
    """Return whether an effect may do other things to other kinds of particles: by a table, or as a user's class."""
    return any(map(looks_at_kinds, effects))


def kinds_in(effects: tuple[Any, ...], packing: Packing) -> NDArray[np.int64] | None:
    """Return the (N,) kinds of a packing's particles; None where there is one alone, or no effect looks at them."""
    return packing.kind_n if packing.kinds > 1 and kinds_matter(effects) else None


def refuse_missing_kinds(effects: tuple[Any, ...], packing: Packing) -> None:
    """Refuse tables by kinds that lack a kind of the packing, or stand where no kinds are known.

    Raises
    ------
    ValueError
        Naming the table and the particle.

    """
    for k, one in enumerate(effects):
        # of surfaces what compiled loops know
        for name, table in tables_in(getattr(one, "flat", one)):
            kinds = kinds_of_table(len(table))
            if getattr(one, "acts_as", "") in ("walls", "mesh"):
                raise ValueError(
                    f"effects[{k}].{name} must not differ by kinds, as walls do the same to all particles, got a table "
                    f"for {kinds} kinds"
                )
            if packing.kinds > kinds:
                kind_n = packing.kind_n
                n = 0 if kind_n is None else int((kind_n >= kinds).argmax())
                raise ValueError(
                    f"effects[{k}].{name} must have a row for each kind of the packing's particles, {packing.kinds}, "
                    f"got {kinds}: particle {n} is of kind {0 if kind_n is None else kind_n[n]}"
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
