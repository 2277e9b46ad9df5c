"""Starting packings: sizes, random positions, lattices."""

from packmech.generate.lattices import LATTICE_NAMES, lattice_packing
from packmech.generate.random import random_packing
from packmech.generate.sizes import Bidisperse, LogNormal, Mixture, Monodisperse, Normal, Sizes, Uniform

__all__ = [
    "LATTICE_NAMES",
    "Bidisperse",
    "LogNormal",
    "Mixture",
    "Monodisperse",
    "Normal",
    "Sizes",
    "Uniform",
    "lattice_packing",
    "random_packing",
]
