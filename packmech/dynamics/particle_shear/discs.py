"""The complete state of a run: discs, their contacts with both histories, strain and time."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech import check
from packmech.dynamics.particle_shear.pairs import BOND, SLIP, STICK

# the package's words for the kinds of contacts, and ours for `permanent`
KINDS = {"stick": STICK, "slip": SLIP, "bond": BOND}
FIRST_ANGLE = -math.pi / 2.0


@dataclasses.dataclass(frozen=True, eq=False)
class Discs:
    """Discs in a rectangular cell, with everything that the next step depends on.

    Lengths are in um, times in s, masses in mg per metre of depth; forces are then in 1e-12 N/m and torques in 1e-18 N.

    Parameters
    ----------
    position_nd, velocity_nd
        (N, 2) centers [um], inside the cell, and velocities [um/s]. No velocities are zeros.
    radius_n, mass_n
        (N,) radii [um] and masses [mg/m].
    spin_n, angle_n
        (N,) angular velocities [1/s] and angles [rad], counterclockwise. Left out they are zeros and -pi/2.
    contact_ck
        (C, 2) the pairs in contact or bonded, each once with the lower number first; in any order.
    kind_c
        (C,) "stick", "slip" or "bond" for each.
    history_ck
        (C, 2) tangential histories [um] as the lower- and the higher-numbered disc has them. Left out, zeros.
    width, height
        Sides of the cell [um].
    strain, strain_rate, time
        Shear strain of the cell [1], its rate [1/s], and the time [s].
    carried_nd
        (N, 2) forces left over from earlier steps, on discs held by the plates alone [1e-12 N/m].

    Examples
    --------
    >>> pair = Discs([[200.0, 250.0], [310.0, 250.0]], [60.0, 60.0], [1.0, 1.0])
    >>> pair.discs, pair.inertia_n
    (2, array([1800., 1800.]))

    """

    position_nd: NDArray[np.float64]
    radius_n: NDArray[np.float64]
    mass_n: NDArray[np.float64]
    velocity_nd: NDArray[np.float64] = None  # type: ignore[assignment]
    spin_n: NDArray[np.float64] = None  # type: ignore[assignment]
    angle_n: NDArray[np.float64] = None  # type: ignore[assignment]
    contact_ck: NDArray[np.int64] = None  # type: ignore[assignment]
    kind_c: NDArray[np.str_] = None  # type: ignore[assignment]
    history_ck: NDArray[np.float64] = None  # type: ignore[assignment]
    width: float = 500.0
    height: float = 500.0
    strain: float = 0.0
    strain_rate: float = 0.0
    time: float = 0.0
    carried_nd: NDArray[np.float64] = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        position_nd = check.finite_array("position_nd", self.position_nd, shape=(None, 2))
        count = len(position_nd)
        made: dict[str, NDArray[Any]] = {
            "position_nd": position_nd,
            "radius_n": check.positive_array("radius_n", self.radius_n, shape=(count,)),
            "mass_n": check.positive_array("mass_n", self.mass_n, shape=(count,)),
        }
        for name, shape, fill in (
            ("velocity_nd", (count, 2), 0.0),
            ("carried_nd", (count, 2), 0.0),
            ("spin_n", (count,), 0.0),
            ("angle_n", (count,), FIRST_ANGLE),
        ):
            given = getattr(self, name)
            made[name] = np.full(shape, fill) if given is None else check.finite_array(name, given, shape=shape)
        for name in ("width", "height"):
            object.__setattr__(self, name, check.positive(name, getattr(self, name)))
        for name in ("strain", "strain_rate", "time"):
            object.__setattr__(self, name, check.real(name, getattr(self, name)))
        outside = ((position_nd < 0.0) | (position_nd > (self.width, self.height))).any(axis=1)
        if outside.any():
            where = int(np.argmax(outside))
            raise ValueError(
                f"position_nd must be inside the cell of {self.width:g} by {self.height:g}, "
                f"got {position_nd[where].tolist()} for particle {where}"
            )
        made |= _contacts(self.contact_ck, self.kind_c, self.history_ck, count)
        for name, array in made.items():
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @property
    def discs(self) -> int:
        """Number of discs."""
        return len(self.radius_n)

    @property
    def inertia_n(self) -> NDArray[np.float64]:
        """(N,) moments of inertia m r^2/2 of discs [mg um^2/m]."""
        return self.mass_n * self.radius_n**2 / 2.0

    @property
    def bonded_c(self) -> NDArray[np.bool_]:
        """(C,) whether each contact is a permanent bond. Its rest length is always the sum of the radii."""
        return np.asarray(self.kind_c == "bond")

    def replace(self, **changes: object) -> Discs:
        """Return the same state with some fields exchanged."""
        return dataclasses.replace(self, **changes)  # type: ignore[arg-type]


def _contacts(
    contact_ck: ArrayLike | None, kind_c: ArrayLike | None, history_ck: ArrayLike | None, count: int
) -> dict[str, NDArray[Any]]:
    """Return the contacts sorted by pair, after checking them."""
    pairs = np.asarray([] if contact_ck is None else contact_ck)
    if pairs.size == 0:
        pairs = np.zeros((0, 2), dtype=np.int64)
    if pairs.ndim != 2 or pairs.shape[1] != 2 or pairs.dtype.kind not in "iu":
        raise ValueError(f"contact_ck must be an integer array of shape (any, 2), got shape {pairs.shape}")
    for c, (i, j) in enumerate(pairs.tolist()):
        if not 0 <= i < j < count:
            raise ValueError(
                f"contact_ck must hold pairs of discs, the lower number first, below {count}, "
                f"got {(i, j)} for contact {c}"
            )
    kinds = np.array([] if kind_c is None else kind_c, dtype="U5")
    if kinds.shape != (len(pairs),):
        raise ValueError(f"kind_c must have shape ({len(pairs)},), got {kinds.shape}")
    for c, kind in enumerate(kinds.tolist()):
        check.one_of(f"kind_c[{c}]", kind, KINDS)
    histories = (
        np.zeros((len(pairs), 2))
        if history_ck is None
        else check.finite_array("history_ck", history_ck, shape=(len(pairs), 2), what="contact", empty=True)
    )
    order = np.lexsort((pairs[:, 1], pairs[:, 0]))
    pairs = np.array(pairs[order], dtype=np.int64)
    twice = (np.diff(pairs, axis=0) == 0).all(axis=1)
    if twice.any():
        raise ValueError(f"contact_ck must hold every pair once, got {tuple(pairs[int(np.argmax(twice))])} twice")
    return {"contact_ck": pairs, "kind_c": kinds[order], "history_ck": histories[order]}
