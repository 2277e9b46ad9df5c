"""Facts about jamming a packing that is jammed already: it is followed from where it stands."""

import functools

import numpy as np
import pytest

import packmech as pm


def network(packing):
    """Return the pairs that touch, rattlers left out."""
    contacts, rattling = pm.find_contacts(packing, gap_tolerance=0.0), pm.find_rattlers(packing)
    kept = ~(rattling[contacts.i_c] | rattling[contacts.j_c])
    return set(zip(contacts.i_c[kept].tolist(), contacts.j_c[kept].tolist(), strict=True))


def jammed(seed, strain, method=None):
    drawn = pm.random_packing(64, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.8, seed=seed)
    return pm.jam(pm.Scene(drawn, (pm.Repulsion(),)), pressure=1e-6, strain=strain, method=method)


@pytest.mark.parametrize("strain", ["isotropic", "free"])
@pytest.mark.parametrize("seed", range(4))
def test_a_jammed_packing_keeps_its_network_and_its_jamming_packing_fraction(seed, strain):
    first = jammed(seed, strain)
    again = pm.jam(pm.Scene(first.packing, (pm.Repulsion(),)), pressure=1e-6, strain=strain)
    assert (first.report["start"], again.report["start"]) == ("fresh", "continued")
    assert network(again.packing) == network(first.packing)
    assert np.isclose(
        again.report["jamming_packing_fraction"], first.report["jamming_packing_fraction"], rtol=1e-12, atol=0.0
    )


@pytest.mark.parametrize("strain", ["isotropic", "free"])
@pytest.mark.parametrize("pressure", [1e-4, 2e-4, 1e-3])
def test_a_packing_under_pressure_keeps_its_network_at_this_pressure(pressure, strain):
    for seed in range(3):
        first = jammed(seed, strain)
        scene = pm.Scene(first.packing, (pm.Repulsion(),))
        pressed = pm.sweep_pressure(scene, [pressure], strain=strain)[0]
        again = pm.jam(scene.replace(packing=pressed.packing), pressure=pressure, strain=strain)
        assert again.report["start"] == "continued"
        assert network(again.packing) == network(pressed.packing)
        assert np.isclose(again.report["packing_fraction"], pressed.report["packing_fraction"], rtol=1e-9, atol=0.0)


@pytest.mark.parametrize(
    "method", [pm.ProgramChain(), pm.Decompression(), pm.StepHalving()], ids=lambda m: type(m).__name__
)
def test_every_method_follows(method):
    first = jammed(1, "isotropic")
    given = {} if isinstance(method, pm.StepHalving) else {"pressure": 1e-6}
    again = pm.jam(pm.Scene(first.packing, (pm.Repulsion(),)), strain="isotropic", method=method, **given)
    assert again.report["start"] == "continued"
    assert network(again.packing) == network(first.packing)
    assert abs(again.report["jamming_packing_fraction"] - first.report["jamming_packing_fraction"]) < 1e-6


def test_a_packing_out_of_balance_or_one_that_is_asked_to_starts_anew():
    first = jammed(1, "isotropic")
    scene = pm.Scene(first.packing, (pm.Repulsion(),))
    fresh = pm.jam(scene, pressure=1e-6, strain="isotropic", start="fresh")
    moved = first.packing.position_nd + 0.01 * np.random.default_rng(1).normal(size=(64, 2))
    shaken = pm.jam(scene.replace(packing=first.packing.replace(position_nd=moved)), pressure=1e-6, strain="isotropic")
    assert fresh.report["start"] == shaken.report["start"] == "fresh"
    assert network(fresh.packing) != network(first.packing)
    with pytest.raises(ValueError, match="start must be one of"):
        pm.jam(scene, start="again")


# -- going on at the same pressure, and at 1.01 times it


def drawn(family, seed):
    """Return a random start of a family with the law that presses it."""
    sizes, two = pm.Bidisperse(ratio=1.4), seed % 3 < 2
    round_one = family in ("discs", "spheres")
    effects = (pm.Repulsion(law=pm.Hertz() if round_one and seed % 8 == 7 else pm.Harmonic()),)
    if family == "discs":
        packing = pm.random_packing(32, dimension=2, sizes=sizes, packing_fraction=0.8, seed=seed)
    elif family == "spheres":
        packing = pm.random_packing(32, dimension=3, sizes=sizes, packing_fraction=0.6, seed=seed)
    elif family == "ellipses":
        shapes = pm.Ellipses((1.1, 1.5, 2.5)[seed % 3])
        packing = pm.random_packing(24, dimension=2, sizes=sizes, packing_fraction=0.5, seed=seed, shapes=shapes)
    elif family == "spheroids":
        shapes = pm.Ellipses((0.7, 1.3, 2.0)[seed % 3])
        packing = pm.random_packing(14, dimension=3, sizes=sizes, packing_fraction=0.4, seed=seed, shapes=shapes)
    elif family == "bodies":
        number, shapes = (16, 2) if two else (10, 3), (pm.Dimer(), pm.LinearCluster(3))[seed // 3 % 2]
        packing = pm.random_packing(
            number[0], dimension=number[1], sizes=sizes, packing_fraction=0.4, seed=seed, shapes=shapes
        )
    elif family == "links":
        shape = (pm.Dimer(), pm.Trimer(), pm.LinearCluster(4))[seed % 3 if two else seed // 3 % 2]
        packing = pm.cluster_packing(
            12 if two else 8, shape, dimension=2 if two else 3, packing_fraction=0.3, seed=seed
        )
    else:
        effects = (pm.Repulsion(), pm.Friction((0.1, 0.5)[seed // 2 % 2]), pm.ContactDamping(0.3))
        packing = pm.random_packing(14, dimension=2, sizes=sizes, packing_fraction=0.75, seed=seed)
    return pm.Scene(packing, effects)


def asked(family, seed):
    """Return pressure and free strains of a packing of a family."""
    pressures = (1e-3, 1e-2) if family == "friction" else (1e-6, 1e-4, 1e-2)
    return {"pressure": pressures[seed // 2 % len(pressures)], "strain": ("isotropic", "free")[seed // 3 % 2]}


@functools.cache
def at_pressure(family, seed):
    """Return the scene of a packing jammed at its pressure."""
    scene = drawn(family, seed)
    return scene.replace(packing=pm.jam(scene, **asked(family, seed)).packing)


def contacts_of(packing):
    """Return the pairs that overlap."""
    if packing.shapes.has_orientations:
        return pm.find_shape_contacts(packing, gap_tolerance=0.0)
    return pm.find_contacts(packing, gap_tolerance=0.0)


def touching(packing):
    """Return the touching pairs, of bodies those of their beads, by name, and their overlaps."""
    columns, contacts = ["i_c", "j_c", "image_cd"], contacts_of(packing)
    if packing.shapes.has_orientations:
        columns += ["site_i_c", "site_j_c"]
    named = np.column_stack([getattr(contacts, name) for name in columns])
    return [tuple(row) for row in named.tolist()], contacts.contact_distance_c - contacts.distance_c


def overlap_changes(scene, pressure, more, strain):
    """Return how the overlaps change, to first order, where the pressure grows: from Hessian, links and slopes."""
    packing, d = scene.packing, scene.packing.dimension
    per_volume = scene.pressure_unit * packing.box.volume
    matrix = pm.hessian(scene, strain="free").toarray()
    rows = pm.rigidity_matrix(packing, strain="free", contacts=contacts_of(packing)).toarray()
    trace = np.r_[np.ones(d), np.zeros(d * (d - 1) // 2)]
    size, strains = len(matrix), len(trace)
    # what the pressure adds to the curvature where strains change the volume
    matrix[-strains:, -strains:] += pressure * per_volume * (np.outer(trace, trace) - np.eye(strains))
    push = np.r_[np.zeros(size - strains), more * per_volume * trace]
    free = np.eye(size)
    if strain == "isotropic":
        free = np.column_stack([free[:, : size - strains], np.r_[np.zeros(size - strains), trace]])
    if packing.links:
        held = pm.constraint_jacobian(packing, strain="free").toarray().T @ free
        _, value, right = np.linalg.svd(held)
        rank = int((value > 1e-9 * value[0]).sum())
        free = free @ right[rank:].T
    value, vector = np.linalg.eigh(free.T @ matrix @ free)
    stiff = value > 1e-11 * value[-1]
    moved = -(vector[:, stiff] / value[stiff]) @ (vector[:, stiff].T @ (free.T @ push))
    return -rows @ (free @ moved)


def check_same(family, seed):
    """Check that a packing jammed again at its pressure stays, and that its report says so."""
    scene = at_pressure(family, seed)
    again = pm.jam(scene, **asked(family, seed))
    assert again.report["start"] == "continued"
    assert abs(pm.packing_fraction(again.packing) - pm.packing_fraction(scene.packing)) < 1e-9
    assert touching(again.packing)[0] == touching(scene.packing)[0]


def check_response(family, seed):
    """Check that at 1.01 times the pressure contacts stay that would with twice the change of linear response."""
    scene, wanted = at_pressure(family, seed), asked(family, seed)
    pressure = wanted["pressure"]
    pressed = pm.jam(scene, pressure=1.01 * pressure, strain=wanted["strain"])
    assert pressed.report["start"] == "continued"
    names, overlap_c = touching(scene.packing)
    change_c = overlap_changes(scene, pressure, 0.01 * pressure, wanted["strain"])
    # contacts with less force than the forces are in balance bear nothing
    kept_c = (overlap_c + 2.0 * change_c > 0.0) & (overlap_c > 1e-5 * overlap_c.mean())
    kept = {names[c] for c in np.flatnonzero(kept_c)}
    assert len(kept) > 0.9 * len(names)
    assert kept <= set(touching(pressed.packing)[0])


# 200 packings, those of friction pressed in time
COUNTS = {"discs": 36, "spheres": 24, "ellipses": 48, "spheroids": 20, "bodies": 32, "links": 30, "friction": 10}
# of each family some of those that rearranged when they were compressed and decompressed again
CHOSEN = [("discs", 2), ("spheres", 1), ("ellipses", 3), ("spheroids", 0), ("bodies", 0), ("bodies", 2), ("links", 2)]


@pytest.mark.parametrize(("family", "seed"), CHOSEN)
def test_a_packing_jammed_again_at_its_own_pressure_stays_as_it_is(family, seed):
    check_same(family, seed)


def test_ellipses_jammed_again_at_their_pressure_are_the_same_packing_to_the_last_bit():
    """They had been compressed to 1e-3 and decompressed again: the packing fraction rose by 8.2e-3."""
    packing = pm.random_packing(
        48, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.5, seed=4, shapes=pm.Ellipses(1.1)
    )
    scene = pm.Scene(packing, (pm.Repulsion(),))
    first = pm.jam(scene, pressure=1e-6)
    again = pm.jam(scene.replace(packing=first.packing), pressure=1e-6)
    assert again.packing == first.packing
    onset, before = (run.report["jamming_packing_fraction"] for run in (again, first))
    assert abs(onset - before) < 1e-8


def test_a_packing_whose_contacts_change_when_its_shear_stress_is_set_free_is_not_called_continued():
    first = jammed(2, "isotropic")
    run = pm.jam(pm.Scene(first.packing, (pm.Repulsion(),)), pressure=1e-6, strain="free")
    assert first.report["stress_anisotropy"] > 1e-2 and run.report["stress_anisotropy"] < 1e-7
    assert run.report["contacts_closed"] > 0 and run.report["start"] == "rearranged"


def test_linked_packings_shear_stabilized_at_their_own_pressure_stay():
    scene = at_pressure("links", 3)
    pressure = asked("links", 3)["pressure"]
    free = pm.shear_stabilize(scene, pressure=pressure)
    again = pm.shear_stabilize(scene.replace(packing=free.packing), pressure=pressure)
    assert again.packing == free.packing


def test_compression_to_its_own_distance_gives_a_packing_of_ellipses_back():
    scene, settings = at_pressure("ellipses", 4), asked("ellipses", 4)
    (low,) = pm.sweep_pressure(scene, [1e-4], strain=settings["strain"])
    scene = scene.replace(packing=low.packing)
    onset = pm.compress(scene, [1e-6], strain=settings["strain"])[0].report["onset"]
    (run,) = pm.compress(scene, [pm.packing_fraction(low.packing) - onset], strain=settings["strain"])
    assert run.report["onset_rearrangements"] == run.report["rearrangements"] == 0
    assert abs(run.report["pressure"] - 1e-4) < 1e-4 * 1e-6
    assert set(touching(run.packing)[0]) == set(touching(low.packing)[0])


def test_a_frictional_packing_pressed_again_at_its_pressure_is_left_alone():
    scene = at_pressure("friction", 0)
    again = pm.jam(scene, **asked("friction", 0))
    assert again.report["start"] == "continued" and again.steps == 0
    assert again.packing == scene.packing


@pytest.mark.parametrize(("family", "seed"), CHOSEN)
def test_contacts_that_linear_response_keeps_stay_at_a_hundredth_more_pressure(family, seed):
    check_response(family, seed)


@pytest.mark.slow
@pytest.mark.parametrize("family", COUNTS)
def test_two_hundred_packings_stay_at_their_pressure_and_keep_contacts_at_a_hundredth_more(family):
    for seed in range(COUNTS[family]):
        check_same(family, seed)
        if family != "friction":
            check_response(family, seed)
