"""Facts about `pm.plot`: given axes come back, labelled with units, with a legend where there are several lines."""

import dataclasses
import functools

import matplotlib
import matplotlib.pyplot as plt
import numpy as np
import pytest

import packmech as pm
from packmech.plotting.plot import _FIGURES

matplotlib.use("agg")


def discs(particles=16, fraction=0.9, seed=1):
    packing = pm.random_packing(particles, dimension=2, packing_fraction=fraction, seed=seed)
    return pm.Scene(packing, (pm.Repulsion(),))


@functools.cache
def jammed(pressure=1e-3):
    return discs().replace(packing=pm.jam(discs(), pressure).packing)


@functools.cache
def damped():
    scene = jammed()
    return scene.replace(effects=(*scene.effects, pm.BackgroundDamping(0.2)))


@functools.cache
def kagome():
    packing = pm.lattice_packing("kagome", repeats=(2, 2))
    return packing, pm.classify_jamming(packing)


def square(dt):
    return dt**2


def shells(packing):
    index = pm.wave_indices(packing.box, 8.0)
    return pm.shell_average(packing.box, index, pm.structure_factor(packing, index))


def correlation(packing):
    return pm.correlation_function(packing, pm.bond_orientational_order(packing, 6).component_nm[:, 0])


def path(steps=20):
    """Return packings of which every next one is moved at random."""
    rng, start = np.random.default_rng(2), jammed().packing
    moved = np.cumsum(0.02 * rng.standard_normal((steps, *start.position_nd.shape)), axis=0)
    return [start.replace(position_nd=start.position_nd + one) for one in moved]


# what is drawn, how often its curve has a name, and a word that its x axis has
CURVES = {
    "density of states": (lambda: pm.density_of_states(jammed(), 8), "1/time"),
    "numbers of modes": (lambda: pm.count_modes(jammed(), [0.5, 1.0, 2.0]), "1/time"),
    "dispersion": (lambda: pm.dispersion(jammed(), [[0, 0], [0.5, 0], [0.5, 0.5]], points=8), "reciprocal lattice"),
    "waves": (lambda: pm.waves(jammed(), [[0.1, 0.2], [0.3, 0.3]], count=4), "1/length"),
    "sound": (lambda: pm.sound_speeds(jammed(), [1.0, 0.5]), "length/time"),
    "pair distribution": (lambda: pm.pair_distribution(jammed().packing, r_max=3.0, bins=30), "length"),
    "shell average": (lambda: shells(jammed().packing), "1/length"),
    "correlation": (lambda: correlation(jammed().packing), "length"),
    "forces": (lambda: pm.force_distribution(jammed(), bins=10), "mean contact force"),
    "histogram": (lambda: pm.histogram(np.random.default_rng(1).normal(size=100)), "value"),
    "quasistatic shear": (lambda: pm.quasistatic_shear(jammed(), 4e-3, step=2e-3), "strain"),
    "deformation": (lambda: pm.deform(jammed(), strain={"yy": -4e-3}, stress={"xx": -1e-3}, steps=2), "strain"),
    "ramp": (lambda: pm.ramp_strain(damped(), rate=0.1, applied_strain=0.02), "strain"),
    "oscillation": (lambda: pm.oscillatory_shear(damped(), amplitude=1e-3, frequency=0.05, periods=2), "strain"),
    "creep": (lambda: pm.creep(damped(), stress=1e-4, duration=5.0), "time"),
    "flow curve": (
        lambda: pm.steady_shear(damped(), rates=[0.1, 0.2], applied_strain=0.5, skip_strain=0.1, check=False),
        "1/time",
    ),
    "mean square displacement": (lambda: pm.mean_square_displacement(path()), "time"),
    "self-intermediate scattering": (lambda: pm.self_scattering(path(), 6.0), "time"),
    "trace": (lambda: pm.simulate(damped(), duration=5.0, trace_every=5).trace, "time"),
}
OTHERS = {
    "modes": (lambda: pm.normal_modes(jammed(), 5), "mode"),
    "played motion": (lambda: pm.play_motion(kagome()[0], kagome()[1].unjamming_motion, steps=4), "diameter"),
    "contacts": (lambda: pm.contact_statistics(jammed().packing), "contacts"),
    "families": (lambda: pm.shear_families(pm.jam(discs(10), strain="isotropic").packing, 0.004), "strain"),
    "complex modulus": (lambda: pm.complex_modulus(damped(), [0.01, 0.1]), "1/time"),
    "amplitude sweep": (
        lambda: pm.amplitude_sweep(damped(), amplitudes=[1e-3, 2e-3], frequency=0.05, periods=2),
        "amplitude",
    ),
    "work and precision": (lambda: pm.work_precision({"a": square}, [0.1, 0.05], 0.0), "CPU time"),
}


def rendered(ax):
    ax.figure.canvas.draw()
    picture = np.asarray(ax.figure.canvas.buffer_rgba())
    plt.close(ax.figure)
    return picture[..., :3].std() > 1.0


@pytest.mark.parametrize("kind", [*CURVES, *OTHERS])
def test_axes_are_those_given_and_their_labels_say_quantity_and_unit(kind):
    make, word = (CURVES | OTHERS)[kind]
    ax = plt.subplots()[1]
    assert pm.plot(make(), ax) is ax
    assert word in ax.get_xlabel() and ax.get_ylabel()
    assert rendered(ax)


@pytest.mark.parametrize("kind", CURVES)
def test_curves_with_labels_share_axes_in_two_colors_with_a_legend_and_without_the_title_of_one(kind):
    thing = CURVES[kind][0]()
    ax = pm.plot(thing, label="first")
    pm.plot(thing, ax, label="second")
    handles, labels = ax.get_legend_handles_labels()
    assert labels == ["first", "second"]
    assert [one.get_text() for one in ax.get_legend().get_texts()] == labels
    assert ax.get_title() == ""
    shown = [getattr(one, "lines", [one])[0] for one in handles]
    color = [one.get_facecolor() if hasattr(one, "get_facecolor") else one.get_color() for one in shown]
    color = [one.get_edgecolor() if c[-1] == 0.0 else c for one, c in zip(shown, color, strict=True)]
    assert matplotlib.colors.to_hex(color[0]) != matplotlib.colors.to_hex(color[1])
    assert rendered(ax)


def test_corners_of_a_path_are_named_as_fractions_and_speeds_lie_along_their_direction():
    ax = pm.plot(pm.dispersion(jammed(), [[0, 0], [0.5, 0], [2 / 3, 1 / 3], [0.1234567, 0]], points=8, count=3))
    assert [one.get_text() for one in ax.get_xticklabels()] == ["0", "(1/2, 0)", "(2/3, 1/3)", "(0.123, 0)"]
    assert rendered(ax)
    direction = np.array([0.6, -0.8])
    sound = pm.sound_speeds(jammed(), direction)
    ax = pm.plot(sound, label="jammed")
    drawn = [one.get_xydata()[0] for one in ax.get_lines() if one.get_marker() in "ox"]
    np.testing.assert_allclose(drawn, np.abs(sound.speed_m)[:, None] * direction, atol=1e-12)
    pm.plot(pm.sound_speeds(jammed(), [1.0, 0.0]), ax, label="jammed")
    assert ax.get_legend_handles_labels()[1] == ["jammed"] and rendered(ax)
    uncertain = pm.count_modes(jammed(), pm.normal_modes(jammed(), 3).frequency_m)
    assert not uncertain.certain_v.all() and rendered(pm.plot(uncertain))


@pytest.mark.parametrize("kind", ["complex modulus", "amplitude sweep", "work and precision"])
def test_several_lines_have_a_legend(kind):
    ax = pm.plot(OTHERS[kind][0]())
    assert ax.get_legend() is not None
    assert rendered(ax)


def test_statistics_have_a_line_for_each_group_and_the_power_law_beside_it(tmp_path):
    def measure(size, kind, seed):
        return size**2.0 * (1.0 + 0.01 * seed) * kind

    grid = {"size": [1, 2, 4], "kind": [1, 2], "seed": range(3)}
    found = pm.run_ensemble(measure, grid, tmp_path / "out", workers=0)
    mean = pm.group_statistics(found, "value", ["size", "kind"])
    ax = pm.plot(mean, over="size", label="area")
    assert [one.get_text() for one in ax.get_legend().get_texts()] == ["area, kind = 1", "area, kind = 2"]
    assert rendered(ax)
    one = pm.group_statistics(found.where(kind=1), "value", ["size"])
    free, limit = (pm.fit_power_law(one.by["size"], one.value_g, one.error_g, exponent=e) for e in (None, 2.0))
    words = [pm.plot(one, fit=fit).get_legend().get_texts()[0].get_text() for fit in (free, limit, True)]
    assert words[0].startswith("exponent 2.0") and words[1].startswith("limit") and words[2] == words[0]
    with pytest.raises(TypeError, match="fit must be a PowerLawFit"):
        pm.plot(one, fit=2.0)
    plt.close("all")


@pytest.mark.parametrize(
    "options", [{}, {"forces": False}, {"color": "size"}, {"color": "kind"}, {"copies": False, "bar": False}]
)
def test_a_packing_a_scene_and_a_run_are_drawn_to_scale(options):
    scene = jammed()
    for thing in (scene.packing, scene, pm.quench(scene, force_tolerance=1e-6)):
        ax = pm.plot(thing, **options)
        assert ax.get_aspect() == 1.0 and len(ax.collections) > 0
        assert rendered(ax)


def test_spheres_ellipses_and_links_are_drawn():
    given = {"packing_fraction": 0.4, "seed": 1}
    spheres = pm.random_packing(20, dimension=3, **given)
    ellipses = pm.random_packing(20, dimension=2, shapes=pm.Ellipses(1.5), **given)
    linked = pm.cluster_packing(5, pm.Dimer(), dimension=2, **given)
    for packing in (spheres, ellipses, linked):
        assert rendered(pm.plot(packing))


def test_every_scalar_of_a_trace_is_drawn_and_others_are_refused_by_name():
    trace = pm.quench(discs(), force_tolerance=1e-6, trace_every=5).trace
    assert pm.plot(trace, of="pressure", log=True).get_ylabel() == "pressure"
    with pytest.raises(ValueError, match="of must be one of .*energy.*did you mean 'energy'"):
        pm.plot(trace, of="enrgy")
    plt.close("all")


def test_a_packing_with_friction_is_drawn_alone_and_with_what_acts_in_it():
    effects = (pm.Repulsion(pm.LinearSpring()), pm.ContactDamping(0.3), pm.Friction(0.5, damping=0.1))
    loose = pm.Scene(discs(16, 0.7).packing, effects)
    packing = pm.jam(loose, pressure=1e-2, method=pm.Press(rate=1e-2), check=False).packing
    assert packing.tangential is not None
    for thing in (packing, loose.replace(packing=packing)):
        assert rendered(pm.plot(thing))


def test_modes_and_motions_are_arrows_on_their_packing():
    packing, verdict = kagome()
    for ax in (
        pm.plot(verdict, packing=packing),
        pm.plot(verdict.unjamming_motion, packing=packing),
        pm.plot(pm.normal_modes(jammed(), 3), packing=jammed(), mode=1),
    ):
        assert any(type(one).__name__ == "Quiver" for one in ax.collections)
        assert ax.get_title() and rendered(ax)


def test_errors_are_drawn_against_the_setting_where_that_is_asked():
    found = pm.work_precision(lambda h: h**2, [0.1, 0.05, 0.025], 0.0, knob="time step")
    ax = pm.plot(found, over="setting")
    assert ax.get_xlabel() == "time step"
    np.testing.assert_allclose(ax.lines[0].get_xydata(), [[h, h**2] for h in (0.1, 0.05, 0.025)])
    with pytest.raises(ValueError, match="over must be"):
        pm.plot(found, over="steps")


def test_an_avalanche_is_drawn_around_its_place():
    start = pm.random_packing(32, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.8, seed=1)
    scene = pm.Scene(start, (pm.Repulsion(),))
    scene = scene.replace(packing=pm.jam(scene, pressure=1e-3).packing)
    event = pm.quasistatic_shear(scene, 0.04, step=2e-3, locate="none").avalanches[0]
    ax = pm.plot(event)
    ring = ax.lines[-1].get_xydata()
    assert np.allclose(ring, event.before.wrapped().position_nd[event.particle])
    assert f"{event.strain:.5g}" in ax.get_title()


def test_displacements_local_strains_and_fields_are_drawn_on_their_packing():
    before, after = path(2)
    moved, local = pm.displacements(before, after), pm.local_strain(before, after)
    ax = pm.plot(moved, packing=before)
    assert any(type(one).__name__ == "Quiver" for one in ax.collections) and rendered(ax)
    assert rendered(pm.plot(local, packing=jammed()))
    with pytest.raises(TypeError, match="packing must be the packing of this local strain"):
        pm.plot(local)
    fields = pm.coarse_grain(jammed(), 0.5)
    for of in ("pressure", "density"):
        ax = pm.plot(fields, of=of)
        mesh = ax.collections[0]
        # the field once, and its first row and column again
        assert mesh.get_array().size == (fields.shape[0] + 1) * (fields.shape[1] + 1)
        assert mesh.get_array().max() == getattr(fields, f"{of}_g").max() and rendered(ax)
    with pytest.raises(ValueError, match="of must be"):
        pm.plot(fields, of="stress")
    with pytest.raises(ValueError, match="fields must be on points of a plane"):
        pm.plot(pm.coarse_grain(pm.Scene(pm.lattice_packing("fcc"), (pm.Repulsion(),)), 1.0))


def test_what_has_no_figure_and_what_is_no_option_are_refused_by_name():
    with pytest.raises(TypeError, match="thing must be one of .*Packing"):
        pm.plot(3)
    with pytest.raises(TypeError, match="figure of Packing: has no argument 'colour'; did you mean 'color'"):
        pm.plot(jammed().packing, colour="size")
    with pytest.raises(TypeError, match="ax must be one matplotlib Axes"):
        pm.plot(jammed(), plt.subplots(1, 2)[1])
    plt.close("all")


def test_a_picture_beside_a_result_is_made_of_every_kind_that_has_one():
    from packmech.plotting.plot import picture_of

    assert picture_of(3) == ""
    assert {type(one) for one in (jammed(), jammed().packing)} <= set(_FIGURES)
    for thing in (jammed(), jammed().packing, pm.density_of_states(jammed(), 8)):
        assert picture_of(thing).startswith("<div><svg")


def test_copies_that_unjam_are_drawn_with_their_motion_and_others_with_the_reason():
    start = pm.random_packing(24, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.8, seed=1)
    run = pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=1e-9, strain="isotropic", check=False)
    verdict = pm.classify_jamming(run.packing, tiled=True)
    count = 24 * int(np.prod(verdict.tiled.repeats))
    assert verdict.collective == "jammed" and count > 24
    for ax in (pm.plot(verdict), pm.plot(verdict.tiled)):
        (arrows,) = [one for one in ax.collections if type(one).__name__ == "Quiver"]
        motion = np.column_stack([arrows.U, arrows.V])
        assert len(motion) == count and np.abs(motion).max() > 0.0
        # in one box nothing moves: copies of a particle move apart
        assert np.abs(motion.reshape(-1, 24, 2) - motion[:24]).max() > 0.1 * np.abs(motion).max()
        assert "copies: collectively not jammed" in ax.get_title() and rendered(ax)
    held = pm.classify_jamming(pm.lattice_packing("triangular", (3, 3)), tiled=(2, 2))
    for ax in (pm.plot(held), pm.plot(held.tiled, packing=held.packing)):
        assert "2 x 2 copies: collectively jammed" in ax.get_title() and "full rank" in ax.get_title()
        assert not [one for one in ax.collections if type(one).__name__ == "Quiver"]
    with pytest.raises(TypeError, match=r"packing must be the packing of this answer for pm.plot, pm.plot\(answer"):
        pm.plot(held.tiled)
    # the reason is whole where it is printed
    assert str(verdict.tiled).endswith(verdict.tiled.reason)


def test_verdicts_moduli_and_contact_forces_have_figures():
    packing, loose = kagome()
    tight = pm.classify_jamming(jammed())
    for verdict, arrows in ((loose, True), (tight, False)):
        ax = pm.plot(verdict)
        assert any(type(one).__name__ == "Quiver" for one in ax.collections) is arrows
        # a line for each contact, two where it crosses the edge
        lines = next(one for one in ax.collections if type(one).__name__ == "LineCollection")
        assert len(lines.get_segments()) >= len(verdict.network)
        assert verdict.collective in ax.get_title() and rendered(ax)
    with pytest.raises(TypeError, match=r"packing must be the packing of this motion for pm.plot, pm.plot\(motion"):
        pm.plot(loose.unjamming_motion)
    assert rendered(pm.plot(pm.contact_forces(jammed())))
    moduli = pm.elastic_moduli(jammed())
    ax = pm.plot(moduli, tangent="energy")
    assert [one.get_text() for one in ax.texts][0] == f"{moduli.energy[0, 0]:.3g}"
    assert len(ax.texts) == 9 and ax.get_xlabel() == "strain" and rendered(ax)


def test_negative_moduli_are_empty_marks_on_a_logarithmic_axis():
    found = dataclasses.replace(OTHERS["complex modulus"][0](), frequency_f=np.array([0.1, 0.2]))
    value_f = np.array([-2.0, 3.0]) + 0.5j
    ax = pm.plot(dataclasses.replace(found, modulus_f=value_f))
    shown = {line.get_label(): line for line in ax.get_lines()}
    np.testing.assert_array_equal(shown["$G'$"].get_ydata(), [np.nan, 3.0])
    below = shown["$-$$G'$ (negative)"]
    assert below.get_ydata().tolist() == [2.0] and below.get_markerfacecolor() == "none"
    plt.close("all")


def test_particles_are_colored_by_kind_with_a_legend_that_names_those_there_are():
    packing = pm.lattice_packing("square", repeats=(3, 2)).replace(kind_n=[0, 2, 0, 2, 2, 5])
    ax = pm.plot(packing, color="kind", copies=False)
    assert [text.get_text() for text in ax.get_legend().get_texts()] == ["kind 0", "kind 2", "kind 5"]
    fill = max((one.get_facecolor() for one in ax.collections), key=len)
    assert len(fill) == 6
    same = (fill[:, None] == fill[None]).all(axis=2)
    assert (same == (packing.kind_n[:, None] == packing.kind_n)).all()
