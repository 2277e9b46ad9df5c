"""What laws are told of two particles that touch, beside their distance: how far and how curved they are."""

from __future__ import annotations

import functools
import inspect
import itertools
from collections.abc import Callable
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

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

    """

    contact_distance: float
    effective_radius: float


@device
def partners_of(radius: float, other: float) -> Partners:
    """Return the partners with these radii.

    Examples
    --------
    >>> partners_of(0.5, 1.5)
    Partners(contact_distance=2.0, effective_radius=0.375)

    """
    return Partners(radius + other, effective_radius(radius, other))


@device
def equal_partners(contact_distance: float) -> Partners:
    """Return two particles of one size: R is a quarter of the contact distance.

    Examples
    --------
    >>> equal_partners(1.0)
    Partners(contact_distance=1.0, effective_radius=0.25)

    """
    return Partners(contact_distance, 0.25 * contact_distance)


def pairs_of_sizes(radius_n: NDArray[np.float64]) -> tuple[Partners, ...]:
    """Return partners of the smallest, the mean and the largest radius, each with each: what bounds are taken over."""
    sizes = dict.fromkeys((float(radius_n.min()), float(radius_n.mean()), float(radius_n.max())))
    return tuple(partners_of(*pair) for pair in itertools.combinations_with_replacement(sizes, 2))


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
