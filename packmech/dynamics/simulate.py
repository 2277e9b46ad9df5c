"""Simulate: Newton's equations for the particles of a scene, in the box as it is, with rigid links or without."""

from __future__ import annotations

import json
import math
import os
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.calls.honors import honors
from packmech.calls.status import Progress
from packmech.check import MOST_STEPS, boolean, brief, check_steps, instance, integer, positive
from packmech.dynamics.deformation import OscillatoryStrain, SteadyStrain
from packmech.dynamics.integrators import Method, checked_method, choose_time_step, start_of_motion
from packmech.dynamics.simulation import KIND, Simulation, SimulationSettings, SimulationTask, saved_settings
from packmech.loop.checkpoint import check_scene, damage_refused, fingerprint, read_checkpoint, restore_from
from packmech.loop.run_loop import RunLoop, run_settings
from packmech.scene import Scene


@honors(
    "repulsion damping friction rolling bonds interactions gravity walls drag noise held links shapes breaking memory "
    "rough kinds moving mesh"
)
def simulate(
    scene: Scene,
    *,
    steps: int | None = None,
    duration: float | None = None,
    dt: float | None = None,
    method: Method | None = None,
    velocity_nd: ArrayLike | None = None,
    temperature: float | None = None,
    seed: int | None = None,
    spin_nk: ArrayLike | None = None,
    applied_strain: SteadyStrain | OscillatoryStrain | None = None,
    held_n: ArrayLike | None = None,
    threads: int = 1,
    ledger: bool = False,
    trace_every: int | None = None,
    trace_positions: bool = False,
    checkpoint: str | os.PathLike[str] | None = None,
    checkpoint_every: int | None = None,
    time_limit: float | None = None,
    progress: Progress = None,
    check: bool = True,
) -> Simulation:
    """Return the motion of the scene's particles through a given time, in the box as it is or as it is deformed.

    m dv/dt = forces of all effects, dashpots (`ContactDamping`) included, and of rigid links: lengths are restored in
    every step along the links at its start, velocities projected at its end (RATTLE). Without dashpots energy is
    conserved to the method's order and without drift; undamped tangential springs, of friction and bonds, lose less
    than (omega dt)^4 / 100 of their swing in a step.

    Parameters
    ----------
    scene
        The scene. Positions may leave the cell; they are not wrapped, nor are those returned.
    steps, duration
        Exactly one of them: number of steps, or the time to cover, in equal steps of at most dt.
    dt
        Time step. Unless given: the method's fraction of the shortest of sqrt(m / stiffness) and m / damping, with the
        least mass and the stiffest pair of equal particles, of rigid bodies of equal beads, at a relative overlap of 0
        or 0.1, whatever the motion is; of bonds that jump also of the time in which they are made and broken.
    method
        VelocityVerlet() unless given, or SemiImplicitEuler().
    velocity_nd
        (N, d) velocities at the start [length/time]; what would stretch links is left out. At rest unless given.
    temperature
        Start instead with random velocities of this temperature [energy]: kinetic energy temperature / 2 for each
        independent motion that links and a resting center of mass leave. Needs a seed.
    seed
        Seed of the velocities.
    spin_nk
        (N, 1) spins at the start in a plane, (N, 3) in space [1/time], where particles turn (friction, bonds, shapes).
        Those of spheroids and rigid bodies are angular velocities, about their own axes too.
    applied_strain
        How the box deforms: SteadyStrain(rate) or OscillatoryStrain(amplitude, frequency). Velocities are then peculiar
        ones, v - L x: what follows the box has none.
    held_n
        (N,) True for particles that nothing pushes or turns; they follow the box.
    threads
        Number of threads; it changes no bit and pays from some thousand particles on. Time limits and `seconds` count
        the time of all of them.
    ledger
        Account for the energy: `run.ledger` says how much work went in, what is stored and where the rest was
        dissipated, every `trace_every` steps or some two hundred times. It changes no bit; a step takes two
        and a half to four times as long. Not with rigid links, nor with thermal noise in a box that deforms.
    trace_every
        Keep figures every so many steps, in `trace`; the first and last step always.
    trace_positions
        Keep positions and velocities with them.
    checkpoint
        A .npz file to which the full state goes, whole or not at all: at the end, at an interrupt (Ctrl-C, SIGTERM,
        time_limit) and now and then on the way. `pm.resume` goes on from it with the same bits; writing it changes
        none. One that cannot be written on the way is a warning; at the end an OSError whose `.run` is the run.
    checkpoint_every
        Write it every so many steps too, whatever the clock says.
    time_limit
        Stop after so much CPU time, compiling aside [s], with Outcome.TIME_LIMIT.
    progress
        Called now and then as progress(stage, figures), figures a dict with "steps", "time" and "energy".
    check
        Raise NotConverged when the run did not get to its end; otherwise return what it came to all the same.

    Returns
    -------
    Simulation
        Outcome.FINISHED; Outcome.STEP_TOO_LONG, and the last good state, where links were lost, something moved by
        the smallest diameter in one step, or energy grew by more than work, kinetic and potential energy explain (in a
        box that deforms, as far as the observed stresses give its work). Outcome.WALLS_MET where walls that move met,
        Outcome.TOO_MANY_TOUCHES where a sphere touched a rough surface at too many places.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind or out of its bounds.
    NotConverged
        If the end was not reached and `check` is set; its `.run` holds what was.
    KeyboardInterrupt
        Passed on, and raised at SIGTERM, with `.run` set to what was reached.

    Examples
    --------
    >>> import numpy as np
    >>> import packmech as pm
    >>> link = pm.Links([0], [1], [[0, 0]], [1.0])
    >>> dimer = pm.Packing([[1.0, 2.0], [2.0, 2.0]], [0.5, 0.5], pm.Box.cubic(4.0, 2), link, [1.0, 1.0])
    >>> turning = [[0.0, -0.5], [0.0, 0.5]]
    >>> run = pm.simulate(pm.Scene(dimer, (pm.Repulsion(),)), duration=2 * np.pi, velocity_nd=turning)
    >>> run.outcome.name, run.tension_l.round(12).tolist(), run.energy_drift < 1e-14
    ('FINISHED', [0.5], True)

    """
    motion = Asked(steps, duration, dt, method, velocity_nd, temperature, seed, spin_nk, applied_strain, held_n)
    settings, velocity, spin = _settings(
        scene, motion._replace(trace_every=trace_every, trace_positions=trace_positions, ledger=ledger)
    )
    limits = run_settings(
        time_limit=time_limit,
        checkpoint=checkpoint,
        checkpoint_every=checkpoint_every,
        threads=threads,
        progress=progress,
        check=check,
    )
    task = SimulationTask(settings, RunLoop(limits), spin)

    def begin() -> None:
        start = velocity
        if temperature is not None:
            start = task.engine.thermal_velocities(temperature, np.random.default_rng(seed))
        task.begin(start)

    return task.run(begin)


@honors(
    "repulsion damping friction rolling bonds interactions gravity walls drag noise held links shapes breaking memory "
    "rough kinds moving mesh"
)
def resume(
    path: str | os.PathLike[str],
    scene: Scene,
    *,
    steps: int | None = None,
    threads: int = 1,
    time_limit: float | None = None,
    progress: Progress = None,
    check: bool = True,
) -> Simulation:
    """Return a simulation that goes on from its checkpoint, with the bits of one that was never stopped.

    Everything but the scene is in the file: time step, method, applied strain, held particles, what is kept on the way,
    and all that was kept so far. Checkpoints go on being written to it.

    Parameters
    ----------
    path
        The file that `pm.simulate(..., checkpoint=path)` wrote.
    scene
        The scene that was simulated; laws and effects may be a user's own, so it is not in the file, but hashes of its
        packing and effects are.
    steps
        Step at which to end, counted from the start of the simulation. The end that was asked for then, unless given;
        a simulation that got there can be taken to a later one.
    threads, time_limit, progress, check
        As in `pm.simulate`; the CPU time starts from zero.

    Raises
    ------
    FileNotFoundError, TypeError, ValueError
        If there is no such checkpoint, the scene is another one, or the end lies before what is in the file.
    NotConverged, KeyboardInterrupt
        As in `pm.simulate`.

    Examples
    --------
    >>> import pathlib, tempfile, packmech as pm
    >>> path = pathlib.Path(tempfile.mkdtemp()) / "run.ckpt.npz"
    >>> pair = pm.Packing([[1.0, 2.0], [1.9, 2.0]], [0.5, 0.5], pm.Box.cubic(4.0, 2))
    >>> scene = pm.Scene(pair, (pm.Repulsion(),))
    >>> half = pm.simulate(scene, steps=50, dt=0.05, checkpoint=path)
    >>> whole = pm.simulate(scene, steps=100, dt=0.05)
    >>> pm.resume(path, scene, steps=100).packing == whole.packing
    True

    """
    found = read_checkpoint(path, KIND)
    instance("scene", scene, Scene)
    with damage_refused("path", path):
        fingerprints = dict(found.settings["scene"])
    check_scene(scene, fingerprints)
    with damage_refused("path", path):
        settings = saved_settings(found, scene)
        reached = integer("reached", found.settings["reached"], at_least=0, at_most=settings.steps)
        every = found.settings["checkpoint_every"]
        if every is not None:
            integer("checkpoint_every", every, at_least=1)
    limits = run_settings(
        time_limit=time_limit,
        checkpoint=path,
        checkpoint_every=every,
        threads=threads,
        progress=progress,
        check=check,
    )
    if steps is not None:
        settings = replace(settings, steps=integer("steps", steps, at_least=reached, at_most=int(MOST_STEPS)))
    task = SimulationTask(settings, RunLoop(limits))
    return task.run(lambda: restore_from(found.arrays, task, "path", path))


class Asked(NamedTuple):
    """The arguments of `simulate` that say which motion it is, unchecked."""

    steps: Any = None
    duration: Any = None
    dt: Any = None
    method: Any = None
    velocity_nd: Any = None
    temperature: Any = None
    seed: Any = None
    spin_nk: Any = None
    applied_strain: Any = None
    held_n: Any = None
    trace_every: Any = None
    trace_positions: Any = False
    ledger: Any = False


def _settings(scene: Any, asked: Asked) -> tuple[SimulationSettings, NDArray[np.float64], NDArray[np.float64] | None]:
    """Return the settings, velocities and spins that the arguments of `simulate` say, after checking them."""
    instance("scene", scene, Scene)
    method, strain = checked_method(asked.method), asked.applied_strain
    velocity, spin, held = start_of_motion(scene.packing, asked.velocity_nd, asked.spin_nk, asked.held_n)
    longest = choose_time_step(scene, method.fraction) if asked.dt is None else positive("dt", asked.dt)
    count, step = _steps(asked.steps, asked.duration, longest)
    if asked.seed is not None:
        integer("seed", asked.seed, at_least=0)
    if asked.temperature is not None:
        _check_temperature(asked.temperature, asked.velocity_nd, asked.seed)
    boolean("trace_positions", asked.trace_positions)
    boolean("ledger", asked.ledger)
    if strain is not None and not isinstance(strain, SteadyStrain | OscillatoryStrain):
        raise TypeError(
            f"applied_strain must be SteadyStrain(...), OscillatoryStrain(...) or None, got {brief(strain)}"
        )
    settings = SimulationSettings(
        scene,
        step,
        count,
        method,
        strain,
        held,
        None if asked.trace_every is None else integer("trace_every", asked.trace_every, at_least=1),
        asked.trace_positions,
        fingerprint((velocity, spin, held, asked.temperature, asked.seed)),
        asked.ledger,
    )
    return settings, velocity, spin


def simulate_from(path: Path, scene: Scene, *, progress: Progress, check: bool, **given: Any) -> Simulation:
    """Return what `simulate` with this checkpoint does, going on from the file where it is there already.

    Parameters
    ----------
    path, scene, progress, check
        The checkpoint, and arguments of `simulate`.
    given
        The others.

    Raises
    ------
    ValueError
        If the file is of another scene or of other settings.

    """
    if not path.exists():
        return simulate(scene, checkpoint=path, progress=progress, check=check, **given)
    asked = json.loads(json.dumps(_settings(scene, Asked(**given))[0].to_table()))
    kept = read_checkpoint(path, KIND, argument="checkpoint").settings
    # a run may be taken to a later end, and another scene is refused by name
    others = [name for name in asked if name not in ("steps", "scene") and kept.get(name) != asked[name]]
    if others:
        raise ValueError(
            f"checkpoint must hold a run of the same scene and settings, or be no file yet, got {str(path)!r} with "
            f"another {', another '.join(others)}; without that file the work begins from the start"
        )
    return resume(path, scene, steps=asked["steps"], progress=progress, check=check)


def _check_temperature(temperature: Any, velocity_nd: Any, seed: Any) -> None:
    positive("temperature", temperature)
    if velocity_nd is not None:
        raise ValueError(f"temperature must be left out where velocity_nd is given, got {temperature:g}")
    if seed is None:
        raise ValueError("seed must be an integer where a temperature is given, got None")


def _steps(steps: Any, duration: Any, longest: float) -> tuple[int, float]:
    """Return the number of steps and their length."""
    if steps is not None:
        count = integer("steps", steps, at_least=1, at_most=int(MOST_STEPS))
        if duration is not None:
            raise ValueError(f"duration must be left out where steps are given, got {brief(duration)}")
        return count, longest
    if duration is None:
        raise ValueError("steps must be an integer at least 1 (or give duration), got None")
    whole = positive("duration", duration)
    check_steps("duration", whole, longest)
    # a duration of whole steps does not get one more by rounding
    count = max(1, math.ceil(whole / longest * (1.0 - 1e-12)))
    return count, whole / count
