"""The linear system of contacts and bonds at rest: springs, dashpots and prestress, in displacements and rotations."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array, csc_array, csr_array, diags_array
from scipy.sparse.linalg import splu

from packmech.contacts import find_contacts
from packmech.effects import Bonds, Friction, is_bound, law_first, law_second, pair_first, pair_second
from packmech.scene import Scene


class Joints(NamedTuple):
    """Contacts and bonds at rest: ends, vectors, du/dr, stiffnesses and dampings along and across."""

    i_c: NDArray[np.int64]
    j_c: NDArray[np.int64]
    vector_cd: NDArray[np.float64]
    first_c: NDArray[np.float64]
    second_c: NDArray[np.float64]
    damping_c: NDArray[np.float64]
    tangential_c: NDArray[np.float64]
    tangential_damping_c: NDArray[np.float64]


def _contacts(scene: Scene, bonds: Bonds | None) -> Joints:
    found = find_contacts(scene.packing)
    keep = np.ones(len(found), dtype=bool)
    if bonds is not None:
        bonded = set(zip(bonds.i_b.tolist(), bonds.j_b.tolist(), map(tuple, bonds.image_bd.tolist()), strict=True))
        named = zip(found.i_c.tolist(), found.j_c.tolist(), map(tuple, found.image_cd.tolist()), strict=True)
        keep = np.array([one not in bonded for one in named], dtype=bool)
    pairs = [one for one in scene.effects if not is_bound(one)]
    distance, sigma = found.distance_c[keep].tolist(), found.contact_distance_c[keep].tolist()
    ends = list(zip(distance, sigma, strict=True))

    def over(what: Any) -> NDArray[np.float64]:
        return np.array([sum((what(one, r, s) for one in pairs), 0.0) for r, s in ends], dtype=np.float64)

    first = over(lambda one, r, s: pair_first(one, r, s, 0.0))
    friction = next((one for one in scene.effects if isinstance(one, Friction) and one.coefficient > 0.0), None)
    like = np.ones(len(first))
    return Joints(
        found.i_c[keep],
        found.j_c[keep],
        found.vector_cd[keep],
        first,
        over(pair_second),
        over(lambda one, r, s: pair_first(one, r, s, 1.0)) - first,
        like * (0.0 if friction is None else friction.stiffness),
        like * (0.0 if friction is None else friction.damping),
    )


def _bonded(scene: Scene, bonds: Bonds) -> Joints:
    packing = scene.packing
    vector = packing.position_nd[bonds.j_b] - packing.position_nd[bonds.i_b]
    vector = vector + bonds.image_bd @ packing.box.lattice_dd.T
    ends = list(zip(np.linalg.norm(vector, axis=1).tolist(), bonds.rest_length_b.tolist(), strict=True))
    laws = [bonds.compression if r < rest else bonds.tension for r, rest in ends]
    like = np.ones(len(bonds))
    return Joints(
        bonds.i_b,
        bonds.j_b,
        vector,
        np.array([law_first(law, *one) for law, one in zip(laws, ends, strict=True)], dtype=np.float64),
        np.array([law_second(law, *one) for law, one in zip(laws, ends, strict=True)], dtype=np.float64),
        like * bonds.damping,
        like * bonds.tangential_stiffness,
        like * bonds.tangential_damping,
    )


def find_joints(scene: Scene) -> Joints:
    """Return the contacts and bonds of a scene."""
    bonds = next((one for one in scene.effects if isinstance(one, Bonds)), None)
    touching = _contacts(scene, bonds)
    if bonds is None:
        return touching
    return Joints(*(np.concatenate(parts) for parts in zip(touching, _bonded(scene, bonds), strict=True)))


class _Rows(NamedTuple):
    """Linear maps from (u, theta) to relative displacements w (C d rows) and to slips (C d rows)."""

    apart: csr_array
    slip: csr_array


def _rows(joints: Joints, radius_n: NDArray[np.float64], spins: int) -> _Rows:
    count, d = joints.vector_cd.shape
    n = len(radius_n)
    size = n * (d + spins)
    c, a = np.repeat(np.arange(count), d), np.tile(np.arange(d), count)
    row = c * d + a
    one = np.ones(count * d)
    entry = (np.concatenate([row, row]), np.concatenate([joints.j_c[c] * d + a, joints.i_c[c] * d + a]))
    apart = coo_array((np.concatenate([one, -one]), entry), shape=(count * d, size)).tocsr()
    distance = np.linalg.norm(joints.vector_cd, axis=1)
    normal = joints.vector_cd / distance[:, None]
    across = _across(normal)
    slip = across @ apart
    if spins:
        # a theta x n, component by component; in a plane theta is about z and this is a theta (-n_y, n_x)
        turn = np.zeros((count, d, spins))
        if d == 2:
            turn[:, 0, 0], turn[:, 1, 0] = -normal[:, 1], normal[:, 0]
        else:
            for x, y, z in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
                turn[:, x, y], turn[:, x, z] = normal[:, z], -normal[:, y]
        share = 1.0 / (radius_n[joints.i_c] + radius_n[joints.j_c])
        row = np.broadcast_to((np.arange(count)[:, None] * d + np.arange(d))[:, :, None], turn.shape)
        for end in (joints.i_c, joints.j_c):
            arm = radius_n[end] * share * distance
            column = np.broadcast_to(n * d + end[:, None, None] * spins + np.arange(spins), turn.shape)
            part = (-arm[:, None, None] * turn).ravel()
            slip = slip + coo_array((part, (row.ravel(), column.ravel())), shape=slip.shape).tocsr()
    return _Rows(apart, csr_array(slip))


def _across(normal_cd: NDArray[np.float64]) -> csr_array:
    """Return the block-diagonal 1 - n n^T."""
    count, d = normal_cd.shape
    block = np.eye(d) - normal_cd[:, :, None] * normal_cd[:, None, :]
    row = np.repeat(np.arange(count * d), d)
    column = (np.repeat(np.arange(count), d * d) * d + np.tile(np.arange(d), count * d)).ravel()
    return coo_array((block.ravel(), (row, column)), shape=(count * d, count * d)).tocsr()


class LinearSystem(NamedTuple):
    """K, C, the diagonal of M, the loads of gamma and of its rate, and what gives stresses."""

    stiffness: csr_array
    damping: csr_array
    inertia: NDArray[np.float64]
    spring_load: NDArray[np.float64]
    dashpot_load: NDArray[np.float64]
    rows: _Rows
    normal_cd: NDArray[np.float64]
    apart_load: NDArray[np.float64]
    slip_load: NDArray[np.float64]


def linear_system(
    joints: Joints,
    radius_n: NDArray[np.float64],
    mass_n: NDArray[np.float64],
    drag: float,
    direction: NDArray[np.float64],
    spins: int,
) -> LinearSystem:
    """Return the system of all displacements (particle-major), then all rotations."""
    count, d = joints.vector_cd.shape
    distance = np.linalg.norm(joints.vector_cd, axis=1)
    normal = joints.vector_cd / distance[:, None]
    rows = _rows(joints, radius_n, spins)
    # what the strain itself does to a joint
    apart = (joints.vector_cd @ direction.T).ravel()
    across = _across(normal)
    slip = across @ apart
    c, a = np.repeat(np.arange(count), d), np.arange(count * d)
    along = coo_array((normal.ravel(), (c, a)), shape=(count, count * d)).tocsr()
    stretch, stretch_load = along @ rows.apart, along @ apart
    bent, bent_load = across @ rows.apart, across @ apart
    geometric = np.repeat(joints.first_c / distance, d)
    sticky, rubbing = np.repeat(joints.tangential_c, d), np.repeat(joints.tangential_damping_c, d)
    parts = ((stretch, stretch_load, joints.second_c), (bent, bent_load, geometric), (rows.slip, slip, sticky))
    stiffness = sum((m.T @ (diags_array(k) @ m) for m, _, k in parts), csr_array((rows.apart.shape[1],) * 2))
    spring_load = sum((m.T @ (k * load) for m, load, k in parts), np.zeros(rows.apart.shape[1]))
    dashpots = ((stretch, stretch_load, joints.damping_c), (rows.slip, slip, rubbing))
    inertia = np.repeat(mass_n, d)
    dashpot_load = sum((m.T @ (k * load) for m, load, k in dashpots), np.zeros(rows.apart.shape[1]))
    if spins:
        turning = np.repeat((0.5 if d == 2 else 0.4) * mass_n * radius_n**2, spins)
        inertia = np.concatenate([inertia, turning])
        skew = direction - direction.T
        spin = 0.5 * np.array([skew[1, 0]] if d == 2 else [skew[2, 1], skew[0, 2], skew[1, 0]])
        dashpot_load[len(radius_n) * d :] -= drag * turning * np.tile(spin, len(radius_n))
    damping = sum((m.T @ (diags_array(k) @ m) for m, _, k in dashpots), diags_array(drag * inertia).tocsr())
    return LinearSystem(
        csr_array(stiffness), csr_array(damping), inertia, spring_load, dashpot_load, rows, normal, apart, slip
    )


def solve_at(
    system: LinearSystem, omega: float, moves: NDArray[np.bool_], turns: NDArray[np.bool_]
) -> tuple[NDArray[np.complex128], float]:
    """Return the amplitudes of displacements and rotations over that of gamma, and the relative error of the solve."""
    free = np.flatnonzero(np.concatenate([moves, turns]))
    matrix = system.stiffness + 1j * omega * system.damping - diags_array(omega**2 * system.inertia)
    matrix = csc_array(csr_array(matrix)[free][:, free])
    load = -(system.spring_load + 1j * omega * system.dashpot_load)[free]
    answer = np.zeros(len(system.inertia), dtype=np.complex128)
    if not len(free):
        return answer, 0.0
    factor = splu(matrix)
    found = factor.solve(load)
    found += factor.solve(load - matrix @ found)
    size = float(np.abs(load).max())
    error = float(np.abs(load - matrix @ found).max()) / size if size > 0.0 else 0.0
    answer[free] = found
    return answer, error


def stress_amplitude(
    system: LinearSystem, joints: Joints, answer: NDArray[np.complex128], omega: float
) -> NDArray[np.complex128]:
    """Return V times the amplitude of force times branch vector, over that of gamma."""
    shape = joints.vector_cd.shape
    apart = (system.rows.apart @ answer + system.apart_load).reshape(shape)
    slip = (system.rows.slip @ answer + system.slip_load).reshape(shape)
    normal, distance = system.normal_cd, np.linalg.norm(joints.vector_cd, axis=1)
    stretch = (apart * normal).sum(axis=1)
    force = ((joints.second_c + 1j * omega * joints.damping_c) * stretch)[:, None] * normal
    force += (joints.first_c / distance)[:, None] * (apart - stretch[:, None] * normal)
    force += (joints.tangential_c + 1j * omega * joints.tangential_damping_c)[:, None] * slip
    pull = joints.first_c[:, None] * normal
    return np.asarray(np.einsum("ca,cb->ab", force, joints.vector_cd) + np.einsum("ca,cb->ab", pull, apart))
