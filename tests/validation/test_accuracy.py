"""Facts about work_precision: known orders, floors, costs counted by a fake clock, failures kept as failures."""

import csv
import io
import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import packmech as pm
from packmech.validation.work_precision import Answer, fit_power_law, work_precision

HALVINGS = tuple(0.1 / 2**k for k in range(6))


def euler(step: float) -> float:
    value = 1.0
    for _ in range(round(1.0 / step)):
        value += step * value
    return value


def runge_kutta_4(step: float) -> float:
    value = 1.0
    for _ in range(round(1.0 / step)):
        k1 = value
        k2 = value + step / 2 * k1
        k3 = value + step / 2 * k2
        k4 = value + step * k3
        value += step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return value


@pytest.fixture(scope="module")
def growth():
    return work_precision({"Euler": euler, "Runge-Kutta 4": runge_kutta_4}, HALVINGS, math.e, knob="step")


def test_euler_is_of_order_one_against_the_closed_form(growth):
    assert growth.order("Euler") == pytest.approx(1.0, abs=0.05)


def test_runge_kutta_4_is_of_order_four_against_the_closed_form(growth):
    assert growth.order("Runge-Kutta 4") == pytest.approx(4.0, abs=0.1)


def test_cheapest_asks_only_trials_below_the_error(growth):
    trial = growth.cheapest(error_below=1e-5)
    assert trial.method == "Runge-Kutta 4"
    assert trial.error < 1e-5


def test_cheapest_is_none_where_no_trial_is_accurate_enough(growth):
    assert growth.cheapest(error_below=1e-300) is None


@given(order=st.floats(0.5, 6.0), prefactor=st.floats(1e-3, 1e3))
def test_an_exact_power_law_is_fitted_exactly_and_without_floor(order, prefactor):
    settings = [0.1, 0.03, 0.01, 0.003, 0.001]
    fit = fit_power_law(settings, [prefactor * h**order for h in settings])
    assert fit.order == pytest.approx(order, rel=1e-9)
    assert fit.floor == 0.0
    assert fit.order_error < 1e-9


@given(order=st.floats(1.0, 4.0), kept=st.integers(3, 6))
def test_a_floor_is_found_where_the_errors_stop_falling(order, kept):
    settings = [10.0**-k for k in range(9)]
    floor = settings[kept] ** order
    fit = fit_power_law(settings, [max(h**order, floor) for h in settings])
    assert fit.order == pytest.approx(order, rel=1e-6)
    assert fit.floor == pytest.approx(floor, rel=1e-6)


@given(order=st.floats(1.0, 4.0), part=st.floats(0.3, 3.0))
def test_errors_that_still_fall_are_no_floor(order, part):
    """Beyond the bend they fall with a part of the order: above a quarter of it finer settings still help."""
    settings = [10.0**-k for k in range(6)]
    errors = [h**order if h > 1e-3 else 1e-3**order * (h / 1e-3) ** (part * order) for h in settings]
    assert fit_power_law(settings, errors).floor == 0.0


def test_errors_that_hardly_fall_are_a_floor():
    settings = [10.0**-k for k in range(7)]
    fit = fit_power_law(settings, [max(h, 1e-3) ** 2 * min(h / 1e-3, 1.0) ** 0.2 for h in settings])
    assert fit.order == pytest.approx(2.0, abs=0.1)
    assert 1e-7 < fit.floor < 1e-6


def test_the_error_of_an_order_holds_settings_that_are_too_coarse_for_it():
    settings = [10.0**-k for k in range(6)]
    fit = fit_power_law(settings, [h**2 + 3.0 * h**3 for h in settings])
    assert 1e-3 < abs(fit.order - 2.0) < 1.5 * fit.order_error
    assert np.isnan(fit_power_law([0.1, 0.01], [1e-2, 1e-4]).order_error)


def test_an_order_needs_two_errors_above_zero():
    with pytest.raises(ValueError, match="at least two errors above zero, got 1"):
        fit_power_law([0.1, 0.01], [1e-3, 0.0])


def test_the_first_call_of_a_method_is_kept_apart_and_never_counted():
    now = itertools.count()
    clock = {"t": 0.0}
    calls = {"n": 0}

    def slow_at_first(setting: float) -> float:
        calls["n"] += 1
        clock["t"] += 100.0 if calls["n"] == 1 else setting
        return next(now) * 0.0

    table = work_precision(slow_at_first, (3.0, 2.0), 0.0, clock=lambda: clock["t"], repeats=3)
    assert table.first_seconds == {"": 100.0}
    assert [trial.seconds for trial in table.trials] == [3.0, 2.0]
    assert calls["n"] == 1 + 2 * 3


def test_the_median_of_the_repeats_is_kept():
    clock = {"t": 0.0}
    seconds = iter([9.0, 1.0, 50.0, 2.0])

    def jittery(setting: float) -> float:
        clock["t"] += next(seconds)
        return setting

    assert work_precision(jittery, (1.0,), 1.0, clock=lambda: clock["t"]).trials[0].seconds == 2.0


def test_a_raised_failure_stays_in_the_table_with_its_reason():
    def breaks_when_fine(setting: float) -> float:
        if setting < 0.5:
            raise FloatingPointError("lost all digits")
        return setting

    table = work_precision(breaks_when_fine, (1.0, 0.1), 0.0)
    assert table.trials[1].failed == "FloatingPointError: lost all digits"
    assert math.isnan(table.trials[1].error)
    assert table.cheapest(error_below=0.5) is None


def test_an_answer_that_did_not_converge_keeps_its_error_but_never_counts():
    table = work_precision(lambda h: Answer(0.0, converged=False, note="step limit"), (1.0, 0.1), 0.0)
    assert [trial.failed for trial in table.trials] == ["step limit", "step limit"]
    assert table.trials[0].error == 0.0
    assert table.cheapest(error_below=1.0) is None


def test_an_answer_that_is_not_finite_is_a_failure():
    assert work_precision(lambda h: math.nan, (1.0,), 0.0).trials[0].failed == "the answer is not finite"


def test_a_mistake_in_the_problem_goes_through():
    def mistaken(setting: float) -> float:
        raise KeyError("typo")

    with pytest.raises(KeyError, match="typo"):
        work_precision(mistaken, (1.0,), 0.0)


def test_each_quantity_of_a_mapping_has_its_own_error_and_order():
    table = work_precision(
        lambda h: {"first": 1.0 + h, "second": np.array([2.0, 2.0 - h**2])},
        HALVINGS,
        {"first": 1.0, "second": [2.0, 2.0]},
    )
    assert table.order("", quantity="first") == pytest.approx(1.0)
    assert table.order("", quantity="second") == pytest.approx(2.0)


def test_csv_returns_every_digit():
    table = work_precision({"m": lambda h: Answer(h / 3, work={"steps": 7})}, (0.1,), 0.0)
    (row,) = csv.DictReader(io.StringIO(table.to_csv()))
    assert float(row["error"]) == 0.1 / 3
    assert float(row["steps"]) == 7
    assert float(row["cpu seconds"]) == table.trials[0].seconds


def test_markdown_has_a_row_for_every_trial(growth):
    assert growth.to_markdown().count("\n") == 2 + len(growth.trials)


def test_markdown_tells_settings_apart():
    table = work_precision({"m": lambda h: h}, (0.05, 0.025, 0.0125), 0.0, knob="step")
    head, _, *rows = table.to_markdown().splitlines()
    assert head.startswith("| method | step | error | CPU s |")
    assert [row.split(" | ")[1] for row in rows] == ["0.05", "0.025", "0.0125"]


def test_markdown_shows_counts_that_are_no_number_or_have_no_end():
    answer = Answer(0.5, work={"verdict": math.nan, "steps": math.inf, "calls": 7.0})
    assert work_precision(lambda h: answer, (0.1,), 0.0).to_markdown().splitlines()[2].count("nan | inf | 7 |") == 1


def test_the_figure_is_written_even_with_failures_and_exact_zeros(tmp_path):
    def mixed(setting: float) -> Answer:
        return Answer(0.0 if setting < 0.03 else setting, converged=setting < 0.09)

    path = tmp_path / "figures" / "mixed.png"
    work_precision(mixed, HALVINGS, 0.0).save_figure(path)
    assert path.read_bytes().startswith(b"\x89PNG")


def test_the_figure_is_written_where_a_quantity_is_undefined_throughout(tmp_path):
    table = work_precision(lambda setting: {"one": setting, "other": math.nan}, HALVINGS, {"one": 0.0, "other": 0.0})
    table.save_figure(tmp_path / "some.png")
    assert (tmp_path / "some.png").read_bytes().startswith(b"\x89PNG")


@pytest.mark.parametrize(
    ("arguments", "options", "message"),
    [
        (({}, (1.0,), 0.0), {}, "problem must have at least one method, got none"),
        ((abs, (), 0.0), {}, "settings must have at least one value, got none"),
        ((abs, (1.0, -1.0), 0.0), {}, r"settings\[1\] must be a finite number above 0, got -1.0"),
        ((abs, (1.0, math.nan), 0.0), {}, r"settings\[1\] must be a finite number above 0, got nan"),
        ((abs, (1.0, 1.0), 0.0), {}, "settings must be different"),
        ((abs, (1.0,), 0.0), {"repeats": 0}, "repeats must be an integer at least 1, got 0"),
        ((abs, (1.0,), [1.0, 2.0]), {}, r"value must have the reference's shape \(2,\), got \(\)"),
        ((abs, (1.0,), {"a": 1.0}), {}, "value must have every quantity of the reference, got none for 'a'"),
    ],
)
def test_bad_arguments_are_named(arguments, options, message):
    with pytest.raises(ValueError, match=message):
        work_precision(*arguments, **options)


def test_a_problem_that_is_no_function_is_named():
    with pytest.raises(TypeError, match="problem must be a function of the setting, got 3 for method 'three'"):
        work_precision({"three": 3}, (1.0,), 0.0)


@pytest.mark.parametrize("ask", ["order", "floor", "of"])
def test_an_unknown_method_is_named(growth, ask):
    with pytest.raises(ValueError, match="method must be one of .*got 'Heun'"):
        getattr(growth, ask)("Heun")


def test_an_unknown_quantity_is_named(growth):
    with pytest.raises(ValueError, match="quantity must be one of .*got 'energy'"):
        growth.cheapest(error_below=1.0, quantity="energy")


def test_one_bound_is_for_all_quantities_and_bounds_by_name_for_those_named():
    def trial(setting, seconds, **errors):
        return pm.Trial(method="only", setting=setting, errors=errors, seconds=seconds)

    trials = (trial(0.1, 1.0, energy=1e-6, stress=1e-2), trial(0.01, 2.0, energy=1e-9, stress=1e-5))
    table = pm.WorkPrecision(trials, {"only": 0.0})
    assert table.cheapest(error_below=1e-4).seconds == 2.0
    assert table.cheapest(error_below=1e-4, quantity="energy").seconds == 1.0
    assert table.cheapest(error_below={"energy": 1e-4}).seconds == 1.0
    assert table.cheapest(error_below={"energy": 1e-4, "stress": 1e-3}).seconds == 2.0
    assert table.cheapest(error_below={"energy": 1e-12}) is None
    with pytest.raises(ValueError, match="quantity must be one of"):
        table.cheapest(error_below={"pressure": 1e-3})
    with pytest.raises(
        ValueError, match="error_below of 'stress' must be a number, perhaps infinite, above 0, got 0.0"
    ):
        table.cheapest(error_below={"stress": 0.0})
    lucky = trial(1.0, 0.1, energy=1e-6, stress=1e-6)
    assert pm.WorkPrecision((lucky, *trials), {"only": 0.0}).cheapest(error_below=1e-4).seconds == 2.0
    assert pm.WorkPrecision((lucky, *trials), {"only": 0.0}).cheapest(error_below=0.1).seconds == 0.1
    ax = pm.plot(table)
    assert [one.get_text() for one in ax.get_legend().get_texts()] == ["only, error in energy", "only, error in stress"]


def test_the_only_method_need_not_be_named():
    table = work_precision(lambda h: h**2, HALVINGS, 0.0)
    (name,) = table.methods
    assert table.order() == table.order(name) == pytest.approx(2.0, abs=1e-6)
    assert table.of() == table.of(name)
    with pytest.raises(ValueError, match="method must be one of"):
        work_precision({"a": abs, "b": abs}, HALVINGS, 0.0).of()
