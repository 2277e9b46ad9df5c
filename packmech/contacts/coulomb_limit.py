"""Which contacts stand at the Coulomb limit: as well as forces are known, by a gap in their distances to it.

Forces of a packing whose net forces are a part `residual` of the mean contact force are known to about that part, and
so is how far a tangential force is from its limit. What slid on the last stretch to rest stands off the limit by the
residual or some ten times it, what did not by many orders more: the bound lies in the widest gap between.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

# part of the limit by which rounding alone keeps a force off it [1]
ROUNDING = 1e-9
# residual up to which a packing is at rest; what moves slides at the limit, to rounding [1]
_AT_REST = 1e-3
# ratio of a distance to the bound within which it is doubtful on which side of it a contact stands
_DOUBTFUL = 10.0


class CoulombLimit(NamedTuple):
    """Contacts at the Coulomb limit.

    Attributes
    ----------
    at_limit_c
        (C,) which are.
    doubtful_c
        (C,) those within ten times the bound of it, on either side: no gap of the distances parts them from the
        others. So are contacts that bear so little that the whole limit is as small as that.
    bound
        Largest distance to the limit, over the mean normal force, of a contact that counts as at it [1].

    """

    at_limit_c: NDArray[np.bool_]
    doubtful_c: NDArray[np.bool_]
    bound: float


def find_at_limit(
    tangential_c: NDArray[np.float64],
    normal_c: NDArray[np.float64],
    coefficient: float | NDArray[np.float64],
    residual: float,
) -> CoulombLimit:
    """Return which contacts are at the Coulomb limit.

    Distances to it, (coefficient |normal force| - |tangential force|) over the mean normal force, are sorted, and the
    bound is put in the middle, on a logarithmic scale, of the widest gap that begins between the residual and its root.
    Where nothing is at rest only rounding is allowed for.

    Parameters
    ----------
    tangential_c, normal_c
        (C,) sizes of tangential forces and normal forces [force].
    coefficient
        Coulomb's coefficient, or those of the (C,) contacts [1].
    residual
        Largest net force over the mean normal force [1].

    """
    normal = np.abs(normal_c)
    cap = coefficient * normal
    # without friction nothing is at its limit
    exact = (cap > 0.0) & (tangential_c >= (1.0 - ROUNDING) * cap)
    mean = float(normal.mean()) if len(normal) else 0.0
    if not mean > 0.0 or not residual <= _AT_REST:
        return CoulombLimit(exact, np.zeros(len(normal), dtype=bool), 0.0)
    distance = np.where(cap > 0.0, (cap - tangential_c) / mean, np.inf)
    lowest = max(residual, ROUNDING)
    highest = float(np.sqrt(lowest))
    # the gap may reach beyond the root, to the first contact that is clearly held
    beyond = float(np.min(distance, where=distance >= highest, initial=1.0))
    steps = np.concatenate([[lowest], np.sort(distance[(distance > lowest) & (distance < highest)]), [beyond]])
    widest = int(np.argmax(steps[1:] / steps[:-1]))
    bound = float(np.sqrt(steps[widest] * steps[widest + 1]))
    # what bears next to nothing is near its limit wherever it stands below
    idle = (cap > 0.0) & (cap < _DOUBTFUL * bound * mean) & ~exact
    doubtful = idle | (distance > bound / _DOUBTFUL) & (distance < bound * _DOUBTFUL)
    return CoulombLimit(exact | (distance <= bound) & ~idle, doubtful, bound)
