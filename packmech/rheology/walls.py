"""Rough plates, what walls feel of an oscillatory shear, and how far that is from the stress between them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.calls.display import shown
from packmech.calls.honors import honors
from packmech.check import brief, instance, integer, positive
from packmech.dynamics.deformation import gamma_at
from packmech.dynamics.engine import Engine
from packmech.dynamics.pair_forces import PairForces, pair_forces
from packmech.effects import Walls
from packmech.loop.checkpoint import saved_array
from packmech.measure.signals import Demodulation
from packmech.packing import Packing
from packmech.result import Row
from packmech.rheology.arguments import StrainSettings


@honors("", packing_only=True)
def rough_plates(packing: Packing, *, layer: str | float = "crossing", axis: int = 1) -> NDArray[np.bool_]:
    """Return which particles rough plates at both ends of the cell would hold: (N,) for held_n of what strains a scene.

    The ends are the faces of the cell across `axis`. Held particles follow the box, so that the plates slide past each
    other as it is sheared; nothing pushes or turns them. Who is free stays free (particleShear goes on catching
    particles for ever).

    Parameters
    ----------
    packing
        The packing, without rigid links; all its lattice vectors but one must lie across the axis.
    layer
        "crossing": who reaches across an end, y < r or y > H - r. Or a thickness [length]: whose center is nearer than
        that to an end.
    axis
        Normal of the plates.

    Raises
    ------
    TypeError, ValueError
        If an argument is wrong, the box has no such ends, or there are no particles for both plates and between them.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.random_packing(60, dimension=2, packing_fraction=0.9, seed=1)
    >>> held = rough_plates(packing)
    >>> run = pm.simulate(pm.Scene(packing, (pm.Repulsion(),)), steps=3, held_n=held)
    >>> bool(np.array_equal(run.packing.position_nd[held], packing.position_nd[held]))
    True

    """
    instance("packing", packing, Packing)
    axis = integer("axis", axis, at_least=0, at_most=packing.dimension - 1)
    if isinstance(layer, str) and layer == "crossing":
        reach = packing.radius_n
    elif isinstance(layer, str):
        raise ValueError(f"layer must be 'crossing' or a thickness, got {brief(layer)}")
    else:
        reach = np.full(packing.particles, positive("layer", layer))
    height = packing.box.height_across(axis)
    if height is None:
        raise ValueError(f"packing must have a box whose vectors but one are across axis {axis}, got others")
    at = np.mod(packing.position_nd[:, axis], height)
    low, high = at < reach, at > height - reach
    if (low & high).any():
        raise ValueError(f"layer must leave room between the plates, got {brief(layer)} in a height of {height:g}")
    if not low.any() or not high.any() or (low | high).all():
        count = int(np.count_nonzero(low)), int(np.count_nonzero(high))
        raise ValueError(
            f"layer must hold particles at both ends and leave some free, got {brief(layer)} that holds {count[0]} and "
            f"{count[1]} of {packing.particles}"
        )
    return np.asarray(low | high)


# differences of the moduli that are flagged
LARGEST_DIFFERENCE = 0.3
# columns of a row: forces per area that the lower and the upper plate bear, and stress of what is between
_LOW, _HIGH, _BETWEEN, _COLUMNS = 0, 1, 2, 3


@shown()
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

    def to_dict(self) -> dict[str, Any]:
        """Return both moduli by name, as plain values."""
        return {
            "separation": self.separation,
            "difference": self.difference,
            "agree": self.agree,
            **{
                f"{name}_{part}": getattr(found, part)
                for name, found in (("force", self.force), ("volume", self.volume))
                for part in ("storage", "loss", "storage_error", "loss_error")
            },
        }

    def rows(self, held: int, unit: str) -> list[Row]:
        """Return both moduli in words, with how many particles were held and the unit of stresses."""
        found = [
            ("at the walls", self.force, f"force on the walls over their area; {unit}"),
            ("between them", self.volume, "stress of what is between them"),
        ]
        rows = [(name, f"{of.storage:.6g}  {of.loss:.6g}", f"G'  G'', {note}") for name, of, note in found]
        note = "MORE THAN 30 %: the sample's inertia counts, take a lower frequency"
        if self.agree:
            note = "within the 30 % that are let pass"
        apart = f"{held} particles held, " if held else ""
        return [*rows, ("walls differ", f"{self.difference:.1%}", f"{note}; {apart}{self.separation:.6g} apart")]


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


class WallForces:
    """Measures the forces on walls on the way of a strained run; lets plates alone drive the sample if asked to."""

    def __init__(
        self, settings: StrainSettings, axes: tuple[int, int], every: int, profile: Any, *, height: float, carried: bool
    ) -> None:
        self.settings, self.axes, self.every, self.profile = settings, axes, every, profile
        self.height, self.carried = height, carried
        particles = settings.scene.packing.particles
        self.held_n = np.zeros(particles, dtype=bool) if settings.held_n is None else settings.held_n
        self.area = settings.scene.packing.box.volume / height
        self.low = self.high = math.nan
        self.rows: list[NDArray[np.float64]] = []

    @property
    def separation(self) -> float:
        """Distance between the walls."""
        return self.high - self.low

    def begin(self, engine: Engine) -> None:
        """Find the ends of the walls at the start, and measure."""
        self.low, self.high = self._ends(self._reaching(engine, pair_forces(engine)))
        self._keep(engine)

    def before(self, engine: Engine, steps: int) -> int:
        """Return how many of so many steps may be taken before `after`; prepare them."""
        due = min(steps, self.every - engine.steps % self.every)
        if self.carried:
            return due
        self._hold_back(engine)
        return 1

    def after(self, engine: Engine) -> None:
        """Measure after the steps that were taken, where a row is due."""
        if engine.steps % self.every == 0:
            self._keep(engine)

    def arrays(self) -> dict[str, NDArray[np.float64]]:
        """Return what a checkpoint must keep."""
        return {"wall_rows": np.array(self.rows), "wall_ends": np.array([self.low, self.high])}

    def restore(self, kept: Any, steps: int) -> None:
        """Go on from what a checkpoint kept after so many steps."""
        self.rows = list(saved_array(kept, "wall_rows", (steps // self.every + 1, _COLUMNS)))
        self.low, self.high = saved_array(kept, "wall_ends", (2,)).tolist()

    def _hold_back(self, engine: Engine) -> None:
        # In the loops what the box carries along is pushed so that it follows (SLLOD). Without that push velocities
        # against the box change by minus what the flow gains; it is given at once, and half of its way taken back, so
        # that places and velocities at the end of the step are those of a push throughout (of second order)
        a, b = self.axes
        dt = engine.dt
        gained = gamma_at(self.profile, engine.time + dt)[1] - gamma_at(self.profile, engine.time)[1]
        body, free = engine.state.body, engine.state.weight_nk[:, 0] > 0.0
        change = -gained * (body[free, b] - 0.5 * (self.low + self.high))
        body[free, 4 + a] += change
        body[free, a] -= 0.5 * dt * change

    def _reaching(self, engine: Engine, pairs: PairForces) -> Reaching:
        """Return the pairs of free and held particles."""
        held_i, held_j = self.held_n[pairs.i_k], self.held_n[pairs.j_k]
        cross = held_i != held_j
        pairs, held_i = PairForces(*(column[cross] for column in pairs)), held_i[cross]
        # the free one is inside the cell, the held one where the branch vector leads
        free = np.where(held_i, pairs.j_k, pairs.i_k)
        sign = np.where(held_i, -1.0, 1.0)
        inside = np.mod(engine.positions()[free, self.axes[1]], self.height)
        at = inside + sign * pairs.branch_kd[:, self.axes[1]]
        held = np.where(held_i, pairs.i_k, pairs.j_k)
        return Reaching(held, inside, at, at > 0.5 * self.height, sign * pairs.force_kd[:, self.axes[0]])

    def _ends(self, reaching: Reaching) -> tuple[float, float]:
        """Return the heights of both walls."""
        walls = _smooth(self.settings, self.axes[1])
        if not self.held_n.any() and walls is not None:
            return walls.low, walls.high
        ends = list(_faces(self.settings, self.axes[1], self.height))
        for upper in (0, 1):
            chosen = reaching.upper_k == bool(upper)
            _, first = np.unique(reaching.held_k[chosen], return_index=True)
            if len(first):
                ends[upper] = float(reaching.at_k[chosen][first].mean())
        return ends[0], ends[1]

    def _keep(self, engine: Engine) -> None:
        a, b = self.axes
        pairs = pair_forces(engine)
        reaching = self._reaching(engine, pairs)
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


def _smooth(settings: StrainSettings, axis: int) -> Walls | None:
    """Return the smooth walls across an axis."""
    return next((one for one in settings.scene.effects if isinstance(one, Walls) and int(one.axis) == axis), None)


def _faces(settings: StrainSettings, axis: int, height: float) -> tuple[float, float]:
    assert settings.held_n is not None
    at = np.mod(settings.scene.packing.position_nd[settings.held_n, axis], height)
    low, high = at[at < 0.5 * height], at[at >= 0.5 * height]
    return (float(low.mean()) if len(low) else math.nan, float(high.mean()) if len(high) else math.nan)


def wall_forces(
    settings: StrainSettings, axes: tuple[int, int], every: int, profile: Any, *, carried: bool
) -> WallForces | None:
    """Return what measures the forces on a scene's walls across the gradient; None where it has none.

    Raises
    ------
    ValueError
        If the sample is not carried along and there are no plates.

    """
    height = settings.scene.packing.box.height_across(axes[1])
    plates = False
    if height is not None and settings.held_n is not None and settings.held_n.any() and not settings.held_n.all():
        low, high = _faces(settings, axes[1], height)
        # a particle that is held in the middle is no plate
        plates = high - low > 0.5 * height
    if not carried and not plates:
        raise ValueError("carried must be True where no plates drive the sample (held_n of rough_plates), got False")
    if height is None or not (plates or _smooth(settings, axes[1]) is not None):
        return None
    return WallForces(settings, axes, every, profile, height=height, carried=carried)
