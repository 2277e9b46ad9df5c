"""Facts about the study of jamming programs: every method's verdict and error."""

import pathlib

import numpy as np
import pytest
from benchmarks import bench_jamming_programs as study

import packmech as pm
from packmech.jamming.contact_selection import backbone_contacts
from packmech.jamming.motion_cone import motion_cone
from packmech.jamming.programs import load_program, yield_to_load

HARD = np.load(pathlib.Path(__file__).parents[1] / "golden" / "hard_packings.npz")


@pytest.fixture(autouse=True)
def small_pair(monkeypatch):
    """Study a stored hard packing with one state of self stress, in place of one jammed here."""
    parts = (HARD[f"2d-64-shape-fixed-0/{part}"] for part in ("position_nd", "radius_n", "lattice_dd"))
    position, radius, lattice = parts
    packing = pm.Packing(position, radius, pm.Box(lattice))
    network = backbone_contacts(pm.find_contacts(packing, gap_tolerance=1e-9))
    cone = motion_cone(packing, network, strain="none")
    force = np.linalg.svd(cone.rows.toarray().T)[2][-1]
    force /= force.mean()
    rest = network.select(np.arange(len(network)) != int(np.argmin(force)))
    pair = study.Pair(cone, float(force.min()), motion_cone(packing, rest, strain="none", kept_n=cone.kept_n))
    monkeypatch.setattr(study, "packings", lambda dimension: pair)
    return pair


@pytest.mark.parametrize("name", list(study.methods()))
def test_every_method_is_right_at_a_tight_tolerance_and_says_how_wrong_its_numbers_are(name):
    answer = study.trial(2, study.methods()[name], 1e-9)
    assert answer.converged and answer.note == ""
    assert answer.value[study.JAMMED] < 1e-4 and answer.value[study.OPENED] < 1e-4
    assert set(answer.work.values()) == {1.0}


def test_error_of_the_certificate_falls_with_the_tolerance():
    method = study.methods()["certificate, Clarabel"]
    coarse, fine = (study.trial(2, method, tolerance).value[study.JAMMED] for tolerance in (1e-4, 1e-10))
    assert fine < 1e-2 * coarse


def test_a_method_that_says_the_wrong_thing_is_kept_as_a_failure(small_pair):
    answer = study.trial(2, lambda cone, force, tolerance: study.Claim(cone is small_pair.opened, 0.5), 1e-8)
    assert not answer.converged
    assert f"'not jammed' said, {study.JAMMED}" in answer.note
    assert f"'jammed' said, {study.OPENED}" in answer.note


def test_a_method_that_says_nothing_is_neither_right_nor_wrong():
    answer = study.trial(2, lambda cone, force, tolerance: study.Claim(None, 0.5), 1e-8)
    assert not answer.converged and np.isnan(list(answer.work.values())).all()


def test_interior_point_stops_where_simplex_does(small_pair):
    cone = small_pair.opened
    load = cone.without_translations(np.random.default_rng(3).standard_normal(cone.unknowns))
    load /= np.linalg.norm(load)
    inside = study.interior_point(load_program(cone, load, "box"), 1e-9)
    vertex, _, _ = yield_to_load(cone, load, bound="box", solver="highs")
    assert abs(load @ inside - load @ vertex) < 1e-6


def test_made_packing_has_one_state_of_self_stress(monkeypatch):
    monkeypatch.undo()
    monkeypatch.setattr(study, "PARTICLES", {2: 32})
    study.packings.cache_clear()
    pair = study.packings(2)
    study.packings.cache_clear()
    assert pair.opened.rows.shape[0] == pair.jammed.rows.shape[0] - 1
    assert pair.smallest_force > 0.0
