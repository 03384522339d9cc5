"""The commands ``ngspring verify``, ``tolerance`` and ``export``."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING

import click

from ngspring.cli.arguments import make_folder
from ngspring.cli.options import NOT_CONVERGED, threads_option
from ngspring.evolution.folder import read_design
from ngspring.view.text import number, signed_percent

if TYPE_CHECKING:
    from rich.table import Table

    from ngspring.solid.tolerance import Tolerance
    from ngspring.solid.verification import Verification

FORMATS = ("svg", "dxf", "step", "stl", "vtu", "msh")
#: Suffixes of a format besides its own name.
_OTHER_SUFFIXES = {"step": (".stp",)}

_out_option = click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Folder for the results; the design's own by default.",
)
_across_option = click.option(
    "--elements-across",
    type=click.IntRange(min=1),
    default=4,
    show_default=True,
    help="Fewest elements across a wall.",
)


@click.command("verify", short_help="Remodel a design with real contact and compare.")
@click.argument("name", metavar="DESIGN")
@click.option(
    "--points",
    type=click.IntRange(min=2),
    default=21,
    show_default=True,
    help="Displacements between the outermost control points (which are added, and zero).",
)
@click.option(
    "--offset",
    type=float,
    default=0.0,
    show_default=True,
    help="Move the surface outwards by this many mm on average first.",
)
@_across_option
@_out_option
@threads_option
def verify_command(
    name: str,
    points: int,
    offset: float,
    elements_across: int,
    out: Path | None,
    threads: int | None,
) -> int:
    """Compare the third medium with a body-fitted mesh and real contact.

    The design is a file, a run folder, or the name of a stored design. Written are
    verification.json, verification.png (both curves) and contact.png (the deformed mesh with the
    contact pressure at every control point).
    """
    from ngspring.basics.files import write_text
    from ngspring.cli.tables import make_console
    from ngspring.solid.tolerance import offset_level
    from ngspring.solid.verification import verify
    from ngspring.view.figure import save_figure
    from ngspring.view.solid import contact_states_figure, verification_figure

    design, path = read_design(name)
    outcome = verify(
        design,
        points=points,
        level=offset_level(design, offset),
        elements_across=elements_across,
        threads=threads,
    )
    make_console().print(verification_table(outcome))
    for line in verification_lines(outcome):
        click.echo(line)
    folder = path.parent if out is None else out
    make_folder(folder)
    write_text(folder / "verification.json", json.dumps(outcome.to_dict(), indent=1) + "\n")
    save_figure(verification_figure(outcome), folder / "verification.png")
    save_figure(contact_states_figure(outcome), folder / "contact.png")
    click.echo(f"files in {folder}: verification.json, verification.png, contact.png")
    if not outcome.complete:
        click.echo(f"incomplete: {outcome.message}", err=True)
        return NOT_CONVERGED
    return 0


def verification_table(outcome: Verification) -> Table:
    """One row per control point."""
    from rich.table import Table

    table = Table()
    for column in (
        "d [mm]",
        "target [N]",
        "third medium [N]",
        "real contact [N]",
        "deviation [N]",
        "deviation",
    ):
        table.add_column(column, justify="right")
    for verdict in outcome.points:
        table.add_row(
            f"{verdict.point.d:g}",
            f"{verdict.point.q:g}",
            number(verdict.q_third_medium, ".4f"),
            number(verdict.q_contact, ".4f"),
            number(verdict.deviation, "+.4f"),
            signed_percent(verdict.relative, 2),
        )
    return table


def verification_lines(outcome: Verification) -> list[str]:
    """What else there is to know, in sentences."""
    from ngspring.view.text import deviation_text

    contact, quality = outcome.contact, outcome.body.quality
    starts = contact.contact_starts
    lines = [
        f"largest deviation in force: {deviation_text(*outcome.largest_deviation)}",
        f"contact starts at d = {', '.join(f'{d:.3f}' for d in starts)} mm"
        if starts
        else "no contact on the path",
    ]
    stretch, x, y = outcome.largest_stretch
    lines.append(f"largest principal stretch: {stretch:.3f}, at x = {x:.1f}, y = {y:.1f} mm")
    lines.append(f"smallest wall: {outcome.smallest_wall:.2f} mm")
    if quality is not None:
        lines.append(
            f"mesh: {quality.elements} elements, at least {quality.elements_across} across a wall,"
            f" smallest angle {quality.smallest_angle:.0f} degrees,"
            f" area {signed_percent(quality.area_error, 4)}"
        )
    return [*lines, *outcome.remarks]


@click.command("tolerance", short_help="What moved surfaces do to the curve.")
@click.argument("name", metavar="DESIGN")
@click.option(
    "--offsets",
    default="0.1,0.25,0.5",
    show_default=True,
    help="Sizes in mm, with commas between them; each is taken in and out.",
)
@click.option(
    "--points",
    type=click.IntRange(min=2),
    default=11,
    show_default=True,
    help="Displacements between the outermost control points (which are added, and zero).",
)
@_across_option
@_out_option
@threads_option
def tolerance_command(
    name: str,
    offsets: str,
    points: int,
    elements_across: int,
    out: Path | None,
    threads: int | None,
) -> int:
    """Curves of the solid with its surfaces moved in and out: manufacturing errors.

    The design is a file, a run folder, or the name of a stored design. Written are tolerance.json
    and tolerance.png.
    """
    from ngspring.basics.files import write_text
    from ngspring.cli.tables import make_console
    from ngspring.solid.tolerance import tolerance
    from ngspring.view.figure import save_figure
    from ngspring.view.tolerance import tolerance_figure

    try:
        sizes = [float(size) for size in offsets.split(",")]
    except ValueError:
        raise click.UsageError(
            f"--offsets {offsets!r} must be numbers with commas between them, such as 0.1,0.25"
        ) from None
    design, path = read_design(name)
    outcome = tolerance(
        design, sizes, points=points, elements_across=elements_across, threads=threads
    )
    make_console().print(tolerance_table(outcome))
    folder = path.parent if out is None else out
    make_folder(folder)
    write_text(folder / "tolerance.json", json.dumps(outcome.to_dict(), indent=1) + "\n")
    save_figure(tolerance_figure(outcome), folder / "tolerance.png")
    click.echo(f"files in {folder}: tolerance.json, tolerance.png")
    lines = tolerance_lines(outcome)
    for line in lines:
        click.echo(f"incomplete: {line}", err=True)
    return NOT_CONVERGED if lines else 0


def tolerance_table(outcome: Tolerance) -> Table:
    """Forces at the control points for each offset, and their derivative."""
    from rich.table import Table

    table = Table()
    table.add_column("offset [mm]", justify="right")
    table.add_column("chi", justify="right")
    for point in outcome.points:
        table.add_column(f"q({point.d:g}) [N]", justify="right")
    for curve in outcome.curves:
        forces = [number(curve.q(point.d), ".4f") for point in outcome.points]
        table.add_row(f"{curve.offset:+g}", number(curve.level, "+.3f"), *forces)
    table.add_section()
    slopes = [number(outcome.sensitivity(point.d), "+.3f") for point in outcome.points]
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


@click.command("export", short_help="Drawing, solid or mesh for a workshop.")
@click.argument("name", metavar="DESIGN")
@click.option("--format", "kind", type=click.Choice(FORMATS), required=True)
@click.option(
    "--offset",
    type=float,
    default=0.0,
    show_default=True,
    help="Move the surface outwards by this many mm on average first.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    help="File to write; beside the design by default, with its name (and -solid for vtu).",
)
def export_command(name: str, kind: str, offset: float, out: Path | None) -> int:
    """Write the solid of a design, in mm and true size.

    The design is a file, a run folder, or the name of a stored design. svg and dxf hold the
    outlines; step and stl the solid, extruded by the thickness T or revolved about the axis; vtu
    and msh the second-order mesh. The default name of a vtu file ends in -solid, because a run's
    design.vtu holds the density on the grid.
    """
    from ngspring.solid.export.export import export_body
    from ngspring.solid.tolerance import offset_level

    if out is not None:
        _check_suffix(out, kind)
    design, path = read_design(name)
    target = _exported(path, kind) if out is None else out
    make_folder(target.parent)
    written = export_body(design, target, kind, level=offset_level(design, offset))
    what = "solid" if kind in ("step", "stl") else "outline" if kind in ("svg", "dxf") else "part"
    size = (
        f"{written.measure:.1f} mm^3" if kind in ("step", "stl") else f"{written.measure:.2f} mm^2"
    )
    plural = "" if written.parts == 1 else "s"
    click.echo(f"{written.path}: {written.parts} {what}{plural}, {size}")
    return 0


def _exported(path: Path, kind: str) -> Path:
    """Default name of an exported file: never that of a run's own design.vtu."""
    stem = f"{path.stem}-solid" if kind == "vtu" else path.stem
    return path.with_name(f"{stem}.{kind}")


def _check_suffix(out: Path, kind: str) -> None:
    fitting = (f".{kind}", *_OTHER_SUFFIXES.get(kind, ()))
    if out.suffix.lower() not in fitting:
        found = f"the suffix {out.suffix}" if out.suffix else "a name without a suffix"
        raise click.UsageError(
            f"--out {out}: {found} does not fit --format {kind}, it must be {' or '.join(fitting)}"
        )
