"""Lattices with defects: vacancies, tunnels, reinforcement, opened contacts."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.box import Box
from packmech.check import instance, integer, real
from packmech.contacts import find_contacts
from packmech.generate.lattices import crystal_packing, reinforced_kagome, tunneled
from packmech.packing import Packing, without_links

# pairs of a crystal touch to rounding: the gap up to which they count
_TOUCHING = 1e-9
# steps of Newton's method that open a contact
_STEPS = 12


def reinforced_kagome_packing(
    cells: int,
    repeats: int | Sequence[int] | None = None,
    *,
    supercell: ArrayLike | None = None,
    conventional: bool = False,
    relative_overlap: float = 0.0,
    diameter: float = 1.0,
) -> Packing:
    """Return a kagome lattice with one row and one column of discs more in every so many cells.

    Where the kagome lattice leaves out the sites with two odd numbers of the triangular lattice, here two rows without
    vacancies lie side by side after every `cells` cells along each lattice vector: (2 c + 1)^2 - c^2 discs in a
    cell of side 2 c + 1. Strictly jammed, at a packing fraction that falls to that of the kagome lattice,
    sqrt(3) pi/8 = 0.680, as c grows (Donev, Torquato, Stillinger and Connelly, J. Comput. Phys. 197, 139 (2004), figure
    10).

    Parameters
    ----------
    cells
        Kagome cells c between two reinforcements, at least 1.
    repeats, supercell, conventional, relative_overlap, diameter
        As for `lattice_packing`; the cell is the one of side 2 c + 1.

    Raises
    ------
    TypeError, ValueError
        Naming the argument, for cells below 1 and what `lattice_packing` refuses.

    Examples
    --------
    >>> packing = reinforced_kagome_packing(3)
    >>> packing.particles, packing.box.lattice_dd[:, 0].round(12).tolist()
    (40, [7.0, 0.0])

    """
    crystal = reinforced_kagome(integer("cells", cells, at_least=1))
    return crystal_packing(crystal, repeats, supercell, conventional, relative_overlap, diameter)


def tunneled_packing(
    steps: Sequence[int],
    repeats: int | Sequence[int] | None = None,
    *,
    supercell: ArrayLike | None = None,
    relative_overlap: float = 0.0,
    diameter: float = 1.0,
) -> Packing:
    """Return a tunneled crystal: honeycomb layers, stacked so that their vacancies form self-avoiding tunnels.

    Each layer is a close-packed one less the middle of every hexagon. The next one lies sqrt(2/3) diameters higher,
    shifted by 1/sqrt 3 of a diameter in one of six directions: the step k points 30 + 60 k degrees from a contact, and
    leads the tunnels there. Every sphere touches three others in its layer, two above and two below, whatever the
    steps. The packing fraction is sqrt(2) pi/9 = 0.494, two thirds of the densest (Torquato and Stillinger, J. Appl.
    Phys. 102, 093511 (2007)).

    The source, whose crystals are among these (it counts two kinds of coordination, of four here), calls them strictly
    jammed. In periodic boxes they are not. A cell of L layers has 7 L contacts and 6 L - 3 + 6 ways to
    move and strain, and strict jamming needs one row more than these, the volume's included: too many for L = 1 and 2.
    For every choice of steps up to L = 5 the cell has floppy strains at fixed volume. They change no contact to first
    order, so lengthen it to second, while the volume shrinks to second order: the crystals shear into denser ones.

    Parameters
    ----------
    steps
        From each layer to the next, 0 to 5. A single step, ``(0,)``, is part of the fcc crystal with straight
        tunnels; ``(0, 3)`` of the hcp crystal. Even and odd steps are the two ways to stack close-packed layers.
    repeats, supercell, relative_overlap, diameter
        As for `lattice_packing`; the primitive cell holds two spheres of each layer. Its third vector is the sum of the
        steps.

    Raises
    ------
    TypeError, ValueError
        Naming the argument, for steps other than 0 to 5 and what `lattice_packing` refuses.

    Examples
    --------
    >>> packing = tunneled_packing((0, 3), repeats=(2, 2, 1))
    >>> packing.particles, round(packing.box.volume * 2**0.5 / packing.particles, 12)
    (16, 1.5)

    """
    if isinstance(steps, str) or not isinstance(steps, (list, tuple, np.ndarray)):
        raise TypeError(f"steps must be a sequence of integers, got {steps!r}")
    if not len(steps):
        raise ValueError("steps must hold at least 1 integer, got none")
    step_k = [integer(f"steps[{k}]", step, at_least=0, at_most=5) for k, step in enumerate(steps)]
    return crystal_packing(tunneled(step_k), repeats, supercell, False, relative_overlap, diameter)


def vacancy_packing(packing: Packing, vacancies: int, *, seed: int, apart: bool = False) -> Packing:
    """Return a packing without so many of its particles, drawn at random.

    Parameters
    ----------
    packing
        The packing, without rigid links.
    vacancies
        Number of particles to leave out, at least 1 and fewer than there are.
    seed
        Draws them: the same seed, the same vacancies.
    apart
        Whether no two vacancies may touch: they are drawn one by one among the particles that touch no earlier one.

    Raises
    ------
    TypeError, ValueError
        Naming the argument; also when so many vacancies find no room apart.

    Examples
    --------
    >>> import packmech as pm
    >>> crystal = pm.lattice_packing("triangular", repeats=(5, 5))
    >>> vacancy_packing(crystal, 3, seed=0, apart=True).particles
    22

    """
    instance("packing", packing, Packing)
    without_links("packing", packing)
    count = integer("vacancies", vacancies, at_least=1)
    if count >= packing.particles:
        raise ValueError(f"vacancies must be fewer than the particles ({packing.particles}), got {count}")
    rng = np.random.default_rng(integer("seed", seed, at_least=0))
    instance("apart", apart, bool)
    kept_n = np.ones(packing.particles, dtype=bool)
    order_n = rng.permutation(packing.particles)
    if not apart:
        kept_n[order_n[:count]] = False
    else:
        contacts = find_contacts(packing, gap_tolerance=_TOUCHING)
        free_n = np.ones(packing.particles, dtype=bool)
        for k in order_n:
            if free_n[k] and np.count_nonzero(~kept_n) < count:
                kept_n[k] = False
                free_n[contacts.j_c[contacts.i_c == k]] = False
                free_n[contacts.i_c[contacts.j_c == k]] = False
        found = np.count_nonzero(~kept_n)
        if found < count:
            raise ValueError(f"vacancies must find room apart from each other, got {count}, with room for {found} here")
    return Packing(packing.position_nd[kept_n], packing.radius_n[kept_n], packing.box)


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
    without_links("packing", packing)
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
        best, found = worst, Packing(position_nd, radius_n, Box(lattice_dd))
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
    without_links("packing", packing)
    box = packing.box.strained(strain_dd)
    return packing.replace(position_nd=packing.position_nd + packing.position_nd @ np.asarray(strain_dd).T, box=box)
