"""The reference model's discs and parameters as a native scene, and a native scene as discs and parameters.

Scenes are in um, s, kg per m of depth and Pa, as those that ship; the preset is in um, s and mg per m.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech import check
from packmech.box import Box
from packmech.check import brief
from packmech.effects import (
    BackgroundDamping,
    Bonds,
    ContactDamping,
    DivergentRepulsion,
    ExponentialTension,
    Friction,
    LinearSpring,
    PlateauRepulsion,
    Repulsion,
)
from packmech.effects.material import contact_stiffness as native_stiffness
from packmech.packing import Packing
from packmech.scene import OscillatoryShearDrive, Scene
from packmech.validation.particle_shear.experiment import ParticleShear
from packmech.validation.particle_shear.step import ShearedDiscs

# mg in kg, and 1e-12 N in 1e-6 N
_UNIT = 1e-6
# relative differences of numbers that should be equal
_SAME = 1e-9


def to_scene(experiment: ParticleShear, discs: ShearedDiscs, *, plates: bool = True) -> Scene:
    """Return the native scene of an experiment: the same discs, bonds, materials and shear, without the faults.

    What the native model does otherwise: friction is Coulomb's, all contacts count in the stress, plates hold the discs
    that reach across them at the start only. The scene starts at rest with slack tangential springs.

    Parameters
    ----------
    experiment
        The parameters.
    discs
        The discs at the start, prepared for it.
    plates
        Whether plates hold the discs at the top and the bottom, as in the preset; else the cell is periodic.

    Raises
    ------
    ValueError
        If the discs are in another cell than the experiment's, or of several densities.

    Examples
    --------
    >>> from packmech.validation.particle_shear import prepared_discs
    >>> experiment = ParticleShear(particles=20)
    >>> discs = prepared_discs(experiment, seed=1, centers=0, steps=10)
    >>> scene = to_scene(experiment, discs)
    >>> [type(one).__name__ for one in scene.effects]
    ['Repulsion', 'ContactDamping', 'Friction', 'BackgroundDamping', 'Bonds']

    """
    check.instance("experiment", experiment, ParticleShear)
    check.instance("discs", discs, ShearedDiscs)
    check.boolean("plates", plates)
    if (discs.width, discs.height) != (experiment.width, experiment.height):
        raise ValueError(
            f"discs must be in the experiment's cell of {experiment.width:g} by {experiment.height:g}, "
            f"got one of {discs.width:g} by {discs.height:g}"
        )
    _density("discs", _UNIT * discs.mass_n, discs.radius_n)
    made = experiment.material
    repulsion = _repulsion(experiment, made.stiffness * _UNIT)
    effects: list[Any] = [
        Repulsion(repulsion),
        ContactDamping(made.viscosity * _UNIT),
        Friction(made.friction_coefficient, made.tangential_stiffness * _UNIT, made.tangential_viscosity * _UNIT),
        BackgroundDamping(-math.log(experiment.cooling) * experiment.frequency),
    ]
    if discs.bonded_c.any():
        effects.append(_bonds(experiment, discs))
    drive = OscillatoryShearDrive(
        amplitude=experiment.amplitude,
        frequency=experiment.frequency,
        pre_periods=experiment.pre_periods,
        periods=experiment.periods,
        post_periods=experiment.post_periods,
        plates="crossing" if plates else None,
    )
    box = Box(np.array([[discs.width, discs.height * discs.strain], [0.0, discs.height]]))
    packing = Packing(discs.position_nd, discs.radius_n, box, mass_n=_UNIT * discs.mass_n)
    return Scene(packing, tuple(effects), drive)


def _density(name: str, mass_n: NDArray[np.float64], radius_n: NDArray[np.float64]) -> float:
    """Return the mass over area of discs that all have the same."""
    density_n = mass_n / (math.pi * radius_n**2)
    density = float(density_n.mean())
    if np.abs(density_n - density).max() > _SAME * density:
        raise ValueError(f"{name} must be of one density, got masses that are not in proportion to the areas")
    return density


def _repulsion(experiment: ParticleShear, stiffness: float) -> Any:
    """Return the law of contacts with this stiffness [Pa]."""
    law = DivergentRepulsion(stiffness, experiment.divergence)
    made = experiment.material
    if experiment.law != "plateau":
        return law
    return PlateauRepulsion(made.plateau_begin, made.plateau_end, made.plateau_slope, law)


def _bonds(experiment: ParticleShear, discs: ShearedDiscs) -> Bonds:
    """Return the bonds, each through the image that the package takes."""
    made = experiment.material
    i, j = discs.contact_ck[discs.bonded_c].T
    apart = discs.position_nd[j] - discs.position_nd[i]
    up = np.floor(apart[:, 1] / discs.height + 0.5)
    along = np.floor((apart[:, 0] - up * discs.height * discs.strain) / discs.width + 0.5)
    stiffness = made.stiffness * made.bond_normal_ratio * _UNIT
    follows = bool(made.bond_viscosity_follows)
    pull: Any = LinearSpring(stiffness)
    if made.tensile_range > 0.0:
        pull = ExponentialTension(stiffness, made.tensile_range)
    return Bonds(
        i,
        j,
        -np.stack([along, up], axis=1).astype(np.int64),
        discs.radius_n[i] + discs.radius_n[j],
        _repulsion(experiment, stiffness),
        pull,
        tangential_stiffness=made.tangential_stiffness * made.bond_tangential_ratio * _UNIT,
        damping=made.viscosity * (made.bond_normal_ratio if follows else 1.0) * _UNIT,
        tangential_damping=made.tangential_viscosity * (made.bond_tangential_ratio if follows else 1.0) * _UNIT,
    )


def from_scene(scene: Scene) -> tuple[ParticleShear, ShearedDiscs]:
    """Return the experiment and the discs of a native scene that the reference model can run.

    The discs are at rest and touch; `to_scene` of both is the scene again.

    Parameters
    ----------
    scene
        Discs of two sizes in a cell that is rectangular or sheared along its first vector, with the effects of
        `to_scene` (bonds or none) and an oscillatory shear with a `frequency`; discs are of one density.

    Raises
    ------
    ValueError
        If the reference model has no such scene, naming what it lacks.

    Examples
    --------
    >>> experiment = ParticleShear(particles=20, amplitude=0.1)
    >>> start = ShearedDiscs([[100.0, 200.0], [200.0, 200.0]], [60.0, 50.0], [36.0, 25.0])
    >>> found, discs = from_scene(to_scene(experiment, start))
    >>> found.amplitude, discs.radius_n.tolist()
    (0.1, [60.0, 50.0])

    """
    check.instance("scene", scene, Scene)
    packing, drive = scene.packing, scene.drive
    if not isinstance(drive, OscillatoryShearDrive) or drive.frequency is None:
        raise ValueError("scene must have an oscillatory shear with a frequency as its drive")
    of = {type(one): one for one in scene.effects}
    needed = (Repulsion, ContactDamping, Friction, BackgroundDamping)
    if len(of) != len(scene.effects) or not set(needed) <= set(of) <= {*needed, Bonds}:
        names = ", ".join(type(one).__name__ for one in scene.effects)
        raise ValueError(f"scene must have the effects of to_scene, got {names}")
    lattice = packing.box.lattice_dd
    if packing.dimension != 2 or lattice[1, 0] != 0.0 or packing.links:
        raise ValueError("scene must be of discs without rigid links, in a cell whose first vector is along x")
    if packing.given_kind_n is not None:
        raise ValueError(f"scene must have particles of one kind, got {packing.kinds}")
    sizes = np.unique(packing.radius_n)
    if len(sizes) > 2:
        raise ValueError(f"scene must have discs of one or two sizes, got {len(sizes)}")
    width, height = float(lattice[0, 0]), float(lattice[1, 1])
    experiment = _experiment(of, drive, packing, width, height)
    bonds = of.get(Bonds)
    pair_ck = np.zeros((0, 2), dtype=np.int64) if bonds is None else np.stack([bonds.i_b, bonds.j_b], axis=1)
    discs = ShearedDiscs(
        packing.box.wrap(packing.position_nd)[0],
        packing.radius_n,
        packing.mass_n / _UNIT,
        contact_ck=pair_ck,
        kind_c=np.full(len(pair_ck), "bond"),
        width=width,
        height=height,
        strain=float(lattice[0, 1]) / height,
    )
    made = to_scene(experiment, discs, plates=drive.plates is not None)
    if not _equal(of, {type(one): one for one in made.effects}):
        raise ValueError("scene must have laws, springs, dashpots and bonds of one material of the reference model")
    for name in OscillatoryShearDrive.__dataclass_fields__:
        wanted, got = getattr(made.drive, name), getattr(drive, name)
        if not _equal(wanted, got):
            raise ValueError(f"scene.drive.{name} must be {wanted!r} for the reference model, got {brief(got)}")
    return experiment, discs


def _experiment(
    of: dict[type, Any], drive: OscillatoryShearDrive, packing: Packing, width: float, height: float
) -> ParticleShear:
    """Return the parameters that a scene's numbers come from."""
    repulsion, friction, bonds = of[Repulsion].law, of[Friction], of.get(Bonds)
    law, form, numbers = repulsion, "divergent", {}
    if isinstance(repulsion, PlateauRepulsion):
        law, form = repulsion.law, "plateau"
        numbers = {f"plateau_{name}": getattr(repulsion, name) for name in ("begin", "end", "slope")}
    elif bonds is not None and isinstance(bonds.tension, ExponentialTension):
        form, numbers = "exponential", {"tensile_range": bonds.tension.fraction}
    if not isinstance(law, DivergentRepulsion):
        raise ValueError(f"scene must have a divergent repulsion, got {type(law).__name__}")
    normal = tangential = 1.0
    keep = False
    if bonds is not None:
        normal = law.stiffness / bonds.tension.stiffness
        if bonds.tangential_stiffness > 0.0:
            tangential = friction.stiffness / bonds.tangential_stiffness
        same = bonds.damping == of[ContactDamping].coefficient and bonds.tangential_damping == friction.damping
        keep = (normal, tangential) != (1.0, 1.0) and same
    stiffness = law.stiffness / normal
    large, small = float(packing.radius_n.max()), float(packing.radius_n.min())
    ratio = large / small
    mixture = (ratio + 1.0 / ratio) / 2.0
    area = math.pi * large * small * mixture
    density = _density("scene.packing", packing.mass_n, packing.radius_n)
    mass = density / mixture * area
    frequency = float(drive.frequency)  # type: ignore[arg-type]
    return ParticleShear(
        amplitude=drive.amplitude,
        friction_coefficient=friction.coefficient,
        young_modulus=stiffness / native_stiffness(1.0),
        particles=packing.particles,
        packing_fraction=packing.particles * area / (width * height),
        density=density / mixture / 1e-12,
        size_ratio=ratio,
        width=width,
        height=height,
        relative_viscosity=of[ContactDamping].coefficient / (1.0 if keep else normal) / math.sqrt(mass * stiffness),
        tangential_ratio=friction.stiffness / tangential / stiffness,
        relative_frequency=frequency * math.sqrt(mass / stiffness),
        divergence=law.divergence,
        reinforcement_normal=normal,
        reinforcement_tangential=tangential,
        keep_viscosity=keep,
        pre_periods=drive.pre_periods,
        periods=drive.periods,
        post_periods=drive.post_periods,
        cooling=math.exp(-of[BackgroundDamping].rate / frequency),
        law=form,
        **numbers,
    )


def _equal(one: Any, other: Any) -> bool:
    """Return whether two scenes' effects have the same numbers but for rounding."""
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(_equal(one[key], other[key]) for key in one)
    if type(one) is not type(other):
        return isinstance(one, float | int) and isinstance(other, float | int) and math.isclose(one, other)
    if isinstance(one, tuple):
        return len(one) == len(other) and all(map(_equal, one, other))
    if isinstance(one, Bonds):
        return all(_equal(getattr(one, name), getattr(other, name)) for name in Bonds.__dataclass_fields__)
    if isinstance(one, Repulsion):
        return _equal(one.law, other.law)
    if isinstance(one, np.ndarray):
        return one.shape == other.shape and bool(np.allclose(one, other, rtol=_SAME, atol=0.0))
    if isinstance(one, float):
        return math.isclose(one, other, rel_tol=_SAME, abs_tol=0.0)
    return bool(one == other)
