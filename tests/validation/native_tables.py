"""What native dynamics measures of the scenarios of the reference package, by the names of its tables.

Native conventions: all contacts count, with the branch vector of the nearest image, across the periodic boundary and at
walls like anywhere; the kinetic part stands apart and is off; there is no outer force in a periodic cell. The scenes
that ship are what is run natively. Tensors are compared with compression positive:

==================  ====================================================================================================
name in the tables  natively, with compression positive
==================  ====================================================================================================
love_weber          all contacts and bonds, force times branch vector to the image that touches
overall             that, with torques and spins: symmetric
unbalanced          net forces on particles that are not held, times positions from the cell's center that are
                    unwrapped along contacts
external            forces of held particles on others, times these positions, negative; nothing else is outside
otsuki              the kinetic part, + m u u of velocities relative to the flow and to their mean
centrifugal         the spins' part
==================  ====================================================================================================
"""

from collections import deque
from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from packmech.contacts import find_contacts
from packmech.dynamics.pair_forces import PairForces
from packmech.effects import contact_terms
from packmech.packing import Packing
from packmech.scene import Scene
from packmech.validation import particle_shear as ps

Tensors = Mapping[str, NDArray[np.float64]]


def elastic_pair_forces(scene: Scene) -> PairForces:
    """Return the forces of the contacts of a scene that has no dashpots, friction and bonds."""
    contacts = find_contacts(scene.packing, gap_tolerance=0.0)
    terms = contact_terms(scene.effects, contacts)
    force = terms.first_c[:, None] * contacts.normal_cd
    return PairForces(contacts.i_c, contacts.j_c, force, contacts.vector_cd, np.zeros(len(contacts), dtype=bool))


def unwrapped(packing: Packing, pairs: PairForces) -> NDArray[np.float64]:
    """Return (N, d) positions inside the cell, those that are joined by pairs next to each other."""
    position = packing.box.wrap(packing.position_nd)[0].copy()
    near: list[list[tuple[int, NDArray[np.float64]]]] = [[] for _ in range(packing.particles)]
    for i, j, branch in zip(pairs.i_k.tolist(), pairs.j_k.tolist(), pairs.branch_kd, strict=True):
        near[i].append((j, branch))
        near[j].append((i, -branch))
    placed = np.zeros(packing.particles, dtype=bool)
    for first in range(packing.particles):
        queue = deque([first] if not placed[first] else [])
        while queue:
            i = queue.popleft()
            placed[i] = True
            for j, branch in near[i]:
                if not placed[j]:
                    placed[j] = True
                    position[j] = position[i] + branch
                    queue.append(j)
    return position


def native_tensors(
    packing: Packing,
    pairs: PairForces,
    stress: Mapping[str, NDArray[np.float64]],
    *,
    velocity_nd: NDArray[np.float64],
    held_n: NDArray[np.bool_] | None = None,
    unit: float = 1.0,
) -> dict[str, NDArray[np.float64]]:
    """Return the (d, d) tensors at one time by their names in the tables [Pa], compression positive.

    Parameters
    ----------
    packing
        Positions, masses and box at that time.
    pairs
        The pair forces then.
    stress
        (d, d) tensors of the run at that time, as `StrainRun.stress` names them.
    velocity_nd
        (N, d) peculiar velocities.
    held_n
        (N,) particles that are held.
    unit
        Pa in a unit of the scene's stress.

    """
    held = np.zeros(packing.particles, dtype=bool) if held_n is None else held_n
    place = unwrapped(packing, pairs) - 0.5 * packing.box.lattice_dd.sum(axis=1)
    outside = held[pairs.i_k] != held[pairs.j_k]
    from_outside = PairForces(*(column[outside] for column in pairs)).net(packing.particles)
    share = unit / packing.box.volume
    weight = np.where(held, 0.0, packing.mass_n)[:, None]
    own = velocity_nd - (weight * velocity_nd).sum(axis=0) / weight.sum()
    return {
        "love_weber": -unit * stress["contact"],
        "overall": -unit * stress["overall"],
        "unbalanced": share * pairs.net(packing.particles)[~held].T @ place[~held],
        "external": -share * from_outside[~held].T @ place[~held],
        "otsuki": share * (weight * own).T @ own,
        "centrifugal": -unit * stress["spin"],
    }


def judge_natively(scenario: ps.Scenario, tensors: Tensors) -> dict[str, dict[str, bool]]:
    """Return which native statements hold, by what they are about.

    Parameters
    ----------
    scenario
        Holds the statements.
    tensors
        Of `native_tensors`; momenta as in `particle_shear.judge`, where rows are about them.

    """
    return {
        row.about: {name: ps.STATEMENTS[name](tensors[row.about], tensors) for name in row.native}
        for row in scenario.rows
    }


HEADINGS = ("table", "scenario", "about", "the package's statement", "preset", "native statement", "native", "why")


def table_rows(
    scenario: ps.Scenario, preset: Mapping[str, Mapping[str, bool]], native: Mapping[str, Mapping[str, bool]]
) -> list[tuple[str, ...]]:
    """Return one line for each row of a scenario's table: what is stated for either model, and whether it holds.

    Parameters
    ----------
    scenario
        The scenario.
    preset, native
        What `particle_shear.judge` and `judge_natively` found.

    """
    return [
        (
            scenario.table,
            scenario.name,
            row.about,
            ", ".join(row.states) or "not tested",
            _verdict(preset[row.about], fails=row.fails),
            ", ".join(row.native) or "not tested",
            _verdict(native[row.about]),
            row.because,
        )
        for row in scenario.rows
    ]


def _verdict(found: Mapping[str, bool], *, fails: bool = False) -> str:
    if not found:
        return "-"
    return "holds" if all(found.values()) else "FAILS, as in the package" if fails else "FAILS"
