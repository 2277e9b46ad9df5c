"""A verdict as named numbers, for files, and as rows of words, for people."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from packmech.mechanics.verdict import Answer, Verdict

Row = tuple[str, str, str]


def verdict_numbers(verdict: Verdict) -> dict[str, Any]:
    """Return the verdict as numbers, words and lists by name, without the arrays of its certificates.

    Parameters
    ----------
    verdict
        The verdict.

    """
    touching, rest = verdict.touching, verdict.rest
    numbers: dict[str, Any] = {
        "local": verdict.local,
        "collective": verdict.collective,
        "strict": verdict.strict,
        "local_reason": verdict.local_reason,
        **_answer_numbers("collective", verdict.collectively),
        **_answer_numbers("strict", verdict.strictly),
        "mechanically_stable": verdict.mechanically_stable,
        "prestress_stable": verdict.prestress_stable,
        "first_order_jammed": verdict.first_order_jammed,
        "backbone_particles": int(verdict.backbone.sum()),
        "backbone_contacts": verdict.contacts,
        "rattling_particles": np.flatnonzero(verdict.rattlers).tolist(),
        "danglers": int(verdict.danglers.sum()),
        "gap_tolerance": None if np.isnan(touching.tolerance) else touching.tolerance,
        "gap_rule": touching.rule,
        "gap_levels": [
            {"tolerance": one.tolerance, "contacts": one.contacts, "particles": one.particles, "excess": one.excess}
            for one in touching.levels
        ],
        "mean_overlap": touching.mean_overlap,
        "rest": None if rest is None else {"residual": rest.residual, "limit": rest.limit, "law": rest.law},
        "at_rest": None if rest is None else rest.at_rest,
        "verdict_method": verdict.method,
        "verdict_solver": verdict.solver,
        "verdict_volume": verdict.volume,
        "verdict_bound": verdict.bound,
        "friction_left_out": verdict.friction,
        "verdict_seconds": verdict.seconds,
    }
    if verdict.cluster_n is not None:
        numbers["rattling_clusters"] = len(np.unique(verdict.cluster_n[verdict.rattling_clusters]))
    return numbers


def _answer_numbers(name: str, answer: Answer) -> dict[str, Any]:
    motion = answer.unjamming_motion
    return {
        f"{name}_reason": answer.reason,
        f"{name}_first_order_jammed": answer.first_order_jammed,
        f"{name}_isostatic_contacts": answer.isostatic_contacts,
        f"{name}_states_of_self_stress": answer.states_of_self_stress,
        f"{name}_floppy_modes": answer.floppy_modes,
        f"{name}_smallest_singular_value": answer.smallest_singular_value,
        f"{name}_smallest_force": answer.smallest_force,
        f"{name}_balance": answer.balance,
        f"{name}_duality_gap": answer.gap,
        f"{name}_solver_status": answer.status,
        f"{name}_motion": None if motion is None else {"opening": motion.opening, "closing": motion.closing},
    }


def verdict_rows(numbers: Mapping[str, Any]) -> list[Row]:
    """Return rows of question, answer and grounds, from what `verdict_numbers` gives.

    Parameters
    ----------
    numbers
        Those numbers, others among them or not.

    """
    rows = [
        ("locally jammed", numbers["local"], numbers["local_reason"]),
        _answer_row(numbers, "collective", "box fixed"),
        _answer_row(numbers, "strict", f"box free to deform, volume {numbers['verdict_volume']}"),
    ]
    if numbers["mechanically_stable"] is not None:
        firm, strained = numbers["mechanically_stable"], numbers["prestress_stable"]
        note = f"Hessian positive in the fixed box; with strains at fixed volume: {_yes(strained)}"
        rows.append(("mechanically stable", _yes(firm), note))
    rows.append(_gap_row(numbers))
    if numbers["rest"] is not None:
        rest = numbers["rest"]
        rows.append(("at rest", _yes(numbers["at_rest"]), f"{_balance(rest)}; law: {rest['law']}"))
    if numbers["friction_left_out"]:
        rows.append(("friction", "left out", "judged as frictionless; with it more may hold than is said here"))
    return rows


def verdict_text(verdict: Verdict) -> str:
    """Return the verdict and its grounds, one line each.

    Parameters
    ----------
    verdict
        The verdict.

    """
    numbers = verdict_numbers(verdict)
    particles = len(verdict.rattlers)
    rattlers = _counted(int(verdict.rattlers.sum()), "rattler")
    loose = f"{_counted(verdict.contacts, 'contact')}; {rattlers}, {numbers['danglers']} touch nothing"
    if "rattling_clusters" in numbers:
        loose += f", {_counted(numbers['rattling_clusters'], 'whole cluster')} among them"
    rows = [
        *verdict_rows(numbers),
        ("backbone", f"{numbers['backbone_particles']} of {particles}", loose),
        ("method", verdict.method, _solver(verdict)),
    ]
    wide = [max(len(row[k]) for row in rows) for k in range(2)]
    return "\n".join(f"{name:<{wide[0]}}  {value:<{wide[1]}}  {note}" for name, value, note in rows)


def _solver(verdict: Verdict) -> str:
    bound = "" if verdict.bound is None else f", loads bounded by a {verdict.bound}"
    return f"solver {verdict.solver}{bound}, {verdict.seconds:.3f} CPU seconds"


def _counted(number: int, name: str) -> str:
    return f"{number} {name}" if number == 1 else f"{number} {name}s"


def _yes(answer: bool | None) -> str:
    return {True: "yes", False: "no", None: "not known"}[answer]


def _balance(rest: Mapping[str, Any]) -> str:
    """Return how well the overlaps balance; rounding of exact crystals is no force that could be large or small."""
    if rest["residual"] == 0.0 and rest["limit"] < 1.0:
        note = "no net forces"
    elif rest["limit"] >= 1.0:
        note = "overlaps are rounding of the coordinates, no forces to balance"
        if rest["residual"] > rest["limit"]:
            note = "overlaps hardly above rounding of the coordinates, and out of balance"
    else:
        note = f"net forces up to {rest['residual']:.1e} of the mean contact force, allowed {rest['limit']:.1e}"
    return note


def _answer_row(numbers: Mapping[str, Any], name: str, where: str) -> Row:
    grounds = [where]
    force = numbers[f"{name}_smallest_force"]
    if numbers[name] == "jammed" and not np.isnan(force):
        grounds += [
            f"smallest singular value {numbers[f'{name}_smallest_singular_value']:.1e}",
            f"smallest force {force:.1e} of the mean",
            f"balanced to {numbers[f'{name}_balance']:.0e}",
        ]
        if not np.isnan(gap := numbers[f"{name}_duality_gap"]):
            grounds.append(f"duality gap {gap:.0e}")
    else:
        grounds.append(numbers[f"{name}_reason"])
    if numbers[name] == "ambiguous" and numbers[f"{name}_first_order_jammed"] is not None:
        first = "jammed" if numbers[f"{name}_first_order_jammed"] else "not jammed"
        grounds.append(f"by the contacts as taken: {first} to first order")
    return (f"{'collectively' if name == 'collective' else 'strictly'} jammed", numbers[name], "; ".join(grounds))


def _gap_row(numbers: Mapping[str, Any]) -> Row:
    tolerance = numbers["gap_tolerance"]
    if tolerance is None:
        return ("touching", "as given", "the contacts were given, gaps and rest not looked at")
    note = f"gaps of contacts in contact distances; {numbers['gap_rule']}"
    if len(numbers["gap_levels"]) == 3:
        few, at, many = (level["excess"] for level in numbers["gap_levels"])
        note += f"; contacts beyond the fewest that jam: {few:+d} at a tenth, {at:+d}, {many:+d} at ten times"
    return ("touching", f"up to {tolerance:.1e}", note)
