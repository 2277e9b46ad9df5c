"""What a batch makes of a scene: the numbers of its minimizer, its bodies, and a start without deep overlaps."""

from __future__ import annotations

from typing import Any, cast

import numpy as np

from packmech.dynamics.joints import row_links
from packmech.dynamics.program import Program, build_program
from packmech.dynamics.stepwise.quench_strain import Bodies
from packmech.effects import Harmonic, Repulsion
from packmech.links import image_offsets
from packmech.measure import packing_fraction
from packmech.scene import Scene

# an overlap [1] at which a law that diverges at the center must not be the one to part the particles
_DEEP = 0.2


def settings_of(method: Any, scene: Scene) -> tuple[Any, float]:
    """Return the record of numbers that a minimizer gives its loop, and its largest step [program.step_unit]."""
    return cast("tuple[Any, float]", method.advance(_Asked(scene), None, None, 0))


class _Asked:
    """Stands in for a program, to learn what a minimizer would tell its loop."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene

    def advance(self, loop: Any, settings: Any, goal: Any, progress: Any, steps: int, largest_step: float) -> Any:
        return settings, largest_step


def bodies_of(program: Program) -> Bodies:
    """Return what is strained and counted as one in a program: clusters of linked rows, or rows."""
    packing = program.scene.packing
    n, d = packing.particles, packing.dimension
    links = program.links
    offset = np.zeros((n, 3))
    if packing.links is None or links is None:
        cluster, winding, freedom = np.arange(n), np.zeros(n, dtype=np.bool_), np.full(n, d)
        i, j, image = np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.int64), np.zeros((0, 3))
    else:
        cluster = packing.links.clusters(n)[program.order_n]
        whole, offsets = row_links(packing.links, program.order_n, program.home_nd, program.change_dd)
        offset[:, :d] = offsets
        winding = image_offsets(packing.links, n)[1][program.order_n].copy()
        freedom = d * np.bincount(cluster) - np.bincount(cluster[links.i_l], minlength=int(cluster.max()) + 1)
        i, j, image = links.i_l.copy(), links.j_l.copy(), np.zeros((len(links), 3))
        image[:, :d] = links.image_ld
    clusters = len(freedom)
    return Bodies(
        cluster_n=np.ascontiguousarray(cluster, dtype=np.int64),
        freedom_c=freedom.astype(np.int64),
        offset_nd=offset,
        winding_n=winding,
        i_l=i,
        j_l=j,
        image_ld=image,
        volume=packing_fraction(packing) * packing.box.volume,
        last_nd=np.zeros((n, 3)),
        last_dd=np.zeros((3, 3)),
        center_cd=np.zeros((clusters, 3)),
        touching_c=np.zeros(clusters, dtype=np.int64),
        loose_c=np.zeros(clusters, dtype=np.bool_),
    )


def soften(program: Program) -> None:
    """Relax deep overlaps with the harmonic law where the scene's own diverges, as pm.quench does."""
    if not program.diverges or program.evaluate().deepest_overlap < _DEEP:
        return
    harmonic = program.scene.replace(effects=(Repulsion(law=Harmonic(energy_scale=program.scene.energy_scale)),))
    program.place(build_program(harmonic).relax(force_tolerance=1e-2).position_nd)
