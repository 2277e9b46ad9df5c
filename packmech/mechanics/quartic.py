"""Quartic modes: motions that stretch no contact to first order, held by the contact forces alone.

Packings of ellipses have fewer contacts than degrees of freedom. What is missing is made up by motions in the null
space of the stiffness: their energy is the prestress times the square of the amplitude, which vanishes with the
pressure, and beyond it grows with the fourth power (Mailman et al., Phys. Rev. Lett. 102, 255501 (2009)). A rigid body
that is touched at one bead alone turns about that at no cost at any amplitude: that is no such mode.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.calls.display import shown
from packmech.calls.honors import honors
from packmech.calls.status import shown_as
from packmech.check import STRAINS, BoxStrain, finite_array, given_shape, instance, one_of, real
from packmech.contacts import Contacts
from packmech.contacts.bead_contact import turned_arms
from packmech.contacts.shape_contacts import ShapeContacts
from packmech.jit.blas import single_thread
from packmech.mechanics.modes import signed_columns
from packmech.mechanics.self_stress import RANK_TOLERANCE, floppy_modes
from packmech.mechanics.system import system_of
from packmech.packing import Packing
from packmech.scene import Scene
from packmech.shapes import Beads

# largest memory of the modes [bytes]
_BASIS_BYTES = 3e9

# forces below this part of the mean are those of contacts that just touch [1]
_IDLE = 1e-9
# 1 - cosine of the angle below which a turn lies in the space of motions that stretch no contact
_INSIDE = 1e-9


@shown()
@dataclass(frozen=True, eq=False, repr=False)
class QuarticModes:
    """Null space of the stiffness of a packing with shapes, by what its contact forces make of it.

    Attributes
    ----------
    curvature_m
        (M,) second derivatives of the energy along the modes, in increasing order [energy/length^2]: those of the
        prestress, for the stiffness has none. Where one is negative the packing is no minimum.
    displacement_mnd, turn_mnk
        (M, N, d) displacements and (M, N, K) turns as lengths, orthonormal all together, zero for rattlers; uniform
        translations and free turns are none of them, and no part of them.
    stretch
        Largest change of a contact's distance by a mode of size 1 [1].
    certain
        Whether their number stays the same for tolerances of the rank ten times looser and tighter, so that singular
        values above and below are a factor of 100 apart.
    pressure
        Pressure of the packing [energy/length^d].
    seconds
        CPU time.
    free_turns
        Number of turns of single rigid bodies, about the beads with which they touch others, that cost nothing.

    """

    curvature_m: NDArray[np.float64]
    displacement_mnd: NDArray[np.float64]
    turn_mnk: NDArray[np.float64]
    stretch: float
    certain: bool
    pressure: float
    seconds: float
    free_turns: int = 0

    def __len__(self) -> int:
        return len(self.curvature_m)

    def __repr__(self) -> str:
        ends = [f"{self.curvature_m[k]:.4g}" for k in (0, -1)] if len(self) else []
        curved = f", curvatures {' to '.join(ends)} [energy/length^2]" if ends else ""
        return (
            f"QuarticModes: {len(self)} of {self.displacement_mnd.shape[1]} particles{curved}, pressure "
            f"{self.pressure:.4g} [energy/length^d], largest stretch of a contact {self.stretch:.1e}"
            f"{'' if self.certain else ', number uncertain'}"
            f"{f', {self.free_turns} free turns beside them' if self.free_turns else ''}"
        )


@shown_as("quartic modes")
@honors("repulsion kinds shapes", at_rest=True)
def quartic_modes(
    scene: Scene,
    *,
    strain: BoxStrain = "none",
    gap_tolerance: float | None = None,
    rank_tolerance: float = RANK_TOLERANCE,
) -> QuarticModes:
    """Return the motions of a packing with shapes that its stiffness does not resist, and how its forces do.

    Along a mode of curvature kappa the energy is kappa delta^2 / 2 for small amplitudes delta and grows as delta^4
    beyond about sqrt(pressure): `pm.displaced` moves particles along it. Their number is that of the missing contacts,
    degrees of freedom - d - contacts + states of self stress, less the turns of single rigid bodies that cost nothing
    (`free_turns`).

    Parameters
    ----------
    scene
        The scene, its packing at rest and with shapes.
    strain
        "none": the box is fixed. "isochoric": its shape may change, too, as in shear-stabilized packings; the modes'
        strains are not given. "isotropic" and "free" admit a change of volume, too, at constant pressure; along a
        motion that stretches no contact a packing under pressure has none, so that these are the same as the two.
    gap_tolerance, rank_tolerance
        As in `floppy_modes`.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be, or the packing has no shapes.

    Examples
    --------
    >>> import packmech as pm
    >>> start = pm.random_packing(12, dimension=2, packing_fraction=0.6, seed=1, shapes=pm.Ellipses(1.5))
    >>> scene = pm.Scene(start, (pm.Repulsion(),))
    >>> run = pm.jam(scene, pressure=1e-5, strain="isotropic")
    >>> modes = pm.quartic_modes(scene.replace(packing=run.packing))
    >>> len(modes) == run.report["floppy_modes"], bool((modes.curvature_m > 0.0).all())
    (True, True)

    """
    start = time.process_time()
    instance("scene", scene, Scene)
    one_of("strain", strain, STRAINS)
    if not scene.packing.turn_nkt.shape[1]:
        raise ValueError("scene.packing must have shapes, got one of discs or spheres: ask pm.floppy_modes")
    with single_thread():
        found = system_of(scene, gap_tolerance=gap_tolerance)
        network = found.network
        if not len(network.index_n):
            real("rank_tolerance", rank_tolerance, above=0.0, below=0.1)
            return _none(scene, network.free_nq.shape[1], start)
        floppy = floppy_modes(
            network.packing, strain, contacts=network.contacts, rank_tolerance=rank_tolerance, basis_limit=_BASIS_BYTES
        )
        if floppy.motion_xk is None:
            raise ValueError(f"scene.packing must have fewer quartic modes, got {floppy.count}, which fill the memory")
        everything = np.ones(network.free_nq.size, dtype=bool)
        size, strains = len(everything), floppy.motion_xk.shape[0] - network.free_nq.size
        basis, whole = floppy.motion_xk, found.matrix(everything)
        # a body that turns freely comes to rest against another, which it does not push: that contact holds nothing
        force_c = np.abs(found.terms.first_c)
        bearing = np.flatnonzero(force_c > _IDLE * force_c.mean())
        basis, free = _without(basis, free_turns(network.packing, network.contacts.select(bearing)))
        moved = whole @ basis[:size]
        if strains:
            coupling = found.column(everything)
            # with the curvature of the volume, times the pressure that is held
            corner = found.corner + found.volume_curvature
            moved = np.concatenate([moved + coupling @ basis[size:], coupling.T @ basis[:size] + corner @ basis[size:]])
        value, share = np.linalg.eigh(basis.T @ moved)
        motion = signed_columns(basis @ share)[:size].T.reshape(len(value), *network.free_nq.shape)
    d = network.contacts.dimension
    modes = np.zeros((len(value), scene.packing.particles, motion.shape[2]))
    modes[:, network.index_n] = motion
    pressure = -float(np.trace(found.virial_dd)) / (d * scene.packing.box.volume)
    return QuarticModes(
        curvature_m=value,
        displacement_mnd=np.ascontiguousarray(modes[..., :d]),
        turn_mnk=np.ascontiguousarray(modes[..., d:]),
        stretch=floppy.residual,
        certain=floppy.certain,
        pressure=pressure,
        seconds=time.process_time() - start,
        free_turns=free,
    )


def _without(basis_xk: NDArray[np.float64], free_fnq: NDArray[np.float64]) -> tuple[NDArray[np.float64], int]:
    """Return an orthonormal basis of what is left of a space of motions without free turns, and how many those are.

    Turns whose combinations stretch a contact that bears no force, and so lie outside the space, take no part.
    """
    if not len(free_fnq):
        return basis_xk, 0
    d = 2 if free_fnq.shape[2] == 3 else 3
    # uniform translations are no part of the space
    moved = free_fnq.copy()
    moved[..., :d] -= moved[..., :d].mean(axis=1, keepdims=True)
    motion = np.zeros((len(basis_xk), len(moved)))
    motion[: moved[0].size] = moved.reshape(len(moved), -1).T
    motion = np.linalg.qr(motion)[0]
    share = basis_xk.T @ motion
    # principal angles between the turns and the space: cosines of one are turns that lie in it
    _, cosine, turned = np.linalg.svd(share)
    inside = share @ turned[: len(cosine)][cosine > 1.0 - _INSIDE].T
    count = inside.shape[1]
    # the columns beyond those of the turns span what is across them
    return np.asarray(basis_xk @ np.linalg.qr(inside, mode="complete")[0][:, count:]), count


def free_turns(packing: Packing, contacts: Contacts | ShapeContacts) -> NDArray[np.float64]:
    """Return (F, N, d + K) turns of rigid bodies about all the beads with which they touch others; none of ellipses.

    Displacements of the centers and turns as lengths (`Beads.turn_basis`): no contact changes along them, at whatever
    amplitude, until other beads touch. Nothing resists a turn about the only bead that is touched, nor in space about
    a line of those that are. Rattlers must have been taken out.
    """
    shapes, d = packing.shapes, packing.dimension
    turn = packing.turn_nkt
    width = d + turn.shape[1]
    found: list[NDArray[np.float64]] = []
    if isinstance(shapes, Beads) and len(contacts):
        site = np.unique(np.concatenate([contacts.pairs.i_c, contacts.pairs.j_c]))
        owner, arm = shapes.particle_b[site], shapes.arms(packing.radius_n)
        for n in np.unique(owner):
            mine = site[owner == n]
            aside = shapes.offset_bd[mine] - shapes.offset_bd[mine[0]]
            spanned = np.linalg.matrix_rank(aside, tol=1e-9)
            there = np.flatnonzero((turn[n] != 0.0).any(axis=1))
            share = np.zeros((0, turn.shape[1]))
            if spanned == 0:
                share = np.eye(turn.shape[1])[there]
            elif spanned == 1 and len(there) == 3:
                # a row of beads does not turn about itself, which is no turn of it
                line = arm[mine[np.argmax((aside**2).sum(axis=1))]] - arm[mine[0]]
                share = np.linalg.solve(turn[n].T, line)[None]
            for one in share:
                motion = np.zeros((packing.particles, width))
                motion[n, :d] = -turned_arms(arm[mine[:1]])[0] @ (one @ turn[n])
                motion[n, d:] = one
                found.append(motion)
    return np.array(found).reshape(len(found), packing.particles, width)


def _none(scene: Scene, width: int, start: float) -> QuarticModes:
    """Return the answer for a packing whose particles all rattle."""
    n, d = scene.packing.position_nd.shape
    none = np.zeros((0, n, d)), np.zeros((0, n, width - d))
    return QuarticModes(np.zeros(0), *none, 0.0, True, 0.0, time.process_time() - start)


@honors("links shapes", packing_only=True)
def displaced(packing: Packing, displacement_nd: ArrayLike, turn_nk: ArrayLike | None = None) -> Packing:
    """Return the packing with its particles moved, and turned where they have shapes; links are not looked at.

    Parameters
    ----------
    packing
        The packing.
    displacement_nd
        (N, d) displacements [length].
    turn_nk
        (N, K) turns, angles times radii of gyration [length], as modes give them; none unless given.

    Raises
    ------
    TypeError, ValueError
        If an argument is not what it must be.

    Examples
    --------
    >>> import packmech as pm
    >>> shapes = pm.Spheroids([2.0], [[1.0, 0.0]])
    >>> packing = pm.Packing([[1.0, 1.0]], [0.5], pm.Box.cubic(3.0, 2), shapes=shapes)
    >>> moved = displaced(packing, [[0.5, 0.0]], [[shapes.gyration(0.5)[0] * np.pi / 2]])
    >>> moved.position_nd.tolist(), abs(moved.shapes.director_nd.round(12)).tolist()
    ([[1.5, 1.0]], [[0.0, 1.0]])

    """
    instance("packing", packing, Packing)
    moved = finite_array("displacement_nd", displacement_nd, shape=packing.position_nd.shape)
    turn = np.zeros(packing.turn_nkt.shape[:2])
    if turn_nk is not None and 0 not in given_shape(turn_nk):
        turn = finite_array("turn_nk", turn_nk, shape=turn.shape)
    return packing.moved(np.hstack([moved, turn]))
