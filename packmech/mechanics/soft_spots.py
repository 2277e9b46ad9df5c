"""Soft spots: particles that the low modes of a packing move most, where it is likely to give way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from packmech.calls.display import shown
from packmech.check import clear_errors, instance, integer
from packmech.mechanics.modes import Modes

# modes that are low, and particles that each of them marks
_LOW, _MARKED = 30, 20


@shown()
@dataclass(frozen=True, eq=False, repr=False)
class SoftSpots:
    """How much the modes of a packing move each of its particles; nan of those that took no part in the modes.

    With w the part of a mode on a particle, mass * (u.u + t.t), the modes that are zero left out (`Modes.zero_m`).

    Attributes
    ----------
    vibrality_n
        (N,) sums of w / omega^2 over all modes given [time^2]; times the temperature over the mass it is the mean
        square displacement of a particle that vibrates.
    participation_n
        (N,) means of w over the low modes [1].
    marks_n
        (N,) in how many of the low modes a particle is among the `particles` of largest w.
    modes, low
        How many modes were summed for the vibrality, and how many are low.
    complete
        Whether those are all modes that the packing has.

    """

    vibrality_n: NDArray[np.float64]
    participation_n: NDArray[np.float64]
    marks_n: NDArray[np.int64]
    modes: int
    low: int
    complete: bool

    @property
    def order_n(self) -> NDArray[np.int64]:
        """The particles that took part in the modes, that of the largest vibrality first."""
        falling = np.argsort(-self.vibrality_n, kind="stable")
        return np.asarray(falling[: np.count_nonzero(~np.isnan(self.vibrality_n))])

    def rank(self, particle: int) -> float:
        """Return the share of the other particles whose vibrality is below that of one: 1 for the softest [1].

        One half is what chance would give.
        """
        known = self.order_n
        place = np.flatnonzero(known == integer("particle", particle, at_least=0))
        if not len(place):
            raise ValueError(f"particle must be one that took part in the modes, got {particle}")
        return 1.0 - float(place[0]) / max(len(known) - 1, 1)

    def __repr__(self) -> str:
        first = self.order_n[:1].tolist()
        softest = f"particle {first[0]} is the softest, of vibrality {self.vibrality_n[first[0]]:.6g}" if first else ""
        among = "all" if self.complete else "the lowest"
        return f"SoftSpots of {len(self.vibrality_n)} particles by {among} {self.modes} modes: {softest or 'none'}"


@clear_errors
def soft_spots(modes: Modes, count: int | None = None, *, particles: int | None = None) -> SoftSpots:
    """Return how much the low modes of a packing move each particle, and its vibrality.

    Vibrality sums |e_i|^2 / omega^2 over modes, e of unit length in coordinates times the square root of the mass: the
    diagonal of the inverse of the dynamical matrix (Tong and Xu, Phys. Rev. E 90, 010401 (2014); compared with other
    indicators by Richard et al., Phys. Rev. Materials 4, 113609 (2020)). Participation is the mean of |e_i|^2 over the
    low modes (Widmer-Cooper et al., Nature Phys. 4, 711 (2008)); `marks_n` counts low modes in which a particle is
    among those that move most (Manning and Liu, Phys. Rev. Lett. 107, 108302 (2011)). Turns of shapes count as they do
    in the modes. Rattlers have none, unless `normal_modes` was to keep them: their own modes are zero, and left out.

    Parameters
    ----------
    modes
        Of `normal_modes`, from the lowest on, without unstable ones; all of them give the whole vibrality.
    count
        How many of the lowest modes count as low, the zero modes left out. None: 30, or all where there are fewer.
    particles
        How many particles each low mode marks. None: 20, or all where there are fewer.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, a mode is unstable, or lower ones than those given were left out.

    Examples
    --------
    >>> import packmech as pm
    >>> crystal = pm.lattice_packing("triangular", repeats=(4, 4)).replace(mass_n=[1.0] * 16)
    >>> modes = pm.normal_modes(pm.Scene(crystal, (pm.Repulsion(),)))
    >>> spots = pm.soft_spots(modes)
    >>> bool(abs(spots.vibrality_n.sum() / (1.0 / modes.eigenvalue_m).sum() - 1.0) < 1e-12)
    True

    """
    instance("modes", modes, Modes)
    if modes.below:
        raise ValueError(f"modes must begin with the lowest, got a window with {modes.below} below it")
    if modes.negative:
        raise ValueError(f"modes must be of a stable packing, got {modes.negative} unstable ones of {len(modes)}")
    some = ~modes.zero_m
    low = int(np.count_nonzero(some))
    if count is None:
        low = min(_LOW, low)
    elif integer("count", count, at_least=1) > low:
        raise ValueError(f"count must be at most the number of modes that are not zero, {low}, got {count}")
    else:
        low = count
    number = len(modes.index_n)
    if particles is None:
        marked = min(_MARKED, number)
    else:
        marked = integer("particles", particles, at_least=1)
        if marked > number:
            raise ValueError(f"particles must be at most those that took part in the modes, {number}, got {marked}")
    index = modes.index_n
    part_mk = modes.part_mn[some][:, index]
    total = len(modes.mass_n)
    vibrality, participation = np.full(total, np.nan), np.full(total, np.nan)
    marks = np.zeros(total, dtype=np.int64)
    vibrality[index] = (part_mk / modes.eigenvalue_m[some, None]).sum(axis=0)
    participation[index] = part_mk[:low].sum(axis=0) / max(low, 1)
    for part_k in part_mk[:low]:
        marks[index[np.argsort(-part_k, kind="stable")[:marked]]] += 1
    return SoftSpots(vibrality, participation, marks, len(part_mk), low, modes.complete)
