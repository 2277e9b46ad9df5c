"""Trials of a series under oscillatory shear: one file each, so that interrupted work goes on where it was."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import os
import zipfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.dynamics.bond_contacts import bond_contacts
from packmech.dynamics.rheology.oscillatory import OscillatoryShear
from packmech.effects import Bonds, Friction
from packmech.scene import Scene

_FORMAT = 1
CONTROLS = ("prepared", "bulk", "uncrosslinked", "frictionless")


@dataclass(frozen=True)
class Settings:
    """What decides the numbers of one trial, beside the scene."""

    control: str
    friction: float | None
    repeat: int
    amplitude: float
    frequency: float | None
    relative_frequency: float | None
    pre_periods: float
    periods: float
    post_periods: float
    axes: tuple[int, int]
    dt: float | None
    samples_per_period: int

    def text(self, print_of_scene: str) -> str:
        """Return the settings and the fingerprint of the scene as JSON, to be compared with those of a file."""
        return json.dumps({**asdict(self), "scene": print_of_scene, "format": _FORMAT}, sort_keys=True)

    def path(self, folder: Path) -> Path:
        """Return the file of the trial."""
        friction = "" if self.friction is None else f"-friction{self.friction:g}"
        return folder / f"{self.control}{friction}-amplitude{self.amplitude:g}-repeat{self.repeat:03d}.npz"


@dataclass(frozen=True, eq=False)
class ShearTrial:
    """One trial: moduli, and the stress against time.

    Attributes
    ----------
    storage, loss
        G' and G'' of the overall stress [energy/length^d].
    storage_error, loss_error
        Their errors over periods.
    time_t, strain_t, stress_tdd
        (T,) times, strains and (T, d, d) overall stresses.
    contacts_t, sliding_t
        (T,) numbers of contacts, and of those that slide.
    seconds
        CPU time.

    """

    storage: float
    loss: float
    storage_error: float
    loss_error: float
    time_t: NDArray[np.float64]
    strain_t: NDArray[np.float64]
    stress_tdd: NDArray[np.float64]
    contacts_t: NDArray[np.int64]
    sliding_t: NDArray[np.int64]
    seconds: float


def fingerprint(scene: Scene) -> str:
    """Return a text that changes with any bit of the scene's packing or effects."""
    packing = scene.packing
    digest = hashlib.sha256()
    for array in (packing.position_nd, packing.radius_n, packing.box.lattice_dd):
        digest.update(np.ascontiguousarray(array).tobytes())
    for one in scene.effects:
        if isinstance(one, Bonds):
            values = [getattr(one, field.name) for field in dataclasses.fields(one)]
            digest.update(b"".join(v.tobytes() if isinstance(v, np.ndarray) else repr(v).encode() for v in values))
        else:
            digest.update(repr(one).encode())
    return digest.hexdigest()[:16]


def controlled(scene: Scene, control: str, friction: float | None) -> Scene:
    """Return the scene with other bonds or other friction.

    "prepared": as it is. "bulk": every contact a bond, of the kind that the scene has. "uncrosslinked": no bonds.
    "frictionless": contacts without friction. A friction coefficient replaces that of the scene.

    Raises
    ------
    ValueError
        If the scene lacks what the control changes.

    """
    effects = scene.effects
    bonds = next((one for one in effects if isinstance(one, Bonds)), None)
    if control in ("bulk", "uncrosslinked") and bonds is None:
        raise ValueError(f"controls must not hold {control!r} where prepare(seed) returns a scene without Bonds")
    if friction is not None:
        if not any(isinstance(one, Friction) for one in effects):
            raise ValueError("frictions must be None where prepare(seed) returns a scene without Friction")
        effects = tuple(one._replace(coefficient=friction) if isinstance(one, Friction) else one for one in effects)
    if control == "bulk":
        assert bonds is not None
        whole = bond_contacts(
            scene.packing,
            compression=bonds.compression,
            tension=bonds.tension,
            tangential_stiffness=bonds.tangential_stiffness,
            damping=bonds.damping,
            tangential_damping=bonds.tangential_damping,
        )
        effects = tuple(whole if isinstance(one, Bonds) else one for one in effects)
    elif control == "uncrosslinked":
        effects = tuple(one for one in effects if not isinstance(one, Bonds))
    elif control == "frictionless":
        effects = tuple(one for one in effects if not isinstance(one, Friction))
    return scene.replace(effects=effects)


def trial_of(run: OscillatoryShear) -> ShearTrial:
    """Return what is kept of a run."""
    assert run.moduli is not None
    return ShearTrial(
        run.moduli.storage,
        run.moduli.loss,
        run.moduli.storage_error,
        run.moduli.loss_error,
        run.time_t,
        run.strain_t,
        run.stress["overall"],
        run.contacts_t,
        run.sliding_t,
        run.seconds,
    )


def read_trial(path: Path, text: str) -> ShearTrial:
    """Return a trial that was kept.

    Raises
    ------
    ValueError
        If the file cannot be read, or holds a trial of other settings.

    """
    names = [field.name for field in dataclasses.fields(ShearTrial)]
    try:
        with np.load(path, allow_pickle=False) as file:
            kept: dict[str, Any] = {name: file[name] for name in names}
            found = str(file["settings"])
    except (OSError, KeyError, ValueError, zipfile.BadZipFile) as reason:
        raise ValueError(f"folder must hold trials that can be read, got {path}: {reason}") from reason
    if found != text:
        raise ValueError(
            f"folder must hold trials of the same settings and scenes, or none, got {path} with {found} where {text} "
            "is asked for"
        )
    fields: dict[str, Any] = {name: value if value.ndim else float(value) for name, value in kept.items()}
    return ShearTrial(**fields)


def write_trial(path: Path, text: str, trial: ShearTrial) -> None:
    """Write the file and put it in its place at once."""
    draft = path.with_suffix(f".{os.getpid()}.part")
    kept = {field.name: np.asarray(getattr(trial, field.name)) for field in dataclasses.fields(trial)}
    try:
        with draft.open("wb") as file:
            np.savez_compressed(file, allow_pickle=False, settings=np.array(text), **kept)
        os.replace(draft, path)
    finally:
        draft.unlink(missing_ok=True)
