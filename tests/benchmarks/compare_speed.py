# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Two versions of packmech against the clock: the same work in alternating pairs, and the ratio of their times.

    python tests/benchmarks/compare_speed.py --tag PATH_OF_A_CHECKOUT [--restarts 5] [--pairs 15] [--rows PATTERN ...]

Two processes, one for each checkout (the other version, "tag", and the one that this file is in, "head"), are asked in
turn, tag, head, head, tag, ..., for one row of the table at a time; each has prepared all rows before, the first answer
(which compiles) is not counted, and answers are the CPU seconds of its process. Where a process has its arrays and code
makes some loops faster or slower by 4 % for as long as it lives, however many pairs are timed: both are started several
times, and each start has its share of the pairs. Scenes come from the benchmarks of the checkout itself, and both get
the same packings: the first that needs one writes it down for the other.

Printed for each row: the median over the restarts of head's time over tag's (the median of the pairs of each), its
quartiles, and the median times; at the end the geometric mean of the medians. The exit code is 1 where a median is
above 1.05 or the mean above 1.01. Run it on an idle machine: one that is shared adds some per cent of noise to the
quartiles.
"""

from __future__ import annotations

import argparse
import fnmatch
import functools
import importlib
import json
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from numpy.typing import NDArray

_HERE = Path(__file__).resolve()
_HEAD = _HERE.parents[2]
LARGEST_RATIO, LARGEST_MEAN = 1.05, 1.01
SIDES = ("head", "tag")

# name -> function of the worker that prepares the row and returns a call that returns seconds
ROWS: dict[str, Callable[[Worker], Callable[[], float]]] = {}


def row(name: str, /, **settings: Any):
    """Register a function as the row of this name, called with these settings."""

    def registered(function):
        ROWS[name] = functools.partial(function, **settings)
        return function

    return registered


def cpu_of(call: Callable[[], Any]) -> float:
    """Return the CPU seconds of a call."""
    began = time.process_time()
    call()
    return time.process_time() - began


def least_of(call: Callable[[], Any], repeats: int = 3) -> Callable[[], float]:
    """Return a call that returns the least CPU seconds of several."""
    return lambda: min(cpu_of(call) for _ in range(repeats))


class Version:
    """The packmech of this process, its environments, and the benchmarks of its checkout."""

    def __init__(self) -> None:
        self.module = importlib.import_module("packmech")

    def __getattr__(self, name: str) -> Any:
        """Return a public name of packmech."""
        return getattr(self.module, name)

    def benchmark(self, place: str) -> Any:
        """Return what a benchmark of this version's own checkout defines, such as "bench_march:make_start"."""
        folder = os.fspath(Path(self.module.__file__).parents[1] / "tests" / "benchmarks")
        if sys.path[0] != folder:
            sys.path.insert(0, folder)
        module, _, name = place.partition(":")
        return getattr(importlib.import_module(module), name)

    def make(self, name: str, **given: Any) -> Any:
        """Return an environment such as "Quench-v0"."""
        return gymnasium.make(f"packmech_envs:packmech/{name}", **given)

    def make_vec(self, name: str, count: int, **given: Any) -> Any:
        """Return a batch of environments."""
        return gymnasium.make_vec(f"packmech_envs:packmech/{name}", num_envs=count, **given)


class Worker:
    """One version, with the packings that both share.

    Parameters
    ----------
    folder
        Where packings are written down for the other.

    """

    def __init__(self, folder: Path) -> None:
        self.pm = Version()
        self.folder = folder
        self._prepared: dict[str, Callable[[], float]] = {}

    def packing(self, name: str, make: Callable[[], Any]) -> Any:
        """Return the packing of this name, which the first worker that needs it makes."""
        path = self.folder / f"{name}.npz"
        if not path.exists():
            self._write_packing(path, make())
        with np.load(path) as file:
            links = None
            if "i_l" in file.files:
                links = self.pm.Links(*(file[key] for key in ("i_l", "j_l", "image_ld", "length_l", "shape_l")))
            return self.pm.Packing(file["position_nd"], file["radius_n"], self.pm.Box(file["lattice_dd"]), links)

    @staticmethod
    def _write_packing(path: Path, made: Any) -> None:
        arrays = {"position_nd": made.position_nd, "radius_n": made.radius_n, "lattice_dd": made.box.lattice_dd}
        links = made.links
        if links:
            arrays |= {key: getattr(links, key) for key in ("i_l", "j_l", "image_ld", "length_l", "shape_l")}
        with path.open("wb") as file:
            np.savez(file, **arrays)

    def prepare(self, name: str) -> float:
        """Make what a row needs; all rows are prepared before any is timed, since solvers start threads."""
        self._prepared[name] = ROWS[name](self)
        return 0.0

    def time(self, name: str) -> float:
        """Return the seconds of a row."""
        return self._prepared[name]()


# -- minimizers -------------------------------------------------------------------------------------------------------


def fire_step(worker, particles, dimension):
    bench = worker.pm.benchmark("bench_fire:bench_step")
    return lambda: bench(particles, dimension=dimension) * 1e-9 * particles


for _n, _d in ((64, 2), (1000, 2), (4096, 2), (10_000, 2), (4096, 3)):
    row(f"FIRE step, {_d}D, N = {_n}", particles=_n, dimension=_d)(fire_step)


# -- time stepping ----------------------------------------------------------------------------------------------------

COMBINATIONS = ("spring", "spring, dashpot", "spring, dashpot, friction", "the same and bonds")
MARCHED = {150: 10_000, 1_000: 2_000, 10_000: 200, 100_000: 40}


@functools.cache
def march_start(worker, particles):
    """Return the start of bench_march.py, the same for both."""
    path = worker.folder / f"start-{particles}.npz"
    start_type = worker.pm.benchmark("bench_march:Start")
    if not path.exists():
        made = worker.pm.benchmark("bench_march:make_start")(particles)
        with path.open("wb") as file:
            np.savez(file, **made._asdict())
    with np.load(path) as file:
        return start_type(**{name: file[name] for name in start_type._fields})._replace(side=float(file["side"]))


def frictional_step(worker, particles, combination):
    ours = worker.pm.benchmark("bench_march:ours")
    start = march_start(worker, particles)
    effects = {name: one for name, one, *_ in worker.pm.benchmark("bench_march:combinations")(start)}[combination]
    steps = MARCHED[particles]

    def once():
        engine = ours(start, effects)
        engine.advance(3)
        return cpu_of(lambda: engine.advance(steps)) / steps

    return lambda: min(once() for _ in range(3))


for _n in MARCHED:
    for _name in COMBINATIONS:
        row(f"frictional step, N = {_n}: {_name}", particles=_n, combination=_name)(frictional_step)


def simulated(worker, kind, particles, dimension, fraction):
    pm = worker.pm
    clusters = {"dimers": pm.Dimer(), "trimers": pm.Trimer()}

    def start():
        if kind in clusters:
            return pm.cluster_packing(
                particles, clusters[kind], dimension=dimension, packing_fraction=fraction, seed=1, crossing="allowed"
            )
        if kind == "chains":
            return pm.chain_packing(particles, 200, dimension=dimension, packing_fraction=fraction, seed=1)
        sizes = pm.Bidisperse(ratio=1.4)
        return pm.random_packing(particles, dimension=dimension, sizes=sizes, packing_fraction=fraction, seed=1)

    def at_rest():
        relaxed = pm.benchmark("bench_simulate:relaxed")
        return relaxed(start(), (pm.Repulsion(),)).packing

    packing = worker.packing(f"simulated-{kind}-{particles}-{dimension}", at_rest)
    damped = (pm.ContactDamping(coefficient=0.1),) if kind == "dashpots" else ()
    scene = pm.Scene(packing, (pm.Repulsion(), *damped))
    steps = max(300, 1_000_000 // packing.particles)
    given = {"dt": 0.05, "mass_n": np.ones(packing.particles), "temperature": 1e-4, "seed": 1}
    few = 2

    def least(count):
        return min(cpu_of(lambda: pm.simulate(scene, steps=count, **given)) for _ in range(3))

    # what it takes to build the run is taken off: the least of each, for the least difference would favor slow builds
    return lambda: (least(steps + few) - least(few)) / steps


for _kind, _n, _d, _fraction in (
    ("discs", 1_000, 2, 0.95),
    ("discs", 10_000, 2, 0.95),
    ("dashpots", 10_000, 2, 0.95),
    ("spheres", 10_000, 3, 0.7),
    ("dimers", 1_000, 2, 0.85),
    ("trimers", 1_000, 2, 0.85),
    ("trimers", 1_000, 3, 0.6),
    ("chains", 50, 2, 0.6),
    ("chains", 20, 3, 0.4),
):
    row(
        f"simulate, {_n} {_kind}, {_d}D", kind=_kind, particles=_n, dimension=_d, fraction=_fraction
    )(simulated)  # fmt: skip


# -- links ------------------------------------------------------------------------------------------------------------


def linked(worker, what):
    pm = worker.pm
    packing = worker.packing("chains-200-80", lambda: pm.benchmark("bench_links:chains")(200, 80))
    force = np.random.default_rng(1).normal(size=packing.position_nd.shape)
    moved = packing.replace(position_nd=packing.position_nd + 0.03 * force)
    call = {
        "basis": lambda: pm.constraint_basis(packing),
        "basis with strains and volume": lambda: pm.constraint_basis(packing, strain="isochoric"),
        "independent links": lambda: pm.independent_links(packing),
        "a first projection": lambda: pm.project_force(packing.replace(), force),
        "50 further projections": lambda: [pm.project_force(packing, force) for _ in range(50)],
        "re-affixing": lambda: pm.reaffix_links(moved),
    }[what]
    return least_of(call, 1 if what.startswith("basis") else 3)


for _name in (
    *("basis", "basis with strains and volume", "independent links", "a first projection"),
    *("50 further projections", "re-affixing"),
):
    row(f"links, 80 chains of 200: {_name}", what=_name)(linked)


# -- jamming and mechanics --------------------------------------------------------------------------------------------


@row("jam, 2D, N = 1024", particles=1024, dimension=2)
@row("jam, 3D, N = 256", particles=256, dimension=3)
def jam(worker, particles, dimension):
    pm = worker.pm
    start = pm.benchmark("bench_jam:start")(particles, dimension, 0.0, 1)
    packing = worker.packing(f"jam-{particles}-{dimension}", lambda: start.packing)
    scene = pm.Scene(packing, (pm.Repulsion(),))
    return lambda: cpu_of(lambda: pm.jam(scene, pressure=1e-8, strain="free", method=pm.HardVertex()))


@row("verdict, 2D, N = 4096")
def verdict(worker):
    pm = worker.pm
    packing = worker.packing("verdict-4096", lambda: pm.benchmark("bench_verdict:cell")(4096, 2))
    return lambda: cpu_of(lambda: pm.classify_jamming(packing))


def scene_at_rest(worker, particles, dimension, fraction):
    """Return a scene at rest, the packing the same for both."""
    pm = worker.pm

    def at_rest():
        scene = pm.benchmark("bench_mechanics:nearly_at_rest")(particles, dimension, fraction, 1)
        return pm.quench(scene, force_tolerance=1e-11).packing

    return pm.Scene(worker.packing(f"at-rest-{particles}-{dimension}", at_rest), (pm.Repulsion(),))


@row("moduli, 2D, N = 1024", particles=1024, dimension=2, fraction=0.9)
@row("moduli, 3D, N = 512", particles=512, dimension=3, fraction=0.7)
def moduli(worker, particles, dimension, fraction):
    scene = scene_at_rest(worker, particles, dimension, fraction)
    return least_of(lambda: [worker.pm.elastic_moduli(scene) for _ in range(3)])


@row("50 modes, 2D, N = 1024")
def modes(worker):
    scene = scene_at_rest(worker, 1024, 2, 0.9)
    return least_of(lambda: worker.pm.normal_modes(scene, 50))


@row("quench, 2D, N = 1024", particles=1024, dimension=2)
@row("quench, 3D, N = 256", particles=256, dimension=3)
def quench(worker, particles, dimension):
    pm = worker.pm
    start = pm.benchmark("bench_jam:start")(particles, dimension, 0.0, 1)
    packing = worker.packing(f"jam-{particles}-{dimension}", lambda: start.packing)
    scene = pm.Scene(packing, (pm.Repulsion(),))
    return least_of(lambda: pm.quench(scene, force_tolerance=1e-10))


@row("quasistatic shear, N = 32", particles=32)
@row("quasistatic shear, N = 256", particles=256)
def quasistatic(worker, particles):
    pm = worker.pm

    def pressed():
        sizes = pm.Bidisperse(ratio=1.4)
        start = pm.random_packing(particles, dimension=2, sizes=sizes, packing_fraction=0.9, seed=1)
        return pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=1e-2, strain="isotropic").packing

    scene = pm.Scene(worker.packing(f"pressed-{particles}", pressed), (pm.Repulsion(),))
    return lambda: cpu_of(lambda: pm.quasistatic_shear(scene, applied_strain=0.005))


@row("oscillation, N = 64, friction")
def oscillation(worker):
    scene = shear_scene(worker, 64, True)
    given = {"amplitude": 1e-3, "frequency": 0.02, "periods": 2.0, "dt": 0.04}
    return least_of(lambda: worker.pm.oscillatory_shear(scene, **given))


# -- environments -----------------------------------------------------------------------------------------------------


@row("Quench-v0, a step of 1", relax=1)
@row("Quench-v0, a step of 10", relax=10)
def quench_step(worker, relax):
    given = {"relax": relax, "step_budget": None, "evaluation_budget": None, "largest_pressure": 1e-9}
    env = worker.pm.make("Quench-v0", scene=None, **given).unwrapped
    env.reset(seed=0)
    action = np.zeros(2)
    return least_of(lambda: [env.step(action) for _ in range(1000)], 5)


@row("Quench-v0, batch of 64, steps of 1", relax=1)
@row("Quench-v0, batch of 64, steps of 10", relax=10)
@row("Quench-v0, batch of 64, relaxed", relax="full")
def quench_batch(worker, relax):
    given = {
        "relax": relax,
        "start_packing_fraction": 0.88,
        "largest_change": 2e-3,
        "largest_strain": 1e-2,
        "step_budget": 100,
        "evaluation_budget": None,
    }
    envs = worker.pm.make_vec("Quench-v0", 64, scene=None, threads=1, **given)
    action = np.random.default_rng(0).uniform(-1.0, 1.0, (20, 64, 2))

    def play():
        envs.reset(seed=0)
        for one in action[: 5 if relax == "full" else 20]:
            envs.step(one)

    return least_of(play, 2)


def shear_scene(worker, particles, frictional):
    """Return a scene of bench_envs_shear.py, with friction or without, the packing the same for both."""
    pm = worker.pm
    packing = worker.packing(f"shear-{particles}", lambda: pm.benchmark("bench_envs_shear:scene_of")(particles).packing)
    effects = pm.benchmark("bench_envs_shear:RUBBING") if frictional else ()
    return pm.Scene(packing, (pm.Repulsion(), *effects))


def shear_step(worker, frame_skip, frictional):
    scene = shear_scene(worker, 64, frictional)
    given = {"frame_skip": frame_skip, "budget": None, "largest_rate": 1.0}
    env = worker.pm.make("Shear-v0", scene=scene, **given).unwrapped
    env.reset(seed=0)
    action = np.array([1e-3])
    return least_of(lambda: [env.step(action) for _ in range(4000 if frame_skip == 1 else 500)], 5)


def shear_batch(worker, frame_skip, frictional):
    scene = shear_scene(worker, 32, frictional)
    given = {"frame_skip": frame_skip, "budget": None, "largest_rate": 1.0, "relax": False}
    envs = worker.pm.make_vec("Shear-v0", 64, scene=scene, threads=1, **given)
    envs.reset(seed=0)
    actions = np.full(envs.action_space.shape, 1e-3)
    return least_of(lambda: [envs.step(actions) for _ in range(200 // frame_skip + 50)])


for _skip in (1, 20):
    for _frictional in (False, True):
        _effects = "friction" if _frictional else "frictionless"
        _given = {"frame_skip": _skip, "frictional": _frictional}
        row(f"Shear-v0, a step of {_skip}, {_effects}", **_given)(shear_step)
        row(f"Shear-v0, batch of 64, steps of {_skip}, {_effects}", **_given)(shear_batch)


# -- the comparison ---------------------------------------------------------------------------------------------------


def work(folder: Path) -> None:
    """Answer the names of rows, line by line, with seconds; what else is printed goes to the error stream."""
    answers = os.fdopen(os.dup(1), "w")
    os.dup2(2, 1)
    worker = Worker(folder)
    for line in sys.stdin:
        what, name = json.loads(line)
        print(json.dumps(getattr(worker, what)(name)), file=answers, flush=True)


class Process:
    """A worker in a process of its own."""

    def __init__(self, side: str, checkout: Path, folder: Path) -> None:
        path = os.pathsep.join(map(os.fspath, (checkout, checkout / "envs")))
        threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"), "1")
        environment = {**os.environ, **threads, "PYTHONPATH": path}
        if side == "tag" and "NUMBA_CACHE_DIR" in environment:
            environment["NUMBA_CACHE_DIR"] += "-tag"
        words = [sys.executable, os.fspath(_HERE), "--worker", side, "--folder", os.fspath(folder)]
        self._running = subprocess.Popen(
            words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True, env=environment
        )
        self._side = side

    def ask(self, name: str, what: str = "time") -> float:
        """Return the seconds of a row, or prepare it."""
        assert self._running.stdin is not None and self._running.stdout is not None
        self._running.stdin.write(json.dumps([what, name]) + "\n")
        self._running.stdin.flush()
        answer = self._running.stdout.readline()
        if not answer:
            raise RuntimeError(f"the worker of the {self._side} ended while it was asked for {name!r}")
        return float(json.loads(answer))

    def close(self) -> None:
        """End the process."""
        assert self._running.stdin is not None
        self._running.stdin.close()
        self._running.wait()


def time_pairs(tag: Path, folder: Path, names: list[str], pairs: int, first: int) -> NDArray[np.float64]:
    """Return the (2, rows, pairs) seconds of both SIDES in processes of their own; `first` says which of them begins.

    Arguments are as of `compare`; `pairs` are those of this start, and `folder` holds the packings.
    """
    checkouts = {"head": _HEAD, "tag": tag}
    order = SIDES if first % 2 else SIDES[::-1]
    processes = {side: Process(side, checkouts[side], folder) for side in order}
    for name in names:
        for side in order:
            processes[side].ask(name, "prepare")
    seconds = np.zeros((len(SIDES), len(names), pairs))
    for r, name in enumerate(names):
        for side in order:
            processes[side].ask(name)
        for k in range(pairs):
            for side in order if k % 2 == 0 else order[::-1]:
                seconds[SIDES.index(side), r, k] = processes[side].ask(name)
    for process in processes.values():
        process.close()
    return seconds


def compare(tag: Path, names: list[str], pairs: int, restarts: int) -> int:
    """Print the table; return 1 where the head is slower than it may be."""
    each = math.ceil(pairs / restarts)
    print(f"other processes that run: {os.getloadavg()[0]:.1f}; {restarts} restarts of {each} pairs", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        # a worker that is asked for nothing else makes the packings: arrays lie elsewhere in the memory of a process
        # that has made one, and some loops over them are up to a third faster there
        maker = Process("tag", tag, Path(folder))
        for name in names:
            maker.ask(name, "prepare")
        maker.close()
        # sides, rows, restarts, pairs
        seconds = np.stack([time_pairs(tag, Path(folder), names, each, k) for k in range(restarts)], axis=2)
    head, other = seconds
    low, middle, high = np.quantile(np.median(head / other, axis=2), [0.25, 0.5, 0.75], axis=1)
    times = 1e3 * np.median(seconds, axis=(2, 3))
    slower = [name for name, one in zip(names, middle, strict=True) if one > LARGEST_RATIO]
    print(f"{'row':52s} {'head / tag':>10s} {'quartiles':>15s} {'tag [ms]':>11s} {'head [ms]':>11s}")
    for r, name in enumerate(names):
        mark = "  SLOWER" if name in slower else ""
        spread = f"{low[r]:7.3f} {high[r]:7.3f}"
        print(f"{name:52s} {middle[r]:10.3f} {spread} {times[1, r]:11.4g} {times[0, r]:11.4g}{mark}")
    mean = math.exp(float(np.mean(np.log(middle))))
    print(f"geometric mean of {len(names)} rows: {mean:.4f} (at most {LARGEST_MEAN})")
    print(f"medians above {LARGEST_RATIO}: {', '.join(slower) or 'none'}")
    return int(bool(slower) or mean > LARGEST_MEAN)


def main(words: list[str] | None = None) -> int:
    """Do what the command line says; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--tag", type=Path, help="a checkout of the other version")
    parser.add_argument("--restarts", type=int, default=5, help="how often both processes are started")
    parser.add_argument("--pairs", type=int, default=15, help="how many in all, over the restarts")
    parser.add_argument("--rows", nargs="+", default=["*"], metavar="PATTERN")
    parser.add_argument("--list", action="store_true", help="print the names of the rows")
    parser.add_argument("--worker", choices=SIDES, help=argparse.SUPPRESS)
    parser.add_argument("--folder", type=Path, help=argparse.SUPPRESS)
    given = parser.parse_args(words)
    if given.worker is not None:
        work(given.folder)
        return 0
    names = [name for name in ROWS if any(fnmatch.fnmatchcase(name, one) for one in given.rows)]
    if given.list:
        print("\n".join(names))
        return 0
    if given.tag is None or not names or min(given.pairs, given.restarts) < 1:
        parser.error("--tag must be given, --rows match a row, and --pairs and --restarts be at least 1")
    return compare(given.tag.resolve(), names, given.pairs, given.restarts)


if __name__ == "__main__":
    sys.exit(main())
