"""Is a scene at rest in a minimum of its energy? The signs of its second derivative on all motions in its box.

Every particle counts that bears a force, rattlers among them, and everything that acts on single ones. One sparse
factorization gives the number of unstable directions (Sylvester's law of inertia); a few more, only where there are
some, one of these directions.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from packmech.constraints.factor import ConstraintFactor
from packmech.constraints.redundancy import workable_links
from packmech.effects import acting_friction, lacking_second, rough_walls
from packmech.linalg.factor import NotDefinite
from packmech.mechanics.frictional import frictional_network, frictional_system
from packmech.mechanics.linked_systems import (
    SOFT,
    Operator,
    Solve,
    link_motions,
    operator_of,
    rows_on,
)
from packmech.mechanics.network import Network, contact_network
from packmech.mechanics.system import assembled_system
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

    @property
    def unstable(self) -> int:
        """Number of unstable directions, 1 where it is not known: what was not judged does not pass for a minimum."""
        return 1 if self.negative is None else self.negative

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
        if acting_friction(scene.effects) is not None or rough_walls(scene.effects):
            return _sticking(scene, unbalanced / radius)
        operator, free = curvature_of(scene)
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
    lacking = lacking_second(scene.effects)
    if lacking and scene.packing.shapes.has_orientations:
        # pairs are checked where an effect is registered
        return f"{type(lacking[0]).__qualname__} has no body_second"
    return ""


def _stiffest(operator: Operator) -> float:
    return float(np.abs(operator.matrix.diagonal()).max(initial=0.0))


def _row_sum(operator: Operator) -> float:
    """Return a bound on every curvature."""
    return float(np.asarray(abs(operator.matrix).sum(axis=1)).max(initial=0.0))


def curvature_of(scene: Scene) -> tuple[Operator, NDArray[np.bool_]]:
    """Return the second derivative on the motions that links admit, and which of the (N, q) coordinates can move."""
    network = _whole(scene)
    system = assembled_system(scene, network, strained=False)
    matrix, free, d = system.matrix(), network.free_nq, network.dimension
    none = np.zeros((d * (d + 1) // 2, 0))
    rows = rows_on(system.links, network.free_f, np.ones(matrix.shape[0]), none, 1.0)
    return operator_of(matrix, rows, network.dimension), free


def _whole(scene: Scene) -> Network:
    """Return all particles with their contacts."""
    packing, effects = scene.packing, scene.effects
    network = contact_network(packing, effects, rattlers="keep")
    links = packing.links
    if len(links) and (links.i_l != links.j_l).all():
        # refuses links that hold to second order only, whose forces are not determined
        network = replace(network, links=ConstraintFactor(packing, workable_links(packing)))
    return network


def _sticking(scene: Scene, unbalanced: float) -> Stability:
    """Return what the stiffness of displacements and rotations says where all contacts stick.

    Tangential forces leave it without symmetry: a direction is unstable where an eigenvalue is negative, not where the
    second-order work is. That is asked first, because it bounds the eigenvalues and a factorization answers it.
    """
    found = frictional_network(scene, "keep")
    network, none = found.network, np.zeros(found.at_limit_sc.shape, dtype=bool)
    matrix = frictional_system(scene, found, "exact", none)[0].matrix()
    bound = max(_CERTAIN_STICKING * float(np.abs(matrix.diagonal()).max(initial=0.0)), _SIDEWAYS * unbalanced)
    rows = sp.csr_array(network.link_rows[0][:, network.free_f])
    even = operator_of(sp.csr_array(0.5 * (matrix + matrix.T)), rows, network.dimension)
    negative = even.below(-bound) if bound > 0.0 else 0
    if negative and (matrix.shape[0] <= _DENSE or rows.shape[0]):
        across = link_motions(rows)
        negative = int((np.linalg.eigvals(across.T @ (matrix @ across)).real < -bound).sum())
    elif negative:
        low = bound
        while even.below(-2.0 * low):
            low *= 2.0
        start = np.modf(np.sqrt(2.0) * (np.arange(even.size) + 1.0))[0]
        near = spla.eigs(sp.csc_array(matrix), k=negative + 2, sigma=-2.0 * low, v0=start, return_eigenvectors=False)
        negative = int((near.real < -bound).sum())
    return Stability(negative, "", bound)
