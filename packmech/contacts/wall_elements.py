"""What rough walls do across at rest: forces and torques of their springs, and how these change as particles move.

A disc or sphere whose center is D from a wall touches it at a = D n, n the direction to the wall, which stands still.
With displacements u and rotations p of the particle, what holds for contacts of two of them (`tangential_elements`,
`turning_elements`) holds with v = -u, no rotation of the other side, and an n that does not turn:

    slip                ds = -(1 - n n)(u + p x a)                        dD = -u.n
    tangential force    dT = k ds + mu dN T/|T| + (n x T) n.p/2           where it slides k acts across T only
    torque of T         a x dT + dD n x T
    other torques       dM = -D^2 (k_r (1 - n n) + k_t n n) p - D F n.p/2 + (n x F + f n) dD

Over an edge or a corner of a surface n turns, too, by dn = -B u with B = (1 - n n) / D, less e e / D along an edge e,
and forces and torques by what turns with it: dT = -n (T.dn), and dn x (T + F) + f dn of the torque over D.

T sticks where there is no term with mu. F and f are the forces of the springs against rolling and twisting, which turn
the particle by M = D (n x F + f n); they count as sticking.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from packmech.check import Kind
from packmech.contacts.bead_contact import turned_arms


class WallSprings(NamedTuple):
    """Touches of discs and spheres with walls, and what their springs bear; zeros where walls are smooth.

    Attributes
    ----------
    normal_wd
        (W, d) directions from the particles to the walls [1].
    arm_w
        (W,) distances of the centers from the walls [length].
    push_w, push_slope_w
        (W,) normal forces, and how they grow with the depth [force], [force/length].
    force_wd
        (W, d) tangential forces on the particles [force].
    rolling_wd, twisting_w
        (W, d) and (W,) forces of the springs against rolling and twisting [force].
    stiffness_w3
        (W, 3) of the springs against slip, rolling and twisting [force/length].
    coefficient_w
        (W,) Coulomb's coefficients [1].
    energy_w
        (W,) energies of the springs [energy].
    bend_wdd
        (W, d, d) by which displacements turn the directions, but for the sign: 0 at walls [1/length].

    """

    normal_wd: NDArray[np.float64]
    arm_w: NDArray[np.float64]
    push_w: NDArray[np.float64]
    push_slope_w: NDArray[np.float64]
    force_wd: NDArray[np.float64]
    rolling_wd: NDArray[np.float64]
    twisting_w: NDArray[np.float64]
    stiffness_w3: NDArray[np.float64]
    coefficient_w: NDArray[np.float64]
    energy_w: NDArray[np.float64]
    bend_wdd: NDArray[np.float64]

    @classmethod
    def smooth(cls, normal_wd: NDArray[np.float64]) -> WallSprings:
        """Return touches in these directions with walls that do nothing across."""
        (count, d), none = normal_wd.shape, np.zeros(len(normal_wd))
        across, bend = np.zeros_like(normal_wd), np.zeros((count, d, d))
        return cls(normal_wd, none, none, none, across, across, none, np.zeros((count, 3)), none, none, bend)

    def select(self, kept_w: NDArray[np.bool_]) -> WallSprings:
        """Return some of the touches."""
        return WallSprings(*(one[kept_w] for one in self))

    @property
    def torque_wk(self) -> NDArray[np.float64]:
        """The (W, 1 or 3) torques on the particles [force * length]."""
        whole = np.einsum("wdt,wd->wt", turned_arms(self.normal_wd), self.force_wd + self.rolling_wd)
        if whole.shape[1] == 3:
            whole += self.twisting_w[:, None] * self.normal_wd
        return np.asarray(self.arm_w[:, None] * whole)

    def second(self, sliding_w: NDArray[np.bool_], kind: Kind = "exact") -> NDArray[np.float64]:
        """Return the (W, X, X) derivatives of minus forces and torques by displacements and rotations, X = d + t.

        Parameters
        ----------
        sliding_w
            (W,) which touches slide, along their tangential forces.
        kind
            "exact", or "unstressed": what forces add where contacts turn, and arms grow, is left out.

        """
        n, d = self.normal_wd, self.normal_wd.shape[1]
        across = np.eye(d) - n[:, :, None] * n[:, None]
        turned, arm = turned_arms(n), self.arm_w[:, None, None]
        t = turned.shape[2]
        slip = -np.concatenate([across, arm * turned], axis=2)
        depth = np.concatenate([n, np.zeros((len(n), t))], axis=1)
        size = np.sqrt((self.force_wd**2).sum(axis=1))
        ahead = self.force_wd / np.where(size > 0.0, size, 1.0)[:, None]
        along = np.where(sliding_w[:, None], ahead, 0.0)
        slid = slip - along[:, :, None] * np.einsum("wa,wax->wx", along, slip)[:, None]
        change = self.stiffness_w3[:, :1, None] * slid
        change += along[:, :, None] * (self.coefficient_w * self.push_slope_w)[:, None, None] * depth[:, None]
        rolling, twisting = self.stiffness_w3[:, 1, None, None], self.stiffness_w3[:, 2, None, None]
        about = np.einsum("wat,wab,wbs->wts", turned, across, turned)
        moment = np.zeros((len(n), t, d + t))
        moment[:, :, d:] = -(arm**2) * (rolling * about)
        if d == 3:
            moment[:, :, d:] -= arm**2 * twisting * n[:, :, None] * n[:, None]
        if kind != "unstressed":
            push = np.einsum("wdt,wd->wt", turned, self.force_wd + self.rolling_wd)
            if d == 3:
                push += self.twisting_w[:, None] * n
                change[:, :, d:] += 0.5 * np.cross(n, self.force_wd)[:, :, None] * n[:, None]
                moment[:, :, d:] -= 0.5 * arm * self.rolling_wd[:, :, None] * n[:, None]
            moment -= push[:, :, None] * depth[:, None]
            self._turn(change, moment)
        moment += arm * np.einsum("wdt,wdx->wtx", turned, change)
        return np.asarray(-np.concatenate([change, moment], axis=1))

    def _turn(self, change: NDArray[np.float64], moment: NDArray[np.float64]) -> None:
        """Add what forces and torques gain as directions turn over edges and corners, as in `second`."""
        n, d, bend = self.normal_wd, self.normal_wd.shape[1], self.bend_wdd
        if not bend.any():
            return
        change[:, :, :d] += n[:, :, None] * np.einsum("wa,wab->wb", self.force_wd, bend)[:, None]
        # columns: the cross product of each column of the turn with the forces
        force = (self.force_wd + self.rolling_wd)[:, :, None]
        turned = np.cross(bend, force, axis=1) + self.twisting_w[:, None, None] * bend
        moment[:, :, :d] -= self.arm_w[:, None, None] * turned
