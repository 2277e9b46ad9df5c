"""Scenes that facts about mechanics are stated on."""

import functools
import json
import pathlib
from typing import NamedTuple

import numpy as np
import pytest

import packmech as pm
from packmech.dynamics.polish import newton
from packmech.dynamics.program import build_program

GOLDEN = pathlib.Path(__file__).parents[1] / "golden"


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
    """Return a function: the stored packing with links of that name as a scene, and all that is stored about it."""

    def read(name):
        data = json.loads((GOLDEN / f"{name}.json").read_text())
        one = data["links"]
        links = pm.Links(*([link[key] for link in one] for key in ("i", "j", "z", "length"))) if one else None
        packing = pm.Packing(data["positions"], data["radii"], pm.Box(data["lattice_columns"]), links)
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
        relaxed = build_program(pm.Scene(packing, (pm.Repulsion(law=LAWS["harmonic"]),))).fire(force_tolerance=1e-7)
        scene = pm.Scene(packing.replace(position_nd=relaxed.position_nd), (pm.Repulsion(law=LAWS[law]),))
        return scene.replace(packing=newton(scene, force_tolerance=1e-11, step_limit=200).packing)

    return make
