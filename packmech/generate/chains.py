"""Random starting packings of chains: open, closed, around the box, branched; with free or fixed angles."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.box import Box
from packmech.check import finite_array, integer, one_of, positive, positive_array, real
from packmech.generate.clusters import CROSSING
from packmech.generate.random import box_for, generator_of, shape_of
from packmech.generate.sizes import Sizes, sizes_of
from packmech.generate.walks import Bonds, Plan, Walk, slither
from packmech.links import Links
from packmech.packing import Packing

FORMS = ("open", "ring", "wound")
_ANGLES = ("free", "fixed")

# links cannot hold angles of chains that bend less [rad]
_LEAST_BEND = 1e-6

# a pair of beads within a chain: first, second, and the image of the second
_Pair = tuple[int, int, tuple[int, ...]]


def chain_packing(
    count: int,
    beads: int,
    *,
    dimension: int,
    packing_fraction: float,
    link_length: float = 1.0,
    radii: ArrayLike | None = None,
    sizes: Sizes | None = None,
    angles: str | ArrayLike = "free",
    bend: float = 2.0 * math.pi / 3.0,
    form: str | Sequence[int] = "open",
    winding: Sequence[int] | None = None,
    seed: int | None = None,
    rng: np.random.Generator | None = None,
    box: Box | ArrayLike | None = None,
    crossing: str = "avoided",
    tries: int = 200,
) -> Packing:
    """Return chains grown as random walks from independent uniform places, at the packing fraction asked for.

    Beads overlap at random, as particles do in ``random_packing``. In two dimensions bonds do not cross: a chain steps
    back and grows another way where it finds no room. Open chains that find none at all, because long walks lock
    themselves in, start in rows instead and slither out of them for ten times their own length; they keep some of the
    rows' direction (nematic order of bonds about 0.3 for chains of 100 discs, 0.5 for 400, at a packing fraction of
    0.9). Closed and branched ones, and those with angles given, then want a lower packing fraction. The particles of a
    chain follow each other.

    Parameters
    ----------
    count, beads
        Number of chains, and of beads in each.
    dimension
        2 (discs) or 3 (spheres).
    packing_fraction
        Sum of the areas or volumes of all beads over that of the box [1]; what neighbors along a chain share, where
        links are shorter than the sum of their radii, counts twice.
    link_length
        Length of the bonds [length].
    radii
        Radius of all beads, or (beads,) along each chain, or (count * beads,) of all particles [length]; 0.5 when
        nothing is said.
    sizes
        Instead of ``radii``: a distribution from which the radii of all beads are drawn, in random order.
    angles
        ``"free"``: bonds only. ``"fixed"``: the angles between successive bonds are held as they came out, by a link
        between next neighbors but one along the chain (``shape_l``); dihedral angles stay free in three dimensions. A
        number or (beads - 2,) of them: the angles [rad] of an open chain, held; above 0 and below pi, because links
        cannot hold three beads on a line. No link is redundant: at a branch, and where a ring closes, only as many
        links are made as hold all angles.
    bend
        Largest angle between a bond and the one before it at the start, 0 for straight on [rad]; uniform below it
        (in three dimensions uniform over that cap of the sphere). The default keeps touching next neighbors but one
        from overlapping; 0.01 makes nearly straight chains.
    form
        ``"open"``; ``"ring"``: the last bead is linked to the first; ``"wound"``: it is linked to an image of the
        first, so that the chain winds around the box; or, for branched chains, the bead that each bead but the first
        follows: (0, 0, 0) is a star with three arms, (0, 1, 1) a fork.
    winding
        (d,) the image of the first bead that a wound chain ends at; one box along the first lattice vector when
        nothing is said.
    seed, rng
        Exactly one of them: a seed for ``numpy.random.default_rng``, or a generator. The same seed gives the same bits.
    box
        Shape of the box, a ``Box`` or (d, d) lattice vectors as columns; its size is set by the packing fraction.
        Square or cubic when nothing is said.
    crossing
        ``"avoided"`` or ``"allowed"``: whether bonds may cross in two dimensions.
    tries
        Number of proposals per bead, on average, before giving up.

    Raises
    ------
    TypeError, ValueError
        Naming the argument, what it must be and what came; also where a chain finds no room in ``tries`` tries.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.chain_packing(1, 30, dimension=2, packing_fraction=0.9, angles="fixed", seed=1)
    >>> len(packing.links), int(packing.links.shape_l.sum()), len(pm.crossing_links(packing))
    (57, 28, 0)

    """
    count = integer("count", count, at_least=1)
    beads = integer("beads", beads, at_least=2)
    dimension = integer("dimension", dimension, at_least=2, at_most=3)
    packing_fraction = positive("packing_fraction", packing_fraction)
    link_length = positive("link_length", link_length)
    parent_b, closing = _form(form, winding, beads, dimension)
    bend = real("bend", bend, at_least=0.0, at_most=math.pi)
    held, bend_b = _angles(angles, bend, beads, form)
    rng = generator_of(seed, rng)
    shape_dd = shape_of(box, dimension)
    one_of("crossing", crossing, CROSSING)
    tries = integer("tries", tries, at_least=1)
    radius_n = _radius_n(radii, sizes, count, beads, rng)

    scaled = box_for(radius_n, packing_fraction, shape_dd)
    around = () if closing is None else tuple(np.einsum("de,e->d", scaled.lattice_dd, np.array(closing)).tolist())
    reach = math.sqrt(math.fsum(x * x for x in around))
    if reach >= beads * link_length:
        least = math.floor(reach / link_length) + 1
        raise ValueError(f"beads must be at least {least} for a chain to reach around the box, got {beads}")
    plan = Plan(dimension, parent_b, link_length, bend, held, bend_b, closing, around)
    avoid = dimension == 2 and crossing == "avoided"
    bonds = Bonds(scaled, count * len(_bonds(plan)), link_length) if avoid else None
    walk = Walk(plan, rng, bonds)
    slithers = bonds is not None and isinstance(form, str) and form == "open" and bend_b is None
    places = walk.grow(count, scaled, max(1, tries // 10) if slithers else tries)
    if places is None and slithers and bonds is not None:
        bonds.take_back(0)
        places = slither(walk, bonds, count, scaled, tries)
    if places is None:
        raise ValueError(
            "bend must be larger, or crossing 'allowed', or the packing fraction lower where a chain finds no way, "
            f"got bend = {bend:g} and no way in {tries} tries per bead"
        )
    position_nd, image_nd = _folded(places, plan, scaled)
    links = _links(plan, count, position_nd, image_nd, scaled)
    return Packing(position_nd, radius_n, scaled, links).wrapped()


def _form(form: Any, winding: Any, beads: int, dimension: int) -> tuple[tuple[int, ...], tuple[int, ...] | None]:
    """Return the bead that each bead follows, -1 for the first, and the image at which the chain closes."""
    if winding is not None and not (isinstance(form, str) and form == "wound"):
        raise ValueError(f"winding must be left out unless form is 'wound', got {winding!r}")
    if isinstance(form, str) or not hasattr(form, "__len__"):
        one_of("form", form, FORMS)
        row = tuple(range(-1, beads - 1))
        if form == "open":
            return row, None
        if beads < 3:
            raise ValueError(f"beads must be at least 3 for a chain that closes, got {beads}")
        if form == "ring":
            return row, (0,) * dimension
        image = [1] + [0] * (dimension - 1) if winding is None else winding
        whole = finite_array("winding", image, shape=(dimension,), what="")
        if (whole != np.rint(whole)).any() or not whole.any():
            raise ValueError(f"winding must be whole numbers, not all 0, got {image!r}")
        return row, tuple(int(z) for z in whole)
    if len(form) != beads - 1:
        raise ValueError(f"form must name a bead for each bead but the first ({beads - 1}), got {len(form)}")
    follows = [integer(f"form[{k}]", bead, at_least=0, at_most=k) for k, bead in enumerate(form)]
    return (-1, *follows), None


def _angles(angles: Any, bend: float, beads: int, form: Any) -> tuple[bool, tuple[float, ...] | None]:
    """Return whether the angles are held, and the prescribed bend at each bead, if any."""
    if isinstance(angles, str):
        held = one_of("angles", angles, _ANGLES) == "fixed"
        if held and bend < _LEAST_BEND:
            raise ValueError(f"bend must be at least 1e-6 for angles that links can hold, got {bend:g}")
        return held, None
    if not (isinstance(form, str) and form == "open"):
        raise ValueError(f"angles must be 'free' or 'fixed' unless form is 'open', got {angles!r}")
    given = np.full(max(beads - 2, 1), positive("angles", angles)) if np.ndim(angles) == 0 else angles
    checked = positive_array("angles", given, shape=(None,), what="angle")
    if np.ndim(angles) and len(checked) != beads - 2:
        raise ValueError(f"angles must have one entry per inner bead ({beads - 2}), got {len(checked)}")
    straight = np.abs(checked - math.pi / 2) > math.pi / 2 - 1e-6
    if straight.any():
        k = int(np.flatnonzero(straight)[0])
        raise ValueError(f"angles must be at least 1e-6 away from 0 and pi, got {checked[k]:g} for angle {k}")
    return True, (0.0, *(math.pi - checked).tolist(), 0.0)


def _radius_n(
    radii: ArrayLike | None, sizes: Any, count: int, beads: int, rng: np.random.Generator
) -> NDArray[np.float64]:
    if sizes is not None:
        if radii is not None:
            raise ValueError(f"radii must be left out when sizes are given, got {radii!r}")
        return np.asarray(rng.permutation(sizes_of(sizes, sizes).radii(count * beads, rng)))
    if radii is None or np.ndim(radii) == 0:
        return np.full(count * beads, 0.5 if radii is None else positive("radii", radii))
    checked = positive_array("radii", radii, shape=(None,))
    if len(checked) not in (beads, count * beads):
        raise ValueError(
            f"radii must be one number, one for each bead of a chain ({beads}) or of all ({count * beads}), got "
            f"{len(checked)}"
        )
    return checked if len(checked) == count * beads else np.tile(checked, count)


def _bonds(plan: Plan) -> list[_Pair]:
    here = (0,) * plan.dimension
    pairs: list[_Pair] = [(plan.parent_b[k], k, here) for k in range(1, plan.beads)]
    return pairs if plan.closing is None else [*pairs, (plan.beads - 1, 0, plan.closing)]


def _angle_pairs(plan: Plan) -> list[_Pair]:
    """Return the pairs whose distances hold all angles, as many as that takes."""
    d, n = plan.dimension, plan.beads
    here = (0,) * d
    if plan.closing is None:
        near: list[list[int]] = [[] for _ in range(n)]
        for k in range(1, n):
            near[plan.parent_b[k]].append(k)
            near[k].append(plan.parent_b[k])
        # m bonds from one bead have m - 1 angles in a plane and 2 m - 3 in space: each to the first, or first two
        return [(min(a, b), max(a, b), here) for one in near for m, b in enumerate(one) for a in one[: min(m, d - 1)]]
    pairs: list[_Pair] = [(k, k + 2, here) for k in range(n - 2)] + [(n - 2, 0, plan.closing), (n - 1, 1, plan.closing)]
    # a ring turns as a whole; a chain around the box turns about the way it winds, which takes three dimensions
    rotations = (d - 1) * (d - 2) // 2 if any(plan.closing) else d * (d - 1) // 2
    return pairs[: max(0, d * n - d - rotations - n)]


def _folded(places: list[tuple[float, ...]], plan: Plan, box: Box) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Return positions in the cell, and the images by which they were moved there.

    Each link is laid off anew from where the one before ends in the cell, so that chains that lead far away lose no
    digits to the size of their coordinates.
    """
    free = np.array(places).reshape(-1, plan.beads, plan.dimension)
    position, image = np.empty_like(free), np.zeros(free.shape, dtype=np.int64)
    position[:, 0], image[:, 0] = box.wrap(free[:, 0])
    last = plan.beads if plan.closing is None else plan.beads - 1
    for bead in range(1, plan.beads):
        parent = plan.parent_b[bead]
        step = free[:, bead] - free[:, parent]
        if bead < last:
            step *= plan.link_length / np.sqrt(np.add.reduce(step**2, axis=1))[:, None]
        position[:, bead], moved = box.wrap(position[:, parent] + step)
        image[:, bead] = image[:, parent] + moved
    return position.reshape(-1, plan.dimension), image.reshape(-1, plan.dimension)


def _links(plan: Plan, count: int, position_nd: NDArray[np.float64], image_nd: NDArray[np.int64], box: Box) -> Links:
    bonds = _bonds(plan)
    pairs = bonds + (_angle_pairs(plan) if plan.held else [])
    shape = np.tile(np.arange(len(pairs)) >= len(bonds), count)
    step = np.repeat(plan.beads * np.arange(count), len(pairs))
    i = np.tile([pair[0] for pair in pairs], count) + step
    j = np.tile([pair[1] for pair in pairs], count) + step
    image = np.tile(np.array([pair[2] for pair in pairs]), (count, 1)) + image_nd[j] - image_nd[i]
    vector = position_nd[j] - position_nd[i] + np.einsum("de,le->ld", box.lattice_dd, image)
    length = np.where(shape, np.sqrt(np.add.reduce(vector**2, axis=1)), plan.link_length)
    return Links(i, j, image, length, shape)
