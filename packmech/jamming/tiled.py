"""Whether a packing that is jammed in its box stays so when the box is repeated: for some repeats, or for all.

What is jammed in one box can unjam in copies of it (Donev, Torquato, Stillinger, J. Comput. Phys. 197, 139 (2004)).
Where forces that all push balance in the box, they balance in any number of copies, so that no motion opens a contact
there without closing another: copies are jammed exactly if no motion but translations keeps all contacts. Such motions
are sums of waves u exp(2 pi i f.n), f a fraction of the reciprocal lattice with the repeats as denominators, n the
number of the copy. Jammed for all repeats: the rows R(f) have full rank at every f but 0.

In a gauge of waves u exp(i k.x), rows of a contact with vector v are n.(u_j exp(i phi) - u_i exp(-i phi)), with
phi = k.v / 2. From one k to another they change by at most B max |change of phi|, B the norm of the rows with all
entries positive. So a smallest singular value s in the middle of a cell of wave vectors proves that it is positive all
over the cell, if phases change by less than s / B in it; cells where it does not are divided. Near k = 0, where s goes
to zero as |k|, a wave is a displacement gradient a k and a motion w within the box. With s1 the smallest singular value
of the rows with strains beside them, scaled by S,

    |R u| >= s1 sqrt(X^2 + W^2) - alpha X - beta W,    X = S |a| |k| / sqrt 2,    W = |w|,
    alpha = sqrt(2 C) |k|^2 v^3 / (24 S),    beta = B |k| v / 2 + |R(0)| (|k| v)^2 / 8,

with C contacts of length up to v: full rank where alpha^2 + beta^2 < s1^2.
"""

from __future__ import annotations

import itertools
import time
from dataclasses import replace
from math import lcm
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.box import Copies
from packmech.contacts import Contacts
from packmech.jamming.verdict import AMBIGUOUS, JAMMED, NOT_JAMMED, JammingAnswer, TiledAnswer, UnjammingMotion
from packmech.mechanics.rigidity import rigidity_matrix, strain_columns
from packmech.packing import Packing

# singular values below this are those of a motion that keeps all contacts [1]
_FLOPPY = 1e-9
# most cells of wave vectors that are looked at, and most unknowns of the dense matrices at each
_CELLS, LARGEST = 40_000, 1500
# largest number of copies in one direction that may be asked for, and up to how many are looked at one by one first
MOST_COPIES, _LOOKED_AT = 12, 16
# and the largest number of copies in all directions
MOST_WAVES = 1000
# parts of the bounds that are used, rounding left out
_SAFE = 0.999


class _StrainedRows(NamedTuple):
    """The rows of one box with strains beside them: what the bound for long waves is made of.

    Their smallest singular value s1 [1], the length S by which strains are divided, the number of contacts and the
    longest of these, and the norms B and |R(0)|.
    """

    smallest: float
    scale: float
    contacts: int
    longest: float
    bound: float
    largest: float

    def errors(self, k: float) -> tuple[float, float]:
        """Return alpha and beta at a wave vector of this length [1/length]."""
        v = self.longest
        alpha = np.sqrt(2.0 * self.contacts) * k**2 * v**3 / (24.0 * self.scale)
        return float(alpha), float(self.bound * k * v / 2.0 + self.largest * (k * v) ** 2 / 8.0)


class _Waves:
    """The rows of the contacts of a backbone at any wave vector."""

    def __init__(self, packing: Packing, network: Contacts, backbone_n: NDArray[np.bool_]) -> None:
        self.packing, self.network, self.backbone_n = packing, network, backbone_n
        self.d, self.count = packing.dimension, len(network)
        self.kept = np.flatnonzero(backbone_n)
        self.size = self.d * len(self.kept)
        place = np.zeros(packing.particles, dtype=np.int64)
        place[self.kept] = np.arange(len(self.kept))
        axes = np.arange(self.d)
        row = np.repeat(np.arange(self.count), self.d)
        self.at_i = row, (place[network.i_c][:, None] * self.d + axes).ravel()
        self.at_j = row, (place[network.j_c][:, None] * self.d + axes).ravel()
        self.normal = network.normal_cd.ravel()
        # phi = pi turn.f
        self.turn_cd = network.vector_cd @ packing.box.inverse_dd.T
        both = np.zeros((self.count, self.size))
        np.add.at(both, self.at_i, np.abs(self.normal))
        np.add.at(both, self.at_j, np.abs(self.normal))
        self.bound = float(np.linalg.norm(both, 2)) if both.size else 0.0

    def rows(self, fraction_d: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return the (C, n) rows at a wave vector, in the gauge of exp(i k.x)."""
        phase = np.repeat(np.exp(1j * np.pi * (self.turn_cd @ fraction_d)), self.d)
        found = np.zeros((self.count, self.size), dtype=complex)
        np.add.at(found, self.at_j, self.normal * phase)
        np.add.at(found, self.at_i, -self.normal * phase.conj())
        return found

    def smallest(self, fraction_d: NDArray[np.float64]) -> float:
        """Return the smallest singular value at a wave vector; 0 where there are fewer rows than columns."""
        if self.count < self.size:
            return 0.0
        return float(np.linalg.svd(self.rows(fraction_d), compute_uv=False)[-1])

    def floppy(self, fraction_d: NDArray[np.float64]) -> NDArray[np.complex128]:
        """Return the (n,) wave that changes the contacts least, in the gauge in which copies differ by phases."""
        wave = np.linalg.svd(self.rows(fraction_d))[2][-1].conj()
        inside = self.packing.position_nd[self.kept] @ self.packing.box.inverse_dd.T @ fraction_d
        return np.asarray(wave * np.repeat(np.exp(2j * np.pi * inside), self.d))

    def change(self, half_d: NDArray[np.float64]) -> float:
        """Return by how much singular values can differ from those in the middle of a cell of these half widths."""
        # chords are shorter than arcs
        return self.bound * float((np.pi * np.abs(self.turn_cd) @ half_d).max(initial=0.0)) / _SAFE

    def strained(self) -> _StrainedRows:
        """Return what the bound for long waves is made of."""
        d, network = self.d, self.network
        position = rigidity_matrix(self.packing, "none", contacts=network)
        moving = (self.kept[:, None] * d + np.arange(d)).ravel()
        rows = position[:, moving].toarray()
        strain = strain_columns(network)
        largest = float(np.linalg.norm(rows, 2))
        scale = float(np.linalg.norm(strain, 2)) / (largest or self.bound)
        translation = np.zeros((d, rows.shape[1] + strain.shape[1]))
        for a in range(d):
            translation[a, a : rows.shape[1] : d] = self.bound / np.sqrt(len(self.kept))
        values = np.linalg.svd(np.vstack([np.hstack([rows, strain / scale]), translation]), compute_uv=False)
        smallest = float(values[-1]) if len(values) == rows.shape[1] + strain.shape[1] else 0.0
        return _StrainedRows(smallest, scale, self.count, float(network.distance_c.max()), self.bound, largest)

    def long_waves(self) -> float:
        """Return up to which |k| there is full rank for sure [1/length]; 0 where no bound holds."""
        strained = self.strained()
        if not strained.smallest > _FLOPPY:
            return 0.0
        low, high = 0.0, np.pi / strained.longest
        for _ in range(60):
            k = 0.5 * (low + high)
            low, high = (k, high) if np.hypot(*strained.errors(k)) < _SAFE * strained.smallest else (low, k)
        return low

    def motion(self, fraction_d: NDArray[np.float64], repeats: tuple[int, ...]) -> tuple[Packing, UnjammingMotion]:
        """Return copies of the packing and a real motion of them that is the floppy wave."""
        wave = self.floppy(fraction_d)
        phase = np.exp(2j * np.pi * (Copies(repeats).place_md @ fraction_d))
        whole = np.zeros((len(phase), self.packing.particles, self.d), dtype=complex)
        whole[:, self.kept] = phase[:, None, None] * wave.reshape(-1, self.d)
        # of the real and the imaginary part the one that is no translation, the longer one
        parts = [whole.real, whole.imag]
        spread = [float(np.abs(one - one[:, self.kept].mean(axis=(0, 1))).max()) for one in parts]
        moved = parts[int(np.argmax(spread))]
        moved = moved / np.sqrt((moved**2).sum(axis=2)).max() * self.packing.reference_diameter
        change = self.stretch(moved, repeats)
        many = self.packing.repeated(repeats)
        d = self.d
        closing, opening = max(0.0, -float(change.min(initial=0.0))), max(0.0, float(change.max(initial=0.0)))
        return many, UnjammingMotion(moved.reshape(-1, d), np.zeros((d, d)), closing, opening)

    def stretch(self, moved_mnd: NDArray[np.float64], repeats: tuple[int, ...]) -> NDArray[np.float64]:
        """Return the changes of all contacts of copies, copy by copy [length]."""
        network = self.network
        other, _ = Copies(repeats).reached(network.image_cd)
        apart = moved_mnd[other, network.j_c[None]] - moved_mnd[:, network.i_c]
        return np.asarray((apart * network.normal_cd[None]).sum(axis=2).ravel())


def judge_tiled(
    packing: Packing,
    collectively: JammingAnswer,
    strictly: JammingAnswer,
    network: Contacts,
    backbone_n: NDArray[np.bool_],
    repeats: tuple[int, ...] | None,
) -> TiledAnswer:
    """Return whether a packing is jammed when its box is repeated.

    Parameters
    ----------
    packing, network, backbone_n
        The packing, the contacts of its backbone, and which particles these are.
    collectively, strictly
        Its answers, with contact forces where jammed. Copies are strictly jammed where they are collectively so and
        one box is strictly jammed: strains of all copies are waves of length infinity.
    repeats
        Largest numbers of copies to judge; None for all.

    """
    start = time.process_time()
    found = _judge(packing, collectively, network, backbone_n, repeats)
    strict = {JAMMED: strictly.verdict, NOT_JAMMED: NOT_JAMMED, AMBIGUOUS: AMBIGUOUS}[found.collective]
    if found.collective == AMBIGUOUS and strictly.verdict == NOT_JAMMED:
        strict = NOT_JAMMED
    return replace(found, strict=strict, seconds=time.process_time() - start)


def floppy_in_copies(
    packing: Packing, network: Contacts, backbone_n: NDArray[np.bool_], fraction_d: NDArray[np.float64]
) -> bool:
    """Return whether a wave at this wave vector keeps all contacts of a backbone."""
    return _Waves(packing, network, backbone_n).smallest(fraction_d) <= _FLOPPY


def _judge(
    packing: Packing,
    collectively: JammingAnswer,
    network: Contacts,
    backbone_n: NDArray[np.bool_],
    repeats: tuple[int, ...] | None,
) -> TiledAnswer:
    d = packing.dimension
    if collectively.verdict != JAMMED:
        moves = collectively.verdict == NOT_JAMMED
        return _answer(
            collectively.verdict,
            f"one box: {collectively.reason}",
            repeats=(1,) * d if moves else None,
            packing=packing if moves else None,
            motion=collectively.unjamming_motion,
        )
    if collectively.contact_force_c is None or not (collectively.contact_force_c > 0.0).all():
        return _answer(AMBIGUOUS, "one box is jammed, but no forces are known that push on every contact")
    if (size := d * int(backbone_n.sum())) > LARGEST:
        return _answer(AMBIGUOUS, f"{size} coordinates are more than the {LARGEST} that copies are judged with")
    waves = _Waves(packing, network, backbone_n)
    few = waves.count < waves.size
    # waves of few copies first: they name the smallest number that unjams
    few_first = _commensurate((MOST_COPIES,) * d, _LOOKED_AT) if repeats is None else _commensurate(repeats)
    for many, fraction in few_first:
        value = 0.0 if few else waves.smallest(fraction)
        if value > _FLOPPY:
            continue
        copies, motion = waves.motion(fraction, many)
        reason = f"{' x '.join(map(str, many))} copies have a motion that keeps all contacts"
        if few:
            reason += f": {waves.count} contacts are fewer than the {waves.size} coordinates, at any wave vector"
        return _answer(NOT_JAMMED, reason, many, fraction, value, fraction, packing=copies, motion=motion)
    if repeats is not None:
        return _answer(
            JAMMED, f"full rank at all wave vectors of up to {' x '.join(map(str, repeats))} copies", repeats
        )
    return _cover(waves)


def _words(fraction_d: NDArray[np.float64]) -> str:
    return "(" + ", ".join(f"{one:.4g}" for one in fraction_d) + ")"


def _answer(collective: str, *rest: Any, **more: Any) -> TiledAnswer:
    return TiledAnswer(collective, AMBIGUOUS, *rest, **more)


def _commensurate(limit: tuple[int, ...], most: int | None = None) -> list[tuple[tuple[int, ...], NDArray[np.float64]]]:
    """Return numbers of copies, few first, and the wave vectors that these have and fewer have not; one of f and -f.

    Parameters
    ----------
    limit
        Largest numbers of copies along each lattice vector.
    most
        Largest number of all copies; None: the product of the limits.

    """
    found = []
    for numbers in itertools.product(*(range(1, k + 1) for k in limit)):
        if most is not None and int(np.prod(numbers)) > most:
            continue
        for parts in itertools.product(*(range(k) for k in numbers)):
            fewer = any(int(np.gcd(p, k)) > 1 for p, k in zip(parts, numbers, strict=True) if k > 1)
            # f and -f are complex conjugates
            opposite = tuple((k - p) % k for p, k in zip(parts, numbers, strict=True))
            if any(parts) and not fewer and parts <= opposite:
                found.append((numbers, np.array(parts) / np.array(numbers)))
    return sorted(found, key=lambda one: (int(np.prod(one[0])), lcm(*one[0]), one[0], one[1].tolist()))


def _cover(waves: _Waves) -> TiledAnswer:
    """Return whether cells that cover all wave vectors prove full rank."""
    d = waves.d
    reciprocal = 2.0 * np.pi * waves.packing.box.inverse_dd
    long = waves.long_waves()
    if not long:
        reason = "strains without a cost in one box: waves are as soft as they are long, and no bound holds"
        return _answer(AMBIGUOUS, reason)
    # half of all wave vectors: the others are their complex conjugates
    cells = [(np.array([0.25, *[0.0] * (d - 1)]), np.array([0.25, *[0.5] * (d - 1)]))]
    lowest, nearest, used = np.inf, np.zeros(d), 0
    while cells:
        middle, half = cells.pop()
        corners = np.array([middle + sign * half for sign in itertools.product((-1.0, 1.0), repeat=d)])
        if np.sqrt(((corners @ reciprocal) ** 2).sum(axis=1)).max() <= long:
            continue
        used += 1
        if used > _CELLS:
            reason = f"{_CELLS} cells of wave vectors did not decide; the smallest singular value found is {lowest:.1e}"
            return _answer(AMBIGUOUS, reason, None, None, lowest, nearest, long, used)
        value = waves.smallest(middle)
        if value < lowest:
            lowest, nearest = value, middle
        if value <= _FLOPPY:
            reason = f"a wave at {_words(middle)} changes the contacts by {value:.0e} of itself, and fits no few copies"
            return _answer(AMBIGUOUS, reason, None, middle, value, middle, long, used)
        if value > waves.change(half):
            continue
        for sign in itertools.product((-0.5, 0.5), repeat=d):
            cells.append((middle + np.array(sign) * half, 0.5 * half))
    longest = 2.0 * np.pi / long / waves.packing.reference_diameter
    reason = (
        f"forces push on every contact, and full rank at every wave vector: {used} cells, smallest singular value "
        f"{lowest:.1e}, and a bound for waves longer than {longest:.3g} diameters"
    )
    return _answer(JAMMED, reason, None, None, lowest, nearest, long, used)
