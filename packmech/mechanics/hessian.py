"""Second derivatives of a scene's energy with respect to positions, turns and strains, and whether it has a minimum.

They are those of the scene's elements, assembled (`packmech.mechanics.assembly`): with n the normal of a contact of
discs, rho its distance, u' and u'' the derivatives of its energy, and strains as v -> (1 + strain) v,

    positions           h = u'' n n + (u' / rho)(1 - n n)             +h at (i,i) and (j,j), -h at (i,j) and (j,i)
    position, strain    (u'' rho - u') n (n.E.n) + 2 u' E n           + at j, - at i
    strain, strain      rho (rho u'' - u')(n.E.n)(n.F.n) + rho u' (E n).(F n)
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from packmech.calls.honors import STRAINED, honors
from packmech.calls.status import shown_as
from packmech.check import KINDS, STRAINS, BoxStrain, Kind, finite_array, instance, one_of, positive
from packmech.constraints.basis import MEMORY_LIMIT, check_memory, motion_basis
from packmech.constraints.factor import ConstraintFactor
from packmech.constraints.jacobian import scale_of_strain
from packmech.effects import acts_on_single, held_particles
from packmech.linalg.mandel import isochoric_basis, mandel_vector, strain_directions
from packmech.mechanics.linked_systems import (
    link_motions,
    linked_system,
    negative_motions,
    rows_on,
    soft_shift,
)
from packmech.mechanics.system import System, bordered, system_of
from packmech.mechanics.wave_matrices import WaveStiffness, wave_fractions
from packmech.scene import Scene

CURVATURES = ("det", "trace")


def corner_of(system: System, kind: Kind, strain: BoxStrain, volume_curvature: str) -> NDArray[np.float64]:
    """Return the (s, s) derivatives by strains, with the curvature of a volume that is held."""
    held = kind == "exact" and strain == "isochoric" and volume_curvature == "det"
    return system.corner + system.volume_curvature if held else system.corner


def check_choices(kind: Kind, strain: BoxStrain, volume_curvature: str) -> None:
    """Check the names of a kind of Hessian, of what the box may do, and of the curvature of its volume."""
    one_of("kind", kind, KINDS)
    one_of("strain", strain, STRAINS)
    one_of("volume_curvature", volume_curvature, CURVATURES)


def check_strain_of_box(scene: Scene, strain: BoxStrain) -> None:
    """Refuse strains of the box where walls, weights or held particles do not follow it."""
    if strain != "none" and acts_on_single(scene.effects):
        raise ValueError(
            "strain must be 'none' where walls, gravity or held particles are, which follow no strain of the box, got "
            f"{strain!r}"
        )


@honors(
    "repulsion kinds bonds interactions gravity walls held links shapes memory",
    at_rest=True,
    rough="pm.stiffness_matrix",
    link_tolerance=STRAINED,
)
def hessian(
    scene: Scene,
    strain: BoxStrain = "free",
    kind: Kind = "exact",
    *,
    volume_curvature: str = "det",
    strain_scale: float | None = 1.0,
    gap_tolerance: float | None = None,
    wave_vector: ArrayLike | None = None,
) -> sp.csr_array:
    """Return the (N d + s, N d + s) second derivatives of the energy, or (N d, N d) without strain.

    Rows are positions, particle-major, then Mandel strains (xx, yy, sqrt2 xy; xx, yy, zz, sqrt2 yz, sqrt2 xz, sqrt2
    xy); a strain acts as v -> (1 + strain) v on all vectors, so that the strain part is in [energy], the mixed part
    in [energy/length]. Equations 24-26 of Dennis (2021) with their errata.

    With rigid links the matrix is that of the Lagrangian, not projected: contacts plus sum of tension * second
    derivatives of the lengths. It means something on motions that the links admit, y = B q with B from
    `change_of_basis`: the second derivatives of the energy along these are B^T H B, for a packing at rest.

    Walls and other potentials of single particles add to the blocks on the diagonal; rows and columns of particles
    that are held are zero. Such scenes have no strain of the box: walls and weights do not follow it.

    Ellipses and spheroids turn: K coordinates follow each particle's position, one in a plane and two in space (about
    the directions of `Spheroids.turn_basis`), angles times the radius of gyration, so that all are lengths. Rows of
    turns of discs and spheres are zero. The size is then N (d + K) in place of N d.

    Parameters
    ----------
    scene
        The scene.
    strain
        What the box may do: "none", "isotropic", "isochoric" or "free". But for "none" all strains are appended. Where
        they are to keep the volume ("isochoric") at its pressure P, "exact" adds the curvature of that constraint;
        project the matrix on the isochoric ones.
    kind
        "exact": the full second derivatives, contact and link forces (prestress) included. "unstressed": R^T diag(u'')
        R, as if nothing carried a force. "paper": the second derivatives of the contact energies alone, as Dennis
        (2021) projects them: without the curvature of links and of a fixed volume, wrong by terms of the order of the
        stress.
    volume_curvature
        Of a fixed volume: "det" keeps the determinant, and adds P V (tr E tr F - tr E F); "trace" keeps the trace of
        the strain coordinate, which has no curvature.
    strain_scale
        Length by which strains are multiplied to be coordinates, as in `rigidity_matrix` and `change_of_basis`; their
        rows and columns are divided by it. None: V^(1/d).
    gap_tolerance
        Contacts are pairs with a gap up to this times the contact distance [1]; those that do not overlap count with
        the second derivative of the closed side, u''(1-), so that a crystal at its touching point has its stiffness.
        None: the rule of `find_contacts`, by which the matrix is the derivative of the forces wherever pairs overlap.
    wave_vector
        (d,) fractions of the reciprocal lattice [1], with strain "none": the box is one cell of an endless packing
        and the coordinates are waves in it, whose copies n boxes away move by exp(2 pi i wave_vector.n) times as much.
        The matrix is Hermitian.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind, a name is unknown, touching centers coincide, or waves are asked for with
        strains, rigid links, or walls and held particles, which have no copies.

    Examples
    --------
    >>> import packmech as pm
    >>> scene = pm.Scene(pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.01), (pm.Repulsion(),))
    >>> pm.hessian(scene).shape
    (21, 21)

    """
    instance("scene", scene, Scene)
    check_choices(kind, strain, volume_curvature)
    check_strain_of_box(scene, strain)
    if wave_vector is not None:
        return _wave_hessian(scene, strain, kind, gap_tolerance, wave_vector)
    system = system_of(scene, kind, gap_tolerance=gap_tolerance, rattlers="keep", strained=strain != "none")
    position = system.whole_matrix()
    if strain == "none":
        return position
    everything = np.ones(system.network.free_f.size, dtype=bool)
    scale = scale_of_strain(scene.packing, strain_scale)
    corner = corner_of(system, kind, strain, volume_curvature)
    return bordered(position, system.column(everything) / scale, corner / scale**2)


def _wave_hessian(
    scene: Scene, strain: BoxStrain, kind: Kind, gap_tolerance: float | None, wave_vector: ArrayLike
) -> sp.csr_array:
    """Return the Hermitian second derivatives by waves."""
    fraction = wave_fractions(wave_vector, scene.packing.dimension)
    if strain != "none":
        raise ValueError(f"strain must be 'none' where a wave_vector is given, got {strain!r}")
    refuse_no_copies(scene, "wave_vector must be left out for packings with")
    system = system_of(scene, kind, gap_tolerance=gap_tolerance, rattlers="keep", strained=False)
    return WaveStiffness(system.elements, system.network.turn_nkt, scene.packing).at(fraction)


def refuse_no_copies(scene: Scene, words: str) -> None:
    """Refuse what waves through copies of the box cannot have; the words begin the message and name the argument."""
    if scene.packing.links:
        raise ValueError(f"{words} rigid links, got {len(scene.packing.links)}")
    if acts_on_single(scene.effects):
        raise ValueError(f"{words} walls, weights or held particles, which have no copies")


def _width(scene: Scene) -> int:
    """Return the number of coordinates of a particle."""
    packing = scene.packing
    return packing.dimension + int(packing.turn_nkt.shape[1])


@honors(
    "repulsion kinds bonds interactions gravity walls held links shapes memory",
    at_rest=True,
    rough="pm.stiffness_matrix",
)
def dynamical_matrix(
    scene: Scene,
    strain: BoxStrain = "none",
    kind: Kind = "exact",
    *,
    volume_curvature: str = "det",
    strain_scale: float | None = None,
    gap_tolerance: float | None = None,
    memory_limit: float = MEMORY_LIMIT,
    wave_vector: ArrayLike | None = None,
) -> sp.csr_array:
    """Return M^-1/2 H M^-1/2, whose eigenvalues are squared frequencies [1/time^2].

    With rigid links it is reduced to the motions that they admit, in the coordinates of `change_of_basis`: a full
    matrix, for small packings; `normal_modes` has no such limit.

    Parameters
    ----------
    scene, kind, volume_curvature, gap_tolerance
        As in `hessian`.
    strain
        Which strains vibrate too, as the coordinates strain_scale * e with unit mass: "none", "isotropic" (one),
        "isochoric" (s - 1) or "free" (s). What mass a strain has is a convention, so these frequencies depend on it;
        their signs do not.
    strain_scale
        Length by which strains are multiplied to be coordinates of unit mass [length]. None: V^(1/d), by which
        frequencies do not depend on the unit of length.
    memory_limit
        Largest memory of the matrix of a packing with links [bytes].
    wave_vector
        As in `hessian`.

    Raises
    ------
    TypeError, ValueError
        As `hessian`, or if the scale is not positive, or the matrix would exceed the memory limit.

    Examples
    --------
    >>> import packmech as pm
    >>> crystal = pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.01)
    >>> light, heavy = (
    ...     pm.dynamical_matrix(pm.Scene(crystal.replace(mass_n=[m] * 9), (pm.Repulsion(),))) for m in (1.0, 4.0)
    ... )
    >>> round(float((light / heavy.max()).max()), 12)
    4.0

    """
    instance("scene", scene, Scene)
    check_choices(kind, strain, volume_curvature)
    positive("memory_limit", memory_limit)
    mass = scene.packing.mass_n
    scale = scale_of_strain(scene.packing, strain_scale)
    full = hessian(
        scene, strain, kind, volume_curvature=volume_curvature, gap_tolerance=gap_tolerance, wave_vector=wave_vector
    )
    dimension = scene.packing.dimension
    if scene.packing.links:
        links, held = ConstraintFactor(scene.packing), held_particles(scene.effects, scene.packing.particles)
        if held is None:
            basis = motion_basis(
                links, None if strain == "none" else strain_directions(dimension, strain),
                mass_n=mass, strain_scale=scale, memory_limit=memory_limit,
            )  # fmt: skip
        else:
            free, root = np.repeat(~held, dimension), np.repeat(np.sqrt(mass), dimension)
            check_memory(len(free), int(free.sum()), memory_limit)
            none = np.zeros((dimension * (dimension + 1) // 2, 0))
            motion = link_motions(rows_on(links, free, 1.0 / root[free], none, 1.0))
            basis = np.zeros((len(free), motion.shape[1]))
            basis[free] = motion / root[free, None]
        return sp.csr_array(basis.T @ (full @ basis))
    # turns are lengths by radii of gyration: they have the mass of their particle
    weight = np.repeat(1.0 / np.sqrt(mass), _width(scene))
    change = sp.diags_array(weight, format="csr")
    if strain != "none":
        admitted = sp.csr_array(strain_directions(dimension, strain) / scale)
        change = sp.csr_array(sp.block_diag([change, admitted], format="csr"))
    result = sp.csr_array(change.T @ full @ change)
    result.sort_indices()
    return result


@honors(
    "repulsion kinds bonds interactions gravity walls held links shapes memory",
    at_rest=True,
    rough="pm.stiffness_matrix",
)
@shown_as("energy of perturbations")
def perturbation_energy(
    scene: Scene,
    displacement_nd: ArrayLike,
    strain_dd: ArrayLike | None = None,
    *,
    strain: BoxStrain = "free",
    kind: Kind = "exact",
    volume_curvature: str = "det",
    gap_tolerance: float | None = None,
) -> float:
    """Return the second-order energy of a perturbation, (1/2) y.H.y [energy]; equation 34 of Dennis (2021).

    At rest this is the change of energy up to third order. Elsewhere add the first-order part,
    -sum(forces * displacement) + V sum(stress * strain). With rigid links the perturbation must keep their lengths to
    first order, and the energy is that of the motion which keeps them to second order too.

    Parameters
    ----------
    scene, kind, volume_curvature, gap_tolerance
        As in `hessian`.
    displacement_nd
        (N, d) displacements [length]; with shapes (N, d + K), turns after them, as in `hessian`.
    strain_dd
        (d, d) symmetric strain [1], none by default; the perturbed vectors are (1 + strain)(v + dv).
    strain
        "free", or "isochoric" where the volume is held and the strain keeps it to first order.

    Raises
    ------
    TypeError, ValueError
        As `hessian`, or if the perturbation has the wrong shape, is not finite, or the strain is not symmetric.

    Examples
    --------
    >>> import packmech as pm
    >>> pair = pm.Packing([[0.0, 0.0], [1.0, 0.0]], [0.5, 0.5], pm.Box.cubic(3.0, 2))
    >>> scene = pm.Scene(pair, (pm.Repulsion(),))
    >>> pm.perturbation_energy(scene, [[0.0, 0.0], [-0.1, 0.0]]).__round__(12)
    0.005

    """
    instance("scene", scene, Scene)
    one_of("strain", strain, ("isochoric", "free"))
    packing = scene.packing
    displacement = finite_array("displacement_nd", displacement_nd, shape=(packing.particles, _width(scene)))
    motion = displacement.ravel()
    if strain_dd is not None:
        applied = finite_array("strain_dd", strain_dd, shape=(packing.dimension, packing.dimension), what="row")
        if np.abs(applied - applied.T).max() > 1e-12 * max(np.abs(applied).max(), 1e-300):
            raise ValueError(f"strain_dd must be symmetric, got {applied.tolist()}")
        motion = np.concatenate([motion, mandel_vector(applied)])
    full = hessian(
        scene,
        strain if strain_dd is not None else "none",
        kind,
        volume_curvature=volume_curvature,
        gap_tolerance=gap_tolerance,
    )
    return 0.5 * float(motion @ (full @ motion))


def is_stable(scene: Scene, *, strain: BoxStrain, gap_tolerance: float | None = None, free_turns: bool = True) -> bool:
    """Return whether the exact Hessian is positive on all motions but the d translations.

    Parameters
    ----------
    scene
        The scene; its rattlers are taken out first, with rigid links only clusters that can be moved as a whole. Then
        the motions are those that keep the links.
    strain
        "none": in the fixed box. "isochoric": with the strains that keep the volume, whose curvature counts.
    gap_tolerance
        Largest gap relative to the contact distance [1] of a contact, as in `hessian`.
    free_turns
        Whether the free turns of linked particles that are held on one side only count as no instability.

    Examples
    --------
    >>> import packmech as pm
    >>> effects = (pm.Repulsion(),)
    >>> scene = pm.Scene(pm.lattice_packing("square", repeats=(1, 1), relative_overlap=0.01), effects)
    >>> is_stable(scene, strain="none"), is_stable(scene, strain="isochoric")
    (True, False)

    """
    plain = scene.replace(packing=scene.packing.replace(tangential=None))
    system = system_of(plain, "exact", gap_tolerance=gap_tolerance)
    network, links, d = system.network, system.links, system.network.dimension
    if not len(network.index_n) or not (len(network.contacts) or len(network.interactions)):
        return False
    pinned = network.pinned_f
    matrix = system.matrix(pinned)
    scale = scene.packing.box.volume ** (1.0 / d)
    admitted = isochoric_basis(d) if strain != "none" else np.zeros((d * (d + 1) // 2, 0))
    if strain != "none":
        corner = admitted.T @ (system.corner + system.volume_curvature) @ admitted
        matrix = bordered(matrix, system.column(pinned) @ admitted / scale, corner / scale**2)
    rows = rows_on(links, network.free_f, np.ones(network.free_f.sum()), admitted, scale)
    moves = np.concatenate([pinned[network.free_f], np.ones(admitted.shape[1], dtype=bool)])
    # zero modes are none of a stable packing, but for the turns of linked particles
    allowed = 1.0 if free_turns and len(links) else -1.0
    return negative_motions(linked_system(matrix, sp.csr_array(rows[:, moves])), allowed * soft_shift(matrix), d) == 0
