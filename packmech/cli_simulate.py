"""What `packmech run` does with a scene that is to be followed through time: print stress, energy and momentum."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from packmech.cli_show import working
from packmech.cli_watch import finish_run, live_watch, moments_wanted, telling
from packmech.dynamics.march.journey import needs_march
from packmech.dynamics.motion import choose_time_step
from packmech.interrupts import safe_interrupts
from packmech.measure import packing_fraction
from packmech.motion_drive import SimulateDrive
from packmech.report_table import Row
from packmech.scene import Scene

if TYPE_CHECKING:
    from packmech.cli_run import Outputs
    from packmech.dynamics.simulation import MotionTrace, Simulation

# moments of the trace that is plotted
_MOMENTS = 200


def simulate_scene(name: str, scene: Scene, outputs: Outputs) -> int:
    """Follow the scene through time as its drive says; return the exit code."""
    from packmech.cli_run import interrupted

    wanted = moments_wanted(outputs)
    if outputs.record is not None and not _recorded(scene):
        raise ValueError(
            "record must be left out for a scene without friction, bonds, body forces and held particles, "
            f"got {str(outputs.record)!r}"
        )
    count = scene.packing.particles
    about = f"{name}: {count} particle{'' if count == 1 else 's'}"
    try:
        with safe_interrupts(), working(about) as tell, live_watch(scene, outputs) as live:
            run = follow(scene, moments=wanted, watch=telling(tell, live))
    except KeyboardInterrupt as stop:
        return interrupted(scene, getattr(stop, "run", None), outputs)
    numbers = _numbers(scene, run)
    title = f"{about} through a time of {numbers['time']:.6g}"
    return finish_run(name, title, _rows(numbers), numbers, run, scene, outputs)


def follow(scene: Scene, *, moments: int = 0, watch: Any = None, **changes: Any) -> Simulation:
    """Return the simulation that the scene's drive describes.

    Parameters
    ----------
    scene
        A scene with a SimulateDrive.
    moments
        Positions are kept about so many times; 0: only figures are.
    watch
        Told of progress, as by `pm.simulate`.
    changes
        Other arguments of `pm.simulate` than the drive's.

    """
    from packmech.cli_shear import masses
    from packmech.dynamics.simulate import simulate
    from packmech.dynamics.verlet import VelocityVerlet

    drive = scene.drive
    assert isinstance(drive, SimulateDrive)
    n = scene.packing.particles
    mass = masses(scene, drive.density) if drive.masses is None else np.array(drive.masses)
    held = None
    if drive.held:
        if max(drive.held) >= n:
            raise ValueError(f"drive.held must be numbers of {n} particles, got {max(drive.held)}")
        held = np.isin(np.arange(n), drive.held)
    steps = drive.steps
    if steps is None:
        fraction = (VelocityVerlet() if drive.method is None else drive.method).fraction
        weight = (scene.packing.diameter_n / scene.packing.reference_diameter) ** scene.packing.dimension
        longest = choose_time_step(scene, weight if mass is None else mass, fraction) if drive.dt is None else drive.dt
        assert drive.duration is not None
        steps = int(np.ceil(drive.duration / longest))
    arguments: dict[str, Any] = {
        **({"steps": drive.steps} if drive.duration is None else {"duration": drive.duration}),
        "dt": drive.dt,
        "method": drive.method,
        "velocity_nd": None if drive.velocities is None else np.array(drive.velocities),
        "spin_nk": None if drive.spins is None else np.array(drive.spins),
        "mass_n": mass,
        "held_n": held,
        "trace_every": max(1, steps // (moments or _MOMENTS)),
        "trace_positions": moments > 0,
        "progress": watch,
        "check": False,
    }
    return simulate(scene, **(arguments | changes))


def _recorded(scene: Scene) -> bool:
    assert isinstance(scene.drive, SimulateDrive)
    return needs_march(scene, None) or bool(scene.drive.held)


def stresses(trace: MotionTrace) -> dict[str, NDArray[np.float64]]:
    """Return the (T, d, d) tensors of a trace by name, Cauchy, tension positive; parts that nothing has are zero."""
    none = np.zeros_like(trace.stress_tdd)
    parts = {"torque": trace.torque_stress_tdd, "spin": trace.spin_stress_tdd, "bond": trace.bond_stress_tdd}
    return {
        "overall": trace.overall_stress_tdd,
        "contact": trace.stress_tdd,
        **{name: none if part is None else part for name, part in parts.items()},
        "kinetic": trace.kinetic_stress_tdd,
    }


def _numbers(scene: Scene, run: Simulation) -> dict[str, Any]:
    """Return the results by name; stresses in the scene's own units of energy/length^d, tension positive."""
    trace: Any = run.trace
    return {
        "particles": scene.packing.particles,
        "dimension": scene.packing.dimension,
        "packing_fraction": packing_fraction(scene.packing),
        "outcome": run.outcome.name.lower(),
        "time": float(trace.time_t[-1]),
        "time_step": run.dt,
        "steps": run.steps,
        "seconds": run.seconds,
        "potential_energy": float(trace.energy_t[-1]),
        "kinetic_energy": float(trace.kinetic_t[-1]),
        "energy_drift": run.energy_drift,
        "momentum": trace.momentum_td[-1].tolist(),
        "momentum_error": run.momentum_error,
        "contacts": int(trace.contacts_t[-1]),
        "sliding": int(trace.sliding_t[-1]),
        "stress": {name: tensor[-1].tolist() for name, tensor in stresses(trace).items()},
    }


_TENSORS = {
    "overall": "forces, torques and spins together; tension positive",
    "contact": "forces of contacts and bonds times branch vectors",
    "torque": "what torques add",
    "spin": "what rotation stretches particles by",
    "kinetic": "of the velocities; in no other",
}


def _rows(numbers: Mapping[str, Any]) -> list[Row]:
    unit = f"energy / length^{numbers['dimension']} of the scene"
    rows: list[Row] = []
    for name, note in _TENSORS.items():
        lines = ["  ".join(f"{entry + 0.0:12.5g}" for entry in row) for row in numbers["stress"][name]]
        for k, line in enumerate(lines):
            rows.append((f"{name} stress" if k == 0 else "", line, note if k == 0 else unit if k == 1 else ""))
    energy = f"{numbers['potential_energy']:.6g} + {numbers['kinetic_energy']:.6g}"
    momentum = "  ".join(f"{entry:.6g}" for entry in numbers["momentum"])
    rows += [
        ("energy", energy, f"potential + kinetic; changed by {numbers['energy_drift']:.2g} of itself"),
        ("momentum", momentum, f"changed by {numbers['momentum_error']:.1e} of the sum of m |v|"),
        ("contacts", str(numbers["contacts"]), f"{numbers['sliding']} of them slide; bonds are not among them"),
        ("packing fraction", f"{numbers['packing_fraction']:.8f}", "overlaps counted in full"),
    ]
    return rows
