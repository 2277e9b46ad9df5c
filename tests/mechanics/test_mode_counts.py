"""Facts about counted modes: numbers below frequencies, windows that come complete, and states of copies of a box."""

import numpy as np
import pytest

import packmech as pm
from packmech.mechanics import modes as modes_module
from packmech.mechanics import state_density

SPRINGS = (pm.Repulsion(),)


def crystal(name, repeats, overlap=0.0):
    packing = pm.lattice_packing(name, repeats=repeats, relative_overlap=overlap)
    return pm.Scene(packing.replace(mass_n=np.ones(packing.particles)), SPRINGS)


def cuts_of(frequency_m):
    """Return frequencies between modes, evenly and right beside some of them."""
    step = max(len(frequency_m) // 9, 1)
    beside = [frequency_m[k::step] * (1.0 + sign * 1e-7) for k, sign in ((0, 1.0), (step // 2, -1.0))]
    return np.unique(np.concatenate([np.linspace(0.0, 1.01 * frequency_m[-1], 23), *beside]))


def below(frequency_m, cut_v):
    return (frequency_m[None] < cut_v[:, None]).sum(axis=1)


@pytest.mark.parametrize(("particles", "dimension", "fraction"), [(1024, 2, 0.9), (128, 3, 0.7)])
def test_counts_are_those_of_all_modes_and_certain(rest_scene, particles, dimension, fraction):
    scene = rest_scene(particles, dimension, fraction, 1)
    modes = pm.normal_modes(scene)
    cut = cuts_of(modes.frequency_m)
    found = pm.count_modes(scene, cut)
    assert np.array_equal(found.count_v, below(modes.frequency_m, cut))
    assert found.certain_v.all() and (found.doubt_v < 1.0).all()
    # no mode is nearer than said, and what is said is of use
    near = np.abs(modes.eigenvalue_m[None] - cut[1:, None] ** 2).min(axis=1)
    assert (found.distance_v[1:] <= near).all() and (near < 100.0 * found.distance_v[1:]).all()
    assert (found.available, found.translations) == (modes.available, modes.translations)
    assert (found.negative, found.zero) == (modes.negative, int(modes.zero_m.sum()))
    assert found.memory > 0 and found.at_rest


@pytest.mark.parametrize("strain", ["isotropic", "isochoric", "free"])
@pytest.mark.parametrize("kind", ["exact", "unstressed"])
def test_strains_of_the_box_are_counted_with_the_modes(rest_scene, strain, kind):
    scene = rest_scene(64, 2, 0.9, 1)
    modes = pm.normal_modes(scene, strain=strain, kind=kind)
    cut = cuts_of(modes.frequency_m)
    found = pm.count_modes(scene, cut, strain=strain, kind=kind)
    assert np.array_equal(found.count_v, below(modes.frequency_m, cut)) and found.available == modes.available


def test_chains_of_springs_vibrate_as_the_sine_says():
    """A square crystal is rows and columns of springs 1 between masses 1: omega = 2 |sin(pi j / n)|."""
    rows, columns = 7, 10
    scene = crystal("square", (rows, columns))
    row, column = (2.0 * np.abs(np.sin(np.pi * np.arange(n) / n)) for n in (rows, columns))
    # each of `columns` rows has the modes of `rows` masses, and the other way round; two translations are left out
    expected = np.sort(np.concatenate([np.tile(row, columns), np.tile(column, rows)]))[2:]
    cut = np.linspace(0.01, 2.1, 40)
    found = pm.count_modes(scene, cut)
    assert np.array_equal(found.count_v, below(expected, cut)) and found.certain_v.all()
    # rows that slide as a whole cost nothing
    assert (found.negative, found.zero) == (0, rows + columns - 2)
    assert pm.count_modes(scene, 0.0).count_v.tolist() == [0]


def test_where_a_mode_lies_at_the_frequency_the_count_says_that_it_is_uncertain():
    scene = crystal("triangular", (4, 4))
    found = pm.count_modes(scene, [6.0**0.5, 6.0**0.5 + 1e-6])
    assert found.certain_v.tolist() == [False, True] and found.count_v[1] == found.available == 30
    assert found.distance_v[0] == 0.0 and "1 of them uncertain" in repr(found)


@pytest.mark.parametrize("repeats", [6, 12])
def test_counts_at_a_frequency_of_many_modes_of_a_crystal_are_uncertain(repeats):
    """A square crystal of unit masses and springs has waves of frequency 1 where k along an axis is a third of pi."""
    crystal = pm.lattice_packing("square", repeats=(repeats, repeats))
    scene = pm.Scene(crystal.replace(mass_n=np.ones(repeats**2)), (pm.Repulsion(),))
    found = pm.count_modes(scene, [0.999, 1.0, 1.001])
    assert found.certain_v.tolist() == [True, False, True]
    assert found.count_v[2] - found.count_v[0] == 4 * repeats


def test_unstable_modes_are_below_zero_and_slower_ones_below_minus_their_growth():
    """Rows of a pressed square crystal buckle."""
    scene = crystal("square", (5, 6), overlap=0.03)
    modes = pm.normal_modes(scene)
    assert modes.negative > 5
    cut = np.unique(np.concatenate([0.5 * (modes.frequency_m[1:] + modes.frequency_m[:-1])[::4], [0.0]]))
    found = pm.count_modes(scene, cut)
    certain = found.certain_v
    assert certain.sum() > 8 and found.negative == modes.negative == found.count_v[cut == 0.0][0]
    assert np.array_equal(found.count_v[certain], below(modes.frequency_m, cut)[certain])


def test_far_above_and_far_below_all_modes_are_counted():
    scene = crystal("triangular", (3, 3))
    assert pm.count_modes(scene, [-1e200, 1e200]).count_v.tolist() == [0, 16]
    apart = pm.Packing([[0.5, 0.5], [2.5, 2.5]], [0.5, 0.5], pm.Box.cubic(4.0, 2))
    scene = pm.Scene(apart, SPRINGS)
    assert pm.count_modes(scene, [0.1]).count_v.tolist() == [0]
    kept = pm.count_modes(scene, [0.0, 0.1], rattlers="keep")
    assert (kept.count_v.tolist(), kept.negative, kept.zero) == ([0, 2], 0, 2)


def test_links_walls_held_particles_and_turns_are_counted_as_modes_have_them(linked):
    standing = pm.Packing(
        [[2.0, 0.49], [2.0, 1.49]], [0.5, 0.5], pm.Box.cubic(4.0, 2), pm.Links([0], [1], [[0, 0]], [1.0])
    )
    weight = pm.Gravity(0.0, -0.01 * 4.0 / np.pi)
    ellipses = pm.random_packing(
        40, dimension=2, packing_fraction=0.95, sizes=pm.Bidisperse(ratio=1.4), seed=3, shapes=pm.Ellipses(1.5)
    )
    turning = pm.Scene(ellipses, SPRINGS)
    turning = turning.replace(packing=pm.quench(turning, force_tolerance=1e-11).packing)
    held = pm.Scene(pm.lattice_packing("triangular", repeats=(4, 4)), (*SPRINGS, pm.FixedParticles((0, 5))))
    chains, _ = linked("equilibrium_chain_2d")
    for scene in (pm.Scene(standing, (*SPRINGS, weight, pm.Walls(1, 0.0, 4.0))), turning, held, chains):
        modes = pm.normal_modes(scene)
        cut = 0.5 * (modes.frequency_m[1:] + modes.frequency_m[:-1])
        cut = cut[np.diff(modes.frequency_m) > 1e-6]
        found = pm.count_modes(scene, cut)
        assert np.array_equal(found.count_v, below(modes.frequency_m, cut)) and found.certain_v.all()
        assert found.available == modes.available and found.negative == modes.negative


@pytest.mark.parametrize("name", ["equilibrium_dimer_3d", "jammed_dimer_strain", "equilibrium_trimer_2d"])
@pytest.mark.parametrize("strain", ["none", "free"])
def test_slack_in_links_leaves_no_doubt_even_beside_modes_that_cost_nothing(linked, name, strain):
    scene, _ = linked(name)
    modes = pm.normal_modes(scene, strain=strain)
    cut = np.append(0.0, 0.5 * (modes.frequency_m[1:] + modes.frequency_m[:-1]))
    found = pm.count_modes(scene, cut, strain=strain)
    apart = np.append(1.0, np.diff(modes.frequency_m)) > 1e-6
    assert found.certain_v[apart].all() and found.count_v[0] == modes.negative
    assert np.array_equal(found.count_v[1:][apart[1:]], below(modes.frequency_m, cut[1:])[apart[1:]])


# -- windows -----------------------------------------------------------------------------------------------------------


def orthonormal(modes):
    """Return how far modes are from orthonormal in the mass metric."""
    root = np.sqrt(modes.mass_n)[None, :, None]
    parts = [(one * root).reshape(len(modes), -1) for one in (modes.displacement_mnd, modes.turn_mnk)]
    return float(np.abs(sum(one @ one.T for one in parts) - np.eye(len(modes))).max(initial=0.0))


@pytest.mark.parametrize("method", ["dense", "shift-invert"])
@pytest.mark.parametrize(("particles", "dimension", "fraction"), [(512, 2, 0.9), (200, 3, 0.7)])
def test_a_window_holds_all_modes_between_its_ends(rest_scene, particles, dimension, fraction, method):
    scene = rest_scene(particles, dimension, fraction, 1)
    every = pm.normal_modes(scene)
    middle = 0.5 * (every.frequency_m[1:] + every.frequency_m[:-1])
    for first, last in ((-1, 40), (80, 330), (350, len(every) - 1)):
        low = middle[first] if first >= 0 else 0.0
        high = middle[last] if last < len(middle) else 10.0
        found = pm.normal_modes(scene, between=(low, high), method=method)
        assert (found.below, len(found), found.missed) == (first + 1, last - first, 0) and found.certain
        expected = every.eigenvalue_m[first + 1 : last + 1]
        assert np.abs(found.eigenvalue_m - expected).max() < 1e-13 * every.largest
        assert found.residual < 1e-11 and found.relative_residual < 1e-9 and orthonormal(found) < 1e-12
        assert found.method == method and not found.complete


def test_windows_side_by_side_are_all_modes(rest_scene):
    scene = rest_scene(300, 2, 0.9, 3)
    every = pm.normal_modes(scene)
    cut = np.linspace(0.0, 1.01 * every.frequency_m[-1], 6)
    parts = [pm.normal_modes(scene, between=ends, method="shift-invert") for ends in zip(cut, cut[1:], strict=False)]
    counts = pm.count_modes(scene, cut).count_v
    assert [len(one) for one in parts] == np.diff(counts).tolist()
    assert [one.below for one in parts] == counts[:-1].tolist()
    np.testing.assert_allclose(
        np.concatenate([one.eigenvalue_m for one in parts]), every.eigenvalue_m, atol=1e-13 * every.largest
    )


@pytest.mark.parametrize(("name", "repeats"), [("square", (15, 15)), ("kagome", (8, 8)), ("triangular", (15, 15))])
def test_windows_hold_every_member_of_degenerate_sets(name, repeats):
    scene = crystal(name, repeats)
    every = pm.normal_modes(scene, method="dense")
    for window in ((0.0, 1.53), (0.93, 2.6)):
        found = pm.normal_modes(scene, between=window, method="shift-invert")
        inside = (every.eigenvalue_m >= (window[0] ** 2 or -1e-9)) & (every.eigenvalue_m < window[1] ** 2)
        assert len(found) == inside.sum() > 100 and found.missed == 0
        assert np.abs(found.eigenvalue_m - every.eigenvalue_m[inside]).max() < 1e-12 * every.largest
        assert orthonormal(found) < 1e-12


def test_slices_of_a_window_are_one_window(rest_scene, monkeypatch):
    scene = rest_scene(512, 2, 0.9, 1)
    whole = pm.normal_modes(scene, between=(0.2, 0.5))
    monkeypatch.setattr(modes_module, "_SLICE", 17)
    sliced = pm.normal_modes(scene, between=(0.2, 0.5))
    assert len(whole) == len(sliced) > 50 and sliced.missed == 0 and sliced.certain
    assert np.abs(whole.eigenvalue_m - sliced.eigenvalue_m).max() < 1e-14 * whole.largest
    assert orthonormal(sliced) < 1e-13


@pytest.mark.parametrize("strain", ["none", "free"])
def test_windows_of_links_and_of_boxes_that_strain(strain):
    packing = pm.lattice_packing("triangular", repeats=(14, 14), relative_overlap=0.03)
    shake = 0.01 * np.random.default_rng(0).normal(size=packing.position_nd.shape)
    packing = packing.replace(position_nd=packing.position_nd + shake)
    contacts = pm.find_contacts(packing)
    chosen = np.flatnonzero((contacts.i_c % 2 == 0) & (contacts.j_c == contacts.i_c + 1))
    links = pm.Links(contacts.i_c[chosen], contacts.j_c[chosen], contacts.image_cd[chosen], contacts.distance_c[chosen])
    scene = pm.Scene(packing.replace(links=links), SPRINGS)
    every = pm.normal_modes(scene, strain=strain)
    found = pm.normal_modes(scene, between=(1.0, 1.5), strain=strain, method="shift-invert")
    inside = (every.frequency_m >= 1.0) & (every.frequency_m < 1.5)
    assert len(found) == inside.sum() > 20 and found.missed == 0
    assert np.abs(found.eigenvalue_m - every.eigenvalue_m[inside]).max() < 1e-11 * every.largest
    assert found.residual < 1e-11


def test_empty_windows_hold_nothing():
    scene = crystal("triangular", (12, 12))
    for method in ("dense", "shift-invert"):
        found = pm.normal_modes(scene, between=(3.0, 4.0), method=method)
        assert len(found) == 0 and found.below == found.available == 2 * 144 - 2 and found.missed == 0


def test_soft_spots_are_of_the_lowest_modes():
    modes = pm.normal_modes(crystal("triangular", (6, 6)), between=(1.1, 3.0))
    with pytest.raises(ValueError, match="modes must begin with the lowest, got a window with"):
        pm.soft_spots(modes)


@pytest.mark.slow
def test_five_hundred_modes_of_a_hundred_thousand_discs_come_complete():
    start = pm.random_packing(
        4096, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.84, seed=1
    )  # fmt: skip
    run = pm.jam(pm.Scene(start, SPRINGS), pressure=1e-4, strain="free", force_tolerance=1e-12, check=False)
    scene = pm.Scene(run.packing.repeated((5, 5)), SPRINGS)
    few, many = pm.count_modes(scene, [0.05, 0.055], signs=False).count_v
    high = 0.05 + 0.005 * 500 / (many - few)
    found = pm.normal_modes(scene, between=(0.05, high))
    assert 400 < len(found) < 600 and found.missed == 0 and found.certain
    assert found.residual < 1e-10 and orthonormal(found) < 1e-12


# -- states of copies --------------------------------------------------------------------------------------------------


def rest(particles, dimension, seed):
    start = pm.random_packing(
        particles, dimension=dimension, sizes=pm.Bidisperse(ratio=1.4),
        packing_fraction=0.8 if dimension == 2 else 0.6, seed=seed,
    )  # fmt: skip
    run = pm.jam(pm.Scene(start, SPRINGS), pressure=1e-2, strain="free", force_tolerance=1e-12)
    return pm.Scene(run.packing, SPRINGS)


@pytest.mark.parametrize(("dimension", "repeats"), [(2, (4, 3)), (2, (1, 2)), (3, (2, 1, 3))])
def test_states_over_a_grid_of_waves_are_those_of_the_copies(dimension, repeats):
    scene = rest(20, dimension, 1)
    many = scene.replace(packing=scene.packing.repeated(repeats))
    states = pm.density_of_states(many, 30)
    found = pm.density_of_states(scene, states.edge_b, repeats=repeats)
    assert np.array_equal(found.count_b, states.count_b) and found.modes == states.modes == states.count_b.sum()
    assert found.uncertain == states.uncertain == 0
    same = pm.density_of_states(scene, 30, repeats=repeats)
    assert same.edge_b == pytest.approx(states.edge_b, rel=1e-9) and same.count_b.sum() == same.modes


def test_states_of_large_cells_are_counted_by_inertia(monkeypatch):
    scene = rest(20, 2, 1)
    edge = np.linspace(0.0, 2.5, 12)
    wanted = pm.density_of_states(scene, edge, repeats=(3, 2))
    monkeypatch.setattr(state_density, "DENSE_ROWS", 4)
    found = pm.density_of_states(scene, edge, repeats=(3, 2))
    assert np.array_equal(found.count_b, wanted.count_b) and found.modes == wanted.modes
    assert found.uncertain == 0 and len(pm.density_of_states(scene, 5, repeats=(2, 2)).count_b) == 5


def test_one_particle_has_the_states_of_its_crystal():
    """A triangular crystal of springs has no mode above the root of 6, and d N - d of them."""
    cell = crystal("triangular", (1, 1))
    found = pm.density_of_states(cell, [0.0, 1.0, 2.0, 2.45], repeats=(9, 12))
    whole = pm.density_of_states(crystal("triangular", (9, 12)), found.edge_b)
    assert np.array_equal(found.count_b, whole.count_b) and found.count_b.sum() == found.modes == 2 * 108 - 2


def test_copies_of_what_rattles_have_no_states():
    apart = pm.Scene(pm.Packing([[0.5, 0.5]], [0.3], pm.Box.cubic(4.0, 2)), SPRINGS)
    assert pm.density_of_states(apart, 4, repeats=(2, 2)).modes == 0


def test_states_say_where_an_edge_lies_on_a_mode():
    scene = crystal("triangular", (4, 4))
    for repeats in (None, (1, 1)):
        assert pm.density_of_states(scene, [0.1, 6.0**0.5, 3.0], repeats=repeats).uncertain == 1


SCENE = crystal("triangular", (3, 3))
CHAINS = pm.Scene(pm.chain_packing(2, 4, dimension=2, packing_fraction=0.3, seed=1), SPRINGS)


@pytest.mark.parametrize(
    ("call", "error", "text"),
    [
        (lambda: pm.count_modes(SCENE.packing, 1.0), TypeError, "scene must be a Scene"),
        (lambda: pm.count_modes(SCENE, np.nan), ValueError, "below must be finite, got nan"),
        (lambda: pm.count_modes(SCENE, [[1.0]]), ValueError, "below must have shape"),
        (lambda: pm.count_modes(SCENE, 1.0, signs=2), TypeError, "signs must be True or False, got 2"),
        (
            lambda: pm.count_modes(SCENE.replace(effects=(*SPRINGS, pm.Friction(0.3, stiffness=1.0))), 1.0),
            ValueError,
            "pm.frictional_modes",
        ),
        (lambda: pm.normal_modes(SCENE, between=(2.0, 1.0)), ValueError, "between must be a lower and a higher freq"),
        (lambda: pm.normal_modes(SCENE, between=(1.0,)), ValueError, "between must have shape"),
        (lambda: pm.normal_modes(SCENE, 3, between=(1.0, 2.0)), ValueError, "count must be left out where a window"),
        (
            lambda: pm.density_of_states(SCENE, repeats=(2, 0)),
            ValueError,
            r"repeats must be 1 or more along each direction, got \[2, 0\]",
        ),
        (lambda: pm.density_of_states(SCENE, repeats=(2,)), ValueError, "repeats must have shape"),
        (lambda: pm.density_of_states(CHAINS, repeats=(2, 2)), ValueError, "scene must be without rigid links"),
        (
            lambda: pm.density_of_states(pm.normal_modes(SCENE), repeats=(2, 2)),
            ValueError,
            "repeats must be left out for modes",
        ),
    ],
)
def test_bad_input_gets_one_clear_error(call, error, text):
    with pytest.raises(error, match=text):
        call()


def test_more_copies_than_memory_holds_are_refused_before_any_work():
    with pytest.raises(ValueError, match="repeats must be so small that memory holds it"):
        pm.density_of_states(rest(20, 2, 1), 30, repeats=(10**6, 10**6))


def test_numbers_of_unstable_and_zero_modes_say_how_sure_they_are():
    found = pm.count_modes(rest(20, 2, 1), 1.0)
    assert found.signs_certain is True
    assert pm.count_modes(rest(20, 2, 1), 1.0, signs=False).signs_certain is None


def test_counts_of_what_is_not_at_rest_warn_of_the_rattlers_that_are_left_out():
    scene = pm.Scene(pm.random_packing(40, dimension=2, packing_fraction=0.85, seed=1), (pm.Repulsion(),))
    with pytest.warns(UserWarning, match="of 40 particles count as rattlers"):
        pm.count_modes(scene, 0.1)
