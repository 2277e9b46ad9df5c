"""The Jacobian of links and volume: one column for each distance, and for the volume, that must not change."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from packmech.check import BoxStrain, instance, one_of, positive
from packmech.contacts import Contacts
from packmech.contacts.network import pair_contacts
from packmech.honors import ANY_LENGTH, honors
from packmech.linalg.mandel import normal_strains, trace_vector
from packmech.links import Links
from packmech.packing import Packing

if TYPE_CHECKING:
    import scipy.sparse as sp

# what the box may do: a fixed volume is a constraint of its own
LINK_STRAINS: tuple[BoxStrain, ...] = ("none", "isochoric", "free")
FORMS = ("exact", "paper")


def scale_of_strain(packing: Packing, strain_scale: float | None) -> float:
    """Return the length that multiplies strains; None: V^(1/d)."""
    if strain_scale is None:
        return float(packing.box.volume ** (1.0 / packing.dimension))
    return positive("strain_scale", strain_scale)


def link_vectors(packing: Packing) -> NDArray[np.float64]:
    """Return the (L, d) vectors of the links from i to j [length].

    Raises
    ------
    ValueError
        If the ends of a link coincide: its length has no derivative there.

    """
    links = packing.rigid_links
    vector = links.vectors(packing.position_nd, packing.box.lattice_dd)
    stuck = np.flatnonzero(~vector.any(axis=1))
    if len(stuck):
        ends = f"particles {links.i_l[stuck[0]]} and {links.j_l[stuck[0]]}"
        raise ValueError(f"packing must have linked particles at different places, got {ends} at one place")
    return vector


def position_rows(packing: Packing, form: str = "exact") -> sp.csc_array:
    """Return Omega, the (N d, L) derivatives of the links' lengths by the positions: -n at i and +n at j."""
    import scipy.sparse as sp

    links, d = packing.rigid_links, packing.dimension
    vector = link_vectors(packing)
    size = links.length_l if form == "paper" else np.sqrt((vector**2).sum(axis=1))
    normal = vector / size[:, None]
    # a link of a particle with its own image keeps its length when the particle moves
    normal[links.i_l == links.j_l] = 0.0
    axis = np.arange(d)
    row = np.concatenate([links.i_l[:, None] * d + axis, links.j_l[:, None] * d + axis], axis=1)
    value = np.concatenate([-normal, normal], axis=1)
    shape = (packing.particles * d, len(links))
    matrix = sp.csc_array((value.ravel(), row.ravel(), np.arange(len(links) + 1) * 2 * d), shape=shape)
    matrix.sum_duplicates()
    matrix.eliminate_zeros()
    return matrix


def strain_rows(packing: Packing, form: str = "exact") -> NDArray[np.float64]:
    """Return the (s, L) derivatives of the links' lengths by the Mandel strains [length]: rho n.E.n."""
    vector = link_vectors(packing)
    distance = np.sqrt((vector**2).sum(axis=1))
    size = packing.rigid_links.length_l if form == "paper" else distance
    # rho n.E.n = v.E.v / rho; the source's l tau.E.tau is v.E.v / l
    rows: NDArray[np.float64] = (distance**2 / size * normal_strains(vector / distance[:, None]).T).copy()
    return rows


def link_pairs(packing: Packing, links: Links) -> Contacts:
    """Return the geometry of links between the particles of a packing, in their order."""
    return pair_contacts(packing, links.i_l, links.j_l, links.image_ld)


@honors("links", packing_only=True, link_tolerance=ANY_LENGTH)
def constraint_jacobian(
    packing: Packing,
    strain: BoxStrain = "none",
    *,
    form: str = "exact",
    strain_scale: float | None = 1.0,
) -> sp.csc_array:
    """Return the constraint Jacobian: (N d, L) derivatives of the links' lengths, one column for each link.

    Column l holds dc_l / dx_k = n (delta_jk - delta_ik) for c_l = |v_l| - length_l, n = v/|v| (equation 4 of the
    polymer source). Where the box may strain there are s = d(d+1)/2 further rows, rho n.E.n for every Mandel strain E
    (equation 16); where it must keep its volume, a further column (0, tr E) (equation 17). Rows are particle-major
    positions, then the strains xx, yy, sqrt2 xy in two dimensions; xx, yy, zz, sqrt2 yz, sqrt2 xz, sqrt2 xy in three. A
    packing without links has no columns of links.

    Parameters
    ----------
    packing
        The packing; its links' columns stand in the order of `packing.links`.
    strain
        What the box may do: "none"; "free" appends the rows of the strains [length]; "isochoric" also the column of the
        volume, which is then a constraint.
    form
        "exact" is the gradient wherever the packing is; "paper" has v/length and length tau.E.tau as printed, which is
        the same only where the links have their lengths.
    strain_scale
        Length by which strains are multiplied to be coordinates; their rows are divided by it. None: V^(1/d).

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind, a name is unknown, or linked particles coincide.

    Examples
    --------
    >>> import packmech as pm
    >>> dimer = pm.Packing([[0, 0], [1, 0]], [0.5, 0.5], pm.Box.cubic(4.0, 2), pm.Links([0], [1], [[0, 0]], [1.0]))
    >>> pm.constraint_jacobian(dimer, strain="isochoric").toarray().T.tolist()
    [[-1.0, 0.0, 1.0, 0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 0.0]]

    """
    import scipy.sparse as sp

    instance("packing", packing, Packing)
    one_of("strain", strain, LINK_STRAINS)
    one_of("form", form, FORMS)
    scale = scale_of_strain(packing, strain_scale)
    position = position_rows(packing, form)
    if strain == "none":
        return position
    rows = strain_rows(packing, form) / scale
    matrix = sp.vstack([position, sp.csr_array(rows)], format="csc")
    if strain == "isochoric":
        column = np.concatenate([np.zeros(position.shape[0]), trace_vector(packing.dimension) / scale])
        matrix = sp.hstack([matrix, sp.csc_array(column[:, None])], format="csc")
    return sp.csc_array(matrix)
