"""How a scene file says its bonds: made of the contacts of its packing, or written out."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from packmech.check import one_of
from packmech.dynamics.bond_contacts import bond_contacts
from packmech.effects import Bonds, LinearSpring
from packmech.effects.laws import Law
from packmech.generate import cut_fragments
from packmech.packing import Packing
from packmech.records import kind_of, to_table

_SPRINGS = ("compression", "tension", "tangential_stiffness", "damping", "tangential_damping")
_WRITTEN = ("pairs", "images", "rest_lengths")
_MADE = {"rest": "contact", "gap_tolerance": 0.0}
_CUT = {
    "centers": None,
    "lines": None,
    "edge_fuzziness": 0.0,
    "avoided_angle": math.pi / 12.0,
    "cut_top_bottom": False,
    "join_isolated": True,
    "removed_fraction": 0.0,
    "spanning": "avoided",
    "axis": 1,
    "seed": None,
    "tries": 100,
}


@dataclass(frozen=True)
class BondRecipe:
    """The fields of bonds in a scene file.

    `of = "contacts"` makes them of the packing's contacts, with `rest` and `gap_tolerance` of `bond_contacts`, and cuts
    them with the arguments of `cut_fragments` where a `seed` is given. Otherwise they are written out: `pairs` of
    particles, `rest_lengths`, and `images` where some are not zero.
    """

    of: str | None = None
    rest: str = "contact"
    gap_tolerance: float = 0.0
    centers: int | None = None
    lines: int | None = None
    edge_fuzziness: float = 0.0
    avoided_angle: float = math.pi / 12.0
    cut_top_bottom: bool = False
    join_isolated: bool = True
    removed_fraction: float = 0.0
    spanning: str = "avoided"
    axis: int = 1
    seed: int | None = None
    tries: int = 100
    pairs: tuple[tuple[int, ...], ...] | None = None
    images: tuple[tuple[int, ...], ...] | None = None
    rest_lengths: tuple[float, ...] | None = None
    compression: Law = LinearSpring()
    tension: Law = LinearSpring()
    tangential_stiffness: float = 1.0
    damping: float = 0.0
    tangential_damping: float = 0.0

    def bonds(self, packing: Packing) -> Bonds:
        """Return the bonds of this packing."""
        springs = {name: getattr(self, name) for name in _SPRINGS}
        if self.of is None:
            return self._written(packing.dimension, springs)
        one_of("of", self.of, ("contacts",))
        self._without(dict.fromkeys(_WRITTEN), "of = 'contacts'")
        bonds = bond_contacts(packing, rest=self.rest, gap_tolerance=self.gap_tolerance, **springs)
        if self.seed is None:
            self._without(_CUT, "a seed", given=False)
            return bonds
        return cut_fragments(bonds, packing, **{name: getattr(self, name) for name in _CUT})

    def _without(self, defaults: dict[str, Any], what: str, *, given: bool = True) -> None:
        for name, default in defaults.items():
            if getattr(self, name) != default:
                where = "with" if given else "without"
                raise ValueError(f"{name} must be left out {where} {what}, got {getattr(self, name)!r}")

    def _written(self, dimension: int, springs: dict[str, Any]) -> Bonds:
        self._without(_MADE | _CUT, "of = 'contacts'", given=False)
        if self.pairs is None:
            raise ValueError("pairs must be given (or of = 'contacts'), got nothing")
        if self.rest_lengths is None:
            raise ValueError("rest_lengths must be given with pairs, got nothing")
        images = ((0,) * dimension,) * len(self.pairs) if self.images is None else self.images
        for name, rows, size in (("pairs", self.pairs, 2), ("images", images, dimension)):
            for k, row in enumerate(rows):
                if len(row) != size:
                    raise ValueError(f"{name}[{k}] must hold {size} numbers, got {len(row)}")
        pairs = np.array(self.pairs, dtype=np.int64).reshape(-1, 2)
        image = np.array(images, dtype=np.int64).reshape(-1, dimension)
        return Bonds(pairs[:, 0], pairs[:, 1], image, np.array(self.rest_lengths, dtype=float), **springs)


# what the functions that make bonds call a field of the file
FIELD_OF = {"i_b": "pairs", "j_b": "pairs", "image_bd": "images", "rest_length_b": "rest_lengths"}


def bonds_table(bonds: Bonds) -> dict[str, Any]:
    """Return the table of bonds written out, from which the same bonds are read to the last bit."""
    springs = {name: getattr(bonds, name) for name in _SPRINGS}
    return {
        "kind": kind_of(Bonds),
        "pairs": np.column_stack([bonds.i_b, bonds.j_b]).tolist(),
        "images": bonds.image_bd.tolist(),
        "rest_lengths": bonds.rest_length_b.tolist(),
        **{name: value if isinstance(value, float) else to_table(value) for name, value in springs.items()},
    }
