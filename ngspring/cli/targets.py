"""The command ``ngspring targets``."""

from __future__ import annotations

import shlex
from pathlib import Path
from typing import Any, TypeAlias

import click
from rich.table import Table

from ngspring.basics.checks import finite_number, shown
from ngspring.basics.errors import ProblemError
from ngspring.basics.files import write_text
from ngspring.basics.text import significant
from ngspring.cli.arguments import check_writable, read_problem
from ngspring.cli.options import FAILED, OK, Finite, anywhere_option
from ngspring.cli.tables import make_console, new_table
from ngspring.problem.annotated import annotated_toml
from ngspring.problem.cases import cases
from ngspring.problem.curves.branches import BRANCHES
from ngspring.problem.curves.curve import read_curve
from ngspring.problem.curves.table import QUANTITIES
from ngspring.problem.kinematics import KINEMATICS
from ngspring.problem.material import young_and_poisson
from ngspring.problem.spring import SpringProblem, height_and_area
from ngspring.problem.targets.from_curve import problem_from_curve
from ngspring.problem.targets.full_block import block_force
from ngspring.problem.targets.plausibility import check_targets
from ngspring.problem.toml import names_material_file, read_law

#: What to take of a curve's file.
_READING = ("compression", "branch", "specimen", "quantities")
#: Ranges of d and q.
Axes: TypeAlias = tuple[tuple[float, float], tuple[float, float]]


@click.command("targets")
@click.argument("curve", metavar="CURVE.csv|CURVE.svg|FILE.toml|CASE")
@click.option("--length", "L", type=Finite(), help="L in mm: across the load, or the diameter.")
@click.option("--height", "H", type=Finite(), help="H in mm: along the load.")
@click.option("--thickness", "T", type=Finite(), help="Out-of-plane thickness T in mm.")
@click.option(
    "--material", help="Elastomer by name, see `ngspring materials`, or a file of `ngspring fit`."
)
@click.option("--shore-a", "shore_A", type=Finite(), help="Hardness instead of E.")
@click.option("--E", "E", type=Finite(), help="Young's modulus in MPa.")
@click.option("--nu", type=Finite(), help="Poisson's ratio; 0.4 by default.")
@click.option("--kinematics", type=click.Choice(list(KINEMATICS)), help="Plane strain by default.")
@click.option("--elements", type=int, help="N of the N x N mesh; 80 by default.")
@click.option("--points", type=click.IntRange(min=1), help="Number of control points to choose.")
@click.option("--at", help="Their displacements in mm instead, as -20,-10,10.")
@click.option("--d-range", help="Of an SVG drawing: d in mm at the left and right, as -20,10.")
@click.option("--q-range", help="Of an SVG drawing: q in N at the bottom and top, as -6,3.")
@click.option(
    "--compression",
    is_flag=True,
    default=None,
    help="The curve counts compression as positive, as test machines do: turn both signs.",
)
@click.option(
    "--branch",
    type=click.Choice(BRANCHES),
    help="Of a test with loops: the branch away from d = 0, as by default, the one back to it, or"
    " the mean of both curves.",
)
@click.option(
    "--specimen", type=click.IntRange(min=1), help="Which of several specimens (curves) in a file."
)
@click.option(
    "--quantities",
    type=click.Choice(list(QUANTITIES)),
    help="Of a file that has both: displacement and force, as by default, or strain and stress.",
)
@click.option("--robust", is_flag=True, help="Add the dilated control point of section 2.6.")
@click.option(
    "--write",
    "out",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write the problem for `ngspring optimize`.",
)
@anywhere_option
def targets_command(
    curve: str,
    points: int | None,
    at: str | None,
    d_range: str | None,
    q_range: str | None,
    robust: bool,
    out: Path | None,
    targets_anywhere: bool,
    **described: float | int | str | None,
) -> int:
    """Check a target before an hour is spent on it.

    The curve is a CSV file with columns d and q, or strain and stress, whose header may give
    units: `d [mm];q [N]`; or an SVG drawing of one path, inside a rectangle or the page that
    --d-range and --q-range describe. Tension is positive; of a test that counts compression as
    positive --compression turns the signs. Sizes not given are the paper's:
    100 x 100 x 1 mm, E = 1 MPa, nu = 0.4. What was assumed is said in notes.

    Exit code 1 if the target cannot be met.
    """
    given = {key: value for key, value in described.items() if value is not None}
    notes: list[str] = []
    text = ""
    if Path(curve).suffix.lower() == ".toml" or curve.strip().upper() in cases:
        if given or points or at or robust or out or d_range or q_range:
            raise click.UsageError("a problem is checked as it is: options belong to a curve")
        problem = read_problem(curve, notes, targets_anywhere)[0]
    else:
        if out is not None:
            check_writable(out)
        name = curve if out is None else out.name
        axes = _axes(curve, d_range, q_range)
        problem, text = _problem_of_curve(curve, name, given, points, at, robust, axes, notes)
    click.echo(_described(problem))
    make_console().print(_points_table(problem))
    for note in notes:
        click.echo(f"note: {note}")
    findings = check_targets(problem)
    for finding in findings:
        click.echo(f"{finding.level}: {finding.message}")
    if not findings:
        click.echo("nothing speaks against this target")
    refused = any(finding.level == "error" for finding in findings)
    if out is not None:
        write_text(out, text)
        optimize = f"ngspring optimize {shlex.quote(str(out))}"
        advice = f"{optimize} will refuse it, unless --anyway is given" if refused else optimize
        click.echo(f"written: {out}; {'but' if refused else 'next:'} {advice}")
    return FAILED if refused else OK


def _problem_of_curve(
    curve: str,
    name: str,
    given: dict[str, Any],
    points: int | None,
    at: str | None,
    robust: bool,
    axes: Axes | None,
    notes: list[str],
) -> tuple[SpringProblem, str]:
    """The problem as it would be read from the file that is written, and that file."""
    if names_material_file(given.get("material")):
        given["material"] = read_law(given["material"])
    reading = {key: given.pop(key) for key in _READING if key in given}
    if "T" in given and not KINEMATICS[str(given.get("kinematics", "plane strain"))].thick:
        raise click.UsageError("an axisymmetric spring has no thickness")
    target = read_curve(curve, *height_and_area(given), axes, **reading)
    at_d = None if at is None else _numbers("--at", at)
    problem = problem_from_curve(target, points, at_d, robust=robust, name=Path(name).stem, **given)
    notes += target.notes(problem.control_points)
    text = annotated_toml(problem, Path(curve).name, given, notes)
    return SpringProblem.parse_toml(text), text


def _numbers(option: str, text: str) -> list[float]:
    try:
        return [finite_number(option, float(part)) for part in text.replace(";", ",").split(",")]
    except ProblemError:
        raise
    except ValueError:
        raise ProblemError(f"{option} {shown(text)} must be numbers, as -20,-10,10") from None


def _axes(curve: str, d_range: str | None, q_range: str | None) -> Axes | None:
    """Ranges of a drawing's axes."""
    if Path(curve).suffix.lower() != ".svg":
        if d_range or q_range:
            raise click.UsageError("--d-range and --q-range belong to an SVG drawing")
        return None
    if d_range is None or q_range is None:
        raise click.UsageError("an SVG drawing needs --d-range and --q-range")
    pairs = [_numbers("--d-range", d_range), _numbers("--q-range", q_range)]
    if any(len(pair) != 2 for pair in pairs):
        raise click.UsageError("--d-range and --q-range are two numbers each, as -20,10")
    return (pairs[0][0], pairs[0][1]), (pairs[1][0], pairs[1][1])


def _described(problem: SpringProblem) -> str:
    """A problem in one line."""
    E, nu = young_and_poisson(problem.K, problem.G)
    size = f"{problem.L:g} x {problem.H:g}" + (f" x {problem.T:g}" if problem.motion.thick else "")
    return (
        f"{problem.name or 'spring'}: {problem.kinematics}, {size} mm, E = {E:.3g} MPa,"
        f" nu = {nu:.3g}, {problem.elements} x {problem.elements} elements"
    )


def _points_table(problem: SpringProblem) -> Table:
    columns = ("d [mm]", "q [N]", "η", "strain d/H", "stress q/area [MPa]", "of a full block")
    table = new_table(*columns)
    for point in problem.control_points:
        table.add_row(
            f"{point.d:g}",
            f"{point.q:g}",
            point.eta_text,
            significant(point.d / problem.H, 3, "+"),
            f"{point.q / problem.top_area:.4g}",
            f"{100 * point.q / block_force(problem, point.d):.3g} %",
        )
    return table
