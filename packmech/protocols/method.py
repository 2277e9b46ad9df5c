"""What a jamming method is: the strains and effects that it knows, how it begins, where it ends, what it reports."""

from __future__ import annotations

import abc
from collections.abc import Mapping
from typing import ClassVar

from packmech.calls.honors import columns_of
from packmech.jit.compiled import own_name
from packmech.packing import Packing
from packmech.protocols.protocol import Protocol, finish
from packmech.result import Outcome, Run
from packmech.scene import Scene

# every method, in the order in which they were defined
_METHODS: list[type[JamMethod]] = []


class JamMethod(abc.ABC):
    """A way from a scene to a packing under pressure: what `jam` takes as `method`, and scene files by its name.

    A method of one's own is a frozen dataclass of its settings that derives from this class and defines `follow`. One
    whose field `start_packing_fraction` is given begins there, and does not go on from a packing that is jammed.

    Attributes
    ----------
    honors
        Strain of the box -> what it honors then beside pair potentials, by columns of `packmech effects`, such as
        "friction" or "links shapes". Strains that are not named are refused.
    ends_at
        "a pressure", or where else it ends: no pressure may be asked for then.

    Examples
    --------
    >>> import packmech as pm
    >>> from dataclasses import dataclass
    >>> @dataclass(frozen=True)
    ... class StepsDown(pm.JamMethod):
    ...     steps: int = 4
    ...     honors = {"isotropic": "shapes"}
    ...     def follow(self, protocol, pressure):
    ...         packing = protocol.scene.packing
    ...         for k in range(self.steps, -1, -1):
    ...             packing = protocol.relax_strained(packing, pressure * 10.0**k, 1e-8, 10_000).packing
    ...         return packing, pm.Outcome.CONVERGED
    >>> packing = pm.random_packing(16, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.9, seed=1)
    >>> scene = pm.Scene(packing, (pm.Repulsion(),))
    >>> run = pm.jam(scene, pressure=1e-4, strain="isotropic", method=StepsDown())
    >>> run.report["method"], round(run.report["pressure"], 8)
    ('StepsDown', 0.0001)

    """

    honors: ClassVar[Mapping[str, str]] = {"isotropic": "", "free": ""}
    ends_at: ClassVar[str] = "a pressure"

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        own_name("method", cls, _METHODS)
        _METHODS.append(cls)

    @classmethod
    def suits(cls, scene: Scene, strain: str) -> bool:
        """Return whether it knows the strain, and honors then what the scene holds."""
        return strain in cls.honors and held_columns(scene) <= set(cls.honors[strain].split())

    @property
    def begins_afresh(self) -> bool:
        """Whether its settings say where it begins, whatever packing it is given."""
        return getattr(self, "start_packing_fraction", None) is not None

    @abc.abstractmethod
    def follow(self, protocol: Protocol, pressure: float) -> tuple[Packing, Outcome]:
        """Return the packing that it ends with, and how it ended.

        Parameters
        ----------
        protocol
            The scene, the free strains and the force tolerance, with what relaxes a packing; stages and figures are
            added to it. Where `protocol.continues` is set, the scene's packing is jammed and to be gone on from.
        pressure
            The pressure to end at [energy_scale / diameter^d].

        """

    def finish(self, protocol: Protocol, outcome: Outcome, asked: float | None, began: float) -> Run:
        """Return the run that ended with the protocol's last packing, its figures recomputed from that.

        Parameters
        ----------
        protocol, outcome
            The protocol, and how it ended.
        asked
            The pressure asked for [energy_scale / diameter^d]; None where none was.
        began
            CPU time of the start [s].

        """
        return finish(protocol, protocol.last, outcome, asked, type(self).__name__, began)


def registered_methods() -> tuple[type[JamMethod], ...]:
    """Return every jamming method, in the order of definition."""
    return tuple(_METHODS)


def held_columns(scene: Scene) -> set[str]:
    """Return the columns of `packmech effects` that a scene holds and only some methods honor."""
    packing = scene.packing
    found = {column for effect in scene.effects for column in columns_of(effect)}
    found |= {
        name for name, held in (("links", len(packing.links)), ("shapes", packing.shapes.has_orientations)) if held
    }
    return found - {"repulsion", "damping", "drag"}
