"""Facts about reports: counts by hand, units, and what is said when something is missing or unstable."""

import math
import time
from typing import NamedTuple

import numpy as np
import pytest

import packmech as pm
from packmech.result import Stage, Summary
from packmech.view.report import Report, _part, examine, isostatic_contacts, result_rows

HARMONIC = (pm.Repulsion(law=pm.Harmonic()),)


def crystal(**options) -> pm.Scene:
    return pm.Scene(pm.lattice_packing("triangular", repeats=(4, 4), **{"relative_overlap": 1e-3, **options}), HARMONIC)


def row(rows, name):
    (found,) = [words for words in rows if words[0] == name]
    return found


@pytest.mark.parametrize(
    ("dimension", "strain", "count"), [(2, "isotropic", 127), (2, "free", 129), (3, "isotropic", 190), (3, "free", 195)]
)
def test_isostatic_counts_of_64_particles(dimension, strain, count):
    assert isostatic_contacts(64, dimension, strain) == count


def test_moduli_of_a_triangular_crystal_are_those_of_its_closed_form():
    """Springs k = eps / sigma^2 on a triangular lattice: B = sqrt(3)/2 k, G = sqrt(3)/4 k at zero overlap."""
    numbers = examine(crystal(relative_overlap=1e-9), modes=0).numbers
    assert numbers["bulk_modulus"] == pytest.approx(3**0.5 / 2, rel=1e-7)
    assert numbers["shear_modulus"] == pytest.approx(3**0.5 / 4, rel=1e-7)
    assert numbers["elastic_constants"]["xxxx"] == pytest.approx(3 * 3**0.5 / 4, rel=1e-7)
    assert numbers["elastic_constants"]["xyxy"] == pytest.approx(3**0.5 / 4, rel=1e-7)


@pytest.mark.parametrize("length", [1e-3, 1.0, 1e4])
def test_numbers_do_not_depend_on_the_unit_of_length(length):
    plain = examine(crystal()).numbers
    packing = crystal().packing
    scaled = pm.Packing(packing.position_nd * length, packing.radius_n * length, packing.box.scaled(length))
    other = examine(pm.Scene(scaled, HARMONIC)).numbers
    for name in ("packing_fraction", "pressure", "energy", "bulk_modulus", "shear_modulus"):
        assert other[name] == pytest.approx(plain[name], rel=1e-10), name
    assert np.allclose(other["lowest_frequencies"], plain["lowest_frequencies"], rtol=1e-8)


def test_a_scene_without_contacts_has_no_stiffness_and_is_not_jammed():
    report = examine(crystal(relative_overlap=-0.1))
    assert report.numbers["rattlers"] == 16
    assert report.numbers["contacts"] == 0
    assert report.numbers["collective"] == report.numbers["strict"] == "not jammed"
    assert report.numbers["bulk_modulus"] == 0.0
    assert row(result_rows(report.numbers, report.missing), "contacts")[2] == "isostatic: 0; 0 states of self stress"


def touching_kagome(**options) -> pm.Scene:
    return pm.Scene(pm.lattice_packing("kagome", repeats=(2, 2), **options), HARMONIC)


@pytest.mark.parametrize("length", [1e-6, 1.0, 1e6])
def test_particles_that_just_touch_have_no_force_residual(length):
    packing = touching_kagome().packing
    scaled = pm.Packing(
        packing.position_nd * length, packing.radius_n * length, pm.Box(packing.box.lattice_dd * length)
    )
    report = examine(pm.Scene(scaled, HARMONIC), modes=0)
    assert report.numbers["contacts"] == 24
    assert report.numbers["force_residual"] is None
    assert row(result_rows(report.numbers, report.missing), "force residual")[1:] == ("-", "no contact carries a force")


@pytest.mark.parametrize("overlap", [1e-12, 1e-6])
def test_particles_that_overlap_a_little_have_a_force_residual(overlap):
    assert examine(crystal(relative_overlap=overlap), modes=0).numbers["force_residual"] < 1e-2


def test_floppy_modes_have_frequency_zero_in_the_table_and_what_was_computed_in_the_numbers():
    report = examine(touching_kagome(), modes=6)
    row_ = row(result_rows(report.numbers, report.missing), "lowest frequencies")
    # 24 contacts on 24 coordinates with 6 states of self stress: 6 zero modes, 2 of them translations
    assert row_[1].split()[:4] == ["0"] * 4 and float(row_[1].split()[4]) > 0.1
    assert row_[2].endswith("1e-6 of the stiffest)")
    unit = np.sqrt(1.0 / touching_kagome().packing.mass_n.mean())
    found = pm.normal_modes(touching_kagome(), 6).frequency_m / unit
    assert report.numbers["lowest_frequencies"] == found.tolist()
    assert report.numbers["lowest_frequencies"][3] <= report.numbers["frequency_floor"] < 1e-5


def test_a_frequency_above_rounding_keeps_its_digits_and_its_sign():
    """A square crystal under pressure p falls apart with a growth rate of about sqrt(p), however small that is."""
    square = pm.lattice_packing("square", repeats=(4, 4), relative_overlap=1e-8)
    report = examine(pm.Scene(square, HARMONIC), modes=2)
    first = row(result_rows(report.numbers, report.missing), "lowest frequencies")[1].split()[0]
    assert -1e-3 < float(first) < -1e-5


def test_every_part_says_what_it_achieved_and_cost():
    stages = {stage.name: stage for stage in examine(crystal()).stages}
    assert set(stages) == {"verdict", "moduli", "modes"}
    assert all(stage.residual < 1e-10 and stage.seconds >= 0.0 for stage in stages.values())


def test_a_part_that_compiles_says_so_the_first_time_only(monkeypatch):
    monkeypatch.setattr("packmech.jit.cache.KernelCache._kept", lambda cache, sig: "Unmet" not in str(sig))

    class Unmet(NamedTuple):
        energy_scale: float = 1.0

    for name in ("energy", "first", "second"):
        setattr(Unmet, name, vars(pm.Harmonic)[name])
    scene = crystal().replace(effects=(pm.Repulsion(law=pm.law(Unmet)()),))
    report = Report(scene, {})
    for notes in ("compiling, once for all runs", ""):
        with _part(report, "verdict", lambda part: None):
            began = time.process_time()
            pm.energy(scene)
            report.stages.append(Stage("verdict", 0.0, seconds=time.process_time() - began))
        assert report.stages[-1].note.endswith(notes) and bool(report.stages[-1].note) == bool(notes)


def test_a_part_that_cannot_be_had_is_named_and_the_others_count(monkeypatch):
    def refuse(scene):
        raise ValueError("touching centers must not coincide, got particles 3 and 5")

    monkeypatch.setattr("packmech.view.report.elastic_moduli", refuse)
    report = examine(crystal())
    words = row(result_rows(report.numbers, report.missing), "moduli")
    assert words == ("moduli", "not available", "touching centers must not coincide, got particles 3 and 5")
    assert report.numbers["strict"] == "jammed"


def test_a_negative_shear_modulus_is_named():
    pressed = pm.Scene(pm.lattice_packing("square", repeats=(4, 4), relative_overlap=0.01), HARMONIC)
    report = examine(pressed, modes=0)
    assert report.numbers["shear_modulus"] < 0.0
    note = row(result_rows(report.numbers, report.missing), "shear modulus")[2]
    assert "NEGATIVE" in note
    assert "elastically unstable" in note


def test_one_state_of_self_stress_is_singular():
    numbers = {**examine(crystal(), modes=0).numbers, "states_of_self_stress": 1}
    assert row(result_rows(numbers, {}), "contacts")[2].endswith("1 state of self stress")


def test_the_summary_has_every_result_and_every_step():
    report = examine(crystal())
    rows = result_rows(report.numbers, report.missing)
    text = report.summary().markdown("crystal")
    assert all(f"| {name} |" in text for name, _, _ in rows)
    assert all(f"| {stage.name} |" in text for stage in report.stages)


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"scene": 3}, TypeError, "scene must be a Scene"),
        ({"strain": "loose"}, ValueError, "strain must be one of 'isotropic', 'free', got 'loose'"),
        ({"modes": -1}, ValueError, "modes must be an integer at least 0, got -1"),
    ],
)
def test_bad_arguments_are_named(arguments, error, message):
    with pytest.raises(error, match=message):
        examine(**{"scene": crystal(), **arguments})


def test_a_pile_has_no_rattlers_and_no_isostatic_count():
    """What has a weight rests on what it touches: the report counts contacts with walls beside the others."""
    start = pm.random_packing(24, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.4, seed=1)
    scene = pm.Scene(start, (pm.Repulsion(), pm.Gravity(0.0, -1e-3), pm.Walls(1, 0.2, 40.0)))
    scene = scene.replace(packing=pm.quench(scene, force_tolerance=1e-8).packing)
    numbers = examine(scene, modes=2).numbers
    assert numbers["rattlers"] == 0
    assert numbers["isostatic_contacts"] is None
    assert numbers["wall_contacts"] == len(pm.wall_contacts(scene)) > 0
    assert numbers["contacts"] == len(pm.find_contacts(scene.packing))
    # at rest the floor bears the weight
    weight = 1e-3 * scene.packing.mass_n.sum()
    assert numbers["weight"] == pytest.approx(weight, rel=1e-12)
    assert numbers["force_on_walls"] == pytest.approx(weight, rel=1e-6) and numbers["force_on_held"] == 0.0
    words = row(result_rows(numbers, {}), "force on supports")
    assert words[1] == f"{numbers['force_on_walls']:.6g}" and "on walls" in words[2]


def test_the_coordination_number_on_a_held_floor_is_that_of_what_moves():
    """Three discs that do not touch each other lie in hollows of six held ones: two contacts each."""
    floor = [[0.5 + x, 0.5] for x in range(6)]
    place = [*floor, *([1.0 + 2.0 * x, 0.5 + math.sqrt(0.75)] for x in range(3))]
    effects = (pm.Repulsion(pm.LinearSpring()), pm.Gravity(0.0, -1e-3), pm.FixedParticles(tuple(range(6))))
    scene = pm.Scene(pm.Packing(place, [0.5] * 9, pm.Box(np.diag([6.0, 20.0]))), effects)
    scene = scene.replace(packing=pm.quench(scene, force_tolerance=1e-8).packing)
    report = examine(scene, modes=0)
    assert report.numbers["coordination_number"] == 2.0 and report.numbers["held"] == 6
    words = row(result_rows(report.numbers, report.missing), "coordination number")[2]
    assert "neither rattles nor is one of 6 held" in words
    # of three discs: what holds the six bears their own weight beside it
    weight = 1e-3 * scene.packing.mass_n[6:].sum()
    assert report.numbers["weight"] == pytest.approx(weight, rel=1e-12)
    assert report.numbers["force_on_held"] == pytest.approx(weight, rel=1e-6)
    assert "on held particles," in row(result_rows(report.numbers, {}), "force on supports")[2]
    lifted = examine(scene.without(pm.Gravity), modes=0, verdict=False)
    assert "force on supports" not in [name for name, *_ in result_rows(lifted.numbers, {})]
    rough = pm.contact_forces(scene.replace(effects=(*effects, pm.Friction(0.5))))
    assert rough.coordination_number == 2.0
    # reactions mean the same: the floor's own weight is not among them
    assert not rough.reaction_nd[6:].any()
    np.testing.assert_allclose(rough.reaction_nd.sum(axis=0), [0.0, weight], atol=1e-7 * weight)


def test_the_report_of_a_crystal_has_six_contacts_per_particle_and_both_isostatic_counts():
    report = examine(crystal(), modes=0)
    assert report.numbers["coordination_number"] == 6.0 == pm.coordination_number(crystal().packing)
    rows = result_rows(report.numbers, report.missing)
    assert row(rows, "coordination number")[1] == "6.0000"
    assert "31 = 2N'-1, strain isotropic (33 with strain free)" in row(rows, "contacts")[2]
    free = examine(crystal(), modes=0, strain="free")
    assert free.numbers["isostatic_contacts"] == 33
    assert "33 = 2N'+1, strain free (31 with strain isotropic)" in row(result_rows(free.numbers, {}), "contacts")[2]


def test_the_excess_coordination_is_two_excess_contacts_per_particle_that_is_held():
    start = pm.random_packing(32, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.9, seed=1)
    scene = pm.Scene(start, HARMONIC)
    run = pm.jam(scene, pressure=1e-3)
    numbers = examine(scene.replace(packing=run.packing), strain="free", modes=0).numbers
    held = numbers["particles"] - numbers["rattlers"]
    assert run.report["excess_contacts"] > 0
    assert numbers["excess_coordination"] == pytest.approx(2.0 * run.report["excess_contacts"] / held, abs=1e-12)
    # nobody is held: there is no number from which it could differ
    assert "excess_coordination" not in examine(crystal(relative_overlap=-0.1), modes=0).numbers


def test_the_excess_coordination_with_friction_is_beyond_three_in_the_plane():
    """No contact of a crystal of equal overlaps bears a tangential force, so z_iso = d + 1 = 3 of z = 6."""
    scene = crystal().replace(effects=(*HARMONIC, pm.Friction(0.5)))
    report = examine(scene, modes=0)
    assert report.numbers["isostatic_coordination"] == 3.0
    assert report.numbers["excess_coordination"] == 3.0
    assert "+3.0000 beyond" in row(result_rows(report.numbers, {}), "coordination number")[2]


@pytest.mark.parametrize(("overlap", "deep"), [(0.4, False), (0.6, True)])
def test_particles_that_lie_on_each_other_are_remarked(overlap, deep):
    report = examine(crystal(relative_overlap=overlap), modes=0, verdict=False)
    assert report.numbers["largest_overlap"] == pytest.approx(overlap)
    assert any(name == "largest overlap" for name, *_ in result_rows(report.numbers, {})) is deep


def test_the_report_says_how_large_particles_are():
    packing = pm.random_packing(6, dimension=3, packing_fraction=0.3, seed=1)
    report = examine(pm.Scene(packing, HARMONIC), modes=0, verdict=False)
    assert row(result_rows(report.numbers, {}), "sizes")[1] == "3 of 1, 3 of 1.4"
    many = pm.random_packing(6, dimension=2, sizes=[0.5, 0.6, 0.7, 0.8, 0.9, 1.0], packing_fraction=0.3, seed=1)
    report = examine(pm.Scene(many, HARMONIC), modes=0, verdict=False)
    assert row(result_rows(report.numbers, {}), "sizes")[1] == "1 to 2"


def test_the_verdict_of_the_hard_packing_stands_beside_one_that_overlaps_hide():
    """At large overlaps it cannot be told which particles touch at the onset; of the hard packing it can."""
    start = pm.random_packing(64, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.8, seed=3)
    scene = pm.Scene(start, (pm.Repulsion(),))
    run = pm.jam(scene, pressure=1e-2)
    report = examine(scene.replace(packing=run.packing), run=run, strain="free", modes=0)
    assert report.numbers["strict"] == "ambiguous"
    exact = pm.classify_jamming(run.report["hard_packing"])
    assert (report.numbers["hard_collective"], report.numbers["hard_strict"]) == (exact.collective, exact.strict)
    assert exact.strict == "jammed" and "hard packing  " in str(report.summary())
    # which says once why, in a line that fits, and the verdict itself says it in full
    shown = str(report.summary())
    assert shown.count("off its plateau (see touching); the hard packing, below") == 1
    assert shown.count("for the same reason") == 1 and "judge the hard packing" not in shown
    assert str(report.verdict).count("off its plateau") == 1 == str(report.verdict).count("judge the hard packing")
    low = pm.jam(scene, pressure=1e-8)
    near = examine(scene.replace(packing=low.packing), run=low, strain="free", modes=0)
    assert near.numbers["strict"] == "jammed" and "hard_strict" not in near.numbers
    held = run.packing.particles - run.report["rattlers"]
    assert run.report["coordination_number"] == 2.0 * run.report["contacts"] / held
    # followed from where it stands, which the printed fraction says
    again = pm.jam(scene.replace(packing=run.packing), pressure=2e-2)
    assert again.report["start"] in ("continued", "rearranged")
    shown = str(examine(scene.replace(packing=again.packing), run=again, strain="free", modes=0).summary())
    assert "followed from the packing as it stood" in shown


def test_a_report_says_how_many_particles_are_of_each_kind_where_there_are_several():
    plain = crystal(relative_overlap=-0.1)
    mixed = pm.Scene(pm.assign_kinds(plain.packing, (2, 0, 1), seed=1), HARMONIC)
    report = examine(mixed)
    # thirds of 16 are 10.67 and 5.33
    assert report.numbers["kinds"] == [11, 0, 5]
    assert row(result_rows(report.numbers, report.missing), "kinds")[1:] == ("11 of 0, 5 of 2", "particles of a kind")
    assert "kinds" not in examine(plain).numbers


def test_notes_of_rows_without_a_name_stand_with_the_row_before():
    rows = (
        ("stress", "1 2", "tension positive"),
        ("", "3 4", "energy / length^2"),
        ("speed", "5", ""),
        ("", "6", "more"),
    )
    lines = Summary("a run", rows, ()).markdown().splitlines()
    notes = [line for line in lines if line.startswith("- ")]
    assert notes == ["- **stress**: tension positive; energy / length^2", "- **speed**: more"]
