"""Rerun recordings of motions played to finite amplitude: contacts that stay, open and close, the box, the way made."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from packmech import drawing
from packmech.check import instance, integer
from packmech.contacts import Contacts, find_contacts
from packmech.contacts.network import pair_contacts
from packmech.dynamics.play import PlayedMotion
from packmech.dynamics.play_steps import pairs_of
from packmech.packing import Packing
from packmech.recording import check_told, opened, send_links
from packmech.recording_film import Curve, Film

if TYPE_CHECKING:
    import rerun as rr

__all__ = ["record_motion"]

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
    check_told(path, parameters, results)
    chosen = np.unique(np.rint(np.linspace(0, played.steps, min(frames, played.steps + 1))).astype(int))
    film = Film(chosen, tuple(played.packing_t[t] for t in chosen), (), _curves(played))
    told = {
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
    with opened(path, _layout(film), film, parameters or {}, told) as (stream, target):
        _log_static(stream, film, _told(played))
        _send(stream, film, _pictures(played, chosen))
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


def _told(played: PlayedMotion) -> str:
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
class _Picture:
    """Lines of one frame by kind, the particles, trails and arrows."""

    drawing: drawing.Drawing
    stayed_sed: NDArray[np.float64]
    opened_sed: NDArray[np.float64]
    opened_color_sc: NDArray[np.uint8]
    closed_sed: NDArray[np.float64]
    trail_ned: NDArray[np.float64]
    arrow_nd: NDArray[np.float64]


def _pictures(played: PlayedMotion, chosen: NDArray[np.int64]) -> list[_Picture]:
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
            _Picture(
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


def _layout(film: Film) -> Any:
    import rerun.blueprint as rrb

    from packmech.recording_layout import PLAY_SECONDS, plots, world_view

    lines = ["/world/contacts/**", "/world/motion/**", "/world/trails/**", "/world/start/**", "/world/links/**"]
    if film.final.dimension == 2:
        views = [world_view(film, "motion", ["/world/particles/**", *lines])]
    else:  # lines inside solid spheres are not seen
        views = [world_view(film, "particles", ["/world/particles/**"]), world_view(film, "motion", lines)]
    beside = [rrb.TextDocumentView(origin="/summary", name="results"), *plots(film)]
    steps = float(film.step_f[-1])
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(*views),
            rrb.Vertical(*beside, row_shares=[0.6 + 0.7 * len(beside)] + [1.0] * (len(beside) - 1)),
            column_shares=[5, 3],
        ),
        rrb.TimePanel(timeline="step", state="collapsed", fps=max(steps / PLAY_SECONDS, 1.0), loop_mode="off"),
        collapse_panels=True,
    )


def _log_static(stream: rr.RecordingStream, film: Film, summary: str) -> None:
    import rerun as rr

    start, flat = film.packing_f[0], film.final.dimension == 2
    points, strips = (rr.Points2D, rr.LineStrips2D) if flat else (rr.Points3D, rr.LineStrips3D)
    color_nc = _colors(film)
    unit = start.reference_diameter
    if flat:  # the viewer's 2D axes point down
        stream.log("world", rr.Transform3D(scale=[1.0, -1.0, 1.0]), static=True)
        orders = {"particles/copies": 20.0, "particles": 30.0}
        for name, order in orders.items():
            stream.log(f"world/{name}", rr.Points2D.from_fields(draw_order=order), static=True)
        orders = {"trails": 36.0, "contacts/opened": 40.0, "contacts/stayed": 42.0, "contacts/closed": 43.0}
        orders |= {"links/shapes": 44.0, "links/bonds": 46.0, "start": 58.0, "box": 60.0}
        for name, order in orders.items():
            stream.log(f"world/{name}", rr.LineStrips2D.from_fields(draw_order=order), static=True)
        stream.log("world/motion", rr.Arrows2D.from_fields(draw_order=50.0), static=True)
    else:
        stream.log("world", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    stream.log("world/particles", points.from_fields(radii=start.radius_n, colors=color_nc), static=True)
    arrows = rr.Arrows2D if flat else rr.Arrows3D
    stream.log("world/motion", arrows.from_fields(radii=ARROW_WIDTH * unit, colors=ARROW), static=True)
    widths = {
        "contacts/stayed": (STAYED_WIDTH, STAYED),
        "contacts/closed": (STAYED_WIDTH, CLOSED),
        "trails": (TRAIL_WIDTH, TRAIL),
        "start": (0.5 * drawing.OUTLINE_RADIUS, GHOST),
        "box": (0.7 * drawing.OUTLINE_RADIUS, drawing.OUTLINE),
    }
    for name, (width, color) in widths.items():
        stream.log(f"world/{name}", strips.from_fields(radii=width * unit, colors=color), static=True)
    # its colors change, and what is static would hide them
    stream.log("world/contacts/opened", strips.from_fields(radii=OPENED_WIDTH * unit), static=True)
    stream.log("world/start", strips.from_fields(strips=drawing.box_outline(start.box)), static=True)
    stream.log("state/radius", rr.AnyValues(radius_n=start.radius_n), static=True)
    stream.log("summary", rr.TextDocument(summary, media_type="text/markdown"), static=True)


def _colors(film: Film) -> NDArray[np.uint8]:
    """Return the particles' colors; none is marked as a rattler, since the motion may free them all."""
    packing = film.packing_f[0]
    return drawing.particle_colors(packing.radius_n, np.zeros(packing.particles, dtype=bool), packing.links)


def _send(stream: rr.RecordingStream, film: Film, picture_f: list[_Picture]) -> None:
    import rerun as rr

    flat = film.final.dimension == 2
    points, strips = (rr.Points2D, rr.LineStrips2D) if flat else (rr.Points3D, rr.LineStrips3D)
    time = [rr.TimeColumn("step", sequence=film.step_f)]
    drawing_f = [picture.drawing for picture in picture_f]

    def send(path: str, columns: Any, sizes: list[int]) -> None:
        stream.send_columns(path, time, columns.partition(sizes))

    centers = np.concatenate([one.center_nd for one in drawing_f])
    sizes = [len(one.center_nd) for one in drawing_f]
    send("world/particles", points.columns(positions=centers), sizes)
    if flat:
        owner_k = np.concatenate([one.copy_of_k for one in drawing_f])
        copies = points.columns(
            positions=np.concatenate([one.copy_center_kd for one in drawing_f]),
            radii=film.final.radius_n[owner_k],
            colors=drawing.dimmed(_colors(film)[owner_k]),
        )
        send("world/particles/copies", copies, [len(one.copy_of_k) for one in drawing_f])
    for name, field in (
        ("contacts/stayed", "stayed_sed"),
        ("contacts/opened", "opened_sed"),
        ("contacts/closed", "closed_sed"),
        ("trails", "trail_ned"),
    ):
        line_f = [getattr(picture, field) for picture in picture_f]
        send(f"world/{name}", strips.columns(strips=np.concatenate(line_f)), [len(one) for one in line_f])
    color_sc = np.concatenate([picture.opened_color_sc for picture in picture_f])
    send("world/contacts/opened", strips.columns(colors=color_sc), [len(one.opened_sed) for one in picture_f])
    arrows = rr.Arrows2D if flat else rr.Arrows3D
    vectors = np.concatenate([picture.arrow_nd for picture in picture_f])
    send("world/motion", arrows.columns(origins=centers, vectors=vectors), sizes)
    outline_k = [line for one in drawing_f for line in one.outline_ed]
    send("world/box", strips.columns(strips=outline_k), [len(one.outline_ed) for one in drawing_f])
    if film.final.links is not None:
        send_links(list(film.packing_f), drawing_f, send)
    position = rr.AnyValues.columns(position_nd=np.concatenate([one.position_nd.ravel() for one in film.packing_f]))
    send("state/position", position, [one.position_nd.size for one in film.packing_f])
    lattice = rr.AnyValues.columns(lattice_dd=np.concatenate([one.box.lattice_dd.ravel() for one in film.packing_f]))
    send("state/lattice", lattice, [one.box.lattice_dd.size for one in film.packing_f])
