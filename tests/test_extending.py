"""Facts about what is added from outside the package: each in one short class or function, named in a scene file."""

import json
import subprocess
import sys
from typing import NamedTuple

import numpy as np
import pytest

import packmech as pm
from packmech.dynamics.integrators import choose_time_step

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

    def pair_first(self, distance, contact_distance):
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


@pm.effect
class Tether(NamedTuple):
    """A contact of one's own: neighbors pull within a reach beyond contact, and turn each other the same way."""

    strength: float = 0.03
    torsion: float = 0.02
    span: float = 1.3

    def reach(self, contact_distance):
        return self.span * contact_distance

    def interaction_energy(self, distance, contact_distance, alignment):
        far = 1.0 - distance / (self.span * contact_distance)
        return far**3 * (self.torsion * (1.0 - alignment**2) - self.strength)

    def interaction_first(self, distance, contact_distance, alignment):
        span = self.span * contact_distance
        far, well = 1.0 - distance / span, self.torsion * (1.0 - alignment**2) - self.strength
        return -3.0 * far**2 * well / span, -2.0 * alignment * self.torsion * far**3

    def interaction_second(self, distance, contact_distance, alignment):
        span = self.span * contact_distance
        far, well = 1.0 - distance / span, self.torsion * (1.0 - alignment**2) - self.strength
        return 6.0 * far * well / span**2, 6.0 * alignment * self.torsion * far**2 / span, -2.0 * self.torsion * far**3


TETHERED = {
    "discs": {"dimension": 2, "packing_fraction": 0.9},
    "ellipses": {"dimension": 2, "packing_fraction": 0.95, "shapes": pm.Ellipses(1.5)},
    "spheroids": {"dimension": 3, "packing_fraction": 0.75, "shapes": pm.Ellipses(1.5)},
    "bodies": {"dimension": 2, "packing_fraction": 0.9, "shapes": pm.Trimer()},
}


@pytest.fixture(scope="module", params=TETHERED)
def tethered(request):
    """A scene at rest under contacts and tethers."""
    start = pm.random_packing(12, seed=4, **TETHERED[request.param])
    scene = pm.Scene(start, (pm.Repulsion(), Tether()))
    run = pm.quench(scene, force_tolerance=1e-11)
    assert run.residual <= 1e-11 and pm.energy(scene.replace(packing=run.packing)) < pm.energy(scene)
    return scene.replace(packing=run.packing)


def slopes(scene):
    """The (N, q) slopes of the energy along positions and turns, in lengths."""
    turn = scene.packing.turn_nkt
    torque = np.reshape(pm.torques(scene), (scene.packing.particles, -1))[:, : turn.shape[2]]
    return -np.hstack([pm.forces(scene), np.einsum("nkt,nt->nk", turn, torque)])


def moved(scene, change_nq):
    return scene.replace(packing=scene.packing.moved(change_nq))


def test_a_contact_of_ones_own_pushes_and_turns_by_its_energy(tethered):
    rng = np.random.default_rng(1)
    aside = moved(tethered, 0.05 * rng.normal(size=slopes(tethered).shape))
    direction, step = rng.normal(size=slopes(aside).shape), 1e-6
    ends = [pm.energy(moved(aside, side * step * direction)) for side in (1.0, -1.0)]
    assert (slopes(aside) * direction).sum() == pytest.approx((ends[0] - ends[1]) / (2.0 * step), rel=1e-6)


def test_its_hessian_and_modes_are_differences_of_its_forces(tethered):
    rng, step = np.random.default_rng(2), 1e-6
    hessian = pm.hessian(tethered, "none").toarray()
    direction = rng.normal(size=slopes(tethered).shape)
    found = (hessian @ direction.ravel()).reshape(direction.shape)
    expected = (slopes(moved(tethered, step * direction)) - slopes(moved(tethered, -step * direction))) / (2.0 * step)
    assert np.abs(found - expected).max() < 1e-6 * np.abs(expected).max()
    dynamical = pm.dynamical_matrix(tethered).toarray()
    modes = pm.normal_modes(tethered)
    assert modes.eigenvalue_m[-3:] == pytest.approx(np.linalg.eigvalsh(dynamical)[-3:], rel=1e-9)


def test_its_moduli_are_those_of_strained_and_quenched_packings_and_of_slow_shear(tethered):
    moduli, step, d = pm.elastic_moduli(tethered, rattlers="keep"), 1e-6, tethered.packing.dimension
    shear = np.zeros((d, d))
    shear[0, 1] = shear[1, 0] = 0.5
    ends = []
    for side in (1.0, -1.0):
        map_dd, packing = np.eye(d) + side * step * shear, tethered.packing
        box = pm.Box(map_dd @ packing.box.lattice_dd)
        there = packing.replace(position_nd=packing.position_nd @ map_dd.T, box=box)
        run = pm.quench(tethered.replace(packing=there), force_tolerance=1e-13, check=False)
        ends.append(pm.stress_tensor(tethered.replace(packing=run.packing)))
    found = pm.mandel_vector(0.5 * (ends[0] - ends[1] + (ends[0] - ends[1]).T)) / (2.0 * step)
    expected = moduli.cauchy @ pm.mandel_vector(shear)
    assert found == pytest.approx(expected, rel=1e-5, abs=1e-6 * np.abs(expected).max())
    # slow simple shear: what pure shear and a rotation of the stress make
    stress = pm.stress_tensor(tethered)
    turned = 0.5 * (stress[1, 1] - stress[0, 0])
    slow = pm.complex_modulus(tethered, [1e-7]).modulus_f[0].real
    assert slow == pytest.approx(expected[-1] / np.sqrt(2.0) + turned, rel=1e-5)


def test_it_holds_particles_that_touch_nothing():
    at = [[1.0 + 1.15 * k, 1.0 + 1.15 * m] for k in range(3) for m in range(3)]
    packing = pm.Packing(at, [0.5] * 9, pm.Box.cubic(3.45, 2))
    assert pm.find_rattlers(packing).all()
    assert not pm.find_rattlers(packing, effects=(Tether(),)).any()
    assert pm.find_rattlers(packing, effects=(Tether(span=1.1),)).all()


def test_its_motion_keeps_the_energy_to_second_order_and_is_that_of_its_forces(tethered):
    rng = np.random.default_rng(3)
    velocity = 0.02 * rng.normal(size=tethered.packing.position_nd.shape)
    drift = []
    for dt in (0.02, 0.01):
        steps = round(2.0 / dt)
        run = pm.simulate(tethered, steps=steps, dt=dt, velocity_nd=velocity, trace_every=steps, check=False)
        numbers = run.to_dict()
        energy = pm.energy(tethered.replace(packing=run.packing))
        assert numbers["potential_energy"] == pytest.approx(energy, rel=1e-9)
        drift.append(abs(numbers["energy_drift"]))
    assert drift[1] < 0.4 * drift[0]


@pm.effect
class Halo(NamedTuple):
    """A repulsion far beyond contact that aligns neighbors."""

    stiffness: float = 1.0
    span: float = 1.4

    def reach(self, contact_distance):
        return self.span * contact_distance

    def interaction_energy(self, distance, contact_distance, alignment):
        return 0.5 * self.stiffness * (self.span * contact_distance - distance) ** 2 * (2.0 - alignment**2)

    def interaction_first(self, distance, contact_distance, alignment):
        far = self.span * contact_distance - distance
        return -self.stiffness * far * (2.0 - alignment**2), -self.stiffness * far**2 * alignment

    def interaction_second(self, distance, contact_distance, alignment):
        far = self.span * contact_distance - distance
        along, mixed = self.stiffness * (2.0 - alignment**2), 2.0 * self.stiffness * far * alignment
        return along, mixed, -self.stiffness * far**2


@pytest.mark.parametrize("kind", ["discs", "ellipses"])
def test_the_default_time_step_answers_to_how_stiff_it_is(kind):
    start = pm.random_packing(12, seed=4, **TETHERED[kind])
    steps = {}
    for stiff in (1.0, 100.0):
        # a thousand times as stiff as contacts are
        scene = pm.Scene(start, (pm.Repulsion(pm.Harmonic(1e-3)), Halo(stiff)))
        steps[stiff] = choose_time_step(scene, 0.05)
        numbers = pm.simulate(scene, steps=400, trace_every=400, check=False).to_dict()
        assert abs(numbers["energy_drift"]) < 2e-3
        assert numbers["potential_energy"] < 0.99 * pm.energy(scene)
    assert steps[1.0] == pytest.approx(10.0 * steps[100.0], rel=1e-12)
