"""What the drives that end at rest do: quench, jam, settle, shear-stabilize, cement, deform."""

from __future__ import annotations

from dataclasses import fields, replace
from typing import Any

import numpy as np

from packmech.calls.status import Progress
from packmech.minimize.minimizers import registered_minimizers
from packmech.minimize.quench import quench
from packmech.protocols.cement import AVERAGES, MODULI, cement
from packmech.protocols.deform import deform, deform_at_rate
from packmech.protocols.jam import jam
from packmech.protocols.method import registered_methods
from packmech.protocols.settle import settle
from packmech.protocols.shearing.shear_stabilize import shear_stabilize
from packmech.result import Run
from packmech.scene import (
    CementDrive,
    DeformDrive,
    DriveCode,
    JamDrive,
    QuenchDrive,
    Scene,
    SettleDrive,
    ShearStabilizeDrive,
)


def _quench(drive: QuenchDrive, scene: Scene, *, frames: int, progress: Progress) -> Run:
    return quench(
        scene,
        force_tolerance=drive.force_tolerance,
        method=drive.method,
        trace_every=max(10, scene.packing.particles // 10) if frames else None,
        trace_positions=frames > 0,
        progress=progress,
        check=False,
    )


def _jam(drive: JamDrive, scene: Scene, *, progress: Progress) -> Run:
    named = {field.name: getattr(drive, field.name) for field in fields(drive)}
    return jam(scene, **named, progress=progress, check=False)


def _shear_stabilize(drive: ShearStabilizeDrive, scene: Scene, *, progress: Progress) -> Run:
    if callable(progress):
        progress("start", {"steps": 0, "packing": scene.packing})
    return shear_stabilize(
        scene, pressure=drive.pressure, force_tolerance=drive.force_tolerance, progress=progress, check=False
    )


def _settle(drive: SettleDrive, scene: Scene, *, progress: Progress) -> Run:
    named = {field.name: getattr(drive, field.name) for field in fields(drive)}
    return settle(scene, **named, progress=progress, check=False)


def _cement(drive: CementDrive, scene: Scene, *, progress: Progress) -> Run:
    """Jam, then cement in several orders; their means at each step are in the report under "cementing".

    Reuss, Hill and Voigt averages, anisotropy and Poisson ratio end before the step at which a direction of strain has
    become infinitely stiff in some order.
    """
    run = jam(scene, pressure=drive.pressure, progress=progress, check=False)
    if not run.ok:
        return run
    start = scene.replace(packing=run.packing)
    orders = []
    for order in range(drive.orders):
        if callable(progress):
            progress("cementing", {"order": order + 1, "of": drive.orders})
        try:
            orders.append(cement(start, seed=drive.seed + order, step=drive.step, freeze=drive.freeze))
        except KeyboardInterrupt as stop:
            stop.run = run  # type: ignore[attr-defined]
            raise
    steps = min(sum(1 for stiff in one.stiff_k if stiff == 0) for one in orders)
    particles = scene.packing.particles
    means: dict[str, Any] = {
        "link_fraction": [float(x) for x in orders[0].link_fraction_k[:steps]],
        "states_of_self_stress": orders[0].self_stress,
        "first_stiff": [None if one.first_stiff is None else one.first_stiff / particles for one in orders],
        "all_stiff": [None if one.all_stiff is None else one.all_stiff / particles for one in orders],
        "freeze": drive.freeze,
        "seconds": sum(one.seconds for one in orders),
    }
    curves = [one.curves for one in orders]
    names = {f"{modulus}_{name}": f"{modulus}_modulus_{name}" for modulus in MODULI for name in AVERAGES}
    for name, called in (names | {"anisotropy": "anisotropy", "poisson": "poisson_ratio"}).items():
        means[called] = [float(np.mean([one[name][k] for one in curves])) for k in range(steps)]
    return replace(run, report={**run.report, "cementing": means})


def _deform(drive: DeformDrive, scene: Scene, *, progress: Progress) -> Run:
    """Jam the packing where a pressure is named, then deform it; the run holds the stages of both."""
    before = None
    if drive.pressure is not None:
        before = jam(scene, pressure=drive.pressure, progress=progress, check=False)
        if not before.ok:
            return before
        scene = scene.replace(packing=before.packing)
    given = {"strain": drive.strain or {}, "stress": drive.stress or {}}
    named = {name: getattr(drive, name) for name in ("rate", "steps", "answer", "stress_tolerance", "dt", "ledger")}
    asked = {**given, **{name: value for name, value in named.items() if value is not None}}
    call: Any = deform if drive.rate is None else deform_at_rate
    run: Run = call(scene, **asked, progress=progress, check=False)
    if before is None:
        return run
    spent = {name: getattr(before, name) + getattr(run, name) for name in ("seconds", "steps", "force_evaluations")}
    return replace(run, stages=(*before.stages, *run.stages), **spent)


QUENCH = DriveCode(_quench, {"method": registered_minimizers})
JAM = DriveCode(_jam, {"method": registered_methods, "minimizer": registered_minimizers})
SETTLE = DriveCode(_settle)
SHEAR_STABILIZE = DriveCode(_shear_stabilize)
CEMENT = DriveCode(_cement)
DEFORM = DriveCode(_deform)
