"""A silo of discs with friction between rough walls whose floor is lowered: stress over depth and on the walls.

    python recordings/silo/silo.py

`janssen.py` draws it, with Janssen's law. Springs of stiffness 1, lengths in mean diameters.
"""

from pathlib import Path

import numpy as np
from cyclopts import run
from filling import GRAVITY, fill

import packmech as pm

# speed of the floor, height of layers
SPEED, LAYER = 3e-4, 2.0
NAMES = ("depth", "vertical", "wall_normal", "wall_shear", "weight", "floor_part")


def measure(scene: pm.Scene, floor: np.ndarray, walls: np.ndarray, width: float) -> np.ndarray:
    """Return by layers the numbers of the names; compression positive, weight is that of all grains over the silo."""
    found, packing = pm.contact_forces(scene), scene.packing
    y, contacts, force_cd, grains = packing.position_nd[:, 1], found.contacts, found.force_cd, int(floor[0])
    top, bottom = float(np.sort(y[:grains])[-round(width / 2.0) :].mean()), float(y[floor].mean()) + 0.5
    level = top - LAYER * (np.arange(int((top - bottom) / LAYER)) + 0.5)
    low = y[contacts.i_c]
    high = low + contacts.vector_cd[:, 1]
    within = (contacts.i_c < grains) & (contacts.j_c < grains)
    crossing = within & ((low < level[:, None]) != (high < level[:, None]))
    vertical = (np.where(low > level[:, None], force_cd[:, 1], -force_cd[:, 1]) * crossing).sum(axis=1) / width
    by_wall, by_floor = (np.isin(contacts.i_c, one) for one in (walls, floor))
    at_wall, at_floor = by_wall ^ np.isin(contacts.j_c, walls), by_floor ^ np.isin(contacts.j_c, floor)
    on_grain_cd = np.where(by_wall[:, None], -force_cd, force_cd)
    near = at_wall & (np.abs(np.where(by_wall, high, low) - level[:, None]) < LAYER / 2.0)
    both = [(one * near).sum(axis=1) / (2.0 * LAYER) for one in (np.abs(on_grain_cd[:, 0]), on_grain_cd[:, 1])]
    weight = float(packing.mass_n[:grains].sum()) * GRAVITY
    borne = abs(float(np.where(by_floor, force_cd[:, 1], -force_cd[:, 1])[at_floor].sum())) / weight
    constant = [np.full(len(level), one) for one in (weight / (width * (top - bottom)), borne)]
    return np.array([top - level, vertical, *both, *constant])


def lower(width: float, height: float, friction: float, seed: int) -> dict[str, np.ndarray]:
    """Return the mean numbers by layers while the floor sinks, so that grains slide down the walls."""
    scene, floor, walls = fill(width, height, friction, seed)
    moving, resting = (pm.FixedParticles(tuple(floor.tolist()), way) for way in ((0.0, -SPEED), ()))
    sinking, looks, further = scene.replace(effects=(*scene.effects, moving)), [], {"duration": 2.0 / SPEED}
    for _ in range(21):
        found = pm.simulate(sinking, **further)
        sinking = sinking.replace(packing=found.packing)
        looks.append(measure(sinking.replace(effects=(*scene.effects, resting)), floor, walls, width))
        further = {"duration": 0.075 / SPEED, "velocity_nd": found.velocity_nd, "spin_nk": found.spin_nk}
    # layers that all looks have; the floor sinks before the first that counts
    layers = min(one.shape[1] for one in looks)
    return dict(zip(NAMES, np.mean([one[:, :layers] for one in looks[1:]], axis=0), strict=True))


def main(
    *,
    width: float = 20.0,
    height: float = 170.0,
    friction: float = 0.5,
    packings: int = 1,
    out: Path = Path(__file__).parent,
    workers: int | None = None,
) -> None:
    """Lower the floor of each silo and write its profiles."""
    grid = {"width": width, "height": height, "friction": friction, "seed": range(packings)}
    found = pm.run_ensemble(lower, grid, out / "members" / "silo", workers=workers).of(grid)
    for k, seed in enumerate(found["seed"]):
        path = out / f"silo-w{width:g}-h{height:g}-mu{friction:g}-seed{seed}.csv"
        table = np.column_stack([*found.arrays(k).values()])
        np.savetxt(path, table, "%.17g", delimiter=",", header=",".join(NAMES), comments="")


if __name__ == "__main__":
    run(main)
