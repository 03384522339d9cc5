"""The command ``ngspring family``."""

from __future__ import annotations

from pathlib import Path

import click

from ngspring.basics.files import write_text
from ngspring.basics.text import significant
from ngspring.cli.arguments import make_folder, read_problem
from ngspring.cli.options import OK, incomplete, solver_option, threads_option
from ngspring.cli.pictures import write_pictures
from ngspring.cli.tables import make_console, new_table
from ngspring.evolution.family import Family, family_members
from ngspring.evolution.folder import read_design
from ngspring.evolution.follow import Reached
from ngspring.problem.point import worst_deviation
from ngspring.view.family import family_figure
from ngspring.view.text import signed_percent, width_symbol

#: What a case of the paper has not, and a design that is followed keeps.
LIMITS = ("stretch_limit", "energy_limit", "k_s", "wall", "gap", "k_w")


@click.command("family")
@click.argument("name", metavar="DESIGN")
@click.option(
    "--to",
    "goal",
    required=True,
    metavar="CASE|FILE.toml",
    help="Whose control points the family ends with: as many as the design has.",
)
@click.option(
    "--members",
    type=click.IntRange(2, 1000),
    default=11,
    show_default=True,
    help="Designs in all, evenly spread.",
)
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    help="Folder of the results; runs/family-DESIGN-GOAL by default.",
)
@threads_option
@solver_option
def family_command(
    name: str, goal: str, members: int, out: Path | None, threads: int | None, solver: str
) -> int:
    """Designs between two sets of targets, each followed from the one before in seconds.

    The design is a file, a run folder, or the name of a stored design, and has to be finished. Only
    control points move; of the goal nothing else is taken but what has to be as in the design.
    Written are a file for each member, family.csv and family.png.
    """
    design, path = read_design(name)
    wanted, goal_name = read_problem(goal)
    # A design on another mesh than the case's own, or with limits: they stay its own.
    problem = design.problem
    own = {key: getattr(problem, key) for key in ("elements", "l_i", "domain", *LIMITS)}
    asked = wanted.replace(**own)
    folder = out or Path("runs", f"family-{path.stem}-{goal_name}")
    make_folder(folder)
    found: list[Reached] = []
    for member in family_members(design, asked, members, threads=threads, solver=solver):
        member.design.save(folder / f"member-{len(found):02d}.npz")
        found.append(member)
        click.echo(_line(member))
    family = Family(tuple(found))
    make_console().print(_table(family))
    write_text(folder / "family.csv", family.to_csv())
    names = write_pictures({folder / "family.png": lambda: family_figure(family)})
    click.echo(f"files in {folder}: {', '.join(['member-NN.npz', 'family.csv', *names])}")
    message = found[-1].message
    return incomplete(message) if message else OK


def _line(member: Reached) -> str:
    """What is said of a member as soon as it is there."""
    design = member.design
    history = design.history
    iterations = 0 if history is None else history.newton_iterations
    seconds = 0.0 if history is None else history.last().seconds
    how = "by the evolution" if member.evolved else "followed"
    width = f"{width_symbol(design.problem)} {design.relative_width:.4f}"
    return f"{member.share:5.0%}  {width}  {how}, {iterations} iterations so far, {seconds:.0f} s"


def _table(family: Family) -> object:
    """Targets, worst deviation and W/H of each member."""
    points = family.designs[0].problem.control_points
    symbol = width_symbol(family.designs[0].problem)
    names = [f"target at {point.d:g} mm [N]" for point in points]
    table = new_table("member", *names, "worst deviation", symbol, "")
    for k, member in enumerate(family.members):
        now = member.design.problem.control_points
        far = worst_deviation(now, member.design.info["q"])
        cells = [significant(point.q, 5) for point in now]
        cells += ["–" if far is None else signed_percent(far, 3)]
        cells += [f"{member.design.relative_width:.4f}", "evolution" if member.evolved else ""]
        table.add_row(str(k), *cells)
    return table
