# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Links in compiled loops: their Jacobian, its factored normal matrix, projections.

Omega has one column per link, the gradient n (delta_jk - delta_ik) of its length (equation 4 of the polymer source,
n = v / |v|). Projections need A = Omega^T W Omega with the inverse masses W. Clusters share no particle, so A is block
diagonal, and within a cluster two links couple only at a common particle. Links are put in an order that follows the
cluster (reverse Cuthill and McKee), in which the factor of A stays inside the envelope of A: two numbers a link for
a chain or a ring (`link_factor`). That structure is found once for a set of links; every configuration refills numbers
only.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.compiled import device
from packmech.links import Links
from packmech.measure.link_order import elimination_order, envelope
from packmech.mechanics.link_factor import factorize_links, solve_links

# rates of links below this many units of rounding of the largest force are zero
AT_ROUNDING = 4.0 * np.finfo(np.float64).eps
# a pass gains the digits that rounding leaves in the factor of A: nearly all of them, but few for long stiff chains
MOST_PASSES = 12


class LinkSystem(NamedTuple):
    """Links compiled for projections: arrays only, so that kernels take it as one argument.

    Index r counts links in the order of elimination; `order_r` is the place of each among the packing's links. The
    arrays of the last group are working space that `refill` and the others overwrite.

    Attributes
    ----------
    axes
        A tuple as long as the dimension.
    order_r, i_r, j_r, image_rd, length_r, scale_r
        Links in the order of elimination; scale is the larger of the length and the mean diameter [length].
    inverse_mass_n
        (N,) inverse masses.
    row_e, column_e, particle_e
        Pairs of links row > column that share a particle.
    slot_e, sign_e
        Where the pair stands in the envelope, and +1 or -1 as both links point alike at the particle.
    first_r, start_r
        First column of each row of the envelope, and its place in `factor`.
    normal_rd, distance_r, error_r
        Unit vectors, distances and distances less lengths at the last refill.
    factor, inverse_pivot_r
        The Cholesky factor of A by rows (its diagonal inverted apart; 0 for a dependent link).
    last_r, block_b
        Last row whose envelope reaches each column, and the first link of each cluster (with the count at the end).
    part_b, who_q, from_q, near_k, sense_k
        Particles by cluster, in the order of their first links: from part_b[b] on, each with its links near_k from
        from_q[q] on, and the signs of their gradients at it.
    diagonal_r, row_r
        Working space of the factor; row_r is zero between calls.
    multiplier_r, spare_nd, start_nd
        Working space of the solves, and of `reaffix`.

    """

    axes: tuple[int, ...]
    order_r: NDArray[np.int64]
    i_r: NDArray[np.int64]
    j_r: NDArray[np.int64]
    image_rd: NDArray[np.float64]
    length_r: NDArray[np.float64]
    scale_r: NDArray[np.float64]
    inverse_mass_n: NDArray[np.float64]
    row_e: NDArray[np.int64]
    column_e: NDArray[np.int64]
    particle_e: NDArray[np.int64]
    slot_e: NDArray[np.int64]
    sign_e: NDArray[np.float64]
    first_r: NDArray[np.int64]
    start_r: NDArray[np.int64]
    normal_rd: NDArray[np.float64]
    distance_r: NDArray[np.float64]
    error_r: NDArray[np.float64]
    factor: NDArray[np.float64]
    inverse_pivot_r: NDArray[np.float64]
    last_r: NDArray[np.int64]
    block_b: NDArray[np.int64]
    part_b: NDArray[np.int64]
    who_q: NDArray[np.int64]
    from_q: NDArray[np.int64]
    near_k: NDArray[np.int64]
    sense_k: NDArray[np.float64]
    diagonal_r: NDArray[np.float64]
    row_r: NDArray[np.float64]
    multiplier_r: NDArray[np.float64]
    spare_nd: NDArray[np.float64]
    start_nd: NDArray[np.float64]


def make_link_system(
    links: Links,
    particles: int,
    dimension: int,
    *,
    mean_diameter: float = 0.0,
    mass_n: NDArray[np.float64] | None = None,
) -> LinkSystem:
    """Return the links compiled for projections: the structure only, `refill` puts the numbers in.

    Parameters
    ----------
    links
        The links, for the rows of the positions that the other functions will get.
    particles, dimension
        Number of particles and of Cartesian axes.
    mean_diameter
        Errors of a link are relative to the larger of its length and this [length].
    mass_n
        (N,) masses; equal when left out.

    Examples
    --------
    >>> chain = Links([0, 1], [1, 2], [[0, 0]] * 2, [1.0, 1.0])
    >>> system = make_link_system(chain, 3, 2)
    >>> position = np.array([[0.0, 0.0], [1.1, 0.0], [1.1, 1.0]])
    >>> _, dependent = refill(system, position, 9.0 * np.eye(2))
    >>> dependent, system.error_r.round(12).tolist()
    (0, [0.0, 0.1])

    """
    order = elimination_order(links, particles)
    tables = envelope(links, order, particles)
    count, d = len(order), dimension
    length = links.length_l[order]
    inverse = np.ones(particles) if mass_n is None else 1.0 / mass_n
    return LinkSystem(
        **tables, axes=(0,) * d, order_r=order, image_rd=links.image_ld[order].astype(np.float64), length_r=length,
        scale_r=np.maximum(length, mean_diameter), inverse_mass_n=inverse,
        normal_rd=np.zeros((count, d)), distance_r=np.zeros(count), error_r=np.zeros(count),
        factor=np.zeros(int(tables["start_r"][-1])), inverse_pivot_r=np.zeros(count), diagonal_r=np.zeros(count),
        row_r=np.zeros(count), multiplier_r=np.zeros(count), spare_nd=np.zeros((particles, d)),
        start_nd=np.zeros((particles, d)),
    )  # fmt: skip


@device
def measure(system, position, lattice):
    """Set unit vectors, distances and errors of the links; return the largest error over the link's scale."""
    axes, image, normal = system.axes, system.image_rd, system.normal_rd
    d = len(axes)
    worst = 0.0
    for r in range(system.i_r.shape[0]):
        i, j = system.i_r[r], system.j_r[r]
        square = 0.0
        for a in range(d):
            part = position[j, a] - position[i, a]
            for b in range(d):
                part += lattice[a, b] * image[r, b]
            normal[r, a] = part
            square += part * part
        distance = math.sqrt(square)
        for a in range(d):
            normal[r, a] /= distance
        system.distance_r[r] = distance
        error = distance - system.length_r[r]
        system.error_r[r] = error
        relative = abs(error) / system.scale_r[r]
        if not relative <= worst:
            worst = relative
    return worst


@device
def refill(system, position, lattice):
    """Set the Jacobian and the factor at a configuration.

    position is (N, >= d): its first d columns are the positions. Returns the smallest relative pivot and the number of
    links left out as dependent (see `factorize_links`); the largest error is that of `measure`.
    """
    measure(system, position, lattice)
    return factorize_links(system, 0.0)


@device
def rates(system, vector_nd, of_force):
    """Set multiplier = Omega^T v, or Omega^T W F of a force; return the largest."""
    axes, normal, weight = system.axes, system.normal_rd, system.inverse_mass_n
    d = len(axes)
    largest = 0.0
    for r in range(system.i_r.shape[0]):
        i, j = system.i_r[r], system.j_r[r]
        wi = weight[i] if of_force else 1.0
        wj = weight[j] if of_force else 1.0
        rate = 0.0
        for a in range(d):
            rate += normal[r, a] * (wj * vector_nd[j, a] - wi * vector_nd[i, a])
        system.multiplier_r[r] = rate
        if system.inverse_pivot_r[r] > 0.0:
            largest = max(largest, abs(rate))
    return largest


@device
def push(system, value_r, vector_nd, of_force):
    """Take Omega value from a force, or W Omega value from a velocity or from positions."""
    axes, normal, weight = system.axes, system.normal_rd, system.inverse_mass_n
    d = len(axes)
    for r in range(system.i_r.shape[0]):
        i, j = system.i_r[r], system.j_r[r]
        wi = value_r[r] if of_force else value_r[r] * weight[i]
        wj = value_r[r] if of_force else value_r[r] * weight[j]
        for a in range(d):
            vector_nd[j, a] -= wj * normal[r, a]
            vector_nd[i, a] += wi * normal[r, a]


@device
def project_vector(system, vector_nd, out_nd, multiplier_l, of_force):
    """Take out what the links bear of a force, or what would stretch them of a velocity; see the two below."""
    d = len(system.axes)
    largest = 0.0
    for i in range(vector_nd.shape[0]):
        for a in range(d):
            out_nd[i, a] = vector_nd[i, a]
            part = abs(vector_nd[i, a])
            if of_force:
                part *= system.inverse_mass_n[i]
            largest = max(largest, part)
    order = system.order_r
    for r in range(order.shape[0]):
        multiplier_l[order[r]] = 0.0
    rate = rates(system, out_nd, of_force)
    # each further pass takes the rounding of the one before out; where A is well conditioned one is enough
    for _ in range(MOST_PASSES):
        if not rate > AT_ROUNDING * largest:
            break
        solve_links(system, system.multiplier_r)
        for r in range(order.shape[0]):
            multiplier_l[order[r]] += system.multiplier_r[r]
        push(system, system.multiplier_r, out_nd, of_force)
        rate = rates(system, out_nd, of_force)
    return rate


@device
def project_force(system, force_nd, out_nd, multiplier_l):
    """Set out = F - Omega lambda, the force that accelerates no link; return its largest rate of a link.

    lambda are the links' multipliers, in the packing's order of links: each link adds the force -lambda n on j and
    lambda n on i, so that lambda > 0 is tension. Needs `refill` at this configuration; out may be the force itself. No
    link should depend on others: what is left of the largest rate tells when rounding won.
    """
    return project_vector(system, force_nd, out_nd, multiplier_l, True)


@device
def project_velocity(system, velocity_nd, out_nd, multiplier_l):
    """Set out = v - W Omega lambda, which changes no link's length; return its largest rate of a link."""
    return project_vector(system, velocity_nd, out_nd, multiplier_l, False)
