"""A scene: a packing, the effects that act on it, and what is done to it. Data only."""

from __future__ import annotations

import dataclasses
import functools
import importlib
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, ClassVar, TypeVar

from packmech.calls.display import shown
from packmech.check import LARGEST_FLOAT, BoxStrain, brief, instance, integer, one_of, positive, real, two_axes
from packmech.effects import (
    BY_KIND,
    SIGNED,
    Bonds,
    DampingRatio,
    Friction,
    HeldStress,
    MeshWalls,
    Mindlin,
    Repulsion,
    TwistingResistance,
    WallMotion,
    Walls,
    bonds_of,
    check_effect,
    check_law,
    damps,
    energy_scale_of,
    is_bound,
    is_effect,
    is_law,
    plain_record,
    refuse_curvature_of_shapes,
    refuse_rolling,
    refuse_walls,
    registered_effects,
)
from packmech.effects.kinds import ByKind, LawByKind, LawPerKind, PerKind, refuse_missing_kinds, rows_in
from packmech.files.records import is_record, kind_of
from packmech.packing import Packing

D = TypeVar("D", bound=type)
# units of energy, force and stiffness between these have squares that double precision carries
_WEAKEST, _STRONGEST = 1e-120, 1e120


@dataclass(frozen=True)
class DriveCode:
    """What does as a drive says.

    Attributes
    ----------
    run
        A function of the drive and its scene that returns a run; of `frames` (how many packings to keep on the way),
        `progress` and `checkpoint` it gets those that it has as parameters.
    nested
        For each field of the drive that holds a record, a function that returns the classes that may stand there.

    """

    run: Callable[..., Any]
    nested: Mapping[str, Callable[[], Iterable[type]]] = field(default_factory=dict)


# registered drives, each with its code; that of packmech's own stands in rooms above this one and is found by its name
_DRIVES: dict[type, DriveCode | str] = {}


def drive(cls: D) -> D:
    """Return the class registered as a drive, which scenes take and scene files name.

    Parameters
    ----------
    cls
        A frozen dataclass of numbers, texts and tuples of them, with a method run(self, scene) that returns a Run.
        Further parameters of `run` may be `frames` (how many packings to keep on the way), `progress` (called as
        progress(stage, figures)) and `checkpoint` (a file to go on from, and to leave). An attribute `examined_strain`
        ("isotropic" or "free": what the box may do) says that the run ends at rest, so that `packmech run` examines the
        packing. In scene files its kind is the name of the class without "Drive": ``kind = "tap"`` for TapDrive.

    Raises
    ------
    TypeError, ValueError
        If it is no such class, or has the name of a drive of packmech's.

    Examples
    --------
    >>> import packmech as pm
    >>> @pm.drive
    ... @dataclass(frozen=True)
    ... class TapDrive:
    ...     taps: int = 3
    ...     def run(self, scene):
    ...         return pm.quench(scene, force_tolerance=1e-6, check=False)
    >>> scene = pm.Scene(pm.lattice_packing("square"), (pm.Repulsion(),), TapDrive(taps=2))
    >>> scene.drive.taps
    2

    """
    if not (isinstance(cls, type) and dataclasses.is_dataclass(cls)):
        raise TypeError(f"drive must be a dataclass, got {brief(cls)}")
    if not callable(getattr(cls, "run", None)):
        raise TypeError(f"drive {cls.__name__} must define the method run(self, scene), got none")
    known = registered_drives().get(drive_kind(cls))
    if known is not None and known.__module__ == __name__:
        raise ValueError(f"drive must have a name that none of packmech's has, got {cls.__name__}")
    _DRIVES[cls] = DriveCode(cls.run)  # type: ignore[attr-defined]
    return cls


def drive_kind(cls: type) -> str:
    """Return the name that scene files give to a class of drives."""
    return kind_of(cls).removesuffix("-drive")


def registered_drives() -> dict[str, type]:
    """Return every registered class of drives by the name that scene files give it."""
    return {drive_kind(cls): cls for cls in _DRIVES}


def drive_code(cls: type) -> DriveCode:
    """Return what does as drives of this class say."""
    code = _DRIVES[cls]
    if isinstance(code, str):
        module, _, name = code.partition(":")
        code = _DRIVES[cls] = getattr(importlib.import_module(module), name)
    return code


def _built_in(code: str) -> Callable[[D], D]:
    """Return what registers a drive whose code is found by a name."""

    def register(cls: D) -> D:
        _DRIVES[cls] = code
        return cls

    return register


def _tuple(name: str, value: Any, *, of: Callable[[str, Any], Any], words: str, empty: bool = True) -> None:
    if not isinstance(value, tuple) or not (value or empty):
        raise TypeError(f"{name} must be a tuple of {words}, got {brief(value)}")
    for k, entry in enumerate(value):
        of(f"{name}[{k}]", entry)


def _axes(name: str, value: Any) -> None:
    instance(name, value, tuple)
    two_axes(name, value)


def _not_zero(name: str, value: Any) -> None:
    if real(name, value) == 0.0:
        raise ValueError(f"{name} must not be zero, got 0.0")


def _method(name: str, value: Any) -> None:
    if not is_record(value):
        raise TypeError(f"{name} must be a record of settings or None, got {brief(value)}")


def _minimizer(name: str, value: Any) -> None:
    _method(name, value)
    if hasattr(value, "follow"):
        raise TypeError(f"{name} must be a minimizer such as Fire() or None, got {brief(value)}")


def _protocol(name: str, value: Any) -> None:
    _method(name, value)
    if not hasattr(value, "follow"):
        raise TypeError(f"{name} must be a protocol such as HardVertex() or None, got {brief(value)}")


def _plates(name: str, value: Any) -> None:
    if isinstance(value, str):
        one_of(name, value, ("crossing",))
    else:
        positive(name, value)


def _components(name: str, value: Any) -> None:
    instance(name, value, Mapping)
    known = ("xx", "yy", "zz", "xy", "xz", "yz")
    for key, number in value.items():
        if key not in known:
            raise ValueError(f"{name} must name components among {', '.join(known)}, got {brief(key)}")
        real(f"{name}.{key}", number)


_count = partial(integer, at_least=1)
_not_negative = partial(real, at_least=0.0)
_numbers = partial(_tuple, of=real, words="numbers")
_rows = partial(_tuple, of=_numbers, words="tuples of numbers, one a particle")

# what the fields of drives must be; None is let pass where it is the default
_CHECKS: dict[str, Callable[[str, Any], Any]] = {
    "amplitude": positive,
    "answer": positive,
    "applied_strain": positive,
    "axes": _axes,
    "blocks": partial(integer, at_least=2),
    "carried": partial(instance, kind=bool),
    "ledger": partial(instance, kind=bool),
    "dt": positive,
    "duration": positive,
    "force_tolerance": positive,
    "freeze": partial(one_of, choices=("angles", "clusters", "nothing")),
    "frequency": positive,
    "held": partial(_tuple, of=partial(integer, at_least=0), words="particle numbers"),
    "hold": positive,
    "inertia": positive,
    "largest_oscillation": positive,
    "method": _method,
    "mode": partial(one_of, choices=("shear", "uniaxial", "isotropic")),
    "orders": _count,
    "periods": positive,
    "plates": _plates,
    "post_periods": _not_negative,
    "pre_periods": _not_negative,
    "pressure": positive,
    "pressure_tolerance": positive,
    "rate": _not_zero,
    "rates": partial(_tuple, of=positive, words="shear rates", empty=False),
    "relative_frequency": positive,
    "expected_stress": positive,
    "samples": _count,
    "samples_per_period": partial(integer, at_least=8),
    "seed": partial(integer, at_least=0),
    "skip_periods": _not_negative,
    "skip_strain": _not_negative,
    "spins": _rows,
    "step": positive,
    "step_limit": _count,
    "steps": _count,
    "strain": partial(one_of, choices=("isotropic", "free")),
    "stress": _not_zero,
    "trace_every": _count,
    "velocities": _rows,
    "viscosity": _not_negative,
    "JamDrive.method": _protocol,
    "QuenchDrive.method": _minimizer,
    "DeformDrive.rate": positive,
    "DeformDrive.strain": _components,
    "DeformDrive.stress": _components,
    "stress_tolerance": positive,
}


def _check_fields(one: Any) -> None:
    for each in dataclasses.fields(one):
        value = getattr(one, each.name)
        if value is not None or each.default is not None:
            check = _CHECKS.get(f"{type(one).__name__}.{each.name}") or _CHECKS[each.name]
            check(f"drive.{each.name}", value)


def _check_either(one: Any, name: str, other: str) -> None:
    if (getattr(one, name) is None) == (getattr(one, other) is None):
        got = "neither" if getattr(one, name) is None else "both"
        raise ValueError(f"drive.{name} must be given, or else {other}, got {got}")


@_built_in("packmech.rheology.drives:SIMULATE")
@dataclass(frozen=True)
class SimulateDrive:
    """Follow Newton's equations in the box as it is; `packmech run` prints stress, energy and momentum at the end.

    Parameters
    ----------
    steps, duration, dt, method
        What pm.simulate takes; exactly one of steps and duration.
    velocities, spins
        One row a particle: velocities, and one number (three in space) of spin; at rest unless given.
    held
        Numbers of the particles that nothing pushes or turns.
    trace_every
        Steps between the rows of observables that are kept; some 200 rows unless given.
    ledger
        Account for the energy, as the call does: what went in, what is stored, where the rest went.

    """

    steps: int | None = None
    duration: float | None = None
    dt: float | None = None
    method: Any = None
    velocities: tuple[tuple[float, ...], ...] | None = None
    spins: tuple[tuple[float, ...], ...] | None = None
    held: tuple[int, ...] = ()
    trace_every: int | None = None
    ledger: bool = False

    def __post_init__(self) -> None:
        _check_fields(self)
        _check_either(self, "steps", "duration")


@_built_in("packmech.protocols.drives:QUENCH")
@dataclass(frozen=True)
class QuenchDrive:
    """Minimize the energy in the box as it is.

    Parameters
    ----------
    force_tolerance
        Stop when the largest net force falls to this times the mean contact force [1].
    method
        What pm.quench takes, such as pm.ConjugateGradient(); None leaves the choice to it.

    """

    force_tolerance: float = 1e-12
    method: Any = None
    examined_strain: ClassVar[str] = "isotropic"

    def __post_init__(self) -> None:
        _check_fields(self)


# where a packing with friction is pressed to unless a pressure is given: in time, which takes ever longer to come to
# rest at ever lower pressures [energy_scale / diameter^d]
ROUGH_PRESSURE = 1e-3


@_built_in("packmech.protocols.drives:JAM")
@dataclass(frozen=True)
class JamDrive:
    """Find the jamming point, then the packing at a pressure.

    `packmech run` and `packmech jam` do so; pm.jam takes the same as arguments, and reads no drive.

    Parameters
    ----------
    pressure
        To end at [energy_scale / diameter^d]; None leaves the choice to pm.jam.
    strain
        Whether the box keeps its shape ("isotropic"), or every strain is "free".
    method
        What pm.jam takes, such as pm.StepHalving(increment=1e-3); None leaves the choice to it.
    force_tolerance
        Largest net force over mean contact force that counts as balance [1].

    """

    pressure: float | None = None
    strain: BoxStrain = "free"
    method: Any = None
    force_tolerance: float = 1e-5

    def __post_init__(self) -> None:
        _check_fields(self)
        if self.pressure is not None and hasattr(self.method, "energy_tolerance"):
            raise ValueError(
                f"drive.pressure must be left out for a method that ends at an energy, got {brief(self.pressure)}"
            )

    @property
    def examined_strain(self) -> str:
        """What the box may do, for the report on the packing at the end."""
        return self.strain


@_built_in("packmech.protocols.drives:SETTLE")
@dataclass(frozen=True)
class SettleDrive:
    """Let the scene come to rest with friction, in time and in the box as it is: a pile under gravity on a floor.

    Parameters
    ----------
    force_tolerance, step_limit
        What pm.settle takes: the largest net force over the mean contact force [1], and the most time steps.

    """

    force_tolerance: float = 1e-6
    step_limit: int = 20_000_000
    examined_strain: ClassVar[str] = "isotropic"

    def __post_init__(self) -> None:
        _check_fields(self)


@_built_in("packmech.protocols.drives:SHEAR_STABILIZE")
@dataclass(frozen=True)
class ShearStabilizeDrive:
    """Relax positions and every strain together.

    Parameters
    ----------
    pressure
        What the box is to bear [energy_scale / diameter^d]; None holds the volume.
    force_tolerance
        Largest net force over the mean contact force, and missing stress over the pressure, at the end [1].

    """

    pressure: float | None = None
    force_tolerance: float = 1e-10
    examined_strain: ClassVar[str] = "free"

    def __post_init__(self) -> None:
        _check_fields(self)


@_built_in("packmech.protocols.drives:CEMENT")
@dataclass(frozen=True)
class CementDrive:
    """Jam with every strain free, then cement random contacts and follow the moduli.

    Parameters
    ----------
    pressure
        Of the packing that is cemented [energy_scale / diameter^d].
    orders
        Number of random orders in which contacts are cemented.
    seed
        That these are drawn from.
    step, freeze
        What pm.cement takes.

    """

    pressure: float = 1e-8
    orders: int = 5
    seed: int = 0
    step: float = 0.05
    freeze: str = "angles"
    examined_strain: ClassVar[str] = "free"

    def __post_init__(self) -> None:
        _check_fields(self)


@_built_in("packmech.rheology.drives:OSCILLATORY_SHEAR")
@dataclass(frozen=True)
class OscillatoryShearDrive:
    """Bring the scene to rest, shear it as a sine, and find the moduli of its stress.

    Parameters
    ----------
    amplitude, frequency, relative_frequency, pre_periods, periods, post_periods, skip_periods, axes, dt, method
        What pm.oscillatory_shear takes; exactly one of the frequencies.
    samples_per_period
        As there.
    largest_oscillation
        What pm.equilibrate takes, which comes first; None: nothing does.
    expected_stress
        As of pm.equilibrate [energy_scale / diameter^d]; None: of the shear modulus, which must then be positive.
    plates
        Whom rough plates hold once the scene is at rest, the layer of pm.rough_plates: "crossing" or a thickness; None:
        there are none.
    carried
        What pm.oscillatory_shear takes; false only with plates.
    ledger
        Account for the energy of the shear: what went in, what is stored, where the rest went; false with plates.

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
    largest_oscillation: float | None = 0.1
    expected_stress: float | None = None
    plates: str | float | None = None
    carried: bool = True
    ledger: bool = False

    def __post_init__(self) -> None:
        _check_fields(self)
        _check_either(self, "frequency", "relative_frequency")
        if self.skip_periods is not None:
            real("drive.skip_periods", self.skip_periods, at_least=0.0, below=self.periods)
        if not self.carried and self.plates is None:
            raise ValueError("drive.carried must be true where there are no plates, got False")
        if self.ledger and self.plates is not None:
            raise ValueError("drive.ledger must be false with plates, whose work is not accounted for, got True")


@_built_in("packmech.rheology.drives:STEADY_SHEAR")
@dataclass(frozen=True)
class SteadyShearDrive:
    """Shear the scene steadily at several rates, and find the mean stress at each.

    Parameters
    ----------
    rates, applied_strain, skip_strain, blocks, samples, axes, dt, method
        What pm.steady_shear takes.
    ledger
        Account for the energy, as the call does: what went in, what is stored, where the rest went.

    """

    rates: tuple[float, ...]
    applied_strain: float = 3.0
    skip_strain: float = 1.0
    blocks: int = 8
    samples: int = 400
    axes: tuple[int, int] = (0, 1)
    dt: float | None = None
    method: Any = None
    ledger: bool = False

    def __post_init__(self) -> None:
        _check_fields(self)
        real("drive.skip_strain", self.skip_strain, at_least=0.0, below=self.applied_strain)


@_built_in("packmech.rheology.drives:SHEAR_AT_PRESSURE")
@dataclass(frozen=True)
class ShearAtPressureDrive:
    """Shear the scene steadily in a box whose volume follows the pressure: mu(I), the packing fraction phi(I).

    Parameters
    ----------
    rate, pressure, applied_strain, skip_strain, blocks, axes, answer, pressure_tolerance, dt
        What pm.shear_at_pressure takes: the rate [1/time] and the pressure [energy/length^d].
    ledger
        Account for the energy, as the call does: what went in, what is stored, where the rest went.

    """

    rate: float
    pressure: float
    applied_strain: float = 5.0
    skip_strain: float = 1.0
    blocks: int = 8
    axes: tuple[int, int] = (0, 1)
    answer: float = 10.0
    pressure_tolerance: float = 0.1
    dt: float | None = None
    ledger: bool = False

    def __post_init__(self) -> None:
        _check_fields(self)
        positive("drive.rate", self.rate)
        real("drive.skip_strain", self.skip_strain, at_least=0.0, below=self.applied_strain)


@_built_in("packmech.protocols.drives:DEFORM")
@dataclass(frozen=True)
class DeformDrive:
    """Deform the box component by component, some strains given and some stresses held: triaxial tests, direct shear.

    Parameters
    ----------
    strain, stress
        What pm.deform and pm.deform_at_rate take, such as {"yy": -0.1} and {"xx": -1e-3}: in scene files
        ``strain = { yy = -0.1 }``; None: none.
    rate
        As of pm.deform_at_rate; None: at rest, by pm.deform.
    pressure
        Jam the packing at this pressure first, as by pm.jam [energy_scale / diameter^d]; None: it is jammed already.
    steps
        As of pm.deform, at rest; 50 unless given.
    answer, stress_tolerance, dt, ledger
        As of pm.deform_at_rate, in time.

    """

    strain: Mapping[str, float] | None = None
    stress: Mapping[str, float] | None = None
    rate: float | None = None
    pressure: float | None = None
    steps: int | None = None
    answer: float | None = None
    stress_tolerance: float | None = None
    dt: float | None = None
    ledger: bool | None = None

    def __post_init__(self) -> None:
        _check_fields(self)
        if not self.strain and not self.stress:
            raise ValueError("drive.strain must be given, or drive.stress, got neither")
        others = ("answer", "stress_tolerance", "dt", "ledger") if self.rate is None else ("steps",)
        where = "without a rate, at rest" if self.rate is None else "with a rate, in time"
        for name in others:
            if getattr(self, name) is not None:
                raise ValueError(f"drive.{name} must be left out {where}, got {brief(getattr(self, name))}")


@_built_in("packmech.rheology.drives:RAMP_STRAIN")
@dataclass(frozen=True)
class RampStrainDrive:
    """Deform the box at a constant rate: shear, or compress it.

    Parameters
    ----------
    rate, applied_strain, mode, samples, axes, dt, method
        What pm.ramp_strain takes.
    ledger
        Account for the energy, as the call does: what went in, what is stored, where the rest went.

    """

    rate: float
    applied_strain: float
    mode: str = "shear"
    samples: int = 200
    axes: tuple[int, int] = (0, 1)
    dt: float | None = None
    method: Any = None
    ledger: bool = False

    def __post_init__(self) -> None:
        _check_fields(self)


@_built_in("packmech.rheology.drives:CREEP")
@dataclass(frozen=True)
class CreepDrive:
    """Let the box shear under a constant stress.

    Parameters
    ----------
    stress, duration, hold, inertia, viscosity, axes, dt, method
        What pm.creep takes.
    ledger
        Account for the energy, as the call does: what went in, what is stored, where the rest went.

    """

    stress: float
    duration: float
    hold: float | None = None
    inertia: float | None = None
    viscosity: float | None = None
    axes: tuple[int, int] = (0, 1)
    dt: float | None = None
    method: Any = None
    ledger: bool = False

    def __post_init__(self) -> None:
        _check_fields(self)
        if self.hold is not None:
            real("drive.hold", self.hold, above=0.0, at_most=self.duration)


def _check_numbers(where: str, record: Any, *, slack: bool = False) -> None:
    if isinstance(record, Walls) and rows_in(record):
        if fault := record.fault():
            raise ValueError(f"{where}.{fault}")
        for one in record.of_kinds:
            _check_numbers(where, one)
        return
    for name, value in zip(record._fields, record, strict=True):
        if isinstance(value, PerKind | LawPerKind):
            raise TypeError(
                f"{where}.{name} must not be {type(value).__name__}, which walls alone take, got {brief(value)}"
            )
        if isinstance(value, ByKind):
            _check_table(where, record, name, value)
            # with each number of the table the record was checked
            return
        if isinstance(record, LawByKind):
            for p, one in enumerate(record.laws):
                _check_numbers(f"{where}.laws[{p}]", one, slack=slack)
        elif is_law(value):
            _check_numbers(f"{where}.{name}", value, slack=slack)
        elif name == "law":
            raise TypeError(f"{where}.law must be a law such as Harmonic(...), got {brief(value)}")
        elif isinstance(record, Friction) and isinstance(value, Mindlin if name == "stiffness" else DampingRatio):
            _check_numbers(f"{where}.{name}", value)
        elif name == "damping" and is_effect(value):
            if not damps(value) or hasattr(value, "pair_energy"):
                raise TypeError(
                    f"{where}.damping must be a number or a dashpot such as Restitution(), got {brief(value)}"
                )
            _check_numbers(f"{where}.damping", value)
        elif isinstance(value, WallMotion | HeldStress):
            _check_numbers(f"{where}.{name}", value)
        elif isinstance(record, Walls) and name.endswith("_motion"):
            continue
        elif isinstance(record, Walls) and name in ("friction", "rolling", "twisting"):
            if is_effect(value):
                _check_numbers(f"{where}.{name}", value)
        elif isinstance(record, Walls) and name == "axis" and isinstance(value, str):
            raise ValueError(f"{where}.axis must be 0, 1 or 2, for x, y or z, got {brief(value)}")
        elif isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) <= LARGEST_FLOAT:
            raise ValueError(f"{where}.{name} must be a finite number, got {brief(value)}")
        elif name in ("energy_scale", "stiffness", "modulus") and value <= 0 and not (slack and value == 0):
            raise ValueError(f"{where}.{name} must be positive, got {brief(value)}")
        elif value < 0 and name not in SIGNED.get(type(record), ()):
            raise ValueError(f"{where}.{name} must not be negative, got {brief(value)}")
        elif name == "exponent" and value < 1.5:
            raise ValueError(f"{where}.{name} must be at least 1.5 for continuous forces, got {brief(value)}")
    fault = record.fault() if hasattr(record, "fault") else ""
    if fault:
        raise ValueError(f"{where}.{fault}")
    if is_law(record) or is_effect(record):
        _check_derivatives(record)


def _check_table(where: str, record: Any, name: str, table: ByKind) -> None:
    """Check a record with each number of a table by kinds in turn, which one of its fields may be."""
    if name not in BY_KIND.get(type(record), ()):
        known = ", ".join(f"{cls.__name__}.{field}" for cls, fields in BY_KIND.items() for field in fields)
        raise TypeError(
            f"{where}.{name} must be the same for all kinds of particles (only {known} may differ), got {brief(table)}"
        )
    for number in table.numbers:
        _check_numbers(where, record._replace(**{name: number}))


@functools.lru_cache(maxsize=256)
def _check_derivatives(record: Any) -> None:
    """Check the hooks of a law or an effect with its numbers, once for each."""
    check_law(record) if is_law(record) else check_effect(record)


def _check_bound(where: str, record: Any) -> None:
    """Check the laws of an effect that checked its arrays itself; its springs may have no stiffness."""
    for each in dataclasses.fields(record):
        value = getattr(record, each.name)
        if is_law(value):
            _check_numbers(f"{where}.{each.name}", value, slack=True)
    if isinstance(record, MeshWalls):
        _check_numbers(where, record.flat)


@shown(lambda one: repr(one.packing))
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
        OscillatoryShearDrive, a SteadyShearDrive, a RampStrainDrive, a CreepDrive, a SimulateDrive, or one of your own
        (see `drive`).

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

    MADE_OF: ClassVar[dict[str, str]] = {"Packing": "pm.Scene(packing, effects=(pm.Repulsion(),))"}

    packing: Packing
    effects: tuple[Any, ...]
    drive: Any = None

    def __post_init__(self) -> None:
        instance("packing", self.packing, Packing)
        if is_effect(self.effects):
            raise TypeError("effects must be a tuple of effects, got one effect; write effects=(effect,)")
        if not isinstance(self.effects, tuple | list):
            raise TypeError(f"effects must be a tuple of effects, got {brief(self.effects)}")
        for k, one in enumerate(self.effects):
            if not is_effect(one):
                raise TypeError(f"effects[{k}] must be an effect such as Repulsion(...), got {brief(one)}")
            if is_bound(one):
                _check_bound(f"effects[{k}]", one)
                continue
            _check_numbers(f"effects[{k}]", one)
        object.__setattr__(self, "effects", tuple(one if is_bound(one) else plain_record(one) for one in self.effects))
        for kind in (Friction, Bonds, TwistingResistance):
            number = sum(isinstance(one, kind) for one in self.effects)
            if number > 1:
                raise ValueError(f"effects must hold one {kind.__name__} at most, got {number}")
        whole = next((one for one in self.effects if getattr(one, "contains_repulsion", False)), None)
        if whole is not None and any(isinstance(one, Repulsion) for one in self.effects):
            raise ValueError(
                f"effects must hold no Repulsion beside {type(whole).__name__}, which contains one: leave it out with "
                "scene.without(pm.Repulsion)"
            )
        refuse_missing_kinds(self.effects, self.packing)
        refuse_rolling(self.effects, self.packing)
        refuse_curvature_of_shapes(self.effects, self.packing)
        refuse_walls(self.effects, self.packing)
        self._check_scales()
        if self.drive is not None and type(self.drive) not in _DRIVES:
            known = ", ".join(cls.__name__ for cls in _DRIVES)
            raise TypeError(f"drive must be one of {known} or None, got {brief(self.drive)}")

    def _check_scales(self) -> None:
        """Check that squares of forces and stiffnesses are numbers that double precision carries."""
        if not any(isinstance(one, Repulsion) for one in self.effects):
            return
        scale, length = self.energy_scale, self.packing.reference_diameter
        for unit, what in ((scale, ""), (scale / length, " / diameter"), (scale / length**2, " / diameter^2")):
            if not _WEAKEST <= unit <= _STRONGEST:
                raise ValueError(
                    f"effects must have energy_scale{what} between {_WEAKEST:g} and {_STRONGEST:g} (take another unit "
                    f"of energy or length), got {unit:g} for energy_scale = {scale:g} and diameter = {length:g}"
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
        """Return a scene with the named fields exchanged.

        Bonds go with particles of another packing that were wrapped to other images.
        """
        packing = changes.get("packing")
        if "effects" not in changes and isinstance(packing, Packing) and packing is not self.packing:
            # only bonds know images
            follow = [getattr(one, "continued", None) for one in self.effects]
            if any(follow):
                together = zip(self.effects, follow, strict=True)
                changes["effects"] = tuple(go_on(self.packing, packing) if go_on else one for one, go_on in together)
        return dataclasses.replace(self, **changes)

    def without(self, *kinds: type) -> Scene:
        """Return the scene without its effects of these kinds.

        Parameters
        ----------
        kinds
            Classes of effects, such as pm.Friction; the scene need not hold any.

        Raises
        ------
        TypeError
            If one is no class of effects.

        Examples
        --------
        >>> import packmech as pm
        >>> rough = pm.Scene(pm.lattice_packing("square"), (pm.Repulsion(), pm.Friction(0.5)))
        >>> rough.without(pm.Friction).effects
        (Repulsion(law=Harmonic(energy_scale=1.0)),)

        """
        for k, kind in enumerate(kinds):
            if kind not in registered_effects():
                raise TypeError(f"kinds[{k}] must be a class of effects such as Friction, got {brief(kind)}")
        return self.replace(effects=tuple(one for one in self.effects if type(one) not in kinds))


def scene_after(run: Any, scene: Scene) -> Scene:
    """Return the scene as a run of it left it: with the packing at its end and, where bonds broke, those that are left.

    Parameters
    ----------
    run
        Its `packing` is taken and, of a run that has them, its `bonds`.
    scene
        The scene that was run.

    """
    whole, left = bonds_of(scene.effects), getattr(run, "bonds", None)
    if left is not None:
        # images of bonds are those of the scene's packing, and go with particles that were wrapped
        scene = scene.replace(effects=tuple(left if one is whole else one for one in scene.effects))
    return scene.replace(packing=run.packing)
