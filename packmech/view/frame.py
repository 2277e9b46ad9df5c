# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""A picture of a packing as an array of pixels, drawn by the processor in a few milliseconds.

Anti-aliased discs, spheres and lines are painted by compiled loops: the same input gives the same bits. Pixels are
counted from the upper left corner, the middle of the first one at (0.5, 0.5). What is nearer than half a pixel to an
edge covers its pixel in part. In space depth grows toward the eye.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.calls.honors import ANY_LENGTH, honors
from packmech.check import brief, entries, finite_array, instance, integer
from packmech.contacts import Contacts
from packmech.contacts.shape_contacts import ShapeContacts, touching_pairs
from packmech.effects import acts, bonds_of
from packmech.jit.compiled import device, kernel
from packmech.packing import Packing
from packmech.scene import Scene
from packmech.view import drawing

# the largest side of a picture [pixel]
LARGEST = 8192
# the cell's sides, and its bounding box, over the picture's: the cell keeps its size while it is sheared by less
ROOM, MINIMUM_ROOM = 1.24, 1.05
# in space: how bright the back is over the front
BACK = 0.42
OUTLINE_DIM = 0.75
# bonds stretched by no more than this, on the mean, are slack to rounding; gaps and overlaps up to this touch [1]
SLACK, TOUCH = 1e-12, 1e-12


@honors("links shapes", packing_only=True, link_tolerance=ANY_LENGTH)
def draw_frame(
    packing: Packing,
    *,
    contacts: Contacts | ShapeContacts | None = None,
    force_c: ArrayLike | None = None,
    sliding_c: ArrayLike | None = None,
    effects: tuple[Any, ...] = (),
    rattler_n: ArrayLike | None = None,
    beads: float = 1.0,
    size: tuple[int, int] = (480, 480),
) -> NDArray[np.uint8]:
    """Return a picture of a packing as (height, width, 3) bytes.

    Particles are shaded by size, bonded and linked clusters in hues of their own, rattlers in amber; contacts are lines
    as wide and bright as their forces, blue where they slide; bonds, which are no contacts, and links are green in
    tension and violet in compression. Around the cell, in a plane, are its periodic copies, dimmed; a cell that was
    sheared far is drawn with its shortest lattice vectors. In space spheres are lit from above and darker at the back,
    and what is inside them is hidden unless `beads` makes them small. The same arguments give the same bytes.

    Parameters
    ----------
    packing
        The packing.
    contacts
        What touches, with images for positions as they are; found unless given.
    force_c
        (C,) forces of these contacts [force]; from `effects` unless given, and all alike without any.
    sliding_c
        (C,) True for contacts that slide.
    effects
        Those of the scene: for forces that are not given, bonds, and walls.
    rattler_n
        (N,) True for rattlers.
    beads
        Radius at which spheres are drawn over their own, in space only [1].
    size
        Width and height [pixel].

    Raises
    ------
    TypeError, ValueError
        Naming the argument that is wrong.

    Examples
    --------
    >>> import packmech as pm
    >>> crystal = pm.lattice_packing("triangular", repeats=(4, 4), relative_overlap=0.01)
    >>> pixels = draw_frame(crystal, effects=(pm.Repulsion(),), size=(120, 90))
    >>> pixels.shape, pixels.dtype
    ((90, 120, 3), dtype('uint8'))

    """
    instance("packing", packing, Packing)
    size = _size(size)
    effects = Scene(packing, effects).effects
    if not isinstance(beads, int | float) or isinstance(beads, bool) or not 0.0 < beads <= 1.0:
        raise ValueError(f"beads must lie above 0 and be at most 1, got {brief(beads)}")
    drawn = drawn_contacts(packing, effects, contacts, force_c, sliding_c)
    rattler = np.zeros(packing.particles, dtype=bool)
    if rattler_n is not None:
        rattler = _booleans("rattler_n", rattler_n, packing.particles)
    return _Picture(packing, size, float(beads)).draw(drawn, effects, rattler)


def _size(size: Any) -> tuple[int, int]:
    if not isinstance(size, tuple | list) or len(size) != 2:
        raise TypeError(f"size must be the width and the height in pixels, got {brief(size)}")
    width, height = (integer(f"size[{k}]", side, at_least=1, at_most=LARGEST) for k, side in enumerate(size))
    return width, height


def _booleans(name: str, value: ArrayLike, count: int) -> NDArray[np.bool_]:
    marks = entries(name, value, "b", "booleans")
    if marks.dtype != bool or marks.shape != (count,):
        raise ValueError(f"{name} must be {count} booleans, got {marks.dtype} of shape {marks.shape}")
    return marks


@dataclass(frozen=True, eq=False)
class DrawnContacts:
    """Contacts that are drawn, bonded pairs not among them; (C,) forces [force], and which of them slide."""

    contacts: Contacts | ShapeContacts
    force_c: NDArray[np.float64]
    sliding_c: NDArray[np.bool_]


def drawn_contacts(
    packing: Packing,
    effects: tuple[Any, ...],
    contacts: Contacts | ShapeContacts | None,
    force_c: ArrayLike | None,
    sliding_c: ArrayLike | None,
) -> DrawnContacts:
    """Return what touches, with forces and whether it slides, after checking what was given of it.

    Parameters
    ----------
    packing, effects
        The packing, and effects whose forces are taken where none are given.
    contacts, force_c, sliding_c
        As in `draw_frame`.

    Raises
    ------
    TypeError, ValueError
        Naming the argument that is wrong.

    """
    if contacts is None:
        if force_c is not None or sliding_c is not None:
            name = "force_c" if force_c is not None else "sliding_c"
            raise ValueError(f"{name} must come with the contacts that it belongs to, got no contacts")
        contacts = touching_pairs(packing, TOUCH)
    else:
        of_packing, finder = (
            (ShapeContacts, "find_shape_contacts") if packing.shapes.has_orientations else (Contacts, "find_contacts")
        )
        if not isinstance(contacts, of_packing) or contacts.particles != packing.particles:
            raise TypeError(f"contacts must be those of the packing (pm.{finder}), got {type(contacts).__name__}")
    sliding = np.zeros(len(contacts), dtype=bool)
    if sliding_c is not None:
        sliding = _booleans("sliding_c", sliding_c, len(contacts))
    if force_c is not None and len(contacts):
        force = np.abs(finite_array("force_c", force_c, shape=(len(contacts),), what="contact"))
    else:
        force = contact_forces(contacts, effects)
    acting = acts(contacts, effects)
    return DrawnContacts(contacts.select(acting), force[acting], sliding[acting])


def contact_forces(contacts: Contacts | ShapeContacts, effects: tuple[Any, ...]) -> NDArray[np.float64]:
    """Return the (C,) magnitudes of the forces that effects with an energy exert; 1 without any.

    They are 1 too where nothing overlaps by more than rounding, as in lattices that just touch.
    """
    acting = tuple(one for one in effects if hasattr(type(one), "pair_energy"))
    if not acting or not len(contacts) or contacts.overlap_c.max() <= TOUCH:
        return np.ones(len(contacts))
    force = drawing.force_magnitudes(contacts, acting)
    # centers that coincide under a law that diverges there: as strong as the strongest that is a number
    finite = np.isfinite(force) & (force < 1e150)
    force[~finite] = force[finite].max(initial=1.0)
    return force


@dataclass(frozen=True, eq=False)
class _Lines:
    """Lines to draw: (S, 2, d) ends and (S,) half widths [length], (S, 3) colors."""

    end_sed: NDArray[np.float64]
    half_width_s: NDArray[np.float64]
    color_sc: NDArray[np.float64]


class _Picture:
    """A packing put before the eye: where it is on the picture, and what is drawn of it."""

    def __init__(self, packing: Packing, size: tuple[int, int], beads: float) -> None:
        self.packing, self.size, self.beads = packing, size, beads
        self.cell = drawing.ShownCell(packing)
        self.flat = packing.dimension == 2
        corner = np.concatenate(drawing.box_outline(self.cell.box))
        self.axes_ds = np.eye(2) if self.flat else drawing.view_axes()
        seen = corner @ self.axes_ds[:, :2]
        low, high = seen.min(axis=0), seen.max(axis=0)
        extent = high - low
        room = MINIMUM_ROOM * extent
        if self.flat:  # the sides that a rectangle of the same volume would have keep the scale under shear
            room = np.maximum(room, ROOM * self.cell.box.volume / extent[::-1])
        else:
            room = room + 2.0 * beads * packing.shapes.reach(packing.radius_n).max()
        self.scale = float((np.array(size) / room).min())
        self.middle_s = 0.5 * (low + high)

    def place(self, position: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return pixels across and down, and in space the depth, of positions (..., d)."""
        seen = position @ self.axes_ds
        placed = np.empty_like(seen)
        width, height = self.size
        placed[..., 0] = 0.5 * width + self.scale * (seen[..., 0] - self.middle_s[0])
        placed[..., 1] = 0.5 * height - self.scale * (seen[..., 1] - self.middle_s[1])
        placed[..., 2:] = self.scale * seen[..., 2:]
        return placed

    def draw(self, drawn: DrawnContacts, effects: tuple[Any, ...], rattler_n: NDArray[np.bool_]) -> NDArray[np.uint8]:
        """Return the picture."""
        image = blank(self.size, drawing.BACKGROUND)
        color_nc = drawing.particle_colors(self.packing, effects, rattler_n)
        lines = [self._edges(effects)]
        if self.flat or self.beads < 1.0:  # lines inside solid spheres are not seen
            links, bonds = self._links(drawn.contacts, effects), self._bonds(effects)
            lines = [*links, self._contacts(drawn), *bonds, *lines]
        if self.flat:
            self._paint_discs(image, color_nc)
            for one in lines:
                paint_lines(image, None, self.place(one.end_sed), self.scale * one.half_width_s, one.color_sc)
        else:
            self._paint_space(image, color_nc, lines)
        return finished(image)

    def _paint_discs(self, image: NDArray[np.float32], color_nc: NDArray[np.uint8]) -> None:
        largest = float(self.packing.shapes.reach(self.packing.radius_n).max())
        reach = 0.5 * np.array(self.size) + self.scale * largest
        shift_kd = np.array([one for one in np.ndindex(3, 3) if one != (1, 1)]) - 1.0
        around = self.cell.inside_nd + (shift_kd @ self.cell.box.lattice_dd.T)[:, None]
        seen = np.all(np.abs(self.place(around) - 0.5 * np.array(self.size)) < reach, axis=-1)
        every = np.arange(self.packing.particles)
        copies = around[seen], np.nonzero(seen)[1], drawing.dimmed(color_nc)
        # the cell itself comes last, over its copies
        for center, owner, color in (copies, (self.cell.inside_nd, every, color_nc)):
            sites = drawing.sites_of(self.packing, center, owner)
            color = color[sites.owner_b].astype(np.float64)
            place, along, down = self.place(sites.place_bd), self.scale * sites.along_b, np.array([1.0, -1.0])
            if sites.corner_bks is not None:
                paint_outlines(image, place, along, self.scale * down * sites.corner_bks, color)
            elif sites.round:
                paint_discs(image, place, along, color)
            else:
                paint_ellipses(image, place, along, self.scale * sites.across_b, down * sites.axis_bd, color)

    def _paint_space(self, image: NDArray[np.float32], color_nc: NDArray[np.uint8], lines: list[_Lines]) -> None:
        corner = self.place(np.concatenate(drawing.box_outline(self.cell.box)))[:, 2]
        low, span = float(corner.min()), float(np.ptp(corner))

        def lit(color: Any, depth: NDArray[np.float64]) -> NDArray[np.float64]:
            share = BACK + (1.0 - BACK) * np.clip((depth - low) / span, 0.0, 1.0)
            ground = np.array(drawing.BACKGROUND)
            return np.asarray(ground + share[:, None] * (np.asarray(color, dtype=np.float64) - ground))

        depth = np.full(image.shape[:2], -np.inf)
        sites = drawing.sites_of(self.packing, self.cell.inside_nd)
        # bodies are made smaller as wholes
        middle_bd = self.cell.inside_nd[sites.owner_b]
        place = self.place(middle_bd + self.beads * (sites.place_bd - middle_bd))
        order = np.argsort(place[:, 2], kind="stable")
        along, across = (self.beads * self.scale * one[order] for one in (sites.along_b, sites.across_b))
        place, color = place[order], lit(color_nc[sites.owner_b[order]], place[order, 2])
        if sites.round:
            paint_spheres(image, depth, place, along, color)
        else:
            paint_spheroids(image, depth, place, along, across, (sites.axis_bd @ self.axes_ds)[order], color)
        end = self.place(np.concatenate([one.end_sed for one in lines]))
        middle = end[:, :, 2].mean(axis=1)
        color = lit(np.concatenate([one.color_sc for one in lines]), middle)
        width = self.scale * np.concatenate([one.half_width_s for one in lines])
        order = np.argsort(middle, kind="stable")
        paint_lines(image, depth, end[order], width[order], color[order])

    def _contacts(self, drawn: DrawnContacts) -> _Lines:
        contacts, sliding_c = drawn.contacts, drawn.sliding_c
        mean = float(drawn.force_c.mean()) if len(drawn.force_c) else 0.0
        force_c = drawn.force_c / mean if mean > 0.0 else np.zeros(len(drawn.force_c))
        end, pair_s, _ = self.cell.lines(contacts.i_c, contacts.j_c, contacts.image_cd)
        # strong forces lie over weak ones
        order = np.argsort(force_c[pair_s], kind="stable")
        end, pair_s = end[order], pair_s[order]
        color = drawing.force_colors(force_c[pair_s]).astype(np.float64)
        color[sliding_c[pair_s]] = drawing.SLIDING
        unit, d = self.packing.reference_diameter, self.packing.dimension
        return _Lines(end, drawing.force_radii(force_c[pair_s], unit, d), color)

    def _bonds(self, effects: tuple[Any, ...]) -> list[_Lines]:
        bonds = bonds_of(effects)
        if bonds is None:
            return []
        end, pair_s, _ = self.cell.lines(bonds.i_b, bonds.j_b, bonds.image_bd)
        extension = np.linalg.norm(end[:, 1] - end[:, 0], axis=1) / bonds.rest_length_b[pair_s] - 1.0
        mean = float(np.abs(extension).mean())
        pull = extension / mean if mean > SLACK else np.zeros(len(pair_s))
        width = np.full(len(pair_s), drawing.BOND_WIDTH * self.packing.reference_diameter)
        return [_Lines(end, width, drawing.tension_colors(pull, shape=False).astype(np.float64))]

    def _links(self, contacts: Any, effects: tuple[Any, ...]) -> list[_Lines]:
        links = self.packing.links
        tension_l = drawing.relative_tension(self.packing, contacts, effects)
        unit, d = self.packing.reference_diameter, self.packing.dimension
        found = []
        for shape in (True, False):
            mine = np.flatnonzero(links.shape_l == shape)
            end, pair_s, _ = self.cell.lines(links.i_l[mine], links.j_l[mine], links.image_ld[mine])
            tension = tension_l[mine][pair_s]
            width = drawing.tension_radii(tension, unit, d, shape=shape)
            found.append(_Lines(end, width, drawing.tension_colors(tension, shape=shape).astype(np.float64)))
        return found

    def _edges(self, effects: tuple[Any, ...]) -> _Lines:
        """Return the cell's edges and the walls."""
        unit = self.packing.reference_diameter
        parts = [(drawing.box_outline(self.cell.box), drawing.OUTLINE_RADIUS, OUTLINE_DIM, drawing.OUTLINE)]
        parts.append((drawing.wall_outlines(effects, self.cell.box), drawing.WALL_WIDTH, 1.0, drawing.WALL))
        ends, widths, colors = [], [], []
        for lines, width, dim, color in parts:
            for line in lines:
                pieces = np.stack([line[:-1], line[1:]], axis=1)
                ends.append(pieces)
                widths.append(np.full(len(pieces), width * unit))
                colors.append(np.tile(dim * np.array(color, dtype=np.float64), (len(pieces), 1)))
        return _Lines(np.concatenate(ends), np.concatenate(widths), np.concatenate(colors))


# a disc's rim over its middle [1]; the width of the dark line at its rim, and its color over the disc's
RIM, EDGE, EDGE_SHADE = 0.72, 0.9, 0.45
# where light comes from in space (across, up, toward the eye), what is lit from everywhere, and the highlight
LIGHT = (-0.42, 0.52, 0.744)
AMBIENT, DIFFUSE, HIGHLIGHT = 0.30, 0.72, 38.0
# lines narrower than this half width are paler instead [pixel]
THIN = 0.5


def blank(size: tuple[int, int], color: tuple[int, int, int]) -> NDArray[np.float32]:
    """Return an image (height, width, 3) of one color; size is (width, height)."""
    width, height = size
    image = np.empty((height, width, 3), dtype=np.float32)
    _fill(image, *(float(part) for part in color))
    return image


def finished(image: NDArray[np.float32]) -> NDArray[np.uint8]:
    """Return the image as bytes."""
    done = np.empty(image.shape, dtype=np.uint8)
    _finish(image, done)
    return done


@kernel
def _fill(image, red, green, blue):
    for y in range(image.shape[0]):
        for x in range(image.shape[1]):
            image[y, x, 0], image[y, x, 1], image[y, x, 2] = red, green, blue


@kernel
def _finish(image, done):
    for y in range(image.shape[0]):
        for x in range(image.shape[1]):
            for c in range(3):
                done[y, x, c] = np.uint8(min(np.float32(255.0), max(np.float32(0.0), image[y, x, c])) + np.float32(0.5))


@device
def _blend(image, y, x, share, red, green, blue):
    image[y, x, 0] += share * (red - image[y, x, 0])
    image[y, x, 1] += share * (green - image[y, x, 1])
    image[y, x, 2] += share * (blue - image[y, x, 2])


@device
def _covered(place, reach, count):
    """Return the first pixel that an interval can touch, and that after its last one."""
    first = int(np.floor(max(0.0, min(float(count), place - reach - 1.0))))
    last = int(np.ceil(max(0.0, min(float(count), place + reach + 1.0))))
    return first, last


@kernel
def paint_discs(image, center_kd, radius_k, color_kc):
    """Paint discs one over the other, a little darker toward the rim."""
    height, width = image.shape[0], image.shape[1]
    for k in range(radius_k.shape[0]):
        cx, cy, r = center_kd[k, 0], center_kd[k, 1], radius_k[k]
        y0, y1 = _covered(cy, r, height)
        red, green, blue = color_kc[k, 0], color_kc[k, 1], color_kc[k, 2]
        slope = (1.0 - RIM) / (r * r)
        for y in range(y0, y1):
            dy = y + 0.5 - cy
            x0, x1 = _covered(cx, np.sqrt(max(0.0, (r + 0.5) * (r + 0.5) - dy * dy)) - 0.5, width)
            for x in range(x0, x1):
                dx = x + 0.5 - cx
                square = dx * dx + dy * dy
                if square >= (r + 0.5) * (r + 0.5):
                    continue
                shade, cover = 1.0 - slope * square, 1.0
                if square > max(r - EDGE - 0.5, 0.0) ** 2:
                    distance = np.sqrt(square)
                    cover = min(1.0, r + 0.5 - distance)
                    line = min(1.0, max(0.0, distance - (r - EDGE) + 0.5))
                    shade *= 1.0 - (1.0 - EDGE_SHADE) * line
                _blend(image, y, x, cover, shade * red, shade * green, shade * blue)


@device
def _paint_rimmed(image, y, x, part, outside, red, green, blue):
    """Paint a pixel of a particle, a part of the way from its center to its outline, and so far outside of this."""
    line = min(1.0, max(0.0, outside + EDGE + 0.5))
    shade = (1.0 - (1.0 - RIM) * part * part) * (1.0 - (1.0 - EDGE_SHADE) * line)
    _blend(image, y, x, min(1.0, 0.5 - outside), shade * red, shade * green, shade * blue)


@kernel
def paint_ellipses(image, center_kd, along_k, across_k, axis_kd, color_kc):
    """Paint ellipses one over the other, as discs are painted; the axis is the unit vector along `along_k`."""
    height, width = image.shape[0], image.shape[1]
    for k in range(along_k.shape[0]):
        cx, cy, a, b, ux, uy = center_kd[k, 0], center_kd[k, 1], along_k[k], across_k[k], axis_kd[k, 0], axis_kd[k, 1]
        y0, y1 = _covered(cy, np.sqrt(a * a * uy * uy + b * b * ux * ux), height)
        x0, x1 = _covered(cx, np.sqrt(a * a * ux * ux + b * b * uy * uy), width)
        red, green, blue = color_kc[k, 0], color_kc[k, 1], color_kc[k, 2]
        for y in range(y0, y1):
            dy = y + 0.5 - cy
            for x in range(x0, x1):
                dx = x + 0.5 - cx
                p, q = (ux * dx + uy * dy) / a, (ux * dy - uy * dx) / b
                part = np.sqrt(p * p + q * q)
                # how far outside, to first order
                slope = np.sqrt((p / a) ** 2 + (q / b) ** 2) / max(part, 1e-12)
                outside = (part - 1.0) / max(slope, 1e-12)
                if outside < 0.5:
                    _paint_rimmed(image, y, x, part, outside, red, green, blue)


@kernel
def paint_outlines(image, center_kd, reach_k, corner_kcd, color_kc):
    """Paint convex outlines one over the other, as discs are painted.

    Corners c, about the centers, are where the outward normal is at the angle 2 pi c / (C - 1) to the first axis; the
    last is the first again.
    """
    height, width, corners = image.shape[0], image.shape[1], corner_kcd.shape[1] - 1
    angle_c = 2.0 * np.pi * np.arange(corners) / corners
    # pixels go down
    across_c, down_c, support_c = np.cos(angle_c), -np.sin(angle_c), np.empty(corners)
    for k in range(center_kd.shape[0]):
        for c in range(corners):
            support_c[c] = across_c[c] * corner_kcd[k, c, 0] + down_c[c] * corner_kcd[k, c, 1]
        cx, cy = center_kd[k, 0], center_kd[k, 1]
        y0, y1 = _covered(cy, reach_k[k], height)
        x0, x1 = _covered(cx, reach_k[k], width)
        red, green, blue = color_kc[k, 0], color_kc[k, 1], color_kc[k, 2]
        for y in range(y0, y1):
            dy = y + 0.5 - cy
            for x in range(x0, x1):
                dx = x + 0.5 - cx
                # the tangent over which the pixel is farthest, over the center's distance from it
                part, outside = 0.0, -np.inf
                for c in range(corners):
                    away = across_c[c] * dx + down_c[c] * dy
                    part, outside = max(part, away / support_c[c]), max(outside, away - support_c[c])
                    if outside >= 0.5:
                        break
                if outside < 0.5:
                    _paint_rimmed(image, y, x, part, outside, red, green, blue)


@kernel
def paint_lines(image, depth, end_sed, half_width_s, color_sc):
    """Paint lines with round ends one over the other; with a depth as rods in space, hidden by what is before them."""
    height, width = image.shape[0], image.shape[1]
    for s in range(half_width_s.shape[0]):
        ax, ay = end_sed[s, 0, 0], end_sed[s, 0, 1]
        lx, ly = end_sed[s, 1, 0] - ax, end_sed[s, 1, 1] - ay
        square = lx * lx + ly * ly
        half = max(half_width_s[s], THIN)
        strength = min(1.0, half_width_s[s] / THIN)
        x0, x1 = _covered(ax + 0.5 * lx, 0.5 * abs(lx) + half, width)
        y0, y1 = _covered(ay + 0.5 * ly, 0.5 * abs(ly) + half, height)
        for y in range(y0, y1):
            py = y + 0.5 - ay
            for x in range(x0, x1):
                px = x + 0.5 - ax
                along = 0.0
                if square > 0.0:
                    along = min(1.0, max(0.0, (px * lx + py * ly) / square))
                dx, dy = px - along * lx, py - along * ly
                away = dx * dx + dy * dy
                if away >= (half + 0.5) * (half + 0.5):
                    continue
                cover = strength * min(1.0, half + 0.5 - np.sqrt(away))
                if depth is None:
                    _blend(image, y, x, cover, color_sc[s, 0], color_sc[s, 1], color_sc[s, 2])
                else:
                    toward = np.sqrt(1.0 - away / ((half + 0.5) * (half + 0.5)))
                    here = end_sed[s, 0, 2] + along * (end_sed[s, 1, 2] - end_sed[s, 0, 2]) + half * toward
                    if here <= depth[y, x]:
                        continue
                    shade = 0.5 + 0.5 * toward if half > 1.0 else 1.0
                    _blend(image, y, x, cover, shade * color_sc[s, 0], shade * color_sc[s, 1], shade * color_sc[s, 2])
                    if cover >= 0.5:
                        depth[y, x] = here


@kernel
def paint_spheres(image, depth, center_kd, radius_k, color_kc):
    """Paint spheres in the order given, from the back to the front, and keep the depth of what is seen."""
    height, width = image.shape[0], image.shape[1]
    for k in range(radius_k.shape[0]):
        cx, cy, cz, r = center_kd[k, 0], center_kd[k, 1], center_kd[k, 2], radius_k[k]
        y0, y1 = _covered(cy, r, height)
        red, green, blue = color_kc[k, 0], color_kc[k, 1], color_kc[k, 2]
        over = 1.0 / r
        for y in range(y0, y1):
            dy = y + 0.5 - cy
            x0, x1 = _covered(cx, np.sqrt(max(0.0, (r + 0.5) * (r + 0.5) - dy * dy)) - 0.5, width)
            for x in range(x0, x1):
                dx = x + 0.5 - cx
                square = dx * dx + dy * dy
                if square >= (r + 0.5) * (r + 0.5):
                    continue
                rise = np.sqrt(max(0.0, r * r - square))
                if cz + rise <= depth[y, x]:
                    continue
                cover = 1.0
                if square > max(r - 0.5, 0.0) ** 2:
                    cover = min(1.0, r + 0.5 - np.sqrt(square))
                lit = (LIGHT[0] * dx - LIGHT[1] * dy + LIGHT[2] * rise) * over
                toward = rise * over
                # the highlight of a light near the eye: a power of the normal's part along the half vector
                gloss = max(0.0, -0.225 * dx * over + 0.278 * -dy * over + 0.934 * toward)
                gloss = HIGHLIGHT * gloss**24
                shade = AMBIENT + 0.12 * toward + (DIFFUSE - 0.12) * max(0.0, lit)
                _blend(image, y, x, cover, shade * red + gloss, shade * green + gloss, shade * blue + gloss)
                if cover >= 0.5:
                    depth[y, x] = cz + rise


@kernel
def paint_spheroids(image, depth, center_kd, along_k, across_k, axis_kd, color_kc):
    """Paint spheroids in the order given, lit as spheres are, and keep the depth of what is seen.

    A place x from the center is on the surface where x M x = 1, with M = 1 / b^2 + (1 / a^2 - 1 / b^2) u u^T.
    """
    height, width = image.shape[0], image.shape[1]
    for k in range(along_k.shape[0]):
        cx, cy, cz, a, b = center_kd[k, 0], center_kd[k, 1], center_kd[k, 2], along_k[k], across_k[k]
        ux, uy, uz = axis_kd[k, 0], axis_kd[k, 1], axis_kd[k, 2]
        more = 1.0 / (a * a) - 1.0 / (b * b)
        x0, x1 = _covered(cx, np.sqrt(b * b + (a * a - b * b) * ux * ux), width)
        y0, y1 = _covered(cy, np.sqrt(b * b + (a * a - b * b) * uy * uy), height)
        red, green, blue = color_kc[k, 0], color_kc[k, 1], color_kc[k, 2]
        mzz = 1.0 / (b * b) + more * uz * uz
        for y in range(y0, y1):
            # pixels go down
            dy = cy - (y + 0.5)
            for x in range(x0, x1):
                dx = x + 0.5 - cx
                flat = ux * dx + uy * dy
                half = more * uz * flat
                inside = half * half - mzz * ((dx * dx + dy * dy) / (b * b) + more * flat * flat - 1.0)
                # pixels within the outline, about
                cover = min(1.0, 0.5 + 0.5 * min(a, b) * inside / mzz)
                if cover <= 0.0:
                    continue
                rise = (np.sqrt(max(0.0, inside)) - half) / mzz
                if cz + rise <= depth[y, x]:
                    continue
                along = more * (flat + uz * rise)
                nx, ny, nz = dx / (b * b) + along * ux, dy / (b * b) + along * uy, rise / (b * b) + along * uz
                over = 1.0 / np.sqrt(nx * nx + ny * ny + nz * nz)
                nx, ny, nz = nx * over, ny * over, nz * over
                gloss = HIGHLIGHT * max(0.0, -0.225 * nx + 0.278 * ny + 0.934 * nz) ** 24
                lit = max(0.0, LIGHT[0] * nx + LIGHT[1] * ny + LIGHT[2] * nz)
                shade = AMBIENT + 0.12 * nz + (DIFFUSE - 0.12) * lit
                _blend(image, y, x, cover, shade * red + gloss, shade * green + gloss, shade * blue + gloss)
                if cover >= 0.5:
                    depth[y, x] = cz + rise
