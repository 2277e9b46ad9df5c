"""Newton's method for soft packings, at constant pressure or volume, with the free strains among the unknowns.

Unknowns are displacements and the free strains; the enthalpy U + p V is stationary where forces balance and the
stress is -p on every free strain. Prestress is included: without it Newton's method stalls at a residual of 1e-2 near
jamming.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.contacts.neighbors import candidate_pairs
from packmech.contacts.network import Contacts, pair_contacts
from packmech.effects import contact_terms
from packmech.mechanics.block_system import BlockSystem, gather
from packmech.outcome import Outcome
from packmech.packing import Packing

_ITERATIONS = 40
_REACH = 0.05


@dataclass(frozen=True, eq=False)
class Units:
    """Length and energy that turn a scene's numbers into numbers of order one."""

    effects: tuple[Any, ...]
    length: float
    energy: float

    def terms(self, contacts: Contacts, closing: bool = False) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return du/dr and d2u/dr2 of the contacts; where they are apart, zero or the values of the closed side."""
        return self.derivatives(contacts.distance_c, contacts.contact_distance_c, closing)

    def derivatives(
        self, distance_c: NDArray[np.float64], sigma_c: NDArray[np.float64], closing: bool = False
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return du/dr and d2u/dr2 at given distances."""
        terms = contact_terms(self.effects, distance_c * self.length, sigma_c * self.length, closing=closing)
        return terms.first_c * (self.length / self.energy), terms.second_c * (self.length**2 / self.energy)

    def overlap_of(self, force_c: NDArray[np.float64], sigma_c: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the relative overlaps, at most one half, at which the law gives the forces; by bisection."""
        low, high = np.full(len(force_c), np.log(1e-18)), np.full(len(force_c), np.log(0.5))
        for _ in range(60):
            middle = 0.5 * (low + high)
            weaker = -self.derivatives(sigma_c * (1.0 - np.exp(middle)), sigma_c)[0] < force_c
            low, high = np.where(weaker, middle, low), np.where(weaker, high, middle)
        overlap: NDArray[np.float64] = np.exp(0.5 * (low + high))
        return overlap


def isochoric_part(basis_kdd: NDArray[np.float64], dimension: int) -> NDArray[np.float64]:
    """Return an orthonormal basis of the strains without trace among the given ones.

    Parameters
    ----------
    basis_kdd
        (k, d, d) strains.
    dimension
        Number of Cartesian axes.

    """
    trace = np.einsum("kaa->k", basis_kdd)
    flat = (basis_kdd - trace[:, None, None] * np.eye(dimension) / dimension).reshape(len(basis_kdd), dimension**2)
    _, size, rows = np.linalg.svd(flat, full_matrices=False)
    kept: NDArray[np.float64] = rows[size > 1e-9].reshape(-1, dimension, dimension)
    return kept


@dataclass(frozen=True, eq=False)
class SoftState:
    """A soft packing in balance, or as near as Newton's method came: how well, and after how many iterations.

    `stress_error` is the largest missing stress on a free strain over the pressure; `negative` counts unstable
    directions; `reached` is the depth of the overlaps over that asked for; `floor` the residual that rounding of
    positions alone can cause.
    """

    packing: Packing
    residual: float
    stress_error: float
    iterations: int
    negative: int
    reached: float = 1.0
    floor: float = 0.0

    def balanced(self, tolerance: float) -> bool:
        """Return whether forces and stress balance to the tolerance."""
        return self.residual <= tolerance and self.stress_error <= tolerance

    def sound(self, tolerance: float) -> bool:
        """Return whether the packing is stable and balanced to the tolerance or to the floor of rounding."""
        # positions are multiples of their last digit: eight such floors is as still as a packing can be in double
        # precision
        return self.negative == 0 and self.balanced(max(tolerance, 8.0 * self.floor))


class _Network:
    """Pairs that touch or may soon, their forces and the parts of the enthalpy's gradient."""

    def __init__(self, packing: Packing, units: Units, basis_kdd: NDArray[np.float64], pressure: float | None) -> None:
        self.packing, self.units, self.pressure = packing, units, 0.0 if pressure is None else pressure
        d = packing.dimension
        # a held volume leaves the parts of the strains without trace, and takes for pressure what it finds
        self.volume = packing.box.volume if pressure is None else None
        self.basis_kdd = basis_kdd if pressure is not None else isochoric_part(basis_kdd, d)
        basis_kdd = self.basis_kdd
        self.pairs = candidate_pairs(packing.position_nd, packing.radius_n, packing.box, scale=1.0 + _REACH)
        self.system: BlockSystem | None = None
        self._touching = np.zeros(0, dtype=bool)
        self.trace_k = np.einsum("kaa->k", basis_kdd)
        self.measure(packing)

    def measure(self, packing: Packing) -> None:
        self.packing = packing
        contacts = pair_contacts(packing, *self.pairs)
        touching = contacts.gap_c < 0.0
        contacts = contacts.select(touching)
        if self.system is None or not np.array_equal(touching, self._touching):
            self.system = BlockSystem(contacts.i_c, contacts.j_c, packing.particles, packing.dimension)
        self._touching = touching
        self.contacts = contacts
        self.first_c, self.second_c = self.units.terms(contacts)
        self.stretch_ck = np.einsum("ca,kab,cb->ck", contacts.normal_cd, self.basis_kdd, contacts.vector_cd)
        out = np.empty((packing.particles, packing.dimension))
        gather(contacts.i_c, contacts.j_c, contacts.normal_cd, self.first_c, out)
        self.uphill_nd = out
        volume = packing.box.volume
        if self.volume is not None:
            self.pressure = -float((self.first_c * contacts.distance_c).sum()) / (packing.dimension * volume)
        self.uphill_k = self.stretch_ck.T @ self.first_c + self.pressure * volume * self.trace_k
        mean = float(np.abs(self.first_c).mean()) if len(contacts) else 0.0
        self.residual = float(np.sqrt((out**2).sum(axis=1)).max()) / mean if mean > 0 else np.inf
        scale = self.pressure * volume
        self.stress_error = float(np.abs(self.uphill_k).max()) / scale if len(self.basis_kdd) and scale > 0.0 else 0.0
        # one figure to judge steps by: net forces and stress in units of what they balance
        self.merit = max(self.residual, self.stress_error)

    def close(self, contacts: Contacts) -> None:
        """Take the contacts as touching, those that just part with the stiffness of the closed side."""
        self.contacts = contacts
        self.system = BlockSystem(contacts.i_c, contacts.j_c, contacts.particles, contacts.dimension)
        self.first_c, self.second_c = self.units.terms(contacts, closing=True)
        self.stretch_ck = np.einsum("ca,kab,cb->ck", contacts.normal_cd, self.basis_kdd, contacts.vector_cd)

    def direction(self, tie: float) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
        """Return the Newton step and the number of negative pivots."""
        assert self.system is not None
        contacts, packing = self.contacts, self.packing
        count = contacts.count_n()
        along, across = self.second_c, self.first_c / contacts.distance_c
        extra = np.where(count == 0, 1.0, tie)
        factored = self.system.factor(contacts.normal_cd, along, across, extra_n=extra)
        strained_ckd = np.einsum("kab,cb->cka", self.basis_kdd, contacts.vector_cd)
        pushed_ckd = across[:, None, None] * strained_ckd
        pushed_ckd += ((along - across)[:, None] * self.stretch_ck)[:, :, None] * contacts.normal_cd[:, None, :]
        k, n, d = len(self.basis_kdd), packing.particles, packing.dimension
        coupling = np.zeros((n * d, k))
        for m in range(k):
            for a in range(d):
                column = np.bincount(contacts.j_c, pushed_ckd[:, m, a], n) - np.bincount(
                    contacts.i_c, pushed_ckd[:, m, a], n
                )
                coupling[a::d, m] = column
        corner = np.einsum("cka,cla->kl", strained_ckd, pushed_ckd)
        twice = np.outer(self.trace_k, self.trace_k) - np.einsum("kab,lab->kl", self.basis_kdd, self.basis_kdd)
        corner += self.pressure * packing.box.volume * twice
        rough = factored.solve(-self.uphill_nd.ravel())
        if k == 0:
            return rough.reshape(n, d), np.zeros(0), factored.negative
        relaxed = factored.solve(coupling)
        schur = corner - coupling.T @ relaxed
        strain_k = np.linalg.solve(schur, -self.uphill_k - coupling.T @ rough)
        negative = factored.negative + int((np.linalg.eigvalsh(0.5 * (schur + schur.T)) < 0).sum())
        return (rough - relaxed @ strain_k).reshape(n, d), strain_k, negative

    def moved(self, u_nd: NDArray[np.float64], strain_k: NDArray[np.float64]) -> Packing:
        strain = np.einsum("k,kab->ab", strain_k, self.basis_kdd)
        position = self.packing.position_nd + u_nd + self.packing.position_nd @ strain.T
        box = self.packing.box.strained(strain) if strain.any() else self.packing.box
        if self.volume is not None and strain.any():
            factor = (self.volume / box.volume) ** (1.0 / self.packing.dimension)
            position, box = position * factor, box.scaled(factor)
        return self.packing.replace(position_nd=position, box=box)


def newton(
    packing: Packing,
    units: Units,
    basis_kdd: NDArray[np.float64],
    pressure: float | None,
    *,
    iterations: int = _ITERATIONS,
) -> SoftState:
    """Return the packing that Newton's method reaches at constant pressure or volume, in reduced units.

    Steps are halved until net forces and stress come closer to balance; the last digits stop at rounding.

    Parameters
    ----------
    packing
        Where to start; it must overlap already.
    units
        The law and the units.
    basis_kdd
        (k, d, d) free strains; none keeps the box.
    pressure
        Pressure [reduced energy / reduced length^d], or None to hold the volume.
    iterations
        Most iterations.

    """
    network = _Network(packing, units, basis_kdd, pressure)
    best = network.packing, network.merit, network.residual, network.stress_error
    negative = 0
    used = 0
    idle = 0
    travelled = 0.0
    for _ in range(iterations):
        used += 1
        start, merit = network.packing, network.merit
        if not np.isfinite(merit):
            break
        tie = 1e-10 * float(np.abs(network.second_c).mean())
        try:
            u_nd, strain_k, negative = network.direction(tie)
        except (np.linalg.LinAlgError, RuntimeError, ValueError):
            break
        size = 1.0
        longest = float(np.abs(u_nd).max()) + float(np.abs(strain_k).max(initial=0.0))
        if not np.isfinite(longest):
            break
        size = min(1.0, 0.3 * _REACH / max(longest, 1e-300))
        travelled += size * longest
        if travelled > 0.8 * _REACH:
            network = _Network(start, units, basis_kdd, pressure)
            travelled = size * longest
        for _ in range(8):
            network.packing = start
            network.measure(network.moved(size * u_nd, size * strain_k))
            # a contact that opens or closes may raise the merit once before it falls
            if network.merit < (4.0 if merit > 1e-4 else 1e3) * merit:
                break
            size *= 0.5
        if network.merit < best[1]:
            idle = 0 if network.merit < 0.5 * best[1] else idle + 1
            best = network.packing, network.merit, network.residual, network.stress_error
        else:
            idle += 1
        if idle >= (2 if best[1] < 1e-5 else 10):
            break
    if negative:
        # the last step's count may belong to another set of contacts: some flicker where they just touch
        negative = _unstable_directions(best[0], units, network.basis_kdd, network.pressure)
    network.measure(best[0])
    extent = max(float(np.abs(best[0].position_nd).max()), float(np.abs(best[0].box.lattice_dd).max()))
    floor = 0.0
    if len(network.contacts):
        floor = np.finfo(float).eps * extent * float(network.second_c.max() / np.abs(network.first_c).mean())
    return SoftState(best[0], best[2], best[3], used, negative, 1.0, floor)


def _unstable_directions(packing: Packing, units: Units, basis_kdd: NDArray[np.float64], pressure: float) -> int:
    """Return the negative eigenvalues of the Hessian, with contacts that touch to rounding counted as closed."""
    network = _Network(packing, units, basis_kdd, pressure)
    extent = max(float(np.abs(packing.position_nd).max()), float(np.abs(packing.box.lattice_dd).max()))
    contacts = pair_contacts(packing, *network.pairs)
    network.close(contacts.select(contacts.gap_c < 4.0 * np.finfo(float).eps * extent))
    try:
        return network.direction(1e-10 * float(np.abs(network.second_c).mean()))[2]
    except np.linalg.LinAlgError:
        return 1


def judge(state: SoftState, tolerance: float) -> Outcome:
    """Return how a soft packing came out: balanced, at the floor of rounding, unstable, or stalled.

    Parameters
    ----------
    state
        The packing.
    tolerance
        Net force over mean contact force, and missing stress over pressure, that count as balance [1].

    """
    if state.reached < 1.0 or not np.isfinite(state.residual):
        return Outcome.STALLED
    if state.negative:
        return Outcome.UNSTABLE
    if state.balanced(tolerance):
        return Outcome.CONVERGED
    return Outcome.ROUNDING_FLOOR if state.sound(tolerance) else Outcome.STALLED
