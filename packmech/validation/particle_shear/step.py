"""The reference package's discs and near pairs, and its time steps, in its order and with its faults, compiled."""

from __future__ import annotations

import dataclasses
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech import check
from packmech.jit.compiled import device, kernel
from packmech.validation.particle_shear.material import Material, repulsion, tension

# mypy: disable-error-code="no-untyped-def, no-untyped-call"


OPEN, STICK, SLIP, BOND = 0, 1, 2, 3


class KnownPairs(NamedTuple):
    """Near pairs i < j in order, their kinds, and what a contact needs at hand.

    That is, in a row of 9: the two histories, 1/(r_i + r_j), and the last separation from i to j: n_x, n_y, the number
    of the copy, the distance and its inverse, and 1 if the contact crosses the cell's boundary.
    """

    i_p: NDArray[np.int64]
    j_p: NDArray[np.int64]
    kind_p: NDArray[np.int64]
    state_p9: NDArray[np.float64]


@device
def image(dx, dy, width, height, strain):
    """Return the difference as the package images it, y first and then x, and how many heights and widths it took.

    In a strongly sheared cell this is not always the nearest image; it is for all distances below half the height.
    """
    up, along = 0, 0
    if abs(dy) >= height / 2.0:
        up = math.floor(dy / height + 0.5)
        dy -= up * height
        dx -= up * height * strain
    if abs(dx) >= width / 2.0:
        along = math.floor(dx / width + 0.5)
        dx -= along * width
    return dx, dy, up, along


@device
def _find_near(x_n, y_n, radius_n, i, width, height, strain, margin, near_n):
    """Flag the discs after the i-th that are near it; without branches, so that it is done for several at a time."""
    shift = height * strain - math.floor(height * strain / width) * width
    for j in range(i + 1, x_n.shape[0]):
        dx, dy = x_n[j] - x_n[i], y_n[j] - y_n[i]
        up = (1.0 if dy >= height / 2.0 else 0.0) - (1.0 if dy < -height / 2.0 else 0.0)
        dy -= up * height
        dx -= up * shift
        for _ in range(2):
            dx -= (width if dx >= width / 2.0 else 0.0) - (width if dx < -width / 2.0 else 0.0)
        reach = radius_n[i] + radius_n[j] + margin
        near_n[j] = dx * dx + dy * dy < reach * reach


@kernel
def list_pairs(position_nd, radius_n, width, height, strain, margin, old):
    """Return the pairs nearer than touching plus the margin.

    KnownPairs of the old list that are in contact or bonded stay, wherever they are, with their state.
    """
    count, listed = radius_n.shape[0], old.i_p.shape[0]
    x_n, y_n = position_nd[:, 0].copy(), position_nd[:, 1].copy()
    near_n = np.zeros(count, np.bool_)
    ij_p3 = np.empty((8 * count + listed, 3), np.int64)
    found, seen = 0, 0
    for i in range(count):
        _find_near(x_n, y_n, radius_n, i, width, height, strain, margin, near_n)
        first = seen
        while seen < listed and old.i_p[seen] == i:
            if old.kind_p[seen] != OPEN:
                near_n[old.j_p[seen]] = True
            seen += 1
        if found + count > ij_p3.shape[0]:
            ij_p3 = np.concatenate((ij_p3, np.empty_like(ij_p3)))
        for j in range(i + 1, count):
            if near_n[j]:
                while first < seen and old.j_p[first] < j:
                    first += 1
                kept = first < seen and old.j_p[first] == j and old.kind_p[first] != OPEN
                ij_p3[found, 0], ij_p3[found, 1], ij_p3[found, 2] = i, j, first if kept else -1
                found += 1
    i_p, j_p, from_p = ij_p3[:found, 0].copy(), ij_p3[:found, 1].copy(), ij_p3[:found, 2].copy()
    kind_p, state_p9 = np.zeros(found, np.int64), np.zeros((found, 9))
    for p in range(found):
        state_p9[p, 2] = 1.0 / (radius_n[i_p[p]] + radius_n[j_p[p]])
        if from_p[p] >= 0:
            kind_p[p] = old.kind_p[from_p[p]]
            state_p9[p, 0] = old.state_p9[from_p[p], 0]
            state_p9[p, 1] = old.state_p9[from_p[p], 1]
    return KnownPairs(i_p, j_p, kind_p, state_p9)


# the package's words for the kinds of contacts, and ours for `permanent`
KINDS = {"stick": STICK, "slip": SLIP, "bond": BOND}
FIRST_ANGLE = -math.pi / 2.0


@dataclasses.dataclass(frozen=True)
class Preparation:
    """How discs were bonded, in the package's terms: what `prepared_discs` and `bond_fragments` did.

    Parameters
    ----------
    bonded
        Whether there are permanent bonds (do_permanent_links).
    pieces
        Number of centers or lines that cut them into fragments; 0 is one bulk (cut_lines).
    by_centers
        Whether fragments belong to centers instead of being cut by lines (doCutByTriangulation).
    avoided_angle
        How near to the horizontal no line is drawn [degree] (avoid_horizontal_angle_degree).
    no_spanning
        Whether fragments as high as the cell were avoided (avoid_height_spanning_particles).
    cut_top_bottom
        Whether bonds across the plates were cut.
    removed_fraction, removed
        Share of bonds that should be removed without dividing a fragment, and that were [1] (remove_link_fraction).
    edge_fuzziness
        [1].

    """

    bonded: bool = True
    pieces: int = 0
    by_centers: bool = True
    avoided_angle: float = 15.0
    no_spanning: bool = False
    cut_top_bottom: bool = False
    removed_fraction: float = 0.0
    removed: float = 0.0
    edge_fuzziness: float = 0.0

    def __post_init__(self) -> None:
        for name in ("bonded", "by_centers", "no_spanning", "cut_top_bottom"):
            object.__setattr__(self, name, check.boolean(name, getattr(self, name)))
        check.integer("pieces", self.pieces, at_least=0)
        check.real("avoided_angle", self.avoided_angle, at_least=0.0, at_most=90.0)
        check.real("edge_fuzziness", self.edge_fuzziness, at_least=0.0)
        for name in ("removed_fraction", "removed"):
            check.real(name, getattr(self, name), at_least=0.0, at_most=1.0)
        if not self.bonded and self.pieces:
            raise ValueError(f"pieces must be 0 where nothing is bonded, got {self.pieces}")

    @property
    def kind(self) -> str:
        """What the file's name says: nothing for fragments, "_bulk" or "_uncrosslinked"."""
        if not self.bonded:
            return "_uncrosslinked"
        return "" if self.pieces else "_bulk"


@dataclasses.dataclass(frozen=True, eq=False)
class ShearedDiscs:
    """Discs in a rectangular cell, with everything that the next step depends on.

    Lengths are in um, times in s, masses in mg per metre of depth; forces are then in 1e-12 N/m and torques in 1e-18 N.

    Parameters
    ----------
    position_nd, velocity_nd
        (N, 2) centers [um], inside the cell, and velocities [um/s]. No velocities are zeros.
    radius_n, mass_n
        (N,) radii [um] and masses [mg/m].
    spin_n, angle_n
        (N,) angular velocities [1/s] and angles [rad], counterclockwise. Left out they are zeros and -pi/2.
    contact_ck
        (C, 2) the pairs in contact or bonded, each once with the lower number first; in any order.
    kind_c
        (C,) "stick", "slip" or "bond" for each.
    history_ck
        (C, 2) tangential histories [um] as the lower- and the higher-numbered disc has them. Left out, zeros.
    width, height
        Sides of the cell [um].
    strain, strain_rate, time
        Shear strain of the cell [1], its rate [1/s], and the time [s].
    carried_nd
        (N, 2) forces left over from earlier steps, on discs held by the plates alone [1e-12 N/m].
    preparation
        How they were bonded, where that is known; text files say so.

    Examples
    --------
    >>> pair = ShearedDiscs([[200.0, 250.0], [310.0, 250.0]], [60.0, 60.0], [1.0, 1.0])
    >>> pair.discs, pair.inertia_n
    (2, array([1800., 1800.]))

    """

    position_nd: NDArray[np.float64]
    radius_n: NDArray[np.float64]
    mass_n: NDArray[np.float64]
    velocity_nd: NDArray[np.float64] = None  # type: ignore[assignment]
    spin_n: NDArray[np.float64] = None  # type: ignore[assignment]
    angle_n: NDArray[np.float64] = None  # type: ignore[assignment]
    contact_ck: NDArray[np.int64] = None  # type: ignore[assignment]
    kind_c: NDArray[np.str_] = None  # type: ignore[assignment]
    history_ck: NDArray[np.float64] = None  # type: ignore[assignment]
    width: float = 500.0
    height: float = 500.0
    strain: float = 0.0
    strain_rate: float = 0.0
    time: float = 0.0
    carried_nd: NDArray[np.float64] = None  # type: ignore[assignment]
    preparation: Preparation | None = None

    def __post_init__(self) -> None:
        if self.preparation is not None:
            check.instance("preparation", self.preparation, Preparation)
        position_nd = check.finite_array("position_nd", self.position_nd, shape=(None, 2))
        count = len(position_nd)
        made: dict[str, NDArray[Any]] = {
            "position_nd": position_nd,
            "radius_n": check.positive_array("radius_n", self.radius_n, shape=(count,)),
            "mass_n": check.positive_array("mass_n", self.mass_n, shape=(count,)),
        }
        for name, shape, fill in (
            ("velocity_nd", (count, 2), 0.0),
            ("carried_nd", (count, 2), 0.0),
            ("spin_n", (count,), 0.0),
            ("angle_n", (count,), FIRST_ANGLE),
        ):
            given = getattr(self, name)
            made[name] = np.full(shape, fill) if given is None else check.finite_array(name, given, shape=shape)
        for name in ("width", "height"):
            object.__setattr__(self, name, check.positive(name, getattr(self, name)))
        for name in ("strain", "strain_rate", "time"):
            object.__setattr__(self, name, check.real(name, getattr(self, name)))
        outside = ((position_nd < 0.0) | (position_nd > (self.width, self.height))).any(axis=1)
        if outside.any():
            where = int(np.argmax(outside))
            raise ValueError(
                f"position_nd must be inside the cell of {self.width:g} by {self.height:g}, "
                f"got {position_nd[where].tolist()} for particle {where}"
            )
        made |= _contacts(self.contact_ck, self.kind_c, self.history_ck, count)
        for name, array in made.items():
            array.flags.writeable = False
            object.__setattr__(self, name, array)

    @property
    def discs(self) -> int:
        """Number of discs."""
        return len(self.radius_n)

    @property
    def inertia_n(self) -> NDArray[np.float64]:
        """(N,) moments of inertia m r^2/2 of discs [mg um^2/m]."""
        return self.mass_n * self.radius_n**2 / 2.0

    @property
    def bonded_c(self) -> NDArray[np.bool_]:
        """(C,) whether each contact is a permanent bond. Its rest length is always the sum of the radii."""
        return np.asarray(self.kind_c == "bond")

    def replace(self, **changes: object) -> ShearedDiscs:
        """Return the same state with some fields exchanged; new contacts or kinds of them forget the preparation."""
        if {"contact_ck", "kind_c"} & set(changes):
            changes = {"preparation": None} | changes
        return dataclasses.replace(self, **changes)  # type: ignore[arg-type]


def _contacts(
    contact_ck: ArrayLike | None, kind_c: ArrayLike | None, history_ck: ArrayLike | None, count: int
) -> dict[str, NDArray[Any]]:
    """Return the contacts sorted by pair, after checking them."""
    pairs = np.asarray([] if contact_ck is None else contact_ck)
    if pairs.size == 0:
        pairs = np.zeros((0, 2), dtype=np.int64)
    if pairs.ndim != 2 or pairs.shape[1] != 2 or pairs.dtype.kind not in "iu":
        raise ValueError(f"contact_ck must be an integer array of shape (any, 2), got shape {pairs.shape}")
    for c, (i, j) in enumerate(pairs.tolist()):
        if not 0 <= i < j < count:
            raise ValueError(
                f"contact_ck must hold pairs of discs, the lower number first, below {count}, "
                f"got {(i, j)} for contact {c}"
            )
    kinds = np.array([] if kind_c is None else kind_c, dtype="U5")
    if kinds.shape != (len(pairs),):
        raise ValueError(f"kind_c must have shape ({len(pairs)},), got {kinds.shape}")
    for c, kind in enumerate(kinds.tolist()):
        check.one_of(f"kind_c[{c}]", kind, KINDS)
    histories = (
        np.zeros((len(pairs), 2))
        if history_ck is None
        else check.finite_array("history_ck", history_ck, shape=(len(pairs), 2), what="contact", empty=True)
    )
    order = np.lexsort((pairs[:, 1], pairs[:, 0]))
    pairs = np.array(pairs[order], dtype=np.int64)
    twice = (np.diff(pairs, axis=0) == 0).all(axis=1)
    if twice.any():
        raise ValueError(f"contact_ck must hold every pair once, got {tuple(pairs[int(np.argmax(twice))])} twice")
    return {"contact_ck": pairs, "kind_c": kinds[order], "history_ck": histories[order]}


# mypy: disable-error-code="no-untyped-def, no-untyped-call"


# rows of the stress array, by the names of `STRESSES`
(LOVE_WEBER, EXTERNAL, ACCELERATION, UNBALANCED, TORQUE, INTERNAL_TORQUE, CENTRIFUGAL, OTSUKI, OVERALL) = range(9)


class MovingArrays(NamedTuple):
    """Arrays that a step changes in place."""

    position_nd: NDArray[np.float64]
    velocity_nd: NDArray[np.float64]
    spin_n: NDArray[np.float64]
    angle_n: NDArray[np.float64]
    carried_nd: NDArray[np.float64]


class FixedArrays(NamedTuple):
    """Arrays that stay; the last two are what a force and a torque add to speed and spin in one step."""

    radius_n: NDArray[np.float64]
    mass_n: NDArray[np.float64]
    push_n: NDArray[np.float64]
    turn_n: NDArray[np.float64]


class Cell(NamedTuple):
    """Size of the cell [um], whether plates catch discs, and the step's constants."""

    width: float
    height: float
    plates: bool
    time_step: float
    cooling: float
    clears_all: bool
    all_spin: bool
    otsuki_flow: bool


class Register(NamedTuple):
    """What a force evaluation reads and leaves, packed by disc so that a contact touches few cache lines.

    Rows are (x, y, v_x, v_y, r w, r, 1 if mobile, 0); parts are (F_x, F_y, T, 0) from contacts inside the cell between
    mobile discs, and from all others.
    """

    row_n8: NDArray[np.float64]
    part_n24: NDArray[np.float64]
    force_nd: NDArray[np.float64]
    torque_n: NDArray[np.float64]
    virial_dd: NDArray[np.float64]


@device
def change_rate(motion, cell, change):
    """Shift all velocities by an affine flow and its spin."""
    for i in range(motion.spin_n.shape[0]):
        motion.velocity_nd[i, 0] += (motion.position_nd[i, 1] - cell.height / 2.0) * change
        motion.spin_n[i] -= change / 2.0


@device
def pack(motion, body, cell, register):
    """Fill the rows and mark mobile discs: with plates, those farther than their radius from both."""
    row_n8, x, v = register.row_n8, motion.position_nd, motion.velocity_nd
    for i in range(body.radius_n.shape[0]):
        y, r = x[i, 1], body.radius_n[i]
        row_n8[i, 0], row_n8[i, 1], row_n8[i, 2], row_n8[i, 3] = x[i, 0], y, v[i, 0], v[i, 1]
        row_n8[i, 4], row_n8[i, 5] = r * motion.spin_n[i], r
        row_n8[i, 6] = 1.0 if (not cell.plates) or (y > r and y < cell.height - r) else 0.0
    register.part_n24[:] = 0.0


@device
def add_parts(motion, register):
    """Set the totals, on top of forces that earlier steps left on caught discs."""
    for i in range(register.torque_n.shape[0]):
        for a in range(2):
            total = register.part_n24[i, 0, a] + register.part_n24[i, 1, a]
            register.force_nd[i, a] = motion.carried_nd[i, a] + total
        register.torque_n[i] = register.part_n24[i, 0, 2] + register.part_n24[i, 1, 2]


@device
def two_visits(drag, spring, cap, first, second):
    """Return the tangential force of a contact that may slip, whether its second visit slipped, and whether any did.

    The lower-numbered disc visits with its history, then the higher-numbered with its own; each gives half of its
    force. A visit that slips wipes both histories: the one after it sees the dashpot alone, and mostly sticks again.
    """
    one = drag + spring * first
    slips = abs(one) > cap
    two = drag + spring * (0.0 if slips else second)
    slips_again = abs(two) > cap
    force = (min(max(one, -cap), cap) + min(max(two, -cap), cap)) / 2.0
    return force, slips_again, slips or slips_again


@device
def find_separations(cell, strain, pairs, register):
    """Fill in direction, image and distance of each pair; apart from the forces, as roots and quotients wait."""
    row_n8, state_p9 = register.row_n8, pairs.state_p9
    for p in range(pairs.i_p.shape[0]):
        # unsigned numbers need no test for counting from the end
        i, j = np.uint64(pairs.i_p[p]), np.uint64(pairs.j_p[p])
        dx, dy, up, along = image(
            row_n8[j, 0] - row_n8[i, 0], row_n8[j, 1] - row_n8[i, 1], cell.width, cell.height, strain
        )
        d = math.sqrt(dx * dx + dy * dy)
        inverse = 1.0 / d if d > 0.0 else np.inf
        # the package draws a fresh direction for coincident centers at every call; here it is the x axis
        state_p9[p, 3] = dx * inverse if d > 0.0 else 1.0
        state_p9[p, 4] = dy * inverse if d > 0.0 else 0.0
        state_p9[p, 5] = up
        state_p9[p, 6] = d
        state_p9[p, 7] = inverse
        state_p9[p, 8] = 0.0 if up == 0 and along == 0 else 1.0


@device
def evaluate(motion, body, cell, material, strain, rate, pairs, register):
    """Fill the register and return how many contacts there are; kinds and histories change as they slip and part."""
    contacts = 0
    pack(motion, body, cell, register)
    find_separations(cell, strain, pairs, register)
    kind_p, state_p9, row_n8, part_n24 = pairs.kind_p, pairs.state_p9, register.row_n8, register.part_n24
    shear = cell.height * rate
    bond_damping, bond_drag = material.viscosity, material.tangential_viscosity
    if material.bond_viscosity_follows != 0.0:
        bond_damping *= material.bond_normal_ratio
        bond_drag *= material.bond_tangential_ratio
    virial_xx, virial_xy, virial_yx, virial_yy = 0.0, 0.0, 0.0, 0.0
    for p in range(pairs.i_p.shape[0]):
        i, j, kind = np.uint64(pairs.i_p[p]), np.uint64(pairs.j_p[p]), kind_p[p]
        ri, rj, d = row_n8[i, 5], row_n8[j, 5], state_p9[p, 6]
        rest = ri + rj
        if kind != BOND and d >= rest:
            if kind != OPEN:
                kind_p[p] = OPEN
                state_p9[p, 0] = 0.0
                state_p9[p, 1] = 0.0
            continue
        nx, ny = state_p9[p, 3], state_p9[p, 4]
        vx, vy = row_n8[j, 2] - row_n8[i, 2] - state_p9[p, 5] * shear, row_n8[j, 3] - row_n8[i, 3]
        approach = vx * nx + vy * ny
        slip = vy * nx - vx * ny - (row_n8[i, 4] + row_n8[j, 4])
        inner = row_n8[i, 6] * row_n8[j, 6] * (1.0 - state_p9[p, 8])
        first, second = state_p9[p, 0], state_p9[p, 1]
        inverse_rest = state_p9[p, 2]
        elastic = repulsion(material, d, rest, rest * state_p9[p, 7])
        if kind == BOND:
            # a stretched bond keeps its tangential spring and loses its dashpot
            drag = bond_drag * slip if d < rest else 0.0
            spring = material.bond_tangential_ratio * material.tangential_stiffness
            tangential = drag + spring * (first + second) / 2.0
            pull = elastic if d < rest else tension(material, d - rest, rest)
            normal = material.bond_normal_ratio * pull + bond_damping * approach
        else:
            normal = elastic + material.viscosity * approach
            tangential, slips, wiped = two_visits(
                material.tangential_viscosity * slip, material.tangential_stiffness,
                material.friction_coefficient * abs(elastic), first, second,
            )  # fmt: skip
            kind_p[p] = SLIP if slips else STICK
            first, second = (0.0, 0.0) if wiped else (first, second)
        state_p9[p, 0], state_p9[p, 1] = first, second
        fx, fy = normal * nx - tangential * ny, normal * ny + tangential * nx
        # S1-3: the arms are the radii times d/(r_i + r_j), while the slip speed has the radii themselves
        turn = d * inverse_rest * tangential
        contacts += 1
        part = np.uint64(0 if inner == 1.0 else 1)
        part_n24[i, part, 0] += fx
        part_n24[i, part, 1] += fy
        part_n24[i, part, 2] += turn * ri
        part_n24[j, part, 0] -= fx
        part_n24[j, part, 1] -= fy
        part_n24[j, part, 2] += turn * rj
        inner_x, inner_y = inner * d * nx, inner * d * ny
        virial_xx -= fx * inner_x
        virial_xy -= fx * inner_y
        virial_yx -= fy * inner_x
        virial_yy -= fy * inner_y
    add_parts(motion, register)
    register.virial_dd[0, 0], register.virial_dd[0, 1] = virial_xx, virial_xy
    register.virial_dd[1, 0], register.virial_dd[1, 1] = virial_yx, virial_yy
    return contacts


@device
def measure(motion, body, cell, rate, register, stress_sdd):
    """Fill the nine tensors [Pa], compression positive; rows are the force's components, columns the position's."""
    x, v = motion.position_nd, motion.velocity_nd
    stress_sdd[:] = 0.0
    flow = rate if cell.otsuki_flow else 0.0
    torque, inner_torque, energy = 0.0, 0.0, 0.0
    pxx, pxy, pyy = 0.0, 0.0, 0.0
    exx, exy, eyx, eyy, axx, axy, ayx, ayy = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(x.shape[0]):
        dx, dy = x[i, 0] - cell.width / 2.0, x[i, 1] - cell.height / 2.0
        torque += register.torque_n[i]
        inner_torque += register.part_n24[i, 0, 2]
        if register.row_n8[i, 6] == 1.0:
            fx, fy = register.part_n24[i, 1, 0], register.part_n24[i, 1, 1]
            exx, exy, eyx, eyy = exx + fx * dx, exy + fx * dy, eyx + fy * dx, eyy + fy * dy
            fx, fy = register.force_nd[i, 0], register.force_nd[i, 1]
            axx, axy, ayx, ayy = axx + fx * dx, axy + fx * dy, ayx + fy * dx, ayy + fy * dy
        if cell.all_spin or register.row_n8[i, 6] == 1.0:
            energy += body.mass_n[i] * body.radius_n[i] ** 2 * motion.spin_n[i] ** 2 / 4.0
            px, py = v[i, 0] - flow * dy, v[i, 1]
            pxx += body.mass_n[i] * px * px
            pxy += body.mass_n[i] * px * py
            pyy += body.mass_n[i] * py * py
    stress_sdd[TORQUE, 1, 0] = torque / 2.0
    stress_sdd[INTERNAL_TORQUE, 1, 0] = inner_torque / 2.0
    stress_sdd[CENTRIFUGAL, 0, 0] = -energy
    # the sign of the paper it follows, where tension is positive, in tensors where compression is
    stress_sdd[OTSUKI, 0, 0], stress_sdd[OTSUKI, 1, 1] = -pxx, -pyy
    stress_sdd[OTSUKI, 0, 1], stress_sdd[OTSUKI, 1, 0] = -pxy, -pxy
    for s in (TORQUE, INTERNAL_TORQUE):
        stress_sdd[s, 0, 1] = -stress_sdd[s, 1, 0]
    stress_sdd[CENTRIFUGAL, 1, 1] = stress_sdd[CENTRIFUGAL, 0, 0]
    stress_sdd[EXTERNAL, 0, 0], stress_sdd[EXTERNAL, 0, 1] = -exx, -exy
    stress_sdd[EXTERNAL, 1, 0], stress_sdd[EXTERNAL, 1, 1] = -eyx, -eyy
    stress_sdd[ACCELERATION, 0, 0], stress_sdd[ACCELERATION, 0, 1] = axx, axy
    stress_sdd[ACCELERATION, 1, 0], stress_sdd[ACCELERATION, 1, 1] = ayx, ayy
    # sums of force times length in 1e-18 J per metre of depth, over an area in um^2
    unit = 1e-6 / (cell.width * cell.height)
    for a in range(2):
        for b in range(2):
            stress_sdd[LOVE_WEBER, a, b] = register.virial_dd[a, b]
            stress_sdd[UNBALANCED, a, b] = stress_sdd[ACCELERATION, a, b]
            spinning = stress_sdd[INTERNAL_TORQUE, a, b] + stress_sdd[CENTRIFUGAL, a, b]
            stress_sdd[OVERALL, a, b] = stress_sdd[LOVE_WEBER, a, b] + spinning
            for s in range(9):
                stress_sdd[s, a, b] *= unit


@device
def kick(motion, body, cell, rate, register):
    """Accelerate by the register's forces, drag the caught discs with their plate, and cool towards the flow."""
    v = motion.velocity_nd
    for i in range(v.shape[0]):
        y = motion.position_nd[i, 1]
        if register.row_n8[i, 6] == 1.0:
            for a in range(2):
                v[i, a] += register.force_nd[i, a] * body.push_n[i]
        else:
            v[i, 0] = rate * cell.height / 2.0 if y > cell.height / 2.0 else -rate * cell.height / 2.0
            v[i, 1] = 0.0
        motion.spin_n[i] += register.torque_n[i] * body.turn_n[i]
        flow = (y - cell.height / 2.0) * rate
        v[i, 0] = flow + (v[i, 0] - flow) * cell.cooling
        v[i, 1] *= cell.cooling
        motion.spin_n[i] *= cell.cooling
        cleared = cell.clears_all or register.row_n8[i, 6] == 1.0
        for a in range(2):
            motion.carried_nd[i, a] = 0.0 if cleared else register.force_nd[i, a]


@device
def drift(motion, body, cell, strain, rate, pairs, register, new_nd):
    """Turn, wind the histories and move, disc by disc: a disc sees the lower-numbered ones where they already are."""
    x, v, spin, dt, row_n8 = motion.position_nd, motion.velocity_nd, motion.spin_n, cell.time_step, register.row_n8
    shear = cell.height * rate
    for i in range(x.shape[0]):
        motion.angle_n[i] += spin[i] * dt
        new_nd[i, 0] = x[i, 0] + v[i, 0] * dt
        new_nd[i, 1] = x[i, 1] + v[i, 1] * dt
        row_n8[i, 2], row_n8[i, 3], row_n8[i, 4] = v[i, 0], v[i, 1], body.radius_n[i] * spin[i]
    for p in range(pairs.i_p.shape[0]):
        if pairs.kind_p[p] != OPEN:
            one, other = np.uint64(pairs.i_p[p]), np.uint64(pairs.j_p[p])
            winding = 0.0 if pairs.kind_p[p] == SLIP else dt
            state_p9 = pairs.state_p9
            vx, vy = row_n8[other, 2] - row_n8[one, 2], row_n8[other, 3] - row_n8[one, 3]
            rolled = row_n8[one, 4] + row_n8[other, 4]
            along = vx - state_p9[p, 5] * shear
            state_p9[p, 0] += (vy * state_p9[p, 3] - along * state_p9[p, 4] - rolled) * winding
            new_x, new_y = row_n8[one, 0] + row_n8[one, 2] * dt, row_n8[one, 1] + row_n8[one, 3] * dt
            dx, dy, up, _ = image(new_x - row_n8[other, 0], new_y - row_n8[other, 1], cell.width, cell.height, strain)
            d = math.sqrt(dx * dx + dy * dy)
            inverse = 1.0 / d if d > 0.0 else 0.0
            nx, ny = dx * inverse, dy * inverse
            if d == 0.0:
                nx = 1.0
            along = -vx - up * shear
            state_p9[p, 1] += (-vy * nx - along * ny - rolled) * winding


@device
def wrap(motion, cell, strain, rate, new_nd):
    """Put the discs at their new places, wrapped into the cell as it is strained now; return the longest own way.

    A disc's own way is its way less that of the sheared flow where it was.
    """
    farthest = 0.0
    x, v = motion.position_nd, motion.velocity_nd
    for i in range(x.shape[0]):
        own = v[i, 0] - (x[i, 1] - cell.height / 2.0) * rate
        farthest = max(farthest, own * own + v[i, 1] * v[i, 1])
        x[i, 0], x[i, 1] = new_nd[i, 0], new_nd[i, 1]
        if x[i, 1] < 0.0 or x[i, 1] >= cell.height:
            up = math.floor(x[i, 1] / cell.height)
            x[i, 1] -= up * cell.height
            x[i, 0] -= up * cell.height * strain
            v[i, 0] -= up * cell.height * rate
        if x[i, 0] < 0.0 or x[i, 0] >= cell.width:
            x[i, 0] -= math.floor(x[i, 0] / cell.width) * cell.width
    return math.sqrt(farthest) * cell.time_step


@kernel
def run_steps(motion, body, cell, material, clock, rate_t, margin, pairs, register, stress_tsdd, count_tk, strain_t):
    """Advance by one step for every rate given; return the pairs, their last histories, and the strain, rate and time.

    The histories are those of the last force evaluation, before the discs moved on. Saves the nine tensors, the numbers
    of caught discs and of contacts and bonds, and the strain of every step's force evaluation.
    """
    strain, rate, time = clock
    new_nd = np.empty_like(motion.position_nd)
    seen_p9 = pairs.state_p9
    reach = 2.0 * np.max(body.radius_n) + margin
    # no list yet: the first step makes it
    gone = np.inf
    for t in range(rate_t.shape[0]):
        if gone >= margin:
            pairs = list_pairs(motion.position_nd, body.radius_n, cell.width, cell.height, strain, margin, pairs)
            gone = 0.0
        change_rate(motion, cell, rate_t[t] - rate)
        rate = rate_t[t]
        count_tk[t, 1] = evaluate(motion, body, cell, material, strain, rate, pairs, register)
        measure(motion, body, cell, rate, register, stress_tsdd[t])
        strain_t[t] = strain
        caught = 0
        for i in range(body.radius_n.shape[0]):
            caught += register.row_n8[i, 6] == 0.0
        count_tk[t, 0] = caught
        if t == rate_t.shape[0] - 1:
            seen_p9 = pairs.state_p9.copy()
        kick(motion, body, cell, rate, register)
        drift(motion, body, cell, strain, rate, pairs, register, new_nd)
        strain += rate * cell.time_step
        # two discs approach by their own ways and by what the flow shrinks the longest distance that could matter
        gone += 2.0 * wrap(motion, cell, strain, rate, new_nd) + reach * abs(rate) * cell.time_step
        time += cell.time_step
    return pairs, seen_p9, strain, rate, time


# the nine tensors of the package, in the order of its text file but for the last, which the rest add up to
STRESSES = (
    "love_weber",
    "external",
    "linear_acceleration",
    "unbalanced",
    "torque",
    "internal_torque",
    "centrifugal",
    "otsuki",
    "overall",
)

# of the mean radius; wider lists are scanned less often and hold more pairs that do not touch
MARGIN = 0.35


@dataclasses.dataclass(frozen=True)
class StepRules:
    """What a step does besides the contacts: its length, cooling, plates, and whose terms enter the stresses.

    Parameters
    ----------
    time_step
        [s].
    cooling
        Factor of the velocities relative to the local flow, and of the spins, at every step [1].
    plates
        Whether discs nearer to y = 0 or y = height than their radius are caught by plates that shear the cell, for
        ever; without, the cell is periodic in both directions.
    clears_forces
        Whether the forces on caught discs are cleared after the step, as in the package's oscillatory runs; in its
        library-level step, which its unit tests take, they add up.
    all_spin
        Whether the centrifugal and the Otsuki terms count caught discs, as in the package's unit tests.
    otsuki_flow
        Whether the Otsuki term takes velocities relative to the sheared flow; the package's unit tests do not.

    """

    time_step: float
    cooling: float = 1.0
    plates: bool = True
    clears_forces: bool = True
    all_spin: bool = False
    otsuki_flow: bool = True

    def __post_init__(self) -> None:
        object.__setattr__(self, "time_step", check.positive("time_step", self.time_step))
        object.__setattr__(self, "cooling", check.real("cooling", self.cooling, above=0.0, at_most=1.0))
        for name in ("plates", "clears_forces", "all_spin", "otsuki_flow"):
            object.__setattr__(self, name, check.boolean(name, getattr(self, name)))


@dataclasses.dataclass(frozen=True, eq=False)
class StepForces:
    """What one step saw when it evaluated its forces.

    Attributes
    ----------
    mobile_n
        (N,) discs that no plate held.
    force_nd, torque_n
        Total forces [1e-12 N/m] and torques [1e-18 N].
    inner_force_nd, outer_force_nd, inner_torque_n, outer_torque_n
        The parts from contacts inside the cell between mobile discs, and from all others, on mobile discs.
    stress_sdd
        (9, 2, 2) the tensors by the order of `STRESSES` [Pa], compression positive.
    history_ck
        (C, 2) histories of the contacts, as the forces left them; those of the state after the step have been wound.

    """

    mobile_n: NDArray[np.bool_]
    force_nd: NDArray[np.float64]
    torque_n: NDArray[np.float64]
    inner_force_nd: NDArray[np.float64]
    outer_force_nd: NDArray[np.float64]
    inner_torque_n: NDArray[np.float64]
    outer_torque_n: NDArray[np.float64]
    stress_sdd: NDArray[np.float64]
    history_ck: NDArray[np.float64]

    def stress(self, name: str) -> NDArray[np.float64]:
        """Return the (2, 2) tensor of that name [Pa]."""
        return np.asarray(self.stress_sdd[STRESSES.index(check.one_of("name", name, STRESSES))])


@dataclasses.dataclass(frozen=True, eq=False)
class Steps:
    """Series over the steps of a run, each taken when its forces were evaluated, and the state after the last one.

    Attributes
    ----------
    final
        The state after the last step.
    time_t, strain_t, strain_rate_t
        [s], [1], [1/s].
    stress_tsdd
        (T, 9, 2, 2) tensors by the order of `STRESSES` [Pa].
    caught_t, contacts_t
        Numbers of discs held by plates, and of contacts and bonds.
    last
        The last step's evaluation.

    """

    final: ShearedDiscs
    time_t: NDArray[np.float64]
    strain_t: NDArray[np.float64]
    strain_rate_t: NDArray[np.float64]
    stress_tsdd: NDArray[np.float64]
    caught_t: NDArray[np.int64]
    contacts_t: NDArray[np.int64]
    last: StepForces

    def stress(self, name: str) -> NDArray[np.float64]:
        """Return the (T, 2, 2) tensor of that name [Pa]."""
        return np.asarray(self.stress_tsdd[:, STRESSES.index(check.one_of("name", name, STRESSES))])


def _start_pairs(discs: ShearedDiscs) -> KnownPairs:
    kinds = np.array([KINDS[str(kind)] for kind in discs.kind_c], dtype=np.int64)
    i_p, j_p = (np.array(discs.contact_ck[:, k]) for k in (0, 1))
    state_p9 = np.zeros((len(kinds), 9))
    state_p9[:, :2] = discs.history_ck
    return KnownPairs(i_p, j_p, kinds, state_p9)


def advance(discs: ShearedDiscs, material: Material, rules: StepRules, strain_rate_t: ArrayLike) -> Steps:
    """Return the run of as many steps as there are strain rates.

    Parameters
    ----------
    discs
        The state to start from; it stays as it is.
    material
        Constants of the contacts.
    rules
        Length of the step, cooling, plates.
    strain_rate_t
        (T,) shear rate that each step sets at its start [1/s].

    Examples
    --------
    >>> pair = ShearedDiscs([[200.0, 250.0], [310.0, 250.0]], [60.0, 60.0], [1.0, 1.0])
    >>> steps = advance(pair, Material(stiffness=1.0), StepRules(0.1, plates=False), [0.0])
    >>> print(steps.last.force_nd[0], steps.stress("love_weber")[0, 0, 0] * 500.0**2 / 1e-6)
    [-10.   0.] 1100.0

    """
    check.instance("discs", discs, ShearedDiscs)
    check.instance("material", material, Material)
    check.instance("rules", rules, StepRules, "an instance of")
    rate_t = check.finite_array("strain_rate_t", strain_rate_t, shape=(None,), what="step")
    count, steps = discs.discs, len(rate_t)
    motion = MovingArrays(*(np.array(getattr(discs, name)) for name in MovingArrays._fields))
    push_n, turn_n = rules.time_step / discs.mass_n, rules.time_step / discs.inertia_n
    body = FixedArrays(discs.radius_n.copy(), discs.mass_n.copy(), push_n, turn_n)
    cell = Cell(
        discs.width, discs.height, bool(rules.plates), rules.time_step, rules.cooling,
        bool(rules.clears_forces), bool(rules.all_spin), bool(rules.otsuki_flow),
    )  # fmt: skip
    register = Register(
        np.zeros((count, 8)), np.zeros((count, 2, 4)), np.zeros((count, 2)), np.zeros(count), np.zeros((2, 2))
    )
    stress_tsdd, count_tk, strain_t = np.empty((steps, 9, 2, 2)), np.empty((steps, 2), np.int64), np.empty(steps)
    pairs, seen_p9, strain, rate, time = run_steps(
        motion, body, cell, material.checked(), (discs.strain, discs.strain_rate, discs.time), rate_t,
        MARGIN * float(np.mean(discs.radius_n)), _start_pairs(discs), register, stress_tsdd, count_tk, strain_t,
    )  # fmt: skip
    held = np.flatnonzero(pairs.kind_p != OPEN)
    names = {number: name for name, number in KINDS.items()}
    if not np.isfinite(motion.position_nd).all():
        raise FloatingPointError(
            f"the run blew up: a disc's position is no number after {steps} steps; take a smaller time_step"
        )
    final = ShearedDiscs(
        *(motion.position_nd, body.radius_n, body.mass_n, motion.velocity_nd, motion.spin_n, motion.angle_n),
        contact_ck=np.stack([pairs.i_p[held], pairs.j_p[held]], axis=1),
        kind_c=np.array([names[int(kind)] for kind in pairs.kind_p[held]], dtype="U5"),
        history_ck=pairs.state_p9[held, :2],
        width=discs.width,
        height=discs.height,
        strain=strain,
        strain_rate=rate,
        time=time,
        carried_nd=motion.carried_nd,
        preparation=discs.preparation,
    )
    mobile_n = register.row_n8[:, 6] == 1.0
    inner_n4, outer_n4 = register.part_n24[:, 0], np.where(mobile_n[:, None], register.part_n24[:, 1], 0.0)
    last = StepForces(
        *(mobile_n, register.force_nd, register.torque_n, inner_n4[:, :2], outer_n4[:, :2], inner_n4[:, 2]),
        outer_torque_n=outer_n4[:, 2],
        stress_sdd=stress_tsdd[-1],
        history_ck=seen_p9[held, :2],
    )
    # the clock of the package adds up its steps one by one
    time_t = np.add.accumulate(np.concatenate([[discs.time], np.full(steps - 1, rules.time_step)]))
    return Steps(final, time_t, strain_t, rate_t, stress_tsdd, count_tk[:, 0], count_tk[:, 1], last)
