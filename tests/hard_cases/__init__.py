"""The catalogue of hard cases: what could go wrong, the quantity watched, the bound, and a function that measures it.

`pytest tests/hard_cases -v` prints every case with what was measured.
"""

from __future__ import annotations

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

__all__ = ["HardCase", "Measured", "catalogue", "measure"]


def catalogue() -> tuple[HardCase, ...]:
    """Return every hard case, by rooms: packings as they stand, minimizers, jamming, sizes, shapes, links, motion.

    Examples
    --------
    >>> [case.name for case in catalogue()][:2]
    ['one particle in a box', 'one sphere in a box']

    """
    cases = (
        *static.CASES,
        *places.CASES,
        *minimizers.CASES,
        *jamming.CASES,
        *tiny_pressures.CASES,
        *sizes.CASES,
        *lattices.CASES,
        *ellipses.CASES,
        *links.CASES,
        *rough.CASES,
        *dynamics.CASES,
    )
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
