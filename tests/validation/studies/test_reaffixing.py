"""Facts about the study of re-affixing: what a tolerance leaves, and that its words follow from its table."""

import numpy as np

import packmech as pm
from packmech.validation.studies.accuracy import reaffixing as study
from packmech.validation.work_precision import Answer, work_precision


def test_a_loose_tolerance_is_met_by_the_packing_that_comes_back():
    packing = study.shoved(study.rest(2)).packing
    for tolerance in (1e-2, 1e-3, 1e-4):
        back = pm.reaffix_links(packing, tolerance=tolerance)
        assert np.abs(back.packing.link_error).max() == back.residual <= tolerance


def test_a_descent_ends_at_the_rest_it_came_from_as_near_as_its_links_are_to_their_lengths(monkeypatch):
    monkeypatch.setattr(study, "STEPS", 300)
    loose, tight = (study.trial(2, tolerance).value for tolerance in (1e-5, 1e-13))
    assert 1e-6 < loose[study.LENGTHS] <= 1e-5 and tight[study.LENGTHS] <= 1e-13
    assert tight[study.ENERGY] < 1e-12 < loose[study.ENERGY]
    assert max(loose[study.BALANCE], tight[study.BALANCE]) < 1e-5


def test_words_tell_the_tightest_tolerance_that_every_step_met():
    def answer(tolerance):
        missed = 3.0 if tolerance < 1e-14 else 0.0
        work = {"iterations a step": 1.0, "seconds of re-affixing": 0.1, "steps that missed": missed}
        return Answer({study.LENGTHS: tolerance, study.ENERGY: 2.0 * tolerance, study.BALANCE: 0.0}, work=work)

    reference = dict.fromkeys((study.LENGTHS, study.ENERGY, study.BALANCE), 0.0)
    table = work_precision({"rigid trimers, 2D": answer}, study.TOLERANCES, reference, repeats=1)
    words = study.describe(table)
    assert "met in every step down to 1e-14" in words and "off by 2.0e-14" in words
    assert "| rigid trimers, 2D | 1e-15 | 1.0e-15 | 2.0e-15 | 0.0e+00 | 1.00 | 0.100 | 3 |" in words
