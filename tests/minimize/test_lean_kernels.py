"""Loops of the engine count no references: what they do is what loops that count them do."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest

import packmech as pm
from packmech.dynamics.deformation import Ramp
from packmech.dynamics.engine import Engine, build_engine
from packmech.dynamics.observables import COLUMNS, measure, new_ledger

SHEAR = np.array([[0.0, 1.0], [0.0, 0.0]])


@pm.law
class SpringOfArrays(NamedTuple):
    """A linear spring that makes an array at every contact, which only loops that count references can do."""

    stiffness: float = 1.0

    def energy(self, distance: float, contact_distance: float) -> float:
        """Return the energy."""
        both = np.array([contact_distance, -distance])
        return 0.5 * self.stiffness * float(both.sum()) ** 2

    def first(self, distance: float, contact_distance: float) -> float:
        """Return the first derivative."""
        both = np.array([contact_distance, -distance])
        return -self.stiffness * float(both.sum())

    def second(self, distance: float, contact_distance: float) -> float:
        """Return the second derivative."""
        return self.stiffness


def an_engine(law: object) -> Engine:
    """Return an engine that shears thirty discs under a law."""
    packing = pm.random_packing(30, dimension=2, packing_fraction=0.9, seed=3)
    profile = Ramp(0.0, 0.01, 0.0, np.inf)
    still = np.zeros((30, 2))
    effects = (pm.Repulsion(law=law), pm.ContactDamping(0.3))
    return build_engine(pm.Scene(packing, effects), dt=0.05, velocity_nd=still, profile=profile, direction_dd=SHEAR)


def test_law_that_makes_arrays_steps_as_one_that_makes_none() -> None:
    """A user's law may make arrays: the loops that count references take over."""
    own, built_in = an_engine(SpringOfArrays()), an_engine(pm.LinearSpring())
    for one in (own, built_in):
        one.advance(40)
    assert np.abs(own.positions() - built_in.positions()).max() == pytest.approx(0.0, abs=1e-12)
    assert own.observe() == pytest.approx(built_in.observe(), abs=1e-11)


def test_figures_kept_on_the_way_are_those_seen_there() -> None:
    """A ledger's row holds what `observe` gives at its step."""
    engine, ledger = an_engine(pm.LinearSpring()), new_ledger(10, 2)
    engine.advance(10, ledger)
    seen, again = engine.observe(), np.zeros(COLUMNS)
    assert ledger.row_tk[0] == pytest.approx(seen, abs=1e-13)
    measure(engine.system, engine.time, engine.now, again)
    assert np.array_equal(seen, again)


def test_law_that_makes_arrays_is_relaxed_as_one_that_makes_none() -> None:
    packing = pm.random_packing(30, dimension=2, packing_fraction=0.9, seed=3)
    own, built_in = (
        pm.quench(pm.Scene(packing, (pm.Repulsion(law=law),)), force_tolerance=1e-10)
        for law in (SpringOfArrays(), pm.LinearSpring())
    )
    assert own.ok
    assert np.abs(own.packing.position_nd - built_in.packing.position_nd).max() < 1e-12
