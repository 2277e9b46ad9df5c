"""The complex modulus of a network of springs and dashpots at rest: its linear answer to a small sine of strain.

Displacements u against the strained box and rotations theta obey m u'' = f and I theta'' = T, with the forces and
torques of contacts and bonds linear in u, theta, gamma and their rates. For e^{i w t} that is one sparse system,

    (K + i w C - w^2 M) q = -(k + i w c) gamma + drag of the turning flow,

with K and k from springs and prestress, C and c from dashpots and drag. Nothing is stepped in time here.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.check import instance, integer, one_of, positive_array
from packmech.compiled import single_thread
from packmech.effects import BackgroundDamping, Bonds, Friction, Gravity
from packmech.mechanics.linear_response import Joints, find_joints, linear_system, solve_at, stress_amplitude
from packmech.packing import without_links
from packmech.scene import Scene

MODES = ("shear", "uniaxial", "isotropic")
# largest net force over the mean contact force at which a scene counts as being at rest
_REST = 1e-6


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
    if not isinstance(axes, tuple | list) or len(axes) != 2:
        raise TypeError(f"axes must be two axes, got {axes!r}")
    a, b = (integer("axes", one, at_least=0, at_most=dimension - 1) for one in axes)
    matrix = np.zeros((dimension, dimension))
    if mode == "shear":
        if a == b:
            raise ValueError(f"axes must be two different axes, got {axes}")
        matrix[a, b] = 1.0
    elif mode == "uniaxial":
        matrix[a, a] = 1.0
    else:
        matrix[:] = np.eye(dimension)
    return matrix


def complex_modulus(
    scene: Scene,
    frequency_f: ArrayLike,
    *,
    mode: str = "shear",
    axes: tuple[int, int] = (0, 1),
    mass_n: ArrayLike | None = None,
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
    mass_n
        (N,) masses; as in `simulate` unless given.
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
    without_links("scene.packing", packing)
    n, d = packing.particles, packing.dimension
    frequency = positive_array("frequency_f", frequency_f, shape=(None,), what="frequency")
    direction = _direction(mode, axes, d)
    if mass_n is None:
        mass = (packing.diameter_n / packing.reference_diameter) ** d
    else:
        mass = positive_array("mass_n", mass_n, shape=(n,))
    free = _free(held_n, n)
    drag = _drag(scene)
    joints = find_joints(scene)
    if not len(joints.i_c):
        raise ValueError("scene must have contacts or bonds, got none")
    rest = _rest(joints, free)
    if rest > _REST:
        raise ValueError(f"scene must be at rest, got a net force of {rest:.2g} mean contact forces")
    turns = any(isinstance(one, Friction | Bonds) for one in scene.effects)
    spins = 0 if not turns else 1 if d == 2 else 3
    with single_thread():
        system = linear_system(joints, packing.radius_n, mass, drag, direction, spins)
        solved = [solve_at(system, 2.0 * np.pi * one, np.repeat(free, d), np.repeat(free, spins)) for one in frequency]
        sums: NDArray[np.complex128] = np.array(
            [stress_amplitude(system, joints, q, 2.0 * np.pi * f) for (q, _), f in zip(solved, frequency, strict=True)]
        )
    # per volume; the volume itself grows by the trace
    contact: NDArray[np.complex128] = (sums - np.trace(direction) * _rest_stress(joints)) / packing.box.volume
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
        elif hasattr(type(one), "body_force") and not isinstance(one, Gravity):
            raise ValueError(f"scene must not hold {type(one).__name__}: its linear answer is not known here")
    return drag


def _rest(joints: Joints, free: NDArray[np.bool_]) -> float:
    force = joints.vector_cd * (joints.first_c / np.linalg.norm(joints.vector_cd, axis=1))[:, None]
    net = np.zeros((len(free), force.shape[1]))
    np.add.at(net, joints.i_c, force)
    np.add.at(net, joints.j_c, -force)
    if not free.any():
        return 0.0
    # springs that are slack are so only to rounding
    tiny = 1e-9 * float((joints.second_c * np.linalg.norm(joints.vector_cd, axis=1)).max())
    scale = max(float(np.abs(joints.first_c).mean()), tiny)
    return float(np.sqrt((net[free] ** 2).sum(axis=1)).max()) / scale if scale > 0.0 else 0.0


def _rest_stress(joints: Joints) -> NDArray[np.float64]:
    pull = joints.first_c / np.linalg.norm(joints.vector_cd, axis=1)
    return np.asarray(np.einsum("c,ca,cb->ab", pull, joints.vector_cd, joints.vector_cd))
