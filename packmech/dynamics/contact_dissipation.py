"""What contacts dissipate at one moment, one by one and channel by channel."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from packmech.calls.display import shown
from packmech.calls.honors import honors
from packmech.check import brief, instance
from packmech.dynamics.account import (
    BOX,
    DISSIPATING,
    ROLLED,
    SLIDING,
    STORED,
    TANGENTIAL_DASHPOTS,
    TWISTED,
    Kicks,
    book_each,
    new_account,
)
from packmech.dynamics.book import refuse_unknown
from packmech.dynamics.contact_records import record_contacts
from packmech.dynamics.deformation import OscillatoryStrain, SteadyStrain
from packmech.dynamics.engine import build_engine
from packmech.dynamics.friction import Pace
from packmech.dynamics.integrators import start_of_motion, stiffness_and_damping
from packmech.effects import Mindlin, friction_of
from packmech.minimize.passes.pair_list import listed_pairs
from packmech.scene import Scene

# the time in which springs are seen to give way over the shortest time of a contact [1]
_MOMENT = 1e-2


@shown(lambda found: f"of {len(found.i_c)} contacts and bonds, {found.total:.6g} in all with single particles")
@dataclass(frozen=True, eq=False, kw_only=True)
class ContactDissipation:
    """The power dissipated at each touching pair, then at each bond.

    Attributes
    ----------
    i_c, j_c
        (C,) particles.
    bonded_c
        (C,) which are bonds.
    power
        (C,) powers by channel, named as `EnergyLedger.dissipated` [power].
    single
        Powers of channels of single particles, drag and walls, all together [power].

    """

    i_c: NDArray[np.int64]
    j_c: NDArray[np.int64]
    bonded_c: NDArray[np.bool_]
    power: Mapping[str, NDArray[np.float64]]
    single: Mapping[str, float]

    @property
    def power_c(self) -> NDArray[np.float64]:
        """The (C,) powers of all channels [power]."""
        return sum(self.power.values(), np.zeros(len(self.i_c)))

    @property
    def by_channel(self) -> dict[str, float]:
        """The power of each channel, all contacts together [power]."""
        return {**{name: float(one.sum()) for name, one in self.power.items()}, **self.single}

    @property
    def total(self) -> float:
        """The power of all channels [power]: the rate at which a ledger's `dissipated_t` grows."""
        return sum(self.by_channel.values())


@honors("repulsion kinds damping friction rolling bonds interactions gravity walls drag held shapes breaking")
def contact_dissipation(
    scene: Scene,
    velocity_nd: ArrayLike,
    spin_nk: ArrayLike | None = None,
    *,
    applied_strain: SteadyStrain | OscillatoryStrain | None = None,
) -> ContactDissipation:
    """Return the power that each contact and bond of a moving packing dissipates, by channel.

    Dashpots take coefficient times rate squared. A contact at Coulomb's cap takes the tangential force times its slip,
    less what its spring gains; so do rolling and twisting, all three as they are after a hundredth of the
    shortest time of a contact: an error of the order of a percent. The springs are those of the packing's tangential
    displacements, as runs through time leave them; bonds' are slack.

    Parameters
    ----------
    scene
        The scene, without rigid links and `Mindlin`'s springs.
    velocity_nd
        (N, d) velocities [length/time].
    spin_nk
        (N, 1) spins in a plane, (N, 3) in space [1/time]; none unless given.
    applied_strain
        How the box deforms, taken at its time zero; velocities are then peculiar ones, as in `simulate`.

    Returns
    -------
    ContactDissipation
        Powers, whose sum is the rate at which `EnergyLedger.dissipated_t` grows. Where two bodies touch in
        several places, all count as sliding if one does, so that some per cent of "sliding" and "tangential_dashpots"
        may be the other's; their sum is right.

    Raises
    ------
    TypeError, ValueError
        If an argument is of the wrong kind or out of its bounds.

    Examples
    --------
    >>> import packmech as pm
    >>> pair = pm.Packing([[1.0, 2.0], [1.9, 2.0]], [0.5, 0.5], pm.Box.cubic(4.0, 2))
    >>> scene = pm.Scene(pair, (pm.Repulsion(), pm.ContactDamping(0.2)))
    >>> found = pm.contact_dissipation(scene, [[1.0, 0.0], [-1.0, 0.0]])
    >>> round(found.total, 12)  # 0.2 times the square of the rate, which is 2
    0.8

    """
    instance("scene", scene, Scene)
    refuse_unknown("scene", scene)
    friction = friction_of(scene.effects)
    if friction is not None and isinstance(friction.stiffness, Mindlin):
        raise ValueError(
            f"scene.effects must have no {friction.stiffness!r}, whose springs lose energy as the normal force "
            "changes: not at one moment, but along pm.simulate(..., ledger=True)"
        )
    if applied_strain is not None and not isinstance(applied_strain, SteadyStrain | OscillatoryStrain):
        raise TypeError(
            f"applied_strain must be SteadyStrain(...), OscillatoryStrain(...) or None, got {brief(applied_strain)}"
        )
    velocity, spin, _ = start_of_motion(scene.packing, velocity_nd, spin_nk, None)
    stiff, damped, drag = stiffness_and_damping(scene)
    mass = float(scene.packing.mass_n.min())
    moment = _MOMENT / (max(math.sqrt(stiff / mass), damped / mass + drag) or 1.0)
    engine = build_engine(
        scene,
        dt=moment,
        velocity_nd=velocity,
        spin_nk=spin,
        profile=None if applied_strain is None else applied_strain.profile(),
        direction_dd=None if applied_strain is None else applied_strain.direction(scene.packing.dimension),
    )
    engine.begin()
    seen, bonds = record_contacts(engine.system, engine.now), engine.space.bonds
    i, j, _ = listed_pairs(engine.pairs)
    if bonds is not None:
        i, j = np.concatenate([i, bonds.i_b]), np.concatenate([j, bonds.j_b])
    pairs, kicks = len(seen.touching_p), Kicks(moment, 0.0, True)

    def powers(before: float) -> NDArray[np.float64]:
        account = new_account(engine.state.body, engine.state.push.shape[1], len(i) + 1)
        stretch = None if seen.stretch_pk is None else seen.stretch_pk.copy()
        book_each(engine.system, account._replace(spring_pk=stretch), kicks, Pace(before, 0.0), pairs)
        return account.part_bk[:, STORED:BOX] / moment

    power = powers(0.0)
    # what gives way under its cap is seen only as it moves
    engine.advance(1)
    later = powers(moment)
    damped, slid = TANGENTIAL_DASHPOTS - STORED, SLIDING - STORED
    slides = later[:, slid] != 0.0
    power[:, damped] = np.where(slides, later[:, damped], power[:, damped] + power[:, slid])
    power[:, slid] = later[:, slid]
    for channel in (ROLLED - STORED, TWISTED - STORED):
        power[:, channel] = later[:, channel]
    bonded = np.arange(len(i)) >= pairs
    acting = bonded | (np.concatenate([seen.touching_p, np.ones(len(i) - pairs, dtype=np.int64)]) > 0)
    at_contacts, single = power[1:][acting], power[0]
    return ContactDissipation(
        i_c=engine.order_n[i[acting].astype(np.int64)],
        j_c=engine.order_n[j[acting].astype(np.int64)],
        bonded_c=bonded[acting],
        power={name: one for name, one in zip(DISSIPATING, at_contacts.T.copy(), strict=True) if one.any()},
        single={name: float(one) for name, one in zip(DISSIPATING, single, strict=True) if one != 0.0},
    )
