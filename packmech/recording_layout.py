"""How a recording opens in the viewer: the packing large, the lowest modes, the results and the curves beside it."""

from __future__ import annotations

import numpy as np
import rerun.blueprint as rrb

from packmech import drawing
from packmech.packing import Packing
from packmech.recording_film import Film, Motion

PLAY_SECONDS = 6.0
MARGIN = 0.04


def blueprint(film: Film, motions: list[Motion], *, summary: bool) -> rrb.Blueprint:
    """Return the layout for a film, with only the panels that have something to show."""
    side: list[rrb.Container | rrb.View] = []
    if motions:
        views = [_world_view(film, motion.title, f"/world/modes/{motion.name}/**", forces=False) for motion in motions]
        side.append(rrb.Tabs(*views, active_tab=0, name="lowest modes"))
    if summary:
        side.append(rrb.TextDocumentView(origin="/summary", name="results"))
    plots = _plots(film)
    columns: list[rrb.Container | rrb.View] = [_world_view(film, "packing", forces=True)]
    shares = [5.0]
    if side:
        columns.append(rrb.Vertical(*side))
        shares.append(3.0)
    if plots:
        columns.append(rrb.Vertical(*plots))
        shares.append(2.4)
    steps = float(film.step_f[-1] - film.step_f[0])
    return rrb.Blueprint(
        rrb.Horizontal(*columns, column_shares=shares),
        rrb.TimePanel(timeline="step", state="collapsed", fps=max(steps / PLAY_SECONDS, 1.0), loop_mode="off"),
        collapse_panels=True,
    )


def _plots(film: Film) -> list[rrb.Container | rrb.View]:
    """One plot for each curve; curves of a single point say nothing that the results do not."""
    return [
        rrb.TimeSeriesView(
            origin=f"/series/{name.replace(' ', '_')}",
            name=name,
            plot_legend=rrb.PlotLegend(visible=False),
        )
        for name, (step_t, _) in film.curves.items()
        if len(step_t) > 1
    ]


def _world_view(film: Film, name: str, *extra: str, forces: bool) -> rrb.View:
    contents = ["/world/box/**", "/world/particles/**", *extra, *(["/world/forces/**"] if forces else [])]
    corner_kd = np.concatenate([np.concatenate(drawing.box_outline(packing.box)) for packing in film.packing_f])
    low, high = corner_kd.min(axis=0), corner_kd.max(axis=0)
    if film.final.dimension == 2:
        pad = MARGIN * float(np.max(high - low)) + float(film.final.radius_n.max())
        # 2D views point down; /world is mirrored, and so are these bounds
        bounds = rrb.VisualBounds2D(
            x_range=[low[0] - pad, high[0] + pad], y_range=[-high[1] - pad, -low[1] + pad]
        )
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
        position=center + reach * np.array([0.55, -1.05, 0.55]),
        look_target=center,
        eye_up=(0.0, 0.0, 1.0),
    )
