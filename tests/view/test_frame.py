"""Facts about pictures drawn by the processor: areas, periodicity, what hides what, and the same bytes every time."""

import numpy as np
import pytest

import packmech as pm
from packmech.view import drawing
from packmech.view import frame as painting

PAIR = pm.Packing([[3.0, 5.0], [3.9, 5.0], [7.0, 7.0]], [0.5, 0.5, 0.5], pm.Box.cubic(10.0, 2))


def packing(dimension=2, seed=1):
    return pm.random_packing(40, dimension=dimension, sizes=pm.Bidisperse(1.4), packing_fraction=0.8, seed=seed)


def far(one, other):
    """Return the largest difference between two pictures."""
    return int(np.abs(one.astype(int) - other.astype(int)).max())


def like(pixels, color):
    """Return how many pixels have this color."""
    return int((np.abs(pixels.astype(int) - np.array(color)).max(axis=2) <= 3).sum())


@pytest.mark.parametrize(("length", "half"), [(0.0, 7.3), (20.0, 3.0), (31.7, 0.8)])
def test_a_line_covers_its_area_whatever_its_direction(length, half):
    for angle in (0.0, 0.3, 1.2, 2.5):
        image = painting.blank((80, 70), (0, 0, 0))
        start = np.array([40.3, 35.1]) - 0.5 * length * np.array([np.cos(angle), np.sin(angle)])
        end = start + length * np.array([np.cos(angle), np.sin(angle)])
        painting.paint_lines(image, None, np.array([[start, end]]), np.array([half]), np.full((1, 3), 1.0))
        assert image[:, :, 0].sum() == pytest.approx(2.0 * half * length + np.pi * half**2, rel=0.02)


@pytest.mark.parametrize("half", [0.4, 0.1])
def test_lines_thinner_than_a_pixel_are_paler_in_proportion(half):
    image = painting.blank((80, 40), (0, 0, 0))
    painting.paint_lines(image, None, np.array([[[10.0, 20.0], [70.0, 20.0]]]), np.array([half]), np.full((1, 3), 1.0))
    assert image[:, 40, 0].sum() == pytest.approx(2.0 * half, rel=1e-6)


def test_a_picture_has_the_size_that_was_asked_for_and_the_same_bytes_every_time():
    scene = pm.Scene(packing(), (pm.Repulsion(),))
    one = pm.draw_frame(scene.packing, effects=scene.effects, size=(120, 90))
    assert one.shape == (90, 120, 3) and one.dtype == np.uint8
    assert one.tobytes() == pm.draw_frame(scene.packing, effects=scene.effects, size=(120, 90)).tobytes()


def test_drawing_draws_no_random_number():
    before = str(np.random.get_state())  # noqa: NPY002 - the global state is what must not change
    pm.draw_frame(packing(), size=(60, 60))
    assert str(np.random.get_state()) == before  # noqa: NPY002


@pytest.mark.parametrize("dimension", [2, 3])
def test_particles_in_another_image_give_the_same_picture(dimension):
    start = packing(dimension)
    image = np.random.default_rng(3).integers(-2, 3, size=start.position_nd.shape)
    moved = start.replace(position_nd=start.position_nd + image @ start.box.lattice_dd.T)
    assert far(pm.draw_frame(start, size=(200, 200)), pm.draw_frame(moved, size=(200, 200))) <= 2


def test_a_box_sheared_by_whole_lattice_vectors_gives_the_same_picture():
    start = packing()
    whole = pm.Box(start.box.lattice_dd @ np.array([[1.0, 3.0], [0.0, 1.0]]))
    assert far(pm.draw_frame(start), pm.draw_frame(start.replace(box=whole))) <= 2


def test_the_cell_keeps_its_size_on_the_picture_while_it_is_sheared_a_little_and_stays_whole_when_more():
    start = packing()
    found = []
    for strain in (0.0, 0.1, 0.18, 0.45):
        shear = np.array([[1.0, strain], [0.0, 1.0]])
        moved = start.replace(position_nd=start.position_nd @ shear.T, box=pm.Box(shear @ start.box.lattice_dd))
        from packmech.view.frame import _Picture

        sheet = _Picture(moved, (300, 300), 1.0)
        found.append(sheet.scale)
        corners = sheet.place(np.concatenate(drawing.box_outline(sheet.cell.box)))
        assert corners.min() > 0.0 and corners.max() < 300.0
    assert found[0] == pytest.approx(found[1], rel=1e-12) == pytest.approx(found[2], rel=1e-12)
    assert found[3] < found[0]


def test_stronger_contacts_have_wider_lines_and_sliding_ones_are_blue():
    contacts = pm.find_contacts(PAIR)
    assert len(contacts) == 1
    four = pm.lattice_packing("square", repeats=(3, 3), relative_overlap=0.01)
    network = pm.find_contacts(four)
    force = np.where(np.arange(len(network)) == 0, 5.0, 1.0)
    sliding = np.arange(len(network)) == 0
    weak = pm.draw_frame(four, contacts=network, force_c=np.ones(len(network)), sliding_c=sliding)
    strong = pm.draw_frame(four, contacts=network, force_c=force, sliding_c=sliding)
    none = pm.draw_frame(four, contacts=network, force_c=force)
    assert like(none, drawing.SLIDING) == 0 < like(weak, drawing.SLIDING) < like(strong, drawing.SLIDING)


def test_a_bonded_pair_is_a_bond_and_no_contact():
    bond = pm.Bonds([0], [1], [[0, 0]], [0.9])
    as_bond = pm.draw_frame(PAIR, effects=(pm.Repulsion(), bond))
    lines = pm.draw_frame(PAIR, effects=(pm.Repulsion(),))
    assert like(as_bond, drawing.IDLE_BOND) > 20
    assert like(lines, drawing.IDLE_BOND) == 0
    ember = drawing.force_colors(np.ones(1))[0]
    assert like(lines, ember) > 20 > like(as_bond, ember)


def test_rattlers_are_amber():
    marks = np.array([False, False, True])
    middle = pm.draw_frame(PAIR, rattler_n=marks)
    assert like(middle, drawing.RATTLER) > 0
    assert like(pm.draw_frame(PAIR), drawing.RATTLER) == 0


def test_what_lies_nearer_to_the_eye_hides_what_lies_behind_whatever_their_order():
    toward = np.array(drawing.VIEW) / np.linalg.norm(drawing.VIEW)
    middle = np.full(3, 5.0)
    near, back = middle + 2.0 * toward, middle - 2.0 * toward
    box = pm.Box.cubic(10.0, 3)
    for order in ((0, 1), (1, 0)):
        both = pm.Packing(np.array([near, back])[list(order)], [0.8, 0.8], box)
        marks = np.array([True, False])[list(order)]
        front = pm.draw_frame(both, rattler_n=marks)[240, 240].astype(int)
        hidden = pm.draw_frame(both, rattler_n=~marks)[240, 240].astype(int)
        assert front[0] > front[2] and hidden[0] < hidden[2]  # amber, and blue


def test_a_link_between_two_spheres_is_hidden_by_solid_ones_and_seen_between_beads():
    chain = pm.Packing(
        [[1.5, 2.0, 2.0], [2.5, 2.0, 2.0]],
        [0.5, 0.5],
        pm.Box.cubic(4.0, 3),
        links=pm.Links([0], [1], [[0, 0, 0]], [1.0]),
    )
    pale = np.array(drawing.IDLE_BOND).min() * 0.6

    def bright(pixels):
        return int((pixels.min(axis=2) > pale).sum())

    assert bright(pm.draw_frame(chain, beads=0.3)) > 20 > bright(pm.draw_frame(chain))


def test_walls_are_drawn():
    walls = pm.draw_frame(PAIR, effects=(pm.Repulsion(), pm.Walls(1, 1.0, 9.0)))
    assert far(walls, pm.draw_frame(PAIR, effects=(pm.Repulsion(),))) > 50


def test_particles_that_just_touch_are_joined_by_lines_of_one_width():
    from packmech.view.frame import TOUCH, contact_forces

    kagome = pm.lattice_packing("kagome", repeats=(2, 2))
    contacts = pm.find_contacts(kagome, gap_tolerance=TOUCH)
    assert len(contacts) == 2 * kagome.particles
    assert contact_forces(contacts, (pm.Repulsion(),)).tolist() == [1.0] * len(contacts)
    assert far(pm.draw_frame(kagome, effects=(pm.Repulsion(),)), pm.draw_frame(kagome)) == 0


def test_centers_that_coincide_under_a_law_that_diverges_are_drawn():
    from packmech.view.frame import contact_forces

    deep = pm.Packing([[3.0, 5.0], [3.0, 5.0], [3.4, 5.0], [3.8, 5.2]], [0.5] * 4, pm.Box.cubic(10.0, 2))
    effects = (pm.Repulsion(law=pm.RepulsiveLennardJones()),)
    assert np.isfinite(contact_forces(pm.find_contacts(deep), effects)).all()
    assert pm.draw_frame(deep, effects=effects).std() > 1.0


def test_a_packing_in_which_nothing_touches_is_drawn():
    alone = pm.Packing([[1.0, 1.0]], [0.2], pm.Box.cubic(2.0, 2))
    assert pm.draw_frame(alone, effects=(pm.Repulsion(),)).std() > 1.0
