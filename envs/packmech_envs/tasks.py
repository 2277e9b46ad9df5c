"""What an environment is given: options that are checked, and a scene by name, from a file, or as a Scene.

Every wrong option gets an error that names it, what is required and what was given.
"""

from __future__ import annotations

import math
import os
from dataclasses import Field, fields, replace
from functools import cache
from pathlib import Path
from typing import Any, ClassVar, Protocol, TypeVar

import numpy as np

import packmech as pm
from packmech_envs.words import brief, nearest


class _Record(Protocol):
    """What `dataclasses.replace` takes."""

    __dataclass_fields__: ClassVar[dict[str, Field[Any]]]


Task = TypeVar("Task", bound=_Record)

# what newcomers give an environment and scenes have
_OF_SCENES = ("particles", "dimension", "packing_fraction", "sizes", "seed")


def task_of(kind: type[Task], task: Any, options: dict[str, Any]) -> Task:
    """Return the task of an environment: the one given, or the default one, with these options changed.

    Parameters
    ----------
    kind
        QuenchTask or ShearTask.
    task
        A record of that kind; None: the one with all defaults.
    options
        Fields of the record by name, as an environment gets them as keywords.

    Raises
    ------
    TypeError
        For another kind of task, or an option that there is not.

    Examples
    --------
    >>> from packmech_envs.quench import QuenchTask
    >>> task_of(QuenchTask, QuenchTask(relax=5), {"step_budget": 10}).relax
    5

    """
    names = [field.name for field in fields(kind)]
    for name in options:
        if name not in names:
            words = f"{name!r} is no option of {kind.__name__}, which has {', '.join(names)}{nearest(name, names)}"
            if name in _OF_SCENES:
                changes = f"changes={{'packing.{name}': {brief(options[name])}}}"
                words += f"; the scene sets it: scene=packmech.read_scene('default', {changes})"
            raise TypeError(words)
    if task is None:
        return kind(**options)
    if not isinstance(task, kind):
        raise TypeError(f"task must be a {kind.__name__}, got {brief(task)}")
    return replace(task, **options)


def one_of(name: str, value: Any, allowed: tuple[str, ...]) -> None:
    """Check that a value is one of some names."""
    if not isinstance(value, str) or value not in allowed:
        near = nearest(value, allowed) if isinstance(value, str) else ""
        raise ValueError(f"{name} must be one of {', '.join(map(repr, allowed))}, got {brief(value)}{near}")


def boolean(name: str, value: Any) -> None:
    """Check that a value is True or False."""
    if not isinstance(value, bool):
        raise TypeError(f"{name} must be True or False, got {brief(value)}")


def real(name: str, value: Any, what: str = "a finite number") -> float:
    """Return a finite real number."""
    if isinstance(value, bool) or not isinstance(value, int | float | np.integer | np.floating):
        raise TypeError(f"{name} must be {what}, got {brief(value)}")
    try:
        number = float(value)
    except OverflowError:
        number = math.inf
    if not math.isfinite(number):
        raise ValueError(f"{name} must be {what}, got {brief(value)}")
    return number


def positive(name: str, value: Any) -> float:
    """Return a positive finite number."""
    number = real(name, value, "a positive number")
    if number <= 0.0:
        raise ValueError(f"{name} must be a positive number, got {brief(value)}")
    return number


def count(name: str, value: Any, what: str = "an integer at least 1") -> int:
    """Return an integer of 1 or more."""
    if isinstance(value, bool | np.bool_) or not isinstance(value, int | np.integer):
        raise TypeError(f"{name} must be {what}, got {brief(value)}")
    if value < 1:
        raise ValueError(f"{name} must be {what}, got {brief(value)}")
    return int(value)


def budget(name: str, value: Any) -> int | None:
    """Return an integer of 1 or more, or None."""
    return None if value is None else count(name, value, "None or an integer at least 1")


LINKS = ("refuse", "bonds")
LEFT_OUT = ("refuse", "leave out")
# hooks of effects that act at rest, or never rest, and that minimizers of batches do not know
NOT_IN_BATCHES = ("interaction_energy", "bath_rate")


def scene_of(scene: Any) -> pm.Scene:
    """Return the scene that was named.

    Parameters
    ----------
    scene
        A pm.Scene, the name of a shipped scene (`pm.list_scenes()`), or a scene file.

    Raises
    ------
    TypeError, ValueError, FileNotFoundError
        Saying what is wrong with the argument, or with which field of the file.

    Examples
    --------
    >>> scene_of("triangular").packing.particles
    64

    """
    if isinstance(scene, pm.Scene):
        return scene
    if not isinstance(scene, str | os.PathLike):
        raise TypeError(
            f"scene must be a Scene, a scene file or the name of a shipped scene, got {type(scene).__name__}"
        )
    name = os.fspath(scene)
    if isinstance(scene, str) and name in pm.list_scenes():
        return _shipped(name)
    if not Path(name).suffix and Path(name).name == name:
        known = pm.list_scenes()
        raise ValueError(f"scene must be a file or one of {', '.join(known)}, got {brief(name)}{nearest(name, known)}")
    return pm.read_scene(scene)


@cache
def _shipped(name: str) -> pm.Scene:
    """Return a shipped scene; some take seconds to prepare, and a scene is data that nothing changes."""
    return pm.read_scene(name)


def shearable(scene: pm.Scene, *, links: str = "refuse", link_stiffness: float | None = None) -> pm.Scene:
    """Return the scene as time-stepped shear takes it: rigid links refused, or made bonds.

    Parameters
    ----------
    scene
        The scene.
    links
        What to do with rigid links, which time stepping in a sheared box does not hold: "refuse", or "bonds": each
        becomes a permanent bond of its length.
    link_stiffness
        Of these bonds [energy/length^2]; ten times energy_scale / reference_diameter^2 unless given.

    Raises
    ------
    TypeError, ValueError
        Naming the argument that is wrong.

    Examples
    --------
    >>> trimers = scene_of("fifty-trimers-2d")
    >>> bonded = shearable(trimers, links="bonds")
    >>> len(bonded.effects[-1]), len(trimers.packing.links), len(bonded.packing.links)
    (150, 150, 0)

    """
    one_of("links", links, LINKS)
    if not scene.packing.links:
        return scene
    if links == "refuse":
        raise ValueError(
            f"scene must have no rigid links here, got {len(scene.packing.links)}; "
            'links="bonds" makes each of them a stiff permanent bond'
        )
    return bonds_for_links(scene, link_stiffness)


def bonds_for_links(scene: pm.Scene, stiffness: float | None = None) -> pm.Scene:
    """Return the scene with a permanent bond in place of each rigid link.

    The bonds are linear springs without tangential springs, slack at the lengths of the links. Links that hold a shape
    become bonds too, so that clusters keep theirs. Pairs without a link in a rigid cluster, which rigid links keep from
    touching, may touch.

    Parameters
    ----------
    scene
        The scene.
    stiffness
        Of the bonds [energy/length^2]; ten times energy_scale / reference_diameter^2 unless given.

    Raises
    ------
    TypeError, ValueError
        For a stiffness that is no positive number, or bonds between pairs that are linked.

    Examples
    --------
    >>> bonds_for_links(scene_of("fifty-trimers-2d"), 100.0).effects[-1].tension
    LinearSpring(stiffness=100.0)

    """
    packing = scene.packing
    links = packing.links
    if not len(links):
        return scene
    if stiffness is None:
        stiffness = 10.0 * scene.energy_scale / packing.reference_diameter**2
    spring = pm.LinearSpring(positive("link_stiffness", stiffness))
    bonds = pm.Bonds(
        links.i_l, links.j_l, links.image_ld, links.length_l,
        compression=spring, tension=spring, tangential_stiffness=0.0,
    )  # fmt: skip
    if any(isinstance(one, pm.Bonds) for one in scene.effects):
        raise ValueError("scene must not have bonds beside rigid links that are to become bonds, got both")
    return scene.replace(packing=packing.replace(links=None), effects=(*scene.effects, bonds))


def quenchable(scene: pm.Scene, *, bonds: str = "refuse", friction: str = "refuse") -> pm.Scene:
    """Return the scene as minimizers take it: with those effects that are an energy of pairs in contact.

    Dashpots do nothing at rest and are left out. Friction has no energy that a minimum could be of: its tangential
    springs stretch as particles move and turn in time, and a minimizer, which takes no time, would end in another
    packing for every way down. It is refused unless it is to be left out, as are bonds. Gravity, walls, thermal noise
    and cohesion are refused: a packing with them is another one than that without.

    Parameters
    ----------
    scene
        The scene.
    bonds, friction
        "refuse", or "leave out".

    Raises
    ------
    ValueError
        Naming what is not known here.

    Examples
    --------
    >>> [type(one).__name__ for one in quenchable(scene_of("rough-discs"), friction="leave out").effects]
    ['Repulsion']

    """
    one_of("bonds", bonds, LEFT_OUT)
    one_of("friction", friction, LEFT_OUT)
    kept = []
    for k, one in enumerate(scene.effects):
        if isinstance(one, pm.Bonds):
            if bonds == "refuse" and len(one):
                raise ValueError(
                    f"scene must have no bonds here, which batches do not know, got {len(one)} in effects[{k}]; "
                    'bonds="leave out" quenches the packing without them'
                )
        elif isinstance(one, pm.Friction | pm.RollingResistance | pm.TwistingResistance):
            numbered = not isinstance(one.coefficient, pm.ByKind)
            if friction == "refuse" and not (numbered and one.coefficient == 0.0):
                raise ValueError(
                    "scene must have no friction here, whose tangential springs stretch on the way that particles take "
                    f'in time while a minimizer takes none, got effects[{k}]; friction="leave out" quenches the '
                    "packing without it, and pm.jam and pm.settle press and come to rest in time with it"
                )
        elif isinstance(one, pm.FixedParticles) or hasattr(type(one), "body_energy"):
            raise ValueError(
                f"scene must have no {type(one).__name__} here, which this environment does not know (pm.quench does), "
                f"got effects[{k}]"
            )
        elif hasattr(type(one), "pair_energy"):
            kept.append(one)
        elif any(hasattr(type(one), hook) for hook in NOT_IN_BATCHES):
            raise ValueError(
                f"scene must have no {type(one).__name__} here, which minimizers of batches do not know, "
                f"got effects[{k}]: leave it out with scene.without(pm.{type(one).__name__})"
            )
    if not kept:
        raise ValueError("scene must have an effect with an energy, such as Repulsion(), got none")
    return scene if len(kept) == len(scene.effects) else scene.replace(effects=tuple(kept))
