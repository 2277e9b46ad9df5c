"""How far the figures of a run may be off, as it is asked for."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from packmech.check import brief, instance, real

# smallest relative error that may be asked for: rounding of sums [1]
LEAST = 1e-14
# what figures are also called
_ALSO = {
    "G_prime": "storage_modulus",
    "G_double_prime": "loss_modulus",
    "G": "shear_modulus",
    "K": "bulk_modulus",
    "phi_J": "jamming_packing_fraction",
    "phi": "packing_fraction",
    "z": "coordination_number",
    "p": "pressure",
}


@dataclass(frozen=True)
class Target:
    """How far a figure may be off: relative to its value, unless `absolute`."""

    figure: str
    error: float
    absolute: bool = False

    def error_of(self, value: Any, reference: Any) -> float:
        """Return how far a value is off, with its sign where it is one number; infinite where shapes differ."""
        found, true = np.asarray(value, dtype=float), np.asarray(reference, dtype=float)
        if found.shape != true.shape:
            return math.inf
        difference = found - true
        off = float(difference) if difference.ndim == 0 else float(np.abs(difference).max(initial=0.0))
        scale = 1.0 if self.absolute else float(np.abs(true).max(initial=0.0))
        if off == 0.0:
            return 0.0
        return off / scale if scale > 0.0 else math.inf

    def __str__(self) -> str:
        return f"{self.figure} to {self.error:g}" if self.absolute else f"{self.figure} to {100.0 * self.error:g} %"


def read_targets(target: Any) -> tuple[Target, ...]:
    """Return what was asked for, of a text, several texts, or errors by figure.

    Examples
    --------
    >>> [str(one) for one in read_targets("G_prime:1%, contacts: 2 absolute")]
    ['storage_modulus to 1 %', 'contacts to 2']
    >>> [str(one) for one in read_targets({"pressure": 1e-3})]
    ['pressure to 0.1 %']

    """
    if isinstance(target, Mapping):
        found = [
            Target(_figure(name), real(f"target[{name!r}]", each, at_least=LEAST)) for name, each in target.items()
        ]
    else:
        texts = [target] if isinstance(target, str) else target
        if not isinstance(texts, Sequence):
            raise TypeError(
                f'target must be a text such as "storage_modulus:1%", or errors by figure, got {brief(target)}'
            )
        found = [_target_of(part) for text in texts for part in (text.split(",") if isinstance(text, str) else [text])]
    if not found:
        raise ValueError("target must name a figure at least, got none")
    names = [one.figure for one in found]
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f"target must name each figure once, got {name!r} twice")
    return tuple(found)


def _figure(name: Any) -> str:
    instance("target", name, str)
    word = str(name).strip()
    return _ALSO.get(word, word)


def _target_of(text: Any) -> Target:
    instance("target", text, str)
    name, given, value = text.partition(":")
    words = value.replace(" %", "%").split()
    absolute = words[1:] == ["absolute"]
    number = words[0] if words and (absolute or len(words) == 1) else ""
    try:
        error = float(number.removesuffix("%")) * (0.01 if number.endswith("%") else 1.0)
    except ValueError:
        error = math.nan
    if given and error < 0.0:
        raise ValueError(f"target must be an error that is not negative, got {brief(text)}")
    if not given or not name.strip() or not 0.0 <= error < math.inf or (absolute and number.endswith("%")):
        raise ValueError(
            f'target must be FIGURE:ERROR, as in "storage_modulus:1%", "pressure:1e-3" or "contacts:0 absolute", '
            f"got {brief(text)}"
        )
    if error == 0.0 and not absolute:
        raise ValueError(
            f'target must be an error above zero, unless it is absolute ("contacts:0 absolute"), got {brief(text)}'
        )
    if error < LEAST and not absolute:
        raise ValueError(f"target must be an error of {LEAST:g} at least, the digits of a number, got {brief(text)}")
    return Target(_figure(name), error, absolute)
