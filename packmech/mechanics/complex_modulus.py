"""The complex modulus of a packing at rest: its linear response to a small sine of strain.

Displacements u against the strained box and turns (angles times radii of gyration) are the coordinates q of one
assembly (`packmech.mechanics.assembly`), and displacement gradients E of the box its strains. Forces of contacts and
bonds are linear in both and in their rates, so that at e^{i w t} one sparse system remains,

    (K + i w C - w^2 M) q = -(k + i w c) E + drag of the rotating flow,

where K and k are assembled from springs, with the forces that they carry at rest, C and c alike from dashpots and drag,
and every coordinate has the mass of its particle. The rows of stress of the same assembly give the answer. Nothing is
stepped in time here.
"""

from __future__ import annotations

import functools
import time
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray

from packmech.calls.display import shown
from packmech.calls.honors import honors
from packmech.calls.status import shown_as
from packmech.check import instance, one_of, particle_mask, positive_array, two_axes
from packmech.contacts import Contacts
from packmech.contacts.bead_contact import turned_arms
from packmech.contacts.elements import Elements, elements_of
from packmech.contacts.fused_volume import second_moments
from packmech.contacts.shape_contacts import ShapeContacts, touching_pairs
from packmech.contacts.tangential_elements import tangential_elements
from packmech.effects import (
    BackgroundDamping,
    TouchingPair,
    acting_contacts,
    at_contact,
    at_distances,
    bonds_of,
    contact_terms,
    damps,
    friction_or_zero,
    pair_damping,
    refuse_tangential_bonds,
    refuse_unknown_to_shapes,
    roughness_of,
    single_terms,
    total_push,
    under_cap,
)
from packmech.effects.single import places_in_cell
from packmech.jit.blas import single_thread
from packmech.measure.contact_forces import rattlers_in
from packmech.measure.friction import tangential_forces, turning_forces
from packmech.mechanics.assembly import Assembled, assemble
from packmech.mechanics.network import network_among
from packmech.mechanics.relaxation import general_factors
from packmech.mechanics.system import across_bonds, closed_terms, single_second, turning_springs
from packmech.packing import Packing
from packmech.scene import Scene

MODES = ("shear", "uniaxial", "isotropic")
# largest net force over the mean force at which a scene counts as being at rest
_REST = 1e-6
# part of the mean contact force below which a contact of a rattler bears nothing
_NOTHING = 1e-9
# relative overlap at which dashpots are looked up at least
_CLOSED = 1e-9


@shown()
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
        (F, d, d) complex amplitudes of the overall (symmetric) stress over that of gamma, with what the inertia of
        turning shapes adds [energy/length^d].
    contact_stress_fdd
        (F, d, d) the same of forces times branch vectors alone, which torques leave unsymmetric.
    displacement_fnd, rotation_fnk
        (F, N, d) and (F, N, 1 or 3) complex amplitudes over that of gamma, of displacements against the box and of
        rotations; no rotations (k = 0) where nothing turns particles, and none of spheroids about their own axes where
        nothing is rough.
    residual
        Largest error of the solved systems over the size of their right sides [1].
    rest
        Largest net force at rest, or torque over the radius of gyration, over the mean force of contacts and weights
        [1].
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
    """Return the displacement gradient of a unit of strain."""
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


@dataclass(frozen=True, eq=False)
class _ViscoelasticResponse:
    """Springs and dashpots, assembled, with what the strain of the box and its rate do to the coordinates."""

    elastic: Assembled
    viscous: Assembled
    elastic_load_nq: NDArray[np.float64]
    viscous_load_nq: NDArray[np.float64]
    mass_nq: NDArray[np.float64]
    drag: float
    direction_dd: NDArray[np.float64]
    free_nq: NDArray[np.bool_]

    @functools.cached_property
    def _matrices(self) -> tuple[sp.csr_array, sp.csr_array, sp.dia_array]:
        """Stiffness, damping and masses of the coordinates that can move."""
        free_f, mass_f = self.free_nq.ravel(), self.mass_nq.ravel()
        damping = self.viscous.matrix(free_f, self.drag * mass_f)
        return self.elastic.matrix(free_f), damping, sp.diags_array(mass_f[free_f])

    def solve(self, omega: float) -> tuple[NDArray[np.complex128], float]:
        """Return (N, q) amplitudes, and the largest error of their equations over the largest load."""
        answer = np.zeros(self.free_nq.shape, dtype=complex)
        if not self.free_nq.any():
            return answer, 0.0
        stiffness, damping, mass = self._matrices
        matrix = stiffness + 1j * omega * damping - omega**2 * mass
        load = -(self.elastic_load_nq + 1j * omega * self.viscous_load_nq)[self.free_nq]
        factor = general_factors(matrix)
        found = factor.solve(load)
        found += factor.solve(load - matrix @ found)
        answer[self.free_nq] = found
        size = float(np.abs(load).max())
        return answer, float(np.abs(load - matrix @ found).max()) / size if size > 0.0 else 0.0

    def virial(self, omega: float, answer_nq: NDArray[np.complex128]) -> NDArray[np.complex128]:
        """Return the amplitude of the sum of forces times branch vectors, these as the particles alone change them."""
        everything, d = np.ones(answer_nq.size, dtype=bool), len(self.direction_dd)
        total = np.zeros(d * d, dtype=complex)
        for one, factor in ((self.elastic, 1.0), (self.viscous, 1j * omega)):
            total += factor * (one.row(everything) @ answer_nq.ravel() + one.corner_ee @ self.direction_dd.ravel())
        # forces at rest times the changes of branch vectors, summed by particles
        return np.asarray(total.reshape(d, d) + self.elastic.slope_nq[:, :d].T @ answer_nq[:, :d])


def _bearing(scene: Scene, found: Contacts | ShapeContacts) -> Contacts | ShapeContacts:
    """Return the contacts without those of rattlers that bear nothing: the first motion opens them."""
    force = np.abs(closed_terms(scene, found).first_c)
    loose = force <= _NOTHING * (float(force.mean()) if len(force) else 0.0)
    if not loose.any():
        return found
    rattling = rattlers_in(scene)
    return found.select(~(loose & (rattling[found.i_c] | rattling[found.j_c])))


def _damping(scene: Scene, found: Contacts | ShapeContacts, weight_n: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (C,) coefficients of the dashpots of contacts at rest, those that just touch a little closed."""
    acting, packing = [one for one in scene.effects if damps(one)], scene.packing
    sigma, slope, d = found.contact_distance_c, found.slope_cx, packing.dimension
    distance = np.minimum(found.distance_c, (1.0 - _CLOSED) * sigma)
    closed = at_distances(found, distance)
    terms = contact_terms(scene.effects, closed)
    inverse = (weight_n[found.i_c] + weight_n[found.j_c]) * (slope[:, :d] ** 2).sum(axis=1)
    for particle, part in zip((found.i_c, found.j_c), np.split(slope[:, d:], 2, axis=1), strict=True):
        if part.shape[1]:
            turned = np.einsum("ckt,ct->ck", packing.turn_nkt[particle], part)
            inverse += weight_n[particle] * (turned**2).sum(axis=1)
    mass = np.divide(1.0, inverse, out=np.zeros_like(inverse), where=inverse > 0.0)
    columns = (distance, sigma, np.zeros_like(sigma), *terms, mass, closed.effective_radius_c, closed.kinds_c)
    pairs = (TouchingPair(*row) for row in zip(*(column.tolist() for column in columns), strict=True))
    return np.array([sum(pair_damping(one, pair) for one in acting) for pair in pairs], dtype=float)


def _touching(
    scene: Scene, found: Contacts | ShapeContacts, weight_n: NDArray[np.float64]
) -> tuple[list[Elements], list[Elements]]:
    """Return the springs and the dashpots of contacts, those across them among these where there is friction.

    The first of each are those of the contacts; after them come those against rolling and twisting, if there are any.

    Parameters
    ----------
    scene, found
        The scene and its contacts.
    weight_n
        (N,) inverse masses, 0 for what follows the box [1/mass].

    """
    terms, friction = closed_terms(scene, found), friction_or_zero(scene.effects)
    slack, none, damping_c = (
        np.zeros_like(terms.first_c),
        np.zeros_like(found.vector_cd),
        _damping(scene, found, weight_n),
    )
    springs, dashpots = elements_of(found, terms.first_c, terms.second_c), elements_of(found, slack, damping_c)
    radius = scene.packing.radius_n
    # limits are made of the size of the normal force, of contacts that pull, too
    cap = under_cap(scene.effects, terms.first_c, found)
    friction = at_contact(friction, terms.second_c * found.push_c**2, damping_c, found.kinds_c)
    if np.any(friction.stiffness):
        across = tangential_forces(scene, found, cap).force_cd
        springs = tangential_elements(found, radius, terms.first_c, terms.second_c, across, friction.stiffness)[0]
    if np.any(friction.damping):
        dashpots = tangential_elements(found, radius, slack, damping_c, none, friction.damping)[0]
    turning = scene.effects, found, scene.packing, turning_forces(scene, found, cap)
    return [springs, *turning_springs(*turning)[0]], [dashpots, *turning_springs(*turning, normal_c=cap)[0]]


@honors(
    "repulsion kinds damping friction rolling bonds interactions gravity drag shapes",
    remarks={
        "walls": "walls follow no strain of the box",
        "held": "give those that follow the box as held_n",
    },
)
@shown_as("complex modulus")
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
    tangential springs and dashpots of contacts and bonds with the forces that they carry at rest, inertia of particles
    and of their rotations, and background damping. Rattlers that bear nothing move by themselves, though they may
    touch. Contacts with friction stick, those at the Coulomb limit too; their tangential springs are stretched as
    `Packing.tangential` says, those of bonds are slack. Weights, and potentials of single particles, act as they do at
    rest, and on places that do not move with the box: of a pile held_n names the particles that bear it. Ellipses,
    spheroids and rigid bodies turn as their contacts make them.

    Parameters
    ----------
    scene
        The scene, at rest, without rigid links, walls and `FixedParticles`.
    frequency_f
        (F,) periods in a unit of time, positive [1/time].
    mode, axes
        How the box is strained, as in `SteadyStrain`: "shear" along the first and with the gradient along the second of
        the axes, "uniaxial" along the first, "isotropic".
    held_n
        (N,) True for particles that follow the box, whatever pushes them.

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
    moving = np.ones(n, dtype=bool) if held_n is None else ~particle_mask("held_n", held_n, n)
    drag = _drag(scene)
    refuse_unknown_to_shapes(scene)
    refuse_tangential_bonds(scene.effects, packing.shapes)
    contacts = acting_contacts(touching_pairs(packing, None, second=True), scene.effects)
    contacts = _bearing(scene, contacts)
    # bonds of other shapes than discs and spheres turn none
    rough = roughness_of(scene.effects) or (not packing.shapes.has_orientations and bonds_of(scene.effects))
    turn = packing.spin_nkk if rough else packing.turn_nkt
    network = network_among(packing, contacts, np.ones(n, dtype=bool), scene.effects, turn)
    if not len(contacts) + len(network.interactions):
        raise ValueError("scene must have contacts or bonds, got none")
    turn, free = network.turn_nkt, network.free_nq & moving[:, None]
    touching, damping = _touching(scene, contacts, moving / packing.mass_n)
    springs = (touching[0], network.interactions.elements(), *across_bonds(scene.effects, network), *touching[1:])
    dashpots = (*damping, *across_bonds(scene.effects, network, dashpots=True))
    single, gradients = single_second(scene, network), np.eye(d * d).reshape(-1, d, d)
    elastic = assemble(springs, turn, d, single_nqq=single, basis_edd=gradients)
    viscous = assemble(dashpots, turn, d, basis_edd=gradients)
    rest = _rest(scene, springs[:2], elastic.slope_nq, free)
    if rest > _REST:
        raise ValueError(f"scene must be at rest, got a net force of {rest:.2g} mean contact forces")
    strain = direction.ravel()
    elastic_load, viscous_load = elastic.column_nqe @ strain, viscous.column_nqe @ strain
    if single is not None:
        # potentials stay where they are while the box takes the particles along
        place = places_in_cell(scene.effects, packing)[:, :d]
        elastic_load += np.einsum("nab,nb->na", single[:, :, :d], place @ direction.T)
    mass = np.broadcast_to(packing.mass_n[:, None], free.shape)
    viscous_load -= drag * mass * _flow(direction, turn)
    response = _ViscoelasticResponse(elastic, viscous, elastic_load, viscous_load, mass, drag, direction, free)
    omega = 2.0 * np.pi * frequency
    with single_thread():
        answers, errors = zip(*(response.solve(one) for one in omega), strict=True)
        virial: NDArray[np.complex128] = np.array([response.virial(*one) for one in zip(omega, answers, strict=True)])
    # branch vectors go with the box, forces at rest or not, and the volume grows by the trace
    at_rest = sum((one.pull_cx[:, :d].T @ one.vector_cd for one in springs), np.zeros((d, d)))
    contact = (virial + at_rest @ direction.T - np.trace(direction) * at_rest) / packing.box.volume
    overall: NDArray[np.complex128] = 0.5 * (contact + np.swapaxes(contact, 1, 2))
    motion = np.array(answers)
    rotation = np.einsum("fnk,nkt->fnt", motion[..., d:], turn)
    # of discs and spheres, whose second moments are the same along all axes, this is none
    overall += _inertia_of_turns(packing, omega[:, None, None] ** 2 * rotation) / packing.box.volume
    if mode == "isotropic":
        modulus = np.trace(overall, axis1=1, axis2=2) / d
    else:
        modulus = overall[:, axes[0], axes[1] if mode == "shear" else axes[0]]
    return ComplexModulus(
        frequency_f=frequency,
        modulus_f=np.ascontiguousarray(modulus),
        stress_fdd=overall,
        contact_stress_fdd=contact,
        displacement_fnd=np.ascontiguousarray(motion[..., :d]),
        rotation_fnk=rotation if turn.shape[1] else rotation[..., :0],
        residual=max(errors),
        rest=rest,
        seconds=time.process_time() - began,
    )


def _drag(scene: Scene) -> float:
    """Return the rate of the drag, and refuse forces on single particles that are no drag and have no energy."""
    drag = 0.0
    for one in scene.effects:
        kind = type(one)
        if isinstance(one, BackgroundDamping):
            drag += one.rate
        elif not hasattr(kind, "body_energy") and (hasattr(kind, "body_force") or hasattr(kind, "spin_drag")):
            raise ValueError(f"scene must not hold {kind.__name__}: its linear answer is not known here")
    return drag


def _rotations(dimension: int) -> NDArray[np.float64]:
    """Return the (t, d, d) displacement gradients of rotations about the axes, about z in a plane."""
    return turned_arms(np.eye(dimension)).transpose(2, 1, 0)


def _flow(direction: NDArray[np.float64], turn_nkt: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the (N, q) coordinates of particles that turn with the flow at half its vorticity, and move with it."""
    d, (n, turns, t) = len(direction), turn_nkt.shape
    spin = 0.5 * np.einsum("tab,ab->t", _rotations(d), direction)[:t]
    flow, square = np.zeros((n, d + turns)), (turn_nkt**2).sum(axis=2)
    flow[:, d:] = turn_nkt @ spin / np.where(square > 0.0, square, 1.0)
    return flow


def _inertia_of_turns(packing: Packing, turned_fnt: NDArray[np.complex128]) -> NDArray[np.complex128]:
    """Return the (F, d, d) symmetric sums over the matter of turning particles of acceleration times arm."""
    moment = packing.mass_n[:, None, None] * second_moments(packing)
    found = np.einsum("fnt,tab,nbc->fac", turned_fnt, _rotations(packing.dimension), moment, optimize=True)
    return np.asarray(0.5 * (found + np.swapaxes(found, 1, 2)))


def _rest(
    scene: Scene, springs: tuple[Elements, ...], slope_nq: NDArray[np.float64], free_nq: NDArray[np.bool_]
) -> float:
    """Return the largest net force, or torque over the radius of gyration, over the mean force at rest."""
    d, single = scene.packing.dimension, single_terms(scene.effects, scene.packing)
    net = slope_nq.copy()
    net[:, :d] -= single.force_nd
    net *= free_nq
    force = np.concatenate([np.sqrt((one.pull_cx[:, :d] ** 2).sum(axis=1)) for one in springs])
    pushed, pushes = total_push(single, ~free_nq[:, 0])
    # springs that are slack are so only to rounding
    stretched = [np.einsum("cab,cb->ca", one.stiffness_cxx[:, :d, :d], one.vector_cd) for one in springs]
    tiny = 1e-9 * float(np.sqrt((np.concatenate(stretched) ** 2).sum(axis=1)).max())
    scale = max((float(force.sum()) + pushed) / (len(force) + pushes), tiny)
    largest = max(float((part**2).sum(axis=1).max(initial=0.0)) for part in (net[:, :d], net[:, d:])) ** 0.5
    return largest / scale if scale > 0.0 else 0.0
