"""Effects: what acts in a scene, each a small record of numbers, compiled in by type."""

from __future__ import annotations

from typing import Any

from packmech.effects.body import (
    ROUGHNESS,
    SIDES,
    SIGNED,
    BackgroundDamping,
    Gravity,
    Walls,
    body_energy,
    body_force,
    body_second,
    first_on_wall,
    refuse_walls,
    rough_walls,
    spin_drag,
    wall_columns,
)
from packmech.effects.bonds import (
    BREAKING_MODES,
    BondLimits,
    Bonds,
    acting_contacts,
    acts,
    bonds_of,
    links_and_bonds,
    refuse_tangential_bonds,
    refuse_tangential_springs,
)
from packmech.effects.cohesion import DMT, JKR, CapillaryBridge, ShortRangeAttraction
from packmech.effects.damping import ContactDamping, Restitution, ViscoelasticDamping
from packmech.effects.friction import (
    DampingRatio,
    Friction,
    Mindlin,
    acting_friction,
    at_contact,
    friction_of,
    friction_or_zero,
    mindlin_stiffness,
)
from packmech.effects.frictional_laws import DivergentRepulsion, ExponentialTension, PlateauRepulsion
from packmech.effects.held import FixedParticles, held_particles
from packmech.effects.interaction import (
    Interactions,
    bonded_pairs,
    find_interactions,
    interaction_law,
    interactions_of,
    is_interaction,
    memory_columns,
    memory_size,
    reach_beyond_contact,
    refuse_memory_of_shapes,
    remembered,
    remembered_energy,
    remembers,
)
from packmech.effects.langevin import Langevin, langevin_of
from packmech.effects.laws import (
    Harmonic,
    Hertz,
    Law,
    LinearSpring,
    PowerLaw,
    RepulsiveLennardJones,
    check_law,
    is_law,
    law,
    law_energy,
    law_first,
    law_scale,
    law_second,
    registered_laws,
)
from packmech.effects.pair import (
    ContactTerms,
    TouchingPair,
    cap_force,
    check_effect,
    contact_terms,
    damps,
    effect,
    is_bound,
    is_effect,
    pair_damping,
    pair_energy,
    pair_first,
    pair_second,
    registered_effects,
    under_cap,
)
from packmech.effects.repulsion import Repulsion
from packmech.effects.rolling import (
    RollingResistance,
    RoughContacts,
    TwistingResistance,
    refuse_rolling,
    resistances,
    rolling_of,
    roughness_of,
    twisting_of,
)
from packmech.effects.single import (
    ShapedTerms,
    SingleTerms,
    WallSide,
    acts_on_single,
    held_velocity,
    lacking_second,
    needs_second,
    refuse_free_fall,
    refuse_unknown_to_shapes,
    shaped_terms,
    single_effects,
    single_terms,
    total_push,
    wall_sides,
)

__all__ = [
    "Interactions",
    "find_interactions",
    "interaction_law",
    "interactions_of",
    "is_interaction",
    "refuse_memory_of_shapes",
    "remembered",
    "remembered_energy",
    "remembers",
    "memory_columns",
    "memory_size",
    "reach_beyond_contact",
    "SIGNED",
    "ROUGHNESS",
    "SIDES",
    "BackgroundDamping",
    "BREAKING_MODES",
    "BondLimits",
    "Bonds",
    "CapillaryBridge",
    "ContactDamping",
    "ContactTerms",
    "DMT",
    "DampingRatio",
    "DivergentRepulsion",
    "ExponentialTension",
    "FixedParticles",
    "Friction",
    "Gravity",
    "Harmonic",
    "Hertz",
    "Langevin",
    "langevin_of",
    "JKR",
    "Law",
    "LinearSpring",
    "Mindlin",
    "PlateauRepulsion",
    "PowerLaw",
    "Repulsion",
    "RollingResistance",
    "RoughContacts",
    "ShortRangeAttraction",
    "TwistingResistance",
    "refuse_rolling",
    "resistances",
    "rolling_of",
    "roughness_of",
    "twisting_of",
    "RepulsiveLennardJones",
    "ShapedTerms",
    "SingleTerms",
    "Walls",
    "acting_friction",
    "acts_on_single",
    "at_contact",
    "body_energy",
    "body_force",
    "body_second",
    "first_on_wall",
    "refuse_walls",
    "rough_walls",
    "wall_columns",
    "bonded_pairs",
    "bonds_of",
    "under_cap",
    "cap_force",
    "check_effect",
    "check_law",
    "contact_terms",
    "effect",
    "energy_scale_of",
    "friction_of",
    "friction_or_zero",
    "held_particles",
    "held_velocity",
    "is_bound",
    "is_effect",
    "is_law",
    "law",
    "law_energy",
    "mindlin_stiffness",
    "law_first",
    "law_of",
    "law_scale",
    "law_second",
    "lacking_second",
    "links_and_bonds",
    "needs_second",
    "pair_damping",
    "damps",
    "Restitution",
    "TouchingPair",
    "ViscoelasticDamping",
    "pair_energy",
    "pair_first",
    "pair_second",
    "refuse_free_fall",
    "refuse_tangential_bonds",
    "refuse_tangential_springs",
    "refuse_unknown_to_shapes",
    "registered_effects",
    "registered_laws",
    "shaped_terms",
    "single_effects",
    "single_terms",
    "total_push",
    "spin_drag",
    "acting_contacts",
    "acts",
    "wall_sides",
    "WallSide",
]


def law_of(effects: tuple[Any, ...]) -> Any:
    """Return the law of the first repulsion among the effects.

    Raises
    ------
    ValueError
        If no effect repels.

    """
    for one in effects:
        if isinstance(one, Repulsion):
            return one.law
    raise ValueError(f"effects must contain a Repulsion, got {tuple(type(one).__name__ for one in effects)}")


def energy_scale_of(effects: tuple[Any, ...], length: float) -> float:
    """Return the unit of energy that the repulsion sets: its energy_scale, or stiffness * length^2 [energy]."""
    return law_scale(law_of(effects), length)
