"""Facts about the checks at the edge: what passes, and one message format for what does not."""

import numpy as np
import pytest

from packmech import check


def test_finite_array_returns_a_new_contiguous_double_array():
    given = np.arange(6, dtype=np.int32).reshape(3, 2).T
    checked = check.finite_array("a", given, shape=(2, None))
    assert checked.dtype == np.float64 and checked.flags.c_contiguous and checked.flags.writeable
    assert not np.shares_memory(checked, given)
    assert checked.tolist() == given.tolist()


def test_finite_array_allows_nothing_only_where_asked():
    assert check.finite_array("a", np.zeros((0, 2)), shape=(None, 2), empty=True).shape == (0, 2)
    with pytest.raises(ValueError, match="a must hold at least one bond, got none"):
        check.finite_array("a", np.zeros((0, 2)), shape=(None, 2), what="bond")


@pytest.mark.parametrize(
    ("value", "error", "message"),
    [
        ([[1.0, np.nan]], ValueError, "a must be finite, got nan for particle 0"),
        ([[1.0, 2.0], [np.inf, 0.0]], ValueError, "a must be finite, got inf for particle 1"),
        ([1.0, 2.0], ValueError, r"a must have shape \(any, 2\), got \(2,\)"),
        ([[1.0, 2.0, 3.0]], ValueError, r"a must have shape \(any, 2\), got \(1, 3\)"),
        ("text", TypeError, "a must be an array of real numbers, got 'text'"),
        ([[1.0, 2j]], TypeError, "a must be an array of real numbers"),
        (None, TypeError, "a must be an array of real numbers, got None"),
        ([[1.0], [2.0, 3.0]], TypeError, "a must be an array of real numbers"),
        ({"x": 1}, TypeError, "a must be an array of real numbers"),
    ],
)
def test_finite_array_refuses(value, error, message):
    with pytest.raises(error, match=message):
        check.finite_array("a", value, shape=(None, 2))


def test_long_values_are_shortened_in_messages():
    with pytest.raises(TypeError) as caught:
        check.finite_array("a", "x" * 10_000, shape=(None,))
    assert len(str(caught.value)) < 150


@pytest.mark.parametrize("value", [0.0, -1.0])
def test_positive_array_names_the_entry(value):
    with pytest.raises(ValueError, match=f"a must be positive, got {value} for contact 1"):
        check.positive_array("a", [1.0, value], shape=(None,), what="contact")


@pytest.mark.parametrize("value", [1, 1.5, np.float32(2.0), np.int64(3)])
def test_real_returns_a_plain_float(value):
    assert type(check.real("a", value)) is float


@pytest.mark.parametrize(
    ("value", "bounds", "error", "message"),
    [
        (float("nan"), {}, ValueError, "a must be a finite number, got nan"),
        (float("inf"), {}, ValueError, "a must be a finite number, got inf"),
        (1.0, {"above": 1.0}, ValueError, "a must be a finite number above 1, got 1.0"),
        (0.9, {"at_least": 1.0}, ValueError, "a must be a finite number at least 1, got 0.9"),
        (1.0, {"above": 0.0, "below": 1.0}, ValueError, "a must be a finite number above 0 and below 1, got 1.0"),
        (2.1, {"at_most": 2.0}, ValueError, "a must be a finite number at most 2, got 2.1"),
        ("1", {}, TypeError, "a must be a finite number, got '1'"),
        (True, {}, TypeError, "a must be a finite number, got True"),
        (None, {}, TypeError, "a must be a finite number, got None"),
        ([1.0], {}, TypeError, r"a must be a finite number, got \[1.0\]"),
        (1j, {}, TypeError, "a must be a finite number, got 1j"),
    ],
)
def test_real_refuses(value, bounds, error, message):
    with pytest.raises(error, match=message):
        check.real("a", value, **bounds)


def test_bounds_that_are_included_pass():
    assert check.real("a", 1.0, at_least=1.0, at_most=1.0) == 1.0


@pytest.mark.parametrize(
    ("value", "bounds", "error", "message"),
    [
        (1.0, {}, TypeError, "a must be an integer, got 1.0"),
        (True, {}, TypeError, "a must be an integer, got True"),
        ("1", {}, TypeError, "a must be an integer, got '1'"),
        (0, {"at_least": 1}, ValueError, "a must be an integer at least 1, got 0"),
        (4, {"at_least": 2, "at_most": 3}, ValueError, "a must be an integer at least 2 and at most 3, got 4"),
    ],
)
def test_integer_refuses(value, bounds, error, message):
    with pytest.raises(error, match=message):
        check.integer("a", value, **bounds)


def test_integer_returns_a_plain_int():
    assert type(check.integer("a", np.int32(5), at_least=5)) is int


def test_one_of_lists_the_choices():
    assert check.one_of("a", "fixed", ("fixed", "free")) == "fixed"
    for wrong in ("Fixed", 3, None, ["fixed"]):
        with pytest.raises(ValueError, match="a must be one of 'fixed', 'free', got"):
            check.one_of("a", wrong, ("fixed", "free"))


def test_instance_names_the_class():
    check.instance("a", 1, int, "an")
    with pytest.raises(TypeError, match="a must be an int, got 'x'"):
        check.instance("a", "x", int, "an")
