"""One hard case, and what was measured of it."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass

import packmech as pm

# the effects of most cases
HARMONIC = (pm.Repulsion(law=pm.Harmonic()),)
# what a case may raise when it goes wrong; anything else is a mistake in the case itself
FAILURES = (ArithmeticError, RuntimeError, ValueError)


@dataclass(frozen=True)
class HardCase:
    """A situation in which something is known to go wrong in codes of this kind.

    Attributes
    ----------
    name, risk, watched
        What the situation is, what could go wrong in it, and which quantity shows it.
    bound, why
        The largest value of the quantity that is right, and where it comes from.
    value
        Function that measures the quantity.
    naive
        What a way that suggests itself gives in its place: a function that measures it, or a sentence.

    """

    name: str
    risk: str
    watched: str
    bound: float
    why: str
    value: Callable[[], float]
    naive: Callable[[], float] | str = ""


@dataclass(frozen=True)
class Measured:
    """A case with the measured value (NaN if it raised, with the reason) and the CPU seconds that it took.

    `naive` is the figure of the naive way, or the sentence about it.
    """

    case: HardCase
    value: float
    seconds: float
    raised: str = ""
    naive: str = ""

    @property
    def within(self) -> bool:
        """Whether the value is a number not above the bound."""
        return self.value <= self.case.bound


def measure(case: HardCase) -> Measured:
    """Return what a case measures; an error that it raises is out of bounds, with the error as the reason.

    Examples
    --------
    >>> broken = HardCase("division", "it is not defined", "1 / 0", 1.0, "an example", lambda: 1 / 0)
    >>> measure(broken).within, measure(broken).raised
    (False, 'ZeroDivisionError: division by zero')

    """
    began = time.process_time()
    value, raised = math.nan, ""
    try:
        value = float(case.value())
    except FAILURES as error:
        raised = f"{type(error).__name__}: {str(error).partition(chr(10))[0]}"
    seconds = time.process_time() - began
    return Measured(case, value, seconds, raised, case.naive if isinstance(case.naive, str) else _figure(case.naive))


def _figure(naive: Callable[[], float]) -> str:
    """Return what the naive way gives; that it breaks is an answer, too."""
    try:
        return f"{float(naive()):.3g}"
    except FAILURES as error:
        return f"{type(error).__name__}"
