"""The command ``ngspring check``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import click
import numpy as np
from rich.table import Table

from ngspring.analysis.finished import Stored, stored_responses
from ngspring.analysis.states import reached
from ngspring.basics.arrays import FloatArray
from ngspring.basics.errors import ConvergenceError, ProblemError
from ngspring.basics.text import significant
from ngspring.cli.options import FAILED, OK, UNSOUND, Finite, threads_option
from ngspring.cli.tables import make_console
from ngspring.design.corrections import MISSED, worst_of_solid
from ngspring.design.design import Design
from ngspring.design.gallery import PART, gallery, parts
from ngspring.design.soundness import flaw
from ngspring.evolution.folder import read_design
from ngspring.kkt.stationarity import Optimality, optimality
from ngspring.part.realisation import PartSettings
from ngspring.part.solid_forces import solid_forces
from ngspring.problem.point import ControlPoint
from ngspring.view.text import deviation_percent

#: So far, relative to the largest, may forces of one design differ that were computed twice.
_SAME_FORCE = 1e-6
#: And those of a solid, whose mesh may be another one with another Netgen.
_SAME_SOLID = 2e-3


@click.command("check")
@click.argument("names", metavar="[DESIGN]...", nargs=-1)
@click.option("--gallery", "all_stored", is_flag=True, help="Check every stored design.")
@click.option("--parts", "all_parts", is_flag=True, help="Check every stored part.")
@click.option(
    "--tolerance",
    type=Finite(),
    default=1e-6,
    show_default=True,
    help="Largest residual of Eq. 8 relative to its terms.",
)
@click.option(
    "--force-tolerance",
    type=Finite(),
    default=0.1,
    show_default=True,
    help="Largest deviation of a force from its target in percent; a larger w_q makes it smaller.",
)
@threads_option
def check_command(
    names: tuple[str, ...],
    all_stored: bool,
    all_parts: bool,
    tolerance: float,
    force_tolerance: float,
    threads: int | None,
) -> int:
    """Check that designs are stationary points and meet their targets (within 0.1 %).

    Of a part the third medium has to have the forces that were asked of it, and the solid, by real
    contact, those that are stored, which miss no target by more than 0.5 %.

    Everything is computed anew from the design field. Control points with an offset of chi
    (eta) are shown, but need not be met. A load path that is stored with a design has to have the
    same forces. Exit code 1 if one fails, 4 if the only fault is that a design is not connected, or
    carries its load through grey.
    """
    if not tolerance > 0:
        raise ProblemError(f"--tolerance {tolerance} must be positive")
    if not force_tolerance > 0:
        raise ProblemError(f"--force-tolerance {force_tolerance} must be positive")
    designs: list[tuple[str, Design, Path | None]] = []
    for name in names:
        design, path = read_design(name)
        designs.append((name, design, path.parent))
    if all_stored:
        designs += [(name, design, None) for name, design in gallery.items()]
    if all_parts:
        designs += [(f"{name}{PART}", design, None) for name, design in parts.items()]
    if not designs:
        stored_none = "there are no stored designs"
        wanted = all_stored or all_parts
        raise click.UsageError(stored_none if wanted else "name a design, or use --gallery")
    table = check_table()
    codes = {OK}
    for name, design, folder in designs:
        try:
            outcome: Optimality | str = optimality(design, threads=threads)
        except ConvergenceError as error:
            outcome = str(error)
        stored = stored_responses(design, folder)
        limits = tolerance, force_tolerance / 100
        solid = None if design.solid is None else solid_forces(design, threads=threads)[0]
        codes.add(add_check(table, name, design, outcome, *limits, stored, solid))
    make_console().print(table)
    return FAILED if FAILED in codes else max(codes)


def _has_forces(stored: Stored, points: Sequence[ControlPoint], q: FloatArray) -> bool:
    """Whether a stored load path has these forces at the control points that are on curves."""
    found = [
        (reached(stored, point), own)
        for point, own in zip(points, q, strict=True)
        if point.on_curves
    ]
    return all(
        force is not None and abs(force - own) <= _SAME_FORCE * float(np.abs(q).max())
        for force, own in found
    )


def _faults_of_solid(design: Design, solid: FloatArray) -> list[str]:
    """Why a part does not carry what it should."""
    points, noted = design.problem.control_points, np.array(design.solid)
    reasons = []
    if not np.allclose(solid, noted, rtol=_SAME_SOLID, atol=0.0, equal_nan=True):
        reasons.append("its solid (the forces are not those that are stored)")
    far = abs(worst_of_solid(points, solid.tolist()))
    if not far <= PartSettings().tolerance and not design.info.get(MISSED):
        reasons.append(f"its solid (off by up to {100 * far:.2f} %)")
    return reasons


def check_table() -> Table:
    """Header of the table that `add_check` fills."""
    table = Table()
    for column in ("design", "residual", "q [N]", "deviations", "W/H or D/H", "verdict"):
        # Long paths and reasons give way to the numbers.
        text = column in ("design", "verdict")
        table.add_column(column, justify="left" if text else "right", no_wrap=not text)
    return table


def add_check(
    table: Table,
    name: str,
    design: Design,
    outcome: Optimality | str,
    tolerance: float,
    force_tolerance: float,
    stored: Stored | None = None,
    solid: FloatArray | None = None,
) -> int:
    """Add a design's row to the table; returns the exit code it asks for.

    Parameters
    ----------
    table : rich.table.Table
    name : str
    design : Design
    outcome : Optimality or str
        What `ngspring.optimality` found, or why it could not.
    tolerance : float
        Largest relative residual.
    force_tolerance : float
        Largest relative deviation of a force from its target.
    stored : mapping from eta to StoredResponse, optional
        Its stored load path.
    solid : array, optional
        Forces of a part's solid, computed anew.
    """
    ratio = f"{design.relative_width:.4f}"
    if isinstance(outcome, str):
        table.add_row(name, "-", "-", "-", ratio, f"fails: {outcome}")
        return FAILED
    points = design.problem.control_points
    reasons = []
    if not outcome.residual <= tolerance:
        reasons.append("residual")
    judged = [abs(dev) for dev, point in zip(outcome.deviation, points, strict=True) if point.own]
    if not all(dev <= force_tolerance for dev in judged):
        limit = f"{100 * force_tolerance:g} %"
        reasons.append(f"forces (off by up to {100 * max(judged):.3f} %, limit {limit})")
    if stored is not None and not _has_forces(stored, points, outcome.q):
        reasons.append("its stored load path (the forces are others)")
    if solid is not None:
        reasons += _faults_of_solid(design, solid)
    shown_forces = outcome.q if solid is None else solid
    code = FAILED if reasons else OK
    no_part = flaw(design, outcome.grey)
    if no_part:
        reasons.append(no_part)
        code = code or UNSOUND
    table.add_row(
        name,
        f"{outcome.residual:.1e}",
        "\n".join(significant(q, 6) for q in shown_forces),
        "\n".join(
            deviation_percent(float(q), point.q_star if solid is None else point.q)
            + (f" ({point.variant})" if point.variant else "")
            for q, point in zip(shown_forces, points, strict=True)
        ),
        ratio,
        f"fails: {' and '.join(reasons)}" if reasons else "passes",
    )
    return code
