"""Energy, forces and stress of a scene as it stands, and what its links bear."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from packmech.check import instance, one_of
from packmech.constraints.factor import ConstraintFactor
from packmech.contacts import Contacts, find_contacts
from packmech.effects import contact_terms, held_particles, single_terms, total_push
from packmech.honors import STRAINED, honors
from packmech.jit.blas import single_thread
from packmech.measure.bonds import bonded_pairs, joined, unbonded
from packmech.measure.friction import friction_of, sum_tangential, tangential_forces
from packmech.measure.shaped import shape_forces
from packmech.scene import Scene

PARTS = ("total", "contacts", "links")


def _terms(scene: Scene) -> tuple[Contacts, NDArray[np.float64], NDArray[np.float64]]:
    """Return contacts and bonds, their energies, and the derivatives of these by distance."""
    instance("scene", scene, Scene)
    contacts = unbonded(find_contacts(scene.packing), scene.effects)
    terms = contact_terms(scene.effects, contacts.distance_c, contacts.contact_distance_c)
    pairs, terms = joined(contacts, terms, bonded_pairs(scene.effects, scene.packing))
    return pairs, terms.energy_c, terms.first_c


def _shaped(scene: Scene) -> bool:
    """Whether the particles of a scene are no discs or spheres."""
    instance("scene", scene, Scene)
    return scene.packing.shapes is not None


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
    "repulsion friction bonds gravity walls held links shapes",
    at_rest=True,
    apart="friction+shapes",
    link_tolerance=STRAINED,
)
def energy(scene: Scene) -> float:
    """Return the energy of all touching pairs [energy], each pair counted once, and of what acts on single particles.

    Equation 19 of the polymer source, with 1/w instead of its double sum. Bonds add that of their normal springs;
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
    if _shaped(scene):
        return shape_forces(scene).energy
    contacts, energy_c, first = _terms(scene)
    whole = float(np.add.reduce(energy_c))
    if friction_of(scene) is not None:
        whole += float(np.add.reduce(tangential_forces(scene, contacts, -first).energy_c))
    return whole + float(np.add.reduce(single_terms(scene.effects, scene.packing).energy_n))


@honors(
    "repulsion friction bonds gravity walls held links shapes",
    at_rest=True,
    apart="friction+shapes",
    link_tolerance=STRAINED,
)
def forces(scene: Scene) -> NDArray[np.float64]:
    """Return the (N, d) net forces of the contacts on the particles [force]; equation 21 of the polymer source.

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
    if _shaped(scene):
        return shape_forces(scene).forces()
    contacts, _, first = _terms(scene)
    return _net(scene, contacts, first)


def _free(scene: Scene) -> NDArray[np.bool_] | None:
    """Return (N,) which particles are not held; None where none is."""
    held = held_particles(scene.effects, scene.packing.particles)
    return None if held is None else ~held


def _net(scene: Scene, contacts: Contacts, first_c: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (N, d) net forces, those of links left out."""
    net = sum_forces(contacts, -first_c)
    if friction_of(scene) is not None:
        net += sum_tangential(contacts, tangential_forces(scene, contacts, -first_c).force_cd)
    net += single_terms(scene.effects, scene.packing).force_nd
    held = held_particles(scene.effects, scene.packing.particles)
    if held is not None:
        net[held] = 0.0
    return net


@honors(
    "repulsion friction bonds gravity walls held links shapes",
    at_rest=True,
    apart="friction+shapes",
    link_tolerance=STRAINED,
)
def stress_tensor(scene: Scene, *, parts: str = "total") -> NDArray[np.float64]:
    """Return the (d, d) Cauchy stress [energy/length^d], tension positive, row = force component.

    sigma_ab = (1/V) (sum over contacts of u' r n_a n_b + sum over links of t r n_a n_b) with the link tensions t: the
    strain derivative of the relaxed energy over the volume (section 8 of the corrected specification). With friction
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
        "total"; "contacts" alone, which is how the polymer source prints it and not what a wall would feel where there
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
    if _shaped(scene):
        whole = shape_forces(scene).stress(scene.packing.box.volume)
        return whole if parts != "links" else np.zeros_like(whole)
    contacts, _, first = _terms(scene)
    packing = scene.packing
    if packing.links is None:
        none = np.zeros((packing.dimension, packing.dimension))
        return none if parts == "links" else _whole_stress(scene, contacts, first)
    stress = np.zeros((packing.dimension, packing.dimension))
    if parts != "links":
        stress += _whole_stress(scene, contacts, first)
    if parts != "contacts":
        with single_thread():
            links = ConstraintFactor(packing)
            tension = links.multipliers(-_net(scene, contacts, first), _free(scene))
        stress += contact_stress(links.pairs, tension, packing.box.volume)
    return stress


def _whole_stress(scene: Scene, contacts: Contacts, first_c: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (d, d) stress of contacts, friction included."""
    volume = scene.packing.box.volume
    stress = contact_stress(contacts, first_c, volume)
    if friction_of(scene) is not None:
        vector = contacts.normal_cd * contacts.distance_c[:, None]
        stress += tangential_forces(scene, contacts, -first_c).force_cd.T @ vector / volume
    return stress


def contact_stress(contacts: Contacts, first_c: NDArray[np.float64], volume: float) -> NDArray[np.float64]:
    """Return the (d, d) stress of contacts with radial derivatives first_c [force], tension positive.

    Parameters
    ----------
    contacts
        The contacts.
    first_c
        (C,) du/dr, negative for repulsion.
    volume
        Volume of the box [length^d].

    """
    weighted = contacts.normal_cd * (first_c * contacts.distance_c)[:, None]
    stress: NDArray[np.float64] = np.einsum("ca,cb->ab", weighted, contacts.normal_cd) / volume
    return stress


@honors(
    "repulsion friction bonds gravity walls held links shapes",
    at_rest=True,
    apart="friction+shapes",
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


def force_balance(scene: Scene) -> tuple[float, float]:
    """Return the largest net force and the mean contact force [force]; both 0 when nothing touches.

    Their ratio is the residual of a run. Rigid links bear what they can of the net forces. Forces on single particles
    that are free count with those of contacts, and torques over radii of gyration on particles with shapes.
    """
    packing = scene.packing
    if packing.shapes is not None:
        return shape_forces(scene).balance(packing.shapes.turn_basis(packing.radius_n))
    contacts, _, first = _terms(scene)
    held = held_particles(scene.effects, scene.packing.particles)
    push, pushes = total_push(single_terms(scene.effects, scene.packing), held)
    count = len(contacts) + pushes
    if not count:
        return 0.0, 0.0
    net, free = _net(scene, contacts, first), _free(scene)
    if scene.packing.links is not None:
        with single_thread():
            links = ConstraintFactor(scene.packing)
            net += sum_forces(links.pairs, -links.multipliers(-net, free))
        if free is not None:
            net[~free] = 0.0
    mean = (np.abs(first).sum() + push) / count
    return float(np.sqrt((net**2).sum(axis=1)).max()), float(mean)


@honors("repulsion friction bonds gravity walls held links", at_rest=True, link_tolerance=STRAINED)
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
    if scene.packing.links is None:
        return np.zeros(0)
    contacts, _, first = _terms(scene)
    with single_thread():
        return ConstraintFactor(scene.packing).multipliers(-_net(scene, contacts, first), _free(scene))
