"""CPU time of the laws in compiled loops, against the linear spring and a function of the same formula written there.

Run by hand: python tests/benchmarks/bench_laws.py
"""

import time
from typing import NamedTuple

import numpy as np
from numba import njit

import packmech as pm
from packmech.effects import law_first
from packmech.effects.partners import equal_partners
from packmech.jit.compiled import OPTIONS, kernel


class Given(NamedTuple):
    """Numbers of contacts and repeats."""

    contacts: int = 100_000
    repeats: int = 200


@kernel
def total(law, distance_c, contact_distance_c):
    """Return the sum of du/dr over the contacts."""
    out = 0.0
    for c in range(distance_c.shape[0]):
        out += law_first(law, distance_c[c], equal_partners(contact_distance_c[c]))
    return out


@njit(**OPTIONS)
def by_hand(stiffness, cap, distance_c, contact_distance_c):
    """Return the same for the divergent law, its formula in the loop."""
    out = 0.0
    for c in range(distance_c.shape[0]):
        r, sigma = distance_c[c], contact_distance_c[c]
        if sigma * (sigma - r) >= cap * sigma * r:
            out -= stiffness * cap * sigma
        else:
            out -= stiffness * sigma / r * (sigma - r)
    return out


def cpu(function, *arguments):
    """Return the least CPU time of a call [s]."""
    function(*arguments)
    best = np.inf
    for _ in range(Given().repeats):
        began = time.process_time()
        function(*arguments)
        best = min(best, time.process_time() - began)
    return best


def main():
    """Print nanoseconds for a contact and ratios to the linear spring."""
    rng = np.random.default_rng(1)
    count = Given().contacts
    sigma = 1.0 + 0.4 * rng.random(count)
    distance = sigma * (1.0 - 0.7 * rng.random(count))
    linear = cpu(total, pm.LinearSpring(2.0), distance, sigma)
    laws = (
        pm.LinearSpring(2.0), pm.Harmonic(), pm.Hertz(), pm.RepulsiveLennardJones(), pm.DivergentRepulsion(2.0),
        pm.DivergentRepulsion(2.0, 0.5), pm.PlateauRepulsion(law=pm.LinearSpring(2.0)),
        pm.PlateauRepulsion(law=pm.DivergentRepulsion(2.0)), pm.ExponentialTension(2.0),
    )  # fmt: skip
    for law in laws:
        spent = cpu(total, law, distance, sigma)
        print(f"{law!r:110.110} {1e9 * spent / count:6.2f} ns  {spent / linear:5.2f} of the linear spring")
    spent, hand = cpu(total, pm.DivergentRepulsion(2.0), distance, sigma), cpu(by_hand, 2.0, 1000.0, distance, sigma)
    print(f"divergent law over the same formula in the loop: {spent / hand:.2f}")


if __name__ == "__main__":
    main()
