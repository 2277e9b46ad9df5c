"""What laws are given of two particles that touch, beside their distance: how large, how curved, of which kinds."""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

from packmech.contacts.network import effective_radius
from packmech.jit.compiled import device

C = TypeVar("C", bound=type)


class Partners(NamedTuple):
    """Two particles that touch, as laws and effects see them.

    A method of a law or an effect that names a parameter `partners` where others have `contact_distance` is given this
    record; the others are given its first number alone.

    Attributes
    ----------
    contact_distance
        Distance of the centers at which they would just touch, the sum of the radii [length].
    effective_radius
        R = r_i r_j / (r_i + r_j) [length]; of rigid bodies with the radii of the beads that touch, of a wall, which is
        touched as an equal particle is, half the radius. nan of ellipses and spheroids, whose curvature differs from
        place to place.
    kinds
        Which pair of kinds of particles they are (`packmech.contacts.network.pair_of_kinds`): 0 of two of kind 0, 1 of
        kinds 0 and 1, 2 of two of kind 1, 3 of kinds 0 and 2, and so on. Of walls and bonds 0.

    """

    contact_distance: float
    effective_radius: float
    kinds: int = 0


@device
def partners_of(radius: float, other: float, kinds: int) -> Partners:
    """Return the partners with these radii, of this pair of kinds.

    Examples
    --------
    >>> partners_of(0.5, 1.5, 0)
    Partners(contact_distance=2.0, effective_radius=0.375, kinds=0)

    """
    return Partners(radius + other, effective_radius(radius, other), kinds)


@device
def equal_partners(contact_distance: float) -> Partners:
    """Return two particles of one size and of kind 0: R is a quarter of the contact distance.

    Examples
    --------
    >>> equal_partners(1.0)
    Partners(contact_distance=1.0, effective_radius=0.25, kinds=0)

    """
    return Partners(contact_distance, 0.25 * contact_distance, 0)


@functools.cache
def asks_for_partners(cls: Any, name: str) -> bool:
    """Return whether a method of a law or an effect names a parameter `partners`."""
    return "partners" in inspect.signature(getattr(cls, name)).parameters


# classes that hand partners to a law in them and ask for nothing themselves
_PASSING: set[type] = set()


def passes_partners_on(cls: C) -> C:
    """Return the class of a law or an effect, which asks for partners only to hand them to a law in it."""
    _PASSING.add(cls)
    return cls


def feels_curvature(record: Any) -> bool:
    """Return whether a law or an effect, or one in it, asks for the effective radius of the two particles."""
    cls: Any = type(record)
    asks = cls not in _PASSING and any(
        asks_for_partners(cls, name) for name, method in vars(cls).items() if inspect.isfunction(method)
    )
    within = record if isinstance(record, tuple) else ()
    return asks or any(feels_curvature(one) for one in within if isinstance(one, tuple))


def as_asked(record: Any, name: str, partners: Partners) -> Any:
    """Return the partners, or their contact distance alone, as a method of a law or an effect asks for."""
    cls: Any = type(record)
    return partners if asks_for_partners(cls, name) else partners.contact_distance


def argument_of(cls: Any, name: str) -> Callable[[Any], Any]:
    """Return the compiled function that makes of partners what a method asks for."""
    return _whole if cls is not None and asks_for_partners(cls, name) else _contact_distance


@device
def _whole(partners: Any) -> Any:
    return partners


@device
def _contact_distance(partners: Any) -> Any:
    return partners.contact_distance
