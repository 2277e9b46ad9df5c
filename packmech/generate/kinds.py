"""Kinds of particles, drawn with given shares or by size."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.calls.honors import honors
from packmech.check import brief, finite_array, instance, one_of
from packmech.generate.random import apportion, generator_of
from packmech.packing import DISCRETE_SIZES, MOST_KINDS, Packing, same_sizes

_BY = ("size",)


@honors("links shapes", packing_only=True)
def assign_kinds(
    packing: Packing,
    shares: Sequence[float] | ArrayLike | None = None,
    *,
    by: str | None = None,
    seed: int | None = None,
    rng: np.random.Generator | None = None,
) -> Packing:
    """Return the packing with kinds of particles: drawn with given shares, or by size.

    Everything else stays as it is. Kinds that are no matter of chance, such as those of layers, are given as numbers:
    ``packing.replace(kind_n=...)``.

    Parameters
    ----------
    packing
        The packing. Kinds that it has are replaced.
    shares
        (K,) share of the particles of kind 0, 1, and so on, none negative; they are divided by their sum [1]. Numbers
        of particles are exact, by largest remainders: each share is rounded down, and what is left goes to the
        largest remainders, the earlier kind first where they tie. Which particles these are is drawn, whether they are
        linked or not; bodies of rigid beads are particles.
    by
        "size" in place of shares: kind 0 are the smallest particles, kind 1 the next larger ones, and so on.
    seed, rng
        With shares exactly one of them: a seed for ``numpy.random.default_rng``, or a generator. The same seed gives
        the same kinds.

    Returns
    -------
    Packing
        With `kind_n`, and tangential displacements where it had some.

    Raises
    ------
    TypeError, ValueError
        Naming the argument; also where there are more than 64 kinds, or sizes of a continuous distribution.

    Examples
    --------
    >>> import packmech as pm
    >>> start = pm.random_packing(10, dimension=2, packing_fraction=0.9, seed=1)
    >>> np.bincount(pm.assign_kinds(start, (0.7, 0.3), seed=1).kind_n).tolist()
    [7, 3]
    >>> pm.assign_kinds(start, by="size").kind_n.tolist()
    [0, 0, 0, 0, 0, 1, 1, 1, 1, 1]

    """
    instance("packing", packing, Packing)
    if by is None:
        if shares is None:
            raise ValueError("shares must be given (or by='size'), got None")
        kind_n = _drawn(packing.particles, shares, generator_of(seed, rng))
    else:
        one_of("by", by, _BY)
        for name, value in {"shares": shares, "seed": seed, "rng": rng}.items():
            if value is not None:
                raise ValueError(f"{name} must be left out with by={by!r}, got {brief(value)}")
        kind_n = _by_size(packing)
    return packing.replace(kind_n=kind_n)


def _drawn(particles: int, shares: Sequence[float] | ArrayLike, rng: np.random.Generator) -> NDArray[np.int64]:
    """Return the (N,) kinds drawn with such shares."""
    share_k = finite_array("shares", shares, shape=(None,), what="kind")
    if len(share_k) > MOST_KINDS:
        raise ValueError(f"shares must be of at most {MOST_KINDS} kinds, got {len(share_k)}")
    if (share_k < 0.0).any():
        k = int(share_k.argmin())
        raise ValueError(f"shares must not be negative, got {share_k[k]:g} for kind {k}")
    if not share_k.any():
        raise ValueError("shares must not all be zero, got zeros")
    count_k = apportion(particles, tuple(share_k.tolist()))
    return rng.permutation(np.repeat(np.arange(len(share_k)), count_k))


def _by_size(packing: Packing) -> NDArray[np.int64]:
    """Return the (N,) kinds by radius, the smallest first."""
    order = np.argsort(packing.radius_n, kind="stable")
    class_n = np.empty(packing.particles, dtype=np.int64)
    class_n[order] = same_sizes(packing.radius_n[order])
    sizes = int(class_n.max()) + 1
    if sizes > MOST_KINDS:
        raise ValueError(f"packing must have at most {MOST_KINDS} sizes for kinds by size, got {sizes}")
    if sizes > DISCRETE_SIZES and 2 * sizes > packing.particles:
        raise ValueError(
            "packing must have a few sizes, of several particles each, for kinds by size, got a continuous "
            f"distribution: {sizes} sizes of {packing.particles} particles"
        )
    return class_n
