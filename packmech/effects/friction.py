"""Friction between touching particles: a tangential spring that gives way at Coulomb's limit."""

from __future__ import annotations

from typing import Any, NamedTuple

from packmech.effects.pair import effect


@effect
class Friction(NamedTuple):
    """A tangential spring and dashpot at each contact, whose force is capped at coefficient times the normal force.

    The spring's stretch is the integral of the slip at the contact point since the contact closed, cut back where
    the cap is reached: steady sliding feels coefficient * F_n at once, F_n the elastic normal force without
    dashpots. Arms are the particles' shares of the distance, a_i = r_i d / (r_i + r_j), in the slip and in the torque:
    angular momentum is kept exactly and energy is, where nothing slides and nothing is damped. Cundall and Strack
    (1979), with these arms and this cap.

    Parameters
    ----------
    coefficient
        Coulomb's coefficient mu [1].
    stiffness
        Of the tangential spring [energy/length^2].
    damping
        Of the tangential dashpot [mass/time].

    """

    coefficient: float = 0.5
    stiffness: float = 1.0
    damping: float = 0.0

    def tangential_force(self, stretch: float, slip: float) -> float:
        """Return the force along the contact for a stretch of the spring and a slip speed, before the cap [force]."""
        return self.stiffness * stretch + self.damping * slip


def friction_of(effects: tuple[Any, ...]) -> Friction | None:
    """Return the friction among the effects; None without."""
    return next((one for one in effects if isinstance(one, Friction)), None)


def acting_friction(effects: tuple[Any, ...]) -> Friction | None:
    """Return the friction among the effects; None without, and where its coefficient is 0."""
    found = friction_of(effects)
    return found if found and found.coefficient > 0.0 else None


def friction_or_zero(effects: tuple[Any, ...]) -> Friction:
    """Return the friction that acts; one whose coefficient, spring and dashpot are 0 where none does."""
    return acting_friction(effects) or Friction(0.0, 0.0, 0.0)
