"""How a scene file says its packing and its bonds: functions whose parameters are the fields of a table.

The kind of a packing is the name of its function. Some parameters the scene gives: `folder`, where the file lies;
`packing`, which bonds are made for; and `law`, that of the scene's repulsion, unless the table has one.
"""

from __future__ import annotations

import inspect
import typing
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.check import brief, function, one_of
from packmech.effects import (
    BY_KIND,
    ROUGHNESS,
    BondLimits,
    Bonds,
    ByKind,
    DampingRatio,
    Harmonic,
    HeldStress,
    LawPerKind,
    LinearSpring,
    Mindlin,
    PerKind,
    Repulsion,
    WallMotion,
    damps,
    registered_effects,
    registered_laws,
)
from packmech.effects.bonds import bond_contacts
from packmech.effects.laws import Law
from packmech.files.packings import read_packing
from packmech.files.records import Kinds, OpenKinds, kind_of, kinds_of, to_table
from packmech.generate import (
    Bidisperse,
    Cluster,
    Dimer,
    Ellipses,
    LinearCluster,
    LogNormal,
    Mixture,
    Monodisperse,
    Normal,
    RingCluster,
    Shape,
    SizeDistribution,
    StarCluster,
    Superellipses,
    Trimer,
    Uniform,
    assign_kinds,
    chain_packing,
    cluster_packing,
    cut_fragments,
    fill_box,
    lattice_packing,
    random_packing,
)
from packmech.links import Links
from packmech.packing import Packing, masses_of_density
from packmech.scene import Scene
from packmech.shapes import Beads, Shapes, Spheroids, Superellipsoids

Vectors = tuple[tuple[float, ...], ...]
P = TypeVar("P", bound=Callable[..., Packing])

_SIZES, _LAW, _SPRING = Bidisperse(), Harmonic(), LinearSpring()

_CLUSTERS = kinds_of((Cluster, Dimer, Trimer, RingCluster, StarCluster, LinearCluster))
# the records that may stand in the fields of a packing, by name
NESTED = {
    "sizes": kinds_of((Monodisperse, Bidisperse, Mixture, Uniform, Normal, LogNormal)),
    "shape": _CLUSTERS,
    "shapes": _CLUSTERS | kinds_of((Ellipses, Superellipses)),
}
# the functions that make packings, by kind
PACKINGS: dict[str, Callable[..., Packing]] = {}


def packing_kind(recipe: P) -> P:
    """Return the function registered as a kind of packing that scene files can name.

    Parameters
    ----------
    recipe
        A function that returns a Packing. Its name, with hyphens, is the kind, and its parameters are the fields of the
        table `[packing]`; numbers, texts and tuples of them are checked by their annotations. A parameter `folder` is
        no field: it is given where the scene file lies; a parameter `law` is given that of the scene's repulsion unless
        the table has one. With a parameter `seed` the packing is random: `packmech run --seed` draws another.

    Raises
    ------
    TypeError, ValueError
        If it is no function, or has the name of a kind that packmech ships.

    Examples
    --------
    >>> import packmech as pm
    >>> @pm.packing_kind
    ... def row(particles: int, distance: float = 1.0) -> pm.Packing:
    ...     box = pm.Box([[particles * distance, 0.0], [0.0, 2.0]])
    ...     return pm.Packing([[k * distance, 1.0] for k in range(particles)], [0.5] * particles, box)
    >>> "row" in PACKINGS
    True

    """
    function("recipe", recipe)
    kind = kind_of(recipe)
    if kind in PACKINGS and PACKINGS[kind].__module__ == __name__ != recipe.__module__:
        raise ValueError(f"recipe must have a name that none of packmech's kinds of packings has, got {brief(kind)}")
    PACKINGS[kind] = recipe
    return recipe


def is_random(tables: Mapping[str, Any]) -> bool:
    """Whether another seed changes the packing of a scene's tables: its start, or its kinds of particles, are drawn."""
    packing, drawn = (found if isinstance(found, Mapping) else {} for found in map(tables.get, ("packing", "kinds")))
    kind = packing.get("kind")
    return "seed" in drawn or (kind in PACKINGS and "seed" in inspect.signature(PACKINGS[kind]).parameters)


# fields of generators that a table holds in other types than the function takes
_FIELD_TYPES: dict[str, Any] = {
    "radii": float | tuple[float, ...] | None,
    "angles": str | float | tuple[float, ...],
    "form": str | tuple[int, ...],
    "winding": tuple[int, ...] | None,
    "seed": int,
}


def _add_generator(kind: str, generator: Callable[..., Packing], **defaults: Any) -> None:
    """Register a generator of random packings: its parameters are the fields of the table.

    A seed must be given, and the box is given by its lattice vectors.
    """
    defaults = {"dimension": 2, **defaults}

    def recipe(*, lattice_vectors: Vectors | None = None, **fields: Any) -> Packing:
        return generator(box=_box_shape(lattice_vectors), **defaults | fields)

    hints = typing.get_type_hints(generator) | _FIELD_TYPES
    parameters = []
    for name, one in inspect.signature(generator).parameters.items():
        if name == "box":
            one = inspect.Parameter("lattice_vectors", one.kind, default=None, annotation=Vectors | None)
        elif name == "seed" or name in defaults:
            one = one.replace(default=defaults.get(name, inspect.Parameter.empty))
        if name != "rng":
            parameters.append(one.replace(kind=inspect.Parameter.KEYWORD_ONLY))
    recipe.__qualname__, recipe.__doc__ = kind, generator.__doc__
    recipe.__annotations__ = {one.name: hints.get(one.name, one.annotation) for one in parameters}
    recipe.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    packing_kind(recipe)


_add_generator("random", random_packing, sizes=_SIZES)
_add_generator("clusters", cluster_packing)
_add_generator("chains", chain_packing)


@packing_kind
def _lattice(
    name: str,
    repeats: int | tuple[int, ...] | None = None,
    supercell: tuple[tuple[int, ...], ...] | None = None,
    conventional: bool = False,
    relative_overlap: float = 0.0,
    diameter: float = 1.0,
    density: float | None = None,
) -> Packing:
    """Return what `lattice_packing` makes; `supercell` has one box vector a line."""
    return lattice_packing(
        name,
        repeats,
        supercell=None if supercell is None else np.array(supercell).T,
        conventional=conventional,
        relative_overlap=relative_overlap,
        diameter=diameter,
        density=density,
    )


@packing_kind
def _prepared(
    particles: int,
    packing_fraction: float,
    seed: int,
    dimension: int = 2,
    sizes: SizeDistribution = _SIZES,
    side: float | None = None,
    lattice_vectors: Vectors | None = None,
    law: Law = _LAW,
    force_tolerance: float = 1e-10,
    density: float | None = None,
    shapes: Ellipses | Superellipses | Shape | None = None,
) -> Packing:
    """Return a random packing at its energy minimum under the law, without friction and bonds.

    With a `side` or `lattice_vectors` the box is this very one and the radii fill it (`fill_box`), else the smallest
    diameter is 1.
    """
    if side is not None and lattice_vectors is not None:
        raise ValueError(f"side must be left out where lattice_vectors are given, got {brief(side)}")
    drawing: dict[str, Any] = {"packing_fraction": packing_fraction, "sizes": sizes, "seed": seed}
    drawing |= {"density": density, "shapes": shapes}
    if side is not None:
        drawn = fill_box(Box.cubic(side, dimension), particles, **drawing)
    elif lattice_vectors is not None:
        drawn = fill_box(Box(_columns(lattice_vectors)), particles, **drawing)
    else:
        drawn = random_packing(particles, dimension=dimension, **drawing)
    from packmech.minimize.quench import quench  # brings SciPy

    return quench(Scene(drawn, (Repulsion(law),)), force_tolerance=force_tolerance).packing


@packing_kind
def _file(
    path: str,
    folder: Path,
    density: float | None = None,
    frame: int | None = None,
    format: str | None = None,
    lattice_vectors: Vectors | None = None,
    radius: float | None = None,
) -> Packing:
    """Return the packing in a file; its path is relative to the scene file. `frame` is one of a trajectory.

    `format`, the lattice vectors of a box, one in a line, and a `radius` say what a file of another program does not.
    """
    box = None if lattice_vectors is None else Box(_columns(lattice_vectors))
    packing = read_packing(folder / path, frame=frame, format=format, box=box, radius=radius)
    if density is None:
        return packing
    if packing.given_mass_n is not None:
        raise ValueError(f"density must be left out where the file has masses, got {brief(density)}")
    return packing.replace(mass_n=masses_of_density(density, packing.radius_n, packing.dimension))


@packing_kind
def _inline(
    lattice_vectors: Vectors,
    positions: Vectors,
    radii: tuple[float, ...],
    link_pairs: tuple[tuple[int, ...], ...] | None = None,
    link_images: tuple[tuple[int, ...], ...] | None = None,
    link_lengths: tuple[float, ...] | None = None,
    link_shapes: tuple[bool, ...] | None = None,
    masses: tuple[float, ...] | None = None,
    kinds: tuple[int, ...] | None = None,
    density: float | None = None,
    aspects: tuple[float, ...] | None = None,
    directors: Vectors | None = None,
    bead_starts: tuple[int, ...] | None = None,
    bead_offsets: Vectors | None = None,
    bead_sizes: tuple[float, ...] | None = None,
    gyration_radii: Vectors | None = None,
    orientations: Vectors | None = None,
    exponents: tuple[float, ...] | None = None,
    axis_ratios: Vectors | None = None,
) -> Packing:
    """Return the packing of lattice vectors and positions, one in a line, and radii; links have one entry each.

    With `aspects` and `directors`, one in a line, particles are ellipses or spheroids; with `exponents`, `axis_ratios`
    and `orientations` superellipsoids; with the other fields, which are those of `pm.Beads`, rigid bodies.
    """
    box = Box(_columns(lattice_vectors))
    if masses is not None and density is not None:
        raise ValueError(f"density must be left out where masses are given, got {brief(density)}")
    links = None
    if link_pairs is None:
        _left_out({"link_images": link_images, "link_lengths": link_lengths, "link_shapes": link_shapes}, "link_pairs")
    elif link_lengths is None:
        raise ValueError("link_lengths must be given with link_pairs, got nothing")
    else:
        pairs, images = _pairs("link_", link_pairs, link_images, box.dimension)
        shape: Any = None if link_shapes is None else np.array(link_shapes, dtype=bool)
        links = Links(pairs[:, 0], pairs[:, 1], images, np.array(link_lengths), shape)
    bodies = {
        "bead_offsets": bead_offsets,
        "bead_sizes": bead_sizes,
        "gyration_radii": gyration_radii,
        "orientations": orientations,
    }
    shapes: Shapes | None = None
    if exponents is not None:
        others = {"bead_starts": bead_starts, "aspects": aspects, "directors": directors}
        others |= {name: value for name, value in bodies.items() if name != "orientations"}
        given = next((name for name, value in others.items() if value is not None), None)
        if given is not None:
            raise ValueError(f"{given} must be left out where exponents are given, got {brief(others[given])}")
        if axis_ratios is None or orientations is None:
            lacking = "axis_ratios" if axis_ratios is None else "orientations"
            raise ValueError(f"{lacking} must be given with exponents, got nothing")
        rows = _rows("axis_ratios", axis_ratios), _rows("orientations", orientations)
        shapes = Superellipsoids(np.array(exponents), *rows)
    elif axis_ratios is not None:
        _left_out({"axis_ratios": axis_ratios}, "exponents")
    elif bead_starts is not None:
        _left_out({"directors": directors, "aspects": aspects}, "bead_starts")
        missing = next((name for name, value in bodies.items() if value is None), None)
        if missing is not None:
            raise ValueError(f"{missing} must be given with bead_starts, got nothing")
        arrays = [np.array(value) if name == "bead_sizes" else _rows(name, value) for name, value in bodies.items()]  # type: ignore[arg-type]
        shapes = Beads(np.array(bead_starts), *arrays)
    elif aspects is None:
        _left_out({"directors": directors}, "aspects")
        _left_out(bodies, "bead_starts")
    elif directors is None:
        raise ValueError("directors must be given with aspects, got nothing")
    else:
        shapes = Spheroids(np.array(aspects), _rows("directors", directors))
    kind_n = None if kinds is None else np.array(kinds)
    packing = Packing(_rows("positions", positions), np.array(radii), box, links, masses, shapes=shapes, kind_n=kind_n)
    if density is None:
        return packing
    return packing.replace(mass_n=masses_of_density(density, packing.radius_n, packing.dimension))


# what the functions that make packings and bonds call a field of the file
FIELD_OF = {
    "box": "lattice_vectors",
    "lattice_dd": "lattice_vectors",
    "position_nd": "positions",
    "radius_n": "radii",
    "mass_n": "masses",
    "kind_n": "kinds",
    "aspect_n": "aspects",
    "director_nd": "directors",
    "shapes": "directors",
    "start_n": "bead_starts",
    "offset_bd": "bead_offsets",
    "size_b": "bead_sizes",
    "gyration_nk": "gyration_radii",
    "orientation_nq": "orientations",
    "exponent_n": "exponents",
    "ratio_nd": "axis_ratios",
    "i_l": "link_pairs",
    "j_l": "link_pairs",
    "links": "link_pairs",
    "image_ld": "link_images",
    "length_l": "link_lengths",
    "shape_l": "link_shapes",
    "i_b": "pairs",
    "j_b": "pairs",
    "image_bd": "images",
    "rest_length_b": "rest_lengths",
}


def inline_table(packing: Packing) -> dict[str, Any]:
    """Return the table of a packing written out, from which the same packing is read to the last bit."""
    table: dict[str, Any] = {
        "kind": "inline",
        "lattice_vectors": packing.box.lattice_dd.T.tolist(),
        "radii": packing.radius_n.tolist(),
        "positions": packing.position_nd.tolist(),
    }
    if packing.given_mass_n is not None:
        table["masses"] = packing.given_mass_n.tolist()
    if packing.given_kind_n is not None:
        table["kinds"] = packing.given_kind_n.tolist()
    table |= {FIELD_OF[name]: array.tolist() for name, array in packing.shapes.arrays().items()}
    links = packing.links
    if len(links):
        table["link_pairs"] = np.column_stack([links.i_l, links.j_l]).tolist()
        table["link_images"] = links.image_ld.tolist()
        table["link_lengths"] = links.length_l.tolist()
        table["link_shapes"] = links.shape_l.tolist()
    return table


def kinds_of_particles(
    packing: Packing, shares: tuple[float, ...] | None = None, by: str | None = None, seed: int | None = None
) -> Packing:
    """Return the packing with kinds of particles, drawn with given shares or by size: `pm.assign_kinds`.

    Parameters
    ----------
    packing
        The packing that the file says, all of one kind.
    shares
        Share of the particles of kind 0, 1, and so on; they are divided by their sum, and numbers are exact [1].
    by
        "size" in place of shares: kind 0 are the smallest particles.
    seed
        Of the shares: the same seed gives the same kinds. `--seed` draws others.

    """
    if packing.kinds > 1:
        raise ValueError(f"packing must be of one kind of particles in a scene with kinds, got {packing.kinds}")
    return assign_kinds(packing, shares, by=by, seed=seed)


# the record that may stand in a field of bonds
LIMITS = {"breaks_at": kinds_of((BondLimits,))}
# kinds in fields of walls, and of their motions
MOTIONS = {
    **dict.fromkeys(("low_motion", "high_motion"), kinds_of((WallMotion,))),
    **dict.fromkeys("xyz", kinds_of((HeldStress,))),
}


def acting() -> OpenKinds:
    """Return what may stand among the effects of a scene, by kind."""
    return OpenKinds(kinds_of(registered_effects()) | {kind_of(bonds): bonds}, "pm.effect")


def records_in_fields() -> dict[str, Kinds]:
    """Return the records that may stand in fields of effects and of laws, by the name of the field."""
    laws = OpenKinds(kinds_of(registered_laws()), "pm.law")
    rows = kinds_of((ByKind, PerKind))
    dashpots = OpenKinds(kinds_of((*filter(damps, registered_effects()), DampingRatio)), "pm.effect")
    return {
        **dict.fromkeys(("laws", "compression", "tension"), laws),
        "law": OpenKinds(laws | kinds_of((LawPerKind,)), laws.register),
        **dict.fromkeys(dict.fromkeys(name for names in BY_KIND.values() for name in names), rows),
        "damping": OpenKinds(dashpots | kinds_of((PerKind,)), dashpots.register),
        "stiffness": kinds_of((Mindlin,)),
        # of walls
        **{name: kinds_of(kinds) for name, kinds in ROUGHNESS.items()},
        **LIMITS,
        **MOTIONS,
    }


_SPRINGS = ("compression", "tension", "tangential_stiffness", "damping", "tangential_damping")


def bonds(
    packing: Packing,
    of: str | None = None,
    rest: str | None = None,
    gap_tolerance: float | None = None,
    centers: int | None = None,
    lines: int | None = None,
    edge_fuzziness: float | None = None,
    avoided_angle: float | None = None,
    cut_top_bottom: bool | None = None,
    join_isolated: bool | None = None,
    removed_fraction: float | None = None,
    spanning: str | None = None,
    axis: int | None = None,
    seed: int | None = None,
    tries: int | None = None,
    pairs: tuple[tuple[int, ...], ...] | None = None,
    images: tuple[tuple[int, ...], ...] | None = None,
    rest_lengths: tuple[float, ...] | None = None,
    compression: Law = _SPRING,
    tension: Law = _SPRING,
    tangential_stiffness: float = 1.0,
    damping: float = 0.0,
    tangential_damping: float = 0.0,
    breaks_at: BondLimits | None = None,
) -> Bonds:
    """Return the bonds of a packing.

    `of = "contacts"` makes them of the packing's contacts, with `rest` and `gap_tolerance` of `bond_contacts`, and cuts
    them with the arguments of `cut_fragments` where a `seed` is given. Otherwise they are written out: `pairs` of
    particles, `rest_lengths`, and `images` where some are not zero.
    """
    fields = locals()
    springs = {name: fields[name] for name in (*_SPRINGS, "breaks_at")}
    making = {"rest": rest, "gap_tolerance": gap_tolerance}
    names = inspect.signature(cut_fragments).parameters
    cutting = {name: value for name, value in fields.items() if name in names and name not in ("packing", "bonds")}
    if of is not None:
        one_of("of", of, ("contacts",))
        _left_out({"pairs": pairs, "images": images, "rest_lengths": rest_lengths}, "of = 'contacts'", given=True)
        made = bond_contacts(packing, **_given(making), **springs)
        if seed is not None:
            return cut_fragments(made, packing, **_given(cutting))
        _left_out(cutting, "a seed")
        return made
    _left_out(making | cutting, "of = 'contacts'")
    if pairs is None:
        raise ValueError("pairs must be given (or of = 'contacts'), got nothing")
    if rest_lengths is None:
        raise ValueError("rest_lengths must be given with pairs, got nothing")
    pair_bk, image_bd = _pairs("", pairs, images, packing.dimension)
    return Bonds(pair_bk[:, 0], pair_bk[:, 1], image_bd, np.array(rest_lengths, dtype=float), **springs)


def bonds_table(bonds: Bonds) -> dict[str, Any]:
    """Return the table of bonds written out, from which the same bonds are read to the last bit."""
    springs = {name: getattr(bonds, name) for name in _SPRINGS}
    return {
        "kind": kind_of(Bonds),
        "pairs": np.column_stack([bonds.i_b, bonds.j_b]).tolist(),
        "images": bonds.image_bd.tolist(),
        "rest_lengths": bonds.rest_length_b.tolist(),
        **{name: value if isinstance(value, float) else to_table(value) for name, value in springs.items()},
        **({} if bonds.breaks_at is None else {"breaks_at": to_table(bonds.breaks_at)}),
    }


def _given(fields: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in fields.items() if value is not None}


def _left_out(fields: dict[str, Any], what: str, *, given: bool = False) -> None:
    for name, value in _given(fields).items():
        raise ValueError(f"{name} must be left out {'with' if given else 'without'} {what}, got {brief(value)}")


def _pairs(prefix: str, pairs: Any, images: Any, dimension: int) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return (P, 2) particles and (P, d) images of pairs; images are zero unless given."""
    images = ((0,) * dimension,) * len(pairs) if images is None else images
    for name, rows, size in (("pairs", pairs, 2), ("images", images, dimension)):
        for k, row in enumerate(rows):
            if len(row) != size:
                raise ValueError(f"{prefix}{name}[{k}] must hold {size} numbers, got {len(row)}")
    return (
        np.array(pairs, dtype=np.int64).reshape(-1, 2),
        np.array(images, dtype=np.int64).reshape(-1, dimension),
    )


def _rows(name: str, rows: Vectors) -> NDArray[np.float64]:
    if len({len(row) for row in rows}) > 1:
        raise ValueError(f"{name} must hold rows of one length, got lengths {sorted({len(row) for row in rows})}")
    return np.array(rows, dtype=np.float64)


def _columns(vectors: Vectors) -> NDArray[np.float64]:
    return _rows("lattice_vectors", vectors).T


def _box_shape(vectors: Vectors | None) -> NDArray[np.float64] | None:
    return None if vectors is None else _columns(vectors)
