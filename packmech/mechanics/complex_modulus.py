"""The complex modulus of a network of springs and dashpots at rest: its linear answer to a small sine of strain.

Displacements u against the strained box and rotations theta obey m u'' = f and I theta'' = T, with the forces and
torques of contacts and bonds linear in u, theta, gamma and their rates. For e^{i w t} that is one sparse system,

    (K + i w C - w^2 M) q = -(k + i w c) gamma + drag of the turning flow,

with K and k from springs and prestress, C and c from dashpots and drag. Nothing is stepped in time here.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.sparse import coo_array, csc_array, csr_array, diags_array
from scipy.sparse.linalg import splu

from packmech.check import instance, one_of, positive_array, two_axes
from packmech.contacts import find_contacts
from packmech.effects import (
    BackgroundDamping,
    Bonds,
    Friction,
    is_bound,
    law_first,
    law_second,
    pair_first,
    pair_second,
)
from packmech.honors import honors
from packmech.jit.blas import single_thread
from packmech.scene import Scene

MODES = ("shear", "uniaxial", "isotropic")
# largest net force over the mean contact force at which a scene counts as being at rest
_REST = 1e-6


class PairSprings(NamedTuple):
    """Contacts and bonds at rest: ends, vectors, du/dr, stiffnesses and dampings along and across."""

    i_c: NDArray[np.int64]
    j_c: NDArray[np.int64]
    vector_cd: NDArray[np.float64]
    first_c: NDArray[np.float64]
    second_c: NDArray[np.float64]
    damping_c: NDArray[np.float64]
    tangential_c: NDArray[np.float64]
    tangential_damping_c: NDArray[np.float64]


def _contacts(scene: Scene, bonds: Bonds | None) -> PairSprings:
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
    return PairSprings(
        found.i_c[keep],
        found.j_c[keep],
        found.vector_cd[keep],
        first,
        over(pair_second),
        over(lambda one, r, s: pair_first(one, r, s, 1.0)) - first,
        like * (0.0 if friction is None else friction.stiffness),
        like * (0.0 if friction is None else friction.damping),
    )


def _bonded(scene: Scene, bonds: Bonds) -> PairSprings:
    packing = scene.packing
    vector = packing.position_nd[bonds.j_b] - packing.position_nd[bonds.i_b]
    vector = vector + bonds.image_bd @ packing.box.lattice_dd.T
    ends = list(zip(np.linalg.norm(vector, axis=1).tolist(), bonds.rest_length_b.tolist(), strict=True))
    laws = [bonds.compression if r < rest else bonds.tension for r, rest in ends]
    like = np.ones(len(bonds))
    return PairSprings(
        bonds.i_b,
        bonds.j_b,
        vector,
        np.array([law_first(law, *one) for law, one in zip(laws, ends, strict=True)], dtype=np.float64),
        np.array([law_second(law, *one) for law, one in zip(laws, ends, strict=True)], dtype=np.float64),
        like * bonds.damping,
        like * bonds.tangential_stiffness,
        like * bonds.tangential_damping,
    )


def find_springs(scene: Scene) -> PairSprings:
    """Return the contacts and bonds of a scene."""
    bonds = next((one for one in scene.effects if isinstance(one, Bonds)), None)
    touching = _contacts(scene, bonds)
    if bonds is None:
        return touching
    return PairSprings(*(np.concatenate(parts) for parts in zip(touching, _bonded(scene, bonds), strict=True)))


class _Rows(NamedTuple):
    """Linear maps from (u, theta) to relative displacements w (C d rows) and to slips (C d rows)."""

    apart: csr_array
    slip: csr_array


def _rows(springs: PairSprings, radius_n: NDArray[np.float64], spins: int) -> _Rows:
    count, d = springs.vector_cd.shape
    n = len(radius_n)
    size = n * (d + spins)
    c, a = np.repeat(np.arange(count), d), np.tile(np.arange(d), count)
    row = c * d + a
    one = np.ones(count * d)
    entry = (np.concatenate([row, row]), np.concatenate([springs.j_c[c] * d + a, springs.i_c[c] * d + a]))
    apart = coo_array((np.concatenate([one, -one]), entry), shape=(count * d, size)).tocsr()
    distance = np.linalg.norm(springs.vector_cd, axis=1)
    normal = springs.vector_cd / distance[:, None]
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
        share = 1.0 / (radius_n[springs.i_c] + radius_n[springs.j_c])
        row = np.broadcast_to((np.arange(count)[:, None] * d + np.arange(d))[:, :, None], turn.shape)
        for end in (springs.i_c, springs.j_c):
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
    springs: PairSprings,
    radius_n: NDArray[np.float64],
    mass_n: NDArray[np.float64],
    drag: float,
    direction: NDArray[np.float64],
    spins: int,
) -> LinearSystem:
    """Return the system of all displacements (particle-major), then all rotations."""
    count, d = springs.vector_cd.shape
    distance = np.linalg.norm(springs.vector_cd, axis=1)
    normal = springs.vector_cd / distance[:, None]
    rows = _rows(springs, radius_n, spins)
    # what the strain itself does to a spring
    apart = (springs.vector_cd @ direction.T).ravel()
    across = _across(normal)
    slip = across @ apart
    c, a = np.repeat(np.arange(count), d), np.arange(count * d)
    along = coo_array((normal.ravel(), (c, a)), shape=(count, count * d)).tocsr()
    stretch, stretch_load = along @ rows.apart, along @ apart
    bent, bent_load = across @ rows.apart, across @ apart
    geometric = np.repeat(springs.first_c / distance, d)
    sticky, rubbing = np.repeat(springs.tangential_c, d), np.repeat(springs.tangential_damping_c, d)
    parts = ((stretch, stretch_load, springs.second_c), (bent, bent_load, geometric), (rows.slip, slip, sticky))
    stiffness = sum((m.T @ (diags_array(k) @ m) for m, _, k in parts), csr_array((rows.apart.shape[1],) * 2))
    spring_load = sum((m.T @ (k * load) for m, load, k in parts), np.zeros(rows.apart.shape[1]))
    dashpots = ((stretch, stretch_load, springs.damping_c), (rows.slip, slip, rubbing))
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
    system: LinearSystem, springs: PairSprings, answer: NDArray[np.complex128], omega: float
) -> NDArray[np.complex128]:
    """Return V times the amplitude of force times branch vector, over that of gamma."""
    shape = springs.vector_cd.shape
    apart = (system.rows.apart @ answer + system.apart_load).reshape(shape)
    slip = (system.rows.slip @ answer + system.slip_load).reshape(shape)
    normal, distance = system.normal_cd, np.linalg.norm(springs.vector_cd, axis=1)
    stretch = (apart * normal).sum(axis=1)
    force = ((springs.second_c + 1j * omega * springs.damping_c) * stretch)[:, None] * normal
    force += (springs.first_c / distance)[:, None] * (apart - stretch[:, None] * normal)
    force += (springs.tangential_c + 1j * omega * springs.tangential_damping_c)[:, None] * slip
    pull = springs.first_c[:, None] * normal
    return np.asarray(np.einsum("ca,cb->ab", force, springs.vector_cd) + np.einsum("ca,cb->ab", pull, apart))


@dataclass(frozen=True, eq=False)
class ComplexModulus:
    """The linear answer of a scene to a sine of strain at several frequencies.

    Attributes
    ----------
    frequency_f
        (F,) periods in a unit of time [1/time].
    modulus_f
        (F,) complex moduli G' + i G'' of the component of the stress that answers to the strain (for "isotropic" the
        mean of the diagonal) [energy/length^d].
    stress_fdd
        (F, d, d) complex amplitudes of the overall (symmetric) stress over that of gamma [energy/length^d].
    contact_stress_fdd
        (F, d, d) the same of forces times branch vectors alone, which torques leave unsymmetric.
    displacement_fnd, rotation_fnk
        (F, N, d) and (F, N, 1 or 3) complex amplitudes over that of gamma, of displacements against the box and of
        rotations; no rotations (k = 0) where particles do not turn.
    residual
        Largest error of the solved systems over the size of their right sides [1].
    rest
        Largest net force at rest over the mean contact force [1].
    seconds
        CPU time.

    """

    frequency_f: NDArray[np.float64]
    modulus_f: NDArray[np.complex128]
    stress_fdd: NDArray[np.complex128]
    contact_stress_fdd: NDArray[np.complex128]
    displacement_fnd: NDArray[np.complex128]
    rotation_fnk: NDArray[np.complex128]
    residual: float
    rest: float
    seconds: float

    @property
    def storage_f(self) -> NDArray[np.float64]:
        """G' [energy/length^d]."""
        return np.asarray(self.modulus_f.real)

    @property
    def loss_f(self) -> NDArray[np.float64]:
        """G'' [energy/length^d]."""
        return np.asarray(self.modulus_f.imag)


def _direction(mode: str, axes: tuple[int, int], dimension: int) -> NDArray[np.float64]:
    one_of("mode", mode, MODES)
    a, b = two_axes("axes", axes, dimension=dimension, different=mode == "shear")
    matrix = np.zeros((dimension, dimension))
    if mode == "shear":
        matrix[a, b] = 1.0
    elif mode == "uniaxial":
        matrix[a, a] = 1.0
    else:
        matrix[:] = np.eye(dimension)
    return matrix


@honors("repulsion damping friction bonds drag", shaped="pm.oscillatory_shear")
def complex_modulus(
    scene: Scene,
    frequency_f: ArrayLike,
    *,
    mode: str = "shear",
    axes: tuple[int, int] = (0, 1),
    held_n: ArrayLike | None = None,
) -> ComplexModulus:
    """Return G' + i G'' of a scene at rest for strains so small that nothing opens, closes or slides.

    What `oscillatory_shear` tends to for small amplitudes and time steps, solved in the frequency domain: normal and
    tangential springs and dashpots of contacts and bonds with the prestress they bear, inertia of particles and of
    their rotations, and background damping. Contacts with friction stick. Tangential springs are slack at rest.

    Parameters
    ----------
    scene
        The scene, at rest, without rigid links and walls.
    frequency_f
        (F,) periods in a unit of time, positive [1/time].
    mode, axes
        How the box is strained, as in `SteadyStrain`: "shear" along the first and with the gradient along the second of
        the axes, "uniaxial" along the first, "isotropic".
    held_n
        (N,) True for particles that follow the box.

    Raises
    ------
    TypeError, ValueError
        If an argument is wrong, an effect has no linear answer here, or the scene is not at rest.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.lattice_packing("triangular", repeats=(3, 3))
    >>> bonds = pm.bond_contacts(packing, tangential_stiffness=0.5, damping=2.0, gap_tolerance=1e-9)
    >>> found = pm.complex_modulus(pm.Scene(packing, (bonds,)), [0.1])
    >>> found.modulus_f.round(6).tolist()  # sqrt(3)/4 (k_n + k_t + i w c_n)
    [(0.649519+0.54414j)]

    """
    began = time.process_time()
    instance("scene", scene, Scene)
    packing = scene.packing
    n, d = packing.particles, packing.dimension
    frequency = positive_array("frequency_f", frequency_f, shape=(None,), what="frequency")
    direction = _direction(mode, axes, d)
    free = _free(held_n, n)
    drag = _drag(scene)
    springs = find_springs(scene)
    if not len(springs.i_c):
        raise ValueError("scene must have contacts or bonds, got none")
    rest = _rest(springs, free)
    if rest > _REST:
        raise ValueError(f"scene must be at rest, got a net force of {rest:.2g} mean contact forces")
    turns = any(isinstance(one, Friction | Bonds) for one in scene.effects)
    spins = 0 if not turns else 1 if d == 2 else 3
    with single_thread():
        system = linear_system(springs, packing.radius_n, packing.mass_n, drag, direction, spins)
        solved = [solve_at(system, 2.0 * np.pi * one, np.repeat(free, d), np.repeat(free, spins)) for one in frequency]
        sums: NDArray[np.complex128] = np.array(
            [stress_amplitude(system, springs, q, 2.0 * np.pi * f) for (q, _), f in zip(solved, frequency, strict=True)]
        )
    # per volume; the volume itself grows by the trace
    contact: NDArray[np.complex128] = (sums - np.trace(direction) * _rest_stress(springs)) / packing.box.volume
    overall: NDArray[np.complex128] = 0.5 * (contact + np.swapaxes(contact, 1, 2))
    if mode == "isotropic":
        modulus = np.trace(overall, axis1=1, axis2=2) / d
    else:
        modulus = overall[:, axes[0], axes[1] if mode == "shear" else axes[0]]
    answer = np.array([q for q, _ in solved])
    return ComplexModulus(
        frequency_f=frequency,
        modulus_f=np.ascontiguousarray(modulus),
        stress_fdd=overall,
        contact_stress_fdd=contact,
        displacement_fnd=answer[:, : n * d].reshape(len(frequency), n, d),
        rotation_fnk=answer[:, n * d :].reshape(len(frequency), n, spins),
        residual=max(error for _, error in solved),
        rest=rest,
        seconds=time.process_time() - began,
    )


def _free(held_n: ArrayLike | None, particles: int) -> NDArray[np.bool_]:
    if held_n is None:
        return np.ones(particles, dtype=bool)
    held = np.asarray(held_n)
    if held.dtype != bool:
        raise TypeError(f"held_n must be True or False for each particle, got {held_n!r}")
    if held.shape != (particles,):
        raise ValueError(f"held_n must have shape ({particles},), got {held.shape}")
    return ~held


def _drag(scene: Scene) -> float:
    drag = 0.0
    for one in scene.effects:
        if isinstance(one, BackgroundDamping):
            drag += one.rate
        elif hasattr(type(one), "body_force"):
            raise ValueError(f"scene must not hold {type(one).__name__}: its linear answer is not known here")
    return drag


def _rest(springs: PairSprings, free: NDArray[np.bool_]) -> float:
    force = springs.vector_cd * (springs.first_c / np.linalg.norm(springs.vector_cd, axis=1))[:, None]
    net = np.zeros((len(free), force.shape[1]))
    np.add.at(net, springs.i_c, force)
    np.add.at(net, springs.j_c, -force)
    if not free.any():
        return 0.0
    # springs that are slack are so only to rounding
    tiny = 1e-9 * float((springs.second_c * np.linalg.norm(springs.vector_cd, axis=1)).max())
    scale = max(float(np.abs(springs.first_c).mean()), tiny)
    return float(np.sqrt((net[free] ** 2).sum(axis=1)).max()) / scale if scale > 0.0 else 0.0


def _rest_stress(springs: PairSprings) -> NDArray[np.float64]:
    pull = springs.first_c / np.linalg.norm(springs.vector_cd, axis=1)
    return np.asarray(np.einsum("c,ca,cb->ab", pull, springs.vector_cd, springs.vector_cd))
