"""Something followed along a parameter: lengths of steps, what is done where none succeeds, where a margin ends.

What is followed is asked for its state at another place from the state before. A step that fails is halved, one that
succeeds may grow. Where steps have become too short to be halved, the path is asked to go on otherwise: to rearrange
or to fall.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Generic, NamedTuple, TypeVar

import numpy as np
from scipy.optimize import brentq

S = TypeVar("S")
E = TypeVar("E")

# a state this near a root is one of it
_AT_ROOT = 1e-11


class Lost(Exception):  # noqa: N818 - the caller decides what to make of it
    """Raised where nothing is found any more that could be followed."""


class Step(NamedTuple, Generic[S, E]):
    """One step of what is followed.

    `after` is the state at its end, `place` where that is, `event` what happened other than that it went on.
    """

    after: S
    place: float
    event: E | None = None


@dataclass
class StepLengths:
    """Lengths of steps along a parameter.

    Attributes
    ----------
    next
        The step that is tried next.
    longest
        What it may grow to.
    growth
        Factor by which it grows after a step without event.
    shortest
        Length up to which a step that fails is not halved any more: the path is asked to go on otherwise.
    least
        Length up to which the path ends where it finds no other way either; None: `shortest`.
    left
        A step ends at the goal where less than this would be left.

    """

    next: float = math.inf
    longest: float = math.inf
    growth: float = 1.0
    shortest: float = 0.0
    least: float | None = None
    left: float = 0.0

    def ahead(self, place: float, goal: float) -> float:
        """Return where the next step ends."""
        if abs(goal - place) <= self.next + self.left:
            return goal
        return place + math.copysign(self.next, goal - place)

    def halve(self, length: float) -> None:
        """Make the next step half as long as one that failed."""
        self.next = 0.5 * length

    def grow(self) -> None:
        """Let the next step grow."""
        self.next = min(self.longest, self.growth * self.next)


def follow(
    reach: Callable[[S, float, float], Step[S, E] | None],
    state: S,
    place: float,
    goal: float,
    lengths: StepLengths,
    go_on: Callable[[S, float, float], Step[S, E] | None] | None = None,
) -> Iterator[Step[S, E]]:
    """Yield the steps from a state at one place to a goal, at least one of them.

    Where the path is lost, the steps end before the goal.

    Parameters
    ----------
    reach
        Called as reach(state, place, further); returns the step from a state to a place further on, or to an event
        before it; None where it fails.
    state, place
        Where it begins.
    goal
        Where it ends.
    lengths
        Of the steps; they go on from one call to the next.
    go_on
        Called as `reach`; returns the step that is taken where none that is long enough succeeds, None where there is
        none. None: it ends there.

    """
    direction = math.copysign(1.0, goal - place)
    while True:
        further = lengths.ahead(place, goal)
        length = abs(further - place)
        step = reach(state, place, further)
        if step is None and go_on is not None and length <= lengths.shortest:
            step = go_on(state, place, further)
        if step is not None:
            if step.event is None:
                lengths.grow()
            yield step
            state, place = step.after, step.place
            if direction * (goal - place) <= 0.0:
                return
        elif length <= (lengths.shortest if lengths.least is None else lengths.least):
            return
        else:
            lengths.halve(length)


def find_root(
    look: Callable[[float], S], margin: Callable[[S], float], start: float, beyond: float, there: S, margin_start: float
) -> S:
    """Return what is seen nearest to the place where a margin falls to zero.

    Parameters
    ----------
    look
        Returns what is seen at a place.
    margin
        Returns its margin, negative beyond the root.
    start, beyond
        Places on both sides.
    there
        What is seen beyond.
    margin_start
        The margin at the start, positive.

    """
    found: dict[float, S] = {beyond: there}

    def at(place: float) -> float:
        if place == start:
            return margin_start
        if place not in found:
            found[place] = look(place)
        return max(margin(found[place]), -1.0)

    root = brentq(at, start, beyond, xtol=1e-15, rtol=4.0 * np.finfo(float).eps, maxiter=200)
    near = [place for place, one in found.items() if abs(place - root) < _AT_ROOT and margin(one) > -1.0]
    return min((found[place] for place in near), key=lambda one: abs(margin(one))) if near else look(root)
