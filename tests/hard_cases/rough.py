"""Hard cases of friction and of stiffness: every contact at the Coulomb limit, coefficients of 1e6, ratios of 1e8."""

from __future__ import annotations

import math
from functools import cache, partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

import packmech as pm
from hard_cases.case import HardCase
from hard_cases.dynamics import STILL, dense_packing, frictional_scene, pair_of

SPRING = pm.Repulsion(law=pm.LinearSpring())
COEFFICIENT, ACROSS = 0.5, 0.4
ROUGH = (SPRING, pm.Friction(COEFFICIENT, ACROSS))


@cache
def sheared_crystal(dimension: int) -> pm.Scene:
    """Return a pressed square or cubic crystal whose springs are stretched to the Coulomb limit, in balance.

    Tangential forces make up a shear stress that is symmetric: those along y at contacts along x are those along x at
    contacts along y, so that no disc is turned; of spheres each contact bears two such parts.
    """
    name = "square" if dimension == 2 else "sc"
    packing = pm.lattice_packing(name, repeats=(3,) * dimension, relative_overlap=0.01)
    contacts = pm.find_contacts(packing, gap_tolerance=0.0)
    limit_c = COEFFICIENT * -contacts.gap_c
    along_cd = np.abs(contacts.normal_cd).round()
    if dimension == 2:
        # the tangent of a contact along y is against x
        stretch = (limit_c * (along_cd[:, 0] - along_cd[:, 1]))[:, None]
    else:
        # against the direction of i to j where that is against the axis
        sign = contacts.normal_cd.sum(axis=1).round()
        stretch = (1.0 - along_cd) * (sign * limit_c / math.sqrt(2.0))[:, None]
    springs = pm.TangentialDisplacements(contacts.i_c, contacts.j_c, contacts.image_cd, stretch / ACROSS)
    return pm.Scene(packing.replace(tangential=springs), ROUGH)


def _all_at_limit(dimension: int) -> float:
    """Largest error of: part of contacts at the limit, shear stress over its closed form, residual."""
    found = pm.contact_forces(sheared_crystal(dimension))
    push = COEFFICIENT * found.pressure
    part = push if dimension == 2 else push / math.sqrt(2.0)
    shear = np.abs(found.stress_dd - np.diag(np.diag(found.stress_dd)))
    wrong = np.abs(shear[~np.eye(dimension, dtype=bool)] / part - 1.0).max()
    return float(max(1.0 - found.at_limit_c.mean(), abs(found.sliding_fraction - 1.0), found.residual, wrong))


def _missed_at_limit(dimension: int) -> float:
    """Return the part of the contacts whose tangential force is not above the limit, compared as numbers."""
    found = pm.contact_forces(sheared_crystal(dimension))
    size = np.sqrt((found.tangential_cd**2).sum(axis=1))
    return float((size < COEFFICIENT * found.normal_c).mean())


def _moduli_at_limit() -> float:
    """Largest error of three shear moduli over that of sticking contacts: all slip, loaded further, unloaded."""
    scene = sheared_crystal(2)
    shear = np.array([[0.0, 1.0], [1.0, 0.0]])
    sign = -float(np.sign(pm.stress_tensor(scene)[0, 1]))

    def modulus(at_limit: Any) -> float:
        return pm.elastic_moduli(scene, kind="unstressed", contacts_at_limit=at_limit).shear_modulus

    stick, slip = modulus("stick"), modulus("slip")
    one, other = modulus(sign * shear), modulus(-sign * shear)
    # a strain along the stress loads, one against it unloads
    loaded, unloaded = other, one
    return max(abs(slip), abs(loaded), abs(unloaded - stick)) / stick


def _gears() -> float:
    """Largest error, over the spin at the start, of discs of a square crystal that all spin the same way.

    Surfaces meet head on at every contact: springs stretch, Omega^2 = 8 r^2 k / I, until they slide at mu N, and 4 mu N
    r brakes each disc from then on.
    """
    packing = pm.lattice_packing("square", repeats=(4, 4), relative_overlap=0.05)
    packing = packing.replace(mass_n=np.ones(16))
    radius, start = float(packing.radius_n[0]), 2.0
    force = 0.05 * 2.0 * radius
    # arms are the halves of the distance
    arm, inertia = 0.95 * radius, 0.5 * radius**2
    run: Any = pm.simulate(
        frictional_scene(packing),
        duration=4.0,
        dt=2e-3,
        spin_nk=np.full((16, 1), start),
        applied_strain=STILL,
        trace_every=1,
    )
    omega = math.sqrt(8.0 * arm**2 * ACROSS / inertia)
    stretched = COEFFICIENT * force / ACROSS
    slides = math.asin(stretched * omega / (2.0 * arm * start)) / omega
    spin = start * math.cos(omega * slides) - 4.0 * COEFFICIENT * force * arm / inertia * (
        run.trace.time_t[-1] - slides
    )
    if run.trace.sliding_t[-1] != 32 or spin < 0.1:
        return math.inf
    return float(np.abs(run.spin_nk - spin).max() / start)


def _gears_naive() -> float:
    """Return the error of the closed form that lets all contacts slide from the start."""
    radius = 0.5
    arm, inertia, force, start = 0.95 * radius, 0.5 * radius**2, 0.05, 2.0
    omega = math.sqrt(8.0 * arm**2 * ACROSS / inertia)
    slides = math.asin(COEFFICIENT * force / ACROSS * omega / (2.0 * arm * start)) / omega
    braking = 4.0 * COEFFICIENT * force * arm / inertia
    return abs(start * math.cos(omega * slides) - start + braking * slides) / start


def _endless_friction() -> float:
    """Largest difference of places after 3000 steps between coefficients of 1e3 and 1e6: neither is reached."""
    thermal = 1e-3 * np.random.default_rng(0).standard_normal((40, 2))
    ends = [
        pm.simulate(
            frictional_scene(dense_packing(), friction=coefficient, damping=0.3, damping_across=0.2),
            steps=3000,
            velocity_nd=thermal,
            applied_strain=STILL,
            trace_every=100,
        )
        for coefficient in (1e3, 1e6)
    ]
    sliding: Any = [one.trace for one in ends]
    if sliding[1].sliding_t.any():
        return math.inf
    return float(np.abs(ends[0].packing.position_nd - ends[1].packing.position_nd).max())


def _cone(coefficient: float, angle: float) -> bool:
    """Return whether a disc that touches two held ones at an angle between the contacts is held by friction."""
    reach = 0.999 * np.array(
        [[math.cos(0.5 * angle), math.sin(0.5 * angle)], [math.cos(0.5 * angle), -math.sin(0.5 * angle)]]
    )
    place = 5.0 + np.vstack([reach, [[0.0, 0.0]]])
    packing = pm.Packing(place, np.full(3, 0.5), pm.Box.cubic(10.0, 2))
    scene = pm.Scene(packing, (SPRING, pm.Friction(coefficient, ACROSS), pm.FixedParticles((0, 1))))
    return not pm.contact_forces(scene).rattlers_n[2]


def _cones(coefficient: float) -> float:
    """Count wrong answers of two: held just inside the cone of friction, not held just outside."""
    # the chord between the contacts leans by 90 degrees less half the angle against either normal
    edge = math.pi - 2.0 * math.atan(coefficient)
    return float((not _cone(coefficient, edge * 1.1)) + _cone(coefficient, edge * 0.9))


RATIO = 1e8


def _springs(ratio: float) -> tuple[Any, ...]:
    """Return springs of 1 between particles of kind 0, of the ratio between those of kind 1, its root between both."""
    small, both, large = (pm.LinearSpring(ratio**power) for power in (0.0, 0.5, 1.0))
    return (pm.Repulsion(law=pm.LawByKind({(0, 0): small, (0, 1): both, (1, 1): large})),)


@cache
def _two_kinds() -> pm.Packing:
    start = pm.random_packing(128, dimension=2, packing_fraction=0.87, seed=4)
    return start.replace(kind_n=(start.radius_n > 1.1 * start.radius_n.min()).astype(np.int64))


def _stiff_jam(ratio: float, pressure: float) -> float:
    """Residual, over eight of the floors that the run reports, of a jammed packing; below one only if called a success.

    Of a run that ends otherwise it is one, so that nothing is claimed, unless it claims to be jammed to the tolerance.
    """
    scene = pm.Scene(_two_kinds(), _springs(ratio))
    run = pm.jam(scene, pressure=pressure / ratio, strain="isotropic", check=False)
    there = pm.contact_forces(scene.replace(packing=run.packing)).residual
    if not run.ok:
        return 1.0
    return there / max(8.0 * float(run.report["rounding_floor"]), 1e-5)


@cache
def _stiff_displaced() -> pm.DisplacedRest:
    """Return the packing of equal springs, its larger discs made stiffer by ten again and again at the same force."""
    packing = pm.jam(pm.Scene(_two_kinds(), (SPRING,)), pressure=1e-6, strain="isotropic").packing
    for power in range(1, 9):
        ratio = 10.0**power
        run = pm.displaced_rest(pm.Scene(packing, _springs(ratio)), pressure=1e-6 / ratio)
        packing = run.packing
    return run


def _chain_levels(dtype: Any) -> NDArray[np.float64]:
    """Return relative errors of the soft branch of a chain of springs of 1 and 1e8 in turn, against closed form.

    m w^2 = k + K - sqrt(k^2 + K^2 + 2 k K cos q), written without the difference as 2 k K (1 - cos q) / (k + K + ...).
    """
    cells = 12
    kind = np.tile([0, 0, 1, 1], cells // 2)
    place = np.column_stack([np.arange(2.0 * cells), np.full(2 * cells, 1.0)])
    packing = pm.Packing(place, np.full(2 * cells, 0.5), pm.Box(np.diag([2.0 * cells, 3.0])), kind_n=kind)
    law = pm.LawByKind({(0, 0): pm.LinearSpring(1.0), (0, 1): pm.LinearSpring(RATIO), (1, 1): pm.LinearSpring(1.0)})
    matrix = pm.hessian(pm.Scene(packing, (pm.Repulsion(law=law),)), strain="none").toarray()[::2, ::2]
    found = np.linalg.eigvalsh(matrix.astype(dtype)).astype(float)[:cells]
    half = 1.0 - np.cos(2.0 * np.pi * np.arange(cells) / cells)
    total = 1.0 + RATIO
    exact = np.sort(2.0 * RATIO * half / (total + np.sqrt(np.maximum(total**2 - 2.0 * RATIO * half, 0.0))))
    return np.asarray(np.abs(found - exact)[1:] / exact[1:])


def _unequal_masses() -> float:
    """Largest relative error of both velocities after a disc 1e8 times heavier has hit one at rest, in its frame."""
    ratio, speed = 1e8, 0.1
    packing = pair_of(1.05).replace(mass_n=[ratio, 1.0])
    run = pm.simulate(
        frictional_scene(packing, friction=0.0),
        duration=6.0,
        dt=1e-3,
        velocity_nd=[[speed, 0.0], [0.0, 0.0]],
        applied_strain=STILL,
    )
    light = 2.0 * speed * ratio / (ratio + 1.0)
    lost = 2.0 * speed / (ratio + 1.0)
    moved = run.velocity_nd[:, 0]
    return float(max(abs(moved[1] / light - 1.0), abs((speed - moved[0]) / lost - 1.0)))


GRAVITY = 1e-4


def _column(count: int, lid: float) -> pm.Scene:
    """Return a column of discs of mass 1 on one grain, the uppermost so heavy, held in line by two walls."""
    mass = np.ones(count)
    mass[-1] = lid
    place = np.column_stack([np.full(count, 2.0), 0.5 + np.arange(count)])
    packing = pm.Packing(place, np.full(count, 0.5), pm.Box(np.diag([4.0, count + 4.0])), mass_n=mass)
    sides = pm.Walls(axis=0, low=1.51, high=2.49, law=pm.LinearSpring())
    return pm.Scene(packing, (SPRING, pm.Gravity(0.0, -GRAVITY), sides, pm.FixedParticles((0,))))


def _weights(count: int, lid: float, dtype: Any = np.float64) -> float:
    """Largest relative error of a force in a column against the weight above it, its places in a precision."""
    scene = _column(count, lid)
    run = pm.quench(scene, force_tolerance=1e-13, check=False)
    place = run.packing.position_nd.astype(dtype).astype(np.float64)
    found = pm.contact_forces(scene.replace(packing=run.packing.replace(position_nd=place)))
    above = GRAVITY * np.cumsum(run.packing.mass_n[::-1])[::-1]
    if len(found.contacts) != count - 1:
        return math.inf
    return float(np.abs(found.normal_c / above[found.contacts.j_c] - 1.0).max())


CASES = (
    *(
        HardCase(
            f"every contact at the Coulomb limit, {name}",
            "tangential forces equal to the limit are above or below it by rounding: half of them seem to stick",
            "largest error of the part that slides, of the shear stress, of balance",
            1e-12,
            "closed form mu P, over root 2 in space; overlaps of .01 are rounded by 4e-16 each",
            partial(_all_at_limit, dimension),
            partial(_missed_at_limit, dimension),
        )
        for dimension, name in ((2, "square crystal"), (3, "cubic crystal"))
    ),
    HardCase(
        "shear modulus where every contact is at the limit",
        "one stiffness for both ways: contacts that slide forth stick on the way back",
        "errors of the moduli: all slip, loaded further, unloaded; over that of sticking contacts",
        1e-10,
        "closed form: springs that slide bear no more, and nothing else resists a shear of the square crystal",
        _moduli_at_limit,
        "one of the two answers for both ways: off by 1, all of it",
    ),
    HardCase(
        "a crystal whose discs all spin alike",
        "every contact slides at once, and nothing moves but spins: the limit is met in one step by all",
        "largest error of a spin over that at the start (infinite unless all 32 contacts slide)",
        2e-5,
        "the limit is passed within a step, in which braking grows by 5.8 w dt, for half a step: 5.8 dt^2 / 2 = 1.2e-5",
        _gears,
        _gears_naive,
    ),
    HardCase(
        "coefficient of friction 1e6 in time",
        "a limit that is never reached has a part in the answer",
        "largest difference of places to a coefficient of 1e3, 3000 steps",
        0.0,
        "contacts that never slide do not know the coefficient",
        _endless_friction,
    ),
    *(
        HardCase(
            f"held by two contacts at the edge of the cone, mu = {coefficient:g}",
            "a disc in a wedge is held or slips out by a tenth of the angle",
            "wrong answers of two: held inside the cone, not outside",
            0.0,
            "the chord between two contacts lies in both cones or in none; opposite means to 1e-8 rad",
            partial(_cones, coefficient),
            "two contacts of a disc count as holding it, or as not: wrong once whatever the angle",
        )
        for coefficient in (0.1, 1.0, 1e3, 1e6)
    ),
    *(
        HardCase(
            f"stiffness ratio {ratio:.0e}, jammed",
            "stiff contacts overlap so much less than soft ones that rounding is all there is of them",
            "residual over eight of the reported floors; one for a run that is not called a success",
            1.0,
            "eight floors are what counts as at rest, and no more may be claimed",
            partial(_stiff_jam, ratio, pressure),
        )
        for ratio, pressure in ((1e2, 1e-8), (1e4, 1e-8), (1e8, 1e-5))
    ),
    HardCase(
        "stiffness ratio 1e8, displacements",
        "stiff contacts overlap by 1e-14 where soft ones do by 1e-6",
        "residual of displacements from a packing of equal springs",
        1e-10,
        "asked for as 1e-10",
        lambda: _stiff_displaced().residual,
        lambda: pm.contact_forces(pm.Scene(_stiff_displaced().packing, _springs(RATIO))).residual,
    ),
    HardCase(
        "stiffness ratio 1e8, vibrations of a chain",
        "the soft branch is a difference of eigenvalues of 1e8",
        "largest relative error of an eigenvalue of the soft branch",
        1e-6,
        "eigenvalues round by 2e-16 of the largest, 2e8, times a few over the lowest, .13",
        lambda: float(_chain_levels(np.float64).max()),
        lambda: float(_chain_levels(np.float32).max()),
    ),
    HardCase(
        "mass ratio 1e8, head on",
        "the heavy disc's change of velocity is lost in its velocity",
        "largest relative error of the light disc's velocity and of what the heavy one lost",
        1e-5,
        "second order, (w dt)^2 = 1e-6 with w^2 = k / m, and contact ends within a step: a digit",
        _unequal_masses,
    ),
    *(
        HardCase(
            f"a column on one grain, {what}",
            "forces from one weight to all of them stand on each other, and the mean force judges them all",
            "largest relative error of a force against the weight above",
            bound,
            why,
            partial(_weights, count, lid),
            partial(_weights, count, lid, np.float32),
        )
        for what, count, lid, bound, why in (
            (
                "100 discs",
                100,
                1.0,
                1e-9,
                "each disc is out of balance by a floor, 1.4e-14 times six springs, over its weight, 1e-4",
            ),
            (
                "its lid 1e3 times heavier",
                30,
                1e3,
                2e-11,
                "thirty discs each out of balance by a floor, 7e-15 times six springs, over .1",
            ),
        )
    ),
)
