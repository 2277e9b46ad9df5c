"""Facts about goals under shear, from their formulas, without a packing that is sheared."""

import math

import numpy as np
import pytest
from packmech_envs import shear_goals as goals
from packmech_envs.shear_goals import (
    DISSIPATED,
    ELAPSED,
    FAILED,
    GOING,
    LEVEL,
    MEMORY,
    PEAK,
    PEAK_STRAIN,
    PHASE,
    REACHED,
    TARGET,
    YIELDED,
    DissipateLeast,
    FindYieldStrain,
    FollowStress,
    goal_of,
    score_frames,
)

# columns of the figures here: time, strain, rate, shear stress, kinetic and elastic energy, work, pressure
WHERE = np.array([3, 4, 5, 6])
UNIT, VOLUME, FASTEST = 2.0, 10.0, 0.5


def scored(goal, frames, good=True, memory=None, picked=(7,), scale=1.0):
    """Return rewards, reasons, infos and observations of frames (F, 8) that one packing takes, the first its start."""
    p = np.array([goal.weight_failure, FASTEST, *goal.numbers(UNIT, VOLUME)])
    memory = np.zeros((1, MEMORY)) if memory is None else memory
    before, observed = np.zeros((1, 8)), np.full((1, len(picked) + len(goal.observed)), np.nan)
    info = np.full((1, 3 + len(goal.terms) + len(goal.infos)), np.nan)
    reward, reason = np.zeros(1), np.zeros(1, dtype=np.int64)
    rows = []
    for k, frame in enumerate(frames):
        last = k == len(frames) - 1
        score_frames(
            k == 0, np.array([True]), np.array([good or not last]), goal.kind, p, WHERE, np.array(picked),
            np.full(observed.shape[1], scale), np.array([frame], dtype=np.float64), before, memory, observed, info,
            reward, reason,
        )  # fmt: skip
        rows.append((float(reward[0]), int(reason[0]), info[0].copy(), observed[0].copy()))
    return rows


def frame(strain=0.0, rate=0.0, shear=0.0, kinetic=0.0, elastic=0.0, work=0.0, time=0.0):
    return [time, strain, rate, shear, kinetic, elastic, work, 0.125]


def test_a_stress_off_its_target_costs_its_distance_in_amplitudes_and_a_rate_its_square():
    goal = FollowStress(amplitude=0.05, random=False, weight_stress=3.0, weight_effort=2.0)
    memory = np.zeros((1, MEMORY))
    goal.draw(np.random.default_rng(0), memory[0], UNIT)
    assert memory[0, LEVEL] == 0.1
    start, one, two = scored(goal, [frame(), frame(shear=0.07, rate=0.25), frame(shear=0.13, rate=-0.5)], memory=memory)
    assert start[:2] == (0.0, GOING) and (start[2][3:] == 0.0).all() and start[3].tolist() == [0.125, 0.1]
    assert np.isclose(one[0], -3.0 * 0.03 / 0.1 - 2.0 * 0.25) and np.isclose(two[0], -3.0 * 0.03 / 0.1 - 2.0)
    assert np.allclose(one[2][3:], [-0.9, -0.5, 0.0, -0.03]) and np.allclose(two[2][3:], [-0.9, -2.0, 0.0, 0.03])


def test_a_target_that_is_a_sine_is_observed_a_frame_ahead():
    goal = FollowStress(amplitude=0.05, period=8.0, random=False)
    memory = np.zeros((1, MEMORY))
    goal.draw(np.random.default_rng(0), memory[0], UNIT)
    targets = [row[3][1] for row in scored(goal, [frame()] * 9, memory=memory)]
    assert np.allclose(targets, 0.1 * np.sin(2.0 * math.pi * np.arange(1, 10) / 8.0))
    assert memory[0, ELAPSED] == 8.0 and memory[0, TARGET] == targets[-1]
    memory[0, PHASE], memory[0, ELAPSED] = 0.5 * math.pi, 0.0
    assert np.isclose(scored(goal, [frame()], memory=memory)[0][3][1], 0.1 * math.cos(2.0 * math.pi / 8.0))


def test_levels_and_phases_are_drawn_over_their_whole_range():
    level, phase = [], []
    for seed in range(200):
        rng, memory = np.random.default_rng(seed), np.zeros((2, MEMORY))
        FollowStress(amplitude=0.05).draw(rng, memory[0], UNIT)
        FollowStress(amplitude=0.05, period=4.0).draw(rng, memory[1], UNIT)
        level.append(memory[0, LEVEL])
        phase.append(memory[1, PHASE])
        assert memory[0, PHASE] == 0.0 and memory[1, LEVEL] == 0.1
    assert -0.1 <= min(level) < -0.09 and 0.09 < max(level) <= 0.1
    assert 0.0 <= min(phase) < 0.3 and 6.0 < max(phase) < 2.0 * math.pi


@pytest.mark.parametrize("target", [0.1, -0.1])
def test_progress_to_a_strain_adds_up_to_one_and_what_is_dissipated_is_work_less_what_is_stored(target):
    goal = DissipateLeast(target_strain=target, tolerance=1e-3, weight_progress=2.0, weight_dissipation=3.0)
    strains = target * np.array([0.0, 0.5, 0.25, 0.989, 0.991])
    frames = [
        frame(strain=one, work=0.4 * k, elastic=0.1 * k, kinetic=0.05 * k, time=float(k))
        for k, one in enumerate(strains)
    ]
    rows = scored(goal, frames)
    assert [row[1] for row in rows] == [GOING] * 4 + [REACHED]
    terms = np.array([row[2][3:7] for row in rows])
    assert np.allclose(terms[:, 0], [0.0, 1.0, -0.5, 2.0 * 0.739, 2.0 * 0.002])
    # a quarter each, over pressure unit, volume and the square of the strain
    assert np.allclose(terms[1:, 1], -3.0 * 0.25 / (2.0 * 10.0 * 0.01)) and (terms[:, 2:] == 0.0).all()
    assert np.allclose([row[0] for row in rows], terms.sum(axis=1))
    assert np.allclose([row[2][7] for row in rows], 0.25 * np.arange(5))
    assert np.allclose([row[3][1] for row in rows], target - strains)
    assert np.allclose([row[3][2] for row in rows], 0.25 * np.arange(5))
    # time, elastic energy, work
    assert np.allclose(rows[3][2][:3], [3.0, 0.3, 1.2])


def test_time_costs_by_its_weight():
    for goal, strain in ((DissipateLeast(weight_time=0.5, weight_progress=0.0), 0.05), (FindYieldStrain(), 0.0)):
        reward = scored(goal, [frame(), frame(strain=strain)])[1][0]
        assert np.isclose(reward, -goal.weight_time)


def test_a_packing_yields_where_its_stress_falls_by_a_part_of_its_peak_beyond_the_least_strain():
    goal = FindYieldStrain(
        drop=0.25, least_strain=0.02, resolution=0.02, weight_rise=3.0, weight_found=5.0, weight_time=0.0
    )
    #          strain, stress
    path = [(0.0, 0.0), (0.01, 9.0), (0.02, 4.0), (0.04, 8.0), (0.05, 6.1), (0.04, 5.0), (0.06, 6.0)]
    rows = scored(goal, [frame(strain=strain, shear=shear) for strain, shear in path])
    assert [row[1] for row in rows] == [GOING] * 6 + [YIELDED]
    # the peak, in pressure units, grows by 4 and by 4 again
    assert np.allclose([row[2][3] for row in rows], [0.0, 0.0, 6.0, 6.0, 0.0, 0.0, 0.0])
    assert np.allclose([row[2][4] for row in rows], [0.0] * 6 + [5.0 / (1.0 + 0.02 / 0.02)])
    # yield strain and stress
    assert np.allclose([row[2][7] for row in rows], [0.0, 0.0, 0.02, 0.04, 0.04, 0.04, 0.04])
    assert np.allclose([row[3][2] for row in rows], [0.0, 0.0, 4.0, 8.0, 8.0, 8.0, 8.0])


@pytest.mark.parametrize("goal", [FollowStress(random=False), DissipateLeast(), FindYieldStrain()])
def test_a_step_too_long_costs_the_weight_of_a_failure_and_ends_the_episode(goal):
    good, bad = (scored(goal, [frame(), frame(strain=0.03)], good=one)[1] for one in (True, False))
    assert good[1] == GOING and bad[1] == FAILED
    assert np.isclose(bad[0], good[0] - 10.0) and bad[2][3 + len(goal.terms) - 1] == -10.0


def test_packings_that_take_no_frame_keep_what_was_said_of_them_and_observations_are_scaled():
    goal = FindYieldStrain()
    assert scored(goal, [frame(), frame(strain=0.02, shear=8.0)], scale=4.0)[1][3].tolist() == [0.5, 0.08, 32.0]
    p = np.array([goal.weight_failure, FASTEST, *goal.numbers(UNIT, VOLUME)])
    memory, before, observed, info = (np.full((2, k), 7.0) for k in (MEMORY, 8, 3, 9))
    reward, reason = np.full(2, 7.0), np.full(2, 7)
    score_frames(
        True, np.array([True, False]), np.array([True, True]), goal.kind, p, WHERE, np.array([7]), np.ones(3),
        np.array([frame(), frame()]), before, memory, observed, info, reward, reason,
    )  # fmt: skip
    assert reward.tolist() == [0.0, 7.0] and reason.tolist() == [GOING, 7]
    assert (observed[1] == 7.0).all() and (info[1] == 7.0).all() and (before[1] == 7.0).all()
    assert before[0].tolist() == frame()


def test_goals_refuse_numbers_that_make_no_goal_and_names_that_are_none():
    for make, message in (
        (lambda: FollowStress(amplitude=0.0), "amplitude must be a positive number"),
        (lambda: FollowStress(period=0.0), "period must be a positive number"),
        (lambda: DissipateLeast(target_strain=0.0), "target_strain must not be zero"),
        (lambda: DissipateLeast(tolerance=0.0), "tolerance must be a positive number"),
        (lambda: FindYieldStrain(drop=1.0), "drop must be below 1, got 1.0"),
        (lambda: FindYieldStrain(resolution=-1.0), "resolution must be a positive number"),
        (lambda: FindYieldStrain(weight_rise=math.nan), "weight_rise must be a finite number"),
        (lambda: goal_of("yield"), "goal must be one of 'follow_stress', .*got 'yield'"),
    ):
        with pytest.raises(ValueError, match=message):
            make()
    with pytest.raises(TypeError, match="random must be True or False"):
        FollowStress(random=1)
    assert FollowStress(period=None, weight_stress=-1.0).period is None
    assert goal_of("find_yield_strain") == FindYieldStrain() and goal_of(FindYieldStrain(drop=0.5)).drop == 0.5
    assert goals.REASONS[FAILED] == "step_too_long" and goals.REASONS[REACHED] == "strain_reached"
    assert goals.REASONS[YIELDED] == "yielded" and goals.REASONS[GOING] is None
    assert len({DISSIPATED, ELAPSED, LEVEL, PEAK, PEAK_STRAIN, PHASE, TARGET}) == MEMORY


def test_defaults_are_those_that_are_written_down():
    assert (FollowStress().amplitude, FollowStress().random, FollowStress().weight_effort) == (0.01, True, 0.0)
    assert (DissipateLeast().target_strain, DissipateLeast().tolerance) == (0.1, 1e-3)
    found = FindYieldStrain()
    assert (found.drop, found.least_strain, found.resolution, found.weight_time) == (0.1, 0.01, 0.01, 0.01)
    assert found.weight_rise == found.weight_found == found.weight_failure == 10.0


@pytest.mark.parametrize("unit", [1.0, 1e-9])
def test_of_equal_peaks_the_first_counts_and_no_stress_is_no_peak_in_any_unit(unit):
    goal = FindYieldStrain(drop=0.25, least_strain=0.02, resolution=0.02)
    path = [(0.0, 0.0), (0.03, 0.0), (0.04, 8.0), (0.05, 8.0), (0.06, 6.0)]
    rows = scored(goal, [frame(strain=strain, shear=shear * unit) for strain, shear in path])
    assert [row[2][7] for row in rows] == [0.0, 0.0, 0.04, 0.04, 0.04]
    assert [row[1] for row in rows] == [GOING] * 4 + [YIELDED]
