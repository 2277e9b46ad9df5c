"""Facts about the study of the time step under oscillatory shear: what it calls converged, and words of its table."""

import pytest

from packmech.validation.studies.accuracy import shear_time_step as study
from packmech.validation.work_precision import Answer, work_precision


def row(off, bar):
    figures = {"storage": 0.5, "storage error": 0.1, "loss": 0.2, "loss error": 0.1}
    return figures | {"storage off": off, "storage off error": bar, "loss off": 0.0, "loss off error": bar}


@pytest.mark.parametrize(
    ("off", "bar", "converged"),
    [(0.005, 0.0, True), (0.02, 0.0, False), (0.02, 0.015, True), (0.02, 0.2, False), (-0.02, 0.001, False)],
)
def test_converged_is_within_a_percent_or_two_error_bars_that_are_not_wide(off, bar, converged):
    assert study._converged(row(off, bar)) is converged


def test_words_name_the_step_below_which_all_are_converged():
    def answer(step):
        # converged by chance at the longest, then not, then truly
        off = 0.0 if step in (0.4, 0.05, 0.025, 0.0125) else 0.1
        return Answer({study.STORAGE: off, study.LOSS: 0.0}, work=row(off, 0.001))

    reference = {study.STORAGE: 0.0, study.LOSS: 0.0}
    table = work_precision({"linked": answer}, study.STEPS[:-1], reference, repeats=1)
    words = study.describe(table)
    assert "linked: from 0.05 tau down" in words
    assert "| linked | 0.2 | 0.5000 +- 0.1000 | 0.2000 +- 0.1000 | +10.00% +- 0.10% | +0.00% +- 0.10% |" in words


def test_the_figure_has_error_bars_and_leaves_out_what_failed(tmp_path):
    def answer(step):
        if step == 0.4:
            raise ArithmeticError("too long")
        return Answer({study.STORAGE: 0.01, study.LOSS: 0.0}, work=row(0.01, 0.001))

    reference = {study.STORAGE: 0.0, study.LOSS: 0.0}
    table = work_precision({"linked": answer}, study.STEPS[:-1], reference, repeats=1)
    study.Deviations(table).save_figure(tmp_path / "a.png")
    assert (tmp_path / "a.png").stat().st_size > 10_000


@pytest.mark.slow
def test_bonded_discs_converge_at_long_steps_of_velocity_verlet_and_not_of_euler(monkeypatch):
    monkeypatch.setattr(study, "REPEATS", {"linked": 2})
    monkeypatch.setattr(study, "STEPS", (0.1, 0.0125))
    study.finest.cache_clear()
    verlet, euler = (
        study.trial(*study.methods()[f"linked, {name}"], 0.1)
        for name in (
            "velocity Verlet",
            "semi-implicit Euler",
        )
    )
    study.finest.cache_clear()
    assert abs(verlet.work["loss off"]) < 1e-3 < 0.1 < abs(euler.work["loss off"])
