"""Discs that are ready for an experiment: drawn with a seed, then relaxed by the preset's own steps.

The reference package draws from an unseeded generator on whole micrometers, and flips a coin for every size. Here the
draw is seeded and uniform and the sizes are half and half; the stages of the relaxation follow the package's, shortened
as in its tests.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from packmech import check
from packmech.dynamics.particle_shear.advance import StepRules, advance
from packmech.dynamics.particle_shear.constants import disc_radii
from packmech.dynamics.particle_shear.discs import Discs
from packmech.dynamics.particle_shear.experiment import ParticleShear
from packmech.dynamics.particle_shear.material import Material

_LONGEST = 0.25


def _relax(discs: Discs, experiment: ParticleShear, material: Material, steps: int) -> Discs:
    """Return the discs after the package's free stages: without plates, long strongly cooled steps first."""
    final = experiment.time_step
    step, cooling = _LONGEST * experiment.tau / experiment.size_ratio, 0.5
    frictionless = material._replace(friction_coefficient=0.0)
    while step > final:
        discs = advance(discs, frictionless, StepRules(step, cooling, plates=False), np.zeros(steps)).final
        discs = discs.replace(velocity_nd=discs.velocity_nd - discs.velocity_nd.mean(axis=0))
        step, cooling = step / 2.0, (1.0 + cooling) / 2.0
    for made in (frictionless, material):
        discs = advance(discs, made, StepRules(final, plates=False), np.zeros(steps)).final
    return discs


def _settle(discs: Discs, experiment: ParticleShear, material: Material, steps: int) -> Discs:
    """Return the discs after the package's stages with plates, ending with the experiment's own cooling."""
    step, cooling = _LONGEST * experiment.tau / experiment.size_ratio, 0.5
    while step > experiment.time_step:
        discs = advance(discs, material, StepRules(step, cooling), np.zeros(max(steps // 2, 1))).final
        step, cooling = step / 2.0, (1.0 + cooling) / 2.0
    discs = advance(discs, material, StepRules(experiment.time_step, 0.98), np.zeros(2 * steps)).final
    return advance(discs, material, experiment.rules, np.zeros(steps)).final


def bond_fragments(discs: Discs, centers: int, rng: np.random.Generator) -> Discs:
    """Return the discs with every contact bonded whose two discs have the same nearest center of those drawn.

    Parameters
    ----------
    discs
        Discs in contact, in an unstrained cell.
    centers
        How many centers to draw; 0 bonds every contact.
    rng
        Where they are drawn from.

    """
    check.instance("discs", discs, Discs)
    count = check.integer("centers", centers, at_least=0)
    check.instance("rng", rng, np.random.Generator, "a numpy")
    size = np.array([discs.width, discs.height])
    owner_n = np.zeros(discs.discs, dtype=np.int64)
    if count:
        apart = discs.position_nd[:, None] - rng.random((count, 2)) * size
        apart -= np.round(apart / size) * size
        owner_n = np.argmin((apart**2).sum(axis=2), axis=1)
    same_c = owner_n[discs.contact_ck[:, 0]] == owner_n[discs.contact_ck[:, 1]]
    history_ck = np.where(same_c[:, None], 0.0, discs.history_ck)
    return discs.replace(kind_c=np.where(same_c, "bond", discs.kind_c), history_ck=history_ck)


def prepared_discs(
    experiment: ParticleShear, *, seed: int, centers: int | None = None, steps: int = 30, width: float = 500.0
) -> Discs:
    """Return relaxed discs for an experiment, at time 0, with plates at the top and the bottom.

    Parameters
    ----------
    experiment
        Says how many discs, of which sizes, and what their contacts are.
    seed
        Of the draw; the same seed gives the same bits.
    centers
        Number of centers of bonded fragments, 0 for one bulk; left out there are no bonds.
    steps
        Steps of each stage; the package takes 300 and its tests 30.
    width
        Side of the square cell [um].

    Examples
    --------
    >>> discs = prepared_discs(ParticleShear(particles=20), seed=1, steps=5)
    >>> discs.discs, discs.time, discs.strain
    (20, 0.0, 0.0)

    """
    check.instance("experiment", experiment, ParticleShear)
    check.integer("steps", steps, at_least=1)
    rng = np.random.default_rng(check.integer("seed", seed, at_least=0))
    count = experiment.particles
    large, small = disc_radii(
        count, experiment.packing_fraction, size_ratio=experiment.size_ratio, width=width, height=width
    )
    radius_n = np.where(rng.permutation(count) < count / 2, large, small)
    # the package's masses: the model's at the mean radius of the two sizes
    mass_n = experiment.mass * radius_n**2 / (large * small)
    discs = Discs(rng.random((count, 2)) * width, radius_n, mass_n, width=width, height=width)
    material = experiment.material
    discs = _relax(discs, experiment, material, steps)
    if centers is not None:
        discs = _relax(bond_fragments(discs, centers, rng), experiment, material, steps)
    discs = _settle(discs, experiment, material, steps)
    return dataclasses.replace(discs, time=0.0)
