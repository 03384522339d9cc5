"""The command ``ngspring tolerance``."""

from __future__ import annotations

import json
from pathlib import Path

import click
from rich.table import Table

from ngspring.basics.files import write_text
from ngspring.basics.text import significant
from ngspring.cli.arguments import results_folder
from ngspring.cli.options import (
    OK,
    across_option,
    incomplete,
    points_option,
    results_option,
    threads_option,
)
from ngspring.cli.pictures import write_pictures
from ngspring.cli.tables import make_console, new_table
from ngspring.evolution.folder import read_design
from ngspring.solid.tolerance import Tolerance, tolerance
from ngspring.view.tolerance import tolerance_figure


@click.command("tolerance")
@click.argument("name", metavar="DESIGN")
@click.option(
    "--offsets",
    help="Sizes in mm, with commas between them; each is taken in and out. By default 0.1, 0.25 and"
    " 0.5 % of sqrt(L H).",
)
@points_option(11)
@across_option
@results_option
@threads_option
def tolerance_command(
    name: str,
    offsets: str | None,
    points: int,
    elements_across: int,
    out: Path | None,
    threads: int | None,
) -> int:
    """Curves of the solid with its surfaces moved in and out: manufacturing errors.

    The design is a file, a run folder, or the name of a stored design. Written are tolerance.json
    and tolerance.png.
    """
    try:
        sizes = None if offsets is None else [float(size) for size in offsets.split(",")]
    except ValueError:
        raise click.UsageError(
            f"--offsets {offsets!r} must be numbers with commas between them, such as 0.1,0.25"
        ) from None
    design, path = read_design(name)
    outcome = tolerance(
        design, sizes, points=points, elements_across=elements_across, threads=threads
    )
    make_console().print(tolerance_table(outcome))
    folder = results_folder(path, out)
    write_text(folder / "tolerance.json", json.dumps(outcome.to_dict(), indent=1) + "\n")
    names = write_pictures({folder / "tolerance.png": lambda: tolerance_figure(outcome)})
    click.echo(f"files in {folder}: {', '.join(['tolerance.json', *names])}")
    return max([OK, *map(incomplete, tolerance_lines(outcome))])


def tolerance_table(outcome: Tolerance) -> Table:
    """Forces at the control points for each offset, and their derivative."""
    forces = [f"q({point.d:g}) [N]" for point in outcome.points]
    table = new_table("offset [mm]", "chi", *forces)
    for curve in outcome.curves:
        forces = [significant(curve.q(point.d), 5) for point in outcome.points]
        table.add_row(f"{curve.offset:+g}", significant(curve.level, 4, "+"), *forces)
    table.add_section()
    slopes = [significant(outcome.sensitivity(point.d), 4, "+") for point in outcome.points]
    table.add_row("dq/d(offset)", "[N/mm]", *slopes)
    return table


def tolerance_lines(outcome: Tolerance) -> list[str]:
    """What the dashes in the table mean: where which path ended, in sentences."""
    lines = []
    for curve in outcome.curves:
        if curve.contact is None:
            lines.append(f"offset {curve.offset:+g} mm: there is no such solid: {curve.message}")
        elif curve.message:
            what = "a thinner spring" if curve.offset < 0 else "the spring"
            lines.append(
                f"offset {curve.offset:+g} mm: {curve.message}; {what} may buckle there"
                " (see ngspring stability)"
            )
    return lines
