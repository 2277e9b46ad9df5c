"""Whether the hooks of a law or an effect are derivatives of each other and continuous, found by differences."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Any

from packmech.effects.partners import as_asked, equal_partners

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
# relative overlaps at which an energy or a force that vanishes at contact is looked for; one that does not stays the
# same from the first to the second, where a power of the overlap falls by more than a tenth from exponents of 0.02 on
_NEAR_CONTACT = (1e-8, 1e-12)
_FALLS = 0.9
# part of the largest value below which a value at contact is rounding
_NOTHING = 1e-13
# part of the largest value by which a function may change between distances this near, over the contact distance,
# beyond what its derivative says: a jump stays when an interval is halved, a kink does not
_JUMP = 1e-5
_NEAR = 1e-7
# parts of the way between two of these overlaps in which a jump is looked for
_PARTS = 64


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


def check_continuity(what: str, names: tuple[str, str, str], hooks: tuple[PairHook, PairHook, PairHook]) -> None:
    """Refuse a pair's energy and first derivative that do not vanish at contact, or jump at smaller distances.

    Parameters
    ----------
    what, names, hooks
        As in `check_derivatives`, which have passed. What fails somewhere, or is not finite, is not looked at.

    Raises
    ------
    ValueError
        Naming the one that jumps, where, and by how much.

    """
    way = "; where a jump is meant, the class says so with force_jumps = True"
    for order in (0, 1):
        lower, upper = hooks[order : order + 2]
        scale = 0.0
        for sigma in _CONTACT_DISTANCES:
            far, near = (_value(lower, (1.0 - overlap) * sigma, sigma) for overlap in _NEAR_CONTACT)
            values = [_value(lower, (1.0 - overlap) * sigma, sigma) for overlap in _OVERLAPS]
            scale = max([scale, *(abs(one) for one in values if math.isfinite(one))])
            if abs(near) > _NOTHING * scale and abs(near) > _FALLS * abs(far):
                raise ValueError(
                    f"{what}.{names[order]} must go to zero at contact, so that {('energies', 'forces')[order]} do not "
                    f"jump as particles part, got {near:.6g} at contact distance {sigma:g}{way}"
                )
        places = sorted(1.0 - overlap for overlap in _OVERLAPS)
        for pair in zip(places[:-1], places[1:], strict=True):
            distance, jump = _largest_jump(lower, upper, *pair)
            if abs(jump) > _JUMP * scale:
                raise ValueError(
                    f"{what}.{names[order]} must be continuous, got a jump by {jump:.6g} at distance {distance:.6g}, "
                    f"contact distance 1{way}"
                )


def _largest_jump(lower: PairHook, upper: PairHook, begin: float, end: float) -> tuple[float, float]:
    """Return where a function changes most beyond what its derivative says, between two distances, and by how much."""

    def beyond(low: float, high: float) -> float:
        found = _value(lower, high, 1.0) - _value(lower, low, 1.0)
        found -= (high - low) * _value(upper, 0.5 * (low + high), 1.0)
        return found if math.isfinite(found) else 0.0

    # jumps there and back cancel between far ends
    places = [begin + (end - begin) * k / _PARTS for k in range(_PARTS + 1)]
    begin, end = max(zip(places[:-1], places[1:], strict=True), key=lambda pair: abs(beyond(*pair)))
    while end - begin > _NEAR:
        middle = 0.5 * (begin + end)
        if abs(beyond(begin, middle)) > abs(beyond(middle, end)):
            end = middle
        else:
            begin = middle
    return 0.5 * (begin + end), beyond(begin, end)


def may_jump(record: Any) -> bool:
    """Return whether a law or an effect, or a law in it, says that its forces jump."""
    return bool(getattr(type(record), "force_jumps", False)) or any(
        may_jump(one) for one in record if isinstance(one, tuple)
    )


def _value(hook: PairHook, distance: float, contact_distance: float) -> float:
    """Return what a hook gives; nan where it fails."""
    try:
        return float(hook(distance, contact_distance))
    except Exception:  # outside a law's domain; a hook that never works is named where it is compiled
        return math.nan


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


# how far before its reach, over it, an interaction is looked at, and what part of its largest value may be left there:
# what grows from there as the square root of the distance, or faster
_NEAR_REACH, _STILL_THERE = 1e-10, 1e-4
# distances [reach] and alignments at which an interaction is looked at, and half the difference of alignments
_PARTS_OF_REACH = (0.2371, 0.4819, 0.6713, 0.9137)
# range beyond contact, over the contact distance, from which on differences in it can be taken
_RESOLVED = 1e-6
# distance over contact distance at which a pair touched that an interaction remembers
_TOUCHED = 0.99
_ALIGNMENTS = (-0.8371, -0.1713, 0.4519, 0.9173)


def check_interaction(what: str, effect: Any) -> None:
    """Refuse an interaction whose hooks are not derivatives of each other, or that does not end at its reach.

    Parameters
    ----------
    what
        The effect that is checked.
    effect
        An interaction (`packmech.effects.interaction`).

    Raises
    ------
    ValueError
        Naming the wrong hook, where, what it gives there and what differences of the one before it give.

    """
    places = []
    for sigma in _CONTACT_DISTANCES:
        reach = float(effect.reach(as_asked(effect, "reach", equal_partners(sigma))))
        if getattr(type(effect), "memory", 0) and reach < sigma:
            raise ValueError(
                f"{what}.reach must be the contact distance or more, as the effect remembers, got {reach:.6g} at "
                f"contact distance {sigma:g}"
            )
        _check_beginning(what, effect, sigma, reach)
        beyond = reach - sigma if reach > sigma else 0.0
        at = [part * reach for part in _PARTS_OF_REACH]
        # a short range beyond contact is looked at by itself, but not where distances are rounded to too large a part
        at += [sigma + part * beyond for part in _PARTS_OF_REACH if beyond > _RESOLVED * sigma]
        places += [(distance, sigma, alignment) for distance in at for alignment in _ALIGNMENTS]
    reach_of = {
        sigma: float(effect.reach(as_asked(effect, "reach", equal_partners(sigma)))) for sigma in _CONTACT_DISTANCES
    }
    names = ("interaction_energy", "interaction_first", "interaction_second")
    parts = (
        ((0, 0, "distance"), (1, 0, "alignment")),
        ((0, 0, "distance"), (1, 0, "alignment"), (1, 1, "distance"), (2, 1, "alignment")),
    )
    for order in (0, 1):
        lower, upper = (functools.partial(_components, effect, name) for name in names[order : order + 2])
        for entry, source, by in parts[order]:
            found = [(place, _slopes_at(place, entry, source, by, lower, upper, reach_of)) for place in places]
            scale = max((abs(value) for _, pair in found for value in pair), default=0.0)
            for place, (given, difference) in found:
                if abs(given - difference) > _TOLERANCE * max(abs(given), abs(difference)) + _ROUNDING * scale:
                    raise ValueError(
                        f"{what}.{names[order + 1]} must hold the derivatives of {names[order]}: at distance "
                        f"{place[0]:.4g}, contact distance {place[1]:g}, alignment {place[2]:g} differences by "
                        f"{by} give {difference:.6g}, got {given:.6g}"
                    )
    if may_jump(effect):
        return
    for name in names[:2]:
        hook = functools.partial(_components, effect, name)
        largest = max(abs(value) for place in places for value in hook(place))
        for sigma in _CONTACT_DISTANCES:
            reach = reach_of[sigma]
            if 0.0 < reach - sigma <= _RESOLVED * sigma:
                continue
            far = reach - _NEAR_REACH * (min(reach, reach - sigma) if reach > sigma else reach)
            last = max(abs(value) for alignment in _ALIGNMENTS for value in hook((far, sigma, alignment)))
            if last > _STILL_THERE * largest:
                raise ValueError(
                    f"{what}.{name} must go to zero at its reach, so that nothing jumps as particles part, got "
                    f"{last:.6g} there at contact distance {sigma:g}; where a jump is meant, the class says so with "
                    "force_jumps = True"
                )


def _check_beginning(what: str, effect: Any, sigma: float, reach: float) -> None:
    """Refuse an effect said to begin at contact that remembers or acts before."""
    if not getattr(type(effect), "begins_at_contact", False):
        return
    nothing = (0.0,) * int(getattr(type(effect), "memory", 0))
    for part in _PARTS_OF_REACH if nothing else ():
        distance = sigma + part * (reach - sigma)
        numbers = tuple(map(float, _asked(effect, "remember", distance, sigma, nothing)))
        energy, first = (
            _asked(effect, name, distance, sigma, 1.0, nothing) for name in ("interaction_energy", "interaction_first")
        )
        if any(numbers) or energy or any(first):
            raise ValueError(
                f"{what}.remember, interaction_energy and interaction_first must be zero of pairs apart that hold "
                f"zeros, as its class says begins_at_contact = True, got {numbers}, {energy} and {first} at distance "
                f"{distance:.4g}, contact distance {sigma:g}"
            )


def _asked(effect: Any, name: str, distance: float, contact_distance: float, *others: Any) -> Any:
    """Return what a hook gives of particles of one size."""
    return getattr(effect, name)(distance, as_asked(effect, name, equal_partners(contact_distance)), *others)


def _components(effect: Any, name: str, place: tuple[float, float, float]) -> tuple[float, ...]:
    """Return what a hook gives, of one with a memory for a pair that touched."""
    memory = int(getattr(type(effect), "memory", 0))
    numbers = (_asked(effect, "remember", _TOUCHED * place[1], place[1], (0.0,) * memory),) if memory else ()
    found = _asked(effect, name, *place, *numbers)
    return tuple(map(float, found)) if isinstance(found, tuple) else (float(found),)


def _slopes_at(
    place: tuple[float, float, float],
    entry: int,
    source: int,
    by: str,
    lower: Callable[..., Any],
    upper: Any,
    reach_of: dict[float, float],
) -> tuple[float, float]:
    """Return an entry of the upper hook, and the difference of an entry of the lower one that it should be."""
    distance, sigma, alignment = place
    # beyond contact nothing is smoother than the range is long
    length = min(sigma, reach_of[sigma] - sigma) if distance > sigma else sigma
    half = _HALF_WIDTH * (length if by == "distance" else 1.0)
    shift = (half, 0.0) if by == "distance" else (0.0, half)
    there = lower((distance + shift[0], sigma, alignment + shift[1]))[source]
    back = lower((distance - shift[0], sigma, alignment - shift[1]))[source]
    return upper(place)[entry], (there - back) / (2.0 * half)
