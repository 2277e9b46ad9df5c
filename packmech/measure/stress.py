"""Energy, forces and stress of a scene as it stands, and what its links bear."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from packmech.calls.honors import STRAINED, honors
from packmech.check import instance, one_of
from packmech.contacts import Contacts
from packmech.measure.contact_forces import resting_forces
from packmech.scene import Scene

PARTS = ("total", "contacts", "links")


def sum_forces(contacts: Contacts, force_c: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (N, d) net forces of contacts that push with force_c [force].

    Parameters
    ----------
    contacts
        The contacts.
    force_c
        (C,) normal forces, positive for repulsion.

    """
    push = contacts.normal_cd * force_c[:, None]
    net = np.empty((contacts.particles, contacts.dimension))
    for k in range(contacts.dimension):
        net[:, k] = np.bincount(contacts.j_c, push[:, k], contacts.particles)
        net[:, k] -= np.bincount(contacts.i_c, push[:, k], contacts.particles)
    return net


@honors(
    "repulsion kinds friction rolling bonds interactions gravity walls held links shapes breaking memory rough mesh",
    at_rest=True,
    link_tolerance=STRAINED,
)
def energy(scene: Scene) -> float:
    """Return the energy of all touching pairs [energy], each pair counted once, and of what acts on single particles.

    Equation 19 of Dennis (2021), with 1/w instead of its double sum. Bonds add that of their normal springs;
    their tangential springs are slack at the start of a scene. Friction adds that of the tangential springs
    as they are stretched; gravity and walls theirs, with particles at their places in the cell. Ellipses and spheroids
    have the law's energy at s (r_i + r_j), s the scale at which a pair touches, and rigid bodies that of
    each bead. On a wall every particle has half the energy of itself and its mirror image (`Walls`).

    Parameters
    ----------
    scene
        The scene.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.Packing([[0.0, 0.0], [0.9, 0.0]], [0.5, 0.5], pm.Box.cubic(3.0, 2))
    >>> round(pm.energy(pm.Scene(packing, (pm.Repulsion(),))), 12)
    0.005

    """
    instance("scene", scene, Scene)
    return resting_forces(scene).energy


@honors(
    "repulsion kinds friction rolling bonds interactions gravity walls held links shapes breaking memory rough mesh",
    at_rest=True,
    link_tolerance=STRAINED,
)
def forces(scene: Scene) -> NDArray[np.float64]:
    """Return the (N, d) net forces of the contacts on the particles [force]; equation 21 of Dennis (2021).

    What rigid links add to them is not counted (`link_tension` gives it). With friction those of the tangential springs
    are (`contact_forces` has them one by one), with gravity and walls theirs; particles that are held have none.

    Parameters
    ----------
    scene
        The scene.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.Packing([[0.0, 0.0], [0.5, 0.0]], [0.5, 0.5], pm.Box.cubic(3.0, 2))
    >>> pm.forces(pm.Scene(packing, (pm.Repulsion(),)))[1].tolist()
    [0.5, 0.0]

    """
    instance("scene", scene, Scene)
    return resting_forces(scene).force_nd


@honors(
    "repulsion kinds friction rolling bonds interactions gravity walls held links shapes breaking memory rough",
    at_rest=True,
    link_tolerance=STRAINED,
)
def stress_tensor(scene: Scene, *, parts: str = "total") -> NDArray[np.float64]:
    """Return the (d, d) Cauchy stress [energy/length^d], tension positive, row = force component.

    sigma_ab = (1/V) (sum over contacts of u' r n_a n_b + sum over links of t r n_a n_b) with the link tensions t: the
    strain derivative of the relaxed energy over the volume. With friction
    contacts add their tangential force times the vector from center to center. Pushes of walls and other forces on
    single particles have no part in it: it is the stress that contacts between particles carry.

    It is symmetric where contacts balance torques, as those of discs and spheres without friction always do. In general
    V (sigma_yx - sigma_xy) is the sum of the torques of the contacts about the centers. Of a pile at rest that is what
    its walls turn the other way, so that the stress of ellipses, rigid bodies, or discs with friction on a wall is not
    symmetric, nor is any away from rest.

    Parameters
    ----------
    scene
        The scene; with rigid links it should be at rest (see `link_tension`).
    parts
        "total"; "contacts" alone, which is how Dennis (2021) prints it and not what a wall would feel where there
        are links; or "links" alone.

    Raises
    ------
    TypeError, ValueError
        If it is no scene or the name is unknown.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.lattice_packing("triangular", repeats=(2, 2), relative_overlap=0.01)
    >>> stress = pm.stress_tensor(pm.Scene(packing, (pm.Repulsion(),)))
    >>> bool(abs(stress[0, 0] + 3**0.5 * 0.01 / 0.99) < 1e-14)
    True

    """
    one_of("parts", parts, PARTS)
    instance("scene", scene, Scene)
    found = resting_forces(scene)
    if parts == "total":
        return found.stress_dd
    return found.contact_stress_dd if parts == "contacts" else found.link_stress_dd


@honors(
    "repulsion kinds friction rolling bonds interactions gravity walls held links shapes breaking memory rough",
    at_rest=True,
    link_tolerance=STRAINED,
)
def pressure(scene: Scene, *, parts: str = "total") -> float:
    """Return the pressure -trace(stress)/d [energy/length^d].

    Parameters
    ----------
    scene, parts
        As in `stress_tensor`: with links, their tension counts unless "contacts" is asked for.

    Raises
    ------
    TypeError, ValueError
        As `stress_tensor`.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.lattice_packing("triangular", repeats=(2, 2), relative_overlap=0.01)
    >>> round(pm.pressure(pm.Scene(packing, (pm.Repulsion(),))), 10)
    0.0174954627

    """
    # 0 - trace, so that a scene without contacts has pressure 0 and not -0
    return (0.0 - float(np.trace(stress_tensor(scene, parts=parts)))) / scene.packing.dimension


@honors(
    "repulsion kinds friction rolling bonds interactions gravity walls held links breaking memory rough",
    at_rest=True,
    link_tolerance=STRAINED,
)
def link_tension(scene: Scene) -> NDArray[np.float64]:
    """Return the (L,) forces in the rigid links [force], tension positive, in the order of `packing.links`.

    They are the multipliers t that make |grad U + sum of t grad(length)| least over the positions of all particles that
    are not held, weights, walls and tangential springs in U; for a packing at rest the sum vanishes and they are exact.
    Where links depend on each other (more links than a shape needs) the smallest such set is given.

    Parameters
    ----------
    scene
        The scene; without links the answer is empty.

    Raises
    ------
    TypeError
        If it is no scene.

    Examples
    --------
    >>> import packmech as pm
    >>> links = pm.Links([0, 1], [1, 2], [[0, 0], [1, 0]], [1.0, 1.0])
    >>> chain = pm.Packing([[0.0, 0.0], [1.0, 0.0], [-0.9, 0.0]], [0.5] * 3, pm.Box.cubic(2.9, 2), links)
    >>> pm.link_tension(pm.Scene(chain, (pm.Repulsion(),))).round(12).tolist()
    [-0.1, -0.1]

    """
    instance("scene", scene, Scene)
    return tension_of(scene)


def tension_of(scene: Scene) -> NDArray[np.float64]:
    """Return the (L,) forces in the rigid links, whatever else the scene holds (`link_tension`)."""
    return resting_forces(scene).tension_l
