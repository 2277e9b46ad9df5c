"""CPU seconds of rigid clusters against N, of bond-diluted triangular lattices, and how far the two methods agree."""

from __future__ import annotations

import numpy as np

import packmech as pm
from packmech.contacts.network import pair_contacts


def diluted(length: int, share: float, seed: int) -> tuple[pm.Packing, pm.Contacts]:
    """Return an open triangular lattice of displaced points with that share of its bonds, and these as contacts."""
    rng = np.random.default_rng(seed)
    number = np.arange(length * length).reshape(length, length)
    pairs = [(number[:, :-1], number[:, 1:]), (number[:-1], number[1:]), (number[:-1, 1:], number[1:, :-1])]
    i, j = (np.concatenate([pair[k].ravel() for pair in pairs]) for k in (0, 1))
    kept = rng.random(len(i)) < share
    order = np.flatnonzero(kept)[np.lexsort((j[kept], i[kept]))]
    y, x = np.divmod(number.ravel(), length)
    place = np.stack([x + 0.5 * y, y * 0.75**0.5], axis=1) + rng.uniform(-0.15, 0.15, (length**2, 2))
    packing = pm.Packing(place, np.full(length**2, 0.5), pm.Box(length * np.array([[1.0, 0.5], [0.0, 0.75**0.5]])))
    return packing, pair_contacts(packing, i[order], j[order], np.zeros((len(order), 2), dtype=np.int64))


def main() -> None:
    print(
        f"{'N':>7} {'p':>5} {'null space':>11} {'game':>7} {'clusters':>9} {'largest':>8} "
        f"{'same labels':>12} {'same stress':>12} {'within':>9} {'between':>9}  certain"
    )
    for length in (32, 100, 316):
        for share in (0.6, 0.66, 0.7, 0.8):
            packing, contacts = diluted(length, share, 1)
            found, counted = (
                pm.rigid_clusters(packing, contacts=contacts, method=method) for method in ("null space", "pebble game")
            )
            same = np.mean(found.cluster_c == counted.cluster_c)
            stress = np.mean(found.overconstrained_c == counted.overconstrained_c)
            print(
                f"{packing.particles:7d} {share:5.2f} {found.seconds:11.2f} {counted.seconds:7.2f} {len(found):9d} "
                f"{found.largest_fraction:8.3f} {same:12.6f} {stress:12.6f} {found.within:9.1e} {found.between:9.1e}  "
                f"{found.certain}",
                flush=True,
            )


if __name__ == "__main__":
    main()
