"""Jamming by pressing: damped time stepping in a box whose strains follow the stress, for packings with friction."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.check import integer, positive
from packmech.dynamics.integrators import choose_time_step, stiffness_and_damping
from packmech.dynamics.spans import Spans, with_dashpot
from packmech.effects import BackgroundDamping, Repulsion
from packmech.measure.contact_forces import contact_forces
from packmech.measure.counting import packing_fraction
from packmech.mechanics.stability import stability
from packmech.minimize.quench import quench
from packmech.packing import Packing
from packmech.protocols.method import JamMethod
from packmech.protocols.protocol import (
    BORNE_BY_RATTLERS,
    PRESSED,
    Protocol,
    at_packing_fraction,
    report_of,
    run_of,
    share_of,
)
from packmech.result import Outcome, Run
from packmech.scene import Scene

# time between two looks at the stress, over that of a contact
_SPAN = 10.0
# time in which strains of a box as stiff as a contact follow the stress, over that of a contact
_ANSWER = 10.0
# missing part of the pressure at which the drag ends [1]
_NEARLY = 0.05
# fraction of the shortest time of a contact that a step takes: what is at rest at the end is no matter of accuracy
_STEP = 0.15
# particles and box are watched for so many spans before the balance is looked at in full
_LOOK = 10


@dataclass(frozen=True)
class Press(JamMethod):
    """Press particles together in time, with friction or without, until they are at rest under the pressure.

    A packing that is at rest under the pressure already stays as it is.

    The box shrinks at a constant rate until most particles touch; then its strains follow the stress, the rate of
    strain being the missing stress over the stiffness of a contact and ten times that of a contact, and never faster
    than before. A drag against the local flow, and the scene's own dashpots, take the energy out; at the end motion is
    stopped again and again instead. Contacts of a scene whose dashpots are too weak for that are given one more, of
    damping .3 sqrt(k m), while it is pressed (`report["added_damping"]` [mass/time]).
    Times are counted in sqrt(m / k), mean mass over stiffness of a contact. What comes back holds its tangential
    springs.

    Parameters
    ----------
    rate
        Rate of strain at which the box shrinks [sqrt(k / m)]. Once most particles touch the pressure
        limits it, too.
    drag
        Rate at which velocities and spins relax to the local flow [sqrt(k / m)].
    force_tolerance
        Largest net force, and torque over radius, over the mean normal force at the end [1].
    start_packing_fraction
        Where pressing begins; None: as the packing stands.
    step_limit
        Maximum number of time steps.

    """

    honors = {"isotropic": "friction rolling links shapes kinds", "free": "friction rolling links shapes kinds"}

    rate: float = 1e-4
    drag: float = 0.1
    force_tolerance: float = 1e-8
    start_packing_fraction: float | None = None
    step_limit: int = 20_000_000

    def __post_init__(self) -> None:
        for name in ("rate", "drag", "force_tolerance"):
            positive(name, getattr(self, name))
        if self.start_packing_fraction is not None:
            positive("start_packing_fraction", self.start_packing_fraction)
        integer("step_limit", self.step_limit, at_least=1)

    def follow(self, protocol: Protocol, pressure: float) -> tuple[Packing, Outcome]:
        """Return the packing at the pressure [energy_scale / diameter^d] and how the protocol ended."""
        scene, threads = protocol.scene, protocol.loop.settings.threads
        if self.start_packing_fraction is not None:
            scene = scene.replace(packing=at_packing_fraction(scene.packing, self.start_packing_fraction))
        elif scene.packing.tangential is None and not protocol.continues:
            # overlaps of a random start would press where nothing is jammed
            bare = Scene(scene.packing, tuple(one for one in scene.effects if isinstance(one, Repulsion)))
            with protocol.stage("relaxing the start") as figures:
                start = quench(
                    bare, force_tolerance=1e-3, threads=threads, time_limit=protocol.loop.time_left, check=False
                )
                figures.residual, figures.steps, figures.force_evaluations = (
                    start.residual, start.steps, start.force_evaluations
                )  # fmt: skip
            scene = scene.replace(packing=start.packing)
            if not start.ok:
                return start.packing, start.outcome
        pressing = _Pressing(self, protocol, scene, pressure * scene.pressure_unit)
        if protocol.continues and pressing.at_rest():
            with protocol.stage("pressing") as figures:
                figures.residual = pressing.figures()[0]
                figures.note = "at rest under the pressure as it stands"
            protocol.report.update(pressing.report())
            return scene.packing, Outcome.CONVERGED
        with protocol.stage("pressing") as figures:
            outcome = Outcome.FINISHED
            while outcome is Outcome.FINISHED and pressing.calm < _LOOK:
                outcome = pressing.press()
            figures.residual, figures.steps, figures.force_evaluations = pressing.figures()
            figures.note = f"packing fraction {packing_fraction(pressing.packing):.6f}, rate {self.rate:g}"
        if outcome is Outcome.FINISHED:
            taken = pressing.steps
            with protocol.stage("settling under pressure") as figures:
                outcome = pressing.settle()
                figures.residual, figures.steps, figures.force_evaluations = pressing.figures(taken)
                figures.note = f"kinetic energy {pressing.report()['kinetic_energy']:.1e} of pressure times volume"
        protocol.report.update(pressing.report())
        return pressing.packing, outcome

    def finish(self, protocol: Protocol, outcome: Outcome, asked: float | None, began: float) -> Run:
        """Return the run that ended with the protocol's last packing, judged by the forces of all its contacts."""
        packing = protocol.last
        found = contact_forces(protocol.scene.replace(packing=packing))
        counts = {"particles": packing.particles, **found.to_dict()}
        del counts["pressure"]
        report = report_of(protocol, found, counts, asked, type(self).__name__)
        contacts, rattling = found.contacts, found.rattlers_n
        report["backbone_pressure"] = share = share_of(
            found.virial_c, ~(rattling[contacts.i_c] | rattling[contacts.j_c])
        )
        if outcome.ok and outcome is not Outcome.UNJAMMED:
            judged_as = stability(found.scene, found.largest_imbalance)
            report.update(judged_as.to_dict())
            if share < 1.0 - BORNE_BY_RATTLERS:
                outcome = Outcome.NOT_JAMMED
            elif judged_as.negative:
                outcome = Outcome.UNSTABLE
        return run_of(protocol, packing, outcome, found.residual, report, began, self.force_tolerance)


class _Pressing:
    """A packing on its way, in spans of time steps in each of which the box deforms at one rate."""

    def __init__(self, method: Press, protocol: Protocol, scene: Scene, pressure: float) -> None:
        self.method, self.protocol, self.pressure = method, protocol, pressure
        packing = scene.packing
        stiff = stiffness_and_damping(scene)[0]
        self.tau = math.sqrt(float(packing.mass_n.mean()) / stiff)
        drag = BackgroundDamping(method.drag / self.tau)
        damped, self.added_damping = with_dashpot(scene)
        self.scene = damped.replace(effects=(*damped.effects, drag))
        self.dt = choose_time_step(self.scene, _STEP)
        self.span = max(1, round(_SPAN * self.tau / self.dt))
        d = packing.dimension
        self.answer = _ANSWER * self.tau
        self.modulus = stiff * packing.reference_diameter ** (2 - d)
        self.spans = Spans(self.scene, self.dt, threads=protocol.loop.settings.threads)
        self.calm = 0

    @property
    def packing(self) -> Packing:
        """The packing as it is now."""
        return self.spans.scene.packing

    @property
    def steps(self) -> int:
        """Steps taken."""
        return self.spans.steps

    def press(self) -> Outcome:
        """Let the strains follow the stress for a span, under the drag."""
        missing = self._missing()
        outcome = self._advance(self._rate(missing))
        self.calm = self.calm + 1 if float(np.abs(missing).max()) <= _NEARLY * self.pressure else 0
        return outcome

    def settle(self) -> Outcome:
        """Let the strains follow the stress until everything is at rest.

        The drag is gone (`Spans.come_to_rest`).
        """
        self.spans.scene = self.spans.scene.replace(effects=self.spans.scene.effects[:-1])
        return self.spans.come_to_rest(lambda: self._advance(self._rate(self._missing())), self.at_rest, _LOOK)

    def at_rest(self) -> bool:
        """Return whether forces, torques and stress are in balance under the pressure."""
        quiet = self.figures()[0] <= self.method.force_tolerance
        if not quiet or float(np.abs(self._missing()).max()) > PRESSED * self.pressure:
            return False
        found = contact_forces(self.protocol.scene.replace(packing=self.packing))
        return found.residual <= self.method.force_tolerance

    def _missing(self) -> NDArray[np.float64]:
        """Return the (d, d) stress that is missing to the pressure, its trace alone where the box keeps its shape."""
        d = self.packing.dimension
        missing = self.spans.stress_dd + self.pressure * np.eye(d)
        if len(self.protocol.basis_kdd) == 1:
            missing = np.trace(missing) / d * np.eye(d)
        return np.asarray(0.5 * (missing + missing.T))

    def _rate(self, missing_dd: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (d, d) rate of strain that answers to missing stress."""
        fastest = self.method.rate / self.tau
        size = float(np.abs(missing_dd).max())
        # few contacts press by collisions and drag alone: nothing is jammed yet
        dilute = self.spans.contacts < self.packing.particles
        rate = fastest if dilute else min(fastest, size / (self.modulus * self.answer))
        return -rate / size * missing_dd if size > 0.0 else missing_dd

    def figures(self, before: int = 0) -> tuple[float, int, int]:
        """Return residual, steps since a number of them, and force evaluations."""
        return self.spans.residual, self.steps - before, self.steps - before

    def report(self) -> dict[str, Any]:
        """Return what pressing adds to the report of the run."""
        return {
            "rate": self.method.rate,
            "added_damping": self.added_damping,
            "time": self.steps * self.dt / self.tau,
            # over the work that the pressure would do on the whole volume
            "kinetic_energy": self.spans.kinetic_energy / (self.pressure * self.packing.box.volume),
        }

    def _advance(self, rate_dd: NDArray[np.float64]) -> Outcome:
        """Take a span of steps in which the box deforms at this rate."""
        self.protocol.loop.check_time()
        steps = min(self.span, self.method.step_limit - self.steps)
        if steps <= 0:
            return Outcome.STEP_LIMIT
        if not self.spans.advance(rate_dd, steps):
            return Outcome.STEP_TOO_LONG
        self.protocol.last = self.packing
        self.protocol.loop.report("pressing", packing=self.packing, steps=self.steps, residual=self.figures()[0])
        return Outcome.FINISHED
