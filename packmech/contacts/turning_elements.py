"""Resistance to rolling and twisting of discs and spheres as elements.

With the rotations p of i and q of j, the direction n from center to center and the arm A = r_i r_j rho / (r_i + r_j)^2,
rolling and twisting displacements grow by A (q - p) x n and A (q - p).n. The force F across n and the number f along it
that their springs bear turn i by the moment M = A (n x F + f n), and j by the opposite, and push neither. As the spring
of rolling turns with the contact like that of friction (`packmech.contacts.tangential_elements`),

    dM = A (dn x F + A k w_across - F n.(p + q)/2 + f dn + A k_t n (n.w)) + (n x F + f n) dA,    w = q - p

in a plane dM = A A k w + (n x F) dA. Springs at their limit count as sticking: so they do in every motion that unloads
them.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from packmech.check import Kind
from packmech.contacts.bead_contact import turned_arms
from packmech.contacts.elements import Elements, PairGeometry, check_centers


def turning_elements(
    pairs: PairGeometry,
    radius_n: NDArray[np.float64],
    rolling_cd: NDArray[np.float64],
    twisting_c: NDArray[np.float64],
    stiffness: tuple[float | NDArray[np.float64], float | NDArray[np.float64]],
    kind: Kind = "exact",
) -> Elements:
    """Return what resists rolling and twisting at contacts as elements.

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
    if d == 2:
        moment = (n[:, 0] * rolling_cd[:, 1] - n[:, 1] * rolling_cd[:, 0])[:, None]
        spring = rolling[:, None, None]
    else:
        moment = np.cross(n, rolling_cd) + twisting_c[:, None] * n
        spring = rolling[:, None, None] * across + twisting[:, None, None] * n[:, :, None] * n[:, None]
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
    return Elements(pairs.i_c, pairs.j_c, pairs.vector_cd, slopes, whole, symmetric=False)
