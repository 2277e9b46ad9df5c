"""Packings with links for the hard cases: rings, long chains, chains around the box, far and near ends, taut rings."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache, partial

import numpy as np
from numpy.typing import NDArray

import packmech as pm
from hard_cases.case import HARMONIC, HardCase
from hard_cases.finite_differences import at_rest, finite_tangent, kept_step
from packmech.constraints.factor import ConstraintFactor
from packmech.measure.contact_forces import force_balance


def rigid(place_nd: NDArray[np.float64] | list[list[float]]) -> pm.Packing:
    """Return particles of diameter 1 with all pairs linked, at the distances at which they stand."""
    place = np.array(place_nd)
    i, j = np.triu_indices(len(place), 1)
    length = np.sqrt(((place[j] - place[i]) ** 2).sum(axis=1))
    links = pm.Links(i, j, np.zeros((len(i), place.shape[1]), dtype=np.int64), length)
    return pm.Packing(place, np.full(len(place), 0.5), pm.Box.cubic(9.0, place.shape[1]), links)


def ring(beads: int, wrong: float = 0.0) -> pm.Packing:
    """Return a ring of particles in a plane, all pairs linked, the last of the redundant ones too long by `wrong`."""
    angle = 2.0 * math.pi * np.arange(beads) / beads
    packing = rigid(2.0 * np.stack([np.cos(angle), np.sin(1.3 * angle)], axis=1))
    links = packing.links
    length = links.length_l.copy()
    length[-1] += wrong
    return packing.replace(links=pm.Links(links.i_l, links.j_l, links.image_ld, length, np.arange(len(length)) > 0))


@cache
def chain(dimension: int, beads: int = 1000, angle: float = 0.6, reach: int = 1) -> pm.Packing:
    """Return an open chain, bent at random within an angle, each particle linked to the next `reach`."""
    rng = np.random.default_rng(7)
    if dimension == 2:
        turn = np.cumsum(rng.uniform(-angle, angle, beads))
        step = np.stack([np.cos(turn), np.sin(turn)], axis=1)
    else:
        step = np.empty((beads, 3))
        step[0] = [1.0, 0.0, 0.0]
        for k in range(1, beads):
            step[k] = step[k - 1] + angle * rng.uniform(-0.6, 0.6, 3)
            step[k] /= math.sqrt(float(step[k] @ step[k]))
    place = np.cumsum(step, axis=0)
    i = np.concatenate([np.arange(beads - u) for u in range(1, reach + 1)])
    j = np.concatenate([np.arange(u, beads) for u in range(1, reach + 1)])
    links = pm.Links(
        i, j, np.zeros((len(i), dimension), dtype=np.int64), np.sqrt(((place[j] - place[i]) ** 2).sum(axis=1))
    )
    return pm.Packing(place, np.full(beads, 0.5), pm.Box.cubic(1.2 * beads, dimension), links)


def around() -> pm.Scene:
    """Return 12 discs in a chain that closes through the box wall, pressed by six free ones; wavy, not at rest."""
    rng, beads, side = np.random.default_rng(6), 12, 8.0
    place = np.stack([side * (np.arange(beads) + 0.5) / beads, 0.3 + 0.25 * rng.normal(size=beads)], axis=1)
    i, j = np.arange(beads), (np.arange(beads) + 1) % beads
    image = np.zeros((beads, 2), dtype=np.int64)
    image[-1, 0] = 1
    vector = place[j] - place[i] + side * image
    links = pm.Links(i, j, image, np.sqrt((vector**2).sum(axis=1)))
    free = np.stack([side * np.arange(6) / 6, np.full(6, 1.05)], axis=1) + 0.05 * rng.normal(size=(6, 2))
    packing = pm.Packing(np.concatenate([place, free]), np.full(beads + 6, 0.5), pm.Box(np.diag([side, 1.9])), links)
    return pm.Scene(packing, HARMONIC)


@cache
def scaled(ratio: float) -> pm.Scene:
    """Return 24 spheres, six pairs of them joined by links `ratio` times a radius long, at rest.

    Long links go around the box many times. Ends of short ones lie in one another.
    """
    rng = np.random.default_rng(8)
    packing = pm.random_packing(24, dimension=3, packing_fraction=0.8, seed=8)
    packing = pm.quench(pm.Scene(packing, HARMONIC), force_tolerance=1e-6).packing
    place, lattice = np.array(packing.position_nd), packing.box.lattice_dd
    i, j = np.arange(0, 12, 2), np.arange(1, 12, 2)
    reach = rng.normal(size=(6, 3))
    reach *= ratio * float(packing.radius_n.min()) / np.sqrt((reach**2).sum(axis=1))[:, None]
    image = np.zeros((6, 3), dtype=np.int64)
    if ratio > 1.0:
        image = np.rint((reach - place[j] + place[i]) @ np.linalg.inv(lattice).T).astype(np.int64)
    else:
        place[j] = place[i] + reach
    vector = place[j] - place[i] + image @ lattice.T
    packing = packing.replace(position_nd=place, links=pm.Links(i, j, image, np.sqrt((vector**2).sum(axis=1))))
    run = pm.quench(pm.Scene(packing, HARMONIC), force_tolerance=1e-8, check=False)
    if not run.ok or np.abs(run.packing.link_error).max() > 1e-13:
        raise RuntimeError(f"quench ended with {run.outcome.name}, link error {np.abs(run.packing.link_error).max()}")
    return pm.Scene(pm.remove_rattlers(run.packing)[0], HARMONIC)


@cache
def bags(at: float = 1e-6) -> pm.Scene:
    """Return four rings of 12 discs, each drawn tight around seven, pressed together softly from all sides."""
    rng = np.random.default_rng(10)
    places, pairs = [], []
    for k in range(4):
        turn = 2.0 * math.pi * (np.arange(12) + rng.random()) / 12
        inner = 2.0 * math.pi * (np.arange(6) + rng.random()) / 6
        around = np.stack([np.cos(turn), np.sin(turn)], axis=1) * 0.5 / math.sin(math.pi / 12)
        core = np.concatenate([[[0.0, 0.0]], np.stack([np.cos(inner), np.sin(inner)], axis=1)])
        places.append(np.concatenate([around, core]) + 4.4 * np.array([k % 2, k // 2 + 0.5 * (k % 2)]))
        pairs += [(19 * k + b, 19 * k + (b + 1) % 12) for b in range(12)]
    place = np.concatenate(places) + 0.01 * rng.normal(size=(76, 2))
    i, j = np.array(pairs).T
    radius = np.tile(np.r_[np.full(12, 0.5), np.full(7, 0.56)], 4)
    packing = pm.Packing(
        place, radius, pm.Box(np.diag([8.8, 8.8])), pm.Links(i, j, np.zeros((48, 2), dtype=np.int64), np.ones(48))
    )
    packing = pm.reaffix_links(packing).packing
    run = pm.shear_stabilize(pm.Scene(packing, HARMONIC), pressure=at)
    scene: pm.Scene = at_rest(pm.Scene(pm.remove_rattlers(run.packing)[0], HARMONIC))
    return scene


FAR = 1e6


SHAPES = {
    "collinear": [[1.0, 2.0], [1.6, 2.8], [2.2, 3.6]],
    "coplanar": [[1.0, 1.0, 1.0], [2.0, 1.0, 1.5], [1.0, 2.0, 1.2], [2.1, 2.2, 1.79]],
}


def _degenerate(shape: str) -> float:
    """Count what is not noticed of four: rank of the basis, the link and its shape by name, a refusal with both."""
    packing = rigid(SHAPES[shape])
    links, members = packing.links, packing.particles
    found = pm.independent_links(packing)
    named = [one for one in found.degenerate if one.shape == shape and len(one.particles) == members]
    missed = int(pm.constraint_basis(packing).rank != len(links) - 1) + int(found.rank != len(links) - 1)
    missed += int(len(named) != 1 or len(found.removed_l) != 0)
    shove = 0.05 * np.random.default_rng(1).normal(size=packing.position_nd.shape)
    try:
        pm.reaffix_links(packing.replace(position_nd=packing.position_nd + shove))
    except pm.NotConverged as error:
        return float(missed + (f"{shape} particles" not in str(error)))
    return float(missed + 1)


def _redundant_rings() -> float:
    """Return the largest error of the removed links after the kept ones are shoved and re-affixed; inf if not 2N-3."""
    packing = ring(8)
    links = packing.links
    found = pm.independent_links(packing)
    if found.rank != 2 * 8 - 3 or len(found.removed_l) != len(links) - found.rank or found.degenerate:
        return math.inf
    shove = 0.01 * np.random.default_rng(2).normal(size=packing.position_nd.shape)
    back = pm.reaffix_links(found.packing.replace(position_nd=packing.position_nd + shove)).packing
    return float(np.abs(back.replace(links=links).link_error).max())


def _inconsistent_ring() -> float:
    """Count wrong answers of two: a redundant link of the wrong length is refused, by the name of its pair."""
    packing = ring(8, 1e-3)
    try:
        pm.independent_links(packing)
    except ValueError as error:
        said = str(error)
        pair = [
            int(word) for word in said.partition("link of particles ")[2].replace(",", "").split() if word.isdigit()
        ]
        return float(len(pair) != 2 or not 0 <= pair[0] < pair[1] < 8)
    return 2.0


def _basis(packing: pm.Packing) -> float:
    """Return the orthogonality of the default basis; infinite if its rank is not the number of links."""
    links = packing.links
    basis = pm.constraint_basis(packing)
    return basis.orthogonality if basis.rank == len(links) else math.inf


def _projection(packing: pm.Packing) -> float:
    """Return the largest rate of a link in a projected random force, or what a second projection changes, relative."""
    force = np.random.default_rng(3).normal(size=packing.position_nd.shape)
    left = pm.project_force(packing, force).force_nd
    rate = np.abs(pm.constraint_jacobian(packing).T @ left.ravel()).max()
    again = np.abs(pm.project_force(packing, left).force_nd - left).max()
    return float(max(rate, again) / np.abs(force).max())


def _reaffixed(packing: pm.Packing, shove: float) -> float:
    """Return the largest error of a link after random shoves and the way back."""
    moved = packing.position_nd + shove * np.random.default_rng(4).normal(size=packing.position_nd.shape)
    return float(np.abs(pm.reaffix_links(packing.replace(position_nd=moved)).packing.link_error).max())


def _chain_quench(dimension: int) -> float:
    """Quench one free chain of 1000 in a box that it fills; return the link error, infinite unless at rest."""
    fraction = 0.85 if dimension == 2 else 0.66
    packing = pm.chain_packing(1, 1000, dimension=dimension, packing_fraction=fraction, seed=5)
    run = pm.quench(pm.Scene(packing, HARMONIC), force_tolerance=1e-6, check=False)
    at_end = run.packing
    return float(np.abs(at_end.link_error).max()) if run.ok and run.residual <= 1e-6 else math.inf


def _winding(packing: pm.Packing) -> int:
    """Return how often the ring of the first 12 particles goes around the box along x."""
    links = packing.links
    way = np.where(links.j_l == (links.i_l + 1) % 12, 1, -1)
    return int((way * links.image_ld[:, 0]).sum())


def _wound_quench() -> float:
    """Return the link error of the wound chain at rest; infinite if it came unwound or the quench failed."""
    run = pm.quench(around(), force_tolerance=1e-10, check=False)
    held = run.ok and _winding(run.packing) == 1 and pm.energy(pm.Scene(run.packing, HARMONIC)) > 0.0
    return float(np.abs(run.packing.link_error).max()) if held else math.inf


def _tangent_error(scene: pm.Scene, step: float) -> float:
    """Return the error of the exact tangent against finite differences, over its largest entry."""
    exact = pm.elastic_moduli(scene).cauchy
    finite = finite_tangent(scene, kept_step(scene, step))
    return float(np.abs(exact - finite).max() / np.abs(finite).max())


def _wound_moduli() -> float:
    scene = around()
    packing = pm.remove_rattlers(pm.quench(scene, force_tolerance=1e-12).packing)[0]
    moduli = pm.elastic_moduli(scene.replace(packing=packing))
    # the chain around the box is wavy: it gives way along x by straightening, so that no strain is forbidden
    if len(moduli.stiff_directions):
        return math.inf
    return _tangent_error(at_rest(scene.replace(packing=packing)), 1e-5)


def _scaled_residual(ratio: float) -> float:
    return force_balance(scaled(ratio))[0] / force_balance(scaled(ratio))[1]


def _scaled_hessian(ratio: float) -> float:
    """Return the error of the Hessian along a motion that links admit against differences of forces, relative.

    The motion ends where the links have their lengths again; forces of contacts and links are differenced together.
    """
    scene = scaled(ratio)
    packing = scene.packing
    shape = packing.position_nd.shape
    motion = pm.project_force(packing, np.random.default_rng(9).normal(size=shape)).force_nd
    motion /= np.abs(motion).max()
    along = float(motion.ravel() @ (pm.hessian(scene, strain="none") @ motion.ravel()))
    links = packing.links
    step = 1e-4 * min(1.0, float(links.length_l.min()))
    ends = []
    for sign in (1.0, -1.0):
        moved = packing.replace(position_nd=packing.position_nd + sign * step * motion)
        ends.append(scene.replace(packing=pm.reaffix_links(moved).packing))
    first = [float((pm.project_force(one.packing, pm.forces(one)).force_nd * motion).sum()) for one in ends]
    return abs(-(first[0] - first[1]) / (2.0 * step) - along) / abs(along)


def _scaled_moduli(ratio: float) -> float:
    scene = at_rest(scaled(ratio))
    return _tangent_error(scene, 1e-3 / ratio if ratio > 1.0 else 1e-3 * ratio)


def _taut_stress() -> float:
    """Return how far the total stress is from a pressure of 1e-6, or over the contacts' stress if that is larger."""
    scene = bags()
    total, contacts = (pm.stress_tensor(scene, parts=parts) for parts in ("total", "contacts"))
    if not np.abs(contacts).max() > 1e3 * np.abs(total).max():
        return math.inf
    wanted = 1e-6 * scene.pressure_unit
    return float(np.abs(total + wanted * np.eye(2)).max() / wanted)


def _taut_moduli() -> float:
    scene = bags()
    exact, paper = (pm.elastic_moduli(scene, kind=kind).cauchy for kind in ("exact", "paper"))
    # the two must differ, or the case says nothing
    differ = np.abs(paper - exact).max() > 0.1 * np.abs(exact).max()
    return _tangent_error(scene, 1e-8) if differ else math.inf


def _of_chain(quantity: Callable[[pm.Packing], float], dimension: int) -> float:
    return quantity(chain(dimension))


def _projected(packing: pm.Packing, shove: float) -> float:
    """Return the largest error of a link after shoves and the compiled steps back.

    Infinite if a particle came to lie farther than ten shoves from where it was pushed to: those places have the
    lengths too, if at all, but they are not those nearby.
    """
    moved = packing.position_nd + shove * np.random.default_rng(4).normal(size=packing.position_nd.shape)
    back = ConstraintFactor(packing).projected(packing.replace(position_nd=moved))
    error = float(np.abs(back.link_error).max())
    return error if np.abs(back.position_nd - moved).max() < 10.0 * shove else math.inf


def _angles_fixed(dimension: int, bend: float, shove: float) -> float:
    """Return that error for a chain of 1000 whose angles links hold."""
    return _projected(
        pm.chain_packing(1, 1000, dimension=dimension, packing_fraction=0.3, angles="fixed", bend=bend, seed=5), shove
    )


def _of_straight(quantity: Callable[[pm.Packing], float]) -> float:
    return quantity(chain(2, 200, 0.01, 2))


def _pulled() -> float:
    """Return the largest error of a tension, or force left, of a straight chain of 1000 pulled at its ends by 1."""
    beads = 1000
    place = np.stack([10.0 + np.arange(beads), np.full(beads, 5.0)], axis=1)
    links = pm.Links(np.arange(beads - 1), np.arange(1, beads), np.zeros((beads - 1, 2), dtype=int), np.ones(beads - 1))
    packing = pm.Packing(place, np.full(beads, 0.4), pm.Box(np.diag([1100.0, 20.0])), links)
    pull = np.zeros((beads, 2))
    pull[0, 0], pull[-1, 0] = -1.0, 1.0
    found = pm.project_force(packing, pull)
    return float(max(np.abs(found.multiplier_l - 1.0).max(), np.abs(found.force_nd).max()))


def _pulled_by_sweeps() -> float:
    """Return the error of the tensions after a hundred sweeps that put one link after the other right."""
    tension = np.zeros(999)
    pull = np.zeros(999)
    pull[[0, -1]] = 1.0
    for _ in range(100):
        for k in range(999):
            others = (tension[k - 1] if k else 0.0) + (tension[k + 1] if k < 998 else 0.0)
            tension[k] = 0.5 * (pull[k] + others)
    return float(np.abs(tension - 1.0).max())


def _all_but_straight(slack: float) -> pm.Packing:
    """Return a chain of 1000 around the box, one wave of it, longer than the box by that part of its length."""
    beads = 1000
    rise = 2.0 * math.sqrt(slack) * np.cos(2.0 * math.pi * (np.arange(beads) + 0.5) / beads)
    run = np.sqrt(1.0 - rise**2)
    place = np.stack([np.cumsum(run) - run, 50.0 + np.cumsum(rise) - rise], axis=1)
    image = np.zeros((beads, 2), dtype=int)
    image[-1, 0] = 1
    links = pm.Links(np.arange(beads), (np.arange(beads) + 1) % beads, image, np.ones(beads))
    return pm.Packing(place, np.full(beads, 0.3), pm.Box(np.diag([float(run.sum()), 100.0])), links)


def _taut(slack: float) -> float:
    """Return the largest error of a link of that chain after shoves and the way back, infinite if it was refused."""
    packing = _all_but_straight(slack)
    moved = packing.position_nd + 1e-4 * np.random.default_rng(4).normal(size=packing.position_nd.shape)
    return pm.reaffix_links(packing.replace(position_nd=moved)).packing.link_error


def _too_taut() -> float:
    """Count wrong answers of two: the chain that is straight to 1e-8 is not brought back, for a reason with a name."""
    packing = _all_but_straight(1e-8)
    moved = packing.position_nd + 1e-4 * np.random.default_rng(4).normal(size=packing.position_nd.shape)
    back = pm.reaffix_links(packing.replace(position_nd=moved), check=False)
    named = any(one.shape == "collinear" for one in back.degenerate)
    return float((back.outcome is not pm.Outcome.DEGENERATE) + (not named))


CASES = (
    *(
        HardCase(
            f"{shape} {name}",
            "its links lose rank: a basis has a column of rounding, Newton's method crawls, forces are arbitrary",
            "answers missed of four: rank of the basis, rank and shape by name, refusal of re-affixing by that name",
            0.0,
            f"{links} links of rank {links - 1}: closed form",
            partial(_degenerate, shape),
        )
        for shape, name, links in (("collinear", "trimer", 3), ("coplanar", "tetramer", 6))
    ),
    HardCase(
        "redundant rings, consistent",
        "28 links among 8 particles in a plane: 15 singular directions in every solve",
        "error of the removed links once the 13 kept ones are back at their lengths",
        1e-13,
        "what links hold to; infinite unless 2 N - 3 are kept",
        _redundant_rings,
    ),
    HardCase(
        "redundant rings, one link too long",
        "lengths that cannot all hold are quietly averaged",
        "wrong answers of two: refused, the pair named",
        0.0,
        "no places in the plane have these lengths",
        _inconsistent_ring,
    ),
    *(
        case
        for dimension in (2, 3)
        for case in (
            HardCase(
                f"basis of a chain of 1000, {dimension}D",
                "orthogonality is lost from link to link along the chain",
                "largest entry of Q^T Q - 1",
                2e-15,
                "what the default basis promises; infinite if a link is taken for dependent",
                partial(_of_chain, _basis, dimension),
            ),
            HardCase(
                f"projection on a chain of 1000, {dimension}D",
                "rates that cancel along the chain leave rounding",
                "largest rate of a link, or change by a second projection, over the force",
                1e-13,
                "a thousand roundings of 2e-16 that add up at random, with a digit to spare",
                partial(_of_chain, _projection, dimension),
            ),
            HardCase(
                f"re-affixing a chain of 1000, {dimension}D",
                "shoves of 2 % add up along the chain",
                "largest error of a link",
                1e-13,
                "what links hold to",
                partial(_of_chain, partial(_reaffixed, shove=0.02), dimension),
            ),
            HardCase(
                f"quench of a chain of 1000, {dimension}D",
                "one cluster: no limit on how far a force is carried; links drift",
                "largest error of a link at rest",
                1e-13,
                "what links hold to; infinite unless the residual is at most 1e-6",
                partial(_chain_quench, dimension),
            ),
        )
    ),
    *(
        HardCase(
            f"re-affixing a chain of 1000, angles fixed, {how}{dimension}D",
            "1997 links that nearly depend on each other: the normal matrix squares their condition, 1e6 to 1e9",
            f"largest error of a link after shoves of {shove:g}, by the compiled steps alone",
            1e-13,
            "what links hold to, and ten roundings of coordinates of 50; infinite unless found within ten shoves",
            partial(_angles_fixed, dimension, bend, shove),
        )
        for how, bend, shove in (
            ("", 2.0 * math.pi / 3.0, 0.02),
            ("bent by 0.05 at most, ", 0.05, 1e-3),
            ("nearly straight, ", 0.01, 1e-4),
        )
        for dimension in (2, 3)
    ),
    HardCase(
        "re-affixing a chain of 1000 with links to the next three, 3D",
        "its shape is rigid, and bends without changing a length by more than a 1e9th of that",
        "largest error of a link after shoves of 1e-3, by the compiled steps alone",
        8e-13,
        "coordinates of 1000 are rounded by 1.1e-13: three axes, two ends; infinite unless found within ten shoves",
        lambda: _projected(chain(3, 1000, 0.6, 3), 1e-3),
    ),
    HardCase(
        "basis of a nearly straight chain",
        "bends within 0.01 rad, held by links that nearly depend on each other",
        "largest entry of Q^T Q - 1",
        2e-15,
        "what the default basis promises; infinite if a link is taken for dependent",
        partial(_of_straight, _basis),
    ),
    HardCase(
        "re-affixing a nearly straight chain",
        "the normal matrix has the square of the condition of its links",
        "largest error of a link after shoves of 1e-4",
        1e-13,
        "what links hold to",
        partial(_of_straight, partial(_reaffixed, shove=1e-4)),
    ),
    HardCase(
        "a chain of 1000 pulled straight at its ends",
        "a pull goes from link to link: what is put right one link after the other never reaches the middle",
        "largest error of a tension, and of the force that is left, over the pull",
        2e-12,
        "tension is the pull everywhere; a thousand sums that round by 2e-16, and a digit",
        _pulled,
        _pulled_by_sweeps,
    ),
    *(
        HardCase(
            f"a chain of 1000 around the box, straight to {slack:.0e}",
            "all that is left to move is sideways, by the square of the way",
            "largest error of a link after shoves of 1e-4, infinite if refused",
            4.5e-13,
            "coordinates of 1000 are rounded by 1.1e-13: two axes, two ends",
            partial(_taut, slack),
        )
        for slack in (1e-4, 1e-6)
    ),
    HardCase(
        "a chain of 1000 around the box, straight to 1e-8",
        "links that cannot all be met are quietly averaged, or steps never end",
        "wrong answers of two: degenerate, collinear by name",
        0.0,
        "shoves of 1e-4 are as large as all its slack: links lose rank",
        _too_taut,
        "steps go on to their limit, and the last one is returned",
    ),
    HardCase(
        "chain wound around the box, quench",
        "images found anew by the nearest copy unwind the chain",
        "largest error of a link at rest",
        1e-13,
        "what links hold to; infinite unless it still goes around once",
        _wound_quench,
    ),
    HardCase(
        "chain wound around the box, moduli",
        "its links bear stress across the box wall",
        "error of the tangent against differences of the stress at rest again, relative",
        1e-6,
        "differences err by the square of a strain of 1e-5 over overlaps, and by rounding over it",
        _wound_moduli,
    ),
    *(
        case
        for ratio, name in ((FAR, "1e6 times longer than a radius"), (1.0 / FAR, "1e6 times shorter than a radius"))
        for case in (
            HardCase(
                f"links {name}, quench",
                "lengths and overlaps differ by twelve digits in one system",
                "largest constrained force over the mean contact force",
                1e-8,
                "the tolerance asked for; raises unless links hold to 1e-13 of the larger of length and diameter",
                partial(_scaled_residual, ratio),
            ),
            HardCase(
                f"links {name}, Hessian",
                "tension over length is the curvature of a link: lost, or all there is",
                "error of the curvature along an admitted motion against differences of constrained forces, relative",
                1e-5,
                "differences over 1e-4 of the shorter of link and diameter",
                partial(_scaled_hessian, ratio),
            ),
            HardCase(
                f"links {name}, moduli",
                "a strain moves the ends of long links by many diameters; short ones turn instead",
                "error of the tangent against differences of the stress at rest again, relative",
                1e-5,
                "differences over strains of 1e-9, in which the stress keeps six digits",
                partial(_scaled_moduli, ratio),
            ),
        )
    ),
    HardCase(
        "taut rings near zero pressure, stress",
        "links bear what contacts push: leaving them out, the pressure is a thousand times too large or more",
        "error of the total stress over the pressure asked for, 1e-6",
        1e-8,
        "what shear stabilization promises; infinite unless the contacts' stress is 1e3 times the total",
        _taut_stress,
    ),
    HardCase(
        "taut rings near zero pressure, moduli",
        "tensions are large where the pressure is small: the paper form does not come right with it",
        "error of the tangent against differences of the stress at rest again, relative",
        1e-6,
        "differences over strains of 1e-8; infinite unless the paper form is off by a tenth",
        _taut_moduli,
    ),
)
