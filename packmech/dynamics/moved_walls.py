"""A record of walls that move: where faces were, how fast, and the stress that particles bear there."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.calls.display import shown
from packmech.dynamics.engine import Engine
from packmech.dynamics.faces import AXIS, FORCE, HELD, INVERSE, MOVED, NUMBERS, PLACE, VELOCITY, WHOLE, WORK, face_area
from packmech.effects import SIDES, HeldStress, WallMotion, Walls, moved_along
from packmech.loop.checkpoint import IndexBounds, saved_array
from packmech.observables import Table, make_table
from packmech.result import Row

# part of a run that is looked at, and the share of the stress within which it is steady there
_LAST, _STEADY = 0.1, 0.01
_AXES = "xyz"


@shown()
@dataclass(frozen=True, eq=False)
class MovedWalls:
    """The faces of `Walls` that move, in time: low before high of each effect, whether either moves or not.

    Attributes
    ----------
    wall_f
        (F,) place of each face's walls among the effects of the scene.
    axis_f
        (F,) axis across the face.
    high_f
        (F,) whether it is the high one.
    time_t
        (T,) times since the start, those of the trace where one is kept, or else some two hundred.
    place_tf
        (T, F) where faces stand along their axis [length].
    moved_tfd
        (T, F, d) how far they have moved since the start [length].
    velocity_tfd
        (T, F, d) velocities [length/time].
    stress_tfd
        (T, F, d) stress that the particles bear at the face: force along each axis over the area, of either face with
        the sign of a stress between both; tension positive, so that across the face it is minus the pressure
        [energy/length^d].
    net_tfd
        (T, F, d) what accelerates a face that holds a stress: all forces on it over its area; 0 for others.
    work_tfd
        (T, F, d) work done so far on faces by what moves them at a velocity [energy].
    held_fd
        (F, d) stresses that are held, with the same sign; nan where a velocity is given [energy/length^d].
    effects
        The effects of the scene with the walls where they stand at the end, for a run that goes on from there.

    """

    wall_f: NDArray[np.int64]
    axis_f: NDArray[np.int64]
    high_f: NDArray[np.bool_]
    time_t: NDArray[np.float64]
    place_tf: NDArray[np.float64]
    moved_tfd: NDArray[np.float64]
    velocity_tfd: NDArray[np.float64]
    stress_tfd: NDArray[np.float64]
    net_tfd: NDArray[np.float64]
    work_tfd: NDArray[np.float64]
    held_fd: NDArray[np.float64]
    effects: tuple[Any, ...]

    def __len__(self) -> int:
        return len(self.wall_f)

    @property
    def pressure_tf(self) -> NDArray[np.float64]:
        """The (T, F) pressures of the particles on the faces [energy/length^d]."""
        return -np.take_along_axis(self.stress_tfd, self.axis_f[None, :, None], axis=2)[..., 0]

    @cached_property
    def unrest_fd(self) -> NDArray[np.float64]:
        """The (F, d) largest departures from a steady state in the last tenth of the run [1].

        Of the net force where a stress is held, of the particles' stress from its mean where a velocity is given; over
        the largest stress at the face then, or held there.
        """
        late = self.time_t >= (1.0 - _LAST) * self.time_t[-1]
        stress_tfd = self.stress_tfd[late]
        varying = np.abs(stress_tfd - stress_tfd.mean(axis=0)).max(axis=0)
        off = np.where(np.isnan(self.held_fd), varying, np.abs(self.net_tfd[late]).max(axis=0))
        scale = np.maximum(np.abs(stress_tfd).max(axis=(0, 2)), np.abs(np.nan_to_num(self.held_fd)).max(axis=1))
        return np.asarray(np.divide(off, scale[:, None], out=np.zeros_like(off), where=scale[:, None] > 0.0))

    @property
    def steady_fd(self) -> NDArray[np.bool_]:
        """The (F, d) components that are steady: `unrest_fd` is at most a hundredth."""
        return np.asarray(self.unrest_fd <= _STEADY)

    def at(self, t: int) -> tuple[Any, ...]:
        """Return the effects of the scene with the walls where they stand at one of the times."""
        found = list(self.effects)
        for f, (k, high) in enumerate(zip(self.wall_f.tolist(), self.high_f.tolist(), strict=True)):
            name = "high" if high else "low"
            found[k] = found[k]._replace(**{name: float(self.place_tf[t, f])})
        return tuple(found)

    def names(self) -> list[str]:
        """Return the name of each face."""
        side = ("low", "high")
        return [f"{side[int(high)]} wall of effects[{k}]" for k, high in zip(self.wall_f, self.high_f, strict=True)]

    def rows(self) -> list[Row]:
        """Return where each face stands at the end, its velocity, and the stress reached: name, value, words."""
        found: list[Row] = []
        for f, name in enumerate(self.names()):
            velocity = "  ".join(f"{one + 0.0:.4g}" for one in self.velocity_tfd[-1, f])
            found.append((name, f"{self.place_tf[-1, f]:.6g}", f"where it stands; velocity {velocity}"))
            for a, stress in enumerate(self.stress_tfd[-1, f]):
                held = self.held_fd[f, a]
                if np.isnan(held) and a != self.axis_f[f] and not stress:
                    continue
                reached = np.isnan(held) or abs(stress - held) <= _STEADY * max(abs(held), abs(stress))
                words = (
                    "given velocity" if np.isnan(held) else f"{held:.6g} is held{'' if reached else ', not reached'}"
                )
                steady = "steady" if self.steady_fd[f, a] else f"not steady, within {self.unrest_fd[f, a]:.1e}"
                found.append(
                    (f"  stress {_AXES[a]}{_AXES[self.axis_f[f]]}", f"{stress + 0.0:.6g}", f"{words}; {steady}")
                )
        return found

    def to_dict(self) -> dict[str, Any]:
        """Return where faces stand at the end, and the stress that was reached, as plain values."""
        return {
            name: {
                "place": float(self.place_tf[-1, f]),
                "velocity": self.velocity_tfd[-1, f].tolist(),
                "stress": self.stress_tfd[-1, f].tolist(),
                "steady": self.steady_fd[f].tolist(),
            }
            for f, name in enumerate(self.names())
        }

    def about(self) -> dict[str, Any]:
        """Return what a table says of it."""
        return {"kind": type(self).__name__, "faces": len(self)}

    def table(self) -> Table:
        """Return places, velocities and stresses as columns; `pm.write_table` writes it."""
        columns, units = {"time": self.time_t}, {"time": "time"}
        d = self.velocity_tfd.shape[2]
        for f, name in enumerate(
            name.replace(" wall of effects", "").replace("[", "_").strip("]") for name in self.names()
        ):
            columns[f"place_{name}"], units[f"place_{name}"] = self.place_tf[:, f], "length"
            for a in range(d):
                for what, values, unit in (
                    ("velocity", self.velocity_tfd, "length/time"),
                    ("stress", self.stress_tfd, f"energy/length^{d}"),
                ):
                    columns[f"{what}_{_AXES[a]}_{name}"] = values[:, f, a]
                    units[f"{what}_{_AXES[a]}_{name}"] = unit
        return make_table(columns, self.about(), units)


class FaceRows:
    """The faces of an engine, kept every so many steps and at the last step that was observed."""

    def __init__(self, engine: Engine, every: int) -> None:
        self.engine, self.every = engine, every
        self.step_t: list[int] = []
        self.row_tfk: list[NDArray[np.float64]] = []

    def until_next(self, steps: int) -> int:
        """Return how many steps may be taken until a row is due."""
        return self.every - steps % self.every

    def keep(self) -> None:
        """Keep the faces as they are now, in place of a row that was not due."""
        assert self.engine.faces is not None
        if self.step_t and (self.step_t[-1] % self.every or self.step_t[-1] == self.engine.steps):
            self.step_t.pop(), self.row_tfk.pop()
        self.step_t.append(self.engine.steps)
        self.row_tfk.append(self.engine.faces.number_fk.copy())

    def have_room(self) -> bool:
        """Return whether all walls stand with the low one below the high one, and no farther apart than the box is."""
        assert self.engine.faces is not None
        number_fk, box = self.engine.faces.number_fk, self.engine.scene.packing.box
        low, high = number_fk[::SIDES, PLACE], number_fk[1::SIDES, PLACE]
        height = [box.height_across(int(axis)) for axis in number_fk[::SIDES, AXIS]]
        return bool(np.all((low < high) & (high - low <= np.array(height, dtype=float))))

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return what a checkpoint keeps, by name."""
        return {
            "face_every": np.array(self.every),
            "face_step_t": np.array(self.step_t, dtype=np.int64),
            "face_row_tfk": np.array(self.row_tfk).reshape(-1, len(self.engine.faces.number_fk), NUMBERS),  # type: ignore[union-attr]
        }

    @staticmethod
    def index_bounds() -> dict[str, IndexBounds]:
        """Return what the integers in `arrays` may be."""
        return {"face_every": IndexBounds(1, 1 << 62, ()), "face_step_t": IndexBounds(0, 1 << 62, (None,))}

    def restore(self, arrays: Mapping[str, Any]) -> None:
        """Go on from what a checkpoint kept."""
        assert self.engine.faces is not None
        self.every = int(arrays["face_every"])
        self.step_t = np.asarray(arrays["face_step_t"]).tolist()
        shape = (len(self.step_t), *self.engine.faces.number_fk.shape)
        self.row_tfk = list(saved_array(arrays, "face_row_tfk", shape))

    def moved_walls(self) -> MovedWalls:
        """Return the walls as far as they came."""
        return _moved_walls(self.engine, self.step_t, self.row_tfk)


def _moved_walls(engine: Engine, step_t: Sequence[int], row_tfk: Sequence[NDArray[np.float64]]) -> MovedWalls:
    scene, d = engine.scene, len(engine.axes)
    number = np.array(row_tfk)
    moving = [k for k, one in enumerate(scene.effects) if isinstance(one, Walls) and one.moves]
    wall_f = np.repeat(np.array(moving, dtype=np.int64), SIDES)
    axis_f = np.array([int(scene.effects[k].axis) for k in wall_f], dtype=np.int64)
    high_f = np.arange(len(wall_f)) % SIDES == 1
    area_f = np.array([face_area(scene.packing.box, axis) for axis in axis_f.tolist()])
    # of the stress to which a force on the face belongs
    outward_f = np.where(high_f, 1.0, -1.0)

    def of(column: int) -> NDArray[np.float64]:
        return np.asarray(number[:, :, column : column + d])

    per_area = 1.0 / area_f[:, None]
    held_fd = np.where(number[0, :, INVERSE : INVERSE + d] > 0.0, number[0, :, HELD : HELD + d], np.nan)
    net = np.where(number[:, :, INVERSE : INVERSE + d] > 0.0, of(WHOLE), 0.0) * per_area
    effects = list(scene.effects)
    for f, k in enumerate(wall_f.tolist()):
        place, side = float(number[-1, f, PLACE]), "high" if high_f[f] else "low"
        motion = getattr(effects[k], f"{side}_motion")
        velocity = number[-1, f, VELOCITY : VELOCITY + 3].tolist()
        after = [
            one._replace(velocity=v) if isinstance(one, HeldStress) else one
            for one, v in zip(moved_along(motion), velocity, strict=True)
        ]
        named = {side: place} | ({} if motion is None else {f"{side}_motion": WallMotion(*after)})
        effects[k] = effects[k]._replace(**named)
    return MovedWalls(
        wall_f,
        axis_f,
        high_f,
        np.array(step_t) * engine.dt,
        number[:, :, PLACE].copy(),
        of(MOVED).copy(),
        of(VELOCITY).copy(),
        -of(FORCE) * per_area * outward_f[:, None],
        net,
        of(WORK).copy(),
        held_fd * per_area * outward_f[:, None],
        tuple(effects),
    )
