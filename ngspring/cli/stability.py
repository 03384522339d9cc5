"""The command ``ngspring stability``."""

from __future__ import annotations

from pathlib import Path

import click
from rich.table import Table

from ngspring.analysis.stability import Critical, Stability, stability
from ngspring.analysis.states import curve_displacements
from ngspring.basics.text import significant
from ngspring.cli.arguments import results_folder
from ngspring.cli.options import OK, incomplete, points_option, threads_option
from ngspring.cli.pictures import write_pictures
from ngspring.cli.tables import make_console, new_table
from ngspring.evolution.folder import read_design
from ngspring.view.stability import stability_figure

PICTURE = "stability.png"


@click.command("stability")
@click.argument("name", metavar="DESIGN")
@points_option(9)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help=f"Folder for {PICTURE}; the design's own by default.",
)
@threads_option
def stability_command(name: str, points: int, out: Path | None, threads: int | None) -> int:
    """Lowest eigenvalue of the full domain's tangent along the symmetric load path.

    The design is a file, a run folder, or the name of a stored design. Where the eigenvalue is
    negative the spring leaves the symmetric path; the critical displacement is found and its mode
    is drawn. An unstable design is a result, not an error: the exit code is 0.
    """
    design, path = read_design(name)
    controls = [point.d for point in design.problem.control_points]
    displacements = sorted({0.0, *controls, *curve_displacements(design, points=points)})
    outcome = stability(design, displacements, threads=threads)
    make_console().print(stability_table(outcome))
    for line in stability_lines(outcome):
        click.echo(line)
    folder = results_folder(path, out)
    picture = folder / PICTURE
    if write_pictures({picture: lambda: stability_figure(design, outcome)}):
        click.echo(f"picture: {picture}")
    return OK if outcome.complete else incomplete(outcome.message)


def stability_table(outcome: Stability) -> Table:
    """One row per displacement."""
    columns = ("d [mm]", "q [N]", "lowest eigenvalue", "negative", "", "in solid", "symmetry")
    table = new_table(*columns, texts=("", "symmetry"))
    largest = max(map(abs, outcome.q), default=0.0)
    for point, relative in zip(outcome.points, outcome.relative, strict=True):
        # At rest all modes of the solid have the same eigenvalue: no one of them is the lowest.
        mode = None if point.d == 0.0 else point.modes[0]
        table.add_row(
            f"{point.d:g}",
            significant(point.q, 6, among=largest),
            f"{relative:.5f}",
            "unknown" if point.negative is None else f"{point.negative}",
            point.verdict,
            "" if mode is None else f"{100 * mode.shares[0]:.0f} %",
            "" if mode is None else mode.symmetry_text,
        )
    return table


def stability_lines(outcome: Stability) -> list[str]:
    """Verdict, and each loss of stability."""
    if outcome.stable:
        first, last = outcome.d.min(), outcome.d.max()
        return [f"the symmetric path is stable from d = {first:g} to {last:g} mm"]
    return [_critical_line(critical) for critical in outcome.critical]


def _critical_line(critical: Critical) -> str:
    mode = critical.mode
    side = "compression" if critical.d < 0 else "tension"
    whose = "the spring's" if mode.kind == "solid" else f"the third medium's own, in {mode.kind}"
    return (
        f"unstable in {side} from d = {significant(critical.d, 4)} mm, q = {critical.q:.6g} N on:"
        f" a mode {mode.symmetry_text}, {whose}"
        f" ({100 * mode.shares[0]:.0f} % of its strain energy in solid)"
    )
