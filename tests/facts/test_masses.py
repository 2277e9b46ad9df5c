"""Facts about masses: they belong to the packing, and go wherever it goes."""

import numpy as np
import pytest

import packmech as pm

REPULSION = (pm.Repulsion(law=pm.Harmonic()),)


def masses(count):
    return np.linspace(1.0, 3.0, count) ** 2


def heavy(packing):
    """Return the packing with uneven masses that follow from nothing else."""
    return packing.replace(mass_n=masses(packing.particles))


@pytest.fixture(scope="module")
def discs():
    start = pm.random_packing(32, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.9, seed=1)
    return heavy(start)


@pytest.fixture(scope="module")
def dimers():
    return heavy(pm.cluster_packing(8, pm.Dimer(), dimension=2, packing_fraction=0.35, largest_overlap=0.1, seed=1))


# -- what they are -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("dimension", "ball"), [(2, np.pi), (3, 4.0 / 3.0 * np.pi)])
def test_a_particle_has_the_mass_of_its_volume_at_density_one_and_grows_with_it(dimension, ball):
    packing = pm.random_packing(9, dimension=dimension, sizes=pm.Uniform(2.0), packing_fraction=0.5, seed=1)
    assert packing.given_mass_n is None
    assert packing.mass_n == pytest.approx(ball * packing.radius_n**dimension, rel=1e-15)
    grown = packing.replace(radius_n=1.5 * packing.radius_n)
    assert grown.mass_n == pytest.approx(1.5**dimension * packing.mass_n, rel=1e-14)


def test_given_masses_stay_when_radii_change_and_none_gives_them_back(discs):
    assert np.array_equal(discs.replace(radius_n=2.0 * discs.radius_n).mass_n, masses(32))
    assert discs.replace(mass_n=None).given_mass_n is None


MAKERS = {
    "random": lambda **given: pm.random_packing(8, dimension=3, packing_fraction=0.4, seed=1, **given),
    "box": lambda **given: pm.fill_box(pm.Box.cubic(9.0, 2), 8, packing_fraction=0.4, seed=1, **given),
    "lattice": lambda **given: pm.lattice_packing("filled square", repeats=2, **given),
    "reinforced kagome": lambda **given: pm.reinforced_kagome_packing(2, **given),
    "tunneled": lambda **given: pm.tunneled_packing((0, 3), **given),
    "clusters": lambda **given: pm.cluster_packing(4, pm.Trimer(), dimension=2, packing_fraction=0.3, seed=1, **given),
    "chains": lambda **given: pm.chain_packing(2, 5, dimension=2, packing_fraction=0.3, seed=1, **given),
}


@pytest.mark.parametrize("name", MAKERS)
def test_every_generator_takes_a_density(name):
    packing = MAKERS[name](density=2.5)
    assert packing.given_mass_n == pytest.approx(2.5 * packing.replace(mass_n=None).mass_n, rel=1e-14)
    assert MAKERS[name]() == packing.replace(mass_n=None)
    with pytest.raises(ValueError, match="density must be a finite number above 0, got -1.0"):
        MAKERS[name](density=-1.0)


def test_packings_of_other_masses_differ(discs):
    other = discs.replace(mass_n=masses(32)[::-1])
    assert discs == discs.replace() and hash(discs) == hash(discs.replace())
    assert discs != other and discs != discs.replace(mass_n=None)


@pytest.mark.parametrize(
    ("mass_n", "words"),
    [
        ([1.0, 2.0, 0.0], "mass_n must be positive, got 0.0 for particle 2"),
        ([1.0, -2.0, 1.0], "mass_n must be positive, got -2.0 for particle 1"),
        ([np.nan, 1.0, 1.0], "mass_n must be finite, got nan for particle 0"),
        ([1.0, 1.0], r"mass_n must have shape \(3\), got \(2,\)"),
    ],
)
def test_wrong_masses_are_refused_by_name_and_particle(mass_n, words):
    with pytest.raises(ValueError, match=words):
        pm.Packing([[0.0, 0.0], [1.0, 0.0], [2.0, 0.0]], [0.4] * 3, pm.Box.cubic(4.0, 2), mass_n=mass_n)


# -- where they go -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ending", [".npz", ".gsd", ".txt", ".csv", ".toml"])
def test_masses_are_read_back_to_the_last_bit(discs, ending, tmp_path):
    path = tmp_path / f"a{ending}"
    for packing in (discs, discs.replace(mass_n=None)):
        if ending == ".toml":
            pm.write_scene(pm.Scene(packing, REPULSION), path)
            assert pm.read_scene(path).packing == packing
        else:
            pm.write_packing(packing, path)
            assert pm.read_packing(path) == packing


def test_a_file_with_masses_is_of_a_version_that_older_readers_refuse(discs, tmp_path):
    for packing, version in ((discs, 3), (discs.replace(mass_n=None), 1)):
        pm.write_packing(packing, tmp_path / "a.npz")
        with np.load(tmp_path / "a.npz") as arrays:
            assert arrays["format_version"] == version


def test_other_programs_see_the_masses_and_one_that_they_changed_is_refused(discs, tmp_path):
    gsd = pytest.importorskip("gsd.hoomd")
    for packing in (discs, discs.replace(mass_n=None)):
        pm.write_packing(packing, tmp_path / "a.gsd")
        with gsd.open(str(tmp_path / "a.gsd"), "r") as file:
            frame = file[0]
        assert frame.particles.mass == pytest.approx(packing.mass_n, rel=1e-6)
        frame.particles.mass = frame.particles.mass * np.float32(2.0)
        with gsd.open(str(tmp_path / "b.gsd"), "w") as file:
            file.append(frame)
        with pytest.raises(ValueError, match="got two that differ"):
            pm.read_packing(tmp_path / "b.gsd")


@pytest.mark.parametrize(
    ("fields", "words"),
    [
        ({"masses": [1.0, 0.0]}, r"packing.masses must be positive, got 0.0 for particle 1"),
        ({"masses": [1.0, 1.0], "density": 2.0}, r"packing.density must be left out where masses are given, got 2.0"),
        ({"density": 0.0}, r"packing.density must be a finite number above 0, got 0.0"),
    ],
)
def test_wrong_masses_of_a_scene_file_are_refused_by_their_path(fields, words, tmp_path):
    lines = ['kind = "inline"', "lattice_vectors = [[4.0, 0.0], [0.0, 4.0]]", "radii = [0.5, 0.5]"]
    lines += ["positions = [[1.0, 1.0], [2.0, 1.0]]", *(f"{name} = {value}" for name, value in fields.items())]
    (tmp_path / "a.toml").write_text("[packing]\n" + "\n".join(lines) + '\n[[effects]]\nkind = "repulsion"\n')
    with pytest.raises(ValueError, match=words):
        pm.read_scene(tmp_path / "a.toml")


def scene(packing, *more):
    return pm.Scene(packing, (*REPULSION, *more))


# calls that return a packing with the particles of another
CALLS = {
    "wrapped": lambda packing: packing.wrapped(),
    "scattered_packing": lambda packing: pm.scattered_packing(packing, packing_fraction=0.3, seed=1),
    "quench": lambda packing: pm.quench(scene(packing), force_tolerance=1e-6).packing,
    "newton": lambda packing: pm.quench(scene(packing), force_tolerance=1e-12).packing,
    "quench batch": lambda packing: pm.QuenchBatch(scene(packing), 1).packing(0),
    "compress": lambda packing: pm.compress(scene(jammed(packing)), [1e-3])[-1].packing,
    "shear_stabilize": lambda packing: pm.shear_stabilize(scene(jammed(packing)), pressure=1e-2).packing,
    "simulate": lambda packing: pm.simulate(scene(packing), steps=3).packing,
    "jam": lambda packing: pm.jam(scene(packing), pressure=1e-4).packing,
}
# those that take no rigid links
UNLINKED = {
    "hard vertex": lambda packing: pm.jam(scene(packing), method=pm.HardVertex()).packing,
    "decompression": lambda packing: pm.jam(scene(packing), pressure=1e-4, method=pm.Decompression()).packing,
    "cement": lambda packing: pm.cement(scene(jammed(packing)), seed=1).packing,
    "shear batch": lambda packing: pm.ShearBatch([scene(packing)]).packing(0),
    "ramp_strain": lambda packing: pm.ramp_strain(scene(packing), rate=0.1, applied_strain=0.01).packing,
    "creep": lambda packing: pm.creep(scene(packing), stress=0.01, duration=0.5).packing,
    "oscillatory_shear": lambda packing: (
        pm.oscillatory_shear(scene(packing), amplitude=0.01, frequency=0.5, periods=2, check=False).packing
    ),
}


def jammed(packing):
    return pm.jam(scene(packing), pressure=1e-2, strain="isotropic").packing


@pytest.mark.parametrize("name", [*CALLS, *UNLINKED])
def test_a_packing_of_a_packing_has_its_masses(discs, name):
    assert np.array_equal((CALLS | UNLINKED)[name](discs).given_mass_n, masses(32))
    assert (CALLS | UNLINKED)[name](discs.replace(mass_n=None)).given_mass_n is None


@pytest.mark.parametrize("name", CALLS)
def test_a_packing_of_a_packing_with_links_has_its_masses(dimers, name):
    assert np.array_equal(CALLS[name](dimers).given_mass_n, masses(16))


def test_the_particles_that_are_left_have_their_masses(discs, dimers):
    for start in (discs, dimers):
        left, kept = pm.remove_rattlers(pm.jam(scene(start), pressure=1e-4).packing)
        assert np.array_equal(left.given_mass_n, start.mass_n[kept])
    crystal = heavy(pm.lattice_packing("triangular", repeats=(4, 4)))
    left = pm.vacancy_packing(crystal, 3, seed=1)
    assert left.particles == 13 and set(left.given_mass_n) < set(crystal.mass_n)


def test_a_run_goes_on_with_its_masses_and_not_with_others(discs, tmp_path):
    given = {"dt": 0.05, "temperature": 1e-3, "seed": 1}
    whole = pm.simulate(scene(discs), steps=40, **given)
    pm.simulate(scene(discs), steps=20, checkpoint=tmp_path / "run.npz", **given)
    assert pm.resume(tmp_path / "run.npz", scene(discs), steps=40).packing == whole.packing
    with pytest.raises(ValueError, match="differs in packing"):
        pm.resume(tmp_path / "run.npz", scene(discs.replace(mass_n=None)), steps=40)


# -- what they do ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("mass_n", [[1.0, 1.0], [0.3, 2.0], None])
def test_a_pair_swings_with_the_root_of_its_stiffness_over_its_reduced_mass_in_any_frame(mass_n):
    stiffness, stretch, boost = 2.0, 1e-3, np.array([0.7, -0.2])
    packing = pm.Packing([[4.0, 5.0], [5.0 + stretch, 5.0]], [0.5, 0.4], pm.Box.cubic(10.0, 2), mass_n=mass_n)
    spring = pm.LinearSpring(stiffness)
    bonds = pm.Bonds([0], [1], [[0, 0]], [1.0], compression=spring, tension=spring, tangential_stiffness=0.0)
    omega = np.sqrt(stiffness * (1.0 / packing.mass_n).sum())
    for velocity in (np.zeros((2, 2)), np.tile(boost, (2, 1))):
        run = pm.simulate(
            pm.Scene(packing, (bonds,)), duration=20.0, dt=1e-3, velocity_nd=velocity, trace_every=100,
            trace_positions=True,
        )  # fmt: skip
        vector = run.trace.position_tnd[:, 1] - run.trace.position_tnd[:, 0]
        assert vector[:, 0] - 1.0 == pytest.approx(stretch * np.cos(omega * run.trace.time_t), abs=1e-4 * stretch)
        center_td = np.einsum("n,tnd->td", packing.mass_n, run.trace.position_tnd) / packing.mass_n.sum()
        assert np.abs(center_td - center_td[0] - run.trace.time_t[:, None] * velocity[0]).max() < 1e-11


def test_modes_of_a_scene_and_their_density_are_those_of_its_masses(discs):
    rest = scene(pm.quench(scene(discs), force_tolerance=1e-12).packing)
    modes, edge = pm.normal_modes(rest), np.linspace(0.0, 3.0, 13)
    assert np.array_equal(pm.density_of_states(rest, edge).count_b, np.histogram(modes.frequency_m, edge)[0])
    weight = np.repeat(discs.mass_n**-0.5, 2)
    every = pm.normal_modes(rest, rattlers="keep")
    value = np.linalg.eigvalsh(pm.hessian(rest, "none").toarray() * weight * weight[:, None])
    assert value[-5:] == pytest.approx(every.eigenvalue_m[-5:], rel=1e-10)


def test_shear_by_hand_and_in_a_series_are_those_of_the_command_for_the_shipped_gel():
    gel = pm.read_scene("microgel")
    run = pm.run(gel)
    settings = {"relative_frequency": 0.025, "pre_periods": 2.0, "periods": 3.0, "post_periods": 1.0}
    by_hand = pm.oscillatory_shear(gel, amplitude=0.2, **settings)
    series = pm.shear_series(lambda seed: gel, amplitudes=[0.2], repeats=1, **settings)
    (trial,) = series.trials.values()
    assert run.frequency == by_hand.frequency == pytest.approx(pm.material_constants().frequency, rel=1e-8)
    for one in (by_hand.moduli, trial):
        assert (one.storage, one.loss) == (run.moduli.storage, run.moduli.loss)
    assert (run.moduli.storage, run.moduli.loss) == pytest.approx((1012.0, 383.0), abs=0.5)
