"""Small faults: a text that stands once in a file, what stands in its place, and the tests that should notice."""

from __future__ import annotations

import json
from pathlib import Path
from typing import NamedTuple

# faults that were drawn by rules (`generate.py`) and kept
DRAWN = Path(__file__).with_name("drawn.json")


class Fault(NamedTuple):
    """A change of one text.

    Attributes
    ----------
    file
        The file, from the root of the checkout.
    what
        What is wrong then, in words; the fault's name.
    was, now
        The text, which stands in the file once, and what stands in its place.
    tests
        Files of tests, or single ones, that should notice, those that are the quickest to first; those of the file
        unless given.
    guard
        Whether it takes away what keeps a wrong verdict from being given.
    equivalent
        Why no answer changes; empty where some should.

    """

    file: str
    what: str
    was: str
    now: str
    tests: tuple[str, ...] = ()
    guard: bool = False
    equivalent: str = ""

    @property
    def key(self) -> tuple[str, str]:
        """Return its file and what is wrong."""
        return self.file, self.what

    def put_into(self, text: str) -> str:
        """Return the file's text with the fault in it."""
        if text.count(self.was) != 1:
            raise ValueError(f"was must stand once in {self.file}, got {text.count(self.was)} times for {self.what!r}")
        return text.replace(self.was, self.now)


def _tests(folder: str, names: str) -> tuple[str, ...]:
    return tuple(f"tests/{folder}/test_{name}.py" for name in names.split())


def _named(file: str, names: str) -> tuple[str, ...]:
    return tuple(f"tests/{file}.py::test_{name}" for name in names.split())


_QUENCHED = _named(
    "envs/test_quench",
    "bad_arguments_get_one_clear_error actions_outside_the_space_get_one_clear_error "
    "steps_that_there_are_not_are_refused what_the_environment_does_not_know_is_refused_by_name "
    "options_come_by_name_or_in_a_record_and_an_unknown_one_is_answered_with_those_there_are "
    "scenes_with_bonds_are_refused_unless_they_are_to_be_left_out "
    "the_reward_is_the_sum_of_its_named_terms_and_weights_scale_them "
    "progress_adds_up_to_the_decades_by_which_the_bracket_narrowed_less_the_steps "
    "observations_are_the_measures_of_the_packing an_action_made_for_a_change_makes_that_change "
    "a_step_changes_the_packing_fraction_by_the_largest_change_halved_so_often budgets_truncate "
    "so_many_steps_at_a_time_show_the_quench an_episode_unjams_and_rejams a_packing_is_judged_by_the_law_of_its_scene "
    "bisection_by_what_is_observed_ends_every_episode_jammed",
)
_LAWS = _named(
    "effects/test_laws",
    "energy_and_derivatives_are_those_of_the_formula_to_rounding stored_potentials_are_met_to_1e_14 "
    "stiffness_on_the_closed_side_of_contact_is_the_known_limit energy_and_force_vanish_at_contact_and_beyond "
    "every_law_repels_and_is_convex power_law_of_exponent_two_is_harmonic_and_of_five_halves_is_hertz "
    "unit_of_energy_is_the_energy_scale_or_the_stiffness_times_length_squared "
    "a_class_that_is_no_law_is_refused_saying_what_is_missing "
    "a_law_with_a_wrong_derivative_is_refused_where_it_is_registered a_law_that_jumps_is_refused_unless_it_says_so "
    "a_law_without_defaults_is_checked_by_scenes_with_its_own_numbers",
)
_HESSIAN = _named(
    "mechanics/test_hessian",
    "crystals_are_stable_where_every_motion_and_in_a_box_of_free_shape_every_strain_takes_work "
    "strains_of_symmetric_gradients_alone_have_an_energy links_leave_one_motion_fewer_each_and_what_is_held_none "
    "bad_input_gets_one_clear_error "
    "dynamical_matrix_is_the_hessian_weighted_with_masses_and_the_strain_scale "
    "default_strain_scale_is_the_side_of_a_cube_of_the_volume a_fixed_volume_leaves_one_strain_fewer "
    "without_strain_the_hessian_is_its_position_block "
    "paper_and_exact_kinds_differ_by_the_curvature_of_a_fixed_volume_only "
    "a_crystal_at_contact_has_the_stiffness_of_the_closed_side "
    "unstressed_hessian_is_the_spring_network_of_the_rigidity_matrix "
    "perturbation_energy_is_the_change_of_energy_at_rest",
)
_VERDICT = _tests("jamming", "guards verdict_softness verdict_assumptions programs load_gap gap_sensitivity verdict")
_SELECTED = _tests("jamming", "settled gap_sensitivity verdict ambiguous verdict_assumptions jamming")
_LINKED = _tests("jamming", "link_jamming")
# tests that should notice faults of a file
TESTS: dict[str, tuple[str, ...]] = {
    "packmech/jamming/certificates.py": (*_VERDICT, *_tests("jamming", "naive_methods ambiguous jamming")),
    "packmech/jamming/motion_cone.py": (
        *_tests("jamming", "guards programs"),
        *_VERDICT[1:],
        *_tests("jamming", "jamming_soft link_jamming"),
    ),
    "packmech/jamming/programs.py": (*_tests("jamming", "load_gap programs gap_sensitivity"), *_VERDICT),
    "packmech/jamming/backbone.py": _tests(
        "jamming", "backbone verdict_softness verdict_assumptions verdict gap_sensitivity jamming"
    ),
    "packmech/jamming/contact_selection.py": _SELECTED,
    "packmech/jamming/classify.py": (*_SELECTED, *_LINKED),
    "packmech/jamming/verdict.py": (*_tests("jamming", "verdict gap_sensitivity jamming"), *_LINKED),
    "packmech/jamming/room.py": _tests("jamming", "room"),
    # those that need no packing to be jammed first
    "packmech/jamming/referee.py": (
        *_named(
            "jamming/test_referee",
            "forged_grounds_prove_nothing links_are_neither_stretched_nor_left_without_balance "
            "the_tolerance_does_not_decide_what_touches_unless_it_is_a_tolerance "
            "one_particle_alone_is_not_jammed_for_free a_particle_held_by_its_own_images_is_not_taken_out "
            "a_particle_inside_of_another_is_refused_wherever_it_belongs "
            "a_jammed_crystal_is_not_unjammed_by_leaving_particles_out_of_its_backbone "
            "the_bound_on_singular_values_holds numbers_that_are_too_large_to_be_added_up_prove_nothing "
            "discs_that_hold_nothing_are_taken_out_one_by_one "
            "a_particle_is_held_where_its_normals_are_in_no_closed_half_space",
        ),
        *_tests("jamming", "referee"),
    ),
    "packmech/jamming/tiled.py": _tests("jamming", "tiled"),
    "packmech/mechanics/waves.py": _tests("mechanics", "waves"),
    "packmech/mechanics/wave_matrices.py": _tests("mechanics", "waves"),
    "packmech/jamming/shaped.py": _tests("jamming", "shaped_answers shaped_verdict"),
    "packmech/mechanics/stability.py": _tests("mechanics", "stability sticking_stability"),
    "packmech/mechanics/elasticity.py": _tests(
        "mechanics", "elasticity elastic_crystals link_moduli frictional exact_hessian rattling"
    ),
    "packmech/mechanics/modes.py": _tests("mechanics", "modes link_modes"),
    "packmech/mechanics/state_density.py": _tests("mechanics", "mode_counts modes"),
    "packmech/mechanics/vibrations.py": _tests("mechanics", "mode_counts modes"),
    "packmech/mechanics/mode_counts.py": _tests("mechanics", "mode_counts"),
    "packmech/linalg/inertia.py": (
        "packmech/linalg/inertia.py",
        *_tests("linalg", "inertia"),
        *_tests("mechanics", "mode_counts"),
    ),
    "packmech/mechanics/rigid_clusters.py": _tests("mechanics", "rigid_clusters"),
    "packmech/contacts/rattlers.py": _tests("contacts", "rattlers"),
    "packmech/measure/rattlers.py": _tests("mechanics", "rattling link_rattlers"),
    "packmech/measure/counting.py": (*_tests("contacts", "rattlers"), *_tests("measure", "contact_forces")),
    "packmech/measure/contact_forces.py": (
        *_tests("measure", "forces_of_columns contact_forces"),
        "tests/mechanics/test_elasticity.py::test_moduli_of_a_packing_as_drawn_say_first_that_it_is_not_at_rest",
    ),
    "packmech/mechanics/hessian.py": (
        "packmech/mechanics/hessian.py",
        *_HESSIAN,
        *_tests("mechanics", "stiffness_at_walls"),
    ),
    "packmech/mechanics/assembly.py": _tests("mechanics", "hessian bonds_at_rest shaped"),
    "packmech/mechanics/system.py": _tests("mechanics", "hessian bonds_at_rest stiffness_at_walls"),
    "packmech/mechanics/relaxation.py": _tests("mechanics", "elastic_crystals elasticity"),
    "packmech/minimize/second_order/soft_network.py": _tests("minimize", "soft_network polish"),
    "packmech/mechanics/self_stress.py": _tests("mechanics", "rigidity link_counting"),
    "packmech/loop/checkpoint.py": ("packmech/loop/checkpoint.py", *_tests("loop", "checkpoint_file")),
    "packmech/effects/laws.py": ("packmech/effects/laws.py", *_LAWS),
    "packmech/effects/cohesion.py": _tests("effects", "cohesion"),
    "packmech/effects/pair.py": ("tests/test_extending.py", *_tests("dynamics", "contact_damping")),
    "packmech/effects/frictional_laws.py": _tests("effects", "frictional_laws"),
    "packmech/contacts/network.py": ("packmech/contacts/network.py", *_tests("contacts", "network")),
    "packmech/contacts/contact_distance.py": _tests("contacts", "contact_distance"),
    "packmech/contacts/crossing.py": _tests("contacts", "crossing"),
    "packmech/contacts/overlaps.py": _tests("contacts", "overlaps"),
    "packmech/contacts/given.py": _tests("contacts", "given"),
    "packmech/contacts/coulomb_limit.py": _tests("contacts", "coulomb_limit"),
    "packmech/dynamics/pair_forces.py": _tests("dynamics", "touching"),
    "packmech/minimize/passes/kernels.py": (
        *_named(
            "minimize/test_program",
            "forces_are_minus_the_gradient_of_the_energy energy_forces_and_stress_are_those_of_the_measures_in_any_box "
            "the_skin_of_the_lists_changes_no_bit_of_a_run",
        ),
        "tests/minimize/test_shape_minimizers.py::test_forces_on_coordinates_are_slopes_of_the_energy",
    ),
    "packmech/linalg/mandel.py": _tests("linalg", "strain"),
    "envs/packmech_envs/quench.py": ("envs/packmech_envs/quench.py", *_tests("envs", "quench_episodes"), *_QUENCHED),
    "envs/packmech_envs/shear_goals.py": ("envs/packmech_envs/shear_goals.py", *_tests("envs", "shear_goals")),
    "envs/packmech_envs/tasks.py": ("envs/packmech_envs/tasks.py", *_tests("envs", "tasks scenes")),
}


def _guards(file: str, *faults: tuple[str, ...]) -> list[Fault]:
    """Return guards taken away in a file: what is wrong, the text, what stands there then, why it is equivalent."""
    return [Fault(file, what, was, now, (), True, *why) for what, was, now, *why in faults]


def _faults(file: str, *faults: tuple[str, ...]) -> list[Fault]:
    """Return faults of a file that no verdict depends on, as `_guards` takes them."""
    return [one._replace(guard=False) for one in _guards(file, *faults)]


CATALOGUE: list[Fault] = [
    *_guards(
        "packmech/jamming/certificates.py",
        (
            "rounding of the rows is no error of the forces",
            "    rows = _ROWS * len(cone.kept_n) ** (1.0 / cone.dimension) * np.sqrt(weight @ weight)\n",
            "    rows = 0.0\n",
        ),
        ("net forces are no error of the forces", "(NET_FORCES * np.sqrt(net @ net) + rows)", "(rows)"),
        (
            "the error of forces is over the largest eigenvalue, not the largest singular value",
            "/ (softest * np.sqrt(cone.largest_eigenvalue)))",
            "/ (softest * cone.largest_eigenvalue))",
        ),
        ("a smallest force within its error holds", "if smallest > error and balance", "if smallest > 0.0 and balance"),
        ("a force that pulls holds", "if smallest > error and balance", "if smallest > -np.inf and balance"),
        ("forces out of balance hold", "balance <= BALANCE and pressing", "balance < np.inf and pressing"),
        ("multipliers may pull", "balance <= BALANCE and pressing:", "balance <= BALANCE:"),
        (
            "multipliers within their error press",
            "weight[count + cone.held.shape[0] :] > error).all()",
            "weight[count + cone.held.shape[0] :] > -error).all()",
        ),
        ("forces of no positive mean are taken", "if np.isfinite(mean) and mean > 0:", "if np.isfinite(mean):"),
        (
            "a motion is a proof unchecked",
            "    if motion is not None and (proof := kept_open(cone, motion)) is not None:\n        if 0.0",
            "    if motion is not None and (proof := motion) is not None:\n        if 0.0",
        ),
        (
            "forces as small as rounding hold nothing for sure",
            "if 0.0 < smallest <= error and closes_hardly(cone, proof):",
            "if False:",
        ),
        ("nothing is soft", "    if softest**2 > FLOPPY or is_surely_rigid(cone):\n", "    if True:\n"),
        ("soft motions are never surely rigid", "softest**2 > FLOPPY or is_surely_rigid(cone)", "softest**2 > FLOPPY"),
        ("a floppy motion is none", "    if cone.is_floppy:\n        reason", "    if False:\n        reason"),
        (
            "what is floppy within the error is left open",
            "    if cone.is_floppy_within_error:\n",
            "    if False:\n",
        ),
        ("mixtures of soft motions are known", "value <= _UNMIXED or size", "size"),
        (
            "values that could be rounding are surely none",
            "value <= _UNMIXED or size <= _SURE * known",
            "value <= _UNMIXED",
        ),
        ("gaps that let a soft motion go hold it", "change[:count][size**2 <= _SURE * cone.gap_c] = 0.0", "pass"),
        ("one direction of a soft motion is looked at", "for one in (change, -change)", "for one in (change,)"),
        ("nothing need hold a soft motion", "> (_BOTH_WAYS * size) ** 2", "> -1.0"),
        (
            "a motion that opens nothing unjams",
            "    if opening and not (len(stretch)",
            "    if False and not (len(stretch)",
        ),
        (
            "an opening as small as rounding is one",
            "float(stretch.mean()) > ROUNDING * size",
            "float(stretch.mean()) > 0.0",
        ),
        (
            "a motion that closes contacts by a thousandth closes none",
            "-float(stretch.min(initial=0.0)) <= cone.rounding * size\n",
            "-float(stretch.min(initial=0.0)) <= 1e-3 * size\n",
        ),
        (
            "closing is measured against any closing",
            "-float(stretch.min(initial=0.0)) <= cone.rounding * size\n",
            "True\n",
        ),
        (
            "the rules are not enforced before",
            "stretch = cone.opening @ cone.keeping_rules(motion)\n    size",
            "stretch = cone.opening @ motion\n    size",
        ),
        (
            "motions that are no numbers go on",
            "if not np.isfinite(change).all() or closing <= 0.0:",
            "if closing <= 0.0:",
            "such motions make the largest closing NaN, and every comparison after it refuses them",
        ),
        (
            "large closings are shut by projection",
            "if times * closing > _LITTLE * size:",
            "if False:",
            "closes_nothing checks what projection makes of them: more proofs are found, none is wrong",
        ),
        (
            "rules may change where contacts are shut",
            "shut[count : count + cone.held.shape[0]] = True",
            "pass",
            "closes_nothing enforces the rules before it looks, and so does what is returned",
        ),
        (
            "all contacts may be shut",
            "if opening and shut[:count].all():",
            "if False:",
            "a motion that opens nothing is refused by closes_nothing all the same",
        ),
        (
            "a shut motion is a proof unchecked",
            "if float(np.abs(kept).max()) > 0.5 * size and closes_nothing(cone, kept, opening=opening):",
            "if float(np.abs(kept).max()) > 0.5 * size:",
        ),
        (
            "a shut motion may be as small as rounding",
            "if float(np.abs(kept).max()) > 0.5 * size and closes_nothing",
            "if closes_nothing",
        ),
        (
            "nothing closes hardly",
            "> _TYPICAL_ROUNDING * cone.rounding * float(np.abs(motion).max(initial=0.0))",
            "> np.inf",
        ),
        ("multipliers settle nothing and are not asked", "MOVED)\n\n\ndef borne", "np.inf)\n\n\ndef borne"),
        ("weights that are no numbers bear", "if not np.isfinite(weight).all() or far", "if far"),
        (
            "weights far from balance bear",
            "return (weight, longest) if far * longest <= NEAREST else None",
            "return (weight, longest)",
        ),
        (
            "stress that pulls turns a load round",
            "if not (stress[pressing] > 0.0).all():",
            "if False:",
            "the weights that it makes are checked by borne, where those that pull count as none",
        ),
        ("one load decides", "for sign in (1.0, -1.0):", "for sign in (1.0,):"),
        (
            "a motion of a load is a proof unchecked",
            "proof = kept_open(cone, motion, opening=False) if size > MOVED else motion",
            "proof = motion",
        ),
        (
            "a load's answer stands without multipliers",
            "if proof is not None and _settled(cone, solve):",
            "if proof is not None:",
        ),
        (
            "motions that the loads' rounding hides are not looked for",
            "    # a motion that the loads' rounding hides\n    if fallback and",
            "    # a motion that the loads' rounding hides\n    if False and",
        ),
        (
            "a load's motion that closes hardly is not doubted",
            "if fallback and proof is not None and closes_hardly(cone, proof):",
            "if False:",
        ),
        ("doubts are not asked of the certificate", "if checked.jammed is not False:", "if checked.jammed is True:"),
    ),
    *_guards(
        "packmech/jamming/motion_cone.py",
        (
            "too few rows hold",
            "if self.rows.shape[0] < self.unknowns - self.dimension:",
            "if False:",
            "the rows then have a motion that they do not see, which softest finds to rounding",
        ),
        (
            "a soft motion that changes rows is floppy",
            "value**2 <= FLOPPY and self.changes_nothing(motion)",
            "value**2 <= FLOPPY",
        ),
        (
            "a motion that changes no row is floppy however stiff",
            "value**2 <= FLOPPY and self.changes_nothing(motion)",
            "self.changes_nothing(motion)",
            "a change by rounding of the rows is far below the threshold of rank, 1e-5, up to any size of packing",
        ),
        ("no motion is soft", "FLOPPY = 1e-10\n", "FLOPPY = 1e-40\n"),
        (
            "a thousand roundings change nothing",
            "return stretch <= self.rounding * float",
            "return stretch <= 1e3 * self.rounding * float",
        ),
        ("contacts are known exactly", "stretch <= _KNOWN * self.slack * float", "stretch <= 0.0 * float"),
        ("stiff motions are floppy within the error", "return value**2 <= FLOPPY and stretch <=", "return stretch <="),
        ("gaps are no slack", "slack = float(np.abs(gap).max(initial=0.0))", "slack = 0.0"),
        (
            "rounding of the coordinates is no slack",
            "slack += float(np.spacing(extent)) / packing.reference_diameter",
            "pass",
        ),
        (
            "soft modes count as floppy",
            "return count if count and (self.is_floppy or within_error) else 0",
            "return count",
        ),
        ("a volume that links hold has a rule", "if outside @ outside < _HELD**2:", "if False:"),
        ("the volume may grow", "-trace_vector(d) / np.sqrt(d)", "trace_vector(d) / np.sqrt(d)"),
        ("links are not kept", "return self._keeper.keep(motion)", "return motion"),
    ),
    *_guards(
        "packmech/jamming/contact_selection.py",
        (
            "two numbers of excess contacts are a plateau",
            "for level in self.levels}) <= 1",
            "for level in self.levels}) <= 2",
        ),
        (
            "an empty network is on the plateau of a full one",
            "{(level.excess, level.contacts > 0) for",
            "{level.excess for",
        ),
        ("the widest level is the tolerance", "10.0 * tolerance) if tolerance > 0", "tolerance) if tolerance > 0"),
        ("every packing is at rest", "return self.residual <= self.limit", "return True"),
        ("rounding is not allowed for at rest", "max(rest_tolerance, FLOORS * floor), law)", "rest_tolerance, law)"),
        ("only rounding is allowed for at rest", "max(rest_tolerance, FLOORS * floor), law)", "FLOORS * floor, law)"),
        ("one contact fewer can jam", "fewest = d * particles - d + 1", "fewest = d * particles - d"),
        ("links count for nothing", "fewest -= link_rules(packing, kept).position.shape[0]", "pass"),
        (
            "crystals without overlap have no tolerance",
            "max(OVERLAPS * mean, MINIMUM_GAP_TOLERANCE) if",
            "OVERLAPS * mean if",
        ),
        ("links bear no force at rest", "net = net - (links.gradient_lx.T", "net = net - 0.0 * (links.gradient_lx.T"),
        (
            "net forces are compared with the largest force",
            "mean = float(np.abs(terms.first_c).mean())",
            "mean = float(np.abs(terms.first_c).max())",
        ),
    ),
    *_guards(
        "packmech/jamming/classify.py",
        (
            "a packing out of balance is judged",
            "    reason = out_of_balance(rest, selection)\n    if reason:\n        return _left_open",
            "    reason = out_of_balance(rest, selection)\n    if False:\n        return _left_open",
        ),
        (
            "a packing off its plateau is judged",
            "    reason = off_plateau(selection)\n    if reason:\n",
            "    reason = off_plateau(selection)\n    if False:\n",
        ),
        (
            "the fewest contacts are not asked",
            "kept = within(0).jammed if may else (None, None)",
            "kept = (True, True)",
        ),
        (
            "the fewest contacts are asked for one answer only",
            "within(0).jammed[0] if may else None, within",
            "True, within",
        ),
        ("the most contacts are not asked", "kept = (collective is False, strict is False)", "kept = (True, True)"),
        ("the most contacts are not asked for strains", "within(2).jammed[1] is False)", "True)"),
        ("forces at second order block nothing", "if not packing.links or answer.verdict != NOT_JAMMED:", "if True:"),
        (
            "jammed may always stand",
            "return unique or selection.mean_overlap * fewest.particles**2 < SMALL_OVERLAP",
            "return True",
        ),
        (
            "jammed may stand where pressure has closed gaps",
            "selection.mean_overlap * fewest.particles**2 < SMALL_OVERLAP",
            "selection.mean_overlap < SMALL_OVERLAP",
        ),
        ("a state is the only one with any contacts", "== 1 and fewest.excess == at.excess", "== 1"),
        ("many states count as one", "answer.states_of_self_stress == 1 and fewest", "fewest"),
        (
            "strictly jammed says nothing of the fixed box",
            "strictly.verdict == JAMMED and collectively.verdict == AMBIGUOUS:",
            "False:",
        ),
        (
            "not collectively jammed says nothing of strains",
            "elif collectively.verdict == NOT_JAMMED and strictly.verdict == AMBIGUOUS:",
            "elif False:",
        ),
        ("stability is claimed away from rest", "rest is not None and rest.at_rest:", "rest is not None:"),
        (
            "the local answer does not ask for rest",
            'reason = out_of_balance(rest, selection) or (off_plateau(selection) if emptied else "")',
            'reason = off_plateau(selection) if emptied else ""',
        ),
        (
            "the local answer does not ask for the plateau",
            'reason = out_of_balance(rest, selection) or (off_plateau(selection) if emptied else "")',
            "reason = out_of_balance(rest, selection)",
        ),
        ("an empty backbone that is not known is not jammed", "    if judged.jammed[0] is None:\n", "    if False:\n"),
        ("what no solver could tell is not jammed", "AMBIGUOUS if finding.jammed is None else JAMMED if", "JAMMED if"),
        ("given contacts are not checked", "            check_given(packing, contacts)\n", ""),
        ("no backbone is stable", "    if rattling_n.all():\n        return False\n", ""),
        (
            "fewer contacts may hold fewer particles",
            "if few.particles != at.particles or few.contacts",
            "if few.contacts",
        ),
        (
            "contacts too few to jam strictly are asked",
            "few.contacts == at.contacts or few.excess < d * (d + 1) // 2 - 1",
            "few.contacts == at.contacts",
        ),
        (
            "rest is not asked before the fewest contacts",
            "or out_of_balance(rest, selection) or selection.backbone is None",
            "or selection.backbone is None",
        ),
    ),
    *_guards(
        "packmech/jamming/backbone.py",
        (
            "a part that no solver could judge is not jammed",
            "return first if smaller is not None and judged.jammed[0] is False else _left_open(first)",
            "return first",
        ),
        ("a motion of a part that is not known unjams", "    if collective.jammed is False:\n", "    if False:\n"),
        (
            "a strain of a part that is not known unjams",
            "    if strict.jammed is False and strict.motion is not None:\n",
            "    if False:\n",
        ),
        ("contacts that do not jam imply that more do", "if fewer.jammed != (True, True) or not", "if not"),
        ("contacts of other particles imply an answer", " or not np.array_equal(fewer.strict[0].kept_n, kept):", ":"),
        (
            "rattlers held by rounding unjam",
            "if proof is not None and not closes_hardly(cone, proof):",
            "if proof is not None:",
        ),
        ("what moves nothing unjams rattlers", "        if cone.is_floppy:\n", "        if True:\n"),
        ("a program that failed names contacts", "if opened.solve.outcome is Outcome.CONVERGED:", "if True:"),
        ("what carries may turn freely", "    return contacts.among(~apart)\n", "    return contacts\n"),
    ),
    *_guards(
        "packmech/jamming/programs.py",
        (
            "weights that pull bound a load",
            "    pressing = np.maximum(weight, 0.0)\n",
            "    pressing = weight.copy()\n",
        ),
        ("the volume's multiplier must press both ways", "    pressing[free] = weight[free]\n", ""),
        (
            "loads along translations count",
            "force_nd -= force_nd.mean(axis=0) if",
            "force_nd -= 0.0 * force_nd.mean(axis=0) if",
        ),
        (
            "a force program that failed has forces",
            "    if outcome is not Outcome.CONVERGED:\n        smallest",
            "    if False:\n        smallest",
        ),
        (
            "an opening program that failed has a motion",
            "    if found.solve.outcome is not Outcome.CONVERGED:\n        empty",
            "    if False:\n        empty",
        ),
        (
            "a status that is not known is success",
            "_OUTCOMES.get(status, Outcome.INACCURATE)",
            "_OUTCOMES.get(status, Outcome.CONVERGED)",
        ),
        ("any motion has the length 1", "np.sqrt(n) * length > NEAREST:", "length > 0.0:"),
        (
            "all contacts carry",
            "return Openings(force > 0.5, weight, _unpinned",
            "return Openings(force > -0.5, weight, _unpinned",
        ),
    ),
    *_guards(
        "packmech/jamming/shaped.py",
        ("contacts that bear nothing count", "one.select(force > _CARRYING * float(force.mean()))", "one"),
        ("shapes out of balance are judged", "    if not rest.at_rest:\n", "    if False:\n"),
        (
            "a rank that depends on its tolerance is known",
            "    if not states.certain:\n        return answer",
            "    if False:\n        return answer",
        ),
        ("shapes without balanced forces go on", "    if not states.count:\n", "    if False:\n"),
        ("several states that pull are the only one", "        if states.count == 1:\n", "        if True:\n"),
        ("motions that lose energy do not fall", "if len(value) and value[0] < -scale:", "if False:"),
        (
            "an unstable state among several is not jammed",
            "answer(NOT_JAMMED if states.count == 1 else AMBIGUOUS",
            "answer(NOT_JAMMED if True else AMBIGUOUS",
        ),
        ("flat motions are held", "    if flat:\n", "    if False:\n"),
        (
            "forces that pull are positive",
            "return force / force.mean() if force.min() > 0.0 else None",
            "return force / force.mean()",
        ),
        (
            "the law's forces need no balance",
            "if np.abs(force - own).max() > max(_BALANCED, rest.limit)",
            "if np.abs(force - own).max() > 1e9 * max(_BALANCED, rest.limit)",
        ),
        ("first order ignores floppy motions", "force is not None and floppy == 0", "force is not None"),
        (
            "strictly jammed shapes are collectively open",
            "if strictly.verdict == JAMMED and collectively.verdict == AMBIGUOUS:",
            "if False:",
        ),
    ),
    *_guards(
        "packmech/mechanics/stability.py",
        (
            "what was not judged is a minimum",
            "return 1 if self.negative is None else",
            "return 0 if self.negative is None else",
        ),
        (
            "the reason is not reported",
            "        if self.negative is None:\n            found",
            "        if False:\n            found",
        ),
        (
            "saddles are looked for below the certain bound",
            "return min(max(SOFT * stiffest, _SIDEWAYS * unbalanced / radius), _CERTAIN * stiffest)",
            "return max(SOFT * stiffest, _SIDEWAYS * unbalanced / radius)",
        ),
        (
            "forces that do not balance are no excuse",
            "max(SOFT * stiffest, _SIDEWAYS * unbalanced / radius)",
            "SOFT * stiffest",
        ),
        (
            "rounding is a saddle",
            "max(SOFT * stiffest, _SIDEWAYS * unbalanced / radius)",
            "_SIDEWAYS * unbalanced / radius",
        ),
        ("only large curvatures count", "_CERTAIN = 5e-9\n", "_CERTAIN = 5e-1\n"),
        (
            "what cannot be factored is stable",
            '        return Stability(None, "the second derivative cannot be factored")',
            "        return Stability(0)",
        ),
        (
            "shapes without a second derivative are judged",
            'return f"{type(lacking[0]).__qualname__} has no body_second"',
            'return ""',
        ),
        (
            "rattlers are left out",
            'contact_network(packing, effects, rattlers="keep")',
            'contact_network(packing, effects, rattlers="remove")',
        ),
        ("links are left out", "    if len(links) and (links.i_l != links.j_l).all():\n", "    if False:\n"),
        (
            "friction is left out",
            "if acting_friction(scene.effects) is not None or rough_walls(scene.effects):",
            "if False:",
        ),
        (
            "second-order work decides where contacts stick",
            "    if negative and (matrix.shape[0] <= _DENSE or rows.shape[0]):\n",
            "    if False:\n",
        ),
        (
            "unstable directions that stick are not counted",
            "negative = int((near.real < -bound).sum())",
            "negative = 0",
        ),
        ("unbalanced forces excuse nothing where contacts stick", ", _SIDEWAYS * unbalanced)\n", ", 0.0)\n"),
    ),
    *_guards(
        "packmech/mechanics/elasticity.py",
        (
            "negative modes are stable",
            "return self.negative_modes == 0 and self.cauchy_least",
            "return self.cauchy_least",
        ),
        (
            "strains that work against their stress are stable",
            "return self.negative_modes == 0 and self.cauchy_least >= -1e-10 * largest",
            "return self.negative_modes == 0",
        ),
        (
            "negative strains are not counted",
            "return self.negative_positions + self.negative_strains",
            "return self.negative_positions",
        ),
        (
            "negative positions are not counted",
            "return self.negative_positions + self.negative_strains",
            "return self.negative_strains",
        ),
        ("particles that fall apart are stable in their box", "return self.negative_positions == 0", "return True"),
        ("strains that cost nothing are unstable by rounding", "< -SOFT * scale))", "< 0.0))"),
        ("strains are unstable beyond a thousandth only", "< -SOFT * scale))", "< -1e-3 * scale))"),
        (
            "strains without a relaxation are stable",
            "    if unsolved:\n        negative",
            "    if False:\n        negative",
        ),
        ("every relaxation has a solution", "    if relaxation.residual <= _INCONSISTENT:\n", "    if True:\n"),
        (
            "a strain without a relaxation is none",
            "return max(negative - relaxation.negative, 1)",
            "return negative - relaxation.negative",
        ),
        (
            "contacts that do not agree with their motion are an answer",
            "relaxation.residual > _INCONSISTENT or not found.consistent)",
            "relaxation.residual > _INCONSISTENT)",
        ),
        (
            "unstable packings have averages",
            'if not (_is_not_negative(matrix) if tangent == "affine" else self.stable):',
            "if False:",
        ),
        (
            "a negative affine matrix has averages",
            "return bool(np.linalg.eigvalsh(matrix_ee)[0] >= -1e-10",
            "return bool(np.linalg.eigvalsh(matrix_ee)[0] >= -1e10",
        ),
        ("unstable packings have an anisotropy", '        if not self.stable:\n            return float("nan")\n', ""),
        (
            "rattlers that bear the pressure are left out",
            "if forces.at_rest and abs(whole - virial) > _BORNE * abs(whole):",
            "if False:",
        ),
        ("soft strains are stiff", "soft = direction[size <= SOFT * lift]", "soft = direction[size < 0.0]"),
        ("the compliance away from rest is given", "    if not forces.at_rest:\n", "    if False:\n"),
        (
            "no rattlers are warned of",
            "        whole.warn_of_rattlers(scene.packing.particles - len(system.network.index_n))\n",
            "",
        ),
    ),
    *_guards(
        "packmech/mechanics/modes.py",
        (
            "rounding is an unstable mode",
            "np.count_nonzero((self.eigenvalue_m < 0.0) & ~self.zero_m)",
            "np.count_nonzero(self.eigenvalue_m < 0.0)",
        ),
        ("soft modes are zero", "<= 1e-10 * self.largest", "<= 1e-2 * self.largest"),
        ("missed modes are not looked for", "return found.number - listed, found.certain", "return 0, True"),
        ("some modes are all", "return len(self) == self.available", "return True"),
        ("unstable modes lie below the shift", "    while operator.below(shift):\n", "    while False:\n"),
        ("translations are modes", "full += (4.0 * largest or 1.0) * (translation @ translation.T)", "pass"),
    ),
    *_guards(
        "packmech/mechanics/state_density.py",
        ("modes may be some of all", "        if not source.complete:\n", "        if False:\n"),
        ("zero modes fall on either side of an edge at zero", "level[np.abs(level) < rounding] = -rounding", "pass"),
        ("translations of copies are states", "below = below - np.where(np.array(level) > 0.0, d, 0)", "pass"),
        (
            "a wave and the one that runs back are one",
            "np.where(place == mirror, 1, 2)",
            "np.where(place == mirror, 1, 1)",
        ),
        ("counts by rounding are certain", "sum(not one.certain for one in found)", "0"),
    ),
    *_guards(
        "packmech/mechanics/vibrations.py",
        ("translations are modes", "self.translation.shape[1] if level > 0.0 else 0", "0"),
        ("translations are available", "self.operator.motions - self.translation.shape[1]", "self.operator.motions"),
        (
            "zero modes lie below zero",
            "return -ZERO * unit if abs(level) <= np.finfo(float).tiny else level",
            "return ZERO * unit if abs(level) <= np.finfo(float).tiny else level",
        ),
    ),
    *_guards(
        "packmech/mechanics/mode_counts.py",
        ("no rattlers are warned of", "    rest.warn_of_rattlers(", "    (lambda _: None)("),
        ("zero modes are unstable", "unstable = vibrations.count(-floor) if soft.number else soft", "unstable = soft"),
    ),
    *_guards(
        "packmech/linalg/inertia.py",
        ("every count is certain", "return self.doubt < 1.0", "return True"),
        ("zero pivots do not matter", "if factor.inertia.zero:", "if False:"),
        ("rounding of entries does not matter", "_ROUNDING * largest / distance if distance > 0.0 else np.inf", "0.0"),
        ("what was factored is what was asked for", "spread = max(spread, _norm(", "spread = max(spread, 0.0 * _norm("),
        ("a count holds as far as it is certain to", "distance * max(1.0 - doubt, 0.0)", "1e3 * distance"),
    ),
    *_guards(
        "packmech/mechanics/rigid_clusters.py",
        (
            "every decomposition is certain",
            "        free_stress, least_stress, residual, certain,",
            "        free_stress, least_stress, residual, True,",
        ),
        ("motions softer than the ranks resolve do not matter", "one_rank and not soft and", "one_rank and"),
        ("counting knows that normal forces turn no disc", "nan, not _pushes_centers(joints),", "nan, True,"),
    ),
    *_guards(
        "packmech/measure/counting.py",
        ("contacts of rattlers count", "2.0 * len(contacts.among(~rattling)) / kept", "2.0 * len(contacts) / kept"),
        (
            "rattlers count",
            "2.0 * len(contacts.among(~rattling)) / kept",
            "2.0 * len(contacts.among(~rattling)) / packing.particles",
        ),
        ("overlaps that hold nothing are not warned of", "        if overlapping:\n", "        if False:\n"),
        ("rounding is an overlap", "_ROUNDING * contacts.contact_distance_c", "-1.0 * contacts.contact_distance_c"),
        (
            "held particles are counted",
            "counted = ~rattler_n if held_n is None else ~rattler_n & ~held_n",
            "counted = ~rattler_n",
        ),
    ),
    *_guards(
        "packmech/measure/contact_forces.py",
        (
            "forces far from balance are at rest",
            "        if self.residual <= tolerance:\n            return True\n",
            "        return True\n",
        ),
        (
            "rounding is not allowed for at rest",
            "return self.largest_imbalance <= _FLOORS * rounding_force",
            "return self.largest_imbalance <= 0.0 * rounding_force",
        ),
        (
            "contacts bear whatever is out of balance",
            "part = _BEARING if self.residual <= _BEARING else 0.0",
            "part = 0.0",
        ),
        (
            "contacts that bear little are none",
            "part = _BEARING if self.residual <= _BEARING else 0.0",
            "part = _BEARING",
        ),
        ("no rattlers are warned of", "        if left_out and not self.at_rest:\n", "        if False:\n"),
        ("links bear no force", "            force = self._free(force + sum_both(links.pairs, pull, -pull))\n", ""),
        (
            "torques need no balance",
            "            parts.append(self.torque_nk / packing.radius_n[:, None])\n",
            "            pass\n",
        ),
        (
            "torques on shapes need no balance",
            '            parts.append(np.einsum("nkt,nt->nk"',
            '            _ = (np.einsum("nkt,nt->nk"',
        ),
        ("contacts at the limit are counted once", "/ count + limited) / (rows", "/ count + 0.5 * limited) / (rows"),
        ("contacts at the limit are counted d times", "/ count + limited) / (rows", "/ count + d * limited) / (rows"),
        (
            "links of the frictional count are left out",
            "(d + (turns - linked) / count + limited)",
            "(d + turns / count + limited)",
        ),
        (
            "links of the frictionless count are left out",
            "(int(turns_n[held].sum()) - linked) / count)",
            "int(turns_n[held].sum()) / count)",
        ),
        (
            "rough walls are not counted",
            "        if rough_walls(self.scene.effects):\n            return math.nan\n",
            "",
        ),
        (
            "springs at their limits do not count",
            "self.at_limit_per_particle + self._turning_at_limit() / count",
            "self.at_limit_per_particle",
        ),
        (
            "rattlers count in the sliding contacts",
            "held = int((~self.rattlers_n).sum())\n        return int",
            "held = len(self.rattlers_n)\n        return int",
        ),
        ("spheres between two contacts do not spin", "(count == 2) & ~resisting", "(count == 1) & ~resisting"),
        (
            "contacts of rattlers bear",
            "return np.asarray(self.bearing_c & ~(rattling[self.contacts.i_c] | rattling[self.contacts.j_c]))",
            "return np.asarray(self.bearing_c)",
        ),
    ),
    *_guards(
        "packmech/measure/rattlers.py",
        (
            "forces out of balance show a backbone",
            "> 0.0 and balance < _BALANCED * push.min())",
            "> 0.0 and balance < np.inf)",
        ),
        (
            "forces that pull show a backbone",
            "return bool(push.min() > _LOADED * push.mean() > 0.0 and balance",
            "return bool(push.mean() > 0.0 and balance",
            "what is unbalanced is compared with the smallest push, which a pull makes negative",
        ),
        (
            "a solution that tells nothing tells",
            "if found.solve.outcome is Outcome.CONVERGED and sure:",
            "if found.solve.outcome is Outcome.CONVERGED:",
        ),
        ("a program that failed tells", "if found.solve.outcome is Outcome.CONVERGED and sure:", "if sure:"),
        (
            "a group that nothing holds together is one",
            "if len(backbone.among(same)) else np.ones(particles, dtype=bool)",
            "if True else np.ones(particles, dtype=bool)",
        ),
        (
            "a cluster's own contacts hold it",
            "    between = ~np.concatenate([inside, inside,",
            "    between = ~0 * np.concatenate([0 * inside, 0 * inside,",
        ),
        ("overlaps out of balance push", "np.asarray(_SHOWN * push > worst[owner])", "np.asarray(push > 0.0)"),
        (
            "overlaps as small as what is unbalanced push",
            "np.asarray(_SHOWN * push > worst[owner])",
            "np.asarray(0.1 * push > worst[owner])",
        ),
        (
            "all may rattle where nothing is left",
            "    if rattling.all():\n        raise ValueError",
            "    if False:\n        raise ValueError",
        ),
    ),
    *_guards(
        "packmech/jamming/room.py",
        (
            "a program that failed moves rattlers",
            "    if solution.solve.outcome is not Outcome.CONVERGED:\n",
            "    if False:\n",
        ),
        (
            "rattlers go where they have less room",
            "better_g = reached_g > room_g + 1e-15",
            "better_g = reached_g > -1.0",
        ),
        ("squeezed rattlers stay", "    if not waiting.any():\n", "    if True:\n"),
        ("other groups limit the room", "here.select((group_c == g) & push_c)", "here.select(push_c)"),
        ("pairs that do not push limit the room", "here.select((group_c == g) & push_c)", "here.select(group_c == g)"),
    ),
    *_guards(
        "packmech/jamming/referee.py",
        ("a tolerance may be negative", "not 0.0 <= self.tolerance < WIDEST", "not self.tolerance < WIDEST"),
        ("a tolerance may be wide", "not 0.0 <= self.tolerance < WIDEST", "not 0.0 <= self.tolerance"),
        ("contacts need not touch", "if (gap > self.tolerance + 4.0 * _EPS).any():", "if False:"),
        (
            "contacts may be of rattlers",
            "if not (self.backbone_n[self.pairs[0]].all() and self.backbone_n[self.pairs[1]].all()):",
            "if False:",
        ),
        (
            "forces may pull",
            "force.shape != (count,) or not (force > 0.0).all():",
            "force.shape != (count,):",
            "the smallest weight must be above its error; if all pull, minus these balance and push",
        ),
        ("forces need no balance", "if not min(smallest, pressing) > error:", "if not min(smallest, pressing) > 0.0:"),
        ("what moves softly is held by small forces", "* (1.0 + 1e-9) / least", "* (1.0 + 1e-9)"),
        ("stresses need no balance", "rest += [(2 - (a == b)) * (stress", "_ = [(2 - (a == b)) * (stress"),
        ("net forces are those on i alone", "        np.add.at(net, j, push)\n", ""),
        ("rounding may hide a floppy motion", "    gram[np.diag_indices(n)] -= shift\n", ""),
        ("infinite sums prove", "    if not np.isfinite(shift):\n", "    if False:\n"),
        ("what no backbone has may be held", "        if not left:\n", "        if not self.backbone_n.any():\n"),
        (
            "what can be taken out is backbone",
            "if not left.issuperset(np.flatnonzero(self.backbone_n).tolist()):",
            "if False:",
        ),
        (
            "particles outside of the backbone may hold each other",
            "if not len(self.links[0]) and not all(self.backbone_n[n] for n in left):",
            "if False:",
        ),
        ("a translation is a motion", "if not size > 0.0 or float", "if float"),
        ("a motion may enlarge the box", " or float(np.trace(strain)) > limit / self.unit:", ":"),
        ("a fixed box may be strained", 'or (strain.any() and question != "strict"):', "or False:"),
        (
            "a strain may turn the box",
            "if not np.array_equal(strain, strain.T) or (",
            "if (",
        ),
        ("a motion may close contacts", "max(-float(stretch[:count].min(initial=0.0)), ", "max(0.0, "),
        ("a motion may stretch links", "float(np.abs(stretch[count:]).max(initial=0.0)))", "0.0)"),
        ("pairs that touch may be left out", "and one not in listed:", "and False:"),
        ("particles may overlap", "if gap[j] < -deepest:", "if False:"),
        ("a particle's own images hold nothing", "(i == j and image > (0,) * self.d)", "False"),
        (
            "particles next to a side of the box touch nothing across it",
            "reach = 1 + np.floor(",
            "reach = 0 * np.floor(",
        ),
        ("all contacts nearly in a half space hold nothing", ">= -1e-8).all()", ">= -0.5).all()"),
        (
            "d contacts hold a particle",
            "if len(normal_cd) <= d:",
            "if len(normal_cd) < d:",
            "d normals always lie in a closed half space, which the next lines find",
        ),
        (
            "strictly jammed need not be collectively so",
            'if proven["strict"] == JAMMED and proven["collective"] == NOT_JAMMED:',
            "if False:",
            "both proofs would have to hold, and a packing that is strictly jammed is collectively so",
        ),
        ("what was not proven is accepted", "            accepted = False\n", ""),
    ),
    *_guards(
        "packmech/jamming/tiled.py",
        ("forces are not asked for", "if collectively.contact_force_c is None or not (", "if not ("),
        (
            "a wave that changes nothing is one of a small change",
            "        if value <= _FLOPPY:\n",
            "        if False:\n",
        ),
        ("a cell is covered whatever its middle", "if value > waves.change(half):", "if True:"),
        ("a cell is long where a corner is", ".sum(axis=1)).max() <= long:", ".sum(axis=1)).min() <= long:"),
        (
            "half of the wave vectors are left out",
            "np.array([0.25, *[0.5] * (d - 1)])",
            "np.array([0.25, *[0.25] * (d - 1)])",
        ),
        (
            "long waves of no strain are rigid",
            "    if not long:\n",
            "    if False:\n",
            "cells about 0 are halved until there are too many, and the answer is as open",
        ),
        ("long waves err by their strain alone", "np.hypot(*strained.errors(k))", "strained.errors(k)[0]"),
        ("floppy strains leave a bound", "if not strained.smallest > _FLOPPY:", "if False:"),
        ("fewer rows than columns have full rank", "        if self.count < self.size:\n", "        if False:\n"),
        ("copies are strict where they are collective", "{JAMMED: strictly.verdict, ", "{JAMMED: JAMMED, "),
        ("the real part alone moves", "parts[int(np.argmax(spread))]", "parts[0]"),
        ("waves of their own conjugates are left out", "parts <= opposite", "parts < opposite"),
        ("the bound on changes is of one end", "        np.add.at(both, self.at_j, np.abs(self.normal))\n", ""),
    ),
    *_faults(
        "packmech/mechanics/waves.py",
        (
            "what grows swings",
            "frequency[k] = np.copysign(np.sqrt(np.abs(value)), value)",
            "frequency[k] = np.sqrt(np.abs(value))",
        ),
        ("what lies below is not looked for", "    while eigenvalues_below(real, shift):\n", "    while False:\n"),
        ("what Lanczos missed is not counted", "// 2 - (k + 1)", "// 2 * 0"),
        ("waves are counted within a degenerate set", "if gap[k] <= _DEGENERATE * bound:", "if False:"),
        (
            "sound does not relax",
            "return assembled.corner_ee - found.relief_ee, found",
            "return assembled.corner_ee, found",
        ),
        ("rattlers are heavy", "packing.mass_n[system.network.index_n].sum()", "packing.mass_n.sum()"),
        ("masses do not matter", "1.0 / np.sqrt(np.repeat(", "1.0 / (np.repeat("),
        ("lines of no length have no points", "np.maximum(1, np.rint(share", "np.maximum(0, np.rint(share"),
    ),
    *_faults(
        "packmech/mechanics/wave_matrices.py",
        ("copies move as the box does", "phase[:, None] * ends[1]", "ends[1]"),
        ("copies lead on one side and lag on none", "images.append((b - a) * image)", "images.append(b * image)"),
        ("images are those of the vectors", "np.rint((vector_cd - inside) @", "np.rint((vector_cd) @"),
        ("copies do not turn", "change[1, :, d + t :, d:] = turn_nkt[j].transpose(0, 2, 1)", "pass"),
    ),
]


def read_drawn() -> list[Fault]:
    """Return the faults that were drawn and kept."""
    kept = json.loads(DRAWN.read_text(encoding="utf-8")) if DRAWN.is_file() else []
    return [Fault(**one | {"tests": tuple(one.get("tests", ()))}) for one in kept]


def keep_drawn(faults: list[Fault]) -> None:
    """Add faults to those that were drawn and kept; those of the same names stay as they are."""
    kept = {one.key: one for one in [*faults, *read_drawn()]}
    left_out = Fault("", "", "", "")
    rows = [
        {name: value for name, value in kept[key]._asdict().items() if value != getattr(left_out, name)}
        for key in sorted(kept)
    ]
    DRAWN.write_text(json.dumps(rows, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def stands(fault: Fault, root: Path) -> bool:
    """Return whether the text of a fault still stands once in its file, so that it can be tried."""
    path = root / fault.file
    return path.is_file() and path.read_text(encoding="utf-8").count(fault.was) == 1


# part of the package by the start of its files, the first that fits
PARTS = {
    "packmech/effects/": "laws",
    "packmech/contacts/": "contacts",
    "packmech/dynamics/": "kernels",
    "packmech/minimize/second_order/": "Hessians",
    "packmech/minimize/": "kernels",
    "packmech/mechanics/stability.py": "stability",
    "packmech/mechanics/elasticity.py": "moduli",
    "packmech/mechanics/relaxation.py": "moduli",
    "packmech/mechanics/": "Hessians",
    "packmech/linalg/mandel.py": "moduli",
    "packmech/jamming/": "certificates",
    "packmech/measure/": "counts",
    "packmech/loop/": "checkpoints",
    "packmech/files/": "checkpoints",
    "packmech/view/": "checkpoints",
    "envs/": "rewards",
}


def part_of(file: str) -> str:
    """Return the part of the package that a file belongs to."""
    return next((part for start, part in PARTS.items() if file.startswith(start)), "others")
