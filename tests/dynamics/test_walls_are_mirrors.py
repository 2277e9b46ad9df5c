"""A contact with a wall is one with the particle's mirror image: closed forms, and an equal pair that meets head on."""

import math

import numpy as np
import pytest

import packmech as pm

# of one kind, which compiles once: a spring of stiffness 2 for a contact distance of 1, and Hertz's law
LAWS = {"linear": pm.PowerLaw(2.0, 2.0), "hertz": pm.PowerLaw(3.0, 2.5)}
RADIUS, LOW, HIGH, SIDE = 0.5, 4.0, 12.0, 16.0


def turned(vector):
    return np.asarray(vector) / np.linalg.norm(vector)


def ellipse(*directors):
    return pm.Spheroids(np.full(len(directors), 1.8), np.array([turned(one) for one in directors]))


def mirrored(vector):
    """Return vectors mirrored across y."""
    return np.asarray(vector, dtype=float) * np.array([1.0, -1.0, 1.0])[: np.shape(vector)[-1]]


def mirrored_spin(spin):
    """Return angular velocities in the mirror: pseudovectors, of which the part along the normal stays."""
    return -np.asarray(spin, dtype=float) if len(spin) == 1 else np.asarray(spin) * np.array([-1.0, 1.0, -1.0])


# disc, sphere, ellipse, spheroid, dimers of discs and of spheres
KINDS = {
    "disc": (2, None, (0.0,)),
    "sphere": (3, None, (0.0, 0.0, 0.0)),
    "ellipse": (2, [(0.8, 0.6)], (0.07,)),
    "spheroid": (3, [(0.7, 0.5, 0.3)], (0.07, 0.02, -0.05)),
    "dimer": (2, "beads", (0.07,)),
    "dimer of spheres": (3, "beads", (0.07, 0.0, -0.05)),
}


def beads_at(position, angle):
    """Return a packing of dimers, each turned by its angle in the plane of x and y."""
    d = len(position[0])
    arm = np.array([[math.cos(one), math.sin(one), 0.0][:d] for one in angle])
    center = np.concatenate([[x - 0.45 * a, x + 0.45 * a] for x, a in zip(np.asarray(position), arm, strict=True)])
    spread = pm.Packing(center, np.full(len(center), RADIUS), pm.Box.cubic(SIDE, d))
    return pm.rigid_packing(spread, np.repeat(np.arange(len(angle)), 2))


def placed(kind, position, mirror):
    """Return particles at these places, each as it is (mirror False) or mirrored across y."""
    d, shapes, _ = KINDS[kind]
    if shapes == "beads":
        return beads_at(position, [-0.6 if one else 0.6 for one in mirror])
    n, box = len(position), pm.Box.cubic(SIDE, d)
    if shapes is None:
        return pm.Packing(position, np.full(n, RADIUS), box)
    director = [mirrored(shapes[0]) if one else shapes[0] for one in mirror]
    return pm.Packing(position, np.full(n, RADIUS), box, shapes=ellipse(*director))


def reach_of(kind, mirror):
    """Return how far the particle reaches down (not mirrored) or up: the lower end of the dimer is the first bead."""
    d, shapes, _ = KINDS[kind]
    if shapes is None:
        return RADIUS
    if shapes == "beads":
        return RADIUS + 0.45 * math.sin(0.6)
    a, b = RADIUS * np.array([math.sqrt(1.8), 1.0 / math.sqrt(1.8)])
    if d == 3:
        a, b = RADIUS * np.array([1.8 ** (2.0 / 3.0), 1.8 ** (-1.0 / 3.0)])
    cosine = turned(shapes[0])[1]
    return math.sqrt(b**2 + (a**2 - b**2) * cosine**2)


def at_wall(kind, law, overlap, damping=0.0):
    """Return the scene of a particle that overlaps the low wall, and of it with its image instead of the wall."""
    d = KINDS[kind][0]
    height = reach_of(kind, False) - overlap
    place = np.full(d, 5.3)
    place[1] = LOW + height
    image = place.copy()
    image[1] = LOW - height
    alone = pm.Scene(placed(kind, [place], [False]), effects_of(LAWS[law], damping))
    pair = pm.Scene(placed(kind, [place, image], [False, True]), effects_of(LAWS[law], damping, low=-99.0))
    return alone, pair


def effects_of(law, damping, *, low=LOW, weight=0.0):
    """Return contacts, a weight, and walls of the same law; the same loops serve all tests."""
    contacts = (pm.Repulsion(law), pm.ContactDamping(damping))
    return (*contacts, pm.Gravity(0.0, -weight), pm.Walls(1, low, HIGH, law, damping))


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("kind", KINDS)
def test_a_wall_pushes_and_turns_with_the_force_of_the_mirror_image(kind, law):
    alone, pair = at_wall(kind, law, 0.06)
    np.testing.assert_allclose(pm.forces(alone)[0], pm.forces(pair)[0], rtol=1e-11, atol=1e-13)
    if alone.packing.shapes.has_orientations:
        own, both = (np.reshape(pm.torques(one), (one.packing.particles, -1)) for one in (alone, pair))
        np.testing.assert_allclose(own[0], both[0], rtol=1e-10, atol=1e-13)
        assert np.abs(own).max() > 1e-3
    assert pm.wall_contacts(alone).force_w.sum() == pytest.approx(abs(pm.forces(pair)[0, 1]), rel=1e-11)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("kind", KINDS)
def test_a_particle_on_a_wall_has_half_the_energy_of_itself_and_its_image(kind, law):
    alone, pair = at_wall(kind, law, 0.06)
    assert pm.energy(alone) == pytest.approx(0.5 * pm.energy(pair), rel=1e-11)


@pytest.mark.parametrize("side", ["low", "high"])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_disc_pressed_into_a_wall_by_a_tenth_of_its_diameter_bears_a_tenth(axis, side):
    place = np.full(2, 1.0)
    place[axis] = LOW + 0.45 if side == "low" else HIGH - 0.45
    disc = pm.Packing([place], [0.5], pm.Box(np.array([[SIDE, 3.0], [0.0, SIDE]])))
    scene = pm.Scene(disc, (pm.Repulsion(), pm.Walls(axis, LOW, HIGH)))
    push = np.zeros(2)
    push[axis] = 0.1 if side == "low" else -0.1
    np.testing.assert_allclose(pm.forces(scene)[0], push, rtol=1e-13, atol=1e-15)
    # (k / 2) overlap^2 of the pair, and twice its stiffness, as the image moves with the disc
    assert pm.energy(scene) == pytest.approx(0.0025, rel=1e-13)
    assert pm.hessian(scene, "none").toarray()[axis, axis] == pytest.approx(2.0, rel=1e-13)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("kind", KINDS)
def test_a_particle_rebounds_from_a_wall_as_from_its_mirror_image(kind, law):
    """The same motion in every step, with a dashpot, through touching and parting."""
    alone, pair = at_wall(kind, law, -0.005, damping=0.3)
    d, _, spin = KINDS[kind]
    velocity = np.array([0.02, -0.12, -0.03])[:d]
    both = {"velocity_nd": [velocity, mirrored(velocity)], "spin_nk": [spin, mirrored_spin(spin)]}
    own = {"velocity_nd": [velocity], "spin_nk": [spin]}
    settings = {"steps": 450, "dt": 0.02, "check": False}
    one, two = pm.simulate(alone, **own, **settings), pm.simulate(pair, **both, **settings)
    # it has turned back
    assert one.velocity_nd[0, 1] > 0.0
    np.testing.assert_allclose(one.packing.position_nd[0], two.packing.position_nd[0], rtol=0, atol=1e-11)
    np.testing.assert_allclose(one.velocity_nd[0], two.velocity_nd[0], rtol=0, atol=1e-11)
    if one.spin_nk is not None:
        np.testing.assert_allclose(one.spin_nk[0], two.spin_nk[0], rtol=0, atol=1e-11)


def flat(kind):
    """Return a particle that no push of a wall across y turns, how far it reaches, and d(rho) / d(height)."""
    d = 3 if "sphere" in kind else 2
    place, box = np.full((1, d), 5.3), pm.Box.cubic(SIDE, d)
    if "dimer" in kind:
        up = np.zeros(d)
        up[1] = 0.5
        two = pm.Packing(place + [up, -up], [0.5, 0.5], box)
        return pm.rigid_packing(two, [0, 0]), 1.0, 2.0
    if kind in ("disc", "sphere"):
        return pm.Packing(place, [0.5], box), 0.5, 2.0
    packing = pm.Packing(place, [0.5], box, shapes=pm.Spheroids([1.8], [np.eye(d)[0]]))
    across = 0.5 * 1.8 ** (-0.5 if d == 2 else -1.0 / 3.0)
    return packing, across, 1.0 / across


def rebound(kind, side, law, damping, duration, steps, speed=0.1):
    """Return height over touching, and velocity away from the wall, after a contact that begins at time 0."""
    packing, reach, _ = flat(kind)
    sign = 1.0 if side == "low" else -1.0
    place = packing.position_nd.copy()
    # it touches by rounding: the dashpot acts from the first step on
    place[0, 1] = (LOW if side == "low" else HIGH) + sign * reach * (1.0 - 1e-12)
    scene = pm.Scene(packing.replace(position_nd=place), effects_of(law, damping))
    velocity = np.zeros((1, packing.dimension))
    velocity[0, 1] = -sign * speed
    run = pm.simulate(scene, steps=steps, dt=duration / steps, velocity_nd=velocity, check=False)
    return sign * (run.packing.position_nd[0, 1] - place[0, 1]), sign * run.velocity_nd[0, 1]


def order_of(error, steps=(100, 200, 400)):
    """Return the smallest and largest order between numbers of steps."""
    found = np.array([error(one) for one in steps])
    orders = np.log2(found[:-1] / found[1:])
    return orders.min(), orders.max()


@pytest.mark.parametrize("side", ["low", "high"])
@pytest.mark.parametrize("kind", KINDS)
def test_restitution_from_a_linear_wall_is_the_closed_form_to_second_order(kind, side):
    """m h'' = -(k (sigma - rho) + c rho') share / 2 with rho = share h: a damped oscillator for half a period."""
    packing, _, share = flat(kind)
    mass, stiffness, damping = float(packing.mass_n[0]), 2.0, 0.4
    omega, gamma = math.sqrt(stiffness * share**2 / (2.0 * mass)), damping * share**2 / (4.0 * mass)
    if kind == "disc":
        # those of an equal pair: reduced mass m / 2
        assert (omega, gamma) == pytest.approx((math.sqrt(2.0 * stiffness / mass), damping / mass))
    swing = math.sqrt(omega**2 - gamma**2)
    duration = math.pi / swing
    exact = math.exp(-gamma * duration)
    assert 0.3 < exact < 0.8

    def error(steps):
        # up to shortly before they part, where the dashpot's force jumps, and from there by the oscillator
        height, velocity = rebound(kind, side, LAWS["linear"], damping, 0.95 * duration, steps)
        overlap, aside = -height, (-velocity - gamma * height) / swing
        left = (math.pi - math.atan2(overlap, aside)) / swing
        return abs(math.hypot(overlap, aside) * swing * math.exp(-gamma * left) / 0.1 - exact)

    low, high = order_of(error)
    assert 1.9 < low and high < 2.1 and error(400) < 1e-4
    parted = rebound(kind, side, LAWS["linear"], damping, 1.1 * duration, 4000)
    assert parted[0] > 0.0 and parted[1] / 0.1 == pytest.approx(exact, abs=1e-3)


@pytest.mark.parametrize("kind", KINDS)
def test_a_hertzian_wall_is_touched_for_the_time_of_the_closed_form_to_second_order(kind):
    """Hertz's collision: duration = 2 delta / v sqrt(pi) Gamma(7/5) / Gamma(9/10), delta the largest overlap."""
    packing, _, share = flat(kind)
    mass, scale, speed = float(packing.mass_n[0]), 3.0, 0.1
    # rho'' = -(share^2 / 2 m) u', as with the mass 2 m / share^2; sigma = 1
    effective, closing = 2.0 * mass / share**2, share * speed
    deepest = (0.5 * effective * closing**2 / (0.4 * scale)) ** 0.4
    duration = 2.0 * deepest / closing * math.sqrt(math.pi) * math.gamma(1.4) / math.gamma(0.9)

    def error(steps):
        height, _ = rebound(kind, "low", LAWS["hertz"], 0.0, duration, steps)
        return abs(height) / deepest

    low, high = order_of(error)
    assert 1.9 < low and high < 2.1 and error(400) < 1e-3
    assert rebound(kind, "low", LAWS["hertz"], 0.0, duration, 400)[1] == pytest.approx(speed, rel=1e-4)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("kind", KINDS)
def test_a_particle_that_comes_to_rest_on_a_floor_bears_its_weight_at_the_overlap_of_the_law(kind, law):
    packing, reach, share = flat(kind)
    place = packing.position_nd.copy()
    place[0, 1] = LOW + reach
    weight = 0.02
    scene = pm.Scene(packing.replace(position_nd=place), effects_of(LAWS[law], 1.0, weight=weight))
    run = pm.simulate(scene, steps=8000, dt=0.02, check=False)
    rest = scene.replace(packing=run.packing)
    force = float(packing.mass_n[0]) * weight
    assert pm.wall_contacts(rest).force_w == pytest.approx([force], rel=1e-10)
    # share / 2 times the law's force is the weight
    pull = 2.0 * force / share
    overlap = pull / 2.0 if law == "linear" else (pull / 3.0) ** (2.0 / 3.0)
    assert place[0, 1] - run.packing.position_nd[0, 1] == pytest.approx(overlap / share, rel=1e-9)
