# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Who touches whom in a march, with which force, and where Coulomb's cap is reached; looking changes no bit."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.dynamics.march.flow import rates
from packmech.dynamics.march.inlined import lean
from packmech.dynamics.march.look import seen_pair, touch
from packmech.dynamics.march.memory import _listed as listed

if TYPE_CHECKING:
    from packmech.dynamics.march.state import March


class Touching(NamedTuple):
    """Pairs that touch, bonded ones not among them, sorted by (i, j, image).

    i_c, j_c are particles, image_cd (C, d) vectors of the scene's box, for positions as they are: the branch vector is
    x_j - x_i + lattice @ image. normal_c are elastic normal forces, force_cd (C, d) the whole forces on i, dashpots and
    friction included [force]; sliding_c marks those at Coulomb's cap.
    """

    i_c: NDArray[np.int64]
    j_c: NDArray[np.int64]
    image_cd: NDArray[np.int64]
    normal_c: NDArray[np.float64]
    force_cd: NDArray[np.float64]
    sliding_c: NDArray[np.bool_]


@lean
def _look_at_contacts(acting, axes, state, space, pace, i_p, j_p, image_pd, held_pk, seen_p, figure_pk):
    """Mark the pairs that touch; write normal force, sliding and force on i of each."""
    flowing = rates(space.flow)
    body, lattice = state.body, space.frame.lattice_dd
    for p in range(i_p.shape[0]):
        i, j = i_p[p], j_p[p]
        x, y, z = image_pd[p, 0], image_pd[p, 1], image_pd[p, 2]
        dx = body[j, 0] - body[i, 0] + (lattice[0, 0] * x + lattice[0, 1] * y + lattice[0, 2] * z)
        dy = body[j, 1] - body[i, 1] + (lattice[1, 0] * x + lattice[1, 1] * y + lattice[1, 2] * z)
        dz = body[j, 2] - body[i, 2] + (lattice[2, 0] * x + lattice[2, 1] * y + lattice[2, 2] * z)
        seen_p[p] = touch(body, i, j, dx, dy, dz)
        if not seen_p[p]:
            continue
        _, _, sliding, normal, (gx, gy, gz), (fx, fy, fz), _, _ = seen_pair(
            acting.pairs, acting.friction, flowing, axes, body, held_pk, p, i, j, dx, dy, dz, pace
        )
        figure_pk[p, 0] = normal
        figure_pk[p, 1] = sliding
        # coincident centers have no direction
        away = 1.0 if dx * dx + dy * dy + dz * dz > 0.0 else 0.0
        figure_pk[p, 2] = away * (gx + fx)
        figure_pk[p, 3] = away * (gy + fy)
        figure_pk[p, 4] = away * (gz + fz)


def _keys(i_p: Any, j_p: Any, image_pd: Any) -> Iterator[tuple[Any, ...]]:
    return zip(i_p.tolist(), j_p.tolist(), map(tuple, image_pd.tolist()), strict=True)


def _held(march: March, i_p: Any, j_p: Any, image_pd: Any) -> NDArray[np.float64]:
    """Return the (P, 1 or 3) stretches of listed pairs, zero where there is none."""
    held = march.stretches()
    stretch = np.zeros((len(i_p), held.stretch_ck.shape[1]))
    if len(held.i_c):
        place = {key: p for p, key in enumerate(_keys(i_p, j_p, image_pd))}
        stretch[[place[key] for key in _keys(held.i_c, held.j_c, held.image_cd)]] = held.stretch_ck
    return stretch


def touching_of(march: March) -> Touching:
    """Return the contacts of a march at the present moment."""
    if not march.started:
        march.begin()
    d = len(march.axes)
    i, j, image = listed(march.pairs)
    seen, figure = np.zeros(len(i), dtype=np.bool_), np.zeros((len(i), 5))
    if len(i) and march.acting.pairs is not None:
        held = None if march.track is None else _held(march, i, j, image)
        _look_at_contacts(
            march.acting,
            march.axes,
            march.state,
            march.space,
            march.pace,
            i,
            j,
            image.astype(float),
            held,
            seen,
            figure,
        )
    i, j, image, figure = march.order_n[i[seen]], march.order_n[j[seen]], image[seen, :d], figure[seen]
    # from rows and images of the loops' lattice to particles, their places and the scene's box
    whole = image @ march.change_dd.T - march.home_nd[j] + march.home_nd[i]
    force = figure[:, 2 : 2 + d]
    # each pair once with i < j; of a particle and its own image the one whose first nonzero number is positive
    first = np.take_along_axis(whole, np.argmax(whole != 0, axis=1)[:, None], axis=1)[:, 0] if len(whole) else i
    flip = (i > j) | ((i == j) & (first < 0))
    i, j = np.where(flip, j, i), np.where(flip, i, j)
    whole, force = np.where(flip[:, None], -whole, whole), np.where(flip[:, None], -force, force)
    order = np.lexsort((*whole.T[::-1], j, i))
    return Touching(i[order], j[order], whole[order], figure[order, 0], force[order], figure[order, 1] > 0.0)
