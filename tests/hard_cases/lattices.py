"""Hard cases of crystals: contacts opened by 1e-4 to 1e-12 or taken away, radii and boxes a little off, tiny cells.

What the verdict must be follows from its definition and from three networks: the pairs within a tenth of the gap
tolerance, within it, and within ten times. More contacts never unjam. So where the network with the fewest pairs is
jammed the answer is "jammed", where the one with the most is not it is "not jammed", and in between no one can say:
"ambiguous". Hard particles that touch to rounding are judged at 1e-10, 1e-9 and 1e-8.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterable, Iterator
from functools import partial

import numpy as np
from numpy.typing import NDArray

import packmech as pm
from hard_cases.case import HardCase
from hard_cases.defects import open_contact, random_strain, resize_particle, strain_packing
from packmech.jamming.classify import METHODS
from packmech.jamming.contact_selection import MINIMUM_GAP_TOLERANCE, OVERLAPS

# locally, collectively, strictly jammed
Answers = tuple[bool, bool, bool]
ALL, NONE = (True, True, True), (False, False, False)
# between the levels 1e-10, 1e-9 and 1e-8 of hard particles, and not at them
GAPS = (1e-4, 1e-6, 2e-8, 5e-9, 5e-10, 5e-11, 1e-12)
# of one contact, the others shut to rounding and the open one not counted
THIN = (1e-3, 1e-4, 1e-5, 1e-6, 1e-7, 1e-8, 1e-9)
BASAL = np.array([[1.0, 0.0], [0.5, math.sqrt(3) / 2], [-0.5, math.sqrt(3) / 2]])


def _answers_of(packing: pm.Packing, rest_tolerance: float = 1e-5) -> tuple[str, str, str]:
    verdict = pm.classify_jamming(packing, rest_tolerance=rest_tolerance)
    return verdict.local, verdict.collective, verdict.strict


def _rule(fewest: Answers, most: Answers) -> tuple[str, ...]:
    """Return what must be said of packings whose networks with the fewest and the most pairs have these answers."""
    names = {(True, True): "jammed", (False, False): "not jammed", (False, True): "ambiguous"}
    return tuple(names[pair] for pair in zip(fewest, most, strict=True))


def _at_gap(gap: float, shut: Answers, opened: Answers) -> tuple[str, ...]:
    """Return what must be said of hard particles with this one gap, by the answers with it counted and not counted."""
    return _rule(
        shut if gap <= 0.1 * MINIMUM_GAP_TOLERANCE else opened, shut if gap <= 10 * MINIMUM_GAP_TOLERANCE else opened
    )


def _wrong(pairs: Iterable[tuple[tuple[str, ...], tuple[str, ...]]]) -> float:
    return float(sum(one != other for said, right in pairs for one, other in zip(said, right, strict=True)))


def _stretched(name: str, answers: Answers) -> float:
    """Wrong answers on a crystal whose contacts have all opened alike: beyond 1e-8 nothing touches anything."""
    crystal = pm.lattice_packing(name, repeats=2)
    size = np.eye(crystal.dimension)
    return _wrong((_answers_of(strain_packing(crystal, gap * size)), _at_gap(gap, answers, NONE)) for gap in GAPS)


def _pressed(name: str, answers: Answers) -> float:
    """Wrong answers on a crystal whose contacts all overlap alike, in balance by symmetry: those of the crystal."""
    overlaps = (1e-3, 1e-5, 1e-7, 1e-9, 1e-11, 1e-12)
    right = _rule(answers, answers)
    return _wrong(
        (_answers_of(pm.lattice_packing(name, repeats=2, relative_overlap=overlap)), right) for overlap in overlaps
    )


def _pressed_out_of_balance(name: str, answers: Answers) -> float:
    """Wrong answers where equal overlaps do not balance: not at rest, unless rest is not asked for."""
    pairs = []
    for overlap in (1e-4, 1e-8, 1e-12):
        packing = pm.lattice_packing(name, repeats=2, relative_overlap=overlap)
        pairs += [(_answers_of(packing), ("ambiguous",) * 3), (_answers_of(packing, math.inf), _rule(answers, answers))]
    return _wrong(pairs)


def _rhombic(repeats: int, opened: Answers) -> float:
    """Wrong answers when the triangular crystal is sheared so that one of its three families of contacts opens."""
    fraction_nd = np.array(list(itertools.product(range(repeats), repeat=2))) / repeats
    pairs = []
    for gap in GAPS:
        # the short diagonal of a rhombus of side 1 is 2 sin(angle/2)
        angle = 2 * math.asin(0.5 * (1 + gap))
        box = pm.Box(repeats * np.array([[1.0, math.cos(angle)], [0.0, math.sin(angle)]]))
        packing = pm.Packing(fraction_nd @ box.lattice_dd.T, np.full(len(fraction_nd), 0.5), box)
        pairs.append((_answers_of(packing), _at_gap(gap, ALL, opened)))
    return _wrong(pairs)


def _rectangular(repeats: int, answers: Answers) -> float:
    """Wrong answers when the square crystal is stretched along one axis: beyond 1e-8 only rows are left."""
    crystal = pm.lattice_packing("square", repeats=repeats)
    stretch = np.diag([0.0, 1.0])
    return _wrong((_answers_of(strain_packing(crystal, gap * stretch)), _at_gap(gap, answers, NONE)) for gap in GAPS)


def _one_gap(crystal: pm.Packing, opened: Answers) -> float:
    """Wrong answers when exactly one contact opens, in turn some contacts all over the crystal."""
    count = len(pm.find_contacts(crystal, gap_tolerance=MINIMUM_GAP_TOLERANCE))
    chosen = range(0, count, max(1, count // 3))
    return _wrong(
        (_answers_of(open_contact(crystal, contact, gap)), _at_gap(gap, ALL, opened))
        for contact in chosen
        for gap in GAPS
    )


def _thin_force() -> float:
    """Largest relative error of the smallest force that holds four discs of the triangular crystal, one contact open.

    Without that contact the others only just hold, by forces on some of them that vanish with the gap: smallest over
    mean is 11/6 of it (eleven contacts; the smallest of the forces is gap/6 of their sum).
    """
    worst = 0.0
    for gap, verdicts in _held_thinly(pm.lattice_packing("triangular", repeats=2), 4, THIN):
        if any(verdict.strict != "jammed" or verdict.contacts != 11 for verdict in verdicts):
            return math.inf
        worst = max(worst, abs(verdicts[0].strictly.smallest_force / (11 * gap / 6) - 1.0))
    return worst


def _held_thinly(
    crystal: pm.Packing, contact: int, gaps: tuple[float, ...]
) -> Iterator[tuple[float, list[pm.Verdict]]]:
    """Yield gaps and the verdicts of both methods on the crystal with one contact open by that much, not counted."""
    for gap in gaps:
        opened = open_contact(crystal, contact, gap)
        shut = pm.find_contacts(opened, gap_tolerance=0.1 * gap)
        yield gap, [pm.classify_jamming(opened, contacts=shut, method=method) for method in METHODS]


def _thin_reinforced() -> float:
    """How many answers are not "jammed" when a reinforced kagome crystal is held by forces as small as a gap."""
    found = _held_thinly(pm.reinforced_kagome_packing(1), 10, THIN[:-2])
    return float(sum(one.strict != "jammed" or one.collective != "jammed" for _, both in found for one in both))


def _one_contact_less(crystal: pm.Packing, jammed: int) -> float:
    """How many contacts too many or too few can be taken away, one by one, and leave the crystal strictly jammed."""
    contacts = pm.find_contacts(crystal, gap_tolerance=MINIMUM_GAP_TOLERANCE)
    number_c = np.arange(len(contacts))
    answers = [pm.classify_jamming(crystal, contacts=contacts.select(number_c != gone)).strict for gone in number_c]
    doubtful = answers.count("ambiguous")
    return float(abs(answers.count("jammed") - jammed) + doubtful)


def _shrunk(repeats: int, without: Answers) -> float:
    """Wrong answers when one disc is smaller, so that all its contacts open: beyond 1e-8 it might as well be gone."""
    crystal = pm.lattice_packing("triangular", repeats=repeats)
    return _wrong((_answers_of(resize_particle(crystal, 0, 1 - 2 * gap)), _at_gap(gap, ALL, without)) for gap in GAPS)


def _grown() -> float:
    """Wrong answers when one disc is larger: its neighbors are pushed and nothing holds them. Hard discs: jammed."""
    crystal = pm.lattice_packing("triangular", repeats=3)
    pairs = []
    for growth in (1e-4, 1e-6, 1e-9, 1e-12):
        packing = resize_particle(crystal, 4, 1 + 2 * growth)
        pairs += [(_answers_of(packing), ("ambiguous",) * 3), (_answers_of(packing, math.inf), ("jammed",) * 3)]
    return _wrong(pairs)


def _by_directions(touching_k: NDArray[np.bool_]) -> Answers:
    """Return the answers for a triangular crystal, 3 by 3, of which only some of the three contact directions touch."""
    directions = int(np.count_nonzero(touching_k))
    return directions >= 2, directions == 3, directions == 3


def _random_affine(size: float) -> float:
    """Wrong answers on triangular crystals strained at random, against the three networks from exact lengths."""
    crystal = pm.lattice_packing("triangular", repeats=3)
    pairs = []
    for seed in range(8):
        strain_dd = random_strain(2, size, seed=seed)
        # |(1 + e) n|^2 - 1 without the difference of nearly equal numbers
        change_k = np.einsum("kd,de,ke->k", BASAL, 2 * strain_dd + strain_dd @ strain_dd, BASAL)
        gap_k = change_k / (1 + np.sqrt(1 + change_k))
        overlap_k = -gap_k[gap_k < 0]
        tolerance = max(OVERLAPS * float(overlap_k.mean()) if len(overlap_k) else 0.0, MINIMUM_GAP_TOLERANCE)
        fewest, most = (_by_directions(gap_k <= factor * tolerance) for factor in (0.1, 10.0))
        pairs.append((_answers_of(strain_packing(crystal, strain_dd)), _rule(fewest, most)))
    return _wrong(pairs)


def _naive(name: str) -> float:
    """Largest net force when every contact pushes alike, plus the wrong answers: a naive certificate says jammed."""
    worst = 0.0
    for supercell in ([[2, 0], [0, 2]], [[3, 0], [0, 3]], [[2, 1], [0, 3]]):
        crystal = pm.lattice_packing(name, supercell=np.array(supercell))
        contacts = pm.find_contacts(crystal, gap_tolerance=MINIMUM_GAP_TOLERANCE)
        net_nd = np.zeros((crystal.particles, 2))
        np.add.at(net_nd, contacts.i_c, -contacts.normal_cd)
        np.add.at(net_nd, contacts.j_c, contacts.normal_cd)
        worst += float(np.abs(net_nd).max()) + (_answers_of(crystal) != ("jammed", "not jammed", "not jammed"))
    return worst


# particles that touch their own images, or each other through several
TINY: dict[str, tuple[Answers, tuple[int, ...]]] = {
    "triangular": (ALL, (1, 1)),
    "square": ((True, True, False), (1, 1)),
    "honeycomb": ((True, True, False), (1, 1)),
    "kagome": ((True, False, False), (1, 1)),
    "snub square": ((True, True, False), (1, 1)),
    "snub hexagonal": (ALL, (1, 1)),
    "filled square": (ALL, (1, 1)),
    "sc": ((True, True, False), (1, 1, 1)),
    "bcc": ((True, True, False), (1, 1, 1)),
    "fcc": (ALL, (1, 1, 1)),
    "hcp": (ALL, (1, 1, 1)),
    "tunneled fcc": ((True, True, False), (1, 1, 1)),
    "filled sc": (ALL, (1, 1, 1)),
}


def _tiny() -> float:
    """Wrong answers on primitive cells, as they are and described with a tilt of 7."""
    pairs = []
    for name, (answers, repeats) in TINY.items():
        cell = pm.lattice_packing(name, repeats=repeats)
        tilt = np.eye(cell.dimension)
        tilt[0, 1] = 7.0
        tilted = cell.replace(box=pm.Box(cell.box.lattice_dd @ tilt))
        pairs += [(_answers_of(one), _rule(answers, answers)) for one in (cell, tilted)]
    return _wrong(pairs)


THREE_LEVELS = "more contacts never unjam: jammed if the fewest pairs jam, not if the most do not, else ambiguous"
WRONG = "wrong answers of local, collective, strict over gaps of 1e-4 to 1e-12"
CRYSTALS: dict[str, Answers] = {
    "triangular": ALL,
    "square": (True, False, False),
    "honeycomb": (True, False, False),
    "kagome": (True, False, False),
    "fcc": ALL,
}

CASES = (
    *(
        HardCase(
            f"every contact opened alike, {name}",
            "whether a gap counts as contact decides everything, and nothing in the packing says so",
            WRONG,
            0.0,
            THREE_LEVELS,
            partial(_stretched, name, answers),
        )
        for name, answers in CRYSTALS.items()
    ),
    *(
        HardCase(
            f"every contact pressed alike, {name}",
            "overlaps of rounding size set the gap tolerance, large ones reach for the next neighbors",
            "wrong answers of three over overlaps of 1e-3 to 1e-12",
            0.0,
            "ten times the tolerance is 70 overlaps, 0.07 at most; no other pair is nearer than 0.41 (fcc, square)",
            partial(_pressed, name, answers),
        )
        for name, answers in CRYSTALS.items()
    ),
    HardCase(
        "equal overlaps out of balance, snub hexagonal",
        "a self stress of other forces exists, so a certificate passes although the packing would move",
        "wrong answers of three, with the check of rest and without",
        0.0,
        "five equal forces sixty degrees apart leave a net force of one: not at rest; as hard discs jammed",
        partial(_pressed_out_of_balance, "snub hexagonal", ALL),
    ),
    *(
        HardCase(
            f"triangular sheared to rhombic, {repeats} by {repeats}",
            "one family of contacts of three opens by a second-order small change of the box",
            WRONG,
            0.0,
            f"{THREE_LEVELS}; open, it has the contacts of the square crystal",
            partial(_rhombic, repeats, (True, repeats == 1, False)),
        )
        for repeats in (1, 3)
    ),
    *(
        HardCase(
            f"square stretched to rectangular, {repeats} by {repeats}",
            "rows that hold nothing replace a crystal with as many surplus contacts as an empty network",
            WRONG,
            0.0,
            f"{THREE_LEVELS}; open, no disc is held",
            partial(_rectangular, repeats, (True, repeats == 1, False)),
        )
        for repeats in (1, 2)
    ),
    HardCase(
        "one contact opened that is needed",
        "all the others stay shut to rounding: one gap decides between jammed and not",
        WRONG,
        0.0,
        f"{THREE_LEVELS}; two of the three contacts leave a rhombus to shear",
        lambda: _one_gap(pm.lattice_packing("triangular"), (True, True, False)),
    ),
    HardCase(
        "held by forces as small as a gap",
        "the certificate's smallest force is mistaken for zero, or zero for it",
        "relative error of smallest over mean force, gaps of 1e-3 to 1e-9; infinite if a method sees it not jammed",
        1e-3,
        "11/6 of the gap to first order in it: the next order is as large as the largest gap",
        _thin_force,
    ),
    HardCase(
        "held by forces as small as a gap, many states of self stress",
        "solvers stop at a tolerance: forces below it seem to pull, contacts held by them seem to open",
        "answers of two methods that are not jammed, over gaps of 1e-3 to 1e-7",
        0.0,
        "two contacts on opposite sides bend by an angle of the size of the gap: the third between them is held",
        _thin_reinforced,
    ),
    HardCase(
        "one contact opened that is not needed",
        "the number of surplus contacts changes with the tolerance, and the answer does not",
        WRONG,
        0.0,
        f"{THREE_LEVELS}; nine discs of the triangular crystal stay jammed without any one contact (simplex)",
        lambda: _one_gap(pm.lattice_packing("triangular", repeats=3), ALL),
    ),
    *(
        HardCase(
            f"one contact taken away, {what}",
            "the rest is as redundant as before, or it is not",
            "difference from the number of contacts without which it stays strictly jammed, and doubtful answers",
            0.0,
            "counted by simplex on the definition",
            value,
        )
        for what, value in (
            ("triangular 1 by 1", lambda: _one_contact_less(pm.lattice_packing("triangular"), 0)),
            ("triangular 2 by 2", lambda: _one_contact_less(pm.lattice_packing("triangular", 2), 0)),
            ("triangular 3 by 3", lambda: _one_contact_less(pm.lattice_packing("triangular", 3), 27)),
            ("reinforced kagome, one cell", lambda: _one_contact_less(pm.reinforced_kagome_packing(1), 0)),
            ("reinforced kagome, two cells", lambda: _one_contact_less(pm.reinforced_kagome_packing(2), 7)),
        )
    ),
    HardCase(
        "one disc too small, it matters",
        "six gaps open at once and one particle is a rattler or is not",
        WRONG,
        0.0,
        f"{THREE_LEVELS}; without one disc of four the triangular crystal is the kagome lattice",
        partial(_shrunk, 2, (True, False, False)),
    ),
    HardCase(
        "one disc too small, it does not matter",
        "six gaps open at once and one particle is a rattler or is not",
        WRONG,
        0.0,
        f"{THREE_LEVELS}; without one disc of nine the triangular crystal is jammed: the reinforced kagome lattice",
        partial(_shrunk, 3, ALL),
    ),
    HardCase(
        "one disc too large",
        "its six overlaps are the only forces, and they do not balance on its neighbors",
        "wrong answers of three, with the check of rest and without, for growth of 1e-4 to 1e-12",
        0.0,
        "one force on each neighbor: not at rest; as hard discs all pairs are within the tolerance",
        _grown,
    ),
    *(
        HardCase(
            f"random affine strain of {size:.0e}",
            "some contacts open and some close by as much as the tolerance that is made from them",
            "wrong answers of three over eight strains",
            0.0,
            f"exact lengths of the three contact directions; {THREE_LEVELS}",
            partial(_random_affine, size),
        )
        for size in (1e-11, 1e-9, 1e-6)
    ),
    *(
        HardCase(
            f"positive self stress with floppy modes, {name}",
            "equal forces balance on every disc: a certificate that asks for no more says jammed",
            "net force of equal contact forces, plus wrong verdicts in three supercells",
            1e-14,
            "rounding of at most four unit vectors; not jammed (Rev. Mod. Phys. 82, 2633, table II)",
            partial(_naive, name),
        )
        for name in ("square", "honeycomb", "kagome")
    ),
    HardCase(
        "primitive cells of thirteen crystals",
        "particles touch their own images: contacts that no motion in a fixed box can change",
        "wrong answers of three, in the plain and in a tilted description",
        0.0,
        "simplex on the definition; a single particle in a fixed box can only be translated",
        _tiny,
    ),
)  # fmt: skip
