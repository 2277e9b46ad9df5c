"""Facts about motions taken to finite amplitude: what really unjams, and what is blocked."""

import functools

import numpy as np
import pytest

import packmech as pm
from packmech.contacts.network import pair_contacts
from packmech.jamming.play import Direction, difference

LATTICES = [("square", (4, 4)), ("kagome", (2, 2)), ("honeycomb", (3, 3)), ("sc", (3, 3, 3)), ("diamond", (2, 2, 2))]


@functools.cache
def judged(name, repeats):
    packing = pm.lattice_packing(name, repeats=repeats)
    return packing, pm.classify_jamming(packing)


@functools.cache
def jammed_in_its_box(particles=48):
    start = pm.random_packing(particles, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.8, seed=1)
    scene = pm.Scene(start, (pm.Repulsion(),))
    scene = scene.replace(packing=pm.jam(scene, strain="isotropic", pressure=1e-6).packing)
    return scene, pm.classify_jamming(scene)


def distances(contacts, packing):
    return pair_contacts(packing, contacts.i_c, contacts.j_c, contacts.image_cd).distance_c


def hinge(drop):
    """Return two touching discs, linked to a bead between them that is below their line by `drop` of their radius.

    The links of the straight one are its length together: no bend without overlap, though none to first order.
    """
    half = np.sqrt(1.0 + drop**2)
    links = pm.Links([0, 1], [1, 2], [[0, 0], [0, 0]], [half, half])
    return pm.Packing([[3.0, 4.0], [4.0, 4.0 - drop], [5.0, 4.0]], [1.0, 0.2, 1.0], pm.Box.cubic(8.0, 2), links)


BEND = np.array([[0.0, -0.5], [0.0, 1.0], [0.0, -0.5]])


@pytest.mark.parametrize(("name", "repeats"), LATTICES)
@pytest.mark.parametrize("question", ["collectively", "strictly"])
def test_floppy_lattice_unjams_without_an_overlap(name, repeats, question):
    packing, verdict = judged(name, repeats)
    played = pm.play_motion(packing, getattr(verdict, question).unjamming_motion, amplitude=0.3, steps=15)
    assert played.outcome == "unjammed"
    assert played.amplitude == pytest.approx(0.3, rel=1e-9)
    assert played.residual <= 1e-12
    assert played.opened_t[-1] > 0
    assert np.diff(played.packing_fraction_t).min() >= -1e-14


@pytest.mark.parametrize(("name", "repeats"), LATTICES)
@pytest.mark.parametrize("question", ["collectively", "strictly"])
def test_contacts_never_shorten_on_the_straight_line_of_a_motion_that_closes_none(name, repeats, question):
    packing, verdict = judged(name, repeats)
    motion = getattr(verdict, question).unjamming_motion
    direction = Direction(motion.displacement_nd, motion.strain_dd)
    contacts = pm.find_contacts(packing, gap_tolerance=1e-9)
    at = [0.0, 0.05, 0.1, 0.2, 0.4]
    distance_tc = np.array([distances(contacts, direction.times(a).apply(packing)) for a in at])
    assert np.diff(distance_tc, axis=0).min() > -1e-12
    # convex: slopes grow along the line
    slope_tc = np.diff(distance_tc, axis=0) / np.diff(at)[:, None]
    assert np.diff(slope_tc, axis=0).min() > -1e-12


def test_box_never_grows_on_the_straight_line_of_a_strain_without_trace():
    rng = np.random.default_rng(0)
    for dimension in (2, 3):
        strain = rng.standard_normal((dimension, dimension))
        strain = strain + strain.T
        strain -= np.trace(strain) / dimension * np.eye(dimension)
        volume = [pm.Box.cubic(1.0, dimension).strained(a * strain).volume for a in np.linspace(0.0, 0.2, 9)]
        assert np.diff(volume).max() < 0.0


def test_straight_line_is_the_same_from_any_place_along_it():
    rng = np.random.default_rng(1)
    packing, strain = judged("kagome", (2, 2))[0], 0.1 * rng.standard_normal((2, 2))
    direction = Direction(rng.standard_normal((12, 2)), strain + strain.T)
    there = direction.times(0.3).apply(packing)
    on = direction.ahead(0.3).times(0.4).apply(there)
    at_once = direction.times(0.7).apply(packing)
    np.testing.assert_allclose(on.position_nd, at_once.position_nd, atol=1e-14)
    np.testing.assert_allclose(on.box.lattice_dd, at_once.box.lattice_dd, atol=1e-14)
    step = difference(packing, there)
    np.testing.assert_allclose(step.displacement_nd, 0.3 * direction.displacement_nd, atol=1e-14)


def test_contacts_of_a_row_that_slides_open_by_the_theorem_of_pythagoras():
    square = pm.lattice_packing("square", repeats=(4, 4))
    slide = np.zeros((16, 2))
    slide[np.isclose(square.position_nd[:, 1], 1.0), 0] = 1.0
    played = pm.play_motion(square, slide, amplitude=0.4, steps=8)
    moved = played.amplitude_t / 0.75  # the mean displacement, a quarter, is no motion
    np.testing.assert_allclose(played.gap_tc.max(axis=1), np.sqrt(1.0 + moved**2) - 1.0, atol=1e-13)
    assert played.opened_t[-1] == 8


def test_nothing_moves_where_the_lattice_is_jammed():
    packing, verdict = judged("triangular", (4, 4))
    assert verdict.unjamming_motion is None
    played = pm.play_motion(packing, np.random.default_rng(0).standard_normal((16, 2)))
    assert (played.outcome, played.amplitude, played.steps) == ("blocked", 0.0, 0)


def test_lowest_mode_of_a_jammed_packing_is_blocked_at_once():
    scene, verdict = jammed_in_its_box()
    assert verdict.collective == "jammed"
    mode = pm.normal_modes(scene, count=1).displacement_mnd[0]
    for sign in (1.0, -1.0):
        played = pm.play_motion(scene, sign * mode)
        assert (played.outcome, played.steps) == ("blocked", 0)


def test_a_translation_past_rattlers_or_with_them_is_no_motion():
    """A mode of unlike masses moves the backbone's center, and rattlers not at all."""
    scene, verdict = jammed_in_its_box()
    assert verdict.rattlers.any()
    past = np.where(verdict.rattlers[:, None], 0.0, [0.3, 0.1])
    with pytest.raises(ValueError, match="motion must move particles against each other"):
        pm.play_motion(scene, past)
    mode = pm.normal_modes(scene, count=1).displacement_mnd[0]
    assert pm.play_motion(scene, mode + np.abs(mode).max() * past).steps == 0


def test_packing_jammed_in_its_box_only_unjams_when_the_box_shears():
    scene, verdict = jammed_in_its_box()
    assert (verdict.collective, verdict.strict) == ("jammed", "not jammed")
    played = pm.play_motion(scene, verdict.unjamming_motion, amplitude=0.2, steps=20)
    assert played.unjammed
    assert played.contacts_t[-1] < played.contacts_t[0]
    assert np.diff(played.packing_fraction_t).min() >= -1e-14
    assert played.residual <= 1e-9
    # what pressed at the start presses less
    assert played.energy_t[-1] < played.energy_t[0]


def test_volume_is_kept_where_it_is_to_stay_fixed():
    packing, verdict = judged("honeycomb", (3, 3))
    motion = verdict.strictly.unjamming_motion
    assert np.abs(motion.strain_dd).max() > 1e-3
    for strain, grows in (("isochoric", False), ("free", True)):
        played = pm.play_motion(packing, motion, amplitude=0.3, steps=10, strain=strain)
        change = played.packing_fraction_t[-1] / played.packing_fraction_t[0] - 1.0
        assert (change > 1e-6) == grows
        assert change > -1e-12


def test_disc_that_meets_another_head_on_is_blocked_where_they_touch():
    row = pm.Packing([[1.0, 1.0], [2.0, 1.0], [3.5, 1.0]], [0.5] * 3, pm.Box.cubic(4.5, 2))
    played = pm.play_motion(row, [[0.0, 0.0], [1.0, 0.0], [0.0, 0.0]], amplitude=3.0, steps=30)
    assert played.outcome == "blocked"
    # all the room there was is now between the two that touched
    assert played.gap_tc[-1] == pytest.approx([1.5], abs=1e-8)
    assert len(pm.find_contacts(played.packing, gap_tolerance=1e-8)) == 2


def test_straight_hinge_is_blocked_at_second_order():
    played = pm.play_motion(hinge(0.0), BEND)
    assert played.outcome == "blocked"
    assert "second order" in played.reason
    assert played.amplitude == 0.0


def test_bent_hinge_goes_on_through_the_straight_shape_that_its_links_admit():
    packing = hinge(0.5)
    played = pm.play_motion(packing, BEND, amplitude=1.0)
    assert played.outcome == "unjammed"
    assert played.residual <= 1e-9
    assert max(one.link_error for one in played.packing_t) < 1e-12
    height = [one.position_nd[1, 1] - one.position_nd[[0, 2], 1].mean() for one in played.packing_t]
    assert height[0] == pytest.approx(-0.5)
    assert height[-1] > -0.1


def test_bent_hinge_is_blocked_by_its_contact_the_other_way():
    played = pm.play_motion(hinge(0.5), -BEND)
    assert (played.outcome, played.steps) == ("blocked", 0)
    assert "contacts" in played.reason


def test_rows_of_dimers_slide_with_their_links_kept():
    square = pm.lattice_packing("square", repeats=(4, 4))
    x, y = np.rint(square.position_nd).astype(int).T
    number = {(a, b): n for n, (a, b) in enumerate(zip(x, y, strict=True))}
    pairs = [(number[a, b], number[a + 1, b]) for a in (0, 2) for b in range(4)]
    links = pm.Links(*np.array(pairs).T, np.zeros((8, 2)), np.ones(8))
    packing = square.replace(links=links)
    verdict = pm.classify_jamming(packing)
    played = pm.play_motion(packing, verdict.unjamming_motion, amplitude=0.3, steps=20)
    assert verdict.collective == "not jammed"
    assert played.unjammed
    assert max(one.link_error for one in played.packing_t) < 1e-12


def test_size_of_the_motion_and_translations_do_not_matter():
    packing, verdict = judged("kagome", (2, 2))
    motion = verdict.unjamming_motion.displacement_nd
    one = pm.play_motion(packing, motion, amplitude=0.2, steps=4)
    other = pm.play_motion(packing, 1e-6 * motion + [3e-6, 1e-6], amplitude=0.2, steps=4)
    np.testing.assert_allclose(one.packing.position_nd, other.packing.position_nd, atol=1e-9)


def test_played_motion_has_the_same_bits_when_repeated():
    scene, verdict = jammed_in_its_box()
    one, other = (pm.play_motion(scene, verdict.unjamming_motion, amplitude=0.05, steps=5) for _ in range(2))
    assert one.packing == other.packing
    assert np.array_equal(one.gap_tc, other.gap_tc)


def test_interrupt_hands_over_what_was_played():
    packing, verdict = judged("kagome", (2, 2))

    def stop(_, figures):
        if figures["steps"] == 3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt) as caught:
        pm.play_motion(packing, verdict.unjamming_motion, progress=stop)
    assert (caught.value.run.outcome, caught.value.run.steps) == ("interrupted", 3)


@pytest.mark.parametrize(
    ("motion", "words"),
    [
        (None, "motion must be an UnjammingMotion"),
        (np.ones((12, 2)), "motion must move particles"),
        (np.zeros((12, 2)), "motion must move particles"),
        (np.ones((5, 2)), "motion must have displacements of shape"),
    ],
)
def test_motion_that_cannot_be_played_is_refused(motion, words):
    with pytest.raises((TypeError, ValueError), match=f"^{words}"):
        pm.play_motion(pm.lattice_packing("kagome", repeats=(2, 2)), motion)


def test_motion_that_contacts_shorten_too_often_is_unfinished(monkeypatch):
    scene, verdict = jammed_in_its_box()
    monkeypatch.setattr("packmech.jamming.play._STEP_FACTOR", 1)
    played = pm.play_motion(scene, verdict.unjamming_motion, amplitude=0.2, steps=20)
    assert (played.outcome, played.unjammed) == ("unfinished", False)
    assert 0.0 < played.amplitude < 0.2
