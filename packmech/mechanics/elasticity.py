"""Elastic moduli and the compliance of a packing by one sparse factorization: stiffness, averages, soft directions."""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from packmech.calls.display import shown
from packmech.calls.honors import honors
from packmech.calls.status import shown_as
from packmech.check import AT_LIMIT, KINDS, Kind, brief, finite_array, instance, integer, one_of, positive
from packmech.constraints.basis import MEMORY_LIMIT, check_memory, motion_basis
from packmech.effects import Friction, acting_friction, bonds_of, memory_columns, remembers
from packmech.jit.blas import single_thread
from packmech.linalg.mandel import (
    isochoric_basis,
    mandel_basis,
    mandel_vector,
    stiffness_component,
    stiffness_tensor,
    trace_vector,
)
from packmech.linalg.threads import factor_threads
from packmech.measure.contact_forces import (
    ContactForces,
    resting_forces,
    unless_at_rest,
)
from packmech.mechanics.frictional import (
    check_frictional,
    find_sliding,
    frictional_network,
    frictional_system,
)
from packmech.mechanics.linked_systems import SOFT, linked_system, negative_motions, soft_shift
from packmech.mechanics.relaxation import RelaxedStrains, relax
from packmech.mechanics.system import System, bordered, system_of
from packmech.packing import without_springs
from packmech.scene import Scene

# a relaxation that leaves more than this unbalanced has no solution: a zero mode that carries strain under stress
_INCONSISTENT = 1e-6
# part of the pressure that rattlers of a packing at rest may bear [1]
_BORNE = 1e-2
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


def _headline(one: Moduli) -> str:
    unit = f"[energy/length^{len(one.stress_dd)}]"
    words = f"bulk modulus {one.bulk_modulus:.6g}, shear modulus {one.shear_modulus:.6g} {unit}"
    if len(one.at_limit_k):
        words += f"\n{len(one.at_limit_k)} contacts at the Coulomb limit: {one.at_limit_motion}"
    return unless_at_rest(one.force_residual, one.at_rest, words)


@shown(_headline)
@dataclass(frozen=True, eq=False)
class Moduli:
    """Linear elastic response of a packing, particles relaxed, contact forces included unless left out by name.

    All matrices are in Mandel components (xx, yy, sqrt2 xy; xx, yy, zz, sqrt2 yz, sqrt2 xz, sqrt2 xy).

    Attributes
    ----------
    energy
        (s, s) second derivatives of the relaxed energy with respect to a symmetric strain, over the volume
        [energy/length^d].
    cauchy
        (s, s) tangent d(stress)/d(strain) of the Cauchy stress: what an experiment measures [energy/length^d]. It
        differs from `energy` by terms of the order of the stress, and is not symmetric under a stress that is not a
        pressure.
    compliance
        (s, s) inverse of `cauchy` [length^d/energy]; entries that a soft direction makes infinite are inf.
    affine
        (s, s) `energy` before the particles relax [energy/length^d].
    stress_dd
        (d, d) Cauchy stress, tension positive [energy/length^d]; zero where "unstressed" moduli were asked for.
    soft_directions
        (k, s) orthonormal strains that cost nothing: their modulus is 0 and their compliance infinite.
    stiff_directions
        (k, s) orthonormal strains that rigid links forbid, whatever the particles do: infinite modulus, zero
        compliance. Links do so only where they close around the box. `energy`, `cauchy` and `affine` hold 0 along these
        directions, and the stiffness of the others across them; moduli and averages that they touch are inf.
    negative_positions, negative_strains
        Unstable directions: negative eigenvalues of the positions' Hessian, and of `energy`.
    cauchy_least
        Smallest eigenvalue of the symmetric part of `cauchy` [energy/length^d].
    floppy_positions
        Zero modes of the positions' Hessian besides translations; they carry no strain.
    particles, contacts
        Particles and contacts that took part (rattlers left out unless they were kept).
    residual
        Largest unbalanced force of the relaxation over the largest force it had to balance [1].
    force_residual
        Largest net force on a particle over the mean contact force of the packing as given, rattlers included [1].
        Moduli are those of a packing at rest: when this is not small they mean little.
    seconds
        CPU time.
    at_limit_k, sliding_k
        With friction the contacts at the Coulomb limit that took part, and those of them that slide, by their numbers
        in `contact_forces(scene)`; what they do is the argument `contacts_at_limit`. Empty without.
    turning_at_limit, turning_sliding
        How many springs against rolling and twisting, of contacts that took part, are at their limits, and how many of
        these slip.
    doubtful_at_limit
        How many contacts are so near to the bound between those at the limit and the others that moduli may rest on
        where it lies (`ContactForces.limit`).
    at_limit_motion
        With friction, what contacts at the Coulomb limit do: "stick", "slip", or "strain" where one was given. Empty
        without.
    at_rest
        Whether `force_residual` is at most a hundredth, or no more than rounding of the coordinates makes of it.

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
    at_limit_k: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    sliding_k: NDArray[np.int64] = field(default_factory=lambda: np.zeros(0, dtype=np.int64))
    turning_at_limit: int = 0
    turning_sliding: int = 0
    doubtful_at_limit: int = 0
    at_limit_motion: str = ""
    at_rest: bool = True

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
        of `cauchy`; soft directions, which cost nothing, are allowed. Averages of an unstable packing are nan.
        """
        largest = float(np.abs(self.affine).max(initial=0.0))
        return self.negative_modes == 0 and self.cauchy_least >= -1e-10 * largest

    @property
    def bulk_modulus(self) -> float:
        """-V dP/dV when the box is scaled without changing its shape (relaxed, Cauchy) [energy/length^d].

        The response to one imposed strain, which a packing has also where it is unstable to others. Of a stable one it
        equals `voigt.bulk_modulus`.
        """
        return voigt_average(self.cauchy, self.stiff_directions).bulk_modulus

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
        if (
            any(not isinstance(one, int | np.integer) or one not in axes for one in (flow, gradient))
            or flow == gradient
        ):
            raise ValueError(
                f"flow and gradient must be two different axes below {self.dimension}, "
                f"got {brief(flow)}, {brief(gradient)}"
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

        No isotropic material stands for an unstable packing (see `stable`): its averages are nan. Those of "affine",
        where particles do not relax, are nan only where that matrix itself has a negative eigenvalue.

        Raises
        ------
        ValueError
            If a name is unknown.

        """
        one_of("bound", bound, ("voigt", "reuss", "hill"))
        matrix = self._matrix(tangent)
        if not (_is_not_negative(matrix) if tangent == "affine" else self.stable):
            return Average(float("nan"), float("nan"), self.dimension)
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

        0 for isotropic packings, inf with soft or stiff directions, nan where the packing is unstable; the usual
        5 G_V/G_R + K_V/K_R - 6 in three dimensions.
        """
        if not self.stable:
            return float("nan")
        voigt, reuss = self.voigt, self.reuss
        return float("inf") if len(self.stiff_directions) else universal_anisotropy(voigt, reuss)

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


def _is_not_negative(matrix_ee: NDArray[np.float64]) -> bool:
    """Return whether no eigenvalue of a symmetric matrix is below zero, but for rounding."""
    return bool(np.linalg.eigvalsh(matrix_ee)[0] >= -1e-10 * np.abs(matrix_ee).max())


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


def universal_anisotropy(voigt: Average, reuss: Average) -> float:
    """Return K_V/K_R + n G_V/G_R - d(d+1)/2 with n = (d-1)(d+2)/2 [1]; inf where a modulus is 0 or infinite.

    Examples
    --------
    >>> universal_anisotropy(Average(2.0, 1.0, 3), Average(2.0, 1.0, 3))
    0.0

    """
    moduli = voigt.bulk_modulus, voigt.shear_modulus, reuss.bulk_modulus, reuss.shear_modulus
    if 0.0 in moduli[2:] or not np.isfinite(moduli).all():
        return float("inf")
    d = voigt.dimension
    ratio = voigt.bulk_modulus / reuss.bulk_modulus + _deviators(d) * voigt.shear_modulus / reuss.shear_modulus
    return ratio - d * (d + 1) / 2.0


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
    inverse = inverse_across(stiffness_ee, left_out)
    around = float(trace_vector(d) @ inverse @ trace_vector(d))
    deviatoric = float(np.trace(inverse)) - around / d
    if left_out is not soft_ke:
        # a stiff direction leaves its zero to rounding
        around, deviatoric = (0.0 if x <= 1e-12 * float(np.trace(inverse)) else x for x in (around, deviatoric))
    soft_bulk, soft_shear = _touches(soft_ke, d)
    bulk = 0.0 if soft_bulk else _inverse(around)
    shear = 0.0 if soft_shear else _inverse(2.0 * deviatoric / _deviators(d))
    return Average(bulk, shear, d)


def inverse_across(stiffness_ee: NDArray[np.float64], soft_ke: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the inverse of a stiffness on the strains across the soft ones, zero along these."""
    size = len(stiffness_ee)
    if len(soft_ke) == size:
        return np.zeros((size, size))
    across = np.linalg.svd(soft_ke, full_matrices=True)[2][len(soft_ke) :] if len(soft_ke) else np.eye(size)
    inverse: NDArray[np.float64] = across.T @ np.linalg.inv(across @ stiffness_ee @ across.T) @ across
    return inverse


def with_infinities(finite_ee: NDArray[np.float64], soft_ke: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the compliance with the entries that the soft directions make infinite, in sign, set to infinity."""
    if not len(soft_ke):
        return finite_ee
    endless = soft_ke.T @ soft_ke
    return np.where(np.abs(endless) > 1e-8, np.copysign(np.inf, endless), finite_ee)


def cauchy_tangent(energy_ee: NDArray[np.float64], stress_dd: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the tangent of the Cauchy stress as a Mandel matrix.

    C_energy : eps + (eps sigma + sigma eps)/2 - sigma tr eps.

    Under sigma = -P it makes K + P(d-1)/d and G - P/2.
    """
    basis = mandel_basis(len(stress_dd))
    trace = np.trace(basis, axis1=1, axis2=2)[:, None, None]
    extra = (basis @ stress_dd + stress_dd @ basis) / 2.0 - stress_dd * trace
    tangent: NDArray[np.float64] = energy_ee + np.einsum("kab,mab->km", basis, extra)
    return tangent


def _unsolved(system: System, relaxation: RelaxedStrains) -> int:
    """Return how many strains are unstable for want of a relaxation: zero modes that carry strain under stress."""
    if relaxation.residual <= _INCONSISTENT:
        return 0
    if not system.assembled.symmetric:
        return 1
    pinned, links = system.network.pinned_f, system.links
    whole = bordered(system.matrix(pinned), system.column(pinned), system.corner)
    shift = soft_shift(whole)
    rows = sp.csr_array((0, whole.shape[0]))
    if len(links):
        gradient, stretch = links.independent_rows()
        rows = sp.csr_array(sp.hstack([gradient[:, pinned], sp.csr_array(stretch)], format="csr"))
    negative = negative_motions(linked_system(whole, rows), shift, system.network.dimension)
    return max(negative - relaxation.negative, 1)


def _across(matrix_ee: NDArray[np.float64], stiff_ke: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the matrix on the strains across the stiff ones, zero along these."""
    if not len(stiff_ke):
        return matrix_ee
    if len(stiff_ke) == len(matrix_ee):
        return np.zeros_like(matrix_ee)
    across = np.eye(len(matrix_ee)) - stiff_ke.T @ stiff_ke
    kept: NDArray[np.float64] = across @ matrix_ee @ across
    return kept


@shown_as("elastic moduli")
@honors("repulsion kinds friction rolling bonds interactions links shapes memory", at_rest=True)
def elastic_moduli(
    scene: Scene,
    *,
    kind: Kind = "exact",
    rattlers: str = "remove",
    gap_tolerance: float | None = None,
    contacts_at_limit: str | ArrayLike = "stick",
    threads: int = 1,
) -> Moduli:
    """Return the elastic moduli of a packing at rest, its particles free to relax.

    The relaxed stiffness is the Schur complement H_ee - H_ex H_xx^-1 H_xe of the extended Hessian, with d coordinates
    of one particle pinned (equations 44-49 of Dennis, 2021, with their errata: over the volume, and Cauchy
    terms). Its null space is the soft strains, whose modulus is 0 and not, as a pseudo-inverse of the compliance
    would have it, infinite: a square lattice has G = 0. Rigid links keep their lengths while the particles relax, their
    forces unknowns of the same sparse system; strains that links forbid are `Moduli.stiff_directions`.

    With `Friction` contacts have tangential springs and particles turn, too: the matrix is that of `stiffness_matrix`,
    not symmetric in general, and neither is then `Moduli.energy`, which is the derivative of the stress times the
    volume. Negative and zero modes are those of its symmetric part: where none is negative every small motion takes
    work (Hill's second-order work), which is enough for stability and not needed for it. A coefficient of 0 is no
    friction.

    Bonds are springs, those across them slack at rest, which turn discs and spheres as friction does.

    Ellipses and spheroids turn while they relax: a strain moves their centers and by itself turns none. With friction
    linked discs turn each about its own center, which links do not feel.

    Parameters
    ----------
    scene
        The scene; its packing should be at rest (see `Moduli.force_residual`).
    kind
        "exact" with the forces of contacts and links, "unstressed" without them; "paper" with those of the contacts
        alone, which is the same where there are no links.
    rattlers
        "remove" leaves them out, linked ones where their whole cluster can be moved, with friction those of
        `contact_forces`; "keep" lets their last contacts stiffen the packing.
    gap_tolerance
        Pairs with a gap up to this times the contact distance [1] are contacts; those that do not overlap count with
        u''(1-). None: the rule of `find_contacts`. With friction contacts are pairs that overlap, and no others.
    contacts_at_limit
        With friction, what contacts at the Coulomb limit do, and springs against rolling and twisting at their limits:
        all "stick" or all "slip", as in `stiffness_matrix`; or a
        (d, d) strain, such as [[0, 1], [1, 0]] for the shear that `shear_modulus` answers to: those slide that it loads
        and those stick that it unloads, together with the motion that follows. Its sign matters and its size does not.
        The moduli are then the response to this strain, and to others that let the same contacts slide: they hold for
        strains that change forces by more than the distances to the limit of `at_limit_k` and by less than those of
        other contacts. No strain need do what "stick" or "slip" say; its moduli mostly lie between the two, though
        with forces that derive from no energy these are no bounds.
    threads
        Number of threads of the factorizations; it changes no bit, and `seconds` counts the time of all. Two pay in
        space: 1.5 times as fast for 8192 spheres, 1.06 for 65536 discs.

    Returns
    -------
    Moduli
        `bulk_modulus` and `shear_modulus` are relaxed Cauchy moduli at imposed box scaling and imposed simple shear
        in the xy plane; averages over directions by name (`voigt`, `reuss`, `hill`). A packing without contacts has
        moduli 0, and all strains soft.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind, a name is unknown, touching centers coincide, or rattlers that would be
        left out bear a pressure: at rest between their own images.

    Examples
    --------
    >>> import packmech as pm
    >>> crystal = pm.lattice_packing("triangular", repeats=(1, 1))
    >>> moduli = pm.elastic_moduli(pm.Scene(crystal, (pm.Repulsion(),)))
    >>> round(moduli.bulk_modulus, 9), round(moduli.shear_modulus, 9), moduli.stable
    (0.866025404, 0.433012702, True)

    Tangential springs, as stiff as the others here, add to G and not to B of a crystal:

    >>> pressed = pm.lattice_packing("triangular", repeats=(2, 2), relative_overlap=0.01)
    >>> rough = pm.Scene(pressed, (pm.Repulsion(), pm.Friction(0.5, stiffness=1.0)))
    >>> moduli = pm.elastic_moduli(rough, kind="unstressed")
    >>> round(moduli.bulk_modulus, 9), round(moduli.shear_modulus, 9)
    (0.866025404, 0.866025404)

    """
    start = time.process_time()
    instance("scene", scene, Scene)
    one_of("kind", kind, KINDS)
    integer("threads", threads, at_least=1)
    at_limit = _at_limit(contacts_at_limit, scene.packing.dimension)
    bonds = bonds_of(scene.effects)
    rough = acting_friction(scene.effects) is not None
    if rough and memory_columns(scene.effects):
        named = next(type(one).__qualname__ for one in scene.effects if remembers(one))
        raise ValueError(
            f"scene.effects must not hold both friction and {named} for pm.elastic_moduli, whose rule of which "
            "contacts bear looks at repulsive forces: leave the friction out with scene.without(pm.Friction)"
        )
    if not rough:
        # a coefficient of zero holds nothing, and springs of such contacts are slack
        scene = scene.without(Friction).replace(packing=without_springs(scene.packing))
        # tangential springs of bonds turn discs and spheres, as friction does
        rough = bonds is not None and bonds.tangential_stiffness > 0.0
    with single_thread(), factor_threads(threads):
        found = _rough_response(scene, kind, rattlers, gap_tolerance, at_limit) if rough else None
        if found is None:
            system = system_of(scene, kind, gap_tolerance=gap_tolerance, rattlers=rattlers)
            relaxation = relax(system)
            unsolved = _unsolved(system, relaxation)
        else:
            system, relaxation = found.system, found.relaxation
            # without a set that agrees with its motion there is no answer at rest, as along a negative direction
            unsolved = int(relaxation.residual > _INCONSISTENT or not found.consistent)
        # the rule of `find_contacts` takes all pairs that touch
        known = system.network.found if found is None and gap_tolerance is None else None
        whole = resting_forces(scene, near=known)
        _refuse_bearing_rattlers(whole, system.virial_of_springs if found is None else found.virial)
        whole.warn_of_rattlers(scene.packing.particles - len(system.network.index_n))
        response = _moduli(system, relaxation, found, scene.packing.box.volume, unsolved, whole, start)
    if acting_friction(scene.effects) is None:
        return response
    return replace(response, at_limit_motion=at_limit if isinstance(at_limit, str) else "strain")


def _at_limit(given: str | ArrayLike, dimension: int) -> str | NDArray[np.float64]:
    """Return what contacts at the Coulomb limit do, checked: a name, or the Mandel components of a strain."""
    if isinstance(given, str):
        return one_of("contacts_at_limit", given, AT_LIMIT)
    strain = finite_array("contacts_at_limit", given, shape=(dimension, dimension))
    if not strain.any():
        raise ValueError("contacts_at_limit must be a strain that is not zero, 'stick' or 'slip', got zeros")
    return mandel_vector((strain + strain.T) / 2.0)


class _RoughResponse(NamedTuple):
    """The response of a packing with friction, the contacts at the Coulomb limit, and forces times vectors, of all."""

    system: System
    relaxation: RelaxedStrains
    consistent: bool
    sliding_k: NDArray[np.int64]
    at_limit_k: NDArray[np.int64]
    turning_at_limit: int
    turning_sliding: int
    doubtful: int
    virial: float


def _rough_response(
    scene: Scene, kind: Kind, rattlers: str, gap_tolerance: float | None, at_limit: str | NDArray[np.float64]
) -> _RoughResponse:
    """Return how a frictional packing relaxes while contacts at the limit do what is asked for."""
    # what contacts add is the same: "paper" leaves out the forces of links
    check_frictional("exact" if kind == "paper" else kind, gap_tolerance=gap_tolerance)
    contacts = frictional_network(scene, rattlers)
    if isinstance(at_limit, str):
        sliding, consistent = contacts.sliding(at_limit), True
        system, _ = frictional_system(scene, contacts, kind, sliding)
        relaxation = relax(system)
    else:
        system, relaxation, sliding, consistent = find_sliding(scene, contacts, kind, at_limit)
    return _RoughResponse(
        system,
        relaxation,
        consistent,
        contacts.chosen_c[sliding[0]],
        contacts.chosen_c[contacts.at_limit_sc[0]],
        int(np.count_nonzero(contacts.at_limit_sc[1:])),
        int(np.count_nonzero(sliding[1:])),
        int(np.count_nonzero(contacts.doubtful_c)),
        float((contacts.forces.force_cd * contacts.network.contacts.vector_cd).sum())
        + float(np.trace(contacts.network.interactions.virial())),
    )


def _refuse_bearing_rattlers(forces: ContactForces, virial: float) -> None:
    """Raise ValueError where the packing is at rest and rattlers that are left out bear a part of its pressure.

    Forces are those of all contacts, `virial` is the sum of du/dr r over the contacts and bonds that are kept.
    """
    whole = float(np.trace(forces.contact_stress_dd)) * forces.scene.packing.box.volume
    if forces.at_rest and abs(whole - virial) > _BORNE * abs(whole):
        raise ValueError(
            f"scene must have rattlers that bear no pressure, got rattlers that bear {1.0 - virial / whole:.2g} of it, "
            'as between their own images: rattlers="keep" takes their contacts along'
        )


def _moduli(
    system: System,
    relaxation: RelaxedStrains,
    rough: _RoughResponse | None,
    volume: float,
    unsolved: int,
    whole: ContactForces,
    start: float,
) -> Moduli:
    """Return the record of a relaxed stiffness; `unsolved` strains are unstable for want of a relaxation."""
    stiff = system.links.stiff_strains
    energy = (system.corner - relaxation.relief_ee) / volume
    energy = _across((energy + energy.T) / 2.0 if system.assembled.symmetric else energy, stiff)
    affine, stress = system.corner / volume, system.virial_dd / volume
    cauchy = _across(cauchy_tangent(energy, stress), stiff)
    scale = float(np.abs(np.linalg.eigvalsh((affine + affine.T) / 2.0)).max())
    negative = int(np.count_nonzero(np.linalg.eigvalsh((energy + energy.T) / 2.0) < -SOFT * scale))
    if unsolved:
        negative = unsolved
    # along stiff directions there is no motion: lift them out of the way of soft and unstable ones
    lift = scale or 1.0
    lifted = cauchy + lift * (stiff.T @ stiff) if len(stiff) else cauchy
    smallest = float(np.linalg.eigvalsh((lifted + lifted.T) / 2.0)[0])
    _, size, direction = np.linalg.svd(lifted)
    soft = direction[size <= SOFT * lift]
    inverse = _across(inverse_across(lifted, soft), stiff)
    none = np.zeros(0, dtype=np.int64)
    return Moduli(
        energy=energy,
        cauchy=cauchy,
        compliance=with_infinities(inverse, soft),
        affine=affine,
        stress_dd=stress,
        soft_directions=soft,
        stiff_directions=stiff,
        negative_positions=relaxation.negative,
        negative_strains=negative,
        cauchy_least=smallest,
        floppy_positions=relaxation.floppy,
        particles=len(system.network.index_n),
        contacts=len(system.network.contacts),
        residual=relaxation.residual,
        force_residual=whole.residual,
        at_rest=whole.at_rest,
        seconds=time.process_time() - start,
        at_limit_k=none if rough is None else rough.at_limit_k,
        sliding_k=none if rough is None else rough.sliding_k,
        turning_at_limit=0 if rough is None else rough.turning_at_limit,
        turning_sliding=0 if rough is None else rough.turning_sliding,
        doubtful_at_limit=0 if rough is None else rough.doubtful,
    )


METHODS = ("sparse", "pseudoinverse")
# eigenvalues below this fraction of the largest are zero
_ZERO = 1e-10
# zero modes of size 1 that strain by less than this (as part of their size) carry none
_CARRIES = 1e-6


@shown_as("compliance")
@honors("repulsion kinds bonds interactions links shapes memory", at_rest=True, rough="pm.elastic_moduli")
def compliance_matrix(
    scene: Scene,
    *,
    kind: Kind = "exact",
    method: str = "sparse",
    rattlers: str = "remove",
    gap_tolerance: float | None = None,
    memory_limit: float = MEMORY_LIMIT,
) -> NDArray[np.float64]:
    """Return the (s, s) compliance [length^d/energy] in Mandel components: the inverse of `Moduli.energy`.

    Strains per imposed stress, box free, particles relaxed (shapes turn, too), links kept (equation 49 of Dennis,
    2021, with its errata: both sides selected, times V). Strains that links forbid have compliance 0; entries that a
    soft direction makes infinite are inf.

    Parameters
    ----------
    scene
        The scene; its packing should be at rest.
    kind, rattlers, gap_tolerance
        As in `elastic_moduli`.
    method
        "sparse": from the relaxed stiffness. "pseudoinverse": V times the strain block of B^T (B H B^T)^+ B with a
        dense B (`change_of_basis`; of shapes all motions), as Dennis (2021) has it, for small packings and comparison.
        A pseudoinverse alone gives 0 for infinitely soft strains too: its zero modes are searched for strains, which
        get inf.
    memory_limit
        Largest memory of the pseudoinverse [bytes].

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind, a name is unknown, the scene is not at rest (a net force above 1e-2 of the
        mean contact force), or the pseudoinverse would exceed the limit.

    Examples
    --------
    >>> import packmech as pm
    >>> scene = pm.Scene(pm.lattice_packing("triangular", repeats=(3, 3)), (pm.Repulsion(),))
    >>> one, other = (pm.compliance_matrix(scene, method=name) for name in ("sparse", "pseudoinverse"))
    >>> bool(abs(one - other).max() < 1e-12)
    True

    """
    instance("scene", scene, Scene)
    one_of("kind", kind, KINDS)
    one_of("method", method, METHODS)
    positive("memory_limit", memory_limit)
    forces = resting_forces(scene)
    if not forces.at_rest:
        raise ValueError(
            f"scene must be at rest, got a net force of {forces.residual:.2g} mean contact forces: "
            "quench or jam it first"
        )
    if method == "sparse":
        moduli = elastic_moduli(scene, kind=kind, rattlers=rattlers, gap_tolerance=gap_tolerance)
        stiff = moduli.stiff_directions
        scale = float(np.abs(moduli.affine).max(initial=0.0)) or 1.0
        lifted = moduli.energy + scale * stiff.T @ stiff
        _, size, direction = np.linalg.svd(lifted)
        soft = direction[size <= _ZERO * scale]
        return with_infinities(_across(inverse_across(lifted, soft), stiff), soft)
    with single_thread():
        return _pseudoinverse(scene, kind, rattlers, gap_tolerance, memory_limit)


def _pseudoinverse(
    scene: Scene, kind: Kind, rattlers: str, gap_tolerance: float | None, memory_limit: float
) -> NDArray[np.float64]:
    packing = scene.packing
    system = system_of(scene, kind, gap_tolerance=gap_tolerance, rattlers=rattlers)
    network, links, free = system.network, system.links, system.network.free_f
    size, components = int(free.sum()), len(system.corner)
    if len(links.stiff_strains) == components:
        return np.zeros((components, components))
    if not size:
        return with_infinities(np.zeros((components, components)), np.eye(components))
    check_memory(size + components, size + components, memory_limit)
    full = bordered(system.matrix(), system.column(), system.corner)
    scale = packing.box.volume ** (1.0 / packing.dimension)
    if not len(links):
        basis = np.diag(np.concatenate([np.ones(size), np.full(components, 1.0 / scale)]))
    else:
        mass, strains = np.ones(len(network.index_n)), np.eye(components)
        basis = motion_basis(links, strains, mass_n=mass, strain_scale=scale, memory_limit=memory_limit)
    return _compliance_of(full, basis, size, packing.box.volume)


def _compliance_of(full: sp.csr_array, basis: NDArray[np.float64], size: int, volume: float) -> NDArray[np.float64]:
    """Return the compliance by a Hessian of so many positions and then strains, in a basis of motions in columns."""
    components = full.shape[0] - size
    scale = volume ** (1.0 / {3: 2, 6: 3}[components])
    value, vector = np.linalg.eigh(basis.T @ (full @ basis))
    strain = basis[size:] @ vector
    zero = np.abs(value) <= _ZERO * np.abs(value).max()
    _, carried, direction = np.linalg.svd((strain[:, zero] * scale).T, full_matrices=False)
    soft = direction[carried > _CARRIES]
    inverse = volume * (strain[:, ~zero] / value[~zero]) @ strain[:, ~zero].T
    return with_infinities(inverse, soft)
