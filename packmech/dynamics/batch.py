# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Batches of sheared packings, advanced frame by frame, as a caller controls them."""

from __future__ import annotations

import math
import weakref
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, NamedTuple

import numpy as np
from numba.typed import List
from numpy.typing import ArrayLike, NDArray

from packmech.calls.honors import declare
from packmech.check import MOST_STEPS, boolean, brief, finite_array, instance, integer, one_of, positive, real, two_axes
from packmech.dynamics.by_shape import turns_of
from packmech.dynamics.deformation import Driven, end_path, extend_path, strain_direction
from packmech.dynamics.engine import SHEARED_ENOUGH, WRAP_EVERY, Engine, build_engine
from packmech.dynamics.friction import Now
from packmech.dynamics.integrators import (
    Method,
    VelocityVerlet,
    checked_method,
    choose_time_step,
    start_of_motion,
)
from packmech.dynamics.observables import (
    COLUMNS,
    CONTACTS,
    FORCE,
    KINETIC,
    MOTION,
    POTENTIAL,
    RATE,
    ROTATIONAL,
    SLIDING,
    SPINNING,
    STRAIN,
    TANGENTIAL,
    TIME,
    TORQUE,
    measure,
)
from packmech.dynamics.time_step import REST_OF_STEP, WHOLE_STEP, Acting, EngineSystem, Rule, Span, run_steps
from packmech.effects import Friction, RoughContacts, friction_of
from packmech.effects.kinds import ByKind, kinds_in
from packmech.jit.by_type import by_type
from packmech.jit.compiled import device, inlined, inner_lean, kernel
from packmech.minimize.passes.kernels import NOT_FINITE, RUNNING, SEARCH
from packmech.minimize.passes.pair_list import follow
from packmech.observables import OBSERVABLES, component_names
from packmech.packing import Packing
from packmech.result import Outcome
from packmech.scene import Scene

# columns of the counts and of the numbers of each packing
STEPS, LEFT, SINCE, STATUS, GOOD, COUNTS = 0, 1, 2, 3, 4, 5
REACH, VOLUME, SHEARED, FASTEST, LAST_FORCE, LAST_STRAIN, HEIGHT, NUMBERS = 0, 1, 2, 3, 4, 5, 6, 7
# other lattice vectors may be better where the smallest height has become so much smaller
_FLATTER = 0.85
# what is done: a frame is started, gone on with where it was left or with new pair lists, or only observed
FRESH, AGAIN, NEW_LISTS, OBSERVE = 0, 1, 2, 3
# leading columns of figures; then the stress (3 numbers in a plane, 6 in space), and the others named in `figure_names`
FIGURE_TIME, FIGURE_STRAIN, FIGURE_RATE, FIGURE_STRESS = 0, 1, 2, 3


class Plan(NamedTuple):
    """What is the same for all packings of a batch, and one packing's counts, numbers, row of observables, and figures.

    axes is (0, 1) or (0, 1, 2); a and b are the axes of displacement and gradient. `switched`: the last number of what
    that control a packing is its coefficient of friction. good_nk holds its rows at the end of the last good frame,
    good_turn_nq how its shapes were turned there, and turn_nq is how they are now.
    """

    axes: Any
    a: int
    b: int
    control: int
    switched: bool
    steps: int
    dt: float
    second_order: bool
    good_nk: Any
    good_turn_nq: Any
    turn_nq: Any
    count_k: Any
    number_k: Any
    row: Any
    figure_k: Any


def figure_names(dimension: int) -> tuple[str, ...]:
    """Return the names of the figures' columns.

    Examples
    --------
    >>> figure_names(2)[3:7]
    ('stress_xx', 'stress_yy', 'stress_xy', 'pressure')

    """
    size = OBSERVABLES["stress"].size_in(dimension)
    named = ("kinetic_energy", "elastic_energy", "work", "contacts", "sliding_fraction")
    return ("time", "strain", "rate", *component_names("stress", size, symmetric=True), "pressure", *named)


@inlined
def _no_friction(friction, plan, doing, control_k):
    return None


@inlined
def _switched_number(coefficient, plan, doing, control_k):
    switched = plan.switched and doing != OBSERVE
    return control_k[control_k.shape[0] - 1] if switched else coefficient


# the coefficient of a frame; a table by kinds is never switched
_coefficient_of_frame = by_type(_switched_number, {ByKind: lambda coefficient, plan, doing, control_k: coefficient})


@inlined
def _switched_friction(friction, plan, doing, control_k):
    coefficient = _coefficient_of_frame(friction.coefficient, plan, doing, control_k)
    return Friction(coefficient, friction.stiffness, friction.damping)


@inlined
def _with_rolling(rough, plan, doing, control_k):
    return RoughContacts(_switched_friction(rough.friction, plan, doing, control_k), rough.rolling, rough.twisting)


# the friction that a frame is taken with; None without
_friction_of_frame = by_type(_switched_friction, {type(None): _no_friction, RoughContacts: _with_rolling})


@kernel
def put(batch, b, record):
    """Replace the record of a packing."""
    batch[b] = record


@kernel
def new_batch(record, count):
    """Return a batch of so many packings, all of this record until others are put there."""
    batch = List()
    for _ in range(count):
        batch.append(record)
    return batch


@kernel
def fetch(batch, b):
    """Return the record of a packing."""
    return batch[b]


@device
def _write_figures(plan):
    row, number_k, out = plan.row, plan.number_k, plan.figure_k
    d = len(plan.axes)
    volume = number_k[VOLUME]
    out[FIGURE_TIME], out[FIGURE_STRAIN], out[FIGURE_RATE] = row[TIME], row[STRAIN], row[RATE]
    k = FIGURE_STRESS
    trace = 0.0
    for a in range(d):
        stress = row[FORCE + 4 * a] / volume - row[SPINNING + 4 * a] / volume
        trace += stress
        out[k] = stress
        k += 1
    # yz, xz, xy; in a plane the last one
    for c in range(3 - d * (d - 1) // 2, 3):
        a, b = (c + 1) % 3, (c + 2) % 3
        torque = 0.5 * row[TORQUE + c] / volume
        out[k] = row[FORCE + 3 * a + b] / volume + torque - row[SPINNING + 3 * a + b] / volume
        k += 1
    out[k] = -trace / d
    out[k + 1] = row[KINETIC] + row[ROTATIONAL]
    out[k + 2] = row[POTENTIAL] + row[TANGENTIAL]
    # what the box shears against, the mean of both ends of the frame
    force = row[FORCE + 3 * plan.a + plan.b] - row[MOTION + 3 * plan.a + plan.b]
    out[k + 3] += 0.5 * (number_k[LAST_FORCE] + force) * (row[STRAIN] - number_k[LAST_STRAIN])
    out[k + 4] = row[CONTACTS]
    out[k + 5] = row[SLIDING] / max(row[CONTACTS], 1.0)
    number_k[LAST_FORCE] = force
    number_k[LAST_STRAIN] = row[STRAIN]


@device
def _is_finite(row):
    total = 0.0
    for k in range(row.shape[0]):
        total += abs(row[k])
    return total < math.inf


@device
def _copy(source_nk, to_nk):
    for i in range(to_nk.shape[0]):
        for k in range(to_nk.shape[1]):
            to_nk[i, k] = source_nk[i, k]


@device
def _put_back(state, profile, plan):
    """Put places, turns, velocities, strain and time back to the end of the last frame that was finished."""
    count_k, figure_k = plan.count_k, plan.figure_k
    _copy(plan.good_turn_nq, plan.turn_nq)
    _copy(plan.good_nk, state.body)
    count_k[STEPS] = count_k[GOOD]
    count_k[LEFT] = 0
    end_path(profile, figure_k[FIGURE_TIME], figure_k[FIGURE_STRAIN], figure_k[FIGURE_RATE])


@device
def _is_outside(axes, body, frame, height):
    """Whether a particle is more than a cell away from the cell, or the cell so flat that others may be better."""
    d = len(axes)
    for a in range(d):
        if frame.height_d[a] < _FLATTER * height:
            return True
    for i in range(body.shape[0]):
        for a in range(d):
            fraction = 0.0
            for b in range(d):
                fraction += frame.inverse_dd[a, b] * body[i, b]
            if fraction < -1.0 or fraction >= 2.0:
                return True
    return False


@inner_lean
def _part_of_frame(system, plan, doing, control_k):
    """Take a frame of one packing, or what was left of it, as far as its pair lists reach; return its status.

    That is RUNNING, SEARCH where new lists are due, or how it failed; and whether its particles must be wrapped.
    """
    count_k, number_k = plan.count_k, plan.number_k
    if count_k[STATUS] != RUNNING:
        return count_k[STATUS], False
    acting, axes, state, links, space, pairs, track, account = system
    profile = space.flow.course
    if doing == FRESH:
        begin, end = count_k[STEPS] * plan.dt, (count_k[STEPS] + plan.steps) * plan.dt
        number_k[FASTEST] = extend_path(profile, plan.control, begin, end, control_k) * plan.dt
        count_k[LEFT] = plan.steps
    friction = _friction_of_frame(acting.friction, plan, doing, control_k)
    now = EngineSystem(
        Acting(acting.pairs, acting.bodies, friction, acting.shapes, acting.walls),
        axes,
        state,
        links,
        space,
        pairs,
        track,
        account,
    )
    rule = Rule(plan.dt, plan.second_order, number_k[REACH])
    start = REST_OF_STEP if doing == NEW_LISTS else WHOLE_STEP
    status = RUNNING
    outside = False
    while count_k[LEFT] > 0 and status == RUNNING and not outside:
        due = min(count_k[LEFT], WRAP_EVERY - count_k[SINCE])
        room = SHEARED_ENOUGH - number_k[SHEARED]
        if number_k[FASTEST] * due > room:
            due = max(1, int(room / number_k[FASTEST]))
        status, taken = run_steps(now, None, 1, Span(start, count_k[STEPS], due), rule)
        start = WHOLE_STEP
        count_k[STEPS] += taken
        count_k[LEFT] -= taken
        count_k[SINCE] += taken
        number_k[SHEARED] += taken * number_k[FASTEST]
        if status == RUNNING and (count_k[SINCE] >= WRAP_EVERY or number_k[SHEARED] >= SHEARED_ENOUGH * (1.0 - 1e-9)):
            outside = _is_outside(axes, state.body, space.frame, number_k[HEIGHT])
            count_k[SINCE] = 0
            number_k[SHEARED] = 0.0
    if status == RUNNING and count_k[LEFT] == 0:
        measure(now, count_k[STEPS] * plan.dt, Now(0.5 * plan.dt if plan.second_order else plan.dt), plan.row)
        if _is_finite(plan.row):
            _write_figures(plan)
            _copy(state.body, plan.good_nk)
            _copy(plan.turn_nq, plan.good_turn_nq)
            count_k[GOOD] = count_k[STEPS]
        else:
            status = NOT_FINITE
    if status != RUNNING and status != SEARCH:
        _put_back(state, profile, plan)
        count_k[STATUS] = status
        return status, False
    return status, outside


@device
def _frame(batch, b, doing, control_k):
    """Take a frame of one packing, or what was left of it; return whether it is good, and must be wrapped."""
    while True:
        # no record is named twice: each of its dozens of arrays would be counted again
        system, plan = batch[b]
        status, outside = _part_of_frame(system, plan, doing, control_k)
        if status != SEARCH:
            return status == RUNNING, outside
        acting, axes, state, links, space, pairs, track, account = system
        pairs, track = follow(axes, state.body, space, pairs, track)
        batch[b] = (EngineSystem(acting, axes, state, links, space, pairs, track, account), plan)
        doing = NEW_LISTS


@kernel
def not_finite(control_bk, active_b):
    """Return the first active packing that is given a number that is not finite; -1: none."""
    for b in range(control_bk.shape[0]):
        if active_b[b]:
            for k in range(control_bk.shape[1]):
                if not math.isfinite(control_bk[b, k]):
                    return b
    return -1


@kernel
def frames(batch, doing, low, high, active_b, control_bk, wrap_b, good_b):
    """Take frames of the active packings from low to high; return how many must be wrapped.

    Those are marked in wrap_b; of a frame that they cut short LEFT steps are left. A packing that moved too fast in a
    step is put back to where its last frame ended, and so is its count; its STATUS is not RUNNING, it is marked in
    good_b and it moves no more. Where packing b is given a number that is not finite, nothing moves: -1 - b.
    """
    if doing == FRESH:
        bad = not_finite(control_bk, active_b)
        if bad >= 0:
            return -1 - bad
    count = 0
    for b in range(low, high):
        if active_b[b]:
            good_b[b], wrap_b[b] = _frame(batch, b, doing, control_bk[b])
            count += wrap_b[b]
    return count


def scenes_of(scenes: Any) -> list[Scene]:
    """Return the scenes of a batch, which must be alike."""
    if isinstance(scenes, Scene) or not isinstance(scenes, Sequence):
        raise TypeError(f"scenes must be a list of scenes, got {brief(scenes)}")
    if not scenes:
        raise ValueError("scenes must hold at least one scene, got none")
    for b, scene in enumerate(scenes):
        must_be_alike(f"scenes[{b}]", scene, scenes[0])
    return list(scenes)


def must_be_alike(name: str, scene: Any, first: Scene) -> None:
    """Check that a scene has the dimension and kinds of effects and shapes of the first one of its batch."""
    instance(name, scene, Scene)
    _HONORS.check(name, scene)
    if scene.packing.shapes.has_frames:
        raise ValueError(
            f"{name}.packing must be of discs, spheres, ellipses or spheroids for pm.ShearBatch, got "
            f"{type(scene.packing.shapes).__name__}: pm.simulate and pm.oscillatory_shear step those"
        )
    if scene.packing.dimension != first.packing.dimension:
        raise ValueError(f"{name} must have the dimension of the first scene, got {scene.packing.dimension}")
    if type(scene.packing.shapes) is not type(first.packing.shapes):
        raise ValueError(
            f"{name}.packing must have shapes of the kind of the first scene's, "
            f"{type(first.packing.shapes).__name__}, got {type(scene.packing.shapes).__name__}"
        )
    if _kinds(scene.effects) != _kinds(first.effects):
        raise ValueError(f"{name} must have the kinds of effects of the first scene, got {brief(scene.effects)}")
    several, others = (kinds_in(one.effects, one.packing) is not None for one in (scene, first))
    if several != others:
        raise ValueError(
            f"{name}.packing must have kinds of particles as the first scene's has, {first.packing.kinds}, got "
            f"{scene.packing.kinds}"
        )


def _kinds(effects: Any) -> Any:
    """Return the classes in a tuple of effects, those of their laws too: what compiled code goes by."""
    if isinstance(effects, tuple):
        return type(effects), tuple(_kinds(one) for one in effects)
    return type(effects)


# what sets the strain of each packing in a frame, by the name of the control
CONTROLS = {"strain": 1, "rate": 1, "strain_and_rate": 2}


_HONORS = declare("ShearBatch", "repulsion kinds damping friction rolling bonds gravity walls drag shapes")


class ShearBatch:
    """Sheared packings that are advanced together, a frame of equal time steps for each at a time.

    All of them are advanced by one compiled call, on any number of threads, with the same bits as each one alone.
    Particles follow Newton's equations in the sheared box (Lees and Edwards's sliding images), as in
    `oscillatory_shear`; how the strain goes is said frame by frame.

    Parameters
    ----------
    scenes
        One scene for each packing, without rigid links. All must have the same kinds of effects and shapes, and the
        same dimension.
    control
        What sets the strain of a packing in a frame: "strain": the strain at its end, "rate": the strain rate; both are
        applied as equal strain increments in all steps of the frame. "strain_and_rate": both at its end, and the strain
        follows a cubic from those before.
    steps
        Time steps of a frame.
    dt
        Time step of all packings. Unless given: the method's fraction of the shortest of sqrt(m / stiffness) and
        m / damping in any of the scenes; a packing alone moves by the same bits with the `dt` of its batch.
    switched_friction
        Whether its coefficient of friction is given for each frame, too, as the last number; scenes must have friction.
    axes
        Direction of the displacements, and of their gradient.
    method
        VelocityVerlet() unless given, or SemiImplicitEuler().
    velocity_nd, spin_nk
        (N, d) peculiar velocities and (N, 1 or 3) spins at the start; at rest unless given.
    held_n
        (N,) True for particles that nothing pushes or turns.
    threads
        Number of threads; it changes no bit.

    Attributes
    ----------
    figure_bk
        (B, K) figures at the end of the last frame, in the columns named in `names`: time [time], strain [1] and its
        rate [1/time], the components of the overall stress (Cauchy, tension positive) and the pressure -trace/d
        [energy/length^d], kinetic energy of peculiar velocities and spins, elastic energy of laws and tangential
        springs, work done by the shear (by the trapezoidal rule, frame by frame) [energy], touching pairs and the part
        of them at Coulomb's cap [1]. Of a packing that moved too fast they stay those of its last good frame.

    Raises
    ------
    TypeError, ValueError
        Naming the argument that is wrong.

    Examples
    --------
    >>> import numpy as np, packmech as pm
    >>> packing = pm.lattice_packing("triangular", repeats=(4, 4), relative_overlap=0.01)
    >>> scene = pm.Scene(packing, (pm.Repulsion(),))
    >>> batch = pm.ShearBatch([scene, scene], control="strain", steps=400)
    >>> batch.advance(np.array([[1e-3], [0.0]])).tolist()
    [True, True]
    >>> stress = batch.figure_bk[:, batch.names.index("stress_xy")]
    >>> (stress > [1e-4, -1e-9]).tolist(), (stress < [1e-3, 1e-9]).tolist()
    ([True, True], [True, True])

    """

    def __init__(
        self,
        scenes: Sequence[Scene],
        *,
        control: str = "rate",
        steps: int = 1,
        dt: float | None = None,
        switched_friction: bool = False,
        axes: tuple[int, int] = (0, 1),
        method: Method | None = None,
        velocity_nd: ArrayLike | None = None,
        spin_nk: ArrayLike | None = None,
        held_n: ArrayLike | None = None,
        threads: int = 1,
    ) -> None:
        self.scenes = scenes_of(scenes)
        first = self.scenes[0]
        self.control = one_of("control", control, tuple(CONTROLS))
        boolean("switched_friction", switched_friction)
        if switched_friction and not friction_of(first.effects):
            raise ValueError("switched_friction must be left out for scenes without friction")
        rough = friction_of(first.effects)
        if switched_friction and rough and isinstance(rough.coefficient, ByKind):
            raise ValueError(f"switched_friction must be left out where friction differs by kinds, got {brief(rough)}")
        method = checked_method(method)
        self.axes = two_axes("axes", axes, dimension=first.packing.dimension)
        self._direction_dd = strain_direction("shear", self.axes, first.packing.dimension)
        self._start_of_motion = start_of_motion(first.packing, velocity_nd, spin_nk, held_n)
        smallest = min(choose_time_step(one, method.fraction) for one in self.scenes)
        self.dt: float = smallest if dt is None else positive("dt", dt)
        d = first.packing.dimension
        self.steps: int = integer("steps", steps, at_least=1, at_most=int(MOST_STEPS))
        self.controls = CONTROLS[control] + bool(switched_friction)
        self._second_order = isinstance(method, VelocityVerlet)
        self._plan = (
            tuple(range(d)),
            *self.axes,
            list(CONTROLS).index(control),
            bool(switched_friction),
            self.steps,
            self.dt,
            self._second_order,
        )
        self.names = figure_names(d)
        count = len(self.scenes)
        self.threads = min(integer("threads", threads, at_least=1), count)
        self.figure_bk = np.zeros((count, len(self.names)))
        self._row_bk = np.zeros((count, COLUMNS))
        self._count_bk = np.zeros((count, COUNTS), dtype=np.int64)
        self._number_bk = np.zeros((count, NUMBERS))
        self._wrap_b = np.zeros(count, dtype=bool)
        self._good_b = np.ones(count, dtype=bool)
        self._all_b = np.ones(count, dtype=bool)
        self._none_bk = np.zeros((count, self.controls))
        # rows and turns at the end of the last good frame, and turns now
        self._good: dict[int, tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]] = {}
        # whole lattice vectors that particles were moved by, before more of them in the middle of a frame
        self._before: dict[int, NDArray[np.int64]] = {}
        self._engines: list[Engine] = []
        self._pool: ThreadPoolExecutor | None = None
        self._batch: Any = None
        for b, scene in enumerate(self.scenes):
            self._start(b, scene, 0.0)
        self._observe(self._all_b)

    def __len__(self) -> int:
        return len(self.scenes)

    def restart(self, index: int, scene: Scene | None = None, *, rate: float = 0.0) -> None:
        """Start one packing again: nothing of what it did before is left.

        Parameters
        ----------
        index
            Which one.
        scene
            The scene; None: as before.
        rate
            The strain rate at the start [1/time], which dashpots feel and a cubic goes on from.

        """
        b = integer("index", index, at_least=0, at_most=len(self) - 1)
        if scene is not None:
            must_be_alike("scene", scene, self.scenes[0])
            self.scenes[b] = scene
        self._start(b, self.scenes[b], real("rate", rate))
        only = np.zeros(len(self), dtype=bool)
        only[b] = True
        self._observe(only)

    def _start(self, b: int, scene: Scene, rate: float) -> None:
        packing = scene.packing
        path = np.zeros(6)
        path[4:] = rate
        built = build_engine(
            scene,
            dt=self.dt,
            velocity_nd=self._start_of_motion.velocity_nd,
            spin_nk=self._start_of_motion.spin_nk,
            profile=Driven(path),
            direction_dd=self._direction_dd,
            held_n=self._start_of_motion.held_n,
            second_order=self._second_order,
        )
        if built.too_long is not None:
            limit = built.too_long
            raise ValueError(f"dt must be at most {limit.asked:.4g}, got {limit.reached:g}: {limit.hint}")
        built.begin()
        turn_nq = turns_of(built.acting.shapes)
        self._good[b] = built.state.body.copy(), turn_nq.copy(), turn_nq
        record = self._record(b, built)
        if self._batch is None:
            self._batch = new_batch(record, len(self.scenes))
        else:
            put(self._batch, b, record)
        self._engines[b : b + 1] = [built]
        self._count_bk[b] = 0
        self._count_bk[b, STATUS] = RUNNING
        self._good_b[b] = True
        self._number_bk[b] = 0.0
        self._number_bk[b, REACH] = 2.0 * float(built.state.body[:, 3].min())
        self._number_bk[b, VOLUME] = packing.box.volume
        self._number_bk[b, HEIGHT] = self._height(built)
        self._row_bk[b] = 0.0
        self.figure_bk[b] = 0.0

    def _height(self, engine: Engine) -> float:
        return float(engine.space.frame.height_d[: len(self._plan[0])].min())

    def _record(self, b: int, engine: Engine) -> Any:
        own = self._count_bk[b], self._number_bk[b], self._row_bk[b], self.figure_bk[b]
        return engine.system, Plan(*self._plan, *self._good[b], *own)

    def _observe(self, which_b: NDArray[np.bool_]) -> None:
        self._call(OBSERVE, which_b, self._none_bk)

    def advance(self, control_bk: NDArray[np.float64], active_b: NDArray[np.bool_] | None = None) -> NDArray[np.bool_]:
        """Advance every packing by a frame; return (B,) whether it is still good.

        A packing in which something moved by the smallest diameter in one step, or whose figures overflowed, is put
        back to where its last frame ended and moves no more until it is restarted.

        Parameters
        ----------
        control_bk
            (B, K) the numbers that control each one.
        active_b
            (B,) which ones to advance; None: all.

        Raises
        ------
        ValueError
            For another shape, or a number that is not finite.

        """
        if type(control_bk) is not np.ndarray or control_bk.dtype != np.float64 or not control_bk.flags.c_contiguous:
            control_bk = finite_array("control_bk", control_bk, shape=self._none_bk.shape, what="packing")
        if control_bk.shape != self._none_bk.shape:
            raise ValueError(f"control_bk must have shape {self._none_bk.shape}, got {control_bk.shape}")
        if active_b is None:
            active_b = self._all_b
        elif type(active_b) is not np.ndarray or active_b.shape != self._all_b.shape or active_b.dtype != np.bool_:
            raise ValueError(f"active_b must be {len(self.scenes)} times True or False, got {brief(active_b)}")
        bad = not_finite(control_bk, active_b) if self.threads > 1 else -1
        wrapping = self._call(FRESH, active_b, control_bk) if bad < 0 else 0
        if bad >= 0 or wrapping < 0:
            b = bad if bad >= 0 else -1 - wrapping
            raise ValueError(f"control_bk must be finite, got {control_bk[b].tolist()} for packing {b}")
        while wrapping:
            left_b = self._wrap()
            wrapping = self._call(AGAIN, left_b, control_bk) if left_b.any() else 0
        for b, wrap_nd in self._before.items():
            # what failed is where its last frame ended, and so are its whole lattice vectors
            if not self._good_b[b]:
                self._engines[b].wrap_nd[:] = wrap_nd
        self._before.clear()
        return self._good_b.copy()

    def _call(self, doing: int, active_b: NDArray[np.bool_], control_bk: NDArray[np.float64]) -> int:
        fixed: tuple[Any, ...] = (active_b, control_bk, self._wrap_b, self._good_b)
        if self.threads == 1:
            return frames(self._batch, doing, 0, len(self.scenes), *fixed)  # type: ignore[no-any-return]
        if self._pool is None:
            self._pool = ThreadPoolExecutor(self.threads - 1, thread_name_prefix="packmech")
            weakref.finalize(self, self._pool.shutdown, wait=False)
        count, parts = len(self.scenes), self.threads
        ends = [count * k // parts for k in range(parts + 1)]
        others = [
            self._pool.submit(frames, self._batch, doing, low, high, *fixed)
            for low, high in zip(ends[1:-1], ends[2:], strict=True)
        ]
        mine = frames(self._batch, doing, 0, ends[1], *fixed)
        return int(mine) + sum(int(one.result()) for one in others)

    def _wrap(self) -> NDArray[np.bool_]:
        """Wrap the marked packings; return which have steps of the frame left."""
        left_b = np.zeros(len(self), dtype=bool)
        for b in np.flatnonzero(self._wrap_b).tolist():
            engine = self._engine(b)
            left_b[b] = self._count_bk[b, LEFT] > 0
            if left_b[b]:
                self._before.setdefault(b, engine.wrap_nd.copy())
            system, _ = fetch(self._batch, b)
            engine.space, engine.pairs, engine.track = system.space, system.pairs, system.track
            engine.wrap()
            if not left_b[b]:
                self._good[b][0][:] = engine.state.body
            put(self._batch, b, self._record(b, engine))
            self._number_bk[b, HEIGHT] = self._height(engine)
            self._wrap_b[b] = False
        return left_b

    def _engine(self, b: int) -> Engine:
        engine = self._engines[b]
        engine.steps = int(self._count_bk[b, STEPS])
        return engine

    def outcome(self, index: int) -> Outcome:
        """Return the state of one packing: Outcome.FINISHED, or Outcome.STEP_TOO_LONG once it moved too fast.

        Parameters
        ----------
        index
            Which one.

        """
        b = integer("index", index, at_least=0, at_most=len(self) - 1)
        return Outcome.FINISHED if self._count_bk[b, STATUS] == RUNNING else Outcome.STEP_TOO_LONG

    def packing(self, index: int) -> Packing:
        """Return one packing as it is at the end of its last good frame; positions are not wrapped.

        Parameters
        ----------
        index
            Which one.

        """
        return self._engine(integer("index", index, at_least=0, at_most=len(self) - 1)).packing()

    def orientations(self, index: int) -> NDArray[np.float64] | None:
        """Return the (N, d) directors of one packing at the end of its last good frame; None of discs and spheres.

        Parameters
        ----------
        index
            Which one.

        """
        return self._engine(integer("index", index, at_least=0, at_most=len(self) - 1)).orientations()

    def velocities(self, index: int) -> NDArray[np.float64]:
        """Return the (N, d) peculiar velocities of one packing at the end of its last good frame [length/time].

        Parameters
        ----------
        index
            Which one.

        """
        return self._engine(integer("index", index, at_least=0, at_most=len(self) - 1)).velocities()

    def spins(self, index: int) -> NDArray[np.float64] | None:
        """Return the (N, 1 or 3) spins of one packing [1/time]; None where particles do not turn.

        Parameters
        ----------
        index
            Which one.

        """
        return self._engine(integer("index", index, at_least=0, at_most=len(self) - 1)).spins()

    def close(self) -> None:
        """Let the threads go; a later frame takes new ones."""
        if self._pool is not None:
            self._pool.shutdown()
            self._pool = None
