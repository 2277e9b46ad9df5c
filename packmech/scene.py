"""A scene: a packing, the effects that act on it, and what is done to it. Data only."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

from packmech.check import instance, integer, one_of, positive, real
from packmech.effects import SIGNED, energy_scale_of, is_bound, is_effect, is_law
from packmech.motion_drive import SimulateDrive
from packmech.packing import Packing
from packmech.records import is_record


@dataclass(frozen=True)
class QuenchDrive:
    """Minimize the energy in the box as it is, to `force_tolerance` times the mean contact force.

    `method` is what pm.quench takes, such as pm.ConjugateGradient(); None leaves the choice to it.
    """

    force_tolerance: float = 1e-12
    method: Any = None

    def __post_init__(self) -> None:
        positive("drive.force_tolerance", self.force_tolerance)
        _record_or_none("drive.method", self.method)
        if hasattr(self.method, "follow"):
            raise TypeError(f"drive.method must be a minimizer such as Fire() or None, got {self.method!r}")


@dataclass(frozen=True)
class JamDrive:
    """Find the jamming point, then the packing at `pressure` [energy_scale / diameter^d].

    `packmech run` and `packmech jam` do so; pm.jam is told the same by its arguments, and reads no drive. `strain` says
    whether the box keeps its shape ("fixed") or every strain is free. `pressure` and `method` are what
    pm.jam takes, such as pm.StepHalving(increment=1e-3); None leaves the choice to it.
    """

    pressure: float | None = None
    strain: str = "free"
    method: Any = None

    def __post_init__(self) -> None:
        if self.pressure is not None:
            positive("drive.pressure", self.pressure)
        one_of("drive.strain", self.strain, ("fixed", "free"))
        _record_or_none("drive.method", self.method)
        if self.method is not None and not hasattr(self.method, "follow"):
            raise TypeError(f"drive.method must be a protocol such as HardVertex() or None, got {self.method!r}")
        if self.pressure is not None and hasattr(self.method, "energy_tolerance"):
            raise ValueError(
                f"drive.pressure must be left out for a method that ends at an energy, got {self.pressure!r}"
            )


@dataclass(frozen=True)
class ShearStabilizeDrive:
    """Relax positions and every strain together, to `force_tolerance` times the mean contact force and the pressure.

    `pressure` [energy_scale / diameter^d] is what pm.shear_stabilize takes; None holds the volume.
    """

    pressure: float | None = None
    force_tolerance: float = 1e-10

    def __post_init__(self) -> None:
        if self.pressure is not None:
            positive("drive.pressure", self.pressure)
        positive("drive.force_tolerance", self.force_tolerance)


@dataclass(frozen=True)
class CementDrive:
    """Jam at `pressure` with every strain free, then cement random contacts and follow the moduli.

    `orders` random orders are drawn from `seed`; `step` and `freeze` are what pm.cement takes.
    """

    pressure: float = 1e-8
    orders: int = 5
    seed: int = 0
    step: float = 0.05
    freeze: str = "angles"

    def __post_init__(self) -> None:
        positive("drive.pressure", self.pressure)
        integer("drive.orders", self.orders, at_least=1)
        integer("drive.seed", self.seed, at_least=0)
        positive("drive.step", self.step)
        one_of("drive.freeze", self.freeze, ("angles", "clusters", "nothing"))


@dataclass(frozen=True)
class OscillatoryShearDrive:
    """Bring the scene to rest, shear it as a sine, and find the moduli of its stress.

    Parameters
    ----------
    amplitude, frequency, relative_frequency, pre_periods, periods, post_periods, skip_periods, axes, dt, method
        What pm.oscillatory_shear takes; exactly one of the frequencies.
    samples_per_period
        As there.
    density
        Mass over area, or over volume in space, of every particle [mass/length^d]. Unless given a particle of the
        reference diameter has mass 1.
    largest_oscillation
        What pm.equilibrate takes, which comes first; None: nothing does.
    plates
        Whom rough plates hold once the scene is at rest, the layer of pm.rough_plates: "crossing" or a thickness; None:
        there are none.
    carried
        What pm.oscillatory_shear takes; false only with plates.

    """

    amplitude: float
    frequency: float | None = None
    relative_frequency: float | None = None
    pre_periods: float = 0.0
    periods: float = 4.0
    post_periods: float = 0.0
    skip_periods: float | None = None
    axes: tuple[int, int] = (0, 1)
    dt: float | None = None
    method: Any = None
    samples_per_period: int = 200
    density: float | None = None
    largest_oscillation: float | None = 0.1
    plates: str | float | None = None
    carried: bool = True

    def __post_init__(self) -> None:
        for name in ("amplitude", "periods"):
            positive(f"drive.{name}", getattr(self, name))
        for name in ("frequency", "relative_frequency", "dt", "density", "largest_oscillation"):
            if getattr(self, name) is not None:
                positive(f"drive.{name}", getattr(self, name))
        if (self.frequency is None) == (self.relative_frequency is None):
            got = "neither" if self.frequency is None else "both"
            raise ValueError(f"drive.frequency must be given, or else relative_frequency, got {got}")
        for name in ("pre_periods", "post_periods"):
            real(f"drive.{name}", getattr(self, name), at_least=0.0)
        if self.skip_periods is not None:
            real("drive.skip_periods", self.skip_periods, at_least=0.0, below=self.periods)
        integer("drive.samples_per_period", self.samples_per_period, at_least=8)
        if isinstance(self.plates, str):
            one_of("drive.plates", self.plates, ("crossing",))
        elif self.plates is not None:
            positive("drive.plates", self.plates)
        instance("drive.carried", self.carried, bool)
        if not self.carried and self.plates is None:
            raise ValueError("drive.carried must be true where there are no plates, got False")
        _record_or_none("drive.method", self.method)
        _two_axes(self.axes)


@dataclass(frozen=True)
class SteadyShearDrive:
    """Shear the scene steadily at several rates, and find the mean stress at each.

    Parameters
    ----------
    rates, strain, skip_strain, blocks, samples, axes, dt, method
        What pm.steady_shear takes.
    density
        As in `OscillatoryShearDrive`.

    """

    rates: tuple[float, ...]
    strain: float = 3.0
    skip_strain: float = 1.0
    blocks: int = 8
    samples: int = 400
    axes: tuple[int, int] = (0, 1)
    dt: float | None = None
    method: Any = None
    density: float | None = None

    def __post_init__(self) -> None:
        if not isinstance(self.rates, tuple) or not self.rates:
            raise TypeError(f"drive.rates must be a tuple of shear rates, got {self.rates!r}")
        for k, rate in enumerate(self.rates):
            positive(f"drive.rates[{k}]", rate)
        real("drive.skip_strain", self.skip_strain, at_least=0.0, below=positive("drive.strain", self.strain))
        integer("drive.blocks", self.blocks, at_least=2)
        integer("drive.samples", self.samples, at_least=1)
        _check_motion(self)


@dataclass(frozen=True)
class RampStrainDrive:
    """Deform the box at a constant rate: shear, or compress it.

    Parameters
    ----------
    rate, strain, mode, samples, axes, dt, method
        What pm.ramp_strain takes.
    density
        As in `OscillatoryShearDrive`.

    """

    rate: float
    strain: float
    mode: str = "shear"
    samples: int = 200
    axes: tuple[int, int] = (0, 1)
    dt: float | None = None
    method: Any = None
    density: float | None = None

    def __post_init__(self) -> None:
        if real("drive.rate", self.rate) == 0.0:
            raise ValueError("drive.rate must not be zero, got 0.0")
        positive("drive.strain", self.strain)
        one_of("drive.mode", self.mode, ("shear", "uniaxial", "isotropic"))
        integer("drive.samples", self.samples, at_least=1)
        _check_motion(self)


@dataclass(frozen=True)
class CreepDrive:
    """Let the box shear under a constant stress.

    Parameters
    ----------
    stress, duration, hold, inertia, viscosity, axes, dt, method
        What pm.creep takes.
    density
        As in `OscillatoryShearDrive`.

    """

    stress: float
    duration: float
    hold: float | None = None
    inertia: float | None = None
    viscosity: float | None = None
    axes: tuple[int, int] = (0, 1)
    dt: float | None = None
    method: Any = None
    density: float | None = None

    def __post_init__(self) -> None:
        if real("drive.stress", self.stress) == 0.0:
            raise ValueError("drive.stress must not be zero, got 0.0")
        positive("drive.duration", self.duration)
        if self.hold is not None:
            real("drive.hold", self.hold, above=0.0, at_most=self.duration)
        if self.inertia is not None:
            positive("drive.inertia", self.inertia)
        if self.viscosity is not None:
            real("drive.viscosity", self.viscosity, at_least=0.0)
        _check_motion(self)


Drive = (
    QuenchDrive
    | JamDrive
    | ShearStabilizeDrive
    | CementDrive
    | OscillatoryShearDrive
    | SteadyShearDrive
    | RampStrainDrive
    | CreepDrive
    | SimulateDrive
)


def _check_motion(drive: Any) -> None:
    """Check what drives that follow Newton's equations under strain share."""
    for name in ("dt", "density"):
        if getattr(drive, name) is not None:
            positive(f"drive.{name}", getattr(drive, name))
    _record_or_none("drive.method", drive.method)
    _two_axes(drive.axes)


def _two_axes(axes: Any) -> None:
    if not isinstance(axes, tuple) or len(axes) != 2:
        raise TypeError(f"drive.axes must be two axes, got {axes!r}")
    for axis in axes:
        integer("drive.axes", axis, at_least=0, at_most=2)
    if axes[0] == axes[1]:
        raise ValueError(f"drive.axes must be two different axes, got {axes}")


def _record_or_none(name: str, value: Any) -> None:
    if value is not None and not is_record(value):
        raise TypeError(f"{name} must be a record of settings or None, got {value!r}")


def _check_numbers(where: str, record: Any, *, slack: bool = False) -> None:
    for name, value in zip(record._fields, record, strict=True):
        if is_law(value):
            _check_numbers(f"{where}.{name}", value, slack=slack)
        elif name == "law":
            raise TypeError(f"{where}.law must be a law such as Harmonic(...), got {value!r}")
        elif isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
            raise ValueError(f"{where}.{name} must be a finite number, got {value!r}")
        elif name in ("energy_scale", "stiffness") and value <= 0 and not (slack and value == 0):
            raise ValueError(f"{where}.{name} must be positive, got {value!r}")
        elif value < 0 and name not in SIGNED.get(type(record), ()):
            raise ValueError(f"{where}.{name} must not be negative, got {value!r}")
        elif name == "exponent" and value < 1.5:
            raise ValueError(f"{where}.{name} must be at least 1.5 for continuous forces, got {value!r}")
    fault = record.fault() if hasattr(record, "fault") else ""
    if fault:
        raise ValueError(f"{where}.{fault}")


def _check_bound(where: str, record: Any) -> None:
    """Check the laws of an effect that checked its arrays itself; its springs may have no stiffness."""
    for field in dataclasses.fields(record):
        value = getattr(record, field.name)
        if is_law(value):
            _check_numbers(f"{where}.{field.name}", value, slack=True)


def _plain(record: Any) -> Any:
    """Return the record with every number a float, so that one combination of effects compiles once."""
    return type(record)(*(_plain(value) if is_law(value) else float(value) for value in record))


@dataclass(frozen=True)
class Scene:
    """A packing, a tuple of effects and, if one was chosen, a drive.

    Parameters
    ----------
    packing
        The packing.
    effects
        Records such as Repulsion(law=Harmonic()); what is not named here costs nothing.
    drive
        What `packmech run` does with the scene: a QuenchDrive, a JamDrive, a ShearStabilizeDrive, a CementDrive, an
        OscillatoryShearDrive, a SteadyShearDrive, a RampStrainDrive, a CreepDrive or a SimulateDrive.

    Raises
    ------
    TypeError, ValueError
        Naming the field that is wrong.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.Packing([[0.0, 0.0], [0.9, 0.0]], [0.5, 0.5], pm.Box.cubic(3.0, 2))
    >>> scene = pm.Scene(packing, effects=(pm.Repulsion(law=pm.Harmonic(energy_scale=2.0)),))
    >>> scene.pressure_unit
    2.0

    """

    packing: Packing
    effects: tuple[Any, ...]
    drive: Drive | None = None

    def __post_init__(self) -> None:
        instance("packing", self.packing, Packing)
        if is_effect(self.effects):
            raise TypeError("effects must be a tuple of effects, got one effect; write effects=(effect,)")
        if not isinstance(self.effects, tuple | list):
            raise TypeError(f"effects must be a tuple of effects, got {self.effects!r}")
        for k, one in enumerate(self.effects):
            if not is_effect(one):
                raise TypeError(f"effects[{k}] must be an effect such as Repulsion(...), got {one!r}")
            if is_bound(one):
                _check_bound(f"effects[{k}]", one)
                continue
            _check_numbers(f"effects[{k}]", one)
        object.__setattr__(self, "effects", tuple(one if is_bound(one) else _plain(one) for one in self.effects))
        if self.drive is not None and not isinstance(self.drive, Drive):
            raise TypeError(
                "drive must be a Quench-, Jam-, ShearStabilize-, Cement-, OscillatoryShear-, SteadyShear-, "
                f"RampStrain-, Creep- or SimulateDrive or None, got {self.drive!r}"
            )

    @property
    def energy_scale(self) -> float:
        """Unit of energy that the repulsion sets [energy]."""
        return energy_scale_of(self.effects, self.packing.reference_diameter)

    @property
    def pressure_unit(self) -> float:
        """Unit of pressures and moduli: energy_scale / reference_diameter^d [energy/length^d]."""
        return self.energy_scale / self.packing.reference_diameter**self.packing.dimension

    def replace(self, **changes: Any) -> Scene:
        """Return a scene with the named fields exchanged."""
        return dataclasses.replace(self, **changes)
