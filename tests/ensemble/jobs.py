"""Jobs of the tests: functions that other processes import from this file."""

import os
import pathlib
import sys
import time

import numpy as np

import packmech as pm


def square(seed, scale=1.0):
    """Return numbers that anybody can check."""
    return {"square": scale * seed**2, "half": seed / 2, "even": seed % 2 == 0, "word": f"number {seed}"}


def pressed(pressure, seed, particles):
    """Return what grows as the root of the pressure."""
    grown = pressure**0.5 * (1.0 + 0.01 * seed)
    return {"shear_modulus": grown, "bulk_modulus": grown}


def counted(seed, log, wait=0.0):
    """Return a number that takes some time, and leave a line for every time that it is finished."""
    rng = np.random.default_rng(seed)
    time.sleep(wait)
    value = float(rng.normal())
    with open(log, "a", encoding="utf-8") as file:
        file.write(f"{seed}\n")
    return {"value": value, "third": value / 3.0}


def packed(seed, particles=8):
    """Return a packing, an array and a number."""
    packing = pm.random_packing(particles, dimension=2, packing_fraction=0.5, seed=seed)
    return {"packing": packing, "radii": packing.radius_n, "fraction": pm.packing_fraction(packing)}


def drawn(seed, random_seed, folder):
    """Return what a job may ask for beside its parameters."""
    return {"drawn": random_seed, "own": pathlib.Path(folder).name}


def troubled(kind, seed=0):
    """Return nothing: raise, hang, take memory, or end the process."""
    if kind == "raises":
        raise ZeroDivisionError("the job divided by nothing")
    if kind == "hangs":
        while True:
            time.sleep(0.01)
    if kind == "eats":
        held = []
        for _ in range(30):
            held.append(np.ones(1 << 24))
            time.sleep(0.1)
    if kind == "dies":
        os.kill(os.getpid(), 9)
    if kind == "exits":
        sys.exit(3)
    if kind == "writes":
        return {"packing": pm.random_packing(4000, dimension=2, packing_fraction=0.5, seed=seed)}
    if kind == "unknown":
        return {"thing": object()}
    return {"value": float(seed)}


def stepping(seed, steps, folder):
    """Return a number after many short steps, kept in the member's folder, so that it goes on where it was."""
    kept = pathlib.Path(folder) / "steps"
    done = int(kept.read_text()) if kept.exists() else 0
    began = done
    try:
        while done < steps:
            time.sleep(0.05)
            done += 1
    except KeyboardInterrupt:
        kept.write_text(str(done))
        raise
    return {"steps": done, "began": began}


def quenched(seed, step_limit):
    """Return a run that is no success where it has few steps."""
    start = pm.random_packing(16, dimension=2, packing_fraction=1.0, seed=seed)
    return pm.quench(
        pm.Scene(start, (pm.Repulsion(),)), force_tolerance=1e-9, step_limit=step_limit, method=pm.Fire(), check=False
    )


def waits_for(seed, flag):
    """Return a number once a file is there, and raise before."""
    if not pathlib.Path(flag).exists():
        raise RuntimeError("not yet")
    return {"value": seed}


def nested(seed, folder):
    """Return the sum of what an ensemble of its own returns, which runs in the same process."""
    found = pm.run_ensemble(lambda x: x + seed, {"x": range(3)}, pathlib.Path(folder) / "own", workers=0)
    return {"total": int(found["value"].sum())}
