"""Decompression: quench far above jamming, let the box grow until the pressure has all but gone, extrapolate."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from packmech.check import integer, positive, real
from packmech.dynamics.expand import decompress
from packmech.dynamics.hard_vertex import find_vertex, press
from packmech.outcome import Outcome
from packmech.packing import Packing

if TYPE_CHECKING:
    from packmech.dynamics.protocol import Protocol

_START = {2: 0.90, 3: 0.70}


@dataclass(frozen=True)
class Decompression:
    """Quench at a packing fraction well above jamming, then decompress in steps that divide the pressure.

    Every step relaxes by FIRE and extrapolates the pressure to the next target by the last slope. The last two
    pressures give the packing fraction of zero pressure; the exact hard packing and the soft one at the pressure
    asked for follow from there. "Random at .90, FIRE, decompress, extrapolate" is this protocol.

    A packing with links is relaxed where it stands (or at `start_packing_fraction`) and compressed by small steps until
    it presses: large overlaps would push links through each other. Then it is followed down from pressure to pressure
    by Newton's method that only goes down, with links and free strains among the unknowns; the box grows and clusters
    keep their shape, which is the shrinking of clusters in place, in other units.

    Parameters
    ----------
    start_packing_fraction
        Where the quench happens; None: .90 in two dimensions, .70 in three, and with links where the packing stands.
    stop_pressure, factor
        Stop decompressing at this pressure [energy_scale / diameter^d], and ratio of successive pressures; not used
        with links.
    quench_tolerance
        Net force over mean contact force at which FIRE stops [1].
    quench_steps
        Most FIRE steps in one box.
    iteration_limit
        Most interior-point iterations for the hard packing.

    """

    start_packing_fraction: float | None = None
    stop_pressure: float = 1e-4
    factor: float = 0.15
    quench_tolerance: float = 1e-4
    quench_steps: int = 1_000_000
    iteration_limit: int = 2000

    def __post_init__(self) -> None:
        if self.start_packing_fraction is not None:
            positive("start_packing_fraction", self.start_packing_fraction)
        positive("stop_pressure", self.stop_pressure)
        real("factor", self.factor, above=0.0, below=1.0)
        real("quench_tolerance", self.quench_tolerance, above=0.0, below=1.0)
        integer("quench_steps", self.quench_steps, at_least=1)
        integer("iteration_limit", self.iteration_limit, at_least=1)

    def follow(self, protocol: Protocol, pressure: float) -> tuple[Packing, Outcome]:
        """Return the packing at the pressure [energy_scale / diameter^d] and how the protocol ended."""
        start = self.start_packing_fraction
        if protocol.scene.packing.links is not None:
            from packmech.dynamics.link_jam import decompress_linked

            return decompress_linked(protocol, start, pressure, self.quench_tolerance, self.quench_steps)
        start = _START[protocol.scene.packing.dimension] if start is None else start
        packing = decompress(
            protocol, start, self.stop_pressure, self.factor, self.quench_tolerance, self.quench_steps
        )  # fmt: skip
        vertex = find_vertex(protocol, packing, self.iteration_limit)
        if vertex is None:
            return protocol.last, Outcome.NOT_JAMMED
        return press(protocol, vertex, pressure)
