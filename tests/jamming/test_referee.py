"""Facts about the referee: it proves what is true, and what was tampered with until it is not it refuses."""

import ast
import zipfile
from pathlib import Path

import numpy as np
import pytest

import packmech as pm
from packmech.files.archive import SEAL, write_archive
from packmech.jamming import referee

CRYSTALS = {
    "triangular": ((3, 3), True, True),
    "square": ((3, 3), False, False),
    "kagome": ((2, 2), False, False),
    "honeycomb": ((3, 3), False, False),
    "fcc": ((2, 2, 2), True, True),
    "hcp": ((2, 2, 2), True, True),
    "sc": ((3, 3, 3), False, False),
}


def jammed(particles, dimension, seed, strain="free"):
    start = pm.random_packing(
        particles,
        dimension=dimension,
        sizes=pm.Bidisperse(ratio=1.4),
        packing_fraction=0.8 if dimension == 2 else 0.6,
        seed=seed,
    )
    return pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=1e-8, strain=strain).packing


@pytest.fixture(scope="module")
def verdicts():
    found = {
        name: pm.classify_jamming(pm.lattice_packing(name, repeats=repeats))
        for name, (repeats, _, _) in CRYSTALS.items()
    }
    for seed in range(4):
        found[f"discs {seed}"] = pm.classify_jamming(jammed(24, 2, seed))
        found[f"isotropic {seed}"] = pm.classify_jamming(jammed(24, 2, seed, "isotropic"))
    found["spheres"] = pm.classify_jamming(jammed(24, 3, 1))
    return found


@pytest.fixture
def written(tmp_path):
    def write(verdict):
        pm.write_certificate(verdict, tmp_path / "one.npz")
        return tmp_path / "one.npz"

    return write


def arrays_of(path):
    with np.load(path) as file:
        return {name: file[name].copy() for name in file.files if name != SEAL}


@pytest.mark.parametrize("name", CRYSTALS)
def test_crystals_are_proven_to_be_what_they_are(name, verdicts, written):
    _, collective, strict = CRYSTALS[name]
    found = pm.verify(written(verdicts[name]))
    answer = {True: "jammed", False: "not jammed"}
    assert found.accepted and (found.collective, found.strict) == (answer[collective], answer[strict])


def test_what_is_claimed_of_random_packings_is_proven(verdicts, written):
    claims = 0
    for name, verdict in verdicts.items():
        if name in CRYSTALS or "ambiguous" in (verdict.collective, verdict.strict):
            continue
        found = pm.verify(written(verdict))
        assert found.accepted and (found.collective, found.strict) == (verdict.collective, verdict.strict), str(found)
        claims += 1
    assert claims >= 6


def test_discs_with_rigid_links_are_proven_too(written):
    linked = pm.chain_packing(6, 4, dimension=2, packing_fraction=0.6, seed=2)
    assert len(linked.links)
    packing = pm.jam(pm.Scene(linked, (pm.Repulsion(),)), pressure=1e-8).packing
    verdict = pm.classify_jamming(packing)
    assert verdict.collective == "jammed"
    assert pm.verify(written(verdict)).collective == "jammed"


def test_discs_that_hold_nothing_are_taken_out_one_by_one(written):
    row = pm.Packing(np.array([[0.5, 0.5], [1.5, 0.5], [2.5, 1.5]]), 0.5, pm.Box.cubic(6.0, 2))
    found = pm.verify(written(pm.classify_jamming(row)))
    assert found.accepted and found.collective == "not jammed"


@pytest.mark.parametrize("seed", range(5))
def test_the_bound_on_singular_values_holds(seed):
    rng = np.random.default_rng(seed)
    kept, d = 6, 2
    pairs = np.array([(i, j) for i in range(kept) for j in range(i + 1, kept)])
    matrix = np.zeros((len(pairs), d * kept))
    for row, (i, j) in zip(matrix, pairs, strict=True):
        row[d * i : d * i + d] = rng.normal(size=d)
        row[d * j : d * j + d] = -row[d * i : d * i + d]
    values = np.linalg.svd(matrix, compute_uv=False)
    bound = referee._smallest_singular_value(matrix, kept, d)
    assert 0.0 < bound <= values[d * kept - d - 1]
    with pytest.raises(referee.Refused, match="no full rank"):
        referee._smallest_singular_value(matrix[: d * kept - d - 1], kept, d)


def tampered(arrays, rng):
    """Return arrays whose claim does not follow any more, and what was done to them."""
    held = {name: one.copy() for name, one in arrays.items()}
    jammed = {one for one in ("collective", "strict") if str(held[f"{one}_verdict"]) == "jammed"}
    question = rng.choice(sorted(jammed)) if jammed else None
    ways = ["position", "radius", "word", "pair", "image", "number", "cut"]
    ways += (
        ["push", "pull", "contact", "lattice", "shuffled", "backbone", "doubled"] if jammed else ["motion", "left out"]
    )
    way = str(rng.choice(ways))
    c = int(rng.integers(max(len(held["i_c"]), 1)))
    if way == "position":
        held["position_nd"][held["i_c"][c]] += rng.normal(size=held["position_nd"].shape[1]) * 0.02
    elif way == "radius":
        held["radius_n"][held["j_c"][c]] *= rng.choice([0.98, 1.02])
    elif way == "word":
        one = rng.choice(["collective", "strict"])
        held[f"{one}_verdict"] = np.array("not jammed" if str(held[f"{one}_verdict"]) == "jammed" else "jammed")
    elif way == "pair":
        held["j_c"][c] = (held["j_c"][c] + 1 + rng.integers(len(held["radius_n"]) - 1)) % len(held["radius_n"])
    elif way == "image":
        held["image_cd"][c] += rng.choice([-2, 2])
    elif way == "number":
        held[str(rng.choice(["position_nd", "lattice_dd", "radius_n"]))].ravel()[0] = rng.choice(
            [np.nan, np.inf, 1e300]
        )
    elif way == "cut":
        name = str(rng.choice(["position_nd", "radius_n", "backbone_n", "i_c", "image_cd"]))
        held[name] = held[name][:-1]
    elif way == "push":
        held[f"{question}_force_c"][c] *= 1.01
    elif way == "pull":
        held[f"{question}_force_c"][c] *= -1.0
    elif way in ("contact", "doubled"):
        kept = np.delete(np.arange(len(held["i_c"])), c) if way == "contact" else np.r_[np.arange(len(held["i_c"])), c]
        for name in ("i_c", "j_c", "image_cd", *(f"{one}_force_c" for one in jammed)):
            held[name] = held[name][kept]
    elif way == "lattice":
        held["lattice_dd"][0] *= 1.01
    elif way == "shuffled":
        force = held[f"{question}_force_c"]
        force[c], force[c - 1] = force[c - 1], force[c] * 1.5
    elif way == "backbone":
        n = int(rng.integers(len(held["backbone_n"])))
        held["backbone_n"][n] = not held["backbone_n"][n]
    elif way == "motion":
        held["collective_displacement_nd"] += rng.normal(size=held["collective_displacement_nd"].shape) * 1e-3
        held["strict_displacement_nd"] = held["collective_displacement_nd"]
    else:
        for name in ("i_c", "j_c", "image_cd"):
            held[name] = np.delete(held[name], c, axis=0)
    return held, way


def test_a_thousand_tampered_certificates_are_refused(verdicts, tmp_path, written):
    rng = np.random.default_rng(0)
    genuine = [arrays_of(written(one)) for one in verdicts.values() if "ambiguous" not in (one.collective, one.strict)]
    path = tmp_path / "tampered.npz"
    accepted, tried = [], {}
    for number in range(1000):
        held, way = tampered(genuine[number % len(genuine)], rng)
        tried[way] = tried.get(way, 0) + 1
        # with a seal of its own: what is refused is the claim
        with open(path, "wb") as file:
            write_archive(file, held)
        if pm.verify(path):
            accepted.append((number, way))
    assert not accepted
    assert min(tried.values()) >= 10


def test_a_certificate_that_was_changed_says_so_and_is_judged_by_what_it_claims_now(verdicts, written):
    path = written(verdicts["triangular"])
    assert "seal" not in str(pm.verify(path))
    with np.load(path) as file:
        arrays = dict(file)
    np.savez(path, **(arrays | {"strict_force_c": 2.0 * arrays["strict_force_c"]}))
    found = pm.verify(path)
    # twice the forces are a proof as well
    assert found.accepted and found.strict == "jammed" and "by its seal" in str(found)


@pytest.mark.parametrize("text", [b"", b"no archive", b"PK\x03\x04 half of one"])
def test_what_is_no_certificate_is_refused_by_name(tmp_path, text):
    path = tmp_path / "other.npz"
    path.write_bytes(text)
    found = pm.verify(path)
    assert not found and "cannot be read" in str(found)


def test_complex_coordinates_are_refused_and_a_wide_gap_tolerance_is_named_first(tmp_path, written):
    held = genuine(pm.lattice_packing("triangular", repeats=(3, 3)), written)
    assert "must be real" in str(forged(tmp_path, **(held | {"position_nd": held["position_nd"] + 1j})))
    loose = forged(tmp_path, **(held | {"radius_n": 0.95 * held["radius_n"], "gap_tolerance": np.array(0.06)}))
    assert loose and str(loose).startswith("accepted, for gaps up to 0.06 of a contact distance\n")
    assert str(forged(tmp_path, **held)).startswith("accepted\n")


def test_archives_made_by_hand_are_refused_and_no_packings(tmp_path):
    head = b"{'descr': '<f8', 'fortran_order': False, 'shape': (3L,), (((".ljust(117) + b"\n"
    for name, kind, spoilt in (("head", zipfile.ZIP_STORED, False), ("packed", zipfile.ZIP_LZMA, True)):
        path = tmp_path / f"{name}.npz"
        with zipfile.ZipFile(path, "w", kind) as archive:
            archive.writestr("radius_n.npy", b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head + bytes(24))
        if spoilt:
            held = bytearray(path.read_bytes())
            held[60:90] = bytes(30)
            path.write_bytes(bytes(held))
        assert not pm.verify(path)
        with pytest.raises(ValueError, match="path must name a readable packing"):
            pm.read_packing(path)


def test_the_referee_uses_nothing_of_what_made_the_verdict():
    tree = ast.parse(Path(referee.__file__).read_text("utf-8"))
    used = {
        name.partition(".")[0]
        for node in ast.walk(tree)
        if isinstance(node, ast.Import | ast.ImportFrom)
        for name in ([node.module] if isinstance(node, ast.ImportFrom) else [one.name for one in node.names])
    }
    assert used == {
        "__future__",
        "fractions",
        "itertools",
        "numpy",
        "pathlib",
        "typing",
    }
    # short enough to be read by whoever doubts it
    assert len(Path(referee.__file__).read_text("utf-8").splitlines()) < 300


def test_verdicts_without_grounds_and_of_shapes_are_not_written(tmp_path):
    ambiguous = pm.classify_jamming(pm.random_packing(20, dimension=2, packing_fraction=0.8, seed=1))
    with pytest.raises(ValueError, match="verdict must have an answer with grounds, got ambiguous"):
        pm.write_certificate(ambiguous, tmp_path / "one.npz")


def test_contacts_that_the_referee_would_refuse_are_not_written(tmp_path):
    apart = pm.lattice_packing("triangular", repeats=(4, 4), relative_overlap=-0.02)
    verdict = pm.classify_jamming(apart, contacts=pm.find_contacts(apart, gap_tolerance=0.15), rest_tolerance=np.inf)
    assert verdict.strict == "jammed"
    pm.write_certificate(verdict, tmp_path / "near.npz")
    assert pm.verify(tmp_path / "near.npz")
    far = pm.lattice_packing("triangular", repeats=(4, 4), relative_overlap=-0.15)
    verdict = pm.classify_jamming(far, contacts=pm.find_contacts(far, gap_tolerance=0.3))
    with pytest.raises(ValueError, match=r"gap tolerance of 0 or more and below 0\.1, .*got 0\.1"):
        pm.write_certificate(verdict, tmp_path / "far.npz")
    pressed = pm.lattice_packing("triangular", repeats=(4, 4), relative_overlap=1e-3)
    verdict = pm.classify_jamming(pressed, gap_tolerance=1e-5)
    assert verdict.strict == "jammed"
    with pytest.raises(ValueError, match=r"overlaps within its gap tolerance, 1e-05, .*got one of 0\.001"):
        pm.write_certificate(verdict, tmp_path / "pressed.npz")
    assert not (tmp_path / "far.npz").exists() and not (tmp_path / "pressed.npz").exists()


def forged(tmp_path, **arrays):
    """Return what the referee says of arrays that nobody's verdict gave."""
    path = tmp_path / "forged.npz"
    with open(path, "wb") as file:
        write_archive(file, arrays)
    return pm.verify(path)


def genuine(packing, written):
    return arrays_of(written(pm.classify_jamming(packing)))


def test_a_jammed_crystal_is_not_unjammed_by_leaving_particles_out_of_its_backbone(tmp_path, written):
    # the honeycomb that is left of a triangular crystal without the middles of its hexagons has floppy motions
    held = genuine(pm.lattice_packing("triangular", repeats=(3, 3)), written)
    out = {0, 4, 8}
    kept = np.array([i not in out and j not in out for i, j in zip(held["i_c"], held["j_c"], strict=True)])
    held["backbone_n"][sorted(out)] = False
    for name in ("i_c", "j_c", "image_cd"):
        held[name] = held[name][kept]
    motion = np.random.default_rng(0).normal(size=held["position_nd"].shape)
    for one in ("collective", "strict"):
        held |= {f"{one}_verdict": np.array("not jammed"), f"{one}_displacement_nd": motion}
        held[f"{one}_strain_dd"] = np.zeros((2, 2))
    found = forged(tmp_path, **held)
    assert not found and "not in the backbone hold each other" in str(found)


def test_the_tolerance_does_not_decide_what_touches_unless_it_is_a_tolerance(tmp_path, written):
    held = genuine(pm.lattice_packing("triangular", repeats=(3, 3)), written)
    held |= {"gap_tolerance": np.array(-0.09), "backbone_n": np.zeros(9, dtype=bool)}
    for name in ("i_c", "j_c", "image_cd"):
        held[name] = held[name][:0]
    for one in ("collective", "strict"):
        held[f"{one}_verdict"] = np.array("not jammed")
    found = forged(tmp_path, **held)
    assert not found and "tolerance from 0 to below 0.1" in str(found)


SHEAR, GROWTH, TURN = np.diag([0.1, -0.1]), 0.1 * np.eye(2), np.array([[0.0, 0.1], [-0.1, 0.0]])
# of a crystal: what is written over its certificate, and what the referee must say
FORGERIES = {
    "tolerance": ("triangular", lambda held: {"gap_tolerance": np.array(0.3)}, "tolerance from 0 to below 0.1"),
    "distances": ("triangular", lambda held: {"radius_n": 0.95 * held["radius_n"]}, "has a gap or overlap of"),
    "force": ("triangular", lambda held: {"collective_force_c": 1.0 + 0.01 * (held["i_c"] == 0)}, "known to"),
    # along lines of discs forces balance at each disc, and strain the box
    "stress": ("triangular", lambda held: {"strict_force_c": 1.0 + along_x(held)}, "known to"),
    "translation": (
        "square",
        lambda held: moving(held, np.ones(2), np.zeros((2, 2))),
        "must be more than a translation",
    ),
    "growth": ("square", lambda held: moving(held, np.zeros(2), GROWTH), "must not enlarge the box"),
    "turn": ("square", lambda held: moving(held, np.zeros(2), TURN), "the strain must be symmetric"),
    "fixed box": (
        "square",
        lambda held: {"collective_displacement_nd": np.zeros((9, 2)), "collective_strain_dd": SHEAR},
        "zero where the box is fixed",
    ),
    "closing": ("square", lambda held: moving(held, np.zeros(2), SHEAR), "closes a contact"),
    "left out": ("square", lambda held: {n: held[n][1:] for n in ("i_c", "j_c", "image_cd")}, "are not among the"),
}


def along_x(held):
    vector = held["position_nd"][held["j_c"]] - held["position_nd"][held["i_c"]]
    vector = vector + held["image_cd"] @ held["lattice_dd"].T
    return np.abs(vector[:, 1]) < 1e-9


def moving(held, all_alike, strain):
    return {"strict_displacement_nd": np.tile(all_alike, (9, 1)), "strict_strain_dd": strain}


@pytest.mark.parametrize("name", FORGERIES)
def test_forged_grounds_prove_nothing(name, tmp_path, written):
    lattice, change, says = FORGERIES[name]
    held = genuine(pm.lattice_packing(lattice, repeats=(3, 3)), written)
    assert forged(tmp_path, **held)
    found = forged(tmp_path, **held | change(held))
    assert not found and says in str(found), str(found)


def test_links_are_neither_stretched_nor_left_without_balance(tmp_path):
    # two linked discs fill a box that is two wide and one high: one moves up and the other down, and not apart
    place = np.array([[0.5, 0.5], [1.5, 0.5]])
    arrays = {
        "kind": "certificate of jamming", "version": 1, "position_nd": place, "radius_n": np.full(2, 0.5),
        "lattice_dd": np.diag([2.0, 1.0]), "backbone_n": np.ones(2, dtype=bool), "gap_tolerance": 1e-9,
        "strain": "free", "i_c": np.array([0, 1, 1]), "j_c": np.array([0, 1, 0]),
        "image_cd": np.array([[0, 1], [0, 1], [1, 0]]), "i_l": np.array([0]), "j_l": np.array([1]),
        "image_ld": np.zeros((1, 2), dtype=int), "strict_verdict": "", "collective_verdict": "not jammed",
        "collective_strain_dd": np.zeros((2, 2)),
    }  # fmt: skip
    assert forged(tmp_path, **arrays, collective_displacement_nd=np.array([[0.0, 1.0], [0.0, -1.0]]))
    # apart one stretches the link and closes the contact, together the link alone becomes shorter
    for apart in (1.0, -1.0):
        found = forged(tmp_path, **arrays, collective_displacement_nd=apart * np.array([[-1.0, 0.0], [1.0, 0.0]]))
        assert not found and "stretches a link" in str(found)


def test_linked_discs_that_nothing_holds_are_no_backbone(tmp_path):
    # three in a row far from all others; that their motion keeps links is no proof of what is jammed
    row = np.array([[1.0, 2.0], [2.0, 2.0], [3.0, 2.0]])
    none = {**{f"{n}_c": np.zeros(0, dtype=int) for n in "ij"}, "image_cd": np.zeros((0, 2), dtype=int)}
    arrays = {
        "kind": "certificate of jamming", "version": 1, "position_nd": row, "radius_n": np.full(3, 0.5),
        "lattice_dd": np.diag([8.0, 8.0]), "gap_tolerance": 1e-9, "strain": "free", **none, "strict_verdict": "",
        "i_l": np.array([0, 1]), "j_l": np.array([1, 2]), "image_ld": np.zeros((2, 2), dtype=int),
        "collective_verdict": "not jammed", "collective_strain_dd": np.zeros((2, 2)),
        "collective_displacement_nd": np.array([[0.0, 1.0], [0.0, 0.0], [0.0, -1.0]]),
    }  # fmt: skip
    assert forged(tmp_path, **arrays, backbone_n=np.zeros(3, dtype=bool))
    found = forged(tmp_path, **arrays, backbone_n=np.ones(3, dtype=bool))
    assert not found and "can be taken out" in str(found)
    # in a box that they fill they hold each other, and an empty backbone says nothing
    full = {
        "position_nd": np.array([[0.5, 0.5], [1.5, 0.5]]),
        "radius_n": np.full(2, 0.5),
        "lattice_dd": np.diag([2.0, 1.0]),
    }
    one = {"i_l": np.array([0]), "j_l": np.array([1]), "image_ld": np.zeros((1, 2), dtype=int)}
    moved = {"collective_displacement_nd": np.array([[0.0, 1.0], [0.0, -1.0]])}
    assert not forged(tmp_path, **arrays | full | one | moved, backbone_n=np.zeros(2, dtype=bool))


def test_a_rattler_that_moves_says_nothing_of_the_backbone(tmp_path, written):
    start = pm.random_packing(32, dimension=2, sizes=pm.Bidisperse(ratio=1.4), packing_fraction=0.84, seed=3)
    run = pm.jam(pm.Scene(start, (pm.Repulsion(),)), pressure=1e-6, strain="isotropic")
    hard = run.report["hard_packing"]
    held = genuine(hard, written)
    rattler = int(np.flatnonzero(~held["backbone_n"])[0])
    moved = np.zeros((32, 2))
    moved[rattler] = 1.0, 0.3
    found = forged(
        tmp_path,
        **held
        | {
            "backbone_n": held["backbone_n"] | (np.arange(32) == rattler),
            "collective_verdict": "not jammed", "strict_verdict": "",
            "collective_displacement_nd": moved, "collective_strain_dd": np.zeros((2, 2)),
        },
    )  # fmt: skip
    assert not found and "can be taken out" in str(found)


def test_a_part_that_is_jammed_is_no_proof_where_others_hold_each_other(tmp_path, written):
    # a disc that touches its images, and a ring of four in its hole: these are held, and turn
    small = (0.5**0.5 - 0.5) / (1.0 + 2.0**0.5)
    ring = [[0.5 + small * x, 0.5 + small * y] for x, y in ((1, 1), (-1, 1), (-1, -1), (1, -1))]
    packing = pm.Packing([[0.0, 0.0], *ring], [0.5, *[small] * 4], pm.Box.cubic(1.0, 2))
    held = genuine(packing, written)
    assert str(held["collective_verdict"]) == "not jammed" and forged(tmp_path, **held)
    alone = (held["i_c"] == 0) & (held["j_c"] == 0)
    found = forged(
        tmp_path,
        **held
        | {name: held[name][alone] for name in ("i_c", "j_c", "image_cd")}
        | {
            "backbone_n": np.arange(5) == 0, "collective_verdict": "jammed", "strict_verdict": "",
            "collective_force_c": np.ones(int(alone.sum())),
        },
    )  # fmt: skip
    assert not found and "not in the backbone hold each other" in str(found)


def test_a_particle_is_held_where_its_normals_are_in_no_closed_half_space():
    for tilt, loose in ((0.01, False), (1e-12, True), (-0.01, True)):
        angle = np.array([0.5 * np.pi, np.pi + tilt, -tilt])
        flat = np.stack([np.cos(angle), np.sin(angle)], axis=1)
        assert referee._is_loose(flat, 2) is loose
        # a tripod, and one normal against its axis
        angle = 2.0 * np.pi / 3.0 * np.arange(3)
        legs = np.stack([np.cos(tilt) * np.cos(angle), np.cos(tilt) * np.sin(angle), np.full(3, -np.sin(tilt))], axis=1)
        assert referee._is_loose(np.vstack([legs, [[0.0, 0.0, 1.0]]]), 3) is loose
    for d in (2, 3):
        assert all(referee._is_loose(np.eye(d)[:k], d) for k in range(d + 1))


def test_one_particle_alone_is_not_jammed_for_free(tmp_path, written):
    held = genuine(pm.lattice_packing("triangular", repeats=(3, 3)), written)
    held["backbone_n"] = np.arange(9) == 0
    for name in ("i_c", "j_c", "image_cd", "collective_force_c", "strict_force_c"):
        held[name] = held[name][:0]
    assert not forged(tmp_path, **held)


def test_a_particle_held_by_its_own_images_is_not_taken_out(tmp_path, written):
    held = genuine(pm.lattice_packing("triangular", repeats=(3, 3)), written)
    one = pm.lattice_packing("triangular", repeats=(1, 1))
    held |= {"position_nd": one.position_nd, "radius_n": one.radius_n, "lattice_dd": one.box.lattice_dd}
    held["backbone_n"] = np.zeros(1, dtype=bool)
    for name in ("i_c", "j_c", "image_cd"):
        held[name] = held[name][:0]
    for name in ("collective", "strict"):
        held[f"{name}_verdict"] = np.array("not jammed")
    found = forged(tmp_path, **held)
    assert not found and "hold each other" in str(found)


def test_numbers_that_are_too_large_to_be_added_up_prove_nothing():
    matrix = np.full((3, 4), 1e200)
    with pytest.raises(referee.Refused, match="too large|no full rank"), np.errstate(all="ignore"):
        referee._smallest_singular_value(matrix, 2, 2)


def test_a_particle_inside_of_another_is_refused_wherever_it_belongs(tmp_path, written):
    held = genuine(pm.lattice_packing("triangular", repeats=(3, 3)), written)
    held["position_nd"] = np.vstack([held["position_nd"], held["position_nd"][:1] + 0.1])
    held["radius_n"], held["backbone_n"] = np.append(held["radius_n"], 0.5), np.append(held["backbone_n"], False)
    found = forged(tmp_path, **held)
    assert not found and "overlap by" in str(found)


def test_damaged_and_boundless_archives_are_refused_and_not_raised(tmp_path, written):
    path = written(pm.classify_jamming(pm.lattice_packing("triangular", repeats=(3, 3))))
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    for _ in range(60):
        damaged = bytearray(whole)
        damaged[int(rng.integers(len(whole)))] ^= int(rng.integers(1, 256))
        path.write_bytes(bytes(damaged))
        # bytes that nobody reads may be any
        pm.verify(path)


def test_contacts_of_what_is_said_to_rattle_are_refused(tmp_path, written):
    held = genuine(pm.lattice_packing("triangular", repeats=(3, 3)), written)
    held["backbone_n"][4] = False
    found = forged(tmp_path, **held)
    assert not found and "contacts must be between particles of the backbone" in str(found)
