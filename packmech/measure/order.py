# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Order of directions: of directors (nematic), and of bonds to neighbors, k-fold in a plane, Q_l and W_l in space."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
from numpy.typing import NDArray

from packmech.calls.display import shown
from packmech.calls.honors import honors
from packmech.check import instance, integer, one_of
from packmech.contacts.surroundings import RULES, Neighbors, find_neighbors
from packmech.jit.blas import single_thread
from packmech.jit.compiled import kernel
from packmech.packing import Packing

# harmonics up to this degree have Wigner symbols and factorials that double precision carries
_HIGHEST = 40


@shown()
@dataclass(frozen=True, eq=False, repr=False)
class NematicOrder:
    """How far directors agree; `float` of it is the order.

    Attributes
    ----------
    order
        1 where all are parallel: |mean of exp(2 i angle)| in a plane, the largest eigenvalue of the mean of
        3/2 u u - 1/2 in space [1]. At random about sqrt(pi / (4 N)) in a plane.
    director_d
        (d,) the common direction: the eigenvector of the largest eigenvalue; its sign means nothing.
    tensor_dd
        (d, d) mean of (d u u - 1) / (d - 1).
    direction_nd
        (N', d) directors of the particles that have one.
    round_particles
        Number of particles that have none, discs and spheres among the others: they are in no mean.

    """

    order: float
    director_d: NDArray[np.float64]
    tensor_dd: NDArray[np.float64]
    direction_nd: NDArray[np.float64]
    round_particles: int = 0

    def __float__(self) -> float:
        return self.order

    def __repr__(self) -> str:
        along = ", ".join(f"{x:.4f}" for x in self.director_d)
        without = f", {self.round_particles} round particles left out" if self.round_particles else ""
        return f"NematicOrder of {len(self.direction_nd)} directors: {self.order:.6g} along ({along}){without}"


@honors("links shapes", packing_only=True)
def nematic_order(packing: Packing) -> NematicOrder:
    """Return the nematic order of the directors of ellipses, spheroids, or bodies of beads.

    In a plane it is <2 cos^2 - 1>, which is 1 for parallel directors (Schreck and O'Hern, 2010, print 2 cos^2 -
    1/2), in space <3/2 cos^2 - 1/2>, about the direction that makes it largest; directors have no head. Of spheroids
    the director is their axis, across which oblate ones are wide; of bodies of beads it is the axis of their greatest
    extent. Particles that are round count nowhere.

    Parameters
    ----------
    packing
        The packing, with shapes.

    Raises
    ------
    TypeError, ValueError
        If it is no packing, or has no particles with a director.

    Examples
    --------
    >>> import packmech as pm
    >>> turned = pm.Spheroids([2.0, 2.0], [[0.6, 0.8], [-0.6, -0.8]])
    >>> two = pm.Packing([[0.0, 0.0], [3.0, 0.0]], [0.5, 0.5], pm.Box.cubic(6.0, 2), shapes=turned)
    >>> round(float(pm.nematic_order(two)), 12), np.abs(pm.nematic_order(two).director_d).round(12).tolist()
    (1.0, [0.6, 0.8])

    """
    instance("packing", packing, Packing)
    direction = packing.shapes.long_axes()
    if not len(direction):
        raise ValueError("packing must have shapes with a director, got discs or spheres")
    d = packing.dimension
    with single_thread():
        mean = direction.T @ direction / len(direction)
        tensor = (d * mean - np.eye(d)) / (d - 1.0)
        value, vector = np.linalg.eigh(tensor)
    director = vector[:, -1] * (1.0 if vector[np.abs(vector[:, -1]).argmax(), -1] > 0.0 else -1.0)
    order = float(value[-1])
    if d == 2:
        order = math.hypot(tensor[0, 0], tensor[0, 1])
    return NematicOrder(order, director, tensor, direction, packing.particles - len(direction))


@kernel
def _fold(i_p, vector_pd, particles, fold):
    """Return (N, 2) means over neighbors of cosine and sine of fold times the angle of the bond."""
    found, count = np.zeros((particles, 2)), np.zeros(particles, np.int64)
    for p in range(i_p.shape[0]):
        x, y = vector_pd[p, 0], vector_pd[p, 1]
        r = np.hypot(x, y)
        z = complex(x / r, y / r)
        # by squares: as many rounding errors as the exponent has digits
        power, base, left = complex(1.0, 0.0), z, fold
        while left > 0:
            if left & 1:
                power *= base
            base *= base
            left >>= 1
        found[i_p[p], 0] += power.real
        found[i_p[p], 1] += power.imag
        count[i_p[p]] += 1
    for n in range(particles):
        for a in range(2):
            found[n, a] /= max(count[n], 1)
    return found


@kernel
def _harmonics(i_p, vector_pd, particles, degree):
    """Return (N, l + 1, 2) means over neighbors of the spherical harmonics of degree l and orders 0 to l."""
    found, count = np.zeros((particles, degree + 1, 2)), np.zeros(particles, np.int64)
    for p in range(i_p.shape[0]):
        x, y, z = vector_pd[p, 0], vector_pd[p, 1], vector_pd[p, 2]
        r = np.sqrt(x * x + y * y + z * z)
        cosine, step = z / r, complex(x / r, y / r)
        # (sin e^(i phi))^m times a polynomial in cos: nothing is divided by the sine
        diagonal, turn = np.sqrt(1.0 / (4.0 * np.pi)), complex(1.0, 0.0)
        n = i_p[p]
        for m in range(degree + 1):
            if m > 0:
                diagonal *= -np.sqrt((2.0 * m + 1.0) / (2.0 * m))
                turn *= step
            before, now = 0.0, diagonal
            for k in range(m + 1, degree + 1):
                a = np.sqrt((4.0 * k * k - 1.0) / (k * k - m * m))
                b = np.sqrt(((k - 1.0) ** 2 - m * m) / (4.0 * (k - 1.0) ** 2 - 1.0))
                before, now = now, a * (cosine * now - b * before)
            found[n, m, 0] += now * turn.real
            found[n, m, 1] += now * turn.imag
        count[n] += 1
    for n in range(particles):
        for m in range(degree + 1):
            for a in range(2):
                found[n, m, a] /= max(count[n], 1)
    return found


@functools.cache
def _wigner(degree: int) -> tuple[NDArray[np.int64], NDArray[np.float64]]:
    """Return the (T, 3) orders m1 + m2 + m3 = 0, as places from -l on, and the 3j symbols (l l l; m1 m2 m3) there."""
    f, high = math.factorial, degree
    orders, symbols = [], []
    for m1 in range(-high, high + 1):
        for m2 in range(max(-high, -high - m1), min(high, high - m1) + 1):
            m3 = -m1 - m2
            # Racah's formula in whole numbers, with one root at the end
            terms = (
                Fraction((-1) ** t, f(t) * f(t + m1) * f(t - m2) * f(high - t) * f(high - t - m1) * f(high - t + m2))
                for t in range(max(0, -m1, m2), min(high, high - m1, high + m2) + 1)
            )
            total = sum(terms, Fraction(0))
            square = f(high) ** 3 * math.prod(f(high - m) * f(high + m) for m in (m1, m2, m3))
            root = math.sqrt(total**2 * square / f(3 * high + 1))
            symbols.append((1.0 if total >= 0 else -1.0) * (-1.0) ** m3 * root)
            orders.append((m1 + high, m2 + high, m3 + high))
    return np.array(orders), np.array(symbols)


@shown()
@dataclass(frozen=True, eq=False, repr=False)
class BondOrder:
    """Bond orientational order of each particle and of all.

    Attributes
    ----------
    degree
        k of psi_k in a plane, l of Q_l in space.
    component_nm
        (N, 1) psi_k in a plane; (N, 2 l + 1) sqrt(4 pi / (2 l + 1)) q_lm in space, m = -l .. l. Means over neighbors;
        zero for a particle without any.
    neighbors
        The neighbors that were used.

    """

    degree: int
    component_nm: NDArray[np.complex128]
    neighbors: Neighbors

    @property
    def counted_n(self) -> NDArray[np.bool_]:
        """The (N,) particles that have neighbors; others have no order, and are left out of every mean."""
        return np.asarray(self.neighbors.count_n > 0)

    @property
    def without_neighbors(self) -> int:
        """Number of particles without neighbors, which no mean counts: rattlers, where neighbors are contacts."""
        return int(np.count_nonzero(~self.counted_n))

    @property
    def psi_n(self) -> NDArray[np.complex128]:
        """The (N,) means of exp(i k angle) over neighbors, in a plane [1]."""
        if self.neighbors.vector_pd.shape[1] != 2:
            raise ValueError("packing must be two-dimensional for psi_n: in space there is q_nm")
        return self.component_nm[:, 0]

    @property
    def q_nm(self) -> NDArray[np.complex128]:
        """The (N, 2 l + 1) means of the spherical harmonics Y_lm over neighbors, in space, m = -l .. l [1]."""
        if self.neighbors.vector_pd.shape[1] != 3:
            raise ValueError("packing must be three-dimensional for q_nm: in a plane there is psi_n")
        return np.asarray(self.component_nm * math.sqrt((2.0 * self.degree + 1.0) / (4.0 * math.pi)))

    @property
    def order_n(self) -> NDArray[np.float64]:
        """The (N,) orders of the particles, |psi_k| or q_l [1]."""
        return np.asarray(np.sqrt((np.abs(self.component_nm) ** 2).sum(axis=1)))

    def _size(self, component_m: NDArray[np.complex128]) -> float:
        return float(np.sqrt((np.abs(component_m) ** 2).sum()))

    @property
    def global_order(self) -> float:
        """Size of the mean over the particles that have neighbors, phases and all [1]; equations 2.30 and 2.32.

        Those without (`without_neighbors`) have no order and are left out; times the share of the others, it is the
        mean in which they count as zero. nan where no particle has neighbors.
        """
        kept = self.component_nm[self.counted_n]
        return self._size(kept.mean(axis=0)) if len(kept) else math.nan

    @property
    def bond_weighted_order(self) -> float:
        """Size of the mean over all bonds [1]: Steinhardt, Nelson and Ronchetti's Q_l. nan without bonds."""
        count = self.neighbors.count_n
        if not count.any():
            return math.nan
        return self._size((self.component_nm * count[:, None]).sum(axis=0) / count.sum())

    @property
    def local_order(self) -> float:
        """Mean of the orders of the particles that have neighbors, without regard to phases [1]; equation 2.31."""
        kept = self.order_n[self.counted_n]
        return float(kept.mean()) if len(kept) else math.nan

    @property
    def local_rms(self) -> float:
        """Root mean square of the orders of the particles that have neighbors [1].

        Equation 2.33 with the factor 1/n_i^2 that it lacks.
        """
        kept = self.order_n[self.counted_n]
        return float(np.sqrt((kept**2).mean())) if len(kept) else math.nan

    @functools.cached_property
    def w_n(self) -> NDArray[np.float64]:
        """The (N,) third-order invariants W_l of the particles over q_l^3, in space [1]; nan where q_l is zero."""
        return self._third(self.q_nm)

    @functools.cached_property
    def global_w(self) -> float:
        """W_l of the mean over the particles that have neighbors, over its size cubed, in space [1]."""
        if not self.counted_n.any():
            return math.nan
        return float(self._third(self.q_nm[self.counted_n].mean(axis=0)[None])[0])

    def _third(self, q_nm: NDArray[np.complex128]) -> NDArray[np.float64]:
        orders, symbols = _wigner(self.degree)
        total = np.zeros(len(q_nm))
        for (a, b, c), symbol in zip(orders, symbols, strict=True):
            total += symbol * (q_nm[:, a] * q_nm[:, b] * q_nm[:, c]).real
        square = (np.abs(q_nm) ** 2).sum(axis=1)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.asarray(total / square**1.5)

    def __repr__(self) -> str:
        without = self.without_neighbors
        name = f"psi_{self.degree}" if self.neighbors.vector_pd.shape[1] == 2 else f"Q_{self.degree}"
        return (
            f"BondOrder {name} of {len(self.component_nm)} particles: global {self.global_order:.6g}, local "
            f"{self.local_order:.6g}, neighbors by {self.neighbors.rule}"
            + (f"; {without} of them without any are left out of the means" if without else "")
        )


@honors("links shapes", packing_only=True)
def bond_orientational_order(
    packing: Packing,
    degree: int = 6,
    neighbors: Neighbors | str = "voronoi",
    *,
    cutoff: float | None = None,
    gap_tolerance: float | None = None,
    smallest_face: float | None = None,
) -> BondOrder:
    """Return the bond orientational order: psi_k in a plane, Q_l and W_l in space, of each particle and of all.

    Equations 2.30 to 2.33 of Schreck and O'Hern (2010). Bonds go from center to center. In a plane order 6 is 1 in
    the triangular crystal; in space Q_6 is .5745 in fcc, .4848 in hcp, and 1 nowhere. Means over particles are those
    over the particles that have neighbors; how many have none is `without_neighbors`.

    Parameters
    ----------
    packing
        The packing.
    degree
        k or l, 1 to 40.
    neighbors
        A rule of `find_neighbors`, whose other arguments are passed on, or the neighbors that it gave.
    cutoff, gap_tolerance, smallest_face
        As in `find_neighbors`, for a rule.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, the neighbors are those of another packing, or two are at one place.

    Examples
    --------
    >>> import packmech as pm
    >>> pm.bond_orientational_order(pm.lattice_packing("triangular", repeats=(4, 4)), 6)
    BondOrder psi_6 of 16 particles: global 1, local 1, neighbors by Voronoi cells (faces above 1e-06 spacings^1)
    >>> fcc = pm.bond_orientational_order(pm.lattice_packing("fcc", repeats=(2, 2, 2)), 6, "contact")
    >>> round(fcc.global_order, 7), round(fcc.global_w, 6)
    (0.5745243, -0.013161)

    """
    instance("packing", packing, Packing)
    number = integer("degree", degree, at_least=1, at_most=_HIGHEST)
    given: dict[str, float] = {
        name: value
        for name, value in (("cutoff", cutoff), ("gap_tolerance", gap_tolerance), ("smallest_face", smallest_face))
        if value is not None
    }
    if isinstance(neighbors, str):
        neighbors = find_neighbors(packing, one_of("neighbors", neighbors, RULES), **given)
    elif given:
        raise TypeError(f"{next(iter(given))} must be left out where neighbors are given")
    instance("neighbors", neighbors, Neighbors)
    if neighbors.particles != packing.particles:
        raise ValueError(
            f"neighbors must be those of the packing, of {packing.particles} particles, got {neighbors.particles}"
        )
    if not neighbors.vector_pd.any(axis=1).all():
        p = int(np.argmin(neighbors.vector_pd.any(axis=1)))
        raise ValueError(
            f"neighbors must have centers apart, got particles {neighbors.i_p[p]} and {neighbors.j_p[p]} at one place"
        )
    if packing.dimension == 2:
        psi = _fold(neighbors.i_p, neighbors.vector_pd, packing.particles, number)
        return BondOrder(number, psi.view(np.complex128), neighbors)
    half = _harmonics(neighbors.i_p, neighbors.vector_pd, packing.particles, number).view(np.complex128)[..., 0]
    sign = (-1.0) ** np.arange(number, 0, -1)
    q = np.concatenate([sign * half[:, :0:-1].conj(), half], axis=1)
    component = (q * math.sqrt(4.0 * math.pi / (2.0 * number + 1.0))).astype(np.complex128)
    return BondOrder(number, component, neighbors)
