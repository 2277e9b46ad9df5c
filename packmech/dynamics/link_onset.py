"""The onset of jamming of a packing with links: followed down in pressure, then drawn out to where overlaps vanish."""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

from packmech.contacts import find_contacts
from packmech.contacts.network import Contacts
from packmech.dynamics.descend import descend
from packmech.dynamics.link_jam import PRESSED, compress_linked, follow_pressure
from packmech.dynamics.soft_newton import SoftState
from packmech.measure import packing_fraction, pressure

if TYPE_CHECKING:
    from packmech.dynamics.protocol import Protocol
    from packmech.packing import Packing

# lowest pressure over the smallest distance asked for, and its bounds: below, rounding of positions leaves too few
# digits of the overlaps; above, overlaps are no longer small [energy_scale / diameter^d]
_LOW, _LOWEST, _HIGHEST = 1e-3, 1e-10, 1e-8
# the second of the two packings on the line to the onset, in units of the pressure of the first
_SECOND = 0.5
_FIRE_TOLERANCE, _FIRE_STEPS = 1e-2, 200_000


class Onset(NamedTuple):
    """Packing fraction at which overlaps vanish, and the packing above: its state, how far above, its contacts."""

    fraction: float
    state: SoftState
    depth: float
    contacts: Contacts


def find_onset(protocol: Protocol, distance: float) -> Onset | None:
    """Return the onset of jamming of the scene's packing, or None when it is not jammed.

    Where contacts stay the same, overlaps grow in proportion to the packing fraction less its onset, whatever the law.
    The line through two packings at pressures far below that of the distance errs by the square of their overlaps.

    Parameters
    ----------
    protocol
        The protocol; stages and `jamming_packing_fraction` are added to it.
    distance
        The smallest packing fraction less onset that will be asked for [1].

    """
    scene = protocol.scene
    packing, now = scene.packing, pressure(scene) / scene.pressure_unit
    low = min(max(_LOW * distance, _LOWEST), _HIGHEST)
    resting = now >= _LOWEST and _at(protocol, protocol.reduced(packing), now) is not None
    if not resting:
        packing, now = compress_linked(protocol, packing, PRESSED, _FIRE_TOLERANCE, _FIRE_STEPS)
        if now < PRESSED:
            return None
    low = min(low, now)
    packing, outcome = follow_pressure(protocol, packing, now, low)
    if not outcome.ok:
        return None
    with protocol.stage("onset") as figures:
        first = _at(protocol, protocol.reduced(packing), low)
        if first is None:
            figures.note = "not accepted: no stable balance"
            return None
        # on the line balance is enough: a contact that bears nothing may part and leave a motion that it held
        goal = protocol.reduced_pressure(_SECOND * low)
        last = descend(first.packing, protocol.units, protocol.basis_kdd, goal)
        depths = [find_contacts(state.packing).overlap_c.mean() for state in (last, first)]
        fractions = [packing_fraction(state.packing) for state in (last, first)]
        if not last.balanced(max(protocol.force_tolerance, 8.0 * last.floor)) or not depths[0] < depths[1]:
            figures.note = "not accepted: no balance with smaller overlaps at half the pressure"
            return None
        depth = float((fractions[1] - fractions[0]) / (depths[1] - depths[0]) * depths[1])
        figures.residual, figures.steps = last.residual, first.iterations + last.iterations
        figures.force_evaluations = first.evaluations + last.evaluations
        figures.note = f"the line through two packings, the first one {depth:.2e} above"
        protocol.last = protocol.restored(first.packing)
    onset = fractions[1] - depth
    protocol.report["jamming_packing_fraction"] = onset
    return Onset(onset, first, depth, find_contacts(protocol.last))


def _at(protocol: Protocol, packing: Packing, at: float) -> SoftState | None:
    """Return the packing, in reduced units, in stable balance at the pressure, or None."""
    state = descend(packing, protocol.units, protocol.basis_kdd, protocol.reduced_pressure(at))
    return state if state.sound(protocol.force_tolerance) else None
