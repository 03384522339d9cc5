"""The command ``ngspring show``."""

from __future__ import annotations

from pathlib import Path

import click

from ngspring.analysis.states import control_point_responses, curve_displacements, index_of, reached
from ngspring.cli.options import OK, incomplete, threads_option
from ngspring.cli.pictures import write_pictures
from ngspring.cli.tables import design_lines, make_console, points_table
from ngspring.design.soundness import flaw
from ngspring.evolution.folder import read_design
from ngspring.view.rows import design_figure


@click.command("show")
@click.argument("name", metavar="DESIGN")
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Picture; beside the design by default, with its name.",
)
@threads_option
def show_command(name: str, out: Path | None, threads: int | None) -> int:
    """Summary and picture of a design: a file, a run folder, or the name of a stored design."""
    design, path = read_design(name)
    picture = path.with_suffix(".png") if out is None else out
    for line in design_lines(design):
        click.echo(line)
    responses = control_point_responses(
        design, curve_displacements(design), domain="quarter", threads=threads
    )
    forces = [reached(responses, point) for point in design.problem.control_points]
    make_console().print(points_table(design.problem, forces))
    curve = responses[0.0]
    if write_pictures({picture: lambda: design_figure(design, responses, curve)}):
        click.echo(f"picture: {picture}")
    places = [index_of(curve, p.d) for p in design.problem.control_points if not p.eta]
    reason = flaw(design, [float(curve.grey[k]) for k in places if k is not None])
    if reason:
        click.echo(f"ngspring: warning: {reason}", err=True)
    message = "; ".join(r.message for r in responses.values() if r.message)
    return incomplete(message) if None in forces else OK
