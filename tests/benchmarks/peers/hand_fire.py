# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""FIRE's step for harmonic discs in a loop written by hand: nothing chosen by type, over packmech's list of pairs."""

from __future__ import annotations

import math

import numpy as np
from bench_fire import ALPHA, DT

from packmech.jit.compiled import kernel
from packmech.minimize.passes.pair_list import listed_pairs


@kernel
def fire_steps(x, v, f, radius_n, i_p, j_p, shift_pd, steps):
    """Harmonic discs by hand, nothing chosen by type: forces, sums, and the mixed step."""
    speed2 = 0.0
    most = 0.0
    for _ in range(steps):
        total = 0.0
        touching = 0
        for p in range(i_p.shape[0]):
            i = i_p[p]
            j = j_p[p]
            dx = x[j, 0] - x[i, 0] + shift_pd[p, 0]
            dy = x[j, 1] - x[i, 1] + shift_pd[p, 1]
            square = dx * dx + dy * dy
            sigma = radius_n[i] + radius_n[j]
            if square < sigma * sigma:
                r = math.sqrt(square)
                inverse = 1.0 / sigma
                push = inverse * inverse * (sigma - r)
                total += push
                touching += 1
                push /= r
                f[i, 0] -= push * dx
                f[i, 1] -= push * dy
                f[j, 0] += push * dx
                f[j, 1] += push * dy
        power = 0.0
        square_force = 0.0
        most = 0.0
        for i in range(x.shape[0]):
            own = f[i, 0] * f[i, 0] + f[i, 1] * f[i, 1]
            power += f[i, 0] * v[i, 0] + f[i, 1] * v[i, 1]
            square_force += own
            most = max(most, own)
        keep = 0.0
        push = DT
        if power > 0.0:
            keep = 1.0 - ALPHA
            push += ALPHA * math.sqrt(speed2 / square_force)
        speed2 = 0.0
        fastest = 0.0
        for i in range(x.shape[0]):
            vx = keep * v[i, 0] + push * f[i, 0]
            vy = keep * v[i, 1] + push * f[i, 1]
            v[i, 0] = vx
            v[i, 1] = vy
            x[i, 0] += DT * vx
            x[i, 1] += DT * vy
            f[i, 0] = 0.0
            f[i, 1] = 0.0
            own = vx * vx + vy * vy
            speed2 += own
            fastest = max(fastest, own)
    return most


def arguments(program, steps):
    """Return what `fire_steps` takes, from a program whose list of pairs is good for its places."""
    i_p, j_p, image = listed_pairs(program.pairs)
    shift = image[:, :2] @ program.space.frame.lattice_dd[:2, :2].T
    order = np.lexsort((j_p, i_p))
    x, radius = program.row[:, :2].copy(), program.row[:, 3].copy()
    return x, np.zeros_like(x), np.zeros_like(x), radius, i_p[order], j_p[order], shift[order], steps
