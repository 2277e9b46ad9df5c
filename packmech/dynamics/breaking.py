# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Bonds that break: which are beyond a limit at the end of a time step, and what is known of those that broke.

Scenes without limits hold none of this: what looks for broken bonds in the loops is chosen by the type of the limits.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.calls.display import Row, shown
from packmech.dynamics.bonds import BondTable, bond_energy, bond_first, bond_vector, pull_of_bond
from packmech.dynamics.contact_forces import laws_of
from packmech.dynamics.friction import Now
from packmech.effects import BREAKING_MODES, Bonds
from packmech.jit.compiled import device, inlined, lean
from packmech.jit.threads import largest, wait
from packmech.loop.checkpoint import IndexBounds
from packmech.observables import Table, make_table

# columns of a table of events: axes of the field, and unit
_COLUMNS = {
    **dict.fromkeys(("bond", "i", "j"), ("e", "1")),
    "image": ("ed", "1"),
    "step": ("e", "1"),
    "time": ("e", "time"),
    "force": ("e", "force"),
    "elongation": ("e", "1"),
    "shear": ("e", "force"),
    "energy": ("e", "energy"),
}
# columns of what a bond bears, as in `Loads.load_bk`
FORCE, ELONGATION, SHEAR, ENERGY = 0, 1, 2, 3


@shown(str)
@dataclass(frozen=True, eq=False)
class BrokenBonds:
    """The bonds that broke in a run, in the order in which they did; those of one step by their places in the scene.

    Attributes
    ----------
    bond_e
        (E,) places in the bonds of the scene.
    i_e, j_e, image_ed
        (E,) particles of each, and (E, d) image vectors between them in the packing of the scene, as its bonds have
        them.
    step_e
        (E,) steps at whose end they broke, counted from the start of the run; a resumed run counts on.
    time_e
        (E,) times of these since that start [time].
    mode_e
        (E,) the limit that each was beyond: "tension", "compression", "stretch", "squeeze" or "shear". Where several
        were exceeded in one step, the one with the largest ratio of load to limit.
    force_e
        (E,) forces of the normal springs at break, positive where they pulled [force].
    elongation_e
        (E,) distance / rest length - 1 at break [1].
    shear_e
        (E,) forces of the tangential springs at break [force].
    energy_e
        (E,) energies of both springs at break [energy].
    left
        Number of bonds that are left.
    released
        Energy that all breaks together released: the sum of `energy_e`, less the energy of the contacts that took the
        places of bonds [energy]. Where contacts slide it includes their change as forces are evaluated again,
        0.1 % of the sum of `energy_e` in the sheared network of the tests.

    Examples
    --------
    Two discs that fly apart with a bond between them:

    >>> import packmech as pm
    >>> pair = pm.Packing([[1.0, 2.0], [2.0, 2.0]], [0.5, 0.5], pm.Box.cubic(4.0, 2))
    >>> bond = pm.Bonds([0], [1], [[0, 0]], [1.0], breaks_at=pm.BondLimits(tension=0.02))
    >>> scene = pm.Scene(pair, (pm.Repulsion(), bond))
    >>> broken = pm.simulate(scene, duration=1.0, velocity_nd=[[-0.05, 0.0], [0.05, 0.0]]).broken_bonds
    >>> str(broken)
    '1 of 1 bonds broke: 1 by tension'
    >>> float(broken.force_e[0]) > 0.02, broken.left
    (True, 0)
    >>> broken.to_dict()["mode"]
    ['tension']

    """

    bond_e: NDArray[np.int64]
    i_e: NDArray[np.int64]
    j_e: NDArray[np.int64]
    image_ed: NDArray[np.int64]
    step_e: NDArray[np.int64]
    time_e: NDArray[np.float64]
    mode_e: NDArray[np.str_]
    force_e: NDArray[np.float64]
    elongation_e: NDArray[np.float64]
    shear_e: NDArray[np.float64]
    energy_e: NDArray[np.float64]
    left: int
    released: float

    def __len__(self) -> int:
        return len(self.bond_e)

    def __str__(self) -> str:
        return f"{len(self)} of {len(self) + self.left} bonds broke" + (f": {self.by_mode()}" if len(self) else "")

    def by_mode(self) -> str:
        """Return how many broke by which limit, in words."""
        count = {name: int((self.mode_e == name).sum()) for name in BREAKING_MODES}
        return ", ".join(f"{number} by {name}" for name, number in count.items() if number)

    def table(self) -> Table:
        """Return the events as columns, a row for each."""
        dimension = self.image_ed.shape[1]
        about = {
            "kind": "BrokenBonds",
            "dimension": dimension,
            "bonds_left": self.left,
            "released_energy": self.released,
        }
        found = {name: getattr(self, f"{name}_{axes}") for name, (axes, _) in _COLUMNS.items()}
        made = make_table(found, about, {name: unit for name, (_, unit) in _COLUMNS.items()})
        return Table({**made.columns, "mode": self.mode_e}, {**made.units, "mode": ""}, about)

    def to_dict(self) -> dict[str, list[Any]]:
        """Return the columns of `table` by name, as plain lists."""
        return {name: column.tolist() for name, column in self.table().columns.items()}


def numbers_of_broken(broken: BrokenBonds | None) -> dict[str, Any]:
    """Return what a run says by name of bonds that broke; nothing where none may."""
    if broken is None:
        return {}
    return {
        "bonds_broken": len(broken),
        "bonds_left": broken.left,
        "released_energy": broken.released,
        "broken_bonds": broken.to_dict(),
    }


def rows_of_broken(broken: BrokenBonds | None) -> list[Row]:
    """Return the row of a report that says which bonds broke; none where none may."""
    if broken is None:
        return []
    count, modes = f"{len(broken)} of {len(broken) + broken.left}", f"{broken.by_mode()}; " if len(broken) else ""
    return [("broken bonds", count, f"{modes}{broken.released:.6g} of energy released")]


class Loads(NamedTuple):
    """What bonds bear at one time, in the order of their table.

    (B, 4) normal forces, positive where they pull, elongations, tangential forces, and energies of the springs; (B, 1
    or 3) displacements of the tangential springs.
    """

    load_bk: NDArray[np.float64]
    stretch_bk: NDArray[np.float64]


@device
def limits_of(bonds):
    """Return the limits of a table of bonds; None without bonds, or where they never break."""
    if bonds is None:
        return None
    return bonds.limit_bk


@inlined
def normal_load(bonds, r, b):
    """Return the force of a bond's normal spring, positive where it pulls, and its elongation."""
    rest = bonds.rest_b[b]
    # ends at the same place have no direction
    first = bond_first(bonds.compression, bonds.tension, r, rest) if r > 0.0 else 0.0
    return first, r / rest - 1.0


@inlined
def _is_beyond(limit_bk, b, force, elongation):
    return (
        force > limit_bk[b, 0] or -force > limit_bk[b, 1] or elongation > limit_bk[b, 2] or -elongation > limit_bk[b, 3]
    )


@inlined
def _across_bond(bonds, laws, b, dx, dy, dz):
    across = pull_of_bond(bonds, laws, b, dx, dy, dz).across
    size = math.sqrt(across.x * across.x + across.y * across.y + across.z * across.z)
    return across.x, across.y, across.z, bonds.tangential_stiffness * size


@inlined
def some_bond_breaks(limit_bk, system, thread, blocks, pace):
    """Whether a bond of any thread is beyond a limit now that velocities are those of the end of the step."""
    if limit_bk is None:
        return False
    bonds, lattice = system.space.bonds, system.space.frame.lattice_dd
    laws = laws_of(system, Now(pace.after))
    wait(thread)
    found = 0.0
    for b in range(np.uint64(bonds.start_s[2 * blocks[0]]), np.uint64(bonds.start_s[2 * blocks[1]])):
        dx, dy, dz = bond_vector(laws.axes, laws.body, bonds, lattice, b)
        force, elongation = normal_load(bonds, math.sqrt(dx * dx + dy * dy + dz * dz), b)
        if _is_beyond(limit_bk, b, force, elongation):
            found = 1.0
        if limit_bk[b, 4] < math.inf and _across_bond(bonds, laws, b, dx, dy, dz)[3] > limit_bk[b, 4]:
            found = 1.0
    broken = largest(thread, found) > 0.0
    # all threads must have read the result before one of them sends its next number
    wait(thread)
    return broken


@lean
def _measure_loads(laws, bonds, lattice_dd, load_bk, stretch_bk):
    for b in range(np.uint64(bonds.i_b.shape[0])):
        dx, dy, dz = bond_vector(laws.axes, laws.body, bonds, lattice_dd, b)
        r = math.sqrt(dx * dx + dy * dy + dz * dz)
        force, elongation = normal_load(bonds, r, b)
        x, y, z, shear = _across_bond(bonds, laws, b, dx, dy, dz)
        load_bk[b, 0], load_bk[b, 1], load_bk[b, 2] = force, elongation, shear
        stored = 0.5 * bonds.tangential_stiffness * (x * x + y * y + z * z)
        load_bk[b, 3] = bond_energy(bonds, b, r) + stored
        stretch_bk[b, 0] = x
        if len(laws.axes) == 3:
            stretch_bk[b, 1], stretch_bk[b, 2] = y, z


def measure_loads(system: Any, now: Any) -> Loads:
    """Return what the bonds of a system bear; `now` is a `Now`."""
    bonds = system.space.bonds
    loads = Loads(np.zeros((len(bonds.i_b), 4)), np.zeros_like(bonds.stretch_bk))
    _measure_loads(laws_of(system, now), bonds, system.space.frame.lattice_dd, *loads)
    return loads


def broken_by(table: BondTable, load_bk: NDArray[np.float64]) -> NDArray[np.int64]:
    """Return the (B,) limits that bonds are beyond, numbered as in `BREAKING_MODES`; -1 where they hold."""
    force, elongation, shear = load_bk[:, FORCE], load_bk[:, ELONGATION], load_bk[:, SHEAR]
    load = np.stack([force, -force, elongation, -elongation, shear], axis=1)
    beyond = load > table.limit_bk
    excess = np.where(beyond, load / table.limit_bk, 0.0)
    return np.where(beyond.any(axis=1), np.argmax(excess, axis=1), -1)


class Breaks:
    """The bonds of a scene that may break: which are left, and the events so far.

    Parameters
    ----------
    whole
        The bonds of the scene.

    Attributes
    ----------
    left
        The bonds that are left.
    left_b
        (B',) their places in the scene's.
    released_s
        (S,) energy that was released in each of the steps in which bonds broke [energy].

    """

    def __init__(self, whole: Bonds) -> None:
        self.whole = whole
        self._clear()

    def _clear(self) -> None:
        self.left = self.whole
        self.left_b = np.arange(len(self.whole))
        self.bond_e, self.step_e, self.mode_e = (np.zeros(0, dtype=np.int64) for _ in range(3))
        self.load_ek, self.released_s = np.zeros((0, 4)), np.zeros(0)

    def add(
        self, broken_b: NDArray[np.int64], mode_b: NDArray[np.int64], load_bk: NDArray[np.float64], step: int
    ) -> None:
        """Record that bonds broke at the end of a step, and take them out of those that are left.

        The energy that they released is 0 until it is set: it is known only once forces were taken without them.

        Parameters
        ----------
        broken_b
            Their places among the bonds that are left.
        mode_b, load_bk
            The limits that they were beyond, and what they bore.
        step
            The step, later than that of any event before.

        """
        order = np.argsort(broken_b)
        self._append(self.left_b[broken_b[order]], step, mode_b[order], load_bk[order], np.zeros(1))

    def _append(self, bond_e: Any, step_e: Any, mode_e: Any, load_ek: Any, released_s: Any) -> None:
        self.bond_e = np.concatenate([self.bond_e, bond_e])
        self.step_e = np.concatenate([self.step_e, np.broadcast_to(step_e, len(bond_e))])
        self.mode_e = np.concatenate([self.mode_e, mode_e])
        self.load_ek = np.concatenate([self.load_ek, load_ek])
        self.released_s = np.concatenate([self.released_s, released_s])
        keep = np.ones(len(self.whole), dtype=bool)
        keep[self.bond_e] = False
        self.left, self.left_b = self.whole.select(keep), np.flatnonzero(keep)

    def released(self, step: int) -> float:
        """Return the energy that was released until the end of a step, its own breaks included."""
        return float(self.released_s[np.unique(self.step_e) <= step].sum())

    def left_at(self, step: int) -> Bonds:
        """Return the bonds that were left at the end of a step."""
        keep = np.ones(len(self.whole), dtype=bool)
        keep[self.bond_e[self.step_e <= step]] = False
        return self.whole.select(keep)

    def until(self, step: int, dt: float) -> BrokenBonds:
        """Return what broke until the end of a step."""
        count = int(np.count_nonzero(self.step_e <= step))
        bond, whole, load = self.bond_e[:count], self.whole, self.load_ek[:count]
        return BrokenBonds(
            bond,
            whole.i_b[bond],
            whole.j_b[bond],
            whole.image_bd[bond],
            self.step_e[:count],
            np.asarray(self.step_e[:count] * dt, dtype=np.float64),
            np.array(BREAKING_MODES)[self.mode_e[:count]],
            load[:, FORCE],
            load[:, ELONGATION],
            load[:, SHEAR],
            load[:, ENERGY],
            len(whole) - count,
            self.released(step),
        )

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the events as arrays by name, for a checkpoint."""
        names = ("bond_e", "step_e", "mode_e", "load_ek", "released_s")
        return {f"broken.{name}": getattr(self, name) for name in names}

    def index_bounds(self) -> dict[str, IndexBounds]:
        """Return what the integers in `arrays` may be."""
        return {
            "broken.bond_e": IndexBounds(0, len(self.whole), (None,)),
            "broken.step_e": IndexBounds(0, 1 << 62, (None,)),
            "broken.mode_e": IndexBounds(0, len(BREAKING_MODES), (None,)),
        }

    def restore(self, arrays: Mapping[str, Any]) -> None:
        """Take the events from the arrays of a checkpoint, as `arrays` returns them."""
        found = {name: np.asarray(arrays.get(name)) for name in self.arrays()}
        bond = found["broken.bond_e"]
        if bond.ndim != 1 or len(np.unique(bond)) != len(bond):
            raise ValueError("broken.bond_e must name each bond that broke once, got others")
        step = found["broken.step_e"]
        count = {"broken.released_s": len(np.unique(step))}
        shapes = {name: (len(bond), 4) if name.endswith("_ek") else (count.get(name, len(bond)),) for name in found}
        for name, array in found.items():
            if array.shape != shapes[name] or not np.isfinite(array).all():
                raise ValueError(f"{name} must be finite and of shape {shapes[name]}, got {array.shape}")
        falls = np.flatnonzero(np.diff(step) < 0)
        if len(falls):
            before, after = step[falls[0] : falls[0] + 2].tolist()
            raise ValueError(f"broken.step_e must not fall from one event to the next, got {after} after {before}")
        self._clear()
        self._append(*found.values())
