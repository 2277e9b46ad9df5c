"""Local yield stress: patches of a plane packing, each sheared by what surrounds it until it falls."""

from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.box import Box
from packmech.calls.honors import honors
from packmech.calls.status import Progress
from packmech.check import finite_array, instance, positive
from packmech.effects import FixedParticles
from packmech.loop.run_loop import RunLoop, run_settings
from packmech.measure.contact_forces import resting_forces
from packmech.measure.counting import packing_fraction
from packmech.observables import Table, make_table
from packmech.packing import Packing
from packmech.protocols.protocol import check_jammed, is_jammed
from packmech.protocols.shearing.quasistatic import shear_held
from packmech.result import Condition, Outcome, Row, Run, Stage, unmet_conditions
from packmech.scene import Scene

# width of the ring of held particles about a patch: none that is free passes it [largest diameter]
_RING = 2.0
# the default radius of a patch [mean diameter]
_RADIUS = 5.0
# what a patch answers with: strain and stress at which it falls, stress before, energy freed
_FIGURES = ("yield_strain", "yield_stress", "start_stress", "energy_drop")


@dataclass(frozen=True, eq=False, repr=False)
class LocalYield(Run):
    """What patches of a packing bear until they fall, by center and direction of shear.

    Attributes
    ----------
    center_pd
        (P, 2) centers of the patches [length].
    direction_k
        (K,) angles of the flow from the x axis [rad].
    radius
        Of the patches [length].
    free_p
        (P,) numbers of particles that were free.
    yield_strain_pk
        (P, K) shear strains of the last equilibrium before the first plastic fall; infinite where there was none up to
        the largest strain, nan where the patch was not done or did not come to rest [1].
    yield_stress_pk
        (P, K) what the shear stress of the patch had grown by there, infinite and nan where the strain is
        [energy_scale / diameter^2].
    start_stress_pk
        (P, K) its shear stress at the start, along the same direction [energy_scale / diameter^2].
    energy_drop_pk
        (P, K) energies that the falls freed [energy_scale].

    """

    center_pd: NDArray[np.float64] = None  # type: ignore[assignment]
    direction_k: NDArray[np.float64] = None  # type: ignore[assignment]
    radius: float = math.nan
    free_p: NDArray[np.int64] = None  # type: ignore[assignment]
    yield_strain_pk: NDArray[np.float64] = None  # type: ignore[assignment]
    yield_stress_pk: NDArray[np.float64] = None  # type: ignore[assignment]
    start_stress_pk: NDArray[np.float64] = None  # type: ignore[assignment]
    energy_drop_pk: NDArray[np.float64] = None  # type: ignore[assignment]

    @property
    def weakest_p(self) -> NDArray[np.float64]:
        """The (P,) least growth of stress to a fall over the directions that came to rest [energy_scale/diameter^2]."""
        least: NDArray[np.float64] = np.fmin.reduce(self.yield_stress_pk, axis=1)
        return least

    @property
    def weakest(self) -> tuple[int, int] | None:
        """The patch and the direction, by number, that fall at the least growth of stress; None where none fell."""
        if not np.isfinite(self.yield_stress_pk).any():
            return None
        patch, direction = divmod(int(np.nanargmin(self.yield_stress_pk)), len(self.direction_k))
        return patch, direction

    @property
    def title(self) -> str:
        """What the run is of, in words."""
        return f"{super().title}, {len(self.center_pd)} patches sheared in {len(self.direction_k)} directions"

    def to_dict(self) -> dict[str, Any]:
        """Return what was found by name, as plain values."""
        fallen = self.yield_stress_pk[np.isfinite(self.yield_stress_pk)]
        return {
            **super().to_dict(),
            "patches": len(self.center_pd),
            "directions": len(self.direction_k),
            "radius": self.radius,
            "fallen": len(fallen),
            "smallest_yield_stress": float(fallen.min()) if len(fallen) else math.nan,
            "weakest": None if self.weakest is None else list(self.weakest),
            "mean_yield_stress": float(fallen.mean()) if len(fallen) else math.nan,
        }

    def rows(self) -> list[Row]:
        """Return what the run reached: name, value, and what the value is."""
        found, asked, where = self.to_dict(), self.yield_strain_pk.size, ""
        if self.weakest is not None:
            patch, direction = self.weakest
            x, y = self.center_pd[patch]
            degrees = math.degrees(self.direction_k[direction])
            where = f"; patch {patch} at ({x:.4g}, {y:.4g}), flow along {degrees:.3g} degrees"
        return [
            *self.outcome_rows(),
            ("patches", str(found["patches"]), f"of radius {self.radius:.4g}, {self.free_p.mean():.3g} particles"),
            ("fallen", f"{found['fallen']} of {asked}", "patches and directions"),
            ("smallest yield stress", f"{found['smallest_yield_stress']:.4g}", f"energy_scale / diameter^2{where}"),
            ("mean yield stress", f"{found['mean_yield_stress']:.4g}", "energy_scale / diameter^2"),
            ("force residual", f"{self.residual:.1e}", "largest net force / mean contact force"),
        ]

    def table(self) -> Table:
        """Return the patches and directions as rows of columns."""
        patches, directions = self.yield_strain_pk.shape
        found = {
            "x": np.repeat(self.center_pd[:, 0], directions),
            "y": np.repeat(self.center_pd[:, 1], directions),
            "direction": np.tile(self.direction_k, patches),
            **{name: getattr(self, f"{name}_pk").ravel() for name in _FIGURES},
        }
        density = "energy_scale/diameter^2"
        units = {"x": "length", "y": "length", "direction": "rad", "yield_strain": "1", "energy_drop": "energy_scale"}
        return make_table(found, self.about(), units | dict.fromkeys(("yield_stress", "start_stress"), density))


class _Patch(NamedTuple):
    """A disc of free particles in a ring of held ones, alone in a box, turned so that the flow is along x."""

    scene: Scene
    free_n: NDArray[np.bool_]
    # area that belongs to the free ones, at the packing fraction of the whole [length^2]
    area: float

    def shear_stress(self, packing: Packing) -> float:
        """Return the shear stress of the free particles, tension positive [energy/length^2].

        Of a contact's virial half belongs to either particle.
        """
        found = resting_forces(self.scene.replace(packing=packing))
        pairs = found.contacts
        share = 0.5 * (self.free_n[pairs.i_c].astype(float) + self.free_n[pairs.j_c])
        across = pairs.normal_cd[:, 0] * pairs.normal_cd[:, 1]
        return -float((share * found.normal_c * pairs.distance_c * across).sum()) / self.area


def _cut(scene: Scene, center_d: NDArray[np.float64], radius: float, direction: float) -> _Patch:
    """Return the patch about a center."""
    packing = scene.packing
    apart = packing.position_nd - center_d
    apart += packing.box.nearest_images(apart) @ packing.box.lattice_dd.T
    widest = float(packing.diameter_n.max())
    outer = radius + _RING * widest
    distance = np.hypot(*apart.T)
    kept = np.flatnonzero(distance < outer)
    free = distance[kept] < radius
    cos, sin = math.cos(direction), math.sin(direction)
    turned = apart[kept] @ np.array([[cos, -sin], [sin, cos]])
    side = 2.0 * (outer + widest)
    radius_n = packing.radius_n[kept]
    kind_n = None if packing.kind_n is None else packing.kind_n[kept]
    alone = Packing(turned + 0.5 * side, radius_n, Box.cubic(side, 2), kind_n=kind_n)
    held = FixedParticles(tuple(np.flatnonzero(~free).tolist()))
    area = math.pi * float((radius_n[free] ** 2).sum()) / float(packing_fraction(packing))
    return _Patch(Scene(alone, (*scene.effects, held)), free, area)


@honors("repulsion kinds", at_rest=True)
def local_yield_stress(
    scene: Scene,
    centers: ArrayLike | None = None,
    *,
    radius: float | None = None,
    directions: Sequence[float] = (0.0,),
    largest_strain: float = 0.2,
    step: float = 1e-3,
    smallest_drop: float | None = None,
    force_tolerance: float = 1e-9,
    time_limit: float | None = None,
    progress: Progress = None,
    check: bool = True,
) -> LocalYield:
    """Return how much more shear stress patches of a jammed plane packing bear before they fall.

    Particles within the radius of a center are free, those around are held and taken along by a simple shear, as by
    `quasistatic_shear`, until the patch falls plastically for the first time: the method of Puosi, Olivier and Martens
    (Soft Matter 11, 7639 (2015)) and of Patinet, Vandembroucq and Falk (Phys. Rev. Lett. 117, 045501 (2016)). Small
    growth marks where the packing will rearrange under shear of that direction. A patch and direction take seconds,
    most of it where it falls.

    Parameters
    ----------
    scene
        The scene of a jammed packing of discs, at rest.
    centers
        (P, 2) centers of the patches [length]; None: those of all particles.
    radius
        Of the patches [length]; None: five mean diameters. With the ring of held particles they must fit into the box.
    directions
        Angles of the flow from the x axis [rad]; the gradient is a quarter turn ahead. One and its opposite are the
        same; a quarter turn away is, for small strains, the reverse shear.
    largest_strain
        Where no patch has fallen by then it counts as one that does not [1].
    step
        Step of strain [1].
    smallest_drop
        Energy drop down to which falls are to be found, as of `quasistatic_shear` [energy_scale].
    force_tolerance
        Net force over mean contact force that counts as balance [1].
    time_limit
        Stop after so much CPU time, compiling aside [s], with Outcome.TIME_LIMIT.
    progress
        Called as progress("local yield", figures) after each patch and direction, figures with "done", "of",
        "yield_stress".
    check
        Raise NotConverged where a patch does not come to rest or time was up; otherwise return what there is.

    Returns
    -------
    LocalYield
        Outcome.FINISHED; Outcome.STALLED where some patch did not come to rest.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, the packing is not jammed, or patches do not fit into the box.
    NotConverged
        Its `.run` holds what was reached.
    KeyboardInterrupt
        Passed on with `.run` set to the patches that were finished.

    Examples
    --------
    >>> import packmech as pm
    >>> start = pm.random_packing(128, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.86, seed=3)
    >>> scene = pm.Scene(start, (pm.Repulsion(),))
    >>> scene = scene.replace(packing=pm.jam(scene, pressure=3e-3).packing)
    >>> found = pm.local_yield_stress(scene, [[3.0, 6.0]], radius=2.5)
    >>> found.yield_strain_pk.round(3).tolist(), bool(found.yield_stress_pk[0, 0] > 0.0)
    ([[0.069]], True)

    """
    instance("scene", scene, Scene)
    packing = scene.packing
    if packing.dimension != 2:
        raise ValueError(f"scene.packing must be in a plane, got one of dimension {packing.dimension}")
    check_jammed(scene)
    center_pd = packing.position_nd if centers is None else finite_array("centers", centers, shape=(None, 2))
    direction_k = finite_array("directions", directions, shape=(None,))
    size = _RADIUS * float(packing.diameter_n.mean()) if radius is None else positive("radius", radius)
    _check_room(packing, size)
    asked = {
        "applied_strain": positive("largest_strain", largest_strain),
        "step": positive("step", step),
        "smallest_drop": None if smallest_drop is None else positive("smallest_drop", smallest_drop),
        "force_tolerance": positive("force_tolerance", force_tolerance),
    }
    loop = RunLoop(run_settings(time_limit=time_limit, progress=progress, check=check))
    work = _Patches(scene, center_pd, size, direction_k, asked, loop)
    return loop.run(work.through, work.finish)


def _check_room(packing: Packing, radius: float) -> None:
    """Refuse patches that meet their own images."""
    small, _ = packing.box.reduced()
    most = 0.5 * float(small.height_d.min()) - _RING * float(packing.diameter_n.max())
    if radius > most:
        raise ValueError(
            f"radius must be at most {most:.4g}, so that a patch and {_RING:g} diameters around it fit into the box, "
            f"got {radius:.4g}"
        )


class _Patches:
    """The patches of a packing, one after the other."""

    def __init__(
        self,
        scene: Scene,
        center_pd: NDArray[np.float64],
        radius: float,
        direction_k: NDArray[np.float64],
        asked: dict[str, Any],
        loop: RunLoop,
    ) -> None:
        self.scene, self.center_pd, self.radius, self.direction_k = scene, center_pd, radius, direction_k
        self.asked, self.loop = asked, loop
        self.began = time.process_time()
        shape = (len(center_pd), len(direction_k))
        self.found = {name: np.full(shape, math.nan) for name in _FIGURES}
        self.free_p = np.zeros(len(center_pd), dtype=np.int64)
        self.done = self.steps = 0
        self.residual = 0.0
        self.stalled = False

    def through(self) -> Outcome:
        """Shear each patch in each direction."""
        for p, center in enumerate(self.center_pd):
            for k, direction in enumerate(self.direction_k.tolist()):
                self.loop.check_time()
                self._shear(p, k, _cut(self.scene, center, self.radius, direction))
                self.done += 1
                self.loop.report(
                    "local yield", done=self.done, of=self.found["yield_strain"].size,
                    yield_stress=float(self.found["yield_stress"][p, k]),
                )  # fmt: skip
        return Outcome.STALLED if self.stalled else Outcome.FINISHED

    def _shear(self, p: int, k: int, patch: _Patch) -> None:
        """Shear one patch until it falls."""
        unit, found = self.scene.pressure_unit, self.found
        self.free_p[p] = int(patch.free_n.sum())
        if not self.free_p[p] or not resting_forces(patch.scene).mean_force > 0.0:
            found["yield_strain"][p, k] = found["yield_stress"][p, k] = math.inf
            found["start_stress"][p, k] = 0.0
            return
        start = patch.shear_stress(patch.scene.packing)
        found["start_stress"][p, k] = start / unit
        if not is_jammed(patch.scene):
            self.stalled = True
            return
        settings = dataclasses.replace(self.loop.rest(), progress=False, check=False)
        run = shear_held(patch.scene, **self.asked, avalanche_limit=1, settings=settings)
        self.steps += run.steps
        if run.outcome is Outcome.TIME_LIMIT:
            self.loop.check_time()
        self.residual = max(self.residual, run.residual)
        fallen = next((one for one in run.avalanches if one.plastic), None)
        if fallen is None:
            held = math.inf if run.outcome is Outcome.FINISHED else math.nan
            found["yield_strain"][p, k] = found["yield_stress"][p, k] = held
            self.stalled |= run.outcome is not Outcome.FINISHED
            return
        found["yield_strain"][p, k] = fallen.strain - fallen.width
        found["yield_stress"][p, k] = (patch.shear_stress(fallen.before) - start) / unit
        found["energy_drop"][p, k] = fallen.energy_drop

    def finish(self, outcome: Outcome) -> LocalYield:
        """Return the run as far as it came."""
        seconds, whole = time.process_time() - self.began, self.found["yield_strain"].size
        figures: dict[str, Any] = {f"{name}_pk": value for name, value in self.found.items()}
        rested = int((~np.isnan(self.found["yield_strain"])).sum())
        stage = Stage("local yield", self.residual, self.steps, self.steps, seconds, f"{self.done} patches")
        return LocalYield(
            packing=self.scene.packing,
            outcome=outcome,
            unmet=unmet_conditions(outcome, Condition("patches and directions that came to rest", rested, whole, 0.0)),
            residual=self.residual,
            steps=self.steps,
            force_evaluations=self.steps,
            seconds=seconds,
            stages=(stage,),
            center_pd=self.center_pd,
            direction_k=self.direction_k,
            radius=self.radius,
            free_p=self.free_p,
            **figures,
        )
