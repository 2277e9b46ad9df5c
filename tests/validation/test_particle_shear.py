"""Facts about the preset: its unit-test scenarios, its laws and constants, demodulation, and its text file."""

import functools
import inspect
import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import packmech as pm
from packmech.validation import particle_shear as ps
from packmech.validation.particle_shear import material as constants
from packmech.validation.particle_shear.text_file import COLUMNS, HEADINGS


@functools.cache
def played(name):
    scenario = ps.SCENARIOS[name]()
    return scenario, scenario.run()


@functools.cache
def short_run():
    experiment = ps.ParticleShear(particles=40, pre_periods=0.1, periods=0.5, post_periods=0.1, amplitude=0.1)
    return experiment.run(ps.prepared_discs(experiment, seed=4, centers=3), frames=3)


# ---------------------------------------------------------------------------------------------- the package's tables


@pytest.mark.parametrize("name", ps.SCENARIOS)
def test_every_row_of_the_packages_tables_holds_but_the_two_that_it_fails(name):
    scenario, steps = played(name)
    verdicts = ps.judge(scenario, steps)
    for row in scenario.rows:
        assert all(verdicts[row.about].values()) is not row.fails, (row.about, verdicts[row.about])


def test_the_two_rows_that_the_package_fails_are_the_otsuki_terms_of_a_moving_disc_and_of_a_collision():
    failing = [(name, row.about) for name in ps.SCENARIOS for row in played(name)[0].rows if row.fails]
    assert failing == [("single_sphere_moving", "otsuki"), ("two_spheres_central", "otsuki")]


def test_every_statement_of_a_row_has_a_meaning_and_every_table_is_there():
    scenarios = [played(name)[0] for name in ps.SCENARIOS]
    assert [scenario.table for scenario in scenarios] == [f"S4-{number}" for number in range(2, 12)]
    for row in (row for scenario in scenarios for row in scenario.rows):
        assert {*row.states, *row.native} <= set(ps.STATEMENTS)
        assert row.states == row.native or row.because


@pytest.mark.parametrize("seed", [2, 3])
@pytest.mark.parametrize("name", ["assembly_at_rest", "assembly_sheared", "crosslinked_sheared"])
def test_rows_of_assemblies_hold_for_other_seeds(name, seed):
    scenario = ps.SCENARIOS[name](seed=seed)
    assert all(all(found.values()) for found in ps.judge(scenario, scenario.run()).values())


def test_love_weber_tensor_of_rubbing_discs_is_the_tangential_force_times_the_branch_vector():
    scenario, _ = played("two_spheres_tangential")
    rates = scenario.strain_rate_t[: scenario.measured_step + 1]
    before = ps.advance(scenario.start, scenario.material, scenario.rules, rates[:-1]).final
    last = ps.advance(before, scenario.material, scenario.rules, rates[:1]).last
    branch = before.position_nd[0] - before.position_nd[1]
    force = last.force_nd[0]
    assert abs(force @ branch) < 1e-13 * np.linalg.norm(force) * np.linalg.norm(branch)
    assert last.stress("love_weber") == pytest.approx(np.outer(force, branch) * 1e-6 / 500.0**2, rel=1e-14)


@pytest.mark.parametrize(("name", "image"), [("sphere_against_plate", 0.0), ("two_spheres_across", 500.0)])
def test_native_statements_hold_where_contacts_of_the_boundary_are_counted(name, image):
    scenario, _ = played(name)
    rates = scenario.strain_rate_t[: scenario.measured_step + 1]
    before = ps.advance(scenario.start, scenario.material, scenario.rules, rates[:-1]).final
    last = ps.advance(before, scenario.material, scenario.rules, rates[:1]).last
    # the force of the one contact, and its branch vector to the nearest image
    branch = before.position_nd[0] - before.position_nd[1] + [image, 0.0]
    assert np.linalg.norm(branch) < before.radius_n.sum()
    virial = np.outer(last.force_nd[0], branch) * 1e-6 / 500.0**2
    spinning = last.torque_n.sum() / 2.0 * np.array([[0.0, -1.0], [1.0, 0.0]]) * 1e-6 / 500.0**2
    counted = {"love_weber": virial, "overall": virial + spinning + last.stress("centrifugal")}
    for row in scenario.rows:
        if row.about in counted:
            assert all(ps.STATEMENTS[one](counted[row.about], counted) for one in row.native), row


def test_tensors_add_up_as_the_documentation_says():
    stress = short_run().stress
    scale = np.abs(stress("overall")).max()
    parts = stress("love_weber") + stress("internal_torque") + stress("centrifugal")
    assert np.abs(stress("overall") - parts).max() < 1e-15 * scale
    assert np.abs(stress("love_weber") - stress("external") - stress("linear_acceleration")).max() < 1e-12 * scale
    assert np.abs(stress("overall")[:, 0, 1] - stress("overall")[:, 1, 0]).max() < 1e-14 * scale


# ------------------------------------------------------------------------------------------------- laws and constants


def test_slow_sliding_feels_half_of_coulombs_friction():
    # discs so heavy that nothing moves; the first one's spin slides the contact
    material = ps.Material(1.0, 0.0, 1.0, 0.1, 0.5)
    cap = 0.5 * 10.0
    slow = 1e-3 * cap / 0.1
    pair = ps.ShearedDiscs([[200.0, 250.0], [310.0, 250.0]], [60.0, 60.0], [1e12, 1e12], spin_n=[slow / 60.0, 0.0])
    force = 0.0
    steps = 40_000
    rules, state = ps.StepRules(0.05, plates=False), pair
    before = momentum_y(state)
    state = ps.advance(state, material, rules, np.zeros(steps)).final
    force = abs(momentum_y(state) - before) / (0.05 * steps)
    assert force / cap == pytest.approx(0.5005, abs=1e-3)


def momentum_y(discs):
    return float(discs.mass_n[0] * discs.velocity_nd[0, 1])


@given(overlap=st.floats(0.0, 19.0), share=st.floats(0.0, 1.0))
def test_repulsion_blends_the_linear_and_the_divergent_law(overlap, share):
    made = ps.Material(2.0, divergence=share)
    expected = (1.0 - share) * 2.0 * overlap + share * 2.0 * overlap / (1.0 - overlap / 20.0)
    assert -ps.normal_force(made, 20.0 - overlap, 20.0) == pytest.approx(expected, rel=1e-12, abs=1e-12)


def test_full_overlap_stops_at_999_k_d0_where_the_documentation_says_1000():
    assert -ps.normal_force(ps.Material(2.0, divergence=1.0), 0.0, 20.0) == pytest.approx(999.0 * 2.0 * 20.0)


def test_plateau_law_is_continuous_and_a_slope_of_one_is_no_plateau():
    made = ps.Material(2.0, plateau_slope=0.1)
    for fraction in (made.plateau_begin, made.plateau_end):
        sides = [ps.normal_force(made, 20.0 * (fraction + way), 20.0) for way in (-1e-12, 1e-12)]
        assert sides[0] == pytest.approx(sides[1], rel=1e-9)
    middle = ps.normal_force(made, 11.0, 20.0)
    assert middle == pytest.approx(-2.0 * (20.0 - (16.0 + 0.1 * (11.0 - 16.0))))
    assert ps.normal_force(made, 0.0, 20.0) == -40.0


def test_numbers_of_plateau_and_tension_are_the_experiments_and_the_files(tmp_path):
    short = {"particles": 20, "pre_periods": 0.1, "periods": 0.1, "post_periods": 0.0}
    flat = ps.ParticleShear(law="plateau", plateau_begin=0.2, plateau_end=0.9, plateau_slope=0.3, **short)
    assert flat.material[-4:] == (0.2, 0.9, 0.3, 0.0)
    weak = ps.ParticleShear(law="exponential", tensile_range=0.5, **short)
    assert weak.material[-2:] == (1.0, 0.5)
    for experiment, words in (
        (flat, "Elastic force law = plateau, begin, end and slope = 0.2, 0.9, 0.3[-]"),
        (weak, "Tensile force law = exponential, range = 0.5[-]"),
    ):
        run = experiment.run(ps.prepared_discs(experiment, seed=1, steps=2))
        assert words in ps.write_text(run, tmp_path, tensors=False).read_text().splitlines()
    assert "force law" not in "".join(ps.read_text(ps.write_text(short_run(), tmp_path)).header)


def test_bonds_pull_linearly_or_saturate():
    linear, saturating = ps.Material(2.0), ps.Material(2.0, tensile_range=0.2)
    assert ps.bond_force(linear, 25.0, 20.0) == 10.0
    assert ps.bond_force(saturating, 20.0 + 1e-6, 20.0) == pytest.approx(2e-6, rel=1e-6)
    assert ps.bond_force(saturating, 1e6, 20.0) == pytest.approx(2.0 * 20.0 * 0.2)
    assert ps.bond_force(ps.Material(2.0, bond_normal_ratio=0.5), 15.0, 20.0) == -5.0


def test_radii_have_the_ratio_and_fill_the_cell():
    large, small = constants.disc_radii(150, 1.5)
    assert large / small == pytest.approx(1.4)
    assert 75 * math.pi * (large**2 + small**2) == pytest.approx(1.5 * 500.0**2)


@pytest.mark.parametrize(("width", "height"), [(500.0, 500.0), (250.0, 250.0), (800.0, 300.0)])
def test_density_of_prepared_discs_is_the_packages_in_cells_of_any_size(width, height):
    experiment = ps.ParticleShear(particles=20, width=width, height=height)
    discs = ps.prepared_discs(experiment, seed=1, steps=2)
    assert (discs.width, discs.height) == (width, height)
    # (b + 1/b)/2 of the nominal density of 50 kg/m^3, and mg per um^2 and m are 1e6 of these
    density_n = 1e6 * discs.mass_n / (math.pi * discs.radius_n**2)
    assert density_n == pytest.approx(50.0 * (1.4 + 1.0 / 1.4) / 2.0, rel=1e-12)
    assert experiment.tau == pytest.approx(math.sqrt(experiment.mass / constants.contact_stiffness(8000.0)), rel=1e-15)
    assert experiment.mass == pytest.approx(1e-6 * 50.0 * 1.5 * width * height / 20, rel=1e-12)


def test_discs_of_another_cell_than_the_experiments_are_refused():
    discs = ps.prepared_discs(ps.ParticleShear(particles=20, width=250.0), seed=1, steps=2)
    with pytest.raises(ValueError, match="start must be in the experiment's cell of 500 by 500, got one of 250 by 500"):
        ps.ParticleShear(particles=20).run(discs)


def test_time_step_follows_the_packages_thresholds():
    step = functools.partial(constants.package_time_step, 1.4)
    assert step() == pytest.approx(0.025)
    assert step(amplitude=0.05) == pytest.approx(0.0125) and step(amplitude=0.005) == pytest.approx(0.00625)
    assert step(amplitude=0.5) == pytest.approx(0.0125) and step(friction_coefficient=2.0) == pytest.approx(0.1)
    assert step(friction_coefficient=0.5) == pytest.approx(0.05)
    assert step(relative_viscosity=100.0) == pytest.approx(0.0025)


# --------------------------------------------------------------------------------------------------- demodulation


@pytest.mark.parametrize(
    ("drift", "storage"), [("package", 68.2), ("none", 84.1), ("removed", 100.0), ("least_squares", 100.0)]
)
def test_drift_is_doubled_by_the_package_and_removed_by_the_others(drift, storage):
    protocol = ps.Periods(1.0, 0.2, 1.0, 3.0, 1.0)
    time_t = np.arange(5000) / 1000.0
    sheared = (time_t >= 1.0) & (time_t <= 4.0)
    phase = 2.0 * np.pi * time_t
    stress_t = (20.0 * np.sin(phase) + 6.0 * np.cos(phase)) * sheared + 10.0 * time_t
    found = ps.demodulate(time_t, stress_t, protocol, drift=drift)
    assert found.storage == pytest.approx(storage, abs=0.05)
    # both ends of the window count, so that the drift's mean reaches the cosine by its one sample too many
    assert found.loss == pytest.approx(30.0, rel=0.01)


def test_third_harmonic_and_offset_do_not_reach_the_least_squares_moduli():
    protocol = ps.Periods(2.0, 0.1, 0.5, 2.3, 0.0)
    time_t = np.linspace(0.0, 1.4, 3000)
    phase = 2.0 * np.pi * (2.0 * time_t - 0.5)
    stress_t = 5.0 * np.sin(phase) + 2.0 * np.cos(phase) + 3.0 * np.sin(3.0 * phase) + 7.0 + 4.0 * time_t
    found = ps.demodulate(time_t, stress_t, protocol, drift="least_squares")
    assert found == pytest.approx((5.0, 2.0, 50.0, 20.0), rel=1e-12)


def test_jumps_of_the_stress_are_replaced_by_the_step_before_and_smaller_steps_stay():
    time_t = np.arange(3000) / 1000.0
    smooth_t = 20.0 * np.sin(2.0 * np.pi * time_t) + 3.0 * np.cos(2.0 * np.pi * time_t)
    jumping_t = smooth_t + 15.0 * (time_t > 0.7) - 25.0 * (time_t > 1.9004) + 0.5 * (time_t > 1.2)
    mended_t = ps.remove_jumps(jumping_t)
    # a step of the sine differs from the one before it by its second difference
    assert np.abs(mended_t - smooth_t - 0.5 * (time_t > 1.2)).max() < 2.0 * 20.0 * (2.0 * np.pi / 1000.0) ** 2
    assert np.array_equal(ps.remove_jumps(smooth_t), smooth_t)
    protocol = ps.Periods(1.0, 0.2, 0.0, 3.0, 0.0)
    found = [
        ps.demodulate(time_t, stress_t, protocol, drift="none", largest_jump=0.15).storage
        for stress_t in (smooth_t, smooth_t + 15.0 * (time_t > 1.7))
    ]
    assert found[1] == pytest.approx(found[0], abs=0.05)
    assert ps.demodulate(time_t, smooth_t + 15.0 * (time_t > 1.7), protocol, drift="none").storage < found[0] - 5.0


# -------------------------------------------------------------------------------------------------------- runs


def test_a_run_cut_into_two_has_the_same_bits():
    experiment = short_run().experiment
    series = short_run().series
    half = len(series.time_t) // 3
    rate_t = series.strain_rate_t
    first = ps.advance(short_run().start, experiment.material, experiment.rules, rate_t[:half])
    second = ps.advance(first.final, experiment.material, experiment.rules, rate_t[half:])
    assert np.array_equal(second.stress_tsdd, series.stress_tsdd[half:])
    assert np.array_equal(second.final.history_ck, short_run().final.history_ck)
    assert np.array_equal(second.time_t, series.time_t[half:])


def test_plates_never_let_go_of_a_disc():
    assert (np.diff(short_run().series.caught_t) >= 0).all() and short_run().series.caught_t[0] > 0


def test_discs_refuse_what_cannot_be():
    good = {"position_nd": [[1.0, 2.0], [3.0, 4.0]], "radius_n": [1.0, 1.0], "mass_n": [1.0, 1.0]}
    for change, message in (
        ({"position_nd": [[1.0, np.nan], [3.0, 4.0]]}, "position_nd must be finite, got nan for particle 0"),
        ({"position_nd": [[1.0, 2.0], [3.0, 501.0]]}, "position_nd must be inside the cell .* for particle 1"),
        ({"mass_n": [1.0, 0.0]}, "mass_n must be positive, got 0.0 for particle 1"),
        ({"contact_ck": [[1, 0]], "kind_c": ["stick"]}, "contact_ck must hold pairs of discs, the lower number first"),
        ({"contact_ck": [[0, 1]], "kind_c": ["glue"]}, "kind_c.0. must be one of 'stick'"),
        ({"contact_ck": [[0, 1], [0, 1]], "kind_c": ["stick"] * 2}, "contact_ck must hold every pair once"),
        ({"width": 0.0}, "width must be"),
    ):
        with pytest.raises(ValueError, match=message):
            ps.ShearedDiscs(**(good | change))


def test_a_run_that_blows_up_says_so():
    pair = ps.ShearedDiscs([[200.0, 250.0], [201.0, 250.0]], [60.0, 60.0], [1e-300, 1.0])
    with pytest.raises(FloatingPointError, match="smaller time_step"):
        ps.advance(pair, ps.Material(1e9, divergence=1.0), ps.StepRules(1e3, plates=False), np.zeros(5))


# --------------------------------------------------------------------------------------------------- the text file

# what the package's evaluation in R looks for in the header
PATTERNS = {
    r"N=([0-9]*) spheres": 40, r"nominal packing density = ([0-9]*\.?[0-9]*)": 1.5,
    r"Young modulus of the individual spheres = ([0-9]*\.?[0-9]*) Pa": 8000,
    r"Friction coefficient = ([0-9]*\.?[0-9]*)": 0.01, r"cut_lines=([0-9]*),": 3,
    r"amplitude=([0-9]*\.?[0-9]*),": 0.1, r"relative_viscosity=([0-9]*\.?[0-9]*)": 0.1,
    r"relative_transversal_link_strength=([0-9]*\.?[0-9]*)[,\)]": 1,
    r"interface_reenforcement_central=([0-9]*\.?[0-9]*)": 1, r"remove_link_fraction=([0-9]*\.?[0-9]*)": 0,
    r"Actual fraction of randomly removed non-essential permanent bonds = ([0-9]*\.?[0-9]*)": 0,
    r"relative_frequency=([0-9]*\.?[0-9]*)": 0.025,
}  # fmt: skip


def test_text_file_gives_back_every_number(tmp_path):
    run = short_run()
    read = ps.read_text(ps.write_text(run, tmp_path))
    series = run.series
    for found, expected in (
        (read.time_t, series.time_t), (read.strain_t, series.strain_t), (read.strain_rate_t, series.strain_rate_t)
    ):  # fmt: skip
        assert np.array_equal(found, expected)
    for name in COLUMNS:
        assert np.array_equal(read.stresses[name], run.stress(name))
    assert read.number("G'=") == run.moduli("overall").storage
    assert read.number("G''(by surface force)=") == run.moduli("external").loss
    assert read.number("Time step = ") == run.experiment.time_step


def test_text_file_has_42_columns_and_is_named_by_what_was_run(tmp_path):
    first, second = (ps.write_text(short_run(), tmp_path) for _ in range(2))
    frequency = round(short_run().experiment.frequency, 4)
    assert first.name == f"dermal_filler0.01_f_{frequency}_strain_0.1_nr_1.txt" and second.name.endswith("_nr_2.txt")
    lines = first.read_text().splitlines()
    start = next(n for n, line in enumerate(lines) if re.search(r"Detailed[a-zA-Z0-9\s].*data", line))
    assert start < 200 and len(HEADINGS) == 42
    assert {len(line.split("\t")) for line in lines[start + 1 :]} == {42}


@functools.cache
def shortest(**bonding):
    experiment = ps.ParticleShear(particles=40, pre_periods=0.1, periods=0.2, post_periods=0.1)
    return experiment.run(ps.prepared_discs(experiment, seed=4, steps=10, **bonding))


@pytest.mark.parametrize(
    ("bonding", "name", "words"),
    [
        ({}, "_uncrosslinked0.01_", ["do_permanent_links=False,cut_lines=0,", "No permanent links"]),
        ({"centers": 0}, "_bulk0.01_", ["do_permanent_links=True,cut_lines=0,", "no cut lines", "particles=False"]),
        (
            {"centers": 3},
            "filler0.01_",
            ["cut_lines=3,", "doCutByTriangulation=True", "Centers used", "particles=True"],
        ),
        (
            {"lines": 4, "cut_top_bottom": True, "avoided_angle": 20.0},
            "filler0.01_",
            ["cut_lines=4,", "doCutByTriangulation=False", "cut_top_bottom=True", "degree=20,", "Cutting lines used"],
        ),
        (
            {"centers": 3, "removed_fraction": 0.1, "edge_fuzziness": 0.5, "spanning": "allowed"},
            "filler0.01_",
            ["remove_link_fraction=0.1,", "edge_fuzziness=0.5,", "interlocking = 0.5[-]", "particles=False"],
        ),
    ],
)
def test_text_file_says_how_the_discs_were_bonded(bonding, name, words, tmp_path):
    run = shortest(**bonding)
    path = ps.write_text(run, tmp_path, tensors=False)
    text = path.read_text()
    assert name in path.name and len(ps.read_text(path).time_t) == 0
    for word in words:
        assert word in text, word
    gone = float(re.search(r"non-essential permanent bonds = ([0-9.]*)", text).group(1))
    assert gone == run.start.preparation.removed and (gone > 0.0) == ("removed_fraction" in bonding)


def test_text_files_of_discs_that_are_otherwise_bonded_than_is_said_are_refused(tmp_path):
    bulk, loose = shortest(centers=0), shortest()
    with pytest.raises(ValueError, match="preparation must be that of the discs"):
        ps.write_text(bulk, tmp_path, preparation=ps.Preparation(pieces=5))
    experiment = bulk.experiment
    own = bulk.start.replace(kind_c=bulk.start.kind_c)
    assert own.preparation is None
    with pytest.raises(ValueError, match="preparation must be given where bonded discs do not say"):
        ps.write_text(experiment.run(own), tmp_path)
    assert "_bulk" in ps.write_text(experiment.run(own), tmp_path, preparation=ps.Preparation()).name
    unsaid = experiment.run(loose.start.replace(preparation=None))
    assert "_uncrosslinked" in ps.write_text(unsaid, tmp_path).name
    with pytest.raises(ValueError, match="preparation must say bonded=False as the discs are, got bonded=True"):
        ps.write_text(unsaid, tmp_path, preparation=ps.Preparation())
    with pytest.raises(ValueError, match="pieces must be 0 where nothing is bonded, got 5"):
        ps.Preparation(bonded=False, pieces=5)
    assert list(tmp_path.glob("*strain_0.2_nr_2*")) == []


def test_header_has_the_lines_that_the_evaluation_in_r_looks_for(tmp_path):
    text = ps.write_text(short_run(), tmp_path).read_text()
    for pattern, expected in PATTERNS.items():
        assert float(re.search(pattern, text).group(1)) == expected, pattern
    for pattern, expected in (
        (r"Frequency = ([0-9]*\.?[0-9]*)Hz", short_run().experiment.frequency),
        (r"Damping factor = ([0-9]*\.?[0-9]*)", short_run().experiment.rules.cooling),
        (r"G'=(-?[0-9]*\.?[0-9]*)", short_run().moduli().storage),
        (r"G''\(by surface force\)=(-?[0-9]*\.?[0-9]*)", short_run().moduli("external").loss),
        (r"Stress = ([0-9]*\.?[0-9e\-]*)Pa", math.hypot(*short_run().moduli()[:2])),
    ):
        assert float(re.search(pattern, text).group(1)) == pytest.approx(expected, rel=1e-15), pattern
    for word in ("do_permanent_links=True,", "doCutByTriangulation=True", "cut_top_bottom=False"):
        assert word in text
    # the package prints the periods before the measurement here
    assert "Post-measurement periods = 0.1 [-]" in text


def test_broken_text_files_are_refused_by_line(tmp_path):
    path = ps.write_text(short_run(), tmp_path)
    lines = path.read_text().splitlines()
    path.write_text("\n".join(lines[:-1] + [lines[-1].rsplit("\t", 3)[0]]))
    with pytest.raises(ValueError, match=f"line {len(lines)} must have 42 columns, got 39"):
        ps.read_text(path)
    path.write_text("\n".join(lines).replace("stress_tensor_overall_11", "stress_tensor_whole_11"))
    with pytest.raises(ValueError, match="must have the column stress_tensor_overall_11"):
        ps.read_text(path)


# ------------------------------------------------------------------------------------------------------ series of runs


def test_series_runs_amplitudes_frictions_and_controls_on_fresh_discs_and_writes_true_files(tmp_path):
    short = ps.ParticleShear(particles=20, pre_periods=0.1, periods=0.1, post_periods=0.1)
    settings = {"amplitudes": [0.1, 0.2], "friction_coefficients": [0.01, 0.1], "repetitions": 2, "seed": 3}
    settings |= {"controls": ps.CONTROLS, "centers": 2, "steps": 5, "spanning": "allowed"}
    first, again = (list(ps.run_series(short, **settings, folder=tmp_path, tensors=False)) for _ in range(2))
    assert len(first) == 2 * 2 * 2 * 4
    for one, other in zip(first, again, strict=True):
        assert np.array_equal(one.series.stress_tsdd, other.series.stress_tsdd)
    assert len({run.start.position_nd.tobytes() for run in first}) == len(first)
    found = [
        (run.experiment.amplitude, run.experiment.friction_coefficient, run.start.preparation.kind) for run in first
    ]
    kinds = [("", False), ("_bulk", False), ("_uncrosslinked", False), ("", True)]
    expected = [(a, 0.0 if bare else mu, kind) for a in (0.1, 0.2) for mu in (0.01, 0.1) for kind, bare in kinds]
    assert found == 2 * expected
    # two repetitions, twice
    assert len(list(tmp_path.glob("dermal_filler_bulk0.1_*_strain_0.2_nr_*.txt"))) == 4
    assert len(list(tmp_path.iterdir())) == 2 * len(first)


def test_series_refuses_at_once_what_cannot_be(tmp_path):
    good = {"amplitudes": [0.1], "friction_coefficients": [0.01], "repetitions": 1, "seed": 1}
    for change, message in (
        ({"amplitudes": [0.1, 0.0]}, "amplitudes.1. must be"),
        ({"friction_coefficients": [-1.0]}, "friction_coefficients.0. must be"),
        ({"repetitions": 0}, "repetitions must be"),
        ({"controls": ["none"]}, "controls.0. must be one of"),
    ):
        with pytest.raises(ValueError, match=message):
            ps.run_series(ps.ParticleShear(), **(good | change))
    with pytest.raises(NotADirectoryError, match="folder must be an existing folder"):
        ps.run_series(ps.ParticleShear(), **good, folder=tmp_path / "none")


# ------------------------------------------------------------------------------------------------- names and commands


def test_the_whole_preset_is_public_with_docstrings_and_examples():
    assert pm.particle_shear is ps and "particle_shear" in pm.__all__
    for name in ps.__all__:
        one = getattr(ps, name)
        if inspect.isfunction(one) or hasattr(one, "py_func"):
            function = getattr(one, "py_func", one)
            assert ">>> " in (inspect.getdoc(function) or ""), name
