# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Anti-aliased discs, spheres and lines on an array of pixels, by compiled loops: the same input gives the same bits.

Pixels are counted from the upper left corner, the middle of the first one at (0.5, 0.5). What is nearer than half a
pixel to an edge covers its pixel in part. In space depth grows toward the eye.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from packmech.jit.compiled import device, kernel

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
