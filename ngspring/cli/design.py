"""The commands ``ngspring response``, ``show`` and ``check``: what a finished design does."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import click
import numpy as np

from ngspring.basics.errors import ConvergenceError, ProblemError
from ngspring.cli.arguments import displacements_between, make_folder
from ngspring.cli.options import FAILED, NOT_CONVERGED, OK, domain_option, threads_option
from ngspring.evolution.folder import read_design

#: Name of the curve's files; a run has one of the csv already.
CURVE = "response"


@click.command("response", short_help="Load-displacement curve of a design.")
@click.argument("name", metavar="DESIGN")
@click.option("--from", "low", type=float, help="First displacement d in mm.")
@click.option("--to", "high", type=float, help="Last displacement d in mm.")
@click.option(
    "--points",
    type=click.IntRange(min=2),
    default=41,
    show_default=True,
    help="Displacements over the range, its ends among them.",
)
@domain_option
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Folder for the .csv and the .png; the design's own by default.",
)
@threads_option
def response_command(
    name: str,
    low: float | None,
    high: float | None,
    points: int,
    domain: str | None,
    out: Path | None,
    threads: int | None,
) -> int:
    """Load-displacement curve of a design: a file, a run folder, or the name of a stored design.

    The range goes from zero to the outermost control points by default. Written are response.csv,
    with d in mm, q in N, the strain energy in N mm and the stiffness dq/dd in N/mm, and
    response.png. With another range or number of points they are response-custom.csv and
    response-custom.png, because the report of a run draws the curve in its response.csv.
    """
    from ngspring.analysis.response import load_displacement, response_csv
    from ngspring.basics.files import write_text
    from ngspring.cli.tables import response_lines
    from ngspring.view.curves import response_figure
    from ngspring.view.figure import save_figure

    design, path = read_design(name)
    displacements = displacements_between(design, low, high, points)
    custom = not np.array_equal(displacements, displacements_between(design))
    stem = f"{CURVE}-custom" if custom else CURVE
    response = load_displacement(design, displacements, domain, threads=threads)
    for line in response_lines(response):
        click.echo(line)
    folder = path.parent if out is None else out
    make_folder(folder)
    write_text(folder / f"{stem}.csv", response_csv(response))
    save_figure(response_figure(response, design.problem), folder / f"{stem}.png")
    # The standard output holds nothing but the table.
    click.echo(f"files in {folder}: {stem}.csv, {stem}.png", err=True)
    if not response.complete:
        click.echo(f"incomplete: {response.message}", err=True)
        return NOT_CONVERGED
    return OK


@click.command("show", short_help="Summary and picture of a design.")
@click.argument("name", metavar="DESIGN")
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Picture; beside the design by default, with its name.",
)
@threads_option
def show_command(name: str, out: Path | None, threads: int | None) -> int:
    """Summary and picture of a design: a file, a run folder, or the name of a stored design."""
    from ngspring.analysis.states import control_point_responses, curve_displacements, reached
    from ngspring.cli.tables import design_lines, make_console, points_table
    from ngspring.view.figure import save_figure
    from ngspring.view.rows import design_figure

    design, path = read_design(name)
    picture = path.with_suffix(".png") if out is None else out
    for line in design_lines(design):
        click.echo(line)
    responses = control_point_responses(
        design, curve_displacements(design), domain="quarter", threads=threads
    )
    forces = [reached(responses, point) for point in design.problem.control_points]
    make_console().print(points_table(design.problem, forces))
    save_figure(design_figure(design, responses, responses[0.0]), picture)
    click.echo(f"picture: {picture}")
    if None in forces:
        message = "; ".join(r.message for r in responses.values() if r.message)
        click.echo(f"incomplete: {message}", err=True)
        return NOT_CONVERGED
    return OK


@click.command("check", short_help="Check that designs are optimal and on target.")
@click.argument("names", metavar="[DESIGN]...", nargs=-1)
@click.option("--gallery", "all_stored", is_flag=True, help="Check every stored design.")
@click.option(
    "--tolerance",
    type=float,
    default=1e-6,
    show_default=True,
    help="Largest residual of Eq. 8 relative to its terms.",
)
@click.option(
    "--force-tolerance",
    type=float,
    default=0.1,
    show_default=True,
    help="Largest deviation of a force from its target in percent; a larger w_q makes it smaller.",
)
@threads_option
def check_command(
    names: tuple[str, ...],
    all_stored: bool,
    tolerance: float,
    force_tolerance: float,
    threads: int | None,
) -> int:
    """Check that designs are stationary points and meet their targets (within 0.1 %).

    Everything is computed anew from the design field. Control points with an offset of chi
    (eta) are shown, but need not be met.
    """
    from ngspring.cli.tables import add_check, check_table, make_console
    from ngspring.design.gallery import gallery
    from ngspring.kkt.stationarity import optimality

    if not tolerance > 0:
        raise ProblemError(f"--tolerance {tolerance} must be positive")
    if not force_tolerance > 0:
        raise ProblemError(f"--force-tolerance {force_tolerance} must be positive")
    designs = [(name, read_design(name)[0]) for name in names]
    if all_stored:
        designs += list(gallery.items())
    if not designs:
        raise click.UsageError(
            "there are no stored designs" if all_stored else "name a design, or use --gallery"
        )
    table = check_table()
    passed = True
    for name, design in designs:
        try:
            outcome: Any = optimality(design, threads=threads)
        except ConvergenceError as error:
            outcome = str(error)
        passed &= add_check(table, name, design, outcome, tolerance, force_tolerance / 100)
    make_console().print(table)
    return OK if passed else FAILED
