"""Differences of stress and energy over small strains, each packing back in equilibrium: what moduli are held against.

They share nothing with `elastic_moduli` but energy, forces and stress, and the matrix of Newton's steps. Dense, for
small packings.
"""

import numpy as np
from numpy.typing import NDArray

import packmech as pm
from packmech.jit.blas import single_thread

# of the dense Newton iteration: its steps, the singular values that count over the largest; halvings of a strain
_NEWTON_STEPS, _RANK_TOLERANCE, _HALVINGS = 30, 1e-11, 40


def _components(dimension: int) -> list[NDArray[np.float64]]:
    """Return the orthonormal symmetric strains xx, yy, sqrt2 xy; or xx, yy, zz, sqrt2 yz, sqrt2 xz, sqrt2 xy."""
    pairs = [(a, a) for a in range(dimension)] + ([(0, 1)] if dimension == 2 else [(1, 2), (0, 2), (0, 1)])
    made = []
    for a, b in pairs:
        strain = np.zeros((dimension, dimension))
        strain[a, b] = strain[b, a] = 1.0 if a == b else 0.5**0.5
        made.append(strain)
    return made


def at_rest(scene: pm.Scene) -> pm.Scene:
    """Return the scene at the rest nearest to it in its box: Newton's method on positions and link forces, dense.

    It stops where steps no longer get smaller, which is at rounding.

    Raises
    ------
    FloatingPointError
        When the steps do not die out: the packing given was not near rest.

    """
    links = scene.packing.links
    size, held = scene.packing.position_nd.size, len(links)
    best, last = np.inf, scene
    with single_thread():
        for _ in range(_NEWTON_STEPS):
            packing = scene.packing
            push = pm.forces(scene).ravel()
            matrix = np.zeros((size + held, size + held))
            matrix[:size, :size] = pm.hessian(scene, strain="none").toarray()
            right = np.concatenate([push, np.zeros(held)])
            gradient = pm.constraint_jacobian(packing).toarray()
            matrix[:size, size:], matrix[size:, :size] = gradient, gradient.T
            vector = links.vectors(packing.position_nd, packing.box.lattice_dd)
            right[size:] = links.length_l - np.sqrt((vector**2).sum(axis=1))
            step = np.linalg.lstsq(matrix, right, rcond=_RANK_TOLERANCE)[0][:size].reshape(packing.position_nd.shape)
            largest = float(np.abs(step).max())
            if not largest < best:
                return last
            best = largest
            last = scene = scene.replace(packing=packing.replace(position_nd=packing.position_nd + step))
    raise FloatingPointError(f"steps do not die out, the last one was {best:.1e}")


def strained(scene: pm.Scene, strain_dd: NDArray[np.float64]) -> pm.Scene:
    """Return the scene strained by 1 + strain, at rest again in the strained box, its links at their lengths."""
    packing = scene.packing
    change = np.eye(packing.dimension) + strain_dd
    box = pm.Box(change @ packing.box.lattice_dd)
    return at_rest(scene.replace(packing=packing.replace(position_nd=packing.position_nd @ change.T, box=box)))


def _same_contacts(one: pm.Scene, other: pm.Scene) -> bool:
    a, b = pm.find_contacts(one.packing, gap_tolerance=0.0), pm.find_contacts(other.packing, gap_tolerance=0.0)
    return len(a) == len(b) and bool(
        (a.i_c == b.i_c).all() and (a.j_c == b.j_c).all() and (a.image_cd == b.image_cd).all()
    )


def kept_step(scene: pm.Scene, step: float) -> float:
    """Return the largest of step, step/2, step/4, ... at which no strain component makes or breaks a contact.

    Raises
    ------
    FloatingPointError
        When forty halvings are not enough: a contact just touches.

    """
    for _ in range(_HALVINGS):
        if all(
            _same_contacts(scene, strained(scene, sign * step * component))
            for component in _components(scene.packing.dimension)
            for sign in (1.0, -1.0)
        ):
            return step
        step /= 2.0
    raise FloatingPointError("a contact changes at every step")


def finite_tangent(scene: pm.Scene, step: float) -> NDArray[np.float64]:
    """Return the (s, s) change of stress with strain in Mandel components, by central differences [energy/length^d].

    Column m is (stress(+step E_m) - stress(-step E_m)) / (2 step), each packing at rest: the error falls with the
    square of the step until rounding takes over.
    """
    components = _components(scene.packing.dimension)
    columns = []
    for component in components:
        up, down = (pm.stress_tensor(strained(scene, sign * step * component)) for sign in (1.0, -1.0))
        columns.append([float((up - down).ravel() @ row.ravel()) / (2.0 * step) for row in components])
    return np.array(columns).T


def second_difference(scene: pm.Scene, step: float) -> NDArray[np.float64]:
    """Return the (s, s) second differences of the energy at rest with strain, over the volume [energy/length^d].

    Strains are 1 + step (E_a +- E_b)/2, so that off-diagonal entries come from the polarization identity.
    """
    components = _components(scene.packing.dimension)
    size, rest = len(components), pm.energy(scene)
    answer = np.zeros((size, size))

    def along(strain: NDArray[np.float64]) -> float:
        up, down = (pm.energy(strained(scene, sign * step * strain)) for sign in (1.0, -1.0))
        curvature: float = (up - 2.0 * rest + down) / step**2
        return curvature

    for a in range(size):
        answer[a, a] = along(components[a])
        for b in range(a):
            plus, minus = (along((components[a] + sign * components[b]) / 2.0) for sign in (1.0, -1.0))
            answer[a, b] = answer[b, a] = plus - minus
    answer /= scene.packing.box.volume
    return answer
