"""The program: a scene compiled to one loop over exactly the effects that it names, and what a minimizer of it is."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.box import Box
from packmech.check import finite_array, given_shape, instance, integer, positive, real
from packmech.constraints.compiled_links import compile_links
from packmech.constraints.redundancy import workable_links
from packmech.contacts.cells import Sizes, frame_of, size_levels
from packmech.effects import bonds_of, held_particles, is_interaction, pair_energy, pair_first, reach_beyond_contact
from packmech.effects.kinds import reference_partners
from packmech.effects.single import vectors_outside
from packmech.loop.run_loop import RunLoop, RunSettings
from packmech.minimize.passes.interaction_rows import bonded_rows
from packmech.minimize.passes.kernels import (
    CONVERGED,
    FLOOR,
    NOT_FINITE,
    RUNNING,
    STALLED,
    UNJAMMED,
    Goal,
    Sums,
    Survey,
    evaluate,
    judge,
)
from packmech.minimize.passes.kind_rows import row_kinds
from packmech.minimize.passes.pair_list import (
    BEYOND,
    DISPLACED,
    SKIN_FULL,
    SKIN_OUTER,
    PairList,
    Space,
    blocks_of,
    empty_list,
    strain_list,
)
from packmech.minimize.passes.shape_rows import shape_rows
from packmech.minimize.passes.single_rows import acting_on_rows
from packmech.packing import Packing
from packmech.result import Outcome
from packmech.scene import Scene


class Progress(NamedTuple):
    """The state of a minimization between two chunks of steps: numbers, of which the first two count, and vectors."""

    number: NDArray[np.float64]
    vector_kf: NDArray[np.float64]

    @property
    def steps(self) -> int:
        """Steps so far."""
        return int(self.number[0])

    @property
    def force_evaluations(self) -> int:
        """Passes over the forces so far."""
        return int(self.number[1])


class Minimizer(Protocol):
    """What every minimization method is: a record of settings that starts a run on a program, and advances it."""

    def start(self, program: Program) -> Progress:
        """Return the state of a run that has not started."""
        ...

    def advance(self, program: Program, goal: Goal, progress: Progress, steps: int) -> int:
        """Advance by up to `steps` steps; return the status code."""
        ...


class Evaluation(NamedTuple):
    """Energy and forces of a scene at given positions.

    energy [energy]; pressure [energy/length^d]; stress_dd, Cauchy, tension positive; contacts touching pairs;
    max_force the largest net force on a particle and mean_force the mean contact force [force]; residual their ratio,
    0 when nothing touches; force_nd (R, d) net forces on the coordinates; force_floor the net force that rounding of
    positions alone can cause [force]; deepest_overlap the largest relative overlap [1].
    """

    energy: float
    pressure: float
    stress_dd: NDArray[np.float64]
    contacts: int
    max_force: float
    mean_force: float
    residual: float
    force_nd: NDArray[np.float64]
    force_floor: float
    deepest_overlap: float


class Relaxation(NamedTuple):
    """What a minimization of arrays arrived at: the packing, and figures as in Evaluation."""

    packing: Packing
    outcome: Outcome
    residual: float
    max_force: float
    mean_force: float
    energy: float
    pressure: float
    contacts: int
    steps: int
    force_evaluations: int


# overlaps [1] above which a law whose energy grows beyond measure, or only its force, must not part the particles
_DEEP, _COINCIDENT = 0.2, 0.99
# a law's force diverges where at the first distance [contact distance] it is more than so many times that at the
# second: a power of the overlap less than doubles it, one over the distance multiplies it by a thousand, up to a cap
_CLOSE, _STEEP = (1e-4, 0.1), 3.0
# skin of the wide pair list in units of the harmonic mean diameter, which many small or a few tiny particles set alike
_SKIN = 0.6

# rows of a block, at least, where there are several
_BLOCK = 2048

OUTCOME_OF = {
    RUNNING: Outcome.STEP_LIMIT,
    CONVERGED: Outcome.CONVERGED,
    FLOOR: Outcome.ROUNDING_FLOOR,
    UNJAMMED: Outcome.UNJAMMED,
    NOT_FINITE: Outcome.STALLED,
    STALLED: Outcome.STALLED,
}


@dataclass(eq=False)
class Program:
    """A scene compiled for its effects, with its working arrays: rows sorted in space, velocities and pair lists.

    The rows are sorted once, when the program is built, by the places of the particles; relabelled particles therefore
    go through the same arithmetic. Build one with `build_program`; one program serves many positions and boxes of the
    same particles, one at a time.

    Coordinates are the positions, and below them for particles with shapes how they are turned, measured in radii of
    gyration: directors of ellipses and spheroids, and of rigid bodies the rotations since the program was built. A
    minimizer that walks over all of them turns particles, too.

    Attributes
    ----------
    scene
        The scene it was built from.
    effects
        Those of its effects that have an energy.
    order_n
        (N,) particle of each row of a position.
    diverges
        Whether the energy of two particles grows beyond measure as their centers meet.
    bearable_overlap
        Overlap [1] above which the scene's own law must not be the one to part the particles; 1 where it always may.
    threads
        Number of threads, for minimizers that take several.
    build_seconds
        CPU seconds spent on building.

    """

    scene: Scene
    effects: tuple[Any, ...]
    order_n: NDArray[np.int64]
    axes: tuple[int, ...]
    row: NDArray[np.float64]
    force_nd: NDArray[np.float64]
    velocity_nd: NDArray[np.float64]
    sizes: Sizes
    wrap_nd: NDArray[np.float64]
    box: Box
    change_dd: NDArray[np.int64]
    space: Space
    pairs: PairList
    diverges: bool
    bearable_overlap: float
    threads: int = 1
    build_seconds: float = 0.0

    @property
    def step_unit(self) -> float:
        """Unit of a method's largest step [length]: the largest diameter; the smallest under a law that diverges."""
        radius = self.scene.packing.radius_n
        return 2.0 * float(radius.min() if self.diverges else radius.max())

    @property
    def chunk(self) -> int:
        """Steps of some tens of milliseconds: compiled loops come back as often, so that an interrupt is seen."""
        return max(1, 1_000_000 // self.velocity_nd.size)

    @property
    def order_r(self) -> NDArray[np.int64]:
        """The (R,) coordinates that rows hold, those of directors after those of positions."""
        n = len(self.order_n)
        return self.order_n if len(self.row) == n else np.concatenate([self.order_n, n + self.order_n])

    def put(self, packing: Packing) -> None:
        """Put the particles where a packing has them, in its box and turned as there, at rest."""
        self.place(self.coordinates_of(packing), packing.box.lattice_dd)

    def coordinates_of(self, packing: Packing) -> NDArray[np.float64]:
        """Return the (R, d) coordinates at which the program's particles are as in a packing."""
        shapes = self.scene.packing.shapes
        return np.concatenate([packing.position_nd, shapes.coordinates(packing.shapes, packing.radius_n)])

    def packing(self) -> Packing:
        """Return the packing as its particles are now."""
        return self.packing_at(self.coordinates(), self.box)

    def packing_at(self, coordinate_rd: NDArray[np.float64], box: Box) -> Packing:
        """Return the packing with given coordinates in a box."""
        packing, n = self.scene.packing, len(self.order_n)
        shapes = packing.shapes.at_coordinates(coordinate_rd[n:], packing.radius_n)
        return packing.replace(position_nd=coordinate_rd[:n], box=box, shapes=shapes)

    def place(self, coordinate_rd: ArrayLike, lattice_dd: ArrayLike | None = None) -> None:
        """Put the particles at the given coordinates, in the given box, at rest.

        Pair lists are kept as far as they still hold: they follow an affine change of the box and are checked against
        what is left of the displacements.

        Parameters
        ----------
        coordinate_rd
            (R, d) positions, and turns below them, in the order of the scene's packing [length]; with N of them
            turns stay as they are.
        lattice_dd
            (d, d) lattice vectors as columns [length]; the present box when left out.

        """
        d, n = len(self.axes), len(self.order_n)
        given = given_shape(coordinate_rd)[:1]
        rows = len(self.row) if given == (len(self.row),) else n
        coordinate = finite_array("coordinate_rd", coordinate_rd, shape=(rows, d))
        affine = np.eye(d)
        if lattice_dd is not None and not np.array_equal(lattice_dd, self.box.lattice_dd):
            box = lattice_dd if isinstance(lattice_dd, Box) else Box(np.asarray(lattice_dd, dtype=np.float64))
            affine = box.lattice_dd @ self.box.inverse_dd
            self._set_box(box)
        self.row[:n, :d] = (coordinate[:n] - self.wrap_nd @ self.box.lattice_dd.T)[self.order_n]
        if rows > n:
            self.row[n:, :d] = coordinate[n:][self.order_n]
        self.velocity_nd[:] = 0.0
        self._resolve()
        strain_list(self.pairs, affine, 4.0 * float(self.sizes.largest_a.max()))

    def _resolve(self) -> None:
        d = len(self.axes)
        extent = max(float(np.abs(self.row[:, :d]).max()), float(np.abs(self.space.frame.lattice_dd[:d, :d]).max()))
        self.space.resolution[0] = np.finfo(np.float64).eps * extent

    def _set_box(self, box: Box) -> None:
        self.box = box
        lattice = Box(box.lattice_dd @ self.change_dd)
        shortest = box.reduced()[0].height_d.min()
        if lattice.height_d.min() < 0.3 * shortest:
            # the box was strained so far that other vectors are short now: start the lists afresh
            lattice, self.change_dd = box.reduced()
            skin, beyond = (float(self.pairs.number[k]) for k in (SKIN_FULL, BEYOND))
            self.pairs = _no_pairs(self.scene, skin, beyond)
            self.link_rows()
        self.space = self.space._replace(frame=frame_of(lattice))

    def link_rows(self) -> None:
        """Compile the links again, for the lattice vectors that the loops use."""
        packing = self.scene.packing
        if packing.links:
            _, links = compile_links(packing, workable_links(packing), self.order_n, self.wrap_nd, self.change_dd)
            self.space = self.space._replace(links=links)

    def strained_box(self) -> Box:
        """Return the box as compiled loops strained it."""
        d = len(self.axes)
        back = np.rint(np.linalg.inv(self.change_dd))
        return Box(self.space.frame.lattice_dd[:d, :d] @ back)

    def keep_strained(self) -> None:
        """Take over the box as compiled loops strained it and the rows."""
        self._set_box(self.strained_box())
        self._resolve()

    def coordinates(self) -> NDArray[np.float64]:
        """Return the (R, d) positions, and turns below them, in the order of the scene's packing [length]."""
        d, n = len(self.axes), len(self.order_n)
        coordinate = np.empty((len(self.row), d))
        coordinate[self.order_r] = self.row[:, :d]
        coordinate[:n] += self.wrap_nd @ self.box.lattice_dd.T
        return coordinate

    def positions(self) -> NDArray[np.float64]:
        """Return the (N, d) positions in the order of the scene's packing [length]."""
        return self.coordinates()[: len(self.order_n)]

    def evaluate(self, coordinate_rd: ArrayLike | None = None, lattice_dd: ArrayLike | None = None) -> Evaluation:
        """Return energy, stress, forces and contacts at the given, or else the present, coordinates.

        Parameters
        ----------
        coordinate_rd, lattice_dd
            As in `place`.

        """
        if coordinate_rd is not None:
            self.place(coordinate_rd, lattice_dd)
        sums, totals, self.pairs = evaluate(
            self.effects, self.axes, self.row, self.force_nd, self.velocity_nd, self.space, self.pairs
        )
        return self._evaluation(sums, totals)

    def _evaluation(self, sums: Sums, totals: Survey) -> Evaluation:
        d = len(self.axes)
        force = np.empty((len(self.row), d))
        force[self.order_r] = self.force_nd
        stress = totals.virial_dd[:d, :d] / self.box.volume
        contacts = int(totals.contacts)
        mean = sums.total / sums.touching if sums.touching else 0.0
        largest = math.sqrt(sums.largest)
        return Evaluation(
            energy=float(totals.energy),
            pressure=(0.0 - float(np.trace(stress))) / d,
            stress_dd=stress,
            contacts=contacts,
            max_force=largest,
            mean_force=mean,
            residual=largest / mean if mean > 0 else 0.0,
            force_nd=force,
            force_floor=float(totals.stiffness * self.space.resolution[0]),
            deepest_overlap=float(totals.deepest),
        )

    def judge(self, goal: Goal) -> tuple[int, Evaluation]:
        """Return how the present positions stand to the goal, as a status code, and the evaluation that says so.

        A minimizer written in Python goes on while the code is RUNNING, which is 0, and returns any other as it is.
        """
        sums, totals, self.pairs = evaluate(
            self.effects, self.axes, self.row, self.force_nd, self.velocity_nd, self.space, self.pairs
        )
        return int(judge(sums, totals.stiffness, self.space, goal)), self._evaluation(sums, totals)  # type: ignore[no-untyped-call]

    def progress(self, numbers: int, vectors: int) -> Progress:
        """Return the empty state of a minimization: so many numbers, and so many vectors over all coordinates."""
        return Progress(np.zeros(numbers), np.zeros((vectors, self.velocity_nd.size)))

    def advance(
        self,
        steps_kernel: Any,
        settings: Any,
        goal: Goal,
        progress: Progress,
        steps: int,
        largest_step: float | None = None,
    ) -> int:
        """Run a minimizer's compiled loop for up to `steps` steps; return its status code.

        Parameters
        ----------
        steps_kernel
            The loop.
        settings
            The record of its numbers.
        goal, progress, steps
            When to stop, the state, which is updated, and the largest number of steps.
        largest_step
            Bound on every particle's displacement in a step [step_unit]; that of the settings when left out.

        """
        cap = settings.largest_step if largest_step is None else largest_step
        try:
            status, self.pairs = steps_kernel(
                self.effects,
                self.axes,
                self.row,
                self.force_nd,
                self.velocity_nd,
                self.space,
                self.pairs,
                settings,
                goal,
                cap * self.step_unit,
                progress.number,
                progress.vector_kf,
                steps,
            )
        except BaseException:
            # a list that was made on the way shares its numbers with the one that is kept, which is older
            self.pairs.number[SKIN_OUTER] = -1.0
            self.pairs.number[DISPLACED] = np.inf
            raise
        return int(status)

    def relax(
        self,
        coordinate_rd: ArrayLike | None = None,
        lattice_dd: ArrayLike | None = None,
        *,
        force_tolerance: float,
        method: Minimizer,
        step_limit: int = 500_000,
        force_floor: float = 0.0,
    ) -> Relaxation:
        """Return where a minimizer ends in the box as it is; whether it converged is in `outcome`, no error is raised.

        Parameters
        ----------
        coordinate_rd, lattice_dd
            As in `place`; the present coordinates when left out.
        force_tolerance
            Stop when the largest net force falls to this times the mean contact force [1].
        method
            The minimizer.
        step_limit
            Largest number of steps.
        force_floor
            Call the packing unjammed when the mean contact force falls to this [force].

        """
        goal = Goal(positive("force_tolerance", force_tolerance), real("force_floor", force_floor, at_least=0.0))
        limit = integer("step_limit", step_limit, at_least=0)
        if coordinate_rd is None:
            self.velocity_nd[:] = 0.0
        else:
            self.place(coordinate_rd, lattice_dd)
        task = Minimization(self, method, goal, limit)
        return task.relaxation(RunLoop(RunSettings()).advance(task))


class Minimization:
    """A minimizer on its way down a program, as the run loop steps it.

    Parameters
    ----------
    program
        The program, its particles where the minimization starts and at rest.
    method, goal, step_limit
        The minimizer and when to stop.
    stop_every
        Maximum number of steps from stop to stop; those of `Program.chunk` when left out.
    keep, keep_every, before
        Called with the number of steps, those taken before this minimization included, at the start and at every
        stop; a multiple of keep_every of these is one.
    describe
        Returns what `progress` is called with after so many steps of this minimization.

    """

    def __init__(
        self,
        program: Program,
        method: Minimizer,
        goal: Goal,
        step_limit: int,
        *,
        stop_every: int | None = None,
        keep: Callable[[int], None] | None = None,
        keep_every: int | None = None,
        before: int = 0,
        describe: Callable[[int], tuple[str, dict[str, Any]]] | None = None,
    ) -> None:
        self.program, self.method, self.goal, self.step_limit = program, method, goal, step_limit
        self.stop_every = program.chunk if stop_every is None else stop_every
        self.keep, self.keep_every, self.before, self.describe = keep, keep_every, before, describe
        self.progress = method.start(program)
        # a loop that is entered again takes the forces again where it was left
        self._again = 0
        self.stop = 0
        self.observe()

    @property
    def steps(self) -> int:
        """Steps taken."""
        return self.progress.steps

    @property
    def force_evaluations(self) -> int:
        """Passes over the forces, the same in whatever portions steps were taken."""
        return self.progress.force_evaluations - self._again

    def next_stop(self) -> int | Outcome:
        """Return the step of the next stop."""
        return self.stop

    def advance(self, steps: int) -> Outcome | None:
        """Advance by up to so many steps."""
        status = self.method.advance(self.program, self.goal, self.progress, steps)
        if status != RUNNING or self.steps >= self.step_limit:
            return OUTCOME_OF[status]
        self._again += self.steps < self.stop
        return None

    def observe(self) -> Outcome | None:
        """Keep what is to be kept here, and set the next stop."""
        if self.keep is not None:
            self.keep(self.before + self.steps)
        further = min(self.stop_every, self.step_limit - self.steps)
        if self.keep_every is not None:
            further = min(further, self.keep_every - (self.before + self.steps) % self.keep_every)
        self.stop = self.steps + further
        return None

    def figures(self) -> tuple[str, dict[str, Any]]:
        """Return what `progress` is called with."""
        if self.describe is not None:
            return self.describe(self.steps)
        return type(self.method).__name__, {"steps": self.steps}

    def relaxation(self, outcome: Outcome) -> Relaxation:
        """Return what was arrived at."""
        end = self.program.evaluate()
        return Relaxation(
            packing=self.program.packing(),
            outcome=outcome,
            residual=end.residual,
            max_force=end.max_force,
            mean_force=end.mean_force,
            energy=end.energy,
            pressure=end.pressure,
            contacts=end.contacts,
            steps=self.steps,
            force_evaluations=self.force_evaluations + 1,
        )


def space_order(packing: Packing) -> NDArray[np.int64]:
    """Return the order of rows: along a Z-shaped curve through the box, ties by place and radius."""
    d = packing.dimension
    box, _ = packing.box.reduced()
    fraction = packing.position_nd @ box.inverse_dd.T
    fraction -= np.floor(fraction)
    bits = max(1, int(np.ceil(np.log2(packing.particles) / d)) + 1)
    cell = np.minimum((fraction * (1 << bits)).astype(np.int64), (1 << bits) - 1)
    key = np.zeros(packing.particles, dtype=np.int64)
    for b in range(bits):
        for k in range(d):
            key |= ((cell[:, k] >> b) & 1) << (d * b + k)
    order: NDArray[np.int64] = np.lexsort((packing.radius_n, *fraction.T[::-1], key))
    return order


def _no_pairs(scene: Scene, skin: float, beyond: float) -> PairList:
    """Return the list before its first use, in several blocks where threads may share the loop over them."""
    packing = scene.packing
    alone = not packing.plain or bonds_of(scene.effects) is not None or any(map(is_interaction, scene.effects))
    row_b = None if alone else blocks_of(packing.particles, _BLOCK)
    return empty_list(packing.particles, skin, beyond, row_b=row_b, width=packing.dimension)


def _diverges(scene: Scene) -> bool:
    """Return whether the energy near the center is beyond measure."""
    sigma, pairs = scene.packing.reference_diameter, reference_partners(scene.effects, scene.packing)
    try:
        near = max(sum(float(pair_energy(one, 0.01 * sigma, pair)) for one in scene.effects) for pair in pairs)
    except (OverflowError, ZeroDivisionError, ValueError):
        return True
    return not near < 1e3 * scene.energy_scale


def _bearable_overlap(scene: Scene, diverges: bool) -> float:
    """Return the overlap [1] above which another law must part the particles: 1, of coincident centers, for none."""
    if diverges:
        return _DEEP
    sigma, pairs = scene.packing.reference_diameter, reference_partners(scene.effects, scene.packing)
    try:
        found = [
            [sum(abs(float(pair_first(one, s * sigma, pair))) for one in scene.effects) for s in _CLOSE]
            for pair in pairs
        ]
    except (OverflowError, ZeroDivisionError, ValueError):
        return _COINCIDENT
    except TypeError:
        # a law whose force is no number is named where it is compiled
        return 1.0
    return 1.0 if all(close <= _STEEP * deep for close, deep in found) else _COINCIDENT


def build_program(scene: Scene, *, threads: int = 1) -> Program:
    """Return the scene compiled for its effects, its particles sorted in space.

    Parameters
    ----------
    scene
        The scene; effects without an energy (damping) have no part in minimization and are left out.
    threads
        Number of threads, for minimizers that take several; it changes no bit.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.Packing([[0.0, 0.0], [0.5, 0.0]], [0.5, 0.5], pm.Box.cubic(3.0, 2))
    >>> program = build_program(pm.Scene(packing, (pm.Repulsion(),)))
    >>> program.evaluate().force_nd[1].tolist()
    [0.5, 0.0]
    >>> program.relax(force_tolerance=1e-10, method=pm.Fire()).outcome.name
    'UNJAMMED'

    """
    started = time.process_time()
    instance("scene", scene, Scene)
    packing = scene.packing
    effects = tuple(one for one in scene.effects if hasattr(type(one), "pair_energy") or is_interaction(one))
    if not effects:
        raise ValueError("effects must contain one with an energy, such as Repulsion(...), got none")
    d = packing.dimension
    fraction = packing.position_nd @ packing.box.inverse_dd.T
    order = space_order(packing)
    single = acting_on_rows(scene, order)
    if not single:
        # positions stay as given unless some lie far outside: their image vectors would make the table of images long
        wrap = np.where((fraction < -1.0) | (fraction >= 2.0), np.floor(fraction), 0.0)
    else:
        # what acts on single particles sees those in the cell
        wrap = vectors_outside(scene.effects, packing)
    shapes = packing.shapes
    rows = packing.particles + len(shapes.coordinates(shapes, packing.radius_n))
    row = np.zeros((rows, 4))
    row[: packing.particles, 3] = shapes.reach(packing.radius_n)[order]
    small, change = packing.box.reduced()
    bonds, bonded = bonded_rows(scene, order, wrap, change)
    effects = (*effects, *bonds, *single, *shape_rows(packing, order), *row_kinds(scene, order))
    sizes = size_levels(row[: packing.particles, 3].copy())
    skin = _SKIN / float(np.mean(1.0 / packing.diameter_n))
    held = held_particles(scene.effects, packing.particles)
    diverges = _diverges(scene)
    program = Program(
        scene=scene,
        effects=effects,
        order_n=order,
        axes=tuple(range(d)),
        row=row,
        force_nd=np.zeros((rows, d)),
        velocity_nd=np.zeros((rows, d)),
        sizes=sizes,
        wrap_nd=wrap,
        box=packing.box,
        change_dd=change,
        space=Space(
            sizes,
            frame_of(small),
            bonds=bonded,
            resolution=np.zeros(1),
            held=None if held is None else held[order],
        ),
        pairs=_no_pairs(scene, skin, reach_beyond_contact(scene.effects, packing)),
        diverges=diverges,
        bearable_overlap=_bearable_overlap(scene, diverges),
        threads=threads,
    )
    program.link_rows()
    program.put(packing)
    program.build_seconds = time.process_time() - started
    return program


__all__ = ["OUTCOME_OF", "Evaluation", "Minimizer", "Program", "Relaxation", "build_program"]
