"""Linear response of frictional packings: forces and torques against displacements, rotations and strains.

Forces with friction have no energy. What stands in for the Hessian is minus the derivative of the generalized forces,
with the tangential springs carried along as the engine carries them: a spring of displacement s grows by the slip, and
turns with the contact. For a contact of direction n, distance r and arms a, whose branch vector changes by du while its
particles turn by p and q,

    slip                ds = (1 - n n) du + n x (a_i p + a_j q)
    direction           dn = (1 - n n) du / r
    tangential force    dT = k ds + mu dN T/|T| - n (T.du)/r + (n x T) n.(p + q)/2       T = k s
    force on i          df = u'' n (n.du) + u' dn + dT
    torque on i         a_i (dn x T + n x dT) + (n.du) (a_i / r) n x T

Where a contact sticks there is no term with mu; where it slides k acts across T only, which in the plane is nowhere.
A contact at the Coulomb limit sticks where the motion unloads it, k T.ds/|T| < mu dN, and slides where it does not, so
that the response is linear only among motions that unload the same contacts: each direction of strain has a set of
sliding contacts that agrees with the motion it leads to (`find_sliding`).
Then, and wherever contacts carry tangential forces, the matrix is not symmetric (Chattoraj, Gendelman, Pica Ciamarra
and Procaccia, Phys. Rev. Lett. 123, 098003 (2019)).
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from packmech.check import instance, integer, one_of
from packmech.constraints.jacobian import scale_of_strain
from packmech.effects import Friction
from packmech.honors import honors
from packmech.jit.blas import single_thread
from packmech.linalg.factor import NotDefinite, factorize
from packmech.linalg.mandel import STRAINS, mandel_basis
from packmech.measure.contact_forces import ContactForces, contact_forces
from packmech.measure.friction import friction_of
from packmech.mechanics.hessian import closed_terms
from packmech.mechanics.linked_systems import soft_shift
from packmech.scene import Scene

# what contacts at the Coulomb limit do under a small motion
AT_LIMIT = ("stick", "slip")
KINDS = ("exact", "unstressed")
# a matrix whose transpose differs by less, over its largest entry, is symmetric but for rounding
_SYMMETRIC = 1e-12
_REFINEMENTS = 12
# sets of sliding contacts that are tried for one strain
_SETS = 200
# eigenvalues below this fraction of the largest are zero; Arnoldi's method looks this far below zero
_ZERO, _NEAR = 1e-10, 1e-6
_DENSE_ROWS, _DENSE_LIMIT = 600, 3000


def acting_friction(scene: Scene) -> Friction | None:
    """Return the scene's friction; None without, and where its coefficient is 0."""
    friction = friction_of(scene)
    return None if friction is None or friction.coefficient == 0.0 else friction


def check_frictional(
    scene: Scene, kind: str, contacts_at_limit: str = "stick", gap_tolerance: float | None = None
) -> None:
    """Check what calls of frictional packings are given."""
    if scene.packing.links is not None:
        raise ValueError(
            "scene.packing must have no links where contacts have friction, which would turn particles against them, "
            f"got {len(scene.packing.links)}"
        )
    one_of("kind", kind, KINDS)
    one_of("contacts_at_limit", contacts_at_limit, AT_LIMIT)
    if gap_tolerance is not None:
        raise ValueError(
            f"gap_tolerance must be None for a scene with friction, whose contacts are overlaps, got {gap_tolerance}"
        )


def _cross_matrix(vector_c3: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (C, 3, 3) matrices of the products v x."""
    x, y, z = vector_c3.T
    zero = np.zeros_like(x)
    return np.array([[zero, -z, y], [z, zero, -x], [-y, x, zero]]).transpose(2, 0, 1)


def contact_blocks(
    forces: ContactForces,
    first_c: NDArray[np.float64],
    second_c: NDArray[np.float64],
    kind: str,
    sliding_c: NDArray[np.bool_],
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return derivatives of contacts by du and two rotations: of force and torques on i and j, and of what passes mu N.

    The first are (C, d + 2 k, d + 2 k); the others, (C, d + 2 k), are those of the force of a spring that sticks, along
    the tangential force, less those of the limit.

    Parameters
    ----------
    forces
        The contacts with their forces.
    first_c, second_c
        (C,) derivatives of the pair energies [force], [force/length].
    kind
        "exact", or "unstressed": what forces add where contacts turn is left out.
    sliding_c
        (C,) which contacts slide.

    """
    contacts, scene = forces.contacts, forces.scene
    friction = acting_friction(scene)
    coefficient, stiffness = (0.0, 0.0) if friction is None else (friction.coefficient, friction.stiffness)
    count, d = len(contacts), contacts.dimension
    # all in space; a plane takes its part at the end
    n, tangential = np.zeros((count, 3)), np.zeros((count, 3))
    n[:, :d], tangential[:, :d] = contacts.normal_cd, forces.tangential_cd
    size = np.sqrt((tangential**2).sum(axis=1))
    ahead = tangential / np.where(size > 0.0, size, 1.0)[:, None]
    along = np.where(sliding_c[:, None], ahead, 0.0)
    # without forces contacts turn for nothing
    pull, push = (tangential, first_c) if kind == "exact" else (0.0 * tangential, 0.0 * first_c)
    r, sigma = contacts.distance_c, contacts.contact_distance_c
    radius = scene.packing.radius_n
    share = np.stack([radius[contacts.i_c], radius[contacts.j_c]], axis=1) / sigma[:, None]
    arm = share * r[:, None]
    across = np.eye(3) - n[:, :, None] * n[:, None, :]
    turn = _cross_matrix(n)
    stiff = stiffness * (across - along[:, :, None] * along[:, None, :])
    slip = np.concatenate([across, arm[:, :1, None] * turn, arm[:, 1:, None] * turn], axis=2)
    none = np.zeros((count, 3, 6))
    direction = np.concatenate([across / r[:, None, None], none], axis=2)
    stretch = np.concatenate([n, none[:, 0]], axis=1)
    twist = np.concatenate([np.zeros((count, 3)), 0.5 * n, 0.5 * n], axis=1)
    spin = np.cross(n, pull)
    # the limit follows the normal force |u'|
    limit = coefficient * np.sign(first_c) * second_c
    change = (
        stiff @ slip + along[:, :, None] * (limit[:, None] * stretch)[:, None, :] + spin[:, :, None] * twist[:, None]
    )
    change[:, :, :3] -= n[:, :, None] * (pull / r[:, None])[:, None, :]
    force = n[:, :, None] * (second_c[:, None] * stretch)[:, None, :] + push[:, None, None] * direction + change
    bent = turn @ change - _cross_matrix(pull) @ direction
    torque = [
        arm[:, k, None, None] * bent + share[:, k, None, None] * spin[:, :, None] * stretch[:, None] for k in range(2)
    ]
    whole = np.concatenate([force, *torque], axis=1)
    beyond = stiffness * np.einsum("ca,cab->cb", ahead, slip) - limit[:, None] * stretch
    if d == 3:
        return np.asarray(whole), beyond
    plane = np.array([0, 1, 5, 8])
    return np.asarray(whole[:, plane[:, None], plane]), beyond[:, plane]


@dataclass(frozen=True, eq=False)
class FrictionalSystem:
    """Minus the derivatives of forces, torques and stress by displacements, rotations and Mandel strains.

    Attributes
    ----------
    matrix
        (N (d + k), N (d + k)) sparse, displacements of all particles first, then their k = 1 or 3 rotations.
    column_xe, row_ex
        (N (d + k), s) forces and torques by strains, and (s, N (d + k)) stress times volume by motions.
    corner_ee
        (s, s) stress times volume by strains [energy].
    beyond_cx, beyond_ce
        (C, N (d + k)) sparse and (C, s): forces of springs that stick, along the tangential forces, less those of the
        Coulomb limit, by motions and strains.
    particles, dimension
        N and d.

    """

    matrix: sp.csr_array
    column_xe: NDArray[np.float64]
    row_ex: NDArray[np.float64]
    corner_ee: NDArray[np.float64]
    beyond_cx: sp.csr_array
    beyond_ce: NDArray[np.float64]
    particles: int
    dimension: int

    @property
    def symmetric(self) -> bool:
        """Whether the matrix of displacements and rotations is symmetric but for rounding."""
        if not self.matrix.nnz:
            return True
        return bool(abs(self.matrix - self.matrix.T).max() <= _SYMMETRIC * abs(self.matrix).max())


def frictional_system(
    forces: ContactForces,
    first_c: NDArray[np.float64],
    second_c: NDArray[np.float64],
    kind: str,
    sliding_c: NDArray[np.bool_],
    kept_n: NDArray[np.bool_] | None = None,
) -> FrictionalSystem:
    """Return the system of the given contacts, and of the kept particles only, renumbered."""
    contacts = forces.contacts
    for c in np.flatnonzero(contacts.distance_c == 0.0):
        raise ValueError(
            "packing must have no coincident centers where second derivatives are asked for, "
            f"got particles {contacts.i_c[c]} and {contacts.j_c[c]} at one place"
        )
    block, beyond = contact_blocks(forces, first_c, second_c, kind, sliding_c)
    count, d = len(contacts), contacts.dimension
    k = 1 if d == 2 else 3
    # rows of what acts on x_i, x_j and the two rotations: minus force, plus force, minus torques
    block[:, d:] *= -1.0
    # du and rotations by x_i, x_j and the two rotations
    spread = np.zeros((d + 2 * k, 2 * (d + k)))
    spread[:d, :d], spread[:d, d : 2 * d], spread[d:, 2 * d :] = -np.eye(d), np.eye(d), np.eye(2 * k)
    number = np.arange(contacts.particles) if kept_n is None else np.cumsum(kept_n) - 1
    particles = contacts.particles if kept_n is None else int(np.count_nonzero(kept_n))
    i, j = number[contacts.i_c, None], number[contacts.j_c, None]
    axis, spin = np.arange(d), particles * d + np.arange(k)
    place = np.concatenate([i * d + axis, j * d + axis, i * k + spin, j * k + spin], axis=1)
    basis = mandel_basis(d)
    branch = contacts.normal_cd * contacts.distance_c[:, None]
    strain = np.zeros((count, d + 2 * k, len(basis)))
    strain[:, :d] = np.einsum("mab,cb->cam", basis, branch)
    # what a strain makes of forces as they are, along x_j - x_i
    whole = forces.force_cd if kind == "exact" else np.zeros_like(forces.force_cd)
    held = np.zeros((count, 2 * (d + k), len(basis)))
    held[:, d : 2 * d] = np.einsum("mab,cb->cam", basis, whole)
    held[:, :d] = -held[:, d : 2 * d]
    local = spread.T @ block @ spread
    size = particles * (d + k)
    width = 2 * (d + k)
    row, column = np.repeat(place, width, axis=1).ravel(), np.tile(place, (1, width)).ravel()
    matrix = sp.csr_array(sp.coo_array((local.ravel(), (row, column)), shape=(size, size)))
    matrix.sum_duplicates()
    column_xe, row_xe = np.zeros((size, len(basis))), np.zeros((size, len(basis)))
    np.add.at(column_xe, place, spread.T @ block @ strain + held)
    np.add.at(row_xe, place, (strain.transpose(0, 2, 1) @ block @ spread).transpose(0, 2, 1) + held)
    corner = np.einsum("cam,cab,cbk->mk", strain, block, strain)
    row = np.repeat(np.arange(count), width)
    beyond_cx = sp.csr_array(sp.coo_array(((beyond @ spread).ravel(), (row, place.ravel())), shape=(count, size)))
    beyond_ce = np.einsum("ca,cam->cm", beyond, strain)
    return FrictionalSystem(matrix, column_xe, row_xe.T, corner, beyond_cx, beyond_ce, particles, d)


class FrictionalNetwork(NamedTuple):
    """The contacts that hold a frictional packing, derivatives of their energies, and who took part."""

    forces: ContactForces
    first_c: NDArray[np.float64]
    second_c: NDArray[np.float64]
    kept_n: NDArray[np.bool_]
    chosen_c: NDArray[np.int64]
    at_limit_c: NDArray[np.bool_]
    doubtful_c: NDArray[np.bool_]

    def sliding(self, contacts_at_limit: str) -> NDArray[np.bool_]:
        """Return the (C,) contacts that slide where those at the limit all stick, or all slip."""
        return self.at_limit_c & (contacts_at_limit == "slip")


def frictional_network(scene: Scene, rattlers: str) -> FrictionalNetwork:
    """Return the touching pairs of a scene with friction, those of rattlers left out unless these are to be kept."""
    one_of("rattlers", rattlers, ("remove", "keep"))
    found = contact_forces(scene)
    kept = ~found.rattlers_n if rattlers == "remove" else np.ones(scene.packing.particles, dtype=bool)
    chosen = np.flatnonzero(kept[found.contacts.i_c] & kept[found.contacts.j_c])
    contacts = found.contacts.select(chosen)
    terms = closed_terms(scene, contacts)
    forces = ContactForces(scene, contacts, found.normal_c[chosen], found.tangential_cd[chosen])
    # a contact without a tangential force has no direction to slide in
    limit = found.limit.at_limit_c & found.tangential_cd.any(axis=1)
    return FrictionalNetwork(
        forces, terms.first_c, terms.second_c, kept, chosen, limit[chosen], found.limit.doubtful_c[chosen]
    )


class FrictionalRelaxation(NamedTuple):
    """The (s, s) stiffness that relaxation takes from the strains, what the system is like, and (x, s) motions."""

    relief_ee: NDArray[np.float64]
    negative: int
    floppy: int
    residual: float
    motion_xe: NDArray[np.float64]


def _factored(matrix: Any) -> Any:
    """Return the LU factors of a matrix whose pattern is symmetric, with pivots on the diagonal where these will do."""
    symmetric = {"SymmetricMode": True}
    return spla.splu(sp.csc_array(matrix), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.01, options=symmetric)


def relax_frictional(system: FrictionalSystem, count_n: NDArray[np.int64], push: float) -> FrictionalRelaxation:
    """Return how displacements and rotations relax, with the best connected particle at its place.

    Negative and zero eigenvalues are those of the symmetric part: motions whose second-order work is negative or none.
    """
    d, size, strains = system.dimension, system.matrix.shape[0], len(system.corner_ee)
    if not size:
        return FrictionalRelaxation(np.zeros((strains, strains)), 0, 0, 0.0, np.zeros((0, strains)))
    moving = np.ones(size, dtype=bool)
    held = int(np.argmax(count_n))
    moving[held * d : (held + 1) * d] = False
    matrix = sp.csr_array(system.matrix[moving][:, moving])
    right = -system.column_xe[moving]
    even = sp.csr_array(matrix + matrix.T) / 2.0
    shift = sp.diags_array(soft_shift(even))
    negative = factorize(even + shift, kind="symmetric").inertia.negative
    floppy = factorize(even - shift, kind="symmetric").inertia.negative - negative
    solve = None
    if system.symmetric and not floppy:
        try:
            solve = factorize(even, kind="symmetric").solve
        except NotDefinite:
            floppy = 1
    if solve is None:
        # zero modes, which the symmetric part does not show where contacts slide or carry tangential forces, do not
        # stand in the way of a shifted factorization; refinement takes the shift back
        solve = _factored(matrix + shift).solve
    solution = np.asarray(solve(right))
    rest = right - matrix @ solution
    reached = float(np.abs(rest).max())
    for _ in range(_REFINEMENTS):
        better = solution + solve(rest)
        left = right - matrix @ better
        error = float(np.abs(left).max())
        if not error < 0.5 * reached:
            break
        solution, rest, reached = better, left, error
    relief = -system.row_ex[:, moving] @ solution
    motion = np.zeros((size, strains))
    motion[moving] = solution
    return FrictionalRelaxation(relief, negative, floppy, reached / push if push else 0.0, motion)


class SlidingResponse(NamedTuple):
    """A system with the contacts that slide in it, how it relaxes, and whether that set agrees with the motion."""

    system: FrictionalSystem
    relaxation: FrictionalRelaxation
    sliding_c: NDArray[np.bool_]
    consistent: bool


def find_sliding(
    network: FrictionalNetwork, kind: str, strain_e: NDArray[np.float64], count_n: NDArray[np.int64], push: float
) -> SlidingResponse:
    """Return the response to a strain in which just those contacts at the limit slide that it loads.

    Sets are tried from all that stick on: every contact at the limit changes over that disagrees with the motion, and
    where that goes round in circles the first of them alone (Murty's rule for linear complementarity problems).

    Parameters
    ----------
    network
        The network.
    kind
        As in `stiffness_matrix`.
    strain_e
        (s,) Mandel strain; its size is of no matter, its sign is.
    count_n, push
        As in `relax_frictional`.

    """
    sliding, seen = np.zeros(len(network.at_limit_c), dtype=bool), set[bytes]()
    numbers = np.flatnonzero(network.at_limit_c)
    for _ in range(_SETS):
        system = frictional_system(network.forces, network.first_c, network.second_c, kind, sliding, network.kept_n)
        relaxation = relax_frictional(system, count_n, push)
        beyond = (system.beyond_cx @ relaxation.motion_xe + system.beyond_ce) @ strain_e
        wrong = numbers[(beyond[numbers] > 0.0) != sliding[numbers]]
        if not len(wrong):
            return SlidingResponse(system, relaxation, sliding, True)
        sliding = sliding.copy()
        changed = wrong if sliding.tobytes() not in seen else wrong[:1]
        seen.add(sliding.tobytes())
        sliding[changed] ^= True
    return SlidingResponse(system, relaxation, sliding, False)


@honors("repulsion friction", at_rest=True, shaped="pm.hessian")
def stiffness_matrix(
    scene: Scene,
    strain: str = "free",
    kind: str = "exact",
    *,
    contacts_at_limit: str = "stick",
    strain_scale: float | None = 1.0,
) -> sp.csr_array:
    """Return minus the derivative of forces and torques by displacements and rotations, and by strains.

    (N (d + k) + s, N (d + k) + s), or without strain (N (d + k), N (d + k)), with k = 1 rotation of a particle in the
    plane and 3 in space. Rows are forces on positions, particle-major, then torques on particles, then Mandel stresses
    times the volume as in `hessian`; tangential springs grow by the slip and turn with their contacts, as in the
    engine. It is symmetric where no contact carries a tangential force and none slides. Without friction, or with a
    coefficient of 0, its part for positions and strains is `hessian`.

    Parameters
    ----------
    scene
        The scene, without links.
    strain
        "none", or "free": with all strains appended.
    kind
        "exact", or "unstressed": as if no contact carried a force.
    contacts_at_limit
        "stick": contacts at the Coulomb limit are springs like the others, as in motions that unload them all. "slip":
        their tangential force follows the coefficient times the change of the normal force, as in motions that load
        them all. Most motions do neither: some contacts stick and some slip, which `elastic_moduli` finds for a given
        strain. With less and less friction moduli go over to those without it smoothly if contacts slip only (Henkes,
        van Hecke and van Saarloos, EPL 90, 14003 (2010)).
    strain_scale
        As in `hessian`.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind, a name is unknown, or the scene holds what would be ignored.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.01)
    >>> rough = pm.Scene(packing, (pm.Repulsion(), pm.Friction(0.5, stiffness=1.0)))
    >>> matrix = pm.stiffness_matrix(rough)
    >>> matrix.shape, bool(abs(matrix - matrix.T).max() < 1e-12)
    ((30, 30), True)

    """
    instance("scene", scene, Scene)
    check_frictional(scene, kind, contacts_at_limit)
    one_of("strain", strain, STRAINS)
    if strain not in ("none", "free"):
        raise ValueError(f"strain must be 'none' or 'free' for pm.stiffness_matrix, got {strain!r}")
    network = frictional_network(scene, "keep")
    sliding = network.sliding(contacts_at_limit)
    system = frictional_system(network.forces, network.first_c, network.second_c, kind, sliding)
    if strain == "none":
        return system.matrix
    scale = scale_of_strain(scene.packing, strain_scale)
    side, below = sp.csr_array(system.column_xe / scale), sp.csr_array(system.row_ex / scale)
    corner = sp.csr_array(system.corner_ee / scale**2)
    return sp.csr_array(sp.block_array([[system.matrix, side], [below, corner]], format="csr"))


@dataclass(frozen=True, eq=False)
class FrictionalModes:
    """Modes of a frictional packing, its particles turning too, in order of the eigenvalues' real parts.

    Attributes
    ----------
    eigenvalue_m
        (M,) complex squared frequencies [1/time^2], uniform translations left out. Complex ones come in pairs, whose
        motions without damping grow while they oscillate.
    displacement_mnd, rotation_mnk
        (M, N, d) displacements and (M, N, 1 or 3) rotations, complex, zero for particles that were left out; the sum of
        mass * |u|^2 + inertia * |rotation|^2 is 1 for each mode.
    residual
        Largest |D q - eigenvalue q| of a mode over a bound on the largest eigenvalue [1].
    available
        Number of modes that the packing has besides translations; M of them are here.
    symmetric
        Whether the stiffness matrix is symmetric but for rounding, so that all eigenvalues are real.
    largest
        Bound on the size of the largest eigenvalue, by column sums [1/time^2].
    force_residual
        Largest net force on a particle over the mean contact force, or torque over the radius, rattlers included [1]:
        when this is not small, the packing is not at rest, and these are no normal modes.
    index_n
        (N',) particles that took part.
    method
        "dense" or "shift-invert".
    seconds
        CPU time.

    """

    eigenvalue_m: NDArray[np.complex128]
    displacement_mnd: NDArray[np.complex128]
    rotation_mnk: NDArray[np.complex128]
    residual: float
    available: int
    symmetric: bool
    largest: float
    force_residual: float
    index_n: NDArray[np.int64]
    method: str
    seconds: float

    def __len__(self) -> int:
        return len(self.eigenvalue_m)

    @property
    def frequency_m(self) -> NDArray[np.complex128]:
        """The (M,) angular frequencies, roots of the eigenvalues: motions go as exp(i frequency time) [1/time]."""
        return np.asarray(np.sqrt(self.eigenvalue_m))

    @property
    def growth_m(self) -> NDArray[np.float64]:
        """The (M,) rates at which undamped motions along the modes grow [1/time]; 0 for real positive eigenvalues."""
        return np.asarray(np.abs(self.frequency_m.imag) * ~self.zero_m)

    @property
    def zero_m(self) -> NDArray[np.bool_]:
        """Which modes are zero to rounding: size of the eigenvalue below 1e-10 of the largest."""
        return np.asarray(np.abs(self.eigenvalue_m) <= _ZERO * self.largest)


@honors("repulsion friction", at_rest=True, shaped="pm.normal_modes")
def frictional_modes(
    scene: Scene,
    count: int | None = None,
    *,
    kind: str = "exact",
    contacts_at_limit: str = "stick",
    rattlers: str = "remove",
    method: str = "auto",
) -> FrictionalModes:
    """Return the modes of a frictional packing in its box: those nearest to zero, or all of them.

    They are solutions of stiffness q = eigenvalue * inertia q, with `stiffness_matrix` and the particles' masses and
    moments of inertia, m r^2 / 2 in the plane and 2 m r^2 / 5 in space. Spheres that two contacts hold can turn about
    the chord between these: a mode near zero each.

    Parameters
    ----------
    scene
        The scene; its packing should be at rest.
    count
        How many modes, counted from zero by the size of the eigenvalue and without the d translations; None for all. A
        packing with fewer gives those it has.
    kind, contacts_at_limit
        As in `stiffness_matrix`.
    rattlers
        "remove" leaves those of `contact_forces` out; "keep" adds their zero modes.
    method
        "dense" diagonalization, "shift-invert" (Arnoldi's method, Lanczos's where the matrix is symmetric, on the
        factored matrix, started from a fixed vector), or "auto": dense for up to 600 rows, for all modes, or for more
        than a quarter of them. Without friction each rotation is a zero mode.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind, a name is unknown, or all modes of more than 3000 coordinates are asked
        for.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.lattice_packing("square", repeats=(2, 2), relative_overlap=0.01).replace(mass_n=[1.0] * 4)
    >>> modes = pm.frictional_modes(pm.Scene(packing, (pm.Repulsion(), pm.Friction(0.5, stiffness=1.0))))
    >>> len(modes), modes.symmetric, int(modes.zero_m.sum()), float(modes.growth_m.max())
    (10, True, 1, 0.0)

    Neighbors of a square lattice turn against each other like gears, which costs nothing.

    """
    start = time.process_time()
    instance("scene", scene, Scene)
    check_frictional(scene, kind, contacts_at_limit)
    one_of("method", method, ("auto", "dense", "shift-invert"))
    wanted = None if count is None else integer("count", count, at_least=1)
    packing = scene.packing
    d, k = packing.dimension, 1 if packing.dimension == 2 else 3
    network = frictional_network(scene, rattlers)
    index = np.flatnonzero(network.kept_n)
    mass, radius = packing.mass_n[index], packing.radius_n[index]
    inertia = (0.5 if d == 2 else 0.4) * mass * radius**2
    root = np.sqrt(np.concatenate([np.repeat(mass, d), np.repeat(inertia, k)]))
    with single_thread():
        system = frictional_system(
            network.forces, network.first_c, network.second_c, kind, network.sliding(contacts_at_limit), network.kept_n
        )
        matrix = sp.csr_array(system.matrix.multiply(1.0 / root[:, None]).multiply(1.0 / root[None, :]))
        shift = np.zeros((len(root), d))
        for a in range(d):
            shift[a : len(index) * d : d, a] = np.sqrt(mass)
        shift /= np.sqrt(mass.sum()) if len(index) else 1.0
        available = max(len(root) - d, 0)
        wanted = available if wanted is None else min(wanted, available)
        largest = float(abs(matrix).sum(axis=0).max()) if len(root) else 0.0
        small = len(root) <= _DENSE_ROWS or count is None or wanted > len(root) // 4
        # Arnoldi's method needs room beyond the modes that it finds
        dense = method == "dense" or (method == "auto" and small) or wanted > len(root) - d - 4
        if dense and len(root) > _DENSE_LIMIT:
            raise ValueError(
                f"count must be given, and small, for more than {_DENSE_LIMIT} coordinates, got {count} of {len(root)}"
            )
        value, vector = (_dense_modes if dense else _modes_near_zero)(matrix, shift, largest, wanted, system.symmetric)
        error = matrix @ vector - vector * value
    worst = float(np.sqrt((np.abs(error) ** 2).sum(axis=0)).max(initial=0.0))
    vector = vector / root[:, None]
    motion = np.zeros((len(value), packing.particles, d), dtype=complex)
    rotation = np.zeros((len(value), packing.particles, k), dtype=complex)
    motion[:, index] = vector[: len(index) * d].T.reshape(len(value), len(index), d)
    rotation[:, index] = vector[len(index) * d :].T.reshape(len(value), len(index), k)
    return FrictionalModes(
        eigenvalue_m=value,
        displacement_mnd=motion,
        rotation_mnk=rotation,
        residual=worst / largest if largest else 0.0,
        available=available,
        symmetric=system.symmetric,
        largest=largest,
        force_residual=contact_forces(scene).residual,
        index_n=index,
        method="dense" if dense else "shift-invert",
        seconds=time.process_time() - start,
    )


def _sorted_modes(
    value: NDArray[Any], vector: NDArray[Any], wanted: int
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return the modes nearest to zero, both of a complex pair, by their real parts; of size 1."""
    nearest = np.argsort(np.abs(value), kind="stable")[:wanted]
    # both of a pair are equally near to zero, and so stand together
    last = value[nearest[-1]] if wanted else 0.0
    if wanted < len(value) and np.imag(last) and not np.isclose(value[nearest], np.conj(last)).any():
        nearest = np.argsort(np.abs(value), kind="stable")[: wanted + 1]
    order = nearest[np.lexsort((np.imag(value[nearest]), np.real(value[nearest])))]
    kept = vector[:, order].astype(complex)
    return value[order].astype(complex), kept / np.sqrt((np.abs(kept) ** 2).sum(axis=0))


def _dense_modes(
    matrix: sp.csr_array, shift_xd: NDArray[np.float64], largest: float, wanted: int, symmetric: bool
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return modes by diagonalization of the matrix across the translations."""
    rows, d = shift_xd.shape
    if not wanted:
        return np.zeros(0, dtype=complex), np.zeros((rows, 0), dtype=complex)
    across = np.linalg.qr(shift_xd, mode="complete")[0][:, d:]
    inside = across.T @ (matrix @ across)
    value, vector = np.linalg.eigh((inside + inside.T) / 2.0) if symmetric else np.linalg.eig(inside)
    return _sorted_modes(value, across @ vector, wanted)


def _modes_near_zero(
    matrix: sp.csr_array, shift_xd: NDArray[np.float64], largest: float, wanted: int, symmetric: bool
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return modes by Arnoldi's method on the factored matrix, across the translations."""
    rows = len(shift_xd)
    sigma = -_NEAR * (largest or 1.0)
    factor = _factored(matrix - sigma * sp.eye_array(rows))

    def across(vector: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(vector - shift_xd @ (shift_xd.T @ vector))

    inverse = spla.LinearOperator(
        (rows, rows), matvec=lambda v: across(factor.solve(across(v.ravel()))), dtype=np.float64
    )
    begin = across(np.random.default_rng(0).normal(size=rows))
    # some in reserve, so that a pair is whole
    count = min(wanted + 2, rows - 2)
    solver = spla.eigsh if symmetric else spla.eigs
    value, vector = solver(inverse, k=count, v0=begin, ncv=min(rows, max(2 * count + 1, count + 40)), which="LM")
    return _sorted_modes(sigma + 1.0 / value, vector, wanted)
