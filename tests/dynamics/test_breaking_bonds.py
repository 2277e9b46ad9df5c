"""Facts about bonds that break: at which load, with which sign, what becomes of the pair and of the energy."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest

import packmech as pm
from packmech.dynamics.simulation import KIND
from packmech.effects import pair_energy
from packmech.effects.partners import partners_of
from packmech.loop.checkpoint import read_checkpoint, write_checkpoint
from packmech.scene import scene_after

K, SHEAR_K, SPEED, DT = 2.0, 0.5, 0.1, 0.01


def pair_scene(limits, velocity, *, stiffness=K, tangential=0.0):
    """Return a bond along x between a disc that is held and one that is moved at this velocity."""
    packing = pm.Packing([[2.0, 3.0], [3.0, 3.0]], [0.5, 0.5], pm.Box.cubic(6.0, 2))
    spring = pm.LinearSpring(stiffness)
    bond = pm.Bonds([0], [1], [[0, 0]], [1.0], spring, spring, tangential_stiffness=tangential, breaks_at=limits)
    moved = pm.FixedParticles((0,)), pm.FixedParticles((1,), velocity=velocity)
    return pm.Scene(packing, (pm.Repulsion(pm.LinearSpring(1e-3)), bond, *moved))


# -- one bond at a given rate ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("mode", "limit", "velocity", "elongation"),
    [
        ("tension", 0.06, (SPEED, 0.0), 0.03),
        ("stretch", 0.03, (SPEED, 0.0), 0.03),
        ("compression", 0.06, (-SPEED, 0.0), -0.03),
        ("squeeze", 0.03, (-SPEED, 0.0), -0.03),
    ],
)
def test_a_bond_breaks_at_the_step_that_takes_it_beyond_its_limit(mode, limit, velocity, elongation):
    run = pm.simulate(pair_scene(pm.BondLimits(**{mode: limit}), velocity), steps=60, dt=DT)
    broken = run.broken_bonds
    assert (len(broken), broken.left, len(run.bonds)) == (1, 0, 0)
    assert broken.mode_e.tolist() == [mode]
    assert abs(broken.time_e[0] - abs(elongation) / SPEED) <= DT * (1.0 + 1e-9)
    # just beyond it: the step before was not
    beyond = abs(broken.elongation_e[0]) - abs(elongation)
    assert -1e-12 < beyond <= SPEED * DT * (1.0 + 1e-9)
    assert broken.force_e[0] == pytest.approx(K * broken.elongation_e[0], rel=1e-12)
    assert broken.energy_e[0] == pytest.approx(0.5 * K * broken.elongation_e[0] ** 2, rel=1e-12)
    assert "1 by " + mode in str(run) and run.to_dict()["bonds_broken"] == 1


@pytest.mark.parametrize(
    ("modes", "velocity"),
    [(("tension", "stretch"), (-SPEED, 0.0)), (("compression", "squeeze"), (SPEED, 0.0))],
)
def test_limits_of_one_sign_never_break_a_bond_under_the_other(modes, velocity):
    limits = pm.BondLimits(**dict.fromkeys(modes, 1e-6))
    run = pm.simulate(pair_scene(limits, velocity), steps=60, dt=DT)
    assert (len(run.broken_bonds), run.broken_bonds.left) == (0, 1)
    assert run.bonds == limits_scene_bonds(limits)


def limits_scene_bonds(limits):
    return pair_scene(limits, (0.0, 0.0)).effects[1]


def test_a_bond_breaks_by_the_force_of_its_tangential_spring():
    """A disc that is moved across the bond and does not turn: the spring's stretch is r0 asinh(v t / r0)."""
    scene = pair_scene(pm.BondLimits(shear=0.02, tension=1.0), (0.0, SPEED), stiffness=0.1, tangential=SHEAR_K)
    broken = pm.simulate(scene, steps=100, dt=DT).broken_bonds
    assert broken.mode_e.tolist() == ["shear"]
    due = math.sinh(0.02 / SHEAR_K) / SPEED
    assert due - 1e-4 < broken.time_e[0] <= due + DT * (1.0 + 1e-4)
    at = SHEAR_K * math.asinh(SPEED * broken.time_e[0])
    assert broken.shear_e[0] == pytest.approx(at, rel=1e-5)


def test_semi_implicit_euler_judges_bonds_at_the_end_of_its_steps():
    scene = pair_scene(pm.BondLimits(tension=0.06), (SPEED, 0.0))
    broken = pm.simulate(scene, steps=60, dt=DT, method=pm.SemiImplicitEuler()).broken_bonds
    assert broken.mode_e.tolist() == ["tension"]
    assert abs(broken.time_e[0] - 0.06 / K / SPEED) <= DT * (1.0 + 1e-9)
    assert broken.force_e[0] == pytest.approx(K * SPEED * broken.time_e[0], rel=1e-9)


def test_a_bond_of_a_particle_with_its_own_image_breaks_as_the_box_deforms():
    """Its length in a box that is sheared by gamma is L sqrt(1 + gamma^2)."""
    packing = pm.Packing([[1.0, 1.0]], [0.5], pm.Box.cubic(4.0, 2))
    spring, stretch = pm.LinearSpring(K), 0.02
    bond = pm.Bonds([0], [0], [[0, 1]], [4.0], spring, spring, 0.0, breaks_at=pm.BondLimits(stretch=stretch))
    scene = pm.Scene(packing, (pm.Repulsion(), bond))
    run = pm.ramp_strain(scene, rate=0.2, applied_strain=0.3, dt=0.02, samples=25)
    broken, due = run.broken_bonds, math.sqrt((1.0 + stretch) ** 2 - 1.0) / 0.2
    assert (broken.i_e.tolist(), broken.j_e.tolist(), broken.image_ed.tolist()) == ([0], [0], [[0, 1]])
    assert due < broken.time_e[0] <= due + run.dt * (1.0 + 1e-9)
    assert broken.elongation_e[0] == pytest.approx(math.sqrt(1.0 + (0.2 * broken.time_e[0]) ** 2) - 1.0, rel=1e-9)
    assert broken.released == pytest.approx(broken.energy_e[0], rel=1e-9) and broken.left == 0
    # the same in a run that looks at its energy long after the break
    seldom = pm.simulate(scene, steps=80, dt=0.02, applied_strain=pm.SteadyStrain(rate=0.2))
    assert seldom.outcome is pm.Outcome.FINISHED
    assert seldom.broken_bonds.step_e.tolist() == broken.step_e.tolist()


def test_events_are_a_table_and_stand_in_what_the_run_says_by_name():
    run = pm.simulate(pair_scene(pm.BondLimits(tension=0.06), (SPEED, 0.0)), steps=60, dt=DT)
    broken, table = run.broken_bonds, run.broken_bonds.table()
    assert len(table) == 1 and table["mode"].tolist() == ["tension"] and table.units["force"] == "force"
    assert table["force"][0] == broken.force_e[0] and table["image_y"].tolist() == [0]
    numbers = run.to_dict()
    assert numbers["broken_bonds"] == broken.to_dict() and numbers["broken_bonds"]["step"] == broken.step_e.tolist()
    assert json.loads(json.dumps(numbers["broken_bonds"])) == broken.to_dict()
    never = pm.simulate(pair_scene(pm.BondLimits(tension=1.0), (SPEED, 0.0)), steps=2, dt=DT).broken_bonds
    assert never.to_dict() == dict.fromkeys(broken.to_dict(), [])


def test_of_two_limits_that_are_exceeded_in_one_step_the_one_exceeded_more_is_named():
    limits = pm.BondLimits(tension=1e-6, stretch=1e-4)
    assert pm.simulate(pair_scene(limits, (SPEED, 0.0)), steps=3, dt=DT).broken_bonds.mode_e.tolist() == ["tension"]
    limits = pm.BondLimits(tension=1e-4, stretch=1e-6)
    assert pm.simulate(pair_scene(limits, (SPEED, 0.0)), steps=3, dt=DT).broken_bonds.mode_e.tolist() == ["stretch"]


# -- free pairs: flight, energy, contact -------------------------------------------------------------------------------


def free_pair(limits, *, rest=1.0, distance=1.0, repulsion=1.0):
    packing = pm.Packing([[2.0, 3.0], [2.0 + distance, 3.0]], [0.5, 0.5], pm.Box.cubic(8.0, 2))
    springs = pm.LinearSpring(K)
    bond = pm.Bonds([0], [1], [[0, 0]], [rest], springs, springs, tangential_stiffness=0.0, breaks_at=limits)
    return pm.Scene(packing, (pm.Repulsion(pm.LinearSpring(repulsion)), bond))


APART = {"velocity_nd": [[-0.1, 0.0], [0.1, 0.0]], "trace_every": 1, "trace_positions": True}


def test_a_pair_flies_freely_once_its_bond_is_broken():
    run = pm.simulate(free_pair(pm.BondLimits(tension=0.1)), steps=80, dt=0.02, **APART)
    after = int(run.broken_bonds.step_e[0])
    assert 1 < after < 70
    velocity, place = run.trace.velocity_tnd, run.trace.position_tnd
    assert not np.array_equal(velocity[after - 1], velocity[after])
    assert all(np.array_equal(one, velocity[after]) for one in velocity[after:])
    flown = place[after] + velocity[after] * (run.trace.time_t[after:, None, None] - run.trace.time_t[after])
    assert np.abs(place[after:] - flown).max() < 1e-13
    # the bond pulled until then
    assert velocity[after, 1, 0] < 0.1 - 1e-3 and run.trace.energy_t[after] == 0.0


def test_kinetic_and_released_energy_are_the_energy_at_the_start_to_the_second_order():
    errors = []
    for dt in (0.04, 0.02, 0.01):
        run = pm.simulate(free_pair(pm.BondLimits(stretch=0.05)), duration=2.0, dt=dt, **APART)
        start, end = run.trace.kinetic_t[0], run.trace.kinetic_t[-1]
        assert run.broken_bonds.released == pytest.approx(run.broken_bonds.energy_e.sum(), rel=1e-12)
        assert run.broken_bonds.released > 0.2 * start
        errors.append(abs(end + run.broken_bonds.released - start) / start)
        # the drift is over the largest energy seen, which the same error separates from that at the start
        assert abs(run.energy_drift) == pytest.approx(errors[-1], rel=errors[-1])
    assert errors[0] < 1e-3
    # the step at which it breaks is another one each time: no exact factor of 4
    assert errors[2] < errors[1] / 2.5 and errors[1] < errors[0] / 2.5


def test_a_broken_pair_is_an_ordinary_contact():
    """A pair that a bond has held deep in each other goes on as one that never had a bond, from the break on."""
    scene = free_pair(pm.BondLimits(compression=0.02), rest=0.8, distance=0.8)
    push = [[0.05, 0.0], [-0.05, 0.0]]
    run = pm.simulate(scene, steps=60, dt=0.02, velocity_nd=push, trace_every=1, trace_positions=True)
    broken, trace = run.broken_bonds, run.trace
    step = int(broken.step_e[0])
    assert broken.mode_e.tolist() == ["compression"]
    assert trace.contacts_t[step - 1] == 0 and trace.contacts_t[step] == 1
    bare = scene.without(pm.Bonds).replace(packing=scene.packing.replace(position_nd=trace.position_tnd[step]))
    again = pm.simulate(bare, steps=60 - step, dt=0.02, velocity_nd=trace.velocity_tnd[step])
    assert np.abs(again.packing.position_nd - run.packing.position_nd).max() < 1e-13
    # the contact holds more than the bond did: energy that nothing released is accounted for
    overlap = 0.5 * (1.0 - np.linalg.norm(np.diff(trace.position_tnd[step], axis=0))) ** 2
    assert broken.released == pytest.approx(broken.energy_e[0] - overlap, rel=1e-12) and broken.released < 0.0
    assert run.outcome.name == "FINISHED" and abs(run.energy_drift) < 1e-3


def test_dimers_with_rigid_links_turn_freely_once_the_bond_between_them_is_broken():
    place = [[2.0, 4.0], [3.0, 4.0], [4.0, 4.0], [5.0, 4.0]]
    links = pm.Links([0, 2], [1, 3], [[0, 0]] * 2, [1.0, 1.0])
    packing = pm.Packing(place, [0.5] * 4, pm.Box.cubic(9.0, 2), links=links)
    spring = pm.LinearSpring(K)
    bond = pm.Bonds([1], [2], [[0, 0]], [1.0], spring, spring, 0.0, breaks_at=pm.BondLimits(tension=0.1))
    scene = pm.Scene(packing, (pm.Repulsion(pm.LinearSpring()), bond))
    apart = [[-0.1, 0.02], [-0.1, -0.02], [0.1, 0.05], [0.1, -0.05]]
    run = pm.simulate(scene, steps=300, dt=0.01, velocity_nd=apart, trace_every=1, trace_positions=True)
    broken, trace = run.broken_bonds, run.trace
    assert broken.mode_e.tolist() == ["tension"] and run.link_error < 1e-12
    assert broken.released == pytest.approx(broken.energy_e[0], rel=1e-9)
    assert abs(run.energy_drift) < 1e-4 and run.momentum_error < 1e-12
    step = int(broken.step_e[0])
    bare = scene.without(pm.Bonds).replace(packing=packing.replace(position_nd=trace.position_tnd[step]))
    again = pm.simulate(bare, steps=300 - step, dt=0.01, velocity_nd=trace.velocity_tnd[step])
    assert np.abs(again.packing.position_nd - run.packing.position_nd).max() < 1e-11
    # at the angular velocity of a free dimer
    line = np.diff(trace.position_tnd[step:, :2], axis=1)[:, 0]
    angle = np.unwrap(np.arctan2(line[:, 1], line[:, 0]))
    turn = np.diff(angle)
    assert abs(turn[0]) > 1e-4 and np.ptp(turn) < 1e-6 * abs(turn[0])


def test_a_chain_under_its_own_weight_breaks_at_the_topmost_bond():
    count, weight, spring = 6, 0.02, pm.LinearSpring(K)
    hanging = np.arange(count - 1, 0, -1)
    gap = 1.0 + weight * hanging / K
    height = 9.0 - np.concatenate([[0.0], np.cumsum(gap)])
    packing = pm.Packing(
        np.column_stack([np.full(count, 3.0), height]), [0.5] * count, pm.Box.cubic(12.0, 2), mass_n=[1.0] * count
    )
    bonds = pm.Bonds(
        range(count - 1), range(1, count), [[0, 0]] * (count - 1), [1.0] * (count - 1), spring, spring, 0.0,
        breaks_at=pm.BondLimits(tension=4.5 * weight),
    )  # fmt: skip
    scene = pm.Scene(
        packing, (pm.Repulsion(pm.LinearSpring()), pm.Gravity(0.0, -weight), bonds, pm.FixedParticles((0,)))
    )
    run = pm.simulate(scene, steps=100, dt=0.02)
    assert (run.broken_bonds.i_e.tolist(), run.broken_bonds.step_e.tolist()) == ([0], [1])
    assert run.broken_bonds.force_e[0] == pytest.approx(5 * weight, rel=1e-6)
    assert run.bonds.i_b.tolist() == [1, 2, 3, 4]
    # what hung from it falls as a whole
    fallen = packing.position_nd[1:, 1].mean() - run.packing.position_nd[1:, 1].mean()
    assert fallen == pytest.approx(0.5 * weight * (99 * 0.02) ** 2, rel=1e-12)


# -- many: limits of single bonds, what a break does to others, threads, checkpoints -----------------------------------


def three_pairs(limits, dimension):
    """Return two bonded pairs and one that touches with friction, far from each other."""
    place = np.array([[2.0, 2.0], [3.0, 2.0], [2.0, 6.0], [3.0, 6.0], [6.0, 4.0], [6.9, 4.0]])
    if dimension == 3:
        place = np.column_stack([place, np.full(6, 4.0)])
    packing = pm.Packing(place, [0.5] * 6, pm.Box.cubic(9.0, dimension))
    bonds = pm.Bonds([0, 2], [1, 3], [[0] * dimension] * 2, [1.0, 1.0], tangential_stiffness=0.7, breaks_at=limits)
    return pm.Scene(packing, (pm.Repulsion(pm.LinearSpring()), pm.Friction(0.5, 0.6), bonds))


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_break_changes_nothing_elsewhere(dimension):
    rng = np.random.default_rng(3)
    velocity = 0.05 * rng.normal(size=(6, dimension))
    velocity[:2] = 0.0
    velocity[1, 0] = 0.3
    spin = 0.2 * rng.normal(size=(6, 1 if dimension == 2 else 3))
    manner = {"steps": 40, "dt": 0.02, "velocity_nd": velocity, "spin_nk": spin}
    runs = [
        pm.simulate(three_pairs(pm.BondLimits(tension=(limit, math.inf)), dimension), **manner)
        for limit in (0.05, math.inf)
    ]
    assert runs[0].broken_bonds.bond_e.tolist() == [0] and len(runs[1].broken_bonds) == 0
    apart = np.abs(runs[0].packing.position_nd - runs[1].packing.position_nd).max(axis=1)
    turned = np.abs(runs[0].spin_nk - runs[1].spin_nk).max(axis=1)
    assert apart[:2].max() > 1e-3
    # forces are taken anew with the velocities at the end of that step
    assert apart[2:].max() < 1e-6 and turned[2:].max() < 1e-5


@pytest.fixture(scope="module")
def network():
    """Discs with friction, half of them bonded with limits of either sign, of which some break in shear."""
    packing = pm.random_packing(40, dimension=2, sizes=pm.Bidisperse(1.4), packing_fraction=0.95, seed=4)
    limits = pm.BondLimits(tension=0.08, compression=0.3, shear=0.05)
    bonds = pm.bond_contacts(packing, tangential_stiffness=0.5, damping=0.2, rest="distance", breaks_at=limits)
    bonds = bonds.select(np.arange(len(bonds)) % 2 == 0)
    effects = (pm.Repulsion(law=pm.LinearSpring()), pm.ContactDamping(0.1), pm.Friction(0.5, 0.4, 0.1), bonds)
    return pm.Scene(packing, effects)


SHEARED = {"applied_strain": pm.SteadyStrain(0.2), "dt": 0.02}


def events(run):
    """Return all that a run says of its bonds, as bytes."""
    named = vars(run.broken_bonds).items()
    return {name: value.tobytes() if isinstance(value, np.ndarray) else value for name, value in named}


def test_a_run_that_is_cut_around_a_break_goes_on_with_the_same_bits(network, tmp_path):
    manner = {**SHEARED, "trace_every": 10}
    whole = pm.simulate(network, steps=120, **manner)
    step = int(whole.broken_bonds.step_e[len(whole.broken_bonds) // 2])
    assert len(whole.broken_bonds) > 3 and {"tension", "shear"} <= set(whole.broken_bonds.mode_e)
    assert 1 < step < 119
    for cut in (step - 1, step, step + 1):
        path = tmp_path / f"{cut}.npz"
        half = pm.simulate(network, steps=cut, checkpoint=path, **manner)
        assert len(half.broken_bonds) == (whole.broken_bonds.step_e <= cut).sum()
        again = pm.resume(path, network, steps=120)
        assert events(again) == events(whole) and again.bonds == whole.bonds
        assert np.array_equal(again.packing.position_nd, whole.packing.position_nd)
        assert np.array_equal(again.velocity_nd, whole.velocity_nd) and np.array_equal(again.spin_nk, whole.spin_nk)
        assert np.array_equal(again.trace.energy_t, whole.trace.energy_t)
        assert again.energy_drift == whole.energy_drift


def test_what_is_released_among_sliding_contacts_is_the_energy_of_the_bonds_less_that_of_their_contacts(network):
    """Beside what is broken, taking forces anew changes the energy of frictional contacts by little."""
    run = pm.simulate(network, steps=120, trace_every=1, trace_positions=True, **SHEARED)
    broken, trace, due = run.broken_bonds, run.trace, 0.0
    assert trace.sliding_t[broken.step_e].min() > 0
    for i, j, image, step in zip(broken.i_e, broken.j_e, broken.image_ed, broken.step_e, strict=True):
        place, lattice = trace.position_tnd[step], trace.lattice_tdd[step]
        distance = np.linalg.norm(place[j] - place[i] + lattice @ image)
        due += pair_energy(network.effects[0], distance, partners_of(*network.packing.radius_n[[i, j]], 0))
    held = broken.energy_e.sum()
    assert abs(broken.released - (held - due)) < 2e-3 * held


def test_a_damaged_list_of_broken_bonds_is_refused(network, tmp_path):
    path = tmp_path / "run.npz"
    pm.simulate(network, steps=120, checkpoint=path, **SHEARED)
    found = read_checkpoint(path, KIND)
    arrays = dict(found.arrays)
    assert len(arrays["engine.broken.bond_e"]) > 1
    arrays["engine.broken.bond_e"] = arrays["engine.broken.bond_e"] * 0
    write_checkpoint(path, KIND, found.settings, arrays)
    with pytest.raises(ValueError, match="broken.bond_e must name each bond that broke once"):
        pm.resume(path, network, steps=130)
    arrays = dict(found.arrays)
    step = arrays["engine.broken.step_e"]
    assert step[0] < step[-1]
    arrays["engine.broken.step_e"] = step[::-1].copy()
    write_checkpoint(path, KIND, found.settings, arrays)
    with pytest.raises(
        ValueError, match=rf"broken.step_e must not fall from one event to the next, got .* after {step[-1]}"
    ):
        pm.resume(path, network, steps=130)


def test_infinite_limits_change_no_bit(network):
    bonds = next(one for one in network.effects if isinstance(one, pm.Bonds))

    def run(limits):
        held = replace(bonds, breaks_at=limits)
        return pm.simulate(network.replace(effects=(*network.effects[:3], held)), steps=100, trace_every=10, **SHEARED)

    never, at_infinity = run(None), run(pm.BondLimits(math.inf, math.inf, math.inf, math.inf, math.inf))
    assert never.broken_bonds is None and never.bonds == bonds.unbreakable()
    assert len(at_infinity.broken_bonds) == 0
    assert np.array_equal(never.packing.position_nd, at_infinity.packing.position_nd)
    assert np.array_equal(never.velocity_nd, at_infinity.velocity_nd)
    assert np.array_equal(never.trace.stress_tdd, at_infinity.trace.stress_tdd)


def test_events_are_the_same_for_any_number_of_threads():
    packing = pm.random_packing(1000, dimension=2, sizes=pm.Bidisperse(1.4), packing_fraction=0.95, seed=4)
    limits = pm.BondLimits(tension=0.06, compression=0.3, shear=0.04)
    bonds = pm.bond_contacts(packing, tangential_stiffness=0.5, damping=0.2, rest="distance", breaks_at=limits)
    effects = (pm.Repulsion(law=pm.LinearSpring()), pm.ContactDamping(0.1), pm.Friction(0.5, 0.4, 0.1), bonds)
    one, two = (pm.simulate(pm.Scene(packing, effects), steps=60, threads=threads, **SHEARED) for threads in (1, 2))
    assert len(one.broken_bonds) > 20 and events(one) == events(two)
    assert np.array_equal(one.packing.position_nd, two.packing.position_nd)


# -- strained runs -----------------------------------------------------------------------------------------------------


def test_a_strained_run_says_which_bonds_broke_and_its_rows_are_those_after_the_break(network):
    run = pm.ramp_strain(network, rate=0.2, applied_strain=0.4, dt=0.02, samples=100, check=False)
    broken, step_t = run.broken_bonds, np.rint(run.time_t / run.dt).astype(int)
    assert run.outcome.name == "FINISHED" and len(broken) > 3 and len(run.bonds) == broken.left
    assert run.to_dict()["bonds_left"] == broken.left and "broken bonds" in str(run.summary())
    # the same steps as those of a simulation, whatever is observed on the way
    bare = pm.simulate(network, steps=run.steps, dt=run.dt, applied_strain=pm.SteadyStrain(0.2), trace_every=1)
    assert events(run) == events(bare)
    assert np.array_equal(run.potential_t + run.tangential_t, bare.trace.energy_t[step_t])
    assert np.array_equal(run.contacts_t, bare.trace.contacts_t[step_t])


def test_a_strained_run_that_was_stopped_goes_on_with_the_same_bits(network, tmp_path, monkeypatch):
    monkeypatch.setattr("packmech.rheology.strain_run._CHUNK", 2000)
    path = tmp_path / "run.npz"
    given = {"rate": 0.2, "applied_strain": 0.4, "dt": 0.02, "samples": 20}
    whole = pm.ramp_strain(network, **given)
    turns = []

    def stop(stage, figures):
        turns.append(figures["steps"])
        if figures["steps"] > int(whole.broken_bonds.step_e[0]):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        pm.ramp_strain(network, checkpoint=path, progress=stop, **given)
    assert turns[-1] < whole.steps
    again = pm.ramp_strain(network, checkpoint=path, **given)
    assert events(again) == events(whole)
    assert np.array_equal(again.packing.position_nd, whole.packing.position_nd)
    assert np.array_equal(again.potential_t, whole.potential_t)


def test_the_bonds_that_are_left_go_on_in_another_run(network):
    """Without tangential springs, which start slack, two runs one after the other do what one does."""
    bonds = replace(network.effects[3], tangential_stiffness=0.0, damping=0.0, breaks_at=pm.BondLimits(tension=0.05))
    smooth = network.replace(effects=(network.effects[0], bonds))
    whole = pm.simulate(smooth, steps=120, **SHEARED)
    cut = int(whole.broken_bonds.step_e[len(whole.broken_bonds) // 2])
    first = pm.simulate(smooth, steps=cut, **SHEARED)
    second = pm.simulate(scene_after(first, smooth), steps=120 - cut, velocity_nd=first.velocity_nd, **SHEARED)
    later = whole.broken_bonds.step_e > cut
    assert 0 < later.sum() < len(later) and len(first.broken_bonds) == (~later).sum()
    assert second.broken_bonds.step_e.tolist() == (whole.broken_bonds.step_e[later] - cut).tolist()
    assert second.broken_bonds.i_e.tolist() == whole.broken_bonds.i_e[later].tolist()
    assert np.abs(second.packing.position_nd - whole.packing.position_nd).max() < 1e-9
    assert second.bonds.i_b.tolist() == whole.bonds.i_b.tolist()


def test_curves_and_sweeps_say_how_many_bonds_broke(network):
    curve = pm.steady_shear(
        network, rates=[0.1, 0.2], applied_strain=0.4, skip_strain=0.2, dt=0.02, blocks=2, check=False
    )
    count = [len(run.broken_bonds) for run in curve.runs]
    assert min(count) > 0 and curve.bonds_broken == count == curve.to_dict()["bonds_broken"]
    assert curve.headings[-1] == "bonds broken" and [line[-1] for line in curve.lines()] == [str(one) for one in count]
    assert f"{count[0]} of " in str(curve.summary())
    sweep = pm.amplitude_sweep(network, amplitudes=[1e-3, 0.1], frequency=0.1, periods=2, dt=0.02)
    assert sweep.bonds_broken == [len(one.broken_bonds) for one in sweep.runs] and min(sweep.bonds_broken) > 0
    assert f"bonds broken at each amplitude: {sweep.bonds_broken[0]}, {sweep.bonds_broken[1]}" in repr(sweep)
    run = sweep.runs[1]
    period_e = 0.1 * run.broken_bonds.time_e
    assert run.broken_while_measured == np.count_nonzero((period_e > 1.0) & (period_e <= 2.0))
    assert run.to_dict()["bonds_broken"] == len(run.broken_bonds)
    assert run.broken_while_measured == 0 or "bonds broke while it was measured" in str(run.summary())
    lasting = network.replace(effects=(*network.effects[:3], network.effects[3].unbreakable()))
    plain = pm.amplitude_sweep(lasting, amplitudes=[1e-3], frequency=0.1, periods=2, dt=0.02)
    assert plain.bonds_broken is None and "bonds broken" not in repr(plain)
