"""Elastic moduli as a record: stiffness matrices, their averages, and which directions are soft."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from packmech.check import one_of
from packmech.mechanics.strain import (
    isochoric_basis,
    mandel_basis,
    mandel_vector,
    stiffness_component,
    stiffness_tensor,
    trace_vector,
)

# components of unit strains below this are rounding
_TOUCHED = 1e-8


@dataclass(frozen=True)
class Average:
    """Moduli of the isotropic material that stands for an anisotropic one.

    Attributes
    ----------
    bulk_modulus, shear_modulus
        [energy/length^d].
    young_modulus
        2 d^2 K G / (d(d-1) K + 2 G) [energy/length^d].
    poisson_ratio
        (d K - 2 G) / (d(d-1) K + 2 G) [1]; at most 1 in two dimensions, 1/2 in three.

    """

    bulk_modulus: float
    shear_modulus: float
    dimension: int

    @property
    def young_modulus(self) -> float:
        """Young's modulus [energy/length^d]; nan without any stiffness."""
        d, bulk, shear = self.dimension, self.bulk_modulus, self.shear_modulus
        if np.isinf(shear):
            return d * d * bulk
        if np.isinf(bulk):
            return 2.0 * d * shear / (d - 1)
        below = d * (d - 1) * bulk + 2.0 * shear
        return 2.0 * d * d * bulk * shear / below if below else float("nan")

    @property
    def poisson_ratio(self) -> float:
        """Poisson ratio [1]; nan without any stiffness, or without any motion."""
        d, bulk, shear = self.dimension, self.bulk_modulus, self.shear_modulus
        if np.isinf(bulk) or np.isinf(shear):
            both = np.isinf(bulk) and np.isinf(shear)
            return float("nan") if both else 1.0 / (d - 1) if np.isinf(bulk) else -1.0
        below = d * (d - 1) * bulk + 2.0 * shear
        return (d * bulk - 2.0 * shear) / below if below else float("nan")


@dataclass(frozen=True, eq=False)
class Moduli:
    """Linear elastic response of a packing, particles relaxed, contact forces included unless left out by name.

    All matrices are in Mandel components (xx, yy, sqrt2 xy; xx, yy, zz, sqrt2 yz, sqrt2 xz, sqrt2 xy) and in
    [energy/length^d].

    Attributes
    ----------
    energy
        (s, s) second derivatives of the relaxed energy with respect to a symmetric strain, over the volume.
    cauchy
        (s, s) tangent d(stress)/d(strain) of the Cauchy stress: what an experiment measures. It differs from `energy`
        by terms of the order of the stress, and is not symmetric under a stress that is not a pressure.
    compliance
        (s, s) inverse of `cauchy`; entries that a soft direction makes infinite are inf.
    affine
        (s, s) `energy` before the particles relax.
    stress_dd
        (d, d) Cauchy stress, tension positive; zero where "unstressed" moduli were asked for.
    soft_directions
        (k, s) orthonormal strains that cost nothing: their modulus is 0 and their compliance infinite.
    stiff_directions
        (k, s) orthonormal strains that rigid links forbid, whatever the particles do: infinite modulus, zero
        compliance. Links do so only where they close around the box. `energy`, `cauchy` and `affine` hold 0 along these
        directions, and the stiffness of the others across them; moduli and averages that they touch are inf.
    negative_positions, negative_strains
        Unstable directions: negative eigenvalues of the positions' Hessian, and of `energy`.
    cauchy_least
        Smallest eigenvalue of the symmetric part of `cauchy`.
    floppy_positions
        Zero modes of the positions' Hessian besides translations; they carry no strain.
    particles, contacts
        Particles and contacts that took part (rattlers left out unless they were kept).
    residual
        Largest unbalanced force of the relaxation over the largest force it had to balance [1].
    force_residual
        Largest net force on a particle over the mean contact force of the packing as given [1]. Moduli are those of a
        packing at rest: when this is not small they mean little.
    seconds
        CPU time.

    """

    energy: NDArray[np.float64]
    cauchy: NDArray[np.float64]
    compliance: NDArray[np.float64]
    affine: NDArray[np.float64]
    stress_dd: NDArray[np.float64]
    soft_directions: NDArray[np.float64]
    stiff_directions: NDArray[np.float64]
    negative_positions: int
    negative_strains: int
    cauchy_least: float
    floppy_positions: int
    particles: int
    contacts: int
    residual: float
    force_residual: float
    seconds: float

    @property
    def dimension(self) -> int:
        """Number of Cartesian axes."""
        return len(self.stress_dd)

    @property
    def pressure(self) -> float:
        """-trace(stress)/d [energy/length^d]."""
        return -float(np.trace(self.stress_dd)) / self.dimension

    @property
    def negative_modes(self) -> int:
        """Negative eigenvalues of the energy over positions and strains (Haynsworth: the two counts add up)."""
        return self.negative_positions + self.negative_strains

    @property
    def stable_in_box(self) -> bool:
        """Whether no motion of the particles in the fixed box lowers the energy: `negative_positions` is 0."""
        return self.negative_positions == 0

    @property
    def stable(self) -> bool:
        """Whether no motion of particles and box lowers the energy, nor any strain works against the stress it makes.

        True needs no negative mode of the energy (`negative_modes`) and no negative eigenvalue of the symmetric part
        of `cauchy`; soft directions, which cost nothing, are allowed. Averages of an unstable packing mean nothing.
        """
        largest = float(np.abs(self.affine).max(initial=0.0))
        return self.negative_modes == 0 and self.cauchy_least >= -1e-10 * largest

    @property
    def bulk_modulus(self) -> float:
        """-V dP/dV when the box is scaled without changing its shape (relaxed, Cauchy) [energy/length^d].

        It equals `voigt.bulk_modulus`.
        """
        return self.voigt.bulk_modulus

    @property
    def shear_modulus(self) -> float:
        """d(stress_xy)/d(gamma) when the box is sheared along x with y (relaxed, Cauchy) [energy/length^d].

        It is `simple_shear(0, 1)`, one direction of shear; `voigt.shear_modulus` is the mean over all directions.
        """
        return self.simple_shear(0, 1)

    def simple_shear(self, flow: int = 0, gradient: int = 1) -> float:
        """Return the modulus of simple shear: (1/V) d2E/dgamma2, displacements gamma * x[gradient] along axis `flow`.

        C_abab + (3 s_bb - s_aa)/4, with C = `energy`, a the flow, b the gradient and s the stress; C_xyxy - P/2 under
        a pressure.

        Raises
        ------
        ValueError
            If the axes are the same or there is no such axis.

        """
        axes = range(self.dimension)
        if flow not in axes or gradient not in axes or flow == gradient:
            raise ValueError(
                f"flow and gradient must be two different axes below {self.dimension}, got {flow}, {gradient}"
            )
        name = "xyz"[flow] + "xyz"[gradient]
        strain = np.zeros((self.dimension, self.dimension))
        strain[flow, gradient] = strain[gradient, flow] = 1.0
        if (np.abs(self.stiff_directions @ mandel_vector(strain)) > _TOUCHED).any():
            return float("inf")
        stress = self.stress_dd
        shear = stiffness_component(self.energy, name + name)
        return shear + (3.0 * float(stress[gradient, gradient]) - float(stress[flow, flow])) / 4.0

    def average(self, bound: str, *, tangent: str = "cauchy") -> Average:
        """Return the "voigt", "reuss" or "hill" average of the matrix named "cauchy", "energy" or "affine".

        Raises
        ------
        ValueError
            If a name is unknown.

        """
        one_of("bound", bound, ("voigt", "reuss", "hill"))
        matrix = self._matrix(tangent)
        voigt = voigt_average(matrix, self.stiff_directions)
        if bound == "voigt":
            return voigt
        soft = self.soft_directions if tangent != "affine" else np.zeros((0, len(matrix)))
        reuss = reuss_average(matrix, soft, self.stiff_directions)
        if bound == "reuss":
            return reuss
        bulk = (voigt.bulk_modulus + reuss.bulk_modulus) / 2.0
        return Average(bulk, (voigt.shear_modulus + reuss.shear_modulus) / 2.0, self.dimension)

    @property
    def voigt(self) -> Average:
        """Average over directions of `cauchy`: the response to imposed strains."""
        return self.average("voigt")

    @property
    def reuss(self) -> Average:
        """Average over directions of `compliance`: the response to imposed stresses; 0 with a soft direction."""
        return self.average("reuss")

    @property
    def hill(self) -> Average:
        """Mean of the Voigt and Reuss moduli."""
        return self.average("hill")

    @property
    def poisson_ratio(self) -> float:
        """Poisson ratio of the Hill average [1]."""
        return self.hill.poisson_ratio

    @property
    def anisotropy(self) -> float:
        """Universal anisotropy K_V/K_R + n G_V/G_R - d(d+1)/2 with n = (d-1)(d+2)/2 [1].

        0 for isotropic packings, inf with soft or stiff directions; the usual 5 G_V/G_R + K_V/K_R - 6 in three
        dimensions.
        """
        voigt, reuss, d = self.voigt, self.reuss, self.dimension
        if len(self.stiff_directions):
            return float("inf")
        if reuss.bulk_modulus == 0.0 or reuss.shear_modulus == 0.0:
            return float("inf")
        ratio = voigt.bulk_modulus / reuss.bulk_modulus + _deviators(d) * voigt.shear_modulus / reuss.shear_modulus
        return ratio - d * (d + 1) / 2.0

    def _matrix(self, tangent: str) -> NDArray[np.float64]:
        one_of("tangent", tangent, ("cauchy", "energy", "affine"))
        matrix: NDArray[np.float64] = getattr(self, tangent)
        return matrix

    def component(self, indices: str, *, tangent: str = "cauchy") -> float:
        """Return a component such as "xyxy" of the matrix named "cauchy", "energy" or "affine" [energy/length^d]."""
        return stiffness_component(self._matrix(tangent), indices)

    def tensor(self, *, tangent: str = "cauchy") -> NDArray[np.float64]:
        """Return the (d, d, d, d) tensor of the matrix named "cauchy", "energy" or "affine" [energy/length^d]."""
        return stiffness_tensor(self._matrix(tangent))


def _deviators(dimension: int) -> int:
    return (dimension - 1) * (dimension + 2) // 2


def _inverse(value: float) -> float:
    return 1.0 / value if value else float("inf")


def _dimension(stiffness_ee: NDArray[np.float64]) -> int:
    return 2 if len(stiffness_ee) == 3 else 3


def _touches(direction_ke: NDArray[np.float64] | None, dimension: int) -> tuple[bool, bool]:
    """Return whether any of the strains changes the volume, and whether any changes the shape."""
    if direction_ke is None or not len(direction_ke):
        return False, False
    volume = bool((np.abs(direction_ke @ trace_vector(dimension)) > _TOUCHED).any())
    return volume, bool((np.abs(direction_ke @ isochoric_basis(dimension)) > _TOUCHED).any())


def voigt_average(stiffness_ee: NDArray[np.float64], stiff_ke: NDArray[np.float64] | None = None) -> Average:
    """Return the average over directions of a stiffness: the response to imposed strains.

    Infinite where one of the (k, s) stiff directions forbids a strain.

    K = 1.C.1/d^2 and G = (tr C - 1.C.1/d)/(2 n) with n = (d-1)(d+2)/2, for a Mandel matrix.

    Examples
    --------
    >>> voigt_average(np.diag([2.0, 2.0, 1.0])).shear_modulus
    0.75

    """
    d = _dimension(stiffness_ee)
    around = float(trace_vector(d) @ stiffness_ee @ trace_vector(d))
    shear = (float(np.trace(stiffness_ee)) - around / d) / (2.0 * _deviators(d))
    stiff_bulk, stiff_shear = _touches(stiff_ke, d)
    return Average(float("inf") if stiff_bulk else around / d**2, float("inf") if stiff_shear else shear, d)


def reuss_average(
    stiffness_ee: NDArray[np.float64], soft_ke: NDArray[np.float64], stiff_ke: NDArray[np.float64] | None = None
) -> Average:
    """Return the average over directions of the inverse of a stiffness: the response to imposed stresses.

    1/K = 1.S.1 and 1/G = 2 (tr S - 1.S.1/d)/n, for a Mandel matrix; 0 where one of the (k, s) soft directions yields.
    Stiff directions add nothing to the compliance.

    Examples
    --------
    >>> reuss_average(np.diag([2.0, 2.0, 1.0]), np.zeros((0, 3))).shear_modulus
    0.6666666666666666

    """
    d = _dimension(stiffness_ee)
    left_out = soft_ke if stiff_ke is None or not len(stiff_ke) else np.concatenate([soft_ke, stiff_ke])
    firm = firm_inverse(stiffness_ee, left_out)
    around = float(trace_vector(d) @ firm @ trace_vector(d))
    deviatoric = float(np.trace(firm)) - around / d
    if left_out is not soft_ke:
        # a stiff direction leaves its zero to rounding
        around, deviatoric = (0.0 if x <= 1e-12 * float(np.trace(firm)) else x for x in (around, deviatoric))
    soft_bulk, soft_shear = _touches(soft_ke, d)
    bulk = 0.0 if soft_bulk else _inverse(around)
    shear = 0.0 if soft_shear else _inverse(2.0 * deviatoric / _deviators(d))
    return Average(bulk, shear, d)


def firm_inverse(stiffness_ee: NDArray[np.float64], soft_ke: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the inverse of a stiffness on the strains across the soft ones, zero along these."""
    size = len(stiffness_ee)
    if len(soft_ke) == size:
        return np.zeros((size, size))
    across = np.linalg.svd(soft_ke, full_matrices=True)[2][len(soft_ke) :] if len(soft_ke) else np.eye(size)
    inverse: NDArray[np.float64] = across.T @ np.linalg.inv(across @ stiffness_ee @ across.T) @ across
    return inverse


def with_infinities(firm_ee: NDArray[np.float64], soft_ke: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the compliance with the entries that the soft directions make infinite, in sign, set to infinity."""
    if not len(soft_ke):
        return firm_ee
    endless = soft_ke.T @ soft_ke
    return np.where(np.abs(endless) > 1e-8, np.copysign(np.inf, endless), firm_ee)


def cauchy_tangent(energy_ee: NDArray[np.float64], stress_dd: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the tangent of the Cauchy stress as a Mandel matrix.

    C_energy : eps + (eps sigma + sigma eps)/2 - sigma tr eps.

    Section 14 of the corrected specification; under sigma = -P it makes K + P(d-1)/d and G - P/2.
    """
    basis = mandel_basis(len(stress_dd))
    trace = np.trace(basis, axis1=1, axis2=2)[:, None, None]
    extra = (basis @ stress_dd + stress_dd @ basis) / 2.0 - stress_dd * trace
    tangent: NDArray[np.float64] = energy_ee + np.einsum("kab,mab->km", basis, extra)
    return tangent
