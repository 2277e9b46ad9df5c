"""An independent referee: reads the certificate of a verdict from a file, and accepts or refuses what it claims.

It needs numpy and exact fractions, and nothing of what made the verdict: no search, no sparse matrix, no solver.

Jammed. Let M be the matrix of what a motion (displacements u, strain e) does to contacts, links and the volume: rows
v.(u_j - u_i) + v.e v for the vector v of a contact or a link, and the trace of e. If M has full rank besides
translations, and weights w of its rows balance, M^T w = 0, all positive but those of links, then no motion opens a
contact without closing another (Roth and Whiteley, Trans. Am. Math. Soc. 265, 419 (1981)). The given forces balance up
to a rest r = M^T w, which is found here in fractions, without rounding. Weights within |r| / s of them balance exactly,
where s bounds the smallest singular value of M from below. That bound is proven by a Cholesky factorization of
M^T M - c that goes through: errors of rounding are bounded for any order of sums (Demmel; Rump, BIT 46, 433 (2006)).

Not jammed. A motion is given; in fractions it closes no pair of the backbone by more than rounding, and all pairs that
touch were looked at. Where there is no backbone, particles are taken out one after the other that nothing holds.
"""

from __future__ import annotations

from fractions import Fraction
from itertools import combinations, product
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[Any]
Pairs = tuple[Array, Array, Array]
JAMMED, NOT_JAMMED, QUESTIONS = "jammed", "not jammed", ("collective", "strict")
_EPS = float(np.finfo(np.float64).eps)
# a motion closes a contact where it shortens it by more than this, of the largest displacement and box length [1]
_CLOSING = 1e3 * _EPS
# gaps and overlaps from which on pairs are no contacts [1]; images of a particle along one side that may touch it
WIDEST, _IMAGES = 0.1, 9
# largest number of unknowns, whose dense matrix takes 8 bytes for each pair
LARGEST = 12_000


class Refused(Exception):  # noqa: N818 - an answer, not a fault
    """A claim that was not proven; the message says why."""


def verify(path: Path) -> tuple[bool, str, str, tuple[str, ...], float, float, float, float]:
    """Return whether the certificate in a file is accepted, and the other fields of a `Verification`."""
    claim, proven = None, dict.fromkeys(QUESTIONS, "")
    reasons, figures, accepted = [], (0.0, 0.0, 0.0), True
    for question in QUESTIONS:
        says = "a certificate"
        try:
            claim = claim or _Claim(path)
            says = claim.verdicts[question]
            why = claim.prove_not_jammed(question) if says == NOT_JAMMED else "nothing claimed"
            if says == JAMMED:
                figures = claim.prove_jammed(question)
                why = "singular values at least {:.1e}; least weight {:.1e}, known to {:.0e}".format(*figures)
            proven[question] = says
            reasons.append(f"{question}: {says}: {why}" if says else f"{question}: {why}")
        # whatever else is wrong with a file or its numbers, nothing was proven
        except Exception as error:
            accepted = False
            why = str(error) if isinstance(error, Refused) else f"the file cannot be read: {error!r}"[:200]
            why = f"the array {error} is missing" if isinstance(error, KeyError) else why
            reasons.append(f"{question}: {says} is not proven: {why}")
    if proven["strict"] == JAMMED and proven["collective"] == NOT_JAMMED:
        accepted, reasons = False, [*reasons, "a packing that is strictly jammed is so collectively"]
    tolerance = 0.0 if claim is None else claim.tolerance
    reasons += [f"contacts: pairs with gaps or overlaps up to {tolerance:.1e} of their distance"] if claim else []
    accepted = accepted and any(proven.values())
    return accepted, proven["collective"], proven["strict"], tuple(reasons), tolerance, *figures


class _Claim:
    """What a file claims; positions and vectors are exact."""

    def __init__(self, path: Path) -> None:
        with open(path, "rb") as opened, np.load(opened, allow_pickle=False) as file:
            self.held = held = {name: file[name] for name in file.files}
        if str(held.get("kind")) != "certificate of jamming" or int(held.get("version", 0)) != 1:
            raise Refused("not a certificate of this kind and version")
        self.position_nd, self.lattice_dd = _numbers(held["position_nd"], 2), _numbers(held["lattice_dd"], 2)
        self.radius_n = _numbers(held["radius_n"], 1)
        n, self.d = self.position_nd.shape
        if self.d not in (2, 3) or self.lattice_dd.shape != (self.d, self.d) or self.radius_n.shape != (n,) or n == 0:
            raise Refused("positions, radii and lattice must be of one packing in two or three dimensions")
        if not (self.radius_n > 0.0).all() or not abs(np.linalg.det(self.lattice_dd)) > 0.0:
            raise Refused("radii and the volume must be positive")
        self.backbone_n = np.asarray(held["backbone_n"], dtype=bool)
        self.tolerance = float(held["gap_tolerance"])
        if self.backbone_n.shape != (n,) or not 0.0 <= self.tolerance < WIDEST:
            raise Refused(f"backbone and gap tolerance must be of the packing, the tolerance from 0 to below {WIDEST}")
        self.fixed_volume = str(held["strain"]) == "isochoric"
        self.pairs, self.links = _pairs(held, "c", n, self.d), _pairs(held, "l", n, self.d)
        if not (self.backbone_n[self.pairs[0]].all() and self.backbone_n[self.pairs[1]].all()):
            raise Refused("contacts must be between particles of the backbone")
        self.verdicts = {one: str(held[f"{one}_verdict"]) for one in QUESTIONS}
        if not all(one in ("", JAMMED, NOT_JAMMED) for one in self.verdicts.values()):
            raise Refused("a verdict must be jammed, not jammed or nothing")
        self.place_nd, self.cell_dd = _exact(self.position_nd), _exact(self.lattice_dd)
        # a power of two, so that no number changes by it
        self.unit = 2.0 ** np.round(np.log2(2.0 * self.radius_n.mean()))
        sigma = self.radius_n[self.pairs[0]] + self.radius_n[self.pairs[1]]
        gap = np.abs(_lengths(self.vectors(self.pairs)) / sigma - 1.0)
        if (gap > self.tolerance + 4.0 * _EPS).any():
            raise Refused(f"a contact has a gap or overlap of {gap.max():.1e}, beyond {self.tolerance:.1e}")
        self.touching = self.find_touching(_both_ways(self.links))

    def vectors(self, pairs: Pairs) -> Array:
        """Return the exact vectors from i to j."""
        i, j, image = pairs
        return np.asarray(self.place_nd[j] - self.place_nd[i] + image.astype(object) @ self.cell_dd.T)

    def rows(self) -> tuple[Array, Array, Array, Array]:
        """Return i, j and vectors of contacts and of links within the backbone, and which links these are."""
        direct = self.backbone_n[self.links[0]] & self.backbone_n[self.links[1]]
        i, j, image = (np.concatenate([one, two[direct]]) for one, two in zip(self.pairs, self.links, strict=True))
        return i, j, self.vectors((i, j, image)), direct

    def check_backbone(self, left: set[int]) -> None:
        """Refuse a backbone with particles that nothing holds, or, where there are no links, without some that are."""
        if not left.issuperset(np.flatnonzero(self.backbone_n).tolist()):
            raise Refused("particles of the backbone can be taken out")
        if not len(self.links[0]) and not all(self.backbone_n[n] for n in left):
            raise Refused("particles that are not in the backbone hold each other")

    def prove_jammed(self, question: str) -> tuple[float, float, float]:
        """Return the bound on singular values, the smallest weight and its error; or raise Refused."""
        d, count, kept = self.d, len(self.pairs[0]), np.flatnonzero(self.backbone_n)
        if d * len(kept) > LARGEST:
            raise Refused(f"{d * len(kept)} unknowns are more than the {LARGEST} that dense matrices are made for")
        self.check_backbone(self.held_together())
        force = _numbers(self.held[f"{question}_force_c"], 1)
        if not len(kept) or not count or force.shape != (count,) or not (force > 0.0).all():
            raise Refused("there must be a positive force for each contact, and contacts")
        i, j, vector, direct = self.rows()
        if len(self.links[0]):
            tension = _numbers(self.held[f"{question}_tension_l"], 1)
            if tension.shape != direct.shape or tension[~direct].any():
                raise Refused("links to particles that rattle bear a force: not judged")
            force = np.concatenate([force, -tension[direct]])
        weight = force / _lengths(vector) * self.unit / force[:count].mean()
        unit, pressing = Fraction(self.unit), np.inf
        push, net = _exact(weight)[:, None] * vector, np.zeros((len(self.position_nd), d), dtype=object)
        np.add.at(net, j, push)
        np.add.at(net, i, -push)
        rest = [one / unit for one in net.ravel()]
        strains = [(a, b) for a in range(d) for b in range(a, d)] if question == "strict" else []
        if strains:
            stress = push.T @ vector / unit**2
            volume = np.trace(stress) / d
            rest += [(2 - (a == b)) * (stress[a, b] - (a == b) * volume) for a, b in strains]
            pressing = np.inf if self.fixed_volume else float(volume)
        least = _smallest_singular_value(self.matrix(i, j, vector, kept, strains), len(kept), d)
        error = float(sum(one**2 for one in rest)) ** 0.5 * (1.0 + 1e-9) / least
        smallest = float(weight[:count].min())
        if not min(smallest, pressing) > error:
            raise Refused(f"the smallest weight, {min(smallest, pressing):.1e}, is known to {error:.1e} only")
        return least, smallest, error

    def matrix(self, i: Array, j: Array, vector: Array, kept: Array, strains: list[tuple[int, int]]) -> Array:
        """Return M, in units of the mean diameter; entries are exact to three roundings."""
        d, every, vector = self.d, np.arange(len(vector)), vector.astype(np.float64) / self.unit
        place = np.cumsum(self.backbone_n) - 1
        found = np.zeros((len(every) + bool(strains), d * len(kept) + len(strains)))
        for a in range(d):
            np.add.at(found, (every, d * place[j] + a), vector[:, a])
            np.add.at(found, (every, d * place[i] + a), -vector[:, a])
        for k, (a, b) in enumerate(strains, d * len(kept)):
            found[every, k] = (2 - (a == b)) * vector[:, a] * vector[:, b]
            found[-1, k] = a == b
        return found

    def prove_not_jammed(self, question: str) -> str:
        """Return what shows that particles can move; or raise Refused."""
        left = self.held_together()
        self.check_backbone(left)
        if not left:
            return "particles, or linked ones as a whole, can be taken out until none is left"
        motion = _numbers(self.held[f"{question}_displacement_nd"], 2)
        strain = _numbers(self.held[f"{question}_strain_dd"], 2)
        if motion.shape != self.position_nd.shape or strain.shape != (self.d, self.d) or not self.backbone_n.any():
            raise Refused("a motion must have a displacement for each particle, a strain, and a backbone")
        if not np.array_equal(strain, strain.T) or (strain.any() and question != "strict"):
            raise Refused("the strain must be symmetric, and zero where the box is fixed")
        apart, length = motion[self.backbone_n], float(np.abs(self.lattice_dd).sum())
        size = max(float(np.abs(apart - apart[0]).max()), float(np.abs(strain).max()) * length)
        limit = _CLOSING * size * length / self.unit
        if not size > 0.0 or float(np.trace(strain)) > limit / self.unit:
            raise Refused("the motion must be more than a translation, and must not enlarge the box")
        (i, j, vector, _), u, e = self.rows(), _exact(motion), _exact(strain)
        # v . (u_j - u_i) + v . e v, exact, over the length of v
        change = (vector * (u[j] - u[i] + vector @ e.T)).sum(axis=1)
        stretch, count = change.astype(np.float64) / _lengths(vector), len(self.pairs[0])
        closes = max(-float(stretch[:count].min(initial=0.0)), float(np.abs(stretch[count:]).max(initial=0.0)))
        if closes > limit:
            raise Refused(f"the motion closes a contact or stretches a link by {closes / size:.1e} of itself")
        listed = _both_ways(self.pairs)
        for one in self.touching:
            if self.backbone_n[one[0]] and self.backbone_n[one[1]] and one not in listed:
                raise Refused(f"particles {one[0]} and {one[1]} touch, and are not among the contacts")
        return f"a motion closes no pair by more than {closes / size:.0e} of itself"

    def find_touching(self, linked: set[tuple[int, ...]]) -> set[tuple[int, ...]]:
        """Return all pairs within the tolerance, by (i, j, image), but linked ones; refuse overlaps."""
        found, inverse = set(), np.linalg.inv(self.lattice_dd)
        turns = np.floor(self.position_nd @ inverse.T).astype(np.int64)
        wrapped = self.position_nd - turns @ self.lattice_dd.T
        farthest = 2.0 * self.radius_n.max() * (1.0 + self.tolerance)
        # so many images as the distance between faces of the box asks for
        reach = 1 + np.floor(farthest * np.sqrt((inverse**2).sum(axis=1))).astype(int)
        if (reach > _IMAGES).any():
            raise Refused("the box is thinner than a particle by far")
        deepest = self.tolerance + 8.0 * _EPS * (1.0 + farthest / self.radius_n.min())
        for image, (i, center) in product(product(*(range(-k, k + 1) for k in reach)), enumerate(wrapped)):
            apart = wrapped + self.lattice_dd @ np.array(image) - center
            gap = np.sqrt((apart**2).sum(axis=1)) / (self.radius_n + self.radius_n[i]) - 1.0
            for j in np.flatnonzero(gap <= self.tolerance + 8.0 * _EPS):
                pair = (i, int(j), *(np.array(image) - turns[j] + turns[i]).tolist())
                if (i < j or (i == j and image > (0,) * self.d)) and pair not in linked:
                    found.add(pair)
                    if gap[j] < -deepest:
                        raise Refused(f"particles {i} and {j} overlap by {-gap[j]:.1e}, beyond {self.tolerance:.1e}")
        return found

    def held_together(self) -> set[int]:
        """Return what is left when particles, or linked ones as a whole, that contacts do not hold are taken out."""
        group, d = np.arange(len(self.radius_n)), self.d
        while (group[self.links[0]] != group[self.links[1]]).any():
            np.minimum.at(group, self.links[0], group[self.links[1]])
            np.minimum.at(group, self.links[1], group[self.links[0]])
        around: dict[int, list[tuple[int, Array]]] = {int(n): [] for n in group}
        for i, j, *image in self.touching:
            vector = self.position_nd[j] - self.position_nd[i] + self.lattice_dd @ np.array(image)
            around[group[i]].append((group[j], vector / np.sqrt(vector @ vector)))
            around[group[j]].append((group[i], -vector / np.sqrt(vector @ vector)))
        left = set(around)
        while loose := {n for n in left if _is_loose(np.array([v for m, v in around[n] if m in left]), d)}:
            left -= loose
        return {n for n in range(len(group)) if group[n] in left}


def _is_loose(normal_cd: Array, d: int) -> bool:
    """Return whether a particle can move, or all its contacts lie in one closed half space."""
    if len(normal_cd) <= d:
        return True
    across = [np.array([-y, x]) for x, y in normal_cd] if d == 2 else [np.cross(*v) for v in combinations(normal_cd, 2)]
    return any((sign * (normal_cd @ one) >= -1e-8).all() for one in across for sign in (1, -1) if one @ one > 1e-24)


def _smallest_singular_value(matrix: Array, kept: int, d: int) -> float:
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


def _pairs(held: dict[str, Any], letter: str, n: int, d: int) -> Pairs:
    i, j, image = held[f"i_{letter}"], held[f"j_{letter}"], held[f"image_{letter}d"]
    if any(one.dtype.kind not in "iu" for one in (i, j, image)) or i.ndim != 1 or i.shape != j.shape:
        raise Refused("pairs must be whole numbers, as many of i as of j")
    if image.shape != (len(i), d) or (len(i) and (min(i.min(), j.min()) < 0 or max(i.max(), j.max()) >= n)):
        raise Refused("pairs must be of particles of the packing, with an image each")
    return i.astype(np.int64), j.astype(np.int64), image.astype(np.int64)


def _both_ways(pairs: Pairs) -> set[tuple[int, ...]]:
    """Return (i, j, image) of pairs, and the same from j to i."""
    every = [(int(i), int(j), image) for i, j, image in zip(*pairs, strict=True)]
    return {(i, j, *image.tolist()) for i, j, image in every} | {(j, i, *(-image).tolist()) for i, j, image in every}


def _lengths(vector: Array) -> NDArray[np.float64]:
    """Return the lengths of exact vectors; rounding follows once."""
    return np.asarray(np.sqrt((vector.astype(np.float64) ** 2).sum(axis=1)))


def _numbers(array: Array, dimensions: int) -> NDArray[np.float64]:
    found = np.asarray(array if array.dtype.kind in "iuf" else np.nan, dtype=np.float64)
    if found.ndim != dimensions or not (np.abs(found) < 1e100).all():
        raise Refused(f"numbers must be real and below 1e100, in {dimensions} dimensions")
    return found


def _exact(array: NDArray[np.float64]) -> Array:
    """Return the numbers as fractions, without rounding."""
    return np.array([Fraction(one) for one in array.ravel().tolist()], dtype=object).reshape(array.shape)
