"""Figures of packings at rest as sums over pairs: what their derivatives are made of (`sensitivity`).

Energies, pressures, moduli and frequencies are sums over contacts, bonds and links of their energies, of pulls along
vectors, and of stiffnesses along motions that do not change to first order: relaxed strains and normal modes.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
import scipy.sparse.linalg as spla
from numpy.typing import NDArray

from packmech.contacts.elements import Elements
from packmech.effects import Friction, acting_friction, bonds_of
from packmech.linalg.mandel import mandel_basis
from packmech.mechanics.elasticity import Average, cauchy_tangent, reuss_average, voigt_average
from packmech.mechanics.frictional import frictional_network, frictional_system
from packmech.mechanics.linked_systems import soft_shift
from packmech.mechanics.modes import normal_modes
from packmech.mechanics.network import Network
from packmech.mechanics.pair_changes import BondPairs, Change, ContactPairs, LinkPairs, Pairs, difference
from packmech.mechanics.relaxation import factored, general_factors, refine
from packmech.mechanics.system import System, system_of
from packmech.packing import without_springs
from packmech.scene import Scene

# figures of the Hill average
_AVERAGES = ("young_modulus", "poisson_ratio")
# frequencies nearer to each other, over the larger, have no derivatives of their own
_DEGENERATE = 1e-6
# relative step of figures by stiffnesses
_OF_STIFFNESS = 1e-3


class Figure(NamedTuple):
    """A figure as sums over pairs: weights of stiffnesses along motions, of pulls along vectors, of energies.

    With w_e the changes of a pair's coordinates by motion e and strain e, phi = (sum over e, f of weight_ef w_e.W.w_f
    + sum over a, b of stress_ab pull_a vector_b) / volume + energy times the energies. `motion_enq`, `link_el` and
    `strain_edd` are the motions, the link forces that go with them, and the strains; `value` is the figure.
    """

    value: float
    weight_ee: NDArray[np.float64]
    stress_dd: NDArray[np.float64]
    energy: float
    motion_enq: NDArray[np.float64]
    link_el: NDArray[np.float64]
    strain_edd: NDArray[np.float64]
    volume: float
    # change of the figure by masses and radii of gyration, relative, at fixed stiffness
    mass_n: NDArray[np.float64]
    gyration_nk: NDArray[np.float64]
    residual: float
    solves: int
    # motions on the left of the stiffness, where friction makes it other than symmetric
    left_enq: NDArray[np.float64] | None = None
    # whether it is a frequency, along whose mode turns are carried along by their particles
    vibrates: bool = False
    # (d, d) antisymmetric derivatives by a rotation of everything, where the figure names axes
    turned_dd: NDArray[np.float64] | None = None


def _sticking(scene: Scene) -> tuple[System, NDArray[np.float64]]:
    """Return the stiffness of a frictional packing whose contacts all stick, and their (C, d) tangential forces."""
    found = frictional_network(scene, "remove")
    at_limit = int(np.count_nonzero(found.at_limit_sc))
    if at_limit:
        raise ValueError(
            f"scene must hold no contacts at the Coulomb limit, which slide one way and stick the other, got {at_limit}"
        )
    system, _ = frictional_system(scene, found, "exact", found.sliding("stick"))
    return system, found.forces.tangential_cd


def _solve_general(
    factor: Any, matrix: sp.csr_array, right: NDArray[np.float64], transposed: bool
) -> tuple[NDArray[np.float64], float]:
    """Return the solution with a matrix that is not symmetric, or its transpose, refined, and what is left."""
    trans, used = ("T", matrix.T) if transposed else ("N", matrix)

    def solve(side: NDArray[np.float64]) -> NDArray[np.float64]:
        return np.asarray(factor.solve(np.ascontiguousarray(side), trans))

    if not right.size:
        return right, 0.0
    found = solve(right)
    return refine(used, right, solve, found, right - used @ found, gain=0.5)


def refuse_dependent(network: Network) -> None:
    """Refuse links that depend on each other."""
    dependent = len(network.links) - network.link_rows[0].shape[0]
    if dependent:
        raise ValueError(
            "scene.packing must have links that do not depend on each other, as their forces are not defined, "
            f"got {dependent} that do"
        )


class Rest:
    """A packing at rest: its second derivatives, factored once, and its pairs, each to be changed by itself."""

    def __init__(self, scene: Scene) -> None:
        self.scene, self.packing = scene, scene.packing
        tangential = None
        self.rough = acting_friction(scene.effects) is not None
        if self.rough:
            self.system, tangential = _sticking(scene)
        else:
            self.system = system_of(scene.without(Friction).replace(packing=without_springs(scene.packing)))
        self.network = network = self.system.network
        self.d = network.dimension
        elements = list(self.system.elements)
        self.pairs: list[Pairs] = []
        if len(network.contacts):
            self.pairs.append(ContactPairs(scene, network, elements[0], tangential_cd=tangential))
        bonds = bonds_of(scene.effects)
        if bonds is not None and len(network.interactions):
            self.pairs.append(BondPairs(bonds, network, elements[1]))
        self.links: LinkPairs | None = None
        if len(network.links):
            refuse_dependent(network)
            own = elements[-1]
            tension = (own.pull_cx[:, : self.d] * network.links.pairs.normal_cd).sum(axis=1)
            self.links = LinkPairs(network, tension, own)
            self.pairs.append(self.links)
        self.error = 0.0

    @property
    def volume(self) -> float:
        """Volume of the box."""
        return self.packing.box.volume

    @functools.cached_property
    def _solver(self) -> Callable[[NDArray[np.float64], bool], tuple[NDArray[np.float64], float]]:
        pinned = self.network.pinned_f
        matrix = self.system.matrix(pinned)
        if self.rough:
            soft = soft_shift(sp.csr_array(matrix + matrix.T) / 2.0)
            return functools.partial(_solve_general, general_factors(matrix, soft), matrix)
        if self.links is None:
            symmetric = factored(matrix)
            return lambda right, transposed: symmetric.solve(right)
        rows = self.network.link_rows[0][:, pinned]
        unit = float(abs(matrix).max()) or 1.0
        whole = sp.csr_array(sp.block_array([[matrix, unit * rows.T], [unit * rows, None]], format="csr"))
        soft = np.concatenate([soft_shift(matrix), np.zeros(rows.shape[0])])
        try:
            factor = spla.splu(sp.csc_array(whole))
        except RuntimeError:
            factor = spla.splu(sp.csc_array(whole + sp.diags_array(soft)))
        scale = np.concatenate([np.ones(matrix.shape[0]), np.full(rows.shape[0], unit)])[:, None]

        def solve(right: NDArray[np.float64], transposed: bool) -> tuple[NDArray[np.float64], float]:
            found, left = _solve_general(factor, whole, right * scale, False)
            return found * scale, left

        return solve

    def solve(
        self, right_nqm: NDArray[np.float64], length_lm: NDArray[np.float64], *, transposed: bool = False
    ) -> tuple[Any, Any, float]:
        """Return motions and link forces that balance forces and change links as asked for, and what is left.

        With friction the stiffness is not symmetric, and adjoints solve with its transpose.
        """
        pinned = self.network.pinned_f
        flat = right_nqm.reshape(pinned.size, -1)
        right = np.concatenate([flat[pinned], length_lm])
        found, left = self._solver(right, transposed)
        motion = np.zeros_like(flat)
        motion[pinned] = found[: int(pinned.sum())]
        largest = float(np.abs(right).max(initial=0.0))
        return motion.reshape(right_nqm.shape), found[int(pinned.sum()) :], left / largest if largest else 0.0

    def changes(
        self, own: Elements, motion_nq: NDArray[np.float64], strain_dd: NDArray[np.float64] | None
    ) -> NDArray[np.float64]:
        """Return the (C, X) changes of pairs' coordinates by a motion and a strain."""
        d, turn = self.d, self.network.turn_nkt
        found = np.zeros_like(own.pull_cx)
        found[:, :d] = motion_nq[own.j_c, :d] - motion_nq[own.i_c, :d]
        if strain_dd is not None:
            found[:, :d] += own.vector_cd @ strain_dd.T
        t = own.rotations
        for end, begin in ((own.i_c, d), (own.j_c, d + t)) if t else ():
            found[:, begin : begin + t] = np.einsum("ck,ckt->ct", motion_nq[end, d:], turn[end])
        return found

    def difference(self, at: Callable[[float], NDArray[np.float64]]) -> NDArray[np.float64]:
        """Return a derivative per step; its error is kept."""
        found, error = difference(at)
        self.error = max(self.error, error)
        return found

    def affine(self) -> NDArray[np.float64]:
        """Return the (s, L) rates of the links' lengths under Mandel strains."""
        s = len(self.system.corner)
        return self.network.link_rows[1].T if self.links is not None else np.zeros((s, 0))


def _moduli(name: str, energy_ee: NDArray[np.float64], stress_dd: NDArray[np.float64]) -> float:
    """Return a figure of stiffness and stress by its name."""
    d = len(stress_dd)
    if len(name) == 2:
        return float(stress_dd["xyz".index(name[0]), "xyz".index(name[1])])
    if name == "pressure":
        return -float(np.trace(stress_dd)) / d
    tangent = cauchy_tangent(energy_ee, stress_dd)
    if name == "bulk_modulus":
        return voigt_average(tangent).bulk_modulus
    if name in _AVERAGES:
        voigt, reuss = voigt_average(tangent), reuss_average(tangent, np.zeros((0, len(tangent))))
        middle = [(getattr(voigt, one) + getattr(reuss, one)) / 2.0 for one in ("bulk_modulus", "shear_modulus")]
        return float(getattr(Average(middle[0], middle[1], d), name))
    if name == "shear_modulus":
        return _entry(energy_ee, "xyxy", d) + (3.0 * float(stress_dd[1, 1]) - float(stress_dd[0, 0])) / 4.0
    return _entry(tangent, name, d)


def _entry(matrix_ee: NDArray[np.float64], indices: str, d: int) -> float:
    """Return a component such as "xyxy" of a Mandel matrix."""
    a, b, m, n = ("xyz".index(one) for one in indices)
    basis = mandel_basis(d)
    return float(basis[:, a, b] @ matrix_ee @ basis[:, m, n])


def _weights(
    name: str, energy_ee: NDArray[np.float64], stress_dd: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the derivatives of a figure by the entries of stiffness and stress."""
    tangent = cauchy_tangent(energy_ee, stress_dd)
    # averages of the inverse change over the size of the smallest stiffness
    sizes = np.abs(np.linalg.eigvalsh(tangent + tangent.T)) / 2.0
    scale = float(sizes.min() if name in _AVERAGES else sizes.max()) or 1.0

    def slopes(size: int, at: Callable[[NDArray[np.float64]], float]) -> NDArray[np.float64]:
        found = np.zeros((size, size))
        for a in range(size):
            for b in range(size):
                one = np.zeros((size, size))
                one[a, b] = scale * _OF_STIFFNESS
                slope = difference(lambda t, one=one: np.array([at(t * one)]))[0]  # type: ignore[misc]
                found[a, b] = float(slope[0]) / (scale * _OF_STIFFNESS)
        return found

    return (
        slopes(len(energy_ee), lambda change: _moduli(name, energy_ee + change, stress_dd)),
        slopes(len(stress_dd), lambda change: _moduli(name, energy_ee, stress_dd + change)),
    )


def _by_rotation(
    weight_ee: NDArray[np.float64],
    across_dd: NDArray[np.float64],
    energy_ee: NDArray[np.float64],
    stress_dd: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Return the (d, d) antisymmetric derivatives of a figure by a rotation that stiffness and stress follow."""
    d = len(stress_dd)
    basis, found = mandel_basis(d), np.zeros((d, d))
    for a, b in zip(*np.triu_indices(d, 1), strict=True):
        turn = np.zeros((d, d))
        turn[a, b], turn[b, a] = 1.0, -1.0
        spin = np.einsum("kab,mab->km", basis, turn @ basis - basis @ turn)
        change = (weight_ee * (spin @ energy_ee - energy_ee @ spin)).sum()
        change += (across_dd * (turn @ stress_dd - stress_dd @ turn)).sum()
        found += 0.5 * change * turn
    return found


def figure_of(rest: Rest, of: str, mode: int) -> Figure:
    """Return a figure as sums over pairs."""
    system, network, d = rest.system, rest.network, rest.d
    shape, links = network.there_nq.shape, len(network.links)
    nothing = np.zeros((0, *shape)), np.zeros((0, links)), np.zeros((0, d, d))
    still = np.zeros(shape[0]), np.zeros((shape[0], shape[1] - d))
    if of == "energy":
        total = sum(float(one.energies(Change(), 0.0).sum()) for one in rest.pairs)
        return Figure(total, np.zeros((0, 0)), np.zeros((d, d)), 1.0, *nothing, rest.volume, *still, 0.0, 0)
    stress = system.virial_dd / rest.volume
    stress = 0.5 * (stress + stress.T)
    if of == "frequency":
        return _frequency(rest, mode)
    s = len(system.corner)
    if of == "pressure" or len(of) == 2:
        _, across = _weights(of, np.eye(s), stress)
        value = _moduli(of, np.eye(s), stress)
        turned = _by_rotation(np.zeros((s, s)), across, np.eye(s), stress)
        return Figure(
            value, np.zeros((0, 0)), across, 0.0, *nothing, rest.volume, *still, 0.0, 0, turned_dd=turned
        )  # fmt: skip
    whole = np.ones(network.free_f.size, dtype=bool)
    column = system.column(whole).reshape(*shape, s)
    motion, force, left = rest.solve(-column, -rest.affine().T)
    row, other = column, None
    if rest.rough:
        row = system.row(whole).T.reshape(*shape, s)
        left_motion, _, also = rest.solve(-row, -rest.affine().T, transposed=True)
        left, other = max(left, also), np.moveaxis(left_motion, 2, 0)
    relief = np.einsum("nqe,nqf->ef", -row, motion)
    if links:
        relief -= rest.affine() @ force
    energy = (system.corner - relief) / rest.volume
    if not rest.rough:
        energy = 0.5 * (energy + energy.T)
    tangent = cauchy_tangent(energy, stress)
    if of in _AVERAGES and np.linalg.eigvalsh(tangent + tangent.T)[0] <= 0.0:
        raise ValueError(f"scene must be stable to all strains for of={of!r}, which is an average over them")
    weight, across = _weights(of, energy, stress)
    return Figure(
        _moduli(of, energy, stress), weight, across, 0.0, np.moveaxis(motion, 2, 0), force.T, mandel_basis(d),
        rest.volume, *still, left, s if other is None else 2 * s, other,
        turned_dd=_by_rotation(weight, across, energy, stress),
    )  # fmt: skip


def _frequency(rest: Rest, mode: int) -> Figure:
    """Return the frequency of one mode as a sum over pairs."""
    network, d = rest.network, rest.d
    modes = normal_modes(rest.scene, mode + 2)
    if mode >= len(modes):
        raise ValueError(f"mode must be below the number of modes, {len(modes)}, got {mode}")
    square = modes.eigenvalue_m
    near = np.delete(square, mode)
    if modes.zero_m[mode] or square[mode] < 0.0:
        raise ValueError(
            f"mode must be one with a frequency that is not zero, got {mode}, of eigenvalue {square[mode]:.3g}"
        )
    if len(near) and float(np.abs(near - square[mode]).min()) < _DEGENERATE * square[mode]:
        raise ValueError(
            f"mode must be one whose frequency no other has, as degenerate ones split up as numbers change, got {mode}"
        )
    whole = np.concatenate([modes.displacement_mnd[mode], modes.turn_mnk[mode]], axis=1)
    motion = np.ascontiguousarray(whole[network.index_n])
    mass = rest.packing.mass_n[network.index_n]
    part = mass[:, None] * motion**2
    # link forces along the mode: what is left of K v - omega^2 M v
    force = np.zeros((1, len(network.links)))
    if len(network.links):
        left = rest.system.whole_matrix() @ motion.ravel() - square[mode] * (mass[:, None] * motion).ravel()
        rows = network.link_rows[0]
        force[0] = spla.spsolve(sp.csc_array(rows @ rows.T), -(rows @ left)).reshape(-1)
    frequency = float(np.sqrt(square[mode]))
    weight = np.full((1, 1), 0.5 / frequency)
    return Figure(
        frequency, weight, np.zeros((d, d)), 0.0, motion[None], force, np.zeros((1, d, d)), 1.0,
        -0.5 * frequency * part.sum(axis=1), -frequency * part[:, d:], modes.residual, 0, vibrates=True,
    )  # fmt: skip
