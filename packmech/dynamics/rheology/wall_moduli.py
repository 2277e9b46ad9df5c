"""What walls feel of an oscillatory shear, and how far that is from the stress of what is between them.

A rheometer measures the force on its plates. Where the sample's inertia counts, that force is not the mean stress of
the sample any more: particleShear's documentation (section 7.3) aims at differences below 30 %.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.dynamics.march.flow import gamma_at
from packmech.dynamics.pair_forces import PairForces, pair_forces
from packmech.dynamics.rheology.plates import height_across
from packmech.effects import Walls
from packmech.measure import Demodulation

if TYPE_CHECKING:
    from packmech.dynamics.march.state import March
    from packmech.dynamics.rheology.manner import Manner

# differences of the moduli that are flagged
LARGEST_DIFFERENCE = 0.3
# columns of a row: forces per area that the lower and the upper plate bear, and stress of what is between
_LOW, _HIGH, _BETWEEN, _COLUMNS = 0, 1, 2, 3


@dataclass(frozen=True, eq=False)
class WallModuli:
    """G' and G'' from the force on walls, and from the stress of what is between them.

    Attributes
    ----------
    force, volume
        Moduli of the force on the walls over their area (the mean of both), and of the mean stress of the volume
        between: force times branch vector of all contacts and bonds but those within and between plates; where one end
        is a plate's particle the branch vector ends at the plate's height. Without inertia and drag they are the same.
    low_stress_t, high_stress_t, volume_stress_t
        (T,) what they are moduli of, for each wall by itself [energy/length^d]. Smooth walls bear no shear stress.
    separation
        Distance between the walls; the height of a plate is the mean of those of its particles that touch free ones or
        are bonded to them at the start [length].

    """

    force: Demodulation
    volume: Demodulation
    low_stress_t: NDArray[np.float64]
    high_stress_t: NDArray[np.float64]
    volume_stress_t: NDArray[np.float64]
    separation: float

    @property
    def difference(self) -> float:
        """Size of the difference of both G' + i G'' over that of the volume [1]; phases count too."""
        wall, volume = (complex(one.storage, one.loss) for one in (self.force, self.volume))
        return abs(wall - volume) / abs(volume) if volume else (math.inf if wall else 0.0)

    @property
    def agree(self) -> bool:
        """Whether they differ by at most 30 %; otherwise the frequency is too high for the sample's inertia."""
        return self.difference <= LARGEST_DIFFERENCE


class Reaching(NamedTuple):
    """Pairs of a free and a held particle.

    held_k is the held one; inside_k is the height of the free one in its cell, at_k that of the held one as seen from
    there; upper_k says whether that is in the upper half; force_k is the shear force on the free one.
    """

    held_k: NDArray[np.int64]
    inside_k: NDArray[np.float64]
    at_k: NDArray[np.float64]
    upper_k: NDArray[np.bool_]
    force_k: NDArray[np.float64]


class WallWatch:
    """Goes along with a strained run: keeps what the walls feel, and lets plates alone drive the sample if asked to."""

    def __init__(
        self, manner: Manner, axes: tuple[int, int], every: int, profile: Any, *, height: float, carried: bool
    ) -> None:
        self.manner, self.axes, self.every, self.profile = manner, axes, every, profile
        self.height, self.carried = height, carried
        particles = manner.scene.packing.particles
        self.held_n = np.zeros(particles, dtype=bool) if manner.held_n is None else manner.held_n
        self.area = manner.scene.packing.box.volume / height
        self.low = self.high = math.nan
        self.rows: list[NDArray[np.float64]] = []

    @property
    def separation(self) -> float:
        """Distance between the walls."""
        return self.high - self.low

    def begin(self, march: March) -> None:
        """Look at the start."""
        self.low, self.high = self._ends(self._reaching(march, pair_forces(march)))
        self._keep(march)

    def before(self, march: March, steps: int) -> int:
        """Return how many of so many steps may be taken before `after`; prepare them."""
        due = min(steps, self.every - march.steps % self.every)
        if self.carried:
            return due
        self._hold_back(march)
        return 1

    def after(self, march: March) -> None:
        """Take note of the steps that were taken."""
        if march.steps % self.every == 0:
            self._keep(march)

    def leaves(self) -> dict[str, NDArray[np.float64]]:
        """Return what a checkpoint must keep."""
        return {"wall_rows": np.array(self.rows), "wall_ends": np.array([self.low, self.high])}

    def restore(self, kept: Any) -> None:
        """Go on from what a checkpoint kept."""
        self.rows = list(kept["wall_rows"])
        self.low, self.high = kept["wall_ends"].tolist()

    def _hold_back(self, march: March) -> None:
        # In the loops what the box carries along is pushed so that it follows (SLLOD). Without that push velocities
        # against the box change by minus what the flow gains; it is given at once, and half of its way taken back, so
        # that places and velocities at the end of the step are those of a push throughout (of second order)
        a, b = self.axes
        dt = march.dt
        gained = gamma_at(self.profile, march.time + dt)[1] - gamma_at(self.profile, march.time)[1]
        body, free = march.state.body, march.state.weight_nk[:, 0] > 0.0
        change = -gained * (body[free, b] - 0.5 * (self.low + self.high))
        body[free, 4 + a] += change
        body[free, a] -= 0.5 * dt * change

    def _reaching(self, march: March, pairs: PairForces) -> Reaching:
        """Return the pairs of free and held particles."""
        held_i, held_j = self.held_n[pairs.i_k], self.held_n[pairs.j_k]
        cross = held_i != held_j
        pairs, held_i = PairForces(*(column[cross] for column in pairs)), held_i[cross]
        # the free one is inside the cell, the held one where the branch vector leads
        free = np.where(held_i, pairs.j_k, pairs.i_k)
        sign = np.where(held_i, -1.0, 1.0)
        inside = np.mod(march.positions()[free, self.axes[1]], self.height)
        at = inside + sign * pairs.branch_kd[:, self.axes[1]]
        held = np.where(held_i, pairs.i_k, pairs.j_k)
        return Reaching(held, inside, at, at > 0.5 * self.height, sign * pairs.force_kd[:, self.axes[0]])

    def _ends(self, reaching: Reaching) -> tuple[float, float]:
        """Return the heights of both walls."""
        walls = _smooth(self.manner, self.axes[1])
        if not self.held_n.any() and walls is not None:
            return walls.low, walls.high
        ends = list(_faces(self.manner, self.axes[1], self.height))
        for upper in (0, 1):
            chosen = reaching.upper_k == bool(upper)
            _, first = np.unique(reaching.held_k[chosen], return_index=True)
            if len(first):
                ends[upper] = float(reaching.at_k[chosen][first].mean())
        return ends[0], ends[1]

    def _keep(self, march: March) -> None:
        a, b = self.axes
        pairs = pair_forces(march)
        reaching = self._reaching(march, pairs)
        free = ~(self.held_n[pairs.i_k] | self.held_n[pairs.j_k])
        between = (pairs.force_kd[free, a] * pairs.branch_kd[free, b]).sum()
        # what a plate's particles bear is handed on inside the plate, up to its mean height
        plane = np.where(reaching.upper_k, self.high, self.low)
        between += (reaching.force_k * (plane - reaching.inside_k)).sum()
        # a stress pulls the sample along at its upper end, and against it at its lower one
        upper = reaching.upper_k
        row = np.zeros(_COLUMNS)
        row[_LOW] = -reaching.force_k[~upper].sum() / self.area
        row[_HIGH] = reaching.force_k[upper].sum() / self.area
        row[_BETWEEN] = between / (self.area * self.separation)
        self.rows.append(row)

    def moduli(self, run: Any) -> WallModuli:
        """Return the moduli of a run that got far enough."""
        rows = np.array(self.rows)[: len(run.time_t)]
        return WallModuli(
            run.demodulated_of(0.5 * (rows[:, _LOW] + rows[:, _HIGH])),
            run.demodulated_of(rows[:, _BETWEEN]),
            rows[:, _LOW].copy(),
            rows[:, _HIGH].copy(),
            rows[:, _BETWEEN].copy(),
            self.separation,
        )


def _smooth(manner: Manner, axis: int) -> Walls | None:
    """Return the smooth walls across an axis."""
    return next((one for one in manner.scene.effects if isinstance(one, Walls) and int(one.axis) == axis), None)


def _faces(manner: Manner, axis: int, height: float) -> tuple[float, float]:
    assert manner.held_n is not None
    at = np.mod(manner.scene.packing.position_nd[manner.held_n, axis], height)
    low, high = at[at < 0.5 * height], at[at >= 0.5 * height]
    return (float(low.mean()) if len(low) else math.nan, float(high.mean()) if len(high) else math.nan)


def wall_watch(manner: Manner, axes: tuple[int, int], every: int, profile: Any, *, carried: bool) -> WallWatch | None:
    """Return what keeps an eye on the walls of a scene across the gradient; None where it has none.

    Raises
    ------
    ValueError
        If the sample is not carried along and there are no plates.

    """
    height = height_across(manner.scene.packing.box, axes[1])
    plates = False
    if height is not None and manner.held_n is not None and manner.held_n.any() and not manner.held_n.all():
        low, high = _faces(manner, axes[1], height)
        # a particle that is held in the middle is no plate
        plates = high - low > 0.5 * height
    if not carried and not plates:
        raise ValueError("carried must be True where no plates drive the sample (held_n of rough_plates), got False")
    if height is None or not (plates or _smooth(manner, axes[1]) is not None):
        return None
    return WallWatch(manner, axes, every, profile, height=height, carried=carried)
