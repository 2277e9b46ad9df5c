"""What may stand in a scene file, read off the records and functions that its tables name; and files with comments."""

from __future__ import annotations

import inspect
import textwrap
import types
import typing
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import tomli_w

from packmech.calls.docstrings import first_sentence, meanings_of
from packmech.effects import ByKind, LawByKind
from packmech.effects.body import Walls
from packmech.effects.materials import MIXED, Material
from packmech.files.records import Kinds, Maker, holds_record, is_record, kinds_of, to_table
from packmech.scene import drive_code, registered_drives
from packmech.scenes.material_tables import exception, mixing
from packmech.scenes.recipes import NESTED, PACKINGS, acting, kinds_of_particles, records_in_fields

_WORDS = {float: "number", int: "integer", str: "text", bool: "true or false"}
_WIDTH = 100
_OF_MATERIAL = (
    "This table has no kind. It stands in place of `[[effects]]`, or beside others: it gives the repulsion, the "
    "dashpots and the friction of contacts, the density of a packing that names none, and the law, damping and "
    "friction of walls that name none. Where particles are of several kinds there is a table `[[material]]` for each: "
    "the first is that of kind 0. Each of these may have a `name`, a text. Walls say by their `material` of which they "
    "are."
)
# what is said of tables without a kind
_WITHOUT_KIND: dict[Maker, str] = {
    Material: _OF_MATERIAL,
    mixing: "This table has no kind. It stands beside a `[[material]]` for each kind. Stiffnesses have no means: they "
    "follow from the constants of both.",
    exception: "These tables have no kind. Each stands for one pair of the `[[material]]` of a scene, and gives one "
    "constant of it at least.",
}
# fields of packings that mean something else in a file than the argument of that name, or have another name
_IN_FILES = {
    "seed": "Of the random start: the same seed gives the same bits. `--seed` draws another.",
    "lattice_vectors": "Vectors of the box, one in a line; those of random packings give its shape only (square or "
    "cubic unless given), and the packing fraction its size.",
    "positions": "Centers, one in a line [length].",
    "radii": "Of all particles [length].",
    "kinds": "Of the particles, whole numbers from 0.",
}
# tables by kinds, whose pairs a file cannot name
_ROWS = "rows of a symmetric square, entry (a, b) for kinds a and b, or a list with one for each pair (0, 0), (1, 0), "
_BY_KIND: dict[tuple[Maker, str], str] = {
    (LawByKind, "laws"): f"Laws of one class: {_ROWS}(1, 1), (2, 0), ...",
    (ByKind, "numbers"): f"Numbers: {_ROWS}(1, 1), (2, 0), ...",
}

_EXAMPLE = (
    "[packing]\n"
    'kind = "lattice"\n'
    'name = "triangular"\n'
    "repeats = [3, 3]\n"
    "\n"
    "[kinds]\n"
    "shares = [2, 1]\n"
    "seed = 1\n"
    "\n"
    "[[effects]]\n"
    'kind = "repulsion"\n'
    "[effects.law]\n"
    'kind = "law-by-kind"\n'
    "laws = [\n"
    '    [{ kind = "harmonic", energy_scale = 1.0 }, { kind = "harmonic", energy_scale = 1.5 }],\n'
    '    [{ kind = "harmonic", energy_scale = 1.5 }, { kind = "harmonic", energy_scale = 3.0 }],\n'
    "]\n"
    "\n"
    "[[effects]]\n"
    'kind = "friction"\n'
    "coefficient = { numbers = [[0.5, 0.1], [0.1, 0.3]] }\n"
    "stiffness = 0.5\n"
    "\n"
    "[[effects]]\n"
    'kind = "walls"\n'
    "low = -0.1\n"
    "high = 2.4\n"
    'law = { kind = "law-per-kind", laws = ["harmonic", { kind = "harmonic", energy_scale = 2.0 }] }\n'
    'friction = { kind = "friction", coefficient = { values = [0.5, 0.2] }, stiffness = 0.5 }\n'
)
# parameters of `kinds_of_particles` that are no fields
_OF_KINDS = ("packing",)


class Field(NamedTuple):
    """A field of a table: its name, what stands there, its default as TOML ("" where it must be given), its meaning."""

    name: str
    kind: str
    default: str
    meaning: str


# a field of walls that no record has
_MATERIAL_OF_WALLS = Field(
    "material",
    "integer or text",
    "unset",
    "Beside several tables `[[material]]`: the name of that which the walls are made of, or its number, 0 for the "
    "first. Law, damping and friction that are not given follow from it and the material of each kind of particles.",
)


def _default(value: Any) -> str:
    """Return a default as TOML."""
    if value is None:
        return "unset"
    if is_record(value):
        table = to_table(value)
        return f'"{table["kind"]}"' if len(table) == 1 else _inline(table)
    return _inline(list(value) if isinstance(value, tuple) else value)


def _inline(value: Any) -> str:
    """Return a value in one line of TOML."""
    if isinstance(value, Mapping):
        return "{ " + ", ".join(f"{name} = {_inline(one)}" for name, one in value.items()) + " }"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_inline, value)) + "]"
    return tomli_w.dumps({"x": value}).partition(" = ")[2].strip()


def _words(hint: Any) -> str:
    """Return what stands in a field of this annotation."""
    options = typing.get_args(hint) if isinstance(hint, types.UnionType) else (hint,)
    said: list[str] = []
    for one in options:
        if typing.get_origin(one) is typing.Literal:
            said += [repr(word).replace("'", '"') for word in typing.get_args(one)]
        elif typing.get_origin(one) is tuple:
            inner = typing.get_args(one)[0]
            words = "rows" if typing.get_origin(inner) is tuple else f"{_words(inner)}s" if _words(inner) else ""
            said.append(f"list of {words}" if words else "list")
        elif one in _WORDS:
            said.append(_WORDS[one])
    return " or ".join(dict.fromkeys(said))


def fields_of(maker: Maker, nested: Mapping[str, Kinds], *, given: Iterable[str] = ()) -> list[Field]:
    """Return the fields of the table that describes what a class or a function makes.

    Parameters
    ----------
    maker
        A record class, or a function.
    nested
        The kinds of records that may stand in a field, by its name.
    given
        Parameters that are no fields.

    """
    try:
        hints = typing.get_type_hints(
            maker.__init__ if inspect.isclass(maker) and not hasattr(maker, "_fields") else maker
        )
    except (NameError, TypeError):
        hints = {}
    meaning = dict(meanings_of(maker))
    found = []
    for name, one in inspect.signature(maker).parameters.items():
        if name in given:
            continue
        hint = hints.get(name, Any)
        kinds = nested.get(name) if holds_record(hint) else None
        if kinds is None:
            words = _words(hint)
        else:
            words = f"a table of {next(iter(kinds))}" if len(kinds) == 1 else "a kind of " + name.rstrip("s")
            words = " or ".join(filter(None, (_words(hint), words)))
        required = one.default is inspect.Parameter.empty
        if maker in PACKINGS.values() and (name == "seed" or name not in meaning):
            meaning[name] = _IN_FILES.get(name, "")
        if (maker, name) in _BY_KIND:
            meaning[name] = _BY_KIND[maker, name]
        found.append(Field(name, words, "" if required else _default(one.default), meaning.get(name, "")))
    return [*found, _MATERIAL_OF_WALLS] if maker is Walls else found


def _places() -> Iterator[tuple[str, Kinds, Mapping[str, Kinds], tuple[str, ...]]]:
    """Give the tables of a scene file: title, kinds, kinds of records in fields, parameters that are no fields.

    A table without a kind has the empty one.
    """
    nested = records_in_fields()
    yield "[packing]", PACKINGS, NESTED | nested, ("folder",)
    yield "[material]", {"": Material}, {}, ()
    yield "[mixing]", {"": mixing}, {}, ()
    yield "[[exception]]", {"": exception}, {}, ()
    yield "[[effects]]", acting(), nested, ("packing",)
    for name, cls in registered_drives().items():
        methods = {field: kinds_of(classes()) for field, classes in drive_code(cls).nested.items()}
        yield f"[drive] {name}", {name: cls}, methods, ()


def commented_scene(tables: Mapping[str, Any]) -> str:
    """Return the tables of a scene as the text of a TOML file that says what each field means.

    Fields that have their defaults stand there as comments.
    """
    lines = [
        "# A scene of packmech; run it with: packmech run THIS_FILE. Lines that begin with # are comments; those of",
        "# the form `# name = value` are defaults: take the # away to change them. See: packmech guide scene-files",
    ]
    if tables.get("description"):
        lines += [f"description = {_inline(tables['description'])}"]
    nested = records_in_fields()
    lines += ["", "[packing]"]
    lines += _table_lines(tables["packing"], PACKINGS, NESTED | nested, ("folder",))
    if "kinds" in tables:
        lines += ["", "[kinds]", *_comment(first_sentence(kinds_of_particles))]
        lines += _field_lines(tables["kinds"], kinds_of_particles, {}, _OF_KINDS)
    materials = tables.get("material", [])
    for one in materials if isinstance(materials, list) else [materials]:
        title = "[[material]]" if isinstance(materials, list) else "[material]"
        lines += ["", title, *_comment(first_sentence(Material))]
        lines += [f"name = {_inline(one['name'])}"] if "name" in one else []
        lines += _field_lines(one, Material, {}, ())
    if "mixing" in tables:
        named = tables["mixing"]
        means = dict.fromkeys(MIXED, named) if isinstance(named, str) else named
        lines += ["", "[mixing]", *_comment(first_sentence(mixing)), *_field_lines(means, mixing, {}, ())]
    for one in tables.get("exception", ()):
        lines += ["", "[[exception]]", *_comment(first_sentence(exception)), *_field_lines(one, exception, {}, ())]
    for one in tables.get("effects", ()):
        lines += ["", "[[effects]]", *_table_lines(one, acting(), nested, ("packing",))]
    if "drive" in tables:
        cls = registered_drives()[tables["drive"]["kind"]]
        methods = {name: kinds_of(classes()) for name, classes in drive_code(cls).nested.items()}
        lines += ["", "[drive]", *_table_lines(tables["drive"], registered_drives(), methods, ())]
    return "\n".join(lines) + "\n"


def _table_lines(
    table: Mapping[str, Any], kinds: Kinds, nested: Mapping[str, Kinds], given: tuple[str, ...]
) -> list[str]:
    kind = table["kind"]
    others = ", ".join(f'"{name}"' for name in kinds if name != kind)
    lines = _comment(f"{first_sentence(kinds[kind])} Others: {others}")
    return [*lines, f"kind = {_inline(kind)}", *_field_lines(table, kinds[kind], nested, given)]


def _field_lines(
    table: Mapping[str, Any], maker: Maker, nested: Mapping[str, Kinds], given: tuple[str, ...]
) -> list[str]:
    lines: list[str] = []
    for field in fields_of(maker, nested, given=given):
        words = field.meaning
        if field.name in nested and field.kind != _WORDS[float]:
            words += f" Kinds: {', '.join(nested[field.name])}."
        if field.name in table:
            lines += [*_comment(words), f"{field.name} = {_inline(table[field.name])}"]
        elif field.default not in ("", "unset"):
            lines += [*_comment(words), f"# {field.name} = {field.default}"]
        else:
            lines += _comment(f"{field.name} ({field.kind or 'a value'}; not set): {words}")
    return lines


def _comment(text: str) -> list[str]:
    return [f"# {line}" for line in textwrap.wrap(" ".join(text.split()), _WIDTH, break_on_hyphens=False)]


def scene_reference() -> str:
    """Return every table, kind and field of a scene file as Markdown."""
    parts = [
        "# Scene files",
        "Every table, kind and field that may stand in a scene file, with defaults and units.",
        "This page is made from the records that a file is read into (`packmech.scenes.reference.scene_reference`). "
        "`packmech new my.toml` writes a file with comments to begin with, `packmech scenes` lists those that ship.",
        "A table names its `kind`; a field whose default is `unset` may be left out. A record in a table is a table, "
        'or just the name of its kind: `law = "hertz"`. Values are changed from the command line with '
        "`--set packing.particles=500 --set effects.friction.coefficient=0.1`.",
        "Laws and numbers that differ by kinds of particles are tables, of rows of a symmetric square for pairs, and "
        "of one entry for each kind for walls:",
        f"```toml by-kinds.toml\n{_EXAMPLE}```",
    ]
    shown: dict[str, Kinds] = {}
    for title, kinds, nested, given in _places():
        parts.append(f"## `{title}`")
        for name, maker in kinds.items():
            parts += _kind_text(name, maker, nested, given, "###")
        if kinds is PACKINGS:
            parts += ["## `[kinds]`", *_kind_text("", kinds_of_particles, {}, _OF_KINDS, "")]
        shown |= {field: found for field, found in nested.items() if field not in shown and found}
    # fields that hold the same kinds are one part
    fields: dict[tuple[str, ...], list[str]] = {}
    for field, kinds in shown.items():
        fields.setdefault(tuple(kinds), []).append(field)
    for names in fields.values():
        which = "a field" if len(names) == 1 else "fields"
        parts.append(f"## Records in {which} " + ", ".join(f"`{name}`" for name in names))
        for name, maker in shown[names[0]].items():
            parts += _kind_text(name, maker, shown, (), "###")
    return "\n\n".join(parts) + "\n"


def _kind_text(name: str, maker: Maker, nested: Mapping[str, Kinds], given: tuple[str, ...], level: str) -> list[str]:
    parts = [f'{level} `kind = "{name}"`' if name else _WITHOUT_KIND.get(maker, ""), first_sentence(maker)]
    fields = fields_of(maker, nested, given=given)
    if fields:
        rows = ["| field | what stands there | default | meaning |", "|---|---|---|---|"]
        for one in fields:
            default = f"`{one.default}`" if one.default else "must be given"
            rows.append(
                "| "
                + " | ".join(text.replace("|", "\\|") for text in (f"`{one.name}`", one.kind, default, one.meaning))
                + " |"
            )
        parts.append("\n".join(rows))
    return [part for part in parts if part]
