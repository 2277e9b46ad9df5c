"""Recordings of motions played to finite amplitude: contacts that stay, open and close, the box, and the way taken."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from packmech.check import instance, integer
from packmech.contacts import Contacts, find_contacts
from packmech.contacts.network import pair_contacts
from packmech.jamming.play import PlayedMotion, pairs_of
from packmech.packing import Packing
from packmech.view import drawing
from packmech.view.recording.stream import Views, World, check_arguments, opened, page, plots, world_view
from packmech.view.trajectory import Curve, Snapshot, Trajectory

# contacts that touch as at the start, those that have opened (by WIDE contact distances or more), those that have
# closed on the way
STAYED, JUST_OPEN, OPENED, CLOSED = (255, 236, 170), (244, 170, 104), (226, 70, 70), (110, 226, 150)
WIDE = 0.2
# half widths of their lines [reference diameter]
STAYED_WIDTH, OPENED_WIDTH = 0.024, 0.014
TRAIL, TRAIL_WIDTH = (170, 196, 226), 0.015
GHOST = (78, 88, 104)
# contacts that have opened wider than this are not drawn any more [1]
FAR = 0.6
ARROW, ARROW_LENGTH, ARROW_WIDTH = (84, 222, 232), 0.6, 0.035


def record_motion(
    played: PlayedMotion,
    path: str | Path,
    *,
    frames: int = 60,
    parameters: Mapping[str, Any] | None = None,
    results: Mapping[str, Any] | None = None,
) -> Path:
    """Write a played motion as a Rerun recording and return the absolute path.

    Contacts that still touch are pale lines, those that have opened thin ones from orange to red, and those that closed
    on the way green. Thin lines lead back to where the particles were; arrows show where they are going. The box at the
    start stays in dark gray.

    Parameters
    ----------
    played
        What `pm.play_motion` returned.
    path
        Where to write, usually `name.rrd`.
    frames
        Largest number of packings to draw, evenly chosen, first and last included.
    parameters, results
        How the packing was made and what was found, by name; kept as the recording's properties.

    Raises
    ------
    TypeError, ValueError
        For arguments of another kind.
    OSError
        When the file cannot be written.

    Examples
    --------
    >>> import tempfile, packmech as pm
    >>> kagome = pm.lattice_packing("kagome", repeats=(2, 2))
    >>> played = pm.play_motion(kagome, pm.classify_jamming(kagome).unjamming_motion, steps=5)
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     written = record_motion(played, folder + "/kagome.rrd")
    ...     written.stat().st_size > 1000
    True

    """
    instance("played", played, PlayedMotion)
    frames = integer("frames", frames, at_least=2)
    check_arguments(path, parameters, results)
    chosen = np.unique(np.rint(np.linspace(0, played.steps, min(frames, played.steps + 1))).astype(int))
    snapshots = tuple(Snapshot(int(t), float(t), played.packing_t[t]) for t in chosen)
    trajectory = Trajectory(snapshots, (), _curves(played))
    found = {
        "outcome": played.outcome,
        "reason": played.reason,
        "amplitude": played.amplitude,
        "steps": played.steps,
        "contacts": len(played.contacts),
        "opened": int(played.opened_t[-1]),
        "largest_closing": played.residual,
        "packing_fraction_start": float(played.packing_fraction_t[0]),
        "packing_fraction": float(played.packing_fraction_t[-1]),
        "seconds": played.seconds,
        **(results or {}),
    }
    with opened(path, _layout(trajectory), trajectory, parameters, found) as (stream, target):
        # no particle is marked as a rattler, since the motion may free them all
        world = World(stream, played.packing_t[0], drawing.particle_colors(played.packing_t[0]))
        _log_static(world, _in_words(played))
        _send(world, trajectory, _drawn(played, chosen))
    return target


def _curves(played: PlayedMotion) -> dict[str, Curve]:
    """Return what to plot against the step; what never changes is left to the results."""
    step_t = np.arange(played.steps + 1)
    diameter = played.packing.reference_diameter
    curves: dict[str, Curve] = {"contacts that stayed": (step_t, played.stayed_t.astype(float))}
    if len(played.contacts):
        curves["widest gap"] = (step_t, played.gap_tc.max(axis=1) / diameter)
    fraction_t = played.packing_fraction_t
    if np.ptp(fraction_t) > 1e-4:
        curves["packing fraction"] = (step_t, fraction_t)
    curves["amplitude"] = (step_t, played.amplitude_t)
    return curves


def _in_words(played: PlayedMotion) -> str:
    """Return the results as the recording's text."""
    before, after = played.packing_fraction_t[[0, -1]]
    return (
        f"# {played.outcome}\n\n{played.reason[0].upper() + played.reason[1:]}.\n\n"
        f"| | |\n|---|---|\n"
        f"| amplitude | {played.amplitude:.3g} diameters in {played.steps} steps |\n"
        f"| contacts at the start | {len(played.contacts)} |\n"
        f"| of them still touch | {played.stayed_t[-1]} |\n"
        f"| of them have opened | {played.opened_t[-1]} |\n"
        f"| contacts at the end | {played.contacts_t[-1]} |\n"
        f"| largest closing | {played.residual:.1e} |\n"
        f"| packing fraction | {before:.6f} to {after:.6f} |\n\n"
        "Pale lines: contacts that stay. Orange to red: contacts that have opened. Green: pairs that have met. Arrows: "
        "where particles go; thin lines behind them: where they came from. Dark gray: the box at the start.\n"
    )


@dataclass(frozen=True, eq=False)
class _Drawn:
    """Lines of one frame by kind, the particles, trails and arrows."""

    drawing: drawing.Drawing
    stayed_sed: NDArray[np.float64]
    opened_sed: NDArray[np.float64]
    opened_color_sc: NDArray[np.uint8]
    closed_sed: NDArray[np.float64]
    trail_ned: NDArray[np.float64]
    arrow_nd: NDArray[np.float64]


def _drawn(played: PlayedMotion, chosen: NDArray[np.int64]) -> list[_Drawn]:
    start = played.packing_t[0]
    first = played.displacement_tnd[0] + start.position_nd @ played.strain_tdd[0]
    scale = ARROW_LENGTH / 1.5 * drawing.arrow_scale(first, start.reference_diameter)
    known = set(pairs_of(played.contacts))
    found = []
    for t in chosen:
        packing = played.packing_t[t]
        _, image_nd = packing.box.wrap(packing.position_nd)
        now = pair_contacts(packing, played.contacts.i_c, played.contacts.j_c, played.contacts.image_cd)
        stayed = played.stayed_tc[t]
        near = now.gap_c < FAR * now.contact_distance_c
        touching = find_contacts(packing, gap_tolerance=played.gap_tolerance)
        new = np.array([pair not in known for pair in pairs_of(touching)], dtype=bool)
        picture = drawing.draw_packing(packing)
        open_sed, of_s = _lines(packing, now.select(~stayed & near), image_nd)
        share_s = np.clip(-now.overlap_c[~stayed & near][of_s] / WIDE, 0.0, 1.0)
        arrow = scale * (played.displacement_tnd[t] + packing.position_nd @ played.strain_tdd[t])
        way = packing.position_nd - start.position_nd
        found.append(
            _Drawn(
                picture,
                _lines(packing, now.select(stayed), image_nd)[0],
                open_sed,
                drawing.between(JUST_OPEN, OPENED, share_s),
                _lines(packing, touching.select(new), image_nd)[0],
                np.stack([picture.center_nd - way, picture.center_nd], axis=1),
                arrow,
            )
        )
    return found


def _lines(
    packing: Packing, pairs: Contacts, image_nd: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.intp]]:
    """Return lines between wrapped centers and whose they are; image_nd are the cells that the centers were in."""
    inside = packing.position_nd - image_nd @ packing.box.lattice_dd.T
    image_cd = pairs.image_cd + image_nd[pairs.j_c] - image_nd[pairs.i_c]
    return drawing.pair_lines(inside, pairs.i_c, pairs.j_c, image_cd, pairs.vector_cd)


def _layout(trajectory: Trajectory) -> rrb.Blueprint:
    lines = ["/world/contacts/**", "/world/motion/**", "/world/trails/**", "/world/start/**", "/world/links/**"]
    particles = ["/world/particles/**"]
    if trajectory.final.dimension == 2:
        views = [world_view(trajectory, "motion", [*particles, *lines])]
    else:  # lines inside solid spheres are not seen
        views = [world_view(trajectory, "particles", particles), world_view(trajectory, "motion", lines)]
    beside: Views = [rrb.TextDocumentView(origin="/summary", name="results"), *plots(trajectory)]
    shares = [0.6 + 0.7 * len(beside)] + [1.0] * (len(beside) - 1)
    return page(trajectory, [(rrb.Vertical(*views), 5), (rrb.Vertical(*beside, row_shares=shares), 3)])


def _log_static(world: World, summary: str) -> None:
    order = {"trails": 36.0, "contacts/opened": 40.0, "contacts/stayed": 42.0, "contacts/closed": 43.0}
    order |= {"links/shapes": 44.0, "links/bonds": 46.0, "motion": 50.0, "start": 58.0}
    lines: dict[str, tuple[float | None, Any]] = {
        "motion": (ARROW_WIDTH, ARROW),
        "contacts/stayed": (STAYED_WIDTH, STAYED),
        "contacts/closed": (STAYED_WIDTH, CLOSED),
        "trails": (TRAIL_WIDTH, TRAIL),
        "start": (0.5 * drawing.OUTLINE_RADIUS, GHOST),
        "box": (0.7 * drawing.OUTLINE_RADIUS, drawing.OUTLINE),
        # its colors change, and what is static would hide them
        "contacts/opened": (OPENED_WIDTH, None),
    }
    world.log_static(order, lines, ["motion"], summary)
    start = world.strips.from_fields(strips=drawing.box_outline(world.packing.box))
    world.stream.log("world/start", start, static=True)


def _send(world: World, trajectory: Trajectory, drawn_f: list[_Drawn]) -> None:
    clock = [rr.TimeColumn("step", sequence=trajectory.step_f)]
    drawing_f = [one.drawing for one in drawn_f]
    world.send_packings(clock, trajectory.packing_f, drawing_f)
    world.send_lines(clock, "contacts/stayed", [one.stayed_sed for one in drawn_f])
    world.send_lines(clock, "contacts/closed", [one.closed_sed for one in drawn_f])
    world.send_lines(clock, "trails", [one.trail_ned for one in drawn_f])
    color_sc = np.concatenate([one.opened_color_sc for one in drawn_f])
    world.send_lines(clock, "contacts/opened", [one.opened_sed for one in drawn_f])
    opened_f = [len(one.opened_sed) for one in drawn_f]
    world.send(clock, "world/contacts/opened", world.strips.columns(colors=color_sc), opened_f)
    vectors = np.concatenate([one.arrow_nd for one in drawn_f])
    centers = np.concatenate([one.center_nd for one in drawing_f])
    count_f = [len(one.center_nd) for one in drawing_f]
    world.send(clock, "world/motion", world.arrows.columns(origins=centers, vectors=vectors), count_f)
