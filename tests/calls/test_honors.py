"""What calls do with what a scene holds: every public call is declared, and does with each effect as it is declared."""

import inspect
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import pytest

import packmech as pm
from packmech.calls.honors import CALLS, COLUMNS, EFFECTS, HONORED, INSTEAD, NOTHING, REFUSED, columns_of

# calls are declared as their modules are imported
for _name in dir(pm):
    getattr(pm, _name)

# public calls of a scene or a packing that change and measure nothing: they write, read or draw what they are given
NO_MECHANICS = {
    "write_scene", "write_packing", "write_table", "record_packing", "record_run", "write_pictures", "run",
    "settings_for",
    "to_ase", "to_freud", "to_hoomd", "snapshots",
}  # fmt: skip


@pm.effect
class Tug(NamedTuple):
    """An attraction beyond contact."""

    strength: float = 0.01

    def reach(self, contact_distance):
        return 1.3 * contact_distance

    def interaction_energy(self, distance, contact_distance, alignment):
        return -self.strength * (1.3 - distance / contact_distance) ** 3

    def interaction_first(self, distance, contact_distance, alignment):
        return 3.0 * self.strength * (1.3 - distance / contact_distance) ** 2 / contact_distance, 0.0

    def interaction_second(self, distance, contact_distance, alignment):
        return -6.0 * self.strength * (1.3 - distance / contact_distance) / contact_distance**2, 0.0, 0.0


def small():
    """Return a few discs that overlap a little, in a cell with room."""
    spot = np.array([[0.6, 0.62], [1.5, 0.6], [2.42, 0.7], [0.62, 1.5], [1.53, 1.52], [2.4, 1.6], [1.1, 2.3]])
    return pm.Packing(spot, np.full(7, 0.5), pm.Box.cubic(3.4, 2))


def effects(silent=None):
    """Return one effect of each column; the silent one acts with nothing, so that compiled code is the same."""
    packing = small()
    bonds = pm.bond_contacts(packing, gap_tolerance=-1e-3, damping=0.3)
    weak = pm.LinearSpring(1e-9)
    few = pm.Bonds(bonds.i_b[:2], bonds.j_b[:2], bonds.image_bd[:2], bonds.rest_length_b[:2] * 1.02, damping=0.3)
    none = pm.Bonds(
        few.i_b, few.j_b, few.image_bd, few.rest_length_b, weak, weak, tangential_stiffness=0.0, damping=0.0
    )
    return {
        "repulsion": pm.Repulsion(pm.Harmonic(1e-9 if silent == "repulsion" else 1.0)),
        "damping": pm.ContactDamping(0.0 if silent == "damping" else 0.2),
        "friction": pm.Friction(0.0 if silent == "friction" else 0.5),
        "rolling": pm.RollingResistance(0.0 if silent == "rolling" else 0.3),
        "bonds": none if silent == "bonds" else few,
        "interactions": Tug(0.0 if silent == "interactions" else 0.01),
        "gravity": pm.Gravity(0.0, 0.0) if silent == "gravity" else pm.Gravity(0.01, -0.02),
        "walls": pm.Walls(
            1.0,
            -9.0 if silent == "walls" else 0.15,
            9.0 if silent == "walls" else 3.2,
            friction=pm.Friction(0.0),
            rolling=pm.RollingResistance(0.0),
        ),
        "drag": pm.BackgroundDamping(0.0 if silent == "drag" else 0.1),
        "noise": pm.Langevin(0.0 if silent == "noise" else 1e-3, 0.0 if silent == "noise" else 0.1),
        "held": pm.FixedParticles(() if silent == "held" else (3,)),
    }


def scene_of(*columns, silent=None):
    held = effects(silent)
    return pm.Scene(small(), tuple(held[name] for name in columns))


def _settled(run):
    """Places, and what is left of forces: particles settle under a drag of its own, whatever the scene's."""
    return np.append(run.packing.position_nd, run.to_dict()["force_residual"])


SPIN = np.full((7, 1), 0.3)
COMMON = {"dt": 0.02, "spin_nk": SPIN, "check": False}
# a short call of each kind, as numbers
MOVING = {
    "simulate": lambda scene: pm.simulate(scene, steps=20, dt=0.02, spin_nk=SPIN, check=False).packing.position_nd,
    "equilibrate": lambda scene: _settled(
        pm.equilibrate(scene, amplitude=0.01, frequency=0.02, expected_stress=0.01, check=False)
    ),
    "oscillatory_shear": lambda scene: (
        pm.oscillatory_shear(
            scene, amplitude=0.01, frequency=1.0, periods=1.0, skip_periods=0.0, **COMMON
        ).packing.position_nd
    ),
    "ramp_strain": lambda scene: pm.ramp_strain(scene, rate=0.1, applied_strain=0.05, **COMMON).packing.position_nd,
    "shear_at_pressure": lambda scene: (
        pm.shear_at_pressure(
            scene, rate=0.05, pressure=0.01, applied_strain=0.05, skip_strain=0.0, dt=0.02, check=False
        ).packing.position_nd
    ),
    "deform_at_rate": lambda scene: (
        pm.deform_at_rate(
            scene, rate=0.05, strain={"xx": -0.05}, stress={"yy": -0.01}, dt=0.02, stress_tolerance=10.0, check=False
        ).packing.position_nd
    ),
    "shear_jam": lambda scene: (
        pm.shear_jam(
            scene, pressure=1e-4, step=0.01, largest_strain=0.01, step_limit=2000, check=False
        ).packing.position_nd
    ),
    "creep": lambda scene: pm.creep(scene, stress=0.01, duration=0.4, **COMMON).strain_t,
    "steady_shear": lambda scene: (
        pm.steady_shear(scene, rates=[0.1], applied_strain=0.05, skip_strain=0.0, blocks=2, dt=0.02, check=False)
        .runs[0]
        .packing.position_nd
    ),
}


def at_rest():
    """Return a packing that every call at rest takes."""
    return pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.01)


def with_shapes(scene):
    """Return the scene with ellipses, all along x, in place of discs."""
    n = scene.packing.particles
    return scene.replace(packing=scene.packing.replace(shapes=pm.Spheroids(np.full(n, 1.1), np.eye(2)[[0] * n])))


def _members_and_modes(found):
    return [found.contacts, found.bonds, found.links, found.floppy_modes, found.self_stresses]


RESTING = {
    "energy": pm.energy,
    "forces": pm.forces,
    "stress_tensor": pm.stress_tensor,
    "pressure": pm.pressure,
    "link_tension": pm.link_tension,
    "contact_forces": lambda scene: pm.contact_forces(scene).force_cd,
    "torques": pm.torques,
    "quench": lambda scene: pm.quench(scene, force_tolerance=1e-8).packing.position_nd,
    "settle": lambda scene: pm.settle(scene, force_tolerance=1e-8).packing.position_nd,
    "jam": lambda scene: pm.jam(scene, pressure=1e-4).packing.position_nd,
    "compress": lambda scene: pm.compress(scene, [1e-3])[0].packing.position_nd,
    "sweep_pressure": lambda scene: pm.sweep_pressure(scene, [1e-3])[0].packing.position_nd,
    "sweep_stress": lambda scene: pm.sweep_stress(scene, [-1e-3 * np.eye(2)])[0].packing.position_nd,
    "quasistatic_shear": lambda scene: pm.quasistatic_shear(scene, 1e-4, step=1e-4, locate="none").packing.position_nd,
    "deform": lambda scene: pm.deform(scene, strain={"xx": -1e-4}, steps=1).packing.position_nd,
    "shear_stabilize": lambda scene: pm.shear_stabilize(scene).packing.position_nd,
    "hessian": lambda scene: pm.hessian(scene).toarray(),
    "dynamical_matrix": lambda scene: pm.dynamical_matrix(scene).toarray(),
    "perturbation_energy": lambda scene: pm.perturbation_energy(scene, np.ones((scene.packing.particles, 2))),
    "normal_modes": lambda scene: pm.normal_modes(scene).frequency_m,
    "density_of_states": lambda scene: pm.density_of_states(scene).density_b,
    "count_modes": lambda scene: pm.count_modes(scene, 1.0).distance_v,
    "waves": lambda scene: pm.waves(scene, [[0.3, 0.1]]).frequency_km,
    "dispersion": lambda scene: pm.dispersion(scene, [[0.1, 0.0], [0.5, 0.2]], points=3).frequency_km,
    "sound_speeds": lambda scene: pm.sound_speeds(scene, [1.0, 0.3]).speed_m,
    "elastic_moduli": lambda scene: pm.elastic_moduli(scene).cauchy,
    "sensitivity": lambda scene: pm.sensitivity(scene, "pressure", "radius").gradient,
    "design": lambda scene: (
        pm.design(scene, "pressure", "radius", at_least=1e9, bounds=(0.01, 9.0), step_limit=1, check=False).value_t
    ),
    "quartic_modes": lambda scene: pm.quartic_modes(with_shapes(scene)).curvature_m,
    "second_order": lambda scene: _members_and_modes(pm.second_order(scene)),
    "stiffness_matrix": lambda scene: pm.stiffness_matrix(scene, "none").toarray(),
    "frictional_modes": lambda scene: pm.frictional_modes(scene).eigenvalue_m,
    "compliance_matrix": lambda scene: pm.compliance_matrix(scene),
    "wall_contacts": lambda scene: pm.wall_contacts(scene).force_w,
    "force_distribution": lambda scene: [pm.force_distribution(scene).mean],
    "force_chains": lambda scene: pm.force_chains(scene).stress_n,
    "coarse_grain": lambda scene: pm.coarse_grain(scene, 1.0).contact_stress_gdd,
    "cyclic_shear": lambda scene: pm.cyclic_shear(scene, 1e-4, step=1e-4)[0].packing.position_nd,
    "tap": lambda scene: pm.tap(scene, 1e-2, seed=1, pressure=1e-3, check=False)[0].packing.position_nd,
    "anneal_shape": lambda scene: pm.anneal_shape(scene, [1.1], seed=1, check=False)[0].packing.position_nd,
    "classify_jamming": lambda scene: [len(pm.classify_jamming(scene).strict)],
    "rigid_clusters": lambda scene: [*pm.rigid_clusters(scene).smallest_k, pm.rigid_clusters(scene).rows],
}


# honored by what they are made of, with the test that says so
ELSEWHERE = {
    "resume": "the same bits as simulate: tests/dynamics/test_checkpoint.py",
    "contact_dissipation": "the rate of a ledger: tests/dynamics/test_ledger.py",
    "amplitude_sweep": "runs of oscillatory_shear: tests/rheology/test_strained_checkpoints.py",
    "ShearBatch": "the bits of the packing alone: tests/dynamics/test_shear_batch.py",
    "QuenchBatch": "the bits of the packing alone: tests/minimize/test_quench_batch.py",
    "complex_modulus": "the moduli of oscillatory_shear: tests/mechanics/test_complex_modulus.py",
    "cement": "jam and moduli: tests/protocols/test_cement.py",
    "local_yield_stress": "a minimization by other means: tests/protocols/test_local_yield.py",
    "displaced_rest": "exact arithmetic: tests/hard_cases/tiny_pressures.py, laws by kinds: tests/hard_cases/rough.py",
    "export_scene": "energy and pressure, as other programs find them: tests/scenes/test_export.py",
    "play_motion": "geometry alone: tests/jamming/test_play.py",
}


def refuses(call, scene, match):
    """Check that a call refuses a scene before it asks for anything else."""
    function = getattr(pm, call)
    signature = inspect.signature(function)
    name = "scene" if "scene" in signature.parameters else next(iter(signature.parameters))
    given = {
        each.name: None
        for each in signature.parameters.values()
        if each.default is each.empty and each.kind is not each.VAR_KEYWORD and each.name != name
    }
    with pytest.raises(ValueError, match=match):
        function(**{name: [scene] if name == "scenes" else scene}, **given)


def test_every_public_call_of_a_scene_or_a_packing_is_declared():
    first = {}
    for name in dir(pm):
        value = getattr(pm, name)
        if inspect.isfunction(value):
            names = list(inspect.signature(value).parameters)
            if names and (names[0] in ("packing", "source", "subject", "scenes", "before") or "scene" in names):
                first[name] = names[0]
    assert set(first) - NO_MECHANICS <= set(CALLS)
    assert set(CALLS) - set(first) <= {"QuenchBatch", "ShearBatch"}
    assert {*MOVING, *RESTING, *ELSEWHERE} == {name for name in CALLS if not CALLS[name].packing_only}


@pytest.mark.parametrize("call", sorted(name for name in CALLS if not CALLS[name].packing_only))
def test_what_a_call_does_not_honor_is_refused_with_the_way_out(call):
    for column in EFFECTS:
        if CALLS[call].answer(column) != REFUSED:
            continue
        scene = scene_of(*{"repulsion": None, column: None})
        kind = type(scene.effects[-1])
        refuses(call, scene, rf"would ignore, got {kind.__name__} .*without\(pm.{kind.__name__}\)")
        assert scene.without(kind).effects == scene.effects[:-1]


def test_links_are_refused_by_calls_that_would_ignore_them():
    linked = small().replace(links=pm.Links([0], [1], [[0, 0]], [np.hypot(0.9, 0.02)]))
    refused = [name for name in CALLS if CALLS[name].answer("links") == REFUSED]
    assert "complex_modulus" in refused and "cement" not in refused and "simulate" not in refused
    for call in refused:
        packing_only = CALLS[call].packing_only
        subject = linked if packing_only else pm.Scene(linked, (pm.Repulsion(),))
        refuses(call, subject, f"no links for pm.{call}, which would ignore them, got 1")


def slack_bonds():
    """Return bonds between second neighbors as far apart as they are, which push nothing."""
    near = pm.find_contacts(at_rest(), gap_tolerance=0.8)
    far = near.distance_c > 1.2
    springs = {"tangential_stiffness": 0.0}
    return pm.Bonds(near.i_c[far], near.j_c[far], near.image_cd[far], near.distance_c[far], **springs)


# what a link or a shape may be beside in one scene
BESIDE = {
    "friction": (pm.Friction(0.5),),
    "bonds": (slack_bonds(),),
    "interactions": (Tug(),),
    "gravity": (pm.Walls(1, -9.0, 9.0), pm.Gravity(0.0, -0.01)),
    "walls": (pm.Walls(1, -9.0, 9.0),),
    "held": (pm.FixedParticles((3,)),),
}


# honored each by itself, and refused together by name
APART = {("sensitivity", "links", "friction"), ("design", "links", "friction")}


def test_calls_at_rest_take_what_they_honor_in_one_scene():
    """Calls that honor an effect and links or shapes take both together."""
    packing, wrong = at_rest(), []
    first = pm.find_contacts(packing).select(np.arange(1))
    links = pm.Links(first.i_c, first.j_c, first.image_cd, first.distance_c)
    # these take their time, and are asked elsewhere
    slow = {"quench", "jam", "settle", "anneal_shape"}
    calls = RESTING | {
        "hessian": lambda scene: pm.hessian(scene, "none"),
        "jam": lambda scene: pm.jam(scene, pressure=1e-4),
        "perturbation_energy": lambda scene: pm.perturbation_energy(
            scene, np.ones((9, 3 if scene.packing.shapes.has_orientations else 2))
        ),
    }
    for name in RESTING:
        for body in ("links", "shapes"):
            for effect, given in BESIDE.items():
                if not CALLS[name].answer(body) == CALLS[name].answer(effect) == HONORED:
                    continue
                scene = pm.Scene(packing.replace(links=links) if body == "links" else packing, (pm.Repulsion(), *given))
                scene = with_shapes(scene) if body == "shapes" else scene
                if name in slow:
                    continue
                try:
                    calls[name](scene)
                except ValueError as refusal:
                    if (name, body, effect) in APART:
                        assert "beside friction" in str(refusal)
                    else:
                        wrong.append(f"{name} refuses {body} with {effect}: {refusal}")
    assert not wrong, "\n".join(wrong)


@pytest.mark.parametrize("column", ["bonds", "interactions"])
def test_calls_at_rest_take_friction_beside_what_acts_beyond_contact(column):
    scene = pm.Scene(at_rest(), (pm.Repulsion(), pm.Friction(0.5), *BESIDE[column]))
    both = [name for name in RESTING if CALLS[name].answer(column) == CALLS[name].answer("friction") == HONORED]
    assert {"energy", "forces", "elastic_moduli", "stiffness_matrix", "frictional_modes"} <= set(both)
    # contacts at the Coulomb limit, and bonds beside friction, have no derivatives and are refused by name
    for name in set(both) - {"sensitivity"}:
        assert np.isfinite(np.asarray(RESTING[name](scene))).all()


def test_rough_walls_are_taken_or_refused():
    walls = pm.Walls(1.0, 0.15, 3.2, friction=pm.Friction(0.3), rolling=pm.RollingResistance(0.0))
    scene = pm.Scene(small(), (pm.Repulsion(), pm.Friction(0.5), pm.RollingResistance(0.1), walls))
    taken = {name for name in CALLS if CALLS[name].answer("rough") == HONORED}
    assert {"simulate", "settle", "forces", "torques", "energy", "contact_forces", "wall_contacts"} <= taken
    smooth = scene.replace(effects=(*scene.effects[:3], walls._replace(friction=pm.Friction(0.0))))
    for name in CALLS:
        honored = [CALLS[name].answer(each) == HONORED for each in ("repulsion", "friction", "rolling", "walls")]
        if CALLS[name].packing_only or not all(honored):
            continue
        if name not in taken:
            refuses(name, scene, f"must hold smooth walls for pm.{name}, which knows no rough ones, got Walls .*at 3")
        CALLS[name].check("scene", smooth)


def test_walls_that_move_and_walls_of_triangles_are_taken_or_refused():
    walls = pm.Walls(1.0, 0.15, 3.2, high_motion=pm.WallMotion(y=-0.1))
    moving = pm.Scene(small(), (pm.Repulsion(), walls))
    corner = [[0.1, 0.1, 0.1], [3.0, 0.1, 0.1], [0.1, 3.0, 0.1]]
    spheres = pm.Packing([[1.0, 1.0, 1.0]], [0.5], pm.Box.cubic(3.4, 3))
    mesh = pm.Scene(spheres, (pm.Repulsion(), pm.MeshWalls(corner, [[0, 1, 2]])))
    assert {name for name in CALLS if CALLS[name].answer("moving") == HONORED} == {"simulate", "resume"}
    taken = {name for name in CALLS if CALLS[name].answer("mesh") == HONORED}
    at_rest = {"energy", "forces", "torques", "contact_forces", "wall_contacts", "stiffness_matrix", "frictional_modes"}
    assert taken == {"simulate", "resume", "quench", "settle", *at_rest}
    for name in CALLS:
        if CALLS[name].packing_only or CALLS[name].answer("walls") != HONORED:
            continue
        if name not in ("simulate", "resume"):
            refuses(name, moving, f"must hold walls that stand still for pm.{name}, which moves none, got Walls .*at 1")
        CALLS[name].check("scene", moving.replace(effects=(moving.effects[0], walls.still)))
        if name not in taken:
            refuses(name, mesh, f"must hold nothing that pm.{name} would ignore, got MeshWalls at 1")


def test_rough_walls_change_what_calls_say_of_forces_torques_and_energies():
    packing = small()
    low = float(packing.position_nd[:, 1].min())
    near = np.flatnonzero(packing.position_nd[:, 1] < low + 0.3)
    # a plane's four numbers of each of the two walls
    stretch = np.zeros((len(near), 8))
    stretch[:, 0], stretch[:, 2] = 0.01, 0.02
    none, image = np.zeros(0, dtype=np.int64), np.zeros((0, 2), dtype=np.int64)
    held = pm.TangentialDisplacements(none, none, image, np.zeros((0, 1)), at_wall_w=near, wall_stretch_wk=stretch)
    walls = pm.Walls(1, low - 0.3, 99.0, friction=pm.Friction(0.9), rolling=pm.RollingResistance(0.9))
    smooth = walls._replace(friction=pm.Friction(0.0), rolling=None)
    one, other = (pm.Scene(packing.replace(tangential=held), (pm.Repulsion(), each)) for each in (walls, smooth))
    changed = {"energy", "forces", "torques", "wall_contacts", "stiffness_matrix"}
    # modes ask for what is at rest: tests/mechanics/test_stiffness_at_walls.py
    left_out = {"settle", "link_tension", "frictional_modes"}
    taken = {name for name in RESTING if CALLS[name].answer("rough") == HONORED} - left_out
    assert changed <= taken
    for name in taken:
        found, plain = (np.asarray(RESTING[name](scene)) for scene in (one, other))
        if name == "wall_contacts":
            found, plain = (pm.wall_contacts(scene).tangential_wd for scene in (one, other))
        assert bool(np.abs(found - plain).max() > 1e-9) is (name in changed), name


@pytest.mark.parametrize("call", sorted(MOVING))
def test_every_effect_changes_a_call_that_honors_it(call):
    """A compiled loop of all effects, and the same with one of them of no strength: the answers differ."""
    honored = [column for column in EFFECTS if CALLS[call].answer(column) == HONORED]
    # a box that deforms says nothing of where particles are held
    sheared = dict.fromkeys(("deform_at_rate", "shear_at_pressure", "shear_jam"), ("gravity", "walls", "held"))
    # at rest there is no noise
    sheared["shear_jam"] += ("noise",)
    left_out = {"simulate": (), "equilibrate": ("noise", "held"), **sheared}.get(call, ("held",))
    assert honored == [column for column in EFFECTS if column not in left_out]
    whole = MOVING[call](scene_of(*honored))
    assert np.isfinite(whole).all()
    for column in honored:
        changed = np.abs(MOVING[call](scene_of(*honored, silent=column)) - whole).max()
        assert changed > 1e-9, column


@pytest.mark.parametrize("call", sorted(RESTING))
def test_dashpots_and_drag_change_no_bit_of_what_is_at_rest(call):
    packing = at_rest()
    bare = np.asarray(RESTING[call](pm.Scene(packing, (pm.Repulsion(),))))
    assert [CALLS[call].answer(column) for column in ("damping", "drag")] == [NOTHING, NOTHING]
    damped = pm.Scene(packing, (pm.Repulsion(), pm.ContactDamping(0.4), pm.BackgroundDamping(0.3)))
    assert np.array_equal(np.asarray(RESTING[call](damped)), bare)


def test_friction_changes_every_call_at_rest_that_honors_it():
    contacts = pm.find_contacts(at_rest())
    springs = np.linspace(-1e-3, 1e-3, len(contacts))[:, None]
    packing = at_rest().replace(
        tangential=pm.TangentialDisplacements(contacts.i_c, contacts.j_c, contacts.image_cd, springs)
    )
    # what pressing does with friction takes its time: tests/protocols/test_press.py
    # what touches walls has no friction, and there are no links here: tests/mechanics/test_link_modes.py
    # derivatives are those of packings at rest: tests/mechanics/test_rough_sensitivity.py
    left_out = {"jam", "wall_contacts", "link_tension", "sensitivity"}
    honoring = [name for name in RESTING if CALLS[name].answer("friction") == HONORED and name not in left_out]
    assert {"contact_forces", "elastic_moduli", "frictional_modes", "stiffness_matrix", "torques"} <= set(honoring)
    for call in honoring:
        rough, slack = (
            np.asarray(RESTING[call](pm.Scene(packing, (pm.Repulsion(), pm.Friction(mu, 0.7))))) for mu in (0.5, 0.0)
        )
        # forces across the contacts have no part in the trace of the stress
        differs = rough.shape != slack.shape or np.abs(rough - slack).max() > 1e-9
        assert differs is not (call == "pressure"), call


def test_resistance_to_rolling_changes_what_calls_at_rest_say_of_torques_energies_and_stiffness():
    contacts = pm.find_contacts(at_rest())
    springs = np.linspace(-1e-3, 1e-3, len(contacts))[:, None]
    packing = at_rest().replace(
        tangential=pm.TangentialDisplacements(
            contacts.i_c, contacts.j_c, contacts.image_cd, 0.1 * springs, rolling_ck=springs
        )
    )
    left_out = {"jam", "settle", "wall_contacts", "link_tension"}
    honoring = [name for name in RESTING if CALLS[name].answer("rolling") == HONORED and name not in left_out]
    assert {"contact_forces", "elastic_moduli", "frictional_modes", "stiffness_matrix", "torques"} <= set(honoring)
    changed = {"energy", "torques", "elastic_moduli", "frictional_modes", "stiffness_matrix", "rigid_clusters"}
    for call in honoring:
        effects = (pm.Repulsion(), pm.Friction(0.5, 0.7), pm.RollingResistance(0.3, 0.7))
        one, other = (np.asarray(RESTING[call](pm.Scene(packing, given))) for given in (effects, effects[:2]))
        differs = one.shape != other.shape or np.abs(one - other).max() > 1e-9
        assert bool(differs) is (call in changed), call


def test_bonds_change_every_call_at_rest_that_honors_them():
    packing = at_rest()
    bonds = pm.bond_contacts(packing, compression=pm.Hertz(), tangential_stiffness=0.0)
    # all contacts alike, so that it stays at rest
    effects = (pm.Repulsion(), bonds)
    # there are no links here, and what acts on centers turns nothing
    honoring = [name for name in RESTING if CALLS[name].answer("bonds") == HONORED and name != "link_tension"]
    assert {"energy", "forces", "hessian", "normal_modes", "elastic_moduli"} <= set(honoring)
    for call in honoring:
        one, other = (np.asarray(RESTING[call](pm.Scene(packing, given))) for given in (effects, effects[:1]))
        differs = one.shape != other.shape or np.abs(one - other).max() > 1e-9
        assert differs is not (call == "torques"), call


def test_laws_by_kinds_change_every_call_at_rest_that_honors_them():
    """Rows of a triangular lattice are of two kinds in turn, so that it stays at rest; equal laws change nothing."""
    rows = np.rint(at_rest().position_nd[:, 1] / np.diff(np.unique(at_rest().position_nd[:, 1].round(9)))[0])
    packing = at_rest().replace(kind_n=(rows % 2).astype(int))
    soft, hard = pm.Harmonic(1.0), pm.Harmonic(3.0)
    same, other = (pm.LawByKind([[soft, soft], [soft, one]]) for one in (soft, hard))
    assert all(one.answer("kinds") == HONORED for one in CALLS.values() if one.answer("repulsion") == HONORED)
    # there are no links and walls here; what is at rest stays there, and no weight presses it
    still = {"link_tension", "wall_contacts", "torques", "forces", "quench", "settle", "classify_jamming"}
    # what strains a lattice moves its particles with the box; all pushed alike, they store nothing; and without modes
    still |= {"compress", "deform", "perturbation_energy", "quartic_modes", "rigid_clusters", "second_order"}
    wrong = []
    for call in RESTING:
        plain, equal, mixed = (
            np.asarray(RESTING[call](pm.Scene(packing, (pm.Repulsion(law),)))) for law in (soft, same, other)
        )
        # products and sums of shapes are rounded once or twice, as the compiler fuses them
        digits = 1e-12 if call == "anneal_shape" else 0.0
        np.testing.assert_allclose(plain, equal, rtol=0.0, atol=digits, err_msg=call)
        differs = plain.shape != mixed.shape or np.abs(plain - mixed).max(initial=0.0) > 1e-9
        if bool(differs) is (call in still):
            wrong.append(call)
    assert not wrong


def test_bonds_that_break_are_refused_where_none_would_and_change_what_honors_them():
    lasting = pm.bond_contacts(small(), gap_tolerance=-1e-3, damping=0.3)
    weak = replace(lasting, breaks_at=pm.BondLimits(stretch=1e-6, squeeze=1e-6))
    scene = pm.Scene(small(), (pm.Repulsion(), weak))
    whole = scene.replace(effects=(pm.Repulsion(), weak.unbreakable()))
    now = {"energy", "forces", "torques", "stress_tensor", "pressure", "link_tension", "coarse_grain"}
    in_time = {"simulate", "resume", "ramp_strain", "steady_shear", "creep", "oscillatory_shear", "amplitude_sweep"}
    in_time |= {"contact_dissipation"}
    assert {name for name in CALLS if CALLS[name].answer("breaking") == HONORED} == now | in_time
    for name in CALLS:
        if CALLS[name].answer("bonds") == HONORED and name not in now | in_time and name != "ShearBatch":
            refuses(name, scene, rf"no bonds that break for pm.{name}, .*bonds.unbreakable\(\), or use pm.simulate")
    with pytest.raises(ValueError, match="no bonds that break for pm.ShearBatch"):
        pm.ShearBatch([scene], control="strain", dt=0.02)
    # what is there now does not depend on what may break later
    assert all(np.array_equal(RESTING[name](scene), RESTING[name](whole)) for name in now)
    # limits that nothing reaches, so that compiled code is the same
    strong = scene.replace(effects=(pm.Repulsion(), replace(weak, breaks_at=pm.BondLimits(stretch=1e6, squeeze=0.999))))
    for name in in_time & set(MOVING):
        assert np.abs(MOVING[name](scene) - MOVING[name](strong)).max() > 1e-9, name


def test_what_is_remembered_changes_what_honors_it_and_is_refused_elsewhere():
    packing = pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=-0.002)
    packing = packing.replace(position_nd=packing.position_nd + 1e-4 * np.cos(np.arange(18.0)).reshape(9, 2))
    near = pm.find_contacts(packing, gap_tolerance=0.1)
    ones = np.ones((len(near), 1))
    held = pm.TangentialDisplacements(near.i_c, near.j_c, near.image_cd, 0.0 * ones, memory_ck=ones)
    scene = pm.Scene(packing.replace(tangential=held), (pm.JKR(1.0, 0.01),))
    now = {"energy", "forces", "torques", "stress_tensor", "pressure", "link_tension", "coarse_grain", "hessian"}
    now |= {"dynamical_matrix", "perturbation_energy", "normal_modes", "density_of_states", "count_modes"}
    now |= {"elastic_moduli", "compliance_matrix", "waves", "dispersion", "sound_speeds"}
    assert {name for name in CALLS if CALLS[name].answer("memory") == HONORED} == now | {"simulate", "resume"}
    # a translation takes no energy
    for call in now - {"link_tension", "torques", "perturbation_energy"}:
        found = np.asarray(RESTING[call](scene))
        try:
            other = np.asarray(RESTING[call](pm.Scene(packing, scene.effects)))
        except ValueError:
            # nothing holds what is not bound
            continue
        assert found.shape != other.shape or np.abs(found - other).max() > 1e-9, call
    for name in CALLS:
        if CALLS[name].answer("interactions") == HONORED and name not in now | {"simulate", "resume", "ShearBatch"}:
            # the way out is a call that honors all that it is, a force of its own range and a memory
            refuses(name, scene, rf"nothing that pm.{name} would ignore, got JKR at 0.*, or use pm.simulate$")


# effects on single particles have no strain of the box
IN_A_FIXED_BOX = RESTING | {
    "hessian": lambda scene: pm.hessian(scene, "none").toarray(),
}


@pytest.mark.parametrize("column", ["gravity", "walls", "held"])
def test_effects_on_single_particles_change_every_call_at_rest_that_honors_them(column):
    lattice = at_rest()
    packing = lattice.replace(position_nd=lattice.position_nd + 1e-3 * np.cos(np.arange(18.0)).reshape(9, 2))
    low = float(packing.position_nd[:, 1].min())
    floor = pm.Walls(1, low - 0.3, 99.0)
    acting, silent = {
        "gravity": ((floor, pm.Gravity(0.0, -0.01)), (floor, pm.Gravity(0.0, 0.0))),
        "walls": ((floor,), (pm.Walls(1, -99.0, 99.0),)),
        "held": ((pm.FixedParticles((3,)),), (pm.FixedParticles(()),)),
    }[column]
    # there are no links here: tests/mechanics/test_link_modes.py
    honoring = [name for name in IN_A_FIXED_BOX if CALLS[name].answer(column) == HONORED and name != "link_tension"]
    assert {"energy", "forces", "hessian", "normal_modes", "quench"} <= set(honoring)
    # contacts between particles have no part in what single ones are pushed by, weights no curvature, held no energy
    unchanged = {"stress_tensor", "pressure", "contact_forces", "torques", "force_distribution", "force_chains"}
    unchanged |= {"coarse_grain"} | {
        "gravity": {"hessian", "dynamical_matrix", "perturbation_energy", "wall_contacts"},
        "walls": set(),
        "held": {"energy", "wall_contacts"},
    }[column]
    for call in honoring:
        one, other = (
            np.asarray(IN_A_FIXED_BOX[call](pm.Scene(packing, (pm.Repulsion(), *given)))) for given in (acting, silent)
        )
        differs = one.shape != other.shape or np.abs(one - other).max(initial=0.0) > 1e-9
        assert differs is not (call in unchanged), call


@pytest.mark.parametrize("column", ["gravity", "walls", "held"])
def test_effects_on_single_particles_change_what_calls_say_of_shapes(column):
    """Quenches of shapes on floors are in tests/effects/test_shapes_on_walls.py, which compiles as many loops."""
    lattice = pm.lattice_packing("triangular", repeats=(3, 3), relative_overlap=0.08)
    n = lattice.particles
    angle = 0.3 + 0.1 * np.arange(n)
    shapes = pm.Spheroids(np.full(n, 1.1), np.column_stack([np.cos(angle), np.sin(angle)]))
    packing = lattice.replace(position_nd=lattice.position_nd + 1e-3 * np.cos(np.arange(2.0 * n)).reshape(n, 2))
    packing = packing.replace(shapes=shapes)
    floor = pm.Walls(1, float(packing.position_nd[:, 1].min()) - 0.3, 99.0)
    acting, silent = {
        "gravity": ((floor, pm.Gravity(0.0, -0.01)), (floor, pm.Gravity(0.0, 0.0))),
        "walls": ((floor,), (pm.Walls(1, -99.0, 99.0),)),
        "held": ((pm.FixedParticles((3,)),), (pm.FixedParticles(()),)),
    }[column]
    calls = IN_A_FIXED_BOX | {
        "perturbation_energy": lambda scene: pm.perturbation_energy(scene, np.ones((n, 3))),
    }
    honoring = [
        name
        for name in calls
        if CALLS[name].answer(column) == CALLS[name].answer("shapes") == HONORED and name != "quench"
    ]
    assert {"energy", "forces", "torques", "hessian", "normal_modes"} <= set(honoring)
    unchanged = {"stress_tensor", "pressure"} | {
        "gravity": {"hessian", "dynamical_matrix", "perturbation_energy", "wall_contacts", "torques"},
        "walls": set(),
        "held": {"energy", "wall_contacts"},
    }[column]
    for call in honoring:
        one, other = (
            np.asarray(calls[call](pm.Scene(packing, (pm.Repulsion(), *given)))) for given in (acting, silent)
        )
        differs = one.shape != other.shape or np.abs(one - other).max(initial=0.0) > 1e-9
        assert differs is not (call in unchanged), call


def test_what_is_said_to_be_used_instead_honors_what_was_refused():
    for column, words in INSTEAD.items():
        for call in words.replace("pm.", "").split(" or "):
            assert CALLS[call].answer(column) == HONORED, (column, call)
    for one in CALLS.values():
        for column in INSTEAD:
            for call in one.instead(column).replace("pm.", "").split(" or "):
                assert CALLS[call].answer(column) == HONORED, (one.call, column, call)
    with pytest.raises(ValueError, match=r"got Friction at 1.* or use pm.stiffness_matrix"):
        pm.hessian(scene_of("repulsion", "friction"))


def test_effects_of_ones_own_belong_where_their_hooks_say():
    own = {column: columns_of(one) for column, one in effects().items()}
    assert own == {column: (column,) for column in EFFECTS}
    assert set(own) < set(COLUMNS)


def test_a_push_without_a_potential_is_no_drag():
    """What pushes particles at rest is refused by calls at rest, though it says nothing of an energy."""

    @pm.effect
    class SteadyPush(NamedTuple):
        force: float = 1.0

        def body_force(self, x, y, z, u, v, w, mass, radius):
            return self.force, 0.0, 0.0

    assert columns_of(SteadyPush()) == ("gravity",)
    assert columns_of(SteadyPush(0.0)) == ("drag",)
    with pytest.raises(ValueError, match="would ignore, got .*SteadyPush"):
        pm.forces(pm.Scene(small(), (pm.Repulsion(), SteadyPush())))


def test_a_column_that_is_none_is_refused_where_the_effect_is_registered():
    class Odd(NamedTuple):
        rate: float = 0.1

        def spin_drag(self):
            return self.rate

    Odd.acts_as = "Drag"
    with pytest.raises(ValueError, match="acts_as must be one of repulsion, .*, got 'Drag'"):
        pm.effect(Odd)
