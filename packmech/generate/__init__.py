"""Starting packings: sizes, random positions, lattices, clusters, chains; fragments cut out of bonded ones."""

from packmech.generate.chains import chain_packing
from packmech.generate.cluster_shapes import Cluster, Dimer, LinearCluster, RingCluster, Shape, StarCluster, Trimer
from packmech.generate.clusters import cluster_packing, scattered_packing
from packmech.generate.fragments import cut_fragments, fragment_numbers
from packmech.generate.kinds import assign_kinds
from packmech.generate.lattices import (
    LATTICE_NAMES,
    lattice_packing,
    reinforced_kagome_packing,
    tunneled_packing,
    vacancy_packing,
)
from packmech.generate.random import (
    Bidisperse,
    Ellipses,
    LogNormal,
    Mixture,
    Monodisperse,
    Normal,
    SizeDistribution,
    Superellipses,
    Uniform,
    fill_box,
    random_packing,
)
from packmech.generate.rigid import bead_packing, rigid_packing

__all__ = [
    "LATTICE_NAMES",
    "Bidisperse",
    "Cluster",
    "Dimer",
    "Ellipses",
    "LinearCluster",
    "LogNormal",
    "Mixture",
    "Monodisperse",
    "Normal",
    "RingCluster",
    "Shape",
    "SizeDistribution",
    "StarCluster",
    "Superellipses",
    "Trimer",
    "Uniform",
    "assign_kinds",
    "bead_packing",
    "chain_packing",
    "cluster_packing",
    "cut_fragments",
    "fill_box",
    "fragment_numbers",
    "lattice_packing",
    "random_packing",
    "reinforced_kagome_packing",
    "rigid_packing",
    "scattered_packing",
    "tunneled_packing",
    "vacancy_packing",
]
