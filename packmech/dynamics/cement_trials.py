"""Trials of cementing: one jammed packing, many orders, kept in a file that grows with each order finished."""

from __future__ import annotations

import json
import os
import time
import zipfile
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.compiled import single_thread
from packmech.dynamics.cement import Cementing, cement_backbone, step_end
from packmech.dynamics.cement_compliance import backbone_of
from packmech.dynamics.jam import jam
from packmech.effects import Repulsion
from packmech.generate import random_packing
from packmech.generate.sizes import Monodisperse, Sizes
from packmech.mechanics.rigidity import TOUCHING
from packmech.outcome import NotConverged
from packmech.packing import Packing
from packmech.scene import Scene

_FORMAT = 1
# jammed packings with other than one state of self stress are drawn anew
_ATTEMPTS = 50
_START_FRACTION = 0.5

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

    def text(self) -> str:
        """Return the settings as JSON, to be compared with those of a file."""
        plain = asdict(replace(self, sizes=Monodisperse()))
        return json.dumps({**plain, "sizes": repr(self.sizes), "format": _FORMAT}, sort_keys=True)

    def draw(self, *more: int) -> int:
        """Return the seed of a part of these trials; the parts' seeds are independent of each other."""
        source = np.random.SeedSequence([self.seed, self.particles, self.packing, *more])
        return int(source.generate_state(1, dtype=np.uint64)[0] >> np.uint64(1))


@dataclass(frozen=True, eq=False)
class Trials:
    """Moduli of one packing along several orders of cementing.

    Attributes
    ----------
    packing
        The jammed packing.
    attempts
        Packings drawn until one jammed with one state of self stress.
    bearing
        Particles that bear force.
    cemented_k
        (K,) n_l at each step that all orders share.
    stiff_ok
        (orders, K) number of stiff directions; all of them after complete rigidity.
    curves
        (orders, K) arrays by name: bulk_reuss, bulk_voigt, shear_reuss, shear_voigt [energy/length^d], infinite where
        they are, and poisson [1].
    first_o, all_o
        (orders,) n_l at the first stiff direction, and at complete rigidity; -1 where it did not come.
    least_new_o, largest_old_o
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
    least_new_o: NDArray[np.float64]
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
    steps = range(count)
    low, high = [cementing.reuss(k) for k in steps], [cementing.voigt(k) for k in steps]
    return {
        "cemented": cemented[:count],
        "stiff": cementing.stiff_k[:count],
        "bulk_reuss": np.array([x.bulk_modulus for x in low]),
        "bulk_voigt": np.array([x.bulk_modulus for x in high]),
        "shear_reuss": np.array([x.shear_modulus for x in low]),
        "shear_voigt": np.array([x.shear_modulus for x in high]),
        "poisson": np.array([cementing.poisson_ratio(k) for k in steps]),
        "first": np.array(-1 if cementing.first_stiff is None else cementing.first_stiff),
        "all": np.array(-1 if cementing.all_stiff is None else cementing.all_stiff),
        "parts": np.array([cementing.least_new, cementing.largest_old]),
        "seconds": np.array(cementing.seconds),
    }


def _read(path: Path, settings: Settings) -> dict[str, NDArray[Any]]:
    try:
        with np.load(path, allow_pickle=False) as file:
            kept = {name: file[name] for name in file.files}
        text = str(kept["settings"])
    except (OSError, KeyError, ValueError, zipfile.BadZipFile) as reason:
        raise ValueError(f"folder must hold results of cementing that can be read, got {path}: {reason}") from reason
    if text != settings.text():
        raise ValueError(
            f"folder must hold results with the same settings, or none, got {path} with {text} where {settings.text()} "
            "is asked for"
        )
    return kept


def _write(path: Path, kept: dict[str, NDArray[Any]]) -> None:
    """Write the file anew and put it in the old one's place at once."""
    draft = path.with_suffix(f".{os.getpid()}.part")
    try:
        with draft.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, **kept)
        os.replace(draft, path)
    finally:
        draft.unlink(missing_ok=True)


def run_trials(
    settings: Settings, orders: int, folder: Path | None, progress: Callable[[int], None] | None = None
) -> Trials:
    """Return the trials of one packing; those that the folder holds are read, every new one is added to it.

    `progress` is called with the number of orders finished.
    """
    path = None if folder is None else path_of(folder, settings)
    kept: dict[str, NDArray[Any]] = {}
    with single_thread():
        if path is not None and path.exists():
            kept = _read(path, settings)
            packing = Packing(kept["position"], kept["radius"], Box(kept["lattice"]))
        else:
            began = time.process_time()
            packing, attempts = _start(settings)
            kept = {
                "settings": np.array(settings.text()),
                "position": packing.position_nd,
                "radius": packing.radius_n,
                "lattice": packing.box.lattice_dd,
                "attempts": np.array(attempts),
                "jam_seconds": np.array(time.process_time() - began),
            }
        backbone = None
        for order in range(orders):
            if f"cemented_{order}" not in kept:
                if backbone is None:
                    backbone = backbone_of(Scene(packing, (Repulsion(),)), "unstressed", TOUCHING)
                    kept["bearing"] = np.array(backbone.bearing)
                sequence = np.random.default_rng(settings.draw(1, order)).permutation(len(backbone.contacts))
                row = _row(
                    cement_backbone(backbone, sequence, settings.step, settings.freeze, "unstressed"), settings.step
                )
                kept |= {f"{name}_{order}": value for name, value in row.items()}
                if path is not None:
                    _write(path, kept)
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
        least_new_o=part[:, 0],
        largest_old_o=part[:, 1],
        seconds=float(kept["jam_seconds"]) + sum(float(kept[f"seconds_{order}"]) for order in range(orders)),
    )
