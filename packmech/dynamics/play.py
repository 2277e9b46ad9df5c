"""Motions of packings taken to finite amplitude: whether one really unjams, or is blocked on the way."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.check import finite_array, instance, integer, one_of, positive
from packmech.compiled import single_thread
from packmech.contacts import Contacts, find_contacts
from packmech.contacts.network import pair_contacts
from packmech.dynamics.play_steps import Direction, Rules, advance, pairs_of
from packmech.dynamics.settings import check_manner
from packmech.effects import Repulsion
from packmech.interrupts import safe_interrupts
from packmech.measure import energy, packing_fraction
from packmech.mechanics.touching import find_touching
from packmech.mechanics.unjamming import UnjammingMotion
from packmech.packing import Packing, no_own_images
from packmech.scene import Scene

UNJAMMED, BLOCKED, UNFINISHED, INTERRUPTED = "unjammed", "blocked", "unfinished", "interrupted"
VOLUMES = ("nonincreasing", "fixed")
# a step that cannot be taken is halved so often before the motion counts as blocked, but not below so many roots of the
# overlap tolerance: a motion that is blocked at second order makes overlaps as small as the square of the step
_HALVINGS, _ROOTS = 8, 10.0
# steps that contacts shorten do not add up for ever
_MOST = 40


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


def play_motion(
    packing: Packing | Scene,
    motion: UnjammingMotion | ArrayLike,
    *,
    amplitude: float = 0.5,
    steps: int = 50,
    strain_dd: ArrayLike | None = None,
    volume: str = "nonincreasing",
    overlap_tolerance: float = 1e-9,
    progress: Any = None,
) -> PlayedMotion:
    """Return a motion taken to finite amplitude, step by step, by particles that are hard.

    Contacts may open and not close; pairs that overlap at the start are hard at their distance; rigid links keep their
    lengths. The motion goes straight on in positions and lattice vectors as long as nothing comes into the way, then
    along what is: each step is the nearest one to the last that contacts, links and volume allow (a quadratic program,
    mended to second order). For discs and spheres without links a motion that closes no contact to first order closes
    none along the straight line, and the volume does not grow (lengths are convex, determinants of 1 + a E concave
    after the root): only other particles can block it. Links may block it at once, at second order.

    Parameters
    ----------
    packing
        The packing that the motion belongs to, or a scene, whose law gives the energies.
    motion
        `Verdict.unjamming_motion`, or (N, d) displacements, of a mode for example; their length does not matter, nor
        does a translation of everything.
    amplitude
        How far to go [reference diameter].
    steps
        Number of steps to take it in; the packing is kept after each. Shorter ones are taken, and kept, where need be.
    strain_dd
        (d, d) symmetric strain of the box that goes with displacements given as an array, in their unit of amplitude.
    volume
        "nonincreasing" or "fixed": what the volume may do where the motion strains the box.
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
    steps = integer("steps", steps, at_least=1)
    one_of("volume", volume, VOLUMES)
    overlap_tolerance = positive("overlap_tolerance", overlap_tolerance)
    check_manner(progress, True)
    direction = _direction(packing, motion, strain_dd)
    scale = float(packing.box.volume ** (1.0 / packing.dimension))
    unit = direction.size(scale)
    if unit == 0.0:
        raise ValueError("motion must move particles against each other or strain the box, got one that does neither")
    overlapping = find_contacts(packing)
    rules = Rules(
        volume,
        packing.box.volume,
        scale,
        overlap_tolerance,
        dict(zip(pairs_of(overlapping), overlapping.distance_c.tolist(), strict=True)),
        box_moves=bool(direction.strain_dd.any()),
    )
    effects = (Repulsion(),) if scene is None else scene.effects
    player = _Player(packing, effects, direction.times(packing.reference_diameter / unit), rules, start)
    try:
        with safe_interrupts(), single_thread():
            outcome, reason = player.play(amplitude, steps, progress)
    except KeyboardInterrupt as stop:
        stop.run = player.played(INTERRUPTED, "stopped from outside")  # type: ignore[attr-defined]
        raise
    return player.played(outcome, reason)


def _direction(packing: Packing, motion: Any, strain_dd: ArrayLike | None) -> Direction:
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
    moved = given - given.mean(axis=0)
    # what the mean's rounding leaves of a translation
    if not np.abs(moved).max() > 1e-14 * np.abs(given).max():
        moved = np.zeros_like(moved)
    return Direction(moved, strain)


class _Player:
    """A motion on its way, and what was kept of it."""

    def __init__(
        self, packing: Packing, effects: tuple[Any, ...], direction: Direction, rules: Rules, start: float
    ) -> None:
        self.effects, self.rules, self.start = effects, rules, start
        touching = find_touching(packing, None)
        self.gap_tolerance, self.contacts = touching.tolerance, touching.contacts
        self.packing_t = [packing]
        self.direction_t = [direction]
        self.amplitude_t = [0.0]

    def play(self, amplitude: float, steps: int, progress: Any) -> tuple[str, str]:
        """Go on until the amplitude is reached or the motion is blocked; return how it ended and why."""
        whole = step = amplitude / steps
        least = max(whole * 0.5**_HALVINGS, min(whole, _ROOTS * self.rules.overlap_tolerance**0.5))
        while len(self.packing_t) <= _MOST * steps:
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
            if progress is not None:
                figures = {"steps": len(self.packing_t) - 1, "amplitude": self.amplitude_t[-1]}
                progress("play", figures | {"closing": self.rules.closing(ahead), "packing": ahead})
        return UNFINISHED, "contacts shortened so many steps that the amplitude was not reached"

    def played(self, outcome: str, reason: str) -> PlayedMotion:
        """Return the record of what was kept, measured on the packings."""
        pairs = self.contacts.i_c, self.contacts.j_c, self.contacts.image_cd
        return PlayedMotion(
            tuple(self.packing_t),
            np.array(self.amplitude_t),
            np.array([find_contacts(one).overlap_c.max(initial=0.0) for one in self.packing_t]),
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
