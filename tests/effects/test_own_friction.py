"""A friction of one's own is refused where it is registered, for no loop would call it."""

from typing import NamedTuple

import pytest

import packmech as pm


def test_a_friction_of_ones_own_is_refused():
    class Sticky(NamedTuple):
        stiffness: float = 1.0

        def tangential_force(self, stretch, slip):
            return self.stiffness * stretch

    with pytest.raises(TypeError, match="Sticky must not define tangential_force: friction is that of Friction alone"):
        pm.effect(Sticky)
