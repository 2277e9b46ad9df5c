"""Facts about the study of integrators: orders with and without events, and words of its table."""

import math

import pytest

from packmech.validation.studies.accuracy import integrators as study
from packmech.validation.work_precision import Answer, work_precision


def test_words_sort_the_scenes_by_the_order_that_was_measured():
    def of_order(power):
        return lambda step: Answer(dict.fromkeys(study.QUANTITIES, step**power))

    methods = {
        "bonds, velocity Verlet": of_order(2.0),
        "contacts, dashpot jumps, velocity Verlet": of_order(1.0),
        "smooth onset and friction, velocity Verlet": of_order(1.5),
        "bonds, semi-implicit Euler": of_order(1.0),
    }
    zero = dict.fromkeys(study.QUANTITIES, 0.0)
    words = study.describe(work_precision(methods, study.STEPS, zero, repeats=1))
    assert "second order in positions with bonds; of first with contacts, dashpot jumps." in words
    assert "In between, of order 1.50: smooth onset and friction" in words
    assert "| bonds, semi-implicit Euler | 1.00 | 1.00 | 1.00 |" in words


@pytest.mark.slow
def test_verlet_is_of_second_order_without_events_and_with_a_smooth_onset_and_of_first_where_dashpots_jump(monkeypatch):
    monkeypatch.setattr(study, "REPEATS", 6)
    study.reference.cache_clear()

    def order(name):
        long, short = (study.trial(*study.METHODS[name], step).value[study.POSITIONS] for step in (0.1, 0.0125))
        return math.log2(long / short) / 3.0

    assert order("bonds, velocity Verlet") == pytest.approx(2.0, abs=0.05)
    assert order("contacts, smooth onset, velocity Verlet") == pytest.approx(2.0, abs=0.3)
    assert order("contacts, dashpot jumps, velocity Verlet") == pytest.approx(1.0, abs=0.35)
    assert order("bonds, semi-implicit Euler") == pytest.approx(1.0, abs=0.1)
    study.reference.cache_clear()
