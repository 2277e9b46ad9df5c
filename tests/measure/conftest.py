"""Points that several tests of structure share."""

import gzip
import itertools
import json
import pathlib
import types

import numpy as np
import pytest

import packmech as pm

GOLDEN = pathlib.Path(__file__).parents[1] / "golden" / "jammed_systems"
BOXES = {
    2: np.array([[9.0, 2.7], [0.0, 10.0]]),
    3: np.array([[7.0, 1.9, -1.2], [0.0, 6.5, 2.1], [0.0, 0.0, 7.5]]),
}


def scattered_points(dimension, particles=120, seed=3):
    """Return points of two sizes in a tilted box, some of them cells away from it."""
    rng = np.random.default_rng(seed)
    lattice = BOXES[dimension]
    place = (rng.random((particles, dimension)) + rng.integers(-2, 3, (particles, dimension))) @ lattice.T
    return pm.Packing(place, rng.choice([0.3, 0.42], particles), pm.Box(lattice))


def image_vectors(packing, reach=3):
    """Return (N, N, I, d) vectors from i to all images of j."""
    d = packing.dimension
    shift = np.array(list(itertools.product(range(-reach, reach + 1), repeat=d))) @ packing.box.lattice_dd.T
    place, _ = packing.box.wrap(packing.position_nd)
    return (place[None, :] - place[:, None])[:, :, None] + shift


@pytest.fixture
def scattered():
    return scattered_points


@pytest.fixture
def images():
    return image_vectors


@pytest.fixture
def stored():
    """Return 80 points in a tilted box, and what a separate program with 50 digits found of them, by name."""
    points = json.loads(gzip.decompress((GOLDEN / "random_points.json.gz").read_bytes()))["2d"]
    packing = pm.Packing(points["x"], np.full(80, 0.5), pm.Box(np.array(points["H_rows"]).T))
    return types.SimpleNamespace(packing=packing, points=points)


@pytest.fixture
def lattices():
    """Return shells and orders of crystals, counted by a separate program, distances rounded to 9 digits."""
    return json.loads((GOLDEN / "lattices.json").read_text())
