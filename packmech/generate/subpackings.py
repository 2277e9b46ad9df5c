"""Crystals that are others with particles left out: the reinforced kagome lattice, tunneled crystals, vacancies."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike

from packmech.check import instance, integer
from packmech.contacts import find_contacts
from packmech.generate.crystals import reinforced_kagome, tunneled
from packmech.generate.lattices import crystal_packing
from packmech.packing import Packing, without_links


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
    return crystal_packing(
        crystal,
        repeats,
        supercell=supercell,
        conventional=conventional,
        relative_overlap=relative_overlap,
        diameter=diameter,
    )


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
    return crystal_packing(
        tunneled(step_k), repeats, supercell=supercell, relative_overlap=relative_overlap, diameter=diameter
    )


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
    if not isinstance(apart, bool):
        raise TypeError(f"apart must be True or False, got {apart!r}")
    kept_n = np.ones(packing.particles, dtype=bool)
    order_n = rng.permutation(packing.particles)
    if not apart:
        kept_n[order_n[:count]] = False
    else:
        # pairs of a crystal touch to rounding
        contacts = find_contacts(packing, gap_tolerance=1e-9)
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
