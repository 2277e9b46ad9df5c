"""`pm.plot`: the usual figure of any result, on axes of matplotlib that it returns."""

from __future__ import annotations

import dataclasses
import io
import math
import textwrap
from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.calls.display import counted, in_words, value_with_error
from packmech.check import brief, call_fault, did_you_mean, finite_array, instance, integer, one_of
from packmech.dynamics.ledger import EnergyLedger
from packmech.effects import bonds_of, held_particles
from packmech.ensemble.shear_series import ShearCurve, ShearSeries
from packmech.ensemble.statistics import GroupStatistics, Histogram, PowerLawFit, fit_power_law
from packmech.jamming.play import PlayedMotion
from packmech.jamming.verdict import TiledAnswer, UnjammingMotion, Verdict
from packmech.links import Links
from packmech.measure.coarse_grain import CoarseFields
from packmech.measure.contact_forces import ContactForces, rattlers_in
from packmech.measure.contact_statistics import ContactStatistics, ForceDistribution
from packmech.measure.displacements import Displacements, LocalStrain
from packmech.measure.mobility import MeanSquareDisplacement, SelfScattering
from packmech.measure.rattlers import find_rattlers
from packmech.measure.scattering import ShellAverage
from packmech.measure.structure import Correlation, PairDistribution
from packmech.mechanics.complex_modulus import ComplexModulus
from packmech.mechanics.elasticity import Moduli
from packmech.mechanics.mode_counts import ModeCounts
from packmech.mechanics.modes import Modes
from packmech.mechanics.rigid_clusters import RigidClusters
from packmech.mechanics.state_density import StateDensity
from packmech.mechanics.waves import SoundSpeeds, Waves
from packmech.packing import Packing
from packmech.protocols.cement import Cementing
from packmech.protocols.deform import Deformation
from packmech.protocols.shearing.avalanche import Avalanche
from packmech.protocols.shearing.families import ShearFamilies
from packmech.protocols.shearing.local_yield import LocalYield
from packmech.protocols.shearing.quasistatic import QuasistaticShear
from packmech.result import Run, Trace
from packmech.rheology.amplitude_sweep import AmplitudeSweep
from packmech.rheology.at_pressure import PressureShear
from packmech.rheology.oscillatory import OscillatoryShear
from packmech.rheology.steady import Creep, FlowCurve
from packmech.rheology.strain_run import StrainRun
from packmech.scene import Scene
from packmech.validation.work_precision import WorkPrecision, error_heading
from packmech.view import drawing
from packmech.view.figures import COLORS, MARKERS, STYLE, matplotlib_parts, new_axes, outlined

SIZE, SQUARE, SMALL = (5.6, 3.8), (6.4, 5.6), (2.6, 2.6)
# kinds of particles that a legend lists, in as many colors
_LISTED_KINDS = 10
# colors of particles on a white ground: those that bear forces, rattlers, held ones, copies
BEARING, RATTLER, HELD, EDGE = "#b7cbe0", "#f0d091", "#b4b4b4", "#5b6b7d"
# particles whose joints are shown, and how many clusters a legend lists
_PALE, _SPRING, _LISTED = "#eef1f5", "#5c5c5c", 3
# what lies at the back of a packing in space is mixed with white up to this part
_FADED = 0.65
# part of the box by which places may differ that are the same [1]
_SAME = 1e-6
_POINTS = {"marker": "o", "markersize": 3.5, "linewidth": 1.2}


def plot(thing: Any, ax: Any = None, **options: Any) -> Any:
    """Return the axes on which the usual figure of a result is drawn.

    Parameters
    ----------
    thing
        What to draw. A packing, a scene, its contact forces or a run: the particles and, of a scene, its
        contact forces. A verdict: the backbone with its contacts and the motion that unjams it, if one does, or
        the fewest copies that unjam where one box does not; its answer on copies: these (else on `packing=`). Rigid
        clusters: contacts and links in their colors, wide where over-constrained. A motion, modes: arrows on
        `packing=`; modes without it: their spectrum. An avalanche: what it moved.
        Displacements and local strains: arrows, and colors by D2min, on `packing=`. Coarse fields: one in the plane
        (`of=`). Moduli: the matrix. Speeds of sound: along their direction, with how particles move. Else a curve: a
        density of states, numbers of modes, waves (branches along a path), pair distribution, shell average,
        correlation, stress-strain curve or loop, flow curve, moduli against amplitude or frequency, creep, mean square
        displacement, self-intermediate scattering, energy ledger, cementing, shear families, distribution of forces,
        numbers of contacts, statistics of an ensemble (`fit=True` draws a power law, or one that was fitted), work and
        precision, or a trace (`of=` names what).
    ax
        Axes of matplotlib to draw on; new ones unless given.
    options
        Of a packing: `forces=False`, `copies=False` and `color=` "role", "size", "kind" or (N,) numbers with `label=`.
        Of modes and motions: `packing=`, `mode=`, `scale=`. Of moduli: `tangent=` "cauchy", "energy" or "affine". Of
        work and precision: `over=` "time" or "setting". Others as above; `log=True` gives logarithmic axes, on which
        negative moduli are empty marks at their size, and `label=` names a curve, so that several on the same axes
        differ in color and have a legend.

    Raises
    ------
    TypeError
        If there is no figure of such a thing, or an option is none of its.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.random_packing(32, dimension=2, packing_fraction=0.9, seed=1)
    >>> scene = pm.Scene(packing, (pm.Repulsion(),))
    >>> ax = pm.plot(pm.quench(scene, force_tolerance=1e-9), scene=scene)
    >>> ax.figure.savefig("/dev/null", format="svg")

    """
    draw, size = _figure_of(thing)
    axes = new_axes(size) if ax is None else ax
    if not hasattr(axes, "add_collection"):
        raise TypeError(f"ax must be one matplotlib Axes, got {brief(axes)}")
    try:
        with matplotlib_parts().rc_context(STYLE):
            draw(thing, axes, **options)
    except TypeError:
        fault = call_fault(draw, (thing, axes), options)
        if fault:
            raise TypeError(f"options of a figure of {type(thing).__name__}: {fault.partition('() ')[2]}") from None
        raise
    return axes


_FIGURES: dict[type, tuple[Callable[..., None], tuple[float, float]]] = {}


def _draws(*kinds: type, size: tuple[float, float] = SIZE) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Return a decorator of the function that draws things of these classes."""

    def decorated(draw: Callable[..., None]) -> Callable[..., None]:
        _FIGURES.update(dict.fromkeys(kinds, (draw, size)))
        return draw

    return decorated


def _figure_of(thing: Any) -> tuple[Callable[..., None], tuple[float, float]]:
    found = next((_FIGURES[kind] for kind in type(thing).__mro__ if kind in _FIGURES), None)
    if found is None:
        raise TypeError(
            "thing must be one of Packing, Scene, Run, ContactForces, Verdict, Modes, Moduli, or the result of a call "
            "that gives a curve, such as pm.density_of_states, pm.pair_distribution, pm.steady_shear, got "
            f"{brief(thing)}; pm.plot(scene) draws its particles with the contact forces"
        )
    return found


# what is seen on a packing that is not at hand, or needs more room
_WITHOUT_PICTURE = (Modes, Moduli, Verdict, TiledAnswer, UnjammingMotion, Trace, Displacements, LocalStrain)


def picture_of(thing: Any) -> str:
    """Return a small picture of a result as HTML; empty where there is none of it."""
    seen = {Packing: thing, Scene: thing}.get(type(thing), thing if isinstance(thing, Run) else None)
    if seen is None and type(thing) in _FIGURES and not isinstance(thing, _WITHOUT_PICTURE):
        seen = thing
    if seen is None:
        return ""
    parts, text = matplotlib_parts(), io.StringIO()
    figure = parts.Figure(figsize=SMALL, layout="constrained")
    draw, _ = _figure_of(seen)
    packings = (Packing, Scene, Run, ContactForces)
    with parts.rc_context({"font.size": 7.0, "svg.hashsalt": "packmech"}):
        axes = figure.add_subplot()
        draw(seen, axes, **({"bar": False} if isinstance(seen, packings) and draw is _draw_packed else {}))
        figure.savefig(text, format="svg", metadata={"Date": None})
    picture = text.getvalue()
    return f"<div>{picture[picture.index('<svg') :]}</div>"


def _curve(ax: Any, label: str) -> dict[str, Any]:
    """Return color and label of the next curve on these axes: those with a label differ, the others are blue."""
    drawn = len(ax.get_legend_handles_labels()[1]) if label else 0
    return {"color": COLORS[drawn % len(COLORS)], "label": label or None}


def _unit(dimension: int | None, of: str = "energy", length: str = "length") -> str:
    """Return the unit of an energy or mass over an area or a volume, in brackets; None: d is not known."""
    return f"[{of}/{length}$^{'d' if dimension is None else dimension}$]"


def _scene_unit(dimension: int) -> str:
    """Return the unit of pressures in a scene's own: its energy scale over its reference diameter^d."""
    return _unit(dimension, "energy scale", "diameter")


def _finish(ax: Any, title: str = "") -> None:
    """Draw the legend if curves have labels; otherwise write the title, which speaks of one curve."""
    if ax.get_legend_handles_labels()[1]:
        ax.set_title("")
        ax.legend(frameon=False)
    elif title:
        ax.set_title(title)


# -- packings -------------------------------------------------------------------------------------------------------


@_draws(Packing, Scene, Run, ContactForces, size=SQUARE)
def _draw_packed(
    thing: Packing | Scene | Run | ContactForces,
    ax: Any,
    *,
    scene: Scene | None = None,
    forces: bool = True,
    color: Any = "role",
    label: str = "",
    copies: bool = True,
    bar: bool = True,
) -> None:
    """Draw particles, and lines as wide as the forces of their contacts where effects are known."""
    thing = thing.scene if isinstance(thing, ContactForces) else thing
    packing = thing if isinstance(thing, Packing) else thing.packing
    effects = thing.effects if isinstance(thing, Scene) else () if scene is None else scene.effects
    fills = _fills(packing, effects, color)
    _add_packing(ax, packing, effects, fills, drawing.draw_packing(packing, effects), forces, label, copies, bar)


def _add_packing(
    ax: Any,
    packing: Packing,
    effects: tuple[Any, ...],
    fills: tuple[NDArray[np.float64], dict[str, Any]],
    drawn: drawing.Drawing,
    forces: bool,
    label: str,
    copies: bool,
    bar: bool,
) -> None:
    """Draw particles filled as given, the lines of their contacts, and links; arguments as of `_draw_packed`."""
    flat, parts = packing.dimension == 2, matplotlib_parts()
    inside = packing.wrapped()
    fill_nc, shown = fills
    every = np.arange(packing.particles)
    if flat and copies and not any(type(one).__name__ == "Walls" for one in effects):
        outlines = drawing.seen_outlines(inside, drawn.copy_center_kd, drawn.copy_of_k)
        _add_particles(ax, outlines, 0.25 * fill_nc + 0.75, 1.0)
    outlines = drawing.seen_outlines(inside, drawn.center_nd, every)
    if not flat:
        outlines = outlines.taken(np.argsort(outlines.place_ks[:, 2]))
        depth_k = outlines.place_ks[:, 2]
        share_k = _FADED * (1.0 - (depth_k - depth_k.min()) / (np.ptp(depth_k) or 1.0))[:, None]
        fill_kc = fill_nc[outlines.owner_k] * (1.0 - share_k) + share_k
        _add_particles(ax, outlines, fill_kc, 2.0, owned=False)
    else:
        _add_particles(ax, outlines, fill_nc, 2.0)
    low, high = _limits(ax, packing, outlines)
    for line in [*drawn.outline_ed, *drawing.wall_outlines(effects, packing.box)]:
        place = drawing.projected(np.asarray(line))
        ax.plot(place[:, 0], place[:, 1], color="#303030", linewidth=0.8, zorder=6.0)
    if forces and flat and len(drawn.segment_sed):
        _add_forces(ax, drawn, packing, bool(effects), bar, float(high[0] - low[0]))
    if len(drawn.bond_sed) and flat:
        lines = parts.LineCollection(drawn.bond_sed[:, :, :2], colors="#2b7a4b", linewidths=1.2, zorder=4.0)
        ax.add_collection(lines)
    springs = drawing.spring_lines(packing, effects) if flat else ()
    if len(springs):
        ax.add_collection(parts.LineCollection(springs, colors=_SPRING, linewidths=1.2, zorder=1.5))
    if bar:
        _legend(ax, shown, bool(len(drawn.bond_sed)) and flat, bool(len(springs)))
    if shown.get("numbers") is not None and bar:
        mappable = parts.ScalarMappable(parts.Normalize(*shown["range"]), "viridis")
        ax.figure.colorbar(mappable, ax=ax, shrink=0.75, label=label or "color")
    ax.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
    ax.set_axis_off()


def _fills(packing: Packing, effects: tuple[Any, ...], color: Any) -> tuple[NDArray[np.float64], dict[str, Any]]:
    """Return the (N, 3) colors of particles, and what a legend has to say of them."""
    parts, n = matplotlib_parts(), packing.particles
    if isinstance(color, str):
        one_of("color", color, ("role", "size", "kind"))
    if isinstance(color, str) and color == "role":
        return _role_fills(packing, effects, _rattlers(packing, effects))
    if isinstance(color, str) and color == "kind":
        kind_n = np.zeros(n, dtype=np.int64) if packing.kind_n is None else packing.kind_n
        if packing.kinds <= _LISTED_KINDS:
            hues = parts.colormaps["tab10"].colors
            marks = [(f"kind {kind}", hues[kind]) for kind in np.unique(kind_n).tolist()]
            return np.array(hues)[kind_n], {"marks": marks}
        color = kind_n
    numbers = packing.radius_n if isinstance(color, str) else finite_array("color", color, shape=(n,))
    low, high = float(numbers.min()), float(numbers.max())
    share = (numbers - low) / ((high - low) or 1.0)
    return np.asarray(parts.colormaps["viridis"](share))[:, :3], {"numbers": numbers, "range": (low, high)}


def _role_fills(
    packing: Packing, effects: tuple[Any, ...], rattler_n: NDArray[np.bool_]
) -> tuple[NDArray[np.float64], dict[str, Any]]:
    """Return the (N, 3) colors of particles that bear forces, rattle or are held, and which of these there are."""
    parts, n = matplotlib_parts(), packing.particles
    fill_nc = np.tile(parts.to_rgb(BEARING), (n, 1))
    fill_nc[rattler_n] = parts.to_rgb(RATTLER)
    held = held_particles(effects, n)
    held_n = np.zeros(n, dtype=bool) if held is None else held
    fill_nc[held_n] = parts.to_rgb(HELD)
    return fill_nc, {"roles": (bool((~rattler_n & ~held_n).any()), bool(rattler_n.any()), bool(held_n.any()))}


def _rattlers(packing: Packing, effects: tuple[Any, ...]) -> NDArray[np.bool_]:
    """Return which particles rattle; none where only friction, which is not known here, could tell, or N is large."""
    if packing.particles >= 100_000 or packing.tangential is not None and not effects:
        return np.zeros(packing.particles, dtype=bool)
    found = rattlers_in(Scene(packing, effects)) if effects else find_rattlers(packing)
    if (bonds := bonds_of(effects)) is not None:
        # nodes of a network of springs, which may be slack
        found[np.concatenate([bonds.i_b, bonds.j_b])] = False
    return found


def _add_particles(ax: Any, outlines: drawing.Outlines, fill: Any, order: float, *, owned: bool = True) -> None:
    color = fill[outlines.owner_k] if owned else fill
    ax.add_collection(outlined(ax, outlines, facecolors=color, edgecolors=EDGE, linewidths=0.3, zorder=order))


def _limits(ax: Any, packing: Packing, outlines: drawing.Outlines) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    corners = [drawing.projected(line)[:, :2] for line in drawing.box_outline(drawing.shown_box(packing.box)[0])]
    place = np.concatenate([*corners, outlines.place_ks[:, :2]])
    pad = 1.1 * float(packing.shapes.reach(packing.radius_n).max())
    return place.min(axis=0) - pad, place.max(axis=0) + pad


def _add_forces(ax: Any, drawn: drawing.Drawing, packing: Packing, known: bool, bar: bool, width: float) -> None:
    """Draw a line for each contact, as wide and as dark as its force over the mean."""
    parts = matplotlib_parts()
    points = ax.get_window_extent().width * 72.0 / ax.figure.dpi / width
    half = drawing.force_radii(drawn.force_s, packing.reference_diameter, packing.dimension)
    lines = parts.LineCollection(drawn.segment_sed, linewidths=2.0 * points * half, zorder=4.0, capstyle="round")
    if known:
        lines.set_array(drawn.force_s)
        lines.set(cmap="inferno_r", norm=parts.Normalize(-1.0, 4.0))
    else:
        lines.set(linewidths=0.8, colors="#404040")
    ax.add_collection(lines)
    if known and bar:
        mappable = parts.ScalarMappable(parts.Normalize(-1.0, 4.0), "inferno_r")
        made = ax.figure.colorbar(mappable, ax=ax, shrink=0.75, label="contact force / mean contact force")
        made.ax.set_ylim(0.0, 4.0)


def _legend(ax: Any, shown: Mapping[str, Any], links: bool, springs: bool) -> None:
    """Say below the packing what its colors mean."""
    parts = matplotlib_parts()
    names = ("backbone" if "contacts" in shown else "bears force", "rattler", "held")
    roles = zip(names, (BEARING, RATTLER, HELD), shown.get("roles", ()), strict=False)
    named = [*shown.get("marks", ()), *((name, fill) for name, fill, there in roles if there)]
    marks = [
        parts.Line2D([], [], marker="o", linestyle="none", markersize=8, color=fill, markeredgecolor=EDGE, label=name)
        for name, fill in named
    ]
    if shown.get("contacts"):
        marks.append(parts.Line2D([], [], color="#404040", linewidth=0.8, label="contact"))
    if links:
        marks.append(parts.Line2D([], [], color="#2b7a4b", linewidth=2.0, label="link"))
    if springs:
        marks.append(parts.Line2D([], [], color=_SPRING, linewidth=2.0, label="spring"))
    if marks:
        place = {"loc": "upper center", "bbox_to_anchor": (0.5, 0.0), "ncols": min(len(marks), 5)}
        ax.legend(handles=marks, frameon=False, **place)


def _arrows(ax: Any, packing: Packing, move_nd: NDArray[np.float64], scale: float | None) -> None:
    """Draw displacements as arrows, the longest one of 1.5 diameters unless the scale is given."""
    factor = drawing.arrow_scale(move_nd, packing.reference_diameter) if scale is None else float(scale)
    start = drawing.projected(packing.wrapped().position_nd)[:, :2]
    along = drawing.projected(factor * move_nd)[:, :2]
    style = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "width": 0.004, "color": "#c22f2f", "zorder": 7.0}
    ax.quiver(*start.T, *along.T, **style)


# -- vibrations and motions -----------------------------------------------------------------------------------------


@_draws(Modes)
def _draw_modes(modes: Modes, ax: Any, *, packing: Any = None, mode: int = 0, scale: float | None = None) -> None:
    """Draw one mode on the packing, or the frequencies of all."""
    if packing is None:
        frequency_m = modes.frequency_m
        ax.plot(np.arange(len(frequency_m)), frequency_m, color=COLORS[0], **_POINTS)
        ax.set(xlabel="mode", ylabel=r"angular frequency $\omega$ [1/time]", title="frequencies of the modes")
        ax.locator_params(axis="x", integer=True)
        return
    number = integer("mode", mode, at_least=0, at_most=len(modes.eigenvalue_m) - 1)
    shown = _packing_of("modes", packing)
    _draw_packed(packing, ax, forces=False, bar=False)
    _arrows(ax, shown, modes.displacement_mnd[number], scale)
    ax.set_title(
        rf"mode {number}: $\omega$ = {modes.frequency_m[number]:.4g} [1/time], "
        f"participation {modes.participation_m[number]:.2f}"
    )


@_draws(TiledAnswer, size=SQUARE)
def _draw_tiled(answer: TiledAnswer, ax: Any, *, packing: Any = None, scale: float | None = None) -> None:
    """Draw the fewest copies that unjam, the boxes of each and how they do, or the packing, and say what holds."""
    shown = _packing_of("answer", answer.packing if answer.packing is not None else packing)
    _add_copies(ax, answer, shown, _fills(shown, (), "role"), scale)


def _add_copies(
    ax: Any,
    answer: TiledAnswer,
    packing: Packing,
    fills: tuple[NDArray[np.float64], dict[str, Any]],
    scale: float | None,
) -> None:
    """Draw the packing of an answer, its copies parted by dashed lines, with the motion if there is one."""
    _add_packing(ax, packing, (), fills, drawing.draw_packing(packing), False, "", True, False)
    words = _tiled_words(answer)
    if answer.motion is not None:
        _arrows(ax, packing, answer.motion.displacement_nd, scale)
        words += "\narrows: a motion that unjams"
    if answer.repeats is not None and answer.packing is not None and packing.dimension == 2:
        across = packing.box.lattice_dd.T
        for axis, count in enumerate(answer.repeats):
            for k in range(1, count):
                start = across[axis] * k / count
                ax.plot(*np.stack([start, start + across[1 - axis]]).T, color="#303030", linewidth=0.8, linestyle="--")
    ax.set_title(words)


def _tiled_words(answer: TiledAnswer) -> str:
    """Return what holds of copies, in a line or two of a title."""
    of = "any number of" if answer.repeats is None else " x ".join(map(str, answer.repeats))
    words = f"{of} copies: collectively {answer.collective}, strictly {answer.strict}"
    return words if answer.motion is not None else "\n".join([words, *textwrap.wrap(answer.reason, 80)])


@_draws(Verdict, size=SQUARE)
def _draw_verdict(verdict: Verdict, ax: Any, *, packing: Any = None, scale: float | None = None) -> None:
    """Draw the backbone with the contacts that were judged, rattlers, and the motion that unjams it, if one does."""
    shown = _packing_of("verdict", verdict.packing if packing is None else packing)
    tiled = verdict.tiled
    if tiled is not None and tiled.packing is not None and tiled.packing.particles > shown.particles:
        # one box holds what its copies let go
        rattling = np.tile(verdict.rattlers, math.prod(tiled.repeats or ()))
        _add_copies(ax, tiled, tiled.packing, _role_fills(tiled.packing, (), rattling), scale)
        ax.set_title(f"one box: {_verdict_words(verdict)}\n{ax.get_title()}")
        return
    one, inside = verdict.network, shown.wrapped()
    i_c, j_c = one.i_c, one.j_c
    if shown.shapes.has_orientations:
        # numbers among the backbone particles
        i_c, j_c = (np.flatnonzero(verdict.backbone)[end] for end in (i_c, j_c))
    if len(verdict.rattlers) != shown.particles:
        raise ValueError(
            f"packing must be that of the verdict, of {len(verdict.rattlers)} particles, got {brief(shown)}"
        )
    apart = (inside.position_nd[i_c] + one.vector_cd - inside.position_nd[j_c]) @ shown.box.inverse_dd.T
    image_cd = np.rint(apart).astype(np.int64)
    if np.abs(apart - image_cd).max(initial=0.0) > _SAME:
        raise ValueError(f"packing must be the one of the verdict, got another one: {shown!r:.60}")
    segments, _ = drawing.pair_lines(inside.position_nd, i_c, j_c, image_cd, one.vector_cd)
    drawn = dataclasses.replace(drawing.draw_packing(shown), segment_sed=segments, force_s=np.ones(len(segments)))
    fill_nc, legend = _role_fills(shown, (), verdict.rattlers)
    legend["contacts"] = len(segments) > 0 and shown.dimension == 2
    _add_packing(ax, shown, (), (fill_nc, legend), drawn, True, "", True, True)
    words = _verdict_words(verdict)
    motion = verdict.unjamming_motion
    if motion is not None:
        _arrows(ax, shown, motion.displacement_nd, scale)
        words += "\narrows: a motion that unjams"
        words += ", with a strain of the box" if motion.strain_dd.any() else ""
    if tiled is not None:
        words += f"\n{_tiled_words(tiled)}"
    ax.set_title(words)


def _verdict_words(verdict: Verdict) -> str:
    return f"collectively {verdict.collective}, strictly {verdict.strict}"


@_draws(RigidClusters, size=SQUARE)
def _draw_clusters(clusters: RigidClusters, ax: Any, *, copies: bool = True) -> None:
    """Draw contacts and links in the colors of their rigid clusters, wide where these are over-constrained."""
    packing, parts = clusters.packing, matplotlib_parts()
    fill_nc = np.tile(parts.to_rgb(_PALE), (packing.particles, 1))
    bare = packing.replace(links=Links.none(packing.dimension))
    _add_packing(ax, bare, (), (fill_nc, {}), drawing.draw_packing(bare), False, "", copies, False)
    lines = drawing.cluster_lines(clusters)
    points = ax.get_window_extent().width * 72.0 / ax.figure.dpi / float(np.ptp(ax.get_xlim()))
    # the largest on top
    order = np.argsort(-np.where(lines.cluster_s < 0, len(clusters), lines.cluster_s), kind="stable")
    ax.add_collection(
        parts.LineCollection(
            drawing.projected(lines.segment_sed[order])[..., :2],
            colors=lines.color_sc[order] / 255.0,
            linewidths=2.0 * points * packing.reference_diameter * lines.width_s[order],
            zorder=5.0,
            capstyle="round",
        )
    )
    several = np.flatnonzero(clusters.size_k[:_LISTED] > 2)
    marks = [
        (f"{clusters.size_k[k]} particles", np.array(drawing.RIGID[k % len(drawing.RIGID)]) / 255.0) for k in several
    ]
    handles = [parts.Line2D([], [], color=color, linewidth=2.5, label=name) for name, color in marks]
    handles.append(parts.Line2D([], [], color="#606060", linewidth=5.0, label="over-constrained"))
    ax.legend(handles=handles, frameon=False, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=4)
    ax.set_title(
        f"{counted(len(clusters), 'rigid cluster')}, {counted(clusters.floppy_modes, 'floppy mode')}, "
        f"{counted(clusters.states_of_self_stress, 'state')} of self stress"
    )


@_draws(UnjammingMotion, size=SQUARE)
def _draw_motion(motion: UnjammingMotion, ax: Any, *, packing: Any = None, scale: float | None = None) -> None:
    """Draw the motion that unjams a packing."""
    shown = _packing_of("motion", packing)
    _draw_packed(shown, ax, forces=False, bar=False)
    _arrows(ax, shown, motion.displacement_nd, scale)
    ax.set_title("motion that unjams")


def _packing_of(name: str, given: Any) -> Packing:
    """Return the packing of what is given as one to draw on, a scene or a run among it."""
    found = given if isinstance(given, Packing) else getattr(given, "packing", None)
    if not isinstance(found, Packing):
        raise TypeError(
            f"packing must be the packing of this {name} for pm.plot, pm.plot({name}, packing=packing), "
            f"got {brief(given)}"
        )
    return found


@_draws(Moduli)
def _draw_matrix(moduli: Moduli, ax: Any, *, tangent: str = "cauchy") -> None:
    """Draw a matrix of moduli in Mandel components, its numbers written in."""
    one_of("tangent", tangent, ("cauchy", "energy", "affine"))
    matrix_ee: NDArray[np.float64] = getattr(moduli, tangent)
    parts, largest = matplotlib_parts(), float(np.abs(matrix_ee).max()) or 1.0
    names = ("xx", "yy", r"$\sqrt{2}$xy") if len(matrix_ee) == 3 else (
        "xx", "yy", "zz", r"$\sqrt{2}$yz", r"$\sqrt{2}$xz", r"$\sqrt{2}$xy"
    )  # fmt: skip
    ax.imshow(matrix_ee, cmap="RdBu_r", vmin=-largest, vmax=largest)
    for (row, column), value in np.ndenumerate(matrix_ee):
        # numbers are written in white where the color below is dark
        color = "white" if abs(value) > 0.6 * largest else "black"
        words = f"{value:.3g}" if abs(value) > 1e-10 * largest else "0"
        size = 9 if len(matrix_ee) == 3 else 6.5
        ax.text(column, row, words, ha="center", va="center", color=color, fontsize=size)
    ax.set(xticks=range(len(names)), yticks=range(len(names)), xticklabels=names, yticklabels=names)
    ax.set(xlabel="strain", ylabel="stress")
    ax.grid(visible=False)
    mappable, unit = parts.ScalarMappable(parts.Normalize(-largest, largest), "RdBu_r"), _unit(moduli.dimension)
    ax.figure.colorbar(mappable, ax=ax, shrink=0.75, label=f"modulus ({tangent}) {unit}")
    ax.set_title(f"$B$ = {moduli.bulk_modulus:.4g}, $G$ = {moduli.shear_modulus:.4g} {unit}")


@_draws(PlayedMotion)
def _draw_played(played: PlayedMotion, ax: Any) -> None:
    """Draw how many contacts are left along a motion."""
    ax.plot(played.amplitude_t, played.contacts_t, color=COLORS[0], **_POINTS)
    ax.set(xlabel="amplitude [reference diameter]", ylabel="pairs that touch", title=f"motion: {played.outcome}")


@_draws(StateDensity)
def _draw_states(density: StateDensity, ax: Any, *, log: bool = False, label: str = "") -> None:
    """Draw D(omega)."""
    style = _curve(ax, label)
    if not label:
        ax.stairs(density.density_b, density.edge_b, color=style["color"], fill=True, alpha=0.35)
    ax.stairs(density.density_b, density.edge_b, **style)
    ax.set(xlabel=r"angular frequency $\omega$ [1/time]", ylabel=r"density of states $D(\omega)$ [time]")
    _finish(ax)
    _scale(ax, log)


@_draws(ModeCounts)
def _draw_counts(found: ModeCounts, ax: Any, *, log: bool = False, label: str = "") -> None:
    """Draw numbers of modes against frequencies, uncertain ones as empty marks."""
    order = np.argsort(found.below_v)
    below_v, count_v, certain_v = found.below_v[order], found.count_v[order], found.certain_v[order]
    style = _curve(ax, label)
    ax.plot(below_v, count_v, markevery=certain_v.tolist(), **_POINTS, **style)
    if not certain_v.all():
        empty = {"linestyle": "none", "marker": "o", "markersize": 4.0, "markerfacecolor": "none"}
        ax.plot(below_v[~certain_v], count_v[~certain_v], color=style["color"], **empty)
    ax.set(xlabel=r"angular frequency $\omega$ [1/time]", ylabel=r"modes below $\omega$")
    _finish(ax, f"numbers of {found.available} modes")
    _scale(ax, log)


@_draws(Waves)
def _draw_waves(found: Waves, ax: Any, *, label: str = "") -> None:
    """Draw branches along a path, its corners named; frequencies at wave vectors that are none as points."""
    style = _curve(ax, label)
    name, along_k, corner_k = style.pop("label"), found.along_k, found.corner_k
    on_path = len(corner_k) < len(along_k)
    style |= {"linewidth": 1.0} if on_path else {"linestyle": "none", "marker": "o", "markersize": 3.0}
    for m, frequency_k in enumerate(found.frequency_km.T):
        ax.plot(along_k, frequency_k, label=None if m else name, **style)
    if (found.frequency_km < 0.0).any():
        ax.axhline(0.0, color="#888888", linewidth=0.8)
    ax.set(xlabel="way through the wave vectors [1/length]", ylabel=r"angular frequency $\omega$ [1/time]")
    if on_path:
        for corner in along_k[corner_k]:
            ax.axvline(corner, color="#888888", linewidth=0.8, zorder=0.5)
        ax.set_xticks(along_k[corner_k], [_fractions(one) for one in found.wave_vector_kd[corner_k]])
        ax.set(xlabel="wave vector [reciprocal lattice]", xlim=(along_k[0], along_k[-1]))
    _finish(ax, f"{found.frequency_km.shape[1]} branches")


def _fractions(fraction_d: NDArray[np.float64]) -> str:
    """Return a wave vector in words: whole numbers over small ones where it is that."""
    if not fraction_d.any():
        return "0"
    near = [Fraction(float(one)).limit_denominator(24) for one in fraction_d]
    exact = np.allclose([float(one) for one in near], fraction_d, rtol=0.0, atol=1e-9)
    return f"({', '.join(map(str, near)) if exact else ', '.join(f'{one:.3g}' for one in fraction_d)})"


@_draws(SoundSpeeds, size=SQUARE)
def _draw_speeds(found: SoundSpeeds, ax: Any, *, label: str = "") -> None:
    """Draw the speeds along their direction, with sticks along which the particles move; growing waves as crosses."""
    known = dict(zip(*reversed(ax.get_legend_handles_labels()), strict=True))
    # other directions of what has this label already
    color = known[label].get_color() if label in known else _curve(ax, label)["color"] if label else None
    longest = float(np.abs(found.speed_m).max(initial=0.0))
    stick = 0.12 * longest
    ray_ks = drawing.projected(np.stack([np.zeros_like(found.direction_d), found.direction_d * longest]))
    ax.plot(*ray_ks[:, :2].T, color="#bbbbbb", linewidth=0.6, zorder=1.0)
    for m, (speed, polarization_d) in enumerate(zip(found.speed_m, found.polarization_md, strict=True)):
        tip_d = found.direction_d * abs(speed)
        ends_ks = drawing.projected(np.stack([tip_d - stick * polarization_d, tip_d + stick * polarization_d]))
        tip_s = drawing.projected(tip_d)
        own = color or COLORS[m % len(COLORS)]
        angle = math.degrees(math.acos(min(abs(float(polarization_d @ found.direction_d)), 1.0)))
        words = f"{speed:.4g} [length/time], motion at {angle:.0f}° to the way"
        ax.plot(*ends_ks[:, :2].T, color=own, linewidth=1.2)
        mark = "o" if speed >= 0.0 else "x"
        name = (None if m or label in known else label) if label else words
        ax.plot(*tip_s[:2, None], mark, color=own, markersize=4.0, label=name)
    plane = len(found.direction_d) == 2
    ax.set(xlabel="speed along x [length/time]" if plane else "speed, seen from the side [length/time]")
    ax.set(ylabel="speed along y [length/time]" if plane else "speed [length/time]", aspect="equal")
    reach = 1.1 * max(float(np.abs(np.asarray(one.get_data())).max(initial=0.0)) for one in ax.get_lines()) or 1.0
    ax.set(xlim=(-reach, reach), ylim=(-reach, reach))
    _finish(ax)


# -- structure ------------------------------------------------------------------------------------------------------


@_draws(PairDistribution)
def _draw_pairs(pairs: PairDistribution, ax: Any, *, log: bool = False, label: str = "") -> None:
    """Draw g(r)."""
    ax.plot(pairs.r_b, pairs.g_b, linewidth=1.2, **_curve(ax, label))
    ax.axhline(1.0, color="#888888", linewidth=0.8)
    ax.set(xlabel="distance $r$ [length]", ylabel="pair distribution $g(r)$")
    _finish(ax)
    _scale(ax, log)


@_draws(ShellAverage)
def _draw_shells(
    shells: ShellAverage, ax: Any, *, log: bool = True, label: str = "", quantity: str = "structure factor $S(k)$"
) -> None:
    """Draw S(k) or a spectral density, with errors."""
    style = {"fmt": "o", "markersize": 3.0, "linewidth": 0.9}
    ax.errorbar(shells.k_b, shells.value_b, shells.error_b, **style, **_curve(ax, label))
    ax.set(xlabel="wave number $k$ [1/length]", ylabel=quantity)
    _finish(ax)
    _scale(ax, log)


@_draws(Correlation)
def _draw_correlation(found: Correlation, ax: Any, *, log: bool = False, label: str = "") -> None:
    """Draw a correlation against distance."""
    ax.plot(found.r_b, found.value_b, **_POINTS, **_curve(ax, label))
    ax.axhline(found.mean_square, color="#888888", linewidth=0.8)
    ax.set(xlabel="distance $r$ [length]", ylabel="correlation [value$^2$]")
    _finish(ax)
    _scale(ax, log)


@_draws(MeanSquareDisplacement)
def _draw_mobility(found: MeanSquareDisplacement, ax: Any, *, log: bool = False, label: str = "") -> None:
    """Draw mean square displacements with their errors against time."""
    ax.errorbar(found.time_l, found.msd_l, found.error_l, **_POINTS, **_curve(ax, label))
    ax.set(xlabel="lag [time]", ylabel="mean square displacement [length$^2$]")
    _finish(ax)
    _scale(ax, log)


@_draws(SelfScattering)
def _draw_scattering(found: SelfScattering, ax: Any, *, log: bool = True, label: str = "") -> None:
    """Draw the scattering function against the logarithm of time."""
    ax.errorbar(found.time_l, found.f_l, found.error_l, **_POINTS, **_curve(ax, label))
    ax.axhline(math.exp(-1.0), color="#888888", linewidth=0.8)
    ax.set(xlabel="lag [time]", ylabel=rf"$F_s(k, t)$ at $k$ = {found.wave_number:.4g}")
    _finish(ax)
    if log:
        ax.set_xscale("log")


@_draws(Displacements, size=SQUARE)
def _draw_displacements(found: Displacements, ax: Any, *, packing: Any = None, scale: float | None = None) -> None:
    """Draw nonaffine displacements about their mean, as arrows on the first packing."""
    shown = _packing_of("displacements", packing)
    _draw_packed(shown, ax, forces=False, bar=False)
    _arrows(ax, shown, found.nonaffine_nd - found.drift_d, scale)
    ax.set_title(f"nonaffine displacements, root mean square {math.sqrt(found.mean_square):.3g}")


@_draws(Avalanche, size=SQUARE)
def _draw_avalanche(event: Avalanche, ax: Any, *, scale: float | None = None) -> None:
    """Draw what an avalanche moved, on the packing before it, with a ring around its place."""
    _draw_displacements(event.displacements, ax, packing=event.before, scale=scale)
    place = drawing.projected(event.before.wrapped().position_nd)[event.particle, :2]
    ax.plot(*place, "o", markersize=16.0, markerfacecolor="none", markeredgecolor="black", zorder=8.0)
    ax.set_title(f"avalanche at a strain of {event.strain:.5g}: {event.participation_number:.3g} particles")


@_draws(LocalStrain, size=SQUARE)
def _draw_local_strain(found: LocalStrain, ax: Any, *, packing: Any = None) -> None:
    """Draw the first packing, each particle colored by the logarithm of its D2min."""
    known = found.d2min_n > 0.0
    least = float(found.d2min_n[known].min()) if known.any() else 1.0
    color = np.log10(np.where(known, found.d2min_n, least))
    _draw_packed(_packing_of("local strain", packing), ax, forces=False, color=color, label=r"$\log_{10}$ D2min")


# what may be drawn of coarse fields, and of what it is the density
_FIELDS = {"pressure": "energy", "density": "mass"}


@_draws(CoarseFields, size=SQUARE)
def _draw_fields(found: CoarseFields, ax: Any, *, of: str = "pressure") -> None:
    """Draw a field in the plane, of one cell."""
    one_of("of", of, tuple(_FIELDS))
    if len(found.shape) != 2 or min(found.shape) < 2:
        raise ValueError(f"fields must be on points of a plane to be drawn, got {' x '.join(map(str, found.shape))}")
    value = getattr(found, f"{of}_g").reshape(found.shape)
    place = found.point_gd.reshape(*found.shape, 2)
    # one row and one column more, so that the edges of the cell meet
    i, j = np.meshgrid(*(np.arange(n + 1) for n in found.shape), indexing="ij")
    x, y = (i * place[1, 0, a] + j * place[0, 1, a] for a in (0, 1))
    shown = ax.pcolormesh(x, y, np.pad(value, (0, 1), mode="wrap"), shading="gouraud")
    ax.figure.colorbar(shown, ax=ax, shrink=0.75, label=f"{of} {_unit(2, _FIELDS[of])}")
    ax.set(aspect="equal", title=f"averaged with a width of {found.width:.3g}")
    ax.set_axis_off()


@_draws(ForceDistribution)
def _draw_forces(found: ForceDistribution, ax: Any, *, log: bool = True, label: str = "") -> None:
    """Draw the density of forces over their mean."""
    some = found.density_b > 0.0
    ax.plot(found.middle_b[some], found.density_b[some], **_POINTS, **_curve(ax, label))
    ax.set(xlabel="contact force / mean contact force", ylabel="probability density")
    _finish(ax)
    if log:
        ax.set_yscale("log")


@_draws(ContactStatistics)
def _draw_contacts(found: ContactStatistics, ax: Any) -> None:
    """Draw the shares of particles with so many contacts."""
    ax.bar(np.arange(len(found.count_z)), found.share_z, color=COLORS[0])
    ax.set(xlabel="contacts of a particle", ylabel="share of particles", title=f"mean {found.mean:.3f}, no rattlers")


# -- strain and flow ------------------------------------------------------------------------------------------------


@_draws(QuasistaticShear)
def _draw_quasistatic(run: QuasistaticShear, ax: Any, *, label: str = "") -> None:
    """Draw stress against strain."""
    ax.plot(run.strain_t, run.shear_stress_t, linewidth=1.0, **_curve(ax, label))
    ax.set(xlabel=r"shear strain $\gamma$", ylabel=f"shear stress {_scene_unit(run.packing.dimension)}")
    _finish(ax, f"quasistatic shear: {len(run.avalanches)} avalanches")


@_draws(LocalYield, size=SQUARE)
def _draw_local_yield(found: LocalYield, ax: Any, *, direction: int | None = None) -> None:
    """Draw centers of patches, colored by what they bear more: in the weakest direction, or in that of a number."""
    if direction is None:
        stress_p, along = found.weakest_p, "in the weakest direction"
    else:
        k = integer("direction", direction, at_least=0, at_most=len(found.direction_k) - 1)
        stress_p, along = found.yield_stress_pk[:, k], f"of a flow along {math.degrees(found.direction_k[k]):.3g}°"
    packing, fallen = found.packing, np.isfinite(stress_p)
    _draw_packed(packing, ax, forces=False)
    inside, _ = packing.box.wrap(found.center_pd)
    place = drawing.projected(inside)[fallen, :2]
    shown = ax.scatter(*place.T, c=stress_p[fallen], cmap="viridis_r", edgecolors="black", zorder=8.0)
    ax.figure.colorbar(shown, ax=ax, shrink=0.75, label=f"yield stress {_scene_unit(2)}")
    ax.set_title(f"growth of the stress to the first fall, {along}")


@_draws(Deformation)
def _draw_deformation(run: Deformation, ax: Any, *, component: str | None = None, label: str = "") -> None:
    """Draw a component of the stress, unless named that of the largest given strain, against this strain."""
    loaded, places = run.loaded_component, {name: at for at, name in run.component_names.items()}
    drawn = loaded or "xx" if component is None else one_of("component", component, tuple(places))
    strain_t = np.arange(len(run.strain_tdd)) if loaded is None else run.strain_tdd[:, *places[loaded]]
    ax.plot(strain_t, run.stress_tdd[:, *places[drawn]], linewidth=1.0, **_curve(ax, label))
    unit = _unit(run.packing.dimension)
    ax.set(xlabel="row" if loaded is None else f"strain {loaded}", ylabel=f"stress {drawn} {unit}")
    _finish(ax, "deformation, tension positive")


@_draws(ShearFamilies)
def _draw_families(run: ShearFamilies, ax: Any) -> None:
    """Draw the packing fraction at jamming along the strain, a color for each contact network."""
    family_t = run.family_t
    for number in np.unique(family_t):
        own = family_t == number
        color = COLORS[int(number) % len(COLORS)]
        ax.plot(run.strain_t[own], run.packing_fraction_t[own], ".", color=color, markersize=3.0)
    ax.set(xlabel=r"shear strain $\gamma$", ylabel=r"packing fraction at jamming $\phi_J$")
    ax.set_title(f"{len(np.unique(family_t))} contact networks")
    ax.ticklabel_format(axis="y", useOffset=False)


@_draws(StrainRun)
def _draw_strained(run: StrainRun, ax: Any, *, label: str = "") -> None:
    """Draw stress against strain."""
    ax.plot(run.strain_t, run.shear_stress_t, linewidth=1.0, **_curve(ax, label))
    ax.set(xlabel=r"strain $\gamma$", ylabel=f"shear stress {_unit(run.packing.dimension)}")
    ax.locator_params(axis="x", nbins=5)
    _finish(ax)


@_draws(OscillatoryShear)
def _draw_loop(run: OscillatoryShear, ax: Any, *, label: str = "") -> None:
    """Draw the loop of stress against strain, and say the moduli."""
    _draw_strained(run, ax, label=label)
    if run.moduli is not None:
        _finish(ax, f"$G'$ = {run.moduli.storage:.4g}, $G''$ = {run.moduli.loss:.4g} {_unit(run.packing.dimension)}")


@_draws(Creep)
def _draw_creep(run: Creep, ax: Any, *, log: bool = False, label: str = "") -> None:
    """Draw strain against time."""
    ax.plot(run.time_t, run.strain_t, linewidth=1.2, **_curve(ax, label))
    ax.set(xlabel="time [time]", ylabel=r"strain $\gamma$")
    _finish(ax, f"creep at stress {run.applied_stress:g} {_unit(run.packing.dimension)}")
    _scale(ax, log)


@_draws(PressureShear)
def _draw_at_pressure(run: PressureShear, ax: Any, *, label: str = "") -> None:
    """Draw stress over pressure against strain, and the mean of what is steady."""
    ax.plot(run.strain_t, run.shear_stress_t / run.pressure_t, linewidth=1.0, **_curve(ax, label))
    ratio, error = run.stress_ratio[:2]
    ax.axhline(ratio, color=COLORS[1], linewidth=1.0)
    ax.set(xlabel=r"shear strain $\gamma$", ylabel=r"stress ratio $\mu$")
    _finish(ax, rf"$\mu$ = {value_with_error(ratio, error, '±')} at inertial number {run.inertial_number:.3g}")


@_draws(FlowCurve)
def _draw_flow(curve: FlowCurve, ax: Any, *, log: bool = True, label: str = "") -> None:
    """Draw stress against rate."""
    style = {"fmt": "o-", "markersize": 4.0}
    ax.errorbar(curve.rate_r, curve.stress_r, curve.stress_error_r, **style, **_curve(ax, label))
    ax.set(xlabel=r"shear rate $\dot\gamma$ [1/time]", ylabel=f"shear stress {_unit(curve.runs[0].packing.dimension)}")
    _finish(ax)
    _scale(ax, log)


@_draws(AmplitudeSweep, ShearCurve)
def _draw_moduli(sweep: AmplitudeSweep | ShearCurve, ax: Any, *, log: bool = True, label: str = "") -> None:
    """Draw G' and G'' against amplitude."""
    lines = ax.get_lines()
    color = COLORS[len(lines) // 2 % len(COLORS)] if label else None
    for k, (name, value, error) in enumerate(
        (
            ("$G'$", sweep.storage_a, sweep.storage_error_a),
            ("$G''$", sweep.loss_a, sweep.loss_error_a),
        )
    ):
        error = np.where(np.isfinite(error), error, 0.0)
        words = f"{name} {label}".strip()
        style = {"marker": MARKERS[k], "linestyle": "-" if k == 0 else "--", "color": color or COLORS[k]}
        seen = np.where(value > 0.0, value, np.nan) if log else value
        ax.errorbar(sweep.amplitude_a, seen, error, markersize=4.0, linewidth=1.2, label=words, **style)
        if log:
            _add_negative(ax, sweep.amplitude_a, value, words, style)
    unit = _unit(sweep.runs[0].packing.dimension if isinstance(sweep, AmplitudeSweep) else None)
    ax.set(xlabel=r"strain amplitude $\gamma_0$", ylabel=f"modulus {unit}")
    ax.legend(frameon=False)
    _scale(ax, log)


def _add_negative(
    ax: Any, x_k: NDArray[np.float64], value_k: NDArray[np.float64], name: str, style: dict[str, Any]
) -> None:
    """Draw the size of negative values, which a logarithmic axis has no place for, as empty marks."""
    below = value_k < 0.0
    if below.any():
        empty = {**style, "linestyle": "none", "markersize": 4.0, "markerfacecolor": "none"}
        ax.plot(x_k[below], -value_k[below], label=f"$-${name} (negative)", **empty)


@_draws(ShearSeries)
def _draw_series(series: ShearSeries, ax: Any, *, log: bool = True) -> None:
    """Draw the moduli of each control and friction."""
    for curve in series.curves:
        friction = "" if curve.friction is None else rf" $\mu$ = {curve.friction:g}"
        _draw_moduli(curve, ax, log=log, label=f"{curve.control}{friction}")


@_draws(ComplexModulus)
def _draw_spectrum(found: ComplexModulus, ax: Any, *, log: bool = True) -> None:
    """Draw G' and G'' against frequency."""
    for k, (name, value) in enumerate((("$G'$", found.storage_f), ("$G''$", found.loss_f))):
        style = {"color": COLORS[k], "marker": MARKERS[k]}
        seen = np.where(value > 0.0, value, np.nan) if log else value
        ax.plot(found.frequency_f, seen, label=name, markersize=4.0, **style)
        if log:
            _add_negative(ax, found.frequency_f, value, name, style)
    ax.set(xlabel="frequency [1/time]", ylabel=f"modulus {_unit(found.stress_fdd.shape[-1])}")
    ax.legend(frameon=False)
    _scale(ax, log)


@_draws(Cementing)
def _draw_cementing(found: Cementing, ax: Any) -> None:
    """Draw bulk and shear moduli against the share of contacts that are links."""
    for k, name in enumerate(("bulk_modulus", "shear_modulus")):
        value_k = np.array([getattr(found.hill(step), name) for step in range(len(found.cemented_k))])
        finite = np.isfinite(value_k) & (value_k > 0.0)
        words = name.replace("_", " ")
        ax.plot(found.link_fraction_k[finite], value_k[finite], color=COLORS[k], label=f"{words} (Hill)", **_POINTS)
    for reached, words, line in ((found.first_stiff, "first stiff", ":"), (found.all_stiff, "rigid", "--")):
        if reached is not None:
            ax.axvline(reached / found.bearing, color="#666666", linestyle=line, linewidth=1.0, label=words)
    ax.set(xlabel="links per particle $n_l/N$", ylabel=f"modulus {_unit(found.packing.dimension)}", yscale="log")
    ax.margins(x=0.05)
    ax.legend(frameon=False)


# -- ensembles, accuracy, traces ------------------------------------------------------------------------------------


@_draws(GroupStatistics)
def _draw_groups(
    groups: GroupStatistics,
    ax: Any,
    *,
    over: str | None = None,
    fit: PowerLawFit | bool | None = None,
    log: bool | None = None,
    label: str = "",
) -> None:
    """Draw a statistic over a parameter, a line for each value of the others, and the power law of all (`fit`)."""
    names = list(groups.by)
    axis = names[0] if over is None and names else one_of("over", over, names)
    others = [name for name in names if name != axis]
    keys = list(zip(*(groups.by[name].tolist() for name in others), strict=True)) or [()] * len(groups.value_g)
    lines = list(dict.fromkeys(keys))
    for key in lines:
        members = np.array([one == key for one in keys])
        words = [f"{name.rpartition('.')[2]} = {in_words(value)}" for name, value in zip(others, key, strict=True)]
        style = _curve(ax, ", ".join([*([label] if label else []), *words]))
        style |= {"fmt": MARKERS[COLORS.index(style["color"]) % len(MARKERS)] + "-", "markersize": 4.0, "capsize": 2.0}
        x, value, error = groups.by[axis][members].astype(float), groups.value_g[members], groups.error_g[members]
        ax.errorbar(x, value, error, **style)
    if isinstance(fit, bool):
        fit = fit_power_law(groups.by[axis], groups.value_g, groups.error_g) if fit else None
    if fit is not None:
        instance("fit", fit, PowerLawFit)
        x = np.geomspace(float(groups.by[axis].min()), float(groups.by[axis].max()), 100)
        fitted = f"exponent {value_with_error(fit.exponent, fit.exponent_error, '±')}"
        if fit.limit:
            fitted = f"limit {value_with_error(fit.limit, fit.limit_error, '±')}, exponent {fit.exponent:.3g}"
        color = style["color"] if len(lines) == 1 else "#444444"
        ax.plot(x, fit.limit + fit.prefactor * x**fit.exponent, color=color, linestyle="--", label=fitted)
    drawn, own = ax.get_ylabel(), f"{groups.statistic} of {groups.name.replace('_', ' ')}"
    ax.set(
        xlabel=axis.rpartition(".")[2].replace("_", " "),
        ylabel=own if not drawn else drawn if own in drawn.split("; ") else f"{drawn}; {own}",
    )
    _finish(ax)
    _scale(ax, fit is not None if log is None else log)


@_draws(Histogram)
def _draw_histogram(found: Histogram, ax: Any, *, log: bool = False, label: str = "", quantity: str = "value") -> None:
    """Draw a density with its errors from counting."""
    style = _curve(ax, label)
    ax.stairs(found.density_b, found.edge_b, fill=True, alpha=0.35, **style)
    middle = 0.5 * (found.edge_b[1:] + found.edge_b[:-1])
    ax.errorbar(middle, found.density_b, found.error_b, fmt="none", color=style["color"], linewidth=1.0)
    ax.set(xlabel=quantity, ylabel="probability density")
    _finish(ax)
    _scale(ax, log, across=False)


@_draws(WorkPrecision)
def _draw_accuracy(found: WorkPrecision, ax: Any, *, over: str = "time") -> None:
    """Draw errors against CPU time or the setting: a color for each method, a mark for each quantity."""
    one_of("over", over, ("time", "setting"))
    several = len(found.quantities) > 1
    for k, method in enumerate(found.methods):
        for q, name in enumerate(found.quantities):
            trials = [one for one in found.of(method) if not one.failed and name in one.errors]
            if not trials:
                continue
            error = [one.errors[name] for one in trials]
            across = [one.seconds if over == "time" else one.setting for one in trials]
            mark = MARKERS[(q if several else k) % len(MARKERS)]
            label = ", ".join(filter(None, (method, error_heading(name) if several else ""))) or None
            ax.plot(across, error, color=COLORS[k % len(COLORS)], marker=mark, markersize=4.0, label=label)
    axis = "error" if several or not found.quantities else error_heading(found.quantities[0])
    words = "CPU time [s]" if over == "time" else found.knob
    ax.set(xlabel=words, ylabel=axis, xscale="log", yscale="log", title=found.title)
    if ax.get_legend_handles_labels()[1]:
        ax.legend(frameon=False)


@_draws(EnergyLedger)
def _draw_ledger(ledger: EnergyLedger, ax: Any) -> None:
    """Draw kinetic, stored and dissipated energies on each other, and the energy at the start with the work done."""
    named = {
        "kinetic": ledger.kinetic_t,
        **{f"stored: {name}": curve for name, curve in ledger.stored.items()},
        **{f"lost: {name}": curve for name, curve in ledger.dissipated.items()},
    }
    # potentials may be negative: what is drawn is what was gained since they were lowest
    heights = [curve - min(float(curve.min()), 0.0) for curve in named.values()]
    colors = [COLORS[k % len(COLORS)] for k in range(len(heights))]
    labels = [name.replace("_", " ") for name in named]
    ax.stackplot(ledger.time_t, heights, labels=labels, colors=colors, alpha=0.6, linewidth=0.0)
    start = sum(float(height[0]) for height in heights)
    ax.plot(ledger.time_t, start + ledger.work_t, color="black", linewidth=1.2, label="start + work")
    ax.set(xlabel="time [time]", ylabel="energy [energy]", title="")
    ax.legend(frameon=False, fontsize="small", loc="upper left")


@_draws(Trace)
def _draw_trace(trace: Trace, ax: Any, *, of: str = "energy", log: bool = False, label: str = "") -> None:
    """Draw an observable against step, or time where there is one."""
    columns = trace.columns()
    name = of.removesuffix("_t")
    if name not in columns or columns[name].ndim != 1:
        known = [one for one, column in columns.items() if column.ndim == 1]
        raise ValueError(f"of must be one of {', '.join(known)}, got {brief(of)}{did_you_mean(name, known)}")
    axis = "time" if "time" in columns else "step"
    ax.plot(columns[axis], columns[name], **_POINTS, **_curve(ax, label))
    _finish(ax)
    ax.set(xlabel="time [time]" if axis == "time" else "step", ylabel=name.replace("_", " "))
    _scale(ax, log, across=False)


def _scale(ax: Any, log: bool, *, across: bool = True) -> None:
    if log:
        ax.set_yscale("log")
        if across:
            ax.set_xscale("log")
            _thin_ticks(ax.xaxis)


def _thin_ticks(axis: Any) -> None:
    """Leave 2 and 5 of the numbers between powers of ten, and none where there are two decades: they would overlap."""

    def words(x: float, _: int) -> str:
        low, high = axis.get_view_interval()
        power = math.floor(math.log10(x) + 1e-9)
        digit = round(x / 10.0**power)
        return rf"${digit}\times10^{{{power}}}$" if digit in (2, 5) and high < 100.0 * low else ""

    axis.set_minor_formatter(words)
