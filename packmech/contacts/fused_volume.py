# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Volume that fused particles share, and its moments: they fill their union, not the sum of their volumes."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray

from packmech.contacts.cells import sort_row
from packmech.contacts.excluded import rigid_clusters
from packmech.jit.compiled import device, kernel
from packmech.packing import Packing
from packmech.shapes import Beads, Superellipsoids

# relative overlaps below this are rounding: the lens is too small for any digit of the sum
_TOUCHING = 1e-12
# breakpoints of a quadrature closer than this, relative to the radius, are one
_SAME = 1e-13
# a point that lies deeper inside a sphere than this, relative to its radius squared, is hidden
_HIDDEN = 1e-6
# nodes of the quadrature between two breakpoints
_NODES = 24


def shared_volume(packing: Packing) -> float:
    """Return what fused particles share, counted as often as it is counted too much in the sum [length^d].

    Two particles are fused where they overlap and are no contact whatever moves: linked ones at the link's image, and
    all of a rigid cluster. The sum of all volumes less what this returns is the volume of every rigid cluster's union;
    in flexible clusters it is inclusion and exclusion over the groups of particles that are all fused with each other.
    It depends on radii, links and the shapes of clusters only, not on where they are.

    Exact in two dimensions: areas inside the arcs that bound the discs (Green's theorem); in three dimensions where no
    three particles are all fused with each other: lenses. Elsewhere a quadrature over slices, each an exact area, whose
    error is below 1e-10 of a particle's volume.

    Parameters
    ----------
    packing
        The packing.

    """
    links = packing.links
    if not len(links):
        return 0.0
    position_nd, radius_n, lattice_dd = packing.position_nd, packing.radius_n, packing.box.lattice_dd
    rigid = rigid_clusters(packing)
    reach_l = (1.0 - _TOUCHING) * (radius_n[links.i_l] + radius_n[links.j_l])
    linked = np.flatnonzero((links.length_l < reach_l) & ~rigid[links.i_l])
    i, j, image = links.i_l[linked], links.j_l[linked], links.image_ld[linked]
    if rigid.any():
        offset, cluster = packing.unwrapping_nd, packing.cluster_n
        member = np.flatnonzero(rigid)
        member = member[np.argsort(cluster[member], kind="stable")]
        start = np.flatnonzero(np.diff(cluster[member], prepend=-1, append=-1))
        first, second = _overlapping(position_nd + offset @ lattice_dd.T, radius_n, member, start)
        i, j = np.concatenate([i, first]), np.concatenate([j, second])
        image = np.concatenate([image, offset[second] - offset[first]])
    if not len(i):
        return 0.0
    # each pair belongs to the particle that is named second; of a particle and its own image either way is the same
    order = np.lexsort((*image.T[::-1], i, j))
    i, j, image = i[order], j[order], image[order]
    vector = position_nd[i] - position_nd[j] - image @ lattice_dd.T
    start = np.searchsorted(j, np.arange(packing.particles + 1))
    padded = np.zeros((len(i), 3))
    padded[:, : packing.dimension] = vector
    node, weight = np.polynomial.legendre.leggauss(_NODES)
    # radii that may not be written to would be compiled for once more, here and below
    return float(_shared((0,) * packing.dimension, start, i, image, padded, np.array(radius_n), node, weight))


@kernel
def _overlapping(unwrapped_nd, radius_n, member_m, start_k):
    """Return the overlapping pairs i < j within each of the clusters, whose members stand one after another."""
    first, second = [0 for _ in range(0)], [0 for _ in range(0)]
    for k in range(start_k.shape[0] - 1):
        for m in range(start_k[k], start_k[k + 1]):
            for n in range(m + 1, start_k[k + 1]):
                i, j = member_m[m], member_m[n]
                square = 0.0
                for a in range(unwrapped_nd.shape[1]):
                    square += (unwrapped_nd[j, a] - unwrapped_nd[i, a]) ** 2
                if square < ((1.0 - _TOUCHING) * (radius_n[i] + radius_n[j])) ** 2:
                    first.append(min(i, j))
                    second.append(max(i, j))
    return np.array(first, dtype=np.int64), np.array(second, dtype=np.int64)


@device
def lens(flat, a, b, distance):
    """Return the area or volume that two discs or spheres of radii a and b share."""
    if distance >= a + b:
        return 0.0
    small = min(a, b)
    if distance <= abs(a - b):
        return math.pi * small**2 if flat else 4.0 / 3.0 * math.pi * small**3
    if not flat:
        inner = distance**2 + 2.0 * distance * (a + b) - 3.0 * (a - b) ** 2
        return math.pi * (a + b - distance) ** 2 * inner / (12.0 * distance)
    # twice the angle between the line of centers and a corner of the lens
    height = math.sqrt(max(0.0, (a + b - distance) * (a + b + distance) * (distance + a - b) * (distance + b - a))) / (
        2.0 * distance
    )
    along = (distance**2 + a**2 - b**2) / (2.0 * distance)
    return a**2 * math.atan2(height, along) + b**2 * math.atan2(height, distance - along) - distance * height


@device
def _groups(inside_k, fused_kk, stack_sk, sign_s):
    """Return the alternating sum over the groups of discs, among those inside, that are all fused with each other.

    1 for discs that are all fused, 0 for none (the Euler characteristic of the graph's cliques): a disc taken out takes
    away 1 less the same sum over the discs it is fused with.
    """
    size = inside_k.shape[0]
    # one by one: to assign a whole row compiles for seconds what would say that it does not fit
    for k in range(size):
        stack_sk[0, k] = inside_k[k]
    sign_s[0] = 1
    height = 1
    found = 0
    while height:
        height -= 1
        sign = sign_s[height]
        taken = -1
        whole = True
        for k in range(size):
            if stack_sk[height, k]:
                if taken < 0:
                    taken = k
                for m in range(k):
                    whole = whole and (not stack_sk[height, m] or fused_kk[k, m])
        if taken < 0:
            continue
        found += sign
        if whole:
            continue
        for k in range(size):
            stack_sk[height + 1, k] = stack_sk[height, k] and fused_kk[taken, k]
        sign_s[height + 1] = -sign
        stack_sk[height, taken] = False
        height += 2
    return found


@device
def _covering(center_kd, radius_k, disc, other):
    """Return direction and half the angle of the arc of one disc's circle that another disc covers; -1 for none.

    Of two equal discs the first one covers the other.
    """
    x, y = center_kd[other, 0] - center_kd[disc, 0], center_kd[other, 1] - center_kd[disc, 1]
    a, b = radius_k[disc], radius_k[other]
    distance = math.sqrt(x * x + y * y)
    if distance >= a + b:
        return 0.0, -1.0
    if distance <= b - a and (distance > 0.0 or b > a or other < disc):
        return 0.0, 4.0
    if distance <= abs(a - b):
        return 0.0, -1.0
    along = (distance**2 + a**2 - b**2) / (2.0 * distance)
    height = math.sqrt(max(0.0, (a + b - distance) * (a + b + distance) * (distance + a - b) * (distance + b - a))) / (
        2.0 * distance
    )
    return math.atan2(y, x), math.atan2(height, along)


@device
def _add_moments(jump, x, y, radius, begin, end, node_q, weight_q, moment_m):
    """Add what an arc gives to the integrals of x, y, x x, x y and y y over what it bounds, to 1, 2, 4, 5 and 7.

    Polynomials of sine and cosine over pieces of at most a radian: exact to rounding.
    """
    pieces = int(math.ceil(end - begin))
    half = 0.5 * (end - begin) / pieces
    for piece in range(pieces):
        middle = begin + (2 * piece + 1) * half
        for q in range(node_q.shape[0]):
            c, s = math.cos(middle + half * node_q[q]), math.sin(middle + half * node_q[q])
            u, v = x + radius * c, y + radius * s
            # Green's theorem: of u u / 2 along dv for u, and so on
            along_v = jump * weight_q[q] * half * radius * c
            along_u = jump * weight_q[q] * half * radius * s
            moment_m[1] += 0.5 * u * u * along_v
            moment_m[2] += 0.5 * v * v * along_u
            moment_m[4] += u**3 / 3.0 * along_v
            moment_m[5] += 0.5 * u * u * v * along_v
            moment_m[7] += v**3 / 3.0 * along_u


@device
def _shared_area(center_kd, radius_k, fused_kk, node_q, weight_q, moment_m):
    """Return the area that the last disc shares with the discs before it: the integral of `_groups` over it.

    By Green's theorem on the arcs across which the integrand jumps: those of the last disc's circle, and those of the
    others inside it. The last disc has its center at the origin; those with radius 0 are not there. Moments in the
    plane are added to those given (`_add_moments`), if they are more than none.
    """
    count = radius_k.shape[0]
    last = count - 1
    stack = np.zeros((count + 2, count), dtype=np.bool_)
    sign = np.zeros(count + 2, dtype=np.int64)
    inside = np.zeros(count, dtype=np.bool_)
    direction, half = np.empty(count), np.empty(count)
    edge = np.empty(2 * count + 1)
    total = 0.0
    for disc in range(count):
        radius = radius_k[disc]
        if not radius > 0.0:
            continue
        edges = 0
        for other in range(count):
            half[other] = -1.0
            if (
                other == disc
                or not radius_k[other] > 0.0
                or not (disc == last or other == last or fused_kk[disc, other])
            ):
                continue
            direction[other], half[other] = _covering(center_kd, radius_k, disc, other)
            if 0.0 <= half[other] < 4.0:
                for side in (-1.0, 1.0):
                    edge[edges] = (direction[other] + side * half[other]) % (2.0 * math.pi)
                    edges += 1
        if disc != last and half[last] < 0.0:
            continue
        if edges:
            sort_row(edge, 0, edges)
        else:
            edge[0] = 0.0
            edges = 1
        edge[edges] = edge[0] + 2.0 * math.pi
        for e in range(edges):
            begin, end = edge[e], edge[e + 1]
            if not end > begin:
                continue
            middle = 0.5 * (begin + end)
            for other in range(count):
                away = (middle - direction[other] + math.pi) % (2.0 * math.pi) - math.pi if half[other] >= 0.0 else 0.0
                inside[other] = half[other] >= 0.0 and abs(away) < half[other]
            if disc != last and not inside[last]:
                continue
            inside[last] = False
            groups = _groups(inside, fused_kk, stack, sign)
            jump = groups if disc == last else 1 - groups
            if jump:
                x, y = center_kd[disc, 0], center_kd[disc, 1]
                turn = x * (math.sin(end) - math.sin(begin)) - y * (math.cos(end) - math.cos(begin))
                total += 0.5 * jump * radius * (radius * (end - begin) + turn)
                if moment_m.shape[0]:
                    _add_moments(jump, x, y, radius, begin, end, node_q, weight_q, moment_m)
    return total


@device
def _square(point_kd, k, x, y, z):
    """Return the squared distance of a point from one of the given ones."""
    return (point_kd[k, 0] - x) ** 2 + (point_kd[k, 1] - y) ** 2 + (point_kd[k, 2] - z) ** 2


@device
def _breakpoints(center_kd, radius_k, fused_kk, out):
    """Write the heights where the slices of spheres change their kind, within the last sphere; return how many."""
    count = radius_k.shape[0]
    last = count - 1
    all_fused = True
    for a in range(last):
        for b in range(a):
            square = _square(center_kd, b, center_kd[a, 0], center_kd[a, 1], center_kd[a, 2])
            all_fused = all_fused and (fused_kk[a, b] or square >= (radius_k[a] + radius_k[b]) ** 2)
    out[0], out[1] = -radius_k[last], radius_k[last]
    found = 2
    for a in range(count):
        x, y, z = center_kd[a, 0], center_kd[a, 1], center_kd[a, 2]
        for side in (-1.0, 1.0):
            found = _noted(x, y, z + side * radius_k[a], center_kd, radius_k, all_fused, out, found)
        for b in range(a):
            distance = math.sqrt(_square(center_kd, b, x, y, z))
            if distance >= radius_k[a] + radius_k[b] or distance <= abs(radius_k[a] - radius_k[b]):
                continue
            nx, ny, nz = (
                (center_kd[b, 0] - x) / distance,
                (center_kd[b, 1] - y) / distance,
                (center_kd[b, 2] - z) / distance,
            )
            along = (distance**2 + radius_k[a] ** 2 - radius_k[b] ** 2) / (2.0 * distance)
            circle = math.sqrt(max(0.0, radius_k[a] ** 2 - along**2))
            mx, my, mz = x + along * nx, y + along * ny, z + along * nz
            tilt = math.sqrt(max(0.0, 1.0 - nz**2))
            if tilt > 0.0:
                # the highest and the lowest point of the circle in which two spheres meet
                up = -nz / tilt
                for side in (-1.0, 1.0):
                    far = side * circle
                    px, py, pz = mx + far * (up * nx), my + far * (up * ny), mz + far * (up * nz + 1.0 / tilt)
                    found = _noted(px, py, pz, center_kd, radius_k, all_fused, out, found)
            for c in range(b):
                # where that circle meets a third sphere
                rx, ry, rz = center_kd[c, 0] - mx, center_kd[c, 1] - my, center_kd[c, 2] - mz
                off = rx * nx + ry * ny + rz * nz
                fx, fy, fz = rx - off * nx, ry - off * ny, rz - off * nz
                aside = math.sqrt(fx * fx + fy * fy + fz * fz)
                if not aside > 0.0:
                    continue
                foot = (rx * rx + ry * ry + rz * rz + circle**2 - radius_k[c] ** 2) / (2.0 * aside)
                if abs(foot) > circle:
                    continue
                wing = math.sqrt(circle**2 - foot**2) / aside
                foot /= aside
                for side in (-1.0, 1.0):
                    px = mx + foot * fx + side * wing * (ny * fz - nz * fy)
                    py = my + foot * fy + side * wing * (nz * fx - nx * fz)
                    pz = mz + foot * fz + side * wing * (nx * fy - ny * fx)
                    found = _noted(px, py, pz, center_kd, radius_k, all_fused, out, found)
    return found


@device
def _noted(x, y, z, center_kd, radius_k, all_fused, out, found):
    """Write the height of a point unless nothing is seen of it: outside the last sphere, or deep inside another one."""
    last = radius_k.shape[0] - 1
    own = radius_k[last]
    if not -own < z < own or x * x + y * y + z * z > own**2 * (1.0 + _HIDDEN):
        return found
    if all_fused:
        for k in range(last):
            if _square(center_kd, k, x, y, z) < radius_k[k] ** 2 * (1.0 - _HIDDEN):
                return found
    out[found] = z
    return found + 1


@device
def _sliced(center_kd, radius_k, fused_kk, node_q, weight_q, moment_m):
    """Return the volume that the last sphere shares with those before it, from the areas of slices.

    Between breakpoints areas are smooth, with powers of 3/2 at their ends, which the change of variable takes away.
    The integrals of x, y, z, x x, x y, x z, y y, y z and z z are added to the moments from 1 on, if they are more than
    none.
    """
    count = radius_k.shape[0]
    own = radius_k[count - 1]
    edge = np.empty(2 + 2 * count + count * count + count**3 // 3 + 1)
    edges = _breakpoints(center_kd, radius_k, fused_kk, edge)
    sort_row(edge, 0, edges)
    disc = np.empty(count)
    slice_m = np.zeros_like(moment_m)
    total = 0.0
    begin = edge[0]
    for e in range(1, edges):
        if edge[e] - begin <= _SAME * own:
            continue
        middle, half = 0.5 * (begin + edge[e]), 0.5 * (edge[e] - begin)
        for q in range(node_q.shape[0]):
            s = node_q[q]
            height = middle + half * 0.5 * s * (3.0 - s * s)
            for k in range(count):
                disc[k] = math.sqrt(max(0.0, radius_k[k] ** 2 - (height - center_kd[k, 2]) ** 2))
            area = _shared_area(center_kd, disc, fused_kk, node_q, weight_q, slice_m)
            total += weight_q[q] * half * 1.5 * (1.0 - s * s) * area
            if slice_m.shape[0]:
                weight = weight_q[q] * half * 1.5 * (1.0 - s * s)
                slice_m[3], slice_m[6], slice_m[8] = height * area, height * slice_m[1], height * slice_m[2]
                slice_m[9] = height**2 * area
                for m in range(10):
                    moment_m[m] += weight * slice_m[m]
                    slice_m[m] = 0.0
        begin = edge[e]
    return total


@kernel
def _shared(axes, start_n, i_p, image_pd, vector_pd, radius_n, node_q, weight_q):
    """Return the sum over particles of what each shares with those that it is fused with and that come before it.

    The pairs of a particle stand from start_n on: the other one, its image, and the vector to it. `axes` is a tuple as
    long as the dimension, which is thereby known when the loop is compiled.
    """
    total = 0.0
    moment = np.empty(0)
    for n in range(start_n.shape[0] - 1):
        low, high = start_n[n], start_n[n + 1]
        count = high - low
        if not count:
            continue
        fused = np.zeros((count + 1, count + 1), dtype=np.bool_)
        pairs_only = True
        for p in range(low, high):
            for q in range(low, high):
                for r in range(start_n[i_p[q]], start_n[i_p[q] + 1]):
                    same = p != q and i_p[r] == i_p[p]
                    for a in range(image_pd.shape[1]):
                        same = same and image_pd[r, a] == image_pd[p, a] - image_pd[q, a]
                    if same:
                        fused[p - low, q - low] = fused[q - low, p - low] = True
                        pairs_only = False
        if pairs_only:
            for p in range(low, high):
                distance = math.sqrt(_square(vector_pd, p, 0.0, 0.0, 0.0))
                total += lens(len(axes) == 2, radius_n[n], radius_n[i_p[p]], distance)
            continue
        center, radius = np.zeros((count + 1, 3)), np.empty(count + 1)
        for p in range(low, high):
            for a in range(3):
                center[p - low, a] = vector_pd[p, a]
            radius[p - low] = radius_n[i_p[p]]
        radius[count] = radius_n[n]
        if len(axes) == 2:
            total += _shared_area(center, radius, fused, node_q, weight_q, moment)
        else:
            total += _sliced(center, radius, fused, node_q, weight_q, moment)
    return total


@kernel
def _union_moments(axes, center_kd, radius_k, node_q, weight_q):
    """Return the integrals over a union of 1, x, y, z, x x, x y, x z, y y, y z and z z; `axes` as in `_shared`."""
    total = np.zeros(10)
    shared = np.zeros(10)
    vector = np.zeros((center_kd.shape[0], 3))
    for n in range(center_kd.shape[0]):
        shared[:] = 0.0
        for k in range(n + 1):
            for a in range(center_kd.shape[1]):
                vector[k, a] = center_kd[k, a] - center_kd[n, a]
        fused = np.ones((n + 1, n + 1), dtype=np.bool_)
        radius = radius_k[n]
        if len(axes) == 2:
            shared[0] = _shared_area(vector[: n + 1], radius_k[: n + 1], fused, node_q, weight_q, shared)
            volume = math.pi * radius**2
            spread = 0.25 * radius**2
        else:
            shared[0] = _sliced(vector[: n + 1], radius_k[: n + 1], fused, node_q, weight_q, shared)
            volume = 4.0 / 3.0 * math.pi * radius**3
            spread = 0.2 * radius**2
        # about its own center what a disc or sphere adds is what it has less what it shares
        own = -shared
        own[0] += volume
        own[4] += spread * volume
        own[7] += spread * volume
        x, y, z = center_kd[n, 0], center_kd[n, 1], 0.0
        if len(axes) == 3:
            z = center_kd[n, 2]
            own[9] += spread * volume
        total[0] += own[0]
        total[1] += own[1] + x * own[0]
        total[2] += own[2] + y * own[0]
        total[3] += own[3] + z * own[0]
        total[4] += own[4] + 2.0 * x * own[1] + x * x * own[0]
        total[5] += own[5] + x * own[2] + y * own[1] + x * y * own[0]
        total[6] += own[6] + x * own[3] + z * own[1] + x * z * own[0]
        total[7] += own[7] + 2.0 * y * own[2] + y * y * own[0]
        total[8] += own[8] + y * own[3] + z * own[2] + y * z * own[0]
        total[9] += own[9] + 2.0 * z * own[3] + z * z * own[0]
    return total


def union_moments(
    center_kd: NDArray[np.float64], radius_k: NDArray[np.float64]
) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
    """Return area or volume of a union of discs or spheres, its center of mass, and its second moments about that.

    Exact in a plane; in space by a quadrature over slices, to some 1e-10.

    Parameters
    ----------
    center_kd, radius_k
        Centers and radii [length].

    """
    d = center_kd.shape[1]
    node, weight = np.polynomial.legendre.leggauss(_NODES)
    moment = _union_moments((0,) * d, np.array(center_kd), np.array(radius_k), node, weight)
    volume = float(moment[0])
    center = moment[1:4] / volume
    second = np.array([[moment[4], moment[5], moment[6]], [moment[5], moment[7], moment[8]], moment[[6, 8, 9]]])
    second = second / volume - np.outer(center, center)
    return volume, center[:d], second[:d, :d]


def body_moments(shapes: Beads | Superellipsoids) -> NDArray[np.float64]:
    """Return the (N, d, d) second moments of bodies of unit radius over mass, in their own frames [length^2]."""
    n, d, square = len(shapes), shapes.dimension, shapes.gyration_nk**2
    found = np.zeros((n, d, d))
    if isinstance(shapes, Superellipsoids):
        found[:, range(d), range(d)] = shapes.spread_nd
        return found
    if d == 3:
        # moments of inertia are sums of two of these
        found[:, (0, 1, 2), (0, 1, 2)] = 0.5 * square.sum(axis=1, keepdims=True) - square
        return found
    bead = np.hstack([shapes.offset_bd, shapes.size_b[:, None]])
    known: dict[bytes, NDArray[np.float64]] = {}
    for k in range(n):
        own = bead[shapes.start_n[k] : shapes.start_n[k + 1]]
        key = own.tobytes()
        if key not in known:
            second = union_moments(own[:, :2], own[:, 2])[2]
            known[key] = second / np.trace(second)
        found[k] = known[key]
    return np.asarray(found * square[:, :, None])


def second_moments(packing: Packing) -> NDArray[np.float64]:
    """Return the (N, d, d) second moments of all particles about their centers, over mass, as they lie [length^2]."""
    shapes, radius, d = packing.shapes, packing.radius_n, packing.dimension
    if isinstance(shapes, Beads | Superellipsoids):
        frame = shapes.frames()
        return np.asarray(frame @ body_moments(shapes) @ frame.transpose(0, 2, 1)) * radius[:, None, None] ** 2
    share = 0.25 if d == 2 else 0.2
    along, across = (one[:, None, None] ** 2 for one in shapes.semi_axes(radius))
    director = shapes.axis_nd
    return np.asarray(share * ((along - across) * director[:, :, None] * director[:, None, :] + across * np.eye(d)))
