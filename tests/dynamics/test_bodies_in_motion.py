"""Rigid bodies of discs and spheres in time: free tops, orders, what is conserved, and (linked) discs beside them."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

import packmech as pm
from packmech.contacts.fused_volume import union_moments
from packmech.generate.rigid import orientation_of

REPULSION = (pm.Repulsion(),)
# a turn of all of space
TURN = np.linalg.qr(np.random.default_rng(8).normal(size=(3, 3)))[0]
TURN *= np.sign(np.linalg.det(TURN))
# a bent body of three beads of different sizes, asymmetric
PLACE = np.array([[0.0, 0.0, 0.0], [0.75, 0.1, 0.0], [0.3, 0.5, 0.45]])
SIZE = np.array([0.5, 0.4, 0.3])


def bodies(d, centers, side=12.0, turn=None):
    """Return copies of the bent body at some centers, each turned in its own way, all of space turned."""
    turn = np.eye(d) if turn is None else turn
    rng = np.random.default_rng(5)
    place, owner = [], []
    for n, center in enumerate(centers):
        own = np.linalg.qr(rng.normal(size=(d, d)))[0]
        own[:, 0] *= np.sign(np.linalg.det(own))
        place.append((PLACE[:, :d] @ own.T + np.asarray(center)[:d]) @ turn.T + 0.5 * side)
        owner += [n] * 3
    beads = pm.Packing(np.concatenate(place), np.tile(SIZE, len(centers)), pm.Box.cubic(side, d))
    return pm.rigid_packing(beads, owner)


def pair(d, turn=None):
    """Return two bodies that overlap askew, far from their images."""
    return bodies(d, [[0.0, 0.0, 0.0], [1.0, 0.55, 0.0] if d == 2 else [0.7, 0.4, 0.15]], turn=turn)


def rough(coefficient):
    return (*REPULSION, pm.Friction(coefficient=coefficient, stiffness=0.7, damping=0.0))


def crowd(d, count=24, seed=1):
    start = pm.random_packing(
        count, dimension=d, packing_fraction=0.85 if d == 2 else 0.6, seed=seed, shapes=pm.Trimer(angle=2.0)
    )
    return pm.quench(pm.Scene(start, REPULSION), force_tolerance=1e-6).packing


def motion(packing, size=0.1, seed=0):
    rng = np.random.default_rng(seed)
    velocity = size * rng.normal(size=packing.position_nd.shape)
    mass = packing.mass_n[:, None]
    return {
        "velocity_nd": velocity - (mass * velocity).sum(axis=0) / mass.sum(),
        "spin_nk": size * rng.normal(size=(packing.particles, 1 if packing.dimension == 2 else 3)),
    }


def inertia(packing):
    """Return the (N, 3, 3) tensors of inertia."""
    shapes = packing.shapes
    square = packing.mass_n[:, None] * (shapes.gyration_nk * packing.radius_n[:, None]) ** 2
    frame = shapes.frames()
    return np.einsum("nak,nk,nbk->nab", frame, square, frame)


def momentum(packing, spin_nk):
    """Return the (N, 3) angular momenta of spins."""
    return np.einsum("nab,nb->na", inertia(packing), spin_nk)


def free(gyration, spin, *, dt, duration, **more):
    """Return the run of a body of two crossed rows of spheres with given radii of gyration."""
    offset = 0.4 * np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
    turned = np.array([[0.8, 0.2, -0.4, 0.4]])
    shapes = pm.Beads([0, 4], offset, np.full(4, 0.7), np.array([gyration]), turned)
    packing = pm.Packing([[3.0] * 3], [0.5], pm.Box.cubic(6.0, 3), shapes=shapes)
    # given in the frame of the body
    spin = packing.shapes.frames()[0] @ spin
    return pm.simulate(pm.Scene(packing, REPULSION), duration=duration, dt=dt, spin_nk=[spin], **more), packing, spin


GYRATION, SPIN = (0.5, 0.65, 0.8), np.array([0.3, 1.2, -0.5])


def test_a_free_asymmetric_body_follows_eulers_equations_to_second_order_and_keeps_what_is_kept():
    moment = np.array(GYRATION) ** 2

    def euler(_, now):
        w, q = now[:3], now[3:]
        rate = np.cross(moment * w, w) / moment
        turn = [
            -q[1] * w[0] - q[2] * w[1] - q[3] * w[2],
            q[0] * w[0] + q[2] * w[2] - q[3] * w[1],
            q[0] * w[1] + q[3] * w[0] - q[1] * w[2],
            q[0] * w[2] + q[1] * w[1] - q[2] * w[0],
        ]
        return np.concatenate([rate, 0.5 * np.array(turn)])

    error = []
    for dt in (0.1, 0.05, 0.025):
        run, packing, spin = free(GYRATION, SPIN, dt=dt, duration=10.0, trace_every=1)
        start = np.concatenate([SPIN, packing.shapes.orientation_nq[0]])
        exact = solve_ivp(euler, (0.0, 10.0), start, method="DOP853", rtol=1e-12, atol=1e-13).y[:, -1]
        turned = run.packing.shapes
        away = turned.rotation_since(turned.oriented(exact[None, 3:]))
        own = turned.frames()[0].T @ run.spin_nk[0]
        error.append(np.array([np.abs(away).max(), np.abs(own - exact[:3]).max()]))
        whole = momentum(packing, [spin])[0]
        assert np.abs(run.trace.angular_momentum_tk - whole).max() < 1e-13 * np.linalg.norm(whole)
        assert np.abs(momentum(run.packing, run.spin_nk)[0] - whole).max() < 1e-13 * np.linalg.norm(whole)
    ratio = np.array([error[0] / error[1], error[1] / error[2]])
    assert np.abs(ratio - 4.0).max() < 0.3
    assert error[2].max() < 2e-3


def test_the_energy_of_a_free_asymmetric_body_swings_and_does_not_drift():
    swing = []
    for dt in (0.1, 0.05):
        run, packing, spin = free(GYRATION, SPIN, dt=dt, duration=2000.0, trace_every=7)
        kinetic = run.trace.kinetic_t / (0.5 * spin @ momentum(packing, [spin])[0]) - 1.0
        assert abs(kinetic[0]) < 1e-14
        swing.append(np.ptp(kinetic))
        early, late = (one.mean() for one in (kinetic[:1000], kinetic[-1000:]))
        assert abs(late - early) < 0.02 * swing[-1]
    assert swing[0] / swing[1] == pytest.approx(4.0, rel=0.05) and swing[1] < 1e-3


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_body_tumbles_about_its_middle_axis_only(axis):
    spin = np.full(3, 1e-4)
    spin[axis] = 1.0
    run, packing, _ = free(GYRATION, spin, dt=0.05, duration=120.0, trace_every=5, trace_positions=True)
    along = [
        packing.shapes.oriented(turn).frames()[0, :, axis] @ rate
        for turn, rate in zip(run.trace.orientation_tnq, run.trace.spin_tnk[:, 0], strict=True)
    ]
    # about the middle axis the spin turns over
    assert min(along) < -0.99 if axis == 1 else min(along) > 0.9999


@pytest.mark.parametrize("gyration", [(0.4, 0.7, 0.7), (0.6, 0.6, 0.75), (0.6, 0.6, 0.6)])
@pytest.mark.parametrize("dt", [0.2, 0.05])
def test_a_symmetric_body_precesses_as_a_symmetric_top_whatever_the_step(gyration, dt):
    run, packing, spin = free(gyration, SPIN, dt=dt, duration=6.0)
    own = int(np.argmax([gyration.count(one) == 1 for one in gyration]))
    whole = momentum(packing, [spin])[0]
    size = np.linalg.norm(whole)
    side = packing.mass_n[0] * 0.25 * gyration[(own + 1) % 3] ** 2
    axis, angle, was = whole / size, 6.0 * size / side, packing.shapes.frames()[0, :, own]
    expected = np.cos(angle) * was + np.sin(angle) * np.cross(axis, was) + (1.0 - np.cos(angle)) * (axis @ was) * axis
    assert np.abs(run.packing.shapes.frames()[0, :, own] - expected).max() < 1e-12


@pytest.mark.parametrize("d", [2, 3])
def test_energy_is_conserved_to_second_order_and_starts_as_the_static_one(d):
    packing = crowd(d)
    scene, start = pm.Scene(packing, REPULSION), motion(packing, 0.02)
    error = []
    for dt in (0.02, 0.01, 0.005):
        run = pm.simulate(scene, duration=1.0, dt=dt, trace_every=1, **start)
        energy = run.trace.energy_t + run.trace.kinetic_t
        error.append(np.abs(energy - energy[0]).max())
        assert run.momentum_error < 1e-13
    assert error[0] / error[1] == pytest.approx(4.0, rel=0.15) and error[1] / error[2] == pytest.approx(4.0, rel=0.15)
    assert run.trace.energy_t[0] == pytest.approx(pm.energy(scene), rel=1e-12)
    assert np.abs(run.trace.stress_tdd[0] - pm.stress_tensor(scene)).max() < 1e-13
    assert run.trace.contacts_t[0] == len(pm.find_shape_contacts(packing, gap_tolerance=0.0))
    end = scene.replace(packing=run.packing)
    assert run.trace.energy_t[-1] == pytest.approx(pm.energy(end), rel=1e-12)


@pytest.mark.parametrize("effects", [REPULSION, (*REPULSION, pm.ContactDamping(0.2)), rough(0.2)])
@pytest.mark.parametrize("d", [2, 3])
def test_the_momenta_of_a_pair_are_conserved(d, effects):
    packing = pair(d)
    start = motion(packing)
    run = pm.simulate(pm.Scene(packing, effects), duration=4.0, dt=0.02, trace_every=1, **start)
    whole = run.trace.angular_momentum_tk
    # about the corner of the box, far from the pair
    orbital = packing.mass_n[:, None] * np.cross(packing.position_nd, start["velocity_nd"]).reshape(2, -1)
    far = np.linalg.norm(packing.position_nd, axis=1) * np.linalg.norm(start["velocity_nd"], axis=1)
    scale = packing.mass_n @ far
    assert np.abs(whole - whole[0]).max() < 1e-13 * scale
    if d == 3:
        assert np.abs(whole[0] - (orbital + momentum(packing, start["spin_nk"])).sum(axis=0)).max() < 1e-13 * scale
    assert run.momentum_error < 1e-13
    # they bounced
    assert run.trace.contacts_t[0] >= 1 and np.ptp(run.trace.energy_t) > 1e-3


@pytest.mark.parametrize("d", [2, 3])
def test_a_pair_is_followed_to_second_order_with_dashpots_and_gains_no_energy(d):
    packing = pair(d)
    effects, ends = (*REPULSION, pm.ContactDamping(0.3)), []
    for dt in (0.02, 0.01, 0.005):
        run = pm.simulate(pm.Scene(packing, effects), duration=0.4, dt=dt, trace_every=1, **motion(packing, 0.3))
        assert len(set(run.trace.contacts_t)) == 1
        total = run.trace.energy_t + run.trace.kinetic_t
        assert np.diff(total).max() < 0.0 < total[0] - total[-1]
        ends.append(np.concatenate([run.packing.position_nd.ravel(), run.packing.shapes.orientation_nq.ravel()]))
    assert np.abs(ends[0] - ends[1]).max() / np.abs(ends[1] - ends[2]).max() == pytest.approx(4.0, rel=0.1)


def test_friction_is_followed_to_second_order_springs_and_all():
    for d in (2, 3):
        packing, ends, error = pair(d), [], []
        for dt in (0.02, 0.01, 0.005):
            run = pm.simulate(
                pm.Scene(packing, rough(10.0)), duration=0.4, dt=dt, trace_every=1, **motion(packing, 0.3)
            )
            assert len(set(run.trace.contacts_t)) == 1 and not run.trace.sliding_t.any()
            total = run.trace.energy_t + run.trace.kinetic_t
            error.append(np.abs(total - total[0]).max())
            assert run.trace.tangential_t[-1] > 1e-6
            turned, springs = run.packing.shapes.orientation_nq, run.packing.tangential
            assert springs.bead_c2.shape == (run.trace.contacts_t[-1], 2)
            moved = (run.packing.position_nd, turned, run.spin_nk, springs.displacement_ck)
            ends.append(np.concatenate([one.ravel() for one in moved]))
        assert np.abs(ends[0] - ends[1]).max() / np.abs(ends[1] - ends[2]).max() == pytest.approx(4.0, rel=0.1)
        assert error[0] / error[1] == pytest.approx(4.0, rel=0.1)


@pytest.mark.parametrize("d", [2, 3])
def test_what_slides_loses_energy_and_gains_none(d):
    packing, lost = pair(d), []
    # both turn one way, so that they rub
    spin = [[2.0], [2.0]] if d == 2 else [[0.4, -0.3, 0.8], [0.2, -0.6, 0.7]]
    for dt in (0.002, 0.001):
        run = pm.simulate(pm.Scene(packing, rough(0.03)), duration=0.4, dt=dt, trace_every=1, spin_nk=spin)
        total = run.trace.energy_t + run.trace.kinetic_t
        assert run.trace.sliding_t.any() and np.diff(total).max() < 1e-6
        lost.append(total[0] - total[-1])
    assert lost[1] > 2e-4 and lost[0] == pytest.approx(lost[1], rel=0.02)


@pytest.mark.parametrize("effects", [(*REPULSION, pm.ContactDamping(0.2)), rough(0.2)])
@pytest.mark.parametrize("d", [2, 3])
def test_the_motion_turns_with_all_of_space(d, effects):
    c, s = np.cos(0.8), np.sin(0.8)
    turn = TURN if d == 3 else np.array([[c, -s], [s, c]])
    spun = turn if d == 3 else np.eye(1)
    one, other = pair(d), pair(d, turn)
    start = motion(one, 0.2)
    runs = [
        pm.simulate(pm.Scene(packing, effects), duration=1.0, dt=0.01, velocity_nd=velocity, spin_nk=spin)
        for packing, velocity, spin in (
            (one, start["velocity_nd"], start["spin_nk"]),
            (other, start["velocity_nd"] @ turn.T, start["spin_nk"] @ spun.T),
        )
    ]
    center = [pm.bead_packing(run.packing).position_nd - 6.0 for run in runs]
    assert np.abs(center[1] - center[0] @ turn.T).max() < 1e-12
    assert np.abs(runs[1].spin_nk - runs[0].spin_nk @ spun.T).max() < 1e-12
    spring, turned = (run.packing.tangential for run in runs)
    if spring is not None:
        assert np.array_equal(spring.bead_c2, turned.bead_c2) and len(spring) > 0
        assert np.abs(turned.displacement_ck - spring.displacement_ck @ spun.T).max() < 1e-12


@pytest.mark.parametrize("effects", [(*REPULSION, pm.ContactDamping(0.2)), rough(0.2)])
@pytest.mark.parametrize("d", [2, 3])
def test_single_beads_move_and_rub_as_discs_and_spheres_do(d, effects):
    start = pm.random_packing(30, dimension=d, packing_fraction=0.9 if d == 2 else 0.7, seed=2)
    plain = pm.quench(pm.Scene(start, REPULSION), force_tolerance=1e-8).packing
    single = pm.rigid_packing(plain, np.arange(30))
    velocity = motion(plain, 0.05)["velocity_nd"]
    one, other = (
        pm.simulate(pm.Scene(packing, effects), duration=2.0, dt=0.02, trace_every=10, velocity_nd=velocity)
        for packing in (plain, single)
    )
    assert np.abs(one.packing.position_nd - other.packing.position_nd).max() < 1e-12
    assert np.array_equal(one.trace.contacts_t, other.trace.contacts_t)
    assert np.abs(one.trace.overall_stress_tdd - other.trace.overall_stress_tdd).max() < 1e-12
    if one.spin_nk is None:
        # nothing turns them
        assert not other.spin_nk.any()
        assert np.array_equal(other.packing.shapes.orientation_nq, single.shapes.orientation_nq)
    else:
        assert np.abs(one.spin_nk - other.spin_nk).max() < 1e-12
        spring, same = one.packing.tangential, other.packing.tangential
        assert np.array_equal(spring.i_c, same.i_c) and not same.bead_c2.any()
        assert np.abs(spring.displacement_ck - same.displacement_ck).max() < 1e-12


def linked(d, centers, legs):
    """Return clusters of equal point masses held by links, and the same as rigid bodies, with the owners of beads."""
    rng = np.random.default_rng(3)
    place, i, j = [], [], []
    for n, center in enumerate(centers):
        own = np.linalg.qr(rng.normal(size=(d, d)))[0]
        own[:, 0] *= np.sign(np.linalg.det(own))
        place.append(legs @ own.T + np.asarray(center)[:d] + 5.0)
        first = n * len(legs)
        i += [first + a for a in range(len(legs)) for b in range(a)]
        j += [first + b for a in range(len(legs)) for b in range(a)]
    position = np.concatenate(place)
    length = np.linalg.norm(position[i] - position[j], axis=1)
    links = pm.Links(i, j, np.zeros((len(i), d), dtype=int), length)
    radius, box = np.full(len(position), 0.5), pm.Box.cubic(10.0, d)
    owner = np.repeat(np.arange(len(centers)), len(legs))
    united = pm.rigid_packing(pm.Packing(position, radius, box, links), owner)
    # point masses at the beads, about their own center, which is that of the union only where beads are alike in it
    shapes = united.shapes
    middle = np.add.reduceat(position, shapes.start_n[:-1]) / len(legs)
    start, offset, gyration, turned = [0], [], [], []
    for n, center in enumerate(middle):
        arm = (position[owner == n] - center) / united.radius_n[n]
        spread, frame = np.linalg.eigh(arm.T @ arm / len(legs))
        frame[:, 0] *= np.sign(np.linalg.det(frame))
        offset.append(arm @ frame)
        # a row of points has no inertia about itself, and nothing turns it there
        gyration.append([np.sqrt(spread.sum())] if d == 2 else np.sqrt(np.maximum(spread.sum() - spread, 1e-2)))
        turned.append(frame)
        start.append(start[-1] + len(legs))
    plain = pm.Beads(start, np.concatenate(offset), shapes.size_b, np.array(gyration), shapes.orientation_nq)
    if d == 2:
        turned = np.array([one[:, 0] for one in turned])
    else:
        turned = np.array([orientation_of(one) for one in turned])
    mass = np.full(len(position), 0.7)
    rigid = pm.Packing(middle, united.radius_n, box, mass_n=np.bincount(owner, mass), shapes=plain.oriented(turned))
    return pm.Packing(position, radius, box, links, mass_n=mass), rigid, owner


ROW = np.array([[-0.45, 0.0, 0.0], [0.45, 0.0, 0.0]])
BENT = np.array([[-0.5, 0.0, 0.0], [0.5, 0.0, 0.0], [0.2, 0.7, 0.0]])
CENTERS = [[0.0, 0.0, 0.0], [1.1, 0.8, 0.3], [-1.0, 0.9, -0.3]]


@pytest.mark.parametrize(("d", "legs"), [(2, ROW), (2, BENT), (3, ROW), (3, BENT)])
def test_bodies_move_as_the_same_beads_held_by_links_do(d, legs):
    # near enough to touch
    near = 0.8 if d == 3 and len(legs) == 2 else 1.0
    held, rigid, owner = linked(d, near * np.array(CENTERS), legs[:, :d])
    assert np.abs(pm.bead_packing(rigid).position_nd - held.position_nd).max() < 1e-14
    start = motion(rigid, 0.1)
    if len(legs) == 2 and d == 3:
        along = rigid.shapes.frames()[:, :, 2]
        start["spin_nk"] -= (start["spin_nk"] * along).sum(axis=1, keepdims=True) * along
    arm = held.position_nd - rigid.position_nd[owner]
    spin = start["spin_nk"][owner]
    turning = np.cross(spin, arm) if d == 3 else spin * np.stack([-arm[:, 1], arm[:, 0]], axis=1)
    effects, apart = (*REPULSION, pm.ContactDamping(0.1)), []
    for dt in (0.02, 0.01):
        one = pm.simulate(pm.Scene(rigid, effects), duration=1.0, dt=dt, trace_every=1, **start)
        other = pm.simulate(
            pm.Scene(held, effects),
            duration=1.0,
            dt=dt,
            trace_every=1,
            velocity_nd=start["velocity_nd"][owner] + turning,
        )
        assert one.trace.contacts_t[0] == other.trace.contacts_t[0] > 0
        assert one.trace.energy_t[0] == pytest.approx(other.trace.energy_t[0], rel=1e-12)
        assert one.trace.kinetic_t[0] == pytest.approx(other.trace.kinetic_t[0], rel=1e-12)
        apart.append(np.abs(pm.bead_packing(one.packing).position_nd - other.packing.position_nd).max())
    assert apart[0] < 1e-3 and apart[0] / apart[1] == pytest.approx(4.0, rel=0.4)


@pytest.mark.parametrize("d", [2, 3])
def test_overall_stress_is_the_virial_of_what_moves(d):
    # V sigma less the integral of u u = -(1/2) d2/dt2 of that of x x, over the matter of an isolated pair
    packing, dt = pair(d), 0.005
    run = pm.simulate(
        pm.Scene(packing, REPULSION), duration=0.2, dt=dt, trace_every=1, trace_positions=True, **motion(packing, 0.3)
    )
    trace, shapes = run.trace, packing.shapes
    scale = packing.mass_n * packing.radius_n**2
    own = []
    for n in range(2):
        bead = slice(shapes.start_n[n], shapes.start_n[n + 1])
        own.append(union_moments(shapes.offset_bd[bead], shapes.size_b[bead])[2])
    spread, stirred = [], []
    for position, turn, spin in zip(trace.position_tnd, trace.orientation_tnq, trace.spin_tnk, strict=True):
        frame = shapes.oriented(turn).frames()
        matter = scale[:, None, None] * np.einsum("nak,nkm,nbm->nab", frame, own, frame)
        rate = np.zeros((2, 3))
        rate[:, 3 - spin.shape[1] :] = spin
        velocity = np.cross(rate[:, None], np.eye(3)[None])[:, :d, :d]
        stirred.append(np.einsum("nxa,nxy,nyb->ab", velocity, matter, velocity))
        spread.append(
            (packing.mass_n[:, None, None] * position[:, :, None] * position[:, None, :] + matter).sum(axis=0)
        )
    spread = np.array(spread)
    second = (spread[2:] - 2.0 * spread[1:-1] + spread[:-2]) / dt**2
    sums = packing.box.volume * (trace.overall_stress_tdd + trace.kinetic_stress_tdd) - np.array(stirred)
    assert np.abs(sums[1:-1] + 0.5 * second).max() < 2e-4 * np.abs(sums).max()
    # the part of the turns is seen, and symmetric with the others
    assert np.abs(packing.box.volume * trace.spin_stress_tdd).max() > 1e-2 * np.abs(sums).max()
    assert np.abs(trace.overall_stress_tdd - trace.overall_stress_tdd.transpose(0, 2, 1)).max() < 1e-15


@pytest.mark.parametrize("d", [2, 3])
def test_the_time_step_is_that_of_the_beads_that_touch_not_of_the_bodies(d):
    # a large bead and a small one, which is as stiff as a disc of its size under a law of the relative overlap
    place = 3.0 + np.array([[0.0] * d, [0.55] + [0.0] * (d - 1)])
    body = pm.rigid_packing(pm.Packing(place, [0.5, 0.1], pm.Box.cubic(6.0, d)), [0, 0])
    scene = pm.Scene(body, REPULSION)
    steep = body.shapes.stiffening(body.radius_n)[0]
    stiffest = steep * scene.energy_scale / 0.2**2
    expected = pm.VelocityVerlet().fraction * np.sqrt(body.mass_n[0] / stiffest)
    assert pm.simulate(scene, steps=1).dt == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("d", [2, 3])
def test_a_checkpoint_and_files_change_nothing(d, tmp_path):
    packing = crowd(d, count=40)
    scene = pm.Scene(packing, rough(0.3))
    start = motion(packing)
    whole = pm.simulate(scene, steps=200, dt=0.02, **start)
    path = tmp_path / "run.npz"
    pm.simulate(scene, steps=90, dt=0.02, checkpoint=path, trace_every=30, trace_positions=True, **start)
    again = pm.resume(path, scene, steps=200)
    assert again.packing == whole.packing and np.array_equal(again.spin_nk, whole.spin_nk)
    assert again.trace.orientation_tnq.shape == (len(again.trace.step_t), 40, 2 if d == 2 else 4)
    turned = packing.shapes.oriented(packing.shapes.orientation_nq[::-1])
    with pytest.raises(ValueError, match="packing"):
        pm.resume(path, scene.replace(packing=packing.replace(shapes=turned)), steps=200)
    # the springs go on where a run is cut in two
    half = pm.simulate(scene, steps=100, dt=0.02, **start)
    assert len(half.packing.tangential) > 40
    rest = []
    for name in ("half.npz", "half.gsd"):
        pm.write_packing(half.packing, tmp_path / name)
        kept = pm.read_packing(tmp_path / name)
        assert kept == half.packing
        rest.append(
            pm.simulate(
                scene.replace(packing=kept), steps=100, dt=0.02, velocity_nd=half.velocity_nd, spin_nk=half.spin_nk
            ).packing.position_nd
        )
    slack = scene.replace(packing=half.packing.replace(tangential=None))
    other = pm.simulate(slack, steps=100, dt=0.02, velocity_nd=half.velocity_nd, spin_nk=half.spin_nk)
    without = np.abs(other.packing.position_nd - whole.packing.position_nd).max()
    assert np.abs(rest[0] - whole.packing.position_nd).max() < 1e-2 * without
    assert np.array_equal(rest[0], rest[1]) and without > 1e-4


@pytest.mark.parametrize("d", [2, 3])
def test_threads_change_no_bit(d):
    # so many that there are blocks for each thread
    packing = pm.random_packing(
        1200, dimension=d, packing_fraction=0.8 if d == 2 else 0.55, seed=2, shapes=pm.Trimer(angle=1.9)
    )
    scene, start = pm.Scene(packing, rough(0.3)), motion(packing)
    one, three = (pm.simulate(scene, steps=10, dt=0.02, threads=threads, **start) for threads in (1, 3))
    assert one.packing == three.packing and np.array_equal(one.spin_nk, three.spin_nk)
    assert one.momentum_error < 1e-13 and len(one.packing.tangential) > 1200


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize("d", [2, 3])
def test_forces_of_many_are_the_static_ones(d, threads):
    # so many that the loops deal with them in blocks, which push each other's bodies
    packing = pm.random_packing(
        1500, dimension=d, packing_fraction=0.8 if d == 2 else 0.55, seed=2, shapes=pm.Trimer(angle=1.9)
    )
    scene, dt = pm.Scene(packing, REPULSION), 1e-7
    run = pm.simulate(scene, steps=1, dt=dt, method=pm.SemiImplicitEuler(), threads=threads)
    force, torque = pm.forces(scene), pm.torques(scene).reshape(1500, -1)
    assert np.abs(run.velocity_nd * packing.mass_n[:, None] / dt - force).max() < 1e-12 * np.abs(force).max()
    if d == 2:
        square = packing.mass_n * packing.shapes.gyration(packing.radius_n) ** 2
        given = run.spin_nk * square[:, None] / dt
    else:
        given = momentum(packing, run.spin_nk) / dt
    assert np.abs(given - torque).max() < 1e-11 * np.abs(torque).max()


@pytest.mark.parametrize("d", [2, 3])
def test_drag_takes_angular_momentum_at_its_rate_and_a_flow_turns_bodies_along_its_vorticity(d):
    packing = bodies(d, [[0.0, 0.0, 0.0]])
    scene = pm.Scene(packing, (*REPULSION, pm.BackgroundDamping(0.5)))
    spin = [[0.3]] if d == 2 else [[0.3, -0.4, 1.1]]
    run = pm.simulate(scene, duration=2.0, dt=0.002, spin_nk=spin)
    if d == 2:
        assert run.spin_nk[0, 0] == pytest.approx(0.3 * np.exp(-1.0), rel=1e-6)
    else:
        whole = momentum(packing, spin)[0]
        assert np.abs(momentum(run.packing, run.spin_nk)[0] - np.exp(-1.0) * whole).max() < 1e-6 * np.linalg.norm(whole)
    end = pm.ramp_strain(scene, rate=0.1, applied_strain=1.0, dt=0.01)
    # half the vorticity of v_x = rate y
    expected = np.zeros(len(spin[0]))
    expected[-1] = -0.05
    assert np.abs(end.spin_nk[0] - expected).max() < 1e-3


def test_moduli_of_bodies_in_slow_oscillatory_shear_go_to_the_static_ones():
    # dense enough to bear a shear
    dense = pm.random_packing(24, dimension=2, packing_fraction=1.0, seed=3, shapes=pm.Trimer(angle=2.0))
    packing = pm.quench(pm.Scene(dense, REPULSION), force_tolerance=1e-12).packing
    moduli = pm.elastic_moduli(pm.Scene(packing, REPULSION))
    assert moduli.stable
    static = moduli.shear_modulus
    effects = (*REPULSION, pm.ContactDamping(0.3), pm.BackgroundDamping(0.1))
    found = []
    for frequency in (0.01, 0.003):
        run = pm.oscillatory_shear(
            pm.Scene(packing, effects), amplitude=1e-6, relative_frequency=frequency, periods=3, frames=2
        )
        assert run.orientation_fnq.shape == (2, 24, 2)
        found.append((abs(run.moduli.storage / static - 1.0), run.moduli.loss / static))
    assert found[1][0] < 0.005 and found[1][0] < 0.2 * found[0][0]
    # of dashpots, and so proportional to the frequency
    assert found[1][1] == pytest.approx(0.3 * found[0][1], rel=0.1)


def test_springs_of_bodies_name_beads_and_others_none():
    packing = pair(2)
    arrays = [0], [1], [[0, 0]], [[0.1]]
    given = pm.TangentialDisplacements(*arrays, [[2, 0]])
    # seen from the other end
    assert given == pm.TangentialDisplacements([1], [0], [[0, 0]], [[0.1]], [[0, 2]])
    two = pm.TangentialDisplacements([0, 0], [1, 1], [[0, 0]] * 2, [[0.1], [0.2]], [[2, 0], [1, 2]])
    assert two.bead_c2.tolist() == [[1, 2], [2, 0]] and two.displacement_ck.tolist() == [[0.2], [0.1]]
    assert packing.replace(tangential=two).replace(shapes=packing.shapes).tangential is None
    with pytest.raises(ValueError, match="contacts must name each pair once"):
        pm.TangentialDisplacements([0, 0], [1, 1], [[0, 0]] * 2, [[0.1], [0.2]], [[2, 0], [2, 0]])
    with pytest.raises(ValueError, match=r"bead_c2 must be below \[3, 3\], got \[3, 0\] for contact 0"):
        packing.replace(tangential=pm.TangentialDisplacements(*arrays, [[3, 0]]))
    with pytest.raises(ValueError, match="must have bead_c2 for rigid bodies"):
        packing.replace(tangential=pm.TangentialDisplacements(*arrays))
    with pytest.raises(ValueError, match="bead_c2 must not be negative"):
        pm.TangentialDisplacements(*arrays, [[-1, 0]])
