"""The chain of linear programs: the exact hard packing by the programs of Torquato and Jiao, one after another."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from packmech.box import Box
from packmech.check import integer, one_of, positive, real
from packmech.contacts.network import candidate_pairs, pair_contacts
from packmech.jamming.hard_packing import HardPacking, HardState, kicked
from packmech.linalg.linear_programs import LinearProgram, Solution, solve_clarabel, solve_highs
from packmech.packing import Packing
from packmech.protocols.hard_vertex import START, certified, check_quench, decompress, jam_hard
from packmech.protocols.method import JamMethod
from packmech.protocols.protocol import Protocol
from packmech.result import Outcome

_STRAIN_BOUND = 0.05


@dataclass(frozen=True)
class ProgramChain(JamMethod):
    """Quench, decompress a little, then a chain of sparse linear programs to the exact hard packing, then the soft one.

    Each program minimizes the trace of the strain over displacements within a trust radius such that no pair closer
    than the radius allows comes to overlap (Torquato and Jiao, Phys. Rev. E 82, 061302, 2010). Distances are convex
    in the unknowns, so a step keeps the true gaps open. Slower than HardVertex, and independent of its solver.

    Parameters
    ----------
    start_packing_fraction
        Where the quench happens; None: .87 in two dimensions, .68 in three.
    stop_pressure
        FIRE stops decompressing at this pressure [energy_scale / diameter^d].
    quench_tolerance, quench_steps
        Net force over mean contact force at which FIRE stops [1], and its maximum number of steps in one box.
    solver
        "clarabel" (interior point) or "highs" (dual simplex).
    trust_radius
        Largest displacement in the first program [mean diameter]; later ones follow the motion.
    program_limit
        Maximum number of programs.

    """

    honors = {"isotropic": "kinds", "free": "kinds"}

    start_packing_fraction: float | None = None
    stop_pressure: float = 1e-3
    quench_tolerance: float = 3e-3
    quench_steps: int = 500_000
    solver: str = "clarabel"
    trust_radius: float = 0.05
    program_limit: int = 200

    def __post_init__(self) -> None:
        check_quench(self.start_packing_fraction, self.quench_tolerance, self.quench_steps)
        positive("stop_pressure", self.stop_pressure)
        one_of("solver", self.solver, ("clarabel", "highs"))
        real("trust_radius", self.trust_radius, above=0.0, at_most=0.2)
        integer("program_limit", self.program_limit, at_least=1)

    def follow(self, protocol: Protocol, pressure: float) -> tuple[Packing, Outcome]:
        """Return the packing at the pressure [energy_scale / diameter^d] and how the protocol ended."""
        start = protocol.start_fraction(self.start_packing_fraction, START)
        return jam_hard(
            protocol,
            pressure,
            lambda: decompress(protocol, start, self.stop_pressure, 0.15, self.quench_tolerance, self.quench_steps),
            lambda near: self._chain(protocol, near),
        )

    def _chain(self, protocol: Protocol, packing: Packing) -> HardPacking | None:
        reduced = protocol.reduced(packing)
        radius = self.trust_radius
        for number in range(1, self.program_limit + 1):
            with protocol.stage("linear program") as figures:
                tolerance = 1e-5 if radius > 1e-3 else 1e-9
                state, step, solution = self._program(reduced, protocol.basis_kdd, radius, tolerance)
                figures.residual, figures.steps = solution.solve.residual, solution.solve.iterations
                figures.note = (
                    f"{solution.solve.status}; trust radius {radius:.1e}, largest step of the backbone {step:.1e}"
                )
                reduced = reduced.replace(position_nd=state.position_nd, box=Box(state.lattice_dd))
                protocol.last = protocol.restored(reduced)
            protocol.loop.report("linear program", number=number, step=step)
            bounded = step > 0.95 * radius
            if step < 3e-3 and not bounded:
                hard = certified(protocol, state, reduced)
                if hard is not None and not hard.floppy_modes:
                    return hard
                if hard is not None:
                    reduced, radius = kicked(hard.packing, protocol.basis_kdd, number), self.trust_radius
                    continue
            radius = min(0.1, 3.0 * radius) if bounded else float(np.clip(3.0 * step, 1e-5, 0.1))
        return None

    def _program(
        self, packing: Packing, basis_kdd: NDArray[np.float64], radius: float, tolerance: float
    ) -> tuple[HardState, float, Solution]:
        """Return the packing after one program with slacks and forces, its backbone's largest step, the solution."""
        import scipy.sparse as sp

        d, n, k = packing.dimension, packing.particles, len(basis_kdd)
        small = 2.0 * float(packing.radius_n.min())
        pairs = candidate_pairs(
            packing.position_nd,
            packing.radius_n,
            packing.box,
            scale=1.0 + 2.0 * _STRAIN_BOUND,
            skin=2.0 * np.sqrt(d) * radius,
        )
        near = pair_contacts(packing, *pairs)
        c = np.arange(len(near))
        rows = np.repeat(c, d)
        at_j = (near.j_c[:, None] * d + np.arange(d)).ravel()
        at_i = (near.i_c[:, None] * d + np.arange(d)).ravel()
        value = near.normal_cd.ravel()
        matrix = sp.coo_array(
            (np.concatenate([value, -value]), (np.concatenate([rows, rows]), np.concatenate([at_j, at_i]))),
            shape=(len(near), n * d),
        )
        stretch = np.einsum("ca,kab,cb->ck", near.normal_cd, basis_kdd, near.vector_cd)
        both = sp.csr_array(sp.hstack([matrix, sp.csr_array(stretch)]))
        reach = np.concatenate([np.full(n * d, radius * min(1.0, small)), np.full(k, min(radius, _STRAIN_BOUND))])
        # one particle stays: a vertex solution would else drift with all particles at the bound
        reach[:d] = 0.0
        cost = np.concatenate([np.zeros(n * d), np.einsum("kaa->k", basis_kdd) * n])
        program = LinearProgram(
            cost=cost, equal=sp.csr_array((0, n * d + k)), equal_to=np.zeros(0),
            below=-both, below_to=near.gap_c, lower=-reach, upper=reach,
        )  # fmt: skip
        solution = (solve_clarabel if self.solver == "clarabel" else solve_highs)(program, tolerance)
        u_nd = solution.x[: n * d].reshape(n, d)
        strain = np.einsum("k,kab->ab", solution.x[n * d :], basis_kdd)
        force = np.maximum(solution.below_multiplier, 1e-300)
        moved = packing.replace(
            position_nd=packing.position_nd + u_nd + packing.position_nd @ strain.T, box=packing.box.strained(strain)
        )
        slack = near.gap_c + both @ solution.x
        # a contact of the solution has a force and no slack; the solver's tolerance is the smallest of either
        slack = np.maximum(slack, 1e-2 * tolerance)
        bearing = force > 1e-4 * force.mean()
        live = np.zeros(n, dtype=bool)
        live[near.i_c[bearing]] = live[near.j_c[bearing]] = True
        step = max(float(np.abs(u_nd[live]).max(initial=0.0)), float(np.abs(strain).max()))
        state = HardState(moved.position_nd, moved.box.lattice_dd, pairs, slack, force, tolerance, 0.0)
        return state, step, solution
