"""Numbers of packings of ellipses that `annealing.py` and `preparations.py` measure and draw."""

import numpy as np

import packmech as pm

PANELS = ("jamming_packing_fraction", "coordination_number", "nematic_order", "local_order")
MEASURED = ("packing_fraction", *PANELS[:3], "global_order", "local_order")


def measured(found: pm.Run) -> tuple[float, ...]:
    """Return packing fractions, coordination, orders and states of self stress of a packing."""
    bonds, report = pm.bond_orientational_order(found.packing, 6), found.report
    z = 2.0 * report["contacts"] / (found.packing.particles - report["rattlers"])
    fractions = report["packing_fraction"], report.get("jamming_packing_fraction", np.nan)
    orders = float(pm.nematic_order(found.packing)), bonds.global_order, bonds.local_order
    return *fractions, z, *orders, report["states_of_self_stress"]
