"""What a simulation kept on its way, as the columns of a trace and as the arrays of a checkpoint."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.dynamics.march.touching import Touching
from packmech.dynamics.motion import Sight
from packmech.dynamics.simulation import MotionTrace


class Scenery(NamedTuple):
    """What else is kept with the positions of a march: (d, d) lattice vectors, (N, k) spins, contacts."""

    lattice_dd: NDArray[np.float64]
    spin_nk: NDArray[np.float64] | None
    touching: Touching


def trace_of_sights(
    kept: Sequence[tuple[int, Sight]],
    position_t: list[NDArray[np.float64]] | None,
    velocity_t: list[NDArray[np.float64]],
    scenery: Sequence[Scenery],
) -> MotionTrace:
    """Return figures by step, at least those of one, as columns.

    Parameters
    ----------
    kept
        Steps and figures.
    position_t, velocity_t
        (N, d) arrays at each of the steps; no positions where they were not asked for.
    scenery
        What came with them in a march; empty otherwise.

    """
    step, sights = zip(*kept, strict=True)

    def column(name: str) -> Any:
        found = [getattr(now, name) for now in sights]
        return None if found[0] is None else np.array(found)

    d = len(sights[0].stress_dd)
    marched = sights[0].overall_stress_dd is not None
    angular = column("angular_momentum_k")
    turning = bool(scenery) and scenery[0].spin_nk is not None
    return MotionTrace(
        step_t=np.array(step, dtype=np.int64),
        energy_t=column("energy"),
        pressure_t=np.array([(0.0 - float(np.trace(now.stress_dd))) / d for now in sights]),
        contacts_t=column("contacts").astype(np.int64),
        max_force_t=column("max_force"),
        position_tnd=None if position_t is None else np.array(position_t),
        lattice_tdd=np.array([one.lattice_dd for one in scenery]) if scenery else None,
        time_t=column("time"),
        kinetic_t=column("kinetic"),
        momentum_td=column("momentum_d"),
        stress_tdd=column("stress_dd"),
        kinetic_stress_tdd=column("kinetic_stress_dd"),
        link_error_t=column("link_error"),
        overall_stress_tdd=column("overall_stress_dd") if marched else column("stress_dd"),
        strain_t=column("strain"),
        strain_rate_t=column("strain_rate"),
        sliding_t=column("sliding").astype(np.int64),
        velocity_tnd=None if position_t is None else np.array(velocity_t),
        torque_stress_tdd=column("torque_stress_dd"),
        spin_stress_tdd=column("spin_stress_dd"),
        bond_stress_tdd=column("bond_stress_dd"),
        tangential_t=column("tangential"),
        rotational_t=column("rotational"),
        # in a plane only the last component is anything
        angular_momentum_tk=angular if angular is None or d == 3 else angular[:, 2:],
        spin_tnk=np.array([one.spin_nk for one in scenery]) if turning else None,
        touching_t=tuple(one.touching for one in scenery) if scenery else None,
    )


def sight_arrays(sights: Sequence[Sight]) -> dict[str, NDArray[Any]]:
    """Return the figures of several moments stacked, by name; what all of them lack is left out."""
    columns = {name: [getattr(one, name) for one in sights] for name in Sight._fields}
    return {f"sight_{name}": np.array(column) for name, column in columns.items() if column[0] is not None}


def sights_of(arrays: Mapping[str, Any]) -> list[Sight]:
    """Return the figures of several moments from what `sight_arrays` returned."""
    columns = {name: arrays[f"sight_{name}"] for name in Sight._fields if f"sight_{name}" in arrays}
    plain = {name: column if column.ndim > 1 else column.tolist() for name, column in columns.items()}
    return [Sight(**{name: column[t] for name, column in plain.items()}) for t in range(len(arrays["sight_time"]))]


def scenery_arrays(kept: Sequence[Scenery]) -> dict[str, NDArray[Any]]:
    """Return what was kept of several moments, contacts one moment after the other, by name."""
    if not kept:
        return {}
    arrays: dict[str, NDArray[Any]] = {"scenery_lattice_tdd": np.array([one.lattice_dd for one in kept])}
    if kept[0].spin_nk is not None:
        arrays["scenery_spin_tnk"] = np.array([one.spin_nk for one in kept])
    arrays["scenery_count_t"] = np.array([len(one.touching.i_c) for one in kept], dtype=np.int64)
    for name in Touching._fields:
        arrays[f"scenery_{name}"] = np.concatenate([getattr(one.touching, name) for one in kept])
    return arrays


def sceneries(arrays: Mapping[str, Any]) -> list[Scenery]:
    """Return what `scenery_arrays` took, moment by moment."""
    if "scenery_count_t" not in arrays:
        return []
    ends = np.cumsum(arrays["scenery_count_t"])[:-1]
    parts = [np.split(arrays[f"scenery_{name}"], ends) for name in Touching._fields]
    spin = arrays.get("scenery_spin_tnk")
    return [
        Scenery(lattice, None if spin is None else spin[t], Touching(*(part[t] for part in parts)))
        for t, lattice in enumerate(arrays["scenery_lattice_tdd"])
    ]
