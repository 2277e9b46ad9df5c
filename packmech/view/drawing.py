"""What a picture of a packing shows, as arrays: discs and copies, lines of forces, bonds and links, box, walls, colors.

Draws nothing; pictures and recordings are made of the same arrays.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import ConvexHull

from packmech.box import Box
from packmech.constraints.factor import link_pairs
from packmech.contacts import Contacts
from packmech.contacts.shape_contacts import ShapeContacts, touching_pairs
from packmech.effects import MeshWalls, Walls, acting_contacts, bonds_of, contact_terms
from packmech.links import number_by_first
from packmech.measure.stress import tension_of
from packmech.mechanics.rigid_clusters import RigidClusters
from packmech.packing import Packing
from packmech.scene import Scene
from packmech.shapes import Superellipsoids

# dark ground: small to large particles from slate to steel blue, rattlers in amber, forces from ember to pale yellow
BACKGROUND = (13, 17, 26)
SMALL, LARGE, RATTLER = (62, 92, 128), (98, 140, 184), (214, 158, 58)
WEAK_FORCE, STRONG_FORCE = (168, 58, 46), (255, 236, 170)
# clusters in hues of their own, far from those of rattlers and forces; a link's line turns green where it pulls its
# ends together and violet where it pushes them apart
CLUSTERS = ((74, 118, 168), (58, 132, 128), (104, 98, 172), (92, 140, 92), (124, 104, 146), (110, 134, 158))
IDLE_BOND, IDLE_SHAPE, TENSION, COMPRESSION = (222, 228, 236), (128, 140, 158), (64, 224, 160), (190, 104, 240)
# rigid clusters, the largest first; joints of two particles alone, and between what turns against each other
RIGID = (
    (226, 88, 62), (66, 146, 214), (240, 176, 52), (62, 168, 116), (164, 110, 210), (232, 124, 176), (98, 196, 196),
    (158, 128, 76), (150, 190, 70), (104, 118, 220),
)  # fmt: skip
SMALL_CLUSTER, TURNING = (158, 166, 178), (96, 102, 114)
OUTLINE = (150, 160, 176)
ARROW = (255, 214, 102)
CURVE = (122, 174, 230)
# a force line is this many diameters wide at the mean force, and no wider than at four times the mean
LINE_WIDTH, WIDEST = 0.13, 4.0
# beads of clusters in 3D where links are to be seen, over their radius
BEAD = 0.4
# a link that bears nothing is drawn as wide as this part of the mean force
THINNEST = 0.35
ARROW_RADIUS, OUTLINE_RADIUS = 0.08, 0.03
# contacts at the Coulomb limit, particles that are held, walls, and the marks that turn with particles
SLIDING, HELD, WALL, MARK = (96, 200, 255), (170, 176, 190), (214, 216, 222), (13, 17, 26)
# half widths over the reference diameter
BOND_WIDTH, MARK_WIDTH, WALL_WIDTH = 0.06, 0.035, 0.05
RIGID_WIDTH, STRESSED_WIDTH = 0.05, 0.1
# direction from which three-dimensional packings are viewed
VIEW = (0.42, -0.88, 0.45)
# a box so much flatter than it need be is drawn with its shortest vectors
_FLAT = 0.7


@dataclass(frozen=True)
class Drawing:
    """Arrays to draw, all inside or at the edge of the cell.

    Attributes
    ----------
    center_nd
        (N, d) wrapped centers [length].
    copy_center_kd, copy_of_k
        (K, d) centers of periodic copies that reach into the cell [length], and whose they are.
    segment_sed, force_s
        (S, 2, d) ends of the force lines [length], two lines where a contact crosses the cell's edge; (S,) their forces
        over the mean [1].
    outline_ed
        Polylines along the cell's edges [length].
    bond_sed, bond_tension_s
        (B, 2, d) ends of the lines of links that are bonds [length], two lines where a link crosses the cell's edge;
        (B,) their forces over the mean contact force, tension positive [1]; 0 without effects.
    shape_sed, shape_tension_s
        The same for links that hold an angle or a shape.

    """

    center_nd: NDArray[np.float64]
    copy_center_kd: NDArray[np.float64]
    copy_of_k: NDArray[np.int64]
    segment_sed: NDArray[np.float64]
    force_s: NDArray[np.float64]
    outline_ed: list[NDArray[np.float64]]
    bond_sed: NDArray[np.float64]
    bond_tension_s: NDArray[np.float64]
    shape_sed: NDArray[np.float64]
    shape_tension_s: NDArray[np.float64]


def draw_packing(packing: Packing, effects: tuple[Any, ...] = ()) -> Drawing:
    """Return what to draw of a packing; without effects every touching pair gets a line of the mean width.

    Examples
    --------
    >>> import packmech as pm
    >>> pair = pm.Packing([[0.2, 1.0], [1.9, 1.0]], [0.2, 0.2], pm.Box.cubic(2.0, 2))
    >>> drawing = draw_packing(pair)
    >>> drawing.segment_sed.shape, drawing.copy_of_k.tolist()    # one contact, across the edge: drawn at both sides
    ((2, 2, 2), [1])
    """
    inside = packing.wrapped()
    contacts = acting_contacts(touching_pairs(inside), effects)
    force_c = _relative_force(contacts, effects)
    segments, pair_s = pair_lines(inside.position_nd, contacts.i_c, contacts.j_c, contacts.image_cd, contacts.vector_cd)
    copy_center, copy_of = _copies(inside)
    return Drawing(
        inside.position_nd,
        copy_center,
        copy_of,
        segments,
        force_c[pair_s],
        box_outline(packing.box),
        *_link_lines(inside, contacts, effects),
    )


def pair_lines(
    position_nd: NDArray[np.float64],
    i_c: NDArray[np.int64],
    j_c: NDArray[np.int64],
    image_cd: NDArray[np.int64],
    vector_cd: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Return a line from i to j for each pair, and a second one that ends in j itself where that is an image of j."""
    crossing = np.flatnonzero(np.any(image_cd != 0, axis=1))
    start_cd, far_cd = position_nd[i_c], position_nd[j_c[crossing]]
    here = np.stack([start_cd, start_cd + vector_cd], axis=1)
    there = np.stack([far_cd - vector_cd[crossing], far_cd], axis=1)
    return np.concatenate([here, there]), np.concatenate([np.arange(len(i_c)), crossing])


def spring_lines(packing: Packing, effects: tuple[Any, ...]) -> NDArray[np.float64]:
    """Return (S, 2, d) ends of the lines of a scene's springs [length]; arguments as of `draw_packing`."""
    bonds = bonds_of(tuple(effects))
    if bonds is None or not len(bonds):
        return np.zeros((0, 2, packing.dimension))
    vector = packing.position_nd[bonds.j_b] - packing.position_nd[bonds.i_b] + bonds.image_bd @ packing.box.lattice_dd.T
    place = packing.wrapped().position_nd
    apart = (place[bonds.i_b] + vector - place[bonds.j_b]) @ packing.box.inverse_dd.T
    return pair_lines(place, bonds.i_b, bonds.j_b, np.rint(apart).astype(np.int64), vector)[0]


def _link_lines(packing: Packing, contacts: Any, effects: tuple[Any, ...]) -> tuple[NDArray[np.float64], ...]:
    """Return lines and tensions of the bonds, then those of the links that hold shapes."""
    links = packing.links
    tension_l = relative_tension(packing, contacts, effects)
    vector_ld = links.vectors(packing.position_nd, packing.box.lattice_dd)
    segments, link_s = pair_lines(packing.position_nd, links.i_l, links.j_l, links.image_ld, vector_ld)
    shape_s = links.shape_l[link_s]
    tension_s = tension_l[link_s]
    return segments[~shape_s], tension_s[~shape_s], segments[shape_s], tension_s[shape_s]


def relative_tension(packing: Packing, contacts: Contacts, effects: tuple[Any, ...]) -> NDArray[np.float64]:
    """Return the (L,) forces of the links over the mean contact force, tension positive [1]; 0 without effects."""
    links = packing.links
    if len(links) and effects and len(contacts):
        first_c = contact_terms(effects, contacts).first_c
        mean = float(np.abs(first_c).mean())
        if mean > 0.0:
            return tension_of(Scene(packing, effects)) / mean
    return np.zeros(len(links))


def box_outline(box: Box) -> list[NDArray[np.float64]]:
    """Return polylines along the edges of the cell: one closed loop in 2D, two loops and four posts in 3D."""
    a, b = box.lattice_dd[:, 0], box.lattice_dd[:, 1]
    loop = np.array([0 * a, a, a + b, b, 0 * a])
    if box.dimension == 2:
        return [loop]
    c = box.lattice_dd[:, 2]
    return [loop, loop + c, *(np.array([corner, corner + c]) for corner in loop[:4])]


def shown_box(box: Box) -> tuple[Box, NDArray[np.int64]]:
    """Return the box to draw, and the integers that turn images of the box as it is into images of that."""
    small, change = box.reduced()
    if box.height_d.min() >= _FLAT * small.height_d.min():
        return box, np.eye(box.dimension, dtype=np.int64)
    return small, np.rint(np.linalg.inv(change)).astype(np.int64)


class ShownCell:
    """A packing wrapped into the cell that is drawn.

    Attributes
    ----------
    box
        The cell: the packing's box, with its shortest vectors where it is sheared far.
    inside_nd
        (N, d) wrapped centers [length].

    """

    def __init__(self, packing: Packing) -> None:
        self.box, self._back = shown_box(packing.box)
        self.inside_nd, self._image_nd = self.box.wrap(packing.position_nd)

    def lines(
        self, i_c: Any, j_c: Any, image_cd: Any
    ) -> tuple[NDArray[np.float64], NDArray[np.intp], NDArray[np.float64]]:
        """Return lines between pairs at these images of the packing's box, whose each line is, and (C, d) vectors."""
        image_sd = np.asarray(image_cd) @ self._back.T + self._image_nd[j_c] - self._image_nd[i_c]
        vector = self.inside_nd[j_c] - self.inside_nd[i_c] + image_sd @ self.box.lattice_dd.T
        return *pair_lines(self.inside_nd, i_c, j_c, image_sd, vector), vector


def wall_outlines(effects: Sequence[Any], box: Box) -> list[NDArray[np.float64]]:
    """Return polylines along the walls among the effects, across the extent of the cell."""
    corner_kd = np.concatenate(box_outline(box))
    low, high = corner_kd.min(axis=0), corner_kd.max(axis=0)
    found = []
    for wall in (one for one in effects if isinstance(one, Walls)):
        axis = int(wall.axis)
        others = [a for a in range(box.dimension) if a != axis]
        for place in (wall.low, wall.high):
            turns = [(0,), (1,)] if len(others) == 1 else [(0, 0), (0, 1), (1, 1), (1, 0), (0, 0)]
            line = np.empty((len(turns), box.dimension))
            line[:, axis] = place
            for k, a in enumerate(others):
                line[:, a] = [(low[a], high[a])[turn[k]] for turn in turns]
            found.append(line)
    for mesh in (one for one in effects if isinstance(one, MeshWalls)):
        found += [corner_cd[[0, 1, 2, 0]] for corner_cd in mesh.corner_tcd]
    return found


def view_axes() -> NDArray[np.float64]:
    """Return the directions across, up and toward the eye as columns, for packings in space."""
    toward = np.array(VIEW) / np.linalg.norm(VIEW)
    across = np.cross((0.0, 0.0, 1.0), toward)
    across /= np.linalg.norm(across)
    return np.column_stack([across, np.cross(toward, across), toward])


def particle_colors(
    packing: Packing,
    effects: Sequence[Any] = (),
    rattler_n: NDArray[np.bool_] | None = None,
    held_n: NDArray[np.bool_] | None = None,
) -> NDArray[np.uint8]:
    """Return (N, 3) colors: by kind where there are several, else by size between two blues.

    Of one kind, rigid bodies, linked or bonded clusters have hues of their own. Particles that are held are gray,
    rattlers amber.
    """
    span = float(np.ptp(packing.radius_n))
    share_n = (packing.radius_n - packing.radius_n.min()) / span if span > 0 else np.ones_like(packing.radius_n)
    color_nc = between(SMALL, LARGE, share_n)
    hues, links, bonds = np.array(CLUSTERS, dtype=np.uint8), packing.links, bonds_of(tuple(effects))
    joined = np.flatnonzero(np.diff(packing.shapes.start_n) > 1)
    color_nc[joined] = hues[np.arange(len(joined)) % len(hues)]
    if packing.given_kind_n is not None:
        color_nc = hues[packing.given_kind_n % len(hues)]
    elif len(links):
        linked = np.union1d(links.i_l, links.j_l)
        color_nc[linked] = hues[number_by_first(links.clusters(packing.particles)[linked]) % len(CLUSTERS)]
    elif bonds is not None:
        graph = coo_array((np.ones(len(bonds)), (bonds.i_b, bonds.j_b)), shape=(packing.particles, packing.particles))
        _, fragment_n = connected_components(graph, directed=False)
        bonded = np.unique(np.concatenate([bonds.i_b, bonds.j_b]))
        color_nc[bonded] = hues[np.unique(fragment_n[bonded], return_inverse=True)[1].ravel() % len(hues)]
    if held_n is not None:
        color_nc[held_n] = HELD
    if rattler_n is not None:
        color_nc[rattler_n] = RATTLER
    return color_nc


class ClusterLines(NamedTuple):
    """Lines of the joints of rigid clusters.

    (S, 2, d) ends [length], (S, 3) colors, (S,) half widths over the reference diameter, and (S,) the cluster of each.
    """

    segment_sed: NDArray[np.float64]
    color_sc: NDArray[np.uint8]
    width_s: NDArray[np.float64]
    cluster_s: NDArray[np.int64]


def cluster_lines(clusters: RigidClusters) -> ClusterLines:
    """Return lines of contacts and links in the colors of their rigid clusters, wide where these are over-constrained.

    Of two particles alone they are gray, and darker between particles that turn against each other.
    """
    inside, links = clusters.packing.wrapped(), link_pairs(clusters.packing)
    parts = (clusters.contacts, links)
    i, j = (np.concatenate([getattr(one, name) for one in parts]) for name in ("i_c", "j_c"))
    vector = np.concatenate([one.vector_cd for one in parts])
    apart = (inside.position_nd[i] + vector - inside.position_nd[j]) @ inside.box.inverse_dd.T
    segment, pair = pair_lines(inside.position_nd, i, j, np.rint(apart).astype(np.int64), vector)
    label = np.concatenate([clusters.cluster_c, clusters.cluster_l])[pair]
    stressed = np.concatenate([clusters.overconstrained_c, clusters.overconstrained_l])[pair]
    color = np.array(RIGID, dtype=np.uint8)[np.maximum(label, 0) % len(RIGID)]
    several = np.append(clusters.size_k > 2, False)[label]
    color[~several] = SMALL_CLUSTER
    color[label < 0] = TURNING
    width = np.where(stressed, STRESSED_WIDTH, np.where(several, RIGID_WIDTH, 0.5 * RIGID_WIDTH))
    return ClusterLines(segment, color, width, label)


def dimmed(color_nc: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return the colors mixed with the background, for periodic copies."""
    mixed: NDArray[np.uint8] = (0.45 * color_nc + 0.55 * np.array(BACKGROUND)).astype(np.uint8)
    return mixed


def force_colors(force_s: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return (S, 3) colors from ember (no force) to pale yellow (three times the mean and above)."""
    return between(WEAK_FORCE, STRONG_FORCE, np.clip(force_s / 3.0, 0.0, 1.0))


def force_radii(force_s: NDArray[np.float64], diameter: float, dimension: int) -> NDArray[np.float64]:
    """Return half the width of each force line [length]: proportional to the force, thinner in 3D."""
    return LINE_WIDTH / dimension * diameter * np.minimum(force_s, WIDEST)


def tension_colors(tension_s: NDArray[np.float64], *, shape: bool) -> NDArray[np.uint8]:
    """Return (S, 3) colors of links: gray without force, green in tension, violet in compression, full at 2 means."""
    idle = IDLE_SHAPE if shape else IDLE_BOND
    share_s = np.clip(np.abs(tension_s) / 2.0, 0.0, 1.0)
    pulled, pushed = between(idle, TENSION, share_s), between(idle, COMPRESSION, share_s)
    return np.where((tension_s >= 0.0)[:, None], pulled, pushed)


def tension_radii(
    tension_s: NDArray[np.float64], diameter: float, dimension: int, *, shape: bool
) -> NDArray[np.float64]:
    """Return half the width of each link's line [length]: that of a contact of its force, half that for shape links."""
    width_s = force_radii(np.maximum(np.abs(tension_s), THINNEST), diameter, dimension)
    return 0.5 * width_s if shape else width_s


def arrow_scale(displacement_nd: NDArray[np.float64], diameter: float) -> float:
    """Return the factor that makes the longest arrow 1.5 diameters long; 1 when nothing moves."""
    longest = float(np.max(np.linalg.norm(displacement_nd, axis=1), initial=0.0))
    return 1.5 * diameter / longest if longest > 0 else 1.0


def _relative_force(contacts: Contacts | ShapeContacts, effects: tuple[Any, ...]) -> NDArray[np.float64]:
    if not len(contacts):
        return np.zeros(0)
    if not effects:
        return np.ones(len(contacts))
    force_c = force_magnitudes(contacts, effects)
    mean = float(force_c.mean())
    return force_c / mean if mean > 0 else np.zeros(len(contacts))


def force_magnitudes(contacts: Contacts | ShapeContacts, effects: tuple[Any, ...]) -> NDArray[np.float64]:
    """Return the (C,) magnitudes of the forces that effects exert at contacts [force]."""
    force_c = np.abs(contact_terms(effects, contacts).first_c)
    return force_c * contacts.push_c


@dataclass(frozen=True, eq=False)
class Sites:
    """What particles are drawn as: discs and spheres, or ellipses and spheroids, one or more for each of them.

    Attributes
    ----------
    place_bd
        (B, d) centers [length].
    along_b, across_b
        (B,) semi-axes along the axis and across it [length].
    axis_bd
        (B, d) directions of the axes.
    owner_b
        (B,) particles that they belong to.
    round
        Whether all are discs or spheres.
    corner_bks
        (B, corners + 1, 2) closed outlines about the centers, of superellipses [length]; None of all others, and the
        semi-axes of superellipses are both those of the circle that holds them.

    """

    place_bd: NDArray[np.float64]
    along_b: NDArray[np.float64]
    across_b: NDArray[np.float64]
    axis_bd: NDArray[np.float64]
    owner_b: NDArray[np.int64]
    round: bool
    corner_bks: NDArray[np.float64] | None = None

    def outlines(self, corners: int = 32) -> NDArray[np.float64]:
        """Return (B, corners + 1, 2) closed lines around ellipses, or the outlines of superellipses."""
        if self.corner_bks is not None:
            return np.asarray(self.place_bd[:, None] + self.corner_bks)
        angle = np.linspace(0.0, 2.0 * np.pi, corners + 1)[:, None]
        aside_bd = np.stack([-self.axis_bd[:, 1], self.axis_bd[:, 0]], axis=1)
        along, across = (self.along_b[:, None] * self.axis_bd)[:, None], (self.across_b[:, None] * aside_bd)[:, None]
        return np.asarray(self.place_bd[:, None] + np.cos(angle) * along + np.sin(angle) * across)


def sites_of(packing: Packing, center_kd: NDArray[np.float64], owner_k: NDArray[np.int64] | None = None) -> Sites:
    """Return what to draw of particles, or of copies of some of them (owner_k), with centers at these places."""
    bodies = packing.shapes
    owner_k = np.arange(packing.particles) if owner_k is None else owner_k
    if not bodies.has_spheroid_sites:
        if packing.dimension == 3:
            raise ValueError(
                f"packing must be of spheres, spheroids or rigid bodies to be painted, got {type(bodies).__name__}: "
                "pm.plot draws these"
            )
        reach = bodies.reach(packing.radius_n)[owner_k]
        corners = silhouettes(packing)[owner_k]
        return Sites(center_kd, reach, reach, bodies.axis_nd[owner_k], owner_k, round=False, corner_bks=corners)
    count_k = np.diff(bodies.start_n)[owner_k]
    # sites of a particle follow each other: from the first one of each, counted up
    of_b = np.repeat(np.arange(len(owner_k)), count_k)
    site_b = np.arange(len(of_b)) + np.repeat(bodies.start_n[owner_k] - np.cumsum(count_k) + count_k, count_k)
    along, across = bodies.semi_axes(packing.radius_n)
    place_bd = center_kd[of_b] + bodies.arms(packing.radius_n)[site_b]
    shown = along[site_b], across[site_b], bodies.axis_bd[site_b], owner_k[of_b]
    return Sites(place_bd, *shown, round=np.array_equal(along, across))


def projected(place_kd: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return places across, up, and toward the eye."""
    if place_kd.shape[-1] == 2:
        return np.concatenate([place_kd, np.zeros((*place_kd.shape[:-1], 1))], axis=-1)
    return np.asarray(place_kd @ view_axes())


class Outlines(NamedTuple):
    """What is seen of particles: (K, 3) places across, up and toward the eye, axes of ellipses [length] and angles.

    angle_k are those of the first axes [degrees], owner_k whose outlines they are; corner_kcs are (K, corners, 2)
    outlines about the places where they are no ellipses.
    """

    place_ks: NDArray[np.float64]
    width_k: NDArray[np.float64]
    height_k: NDArray[np.float64]
    angle_k: NDArray[np.float64]
    owner_k: NDArray[np.int64]
    corner_kcs: NDArray[np.float64] | None = None

    def taken(self, order_k: NDArray[np.int64]) -> Outlines:
        """Return them in another order."""
        axes = self.width_k[order_k], self.height_k[order_k], self.angle_k[order_k]
        corners = None if self.corner_kcs is None else self.corner_kcs[order_k]
        return Outlines(self.place_ks[order_k], *axes, self.owner_k[order_k], corners)


def seen_outlines(packing: Packing, center_kd: NDArray[np.float64], owner_k: NDArray[np.int64]) -> Outlines:
    """Return what particles, or the beads of bodies, with centers at these places look like from where the eye is."""
    if not packing.shapes.has_spheroid_sites:
        width = 2.0 * packing.shapes.reach(packing.radius_n)[owner_k]
        corners = silhouettes(packing)[owner_k]
        return Outlines(projected(center_kd), width, width, np.zeros(len(owner_k)), owner_k, corners)
    sites = sites_of(packing, center_kd, owner_k)
    axis_ks = projected(sites.axis_bd)[:, :2]
    # a spheroid seen from afar is an ellipse, as long as its axis is seen
    square = (sites.along_b**2 - sites.across_b**2) * (axis_ks**2).sum(axis=1)
    width_k, height_k = 2.0 * np.sqrt(sites.across_b**2 + square), 2.0 * sites.across_b
    angle_k = np.degrees(np.arctan2(axis_ks[:, 1], axis_ks[:, 0])) * (sites.along_b != sites.across_b)
    return Outlines(projected(sites.place_bd), width_k, height_k, angle_k, sites.owner_b)


def silhouettes(packing: Packing, corners: int = 128) -> NDArray[np.float64]:
    """Return (N, corners + 1, 2) closed outlines of superellipsoids about their centers, from where the eye is."""
    shapes: Any = packing.shapes
    angle = np.linspace(0.0, 2.0 * np.pi, corners + 1)
    across_ds = np.eye(2) if packing.dimension == 2 else view_axes()[:, :2]
    # the edge of what is seen is where normals lie in the plane of the picture
    normal = np.stack([np.cos(angle), np.sin(angle)], axis=1) @ across_ds.T
    normal = np.repeat(normal[:, None], packing.particles, axis=1)
    return np.asarray((shapes.surface_points(normal, packing.radius_n) @ across_ds).transpose(1, 0, 2))


class Solids(NamedTuple):
    """Superellipsoids of one exponent and one color, which triangles of one surface show.

    Of the surface with semi-axes of 1 they are (V, 3) corners and (V, 3) normals there, and (T, 3) numbers of corners.
    """

    particle_k: NDArray[np.intp]
    color: NDArray[np.uint8]
    corner_vd: NDArray[np.float64]
    normal_vd: NDArray[np.float64]
    triangle_tk: NDArray[np.int64]


def solids_of(packing: Packing, color_nc: NDArray[np.uint8], parts: int = 12) -> list[Solids]:
    """Return what shows superellipsoids in space, by exponent and color; `parts` divide each edge of an octahedron."""
    shapes: Any = packing.shapes
    grid = np.array([one for one in np.ndindex((2 * parts + 1,) * 3)], dtype=float) - parts
    normal = grid[np.abs(grid).sum(axis=1) == parts]
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    triangle = ConvexHull(normal).simplices.astype(np.int64)
    inward = np.linalg.det(normal[triangle]) < 0.0
    triangle[inward] = triangle[inward, ::-1]
    look, group_n = np.unique(np.column_stack([shapes.exponent_n, color_nc]), axis=0, return_inverse=True)
    found = []
    for k, (exponent, *color) in enumerate(look):
        one = Superellipsoids(np.array([exponent]), np.ones((1, 3)), np.array([[1.0, 0.0, 0.0, 0.0]]))
        corner = one.surface_points(normal[:, None], np.ones(1))[:, 0] / one.axes(np.ones(1))
        members = np.flatnonzero(group_n.ravel() == k)
        found.append(Solids(members, np.array(color, dtype=np.uint8), corner, normal, triangle))
    return found


def orientations(axis_bd: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return (B, 4) quaternions (x, y, z, w) that turn the x axis to the axes of spheroids."""
    x, y, z = axis_bd.T
    # the shortest rotation; opposite directors are the same shape
    sign = np.where(x < 0.0, -1.0, 1.0)
    found = np.stack([np.zeros(len(x)), -sign * z, sign * y, 1.0 + np.abs(x)], axis=1)
    return np.asarray(found / np.sqrt((found**2).sum(axis=1, keepdims=True)))


def _copies(packing: Packing) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Periodic copies of particles that reach into the cell from outside."""
    centers, owners = [], []
    reach_nd = packing.shapes.reach(packing.radius_n)[:, None] / packing.box.height_d
    fraction_nd = packing.position_nd @ packing.box.inverse_dd.T
    for shift in itertools.product((-1, 0, 1), repeat=packing.dimension):
        if any(shift):
            moved_nd = fraction_nd + np.array(shift)
            reaches_n = np.all((moved_nd > -reach_nd) & (moved_nd < 1.0 + reach_nd), axis=1)
            centers.append(moved_nd[reaches_n] @ packing.box.lattice_dd.T)
            owners.append(np.flatnonzero(reaches_n))
    return np.concatenate(centers), np.concatenate(owners).astype(np.int64)


def between(low: tuple[int, ...], high: tuple[int, ...], share: NDArray[np.float64]) -> NDArray[np.uint8]:
    """Return (S, 3) colors that lie that share of the way from one to the other."""
    mixed: NDArray[np.uint8] = np.rint((1.0 - share[:, None]) * np.array(low) + share[:, None] * np.array(high)).astype(
        np.uint8
    )
    return mixed
