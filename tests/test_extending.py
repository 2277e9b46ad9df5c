"""Facts about what is added from outside the package: each in one short class or function, named in a scene file."""

import json
import subprocess
import sys

import numpy as np
import pytest

MODULE = """
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

import packmech as pm


@pm.law
class Cubic(NamedTuple):
    energy_scale: float = 1.0

    def energy(self, distance, contact_distance):
        return self.energy_scale * (1.0 - distance / contact_distance) ** 3 / 3.0

    def first(self, distance, contact_distance):
        return -self.energy_scale * (1.0 - distance / contact_distance) ** 2 / contact_distance

    def second(self, distance, contact_distance):
        return 2.0 * self.energy_scale * (1.0 - distance / contact_distance) / contact_distance**2


@pm.effect
class Sticky(NamedTuple):
    strength: float = 1.0

    def pair_energy(self, distance, contact_distance):
        return -0.5 * self.strength * (contact_distance - distance) ** 2

    def pair_first(self, distance, contact_distance, rate):
        return self.strength * (contact_distance - distance)

    def pair_second(self, distance, contact_distance):
        return -self.strength


@pm.effect
class Wind(NamedTuple):
    acceleration: float = 0.0

    def body_force(self, x, y, z, u, v, w, mass, radius):
        return mass * self.acceleration, 0.0, 0.0


@pm.minimizer
class Downhill(NamedTuple):
    step: float = 1.0

    def start(self, program):
        return program.progress(2, 0)

    def advance(self, program, goal, progress, steps):
        for _ in range(steps):
            status, now = program.judge(goal)
            progress.number[1] += 1
            if status:
                return status
            program.place(program.coordinates() + self.step * now.force_nd)
            progress.number[0] += 1
        return program.judge(goal)[0]


@pm.observable(unit="length")
def deepest_overlap(state):
    return pm.find_contacts(state.packing).overlap_c.max(initial=0.0)


@pm.report_figure(unit="contacts of a particle")
def smallest_coordination(scene):
    contacts = pm.find_contacts(scene.packing)
    return int(np.bincount(np.append(contacts.i_c, contacts.j_c)).min())


@pm.packing_kind
def brick_wall(rows: int, overlap: float = 0.1) -> pm.Packing:
    at = [[column + k % 2 * 0.5, k * 0.75**0.5] for k in range(2 * rows) for column in range(4)]
    return pm.Packing(at, [0.5 / (1.0 - overlap)] * len(at), pm.Box([[4.0, 0.0], [0.0, 2 * rows * 0.75**0.5]]))


@pm.drive
@dataclass(frozen=True)
class TapDrive:
    taps: int = 2
    height: float = 0.01
    examined_strain = "isotropic"

    def run(self, scene, *, progress=None):
        rng = np.random.default_rng(0)
        for tap in range(self.taps):
            at = scene.packing.position_nd + self.height * rng.normal(size=scene.packing.position_nd.shape)
            tapped = scene.replace(packing=scene.packing.replace(position_nd=at))
            run = pm.quench(tapped, force_tolerance=1e-9, method=Downhill(), check=False)
            scene = scene.replace(packing=run.packing)
            progress("tap", {"number": tap, "packing": run.packing})
        return run
"""

WALL = """
[packing]
kind = "brick-wall"
rows = 2

[[effects]]
kind = "repulsion"
law = { kind = "cubic", energy_scale = 2.0 }
"""
STICKY = '[[effects]]\nkind = "sticky"\nstrength = 0.01\n'
SCENES = {
    "tap": WALL + STICKY + '[drive]\nkind = "tap"\ntaps = 3\n',
    "quench": WALL + STICKY + '[drive]\nkind = "quench"\nmethod = { kind = "downhill", step = 0.5 }\n',
    "wind": WALL + '[[effects]]\nkind = "wind"\nacceleration = 0.25\n[drive]\nkind = "simulate"\nduration = 2.0\n',
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A folder with the module and the scenes that use it."""
    made = tmp_path_factory.mktemp("outside")
    (made / "my_module.py").write_text(MODULE)
    for name, text in SCENES.items():
        (made / f"{name}.toml").write_text(text)
    return made


def python(folder, *words):
    """Run Python in the folder as a process of its own: what is registered there stays there."""
    done = subprocess.run([sys.executable, *words], cwd=folder, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return done.stdout


def run(folder, name, *words):
    """Run a scene by the command; its numbers."""
    python(folder, "-m", "packmech", "run", f"{name}.toml", "--load", "my_module.py", "--json", f"{name}.json", *words)
    return json.loads((folder / f"{name}.json").read_text())


def pressure_of_the_wall():
    """Pressure of a triangular crystal of distance 1 under both pair effects, in energy_scale / diameter^2."""
    diameter = 1.0 / 0.9
    force = 2.0 * 0.1**2 / diameter - 0.01 * (diameter - 1.0)
    return np.sqrt(3.0) * force / (2.0 / diameter**2)


def test_a_drive_of_ones_own_runs_under_a_law_and_a_pair_effect_of_ones_own(folder):
    numbers = run(folder, "tap", "--modes", "0", "--record", "tap.rrd")
    assert numbers["particles"] == 16 and numbers["outcome"] == "converged" and numbers["steps"] > 10
    assert numbers["pressure"] == pytest.approx(pressure_of_the_wall(), rel=1e-9)
    assert numbers["contacts"] == 48
    # a figure of the report that was added
    assert numbers["smallest_coordination"] == 6
    assert (folder / "tap.rrd").stat().st_size > 1000


def test_a_scene_file_names_a_minimizer_of_ones_own(folder):
    numbers = run(folder, "quench", "--modes", "0")
    assert numbers["pressure"] == pytest.approx(pressure_of_the_wall(), rel=1e-9)


def test_a_body_effect_of_ones_own_pushes_every_particle(folder):
    numbers = run(folder, "wind")
    # density 1, diameter 1/0.9
    assert numbers["momentum"] == pytest.approx([16 * np.pi / 4.0 / 0.9**2 * 0.25 * 2.0, 0.0], abs=1e-9)


def test_an_observable_of_ones_own_is_in_trace_columns_and_recording(folder):
    script = """
import my_module, packmech as pm
import rerun.chunk as chunk
scene = pm.read_scene("quench.toml")
at = scene.packing.position_nd + [[0.02 * (k % 3), 0.0] for k in range(16)]
scene = scene.replace(packing=scene.packing.replace(position_nd=at))
run = pm.quench(scene, force_tolerance=1e-6, method=my_module.Downhill(), trace_every=5, trace_positions=True)
kept = run.trace["deepest_overlap"]
assert len(kept) == len(run.trace.step_t) > 3
expected = [pm.find_contacts(scene.packing.replace(position_nd=at)).overlap_c.max() for at in run.trace.position_tnd]
assert kept.tolist() == expected, (kept, expected)
pm.write_table(run, "run.csv")
assert pm.read_table("run.csv")["deepest_overlap"].tolist() == kept.tolist()
path = pm.record_run(run, "run.rrd", scene=scene)
entities = {str(piece.entity_path) for piece in chunk.RrdReader(path).stream().to_chunks()}
assert any(name.startswith("/series/deepest") for name in entities), entities
"""
    python(folder, "-c", script)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("import no_such_thing", "got 'bad.py': No module named 'no_such_thing'"),
        ("import packmech as pm\n@pm.packing_kind\ndef lattice(): ...", "kinds of packings has, got 'lattice'"),
        ("import packmech as pm\n@pm.drive\nclass JamDrive: ...", "drive must be a dataclass"),
    ],
)
def test_what_cannot_be_loaded_is_one_line_and_exit_code_2(folder, text, message):
    (folder / "bad.py").write_text(text)
    words = [sys.executable, "-m", "packmech", "jam", "--load", "bad.py"]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True)
    (line,) = done.stderr.splitlines()
    assert done.returncode == 2 and line.startswith("packmech: load must name a file that can be imported")
    assert message in line
