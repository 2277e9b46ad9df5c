"""A march on its way: the arrays of a scene that is stepped through time, and what keeps them in order."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.contacts.cells import frame_of, size_levels
from packmech.dynamics.kernels import RUNNING
from packmech.dynamics.march.bonds import bond_stretches, bond_table
from packmech.dynamics.march.flow import ALONG_X, GAMMA, NILPOTENT, NUMBERS, Flow, Still, gamma_at, set_flow
from packmech.dynamics.march.leading import leading_share
from packmech.dynamics.march.lists import Space, Track, empty_track, search
from packmech.dynamics.march.look import COLUMNS, look
from packmech.dynamics.march.memory import Stretches, read_stretches, write_stretches
from packmech.dynamics.march.pairs import Pairs, empty_pairs
from packmech.dynamics.march.springs import Pace
from packmech.dynamics.march.steps import FORCES, REST_OF_STEP, SEARCH, WHOLE_STEP, Acting, State, march
from packmech.dynamics.march.tally import Ledger
from packmech.dynamics.march.team import Team, together
from packmech.dynamics.pair_list import SKIN_FULL
from packmech.dynamics.program import space_order
from packmech.effects import Bonds, Friction
from packmech.scene import Scene

# skin of the wide pair list in units of the harmonic mean diameter
_SKIN = 0.6
# who left the cell is brought home every so many steps, or whenever the box has sheared by so much
_HOMING, _SHEARED = 1024, 0.2
# other lattice vectors are taken where the loops' are so much flatter than the best
_FLAT = 0.7


@dataclass(eq=False)
class March:
    """Particles on their way through time. All arrays but home_nd are by rows, sorted in space.

    Attributes
    ----------
    scene
        The scene it was built from; its box is that at gamma = 0.
    order_n
        (N,) particle of each row.
    home_nd
        (N, d) whole lattice vectors (of the scene's box, deformed) by which particles were moved.
    change_dd
        (d, d) whole numbers: the loops' lattice vectors are the scene's @ change.
    profile, direction_dd
        How the box deforms: F(t) = 1 + gamma(t) direction; no direction where it does not.
    dt, steps
        Time step and steps taken.
    second_order
        Velocity Verlet, or else semi-implicit Euler.
    threads
        Number of threads; it changes no bit.

    """

    scene: Scene
    axes: tuple[int, ...]
    order_n: NDArray[np.int64]
    home_nd: NDArray[np.int64]
    change_dd: NDArray[np.int64]
    profile: Any
    direction_dd: NDArray[np.float64] | None
    acting: Acting
    state: State
    space: Space
    pairs: Pairs
    track: Track | None
    dt: float
    second_order: bool
    steps: int = 0
    started: bool = False
    homing: int = _HOMING
    threads: int = 1

    @property
    def time(self) -> float:
        """Time since the start."""
        return self.steps * self.dt

    @property
    def pace(self) -> Pace:
        """How much of a slip is added to a spring before and after the force is taken."""
        return Pace(0.5 * self.dt, 0.5 * self.dt) if self.second_order else Pace(0.0, self.dt)

    @property
    def gamma(self) -> float:
        """Strain of the box now."""
        return 0.0 if self.space.flow is None else float(gamma_at(self.profile, self.time)[0])

    def box(self) -> Box:
        """Return the box as it is now: the scene's, deformed."""
        if self.direction_dd is None:
            return self.scene.packing.box
        d = len(self.axes)
        return Box((np.eye(d) + self.gamma * self.direction_dd) @ self.scene.packing.box.lattice_dd)

    def positions(self) -> NDArray[np.float64]:
        """Return the (N, d) positions in the order of the packing, never wrapped [length]."""
        d = len(self.axes)
        position = np.empty((len(self.order_n), d))
        position[self.order_n] = self.state.body[:, :d]
        return np.asarray(position + self.home_nd @ self.box().lattice_dd.T)

    def velocities(self) -> NDArray[np.float64]:
        """Return the (N, d) peculiar velocities c = v - L x in the order of the packing [length/time]."""
        d = len(self.axes)
        velocity = np.empty((len(self.order_n), d))
        velocity[self.order_n] = self.state.body[:, 4 : 4 + d]
        return velocity

    def spins(self) -> NDArray[np.float64] | None:
        """Return the (N, 1 or 3) spins in the order of the packing [1/time]; None where particles do not turn."""
        d = len(self.axes)
        turns = len(self.state.spins)
        if not turns:
            return None
        spin = np.empty((len(self.order_n), turns))
        spin[self.order_n] = self.state.body[:, 4 + d : 4 + d + turns]
        return spin

    def begin(self) -> None:
        """Take the forces of the present state."""
        if self.space.flow is not None:
            set_flow(self.space.flow, self.space.frame, self.time)
        self._search()
        self._run(FORCES, 1, None)
        if self.state.last is not None:
            self.state.last[:] = self.state.push
        self.started = True

    def advance(self, steps: int, ledger: Ledger | None = None) -> int:
        """Advance by up to `steps` steps; return how that ended."""
        if not self.started:
            self.begin()
        left = steps
        start = WHOLE_STEP
        while left > 0:
            due = min(left, self.homing - self.steps % self.homing)
            status, taken = self._run(start, due, ledger)
            self.steps += taken
            left -= taken
            start = WHOLE_STEP
            if status == SEARCH:
                self._search()
                start = REST_OF_STEP
            elif status != RUNNING:
                return status
            elif self.steps % self.homing == 0:
                self.bring_home()
        return RUNNING

    def _run(self, start: int, steps: int, ledger: Ledger | None) -> tuple[int, int]:
        reach = 2.0 * float(self.state.body[:, 3].min())
        threads = min(self.threads, len(self.pairs.row_b) - 1)

        def run(team: Team | None) -> tuple[int, int]:
            space = self.space
            if team is not None and space.flow is not None:
                # room to reckon in is each thread's own
                space = space._replace(flow=own_room(space.flow))
            status, taken = march(
                self.acting,
                self.axes,
                self.state,
                space,
                self.pairs,
                self.track,
                ledger,
                team,
                start,
                self.steps,
                steps,
                self.dt,
                self.second_order,
                reach,
            )
            return int(status), int(taken)

        return run(None) if threads == 1 else together(run, threads)

    def _search(self) -> None:
        self.pairs, self.track = search(self.axes, self.state.body, self.space, self.pairs, self.track)

    def see(self) -> NDArray[np.float64]:
        """Return the figures of the present moment, in the columns of `look`."""
        if not self.started:
            self.begin()
        out = np.zeros(COLUMNS)
        look(self.acting, self.axes, self.state, self.space, self.pairs, self.track, self.time, self.pace, out)
        return out

    def stretches(self) -> Stretches:
        """Return the springs that are stretched, by rows and images of the loops' lattice."""
        return read_stretches(self.pairs, self.track, len(self.axes))

    def bring_home(self) -> None:
        """Move who left the cell far behind by whole lattice vectors, and take better vectors where these are flat."""
        d = len(self.axes)
        body = self.state.body
        lattice = self.space.frame.lattice_dd[:d, :d]
        loops = Box(lattice)
        fraction = body[:, :d] @ loops.inverse_dd.T
        shift = np.where((fraction < -1.0) | (fraction >= 2.0), np.floor(fraction), 0.0).astype(np.int64)
        change = np.eye(d, dtype=np.int64)
        if self.space.flow is not None:
            reduced, other = loops.reduced()
            if loops.height_d.min() < _FLAT * reduced.height_d.min():
                change = other
        turned = not np.array_equal(change, np.eye(d, dtype=np.int64))
        if not shift.any() and not turned:
            return
        held = self.stretches()
        body[:, :d] -= shift @ lattice.T
        self.home_nd[self.order_n] += shift @ self.change_dd.T
        back = np.rint(np.linalg.inv(change)).astype(np.int64)
        self.change_dd = self.change_dd @ change
        self.renew()
        held = held.moved(shift, back)
        self.restore(held)

    def renew(self) -> None:
        """Make the frame, the bonds' images and empty lists anew."""
        packing, d = self.scene.packing, len(self.axes)
        start = Box(packing.box.lattice_dd @ self.change_dd)
        frame = frame_of(start)
        flow = None
        if self.direction_dd is not None:
            flow = make_flow(self.profile, self.direction_dd, start)
            set_flow(flow, frame, self.time)
        table = self.space.bonds
        if table is not None:
            bonds = next(one for one in self.scene.effects if isinstance(one, Bonds))
            table = bond_table(bonds, self.order_n, self.home_nd, self.change_dd, bond_stretches(table))
        self.space = Space(self.space.sizes, frame, flow, table)
        self.pairs = empty_pairs(len(self.order_n), self.state.push.shape[1], float(self.pairs.number[SKIN_FULL]))
        self.track = None if self.track is None else empty_track(d)

    def restore(self, held: Stretches) -> None:
        """Make the lists at the present positions and give their springs these stretches; forces stay as they are."""
        self._search()
        write_stretches(self.pairs, self.track, held)


def aligned_rows(rows: int, columns: int) -> NDArray[np.float64]:
    """Return rows of zeros; those of up to eight numbers fill one cache line each."""
    if columns > 8:
        return np.zeros((rows, columns))
    space = np.zeros(8 * rows + 8)
    ahead = (-space.ctypes.data % 64) // 8
    return space[ahead : ahead + 8 * rows].reshape(rows, 8)


def make_flow(profile: Any, direction_dd: NDArray[np.float64], box: Box) -> Flow:
    """Return the record of a deforming box whose lattice at gamma = 0 is that of `box`."""
    d = box.dimension
    direction, lattice = np.zeros((3, 3)), np.eye(3)
    direction[:d, :d] = direction_dd
    lattice[:d, :d] = box.lattice_dd
    number = np.zeros(NUMBERS)
    number[NILPOTENT] = not (direction @ direction).any()
    number[ALONG_X] = direction[0, 1] != 0.0 and np.count_nonzero(direction) == 1
    return Flow(profile, direction, lattice, np.zeros((3, 3)), np.eye(3), np.eye(3), np.eye(3), number)


def own_room(flow: Flow) -> Flow:
    """Return the record with matrices of its own to reckon in."""
    return flow._replace(step_dd=np.eye(3), back_dd=np.eye(3), work_dd=np.eye(3))


def build_march(
    scene: Scene,
    *,
    dt: float,
    mass_n: NDArray[np.float64],
    velocity_nd: NDArray[np.float64],
    spin_nk: NDArray[np.float64] | None = None,
    profile: Any = None,
    direction_dd: NDArray[np.float64] | None = None,
    held_n: NDArray[np.bool_] | None = None,
    second_order: bool = True,
    threads: int = 1,
) -> March:
    """Return a march ready to go; velocities are peculiar ones.

    Parameters
    ----------
    scene
        The scene, without rigid links.
    dt
        Time step.
    mass_n, velocity_nd, spin_nk
        (N,) masses, (N, d) peculiar velocities, (N, 1 or 3) spins; None: at rest.
    profile, direction_dd
        How the box deforms; None: it does not.
    held_n
        (N,) particles that nothing pushes.
    second_order
        Velocity Verlet, or else semi-implicit Euler.
    threads
        Number of threads; it changes no bit.

    """
    packing, d = scene.packing, scene.packing.dimension
    pairs = tuple(one for one in scene.effects if hasattr(type(one), "pair_first"))
    bodies = tuple(one for one in scene.effects if hasattr(type(one), "body_force"))
    friction = next((one for one in scene.effects if isinstance(one, Friction)), None)
    bonds = next((one for one in scene.effects if isinstance(one, Bonds)), None)
    turns = friction is not None or bonds is not None
    spins = 0 if not turns else 1 if d == 2 else 3
    lead = leading_share(scene, dt, float(mass_n.min())) if second_order else 0.0
    order = space_order(packing)
    n = packing.particles
    body = aligned_rows(n, 4 + d + spins)
    body[:, 3] = packing.radius_n[order]
    body[:, 4 : 4 + d] = velocity_nd[order]
    if turns and spin_nk is not None:
        body[:, 4 + d : 4 + d + spins] = spin_nk[order]
    fraction = packing.position_nd @ packing.box.inverse_dd.T
    home = np.floor(fraction).astype(np.int64)
    body[:, :d] = (packing.position_nd - home @ packing.box.lattice_dd.T)[order]
    mass = np.ascontiguousarray(mass_n[order])
    inertia = (0.5 if d == 2 else 0.4) * mass * body[:, 3] ** 2
    weight = np.zeros((n, 2))
    weight[:, 0] = 1.0 / mass
    if turns:
        weight[:, 1] = 1.0 / inertia
    if held_n is not None:
        weight[held_n[order]] = 0.0
    small, change = packing.box.reduced()
    skin = _SKIN / float(np.mean(1.0 / packing.diameter_n))
    flow = None
    if direction_dd is not None:
        flow = make_flow(profile, direction_dd, small)
    table = None if bonds is None else bond_table(bonds, order, home, change, None)
    built = March(
        scene=scene,
        axes=tuple(range(d)),
        order_n=order,
        home_nd=home,
        change_dd=change,
        profile=Still() if profile is None else profile,
        direction_dd=direction_dd,
        acting=Acting(pairs or None, bodies or None, friction),
        state=State(
            tuple(range(spins)),
            body,
            np.zeros((n, d + spins)),
            np.zeros((n, d + spins)),
            weight,
            mass,
            np.zeros((n, d + spins)) if lead else None,
            lead,
        ),
        space=Space(size_levels(body[:, 3].copy()), frame_of(small), flow, table),
        pairs=empty_pairs(n, d + spins, skin),
        track=empty_track(d) if friction is not None else None,
        dt=dt,
        second_order=second_order,
        threads=threads,
    )
    built.homing = homing_steps(built)
    return built


def homing_steps(march_: March) -> int:
    """Return how many steps may pass before particles are brought home; the same for every run of the same scene."""
    if march_.direction_dd is None:
        return _HOMING
    profile = march_.profile
    rate = getattr(profile, "rate", None)
    if rate is None:
        rate = getattr(profile, "amplitude", 0.0) * getattr(profile, "angular_frequency", 0.0)
    fastest = abs(float(rate)) * float(np.linalg.norm(march_.direction_dd, 2)) * march_.dt
    return max(1, min(_HOMING, int(math.floor(_SHEARED / fastest)))) if fastest > 0.0 else _HOMING


__all__ = ["GAMMA", "March", "build_march"]
