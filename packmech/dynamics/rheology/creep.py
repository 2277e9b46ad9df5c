"""Creep: the strain of a box that answers to a constant stress."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from packmech.check import positive, real
from packmech.dynamics.march.flow import Ramp
from packmech.dynamics.march.journey import tensors
from packmech.dynamics.motion import stiffness_and_damping
from packmech.dynamics.rheology.manner import Common, check_arguments, listed, two_axes
from packmech.dynamics.rheology.travel import StrainRun, Travel
from packmech.dynamics.strain import SteadyStrain
from packmech.interrupts import held_interrupts
from packmech.outcome import Outcome
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


@listed(Common)
def creep(
    scene: Scene,
    *,
    stress: float,
    duration: float,
    hold: float | None = None,
    inertia: float | None = None,
    viscosity: float | None = None,
    axes: tuple[int, int] = (0, 1),
    **common: Unpack[Common],
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
    dt, method, mass_n, velocity_nd, spin_nk, held_n, frames, time_limit, progress, checkpoint, check
        As in `oscillatory_shear`.

    Raises
    ------
    TypeError, ValueError, NotConverged, KeyboardInterrupt
        As in `oscillatory_shear`.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.lattice_packing("triangular", repeats=(4, 4), relative_overlap=0.01)
    >>> scene = pm.Scene(packing, (pm.Repulsion(law=pm.LinearSpring()), pm.BackgroundDamping(0.5)))
    >>> run = pm.creep(scene, stress=1e-4, duration=200.0)
    >>> round(1 / float(run.compliance_t[-1]), 3)  # the shear modulus
    0.42

    """
    manner = check_arguments(scene, **common)
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
    driven = {"applied_stress": load, "hold": held, "inertia": weight, "viscosity": eta}
    travel = Travel(
        manner,
        dt=time / (turns * chunk),
        steps=turns * chunk,
        every=turns * chunk + 1,
        profile=Ramp(0.0, 0.0, 0.0, math.inf),
        direction_dd=SteadyStrain(0.0, axes=pair).direction(d),
        driven=True,
        further={**driven, "chunk": chunk},
    )
    return travel.end(
        lambda: _drive(travel, chunk, pair, driven),
        lambda outcome: Creep(**travel.fields(STAGE, outcome, pair), **driven),
    )


def _drive(travel: Travel, chunk: int, axes: tuple[int, int], driven: dict[str, Any]) -> Outcome:
    packing = travel.manner.scene.packing
    volume, weight, eta = packing.box.volume, driven["inertia"], driven["viscosity"]
    rows = travel.driven_rows
    assert rows is not None
    span = chunk * travel.dt
    while travel.march.steps < travel.steps:
        # the rate of strain is part of the state: it is stepped like a velocity
        rate = travel.march.profile.rate
        sigma = float(tensors(rows[-1], packing.dimension, volume)["overall"][axes])
        # what ends within half a span ends now
        load = driven["applied_stress"] if travel.march.time < driven["hold"] - 0.5 * span else 0.0
        rate = (rate + span * volume * (load - sigma) / weight) / (1.0 + span * volume * eta / weight)
        with held_interrupts():
            travel.drive(rate)
            # frames fall on the ends of spans
            if not travel.advance(chunk):
                return Outcome.STEP_TOO_LONG
            rows.append(travel.march.see())
        if len(rows) % _TELL == 0:
            travel.tell(STAGE)
        if travel.late():
            return Outcome.INTERRUPTED
    return Outcome.FINISHED
