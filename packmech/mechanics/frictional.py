"""Linear response of frictional packings: forces and torques against displacements, rotations and strains.

Forces with friction have no energy. What stands in for the Hessian is minus the derivative of the generalized forces,
with the tangential springs carried along as the engine carries them (`packmech.contacts.tangential_elements`).

A contact at the Coulomb limit sticks where the motion unloads it, k T.ds/|T| < mu dN, and slides where it does not, and
so do springs against rolling and twisting at their own limits. The response is linear only among motions that unload
the same springs: each direction of strain has a set of sliding ones that agrees with the motion it leads to
(`find_sliding`).
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

from packmech.calls.display import shown
from packmech.calls.honors import honors
from packmech.calls.status import shown_as
from packmech.check import AT_LIMIT, STRAINS, BoxStrain, Kind, brief, instance, integer, one_of
from packmech.constraints.jacobian import scale_of_strain
from packmech.contacts.coulomb_limit import find_at_limit
from packmech.contacts.elements import pair_rows
from packmech.contacts.tangential_elements import tangential_elements
from packmech.contacts.turning_elements import TurningLimits
from packmech.contacts.wall_elements import WallSprings
from packmech.effects import (
    ContactTerms,
    acts_on_single,
    at_contact,
    friction_or_zero,
    needs_second,
    rolling_spring_of,
    twisting_of,
    wall_sides,
)
from packmech.jit.blas import single_thread
from packmech.linalg.mandel import mandel_basis
from packmech.measure.contact_forces import ContactForces, resting_forces, unless_at_rest
from packmech.measure.friction import particles_at_walls, wall_springs
from packmech.mechanics.hessian import check_strain_of_box
from packmech.mechanics.linked_systems import free_translations, rows_on
from packmech.mechanics.modes import lowest_in_words
from packmech.mechanics.network import Network, network_among
from packmech.mechanics.relaxation import RelaxedStrains, general_factors, is_symmetric, relax
from packmech.mechanics.system import System, across_bonds, assembled_system, closed_terms, turning_springs
from packmech.packing import Packing
from packmech.scene import Scene

# kinds of stiffness
_KINDS: tuple[Kind, ...] = ("exact", "unstressed")
# sets of sliding contacts that are tried for one strain
_SETS = 200
# eigenvalues below this fraction of the largest are zero; Arnoldi's method looks this far below zero
_ZERO, _NEAR = 1e-10, 1e-6
_DENSE_ROWS, _DENSE_LIMIT = 600, 3000


def check_frictional(kind: Kind, contacts_at_limit: str = "stick", gap_tolerance: float | None = None) -> None:
    """Check what calls of frictional packings are given."""
    one_of("kind", kind, _KINDS)
    one_of("contacts_at_limit", contacts_at_limit, AT_LIMIT)
    if gap_tolerance is not None:
        raise ValueError(
            f"gap_tolerance must be None for a scene with friction, whose contacts are overlaps, got {gap_tolerance}"
        )


class RoughTouches(NamedTuple):
    """Touches of all particles with walls: which particles, their springs, and which are at the Coulomb limit."""

    particle_w: NDArray[np.int64]
    springs: WallSprings
    at_limit_w: NDArray[np.bool_]

    def second(self, packing: Packing, kind: Kind, contacts_at_limit: str) -> NDArray[np.float64] | None:
        """Return the (N, X, X) derivatives of what walls do across by displacements and rotations; None of smooth ones.

        Those at the limit all stick, or all slip.
        """
        if not self.springs.stiffness_w3.any():
            return None
        whole = self.springs.second(self.at_limit_w & (contacts_at_limit == "slip"), kind)
        found = np.zeros((packing.particles, *whole.shape[1:]))
        np.add.at(found, self.particle_w, whole)
        return found


def rough_touches(scene: Scene, residual: float) -> RoughTouches:
    """Return what touches the walls of a scene of discs or spheres, with forces known to a part of the mean one."""
    packing = scene.packing
    sides = [] if packing.shapes.has_orientations else wall_sides(scene.effects, packing)
    springs = wall_springs(packing, sides)
    size = np.sqrt((springs.force_wd**2).sum(axis=1))
    limit = find_at_limit(size, springs.push_w, springs.coefficient_w, residual)
    return RoughTouches(particles_at_walls(sides), springs, limit.at_limit_c & (size > 0.0))


class FrictionalNetwork(NamedTuple):
    """The contacts that hold a frictional packing, derivatives of their energies, and who took part.

    at_limit_sc are their springs at the limit: of friction, against rolling, and against twisting, (3, C). doubtful_c
    are contacts of which that is doubtful for one of them.
    """

    network: Network
    forces: ContactForces
    terms: ContactTerms
    chosen_c: NDArray[np.int64]
    at_limit_sc: NDArray[np.bool_]
    doubtful_c: NDArray[np.bool_]
    walls: RoughTouches

    def sliding(self, contacts_at_limit: str) -> NDArray[np.bool_]:
        """Return the (3, C) springs that slide where those at the limit all stick, or all slip."""
        return self.at_limit_sc & (contacts_at_limit == "slip")


def springs_at_limit(found: ContactForces) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Return the (3, C) springs at their limits: of friction, rolling, twisting; and (C,) where one is doubtful."""
    # a spring without a force has no direction to slide in
    borne = found.tangential_cd.any(axis=1), found.turning.rolling_cd.any(axis=1), found.turning.twisting_c != 0.0
    limits = (found.limit, *found.turning_limits)
    at_limit = np.stack([one.at_limit_c & there for one, there in zip(limits, borne, strict=True)])
    return at_limit, np.any([one.doubtful_c for one in limits], axis=0)


def frictional_network(scene: Scene, rattlers: str) -> FrictionalNetwork:
    """Return the touching pairs of a scene with friction, those of rattlers left out unless these are to be kept."""
    one_of("rattlers", rattlers, ("remove", "keep"))
    if acts_on_single(scene.effects):
        needs_second(scene.effects, "second derivatives")
    found = resting_forces(scene, second=True)
    kept = ~found.rattlers_n if rattlers == "remove" else np.ones(scene.packing.particles, dtype=bool)
    chosen = np.flatnonzero(kept[found.contacts.i_c] & kept[found.contacts.j_c])
    contacts = found.contacts.select(chosen)
    forces = ContactForces(scene, contacts, found.normal_c[chosen], found.tangential_cd[chosen])
    at_limit, doubtful = springs_at_limit(found)
    network = network_among(scene.packing, contacts, kept, scene.effects, scene.packing.spin_nkk)
    return FrictionalNetwork(
        network,
        forces,
        closed_terms(scene, contacts),
        chosen,
        at_limit[:, chosen],
        doubtful[chosen],
        rough_touches(scene, found.residual),
    )


def frictional_system(
    scene: Scene,
    found: FrictionalNetwork,
    kind: Kind,
    sliding_sc: NDArray[np.bool_],
    contacts_at_limit: str = "stick",
) -> tuple[System, NDArray[np.float64]]:
    """Return minus the derivatives of forces, torques and stress, and (3, C, X) ones of what passes limits.

    Contacts slide as they are given, those with walls as `contacts_at_limit` says.
    """
    network, terms, friction = found.network, found.terms, friction_or_zero(scene.effects)
    friction = at_contact(friction, terms.second_c * network.contacts.push_c**2, 0.0, network.contacts.kinds_c)
    contacts, beyond = tangential_elements(
        network.contacts,
        network.packing.radius_n,
        terms.first_c,
        terms.second_c,
        found.forces.tangential_cd,
        friction.stiffness,
        friction.coefficient,
        sliding_sc[0],
        kind,
    )
    resisting = rolling_spring_of(scene.effects), twisting_of(scene.effects)
    growth = np.sign(terms.first_c) * terms.second_c
    slopes = np.stack([(0.0 if one is None else one.coefficient) * growth for one in resisting])
    limits = TurningLimits(sliding_sc[1:], slopes)
    turning, turned = turning_springs(
        scene.effects, network.contacts, network.packing, found.forces.turning, kind, limits=limits
    )
    surfaces = (contacts, *turning, *across_bonds(scene.effects, network))
    past = np.zeros((3, *beyond.shape))
    past[0] = beyond
    if turned is not None:
        past[1:] = turned
    walls = found.walls.second(scene.packing, kind, contacts_at_limit)
    return assembled_system(scene, network, kind, surfaces=surfaces, walls_nxx=walls), past


class SlidingResponse(NamedTuple):
    """A system with the springs that slide in it, how it relaxes, and whether that set agrees with the motion."""

    system: System
    relaxation: RelaxedStrains
    sliding_sc: NDArray[np.bool_]
    consistent: bool


def find_sliding(scene: Scene, found: FrictionalNetwork, kind: Kind, strain_e: NDArray[np.float64]) -> SlidingResponse:
    """Return the response to a strain in which just those springs at the limit slide that it loads.

    Sets are tried from all that stick on: every spring at the limit changes over that disagrees with the motion, and
    where that goes round in circles the first of them alone (Murty's rule for linear complementarity problems).

    Parameters
    ----------
    scene, found
        The scene and its contacts.
    kind
        As in `stiffness_matrix`.
    strain_e
        (s,) Mandel strain; its size is of no matter, its sign is.

    """
    sliding, seen = np.zeros(found.at_limit_sc.shape, dtype=bool), set[bytes]()
    numbers = np.flatnonzero(found.at_limit_sc)
    network, d = found.network, found.network.dimension
    for _ in range(_SETS):
        system, beyond = frictional_system(scene, found, kind, sliding)
        relaxation = relax(system)
        one = system.elements[0]
        i, j = (np.tile(each, len(beyond)) for each in (one.i_c, one.j_c))
        rows = pair_rows(i, j, beyond.reshape(-1, beyond.shape[2]), network.turn_nkt, d)
        strained = np.einsum("sca,mab,cb->scm", beyond[:, :, :d], mandel_basis(d), one.vector_cd)
        past = (rows @ relaxation.motion_xe + strained.reshape(rows.shape[0], -1)) @ strain_e
        wrong = numbers[(past[numbers] > 0.0) != sliding.ravel()[numbers]]
        if not len(wrong):
            return SlidingResponse(system, relaxation, sliding, True)
        sliding = sliding.copy()
        changed = wrong if sliding.tobytes() not in seen else wrong[:1]
        seen.add(sliding.tobytes())
        sliding.ravel()[changed] ^= True
    return SlidingResponse(system, relaxation, sliding, False)


@honors("repulsion kinds friction rolling bonds interactions gravity walls held links shapes rough mesh", at_rest=True)
def stiffness_matrix(
    scene: Scene,
    strain: BoxStrain = "free",
    kind: Kind = "exact",
    *,
    contacts_at_limit: str = "stick",
    strain_scale: float | None = 1.0,
) -> sp.csr_array:
    """Return minus the derivative of forces and torques by displacements and rotations, and by strains.

    (N (d + k) + s, N (d + k) + s), or without strain (N (d + k), N (d + k)), with k = 1 rotation of a particle in the
    plane and 3 in space, in the coordinates of `hessian`: particle by particle its position and then its rotations,
    angles times the radius of gyration, so that all are lengths; then the Mandel strains, whose rows are stresses times
    the volume. Tangential springs grow by the slip and turn with their contacts, as in the engine. It is symmetric
    where no contact carries a tangential force and none slides. Without friction, or with a coefficient of 0, its part
    for positions and strains is `hessian` where discs and spheres are not linked. Rotations are about the principal
    axes of the particles. Links, which are constraints, add what their forces do as they turn; bonds and interactions
    beyond contact act as springs. Walls and surfaces, rough ones too, and other potentials of single particles add to
    the blocks on the diagonal; rows and columns of what is held are zero, and none of these follows a strain of the
    box.

    Parameters
    ----------
    scene
        The scene.
    strain
        "none", or "free": with all strains appended.
    kind
        "exact", or "unstressed": as if no contact carried a force.
    contacts_at_limit
        "stick": contacts at the Coulomb limit are springs like the others, as in motions that unload them all. "slip":
        their tangential force follows the coefficient times the change of the normal force, as in motions that load
        them all. Most motions do neither: some contacts stick and some slip, which `elastic_moduli` finds for a given
        strain. With less and less friction moduli go over to those without it smoothly if contacts slip only (Henkes,
        van Hecke and van Saarloos, EPL 90, 14003 (2010)). Springs against rolling and twisting at their
        limits do the same at contacts between particles; at walls they stick.
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
    check_frictional(kind, contacts_at_limit)
    one_of("strain", strain, STRAINS)
    if strain not in ("none", "free"):
        raise ValueError(f"strain must be 'none' or 'free' for pm.stiffness_matrix, got {brief(strain)}")
    check_strain_of_box(scene, strain)
    found = frictional_network(scene, "keep")
    system, _ = frictional_system(scene, found, kind, found.sliding(contacts_at_limit), contacts_at_limit)
    everything = np.ones(system.network.free_f.size, dtype=bool)
    matrix = system.whole_matrix()
    if strain == "none":
        return matrix
    scale = scale_of_strain(scene.packing, strain_scale)
    side, below = sp.csr_array(system.column(everything) / scale), sp.csr_array(system.row(everything) / scale)
    corner = sp.csr_array(system.corner / scale**2)
    return sp.csr_array(sp.block_array([[matrix, side], [below, corner]], format="csr"))


@shown(lambda one: unless_at_rest(one.force_residual, one.at_rest, lowest_in_words(len(one), one.frequency_m)))
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
    at_rest
        Whether `force_residual` is at most a hundredth, or no more than rounding of the coordinates makes of it.

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
    at_rest: bool = True

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


@shown_as("frictional modes")
@honors("repulsion kinds friction rolling bonds interactions gravity walls held links shapes rough mesh", at_rest=True)
def frictional_modes(
    scene: Scene,
    count: int | None = None,
    *,
    kind: Kind = "exact",
    contacts_at_limit: str = "stick",
    rattlers: str = "remove",
    method: str = "auto",
) -> FrictionalModes:
    """Return the modes of a frictional packing in its box: those nearest to zero, or all of them.

    They are solutions of stiffness q = eigenvalue * inertia q, with `stiffness_matrix` and the particles' masses and
    moments of inertia, m r^2 / 2 in the plane and 2 m r^2 / 5 in space. What is held stays. Uniform translations that
    cost nothing are left out, d of them, fewer beside walls or what is held. Spheres that two contacts hold can turn
    about the chord between these, a mode near zero each, where nothing resists rolling or twisting.

    Parameters
    ----------
    scene
        The scene; its packing should be at rest. Links keep their lengths.
    count
        How many modes, counted from zero by the size of the eigenvalue and without uniform translations; None for all.
        A packing with fewer gives those it has.
    kind, contacts_at_limit
        As in `stiffness_matrix`.
    rattlers
        "remove" leaves those of `contact_forces` out; "keep" adds their zero modes.
    method
        "dense" diagonalization, "shift-invert" (Arnoldi's method, Lanczos's where the matrix is symmetric, on the
        factored matrix, started from a fixed vector), or "auto": dense for up to 600 rows, for all modes, or for more
        than a quarter of them. Without friction, and resistance to rolling, each rotation is a zero
        mode.

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
    check_frictional(kind, contacts_at_limit)
    one_of("method", method, ("auto", "dense", "shift-invert"))
    wanted = None if count is None else integer("count", count, at_least=1)
    packing = scene.packing
    d, k = packing.dimension, 1 if packing.dimension == 2 else 3
    found = frictional_network(scene, rattlers)
    network, index, free = found.network, found.network.index_n, found.network.free_f
    root = np.repeat(np.sqrt(packing.mass_n[index]), d + k)[free]
    with single_thread():
        system, _ = frictional_system(scene, found, kind, found.sliding(contacts_at_limit), contacts_at_limit)
        matrix = sp.csr_array(system.matrix().multiply(1.0 / root[:, None]).multiply(1.0 / root[None, :]))
        symmetric = is_symmetric(matrix)
        rows, axis = _link_rows(network, root), np.nonzero(network.free_nq)[1]
        shift = free_translations(matrix, rows, root, axis, d, network.anchored)
        available = max(len(root) - shift.shape[1] - rows.shape[0], 0)
        wanted = available if wanted is None else min(wanted, available)
        largest = float(abs(matrix).sum(axis=0).max()) if len(root) else 0.0
        small = len(root) <= _DENSE_ROWS or count is None or wanted > len(root) // 4
        # Arnoldi's method needs room beyond the modes that it finds
        dense = method == "dense" or (method == "auto" and small) or wanted > available - 4
        if dense and len(root) > _DENSE_LIMIT:
            raise ValueError(
                f"count must be given, and small, for more than {_DENSE_LIMIT} coordinates, got {count} of {len(root)}"
            )
        value, vector = (_dense_modes if dense else _modes_near_zero)(matrix, shift, rows, largest, wanted, symmetric)
        error = matrix @ vector - vector * value
        if rows.shape[0]:
            # links bear what would stretch them
            solve, left = general_factors(rows @ rows.T).solve, rows @ error
            error -= rows.T @ (solve(left.real) + 1j * solve(left.imag))
    whole = resting_forces(scene)
    whole.warn_of_rattlers(packing.particles - len(index))
    worst = float(np.sqrt((np.abs(error) ** 2).sum(axis=0)).max(initial=0.0))
    whole_mf = np.zeros((len(value), len(free)), dtype=complex)
    whole_mf[:, free] = (vector / root[:, None]).T
    vector = whole_mf.reshape(len(value), len(index), d + k)
    motion = np.zeros((len(value), packing.particles, d), dtype=complex)
    rotation = np.zeros((len(value), packing.particles, k), dtype=complex)
    motion[:, index] = vector[..., :d]
    rotation[:, index] = np.einsum("mnk,nkt->mnt", vector[..., d:], network.turn_nkt)
    return FrictionalModes(
        eigenvalue_m=value,
        displacement_mnd=motion,
        rotation_mnk=rotation,
        residual=worst / largest if largest else 0.0,
        available=available,
        symmetric=symmetric,
        largest=largest,
        force_residual=whole.residual,
        index_n=index,
        method="dense" if dense else "shift-invert",
        seconds=time.process_time() - start,
        at_rest=whole.at_rest,
    )


def _link_rows(network: Network, root_f: NDArray[np.float64]) -> sp.csr_array:
    """Return independent rows that vanish on what keeps the links, by the free coordinates times roots of masses."""
    d, free = network.dimension, network.free_nq
    place = np.zeros(free.shape, dtype=bool)
    place[:, :d] = True
    place_f = place[free]
    unstrained = np.zeros((d * (d + 1) // 2, 0))
    rows = rows_on(network.links, free[:, :d].ravel(), 1.0 / root_f[place_f], unstrained, 1.0)
    column = np.flatnonzero(place_f)[rows.indices]
    return sp.csr_array((rows.data, column, rows.indptr), shape=(rows.shape[0], len(root_f)))


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
    matrix: sp.csr_array,
    shift_xd: NDArray[np.float64],
    links: sp.csr_array,
    largest: float,
    wanted: int,
    symmetric: bool,
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return modes by diagonalization of the matrix across the translations and what stretches links."""
    if not wanted:
        return np.zeros(0, dtype=complex), np.zeros((len(shift_xd), 0), dtype=complex)
    forbidden = np.hstack([shift_xd, links.T.toarray()])
    across = np.linalg.qr(forbidden, mode="complete")[0][:, forbidden.shape[1] :]
    inside = across.T @ (matrix @ across)
    value, vector = np.linalg.eigh((inside + inside.T) / 2.0) if symmetric else np.linalg.eig(inside)
    return _sorted_modes(value, across @ vector, wanted)


def _modes_near_zero(
    matrix: sp.csr_array,
    shift_xd: NDArray[np.float64],
    links: sp.csr_array,
    largest: float,
    wanted: int,
    symmetric: bool,
) -> tuple[NDArray[np.complex128], NDArray[np.complex128]]:
    """Return modes by Arnoldi's method on the factored matrix, across the translations and what stretches links."""
    rows = len(shift_xd)
    sigma = -_NEAR * (largest or 1.0)
    shifted = matrix - sigma * sp.eye_array(rows)
    if links.shape[0]:
        # the forces of links are further unknowns
        side = largest * links
        factor = spla.splu(sp.csc_array(sp.block_array([[shifted, side.T], [side, None]])))
    else:
        factor = general_factors(shifted)
    forces = np.zeros(links.shape[0])

    def across(vector: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(vector - shift_xd @ (shift_xd.T @ vector))

    inverse = spla.LinearOperator(
        (rows, rows), matvec=lambda v: across(factor.solve(np.append(across(v.ravel()), forces))[:rows]), dtype=float
    )
    begin = inverse.matvec(np.random.default_rng(0).normal(size=rows))
    # some in reserve, so that a pair is whole
    count = min(wanted + 2, rows - links.shape[0] - 2)
    solver = spla.eigsh if symmetric else spla.eigs
    value, vector = solver(inverse, k=count, v0=begin, ncv=min(rows, max(2 * count + 1, count + 40)), which="LM")
    return _sorted_modes(sigma + 1.0 / value, vector, wanted)
