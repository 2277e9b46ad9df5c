"""Newton's method that only goes down: for soft packings whose contacts change, or that must leave a saddle.

Where the Hessian has unstable directions every coordinate is tied until it has none; steps are halved until the
enthalpy falls.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.contacts.network import Contacts, pair_contacts
from packmech.minimize.energy_change import energy_change
from packmech.minimize.soft_network import REACH, SoftNetwork, Units
from packmech.minimize.soft_newton import SoftState, network_of, newton, rounding_floor
from packmech.packing import Packing

_ARMIJO = 1e-4
_HALVINGS = 3
# ties on every coordinate, in units of the mean stiffness of a contact: a trace always, more where it is unstable
_TRACE, _FIRST, _MOST = 1e-10, 1e-9, 1e3
# after a good step the tie is loosened, after a bad one tightened
_LOOSER, _TIGHTER = 0.3, 10.0
# falling back onto the floor of a valley: tie on what is soft, and how often
_STIFF, _CORRECTIONS = 1e-2, 3
# Newton's method without safeguards goes on from here
_NEAR = 1e-7


class _Step(NamedTuple):
    u_nd: NDArray[np.float64]
    strain_k: NDArray[np.float64]
    slope: float


def enthalpy_change(network: SoftNetwork, near: Contacts, packing: Packing, volume: float) -> float:
    """Return the enthalpy of the packing less that of the one in which `near` lists touching and near pairs.

    Parameters
    ----------
    network
        The pairs, units and pressure.
    near
        All pairs of the network where the step started.
    packing
        Where it ended.
    volume
        Volume where it started.

    """
    after = pair_contacts(packing, *network.pairs)
    total = energy_change(
        near.vector_cd,
        after.vector_cd - near.vector_cd,
        near.contact_distance_c,
        lambda distance, sigma: network.units.derivatives(distance, sigma)[0],
    )
    return total + (network.pressure * (packing.box.volume - volume) if network.volume is None else 0.0)


def descend(
    packing: Packing,
    units: Units,
    basis_kdd: NDArray[np.float64],
    pressure: float | None,
    *,
    iterations: int = 200,
    watch: Callable[[Packing], None] | None = None,
) -> SoftState:
    """Return the packing at the bottom that Newton's method reaches going down, in reduced units.

    Parameters
    ----------
    packing, units, basis_kdd, pressure
        As in `newton`.
    iterations
        Most iterations, those of the last digits not counted.
    watch
        Called with the packing after each accepted step.

    """
    network = network_of(packing, units, basis_kdd, pressure)
    tie, used, looks = _TRACE, 0, 1
    travelled = 0.0
    while used < iterations and np.isfinite(network.merit) and network.merit > max(_NEAR, rounding_floor(network)):
        used += 1
        found = _downhill(network, tie)
        if found is None:
            break
        step, tie = found
        start, merit = network.packing, network.merit
        longest = float(np.abs(step.u_nd).max()) + float(np.abs(step.strain_k).max(initial=0.0))
        size = min(1.0, 0.5 * REACH / max(longest, 1e-300))
        travelled += size * longest
        if travelled > 0.8 * REACH:
            network = network_of(start, units, basis_kdd, pressure)
            travelled = size * longest
        near = pair_contacts(start, *network.pairs)
        volume = start.box.volume
        for halving in range(_HALVINGS):
            network.packing = start
            network.measure(network.moved(size * step.u_nd, size * step.strain_k))
            looks += 1
            fall = _ARMIJO * size * step.slope
            lower = enthalpy_change(network, near, network.packing, volume) <= fall
            for _ in range(0 if lower else _CORRECTIONS):
                # a long way along a soft valley leaves its floor by the square of the way: let what is stiff fall back
                back = _downhill(network, _STIFF)
                if back is None:
                    break
                network.measure(network.moved(back[0].u_nd, back[0].strain_k))
                looks += 1
                lower = enthalpy_change(network, near, network.packing, volume) <= fall
                if lower:
                    break
            if lower:
                tie = tie if halving else max(_LOOSER * tie, _TRACE)
                break
            if network.merit < 0.3 * merit and merit < 1e-3:
                break
            size *= 0.5
        else:
            network.measure(start)
            tie = max(_TIGHTER * tie, _FIRST)
            if tie > _MOST:
                break
            continue
        if watch is not None:
            watch(network.packing)
    end = newton(network.packing, units, basis_kdd, pressure)
    return replace(end, iterations=end.iterations + used, evaluations=end.evaluations + looks)


def _downhill(network: SoftNetwork, tie: float) -> tuple[_Step, float] | None:
    """Return Newton's step with as much tie as makes it go down, and that tie."""
    mean = float(np.abs(network.second_c).mean()) if len(network.second_c) else 0.0
    while tie <= _MOST and mean > 0.0:
        try:
            u_nd, strain_k, negative = network.direction(tie * mean)
        except np.linalg.LinAlgError:
            negative = 1
        if negative == 0:
            slope = float((network.uphill_nd * u_nd).sum() + network.uphill_k @ strain_k)
            if slope < 0.0 and np.isfinite(slope):
                return _Step(u_nd, strain_k, slope), tie
        tie = max(10.0 * tie, _FIRST)
    return None
