"""The command ``ngspring show``."""

from __future__ import annotations

from pathlib import Path

import click

from ngspring.analysis.finished import responses_of
from ngspring.analysis.states import control_places, reached
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
    """Summary and picture of a design: a file, a run folder, or the name of a stored design.

    Its load path is computed only where it is not stored: a run leaves it in states.npz.
    """
    design, path = read_design(name)
    picture = path.with_suffix(".png") if out is None else out
    for line in design_lines(design):
        click.echo(line)
    responses = responses_of(design, path.parent, threads)
    points = design.problem.control_points
    forces = [reached(responses, point) for point in points]
    make_console().print(points_table(design, forces))
    curve = responses[0.0]
    if write_pictures({picture: lambda: design_figure(design, responses, curve)}):
        click.echo(f"picture: {picture}")
    places = control_places(curve, design.problem, 0.0)
    reason = flaw(design, [float(curve.grey[place]) for place in places])
    if reason:
        click.echo(f"ngspring: warning: {reason}", err=True)
    message = "; ".join(r.message for r in responses.values() if r.message)
    on_curves = [q for q, point in zip(forces, points, strict=True) if point.on_curves]
    return incomplete(message) if None in on_curves else OK
