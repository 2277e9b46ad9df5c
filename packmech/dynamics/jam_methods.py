"""The jamming protocols by name."""

from __future__ import annotations

from packmech.dynamics.decompression import Decompression
from packmech.dynamics.hard_vertex import HardVertex
from packmech.dynamics.program_chain import ProgramChain
from packmech.dynamics.step_halving import StepHalving

JamMethod = HardVertex | ProgramChain | StepHalving | Decompression

__all__ = ["Decompression", "HardVertex", "JamMethod", "ProgramChain", "StepHalving"]
