"""Crystals a little off: one contact opened, one radius changed, all of it strained; what verdicts are tried on."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.box import Box
from packmech.check import instance, integer, real
from packmech.contacts import find_contacts
from packmech.packing import Packing

_TOUCHING = 1e-9
_STEPS = 12


def open_contact(packing: Packing, contact: int, gap: float) -> Packing:
    """Return a packing in which one contact has the given gap and every other one is closed, to rounding.

    A radius belongs to all contacts of its particle, so one contact opens only when several things change together:
    here positions, radii and the box all do, by the smallest changes (least squares, Newton's method). In crystals of
    discs that touch to triangles this is possible (a packing of discs has one more freedom for each triangle pair that
    becomes a quadrangle); where contacts outnumber positions, radii and strains it may not be.

    Parameters
    ----------
    packing
        Hard particles that touch to rounding, without rigid links.
    contact
        Number of the contact to open, as in ``find_contacts(packing, gap_tolerance=1e-9)``.
    gap
        Relative to the contact distance [1], from 0 to 0.01.

    Raises
    ------
    TypeError, ValueError
        Naming the argument; also when this contact cannot open while the others stay closed.

    Examples
    --------
    >>> import packmech as pm
    >>> crystal = pm.lattice_packing("triangular", repeats=(3, 3))
    >>> opened = pm.find_contacts(open_contact(crystal, 5, 1e-6), gap_tolerance=1e-3)
    >>> gap = opened.gap_c / opened.contact_distance_c
    >>> len(gap), round(float(gap[5]) * 1e6, 6), bool(abs(gap[:5]).max() < 1e-14)
    (27, 1.0, True)

    """
    instance("packing", packing, Packing)
    contacts = find_contacts(packing, gap_tolerance=_TOUCHING)
    contact = integer("contact", contact, at_least=0, at_most=len(contacts) - 1)
    target_c = np.zeros(len(contacts))
    target_c[contact] = real("gap", gap, at_least=0.0, at_most=0.01)
    n, d = packing.particles, packing.dimension
    i_c, j_c = contacts.i_c, contacts.j_c
    position_nd, radius_n, lattice_dd = packing.position_nd, packing.radius_n, packing.box.lattice_dd
    c = np.arange(len(contacts))
    pairs = [(a, b) for a in range(d) for b in range(a, d)]
    best = np.inf
    found = packing
    for _ in range(_STEPS):
        vector_cd = position_nd[j_c] - position_nd[i_c] + contacts.image_cd @ lattice_dd.T
        distance_c = np.sqrt((vector_cd**2).sum(axis=1))
        sum_c = radius_n[i_c] + radius_n[j_c]
        error_c = distance_c - (1.0 + target_c) * sum_c
        worst = float(np.abs(error_c / sum_c).max())
        if worst >= best:
            break
        best = worst
        found = packing.replace(position_nd=position_nd, radius_n=radius_n, box=Box(lattice_dd), links=None)
        normal_cd = vector_cd / distance_c[:, None]
        change = np.zeros((len(contacts), n * d + n + len(pairs)))
        for k in range(d):
            np.add.at(change, (c, j_c * d + k), normal_cd[:, k])
            np.add.at(change, (c, i_c * d + k), -normal_cd[:, k])
        for end in (i_c, j_c):
            np.add.at(change, (c, n * d + end), -(1.0 + target_c))
        for k, (a, b) in enumerate(pairs):
            change[:, n * d + n + k] = normal_cd[:, a] * vector_cd[:, b] * (1.0 if a == b else 2.0)
        step = np.linalg.lstsq(change, -error_c, rcond=1e-10)[0]
        strain_dd = np.zeros((d, d))
        for k, (a, b) in enumerate(pairs):
            strain_dd[a, b] = strain_dd[b, a] = step[n * d + n + k]
        position_nd = position_nd + position_nd @ strain_dd + step[: n * d].reshape(n, d)
        radius_n = radius_n + step[n * d : n * d + n]
        lattice_dd = lattice_dd + strain_dd @ lattice_dd
    # rounding of coordinates that reach across the box
    if best > 64 * np.spacing(float(np.abs(lattice_dd).max())) / float(radius_n.min()):
        raise ValueError(
            f"contact must be one that can open while the others stay closed, got {contact},"
            f" which leaves errors of {best:.1e} of the contact distances"
        )
    return found


def resize_particle(packing: Packing, particle: int, factor: float) -> Packing:
    """Return a packing with one radius multiplied: all contacts of that particle open or overlap.

    Parameters
    ----------
    packing
        The packing.
    particle
        Its number.
    factor
        New radius over old [1]; between equal particles 1 - g opens gaps of g/2.

    Raises
    ------
    TypeError, ValueError
        Naming the argument that is wrong.

    Examples
    --------
    >>> import packmech as pm
    >>> smaller = resize_particle(pm.lattice_packing("fcc", repeats=3), 4, 1 - 2e-6)
    >>> len(pm.find_contacts(smaller, gap_tolerance=0.9e-6)), len(pm.find_contacts(smaller, gap_tolerance=1.1e-6))
    (150, 162)

    """
    instance("packing", packing, Packing)
    particle = integer("particle", particle, at_least=0, at_most=packing.particles - 1)
    radius_n = packing.radius_n.copy()
    radius_n[particle] *= real("factor", factor, above=0.0)
    return packing.replace(radius_n=radius_n)


def random_strain(dimension: int, size: float, *, seed: int) -> NDArray[np.float64]:
    """Return a random symmetric strain whose largest eigenvalue is the given size, in magnitude.

    Parameters
    ----------
    dimension
        2 or 3.
    size
        Largest change of a length, relative [1].
    seed
        Draws it.

    Raises
    ------
    TypeError, ValueError
        Naming the argument that is wrong.

    """
    dimension = integer("dimension", dimension, at_least=2, at_most=3)
    size = real("size", size, above=0.0)
    drawn_dd = np.random.default_rng(integer("seed", seed, at_least=0)).standard_normal((dimension, dimension))
    strain_dd = drawn_dd + drawn_dd.T
    scaled: NDArray[np.float64] = strain_dd * (size / np.abs(np.linalg.eigvalsh(strain_dd)).max())
    return scaled


def strain_packing(packing: Packing, strain_dd: ArrayLike) -> Packing:
    """Return the packing strained affinely, radii kept.

    Parameters
    ----------
    packing
        The packing, without rigid links.
    strain_dd
        (d, d) strain: x becomes (1 + strain) x, and so does the box.

    Raises
    ------
    TypeError, ValueError
        Naming the argument that is wrong.

    Examples
    --------
    >>> import packmech as pm
    >>> stretched = strain_packing(pm.lattice_packing("square", repeats=2), 1e-3 * np.eye(2))
    >>> pm.find_contacts(stretched, gap_tolerance=0.01).gap_c.round(9).tolist()[:2]
    [0.001, 0.001]

    """
    instance("packing", packing, Packing)
    box = packing.box.strained(strain_dd)
    return packing.replace(position_nd=packing.position_nd + packing.position_nd @ np.asarray(strain_dd).T, box=box)
