"""The densest hard packing nearby, by an interior-point method on the true distances.

    minimize the volume   over displacements u and strains e   subject to   |v_c + u_j - u_i + e v_c| >= sigma_c

for every pair c near enough to touch. Distances are convex in (u, e), so their linearizations lie below them: a step
that keeps the linear gaps open keeps the true ones open, and each iteration may linearize anew at the packing as it
is. One primal-dual step (Mehrotra's predictor and corrector) costs one factorization of the pair network; the
multipliers converge to the contact forces. The programs of Torquato and Jiao (Phys. Rev. E 82, 061302, 2010) solve
the same problem one linear program after another.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.contacts.network import candidate_pairs
from packmech.jit.compiled import kernel
from packmech.linalg.block_system import BlockSystem, Factored, extensions, gather

# pairs with gaps up to this fraction of the contact distance are constraints; the list lasts while no other can close
REACH = {2: 0.35, 3: 0.3}
_STEP_CAP = 0.1
_ENDLESS = 1e9


@kernel
def _measure(position, lattice, i_c, j_c, image_cd, vector, distance, normal):  # type: ignore[no-untyped-def]
    d = position.shape[1]
    for c in range(i_c.shape[0]):
        total = 0.0
        for a in range(d):
            v = position[j_c[c], a] - position[i_c[c], a]
            for b in range(d):
                v += lattice[a, b] * image_cd[c, b]
            vector[c, a] = v
            total += v * v
        r = np.sqrt(total)
        distance[c] = r
        for a in range(d):
            normal[c, a] = vector[c, a] / r


@kernel
def _carry_over(i_c, j_c, image_cd, old_i, old_j, old_image, slack, force, old_slack, old_force):  # type: ignore[no-untyped-def]
    """Copy slack and force of pairs that were listed before; both lists are sorted by (i, j, image)."""
    d = image_cd.shape[1]
    k = 0
    for c in range(i_c.shape[0]):
        while k < old_i.shape[0]:
            order = i_c[c] - old_i[k]
            if order == 0:
                order = j_c[c] - old_j[k]
            for a in range(d):
                if order == 0:
                    order = image_cd[c, a] - old_image[k, a]
            if order > 0:
                k += 1
                continue
            if order == 0:
                slack[c] = old_slack[k]
                force[c] = old_force[k]
            break


@dataclass(frozen=True, eq=False)
class HardState:
    """A packing on its way to the densest one nearby, in units of the mean diameter.

    Attributes
    ----------
    position_nd, lattice_dd
        (N, d) positions, not wrapped, and (d, d) lattice vectors.
    i_c, j_c, image_cd, contact_distance_c
        The pairs near enough to be constraints.
    slack_c, force_c
        Their slacks (gaps, once feasible) and multipliers; the mean force is of order one.
    barrier
        Mean of slack * force: how far from the end.
    violation
        Largest overlap that is left.
    iterations, factorizations
        What it cost.

    """

    position_nd: NDArray[np.float64]
    lattice_dd: NDArray[np.float64]
    i_c: NDArray[np.int64]
    j_c: NDArray[np.int64]
    image_cd: NDArray[np.int64]
    contact_distance_c: NDArray[np.float64]
    slack_c: NDArray[np.float64]
    force_c: NDArray[np.float64]
    barrier: float
    violation: float
    iterations: int = 0


class _Pairs:
    """The pairs near enough to touch, their geometry at the present positions, and how long the list lasts."""

    def __init__(
        self, position_nd: NDArray[np.float64], lattice_dd: NDArray[np.float64], radius_n: NDArray[np.float64]
    ) -> None:
        self.reach = REACH[position_nd.shape[1]]
        found = candidate_pairs(position_nd, radius_n, Box(lattice_dd), scale=1.0 + self.reach)
        self.i_c, self.j_c, self.image_cd = found
        self.sigma_c = radius_n[self.i_c] + radius_n[self.j_c]
        self.vector_cd = np.empty(self.image_cd.shape)
        self.distance_c = np.empty(len(self.i_c))
        self.normal_cd = np.empty(self.image_cd.shape)
        self.system = BlockSystem(self.i_c, self.j_c, *position_nd.shape)
        self._moved_nd = np.zeros_like(position_nd)
        self._strained = 0.0
        self._radius_n = radius_n

    def measure(self, position_nd: NDArray[np.float64], lattice_dd: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the gaps."""
        # copies: to the compiler a packing's arrays, which nobody may write to, are of another type
        position_nd, lattice_dd = position_nd.copy(), lattice_dd.copy()
        _measure(
            position_nd, lattice_dd, self.i_c, self.j_c, self.image_cd, self.vector_cd, self.distance_c, self.normal_cd
        )
        return self.distance_c - self.sigma_c

    def lasts(self, moved_nd: NDArray[np.float64], strain: float) -> bool:
        """Return whether no unlisted pair can be near closing after one more such step."""
        self._moved_nd += moved_nd
        self._strained += strain
        furthest = float((np.sqrt((self._moved_nd**2).sum(axis=1)) / self._radius_n).max())
        return furthest + (1.0 + self.reach) * self._strained < self.reach - _STEP_CAP - 0.02


class _Step:
    """Directions of one interior-point iteration; the strains are eliminated last."""

    def __init__(
        self,
        pairs: _Pairs,
        basis_kdd: NDArray[np.float64],
        load_k: NDArray[np.float64],
        slack_c: NDArray[np.float64],
        force_c: NDArray[np.float64],
        defect_c: NDArray[np.float64],
        tie: float,
    ) -> None:
        self.pairs, self.load_k, self.slack_c, self.force_c, self.defect_c = pairs, load_k, slack_c, force_c, defect_c
        self.shape = (pairs.system.particles, pairs.system.dimension)
        self.weight_c = force_c / slack_c
        self.stretch_ck = np.einsum("ca,kab,cb->ck", pairs.normal_cd, basis_kdd, pairs.vector_cd)
        # particles and strains are tied to where they are: by little, but enough where nothing else resists a motion
        tie += 1e-11 * float(self.weight_c.mean())
        self.factored: Factored = pairs.system.factor(
            pairs.normal_cd, self.weight_c, extra_n=np.full(self.shape[0], tie)
        )
        coupling = np.stack([self.gather(self.weight_c * column) for column in self.stretch_ck.T], axis=1)
        self.coupling = coupling
        self.relaxed = self.factored.solve(coupling)
        self.corner_kk = (self.stretch_ck.T * self.weight_c) @ self.stretch_ck - coupling.T @ self.relaxed
        self.corner_kk += tie * self.shape[0] * np.eye(len(load_k))

    def gather(self, weight_c: NDArray[np.float64]) -> NDArray[np.float64]:
        out = np.empty(self.shape)
        gather(self.pairs.i_c, self.pairs.j_c, self.pairs.normal_cd, weight_c, out)
        return out.ravel()

    def unbalanced(self) -> float:
        """Return the largest net force of the multipliers [mean force]."""
        return float(np.abs(self.gather(self.force_c)).max())

    def direction(self, target_c: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        """Return displacements, strains, and the changes of slack and force that lead to slack * force = target."""
        push = target_c / self.slack_c - self.weight_c * self.defect_c
        rough = self.factored.solve(self.gather(push))
        right = self.stretch_ck.T @ push - self.load_k - self.coupling.T @ rough
        strain_k = np.linalg.solve(self.corner_kk, right)
        u_nd = (rough - self.relaxed @ strain_k).reshape(self.shape)
        slack = np.empty(len(target_c))
        extensions(self.pairs.i_c, self.pairs.j_c, self.pairs.normal_cd, u_nd, slack)
        slack += self.stretch_ck @ strain_k + self.defect_c
        force = target_c / self.slack_c - self.force_c - self.weight_c * slack
        return u_nd, strain_k, slack, force


def _largest_step(value: NDArray[np.float64], change: NDArray[np.float64]) -> float:
    falling = change < 0.0
    return float((-value[falling] / change[falling]).min(initial=_ENDLESS))


def start_state(
    position_nd: NDArray[np.float64],
    lattice_dd: NDArray[np.float64],
    radius_n: NDArray[np.float64],
    load: float,
    force_of: Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.float64]] | None = None,
) -> HardState:
    """Return the first state: slacks of the order of the mean overlap, forces in proportion to the overlaps.

    Parameters
    ----------
    position_nd, lattice_dd, radius_n
        The packing, with overlaps or without, in units of the mean diameter.
    load
        Sum of force * distance over all pairs at the end.
    force_of
        Contact forces from (overlap_c, contact_distance_c); proportional to relative overlap over distance if not
        given.

    """
    pairs = _Pairs(position_nd, lattice_dd, radius_n)
    gap = pairs.measure(position_nd, lattice_dd)
    overlap = np.maximum(-gap, 0.0) / pairs.sigma_c
    touching = overlap > 0.0
    if touching.any():
        force = overlap / pairs.sigma_c if force_of is None else force_of(overlap, pairs.sigma_c)
        width = max(float(overlap[touching].mean()), 1e-6)
    else:
        # nothing touches yet: every listed pair bears the same
        force = np.ones_like(gap)
        width = max(float(np.minimum(gap, 0.1).mean()), 1e-6) if len(gap) else 0.1
    slack = np.maximum(gap, width)
    total = float((force * pairs.distance_c).sum())
    if total > 0.0:
        force = force * (load / total)
    barrier = 0.5 * width * (float(force[force > 0].mean()) if (force > 0).any() else 1.0)
    force = np.maximum(force, barrier / slack)
    return HardState(
        position_nd, lattice_dd, *(pairs.i_c, pairs.j_c, pairs.image_cd), pairs.sigma_c, slack, force, barrier,
        float((slack - gap).max(initial=0.0)),
    )  # fmt: skip


def densify(
    state: HardState,
    radius_n: NDArray[np.float64],
    basis_kdd: NDArray[np.float64],
    *,
    barrier: float = 1e-12,
    iteration_limit: int = 500,
    watch: Callable[[HardState], None] | None = None,
) -> HardState:
    """Return the state after lowering the barrier to the one asked for, or at the iteration limit.

    Parameters
    ----------
    state
        Where to start, from `start_state` or from an earlier call.
    radius_n
        (N,) radii in the state's units.
    basis_kdd
        (k, d, d) strains that are free: the unit tensor over sqrt(d) alone keeps the shape of the box, the Mandel
        basis frees all.
    barrier
        Mean of slack * force to end at; forces have mean of order one.
    iteration_limit
        Most iterations, counted from the start of the state.
    watch
        Called with the state after every iteration.

    """
    position, lattice = state.position_nd.copy(), state.lattice_dd.copy()
    particles, dimension = position.shape
    load_k = np.einsum("kaa->k", basis_kdd) * particles
    pairs = _Pairs(position, lattice, radius_n)
    gap = pairs.measure(position, lattice)
    slack, force = np.maximum(gap, 1e-300), np.full(len(gap), 0.0)
    mean = state.barrier
    _carry_over(
        pairs.i_c,
        pairs.j_c,
        pairs.image_cd,
        state.i_c,
        state.j_c,
        state.image_cd,
        slack,
        force,
        state.slack_c,
        state.force_c,
    )
    force = np.where(force > 0.0, force, mean / np.maximum(slack, 1e-3))
    iterations = state.iterations
    now = state
    while iterations < iteration_limit:
        iterations += 1
        defect = np.minimum(gap - slack, 0.0)
        mean = float((force * slack).mean())
        try:
            step = _Step(pairs, basis_kdd, load_k, slack, force, defect, tie=mean)
            *_, ds, df = step.direction(np.zeros_like(slack))
            ahead_p, ahead_d = min(1.0, _largest_step(slack, ds)), min(1.0, _largest_step(force, df))
            reached = float(((force + ahead_d * df) * (slack + ahead_p * ds)).mean())
            # a packing that still moves is far from balance: lowering the barrier faster than it settles makes it crawl
            # along walls
            center = min(1.0, max((reached / mean) ** 3, 1e-4, 0.3 * step.unbalanced() ** 2 / mean))
            correction = ds * df if min(ahead_p, ahead_d) > 0.1 else 0.0
            u_nd, strain_k, ds, df = step.direction(center * mean + np.zeros_like(slack) - correction)
        except np.linalg.LinAlgError:
            # no digits are left to go on with: the caller's certificate decides what this is worth
            break
        keep = 0.995 if min(ahead_p, ahead_d) > 0.95 else 0.9
        size_p, size_d = min(1.0, keep * _largest_step(slack, ds)), min(1.0, keep * _largest_step(force, df))
        strain = np.einsum("k,kab->ab", strain_k, basis_kdd)
        fastest = float((np.sqrt((u_nd**2).sum(axis=1)) / radius_n).max()) + float(np.linalg.norm(strain))
        size_p = min(size_p, _STEP_CAP / max(fastest, 1e-300))
        position += size_p * (u_nd + position @ strain.T)
        lattice += size_p * strain @ lattice
        slack = slack + size_p * ds
        force = force + size_d * df
        if not pairs.lasts(size_p * u_nd, size_p * float(np.linalg.norm(strain))):
            old = (pairs.i_c, pairs.j_c, pairs.image_cd)
            pairs = _Pairs(position, lattice, radius_n)
            gap = pairs.measure(position, lattice)
            old_slack, old_force = slack, force
            slack, force = np.maximum(gap, 1e-3), np.zeros(len(gap))
            _carry_over(pairs.i_c, pairs.j_c, pairs.image_cd, *old, slack, force, old_slack, old_force)
            force = np.where(force > 0.0, force, center * mean / slack)
        else:
            gap = pairs.measure(position, lattice)
        slack = np.maximum(slack, gap)
        mean = float((force * slack).mean())
        violation = float((slack - gap).max(initial=0.0))
        now = HardState(
            position,
            lattice,
            pairs.i_c,
            pairs.j_c,
            pairs.image_cd,
            pairs.sigma_c,
            slack,
            force,
            mean,
            violation,
            iterations,
        )
        if watch is not None:
            watch(now)
        if mean < barrier and violation < max(1e-13, 0.1 * barrier):
            break
    return now
