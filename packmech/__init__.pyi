# The public names of packmech by subject, one in a line: what editors complete, and where each is found on first use.

# packings
from packmech.box import Box as Box
from packmech.packing import Packing as Packing
from packmech.generate import random_packing as random_packing
from packmech.generate import lattice_packing as lattice_packing
from packmech.generate import fill_box as fill_box
from packmech.generate import cluster_packing as cluster_packing
from packmech.generate import chain_packing as chain_packing
from packmech.generate import rigid_packing as rigid_packing
from packmech.generate import bead_packing as bead_packing
from packmech.generate import scattered_packing as scattered_packing
from packmech.generate import assign_kinds as assign_kinds
from packmech.generate import vacancy_packing as vacancy_packing
from packmech.generate import tunneled_packing as tunneled_packing
from packmech.generate import reinforced_kagome_packing as reinforced_kagome_packing
from packmech.measure.counting import packing_fraction as packing_fraction
from packmech.protocols.protocol import at_packing_fraction as at_packing_fraction

# sizes and shapes of particles
from packmech.generate import Monodisperse as Monodisperse
from packmech.generate import Bidisperse as Bidisperse
from packmech.generate import Mixture as Mixture
from packmech.generate import Uniform as Uniform
from packmech.generate import Normal as Normal
from packmech.generate import LogNormal as LogNormal
from packmech.shapes import Spheroids as Spheroids
from packmech.shapes import Superellipsoids as Superellipsoids
from packmech.shapes import Beads as Beads
from packmech.generate import Ellipses as Ellipses
from packmech.generate import Superellipses as Superellipses
from packmech.generate import Cluster as Cluster
from packmech.generate import Dimer as Dimer
from packmech.generate import Trimer as Trimer
from packmech.generate import LinearCluster as LinearCluster
from packmech.generate import RingCluster as RingCluster
from packmech.generate import StarCluster as StarCluster

# files
from packmech.files.packings import read_packing as read_packing
from packmech.files.meshes import read_mesh as read_mesh
from packmech.files.packings import write_packing as write_packing
from packmech.files.packings import read_trajectory as read_trajectory
from packmech.files.packings import write_trajectory as write_trajectory
from packmech.files.packings import Snapshots as Snapshots
from packmech.files.snapshot import Snapshot as Snapshot
from packmech.files.snapshot import ContactData as ContactData
from packmech.view.trajectory import snapshots as snapshots
from packmech.files.packings import read_law as read_law
from packmech.scenes.scene_file import read_scene as read_scene
from packmech.scenes.scene_file import write_scene as write_scene
from packmech.scenes.export import Export as Export
from packmech.scenes.export import export_scene as export_scene
from packmech.files.tables import read_table as read_table
from packmech.files.tables import write_table as write_table

# objects of other programs
from packmech.files.convert import to_ase as to_ase
from packmech.files.convert import from_ase as from_ase
from packmech.files.convert import to_freud as to_freud
from packmech.files.convert import from_freud as from_freud
from packmech.files.convert import to_hoomd as to_hoomd
from packmech.files.convert import from_hoomd as from_hoomd
from packmech.files.convert import to_networkx as to_networkx
from packmech.files.convert import from_networkx as from_networkx

# scenes and what acts in them
from packmech.scene import Scene as Scene
from packmech.scenes.scene_file import list_scenes as list_scenes
from packmech.scenes import run as run
from packmech.effects import Repulsion as Repulsion
from packmech.effects import Friction as Friction
from packmech.effects import Mindlin as Mindlin
from packmech.effects import DampingRatio as DampingRatio
from packmech.effects.materials import Material as Material
from packmech.effects.materials import Materials as Materials
from packmech.effects import ByKind as ByKind
from packmech.effects import LawByKind as LawByKind
from packmech.effects import LawPerKind as LawPerKind
from packmech.effects import PerKind as PerKind
from packmech.effects import ConstantRolling as ConstantRolling
from packmech.effects import RollingResistance as RollingResistance
from packmech.effects import TwistingResistance as TwistingResistance
from packmech.effects import ViscousRolling as ViscousRolling
from packmech.effects import ShortRangeAttraction as ShortRangeAttraction
from packmech.effects import DMT as DMT
from packmech.effects import JKR as JKR
from packmech.effects import CapillaryBridge as CapillaryBridge
from packmech.effects import ContactDamping as ContactDamping
from packmech.effects import Restitution as Restitution
from packmech.effects import ViscoelasticDamping as ViscoelasticDamping
from packmech.effects import TouchingPair as TouchingPair
from packmech.effects import BackgroundDamping as BackgroundDamping
from packmech.effects import Langevin as Langevin
from packmech.effects import Gravity as Gravity
from packmech.effects import Walls as Walls
from packmech.effects import WallMotion as WallMotion
from packmech.effects import HeldStress as HeldStress
from packmech.effects import MeshWalls as MeshWalls
from packmech.effects import FixedParticles as FixedParticles
from packmech.effects import Bonds as Bonds
from packmech.effects import BondLimits as BondLimits
from packmech.effects.bonds import bond_contacts as bond_contacts
from packmech.generate import cut_fragments as cut_fragments
from packmech.tangential import TangentialDisplacements as TangentialDisplacements

# laws of contacts
from packmech.effects import Harmonic as Harmonic
from packmech.effects import Hertz as Hertz
from packmech.effects import ElasticSpheres as ElasticSpheres
from packmech.effects import LinearSpring as LinearSpring
from packmech.effects import PowerLaw as PowerLaw
from packmech.effects import RepulsiveLennardJones as RepulsiveLennardJones
from packmech.effects import DivergentRepulsion as DivergentRepulsion
from packmech.effects import PlateauRepulsion as PlateauRepulsion
from packmech.effects import ExponentialTension as ExponentialTension
from packmech.effects import Partners as Partners

# what a scene file's drive says
from packmech.scene import JamDrive as JamDrive
from packmech.scene import QuenchDrive as QuenchDrive
from packmech.scene import SettleDrive as SettleDrive
from packmech.scene import ShearStabilizeDrive as ShearStabilizeDrive
from packmech.scene import CementDrive as CementDrive
from packmech.scene import SimulateDrive as SimulateDrive
from packmech.scene import OscillatoryShearDrive as OscillatoryShearDrive
from packmech.scene import SteadyShearDrive as SteadyShearDrive
from packmech.scene import DeformDrive as DeformDrive
from packmech.scene import ShearAtPressureDrive as ShearAtPressureDrive
from packmech.scene import RampStrainDrive as RampStrainDrive
from packmech.scene import CreepDrive as CreepDrive

# jam, and follow what is jammed
from packmech.protocols.jam import jam as jam
from packmech.protocols.compress import compress as compress
from packmech.minimize.quench import quench as quench
from packmech.protocols.shearing.shear_stabilize import shear_stabilize as shear_stabilize
from packmech.protocols.settle import settle as settle
from packmech.protocols.sweep import sweep_pressure as sweep_pressure
from packmech.protocols.sweep import sweep_stress as sweep_stress
from packmech.protocols.shearing.shear_jam import shear_jam as shear_jam
from packmech.protocols.jam import JamMethod as JamMethod
from packmech.protocols.jam import HardVertex as HardVertex
from packmech.protocols.jam import ProgramChain as ProgramChain
from packmech.protocols.jam import Decompression as Decompression
from packmech.protocols.jam import StepHalving as StepHalving
from packmech.protocols.jam import Press as Press
from packmech.minimize.batch import QuenchBatch as QuenchBatch
from packmech.protocols.displaced_rest import displaced_rest as displaced_rest
from packmech.protocols.displaced_rest import DisplacedRest as DisplacedRest

# minimizers
from packmech.minimize.first_order.fire import Fire as Fire
from packmech.minimize.first_order.fire import Fire2 as Fire2
from packmech.minimize.first_order.conjugate_gradient import ConjugateGradient as ConjugateGradient
from packmech.minimize.first_order.lbfgs import LBFGS as LBFGS
from packmech.minimize.second_order.newton import Newton as Newton
from packmech.minimize.first_order.gradient_descent import GradientDescent as GradientDescent
from packmech.minimize.first_order.steepest_descent import SteepestDescent as SteepestDescent
from packmech.minimize.first_order.damped import DampedDynamics as DampedDynamics

# prepare and shear quasistatically
from packmech.protocols.deform import deform as deform
from packmech.protocols.deform import deform_at_rate as deform_at_rate
from packmech.protocols.deform import Deformation as Deformation
from packmech.protocols.shearing.quasistatic import quasistatic_shear as quasistatic_shear
from packmech.protocols.shearing.quasistatic import QuasistaticShear as QuasistaticShear
from packmech.protocols.shearing.avalanche import Avalanche as Avalanche
from packmech.protocols.shearing.local_yield import local_yield_stress as local_yield_stress
from packmech.protocols.shearing.local_yield import LocalYield as LocalYield
from packmech.protocols.shearing.quasistatic import ContactChange as ContactChange
from packmech.protocols.shearing.families import shear_families as shear_families
from packmech.protocols.shearing.families import ShearFamilies as ShearFamilies
from packmech.protocols.shearing.families import FamilyChange as FamilyChange
from packmech.protocols.shearing.quasistatic import cyclic_shear as cyclic_shear
from packmech.protocols.anneal import tap as tap
from packmech.protocols.anneal import anneal_shape as anneal_shape

# is it jammed
from packmech.jamming.certificate_file import Verification as Verification
from packmech.jamming.certificate_file import verify as verify
from packmech.jamming.certificate_file import write_certificate as write_certificate
from packmech.jamming.classify import classify_jamming as classify_jamming
from packmech.jamming.verdict import TiledAnswer as TiledAnswer
from packmech.jamming.verdict import Verdict as Verdict
from packmech.jamming.play import play_motion as play_motion
from packmech.jamming.play import PlayedMotion as PlayedMotion
from packmech.measure.rattlers import find_rattlers as find_rattlers
from packmech.measure.rattlers import remove_rattlers as remove_rattlers
from packmech.measure.rattlers import find_rattling_clusters as find_rattling_clusters
from packmech.measure.rattlers import Rattling as Rattling

# contacts and forces
from packmech.contacts import find_contacts as find_contacts
from packmech.contacts import Contacts as Contacts
from packmech.contacts.shape_contacts import find_shape_contacts as find_shape_contacts
from packmech.contacts.shape_contacts import ShapeContacts as ShapeContacts
from packmech.contacts.contact_distance import contact_distance as contact_distance
from packmech.measure.contact_forces import contact_forces as contact_forces
from packmech.measure.contact_forces import ContactForces as ContactForces
from packmech.measure.stress import forces as forces
from packmech.measure.contact_forces import torques as torques
from packmech.measure.stress import energy as energy
from packmech.measure.stress import pressure as pressure
from packmech.measure.stress import stress_tensor as stress_tensor
from packmech.measure.counting import coordination_number as coordination_number
from packmech.measure.walls import wall_contacts as wall_contacts
from packmech.measure.walls import WallContacts as WallContacts

# stiffness
from packmech.mechanics.elasticity import elastic_moduli as elastic_moduli
from packmech.mechanics.elasticity import Moduli as Moduli
from packmech.mechanics.elasticity import Average as Average
from packmech.mechanics.frictional import stiffness_matrix as stiffness_matrix
from packmech.mechanics.hessian import hessian as hessian
from packmech.mechanics.elasticity import compliance_matrix as compliance_matrix
from packmech.mechanics.hessian import perturbation_energy as perturbation_energy
from packmech.mechanics.complex_modulus import complex_modulus as complex_modulus
from packmech.mechanics.complex_modulus import ComplexModulus as ComplexModulus
from packmech.mechanics.sensitivity import sensitivity as sensitivity
from packmech.mechanics.sensitivity import Sensitivity as Sensitivity
from packmech.protocols.design import design as design
from packmech.protocols.design import Design as Design
from packmech.protocols.cement import cement as cement
from packmech.protocols.cement import Cementing as Cementing
from packmech.measure.signals import yield_strain as yield_strain
from packmech.measure.signals import softening_strain as softening_strain
from packmech.linalg.mandel import mandel_tensor as mandel_tensor
from packmech.linalg.mandel import mandel_vector as mandel_vector

# vibrations
from packmech.mechanics.modes import normal_modes as normal_modes
from packmech.mechanics.modes import Modes as Modes
from packmech.mechanics.mode_counts import count_modes as count_modes
from packmech.mechanics.mode_counts import ModeCounts as ModeCounts
from packmech.mechanics.state_density import density_of_states as density_of_states
from packmech.mechanics.state_density import StateDensity as StateDensity
from packmech.mechanics.waves import waves as waves
from packmech.mechanics.waves import Waves as Waves
from packmech.mechanics.waves import dispersion as dispersion
from packmech.mechanics.waves import sound_speeds as sound_speeds
from packmech.mechanics.waves import SoundSpeeds as SoundSpeeds
from packmech.mechanics.soft_spots import soft_spots as soft_spots
from packmech.mechanics.soft_spots import SoftSpots as SoftSpots
from packmech.mechanics.hessian import dynamical_matrix as dynamical_matrix
from packmech.mechanics.frictional import frictional_modes as frictional_modes
from packmech.mechanics.frictional import FrictionalModes as FrictionalModes
from packmech.mechanics.quartic import quartic_modes as quartic_modes
from packmech.mechanics.quartic import QuarticModes as QuarticModes

# rigidity
from packmech.mechanics.rigidity import rigidity_matrix as rigidity_matrix
from packmech.mechanics.self_stress import states_of_self_stress as states_of_self_stress
from packmech.mechanics.self_stress import SelfStress as SelfStress
from packmech.mechanics.self_stress import floppy_modes as floppy_modes
from packmech.mechanics.self_stress import FloppyModes as FloppyModes
from packmech.mechanics.rigid_clusters import rigid_clusters as rigid_clusters
from packmech.mechanics.rigid_clusters import RigidClusters as RigidClusters
from packmech.mechanics.second_order import second_order as second_order
from packmech.mechanics.second_order import SecondOrder as SecondOrder

# links
from packmech.links import Links as Links
from packmech.contacts import crossing_links as crossing_links
from packmech.contacts import Crossings as Crossings
from packmech.measure.stress import link_tension as link_tension
from packmech.constraints.jacobian import constraint_jacobian as constraint_jacobian
from packmech.constraints.basis import constraint_basis as constraint_basis
from packmech.constraints.basis import ConstraintBasis as ConstraintBasis
from packmech.mechanics.rigidity import constrained_rigidity_matrix as constrained_rigidity_matrix
from packmech.mechanics.rigidity import change_of_basis as change_of_basis
from packmech.mechanics.rigidity import n_matrix as n_matrix
from packmech.constraints.redundancy import independent_links as independent_links
from packmech.constraints.redundancy import IndependentLinks as IndependentLinks
from packmech.constraints.projection import project_force as project_force
from packmech.constraints.projection import ConstrainedForce as ConstrainedForce
from packmech.constraints.projection import reaffix_links as reaffix_links
from packmech.constraints.projection import ReaffixedLinks as ReaffixedLinks
from packmech.mechanics.quartic import displaced as displaced

# structure
from packmech.measure.structure import pair_distribution as pair_distribution
from packmech.measure.structure import PairDistribution as PairDistribution
from packmech.measure.scattering import structure_factor as structure_factor
from packmech.measure.scattering import partial_structure_factors as partial_structure_factors
from packmech.measure.scattering import PartialStructureFactors as PartialStructureFactors
from packmech.measure.scattering import spectral_density as spectral_density
from packmech.measure.scattering import wave_indices as wave_indices
from packmech.measure.scattering import wave_vectors as wave_vectors
from packmech.measure.scattering import shell_average as shell_average
from packmech.measure.scattering import ShellAverage as ShellAverage
from packmech.measure.scattering import SpectrumFit as SpectrumFit
from packmech.measure.structure import correlation_function as correlation_function
from packmech.measure.structure import Correlation as Correlation
from packmech.measure.structure import correlation_length as correlation_length
from packmech.measure.structure import CorrelationLength as CorrelationLength
from packmech.contacts.surroundings import find_neighbors as find_neighbors
from packmech.contacts.surroundings import Neighbors as Neighbors
from packmech.measure.coarse_grain import coarse_grain as coarse_grain
from packmech.measure.coarse_grain import CoarseFields as CoarseFields
from packmech.measure.displacements import displacements as displacements
from packmech.measure.displacements import Displacements as Displacements
from packmech.measure.displacements import local_strain as local_strain
from packmech.measure.displacements import LocalStrain as LocalStrain
from packmech.measure.mobility import mean_square_displacement as mean_square_displacement
from packmech.measure.mobility import MeanSquareDisplacement as MeanSquareDisplacement
from packmech.measure.mobility import self_scattering as self_scattering
from packmech.measure.mobility import SelfScattering as SelfScattering
from packmech.measure.order import bond_orientational_order as bond_orientational_order
from packmech.measure.order import BondOrder as BondOrder
from packmech.measure.order import nematic_order as nematic_order
from packmech.measure.order import NematicOrder as NematicOrder
from packmech.measure.contact_statistics import contact_statistics as contact_statistics
from packmech.measure.contact_statistics import ContactStatistics as ContactStatistics
from packmech.measure.contact_statistics import force_chains as force_chains
from packmech.measure.contact_statistics import ForceChains as ForceChains
from packmech.measure.contact_statistics import force_distribution as force_distribution
from packmech.measure.contact_statistics import ForceDistribution as ForceDistribution

# motion in time
from packmech.dynamics.simulate import simulate as simulate
from packmech.effects.restitution import coefficient_of_restitution as coefficient_of_restitution
from packmech.effects.restitution import viscoelastic_time as viscoelastic_time
from packmech.dynamics.simulation import Simulation as Simulation
from packmech.dynamics.breaking import BrokenBonds as BrokenBonds
from packmech.dynamics.simulate import resume as resume
from packmech.dynamics.simulation import MotionTrace as MotionTrace
from packmech.dynamics.ledger import EnergyLedger as EnergyLedger
from packmech.dynamics.moved_walls import MovedWalls as MovedWalls
from packmech.dynamics.contact_dissipation import contact_dissipation as contact_dissipation
from packmech.dynamics.contact_dissipation import ContactDissipation as ContactDissipation
from packmech.dynamics.integrators import VelocityVerlet as VelocityVerlet
from packmech.dynamics.integrators import SemiImplicitEuler as SemiImplicitEuler
from packmech.observables import State as State
from packmech.observables import Table as Table
from packmech.effects.material import material_constants as material_constants
from packmech.effects.material import MaterialConstants as MaterialConstants

# rheology
from packmech.rheology.oscillatory import oscillatory_shear as oscillatory_shear
from packmech.rheology.oscillatory import OscillatoryShear as OscillatoryShear
from packmech.rheology.amplitude_sweep import amplitude_sweep as amplitude_sweep
from packmech.rheology.amplitude_sweep import AmplitudeSweep as AmplitudeSweep
from packmech.rheology.steady import steady_shear as steady_shear
from packmech.rheology.steady import FlowCurve as FlowCurve
from packmech.rheology.at_pressure import shear_at_pressure as shear_at_pressure
from packmech.rheology.at_pressure import PressureShear as PressureShear
from packmech.rheology.steady import ramp_strain as ramp_strain
from packmech.rheology.strain_run import StrainRun as StrainRun
from packmech.rheology.steady import creep as creep
from packmech.rheology.steady import Creep as Creep
from packmech.rheology.equilibrate import equilibrate as equilibrate
from packmech.rheology.equilibrate import Equilibration as Equilibration
from packmech.dynamics.deformation import OscillatoryStrain as OscillatoryStrain
from packmech.dynamics.deformation import SteadyStrain as SteadyStrain
from packmech.rheology.walls import rough_plates as rough_plates
from packmech.rheology.walls import WallModuli as WallModuli
from packmech.ensemble.shear_series import shear_series as shear_series
from packmech.ensemble.shear_series import ShearSeries as ShearSeries
from packmech.ensemble.shear_series import ShearCurve as ShearCurve
from packmech.ensemble.shear_series import ShearTrial as ShearTrial
from packmech.dynamics.batch import ShearBatch as ShearBatch
from packmech.measure.signals import demodulate as demodulate
from packmech.measure.signals import Demodulation as Demodulation
from packmech.measure.signals import mean_with_error as mean_with_error
from packmech.validation import particle_shear as particle_shear
from packmech.validation.particle_shear import ParticleShear as ParticleShear
from packmech.validation.particle_shear import ParticleShearRun as ParticleShearRun

# ensembles
from packmech.ensemble.run import run_ensemble as run_ensemble
from packmech.ensemble.run import resume_ensemble as resume_ensemble
from packmech.ensemble.table import read_ensemble as read_ensemble
from packmech.ensemble.table import Ensemble as Ensemble
from packmech.ensemble.statistics import group_statistics as group_statistics
from packmech.ensemble.statistics import GroupStatistics as GroupStatistics
from packmech.ensemble.statistics import histogram as histogram
from packmech.ensemble.statistics import Histogram as Histogram
from packmech.ensemble.statistics import bootstrap as bootstrap
from packmech.ensemble.statistics import fit_power_law as fit_power_law
from packmech.ensemble.statistics import PowerLawFit as PowerLawFit
from packmech.ensemble.statistics import small_value_exponent as small_value_exponent

# accuracy and its cost
from packmech.validation.work_precision import work_precision as work_precision
from packmech.validation.work_precision import WorkPrecision as WorkPrecision
from packmech.validation.work_precision import Trial as Trial
from packmech.validation.work_precision import Answer as Answer
from packmech.validation.settings import settings_for as settings_for
from packmech.validation.cheapest import CheapestSettings as CheapestSettings

# figures, pictures and recordings
from packmech.plotting.plot import plot as plot
from packmech.view.recording import record_run as record_run
from packmech.view.recording import record_packing as record_packing
from packmech.view.recording import record_motion as record_motion
from packmech.view.live import Recording as Recording
from packmech.view.frame import draw_frame as draw_frame
from packmech.view.figures import write_pictures as write_pictures
from packmech.view.report import report_figure as report_figure

# outcomes
from packmech.result import Run as Run
from packmech.result import Outcome as Outcome
from packmech.result import NotConverged as NotConverged
from packmech.result import Condition as Condition
from packmech.result import Solve as Solve
from packmech.result import Stage as Stage
from packmech.result import Trace as Trace

# your own laws, effects, methods, drives and measures
from packmech.observables import observable as observable
from packmech.effects import law as law
from packmech.effects import effect as effect
from packmech.minimize.minimizers import minimizer as minimizer
from packmech.scene import drive as drive
from packmech.scenes.recipes import packing_kind as packing_kind
from packmech.jit.compiled import kernel as kernel

#: shear_modulus, bulk_modulus, young_modulus, poisson_ratio, elastic_constants, elasticity -> elastic_moduli
#: stiffness_tensor -> elastic_moduli
#: derivative, gradient, adjoint, differentiate -> sensitivity
#: optimize, inverse_design, auxetic, pruning, tune -> design
#: storage_modulus, loss_modulus, viscoelasticity -> complex_modulus, oscillatory_shear
#: hessian_matrix -> hessian
#: number_of_modes, inertia, sylvester, integrated_density -> count_modes
#: dos, vdos, vibrational_density, phonons, spectrum -> density_of_states
#: vibrality, plastic_spots -> soft_spots
#: eigenmodes, vibrations, normal_mode, frequencies -> normal_modes
#: onset, onset_between, bracket, jamming_point, phi_j -> jam, compress
#: z, coordination, contact_number -> coordination_number
#: z_iso, isostatic, isostaticity, excess_contacts -> classify_jamming, contact_forces
#: phi, volume_fraction, density -> packing_fraction
#: g, g_r, rdf, radial_distribution -> pair_distribution
#: s_k, s_q, hyperuniformity -> structure_factor
#: psi6, psi_6, hexatic, steinhardt -> bond_orientational_order
#: msd, diffusion, mobility -> mean_square_displacement
#: trajectory -> simulate, read_trajectory
#: coarse_graining, stress_field, density_field, goldhirsch -> coarse_grain
#: d2min, nonaffine, affine, von_mises -> local_strain, displacements
#: isf, f_s, intermediate_scattering, relaxation_time -> self_scattering
#: minimize, relax, energy_minimization -> quench
#: viscosity, flow -> steady_shear
#: yield_stress -> steady_shear, quasistatic_shear, local_yield_stress
#: soft_spot, weak_spot, local_yield -> local_yield_stress, soft_spots
#: aqs -> quasistatic_shear
#: triaxial, biaxial, direct_shear, servo, barostat -> deform_at_rate, deform
#: mixed_control, uniaxial_stress -> deform, deform_at_rate
#: force_network, overlaps, normal_forces -> contact_forces
#: rattlers -> find_rattlers
#: pebble_game, rigidity_percolation, over_constrained -> rigid_clusters
#: polymer, polymers, chains, beads_on_a_chain -> chain_packing, Links, bead_packing
#: adhesion, pull_off, sticking -> JKR, DMT, ShortRangeAttraction
#: effective_radius, curvature, hertz_mindlin, unequal_spheres -> ElasticSpheres, Hertz, Partners, Material
#: gel, attraction, cohesion, wet, liquid_bridge -> ShortRangeAttraction, DMT, JKR, CapillaryBridge
#: reaction, support, floor, weight -> contact_forces, wall_contacts
#: plastic, plasticity, plastic_events, yielding -> quasistatic_shear, local_yield_stress
#: heap, pile, angle_of_repose -> settle, SettleDrive, Gravity, Friction
#: convergence, order_of_convergence, accuracy, step_size -> settings_for, work_precision, WorkPrecision, Outcome
#: notebook, html -> plot
#: import, load, open, read -> read_packing, read_trajectory, from_ase
#: export, save, write -> write_packing, write_trajectory, to_ase
#: draw, figure, show -> plot
#: lammps, gsd, xyz, vtk -> read_packing, write_packing
#: stress -> stress_tensor
#: kind, kinds, species, types, materials_of_particles -> assign_kinds
#: discs, disks, spheres, bidisperse_packing -> random_packing

__version__: str

def help(word: object = "") -> None: ...
