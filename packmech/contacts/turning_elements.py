"""Resistance to rolling and twisting of discs and spheres as elements.

With the rotations p of i and q of j, the direction n from center to center and the arm A = r_i r_j rho / (r_i + r_j)^2,
rolling and twisting displacements grow by A (q - p) x n and A (q - p).n. The force F across n and the number f along it
that their springs bear turn i by the moment M = A (n x F + f n), and j by the opposite, and push neither. As the spring
of rolling turns with the contact like that of friction (`packmech.contacts.tangential_elements`),

    dM = A (dn x F + A k w_across - F n.(p + q)/2 + f dn + A k_t n (n.w)) + (n x F + f n) dA,    w = q - p

in a plane dM = A A k w + (n x F) dA. A spring at its limit that slips resists across F alone, which in a plane and of
twisting is nowhere, and its force follows the limit: with a = F/|F| and the limit mu N of rolling

    dM = ... - A A k (n x a) (n x a).w + A (n x a) mu dN,

and the same of twisting with its own limit along n.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.check import Kind
from packmech.contacts.bead_contact import turned_arms
from packmech.contacts.elements import Elements, PairGeometry, check_centers


class TurningLimits(NamedTuple):
    """Which springs against rolling and twisting slip, (2, C), and (2, C) slopes of their limits by the distance.

    The slope of a limit mu N, N the size of the normal force, is in [force/length].
    """

    slips_sc: NDArray[np.bool_]
    slope_sc: NDArray[np.float64]


def turning_elements(
    pairs: PairGeometry,
    radius_n: NDArray[np.float64],
    rolling_cd: NDArray[np.float64],
    twisting_c: NDArray[np.float64],
    stiffness: tuple[float | NDArray[np.float64], float | NDArray[np.float64]],
    kind: Kind = "exact",
    limits: TurningLimits | None = None,
) -> tuple[Elements, NDArray[np.float64]]:
    """Return what resists rolling and twisting at contacts as elements, and derivatives of what passes their limits.

    The (2, C, X) derivatives, X = d + 2 t, are those of the forces of springs that stick, along these forces, less
    those of the limits: of rolling, then of twisting.

    Parameters
    ----------
    pairs
        The pairs, of discs or spheres.
    radius_n
        (N,) radii of the particles [length].
    rolling_cd, twisting_c
        (C, d) forces F and (C,) forces f of their springs, as of `TurningForces` [force].
    stiffness
        Of the springs against rolling and twisting, numbers or (C,); with rates in place of displacements dashpots
        [force/length].
    kind
        "exact", or "unstressed": what forces add where contacts turn is left out.
    limits
        None: all springs stick.

    Raises
    ------
    ValueError
        If centers coincide.

    """
    check_centers(pairs, np.ones(len(twisting_c)))
    d, n = pairs.dimension, pairs.normal_cd
    t = 1 if d == 2 else 3
    of_v, of_i, of_j = slice(0, d), slice(d, d + t), slice(d + t, d + 2 * t)
    one, other = radius_n[pairs.i_c], radius_n[pairs.j_c]
    share = one * other / (one + other) ** 2
    arm = share * np.sqrt((pairs.vector_cd**2).sum(axis=1))
    across = np.eye(d) - n[:, :, None] * n[:, None]
    rolling, twisting = (np.broadcast_to(one, len(n)) for one in stiffness)
    slopes = np.zeros((len(n), d + 2 * t))
    change = np.zeros((len(n), t, d + 2 * t))
    # directions of the moments of both springs
    ahead = np.zeros((2, len(n), t))
    if d == 2:
        moment = rolled = (n[:, 0] * rolling_cd[:, 1] - n[:, 1] * rolling_cd[:, 0])[:, None]
        spring = rolling[:, None, None]
    else:
        rolled = np.cross(n, rolling_cd)
        moment = rolled + twisting_c[:, None] * n
        spring = rolling[:, None, None] * across + twisting[:, None, None] * n[:, :, None] * n[:, None]
        ahead[1] = np.sign(twisting_c)[:, None] * n
    size = np.sqrt((rolled**2).sum(axis=1))
    ahead[0] = rolled / np.where(size > 0.0, size, 1.0)[:, None]
    beyond = np.zeros((2, len(n), d + 2 * t))
    beyond[:, :, of_j] = np.stack([rolling, twisting])[:, :, None] * arm[:, None] * ahead
    beyond[:, :, of_i] = -beyond[:, :, of_j]
    if limits is not None:
        loaded = np.where(limits.slips_sc[:, :, None], ahead, 0.0)
        spring = spring - np.einsum("sc,sca,scb->cab", np.stack([rolling, twisting]), loaded, loaded)
        change[:, :, of_v] += np.einsum("c,sca,sc,cb->cab", arm, loaded, limits.slope_sc, n)
        beyond[:, :, of_v] = -limits.slope_sc[:, :, None] * n
    # the stiffness against w = q - p
    change[:, :, of_j] = (arm * arm)[:, None, None] * spring
    change[:, :, of_i] = -change[:, :, of_j]
    if kind != "unstressed":
        change[:, :, of_v] += share[:, None, None] * moment[:, :, None] * n[:, None]
        if d == 3:
            # arm times dn is share times the part of dv across n
            turned = twisting_c[:, None, None] * np.eye(3) + turned_arms(rolling_cd)
            change[:, :, of_v] += share[:, None, None] * (turned @ across)
            about = -0.5 * arm[:, None, None] * rolling_cd[:, :, None] * n[:, None]
            change[:, :, of_i] += about
            change[:, :, of_j] += about
        slopes[:, of_i], slopes[:, of_j] = -arm[:, None] * moment, arm[:, None] * moment
    whole = np.zeros((len(n), d + 2 * t, d + 2 * t))
    whole[:, of_i], whole[:, of_j] = -change, change
    return Elements(pairs.i_c, pairs.j_c, pairs.vector_cd, slopes, whole, symmetric=False), beyond
