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
        Functions of the distance and the contact distance; distances where one of them fails, or is not finite, are
        left out.

    Raises
    ------
    ValueError
        Naming the wrong one, a distance, what it gives there and what it should.

    """
    places = [((1.0 - overlap) * sigma, sigma) for sigma in _CONTACT_DISTANCES for overlap in _OVERLAPS]
    found = [(place, pairs) for place in places if (pairs := _derivatives_at(*place, hooks)) is not None]
    for order in (0, 1):
        scale = max((abs(value) for _, pairs in found for value in pairs[order]), default=0.0)
        for (distance, sigma), pairs in found:
            given, difference = pairs[order]
            if abs(given - difference) > _TOLERANCE * max(abs(given), abs(difference)) + _ROUNDING * scale:
                raise ValueError(
                    f"{what}.{names[order + 1]} must be the derivative of {names[order]} with respect to distance: "
                    f"at distance {distance:.4g}, contact distance {sigma:g}, differences give {difference:.6g}, "
                    f"got {given:.6g}"
                )


def _derivatives_at(
    distance: float, contact_distance: float, hooks: tuple[PairHook, PairHook, PairHook]
) -> list[tuple[float, float]] | None:
    """Return, for either derivative, what the hook gives beside what differences give; None where one fails."""
    half = _HALF_WIDTH * contact_distance
    pairs = []
    for lower, upper in zip(hooks[:-1], hooks[1:], strict=True):
        try:
            change = lower(distance + half, contact_distance) - lower(distance - half, contact_distance)
            pairs.append((float(upper(distance, contact_distance)), float(change) / (2.0 * half)))
        except Exception:  # outside a law's domain; a hook that never works is named where it is compiled
            return None
    return pairs if all(math.isfinite(value) for pair in pairs for value in pair) else None


def default_record(cls: Any) -> Any | None:
    """Return the record of a class with every field as it is unless given; None where a field must be given."""
    return cls() if len(cls._field_defaults) == len(cls._fields) else None
