"""`QuenchBatch`: many packings of one kind, strained and relaxed step by step as a caller decides."""

from __future__ import annotations

import itertools
import weakref
from concurrent.futures import ThreadPoolExecutor
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.calls.honors import declare
from packmech.check import PARTICLE_BYTES, boolean, brief, finite_array, instance, integer, one_of, positive, real
from packmech.constraints.compiled_links import row_links
from packmech.effects import Harmonic, Repulsion
from packmech.effects.kinds import kinds_in
from packmech.links import image_offsets
from packmech.measure.counting import packing_fraction
from packmech.mechanics.stability import stability
from packmech.minimize import batch_kernels as kernels
from packmech.minimize.bodies_apart import separate
from packmech.minimize.first_order.damped import DampedDynamics
from packmech.minimize.first_order.fire import Fire, Fire2
from packmech.minimize.minimizers import checked_minimizer
from packmech.minimize.passes.kernels import Goal
from packmech.minimize.passes.shape_rows import shapes_of
from packmech.minimize.program import OUTCOME_OF, Program, build_program
from packmech.packing import Packing
from packmech.result import Outcome
from packmech.scene import Scene

# whether a status code is a success
_SUCCESS = np.array([OUTCOME_OF[code].ok for code in sorted(OUTCOME_OF)])
# packings are dealt out to threads in this many parts for each, as they take unequal times
_PARTS = 8
# angle beyond which rotation vectors of rigid bodies in space start again from zero: they are singular at a whole turn
_FAR_TURNED = 2.0
# packing fractions below which particles hardly meet, and above which pairs are too many
_LIMITS = {2: (0.1, 1.3), 3: (0.05, 1.1)}


class _Recorder:
    """Takes the place of a program, to return the numbers that a minimizer gives its loop."""

    # threads share the packings of a batch, not the rows of one
    threads = 1

    def __init__(self, scene: Scene) -> None:
        self.scene = scene

    def advance(self, loop: Any, numbers: Any, goal: Any, progress: Any, steps: int, largest_step: float) -> Any:
        return numbers, largest_step


def bodies_of(program: Program) -> kernels.Bodies:
    """Return the bodies of a program: clusters of linked rows, or single rows."""
    packing = program.scene.packing
    n, d = packing.particles, packing.dimension
    links = program.space.links
    offset, rows = np.zeros((n, 3)), len(program.row)
    if links is None:
        cluster, winding, freedom = np.arange(n), np.zeros(n, dtype=np.bool_), np.full(n, d)
        freedom += (packing.turn_nkt != 0.0).any(axis=2).sum(axis=1)[program.order_n]
    else:
        cluster = packing.links.clusters(n)[program.order_n]
        _, offsets = row_links(packing.links, program.order_n, program.wrap_nd, program.change_dd)
        offset[:, :d] = offsets
        winding = image_offsets(packing.links, n)[1][program.order_n].copy()
        freedom = d * np.bincount(cluster) - np.bincount(cluster[links.system.i_r], minlength=int(cluster.max()) + 1)
    clusters = len(freedom)
    return kernels.Bodies(
        cluster_n=np.ascontiguousarray(cluster, dtype=np.int64),
        freedom_c=freedom.astype(np.int64),
        offset_nd=offset,
        winding_n=winding,
        volume=packing_fraction(packing) * packing.box.volume,
        last_nd=np.zeros((rows, 3)),
        last_dd=np.zeros((3, 3)),
        center_cd=np.zeros((clusters, 3)),
        contacts_c=np.zeros(clusters, dtype=np.int64),
        rattler_c=np.zeros(clusters, dtype=np.bool_),
    )


def relax_deep_overlaps(program: Program) -> None:
    """Relax deep overlaps with the harmonic law where the scene's own diverges, as pm.quench does."""
    if not program.evaluate().deepest_overlap > program.bearable_overlap:
        return
    harmonic = program.scene.replace(effects=(Repulsion(law=Harmonic(energy_scale=program.scene.energy_scale)),))
    program.put(build_program(harmonic).relax(force_tolerance=1e-2, method=Fire()).packing)


_HONORS = declare("QuenchBatch", "repulsion kinds links shapes", at_rest=True)


class QuenchBatch:
    """A batch of packings that are strained, then relaxed, in one compiled call on any number of threads.

    All packings have the same number of particles, and the scene's effects. A step changes the packing fraction of each
    by scaling its box, shears it, and then minimizes the energy in the box as it is. Scaling and shear displace
    particles with the box, or the centers of clusters of linked particles, which keep their shape; a cluster that winds
    around the box is strained with it. Ellipses, spheroids and rigid bodies keep their directions then, and turn as
    they relax. Each packing is independent of the others and of the number of threads, to the bit.

    Figures are arrays with one entry for each packing, after the last step: `packing_fraction_b` [1], `energy_b`
    [energy], `pressure_b` [energy/length^d], `stress_bdd` (Cauchy, tension positive), `max_force_b`, the largest net
    force on a particle, and `mean_force_b`, the mean contact force [force], `contacts_b`, `rattlers_b` and
    `excess_contacts_b`, see `step`, `strain_b`, all shear since the restart [1], `steps_b` and `force_evaluations_b` of
    the last step.

    Parameters
    ----------
    scene
        The scene whose packing all start from; effects without an energy are left out, as in pm.quench.
    batch
        How many packings.
    relax
        "full": every step relaxes to the tolerance, and the minimizer starts again each time. A number k: every step
        takes k steps of the minimizer, which goes on where it was, so that the quench itself can be followed.
    force_tolerance
        Largest net force over mean contact force at which a packing counts as relaxed [1].
    force_floor
        Mean contact force at which it counts as unjammed [energy_scale / reference diameter].
    method
        pm.Fire(), pm.Fire2() or pm.DampedDynamics(); None: Fire().
    step_limit
        Maximum number of steps of a full relaxation.
    packing_fraction_limits
        (low, high) between which steps keep the packing fraction [1]; None: (0.1, 1.3) in two dimensions, (0.05, 1.1)
        in three.
    threads
        How many packings are advanced at a time.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.random_packing(32, dimension=2, packing_fraction=0.9, seed=1)
    >>> batch = pm.QuenchBatch(pm.Scene(packing, (pm.Repulsion(),)), 2, force_tolerance=1e-8)
    >>> batch.step([-0.1, 0.0], [0.0, 0.01])
    >>> batch.packing_fraction_b.round(6).tolist(), [batch.outcome(b).name for b in range(2)]
    ([0.8, 0.9], ['UNJAMMED', 'CONVERGED'])

    """

    def __init__(
        self,
        scene: Scene,
        batch: int = 1,
        *,
        relax: str | int = "full",
        force_tolerance: float = 1e-8,
        force_floor: float = 0.0,
        method: Fire | Fire2 | DampedDynamics | None = None,
        step_limit: int = 100_000,
        packing_fraction_limits: ArrayLike | None = None,
        threads: int = 1,
    ) -> None:
        instance("scene", scene, Scene)
        _HONORS.check("scene", scene)
        self.scene = scene
        self.batch = integer("batch", batch, at_least=1, bytes_each=scene.packing.particles * PARTICLE_BYTES)
        if isinstance(relax, str):
            one_of("relax", relax, ("full",))
            self.relax: str | int = relax
        else:
            self.relax = integer("relax", relax, at_least=1)
        limits = _LIMITS[scene.packing.dimension] if packing_fraction_limits is None else packing_fraction_limits
        low, high = finite_array("packing_fraction_limits", limits, shape=(2,), what="limit").tolist()
        if not 0.0 < low < high:
            raise ValueError(f"packing_fraction_limits must be positive and rise, got ({low:g}, {high:g})")
        self.packing_fraction_limits = (low, high)
        self.force_tolerance = positive("force_tolerance", force_tolerance)
        floor = real("force_floor", force_floor, at_least=0.0) * scene.energy_scale / scene.packing.reference_diameter
        limit = integer("step_limit", step_limit, at_least=1)
        self.threads = integer("threads", threads, at_least=1)
        method = Fire() if method is None else method
        if not isinstance(method, Fire | Fire2 | DampedDynamics):
            raise TypeError(f"method must be Fire(), Fire2() or DampedDynamics(), got {brief(method)}")
        method = checked_minimizer(method)
        self._programs: list[Program] = []
        program = build_program(scene)
        self._axes = program.axes
        begun, goal = method.start(program), Goal(self.force_tolerance, floor)
        self._start_k, self._vectors = begun.number.copy(), begun.vector_kf
        self._numbers, cap = cast("tuple[Any, float]", method.advance(cast("Any", _Recorder(scene)), goal, begun, 0))
        self._settings = kernels.Settings(
            steps=limit if isinstance(self.relax, str) else self.relax,
            restart=self.relax == "full",
            force_tolerance=self.force_tolerance,
            force_floor=floor,
            cap=cap * program.step_unit,
            low=low,
            high=high,
        )
        self._figure_bk = np.zeros((self.batch, kernels.FIGURES))
        self._stress_bdd = np.zeros((self.batch, 3, 3))
        self._none_b = np.zeros(self.batch)
        # unstable directions where packings are now; None until `outcome` is called
        self._negative_b: list[int | None] = [None] * self.batch
        self._packings: Any = None
        self._turns_in_space = scene.packing.shapes.has_frames and scene.packing.dimension == 3
        # the minimizer's state of each packing
        self._number_bk: list[NDArray[np.float64]] = []
        self._all = np.arange(self.batch)
        self._pool: ThreadPoolExecutor | None = None
        for b in range(self.batch):
            self._place(b, build_program(scene) if b else program)
        self._advance(self._all, self._none_b, self._none_b, relax=False)

    def restart(self, index: int, packing: Packing, *, relax: bool = False) -> None:
        """Replace one packing. Nothing of the old one is kept: no pair list, velocity or count.

        Under a law that diverges at the center, deep overlaps are first relaxed with the harmonic law, and rigid bodies
        whose beads overlap deeply are taken apart, as in pm.quench.

        Parameters
        ----------
        index
            Which one.
        packing
            The packing, with as many particles as the scene's; with links if that has links, and shapes of its kind.
        relax
            Take the minimizer's steps as in `step`, in the box as it is.

        """
        b = self._index(index)
        instance("packing", packing, Packing)
        own = self.scene.packing
        if (packing.particles, packing.dimension) != (own.particles, own.dimension):
            raise ValueError(
                f"packing must have {own.particles} particles in {own.dimension} dimensions, "
                f"got {packing.particles} in {packing.dimension}"
            )
        if bool(packing.links) != bool(own.links):
            raise ValueError(f"packing must have links just if the scene's has, got {len(packing.links)}")
        if type(packing.shapes) is not type(own.shapes):
            raise ValueError(
                f"packing must have shapes of the kind of the scene's, {type(own.shapes).__name__}, "
                f"got {type(packing.shapes).__name__}"
            )
        boolean("relax", relax)
        several, others = (kinds_in(self.scene.effects, one) is not None for one in (packing, own))
        if several != others:
            raise ValueError(
                f"packing must have kinds of particles as the scene's has, {own.kinds}, got {packing.kinds}"
            )
        program = build_program(self.scene.replace(packing=packing))
        apart = 0
        if own.shapes.has_orientations:
            packing, apart = separate(program, packing)
            program.put(packing)
        relax_deep_overlaps(program)
        self._figure_bk[b] = 0.0
        self._place(b, program)
        self._advance(np.array([b]), self._none_b, self._none_b, relax=relax)
        self._figure_bk[b, kernels.EVALUATIONS] += apart

    def step(
        self,
        packing_fraction_change_b: ArrayLike,
        shear_strain_b: ArrayLike,
        *,
        active_b: ArrayLike | None = None,
    ) -> None:
        """Strain every packing, or the active ones, and relax it.

        Particles, or clusters, with at most d contacts are removed until none are left: their particles are
        `rattlers_b`. `excess_contacts_b` is the number of contacts left less that of one state of self stress in a box
        of fixed shape, N_dof - d + 1, N_dof the degrees of freedom left, turns of shapes among them. It may be
        negative, and is in jammed packings of ellipses and spheroids, which curvature holds. Where forces overflow or
        links would be lost, a packing stays where it was before the step, with Outcome.STALLED.

        Parameters
        ----------
        packing_fraction_change_b
            (B,) changes of the packing fraction [1], kept inside the limits.
        shear_strain_b
            (B,) simple shear along the first axis with its gradient along the second, in [-1, 1] [1].
        active_b
            (B,) which packings to advance; None: all.

        Raises
        ------
        TypeError, ValueError
            Numbers of another shape, not finite, or too large.

        """
        change = finite_array(
            "packing_fraction_change_b", packing_fraction_change_b, shape=(self.batch,), what="packing"
        )
        strain = finite_array("shear_strain_b", shear_strain_b, shape=(self.batch,), what="packing")
        if (np.abs(strain) > 1.0).any():
            b = int(np.argmax(np.abs(strain)))
            raise ValueError(f"shear_strain_b must lie between -1 and 1, got {strain[b]} for packing {b}")
        if active_b is None:
            index = self._all
        else:
            active = np.asarray(active_b)
            if active.dtype != np.bool_ or active.shape != (self.batch,):
                raise TypeError(f"active_b must be ({self.batch},) booleans, got {brief(active_b)}")
            index = np.flatnonzero(active)
        self._advance(index, change, strain, relax=True)

    def packing(self, index: int) -> Packing:
        """Return a packing as it is now; its lattice vectors and images may be others of the same lattice.

        Parameters
        ----------
        index
            Which one.

        """
        program = self._programs[self._index(index)]
        program.box = program.strained_box()
        return program.packing()

    def outcome(self, index: int) -> Outcome:
        """Return how the last relaxation of a packing ended; STEP_LIMIT while it goes on.

        Outcome.UNSTABLE where forces balance on a saddle, or where it is not known whether they do; `relaxed_b` does
        not show it: the second derivative of the whole packing is factored where this is called.

        Parameters
        ----------
        index
            Which one.

        """
        b = self._index(index)
        outcome = OUTCOME_OF[int(self._figure_bk[b, kernels.STATUS])]
        if outcome not in (Outcome.CONVERGED, Outcome.ROUNDING_FLOOR):
            return outcome
        if self._negative_b[b] is None:
            largest = float(self._figure_bk[b, kernels.MAX_FORCE])
            self._negative_b[b] = stability(self.scene.replace(packing=self.packing(b)), largest).unstable
        return Outcome.UNSTABLE if self._negative_b[b] else outcome

    @property
    def packing_fraction_b(self) -> NDArray[np.float64]:
        """The (B,) packing fractions [1]."""
        return self._figures(kernels.FRACTION)

    @property
    def energy_b(self) -> NDArray[np.float64]:
        """The (B,) energies [energy]."""
        return self._figures(kernels.ENERGY)

    @property
    def pressure_b(self) -> NDArray[np.float64]:
        """The (B,) pressures [energy/length^d]."""
        return self._figures(kernels.PRESSURE)

    @property
    def stress_bdd(self) -> NDArray[np.float64]:
        """The (B, d, d) Cauchy stresses, tension positive [energy/length^d]."""
        d = len(self._axes)
        return self._stress_bdd[:, :d, :d] + 0.0

    @property
    def max_force_b(self) -> NDArray[np.float64]:
        """The (B,) largest net forces on a particle [force]."""
        return self._figures(kernels.MAX_FORCE)

    @property
    def mean_force_b(self) -> NDArray[np.float64]:
        """The (B,) mean contact forces [force]."""
        return self._figures(kernels.MEAN_FORCE)

    @property
    def contacts_b(self) -> NDArray[np.int64]:
        """The (B,) numbers of touching pairs."""
        return self._figures(kernels.CONTACTS).astype(np.int64)

    @property
    def rattlers_b(self) -> NDArray[np.int64]:
        """The (B,) numbers of rattlers."""
        return self._figures(kernels.RATTLERS).astype(np.int64)

    @property
    def excess_contacts_b(self) -> NDArray[np.int64]:
        """The (B,) contacts beyond those of one state of self stress."""
        return self._figures(kernels.EXCESS).astype(np.int64)

    @property
    def strain_b(self) -> NDArray[np.float64]:
        """The (B,) sums of the shear strains since the restart [1]."""
        return self._figures(kernels.STRAIN)

    @property
    def steps_b(self) -> NDArray[np.int64]:
        """The (B,) steps that the minimizer took in the last step."""
        return self._figures(kernels.STEPS).astype(np.int64)

    @property
    def force_evaluations_b(self) -> NDArray[np.int64]:
        """The (B,) force evaluations of the last step, the one for the figures among them."""
        return self._figures(kernels.EVALUATIONS).astype(np.int64)

    @property
    def relaxed_b(self) -> NDArray[np.bool_]:
        """Whether the last relaxation of each packing met the tolerance, or found no contacts; see `outcome`."""
        return np.asarray(_SUCCESS[self._figure_bk[:, kernels.STATUS].astype(np.int64)])

    def _figures(self, k: int) -> NDArray[np.float64]:
        return self._figure_bk[:, k] + 0.0  # no negative zeros

    def _index(self, index: int) -> int:
        return integer("index", index, at_least=0, at_most=self.batch - 1)

    def _place(self, b: int, program: Program, number_k: NDArray[np.float64] | None = None) -> None:
        """Put a program at its place, with the minimizer's state as it is, or as it starts."""
        number = self._start_k.copy() if number_k is None else number_k
        packing = (
            program.effects, program.row, program.force_nd, program.velocity_nd, program.space, program.pairs,
            bodies_of(program), number, self._vectors.copy(),
        )  # fmt: skip
        if self._packings is None:
            self._packings = kernels.new_list(packing)
        else:
            kernels.put(self._packings, b, packing)
        self._programs[b : b + 1] = [program]
        self._number_bk[b : b + 1] = [number]

    def _advance(self, index_k: Any, change_b: Any, strain_b: Any, *, relax: bool) -> None:
        """Strain these packings and relax them, or only measure them, each thread taking one part after the other."""
        settings = self._settings if relax else self._settings._replace(steps=-1)
        for b in index_k:
            self._negative_b[b] = None
        count = len(index_k)
        size = max(1, -(-count // (_PARTS * self.threads)))
        if self.threads == 1 or count <= size:
            size = count
        lows = itertools.count(0, max(size, 1))

        def work() -> None:
            while (low := next(lows)) < count:
                kernels.advance_packings(
                    self._packings, index_k, low, min(low + size, count), self._axes, self._numbers,
                    settings, self._start_k, change_b, strain_b, self._figure_bk, self._stress_bdd,
                )  # fmt: skip

        # more threads than packings have nothing to do
        further = min(self.threads, count) - 1 if size < count else 0
        others = [self._threads().submit(work) for _ in range(further)]
        try:
            work()
        finally:
            for other in others:
                other.result()
        stale_k = self._figure_bk[index_k, kernels.OUTSIDE] > 0.0
        if self._turns_in_space:
            stale_k |= self._far_turned(index_k)
        for b in index_k[stale_k]:
            self._wrap(int(b))

    def _far_turned(self, index_k: Any) -> NDArray[np.bool_]:
        """Return which packings hold rigid bodies in space that turned so far that rotation vectors should restart."""
        return np.array([self._largest_turn(self._programs[b]) > _FAR_TURNED for b in index_k])

    def _largest_turn(self, program: Program) -> float:
        n = len(program.order_n)
        angle = np.sqrt((program.row[n:, :3] ** 2).sum(axis=1)) / shapes_of(program.effects).gyration_n
        return float(angle.max())

    def _threads(self) -> ThreadPoolExecutor:
        if self._pool is None:
            self._pool = ThreadPoolExecutor(self.threads - 1)
            weakref.finalize(self, self._pool.shutdown, wait=False)
        return self._pool

    def _wrap(self, b: int) -> None:
        """Choose short lattice vectors and wrap the particles into their cell; velocities and the minimizer go on."""
        old = self._programs[b]
        packing = self.packing(b)
        box, change = packing.box.reduced()
        back = np.rint(np.linalg.inv(change)).astype(np.int64)
        links = packing.links.at_images(packing.links.image_ld @ back.T)
        program = build_program(self.scene.replace(packing=packing.replace(box=box, links=links).wrapped()))
        velocity, n = np.empty_like(old.velocity_nd), packing.particles
        velocity[old.order_r] = old.velocity_nd
        if self._turns_in_space:
            # rotations count from here on, and the rates of rotation vectors are angular velocities at their start
            bodies = shapes_of(old.effects)
            spin = kernels.spins_of_rows(bodies, old.row, old.velocity_nd)
            velocity[n + old.order_n] = spin * bodies.gyration_n[:, None]
        program.velocity_nd[:] = velocity[program.order_r]
        self._place(b, program, self._number_bk[b])
