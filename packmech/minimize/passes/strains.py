# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""Strains of the box inside compiled loops: applied from outside, or free to relax with the positions.

Free strains are chosen by type: None where the box stays as it is, which costs nothing, or `FreeStrains`. A strain
moves every particle with it; its coordinate is the strain times sqrt(N) mean diameters, which makes it about as stiff
as a particle. Directors of shapes are not strained.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.constraints.compiled_links import add_tensions
from packmech.contacts.cells import lattice_volume, set_frame
from packmech.jit.by_type import by_type
from packmech.jit.compiled import device
from packmech.minimize.passes.interaction_rows import survey_interactions
from packmech.minimize.passes.kernels import CONVERGED, NOT_FINITE, RUNNING, Sums, Virial, judge
from packmech.minimize.passes.pair_list import (
    BENT,
    BEYOND,
    BUDGET,
    DISPLACED,
    SKIN_INNER,
    SKIN_OUTER,
    largest_contact,
    place_images,
)
from packmech.minimize.passes.shape_rows import shapes_of

# places in FreeStrains.number_k
RESIDUAL, STRESS_ERROR, PRESSURE, NUMBERS = range(4)


class FreeStrains(NamedTuple):
    """Free strains of the box, the load that is held, and how things stand.

    Attributes
    ----------
    basis_kdd
        (k, 3, 3) orthonormal strains.
    load_dd
        (3, 3) compression that is held, over its pressure.
    pressure
        Pressure that is held [energy/length^d]; of no meaning where the volume is.
    volume
        Volume that is held; 0 where the pressure is.
    scale
        Length that a unit strain counts as.
    since_dd
        (3, 3) map that took the rows, but not yet the anchors of lists, with the box.
    rate_dd, pull_dd
        (3, 3) rate of strain times that length, and minus the slope of the enthalpy over it.
    number_k
        Net force over mean contact force, missing stress over pressure, and the pressure, after the last pass.
    virial
        What a pass over the forces adds up; zero between passes.
    stiffness_n
        (R,) sums of contact stiffnesses that bonds and interactions add up beside the virial; not used here.

    """

    basis_kdd: NDArray[np.float64]
    load_dd: NDArray[np.float64]
    pressure: float
    volume: float
    scale: float
    since_dd: NDArray[np.float64]
    rate_dd: NDArray[np.float64]
    pull_dd: NDArray[np.float64]
    number_k: NDArray[np.float64]
    virial: Virial
    stiffness_n: NDArray[np.float64]


# what takes the virial of a pass over the forces, where strains are free
virial_of = by_type(lambda strains: None, {FreeStrains: lambda strains: strains.virial})


@device
def strain_space(axes, row, space, pairs, map_dd):
    """Strain the box of rows that were strained already. Outer pairs are kept as far as they are complete."""
    _strain_outer(axes, space, pairs, map_dd)
    map_rows(axes, pairs.outer_anchor_nd, pairs.outer_anchor_nd.shape[0], map_dd)
    set_resolution(axes, row, space)
    pairs.number[DISPLACED] = np.inf


@device
def times(left_dd, right_dd):
    """Return the product of two (3, 3) matrices."""
    product = np.zeros((3, 3))
    for a in range(3):
        for b in range(3):
            for k in range(3):
                product[a, b] += left_dd[a, k] * right_dd[k, b]
    return product


@device
def _strain_outer(axes, space, pairs, map_dd):
    """Strain the box and what the outer list reaches; return the norm of the strain: no distance shrinks by more."""
    d = len(axes)
    set_frame(space.frame, times(map_dd, space.frame.lattice_dd))
    strain2 = 0.0
    for a in range(d):
        for b in range(d):
            strain2 += (map_dd[a, b] - (1.0 if a == b else 0.0)) ** 2
    shrink = max(0.0, 1.0 - math.sqrt(strain2))
    widest = 0.0
    for a in range(space.sizes.largest_a.shape[0]):
        widest = max(widest, space.sizes.largest_a[a])
    pairs.number[SKIN_OUTER] = shrink * pairs.number[SKIN_OUTER] - (1.0 - shrink) * 4.0 * widest
    return math.sqrt(strain2)


@device
def _strain_lists(axes, space, pairs, map_dd):
    """Strain the box of rows that were strained already, and both lists but for their anchors, as a small step does."""
    strain, number = _strain_outer(axes, space, pairs, map_dd), pairs.number
    place_images(space.frame, pairs)
    # displacements are strained, too: twice as much as unlisted pairs may come nearer by
    taken = strain * (largest_contact(space.sizes) + number[BEYOND] + number[SKIN_INNER])
    number[BENT] += taken
    number[BUDGET] -= taken


@device
def map_rows(axes, row, count, map_dd):
    """Map the positions in the first rows."""
    d = len(axes)
    moved = np.empty(3)
    for i in range(count):
        for a in range(d):
            moved[a] = 0.0
            for b in range(d):
                moved[a] += map_dd[a, b] * row[i, b]
        for a in range(d):
            row[i, a] = moved[a]


@device
def set_resolution(axes, row, space):
    """Set the rounding of the positions as they are."""
    frame = space.frame
    largest = 0.0
    for i in range(row.shape[0]):
        for a in range(len(axes)):
            largest = max(largest, abs(row[i, a]))
    for a in range(len(axes)):
        for b in range(len(axes)):
            largest = max(largest, abs(frame.lattice_dd[a, b]))
    space.resolution[0] = 2.220446049250313e-16 * largest


@device
def pull_box(strains, effects, axes, row, space, pairs, sums):
    """Take the forces along free strains from the virial of the last pass; return the sums with theirs among them."""
    if strains is None:
        return sums
    d, number, virial = len(axes), strains.number_k, strains.virial.sum_dd
    survey_interactions(shapes_of(effects), effects, row, pairs, virial, strains.stiffness_n)
    virial[1, 0], virial[2, 0], virial[2, 1] = virial[0, 1], virial[0, 2], virial[1, 2]
    add_tensions(space.links, axes, virial)
    volume = lattice_volume(space.frame.lattice_dd)
    pressure = 0.0
    for a in range(d):
        pressure -= virial[a, a] / (volume * d)
    held = pressure if strains.volume > 0.0 else strains.pressure
    missing = 0.0
    strains.pull_dd[:] = 0.0
    for k in range(strains.basis_kdd.shape[0]):
        stress = 0.0
        for a in range(d):
            for b in range(d):
                stress += strains.basis_kdd[k, a, b] * (virial[a, b] / volume + held * strains.load_dd[a, b])
        missing = max(missing, abs(stress))
        for a in range(d):
            for b in range(d):
                strains.pull_dd[a, b] -= volume * stress / strains.scale * strains.basis_kdd[k, a, b]
    virial[:] = 0.0
    number[PRESSURE] = pressure
    number[STRESS_ERROR] = missing / held if held > 0.0 else 0.0
    if sums.total > 0.0:
        number[RESIDUAL] = math.sqrt(sums.largest) * sums.touching / sums.total
    else:
        number[RESIDUAL] = 0.0 if strains.volume > 0.0 else np.inf
    power, square, largest = sums.power, sums.square, sums.largest
    for a in range(d):
        for b in range(d):
            pull = strains.pull_dd[a, b]
            power += pull * strains.rate_dd[a, b]
            square += pull * pull
            largest = max(largest, pull * pull)
    return Sums(sums.total, sums.touching, power, square, largest)


@device
def judge_all(strains, sums, stiffness, space, goal):
    """Return how things stand after a pass over the forces: with free strains by the stress, too, and no floors."""
    if strains is None:
        return judge(sums, stiffness, space, goal)
    if not (sums.total < np.inf and sums.largest < np.inf):
        return NOT_FINITE
    error = max(strains.number_k[RESIDUAL], strains.number_k[STRESS_ERROR])
    return CONVERGED if error <= goal.force_tolerance else RUNNING


@device
def move_box(strains, axes, row, space, pairs, keep, push, dt):
    """Set the rates of free strains to keep times themselves plus push times their forces, and strain the box so."""
    if strains is None:
        return
    d, rate = len(axes), strains.rate_dd
    map_dd = np.eye(3)
    for a in range(d):
        for b in range(d):
            rate[a, b] = keep * rate[a, b] + push * strains.pull_dd[a, b]
            map_dd[a, b] += dt * rate[a, b] / strains.scale
    if strains.volume > 0.0:
        volume = lattice_volume(map_dd) * lattice_volume(space.frame.lattice_dd)
        factor = (strains.volume / volume) ** (1.0 / d)
        for a in range(d):
            for b in range(d):
                map_dd[a, b] *= factor
    map_rows(axes, row, pairs.anchor_nd.shape[0], map_dd)
    _strain_lists(axes, space, pairs, map_dd)
    strains.since_dd[:] = times(map_dd, strains.since_dd)


@device
def bring_anchors(strains, axes, pairs):
    """Strain the anchors of both lists as the rows were, before anyone looks how far these are from them."""
    if strains is None:
        return
    for anchor_nd in (pairs.anchor_nd, pairs.outer_anchor_nd):
        map_rows(axes, anchor_nd, anchor_nd.shape[0], strains.since_dd)
    strains.since_dd[:] = np.eye(3)


@device
def with_rates(strains, square, largest):
    """Return the sum and the largest of the squared speeds, with the rates of free strains among them."""
    if strains is None:
        return square, largest
    for a in range(3):
        for b in range(3):
            own = strains.rate_dd[a, b] ** 2
            square += own
            largest = max(largest, own)
    return square, largest
