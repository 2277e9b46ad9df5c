"""The densest hard packing nearby, by an interior-point method on the true distances, and the certificate that it is.

    minimize the volume   over displacements u and strains e   subject to   |v_c + u_j - u_i + e v_c| >= sigma_c

for every pair c near enough to touch. Distances are convex in (u, e), so their linearizations lie below them: a step
that keeps the linear gaps open keeps the true ones open, and each iteration may linearize again at the packing as it
is. One primal-dual step (Mehrotra's predictor and corrector) costs one factorization of the pair network; the
multipliers converge to the contact forces. The programs of Torquato and Jiao (Phys. Rev. E 82, 061302, 2010) solve
the same problem one linear program after another.

Near the end it is known which pairs touch. `certify` brings these to contact exactly, and accepts the packing where all
others are apart, all forces push, and forces balance.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components

from packmech.box import Box
from packmech.contacts.elements import distance_rows
from packmech.contacts.network import Candidates, Contacts, candidate_pairs, pair_contacts
from packmech.contacts.overlaps import HARD, overlap_of_hard
from packmech.jit.compiled import kernel
from packmech.linalg.block_system import BlockSystem, Factored, extensions, gather
from packmech.packing import Packing

# pairs with gaps up to this fraction of the contact distance are constraints; the list lasts while no other can close
REACH = {2: 0.35, 3: 0.3}
_STEP_CAP = 0.1
# correctors: steps that are long enough without, how far beyond the longest step they look, what products count as
# near, over their aim, and how much longer steps must get; chosen at N = 1024 (seeds 10 to 14)
_LONG, _BEYOND, _LOWEST, _HIGHEST, _GAIN = 0.9, 0.3, 0.3, 10.0, 0.02
# A search that only takes short steps far from balance goes back to a wider barrier. A step this short [1]:
_SHORT = 0.1
# with the largest net force squared this many times the barrier, and twice as many after each time it went back [1]:
_LOST = 30.0
# to a barrier of so many times the net force squared, which counts up to the second number [1]:
_WIDER, _WIDEST = 3.0, 1e-3
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
def _carry_over(pairs, old_pairs, slack, force, old_slack, old_force):  # type: ignore[no-untyped-def]
    """Copy slack and force of pairs that were listed before; both lists are sorted by (i, j, image)."""
    i_c, j_c, image_cd = pairs
    old_i, old_j, old_image = old_pairs
    k = 0
    for c in range(i_c.shape[0]):
        while k < old_i.shape[0]:
            order = i_c[c] - old_i[k]
            if order == 0:
                order = j_c[c] - old_j[k]
            for a in range(image_cd.shape[1]):
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
    pairs
        The pairs near enough to be constraints.
    slack_c, force_c
        Their slacks (gaps, once feasible) and multipliers; the mean force is of order one.
    barrier
        Mean of slack * force: how far from the end.
    violation
        Largest overlap that is left.
    iterations
        What it cost: as many factorizations.

    """

    position_nd: NDArray[np.float64]
    lattice_dd: NDArray[np.float64]
    pairs: Candidates
    slack_c: NDArray[np.float64]
    force_c: NDArray[np.float64]
    barrier: float
    violation: float
    iterations: int = 0


class ContactSystem:
    """Normal equations A^T W A of pairs that push along their normals: positions first, strains eliminated last.

    Parameters
    ----------
    system
        The pairs and their pattern.
    normal_cd, vector_cd
        (C, d) unit vectors and vectors of the pairs.
    basis_kdd
        (k, d, d) free strains.
    live_n
        (N,) particles that bear forces; the rest are held in place. All unless given.

    """

    def __init__(
        self,
        system: BlockSystem,
        normal_cd: NDArray[np.float64],
        vector_cd: NDArray[np.float64],
        basis_kdd: NDArray[np.float64],
        live_n: NDArray[np.bool_] | None = None,
    ) -> None:
        self.system, self.normal_cd, self.basis_kdd = system, normal_cd, basis_kdd
        self.live_n = np.ones(system.particles, dtype=bool) if live_n is None else live_n
        self.shape = (system.particles, system.dimension)
        # n . e v of each strain
        dyad_cq = (normal_cd[:, :, None] * vector_cd[:, None, :]).reshape(len(normal_cd), -1)
        self.stretch_ck = dyad_cq @ basis_kdd.reshape(len(basis_kdd), dyad_cq.shape[1]).T
        self.load_k = np.einsum("kaa->k", basis_kdd) * system.particles

    def factor(self, weight_c: NDArray[np.float64], hold_n: NDArray[np.float64], hold: float) -> None:
        """Prepare `solve` for these weights; hold_n and `hold` are stiffnesses of every particle and strain."""
        self.weight_c = weight_c
        self.factored: Factored = self.system.factor(self.normal_cd, weight_c, extra_n=hold_n)
        self.coupling = np.stack([self.gather(weight_c * column) for column in self.stretch_ck.T], axis=1)
        self.relaxed = self.factored.solve(self.coupling)
        self.corner = (self.stretch_ck.T * weight_c) @ self.stretch_ck - self.coupling.T @ self.relaxed
        self.corner += hold * np.eye(len(self.corner))

    def prepare(self, weight_c: NDArray[np.float64]) -> None:
        """Prepare `solve` for these weights, with so little regularization that refinement takes it out again."""
        hold = 1e-12 * float(weight_c.mean())
        self.factor(weight_c, np.where(self.live_n, hold, 1.0), hold * self.shape[0])

    def gather(self, force_c: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (N d,) net forces of pairs that push with force_c."""
        net: NDArray[np.float64] = gather(self.system.i_c, self.system.j_c, self.normal_cd, force_c, self.shape[0])
        return net.ravel()

    def extensions(self, u_nd: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (C,) growths of the distances under displacements alone."""
        growth: NDArray[np.float64] = extensions(self.system.i_c, self.system.j_c, self.normal_cd, u_nd)
        return growth

    def extend(self, u_nd: NDArray[np.float64], strain_k: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return A (u, strain)."""
        extension: NDArray[np.float64] = self.extensions(u_nd) + self.stretch_ck @ strain_k
        return extension

    def solve(
        self, net: NDArray[np.float64], load_k: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (u, strain) with A^T W A (u, strain) = (net, load)."""
        rough = self.factored.solve(net)
        strain_k = np.linalg.solve(self.corner, load_k - self.coupling.T @ rough)
        return (rough - self.relaxed @ strain_k).reshape(self.shape), np.asarray(strain_k, dtype=np.float64)

    def moved(self, packing: Packing, u_nd: NDArray[np.float64], strain_k: NDArray[np.float64]) -> Packing:
        """Return the packing displaced by u, then strained."""
        strain = np.einsum("k,kab->ab", strain_k, self.basis_kdd)
        position = packing.position_nd + u_nd + packing.position_nd @ strain.T
        return packing.replace(position_nd=position, box=packing.box.strained(strain))

    def balance(self, force_c: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return what the forces lack: net force on the particles, and load."""
        return -self.gather(force_c), self.load_k - self.stretch_ck.T @ force_c

    def balanced(self, force_c: NDArray[np.float64], weight_c: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the forces nearest to the given ones, in the metric of the weights, that balance the load."""
        self.prepare(weight_c)
        for _ in range(3):
            net, load = self.balance(force_c)
            force_c = force_c + weight_c * self.extend(*self.solve(net, load))
        return force_c

    def imbalance(self, force_c: NDArray[np.float64]) -> float:
        """Return the largest missing net force or load per contact over the mean force."""
        net, load = self.balance(force_c)
        largest = float(np.sqrt((net.reshape(self.shape) ** 2).sum(axis=1)).max())
        return max(largest, float(np.abs(load).max()) / len(force_c)) / max(float(np.abs(force_c).mean()), 1e-300)

    def without_load(self, force_c: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the part of the forces that balances with no load at all (unit weights must be factored)."""
        for _ in range(2):
            u_nd, strain_k = self.solve(self.gather(force_c), self.stretch_ck.T @ force_c)
            force_c = force_c - self.extend(u_nd, strain_k)
        return force_c


def contact_system(
    contacts: Contacts, basis_kdd: NDArray[np.float64], live_n: NDArray[np.bool_] | None = None
) -> ContactSystem:
    """Return the system of a force-bearing network; live_n are the particles with contacts unless given."""
    system = BlockSystem(contacts.i_c, contacts.j_c, contacts.particles, contacts.dimension)
    live = contacts.count_n() > 0 if live_n is None else live_n
    return ContactSystem(system, contacts.normal_cd, contacts.vector_cd, basis_kdd, live)


class NearPairs:
    """The pairs near enough to touch, their geometry at the present positions, and how long the list lasts."""

    def __init__(
        self, position_nd: NDArray[np.float64], lattice_dd: NDArray[np.float64], radius_n: NDArray[np.float64]
    ) -> None:
        self.reach = REACH[position_nd.shape[1]]
        self.list = candidate_pairs(position_nd, radius_n, Box(lattice_dd), scale=1.0 + self.reach)
        self.sigma_c = radius_n[self.list.i_c] + radius_n[self.list.j_c]
        self.vector_cd = np.empty(self.list.image_cd.shape)
        self.distance_c = np.empty(len(self.list.i_c))
        self.normal_cd = np.empty(self.list.image_cd.shape)
        self.system = BlockSystem(self.list.i_c, self.list.j_c, *position_nd.shape)
        self._moved_nd = np.zeros_like(position_nd)
        self._strained = 0.0
        self._radius_n = radius_n

    def measure(self, position_nd: NDArray[np.float64], lattice_dd: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the gaps."""
        # copies: to the compiler a packing's arrays, which are read-only, are of another type
        position_nd, lattice_dd = position_nd.copy(), lattice_dd.copy()
        _measure(position_nd, lattice_dd, *self.list, self.vector_cd, self.distance_c, self.normal_cd)
        return self.distance_c - self.sigma_c

    def unbalanced(self, force_c: NDArray[np.float64]) -> float:
        """Return the largest net force of the multipliers [mean force]."""
        net = gather(self.system.i_c, self.system.j_c, self.normal_cd, force_c, self.system.particles)
        return float(np.abs(net).max())

    def lasts(self, moved_nd: NDArray[np.float64], strain: float) -> bool:
        """Return whether no unlisted pair can be near closing after one more such step."""
        self._moved_nd += moved_nd
        self._strained += strain
        furthest = float((np.sqrt((self._moved_nd**2).sum(axis=1)) / self._radius_n).max())
        return furthest + (1.0 + self.reach) * self._strained < self.reach - _STEP_CAP - 0.02


class _InteriorStep:
    """Directions of one interior-point iteration."""

    def __init__(
        self,
        pairs: NearPairs,
        basis_kdd: NDArray[np.float64],
        slack_c: NDArray[np.float64],
        force_c: NDArray[np.float64],
        defect_c: NDArray[np.float64],
        barrier: float,
    ) -> None:
        self.slack_c, self.force_c, self.defect_c = slack_c, force_c, defect_c
        self.contacts = ContactSystem(pairs.system, pairs.normal_cd, pairs.vector_cd, basis_kdd)
        weight = force_c / slack_c
        # regularization of particles and strains: little, but enough where nothing else resists a motion
        hold = barrier + 1e-11 * float(weight.mean())
        particles = pairs.system.particles
        self.contacts.factor(weight, np.full(particles, hold), hold * particles)

    def corrected(
        self, target_c: NDArray[np.float64], found: tuple[NDArray[np.float64], ...], aim: float
    ) -> tuple[NDArray[np.float64], tuple[NDArray[np.float64], ...]] | None:
        """Return a target and its direction along which longer steps are possible, or None where that is not so.

        Gondzio's corrector (Comput. Optim. Appl. 6, 137, 1996): the few pairs that would be far from the aim, a mean
        product of slack and force, some way beyond the longest step get another target, and cost a solve each time.
        """
        *_, slack, force = found
        reach = _largest_step(self.slack_c, slack), _largest_step(self.force_c, force)
        if min(reach) > _LONG:
            return None
        ahead_p, ahead_d = (min(1.0, one + _BEYOND) for one in reach)
        product = (self.slack_c + ahead_p * slack) * (self.force_c + ahead_d * force)
        more = np.maximum(np.clip(product, _LOWEST * aim, _HIGHEST * aim) - product, -_HIGHEST * aim)
        other = self.direction(target_c + more)
        now = min(1.0, _largest_step(self.slack_c, other[2])) + min(1.0, _largest_step(self.force_c, other[3]))
        if now < sum(min(1.0, one) for one in reach) + _GAIN:
            return None
        return target_c + more, other

    def direction(self, target_c: NDArray[np.float64]) -> tuple[NDArray[np.float64], ...]:
        """Return displacements, strains, and the changes of slack and force that lead to slack * force = target."""
        contacts = self.contacts
        push = target_c / self.slack_c - contacts.weight_c * self.defect_c
        u_nd, strain_k = contacts.solve(contacts.gather(push), contacts.stretch_ck.T @ push - contacts.load_k)
        slack = contacts.extensions(u_nd) + (contacts.stretch_ck @ strain_k + self.defect_c)
        force = target_c / self.slack_c - self.force_c - contacts.weight_c * slack
        return u_nd, strain_k, slack, force


@kernel
def _largest_step(value, change):  # type: ignore[no-untyped-def]
    """Return the largest step along a change that keeps every value positive."""
    largest = _ENDLESS
    for c in range(value.shape[0]):
        if change[c] < 0.0:
            largest = min(largest, -value[c] / change[c])
    return largest


def _at_barrier(
    barrier: float, gap: NDArray[np.float64], force: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return slack and force of one product; forces of pairs that bear stay as they were."""
    slack = np.maximum(gap, barrier / np.maximum(force, np.sqrt(barrier)))
    return slack, barrier / slack


def start_state(
    position_nd: NDArray[np.float64],
    lattice_dd: NDArray[np.float64],
    radius_n: NDArray[np.float64],
    load: float,
) -> HardState:
    """Return the first state: slacks of the order of the mean overlap, forces in proportion to the overlaps.

    Parameters
    ----------
    position_nd, lattice_dd, radius_n
        The packing, with overlaps or without, in units of the mean diameter.
    load
        Sum of force * distance over all pairs at the end.

    """
    pairs = NearPairs(position_nd, lattice_dd, radius_n)
    gap = pairs.measure(position_nd, lattice_dd)
    overlap = np.maximum(-gap, 0.0) / pairs.sigma_c
    touching = overlap > 0.0
    if touching.any():
        force = overlap / pairs.sigma_c
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
    violation = float((slack - gap).max(initial=0.0))
    return HardState(position_nd, lattice_dd, pairs.list, slack, force, barrier, violation)


def densify(
    state: HardState,
    radius_n: NDArray[np.float64],
    basis_kdd: NDArray[np.float64],
    *,
    barrier: float = 1e-12,
    iteration_limit: int = 500,
    correctors: int = 0,
    retreats: bool = False,
    watch: Callable[[HardState], None] | None = None,
) -> HardState:
    """Return the state after lowering the barrier to the one asked for, or at the iteration limit.

    A packing that finds a way to rearrange when the barrier is small already moves along walls that it feels only when
    it meets them, one after another: hundreds of steps, all short. At a wider barrier it takes a few dozen.

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
        Maximum number of iterations, counted from the start of the state.
    correctors
        Maximum number of Gondzio's correctors in an iteration: worth their solves where a factorization costs many.
    retreats
        Whether a state that crawls goes back to a barrier of the order of its net forces squared.
    watch
        Called with the state after every iteration.

    """
    position, lattice = state.position_nd.copy(), state.lattice_dd.copy()
    pairs = NearPairs(position, lattice, radius_n)
    gap = pairs.measure(position, lattice)
    slack, force = np.maximum(gap, 1e-300), np.full(len(gap), 0.0)
    mean = state.barrier
    _carry_over(tuple(pairs.list), tuple(state.pairs), slack, force, state.slack_c, state.force_c)
    force = np.where(force > 0.0, force, mean / np.maximum(slack, 1e-3))
    iterations = state.iterations
    now, lost, shortest = state, _LOST, 1.0
    while iterations < iteration_limit:
        iterations += 1
        mean, unbalanced = float((force * slack).mean()), pairs.unbalanced(force)
        size = min(unbalanced**2, _WIDEST)
        if retreats and shortest < _SHORT and size > lost * mean:
            slack, force = _at_barrier(_WIDER * size, gap, force)
            mean, unbalanced, lost = float((force * slack).mean()), pairs.unbalanced(force), 2.0 * lost
        defect = np.minimum(gap - slack, 0.0)
        try:
            step = _InteriorStep(pairs, basis_kdd, slack, force, defect, mean)
            *_, ds, df = step.direction(np.zeros_like(slack))
            ahead_p, ahead_d = min(1.0, _largest_step(slack, ds)), min(1.0, _largest_step(force, df))
            reached = float(((force + ahead_d * df) * (slack + ahead_p * ds)).mean())
            # a packing that still moves is far from balance: lowering the barrier faster than it settles makes it crawl
            # along walls
            center = min(1.0, max((reached / mean) ** 3, 1e-4, 0.3 * unbalanced**2 / mean))
            correction = ds * df if min(ahead_p, ahead_d) > 0.1 else 0.0
            target = center * mean + np.zeros_like(slack) - correction
            found = step.direction(target)
            for _ in range(correctors):
                better = step.corrected(target, found, max(center, 0.1) * mean)
                if better is None:
                    break
                target, found = better
            u_nd, strain_k, ds, df = found
        except np.linalg.LinAlgError:
            # no digits are left to go on with: the caller's certificate decides what this is worth
            break
        keep = 0.995 if min(ahead_p, ahead_d) > 0.95 else 0.9
        size_p, size_d = min(1.0, keep * _largest_step(slack, ds)), min(1.0, keep * _largest_step(force, df))
        strain = np.einsum("k,kab->ab", strain_k, basis_kdd)
        fastest = float((np.sqrt((u_nd**2).sum(axis=1)) / radius_n).max()) + float(np.linalg.norm(strain))
        size_p = min(size_p, _STEP_CAP / max(fastest, 1e-300))
        shortest = min(size_p, size_d)
        position += size_p * (u_nd + position @ strain.T)
        lattice += size_p * strain @ lattice
        slack = slack + size_p * ds
        force = force + size_d * df
        if not pairs.lasts(size_p * u_nd, size_p * float(np.linalg.norm(strain))):
            old = pairs.list
            pairs = NearPairs(position, lattice, radius_n)
            gap = pairs.measure(position, lattice)
            old_slack, old_force = slack, force
            slack, force = np.maximum(gap, 1e-3), np.zeros(len(gap))
            _carry_over(tuple(pairs.list), tuple(old), slack, force, old_slack, old_force)
            force = np.where(force > 0.0, force, center * mean / slack)
        else:
            gap = pairs.measure(position, lattice)
        slack = np.maximum(slack, gap)
        mean = float((force * slack).mean())
        violation = float((slack - gap).max(initial=0.0))
        now = HardState(position, lattice, pairs.list, slack, force, mean, violation, iterations)
        if watch is not None:
            watch(now)
        if mean < barrier and violation < max(1e-13, 0.1 * barrier):
            break
    return now


GAP_ERROR = HARD
FORCE_IMBALANCE = 1e-9
_SWEEPS = 8
_CORRECTIONS = 8
# rattlers may be shoved aside this often, by overlaps up to this [mean diameter]
_SHOVES, _SHOVE = 50, 1e-6
_DENSE_UNKNOWNS = 60
# size of a kick off a saddle [radius], how many there are, and the barriers at which packings are certified
_KICK, _KICKS, _BARRIERS = 1e-3, 3, (1e-12, 1e-13, 1e-14)


@dataclass(frozen=True, eq=False)
class HardPacking:
    """A hard packing whose contacts balance, a vertex of the linear programs: no small motion makes it denser.

    Lengths are in units of the mean diameter.

    Attributes
    ----------
    packing
        The packing; contacts touch to rounding, all other pairs are apart.
    contacts
        The force-bearing contacts.
    force_c
        (C,) their forces; the sum of force * distance is N d.
    excess
        Contacts beyond d N' - d + k for N' force-bearing particles and k free strains: 0 means one state of self
        stress.
    floppy_modes
        Motions of the backbone that no contact resists to first order: moving along them opens contacts, so the
        packing is at a saddle.
    gap_error
        Largest gap or overlap of a contact [mean diameter].
    force_imbalance
        Largest net force or unbalanced stress over the mean force [1].
    patches
        Particles held by more contacts than needed: one array per connected group. Equal particles close the contacts
        of a hexagonal patch exactly, so its forces are not unique.

    """

    packing: Packing
    contacts: Contacts
    force_c: NDArray[np.float64]
    excess: int
    floppy_modes: int
    gap_error: float
    force_imbalance: float
    patches: tuple[NDArray[np.int64], ...]

    @property
    def states_of_self_stress(self) -> int:
        """Sets of contact forces in balance, counted with the volume held."""
        return self.excess + 1 + self.floppy_modes


def _touching_pairs(state: HardState) -> list[NDArray[np.bool_]]:
    """Return the likely sets of contacts: force above slack, and the cut at the widest break of their ratio."""
    ratio = np.log10(state.force_c / np.maximum(state.slack_c, 1e-300))
    first = ratio > 0.0
    near = np.sort(ratio[(ratio > -7.0) & (ratio < 7.0)])
    ladder = np.concatenate([[-7.0], near, [7.0]])
    widest = int(np.argmax(np.diff(ladder)))
    second = ratio > 0.5 * (ladder[widest] + ladder[widest + 1])
    return [first] if (first == second).all() else [second, first]


def bring_to_contact(
    packing: Packing, pairs: Candidates, basis_kdd: NDArray[np.float64]
) -> tuple[Packing, Contacts, float]:
    """Return the packing with the pairs at contact, by Gauss-Newton steps, the contacts, and the largest gap left."""
    error = np.inf
    best: tuple[Packing, Contacts, float] | None = None
    for _ in range(_SWEEPS):
        contacts = pair_contacts(packing, *pairs)
        gap = contacts.gap_c
        now = float(np.abs(gap).max())
        if best is None or now < error:
            best = (packing, contacts, now)
        # the last digits wander by rounding: stop when a step gains nothing
        if now < 1e-15 or (now > 0.5 * error and now < 1e-12):
            break
        error = min(error, now)
        system = contact_system(contacts, basis_kdd)
        system.prepare(np.ones(len(gap)))
        u_nd, strain_k = system.solve(system.gather(-gap), -system.stretch_ck.T @ gap)
        if not np.isfinite(u_nd).all() or np.abs(u_nd).max() > 0.1:
            break
        packing = system.moved(packing, u_nd, strain_k)
    assert best is not None
    return best


def clusters(particles: int, i_c: NDArray[np.int64], j_c: NDArray[np.int64]) -> NDArray[np.int64]:
    """Return the (N,) number of each particle's group of those that the pairs join."""
    graph = sp.coo_array((np.ones(len(i_c)), (i_c, j_c)), shape=(particles, particles))
    return np.asarray(connected_components(graph, directed=False)[1], dtype=np.int64)


def _patches(contacts: Contacts, system: ContactSystem, excess: int) -> tuple[NDArray[np.int64], ...]:
    """Return the particles of the redundant contacts, those that take part in a state of self stress without load."""
    system.prepare(np.ones(len(contacts)))
    probe = np.random.default_rng(0).standard_normal((len(contacts), excess + 1))
    states = np.stack([system.without_load(column) for column in probe.T], axis=1)
    strength = np.sqrt((states**2).sum(axis=1))
    redundant = strength > 1e-6 * max(float(strength.max()), 1e-300)
    i, j = contacts.i_c[redundant], contacts.j_c[redundant]
    label = clusters(contacts.particles, i, j)
    involved = np.unique(np.concatenate([i, j]))
    groups = [involved[label[involved] == one] for one in np.unique(label[involved])]
    return tuple(sorted(groups, key=lambda group: (-len(group), int(group[0]))))


def _floppy_modes(contacts: Contacts, system: ContactSystem, excess: int) -> int:
    """Return how many motions of the backbone no contact resists; only small or deficient backbones can have any."""
    live = np.flatnonzero(system.live_n)
    d = contacts.dimension
    if len(live) * d > _DENSE_UNKNOWNS and excess >= 0:
        system.prepare(np.ones(len(contacts)))
        # a direction that no contact resists would come out of the solve a trillion times larger than it went in
        probe = np.random.default_rng(1).standard_normal((contacts.particles, d)) * system.live_n[:, None]
        probe[live] -= probe[live].mean(axis=0)
        answer, _ = system.solve(probe.ravel(), np.zeros(len(system.load_k)))
        if np.abs(answer).max() < 1e10 * np.abs(probe).max():
            return 0
    matrix = distance_rows(contacts).toarray().reshape(len(contacts), -1, d)
    full = np.concatenate([matrix[:, live].reshape(len(contacts), -1), system.stretch_ck], axis=1)
    singular = np.linalg.svd(full, compute_uv=False)
    rank = int((singular > 1e-7 * singular.max(initial=1.0)).sum())
    # parts of the backbone that do not touch each other may slide without opening a contact: that is no way out
    parts = len(np.unique(clusters(contacts.particles, contacts.i_c, contacts.j_c)[live]))
    return max(0, len(live) * d - d * parts + len(system.load_k) - rank)


def kicked(packing: Packing, basis_kdd: NDArray[np.float64], number: int) -> Packing:
    """Return the packing after a small random displacement and strain, to leave a saddle that no contact holds it at.

    Parameters
    ----------
    packing
        The packing, in reduced units.
    basis_kdd
        (k, d, d) free strains.
    number
        Which kick: the same number gives the same one.

    """
    rng = np.random.default_rng(number)
    position = packing.position_nd + _KICK * packing.radius_n[:, None] * rng.standard_normal(packing.position_nd.shape)
    strain = np.einsum("k,kab->ab", _KICK * rng.standard_normal(len(basis_kdd)), basis_kdd)
    return packing.replace(position_nd=position + position @ strain.T, box=packing.box.strained(strain))


def certify(state: HardState, like: Packing, basis_kdd: NDArray[np.float64]) -> tuple[HardPacking | None, str]:
    """Return the exact hard packing that the state has come close to, or None and what is missing.

    Accepted only if all contacts touch to 1e-12 and all other pairs are apart, every force is positive, and the
    forces balance to 1e-9 of their mean.

    Parameters
    ----------
    state
        The end of an interior-point search.
    like
        A packing of these particles, in the state's units.
    basis_kdd
        (k, d, d) free strains.

    """
    reason = "no pair bears a force"
    for touching in _touching_pairs(state):
        try:
            hard, reason = _accept(state, like, basis_kdd, touching.copy())
        except np.linalg.LinAlgError as failure:
            hard, reason = None, f"the network cannot be factored: {failure}"
        if hard is not None:
            return hard, ""
    return None, reason


def search_hard(
    state: HardState,
    like: Packing,
    basis_kdd: NDArray[np.float64],
    iteration_limit: int,
    *,
    approach: Callable[[HardState, float], HardState] | None = None,
    accept: Callable[[HardState], HardPacking | None] | None = None,
) -> tuple[HardPacking | None, int]:
    """Return the hard packing that a search from a state ends in, or None, and the number of iterations.

    Where no packing can be certified the barrier is lowered further; a packing at a saddle is kicked off it.

    Parameters
    ----------
    state, basis_kdd, iteration_limit
        As in `densify`.
    like
        A packing of these particles, in the state's units.
    approach
        Returns the state at a barrier; None: `densify`.
    accept
        Returns the packing that a state has come close to, or None; None: `certify`.

    """
    rung = kicks = 0
    began = state.iterations
    while True:
        if approach is None:
            state = densify(state, like.radius_n, basis_kdd, barrier=_BARRIERS[rung], iteration_limit=iteration_limit)
        else:
            state = approach(state, _BARRIERS[rung])
        hard = certify(state, like, basis_kdd)[0] if accept is None else accept(state)
        if hard is not None and not hard.floppy_modes:
            return hard, state.iterations - began
        if state.iterations >= iteration_limit:
            return None, state.iterations - began
        if hard is not None and kicks < _KICKS:
            kicks, rung = kicks + 1, 0
            near, used = kicked(hard.packing, basis_kdd, kicks), state.iterations
            load = float(near.particles * near.dimension)
            state = replace(start_state(near.position_nd, near.box.lattice_dd, like.radius_n, load), iterations=used)
        elif hard is None and rung < len(_BARRIERS) - 1:
            rung += 1
        else:
            return None, state.iterations - began


def _room_for_rattlers(packing: Packing, state: HardState, live_n: NDArray[np.bool_]) -> Packing:
    """Return the packing with rattlers moved off what they overlap by a solver's tolerance; cages have room."""
    position = packing.position_nd.copy()
    for _ in range(_SHOVES):
        near = pair_contacts(packing, *state.pairs)
        overlap = np.maximum(-near.gap_c, 0.0)
        at_i, at_j = ~live_n[near.i_c], ~live_n[near.j_c]
        wrong = (overlap > 1e-14) & (at_i != at_j) & (overlap < _SHOVE)
        if not wrong.any():
            break
        push = (1.5 * overlap[wrong])[:, None] * near.normal_cd[wrong]
        np.subtract.at(position, near.i_c[wrong & at_i], push[at_i[wrong]])
        np.add.at(position, near.j_c[wrong & at_j], push[at_j[wrong]])
        packing = packing.replace(position_nd=position)
    return packing


def _accept(
    state: HardState, like: Packing, basis_kdd: NDArray[np.float64], touching: NDArray[np.bool_]
) -> tuple[HardPacking | None, str]:
    reason = "no pair bears a force"
    ratio = np.log(state.force_c) - np.log(np.maximum(state.slack_c, 1e-300))
    for _ in range(_CORRECTIONS):
        if not touching.any():
            return None, reason
        packing = like.replace(position_nd=state.position_nd, box=Box(state.lattice_dd))
        chosen = Candidates(*(part[touching] for part in state.pairs))
        packing, contacts, gap_error = bring_to_contact(packing, chosen, basis_kdd)
        k = len(basis_kdd)
        live = contacts.count_n() > 0
        excess = len(contacts) - (packing.dimension * (int(live.sum()) - 1) + k)
        if gap_error > GAP_ERROR:
            # gaps of 1e-9 do occur, and look like contacts to the search: the pair with the smallest force is not one
            reason = f"contacts close to {gap_error:.1e} only"
            if excess <= 0:
                return None, reason
            touching[np.flatnonzero(touching)[np.argmin(ratio[touching])]] = False
            continue
        packing = _room_for_rattlers(packing, state, live)
        overlap_c = -pair_contacts(packing, *state.pairs).gap_c
        overlap = float(np.maximum(overlap_c, 0.0).max())
        if overlap > GAP_ERROR:
            reason = f"another pair overlaps by {overlap:.1e}"
            touching |= overlap_c > GAP_ERROR
            continue
        # all pairs, listed by the search or not
        wrong = overlap_of_hard(packing)
        if wrong is not None:
            return None, str(wrong)
        given = state.force_c[touching]
        # without redundancy the forces are unique; with it, weights in proportion keep small forces positive
        system = contact_system(contacts, basis_kdd, live)
        force = system.balanced(given, np.ones_like(given) if excess <= 0 else given)
        imbalance = system.imbalance(force)
        if (force <= 0.0).any():
            return None, f"{int((force <= 0.0).sum())} contacts pull"
        if imbalance > FORCE_IMBALANCE:
            return None, f"forces balance to {imbalance:.1e} only"
        floppy = _floppy_modes(contacts, system, excess)
        patches = _patches(contacts, system, excess + floppy) if excess + floppy > 0 else ()
        error = max(gap_error, overlap)
        return HardPacking(packing, contacts, force, excess, floppy, error, imbalance, patches), ""
    return None, reason
