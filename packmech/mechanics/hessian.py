"""Second derivatives of a scene's energy with respect to positions and strains."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from packmech.check import finite_array, instance, one_of, positive, positive_array
from packmech.constraints.basis import MEMORY_LIMIT, motion_basis
from packmech.constraints.factor import ConstraintFactor
from packmech.contacts import Contacts, find_contacts
from packmech.effects import ContactTerms, contact_terms
from packmech.linalg.mandel import STRAINS, mandel_vector, strain_directions, trace_vector
from packmech.measure import contact_stress
from packmech.mechanics.pair_stiffness import BondSums, bond_sums, prestressed
from packmech.mechanics.rigidity import TOUCHING
from packmech.packing import Packing
from packmech.scene import Scene

KINDS = ("exact", "paper", "unstressed")
CURVATURES = ("det", "trace")


def closed_terms(scene: Scene, contacts: Contacts) -> ContactTerms:
    """Return the contacts' energies and derivatives, those that just touch taken from the closed side."""
    return contact_terms(scene.effects, contacts.distance_c, contacts.contact_distance_c, closing=True)


def scene_sums(contacts: Contacts, terms: ContactTerms, kind: str, links: ConstraintFactor | None = None) -> BondSums:
    """Return the bond tensors of the named kind; "unstressed" leaves out the forces, "paper" those of the links."""
    return bond_sums(*prestressed(contacts, terms, kind, links))


def volume_curvature_term(
    contacts: Contacts, terms: ContactTerms, links: ConstraintFactor | None = None
) -> NDArray[np.float64]:
    """Return the (s, s) curvature P V d2(det) of a volume held by pressure: P V (tr E tr F - tr E F)."""
    stressed = prestressed(contacts, terms, "exact", links)
    stress_volume = contact_stress(stressed.pairs, stressed.first_c, 1.0)
    trace = trace_vector(contacts.dimension)
    pressure_volume = -float(np.trace(stress_volume)) / contacts.dimension
    return pressure_volume * (np.outer(trace, trace) - np.eye(len(trace)))


def links_of(packing: Packing) -> ConstraintFactor | None:
    """Return the gradients of a packing's links, None where there are none."""
    return None if packing.links is None else ConstraintFactor(packing)


def check_choices(kind: str, strain: str, volume_curvature: str) -> None:
    """Check the names of a kind of Hessian, of what the box may do, and of the curvature of its volume."""
    one_of("kind", kind, KINDS)
    one_of("strain", strain, STRAINS)
    one_of("volume_curvature", volume_curvature, CURVATURES)


def hessian(
    scene: Scene,
    strain: str = "free",
    kind: str = "exact",
    *,
    volume_curvature: str = "det",
    gap_tolerance: float = TOUCHING,
) -> sp.csr_array:
    """Return the (N d + s, N d + s) second derivatives of the energy, or (N d, N d) without strain.

    Rows are positions, particle-major, then Mandel strains (xx, yy, sqrt2 xy; xx, yy, zz, sqrt2 yz, sqrt2 xz, sqrt2
    xy); a strain acts as v -> (1 + strain) v on all vectors, so that the strain part is in [energy], the mixed part
    in [energy/length]. Equations 24-26 of the polymer source with their errata.

    With rigid links the matrix is that of the Lagrangian, not projected: contacts plus sum of tension * second
    derivatives of the lengths. It means something on motions that the links admit, y = B q with B from
    `change_of_basis`: the second derivatives of the energy along these are B^T H B, for a packing at rest.

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
        R, as if nothing carried a force. "paper": the second derivatives of the contact energies alone, as the source
        projects them: without the curvature of links and of a fixed volume, wrong by terms of the order of the stress.
    volume_curvature
        Of a fixed volume: "det" keeps the determinant, and adds P V (tr E tr F - tr E F); "trace" keeps the trace of
        the strain coordinate, which has no curvature.
    gap_tolerance
        Contacts are pairs with a gap up to this times the contact distance [1]; those that do not overlap count with
        the second derivative of the closed side, u''(1-), so that a crystal at its touching point has its stiffness.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind, a name is unknown, or touching centers coincide.

    Examples
    --------
    >>> import packmech as pm
    >>> scene = pm.Scene(pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.01), (pm.Repulsion(),))
    >>> pm.hessian(scene).shape
    (21, 21)

    """
    instance("scene", scene, Scene)
    check_choices(kind, strain, volume_curvature)
    contacts = find_contacts(scene.packing, gap_tolerance=gap_tolerance)
    terms = closed_terms(scene, contacts)
    links = links_of(scene.packing)
    sums = scene_sums(contacts, terms, kind, links)
    position = sums.position_matrix()
    position.eliminate_zeros()
    if strain == "none":
        return position
    corner = sums.strain_ee
    if kind == "exact" and strain == "isochoric" and volume_curvature == "det":
        corner = corner + volume_curvature_term(contacts, terms, links)
    return bordered(position, sums.coupling_xe, corner)


def bordered(position: sp.csr_array, coupling_xe: NDArray[np.float64], corner_ee: NDArray[np.float64]) -> sp.csr_array:
    """Return the sparse matrix with dense strain rows and columns appended."""
    side = sp.csr_array(coupling_xe)
    return sp.csr_array(sp.block_array([[position, side], [side.T, sp.csr_array(corner_ee)]], format="csr"))


def dynamical_matrix(
    scene: Scene,
    strain: str = "none",
    kind: str = "exact",
    *,
    volume_curvature: str = "det",
    mass_n: ArrayLike | None = None,
    strain_scale: float | None = None,
    gap_tolerance: float = TOUCHING,
    memory_limit: float = MEMORY_LIMIT,
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
    mass_n
        (N,) masses; 1 for all by default.
    strain_scale
        Length that a unit strain counts as [length]; V^(1/d) by default.
    memory_limit
        Largest memory of the matrix of a packing with links [bytes].

    Raises
    ------
    TypeError, ValueError
        As `hessian`, or if a mass or the scale is not positive, or the matrix would exceed the memory limit.

    Examples
    --------
    >>> import packmech as pm
    >>> scene = pm.Scene(pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.01), (pm.Repulsion(),))
    >>> light, heavy = (pm.dynamical_matrix(scene, mass_n=[m] * 9) for m in (1.0, 4.0))
    >>> round(float((light / heavy.max()).max()), 12)
    4.0

    """
    instance("scene", scene, Scene)
    check_choices(kind, strain, volume_curvature)
    positive("memory_limit", memory_limit)
    mass = checked_masses(mass_n, scene.packing.particles)
    scale = checked_scale(strain_scale, scene)
    full = hessian(scene, strain, kind, volume_curvature=volume_curvature, gap_tolerance=gap_tolerance)
    dimension = scene.packing.dimension
    if scene.packing.links is not None:
        basis = motion_basis(
            ConstraintFactor(scene.packing), None if strain == "none" else strain_directions(dimension, strain),
            mass_n=mass, strain_scale=scale, memory_limit=memory_limit,
        )  # fmt: skip
        return sp.csr_array(basis.T @ (full @ basis))
    weight = np.repeat(1.0 / np.sqrt(mass), dimension)
    change = sp.diags_array(weight, format="csr")
    if strain != "none":
        admitted = sp.csr_array(strain_directions(dimension, strain) / scale)
        change = sp.csr_array(sp.block_diag([change, admitted], format="csr"))
    result = sp.csr_array(change.T @ full @ change)
    result.sort_indices()
    return result


def checked_masses(mass_n: ArrayLike | None, particles: int) -> NDArray[np.float64]:
    """Return the masses, 1 where none were given, after checking their number and sign."""
    if mass_n is None:
        return np.ones(particles)
    return positive_array("mass_n", mass_n, shape=(particles,))


def checked_scale(strain_scale: float | None, scene: Scene) -> float:
    """Return the length that a unit strain counts as, V^(1/d) where none was given."""
    if strain_scale is None:
        return float(scene.packing.box.volume ** (1.0 / scene.packing.dimension))
    return positive("strain_scale", strain_scale)


def perturbation_energy(
    scene: Scene,
    displacement_nd: ArrayLike,
    strain_dd: ArrayLike | None = None,
    *,
    strain: str = "free",
    kind: str = "exact",
    volume_curvature: str = "det",
    gap_tolerance: float = TOUCHING,
) -> float:
    """Return the second-order energy of a perturbation, (1/2) y.H.y [energy]; equation 34 of the polymer source.

    At rest this is the change of energy up to third order. Elsewhere add the first-order part,
    -sum(forces * displacement) + V sum(stress * strain). With rigid links the perturbation must keep their lengths to
    first order, and the energy is that of the motion which keeps them to second order too.

    Parameters
    ----------
    scene, kind, volume_curvature, gap_tolerance
        As in `hessian`.
    displacement_nd
        (N, d) displacements [length].
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
    displacement = finite_array("displacement_nd", displacement_nd, shape=(packing.particles, packing.dimension))
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
