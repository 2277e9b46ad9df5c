"""Tangential displacements of contacts: what friction remembers of how particles slid and rolled on each other."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.calls.display import shown
from packmech.check import brief, finite_array, integer_array
from packmech.links import named_pairs

_OF_PAIRS = ("i_c", "j_c", "image_cd", "displacement_ck", "bead_c2", "rolling_ck", "twisting_c", "memory_ck")
_FIELDS = (*_OF_PAIRS, "at_wall_w", "wall_stretch_wk")


@shown()
@dataclass(frozen=True, eq=False)
class TangentialDisplacements:
    """Displacements of the tangential springs of a packing's contacts; each once, sorted by (i, j, image).

    They belong to the packing as it stands: a packing whose particles or box have changed has none. They act where
    the scene has friction, those at walls where its walls have, and are left out in others. The force on particle i is
    the tangential stiffness times the displacement of j's surface relative to i's.

    Parameters
    ----------
    i_c, j_c
        (C,) particles. Contacts are stored with i < j, or i == j and the image's first nonzero component positive.
    image_cd
        (C, d) integer vectors, for the positions as they stand in the packing: x_j - x_i + lattice @ image is the
        vector from center to center.
    displacement_ck
        In the plane (C, 1), along the tangent (-n_y, n_x) of the direction n from i to j; in space (C, 3) vectors
        [length].
    bead_c2
        (C, 2) beads of i and of j that touch, counted from 0 in each, where particles are rigid bodies (`Beads`): one
        pair of these has a spring for each pair of their beads, and n is the direction from bead to bead. None for
        other particles.
    rolling_ck, twisting_c
        (C, 1 or 3) and (C,) rolling and twisting displacements (`RollingResistance`, `TwistingResistance`) [length];
        None where nothing resists these.
    memory_ck
        (C, K) numbers that effects with a memory keep of the pairs, in the order of the scene's effects: of `JKR` and
        `CapillaryBridge` 0 of a pair that is not bound, of one that is (2 pi w R^2/E)^(2/3) [length^2] and 1. None
        where nothing is remembered.
    at_wall_w, wall_stretch_wk
        (W,) particles, each once, and (W, K) displacements of their springs at rough walls, in the order of the
        scene's effects, low before high: of each wall those of sliding (1 or 3), the stiffness that `Mindlin` keeps,
        rolling (1 or 3) and twisting (1), 0 for what it lacks [length]. Tangents are those of the direction to the
        wall. Of rough `MeshWalls` the same for each of the places that a sphere may touch at once, after the direction
        to it (3), 0 where there is none. None without.

    Raises
    ------
    TypeError, ValueError
        Naming the argument and the contact.

    Examples
    --------
    >>> springs = TangentialDisplacements([1], [0], [[0, 0, -1]], [[0.0, 0.1, 0.0]])
    >>> springs.i_c.tolist(), springs.image_cd.tolist(), springs.displacement_ck.tolist()
    ([0], [[0, 0, 1]], [[0.0, -0.1, 0.0]])

    """

    i_c: NDArray[np.int64]
    j_c: NDArray[np.int64]
    image_cd: NDArray[np.int64]
    displacement_ck: NDArray[np.float64]
    bead_c2: NDArray[np.int64] | None = None
    rolling_ck: NDArray[np.float64] | None = None
    twisting_c: NDArray[np.float64] | None = None
    memory_ck: NDArray[np.float64] | None = None
    at_wall_w: NDArray[np.int64] | None = None
    wall_stretch_wk: NDArray[np.float64] | None = None

    def __post_init__(self) -> None:
        site = None if self.bead_c2 is None else ("bead_c2", self.bead_c2)
        pairs = named_pairs("contact", "c", self.i_c, self.j_c, self.image_cd, site)
        components = 1 if pairs.image_pd.shape[1] == 2 else 3
        # nothing but springs at walls
        shape, alone = (len(pairs.i_p), components), self.at_wall_w is not None
        displacement = finite_array("displacement_ck", self.displacement_ck, shape=shape, what="contact", empty=alone)
        displacement = displacement[pairs.order_p]
        if components == 3:
            # seen from the other end a vector turns round; the tangent of a plane does, too, and its component stays
            displacement = np.where(pairs.turned_p[:, None], 0.0 - displacement, displacement)
        rolling, twisting = self.rolling_ck, self.twisting_c
        if rolling is not None:
            rolling = finite_array("rolling_ck", rolling, shape=shape, what="contact", empty=alone)[pairs.order_p]
            if components == 1:
                # of rolling it is the other way round
                rolling = np.where(pairs.turned_p[:, None], 0.0 - rolling, rolling)
        if twisting is not None:
            twisting = finite_array("twisting_c", twisting, shape=shape[:1], what="contact", empty=alone)[pairs.order_p]
        memory = self.memory_ck
        if memory is not None:
            rows = shape[0], None
            memory = finite_array("memory_ck", memory, shape=rows, what="contact", empty=alone)[pairs.order_p]
        kept: tuple[NDArray[Any] | None, ...] = (*pairs[:3], displacement, pairs.site_p2, rolling, twisting, memory)
        for name, given in zip(_FIELDS, (*kept, *self._checked_walls()), strict=True):
            if given is not None:
                array = np.ascontiguousarray(given)
                array.setflags(write=False)
                object.__setattr__(self, name, array)

    def _checked_walls(self) -> tuple[NDArray[Any] | None, NDArray[Any] | None]:
        """Return the particles at walls, sorted, and their displacements; None without."""
        if self.at_wall_w is None or self.wall_stretch_wk is None:
            for name, other in (("at_wall_w", self.wall_stretch_wk), ("wall_stretch_wk", self.at_wall_w)):
                if other is not None:
                    raise ValueError(f"{name} must be given with its displacements or particles, got None")
            return None, None
        particle = integer_array("at_wall_w", self.at_wall_w, shape=(None,), what="particle")
        if len(np.unique(particle)) < len(particle) or (len(particle) and particle.min() < 0):
            raise ValueError(f"at_wall_w must name particles from 0 on, each once, got {brief(particle.tolist())}")
        stretch = finite_array("wall_stretch_wk", self.wall_stretch_wk, shape=(len(particle), None), what="particle")
        order = np.argsort(particle)
        return particle[order], stretch[order]

    def __len__(self) -> int:
        return len(self.i_c)

    @property
    def springs(self) -> int:
        """Number of contacts, and of particles at rough walls, that have displacements."""
        return len(self) + (0 if self.at_wall_w is None else len(self.at_wall_w))

    def __eq__(self, other: object) -> bool:
        return isinstance(other, TangentialDisplacements) and all(
            np.array_equal(getattr(self, name), getattr(other, name)) for name in _FIELDS
        )

    def __hash__(self) -> int:
        return hash(tuple(one.tobytes() for one in self.arrays()))

    def arrays(self) -> tuple[NDArray[Any], ...]:
        """Return the arrays, in the order of the fields, without what is None."""
        return tuple(one for one in (getattr(self, name) for name in _FIELDS) if one is not None)

    @property
    def dimension(self) -> int:
        """Number of Cartesian axes, 2 or 3."""
        return int(self.image_cd.shape[1])

    def check_memory(self, columns: int) -> None:
        """Refuse numbers kept of pairs that are not as many as a scene's effects keep.

        Raises
        ------
        ValueError
            With both numbers.

        """
        if self.memory_ck is not None and self.memory_ck.shape[1] != columns:
            raise ValueError(
                f"packing.tangential.memory_ck must hold the {columns} numbers that the scene's effects keep of each "
                f"pair, got {self.memory_ck.shape[1]}"
            )

    def without_springs(self) -> TangentialDisplacements | None:
        """Return what is remembered of pairs alone, all springs slack; None where nothing is."""
        if self.memory_ck is None or not len(self):
            return None
        slack = np.zeros_like(self.displacement_ck)
        return TangentialDisplacements(self.i_c, self.j_c, self.image_cd, slack, memory_ck=self.memory_ck)

    def moved(self, image_nd: NDArray[np.int64]) -> TangentialDisplacements:
        """Return the same displacements after the particles were moved: x = new x + lattice @ image."""
        image = self.image_cd + image_nd[self.j_c] - image_nd[self.i_c]
        return dataclasses.replace(self, image_cd=image)

    def numbered(self, number_n: NDArray[np.int64]) -> TangentialDisplacements | None:
        """Return them with particles renumbered, without those of particles with a negative number; None if all go."""
        i, j = number_n[self.i_c], number_n[self.j_c]
        keep = (i >= 0) & (j >= 0)
        walls: dict[str, Any] = {}
        if self.at_wall_w is not None and self.wall_stretch_wk is not None:
            particle = number_n[self.at_wall_w]
            there = particle >= 0
            if there.any():
                walls = {"at_wall_w": particle[there], "wall_stretch_wk": self.wall_stretch_wk[there]}
        return self._replaced(i[keep], j[keep], keep, walls) if keep.any() or walls else None

    def _replaced(
        self, i_c: NDArray[np.int64], j_c: NDArray[np.int64], kept_c: NDArray[np.bool_], walls: dict[str, Any]
    ) -> TangentialDisplacements:
        """Return those that are kept, of other particles, and those at walls."""
        named = {name: one for name in _OF_PAIRS[2:] if (one := getattr(self, name)) is not None}
        return TangentialDisplacements(i_c, j_c, **{name: one[kept_c] for name, one in named.items()}, **walls)

    def at_walls(self, particles: int, columns: int) -> NDArray[np.float64]:
        """Return (N, K) displacements of the springs of all particles at walls, 0 where none are given.

        Raises
        ------
        ValueError
            If the walls of the scene have another number of them.

        """
        found = np.zeros((particles, columns))
        if self.at_wall_w is not None and self.wall_stretch_wk is not None:
            if self.wall_stretch_wk.shape[1] != columns:
                raise ValueError(
                    f"packing.tangential.wall_stretch_wk must hold the {columns} numbers that the scene's walls keep "
                    f"of each particle, got {self.wall_stretch_wk.shape[1]}: leave them out with "
                    "packing.replace(tangential=None)"
                )
            found[self.at_wall_w] = self.wall_stretch_wk
        return found
