"""What each call does with what a scene holds: one declaration per public call, checked there, printed as a table.

A call honors an effect, or the effect does nothing there (a dashpot at rest), or the call refuses it by name. Nothing
is ignored in silence. Links that do not have their lengths are refused where the answer depends on them. `packmech
effects` prints the table, and what calls honor but not both at once.
"""

from __future__ import annotations

import functools
import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, ParamSpec, TypedDict, TypeVar, Unpack

from packmech.calls.kinds import looks_at_kinds
from packmech.check import clear_errors

P = ParamSpec("P")
R = TypeVar("R")

# a link has its length where its error, over the larger of that and the mean diameter, is below this: what seven digits
# of a text file leave; runs leave 1e-13 [1]
LINK_TOLERANCE = 1e-6
# links of a packing that was strained or displaced a little, as for differences of energies and forces; and of any
STRAINED, ANY_LENGTH = 1e-2, float("inf")

# columns of the table, and what a scene holds that belongs to each
COLUMNS = {
    "repulsion": "pair potentials, such as Repulsion",
    "damping": "dashpots of contacts, such as ContactDamping, ConstantRolling and ViscousRolling",
    "friction": "tangential forces of contacts, such as Friction",
    "rolling": "springs of contacts against rolling and twisting, such as RollingResistance",
    "bonds": "springs between named particles: Bonds",
    "interactions": "forces of a range of their own between centers, and torques between directions",
    "gravity": "potentials of single particles, such as Gravity",
    "walls": "Walls",
    "drag": "drag on single particles, such as BackgroundDamping",
    "noise": "thermal noise: Langevin",
    "held": "particles that are held: FixedParticles",
    "links": "rigid links of the packing",
    "shapes": "shapes other than discs and spheres",
    "breaking": "bonds that break: Bonds with breaks_at",
    "memory": "interactions that remember, such as JKR",
    "rough": "Walls or MeshWalls with friction, or on which particles roll or spin with resistance",
    "kinds": "laws and numbers that differ by kinds of particles: LawByKind, ByKind, and a user's that read kinds; of "
    "walls LawPerKind, PerKind",
    "moving": "Walls that move, or hold a stress: WallMotion",
    "mesh": "walls of triangles: MeshWalls",
}
EFFECTS = tuple(COLUMNS)[:11]
# columns of what a scene adds to its packing
_OF_SCENES = (*EFFECTS, "breaking", "memory", "rough", "kinds", "moving", "mesh")
# places at which a drag is asked whether it pushes what does not move
_PLACES = ((0.0, 0.0, 0.0), (0.3, -0.7, 1.1), (-12.0, 5.0, 40.0))
# what stands in the table
HONORED, NOTHING, REFUSED, ABSENT = "yes", "zero at rest", "refused", ""
# calls that honor what others refuse
INSTEAD = {
    "damping": "pm.simulate",
    "friction": "pm.simulate or pm.contact_forces",
    "rolling": "pm.simulate",
    "bonds": "pm.simulate or pm.oscillatory_shear",
    "interactions": "pm.simulate or pm.quench",
    "gravity": "pm.simulate or pm.quench or pm.settle",
    "walls": "pm.simulate or pm.quench",
    "drag": "pm.simulate",
    "noise": "pm.simulate",
    "held": "pm.simulate or pm.quench or pm.settle",
    "links": "pm.simulate or pm.jam",
    "shapes": "pm.jam or pm.quench",
    "breaking": "pm.simulate or pm.ramp_strain",
    "memory": "pm.simulate",
    "rough": "pm.simulate or pm.settle",
    "kinds": "pm.simulate or pm.quench",
    "moving": "pm.simulate",
    "mesh": "pm.simulate or pm.quench or pm.settle",
}


def columns_of(effect: Any) -> tuple[str, ...]:
    """Return the columns of an effect: what its class says itself in `acts_as`, or else what its hooks do.

    Columns that depend on its parameters come from `acts_also`: bonds are in "breaking" only if they have limits.
    """
    said = getattr(effect, "acts_as", None)
    if said is not None:
        return (str(said), *getattr(effect, "acts_also", ()))
    found = []
    if hasattr(effect, "tangential_force"):
        found.append("friction")
    if hasattr(effect, "pair_energy"):
        found.append("repulsion")
    if hasattr(effect, "pair_damping"):
        found.append("damping")
    if hasattr(effect, "interaction_energy"):
        found.append("interactions")
        if getattr(effect, "memory", 0):
            found.append("memory")
    if hasattr(effect, "bath_rate"):
        found.append("noise")
    if hasattr(effect, "body_energy") or _pushes_at_rest(effect):
        found.append("gravity")
    elif hasattr(effect, "body_force") or hasattr(effect, "spin_drag"):
        found.append("drag")
    if looks_at_kinds(effect):
        found.append("kinds")
    return tuple(found)


def _pushes_at_rest(effect: Any) -> bool:
    """Return whether an effect on single particles pushes one that does not move, at some place or other."""
    hook = getattr(effect, "body_force", None)
    if hook is None:
        return False
    try:
        return any(any(hook(*place, 0.0, 0.0, 0.0, 1.0, 0.5)) for place in _PLACES)
    except Exception:  # what compiles need not run in plain Python: it is not taken for a drag then
        return True


@dataclass(frozen=True)
class Honors:
    """What one call honors.

    Attributes
    ----------
    call
        Its public name.
    columns
        Names of `COLUMNS` that it honors.
    at_rest
        Whether it looks at particles at rest, where damping and drag do nothing.
    packing_only
        Whether it takes a packing, which has no effects.
    rough, shaped
        The call that does the same with friction, and with shapes, where there is one.
    link_tolerance
        Largest error of a link's length that it takes, over the larger of that and the mean diameter [1].
    remarks
        By columns that it refuses: why it does, or what else to do.

    """

    call: str
    columns: tuple[str, ...]
    at_rest: bool = False
    packing_only: bool = False
    rough: str = ""
    shaped: str = ""
    link_tolerance: float = LINK_TOLERANCE
    remarks: Mapping[str, str] = field(default_factory=dict)

    def instead(self, column: str) -> str:
        """Return the calls that honor a column which this one refuses."""
        return {"friction": self.rough, "rolling": self.rough, "shapes": self.shaped}.get(column) or INSTEAD[column]

    def answer(self, column: str) -> str:
        """Return what stands in this column of the table."""
        if column in self.columns:
            return HONORED
        if self.packing_only and column in _OF_SCENES:
            return ABSENT
        return NOTHING if self.at_rest and column in ("damping", "drag") else REFUSED

    def _refuses(self, effect: Any, column: str) -> bool:
        """Return whether the call refuses an effect of a column: not all that acts lets something come to rest."""
        pushes = self.at_rest and column == "gravity" and not hasattr(effect, "body_energy")
        moves = self.at_rest and column == "held" and getattr(effect, "moves", False)
        return pushes or moves or self.answer(column) == REFUSED

    def check(self, name: str, subject: Any) -> None:
        """Refuse what a scene or a packing holds and the call does not honor; other values pass, and fail there.

        Raises
        ------
        ValueError
            Naming what is refused, the call, and the way out.

        """
        for k, one in enumerate(getattr(subject, "effects", ())):
            column = next((each for each in columns_of(one) if self._refuses(one, each)), None)
            kind = type(one).__qualname__
            if column == "breaking":
                raise ValueError(
                    f"{name}.effects must hold no bonds that break for pm.{self.call}, which would break none, got "
                    f"limits of {kind} at {k}: take them away with bonds.unbreakable(), or use {self.instead(column)}"
                )
            if column == "moving":
                raise ValueError(
                    f"{name}.effects must hold walls that stand still for pm.{self.call}, which moves none, got {kind} "
                    f"with a motion at {k}: take walls.still, or use {self.instead(column)}"
                )
            if column == "rough":
                raise ValueError(
                    f"{name}.effects must hold smooth walls for pm.{self.call}, which knows no rough ones, got {kind} "
                    f"with friction or resistance to rolling at {k}: take friction=pm.Friction(0.0), or use "
                    f"{self.instead(column)}"
                )
            if column == "kinds":
                raise ValueError(
                    f"{name}.effects must be the same for all kinds of particles for pm.{self.call}, which knows none, "
                    f"got {kind} at {k}, which looks at kinds: take one law or number, or use {self.instead(column)}"
                )
            if column is not None:
                # of what is in several columns a call that honors all
                others = [other for other in columns_of(one) if self._refuses(one, other)]
                way = " or ".join(
                    call
                    for call in self.instead(column).split(" or ")
                    if all(call in self.instead(other).split(" or ") for other in others)
                )
                remark = f" ({self.remarks[column]})" if column in self.remarks else ""
                raise ValueError(
                    f"{name}.effects must hold nothing that pm.{self.call} would ignore, got {kind} at {k}{remark}: "
                    f"leave it out with scene.without(pm.{kind}), or use {way or self.instead(column)}"
                )
        packing = getattr(subject, "packing", subject)
        links, shapes = getattr(packing, "links", None), getattr(packing, "shapes", None)
        where = f"{name}.packing" if packing is not subject else name
        if getattr(shapes, "has_orientations", False) and self.answer("shapes") == REFUSED:
            raise ValueError(
                f"{where} must be of discs or spheres for pm.{self.call}, which knows no other shapes, got "
                f"{type(shapes).__name__}: leave them out with packing.replace(shapes=None), or use "
                f"{self.instead('shapes')}"
            )
        if links and self.answer("links") == REFUSED:
            raise ValueError(
                f"{where} must have no links for pm.{self.call}, which would ignore them, got {len(links)}: leave them "
                f"out with packing.replace(links=None), or use {self.instead('links')}"
            )
        check_lengths = getattr(packing, "check_link_lengths", None)
        if check_lengths is not None:
            check_lengths(where, self.call, self.link_tolerance)


# declarations by the name of the call
CALLS: dict[str, Honors] = {}


class HowHonored(TypedDict, total=False):
    """How a call honors what it does: fields of `Honors`."""

    at_rest: bool
    packing_only: bool
    rough: str
    shaped: str
    link_tolerance: float
    remarks: Mapping[str, str]


def declare(call: str, columns: str, **how: Unpack[HowHonored]) -> Honors:
    """Return the declaration of a call, entered in the table; for classes, which check what they are given themselves.

    Parameters
    ----------
    call
        The public name.
    columns
        Names of `COLUMNS` that it honors, with spaces between.
    how
        Fields of `Honors`.

    """
    named = tuple(columns.split())
    unknown = [one for one in named if one not in COLUMNS]
    if unknown:
        raise ValueError(f"columns must be among {', '.join(COLUMNS)}, got {unknown[0]}")
    CALLS[call] = Honors(call, named, **how)
    return CALLS[call]


def honors(columns: str, **how: Unpack[HowHonored]) -> Callable[[Callable[P, R]], Callable[P, R]]:
    """Return a decorator for a public function of a scene or a packing: what it honors.

    The argument of that name is what is checked, or the first where neither name is among them.

    Parameters
    ----------
    columns, how
        As in `declare`.

    """

    def decorate(function: Callable[P, R]) -> Callable[P, R]:
        names = list(inspect.signature(function).parameters)
        place = next((names.index(one) for one in ("scene", "packing") if one in names), 0)
        name = names[place]
        declared, clear = declare(function.__name__, columns, **how), clear_errors(function)

        @functools.wraps(function)
        def call(*args: P.args, **kwargs: P.kwargs) -> R:
            declared.check(name, args[place] if place < len(args) else kwargs.get(name))
            return clear(*args, **kwargs)

        return call

    return decorate
