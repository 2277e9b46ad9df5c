"""`jamming_scaling`: how contacts, energy and moduli fall as packings are followed down to the jamming point."""

from __future__ import annotations

import math
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.check import instance, one_of, positive
from packmech.honors import declare
from packmech.loop.run_loop import Progress
from packmech.measure.counting import packing_fraction
from packmech.measure.stress import energy
from packmech.mechanics.elasticity import elastic_moduli
from packmech.protocols.jam import jam
from packmech.protocols.protocol import sequence
from packmech.protocols.sweep import sweep_pressure
from packmech.result import Run
from packmech.scene import Scene

PRESSURES = tuple(10.0 ** (-2.0 - 0.5 * k) for k in range(9))
# what is measured of each packing at each pressure, and its unit
COLUMNS = {
    "packing_fraction": "1",
    "energy_per_particle": "energy_scale",
    "excess_coordination": "1",
    "bulk_modulus": "energy_scale / diameter^d",
    "shear_modulus": "energy_scale / diameter^d",
    "modulus_ratio": "1",
    "rearrangements": "1",
    "residual": "1",
}
HONORED = declare("jamming_scaling", "repulsion links shapes", at_rest=True)
# below this pressure of 256 particles, times (256 / N)^2, a packing has a handful of contacts too many or none
_COUNTED, _OF = 1.5e-4, 256


class Exponent(NamedTuple):
    """quantity = prefactor * pressure**exponent; the error of the exponent is one standard deviation over packings."""

    exponent: float
    error: float
    prefactor: float


@dataclass(frozen=True, eq=False)
class JammingScaling:
    """Packings followed over pressure, and what was measured of each.

    Attributes
    ----------
    particles, dimension
        N and d.
    strain
        "isotropic" or "free".
    pressure_p
        (P,) pressures in the order in which they were visited [energy_scale / diameter^d].
    value_sp
        By name (see `COLUMNS`) an (S, P) array: one row a packing. The excess coordination is 2 / N' times the contacts
        beyond one state of self stress, N' particles without rattlers; the modulus ratio is shear over bulk modulus.
        Rearrangements are those on the way from the pressure before; nan: that packing did not come to rest.
    seconds
        CPU time.

    """

    particles: int
    dimension: int
    strain: str
    pressure_p: NDArray[np.float64]
    value_sp: Mapping[str, NDArray[np.float64]]
    seconds: float

    @property
    def packings(self) -> int:
        """Number of packings."""
        return len(self.value_sp["residual"])

    @property
    def counted_from(self) -> float:
        """Pressure from which contacts beyond isostaticity are enough to fit, 1.5e-4 (256 / N)^2: below, N shows."""
        return _COUNTED * (_OF / self.particles) ** 2

    def mean_p(self, name: str) -> NDArray[np.float64]:
        """Return the (P,) means over the packings."""
        return np.asarray(self._values(name).mean(axis=0))

    def error_p(self, name: str) -> NDArray[np.float64]:
        """Return the (P,) standard errors of these means; nan for a single packing."""
        value = self._values(name)
        if len(value) < 2:
            return np.full(value.shape[1], math.nan)
        return np.asarray(value.std(axis=0, ddof=1) / math.sqrt(len(value)))

    def fit(self, name: str, *, pressure_from: float | None = None) -> Exponent:
        """Return the power law of the means, by least squares in logarithms; leaving packings out gives its error.

        Parameters
        ----------
        name
            Of the quantity.
        pressure_from
            Smallest pressure that takes part; None: `counted_from`.

        Raises
        ------
        ValueError
            If the name is unknown, fewer than two pressures take part, or a mean there is not positive.

        """
        value = self._values(name)
        least = self.counted_from if pressure_from is None else positive("pressure_from", pressure_from)
        part = self.pressure_p >= least * (1.0 - 1e-12)
        if np.count_nonzero(part) < 2:
            raise ValueError(f"pressure_from must leave at least two pressures, got {least:g}")
        log_p = np.log(self.pressure_p[part])

        def line(rows: NDArray[np.float64]) -> tuple[float, float]:
            mean = rows.mean(axis=0)[part]
            if not (mean > 0.0).all():
                raise ValueError(f"{name} must be positive on average to be fitted, got {mean.min():g}")
            slope, offset = np.polyfit(log_p, np.log(mean), 1)
            return float(slope), float(offset)

        slope, offset = line(value)
        error = math.nan
        if len(value) > 1:
            left = np.array([line(np.delete(value, s, axis=0))[0] for s in range(len(value))])
            error = math.sqrt((len(value) - 1) * float(((left - left.mean()) ** 2).mean()))
        return Exponent(slope, error, math.exp(offset))

    def to_csv(self) -> str:
        """Return means and errors of every quantity, a line a pressure."""
        lines = ["pressure," + ",".join(f"{name},{name}_error" for name in COLUMNS)]
        columns = [(self.mean_p(name), self.error_p(name)) for name in COLUMNS]
        for k, pressure in enumerate(self.pressure_p.tolist()):
            cells = ",".join(f"{mean[k]:.9g},{error[k]:.3g}" for mean, error in columns)
            lines.append(f"{pressure:.9g},{cells}")
        return "\n".join(lines) + "\n"

    def _values(self, name: str) -> NDArray[np.float64]:
        one_of("name", name, tuple(COLUMNS))
        value = self.value_sp[name]
        rest = value[~np.isnan(self.value_sp["residual"]).any(axis=1)]
        if not len(rest):
            raise ValueError("packings must have come to rest at every pressure, got none that did")
        return rest


def jamming_scaling(
    scenes: Iterable[Scene],
    pressures: Iterable[float] = PRESSURES,
    *,
    strain: str = "free",
    time_limit: float | None = None,
    progress: Progress | None = None,
    check: bool = True,
) -> JammingScaling:
    """Return how packings change as they are followed from pressure to pressure towards the jamming point.

    Each scene is jammed at the first pressure and then followed along its contact network (`sweep_pressure`).

    Parameters
    ----------
    scenes
        Starts of one number of particles and of axes, such as random packings of many seeds.
    pressures
        In the order in which they are visited, from high to low as a rule [energy_scale / diameter^d].
    strain
        "free": strains relax. "isotropic": the box keeps its shape; many such packings are unstable to shear, and their
        shear moduli scatter around a small mean.
    time_limit
        CPU time for each packing [s].
    progress
        Called as progress(stage, figures); figures holds "done", the number of packings that are finished.
    check
        Raise NotConverged when a packing does not come to rest; otherwise it is nan and left out of means.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, or scenes differ in particles or axes.
    NotConverged
        If a packing does not come to rest and `check` is set.
    KeyboardInterrupt
        Passed on with `.scaling` set to what the finished packings give, None before the first.

    Examples
    --------
    >>> import packmech as pm
    >>> starts = [
    ...     pm.random_packing(64, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.87, seed=seed)
    ...     for seed in (1, 2)
    ... ]
    >>> found = pm.jamming_scaling([pm.Scene(start, (pm.Repulsion(),)) for start in starts], [1e-2, 4e-3])
    >>> found.packings, 0.2 < found.fit("excess_coordination").exponent < 0.9
    (2, True)

    """
    started = time.process_time()
    if isinstance(scenes, str | Scene) or not isinstance(scenes, Iterable):
        raise TypeError(f"scenes must be a sequence of scenes, got {scenes!r}")
    given = tuple(scenes)
    if not given:
        raise ValueError("scenes must hold at least one scene, got none")
    for k, scene in enumerate(given):
        instance(f"scenes[{k}]", scene, Scene)
        HONORED.check(f"scenes[{k}]", scene)
        if scene.packing.position_nd.shape != given[0].packing.position_nd.shape:
            raise ValueError(
                f"scenes[{k}] must have {given[0].packing.particles} particles in {given[0].packing.dimension} "
                f"dimensions like the first, got {scene.packing.particles} in {scene.packing.dimension}"
            )
    goals = sequence("pressures", pressures, "pressure")
    one_of("strain", strain, ("isotropic", "free"))
    rows: list[NDArray[np.float64]] = []

    def gathered() -> JammingScaling:
        table = np.stack(rows)
        values = MappingProxyType({name: table[:, :, k] for k, name in enumerate(COLUMNS)})
        first = given[0].packing
        seconds = time.process_time() - started
        return JammingScaling(first.particles, first.dimension, strain, goals, values, seconds)

    try:
        for scene in given:
            jammed = jam(
                scene, pressure=float(goals[0]), strain=strain, time_limit=time_limit, progress=progress, check=check
            )
            runs: tuple[Run, ...] = (jammed,)
            if jammed.outcome.ok and len(goals) > 1:
                runs += sweep_pressure(
                    scene.replace(packing=jammed.packing),
                    goals[1:].tolist(),
                    strain=strain,
                    time_limit=time_limit,
                    progress=progress,
                    check=check,
                )
            rows.append(np.full((len(goals), len(COLUMNS)), math.nan))
            if len(runs) == len(goals) and all(run.outcome.ok for run in runs):
                rows[-1][:] = [_measured(scene, run) for run in runs]
            if progress is not None:
                progress("scaling", {"done": len(rows)})
    except KeyboardInterrupt as stop:
        stop.scaling = gathered() if rows else None  # type: ignore[attr-defined]
        raise
    return gathered()


def _measured(scene: Scene, run: Run) -> list[float]:
    """Return the figures of one packing, in the order of `COLUMNS`."""
    here = scene.replace(packing=run.packing)
    moduli = elastic_moduli(here)
    backbone = run.report["particles"] - run.report["rattlers"]
    return [
        packing_fraction(run.packing),
        energy(here) / (scene.energy_scale * scene.packing.particles),
        2.0 * run.report["excess_contacts"] / backbone,
        moduli.bulk_modulus / scene.pressure_unit,
        moduli.shear_modulus / scene.pressure_unit,
        moduli.shear_modulus / moduli.bulk_modulus,
        run.report.get("rearrangements", 0),
        run.residual,
    ]
