"""The catalogue of hard cases: what could go wrong, the quantity watched, the bound, and a function that measures it.

`pytest tests/hard_cases -v` prints every case with what was measured; `python tests/hard_cases/page.py
recordings/hard-cases` writes it to a page.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence

from hard_cases import (
    dynamics,
    ellipses,
    jamming,
    lattices,
    links,
    minimizers,
    places,
    rough,
    sizes,
    static,
    tiny_pressures,
)
from hard_cases.case import HardCase, Measured, measure

__all__ = ["ROOMS", "HardCase", "Measured", "catalogue", "measure"]


# by subject, in the order of the table
ROOMS: dict[str, tuple[HardCase, ...]] = {
    "Packings as they stand": static.CASES,
    "Places, boxes and units": places.CASES,
    "Minimizers": minimizers.CASES,
    "Jamming and verdicts": jamming.CASES,
    "Tiny pressures": tiny_pressures.CASES,
    "Sizes": sizes.CASES,
    "Crystals": lattices.CASES,
    "Ellipses": ellipses.CASES,
    "Links": links.CASES,
    "Friction and stiffness": rough.CASES,
    "Motion": dynamics.CASES,
}


def catalogue() -> tuple[HardCase, ...]:
    """Return every hard case, room by room.

    Examples
    --------
    >>> [case.name for case in catalogue()][:2]
    ['one particle in a box', 'one sphere in a box']

    """
    cases = tuple(itertools.chain.from_iterable(ROOMS.values()))
    _check(cases)
    return cases


def _check(cases: Sequence[HardCase]) -> None:
    names = [case.name for case in cases]
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"names of hard cases must be different, got {name!r} twice")
    for case in cases:
        if not (math.isfinite(case.bound) and case.bound >= 0.0):
            raise ValueError(f"bound must be finite and not negative, got {case.bound} for {case.name!r}")
