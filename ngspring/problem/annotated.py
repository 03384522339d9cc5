"""A problem as a TOML file to read and to edit: every number with what it means."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping

from ngspring.problem.dimension import dimensions, used_weights
from ngspring.problem.kinematics import KINEMATICS
from ngspring.problem.material import young_and_poisson
from ngspring.problem.scaling import REFERENCE_STIFFNESS
from ngspring.problem.spring import SpringProblem

_WIDTH = 29


def _line(key: str, value: float | int | str, comment: str) -> str:
    # A JSON string is a TOML string.
    text = json.dumps(value) if isinstance(value, str) else f"{value:.7g}"
    return f"{f'{key} = {text}':<{_WIDTH}}  # {comment}"


def _weights(problem: SpringProblem) -> list[str]:
    """The weights of the terms of the objective."""
    units = dimensions(problem)
    return [
        _line(name, getattr(problem, name), f"weight of {what} in {units[name].unit(problem.n)}")
        for name, what in used_weights(problem).items()
    ]


def _stiffness(problem: SpringProblem, described: Mapping[str, object]) -> list[str]:
    """The stiffness as it was described; nothing for a law, which has a table of its own."""
    if problem.material is not None:
        return []
    E, nu = young_and_poisson(problem.K, problem.G)
    lines = []
    hardness, material = described.get("shore_A"), described.get("material")
    if isinstance(material, str):
        typical = f"E = {E:.4g} MPa by its usual hardness, see ngspring materials"
        comment = typical if hardness is None else "only a name: shore_A decides"
        lines.append(_line("material", material, comment))
    if isinstance(hardness, float):
        lines.append(_line("shore_A", hardness, f"hardness: E = {E:.4g} MPa by Gent's relation"))
    lines = lines or [_line("E", E, "Young's modulus (or shore_A, or material, in its place)")]
    return [*lines, _line("nu", nu, "Poisson's ratio"), ""]


def annotated_toml(
    problem: SpringProblem,
    source: str,
    described: Mapping[str, object] | None = None,
    notes: Iterable[str] = (),
) -> str:
    """The problem as TOML with comments; values are rounded to seven digits.

    Parameters
    ----------
    problem : SpringProblem
        Weights of points other than the largest are written with their point. The numerical
        parameters E_0, k_r, p and n are left out where they have their defaults.
    source : str
        Where the targets come from.
    described : mapping, optional
        How the stiffness was described: ``shore_A`` or ``material`` in it are written instead of E
        (see `ngspring.problem.material.moduli_from`); other keys are ignored.
    notes : iterable of str
        What was assumed about the targets: comments.
    """
    other = next(name for name in KINEMATICS if name != problem.kinematics)
    w_q = max(point.weight for point in problem.control_points)
    lines = [
        f"# Targets from {' '.join(source.split())}. Lengths in mm, forces in N, stress in MPa;"
        " tension is positive.",
        *(f"# {' '.join(note.split())}" for note in notes),
        "",
        _line("name", problem.name, "of the run folder and in titles"),
        _line("kinematics", problem.kinematics, f'or "{other}"'),
        _line("elements", problem.elements, "N of the N x N mesh over L x H; even"),
        "",
        _line("L", problem.L, problem.motion.across),
        _line("H", problem.H, "height along the load"),
    ]
    if problem.motion.thick:
        lines.append(_line("T", problem.T, "out-of-plane thickness"))
    if problem.stretch_limit:
        lines.append(_line("stretch_limit", problem.stretch_limit, "of the largest stretch"))
    if problem.energy_limit:
        lines.append(_line("energy_limit", problem.energy_limit, "of the strain energy density"))
    for key in ("wall", "gap"):
        if getattr(problem, key):
            lines.append(_line(key, getattr(problem, key), f"smallest {key}"))
    lines += [
        "",
        *_stiffness(problem, described or {}),
        "# The weights of the paper's springs, scaled to this size and these forces.",
        _line("l_i", problem.l_i, "interface width: 4/5 of an element or more"),
        _line("l_t", problem.l_t, "length scale of the evolution"),
        *_weights(problem),
        _line("w_q", w_q, f"weight of a target in N^-2: ({REFERENCE_STIFFNESS:g} N / (q H/d))^2"),
    ]
    defaults = SpringProblem.__dataclass_fields__
    for key in ("E_0", "k_r", "p", "n"):
        value = getattr(problem, key)
        if value != defaults[key].default:
            lines.append(_line(key, value, "not the paper's"))
    if problem.material is not None:
        values = [f"{name} = {value:.7g}" for name, value in problem.law.parameters.items()]
        lines += ["", "[material]", _line("law", problem.law.name, "stresses in MPa"), *values]
    for point in problem.control_points:
        lines += ["", "[[control_points]]", f"d = {point.d:.7g}", f"q = {point.q:.7g}"]
        if point.weight != w_q:
            lines.append(f"weight = {point.weight:.7g}")
        if point.aim is not None:
            lines.append(_line("aim", point.aim, "of the third medium, so that the part has q"))
        if point.eta:
            lines.append(_line("eta", point.eta, "the design dilated by l_i eta / 8"))
        if point.eta_odd:
            note = "the same here, and eroded at the mirror image"
            lines += [_line("eta_odd", point.eta_odd, note), f'odd_in = "{point.odd_in}"']
    return "\n".join(lines) + "\n"
