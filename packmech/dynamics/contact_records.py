# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""The listed pairs one by one at the time of the force taken last: which touch, and what they do to each other."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.dynamics.by_shape import touch_of_rows, touches_of
from packmech.dynamics.contact_forces import laws_of, pull_of_touch, spring_of
from packmech.dynamics.friction import rolling_columns, sliding_columns
from packmech.effects import RollingResistance, RoughContacts, TwistingResistance, memory_columns
from packmech.jit.by_type import by_type
from packmech.jit.compiled import device, inlined, lean
from packmech.minimize.passes.pair_list import is_near, visit, walk_pairs


class ContactRecords(NamedTuple):
    """What is written of each listed pair.

    In how many places it touches and slides, the sum of the normal forces [force], the force on i (P, 3) [force], the
    vector between the centers (P, 3) [length], and the displacements of its tangential springs at this time, by the
    columns of the track; None without.
    """

    touching_p: NDArray[np.int64]
    sliding_p: NDArray[np.int64]
    normal_p: NDArray[np.float64]
    force_pd: NDArray[np.float64]
    branch_pd: NDArray[np.float64]
    stretch_pk: NDArray[np.float64] | None


@visit.form(ContactRecords)
@inlined
def _write_down(records, laws, pair, value):
    p, force_pd, branch_pd = pair.p, records.force_pd, records.branch_pd
    branch_pd[p, 0], branch_pd[p, 1], branch_pd[p, 2] = pair.dx, pair.dy, pair.dz
    if is_near(laws, pair):
        for k in range(touches_of(laws.shapes, pair.i, pair.j)):
            touch = touch_of_rows(laws.shapes, laws.axes, laws.body, pair, k)
            if touch.touching:
                pull = pull_of_touch(laws, pair, k, touch)
                records.touching_p[p] += 1
                records.sliding_p[p] += int(pull.across.sliding)
                records.normal_p[p] += pull.normal
                force_pd[p, 0] += pull.fx
                force_pd[p, 1] += pull.fy
                force_pd[p, 2] += pull.fz
                write_springs(laws.friction, laws.axes, records.stretch_pk, p, spring_of(laws, pair, k).k, pull)
    return value


@device
def _write_stretch(axes, stretch_pk, p, k, across):
    if stretch_pk is not None:
        stretch_pk[p, k] = across.x
        if len(axes) == 3:
            stretch_pk[p, k + 1] = across.y
            stretch_pk[p, k + 2] = across.z


@inlined
def _write_sliding(friction, axes, stretch_pk, p, k, pull):
    _write_stretch(axes, stretch_pk, p, k, pull.across)


@inlined
def _write_no_stretch(friction, axes, stretch_pk, p, k, pull):
    return None


@inlined
def _write_rough(rough, axes, stretch_pk, p, k, pull):
    _write_stretch(axes, stretch_pk, p, k, pull.across)
    k += len(sliding_columns(rough.friction, axes))
    _write_turning(rough.rolling, pull.turning.rolling, axes, stretch_pk, p, k)
    k += len(rolling_columns(rough.rolling, axes))
    _write_turning(rough.twisting, pull.turning.twisting, (0, 1), stretch_pk, p, k)


@inlined
def _write_nothing(resistance, across, axes, stretch_pk, p, k):
    return None


@inlined
def _write_across(resistance, across, axes, stretch_pk, p, k):
    _write_stretch(axes, stretch_pk, p, k, across)


# of what has a spring
_write_turning = by_type(_write_nothing, {RollingResistance: _write_across, TwistingResistance: _write_across})
# writes the displacements of the springs of a contact, from what its pull says of them, from a first column on
write_springs = by_type(_write_sliding, {RoughContacts: _write_rough, type(None): _write_no_stretch})


@lean
def _walk(laws, pairs, records):
    for b in range(pairs.row_b.shape[0] - 1):
        walk_pairs(records, laws, pairs, b, 0)


def record_contacts(system: Any, now: Any) -> ContactRecords:
    """Return what the inner pairs of a system do to each other; `now` is a `Now`."""
    count = int(system.pairs.start_s[-1])
    whole, number = np.zeros((2, count), dtype=np.int64), np.zeros((count, 3))
    stretch = None if system.track is None else np.zeros_like(system.track.inner_pk)
    records = ContactRecords(whole[0], whole[1], np.zeros(count), number, np.zeros((count, 3)), stretch)
    if system.acting.pairs is not None:
        _walk(laws_of(system, now), system.pairs, records)
    memory = memory_columns(system.acting.pairs or ())
    if stretch is not None and memory:
        # of this time, where springs are ahead of it
        stretch[:count, -memory:] = system.track.inner_pk[:count, -memory:]
    return records
