"""No checkpoint, whatever was done to it with a right checksum, ends the process: it goes on or is refused."""

import pathlib
import subprocess
import sys

import pytest

SCRIPT = """
import sys, warnings
import numpy as np
import packmech as pm
from packmech.loop.checkpoint import read_checkpoint, write_checkpoint

path, case = sys.argv[1], sys.argv[2]
warnings.simplefilter("ignore")
law = pm.LinearSpring()
dimension = 3 if case == "spheres" else 2
start = pm.random_packing(24, dimension=dimension, packing_fraction=0.95 if dimension == 2 else 0.7, seed=1)
effects = (pm.Repulsion(law=law), pm.ContactDamping(0.3), pm.Friction(0.5, 0.6, 0.2))
if case == "bonds":
    bonds = pm.bond_contacts(start, compression=law, tension=law, tangential_stiffness=0.5, damping=0.4)
    effects = (*effects, bonds.select(np.arange(len(bonds)) % 2 == 0))
scene = pm.Scene(start, effects)
given = {"rate": 0.1, "applied_strain": 0.4, "samples": 8, "frames": 3, "checkpoint": path, "check": False}

def stop(stage, figures):
    if figures["steps"] > 0.3 * figures["of"]:
        raise KeyboardInterrupt

import packmech.rheology.strain_run as strain_run
strain_run._CHUNK = 2000
try:
    pm.ramp_strain(scene, progress=stop, **given)
except KeyboardInterrupt:
    pass
settings, arrays = read_checkpoint(path, "strained runs")
rng = np.random.default_rng(0)
chosen = [name for name in arrays if arrays[name].dtype.kind in "if" and arrays[name].size]
went_on, refused = 0, 0
for turn in range(int(sys.argv[3])):
    name = chosen[turn % len(chosen)]
    edited = arrays[name].copy()
    place = rng.integers(edited.size)
    if edited.dtype.kind == "i":
        value = [-1, edited.max() + 1, 10**6, 2**31, -2**40, 2**62, 0][rng.integers(7)]
    else:
        value = [np.nan, np.inf, -1e300, 1e300, 1e9, -1.0, 0.0][rng.integers(7)]
    kind = rng.integers(4)
    if kind == 0 and edited.ndim:
        edited = edited[: rng.integers(len(edited))]
    elif kind == 1 and edited.ndim:
        edited = np.concatenate([edited, edited])
    else:
        edited.reshape(-1)[place] = value
    print(turn, name, "edited", flush=True)
    write_checkpoint(path_of := __import__("pathlib").Path(path), "strained runs", settings, {**arrays, name: edited})
    try:
        pm.ramp_strain(scene, **given)
        went_on += 1
    except ValueError as refusal:
        assert "checkpoint must" in str(refusal), refusal
        refused += 1
print("done", went_on, refused)
"""


@pytest.mark.slow
@pytest.mark.parametrize("case", ["discs", "bonds", "spheres"])
def test_one_edited_array_never_ends_the_process(case, tmp_path):
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, str(tmp_path / "run.npz"), case, "120"],
        capture_output=True,
        text=True,
        check=False,
        timeout=3600,
        cwd=pathlib.Path(__file__).parents[2],
    )
    assert done.returncode == 0, (done.stdout[-200:], done.stderr[-2000:])
    _, went_on, refused = done.stdout.splitlines()[-1].split()
    assert int(went_on) + int(refused) == 120
    assert int(refused) > 40
