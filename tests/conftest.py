"""Settings and scenes that many tests share: the same examples in every run, so that a red run can be repeated.

`pytest --hypothesis-profile=explore` draws new ones.
"""

import functools
import importlib.util
import json
import os
import pathlib
import signal
import sys
import tempfile
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import settings

import packmech as pm
from packmech.minimize.program import build_program
from packmech.minimize.second_order.newton import newton

settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.register_profile("explore", derandomize=False, deadline=None)
settings.load_profile("repeatable")

# a shell that starts the suite in the background makes it deaf to Ctrl-C, and the tests that press it with it
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)

GOLDEN = pathlib.Path(__file__).parent / "golden"

# What LLVM takes to compile it does not give back, some 45 MB for each law that is quenched: a process that ran half of
# the suite would hold 12 GB. One that holds more than this [bytes] ends between two files, and a new one goes on.
WORKER_LIMIT = 6 * 1024**3
_LAST_FILE = pytest.StashKey()


@pytest.fixture(autouse=True)
def figures_are_closed():
    """Close what a test drew: matplotlib warns beyond twenty figures, in whichever test draws the next."""
    yield
    pyplot = sys.modules.get("matplotlib.pyplot")
    if pyplot is not None:
        pyplot.close("all")


def _resident():
    """Return how much memory this process holds [bytes]; 0 where the system does not say."""
    try:
        return int(pathlib.Path("/proc/self/statm").read_text().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return 0


def _note_of(workerinput):
    """Return the file by which a worker says that it ended on purpose."""
    return pathlib.Path(tempfile.gettempdir(), f"packmech-{workerinput['testrunuid']}-{workerinput['workerid']}")


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_protocol(item):
    """End a worker that holds too much, before the first test of a file."""
    stash, workerinput = item.config.stash, getattr(item.config, "workerinput", None)
    last, stash[_LAST_FILE] = stash.get(_LAST_FILE, item.path), item.path
    if workerinput is not None and last != item.path and _resident() > WORKER_LIMIT:
        _note_of(workerinput).write_text(item.nodeid)
        os._exit(0)


@pytest.hookimpl(optionalhook=True)
def pytest_handlecrashitem(crashitem, report, sched):
    """Give the test before which a worker ended on purpose to another; what else ends a worker is a failure."""
    note = _note_of(report.node.workerinput)
    if note.exists() and note.read_text() == crashitem:
        note.unlink()
        sched.mark_test_pending(crashitem)
        report.outcome = "rerun"


def pytest_report_teststatus(report):
    """Count a test that was given on as nothing: it is still to run."""
    return ("", "", "") if report.outcome == "rerun" else None


@pm.law
class Quartic(NamedTuple):
    """A user's law: u = (energy_scale / 4) xi^4 + (energy_scale / 2) xi^2."""

    energy_scale: float = 1.0

    def energy(self, distance, contact_distance):
        overlap = 1.0 - distance / contact_distance
        return self.energy_scale * (overlap**4 / 4.0 + overlap**2 / 2.0)

    def first(self, distance, contact_distance):
        overlap = 1.0 - distance / contact_distance
        return -self.energy_scale * (overlap**3 + overlap) / contact_distance

    def second(self, distance, contact_distance):
        overlap = 1.0 - distance / contact_distance
        return self.energy_scale * (3.0 * overlap**2 + 1.0) / contact_distance**2


LAWS = {
    "harmonic": pm.Harmonic(1.3),
    "hertz": pm.Hertz(0.7),
    "power 3": pm.PowerLaw(2.0, 3.0),
    "lennard-jones": pm.RepulsiveLennardJones(0.02),
    "spring": pm.LinearSpring(0.9),
    "user's": Quartic(1.1),
}


@pytest.fixture(scope="session")
def laws():
    return LAWS


@pytest.fixture(scope="session")
def golden():
    return lambda name: json.loads((GOLDEN / name).read_text())


@pytest.fixture(scope="session")
def linked():
    """Return a function: the stored packing with links and masses 1 of that name as a scene, and all that is stored."""

    def read(name):
        data = json.loads((GOLDEN / f"{name}.json").read_text())
        one = data["links"]
        links = pm.Links(*([link[key] for link in one] for key in ("i", "j", "z", "length"))) if one else None
        packing = pm.Packing(data["positions"], data["radii"], pm.Box(data["lattice_columns"]), links)
        packing = packing.replace(mass_n=np.ones(packing.particles))
        return pm.Scene(packing, (pm.Repulsion(law=pm.PowerLaw(1.0, data["w"])),)), data

    return read


@pytest.fixture(scope="session")
def random_scene():
    """Return a function: a random packing in a skewed box, no pair nearer to touching than 2e-3."""

    @functools.cache
    def make(dimension, seed, law="harmonic", particles=7):
        rng = np.random.default_rng(seed)
        for _ in range(1000):
            shape = np.eye(dimension) + 0.4 * rng.standard_normal((dimension, dimension))
            if np.linalg.det(shape) < 0.3:
                continue
            packing = pm.random_packing(
                particles, dimension=dimension, packing_fraction=1.1, sizes=pm.Uniform(ratio=2.0), box=shape, rng=rng
            )
            contacts = pm.find_contacts(packing, gap_tolerance=0.01)
            ratio = contacts.distance_c / contacts.contact_distance_c
            if ratio.min() > 0.35 and np.abs(contacts.overlap_c).min() > 2e-3:
                return pm.Scene(packing, (pm.Repulsion(law=LAWS[law]),))
        raise AssertionError("no such packing found")

    return make


@pytest.fixture(scope="session")
def rest_scene():
    """Return a function: a disordered packing at rest in its box: FIRE with the harmonic law, then Newton."""

    @functools.cache
    def make(particles, dimension, packing_fraction, seed, law="harmonic"):
        packing = pm.random_packing(
            particles,
            dimension=dimension,
            packing_fraction=packing_fraction,
            sizes=pm.Bidisperse(ratio=1.4) if dimension == 2 else pm.Monodisperse(),
            seed=seed,
        )
        relaxed = build_program(pm.Scene(packing, (pm.Repulsion(law=LAWS["harmonic"]),))).relax(
            force_tolerance=1e-7, method=pm.Fire()
        )
        scene = pm.Scene(packing.replace(position_nd=relaxed.packing.position_nd), (pm.Repulsion(law=LAWS[law]),))
        return scene.replace(packing=newton(scene, force_tolerance=1e-11, step_limit=200).packing)

    return make


@pytest.fixture(scope="session")
def stored_links():
    """Return a function: the stored packing of that name, what is stored about it, and the file's order of its links.

    What is stored by link is taken in the packing's order by that index.
    """

    def read(name):
        data = json.loads((GOLDEN / f"{name}.json").read_text())
        link = data["links"]
        links, place = None, np.empty(0, dtype=int)
        if link:
            ends = np.array([[one["i"], one["j"]] for one in link])
            assert (ends[:, 0] < ends[:, 1]).all()
            place = np.lexsort(ends.T[::-1])
            links = pm.Links(*ends.T, [one["z"] for one in link], [one["length"] for one in link])
        return pm.Packing(data["positions"], data["radii"], pm.Box(data["lattice_columns"]), links), data, place

    return read


@pytest.fixture(scope="session")
def off_lengths():
    """Return a function: a chain with angle links in a skew box, up to ten percent off its lengths."""

    def make(dimension, seed=0):
        rng = np.random.default_rng(seed)
        count = 12
        place = rng.uniform(0, 6, (count, dimension))
        i = np.concatenate([np.arange(count - 1), np.arange(count - 2)])
        j = np.concatenate([np.arange(1, count), np.arange(2, count)])
        image = rng.integers(-1, 2, (len(i), dimension))
        box = pm.Box(6 * np.eye(dimension) + rng.uniform(-1, 1, (dimension, dimension)))
        links = pm.Links(i, j, image, np.ones(len(i)))
        length = np.linalg.norm(links.vectors(place, box.lattice_dd), axis=1) * rng.uniform(0.9, 1.1, len(i))
        links = pm.Links(links.i_l, links.j_l, links.image_ld, length)
        return pm.Packing(place, np.full(count, 0.5), box, links)

    return make


@pytest.fixture(scope="session")
def chain_packing():
    """Return a function: chains of unit steps, each particle linked to those up to `reach` along."""

    def make(length, chains=1, *, dimension=2, angle=0.6, reach=1, seed=0):
        rng = np.random.default_rng(seed)
        place = np.empty((chains, length, dimension))
        for k in range(chains):
            turn = np.cumsum(rng.uniform(-angle, angle, length))
            step = np.stack([np.cos(turn), np.sin(turn)] + [np.zeros(length)] * (dimension - 2), axis=1)
            if dimension == 3:
                step += angle * rng.uniform(-1, 1, step.shape)
                step /= np.linalg.norm(step, axis=1)[:, None]
            place[k] = np.cumsum(step, axis=0)
            place[k, :, 1] += 2.5 * k
        first = np.arange(chains)[:, None] * length
        i = np.concatenate([(first + np.arange(length - u)).ravel() for u in range(1, reach + 1)])
        j = np.concatenate([(first + np.arange(u, length)).ravel() for u in range(1, reach + 1)])
        shape = np.concatenate([np.full(chains * (length - u), u > 1) for u in range(1, reach + 1)])
        place = place.reshape(-1, dimension)
        distance = np.linalg.norm(place[j] - place[i], axis=1)
        links = pm.Links(i, j, np.zeros((len(i), dimension)), distance, shape)
        box = pm.Box.cubic(1.2 * max(length, 2.5 * chains), dimension)
        return pm.Packing(place, np.full(len(place), 0.5), box, links)

    return make


@pytest.fixture(scope="session")
def rigid_cluster():
    """Return a function: one cluster at the given places with all its pairs linked."""

    def make(dimension, places):
        places = np.asarray(places, dtype=float)
        i, j = np.triu_indices(len(places), 1)
        length = np.linalg.norm(places[j] - places[i], axis=1)
        links = pm.Links(i, j, np.zeros((len(i), dimension)), length)
        return pm.Packing(places, np.full(len(places), 0.5), pm.Box.cubic(9.0, dimension), links)

    return make


@pytest.fixture(scope="session")
def dense_null():
    """Return a function: orthonormal rows that span the left null space of a matrix, by singular values."""

    def make(matrix, tolerance=1e-9):
        left, value, _ = np.linalg.svd(matrix)
        rank = int((value > tolerance * value[0]).sum()) if len(value) else 0
        return left[:, rank:].T

    return make


@pytest.fixture(scope="session")
def simplex_oracle():
    """Return the module of that name: the definition of jamming, decided by HiGHS' simplex method."""
    place = pathlib.Path(__file__).parent / "jamming" / "simplex_oracle.py"
    spec = importlib.util.spec_from_file_location("simplex_oracle", place)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture(scope="session")
def simplex_answers(simplex_oracle):
    """Return a function: whether contacts jam a packing, collectively and strictly, by that module."""
    return simplex_oracle.answers
