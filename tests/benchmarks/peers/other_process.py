# mypy: disable-error-code="no-untyped-def, no-untyped-call"
"""The peers' side of other_python.py: it runs in an environment without packmech and answers lines of JSON."""

from __future__ import annotations

import contextlib
import importlib.metadata
import json
import os
import sys
import time

import numpy as np

# one core: then libraries that start threads of their own have one
if hasattr(os, "sched_setaffinity"):
    os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})


def versions():
    """Return the versions of the peers that are here."""
    found = {}
    for name in ("jax-md", "jax", "particleshear", "rigidpy", "numpy"):
        with contextlib.suppress(importlib.metadata.PackageNotFoundError):
            found[name] = importlib.metadata.version(name)
    return {"versions": found}


def jax_md(data, **_):
    """Return a call of the elastic moduli of harmonic discs (list of neighbors, 64 bits, compiled), and the tensor."""
    import jax

    jax.config.update("jax_enable_x64", True)
    import jax.numpy as jnp
    from jax_md import elasticity, energy, partition, space

    size, kind = np.unique(data["radius_n"], return_inverse=True)
    box = jnp.array(data["lattice_dd"])
    displacement, _ = space.periodic_general(box, fractional_coordinates=False)
    neighbor_of, energy_of = energy.soft_sphere_neighbor_list(
        displacement,
        box,
        species=jnp.array(kind),
        sigma=jnp.array(size[:, None] + size[None, :]),
        epsilon=1.0,
        alpha=2.0,
        dr_threshold=0.0,
        fractional_coordinates=False,
        format=partition.OrderedSparse,
    )
    place = jnp.array(data["position_nd"])
    neighbor = neighbor_of.allocate(place)
    moduli = jax.jit(elasticity.athermal_moduli(energy_of, check_convergence=True))

    def call():
        return jax.block_until_ready(moduli(place, box, neighbor=neighbor))

    tensor, converged = call()
    return call, {"tensor": np.asarray(tensor).tolist(), "converged": bool(converged)}


def rigidpy(data, **_):
    """Return a call of the bulk modulus of springs along the contacts, and its value."""
    # gone from numpy 2, for which rigidpy was not written
    if not hasattr(np, "product"):
        np.product = np.prod  # noqa: NPY003, NPY201
    import rigidpy as rp

    basis = data["lattice_dd"].T

    def call():
        spring = rp.framework(data["position_nd"], data["bond_ck"], basis=basis, k=data["stiffness_c"])
        return spring.bulkModulus()

    return call, {"bulk_modulus": float(call())}


def particle_shear(data, steps, k, nu, k_t, nu_t, mu, divergence, dt, cooling, **_):
    """Return a call of as many steps of sheared frictional discs, all stresses recorded, and where they end."""
    import particleShear as ps  # noqa: N813

    side = float(data["side"])

    def ensemble():
        made = ps.EnsembleFrictionLeesEdwards(side, side, 0, k=k, nu=nu, m=1.0, k_t=k_t, nu_t=nu_t, mu=mu)
        discs = zip(data["position_nd"], data["radius_n"], data["mass_n"], strict=True)
        for i, ((x, y), radius, mass) in enumerate(discs):
            made.sphereList.append(
                ps.SphereFrictionLeesEdwards(
                    "grey", float(x), float(y), 2.0 * float(radius), float(mass), i, False, False, made, side, side
                )
            )
        made.r_max = float(data["radius_n"].max())
        made.setShearInSpheres()
        made.setShearRateInSpheres()
        made.set_central_repulsion_coefficient(divergence)
        made.applyingShear = True
        return made

    def call(made):
        handler, evaluator = ps.EvaluationHandler(), ps.StressTensorEvaluation(side, side)
        for rate in data["rate_t"][:steps].tolist():
            made.setShearRate(rate)
            made.mechanical_simulation_step_calculate_forces()
            made.record_total_particle_forces()
            handler.record(made, evaluator)
            made.mechanical_simulation_step_calculate_acceleration(cool_factor=cooling, dt=dt)
            made.mechanical_simulation_step_calculate_movement(dt=dt)
            made.reset_force()
        return made

    end = call(ensemble())
    waiting = []

    def again():
        call(waiting.pop())

    again.before = lambda: waiting.append(ensemble())
    return again, {"position_nd": [[one.x, one.y] for one in end.sphereList]}


class Asked:
    """What was prepared last."""

    call = None

    @classmethod
    def prepare(cls, peer, path, **given):
        """Prepare a peer's work on the arrays of a file."""
        with np.load(path) as file:
            data = dict(file)
        cls.call, first = {"jax_md": jax_md, "rigidpy": rigidpy, "particle_shear": particle_shear}[peer](data, **given)
        return first

    @classmethod
    def again(cls):
        """Do it once more; return the CPU seconds."""
        getattr(cls.call, "before", lambda: None)()
        began = time.process_time()
        cls.call()
        return {"seconds": time.process_time() - began}


def main():
    """Answer until there are no more lines."""
    asked = {"versions": versions, "prepare": Asked.prepare, "again": Asked.again}
    for line in sys.stdin:
        name, given = json.loads(line)
        try:
            # peers print what they please
            with contextlib.redirect_stdout(sys.stderr):
                answer = asked[name](**given)
        except Exception as failed:
            answer = {"error": f"{type(failed).__name__}: {failed}"}
        print(json.dumps(answer), flush=True)


if __name__ == "__main__":
    main()
