"""The exact hard packing at the end of a search: which pairs touch, that they balance, and how many are redundant."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.contacts.network import Contacts, pair_contacts
from packmech.jamming.interior_point import HardState
from packmech.linalg.block_system import BlockSystem, Factored, extensions, gather
from packmech.packing import Packing

GAP_ERROR = 1e-11
FORCE_IMBALANCE = 1e-9
_SWEEPS = 8
_CORRECTIONS = 8
# rattlers may be shoved aside this often, by overlaps up to this [mean diameter]
_SHOVES, _SHOVE = 50, 1e-6
_DENSE_UNKNOWNS = 60
_KICK = 1e-3


@dataclass(frozen=True, eq=False)
class Vertex:
    """A hard packing whose contacts balance: no small motion makes it denser. Lengths in units of the mean diameter.

    Attributes
    ----------
    packing
        The packing; contacts touch to rounding, all other pairs are apart.
    contacts
        The force-bearing contacts.
    force_c
        (C,) their forces; the sum of force * distance is N d.
    excess
        Contacts beyond d N' - d + k for N' force-bearing particles and k free strains: 0 means one state of self
        stress.
    floppy_modes
        Motions of the backbone that no contact resists to first order: moving along them opens contacts, so the
        packing is at a saddle.
    gap_error
        Largest gap or overlap of a contact [mean diameter].
    force_imbalance
        Largest net force or unbalanced stress over the mean force [1].
    patches
        Particles held by more contacts than needed: one array per connected group. Equal particles close the contacts
        of a hexagonal patch exactly, so its forces are not unique.

    """

    packing: Packing
    contacts: Contacts
    force_c: NDArray[np.float64]
    excess: int
    floppy_modes: int
    gap_error: float
    force_imbalance: float
    patches: tuple[NDArray[np.int64], ...]

    @property
    def states_of_self_stress(self) -> int:
        """Sets of contact forces in balance, counted with the volume held."""
        return self.excess + 1 + self.floppy_modes


class Backbone:
    """The force-bearing network with its weighted normal equations A^T W A, positions first, strains eliminated last.

    Parameters
    ----------
    contacts
        The contacts.
    basis_kdd
        (k, d, d) free strains.
    live_n
        (N,) particles that bear forces; the rest are held in place. Those with contacts, unless given.

    """

    def __init__(
        self, contacts: Contacts, basis_kdd: NDArray[np.float64], live_n: NDArray[np.bool_] | None = None
    ) -> None:
        self.contacts, self.basis_kdd = contacts, basis_kdd
        self.shape = (contacts.particles, contacts.dimension)
        self.system = BlockSystem(contacts.i_c, contacts.j_c, *self.shape)
        self.live_n = contacts.count_n() > 0 if live_n is None else live_n
        self.stretch_ck = np.einsum("ca,kab,cb->ck", contacts.normal_cd, basis_kdd, contacts.vector_cd)
        self.load_k = np.einsum("kaa->k", basis_kdd) * contacts.particles

    def factor(self, weight_c: NDArray[np.float64]) -> None:
        """Prepare `solve` for these weights."""
        # a floppy backbone stays factorable; refinement takes the tie out again
        tie = np.where(self.live_n, 1e-12 * float(weight_c.mean()), 1.0)
        self.weight_c = weight_c
        self.factored: Factored = self.system.factor(self.contacts.normal_cd, weight_c, extra_n=tie)
        self.coupling = np.stack([self.gather(weight_c * column) for column in self.stretch_ck.T], axis=1)
        self.relaxed = self.factored.solve(self.coupling)
        self.corner = (self.stretch_ck.T * weight_c) @ self.stretch_ck - self.coupling.T @ self.relaxed
        self.corner += 1e-12 * float(weight_c.mean()) * self.shape[0] * np.eye(len(self.corner))

    def gather(self, force_c: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the (N d,) net forces of contacts that push with force_c."""
        out = np.empty(self.shape)
        gather(self.contacts.i_c, self.contacts.j_c, self.contacts.normal_cd, force_c, out)
        return out.ravel()

    def extend(self, u_nd: NDArray[np.float64], strain_k: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return A (u, strain)."""
        out = np.empty(len(self.contacts))
        extensions(self.contacts.i_c, self.contacts.j_c, self.contacts.normal_cd, u_nd, out)
        extension: NDArray[np.float64] = out + self.stretch_ck @ strain_k
        return extension

    def solve(
        self, net: NDArray[np.float64], load_k: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return (u, strain) with A^T W A (u, strain) = (net, load)."""
        rough = self.factored.solve(net)
        strain_k = np.linalg.solve(self.corner, load_k - self.coupling.T @ rough)
        return (rough - self.relaxed @ strain_k).reshape(self.shape), strain_k

    def moved(self, packing: Packing, u_nd: NDArray[np.float64], strain_k: NDArray[np.float64]) -> Packing:
        """Return the packing displaced by u, then strained."""
        strain = np.einsum("k,kab->ab", strain_k, self.basis_kdd)
        position = packing.position_nd + u_nd + packing.position_nd @ strain.T
        return packing.replace(position_nd=position, box=packing.box.strained(strain))

    def balance(self, force_c: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Return what the forces lack: net force on the particles, and load."""
        return -self.gather(force_c), self.load_k - self.stretch_ck.T @ force_c

    def balanced(self, force_c: NDArray[np.float64], weight_c: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the forces nearest to the given ones, in the metric of the weights, that balance the load."""
        self.factor(weight_c)
        for _ in range(3):
            net, load = self.balance(force_c)
            force_c = force_c + weight_c * self.extend(*self.solve(net, load))
        return force_c

    def imbalance(self, force_c: NDArray[np.float64]) -> float:
        """Return the largest missing net force or load per contact over the mean force."""
        net, load = self.balance(force_c)
        largest = float(np.sqrt((net.reshape(self.shape) ** 2).sum(axis=1)).max())
        return max(largest, float(np.abs(load).max()) / len(force_c)) / max(float(np.abs(force_c).mean()), 1e-300)

    def without_load(self, force_c: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the part of the forces that balances with no load at all (unit weights must be factored)."""
        for _ in range(2):
            u_nd, strain_k = self.solve(self.gather(force_c), self.stretch_ck.T @ force_c)
            force_c = force_c - self.extend(u_nd, strain_k)
        return force_c


def _touching_pairs(state: HardState) -> list[NDArray[np.bool_]]:
    """Return the likely sets of contacts: force above slack, and the cut at the widest break of their ratio."""
    ratio = np.log10(state.force_c / np.maximum(state.slack_c, 1e-300))
    first = ratio > 0.0
    near = np.sort(ratio[(ratio > -7.0) & (ratio < 7.0)])
    ladder = np.concatenate([[-7.0], near, [7.0]])
    widest = int(np.argmax(np.diff(ladder)))
    second = ratio > 0.5 * (ladder[widest] + ladder[widest + 1])
    return [first] if (first == second).all() else [second, first]


def _polish(
    packing: Packing, pairs: tuple[NDArray[np.int64], ...], basis_kdd: NDArray[np.float64]
) -> tuple[Packing, Backbone, float]:
    """Return the packing with the pairs at contact, by Gauss-Newton steps, their network, and the largest gap left."""
    error = np.inf
    best: tuple[Packing, Backbone, float] | None = None
    for _ in range(_SWEEPS):
        backbone = Backbone(pair_contacts(packing, *pairs), basis_kdd)
        gap = backbone.contacts.gap_c
        now = float(np.abs(gap).max())
        if best is None or now < error:
            best = (packing, backbone, now)
        # the last digits wander by rounding: stop when a step gains nothing
        if now < 1e-15 or (now > 0.5 * error and now < 1e-12):
            break
        error = min(error, now)
        backbone.factor(np.ones(len(gap)))
        u_nd, strain_k = backbone.solve(backbone.gather(-gap), -backbone.stretch_ck.T @ gap)
        if not np.isfinite(u_nd).all() or np.abs(u_nd).max() > 0.1:
            break
        packing = backbone.moved(packing, u_nd, strain_k)
    assert best is not None
    return best


def _patches(backbone: Backbone, excess: int) -> tuple[NDArray[np.int64], ...]:
    """Return the particles of the redundant contacts, those that take part in a state of self stress without load."""
    import scipy.sparse as sp
    from scipy.sparse.csgraph import connected_components

    contacts = backbone.contacts
    backbone.factor(np.ones(len(contacts)))
    probe = np.random.default_rng(0).standard_normal((len(contacts), excess + 1))
    states = np.stack([backbone.without_load(column) for column in probe.T], axis=1)
    strength = np.sqrt((states**2).sum(axis=1))
    redundant = strength > 1e-6 * max(float(strength.max()), 1e-300)
    i, j = contacts.i_c[redundant], contacts.j_c[redundant]
    size = contacts.particles
    graph = sp.coo_array((np.ones(len(i)), (i, j)), shape=(size, size))
    _, label = connected_components(graph, directed=False)
    involved = np.unique(np.concatenate([i, j]))
    groups = [involved[label[involved] == one] for one in np.unique(label[involved])]
    return tuple(sorted(groups, key=lambda group: (-len(group), int(group[0]))))


def _floppy_modes(backbone: Backbone, excess: int) -> int:
    """Return how many motions of the backbone no contact resists; only small or deficient backbones can have any."""
    contacts = backbone.contacts
    live = np.flatnonzero(backbone.live_n)
    d = contacts.dimension
    if len(live) * d > _DENSE_UNKNOWNS and excess >= 0:
        backbone.factor(np.ones(len(contacts)))
        # a direction that no contact resists would come out of the tied system a trillion times larger than it went in
        probe = np.random.default_rng(1).standard_normal((contacts.particles, d)) * backbone.live_n[:, None]
        probe[live] -= probe[live].mean(axis=0)
        answer, _ = backbone.solve(probe.ravel(), np.zeros(len(backbone.load_k)))
        if np.abs(answer).max() < 1e10 * np.abs(probe).max():
            return 0
    row = np.arange(len(contacts))
    matrix = np.zeros((len(contacts), contacts.particles, d))
    np.add.at(matrix, (row, contacts.j_c), contacts.normal_cd)
    np.subtract.at(matrix, (row, contacts.i_c), contacts.normal_cd)
    full = np.concatenate([matrix[:, live].reshape(len(contacts), -1), backbone.stretch_ck], axis=1)
    singular = np.linalg.svd(full, compute_uv=False)
    rank = int((singular > 1e-7 * singular.max(initial=1.0)).sum())
    import scipy.sparse as sp
    from scipy.sparse.csgraph import connected_components

    # parts of the backbone that do not touch each other may slide without opening a contact: that is no way out
    graph = sp.coo_array((np.ones(len(contacts)), (contacts.i_c, contacts.j_c)), shape=(contacts.particles,) * 2)
    parts = len(np.unique(connected_components(graph, directed=False)[1][live]))
    return max(0, len(live) * d - d * parts + len(backbone.load_k) - rank)


def kicked(packing: Packing, basis_kdd: NDArray[np.float64], number: int) -> Packing:
    """Return the packing after a small random displacement and strain, to leave a saddle that no contact holds it at.

    Parameters
    ----------
    packing
        The packing, in reduced units.
    basis_kdd
        (k, d, d) free strains.
    number
        Which kick: the same number gives the same one.

    """
    rng = np.random.default_rng(number)
    position = packing.position_nd + _KICK * packing.radius_n[:, None] * rng.standard_normal(packing.position_nd.shape)
    strain = np.einsum("k,kab->ab", _KICK * rng.standard_normal(len(basis_kdd)), basis_kdd)
    return packing.replace(position_nd=position + position @ strain.T, box=packing.box.strained(strain))


def certify(
    state: HardState, radius_n: NDArray[np.float64], basis_kdd: NDArray[np.float64]
) -> tuple[Vertex | None, str]:
    """Return the exact hard packing that the state has come close to, or None and what is missing.

    Accepted only if all contacts touch to 1e-11 and all other pairs are apart, every force is positive, and the
    forces balance to 1e-9 of their mean.

    Parameters
    ----------
    state
        The end of an interior-point search.
    radius_n
        (N,) radii in the state's units.
    basis_kdd
        (k, d, d) free strains.

    """
    reason = "no pair bears a force"
    for touching in _touching_pairs(state):
        try:
            vertex, reason = _accept(state, radius_n, basis_kdd, touching.copy())
        except np.linalg.LinAlgError as failure:
            vertex, reason = None, f"the network cannot be factored: {failure}"
        if vertex is not None:
            return vertex, ""
    return None, reason


def _room_for_rattlers(packing: Packing, state: HardState, live_n: NDArray[np.bool_]) -> Packing:
    """Return the packing with rattlers moved off what they overlap by a solver's tolerance; cages have room."""
    position = packing.position_nd.copy()
    for _ in range(_SHOVES):
        near = pair_contacts(packing, state.i_c, state.j_c, state.image_cd)
        overlap = np.maximum(-near.gap_c, 0.0)
        at_i, at_j = ~live_n[near.i_c], ~live_n[near.j_c]
        wrong = (overlap > 1e-14) & (at_i != at_j) & (overlap < _SHOVE)
        if not wrong.any():
            break
        push = (1.5 * overlap[wrong])[:, None] * near.normal_cd[wrong]
        np.subtract.at(position, near.i_c[wrong & at_i], push[at_i[wrong]])
        np.add.at(position, near.j_c[wrong & at_j], push[at_j[wrong]])
        packing = packing.replace(position_nd=position)
    return packing


def _accept(
    state: HardState, radius_n: NDArray[np.float64], basis_kdd: NDArray[np.float64], touching: NDArray[np.bool_]
) -> tuple[Vertex | None, str]:
    reason = "no pair bears a force"
    ratio = np.log(state.force_c) - np.log(np.maximum(state.slack_c, 1e-300))
    for _ in range(_CORRECTIONS):
        if not touching.any():
            return None, reason
        packing = Packing(state.position_nd, radius_n, Box(state.lattice_dd))
        chosen = (state.i_c[touching], state.j_c[touching], state.image_cd[touching])
        packing, backbone, gap_error = _polish(packing, chosen, basis_kdd)
        k = len(basis_kdd)
        excess = len(backbone.contacts) - (packing.dimension * (int(backbone.live_n.sum()) - 1) + k)
        if gap_error > GAP_ERROR:
            # gaps of 1e-9 do occur, and look like contacts to the search: the pair with the least force is not one
            reason = f"contacts close to {gap_error:.1e} only"
            if excess <= 0:
                return None, reason
            touching[np.flatnonzero(touching)[np.argmin(ratio[touching])]] = False
            continue
        packing = _room_for_rattlers(packing, state, backbone.live_n)
        overlap_c = -pair_contacts(packing, state.i_c, state.j_c, state.image_cd).gap_c
        overlap = float(np.maximum(overlap_c, 0.0).max())
        if overlap > GAP_ERROR:
            reason = f"another pair overlaps by {overlap:.1e}"
            touching |= overlap_c > GAP_ERROR
            continue
        given = state.force_c[touching]
        # without redundancy the forces are unique; with it, weights in proportion keep small forces positive
        force = backbone.balanced(given, np.ones_like(given) if excess <= 0 else given)
        imbalance = backbone.imbalance(force)
        if (force <= 0.0).any():
            return None, f"{int((force <= 0.0).sum())} contacts pull"
        if imbalance > FORCE_IMBALANCE:
            return None, f"forces balance to {imbalance:.1e} only"
        floppy = _floppy_modes(backbone, excess)
        patches = _patches(backbone, excess + floppy) if excess + floppy > 0 else ()
        error = max(gap_error, overlap)
        return Vertex(packing, backbone.contacts, force, excess, floppy, error, imbalance, patches), ""
    return None, reason
