"""The Jacobian of links and volume: one column for each distance, and for the volume, that must not change."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from packmech.calls.honors import ANY_LENGTH, honors
from packmech.check import BoxStrain, instance, one_of, real
from packmech.constraints.factor import ConstraintFactor
from packmech.linalg.mandel import trace_vector
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
    # its square is a number too
    return real("strain_scale", strain_scale, at_least=1e-100, at_most=1e100)


def link_rows(links: ConstraintFactor, form: str = "exact") -> tuple[sp.csc_array, NDArray[np.float64]]:
    """Return Omega, the (N d, L) derivatives of the links' lengths by the positions, and (s, L) by Mandel strains."""
    position, strain = links.gradient_lx.T.tocsc(), links.strain_le.T
    if form == "paper":
        # rho n.E.n = v.E.v / rho; the l tau.E.tau of Dennis (2021) is v.E.v / l
        over = links.pairs.distance_c / links.links.length_l
        position, strain = position.multiply(over).tocsc(), strain * over
    return position, strain


@honors("links", packing_only=True, link_tolerance=ANY_LENGTH)
def constraint_jacobian(
    packing: Packing,
    strain: BoxStrain = "none",
    *,
    form: str = "exact",
    strain_scale: float | None = 1.0,
) -> sp.csc_array:
    """Return the constraint Jacobian: (N d, L) derivatives of the links' lengths, one column for each link.

    Column l holds dc_l / dx_k = n (delta_jk - delta_ik) for c_l = |v_l| - length_l, n = v/|v| (equation 4 of
    Dennis, 2021). Where the box may strain there are s = d(d+1)/2 further rows, rho n.E.n for every Mandel strain E
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
    position, rows = link_rows(ConstraintFactor(packing), form)
    if strain == "none":
        return position
    matrix = sp.vstack([position, sp.csr_array(rows / scale)], format="csc")
    if strain == "isochoric":
        column = np.concatenate([np.zeros(position.shape[0]), trace_vector(packing.dimension) / scale])
        matrix = sp.hstack([matrix, sp.csc_array(column[:, None])], format="csc")
    return sp.csc_array(matrix)
