"""Jammed rigid bodies over their shape: dimers over their asymmetry, trimers over their bend.

Packings of rigid bodies are isostatic where shapes are bent enough: one state of self stress, and no floppy modes but
turns that nothing resists. Straight trimers that are alike (N = 64, d = 2, P = 1e-7, five packings) have 12 to 18
states of self stress instead. All but one of them live on the contacts between two bodies alone: trimers lie side by
side, bead against bead (three parallel contacts, which hold a distance and an angle) or beads in the notches of the
other (four or five contacts, which hold three relative coordinates). At 150 degrees there are 4 to 6, of which all but
one live on pairs, in two of five packings but one on three bodies side by side. None of that is a property of
trimers: where radii of beads are larger or smaller by up to 5 percent, each its own, every packing has one state.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, fields
from pathlib import Path

import numpy as np

import packmech as pm
from packmech.contacts.shape_contacts import slopes_of_ends
from packmech.contacts.shape_rattlers import free_turns
from packmech.mechanics.network import contact_network
from packmech.mechanics.self_stress import RANK_TOLERANCE
from packmech.validation.studies.rows import Progress, complete_rows
from packmech.validation.studies.shapes import mean_and_error
from packmech.view.figures import COLORS, MARKERS, styled_figure

DIMER, TRIMER = 2, 3
# the smaller bead's radius over the larger one's; angles between the arms of trimers, straight last [degrees]
ASYMMETRIES = (0.2, 0.4, 0.6, 0.8, 1.0)
ANGLES = (60.0, 90.0, 120.0, 150.0, 180.0)
# beads of a body are this much nearer than where they just touch
_FUSED = 0.8
_START = {2: 0.5, 3: 0.3}


@dataclass(frozen=True)
class JammedBodies:
    """One jammed packing of bodies: what it was asked for, and what came of it.

    `turning_freely` counts the turns that nothing resists, `states_within_pairs` the states of self stress that live on
    the contacts between two bodies alone (`states_within_pairs`). `scatter` is that of the radii of beads.
    """

    dimension: int
    particles: int
    beads: int
    shape: float
    pressure: float
    seed: int
    scatter: float
    packing_fraction: float
    jamming_packing_fraction: float
    coordination_number: float
    rattlers: int
    contacts: int
    isostatic_contacts: int
    floppy_modes: int
    turning_freely: int
    states_of_self_stress: int
    states_within_pairs: int
    certain: int
    residual: float
    seconds: float

    @property
    def settings(self) -> tuple[float, ...]:
        """What it was asked for."""
        return tuple(getattr(self, one.name) for one in fields(self)[:7])


def body_shape(beads: int, shape: float) -> pm.Dimer | pm.Trimer | pm.LinearCluster:
    """Return the dimer of this asymmetry, or the trimer of this angle."""
    if beads == DIMER:
        return pm.Dimer(_FUSED * 0.5 * (1.0 + shape), radii=(0.5, 0.5 * shape))
    if shape == 180.0:
        return pm.LinearCluster(3, _FUSED)
    return pm.Trimer(_FUSED, math.radians(shape))


def _free_turns(packing: pm.Packing) -> int:
    network = contact_network(packing, second=False)
    return len(free_turns(network.packing, network.shape_contacts))


def states_within_pairs(packing: pm.Packing) -> int:
    """Return the number of independent states of self stress that live on the contacts between two bodies alone.

    The contacts of two bodies, number k, depend on 3 relative coordinates in a plane and 6 in space: at least k - 3, or
    k - 6, such states, and more where contacts agree on what they hold.
    """
    network = contact_network(packing, second=False)
    one = network.shape_contacts
    slopes = np.hstack(list(slopes_of_ends(one, network.turn_nkt)))
    pair = np.unique(np.column_stack([one.i_c, one.j_c, one.image_cd]), axis=0, return_inverse=True)[1].ravel()
    found = 0
    for each in np.flatnonzero(np.bincount(pair) > 1):
        value = np.linalg.svd(slopes[pair == each], compute_uv=False)
        found += int((pair == each).sum() - (value > RANK_TOLERANCE * value[0]).sum())
    return found


def scattered_beads(packing: pm.Packing, scatter: float, seed: int) -> pm.Packing:
    """Return the packing of bodies whose beads have radii of their own, evenly spread by this part of them."""
    shapes = packing.shapes
    assert isinstance(shapes, pm.Beads)
    beads = pm.bead_packing(packing)
    factor = 1.0 + scatter * np.random.default_rng(seed).uniform(-1.0, 1.0, beads.particles)
    return pm.rigid_packing(beads.replace(radius_n=beads.radius_n * factor), shapes.particle_b)


def jam_body(
    dimension: int, particles: int, beads: int, shape: float, pressure: float, seed: int, scatter: float
) -> JammedBodies:
    """Return a jammed packing of one shape from a dilute start."""
    start = pm.random_packing(
        particles,
        dimension=dimension,
        packing_fraction=_START[dimension],
        seed=seed,
        shapes=body_shape(beads, shape),
    )
    if scatter > 0.0:
        start = scattered_beads(start, scatter, seed)
    run = pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=pressure, check=False)
    report = run.report
    return JammedBodies(
        *(dimension, particles, beads, shape, pressure, seed, scatter),
        report["packing_fraction"],
        report.get("jamming_packing_fraction", math.nan),
        2.0 * report["contacts"] / (particles - report["rattlers"]),
        report["rattlers"],
        report["contacts"],
        report["isostatic_contacts"],
        report["floppy_modes"],
        _free_turns(run.packing),
        report["states_of_self_stress"],
        states_within_pairs(run.packing),
        int(report.get("rank_certain", False) and run.ok),
        run.residual,
        run.seconds,
    )


def jam_bodies(
    folder: Path,
    *,
    dimension: int,
    particles: int,
    pressure: float,
    seeds: Sequence[int],
    scatter: float,
    progress: Progress[JammedBodies],
    workers: int | None = None,
) -> list[JammedBodies]:
    """Return packings of all shapes and seeds, every strain free; each is a member."""
    shapes = [(DIMER, each) for each in ASYMMETRIES] + [(TRIMER, each) for each in ANGLES]
    wanted = [
        (dimension, particles, *shape, pressure, seed, scatter) for shape, seed in itertools.product(shapes, seeds)
    ]
    return complete_rows(folder / f"bodies-{dimension}d.csv", JammedBodies, wanted, jam_body, progress, workers)


def draw_bodies(found: Sequence[JammedBodies], path: Path) -> None:
    """Write the figure: packing fraction and contacts over asymmetry and bend."""
    with styled_figure(path, (9.0, 6.4)) as figure:
        axes = figure.subplots(2, 2, sharex="col")
        columns = ((DIMER, "radius of the smaller bead over the larger"), (TRIMER, "angle of trimers [degrees]"))
        rows = (("jamming_packing_fraction", "packing fraction at jamming"), ("coordination_number", "contacts a body"))
        for column, (beads, along) in enumerate(columns):
            part = [one for one in found if one.beads == beads]
            shapes = sorted({one.shape for one in part})
            for row, (name, label) in enumerate(rows):
                figures = [
                    mean_and_error([float(getattr(one, name)) for one in part if one.shape == each]) for each in shapes
                ]
                mean, error = np.array(figures).T
                axes[row, column].errorbar(
                    shapes, mean, error, color=COLORS[row], marker=MARKERS[row], markersize=4.0, capsize=2.0
                )
                axes[row, column].set_ylabel(label)
            axes[1, column].set_xlabel(along)
        one = found[0]
        seeds = len({each.seed for each in found})
        scatter = f", radii of beads +- {one.scatter:g}" if one.scatter else ""
        figure.suptitle(
            f"{seeds} packings each of N = {one.particles}, d = {one.dimension}, pressure {one.pressure:g}{scatter}",
            fontsize=10,
        )
