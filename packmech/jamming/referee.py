"""An independent referee: reads the certificate of a verdict from a file, and accepts or refuses what it claims.

It needs numpy and fractions of whole numbers, and nothing of what made the verdict: no contact search, no sparse
matrix, no solver.

Jammed. Let M be the matrix of what a motion (displacements u, strain e) does to contacts, links and the volume: rows
v.(u_j - u_i) + v.e v for the vector v of a contact or a link, and the trace of e. If M has full rank besides
translations, and weights w of its rows balance, M^T w = 0, all positive but those of links, then no motion opens a
contact without closing another (Roth and Whiteley, Trans. Am. Math. Soc. 265, 419 (1981)). The given forces balance up
to a rest r = M^T w, which is found here in whole numbers, without rounding. Weights within |r| / s of them balance
exactly, where s bounds the smallest singular value of M from below. That bound is proven by a Cholesky factorization of
M^T M - c that goes through: errors of rounding are bounded for any order of sums (Demmel; Rump, BIT 46, 433 (2006)).

Not jammed. A motion is given; in whole numbers it closes no pair of the backbone by more than rounding, and all pairs
that touch were looked at. Where there is no backbone, particles are taken out one after the other that nothing holds.
"""

from __future__ import annotations

import zlib
from dataclasses import dataclass
from fractions import Fraction
from itertools import combinations, product
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

JAMMED, NOT_JAMMED, QUESTIONS = "jammed", "not jammed", ("collective", "strict")
_EPS = float(np.finfo(np.float64).eps)
# a motion closes a contact where it shortens it by more than this, of the largest displacement and box length [1]
_CLOSING = 1e3 * _EPS
# largest number of images of a particle along one side of the box that may touch it
_IMAGES = 9
# largest number of unknowns, whose dense matrix takes 8 bytes for each pair
LARGEST = 12_000


@dataclass(frozen=True)
class Verification:
    """What a referee says of a certificate.

    Attributes
    ----------
    accepted
        Whether all that it claims was proven, without what made it.
    collective, strict
        What was proven: "jammed", "not jammed", or "" where nothing was claimed or the proof failed.
    reasons
        A sentence on each question.
    gap_tolerance
        Up to which gaps and overlaps pairs were taken for contacts, in contact distances [1]: all is proven for these.
    smallest_singular_value
        What that of the rows of the strongest claim is at least, of unit vectors of contacts to within a factor of 2
        [1]; 0 where none was needed.
    smallest_weight, weight_error
        The smallest weight of a contact over their mean, and how far it may be from balance [1]; 0 where not needed.

    """

    accepted: bool
    collective: str
    strict: str
    reasons: tuple[str, ...]
    gap_tolerance: float = 0.0
    smallest_singular_value: float = 0.0
    smallest_weight: float = 0.0
    weight_error: float = 0.0

    def __bool__(self) -> bool:
        return self.accepted

    def __str__(self) -> str:
        """Return the answer and its reasons, one line each."""
        return "\n".join(("accepted" if self.accepted else "refused", *self.reasons))


class Refused(Exception):  # noqa: N818 - an answer, not a fault
    """A claim that was not proven; the message says why."""


# what bytes that were damaged, and sizes that were made up, raise
_ARCHIVE = (BadZipFile, zlib.error, NotImplementedError, RuntimeError, EOFError, OSError)
_UNREADABLE = (*_ARCHIVE, ValueError, KeyError, TypeError, IndexError, OverflowError, ZeroDivisionError, MemoryError)


def verify(path: Path) -> Verification:
    """Return whether a referee accepts the certificate in a file.

    Parameters
    ----------
    path
        What `write_certificate` wrote.

    """
    claim = None
    proven = dict.fromkeys(QUESTIONS, "")
    reasons, figures, accepted = [], (0.0, 0.0, 0.0), True
    for question in QUESTIONS:
        says = "a certificate"
        try:
            claim = claim or _Claim(path)
            says = claim.verdicts[question]
            if says == JAMMED:
                figures = claim.prove_jammed(question)
                why = (
                    f"singular values at least {figures[0]:.1e}, weights of {figures[1]:.1e} known to {figures[2]:.0e}"
                )
            else:
                why = claim.prove_not_jammed(question) if says else "nothing claimed"
            proven[question] = says
            reasons.append(f"{question}: {says}: {why}" if says else f"{question}: {why}")
        except (Refused, *_UNREADABLE) as error:
            accepted = False
            why = str(error) if isinstance(error, Refused) else f"the file cannot be read: {error!r}"[:200]
            why = f"the array {error} is missing" if isinstance(error, KeyError) else why
            reasons.append(f"{question}: {says} is not proven: {why}")
    if proven["strict"] == JAMMED and proven["collective"] == NOT_JAMMED:
        reasons.append("a packing that is strictly jammed is so collectively")
        accepted = False
    tolerance = 0.0 if claim is None else claim.tolerance
    if claim is not None:
        reasons.append(f"contacts: pairs with gaps or overlaps up to {tolerance:.1e} of their distance")
    answers = proven["collective"], proven["strict"]
    return Verification(accepted and any(answers), *answers, tuple(reasons), tolerance, *figures)


class _Claim:
    """What a file claims, in whole numbers: an integer times 2^-bits for each number."""

    def __init__(self, path: Path) -> None:
        with open(path, "rb") as opened, np.load(opened, allow_pickle=False) as file:
            held = {name: file[name] for name in file.files}
        if str(held["kind"]) != "certificate of jamming" or int(held["version"]) != 1:
            raise Refused("not a certificate of this kind and version")
        self.position_nd, self.radius_n = _numbers(held["position_nd"], 2), _numbers(held["radius_n"], 1)
        self.lattice_dd = _numbers(held["lattice_dd"], 2)
        n, self.d = self.position_nd.shape
        if self.d not in (2, 3) or self.lattice_dd.shape != (self.d, self.d) or self.radius_n.shape != (n,) or n == 0:
            raise Refused("positions, radii and lattice must be of one packing in two or three dimensions")
        if not (self.radius_n > 0.0).all() or not abs(np.linalg.det(self.lattice_dd)) > 0.0:
            raise Refused("radii and the volume must be positive")
        self.backbone_n = np.asarray(held["backbone_n"], dtype=bool)
        self.tolerance = float(held["gap_tolerance"])
        if self.backbone_n.shape != (n,) or not 0.0 <= self.tolerance < 0.1:
            raise Refused("backbone and gap tolerance must be those of the packing, the tolerance from 0 to 0.1")
        self.fixed_volume = str(held["strain"]) == "isochoric"
        self.pairs = _pairs(held, "c", n, self.d)
        self.links = _pairs(held, "l", n, self.d)
        if not (self.backbone_n[self.pairs[0]].all() and self.backbone_n[self.pairs[1]].all()):
            raise Refused("contacts must be between particles of the backbone")
        self.verdicts = {one: str(held[f"{one}_verdict"]) for one in QUESTIONS}
        if not all(one in ("", JAMMED, NOT_JAMMED) for one in self.verdicts.values()):
            raise Refused("a verdict must be jammed, not jammed or nothing")
        self.held = held
        self.bits = max(_bits(self.position_nd), _bits(self.lattice_dd))
        self.place_nd, self.cell_dd = _whole(self.position_nd, self.bits), _whole(self.lattice_dd, self.bits)
        # a power of two, so that no number changes by it
        self.unit = 2.0 ** np.round(np.log2(2.0 * self.radius_n.mean()))
        self.check_contacts()
        linked = {(int(i), int(j), *image.tolist()) for i, j, image in zip(*self.links, strict=True)}
        self.touching = self.find_touching(linked)

    def vectors(self, pairs: tuple[NDArray[Any], ...]) -> NDArray[Any]:
        """Return the exact vectors from i to j, in 2^-bits."""
        i, j, image = pairs
        return np.asarray(self.place_nd[j] - self.place_nd[i] + image.astype(object) @ self.cell_dd.T)

    def lengths(self, pairs: tuple[NDArray[Any], ...]) -> NDArray[np.float64]:
        """Return the lengths of these vectors; the vectors are exact, and rounding follows once."""
        vector = (self.vectors(pairs) / 2**self.bits).astype(np.float64).reshape(-1, self.d)
        return np.asarray(np.sqrt((vector**2).sum(axis=1)))

    def check_contacts(self) -> None:
        """Refuse contacts that do not touch."""
        sigma = self.radius_n[self.pairs[0]] + self.radius_n[self.pairs[1]]
        gap = np.abs(self.lengths(self.pairs) / sigma - 1.0)
        if (gap > self.tolerance + 4.0 * _EPS).any():
            raise Refused(
                f"contact {int(gap.argmax())} has a gap or overlap of {gap.max():.1e}, beyond {self.tolerance:.1e}"
            )

    def rows(self, strained: bool) -> tuple[NDArray[Any], NDArray[Any], NDArray[np.bool_]]:
        """Return i, j and vectors of contacts and of links within the backbone, and which links these are."""
        direct = self.backbone_n[self.links[0]] & self.backbone_n[self.links[1]]
        i, j, image = (np.concatenate([one, two[direct]]) for one, two in zip(self.pairs, self.links, strict=True))
        return np.stack([i, j]), self.vectors((i, j, image)), direct

    def prove_jammed(self, question: str) -> tuple[float, float, float]:
        """Return the bound on singular values, the smallest weight and its error; or raise Refused."""
        strained, d, count = question == "strict", self.d, len(self.pairs[0])
        kept = np.flatnonzero(self.backbone_n)
        if d * len(kept) > LARGEST:
            raise Refused(f"{d * len(kept)} unknowns are more than the {LARGEST} that dense matrices are made for")
        force = _numbers(self.held[f"{question}_force_c"], 1)
        if not len(kept) or not count or force.shape != (count,) or not (force > 0.0).all():
            raise Refused("there must be a positive force for each contact, and contacts")
        ends, vector, direct = self.rows(strained)
        if len(self.links[0]):
            tension = _numbers(self.held[f"{question}_tension_l"], 1)
            if tension.shape != direct.shape or tension[~direct].any():
                raise Refused("links to particles that rattle bear a force: not judged")
            force = np.concatenate([force, -tension[direct]])
        real = (vector / 2**self.bits).astype(np.float64)
        # weights are whatever numbers they come out as: the rest is found for these
        weight = force / np.sqrt((real**2).sum(axis=1)) * self.unit / force[:count].mean()
        bits = _bits(weight)
        whole = _whole(weight, bits)
        net = np.zeros((len(self.position_nd), d), dtype=object)
        np.add.at(net, ends[1], whole[:, None] * vector)
        np.add.at(net, ends[0], -whole[:, None] * vector)
        rest = [Fraction(int(one), 2 ** (bits + self.bits)) for one in net.ravel() if one]
        if strained:
            stress = sum(
                (w * np.multiply.outer(v, v) for w, v in zip(whole, vector, strict=True)), np.zeros((d, d), int)
            )
            volume = Fraction(int(np.trace(stress)), d)
            if not self.fixed_volume and volume <= 0:
                raise Refused("the contacts do not press against the box")
            scale = Fraction(self.unit) * 2 ** (bits + 2 * self.bits)
            unbalanced = [(2 - (a == b)) * (stress[a, b] - (a == b) * volume) for a in range(d) for b in range(a, d)]
            rest += [Fraction(one) / scale for one in unbalanced]
        # both in units of this length, rows as of the matrix below
        size = float(sum((one / Fraction(self.unit)) ** 2 for one in rest)) ** 0.5 * (1.0 + 1e-9)
        least = _smallest_singular_value(self.matrix(ends, real / self.unit, kept, strained), len(kept), d)
        error, smallest = size / least, float(weight[:count].min())
        pressing = float(volume / scale / Fraction(self.unit)) if strained and not self.fixed_volume else np.inf
        if not min(smallest, pressing) > error:
            raise Refused(f"the smallest weight, {min(smallest, pressing):.1e}, is known to {error:.1e} only")
        return least, smallest, error

    def matrix(
        self, ends: NDArray[Any], vector: NDArray[np.float64], kept: NDArray[Any], strained: bool
    ) -> NDArray[np.float64]:
        """Return the rows, in units of the mean diameter; entries are exact to three roundings."""
        d, rows = self.d, len(vector)
        place = np.full(len(self.position_nd), -1)
        place[kept] = np.arange(len(kept))
        strains = [(a, b) for a in range(d) for b in range(a, d)] if strained else []
        found = np.zeros((rows + bool(strains), d * len(kept) + len(strains)))
        for a in range(d):
            np.add.at(found, (np.arange(rows), d * place[ends[1]] + a), vector[:, a])
            np.add.at(found, (np.arange(rows), d * place[ends[0]] + a), -vector[:, a])
        for k, (a, b) in enumerate(strains):
            found[:rows, d * len(kept) + k] = (2 - (a == b)) * vector[:, a] * vector[:, b]
            found[-1, d * len(kept) + k] = a == b
        return found

    def prove_not_jammed(self, question: str) -> str:
        """Return what shows that particles can move; or raise Refused."""
        left = self.held_together()
        if not self.backbone_n.any():
            if left:
                raise Refused(f"{len(left)} particles hold each other, but no backbone is given")
            return "particles can be taken out one after the other until none is left"
        if not all(self.backbone_n[n] for n in left):
            raise Refused("particles that are not in the backbone hold each other")
        strained = question == "strict"
        motion = _numbers(self.held[f"{question}_displacement_nd"], 2)
        strain = _numbers(self.held[f"{question}_strain_dd"], 2)
        if motion.shape != self.position_nd.shape or strain.shape != (self.d, self.d):
            raise Refused("a motion must have a displacement for each particle, and a strain")
        if not np.array_equal(strain, strain.T) or (strain.any() and not strained):
            raise Refused("the strain must be symmetric, and zero where the box is fixed")
        apart = np.abs(motion[self.backbone_n] - motion[self.backbone_n][0]).max()
        length = float(np.abs(self.lattice_dd).sum())
        size = max(float(apart), float(np.abs(strain).max()) * length)
        limit = _CLOSING * size * length / self.unit
        if not size > 0.0 or float(np.trace(strain)) > limit / self.unit:
            raise Refused("the motion must be no translation, and must not enlarge the box")
        ends, vector, _ = self.rows(strained)
        bits = max(_bits(motion), _bits(strain))
        u, e = _whole(motion, bits), _whole(strain, bits)
        # v . (u_j - u_i) + v . e v, exact, over the length of v
        change = (vector * ((u[ends[1]] - u[ends[0]]) * 2**self.bits + vector @ e.T)).sum(axis=1) / 2 ** (
            bits + 2 * self.bits
        )
        stretch = change.astype(np.float64) / np.sqrt(((vector / 2**self.bits).astype(np.float64) ** 2).sum(axis=1))
        count = len(self.pairs[0])
        if float(stretch[:count].min(initial=0.0)) < -limit or float(np.abs(stretch[count:]).max(initial=0.0)) > limit:
            raise Refused(
                f"the motion closes a contact or stretches a link by {np.abs(stretch.min()) / size:.1e} of itself"
            )
        self.check_complete()
        closes = max(0.0, -float(stretch[:count].min(initial=0.0))) / size
        return f"a motion closes no pair by more than {closes:.0e} of itself"

    def find_touching(self, linked: set[tuple[int, ...]]) -> set[tuple[int, ...]]:
        """Return all pairs within the tolerance, by (i, j, image), but linked ones; refuse overlaps."""
        found: set[tuple[int, ...]] = set()
        turns = np.floor(self.position_nd @ np.linalg.inv(self.lattice_dd).T).astype(np.int64)
        wrapped = self.position_nd - turns @ self.lattice_dd.T
        farthest = 2.0 * self.radius_n.max() * (1.0 + self.tolerance)
        # so many images as the distance between faces of the box asks for
        reach = 1 + np.floor(farthest * np.sqrt((np.linalg.inv(self.lattice_dd) ** 2).sum(axis=1))).astype(int)
        if (reach > _IMAGES).any():
            raise Refused("the box is thinner than a particle by far")
        for image in product(*(range(-k, k + 1) for k in reach)):
            shift = self.lattice_dd @ np.array(image)
            for i in range(len(wrapped)):
                gap = (
                    np.sqrt(((wrapped + shift - wrapped[i]) ** 2).sum(axis=1)) / (self.radius_n + self.radius_n[i])
                    - 1.0
                )
                for j in np.flatnonzero(gap <= self.tolerance + 8.0 * _EPS):
                    pair = (i, int(j), *(np.array(image) - turns[j] + turns[i]).tolist())
                    if (i < j or (i == j and tuple(image) > (0,) * self.d)) and pair not in linked:
                        found.add(pair)
                        if gap[j] < -self.tolerance - 8.0 * _EPS * (1.0 + farthest / self.radius_n.min()):
                            raise Refused(
                                f"particles {i} and {j} overlap by {-gap[j]:.1e}, beyond {self.tolerance:.1e}"
                            )
        return found

    def check_complete(self) -> None:
        """Refuse a list that leaves out a pair of the backbone that touches, or that links do not hold."""
        listed: set[tuple[int, ...]] = set()
        for i, j, image in [*zip(*self.pairs, strict=True), *zip(*self.links, strict=True)]:
            forward = image.tolist()
            listed |= {(int(i), int(j), *forward), (int(j), int(i), *(-image).tolist())}
        for one in self.touching:
            if self.backbone_n[one[0]] and self.backbone_n[one[1]] and one not in listed:
                raise Refused(f"particles {one[0]} and {one[1]} touch, and are not among the contacts")

    def held_together(self) -> set[int]:
        """Return what is left when particles that their contacts do not hold are taken out one after the other."""
        left = set(range(len(self.radius_n)))
        if len(self.links[0]):
            return set(np.flatnonzero(self.backbone_n).tolist()) if self.backbone_n.any() else left
        around: dict[int, list[tuple[int, NDArray[np.float64]]]] = {n: [] for n in left}
        for i, j, *image in self.touching:
            vector = self.position_nd[j] - self.position_nd[i] + self.lattice_dd @ np.array(image)
            around[i].append((j, vector / np.sqrt(vector @ vector)))
            around[j].append((i, -vector / np.sqrt(vector @ vector)))
        while loose := {n for n in left if _is_loose(np.array([v for m, v in around[n] if m in left]), self.d)}:
            left -= loose
        return left


def _is_loose(normal_cd: NDArray[np.float64], d: int) -> bool:
    """Return whether a particle can move, or all its contacts lie in one closed half space."""
    if len(normal_cd) <= d:
        return True
    sets = [(np.array([-v[1], v[0]]),) if d == 2 else () for v in normal_cd]
    candidates = [c for one in sets for c in one] or [np.cross(*two) for two in combinations(normal_cd, 2)]
    return any(
        (sign * (normal_cd @ one) >= -1e-8).all() for one in candidates for sign in (1.0, -1.0) if (one @ one) > 1e-24
    )


def _smallest_singular_value(matrix: NDArray[np.float64], kept: int, d: int) -> float:
    """Return what the smallest singular value besides translations is at least, rounding included; or raise Refused."""
    rows, n = matrix.shape
    gram = matrix.T @ matrix
    for a in range(d):
        gram[a : d * kept : d, a : d * kept : d] += 1.0 / kept
    size = np.abs(matrix)
    # entries of the matrix to three roundings, sums of rows + d terms in any order
    wrong = (rows + 20) * _EPS * (float((size.T @ size.sum(axis=1)).max()) + 1.0)
    factored = (n + 20) * _EPS * float(np.trace(gram))
    shift = 4.0 * (wrong + factored)
    if not np.isfinite(shift):
        raise Refused("numbers are too large to be added up")
    gram[np.diag_indices(n)] -= shift
    try:
        np.linalg.cholesky(gram)
    except np.linalg.LinAlgError:
        raise Refused(f"no full rank: a motion changes contacts by less than {shift**0.5:.0e} of itself") from None
    return float(np.sqrt(0.5 * (shift - wrong - factored)))


def _pairs(held: dict[str, Any], letter: str, n: int, d: int) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any]]:
    i, j, image = held[f"i_{letter}"], held[f"j_{letter}"], held[f"image_{letter}d"]
    if any(one.dtype.kind not in "iu" for one in (i, j, image)) or i.ndim != 1 or i.shape != j.shape:
        raise Refused("pairs must be whole numbers, as many of i as of j")
    if image.shape != (len(i), d) or (len(i) and (min(i.min(), j.min()) < 0 or max(i.max(), j.max()) >= n)):
        raise Refused("pairs must be of particles of the packing, with an image each")
    return i.astype(np.int64), j.astype(np.int64), image.astype(np.int64)


def _numbers(array: NDArray[Any], dimensions: int) -> NDArray[np.float64]:
    found = np.asarray(array, dtype=np.float64)
    if found.ndim != dimensions or not (np.abs(found) < 1e100).all():
        raise Refused(f"numbers must be below 1e100, in {dimensions} dimensions")
    return found


def _bits(array: NDArray[np.float64]) -> int:
    """Return the smallest number b for which all entries times 2^b are whole."""
    return max((one.as_integer_ratio()[1].bit_length() - 1 for one in array.ravel().tolist()), default=0)


def _whole(array: NDArray[np.float64], bits: int) -> NDArray[Any]:
    """Return the entries times 2^bits, as whole numbers."""
    found = np.empty(array.shape, dtype=object)
    for place, one in zip(np.ndindex(array.shape), array.ravel().tolist(), strict=True):
        top, bottom = one.as_integer_ratio()
        found[place] = top * (2**bits // bottom)
    return found
