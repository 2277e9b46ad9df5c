# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Kinds of particles inside compiled loops, of minimizers and time steps, where an effect looks at them.

They travel in the tuple of effects as a record of its own, so that loops of scenes without them have no code for them.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.contacts.network import pair_of_kinds
from packmech.effects.kinds import kinds_in
from packmech.effects.partners import partners_of
from packmech.jit.compiled import compiled_form, inlined
from packmech.scene import Scene


class RowKinds(NamedTuple):
    """The kinds of particles, by rows."""

    kind_n: NDArray[np.int64]


def row_kinds(scene: Scene, order_n: NDArray[np.int64]) -> tuple[RowKinds, ...]:
    """Return the kinds of a packing by rows; nothing where there is one alone, or no effect looks at them."""
    kind_n = kinds_in(scene.effects, scene.packing)
    return () if kind_n is None else (RowKinds(np.ascontiguousarray(kind_n[order_n])),)


def kinds_between(effects: Any, i: int, j: int) -> int:
    """Return which pair of kinds two rows are; 0 where the effects hold no kinds."""
    held = next((one for one in effects if isinstance(one, RowKinds)), None)
    return 0 if held is None else int(pair_of_kinds(held.kind_n[i], held.kind_n[j]))


@compiled_form(kinds_between, inline=True)
def _choose_kinds_between(effects: Any, i: Any, j: Any) -> Any:
    places = [k for k, one in enumerate(effects) if getattr(one, "instance_class", None) is RowKinds]
    if not places:
        return lambda effects, i, j: 0
    place = places[0]
    return lambda effects, i, j: pair_of_kinds(effects[place].kind_n[i], effects[place].kind_n[j])


@inlined
def partners_of_rows(effects, row, i, j):
    """Return the partners that two rows are, with the radii that stand in them."""
    return partners_of(row[i, 3], row[j, 3], kinds_between(effects, i, j))
