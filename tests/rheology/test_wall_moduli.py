"""Facts about rough plates and what they feel: closed forms of a bonded slab, inertia, who is held, restarts."""

import json
from importlib import resources

import numpy as np
import pytest

import packmech as pm
from packmech.cli import execute
from packmech.dynamics.pair_forces import pair_forces

LAW, DASHPOT, GAPS = pm.LinearSpring(1.0), 0.3, 9
SMALL = 1e-4


@pytest.fixture(scope="module")
def slab():
    """Ten rows of a triangular crystal of slack bonds, four discs of mass 1 wide.

    Contacts, friction and drag do nothing here: their loops serve other tests too.
    """
    packing = pm.lattice_packing("triangular", repeats=(2, 5), conventional=True)
    packing = packing.replace(position_nd=packing.position_nd + 0.1, mass_n=np.ones(20))
    springs = {"compression": LAW, "tension": LAW, "tangential_stiffness": 0.0, "damping": DASHPOT}
    bonds = pm.bond_contacts(packing, rest="distance", gap_tolerance=1e-9, **springs)
    idle = (pm.Repulsion(law=LAW), pm.ContactDamping(0.0), pm.Friction(0.0, 1.0, 0.0))
    return pm.Scene(packing, (*idle, bonds, pm.BackgroundDamping(0.0)))


@pytest.fixture(scope="module")
def plates(slab):
    return pm.rough_plates(slab.packing, layer=0.8)


def exact(frequency):
    """Return G' + i G'' at the plates and between them, rows being the masses of a chain.

    A row's coupling to the next is k/2 + i w c/2 for each disc; rows move as sin(q (j - M/2)), antisymmetric about the
    middle, with 4 coupling sin^2(q/2) = m w^2, while the sum of their differences is what the plates impose.
    """
    w = 2.0 * np.pi * frequency
    coupling = 0.5 * (1.0 + 1j * w * DASHPOT)
    q = 2.0 * np.arcsin(w / np.sqrt(4.0 * coupling))
    ends = (np.sin(q * GAPS / 2) - np.sin(q * (GAPS / 2 - 1))) / np.sin(q * GAPS / 2)
    return coupling * GAPS * np.sqrt(3.0) / 4.0 * ends, coupling * np.sqrt(3.0) / 2.0


def shear(scene, held, **choices):
    settings = {"amplitude": SMALL, "frequency": 0.05, "periods": 2, "dt": 0.1, "samples_per_period": 40}
    return pm.oscillatory_shear(scene, held_n=held, **(settings | {"carried": False} | choices))


def both(walls):
    return tuple(complex(one.storage, one.loss) for one in (walls.force, walls.volume))


def test_plates_hold_the_rows_at_both_ends(slab, plates):
    y = slab.packing.position_nd[:, 1]
    assert np.array_equal(plates, (y < 0.2) | (y > 7.8)) and plates.sum() == 4


def test_slow_shear_of_a_slab_has_its_exact_moduli_at_the_plates_and_between_them(slab, plates):
    walls = shear(slab, plates, frequency=0.005, periods=4, skip_periods=2).walls
    for found, expected in zip(both(walls), exact(0.005), strict=True):
        assert abs(found - expected) < 1e-4 * abs(expected)
    assert walls.separation == pytest.approx(GAPS * np.sqrt(0.75), rel=1e-12)
    # inertia takes a hundredth of what the plates bear already
    assert 0.001 < walls.difference < 0.02 and walls.agree


def test_fast_shear_makes_a_standing_wave_that_the_plates_feel_and_the_flag_tells(slab, plates):
    walls = shear(slab, plates, periods=24, skip_periods=22).walls
    for found, expected in zip(both(walls), exact(0.05), strict=True):
        assert abs(found - expected) < 1e-2 * abs(expected)
    wall, volume = exact(0.05)
    assert walls.difference == pytest.approx(abs(wall - volume) / abs(volume), rel=1e-2)
    assert walls.difference > 1.0 and not walls.agree


def test_a_slab_that_is_carried_along_has_no_wave_and_the_moduli_of_the_frequency_domain(slab, plates):
    walls = shear(slab, plates, carried=True).walls
    domain = pm.complex_modulus(slab, [0.05], held_n=plates).modulus_f[0]
    for found in both(walls):
        assert abs(found - domain) < 1e-6 * abs(domain)
    assert walls.agree


def test_both_plates_feel_the_same_where_the_wave_is_symmetric(slab, plates):
    walls = shear(slab, plates).walls
    scale = np.abs(walls.low_stress_t).max()
    # rows are shifted by half a disc from one to the next, which counts in the second order of the amplitude
    assert np.abs(walls.low_stress_t - walls.high_stress_t).max() < 1e-3 * scale


def test_what_the_plates_feel_is_the_rate_of_the_samples_momentum(slab, plates):
    """The plates' forces, less in the middle of the wave, are what turns the sample's momentum about."""
    run = shear(slab, plates, frames=81, samples_per_period=400, periods=1, amplitude=1e-3)
    free = ~plates
    x, t = run.position_fnd[:, free, 0], run.frame_time_f
    dt = t[1] - t[0]
    middle = 0.5 * (slab.packing.position_nd[plates, 1].min() + slab.packing.position_nd[plates, 1].max())
    # in the frame in which the middle between the plates rests
    sheared = run.amplitude * np.sin(2.0 * np.pi * run.frequency * t)
    lab = x - sheared[:, None] * middle
    upper = slab.packing.position_nd[free, 1] > middle
    accelerated = ((lab[2:] - 2.0 * lab[1:-1] + lab[:-2]) / dt**2)[:, upper].sum(axis=1)
    bonds = slab.effects[3]
    assert len(bonds) == 60
    at = np.searchsorted(run.time_t, t[1:-1] - 1e-9)
    volume = slab.packing.box.volume / (10.0 * np.sqrt(0.75))
    on_upper = run.walls.high_stress_t[at] * volume
    # the other force on the upper half is that of its lower neighbors, by symmetry the stress in the middle
    rows = np.round((slab.packing.position_nd[:, 1] - 0.1) / np.sqrt(0.75)).astype(int)
    mean = np.array([run.position_fnd[1:-1, rows == j, 0].mean(axis=1) for j in (4, 5)])
    rest = np.array([slab.packing.position_nd[rows == j, 0].mean() for j in (4, 5)])
    slip = (mean[1] - mean[0]) - (rest[1] - rest[0])
    rate = np.gradient(slip, dt)
    pulled = 2 * 0.5 * (slip + DASHPOT * rate)
    scale = np.abs(on_upper).max()
    assert np.abs(accelerated - (on_upper - pulled))[5:-5].max() < 0.02 * scale


def test_plates_that_drive_alone_do_so_at_second_order(slab, plates):
    def end(dt):
        return shear(slab, plates, dt=dt, periods=0.75, samples_per_period=8).packing.position_nd

    fine = end(0.0125 / 2)
    error = [np.abs(end(dt) - fine).max() for dt in (0.1, 0.05, 0.025)]
    order = np.log2(np.array(error[:-1]) / error[1:])
    assert order == pytest.approx([2.0, 2.0], abs=0.1)


def test_a_run_with_plates_goes_on_from_its_checkpoint_with_the_same_bits(slab, plates, tmp_path):
    path, calls = tmp_path / "run.npz", []

    def stop(stage, figures):
        calls.append(figures["steps"])
        if len(calls) == 3:
            raise KeyboardInterrupt

    choices = {"frames": 6, "checkpoint": path}
    with pytest.raises(KeyboardInterrupt):
        shear(slab, plates, progress=stop, **choices)
    again, whole = shear(slab, plates, **choices), shear(slab, plates, frames=6)
    assert np.array_equal(again.packing.position_nd, whole.packing.position_nd)
    for name in ("low_stress_t", "high_stress_t", "volume_stress_t"):
        assert np.array_equal(getattr(again.walls, name), getattr(whole.walls, name))
    assert again.walls.separation == whole.walls.separation


@pytest.mark.slow
def test_smooth_walls_bear_no_shear_and_the_flag_tells(slab):
    slab = slab.without(pm.Friction)
    walled = slab.replace(effects=(*slab.effects[:-1], pm.Walls(axis=1, low=-0.5, high=8.5, law=LAW)))
    walls = shear(walled, None, carried=True).walls
    assert both(walls)[0] == 0.0 and not walls.agree
    assert walls.separation == 9.0


def test_there_are_no_walls_without_plates_or_with_one_particle_held_in_the_middle(slab):
    middle = np.zeros(20, dtype=bool)
    middle[8] = True
    assert shear(slab, None, carried=True).walls is None
    assert shear(slab, middle, carried=True).walls is None
    with pytest.raises(ValueError, match="carried must be True where no plates drive the sample"):
        shear(slab, middle)


def test_forces_of_pairs_add_up_to_the_stress_and_vanish_in_total(slab, plates):
    marches = []
    run = shear(slab, plates, progress=lambda stage, figures: marches.append(figures["engine"]))
    pairs = pair_forces(marches[-1])
    virial = pairs.force_kd.T @ pairs.branch_kd / slab.packing.box.volume
    assert np.abs(virial - run.stress["contact"][-1]).max() < 1e-13 * np.abs(virial).max()
    assert np.abs(pairs.net(20).sum(axis=0)).max() < 1e-13 * np.abs(pairs.force_kd).max()
    assert pairs.bonded_k.all() and len(pairs.i_k) == 60


def test_plates_catch_who_reaches_across_the_ends():
    packing = pm.random_packing(60, dimension=2, packing_fraction=0.9, seed=1)
    height, y, r = packing.box.lattice_dd[1, 1], packing.position_nd[:, 1], packing.radius_n
    expected = (y < r) | (y > height - r)
    assert np.array_equal(pm.rough_plates(packing), expected)
    moved = packing.replace(position_nd=packing.position_nd + [0.0, 3.0 * height])
    assert np.array_equal(pm.rough_plates(moved), pm.rough_plates(packing))
    tilted = packing.replace(box=pm.Box(packing.box.lattice_dd @ np.array([[1.0, 0.0], [0.3, 1.0]])))
    with pytest.raises(ValueError, match="packing must have a box whose vectors but one are across axis 1"):
        pm.rough_plates(tilted)
    for layer in (0.5 * height, 1e-9):
        with pytest.raises(ValueError, match="layer must"):
            pm.rough_plates(packing, layer=layer)


def run_scene(folder, text):
    (folder / "a.toml").write_text(text)
    assert execute(["run", str(folder / "a.toml"), "--json", str(folder / "a.json")]) == 0
    return json.loads((folder / "a.json").read_text())


def test_the_command_prints_both_moduli_of_the_shipped_plates_and_flags_a_fast_shear(tmp_path, capsys):
    text = (resources.files("packmech") / "scenes" / "rough-plates.toml").read_text()
    slow = run_scene(tmp_path, text.replace("periods = 2.0", "periods = 1.0"))
    said = capsys.readouterr().out
    assert "at the walls" in said and "between them" in said and "walls differ" in said and "MORE" not in said
    # contacts inside the plates are no part of the material's modulus: what counts them comes after, by its name
    first = next(line for line in said.splitlines() if "G'" in line)
    assert "at the walls" in first
    assert said.index("between them") < said.index("G' of the whole box") < said.index("contacts inside the plates")
    assert slow["storage_modulus"] > 1.2 * slow["walls"]["volume_storage"]
    walls = slow["walls"]
    assert walls["agree"] and walls["difference"] < 0.1 and slow["held"] == 11
    assert walls["force_storage"] == pytest.approx(walls["volume_storage"], rel=0.1)
    fast = run_scene(tmp_path, text.replace("relative_frequency = 0.005", "relative_frequency = 0.05"))
    assert "MORE THAN 30 %" in capsys.readouterr().out
    assert not fast["walls"]["agree"] and fast["walls"]["difference"] > 0.3


def test_slow_shear_between_rough_plates_has_one_modulus_whatever_their_discs_heights():
    scene = pm.read_scene("rough-plates")
    run = pm.oscillatory_shear(
        scene,
        amplitude=1e-3,
        relative_frequency=0.002,
        periods=1,
        held_n=pm.rough_plates(scene.packing),
        samples_per_period=40,
    )
    assert run.walls.difference < 0.01


@pytest.mark.slow
def test_plates_in_space_have_one_modulus_above_that_of_the_bulk_as_they_let_nothing_turn():
    packing = pm.lattice_packing("sc", repeats=(3, 3, 5))
    packing = packing.replace(position_nd=packing.position_nd + 0.2, mass_n=np.ones(45))
    springs = {"compression": LAW, "tension": LAW, "tangential_stiffness": 0.5, "damping": 0.2}
    bonds = pm.bond_contacts(packing, rest="distance", gap_tolerance=1e-9, tangential_damping=0.1, **springs)
    scene, marches = pm.Scene(packing, (bonds,)), []
    held = pm.rough_plates(packing, layer=0.9, axis=2)
    assert held.sum() == 18
    choices = {"axes": (0, 2), "held_n": held}
    run = pm.oscillatory_shear(
        scene,
        amplitude=1e-6,
        frequency=0.005,
        periods=4,
        skip_periods=3,
        progress=lambda stage, figures: marches.append(figures["engine"]),
        **choices,
    )
    # half of the shear is rotation, which bonds between turning spheres do not resist: G = k_t / 2
    bulk = 0.5 * 0.5
    wall, volume = both(run.walls)
    assert abs(wall - volume) < 1e-3 * abs(volume)
    assert 1.05 * bulk < wall.real < 2.0 * bulk
    assert run.walls.separation == pytest.approx(4.0, rel=1e-12)
    pairs = pair_forces(marches[-1])
    virial = pairs.force_kd.T @ pairs.branch_kd / packing.box.volume
    assert np.abs(virial - run.stress["contact"][-1]).max() < 1e-12 * np.abs(virial).max()
