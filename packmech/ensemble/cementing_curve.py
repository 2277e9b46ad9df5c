"""`cementing_curve`: bulk and shear modulus against cemented contacts, over many packings and orders."""

from __future__ import annotations

import functools
import itertools
import json
import os
import time
import uuid
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.check import function, instance, integer, one_of, positive
from packmech.effects import Repulsion
from packmech.ensemble.callers import Finished, complete, folder_of, has_scene, keep_scene, scene_at, scene_path
from packmech.files.records import from_table, is_record, to_table
from packmech.generate import random_packing
from packmech.generate.random import Monodisperse, Sizes, sizes_of
from packmech.honors import CALLS
from packmech.loop.checkpoint import fingerprint
from packmech.mechanics.elasticity import Average, universal_anisotropy
from packmech.packing import Packing
from packmech.protocols.cement import (
    AVERAGES,
    FREEZE,
    MODULI,
    ORDERS,
    Backbone,
    backbone_of,
    cement_backbone,
    drawn_order,
    step_end,
)
from packmech.protocols.jam import jam
from packmech.result import NotConverged
from packmech.scene import Scene
from packmech.scenes.recipes import NESTED

# ensembles in the folder
PACKINGS, TRIALS = "packings", "trials"
# jammed packings with other than one state of self stress are drawn again
_ATTEMPTS = 50
_START_FRACTION = 0.5

# what is kept; Hill averages and anisotropy follow from it
CURVES = ("bulk_reuss", "bulk_voigt", "shear_reuss", "shear_voigt", "poisson")


def draw(seed: int, particles: int, packing: int, *more: int) -> int:
    """Return the seed of a part of a packing's trials; the parts' seeds are independent of each other."""
    source = np.random.SeedSequence([seed, particles, packing, *more])
    return int(source.generate_state(1, dtype=np.uint64)[0] >> np.uint64(1))


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


def jammed_packing(
    particles: int, packing: int, seed: int, pressure: float, dimension: int, sizes: str, own: Sizes | None = None
) -> dict[str, Any]:
    """Return a jammed packing with one state of self stress, how many were drawn, and the CPU time.

    `sizes` is a table in JSON; `own`, those of this process, need none.
    """
    began = time.process_time()
    for attempt in range(_ATTEMPTS):
        start = random_packing(
            particles,
            dimension=dimension,
            sizes=from_table(json.loads(sizes), "sizes", NESTED["sizes"]) if own is None else own,
            packing_fraction=_START_FRACTION,
            seed=draw(seed, particles, packing, 0, attempt),
        )
        run = jam(Scene(start, (Repulsion(),)), pressure=pressure, strain="free", check=False)
        if run.ok and run.report["states_of_self_stress"] == 1:
            return {"packing": run.packing, "attempts": attempt + 1, "cpu_seconds": time.process_time() - began}
    raise NotConverged(run)


@functools.lru_cache(maxsize=1)
def _backbone(path: Path) -> Backbone:
    """Return the backbone of a scene that is kept: orders of one packing follow each other."""
    return backbone_of(scene_at(path), "unstressed", None)


def cement_trial(
    folder: Path, scene: str, particles: int, packing: int, trial: int, seed: int, step: float, freeze: str, order: str
) -> dict[str, Any]:
    """Return what is kept of one order; a last step that ran out of contacts is none that packings share."""
    backbone = _backbone(scene_path(folder, scene))
    sequence = drawn_order(order, backbone, np.random.default_rng(draw(seed, particles, packing, 1, trial)))
    cementing = cement_backbone(backbone, sequence, step, freeze, "unstressed")
    cemented = cementing.cemented_k
    count = len(cemented)
    if count > 1 and step_end(count - 1, cemented[-2], step, particles) != cemented[-1]:
        count -= 1
    curves = cementing.curves
    return {name: curves[name][:count] for name in CURVES} | {
        "bearing": backbone.bearing,
        "cemented": cemented[:count],
        "stiff": cementing.stiff_k[:count],
        "first": -1 if cementing.first_stiff is None else cementing.first_stiff,
        "all": -1 if cementing.all_stiff is None else cementing.all_stiff,
        "smallest_new": cementing.smallest_new,
        "largest_old": cementing.largest_old,
        "cpu_seconds": cementing.seconds,
    }


def _gathered(packing: Packing, jammed: Mapping[str, Any], members: Sequence[Finished]) -> Trials:
    """Return the trials as tables: orders that ended earlier are rigid in every direction afterwards."""
    kept = [one.values | one.arrays() for one in members]
    longest = max((one["cemented"] for one in kept), key=len)
    orders, size, d = len(kept), len(longest), packing.dimension
    stiff = np.full((orders, size), d * (d + 1) // 2)
    curves = {name: np.full((orders, size), np.nan if name == "poisson" else np.inf) for name in CURVES}
    for order, one in enumerate(kept):
        steps = len(one["cemented"])
        stiff[order, :steps] = one["stiff"]
        for name, table in curves.items():
            table[order, :steps] = one[name]
    for modulus in MODULI:
        curves[f"{modulus}_hill"] = (curves[f"{modulus}_reuss"] + curves[f"{modulus}_voigt"]) / 2.0
    low, high = (
        [Average(*pair, d) for pair in zip(curves[f"bulk_{bound}"].flat, curves[f"shear_{bound}"].flat, strict=True)]
        for bound in ("reuss", "voigt")
    )
    between = [universal_anisotropy(*pair) for pair in zip(high, low, strict=True)]
    curves["anisotropy"] = np.array(between).reshape(orders, size)
    return Trials(
        packing=packing,
        attempts=jammed["attempts"],
        bearing=kept[0]["bearing"],
        cemented_k=longest,
        stiff_ok=stiff,
        curves=curves,
        first_o=np.array([one["first"] for one in kept]),
        all_o=np.array([one["all"] for one in kept]),
        smallest_new_o=np.array([one["smallest_new"] for one in kept]),
        largest_old_o=np.array([one["largest_old"] for one in kept]),
        seconds=jammed["cpu_seconds"] + sum(one["cpu_seconds"] for one in kept),
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
    workers: int | None = 0,
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
        Two ensembles (`pm.read_ensemble`): "packings" that were drawn, and "trials", one for each order of cementing
        of each, so that interrupted work goes on where it was when called again, with the same numbers. More packings,
        orders or sizes may be asked for then. None keeps nothing.
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
    workers
        How many processes share the work, as in `run_ensemble`; 0: none, it is done here. The numbers are the same for
        any. Sizes and laws of your own need 0.
    progress
        Called as progress(particles, packing, orders_finished).

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, or a packing of one's own does not resist every strain.
    NotConverged
        If 50 packings in a row do not jam with one state of self stress; a RuntimeError where other processes do it.
    KeyboardInterrupt
        Passed on; what is in the folder stays there.

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
    dimension = integer("dimension", dimension, at_least=2, at_most=3)
    seed = integer("seed", seed, at_least=0)
    step, pressure = positive("step", step), positive("pressure", pressure)
    one_of("freeze", freeze, FREEZE)
    one_of("order", order, ORDERS)
    sizes = sizes_of(sizes, Monodisperse())
    if progress is not None:
        function("progress", progress)
    asked: dict[str, Any] = {"seed": seed, "step": step, "freeze": freeze, "order": order}
    with folder_of(folder) as place:
        if scenes is None:
            drawn: dict[str, Any] = {"seed": seed, "pressure": pressure, "dimension": dimension}
            packs = [{"particles": n, "packing": k} for n, k in itertools.product(counts, range(number))]
            jammed = _jammed(place / PACKINGS, [one | drawn for one in packs], sizes, workers)
            given = [Scene(one.packing(), (Repulsion(),)) for one in jammed]
            about = [one.values for one in jammed]
        else:
            given = _own(scenes, place / TRIALS)
            seen: Counter[int] = Counter()
            packs = []
            for scene in given:
                n = scene.packing.particles
                packs.append({"particles": n, "packing": seen[n]})
                seen[n] += 1
            about = [{"attempts": 0, "cpu_seconds": 0.0}] * len(given)
        names = [keep_scene(place / TRIALS, scene) for scene in given]
        wanted = [
            {"scene": name, **pack, "trial": trial, **asked}
            for name, pack in zip(names, packs, strict=True)
            for trial in range(orders)
        ]
        finished: Counter[int] = Counter()

        def report(done: int, of: int, k: int, member: Finished) -> None:
            finished[k // orders] += 1
            if progress is not None:
                progress(packs[k // orders]["particles"], packs[k // orders]["packing"], finished[k // orders])

        members = complete(cement_trial, wanted, place / TRIALS, workers=workers, progress=report)
        sized: dict[int, list[Trials]] = {}
        for k, (scene, pack) in enumerate(zip(given, packs, strict=True)):
            trials = _gathered(scene.packing, about[k], members[k * orders : (k + 1) * orders])
            sized.setdefault(pack["particles"], []).append(trials)
    return tuple(gathered(count, trials) for count, trials in sized.items())


def _jammed(folder: Path, wanted: Sequence[dict[str, Any]], sizes: Sizes, workers: int | None) -> list[Finished]:
    """Return packings that are drawn."""
    shipped = is_record(sizes) and type(sizes) in NESTED["sizes"].values()
    if not shipped and workers != 0:
        raise ValueError(f"workers must be 0 for sizes of your own, got {workers!r} with {sizes!r}")
    text = json.dumps(to_table(sizes), sort_keys=True) if shipped else fingerprint(sizes)
    if not is_record(sizes):
        # nothing tells such an object from another: what it drew is never taken for what another draws
        text = uuid.uuid4().hex
    job: Callable[..., Any] = jammed_packing
    if not shipped:
        job = functools.update_wrapper(functools.partial(jammed_packing, own=sizes), jammed_packing)
    return complete(job, [one | {"sizes": text} for one in wanted], folder, workers=workers)


def _own(scenes: Any, folder: Path) -> list[Scene]:
    """Return scenes of one's own, after a look at whether those that are new can be cemented."""
    if isinstance(scenes, str) or not isinstance(scenes, Sequence) or not len(scenes):
        raise TypeError(f"scenes must be a list of scenes, at least one, got {scenes!r:.60}")
    for k, scene in enumerate(scenes):
        instance(f"scenes[{k}]", scene, Scene)
        CALLS["cement"].check(f"scenes[{k}]", scene)
        if not has_scene(folder, scene):
            try:
                backbone_of(scene, "unstressed", None)
            except ValueError as error:
                raise ValueError(f"scenes[{k}]: {error}") from error
    dimensions = {scene.packing.dimension for scene in scenes}
    if len(dimensions) > 1:
        raise ValueError(f"scenes must be of one dimension, got {sorted(dimensions)}")
    return list(scenes)
