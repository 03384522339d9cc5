"""The command ``ngspring cases``."""

from __future__ import annotations

from collections.abc import Collection, Mapping

import click
from rich.table import Table

from ngspring.cli.tables import make_console
from ngspring.design.gallery import gallery
from ngspring.problem.cases import cases
from ngspring.problem.spring import SpringProblem


@click.command("cases")
def cases_command() -> None:
    """List the cases of the paper, and which have a stored design."""
    make_console().print(_cases_table(cases, list(gallery)))


def _cases_table(cases: Mapping[str, SpringProblem], stored: Collection[str]) -> Table:
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
            f"{point.d:+g}:{point.q:+g}" + ("" if point.own else f" (robust, {point.variant})")
            for point in problem.control_points
        ]
        mesh = f"{problem.elements} x {problem.elements}"
        design = "stored" if name in stored else ""
        table.add_row(name, problem.kinematics, mesh, design, "  ".join(points))
    return table
