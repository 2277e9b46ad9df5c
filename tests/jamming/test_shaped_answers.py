"""What is answered about ellipses and rigid bodies, by their states of self stress and quartic modes: every case."""

from dataclasses import dataclass
from types import SimpleNamespace

import numpy as np
import pytest

import packmech as pm
from packmech.jamming import shaped
from packmech.jamming.contact_selection import RestCheck
from packmech.jamming.verdict import AMBIGUOUS, JAMMED, NOT_JAMMED, JammingAnswer

PUSH, PULL = [1.0, 2.0, 3.0], [1.0, -2.0, 3.0]
# orthonormal states: their first part pushes, their second alone does not
TWO = np.linalg.qr(np.array([PUSH, [1.0, -1.0, 0.0]]).T)[0]


@pytest.fixture
def answered(monkeypatch):
    """Return a function that gives the answer to what is found of three contacts."""

    def answer(force_ck, *, own=PUSH, floppy=0, curvature=(), certain=True, residual=1e-7):
        states = np.asarray(force_ck, dtype=float)
        found = SimpleNamespace(
            motions=10 + floppy, trivial=2, rank=8, force_ck=states if states.size else None, certain=certain,
            count=states.shape[1] if states.size else 0, isostatic_contact_count=9,
        )  # fmt: skip
        modes = SimpleNamespace(curvature_m=np.array(curvature), pressure=2.0)
        monkeypatch.setattr(shaped, "states_of_self_stress", lambda *given, **named: found)
        monkeypatch.setattr(shaped, "contact_terms", lambda *given: SimpleNamespace(first_c=-np.array(own)))
        monkeypatch.setattr(shaped, "quartic_modes", lambda *given, **named: modes)
        scene = SimpleNamespace(effects=(), packing=SimpleNamespace(reference_diameter=1.0, dimension=2))
        network = SimpleNamespace(contacts=range(3), packing=None)
        return shaped._answer(scene, network, "none", RestCheck(residual, 0.0, 1e-5, "law"), None)

    return answer


def column(force_c):
    return np.array([force_c]).T / np.linalg.norm(force_c)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_the_only_state_decides_by_its_signs_whatever_its_own_sign(answered, sign):
    jammed = answered(sign * column(PUSH))
    assert jammed.verdict == JAMMED and jammed.first_order_jammed
    assert jammed.contact_force_c == pytest.approx([0.5, 1.0, 1.5])
    assert answered(sign * column(PULL)).verdict == NOT_JAMMED
    assert answered([]).verdict == NOT_JAMMED


@pytest.mark.parametrize("floppy", [0, 1])
def test_nothing_is_answered_away_from_rest_or_where_the_rank_depends_on_its_tolerance(answered, floppy):
    for force_ck in (column(PUSH), column(PULL), TWO, []):
        assert answered(force_ck, floppy=floppy, curvature=[1.0] * floppy, residual=1e-4).verdict == AMBIGUOUS
        uncertain = answered(force_ck, floppy=floppy, curvature=[1.0] * floppy, certain=False)
        assert uncertain.verdict == AMBIGUOUS and uncertain.first_order_jammed is None


def test_of_several_states_that_of_the_law_decides_if_it_is_one_of_them_and_pushes(answered):
    assert answered(TWO).verdict == JAMMED
    # a load on a strain, which no state bears: a hundredth of the largest force is no rounding
    off = np.array(PUSH) + 0.03 * np.cross(TWO[:, 0], TWO[:, 1])
    assert answered(TWO, own=off).verdict == AMBIGUOUS
    pulling = TWO @ (TWO.T @ np.array([3.0, -1.0, 2.0]))
    assert pulling.min() < 0.0 and answered(TWO, own=pulling).verdict == AMBIGUOUS


@pytest.mark.parametrize(
    ("curvature", "alone", "among_two"),
    [
        ([1.0, 2.0], JAMMED, JAMMED),
        ([-1.0, 2.0], NOT_JAMMED, AMBIGUOUS),
        # curvatures below 1e-6 of the pressure, 2, are none
        ([1.9e-6, 2.0], AMBIGUOUS, AMBIGUOUS),
        ([-1.9e-6, 2.0], AMBIGUOUS, AMBIGUOUS),
        ([2.1e-6, 2.0], JAMMED, JAMMED),
        ([-2.1e-6, 2.0], NOT_JAMMED, AMBIGUOUS),
    ],
)
def test_motions_that_contacts_leave_are_held_where_all_curvatures_are_positive(answered, curvature, alone, among_two):
    for force_ck, expected in ((column(PUSH), alone), (TWO, among_two)):
        found = answered(force_ck, floppy=2, curvature=curvature)
        assert found.verdict == expected and found.first_order_jammed is False


@dataclass(frozen=True)
class Some:
    """A network of contacts with forces."""

    contacts: "Row"


class Row(list):
    """Contacts that can be chosen from."""

    def select(self, mask):
        return Row(np.array(self)[mask])


@pytest.mark.parametrize(
    ("force", "kept"),
    [([1.0, 1e-3, 1e-8], [0, 1]), ([1.0, 1.0, -1.0], [0, 1]), ([0.0] * 3, [0, 1, 2]), ([-1.0, 0.0, 0.0], [0, 1, 2])],
)
def test_contacts_that_bear_less_than_a_millionth_of_the_mean_are_none_where_any_bears(monkeypatch, force, kept):
    monkeypatch.setattr(shaped, "contact_terms", lambda *given: SimpleNamespace(first_c=-np.array(force)))
    assert list(shaped._carrying(Some(Row([0, 1, 2])), SimpleNamespace(effects=())).contacts) == kept


@pytest.mark.parametrize(
    ("collective", "strict", "expected"), [(AMBIGUOUS, JAMMED, JAMMED), (AMBIGUOUS, NOT_JAMMED, AMBIGUOUS)]
)
def test_strictly_jammed_bodies_are_collectively_so(monkeypatch, collective, strict, expected):
    told = {"none": JammingAnswer(collective, "", None, 0, 0, 0), "isochoric": JammingAnswer(strict, "", None, 0, 0, 0)}
    monkeypatch.setattr(shaped, "_answer", lambda scene, network, kind, rest, gap_tolerance: told[kind])
    packing = pm.random_packing(4, dimension=2, packing_fraction=0.3, seed=0, shapes=pm.Ellipses(1.5))
    verdict = pm.classify_jamming(packing)
    assert (verdict.collective, verdict.strict) == (expected, strict)
