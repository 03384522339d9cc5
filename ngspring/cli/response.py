"""The command ``ngspring response``."""

from __future__ import annotations

from pathlib import Path

import click
import numpy as np

from ngspring.analysis.forward import load_displacement
from ngspring.analysis.response import Response, response_csv
from ngspring.analysis.states import curve_displacements
from ngspring.basics.files import write_text
from ngspring.cli.arguments import results_folder
from ngspring.cli.options import MOST_POINTS, OK, Finite, domain_option, incomplete, threads_option
from ngspring.cli.pictures import write_pictures
from ngspring.evolution.folder import read_design
from ngspring.view.curves import response_figure

#: Name of the curve's files; a run has one of the csv already.
CURVE = "response"


@click.command("response")
@click.argument("name", metavar="DESIGN")
@click.option("--from", "low", type=Finite(), help="First displacement d in mm.")
@click.option("--to", "high", type=Finite(), help="Last displacement d in mm.")
@click.option(
    "--points",
    type=click.IntRange(min=2, max=MOST_POINTS),
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
    response-custom.png, because response.csv is the curve of the run.
    """
    design, path = read_design(name)
    displacements = curve_displacements(design, low, high, points)
    custom = not np.array_equal(displacements, curve_displacements(design))
    stem = f"{CURVE}-custom" if custom else CURVE
    response = load_displacement(design, displacements, domain, threads=threads)
    for line in response_lines(response):
        click.echo(line)
    folder = results_folder(path, out)
    write_text(folder / f"{stem}.csv", response_csv(response))
    picture = folder / f"{stem}.png"
    names = write_pictures({picture: lambda: response_figure(response, design.problem)})
    # The standard output holds nothing but the table.
    click.echo(f"files in {folder}: {', '.join([f'{stem}.csv', *names])}", err=True)
    return OK if response.complete else incomplete(response.message)


def response_lines(response: Response) -> list[str]:
    """Displacements and forces in two columns."""
    lines = [f"{'d [mm]':>12} {'q [N]':>16}"]
    # At rest the force is what rounding leaves of 0.
    smallest = 1e-12 * max(map(abs, response.q), default=0.0)
    for d, q in zip(response.d, response.q, strict=True):
        # Adding 0 takes the sign of -0 away.
        lines.append(f"{d + 0.0:12.6g} {q if abs(q) > smallest else 0.0:16.9g}")
    return [*lines, *map(str, response.jumps)]
