"""`cementing_curve`: bulk and shear modulus against cemented contacts, over many packings and orders."""

from __future__ import annotations

import hashlib
import itertools
import os
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.check import function, instance, integer, one_of, positive
from packmech.effects import Repulsion
from packmech.generate import random_packing
from packmech.generate.random import Monodisperse, Sizes, sizes_of
from packmech.honors import CALLS
from packmech.jit.blas import single_thread
from packmech.loop.checkpoint import read_results, write_checkpoint
from packmech.mechanics.elasticity import Average, universal_anisotropy
from packmech.packing import Packing
from packmech.protocols.cement import (
    AVERAGES,
    FREEZE,
    MODULI,
    ORDERS,
    Cementing,
    backbone_of,
    cement_backbone,
    drawn_order,
    step_end,
)
from packmech.protocols.jam import jam
from packmech.result import NotConverged
from packmech.scene import Scene

KIND = "trials of cementing"
# jammed packings with other than one state of self stress are drawn again
_ATTEMPTS = 50
_START_FRACTION = 0.5

# what is kept; Hill averages and anisotropy follow from it
CURVES = ("bulk_reuss", "bulk_voigt", "shear_reuss", "shear_voigt", "poisson")


@dataclass(frozen=True)
class Settings:
    """What decides the numbers of one packing's trials."""

    particles: int
    packing: int
    seed: int
    step: float
    freeze: str
    pressure: float
    dimension: int
    sizes: Sizes
    order: str
    scene: Scene | None = field(default=None, compare=False)

    def table(self) -> dict[str, Any]:
        """Return the settings, to be compared with those of a file."""
        named = asdict(replace(self, sizes=Monodisperse(), scene=None)) | {"sizes": repr(self.sizes)}
        if self.order == "random":
            del named["order"]
        if self.scene is None:
            del named["scene"]
        else:
            named["scene"] = _fingerprint(self.scene)
        return named

    def draw(self, *more: int) -> int:
        """Return the seed of a part of these trials; the parts' seeds are independent of each other."""
        source = np.random.SeedSequence([self.seed, self.particles, self.packing, *more])
        return int(source.generate_state(1, dtype=np.uint64)[0] >> np.uint64(1))


def _fingerprint(scene: Scene) -> str:
    """Return what tells a scene's packing, links and laws from others'."""
    packing, found = scene.packing, hashlib.sha256()
    parts: list[NDArray[Any]] = [packing.position_nd, packing.radius_n, packing.box.lattice_dd]
    if packing.links is not None:
        assert packing.links.shape_l is not None
        parts += [packing.links.i_l, packing.links.j_l, packing.links.image_ld, packing.links.length_l]
        parts.append(packing.links.shape_l)
    for part in parts:
        found.update(np.ascontiguousarray(part).tobytes())
    return f"{found.hexdigest()} {scene.effects!r}"


@dataclass(frozen=True, eq=False)
class Trials:
    """Moduli of one packing along several orders of cementing.

    Attributes
    ----------
    packing
        The jammed packing.
    attempts
        Packings drawn until one jammed with one state of self stress; 0 for a packing of one's own.
    bearing
        Particles that bear force.
    cemented_k
        (K,) n_l at each step that all orders share.
    stiff_ok
        (orders, K) number of stiff directions; all of them after complete rigidity.
    curves
        (orders, K) arrays by name, as in `Cementing`.
    first_o, all_o
        (orders,) n_l at the first stiff direction, and at complete rigidity; -1 where it did not come.
    smallest_new_o, largest_old_o
        (orders,) as in `Cementing`.
    seconds
        CPU time of jamming and of all orders.

    """

    packing: Packing
    attempts: int
    bearing: int
    cemented_k: NDArray[np.int64]
    stiff_ok: NDArray[np.int64]
    curves: dict[str, NDArray[np.float64]]
    first_o: NDArray[np.int64]
    all_o: NDArray[np.int64]
    smallest_new_o: NDArray[np.float64]
    largest_old_o: NDArray[np.float64]
    seconds: float


def path_of(folder: Path, settings: Settings) -> Path:
    """Return the file of one packing's trials."""
    return folder / f"n{settings.particles:05d}-packing{settings.packing:03d}.npz"


def _start(settings: Settings) -> tuple[Packing, int]:
    """Return a jammed packing with one state of self stress, and how many were drawn."""
    for attempt in range(_ATTEMPTS):
        start = random_packing(
            settings.particles,
            dimension=settings.dimension,
            sizes=settings.sizes,
            packing_fraction=_START_FRACTION,
            seed=settings.draw(0, attempt),
        )
        run = jam(Scene(start, (Repulsion(),)), pressure=settings.pressure, strain="free", check=False)
        if run.ok and run.report["states_of_self_stress"] == 1:
            return run.packing, attempt + 1
    raise NotConverged(run)


def _row(cementing: Cementing, step: float) -> dict[str, NDArray[Any]]:
    """Return what is kept of one order; a last step that ran out of contacts is none that packings share."""
    cemented = cementing.cemented_k
    count = len(cemented)
    if count > 1 and step_end(count - 1, cemented[-2], step, cementing.packing.particles) != cemented[-1]:
        count -= 1
    curves = cementing.curves
    return {name: curves[name][:count] for name in CURVES} | {
        "cemented": cemented[:count],
        "stiff": cementing.stiff_k[:count],
        "first": np.array(-1 if cementing.first_stiff is None else cementing.first_stiff),
        "all": np.array(-1 if cementing.all_stiff is None else cementing.all_stiff),
        "parts": np.array([cementing.smallest_new, cementing.largest_old]),
        "seconds": np.array(cementing.seconds),
    }


def run_trials(
    settings: Settings, orders: int, folder: Path | None, progress: Callable[[int], None] | None = None
) -> Trials:
    """Return the trials of one packing; those that the folder holds are read, every new one is added to it.

    `progress` is called with the number of orders finished.
    """
    path = None if folder is None else path_of(folder, settings)
    kept: dict[str, NDArray[Any]] = {}
    scene = settings.scene
    with single_thread():
        if path is not None and path.exists():
            kept = read_results(path, KIND, settings.table())
            packing = Packing(kept["position"], kept["radius"], Box(kept["lattice"]))
        else:
            began = time.process_time()
            packing, attempts = _start(settings) if scene is None else (scene.packing, 0)
            kept = {
                "position": packing.position_nd,
                "radius": packing.radius_n,
                "lattice": packing.box.lattice_dd,
                "attempts": np.array(attempts),
                "jam_seconds": np.array(time.process_time() - began),
            }
        scene = Scene(packing, (Repulsion(),)) if scene is None else scene
        packing, backbone = scene.packing, None
        for order in range(orders):
            if f"cemented_{order}" not in kept:
                if backbone is None:
                    backbone = backbone_of(scene, "unstressed", None)
                    kept["bearing"] = np.array(backbone.bearing)
                rng = np.random.default_rng(settings.draw(1, order))
                sequence = drawn_order(settings.order, backbone, rng)
                row = _row(
                    cement_backbone(backbone, sequence, settings.step, settings.freeze, "unstressed"), settings.step
                )
                kept |= {f"{name}_{order}": value for name, value in row.items()}
                if path is not None:
                    write_checkpoint(path, KIND, settings.table(), kept)
            if progress is not None:
                progress(order + 1)
    return _gathered(packing, kept, orders)


def _gathered(packing: Packing, kept: dict[str, NDArray[Any]], orders: int) -> Trials:
    """Return the trials as tables: orders that ended earlier are rigid in every direction afterwards."""
    longest = max((kept[f"cemented_{order}"] for order in range(orders)), key=len)
    size, d = len(longest), packing.dimension
    stiff = np.full((orders, size), d * (d + 1) // 2)
    curves = {name: np.full((orders, size), np.nan if name == "poisson" else np.inf) for name in CURVES}
    for order in range(orders):
        steps = len(kept[f"cemented_{order}"])
        stiff[order, :steps] = kept[f"stiff_{order}"]
        for name, table in curves.items():
            table[order, :steps] = kept[f"{name}_{order}"]
    for modulus in MODULI:
        curves[f"{modulus}_hill"] = (curves[f"{modulus}_reuss"] + curves[f"{modulus}_voigt"]) / 2.0
    low, high = (
        [Average(*pair, d) for pair in zip(curves[f"bulk_{bound}"].flat, curves[f"shear_{bound}"].flat, strict=True)]
        for bound in ("reuss", "voigt")
    )
    between = [universal_anisotropy(*pair) for pair in zip(high, low, strict=True)]
    curves["anisotropy"] = np.array(between).reshape(orders, size)
    part = np.array([kept[f"parts_{order}"] for order in range(orders)])
    return Trials(
        packing=packing,
        attempts=int(kept["attempts"]),
        bearing=int(kept["bearing"]),
        cemented_k=longest,
        stiff_ok=stiff,
        curves=curves,
        first_o=np.array([int(kept[f"first_{order}"]) for order in range(orders)]),
        all_o=np.array([int(kept[f"all_{order}"]) for order in range(orders)]),
        smallest_new_o=part[:, 0],
        largest_old_o=part[:, 1],
        seconds=float(kept["jam_seconds"]) + sum(float(kept[f"seconds_{order}"]) for order in range(orders)),
    )


# called as (particles, packing, orders finished)
Progress = Callable[[int, int, int], None]
# bounds nearer than this, relative to their mean, weigh as if they were this far apart
_NARROWEST = 1e-6


@dataclass(frozen=True, eq=False)
class WeightedMean:
    """Weighted means over trials, with their standard errors.

    Attributes
    ----------
    mean_k, error_k
        (K,) weighted mean and weighted standard error; nan without trials, the error also with a single packing.
    trials_k
        (K,) trials with finite bounds, those that count.

    """

    mean_k: NDArray[np.float64]
    error_k: NDArray[np.float64]
    trials_k: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class CementingCurve:
    """Moduli against cemented contacts for packings of one size.

    Attributes
    ----------
    particles
        N.
    link_fraction_k
        (K,) n_l/N at each step [1].
    bulk, shear
        Weighted means [energy/length^d]. A trial's value is the mean of its Voigt and Reuss bounds and its weight
        12/(Voigt - Reuss)^2, the inverse variance of a value spread evenly between them; trials with an infinite bound
        have no weight and drop out. The standard error takes packings as independent, not orders of the same packing:
        error^2 = P/(P-1) sum over the P packings of (sum over orders of w (x - mean))^2 / (sum of w)^2.
    poisson_ratio, anisotropy
        Means with equal weights [1], over trials with finite bounds; `universal_anisotropy` of each trial's bounds.
    bound_means
        (K,) means with equal weights over the same trials by name: bulk_reuss, bulk_hill, bulk_voigt, shear_reuss,
        shear_hill, shear_voigt; nan where no trial is finite.
    some_stiff_k, all_stiff_k
        (K,) fraction of trials with an infinitely stiff direction, and with all of them [1].
    first_stiff_po, all_stiff_po
        (P, orders) n_l/N at the first infinitely stiff direction, and at complete rigidity [1]; nan where cementing
        ended before.
    trials
        The trials of each packing.

    """

    particles: int
    link_fraction_k: NDArray[np.float64]
    bulk: WeightedMean
    shear: WeightedMean
    poisson_ratio: WeightedMean
    anisotropy: WeightedMean
    bound_means: dict[str, NDArray[np.float64]]
    some_stiff_k: NDArray[np.float64]
    all_stiff_k: NDArray[np.float64]
    first_stiff_po: NDArray[np.float64]
    all_stiff_po: NDArray[np.float64]
    trials: tuple[Trials, ...]

    @property
    def seconds(self) -> float:
        """CPU time of all packings and orders, whenever they were run."""
        return sum(trial.seconds for trial in self.trials)


def weighted_mean(value_pok: NDArray[np.float64], weight_pok: NDArray[np.float64]) -> WeightedMean:
    """Return weighted means over packings and orders, packings independent; values of no weight may be anything.

    Examples
    --------
    >>> import numpy as np
    >>> found = weighted_mean(np.array([[[1.0], [1.0]], [[3.0], [3.0]]]), np.ones((2, 2, 1)))
    >>> found.mean_k.tolist(), found.error_k.tolist()
    ([2.0], [1.0])

    """
    value = np.where(weight_pok > 0.0, value_pok, 0.0)
    total = weight_pok.sum(axis=(0, 1))
    counted = (weight_pok > 0.0).any(axis=1).sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = (weight_pok * value).sum(axis=(0, 1)) / total
        off = (weight_pok * np.where(weight_pok > 0.0, value - mean, 0.0)).sum(axis=1)
        error = np.sqrt(counted / (counted - 1.0) * (off**2).sum(axis=0)) / total
    error[counted < 2] = np.nan
    return WeightedMean(mean, error, np.asarray((weight_pok > 0.0).sum(axis=(0, 1))))


def error_of_mean(value_po: NDArray[np.float64]) -> tuple[float, float]:
    """Return the mean of the finite values and its standard error, packings independent."""
    finite = np.isfinite(value_po)
    found = weighted_mean(value_po[..., None], finite[..., None].astype(float))
    return float(found.mean_k[0]), float(found.error_k[0])


def gathered(particles: int, trials: Sequence[Trials]) -> CementingCurve:
    """Return the curve of packings of one size from their trials."""
    longest = max((one.cemented_k for one in trials), key=len)
    size, d = len(longest), trials[0].packing.dimension

    def padded(table_ok: NDArray[Any], fill: float) -> NDArray[np.float64]:
        return np.pad(table_ok.astype(float), ((0, 0), (0, size - table_ok.shape[1])), constant_values=fill)

    stiff = np.array([padded(one.stiff_ok, d * (d + 1) // 2) for one in trials])
    names = [f"{modulus}_{average}" for modulus in MODULI for average in AVERAGES] + ["anisotropy"]
    curve = {name: np.array([padded(one.curves[name], np.inf) for one in trials]) for name in names}
    poisson = np.array([padded(one.curves["poisson"], np.nan) for one in trials])
    means, bounds = {}, {}
    for modulus in MODULI:
        low, high = curve[f"{modulus}_reuss"], curve[f"{modulus}_voigt"]
        finite = np.isfinite(high)
        middle = np.where(finite, curve[f"{modulus}_hill"], 1.0)
        width = np.where(finite, np.maximum(np.where(finite, high, 0.0) - low, _NARROWEST * middle), 1.0)
        means[modulus] = weighted_mean(middle, np.where(finite, 12.0 / width**2, 0.0))
        for average in AVERAGES:
            name = f"{modulus}_{average}"
            bounds[name] = weighted_mean(curve[name], finite.astype(float)).mean_k
    both = np.isfinite(curve["bulk_voigt"]) & np.isfinite(curve["shear_voigt"])
    first, whole = (
        np.array([np.where(one >= 0, one / particles, np.nan) for one in found])
        for found in ([one.first_o for one in trials], [one.all_o for one in trials])
    )
    return CementingCurve(
        particles=particles,
        link_fraction_k=longest / particles,
        bulk=means["bulk"],
        shear=means["shear"],
        poisson_ratio=weighted_mean(poisson, both.astype(float)),
        anisotropy=weighted_mean(curve["anisotropy"], both.astype(float)),
        bound_means=bounds,
        some_stiff_k=(stiff > 0).mean(axis=(0, 1)),
        all_stiff_k=(stiff == d * (d + 1) // 2).mean(axis=(0, 1)),
        first_stiff_po=first,
        all_stiff_po=whole,
        trials=tuple(trials),
    )


def _in_turn(tasks: list[Settings], orders: int, folder: Path | None, progress: Progress | None) -> Iterator[Trials]:
    for settings in tasks:

        def report(done: int, settings: Settings = settings) -> None:
            if progress is not None:
                progress(settings.particles, settings.packing, done)

        yield run_trials(settings, orders, folder, report)


def _at_once(
    tasks: list[Settings], orders: int, folder: Path | None, progress: Progress | None, processes: int
) -> list[Trials]:
    import multiprocessing
    from concurrent.futures import ProcessPoolExecutor, as_completed

    # large packings first, so that no process is left waiting for one of them
    first = sorted(tasks, key=lambda settings: -settings.particles)
    with ProcessPoolExecutor(processes, mp_context=multiprocessing.get_context("spawn")) as pool:
        waiting = {pool.submit(run_trials, settings, orders, folder): settings for settings in first}
        found = {}
        try:
            for one in as_completed(waiting):
                settings = waiting[one]
                found[settings] = one.result()
                if progress is not None:
                    progress(settings.particles, settings.packing, orders)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise
    return [found[settings] for settings in tasks]


def cementing_curve(
    folder: str | os.PathLike[str] | None = None,
    *,
    scenes: Sequence[Scene] | None = None,
    particles: Sequence[int] = (64, 128, 256),
    packings: int = 10,
    orders: int = 20,
    seed: int = 0,
    step: float = 0.05,
    freeze: str = "angles",
    order: str = "random",
    pressure: float = 1e-8,
    dimension: int = 3,
    sizes: Sizes | None = None,
    processes: int = 1,
    progress: Progress | None = None,
) -> tuple[CementingCurve, ...]:
    """Return bulk and shear modulus against the fraction of cemented contacts n_l/N, a curve for each N.

    Packings are jammed with all strains free (shear-stabilized), at a pressure near zero and with one state of self
    stress; others are drawn again. Each is cemented in several random orders up to complete rigidity (`cement`, moduli
    of the unstressed network in units of energy_scale/diameter^d). This is figure 5 of the polymer source, which had
    N = 64 to 2048, 25 packings and 50 orders.

    Parameters
    ----------
    folder
        Where results are kept: a file for each packing, rewritten after each order, so that interrupted work goes on
        where it was when called again, with the same numbers. More packings, orders or sizes may be asked for then.
        None keeps nothing.
    scenes
        Jammed packings of one's own with their laws, shear-stabilized, in place of those that are drawn: `particles`,
        `packings`, `pressure`, `dimension` and `sizes` are not used then. Those of one size make up a curve.
    particles
        Sizes N.
    packings, orders
        Packings of each size, and orders of cementing of each.
    seed
        Everything is drawn from it; each packing and order for itself, whatever else is asked for.
    step, freeze, order
        As in `cement`; the order is "random" or "aggregate".
    pressure
        Pressure of the jammed packings [energy_scale / diameter^d].
    dimension, sizes
        As in `random_packing`; `Monodisperse()` if not given.
    processes
        How many processes share the packings; the numbers are the same for any.
    progress
        Called as progress(particles, packing, orders_finished).

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, a packing of one's own does not resist every strain, or the folder holds
        results of other settings.
    NotConverged
        If 50 packings in a row do not jam with one state of self stress.

    Examples
    --------
    >>> import packmech as pm
    >>> (curve,) = pm.cementing_curve(particles=[16], packings=2, orders=2, dimension=2, sizes=pm.Bidisperse(ratio=1.4))
    >>> curve.first_stiff_po.shape, bool((curve.first_stiff_po <= curve.all_stiff_po).all())
    ((2, 2), True)

    """
    if isinstance(particles, str) or not isinstance(particles, Sequence | np.ndarray) or not len(particles):
        raise TypeError(f"particles must be a list of sizes, got {particles!r}")
    counts = [integer("particles", one, at_least=8) for one in particles]
    if len(set(counts)) != len(counts):
        raise ValueError(f"particles must name each size once, got {particles!r}")
    number = integer("packings", packings, at_least=1)
    orders = integer("orders", orders, at_least=1)
    processes = integer("processes", processes, at_least=1)
    dimension = integer("dimension", dimension, at_least=2, at_most=3)
    seed = integer("seed", seed, at_least=0)
    step, pressure = positive("step", step), positive("pressure", pressure)
    one_of("freeze", freeze, FREEZE)
    one_of("order", order, ORDERS)
    sizes = sizes_of(sizes, Monodisperse())
    if progress is not None:
        function("progress", progress)
    if folder is not None:
        if not isinstance(folder, str | os.PathLike):
            raise TypeError(f"folder must be a path or None, got {folder!r}")
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
    if scenes is None:
        tasks = [
            Settings(count, packing, seed, step, freeze, pressure, dimension, sizes, order)
            for count, packing in itertools.product(counts, range(number))
        ]
    else:
        tasks = _own_tasks(scenes, Settings(0, 0, seed, step, freeze, 0.0, dimension, sizes, order), folder)
    if processes == 1:
        found = list(_in_turn(tasks, orders, folder, progress))
    else:
        found = _at_once(tasks, orders, folder, progress, processes)
    sized: dict[int, list[Trials]] = {one.particles: [] for one in tasks}
    for settings, trials in zip(tasks, found, strict=True):
        sized[settings.particles].append(trials)
    return tuple(gathered(count, trials) for count, trials in sized.items())


def _own_tasks(scenes: Sequence[Scene], settings: Settings, folder: Path | None) -> list[Settings]:
    """Return the settings of one's own scenes, after a look at whether those that are new can be cemented."""
    if isinstance(scenes, str) or not isinstance(scenes, Sequence) or not len(scenes):
        raise TypeError(f"scenes must be a list of scenes, at least one, got {scenes!r:.60}")
    count: dict[int, int] = {}
    dimensions = set()
    tasks = []
    for k, scene in enumerate(scenes):
        instance(f"scenes[{k}]", scene, Scene)
        CALLS["cement"].check(f"scenes[{k}]", scene)
        n, d = scene.packing.position_nd.shape
        dimensions.add(d)
        task = replace(settings, particles=n, packing=count.get(n, 0), dimension=d, scene=scene)
        if folder is None or not path_of(folder, task).exists():
            try:
                backbone_of(scene, "unstressed", None)
            except ValueError as error:
                raise ValueError(f"scenes[{k}]: {error}") from error
        tasks.append(task)
        count[n] = count.get(n, 0) + 1
    if len(dimensions) > 1:
        raise ValueError(f"scenes must be of one dimension, got {sorted(dimensions)}")
    return tasks
