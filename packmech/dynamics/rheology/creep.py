"""Creep: the strain of a box that answers to a constant stress."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.check import integer, positive, real
from packmech.dynamics.march.flow import Ramp
from packmech.dynamics.march.journey import tensors
from packmech.dynamics.motion import stiffness_and_damping
from packmech.dynamics.rheology.travel import Manner, Method, Progress, StrainRun, Travel, check_arguments, two_axes
from packmech.dynamics.strain import SteadyStrain
from packmech.interrupts import safe_interrupts
from packmech.outcome import NotConverged, Outcome
from packmech.scene import Scene

STAGE = "creep"
# the strain's rate is renewed so often in the shortest time in which a box of this inertia answers
_OFTEN = 0.02
_TELL = 100


@dataclass(frozen=True, eq=False, kw_only=True)
class Creep(StrainRun):
    """A run at constant stress.

    Attributes
    ----------
    applied_stress
        The stress [energy/length^d].
    hold
        How long it acted; none acts after [time].
    inertia, viscosity
        W and eta of the box's equation of motion [mass length^2], [energy time/length^d].

    """

    applied_stress: float
    hold: float
    inertia: float
    viscosity: float

    @property
    def compliance_t(self) -> NDArray[np.float64]:
        """The (T,) creep compliances gamma / stress [length^d/energy]."""
        return np.asarray(self.strain_t / self.applied_stress)


def creep(
    scene: Scene,
    *,
    stress: float,
    duration: float,
    hold: float | None = None,
    inertia: float | None = None,
    viscosity: float | None = None,
    axes: tuple[int, int] = (0, 1),
    dt: float | None = None,
    method: Method | None = None,
    mass_n: ArrayLike | None = None,
    velocity_nd: ArrayLike | None = None,
    spin_nk: ArrayLike | None = None,
    held_n: ArrayLike | None = None,
    frames: int = 0,
    time_limit: float | None = None,
    progress: Progress | None = None,
    check: bool = True,
) -> Creep:
    """Return how the box shears under a constant stress.

    The strain has an equation of motion of its own, W gamma'' = V (stress - sigma - eta gamma'), with sigma the overall
    stress of the particles along the axes, W the box's inertia and eta a viscosity beside it. It is stepped by the
    semi-implicit Euler method with the rate constant over a few time steps (a fiftieth of the time in which a box that
    is as stiff as a contact would answer), so that gamma(t) is of first order in these; where the box comes to rest
    sigma is the stress, whatever W and eta are.

    Parameters
    ----------
    scene
        The scene, without rigid links.
    stress
        Shear stress [energy/length^d], of any sign but not zero.
    duration
        How long [time].
    hold
        How long the stress acts; after that there is none (recovery). All the time unless given.
    inertia
        W [mass length^2]. Unless given M H^2 / 12 with the total mass M and H = V^(1/d): the inertia of the sheared
        material itself, so that the box answers as fast as its own slowest shear wave.
    viscosity
        eta [energy time/length^d]; 0 lets the box ring. Unless given, critical for a box as stiff as a contact:
        2 sqrt(W E / V) with E = stiffness d^(2 - dimension).
    axes
        Direction of the displacements, and of their gradient.
    dt, method, mass_n, velocity_nd, spin_nk, held_n, frames, time_limit, progress, check
        As in `oscillatory_shear`.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind or out of its bounds.
    NotConverged
        If the end was not reached and `check` is set; its `.run` holds what was.
    KeyboardInterrupt
        Passed on with `.run` set to what was reached.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.lattice_packing("triangular", repeats=(4, 4), relative_overlap=0.01)
    >>> scene = pm.Scene(packing, (pm.Repulsion(law=pm.LinearSpring()), pm.BackgroundDamping(0.5)))
    >>> run = pm.creep(scene, stress=1e-4, duration=200.0)
    >>> round(1 / float(run.compliance_t[-1]), 3)  # the shear modulus
    0.42

    """
    manner = check_arguments(
        scene,
        dt=dt,
        method=method,
        mass_n=mass_n,
        velocity_nd=velocity_nd,
        spin_nk=spin_nk,
        held_n=held_n,
        time_limit=time_limit,
        progress=progress,
        check=check,
    )
    load = real("stress", stress)
    if load == 0.0:
        raise ValueError("stress must not be zero, got 0.0")
    time = positive("duration", duration)
    held = time if hold is None else real("hold", hold, above=0.0, at_most=time)
    packing = scene.packing
    d, volume = packing.dimension, packing.box.volume
    if inertia is None:
        weight = float(manner.mass_n.sum()) * volume ** (2.0 / d) / 12.0
    else:
        weight = positive("inertia", inertia)
    stiff = stiffness_and_damping(scene)[0] * packing.reference_diameter ** (2 - d)
    eta = 2.0 * math.sqrt(weight * stiff / volume)
    if viscosity is not None:
        eta = real("viscosity", viscosity, at_least=0.0)
    answer = min(math.sqrt(weight / (volume * stiff)) if stiff > 0.0 else math.inf, time)
    chunk = max(1, int(_OFTEN * answer / manner.longest))
    turns = max(1, math.ceil(time / (manner.longest * chunk) * (1.0 - 1e-12)))
    pair = two_axes(axes)
    travel = Travel(
        manner,
        dt=time / (turns * chunk),
        steps=turns * chunk,
        every=turns * chunk + 1,
        profile=Ramp(0.0, 0.0, 0.0, math.inf),
        direction_dd=SteadyStrain(0.0, axes=pair).direction(d),
        frames=integer("frames", frames, at_least=0),
    )
    driven = {"applied_stress": load, "hold": held, "inertia": weight, "viscosity": eta}
    try:
        with safe_interrupts():
            outcome = _drive(travel, manner, chunk, pair, driven)
    except KeyboardInterrupt as stop:
        stop.run = Creep(**travel.fields(STAGE, Outcome.INTERRUPTED, pair), **driven)  # type: ignore[attr-defined]
        raise
    run = Creep(**travel.fields(STAGE, outcome, pair), **driven)
    if check and not run.ok:
        raise NotConverged(run)
    return run


def _drive(travel: Travel, manner: Manner, chunk: int, axes: tuple[int, int], driven: dict[str, Any]) -> Outcome:
    packing = manner.scene.packing
    volume, weight, eta = packing.box.volume, driven["inertia"], driven["viscosity"]
    rows = travel.driven_rows = [travel.first]
    span = chunk * travel.dt
    rate = 0.0
    while travel.march.steps < travel.steps:
        sigma = float(tensors(rows[-1], packing.dimension, volume)["overall"][axes])
        # what ends within half a span ends now
        load = driven["applied_stress"] if travel.march.time < driven["hold"] - 0.5 * span else 0.0
        rate = (rate + span * volume * (load - sigma) / weight) / (1.0 + span * volume * eta / weight)
        travel.drive(rate)
        due = len(rows) % _TELL == 0
        # frames fall on the ends of spans
        outcome = travel.advance(chunk, STAGE, tell=due)
        if outcome is Outcome.STEP_TOO_LONG:
            return outcome
        rows.append(travel.march.see())
        if outcome is not Outcome.FINISHED:
            return outcome
    return Outcome.FINISHED
