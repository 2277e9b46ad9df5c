"""Facts about rough walls: what a contact with one takes and keeps, and what a run hands on of it."""

import math
from typing import NamedTuple

import numpy as np
import pytest

import packmech as pm
from packmech.dynamics.engine import build_engine
from packmech.dynamics.observables import POTENTIAL, TANGENTIAL
from packmech.measure.contact_forces import rattlers_in

STIFF = 1e3


@pm.effect
class Ceiling(NamedTuple):
    """A user's own wall."""

    height: float = 9.0

    acts_as = "walls"

    def body_energy(self, x, y, z, mass, radius):
        return 0.5 * max(y + radius - self.height, 0.0) ** 2

    def body_force(self, x, y, z, u, v, w, mass, radius):
        return 0.0, -max(y + radius - self.height, 0.0), 0.0


def cage(dimension, walls, number=12):
    """Return a scene of particles that move about between rough walls, none in another at the start."""
    packing = pm.random_packing(number, dimension=dimension, packing_fraction=0.3, seed=3)
    packing = pm.quench(pm.Scene(packing, (pm.Repulsion(),)), force_tolerance=1e-9).packing
    side = float(packing.box.lattice_dd[0, 0])
    # a box that is higher than from wall to wall
    height = np.ones(dimension)
    height[1] = 1.4
    place = packing.position_nd % side
    packing = packing.replace(box=pm.Box(np.diag(side * height)), position_nd=place)
    reach = float(packing.radius_n.max())
    return pm.Scene(packing, (pm.Repulsion(pm.LinearSpring(STIFF)), walls(-0.5 * reach, side + 0.5 * reach)))


def rough(low, high):
    return pm.Walls(1, low, high, pm.LinearSpring(STIFF), 0.0, pm.Friction(0.5, 0.3 * STIFF))


def sticking(low, high):
    return rough(low, high)._replace(friction=pm.Friction(1e9, 0.3 * STIFF))


def everything(low, high):
    return pm.Walls(
        1, low, high, pm.LinearSpring(STIFF), pm.Restitution(0.7),
        pm.Friction(0.5, pm.Mindlin(0.2), pm.DampingRatio(0.5)),
        pm.RollingResistance(0.1, 0.1 * STIFF, 1.0), pm.TwistingResistance(0.05, 0.1 * STIFF, 1.0),
    )  # fmt: skip


def start(scene, speed=3.0):
    n, d = scene.packing.particles, scene.packing.dimension
    random = np.random.default_rng(7)
    spin = random.standard_normal((n, 1 if d == 2 else 3))
    return {"velocity_nd": speed * random.standard_normal((n, d)), "spin_nk": spin}


def test_energy_is_kept_to_second_order_where_nothing_slides_and_nothing_is_damped():
    scene = cage(2, sticking, number=1)
    place = np.array([[1.0, 0.0]])
    place[0, 1] = scene.effects[1].low + scene.packing.radius_n[0] * 0.9
    scene = scene.replace(packing=scene.packing.replace(position_nd=place))
    errors = []
    for dt in (2e-3, 1e-3):
        run = pm.simulate(
            scene, duration=0.02, dt=dt, trace_every=1, velocity_nd=[[0.3, 0.0]], spin_nk=[[0.5]], check=False
        )
        trace = run.trace
        whole = trace.energy_t + trace.kinetic_t
        assert trace.tangential_t.max() > 1e-3 * whole[0]
        errors.append(np.abs(whole - whole[0]).max())
    assert math.log2(errors[0] / errors[1]) == pytest.approx(2.0, abs=0.1)


def test_angular_momentum_about_the_contact_is_all_that_a_rough_wall_keeps_of_a_sliding_sphere():
    """Friction at the wall has no moment about the point of contact: m v a + I w stays."""
    packing = pm.Packing([[5.0, 0.49]], [0.5], pm.Box.cubic(20.0, 2), mass_n=[1.0])
    walls = pm.Walls(1, 0.0, 15.0, pm.LinearSpring(STIFF), 0.0, pm.Friction(0.3, STIFF, 5.0))
    # a weight that the wall's spring balances: it stays at the arm .49
    scene = pm.Scene(packing, (walls, pm.Gravity(0.0, -2.0 * STIFF * 0.01, 0.0)))
    run = pm.simulate(scene, duration=0.2, dt=1e-4, velocity_nd=[[2.0, 0.0]])
    assert run.spin_nk[0, 0] < -0.1
    assert run.velocity_nd[0, 0] * 0.49 - 0.125 * run.spin_nk[0, 0] == pytest.approx(2.0 * 0.49, rel=1e-12)


@pytest.mark.parametrize(("dimension", "walls"), [(2, rough), (3, everything)])
def test_a_run_goes_on_from_the_springs_at_walls_that_another_left(dimension, walls):
    scene = cage(dimension, walls, number=60)
    dt = 5e-4
    whole = pm.simulate(scene, steps=600, dt=dt, check=False, **start(scene))
    first = pm.simulate(scene, steps=400, dt=dt, check=False, **start(scene))
    held = first.packing.tangential
    assert held is not None and len(held.at_wall_w) >= 1
    then = pm.simulate(
        scene.replace(packing=first.packing), steps=200, dt=dt, check=False,
        velocity_nd=first.velocity_nd, spin_nk=first.spin_nk,
    )  # fmt: skip
    slack = pm.simulate(
        scene.replace(packing=first.packing.replace(tangential=None)), steps=200, dt=dt, check=False,
        velocity_nd=first.velocity_nd, spin_nk=first.spin_nk,
    )  # fmt: skip
    scale = np.abs(whole.velocity_nd).max()
    off = np.abs(then.velocity_nd - whole.velocity_nd).max() / scale
    assert off < 1e-2 * np.abs(slack.velocity_nd - whole.velocity_nd).max() / scale
    # springs and dashpots see velocities extrapolated from the step before, which a new run has none of
    assert off < 1e-5


@pytest.mark.parametrize(("dimension", "walls"), [(2, rough), (3, everything)])
def test_forces_torques_and_energy_at_rest_are_those_that_time_steps_begin_with(dimension, walls):
    scene = cage(dimension, walls, number=60)
    end = pm.simulate(scene, steps=400, dt=5e-4, check=False, **start(scene)).packing
    scene = scene.replace(packing=end)
    at = end.tangential.at_wall_w
    engine = build_engine(scene, dt=5e-4, velocity_nd=np.zeros_like(end.position_nd))
    row = engine.observe()
    push = np.empty_like(engine.state.push)
    push[engine.order_n] = engine.state.push
    whole = np.concatenate([pm.forces(scene), np.reshape(pm.torques(scene), (len(push), -1))], axis=1)
    assert np.abs(push[at, dimension:]).max() > 1e-3 * np.abs(push).max()
    assert np.abs(whole - push).max() < 1e-12 * np.abs(push).max()
    assert pm.energy(scene) == pytest.approx(row[POTENTIAL] + row[TANGENTIAL], rel=1e-12)


def test_a_run_that_was_cut_ends_with_the_same_bits_on_any_number_of_threads(tmp_path):
    scene = cage(2, rough, number=800)
    how = {"dt": 5e-4, "check": False, **start(scene)}
    whole = pm.simulate(scene, steps=300, **how)
    both = pm.simulate(scene, steps=300, threads=2, **how)
    pm.simulate(scene, steps=100, checkpoint=tmp_path / "run.npz", **how)
    cut = pm.resume(tmp_path / "run.npz", scene, steps=300)
    for one in (both, cut):
        assert np.array_equal(one.velocity_nd, whole.velocity_nd) and one.packing == whole.packing
    assert whole.packing.tangential.at_wall_w is not None


@pytest.mark.parametrize("name", ["end.npz", "end.gsd"])
def test_springs_at_walls_are_written_and_read(name, tmp_path):
    packing = pm.random_packing(4, dimension=3, packing_fraction=0.2, seed=1)
    none, image = np.zeros(0, dtype=np.int64), np.zeros((0, 3), dtype=np.int64)
    at_walls = {"at_wall_w": [3, 1], "wall_stretch_wk": [[0.1, 0.2, 0.3, 4.0], [0.0, -0.5, 0.0, 2.0]]}
    alone = pm.TangentialDisplacements(none, none, image, np.zeros((0, 3)), **at_walls)
    beside = pm.TangentialDisplacements([0], [1], [[0, 0, 0]], [[0.1, 0.0, 0.2]], **at_walls)
    for springs in (alone, beside):
        assert springs.at_wall_w.tolist() == [1, 3]
        pm.write_packing(packing.replace(tangential=springs), tmp_path / name)
        assert pm.read_packing(tmp_path / name).tangential == springs


def test_springs_at_walls_go_with_their_particles():
    springs = pm.TangentialDisplacements(
        [0], [1], [[0, 0]], [[0.1]], at_wall_w=[0, 2], wall_stretch_wk=[[1.0, 2.0], [3.0, 4.0]]
    )
    left = springs.numbered(np.array([-1, 0, 1]))
    assert len(left) == 0 and left.at_wall_w.tolist() == [1] and left.wall_stretch_wk.tolist() == [[3.0, 4.0]]
    assert springs.numbered(np.array([-1, 0, -1])) is None
    with pytest.raises(ValueError, match="must hold the 3 numbers that the scene's walls keep of each particle, got 2"):
        springs.at_walls(4, 3)


def test_walls_say_what_they_do_where_contacts_have_friction():
    packing = pm.random_packing(4, dimension=2, packing_fraction=0.2, seed=1)
    walls = pm.Walls(1, -9.0, 9.0)
    for effect, name in ((pm.Friction(0.3), "friction"), (pm.RollingResistance(0.1), "rolling")):
        with pytest.raises(ValueError, match=rf"effects\[2\].{name} of Walls must be given where contacts have"):
            pm.Scene(packing, (pm.Repulsion(), effect, walls))
    smooth = walls._replace(friction=pm.Friction(0.0), rolling=pm.RollingResistance(0.0))
    assert pm.Scene(packing, (pm.Repulsion(), pm.Friction(0.3), pm.RollingResistance(0.1), smooth))
    with pytest.raises(ValueError, match="friction must be Friction"):
        pm.Scene(packing, (pm.Repulsion(), walls._replace(friction=pm.RollingResistance(0.1))))
    with pytest.raises(ValueError, match="friction must be Friction"):
        pm.Scene(packing, (pm.Repulsion(), walls._replace(friction=0.3)))
    with pytest.raises(ValueError, match="twisting must be None in a plane"):
        pm.Scene(packing, (pm.Repulsion(), walls._replace(twisting=pm.TwistingResistance(0.1))))
    rods = packing.replace(shapes=pm.Spheroids(np.full(4, 1.5), np.tile([1.0, 0.0], (4, 1))))
    with pytest.raises(ValueError, match="must be smooth Walls"):
        pm.Scene(rods, (pm.Repulsion(), walls._replace(friction=pm.Friction(0.3))))


def test_a_box_that_deforms_refuses_rough_walls():
    scene = cage(2, rough)
    with pytest.raises(ValueError, match="smooth walls for pm.ramp_strain, which knows no rough ones, got Walls"):
        pm.ramp_strain(scene, rate=0.1, applied_strain=0.1)


def test_a_disc_rests_on_a_slope_that_friction_and_resistance_to_rolling_hold():
    """It rolls down where the slope is steeper than the coefficient of rolling, whatever the friction is."""
    slope, law = 0.05, pm.LinearSpring(STIFF)
    floor = pm.Walls(
        1, 0.0, 15.0, law, 5.0, pm.Friction(0.5, 0.5 * STIFF, 5.0), pm.RollingResistance(0.1, 0.5 * STIFF, 5.0)
    )
    packing = pm.Packing([[5.0, 0.5]], [0.5], pm.Box.cubic(20.0, 2), mass_n=[1.0])
    scene = pm.Scene(packing, (pm.Repulsion(law), floor, pm.Gravity(slope, -1.0)))
    rest = pm.settle(scene, force_tolerance=1e-8)
    found = scene.replace(packing=rest.packing)
    touch = pm.wall_contacts(found)
    assert touch.force_w == pytest.approx([1.0], rel=1e-7)
    assert touch.tangential_wd == pytest.approx(np.array([[-slope, 0.0]]), rel=1e-6)
    assert touch.on_walls() == pytest.approx([slope, -1.0], rel=1e-6)
    forces = pm.contact_forces(found)
    assert rest.outcome is pm.Outcome.CONVERGED
    assert forces.residual < 1e-7 and not forces.rattlers_n.any()
    steeper = scene.replace(effects=(*scene.effects[:2], pm.Gravity(0.12, -1.0)))
    assert pm.simulate(steeper, duration=40.0, check=False).velocity_nd[0, 0] > 0.1


def test_a_pyramid_of_three_discs_stands_on_a_rough_floor_and_slides_apart_on_a_smooth_one():
    law = pm.LinearSpring(STIFF)
    place = [[4.0, 0.5], [5.02, 0.5], [4.51, 0.5 + math.sqrt(1.0 - 0.51**2)]]
    packing = pm.Packing(place, [0.5] * 3, pm.Box.cubic(20.0, 2), mass_n=[1.0] * 3)
    outcomes = []
    for mu in (0.6, 0.0):
        floor = pm.Walls(1, 0.0, 15.0, law, 5.0, pm.Friction(mu, 0.5 * STIFF, 5.0))
        effects = (pm.Repulsion(law), pm.ContactDamping(5.0), pm.Friction(0.6, 0.5 * STIFF, 5.0), floor)
        run = pm.settle(
            pm.Scene(packing, (*effects, pm.Gravity(0.0, -1.0))), force_tolerance=1e-6, step_limit=200_000, check=False
        )
        outcomes.append((run.outcome, float(run.packing.position_nd[2, 1])))
    assert outcomes[0][0] is pm.Outcome.CONVERGED and outcomes[0][1] > 1.3
    assert outcomes[1][1] < 1.0


def test_between_rough_walls_what_has_no_friction_is_held_by_pushes_alone():
    """Three discs stacked straight: the middle one, which no wall touches, can go sideways."""
    packing = pm.Packing([[5.0, 0.45], [5.0, 1.35], [5.0, 2.25]], [0.5] * 3, pm.Box.cubic(20.0, 2))
    walls = pm.Walls(1, 0.0, 2.7, pm.LinearSpring(), friction=pm.Friction(0.5))
    assert pm.contact_forces(pm.Scene(packing, (pm.Repulsion(), walls))).rattlers_n.any()
    rough = pm.Scene(packing, (pm.Repulsion(), pm.Friction(0.5), walls))
    assert not pm.contact_forces(rough).rattlers_n.any()
    assert math.isnan(pm.contact_forces(rough).isostatic_coordination)


def test_walls_of_a_user_s_own_have_no_part_in_friction():
    packing = pm.random_packing(4, dimension=2, packing_fraction=0.2, seed=1)
    with pytest.raises(ValueError, match="must hold no Ceiling beside Friction, .* at 1 and 2"):
        pm.Scene(packing, (pm.Repulsion(), Ceiling(), pm.Friction(0.3)))


@pytest.mark.parametrize("dimension", [2, 3])
def test_a_particle_that_two_rough_walls_press_is_held_and_rattles_between_smooth_ones(dimension):
    place = np.full((1, dimension), 5.0)
    place[0, 1] = 0.45
    packing = pm.Packing(place, [0.5], pm.Box.cubic(20.0, dimension))
    for walls, rattles in (
        (pm.Walls(1, 0.0, 0.9, pm.LinearSpring()), True),
        (pm.Walls(1, 0.0, 0.9, pm.LinearSpring(), friction=pm.Friction(0.1)), False),
    ):
        assert rattlers_in(pm.Scene(packing, (pm.Repulsion(), walls))).tolist() == [rattles]
