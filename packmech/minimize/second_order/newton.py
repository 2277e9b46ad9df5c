"""Newton's method for the last digits: from forces that nearly balance to the floor of double precision."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from packmech.check import instance, integer, positive
from packmech.contacts import Contacts, candidate_pairs, pair_contacts
from packmech.contacts.elements import elements_of
from packmech.contacts.rattlers import rattlers_of
from packmech.effects import (
    contact_terms,
    held_particles,
    needs_second,
    refuse_single,
    single_effects,
    single_terms,
    total_push,
)
from packmech.jit.blas import single_thread
from packmech.linalg.factor import Factorization, NotDefinite, eigenvalues_below, factorize
from packmech.measure.stress import sum_forces
from packmech.mechanics.assembly import Assembled, assemble
from packmech.mechanics.stability import stability_bound
from packmech.minimize.second_order.soft_network import Units, energy_change, length_unit
from packmech.minimize.second_order.soft_newton import descend, judge
from packmech.packing import Packing
from packmech.result import Condition, NotConverged, Outcome, Run, unmet_conditions
from packmech.scene import Scene


class Polished(NamedTuple):
    """What Newton's method made of a packing.

    `residual` is the largest net force over the mean contact force; `steps` counts the steps taken, `regularized`
    those of them whose Hessian had to be made definite, `negative` the unstable directions of all particles at the end.
    """

    packing: Packing
    outcome: Outcome
    residual: float
    max_force: float
    mean_force: float
    steps: int
    force_evaluations: int
    regularized: int
    negative: int


def polish_downhill(packing: Packing, effects: tuple[Any, ...], *, force_tolerance: float, step_limit: int) -> Polished:
    """Return the packing with links or shapes after Newton steps in its box; whether it converged is in `outcome`.

    Parameters
    ----------
    packing, effects, force_tolerance, step_limit
        As in `polish`.

    """
    units = Units(effects, length_unit(packing), 1.0)
    none = np.zeros((0, packing.dimension, packing.dimension))
    state = descend(units.reduced(packing), units, none, None, iterations=step_limit)
    outcome = judge(state, force_tolerance)
    if outcome is Outcome.STALLED and state.iterations == step_limit:
        outcome = Outcome.STEP_LIMIT
    mean = state.mean_force / units.length
    if not mean > 0.0:
        outcome = Outcome.UNJAMMED
    residual = state.residual if mean > 0.0 else 0.0
    final = units.restored(state.packing, packing)
    return Polished(
        final, outcome, residual, residual * mean, mean, state.iterations, state.evaluations, 0, state.negative
    )  # fmt: skip


_ARMIJO = 1e-4
_HALVINGS = 14
# net forces within this many rounding floors may be rounding: the search stops there
_FLOORS = 8.0
# weights of Simpson's rule
_SIMPSON = {0.0: 1.0 / 6.0, 0.5: 4.0 / 6.0, 1.0: 1.0 / 6.0}
# of a coordinate's own stiffness: what smooth walls let slide is held by this much
_SLIDING = 1e-9


class Newton(NamedTuple):
    """Newton's method with a sparse factorization: few, expensive steps; for packings that are nearly at rest.

    Parameters
    ----------
    largest_step
        No particle moves farther than this in one step [smallest diameter].
    skin
        Pairs are searched within this reach beyond contact [smallest diameter].

    """

    largest_step: float = 0.1
    skin: float = 0.3

    def check(self) -> None:
        """Check every number; the error names the first that is wrong."""
        positive("method.largest_step", self.largest_step)
        positive("method.skin", self.skin)


@dataclass(frozen=True, eq=False)
class _State:
    """Positions with their touching contacts, net forces, and what acts on single particles."""

    position_nd: NDArray[np.float64]
    near: Contacts
    touching: Contacts
    first_c: NDArray[np.float64]
    second_c: NDArray[np.float64]
    net_nd: NDArray[np.float64]
    push: float
    pushes: int
    single_ndd: NDArray[np.float64]

    @property
    def max_force(self) -> float:
        return float(np.sqrt((self.net_nd**2).sum(axis=1)).max())

    @property
    def mean_force(self) -> float:
        # forces on single particles count as those of contacts do, where there are any
        count = len(self.touching) + self.pushes
        return float((np.abs(self.first_c).sum() + self.push) / count) if count else 0.0

    @property
    def residual(self) -> float:
        return self.max_force / self.mean_force if self.mean_force > 0.0 else 0.0


class _Landscape:
    """The energy of one packing's particles in its box, near where they are."""

    def __init__(self, packing: Packing, effects: tuple[Any, ...], skin: float) -> None:
        self.packing, self.effects, self.skin = packing, effects, skin
        self.evaluations = 0
        self.held_n = held_particles(effects, packing.particles)
        self.pushed = bool(single_effects(effects))
        self._search(packing.position_nd)

    def _search(self, position_nd: NDArray[np.float64]) -> None:
        packing = self.packing
        self.pairs = candidate_pairs(position_nd, packing.radius_n, packing.box, skin=self.skin)
        self.listed_nd = position_nd

    def at(self, position_nd: NDArray[np.float64]) -> _State:
        moved = float(np.sqrt(((position_nd - self.listed_nd) ** 2).sum(axis=1)).max())
        if moved > 0.5 * self.skin:
            self._search(position_nd)
        self.evaluations += 1
        near = pair_contacts(self.packing.replace(position_nd=position_nd), *self.pairs)
        touching = near.select(near.distance_c < near.contact_distance_c)
        terms = contact_terms(self.effects, touching.distance_c, touching.contact_distance_c)
        net = sum_forces(touching, -terms.first_c)
        single = single_terms(self.effects, self.packing, position_nd)
        net += single.force_nd
        if self.held_n is not None:
            net[self.held_n] = 0.0
        pushed = total_push(single, self.held_n)
        return _State(position_nd, near, touching, terms.first_c, terms.second_c, net, *pushed, single.second_ndd)

    def floor(self, state: _State) -> float:
        """Return the net force that rounding of the coordinates makes: their spacing times a particle's stiffness."""
        ends = np.concatenate([state.touching.i_c, state.touching.j_c])
        stiffness_n = np.bincount(ends, np.tile(state.second_c, 2), minlength=len(state.position_nd))
        stiffness = (stiffness_n + np.abs(state.single_ndd).sum(axis=2).max(axis=1)).max(initial=0.0)
        return float(stiffness * np.spacing(self.extent(state)))

    def extent(self, state: _State) -> float:
        """Return the largest coordinate, whose last digit is the error of positions."""
        return max(float(np.abs(state.position_nd).max()), float(np.abs(self.packing.box.lattice_dd).max()))

    def energy_change(self, start: _State, position_nd: NDArray[np.float64]) -> float:
        """Return the energy at new positions less that at the start, free of cancellation."""
        near = start.near
        step = position_nd - start.position_nd
        change = step[near.j_c] - step[near.i_c]
        change_of_pairs = energy_change(
            near.vector_cd,
            change,
            near.contact_distance_c,
            lambda distance, sigma: contact_terms(self.effects, distance, sigma).first_c,
        )
        if not self.pushed:
            return change_of_pairs
        places = ((weight, start.position_nd + share * step) for share, weight in _SIMPSON.items())
        work = sum(
            weight * float((single_terms(self.effects, self.packing, place).force_nd * step).sum())
            for weight, place in places
        )
        return change_of_pairs - work


@dataclass(frozen=True, eq=False)
class _Curvature:
    """The factored Hessian of the particles that may move, made definite if it was not."""

    factor: Factorization
    free_n: NDArray[np.bool_]
    changed: bool

    def step(self, net_nd: NDArray[np.float64]) -> NDArray[np.float64]:
        step = np.zeros_like(net_nd)
        step[self.free_n] = self.factor.solve(net_nd[self.free_n].ravel()).reshape(-1, net_nd.shape[1])
        return step


def _curvature(landscape: _Landscape, state: _State, regularization: float) -> _Curvature:
    """Return the factored Hessian; `regularization` [1] in units of each coordinate's own stiffness is added."""
    touching = state.touching
    count = touching.count_n()
    free = count > 0
    if landscape.pushed:
        free |= (state.single_ndd != 0.0).any(axis=(1, 2))
        regularization = max(regularization, _SLIDING)
    else:
        # one particle of each cluster is held in place of the cluster's translations
        links = sp.coo_array((np.ones(len(touching)), (touching.i_c, touching.j_c)), shape=(len(free), len(free)))
        _, cluster_n = connected_components(links, directed=False)
        # one that is held already does
        weight_n = count if landscape.held_n is None else np.where(landscape.held_n, touching.particles, count)
        order = np.lexsort((-weight_n, cluster_n))
        free[order[np.concatenate([[True], np.diff(cluster_n[order]) > 0])]] = False
    if landscape.held_n is not None:
        free &= ~landscape.held_n
    # what is pushed or leans on what is held needs no force to bear
    alone = landscape.held_n is None and not landscape.pushed
    rattling = rattlers_of(touching) if alone else np.zeros(touching.particles, dtype=np.bool_)
    weak = rattling[touching.i_c] | rattling[touching.j_c]
    # contacts that hold no particle bend sideways under their own force: leave that out, and regularize it
    pushes: NDArray[np.float64] = np.where(weak, 0.0, state.first_c)
    matrix = _second(touching, pushes, state.second_c, state.single_ndd).matrix(np.repeat(free, touching.dimension))
    if not matrix.shape[0]:
        return _Curvature(factorize(matrix), free, False)
    diagonal = np.abs(matrix.diagonal())
    diagonal = np.maximum(diagonal, 1e-3 * diagonal.mean())
    held = np.repeat(~rattling[free], touching.dimension)
    added = np.where(held, regularization, max(regularization, 1e-3)) * diagonal
    while True:
        try:
            whole = matrix + sp.diags_array(added, format="csr") if added.any() else matrix
            factor = factorize(whole, kind="symmetric")
            if factor.inertia.positive == matrix.shape[0]:
                return _Curvature(factor, free, bool((added > 0.0)[held].any()))
        except NotDefinite:
            pass
        regularization = max(10.0 * regularization, 1e-8)
        added = np.maximum(added, regularization * diagonal)


def _second(
    contacts: Contacts, first_c: NDArray[np.float64], second_c: NDArray[np.float64], single_ndd: NDArray[np.float64]
) -> Assembled:
    """Return the second derivatives of contacts and of what acts on single particles."""
    still = np.zeros((contacts.particles, 0, 0))
    d = contacts.dimension
    elements = [elements_of(contacts, first_c, second_c)]
    return assemble(elements, still, d, single_nqq=single_ndd, basis_edd=np.zeros((0, d, d)))


def _unstable_directions(landscape: _Landscape, state: _State) -> int:
    """Return the negative eigenvalues of the second derivative by all particles that can move, rattlers among them."""
    near = state.near
    rounding = 4.0 * np.finfo(float).eps * landscape.extent(state)
    # contacts that touch to rounding count as closed
    contacts = near.select(near.gap_c < rounding)
    moves = np.ones(contacts.particles, dtype=bool) if landscape.held_n is None else ~landscape.held_n
    contacts = contacts.select(moves[contacts.i_c] | moves[contacts.j_c])
    terms = contact_terms(landscape.effects, contacts.distance_c, contacts.contact_distance_c, closing=True)
    second = _second(contacts, terms.first_c, terms.second_c, state.single_ndd)
    matrix = second.matrix(np.repeat(moves, contacts.dimension))
    stiffest = float(np.abs(matrix.diagonal()).max(initial=0.0))
    bound = stability_bound(stiffest, state.max_force, float(landscape.packing.radius_n.min()))
    try:
        return eigenvalues_below(matrix, -bound) if bound > 0.0 else 0
    except NotDefinite:
        return 1


def polish(
    packing: Packing,
    effects: tuple[Any, ...],
    *,
    force_tolerance: float,
    step_limit: int = 60,
    method: Newton | None = None,
    deadline: float = math.inf,
) -> Polished:
    """Return the packing after Newton steps in its box; whether it converged is in `outcome`, no error is raised.

    Parameters
    ----------
    packing
        Where to start: forces should balance to about 1e-5 of the mean contact force already.
    effects
        The scene's effects.
    force_tolerance
        Stop when the largest net force falls to this times the mean contact force [1].
    step_limit
        Largest number of steps.
    method
        Newton() unless given.
    deadline
        Stop, with Outcome.TIME_LIMIT, when `time.process_time()` has passed this [s].

    Examples
    --------
    >>> import packmech as pm
    >>> crystal = pm.lattice_packing("triangular", repeats=(4, 4), relative_overlap=0.05)
    >>> shaken = crystal.position_nd + 1e-3 * np.random.default_rng(1).normal(size=(16, 2))
    >>> polished = polish(crystal.replace(position_nd=shaken), (pm.Repulsion(),), force_tolerance=1e-12)
    >>> polished.outcome.name, polished.residual < 1e-12, polished.steps < 6
    ('CONVERGED', True, True)

    """
    instance("packing", packing, Packing)
    tolerance = positive("force_tolerance", force_tolerance)
    limit = integer("step_limit", step_limit, at_least=0)
    method = Newton() if method is None else method
    instance("method", method, Newton)
    if not packing.plain:
        refuse_single(effects, "Newton's method on packings with links or shapes")
        with single_thread():
            return polish_downhill(packing, effects, force_tolerance=tolerance, step_limit=limit)
    smallest = float(packing.diameter_n.min())
    landscape = _Landscape(packing, effects, positive("method.skin", method.skin) * smallest)
    longest = positive("method.largest_step", method.largest_step) * smallest
    needs_second(effects, "Newton's method")
    with single_thread():
        state = best = landscape.at(packing.position_nd)
        steps = regularized = negative = 0
        regularization = 0.0
        while True:
            floor = landscape.floor(state)
            if state.mean_force <= floor:
                outcome = Outcome.UNJAMMED
                break
            if state.residual <= tolerance or state.max_force <= floor:
                negative = _unstable_directions(landscape, state)
                outcome = Outcome.CONVERGED if state.residual <= tolerance else Outcome.ROUNDING_FLOOR
                outcome = Outcome.UNSTABLE if negative else outcome
                break
            if steps == limit:
                outcome = Outcome.STEP_LIMIT
                break
            if time.process_time() > deadline:
                outcome = Outcome.TIME_LIMIT
                break
            curvature = _curvature(landscape, state, regularization)
            step = curvature.step(state.net_nd)
            step *= min(1.0, longest / max(float(np.sqrt((step**2).sum(axis=1)).max()), 1e-300))
            reached = _descend(landscape, state, step)
            if reached is None or (reached.max_force > 0.5 * best.max_force and best.max_force <= _FLOORS * floor):
                near_floor = best.max_force <= _FLOORS * landscape.floor(best)
                negative = _unstable_directions(landscape, best)
                outcome = Outcome.ROUNDING_FLOOR if near_floor else Outcome.STALLED
                outcome = Outcome.UNSTABLE if near_floor and negative else outcome
                state = best
                break
            steps += 1
            regularized += curvature.changed
            state = reached
            if state.max_force < best.max_force:
                best = state
    final = packing.replace(position_nd=state.position_nd)
    return Polished(
        final, outcome, state.residual, state.max_force, state.mean_force,
        steps, landscape.evaluations, regularized, negative,
    )  # fmt: skip


def _descend(landscape: _Landscape, state: _State, step: NDArray[np.float64]) -> _State | None:
    """Return the state after the longest halving of the step that lowers the energy or the largest net force."""
    slope = -float((state.net_nd * step).sum())
    size = 1.0
    for _ in range(_HALVINGS):
        position = state.position_nd + size * step
        if np.array_equal(position, state.position_nd):
            return None
        change = landscape.energy_change(state, position)
        reached = landscape.at(position)
        if change <= _ARMIJO * size * slope or reached.max_force < 0.5 * state.max_force:
            return reached
        size *= 0.5
    return None


def newton(
    scene: Scene, *, force_tolerance: float, step_limit: int = 60, method: Newton | None = None, check: bool = True
) -> Run:
    """Return the run of Newton's method from a packing that is nearly at rest, in its box.

    Parameters
    ----------
    scene
        The scene.
    force_tolerance
        Stop when the largest net force falls to this times the mean contact force [1].
    step_limit
        Largest number of steps.
    method
        Newton() unless given.
    check
        Raise NotConverged when the outcome is not a success; otherwise return the run all the same.

    Returns
    -------
    Run
        Outcome.ROUNDING_FLOOR, a success, where the tolerance lies below what the coordinates' rounding allows;
        Outcome.UNSTABLE where forces balance on a saddle of the energy.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind or not positive.
    NotConverged
        If forces do not come to balance and `check` is set; its `.run` holds what was reached.

    Examples
    --------
    >>> import packmech as pm
    >>> crystal = pm.lattice_packing("triangular", repeats=(4, 4), relative_overlap=0.05)
    >>> scene = pm.Scene(crystal.replace(position_nd=crystal.position_nd * (1.0 + 1e-9)), (pm.Repulsion(),))
    >>> newton(scene, force_tolerance=1e-12).outcome.name
    'CONVERGED'

    """
    start = time.process_time()
    instance("scene", scene, Scene)
    done = polish(scene.packing, scene.effects, force_tolerance=force_tolerance, step_limit=step_limit, method=method)
    run = Run(
        packing=done.packing,
        outcome=done.outcome,
        residual=done.residual,
        steps=done.steps,
        force_evaluations=done.force_evaluations,
        seconds=time.process_time() - start,
        report={"regularized_steps": done.regularized, "negative_modes": done.negative},
        unmet=unmet_conditions(done.outcome, Condition("force residual", done.residual, force_tolerance)),
    )
    if check and not run.ok:
        raise NotConverged(run)
    return run
