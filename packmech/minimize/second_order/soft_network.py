"""What Newton's method needs of a soft packing: contacts and links, forces, slopes, second derivatives, energies."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.constraints.factor import ConstraintFactor
from packmech.constraints.redundancy import workable_links
from packmech.contacts.elements import elements_of, sum_slopes
from packmech.contacts.network import Candidates, distance_change
from packmech.contacts.pairs import list_pairs, measure_pairs, search_pairs
from packmech.effects import (
    ContactLengths,
    Touches,
    at_distances,
    contact_terms,
    held_particles,
    single_effects,
    single_terms,
    total_push,
)
from packmech.linalg.factor import Factorization, factor_saddle, factorize
from packmech.mechanics.assembly import assemble
from packmech.packing import Packing

# pairs are searched within this reach beyond contact, relative to it
REACH = 0.05
# Gauss-Legendre on [0, 1], exact for du/dr up to the fifth power of the distance
_PLACE = 0.5 + np.array([-0.5, 0.0, 0.5]) * np.sqrt(0.6)
_WEIGHT = np.array([5.0, 8.0, 5.0]) / 18.0
# pairs further apart than so many widths of the smoothing bear next to nothing: overlaps fall as width^2 / gap
_FAR = 30.0
Array = NDArray[np.float64]


def length_unit(packing: Packing) -> float:
    """Return the power of two nearest to the mean diameter: dividing by it changes no digits of the coordinates."""
    return float(2.0 ** np.round(np.log2(packing.diameter_n.mean())))


@dataclass(frozen=True, eq=False)
class Units:
    """Length and energy that turn a scene's numbers into numbers of order one."""

    effects: tuple[Any, ...]
    length: float
    energy: float

    def reduced(self, packing: Packing) -> Packing:
        """Return the packing in reduced lengths."""
        box = Box(packing.box.lattice_dd / self.length)
        return packing.replace(
            position_nd=packing.position_nd / self.length, radius_n=packing.radius_n / self.length, box=box,
            links=packing.links.scaled(1.0 / self.length),
        )  # fmt: skip

    def restored(self, packing: Packing, like: Packing) -> Packing:
        """Return a packing of reduced lengths in true ones, with radii, links and masses exactly those of another."""
        box = Box(packing.box.lattice_dd * self.length)
        return like.replace(position_nd=packing.position_nd * self.length, box=box, shapes=packing.shapes)

    def terms(self, touches: Touches, closing: bool = False) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return du/dr and d2u/dr2 of the contacts; where they are apart, zero or the values of the closed side."""
        lengths = touches.distance_c, touches.contact_distance_c, touches.effective_radius_c
        distance, sigma, radius = (self.length * column for column in lengths)
        terms = contact_terms(
            self.effects,
            ContactLengths(distance, sigma, radius, touches.kinds_c),
            closing=closing,
        )
        return terms.first_c * (self.length / self.energy), terms.second_c * (self.length**2 / self.energy)

    def smoothed(self, touches: Touches, width: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return du/dr and d2u/dr2 where overlaps are smoothed over a width, see `smoothed_overlap`."""
        distance_c, sigma_c = touches.distance_c, touches.contact_distance_c
        overlap = smoothed_overlap(distance_c, sigma_c, width)
        first, second = self.terms(at_distances(touches, sigma_c - overlap))
        root = np.sqrt((sigma_c - distance_c) ** 2 + 4.0 * width**2)
        slope = overlap / root
        return first * slope, second * slope**2 - first * 2.0 * width**2 / root**3

    def overlap_of(self, force_c: NDArray[np.float64], touches: Touches) -> NDArray[np.float64]:
        """Return the relative overlaps, at most one half, at which the law gives the forces; by bisection."""
        low, high = np.full(len(force_c), np.log(1e-18)), np.full(len(force_c), np.log(0.5))
        for _ in range(60):
            middle = 0.5 * (low + high)
            there = at_distances(touches, touches.contact_distance_c * (1.0 - np.exp(middle)))
            weaker = -self.terms(there)[0] < force_c
            low, high = np.where(weaker, middle, low), np.where(weaker, high, middle)
        overlap: NDArray[np.float64] = np.exp(0.5 * (low + high))
        return overlap


def smoothed_overlap(distance_c: Array, sigma_c: Array, width: float) -> Array:
    """Return (x + sqrt(x^2 + 4 width^2)) / 2 for x = sigma - distance, positive at any distance [length].

    The smoothing of Chen and Harker (1993) and Kanzow (1996): a force f and a gap g then satisfy f (g + f / k) =
    k width^2 for a spring of stiffness k, as on the central path of an interior-point method.

    Examples
    --------
    >>> smoothed_overlap(np.array([1.0]), np.array([1.0]), 1e-3).tolist()
    [0.001]

    """
    inside = sigma_c - distance_c
    root = np.sqrt(inside**2 + 4.0 * width**2)
    # where pairs are apart, the sum loses its digits
    overlap: Array = np.where(inside < 0.0, 2.0 * width**2 / (root + np.abs(inside)), 0.5 * (root + inside))
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


class Load(NamedTuple):
    """A stress to hold: its pressure, and the rest of the compression over it, symmetric and without trace."""

    pressure: float
    rest_dd: Array

    @classmethod
    def of(cls, stress_dd: Array) -> Load:
        """Return the load of a stress, tension positive."""
        d = len(stress_dd)
        pressure = (0.0 - float(np.trace(stress_dd))) / d
        return cls(pressure, -0.5 * (stress_dd + stress_dd.T) / pressure - np.eye(d))


def scaled_load(pressure: float | Load | None, factor: float) -> float | Load | None:
    """Return a pressure or a load in another unit; None stays."""
    if isinstance(pressure, Load):
        return Load(pressure.pressure * factor, pressure.rest_dd)
    return None if pressure is None else pressure * factor


class Coupled(NamedTuple):
    """Second derivatives of the enthalpy: factored by the free coordinates, mixed with strains, and by strains.

    `free_f` are the places of the coordinates among all; the tensions of links are further unknowns after them.
    """

    solve: Callable[[Array], Array]
    negative: int
    free_f: NDArray[np.int64]
    coupling_fk: Array
    corner_kk: Array

    @property
    def size(self) -> int:
        """Number of unknowns that are factored."""
        return len(self.coupling_fk)

    def solved(self, right: Array, right_k: Array, coupling_fk: Array, corner_kk: Array) -> tuple[Array, Array, int]:
        """Return the unknowns and the strains that give the right-hand sides, and the strains' negative pivots."""
        rough = self.solve(right)
        if not len(right_k):
            return rough, np.zeros(0), 0
        relaxed = self.solve(coupling_fk)
        schur = corner_kk - coupling_fk.T @ relaxed
        strain_k = np.asarray(np.linalg.solve(schur, right_k - coupling_fk.T @ rough), dtype=np.float64)
        negative = int((np.linalg.eigvalsh(0.5 * (schur + schur.T)) < 0).sum())
        return rough - relaxed @ strain_k, strain_k, negative


class Response(NamedTuple):
    """What an imposed strain does to a packing in balance, per strain.

    `u_nd` are the motions beyond what the gradient takes along, turns among them, `strain_k` the free strains,
    `gradient_dd` the displacement gradient with them, and `curvature` the second derivative of the enthalpy.
    """

    u_nd: Array
    strain_k: Array
    gradient_dd: Array
    curvature: float


class SoftNetwork:
    """Pairs that touch or may soon, links, their forces and the parts of the enthalpy's gradient.

    Weights, walls and held particles are taken in where particles are discs or spheres, and units of length 1.

    `uphill_nd` are the (N, q) slopes of the enthalpy along the positions and turns (measured in lengths) of the
    particles, less what links bear; `tension_l` is what these do.
    """

    def __init__(
        self,
        packing: Packing,
        units: Units,
        basis_kdd: NDArray[np.float64],
        pressure: float | Load | None,
        width: float = 0.0,
        reach: float = REACH,
    ) -> None:
        rest_dd = pressure.rest_dd if isinstance(pressure, Load) else None
        pressure = pressure.pressure if isinstance(pressure, Load) else pressure
        self.units, self.pressure, self.rest_dd = units, pressure or 0.0, rest_dd
        # width over which overlaps are smoothed, none usually
        self.width, self.reach = width, reach
        self.acting, self.held_n = bool(single_effects(units.effects)), held_particles(units.effects, packing.particles)
        d = packing.dimension
        # a held volume leaves the parts of the strains without trace, and takes for pressure what it finds
        self.volume = packing.box.volume if pressure is None else None
        self.basis_kdd = basis_kdd = basis_kdd if pressure is not None else isochoric_part(basis_kdd, d)
        self.links = ConstraintFactor(packing, workable_links(packing))
        self.packing = packing = self.links.projected(packing)
        self.tension_l = np.zeros(len(self.links))
        # the last factorization, whose order of elimination serves while the same contacts touch
        self.factor: Factorization | None = None
        self.pairs, self.searched_nd = self.search(packing), packing.position_nd
        self.trace_k = np.einsum("kaa->k", basis_kdd)
        # what the load does on each strain, over pressure times volume
        self.load_k = self.trace_k if rest_dd is None else self.trace_k + np.einsum("kab,ab->k", basis_kdd, rest_dd)
        self.measure(packing)

    def search(self, packing: Packing) -> Candidates:
        """Return the pairs that touch or may soon."""
        shapes = packing.shapes
        # beads move by more than turns, measured in radii of gyration
        arm = float((shapes.sweep(packing.radius_n) / shapes.gyration(packing.radius_n)).max())
        found = search_pairs(packing, 1.0 + self.reach, 2.0 * self.reach * arm)
        if self.held_n is None:
            return found
        held_b = self.held_n[shapes.particle_b]
        kept = ~(held_b[found.i_c] & held_b[found.j_c])
        return Candidates(*(column[kept] for column in found))

    def near(self, packing: Packing) -> Any:
        """Return the pairs of the list, touching or not, as they are in a packing."""
        return measure_pairs(packing, self.pairs)

    def growth_to(self, other: Packing) -> float:
        """Return the enthalpy of a packing nearby, whose pairs are those of the list, less that of this one.

        From the displacements: rounding of the vectors between particles would not cancel. A held volume is one to
        rounding of the lattice, and the pressure's work on the rest is taken off. A load that is no pressure does its
        work on the small strain from here.
        """
        packing, near = self.packing, self.listed
        stretched = other.box.lattice_dd - packing.box.lattice_dd
        if not packing.shapes.has_orientations:
            moved = other.position_nd - packing.position_nd
            change = moved[near.j_c] - moved[near.i_c] + near.image_cd @ stretched.T
            own = energy_change(near.vector_cd, change, near, self.first_at, self.width)
        else:
            now, sigma = self.near(other), near.contact_distance_c
            either = (near.distance_c < sigma) | (now.distance_c < sigma) | (self.width > 0.0)
            now, near = now.select(either), near.select(either)
            exact = now.distance_change(near)
            own = energy_between(near, now.distance_c, exact, self.first_at, self.width)
        return own + self._pressing(packing.box, stretched)

    def _pressing(self, box: Box, stretched_dd: Array) -> float:
        """Return the work against the load where the lattice of a box is stretched."""
        share = stretched_dd @ box.inverse_dd
        trace, d = float(np.trace(share)), len(share)
        # det(1 + share) - 1
        more = float(np.linalg.det(share)) + (0.0 if d == 2 else 0.5 * (trace**2 - float(np.trace(share @ share))))
        rest = 0.0 if self.rest_dd is None else float((self.rest_dd * share).sum())
        return self.pressure * box.volume * (trace + more + rest)

    def first_at(self, touches: Touches) -> Array:
        """Return du/dr of pairs."""
        return self.units.terms(touches)[0]

    def measure(self, packing: Packing) -> None:
        """Take the packing in: its contacts, forces and errors."""
        self.packing = packing
        contacts = self.listed = self.near(packing)
        if self.width > 0.0:
            touching = contacts.distance_c - contacts.contact_distance_c < _FAR * self.width
            self.contacts = near = contacts.select(touching)
            self.first_c, self.second_c = self.units.smoothed(near, self.width)
        else:
            self.contacts = contacts.select(contacts.gap_c < 0.0)
            self.first_c, self.second_c = self.units.terms(self.contacts)
        self.balance()

    def balance(self) -> None:
        """Set the slopes of the enthalpy and how far from balance they are."""
        packing, one, d = self.packing, self.contacts, self.packing.dimension
        self.turn_nkt = packing.turn_nkt
        pull_cx = self.first_c[:, None] * one.slope_cx
        self.uphill_nd = sum_slopes(one.i_c, one.j_c, pull_cx, self.turn_nkt, d)
        # slopes of the energy along displacement gradients, which turn no particle
        self.gradient_dd = pull_cx[:, :d].T @ one.vector_cd
        self.single = single_terms(self.units.effects, packing) if self.acting else None
        if self.single is not None:
            self.uphill_nd -= self.single.force_nd
        if self.held_n is not None:
            self.uphill_nd[self.held_n] = 0.0
        if self.links:
            self.links = self.links.at(packing)
            left, self.tension_l, _ = self.links.project(-self.uphill_nd)
            self.uphill_nd, bonds = -left, self.links.pairs
            self.gradient_dd = self.gradient_dd + (self.tension_l[:, None] * bonds.slope_cx).T @ bonds.vector_cd
        volume = packing.box.volume
        if self.volume is not None:
            self.pressure = -float(np.trace(self.gradient_dd)) / (d * volume)
        scale = self.pressure * volume
        self.uphill_k = np.einsum("kab,ab->k", self.basis_kdd, self.gradient_dd) + scale * self.load_k
        mean = self.mean_force
        self.residual = self.largest_force() / mean if mean > 0 else np.inf
        self.stress_error = float(np.abs(self.uphill_k).max()) / scale if len(self.basis_kdd) and scale > 0.0 else 0.0
        # one figure to judge steps by: net forces and stress in units of what they balance
        self.merit = max(self.residual, self.stress_error)

    def largest_force(self) -> float:
        """Return the largest net force, or torque over the radius of gyration, on a particle."""
        square, d = self.uphill_nd**2, self.packing.dimension
        return float(np.sqrt(max(square[:, :d].sum(axis=1).max(), square[:, d:].sum(axis=1).max())))

    @property
    def mean_force(self) -> float:
        """Mean contact force; where overlaps are smoothed and no pair need touch, that which bears the pressure."""
        if self.width > 0.0:
            return self.pressure * float(self.packing.diameter_n.mean()) ** (self.packing.dimension - 1)
        # forces on single particles count as those of contacts do
        push, pushes = (0.0, 0) if self.single is None else total_push(self.single, self.held_n)
        count = len(self.contacts) + pushes
        return (float((np.abs(self.first_c) * self.contacts.push_c).sum()) + push) / count if count else 0.0

    @property
    def extent(self) -> float:
        """Largest coordinate, whose last digit is the error of positions."""
        packing = self.packing
        return max(float(np.abs(packing.position_nd).max()), float(np.abs(packing.box.lattice_dd).max()))

    @property
    def largest_stiffness(self) -> float:
        """Largest stiffness of a contact along a particle's motion."""
        return float((self.second_c * self.contacts.push_c**2).max())

    def close(self, contacts: Any, least: float = 0.0) -> None:
        """Take the contacts as touching, those that just part with the stiffness of the closed side.

        Forces no larger than the least count as none.
        """
        self.contacts = contacts
        self.first_c, self.second_c = self.units.terms(contacts, closing=True)
        self.first_c = np.where(np.abs(self.first_c) > least, self.first_c, 0.0)
        self.balance()

    def coupled(self, basis_kdd: NDArray[np.float64], regularization: float) -> Coupled:
        """Return the factored second derivatives of the enthalpy by positions and turns, and those with strains.

        Parameters
        ----------
        basis_kdd
            (k, d, d) strains, any displacement gradients; each takes the positions along.
        regularization
            What is added to every coordinate's stiffness.

        """
        packing = self.packing
        one = measure_pairs(packing, list_pairs(self.contacts), second=True)
        count, d = one.count_n(), packing.dimension
        bonds, cluster_n = self.links.pairs, self.links.cluster_n
        elements = [elements_of(one, self.first_c, self.second_c)]
        if len(bonds):
            elements.append(elements_of(bonds, self.tension_l, np.zeros(len(bonds))))
        # a cluster that nothing touches is held, all others hardly
        loose = np.bincount(cluster_n, count, len(count))[cluster_n] == 0
        unit = float(np.abs(self.second_c).mean()) if len(bonds) and len(self.second_c) else 1.0
        found = assemble(elements, self.turn_nkt, d, basis_edd=basis_kdd)
        free = np.ones_like(self.uphill_nd, dtype=bool)
        free[:, d:] = (self.turn_nkt != 0.0).any(axis=2)
        # the best connected particle stays where none is held
        stays = int(np.argmax(np.where(loose, -1, count))) if self.held_n is None else self.held_n
        free[stays, :d] = False
        free_f, coupling = free.ravel(), found.column(free.ravel())
        matrix = found.matrix(free_f, np.repeat(np.where(loose, unit, regularization), free.shape[1]))
        if len(bonds):
            self.factor = factor_saddle(matrix, self.links.gradient_lx[:, free_f], d, stiffness=unit)
            stretch_lk = np.einsum("la,kab,lb->lk", bonds.slope_cx, basis_kdd, bonds.vector_cd)
            coupling = np.concatenate([coupling, unit * stretch_lk])
        else:
            self.factor = factorize(matrix, kind="symmetric", like=self.factor)
        negative = self.factor.inertia.negative - len(bonds)
        # the pressure's work on the volume
        trace = np.einsum("kaa->k", basis_kdd)
        twice = np.outer(trace, trace) - np.einsum("kab,lba->kl", basis_kdd, basis_kdd)
        corner = found.corner_ee + self.pressure * packing.box.volume * twice
        return Coupled(self.factor.solve, negative, np.flatnonzero(free_f), coupling, corner)

    def direction(self, regularization: float) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
        """Return the Newton step and the number of negative pivots."""
        found = self.coupled(self.basis_kdd, regularization)
        corner = found.corner_kk + regularization * self.packing.particles * np.eye(len(self.basis_kdd))
        right = np.zeros(found.size)
        right[: len(found.free_f)] = -self.uphill_nd.ravel()[found.free_f]
        step, strain_k, negative = found.solved(right, -self.uphill_k, found.coupling_fk, corner)
        return self.spread(found, step), strain_k, found.negative + negative

    def spread(self, found: Coupled, step: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a step of the free coordinates as one of all, in the shape of the slopes."""
        whole = np.zeros(self.uphill_nd.size)
        whole[found.free_f] = step[: len(found.free_f)]
        return whole.reshape(self.uphill_nd.shape)

    def response(self, shear_dd: NDArray[np.float64]) -> Response:
        """Return how the packing in balance answers to an imposed displacement gradient: to first order, exactly.

        Contacts as they are; the load, or the volume, is held.
        """
        k = len(self.basis_kdd)
        stiff = float(np.abs(self.second_c).mean()) if len(self.second_c) else 0.0
        found = self.coupled(np.concatenate([self.basis_kdd, shear_dd[None]]), 1e-12 * stiff)
        coupling, corner = found.coupling_fk, found.corner_kk.copy()
        # free strains act on what is sheared already
        corner[:k, k] += np.einsum("ab,kac,cb->k", self.gradient_dd, self.basis_kdd, shear_dd)
        corner[k, :k] = corner[:k, k]
        step, strain_k, _ = found.solved(-coupling[:, k], -corner[:k, k], coupling[:, :k], corner[:k, :k])
        curvature = float(corner[k, k] + coupling[:, k] @ step + corner[k, :k] @ strain_k)
        gradient = shear_dd + np.einsum("k,kab->ab", strain_k, self.basis_kdd)
        return Response(self.spread(found, step), strain_k, gradient, curvature)

    def gap_rates(self, near: Any, answer: Response) -> NDArray[np.float64]:
        """Return how fast the distances of pairs change in a response."""
        d, u_nd = near.dimension, answer.u_nd
        moved = u_nd[near.j_c, :d] - u_nd[near.i_c, :d] + near.vector_cd @ answer.gradient_dd.T
        turned = np.einsum("nk,nkt->nt", u_nd[:, d:], self.turn_nkt)
        # distances of discs and spheres have no slopes along rotations
        whole = np.hstack([moved, turned[near.i_c], turned[near.j_c]])[:, : near.slope_cx.shape[1]]
        return np.asarray((near.slope_cx * whole).sum(axis=1))

    def moved(self, u_nd: NDArray[np.float64], strain_k: NDArray[np.float64]) -> Packing:
        """Return the packing after displacements, turns and strains, at the volume that is held and on its links."""
        packing, d = self.packing, self.packing.dimension
        strain = np.einsum("k,kab->ab", strain_k, self.basis_kdd)
        position = packing.position_nd + u_nd[:, :d] + packing.position_nd @ strain.T
        box = packing.box.strained(strain) if strain.any() else packing.box
        if self.volume is not None and strain.any():
            factor = (self.volume / box.volume) ** (1.0 / d)
            position, box = position * factor, box.scaled(factor)
        shapes = packing.shapes.turned(np.einsum("nk,nkt->nt", u_nd[:, d:], packing.turn_nkt))
        return self.links.projected(packing.replace(position_nd=position, box=box, shapes=shapes))


def energy_change(
    vector_cd: Array, change_cd: Array, touches: Touches, first: Callable[[Touches], Array], width: float = 0.0
) -> float:
    """Return the energy of pairs after their vectors have changed, less that before: the integral of du/dr.

    Parameters
    ----------
    vector_cd, change_cd
        (C, d) vectors of the pairs where the step starts, and their changes.
    touches
        The pairs, whose contact distances and effective radii are taken.
    first
        du/dr of pairs.
    width
        Width over which overlaps are smoothed [length].

    Examples
    --------
    >>> from packmech.effects import equal_touches
    >>> vector, step = np.array([[0.9, 0.0]]), np.array([[-1e-12, 0.0]])
    >>> spring = equal_touches(np.array([0.9]), np.ones(1))
    >>> closer = energy_change(vector, step, spring, lambda pairs: pairs.distance_c - pairs.contact_distance_c)
    >>> round(closer / 1e-13, 10)
    1.0

    """
    exact, before, after = distance_change(vector_cd, change_cd)
    sigma, radius, kinds = touches.contact_distance_c, touches.effective_radius_c, touches.kinds_c
    either = (before < sigma) | (after < sigma) | (width > 0.0)
    pairs = ContactLengths(before[either], sigma[either], radius[either], kinds[either])
    return energy_between(pairs, after[either], exact[either], first, width)


def energy_between(
    before: Touches, after: Array, exact: Array, first: Callable[[Touches], Array], width: float = 0.0
) -> float:
    """Return the energy of pairs at distances `after` less that where they are, whose exact change is given."""
    distance, sigma = before.distance_c, before.contact_distance_c
    if width > 0.0:
        low = sigma - smoothed_overlap(distance, sigma, width)
        inside, deeper = sigma - distance, sigma - after
        roots = np.sqrt(inside**2 + 4.0 * width**2) + np.sqrt(deeper**2 + 4.0 * width**2)
        length = 0.5 * exact * (1.0 + (inside + deeper) / roots)
    else:
        low, high = np.minimum(distance, sigma), np.minimum(after, sigma)
        length = np.where((distance < sigma) & (after < sigma), exact, high - low)
    total = 0.0
    for place, weight in zip(_PLACE, _WEIGHT, strict=True):
        total += weight * float(np.add.reduce(first(at_distances(before, low + place * length)) * length))
    return float(total)
