"""How a recording opens in the viewer: the packing large, the lowest modes, the results and the curves beside it."""

from __future__ import annotations

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from packmech import drawing
from packmech.march_film import MarchFilm
from packmech.packing import Packing
from packmech.recording_film import Film, Motion

PLAY_SECONDS = 6.0
MARGIN = 0.04
# plots that stand in one column
MOST_PLOTS = 8


def blueprint(film: Film, motions: list[Motion], *, summary: bool) -> rrb.Blueprint:
    """Return the layout for a film, with only the panels that have something to show."""
    flat = film.final.dimension == 2
    particles, lines = ["/world/particles/**"], ["/world/forces/**"]
    if film.final.links is not None:
        lines = [*lines, "/world/links/**"]
    pictures: list[rrb.Container | rrb.View]
    if flat:
        pictures = [world_view(film, "packing", [*particles, *lines])]
    else:  # lines inside solid spheres are not seen, so they have views of their own
        pictures = [world_view(film, "packing", particles), world_view(film, "contact forces", ["/world/forces/**"])]
        if film.final.links is not None:
            sticks = world_view(film, "links", ["/world/links/**"])
            pictures = [pictures[0], rrb.Horizontal(sticks, pictures[1])]
    middle: list[rrb.Container | rrb.View] = []
    if motions:
        shown = ["/world/particles"] if flat else []
        views = [world_view(film, motion.title, [*shown, f"/world/modes/{motion.name}/**"]) for motion in motions]
        middle.append(rrb.Tabs(*views, active_tab=0, name="lowest modes"))
    if summary:
        middle.append(rrb.TextDocumentView(origin="/summary", name="results"))
    columns = [(rrb.Vertical(*pictures), 5.0), *_columns(middle, plots(film))]
    steps = float(film.step_f[-1] - film.step_f[0])
    return rrb.Blueprint(
        rrb.Horizontal(*(column for column, _ in columns), column_shares=[share for _, share in columns]),
        rrb.TimePanel(timeline="step", state="collapsed", fps=max(steps / PLAY_SECONDS, 1.0), loop_mode="off"),
        collapse_panels=True,
    )


def march_blueprint(march: MarchFilm, *, summary: bool) -> rrb.Blueprint:
    """Return the layout for a march: the packing large, stress against strain and the results, the curves."""
    film = march.film()
    bodies, lines = ["/world/particles/**", "/world/walls/**"], ["/world/bonds/**", "/world/contacts/**"]
    pictures: list[rrb.Container | rrb.View]
    if film.final.dimension == 2:
        pictures = [world_view(film, "packing", [*bodies, *lines, "/world/marks/**"])]
    else:  # lines inside solid spheres are not seen, so they have a view of their own
        pictures = [world_view(film, "packing", bodies), world_view(film, "bonds and contacts", lines)]
    middle: list[rrb.Container | rrb.View] = []
    if len(march.strain_t) > 1:
        across, up = (float(np.abs(part).max()) for part in (march.strain_t, march.stress_t))
        bounds = rrb.VisualBounds2D(x_range=[-1.25, 1.25], y_range=[-1.25, 1.25])
        middle.append(
            rrb.Spatial2DView(
                origin="/",
                contents=["/loop/**"],
                name=f"stress (up, whole {up:.3g}) against strain (across, whole {across:.3g})",
                visual_bounds=bounds,
                background=drawing.BACKGROUND,
            )
        )
    if summary:
        middle.append(rrb.TextDocumentView(origin="/summary", name="results"))
    columns = [(rrb.Vertical(*pictures), 5.0), *_columns(middle, plots(film))]
    steps = float(film.step_f[-1] - film.step_f[0])
    return rrb.Blueprint(
        rrb.Horizontal(*(column for column, _ in columns), column_shares=[share for _, share in columns]),
        rrb.TimePanel(timeline="step", state="collapsed", fps=max(steps / PLAY_SECONDS, 1.0), loop_mode="off"),
        collapse_panels=True,
    )


def _columns(
    middle: list[rrb.Container | rrb.View], plotted: list[rrb.Container | rrb.View]
) -> list[tuple[rrb.Container, float]]:
    """Return what stands beside the pictures, and how wide: nothing that is empty, many plots in two columns."""
    found: list[tuple[rrb.Container, float]] = [(rrb.Vertical(*middle), 3.0)] if middle else []
    if len(plotted) > MOST_PLOTS:
        found.append((rrb.Grid(*plotted, grid_columns=2), 3.6))
    elif plotted:
        found.append((rrb.Vertical(*plotted), 2.4))
    return found


def plots(film: Film) -> list[rrb.Container | rrb.View]:
    """One plot for each curve; curves of a single point say nothing that the results do not."""
    first, last = int(film.step_f[0]), int(film.step_f[-1])
    edge = max(1, round(MARGIN * (last - first)))  # a last fall in one step should be seen
    whole = rr.TimeRange(
        rr.TimeRangeBoundary.absolute(seq=first - edge), rr.TimeRangeBoundary.absolute(seq=last + edge)
    )
    return [
        rrb.TimeSeriesView(
            origin=f"/series/{name.replace(' ', '_')}",
            name=name,
            plot_legend=rrb.PlotLegend(visible=False),
            axis_x=rrb.TimeAxis(view_range=whole),
        )
        for name, (step_t, _) in film.curves.items()
        if len(step_t) > 1
    ]


def world_view(film: Film, name: str, shown: list[str]) -> rrb.View:
    """Return a view of the box and of what is shown, wide enough for the packings of the film's later half.

    A packing that is compressed from far away would otherwise end as a spot in a corner.
    """
    contents = ["/world/box/**", *shown]
    seen = film.packing_f[len(film.packing_f) // 2 :]
    corner_kd = np.concatenate([np.concatenate(drawing.box_outline(packing.box)) for packing in seen])
    low, high = corner_kd.min(axis=0), corner_kd.max(axis=0)
    if film.final.dimension == 2:
        extent = float(np.max(high - low))
        pad = MARGIN * extent + float(film.final.radius_n.max())
        if film.final.links is not None:  # bonds across the edge end in a center outside
            pad += min(float(film.final.links.length_l.max()), 0.1 * extent)
        # 2D views point down; /world is mirrored, and so are these bounds
        bounds = rrb.VisualBounds2D(x_range=[low[0] - pad, high[0] + pad], y_range=[-high[1] - pad, -low[1] + pad])
        return rrb.Spatial2DView(
            origin="/", contents=contents, name=name, visual_bounds=bounds, background=drawing.BACKGROUND
        )
    return rrb.Spatial3DView(
        origin="/",
        contents=contents,
        name=name,
        background=drawing.BACKGROUND,
        line_grid=False,
        eye_controls=_eye(film.final, low, high),
    )


def _eye(packing: Packing, low: np.ndarray, high: np.ndarray) -> rrb.EyeControls3D:
    center = 0.5 * (low + high)
    reach = float(np.linalg.norm(high - low))
    return rrb.EyeControls3D(
        kind=rrb.Eye3DKind.Orbital,
        position=center + reach * np.array([0.42, -0.88, 0.45]),
        look_target=center,
        eye_up=(0.0, 0.0, 1.0),
    )
