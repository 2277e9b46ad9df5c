"""Is a scene at rest in a minimum of its energy? The signs of its second derivative on all motions in its box.

Every particle counts that bears a force, rattlers among them, and everything that acts on single ones. One sparse
factorization gives the number of unstable directions (Sylvester's law of inertia); a few more, only where there are
some, one of these directions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from packmech.constraints.factor import ConstraintFactor
from packmech.constraints.redundancy import workable_links
from packmech.contacts import Contacts, find_contacts
from packmech.effects import contact_terms, held_particles, single_effects, single_terms
from packmech.linalg.block_system import gather
from packmech.linalg.factor import NotDefinite
from packmech.mechanics.frictional import acting_friction, frictional_network, frictional_system
from packmech.mechanics.hessian import bond_sums, prestressed
from packmech.mechanics.linked_systems import SOFT, FreeOperator, LinkedOperator, Operator, Solve
from packmech.mechanics.shaped import shaped_hessian
from packmech.scene import Scene

# a curvature is that of a saddle below minus this part of the largest, whatever forces are left
_CERTAIN = 5e-9
# forces that do not balance bend contacts sideways: so many times their size over the smallest radius may be theirs
_SIDEWAYS = 4.0
# the same for a stiffness without symmetry, whose eigenvalues are known to the root of rounding; rows up to which all
# of them are found
_CERTAIN_STICKING, _DENSE = 1e-7, 600
# inverse iterations for an unstable direction: it is within the last octave of the lowest curvature long before
_ITERATIONS, _LEAST = 40, 4
# step of differences of forces on single particles [smallest radius]
_STEP = 1e-6
# shifts that are tried, where one is an eigenvalue
_SHIFTS = 4


@dataclass(frozen=True, eq=False)
class Stability:
    """What the second derivative of a scene's energy says of its place.

    Attributes
    ----------
    negative
        Number of unstable directions; None where it is not known.
    reason
        Why it is not known; empty where it is.
    bound
        Curvature, in size, from which on a direction counts as unstable [force/length].

    """

    negative: int | None
    reason: str = ""
    bound: float = 0.0
    _operator: Operator | None = None
    _free_nq: NDArray[np.bool_] | None = None

    def to_dict(self) -> dict[str, Any]:
        """Return what a run reports of it: "negative_modes", and as "not_judged" why that is not known."""
        found: dict[str, Any] = {"negative_modes": self.negative}
        if self.negative is None:
            found["not_judged"] = f"minimum or saddle: {self.reason}"
        return found

    def direction(self) -> NDArray[np.float64]:
        """Return an (N, q) unstable direction, turns of shapes after positions, its largest entry 1; always the same.

        It lies among the lowest curvatures and has a part along each of those: no symmetry of the packing is kept.
        """
        operator, free = self._operator, self._free_nq
        if not self.negative or operator is None or free is None:
            raise ValueError(f"scene must be unstable for a direction, got {self.negative} unstable directions")
        low, high = self.bound, max(2.0 * self.bound, _row_sum(operator))
        while high > 2.0 * low:
            middle = float(np.sqrt(low * high))
            low, high = (middle, high) if _below(operator, -middle) else (low, middle)
        solve = _solver_near(operator, -high)
        # directions made of the coordinates' numbers
        vector = operator.project(2.0 * np.modf(np.sqrt(2.0) * (np.arange(operator.size) + 1.0))[0] - 1.0)
        for number in range(_ITERATIONS):
            vector = solve(vector)
            vector /= np.sqrt(vector @ vector)
            if number >= _LEAST and vector @ operator.apply(vector) < -0.5 * low:
                break
        whole = np.zeros(free.shape)
        whole[free] = vector / np.abs(vector).max()
        return whole


def stability(scene: Scene, unbalanced: float = 0.0) -> Stability:
    """Return whether the scene's energy has a minimum where its particles are, its box as it is.

    Motions that cost nothing are none that destabilize: translations, rattlers, floppy modes. Contacts that just touch
    count as closed. A direction is unstable where its curvature is negative by more than 1e-10 of the largest, and by
    more than what forces do not balance explains; but always below -5e-9 of the largest. With friction
    displacements and rotations are looked at where every contact sticks, which is as stable as it can be, and a
    direction counts below -1e-7 of the largest: the stiffness has no symmetry there.

    Parameters
    ----------
    scene
        The scene, at rest but for the unbalanced forces.
    unbalanced
        The largest net force [force].

    Examples
    --------
    >>> import packmech as pm
    >>> row = pm.Packing([[0.5 + k, 1.0] for k in range(6)], [0.525] * 6, pm.Box([[6.0, 0.0], [0.0, 3.0]]))
    >>> crystal = pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.01)
    >>> [stability(pm.Scene(one, (pm.Repulsion(),))).negative for one in (row, crystal)]
    [5, 0]

    """
    reason = _unknown(scene)
    if reason:
        return Stability(None, reason)
    radius = float(scene.packing.radius_n.min())
    try:
        if acting_friction(scene) is not None:
            return _sticking(scene, unbalanced / radius)
        operator, free = _curvature(scene)
        bound = stability_bound(_stiffest(operator), unbalanced, radius)
        negative = operator.below(-bound) if bound > 0.0 else 0
    except NotDefinite:
        return Stability(None, "the second derivative cannot be factored")
    return Stability(max(negative, 0), "", bound, operator, free)


def _below(operator: Operator, bound: float) -> bool:
    """Return whether an eigenvalue lies at the bound or below it."""
    try:
        return operator.below(bound) > 0
    except NotDefinite:
        return True


def _solver_near(operator: Operator, shift: float) -> Solve:
    """Return the solver shifted by about as much, away from eigenvalues."""
    for _ in range(_SHIFTS):
        try:
            return operator.solver(shift)
        except NotDefinite:
            shift *= 1.1
    return operator.solver(shift)


def stability_bound(stiffest: float, unbalanced: float, radius: float) -> float:
    """Return the curvature, in size, from which on a negative one is that of a saddle.

    Parameters
    ----------
    stiffest
        Largest second derivative by one coordinate [force/length].
    unbalanced
        Largest net force [force].
    radius
        Smallest radius [length].

    """
    return min(max(SOFT * stiffest, _SIDEWAYS * unbalanced / radius), _CERTAIN * stiffest)


def _unknown(scene: Scene) -> str:
    """Return why there is no second derivative, or nothing where there is one."""
    if acting_friction(scene) is not None and (scene.packing.shapes is not None or scene.packing.links is not None):
        return "friction of shapes or links at rest has no second derivative"
    lacking = _without_second(scene.effects)
    if lacking and scene.packing.shapes is not None:
        # pairs are checked where an effect is registered
        return f"{type(lacking[0]).__qualname__} has no body_second"
    return ""


def _without_second(effects: tuple[Any, ...]) -> tuple[Any, ...]:
    """Return the effects on single particles that give no second derivative."""
    return tuple(one for one in single_effects(effects) if not hasattr(type(one), "body_second"))


def _single_second(scene: Scene, second: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (N, d, d) second derivatives of what acts on single particles, given but where they are not known.

    Those come from differences of forces.

    The step errs by the square of a millionth of the smallest radius, over the length on which the forces change.
    """
    packing = scene.packing
    lacking = _without_second(scene.effects)
    if lacking:
        step, second = _STEP * float(packing.radius_n.min()), second.copy()
        for axis in range(packing.dimension):
            shift = np.zeros(packing.dimension)
            shift[axis] = step
            there, back = (
                single_terms(lacking, packing, packing.position_nd + side * shift).force_nd for side in (1.0, -1.0)
            )
            second[:, :, axis] -= (there - back) / (2.0 * step)
        second = 0.5 * (second + second.transpose(0, 2, 1))
    return second


def _stiffest(operator: Operator) -> float:
    return float(np.abs(_matrix(operator).diagonal()).max(initial=0.0))


def _row_sum(operator: Operator) -> float:
    """Return a bound on every curvature."""
    return float(np.asarray(abs(_matrix(operator)).sum(axis=1)).max(initial=0.0))


def _matrix(operator: Operator) -> Any:
    assert isinstance(operator, FreeOperator | LinkedOperator)
    return operator.matrix


def _curvature(scene: Scene) -> tuple[Operator, NDArray[np.bool_]]:
    """Return the second derivative on the motions that links admit, and which of the (N, q) coordinates can move."""
    packing, effects = scene.packing, scene.effects
    if packing.shapes is not None:
        found = shaped_hessian(scene, "exact", rattlers="keep")
        free = found.network.free_nq
        return FreeOperator(found.sums.matrix(free.ravel())), free
    held = held_particles(effects, packing.particles)
    moves = np.ones(packing.particles, dtype=bool) if held is None else ~held
    free = np.repeat(moves[:, None], packing.dimension, axis=1)
    contacts = find_contacts(packing, gap_tolerance=None)
    contacts = contacts.select(moves[contacts.i_c] | moves[contacts.j_c])
    terms = contact_terms(effects, contacts.distance_c, contacts.contact_distance_c, closing=True)
    single = single_terms(effects, packing)
    links = None if packing.links is None else ConstraintFactor(packing, workable_links(packing))
    tension = None if links is None else _tension(links, contacts, terms.first_c, single.force_nd, moves)
    pairs = prestressed(contacts, terms, "exact", links, tension)
    sums = bond_sums(pairs.pairs, pairs.first_c, pairs.second_c)
    sums.diagonal_ndd[:] += _single_second(scene, single.second_ndd)
    matrix = sums.position_matrix(moves)
    if links is None:
        return FreeOperator(matrix), free
    rows = sp.csr_array(links.independent_rows()[0][:, free.ravel()])
    rows = rows[np.diff(rows.indptr) > 0]
    return LinkedOperator(matrix, rows, packing.dimension), free


def _sticking(scene: Scene, unbalanced: float) -> Stability:
    """Return what the stiffness of displacements, and of rotations times radii, says where all contacts stick.

    Tangential forces leave it without symmetry: a direction is unstable where an eigenvalue is negative, not where the
    second-order work is. That is asked first, because it bounds the eigenvalues and a factorization answers it.
    """
    packing = scene.packing
    n, d, k = packing.particles, packing.dimension, 1 if packing.dimension == 2 else 3
    network = frictional_network(scene, "keep")
    none = np.zeros(len(network.first_c), dtype=bool)
    system = frictional_system(network.forces, network.first_c, network.second_c, "exact", none)
    scale = np.concatenate([np.ones(n * d), np.repeat(1.0 / packing.radius_n, k)])
    given = single_terms(scene.effects, packing).second_ndd
    single = sp.block_diag([*_single_second(scene, given), sp.csr_array((n * k, n * k))])
    held = held_particles(scene.effects, n)
    moves = np.ones(n, dtype=bool) if held is None else ~held
    free = np.concatenate([np.repeat(moves, d), np.repeat(moves, k)])
    matrix = system.matrix.multiply(scale[:, None]).multiply(scale[None, :]) + single
    matrix = sp.csr_array(matrix.tocsr()[free][:, free])
    bound = max(_CERTAIN_STICKING * float(np.abs(matrix.diagonal()).max(initial=0.0)), _SIDEWAYS * unbalanced)
    even = FreeOperator(sp.csr_array(0.5 * (matrix + matrix.T)))
    negative = even.below(-bound) if bound > 0.0 else 0
    if negative and matrix.shape[0] <= _DENSE:
        negative = int((np.linalg.eigvals(matrix.toarray()).real < -bound).sum())
    elif negative:
        low = bound
        while even.below(-2.0 * low):
            low *= 2.0
        start = np.modf(np.sqrt(2.0) * (np.arange(even.size) + 1.0))[0]
        near = spla.eigs(sp.csc_array(matrix), k=negative + 2, sigma=-2.0 * low, v0=start, return_eigenvectors=False)
        negative = int((near.real < -bound).sum())
    return Stability(negative, "", bound)


def _tension(
    links: ConstraintFactor,
    contacts: Contacts,
    first_c: NDArray[np.float64],
    single_nd: NDArray[np.float64],
    moves_n: NDArray[np.bool_],
) -> NDArray[np.float64]:
    """Return the (L,) forces in the links that balance those of contacts and on single particles that can move."""
    push = gather(contacts.i_c, contacts.j_c, contacts.normal_cd, first_c, contacts.particles) - single_nd
    if moves_n.all():
        return links.multipliers(push)
    free = np.repeat(moves_n, contacts.dimension)
    gradient = links.gradient_lx[:, free]
    found = spla.lsqr(gradient.T, -push.ravel()[free], atol=1e-15, btol=1e-15, iter_lim=10 * gradient.shape[0] + 100)
    return np.asarray(found[0], dtype=np.float64)
