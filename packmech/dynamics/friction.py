# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Tangential springs of contacts and bonds, and friction: a scene without it (None) holds none of its code.

A row of `body` holds x, y, z, radius, the peculiar velocity (d numbers) and, where particles turn, the spin (1 in a
plane, 3 in space); a row of `push` the force (d) and the torque. Of shapes the radius is that of the disc or sphere
that holds them, and in space their angular momentum over a moment of inertia stands for the spin (`shape_pairs`,
`rigid_bodies`).

A tangential displacement is the integral of the slip velocity, by the trapezoidal rule: a pass first adds `before`
times the slip, takes the force, and then adds `after` times it. In space it turns with the contact by half a step
before and half a step after.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

from numba import types

from packmech.effects import (
    ConstantRolling,
    Friction,
    Mindlin,
    RollingResistance,
    RoughContacts,
    TwistingResistance,
    ViscousRolling,
    at_contact,
    at_normal_force,
    bonds_of,
    cap_force,
    friction_or_zero,
    is_bound,
    pair_damping,
    resistances,
    rough_walls,
    roughness_of,
    walls_met,
)
from packmech.effects.kinds import bounding_partners
from packmech.effects.pair import TouchingPair, at_overlap, hook_of
from packmech.effects.partners import Partners
from packmech.jit.by_type import by_type
from packmech.jit.compiled import compiled_form, device, inlined
from packmech.packing import Packing
from packmech.scene import Scene


class Slip(NamedTuple):
    """How two rows slip at a contact with the unit normal n from i to j.

    Levers are those of the contact point about either center: their lengths along n (of i) and -n (of j), or vectors,
    of j with the other sign. The slip velocity is s, in a plane its component sx along t = (-ny, nx), and o the angular
    velocity with which the contact turns.
    """

    nx: float
    ny: float
    nz: float
    lever_i: Any
    lever_j: Any
    sx: float
    sy: float
    sz: float
    ox: float
    oy: float
    oz: float


class Pace(NamedTuple):
    """A time step: how much of the slip is added to a spring before and after the force is taken [time]."""

    before: float
    after: float


class Now(NamedTuple):
    """The time of the force taken last, which changes no spring: they are ahead of it by the slip of this time."""

    after: float


class Spring(NamedTuple):
    """Where the stretch of a tangential spring stands: the array, its row, and its first column there."""

    stretch_pk: Any
    p: Any
    k: Any


class Across(NamedTuple):
    """A tangential force on i, its moment n x f, the stretch of its spring, and whether it is at Coulomb's cap."""

    fx: float
    fy: float
    fz: float
    mx: float
    my: float
    mz: float
    x: float
    y: float
    z: float
    sliding: float


class Turning(NamedTuple):
    """What resists rolling and twisting at a contact, each as `Across` has it; None for what a scene lacks."""

    rolling: Any
    twisting: Any


class Slipping(NamedTuple):
    """How a contact slips: the friction with the numbers it has there, the slip, and how its rows turn; or None."""

    here: Friction
    slip: Slip
    turns: Any


class Pull(NamedTuple):
    """What two rows do to each other: force on i, torques on both, normal force, and what `Across` says of the spring.

    The force on j is the opposite one. `turning` is what resists rolling and twisting; None without.
    """

    fx: float
    fy: float
    fz: float
    on_i: Any
    on_j: Any
    normal: float
    across: Across
    turning: Any


@device
def rotated(x, y, z, ox, oy, oz, time):
    """Return a stretch turned by the angular velocity o for a time."""
    # the rotation of Cayley, (1 - W t/2)^-1 (1 + W t/2), keeps lengths and is of second order
    hx, hy, hz = 0.5 * time * ox, 0.5 * time * oy, 0.5 * time * oz
    cx, cy, cz = x + hy * z - hz * y, y + hz * x - hx * z, z + hx * y - hy * x
    dot = hx * cx + hy * cy + hz * cz
    scale = 1.0 / (1.0 + hx * hx + hy * hy + hz * hz)
    return (
        scale * (cx + hy * cz - hz * cy + hx * dot),
        scale * (cy + hz * cx - hx * cz + hy * dot),
        scale * (cz + hx * cy - hy * cx + hz * dot),
    )


@device
def stretch_before(x, y, z, slip, time):
    """Return a stretch after a time at the present slip: turned, laid into the tangent plane, and stretched."""
    size = x * x + y * y + z * z
    if size > 0.0:
        x, y, z = rotated(x, y, z, slip.ox, slip.oy, slip.oz, time)
        along = x * slip.nx + y * slip.ny + z * slip.nz
        x -= along * slip.nx
        y -= along * slip.ny
        z -= along * slip.nz
        left = x * x + y * y + z * z
        scale = math.sqrt(size / left) if left > 0.0 else 0.0
        x *= scale
        y *= scale
        z *= scale
    return x + time * slip.sx, y + time * slip.sy, z + time * slip.sz


@device
def stretch_after(x, y, z, slip, time):
    """Return a stretch after a time at the present slip: stretched, then turned."""
    x, y, z = x + time * slip.sx, y + time * slip.sy, z + time * slip.sz
    return rotated(x, y, z, slip.ox, slip.oy, slip.oz, time)


def by_pace(in_steps: Any, now: Any) -> Any:
    """Return a function that runs one of two, by its last argument: a `Pace` or `Now`; compiled code only."""

    def chosen(*arguments: Any) -> Any:
        raise NotImplementedError("springs are stretched in compiled loops")

    compiled_form(chosen, inline=True)(lambda *arguments: now if arguments[-1].instance_class is Now else in_steps)
    return chosen


@inlined
def _read(axes, spring):
    stretch, p, k = spring
    if len(axes) == 2:
        return stretch[p, k], 0.0, 0.0
    return stretch[p, k], stretch[p, k + 1], stretch[p, k + 2]


@inlined
def _advanced(axes, spring, slip, pace):
    x, y, z = _read(axes, spring)
    if len(axes) == 2:
        return x + pace.before * slip.sx, 0.0, 0.0
    return stretch_before(x, y, z, slip, pace.before)


@inlined
def _put_back(axes, spring, slip, now):
    x, y, z = _read(axes, spring)
    if len(axes) == 2:
        return x - now.after * slip.sx, 0.0, 0.0
    x, y, z = rotated(x, y, z, slip.ox, slip.oy, slip.oz, -now.after)
    return x - now.after * slip.sx, y - now.after * slip.sy, z - now.after * slip.sz


@inlined
def _keep(axes, spring, x, y, z, slip, pace):
    stretch, p, k = spring
    if len(axes) == 2:
        stretch[p, k] = x + pace.after * slip.sx
    else:
        stretch[p, k], stretch[p, k + 1], stretch[p, k + 2] = stretch_after(x, y, z, slip, pace.after)


@inlined
def _keep_nothing(axes, spring, x, y, z, slip, now):
    return None


@inlined
def _follow_stiffness(axes, spring, stiffness, pace):
    stretch, p, k = spring
    numbers = 1 if len(axes) == 2 else 3
    before = stretch[p, k + numbers]
    # as the normal force grows the tangential one stays, as it falls the stretch does
    share = before / stiffness if 0.0 < before < stiffness else 1.0
    for a in range(numbers):
        stretch[p, k + a] *= share
    stretch[p, k + numbers] = stiffness


@inlined
def _follow_nothing(axes, spring, stiffness, now):
    return None


_followed = by_pace(_follow_stiffness, _follow_nothing)


@inlined
def _same_stiffness(kind, axes, spring, stiffness, pace):
    return None


@inlined
def _other_stiffness(kind, axes, spring, stiffness, pace):
    _followed(axes, spring, stiffness, pace)


# change the stretch of a spring for its present stiffness, which may depend on the contact
follow_stiffness = by_type(_same_stiffness, {Mindlin: _other_stiffness})
# the stretch that the force at this time is made of, and what is kept of it for the next one
stretch_of_force = by_pace(_advanced, _put_back)
keep_stretch = by_pace(_keep, _keep_nothing)


@inlined
def slip_of_round(axes, touch, levers, u, wi, wj):
    """Return the slip of two discs or spheres, from the velocity u of their centers and the spins of both."""
    nx, ny, nz = touch.x, touch.y, touch.z
    ux, uy, uz = u
    ai, aj = levers
    if len(axes) == 2:
        return Slip(nx, ny, 0.0, ai, aj, uy * nx - ux * ny - ai * wi[2] - aj * wj[2], 0.0, 0.0, 0.0, 0.0, 0.0)
    wx, wy, wz = ai * wi[0] + aj * wj[0], ai * wi[1] + aj * wj[1], ai * wi[2] + aj * wj[2]
    along = ux * nx + uy * ny + uz * nz
    tx, ty, tz = ux - along * nx, uy - along * ny, uz - along * nz
    # the line of centers turns by n x dn/dt, and about itself with the mean spin along it
    about = 0.5 * ((wi[0] + wj[0]) * nx + (wi[1] + wj[1]) * ny + (wi[2] + wj[2]) * nz)
    inverse = 1.0 / touch.rho if touch.rho > 0.0 else 0.0
    return Slip(
        nx, ny, nz, ai, aj,
        # v_j - v_i - (a_i w_i + a_j w_j) x n, tangential part
        tx - (wy * nz - wz * ny), ty - (wz * nx - wx * nz), tz - (wx * ny - wy * nx),
        (ny * tz - nz * ty) * inverse + about * nx,
        (nz * tx - nx * tz) * inverse + about * ny,
        (nx * ty - ny * tx) * inverse + about * nz,
    )  # fmt: skip


@inlined
def slip_of_discs(axes, body, i, j, touch, u):
    """Return the slip of two rows of discs or spheres, from the velocity u of their centers."""
    share = touch.rho * (1.0 / touch.sigma)
    levers = body[i, 3] * share, body[j, 3] * share
    return slip_of_round(axes, touch, levers, u, spin_of_round(axes, body, i), spin_of_round(axes, body, j))


@inlined
def spin_of_round(axes, body, i):
    """Return the spin of a row of discs or spheres."""
    if len(axes) == 2:
        return 0.0, 0.0, body[i, 6]
    return body[i, 7], body[i, 8], body[i, 9]


@inlined
def across_contact(axes, slip, f, x, y, z, sliding):
    """Return a tangential force, in a plane given by its component along t, as `Across` has it."""
    nx, ny, nz = slip.nx, slip.ny, slip.nz
    fx, fy, fz = f
    if len(axes) == 2:
        # along t = (-ny, nx); the moment n x t is one
        return Across(fx * -ny, fx * nx, 0.0, 0.0, 0.0, fx, x, 0.0, 0.0, sliding)
    return Across(fx, fy, fz, ny * fz - nz * fy, nz * fx - nx * fz, nx * fy - ny * fx, x, y, z, sliding)


@inlined
def dot(a, b):
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@inlined
def cross(a, b):
    """Return the vector product."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def torque_of(lever: Any, across: Across) -> Any:
    """Return the torque of a tangential force whose lever is a length along the normal, or a vector."""
    raise NotImplementedError("particles are turned in compiled loops")


@compiled_form(torque_of, inline=True)
def _choose_torque_of(lever: Any, across: Any) -> Any:
    if isinstance(lever, types.Float):
        return lambda lever, across: (lever * across.mx, lever * across.my, lever * across.mz)
    return lambda lever, across: cross(lever, (across.fx, across.fy, across.fz))


@inlined
def add_force(axes, spins, push, i, pull):
    """Add a pull, and its torque where particles turn, to row i."""
    push[i, 0] += pull.fx
    push[i, 1] += pull.fy
    if len(axes) == 3:
        push[i, 2] += pull.fz
    _add_torque(axes, spins, push, i, pull.on_i)


@inlined
def add_reaction(axes, spins, push, j, pull):
    """Add the reaction to row j."""
    push[j, 0] -= pull.fx
    push[j, 1] -= pull.fy
    if len(axes) == 3:
        push[j, 2] -= pull.fz
    _add_torque(axes, spins, push, j, pull.on_j)


@inlined
def _add_torque(axes, spins, push, i, torque):
    if len(spins) == 1:
        push[i, 2] += torque[2]
    if len(spins) == 3:
        push[i, 3] += torque[0]
        push[i, 4] += torque[1]
        push[i, 5] += torque[2]


# overlaps at which contacts are looked up, barely and deep [1]
_OVERLAPS = (1e-9, 0.1)
# a time step so long that nothing is stable with it, though its cube is a number yet
_LARGEST_STEP = 1e100
# a little more than 1/3: oscillations up to omega dt = 1/3 then fall, by less than (omega dt)^4 / 100 a step
_SHARE = 0.35
# (omega dt)^2 of the fastest springs, over stiffness dt^2 / mass: with 6 neighbors, or 12 in space
_FASTEST = {2: 12.0, 3: 24.0}


def stiffening(packing: Packing) -> tuple[float, float]:
    """Return how many fold the stiffness of contacts, and of tangential springs, counts over mass.

    Tangential ones turn particles as well as move them, with the inertia m r^2 / 2 or 2 m r^2 / 5; of other shapes this
    is their own `stiffening`.
    """
    return packing.shapes.stiffening(packing.radius_n)


def frictions_at_contacts(scene: Scene, friction: Friction, smallest_mass: float) -> list[Any]:
    """Return a friction as it is at contacts of the smallest, mean and largest particles, barely and deep.

    For each pair of kinds whose coefficient is not 0, where effects look at these; the same for all where its stiffness
    and dashpot are numbers.
    """
    if all(isinstance(one, float) for one in friction):
        return [friction]
    pairs = _of_pairs(scene)
    found = [
        at_contact(friction, touch.second, sum(pair_damping(one, touch) for one in pairs), touch.kinds)
        for touch in _touches(scene, smallest_mass)
    ]
    return [one for one in found if one.coefficient > 0.0] or [Friction(0.0, 0.0, 0.0)]


def resistance_at_contacts(
    scene: Scene, resistance: Any, smallest_mass: float
) -> list[RollingResistance | TwistingResistance]:
    """Return what resists rolling or twisting as it is (`at_normal_force`) at the contacts of `frictions_at_contacts`.

    The same for all where it does not depend on the normal force. That of deep contacts bounds it, and not that of the
    present ones: what watches runs (`energy_drift`) does not find all that a force which grows makes unstable.
    """
    if not isinstance(resistance, ViscousRolling):
        return [at_normal_force(resistance, 0.0)]
    pairs, found = _of_pairs(scene), []
    for touch in _touches(scene, smallest_mass):
        partners = Partners(touch.contact_distance, touch.effective_radius, touch.kinds)
        normal = abs(touch.first) + sum(cap_force(one, touch.distance, partners) for one in pairs)
        found.append(at_normal_force(resistance, max(normal, 0.0)))
    return found


def _of_pairs(scene: Scene) -> list[Any]:
    return [one for one in scene.effects if not is_bound(one)]


def _touches(scene: Scene, smallest_mass: float) -> list[TouchingPair]:
    """Return contacts of the smallest, mean and largest particles, barely and deep."""
    return [
        at_overlap(_of_pairs(scene), overlap, partners, 0.5 * smallest_mass)
        for partners in bounding_partners(scene.effects, scene.packing, sites=True)
        for overlap in _OVERLAPS
    ]


def resistances_at_walls(scene: Scene, smallest_mass: float) -> list[Any]:
    """Return what acts across contacts of the smallest and of the largest particles with rough walls."""
    radius_n = scene.packing.radius_n
    radii = float(radius_n.min()), float(radius_n.max())
    met = [wall for one in rough_walls(scene.effects) for wall in walls_met(one, scene.packing)]
    return [each for wall in met for each in wall.resistances(radii, smallest_mass)]


def leading_share(scene: Scene, dt: float, smallest_mass: float) -> float:
    """Return the share of the forces' last change that belongs in extrapolated velocities [1].

    None, unless some tangential spring k has a dashpot c so weak that what it takes, (c / 2k) omega^2 dt of an
    oscillation in every step, is less than the growth.

    Parameters
    ----------
    scene
        The scene.
    dt, smallest_mass
        Time step, and the smallest mass.

    """
    friction, bonds = friction_or_zero(scene.effects), bonds_of(scene.effects)
    springs = [(one.stiffness, one.damping) for one in frictions_at_contacts(scene, friction, smallest_mass)]
    for resistance in resistances(roughness_of(scene.effects))[1:]:
        there = resistance_at_contacts(scene, resistance, smallest_mass)
        springs += [(one.stiffness, one.damping) for one in there]
    springs += [(one.stiffness, one.damping) for one in resistances_at_walls(scene, smallest_mass)]
    if bonds is not None:
        springs.append((bonds.tangential_stiffness, bonds.tangential_damping))
    fastest = _FASTEST[scene.packing.dimension] * stiffening(scene.packing)[1]
    weak = 0.25 * fastest * min(dt, _LARGEST_STEP) ** 3 / smallest_mass
    return _SHARE if any(k > 0.0 and c < weak * k * k for k, c in springs) else 0.0


def uncapped_force(friction: Any, stretch: float, slip: float) -> float:
    """Return the tangential force of a friction before its cap [force]."""
    return float(friction.tangential_force(stretch, slip))


@compiled_form(uncapped_force)
def _choose_uncapped_force(friction: Any, stretch: Any, slip: Any) -> Any:
    function = hook_of(friction, "tangential_force")
    if function is None:
        return None
    return lambda friction, stretch, slip: function(friction, stretch, slip)


def rolling_dashpot(rolling: Any, speed: float, normal: float) -> float:
    """Return the force of a resistance without a spring over the rolling velocity [mass/time]."""
    return float(rolling.rolling_dashpot(speed, normal))


@compiled_form(rolling_dashpot)
def _choose_rolling_dashpot(rolling: Any, speed: Any, normal: Any) -> Any:
    function = hook_of(rolling, "rolling_dashpot")
    if function is None:
        return None
    return lambda rolling, speed, normal: function(rolling, speed, normal)


def turning_axes(friction: Any, axes: Any) -> Any:
    """Return a tuple as long as the torques that a pair has: none without friction, 1 in a plane, 3 in space."""
    return () if friction is None else axes if len(axes) == 3 else axes[:1]


@compiled_form(turning_axes)
def _choose_turning_axes(friction: Any, axes: Any) -> Any:
    if isinstance(friction, types.NoneType):
        return lambda friction, axes: ()
    return (lambda friction, axes: axes) if len(axes) == 3 else (lambda friction, axes: (0,))


@inlined
def _friction_in_plane(friction, axes, spring, slip, normal, pace):
    stretch, _, _ = stretch_of_force(axes, spring, slip, pace)
    force = uncapped_force(friction, stretch, slip.sx)
    cap = friction.coefficient * normal
    soft = 1.0 / friction.stiffness
    # no branch predictor knows which contacts slide: without a branch, what the cap takes is taken off the spring too;
    # never past rest nor beyond what it was, so that a strong dashpot does not wind it
    capped = min(max(force, -cap), cap)
    less = stretch + (capped - force) * soft
    keep_stretch(axes, spring, min(max(less, min(stretch, 0.0)), max(stretch, 0.0)), 0.0, 0.0, slip, pace)
    return across_contact(axes, slip, (capped, 0.0, 0.0), stretch, 0.0, 0.0, _at_cap(abs(force), cap))


@inlined
def _at_cap(size, cap):
    # a spring at its cap is as far as it gets: rounding must not tell it from one beyond
    return 1.0 if size >= cap * (1.0 - 1e-9) else 0.0


@inlined
def _friction_in_space(friction, axes, spring, slip, normal, pace):
    sx, sy, sz = stretch_of_force(axes, spring, slip, pace)
    fx = uncapped_force(friction, sx, slip.sx)
    fy = uncapped_force(friction, sy, slip.sy)
    fz = uncapped_force(friction, sz, slip.sz)
    square = fx * fx + fy * fy + fz * fz
    cap = friction.coefficient * normal
    soft = 1.0 / friction.stiffness
    x, y, z = sx, sy, sz
    size = math.sqrt(square)
    if square > cap * cap:
        # as in a plane: the spring gives way along the force, and no farther than to rest
        along = (x * fx + y * fy + z * fz) / size
        less = min((size - cap) * soft, max(along, 0.0)) / size
        x -= less * fx
        y -= less * fy
        z -= less * fz
        scale = cap / size
        fx *= scale
        fy *= scale
        fz *= scale
    keep_stretch(axes, spring, x, y, z, slip, pace)
    return across_contact(axes, slip, (fx, fy, fz), sx, sy, sz, _at_cap(size, cap))


@inlined
def tangential_force(friction, axes, spring, slip, normal, pace):
    """Return the friction of a contact under a normal force, its spring taken along as the pace says."""
    if len(axes) == 2:
        return _friction_in_plane(friction, axes, spring, slip, normal, pace)
    return _friction_in_space(friction, axes, spring, slip, normal, pace)


def sliding_columns(friction: Any, axes: Any) -> Any:
    """Return a tuple as long as what friction keeps of one touch: a stretch, and of `Mindlin` its stiffness."""
    if friction is None or not isinstance(friction.stiffness, Mindlin):
        return turning_axes(friction, axes)
    return tuple(range(len(turning_axes(friction, axes)) + 1))


@compiled_form(sliding_columns)
def _choose_sliding_columns(friction: Any, axes: Any) -> Any:
    if isinstance(friction, types.NoneType) or getattr(friction.types[1], "instance_class", None) is not Mindlin:
        return lambda friction, axes: turning_axes(friction, axes)
    columns = tuple(range(4 if len(axes) == 3 else 2))
    return lambda friction, axes: columns


# a tuple as long as what resistance to rolling keeps of one touch: nothing where it has no spring
rolling_columns = by_type(
    lambda rolling, axes: (), {RollingResistance: lambda rolling, axes: turning_axes(rolling, axes)}
)


def spring_columns(friction: Any, axes: Any) -> Any:
    """Return a tuple as long as a row of stretches of one touch is: sliding, rolling, then twisting; empty without."""
    if not isinstance(friction, RoughContacts):
        return sliding_columns(friction, axes)
    sliding, rolling = len(sliding_columns(friction.friction, axes)), len(rolling_columns(friction.rolling, axes))
    return tuple(range(sliding + rolling + (friction.twisting is not None)))


@compiled_form(spring_columns)
def _choose_spring_columns(friction: Any, axes: Any) -> Any:
    if getattr(friction, "instance_class", None) is not RoughContacts:
        return lambda friction, axes: sliding_columns(friction, axes)
    kept = getattr(friction.types[0].types[1], "instance_class", None) is Mindlin
    rolling = getattr(friction.types[1], "instance_class", None) is RollingResistance
    twisting = not isinstance(friction.types[2], types.NoneType)
    columns = tuple(range((3 if len(axes) == 3 else 1) * (1 + rolling) + twisting + kept))
    return lambda friction, axes: columns


@inlined
def relax(friction, axes, spring):
    """Set the stretches of a contact that is open to zero; nothing where none are held."""
    relax_columns(spring_columns(friction, axes), spring.stretch_pk, spring.p, spring.k)


@inlined
def relax_columns(columns, stretch_pk, p, k):
    """Set so many stretches of a pair to zero, from a first one on; nothing where none are held."""
    if stretch_pk is not None:
        for a in range(len(columns)):
            stretch_pk[p, k + a] = 0.0


@inlined
def _no_resistance(resistance, axes, spring, slip, normal, pace):
    return None


@inlined
def _rolling_at(rolling, axes, spring, slip, normal, pace):
    return tangential_force(rolling, axes, spring, slip, normal, pace)


@inlined
def _rolling_damped(rolling, axes, spring, slip, normal, pace):
    sx, sy, sz = slip.sx, slip.sy, slip.sz
    speed = abs(sx) if len(axes) == 2 else math.sqrt(sx * sx + sy * sy + sz * sz)
    c = rolling_dashpot(rolling, speed, normal)
    return across_contact(axes, slip, (c * sx, c * sy, c * sz), 0.0, 0.0, 0.0, 0.0)


@inlined
def _twisting_at(twisting, axes, spring, slip, normal, pace):
    # one number, as the slip of a plane
    return _friction_in_plane(twisting, (0, 1), spring, slip, normal, pace)


# what resists rolling or twisting by a slip of its own; None where a scene lacks it
resist_rolling = by_type(
    _rolling_at, {type(None): _no_resistance, ConstantRolling: _rolling_damped, ViscousRolling: _rolling_damped}
)
resist_twisting = by_type(_twisting_at, {type(None): _no_resistance})


@inlined
def reduced_arm(slip):
    """Return the length that makes lengths of the angles by which round rows roll on each other."""
    both = slip.lever_i + slip.lever_j
    return slip.lever_i * slip.lever_j / both if both > 0.0 else 0.0


@inlined
def rolling_slip(axes, arm, wi, wj, slip):
    """Return the rolling of two discs or spheres as a slip: a (w_j - w_i) x n, in a plane its component along t."""
    nx, ny, nz = slip.nx, slip.ny, slip.nz
    x, y, z = arm * (wj[0] - wi[0]), arm * (wj[1] - wi[1]), arm * (wj[2] - wi[2])
    if len(axes) == 2:
        return Slip(nx, ny, 0.0, arm, arm, z, 0.0, 0.0, 0.0, 0.0, 0.0)
    return Slip(
        nx, ny, nz, arm, arm, y * nz - z * ny, z * nx - x * nz, x * ny - y * nx, slip.ox, slip.oy, slip.oz
    )  # fmt: skip


@inlined
def twisting_slip(arm, wi, wj, slip):
    """Return the twisting of two spheres as a slip of one number: a (w_j - w_i).n."""
    along = (wj[0] - wi[0]) * slip.nx + (wj[1] - wi[1]) * slip.ny + (wj[2] - wi[2]) * slip.nz
    return Slip(slip.nx, slip.ny, slip.nz, arm, arm, arm * along, 0.0, 0.0, 0.0, 0.0, 0.0)


@inlined
def _no_torque(resisting, arm, slip):
    return 0.0, 0.0, 0.0


@inlined
def _rolling_torque(resisting, arm, slip):
    return arm * resisting.mx, arm * resisting.my, arm * resisting.mz


@inlined
def _twisting_torque(resisting, arm, slip):
    # in the first column of a plane
    size = arm * resisting.mz
    return size * slip.nx, size * slip.ny, size * slip.nz


# torques on i of what resists rolling and twisting; those on j are the opposite ones
torque_of_rolling = by_type(_rolling_torque, {type(None): _no_torque})
torque_of_twisting = by_type(_twisting_torque, {type(None): _no_torque})


class Turns(NamedTuple):
    """How two round rows turn against each other at a contact: the arm, and rolling and twisting as slips."""

    arm: float
    roll: Slip
    twist: Slip


@inlined
def turns_at(axes, arm, wi, wj, slip):
    """Return how rows with these spins turn against each other."""
    return Turns(arm, rolling_slip(axes, arm, wi, wj, slip), twisting_slip(arm, wi, wj, slip))


@inlined
def _resist_sliding(friction, axes, here, slip, turns, spring, normal, pace):
    follow_stiffness(friction.stiffness, axes, spring, here.stiffness, pace)
    across = tangential_force(here, axes, spring, slip, normal, pace)
    return across, None, torque_of(slip.lever_i, across), torque_of(slip.lever_j, across)


@inlined
def _resist_all(rough, axes, here, slip, turns, spring, normal, pace):
    across, _, on_i, on_j = _resist_sliding(rough.friction, axes, here, slip, turns, spring, normal, pace)
    # their columns come after those of friction, then that of twisting
    stretch, p, column = spring
    column += len(sliding_columns(rough.friction, axes))
    rolling = resist_rolling(rough.rolling, axes, Spring(stretch, p, column), turns.roll, normal, pace)
    column += len(rolling_columns(rough.rolling, axes))
    twisting = resist_twisting(rough.twisting, axes, Spring(stretch, p, column), turns.twist, normal, pace)
    rx, ry, rz = torque_of_rolling(rolling, turns.arm, slip)
    tx, ty, tz = torque_of_twisting(twisting, turns.arm, slip)
    x, y, z = rx + tx, ry + ty, rz + tz
    on_i = on_i[0] + x, on_i[1] + y, on_i[2] + z
    on_j = on_j[0] - x, on_j[1] - y, on_j[2] - z
    return across, Turning(rolling, twisting), on_i, on_j


# the tangential force of a contact with a friction `here`, what resists rolling and twisting (None without), and the
# torques on both rows; springs go along as the pace says
resist = by_type(_resist_sliding, {RoughContacts: _resist_all})


@inlined
def _no_energy(resistance, across):
    return 0.0


@inlined
def _energy(resistance, across):
    return 0.5 * resistance.stiffness * (across.x * across.x + across.y * across.y + across.z * across.z)


# the energy of a spring from what `Across` says of it; 0 where there is none
_spring_energy = by_type(_energy, {type(None): _no_energy, ConstantRolling: _no_energy, ViscousRolling: _no_energy})


@inlined
def _energy_of_pull(friction, pull):
    return _spring_energy(friction, pull.across)


@inlined
def _energy_of_rough_pull(rough, pull):
    energy = _spring_energy(rough.friction, pull.across) + _spring_energy(rough.rolling, pull.turning.rolling)
    return energy + _spring_energy(rough.twisting, pull.turning.twisting)


# the energy of the springs of a contact, from what its pull says of them
energy_of_springs = by_type(_energy_of_pull, {RoughContacts: _energy_of_rough_pull})
