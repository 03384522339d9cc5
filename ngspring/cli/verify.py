"""The command ``ngspring verify``."""

from __future__ import annotations

import json
from pathlib import Path

import click
from rich.table import Table

from ngspring.analysis.states import path_displacements
from ngspring.basics.files import write_text
from ngspring.basics.text import significant
from ngspring.cli.arguments import results_folder
from ngspring.cli.options import (
    OK,
    FiniteRange,
    across_option,
    incomplete,
    odd_in_option,
    offset_option,
    points_option,
    results_option,
    threads_option,
)
from ngspring.cli.pictures import write_pictures
from ngspring.cli.tables import make_console, new_table
from ngspring.evolution.folder import read_design
from ngspring.problem.imperfection import checked_odd_in
from ngspring.solid.imperfection import Imperfection, imperfection
from ngspring.solid.tolerance import offset_level
from ngspring.solid.verification import Verification, verify
from ngspring.view.imperfection import imperfection_figure
from ngspring.view.solid import contact_states_figure, verification_figure
from ngspring.view.text import deviation_text, signed_percent


@click.command("verify")
@click.argument("name", metavar="DESIGN")
@points_option(21)
@offset_option
@across_option
@click.option(
    "--imperfect",
    type=FiniteRange(min=0.0, min_open=True),
    metavar="MM",
    help="Compute the whole solid with surfaces moved by up to this many mm, too: is the spring"
    " stable?",
)
@odd_in_option("--imperfect")
@results_option
@threads_option
def verify_command(
    name: str,
    points: int,
    offset: float,
    elements_across: int,
    imperfect: float | None,
    odd_in: str | None,
    out: Path | None,
    threads: int | None,
) -> int:
    """Compare the third medium with a body-fitted mesh and real contact.

    The design is a file, a run folder, or the name of a stored design. Written are
    verification.json, verification.png (both curves) and contact.png (the deformed mesh with the
    contact pressure at every control point). With --imperfect also imperfection.json and
    imperfection.png, the curves of the perfect and the imperfect solid.
    """
    if odd_in is not None and imperfect is None:
        raise click.UsageError("--odd-in needs --imperfect: how far surfaces are moved")
    design, path = read_design(name)
    if odd_in is not None:
        checked_odd_in("odd_in", odd_in, design.problem.motion.axis)
    wanted = path_displacements(design, points)
    outcome = verify(
        design,
        wanted,
        level=offset_level(design, offset),
        elements_across=elements_across,
        threads=threads,
        folder=path.parent,
    )
    make_console().print(verification_table(outcome))
    for line in verification_lines(outcome):
        click.echo(line)
    folder = results_folder(path, out)
    write_text(folder / "verification.json", json.dumps(outcome.to_dict(), indent=1) + "\n")
    pictures = {
        folder / "verification.png": lambda: verification_figure(outcome),
        folder / "contact.png": lambda: contact_states_figure(outcome),
    }
    names = ["verification.json", *write_pictures(pictures)]
    code = OK if outcome.complete else incomplete(outcome.message)
    if imperfect is not None:
        moved = imperfection(
            design,
            imperfect,
            wanted,
            odd_in=odd_in,
            threads=threads,
            perfect=outcome.contact,
        )
        names += _tell_imperfection(moved, folder)
        code = max(code, OK if moved.complete else incomplete(moved.message))
    click.echo(f"files in {folder}: {', '.join(names)}")
    return code


def _tell_imperfection(outcome: Imperfection, folder: Path) -> list[str]:
    """Print what an imperfection does, and write its files; their names."""
    click.echo(outcome.verdict)
    write_text(folder / "imperfection.json", json.dumps(outcome.to_dict(), indent=1) + "\n")
    picture = {folder / "imperfection.png": lambda: imperfection_figure(outcome)}
    return ["imperfection.json", *write_pictures(picture)]


def verification_table(outcome: Verification) -> Table:
    """One row per control point."""
    table = new_table(
        "d [mm]",
        "target [N]",
        "third medium [N]",
        "real contact [N]",
        "deviation [N]",
        "deviation",
    )
    for verdict in outcome.points:
        table.add_row(
            f"{verdict.point.d:g}",
            f"{verdict.point.q:g}",
            significant(verdict.q_third_medium, 5),
            significant(verdict.q_contact, 5),
            significant(verdict.deviation, 3, "+", verdict.q_contact),
            signed_percent(verdict.relative, 2),
        )
    return table


def verification_lines(outcome: Verification) -> list[str]:
    """What else there is to know, in sentences."""
    contact, quality = outcome.contact, outcome.body.quality
    starts = contact.contact_starts
    lines = [
        f"largest deviation in force: {deviation_text(*outcome.largest_deviation)}",
        f"contact starts at d = {', '.join(significant(d, 4) for d in starts)} mm"
        if starts
        else "no contact on the path",
    ]
    stretch, x, y = outcome.largest_stretch
    place = f"x = {significant(x, 3)}, y = {significant(y, 3)} mm"
    lines.append(
        f"largest principal stretch: {stretch:.3f}, at {place};"
        f" all but a thousandth of the volume stays below {outcome.stretch_measure:.3f}"
    )
    gap = outcome.smallest_gap
    between = f"smallest gap {significant(gap, 3)} mm" if gap < float("inf") else "no gap"
    lines.append(f"smallest wall {significant(outcome.smallest_wall, 3)} mm, {between}, undeformed")
    if quality is not None:
        lines.append(
            f"mesh: {quality.elements} elements, at least {quality.elements_across} across a wall,"
            f" smallest angle {quality.smallest_angle:.0f} degrees,"
            f" area {signed_percent(quality.area_error, 4)}"
        )
    return [*lines, *outcome.remarks]
