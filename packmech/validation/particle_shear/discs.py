"""The complete state of a run of the reference model: discs, near pairs, contacts with both histories, strain, time."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech import check
from packmech.jit.compiled import device, kernel

# mypy: disable-error-code="no-untyped-def, no-untyped-call"


OPEN, STICK, SLIP, BOND = 0, 1, 2, 3


class Pairs(NamedTuple):
    """Near pairs i < j in order, their kinds, and what a contact needs at hand.

    That is, in a row of 9: the two histories, 1/(r_i + r_j), and where i last saw j: n_x, n_y, the number of the copy,
    the distance and its inverse, and 1 if the contact crosses the cell's boundary.
    """

    i_p: NDArray[np.int64]
    j_p: NDArray[np.int64]
    kind_p: NDArray[np.int64]
    state_p9: NDArray[np.float64]


@device
def image(dx, dy, width, height, strain):
    """Return the difference as the package images it, y first and then x, and how many heights and widths it took.

    In a strongly sheared cell this is not always the nearest image; it is for all distances below half the height.
    """
    up, along = 0, 0
    if abs(dy) >= height / 2.0:
        up = math.floor(dy / height + 0.5)
        dy -= up * height
        dx -= up * height * strain
    if abs(dx) >= width / 2.0:
        along = math.floor(dx / width + 0.5)
        dx -= along * width
    return dx, dy, up, along


@device
def _find_near(x_n, y_n, radius_n, i, width, height, strain, margin, near_n):
    """Flag the discs after the i-th that are near it; without branches, so that it is done for several at a time."""
    shift = height * strain - math.floor(height * strain / width) * width
    for j in range(i + 1, x_n.shape[0]):
        dx, dy = x_n[j] - x_n[i], y_n[j] - y_n[i]
        up = (1.0 if dy >= height / 2.0 else 0.0) - (1.0 if dy < -height / 2.0 else 0.0)
        dy -= up * height
        dx -= up * shift
        for _ in range(2):
            dx -= (width if dx >= width / 2.0 else 0.0) - (width if dx < -width / 2.0 else 0.0)
        reach = radius_n[i] + radius_n[j] + margin
        near_n[j] = dx * dx + dy * dy < reach * reach


@kernel
def list_pairs(position_nd, radius_n, width, height, strain, margin, old):
    """Return the pairs nearer than touching plus the margin.

    Pairs of the old list that are in contact or bonded stay, wherever they are, with their state.
    """
    count, listed = radius_n.shape[0], old.i_p.shape[0]
    x_n, y_n = position_nd[:, 0].copy(), position_nd[:, 1].copy()
    near_n = np.zeros(count, np.bool_)
    ij_p3 = np.empty((8 * count + listed, 3), np.int64)
    found, seen = 0, 0
    for i in range(count):
        _find_near(x_n, y_n, radius_n, i, width, height, strain, margin, near_n)
        first = seen
        while seen < listed and old.i_p[seen] == i:
            if old.kind_p[seen] != OPEN:
                near_n[old.j_p[seen]] = True
            seen += 1
        if found + count > ij_p3.shape[0]:
            ij_p3 = np.concatenate((ij_p3, np.empty_like(ij_p3)))
        for j in range(i + 1, count):
            if near_n[j]:
                while first < seen and old.j_p[first] < j:
                    first += 1
                kept = first < seen and old.j_p[first] == j and old.kind_p[first] != OPEN
                ij_p3[found, 0], ij_p3[found, 1], ij_p3[found, 2] = i, j, first if kept else -1
                found += 1
    i_p, j_p, from_p = ij_p3[:found, 0].copy(), ij_p3[:found, 1].copy(), ij_p3[:found, 2].copy()
    kind_p, state_p9 = np.zeros(found, np.int64), np.zeros((found, 9))
    for p in range(found):
        state_p9[p, 2] = 1.0 / (radius_n[i_p[p]] + radius_n[j_p[p]])
        if from_p[p] >= 0:
            kind_p[p] = old.kind_p[from_p[p]]
            state_p9[p, 0] = old.state_p9[from_p[p], 0]
            state_p9[p, 1] = old.state_p9[from_p[p], 1]
    return Pairs(i_p, j_p, kind_p, state_p9)


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
