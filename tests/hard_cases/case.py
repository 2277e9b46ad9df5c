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

    """

    name: str
    risk: str
    watched: str
    bound: float
    why: str
    value: Callable[[], float]


@dataclass(frozen=True)
class Measured:
    """A case with the measured value (NaN if it raised, with the reason) and the CPU seconds that it took."""

    case: HardCase
    value: float
    seconds: float
    raised: str = ""

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
    return Measured(case, value, time.process_time() - began, raised)
