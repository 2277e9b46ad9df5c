"""Motions of hard particles taken to finite amplitude: whether one really unjams, or is blocked on the way."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from packmech.box import Box
from packmech.calls.display import shown
from packmech.calls.honors import honors
from packmech.calls.status import Progress, check_progress, is_watched, shows
from packmech.check import BoxStrain, finite_array, instance, integer, one_of, positive
from packmech.constraints.factor import link_pairs
from packmech.constraints.projection import reaffix_links
from packmech.contacts import Contacts, find_contacts
from packmech.contacts.elements import distance_rows
from packmech.contacts.network import pair_contacts
from packmech.contacts.pairs import pair_names
from packmech.effects import Repulsion
from packmech.jamming.contact_selection import ContactSelection, select_contacts
from packmech.jamming.verdict import UnjammingMotion
from packmech.jit.blas import single_thread
from packmech.jit.interrupts import safe_interrupts
from packmech.linalg.linear_programs import LinearProgram, solve_clarabel
from packmech.linalg.mandel import mandel_tensor, mandel_vector, strain_components, trace_vector
from packmech.measure.counting import packing_fraction
from packmech.measure.rattlers import rattling_particles
from packmech.measure.stress import energy
from packmech.mechanics.rigidity import strain_columns
from packmech.packing import Packing, no_own_images
from packmech.scene import Scene

# what is left of a step where contacts hold a motion up [1]
_STANDSTILL = 0.02
# a step is abandoned when so much of it is lost on the way back to where links and contacts allow it
_LOST = 0.5
_CORRECTIONS = 12
# links this near to their lengths count as kept [1]
_KEPT = 1e-12
_SOLVER = 1e-10


@dataclass(frozen=True, eq=False)
class Direction:
    """Displacements (N, d) [length] and a symmetric strain (d, d) [1], for a unit of amplitude."""

    displacement_nd: NDArray[np.float64]
    strain_dd: NDArray[np.float64]

    def times(self, factor: float) -> Direction:
        """Return the direction, longer by the factor."""
        return Direction(factor * self.displacement_nd, factor * self.strain_dd)

    def product(self, other: Direction, scale: float) -> float:
        """Return the scalar product with another direction, strains counted as `scale` lengths [length^2]."""
        strain = scale**2 * float((self.strain_dd * other.strain_dd).sum())
        return float((self.displacement_nd * other.displacement_nd).sum()) + strain

    def size(self, scale: float) -> float:
        """Return the largest displacement, or scale times the largest Mandel strain [length]."""
        moved = np.sqrt((self.displacement_nd**2).sum(axis=1)).max()
        return float(max(moved, scale * np.abs(mandel_vector(self.strain_dd)).max()))

    def apply(self, packing: Packing) -> Packing:
        """Return the packing after a unit of the direction; links are not mended."""
        position = packing.position_nd
        moved = position + self.displacement_nd + position @ self.strain_dd
        return packing.replace(position_nd=moved, box=packing.box.strained(self.strain_dd))

    def ahead(self, step: float) -> Direction:
        """Return the same straight line as seen from the place one step along it."""
        back = np.linalg.inv(np.eye(len(self.strain_dd)) + step * self.strain_dd)
        strain = back @ self.strain_dd
        return Direction(self.displacement_nd @ back.T, 0.5 * (strain + strain.T))


def difference(before: Packing, after: Packing) -> Direction:
    """Return the step from one packing to another; of a box that turned, what strained it."""
    change = after.box.lattice_dd @ before.box.inverse_dd - np.eye(before.dimension)
    strain = 0.5 * (change + change.T)
    return Direction(after.position_nd - before.position_nd - before.position_nd @ change.T, strain)


@dataclass(frozen=True, eq=False)
class Rules:
    """What a motion has to keep to.

    Attributes
    ----------
    strain
        "free" or "isochoric": what the box may do, where it moves; its volume never grows.
    start_volume
        The volume that it is held at [length^d].
    scale
        Length that a unit strain counts as [length].
    overlap_tolerance
        Largest relative overlap [1] beyond those of the start.
    floor
        Distances of the pairs that overlap at the start, by (i, j, image): they are hard at that distance [length].
    box_moves
        Whether the box takes part in the motion.
    backbone_n
        Numbers of the particles that do not rattle at the start, of all where every one does: their mean displacement
        is none, as a translation of all of them, past rattlers or with them, is no motion.

    """

    strain: BoxStrain
    start_volume: float
    scale: float
    overlap_tolerance: float
    floor: dict[tuple[int, ...], float]
    box_moves: bool
    backbone_n: NDArray[np.int64]

    def still(self, direction: Direction) -> Direction:
        """Return the direction without its translation."""
        moved = direction.displacement_nd
        return Direction(moved - moved[self.backbone_n].mean(axis=0), direction.strain_dd)

    def floor_c(self, contacts: Contacts) -> NDArray[np.float64]:
        """Return the (C,) distances below which pairs are not to come [length]."""
        floor = contacts.contact_distance_c.copy()
        if self.floor:
            for c, pair in enumerate(pair_names(contacts)):
                floor[c] = self.floor.get(pair, floor[c])
        return floor

    def closing(self, packing: Packing) -> float:
        """Return how far the worst pair is below its floor, over the contact distance [1]; 0 when none is."""
        contacts = find_contacts(packing, gap_tolerance=0.0)
        below = (self.floor_c(contacts) - contacts.distance_c) / contacts.contact_distance_c
        return float(below.max(initial=0.0))

    def kept(self, packing: Packing) -> bool:
        """Whether contacts and links are as they should be."""
        return packing.link_error <= _KEPT and self.closing(packing) <= self.overlap_tolerance

    def mended(self, packing: Packing, volume: float) -> Packing:
        """Return the packing with volume and links put right, as far as it takes no contacts; they may be wrong after.

        Parameters
        ----------
        packing
            The packing.
        volume
            The volume before the step [length^d].

        """
        if self.box_moves:
            held = self.strain == "isochoric"
            aim = self.start_volume if held else min(volume, packing.box.volume)
            if aim != packing.box.volume:
                factor = (aim / packing.box.volume) ** (1.0 / packing.dimension)
                box = Box(factor * packing.box.lattice_dd)
                packing = packing.replace(position_nd=factor * packing.position_nd, box=box)
        return reaffix_links(packing, check=False).packing


def advance(
    packing: Packing, direction: Direction, step: float, rules: Rules
) -> tuple[Packing, Direction, float] | str:
    """Return the packing after a step, the direction that goes on from there and the way made, or why there is none.

    "contacts": nothing is left of the direction. "second order": what links and contacts admit to first order leads
    nowhere, at this length of the step.

    Parameters
    ----------
    packing, direction
        Where it stands and where it goes.
    step
        How far, in units of the direction.
    rules
        What to keep to.

    """
    volume, scale = packing.box.volume, rules.scale
    target = direction.times(step)
    ahead = rules.mended(target.apply(packing), volume)
    free = rules.kept(ahead)
    if free and not len(packing.links):
        return ahead, direction.ahead(step), step
    reach = target.size(scale)
    wanted = target if free else rules.still(nearest(packing, target, rules, reach))
    if wanted.size(scale) < _STANDSTILL * reach:
        return "contacts"
    if not free:
        ahead = rules.mended(wanted.apply(packing), volume)
    for _ in range(_CORRECTIONS):
        done = difference(packing, ahead)
        if done.product(wanted, scale) < _LOST * wanted.product(wanted, scale):
            break
        if rules.kept(ahead):
            way = done.size(scale) / direction.size(scale)
            return ahead, rules.still(done.times(1.0 / way)), min(way, step)
        stay = Direction(np.zeros_like(packing.position_nd), np.zeros_like(packing.box.lattice_dd))
        ahead = rules.mended(nearest(ahead, stay, rules, reach).apply(ahead), volume)
    return "second order"


def nearest(packing: Packing, target: Direction, rules: Rules, reach: float) -> Direction:
    """Return the step nearest to the target that contacts, links and volume admit, all taken as linear.

    Parameters
    ----------
    packing
        Where the step begins.
    target
        The step that is wanted.
    rules
        What to keep to.
    reach
        How far anything may move; pairs that cannot meet by then are left out [length].

    """
    d, moving = packing.dimension, packing.position_nd.size
    strains = strain_components(d) if rules.box_moves else 0
    smallest = 2.0 * float(packing.radius_n.min())
    # both partners of a pair move, and what contacts ask may add as much
    near = find_contacts(packing, gap_tolerance=4.0 * reach * (1.0 / smallest + 1.0 / rules.scale))
    links = link_pairs(packing)
    room_c = near.distance_c - rules.floor_c(near)
    wrong_l = packing.links.length_l - links.distance_c
    # numbers of order one for the solver: lengths in units of the step, or of the errors to be mended
    unit = max(target.size(rules.scale), float(np.abs(wrong_l).max(initial=0.0)), float(-room_c.min(initial=0.0)))

    def rows(pairs: Contacts) -> sp.csr_array:
        gradient = distance_rows(pairs)
        if not strains:
            return gradient
        return sp.csr_array(sp.hstack([gradient, sp.csr_array(strain_columns(pairs) / rules.scale)], format="csr"))

    trace = sp.csr_array(np.concatenate([np.zeros(moving), trace_vector(d) / np.sqrt(d)])[None, :]) if strains else None
    equal, below = [rows(links)], [-rows(near)]
    equal_to, below_to = [wrong_l / unit], [room_c / unit]
    if trace is not None:
        (equal if rules.strain == "isochoric" else below).append(trace)
        (equal_to if rules.strain == "isochoric" else below_to).append(np.zeros(1))
    wanted = target.displacement_nd.ravel()
    if strains:
        wanted = np.concatenate([wanted, rules.scale * mandel_vector(target.strain_dd)])
    program = LinearProgram(
        -wanted / unit,
        sp.csr_array(sp.vstack(equal, format="csr")),
        np.concatenate(equal_to),
        sp.csr_array(sp.vstack(below, format="csr")),
        np.concatenate(below_to),
        np.full(moving + strains, -np.inf),
        np.full(moving + strains, np.inf),
        quadratic=1.0,
        dimension=d,
    )
    motion = unit * solve_clarabel(program, _SOLVER, refine=True).x
    strain = mandel_tensor(motion[moving:] / rules.scale) if strains else np.zeros((d, d))
    return Direction(motion[:moving].reshape(-1, d), strain)


UNJAMMED, BLOCKED, UNFINISHED, INTERRUPTED = "unjammed", "blocked", "unfinished", "interrupted"
# a step that cannot be taken is halved so often before the motion counts as blocked, but not below so many roots of the
# overlap tolerance: a motion that is blocked at second order makes overlaps as small as the square of the step
_HALVINGS, _ROOTS = 8, 10.0
# steps that contacts shorten do not add up for ever
_STEP_FACTOR = 40


@shown()
@dataclass(frozen=True, eq=False)
class PlayedMotion:
    """Packings along a motion, from the packing that it was given for to where it ended.

    Attributes
    ----------
    packing_t
        T + 1 packings, the first as it was given.
    amplitude_t
        (T + 1,) way that was made [reference diameter]: largest displacement, or V^(1/d) times the largest strain.
    overlap_t
        (T + 1,) largest relative overlap [1].
    closing_t
        (T + 1,) by how much a pair is nearer than contact, or nearer than it was where it overlapped at the start [1].
    energy_t
        (T + 1,) energies [energy], by the scene's law; without a scene by the harmonic one of energy scale 1.
    packing_fraction_t
        (T + 1,) packing fractions; they never fall.
    contacts
        The contacts at the start.
    gap_tc
        (T + 1, C) their gaps [length].
    contacts_t
        (T + 1,) number of pairs that touch.
    displacement_tnd, strain_tdd
        (T + 1, N, d) displacements [length] and (T + 1, d, d) strains [1] of the direction, per reference diameter.
    outcome
        "unjammed": the amplitude was reached, no pair nearer than at the start by more than the tolerance. "blocked":
        contacts or links hold the motion up before. "unfinished": it was still on its way when the steps were used up.
        "interrupted": stopped from outside.
    reason
        One sentence why.
    gap_tolerance
        Largest gap at which a pair touches, over the contact distance [1].
    overlap_tolerance
        As asked for [1].
    steps
        Number T of steps taken.
    seconds
        CPU time.

    """

    packing_t: tuple[Packing, ...]
    amplitude_t: NDArray[np.float64]
    overlap_t: NDArray[np.float64]
    closing_t: NDArray[np.float64]
    energy_t: NDArray[np.float64]
    packing_fraction_t: NDArray[np.float64]
    contacts: Contacts
    gap_tc: NDArray[np.float64]
    contacts_t: NDArray[np.int64]
    displacement_tnd: NDArray[np.float64]
    strain_tdd: NDArray[np.float64]
    outcome: str
    reason: str
    gap_tolerance: float
    overlap_tolerance: float
    steps: int
    seconds: float

    @property
    def packing(self) -> Packing:
        """The packing at the end."""
        return self.packing_t[-1]

    @property
    def amplitude(self) -> float:
        """Way made to the end [reference diameter]."""
        return float(self.amplitude_t[-1])

    @property
    def residual(self) -> float:
        """Largest closing of any pair at any step [1]."""
        return float(self.closing_t.max())

    def to_dict(self) -> dict[str, Any]:
        """Return the results by name, as plain values."""
        return {
            "outcome": self.outcome,
            "reason": self.reason,
            "amplitude": self.amplitude,
            "steps": self.steps,
            "contacts": len(self.contacts),
            "opened": int(self.opened_t[-1]),
            "largest_closing": self.residual,
            "packing_fraction_start": float(self.packing_fraction_t[0]),
            "packing_fraction": float(self.packing_fraction_t[-1]),
            "seconds": self.seconds,
        }

    @property
    def unjammed(self) -> bool:
        """Whether the amplitude was reached."""
        return self.outcome == UNJAMMED

    @property
    def stayed_tc(self) -> NDArray[np.bool_]:
        """Which of the start's contacts touch at each step, (T + 1, C)."""
        return np.asarray(self.gap_tc <= self.gap_tolerance * self.contacts.contact_distance_c)

    @property
    def stayed_t(self) -> NDArray[np.int64]:
        """The (T + 1,) number of the start's contacts that touch."""
        return np.asarray(np.count_nonzero(self.stayed_tc, axis=1), dtype=np.int64)

    @property
    def opened_t(self) -> NDArray[np.int64]:
        """The (T + 1,) number of the start's contacts that are open."""
        opened: NDArray[np.int64] = len(self.contacts) - self.stayed_t
        return opened


@honors("repulsion kinds links", at_rest=True)
def play_motion(
    packing: Packing | Scene,
    motion: UnjammingMotion | ArrayLike,
    *,
    amplitude: float = 0.5,
    steps: int = 50,
    strain_dd: ArrayLike | None = None,
    strain: BoxStrain = "free",
    overlap_tolerance: float = 1e-9,
    progress: Progress = None,
) -> PlayedMotion:
    """Return a motion taken to finite amplitude, step by step, by particles that are hard.

    Contacts may open and not close; pairs that overlap at the start are hard at their distance; rigid links keep their
    lengths. The motion goes straight on in positions and lattice vectors as long as nothing comes into the way, then
    along what is: each step is the nearest one to the last that contacts, links and volume allow (a quadratic program,
    mended to second order). For discs and spheres without links a motion that closes no contact to first order closes
    none along the straight line, and the volume does not grow (lengths are convex, determinants of 1 + a E concave
    after the root): only other particles can block it. Links may block it at once, at second order.

    Displacements are those relative to the mean of the particles that do not rattle. Rattlers that the motion leaves
    where they are go only where they are pushed.

    Parameters
    ----------
    packing
        The packing that the motion belongs to, or a scene, whose law gives the energies.
    motion
        `Verdict.unjamming_motion`, or (N, d) displacements, of a mode for example; their length does not matter, nor
        does a translation of everything but rattlers that it leaves at rest.
    amplitude
        How far to go [reference diameter].
    steps
        Number of steps to take it in; the packing is kept after each. Shorter ones are taken, and kept, where need be.
    strain_dd
        (d, d) symmetric strain of the box that goes with displacements given as an array, in their unit of amplitude.
    strain
        "free" or "isochoric": what the box may do where the motion strains it; its volume never grows.
    overlap_tolerance
        Largest relative overlap [1] to accept beyond those of the start.
    progress
        Called after each step as progress("play", figures) with "steps", "amplitude", "closing" and "packing".

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind or shape, or the motion moves nothing.
    KeyboardInterrupt
        Passed on with `.run` set to what was played.

    Examples
    --------
    >>> import packmech as pm
    >>> square = pm.lattice_packing("square", repeats=(4, 4))
    >>> played = play_motion(square, pm.classify_jamming(square).unjamming_motion, amplitude=0.4, steps=10)
    >>> played.outcome, int(played.opened_t[-1]) > 0, played.residual < 1e-9
    ('unjammed', True, True)

    """
    start = time.process_time()
    scene = packing if isinstance(packing, Scene) else None
    if isinstance(packing, Scene):
        packing = packing.packing
    instance("packing", packing, Packing)
    no_own_images("packing", packing)
    amplitude = positive("amplitude", amplitude)
    steps = integer("steps", steps, at_least=1, bytes_each=8.0 * packing.position_nd.size)
    one_of("strain", strain, ("free", "isochoric"))
    overlap_tolerance = positive("overlap_tolerance", overlap_tolerance)
    check_progress(progress)
    selection = select_contacts(packing, None)
    rattling = rattling_particles(packing, selection.contacts)
    backbone = np.flatnonzero(rattling.all() | ~rattling)
    direction = _direction(packing, motion, strain_dd, backbone)
    scale = float(packing.box.volume ** (1.0 / packing.dimension))
    unit = direction.size(scale)
    if unit == 0.0:
        raise ValueError("motion must move particles against each other or strain the box, got one that does neither")
    overlapping = find_contacts(packing, gap_tolerance=0.0)
    rules = Rules(
        strain,
        packing.box.volume,
        scale,
        overlap_tolerance,
        dict(zip(pair_names(overlapping), overlapping.distance_c.tolist(), strict=True)),
        box_moves=bool(direction.strain_dd.any()),
        backbone_n=backbone,
    )
    effects = (Repulsion(),) if scene is None else scene.effects
    direction = direction.times(packing.reference_diameter / unit)
    player = _Player(packing, effects, direction, rules, selection, start)
    try:
        with safe_interrupts(), single_thread(), shows("motion", progress) as report:
            outcome, reason = player.play(amplitude, steps, report if is_watched(progress) else None)
    except KeyboardInterrupt as stop:
        stop.run = player.played(INTERRUPTED, "stopped from outside")  # type: ignore[attr-defined]
        raise
    return player.played(outcome, reason)


def _direction(packing: Packing, motion: Any, strain_dd: ArrayLike | None, backbone_n: NDArray[np.int64]) -> Direction:
    d = packing.dimension
    strain = np.zeros((d, d))
    if isinstance(motion, UnjammingMotion):
        if strain_dd is not None:
            raise ValueError("strain_dd must be left out when motion is an UnjammingMotion, which has its own")
        given, strain = motion.displacement_nd, motion.strain_dd
    elif motion is None:
        raise TypeError("motion must be an UnjammingMotion or (N, d) displacements, got None: is the packing jammed?")
    else:
        given = finite_array("motion", motion, shape=(None, d))
        if strain_dd is not None:
            strain = finite_array("strain_dd", strain_dd, shape=(d, d), what="row")
            if not np.allclose(strain, strain.T, rtol=0.0, atol=1e-12 * np.abs(strain).max()):
                raise ValueError(f"strain_dd must be symmetric, got {strain.tolist()}")
    if given.shape != packing.position_nd.shape:
        raise ValueError(f"motion must have displacements of shape {packing.position_nd.shape}, got {given.shape}")
    moved = given - given[backbone_n].mean(axis=0)
    if len(backbone_n) < len(given):
        # rattlers that are left where they are stay with the rest
        moved[~given.any(axis=1)] = 0.0
    # what the mean's rounding leaves of a translation
    if not np.abs(moved).max() > 1e-14 * np.abs(given).max():
        moved = np.zeros_like(moved)
    return Direction(moved, strain)


class _Player:
    """A motion on its way, and what was kept of it."""

    def __init__(
        self,
        packing: Packing,
        effects: tuple[Any, ...],
        direction: Direction,
        rules: Rules,
        selection: ContactSelection,
        start: float,
    ) -> None:
        self.effects, self.rules, self.start = effects, rules, start
        self.gap_tolerance, self.contacts = selection.tolerance, selection.contacts
        self.packing_t = [packing]
        self.direction_t = [direction]
        self.amplitude_t = [0.0]

    def play(self, amplitude: float, steps: int, progress: Any) -> tuple[str, str]:
        """Go on until the amplitude is reached or the motion is blocked; return how it ended and why."""
        whole = step = amplitude / steps
        least = max(whole * 0.5**_HALVINGS, min(whole, _ROOTS * self.rules.overlap_tolerance**0.5))
        while len(self.packing_t) <= _STEP_FACTOR * steps:
            left = amplitude - self.amplitude_t[-1]
            if left <= 1e-9 * amplitude:
                return UNJAMMED, "the amplitude was reached and no pair is nearer than it was"
            step = min(step, left)
            found = advance(self.packing_t[-1], self.direction_t[-1], step, self.rules)
            if isinstance(found, str):
                if found == "contacts":
                    return BLOCKED, "contacts hold it up: nothing is left of its direction that closes none"
                if 0.5 * step < least:
                    return BLOCKED, "links and contacts admit it to first order and block it at second order"
                step *= 0.5
                continue
            ahead, direction, way = found
            self.packing_t.append(ahead)
            self.direction_t.append(direction)
            self.amplitude_t.append(self.amplitude_t[-1] + way)
            step = min(2.0 * step, whole)
            if callable(progress):
                figures = {"steps": len(self.packing_t) - 1, "amplitude": self.amplitude_t[-1]}
                progress("play", figures | {"closing": self.rules.closing(ahead), "packing": ahead})
        return UNFINISHED, "contacts shortened so many steps that the amplitude was not reached"

    def played(self, outcome: str, reason: str) -> PlayedMotion:
        """Return the record of what was kept, measured on the packings."""
        pairs = self.contacts.i_c, self.contacts.j_c, self.contacts.image_cd
        return PlayedMotion(
            tuple(self.packing_t),
            np.array(self.amplitude_t),
            np.array([find_contacts(one, gap_tolerance=0.0).overlap_c.max(initial=0.0) for one in self.packing_t]),
            np.array([self.rules.closing(one) for one in self.packing_t]),
            np.array([energy(Scene(one, self.effects)) for one in self.packing_t]),
            np.array([packing_fraction(one) for one in self.packing_t]),
            self.contacts,
            np.array([pair_contacts(one, *pairs).gap_c for one in self.packing_t]),
            np.array([len(find_contacts(one, gap_tolerance=self.gap_tolerance)) for one in self.packing_t]),
            np.array([one.displacement_nd for one in self.direction_t]),
            np.array([one.strain_dd for one in self.direction_t]),
            outcome,
            reason,
            self.gap_tolerance,
            self.rules.overlap_tolerance,
            len(self.packing_t) - 1,
            time.process_time() - self.start,
        )
