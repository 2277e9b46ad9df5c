"""The calibration pair loop: how fast this machine is, in CPU ns a contact (8 on the machine of the stated figures).

A plain compiled loop over the Verlet list (skin 0.25) of a packed 2D configuration: distance, harmonic force and
energy, two scattered additions; its time is divided by the number of touching pairs. Every benchmark prints it next to
its own figures, so that they can be compared between machines.
"""

from __future__ import annotations

import math
import statistics
import time
from collections.abc import Callable
from typing import Any

import numpy as np

import packmech as pm
from packmech.contacts import candidate_pairs
from packmech.jit.compiled import kernel

REFERENCE_NS = 8.0


@kernel
def _pair_loop(row, i_c, j_c, shift_cd, repeats):  # type: ignore[no-untyped-def]
    energy = 0.0
    for _ in range(repeats):
        for c in range(i_c.shape[0]):
            i = i_c[c]
            j = j_c[c]
            dx = row[j, 0] - row[i, 0] + shift_cd[c, 0]
            dy = row[j, 1] - row[i, 1] + shift_cd[c, 1]
            square = dx * dx + dy * dy
            sigma = row[i, 2] + row[j, 2]
            if square < sigma * sigma:
                r = math.sqrt(square)
                overlap = 1.0 - r / sigma
                energy += 0.5 * overlap * overlap
                push = overlap / (sigma * r)
                row[i, 3] -= push * dx
                row[i, 4] -= push * dy
                row[j, 3] += push * dx
                row[j, 4] += push * dy
    return energy


def cpu_seconds(function: Callable[[], Any], *, repeats: int = 7) -> float:
    """Return the median CPU seconds of one call; call it once before, so that nothing compiles in between."""
    taken = []
    for _ in range(repeats):
        started = time.process_time()
        function()
        taken.append(time.process_time() - started)
    return statistics.median(taken)


def calibrate(particles: int = 4096) -> float:
    """Return the CPU nanoseconds that one contact takes in the calibration loop; print them with their ratio to 8."""
    packing = pm.random_packing(particles, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.88, seed=1)
    order = np.lexsort((packing.position_nd[:, 1], np.floor(packing.position_nd[:, 0] / 2.0)))
    packing = packing.replace(position_nd=packing.position_nd[order], radius_n=packing.radius_n[order])
    pairs = candidate_pairs(packing.position_nd, packing.radius_n, packing.box, skin=0.25)
    contacts = len(pm.find_contacts(packing, gap_tolerance=0.0))
    row = np.zeros((particles, 8))
    row[:, :2], row[:, 2] = packing.position_nd, packing.radius_n
    shift = pairs.image_cd @ packing.box.lattice_dd.T
    arrays = (row, pairs.i_c.astype(np.uint32), pairs.j_c.astype(np.uint32), shift)
    _pair_loop(*arrays, 1)
    repeats = 100
    took = cpu_seconds(lambda: _pair_loop(*arrays, repeats)) / repeats / contacts * 1e9
    print(f"calibration pair loop: {took:.2f} ns a contact, {took / REFERENCE_NS:.2f} x the reference machine")
    return took


if __name__ == "__main__":
    calibrate()
