"""Facts about the verdict: all methods agree, and are right, on crystals, packings made, and these less a contact.

Right is what HiGHS' simplex method says of the definition, written down anew in `simplex_oracle.py`; published tables;
and that a packing with one state of self stress is not jammed without any of the contacts that it loads.
"""

import functools

import numpy as np
import pytest

import packmech as pm

YES, NO = "jammed", "not jammed"
FAST = [
    ("certificate", "clarabel", "ball"),
    ("certificate", "highs", "ball"),
    ("loads", "clarabel", "ball"),
    ("loads", "clarabel", "box"),
    ("loads", "highs", "box"),
]
READABLE = [("certificate", "cvxpy", "ball"), ("loads", "cvxpy", "ball"), ("loads", "cvxpy", "box")]
LARGE = [("certificate", "clarabel", "ball"), ("loads", "clarabel", "ball")]


def assert_all_say(expected, packing, contacts, ways, **more):
    for method, solver, bound in ways:
        how = {"method": method, "solver": solver, "bound": bound, **more}
        verdict = pm.classify_jamming(packing, contacts=contacts, **how)
        assert (verdict.collective, verdict.strict) == expected, how


# Torquato and Stillinger, Rev. Mod. Phys. 82, 2633, table II
TABLE = {
    "triangular": ((YES, YES), [[[2, 1], [-1, 3]], [[3, 0], [1, 2]], [[5, 2], [0, 5]], [[1, 5], [0, 1]]]),
    "square": ((NO, NO), [[[3, 0], [1, 2]], [[4, 2], [2, 4]], np.diag([3, 5])]),
    "honeycomb": ((NO, NO), [[[2, 1], [-1, 3]], [[3, 0], [1, 2]], [[4, 1], [0, 3]]]),
    "kagome": ((NO, NO), [[[2, 1], [-1, 3]], [[3, 0], [1, 2]], [[1, 4], [0, 1]]]),
    "sc": ((NO, NO), [[[2, 0, 1], [0, 2, 0], [-1, 0, 2]], np.diag([1, 1, 2]), np.diag([3, 2, 3])]),
    "fcc": ((YES, YES), [[[2, 0, 1], [0, 2, 0], [-1, 0, 2]], [[1, 1, 0], [0, 2, 1], [1, 0, 2]], np.diag([1, 1, 1])]),
}
CELLS = [(name, cells, expected) for name, (expected, supercells) in TABLE.items() for cells in supercells]
ONES = [("square", (YES, NO)), ("honeycomb", (YES, NO)), ("kagome", (NO, NO)), ("sc", (YES, NO)), ("fcc", (YES, YES))]
ONES = [(name, np.eye(3 if name in ("sc", "fcc") else 2, dtype=int), answers) for name, answers in ONES]
# one straight line along each axis runs through all particles of these cells: no line slides past another
ONES += [("square", [[2, 1], [-1, 3]], (YES, NO))]
ONES += [("sc", [[1, 1, 0], [0, 2, 1], [1, 0, 2]], (YES, NO))]


@pytest.mark.parametrize(("name", "cells", "expected"), CELLS + ONES)
def test_every_method_and_simplex_give_a_crystal_in_a_skew_cell_its_published_answer(
    name, cells, expected, simplex_answers
):
    crystal = pm.lattice_packing(name, supercell=cells)
    contacts = pm.find_contacts(crystal, gap_tolerance=1e-9)
    assert simplex_answers(crystal, contacts) == expected
    assert_all_say(expected, crystal, contacts, FAST)


@pytest.mark.parametrize(("name", "cells", "expected"), CELLS[1::3] + ONES)
def test_programs_as_they_read_give_a_crystal_in_a_skew_cell_its_published_answer(name, cells, expected):
    crystal = pm.lattice_packing(name, supercell=cells)
    assert_all_say(expected, crystal, None, READABLE)


@functools.cache
def made(kind, count, dimension, strain, seed):
    """Return a packing by `pm.jam` at a pressure of 1e-8, its contacts, and its verdict by the default method."""
    sizes = pm.Bidisperse(ratio=1.4)
    dilute = {"dimension": dimension, "packing_fraction": 0.3, "seed": seed}
    if kind == "single":
        fraction = 0.87 if dimension == 2 else 0.68
        sizes = sizes if dimension == 2 else pm.Monodisperse()
        start = pm.random_packing(count, dimension=dimension, sizes=sizes, packing_fraction=fraction, seed=seed)
    elif kind == "chain":
        start = pm.chain_packing(count // 8, 8, **dilute)
    else:
        shape, beads = (pm.Dimer(), 2) if kind == "dimer" else (pm.Trimer(), 3)
        start = pm.cluster_packing(count // beads, shape, sizes=sizes, largest_overlap=0.1, **dilute)
    packing = pm.jam(pm.Scene(start, (pm.Repulsion(),)), strain=strain, pressure=1e-8).packing
    verdict = pm.classify_jamming(packing)
    return packing, verdict.touching.contacts, verdict


def less_one(contacts, verdict, which):
    """Return the contacts without the weakest, the median or a random one of those in the certificate."""
    order = np.argsort(verdict.contact_force_c)
    rank = {
        "weakest": 0,
        "median": len(order) // 2,
        "random": int(np.random.default_rng(len(order)).integers(len(order))),
    }
    gone, network = order[rank[which]], verdict.network
    same = (contacts.i_c == network.i_c[gone]) & (contacts.j_c == network.j_c[gone])
    same &= (contacts.image_cd == network.image_cd[gone]).all(axis=1)
    assert same.sum() == 1
    return contacts.select(~same)


SMALL = [
    ("single", 64, 2, "isotropic", 1),
    ("single", 64, 2, "free", 1),
    ("single", 32, 3, "free", 1),
    ("dimer", 32, 2, "free", 2),
    ("chain", 32, 2, "isotropic", 2),
]
MIDDLE = [
    ("single", 32, 3, "isotropic", 1),
    ("dimer", 32, 2, "isotropic", 2),
    ("trimer", 36, 3, "isotropic", 1),
    ("single", 256, 2, "isotropic", 1),
    ("single", 256, 2, "free", 2),
    ("single", 128, 3, "isotropic", 2),
    ("single", 128, 3, "free", 1),
    ("dimer", 96, 2, "free", 3),
    ("dimer", 64, 3, "isotropic", 3),
    ("trimer", 60, 2, "free", 3),
    ("trimer", 60, 3, "free", 2),
    ("chain", 96, 2, "isotropic", 3),
    ("chain", 64, 3, "free", 1),
]
REMOVED = ["weakest", "median", "random"]


def assert_right(case, answers, ways):
    packing, contacts, verdict = made(*case)
    expected = answers(packing, contacts)
    assert expected == (YES, YES if case[3] == "free" else NO)
    assert (verdict.collective, verdict.strict) == expected
    assert_all_say(expected, packing, None, ways)


def assert_right_without(case, which, answers, ways):
    packing, contacts, verdict = made(*case)
    contacts = less_one(contacts, verdict, which)
    expected = answers(packing, contacts)
    for question, answer in zip(("none", "isochoric"), expected, strict=True):
        if verdict.states_of_self_stress[question] == 1:
            assert answer == NO
    assert_all_say(expected, packing, contacts, ways)


@pytest.mark.parametrize("case", SMALL, ids=str)
def test_every_method_and_simplex_call_a_packing_that_was_made_jammed(case, simplex_answers):
    assert_right(case, simplex_answers, FAST + READABLE[::2])


@pytest.mark.parametrize("which", REMOVED)
@pytest.mark.parametrize("case", SMALL, ids=str)
def test_every_method_says_what_simplex_says_of_a_packing_less_a_contact(case, which, simplex_answers):
    assert_right_without(case, which, simplex_answers, FAST)


@pytest.mark.slow
@pytest.mark.parametrize("case", MIDDLE, ids=str)
def test_every_method_and_simplex_agree_on_larger_packings_whole_and_less_a_contact(case, simplex_answers):
    assert_right(case, simplex_answers, FAST + (READABLE if case[1] <= 128 else []))
    for which in REMOVED:
        assert_right_without(case, which, simplex_answers, FAST)


@pytest.mark.slow
@pytest.mark.parametrize("case", [("single", 1024, 2, "isotropic", 1), ("single", 1024, 2, "free", 2)], ids=str)
def test_fast_methods_and_simplex_agree_on_1024_discs_whole_and_less_a_contact(case, simplex_answers):
    assert_right(case, simplex_answers, LARGE)
    for which in REMOVED:
        assert_right_without(case, which, simplex_answers, LARGE)
