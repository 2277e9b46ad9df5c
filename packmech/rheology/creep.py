"""Creep: the strain of a box that answers to a constant stress."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Unpack

import numpy as np
from numpy.typing import NDArray

from packmech.check import positive, real
from packmech.dynamics.deformation import Ramp, SteadyStrain
from packmech.dynamics.integrators import stiffness_and_damping
from packmech.dynamics.observables import tensors
from packmech.result import Row, particles_in_words
from packmech.rheology.arguments import Common, check_arguments, listed, two_axes
from packmech.rheology.strain_run import StrainRun, StrainTask
from packmech.scene import Scene

STAGE = "creep"
# the strain's rate is renewed so often in the shortest time in which a box of this inertia answers
_OFTEN = 0.02
# spans from one call of `progress` to the next
_REPORT = 100


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
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

    @property
    def title(self) -> str:
        """What the run is of, in words."""
        return f"{particles_in_words(self.packing)} under a shear stress of {self.applied_stress:g}"

    def to_dict(self) -> dict[str, Any]:
        """Return what the run reached by name, as plain values; stresses in the scene's units of energy/length^d."""
        held = float(self.strain_t[self.time_t <= self.hold * (1.0 + 1e-9)][-1])
        return {**super().to_dict(), "strain_under_stress": held, "compliance": held / self.applied_stress}

    def rows(self) -> list[Row]:
        """Return what the run reached: name, value, and what the value is."""
        told, (outcome, *rest) = self.to_dict(), super().rows()
        return [
            outcome,
            ("strain under stress", f"{told['strain_under_stress']:.6g}", "when the stress ends"),
            ("compliance", f"{told['compliance']:.6g}", "that strain over the stress"),
            *rest,
        ]


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
    settings = check_arguments(scene, **common)
    load = real("stress", stress)
    if load == 0.0:
        raise ValueError("stress must not be zero, got 0.0")
    time = positive("duration", duration)
    held = time if hold is None else real("hold", hold, above=0.0, at_most=time)
    packing = scene.packing
    d, volume = packing.dimension, packing.box.volume
    if inertia is None:
        weight = float(settings.mass_n.sum()) * volume ** (2.0 / d) / 12.0
    else:
        weight = positive("inertia", inertia)
    stiff = stiffness_and_damping(scene)[0] * packing.reference_diameter ** (2 - d)
    eta = 2.0 * math.sqrt(weight * stiff / volume)
    if viscosity is not None:
        eta = real("viscosity", viscosity, at_least=0.0)
    answer = min(math.sqrt(weight / (volume * stiff)) if stiff > 0.0 else math.inf, time)
    chunk = max(1, int(_OFTEN * answer / settings.longest))
    turns = max(1, math.ceil(time / (settings.longest * chunk) * (1.0 - 1e-12)))
    pair = two_axes(axes)
    driven = {"applied_stress": load, "hold": held, "inertia": weight, "viscosity": eta}
    span = chunk * time / (turns * chunk)

    def drive(task: StrainTask) -> None:
        """Give the box the rate of strain, which is stepped like a velocity."""
        rows, rate = task.driven_rows, task.engine.profile.rate
        assert rows is not None
        sigma = float(tensors(rows[-1], d, volume)["overall"][pair])
        # what ends within half a span ends now
        acting = load if task.engine.time < held - 0.5 * span else 0.0
        task.drive_at((rate + span * volume * (acting - sigma) / weight) / (1.0 + span * volume * eta / weight))

    task = StrainTask(
        settings,
        STAGE,
        dt=time / (turns * chunk),
        steps=turns * chunk,
        every=turns * chunk + 1,
        profile=Ramp(0.0, 0.0, 0.0, math.inf),
        direction_dd=SteadyStrain(0.0, axes=pair).direction(d),
        further={**driven, "chunk": chunk},
        drive=drive,
        span=chunk,
        report_every=_REPORT,
    )
    return task.run(lambda outcome: Creep(**task.fields(outcome, pair), **driven))
