"""What a simulation returns, and what it keeps on the way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from packmech.dynamics.march.touching import Touching
from packmech.outcome import Run, Trace


@dataclass(frozen=True, eq=False, kw_only=True)
class MotionTrace(Trace):
    """A trace against time, kept at the steps that the caller asked for.

    Attributes
    ----------
    time_t
        (T,) times since the start [time].
    kinetic_t
        (T,) kinetic energies [energy]; energy_t are the potential ones.
    momentum_td
        (T, d) total momenta.
    stress_tdd
        (T, d, d) Cauchy stress of contacts, with their dashpots, and links, tension positive [energy/length^d];
        pressure_t is -trace / d of it.
    kinetic_stress_tdd
        (T, d, d) kinetic part -(1/V) sum m u u^T of the velocities u less their mass-weighted mean; in no other figure.
    link_error_t
        (T,) largest error of a link, over the larger of its length and the mean diameter [1].
    velocity_tnd
        (T, N, d) velocities (peculiar ones in a box that deforms), or None when positions were not asked for.
        lattice_tdd are the lattice vectors then, where the box deforms.
    overall_stress_tdd
        (T, d, d) the stress with torques and the spins' part, symmetric (as stress_tdd where nothing turns).
    strain_t, strain_rate_t
        (T,) gamma of the box [1] and its rate [1/time].
    sliding_t
        (T,) number of contacts at Coulomb's cap.
    torque_stress_tdd, spin_stress_tdd, bond_stress_tdd
        (T, d, d) the parts of the overall stress by torques and by spins, and the part of stress_tdd that bonds bear;
        None without friction, bonds, body forces and strain.
    tangential_t, rotational_t
        (T,) the parts of energy_t in tangential springs and of kinetic_t in spins.
    angular_momentum_tk
        (T, 1 or 3) total angular momenta about the origin, spins included; None as above.
    spin_tnk
        (T, N, 1 or 3) spins, None where particles do not turn or positions were not asked for.
    touching_t
        Who touches whom at each saved time, with which force and which of them slide; None where positions were not
        asked for, or as above.

    """

    time_t: NDArray[np.float64]
    kinetic_t: NDArray[np.float64]
    momentum_td: NDArray[np.float64]
    stress_tdd: NDArray[np.float64]
    kinetic_stress_tdd: NDArray[np.float64]
    link_error_t: NDArray[np.float64]
    overall_stress_tdd: NDArray[np.float64]
    strain_t: NDArray[np.float64]
    strain_rate_t: NDArray[np.float64]
    sliding_t: NDArray[np.int64]
    velocity_tnd: NDArray[np.float64] | None = None
    torque_stress_tdd: NDArray[np.float64] | None = None
    spin_stress_tdd: NDArray[np.float64] | None = None
    bond_stress_tdd: NDArray[np.float64] | None = None
    tangential_t: NDArray[np.float64] | None = None
    rotational_t: NDArray[np.float64] | None = None
    angular_momentum_tk: NDArray[np.float64] | None = None
    spin_tnk: NDArray[np.float64] | None = None
    touching_t: tuple[Touching, ...] | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Simulation(Run):
    """A run through time: where it ended, what it kept on the way, and how well energy and momentum held.

    Attributes
    ----------
    velocity_nd, mass_n
        (N, d) velocities at the end [length/time]; (N,) masses.
    dt
        The time step [time].
    energy_drift
        Energy at the end less that at the start, over the largest |potential| + kinetic energy seen [1]. With dashpots
        it holds what they took, without it is the method's error.
    momentum_error
        Largest change of the total momentum seen, over the largest sum of m |v| [1].
    link_error
        Largest error of a link seen, over the larger of its length and the mean diameter [1].
    tension_l
        (L,) forces in the links at the end, positive for tension [force]; none in redundant ones.
    spin_nk
        (N, 1 or 3) spins at the end [1/time]; None where particles do not turn.
    strain
        gamma of the box at the end [1]; `packing` has the box as it is then.
    held_n
        (N,) who was held, if anybody was.

    """

    velocity_nd: NDArray[np.float64]
    mass_n: NDArray[np.float64]
    dt: float
    energy_drift: float
    momentum_error: float
    link_error: float
    tension_l: NDArray[np.float64]
    spin_nk: NDArray[np.float64] | None = None
    strain: float = 0.0
    held_n: NDArray[np.bool_] | None = None
