"""What Newton's method needs of a soft packing, with links or without: contacts, forces, slopes, changes of energy."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from packmech.box import Box
from packmech.constraints.factor import ConstraintFactor
from packmech.constraints.redundancy import workable_links
from packmech.contacts.excluded import Excluded
from packmech.contacts.network import Candidates, Contacts, candidate_pairs, pair_contacts
from packmech.effects import contact_terms
from packmech.linalg.block_system import BlockSystem, Factored, gather
from packmech.linalg.factor import factor_saddle
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
        links = None if packing.links is None else packing.links.scaled(1.0 / self.length)
        box = Box(packing.box.lattice_dd / self.length)
        return packing.replace(
            position_nd=packing.position_nd / self.length, radius_n=packing.radius_n / self.length, box=box, links=links
        )

    def restored(self, packing: Packing, like: Packing) -> Packing:
        """Return a packing of reduced lengths in true ones, with radii, links and masses exactly those of another."""
        box = Box(packing.box.lattice_dd * self.length)
        return like.replace(position_nd=packing.position_nd * self.length, box=box, shapes=packing.shapes)

    def terms(self, contacts: Contacts, closing: bool = False) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return du/dr and d2u/dr2 of the contacts; where they are apart, zero or the values of the closed side."""
        return self.derivatives(contacts.distance_c, contacts.contact_distance_c, closing)

    def derivatives(
        self, distance_c: NDArray[np.float64], sigma_c: NDArray[np.float64], closing: bool = False
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return du/dr and d2u/dr2 at given distances."""
        terms = contact_terms(self.effects, distance_c * self.length, sigma_c * self.length, closing=closing)
        return terms.first_c * (self.length / self.energy), terms.second_c * (self.length**2 / self.energy)

    def smoothed(
        self, distance_c: NDArray[np.float64], sigma_c: NDArray[np.float64], width: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return du/dr and d2u/dr2 where overlaps are smoothed over a width, see `smoothed_overlap`."""
        overlap = smoothed_overlap(distance_c, sigma_c, width)
        first, second = self.derivatives(sigma_c - overlap, sigma_c)
        root = np.sqrt((sigma_c - distance_c) ** 2 + 4.0 * width**2)
        slope = overlap / root
        return first * slope, second * slope**2 - first * 2.0 * width**2 / root**3

    def overlap_of(self, force_c: NDArray[np.float64], sigma_c: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the relative overlaps, at most one half, at which the law gives the forces; by bisection."""
        low, high = np.full(len(force_c), np.log(1e-18)), np.full(len(force_c), np.log(0.5))
        for _ in range(60):
            middle = 0.5 * (low + high)
            weaker = -self.derivatives(sigma_c * (1.0 - np.exp(middle)), sigma_c)[0] < force_c
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


class StiffPairs(NamedTuple):
    """Pairs that are stiff or bear a force: stiffness along and across, the latter du/dr / r."""

    i_c: NDArray[np.int64]
    j_c: NDArray[np.int64]
    normal_cd: NDArray[np.float64]
    vector_cd: NDArray[np.float64]
    along_c: NDArray[np.float64]
    across_c: NDArray[np.float64]


class Coupled(NamedTuple):
    """Second derivatives of the enthalpy: factored by the free coordinates, mixed with strains, and by strains.

    `free_f` are the places of the coordinates among all; a system may have further unknowns after them.
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
    """Pairs that touch or may soon, their forces and the parts of the enthalpy's gradient."""

    def __init__(
        self,
        packing: Packing,
        units: Units,
        basis_kdd: NDArray[np.float64],
        pressure: float | Load | None,
        width: float = 0.0,
    ) -> None:
        rest_dd = pressure.rest_dd if isinstance(pressure, Load) else None
        pressure = pressure.pressure if isinstance(pressure, Load) else pressure
        self.packing, self.units, self.pressure, self.rest_dd = packing, units, pressure or 0.0, rest_dd
        # width over which overlaps are smoothed, none usually
        self.width = width
        d = packing.dimension
        # a held volume leaves the parts of the strains without trace, and takes for pressure what it finds
        self.volume = packing.box.volume if pressure is None else None
        self.basis_kdd = basis_kdd if pressure is not None else isochoric_part(basis_kdd, d)
        basis_kdd = self.basis_kdd
        self.pairs = self.search(packing)
        self.system: BlockSystem | None = None
        # of another length than any list: the first measurement lays out the system
        self._touching = np.zeros(len(self.pairs.i_c) + 1, dtype=bool)
        self.trace_k = np.einsum("kaa->k", basis_kdd)
        # what the load does on each strain, over pressure times volume
        self.load_k = self.trace_k if rest_dd is None else self.trace_k + np.einsum("kab,ab->k", basis_kdd, rest_dd)
        self.measure(packing)

    def search(self, packing: Packing) -> Candidates:
        """Return the pairs that touch or may soon."""
        return candidate_pairs(packing.position_nd, packing.radius_n, packing.box, scale=1.0 + REACH)

    def near(self, packing: Packing) -> Any:
        """Return the pairs of the list, touching or not, as they are in a packing."""
        return pair_contacts(packing, *self.pairs)

    def energy_change(self, near: Any) -> float:
        """Return the energy less that of the packing whose pairs of the list are given."""
        change = self.near(self.packing).vector_cd - near.vector_cd
        return energy_change(near.vector_cd, change, near.contact_distance_c, self.first_at, self.width)

    def growth_to(self, other: Packing) -> float:
        """Return the enthalpy of a packing nearby, whose pairs are those of the list, less that of this one.

        From the displacements: rounding of the vectors between particles would not cancel. A held volume is one to
        rounding of the lattice, and the pressure's work on the rest is taken off. A load that is no pressure does its
        work on the small strain from here.
        """
        packing = self.packing
        near, moved = self.near(packing), other.position_nd - packing.position_nd
        stretched = other.box.lattice_dd - packing.box.lattice_dd
        change = moved[near.j_c] - moved[near.i_c] + near.image_cd @ stretched.T
        own = energy_change(near.vector_cd, change, near.contact_distance_c, self.first_at, self.width)
        return own + self._pressing(packing.box, stretched)

    def _pressing(self, box: Box, stretched_dd: Array) -> float:
        """Return the work against the load where the lattice of a box is stretched."""
        share = stretched_dd @ box.inverse_dd
        trace, d = float(np.trace(share)), len(share)
        # det(1 + share) - 1
        more = float(np.linalg.det(share)) + (0.0 if d == 2 else 0.5 * (trace**2 - float(np.trace(share @ share))))
        rest = 0.0 if self.rest_dd is None else float((self.rest_dd * share).sum())
        return self.pressure * box.volume * (trace + more + rest)

    def first_at(self, distance_c: Array, sigma_c: Array) -> Array:
        """Return du/dr at given distances."""
        return self.units.derivatives(distance_c, sigma_c)[0]

    def measure(self, packing: Packing) -> None:
        """Take the packing in: its contacts, forces and errors."""
        self.packing = packing
        contacts = self.near(packing)
        if self.width > 0.0:
            touching = contacts.distance_c - contacts.contact_distance_c < _FAR * self.width
            self.contacts = near = contacts.select(touching)
            self.first_c, self.second_c = self.units.smoothed(near.distance_c, near.contact_distance_c, self.width)
        else:
            touching = contacts.gap_c < 0.0
            self.contacts = contacts.select(touching)
            self.first_c, self.second_c = self.units.terms(self.contacts)
        if not np.array_equal(touching, self._touching):
            self.lay_out()
        self._touching = touching
        self.balance()

    def lay_out(self) -> None:
        """Forget what depends on which pairs touch, not on where they are: it is made where it is asked for."""
        self.system = None

    def balance(self) -> None:
        """Set the slopes of the enthalpy and how far from balance they are."""
        packing = self.packing
        self.uphill_nd, energy_k, virial = self.slopes()
        volume = packing.box.volume
        if self.volume is not None:
            self.pressure = -virial / (packing.dimension * volume)
        self.uphill_k = energy_k + self.pressure * volume * self.load_k
        mean = self.mean_force
        self.residual = self.largest_force() / mean if mean > 0 else np.inf
        scale = self.pressure * volume
        self.stress_error = float(np.abs(self.uphill_k).max()) / scale if len(self.basis_kdd) and scale > 0.0 else 0.0
        # one figure to judge steps by: net forces and stress in units of what they balance
        self.merit = max(self.residual, self.stress_error)

    def largest_force(self) -> float:
        """Return the largest net force on a particle."""
        return float(np.sqrt((self.uphill_nd**2).sum(axis=1)).max())

    @property
    def mean_force(self) -> float:
        """Mean contact force; where overlaps are smoothed and no pair need touch, that which bears the pressure."""
        if self.width > 0.0:
            return self.pressure * float(self.packing.diameter_n.mean()) ** (self.packing.dimension - 1)
        return self.mean_contact_force()

    def mean_contact_force(self) -> float:
        """Return the mean size of the contacts' forces; none where nothing touches."""
        return float(np.abs(self.first_c).mean()) if len(self.contacts) else 0.0

    @property
    def largest_stiffness(self) -> float:
        """Largest stiffness of a contact."""
        return float(self.second_c.max())

    def slopes(self) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        """Return the energy's slopes along positions and strains, and the virial sum of du/dr r."""
        contacts = self.contacts
        self.stretch_ck = np.einsum("ca,kab,cb->ck", contacts.normal_cd, self.basis_kdd, contacts.vector_cd)
        out = gather(contacts.i_c, contacts.j_c, contacts.normal_cd, self.first_c, contacts.particles)
        return out, self.stretch_ck.T @ self.first_c, float((self.first_c * contacts.distance_c).sum())

    def close(self, contacts: Any, least: float = 0.0) -> None:
        """Take the contacts as touching, those that just part with the stiffness of the closed side.

        Forces no larger than the least count as none.
        """
        self.contacts = contacts
        self.first_c, self.second_c = self.units.terms(contacts, closing=True)
        self.first_c = np.where(np.abs(self.first_c) > least, self.first_c, 0.0)
        self.lay_out()
        self.balance()

    def stiff_pairs(self) -> StiffPairs:
        """Return what is stiff or bears a force: the contacts."""
        one = self.contacts
        return StiffPairs(one.i_c, one.j_c, one.normal_cd, one.vector_cd, self.second_c, self.first_c / one.distance_c)

    def factor(self, stiff: StiffPairs, regularization: float) -> Factored:
        """Return the factored system of the positions; `regularization` is added to every particle's stiffness."""
        if self.system is None:
            one = self.contacts
            self.system = BlockSystem(one.i_c, one.j_c, one.particles, one.dimension)
        extra = np.where(self.contacts.count_n() == 0, 1.0, regularization)
        return self.system.factor(stiff.normal_cd, stiff.along_c, stiff.across_c, extra_n=extra)

    def border(self, coupling: NDArray[np.float64], basis_kdd: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the coupling of the positions to the strains with that of the system's other unknowns below."""
        return coupling

    def work(self, before: Box) -> float:
        """Return the work against the load on the way from a box to that of the packing; none where volume is held.

        A load that is no pressure does it on small strains from where each step begins: it has no potential.
        """
        if self.volume is not None:
            return 0.0
        work = self.pressure * (self.packing.box.volume - before.volume)
        if self.rest_dd is None:
            return work
        strain_dd = self.packing.box.lattice_dd @ before.inverse_dd - np.eye(self.packing.dimension)
        return work + self.pressure * before.volume * float((self.rest_dd * strain_dd).sum())

    def coupled(self, basis_kdd: NDArray[np.float64], regularization: float) -> Coupled:
        """Return the factored second derivatives of the enthalpy by positions, and those with the strains of a basis.

        Strains may be any displacement gradients; each takes the positions along.
        """
        stiff, packing = self.stiff_pairs(), self.packing
        factored = self.factor(stiff, regularization)
        along, across = stiff.along_c, stiff.across_c
        strained_ckd = np.einsum("kab,cb->cka", basis_kdd, stiff.vector_cd)
        stretch_ck = np.einsum("ca,cka->ck", stiff.normal_cd, strained_ckd)
        pushed_ckd = across[:, None, None] * strained_ckd
        pushed_ckd += ((along - across)[:, None] * stretch_ck)[:, :, None] * stiff.normal_cd[:, None, :]
        k, n, d = len(basis_kdd), packing.particles, packing.dimension
        coupling = np.zeros((n * d, k))
        for m in range(k):
            for a in range(d):
                column = np.bincount(stiff.j_c, pushed_ckd[:, m, a], n) - np.bincount(stiff.i_c, pushed_ckd[:, m, a], n)
                coupling[a::d, m] = column
        corner = np.einsum("cka,cla->kl", strained_ckd, pushed_ckd)
        return Coupled(
            factored.solve, factored.negative, np.arange(n * d), self.border(coupling, basis_kdd),
            corner + self._bulging(basis_kdd),
        )  # fmt: skip

    def _bulging(self, basis_kdd: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the second derivatives of the pressure's work on the volume."""
        trace = np.einsum("kaa->k", basis_kdd)
        twice = np.outer(trace, trace) - np.einsum("kab,lba->kl", basis_kdd, basis_kdd)
        return np.asarray(self.pressure * self.packing.box.volume * twice)

    def direction(self, regularization: float) -> tuple[NDArray[np.float64], NDArray[np.float64], int]:
        """Return the Newton step and the number of negative pivots."""
        found = self.coupled(self.basis_kdd, regularization)
        corner = found.corner_kk + regularization * self.packing.particles * np.eye(len(self.basis_kdd))
        right = np.zeros(found.size)
        right[: len(found.free_f)] = -self.uphill_nd.ravel()[found.free_f]
        step, strain_k, negative = found.solved(right, -self.uphill_k, found.coupling_fk, corner)
        return self._spread(found, step), strain_k, found.negative + negative

    def _spread(self, found: Coupled, step: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return a step of the free coordinates as one of all, in the shape of the slopes."""
        whole = np.zeros(self.uphill_nd.size)
        whole[found.free_f] = step[: len(found.free_f)]
        return whole.reshape(self.uphill_nd.shape)

    def response(self, shear_dd: NDArray[np.float64]) -> Response:
        """Return how the packing in balance answers to an imposed displacement gradient: to first order, exactly.

        Contacts as they are; the load, or the volume, is held.
        """
        k = len(self.basis_kdd)
        found = self.coupled(
            np.concatenate([self.basis_kdd, shear_dd[None]]), 1e-12 * float(np.abs(self.second_c).mean())
        )
        coupling, corner = found.coupling_fk, found.corner_kk.copy()
        # free strains act on what is sheared already
        corner[:k, k] += np.einsum("ab,kac,cb->k", self.gradient_slopes(), self.basis_kdd, shear_dd)
        corner[k, :k] = corner[:k, k]
        step, strain_k, _ = found.solved(-coupling[:, k], -corner[:k, k], coupling[:, :k], corner[:k, :k])
        curvature = float(corner[k, k] + coupling[:, k] @ step + corner[k, :k] @ strain_k)
        gradient = shear_dd + np.einsum("k,kab->ab", strain_k, self.basis_kdd)
        return Response(self._spread(found, step), strain_k, gradient, curvature)

    def gradient_slopes(self) -> NDArray[np.float64]:
        """Return the (d, d) slopes of the energy along displacement gradients."""
        one = self.contacts
        return np.asarray(np.einsum("c,ca,cb->ab", self.first_c, one.normal_cd, one.vector_cd))

    def gap_rates(self, near: Any, answer: Response) -> NDArray[np.float64]:
        """Return how fast the distances of pairs change in a response."""
        u_nd = answer.u_nd
        moved = u_nd[near.j_c] - u_nd[near.i_c] + near.vector_cd @ answer.gradient_dd.T
        return np.asarray(np.einsum("ca,ca->c", near.normal_cd, moved))

    def moved(self, u_nd: NDArray[np.float64], strain_k: NDArray[np.float64]) -> Packing:
        """Return the packing after displacements and strains, at the volume that is held."""
        strain = np.einsum("k,kab->ab", strain_k, self.basis_kdd)
        position = self.packing.position_nd + u_nd + self.packing.position_nd @ strain.T
        box = self.packing.box.strained(strain) if strain.any() else self.packing.box
        if self.volume is not None and strain.any():
            factor = (self.volume / box.volume) ** (1.0 / self.packing.dimension)
            position, box = position * factor, box.scaled(factor)
        return self.packing.replace(position_nd=position, box=box)


class LinkedNetwork(SoftNetwork):
    """Contacts and links of a packing; `uphill_nd` is what the links do not bear, `tension_l` what they do."""

    def __init__(
        self,
        packing: Packing,
        units: Units,
        basis_kdd: NDArray[np.float64],
        pressure: float | Load | None,
        width: float = 0.0,
    ) -> None:
        self.links = links = workable_links(packing)
        self._constraints = ConstraintFactor(packing, links)
        self._excluded = Excluded(packing)
        self.tension_l = np.zeros(len(links))
        self._cluster_n = links.clusters(packing.particles)
        super().__init__(self._constraints.projected(packing), units, basis_kdd, pressure, width)

    def search(self, packing: Packing) -> Candidates:
        """Return the pairs that touch or may soon, neither linked nor of one rigid cluster."""
        pairs = super().search(packing)
        apart = ~self._excluded.mask(*pairs)
        return Candidates(*(part[apart] for part in pairs))

    def lay_out(self) -> None:
        """Do nothing: the system with links is laid out when it is factored."""

    def slopes(self) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        """Return the slopes along the motions that the links admit, their tension included, and the virial."""
        out, load_k, virial = super().slopes()
        packing = self.packing
        left, self.tension_l, _ = self._constraints.at(packing).project(-out)
        vector = self.links.vectors(packing.position_nd, packing.box.lattice_dd)
        distance = np.sqrt((vector**2).sum(axis=1))
        self._vector_ld, self._normal_ld = vector, vector / distance[:, None]
        self._distance_l = distance
        stretch_lk = np.einsum("la,kab,lb->lk", self._normal_ld, self.basis_kdd, vector)
        return -left, load_k + stretch_lk.T @ self.tension_l, virial + float((self.tension_l * distance).sum())

    def gradient_slopes(self) -> NDArray[np.float64]:
        """Return the (d, d) slopes of the energy along displacement gradients, tensions of links included."""
        own = np.einsum("l,la,lb->ab", self.tension_l, self._normal_ld, self._vector_ld)
        return np.asarray(super().gradient_slopes() + own)

    def stiff_pairs(self) -> StiffPairs:
        """Return the contacts and the links, which are stiff across by their tension."""
        links, none = self.links, np.zeros(len(self.links))
        own = StiffPairs(
            links.i_l, links.j_l, self._normal_ld, self._vector_ld, none, self.tension_l / self._distance_l
        )  # fmt: skip
        return StiffPairs(*(np.concatenate(both) for both in zip(super().stiff_pairs(), own, strict=True)))

    def factor(self, stiff: StiffPairs, regularization: float) -> Factored:
        """Return the factored system of positions and tensions; negative pivots beyond one a link are unstable."""
        packing = self.packing
        n, d, count = packing.particles, packing.dimension, len(self.links)
        unit = float(np.abs(self.second_c).mean()) if len(self.second_c) else 1.0
        normal = stiff.normal_cd
        block = (stiff.along_c - stiff.across_c)[:, None, None] * normal[:, :, None] * normal[:, None, :]
        block += stiff.across_c[:, None, None] * np.eye(d)
        i, j = stiff.i_c, stiff.j_c
        sign = np.array([1.0, 1.0, -1.0, -1.0])
        rows, columns = np.stack([i, j, i, j]), np.stack([i, j, j, i])
        values = sign[:, None, None, None] * block
        axis = np.arange(d)
        row = (rows[:, :, None, None] * d + axis[:, None]) + 0 * axis
        column = (columns[:, :, None, None] * d + axis) + 0 * axis[:, None]
        # a cluster that nothing touches is held, all others hardly
        held = np.bincount(self._cluster_n, self.contacts.count_n(), minlength=n)[self._cluster_n] == 0
        diagonal = np.repeat(np.where(held, unit, regularization), d)
        pinned = int(np.argmax(np.where(held, -1, self.contacts.count_n())))
        diagonal[pinned * d : pinned * d + d] += unit
        links = self.links
        everything = np.arange(n * d)
        stiff = sp.coo_array(
            (
                np.concatenate([values.ravel(), diagonal]),
                (np.concatenate([row.ravel(), everything]), np.concatenate([column.ravel(), everything])),
            ),
            shape=(n * d, n * d),
        ).tocsr()
        gradient = sp.coo_array(
            (
                np.concatenate([-self._normal_ld, self._normal_ld]).ravel(),
                (
                    np.repeat(np.tile(np.arange(count), 2), d),
                    (np.concatenate([links.i_l, links.j_l])[:, None] * d + axis).ravel(),
                ),
            ),
            shape=(count, n * d),
        ).tocsr()
        done = factor_saddle(stiff, gradient, d, stiffness=unit)
        return Factored(done.solve, done.inertia.negative - count, pinned)

    def border(self, coupling: NDArray[np.float64], basis_kdd: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the coupling with the links' stretches below, in the unit of their rows."""
        unit = float(np.abs(self.second_c).mean()) if len(self.second_c) else 1.0
        stretch_lk = np.einsum("la,kab,lb->lk", self._normal_ld, basis_kdd, self._vector_ld)
        return np.concatenate([coupling, unit * stretch_lk])

    def moved(self, u_nd: NDArray[np.float64], strain_k: NDArray[np.float64]) -> Packing:
        """Return the packing after displacements and strains, back on its links."""
        return self._constraints.projected(super().moved(u_nd, strain_k))


def energy_change(
    vector_cd: Array, change_cd: Array, sigma_c: Array, first: Callable[[Array, Array], Array], width: float = 0.0
) -> float:
    """Return the energy of pairs after their vectors have changed, less that before.

    The distance changes by (2 v.dv + dv.dv) / (r + r'), and the energy by the integral of du/dr over that.

    Parameters
    ----------
    vector_cd, change_cd
        (C, d) vectors of the pairs where the step starts, and their changes.
    sigma_c
        (C,) contact distances.
    first
        du/dr of (distance, contact distance), both (k,).
    width
        Width over which overlaps are smoothed [length].

    Examples
    --------
    >>> closer = energy_change(np.array([[0.9, 0.0]]), np.array([[-1e-12, 0.0]]), np.ones(1), lambda r, s: r - s)
    >>> round(closer / 1e-13, 10)
    1.0

    """
    before = np.sqrt((vector_cd**2).sum(axis=1))
    after = np.sqrt(((vector_cd + change_cd) ** 2).sum(axis=1))
    either = (before < sigma_c) | (after < sigma_c) | (width > 0.0)
    before, after, sigma = before[either], after[either], sigma_c[either]
    vector, change = vector_cd[either], change_cd[either]
    exact = (2.0 * (vector * change).sum(axis=1) + (change**2).sum(axis=1)) / (before + after)
    return energy_between(before, after, exact, sigma, first, width)


def energy_between(
    before: Array, after: Array, exact: Array, sigma: Array, first: Callable[[Array, Array], Array], width: float = 0.0
) -> float:
    """Return the energy of pairs at distances `after` less that at `before`, whose exact change is given."""
    if width > 0.0:
        low = sigma - smoothed_overlap(before, sigma, width)
        inside, deeper = sigma - before, sigma - after
        roots = np.sqrt(inside**2 + 4.0 * width**2) + np.sqrt(deeper**2 + 4.0 * width**2)
        length = 0.5 * exact * (1.0 + (inside + deeper) / roots)
    else:
        low, high = np.minimum(before, sigma), np.minimum(after, sigma)
        length = np.where((before < sigma) & (after < sigma), exact, high - low)
    total = 0.0
    for place, weight in zip(_PLACE, _WEIGHT, strict=True):
        total += weight * float(np.add.reduce(first(low + place * length, sigma) * length))
    return float(total)
