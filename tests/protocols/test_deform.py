"""Components of strain and stress of a box set one by one, against calls that set them together and against moduli."""

import functools

import numpy as np
import pytest

import packmech as pm


@functools.cache
def soft(dimension=2, particles=48, seed=3, law=None):
    sizes = pm.Bidisperse(ratio=1.4)
    fraction = {2: 0.85, 3: 0.66}[dimension]
    start = pm.random_packing(particles, dimension=dimension, sizes=sizes, packing_fraction=fraction, seed=seed)
    scene = pm.Scene(start, (pm.Repulsion(law or pm.Harmonic()),))
    return scene.replace(packing=pm.jam(scene, pressure=1e-2).packing)


@functools.cache
def rough(pressure=1e-2):
    start = pm.random_packing(64, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.8, seed=1)
    effects = (pm.Repulsion(pm.LinearSpring()), pm.ContactDamping(0.5), pm.Friction(0.5, damping=0.1))
    pressed = pm.jam(pm.Scene(start, effects), pressure=pressure, method=pm.Press(rate=1e-3))
    return pm.Scene(pressed.packing, effects)


def test_a_shear_alone_is_quasistatic_shear():
    run = pm.deform(soft(), strain={"xy": 3e-3}, steps=3)
    other = pm.quasistatic_shear(soft(), 3e-3, step=1e-3, locate="none")
    assert run.stress_tdd[:, 0, 1] == pytest.approx(other.shear_stress_t * soft().pressure_unit, abs=1e-12)
    assert run.strain_tdd[:, 0, 1] == pytest.approx(other.strain_t, abs=1e-15)
    assert run.packing_fraction_t == pytest.approx(other.packing_fraction_t, rel=1e-13)


@pytest.mark.parametrize("dimension", [2, 3])
def test_stresses_that_are_all_held_are_those_of_sweep_stress(dimension):
    scene = soft(dimension)
    asked = 1.05 * pm.stress_tensor(scene)
    asked[0, 1] = asked[1, 0] = 2e-4
    (other,) = pm.sweep_stress(scene, [asked / scene.pressure_unit])
    # strains of the other call are symmetric: its box turns, and the stress with it
    turn, _ = np.linalg.qr(other.packing.box.lattice_dd @ scene.packing.box.inverse_dd)
    turn *= np.sign(np.diag(turn))
    turned = turn.T @ asked @ turn
    names = {"xx": (0, 0), "yy": (1, 1), "zz": (2, 2), "xy": (0, 1), "xz": (0, 2), "yz": (1, 2)}
    run = pm.deform(scene, stress={name: float(turned[at]) for name, at in names.items() if max(at) < dimension})
    assert run.stress_tdd[-1] == pytest.approx(turned, abs=1e-9 * abs(asked[0, 0]))
    metric = [one.box.lattice_dd.T @ one.box.lattice_dd for one in (run.packing, other.packing)]
    assert metric[0] == pytest.approx(metric[1], rel=1e-8, abs=1e-8)


@pytest.mark.parametrize("dimension", [2, 3])
def test_small_strains_beside_a_held_stress_have_the_moduli_of_the_packing(dimension):
    scene, size = soft(dimension), 1e-7
    stress = pm.stress_tensor(scene)
    stiff = pm.elastic_moduli(scene).cauchy[:2, :2]
    run = pm.deform(scene, strain={"yy": size}, stress={"xx": float(stress[0, 0])}, steps=1)
    sideways = -stiff[0, 1] / stiff[0, 0]
    assert run.strain_tdd[-1, 0, 0] == pytest.approx(sideways * size, rel=1e-5)
    young = stiff[1, 1] + stiff[1, 0] * sideways
    assert run.stress_tdd[-1, 1, 1] - stress[1, 1] == pytest.approx(young * size, rel=1e-5)


def test_the_work_of_all_stresses_is_the_energy_to_second_order_of_the_step():
    scene, left = soft(), []
    held = {"xx": float(pm.stress_tensor(scene)[0, 0]), "xy": 0.0}
    for steps in (2, 4):
        run = pm.deform(scene, strain={"yy": -2e-4}, stress=held, steps=steps)
        assert run.rearrangements == 0
        volume = scene.packing.box.volume * np.exp(np.trace(run.strain_tdd, axis1=1, axis2=2))
        force = volume[:, None, None] * run.stress_tdd
        work = float((0.5 * (force[1:] + force[:-1]) * np.diff(run.strain_tdd, axis=0)).sum())
        energy = [pm.contact_forces(one).energy for one in (scene, scene.replace(packing=run.packing))]
        left.append(work - energy[1] + energy[0])
        assert abs(left[-1]) < 1e-3 * abs(work)
    assert left[0] / left[1] == pytest.approx(4.0, abs=0.4)


@pytest.mark.parametrize("dimension", [2, 3])
def test_strains_on_the_diagonal_are_logarithms_of_lengths(dimension):
    scene = soft(dimension)
    run = pm.deform(scene, strain={"yy": -0.01}, stress={"xx": -1.2e-2}, steps=2)
    before, after = (np.log(np.diag(one.box.lattice_dd)) for one in (scene.packing, run.packing))
    grown = np.zeros(dimension)
    grown[:2] = run.strain_tdd[-1, 0, 0], -0.01
    # the lattice is renewed at the end, which a box this square does not feel
    assert after - before == pytest.approx(grown, abs=1e-12)
    assert run.stress_tdd[:, 0, 0] == pytest.approx(-1.2e-2, rel=1e-8)


def test_the_repr_says_first_which_component_was_loaded_and_how_far():
    scene = soft(3)
    held = {name: float(pm.stress_tensor(scene)[at, at]) for at, name in ((0, "xx"), (1, "yy"))}
    run = pm.deform(scene, strain={"zz": -2e-4, "xy": 1e-4}, stress=held, steps=1)
    stress = run.stress_tdd[-1, 2, 2]
    assert run.loaded_component == "zz"
    words = f"loaded: zz strain -0.0002, stress {stress:.6g} [1], [energy/length^3]; a strain of -0.0002 was asked for"
    assert repr(run).splitlines()[1].split() == words.split()
    assert pm.deform(scene, stress=held).loaded_component is None


def test_in_time_slow_strains_lead_where_those_at_rest_do():
    bare = soft()
    scene = bare.replace(effects=(*bare.effects, pm.ContactDamping(0.5)))
    asked = {"strain": {"yy": -1e-3}, "stress": {"xx": float(pm.stress_tensor(bare)[0, 0])}}
    still = pm.deform(bare, steps=4, **asked)
    off = []
    for rate in (4e-6, 2e-6):
        run = pm.deform_at_rate(scene, rate=rate, **asked)
        assert run.strain_tdd[-1, 1, 1] == pytest.approx(-1e-3, rel=1e-12)
        assert np.log(run.packing.box.lattice_dd[1, 1] / bare.packing.box.lattice_dd[1, 1]) == pytest.approx(-1e-3)
        off.append(run.stress_tdd[-1, 1, 1] - still.stress_tdd[-1, 1, 1])
        assert run.strain_tdd[-1, 0, 0] == pytest.approx(still.strain_tdd[-1, 0, 0], rel=0.05)
    # only what is at rest says how well its forces balance
    assert [any(name == "force residual" for name, *_ in one.rows()) for one in (still, run)] == [True, False]
    grown = still.stress_tdd[-1, 1, 1] - still.stress_tdd[0, 1, 1]
    assert abs(off[1]) < 0.6 * abs(off[0]) < 0.05 * abs(grown)


def test_friction_bears_shear_while_stresses_are_held():
    scene = rough()
    pressure = -float(pm.stress_tensor(scene)[0, 0])
    run = pm.deform_at_rate(scene, rate=1e-4, strain={"yy": -0.05}, stress={"xx": -pressure})
    assert run.stress_tdd[:, 0, 0].mean() == pytest.approx(-pressure, rel=0.02)
    assert run.strain_tdd[-1] == pytest.approx(np.diag([run.strain_tdd[-1, 0, 0], -0.05]), abs=1e-12)
    (sxx, sxy), (_, syy) = 0.5 * (run.stress_tdd[-1] + run.stress_tdd[-1].T)
    assert np.degrees(run.friction_angle_t[-1]) > 8.0
    assert np.sin(run.friction_angle_t[-1]) == pytest.approx(np.hypot(0.5 * (sxx - syy), sxy) / (-0.5 * (sxx + syy)))
    again = pm.deform_at_rate(scene, rate=1e-4, strain={"yy": -0.05}, stress={"xx": -pressure})
    assert (again.stress_tdd == run.stress_tdd).all() and (again.strain_tdd == run.strain_tdd).all()
    assert {"strain_yy", "stress_xx", "packing_fraction"} <= set(run.table().columns)


def test_a_stress_that_is_not_held_is_said():
    scene = rough()
    run = pm.deform_at_rate(
        scene, rate=1e-4, strain={"yy": -0.01}, stress={"xx": -1e-2}, stress_tolerance=1e-6, check=False
    )
    assert run.outcome is pm.Outcome.NOT_AT_PRESSURE
    assert [one.name for one in run.unmet] == ["missing stress xx"]


def test_a_loose_start_shrinks_to_the_stresses_and_no_further():
    start = pm.random_packing(60, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.6, seed=2)
    effects = (pm.Repulsion(pm.LinearSpring()), pm.ContactDamping(0.5), pm.Friction(0.5, damping=0.1))
    asked = {"strain": {"xy": 0.01}, "stress": {"xx": -1e-2, "yy": -1e-2}}
    run = pm.deform_at_rate(pm.Scene(start, effects), rate=1e-4, stress_tolerance=0.1, **asked)
    assert (np.abs(run.stress_tdd[:, 0, 0] / -1e-2 - 1.0) < 0.5).all()
    assert 0.78 < run.packing_fraction_t[-1] < 0.9


def test_units_are_of_no_matter():
    found = []
    for energy, length in ((1.0, 1.0), (3e-7, 2.5e-3)):
        packing = soft().packing
        packing = packing.replace(
            position_nd=length * packing.position_nd,
            radius_n=length * packing.radius_n,
            box=pm.Box(length * packing.box.lattice_dd),
        )
        scene = pm.Scene(packing, (pm.Repulsion(pm.Harmonic(energy)),))
        run = pm.deform(scene, strain={"yy": -1e-3}, stress={"xx": -1.1e-2 * scene.pressure_unit}, steps=2)
        found.append((*run.strain_tdd[-1].ravel(), *(run.stress_tdd[-1] / scene.pressure_unit).ravel()))
    assert found[0] == pytest.approx(found[1], rel=1e-8, abs=1e-12)


def test_a_box_that_grows_until_nothing_touches_is_unjammed():
    run = pm.deform(soft(), strain={"xx": 0.05, "yy": 0.05}, steps=5)
    assert run.outcome is pm.Outcome.UNJAMMED and run.stress_tdd[-1] == pytest.approx(np.zeros((2, 2)), abs=1e-8)


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"strain": {"yx": 0.1}}, "strain must name components among xx, xy, yy, got 'yx'; it is 'xy' here"),
        ({"strain": {"zz": 0.1}}, "strain must name components among xx, xy, yy, got 'zz'"),
        ({"strain": {"xx": 0.1}, "stress": {"xx": -0.1}}, "stress must name no component whose strain is given"),
        ({"strain": {"xx": "a"}}, r"strain\['xx'\] must be a finite number"),
        ({"strain": -0.1}, "strain must be a mapping of components such as"),
        ({"stress": {"xx": 1e-2}}, "stress must be below 0 for 'xx' where particles only push, .*, got 0.01"),
        ({"stress": {"yy": 0.0}}, "stress must be below 0 for 'yy'"),
        ({"strain": {}}, "strain must name a component that is not 0"),
        ({"stress": {"xx": float("nan")}}, r"stress\['xx'\] must be a finite number"),
        ({"strain": {"xx": 0.01}, "steps": 0}, "steps must be an integer at least 1"),
    ],
)
def test_what_cannot_be_asked_of_a_box_is_refused_by_name(given, message):
    with pytest.raises((TypeError, ValueError), match=message):
        pm.deform(soft(), **given)


@pytest.mark.slow
def test_failure_of_compressed_grains_is_that_of_the_same_grains_sheared_directly():
    """The ratio of stresses that grains fail at under constant lateral pressure, from direct shear, by two criteria.

    Mohr and Coulomb: (1 + sin a) / (1 - sin a), where tan a is the shear stress over the normal one on the plane that
    is sheared. Matsuoka and Nakai, who know the middle stress: I_1 I_2 / I_3 is the same.
    """
    start = pm.random_packing(1000, dimension=3, sizes=pm.Bidisperse(ratio=1.2), packing_fraction=0.5, seed=1)
    effects = (pm.Repulsion(pm.LinearSpring()), pm.ContactDamping(0.5), pm.Friction(0.5, 2.0 / 7.0, damping=0.1))
    pressed = pm.jam(pm.Scene(start, effects), pressure=1e-3, method=pm.Press(rate=1e-3))
    scene = pm.Scene(pressed.packing, effects)
    p = -float(np.trace(pm.stress_tensor(scene))) / 3.0
    squeezed = pm.deform_at_rate(scene, rate=1e-4, strain={"zz": -0.3}, stress={"xx": -p, "yy": -p}, ledger=True)
    sheared = pm.deform_at_rate(
        scene, rate=1e-4, strain={"xz": 0.6}, stress={"zz": -p, "xx": -p, "yy": -p}, ledger=True
    )
    stresses = []
    for run in (squeezed, sheared):
        assert run.ledger.closed and run.ledger.residual < 1e-10
        stresses.append(-run.stress_tdd[len(run.stress_tdd) // 2 :].mean(axis=0))
    low, middle, high = np.transpose([np.linalg.eigvalsh(0.5 * (one + one.T)) for one in stresses])
    sine = np.sin(np.arctan(abs(stresses[1][0, 2]) / stresses[1][2, 2]))
    assert high[0] / low[0] == pytest.approx((1.0 + sine) / (1.0 - sine), rel=0.1)
    # from 9, where all three are equal
    over = (low + middle + high) * (low * middle + middle * high + high * low) / (low * middle * high) - 9.0
    assert over[0] == pytest.approx(over[1], rel=0.1)
