"""Facts about what looks at the kinds of particles: tables wherever they stand, and a user's classes."""

from typing import Any, NamedTuple

import pytest

import packmech as pm
from packmech.calls.honors import columns_of
from packmech.calls.kinds import looks_at_kinds, records_in
from packmech.effects.kinds import kinds_in, kinds_matter, tables_in

TABLE = pm.ByKind([[0.5, 0.1], [0.1, 0.3]])
LAW = pm.LawByKind([[pm.Harmonic(1.0), pm.Harmonic(2.0)], [pm.Harmonic(2.0), pm.Harmonic(3.0)]])


class OfRadius(NamedTuple):
    """A law that knows how curved the two are, and no kinds."""

    modulus: float = 1.0

    def energy(self, distance, partners):
        return 0.5 * self.modulus * partners.effective_radius * (partners.contact_distance - distance) ** 2

    def first(self, distance, partners):
        return -self.modulus * partners.effective_radius * (partners.contact_distance - distance)

    def second(self, distance, partners):
        return self.modulus * partners.effective_radius


class OfKinds(NamedTuple):
    """The same, of another stiffness for each pair of kinds."""

    modulus: float = 1.0

    def energy(self, distance, partners):
        return 0.5 * (1.0 + partners.kinds) * (partners.contact_distance - distance) ** 2

    def first(self, distance, partners):
        return -(1.0 + partners.kinds) * (partners.contact_distance - distance)

    def second(self, distance, partners):
        return 1.0 + partners.kinds


class HandsOn(NamedTuple):
    """A law that gives its partners to a function."""

    def energy(self, distance, partners):
        return 0.5 * stiffness_of(partners) * (partners.contact_distance - distance) ** 2


class Names(NamedTuple):
    """A law that gives its partners another name."""

    def energy(self, distance, partners):
        both = partners
        return both.kinds * distance


class Within(NamedTuple):
    """An effect that holds a law."""

    law: Any = OfKinds()

    def pair_energy(self, distance, contact_distance):
        return 0.0


class Inherits(OfKinds):
    """A class that reads kinds where the one that it is made of does."""


class Dashpot(NamedTuple):
    """A dashpot that differs by kinds."""

    def pair_damping(self, pair):
        return 0.1 * (1.0 + pair.kinds)


class PlainDashpot(NamedTuple):
    """A dashpot of all alike."""

    def pair_damping(self, pair):
        return 0.1 * pair.second


def stiffness_of(partners):
    return 1.0 + partners.kinds


@pytest.mark.parametrize("one", [OfKinds(), HandsOn(), Names(), Within(), Inherits(), Dashpot(), TABLE, LAW], ids=repr)
def test_what_reads_kinds_or_holds_a_table_looks_at_kinds(one):
    assert looks_at_kinds(one) and kinds_matter((pm.Repulsion(), one))


@pytest.mark.parametrize(
    "one",
    [OfRadius(), Within(OfRadius()), PlainDashpot(), pm.Repulsion(), pm.ElasticSpheres(), pm.Restitution()],
    ids=repr,
)
def test_what_reads_no_kinds_does_not_look_at_them(one):
    assert not looks_at_kinds(one) and not kinds_matter((one,))


def test_tables_are_found_by_the_path_of_their_field():
    friction = pm.Friction(TABLE, pm.Mindlin(TABLE), 0.1)
    assert [name for name, _ in records_in(friction)] == ["", "coefficient", "stiffness", "stiffness.poisson_ratio"]
    assert tables_in(friction) == [("coefficient", TABLE.numbers), ("stiffness.poisson_ratio", TABLE.numbers)]
    assert tables_in(pm.Repulsion(LAW)) == [("law", LAW.laws)]
    assert tables_in(pm.Repulsion()) == []


def test_an_effect_of_a_users_that_reads_kinds_is_in_their_column():
    assert columns_of(Dashpot()) == ("damping", "kinds")
    assert columns_of(PlainDashpot()) == ("damping",)
    assert columns_of(pm.Repulsion(OfKinds())) == ("repulsion", "kinds")
    assert columns_of(pm.Repulsion(OfRadius())) == ("repulsion",)
    assert columns_of(pm.Friction(TABLE, 0.5)) == ("friction", "kinds")


def test_kinds_that_nothing_looks_at_are_none():
    packing = pm.lattice_packing("square", repeats=(2, 2)).replace(kind_n=[0, 1, 0, 1])
    assert kinds_in((pm.Repulsion(OfRadius()),), packing) is None
    assert kinds_in((pm.Repulsion(OfKinds()),), packing).tolist() == [0, 1, 0, 1]


def test_walls_refuse_what_reads_the_kinds_of_two_particles():
    @pm.law
    class ReadsKinds(NamedTuple):
        energy_scale: float = 1.0

        def energy(self, distance, partners):
            return 0.5 * self.energy_scale * (1.0 + partners.kinds) * (partners.contact_distance - distance) ** 2

        def first(self, distance, partners):
            return -self.energy_scale * (1.0 + partners.kinds) * (partners.contact_distance - distance)

        def second(self, distance, partners):
            return self.energy_scale * (1.0 + partners.kinds)

    packing = pm.lattice_packing("square", repeats=(2, 2)).replace(kind_n=[0, 1, 0, 1])
    walls = pm.Walls(1, -0.2, 1.8, ReadsKinds())
    rows = walls._replace(law=pm.LawPerKind([ReadsKinds(1.0), ReadsKinds(2.0)]))
    for one in (walls, rows):
        with pytest.raises(ValueError, match=r"effects\[1\].law must read no kinds, .* got .*ReadsKinds"):
            pm.Scene(packing, (pm.Repulsion(), one))
    # of one kind there is nothing to tell apart
    assert pm.Scene(packing.replace(kind_n=None), (pm.Repulsion(), walls))


def test_rows_of_walls_are_their_own_and_no_loop_over_pairs_looks_at_them():
    packing = pm.lattice_packing("square", repeats=(2, 2)).replace(kind_n=[0, 1, 0, 1])
    walls = pm.Walls(1, -0.2, 1.8, damping=pm.PerKind([0.1, 0.2]))
    assert columns_of(walls) == ("walls", "kinds")
    assert kinds_in((pm.Repulsion(), walls), packing) is None
