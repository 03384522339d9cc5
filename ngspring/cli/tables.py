"""Tables of the command line."""

from __future__ import annotations

import sys
from collections.abc import Collection, Mapping, Sequence
from typing import TYPE_CHECKING

from rich.console import Console
from rich.table import Table

from ngspring.problem.spring import SpringProblem
from ngspring.view.text import deviation, duration, width_symbol

if TYPE_CHECKING:
    from ngspring.analysis.response import Response
    from ngspring.design.design import Design
    from ngspring.design.history import History
    from ngspring.kkt.bench import Benchmark
    from ngspring.kkt.stationarity import Optimality

LARGEST_DEVIATION = 1e-3


def make_console() -> Console:
    """The standard output; wide enough for the tables where it is not a terminal."""
    width = None if sys.stdout.isatty() else 120
    # Units such as [mm] would be taken for markup.
    return Console(highlight=False, markup=False, width=width)


def cases_table(cases: Mapping[str, SpringProblem], stored: Collection[str]) -> Table:
    """All cases with their target load paths, and which designs are stored."""
    others = [name for name in stored if name not in cases]
    table = Table(
        title="cases of the paper (A1-A4: our own)",
        caption=f"also stored: {', '.join(others)}" if others else None,
    )
    for column in ("case", "kinematics", "elements", "design", "control points d:q [mm:N]"):
        table.add_column(column)
    for name, problem in cases.items():
        points = [
            f"{point.d:+g}:{point.q:+g}" + (f" (robust, η = {point.eta:g})" if point.eta else "")
            for point in problem.control_points
        ]
        mesh = f"{problem.elements} x {problem.elements}"
        design = "stored" if name in stored else ""
        table.add_row(name, problem.kinematics, mesh, design, "  ".join(points))
    return table


def points_table(problem: SpringProblem, forces: Sequence[float | None]) -> Table:
    """Reached forces against their targets; None where the path ends before."""
    table = Table()
    for column in ("d [mm]", "η", "target q [N]", "reached q [N]", "deviation"):
        table.add_column(column, justify="right")
    for point, q in zip(problem.control_points, forces, strict=True):
        reached = ("not reached", "") if q is None else (f"{q:.6f}", deviation(q, point.q))
        table.add_row(f"{point.d:g}", f"{point.eta:g}", f"{point.q:g}", *reached)
    return table


def design_lines(design: Design) -> list[str]:
    """What a design is, and how it came about."""
    problem = design.problem
    ratio = design.relative_width
    lines = [
        f"{problem.name or 'spring without name'}: {problem.kinematics},"
        f" {problem.elements} x {problem.elements} elements ({problem.domain}),"
        f" {problem.L:g} x {problem.H:g} mm, l_i = {problem.l_i:g} mm",
        f"{width_symbol(problem)} = {ratio:.4f}, V = {design.volume:.2f} mm³",
    ]
    if design.info.get("start"):
        lines.append(f"start: {design.info['start']}")
    if design.history is not None and len(design.history):
        end = "converged to dt = ∞" if design.info.get("converged") else "not converged"
        if design.info.get("falling_directions"):
            end += f" at a saddle: C falls in {design.info['falling_directions']} directions"
        lines.append(f"{history_line(design.history)}, {end}")
    return lines


def history_line(history: History) -> str:
    """Size of a run in one line."""
    seconds = history.last().seconds
    return (
        f"{len(history) - 1} design updates, {history.newton_iterations} Newton iterations,"
        f" {duration(seconds)} ({seconds:.1f} s)"
    )


def response_lines(response: Response) -> list[str]:
    """Displacements and forces in two columns."""
    lines = [f"{'d [mm]':>12} {'q [N]':>16}"]
    # At rest the force is what rounding leaves of 0.
    smallest = 1e-12 * max(map(abs, response.q), default=0.0)
    for d, q in zip(response.d, response.q, strict=True):
        # Adding 0 takes the sign of -0 away.
        lines.append(f"{d + 0.0:12.6g} {q if abs(q) > smallest else 0.0:16.9g}")
    return [*lines, *map(str, response.jumps)]


def check_table() -> Table:
    """Header of the table that `add_check` fills."""
    table = Table()
    for column in ("design", "residual", "q [N]", "deviations", "W/H or D/H", "verdict"):
        # Long paths and reasons give way to the numbers.
        text = column in ("design", "verdict")
        table.add_column(column, justify="left" if text else "right", no_wrap=not text)
    return table


def add_check(
    table: Table,
    name: str,
    design: Design,
    outcome: Optimality | str,
    tolerance: float,
    force_tolerance: float = LARGEST_DEVIATION,
) -> bool:
    """Add a design's row to the table; returns whether it passes.

    Parameters
    ----------
    table : rich.table.Table
    name : str
    design : Design
    outcome : Optimality or str
        What `ngspring.optimality` found, or why it could not.
    tolerance : float
        Largest relative residual.
    force_tolerance : float
        Largest relative deviation of a force from its target.
    """
    ratio = f"{design.relative_width:.4f}"
    if isinstance(outcome, str):
        table.add_row(name, "-", "-", "-", ratio, f"fails: {outcome}")
        return False
    points = design.problem.control_points
    reasons = []
    if not outcome.residual <= tolerance:
        reasons.append("residual")
    judged = [dev for dev, point in zip(outcome.deviation, points, strict=True) if point.eta == 0]
    if not all(dev <= force_tolerance for dev in judged):
        limit = f"{100 * force_tolerance:g} %"
        reasons.append(f"forces (off by up to {100 * max(judged):.3f} %, limit {limit})")
    table.add_row(
        name,
        f"{outcome.residual:.1e}",
        "\n".join(f"{q:.6f}" for q in outcome.q),
        "\n".join(
            deviation(float(q), point.q) + (f" (η = {point.eta:g})" if point.eta else "")
            for q, point in zip(outcome.q, points, strict=True)
        ),
        ratio,
        f"fails: {' and '.join(reasons)}" if reasons else "passes",
    )
    return not reasons


def bench_table(problem: SpringProblem, result: Benchmark) -> Table:
    """Sizes, seconds and memory of a Newton iteration."""
    n = problem.elements
    table = Table(caption=f"seconds: medians of {result.repeat}", show_header=False)
    table.add_column()
    table.add_column(justify="right")
    table.add_row("elements", f"{n} x {n} ({problem.domain})")
    table.add_row("control points", f"{len(problem.control_points)}")
    table.add_row("threads", f"{result.threads}")
    table.add_row("unknowns", f"{result.unknowns:,}")
    table.add_row("non-zeros (lower triangle)", f"{result.nonzeros:,}")
    for name in ("assembly", "reduction", "factorisation", "solve", "residual"):
        table.add_row(f"{name} [s]", f"{getattr(result, name):.4f}")
    table.add_row("whole Newton iteration [s]", f"{result.iteration:.4f}")
    table.add_row("first iteration, with symbolic analysis [s]", f"{result.first_iteration:.4f}")
    table.add_row("peak memory of the process [GB]", f"{result.peak_memory:.3f}")
    return table
