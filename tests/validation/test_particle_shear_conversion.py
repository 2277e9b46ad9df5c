"""Facts about the preset's scenes under native dynamics: the same forces, the same numbers back, honest refusals."""

import dataclasses
import functools

import numpy as np
import pytest

import packmech as pm
from packmech.effects import equal_partners, law_first
from packmech.validation import particle_shear as ps

CHANGES = [
    {},
    {"law": "plateau", "plateau_begin": 0.2, "plateau_end": 0.9, "plateau_slope": 0.3},
    {"law": "exponential", "tensile_range": 0.5},
    {"divergence": 0.4, "friction_coefficient": 0.3, "tangential_ratio": 0.5, "relative_viscosity": 0.3},
    {"reinforcement_normal": 2.0, "reinforcement_tangential": 3.0},
    {"reinforcement_normal": 2.0, "reinforcement_tangential": 3.0, "keep_viscosity": True},
    {"width": 700.0, "height": 300.0, "cooling": 0.8, "amplitude": 0.05, "pre_periods": 1.0},
]


@functools.cache
def prepared(which, centers):
    experiment = ps.ParticleShear(particles=30, **CHANGES[which])
    return experiment, ps.prepared_discs(experiment, seed=2, centers=centers, steps=20)


def still(which, centers):
    """Return an experiment and discs out of equilibrium without velocities and histories."""
    experiment, discs = prepared(which, centers)
    moved = discs.position_nd + np.random.default_rng(1).normal(0.0, 5.0, (30, 2))
    return experiment, discs.replace(
        position_nd=np.clip(moved, 0.0, (experiment.width, experiment.height)), velocity_nd=np.zeros((30, 2)),
        spin_n=np.zeros(30), carried_nd=np.zeros((30, 2)), history_ck=np.zeros((len(discs.contact_ck), 2)),
    )  # fmt: skip


@pytest.mark.parametrize("which", range(len(CHANGES)))
def test_contacts_of_a_scene_have_the_forces_of_the_preset(which):
    experiment, discs = still(which, None)
    last = ps.advance(discs, experiment.material, ps.StepRules(1e-12, plates=False), np.zeros(1)).last
    expected = 1e-6 * last.force_nd
    scene = ps.to_scene(experiment, discs)
    found = pm.forces(scene.replace(effects=scene.effects[:1]))
    assert np.abs(found - expected).max() < 1e-12 * np.abs(expected).max()


def test_a_bonded_scene_is_pushed_off_as_the_discs_are():
    experiment, discs = still(0, 4)
    dt = 1e-9
    expected = ps.advance(discs, experiment.material, ps.StepRules(dt, plates=False), np.zeros(1)).final.velocity_nd
    scene = ps.to_scene(experiment, discs)
    run = pm.simulate(scene, steps=1, dt=dt, method=pm.SemiImplicitEuler())
    assert np.abs(run.velocity_nd - expected).max() < 1e-6 * np.abs(expected).max()


@pytest.mark.parametrize("which", range(len(CHANGES)))
def test_bonds_of_a_scene_have_the_laws_of_the_preset(which):
    experiment, discs = prepared(which, 4)
    made, bonds = experiment.material, ps.to_scene(experiment, discs).effects[-1]
    for share in (0.1, 0.5, 0.9, 0.999):
        assert 1e6 * law_first(bonds.compression, 40.0 * share, equal_partners(40.0)) == pytest.approx(
            ps.bond_force(made, 40.0 * share, 40.0), rel=1e-12
        )
        assert 1e6 * law_first(bonds.tension, 40.0 / share, equal_partners(40.0)) == pytest.approx(
            ps.bond_force(made, 40.0 / share, 40.0), rel=1e-12
        )
    shares = (made.bond_normal_ratio, made.bond_tangential_ratio) if made.bond_viscosity_follows else (1.0, 1.0)
    assert 1e6 * bonds.damping == pytest.approx(made.viscosity * shares[0], rel=1e-15)
    assert 1e6 * bonds.tangential_damping == pytest.approx(made.tangential_viscosity * shares[1], rel=1e-15)


@pytest.mark.parametrize("which", range(len(CHANGES)))
def test_a_scene_with_bonds_gives_the_experiment_and_its_discs_back(which):
    experiment, discs = prepared(which, 4)
    found, back = ps.from_scene(ps.to_scene(experiment, discs))
    for field in dataclasses.fields(experiment):
        got, expected = getattr(found, field.name), getattr(experiment, field.name)
        assert got == (pytest.approx(expected, rel=1e-12) if isinstance(expected, float) else expected), field.name
    assert np.array_equal(back.position_nd, discs.position_nd) and np.array_equal(back.radius_n, discs.radius_n)
    assert back.mass_n == pytest.approx(discs.mass_n, rel=1e-12)
    assert np.array_equal(back.contact_ck, discs.contact_ck[discs.bonded_c]) and back.bonded_c.all()


@pytest.mark.parametrize("which", [0, 1, 3, 4, 6])
def test_a_scene_without_bonds_gives_the_same_contacts_and_discs_back(which):
    # nothing tells stiffer contacts from stiffer discs there
    experiment, discs = prepared(which, None)
    found, back = ps.from_scene(ps.to_scene(experiment, discs))
    assert found.material[:6] == pytest.approx(experiment.material[:6], rel=1e-12)
    assert found.frequency == pytest.approx(experiment.frequency, rel=1e-12)
    assert found.cooling == pytest.approx(experiment.cooling, rel=1e-12)
    assert np.array_equal(back.position_nd, discs.position_nd) and len(back.contact_ck) == 0


def test_a_scene_runs_natively_and_is_written_and_read(tmp_path):
    experiment = ps.ParticleShear(particles=30, pre_periods=0.0, periods=0.1, post_periods=0.0)
    scene = ps.to_scene(experiment, ps.prepared_discs(experiment, seed=2, steps=20), plates=False)
    run = pm.run(scene)
    assert run.ok and run.packing.particles == 30 and run.frequency == experiment.frequency
    pm.write_scene(scene, tmp_path / "a.toml")
    assert ps.from_scene(pm.read_scene(tmp_path / "a.toml"))[0] == ps.from_scene(scene)[0]


def test_what_the_reference_model_has_not_is_refused_by_name():
    experiment, discs = prepared(0, 4)
    scene = ps.to_scene(experiment, discs)
    with pytest.raises(ValueError, match="scene must have the effects of to_scene, got .*Gravity"):
        ps.from_scene(scene.replace(effects=(*scene.effects, pm.Gravity(0.0, -1.0))))
    with pytest.raises(ValueError, match="scene must have an oscillatory shear"):
        ps.from_scene(scene.replace(drive=None))
    labeled = scene.packing.replace(kind_n=np.arange(scene.packing.particles) % 2)
    with pytest.raises(ValueError, match="particles of one kind, got 2"):
        ps.from_scene(scene.replace(packing=labeled))
    hertzian = tuple(pm.Repulsion(pm.Hertz()) if isinstance(one, pm.Repulsion) else one for one in scene.effects)
    with pytest.raises(ValueError, match="scene must have a divergent repulsion, got Hertz"):
        ps.from_scene(scene.replace(effects=hertzian))
    longer = [
        dataclasses.replace(one, rest_length_b=1.1 * one.rest_length_b) if isinstance(one, pm.Bonds) else one
        for one in scene.effects
    ]
    with pytest.raises(ValueError, match="bonds of one material of the reference model"):
        ps.from_scene(scene.replace(effects=tuple(longer)))
    with pytest.raises(ValueError, match="discs must be of one density"):
        ps.to_scene(experiment, discs.replace(mass_n=np.ones(30)))
    with pytest.raises(ValueError, match="discs must be in the experiment's cell"):
        ps.to_scene(ps.ParticleShear(particles=30, width=400.0), discs)
