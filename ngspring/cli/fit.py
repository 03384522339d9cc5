"""The command ``ngspring fit``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import click
from rich.table import Table

from ngspring.basics.checks import finite_number, shown
from ngspring.basics.errors import ProblemError
from ngspring.basics.files import write_text
from ngspring.cli.arguments import check_writable
from ngspring.cli.options import OK, Finite
from ngspring.cli.pictures import write_pictures
from ngspring.cli.tables import make_console, new_table
from ngspring.problem.curves.branches import BRANCHES
from ngspring.problem.fit.candidates import CANDIDATES
from ngspring.problem.fit.data import MaterialTest, read_material_test
from ngspring.problem.fit.fitting import Fit, fit, fit_all, uncertainty_text
from ngspring.problem.laws.modes import MODES
from ngspring.problem.material import FITTED_NU
from ngspring.view.fit import fit_figure

_FILE = click.Path(dir_okay=False)


@click.command("fit")
@click.argument("files", metavar="[TEST.csv]...", nargs=-1, type=_FILE)
@click.option("--uniaxial", multiple=True, metavar="FILE", type=_FILE, help="A uniaxial test.")
@click.option("--planar", multiple=True, metavar="FILE", type=_FILE, help="A planar test.")
@click.option("--equibiaxial", multiple=True, metavar="FILE", type=_FILE, help="A biaxial test.")
@click.option(
    "--law",
    type=click.Choice([*CANDIDATES, "all"]),
    default="yeoh",
    show_default=True,
    help="What to fit; ogden-2 has two terms; all compares them.",
)
@click.option(
    "--nu",
    type=Finite(),
    default=FITTED_NU,
    show_default=True,
    help="Poisson's ratio at small strains, which gives K.",
)
@click.option("--stretches", help="Use these stretches only, as 0.7,2.5.")
@click.option("--compression", is_flag=True, help="The files count compression as positive.")
@click.option("--branch", type=click.Choice(BRANCHES), help="Of tests with loops; loading if not.")
@click.option("--specimen", type=click.IntRange(min=1), help="Which of several in a file.")
@click.option(
    "--write",
    "out",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Write the law as a [material] table in a TOML file.",
)
@click.option(
    "--picture",
    type=click.Path(path_type=Path, dir_okay=False),
    help="Tests and curves; by default beside the file of --write, and else none.",
)
def fit_command(
    files: tuple[str, ...],
    uniaxial: tuple[str, ...],
    planar: tuple[str, ...],
    equibiaxial: tuple[str, ...],
    law: str,
    nu: float,
    stretches: str | None,
    compression: bool,
    branch: str | None,
    specimen: int | None,
    out: Path | None,
    picture: Path | None,
) -> int:
    """Fit a material law to tests of the material, one or several.

    A test is a CSV file with columns of stretch or strain and of stress, nominal or true, whose
    header may give units: `strain [%];stress [MPa]`. Tension is positive. Which test it was is said
    by the option, or else by a word in the name of the file or in the lines above its numbers
    (planar, pure shear; biaxial; uniaxial, tensile). A planar test, a wide strip that is pulled, is
    what a spring in plane strain does: it counts twice.

    Errors are relative to the stress. The file of --write is taken into a problem by
    `material = "material.toml"`, and by `ngspring targets --material material.toml`.
    """
    if out is not None:
        if law == "all":
            raise click.UsageError("--law all compares: name one of them to --write it")
        check_writable(out)
    reading = {"compression": compression, "branch": branch, "specimen": specimen}
    tests = _tests(files, (uniaxial, planar, equibiaxial), reading)
    if stretches is not None:
        limits = _limits(stretches)
        tests = [test.between(*limits) for test in tests]
    for test in tests:
        _say_test(test)
    if law == "all":
        fits = fit_all(tests, nu=nu)
        make_console().print(_comparison(fits))
    else:
        fits = [fit(tests, law, nu=nu)]
        make_console().print(_parameters(fits[0]))
        _say_fit(fits[0])
    if out is not None:
        write_text(out, fits[0].to_toml())
        click.echo(f'written: {out}; a problem beside it takes it by: material = "{out.name}"')
    path = picture or (None if out is None else out.with_suffix(".png"))
    if path is not None and write_pictures({path: lambda: fit_figure(fits)}):
        click.echo(f"picture: {path}")
    return OK


def _tests(
    files: tuple[str, ...],
    told: tuple[tuple[str, ...], ...],
    reading: Mapping[str, Any],
) -> list[MaterialTest]:
    named: list[tuple[str | None, str]] = [(None, file) for file in files]
    named += [(test, file) for test, group in zip(MODES, told, strict=True) for file in group]
    if not named:
        raise click.UsageError("name a CSV file of a test")
    return [read_material_test(file, test, **reading) for test, file in named]


def _limits(text: str) -> tuple[float, float]:
    parts = text.replace(";", ",").split(",")
    try:
        low, high = (finite_number("--stretches", float(part)) for part in parts)
    except ValueError:
        raise ProblemError(f"--stretches {shown(text)} must be two numbers, as 0.7,2.5") from None
    return low, high


def _say_test(test: MaterialTest) -> None:
    click.echo(
        f"{test.name}: {test.test}, {len(test.stretch)} points, stretches"
        f" {test.stretch.min():.4g} to {test.stretch.max():.4g}, nominal stresses"
        f" {test.stress.min():.4g} to {test.stress.max():.4g} MPa"
    )
    for remark in test.remarks:
        click.echo(f"note: {remark}")


def _parameters(found: Fit) -> Table:
    table = new_table("parameter", "value", "+-", "unit", texts=("parameter", "unit"))
    for name, value in found.law.parameters.items():
        unit = "MPa" if name in found.law.stresses else ""
        spread = f"from nu = {found.nu:g}"
        if name in found.uncertainty:
            spread = uncertainty_text(found.uncertainty[name])
        table.add_row(name, f"{value:.6g}", spread, unit)
    return table


def _say_fit(found: Fit) -> None:
    for test in found.tests:
        errors = abs(found.errors(test))
        k = int(errors.argmax())
        click.echo(
            f"{test.name} ({test.test}): relative error"
            f" {100 * float((errors**2).mean()) ** 0.5:.2g} % (root mean square), at most"
            f" {100 * float(errors[k]):.2g} %, at a stretch of {test.stretch[k]:.4g}"
        )
    E = 3 * found.law.initial_moduli[1]
    click.echo(f"E = {E:.4g} MPa at small strains (incompressible)")
    click.echo(f"stable for stretches: {found.stable}")
    for remark in found.remarks:
        click.echo(f"note: {remark}")


def _comparison(fits: list[Fit]) -> Table:
    """A row for each law, the best first."""
    columns = ("law", "parameters", "error", "largest", "E [MPa]", "stable up to", "note")
    table = new_table(*columns, texts=("law", "note"))
    for each in fits:
        limit, test = each.stable.first_limit()
        unknown = [name for name, value in each.uncertainty.items() if not value < float("inf")]
        table.add_row(
            each.candidate,
            str(len(each.uncertainty)),
            f"{100 * each.mean_error:.2g} %",
            f"{100 * each.largest_error:.2g} %",
            f"{3 * each.law.initial_moduli[1]:.4g}",
            f"{limit:.3g}" if test else "10",
            f"not determined: {', '.join(unknown)}" if unknown else "",
        )
    table.caption = (
        "Relative errors, root mean square and largest. Stable up to a principal stretch, in any of"
        " the three tests."
    )
    return table
