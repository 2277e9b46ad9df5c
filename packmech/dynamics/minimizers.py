"""The minimization methods by name."""

from __future__ import annotations

from packmech.dynamics.conjugate_gradient import ConjugateGradient
from packmech.dynamics.damped import DampedDynamics
from packmech.dynamics.fire import Fire, Fire2
from packmech.dynamics.gradient_descent import GradientDescent
from packmech.dynamics.lbfgs import LBFGS
from packmech.dynamics.polish import Newton

MinimizeMethod = Fire | Fire2 | ConjugateGradient | LBFGS | DampedDynamics | GradientDescent | Newton

__all__ = [
    "ConjugateGradient",
    "DampedDynamics",
    "Fire",
    "Fire2",
    "GradientDescent",
    "LBFGS",
    "MinimizeMethod",
    "Newton",
]
