"""Newton's method for the last digits: from forces that nearly balance to the floor of double precision.

There are three loops. That of discs and spheres without bonds keeps the pair list of `Newton.skin` and sees changes of
the energy free of cancellation, that of links and shapes goes on to rounding whatever is asked for; the general one,
of bonds and whatever else acts, stops at the tolerance. In place of the other two it takes 0.9 to 1.2 times as long in
a quench.
"""

from __future__ import annotations

import copy
import time
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from packmech.check import instance, integer, positive
from packmech.constraints.factor import ConstraintFactor
from packmech.constraints.redundancy import workable_links
from packmech.contacts.elements import elements_of
from packmech.contacts.rattlers import rattlers_of
from packmech.effects import acts_on_single, bonds_of, interactions_of, needs_second, single_terms
from packmech.jit.blas import single_thread
from packmech.linalg.factor import NotDefinite, factorize
from packmech.loop.run_loop import TimeUp
from packmech.measure.contact_forces import ContactForces, resting_forces
from packmech.mechanics.assembly import assemble
from packmech.mechanics.linked_systems import Operator
from packmech.mechanics.stability import curvature_of, stability
from packmech.minimize.second_order.soft_network import SoftNetwork, Units, length_unit
from packmech.minimize.second_order.soft_newton import descend, judge, standing
from packmech.packing import Packing
from packmech.result import Condition, NotConverged, Outcome, Run, unmet_conditions
from packmech.scene import Scene

# whether time is up
IsLate = Callable[[], bool]


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


def polish_downhill(
    packing: Packing,
    effects: tuple[Any, ...],
    *,
    force_tolerance: float,
    step_limit: int,
    is_late: IsLate = lambda: False,
) -> Polished:
    """Return the packing with links or shapes after Newton steps in its box; whether it converged is in `outcome`.

    Parameters
    ----------
    packing, effects, force_tolerance, step_limit, is_late
        As in `polish`.

    """
    units = Units(effects, length_unit(packing), 1.0)
    none = np.zeros((0, packing.dimension, packing.dimension))
    reached = units.reduced(packing)

    def watch(lower: Packing) -> None:
        nonlocal reached
        reached = lower
        if is_late():
            raise TimeUp

    try:
        state = descend(reached, units, none, None, iterations=step_limit, watch=watch)
        outcome = judge(state, force_tolerance)
    except TimeUp:
        state, outcome = standing(reached, units, none, None), Outcome.TIME_LIMIT
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
        Pairs are searched within this reach beyond contact [contact distance].

    """

    largest_step: float = 0.1
    skin: float = 0.3

    def check(self) -> None:
        """Check every number; the error names the first that is wrong."""
        positive("method.largest_step", self.largest_step)
        positive("method.skin", self.skin)


def _at(state: SoftNetwork, packing: Packing) -> SoftNetwork:
    """Return the network of the same particles where they are in a packing."""
    moved = float(np.sqrt(((packing.position_nd - state.searched_nd) ** 2).sum(axis=1)).max())
    if moved > 0.5 * state.reach * float(packing.diameter_n.min()):
        return SoftNetwork(packing, state.units, state.basis_kdd, None, reach=state.reach)
    found = copy.copy(state)
    found.measure(packing)
    return found


def _floor(state: SoftNetwork) -> float:
    """Return the net force that rounding of the coordinates makes: their spacing times a particle's stiffness."""
    one = state.contacts
    stiffness_n = np.bincount(np.concatenate([one.i_c, one.j_c]), np.tile(state.second_c, 2), minlength=one.particles)
    if state.single is not None:
        stiffness_n = stiffness_n + np.abs(state.single.second_ndd).sum(axis=2).max(axis=1)
    return float(stiffness_n.max(initial=0.0) * np.spacing(state.extent))


def _energy_change(state: SoftNetwork, packing: Packing) -> float:
    """Return the energy of a packing nearby less that of the network's, free of cancellation."""
    change = state.growth_to(packing)
    if state.acting:
        start, effects = state.packing, state.units.effects
        step = packing.position_nd - start.position_nd
        for share, weight in _SIMPSON.items():
            force_nd = single_terms(effects, start, start.position_nd + share * step).force_nd
            change -= weight * float((force_nd * step).sum())
    return change


def _step(state: SoftNetwork) -> tuple[NDArray[np.float64], bool]:
    """Return Newton's step, its Hessian made definite where it is not, and whether that was needed."""
    touching, held_n = state.contacts, state.held_n
    count, d = touching.count_n(), touching.dimension
    free = count > 0
    regularization = 0.0
    if state.single is not None:
        free |= (state.single.second_ndd != 0.0).any(axis=(1, 2))
        regularization = _SLIDING
    else:
        # one particle of each cluster is held in place of the cluster's translations
        links = sp.coo_array((np.ones(len(touching)), (touching.i_c, touching.j_c)), shape=(len(free), len(free)))
        _, cluster_n = connected_components(links, directed=False)
        # one that is held already does
        weight_n = count if held_n is None else np.where(held_n, touching.particles, count)
        order = np.lexsort((-weight_n, cluster_n))
        free[order[np.concatenate([[True], np.diff(cluster_n[order]) > 0])]] = False
    if held_n is not None:
        free &= ~held_n
    # what is pushed or leans on what is held needs no force to bear
    alone = held_n is None and state.single is None
    rattling = rattlers_of(touching) if alone else np.zeros(touching.particles, dtype=np.bool_)
    weak = rattling[touching.i_c] | rattling[touching.j_c]
    # contacts that hold no particle bend sideways under their own force: leave that out, and regularize it
    elements = elements_of(touching, np.where(weak, 0.0, state.first_c), state.second_c)
    single_ndd = None if state.single is None else state.single.second_ndd
    second = assemble([elements], state.turn_nkt, d, single_nqq=single_ndd, basis_edd=state.basis_kdd)
    matrix = second.matrix(np.repeat(free, d))
    step = np.zeros_like(state.uphill_nd)
    if not matrix.shape[0]:
        return step, False
    diagonal = np.abs(matrix.diagonal())
    diagonal = np.maximum(diagonal, 1e-3 * diagonal.mean())
    bound = np.repeat(~rattling[free], d)
    added = np.where(bound, regularization, max(regularization, 1e-3)) * diagonal
    while True:
        try:
            whole = matrix + sp.diags_array(added, format="csr") if added.any() else matrix
            factor = factorize(whole, kind="symmetric")
            if factor.inertia.positive == matrix.shape[0]:
                step[free] = factor.solve(-state.uphill_nd[free].ravel()).reshape(-1, d)
                return step, bool((added > 0.0)[bound].any())
        except NotDefinite:
            pass
        regularization = max(10.0 * regularization, 1e-8)
        added = np.maximum(added, regularization * diagonal)


def displaced(packing: Packing, change_nq: NDArray[np.float64]) -> Packing:
    """Return the packing after displacements and turns, its links at their lengths."""
    moved = packing.moved(change_nq)
    return ConstraintFactor(packing, workable_links(packing)).projected(moved)


def _assembled_step(
    found: ContactForces, operator: Operator, free_nq: NDArray[np.bool_], stiffest: float
) -> tuple[NDArray[np.float64], float, bool]:
    """Return Newton's step by the second derivatives of a scene, as definite as need be: whether they were not.

    And the slope of the energy along it.
    """
    turn_nkt = found.scene.packing.turn_nkt
    torque = np.einsum("nkt,nt->nk", turn_nkt, found.torque_nk[:, : turn_nkt.shape[2]])
    uphill = -np.hstack([found.force_nd, torque])[free_nq]
    step, regularization = np.zeros(free_nq.shape), _SLIDING
    if not stiffest > 0.0:
        return step, 0.0, False
    while operator.below(-0.5 * regularization * stiffest):
        regularization *= 10.0
    along = operator.solver(-regularization * stiffest)(-uphill)
    step[free_nq] = along
    return step, float(uphill @ along), regularization > _SLIDING


def _polish_assembled(scene: Scene, tolerance: float, step_limit: int, longest: float, is_late: IsLate) -> Polished:
    """Return the packing of a scene after Newton steps by whatever second derivatives its elements have."""
    found = best = resting_forces(scene)
    extent = max(float(np.abs(one).max()) for one in (scene.packing.position_nd, scene.packing.box.lattice_dd))
    evaluations, steps, regularized, negative = 1, 0, 0, 0
    while True:
        scene, imbalance = found.scene, found.largest_imbalance
        operator, free_nq = curvature_of(scene)
        stiffest = float(np.abs(operator.matrix.diagonal()).max(initial=0.0))
        floor = stiffest * float(np.spacing(extent))
        if found.mean_force <= floor:
            outcome = Outcome.UNJAMMED
            break
        if found.residual <= tolerance or imbalance <= floor:
            outcome = Outcome.CONVERGED if found.residual <= tolerance else Outcome.ROUNDING_FLOOR
            break
        if steps == step_limit:
            outcome = Outcome.STEP_LIMIT
            break
        if is_late():
            outcome = Outcome.TIME_LIMIT
            break
        step, slope, changed = _assembled_step(found, operator, free_nq, stiffest)
        size, reached = min(1.0, longest / max(float(np.sqrt((step**2).sum(axis=1)).max()), 1e-300)), None
        for _ in range(_HALVINGS):
            moved = scene.replace(packing=displaced(scene.packing, size * step))
            reached = resting_forces(moved)
            evaluations += 1
            lower = reached.energy <= found.energy + _ARMIJO * size * slope
            if lower or reached.largest_imbalance < 0.5 * imbalance:
                break
            size, reached = 0.5 * size, None
        if reached is None or (imbalance <= _FLOORS * floor and reached.largest_imbalance > 0.5 * imbalance):
            outcome = Outcome.ROUNDING_FLOOR if best.largest_imbalance <= _FLOORS * floor else Outcome.STALLED
            found = best
            break
        steps, regularized, found = steps + 1, regularized + changed, reached
        best = found if found.largest_imbalance < best.largest_imbalance else best
    if outcome in (Outcome.CONVERGED, Outcome.ROUNDING_FLOOR):
        negative = stability(found.scene, found.largest_imbalance).unstable
        outcome = Outcome.UNSTABLE if negative else outcome
    return Polished(
        found.scene.packing, outcome, found.residual, found.largest_imbalance, found.mean_force,
        steps, evaluations, regularized, negative,
    )  # fmt: skip


def polish(
    packing: Packing,
    effects: tuple[Any, ...],
    *,
    force_tolerance: float,
    step_limit: int = 60,
    method: Newton | None = None,
    is_late: IsLate = lambda: False,
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
    is_late
        Whether time is up: it then stops, with Outcome.TIME_LIMIT.

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
    needs_second(effects, "Newton's method")
    longest = positive("method.largest_step", method.largest_step) * float(packing.diameter_n.min())
    if bonds_of(effects) or interactions_of(effects) or (not packing.plain and acts_on_single(effects)):
        with single_thread():
            return _polish_assembled(Scene(packing, effects), tolerance, limit, longest, is_late)
    if not packing.plain:
        with single_thread():
            return polish_downhill(packing, effects, force_tolerance=tolerance, step_limit=limit, is_late=is_late)
    none, reach = np.zeros((0, packing.dimension, packing.dimension)), positive("method.skin", method.skin)
    with single_thread():
        state = best = SoftNetwork(packing, Units(effects, 1.0, 1.0), none, None, reach=reach)
        evaluations, steps, regularized, negative = 1, 0, 0, 0
        while True:
            floor, largest = _floor(state), state.largest_force()
            if state.mean_force <= floor:
                outcome = Outcome.UNJAMMED
                break
            if state.residual <= tolerance or largest <= floor:
                negative = stability(Scene(state.packing, effects), largest).unstable
                outcome = Outcome.CONVERGED if state.residual <= tolerance else Outcome.ROUNDING_FLOOR
                outcome = Outcome.UNSTABLE if negative else outcome
                break
            if steps == limit:
                outcome = Outcome.STEP_LIMIT
                break
            if is_late():
                outcome = Outcome.TIME_LIMIT
                break
            step, changed = _step(state)
            step *= min(1.0, longest / max(float(np.sqrt((step**2).sum(axis=1)).max()), 1e-300))
            reached, looks = _descend(state, step)
            evaluations += looks
            least = best.largest_force()
            if reached is None or (reached.largest_force() > 0.5 * least and least <= _FLOORS * floor):
                state = best
                near_floor = least <= _FLOORS * _floor(best)
                negative = stability(Scene(best.packing, effects), least).unstable
                outcome = Outcome.ROUNDING_FLOOR if near_floor else Outcome.STALLED
                outcome = Outcome.UNSTABLE if near_floor and negative else outcome
                break
            steps += 1
            regularized += changed
            state = reached
            if state.largest_force() < least:
                best = state
    mean = state.mean_force
    residual = state.residual if mean > 0.0 else 0.0
    return Polished(
        state.packing, outcome, residual, state.largest_force(), mean, steps, evaluations, regularized, negative
    )


def _descend(state: SoftNetwork, step: NDArray[np.float64]) -> tuple[SoftNetwork | None, int]:
    """Return the network after the longest halving of the step that lowers the energy or the largest net force.

    And the number of force evaluations; None where there is no such step.
    """
    packing = state.packing
    slope, size = float((state.uphill_nd * step).sum()), 1.0
    for number in range(_HALVINGS):
        position = packing.position_nd + size * step
        if np.array_equal(position, packing.position_nd):
            return None, number
        moved = packing.replace(position_nd=position)
        reached = _at(state, moved)
        lower = _energy_change(state, moved) <= _ARMIJO * size * slope
        if lower or reached.largest_force() < 0.5 * state.largest_force():
            return reached, number + 1
        size *= 0.5
    return None, _HALVINGS


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
