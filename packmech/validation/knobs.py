"""What decides how exact the run of a scene is and what it costs: the settings of its drive, from coarse to fine."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

from packmech.check import brief, did_you_mean, table
from packmech.dynamics.integrators import SemiImplicitEuler, VelocityVerlet, choose_time_step
from packmech.files.records import is_record, kind_of
from packmech.minimize.first_order.conjugate_gradient import ConjugateGradient
from packmech.minimize.first_order.fire import Fire
from packmech.minimize.first_order.lbfgs import LBFGS
from packmech.scene import Scene

# time steps begin at this fraction of the fastest time of a scene, four times what a run takes by itself
_COARSEST = 0.2
# settings of one kind that a search may go through
_RUNGS = 16
# a reference is so many settings finer than what is compared with it
_BEYOND = 2
# of settings that cost twice as much each, and of tolerances, how much finer each is
_DOUBLED, _DECADE = 2.0, 10.0


@dataclass(frozen=True)
class Knob:
    """A setting of a scene, and what it may be set to.

    Attributes
    ----------
    path
        The field, as `drive.dt`.
    values
        From coarse to fine; or, where `alternatives`, of which the first is trusted.
    alternatives
        Whether the values are ways to one answer, none finer than another.
    factor
        How much finer each value is than the one before; 0 where nothing is known of it, and the last is the reference.

    """

    path: str
    values: tuple[Any, ...]
    alternatives: bool = False
    factor: float = 0.0

    @property
    def last(self) -> int:
        """The finest setting that has a reference."""
        return len(self.values) - 1 - (0 if self.alternatives else _BEYOND if self.factor else 1)

    @property
    def first_cap(self) -> int:
        """The finest setting that is tried at first; where finer ones cost no better reference, the last."""
        return {0.0: self.last, _DECADE: 2}.get(self.factor, 0)

    def reference(self, cap: int) -> int:
        """Return the place of the reference for settings up to a cap; of alternatives the first is trusted."""
        return 0 if self.alternatives else cap + _BEYOND if self.factor else len(self.values) - 1

    @property
    def costs(self) -> bool:
        """Whether finer values are sure to cost more: a loose tolerance may cost more than a tight one."""
        return self.factor == _DOUBLED

    def lacking(self, k: int, reference: int) -> float:
        """Part of an error of first order that the reference still has, so that a difference from it lacks it."""
        return self.factor ** (k - reference) if self.factor else 0.0


def label(value: Any) -> str:
    """Return the value of a setting in words."""
    if value is None:
        return "default"
    if is_record(value):
        return kind_of(type(value))
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def of_a_duration(scene: Scene) -> Scene:
    """Return the scene with a drive that goes on for a time, where it said how many steps of which length."""
    drive = scene.drive
    if getattr(drive, "steps", None) is None or not hasattr(drive, "duration"):
        return scene
    fraction = VelocityVerlet().fraction if drive.method is None else drive.method.fraction
    dt = choose_time_step(scene, fraction) if drive.dt is None else drive.dt
    return scene.replace(drive=replace(drive, steps=None, duration=drive.steps * dt))


def set_fields(scene: Scene, changes: Mapping[str, Any]) -> Scene:
    """Return the scene with other values in fields of its drive, by their paths."""
    named = {path.removeprefix("drive."): value for path, value in changes.items()}
    return scene.replace(drive=replace(scene.drive, **named))


def usual_knobs(scene: Scene) -> tuple[Knob, ...]:
    """Return what a search turns of a scene's drive where nothing else is asked for.

    Time steps and integrators, tolerances and minimizers, numbers of periods, strains that are averaged over, steps of
    strain and orders of cementing. A method that the scene names stays; so does all that is not numerics, such as
    rates and pressures.
    """
    drive = scene.drive
    named = {field.name: getattr(drive, field.name) for field in fields(drive)}
    found = []
    for name, value in named.items():
        make = _MAKERS.get((type(drive).__name__, name), _MAKERS.get(("", name)))
        values, alternatives, factor = ((), False, 0.0) if make is None else make(scene, value, named)
        if len(values) > 1:
            found.append(Knob(f"drive.{name}", tuple(values), alternatives, factor))
    # where runs fail the first is made finer: time steps
    return tuple(sorted(found, key=lambda knob: (knob.alternatives, knob.path != "drive.dt")))


def given_knobs(scene: Scene, knobs: Mapping[str, Sequence[Any]]) -> tuple[Knob, ...]:
    """Return the settings that were given by path, each from coarse to fine; the last of each is the reference."""
    table("knobs", knobs)
    if not knobs:
        raise ValueError("knobs must name a field of the drive at least, got none")
    names = [f"drive.{field.name}" for field in fields(scene.drive)]
    found = []
    for path, values in knobs.items():
        if path not in names:
            raise ValueError(
                f"knobs must name fields of the drive, such as {names[0]}, got {brief(path)}{did_you_mean(path, names)}"
            )
        if isinstance(values, str) or not isinstance(values, Sequence) or len(values) < 2:
            raise ValueError(
                f"knobs[{path!r}] must be two values at least, from coarse to fine, the last for the reference, "
                f"got {brief(values)}"
            )
        for value in values:
            set_fields(scene, {path: value})
        if path == "drive.dt" or path.endswith("tolerance"):
            for before, after in itertools.pairwise(values):
                if not after <= before:
                    raise ValueError(
                        f"knobs[{path!r}] must go from coarse to fine, which smaller values are, got {after:g} after "
                        f"{before:g}"
                    )
        found.append(Knob(path, tuple(values)))
    return tuple(found)


# values, whether they are alternatives, and how much finer each is than the one before
_Values = tuple[Sequence[Any], bool, float]
_Maker = Callable[[Scene, Any, Mapping[str, Any]], _Values]
_NONE: _Values = ((), False, 0.0)


def _by_two(first: float, growth: float, more: float = 0.0) -> _Values:
    """Return values that double, or halve, after a part that stays."""
    return [more + first * growth**k for k in range(_RUNGS)], False, _DOUBLED


def _time_steps(scene: Scene, value: float | None, named: Mapping[str, Any]) -> _Values:
    if named.get("rate", 0.0) is None:  # a deformation without a rate has no time
        return _NONE
    longest = choose_time_step(scene, _COARSEST) if value is None else 4.0 * value
    return _by_two(longest, 0.5)


def _integrators(scene: Scene, value: Any, named: Mapping[str, Any]) -> _Values:
    stepped = "dt" in named and value is None
    return ((VelocityVerlet(), SemiImplicitEuler()), True, 0.0) if stepped else _NONE


def _minimizers(scene: Scene, value: Any, named: Mapping[str, Any]) -> _Values:
    return ((None, Fire(), LBFGS(), ConjugateGradient()), True, 0.0) if value is None else _NONE


def _tolerances(scene: Scene, value: float, named: Mapping[str, Any]) -> _Values:
    return [float(f"1e-{k}") for k in range(1, _RUNGS)], False, _DECADE


def _periods(scene: Scene, value: float, named: Mapping[str, Any]) -> _Values:
    return _by_two(1.0, 2.0, float(math.ceil(named.get("skip_periods") or 0.0)))


def _strains(scene: Scene, value: float, named: Mapping[str, Any]) -> _Values:
    skipped = named["skip_strain"]
    return _by_two(0.25 * (value - skipped), 2.0, skipped)


def _strain_steps(scene: Scene, value: int | None, named: Mapping[str, Any]) -> _Values:
    if named["rate"] is not None:
        return _NONE
    return [4 * 2**k for k in range(_RUNGS)], False, _DOUBLED


def _orders(scene: Scene, value: int, named: Mapping[str, Any]) -> _Values:
    return [2**k for k in range(_RUNGS)], False, _DOUBLED


def _link_steps(scene: Scene, value: float, named: Mapping[str, Any]) -> _Values:
    return _by_two(0.2, 0.5)


# by kind of drive and field; a field of any drive first
_MAKERS: dict[tuple[str, str], _Maker] = {
    ("", "dt"): _time_steps,
    ("", "method"): _integrators,
    ("", "force_tolerance"): _tolerances,
    ("QuenchDrive", "method"): _minimizers,
    # methods of jamming end in packings of their own
    ("JamDrive", "method"): lambda scene, value, named: _NONE,
    ("OscillatoryShearDrive", "periods"): _periods,
    ("SteadyShearDrive", "applied_strain"): _strains,
    ("ShearAtPressureDrive", "applied_strain"): _strains,
    ("DeformDrive", "steps"): _strain_steps,
    ("CementDrive", "orders"): _orders,
    ("CementDrive", "step"): _link_steps,
}
