"""Forces that rigid links carry: the multipliers that leave as little force on the particles as links can."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from packmech.check import instance
from packmech.constraints.factor import ConstraintFactor
from packmech.contacts import find_contacts
from packmech.effects import contact_terms
from packmech.jit.blas import single_thread
from packmech.scene import Scene


def link_tension(scene: Scene) -> NDArray[np.float64]:
    """Return the (L,) forces in the rigid links [force], tension positive, in the order of `packing.links`.

    They are the multipliers t that make |grad U + sum of t grad(length)| least over the positions; for a packing at
    rest the sum vanishes and they are exact. Where links depend on each other (more links than a shape needs) the
    smallest such set is given.

    Parameters
    ----------
    scene
        The scene; without links the answer is empty.

    Raises
    ------
    TypeError
        If it is no scene.

    Examples
    --------
    >>> import packmech as pm
    >>> links = pm.Links([0, 1], [1, 2], [[0, 0], [1, 0]], [1.0, 1.0])
    >>> chain = pm.Packing([[0.0, 0.0], [1.0, 0.0], [-0.9, 0.0]], [0.5] * 3, pm.Box.cubic(2.9, 2), links)
    >>> pm.link_tension(pm.Scene(chain, (pm.Repulsion(),))).round(12).tolist()
    [-0.1, -0.1]

    """
    instance("scene", scene, Scene)
    if scene.packing.links is None:
        return np.zeros(0)
    contacts = find_contacts(scene.packing)
    first = contact_terms(scene.effects, contacts.distance_c, contacts.contact_distance_c).first_c
    with single_thread():
        return ConstraintFactor(scene.packing).tension(contacts, first)
