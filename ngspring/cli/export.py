"""The command ``ngspring export``."""

from __future__ import annotations

from pathlib import Path

import click

from ngspring.basics.text import significant
from ngspring.cli.arguments import make_folder
from ngspring.cli.options import OK, offset_option
from ngspring.evolution.folder import read_design
from ngspring.solid.export.export import export_body
from ngspring.solid.tolerance import offset_level

FORMATS = ("svg", "dxf", "step", "stl", "vtu", "msh")
#: Suffixes of a format besides its own name.
_OTHER_SUFFIXES = {"step": (".stp",)}


@click.command("export")
@click.argument("name", metavar="DESIGN")
@click.option("--format", "kind", type=click.Choice(FORMATS), required=True)
@offset_option
@click.option(
    "--polylines",
    type=float,
    metavar="MM",
    help="Closed polylines in a dxf file, this many mm from the contour at most, in place of"
    " splines.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path, dir_okay=False),
    help="File to write; beside the design by default, with its name (and -solid for vtu).",
)
def export_command(
    name: str, kind: str, offset: float, polylines: float | None, out: Path | None
) -> int:
    """Write the solid of a design, in mm and true size.

    The design is a file, a run folder, or the name of a stored design. svg and dxf hold the
    outlines; step and stl the solid, extruded by the thickness T or revolved about the axis; vtu
    and msh the second-order mesh. The default name of a vtu file ends in -solid, because a run's
    design.vtu holds the density on the grid.
    """
    if out is not None:
        _check_suffix(out, kind)
    design, path = read_design(name)
    target = _exported(path, kind) if out is None else out
    make_folder(target.parent)
    written = export_body(
        design,
        target,
        kind,
        level=offset_level(design, offset),
        tolerance=polylines,
        polylines=polylines is not None,
    )
    what = "solid" if kind in ("step", "stl") else "outline" if kind in ("svg", "dxf") else "part"
    size = f"{significant(written.measure, 6)} mm^{3 if kind in ('step', 'stl') else 2}"
    plural = "" if written.parts == 1 else "s"
    click.echo(f"{written.path}: {written.parts} {what}{plural}, {size}")
    return OK


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
