"""The engine: the arrays of a scene that is stepped through time, and what keeps them in order."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.check import brief
from packmech.constraints.compiled_links import compile_links, linked_pairs
from packmech.constraints.rattle import Rattle, along_rattle, make_rattle, project_rattle, refill_rattle
from packmech.constraints.redundancy import workable_links
from packmech.contacts.cells import frame_of, size_levels
from packmech.dynamics.bath import make_bath
from packmech.dynamics.bonds import bond_stretches, bond_table
from packmech.dynamics.book import Book, make_book
from packmech.dynamics.breaking import Breaks, broken_by, measure_loads
from packmech.dynamics.by_shape import (
    inertia_per_mass,
    most_beads,
    place_turned,
    rows_of_spins,
    shapes_in_motion,
    spins_of_rows,
    turns_of,
)
from packmech.dynamics.contact_records import record_contacts
from packmech.dynamics.deformation import (
    ALONG_X,
    GAMMA,
    NILPOTENT,
    NUMBERS,
    Driven,
    Flow,
    Still,
    course_of,
    gamma_at,
    set_flow,
)
from packmech.dynamics.faces import Faces, restore_faces
from packmech.dynamics.friction import Now, leading_share, spring_columns
from packmech.dynamics.observables import COLUMNS, POTENTIAL, TANGENTIAL, Ledger, append_due, measure
from packmech.dynamics.stability import step_condition
from packmech.dynamics.stretches import (
    Stretches,
    columns_of,
    empty_track,
    read_stretches,
    split_columns,
    write_stretches,
)
from packmech.dynamics.time_step import (
    BREAKING,
    FORCES,
    REST_OF_STEP,
    TOO_FAST,
    WHOLE_STEP,
    Acting,
    EngineArrays,
    EngineSystem,
    Rule,
    Span,
    run_steps,
)
from packmech.dynamics.wall_friction import faces_of, is_crowded, make_visited_walls, stretches_at_walls
from packmech.effects import (
    Bonds,
    Langevin,
    MeshWalls,
    Restitution,
    ViscoelasticDamping,
    Walls,
    bonds_of,
    damps,
    held_particles,
    held_velocity,
    in_loops,
    is_interaction,
    kinds_by_rows,
    langevin_of,
    memory_columns,
    reach_beyond_contact,
    refuse_memory_of_shapes,
    refuse_tangential_bonds,
    resistances,
    rough_walls,
    roughness_of,
    visited_walls,
    wall_columns,
)
from packmech.effects.single import vectors_outside
from packmech.jit.compiled import kernel
from packmech.links import Links, one_way
from packmech.loop.checkpoint import IndexBounds
from packmech.minimize.passes.kernels import RUNNING, SEARCH
from packmech.minimize.passes.kind_rows import row_kinds
from packmech.minimize.passes.pair_list import BEYOND, SKIN_FULL, PairList, Space, Track, blocks_of, empty_list, follow
from packmech.minimize.program import space_order
from packmech.packing import Packing
from packmech.result import Condition
from packmech.scene import Scene
from packmech.tangential import TangentialDisplacements

# skin of the wide pair list in units of the harmonic mean diameter
_SKIN = 0.6
# particles that left the cell are moved back every so many steps, or whenever the box has sheared by so much
WRAP_EVERY, SHEARED_ENOUGH = 1024, 0.2
# whole lattice vectors, and entries of a change of lattice vectors, beyond which no run gets
_FAR, _STEEP = 1 << 31, 1000
# how far out of the cell a particle may get before it is wrapped, in lattice vectors
_ASTRAY = 1024.0
# relative rounding of a box that followed its strain step by step
_ROUNDING = 1e-9
# arrays of the frame that follow a deforming box
_FRAME = ("lattice_dd", "inverse_dd", "height_d")
# other lattice vectors are taken where the loops' are so much flatter than the best
_FLAT = 0.7


@kernel
def _followed(axes, body, space, pairs, track):  # type: ignore[no-untyped-def]
    """Return valid lists and their track to Python: for minimizers it is not compiled how arrays are handed on."""
    return follow(axes, body, space, pairs, track)


@dataclass(eq=False)
class Engine:
    """Particles stepped through time. All arrays but wrap_nd and mass_n are by rows, sorted in space.

    Attributes
    ----------
    scene
        The scene it was built from; its box is that at gamma = 0.
    mass_n
        (N,) masses in the order of the packing.
    order_n
        (N,) particle of each row.
    wrap_nd
        (N, d) whole lattice vectors (of the scene's box, deformed) by which particles were moved.
    change_dd
        (d, d) whole numbers: the loops' lattice vectors are the scene's @ change.
    profile, direction_dd
        How the box deforms: F(t) = 1 + gamma(t) direction; no direction where it does not.
    dt, steps
        Time step and steps taken.
    second_order
        Velocity Verlet, or else semi-implicit Euler.
    resolution
        Rounding of positions at the start [length].
    wrap_every
        Particles that left the cell are moved back into it every so many steps.
    threads
        Number of threads; it changes no bit.
    force_evaluations
        Passes over the forces so far.
    row_links
        The links between rows, those that depend on others left out; None without.
    rattle
        The same as time steps take them.
    link_l
        The link of the packing that each of `row_links` is; None until somebody asks.
    breaks
        The bonds that are left of those that may break, and what broke; None where none may.
    too_long
        The longest stable time step, where this one is unstable for a single contact: no step is taken then.
    book
        Where the energy is accounted for; None unless a ledger was asked for.

    """

    scene: Scene
    mass_n: NDArray[np.float64]
    axes: tuple[int, ...]
    order_n: NDArray[np.int64]
    wrap_nd: NDArray[np.int64]
    change_dd: NDArray[np.int64]
    profile: Any
    direction_dd: NDArray[np.float64] | None
    acting: Acting
    state: EngineArrays
    space: Space
    pairs: PairList
    track: Track | None
    dt: float
    second_order: bool
    resolution: float
    steps: int = 0
    started: bool = False
    wrap_every: int = WRAP_EVERY
    threads: int = 1
    force_evaluations: int = 0
    row_links: Links | None = None
    rattle: Rattle | None = None
    link_l: NDArray[np.int64] | None = None
    breaks: Breaks | None = None
    too_long: Condition | None = None
    book: Book | None = None

    @property
    def time(self) -> float:
        """Time since the start."""
        return self.steps * self.dt

    @property
    def system(self) -> EngineSystem:
        """All that the compiled loops move."""
        account = None if self.book is None else self.book.account_for(self.track)
        return EngineSystem(
            self.acting, self.axes, self.state, self.rattle, self.space, self.pairs, self.track, account
        )

    @property
    def faces(self) -> Faces | None:
        """The faces of walls that move; None where all stand still."""
        found: Faces | None = faces_of(self.acting.walls)
        return found

    @property
    def is_crowded(self) -> bool:
        """Whether a sphere has touched a rough surface of triangles at more places than it has springs for."""
        return is_crowded(self.acting.walls)

    @property
    def rule(self) -> Rule:
        """How steps are taken; nothing may move by the smallest diameter in one of them."""
        return Rule(self.dt, self.second_order, 2.0 * float(self.state.body[:, 3].min()))

    @property
    def now(self) -> Now:
        """The time of the force taken last, for what looks at tangential springs."""
        return Now(0.5 * self.dt if self.second_order else self.dt)

    @property
    def gamma(self) -> float:
        """Strain of the box now."""
        return 0.0 if self.space.flow is None else float(gamma_at(self.profile, self.time)[0])

    @property
    def bonds(self) -> Bonds | None:
        """The bonds that are left; None in a scene without."""
        return bonds_of(self.scene.effects) if self.breaks is None else self.breaks.left

    @property
    def effects(self) -> tuple[Any, ...]:
        """The effects of the scene with the bonds that are left."""
        if self.breaks is None:
            return self.scene.effects
        return tuple(self.breaks.left if one is self.breaks.whole else one for one in self.scene.effects)

    def released(self, time: float) -> float:
        """Return the energy that breaking bonds released until a time [energy]."""
        return 0.0 if self.breaks is None else self.breaks.released(round(time / self.dt))

    @property
    def free_mass(self) -> float:
        """Mass of all that is not held."""
        return float(self.mass_n[self.order_n][self.state.weight_nk[:, 0] > 0.0].sum())

    def limits(self) -> tuple[Condition, ...]:
        """Return the limit that the time step does not keep, if there is one."""
        return () if self.too_long is None else (self.too_long,)

    def box(self, steps: int | None = None) -> Box:
        """Return the box after so many steps, now unless given: the scene's, deformed."""
        if self.direction_dd is None:
            return self.scene.packing.box
        time = (self.steps if steps is None else steps) * self.dt
        gamma = 0.0 if self.space.flow is None else float(gamma_at(self.profile, time)[0])
        return Box((np.eye(len(self.axes)) + gamma * self.direction_dd) @ self.scene.packing.box.lattice_dd)

    def positions(self) -> NDArray[np.float64]:
        """Return the (N, d) positions in the order of the packing, never wrapped [length]."""
        d = len(self.axes)
        position = np.empty((len(self.order_n), d))
        position[self.order_n] = self.state.body[:, :d]
        return np.asarray(position + self.wrap_nd @ self.box().lattice_dd.T)

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
        spin, row = np.empty((len(self.order_n), turns)), self.state.body[:, 4 + d : 4 + d + turns]
        spin[self.order_n] = row if d == 2 else spins_of_rows(self.acting.shapes, row)
        return spin

    def set_velocities(self, velocity_nd: NDArray[np.float64]) -> None:
        """Set the (N, d) peculiar velocities in the order of the packing, and the forces that belong to them.

        What is held goes on as it does; what would stretch links is left out.
        """
        d = len(self.axes)
        velocity = velocity_nd[self.order_n]
        held = self.state.weight_nk[:, 0] == 0.0
        velocity[held] = self.state.body[held, 4 : 4 + d]
        along_rattle(self.rattle, velocity)
        self.state.body[:, 4 : 4 + d] = velocity
        self.begin()

    def thermal_velocities(self, temperature: float, rng: np.random.Generator) -> NDArray[np.float64]:
        """Return (N, d) random velocities without total momentum, along the links, of just the kinetic energy."""
        d = len(self.axes)
        free = np.empty(len(self.mass_n), dtype=bool)
        free[self.order_n] = self.state.weight_nk[:, 0] > 0.0
        mass = self.mass_n[:, None]
        draw = rng.standard_normal((len(self.mass_n), d)) * np.sqrt(temperature / mass) * free[:, None]
        freedom = int(free.sum()) * d
        if free.all():
            draw -= (mass * draw).sum(axis=0) / mass.sum()
            freedom -= d
        if self.rattle is not None:
            row = draw[self.order_n]
            freedom -= along_rattle(self.rattle, row)
            draw[self.order_n] = row
        kinetic = 0.5 * float((mass * draw**2).sum())
        if freedom <= 0 or not kinetic > 0.0:
            raise ValueError(f"temperature must be left out where nothing can move, got {temperature:g}")
        return np.asarray(draw * math.sqrt(0.5 * freedom * temperature / kinetic))

    def begin(self, ledger: Ledger | None = None) -> None:
        """Take the forces of the present state, in the same loop as steps with this ledger."""
        if self.space.flow is not None:
            set_flow(self.space.flow, self.space.frame, self.time)
        self._follow()
        given = self.scene.packing.tangential
        if self.steps == 0 and given is not None:
            if self.track is not None:
                self._set_springs(given)
            if rough_walls(self.scene.effects):
                assert self.acting.walls is not None
                used, columns = wall_columns(rough_walls(self.scene.effects), len(self.axes))
                whole = given.at_walls(len(self.order_n), columns)
                self.acting.walls.stretch_nk[:] = whole[self.order_n][:, used]
        self._take_forces(ledger)
        if self.state.last is not None:
            self.state.last[:] = self.state.push
        if self.book is not None:
            self.book.keep(self.steps)
        self.started = True
        self.force_evaluations += 1

    def go_on_with_book_of(self, engine: Engine) -> None:
        """Account for the energy from where another engine of the same particles ended."""
        assert self.book is not None and engine.book is not None
        self.book.go_on_from(engine.book, engine.order_n, self.row_n, (engine.steps, engine.time))

    def advance(self, steps: int, ledger: Ledger | None = None) -> int:
        """Advance by up to `steps` steps; return how that ended."""
        if not self.started:
            self.begin(ledger)
        if self.too_long is not None:
            return TOO_FAST
        start, left = WHOLE_STEP, steps
        while left > 0:
            due = min(left, self.wrap_every - self.steps % self.wrap_every)
            if self.book is not None:
                due = min(due, self.book.until_next(self.steps))
            span = Span(start, self.steps, due)
            status, taken = run_steps(self.system, ledger, self.threads, span, self.rule)
            self.steps += taken
            self.force_evaluations += taken
            left -= taken
            if status == SEARCH:
                self._follow()
                start = REST_OF_STEP
                continue
            if status == BREAKING:
                self._break_bonds(ledger)
            elif status != RUNNING:
                return status
            start = WHOLE_STEP
            if self.book is not None:
                self.book.keep_due(self.steps)
            if self.steps % self.wrap_every == 0:
                self.wrap()
        return RUNNING

    def _break_bonds(self, ledger: Ledger | None) -> None:
        """Take out the bonds that are beyond a limit, and write what is due of the step at whose end they broke."""
        table, loads = self.space.bonds, measure_loads(self.system, self.now)
        mode = broken_by(table, loads.load_bk)
        broken = np.flatnonzero(mode >= 0)
        # none where a load equals its limit but for rounding, which the loop of time steps does in another order
        if len(broken):
            assert self.breaks is not None
            before = self._potential_energy()
            self.breaks.add(table.place_b[broken], mode[broken], loads.load_bk[broken], self.steps)
            if self.book is not None:
                self.book.mark()
            self._go_on_without(table.place_b, broken, loads.stretch_bk, ledger)
            if self.book is not None:
                self.book.release()
            self.breaks.released_s[-1] = before - self._potential_energy()
        append_due(ledger, self.system, self.steps, self.now, self.dt)

    def _go_on_without(
        self,
        place_b: NDArray[np.int64],
        broken: NDArray[np.int64],
        stretch_bk: NDArray[np.float64],
        ledger: Ledger | None,
    ) -> None:
        """Rebuild the table of bonds without the broken ones, and evaluate the forces, as at the start of a run.

        Parameters
        ----------
        place_b, broken
            Places of the bonds of the table among those that were left, and which of the table broke.
        stretch_bk
            Present displacements of the tangential springs, in the table's order.
        ledger
            Of the loop that takes the forces.

        """
        # springs are ahead of the time by the slip of what is to come, which the forces add again
        now = record_contacts(self.system, self.now).stretch_pk
        held = read_stretches(self.pairs, None if now is None else Track(now, now), self._spring_columns)
        keep, stretch = np.ones(len(place_b), dtype=bool), np.empty_like(stretch_bk)
        keep[place_b[broken]], stretch[place_b] = False, stretch_bk
        bonds = self.bonds
        assert bonds is not None
        table = bond_table(bonds, self.order_n, self.wrap_nd, self.change_dd, stretch[keep])
        self.space = self.space._replace(bonds=table)
        self._empty_lists()
        self.rebuild_lists(held)
        self._take_forces(ledger)
        if self.state.last is not None:
            self.state.last[:] = self.state.push
        self.force_evaluations += 1

    def _potential_energy(self) -> float:
        """Return the energy of all that acts now, of tangential springs too [energy]."""
        out = np.zeros(COLUMNS)
        measure(self.system, self.time, self.now, out)
        return float(out[POTENTIAL] + out[TANGENTIAL])

    def _take_forces(self, ledger: Ledger | None = None) -> None:
        run_steps(self.system, ledger, self.threads, Span(FORCES, self.steps, 1), self.rule)

    def _follow(self) -> None:
        self.pairs, self.track = _followed(self.axes, self.state.body, self.space, self.pairs, self.track)

    def observe(self) -> NDArray[np.float64]:
        """Return the observables of the present time, in the columns of `observables`; it changes no bit."""
        if not self.started:
            self.begin()
        out, push = np.zeros(COLUMNS), None
        if self.rattle is not None and self.track is None and self.space.bonds is None and self.acting.walls is None:
            # links bear what dashpots do at the velocities now, not at those that a step extrapolated
            push = self.state.push.copy()
            self._take_forces()
        measure(self.system, self.time, self.now, out)
        if push is not None:
            self.state.push[:] = push
        return out

    def tensions(self) -> NDArray[np.float64]:
        """Return the (L,) tensions of the packing's links that `observe` measured [force]; none in redundant ones."""
        whole, own = self.scene.packing.links, self.row_links
        if own is None or self.rattle is None:
            return np.zeros(0)
        if self.link_l is None:
            i, j = self.order_n[own.i_l], self.order_n[own.j_l]
            image = own.image_ld @ self.change_dd.T - self.wrap_nd[j] + self.wrap_nd[i]
            self.link_l = whole.find(i, j, image)
        tension = np.zeros(len(whole))
        tension[self.link_l] = self.rattle.tension_l
        return tension

    def stretches(self) -> Stretches:
        """Return the springs that are stretched, by rows and images of the loops' lattice."""
        return read_stretches(self.pairs, self.track, self._spring_columns)

    @property
    def _spring_columns(self) -> int:
        """Numbers of the springs of one touch, and those that interactions keep of the pair."""
        return len(spring_columns(self.acting.friction, self.axes)) + self._memory

    @property
    def _memory(self) -> int:
        """How many numbers interactions keep of each pair."""
        return memory_columns(self.scene.effects)

    def _set_springs(self, given: TangentialDisplacements) -> None:
        """Set the springs of the listed pairs to the packing's displacements, which the first forces are made of."""
        d, row = len(self.axes), self.row_n
        whole = given.image_cd + self.wrap_nd[given.j_c] - self.wrap_nd[given.i_c]
        image = whole @ np.rint(np.linalg.inv(self.change_dd)).astype(np.int64).T
        i, j, image, turned = one_way(row[given.i_c], row[given.j_c], image)
        spring = columns_of(self.acting.friction, self.axes, given, turned, self._memory)
        bead = np.zeros((len(i), 2), dtype=np.int64) if given.bead_c2 is None else given.bead_c2
        bead = np.where(turned[:, None], bead[:, ::-1], bead)
        full = np.zeros((len(i), 3), dtype=np.int64)
        full[:, :d] = image
        write_stretches(self.pairs, self.track, Stretches(i, j, full, bead, spring))

    def tangential(self) -> TangentialDisplacements | None:
        """Return the displacements of the tangential springs of contacts and walls now; None where all are slack."""
        if not self.started:
            return self.scene.packing.tangential
        found, at_walls = self._between_particles(), stretches_at_walls(self.system, self.now)[self.row_n]
        particle = np.flatnonzero(at_walls.any(axis=1))
        if not len(particle) or not np.isfinite(at_walls).all():
            return found
        used, columns = wall_columns(rough_walls(self.scene.effects), len(self.axes))
        whole = np.zeros((len(particle), columns))
        whole[:, used] = at_walls[particle]
        walls: dict[str, Any] = {"at_wall_w": particle, "wall_stretch_wk": whole}
        if found is not None:
            return replace(found, **walls)
        d = len(self.axes)
        none, image = np.zeros(0, dtype=np.int64), np.zeros((0, d), dtype=np.int64)
        return TangentialDisplacements(none, none, image, np.zeros((0, 1 if d == 2 else 3)), **walls)

    def bond_displacements(self) -> NDArray[np.float64] | None:
        """Return the (B, 1 or 3) displacements of the tangential springs of bonds now; None without."""
        table = self.space.bonds
        if table is None or not table.tangential_stiffness > 0.0:
            return None
        found: NDArray[np.float64] = np.empty_like(table.stretch_bk)
        found[table.place_b] = measure_loads(self.system, self.now).stretch_bk
        return found

    @property
    def row_n(self) -> NDArray[np.int64]:
        """Row of each particle."""
        row = np.empty_like(self.order_n)
        row[self.order_n] = np.arange(len(row))
        return row

    def _between_particles(self) -> TangentialDisplacements | None:
        """Return the displacements of the contacts' springs now; None where all are slack."""
        friction = self.acting.friction
        memory = self._memory
        springs = any(one.coefficient and one.stiffness for one in resistances(friction))
        if self.track is None or not (memory or springs):
            return None
        now = record_contacts(self.system, self.now).stretch_pk
        # a run that went astray has nothing to hand on
        if now is None or not now.any() or not np.isfinite(now).all():
            return None
        held = read_stretches(self.pairs, Track(now, now), self._spring_columns)
        # from rows and images of the loops' lattice to particles, their places and the scene's box
        i, j = self.order_n[held.i_c], self.order_n[held.j_c]
        image = held.image_cd[:, : len(self.axes)] @ self.change_dd.T - self.wrap_nd[j] + self.wrap_nd[i]
        bead = held.bead_c2 if self.scene.packing.shapes.has_beads else None
        columns = self._spring_columns - memory
        sliding, rolling, twisting = split_columns(friction, self.axes, held.stretch_ck[:, :columns])
        numbers = held.stretch_ck[:, columns:] if memory else None
        return TangentialDisplacements(i, j, image, sliding, bead, rolling, twisting, numbers)

    def packing(self) -> Packing:
        """Return the packing as it is now, with its box, turns and tangential displacements."""
        return self.packing_at(self.positions(), self.orientations(), self.box(), self.tangential())

    def packing_at(
        self,
        position_nd: NDArray[np.float64],
        orientation_nq: NDArray[np.float64] | None,
        box: Box,
        tangential: TangentialDisplacements | None = None,
    ) -> Packing:
        """Return the packing with these places and orientations (None without shapes)."""
        shapes = self.scene.packing.shapes
        if orientation_nq is not None:
            shapes = shapes.oriented(orientation_nq)
        return self.scene.packing.replace(position_nd=position_nd, box=box, tangential=tangential, shapes=shapes)

    def orientations(self) -> NDArray[np.float64] | None:
        """Return (N, q) directors, or what says how bodies are turned, in the packing's order; None without shapes."""
        shapes = self.scene.packing.shapes
        if not shapes.has_orientations:
            return None
        turned = np.empty_like(shapes.orientation_nq)
        turned[self.order_n] = turns_of(self.acting.shapes)[:, : turned.shape[1]]
        return turned

    def wrap(self) -> None:
        """Move particles that left the cell by whole lattice vectors, and take better ones where these are flat."""
        d = len(self.axes)
        body = self.state.body
        frame = self.space.frame
        lattice = frame.lattice_dd[:d, :d]
        fraction = body[:, :d] @ frame.inverse_dd[:d, :d].T
        shift = np.where((fraction < -1.0) | (fraction >= 2.0), np.floor(fraction), 0.0).astype(np.int64)
        for one in self.scene.effects:
            if isinstance(one, Walls) and one.moves:
                # what is between two walls stays there, wherever they go
                shift[:, np.abs(lattice[int(one.axis)]).argmax()] = 0
            if isinstance(one, MeshWalls):
                shift[:] = 0
        change = np.eye(d, dtype=np.int64)
        # the smallest height of any cell of this volume is at most the side of a cube
        side = abs(float(np.linalg.det(lattice))) ** (1.0 / d)
        if self.space.flow is not None and frame.height_d[:d].min() < _FLAT * side:
            loops = Box(lattice)
            reduced, other = loops.reduced()
            if loops.height_d.min() < _FLAT * reduced.height_d.min():
                change = other
        turned = not np.array_equal(change, np.eye(d, dtype=np.int64))
        if not shift.any() and not turned:
            return
        held = self.stretches()
        before = 0.0 if self.book is None else self._potential_energy()
        body[:, :d] -= shift @ lattice.T
        self.wrap_nd[self.order_n] += shift @ self.change_dd.T
        back = np.rint(np.linalg.inv(change)).astype(np.int64)
        self.change_dd = self.change_dd @ change
        self.rebuild()
        # lengths held to rounding in one cell are not in another
        project_rattle(self.rattle, body, self.space.frame.lattice_dd)
        self.rebuild_lists(held.moved(shift, back, self._memory))
        if self.book is not None and self.acting.bodies is not None:
            self.book.shift(before - self._potential_energy())

    def rebuild(self) -> None:
        """Rebuild the frame, the images of bonds and links, and empty lists."""
        start = Box(self.scene.packing.box.lattice_dd @ self.change_dd)
        frame = frame_of(start)
        flow = None
        if self.direction_dd is not None:
            flow = make_flow(self.profile, self.direction_dd, start)
            set_flow(flow, frame, self.time)
        table = self.space.bonds
        if table is not None:
            bonds = self.bonds
            assert bonds is not None
            table = bond_table(bonds, self.order_n, self.wrap_nd, self.change_dd, bond_stretches(table))
        self.space = Space(self.space.sizes, frame, bonds=table, flow=flow, held=self.space.held)
        self._link_rows()
        self._empty_lists()

    def _empty_lists(self) -> None:
        """Empty the pair lists; tangential springs of the pairs in them are dropped."""
        skin, beyond = (float(self.pairs.number[one]) for one in (SKIN_FULL, BEYOND))
        self.pairs = empty_list(len(self.order_n), skin, beyond, row_b=self.pairs.row_b, width=self.state.push.shape[1])
        if self.track is not None:
            self.track = empty_track(self._spring_columns, most_beads(self.scene.packing))

    def _link_rows(self) -> None:
        packing = self.scene.packing
        if not packing.links:
            return
        workable = workable_links(packing)
        wrap_nd = self.wrap_nd.astype(np.float64)
        self.row_links, links = compile_links(packing, workable, self.order_n, wrap_nd, self.change_dd)
        self.link_l = None
        self.rattle = make_rattle(links, self.state.weight_nk[:, 0].copy(), self.resolution)
        self.space = self.space._replace(links=linked_pairs(links))

    def rebuild_lists(self, held: Stretches) -> None:
        """Make the lists at the present positions and give their springs these stretches; forces stay as they are."""
        self._follow()
        write_stretches(self.pairs, self.track, held)

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return what a run cannot rebuild from scene and settings, by name: `restore` goes on with the same bits."""
        state, space, held = self.state, self.space, self.stretches()
        found: dict[str, Any] = {
            "steps": np.array(self.steps),
            "force_evaluations": np.array(self.force_evaluations),
            "wrap_nd": self.wrap_nd.copy(),
            "change_dd": self.change_dd.copy(),
            "row_nk": state.body.copy(),
            "push_nk": state.push.copy(),
            "turn_nq": turns_of(self.acting.shapes).copy(),
        }
        if state.last is not None:
            found["last_push_nk"] = state.last.copy()
        if self.track is not None:
            found |= {f"stretch.{name}": value for name, value in held._asdict().items()}
        if self.acting.walls is not None:
            found["wall_stretch_nk"] = self.acting.walls.stretch_nk.copy()
        if self.faces is not None:
            found["face_fk"] = self.faces.number_fk.copy()
        if space.bonds is not None:
            found["bond_stretch_bk"] = bond_stretches(space.bonds)
        if self.breaks is not None:
            found |= self.breaks.arrays()
        if self.book is not None:
            found |= self.book.arrays()
        if self.rattle is not None:
            found["link_number"] = self.rattle.number.copy()
        if space.flow is not None:
            # the last step's, whose time was summed in another order than `time`
            found |= {f"frame.{name}": getattr(space.frame, name).copy() for name in _FRAME}
            found["rate_dd"], found["gamma"] = space.flow.rate_dd.copy(), np.array(space.flow.number[GAMMA])
            found["profile"] = _numbers(self.profile)
        return {f"engine.{name}": np.asarray(value) for name, value in found.items()}

    def index_bounds(self) -> dict[str, IndexBounds]:
        """Return what the integers in `arrays` may be."""
        n, d = len(self.order_n), len(self.axes)
        bounds = {
            "steps": IndexBounds(0, 1 << 62, ()),
            "force_evaluations": IndexBounds(0, 1 << 62, ()),
            "wrap_nd": IndexBounds(-_FAR, _FAR, (n, d)),
            "change_dd": IndexBounds(-_STEEP, _STEEP + 1, (d, d)),
            "stretch.i_c": IndexBounds(0, n, (None,)),
            "stretch.j_c": IndexBounds(0, n, (None,)),
            "stretch.image_cd": IndexBounds(-_FAR, _FAR, (None, 3)),
            "stretch.bead_c2": IndexBounds(0, most_beads(self.scene.packing), (None, 2)),
            "book.every": IndexBounds(1, 1 << 62, ()),
            "book.step_t": IndexBounds(0, 1 << 62, (None,)),
            **({} if self.breaks is None else self.breaks.index_bounds()),
        }
        return {f"engine.{name}": bound for name, bound in bounds.items()}

    def restore(self, arrays: Mapping[str, Any]) -> None:
        """Go where the engine was whose `arrays` these are; this one was built for the same scene and settings."""

        def saved(name: str, like: Any) -> NDArray[Any]:
            value = np.asarray(arrays.get(f"engine.{name}"))
            if value.shape != np.shape(like) or value.dtype != np.asarray(like).dtype:
                raise ValueError(
                    f"engine.{name} must be {np.asarray(like).dtype} of shape {np.shape(like)}, got {value.dtype} of "
                    f"{value.shape}"
                )
            # a strain may go on without end
            if name != "profile" and value.dtype.kind == "f" and not np.isfinite(value).all():
                raise ValueError(f"engine.{name} must be finite, got {value[~np.isfinite(value)].flat[0]}")
            return value

        state = self.state
        self.steps = int(saved("steps", 0))
        self.force_evaluations = int(saved("force_evaluations", 0))
        self.wrap_nd = saved("wrap_nd", self.wrap_nd).copy()
        self.change_dd = saved("change_dd", self.change_dd).copy()
        if abs(round(float(np.linalg.det(self.change_dd)))) != 1:
            raise ValueError(f"engine.change_dd must have the determinant 1 or -1, got {self.change_dd.tolist()}")
        radius_n = state.body[:, 3].copy()
        state.body[:] = saved("row_nk", state.body)
        state.body[:, 3] = radius_n
        state.push[:] = saved("push_nk", state.push)
        if state.last is not None:
            state.last[:] = saved("last_push_nk", state.last)
        turn_nq = turns_of(self.acting.shapes)
        turn_nq[:] = saved("turn_nq", turn_nq)
        place_turned(self.acting.shapes)
        if self.space.flow is not None:
            numbers = saved("profile", _numbers(self.profile))
            if not isinstance(self.profile, Driven):
                self.set_profile(type(self.profile)(*numbers.tolist()))
        if self.breaks is not None:
            self.breaks.restore({name: arrays.get(f"engine.{name}") for name in self.breaks.arrays()})
            table = bond_table(self.breaks.left, self.order_n, self.wrap_nd, self.change_dd, None)
            self.space = self.space._replace(bonds=table)
        if self.space.bonds is not None:
            table = self.space.bonds
            table.stretch_bk[:] = saved("bond_stretch_bk", table.stretch_bk)[table.place_b]
        self.rebuild()
        space = self.space
        if space.flow is not None:
            for name in _FRAME:
                own = getattr(space.frame, name)
                value = saved(f"frame.{name}", own)
                if not np.allclose(value, own, rtol=_ROUNDING, atol=_ROUNDING * float(np.abs(own).max())):
                    raise ValueError(f"engine.frame.{name} must be that of the box at this strain, got another")
                own[:] = value
            space.flow.rate_dd[:] = saved("rate_dd", space.flow.rate_dd)
            space.flow.number[GAMMA] = float(saved("gamma", 0.0))
        d = len(self.axes)
        astray = float(np.abs(state.body[:, :d] @ space.frame.inverse_dd[:d, :d].T).max())
        if not astray < _ASTRAY:
            raise ValueError(f"engine.row_nk must hold places near the cell, got one {astray:g} lattice vectors away")
        if self.book is not None:
            self.book.restore(saved, len(np.atleast_1d(arrays.get("engine.book.step_t", ()))))
        if self.acting.walls is not None:
            self.acting.walls.stretch_nk[:] = saved("wall_stretch_nk", self.acting.walls.stretch_nk)
        if self.faces is not None:
            restore_faces(self.faces, saved("face_fk", self.faces.number_fk))
        if self.rattle is not None:
            refill_rattle(self.rattle, state.body, space.frame.lattice_dd)
            self.rattle.number[:] = saved("link_number", self.rattle.number)
        if self.track is None:
            self.rebuild_lists(self.stretches())
        else:
            missing = [name for name in Stretches._fields if f"engine.stretch.{name}" not in arrays]
            if missing:
                raise ValueError(f"engine.stretch must hold {', '.join(missing)}, got none")
            pairs = len(arrays["engine.stretch.i_c"])
            stretch = saved("stretch.stretch_ck", np.zeros((pairs, self._spring_columns)))
            image, bead = (
                saved(f"stretch.{name}", np.zeros((pairs, k), dtype=np.int64))
                for name, k in (("image_cd", 3), ("bead_c2", 2))
            )
            i, j = (saved(f"stretch.{name}", np.zeros(pairs, dtype=np.int64)) for name in ("i_c", "j_c"))
            self.rebuild_lists(Stretches(i, j, image, bead, stretch))
        self.started = True

    def set_profile(self, profile: Any) -> None:
        """Let the box deform in another way from here on; both are of one kind."""
        self.profile = profile
        if self.space.flow is not None:
            self.space = self.space._replace(flow=self.space.flow._replace(course=course_of(profile)))
        self.wrap_every = _steps_between_wraps(profile, self.direction_dd, self.dt)


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
    return Flow(course_of(profile), direction, lattice, np.zeros((3, 3)), np.eye(3), np.eye(3), np.eye(3), number)


def _numbers(profile: Any) -> NDArray[np.float64]:
    """Return the numbers of a profile."""
    return np.hstack(list(profile)).astype(np.float64)


def refuse_misfits(scene: Scene) -> None:
    """Refuse bonds of particles or of a dimension that are not the packing's, or whose ends coincide.

    Bonds without a length have no direction to push in.
    """
    _refuse_shapes(scene)
    _refuse_idle_dashpots(scene)
    position, lattice = scene.packing.position_nd, scene.packing.box.lattice_dd
    n, d = position.shape
    for k, one in enumerate(scene.effects):
        if not isinstance(one, Bonds) or not len(one):
            continue
        if one.image_bd.shape[1] != d:
            raise ValueError(f"scene.effects[{k}].image_bd must have shape ({len(one)}, {d}), got {one.image_bd.shape}")
        if int(one.j_b.max()) >= n:
            # i < j
            bond = int(one.j_b.argmax())
            raise ValueError(f"scene.effects[{k}].j_b must be below {n}, got {int(one.j_b[bond])} for bond {bond}")
        length = np.linalg.norm(position[one.j_b] - position[one.i_b] + one.image_bd @ lattice.T, axis=1)
        smallest = int(np.argmin(length))
        if length[smallest] == 0.0:
            raise ValueError(f"scene.effects must hold bonds whose ends are apart, got no length for bond {smallest}")


def _refuse_idle_dashpots(scene: Scene) -> None:
    """Refuse dashpots by restitution or viscosity beside interactions alone: their size follows from a repulsion."""
    springs = any(hasattr(type(one), "pair_energy") for one in scene.effects)
    for k, one in enumerate(scene.effects):
        if isinstance(one, Restitution | ViscoelasticDamping) and memory_columns(scene.effects) and not springs:
            kind = type(one).__qualname__
            raise ValueError(
                f"scene.effects must hold a Repulsion for {kind}, whose dashpots follow from its stiffness, got {kind} "
                f"at {k} beside interactions alone: take pm.ContactDamping"
            )


def _refuse_shapes(scene: Scene) -> None:
    """Refuse tangential springs of bonds, and what would take shapes for discs or spheres."""
    shapes = scene.packing.shapes
    if not shapes.has_orientations:
        return
    refuse_tangential_bonds(scene.effects, shapes)
    refuse_memory_of_shapes(scene.effects, scene.packing)
    for k, one in enumerate(scene.effects):
        kind = type(one).__qualname__
        own_walls = getattr(one, "acts_as", None) == "walls" and not isinstance(one, Walls)
        if own_walls:
            raise ValueError(
                f"scene.effects must hold no {kind} for {type(shapes).__name__}, which it "
                f"would take for discs or spheres, got it at {k}: leave it out with scene.without(pm.{kind})"
            )


def build_engine(
    scene: Scene,
    *,
    dt: float,
    velocity_nd: NDArray[np.float64],
    spin_nk: NDArray[np.float64] | None = None,
    profile: Any = None,
    direction_dd: NDArray[np.float64] | None = None,
    held_n: NDArray[np.bool_] | None = None,
    second_order: bool = True,
    threads: int = 1,
    ledger_every: int | None = None,
    bond_stretch_bk: NDArray[np.float64] | None = None,
) -> Engine:
    """Return the engine of a scene, ready to advance; velocities are peculiar ones.

    Parameters
    ----------
    scene
        The scene; with rigid links only in a box that does not deform.
    dt
        Time step.
    velocity_nd, spin_nk
        (N, d) peculiar velocities, (N, 1 or 3) spins; None: at rest.
    profile, direction_dd
        How the box deforms; None: it does not.
    held_n
        (N,) particles that nothing pushes.
    second_order
        Velocity Verlet, or else semi-implicit Euler.
    threads
        Number of threads; it changes no bit.
    ledger_every
        Energies are accounted for, and figures kept every so many steps; None: not.
    bond_stretch_bk
        (B, 1 or 3) displacements of the tangential springs of bonds; slack unless given.

    """
    packing, d = scene.packing, scene.packing.dimension
    mass_n = packing.mass_n
    refuse_misfits(scene)
    if direction_dd is not None and packing.links:
        raise ValueError(
            "scene.packing must have no rigid links where the box deforms: they are held in a box at rest only, got "
            f"{len(packing.links)} links"
        )
    pairs = tuple(
        one for one in scene.effects if hasattr(type(one), "pair_energy") or damps(one) or is_interaction(one)
    )
    moving = tuple(one for one in scene.effects if isinstance(one, Walls) and one.moves)
    if moving and direction_dd is not None:
        raise ValueError(
            "scene.effects must hold no Walls that move where the box deforms, got "
            f"{moving[0].low_motion!r} and {moving[0].high_motion!r}"
        )
    friction, bonds = roughness_of(scene.effects), bonds_of(scene.effects)
    langevin = _bath_of(scene, second_order)
    shapes, memory = packing.shapes, memory_columns(scene.effects)
    row_b, order = blocks_of(packing.particles), space_order(packing)
    kind_n = kinds_by_rows(packing, order)
    # walls that move push rows where these are walked past walls
    acting = [one for one in scene.effects if hasattr(type(one), "body_force") and one not in moving]
    bodies = tuple(in_loops(one, kind_n) for one in acting)
    walls = make_visited_walls(visited_walls(scene.effects), packing.box, kind_n, tuple(range(d)), len(row_b) - 1)
    turns = bool(friction is not None or bonds is not None or shapes.has_orientations or rough_walls(scene.effects))
    spins = 0 if not turns else 1 if d == 2 else 3
    lead = leading_share(scene, dt, float(mass_n.min())) if second_order else 0.0
    n = packing.particles
    body = aligned_rows(n, 4 + d + spins)
    body[:, 3] = shapes.reach(packing.radius_n)[order]
    body[:, 4 : 4 + d] = velocity_nd[order]
    wrap = vectors_outside(scene.effects, packing).astype(np.int64)
    body[:, :d] = (packing.position_nd - wrap @ packing.box.lattice_dd.T)[order]
    mass = np.ascontiguousarray(mass_n[order])
    shape = shapes_in_motion(packing, order)
    inertia = mass * inertia_per_mass(shape, body[:, 3], d)
    if turns and spin_nk is not None:
        row = spin_nk[order]
        body[:, 4 + d : 4 + d + spins] = row if d == 2 else rows_of_spins(shape, row)
    weight = np.zeros((n, 2))
    weight[:, 0] = 1.0 / mass
    if turns:
        weight[:, 1] = 1.0 / inertia
    fixed_n = held_particles(scene.effects, n)
    for held in (held_n, fixed_n):
        if held is not None:
            weight[held[order]] = 0.0
    if fixed_n is not None:
        body[:, 4 : 4 + d][fixed_n[order]] = held_velocity(scene.effects, n, d)[order[fixed_n[order]]]
        if shapes.has_orientations:
            body[fixed_n[order], 4 + d :] = 0.0
    small, change = packing.box.reduced()
    skin = _SKIN / float(np.mean(1.0 / packing.diameter_n))
    flow = None
    if direction_dd is not None:
        flow = make_flow(profile, direction_dd, small)
    table = None if bonds is None else bond_table(bonds, order, wrap, change, bond_stretch_bk)
    extent = max(float(np.abs(body[:, :d]).max()), float(np.abs(small.lattice_dd).max()))
    built = Engine(
        scene=scene,
        mass_n=mass_n,
        axes=tuple(range(d)),
        order_n=order,
        wrap_nd=wrap,
        change_dd=change,
        profile=Still() if profile is None else profile,
        direction_dd=direction_dd,
        acting=Acting((*pairs, *row_kinds(scene, order)) if pairs else None, bodies or None, friction, shape, walls),
        state=EngineArrays(
            tuple(range(spins)),
            body,
            np.zeros((n, d + spins)),
            np.zeros((n, d + spins)),
            weight,
            mass,
            np.zeros((n, d + spins)) if lead else None,
            lead,
            make_bath(langevin, dt, order),
        ),
        space=Space(
            size_levels(body[:, 3].copy()),
            frame_of(small),
            bonds=table,
            flow=flow,
            held=None if fixed_n is None else fixed_n[order],
        ),
        pairs=empty_list(n, skin, reach_beyond_contact(scene.effects, packing), row_b=row_b, width=d + spins),
        track=None
        if friction is None and not memory
        else empty_track(len(spring_columns(friction, tuple(range(d)))) + memory, most_beads(packing)),
        dt=dt,
        second_order=second_order,
        resolution=np.finfo(np.float64).eps * extent,
        wrap_every=_steps_between_wraps(profile, direction_dd, dt),
        threads=threads,
        breaks=None if bonds is None or bonds.breaks_at is None else Breaks(bonds),
        too_long=step_condition(scene, dt, _in_order(weight[:, 0], order), second_order=second_order, lead=lead),
    )
    if ledger_every is not None:
        if langevin is not None and flow is not None:
            raise ValueError(
                "scene.effects must have no Langevin where energies are accounted for in a box that deforms, as both "
                f"change velocities between kicks, got {brief(langevin)}"
            )
        built.book = make_book(scene, body, d + spins, len(built.pairs.row_b) - 1, walls, ledger_every)
    built._link_rows()
    project_rattle(built.rattle, body, built.space.frame.lattice_dd)
    return built


def _bath_of(scene: Scene, second_order: bool) -> Langevin | None:
    """Return the bath of a scene, refused where steps do not sample it."""
    found = langevin_of(scene.effects)
    if found is not None and scene.packing.links:
        raise ValueError(
            "scene.packing must have no rigid links beside Langevin, whose kicks would stretch them, got "
            f"{len(scene.packing.links)}: use stiff pm.Bonds, or leave it out with scene.without(pm.Langevin)"
        )
    if found is not None and not second_order:
        raise ValueError("method must be VelocityVerlet() with Langevin, got SemiImplicitEuler()")
    return found


def _in_order(value: NDArray[np.float64], order_n: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return values of rows in the order of the packing."""
    found = np.empty_like(value)
    found[order_n] = value
    return found


def _steps_between_wraps(profile: Any, direction_dd: NDArray[np.float64] | None, dt: float) -> int:
    """Return how many steps may pass before particles are wrapped; the same for every run of the same scene."""
    if direction_dd is None:
        return WRAP_EVERY
    rate = getattr(profile, "rate", None)
    if rate is None:
        rate = getattr(profile, "amplitude", 0.0) * getattr(profile, "angular_frequency", 0.0)
    fastest = abs(float(rate)) * float(np.linalg.norm(direction_dd, 2)) * dt
    # a rate that is almost none would overflow the quotient
    return WRAP_EVERY if WRAP_EVERY * fastest <= SHEARED_ENOUGH else max(1, math.floor(SHEARED_ENOUGH / fastest))
