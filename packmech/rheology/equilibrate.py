"""Preparation: a scene brought to rest before it is sheared, with what is left of its oscillation."""

from __future__ import annotations

import dataclasses
import json
import math
from dataclasses import dataclass
from typing import Any, Unpack

import numpy as np

from packmech.calls.honors import honors
from packmech.check import brief, check_steps, integer, positive, two_axes
from packmech.dynamics.deformation import OscillatoryStrain, Sine
from packmech.effects import BackgroundDamping, Repulsion, bonds_of
from packmech.loop.checkpoint import Arrays, IndexBounds, scene_fingerprints
from packmech.mechanics.elasticity import elastic_moduli
from packmech.minimize.quench import quench
from packmech.packing import Packing
from packmech.result import Condition, NotConverged, Outcome, Row, Run, Stage, unmet_conditions
from packmech.rheology.arguments import AtRest, StrainSettings, check_arguments, listed
from packmech.rheology.oscillatory import characteristic_time, frequency_of, rest_row
from packmech.rheology.strain_run import StrainPlan, StrainRun, StrainTask
from packmech.scene import Scene

STAGE = "baseline"
_QUENCHED = 1e-10
# figures kept in a period of the baseline
_SAMPLES = 200
# while a scene settles, drag relaxes velocities at least at this rate times 1/tau
_SETTLING = 0.5
# periods without a smaller oscillation than all before, after which none is waited for
_STALLED = 50


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Equilibration(Run):
    """A scene at rest, and how much its stress still oscillates where nothing shears it.

    Attributes
    ----------
    oscillation
        Half the distance between the largest and the smallest shear stress in one period without strain, from rest with
        slack tangential springs: as what follows will start [energy/length^d].
    expected_stress
        The stress amplitude that it was compared with [energy/length^d].
    periods
        Periods that were stepped through, to measure and to settle.
    baseline
        The period that was measured.

    """

    oscillation: float
    expected_stress: float
    periods: int
    baseline: StrainRun

    @property
    def ratio(self) -> float:
        """The oscillation over the expected amplitude [1]."""
        return self.oscillation / self.expected_stress

    @property
    def title(self) -> str:
        """What the run is of, in words."""
        return f"{super().title} at rest"

    def to_dict(self) -> dict[str, Any]:
        """Return what the run reached by name, as plain values; stresses in the scene's units of energy/length^d."""
        return {
            **super().to_dict(),
            "residual_oscillation": self.oscillation,
            "expected_stress": self.expected_stress,
            "oscillation_ratio": self.ratio,
        }

    def rows(self) -> list[Row]:
        """Return what the run reached: name, value, and what the value is."""
        return [*super().rows(), rest_row(self.ratio, self.expected_stress)]


@listed(AtRest)
@honors("repulsion kinds damping friction rolling bonds interactions gravity walls drag shapes")
def equilibrate(
    scene: Scene,
    *,
    amplitude: float,
    frequency: float | None = None,
    relative_frequency: float | None = None,
    largest_oscillation: float = 0.1,
    expected_stress: float | None = None,
    frictionless: bool | None = None,
    axes: tuple[int, int] = (0, 1),
    step_limit: int = 500_000,
    **common: Unpack[AtRest],
) -> Equilibration:
    """Return the scene's packing at rest: frictionless equilibrium first, then that under all effects.

    The protocol of section 6 of particleShear's documentation. First the energy of what repels is minimized without
    friction. Then one period is stepped through with all effects and without strain; where the shear stress oscillates
    too much, particles settle for another period under stronger drag and are measured again. Each measurement starts at
    rest with slack tangential springs, as whatever follows will; what is returned is where the last one began.

    Parameters
    ----------
    scene
        The scene, without rigid links.
    amplitude
        Of the strain that is to follow [1].
    frequency, relative_frequency
        One of them, as for `oscillatory_shear`: a period is measured.
    largest_oscillation
        Ends when the oscillation is below this times the expected amplitude [1].
    expected_stress
        Amplitude of the stress to come [energy/length^d]. Unless given: the strain's times the shear modulus of the
        frictionless packing without bonds; friction and bonds only add to it.
    frictionless
        Whether to begin with the frictionless minimum. Unless given: where the scene has no bonds, as those are made in
        a packing that is there already.
    axes
        As for `oscillatory_shear`.
    dt, method
        As for `oscillatory_shear`.
    step_limit
        Largest number of time steps.
    time_limit
        Stop after so much CPU time, compiling aside [s], with Outcome.TIME_LIMIT.
    progress
        Called now and then as progress(stage, figures).
    checkpoint
        As in `oscillatory_shear`, one file for all periods.
    check
        Raise NotConverged when the frictionless minimum was not found or the oscillation did not come down; otherwise
        return what it came to all the same.

    Returns
    -------
    Equilibration
        Outcome.CONVERGED, or Outcome.STEP_LIMIT. Where the frictionless minimum was not found, the outcome of that
        minimization, after one period from where it ended; `expected_stress` is nan unless given.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind or out of its bounds.
    NotConverged
        If the frictionless minimum was not found or the oscillation did not come down, and `check` is set; its `.run`
        holds what was.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.random_packing(30, dimension=2, packing_fraction=1.0, seed=1)
    >>> scene = pm.Scene(packing, (pm.Repulsion(pm.LinearSpring()), pm.BackgroundDamping(0.1)))
    >>> ready = pm.equilibrate(scene, amplitude=0.01, relative_frequency=0.025)
    >>> ready.outcome.name, ready.ratio < 1e-6
    ('CONVERGED', True)

    """
    settings = check_arguments(scene, **common)
    size, rate = positive("amplitude", amplitude), frequency_of(settings, frequency, relative_frequency)
    pair = two_axes("axes", axes, dimension=scene.packing.dimension)
    largest = positive("largest_oscillation", largest_oscillation)
    limit = integer("step_limit", step_limit, at_least=1)
    check_steps("1 / frequency", 1.0 / rate, settings.longest)
    bonded = bonds_of(scene.effects) is not None
    if frictionless is not None and not isinstance(frictionless, bool):
        raise TypeError(f"frictionless must be True, False or None, got {brief(frictionless)}")
    stages: list[Stage] = []
    packing, start = scene.packing.replace(tangential=None), Outcome.CONVERGED
    if frictionless or (frictionless is None and not bonded):
        minimum = _Minimum(_frictionless(scene), settings)
        packing, stages, start = minimum.packing, minimum.stages, minimum.outcome
        if start is Outcome.TIME_LIMIT:
            # the file keeps whole minimizations only
            settings = dataclasses.replace(settings, file=None)
    if expected_stress is not None:
        expected = positive("expected_stress", expected_stress)
    else:
        # what is not at rest has no modulus
        expected = _expected(scene, packing, size) if start.ok and not settings.loop.late else math.nan

    each = max(_SAMPLES, math.ceil(1.0 / (rate * settings.longest)))
    every = max(1, each // _SAMPLES)
    each = every * math.ceil(each / every)
    plan = StrainPlan(
        STAGE,
        dt=1.0 / (rate * each),
        steps=each,
        every=every,
        # a sine of no amplitude, so that the loops compiled for oscillatory shear serve
        profile=Sine(0.0, 2.0 * math.pi * rate, 0.0, math.inf),
        direction_dd=OscillatoryStrain(size, rate, axes=pair).direction(scene.packing.dimension),
        axes=pair,
    )
    periods, taken, since, least = 0, 0, 0, math.inf
    while True:
        run = _period(settings, scene.replace(packing=packing), plan)
        outcome = run.outcome
        stages += run.stages
        periods, taken = periods + 1, taken + run.steps
        stress = run.shear_stress_t
        oscillation = 0.5 * float(stress.max() - stress.min())
        found = oscillation < largest * expected
        since = 0 if oscillation < least else since + 1
        least = min(least, oscillation)
        stalled = since == _STALLED
        if found or stalled or outcome is not Outcome.FINISHED or not start.ok or taken + 2 * each > limit:
            break
        settled = _period(settings, _dragged(scene, settings).replace(packing=packing), plan)
        outcome = settled.outcome
        periods, taken = periods + 1, taken + settled.steps
        packing = settled.packing.replace(tangential=None)
        stages += settled.stages
    if outcome is Outcome.FINISHED:
        missed = Outcome.STALLED if stalled else Outcome.STEP_LIMIT
        outcome = (Outcome.CONVERGED if found else missed) if start.ok else start
    made = Equilibration(
        packing=packing,
        outcome=outcome,
        residual=run.residual,
        steps=taken,
        force_evaluations=sum(stage.force_evaluations for stage in stages),
        seconds=sum(stage.seconds for stage in stages),
        build_seconds=run.build_seconds,
        stages=tuple(stages),
        oscillation=oscillation,
        expected_stress=expected,
        periods=periods,
        baseline=run,
        unmet=unmet_conditions(outcome, Condition("residual oscillation", oscillation / expected, largest)),
    )
    if settings.loop.settings.check and not made.ok:
        raise NotConverged(made)
    return made


def _frictionless(scene: Scene) -> Scene:
    return Scene(scene.packing, tuple(one for one in scene.effects if isinstance(one, Repulsion)))


class _Minimum:
    """The energy minimum of a scene: its positions and the stages to it, from a checkpoint if they are there."""

    def __init__(self, scene: Scene, settings: StrainSettings) -> None:
        self.scene, self.packing, self.stages = scene, scene.packing, list[Stage]()
        self.outcome = Outcome.CONVERGED
        file = settings.file
        if file is not None and file.begin(self, {**scene_fingerprints(scene), "minimum": _QUENCHED}):
            return
        loop = settings.loop
        found = quench(
            scene,
            force_tolerance=_QUENCHED,
            time_limit=loop.time_left,
            progress=loop.settings.progress,
            check=False,
        )
        self.packing, self.stages, self.outcome = found.packing, list(found.stages), found.outcome
        if loop.settings.check and not found.ok and found.outcome is not Outcome.TIME_LIMIT:
            raise NotConverged(found)
        if file is not None and found.ok:
            file.write(self, finished=True)

    def arrays(self) -> Arrays:
        """Return what a checkpoint keeps."""
        stages = json.dumps([dataclasses.asdict(one) for one in self.stages])
        turned = self.packing.shapes.turned_arrays()
        return {"position_nd": self.packing.position_nd, "stages": np.array(stages), **turned}

    def index_bounds(self) -> dict[str, IndexBounds]:
        """Return that there are no arrays of integers."""
        return {}

    def restore(self, kept: Arrays) -> None:
        """Take what a checkpoint kept."""
        shapes = self.scene.packing.shapes
        turned = shapes.oriented(kept.get("orientation_nq", shapes.orientation_nq))
        self.packing = self.scene.packing.replace(position_nd=kept["position_nd"], shapes=turned)
        self.stages = [Stage(**one) for one in json.loads(str(kept["stages"]))]


def _expected(scene: Scene, packing: Packing, amplitude: float) -> float:
    """Return the stress that the shear modulus of the frictionless packing lets expect."""
    modulus = elastic_moduli(_frictionless(scene.replace(packing=packing))).shear_modulus
    if not (math.isfinite(modulus) and modulus > 0.0):
        raise ValueError(
            f"expected_stress must be given where nothing resists shear without friction, got the modulus {modulus:g}"
        )
    return amplitude * modulus


def _dragged(scene: Scene, settings: StrainSettings) -> Scene:
    """Return the scene with its background damping, if it has any, strong enough to settle in."""
    rate = _SETTLING / characteristic_time(settings.scene)
    effects = (
        BackgroundDamping(max(rate, one.rate)) if isinstance(one, BackgroundDamping) else one for one in scene.effects
    )
    return scene.replace(effects=tuple(effects))


def _period(settings: StrainSettings, scene: Scene, plan: StrainPlan) -> StrainRun:
    """Return one period of a scene without strain, from rest."""
    task = StrainTask(dataclasses.replace(settings, scene=scene), plan)
    return task.run(lambda outcome: StrainRun(**task.fields(outcome)), check=False)
