"""Contacts by listing every pair and every image: the slow, obvious way that the cell list is checked against."""

import itertools
import math

import numpy as np
import pytest

import packmech as pm


def _images_within(box, reach):
    """Return all integer vectors that can bring two points of the cell within `reach` of each other.

    |z_k| <= reach / h_k + 1 for points inside the cell, h_k the distance between opposite faces.
    """
    height = 1.0 / np.sqrt((np.linalg.inv(box.lattice_dd) ** 2).sum(axis=1))
    most = np.ceil(reach / height).astype(int) + 1
    return np.array(list(itertools.product(*[range(-m, m + 1) for m in most])), dtype=np.int64)


def _list_pairs(packing, scale=1.0, skin=0.0):
    """Return the sorted (i, j, *image) of pairs with distance <= scale * sigma + skin; image for positions as given."""
    lattice, radius = packing.box.lattice_dd, packing.radius_n
    cell = np.floor(packing.position_nd @ np.linalg.inv(lattice).T).astype(np.int64)
    inside = packing.position_nd - cell @ lattice.T
    limit = scale * (radius[:, None] + radius[None, :]) + skin
    image_kd = _images_within(packing.box, limit.max())
    vector = (inside[None, :, :] - inside[:, None, :])[None] + (image_kd @ lattice.T)[:, None, None, :]
    image_k, i_k, j_k = np.nonzero((vector**2).sum(axis=-1) <= limit**2)
    # x = inside + lattice cell: the image for x differs by the cells of the two ends
    image = image_kd[image_k] - cell[j_k] + cell[i_k]
    found = [(i, j, *z) for i, j, z in zip(i_k.tolist(), j_k.tolist(), image.tolist(), strict=True)]
    return sorted(pair for pair in found if pair == _forward(pair) and (pair[0] < pair[1] or any(pair[2:])))


def _forward(triple):
    """Return the pair in its agreed direction: i < j, or i = j and the image's first nonzero component positive."""
    i, j, *image = triple
    if i < j or (i == j and next((z for z in image if z), 0) >= 0):
        return (i, j, *image)
    return (j, i, *(-z for z in image))


def _random_packing(seed, most_particles=60, work=4e5):
    """Return 1 to 60 particles in 2D or 3D, size ratio 1 to 1000, in boxes tilted up to 10 and flat up to 1:20.

    Positions lie up to three cells outside. Crowded, flat and tilted boxes hold few particles, so that listing every
    image of every pair stays affordable.
    """
    rng = np.random.default_rng(seed)
    dimension = int(rng.integers(2, 4))
    particles = int(rng.integers(1, most_particles + 1))
    shape = np.eye(dimension)
    if rng.random() < 0.7:
        shape[np.triu_indices(dimension, 1)] = rng.uniform(-10, 10) * rng.random(dimension * (dimension - 1) // 2)
    if rng.random() < 0.5:
        shape[rng.integers(dimension)] *= 10 ** rng.uniform(-math.log10(20), 0)
    if rng.random() < 0.5:  # any orientation
        shape = np.linalg.qr(rng.standard_normal((dimension, dimension)))[0] @ shape
    if rng.random() < 0.5:
        shape[:, 0] *= -1
    ratio = 10 ** rng.uniform(0, 3)
    fraction = 10 ** rng.uniform(-1, 0.3)
    while True:
        sizes = pm.Mixture(ratios=(1.0, ratio, math.sqrt(ratio)), fractions=(6, 2, 1))
        packing = pm.random_packing(
            particles, dimension=dimension, packing_fraction=fraction, sizes=sizes, box=shape, rng=rng
        )
        images = len(_images_within(packing.box, 2 * packing.radius_n.max()))
        if images * particles**2 <= work or particles == 1:
            break
        particles = max(1, min(particles - 1, int(math.sqrt(work / images))))
    outside = rng.integers(-3, 4, (particles, dimension)) @ packing.box.lattice_dd.T
    return packing.replace(position_nd=packing.position_nd + outside)


def _as_list(pairs):
    return [(int(i), int(j), *map(int, z)) for i, j, z in zip(pairs.i_c, pairs.j_c, pairs.image_cd, strict=True)]


@pytest.fixture(scope="session")
def list_pairs():
    return _list_pairs


@pytest.fixture(scope="session")
def forward():
    return _forward


@pytest.fixture(scope="session")
def difficult_packing():
    return _random_packing


@pytest.fixture(scope="session")
def as_list():
    return _as_list
