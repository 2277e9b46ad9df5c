"""Facts about the study of gap tolerances: contacts and verdicts against the tolerance, words that follow the table."""

import pytest

from packmech.validation.studies.accuracy import gap_tolerance as study
from packmech.validation.work_precision import Answer, work_precision


@pytest.fixture
def few(monkeypatch):
    """Study fewer particles."""
    monkeypatch.setattr(study, "PARTICLES", 32)
    study.packing_at.cache_clear()
    yield
    study.packing_at.cache_clear()


def test_at_a_low_pressure_contacts_are_those_of_the_hard_packing_at_any_small_tolerance(few):
    found = [study.trial(1e-8, tolerance) for tolerance in (1e-12, 1e-9, 1e-6)]
    assert [one.work["excess"] for one in found] == [0.0, 0.0, 0.0]
    assert [study.WORDS[int(one.work["strict"])] for one in found] == ["jammed", "jammed", "jammed"]


def test_a_wide_tolerance_counts_pairs_that_do_not_touch(few):
    assert study.trial(1e-8, 1e-2).work["excess"] > 0.0


def test_words_tell_the_plateau_and_what_the_rule_takes():
    def answer(tolerance):
        excess = 3.0 if tolerance > 1e-4 else 0.0
        return Answer({study.EXCESS: excess}, work={"excess": excess, "strict": 1.0})

    table = work_precision({"pressure 1e-08": answer}, study.TOLERANCES, {study.EXCESS: 0.0}, repeats=1)
    words = study.describe(table, {"pressure 1e-08": (7e-8, "jammed")})
    assert "| 7e-08: jammed |" in words and "+3 j | +3 j | +0 j" in words
    assert "strictly jammed, from 1e-12 to 1e-04." in words
