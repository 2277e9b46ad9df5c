"""The package's preparation: discs relaxed from random places, their contacts bonded and cut into fragments."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from packmech import check
from packmech.generate.fragments import SPANNING
from packmech.generate.random import generator_of
from packmech.validation.particle_shear.experiment import ParticleShear
from packmech.validation.particle_shear.material import Material, disc_radii
from packmech.validation.particle_shear.step import Preparation, ShearedDiscs, StepRules, advance

# a fragment of more than this part of the cell's height spans it
_HIGH = 0.9
# bonds are taken away until so many in a row could not be
_FAILURES = 1000
# steps of the package's first stage; all others are in proportion
_STEPS = 300


def bond_fragments(
    discs: ShearedDiscs,
    *,
    centers: int | None = None,
    lines: int | None = None,
    edge_fuzziness: float = 0.0,
    avoided_angle: float = 15.0,
    spanning: str = "avoided",
    cut_top_bottom: bool = False,
    removed_fraction: float = 0.0,
    seed: int | None = None,
    rng: np.random.Generator | None = None,
    tries: int = 1000,
) -> ShearedDiscs:
    """Return the discs with their contacts bonded and cut into fragments, in the package's order.

    All contacts become bonds; bonds are cut, and all that again while a fragment spans the height; bonds are taken
    away; discs without a bond get one. Fragments are what bonds inside the cell hold together: a bond through its
    boundary is a bond, but neither joins fragments nor counts for what a disc has. What was done goes along as
    `ShearedDiscs.preparation`.

    Parameters
    ----------
    discs
        Discs in contact, in an unstrained cell.
    centers
        Bonds are cut between discs that are nearest to different ones of so many random centers; 0: one bulk.
    lines
        Or bonds are cut that cross one of so many random straight lines.
    edge_fuzziness
        Up to this times the largest radius is added to each distance from a center [1].
    avoided_angle
        How near to the horizontal no line is drawn [degree].
    spanning
        "avoided": no fragment is higher than 0.9 of the cell; "allowed". One center, or no line, cannot avoid it.
    cut_top_bottom
        Whether bonds through the top and the bottom of the cell are cut.
    removed_fraction
        Share of the bonds inside the cell that is then taken away, by chance among those whose loss leaves fragments
        whole [1]; fewer where 1000 draws in a row find none.
    seed, rng
        Exactly one of them: a seed, or a generator. The same seed gives the same bits.
    tries
        How often cuts are drawn at most; the package has no limit.

    Raises
    ------
    ValueError
        Naming the argument; also where a fragment spans the height in all tries.

    Examples
    --------
    >>> loose = prepared_discs(ParticleShear(particles=30), seed=1, steps=10)
    >>> bonded = bond_fragments(loose, centers=4, seed=2)
    >>> int(loose.bonded_c.sum()), bonded.preparation.pieces, bool(bonded.bonded_c.any())
    (0, 4, True)

    """
    check.instance("discs", discs, ShearedDiscs)
    pieces = _pieces(centers, lines)
    fuzziness = check.real("edge_fuzziness", edge_fuzziness, at_least=0.0)
    angle = check.real("avoided_angle", avoided_angle, at_least=0.0, below=90.0)
    check.one_of("spanning", spanning, SPANNING)
    removed = check.real("removed_fraction", removed_fraction, at_least=0.0, at_most=1.0)
    check.boolean("cut_top_bottom", cut_top_bottom)
    rng = generator_of(seed, rng)
    avoided = spanning == "avoided" and pieces > (1 if lines is None else 0)
    found = _CellContacts(discs)
    for _ in range(check.integer("tries", tries, at_least=1)):
        bonded_c = np.ones(len(discs.contact_ck), dtype=bool)
        if cut_top_bottom:
            for height in (0.0, discs.height):
                bonded_c &= found.uncut((0.0, height), math.pi / 2.0)
        if lines is None:
            if pieces:
                bonded_c &= found.same_center(pieces, fuzziness, rng)
        else:
            for _ in range(pieces):
                bonded_c &= found.uncut(*found.line(angle, rng))
        if not avoided or found.heights(bonded_c).max() <= _HIGH * discs.height:
            break
    else:
        raise ValueError(
            "spanning must be 'allowed' (or take more centers or lines), "
            f"got a fragment above {_HIGH:g} of the height in each of {tries} tries"
        )
    gone = found.thin(bonded_c, removed, rng) if removed > 0.0 else 0.0
    found.join_isolated(bonded_c, rng)
    done = Preparation(
        pieces=pieces,
        by_centers=lines is None,
        avoided_angle=angle,
        no_spanning=avoided,
        cut_top_bottom=cut_top_bottom,
        removed_fraction=removed,
        removed=gone,
        edge_fuzziness=fuzziness,
    )
    kind_c = np.where(bonded_c, "bond", "slip")
    return discs.replace(kind_c=kind_c, history_ck=np.zeros((len(kind_c), 2)), preparation=done)


def prepared_discs(
    experiment: ParticleShear,
    *,
    seed: int,
    centers: int | None = None,
    lines: int | None = None,
    edge_fuzziness: float = 0.0,
    avoided_angle: float = 15.0,
    spanning: str = "avoided",
    cut_top_bottom: bool = False,
    removed_fraction: float = 0.0,
    radii: str = "coin flips",
    steps: int = _STEPS,
) -> ShearedDiscs:
    """Return relaxed discs for an experiment, at time 0, with plates at the top and the bottom, as the package does.

    From random places discs relax without plates, first without friction, in steps that get shorter. Then they are
    bonded, if they are to be, and relax again; at last with plates.

    Parameters
    ----------
    experiment
        Says how many discs, of which sizes, in which cell, and what their contacts are.
    seed
        Of all draws; the same seed gives the same bits.
    centers, lines, edge_fuzziness, avoided_angle, spanning, cut_top_bottom, removed_fraction
        As for `bond_fragments`; without centers and lines there are no bonds.
    radii
        "coin flips": each disc is large or small by chance, so that the packing fraction differs from draw to draw, as
        in the package; "equal numbers": half of each.
    steps
        Steps of the first stage; the others are as long in proportion. The package takes 300, and 30 in its tests.

    Examples
    --------
    >>> discs = prepared_discs(ParticleShear(particles=20), seed=1, steps=5)
    >>> discs.discs, discs.time, discs.strain
    (20, 0.0, 0.0)

    """
    check.instance("experiment", experiment, ParticleShear)
    first = check.integer("steps", steps, at_least=1)
    check.one_of("radii", radii, ("coin flips", "equal numbers"))
    rng = np.random.default_rng(check.integer("seed", seed, at_least=0))
    bonded = centers is not None or lines is not None
    if bonded:
        _pieces(centers, lines)
    material, relax = experiment.material, _PreparationStages(experiment, first)
    discs = relax.before_bonds(_random_discs(experiment, radii, rng))
    longest = experiment.longest_step
    if bonded:
        discs = bond_fragments(
            discs,
            centers=centers,
            lines=lines,
            edge_fuzziness=edge_fuzziness,
            avoided_angle=avoided_angle,
            spanning=spanning,
            cut_top_bottom=cut_top_bottom,
            removed_fraction=removed_fraction,
            rng=rng,
        )
        longest = min(2.0 * experiment.time_step, longest) / (2.0 if experiment.tangential_ratio > 5.0 else 1.0)
        discs = relax.after_bonds(discs, longest)
    else:
        discs = discs.replace(preparation=Preparation(bonded=False))
    return relax.with_plates(discs, material, longest).replace(time=0.0)


def _pieces(centers: int | None, lines: int | None) -> int:
    """Return the number of centers or of lines, whichever is given."""
    if (centers is None) == (lines is None):
        raise ValueError(f"centers must be given, or else lines, got {'neither' if centers is None else 'both'}")
    if centers is not None:
        return check.integer("centers", centers, at_least=0)
    return check.integer("lines", lines, at_least=0)


def _random_discs(experiment: ParticleShear, radii: str, rng: np.random.Generator) -> ShearedDiscs:
    """Return discs at random places, at whole numbers of um as the package has them."""
    count, width, height = experiment.particles, experiment.width, experiment.height
    large, small = disc_radii(
        count, experiment.packing_fraction, size_ratio=experiment.size_ratio, width=width, height=height
    )
    if radii == "coin flips":
        is_large_n = rng.random(count) < 0.5
    else:
        is_large_n = rng.permutation(count) < count / 2
    radius_n = np.where(is_large_n, large, small)
    # the package's masses: the model's at the mean radius of the two sizes
    mass_n = experiment.mass * radius_n**2 / (large * small)
    place_nd = np.stack([rng.integers(0, math.ceil(side), count) for side in (width, height)], axis=1)
    return ShearedDiscs(place_nd.astype(float), radius_n, mass_n, width=width, height=height)


class _PreparationStages:
    """The stages of the package's preparation."""

    def __init__(self, experiment: ParticleShear, first: int) -> None:
        self.experiment, self.first = experiment, first

    def steps(self, of_package: float) -> int:
        """Return the steps of a stage to which the package gives so many."""
        return max(1, int(of_package) * self.first // _STEPS)

    def before_bonds(self, discs: ShearedDiscs) -> ShearedDiscs:
        """Return random discs at rest; the package takes more rounds where little strain is to come."""
        made = self.experiment
        reinforced = made.reinforcement_normal != 1.0
        longest = (0.2 if made.relative_viscosity <= 0.1 else 0.25) * made.tau / made.size_ratio
        if made.packing_fraction > 2.0:
            longest /= 2.0
        for wanted in (True, made.amplitude <= 0.01 or made.tangential_ratio < 0.1):
            if wanted:
                discs = self.freely(discs, made.material, longest, 100 if reinforced else 300)
        for wanted in (True, made.amplitude <= 0.01 and not reinforced, made.amplitude <= 0.001 and not reinforced):
            if wanted:
                discs = self.freely(discs, made.material, made.longest_step, 100 if reinforced else 200)
        return discs

    def after_bonds(self, discs: ShearedDiscs, longest: float) -> ShearedDiscs:
        """Return bonded discs at rest."""
        made = self.experiment
        material = made.material
        slippery = material._replace(friction_coefficient=0.0)
        rounds = [(material, 300)]
        if made.amplitude < 0.1:
            rounds += [(slippery, 150), (material, 150)]
        for amplitude in (0.01, 0.001, 0.0001):
            if made.amplitude <= amplitude:
                rounds += [(material, 100), (slippery, 100), (material, 100)]
        for one, steps in rounds:
            discs = self.freely(discs, one, longest, steps)
        if made.amplitude <= 0.001 and (made.reinforcement_normal != 1.0 or made.reinforcement_tangential != 1.0):
            for one in (material, slippery, material):
                discs = self.freely(discs, one, longest / 3.0, 200)
        return discs

    def freely(self, discs: ShearedDiscs, material: Material, longest: float, of_package: int) -> ShearedDiscs:
        """Return the discs after one round without plates: long strongly cooled steps without friction first."""
        final, steps = self.experiment.time_step, np.zeros(self.steps(of_package))
        step, cooling = longest, 0.5
        slippery = material._replace(friction_coefficient=0.0)
        while step > final:
            discs = advance(discs, slippery, StepRules(step, cooling, plates=False), steps).final
            discs = discs.replace(velocity_nd=discs.velocity_nd - discs.velocity_nd.mean(axis=0))
            step, cooling = step / 2.0, (1.0 + cooling) / 2.0
        for made in (slippery, material):
            discs = advance(discs, made, StepRules(final, plates=False), steps).final
        return discs

    def with_plates(self, discs: ShearedDiscs, material: Material, longest: float) -> ShearedDiscs:
        """Return the discs after the stages with plates, which end with the experiment's own cooling."""
        made = self.experiment
        mu, strain = made.friction_coefficient, made.amplitude
        factor = (1.5 if mu <= 0.1 else 1.0) * (2.0 if mu <= 0.01 else 1.0) * (2.0 if mu <= 0.001 else 1.0)
        factor *= 1.0 - (math.log10(strain) + 2.0) if strain <= 0.01 else 1.0
        factor *= (2.0 if strain <= 0.005 else 1.0) * (2.0 if made.relative_viscosity <= 0.1 else 1.0)
        steps = self.steps(25 * int(factor))
        step, cooling = longest if longest > made.time_step else 10.0 * made.time_step, 0.5
        while step > made.time_step:
            discs = advance(discs, material, StepRules(step, cooling), np.zeros(max(steps // 2, 1))).final
            step, cooling = step / 2.0, (1.0 + cooling) / 2.0
        discs = advance(discs, material, StepRules(made.time_step, 0.98), np.zeros(2 * steps)).final
        return advance(discs, material, made.rules, np.zeros(steps)).final


class _CellContacts:
    """The contacts of discs in an unstrained cell, with their vectors to the nearest image."""

    def __init__(self, discs: ShearedDiscs) -> None:
        self.discs, self.pair_ck = discs, discs.contact_ck
        self.size = np.array([discs.width, discs.height])
        raw_cd = discs.position_nd[self.pair_ck[:, 1]] - discs.position_nd[self.pair_ck[:, 0]]
        self.vector_cd = raw_cd - np.floor(raw_cd / self.size + 0.5) * self.size
        # what the package calls physical neighbors
        self.inside_c = np.asarray((np.abs(raw_cd) < self.size / 2.0).all(axis=1))

    def same_center(self, centers: int, fuzziness: float, rng: np.random.Generator) -> NDArray[np.bool_]:
        """Return whether the discs of each contact have the same nearest center."""
        place = self.discs.position_nd
        apart = place[:, None] - rng.random((centers, 2)) * self.size
        apart -= np.round(apart / self.size) * self.size
        distance_nk = np.hypot(apart[..., 0], apart[..., 1])
        distance_nk += fuzziness * float(self.discs.radius_n.max()) * rng.random(distance_nk.shape)
        owner_n = distance_nk.argmin(axis=1)
        return np.asarray(owner_n[self.pair_ck[:, 0]] == owner_n[self.pair_ck[:, 1]])

    def line(self, avoided: float, rng: np.random.Generator) -> tuple[tuple[float, float], float]:
        """Return a point of a random line, at whole numbers of um, and the angle of its normal."""
        point = tuple(float(rng.integers(0, math.floor(side), endpoint=True)) for side in self.size)
        angle = 2.0 * math.pi * float(rng.random())
        while avoided > 0.0 and abs(abs(math.degrees(angle) - 180.0) - 90.0) <= avoided:
            angle = 2.0 * math.pi * float(rng.random())
        return (point[0], point[1]), angle

    def uncut(self, point: tuple[float, float], angle: float) -> NDArray[np.bool_]:
        """Return whether each contact stays on one side of a line, as seen from either disc."""
        normal = np.array([math.cos(angle), math.sin(angle)])
        side_n = (self.discs.position_nd - point) @ normal
        step_c = self.vector_cd @ normal
        i, j = self.pair_ck.T
        return np.asarray((side_n[i] * (side_n[i] + step_c) > 0.0) & (side_n[j] * (side_n[j] - step_c) > 0.0))

    def heights(self, bonded_c: NDArray[np.bool_]) -> NDArray[np.float64]:
        """Return the height of each fragment, from the bottom of its lowest disc to the top of its highest one."""
        fragment_n = self.fragments(bonded_c)
        y, r = self.discs.position_nd[:, 1], self.discs.radius_n
        top, bottom = np.full(fragment_n.max() + 1, -np.inf), np.full(fragment_n.max() + 1, np.inf)
        np.maximum.at(top, fragment_n, y + r)
        np.minimum.at(bottom, fragment_n, y - r)
        return top - bottom

    def fragments(self, bonded_c: NDArray[np.bool_]) -> NDArray[np.int64]:
        """Return the fragment of each disc."""
        i, j = self.pair_ck[bonded_c & self.inside_c].T
        count = self.discs.discs
        return np.asarray(connected_components(coo_array((np.ones(len(i)), (i, j)), shape=(count, count)))[1])

    def thin(self, bonded_c: NDArray[np.bool_], fraction: float, rng: np.random.Generator) -> float:
        """Take bonds away in place, each tried by a random disc and one of its bonds; return the share that went."""
        near: list[dict[int, int]] = [{} for _ in range(self.discs.discs)]
        for c in np.flatnonzero(bonded_c & self.inside_c).tolist():
            i, j = self.pair_ck[c].tolist()
            near[i][j] = near[j][i] = c
        count = sum(map(len, near)) // 2
        failures = taken = 0
        # a bond that holds its fragment together does so ever after
        essential: set[int] = set()
        while failures < _FAILURES and taken < fraction * count:
            failures += 1
            i = int(rng.integers(len(near)))
            if not near[i]:
                continue
            j, c = list(near[i].items())[int(rng.integers(len(near[i])))]
            if c in essential:
                continue
            del near[i][j], near[j][i]
            if _joined(near, i, j):
                bonded_c[c] = False
                taken, failures = taken + 1, 0
            else:
                essential.add(c)
                near[i][j] = near[j][i] = c
        return taken / count if count else 0.0

    def join_isolated(self, bonded_c: NDArray[np.bool_], rng: np.random.Generator) -> None:
        """Bond each disc that has no bond inside the cell to a random one that it touches, in place."""
        touching: list[list[int]] = [[] for _ in range(self.discs.discs)]
        for c, (i, j) in enumerate(self.pair_ck.tolist()):
            touching[i].append(c)
            touching[j].append(c)
        for contacts in touching:
            open_contacts = [c for c in contacts if not bonded_c[c]]
            if open_contacts and not any(bonded_c[c] and self.inside_c[c] for c in contacts):
                bonded_c[open_contacts[int(rng.integers(len(open_contacts)))]] = True


def _joined(near: list[dict[int, int]], start: int, end: int) -> bool:
    """Return whether a path of bonds leads from one disc to another."""
    seen, waiting = {start}, [start]
    while waiting:
        for one in near[waiting.pop()]:
            if one == end:
                return True
            if one not in seen:
                seen.add(one)
                waiting.append(one)
    return False
