"""Whether the hooks of a law or an effect are derivatives of each other, found by differences."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

PairHook = Callable[[float, float], float]

# relative overlaps at which is looked: none of them where somebody would put a kink
_OVERLAPS = (0.0123718, 0.0571049, 0.1237193, 0.2371867, 0.3819311, 0.6180557)
# contact distances: more than one, so that a wrong power of it is seen
_CONTACT_DISTANCES = (1.0, 1.7)
# half the difference of distances, over the contact distance: errors of 1e-10 for smooth laws, whose curvatures are
# 1e3 times their forces at most, and 1e-11 by rounding
_HALF_WIDTH = 1e-5
_TOLERANCE = 1e-4
# parts of the largest derivative below which a disagreement is rounding
_ROUNDING = 1e-7


def check_derivatives(what: str, names: tuple[str, str, str], hooks: tuple[PairHook, PairHook, PairHook]) -> None:
    """Refuse a pair's energy, first and second derivative that are not derivatives of each other.

    Parameters
    ----------
    what
        The law or effect that is checked.
    names
        What it calls the three.
    hooks
        Functions of the distance and the contact distance. Each of the two derivatives is compared with differences of
        the function before it, but not at distances where one of these two fails or is not finite.

    Raises
    ------
    ValueError
        Naming the wrong one, a distance, what it gives there and what it should.

    """
    places = [((1.0 - overlap) * sigma, sigma) for sigma in _CONTACT_DISTANCES for overlap in _OVERLAPS]
    for order in (0, 1):
        lower, upper = hooks[order : order + 2]
        found = [(place, pair) for place in places if (pair := _derivatives_at(*place, lower, upper)) is not None]
        scale = max((abs(value) for _, pair in found for value in pair), default=0.0)
        for (distance, sigma), (given, difference) in found:
            if abs(given - difference) > _TOLERANCE * max(abs(given), abs(difference)) + _ROUNDING * scale:
                raise ValueError(
                    f"{what}.{names[order + 1]} must be the derivative of {names[order]} with respect to distance: "
                    f"at distance {distance:.4g}, contact distance {sigma:g}, differences give {difference:.6g}, "
                    f"got {given:.6g}"
                )


def _derivatives_at(
    distance: float, contact_distance: float, lower: PairHook, upper: PairHook
) -> tuple[float, float] | None:
    """Return what the derivative gives beside what differences of the lower give; None where one of them fails."""
    half = _HALF_WIDTH * contact_distance
    try:
        change = lower(distance + half, contact_distance) - lower(distance - half, contact_distance)
        pair = float(upper(distance, contact_distance)), float(change) / (2.0 * half)
    except Exception:  # outside a law's domain; a hook that never works is named where it is compiled
        return None
    return pair if all(map(math.isfinite, pair)) else None


def default_record(cls: Any) -> Any | None:
    """Return the record of a class with every field as it is unless given; None where a field must be given."""
    return cls() if len(cls._field_defaults) == len(cls._fields) else None
