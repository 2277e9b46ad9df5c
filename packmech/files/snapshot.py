"""A packing with what else belongs to it at one moment: arrays of its particles, springs, forces of its contacts."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from packmech.calls.display import shown
from packmech.check import brief, finite_array, instance, integer, integer_array, listed, table
from packmech.effects.bonds import Bonds
from packmech.packing import DISCRETE_SIZES, Packing

# fields that formats have names of their own for, as warnings call them
FIELD_WORDS = {"velocity_nd": "velocities", "force_nd": "forces", "spin_nk": "spins", "torque_nk": "torques"}
# names that a field cannot have: those of what a packing holds itself
_TAKEN = frozenset(("position_nd", "radius_n", "mass_n", "aspect_n", "director_nd", "kind_n"))


@shown()
@dataclass(frozen=True, eq=False)
class ContactData:
    """Forces of contacts as files keep them.

    Attributes
    ----------
    i_c, j_c
        (C,) particles.
    image_cd
        (C, d) integer vectors: x_j - x_i + lattice @ image is the vector from center to center.
    normal_c
        (C,) normal forces, positive for repulsion [force].
    tangential_cd
        (C, d) tangential forces on particle i [force].

    """

    i_c: NDArray[np.int64]
    j_c: NDArray[np.int64]
    image_cd: NDArray[np.int64]
    normal_c: NDArray[np.float64]
    tangential_cd: NDArray[np.float64]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, ContactData) and all(
            np.array_equal(one, other.arrays()[name]) for name, one in self.arrays().items()
        )

    __hash__ = None  # type: ignore[assignment]

    def arrays(self) -> dict[str, NDArray[Any]]:
        """Return the arrays by name."""
        return {name: getattr(self, name) for name in self.__dataclass_fields__}


@shown()
@dataclass(frozen=True, eq=False, repr=False)
class Snapshot:
    """A packing with arrays of its particles, springs between them, and forces of its contacts, as files hold them.

    Parameters
    ----------
    packing
        The packing.
    fields
        Arrays (N,) or (N, k) of numbers, or (N,) of words, by name. Those called `velocity_nd`, `spin_nk`, `force_nd`
        and `torque_nk` stand where formats have a place for velocities, angular velocities, forces and torques; others
        have the names that they have in the file.
    bonds
        Springs between particles, `Bonds`, one or several.
    contact_forces
        What `pm.contact_forces` returns, or the `ContactData` that was read from a file; None: not known.
    step
        Number of the step of a run; None where there is none.

    Raises
    ------
    TypeError, ValueError
        Naming the argument, or the field and the particle.

    Examples
    --------
    >>> import packmech as pm
    >>> packing = pm.lattice_packing("square", repeats=(2, 2))
    >>> snapshot = pm.Snapshot(packing, {"velocity_nd": 0.1 * packing.position_nd}, step=3)
    >>> snapshot.fields["velocity_nd"].shape, snapshot.step
    ((4, 2), 3)

    """

    packing: Packing
    fields: Mapping[str, NDArray[Any]] = field(default_factory=dict)
    bonds: tuple[Bonds, ...] = ()
    contact_forces: ContactData | None = None
    step: int | None = None

    def __post_init__(self) -> None:
        instance("packing", self.packing, Packing)
        table("fields", self.fields)
        found = {name: self._field(name, value) for name, value in self.fields.items()}
        bonds = [self.bonds] if isinstance(self.bonds, Bonds) else listed("bonds", self.bonds, "Bonds")
        for one in bonds:
            instance("bonds", one, Bonds)
            last = int(one.j_b.max(initial=-1))
            if last >= self.packing.particles:
                raise ValueError(f"bonds must name particles below {self.packing.particles}, got {last}")
            if len(one) and one.image_bd.shape[1] != self.packing.dimension:
                raise ValueError(
                    f"bonds must have images of {self.packing.dimension} components, got {one.image_bd.shape[1]}"
                )
        object.__setattr__(self, "fields", found)
        object.__setattr__(self, "bonds", tuple(one for one in bonds if len(one)))
        if self.contact_forces is not None:
            object.__setattr__(self, "contact_forces", self._contacts(self.contact_forces))
        if self.step is not None:
            object.__setattr__(self, "step", integer("step", self.step, at_least=0))

    def _field(self, name: str, value: Any) -> NDArray[Any]:
        if name in _TAKEN or not name.strip() or not name.isprintable():
            raise ValueError(f"fields must have names, and of their own, got {brief(name)}")
        array, many, d = np.asarray(value), self.packing.particles, self.packing.dimension
        turning = 1 if d == 2 else 3
        own = {"velocity_nd": d, "force_nd": d, "spin_nk": turning, "torque_nk": turning}.get(name)
        shown, shape = f"fields[{name!r}]", (many, None)[: max(array.ndim, 1)]
        if own is not None:
            found: NDArray[Any] = finite_array(shown, array, shape=shape)
            # files make one column of (N, 1) and of (N,) the same
            found = found[:, None] if found.ndim == 1 else found
            if found.shape != (many, own):
                raise ValueError(f"{shown} must have shape {(many, own)}, got {found.shape}")
        elif array.dtype.kind == "U" and array.shape == (many,):
            found = array.copy()
        elif array.dtype.kind in "iufb" and array.ndim in (1, 2) and len(array) == many:
            if array.dtype.kind == "u":
                found = integer_array(shown, array, shape=(None,) * array.ndim)
            else:
                found = array.astype(np.float64 if array.dtype.kind == "f" else np.int64)
        else:
            found = finite_array(shown, value, shape=shape)
        if own is None and found.ndim == 2 and found.shape[1] == 1:
            found = found[:, 0]
        found.setflags(write=False)
        return found

    def _contacts(self, given: Any) -> ContactData:
        # pm.contact_forces returns a record of a room above this one
        pairs = getattr(given, "contacts", given)
        try:
            i, j, image = pairs.i_c, pairs.j_c, pairs.image_cd
            normal, tangential = given.normal_c, given.tangential_cd
        except AttributeError:
            raise TypeError(
                f"contact_forces must be what pm.contact_forces returns, got {type(given).__name__}"
            ) from None
        d, count = self.packing.dimension, len(np.atleast_1d(i))
        found = ContactData(
            integer_array("contact_forces.i_c", i, shape=(None,), what="contact"),
            integer_array("contact_forces.j_c", j, shape=(count,), what="contact"),
            integer_array("contact_forces.image_cd", image, shape=(count, d), what="contact"),
            finite_array("contact_forces.normal_c", normal, shape=(count,), what="contact", empty=True),
            finite_array("contact_forces.tangential_cd", tangential, shape=(count, d), what="contact", empty=True),
        )
        last = int(max(found.i_c.max(initial=-1), found.j_c.max(initial=-1)))
        if last >= self.packing.particles:
            raise ValueError(f"contact_forces must be of particles below {self.packing.particles}, got {last}")
        return found

    def __eq__(self, other: object) -> bool:
        return (
            isinstance(other, Snapshot)
            and self.packing == other.packing
            and self.fields.keys() == other.fields.keys()
            and all(_same(value, other.fields[name]) for name, value in self.fields.items())
            and self.bonds == other.bonds
            and self.contact_forces == other.contact_forces
            and self.step == other.step
        )

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        held = [f"fields {', '.join(self.fields)}" if self.fields else ""]
        held.append(f"{sum(map(len, self.bonds))} springs" if self.bonds else "")
        held.append(f"forces of {len(self.contact_forces.i_c)} contacts" if self.contact_forces is not None else "")
        held.append("" if self.step is None else f"step {self.step}")
        return "; ".join([f"Snapshot of a {self.packing!r}", *filter(None, held)])

    def at_step(self, step: int) -> Snapshot:
        """Return the snapshot with this step."""
        return dataclasses.replace(self, step=step)

    def beside(self) -> Iterator[str]:
        """Name what the snapshot holds and its packing does not, for warnings."""
        # types that are numbered by kind or size are written so again
        usual = np.array_equal(self.fields.get("type", ()), usual_types(self.packing))
        known = {"type"} if usual else set()
        yield from (words for name, words in FIELD_WORDS.items() if name in self.fields)
        others = [name for name in self.fields if name not in FIELD_WORDS and name not in known]
        if others:
            yield f"fields {', '.join(others)}"
        if self.bonds:
            yield f"{sum(map(len, self.bonds))} springs (bonds)"
        if self.contact_forces is not None:
            yield f"forces of {len(self.contact_forces.i_c)} contacts"


def _same(one: NDArray[Any], other: NDArray[Any]) -> bool:
    return np.array_equal(one, other, equal_nan=one.dtype.kind == other.dtype.kind == "f")


def usual_types(packing: Packing) -> NDArray[np.int64]:
    """Return types of particles from 1: their kinds where there are several, else by size; 1 where sizes are many."""
    if packing.given_kind_n is not None:
        return packing.given_kind_n + 1
    sizes, type_n = np.unique(packing.radius_n, return_inverse=True)
    return np.asarray(type_n + 1 if len(sizes) <= DISCRETE_SIZES else np.ones_like(type_n))
