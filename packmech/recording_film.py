"""What a recording holds, before any of it is written: packings at some steps, curves against step. Knows no Rerun."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.contacts import find_contacts
from packmech.links import image_offsets
from packmech.measure import energy, force_balance, pressure
from packmech.measure.rattlers import find_rattlers
from packmech.outcome import Run, Trace
from packmech.packing import Packing
from packmech.records import is_record, to_table
from packmech.scene import Scene

Curve = tuple[NDArray[np.int64], NDArray[np.float64]]

# an eigenvalue this small against the stiffness of a contact belongs to a free motion (a translation, a rattler);
# the softest true mode of a jammed packing of 16,000 discs is at 1e-6 (near jamming, over the contact stiffness)
FREE_MOTION = 1e-9


@dataclass(frozen=True, eq=False)
class Film:
    """Packings at steps step_f, curves (step, value) by name, the effects whose forces are drawn."""

    step_f: NDArray[np.int64]
    packing_f: tuple[Packing, ...]
    effects: tuple[Any, ...]
    curves: Mapping[str, Curve]

    @property
    def final(self) -> Packing:
        """The last packing."""
        return self.packing_f[-1]

    def rattler_n(self) -> NDArray[np.bool_]:
        """Return which particles are rattlers in the last packing; with links, which move apart from its backbone."""
        if self.final.links is None:
            return find_rattlers(self.final)
        from packmech.mechanics.rattling import find_rattling_clusters

        return find_rattling_clusters(self.final).rattling_n


@dataclass(frozen=True, eq=False)
class Motion:
    """A mode to draw: a short name, what to say of it, and (N, d) displacements."""

    name: str
    title: str
    displacement_nd: NDArray[np.float64]


def film_of_packing(subject: Packing | Scene) -> Film:
    """Return the film of one packing: a single picture, and its numbers as curves of one point."""
    if isinstance(subject, Packing):
        curves = {"contacts": _point(len(find_contacts(subject)))}
        return Film(np.array([0]), (subject,), (), curves)
    packing = subject.packing
    values = {"energy": energy(subject), "pressure": pressure(subject), "max force": force_balance(subject)[0]}
    curves = {f"log10 {name}": _point(np.log10(value)) for name, value in values.items() if value > 0.0}
    curves["contacts"] = _point(len(find_contacts(packing)))
    return Film(np.array([0]), (packing,), subject.effects, curves)


def film_of_run(run: Run, scene: Scene, frames: int) -> Film:
    """Return the film of a run: packings evenly chosen from its trace, first and final included, every saved number."""
    trace = run.trace
    if trace is None or trace.position_tnd is None or len(trace.step_t) == 0:
        step_f = np.array([0, max(run.steps, 1)])
        return Film(step_f, (scene.packing, run.packing), scene.effects, {} if trace is None else curves_of(trace))
    count = len(trace.step_t)
    chosen = np.unique(np.rint(np.linspace(0, count - 1, min(frames - 1, count))).astype(int))
    packing_f = [
        scene.packing.replace(
            position_nd=trace.position_tnd[t],
            box=scene.packing.box if trace.lattice_tdd is None else Box(trace.lattice_tdd[t]),
        )
        for t in chosen
    ]
    step_f = trace.step_t[chosen]
    last = max(int(run.steps), int(step_f[-1]) + 1)
    return Film(np.append(step_f, last), (*packing_f, run.packing), scene.effects, curves_of(trace))


def curves_of(trace: Trace) -> dict[str, Curve]:
    """Return what to plot; the viewer has no logarithmic axis, so logarithms are taken here and zeros left out."""
    curves: dict[str, Curve] = {}
    for name, value_t in (("energy", trace.energy_t), ("pressure", trace.pressure_t), ("max force", trace.max_force_t)):
        seen_t = value_t > 0.0
        curves[f"log10 {name}"] = (trace.step_t[seen_t], np.log10(value_t[seen_t]))
    curves["contacts"] = (trace.step_t, trace.contacts_t.astype(float))
    return curves


def trace_of(scene: Scene, step_t: Sequence[int], packing_t: Sequence[Packing]) -> Trace:
    """Return the trace of packings of one scene that were kept on the way, with their energies and forces.

    Packings in which nothing touches are left out.

    Examples
    --------
    >>> import packmech as pm
    >>> crystal = pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.1)
    >>> trace_of(pm.Scene(crystal, (pm.Repulsion(),)), [0], [crystal]).contacts_t.tolist()
    [27]

    """
    # the pairs of a hard packing touch to rounding only: there is no force to draw
    kept = [(step, packing) for step, packing in zip(step_t, packing_t, strict=True) if len(find_contacts(packing)) > 0]
    scenes = [scene.replace(packing=packing) for _, packing in kept]
    if not scenes:
        kept, scenes = [(0, scene.packing)], [scene]
    return Trace(
        step_t=np.array([step for step, _ in kept], dtype=np.int64),
        energy_t=np.array([energy(one) for one in scenes]),
        pressure_t=np.array([pressure(one) for one in scenes]),
        contacts_t=np.array([len(find_contacts(one.packing)) for one in scenes], dtype=np.int64),
        max_force_t=np.array([force_balance(one)[0] for one in scenes]),
        position_tnd=np.array([_in_images_of(scene.packing, one.packing) for one in scenes]),
        lattice_tdd=np.array([one.packing.box.lattice_dd for one in scenes]),
    )


def _in_images_of(start: Packing, packing: Packing) -> NDArray[np.float64]:
    """Return the positions moved by lattice vectors so that links have the images that they have in the start."""
    if start.links is None or packing.links is None or start.links == packing.links:
        return packing.position_nd
    now, _ = image_offsets(packing.links, packing.particles)
    before, _ = image_offsets(start.links, start.particles)
    moved: NDArray[np.float64] = packing.position_nd + (now - before) @ packing.box.lattice_dd.T
    return moved


def motions_of(modes: Any, packing: Packing, stiffness: float, count: int) -> list[Motion]:
    """Return the lowest modes that are no free motions, at most `count` of them.

    Raises
    ------
    TypeError, ValueError
        When the modes are none, or belong to another packing.

    """
    if not hasattr(modes, "displacement_mnd"):
        raise TypeError(f"modes must be what pm.normal_modes returns, got {modes!r}")
    displacement_mnd = np.asarray(modes.displacement_mnd)
    if displacement_mnd.shape[1:] != packing.position_nd.shape:
        raise ValueError(
            f"modes must be those of the packing with positions of shape {packing.position_nd.shape}, "
            f"got displacements of shape {displacement_mnd.shape[1:]}"
        )
    vibrating = np.flatnonzero(np.abs(modes.eigenvalue_m) > FREE_MOTION * stiffness)[:count]
    return [
        Motion(f"mode_{rank}", f"mode {rank}: frequency {modes.frequency_m[m]:.4g}", displacement_mnd[m])
        for rank, m in enumerate(vibrating, start=1)
    ]


def properties_of(film: Film, parameters: Mapping[str, Any], results: Mapping[str, Any]) -> dict[str, Any]:
    """Return what a recording tells of itself: every parameter and result as JSON, and each plain result by name."""
    told = {
        "particles": film.final.particles,
        "dimension": film.final.dimension,
        "effects": [to_table(effect) for effect in film.effects],
        **parameters,
    }
    plain = {name: value for name, value in results.items() if isinstance(value, bool | int | float | str)}
    return {
        "parameters_json": json.dumps(plain_value(told)),
        "results_json": json.dumps(plain_value(results)),
        **plain,
    }


def plain_value(value: Any) -> Any:
    """Return the value as JSON knows it: records as tables, arrays as lists, what has no such form as its text.

    Examples
    --------
    >>> import packmech as pm
    >>> plain_value({"law": pm.Hertz(), "shares": np.array([0.5, 0.5])})
    {'law': {'kind': 'hertz', 'energy_scale': 1.0}, 'shares': [0.5, 0.5]}

    """
    if isinstance(value, np.generic | np.ndarray):
        return value.tolist()
    if is_record(value):  # before the plain tuples, which some records are
        return plain_value(to_table(value))
    if isinstance(value, Mapping):
        return {str(name): plain_value(entry) for name, entry in value.items()}
    if isinstance(value, list | tuple):
        return [plain_value(entry) for entry in value]
    return value if value is None or isinstance(value, bool | int | float | str) else str(value)


def _point(value: float) -> Curve:
    return np.array([0]), np.array([float(value)])
