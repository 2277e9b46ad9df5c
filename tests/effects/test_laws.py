"""Facts about laws of repulsion: closed forms, derivatives, limits, and a user's own law treated as a built-in one."""

import json
import math
import pathlib
from decimal import Decimal, localcontext
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba.core.errors import NumbaError

import packmech as pm
from packmech.effects import contact_terms, energy_scale_of, equal_touches
from packmech.effects.laws import check_law
from packmech.effects.pair import check_effect
from packmech.jit.source_key import source_key
from packmech.minimize.program import build_program

GOLDEN = json.loads((pathlib.Path(__file__).parents[1] / "golden" / "potentials.json").read_text())
GOLDEN_LAWS = {"spring2": pm.Harmonic(), "hertz2.5": pm.Hertz(), "rlj": pm.RepulsiveLennardJones()}
EPSILON = float(np.finfo(float).eps)


@pytest.fixture(autouse=True)
def precise_decimals():
    with localcontext(prec=90):
        yield


@pm.law
class Quartic(NamedTuple):
    """A user's law, written as the documentation says."""

    energy_scale: float = 1.0

    def energy(self, distance, contact_distance):
        return self.energy_scale * (1.0 - distance / contact_distance) ** 4 / 4.0

    def first(self, distance, contact_distance):
        return -self.energy_scale * (1.0 - distance / contact_distance) ** 3 / contact_distance

    def second(self, distance, contact_distance):
        return 3.0 * self.energy_scale * (1.0 - distance / contact_distance) ** 2 / contact_distance**2


# energy of each law as a formula of exact decimal numbers: r, sigma -> u
def _power(scale, exponent):
    return lambda r, sigma: Decimal(scale) / Decimal(exponent) * (1 - r / sigma) ** Decimal(exponent)


CLOSED_FORMS = {
    pm.Harmonic(1.5): _power(1.5, 2),
    pm.Hertz(0.7): _power(0.7, 2.5),
    pm.PowerLaw(2.0, 2.0): _power(2.0, 2),
    pm.PowerLaw(1.0, 2.5): _power(1.0, 2.5),
    pm.PowerLaw(3.0, 1.75): _power(3.0, 1.75),
    pm.PowerLaw(1.0, 6.0): _power(1.0, 6),
    pm.RepulsiveLennardJones(2.0): lambda r, sigma: 2 * ((sigma / r) ** 12 - 2 * (sigma / r) ** 6 + 1),
    pm.LinearSpring(4.0): lambda r, sigma: 2 * (sigma - r) ** 2,
    Quartic(0.3): _power(0.3, 4),
}
LAWS = list(CLOSED_FORMS)


def derivative(function, order, r, sigma):
    """Return the derivative of a decimal function with respect to r, by central differences good to 25 digits."""
    step = (sigma - r) * Decimal("1e-15")
    coefficients = {0: [1], 1: [-1, 1], 2: [1, -2, 1], 3: [-1, 3, -3, 1]}[order]
    places = [r + step * (2 * k - order) for k in range(order + 1)]
    differences = sum(c * function(place, sigma) for c, place in zip(coefficients, places, strict=True))
    return differences / (2 * step) ** order


@settings(max_examples=40, deadline=None)
@given(st.floats(1e-9, 0.9), st.floats(0.1, 10.0))
@pytest.mark.parametrize("order", [0, 1, 2])
@pytest.mark.parametrize("law", LAWS, ids=repr)
def test_energy_and_derivatives_are_those_of_the_formula_to_rounding(law, order, overlap, contact_distance):
    distance = contact_distance * (1.0 - overlap)
    r, sigma = Decimal(distance), Decimal(contact_distance)
    exact = derivative(CLOSED_FORMS[law], order, r, sigma)
    found = (law.energy, law.first, law.second)[order](distance, contact_distance)
    # rounding r/sigma once costs as many units in the last place as the condition number of the function
    sensitivity = derivative(CLOSED_FORMS[law], order + 1, r, sigma)
    condition = abs(float(r * sensitivity / exact))
    assert abs(Decimal(found) - exact) <= Decimal(EPSILON * (20 + condition)) * abs(exact)


@pytest.mark.parametrize("row", GOLDEN["rows"], ids=lambda row: f"{row['pot']}-{row['r_over_sigma']}")
def test_stored_potentials_are_met_to_1e_14(row):
    effects = (pm.Repulsion(law=GOLDEN_LAWS[row["pot"]]),)
    terms = contact_terms(effects, equal_touches(np.array([row["r_over_sigma"]]), np.array([1.0])))
    found = [terms.energy_c[0], terms.first_c[0], terms.second_c[0]]
    assert found == pytest.approx([row["V"], row["dV"], row["d2V"]], rel=1e-14, abs=0.0)


@pytest.mark.parametrize(
    ("law", "stiffness"),
    [
        (pm.Harmonic(), 1.0),
        (pm.Hertz(), 0.0),
        (pm.PowerLaw(1.0, 3.0), 0.0),
        (pm.RepulsiveLennardJones(), 72.0),
        (pm.LinearSpring(3.0), 3.0),
    ],
    ids=repr,
)
def test_stiffness_on_the_closed_side_of_contact_is_the_known_limit(law, stiffness):
    # jammed-systems.md section 1: eps (p = 2), 0 (p > 2), 72 eps (repulsive Lennard-Jones), over sigma^2
    terms = contact_terms(
        (pm.Repulsion(law=law),), equal_touches(np.array([1.0, 1.3]), np.array([1.0, 1.0])), closing=True
    )
    assert terms.second_c.tolist() == [stiffness] * 2
    assert np.abs(terms.energy_c).max() == 0.0 and np.abs(terms.first_c).max() == 0.0


@pytest.mark.parametrize("law", LAWS, ids=repr)
def test_energy_and_force_vanish_at_contact_and_beyond(law):
    terms = contact_terms((pm.Repulsion(law=law),), equal_touches(np.array([1.5, 1.5 + 1e-15, 2.0]), np.full(3, 1.5)))
    assert all(np.array_equal(term, np.zeros(3)) for term in terms)


@pytest.mark.parametrize("law", LAWS, ids=repr)
def test_every_law_repels_and_is_convex(law):
    distance = np.linspace(0.05, 0.999, 50)
    terms = contact_terms((pm.Repulsion(law=law),), equal_touches(distance, np.ones(50)))
    assert (terms.energy_c > 0).all() and (terms.first_c < 0).all() and (terms.second_c > 0).all()


@settings(max_examples=30, deadline=None)
@given(st.floats(1e-9, 0.95), st.floats(0.1, 10.0))
@pytest.mark.parametrize("law", LAWS, ids=repr)
def test_compiled_law_gives_what_the_plain_methods_give(law, overlap, contact_distance):
    distance = contact_distance * (1.0 - overlap)
    terms = contact_terms((pm.Repulsion(law=law),), equal_touches(np.array([distance]), np.array([contact_distance])))
    plain = [float(method(distance, contact_distance)) for method in (law.energy, law.first, law.second)]
    compiled = [terms.energy_c[0], terms.first_c[0], terms.second_c[0]]
    # machine code may fuse a product and a sum and call another pow: a few units in the last place
    assert compiled == pytest.approx(plain, rel=16 * EPSILON)


def test_power_law_of_exponent_two_is_harmonic_and_of_five_halves_is_hertz():
    distance, sigma = np.linspace(0.3, 0.99, 12), np.full(12, 1.1)
    for power, named in ((pm.PowerLaw(2.0, 2.0), pm.Harmonic(2.0)), (pm.PowerLaw(2.0, 2.5), pm.Hertz(2.0))):
        first, second = (
            contact_terms((pm.Repulsion(law=law),), equal_touches(distance, sigma)) for law in (power, named)
        )
        for one, other in zip(first, second, strict=True):
            np.testing.assert_allclose(one, other, rtol=1e-14)


def test_a_users_law_acts_in_energy_forces_and_stress_like_the_built_in_one():
    packing = pm.random_packing(60, dimension=3, packing_fraction=0.8, seed=2)
    own, built_in = (pm.Scene(packing, (pm.Repulsion(law=law),)) for law in (Quartic(2.0), pm.PowerLaw(2.0, 4.0)))
    assert pm.energy(own) == pytest.approx(pm.energy(built_in), rel=1e-13)
    np.testing.assert_allclose(pm.forces(own), pm.forces(built_in), rtol=1e-10, atol=1e-13)
    np.testing.assert_allclose(pm.stress_tensor(own), pm.stress_tensor(built_in), rtol=1e-12, atol=1e-14)


def test_terms_of_several_effects_are_the_sum_of_each():
    distance, sigma = np.linspace(0.5, 1.2, 15), np.ones(15)
    effects = (pm.Repulsion(law=pm.Hertz(0.5)), pm.ContactDamping(0.2), pm.Repulsion(law=pm.Harmonic(2.0)))
    together = contact_terms(effects, equal_touches(distance, sigma))
    apart = [contact_terms((effect,), equal_touches(distance, sigma)) for effect in effects]
    for name in together._fields:
        np.testing.assert_allclose(getattr(together, name), sum(getattr(one, name) for one in apart), rtol=1e-15)


def test_an_effect_of_zero_strength_equals_an_absent_one():
    distance, sigma = np.linspace(0.5, 1.2, 15), np.ones(15)
    repulsion = pm.Repulsion(law=pm.Harmonic())
    with_zero = contact_terms((repulsion, pm.ContactDamping(0.0)), equal_touches(distance, sigma))
    without = contact_terms((repulsion,), equal_touches(distance, sigma))
    assert all(np.array_equal(one, other) for one, other in zip(with_zero, without, strict=True))


def test_unit_of_energy_is_the_energy_scale_or_the_stiffness_times_length_squared():
    assert energy_scale_of((pm.ContactDamping(), pm.Repulsion(law=pm.Hertz(2.5))), 3.0) == 2.5
    assert energy_scale_of((pm.Repulsion(law=pm.LinearSpring(2.0)),), 3.0) == 18.0
    assert energy_scale_of((pm.Repulsion(law=pm.ElasticSpheres(2.0)),), 3.0) == 54.0
    # of a law that goes by another one, that one's; of one for each pair of kinds, the largest
    assert energy_scale_of((pm.Repulsion(law=pm.PlateauRepulsion(law=pm.LinearSpring(2.0))),), 3.0) == 18.0
    kinds = pm.LawByKind([[pm.Harmonic(1.0), pm.Harmonic(5.0)], [pm.Harmonic(5.0), pm.Harmonic(2.0)]])
    assert energy_scale_of((pm.Repulsion(law=kinds),), 3.0) == 5.0


def monomial(exponent):
    """Return a law class of a name that every call uses again; its exponent is bound, not a field."""

    @pm.law
    class Monomial(NamedTuple):
        energy_scale: float = 1.0

        def energy(self, distance, contact_distance):
            return self.energy_scale * (1.0 - distance / contact_distance) ** exponent

        def first(self, distance, contact_distance):
            overlap = 1.0 - distance / contact_distance
            return -exponent * self.energy_scale * overlap ** (exponent - 1.0) / contact_distance

        def second(self, distance, contact_distance):
            overlap = 1.0 - distance / contact_distance
            return exponent * (exponent - 1.0) * self.energy_scale * overlap ** (exponent - 2.0) / contact_distance**2

    return Monomial


def test_a_law_defined_again_under_its_name_is_the_new_law():
    for exponent in (2.0, 3.0, 4.0):
        terms = contact_terms(
            (pm.Repulsion(law=monomial(exponent)()),), equal_touches(np.array([0.5]), np.array([1.0]))
        )
        assert terms.energy_c[0] == pytest.approx(0.5**exponent, rel=1e-14)
        assert terms.first_c[0] == pytest.approx(-exponent * 0.5 ** (exponent - 1.0), rel=1e-14)


def scaled_by(make):
    """Return a class with a method that computes with whatever `make` returns."""
    value = make()

    class Scaled:
        def energy(self, distance):
            return (lambda: value(distance) if callable(value) else value * distance)()

    return Scaled


def factor(size):
    return lambda distance: size * distance


@pytest.mark.parametrize(
    ("one", "other"),
    [
        (lambda: 1.0, lambda: 1.0 + 1e-15),
        (lambda: (1.0, 2.0), lambda: (1.0, 3.0)),
        (lambda: np.array([1.0]), lambda: np.array([1.0 + 1e-9])),
        (lambda: np.zeros(2000), lambda: np.eye(1, 2000, 900)[0]),
        (lambda: factor(1.0), lambda: factor(2.0)),
        (lambda: np.sin, lambda: np.cos),
    ],
    ids=["number", "tuple", "array", "long array", "function of a factory", "ufunc"],
)
def test_code_on_disk_is_told_apart_by_what_a_laws_formulas_refer_to(one, other):
    assert source_key(scaled_by(one)) == source_key(scaled_by(one)) is not None
    assert source_key(scaled_by(one)) != source_key(scaled_by(other))


@pytest.mark.parametrize("value", [json, object(), {}, [1.0]], ids=["module", "object", "dict", "list"])
def test_code_that_refers_to_what_may_change_is_not_kept_on_disk(value):
    assert source_key(scaled_by(lambda: value)) is None


def test_a_law_cannot_take_the_name_of_one_that_ships():
    # files name laws by their classes
    with pytest.raises(ValueError, match="law must have a name that none of packmech's has, got Harmonic"):
        pm.law(named_tuple("Harmonic", energy=no_op, first=no_op, second=no_op))


def test_a_law_defined_again_shows_the_name_it_was_given():
    assert repr(monomial(2.0)(3.0)) == repr(monomial(2.0)(3.0)) == "Monomial(energy_scale=3.0)"


def test_laws_and_effects_of_two_kinds_are_never_equal():
    assert pm.Harmonic(1.0) == pm.Harmonic(1.0) != pm.Hertz(1.0)
    assert pm.Repulsion(law=pm.Harmonic(1.0)) != pm.Repulsion(law=pm.Hertz(1.0))
    packing = pm.lattice_packing("square")
    assert pm.Scene(packing, (pm.Repulsion(law=pm.Harmonic(1.0)),)) != pm.Scene(
        packing, (pm.Repulsion(law=pm.Hertz(1.0)),)
    )


def no_op(self, distance, contact_distance):
    return 0.0


def named_tuple(name, field="energy_scale", **methods):
    cls = NamedTuple(name, [(field, float)])
    for method, function in methods.items():
        setattr(cls, method, function)
    return cls


@pytest.mark.parametrize(
    ("cls", "message"),
    [
        (dict, "law must be a NamedTuple class, got <class 'dict'>"),
        (pm.Harmonic(), "law must be a NamedTuple class, got Harmonic"),
        (named_tuple("Half", energy=no_op, first=no_op), r"law Half must define the method second\(self, distance"),
        (
            named_tuple("Short", energy=lambda self, distance: 0.0, first=no_op, second=no_op),
            r"law Short.energy must take \(self, distance, contact_distance\)",
        ),
        (
            named_tuple("Scaleless", field="strength", energy=no_op, first=no_op, second=no_op),
            r"law Scaleless must have a field energy_scale, stiffness or modulus, got \('strength',\)",
        ),
    ],
)
def test_a_class_that_is_no_law_is_refused_saying_what_is_missing(cls, message):
    with pytest.raises(TypeError, match=message):
        pm.law(cls)


TABLE = {"stiff": 0.0}


def looks_up_in_a_dictionary(self, distance, contact_distance):
    return TABLE["stiff"]


def makes_a_pair(self, distance, contact_distance):
    return distance, contact_distance


def joins_words(self, distance, contact_distance):
    return distance + "word"


@pytest.mark.parametrize(
    ("method", "formula", "message"),
    [
        ("energy", looks_up_in_a_dictionary, r"law Weird\.energy must compile: .*TABLE"),
        ("second", joins_words, r"law Weird\.second must compile: No implementation .*add.* >>> add\(float64, "),
        ("first", makes_a_pair, r"law Weird\.first must return a number, got .*float64 x 2.* when compiled"),
    ],
)
@pytest.mark.parametrize("use", [pm.energy, lambda scene: build_program(scene).evaluate()], ids=["terms", "program"])
def test_a_law_that_does_not_compile_is_told_in_one_line_naming_law_and_method(method, formula, message, use):
    law = pm.law(named_tuple("Weird", **{"energy": no_op, "first": no_op, "second": no_op, method: formula}))
    packing = pm.Packing([[0.0, 0.0], [0.5, 0.0]], [0.5, 0.5], pm.Box.cubic(3.0, 2))
    with pytest.raises(TypeError, match=f"^{message}") as caught:
        use(pm.Scene(packing, (pm.Repulsion(law=law(1.0)),)))
    assert "\n" not in str(caught.value)
    assert isinstance(caught.value.__cause__, NumbaError)


def test_an_effect_that_does_not_compile_is_told_in_one_line():
    cls = pm.effect(named_tuple("Odd", pair_energy=looks_up_in_a_dictionary))
    with pytest.raises(TypeError, match=r"^effect Odd\.pair_energy must compile: "):
        contact_terms((cls(1.0),), equal_touches(np.array([0.5]), np.array([1.0])))


def harmony(**changes):
    """Return a harmonic law's methods, some of them changed."""
    methods = {
        "energy": lambda self, r, sigma: 0.5 * self.energy_scale * (1.0 - r / sigma) ** 2,
        "first": lambda self, r, sigma: -self.energy_scale * (1.0 - r / sigma) / sigma,
        "second": lambda self, r, sigma: self.energy_scale / sigma**2,
    }
    return {**methods, **changes}


def turned(self, r, sigma):
    return self.energy_scale * (1.0 - r / sigma) / sigma


def fails(self, r, sigma):
    raise ArithmeticError


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"first": turned}, r"law Harmony\.first must be the derivative of energy with respect to distance: at "),
        ({"first": lambda self, r, sigma: -self.energy_scale * (1.0 - r / sigma)}, r"contact distance 1\.7"),
        ({"first": lambda self, r, sigma: -1.01 * self.energy_scale * (1.0 - r / sigma) / sigma}, "Harmony.first"),
        ({"second": lambda self, r, sigma: -self.energy_scale / sigma**2}, r"Harmony\.second must be the derivative"),
        ({"second": lambda self, r, sigma: 0.0}, r"differences give 1, got 0"),
        ({"first": turned, "second": fails}, r"Harmony\.first must be the derivative of energy"),
        ({"energy": fails, "second": lambda self, r, sigma: 0.0}, r"Harmony\.second must be the derivative of first"),
    ],
)
def test_a_law_with_a_wrong_derivative_is_refused_where_it_is_registered(changes, message):
    cls = named_tuple("Harmony", **harmony(**changes))
    cls._field_defaults["energy_scale"] = 1.0
    cls.__new__.__defaults__ = (1.0,)
    with pytest.raises(ValueError, match=message):
        pm.law(cls)


def test_a_law_without_defaults_is_checked_by_scenes_with_its_own_numbers():
    cls = pm.law(named_tuple("Harmony", **harmony(first=turned)))
    packing = pm.Packing([[0.0, 0.0], [0.9, 0.0]], [0.5, 0.5], pm.Box.cubic(3.0, 2))
    with pytest.raises(ValueError, match=r"law Harmony\.first must be .* give -0\.0408\d+, got 0\.0408"):
        pm.Scene(packing, (pm.Repulsion(law=cls(3.3)),))


def test_an_effect_whose_force_is_not_that_of_its_energy_is_refused():
    energy_only = named_tuple("Odd", "strength", pair_energy=lambda self, r, sigma: self.strength * (1.0 - r / sigma))
    with pytest.raises(ValueError, match=r"effect Odd\.pair_first must be the derivative of pair_energy"):
        packing = pm.Packing([[0.0, 0.0], [0.9, 0.0]], [0.5, 0.5], pm.Box.cubic(3.0, 2))
        pm.Scene(packing, (pm.effect(energy_only)(1.0),))


def jumping(**changes):
    """Return a class of laws whose three functions belong together, with its numbers given."""
    cls = named_tuple("Jumping", **harmony(**changes))
    cls._field_defaults["energy_scale"] = 1.0
    cls.__new__.__defaults__ = (1.0,)
    return cls


def linear(extra):
    """Return harmonic energy and force and a constant force besides: it jumps where particles part."""
    return {
        "energy": lambda self, r, sigma: 0.5 * (1.0 - r / sigma) ** 2 + extra * (1.0 - r / sigma),
        "first": lambda self, r, sigma: -(1.0 - r / sigma + extra) / sigma,
    }


def lennard_jones(shift):
    """Return the attractive and repulsive parts, cut at contact where the force is -24, or at the minimum."""
    s = 2.0 ** (-1.0 / 6.0) if shift else 1.0
    return {
        "energy": lambda self, r, sigma: 4.0 * ((s * sigma / r) ** 12 - (s * sigma / r) ** 6) + shift,
        "first": lambda self, r, sigma: (-48.0 * (s * sigma / r) ** 12 + 24.0 * (s * sigma / r) ** 6) / r,
        "second": lambda self, r, sigma: (624.0 * (s * sigma / r) ** 12 - 168.0 * (s * sigma / r) ** 6) / r**2,
    }


def dropped(at):
    """Return a spring that gives way at a relative overlap, to a constant force of twice the strength."""
    return {
        "energy": lambda self, r, sigma: (
            0.5 * min(1.0 - r / sigma, at) ** 2 + 2.0 * at * max(1.0 - r / sigma - at, 0.0)
        ),
        "first": lambda self, r, sigma: -(1.0 - r / sigma if 1.0 - r / sigma < at else 2.0 * at) / sigma,
        "second": lambda self, r, sigma: 1.0 / sigma**2 if 1.0 - r / sigma < at else 0.0,
    }


JUMPS = {
    "constant force": (linear(0.1), r"Jumping\.first must go to zero at contact, .*got -0\.1 at contact distance 1"),
    "weak constant force": (linear(1e-6), r"Jumping\.first must go to zero at contact, .*got -1e-06"),
    "pull": (linear(-0.2), r"Jumping\.first must go to zero at contact, .*got 0\.2"),
    "Lennard-Jones cut at its zero": (lennard_jones(0.0), r"Jumping\.first must go to zero at contact, .*got -24 "),
    "energy that is not shifted": (
        {"energy": lambda self, r, sigma: 0.5 * (1.0 - r / sigma) ** 2 - 0.3}, r"energy must go to zero .*got -0\.3 "
    ),
    "screened charges": (
        {
            "energy": lambda self, r, sigma: math.exp(-r / sigma) * sigma / r,
            "first": lambda self, r, sigma: -math.exp(-r / sigma) * (1.0 / r + sigma / r**2),
            "second": lambda self, r, sigma: (
                math.exp(-r / sigma) * (1.0 / (r * sigma) + 2.0 / r**2 + 2.0 * sigma / r**3)
            ),
        },
        r"energy must go to zero at contact",
    ),
    "square root": (
        {
            "energy": lambda self, r, sigma: (1.0 - r / sigma) ** 1.0,
            "first": lambda self, r, sigma: -1.0 / sigma,
            "second": lambda self, r, sigma: 0.0,
        },
        r"Jumping\.first must go to zero at contact, .*got -1 at",
    ),
    "force that drops": (dropped(0.3), r"Jumping\.first must be continuous, got a jump by 0\.3 at distance 0\.7, "),
    "force that drops a little": (dropped(0.05), r"Jumping\.first must be continuous, got a jump by 0\.05 at "),
    "energy that drops": (
        {"energy": lambda self, r, sigma: 0.5 * (1.0 - r / sigma) ** 2 + (0.1 if r < 0.5 * sigma else 0.0)},
        r"Jumping\.energy must be continuous, got a jump by -0\.1 at distance 0\.5, ",
    ),
}  # fmt: skip


@pytest.mark.parametrize(("changes", "message"), JUMPS.values(), ids=list(JUMPS))
def test_a_law_that_jumps_is_refused_unless_it_says_so(changes, message):
    cls = jumping(**changes)
    with pytest.raises(ValueError, match=message):
        pm.law(cls)
    cls.force_jumps = True
    packing = pm.Packing([[0.0, 0.0], [0.9, 0.0]], [0.5, 0.5], pm.Box.cubic(3.0, 2))
    # an effect and a law that hold such a law jump, too
    plateau = pm.PlateauRepulsion(law=pm.law(cls)())
    assert len(pm.Scene(packing, (pm.Repulsion(cls()), pm.Repulsion(plateau))).effects) == 2


@settings(max_examples=60, deadline=None)
@given(st.floats(1.5, 12.0), st.floats(-12.0, 12.0))
def test_power_laws_of_every_exponent_with_continuous_forces_are_accepted(exponent, scale):
    check_law(pm.PowerLaw(10.0**scale, exponent))


@settings(max_examples=40, deadline=None)
@given(st.floats(0.1, 0.99) | st.just(1.0))
def test_power_laws_whose_force_jumps_or_diverges_at_contact_are_refused(exponent):
    with pytest.raises(ValueError, match="PowerLaw.first must go to zero at contact"):
        check_law(pm.PowerLaw(1.0, exponent))


@pytest.mark.parametrize(
    "law",
    [
        pm.Harmonic(1e-12),
        pm.RepulsiveLennardJones(5.0),
        pm.DivergentRepulsion(divergence=1.0),
        pm.DivergentRepulsion(divergence=1.0, cap=2.0),
        pm.PlateauRepulsion(0.3, 0.9, 0.0),
        pm.PlateauRepulsion(1.0, 1.0, 0.0),
        pm.PlateauRepulsion(law=pm.DivergentRepulsion()),
        pm.ExponentialTension(1.0, 0.01),
    ],
    ids=repr,
)
def test_kinks_steep_forces_and_caps_are_no_jumps(law):
    check_law(law)
    check_effect(pm.Repulsion(law))


def test_lennard_jones_cut_at_its_minimum_is_accepted_as_it_is_written():
    assert pm.law(jumping(**lennard_jones(1.0)))().energy(1.0, 1.0) == pytest.approx(0.0, abs=1e-15)


def test_an_effect_that_pulls_with_a_constant_force_while_touching_is_refused_unless_it_says_so():
    hooks = {
        "pair_energy": lambda self, r, sigma: self.energy_scale * (r - sigma),
        "pair_first": lambda self, r, sigma: self.energy_scale,
        "pair_second": lambda self, r, sigma: 0.0,
    }
    cls = named_tuple("Glue", **hooks)
    cls._field_defaults["energy_scale"] = 0.1
    cls.__new__.__defaults__ = (0.1,)
    with pytest.raises(ValueError, match=r"effect Glue\.pair_first must go to zero at contact, .*got 0\.1"):
        pm.effect(cls)
    cls.force_jumps = True
    assert pm.effect(cls) is cls


@pytest.mark.parametrize("ends", [(0.11, 0.12), (0.031, 0.033), (0.055, 0.056)])
def test_a_shoulder_in_a_force_is_two_jumps(ends):
    low, high = ends

    def inside(r, sigma):
        return min(max(1.0 - r / sigma - low, 0.0), high - low)

    class Shoulder(NamedTuple):
        height: float = 0.02

        def energy(self, r, sigma):
            return 0.5 * (1.0 - r / sigma) ** 2 + self.height * inside(r, sigma)

        def first(self, r, sigma):
            on = low < 1.0 - r / sigma < high
            return -((1.0 - r / sigma) + (self.height if on else 0.0)) / sigma

        def second(self, r, sigma):
            return 1.0 / sigma**2

    with pytest.raises(ValueError, match="first must be continuous, got a jump by"):
        check_law(Shoulder())
