"""Facts about the driver that follows packings along a parameter, on numbers in place of packings."""

from __future__ import annotations

import math

import pytest

from packmech.protocols.continuation import Step, StepLengths, find_root, follow


def square_root(lengths, goal, tries):
    """Follow the root of x^2 = place by Newton's steps, of which few lead far."""

    def reach(state, place, further):
        tries.append(further - place)
        x = state
        for _ in range(4):
            x = 0.5 * (x + further / x)
        return Step(x, further) if abs(x * x - further) < 1e-6 * further else None

    return list(follow(reach, 1.0, 1.0, goal, lengths))


@pytest.mark.parametrize("goal", [1e4, 1e-4, 1.0])
def test_it_ends_at_the_goal_wherever_steps_that_are_short_enough_succeed(goal):
    steps = square_root(StepLengths(growth=3.0), goal, tries := [])
    assert steps[-1].place == goal and steps[-1].after == pytest.approx(math.sqrt(goal), rel=1e-6)
    assert len(tries) >= len(steps) >= 1
    assert all(one * (goal - 1.0) >= 0.0 for one in tries)


def test_steps_are_halved_where_they_fail_and_grow_where_they_succeed():
    tries = []

    def reach(state, place, further):
        tries.append(further - place)
        return Step(state, further) if further - place <= 3.0 else None

    lengths = StepLengths(8.0, longest=4.0, growth=3.0)
    places = [one.place for one in follow(reach, 0, 0.0, 9.0, lengths)]
    assert places == [2.0, 4.0, 6.0, 9.0]
    assert tries == [8.0, 4.0, 2.0, 4.0, 2.0, 4.0, 2.0, 3.0]


def test_where_steps_are_too_short_it_goes_on_otherwise_or_ends():
    def reach(state, place, further):
        return None if place < 5.0 < further else Step(state, further)

    def jump(state, place, further):
        return Step(state + 1, further, "jump")

    lengths = StepLengths(1.0, shortest=0.1)
    steps = list(follow(reach, 0, 0.3, 9.0, lengths, jump))
    jumps = [one for one in steps if one.event == "jump"]
    assert steps[-1].place == 9.0 and steps[-1].after == 1
    assert len(jumps) == 1 and 5.0 < jumps[0].place < 5.1
    ended = list(follow(reach, 0, 0.3, 9.0, StepLengths(1.0, shortest=0.1)))
    assert 4.9 < ended[-1].place <= 5.0
    nothing = list(follow(reach, 0, 0.3, 9.0, StepLengths(1.0, shortest=0.4, least=0.01), lambda *_: None))
    assert 4.99 < nothing[-1].place <= 5.0


def test_no_step_is_left_that_is_shorter_than_asked_for():
    steps = list(follow(lambda state, place, further: Step(state, further), 0, 0.0, 3.05, StepLengths(1.0, left=0.1)))
    assert [one.place for one in steps] == [1.0, 2.0, 3.05]


def test_an_event_may_lie_before_or_beyond_what_was_aimed_at():
    def reach(state, place, further):
        return Step("fallen", 2.5, "fall") if place < 2.0 <= further else Step(state, further)

    steps = list(follow(reach, "held", 0.0, 2.2, StepLengths(1.5)))
    assert [(one.place, one.event) for one in steps] == [(1.5, None), (2.5, "fall")]


def test_the_root_of_a_margin_is_found_to_rounding_and_what_is_seen_there_returned():
    seen = find_root(lambda place: (place, math.cos(place)), lambda one: one[1], 0.0, 3.0, (3.0, math.cos(3.0)), 1.0)
    assert seen[0] == pytest.approx(0.5 * math.pi, abs=1e-14)


def test_a_root_beside_places_where_nothing_is_seen_is_looked_at_itself():
    def look(place):
        return place if place < 1.0 else None

    found = find_root(look, lambda one: -math.inf if one is None else 1.5 - one, 0.0, 2.0, None, 1.5)
    assert found is None or found == pytest.approx(1.0, abs=1e-11)
