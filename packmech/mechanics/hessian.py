"""Second derivatives of a scene's energy with respect to positions and strains, and whether it has a minimum there.

They are sums over pairs, gathered by pairs of particles (the bond tensors). For a pair at distance rho along n with
radial derivatives u' and u''; positions x and strains E enter as v -> (1 + strain)(x_j - x_i + lattice image):

    positions           h = u'' n n + (u' / rho)(1 - n n)             +h at (i,i) and (j,j), -h at (i,j) and (j,i)
    position, strain    (u'' rho - u') n (n.E.n) + 2 u' E n           + at j, - at i
    strain, strain      rho (rho u'' - u')(n.E.n)(n.F.n) + rho u' (E n).(F n)
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from packmech.check import finite_array, instance, one_of, positive
from packmech.constraints.basis import MEMORY_LIMIT, motion_basis
from packmech.constraints.factor import ConstraintFactor
from packmech.constraints.jacobian import scale_of_strain
from packmech.contacts import Contacts
from packmech.contacts.network import distinct_pairs
from packmech.effects import ContactTerms, acts_on_single, contact_terms, held_particles
from packmech.honors import STRAINED, honors
from packmech.jit.compiled import kernel
from packmech.linalg.factor import NotDefinite, factorize
from packmech.linalg.mandel import (
    STRAINS,
    isochoric_basis,
    mandel_basis,
    mandel_vector,
    strain_directions,
    trace_vector,
)
from packmech.measure.counting import remove_rattlers
from packmech.measure.stress import contact_stress
from packmech.mechanics.linked_systems import linked_system, negative_motions, soft_shift, weighted_rows
from packmech.mechanics.rattling import held_network, scene_network
from packmech.mechanics.shaped import shaped_hessian
from packmech.scene import Scene


@kernel
def _gather(i_c, j_c, pair_c, normal, distance, first, second, basis, pair, diagonal, coupling, strain):  # type: ignore[no-untyped-def]
    count, d = normal.shape
    s = basis.shape[0]
    block = np.empty((d, d))
    stretch = np.empty(s)
    tilt = np.empty((s, d))
    for c in range(count):
        n = normal[c]
        r = distance[c]
        u1 = first[c]
        u2 = second[c]
        across = u1 / r if u1 != 0.0 else 0.0
        for a in range(d):
            for b in range(d):
                block[a, b] = (u2 - across) * (n[a] * n[b])
            block[a, a] += across
        for m in range(s):
            stretch[m] = 0.0
            for a in range(d):
                total = 0.0
                for b in range(d):
                    total += basis[m, a, b] * n[b]
                tilt[m, a] = total
                stretch[m] += n[a] * total
        for m in range(s):
            for k in range(m, s):
                product = 0.0
                for a in range(d):
                    product += tilt[m, a] * tilt[k, a]
                strain[m, k] += r * (r * u2 - u1) * stretch[m] * stretch[k] + r * u1 * product
        i = i_c[c]
        j = j_c[c]
        if i == j:
            continue
        q = pair_c[c]
        for a in range(d):
            for b in range(d):
                pair[q, a, b] += block[a, b]
                diagonal[i, a, b] += block[a, b]
                diagonal[j, a, b] += block[a, b]
            for m in range(s):
                g = (u2 * r - u1) * n[a] * stretch[m] + 2.0 * u1 * tilt[m, a]
                coupling[j, a, m] += g
                coupling[i, a, m] -= g
    for m in range(s):
        for k in range(m):
            strain[m, k] = strain[k, m]


@dataclass(frozen=True, eq=False)
class BondSums:
    """Second derivatives of a sum of pair energies, in blocks.

    Attributes
    ----------
    pair_i, pair_j
        (P,) pairs of particles i < j that interact, each once, whatever the number of images.
    pair_pdd
        (P, d, d) sums of h over the images of each pair; the Hessian's block (i, j) is minus this [energy/length^2].
    diagonal_ndd
        (N, d, d) blocks on the diagonal [energy/length^2].
    coupling_nde
        (N, d, s) mixed derivatives with respect to position and Mandel strain [energy/length].
    strain_ee
        (s, s) derivatives with respect to the strains [energy].

    """

    pair_i: NDArray[np.int64]
    pair_j: NDArray[np.int64]
    pair_pdd: NDArray[np.float64]
    diagonal_ndd: NDArray[np.float64]
    coupling_nde: NDArray[np.float64]
    strain_ee: NDArray[np.float64]

    @property
    def coupling_xe(self) -> NDArray[np.float64]:
        """The (N d, s) mixed derivatives, rows particle-major."""
        return self.coupling_nde.reshape(-1, self.strain_ee.shape[0])

    def position_matrix(self, keep_n: NDArray[np.bool_] | None = None) -> sp.csr_array:
        """Return the (N d, N d) derivatives with respect to positions, or only those of the particles to keep."""
        pair_i, pair_j, blocks, diagonal = self.pair_i, self.pair_j, self.pair_pdd, self.diagonal_ndd
        if keep_n is not None:
            number = np.cumsum(keep_n) - 1
            inside = keep_n[pair_i] & keep_n[pair_j]
            pair_i, pair_j, blocks = number[pair_i[inside]], number[pair_j[inside]], blocks[inside]
            diagonal = diagonal[keep_n]
        count, dimension = diagonal.shape[:2]
        row = np.concatenate([pair_i, pair_j, np.arange(count)])
        column = np.concatenate([pair_j, pair_i, np.arange(count)])
        order = np.argsort(row * max(count, 1) + column, kind="stable")
        start = np.concatenate([[0], np.cumsum(np.bincount(row, minlength=count))])
        value = np.concatenate([-blocks, -blocks, diagonal])[order]
        size = count * dimension
        if not count:
            return sp.csr_array((0, 0))
        matrix = sp.bsr_array((value, column[order], start), shape=(size, size)).tocsr()
        matrix.has_sorted_indices = True
        return matrix


def bond_sums(contacts: Contacts, first_c: NDArray[np.float64], second_c: NDArray[np.float64]) -> BondSums:
    """Return the second derivatives of a sum of pair energies with the given radial derivatives.

    Parameters
    ----------
    contacts
        The pairs.
    first_c, second_c
        (C,) du/dr [force] and d2u/dr2 [force/length].

    Raises
    ------
    ValueError
        If a pair with a force has coincident centers: its energy has no second derivative there.

    """
    stuck = (contacts.distance_c == 0.0) & (first_c != 0.0)
    if stuck.any():
        c = int(np.flatnonzero(stuck)[0])
        raise ValueError(
            "packing must have no coincident centers where second derivatives are asked for, "
            f"got particles {contacts.i_c[c]} and {contacts.j_c[c]} at one place"
        )
    dimension, particles = contacts.dimension, contacts.particles
    basis = mandel_basis(dimension)
    # contacts are sorted by (i, j, image)
    pair_i, pair_j, pair_c = distinct_pairs(contacts.i_c, contacts.j_c)
    pair = np.zeros((len(pair_i), dimension, dimension))
    diagonal = np.zeros((particles, dimension, dimension))
    coupling = np.zeros((particles, dimension, len(basis)))
    strain = np.zeros((len(basis), len(basis)))
    _gather(
        contacts.i_c, contacts.j_c, pair_c, contacts.normal_cd, contacts.distance_c, first_c, second_c, basis,
        pair, diagonal, coupling, strain,
    )  # fmt: skip
    return BondSums(pair_i, pair_j, pair, diagonal, coupling, strain)


class Prestressed(NamedTuple):
    """Pairs with radial derivatives of their energies: contacts, and links as bonds with a force and no stiffness."""

    pairs: Contacts
    first_c: NDArray[np.float64]
    second_c: NDArray[np.float64]


def prestressed(
    contacts: Contacts,
    terms: ContactTerms,
    kind: str,
    links: ConstraintFactor | None,
    tension_l: NDArray[np.float64] | None = None,
) -> Prestressed:
    """Return the pairs whose second derivatives make up the Hessian of the named kind.

    "exact" adds each link as a bond with u' = its tension (found here unless given) and u'' = 0; "paper" and
    "unstressed" have contacts only.
    """
    first = np.zeros_like(terms.first_c) if kind == "unstressed" else terms.first_c
    if links is None or kind != "exact":
        return Prestressed(contacts, first, terms.second_c)
    tension = links.tension(contacts, terms.first_c) if tension_l is None else tension_l
    pairs, order = joined(contacts, links.pairs)
    first = np.concatenate([first, tension])[order]
    return Prestressed(pairs, first, np.concatenate([terms.second_c, np.zeros(len(tension))])[order])


@kernel
def _merged(i_c, j_c, image_cd, count):  # type: ignore[no-untyped-def]
    """Return the order that merges the first `count` pairs and the others, each sorted by (i, j, image) already."""
    order = np.empty(i_c.shape[0], np.int64)
    a, b = 0, count
    for k in range(i_c.shape[0]):
        first = a < count
        if first and b < i_c.shape[0]:
            step = i_c[a] - i_c[b]
            if step == 0:
                step = j_c[a] - j_c[b]
            for m in range(image_cd.shape[1]):
                if step == 0:
                    step = image_cd[a, m] - image_cd[b, m]
            first = step <= 0
        if first:
            order[k] = a
            a += 1
        else:
            order[k] = b
            b += 1
    return order


@kernel
def _picked(order, i_c, j_c, image_cd, normal_cd, distance_c, touching_c):  # type: ignore[no-untyped-def]
    """Return the arrays in this order."""
    count, d = image_cd.shape
    i, j, image = np.empty_like(i_c), np.empty_like(j_c), np.empty((count, d), np.int64)
    normal, distance, touching = np.empty((count, d)), np.empty(count), np.empty(count)
    for k in range(count):
        c = order[k]
        i[k], j[k], distance[k], touching[k] = i_c[c], j_c[c], distance_c[c], touching_c[c]
        for a in range(d):
            image[k, a], normal[k, a] = image_cd[c, a], normal_cd[c, a]
    return i, j, image, normal, distance, touching


def joined(one: Contacts, other: Contacts) -> tuple[Contacts, NDArray[np.int64]]:
    """Return the pairs of both, sorted by (i, j, image), and where each of them came from."""
    i, j = np.concatenate([one.i_c, other.i_c]), np.concatenate([one.j_c, other.j_c])
    image = np.concatenate([one.image_cd, other.image_cd])
    order = _merged(i, j, image, len(one))
    normal = np.concatenate([one.normal_cd, other.normal_cd])
    distance = np.concatenate([one.distance_c, other.distance_c])
    touching = np.concatenate([one.contact_distance_c, other.contact_distance_c])
    i, j, image, normal, distance, touching = _picked(order, i, j, image, normal, distance, touching)
    return Contacts(i, j, image, normal, distance, touching, one.particles, one.dimension), order


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


def check_choices(kind: str, strain: str, volume_curvature: str) -> None:
    """Check the names of a kind of Hessian, of what the box may do, and of the curvature of its volume."""
    one_of("kind", kind, KINDS)
    one_of("strain", strain, STRAINS)
    one_of("volume_curvature", volume_curvature, CURVATURES)


def check_strain_of_box(scene: Scene, strain: str) -> None:
    """Refuse strains of the box where walls, weights or held particles do not follow it."""
    if strain != "none" and acts_on_single(scene.effects):
        raise ValueError(
            "strain must be 'none' where walls, gravity or held particles are, which follow no strain of the box, got "
            f"{strain!r}"
        )


@honors(
    "repulsion gravity walls held links shapes",
    at_rest=True,
    rough="pm.stiffness_matrix",
    apart="links+gravity links+walls links+held",
    link_tolerance=STRAINED,
)
def hessian(
    scene: Scene,
    strain: str = "free",
    kind: str = "exact",
    *,
    volume_curvature: str = "det",
    strain_scale: float | None = 1.0,
    gap_tolerance: float | None = None,
) -> sp.csr_array:
    """Return the (N d + s, N d + s) second derivatives of the energy, or (N d, N d) without strain.

    Rows are positions, particle-major, then Mandel strains (xx, yy, sqrt2 xy; xx, yy, zz, sqrt2 yz, sqrt2 xz, sqrt2
    xy); a strain acts as v -> (1 + strain) v on all vectors, so that the strain part is in [energy], the mixed part
    in [energy/length]. Equations 24-26 of the polymer source with their errata.

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
        The scene; with rigid links nothing may act on single particles.
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
    strain_scale
        Length by which strains are multiplied to be coordinates, as in `rigidity_matrix` and `change_of_basis`; their
        rows and columns are divided by it. None: V^(1/d).
    gap_tolerance
        Contacts are pairs with a gap up to this times the contact distance [1]; those that do not overlap count with
        the second derivative of the closed side, u''(1-), so that a crystal at its touching point has its stiffness.
        None: the rule of `find_contacts`, by which the matrix is the derivative of the forces wherever pairs overlap.

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
    check_strain_of_box(scene, strain)
    if scene.packing.shapes is not None:
        return _of_shapes(scene, strain, kind, volume_curvature, strain_scale, gap_tolerance)
    (contacts, _, links), free_n, second = scene_network(scene, gap_tolerance=gap_tolerance, rattlers="keep")
    terms = closed_terms(scene, contacts)
    sums = scene_sums(contacts, terms, kind, links)
    if second is not None:
        sums.diagonal_ndd[:] += second
    position = sums.position_matrix()
    if free_n is not None:
        moving = sp.diags_array(np.repeat(free_n.astype(float), contacts.dimension), format="csr")
        position = sp.csr_array(moving @ position @ moving)
    position.eliminate_zeros()
    if strain == "none":
        return position
    corner = sums.strain_ee
    if kind == "exact" and strain == "isochoric" and volume_curvature == "det":
        corner = corner + volume_curvature_term(contacts, terms, links)
    scale = scale_of_strain(scene.packing, strain_scale)
    return bordered(position, sums.coupling_xe / scale, corner / scale**2)


def _width(scene: Scene) -> int:
    """Return the number of coordinates of a particle."""
    packing = scene.packing
    turns = 0 if packing.shapes is None else packing.shapes.turn_basis(packing.radius_n).shape[1]
    return packing.dimension + turns


def _of_shapes(
    scene: Scene, strain: str, kind: str, volume_curvature: str, strain_scale: float | None, gap_tolerance: float | None
) -> sp.csr_array:
    """Return the Hessian of a packing with shapes, the turns of each particle after its position."""
    found = shaped_hessian(scene, kind, gap_tolerance=gap_tolerance, rattlers="keep")
    everything = np.ones(found.network.free_nq.size, dtype=bool)
    position = found.sums.matrix(everything)
    if held_particles(scene.effects, scene.packing.particles) is not None:
        moving = sp.diags_array(found.network.free_nq.ravel().astype(float), format="csr")
        position = sp.csr_array(moving @ position @ moving)
    position.eliminate_zeros()
    if strain == "none":
        return position
    scale = scale_of_strain(scene.packing, strain_scale)
    corner = found.corner(kind, strain, volume_curvature)
    return bordered(position, found.sums.coupling(everything) / scale, corner / scale**2)


def bordered(position: sp.csr_array, coupling_xe: NDArray[np.float64], corner_ee: NDArray[np.float64]) -> sp.csr_array:
    """Return the sparse matrix with dense strain rows and columns appended."""
    side = sp.csr_array(coupling_xe)
    return sp.csr_array(sp.block_array([[position, side], [side.T, sp.csr_array(corner_ee)]], format="csr"))


@honors(
    "repulsion gravity walls held links shapes",
    at_rest=True,
    rough="pm.stiffness_matrix",
    apart="links+gravity links+walls links+held",
)
def dynamical_matrix(
    scene: Scene,
    strain: str = "none",
    kind: str = "exact",
    *,
    volume_curvature: str = "det",
    strain_scale: float | None = None,
    gap_tolerance: float | None = None,
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
    strain_scale
        Length by which strains are multiplied to be coordinates of unit mass [length]. None: V^(1/d), by which
        frequencies do not depend on the unit of length.
    memory_limit
        Largest memory of the matrix of a packing with links [bytes].

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
    full = hessian(scene, strain, kind, volume_curvature=volume_curvature, gap_tolerance=gap_tolerance)
    dimension = scene.packing.dimension
    if scene.packing.links is not None:
        basis = motion_basis(
            ConstraintFactor(scene.packing), None if strain == "none" else strain_directions(dimension, strain),
            mass_n=mass, strain_scale=scale, memory_limit=memory_limit,
        )  # fmt: skip
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
    "repulsion gravity walls held links shapes",
    at_rest=True,
    rough="pm.stiffness_matrix",
    apart="links+gravity links+walls links+held",
)
def perturbation_energy(
    scene: Scene,
    displacement_nd: ArrayLike,
    strain_dd: ArrayLike | None = None,
    *,
    strain: str = "free",
    kind: str = "exact",
    volume_curvature: str = "det",
    gap_tolerance: float | None = None,
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


def is_stable(scene: Scene, *, strain: str, gap_tolerance: float | None = None, free_turns: bool = True) -> bool:
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
    if scene.packing.links is not None:
        return _is_stable_with_links(scene, strain, gap_tolerance, allowed=1.0 if free_turns else -1.0)
    try:
        packing, _ = remove_rattlers(scene.packing.replace(tangential=None), gap_tolerance=gap_tolerance)
    except ValueError:
        return False
    d = packing.dimension
    backbone = scene.replace(packing=packing)
    matrix = hessian(backbone, strain, gap_tolerance=gap_tolerance)[d:, d:]
    if strain != "none":
        scale = packing.box.volume ** (1.0 / d)
        basis = sp.csr_array(isochoric_basis(d) / scale)
        change = sp.block_diag([sp.eye_array((packing.particles - 1) * d), basis], format="csr")
        matrix = sp.csr_array(change.T @ matrix @ change)
    if matrix.shape[0] and not np.abs(matrix.diagonal()).max() > 0:
        return False
    try:
        factorize(matrix, kind="definite")
    except NotDefinite:
        return False
    return True


def _is_stable_with_links(scene: Scene, strain: str, gap_tolerance: float | None, allowed: float) -> bool:
    """Return whether no motion is unstable, those softer than counts as zero being `allowed` (1) or not (-1)."""
    contacts, index, links = held_network(scene.packing, gap_tolerance=gap_tolerance)
    if not len(index) or not len(contacts):
        return False
    d = contacts.dimension
    terms = closed_terms(scene, contacts)
    sums = scene_sums(contacts, terms, "exact", links)
    matrix = sums.position_matrix()
    admitted = np.zeros((d * (d + 1) // 2, 0))
    scale = scene.packing.box.volume ** (1.0 / d)
    if strain != "none":
        admitted = isochoric_basis(d)
        corner = sums.strain_ee + volume_curvature_term(contacts, terms, links)
        matrix = bordered(matrix, sums.coupling_xe @ admitted / scale, admitted.T @ corner @ admitted / scale**2)
    pinned = matrix[d:, d:]
    if links is None:
        rows = sp.csr_array((0, pinned.shape[0]))
    else:
        rows = weighted_rows(links, np.ones(len(index) * d), admitted, scale)[:, d:]
    system = linked_system(pinned, sp.csr_array(rows))
    return negative_motions(system, allowed * soft_shift(pinned), d) == 0
